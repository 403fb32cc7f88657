"""Logic: from a raw atrium to a cavity with seeds, by planes that can be moved."""

import json
import tempfile
import unittest.mock
from pathlib import Path

import numpy as np
import slicer
import vtk
from LAFlatteningScene.cut_preview import CutPreview, cutOf
from LAFlatteningScene.live_update import SHORTEST_PAUSE
from LAFlatteningScene.plane_nodes import planeOf, planesOf, setPlane
from LAFlatteningScene.prepare_logic import RawChoice
from LAFlatteningScene.raw_input import rawSurface, versionOf
from logic_case import (
    Clock,
    LogicCase,
    addTransform,
    array,
    phantom,
    points,
    sceneNodes,
    seedPosition,
    toRas,
    triangles,
)
from prepare_case import (
    POINTS,
    addClosed,
    addLabelMap,
    addSegmentation,
    addSphere,
    closedPhantom,
    labelVoxels,
    truth,
)

from LAFlatteningLib import LEFT_ATRIUM, Cancelled, LAFlatteningError, Surface
from LAFlatteningLib.cavity.clipping import CutPlane
from LAFlatteningLib.seeds import check_directions

CHOICE = RawChoice(points=POINTS)
SHIFT = np.array((10.0, -20.0, 30.0))


class PrepareCase(LogicCase):
    """A closed atrium."""

    def setUp(self):
        super().setUp()
        self.raw = addClosed()
        self.p = self.parameters()
        self.p.prepareInput, self.p.preparePoints = self.raw, POINTS
        self.addCleanup(self.logic.stopCutPreview)

    def rims(self, node):
        """The perimeters of the openings of a model, mm, longest first, and their middles."""
        surface = Surface(points(node), triangles(node))
        loops = surface.boundary_loops
        return [surface.loop_length(loop) for loop in loops], [surface.points[loop].mean(axis=0) for loop in loops]

    def movePlane(self, name, beyond):
        """Move the plane of an opening outwards by so many mm."""
        node = planesOf(self.raw)[name]
        plane = planeOf(node)
        setPlane(node, CutPlane(plane.centre + beyond * plane.normal, plane.normal))


class SuggestTest(PrepareCase):
    def test_planesAreWhereTheOpeningsAre(self):
        before, mesh = points(self.raw), array(self.raw, "LGE")
        planes = self.logic.suggestParameters(self.p)
        self.assertEqual(set(planes), set(LEFT_ATRIUM.openings))
        for name, (middle, axis) in truth().items():
            plane = planeOf(planes[name])
            self.assertEqual(planes[name].GetName(), name)
            self.assertLess(abs((plane.centre - middle) @ axis), 3.0, name)
            self.assertGreater(plane.normal @ axis, np.cos(np.radians(15.0)), name)
            self.assertFalse(planes[name].GetLocked())
        np.testing.assert_array_equal(points(self.raw), before)
        np.testing.assert_array_equal(array(self.raw, "LGE"), mesh)
        self.assertIsNone(self.p.surface)

    def test_again_takesTheSamePlanes(self):
        planes = self.logic.suggestParameters(self.p)
        place = planeOf(planes["LAA"])
        self.movePlane("LAA", 4.0)
        again = self.logic.suggestParameters(self.p)
        self.assertEqual(planes, again)
        np.testing.assert_allclose(planeOf(again["LAA"]).centre, place.centre, atol=1e-9)

    def test_aTransformOfTheAtriumCounts(self):
        first = {name: planeOf(node) for name, node in self.logic.suggestParameters(self.p).items()}
        shift = vtk.vtkTransform()
        shift.Translate(*SHIFT)
        addTransform(self.raw, shift)
        for name, node in self.logic.suggestParameters(self.p).items():
            np.testing.assert_allclose(planeOf(node).centre, first[name].centre + SHIFT, atol=0.5)

    def test_lengthsAreThoseAsked(self):
        first = {name: planeOf(node) for name, node in self.logic.suggestParameters(self.p).items()}
        self.p.pvLength, self.p.laaLength = 6.0, 3.0
        second = {name: planeOf(node) for name, node in self.logic.suggestParameters(self.p).items()}
        for name, plane in first.items():
            out = (second[name].centre - plane.centre) @ plane.normal
            self.assertAlmostEqual(out, 3.0 if name.endswith("PV") else 0.0, delta=0.75, msg=name)

    def test_cancelled(self):
        before = sceneNodes()
        with self.assertRaises(Cancelled):
            self.logic.suggestParameters(self.p, lambda share, text: share < 0.3)
        self.assertEqual(sceneNodes(), before)
        self.assertFalse(self.logic.isBusy)
        self.logic.suggestParameters(self.p)

    def test_deletedMeanwhile(self):
        def delete(share, text):
            if share > 0.3 and self.raw.GetScene() is not None:
                slicer.mrmlScene.RemoveNode(self.raw)

        with self.assertRaisesRegex(Cancelled, "deleted"):
            self.logic.suggestParameters(self.p, delete)
        self.assertEqual(slicer.util.getNodesByClass("vtkMRMLMarkupsPlaneNode"), [])


