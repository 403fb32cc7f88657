"""What users do that cannot work: a message in the panel, no traceback, nothing lost."""

import unittest.mock

import numpy as np
import qt
import slicer
import vtk
from panel_case import PanelCase


class TestBadInput(PanelCase):
    def scalePoints(self, node, factor: float) -> None:
        points = slicer.util.arrayFromModelPoints(node)
        points *= factor
        slicer.util.arrayFromModelPointsModified(node)

    def test_surface_deleted_while_a_seed_is_dragged(self):
        surfaceNode, seedsNode, mapNode = self.makeMap(follow=True)
        before = slicer.util.arrayFromModelPoints(mapNode).copy()
        seedsNode.InvokeEvent(seedsNode.PointStartInteractionEvent)
        self.moveSeed(seedsNode, "RSPV", (0.0, 1.0, 0.0))
        slicer.mrmlScene.RemoveNode(surfaceNode)
        self.moveSeed(seedsNode, "RSPV", (0.0, 1.0, 0.0))
        seedsNode.InvokeEvent(seedsNode.PointEndInteractionEvent)
        self.settle()
        self.assertIsNone(self.parameters.surface)
        self.assertIn("Choose the surface", self.ui.inputMessage.text)
        self.assertFalse(self.ui.flattenButton.enabled)
        self.assertEqual(seedsNode.GetNumberOfDefinedControlPoints(), 9)
        self.assertEqual(slicer.util.arrayFromModelPoints(mapNode).shape, before.shape)

    def test_seeds_node_deleted(self):
        _, seedsNode, mapNode = self.makeMap(follow=True)
        before = slicer.util.arrayFromModelPoints(mapNode).copy()
        slicer.mrmlScene.RemoveNode(seedsNode)
        self.settle()
        self.assertIsNone(self.parameters.seeds)
        self.assertFalse(self.ui.flattenButton.enabled)
        self.assertIn("seeds", self.ui.flattenButton.toolTip)
        self.assertEqual(self.stateOf("RSPV"), "next")
        np.testing.assert_array_equal(slicer.util.arrayFromModelPoints(mapNode), before)
        # Placing begins anew.
        self.ui.placeButton.click()
        self.assertIsNotNone(self.parameters.seeds)

    def test_seeds_node_deleted_while_placing(self):
        self.loadSample()
        self.parameters.seeds = None
        self.ui.placeButton.click()
        slicer.mrmlScene.RemoveNode(self.parameters.seeds)
        self.settle()
        self.assertFalse(self.ui.placeButton.checked)

    def test_map_deleted(self):
        _, seedsNode, mapNode = self.makeMap(follow=True)
        slicer.mrmlScene.RemoveNode(mapNode)
        self.settle()
        self.assertIsNone(self.parameters.map)
        self.assertFalse(self.ui.exportButton.enabled)
        self.assertIn("Flatten", self.ui.mapMessage.text)
        self.moveSeed(seedsNode, "RSPV", (0.0, 1.0, 0.0))
        self.waitFor(lambda: self.parameters.map is not None)

    def test_the_atrium_chosen_as_the_map_is_not_written_over(self):
        surfaceNode, _ = self.loadSample()
        before = slicer.util.arrayFromModelPoints(surfaceNode).copy()
        self.parameters.map = surfaceNode
        self.ui.flattenButton.click()
        self.assertIn("is not a map", self.ui.mapMessage.text)
        self.parameters.liveUpdate = True
        self.settle()
        np.testing.assert_array_equal(slicer.util.arrayFromModelPoints(surfaceNode), before)
        self.assertIn("is not a map", self.ui.mapMessage.text)

    def test_another_atrium_does_not_take_the_map_of_the_first(self):
        surfaceNode, seedsNode, mapNode = self.makeMap(follow=True)
        before = slicer.util.arrayFromModelPoints(mapNode).copy()
        lge = slicer.util.arrayFromModelPointData(mapNode, "LGE").copy()
        other, otherSeeds = self.panel.logic.loadSample(points=2 * self.POINTS)
        slicer.util.arrayFromModelPointData(other, "LGE")[:] = -1.0
        self.parameters.surface = other
        self.assertIsNone(self.parameters.map)
        self.parameters.seeds = otherSeeds
        self.waitFor(lambda: self.parameters.map is not None)
        self.assertIsNot(self.parameters.map, mapNode)
        np.testing.assert_array_equal(slicer.util.arrayFromModelPoints(mapNode), before)
        np.testing.assert_array_equal(slicer.util.arrayFromModelPointData(mapNode, "LGE"), lge)
        # Back at the first atrium, its map and its seeds are there.
        self.parameters.surface = surfaceNode
        self.settle()
        self.assertIs(self.parameters.map, mapNode)
        self.assertIs(self.parameters.seeds, seedsNode)
        np.testing.assert_array_equal(slicer.util.arrayFromModelPoints(mapNode), before)

    def test_scene_closed_during_a_computation(self):
        self.loadSample()
        qt.QTimer.singleShot(0, slicer.mrmlScene.Clear)
        self.ui.flattenButton.click()
        self.settle()
        self.assertEqual(slicer.util.getNodesByClass("vtkMRMLModelNode"), [])
        self.panel.enter()
        self.assertIn("Choose the surface", self.ui.inputMessage.text)
        self.assertFalse(self.panel.map.work.isRunning)
        # The panel works as before.
        self.makeMap()

    def test_surface_deleted_during_a_computation(self):
        surfaceNode, seedsNode = self.loadSample()
        qt.QTimer.singleShot(0, lambda: slicer.mrmlScene.RemoveNode(surfaceNode))
        self.ui.flattenButton.click()
        self.settle()
        self.assertIsNone(self.parameters.map)
        self.assertIn("Choose the surface", self.ui.inputMessage.text)
        self.assertEqual(seedsNode.GetNumberOfDefinedControlPoints(), 9)

    def test_surface_replaced_by_one_of_other_topology(self):
        surfaceNode, seedsNode, mapNode = self.makeMap(follow=True)
        before = slicer.util.arrayFromModelPoints(mapNode).copy()
        ball = vtk.vtkSphereSource()
        ball.SetRadius(30.0)
        ball.Update()
        surfaceNode.SetAndObservePolyData(ball.GetOutput())
        self.waitFor(lambda: "opening" in self.ui.mapMessage.text)
        self.ui.flattenButton.click()
        self.assertIn("opening", self.ui.mapMessage.text)
        np.testing.assert_array_equal(slicer.util.arrayFromModelPoints(mapNode), before)
        self.assertEqual(seedsNode.GetNumberOfDefinedControlPoints(), 9)

    def test_surface_replaced_by_another_mesh_of_the_same_atrium(self):
        surfaceNode, _, mapNode = self.makeMap()
        finer, finerSeeds = self.panel.logic.loadSample(points=2 * self.POINTS)
        mesh = vtk.vtkPolyData()
        mesh.DeepCopy(finer.GetPolyData())
        for node in (finer, finerSeeds):
            slicer.mrmlScene.RemoveNode(node)
        surfaceNode.SetAndObservePolyData(mesh)
        self.settle(1.0)
        self.ui.flattenButton.click()
        self.assertEqual(self.ui.mapMessage.text, "")
        self.assertEqual(mapNode.GetPolyData().GetNumberOfPoints(), 2 * self.POINTS)

    def test_wrong_units(self):
        surfaceNode, seedsNode = self.loadSample()
        self.parameters.liveUpdate = False
        self.scalePoints(surfaceNode, 0.001)
        for index in range(9):
            position = np.array(seedsNode.GetNthControlPointPositionWorld(index)) * 0.001
            seedsNode.SetNthControlPointPositionWorld(index, *position)
        self.settle()
        self.ui.flattenButton.click()
        message = self.ui.mapMessage.text + self.ui.seedsMessage.text
        self.assertIn("metres", message)
        self.assertIsNone(self.parameters.map)

    def test_seeds_in_other_axes(self):
        _, seedsNode = self.loadSample()
        self.parameters.snapSeeds = False
        for index in range(9):
            x, y, z = seedsNode.GetNthControlPointPositionWorld(index)
            seedsNode.SetNthControlPointPositionWorld(index, -x, -y, z)
        self.settle()
        self.ui.flattenButton.click()
        self.assertTrue(self.ui.mapMessage.text + self.ui.seedsMessage.text)
        self.assertIsNone(self.parameters.map)

    def test_empty_surface(self):
        _, seedsNode = self.loadSample()
        empty = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLModelNode", "empty")
        self.parameters.surface = empty
        self.settle()
        self.ui.flattenButton.click()
        self.assertIn("empty", self.ui.mapMessage.text)
        self.assertEqual(seedsNode.GetNumberOfDefinedControlPoints(), 9)

    def test_a_fault_of_the_program_is_not_taken_for_bad_input(self):
        """What the library does not refuse must not end as a friendly message: Slicer shows it with its details."""
        self.loadSample()
        with (
            unittest.mock.patch.object(self.panel.logic, "flattenParameters", side_effect=RuntimeError("fault")),
            self.assertRaisesRegex(RuntimeError, "fault"),
        ):
            self.panel.map.flatten()
        self.assertEqual(self.ui.mapMessage.text, "")
        self.assertTrue(self.ui.flattenButton.enabled)
