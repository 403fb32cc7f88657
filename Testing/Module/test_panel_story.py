"""The panel as a user goes through it, by its real buttons."""

import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np
import qt
import slicer
from panel_case import PanelCase


class TestInput(PanelCase):
    def test_empty_scene_says_what_to_do(self):
        self.assertIn("Choose the surface", self.ui.inputMessage.text)
        self.assertFalse(self.ui.flattenButton.enabled)
        self.assertIn("atrium", self.ui.flattenButton.toolTip)
        self.assertFalse(self.ui.placeButton.enabled)
        self.assertFalse(self.ui.exportButton.enabled)
        self.assertFalse(self.ui.histogramButton.enabled)
        self.assertIn("no map", self.ui.notesText.text)

    def test_sample_button_fills_the_panel(self):
        self.ui.sampleButton.click()
        self.assertEqual(self.ui.surfaceSelector.currentNode(), self.parameters.surface)
        self.assertEqual(self.ui.seedsSelector.currentNode(), self.parameters.seeds)
        self.assertEqual(self.ui.inputMessage.text, "")
        self.assertTrue(self.ui.flattenButton.enabled, self.ui.flattenButton.toolTip)

    def test_the_only_model_is_chosen(self):
        surfaceNode, _ = self.panel.logic.loadSample(points=self.POINTS)
        self.panel.enter()
        self.assertEqual(self.parameters.surface, surfaceNode)

    def test_of_two_models_none_is_chosen(self):
        for name in ("a", "b"):
            slicer.mrmlScene.AddNewNodeByClass("vtkMRMLModelNode", name)
        self.panel.enter()
        self.assertIsNone(self.parameters.surface)

    def test_every_control_explains_itself(self):
        kinds = (qt.QPushButton, qt.QCheckBox, qt.QComboBox, qt.QTableWidget, slicer.qMRMLNodeComboBox)
        controls = [widget for widget in vars(self.ui).values() if isinstance(widget, kinds)]
        self.assertGreater(len(controls), 20)
        for widget in controls:
            self.assertTrue(widget.toolTip.strip(), widget.name)