class ApplyTest(PrepareCase):
    def test_cavityWithSixRimsAndNineSeedsGivesAMap(self):
        before = points(self.raw)
        self.logic.suggestParameters(self.p)
        cavity, seeds = self.logic.applyParameters(self.p)
        self.assertEqual(cavity.GetName(), "Raw cavity")
        self.assertIs(self.p.surface, cavity)
        self.assertIs(self.p.seeds, seeds)
        self.assertEqual(len(self.rims(cavity)[0]), 6)
        self.assertEqual(len(array(cavity, "LGE")), len(points(cavity)))
        for label, place in phantom().seeds.items():
            off = np.linalg.norm(seedPosition(seeds, label) - toRas(place))
            self.assertLess(off, 10.0, label)
        self.assertFalse(self.raw.GetDisplayNode().GetVisibility())
        np.testing.assert_array_equal(points(self.raw), before)
        for node in planesOf(self.raw).values():
            self.assertTrue(node.GetLocked())
            self.assertFalse(node.GetDisplayNode().GetVisibility())
        mapNode = self.logic.flattenParameters(self.p)
        self.assertEqual(len(points(mapNode)), len(points(cavity)))
        self.assertTrue(mapNode.GetPolyData().GetPointData().HasArray("LGE"))

    def test_rimsLieInThePlanes(self):
        planes = {name: planeOf(node) for name, node in self.logic.suggestParameters(self.p).items()}
        cavity, _ = self.logic.applyParameters(self.p)
        surface = Surface(points(cavity), triangles(cavity))
        for loop in surface.boundary_loops:
            rim = surface.points[loop]
            off = [np.abs((rim - plane.centre) @ plane.normal).max() for plane in planes.values()]
            self.assertLess(min(off), 0.2)

    def test_aMovedPlaneMovesTheRim(self):
        planes = self.logic.suggestParameters(self.p)
        first = planeOf(planes["RSPV"])
        self.movePlane("RSPV", 5.0)
        cavity, _ = self.logic.applyParameters(self.p)
        _, middles = self.rims(cavity)
        along = [(middle - first.centre) @ first.normal for middle in middles]
        nearest = min(range(6), key=lambda k: np.linalg.norm(middles[k] - first.centre))
        self.assertAlmostEqual(along[nearest], 5.0, delta=0.2)

    def test_aPlaneThatIsTurnedRoundCutsTheSame(self):
        planes = self.logic.suggestParameters(self.p)
        plane = planeOf(planes["LIPV"])
        setPlane(planes["LIPV"], CutPlane(plane.centre, -plane.normal))
        cavity, _ = self.logic.applyParameters(self.p)
        self.assertLess(min(np.linalg.norm(m - plane.centre) for m in self.rims(cavity)[1]), 1.0)

    def test_aPlaneThatCutsNothingIsRefused(self):
        planes = self.logic.suggestParameters(self.p)
        before = sceneNodes()
        self.movePlane("LSPV", 100.0)
        with self.assertRaisesRegex(LAFlatteningError, "LSPV"):
            self.logic.applyParameters(self.p)
        self.assertEqual(sceneNodes(), before)
        self.assertIsNone(self.p.surface)
        self.assertFalse(planes["LSPV"].GetLocked())

    def test_aDeletedPlaneIsNamed(self):
        planes = self.logic.suggestParameters(self.p)
        slicer.mrmlScene.RemoveNode(planes["RIPV"])
        planes["LAA"].RemoveAllControlPoints()
        with self.assertRaisesRegex(LAFlatteningError, "RIPV and LAA"):
            self.logic.applyParameters(self.p)
        self.logic.suggestParameters(self.p)
        self.logic.applyParameters(self.p)

    def test_withoutPlanes(self):
        with self.assertRaisesRegex(LAFlatteningError, "Suggest"):
            self.logic.applyParameters(self.p)

    def test_anOpenAtriumIsTakenAsItIs(self):
        self.logic.suggestParameters(self.p)
        cavity, _ = self.logic.applyParameters(self.p)
        self.p.prepareInput = cavity
        self.p.preparePoints = POINTS
        planes = self.logic.suggestParameters(self.p)
        self.assertEqual(
            {json.loads(node.GetAttribute("LAFlattening.suggested"))["found_by"] for node in planes.values()}, {"open"}
        )
        again, _ = self.logic.applyParameters(self.p)
        np.testing.assert_allclose(sorted(self.rims(again)[0]), sorted(self.rims(cavity)[0]), rtol=0.02)


