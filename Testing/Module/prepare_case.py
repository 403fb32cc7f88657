"""What the tests of preparing share: closed atria as model, segmentation and label map, and where the truth is."""

import functools

import numpy as np
import SimpleITK as sitk
import slicer
import vtk
from logic_case import addArray, addModel, toRas
from vtk.util.numpy_support import numpy_to_vtk

from LAFlatteningLib import make_phantom
from LAFlatteningLib.phantom import left_atrium_shape
from LAFlatteningLib.phantom.labels import make_label_map

POINTS = 3000
SPACING = (0.625, 0.625, 1.25)


@functools.cache
def closedPhantom():
    """The synthetic atrium with all its veins; never changed."""
    return make_phantom(POINTS, closed=True)


@functools.cache
def labelImage():
    """The same as a label map, LPS."""
    return make_label_map(left_atrium_shape(), SPACING)


def truth():
    """Opening -> the middle of its rim in the open phantom (RAS, mm), and the way out of it."""
    shape = closedPhantom().shape
    return {
        name: (toRas(np.array(shape.centre) + opening.rim[1] * opening.axis), toRas(opening.axis))
        for name, opening in shape.openings.items()
    }


def addClosed(name="Raw"):
    """The closed phantom as a model node in RAS, with its LGE intensity."""
    surface = closedPhantom().surface
    node = addModel(toRas(surface.points), surface.triangles, name)
    addArray(node, "LGE", surface.point_data["LGE"])
    return node


def addSphere(radius=25.0):
    """A ball as a model node."""
    source = vtk.vtkSphereSource()
    source.SetRadius(radius)
    source.SetThetaResolution(60)
    source.SetPhiResolution(60)
    source.Update()
    node = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLModelNode", "Ball")
    node.SetAndObservePolyData(source.GetOutput())
    return node


def labelVoxels():
    """The label map as (values, 4x4 matrix from indices to RAS)."""
    image = labelImage()
    toRasMatrix = np.eye(4)
    flip = np.diag([-1.0, -1.0, 1.0])
    toRasMatrix[:3, :3] = flip @ np.reshape(image.GetDirection(), (3, 3)) @ np.diag(image.GetSpacing())
    toRasMatrix[:3, 3] = flip @ image.GetOrigin()
    return sitk.GetArrayFromImage(image), toRasMatrix


def imageData(values, image):
    """Put voxels (k, j, i) into an image."""
    image.SetDimensions(*values.shape[::-1])
    scalars = numpy_to_vtk(np.ascontiguousarray(values, np.uint8).reshape(-1), deep=True)
    scalars.SetName("label")
    image.GetPointData().SetScalars(scalars)
    return image


def addLabelMap(values=None):
    """The phantom as a label map node."""
    voxels, matrix = labelVoxels()
    node = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLLabelMapVolumeNode", "Labels")
    node.SetIJKToRASMatrix(slicer.util.vtkMatrixFromArray(matrix))
    node.SetAndObserveImageData(imageData(voxels if values is None else values, vtk.vtkImageData()))
    return node


def addSegmentation(masks=None):
    """The phantom as a segmentation node, a segment for each mask (name -> voxels)."""
    voxels, matrix = labelVoxels()
    node = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLSegmentationNode", "Segmentation")
    for name, mask in ({"left atrium": voxels > 0} if masks is None else masks).items():
        image = imageData(mask, slicer.vtkOrientedImageData())
        image.SetImageToWorldMatrix(slicer.util.vtkMatrixFromArray(matrix))
        node.AddSegmentFromBinaryLabelmapRepresentation(image, name, [1.0, 0.5, 0.5])
    return node
