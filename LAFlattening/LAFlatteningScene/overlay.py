"""Template lines and names on the map."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import slicer
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

from LAFlatteningLib import Template

from .map_nodes import onMap, settingsOf
from .template_text import templateOf

LINES_ROLE, LABELS_ROLE = "LAFlattening.lines", "LAFlattening.labels"
"""Node references from a map to its overlay."""
MADE_FROM = "LAFlattening.template"
"""Attribute of the overlay's nodes: template and diameter, so that it is made anew only when these change."""
LINES_HEIGHT, HALO_HEIGHT, TEXT_HEIGHT = 0.006, 0.007, 0.008
"""Height above the map, in disk diameters: as near as drawing allows, so that no angle of view shifts the lines."""
TEXT_SIZE = {"opening": 0.022, "region": 0.036}
"""Height of the letters, in disk diameters."""
HALO_WIDTH = 0.16
"""Of the light border round letters, in heights of a letter."""
RIM_STEPS = 120
GRID = 60
"""Steps across the disk in the search for the widest place of a region."""

ModelNode = slicer.vtkMRMLModelNode


def updateOverlay(mapNode: ModelNode) -> tuple[ModelNode, ModelNode]:
    """Make or update the lines and the names of a map; returns their nodes.

    Lines: rims and paths. Names: of every opening in its hole (the outer one above the disk), R1, R2, ... in the
    widest place of each region.
    """
    settings = settingsOf(mapNode)
    madeFrom = f"{settings.template} {settings.diskDiameter!r}"
    lines, labels = (_node(mapNode, role, what) for role, what in ((LINES_ROLE, "lines"), (LABELS_ROLE, "names")))
    if lines.GetAttribute(MADE_FROM) != madeFrom or lines.GetPolyData() is None:
        template = templateOf(settings.template)
        lines.SetAndObservePolyData(linesOf(template, settings.diskDiameter))
        labels.SetAndObservePolyData(namesOf(template, settings.diskDiameter))
        for node in (lines, labels):
            node.SetAttribute(MADE_FROM, madeFrom)
    return lines, labels


def overlayOf(mapNode: ModelNode) -> tuple[ModelNode | None, ModelNode | None]:
    """The nodes of lines and names of a map."""
    return mapNode.GetNodeReference(LINES_ROLE), mapNode.GetNodeReference(LABELS_ROLE)


def linesOf(template: Template, diskDiameter: float) -> vtk.vtkPolyData:
    """Rims and paths of a template as lines, mm on the map."""
    anatomy = template.anatomy
    rims = [template.rim(opening).shape.outline(RIM_STEPS) for opening in anatomy.openings]
    chains = [np.concatenate([rim, rim[:1]]) for rim in rims] + [template.segment(path) for path in anatomy.paths]
    append = vtk.vtkAppendPolyData()
    for chain in chains:
        flat = onMap(chain, template, diskDiameter)
        line = vtk.vtkPolyData()
        points = vtk.vtkPoints()
        points.SetData(
            numpy_to_vtk(np.column_stack([flat, np.full(len(flat), LINES_HEIGHT * diskDiameter)]), deep=True)
        )
        cells = vtk.vtkCellArray()
        cells.InsertNextCell(len(flat))
        for k in range(len(flat)):
            cells.InsertCellPoint(k)
        line.SetPoints(points)
        line.SetLines(cells)
        append.AddInputData(line)
    append.Update()
    return append.GetOutput()


def places(template: Template) -> Iterator[tuple[str, np.ndarray, str]]:
    """Each name with the middle of where it is written, map units, and the kind of name: "opening" or "region"."""
    anatomy, outer = template.anatomy, template.outer.shape
    for hole in anatomy.holes:
        yield hole, np.asarray(template.holes[hole].shape.centre), "opening"
    top = outer.outline()[:, 1].max()
    yield anatomy.outer, np.array([outer.centre[0], top + 0.06 * template.radius]), "opening"
    for region in sorted(anatomy.regions):
        yield f"R{region}", widestPlace(template.region_outline(region)), "region"


