"""Logic: what happens while something long is computed and its progress lets events through."""

import tempfile
from pathlib import Path

import numpy as np
import slicer
from analysis_case import AnalysisCase, addVolume, column
from LAFlatteningScene.fibrosis_nodes import classArrayOf
from LAFlatteningScene.live_update import LiveUpdate
from LAFlatteningScene.plane_nodes import planeOf, planesOf, setPlane
from LAFlatteningScene.prepare_logic import RawChoice
from LAFlatteningScene.template_text import textOf
from logic_case import (
    Clock,
    LogicCase,
    addArray,
    addAtrium,
    addSeeds,
    addTransform,
    array,
    moveSeed,
    points,
    sceneNodes,
    seedPosition,
)
from prepare_case import POINTS, addClosed
from vtk import vtkTransform

from LAFlattening import LAFlatteningLogic
from LAFlatteningLib import Cancelled, InputFileError, Rule, SurfaceError, Template
from LAFlatteningLib.cavity.clipping import CutPlane
from LAFlatteningLib.template_editing import move_hole

RULE = Rule("value", (120.0,))
BLOOD = Rule("iir", (1.2,))


class Once:
    """A progress that lets one thing happen, as soon as so much is done."""

    def __init__(self, act, at=0.4):
        self.act, self.at, self.done = act, at, False

    def __call__(self, share, _text):
        if share >= self.at and not self.done:
            self.done = True
            self.act()


def shifted(node, by):
    """Put a node below a transform that shifts it to the right."""
    transform = vtkTransform()
    transform.Translate(by, 0.0, 0.0)
    addTransform(node, transform)