class TestSeeds(PanelCase):
    def place(self, label: str) -> None:
        """A click at the place of a seed, without the mouse."""
        self.panel.logic.placeSeed(self.parameters.seeds, label, tuple(self.truth[label]), self.parameters.surface)
        self.settle(0.2)

    def setUp(self):
        super().setUp()
        surfaceNode, sampleSeeds = self.panel.logic.loadSample(points=self.POINTS)
        self.truth = {
            sampleSeeds.GetNthControlPointLabel(k): np.array(sampleSeeds.GetNthControlPointPositionWorld(k))
            for k in range(sampleSeeds.GetNumberOfControlPoints())
        }
        slicer.mrmlScene.RemoveNode(sampleSeeds)
        self.parameters.surface = surfaceNode

    def test_placing_makes_the_seeds_and_guides_through_them(self):
        self.ui.placeButton.click()
        self.assertIsNotNone(self.parameters.seeds)
        self.assertTrue(self.ui.placeButton.checked)
        shown = []
        for label in self.panel.logic.seedLabels():
            self.assertIn(label, self.ui.nextSeedText.text)
            self.assertEqual(self.stateOf(label), "next")
            shown.append(self.ui.seedDiagram.pixmap.toImage())
            self.place(label)
            self.assertEqual(self.stateOf(label), "placed")
        # A diagram for each seed.
        for k, one in enumerate(shown):
            self.assertFalse(one.isNull())
            self.assertFalse(any(one == other for other in shown[k + 1 :]))
        self.assertIn("All seeds", self.ui.nextSeedText.text)
        self.assertFalse(self.ui.placeButton.checked)
        self.assertTrue(self.ui.flattenButton.enabled, self.ui.flattenButton.toolTip)

    def test_pressing_again_stops_placing(self):
        self.ui.placeButton.click()
        interaction = slicer.app.applicationLogic().GetInteractionNode()
        self.assertEqual(interaction.GetCurrentInteractionMode(), interaction.Place)
        self.ui.placeButton.click()
        self.assertEqual(interaction.GetCurrentInteractionMode(), interaction.ViewTransform)
        self.assertFalse(self.ui.placeButton.checked)

    def test_leaving_the_mode_for_placing_is_seen_by_the_button(self):
        self.ui.placeButton.click()
        slicer.app.applicationLogic().GetInteractionNode().SwitchToViewTransformMode()
        self.assertFalse(self.ui.placeButton.checked)

    def test_another_seed_can_be_chosen_to_be_placed_next(self):
        self.ui.placeButton.click()
        row = self.rowOf("LAA")
        self.ui.seedsTable.selectRow(row)
        self.panel.seeds.choose(row)
        self.assertIn("LAA", self.ui.nextSeedText.text)

    def test_remove_undo_redo(self):
        self.ui.placeButton.click()
        for label in ("RSPV", "RIPV"):
            self.place(label)
        self.ui.placeButton.click()
        self.panel.seeds.choose(self.rowOf("RIPV"))
        self.assertTrue(self.ui.removeButton.enabled)
        self.ui.removeButton.click()
        self.settle(0.2)
        self.assertEqual(self.stateOf("RIPV"), "next")
        self.assertEqual(self.stateOf("RSPV"), "placed")
        self.ui.undoButton.click()
        self.settle(0.2)
        self.assertEqual(self.stateOf("RIPV"), "placed")
        self.ui.redoButton.click()
        self.settle(0.2)
        self.assertEqual(self.stateOf("RIPV"), "next")

    def test_a_seed_out_of_place_is_marked_with_its_reason(self):
        self.ui.placeButton.click()
        for label in self.panel.logic.seedLabels():
            self.place(label)
        self.parameters.snapSeeds = False
        self.moveSeed(self.parameters.seeds, "RSPV", (0.0, 0.0, 60.0))
        self.waitFor(lambda: self.stateOf("RSPV") == "check")
        self.assertIn("RSPV", self.ui.seedsMessage.text)
        self.assertIn("mm", self.ui.seedsTable.item(self.rowOf("RSPV"), 0).toolTip())
        self.moveSeed(self.parameters.seeds, "RSPV", (0.0, 0.0, -60.0))
        self.waitFor(lambda: self.stateOf("RSPV") == "placed")
        self.assertEqual(self.ui.seedsMessage.text, "")

    def test_swapped_seeds_are_named(self):
        self.ui.placeButton.click()
        for label in self.panel.logic.seedLabels():
            self.place(label)
        for label, other in (("RSPV", "RIPV"), ("RIPV", "RSPV")):
            self.panel.logic.placeSeed(self.parameters.seeds, label, tuple(self.truth[other]))
        self.waitFor(lambda: self.stateOf("RSPV") == self.stateOf("RIPV") == "check")
        self.assertIn("each other's labels", self.ui.seedsMessage.text)


