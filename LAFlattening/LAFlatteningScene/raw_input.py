"""What an atrium is prepared from: a model, a segment or a label map, as a surface in world coordinates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import slicer
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

from LAFlatteningLib import Surface, SurfaceError
from LAFlatteningLib.cavity.label_surface import denoised_label_surface
from LAFlatteningLib.progress import ProgressCallback

from .image_input import LPS_TO_RAS, imageVolume
from .surface_nodes import toWorld

MOST_STRUCTURES = 256
"""An image with more different values is no label map; none of them is offered."""
BINARY, CLOSED = (
    slicer.vtkSegmentationConverter.GetSegmentationBinaryLabelmapRepresentationName(),
    slicer.vtkSegmentationConverter.GetSegmentationClosedSurfaceRepresentationName(),
)

RawNode = slicer.vtkMRMLModelNode | slicer.vtkMRMLSegmentationNode | slicer.vtkMRMLLabelMapVolumeNode


def structuresOf(node: RawNode | None) -> dict[str, str]:
    """What can be chosen in a node: id -> name of each segment, or value -> name of each label; nothing in a model."""
    if isinstance(node, slicer.vtkMRMLSegmentationNode):
        segmentation = node.GetSegmentation()
        return {key: segmentation.GetSegment(key).GetName() for key in segmentation.GetSegmentIDs()}
    if isinstance(node, slicer.vtkMRMLLabelMapVolumeNode) and node.GetImageData() is not None:
        values = np.unique(vtk_to_numpy(node.GetImageData().GetPointData().GetScalars()))
        values = [value for value in values.tolist() if value != 0 and value == round(value)]
        if len(values) <= MOST_STRUCTURES:
            return {f"{value:g}": _labelName(node, int(value)) for value in values}
    return {}


def versionOf(node: RawNode, structure: str = "") -> tuple[object, ...]:
    """A key that changes whenever `rawSurface` may give another surface."""
    parent = node.GetParentTransformNode()
    moved = None if parent is None else (parent.GetID(), parent.GetTransformToWorldMTime(), parent.GetMTime())
    data: list[object] = []
    if isinstance(node, slicer.vtkMRMLModelNode):
        data = [node.GetPolyData()]
    elif isinstance(node, slicer.vtkMRMLSegmentationNode):
        segmentation = node.GetSegmentation()
        data = [segmentation.GetSegmentIDs()]
        for key in segmentation.GetSegmentIDs():
            segment = segmentation.GetSegment(key)
            data += [segment.GetLabelValue(), *(segment.GetRepresentation(name) for name in (BINARY, CLOSED))]
    else:
        matrix = vtk.vtkMatrix4x4()
        node.GetIJKToRASMatrix(matrix)
        data = [node.GetImageData(), str(slicer.util.arrayFromVTKMatrix(matrix).tolist())]
    times = (part.GetMTime() if isinstance(part, vtk.vtkObject) else part for part in data)
    return (node.GetID(), structure, moved, *times)


def rawSurface(
    node: RawNode | None, structure: str = "", progress: ProgressCallback | None = None, axesKnown: bool = True
) -> tuple[Surface, list[str]]:
    """The surface of an atrium as the scene has it, RAS, mm, world, with all arrays; and what is to be said about it.

    Parameters
    ----------
    structure : id of a segment, or value of a label; may be empty where there is only one.
    axesKnown : whether the axes of the scene are the patient's, so that notes may go by them.

    Raises
    ------
    SurfaceError, InputFileError : no node, nothing in it, several structures and none chosen, or not a left atrium.
    """
    if node is None or node.GetScene() is None:
        raise SurfaceError(
            "Nothing is selected to be prepared. Expected the model, segmentation or label map of a left atrium; "
            "select or load one."
        )
    if isinstance(node, slicer.vtkMRMLModelNode):
        return _modelSurface(node.GetPolyData(), node), []
    if isinstance(node, slicer.vtkMRMLSegmentationNode):
        return _segmentSurface(node, _chosen(node, structure), progress, axesKnown)
    if node.GetImageData() is None:
        raise SurfaceError(
            f'The label map "{node.GetName()}" has no voxels. Expected the segmentation of a left atrium.'
        )
    matrix = vtk.vtkMatrix4x4()
    node.GetIJKToRASMatrix(matrix)
    label = int(structure) if structure else None
    return _labelSurface(node.GetImageData(), matrix, node, label, progress, axesKnown)


def _labelName(node: slicer.vtkMRMLLabelMapVolumeNode, value: int) -> str:
    display = node.GetDisplayNode()
    colours = display.GetColorNode() if display is not None else None
    name = colours.GetColorName(value) if colours is not None else ""
    return f"{value} ({name})" if name and name != f"{value}" else f"{value}"


def _chosen(node: slicer.vtkMRMLSegmentationNode, structure: str) -> str:
    structures = structuresOf(node)
    if not structures:
        raise SurfaceError(
            f'The segmentation "{node.GetName()}" has no segments. Expected one of a left atrium; segment it first, or '
            "select another one."
        )
    if structure in structures:
        return structure
    if len(structures) > 1:
        raise SurfaceError(
            f'The segmentation "{node.GetName()}" has several segments: {", ".join(structures.values())}. Choose the '
            "one that is the left atrium."
        )
    return next(iter(structures))


def _modelSurface(polydata: vtk.vtkPolyData | None, node: slicer.vtkMRMLTransformableNode) -> Surface:
    if polydata is None or polydata.GetNumberOfPoints() == 0:
        raise SurfaceError(f'"{node.GetName()}" is empty. Expected the surface of a left atrium; select another one.')
    surface = Surface.from_polydata(polydata, "RAS")
    return replace(surface, points=toWorld(polydata.GetPoints(), node))


def _segmentSurface(
    node: slicer.vtkMRMLSegmentationNode, key: str, progress: ProgressCallback | None, axesKnown: bool
) -> tuple[Surface, list[str]]:
    segmentation = node.GetSegmentation()
    name = segmentation.GetSegment(key).GetName()
    if segmentation.GetSourceRepresentationName() == CLOSED:
        polydata = vtk.vtkPolyData()
        node.GetClosedSurfaceRepresentation(key, polydata)
        return _modelSurface(polydata, node), []
    if not segmentation.ContainsRepresentation(BINARY):
        raise SurfaceError(
            f'The segmentation "{node.GetName()}" has neither a binary label map nor a closed surface. Make one of '
            "them in the module Segmentations."
        )
    image, matrix = slicer.vtkOrientedImageData(), vtk.vtkMatrix4x4()
    node.GetBinaryLabelmapRepresentation(key, image)
    if image.GetNumberOfPoints() == 0 or image.GetPointData().GetScalars() is None:
        raise SurfaceError(f'The segment "{name}" is empty. Expected a left atrium; choose another segment.')
    image.GetImageToWorldMatrix(matrix)
    return _labelSurface(image, matrix, node, None, progress, axesKnown)


def _labelSurface(
    image: vtk.vtkImageData,
    toRas: vtk.vtkMatrix4x4,
    node: slicer.vtkMRMLTransformableNode,
    label: int | None,
    progress: ProgressCallback | None,
    axesKnown: bool,
) -> tuple[Surface, list[str]]:
    """The surface of a label of an image whose indices become RAS by a matrix."""
    volume = imageVolume(image, slicer.util.arrayFromVTKMatrix(toRas))
    found = denoised_label_surface(volume, label, progress, axesKnown)
    points = vtk.vtkPoints()
    points.SetDataTypeToDouble()
    points.SetData(numpy_to_vtk(found.surface.points * LPS_TO_RAS, deep=True))
    return replace(found.surface, points=toWorld(points, node), space="RAS"), list(found.notes)
