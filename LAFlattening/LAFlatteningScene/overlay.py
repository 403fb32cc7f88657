"""Template lines and names on the map."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
import slicer
import vtk
from scipy.spatial import cKDTree
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

from LAFlatteningLib import Template
from LAFlatteningLib.template import inside_polygon

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
GRID, BORDER_POINTS = 24, 100
"""Steps across a region, and points of its border for as long a way, in the search for its widest place."""

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
    flat = onMap(np.concatenate(chains), template, diskDiameter)
    cells, first = vtk.vtkCellArray(), 0
    for chain in chains:
        cells.InsertNextCell(len(chain), range(first, first + len(chain)))
        first += len(chain)
    lines = vtk.vtkPolyData()
    lines.SetPoints(_points(flat, np.full(len(flat), LINES_HEIGHT * diskDiameter)))
    lines.SetLines(cells)
    return lines


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
    grid = grid[inside_polygon(grid, outline)]
    # The border as points, a few of them for each step of the grid.
    sides = np.roll(outline, -1, axis=0) - outline
    steps = 1 + (BORDER_POINTS * np.linalg.norm(sides, axis=1) / (high - low).max()).astype(int)
    share = np.concatenate([np.arange(count) / count for count in steps])[:, None]
    distance = cKDTree(np.repeat(outline, steps, axis=0) + share * np.repeat(sides, steps, axis=0)).query(grid)[0]
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
        name = vtk.vtkPolyData()
        name.ShallowCopy(_name(text))
        points = vtk_to_numpy(name.GetPoints().GetData())
        flat = points[:, :2] * (TEXT_SIZE[kind] * diskDiameter) + onMap(place[None], template, diskDiameter)
        name.SetPoints(_points(flat, points[:, 2] * diskDiameter))
        append.AddInputData(name)
    append.Update()
    return append.GetOutput()


@cache
def _name(text: str) -> vtk.vtkPolyData:
    """A name with its border, about the origin: x and y in heights of a letter, z in disk diameters."""
    letters = _letters(text)
    append = vtk.vtkAppendPolyData()
    for part, height, grey in ((_halo(letters), HALO_HEIGHT, 255), (letters, TEXT_HEIGHT, 20)):
        flat = vtk_to_numpy(part.GetPoints().GetData())[:, :2]
        raised = vtk.vtkPolyData()
        raised.SetPoints(_points(flat, np.full(len(flat), height)))
        raised.SetPolys(part.GetPolys())
        colours = numpy_to_vtk(np.full((raised.GetNumberOfCells(), 3), grey, np.uint8), deep=True)
        colours.SetName("colour")
        raised.GetCellData().AddArray(colours)
        append.AddInputData(raised)
    append.Update()
    return append.GetOutput()


def _letters(text: str) -> vtk.vtkPolyData:
    """A text as triangles about the origin, its letters 1 high."""
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
    flat = (points - 0.5 * (low + high))[:, :2] / (high[1] - low[1])
    letters.SetPoints(_points(flat, np.zeros(len(flat))))
    return letters


def _halo(letters: vtk.vtkPolyData) -> vtk.vtkPolyData:
    """Round patches along the outlines of letters: together a border, `HALO_WIDTH` wide."""
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
    ring = 0.5 * HALO_WIDTH * np.column_stack([np.cos(turns), np.sin(turns)])
    corners, cells = [], vtk.vtkCellArray()
    first = 0
    for start, end in ends:
        along = end - start
        side = np.array([-along[1], along[0]]) / max(float(np.linalg.norm(along)), 1e-12) * 0.5 * HALO_WIDTH
        for patch in (start + ring, np.array([start - side, end - side, end + side, start + side])):
            cells.InsertNextCell(len(patch), range(first, first + len(patch)))
            corners.append(patch)
            first += len(patch)
    halo = vtk.vtkPolyData()
    flat = np.concatenate(corners)
    halo.SetPoints(_points(flat, np.zeros(len(flat))))
    halo.SetPolys(cells)
    return halo


def _points(flat: np.ndarray, height: np.ndarray) -> vtk.vtkPoints:
    """Points from places (k, 2) and heights (k,)."""
    points = vtk.vtkPoints()
    points.SetData(numpy_to_vtk(np.column_stack([flat, height]), deep=True))
    return points


def _node(mapNode: ModelNode, role: str, what: str) -> ModelNode:
    node = mapNode.GetNodeReference(role)
    if node is None:
        scene = mapNode.GetScene()
        node = scene.AddNewNodeByClass("vtkMRMLModelNode", scene.GenerateUniqueName(f"{mapNode.GetName()} {what}"))
        node.SetHideFromEditors(True)
        node.SetSelectable(False)
        mapNode.SetNodeReferenceID(role, node.GetID())
    if node.GetDisplayNode() is None:
        # New, or somebody has deleted it.
        _prepareDisplay(node, role)
    return node


def _prepareDisplay(node: ModelNode, role: str) -> None:
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
