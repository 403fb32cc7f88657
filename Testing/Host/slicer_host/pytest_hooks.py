"""Runs the tests in Testing/Module on the host under pytest; the conftest.py there takes these hooks over.

Tests whose part of the host is missing on this machine are skipped with the reason, or fail where the environment
variable LAF_REQUIRE_HOST is set. An exception in a callback of Qt or VTK, which would otherwise only be printed, fails
its test.
"""

from __future__ import annotations

import contextlib
import os
import sys
import traceback
from pathlib import Path

import pytest

from . import session

MODULE_FILE = Path(__file__).resolve().parents[3] / "LAFlattening" / "LAFlattening.py"
# Beginning of a test file's name -> what its tests need.
_NEEDS = {
    "test_panel": (session.wheel_problem, session.qt_problem, session.rendering_problem),
    "test_views": (session.wheel_problem, session.qt_problem, session.rendering_problem),
    "test": (session.wheel_problem, session.qt_problem),
}


def problem(path: Path) -> str:
    """Why the tests in the file ``path`` cannot run here; empty if they can."""
    needs = next(needs for start, needs in _NEEDS.items() if path.name.startswith(start))
    return next((found for found in (need() for need in needs) if found), "")


class _Unavailable(pytest.Module):
    """A test file that is not even imported."""

    def collect(self):
        reason = f"needs the test host: {problem(self.path)}"
        if os.environ.get("LAF_REQUIRE_HOST"):
            raise self.CollectError(reason)
        pytest.skip(reason, allow_module_level=True)


def pytest_pycollect_makemodule(module_path: Path, parent):
    """Start the host before the first test file is imported, or put a skip in the file's place."""
    if problem(module_path):
        return _Unavailable.from_parent(parent, path=module_path)
    session.start()
    from . import loading

    loading.load_module(MODULE_FILE)
    return None


def _need(*needs) -> None:
    found = next((found for found in (need() for need in needs) if found), "")
    if found and os.environ.get("LAF_REQUIRE_HOST"):
        pytest.fail(found)
    if found:
        pytest.skip(found)


@pytest.fixture
def host():
    """The module ``slicer`` of the host, with an empty scene."""
    _need(session.wheel_problem)
    slicer = session.start()
    with _fresh_scene(slicer):
        yield slicer


@pytest.fixture
def host_with_views(host):
    """The same, where 3D views can be drawn."""
    _need(session.rendering_problem)
    return host


@pytest.fixture
def host_with_qt(host):
    """The same, where widgets can be made."""
    _need(session.qt_problem)
    return host


@pytest.fixture(autouse=True)
def fresh_scene():
    """An empty scene before and after each test of the module, and no exception lost in a callback."""
    import slicer

    with _fresh_scene(slicer):
        yield


@contextlib.contextmanager
def _fresh_scene(slicer):

    lost: list[str] = []

    def keep(kind, error, trace):
        lost.append("".join(traceback.format_exception(kind, error, trace)))

    before, sys.excepthook = sys.excepthook, keep
    slicer.mrmlScene.Clear(0)
    slicer.app.processEvents()
    yield
    slicer.mrmlScene.Clear(0)
    slicer.app.processEvents()
    sys.excepthook = before
    if lost:
        pytest.fail("exception in a callback:\n" + "\n".join(lost), pytrace=False)
