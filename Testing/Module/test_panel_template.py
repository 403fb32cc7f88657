"""The section Template of the panel, as a user meets it."""

import json
import tempfile
from pathlib import Path
from unittest import mock

import numpy as np
import qt
import slicer
from LAFlatteningScene.template_text import templateOf, textOf
from panel_case import PanelCase

from LAFlatteningLib import Template
from LAFlatteningLib.template_editing import move_hole, renamed

ADAPTED = Template.load("adapted1")


class TestTemplate(PanelCase):
    def setUp(self):
        super().setUp()
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def pick(self, kind, path):
        """Press Open or Save, and answer with a path."""
        with mock.patch.object(qt.QFileDialog, kind, lambda *_: str(path)):
            (self.ui.openTemplateButton if kind == "getOpenFileName" else self.ui.saveTemplateButton).click()

    def choose(self, selector, text):
        selector.setCurrentText(text)
        selector.activated.emit(selector.currentIndex)

    def full(self):
        """Whether the map shows the template of the panel."""
        node = self.parameters.map
        return (
            node.GetAttribute("LAFlattening.stage") == "map"
            and json.loads(node.GetAttribute("LAFlattening.settings"))["template"] == self.parameters.template
        )

    def test_numbers_show_the_template(self):
        self.assertEqual(
            [self.ui.holeSelector.itemText(row) for row in range(self.ui.holeSelector.count)],
            list(ADAPTED.anatomy.holes),
        )
        self.choose(self.ui.holeSelector, "LAA")
        self.assertEqual((self.ui.holeX.value, self.ui.holeY.value, self.ui.holeRadius.value), (-28.0, 28.5, 4.05))
        self.choose(self.ui.footSelector, "MV4")
        self.assertEqual(self.ui.footAngle.value, 130.5)
        self.ui.templateSelector.setCurrentText("adapted2")
        shape = Template.load("adapted2").holes["LAA"].shape
        self.assertAlmostEqual(self.ui.holeX.value, 100.0 * shape.centre[0], places=2)

    def test_numbers_move_the_map(self):
        _, _, mapNode = self.makeMap(follow=True)
        before = slicer.util.arrayFromModelPoints(mapNode).copy()
        said = self.ui.mapDistortion.text
        self.choose(self.ui.holeSelector, "RSPV")
        self.ui.holeX.value = 23.0
        self.assertEqual(mapNode.GetAttribute("LAFlattening.stage"), "preview")
        self.assertIn("isotropy", self.ui.quickDistortion.text)
        self.assertTrue(self.ui.quickDistortion.isVisibleTo(self.panel.parent))
        self.waitFor(self.full)
        self.settle()
        template = templateOf(self.parameters.template)
        self.assertEqual(template.holes["RSPV"].shape.centre, (0.23, 0.08375))
        self.assertGreater(np.abs(slicer.util.arrayFromModelPoints(mapNode) - before).max(), 1.0)
        self.assertEqual(self.ui.templateSelector.currentText, "adapted1-edited")
        self.assertFalse(self.ui.quickDistortion.isVisibleTo(self.panel.parent))
        self.assertNotEqual(self.ui.mapDistortion.text, said)

    def test_radius_and_angle(self):
        self.makeMap(follow=True)
        self.choose(self.ui.holeSelector, "LIPV")
        self.ui.holeRadius.value = 3.6
        self.choose(self.ui.footSelector, "MV1")
        self.ui.footAngle.value = 25.0
        self.waitFor(lambda: self.parameters.template != "adapted1")
        template = templateOf(self.parameters.template)
        np.testing.assert_allclose(template.holes["LIPV"].shape.semi_axes, 0.036)
        self.assertEqual(template.outer.feet["s5"], 25.0)

    def test_what_cannot_be_is_said_and_the_number_goes_back(self):
        self.makeMap(follow=True)
        self.choose(self.ui.holeSelector, "RSPV")
        self.ui.holeX.value = 49.0
        self.assertIn("beyond the outer rim", self.ui.templateMessage.text)
        self.assertTrue(self.ui.templateMessage.isVisibleTo(self.panel.parent))
        self.assertEqual(self.ui.holeX.value, 20.5)
        self.settle(0.7)
        self.assertEqual(self.parameters.template, "adapted1")
        self.ui.holeX.value = 21.0
        self.assertEqual(self.ui.templateMessage.text, "")

    def test_handles_change_numbers(self):
        self.makeMap(follow=True)
        self.ui.editTemplate.click()
        node = self.panel.logic.templateHandles()
        index = node.GetControlPointIndexByLabel("LSPV centre")
        node.SetNthControlPointPosition(index, -24.0, 8.0, 1.2)
        self.assertEqual(self.ui.holeSelector.currentText, "LSPV")
        self.assertEqual((self.ui.holeX.value, self.ui.holeY.value), (-24.0, 8.0))
        self.waitFor(self.full)

    def test_undo_redo_and_reset(self):
        self.makeMap(follow=True)
        self.assertFalse(self.ui.undoTemplateButton.enabled)
        self.choose(self.ui.holeSelector, "RSPV")
        self.ui.holeX.value = 22.0
        self.waitFor(lambda: self.parameters.template != "adapted1")
        edited = self.parameters.template
        self.ui.undoTemplateButton.click()
        self.assertEqual(self.parameters.template, "adapted1")
        self.assertEqual(self.ui.holeX.value, 20.5)
        self.ui.redoTemplateButton.click()
        self.assertEqual(self.parameters.template, edited)
        self.ui.resetTemplateButton.click()
        self.assertEqual((self.parameters.template, self.ui.holeX.value), ("adapted1", 20.5))
        self.assertTrue(self.ui.undoTemplateButton.enabled)

    def test_save_and_open(self):
        self.loadSample()
        self.choose(self.ui.holeSelector, "RSPV")
        self.ui.holeX.value = 21.0
        self.pick("getSaveFileName", self.folder / "mine.json")
        self.assertEqual(self.ui.templateMessage.text, "")
        self.assertEqual(self.ui.templateSelector.currentText, "mine")
        self.ui.templateSelector.setCurrentText("population")
        self.assertEqual(self.parameters.template, "population")
        self.pick("getOpenFileName", self.folder / "mine.json")
        self.assertEqual(templateOf(self.parameters.template), Template.load(self.folder / "mine.json"))
        # Going to and fro between a built-in one and one's own.
        self.ui.templateSelector.setCurrentText("adapted2")
        self.ui.templateSelector.setCurrentText("mine")
        self.assertEqual(templateOf(self.parameters.template).name, "mine")
        self.pick("getOpenFileName", "")
        self.pick("getSaveFileName", "")
        self.assertEqual(self.ui.templateMessage.text, "")

    def test_a_file_that_is_no_template_is_said_to_be_none(self):
        (self.folder / "bad.json").write_text('{"schema": "laflattening-template/2"}')
        self.pick("getOpenFileName", self.folder / "bad.json")
        self.assertIn("schema", self.ui.templateMessage.text)
        self.assertEqual(self.parameters.template, "adapted1")
        self.pick("getSaveFileName", self.folder / "nowhere" / "mine.json")
        self.assertIn("does not exist", self.ui.templateMessage.text)

    def test_a_template_of_another_chamber_is_refused_and_the_panel_goes_on(self):
        self.makeMap(follow=True)
        renamed(Template.load("right_atrium"), "right").save(self.folder / "right.json")
        self.pick("getOpenFileName", self.folder / "right.json")
        self.assertIn("left_atrium", self.ui.templateMessage.text)
        self.assertEqual((self.parameters.template, self.ui.templateSelector.currentText), ("adapted1", "adapted1"))
        self.parameters.showLabels = False
        self.settle()
        self.assertTrue(self.full())

    def test_a_scene_brings_its_template_back(self):
        self.makeMap()
        mine = textOf(renamed(move_hole(ADAPTED, "RSPV", (0.22, 0.09)), "mine"))
        self.parameters.template = mine
        self.parameters.template = "adapted2"
        self.ui.editTemplate.click()
        path = str(self.folder / "scene.mrb")
        self.assertTrue(slicer.util.saveScene(path))
        slicer.mrmlScene.Clear()
        slicer.util.loadScene(path)
        self.panel.enter()
        self.assertEqual(self.parameters.template, "adapted2")
        self.assertTrue(self.ui.editTemplate.checked)
        self.assertIsNotNone(self.panel.logic.templateHandles())
        names = [node.GetName() for node in slicer.util.getNodesByClass("vtkMRMLMarkupsFiducialNode")]
        self.assertEqual(sum("handles" in name for name in names), 1, names)
        self.ui.templateSelector.setCurrentText("mine")
        self.assertEqual(self.parameters.template, mine)

    def test_without_a_map_there_are_no_handles(self):
        self.assertFalse(self.ui.editTemplate.enabled)
        self.assertIn("no map", self.ui.mapDistortion.text)
