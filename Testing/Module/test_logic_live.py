"""Logic: the map follows the seeds; quickly during a drag, fully afterwards, and never gets in the way."""

import tempfile
from pathlib import Path

import numpy as np
import slicer
import vtk
from LAFlatteningScene.live_update import SHORTEST_PAUSE, LiveUpdate
from logic_case import (
    Clock,
    LogicCase,
    addAtrium,
    addSeeds,
    addTransform,
    moveSeed,
    phantom,
    points,
    seedIndex,
    seedPosition,
    toRas,
)


class LiveCase(LogicCase):
    """An atrium whose map is followed, with a clock that stands still by itself; counts what the Logic makes."""

    without = ()

    def setUp(self):
        super().setUp()
        self.clock, self.reports, self.made = Clock(), [], []
        self.previewTakes = 0.0
        self.surface, self.seeds = addAtrium(), addSeeds(self.logic, self.without)
        self.p = self.parameters(self.surface, self.seeds)
        for name, stage in (("flattenParameters", "map"), ("previewParameters", "preview")):
            self.count(name, stage)
        self.live = LiveUpdate(self.logic, self.p, self.clock.schedule, self.reports.append, self.clock)
        # As startLiveUpdate does, with the test's clock.
        self.logic._live = self.live
        self.clock.run()

    def count(self, name, stage):
        original = getattr(self.logic, name)

        def counted(*arguments, **options):
            self.made.append(stage)
            self.clock.now += self.previewTakes if stage == "preview" else 0.0
            return original(*arguments, **options)

        setattr(self.logic, name, counted)

    def event(self, name):
        self.seeds.InvokeEvent(getattr(self.seeds, name))

    def drag(self, label, steps, pause=0.0):
        """Press, move by 0.1 mm a step, with a pause in seconds after each step; without letting go."""
        self.event("PointStartInteractionEvent")
        for _ in range(steps):
            moveSeed(self.seeds, label, seedPosition(self.seeds, label) + np.array((0.1, 0.0, 0.0)))
            self.clock.run(pause)

    def release(self):
        self.event("PointEndInteractionEvent")
        self.clock.run()


