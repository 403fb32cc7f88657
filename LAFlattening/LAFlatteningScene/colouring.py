"""By which array atrium and map are coloured, and the colour bar in the view of the map."""

from __future__ import annotations

import slicer
import vtk

from LAFlatteningLib import LEFT_ATRIUM
from LAFlatteningLib.anatomy import Anatomy
from LAFlatteningLib.errors import InputFileError
from LAFlatteningLib.flattening.flat_map import POINT_ID_ARRAY, REGION_ARRAY
from LAFlatteningLib.shading import label_of

from .display_link import activeArray
from .map_nodes import regionColours
from .surface_nodes import CELL_ID_ARRAY

POINT_DATA, CELL_DATA = vtk.vtkAssignAttribute.POINT_DATA, vtk.vtkAssignAttribute.CELL_DATA
FORMER_COLOURS = "LAFlattening.formerColours"
"""Node reference from a display node to the colour table that it had before it showed regions."""
DEFAULT_COLOURS = "vtkMRMLColorTableNodeRainbow"
DARK = (0.1, 0.1, 0.1)
BAR_POSITION, BAR_SIZE = (0.99, 0.01), (0.06, 0.2)
"""In shares of the view: the lower right corner, which the disk leaves free. Slicer makes the letters fit the width."""
BAR_LABELS = 3

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
                choices[name, where] = "regions" if name == REGION_ARRAY else label_of(name)
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
    if choice == colouredBy(surfaceNode):
        return
    modifying = display.StartModify()
    try:
        if choice is None:
            display.SetScalarVisibility(False)
            return
        display.SetActiveScalar(*choice)
        if choice[0] == REGION_ARRAY:
            display.SetNodeReferenceID(FORMER_COLOURS, display.GetColorNodeID())
            display.SetAndObserveColorNodeID(regionColours(surfaceNode.GetScene(), anatomy).GetID())
            display.SetScalarRangeFlag(display.UseManualScalarRange)
            display.SetScalarRange(0, max(anatomy.regions))
        else:
            colours = display.GetColorNode()
            if colours is None or colours is regionColours(surfaceNode.GetScene(), anatomy):
                former = display.GetNodeReferenceID(FORMER_COLOURS)
                display.SetAndObserveColorNodeID(former or DEFAULT_COLOURS)
            display.SetScalarRangeFlag(display.UseDataScalarRange)
        display.SetScalarVisibility(True)
    finally:
        display.EndModify(modifying)


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
        if shown and bar.GetTitleText() != label_of(array.GetName()):
            bar.SetTitleText(label_of(array.GetName()))
        if shown and bar.GetLabelFormat() != _format(array):
            bar.SetLabelFormat(_format(array))
        if bool(bar.GetVisibility()) != shown:
            bar.SetVisibility(shown)
    finally:
        bar.EndModify(modifying)
    return isNew


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
