"""Fibrosis, or low voltage, as nodes: table, classes in colour on atrium and map, where blood was measured."""

from __future__ import annotations

import numpy as np
import slicer
from vtk.util.numpy_support import numpy_to_vtk

from LAFlatteningLib import MapData
from LAFlatteningLib.blood_pool import BloodPool
from LAFlatteningLib.fibrosis import Fibrosis
from LAFlatteningLib.scalar_arrays import corner_values

from .class_colours import removeClassColours, setClassColours
from .image_input import addLabelVolume
from .map_nodes import copyArrays, groupNodes, mapsOf
from .result_nodes import addResult, removeResults, resultOf, tableResult
from .surface_nodes import CELL_ID_ARRAY

FIBROSIS, BLOOD_POOL = "fibrosis", "blood pool"
"""Kinds of results."""
CLASSES_SUFFIX = " classes"
NORMAL = (0.91, 0.91, 0.91)
DISEASED = {1: ((0.85, 0.37, 0.05),), 2: ((0.95, 0.70, 0.30), (0.75, 0.15, 0.10))}
WARM = ((1.0, 0.93, 0.63), (0.99, 0.55, 0.24), (0.74, 0.0, 0.15))
"""From light to dark, for more than two classes."""
BLOOD_RED = (0.85, 0.15, 0.15)

ModelNode = slicer.vtkMRMLModelNode


def classArrayOf(array: str) -> str:
    """The name of the cell array with the classes of an array."""
    return f"{array}{CLASSES_SUFFIX}"


def fibrosisColumns(found: Fibrosis) -> dict[str, list[str] | np.ndarray]:
    """The columns of the table: one row a part, the whole atrium first."""
    parts = found.parts
    columns: dict[str, list[str] | np.ndarray] = {
        "Group": [part.group for part in parts],
        "Part": [part.name for part in parts],
        "Area (cm2)": np.array([part.area_cm2 for part in parts]),
    }
    for k in range(1, len(found.class_names)):
        columns[f"{found.class_label(k)} (%)"] = np.array([part.class_percent[k] for part in parts])
        columns[f"{found.class_label(k)} (cm2)"] = np.array([part.class_cm2[k] for part in parts])
    if len(found.class_names) > 2:
        columns["All of these (%)"] = np.array([part.beyond_percent for part in parts])
    unit = f" ({found.unit})" if found.unit else ""
    columns[f"Mean of {found.array}{unit}"] = np.array([part.mean for part in parts])
    columns["No value (cm2)"] = np.array([part.missing_cm2 for part in parts])
    return columns


def writeFibrosis(
    mapNode: ModelNode, surfaceNode: ModelNode, data: MapData, found: Fibrosis
) -> slicer.vtkMRMLTableNode:
    """The table of a map, and the classes as a cell array of its atrium and of all maps of that."""
    table = tableResult(mapNode, FIBROSIS, f"{found.array} classes", fibrosisColumns(found))
    polydata = surfaceNode.GetPolyData()
    count = len(found.class_names)
    # What is no wall has no value: covers.
    values = np.full(polydata.GetNumberOfCells(), count, np.int32)
    first = polydata.GetNumberOfVerts() + polydata.GetNumberOfLines()
    values[data.surface.cell_data[CELL_ID_ARRAY] + first] = _classes(data, found)
    name = classArrayOf(found.array)
    array = numpy_to_vtk(values, deep=True)
    array.SetName(name)
    names = [found.class_label(k) for k in range(count)]
    setClassColours(surfaceNode, name, names, [NORMAL, *_colours(count - 1)])
    polydata.GetCellData().AddArray(array)
    polydata.Modified()
    for other in mapsOf(surfaceNode):
        copyArrays(other, surfaceNode)
    groupNodes(surfaceNode, [table])
    return table


def removeClasses(surfaceNode: ModelNode) -> None:
    """Take class arrays and their colours off an atrium and its maps."""
    polydata = surfaceNode.GetPolyData()
    cells = polydata.GetCellData()
    for name in [cells.GetArrayName(k) for k in range(cells.GetNumberOfArrays())]:
        if name and name.endswith(CLASSES_SUFFIX):
            display = surfaceNode.GetDisplayNode()
            if display is not None and display.GetActiveScalarName() == name:
                display.SetActiveScalarName(name.removesuffix(CLASSES_SUFFIX))
                display.SetScalarVisibility(False)
            cells.RemoveArray(name)
            removeClassColours(surfaceNode, name)
    polydata.Modified()
    for mapNode in mapsOf(surfaceNode):
        copyArrays(mapNode, surfaceNode)


def writeBloodPool(
    mapNode: ModelNode, surfaceNode: ModelNode, volumeNode: slicer.vtkMRMLVolumeNode, pool: BloodPool
) -> slicer.vtkMRMLLabelMapVolumeNode | None:
    """Where blood was measured, as a label map below the transform of the image; None for a region of the user's."""
    if pool.region is None or pool.depth_mm is None:
        removeResults(mapNode, BLOOD_POOL)
        return None
    node = resultOf(mapNode, BLOOD_POOL)
    if node is None:
        node = addResult(mapNode, BLOOD_POOL, "vtkMRMLLabelMapVolumeNode", f"{mapNode.GetName()} blood pool")
    addLabelVolume(node, pool.region)
    node.SetAndObserveTransformNodeID(volumeNode.GetTransformNodeID())
    if node.GetDisplayNode() is None:
        node.CreateDefaultDisplayNodes()
    groupNodes(surfaceNode, [node])
    return node


def _classes(data: MapData, found: Fibrosis) -> np.ndarray:
    """The class of each triangle of a map, by the mean of its corners; "no value" is the number of classes."""
    values = corner_values(data.surface, found.array).mean(axis=1)
    limits = np.array(found.thresholds)
    if found.rule.direction == "above":
        classes = np.searchsorted(limits, values, side="right")
    else:
        classes = np.searchsorted(-limits, -values, side="left")
    return np.where(np.isfinite(values), classes, len(found.class_names))


def _colours(count: int) -> list[tuple[float, float, float]]:
    """Colours of the classes beyond normal."""
    if count in DISEASED:
        return list(DISEASED[count])
    at, anchors = np.linspace(0.0, len(WARM) - 1.0, count), np.array(WARM)
    return [tuple(float(np.interp(x, range(len(WARM)), anchors[:, c])) for c in range(3)) for x in at]