class TestMap(PanelCase):
    def test_flatten_makes_map_tables_and_views(self):
        surfaceNode, _, mapNode = self.makeMap()
        self.assertEqual(self.ui.mapMessage.text, "")
        self.assertEqual(self.ui.mapSelector.currentNode(), mapNode)
        self.assertIn(surfaceNode.GetName(), mapNode.GetName())
        self.assertGreater(self.ui.metricsTable.rowCount, 5)
        self.assertEqual(self.ui.metricsTable.columnCount, 3)
        self.assertEqual(self.ui.regionTable.rowCount, 5)
        self.assertFalse(self.ui.cancelButton.isVisibleTo(self.panel.parent))
        self.assertTrue(self.ui.histogramButton.enabled)

    def test_disk_diameter_is_the_one_of_the_slider(self):
        self.loadSample()
        self.ui.diskDiameterSlider.value = 60.0
        self.assertEqual(self.parameters.diskDiameter, 60.0)
        self.ui.flattenButton.click()
        points = slicer.util.arrayFromModelPoints(self.parameters.map)
        self.assertAlmostEqual(float(np.hypot(*points[:, :2].T).max()), 30.0, places=3)

    def test_template_and_method_of_the_panel_are_used(self):
        self.loadSample()
        self.ui.templateSelector.setCurrentText("adapted2")
        self.ui.methodSelector.setCurrentText("paper")
        self.assertEqual((self.parameters.template, self.parameters.method), ("adapted2", "paper"))
        self.ui.flattenButton.click()
        said = {
            self.ui.metricsTable.item(row, 0).text(): self.ui.metricsTable.item(row, 1).text()
            for row in range(self.ui.metricsTable.rowCount)
        }
        self.assertEqual((said["template"], said["method"]), ("adapted2", "paper"))

    def test_cancel_keeps_the_former_map(self):
        _, _, mapNode = self.makeMap()
        self.ui.templateSelector.setCurrentText("population")
        self.settle()
        before = slicer.util.arrayFromModelPoints(mapNode).copy()
        qt.QTimer.singleShot(0, self.ui.cancelButton.click)
        self.ui.flattenButton.click()
        self.assertIn("Cancelled", self.ui.mapMessage.text)
        np.testing.assert_array_equal(slicer.util.arrayFromModelPoints(mapNode), before)
        self.assertTrue(self.ui.flattenButton.enabled)
        # And it can be made after all.
        self.ui.flattenButton.click()
        self.assertEqual(self.ui.mapMessage.text, "")

    def test_progress_and_cancel_are_shown_while_computing(self):
        self.loadSample()
        seen = []

        def look():
            parent = self.panel.parent
            seen.append((self.ui.cancelButton.isVisibleTo(parent), self.ui.flattenButton.enabled))

        qt.QTimer.singleShot(0, look)
        self.ui.flattenButton.click()
        self.assertEqual(seen, [(True, False)])
        self.assertEqual(self.ui.progressBar.value, 100)

    def test_map_follows_a_moved_seed(self):
        _, seedsNode, mapNode = self.makeMap(follow=True)
        before = slicer.util.arrayFromModelPoints(mapNode).copy()
        self.moveSeed(seedsNode, "RSPV", (0.0, 3.0, 0.0))
        self.waitFor(lambda: not np.array_equal(slicer.util.arrayFromModelPoints(mapNode), before))
        self.assertIs(self.parameters.map, mapNode)

    def test_map_appears_by_itself_when_all_seeds_are_placed(self):
        self.loadSample(follow=True)
        self.waitFor(lambda: self.parameters.map is not None)
        self.assertEqual(self.ui.mapMessage.text, "")

    def test_live_update_can_be_switched_off(self):
        _, seedsNode, mapNode = self.makeMap(follow=True)
        self.ui.liveUpdate.click()
        self.assertFalse(self.parameters.liveUpdate)
        before = slicer.util.arrayFromModelPoints(mapNode).copy()
        self.moveSeed(seedsNode, "RSPV", (0.0, 3.0, 0.0))
        self.settle(1.0)
        np.testing.assert_array_equal(slicer.util.arrayFromModelPoints(mapNode), before)
        self.assertIn("Flatten", self.ui.mapMessage.text)


