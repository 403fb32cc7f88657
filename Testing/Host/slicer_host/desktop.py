"""The window of ``make panel``: the module's panel on the left, the 3D views of the layout on the right.

    python -m slicer_host.desktop LAFlattening/LAFlattening.py [FILE ...]

FILEs (scenes, models, markups) are loaded at the start. Views are drawn off screen and shown as pictures; the mouse in
them reaches the same displayable managers as in Slicer.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from . import session


def main(arguments: list[str] | None = None) -> int:
    """Show the window until it is closed."""
    parser = argparse.ArgumentParser(
        prog="slicer_host.desktop", description="A scripted module's panel without Slicer."
    )
    parser.add_argument("module", help="the module's file")
    parser.add_argument("files", nargs="*", help="files to load: scenes, models, markups")
    options = parser.parse_args(arguments)
    screen = "" if _has_screen() else "there is no screen (DISPLAY is not set); start it in a desktop session"
    problem = screen or session.wheel_problem() or session.qt_problem() or session.rendering_problem()
    if problem:
        print(f"The panel cannot be shown: {problem}", file=sys.stderr)
        return 1
    window = open_window(options.module)
    for name in options.files:
        window.load(name)
    from PySide6.QtWidgets import QApplication

    return QApplication.exec()


def open_window(module_file: str | Path, *, platform: str | None = None, testing: bool = False):
    """Start the host, load the module, and show its panel and the views in a window; returns the window."""
    session.start(views=True, testing=testing, platform=platform or _platform())
    from . import loading, window

    made = window.Window(loading.load_module(module_file))
    made.show()
    return made


def _has_screen() -> bool:
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _platform() -> str:
    """Qt's plugin for this machine's screen; the host would otherwise take the one that shows nothing."""
    return os.environ.get("QT_QPA_PLATFORM", {"linux": "xcb", "darwin": "cocoa", "win32": "windows"}[sys.platform])


if __name__ == "__main__":
    sys.exit(main())