def widestPlace(outline: np.ndarray) -> np.ndarray:
    """A point inside a polygon (k, 2) that is as far from its border as one on a grid can be, (2,)."""
    low, high = outline.min(axis=0), outline.max(axis=0)
    ticks = [low[k] + (np.arange(GRID) + 0.5) / GRID * (high[k] - low[k]) for k in (0, 1)]
    grid = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 2)
    a, b = outline, np.roll(outline, -1, axis=0)
    spans = (a[:, 1] > grid[:, None, 1]) != (b[:, 1] > grid[:, None, 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (b[:, 0] - a[:, 0]) / (b[:, 1] - a[:, 1])
        left = grid[:, None, 0] < a[:, 0] + (grid[:, None, 1] - a[:, 1]) * slope
    grid = grid[(spans & left).sum(axis=1) % 2 == 1]
    side = b - a
    length2 = np.maximum((side**2).sum(axis=1), 1e-300)
    along = np.clip(((grid[:, None] - a) * side).sum(axis=2) / length2, 0.0, 1.0)
    distance = np.linalg.norm(grid[:, None] - (a + along[:, :, None] * side), axis=2).min(axis=1)
    # Along a strip many places are as good: the middle of them.
    widest = grid[distance >= 0.97 * distance.max()]
    return widest[np.linalg.norm(widest - widest.mean(axis=0), axis=1).argmin()]


def namesOf(template: Template, diskDiameter: float) -> vtk.vtkPolyData:
    """Names as flat letters with a light border, mm on the map; cell array ``colour`` (RGB).

    Letters that are part of the scene keep their size relative to the map when it is zoomed, and cannot be caught by
    the mouse as markups can.
    """
    append = vtk.vtkAppendPolyData()
    for text, place, kind in places(template):
        flat = onMap(place[None], template, diskDiameter)[0]
        size = TEXT_SIZE[kind] * diskDiameter
        letters = _letters(text, flat, size, TEXT_HEIGHT * diskDiameter)
        append.AddInputData(_coloured(_halo(letters, size * HALO_WIDTH, HALO_HEIGHT * diskDiameter), 255))
        append.AddInputData(_coloured(letters, 20))
    append.Update()
    return append.GetOutput()


def _letters(text: str, centre: np.ndarray, size: float, height: float) -> vtk.vtkPolyData:
    """A text as triangles, its capital letters `size` high, centred."""
    source = vtk.vtkVectorText()
    source.SetText(text)
    triangles = vtk.vtkTriangleFilter()
    triangles.SetInputConnection(source.GetOutputPort())
    triangles.PassLinesOff()
    triangles.PassVertsOff()
    triangles.Update()
    letters = vtk.vtkPolyData()
    letters.DeepCopy(triangles.GetOutput())
    points = vtk_to_numpy(letters.GetPoints().GetData()).astype(np.float64)
    low, high = points.min(axis=0), points.max(axis=0)
    flat = (points - 0.5 * (low + high))[:, :2] * (size / (high[1] - low[1])) + centre
    moved = vtk.vtkPoints()
    moved.SetData(numpy_to_vtk(np.column_stack([flat, np.full(len(flat), height)]), deep=True))
    letters.SetPoints(moved)
    return letters


def _halo(letters: vtk.vtkPolyData, width: float, height: float) -> vtk.vtkPolyData:
    """Round patches along the outlines of letters: together a border of a given width."""
    edges = vtk.vtkFeatureEdges()
    edges.SetInputData(letters)
    edges.FeatureEdgesOff()
    edges.NonManifoldEdgesOff()
    edges.ManifoldEdgesOff()
    edges.Update()
    lines = edges.GetOutput()
    ends = np.array(
        [[lines.GetPoint(lines.GetCell(k).GetPointId(end)) for end in (0, 1)] for k in range(lines.GetNumberOfCells())]
    )[:, :, :2]
    turns = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
    ring = 0.5 * width * np.column_stack([np.cos(turns), np.sin(turns)])
    append = vtk.vtkAppendPolyData()
    for start, end in ends:
        along = end - start
        side = np.array([-along[1], along[0]]) / max(float(np.linalg.norm(along)), 1e-12) * 0.5 * width
        for corners in (start + ring, np.array([start - side, end - side, end + side, start + side])):
            patch = vtk.vtkPolyData()
            points = vtk.vtkPoints()
            points.SetData(numpy_to_vtk(np.column_stack([corners, np.full(len(corners), height)]), deep=True))
            patch.SetPoints(points)
            cells = vtk.vtkCellArray()
            cells.InsertNextCell(len(corners))
            for k in range(len(corners)):
                cells.InsertCellPoint(k)
            patch.SetPolys(cells)
            append.AddInputData(patch)
    append.Update()
    return append.GetOutput()


def _coloured(polydata: vtk.vtkPolyData, grey: int) -> vtk.vtkPolyData:
    copy = vtk.vtkPolyData()
    copy.SetPoints(polydata.GetPoints())
    copy.SetPolys(polydata.GetPolys())
    colours = numpy_to_vtk(np.full((copy.GetNumberOfCells(), 3), grey, np.uint8), deep=True)
    colours.SetName("colour")
    copy.GetCellData().AddArray(colours)
    return copy


def _node(mapNode: ModelNode, role: str, what: str) -> ModelNode:
    node = mapNode.GetNodeReference(role)
    if node is not None:
        return node
    scene = mapNode.GetScene()
    node = scene.AddNewNodeByClass("vtkMRMLModelNode", scene.GenerateUniqueName(f"{mapNode.GetName()} {what}"))
    node.SetHideFromEditors(True)
    node.SetSelectable(False)
    node.CreateDefaultDisplayNodes()
    display = node.GetDisplayNode()
    display.SetLighting(False)
    display.SetBackfaceCulling(False)
    display.SetVisibility2D(False)
    display.SetColor(0.08, 0.08, 0.08)
    display.SetLineWidth(2.0)
    if role == LABELS_ROLE:
        display.SetActiveScalar("colour", vtk.vtkAssignAttribute.CELL_DATA)
        display.SetScalarRangeFlag(display.UseDirectMapping)
        display.SetScalarVisibility(True)
    mapNode.SetNodeReferenceID(role, node.GetID())
    return node