class FollowTest(LiveCase):
    """What happens when."""

    def test_theMapIsMadeWhenAllSeedsAreThere(self):
        self.assertEqual(self.made, ["map"])
        self.assertEqual(self.reports[-1].stage, "map")
        self.assertEqual(self.p.map.GetName(), "Atrium map")
        self.assertIs(self.p.metrics, self.logic.metricsTable(self.p.map))
        self.assertEqual(self.clock.pending(), 0)

    def test_atRestNothingIsMade(self):
        self.made.clear()
        self.seeds.Modified()
        self.seeds.SetName("Other")
        self.seeds.GetDisplayNode().SetTextScale(5.0)
        self.p.showLabels = False
        self.surface.GetDisplayNode().SetOpacity(0.5)
        self.clock.run(1.0)
        self.assertEqual(self.made, [])

    def test_addingAnotherSceneEndsIt(self):
        before, mapNode = points(self.p.map), self.p.map
        with tempfile.TemporaryDirectory() as folder:
            file = str(Path(folder) / "saved.mrb")
            slicer.util.saveScene(file)
            moveSeed(self.seeds, "RSPV", seedPosition(self.seeds, "RSPV") + np.array((0.0, 3.0, 0.0)))
            self.made.clear()
            # The nodes of the file have the names and ids of those that are here, the seeds are elsewhere.
            slicer.util.loadScene(file)
        self.clock.run(1.0)
        self.assertEqual(self.made, [])
        np.testing.assert_array_equal(points(mapNode), before)

    def test_duringADragOnlyPreviews(self):
        self.made.clear()
        before = points(self.p.map)
        self.drag("RSPV", 10, pause=0.1)
        self.assertEqual(self.made, ["preview"] * 10)
        self.assertGreater(np.abs(points(self.p.map) - before).max(), 0.01)
        self.release()
        self.assertEqual(self.made, ["preview"] * 10 + ["map"])
        self.assertEqual(self.reports[-1].stage, "map")

    def test_leadingEdge(self):
        self.made.clear()
        self.drag("RSPV", 1)
        self.assertEqual(self.made, ["preview"], "the first move shows at once")

    def test_trailingEdge(self):
        self.drag("RSPV", 1)
        self.made.clear()
        self.drag("RSPV", 5)
        self.assertEqual(self.made, [], "too soon after the last one")
        self.clock.run(SHORTEST_PAUSE + 0.01)
        self.assertEqual(self.made, ["preview"], "the last of several moves is shown, though no further event comes")
        self.clock.run(1.0)
        self.assertEqual(self.made, ["preview"])

    def test_slowPreviewsLeaveHalfOfTheTime(self):
        self.made.clear()
        self.previewTakes = 0.2
        began = self.clock.now
        self.drag("RSPV", 200, pause=0.01)
        share = 0.2 * len(self.made) / (self.clock.now - began)
        self.assertLess(share, 0.6)
        self.assertGreater(share, 0.3)

    def test_releaseDropsThePreviewThatIsDue(self):
        self.drag("RSPV", 3)
        self.made.clear()
        self.release()
        self.clock.run(1.0)
        self.assertEqual(self.made, ["map"])

    def test_aNewDragBeforeTheMapIsMadePutsItOff(self):
        self.drag("RSPV", 2)
        self.event("PointEndInteractionEvent")
        self.made.clear()
        self.event("PointStartInteractionEvent")
        self.clock.run(1.0)
        self.assertNotIn("map", self.made)
        self.release()
        self.assertEqual(self.made.count("map"), 1)

    def test_previewIsReplacedEvenIfTheSeedComesBack(self):
        start, before = seedPosition(self.seeds, "LSPV"), points(self.p.map)
        self.drag("LSPV", 4, pause=0.1)
        moveSeed(self.seeds, "LSPV", start)
        self.clock.run(0.1)
        self.release()
        self.assertEqual(self.p.map.GetAttribute("LAFlattening.stage"), "map")
        np.testing.assert_allclose(points(self.p.map), before, atol=1e-6)

    def test_aClickWithoutAMoveMakesNothing(self):
        self.made.clear()
        self.event("PointStartInteractionEvent")
        self.release()
        self.assertEqual(self.made, [])

    def test_manyChangesAtOnceMakeOneMap(self):
        self.made.clear()
        for label in ("RSPV", "LIPV", "LAA"):
            moveSeed(self.seeds, label, seedPosition(self.seeds, label) + np.array((0.5, 0.0, 0.0)))
        self.clock.run()
        self.assertEqual(self.made, ["map"])

    def test_switchedOff(self):
        self.p.liveUpdate = False
        self.clock.run()
        self.made.clear()
        before = points(self.p.map)
        self.drag("RSPV", 5, pause=0.1)
        self.release()
        self.assertEqual(self.made, [])
        np.testing.assert_array_equal(points(self.p.map), before)
        self.assertEqual(self.reports[-1].stage, "outdated")
        self.assertIn("Flatten", self.reports[-1].message)
        self.p.liveUpdate = True
        self.clock.run()
        self.assertEqual(self.made, ["map"])

    def test_stopped(self):
        self.drag("RSPV", 3)
        self.made.clear()
        self.logic.stopLiveUpdate()
        moveSeed(self.seeds, "LAA", seedPosition(self.seeds, "LAA") + np.array((1.0, 0.0, 0.0)))
        self.release()
        self.clock.run(1.0)
        self.assertEqual(self.made, [])

    def test_otherTemplate(self):
        before = points(self.p.map)
        self.p.template = "adapted2"
        self.clock.run()
        self.assertEqual(self.made, ["map", "map"])
        self.assertGreater(np.abs(points(self.p.map) - before).max(), 1.0)

    def test_transformOfTheSeeds(self):
        self.made.clear()
        parent = addTransform(self.seeds, vtk.vtkTransform())
        matrix = np.eye(4)
        matrix[0, 3] = 0.5
        parent.SetMatrixTransformToParent(slicer.util.vtkMatrixFromArray(matrix))
        self.clock.run()
        self.assertEqual(self.made, ["map"])

    def test_aSavedMapIsNotMadeAgain(self):
        self.logic.stopLiveUpdate()
        self.made.clear()
        again = LiveUpdate(self.logic, self.p, self.clock.schedule, self.reports.append, self.clock)
        self.addCleanup(again.stop)
        self.clock.run()
        self.assertEqual(self.made, [])
        self.assertEqual(self.reports[-1].stage, "map")


class SnapTest(LiveCase):
    """Seeds snap when they are let go."""

    def test_onlyTheSeedThatWasMovedAndOnlyOnRelease(self):
        others = {label: seedPosition(self.seeds, label) for label in ("RSPV", "MV2")}
        start = seedPosition(self.seeds, "MV1")
        self.event("PointStartInteractionEvent")
        inTheAir = start + np.array((1.5, 2.0, 2.5))
        moveSeed(self.seeds, "MV1", inTheAir)
        self.clock.run(1.0)
        np.testing.assert_allclose(seedPosition(self.seeds, "MV1"), inTheAir)
        self.release()
        cavity = self.logic.cache.cavity(self.surface, self.logic.anatomy(), {"MV1": start})
        rim = cavity.surface.points[cavity.outer]
        self.assertLess(np.linalg.norm(rim - seedPosition(self.seeds, "MV1"), axis=1).min(), 1e-9)
        for label, place in others.items():
            np.testing.assert_array_equal(seedPosition(self.seeds, label), place)

    def test_switchedOff(self):
        self.p.snapSeeds = False
        place = seedPosition(self.seeds, "MV1") + np.array((0.7, 0.7, 0.7))
        moveSeed(self.seeds, "MV1", place)
        self.clock.run()
        np.testing.assert_allclose(seedPosition(self.seeds, "MV1"), place)


