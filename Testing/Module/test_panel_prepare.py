"""The section Prepare as a user goes through it, by its real buttons."""

import tempfile
import unittest
import unittest.mock
from pathlib import Path

import numpy as np
import qt
import slicer
from LAFlatteningScene.plane_nodes import planeOf, planesOf, setPlane
from panel_case import PanelCase
from prepare_case import POINTS, addClosed, addSegmentation, addSphere, labelVoxels

from LAFlatteningLib.cavity.clipping import CutPlane


class PreparePanelCase(PanelCase):
    def setUp(self):
        super().setUp()
        self.parameters.liveUpdate = False

    def choose(self, node):
        self.parameters.prepareInput, self.parameters.preparePoints = node, POINTS
        self.settle()
        return node

    def suggest(self):
        """A closed atrium with its planes, by the button."""
        raw = self.choose(addClosed())
        self.ui.suggestButton.click()
        self.settle()
        return raw, planesOf(raw)

    def cells(self, name):
        """What the table says about an opening: name, perimeter, plane."""
        table = self.ui.openingsTable
        rows = [[table.item(row, column).text() for column in range(3)] for row in range(table.rowCount)]
        return next(row for row in rows if row[0] == name)

    def move(self, node, offset):
        plane = planeOf(node)
        setPlane(node, CutPlane(plane.centre + offset, plane.normal))
        self.settle()


class TestPrepare(PreparePanelCase):
    def test_empty_scene_says_what_to_do(self):
        for button in (self.ui.suggestButton, self.ui.applyButton, self.ui.prepareUndoButton):
            self.assertFalse(button.enabled)
        self.assertIn("Choose", self.ui.suggestButton.toolTip)
        self.assertFalse(self.ui.openingsTable.isVisibleTo(self.panel.parent))
        self.assertFalse(self.ui.prepareSection.collapsed)

    def test_suggest_shows_planes_and_perimeters(self):
        _raw, planes = self.suggest()
        self.assertEqual(len(planes), 6)
        self.assertEqual(self.ui.openingsTable.rowCount, 6)
        for name in planes:
            _, perimeter, how = self.cells(name)
            self.assertRegex(perimeter, r"^\d+ mm$")
            self.assertTrue(how)
        self.assertTrue(self.ui.applyButton.enabled)
        self.assertIsNone(self.parameters.seeds)

    def test_table_follows_a_plane(self):
        _raw, planes = self.suggest()
        before = self.cells("LAA")
        self.move(planes["LAA"], -4.0 * planeOf(planes["LAA"]).normal)
        self.assertNotEqual(self.cells("LAA")[1], before[1])
        self.assertEqual(self.cells("LAA")[2], "moved")
        self.move(planes["LAA"], np.array((0.0, 0.0, 200.0)))
        self.assertIn("misses", self.cells("LAA")[2])
        self.ui.applyButton.click()
        self.assertIn("LAA", self.ui.prepareMessage.text)
        self.assertIsNone(self.parameters.seeds)
        self.ui.prepareUndoButton.click()
        self.settle()
        self.assertEqual(self.cells("LAA"), before)

    def test_chosen_opening_gets_handles(self):
        _raw, planes = self.suggest()
        self.panel.prepare.choose([self.ui.openingsTable.item(row, 0).text() for row in range(6)].index("RIPV"))
        self.settle()
        self.assertEqual(
            [name for name, node in planes.items() if node.GetDisplayNode().GetHandlesInteractive()], ["RIPV"]
        )

    def test_apply_and_undo(self):
        raw, planes = self.suggest()
        self.ui.applyButton.click()
        cavity = self.parameters.surface
        self.assertEqual(cavity.GetName(), "Raw cavity")
        self.assertEqual(self.parameters.seeds.GetNumberOfDefinedControlPoints(), 9)
        self.assertFalse(self.ui.applyButton.enabled)
        self.assertIn("Undo", self.ui.applyButton.toolTip)
        self.assertFalse(self.ui.prepareSection.collapsed)
        self.assertTrue(self.ui.flattenButton.enabled)
        self.ui.flattenButton.click()
        self.assertEqual(self.ui.mapMessage.text, "")
        self.assertIsNotNone(self.parameters.map)
        self.ui.prepareUndoButton.click()
        self.assertIsNone(cavity.GetScene())
        self.assertIsNone(self.parameters.map)
        self.assertFalse(planes["LAA"].GetLocked())
        self.assertTrue(raw.GetDisplayNode().GetVisibility())
        for text in ("removed", ""):
            self.settle()
            self.ui.prepareUndoButton.click()
            self.assertIn(text, self.ui.prepareMessage.text)
        self.assertEqual(planesOf(raw), {})

    def test_the_map_follows_by_itself(self):
        self.suggest()
        self.parameters.liveUpdate = True
        self.ui.applyButton.click()
        self.waitFor(lambda: self.parameters.map is not None)
        self.assertEqual(self.ui.mapMessage.text, "")

    def test_progress_and_cancel(self):
        raw = self.choose(addClosed())
        seen = []

        def cancel():
            parent = self.panel.parent
            seen.append((self.ui.prepareCancelButton.isVisibleTo(parent), self.ui.suggestButton.enabled))
            self.ui.prepareCancelButton.click()

        qt.QTimer.singleShot(0, cancel)
        self.ui.suggestButton.click()
        self.assertEqual(seen, [(True, False)])
        self.assertIn("Cancelled", self.ui.prepareMessage.text)
        self.assertEqual(planesOf(raw), {})
        self.assertTrue(self.ui.suggestButton.enabled)

    def test_refusal_is_a_message(self):
        ball = self.choose(addSphere())
        self.ui.suggestButton.click()
        self.assertIn("vein", self.ui.prepareMessage.text)
        self.assertEqual(planesOf(ball), {})
        self.assertFalse(self.ui.applyButton.enabled)

    def test_a_fault_of_the_program_is_not_taken_for_bad_input(self):
        self.choose(addClosed())
        with (
            unittest.mock.patch.object(self.panel.logic, "suggestParameters", side_effect=RuntimeError("fault")),
            self.assertRaisesRegex(RuntimeError, "fault"),
        ):
            self.panel.prepare.suggest()
        self.assertEqual(self.ui.prepareMessage.text, "")
        self.assertTrue(self.ui.suggestButton.enabled)

    def test_scene_closed_during_a_computation(self):
        self.choose(addClosed())
        qt.QTimer.singleShot(0, slicer.mrmlScene.Clear)
        self.ui.suggestButton.click()
        self.settle()
        self.assertEqual(slicer.util.getNodesByClass("vtkMRMLMarkupsPlaneNode"), [])
        self.panel.enter()
        self.assertFalse(self.ui.suggestButton.enabled)

    def test_input_deleted(self):
        raw, _planes = self.suggest()
        slicer.mrmlScene.RemoveNode(raw)
        self.settle()
        self.assertEqual(self.ui.openingsTable.rowCount, 0)
        self.assertFalse(self.ui.suggestButton.enabled)


