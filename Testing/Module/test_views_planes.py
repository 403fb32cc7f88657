"""The planes of the openings in the view: their rims as they are drawn, and planes moved by the mouse."""

import numpy as np
import slicer
import vtk
from LAFlatteningScene import views
from LAFlatteningScene.cut_preview import CutPreview
from LAFlatteningScene.plane_nodes import planeOf, setPlane
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

    def test_goneAfterApply(self):
        self.logic.applyParameters(self.p)
        self.clock.run(1.0)
        self.p.seeds.GetDisplayNode().SetVisibility(False)
        self.assertEqual(self.shares(), (0.0, 0.0))


class MouseTest(PlanesCase):
    def mouse(self, event, at):
        self.view.interactor().SetEventInformation(int(at[0]), int(at[1]), 0, 0)
        self.view.interactor().InvokeEvent(event)

    def test_aPlaneIsDraggedAndTheRimFollows(self):
        node = self.planes["RSPV"]
        before, cut = planeOf(node), self.logic.plannedCuts()["RSPV"]
        picture(self.view)
        corners = vtk.vtkPoints()
        node.GetPlaneCornerPointsWorld(corners)
        # By its border, which is in sight beside the vein.
        places = [0.5 * (np.array(corners.GetPoint(k)) + corners.GetPoint((k + 1) % 4)) for k in range(4)]
        eye = np.array(views.cameraOf(self.logic.atriumViewNode()).GetPosition())
        start = onScreen(self.view, min(places, key=lambda place: np.linalg.norm(place - eye)))
        end = start + np.array((12, 8))
        self.mouse("EnterEvent", start)
        self.mouse("MouseMoveEvent", start)
        self.mouse("LeftButtonPressEvent", start)
        for share in (0.25, 0.5, 0.75, 1.0):
            self.mouse("MouseMoveEvent", start + share * (end - start))
            self.clock.run(0.1)
        during = self.logic.plannedCuts()["RSPV"]
        self.mouse("LeftButtonReleaseEvent", end)
        self.clock.run(1.0)
        after = planeOf(node)
        self.assertGreater(np.linalg.norm(after.centre - before.centre), 1.0)
        self.assertIsNot(during, cut)
        rim = self.logic.plannedCuts()["RSPV"].points
        self.assertLess(np.abs((rim - after.centre) @ after.normal).max(), 1e-6)
