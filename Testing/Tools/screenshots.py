"""Draw the panel and both views, as they are with the synthetic atrium, to Screenshots/.

make screenshots      or      python Testing/Tools/screenshots.py

`module.png` is the whole picture, `placing.png` the panel in the middle of placing seeds, `prepare.png` with the planes
of a closed atrium, `analyse.png` with fibrosis and gaps, `template.png` with a template that was edited, `atrium.png`
and `flat.png` the two views.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
SCREENSHOTS = ROOT / "Screenshots"
sys.path.insert(0, str(ROOT / "Testing" / "Host"))

import slicer_host  # noqa: E402

POINTS = 20000
PANEL_WIDTH = 460
VIEW_WIDTH = 720
"""Pixels; views are as high as the panel."""
POINTED_AT = (-12.0, -7.5)
"""Where the cursor is on the map, mm from the centre of the disk: in a gap of the scar round the left veins."""


def settle(seconds: float = 1.5) -> None:
    """Let the application work."""
    import slicer

    end = time.monotonic() + seconds
    while time.monotonic() < end:
        slicer.app.processEvents()


def view_image(view) -> np.ndarray:
    """What a view shows, (h, w, 3) uint8."""
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy

    view.forceRender()
    grab = vtk.vtkWindowToImageFilter()
    grab.SetInput(view.renderWindow())
    grab.SetInputBufferTypeToRGB()
    grab.ReadFrontBufferOff()
    grab.Update()
    image = grab.GetOutput()
    width, height, _ = image.GetDimensions()
    return vtk_to_numpy(image.GetPointData().GetScalars()).reshape(height, width, 3)[::-1]


def panel_image(panel, sections: tuple[str, ...]) -> np.ndarray:
    """The panel with some of its sections open, (h, w, 3) uint8."""
    import qt

    for name, widget in vars(panel.ui).items():
        if name.endswith("Section"):
            widget.collapsed = name.removesuffix("Section") not in sections
    frame = panel.parent
    frame.setFixedWidth(PANEL_WIDTH)
    frame.show()
    # Tables take their heights when they are shown, and labels theirs when the width is known.
    for _ in range(2):
        settle(0.3)
        panel.update()
        frame.resize(PANEL_WIDTH, frame.layout().totalHeightForWidth(PANEL_WIDTH))
    settle(0.3)
    image = frame.grab().toImage().convertToFormat(qt.QImage.Format_RGB888)
    bits = np.frombuffer(image.constBits(), np.uint8).reshape(image.height(), image.bytesPerLine())
    return bits[:, : 3 * image.width()].reshape(image.height(), image.width(), 3).copy()


def save(name: str, image: np.ndarray) -> None:
    """Write a picture."""
    import vtk
    from vtk.util.numpy_support import numpy_to_vtk

    height, width, _ = image.shape
    data = vtk.vtkImageData()
    data.SetDimensions(width, height, 1)
    data.GetPointData().SetScalars(numpy_to_vtk(np.ascontiguousarray(image[::-1]).reshape(-1, 3), deep=True))
    writer = vtk.vtkPNGWriter()
    writer.SetInputData(data)
    SCREENSHOTS.mkdir(exist_ok=True)
    writer.SetFileName(str(SCREENSHOTS / name))
    writer.Write()
    print(f"Screenshots/{name}  {width} x {height}")


def beside(*images: np.ndarray) -> np.ndarray:
    """Pictures side by side, aligned at the top, on grey."""
    height, gap = max(len(image) for image in images), 6
    page = np.full((height, sum(image.shape[1] + gap for image in images) - gap, 3), 225, np.uint8)
    left = 0
    for image in images:
        page[: len(image), left : left + image.shape[1]] = image
        left += image.shape[1] + gap
    return page


def main() -> None:
    """Write all pictures."""
    slicer = slicer_host.start(views=True)
    from slicer_host import loading

    panel = loading.enter(loading.load_module(ROOT / "LAFlattening" / "LAFlattening.py"))
    logic, parameters = panel.logic, panel.parameterNode
    surface, seeds = logic.loadSample(points=POINTS)
    parameters.surface, parameters.seeds = surface, seeds
    panel.showLayout()
    settle()
    panel.ui.flattenButton.click()
    settle()
    manager = slicer.app.layoutManager()
    views = {
        view.mrmlViewNode(): view.threeDView() for view in map(manager.threeDWidget, range(manager.threeDViewCount))
    }
    atrium, flat = views[logic.atriumViewNode()], views[logic.mapViewNode()]
    sections = ("input", "seeds", "map")
    height = len(panel_image(panel, sections))
    for view in views.values():
        view.resize(VIEW_WIDTH, height)
    logic.frameMap()
    # From behind, as the map is drawn.
    centre = slicer.util.arrayFromModelPoints(surface).mean(axis=0)
    camera = atrium.cameraNode()
    camera.SetFocalPoint(*centre)
    camera.SetPosition(*np.add(centre, (0.0, -200.0, 0.0)))
    camera.SetViewUp(0.0, 0.0, 1.0)
    atrium.resetCamera()
    settle()
    crosshair = slicer.util.getNode("Crosshair")
    crosshair.SetCursorPositionRAS((*POINTED_AT, 0.0))
    settle(0.5)
    # The letters of the box are as high as the view of an empty scene asks for.
    logic.atriumViewNode().SetBoxVisible(False)
    logic.atriumViewNode().SetAxisLabelsVisible(False)
    left, right = view_image(atrium), view_image(flat)
    save("atrium.png", left)
    save("flat.png", right)
    save("module.png", beside(panel_image(panel, sections), left, right))
    # Without Export: the folder shown there is that of whoever draws this.
    save("quality.png", panel_image(panel, ("quality",)))

    crosshair.SetCursorPositionInvalid()
    save("template.png", template_image(panel, flat))
    save("analyse.png", analyse_image(panel, atrium, flat))
    logic.clearAnalysis(parameters.map)
    logic.colourBy(surface, "LGE")
    parameters.liveUpdate = False
    for label in logic.seedLabels()[4:]:
        logic.removeSeed(seeds, label)
    settle()
    panel.ui.placeButton.click()
    settle()
    placing = panel_image(panel, ("input", "seeds"))
    atrium.resize(VIEW_WIDTH, len(placing))
    camera.SetPosition(*np.add(centre, (-40.0, 200.0, 20.0)))
    atrium.resetCamera()
    save("placing.png", beside(placing, view_image(atrium)))
    logic.stopPlacing()
    save("prepare.png", prepare_image(panel, atrium, (surface, seeds)))


def analyse_image(panel, atrium, flat) -> np.ndarray:
    """Fibrosis and gaps of the sample."""
    import slicer

    panel.ui.volumeSelector.setCurrentNode(slicer.util.getNodesByClass("vtkMRMLScalarVolumeNode")[0])
    settle()
    panel.ui.measureButton.click()
    panel.ui.gapThresholds.text = "120"
    panel.ui.gapsButton.click()
    settle()
    picture = panel_image(panel, ("analyse",))
    for view in (atrium, flat):
        view.resize(VIEW_WIDTH, VIEW_WIDTH)
    atrium.resetCamera()
    panel.logic.frameMap()
    settle()
    return beside(picture, view_image(atrium), view_image(flat))


def template_image(panel, flat) -> np.ndarray:
    """A hole moved on the template, with the handles; the built-in template again afterwards."""
    panel.ui.editTemplate.click()
    panel.ui.holeSelector.setCurrentText("RSPV")
    panel.template.showNumbers()
    panel.ui.holeX.value = 23.0
    panel.ui.holeY.value = 10.0
    settle(4.0)
    picture = panel_image(panel, ("template",))
    flat.resize(VIEW_WIDTH, VIEW_WIDTH)
    panel.logic.frameMap()
    settle()
    image = beside(picture, view_image(flat))
    panel.ui.editTemplate.click()
    panel.ui.resetTemplateButton.click()
    settle(4.0)
    return image


def prepare_image(panel, atrium, others) -> np.ndarray:
    """The planes of a closed atrium, the one of the LIPV with its handles."""
    import slicer
    import vtk
    from LAFlatteningScene.sample_data import LPS_TO_RAS

    from LAFlatteningLib import make_phantom

    for node in others:
        node.GetDisplayNode().SetVisibility(False)
    parameters = panel.parameterNode
    parameters.surface = parameters.seeds = parameters.map = None
    closed = make_phantom(POINTS, closed=True).surface
    polydata = vtk.vtkPolyData()
    polydata.DeepCopy(replace(closed, points=closed.points @ LPS_TO_RAS).to_polydata())
    raw = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLModelNode", "Raw atrium")
    raw.SetAndObservePolyData(polydata)
    raw.CreateDefaultDisplayNodes()
    raw.GetDisplayNode().SetColor(0.85, 0.7, 0.62)
    parameters.prepareInput = raw
    settle()
    panel.ui.suggestButton.click()
    settle()
    panel.prepare.choose(list(panel.logic.openings()).index("LIPV"))
    panel_picture = panel_image(panel, ("prepare",))
    atrium.resize(VIEW_WIDTH, max(len(panel_picture), VIEW_WIDTH))
    camera = atrium.cameraNode()
    centre = slicer.util.arrayFromModelPoints(raw).mean(axis=0)
    camera.SetFocalPoint(*centre)
    camera.SetPosition(*np.add(centre, (-90.0, -200.0, 40.0)))
    camera.SetViewUp(0.0, 0.0, 1.0)
    atrium.resetCamera()
    settle()
    return beside(panel_picture, view_image(atrium))


if __name__ == "__main__":
    main()
