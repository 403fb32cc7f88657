"""The planes of the openings in the view: their rims as they are drawn, and planes moved by the mouse."""

import numpy as np
import slicer
from LAFlatteningScene import views
from LAFlatteningScene.cut_preview import CutPreview
from LAFlatteningScene.overlay import overlayOf
from LAFlatteningScene.plane_nodes import planeOf, setPlane, showHandles
from logic_case import Clock, LogicCase
from prepare_case import POINTS, addClosed
from view_case import onScreen, picture

from LAFlatteningLib.cavity.clipping import CutPlane

WALL = (51, 51, 204)
"""Colour of the atrium, far from those of rims."""


class PlanesCase(LogicCase):
    """A closed atrium from the right and behind, with suggested planes that are followed."""

    def setUp(self):
        super().setUp()
        if slicer.app.layoutManager() is None:
            self.skipTest("views cannot be drawn here")
        self.raw, self.clock = addClosed(), Clock()
        self.raw.GetDisplayNode().SetColor(*(np.array(WALL) / 255.0))
        self.p = self.parameters()
        self.p.prepareInput, self.p.preparePoints = self.raw, POINTS
        self.logic.showLayout()
        self.logic.linkViews(self.p)
        self.addCleanup(self.logic.stopCutPreview)
        self.logic._preview = CutPreview(self.logic, self.p, self.clock.schedule, None, self.clock)
        self.planes = self.logic.suggestParameters(self.p)
        self.clock.run(1.0)
        self.view = views.threeDView(self.logic.atriumViewNode())
        node = self.logic.atriumViewNode()
        node.SetBoxVisible(False)
        node.SetAxisLabelsVisible(False)
        plane = planeOf(self.planes["RSPV"])
        camera = views.cameraOf(node)
        camera.SetFocalPoint(*plane.centre)
        # Aslant on the plane, from behind.
        across = np.cross(plane.normal, (0.0, 0.0, 1.0))
        across *= -np.sign(across[1]) / np.linalg.norm(across)
        camera.SetPosition(*(plane.centre + 150.0 * (across + plane.normal) / np.sqrt(2.0)))
        camera.SetViewUp(0.0, 0.0, 1.0)
        camera.ResetClippingRange()

    def onlyRims(self):
        """Take the planes out of sight: what is green or red then is a rim."""
        for node in self.planes.values():
            node.GetDisplayNode().SetVisibility(False)

    def shares(self):
        """How much of the picture is green, and how much is red."""
        pixels = picture(self.view)
        red, green, blue = (pixels[..., k] for k in range(3))
        greenish = (green > red + 40) & (green > blue + 40)
        reddish = (red > green + 40) & (red > blue + 40)
        return greenish.mean(), reddish.mean()


class RimsTest(PlanesCase):
    def test_greenWhereItCutsAndRedWhereItDoesNot(self):
        self.onlyRims()
        green, red = self.shares()
        self.assertGreater(green, 1e-3)
        self.assertEqual(red, 0.0)
        plane = planeOf(self.planes["RSPV"])
        aside = np.cross(plane.normal, (0.0, 1.0, 0.0))
        setPlane(self.planes["RSPV"], CutPlane(plane.centre + 14.0 * aside / np.linalg.norm(aside), plane.normal))
        self.clock.run(1.0)
        self.assertGreater(self.shares()[1], 1e-4)

    def test_notOnTheMap(self):
        mapView = self.logic.mapViewNode()
        for node in (*self.planes.values(), *slicer.util.getNodesByClass("vtkMRMLModelNode")):
            display = node.GetDisplayNode()
            shown = [display.GetNthViewNodeID(k) for k in range(display.GetNumberOfViewNodeIDs())]
            self.assertTrue(shown, node.GetName())
            self.assertNotIn(mapView.GetID(), shown, node.GetName())

    def test_aMapThatIsNoLongerChosenIsNotShownWithTheAtrium(self):
        self.logic.applyParameters(self.p)
        mapNode = self.logic.flattenParameters(self.p)
        nodes = [mapNode, *overlayOf(mapNode)]
        self.assertTrue(all(node.GetDisplayVisibility() for node in nodes))
        self.p.map = None
        self.assertFalse(any(node.GetDisplayVisibility() for node in nodes))
        self.p.map = mapNode
        self.assertTrue(all(node.GetDisplayVisibility() for node in nodes))
        mapNode.SetDisplayVisibility(False)
        self.logic.linkViews(self.p)
        self.assertFalse(mapNode.GetDisplayVisibility(), "hidden by the user")

    def test_goneAfterApply(self):
        self.logic.applyParameters(self.p)
        self.clock.run(1.0)
        self.p.seeds.GetDisplayNode().SetVisibility(False)
        self.assertEqual(self.shares(), (0.0, 0.0))


