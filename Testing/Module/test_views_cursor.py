"""The linked cursor and clicks, drawn off screen."""

import numpy as np
import slicer
import vtk
from LAFlatteningScene.cursor import Correspondence
from logic_case import addArray, array, points, triangles
from view_case import MARKER, ViewCase, like, middle, onScreen, picture


class CursorTest(ViewCase):
    """Pointing at one marks the same place on the other."""

    def placeIn(self, triangle, weights=(0.2, 0.3, 0.5)):
        """A place by barycentric weights in a triangle: on the atrium, on the map, and the points' numbers."""
        ids = triangles(self.p.map)[triangle]
        return np.array(weights) @ points(self.surface)[ids], np.array(weights) @ points(self.p.map)[ids], ids

    def frontTriangle(self):
        """A triangle that faces the camera of `lookAtTheAtrium`."""
        centre = points(self.surface).mean(axis=0)
        middles = points(self.surface)[triangles(self.p.map)].mean(axis=1)
        return int(((middles - centre) @ np.array([0.05, 1.0, 0.2])).argmax())

    def test_atriumToMap(self):
        atrium, flat, _ = self.placeIn(self.frontTriangle())
        self.assertFalse(like(picture(self.right), MARKER).any())
        self.pointAt(atrium)
        marked = like(picture(self.right), MARKER)
        np.testing.assert_allclose(middle(marked), onScreen(self.right, flat), atol=2)

    def test_mapToAtrium(self):
        self.lookAtTheAtrium()
        atrium, flat, _ = self.placeIn(self.frontTriangle())
        self.assertFalse(like(picture(self.left), MARKER, 90).any())
        self.pointAt(flat)
        pixels = picture(self.left)
        # The marker is lit, so its colour varies: more red than the green atrium and the blue background.
        marked = (pixels[..., 0] > pixels[..., 1] + 60) & (pixels[..., 0] > pixels[..., 2] + 20)
        np.testing.assert_allclose(middle(marked), onScreen(self.left, atrium), atol=3)

    def test_underATransform(self):
        node = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLTransformNode")
        matrix = np.eye(4)
        matrix[:3, 3] = (300.0, 0.0, 0.0)
        node.SetMatrixTransformToParent(slicer.util.vtkMatrixFromArray(matrix))
        self.surface.SetAndObserveTransformNodeID(node.GetID())
        atrium, flat, _ = self.placeIn(self.frontTriangle())
        self.pointAt(atrium + np.array((300.0, 0.0, 0.0)))
        np.testing.assert_allclose(middle(like(picture(self.right), MARKER)), onScreen(self.right, flat), atol=2)

    def test_nothingUnderTheCursor(self):
        self.pointAt(self.placeIn(10)[0])
        self.assertTrue(like(picture(self.right), MARKER).any())
        self.pointAt((400.0, 400.0, 400.0))
        self.assertFalse(like(picture(self.right), MARKER).any())
        self.assertEqual(self.read[-1], "")

    def test_readout(self):
        triangle = self.frontTriangle()
        values = np.zeros(len(points(self.surface)))
        atrium, _, ids = self.placeIn(triangle)
        values[ids] = (10.0, 20.0, 40.0)
        addArray(self.surface, "LGE", values)
        display = self.surface.GetDisplayNode()
        display.SetActiveScalar("LGE", vtk.vtkAssignAttribute.POINT_DATA)
        display.SetScalarVisibility(True)
        self.pointAt(atrium)
        # 0.2 * 10 + 0.3 * 20 + 0.5 * 40
        self.assertIn("LGE (a.u.): 28", self.read[-1])
        region = array(self.p.map, "region", True)[triangle]
        self.assertTrue(self.read[-1].startswith(f"R{region} "), self.read[-1])
        self.assertTrue(self.read[-1].endswith("mm"), self.read[-1])
        self.assertIn(f"{abs(atrium[0]):.1f}", self.read[-1])

    def test_wholeNumbersAreNotMixed(self):
        atrium, _, ids = self.placeIn(self.frontTriangle())
        display = self.surface.GetDisplayNode()
        display.SetActiveScalar("number", vtk.vtkAssignAttribute.POINT_DATA)
        display.SetScalarVisibility(True)
        self.pointAt(atrium)
        self.assertIn(f": {ids[2]}", self.read[-1], "the corner of the largest weight")

    def test_switchedOff(self):
        self.p.linkCursor = False
        self.pointAt(self.placeIn(10)[0])
        self.assertFalse(like(picture(self.right), MARKER).any())
        self.assertEqual(self.read, [])

    def test_markersAreNotSaved(self):
        self.pointAt(self.placeIn(10)[0])
        markers = [
            node for node in slicer.util.getNodesByClass("vtkMRMLModelNode") if node.GetName().startswith("Cursor")
        ]
        self.assertEqual(len(markers), 2)
        for node in markers:
            self.assertFalse(node.GetSaveWithScene() or node.GetDisplayNode().GetSaveWithScene())
            self.assertTrue(node.GetHideFromEditors())

    def test_theMapFollowsTheMouse(self):
        """With real mouse events: the view reports what is under the mouse."""
        self.lookAtTheAtrium()
        atrium, flat, _ = self.placeIn(self.frontTriangle())
        self.left.forceRender()
        at = onScreen(self.left, atrium)
        self.mouse(self.left, "EnterEvent", at)
        self.mouse(self.left, "MouseMoveEvent", at)
        marked = like(picture(self.right), MARKER)
        self.assertTrue(marked.any())
        # One pixel of the left view is about half a mm on the atrium, and more on an enlarged part of the map.
        np.testing.assert_allclose(middle(marked), onScreen(self.right, flat), atol=8)

    def test_clickTurnsTheAtrium(self):
        camera = self.lookAtTheAtrium((0.0, -1.0, 0.0))
        triangle = self.frontTriangle()
        atrium, flat, ids = self.placeIn(triangle)
        self.right.forceRender()
        at = onScreen(self.right, flat)
        for event in ("MouseMoveEvent", "LeftButtonPressEvent", "LeftButtonReleaseEvent"):
            self.mouse(self.right, event, at)
        np.testing.assert_allclose(camera.GetFocalPoint(), atrium, atol=1.5)
        a, b, c = points(self.surface)[ids]
        outward = np.cross(b - a, c - a) / np.linalg.norm(np.cross(b - a, c - a))
        sight = np.array(camera.GetPosition()) - camera.GetFocalPoint()
        self.assertAlmostEqual(np.linalg.norm(sight), 250.0, delta=1.0)
        self.assertGreater(outward @ sight / np.linalg.norm(sight), 0.9)
        column, row = onScreen(self.left, atrium)
        height, width, _ = picture(self.left).shape
        np.testing.assert_allclose((column, row), (0.5 * width, 0.5 * height), atol=6)

    def test_draggingTheMapDoesNotTurnTheAtrium(self):
        camera = self.lookAtTheAtrium((0.0, -1.0, 0.0))
        before = camera.GetPosition()
        start = onScreen(self.right, (5.0, 5.0, 0.0))
        self.drag(self.right, start, start + np.array((40, 25)))
        self.assertEqual(camera.GetPosition(), before)

    def test_whereAtriumAndMapMeetTheCursorStaysOnItsModel(self):
        cursor = self.logic._linked.cursor
        atrium, flat, _ = self.placeIn(self.frontTriangle())
        shift = flat - atrium
        node = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLTransformNode")
        matrix = np.eye(4)
        matrix[:3, 3] = shift
        node.SetMatrixTransformToParent(slicer.util.vtkMatrixFromArray(matrix))
        self.surface.SetAndObserveTransformNodeID(node.GetID())
        onlyMap, onlyAtrium = self.placeIn(0)[1], self.placeIn(0)[0] + shift
        for place, model in ((onlyMap, "map"), (onlyAtrium, "atrium")):
            self.assertEqual(cursor.locate(place)[0], model)
            self.assertEqual(cursor.locate(flat)[0], model)

    def test_modelsThatChange(self):
        """The map while a seed is dragged, then the atrium under a transform that moves."""
        linked = Correspondence(self.surface, self.p.map)
        atrium, flat, ids = self.placeIn(self.frontTriangle())
        np.testing.assert_allclose(linked.find("atrium", atrium)[1].map, flat, atol=1e-3)
        slicer.util.arrayFromModelPoints(self.p.map)[:] *= 0.5
        slicer.util.arrayFromModelPointsModified(self.p.map)
        np.testing.assert_allclose(linked.find("atrium", atrium)[1].map, 0.5 * flat, atol=1e-3)
        np.testing.assert_allclose(linked.find("map", 0.5 * flat)[1].atrium, atrium, atol=1e-3)
        node = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLTransformNode")
        self.surface.SetAndObserveTransformNodeID(node.GetID())
        for shift in (np.array((300.0, 0.0, 0.0)), np.array((0.0, -500.0, 0.0))):
            matrix = np.eye(4)
            matrix[:3, 3] = shift
            node.SetMatrixTransformToParent(slicer.util.vtkMatrixFromArray(matrix))
            distance, place = linked.find("atrium", atrium + shift)
            self.assertLess(distance, 1e-3)
            np.testing.assert_allclose(place.map, 0.5 * flat, atol=1e-3)
        # A map of the same points without that triangle.
        cells = vtk.vtkCellArray()
        for corners in triangles(self.p.map).tolist():
            if set(corners) != set(ids.tolist()):
                cells.InsertNextCell(3, corners)
        self.p.map.GetPolyData().SetPolys(cells)
        for on, at in (("atrium", atrium + shift), ("map", 0.5 * flat)):
            found = linked.find(on, at)[1]
            self.assertNotEqual(set(found.ids.tolist()), set(ids.tolist()))
            self.assertEqual(len(set(found.ids.tolist()) & set(ids.tolist())), 2, "a neighbour of the triangle")
