"""The synthetic atrium of the library as sample data: no download, known answers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import SimpleITK as sitk
import slicer
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

from LAFlatteningLib import LEFT_ATRIUM, make_phantom
from LAFlatteningLib.phantom import make_lge_volume

from .colouring import rampColours
from .map_nodes import groupNodes
from .seed_nodes import createSeedsNode, setPositions

SAMPLE_NAME = "Left atrium with LGE (synthetic)"
SHOWN_ARRAY = "LGE"
COLOURS_NAME = "LGE intensity"
COLOURS = (
    (0.05, 0.03, 0.53), (0.29, 0.01, 0.63), (0.49, 0.01, 0.66), (0.66, 0.14, 0.59), (0.80, 0.28, 0.47),
    (0.90, 0.42, 0.36), (0.97, 0.58, 0.25), (0.99, 0.76, 0.15), (0.94, 0.98, 0.13),
)  # fmt: skip
"""From low to high intensity, evenly brighter, so that equal steps look equal (the colour map "plasma")."""
LPS_TO_RAS = np.diag([-1.0, -1.0, 1.0])


def loadSample(points: int = 20000) -> tuple[slicer.vtkMRMLNode, ...]:
    """Add the atrium, coloured by its LGE intensity, its nine seeds, and the LGE image that it was measured on.

    Returns
    -------
    surface, seeds, volume : the nodes added.
    """
    phantom = make_phantom(points)
    scene = slicer.mrmlScene
    polydata = vtk.vtkPolyData()
    polydata.DeepCopy(phantom.surface.to_polydata())
    vtk_to_numpy(polydata.GetPoints().GetData())[:] = phantom.surface.points @ LPS_TO_RAS
    surface = scene.AddNewNodeByClass("vtkMRMLModelNode", scene.GenerateUniqueName("Left atrium"))
    surface.SetAndObservePolyData(polydata)
    surface.CreateDefaultDisplayNodes()
    display = surface.GetDisplayNode()
    display.SetBackfaceCulling(False)
    display.SetActiveScalar(SHOWN_ARRAY, vtk.vtkAssignAttribute.POINT_DATA)
    display.SetAndObserveColorNodeID(rampColours(scene, COLOURS_NAME, COLOURS).GetID())
    display.SetScalarRangeFlag(display.UseManualScalarRange)
    display.SetScalarRange(*np.percentile(phantom.surface.point_data[SHOWN_ARRAY], [1, 99]).round(1))
    display.SetScalarVisibility(True)
    seeds = createSeedsNode(scene, "Left atrium seeds", LEFT_ATRIUM)
    setPositions(seeds, {label: LPS_TO_RAS @ place for label, place in phantom.seeds.items()}, LEFT_ATRIUM)
    volume = _volume(make_lge_volume(phantom.shape))
    groupNodes(surface, [seeds])
    return surface, seeds, volume


def _volume(image: sitk.Image) -> slicer.vtkMRMLScalarVolumeNode:
    """A volume node of a SimpleITK image (LPS), with its own copy of the voxels."""
    values = sitk.GetArrayFromImage(image)
    data = vtk.vtkImageData()
    data.SetDimensions(*image.GetSize())
    voxels = numpy_to_vtk(values.reshape(-1), deep=True)
    voxels.SetName("LGE")
    data.GetPointData().SetScalars(voxels)
    toRas = np.eye(4)
    toRas[:3, :3] = LPS_TO_RAS @ np.reshape(image.GetDirection(), (3, 3)) @ np.diag(image.GetSpacing())
    toRas[:3, 3] = LPS_TO_RAS @ image.GetOrigin()
    matrix = vtk.vtkMatrix4x4()
    for row in range(4):
        for column in range(4):
            matrix.SetElement(row, column, toRas[row, column])
    scene = slicer.mrmlScene
    volume = scene.AddNewNodeByClass("vtkMRMLScalarVolumeNode", scene.GenerateUniqueName("Left atrium LGE"))
    volume.SetIJKToRASMatrix(matrix)
    volume.SetAndObserveImageData(data)
    volume.CreateDefaultDisplayNodes()
    return volume


def registerSampleData() -> None:
    """Offer the synthetic atrium in the module Sample Data; it is made on the spot, nothing is downloaded."""
    import SampleData

    SampleData.SampleDataLogic.registerCustomSampleDataSource(
        category="Cardiac",
        sampleName=SAMPLE_NAME,
        # Slicer counts a sample's files by these, also where there are none.
        uris="",
        fileNames="",
        nodeNames="Left atrium",
        customDownloader=makeSampleData,
        thumbnailFileName=str(Path(__file__).parents[1] / "Resources" / "Icons" / "LeftAtriumSynthetic.png"),
    )


def makeSampleData(source: object = None) -> list[slicer.vtkMRMLNode]:
    """Add the synthetic atrium, its seeds and its image to the scene; called by the module Sample Data."""
    return list(loadSample())
