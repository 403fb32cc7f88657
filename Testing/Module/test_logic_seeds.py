"""Logic: the seeds node, snapping, and what is said about seeds that cannot be right."""

import numpy as np
import slicer
from logic_case import LogicCase, addAtrium, addSeeds, moveSeed, phantom, points, seedIndex, seedPosition, toRas

from LAFlatteningLib import SeedError

LABELS = ["RSPV", "RIPV", "LIPV", "LSPV", "LAA", "MV1", "MV2", "MV3", "MV4"]


def mitralRim():
    """The points of the phantom's mitral rim, RAS: the longest rim."""
    surface = phantom().surface
    return toRas(surface.points[max(surface.boundary_loops, key=surface.loop_length)])


class SeedsNodeTest(LogicCase):
    """Nine named points that are placed in order."""

    def labels(self, node):
        return [node.GetNthControlPointLabel(k) for k in range(node.GetNumberOfControlPoints())]

    def test_newNode(self):
        node = self.logic.createSeedsNode("Seeds")
        self.assertEqual(self.labels(node), LABELS)
        self.assertEqual(node.GetNumberOfDefinedControlPoints(), 0)
        self.assertEqual(self.logic.nextSeed(node), "RSPV")

    def test_placedInOrder(self):
        node = self.logic.createSeedsNode("Seeds")
        for k, label in enumerate(LABELS):
            self.assertEqual(self.logic.nextSeed(node), label)
            self.logic.placeSeed(node, label, (float(k), 0.0, 0.0))
        self.assertIsNone(self.logic.nextSeed(node))
        self.assertEqual(self.labels(node), LABELS)

    def test_removingTakesThePlaceOnly(self):
        node = addSeeds(self.logic)
        self.logic.removeSeed(node, "LIPV")
        self.assertEqual(self.logic.nextSeed(node), "LIPV")
        self.assertIsNone(seedPosition(node, "LIPV"))
        self.assertEqual(self.labels(node), LABELS)

    def test_deletingAPointOfTheNodeTakesItsPlaceOnly(self):
        node = addSeeds(self.logic)
        # What Slicer's table of control points does with a node of a fixed number of points.
        self.assertTrue(node.GetFixedNumberOfControlPoints())
        node.UnsetNthControlPointPosition(seedIndex(node, "MV3"))
        self.assertEqual(self.logic.nextSeed(node), "MV3")

    def test_aNodeOfTheUsersGetsWhatItLacks(self):
        node = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLMarkupsFiducialNode", "Mine")
        node.AddControlPointWorld(1.0, 2.0, 3.0, "LAA")
        node.AddControlPointWorld(4.0, 5.0, 6.0, "note")
        self.logic.prepareSeedsNode(node)
        self.assertEqual(sorted(self.labels(node)), sorted([*LABELS, "note"]))
        np.testing.assert_allclose(seedPosition(node, "LAA"), (1.0, 2.0, 3.0))
        self.assertEqual(self.logic.nextSeed(node), "RSPV")
        self.logic.prepareSeedsNode(node)
        self.assertEqual(node.GetNumberOfControlPoints(), 10)

    def test_noSuchSeed(self):
        with self.assertRaisesRegex(SeedError, '"PV".*RSPV'):
            self.logic.placeSeed(self.logic.createSeedsNode(), "PV", (0.0, 0.0, 0.0))

    def test_everySeedIsDescribed(self):
        self.assertEqual(list(self.logic.seedLabels()), LABELS)
        for label in LABELS:
            self.assertGreater(len(self.logic.seedDescription(label).split()), 4)

    def test_placingByMouseBeginsWithTheNextSeed(self):
        node = addSeeds(self.logic, without=("LSPV", "MV2"))
        interaction = slicer.app.applicationLogic().GetInteractionNode()
        self.logic.placeNext(node)
        self.assertEqual(interaction.GetCurrentInteractionMode(), interaction.Place)
        self.assertEqual(slicer.modules.markups.logic().GetActiveListID(), node.GetID())
        self.assertEqual(node.GetControlPointPlacementStartIndex(), seedIndex(node, "LSPV"))
        self.logic.stopPlacing()
        self.assertNotEqual(interaction.GetCurrentInteractionMode(), interaction.Place)

    def test_placingOneAgain(self):
        node = addSeeds(self.logic)
        self.logic.placeNext(node, "MV1")
        self.addCleanup(self.logic.stopPlacing)
        self.assertEqual(self.logic.nextSeed(node), "MV1")