class MeasuringTest(AnalysisCase):
    """Nothing is written that does not belong to the map, the atrium and the image as they are."""

    def setUp(self):
        super().setUp()
        self.volume = addVolume()

    def measure(self, progress=None, rule=RULE):
        return self.logic.measureFibrosis(self.map, "LGE", rule, self.volume, progress=progress)

    def findGaps(self, progress=None):
        return self.logic.findGaps(self.map, "LGE", [110.0, 120.0], progress=progress)

    def stopped(self, action, act, words):
        """Something happens in the midst of an action: it stops, and there is nothing of it."""
        progress = Once(act)
        with self.assertRaisesRegex(Cancelled, words):
            action(progress)
        self.assertTrue(progress.done)
        self.assertFalse(self.logic.isBusy)
        self.assertEqual(slicer.util.getNodesByClass("vtkMRMLMarkupsCurveNode"), [])
        tables = [node.GetName() for node in slicer.util.getNodesByClass("vtkMRMLTableNode")]
        self.assertFalse([name for name in tables if "classes" in name or "gap" in name], tables)
        if self.surface.GetScene() is not None:
            self.assertFalse(self.surface.GetPolyData().GetCellData().HasArray(classArrayOf("LGE")))

    def remake(self, **options):
        """Another seed, another map: made by another Logic, which does not wait for this one."""
        moveSeed(self.seeds, "MV2", 0.5 * (seedPosition(self.seeds, "MV1") + seedPosition(self.seeds, "MV2")))
        LAFlatteningLogic().flatten(self.surface, self.seeds, self.map, **options)

    def test_theMapIsMadeAnew(self):
        for action in (self.measure, self.findGaps):
            with self.subTest(action.__name__):
                self.stopped(action, self.remake, "changed")
        self.assertFalse(self.logic.hasResults(self.map))
        # And now it is the new map that is measured.
        self.measure()
        table, regions = self.logic.fibrosisTable(self.map), self.logic.regionTable(self.map)
        measured, own = column(table, "Area")[1:], np.array(column(regions, "Area on")) / 100.0
        np.testing.assert_allclose(measured, own, rtol=1e-6)

    def test_theTemplateIsAnotherOne(self):
        for action in (self.measure, self.findGaps):
            with self.subTest(action.__name__):
                template = "population" if action == self.measure else "adapted2"

                def remake(template=template):
                    LAFlatteningLogic().flatten(self.surface, self.seeds, self.map, template=template)

                self.stopped(action, remake, "changed")

    def test_theFormerResultsStay(self):
        self.measure()
        before = column(self.logic.fibrosisTable(self.map), "Area")
        with self.assertRaisesRegex(Cancelled, "changed"):
            self.measure(Once(self.remake))
        self.assertEqual(column(self.logic.fibrosisTable(self.map), "Area"), before)
        self.assertTrue(self.logic.hasOutdated(self.map))

    def test_theArrayChanges(self):
        for action in (self.measure, self.findGaps):
            with self.subTest(action.__name__):
                other = 1.1 * array(self.surface, "LGE")
                self.stopped(action, lambda other=other: addArray(self.surface, "LGE", other), "changed")

    def test_theAtriumMoves(self):
        self.stopped(self.measure, lambda: shifted(self.surface, 5.0), "changed")

    def test_theImageChanges(self):
        def brighter():
            slicer.util.arrayFromVolume(self.volume)[:] += 1
            slicer.util.arrayFromVolumeModified(self.volume)

        for act in (brighter, lambda: shifted(self.volume, 3.0)):
            self.stopped(lambda progress: self.measure(progress, BLOOD), act, "changed")

    def test_somethingIsDeleted(self):
        for action in (self.measure, self.findGaps):
            for name in ("map", "surface"):
                with self.subTest(f"{name} while {action.__name__}"):
                    slicer.mrmlScene.Clear(0)
                    self.surface, self.seeds, self.volume = addAtrium(), addSeeds(self.logic), addVolume()
                    self.map = self.logic.flatten(self.surface, self.seeds)
                    node = getattr(self, name)
                    self.stopped(action, lambda node=node: slicer.mrmlScene.RemoveNode(node), "deleted")

    def test_theImageIsDeleted(self):
        self.stopped(
            lambda progress: self.measure(progress, BLOOD), lambda: slicer.mrmlScene.RemoveNode(self.volume), "deleted"
        )

    def test_theSceneIsClosed(self):
        for action in (self.measure, self.findGaps):
            with self.subTest(action.__name__):
                self.surface, self.seeds, self.volume = addAtrium(), addSeeds(self.logic), addVolume()
                self.map = self.logic.flatten(self.surface, self.seeds)
                self.stopped(action, lambda: slicer.mrmlScene.Clear(0), "deleted")

    def test_whatDoesNotMatterDoesNotStopIt(self):
        def harmless():
            addArray(self.surface, "other", np.zeros(len(points(self.surface))))
            self.logic.colourBy(self.surface, None)
            self.seeds.SetName("Seeds of mine")
            slicer.mrmlScene.AddNewNodeByClass("vtkMRMLTextNode", "A note")

        expected = column((self.measure(), self.logic.fibrosisTable(self.map))[1], "Area")
        self.measure(Once(harmless))
        self.assertEqual(column(self.logic.fibrosisTable(self.map), "Area"), expected)
        self.findGaps(Once(harmless))
        self.assertFalse(self.logic.hasOutdated(self.map))


