"""By which array atrium and map are coloured, and the colour bar in the view of the map."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import slicer
import vtk

from LAFlatteningLib import LEFT_ATRIUM
from LAFlatteningLib.anatomy import Anatomy
from LAFlatteningLib.errors import InputFileError
from LAFlatteningLib.flattening.flat_map import POINT_ID_ARRAY, REGION_ARRAY
from LAFlatteningLib.shading import label_of

from .class_colours import CLASS_ARRAY, classColours
from .display_link import activeArray
from .map_nodes import COLOURS_NAME, regionColours
from .surface_nodes import CELL_ID_ARRAY

POINT_DATA, CELL_DATA = vtk.vtkAssignAttribute.POINT_DATA, vtk.vtkAssignAttribute.CELL_DATA
FORMER_COLOURS = "LAFlattening.formerColours"
"""Node reference from a display node to the colour table that it had before it showed regions."""
DEFAULT_COLOURS = "vtkMRMLColorTableNodeRainbow"
DARK = (0.1, 0.1, 0.1)
BAR_POSITION, BAR_SIZE = (0.99, 0.01), (0.06, 0.2)
"""In shares of the view: the lower right corner, which the disk leaves free. Slicer makes the letters fit the width."""
BAR_LABELS = 3
CLASS_BAR_SIZE = (0.16, 0.16)
"""Wider, for names."""

ModelNode = slicer.vtkMRMLModelNode
ArrayChoice = tuple[str, int]
"""Name of an array, and whether it is on points or on cells (of vtkAssignAttribute)."""


def colourChoices(surfaceNode: ModelNode | None) -> dict[ArrayChoice, str]:
    """The scalar arrays by which an atrium can be coloured -> what they are called, with unit."""
    polydata = surfaceNode.GetPolyData() if surfaceNode is not None else None
    if polydata is None:
        return {}
    choices = {}
    for where, data in ((POINT_DATA, polydata.GetPointData()), (CELL_DATA, polydata.GetCellData())):
        for k in range(data.GetNumberOfArrays()):
            array, name = data.GetArray(k), data.GetArrayName(k)
            if array is None or not name or name in (POINT_ID_ARRAY, CELL_ID_ARRAY):
                continue
            if array.GetNumberOfComponents() == 1:
                choices[name, where] = _label(surfaceNode, name)
    return choices


def colouredBy(surfaceNode: ModelNode | None) -> ArrayChoice | None:
    """The array by which an atrium is coloured; None: one plain colour."""
    array = activeArray(surfaceNode) if surfaceNode is not None else None
    return (array.GetName(), surfaceNode.GetDisplayNode().GetActiveAttributeLocation()) if array is not None else None


def colourBy(surfaceNode: ModelNode, choice: ArrayChoice | None, anatomy: Anatomy = LEFT_ATRIUM) -> None:
    """Colour an atrium by an array over the range of its values; None gives it one plain colour.

    Raises
    ------
    InputFileError : the atrium has no such array.
    """
    if surfaceNode.GetDisplayNode() is None:
        surfaceNode.CreateDefaultDisplayNodes()
    display = surfaceNode.GetDisplayNode()
    choices = colourChoices(surfaceNode)
    if choice is not None and choice not in choices:
        names = ", ".join(name for name, _ in choices) or "none"
        raise InputFileError(f'"{surfaceNode.GetName()}" has no scalar array "{choice[0]}". Expected one of {names}.')
    own = ownColours(surfaceNode, choice[0], anatomy) if choice is not None else None
    if choice == colouredBy(surfaceNode) and own is None:
        return
    modifying = display.StartModify()
    try:
        if choice is None:
            display.SetScalarVisibility(False)
            return
        display.SetActiveScalar(*choice)
        if own is not None:
            if not _isOwn(display.GetColorNode()):
                display.SetNodeReferenceID(FORMER_COLOURS, display.GetColorNodeID())
            display.SetAndObserveColorNodeID(own.GetID())
            display.SetScalarRangeFlag(display.UseManualScalarRange)
            display.SetScalarRange(0, own.GetNumberOfColors() - 1)
        else:
            if display.GetColorNode() is None or _isOwn(display.GetColorNode()):
                former = display.GetNodeReferenceID(FORMER_COLOURS)
                display.SetAndObserveColorNodeID(former or DEFAULT_COLOURS)
            display.SetScalarRangeFlag(display.UseDataScalarRange)
        display.SetScalarVisibility(True)
    finally:
        display.EndModify(modifying)


def ownColours(
    surfaceNode: ModelNode, array: str, anatomy: Anatomy = LEFT_ATRIUM
) -> slicer.vtkMRMLColorTableNode | None:
    """The colour table of an array of classes, regions among them; None for an array of numbers."""
    if array == REGION_ARRAY:
        return regionColours(surfaceNode.GetScene(), anatomy)
    return classColours(surfaceNode, array)


def rampColours(
    scene: slicer.vtkMRMLScene, name: str, anchors: Sequence[tuple[float, float, float]]
) -> slicer.vtkMRMLColorTableNode:
    """A colour table of 256 steps between colours at equal distances; one of each name in a scene."""
    node = scene.GetFirstNode(name, "vtkMRMLColorTableNode")
    if node is not None:
        return node
    node = scene.AddNewNodeByClass("vtkMRMLColorTableNode", name)
    node.SetTypeToUser()
    node.SetNumberOfColors(256)
    at = np.linspace(0.0, len(anchors) - 1.0, 256)
    for k in range(256):
        colour = [float(np.interp(at[k], range(len(anchors)), np.array(anchors)[:, channel])) for channel in range(3)]
        node.SetColor(k, f"{k}", *colour, 1.0)
    node.GetLookupTable().SetTableRange(0, 255)
    return node


def _isOwn(colours: slicer.vtkMRMLColorNode | None) -> bool:
    """Whether a colour table is one of regions or classes."""
    return colours is not None and (
        colours.GetAttribute(CLASS_ARRAY) is not None or colours.GetName().startswith(COLOURS_NAME)
    )


def _label(surfaceNode: ModelNode, array: str) -> str:
    if array == REGION_ARRAY:
        return "regions"
    return array if classColours(surfaceNode, array) is not None else label_of(array)


def colourBarOf(mapNode: ModelNode) -> slicer.vtkMRMLColorLegendDisplayNode | None:
    """The colour bar of a map, if there is one."""
    displays = (mapNode.GetNthDisplayNode(k) for k in range(mapNode.GetNumberOfDisplayNodes()))
    return next((node for node in displays if isinstance(node, slicer.vtkMRMLColorLegendDisplayNode)), None)


def updateColourBar(mapNode: ModelNode, visible: bool) -> bool:
    """Show or hide the colour bar of a map; True if it was made now. Regions have none: their names are on the map."""
    array = activeArray(mapNode)
    shown = visible and array is not None and array.GetName() != REGION_ARRAY
    bar = colourBarOf(mapNode)
    isNew = bar is None
    if isNew:
        if not shown:
            return False
        bar = _colourBar(mapNode)
    modifying = bar.StartModify()
    try:
        if shown:
            _describe(bar, mapNode.GetDisplayNode().GetColorNode(), array)
        if bool(bar.GetVisibility()) != shown:
            bar.SetVisibility(shown)
    finally:
        bar.EndModify(modifying)
    return isNew


def _describe(
    bar: slicer.vtkMRMLColorLegendDisplayNode, colours: slicer.vtkMRMLColorNode | None, array: vtk.vtkDataArray
) -> None:
    """Title and labels: numbers, or the names of classes with their limits."""
    isClasses = colours is not None and colours.GetAttribute(CLASS_ARRAY) == array.GetName()
    title = array.GetName() if isClasses else label_of(array.GetName())
    if bar.GetTitleText() != title:
        bar.SetTitleText(title)
    if bar.GetLabelFormat() != _format(array) and not isClasses:
        bar.SetLabelFormat(_format(array))
    count = colours.GetNumberOfColors() if isClasses else BAR_LABELS
    if bool(bar.GetUseColorNamesForLabels()) != isClasses or bar.GetNumberOfLabels() != count:
        bar.SetUseColorNamesForLabels(isClasses)
        bar.SetNumberOfLabels(count)
        if isClasses:
            bar.SetLabelFormat("%s")
        bar.SetSize(*(CLASS_BAR_SIZE if isClasses else BAR_SIZE))


def _colourBar(mapNode: ModelNode) -> slicer.vtkMRMLColorLegendDisplayNode:
    bar = mapNode.GetScene().AddNewNodeByClass("vtkMRMLColorLegendDisplayNode", f"{mapNode.GetName()} colour bar")
    bar.SetAndObservePrimaryDisplayNode(mapNode.GetDisplayNode())
    bar.SetPosition(*BAR_POSITION)
    bar.SetSize(*BAR_SIZE)
    bar.SetNumberOfLabels(BAR_LABELS)
    for text in (bar.GetTitleTextProperty(), bar.GetLabelTextProperty()):
        text.SetColor(*DARK)
        text.SetShadow(False)
        text.SetFontFamilyToArial()
    mapNode.AddAndObserveDisplayNodeID(bar.GetID())
    return bar


def _format(array: vtk.vtkDataArray) -> str:
    return "%.3g" if array.GetDataType() in (vtk.VTK_FLOAT, vtk.VTK_DOUBLE) else "%.0f"
