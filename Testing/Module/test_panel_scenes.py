"""Scenes that are saved, opened and added while the panel is at work."""

import tempfile
from pathlib import Path
from typing import ClassVar

import numpy as np
import qt
import slicer
import vtk
from panel_case import PanelCase

from LAFlatteningLib import SurfaceError


class TestAddedScene(PanelCase):
    """A saved scene is added to the one that is open, as "Add Data" does."""

    def setUp(self):
        super().setUp()
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.file = str(Path(folder.name) / "saved.mrb")
        # The saved patient: moved, on another template, so that no map of his can be taken for one of the other's.
        surfaceNode, seedsNode = self.loadSample()
        self.shift(surfaceNode, seedsNode)
        self.parameters.template = "population"
        self.ui.flattenButton.click()
        mapNode = self.parameters.map
        for node, name in ((surfaceNode, "B atrium"), (seedsNode, "B seeds"), (mapNode, "B map")):
            node.SetName(name)
        self.parameters.liveUpdate = True
        self.settle()
        self.saved = slicer.util.arrayFromModelPoints(mapNode).copy()
        self.assertTrue(slicer.util.saveScene(self.file))
        slicer.mrmlScene.Clear()
        self.settle()
        self.panel.enter()

    def shift(self, surfaceNode, seedsNode):
        points = slicer.util.arrayFromModelPoints(surfaceNode)
        points += (5.0, 0.0, 3.0)
        slicer.util.arrayFromModelPointsModified(surfaceNode)
        for label in self.panel.logic.seedLabels():
            self.moveSeed(seedsNode, label, (5.0, 0.0, 3.0))

    def assertShown(self, *names):
        selectors = (self.ui.surfaceSelector, self.ui.seedsSelector, self.ui.mapSelector)
        self.assertEqual([node and node.GetName() for node in (s.currentNode() for s in selectors)], list(names))

    def assertSavedMapIsWhole(self):
        mapNode = slicer.util.getNode("B map")
        np.testing.assert_allclose(slicer.util.arrayFromModelPoints(mapNode), self.saved, atol=1e-4)
        for role, name in (("LAFlattening.surface", "B atrium"), ("LAFlattening.seeds", "B seeds")):
            self.assertEqual(mapNode.GetNodeReference(role).GetName(), name)

    def test_neither_map_is_lost_when_a_scene_is_added_to_another(self):
        nodes = self.makeMap(follow=True)
        for node, what in zip(nodes, ("atrium", "seeds", "map"), strict=True):
            node.SetName(f"A {what}")
        before = slicer.util.arrayFromModelPoints(nodes[2]).copy()
        slicer.util.loadScene(self.file)
        self.settle(1.0)
        self.assertShown("B atrium", "B seeds", "B map")
        self.assertEqual(self.parameters.template, "population")
        self.assertEqual(self.ui.mapMessage.text, "")
        self.assertSavedMapIsWhole()
        np.testing.assert_array_equal(slicer.util.arrayFromModelPoints(nodes[2]), before)
        self.assertIs(nodes[2].GetNodeReference("LAFlattening.seeds"), nodes[1])
        # Only the map that is chosen is shown; the other would lie about in the view of the atrium.
        self.assertFalse(nodes[2].GetDisplayVisibility())
        self.assertTrue(self.parameters.map.GetDisplayVisibility())
        # And it can be gone back to.
        self.parameters.surface = nodes[0]
        self.settle()
        self.assertShown("A atrium", "A seeds", "A map")
        self.assertTrue(nodes[2].GetDisplayVisibility())

    def test_the_panel_shows_a_scene_that_is_added_to_an_empty_one(self):
        self.assertShown(None, None, None)
        slicer.util.loadScene(self.file)
        self.waitFor(lambda: self.parameters is not None)
        self.assertShown("B atrium", "B seeds", "B map")
        self.settle(0.5)
        self.assertSavedMapIsWhole()

    def test_the_map_follows_its_own_seeds_afterwards(self):
        self.makeMap(follow=True)
        slicer.util.loadScene(self.file)
        self.settle(1.0)
        mapNode = slicer.util.getNode("B map")
        self.moveSeed(slicer.util.getNode("B seeds"), "RSPV", (0.0, 3.0, 0.0))
        self.waitFor(lambda: np.abs(slicer.util.arrayFromModelPoints(mapNode) - self.saved).max() > 0.01)

    def test_a_panel_that_was_never_connected_stays_so(self):
        self.panel.setParameterNode(None)
        slicer.util.loadScene(self.file)
        self.settle(0.5)
        self.assertIsNone(self.parameters)