class OneAtATimeTest(AnalysisCase):
    """A second action is refused while one is going on, and the first is not disturbed."""

    def setUp(self):
        super().setUp()
        self.volume, self.raw = addVolume(), addClosed()
        self.choice = RawChoice(points=POINTS)

    def attempts(self):
        """All that reads or writes maps and atria."""
        logic = self.logic
        return {
            "flatten": lambda: logic.flatten(self.surface, self.seeds),
            "preview": lambda: logic.preview(self.surface, self.seeds, self.map),
            "project": lambda: logic.project(self.surface, self.volume),
            "measure": lambda: logic.measureFibrosis(self.map, "LGE", RULE),
            "gaps": lambda: logic.findGaps(self.map, "LGE", [120.0]),
            "compare": lambda: logic.compare(self.map, self.map, "LGE", "number"),
            "clear": lambda: logic.clearAnalysis(self.map),
            "export": lambda: logic.exportMap(self.map, tempfile.gettempdir(), ("csv",)),
            "suggest": lambda: logic.prepareSuggest(self.raw, self.choice),
            "by hand": lambda: logic.preparePlanes(self.raw, self.choice),
            "apply": lambda: logic.prepareApply(self.raw, self.choice),
            "undo": lambda: logic.prepareUndo(self.raw),
        }

    def refuseAll(self):
        nodes = sceneNodes()
        for name, attempt in self.attempts().items():
            with self.subTest(name), self.assertRaisesRegex(Cancelled, "Something else is being computed"):
                attempt()
        self.assertEqual(sceneNodes(), nodes)
        self.assertTrue(self.logic.isBusy, "the first one is still going on")

    def test_all(self):
        self.logic.prepareSuggest(self.raw, self.choice)
        firsts = {
            "flatten": lambda progress: self.logic.flatten(self.surface, self.seeds, self.map, progress=progress),
            "measure": lambda progress: self.logic.measureFibrosis(self.map, "LGE", RULE, progress=progress),
            "gaps": lambda progress: self.logic.findGaps(self.map, "LGE", [120.0], progress=progress),
            "apply": lambda progress: self.logic.prepareApply(self.raw, self.choice, progress),
        }
        # So that there is something to do for Apply.
        plane = planesOf(self.raw)["LAA"]
        setPlane(plane, CutPlane(planeOf(plane).centre + 2.0 * planeOf(plane).normal, planeOf(plane).normal))
        for name, first in firsts.items():
            progress = Once(self.refuseAll)
            self.assertIsNotNone(first(progress), name)
            self.assertTrue(progress.done, name)
            self.assertFalse(self.logic.isBusy, name)
        self.assertEqual(len(column(self.logic.fibrosisTable(self.map), "Area")), 6)
        self.assertIsNotNone(self.logic.gapTable(self.map))

    def test_theMapFollowsAfterwards(self):
        """A seed that was moved meanwhile: first what was asked for, of the map as it was; then the new map."""
        p, clock, reports = self.parameters(self.surface, self.seeds), Clock(), []
        p.map = self.map
        live = LiveUpdate(self.logic, p, clock.schedule, reports.append, clock)
        self.addCleanup(live.stop)
        clock.run(1.0)
        before = points(self.map)
        self.logic.measureFibrosis(self.map, "LGE", RULE)
        expected = column(self.logic.fibrosisTable(self.map), "Area")

        def move():
            moveSeed(self.seeds, "LAA", seedPosition(self.seeds, "LAA") + np.array((2.0, 0.0, 0.0)))
            clock.run(0.5)
            np.testing.assert_array_equal(points(self.map), before)

        self.logic.measureFibrosis(self.map, "LGE", RULE, progress=Once(move))
        self.assertEqual(column(self.logic.fibrosisTable(self.map), "Area"), expected)
        self.assertFalse(self.logic.hasOutdated(self.map))
        clock.run(1.0)
        self.assertGreater(np.abs(points(self.map) - before).max(), 0.1)
        self.assertTrue(self.logic.hasOutdated(self.map))
        self.assertEqual(reports[-1].stage, "map")

    def test_theProjectionFollowsAfterwards(self):
        p, clock, told = self.parameters(self.surface, self.seeds), Clock(), []
        p.volume = self.volume
        self.logic.projectParameters(p)
        self.logic.startLiveProjection(p, clock.schedule, lambda found, text: told.append(found.interval_mm))
        before = array(self.surface, "LGE")

        def change():
            p.projectionDepth = 1.0
            clock.run(0.5)
            np.testing.assert_array_equal(array(self.surface, "LGE"), before)

        self.logic.measureFibrosis(self.map, "LGE", RULE, progress=Once(change))
        self.assertEqual(told, [])
        clock.run(0.5)
        self.assertEqual(told, [(-1.0, 1.0)])
        self.assertEqual(clock.pending(), 0)


