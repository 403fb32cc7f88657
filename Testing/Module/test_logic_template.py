"""Templates of the user's: opened, edited with the map following, undone, saved with the scene and to files."""

import json
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import slicer
from LAFlatteningScene.map_reading import mapDataOf
from LAFlatteningScene.template_editor import TemplateEditor
from LAFlatteningScene.template_handles import CENTRE, FOOT, SIZE, Handle, handlesOf
from LAFlatteningScene.template_text import templateOf, textOf
from logic_case import Clock, LogicCase, addAtrium, addSeeds, phantom, points

from LAFlatteningLib import Flattener, InputFileError, Template, TemplateError, read_surface
from LAFlatteningLib.template_editing import move_foot, move_hole, renamed, scale_hole

ADAPTED = Template.load("adapted1")
MM = 100.0
"""One map unit of a disk of radius 0.5 and diameter 100 mm."""


def own(name="mine"):
    """A template that is not built in."""
    return renamed(move_hole(ADAPTED, "RSPV", (0.22, 0.09)), name)


class TextTest(LogicCase):
    """A template as text."""

    def test_builtIn(self):
        self.assertEqual(textOf(ADAPTED), "adapted1")
        self.assertEqual(templateOf("adapted1"), ADAPTED)

    def test_content(self):
        text = textOf(own())
        self.assertEqual(json.loads(text)["name"], "mine")
        self.assertEqual(templateOf(text), own())
        self.assertEqual(textOf(text), text)

    def test_whatIsNoTemplateIsRefused(self):
        p = self.parameters()
        for text in ("nonsense", "{", '{"schema": "laflattening-template/9"}', ""):
            with self.assertRaises(ValueError):
                p.template = text
        self.assertEqual(p.template, "adapted1")
        with self.assertRaisesRegex(TemplateError, "JSON"):
            templateOf("{nonsense")


class FileTest(LogicCase):
    """Template files."""

    def setUp(self):
        super().setUp()
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.p = self.parameters(addAtrium(), addSeeds(self.logic))

    def test_theFileIsUsedAndKeptWithTheScene(self):
        own().save(self.folder / "mine.json")
        self.logic.openTemplate(self.p, self.folder / "mine.json")
        (self.folder / "mine.json").unlink()
        mapNode = self.logic.flattenParameters(self.p)
        self.assertEqual(mapDataOf(mapNode).template, own())
        expected = Flattener(phantom().surface, own()).flatten(phantom().seeds).points * MM
        np.testing.assert_allclose(points(mapNode)[:, :2], expected, atol=0.01)
        path = self.folder / "scene.mrb"
        self.assertTrue(slicer.util.saveScene(str(path)))
        slicer.mrmlScene.Clear()
        slicer.util.loadScene(str(path))
        again = self.logic.getParameterNode()
        parameters = type(self.p)(again)
        self.assertEqual(templateOf(parameters.template), own())
        self.assertEqual(mapDataOf(parameters.map).template, own())

    def test_bySavingItGetsTheNameOfTheFile(self):
        self.p.template = textOf(own())
        self.logic.saveTemplate(self.p, self.folder / "clinic 2.json")
        saved = Template.load(self.folder / "clinic 2.json")
        self.assertEqual(saved, replace(own(), name="clinic_2"))
        self.assertEqual(templateOf(self.p.template), saved)

    def test_aCopyOfABuiltInOne(self):
        self.logic.saveTemplate(self.p, self.folder / "copy.json")
        self.assertEqual(Template.load(self.folder / "copy.json"), replace(ADAPTED, name="copy"))
        self.assertEqual(self.p.template, "adapted1")

    def test_whatCannotBeSavedOrOpened(self):
        for name in ("population.json", "Bär.json"):
            with self.assertRaises(TemplateError):
                self.logic.saveTemplate(self.p, self.folder / name)
        self.assertEqual(list(self.folder.iterdir()), [])
        content = own().to_dict()
        content["holes"]["LAA"]["shape"]["centre"] = [0.6, 0.0]
        (self.folder / "bad.json").write_text(json.dumps(content))
        with self.assertRaisesRegex(TemplateError, "holes.LAA.shape"):
            self.logic.openTemplate(self.p, self.folder / "bad.json")
        self.assertEqual(self.p.template, "adapted1")

    def test_theFileIsFoundAgainWhereFilesAreChosen(self):
        self.logic.saveTemplate(self.p, self.folder / "mine")
        self.assertEqual([path.name for path in self.folder.iterdir()], ["mine.json"])
        self.assertEqual(Template.load(self.folder / "mine.json").name, "mine")
        # Nobody was asked whether that file may be replaced.
        with self.assertRaisesRegex(InputFileError, "already"):
            self.logic.saveTemplate(self.p, self.folder / "mine")
        self.logic.saveTemplate(self.p, self.folder / "mine.json")

    def test_otherChambersAreNotForThePanel(self):
        for name in ("right_atrium", "left_ventricle"):
            replace(Template.load(name), name="other").save(self.folder / "other.json")
            with self.assertRaisesRegex(TemplateError, "left_atrium"):
                self.logic.openTemplate(self.p, self.folder / "other.json")
            for text in (name, (self.folder / "other.json").read_text()):
                with self.assertRaisesRegex(ValueError, "left_atrium"):
                    self.p.template = text
        self.assertEqual(self.p.template, "adapted1")

    def test_anExportedMapComesWithItsTemplate(self):
        self.p.template = textOf(own())
        mapNode = self.logic.flattenParameters(self.p)
        written = self.logic.exportMap(mapNode, self.folder, ("vtp",))
        self.assertEqual([path.name for path in written], ["Atrium map.vtp", "Atrium map template.json"])
        self.assertEqual(Template.load(written[1]), own())
        self.assertEqual(list(read_surface(written[0]).field_data["template"]), ["mine"])

    def test_theConsoleTakesFileAndContent(self):
        own().save(self.folder / "mine.json")
        byFile = self.logic.flatten(self.p.surface, self.p.seeds, template=str(self.folder / "mine.json"))
        byText = self.logic.flatten(self.p.surface, self.p.seeds, template=textOf(own()))
        np.testing.assert_array_equal(points(byFile), points(byText))
        (self.folder / "mine.json").unlink()
        self.assertEqual(mapDataOf(byFile).template, own())


