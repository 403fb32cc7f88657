"""What the tests of the analyses share: an atrium with its map, an image of it, and a voltage."""

import functools

import numpy as np
import slicer
import vtk
from logic_case import LogicCase, addAtrium, addSeeds, phantom
from vtk.util.numpy_support import numpy_to_vtk

from LAFlatteningLib import Volume
from LAFlatteningLib.phantom import make_lge_volume


@functools.cache
def lgeVolume():
    """An image of the phantom, LPS; coarse, so that the tests are quick."""
    return Volume.from_image(make_lge_volume(phantom().shape, spacing=(1.0, 1.0, 1.5)))


def addVolume(volume=None, name="LGE image"):
    """A scalar volume node of a library volume (LPS)."""
    volume = volume or lgeVolume()
    image = vtk.vtkImageData()
    image.SetDimensions(*volume.values.shape[::-1])
    image.GetPointData().SetScalars(numpy_to_vtk(volume.values.reshape(-1), deep=True))
    toRas = np.eye(4)
    toRas[:3, :3] = np.array([-1.0, -1.0, 1.0])[:, None] * volume.direction * volume.spacing
    toRas[:3, 3] = volume.origin * (-1.0, -1.0, 1.0)
    node = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLScalarVolumeNode", name)
    node.SetIJKToRASMatrix(slicer.util.vtkMatrixFromArray(toRas))
    node.SetAndObserveImageData(image)
    node.CreateDefaultDisplayNodes()
    return node


def column(table, name):
    """A column of a table node as a list."""
    found = next(
        table.GetTable().GetColumn(k)
        for k in range(table.GetNumberOfColumns())
        if table.GetTable().GetColumnName(k).startswith(name)
    )
    return [found.GetValue(row) for row in range(found.GetNumberOfValues())]


class AnalysisCase(LogicCase):
    """An atrium with its seeds and its map."""

    def setUp(self):
        super().setUp()
        self.addCleanup(self.logic.stopLiveProjection)
        self.surface, self.seeds = addAtrium(), addSeeds(self.logic)
        self.map = self.logic.flatten(self.surface, self.seeds)