class QuickMapTest(AnalysisCase):
    """A quick map, of a drag or an edit, is not the one that its tables are of."""

    def makeQuick(self):
        moveSeed(self.seeds, "LAA", seedPosition(self.seeds, "LAA") + np.array((2.0, 0.0, 0.0)))
        self.logic.preview(self.surface, self.seeds, self.map)

    def test_isNotMeasured(self):
        self.makeQuick()
        for act in (
            lambda: self.logic.measureFibrosis(self.map, "LGE", RULE),
            lambda: self.logic.findGaps(self.map, "LGE", [120.0]),
            lambda: self.logic.compare(self.map, self.map, "LGE", "number"),
        ):
            with self.assertRaisesRegex(SurfaceError, "only a quick map.*Press Flatten"):
                act()
        self.assertFalse(self.logic.hasResults(self.map))

    def test_isNotExported(self):
        self.makeQuick()
        with tempfile.TemporaryDirectory() as folder:
            with self.assertRaisesRegex(InputFileError, "only a quick map"):
                self.logic.exportMap(self.map, folder)
            self.assertEqual(list(Path(folder).iterdir()), [])

    def test_outdatedTablesAreNotExported(self):
        self.logic.measureFibrosis(self.map, "LGE", RULE)
        self.makeQuick()
        self.logic.flatten(self.surface, self.seeds, self.map)
        with tempfile.TemporaryDirectory() as folder:
            with self.assertRaisesRegex(InputFileError, "outdated.*Measure again"):
                self.logic.exportMap(self.map, folder, ("vtp", "csv"))
            self.assertEqual(list(Path(folder).iterdir()), [])
            self.logic.exportMap(self.map, folder, ("vtp",))
            self.logic.measureFibrosis(self.map, "LGE", RULE)
            names = [path.name for path in self.logic.exportMap(self.map, folder, ("csv",))]
        self.assertIn("Atrium map fibrosis.csv", names)


class FlatteningTest(LogicCase):
    """What is chosen in the panel meanwhile is not chosen away."""

    def setUp(self):
        super().setUp()
        self.surface, self.seeds, self.other = addAtrium(), addSeeds(self.logic), addAtrium("Other")
        self.p = self.parameters(self.surface, self.seeds)

    def test_anotherAtriumIsChosen(self):
        nodes = sceneNodes()

        def choose():
            self.p.surface, self.p.seeds = self.other, None

        with self.assertRaisesRegex(Cancelled, "chosen"):
            self.logic.flattenParameters(self.p, Once(choose))
        self.assertEqual((self.p.surface, self.p.seeds, self.p.map), (self.other, None, None))
        self.assertEqual(sceneNodes(), nodes)

    def test_cancelAtTheLastStepCounts(self):
        self.map = self.logic.flatten(self.surface, self.seeds)
        told = []
        LAFlatteningLogic().flatten(self.surface, self.seeds, self.map, progress=lambda *step: told.append(step))
        before, nodes, steps = points(self.map), sceneNodes(), []
        moveSeed(self.seeds, "LAA", seedPosition(self.seeds, "LAA") + np.array((2.0, 0.0, 0.0)))

        def cancel(share, text):
            steps.append((share, text))
            return len(steps) < len(told)

        with self.assertRaises(Cancelled):
            self.logic.flatten(self.surface, self.seeds, self.map, progress=cancel)
        self.assertEqual(steps[-1][0], 1.0)
        self.assertEqual(sceneNodes(), nodes)
        np.testing.assert_array_equal(points(self.map), before)

    def test_theTemplateIsEdited(self):
        """The map is of the template with which it was begun, and says so."""
        template = Template.load("adapted1")
        edited = move_hole(template, "LAA", np.add(template.holes["LAA"].shape.centre, (0.01, 0.0)))

        def edit():
            self.p.template = textOf(edited)

        mapNode = self.logic.flattenParameters(self.p, Once(edit))
        expected = LAFlatteningLogic().flatten(self.surface, self.seeds, template="adapted1")
        np.testing.assert_array_equal(points(mapNode), points(expected))
        self.assertEqual(
            mapNode.GetAttribute("LAFlattening.fingerprint"), expected.GetAttribute("LAFlattening.fingerprint")
        )