class MouseTest(PlanesCase):
    def mouse(self, event, at):
        self.view.interactor().SetEventInformation(int(at[0]), int(at[1]), 0, 0)
        self.view.interactor().InvokeEvent(event)

    def handle(self, node, component):
        """Where the mouse finds a handle (type, number) of a plane: a place near the plane's centre on the picture."""
        display, centre = node.GetDisplayNode(), onScreen(self.view, planeOf(node).centre)
        self.mouse("EnterEvent", centre)
        found = None
        for x in range(-80, 81, 8):
            for y in range(-80, 81, 8):
                place = centre + np.array((x, y))
                self.mouse("MouseMoveEvent", place)
                if (display.GetActiveComponentType(), display.GetActiveComponentIndex()) == component:
                    found = place
        self.assertIsNotNone(found, "the plane has no such handle")
        return found

    def drag(self, start, by):
        self.mouse("MouseMoveEvent", start)
        self.mouse("LeftButtonPressEvent", start)
        for share in (0.25, 0.5, 0.75, 1.0):
            self.mouse("MouseMoveEvent", start + share * by)
            self.clock.run(0.1)

    def test_aPlaneIsMovedByItsHandleAndTheRimFollows(self):
        node = self.planes["RSPV"]
        showHandles(self.planes, "RSPV")
        picture(self.view)
        before, cut = planeOf(node), self.logic.plannedCuts()["RSPV"]
        # The third axis of a plane is its normal.
        start = self.handle(node, (node.GetDisplayNode().ComponentTranslationHandle, 2))
        by = onScreen(self.view, before.centre + 4.0 * before.normal) - onScreen(self.view, before.centre)
        self.drag(start, by)
        during, now = self.logic.plannedCuts()["RSPV"], planeOf(node)
        self.assertIsNot(during, cut)
        self.assertLess(np.abs((during.points - now.centre) @ now.normal).max(), 1e-6)
        self.mouse("LeftButtonReleaseEvent", start + by)
        self.clock.run(1.0)
        moved = planeOf(node).centre - before.centre
        self.assertAlmostEqual(float(moved @ before.normal), 4.0, delta=1.0)
        self.assertLess(np.linalg.norm(np.cross(moved, before.normal)), 0.01)
        np.testing.assert_allclose(planeOf(node).normal, before.normal, atol=1e-6)

    def test_aPlaneIsTurnedByItsHandle(self):
        node = self.planes["RSPV"]
        showHandles(self.planes, "RSPV")
        picture(self.view)
        before = planeOf(node)
        start = self.handle(node, (node.GetDisplayNode().ComponentRotationHandle, 1))
        by = np.array((10, 10))
        self.drag(start, by)
        self.mouse("LeftButtonReleaseEvent", start + by)
        self.clock.run(1.0)
        self.assertLess(planeOf(node).normal @ before.normal, np.cos(np.radians(2.0)))
        np.testing.assert_allclose(planeOf(node).centre, before.centre, atol=1e-6)
        rim, now = self.logic.plannedCuts()["RSPV"].points, planeOf(node)
        self.assertLess(np.abs((rim - now.centre) @ now.normal).max(), 1e-6)