class HandleTest(LogicCase):
    """Where handles are, and what dragging them does."""

    def test_whereTheyAre(self):
        handles = handlesOf(ADAPTED)
        self.assertEqual(len(handles), 5 + 5 + 4)
        self.assertEqual({h.label(ADAPTED) for h in handles if h.kind == FOOT}, {"MV1", "MV2", "MV3", "MV4"})
        for handle in handles:
            place = handle.place(ADAPTED)
            if handle.kind == CENTRE:
                np.testing.assert_allclose(place, ADAPTED.holes[handle.name].shape.centre)
            rim = ADAPTED.outer if handle.kind == FOOT else ADAPTED.holes[handle.name]
            if handle.kind != CENTRE:
                self.assertLess(rim.shape.distance(place[None])[0], 1e-12)

    def test_draggedToWhereTheyAreTheyChangeNothing(self):
        template = own()
        for handle in handlesOf(template):
            same = handle.dragged(template, handle.place(template))
            for opening in template.anatomy.openings:
                a, b = same.rim(opening), template.rim(opening)
                np.testing.assert_allclose(a.shape.semi_axes, b.shape.semi_axes, atol=1e-12)
                np.testing.assert_allclose(list(a.feet.values()), list(b.feet.values()), atol=1e-9)

    def test_dragged(self):
        template = Handle(CENTRE, "LAA").dragged(ADAPTED, np.array((-0.27, 0.28)))
        self.assertEqual(template, move_hole(ADAPTED, "LAA", (-0.27, 0.28)))
        centre = ADAPTED.holes["LAA"].shape.centre
        wider = Handle(SIZE, "LAA").dragged(ADAPTED, np.add(centre, (0.0, 0.05)))
        np.testing.assert_allclose(wider.holes["LAA"].shape.semi_axes, 0.05)
        foot = Handle(FOOT, "s5").dragged(ADAPTED, np.array((0.3, 0.3)))
        self.assertAlmostEqual(foot.outer.feet["s5"], 45.0)


