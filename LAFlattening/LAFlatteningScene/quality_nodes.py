"""How good a map is, as tables and plots."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import slicer

from LAFlatteningLib import FlatMap, distortion

from .result_nodes import fillTableNode

METRICS_ROLE, REGIONS_ROLE = "LAFlattening.metrics", "LAFlattening.regions"
HISTOGRAM_ROLE = "LAFlattening.histogram"
AREA_ROLE, ISOTROPY_ROLE = "LAFlattening.areaChart", "LAFlattening.isotropyChart"
"""Node references from a map to its tables and plot charts."""
SERIES_ROLES = {AREA_ROLE: "LAFlattening.areaSeries", ISOTROPY_ROLE: "LAFlattening.isotropySeries"}
OCTAVES, BINS = 4, 40
"""The histogram of the area ratio spans this many octaves on either side of 1."""
AREA_BIN, AREA_SHARE = "Area ratio, map to atrium (log2)", "Triangles by area ratio (%)"
ISOTROPY_BIN, ISOTROPY_SHARE = "Isotropy (1: angles kept)", "Triangles by isotropy (%)"

ModelNode = slicer.vtkMRMLModelNode


def qualityNodesOf(mapNode: ModelNode) -> list[slicer.vtkMRMLNode]:
    """The tables and plots of a map, as far as they are there."""
    roles = (METRICS_ROLE, REGIONS_ROLE, HISTOGRAM_ROLE, *SERIES_ROLES, *SERIES_ROLES.values())
    nodes = (mapNode.GetNodeReference(role) for role in roles)
    return [node for node in nodes if node is not None]


def metricRows(flatMap: FlatMap, diskDiameter: float) -> Iterator[tuple[str, str, str]]:
    """Quantity, value, unit of each figure of a map; "1" is the unit of a ratio."""
    metrics, radius = flatMap.metrics, 0.5 * diskDiameter
    yield "template", str(metrics["template"]), ""
    yield "method", str(metrics["method"]), ""
    yield "map diameter", f"{diskDiameter:g}", "mm"
    for name in ("points", "triangles", "folded_triangles"):
        yield name.replace("_", " "), str(metrics[name]), name.split("_")[-1]
    yield "overlapping pairs", str(metrics["overlapping_pairs"]), "pairs of triangles"
    yield "flipped edges", str(metrics["flipped_edges"]), "edges"
    yield "freed path points", str(metrics["freed_path_points"]), "points"
    yield "rim error on the map, largest", _millimetres(metrics["rim_error"] * radius), "mm"
    yield "path drift on the map, largest", _millimetres(metrics["path_drift"] * radius), "mm"
    labels = {"alpha": "area ratio alpha", "beta": "isotropy beta", "dilatation": "dilatation"}
    for key, label in labels.items():
        for figure, value in metrics[key].items():
            yield f"{label}, {figure}", _digits(value), "nat" if figure == "entropy" else "1"
    for seed, moved in metrics["seed_moved_mm"].items():
        yield f"seed {seed} moved to its rim or cover", _millimetres(moved), "mm"
    yield "time from seeds to map", _digits(metrics["seconds"]["total"]), "s"


def writeQuality(mapNode: ModelNode, flatMap: FlatMap, diskDiameter: float) -> list[slicer.vtkMRMLNode]:
    """Make or update the tables and plots of a map; returns all of their nodes."""
    metrics = _node(mapNode, METRICS_ROLE, "vtkMRMLTableNode", "metrics")
    columns = zip(*metricRows(flatMap, diskDiameter), strict=True)
    fillTableNode(metrics, dict(zip(("Quantity", "Value", "Unit"), columns, strict=True)))
    regions = _node(mapNode, REGIONS_ROLE, "vtkMRMLTableNode", "regions")
    fillTableNode(regions, regionColumns(flatMap))
    histogram = _node(mapNode, HISTOGRAM_ROLE, "vtkMRMLTableNode", "distortion histogram")
    fillTableNode(histogram, histogramColumns(flatMap))
    charts = [
        *_chart(mapNode, histogram, AREA_ROLE, "area ratio", AREA_BIN, AREA_SHARE, (0.93, 0.53, 0.4)),
        *_chart(mapNode, histogram, ISOTROPY_ROLE, "isotropy", ISOTROPY_BIN, ISOTROPY_SHARE, (0.3, 0.5, 0.75)),
    ]
    return [metrics, regions, histogram, *charts]


def regionColumns(flatMap: FlatMap) -> dict[str, list[str] | np.ndarray]:
    """The columns of the region table; areas on the atrium in mm2."""
    anatomy, triangles = flatMap.template.anatomy, flatMap.triangles
    numbers = sorted(anatomy.regions)
    area = flatMap.surface.triangle_areas
    corners = flatMap.points[triangles]
    (ax, ay), (bx, by) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    onMap = 0.5 * np.abs(ax * by - ay * bx)
    beta = np.nan_to_num(distortion.isotropy(flatMap.surface.points, triangles, flatMap.points))
    inside = [flatMap.regions == number for number in numbers]
    areas = np.array([area[part].sum() for part in inside])
    return {
        "Region": np.array(numbers, np.int32),
        "Name": [anatomy.region_names[number] for number in numbers],
        "Area on the atrium (mm2)": areas,
        "Share of the atrium (%)": 100.0 * areas / area.sum(),
        "Share of the map (%)": 100.0 * np.array([onMap[part].sum() for part in inside]) / onMap.sum(),
        "Isotropy, mean over the area (1)": np.array(
            [(beta[part] * area[part]).sum() / max(area[part].sum(), 1e-12) for part in inside]
        ),
    }


def histogramColumns(flatMap: FlatMap) -> dict[str, np.ndarray]:
    """Middles of the bins, and the share of the triangles in each in percent; the outer bins hold what lies beyond."""
    mesh = (flatMap.surface.points, flatMap.triangles, flatMap.points)
    alpha, beta = distortion.area_ratio(*mesh), distortion.isotropy(*mesh)
    columns = {}
    for name, share, values, low, high in (
        (AREA_BIN, AREA_SHARE, np.log2(np.maximum(alpha[np.isfinite(alpha)], 1e-12)), -OCTAVES, OCTAVES),
        (ISOTROPY_BIN, ISOTROPY_SHARE, beta[np.isfinite(beta)], 0.0, 1.0),
    ):
        counts, edges = np.histogram(np.clip(values, low, high), BINS, (low, high))
        columns[name] = 0.5 * (edges[1:] + edges[:-1])
        columns[share] = 100.0 * counts / max(len(values), 1)
    return columns


def _digits(value: float) -> str:
    return f"{value:.4g}"


def _millimetres(value: float) -> str:
    """To a thousandth: what is smaller is the rounding of the computer."""
    return f"{value:.3f}"


def _node(mapNode: ModelNode, role: str, className: str, what: str) -> slicer.vtkMRMLNode:
    """The node that a map refers to by a role; a new one, named after the map, if there is none."""
    node = mapNode.GetNodeReference(role)
    if node is None:
        scene = mapNode.GetScene()
        node = scene.AddNewNodeByClass(className, scene.GenerateUniqueName(f"{mapNode.GetName()} {what}"))
        mapNode.SetNodeReferenceID(role, node.GetID())
    return node


def _chart(
    mapNode: ModelNode,
    histogram: slicer.vtkMRMLTableNode,
    role: str,
    what: str,
    bins: str,
    share: str,
    colour: tuple[float, float, float],
) -> list[slicer.vtkMRMLNode]:
    series = _node(mapNode, SERIES_ROLES[role], "vtkMRMLPlotSeriesNode", f"{what} series")
    series.SetAndObserveTableNodeID(histogram.GetID())
    series.SetXColumnName(bins)
    series.SetYColumnName(share)
    series.SetPlotType(series.PlotTypeScatterBar)
    series.SetMarkerStyle(series.MarkerStyleNone)
    series.SetColor(*colour)
    chart = _node(mapNode, role, "vtkMRMLPlotChartNode", what)
    chart.RemoveAllPlotSeriesNodeIDs()
    chart.AddAndObservePlotSeriesNodeID(series.GetID())
    chart.SetTitle(f"Distortion of the map: {what}")
    chart.SetXAxisTitle(bins)
    chart.SetYAxisTitle(share)
    chart.LegendVisibilityOff()
    return [series, chart]