class UndoTest(PrepareCase):
    def test_stepByStep(self):
        chosen = addSphere()
        self.p.surface = chosen
        before = sceneNodes()
        planes = self.logic.suggestParameters(self.p)
        suggested = planeOf(planes["LAA"])
        self.movePlane("LAA", 3.0)
        withPlanes = sceneNodes()
        self.logic.applyParameters(self.p)
        self.logic.flattenParameters(self.p)
        self.assertEqual(self.logic.undoPrepareParameters(self.p), "cavity")
        self.assertIs(self.p.surface, chosen)
        self.assertIsNone(self.p.seeds)
        self.assertIsNone(self.p.map)
        left = {slicer.mrmlScene.GetNodeByID(key).GetClassName() for key in sceneNodes() - withPlanes}
        self.assertLessEqual(left, {"vtkMRMLColorTableNode"})
        self.assertTrue(self.raw.GetDisplayNode().GetVisibility())
        self.assertFalse(planes["LAA"].GetLocked())
        self.assertEqual(self.logic.undoPrepareParameters(self.p), "moves")
        np.testing.assert_allclose(planeOf(planes["LAA"]).centre, suggested.centre)
        self.assertEqual(self.logic.undoPrepareParameters(self.p), "planes")
        self.assertEqual(planesOf(self.raw), {})
        self.assertLessEqual(before, sceneNodes())
        self.assertEqual(self.logic.undoPrepareParameters(self.p), "")

    def test_anotherChoiceOfTheUserStays(self):
        self.logic.suggestParameters(self.p)
        self.logic.applyParameters(self.p)
        other = addSphere()
        self.p.surface = other
        self.logic.undoPrepareParameters(self.p)
        self.assertIs(self.p.surface, other)

    def test_afterUndoItCanBeCutOtherwise(self):
        self.logic.suggestParameters(self.p)
        first = self.rims(self.logic.applyParameters(self.p)[0])[1]
        self.logic.undoPrepareParameters(self.p)
        self.movePlane("LAA", 4.0)
        second = self.rims(self.logic.applyParameters(self.p)[0])[1]
        apart = [min(np.linalg.norm(a - b) for b in first) for a in second]
        self.assertEqual(sum(distance > 3.0 for distance in apart), 1)