class EditorTest(LogicCase):
    """Editing, with a clock that stands still by itself."""

    def setUp(self):
        super().setUp()
        self.surface, self.seeds = addAtrium(), addSeeds(self.logic)
        self.p = self.parameters(self.surface, self.seeds)
        self.logic.flattenParameters(self.p)
        self.clock, self.reports, self.states = Clock(), [], []
        self.logic.startLiveUpdate(self.p, self.clock.schedule, lambda report: self.states.append(report.stage))
        self.editor = TemplateEditor(self.logic, self.p, self.clock.schedule, self.reports.append, self.clock)
        self.logic._editor = self.editor
        self.addCleanup(self.logic.stopTemplateEditing)
        self.clock.run(1.0)
        self.p.editTemplate = True
        self.clock.run()
        self.node = self.editor.handlesNode

    def index(self, kind, name):
        return handlesOf(self.editor.template).index(Handle(kind, name))

    def place(self, kind, name):
        """Where a handle is, map units."""
        return np.array(self.node.GetNthControlPointPosition(self.index(kind, name)))[:2] / MM

    def move(self, kind, name, place):
        self.node.SetNthControlPointPosition(self.index(kind, name), *(MM * np.asarray(place)).tolist(), 1.2)

    def drag(self, kind, name, *places):
        self.node.InvokeEvent(self.node.PointStartInteractionEvent)
        for place in places:
            self.move(kind, name, place)
            self.clock.run(0.2)

    def release(self):
        self.node.InvokeEvent(self.node.PointEndInteractionEvent)
        self.clock.run()

    def stage(self):
        return self.p.map.GetAttribute("LAFlattening.stage")

    def test_handlesAreWhereTheTemplateIs(self):
        for handle in handlesOf(ADAPTED):
            np.testing.assert_allclose(self.place(handle.kind, handle.name), handle.place(ADAPTED), atol=1e-9)
        self.p.editTemplate = False
        self.assertIsNone(self.editor.handlesNode)
        self.assertIsNone(self.node.GetScene())

    def test_theMapFollowsAndIsMadeInFullOnRelease(self):
        before = points(self.p.map)
        self.drag(CENTRE, "RSPV", (0.21, 0.09), (0.22, 0.1))
        self.assertEqual(self.stage(), "preview")
        self.assertEqual(self.p.template, "adapted1")
        quick, template = points(self.p.map), move_hole(ADAPTED, "RSPV", (0.22, 0.1))
        self.assertGreater(np.abs(quick - before).max(), 0.5)
        self.assertEqual([report.template for report in self.reports][-1], template)
        self.assertGreater(self.reports[-1].summary["beta"]["mean"], 0.2)
        self.assertEqual(self.reports[-1].folded, 0)
        # The handles of rim and lines have come along.
        np.testing.assert_allclose(self.place(SIZE, "RSPV"), Handle(SIZE, "RSPV").place(template), atol=1e-9)
        self.release()
        self.assertEqual(templateOf(self.p.template), template)
        self.assertEqual(self.stage(), "map")
        expected = Flattener(phantom().surface, template).flatten(phantom().seeds).points * MM
        np.testing.assert_allclose(points(self.p.map)[:, :2], expected, atol=0.01)
        self.assertEqual(self.states[-1], "map")

    def test_sizeAndMitralSeed(self):
        centre = ADAPTED.holes["LIPV"].shape.centre
        self.drag(SIZE, "LIPV", np.add(centre, (0.04, 0.0)))
        self.release()
        self.drag(FOOT, "s9", (-0.28, 0.45))
        # Off the rim while the mouse holds it, on it afterwards.
        np.testing.assert_allclose(self.place(FOOT, "s9"), (-0.28, 0.45), atol=1e-9)
        self.release()
        self.assertAlmostEqual(np.linalg.norm(self.place(FOOT, "s9")), 0.5)
        template = templateOf(self.p.template)
        np.testing.assert_allclose(template.holes["LIPV"].shape.semi_axes, 0.04)
        self.assertAlmostEqual(template.outer.feet["s9"], np.degrees(np.arctan2(0.45, -0.28)))
        self.assertEqual(template.name, "adapted1-edited")

    def test_whatCannotBeIsSaidAndNotTaken(self):
        self.drag(CENTRE, "RSPV", (0.21, 0.09), (0.205, -0.1))
        self.assertIn("overlaps", self.reports[-1].message)
        self.release()
        template = move_hole(ADAPTED, "RSPV", (0.21, 0.09))
        self.assertEqual(templateOf(self.p.template), template)
        np.testing.assert_allclose(self.place(CENTRE, "RSPV"), (0.21, 0.09), atol=1e-9)
        self.assertEqual(self.stage(), "map")

    def test_aScriptThatMovesAHandle(self):
        self.move(CENTRE, "LAA", (-0.27, 0.28))
        self.assertEqual(self.stage(), "preview")
        self.clock.run(1.0)
        self.assertEqual(templateOf(self.p.template), move_hole(ADAPTED, "LAA", (-0.27, 0.28)))
        self.move(CENTRE, "LAA", (0.9, 0.0))
        self.assertIn("beyond the outer rim", self.reports[-1].message)
        np.testing.assert_allclose(self.place(CENTRE, "LAA"), (-0.27, 0.28), atol=1e-9)

    def test_numbersAreShownAtOnceAndTakenAfterAPause(self):
        self.logic.editTemplate(scale_hole(ADAPTED, "LAA", 1.1))
        self.assertEqual(self.stage(), "preview")
        self.clock.run(0.3)
        self.logic.editTemplate(scale_hole(ADAPTED, "LAA", 1.2))
        self.clock.run(0.3)
        self.assertEqual(self.p.template, "adapted1")
        self.clock.run(0.3)
        self.assertEqual(templateOf(self.p.template), scale_hole(ADAPTED, "LAA", 1.2))
        np.testing.assert_allclose(
            self.place(SIZE, "LAA"), Handle(SIZE, "LAA").place(scale_hole(ADAPTED, "LAA", 1.2)), atol=1e-9
        )

    def test_undoAndRedo(self):
        before = points(self.p.map)
        self.assertFalse(self.logic.canUndoTemplate())
        self.logic.editTemplate(scale_hole(ADAPTED, "LAA", 1.1))
        self.clock.run(1.0)
        first = self.p.template
        self.logic.editTemplate(move_foot(templateOf(first), "MV", "s5", 26.0))
        # Not taken yet, and undone all the same.
        self.logic.undoTemplate()
        self.clock.run(1.0)
        self.assertEqual(self.p.template, first)
        self.logic.undoTemplate()
        self.clock.run(1.0)
        self.assertEqual(self.p.template, "adapted1")
        np.testing.assert_allclose(points(self.p.map), before, atol=1e-6)
        self.assertFalse(self.logic.canUndoTemplate())
        self.logic.redoTemplate()
        self.logic.redoTemplate()
        self.clock.run(1.0)
        self.assertEqual(templateOf(self.p.template).outer.feet["s5"], 26.0)
        self.assertFalse(self.logic.canRedoTemplate())

    def test_resetGoesBackToTheBuiltInOne(self):
        self.p.template = "adapted2"
        self.clock.run()
        self.logic.editTemplate(scale_hole(Template.load("adapted2"), "LIPV", 1.1))
        self.clock.run(1.0)
        edited = self.p.template
        self.logic.resetTemplate(self.p)
        self.assertEqual(self.p.template, "adapted2")
        # The edited one is still offered, and undoing brings it back.
        self.assertEqual(list(self.logic.templateChoices(self.p))[-1], edited)
        self.logic.undoTemplate()
        self.assertEqual(self.p.template, edited)

    def test_anotherTemplateMovesTheHandles(self):
        self.p.template = "adapted2"
        self.clock.run()
        np.testing.assert_allclose(self.place(CENTRE, "RSPV"), (0.25, 0.1), atol=1e-9)

    def test_theHandlesGoWithTheMapAndAreNeverSaved(self):
        self.assertFalse(self.node.GetSaveWithScene())
        slicer.mrmlScene.RemoveNode(self.p.map)
        self.clock.run(1.0)
        self.assertIsNone(self.node.GetScene())

    def test_stopped(self):
        self.logic.stopTemplateEditing()
        self.assertIsNone(self.node.GetScene())
        self.p.editTemplate = False
        self.clock.run(1.0)
        self.assertEqual(self.p.template, "adapted1")

    def test_seedsThatMoveMeanwhile(self):
        before = points(self.p.map)
        index = self.seeds.GetControlPointIndexByLabel("RSPV")
        place = np.add(self.seeds.GetNthControlPointPositionWorld(index), (0.0, 2.0, 0.0))
        self.p.liveUpdate = False
        self.seeds.SetNthControlPointPositionWorld(index, *place.tolist())
        self.clock.run(1.0)
        self.logic.editTemplate(replace(ADAPTED, name="same"))
        seeds = {**phantom().seeds, "RSPV": place * (-1.0, -1.0, 1.0)}
        self.assertGreater(np.abs(points(self.p.map) - before).max(), 0.1)
        expected = Flattener(phantom().surface).flatten(seeds).points * MM
        np.testing.assert_allclose(points(self.p.map)[:, :2], expected, atol=0.5)