class WrongSeedsTest(LiveCase):
    """Seeds that cannot be right."""

    def test_markedWithTheReasonAndTheMapStays(self):
        before = points(self.p.map)
        left = seedPosition(self.seeds, "LSPV")
        moveSeed(self.seeds, "LSPV", seedPosition(self.seeds, "RSPV") + np.array((0.5, 0.0, 0.0)))
        self.clock.run()
        report = self.reports[-1]
        self.assertEqual(report.stage, "error")
        self.assertIn("LSPV", report.seedReasons)
        self.assertIn("same opening", report.message)
        self.assertFalse(self.seeds.GetNthControlPointSelected(seedIndex(self.seeds, "LSPV")))
        np.testing.assert_array_equal(points(self.p.map), before)
        self.made.clear()
        self.p.showLabels = False
        self.clock.run()
        self.assertEqual(self.made, [], "the same input is not tried twice")
        self.assertEqual(self.reports[-1].stage, "error")
        moveSeed(self.seeds, "LSPV", left)
        self.clock.run()
        self.assertEqual(self.reports[-1].stage, "map")
        self.assertTrue(self.seeds.GetNthControlPointSelected(seedIndex(self.seeds, "LSPV")))

    def test_duringADrag(self):
        self.event("PointStartInteractionEvent")
        moveSeed(self.seeds, "LSPV", seedPosition(self.seeds, "RSPV") + np.array((0.5, 0.0, 0.0)))
        self.assertEqual(self.reports[-1].stage, "error")
        self.assertIn("LSPV", self.reports[-1].seedReasons)


class PlacingTest(LiveCase):
    """The map appears with the last seed."""

    without = ("LAA", "MV2")

    def test_stepByStep(self):
        self.assertEqual((self.reports[-1].stage, self.reports[-1].nextSeed), ("seeds", "LAA"))
        self.assertIsNone(self.p.map)
        for label, after in (("LAA", "MV2"), ("MV2", None)):
            self.logic.placeSeed(self.seeds, label, toRas(phantom().seeds[label]))
            self.clock.run()
            self.assertEqual(self.reports[-1].nextSeed, after)
        self.assertEqual(self.made, ["map"])
        self.assertIsNotNone(self.p.map)


class UndoTest(LiveCase):
    """Changes of seeds can be undone."""

    def test_moves(self):
        first = seedPosition(self.seeds, "RIPV")
        self.assertFalse(self.logic.canUndo())
        places = [first]
        for _ in range(2):
            self.drag("RIPV", 8, pause=0.1)
            self.release()
            places.append(seedPosition(self.seeds, "RIPV"))
        self.assertGreater(np.linalg.norm(places[2] - places[1]), 0.2)
        for place in (places[1], places[0]):
            self.logic.undo()
            self.clock.run()
            np.testing.assert_allclose(seedPosition(self.seeds, "RIPV"), place, atol=1e-9)
        self.assertFalse(self.logic.canUndo())
        self.assertTrue(self.logic.canRedo())
        self.logic.redo()
        self.logic.redo()
        self.clock.run()
        np.testing.assert_allclose(seedPosition(self.seeds, "RIPV"), places[2], atol=1e-9)
        self.assertFalse(self.logic.canRedo())

    def test_removal(self):
        place = seedPosition(self.seeds, "MV3")
        self.logic.removeSeed(self.seeds, "MV3")
        self.clock.run()
        self.assertEqual(self.reports[-1].nextSeed, "MV3")
        self.logic.undo()
        self.clock.run()
        np.testing.assert_allclose(seedPosition(self.seeds, "MV3"), place, atol=1e-9)
        self.assertEqual(self.reports[-1].stage, "map")

    def test_aNewChangeEndsRedoing(self):
        for label in ("RSPV", "LSPV"):
            moveSeed(self.seeds, label, seedPosition(self.seeds, label) + np.array((1.0, 0.0, 0.0)))
            self.clock.run()
        self.logic.undo()
        self.clock.run()
        moveSeed(self.seeds, "LAA", seedPosition(self.seeds, "LAA") + np.array((1.0, 0.0, 0.0)))
        self.clock.run()
        self.assertFalse(self.logic.canRedo())
        self.assertTrue(self.logic.canUndo())

    def test_theMapFollows(self):
        before = points(self.p.map)
        moveSeed(self.seeds, "LSPV", seedPosition(self.seeds, "LSPV") + np.array((1.0, 0.5, 0.0)))
        self.clock.run()
        self.assertGreater(np.abs(points(self.p.map) - before).max(), 0.01)
        self.logic.undo()
        self.clock.run()
        np.testing.assert_allclose(points(self.p.map), before, atol=1e-6)