class RefusalTest(PrepareCase):
    def refused(self, node, pattern, **choice):
        before = sceneNodes()
        with self.assertRaisesRegex(LAFlatteningError, pattern):
            self.logic.prepareSuggest(node, RawChoice(points=POINTS, **choice))
        self.assertEqual(sceneNodes(), before)
        self.assertFalse(self.logic.isBusy)

    def test_nothingChosen(self):
        self.refused(None, "Nothing is selected")

    def test_ball(self):
        self.refused(addSphere(), "vein")

    def test_emptyModel(self):
        self.refused(slicer.mrmlScene.AddNewNodeByClass("vtkMRMLModelNode", "Nothing"), "Nothing.*empty")

    def test_emptySegmentation(self):
        self.refused(slicer.mrmlScene.AddNewNodeByClass("vtkMRMLSegmentationNode", "Nothing"), "no segments")

    def test_emptySegment(self):
        self.refused(addSegmentation({"a": np.zeros_like(labelVoxels()[0])}), "empty")

    def test_severalSegments(self):
        voxels = labelVoxels()[0] > 0
        node = addSegmentation({"left atrium": voxels, "other": ~voxels})
        self.refused(node, "several segments: left atrium, other")

    def test_emptyLabelMap(self):
        self.refused(addLabelMap(np.zeros_like(labelVoxels()[0])), "empty")
        self.refused(slicer.mrmlScene.AddNewNodeByClass("vtkMRMLLabelMapVolumeNode", "None"), "no voxels")

    def test_mirrored(self):
        mirror = vtk.vtkTransform()
        mirror.Scale(-1.0, 1.0, 1.0)
        addTransform(self.raw, mirror)
        self.refused(self.raw, ".")


class ByHandTest(PrepareCase):
    def test_planesCutTheAtriumOnTheRightSides(self):
        planes = self.logic.planesParameters(self.p)
        surface = rawSurface(self.raw)[0]
        for name, node in planes.items():
            self.assertTrue(cutOf(surface, planeOf(node)).around, name)
        check_directions({name: planeOf(planes[name]).centre for name in LEFT_ATRIUM.holes}, "RAS", LEFT_ATRIUM)

    def test_cutWhereTheyWerePut(self):
        planes = self.logic.planesParameters(self.p)
        for name, (place, axis) in truth().items():
            setPlane(planes[name], CutPlane(place, axis))
        cavity, seeds = self.logic.applyParameters(self.p)
        shape = phantom().shape
        expected = sorted(2.0 * np.pi * opening.rim[0] for opening in shape.openings.values())
        np.testing.assert_allclose(sorted(self.rims(cavity)[0]), expected, rtol=0.03)
        self.assertEqual(seeds.GetNumberOfDefinedControlPoints(), 9)

    def test_theOthersAreFoundByRule(self):
        node = addSegmentation()
        planes = self.logic.preparePlanes(node, CHOICE)
        setPlane(planes["MV"], CutPlane(*truth()["MV"]))
        self.logic.prepareSuggest(node, CHOICE)
        for name, (middle, axis) in truth().items():
            plane = planeOf(planes[name])
            self.assertLess(abs((plane.centre - middle) @ axis), 3.0, name)
            self.assertGreater(plane.normal @ axis, np.cos(np.radians(15.0)), name)
        np.testing.assert_allclose(planeOf(planes["MV"]).centre, truth()["MV"][0], atol=1e-6)
        with unittest.mock.patch("LAFlatteningScene.prepare_logic.prepare", side_effect=AssertionError("made anew")):
            cavity, _ = self.logic.prepareApply(node, CHOICE)
        self.assertEqual(len(self.rims(cavity)[0]), 6)

    def test_swappedPlanesAreRefused(self):
        planes = self.logic.planesParameters(self.p)
        swapped = {"RSPV": "LSPV", "LSPV": "RSPV", "RIPV": "LIPV", "LIPV": "RIPV"}
        for name, node in planes.items():
            setPlane(node, CutPlane(*truth()[swapped.get(name, name)]))
        with self.assertRaises(LAFlatteningError):
            self.logic.applyParameters(self.p)
        self.assertIsNone(self.p.surface)


