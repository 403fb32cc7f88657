"""What the tests of views share: the two views with an atrium and its map, pictures of them, and the mouse."""

import numpy as np
import slicer
import vtk
from LAFlatteningScene import views
from logic_case import LogicCase, addAtrium, addSeeds, points
from vtk.util.numpy_support import vtk_to_numpy

GREEN = (0, 255, 0)
MARKER = (255, 26, 153)


def picture(view):
    """What a view shows, (height, width, 3), rows from below."""
    view.forceRender()
    image = vtk.vtkWindowToImageFilter()
    image.SetInput(view.renderWindow())
    image.SetInputBufferTypeToRGB()
    image.ReadFrontBufferOff()
    image.Update()
    width, height, _ = image.GetOutput().GetDimensions()
    return vtk_to_numpy(image.GetOutput().GetPointData().GetScalars()).reshape(height, width, 3).astype(int)


def onScreen(view, place):
    """Column and row of a place (RAS, mm) in the picture of a view."""
    coordinate = vtk.vtkCoordinate()
    coordinate.SetCoordinateSystemToWorld()
    coordinate.SetValue(*[float(x) for x in place])
    return np.array(coordinate.GetComputedDisplayValue(view.renderer()))


def like(pixels, colour, tolerance=40):
    """Which pixels are nearly of a colour."""
    return (np.abs(pixels - colour) <= tolerance).all(axis=-1)


def middle(mask):
    """The mean column and row of the pixels of a mask."""
    rows, columns = np.nonzero(mask)
    return np.array([columns.mean(), rows.mean()])


class ViewCase(LogicCase):
    """An atrium and its map in the two views, the map in one plain colour."""

    def setUp(self):
        super().setUp()
        if slicer.app.layoutManager() is None:
            self.skipTest("views cannot be drawn here")
        self.surface, self.seeds = addAtrium(), addSeeds(self.logic)
        self.p = self.parameters(self.surface, self.seeds)
        self.p.showTemplate = self.p.showLabels = False
        self.logic.showLayout()
        self.read = []
        self.logic.linkViews(self.p, self.read.append)
        self.logic.flattenParameters(self.p)
        for node in (self.surface, self.p.map):
            node.GetDisplayNode().SetScalarVisibility(False)
            node.GetDisplayNode().SetColor(0.0, 1.0, 0.0)
        self.left = views.threeDView(self.logic.atriumViewNode())
        self.right = views.threeDView(self.logic.mapViewNode())

    def lookAtTheAtrium(self, direction=(0.0, 1.0, 0.2)):
        """Put the atrium's camera in front of it."""
        camera = views.cameraOf(self.logic.atriumViewNode())
        centre = points(self.surface).mean(axis=0)
        camera.SetFocalPoint(*centre)
        camera.SetPosition(*(centre + 250.0 * np.array(direction) / np.linalg.norm(direction)))
        camera.SetViewUp(0.0, 0.0, 1.0)
        camera.ResetClippingRange()
        return camera

    def pointAt(self, place):
        """What the views do when the mouse is at a place."""
        crosshair = slicer.mrmlScene.GetSingletonNode("default", "vtkMRMLCrosshairNode")
        crosshair.SetCursorPositionRAS([float(x) for x in place])

    def mouse(self, view, event, at):
        view.interactor().SetEventInformation(int(at[0]), int(at[1]), 0, 0)
        view.interactor().InvokeEvent(event)

    def drag(self, view, start, end):
        self.mouse(view, "MouseMoveEvent", start)
        self.mouse(view, "LeftButtonPressEvent", start)
        for step in np.linspace(0.0, 1.0, 6)[1:]:
            self.mouse(view, "MouseMoveEvent", start + step * (np.array(end) - start))
        self.mouse(view, "LeftButtonReleaseEvent", end)
