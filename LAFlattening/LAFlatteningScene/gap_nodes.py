"""Gaps in ablation lines as nodes: tables, curves on the atrium and on the map, RGM over the threshold."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import slicer
import vtk
from scipy.spatial import cKDTree
from vtk.util.numpy_support import numpy_to_vtk

from LAFlatteningLib import MapData
from LAFlatteningLib.gaps.places import WIDE_MM
from LAFlatteningLib.gaps.quantification import Encirclement, FoundGap, GapReport
from LAFlatteningLib.projection import outward_normals
from LAFlatteningLib.surface import UNKNOWN

from .map_nodes import groupNodes, onMap, settingsOf
from .result_nodes import addResult, removeResults, tableResult

GAPS, GAP_LIST, GAP_CURVE, PATH, RGM = GAP_KINDS = "gaps", "gap list", "gap curve", "ablation path", "RGM"
"""Kinds of results."""
GAP_COLOUR, SCAR_COLOUR = (0.04, 0.31, 0.82), (0.23, 0.16, 0.06)
OFF_WALL_MM = 0.6
"""Lines lie so far outside the wall, so that it does not hide them."""
HEIGHT = 0.009
"""Of lines above the map, in disk diameters."""
MOST_CURVE_POINTS = 12
"""Control points of a gap; its measured length is in its name."""

ModelNode = slicer.vtkMRMLModelNode


def gapColumns(report: GapReport) -> dict[str, list[str] | np.ndarray]:
    """One row for each threshold and search area."""
    rows = [(level, area, ring) for level in report.thresholds for area, ring in report.at(level).items()]
    return {
        f"Threshold of {report.array}": np.array([level for level, _, _ in rows]),
        "Around": [area for _, area, _ in rows],
        "Gap length (mm)": np.array([ring.gap_length_mm for _, _, ring in rows]),
        "Scar length (mm)": np.array([ring.scar_length_mm for _, _, ring in rows]),
        "RGM (0 complete to 1)": np.array([ring.rgm for _, _, ring in rows]),
        "Gaps": np.array([len(ring.gaps) for _, _, ring in rows], np.int32),
        f"Of {WIDE_MM:g} mm or more": np.array([ring.wide_gaps for _, _, ring in rows], np.int32),
        "No value (% of the area)": np.array([100.0 * ring.unknown_share for _, _, ring in rows]),
    }


def gapListColumns(report: GapReport) -> dict[str, list[str] | np.ndarray]:
    """One row for each gap."""
    rows = [
        (level, area, k, gap)
        for level in report.thresholds
        for area, ring in report.at(level).items()
        for k, gap in enumerate(ring.gaps, 1)
    ]
    columns: dict[str, list[str] | np.ndarray] = {
        f"Threshold of {report.array}": np.array([level for level, _, _, _ in rows]),
        "Around": [area for _, area, _, _ in rows],
        "Gap": np.array([k for _, _, k, _ in rows], np.int32),
        "Length (mm)": np.array([gap.length_mm for _, _, _, gap in rows]),
        "Place": [gap.where for _, _, _, gap in rows],
    }
    places = np.array([gap.place_mm for _, _, _, gap in rows]).reshape(-1, 3)
    for k, axis in enumerate("xyz" if report.space == UNKNOWN else "RAS"):
        columns[f"{axis} (mm)"] = places[:, k].copy()
    return columns


def writeGaps(
    mapNode: ModelNode, surfaceNode: ModelNode, data: MapData, report: GapReport, shown: float
) -> slicer.vtkMRMLTableNode:
    """Tables for all thresholds; paths and gaps of one of them as lines; a chart where there are several.

    Returns
    -------
    The table of gap lengths.
    """
    removeResults(mapNode, GAP_CURVE, PATH, RGM)
    table = tableResult(mapNode, GAPS, "gaps", gapColumns(report))
    nodes: list[slicer.vtkMRMLNode] = [table, tableResult(mapNode, GAP_LIST, "gap list", gapListColumns(report))]
    normals, tree = outward_normals(data.surface), cKDTree(data.surface.points)

    def lifted(points: np.ndarray) -> np.ndarray:
        return points + OFF_WALL_MM * normals[tree.query(points)[1]]

    def flat(points: np.ndarray) -> np.ndarray:
        diameter = settingsOf(mapNode).diskDiameter
        return np.column_stack([onMap(points, data.template, diameter), np.full(len(points), HEIGHT * diameter)])

    rings = report.at(shown)
    closed = [(lifted(_closed(ring.points_mm)), flat(_closed(ring.points_on_map))) for ring in rings.values()]
    for where, isMap in (("atrium", False), ("map", True)):
        node = addResult(mapNode, PATH, "vtkMRMLModelNode", f"{mapNode.GetName()} ablation paths on the {where}", isMap)
        node.SetAndObservePolyData(_lines([both[isMap] for both in closed]))
        node.CreateDefaultDisplayNodes()
        display = node.GetDisplayNode()
        display.SetColor(*SCAR_COLOUR)
        display.SetLineWidth(3.0)
        display.SetLighting(False)
        display.SetVisibility2D(False)
        nodes.append(node)
    for name, gap in _gaps(rings):
        for points, isMap in ((lifted(gap.points_mm), False), (flat(gap.points_on_map), True)):
            nodes.append(_curve(mapNode, f"{name}: {gap.length_mm:.1f} mm", points, isMap))
    if len(report.thresholds) > 1:
        nodes += _chart(mapNode, report)
    groupNodes(surfaceNode, nodes)
    # Those that look after views see what has come.
    mapNode.Modified()
    return table


def _gaps(rings: dict[str, Encirclement]) -> Iterator[tuple[str, FoundGap]]:
    for area, ring in rings.items():
        for k, gap in enumerate(ring.gaps, 1):
            yield f"{area} gap {k}", gap


def _closed(points: np.ndarray) -> np.ndarray:
    return np.concatenate([points, points[:1]])


def _lines(chains: list[np.ndarray]) -> vtk.vtkPolyData:
    cells, points = vtk.vtkCellArray(), vtk.vtkPoints()
    points.SetData(numpy_to_vtk(np.concatenate(chains), deep=True))
    first = 0
    for chain in chains:
        cells.InsertNextCell(len(chain))
        for k in range(first, first + len(chain)):
            cells.InsertCellPoint(k)
        first += len(chain)
    polydata = vtk.vtkPolyData()
    polydata.SetPoints(points)
    polydata.SetLines(cells)
    return polydata


def _curve(mapNode: ModelNode, name: str, points: np.ndarray, isMap: bool) -> slicer.vtkMRMLMarkupsCurveNode:
    node = addResult(mapNode, GAP_CURVE, "vtkMRMLMarkupsCurveNode", name, isMap)
    node.SetCurveTypeToLinear()
    few = np.unique(np.linspace(0, len(points) - 1, min(len(points), MOST_CURVE_POINTS)).round().astype(int))
    for point in points[few]:
        node.AddControlPoint(vtk.vtkVector3d(*(float(x) for x in point)))
    node.SetLocked(True)
    node.CreateDefaultDisplayNodes()
    display = node.GetDisplayNode()
    display.SetColor(*GAP_COLOUR)
    display.SetSelectedColor(*GAP_COLOUR)
    display.SetPointLabelsVisibility(False)
    display.SetPropertiesLabelVisibility(False)
    display.SetGlyphScale(0.01)
    display.SetCurveLineSizeMode(display.UseLineDiameter)
    display.SetLineDiameter(0.012 * settingsOf(mapNode).diskDiameter if isMap else 1.2)
    display.SetVisibility2D(False)
    return node


def _chart(mapNode: ModelNode, report: GapReport) -> list[slicer.vtkMRMLNode]:
    """RGM of each search area over the threshold."""
    levels = f"Threshold of {report.array}"
    rgm = {area: np.array([ring.rgm for ring in rings]) for area, rings in report.rings.items()}
    table = tableResult(mapNode, RGM, "RGM", {levels: np.array(report.thresholds), **rgm})
    chart = addResult(mapNode, RGM, "vtkMRMLPlotChartNode", f"{mapNode.GetName()} RGM over threshold")
    nodes = [table, chart]
    for k, area in enumerate(rgm):
        series = addResult(mapNode, RGM, "vtkMRMLPlotSeriesNode", area)
        series.SetAndObserveTableNodeID(table.GetID())
        series.SetXColumnName(levels)
        series.SetYColumnName(area)
        series.SetPlotType(series.PlotTypeScatter)
        series.SetColor(*(((0.27, 0.47, 0.67), (0.93, 0.40, 0.47), (0.13, 0.53, 0.20), (0.67, 0.20, 0.47))[k % 4]))
        series.SetLineStyle(series.LineStyleSolid if len(report.rings[area][0].openings) == 1 else series.LineStyleDash)
        chart.AddAndObservePlotSeriesNodeID(series.GetID())
        nodes.append(series)
    chart.SetTitle("Relative gap measure over the threshold of scar")
    chart.SetXAxisTitle(levels)
    chart.SetYAxisTitle("RGM (0 complete to 1)")
    return nodes