class TestTables(PanelCase):
    def test_a_table_of_figures_without_rows_is_no_error(self):
        _, _, mapNode = self.makeMap()
        table = self.panel.logic.metricsTable(mapNode)
        self.assertIn("isotropy", self.ui.mapDistortion.text)
        table.SetLocked(False)
        while table.GetNumberOfRows():
            table.RemoveRow(0)
        self.parameters.showLabels = False
        self.settle()
        self.assertIn("not in the scene", self.ui.mapDistortion.text)


class TestEntering(PanelCase):
    """The user looks at another module and comes back."""

    def test_what_can_be_undone_stays(self):
        _, seedsNode, _ = self.makeMap(follow=True)
        self.moveSeed(seedsNode, "RSPV", (0.0, 3.0, 0.0))
        self.settle()
        self.ui.holeX.value += 1.0
        self.waitFor(lambda: self.parameters.template != "adapted1")
        buttons = (self.ui.undoButton, self.ui.undoTemplateButton)
        self.assertEqual([button.enabled for button in buttons], [True, True])
        before = self.parameters
        self.panel.exit()
        self.panel.enter()
        self.settle()
        self.assertIs(self.parameters, before)
        self.assertEqual([button.enabled for button in buttons], [True, True])
        self.ui.undoTemplateButton.click()
        self.assertEqual(self.parameters.template, "adapted1")

    def test_a_map_that_is_being_made_is_made(self):
        self.loadSample()
        qt.QTimer.singleShot(0, self.panel.enter)
        self.ui.flattenButton.click()
        self.assertEqual(self.ui.mapMessage.text, "")
        self.assertIsNotNone(self.parameters.map)

    def test_another_scene_is_another_start(self):
        self.makeMap()
        before = self.parameters
        slicer.mrmlScene.Clear()
        self.panel.enter()
        self.assertIsNot(self.parameters, before)
        self.assertIsNone(self.parameters.map)


class TestUnknownValues(PanelCase):
    """A scene of another version of the module."""

    VALUES: ClassVar = {
        "template": ("adapted3", "adapted1"),
        "rule": ("iir2", "iir"),
        "parcellation": ("aha17", "none"),
        "pvLength": ("300.0", 3.0),
        "preparePoints": ("-5", 0),
        "ownTemplate": ('{"schema": "laflattening-template/9"}', ""),
    }

    def test_the_defaults_are_used_and_it_is_said(self):
        node = self.panel.logic.getParameterNode()
        self.panel.setParameterNode(None)
        for name, (said, _) in self.VALUES.items():
            node.SetParameter(name, said)
        node.SetParameter("method", "paper")
        self.panel.enter()
        self.settle()
        for name, (said, used) in self.VALUES.items():
            self.assertEqual(getattr(self.parameters, name), used)
            self.assertIn(f'{name} "{said}'[:30], self.ui.inputMessage.text)
        # What is known stays.
        self.assertEqual(self.parameters.method, "paper")
        self.assertNotIn("method", self.ui.inputMessage.text)
        self.parameters.template = "population"
        self.assertNotIn("adapted3", self.ui.inputMessage.text)
        self.loadSample()
        self.ui.flattenButton.click()
        self.assertIsNotNone(self.parameters.map)

    def test_nothing_is_said_of_a_scene_that_is_all_known(self):
        self.makeMap()
        self.panel.setParameterNode(None)
        self.panel.enter()
        self.assertEqual(self.ui.inputMessage.text, "")