class SnappingTest(LogicCase):
    """Seeds go where they belong if they are put near."""

    def setUp(self):
        super().setUp()
        self.surface, self.seeds = addAtrium(), self.logic.createSeedsNode("Seeds")

    def snapped(self, label, position):
        self.logic.placeSeed(self.seeds, label, position, self.surface)
        return seedPosition(self.seeds, label)

    def test_mitralSeedsGoToTheMitralRim(self):
        rim = mitralRim()
        place = self.snapped("MV2", rim[5] + np.array((2.0, -1.0, 3.0)))
        self.assertLess(np.linalg.norm(rim - place, axis=1).min(), 1e-9)
        self.assertLess(np.linalg.norm(place - rim[5]), 6.0)

    def test_veinSeedsGoToThePlaneOfTheirOstium(self):
        shape, centre = phantom().shape, np.array(phantom().shape.centre)
        for label in ("RSPV", "LAA"):
            axis = shape.openings[label].axis
            outside = phantom().seeds[label] + 5.0 * axis
            place = toRas(self.snapped(label, toRas(outside)))
            # The rims of the phantom are plane circles, so the cover lies in that plane.
            height = (phantom().seeds[label] - centre) @ axis
            self.assertAlmostEqual((place - centre) @ axis, height, delta=0.3)
            self.assertLess(np.linalg.norm(place - phantom().seeds[label]), 2.0)

    def test_farFromItsPlaceASeedStaysOnTheSurface(self):
        far = mitralRim().mean(axis=0) + 200.0 * (points(self.surface).mean(axis=0) - mitralRim().mean(axis=0))
        nearest = points(self.surface)[np.linalg.norm(points(self.surface) - far, axis=1).argmin()]
        np.testing.assert_allclose(self.snapped("MV1", far), nearest, atol=1e-9)

    def test_underATransform(self):
        shift = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLTransformNode")
        matrix = np.eye(4)
        matrix[:3, 3] = (70.0, 0.0, -20.0)
        shift.SetMatrixTransformToParent(slicer.util.vtkMatrixFromArray(matrix))
        self.surface.SetAndObserveTransformNodeID(shift.GetID())
        place = self.snapped("MV2", mitralRim()[5] + np.array((71.0, 0.0, -20.0)))
        self.assertLess(np.linalg.norm(mitralRim() + np.array((70.0, 0.0, -20.0)) - place, axis=1).min(), 1e-9)


class CheckTest(LogicCase):
    """A seed that cannot be right is marked, and the reason is told."""

    def setUp(self):
        super().setUp()
        self.surface, self.seeds = addAtrium(), addSeeds(self.logic)

    def marked(self):
        return {label for label in LABELS if not self.seeds.GetNthControlPointSelected(seedIndex(self.seeds, label))}

    def test_nothingIsWrong(self):
        self.assertEqual(self.logic.checkSeeds(self.seeds, self.surface), {})
        self.assertEqual(self.marked(), set())

    def test_exchangedVeins(self):
        left, right = seedPosition(self.seeds, "LIPV"), seedPosition(self.seeds, "LSPV")
        moveSeed(self.seeds, "LIPV", right)
        moveSeed(self.seeds, "LSPV", left)
        reasons = self.logic.checkSeeds(self.seeds, self.surface)
        self.assertLessEqual({"LIPV", "LSPV"}, set(reasons))
        self.assertEqual(self.marked(), set(reasons))
        description = self.seeds.GetNthControlPointDescription(seedIndex(self.seeds, "LIPV"))
        self.assertEqual(description, reasons["LIPV"])
        moveSeed(self.seeds, "LIPV", left)
        moveSeed(self.seeds, "LSPV", right)
        self.assertEqual(self.logic.checkSeeds(self.seeds, self.surface), {})
        self.assertEqual(self.marked(), set())
        self.assertEqual(self.seeds.GetNthControlPointDescription(seedIndex(self.seeds, "LIPV")), "")

    def test_beforeAllArePlacedEachIsCheckedForItself(self):
        self.logic.removeSeed(self.seeds, "MV4")
        moveSeed(self.seeds, "MV1", seedPosition(self.seeds, "LAA") + np.array((0.0, 3.0, 0.0)))
        moveSeed(self.seeds, "RIPV", seedPosition(self.seeds, "RSPV") + np.array((1.0, 0.0, 0.0)))
        reasons = self.logic.checkSeeds(self.seeds, self.surface)
        self.assertEqual(set(reasons), {"MV1", "RIPV"})
        self.assertRegex(reasons["MV1"], r"MV1 is \d+ mm from the rim of the mitral valve")
        self.assertIn("same opening", reasons["RIPV"])
        self.assertEqual(self.marked(), {"MV1", "RIPV"})