class PreparingTest(LogicCase):
    """Planes and cavity belong to the atrium, and to the places of the planes, as they are."""

    def setUp(self):
        super().setUp()
        self.raw = addClosed()
        self.p = self.parameters()
        self.p.prepareInput, self.p.preparePoints = self.raw, POINTS

    def movePlane(self):
        node = planesOf(self.raw)["LAA"]
        plane = planeOf(node)
        setPlane(node, CutPlane(plane.centre - 3.0 * plane.normal, plane.normal))

    def deletePlane(self):
        slicer.mrmlScene.RemoveNode(planesOf(self.raw)["LAA"])

    def grow(self):
        slicer.util.arrayFromModelPoints(self.raw)[:] *= 1.05
        slicer.util.arrayFromModelPointsModified(self.raw)

    def places(self):
        return {name: planeOf(node).centre.tolist() for name, node in planesOf(self.raw).items()}

    def stopped(self, action, act, words="changed"):
        """Something happens in the midst of an action: it stops, and nothing came of it."""
        told = []

        def happen():
            act()
            told.append((sceneNodes(), self.places()))

        with self.assertRaisesRegex(Cancelled, words):
            action(self.p, Once(happen))
        self.assertEqual([(sceneNodes(), self.places())], told)
        self.assertFalse(self.logic.isBusy)
        self.assertFalse(any(node.GetLocked() for node in planesOf(self.raw).values()))

    def test_theAtriumChangesWhileSuggesting(self):
        self.stopped(self.logic.suggestParameters, self.grow)
        # What was found of the former shape is not taken for the present one.
        self.assertFalse(self.logic.isPrepared(self.raw, self.logic.rawChoiceFrom(self.p)))

    def test_aPlaneIsMovedWhileSuggesting(self):
        self.logic.suggestParameters(self.p)
        self.p.pvLength = 5.0
        self.stopped(self.logic.suggestParameters, self.movePlane)

    def test_whileCutting(self):
        for act in (self.movePlane, self.deletePlane, self.grow):
            with self.subTest(act.__name__):
                self.logic.suggestParameters(self.p)
                # So that the cut is not known already.
                node = planesOf(self.raw)["RIPV"]
                setPlane(node, CutPlane(planeOf(node).centre + planeOf(node).normal, planeOf(node).normal))
                self.stopped(self.logic.applyParameters, act)
                self.assertIsNone(self.p.surface)

    def test_whatWasChosenBeforeIsDeleted(self):
        """Undo does not choose a later node that has got the id of the one that was deleted."""
        self.p.surface = addAtrium()
        self.logic.suggestParameters(self.p)
        node = planesOf(self.raw)["RIPV"]
        setPlane(node, CutPlane(planeOf(node).centre + planeOf(node).normal, planeOf(node).normal))
        progress = Once(lambda: slicer.mrmlScene.RemoveNode(self.p.surface))
        cavity, _ = self.logic.applyParameters(self.p, progress)
        self.assertTrue(progress.done)
        self.assertIsNone(cavity.GetNodeReferenceID("LAFlattening.former.surface"))
        self.logic.undoPrepareParameters(self.p)
        self.assertIsNone(self.p.surface)

    def test_anotherInputIsChosen(self):
        other = addClosed("Other")

        def choose():
            self.p.prepareInput = other

        self.stopped(self.logic.suggestParameters, choose, "chosen")
        self.assertIs(self.p.prepareInput, other)
