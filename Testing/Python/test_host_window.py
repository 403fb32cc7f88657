"""The window of ``make panel``: panel and views, files opened and saved by its menu, the mouse in its views."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

HOST = Path(__file__).resolve().parents[1] / "Host"

# In a process of its own: a window stays until its process ends.
SCRIPT = """
import sys
import time
from pathlib import Path

from slicer_host import desktop

folder, module = Path(sys.argv[1]), sys.argv[2]
window = desktop.open_window(module, platform="offscreen", testing=True)
escaped = []
sys.excepthook = lambda *error: (escaped.append(error[1]), sys.__excepthook__(*error))

import qt
import slicer
from PySide6 import QtWidgets


def settle(seconds=0.5):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        slicer.app.processEvents()
        time.sleep(0.005)


def menu(text):
    entries = [entry for menu in window.menuBar().actions() for entry in menu.menu().actions()]
    next(entry for entry in entries if text in entry.text).trigger()
    settle()


assert slicer.util.mainWindow() is window
panel = slicer.util.getModuleWidget("LAFlattening")
assert panel.parent.isEntered
menu("synthetic")
panel.ui.surfaceSelector.setCurrentNode(slicer.mrmlScene.GetFirstNodeByClass("vtkMRMLModelNode"))
panel.ui.seedsSelector.setCurrentNode(slicer.mrmlScene.GetFirstNodeByClass("vtkMRMLMarkupsFiducialNode"))
panel.ui.flattenButton.click()
settle()
views = [view for view in window.findChildren(qt.QWidget) if type(view).__name__ == "ViewWidget" and view.isVisible()]
assert len(views) == 2, views
# Each view fills its part of the window and shows more than one colour.
for view in views:
    image = view.grab().toImage()
    assert image.width() > 240 and image.height() > 400
    colours = {image.pixel(x, y) for x in range(0, image.width(), 7) for y in range(0, image.height(), 7)}
    assert len(colours) > 20, len(colours)
# Dragging in the first view turns its camera.
camera = slicer.app.layoutManager().threeDWidget("1").threeDView().cameraNode()
before = camera.GetPosition()
first = next(view for view in views if view._view.cameraNode() is camera)
for kind, x in (("mouseMove", 20), ("mousePress", 20), ("mouseMove", 60), ("mouseMove", 90), ("mouseRelease", 90)):
    where = qt.QPoint(x, 20)
    if kind == "mouseMove":
        qt.QTest.mouseMove(first, where)
        slicer.app.processEvents()
    else:
        getattr(qt.QTest, kind)(first, qt.Qt.LeftButton, qt.Qt.NoModifier, where)
settle(0.2)
assert camera.GetPosition() != before

name = str(folder / "scene.mrb")
QtWidgets.QFileDialog.getSaveFileName = staticmethod(lambda *_: (name, ""))
QtWidgets.QFileDialog.getOpenFileNames = staticmethod(lambda *_: ([name], ""))
points = slicer.util.arrayFromModelPoints(panel.parameterNode.map).copy()
menu("Save")
menu("Close scene")
assert panel.parameterNode.map is None
menu("Open")
assert abs(slicer.util.arrayFromModelPoints(panel.parameterNode.map) - points).max() < 1e-4
window.close()
assert not escaped, escaped
print("all done")
"""


def test_window(host_with_views, host_with_qt, tmp_path):
    module = Path(__file__).resolve().parents[2] / "LAFlattening" / "LAFlattening.py"
    environment = {**os.environ, "PYTHONPATH": str(HOST)}
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(tmp_path), str(module)],
        capture_output=True,
        text=True,
        env=environment,
        timeout=300,
        check=False,
    )
    assert done.stdout.strip().endswith("all done"), done.stdout + done.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="only on Linux can a machine be without a screen")
def test_without_a_screen_it_says_so():
    environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    environment["PYTHONPATH"] = str(HOST)
    done = subprocess.run(
        [sys.executable, "-m", "slicer_host.desktop", "LAFlattening.py"],
        capture_output=True,
        text=True,
        env=environment,
        timeout=100,
        check=False,
    )
    assert done.returncode == 1 and "no screen" in done.stderr and "Traceback" not in done.stderr
