"""Where sheets of a surface touch or grow together in points and edges: taken apart."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from .. import topology
from ..surface import FloatArray, IntArray, Surface

NUDGE_SHARE = 0.05
"""Points that were one are moved apart by so much of the way to their neighbours, so that they do not coincide."""


def flaps(surface: Surface) -> IntArray:
    """Ids of the triangles that hang on an edge with more than two triangles and have a free edge themselves."""
    usage = surface.edges.usage[surface.edges.of_triangle]
    return np.flatnonzero((usage > 2).any(axis=1) & (usage == 1).any(axis=1))


def separate_sheets(surface: Surface, keep_lumen: bool = True) -> tuple[Surface, IntArray]:
    """Give each sheet its own points wherever several meet in a point or an edge.

    Triangles round a point belong to one sheet if they hang together through edges. At an edge with more than two
    triangles, those hang together that have only lumen, or only room outside, between them; any left over keep a free
    edge there. The largest sheet (by number of triangles) keeps the point, and the
    points of the others move a little towards their own neighbours.

    Parameters
    ----------
    surface : triangles turned the same way (`topology.orient`).
    keep_lumen : True takes apart veins that touch along an edge from outside; False, a wall that has become so thin
        that its two sides touch.

    Returns
    -------
    surface : the same triangles; the new points follow the old ones, with their data.
    points : ids of the points that were divided.
    """
    triangles, edges = surface.triangles, surface.edges
    m = len(triangles)
    inner = np.flatnonzero(edges.usage == 2)
    joins = [np.column_stack([inner, edges.triangles[inner]])]
    for edge in np.flatnonzero(edges.usage > 2).tolist():
        joins.extend(np.array([[edge, a, b]]) for a, b in _pairs(surface, edge, keep_lumen))
    edge_of, one, two = np.concatenate(joins).T
    rows, columns = [], []
    for end in (0, 1):
        point = edges.points[edge_of, end]
        rows.append(3 * one + (triangles[one] == point[:, None]).argmax(axis=1))
        columns.append(3 * two + (triangles[two] == point[:, None]).argmax(axis=1))
    i, j = np.concatenate(rows), np.concatenate(columns)
    graph = sparse.coo_matrix((np.ones(len(i), np.int8), (i, j)), shape=(3 * m, 3 * m))
    count, fan = connected_components(graph, directed=False)
    corners = triangles.reshape(-1)
    size = np.bincount(fan)
    point_of = np.empty(count, np.int64)
    point_of[fan] = corners
    # The largest fan of each point comes first.
    order = np.lexsort((np.arange(count), -size, point_of))
    first = np.concatenate([[True], np.diff(point_of[order]) != 0])
    others = order[~first]
    divided = np.unique(point_of[others])
    if len(others) == 0:
        return surface, divided
    n = len(surface.points)
    new_id = point_of.copy()
    new_id[others] = n + np.arange(len(others))
    source = np.concatenate([np.arange(n), point_of[others]])
    points = surface.points[source].copy()
    new_triangles = new_id[fan].reshape(-1, 3)
    for copy in range(n, len(points)):
        own = new_triangles[(new_triangles == copy).any(axis=1)]
        points[copy] += NUDGE_SHARE * (surface.points[source[own[own != copy]]].mean(axis=0) - points[copy])
    result = Surface(
        points,
        new_triangles,
        {name: values[source] for name, values in surface.point_data.items()},
        surface.cell_data,
        surface.field_data,
        surface.space,
    )
    return result, divided


def _pairs(surface: Surface, edge: int, keep_lumen: bool) -> list[tuple[int, int]]:
    """Pairs of triangles on an edge with only lumen, or only room outside, between them; none twice."""
    a, b = surface.edges.points[edge]
    around = np.flatnonzero((surface.edges.of_triangle == edge).any(axis=1))
    corner = surface.triangles[around]
    third = corner[(corner != a) & (corner != b)]
    forward = ((corner == a) & (np.roll(corner, -1, axis=1) == b)).any(axis=1)
    axis = surface.points[b] - surface.points[a]
    axis = axis / max(float(np.linalg.norm(axis)), np.finfo(float).tiny)
    arm = surface.points[third] - surface.points[a]
    u = _perpendicular(axis)
    angle = np.arctan2(arm @ np.cross(axis, u), arm @ u)
    order = np.argsort(angle)
    # Turning about the edge, the lumen follows a triangle that runs backwards along it and ends at one that runs
    # forwards.
    return [
        (int(around[k]), int(around[following]))
        for k, following in zip(order, np.roll(order, -1), strict=True)
        if forward[k] != keep_lumen and forward[following] == keep_lumen
    ]


def _perpendicular(axis: FloatArray) -> FloatArray:
    other = np.eye(3)[np.abs(axis).argmin()]
    u = np.cross(axis, other)
    return u / max(float(np.linalg.norm(u)), np.finfo(float).tiny)


def turned_alike(surface: Surface) -> Surface:
    """The surface with triangles turned the same way, as most of them are; the same object if they are.

    Raises
    ------
    SurfaceError : a one-sided surface.
    """
    if surface.is_oriented:
        return surface
    triangles = topology.orient(surface.triangles, surface.edges)
    if (triangles != surface.triangles).any(axis=1).mean() > 0.5:
        triangles = triangles[:, ::-1]
    return surface.with_triangles(triangles)
