"""Seeds placed and dragged with the mouse in the view of the atrium, through Slicer's own markups widget."""

import numpy as np
import slicer
import vtk
from LAFlatteningScene.map_nodes import STAGE
from panel_case import PanelCase


class TestMouse(PanelCase):
    def setUp(self):
        super().setUp()
        self.surfaceNode, self.seedsNode = self.loadSample()
        self.truth = {
            self.seedsNode.GetNthControlPointLabel(k): np.array(self.seedsNode.GetNthControlPointPositionWorld(k))
            for k in range(self.seedsNode.GetNumberOfControlPoints())
        }
        self.panel.showLayout()
        self.settle()
        manager, wanted = slicer.app.layoutManager(), self.panel.logic.atriumViewNode()
        widgets = [manager.threeDWidget(k) for k in range(manager.threeDViewCount)]
        self.view = next(widget.threeDView() for widget in widgets if widget.mrmlViewNode() is wanted)

    def lookAt(self, place) -> None:
        """Turn the view so that a place on the atrium is in its middle."""
        centre = slicer.util.arrayFromModelPoints(self.surfaceNode).mean(axis=0)
        outward = (place - centre) / np.linalg.norm(place - centre)
        camera = self.view.cameraNode()
        camera.SetFocalPoint(*place)
        camera.SetPosition(*(place + 200.0 * outward))
        camera.SetViewUp(*np.cross(outward, np.cross((0.1, 0.2, 1.0), outward)))
        camera.ResetClippingRange()
        self.view.forceRender()

    def pixel(self, place):
        """Where a place is in the view."""
        coordinate = vtk.vtkCoordinate()
        coordinate.SetCoordinateSystemToWorld()
        coordinate.SetValue(*place)
        return coordinate.GetComputedDisplayValue(self.view.renderer())

    def mouse(self, event: str, at) -> None:
        """A mouse event in the view."""
        interactor = self.view.interactor()
        interactor.SetEventInformation(int(at[0]), int(at[1]), 0, 0)
        interactor.InvokeEvent(event)

    def click(self, place) -> None:
        """A click at a place on the atrium."""
        at = self.pixel(place)
        for event in ("EnterEvent", "MouseMoveEvent", "LeftButtonPressEvent", "LeftButtonReleaseEvent"):
            self.mouse(event, at)
        self.settle()

    def test_nine_clicks_place_nine_seeds(self):
        slicer.mrmlScene.RemoveNode(self.seedsNode)
        self.settle()
        self.ui.placeButton.click()
        for label, place in self.truth.items():
            self.assertIn(label, self.ui.nextSeedText.text)
            self.lookAt(place)
            self.click(place)
            self.assertEqual(self.stateOf(label), "placed")
        self.assertFalse(self.ui.placeButton.checked)
        self.assertEqual(self.ui.seedsMessage.text, "")
        seedsNode = self.parameters.seeds
        self.assertEqual(seedsNode.GetNumberOfControlPoints(), 9)
        for label, place in self.truth.items():
            index = seedsNode.GetControlPointIndexByLabel(label)
            off = np.linalg.norm(np.array(seedsNode.GetNthControlPointPositionWorld(index)) - place)
            # A pixel is about 0.3 mm here, an edge of this mesh about 4 mm.
            self.assertLess(off, 3.0, label)
        self.assertTrue(self.ui.flattenButton.enabled)
        self.ui.flattenButton.click()
        self.assertEqual(self.ui.mapMessage.text, "")

    def test_after_the_last_seed_a_click_adds_nothing(self):
        self.panel.logic.removeSeed(self.seedsNode, "LAA")
        self.settle()
        self.ui.placeButton.click()
        self.lookAt(self.truth["LAA"])
        self.click(self.truth["LAA"])
        self.click(self.truth["LAA"])
        self.assertEqual(self.seedsNode.GetNumberOfControlPoints(), 9)
        self.assertEqual(self.seedsNode.GetNumberOfDefinedControlPoints(), 9)

    def test_the_map_follows_a_seed_that_is_dragged(self):
        self.ui.liveUpdate.checked = True
        self.waitFor(lambda: self.parameters.map is not None)
        mapNode = self.parameters.map
        before = slicer.util.arrayFromModelPoints(mapNode).copy()
        start = self.truth["RSPV"]
        self.lookAt(start)
        at = np.array(self.pixel(start))
        for event in ("EnterEvent", "MouseMoveEvent", "LeftButtonPressEvent"):
            self.mouse(event, at)
        for step in range(1, 7):
            self.mouse("MouseMoveEvent", at + np.array((2, 0)) * step)
            slicer.app.processEvents()
        self.settle()
        self.assertEqual(mapNode.GetAttribute(STAGE), "preview")
        dragged = slicer.util.arrayFromModelPoints(mapNode)
        self.assertGreater(float(np.abs(dragged - before).max()), 0.01)
        self.mouse("LeftButtonReleaseEvent", at + np.array((12, 0)))
        self.waitFor(lambda: mapNode.GetAttribute(STAGE) == "map")
        self.assertEqual(self.ui.mapMessage.text, "")
        self.assertTrue(self.ui.undoButton.enabled)
        self.ui.undoButton.click()
        self.waitFor(lambda: np.allclose(slicer.util.arrayFromModelPoints(mapNode), before, atol=1e-6))