class TestDamagedNodes(PanelCase):
    """What a user can do in the modules Data, Models and Tables to nodes that the panel shows."""

    def test_a_copy_of_a_map_is_not_taken_for_one(self):
        surfaceNode, _, mapNode = self.makeMap(follow=True)
        hierarchy = slicer.vtkMRMLSubjectHierarchyNode.GetSubjectHierarchyNode(slicer.mrmlScene)
        clone = slicer.vtkSlicerSubjectHierarchyModuleLogic.CloneSubjectHierarchyItem
        copy = hierarchy.GetItemDataNode(clone(hierarchy, hierarchy.GetItemByDataNode(mapNode)))
        before = slicer.util.arrayFromModelPoints(copy).copy()
        self.parameters.map = copy
        self.parameters.template = "population"
        self.settle(0.5)
        for text in (self.ui.mapMessage.text, self.ui.notesText.text):
            self.assertIn("copy of a map", text)
            self.assertIn("Flatten", text)
        self.assertFalse(self.panel.logic.isCurrent(copy))
        # What somebody has kept is not made anew without being asked, by no edit either.
        self.ui.holeX.value += 1.0
        self.settle(0.5)
        np.testing.assert_array_equal(slicer.util.arrayFromModelPoints(copy), before)
        self.parameters.analysisArray, self.parameters.rule, self.parameters.ruleThresholds = "LGE", "value", "120"
        self.ui.measureButton.click()
        self.assertIn("copy of a map", self.ui.analyseMessage.text)
        with tempfile.TemporaryDirectory() as folder:
            self.ui.exportDirectory.currentPath = folder
            self.ui.exportButton.click()
            self.assertIn("copy of a map", self.ui.exportMessage.text)
            self.assertEqual(list(Path(folder).iterdir()), [])
        self.ui.flattenButton.click()
        self.assertEqual(self.ui.mapMessage.text, "")
        self.assertGreater(self.ui.metricsTable.rowCount, 5)
        self.assertIs(copy.GetNodeReference("LAFlattening.surface"), surfaceNode)
        self.assertTrue(self.panel.logic.isCurrent(copy))

    def test_a_map_whose_atrium_was_deleted_is_no_copy(self):
        surfaceNode, _, mapNode = self.makeMap()
        slicer.mrmlScene.RemoveNode(surfaceNode)
        self.settle()
        self.assertIs(self.parameters.map, mapNode)
        self.assertNotIn("copy", self.ui.notesText.text)
        with self.assertRaisesRegex(SurfaceError, "not in the scene"):
            self.panel.logic.findGaps(mapNode, "LGE", [120.0])

    def test_a_map_without_points_is_made_anew(self):
        _, _, mapNode = self.makeMap(follow=True)
        count = mapNode.GetPolyData().GetNumberOfPoints()
        mapNode.SetAndObservePolyData(vtk.vtkPolyData())
        self.parameters.liveUpdate = False
        self.settle()
        self.assertIn("Flatten", self.ui.mapMessage.text)
        self.parameters.liveUpdate = True
        self.waitFor(lambda: mapNode.GetPolyData().GetNumberOfPoints() == count)
        self.settle()
        self.assertEqual(self.ui.mapMessage.text, "")

    def test_nodes_without_display(self):
        surfaceNode, _, mapNode = self.makeMap()
        overlay = [mapNode.GetNodeReference(f"LAFlattening.{what}") for what in ("lines", "labels")]
        for node in (*overlay, surfaceNode.GetNodeReference("LAFlattening.openings"), surfaceNode, mapNode):
            slicer.mrmlScene.RemoveNode(node.GetDisplayNode())
            self.parameters.showOpenings = not self.parameters.showOpenings
            self.settle()
            self.assertEqual(self.escaped, [])
        for node in overlay:
            self.assertTrue(node.GetDisplayVisibility())
        with tempfile.TemporaryDirectory() as folder:
            self.ui.exportDirectory.currentPath = folder
            self.ui.exportButton.click()
            self.assertIn(folder, self.ui.exportMessage.text)