class TestInputs(PreparePanelCase):
    def test_models_segmentations_and_label_maps_are_offered(self):
        for kind in ("Model", "Segmentation", "LabelMapVolume"):
            node = slicer.mrmlScene.AddNewNodeByClass(f"vtkMRML{kind}Node", kind)
            self.ui.prepareInputSelector.setCurrentNode(node)
            self.assertIs(self.parameters.prepareInput, node)
        self.assertEqual(self.ui.prepareInputSelector.nodeCount(), 3)

    def test_segments_can_be_chosen(self):
        voxels = labelVoxels()[0] > 0
        node = self.choose(addSegmentation({"other": ~voxels, "left atrium": voxels}))
        self.assertTrue(self.ui.structureSelector.isVisibleTo(self.panel.parent))
        self.ui.suggestButton.click()
        self.assertIn("several segments", self.ui.prepareMessage.text)
        self.ui.structureSelector.currentIndex = 1
        self.panel.prepare.chooseStructure(1)
        self.assertEqual(self.parameters.prepareStructure, list(self.panel.logic.structures(node))[1])
        self.ui.byHandButton.click()
        self.assertEqual(len(planesOf(node)), 6, self.ui.prepareMessage.text)

    def test_a_closed_model_unfolds_the_section_and_is_proposed(self):
        raw = addClosed()
        self.parameters.surface = raw
        self.settle()
        self.assertFalse(self.ui.prepareSection.collapsed)
        self.assertIs(self.parameters.prepareInput, raw)

    def test_a_ready_atrium_folds_it(self):
        self.loadSample()
        self.assertTrue(self.ui.prepareSection.collapsed)
        self.assertIsNone(self.parameters.prepareInput)
        # And the user has the last word.
        self.ui.prepareSection.collapsed = False
        self.parameters.showLabels = False
        self.settle()
        self.assertFalse(self.ui.prepareSection.collapsed)


class TestScene(PreparePanelCase):
    def test_a_saved_scene_gives_the_same_panel(self):
        _raw, planes = self.suggest()
        self.move(planes["LAA"], 2.0 * planeOf(planes["LAA"]).normal)
        self.parameters.pvLength = 4.0
        before = self.cells("LAA")
        with tempfile.TemporaryDirectory() as folder:
            file = str(Path(folder) / "scene.mrb")
            self.assertTrue(slicer.util.saveScene(file))
            slicer.mrmlScene.Clear()
            slicer.util.loadScene(file)
        self.panel.enter()
        self.settle(0.5)
        self.assertEqual(self.ui.prepareInputSelector.currentNode().GetName(), "Raw")
        self.assertEqual(self.ui.pvLength.value, 4.0)
        self.assertEqual(self.cells("LAA"), before)
        self.ui.applyButton.click()
        self.assertEqual(self.parameters.seeds.GetNumberOfDefinedControlPoints(), 9, self.ui.prepareMessage.text)