class TestColours(PanelCase):
    def test_selector_shows_and_changes_what_both_are_coloured_by(self):
        surfaceNode, _, mapNode = self.makeMap()
        selector = self.ui.colourSelector
        self.assertEqual(selector.currentText, "LGE (a.u.)")
        rows = [selector.itemText(row) for row in range(selector.count)]
        self.assertIn("regions", rows)
        selector.currentIndex = rows.index("regions")
        self.panel.map.colour(selector.currentIndex)
        for node in (surfaceNode, mapNode):
            self.assertEqual(node.GetDisplayNode().GetActiveScalarName(), "region")

    def test_selector_follows_the_models(self):
        surfaceNode, _, mapNode = self.makeMap()
        mapNode.GetDisplayNode().SetScalarVisibility(False)
        self.assertEqual(self.ui.colourSelector.currentText, "one colour")
        self.panel.logic.colourBy(surfaceNode, "LGE")
        self.assertEqual(self.ui.colourSelector.currentText, "LGE (a.u.)")
        self.parameters.surface = None
        self.assertFalse(self.ui.colourSelector.enabled)


class TestExport(PanelCase):
    def test_files_are_written_and_named(self):
        self.makeMap()
        # No folder of anyone's is saved with the scene before one is chosen.
        self.assertEqual(str(self.panel.parameterNode.exportDirectory), ".")
        with tempfile.TemporaryDirectory() as folder:
            self.ui.exportDirectory.currentPath = folder
            self.assertTrue(self.ui.exportButton.enabled)
            self.ui.exportButton.click()
            kinds = sorted(path.suffix for path in Path(folder).iterdir())
            self.assertIn(folder, self.ui.exportMessage.text)
        self.assertEqual(kinds, [".csv", ".csv", ".png", ".vtp"])

    def test_a_folder_that_is_gone_is_a_message(self):
        self.makeMap()
        with tempfile.TemporaryDirectory() as folder:
            self.ui.exportDirectory.currentPath = folder
        self.ui.exportButton.click()
        self.assertIn(Path(folder).name, self.ui.exportMessage.text)


class TestScene(PanelCase):
    def test_a_saved_scene_gives_the_same_panel(self):
        surfaceNode, seedsNode, mapNode = self.makeMap()
        self.ui.diskDiameterSlider.value = 80.0
        self.ui.showLabels.click()
        self.settle()
        self.ui.flattenButton.click()
        names = [node.GetName() for node in (surfaceNode, seedsNode, mapNode)]
        points = slicer.util.arrayFromModelPoints(mapNode).copy()
        with tempfile.TemporaryDirectory() as folder:
            file = str(Path(folder) / "scene.mrb")
            self.assertTrue(slicer.util.saveScene(file))
            slicer.mrmlScene.Clear()
            slicer.util.loadScene(file)
        self.panel.enter()
        chosen = (self.ui.surfaceSelector, self.ui.seedsSelector, self.ui.mapSelector)
        self.assertEqual([selector.currentNode().GetName() for selector in chosen], names)
        self.assertEqual(self.ui.diskDiameterSlider.value, 80.0)
        self.assertFalse(self.ui.showLabels.checked)
        self.assertFalse(self.ui.liveUpdate.checked)
        np.testing.assert_allclose(slicer.util.arrayFromModelPoints(self.parameters.map), points, atol=1e-4)
        self.assertGreater(self.ui.metricsTable.rowCount, 5)
        self.assertTrue(self.ui.flattenButton.enabled)


class TestReload(unittest.TestCase):
    def test_library_and_module_come_anew_from_their_files(self):
        slicer.mrmlScene.Clear()
        # Other tests in this process have imported the modules as they are: two of each class would be told apart.
        packages = ("LAFlatteningLib", "LAFlatteningScene", "LAFlatteningWidgets")
        former = {name: module for name, module in sys.modules.items() if name.partition(".")[0] in packages}
        self.addCleanup(sys.modules.update, former)
        panel = slicer.util.getModuleWidget("LAFlattening")
        before = type(panel.logic), panel.map.__class__
        panel.onReload()
        after = slicer.util.getModuleWidget("LAFlattening")
        self.assertIsNot(after, panel)
        self.assertIsNot(type(after.logic), before[0])
        self.assertIsNot(type(after.map), before[1])
        after.enter()
        after.ui.sampleButton.click()
        self.assertTrue(after.ui.flattenButton.enabled)
        slicer.mrmlScene.Clear()