class InputTest(PrepareCase):
    """Segments and label maps, against the analytic shape that they were made of."""

    def compare(self, node, structure="", shift=0.0):
        surface, _ = rawSurface(node, structure)
        self.assertEqual((surface.space, len(surface.boundary_loops)), ("RAS", 0))
        off = np.abs(closedPhantom().shape.signed_distance(toRas(surface.points - shift)))
        self.assertLess(np.quantile(off, 0.95), 0.4)
        self.assertGreater(surface.enclosed_volume, 0.0)

    def test_segment(self):
        self.compare(addSegmentation())

    def test_chosenSegment(self):
        voxels = labelVoxels()[0] > 0
        node = addSegmentation({"other": ~voxels, "left atrium": voxels})
        structures = self.logic.structures(node)
        self.assertEqual(list(structures.values()), ["other", "left atrium"])
        self.compare(node, list(structures)[1])

    def test_segmentOfAClosedSurface(self):
        node = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLSegmentationNode", "Segmentation")
        node.SetSourceRepresentationToClosedSurface()
        node.AddSegmentFromClosedSurfaceRepresentation(self.raw.GetPolyData(), "left atrium", [1.0, 0.0, 0.0])
        self.compare(node)

    def test_labelMap(self):
        values = labelVoxels()[0].astype(int)
        values[values > 0] = 3
        values[:2, :2, :2] = 7
        node = addLabelMap(values)
        self.assertEqual(list(self.logic.structures(node)), ["3", "7"])
        self.compare(node, "3")

    def test_underATransform(self):
        node = addSegmentation()
        shift = vtk.vtkTransform()
        shift.Translate(*SHIFT)
        addTransform(node, shift)
        self.compare(node, shift=SHIFT)

    def test_aChangedSegmentIsReadAnew(self):
        node = addSegmentation()
        key = node.GetSegmentation().GetSegmentIDs()[0]
        before = versionOf(node)
        self.assertEqual(versionOf(node), before)
        slicer.util.arrayFromSegmentInternalBinaryLabelmap(node, key)[:4] = 1
        node.GetBinaryLabelmapInternalRepresentation(key).Modified()
        self.assertNotEqual(versionOf(node), before)

    def test_segmentIsCutInPlanesByHand(self):
        node = addSegmentation()
        before = slicer.util.arrayFromSegmentInternalBinaryLabelmap(node, node.GetSegmentation().GetSegmentIDs()[0])
        before = before.copy()
        for name, plane in self.logic.preparePlanes(node, CHOICE).items():
            setPlane(plane, CutPlane(*truth()[name]))
        cavity, seeds = self.logic.prepareApply(node, CHOICE)
        self.assertEqual(len(self.rims(cavity)[0]), 6)
        self.logic.flatten(cavity, seeds)
        after = slicer.util.arrayFromSegmentInternalBinaryLabelmap(node, node.GetSegmentation().GetSegmentIDs()[0])
        np.testing.assert_array_equal(before, after)


class SceneTest(PrepareCase):
    def reopen(self):
        with tempfile.TemporaryDirectory() as folder:
            file = str(Path(folder) / "scene.mrb")
            self.assertTrue(slicer.util.saveScene(file))
            slicer.mrmlScene.Clear()
            slicer.util.loadScene(file)
        self.p = type(self.p)(self.logic.getParameterNode())
        self.raw = self.p.prepareInput

    def test_planesAreKept(self):
        self.logic.suggestParameters(self.p)
        self.movePlane("RSPV", 4.0)
        before = {name: planeOf(node) for name, node in planesOf(self.raw).items()}
        self.reopen()
        self.assertEqual(self.raw.GetName(), "Raw")
        planes = planesOf(self.raw)
        self.assertEqual(set(planes), set(before))
        for name, node in planes.items():
            np.testing.assert_allclose(planeOf(node).centre, before[name].centre, atol=1e-3)
            np.testing.assert_allclose(planeOf(node).normal, before[name].normal, atol=1e-3)
        cavity, _ = self.logic.applyParameters(self.p)
        self.assertLess(min(np.linalg.norm(m - before["RSPV"].centre) for m in self.rims(cavity)[1]), 2.0)

    def test_theCavityCanStillBeUndone(self):
        self.logic.suggestParameters(self.p)
        self.logic.applyParameters(self.p)
        self.reopen()
        self.assertEqual(self.logic.cavityOf(self.raw).GetName(), "Raw cavity")
        self.assertIs(self.p.surface, self.logic.cavityOf(self.raw))
        self.assertEqual(self.logic.undoPrepareParameters(self.p), "cavity")
        self.assertIsNone(self.p.surface)
        self.assertIsNone(self.p.seeds)
        self.assertFalse(planesOf(self.raw)["LAA"].GetLocked())