class GoneTest(LiveCase):
    """Nodes disappear at any moment."""

    def test_surfaceDeletedDuringADrag(self):
        self.drag("RSPV", 2, pause=0.1)
        slicer.mrmlScene.RemoveNode(self.surface)
        self.drag("RSPV", 2, pause=0.1)
        self.release()
        self.assertEqual(self.reports[-1].stage, "error" if self.p.surface is not None else "seeds")
        self.assertIn("surface", self.reports[-1].message)
        self.assertIsNotNone(self.p.map)

    def test_seedsDeletedDuringADrag(self):
        self.drag("RSPV", 2, pause=0.1)
        slicer.mrmlScene.RemoveNode(self.seeds)
        self.clock.run(1.0)
        self.assertEqual(self.reports[-1].stage, "seeds")
        self.assertIn("seeds", self.reports[-1].message)
        self.assertIsNotNone(self.p.map)

    def test_aDeletedMapIsNotMadeAgainByItself(self):
        self.made.clear()
        slicer.mrmlScene.RemoveNode(self.p.map)
        self.clock.run(1.0)
        self.assertEqual(self.made, [])
        self.assertIn("Flatten", self.reports[-1].message)
        moveSeed(self.seeds, "LAA", seedPosition(self.seeds, "LAA") + np.array((1.0, 0.0, 0.0)))
        self.clock.run()
        self.assertEqual(self.made, ["map"])
        self.assertIsNotNone(self.p.map)

    def test_aDeletedMapThatWasMadeByHandIsNotMadeAgainEither(self):
        self.p.liveUpdate = False
        self.clock.run()
        moveSeed(self.seeds, "LAA", seedPosition(self.seeds, "LAA") + np.array((1.0, 0.0, 0.0)))
        self.clock.run()
        self.logic.flattenParameters(self.p)
        self.p.liveUpdate = True
        self.clock.run()
        self.made.clear()
        slicer.mrmlScene.RemoveNode(self.p.map)
        self.clock.run(1.0)
        self.assertEqual(self.made, [])
        self.assertIn("Flatten", self.reports[-1].message)

    def test_sceneClosed(self):
        self.drag("RSPV", 3)
        self.made.clear()
        slicer.mrmlScene.Clear(0)
        self.clock.run(1.0)
        self.assertEqual(self.made, [])

    def test_otherSeedsAreChosen(self):
        other = addSeeds(self.logic)
        self.p.seeds = other
        self.clock.run()
        self.made.clear()
        moveSeed(self.seeds, "LAA", seedPosition(self.seeds, "LAA") + np.array((1.0, 0.0, 0.0)))
        self.clock.run()
        self.assertEqual(self.made, [], "the former seeds are no longer followed")
        moveSeed(other, "LAA", seedPosition(other, "LAA") + np.array((1.0, 0.0, 0.0)))
        self.clock.run()
        self.assertEqual(self.made, ["map"])

    def test_surfaceOfOtherTopology(self):
        before = points(self.p.map)
        sphere = vtk.vtkSphereSource()
        sphere.SetRadius(40.0)
        sphere.Update()
        self.surface.SetAndObservePolyData(sphere.GetOutput())
        self.clock.run()
        self.assertEqual(self.reports[-1].stage, "error")
        self.assertIn("openings", self.reports[-1].message)
        np.testing.assert_array_equal(points(self.p.map), before)

    def test_aMapIsBeingMade(self):
        """Events let through by a progress callback wait until the work is done."""
        moved = []

        def progress(share, _text):
            if not moved:
                moved.append(share)
                moveSeed(self.seeds, "LAA", seedPosition(self.seeds, "LAA") + np.array((1.0, 0.0, 0.0)))
            self.clock.run(0.05)

        self.made.clear()
        self.logic.flattenParameters(self.p, progress)
        self.assertEqual(self.made, ["map"])
        self.clock.run(1.0)
        self.assertEqual(self.made, ["map", "map"])
        self.assertEqual(self.reports[-1].stage, "map")
