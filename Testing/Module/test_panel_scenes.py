"""Scenes that are saved, opened and added while the panel is at work."""

import tempfile
from pathlib import Path

import numpy as np
import slicer
from panel_case import PanelCase


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