class PreviewTest(PrepareCase):
    def setUp(self):
        super().setUp()
        self.clock, self.told = Clock(), 0
        self.preview = CutPreview(self.logic, self.p, self.clock.schedule, self.tell, self.clock)
        self.logic._preview = self.preview
        self.planes = self.logic.suggestParameters(self.p)
        self.clock.run(1.0)

    def tell(self):
        self.told += 1

    def rimsNode(self):
        return next((n for n in slicer.util.getNodesByClass("vtkMRMLModelNode") if n.GetName() == "Planned rims"), None)

    def test_rimsOfAllPlanes(self):
        cuts = self.logic.plannedCuts()
        self.assertEqual(set(cuts), set(LEFT_ATRIUM.openings))
        shape = phantom().shape
        for name, cut in cuts.items():
            self.assertTrue(cut.around, name)
            self.assertAlmostEqual(
                cut.perimeter / (2.0 * np.pi * shape.openings[name].rim[0]), 1.0, delta=0.1, msg=name
            )
            plane = planeOf(self.planes[name])
            self.assertLess(np.abs((cut.points - plane.centre) @ plane.normal).max(), 1e-6)
        self.assertGreater(self.rimsNode().GetPolyData().GetNumberOfCells(), 0)

    def test_aMoveIsSeenAtOnceAndTheLastMoveAfterAPause(self):
        before = self.logic.plannedCuts()["RSPV"]
        self.movePlane("RSPV", 2.0)
        first = self.logic.plannedCuts()["RSPV"]
        self.assertAlmostEqual(
            float((first.points.mean(axis=0) - before.points.mean(axis=0)) @ planeOf(self.planes["RSPV"]).normal),
            2.0,
            delta=0.1,
        )
        told = self.told
        for _ in range(5):
            self.movePlane("RSPV", 0.5)
        self.assertEqual(self.told, told, "too soon after the last one")
        self.clock.run(SHORTEST_PAUSE + 0.01)
        plane = planeOf(self.planes["RSPV"])
        self.assertLess(np.abs((self.logic.plannedCuts()["RSPV"].points - plane.centre) @ plane.normal).max(), 1e-6)
        self.assertEqual(self.told, told + 1)
        self.clock.run(1.0)
        self.assertEqual(self.told, told + 1)

    def test_onlyTheMovedPlaneIsCutAnew(self):
        before = dict(self.logic.plannedCuts())
        self.movePlane("LAA", 1.0)
        self.clock.run(1.0)
        after = self.logic.plannedCuts()
        self.assertEqual([name for name in after if after[name] is not before[name]], ["LAA"])

    def test_aPlaneBesideTheVeinIsRed(self):
        plane = planeOf(self.planes["RSPV"])
        aside = np.cross(plane.normal, (0.0, 0.0, 1.0))
        setPlane(self.planes["RSPV"], CutPlane(plane.centre + 20.0 * aside / np.linalg.norm(aside), plane.normal))
        self.clock.run(1.0)
        self.assertFalse(self.logic.plannedCuts()["RSPV"].around)
        red, green, _ = self.planes["RSPV"].GetDisplayNode().GetSelectedColor()
        self.assertGreater(red, green)

    def test_afterApplyNothingIsDrawn(self):
        self.logic.applyParameters(self.p)
        self.clock.run(1.0)
        self.assertEqual(dict(self.logic.plannedCuts()), {})
        self.assertIsNone(self.rimsNode())
        self.logic.undoPrepareParameters(self.p)
        self.clock.run(1.0)
        self.assertEqual(len(self.logic.plannedCuts()), 6)

    def test_deletedAtrium(self):
        slicer.mrmlScene.RemoveNode(self.raw)
        self.clock.run(1.0)
        self.assertEqual(dict(self.logic.plannedCuts()), {})
        self.assertIsNone(self.rimsNode())

    def test_closedScene(self):
        self.movePlane("RSPV", 0.5)
        self.movePlane("RSPV", 0.5)
        slicer.mrmlScene.Clear()
        self.clock.run(1.0)
        self.assertEqual(slicer.util.getNodesByClass("vtkMRMLModelNode"), [])
