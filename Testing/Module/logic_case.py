"""What the tests of Logic and views share: an atrium with seeds as nodes, and a clock that the test moves on."""

import functools
import unittest

import numpy as np
import slicer
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

from LAFlattening import LAFlatteningLogic, LAFlatteningParameterNode
from LAFlatteningLib import make_phantom

POINTS = 1500


@functools.cache
def phantom():
    """The synthetic atrium of these tests; never changed."""
    return make_phantom(POINTS)


def toRas(points):
    """LPS to RAS."""
    return np.asarray(points) * (-1.0, -1.0, 1.0)


def addModel(points, triangles, name="Atrium"):
    """A model node of points (RAS, mm) and triangles."""
    polydata = vtk.vtkPolyData()
    vtkPoints = vtk.vtkPoints()
    vtkPoints.SetData(numpy_to_vtk(np.asarray(points, float), deep=True))
    polydata.SetPoints(vtkPoints)
    cells = vtk.vtkCellArray()
    for triangle in np.asarray(triangles).tolist():
        cells.InsertNextCell(3, triangle)
    polydata.SetPolys(cells)
    node = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLModelNode", name)
    node.SetAndObservePolyData(polydata)
    node.CreateDefaultDisplayNodes()
    return node


def addArray(node, name, values, onCells=False):
    """Put an array on a model."""
    array = numpy_to_vtk(np.asarray(values), deep=True)
    array.SetName(name)
    polydata = node.GetPolyData()
    (polydata.GetCellData() if onCells else polydata.GetPointData()).AddArray(array)
    polydata.Modified()


def addAtrium(name="Atrium"):
    """The phantom as a model node in RAS, with its LGE intensity, and the number of each point and triangle."""
    surface = phantom().surface
    node = addModel(toRas(surface.points), surface.triangles, name)
    addArray(node, "LGE", surface.point_data["LGE"])
    addArray(node, "number", np.arange(len(surface.points)))
    addArray(node, "true_region", surface.cell_data["true_region"], onCells=True)
    return node


def addSeeds(logic, without=()):
    """The phantom's seeds as a fiducial node."""
    node = logic.createSeedsNode("Seeds")
    for label, position in phantom().seeds.items():
        if label not in without:
            logic.placeSeed(node, label, toRas(position))
    return node


def addTransform(node, transform):
    """Put a node under a transform."""
    parent = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLTransformNode", "Transform")
    parent.SetAndObserveTransformToParent(transform)
    node.SetAndObserveTransformNodeID(parent.GetID())
    return parent


def points(node):
    """A copy of a model's points, (n, 3)."""
    return vtk_to_numpy(node.GetPolyData().GetPoints().GetData()).astype(float)


def triangles(node):
    """A model's triangles, (m, 3)."""
    return vtk_to_numpy(node.GetPolyData().GetPolys().GetConnectivityArray()).reshape(-1, 3)


def array(node, name, onCells=False):
    """A copy of a model's array."""
    polydata = node.GetPolyData()
    return vtk_to_numpy((polydata.GetCellData() if onCells else polydata.GetPointData()).GetArray(name)).copy()


def seedPosition(node, label):
    """Where a seed is, or None."""
    for k in range(node.GetNumberOfControlPoints()):
        if (
            node.GetNthControlPointLabel(k) == label
            and node.GetNthControlPointPositionStatus(k) == node.PositionDefined
        ):
            return np.array(node.GetNthControlPointPositionWorld(k))
    return None


def seedIndex(node, label):
    """The number of the control point of a seed."""
    return next(k for k in range(node.GetNumberOfControlPoints()) if node.GetNthControlPointLabel(k) == label)


def moveSeed(node, label, position):
    """Move a seed as a script does, outside of a drag."""
    node.SetNthControlPointPositionWorld(seedIndex(node, label), *[float(x) for x in position])


def sceneNodes():
    """The ids of all nodes in the scene."""
    scene = slicer.mrmlScene
    return {scene.GetNthNode(k).GetID() for k in range(scene.GetNumberOfNodes())}


class Clock:
    """A clock and a scheduler in one: time passes only when the test says so."""

    def __init__(self):
        self.now = 0.0
        self._due = []

    def __call__(self):
        return self.now

    def schedule(self, milliseconds, function):
        """Call a function when so much time has passed."""
        self._due.append((self.now + milliseconds / 1000.0, len(self._due), function))

    def pending(self):
        """How many calls are scheduled."""
        return len(self._due)

    def run(self, seconds=0.0):
        """Let time pass, and whatever is due by then happen in order."""
        end = self.now + seconds
        for _ in range(200):
            self._due.sort(key=lambda entry: entry[:2])
            if not self._due or self._due[0][0] > end:
                self.now = end
                return
            at, _, function = self._due.pop(0)
            self.now = max(self.now, at)
            function()
        raise AssertionError("it never comes to rest")


class LogicCase(unittest.TestCase):
    """An empty scene and a Logic."""

    def setUp(self):
        slicer.mrmlScene.Clear(0)
        self.logic = LAFlatteningLogic()
        self.addCleanup(self.logic.stopLiveUpdate)
        self.addCleanup(self.logic.unlinkViews)

    def parameters(self, surface=None, seeds=None):
        """A parameter node that names these nodes."""
        parameters = LAFlatteningParameterNode(self.logic.getParameterNode())
        parameters.surface, parameters.seeds = surface, seeds
        return parameters
