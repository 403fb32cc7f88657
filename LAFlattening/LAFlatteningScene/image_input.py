"""Images of the scene as the library reads them, parent transforms included."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import slicer
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

from LAFlatteningLib import InputFileError, Surface, Volume

from .surface_nodes import transformed

LPS_TO_RAS = np.array([-1.0, -1.0, 1.0])
RIGID = 1e-6
"""A transform whose axes are off right angles and length 1 by no more than this is a rigid one."""


@dataclass(frozen=True, eq=False)
class WarpedVolume(Volume):
    """An image below a transform that does more than turn and shift.

    Attributes
    ----------
    toWorld : from the image's own RAS to world RAS. Spacing, origin and direction are the image's own.
    """

    toWorld: vtk.vtkGeneralTransform

    def positions(self, indices):
        """World LPS, mm."""
        return LPS_TO_RAS * _through(self.toWorld, LPS_TO_RAS * super().positions(indices))

    def indices(self, positions):
        """Of places in world LPS, mm."""
        toLocal = self.toWorld.GetInverse()
        return super().indices(LPS_TO_RAS * _through(toLocal, LPS_TO_RAS * np.asarray(positions)))


def imageVolume(image: vtk.vtkImageData, toRas: np.ndarray) -> Volume:
    """An image whose indices become RAS by a (4, 4) matrix; voxels are shared with the image.

    Raises
    ------
    InputFileError : several values a voxel, or axes that are not at right angles.
    """
    scalars, extent = image.GetPointData().GetScalars(), image.GetExtent()
    if scalars.GetNumberOfComponents() != 1:
        raise InputFileError(
            f"Expected an image with one value a voxel, found {scalars.GetNumberOfComponents()}. Choose another volume."
        )
    axes = LPS_TO_RAS[:, None] * toRas[:3, :3]
    spacing = np.linalg.norm(axes, axis=0)
    first = toRas @ (extent[0], extent[2], extent[4], 1.0)
    values = vtk_to_numpy(scalars).reshape(image.GetDimensions()[::-1])
    return Volume(values, spacing, LPS_TO_RAS * first[:3], axes / spacing)


def localVolume(volumeNode: slicer.vtkMRMLVolumeNode | None) -> Volume:
    """The image of a volume node in its own coordinates, without parent transforms.

    Raises
    ------
    InputFileError : no node, no voxels, or what `imageVolume` refuses.
    """
    if volumeNode is None or volumeNode.GetScene() is None:
        raise InputFileError("No image is selected. Expected a volume that shows the atrium; select or load one.")
    image = volumeNode.GetImageData()
    if image is None or image.GetNumberOfPoints() == 0 or image.GetPointData().GetScalars() is None:
        raise InputFileError(f'The volume "{volumeNode.GetName()}" has no voxels. Select another one.')
    matrix = vtk.vtkMatrix4x4()
    volumeNode.GetIJKToRASMatrix(matrix)
    return imageVolume(image, slicer.util.arrayFromVTKMatrix(matrix))


def worldVolume(volumeNode: slicer.vtkMRMLVolumeNode | None) -> Volume:
    """The image of a volume node in world coordinates, with all parent transforms; errors as `localVolume`."""
    local = localVolume(volumeNode)
    parent = volumeNode.GetParentTransformNode()
    if parent is None:
        return local
    if parent.IsTransformToWorldLinear():
        matrix, own = vtk.vtkMatrix4x4(), vtk.vtkMatrix4x4()
        parent.GetMatrixTransformToWorld(matrix)
        turn = slicer.util.arrayFromVTKMatrix(matrix)
        if np.abs(turn[:3, :3].T @ turn[:3, :3] - np.eye(3)).max() < RIGID:
            volumeNode.GetIJKToRASMatrix(own)
            return imageVolume(volumeNode.GetImageData(), turn @ slicer.util.arrayFromVTKMatrix(own))
    toWorld = vtk.vtkGeneralTransform()
    slicer.vtkMRMLTransformNode.GetTransformBetweenNodes(parent, None, toWorld)
    return WarpedVolume(local.values, local.spacing, local.origin, local.direction, toWorld)


def segmentVolume(node: slicer.vtkMRMLLabelMapVolumeNode | slicer.vtkMRMLSegmentationNode, segment: str = "") -> Volume:
    """A region that a user drew, in world coordinates: all labels of a label map, or one segment.

    Raises
    ------
    InputFileError : nothing in it, or several segments and none chosen.
    """
    if not isinstance(node, slicer.vtkMRMLSegmentationNode):
        return worldVolume(node)
    segmentation = node.GetSegmentation()
    keys = list(segmentation.GetSegmentIDs())
    if not segment and len(keys) != 1:
        raise InputFileError(
            f'The segmentation "{node.GetName()}" has {len(keys)} segments. Expected one, that of the blood; make one '
            "of its own for it."
        )
    image, matrix = slicer.vtkOrientedImageData(), vtk.vtkMatrix4x4()
    node.GetBinaryLabelmapRepresentation(segment or keys[0], image)
    if image.GetNumberOfPoints() == 0 or image.GetPointData().GetScalars() is None:
        raise InputFileError(f'The segment of the blood in "{node.GetName()}" is empty. Draw it, or choose another.')
    image.GetImageToWorldMatrix(matrix)
    parent = node.GetParentTransformNode()
    toWorld = vtk.vtkMatrix4x4()
    if parent is not None:
        if not parent.IsTransformToWorldLinear():
            raise InputFileError(
                f'The segmentation "{node.GetName()}" is below a nonlinear transform. Harden the transform first.'
            )
        parent.GetMatrixTransformToWorld(toWorld)
    turn = slicer.util.arrayFromVTKMatrix(toWorld)
    return imageVolume(image, turn @ slicer.util.arrayFromVTKMatrix(matrix))


def inCoordinatesOf(surface: Surface, node: slicer.vtkMRMLTransformableNode) -> Surface:
    """A surface (world RAS) in the own coordinates of a node, without the node's parent transforms."""
    parent = node.GetParentTransformNode()
    if parent is None:
        return surface
    toLocal = vtk.vtkGeneralTransform()
    slicer.vtkMRMLTransformNode.GetTransformBetweenNodes(None, parent, toLocal)
    return Surface(_through(toLocal, surface.points), surface.triangles, space="RAS")


def addLabelVolume(node: slicer.vtkMRMLLabelMapVolumeNode, labels: Volume) -> None:
    """Give a label map node the voxels of a library volume (LPS), copied."""
    image = vtk.vtkImageData()
    image.SetDimensions(*labels.values.shape[::-1])
    voxels = numpy_to_vtk(labels.values.reshape(-1), deep=True)
    voxels.SetName("labels")
    image.GetPointData().SetScalars(voxels)
    toRas = np.eye(4)
    toRas[:3, :3] = LPS_TO_RAS[:, None] * labels.direction * labels.spacing
    toRas[:3, 3] = LPS_TO_RAS * labels.origin
    node.SetIJKToRASMatrix(slicer.util.vtkMatrixFromArray(toRas))
    node.SetAndObserveImageData(image)


def _through(transform: vtk.vtkAbstractTransform, points: np.ndarray) -> np.ndarray:
    """Points (n, 3) moved by a transform."""
    before = vtk.vtkPoints()
    before.SetData(numpy_to_vtk(np.ascontiguousarray(points, np.float64), deep=True))
    return transformed(before, transform)
