"""Starting the host: which parts this machine has, and putting them in place once."""

from __future__ import annotations

import functools
import importlib
import os
import re
import subprocess
import sys
import types


class HostUnavailable(RuntimeError):
    """A part of the host that was asked for is missing on this machine; the message says which and what to do."""


@functools.cache
def wheel_problem() -> str:
    """Why MRML is not available here; empty if it is."""
    try:
        importlib.import_module("slicer_core")
    except ImportError as error:
        version = ".".join(map(str, sys.version_info[:2]))
        return (
            f"the package slicer-core cannot be imported ({error}); it has wheels for Python 3.10 to 3.13 on Linux and"
            f" Windows (x86-64) and macOS (arm64), this is Python {version} on {sys.platform}"
        )
    return ""


@functools.cache
def qt_problem() -> str:
    """Why the panel cannot be shown here; empty if it can."""
    try:
        importlib.import_module("PySide6.QtUiTools")
    except ImportError as error:
        return (
            f"PySide6 cannot be imported ({error}); on Debian and Ubuntu: apt-get install libegl1 libgl1 libxkbcommon0"
        )
    return ""


@functools.cache
def rendering_problem() -> str:
    """Why nothing can be drawn off screen here; empty if it can.

    Tried in a process of its own, because some drivers end the process that asks for a context they cannot give.
    """
    script = (
        "import vtk; w = vtk.vtkRenderWindow(); w.SetOffScreenRendering(1); w.AddRenderer(vtk.vtkRenderer());"
        "w.Render();"
        "v = [l for l in w.ReportCapabilities().splitlines() if 'version string' in l]; raise SystemExit(0 if v else 3)"
    )
    _choose_window()
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120, check=False)
    if done.returncode == 0:
        return ""
    said = re.sub(r"\x1b\[[0-9;]*m", "", (done.stderr.strip().splitlines() or ["no message"])[-1])
    return (
        f"no OpenGL context for off-screen rendering ({said[:200]}); "
        "on Debian and Ubuntu: apt-get install libegl1 libgl1-mesa-dri"
    )


def _choose_window() -> None:
    """Without a screen VTK would first try X, and complain."""
    if sys.platform == "linux" and not os.environ.get("DISPLAY"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")


def start(*, views: bool | None = None, testing: bool = True, platform: str | None = None) -> types.ModuleType:
    """Put the host in place (once a process) and return the module ``slicer``.

    ``views``: make a layout manager with 3D views (None: where this machine can render). ``testing``: what
    ``slicer.app.testingEnabled()`` answers, so that message boxes are logged instead of shown. ``platform``: Qt's
    platform plugin (None: what ``QT_QPA_PLATFORM`` says, else ``offscreen``). Raises HostUnavailable where slicer-core,
    or the OpenGL that ``views`` asks for, is missing.
    """
    if wheel_problem():
        raise HostUnavailable(wheel_problem())
    _choose_window()
    import slicer

    if getattr(slicer, "app", None) is not None:
        return slicer
    if views is None:
        views = not rendering_problem()
    elif views and rendering_problem():
        raise HostUnavailable(rendering_problem())
    if platform:
        os.environ["QT_QPA_PLATFORM"] = platform
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

    from . import application, parameter_nodes, scripted_module

    app = application.create(testing)
    _publish(application.translations())
    if not qt_problem():
        from . import toolkit

        toolkit.install()
    _publish(parameter_nodes)
    _publish(scripted_module)
    from . import sample_data

    sys.modules["SampleData"] = sample_data
    application.add_module_stand_in("SampleData", sample_data.logic)
    if views:
        from . import layouts

        app.setLayoutManager(layouts.LayoutManager())
    return slicer


def _publish(module: types.ModuleType) -> None:
    """Make ``module`` importable as ``slicer.<name>`` (its attribute ``PUBLISHED_AS``)."""
    import slicer

    name = module.PUBLISHED_AS
    sys.modules[f"slicer.{name}"] = module
    setattr(slicer, name, module)
