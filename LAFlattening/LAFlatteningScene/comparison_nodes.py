"""How two maps agree, as nodes: a table, and the difference as an array of the atrium."""

from __future__ import annotations

import numpy as np
import slicer
from vtk.util.numpy_support import numpy_to_vtk

from LAFlatteningLib import MapData
from LAFlatteningLib.comparison import Comparison
from LAFlatteningLib.flattening.flat_map import POINT_ID_ARRAY

from .colouring import POINT_DATA, colourBy, rampColours
from .map_nodes import copyArrays, groupNodes, mapsOf
from .result_nodes import tableResult

COMPARISON = "comparison"
"""Kind of result."""
DIFFERENCE = "difference"
"""Begin of the name of the point array with the difference of another map and this one."""
DIVERGING_NAME = "Difference (blue less, red more)"
DIVERGING = ((0.13, 0.40, 0.67), (0.57, 0.77, 0.87), (0.97, 0.97, 0.97), (0.96, 0.65, 0.51), (0.70, 0.09, 0.17))

ModelNode = slicer.vtkMRMLModelNode


def comparisonColumns(found: Comparison) -> dict[str, list[str] | np.ndarray]:
    """One row a part, the whole map first; A is this map, B the other."""
    parts = found.parts

    def numbers(name: str) -> np.ndarray:
        return np.array([getattr(part, name) for part in parts], np.float64)

    unit = " (percentiles)" if found.scale == "ranks" else ""
    columns: dict[str, list[str] | np.ndarray] = {
        "Part": [part.name for part in parts],
        "Area (cm2)": numbers("area_cm2"),
        "Pearson r (-1 to 1)": numbers("pearson"),
        "Spearman rho (-1 to 1)": numbers("spearman"),
        f"Mean of A, {found.array_a}": numbers("mean_a"),
        f"Mean of B, {found.array_b}": numbers("mean_b"),
        f"B - A, mean{unit}": numbers("difference"),
        f"B - A, SD{unit}": numbers("difference_sd"),
        "Left out, no value (%)": numbers("missing_percent"),
    }
    if found.threshold_a is not None:
        columns["Overlap, Dice (0 to 1)"] = numbers("dice")
        columns["A beyond its threshold (%)"] = numbers("percent_a")
        columns["B beyond its threshold (%)"] = numbers("percent_b")
    return columns


def differenceArray(found: Comparison, otherName: str) -> str:
    """The name of the array of differences, with its unit."""
    return f"{DIFFERENCE} to {otherName} ({'percentiles' if found.scale == 'ranks' else found.array_b})"


def writeComparison(
    mapNode: ModelNode, surfaceNode: ModelNode, data: MapData, found: Comparison, otherName: str
) -> slicer.vtkMRMLTableNode:
    """The table of a map; the difference B - A on its atrium, coloured, with white for none."""
    table = tableResult(mapNode, COMPARISON, "comparison", comparisonColumns(found))
    removeDifferences(surfaceNode)
    polydata = surfaceNode.GetPolyData()
    values = np.full(polydata.GetNumberOfPoints(), np.nan)
    values[data.surface.point_data[POINT_ID_ARRAY]] = found.at(data.flat, found.difference)
    array = numpy_to_vtk(values, deep=True)
    array.SetName(differenceArray(found, otherName))
    polydata.GetPointData().AddArray(array)
    polydata.Modified()
    for other in mapsOf(surfaceNode):
        copyArrays(other, surfaceNode)
    colourBy(surfaceNode, (array.GetName(), POINT_DATA))
    known = np.abs(found.difference[np.isfinite(found.difference)])
    reach = max(float(np.percentile(known, 98)), 1e-9) if len(known) else 1.0
    display = surfaceNode.GetDisplayNode()
    display.SetAndObserveColorNodeID(rampColours(surfaceNode.GetScene(), DIVERGING_NAME, DIVERGING).GetID())
    display.SetScalarRangeFlag(display.UseManualScalarRange)
    display.SetScalarRange(-reach, reach)
    groupNodes(surfaceNode, [table])
    return table


def removeDifferences(surfaceNode: ModelNode) -> None:
    """Take the arrays of differences off an atrium."""
    points = surfaceNode.GetPolyData().GetPointData()
    for name in [points.GetArrayName(k) for k in range(points.GetNumberOfArrays())]:
        if name and name.startswith(f"{DIFFERENCE} to "):
            points.RemoveArray(name)
    surfaceNode.GetPolyData().Modified()
