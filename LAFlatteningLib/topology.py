"""Combinatorics of a triangle mesh: edges, boundary loops, components, manifoldness, orientation.

Plain functions on a triangle array ``(m, 3)`` of point ids; no coordinates are involved.
`LAFlatteningLib.surface.Surface` caches what they return.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from .errors import SurfaceError

IntArray = NDArray[np.int64]


class Edges(NamedTuple):
    """The undirected edges of a mesh and how triangles use them."""

    points: IntArray
    """(e, 2) the two ends of each edge, smaller id first, sorted."""
    of_triangle: IntArray
    """(m, 3) edge ids of each triangle; column k is the edge *opposite* corner k."""
    triangles: IntArray
    """(e, 2) the triangles on each edge; -1 where there is no second one (boundary). Edges with
    more than two triangles list the first two."""
    usage: IntArray
    """(e,) number of triangles on each edge: 1 on the boundary, 2 inside, more where non-manifold."""


def half_edges(triangles: IntArray) -> IntArray:
    """Directed edges of the triangles, (3m, 2): the edge opposite corner 0 of each triangle, then 1, then 2."""
    return np.concatenate([triangles[:, [1, 2]], triangles[:, [2, 0]], triangles[:, [0, 1]]])


def edges(triangles: IntArray) -> Edges:
    """All edges of a mesh with their triangles.

    Parameters
    ----------
    triangles : (m, 3) int array of point ids.
    """
    m = len(triangles)
    corners = np.ascontiguousarray(triangles.T)
    start, end = corners[[1, 2, 0]].reshape(-1), corners[[2, 0, 1]].reshape(-1)
    low, high = np.minimum(start, end), np.maximum(start, end)
    n = int(triangles.max()) + 1 if m else 0
    key = low * n + high
    bits = (3 * m).bit_length()
    if (n * n).bit_length() + bits < 64:
        # Edge and half-edge as one number sort several times faster than rows, or than looking up in which order.
        ordered = np.sort((key << bits) | np.arange(3 * m))
        order, ordered = ordered & ((1 << bits) - 1), ordered >> bits
    else:
        order = np.argsort(key, kind="stable")
        ordered = key[order]
    first = np.ones(3 * m, bool)
    np.not_equal(ordered[1:], ordered[:-1], out=first[1:])
    starts = np.flatnonzero(first)
    count = np.diff(starts, append=3 * m)
    edge_of_half = np.empty(3 * m, np.int64)
    edge_of_half[order] = np.cumsum(first) - 1
    one, other = order[starts], order[np.minimum(starts + 1, 3 * m - 1)]
    pair = np.stack([one, np.where(count > 1, other, -1)], axis=1)
    pair[pair >= m] %= max(m, 1)
    return Edges(np.stack([low[one], high[one]], axis=1), edge_of_half.reshape(3, m).T, pair, count)


def triangle_components(triangles: IntArray, mesh_edges: Edges, blocked: NDArray[np.bool_] | None = None) -> IntArray:
    """Component number of each triangle, (m,), numbered from 0, where triangles sharing an edge are connected.

    Parameters
    ----------
    mesh_edges : what `edges` returned for the same triangles.
    blocked : (e,) edges that do not connect, e.g. those along a cut.
    """
    joins = mesh_edges.usage == 2 if blocked is None else (mesh_edges.usage == 2) & ~blocked
    a, b = mesh_edges.triangles[joins].T
    m = len(triangles)
    graph = sparse.coo_matrix((np.ones(len(a), np.int8), (a, b)), shape=(m, m))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def is_oriented(triangles: IntArray, mesh_edges: Edges) -> bool:
    """Whether neighbouring triangles all turn the same way: they run through their common edge in opposite
    directions."""
    start, end = half_edges(triangles).T
    forward = np.bincount(mesh_edges.of_triangle.T.reshape(-1), start < end)
    return bool((np.abs(2 * forward - mesh_edges.usage) <= mesh_edges.usage % 2).all())


def orient(triangles: IntArray, mesh_edges: Edges) -> IntArray:
    """The same triangles, some reversed, so that neighbours turn the same way.

    The first triangle of each component keeps its direction.

    Raises
    ------
    SurfaceError : if that is impossible (a one-sided surface, like a Möbius strip).
    """
    inner = mesh_edges.usage == 2
    a, b = mesh_edges.triangles[inner].T
    # Neighbours agree when they run through their common edge in opposite directions.
    start = mesh_edges.points[inner, 0]
    end = mesh_edges.points[inner, 1]

    def runs_forward(t: IntArray) -> NDArray[np.bool_]:
        corners = triangles[t]
        following = np.roll(corners, -1, axis=1)
        return ((corners == start[:, None]) & (following == end[:, None])).any(axis=1)

    disagree = runs_forward(a) == runs_forward(b)
    # A double cover of the dual graph: two copies of each triangle, joined crosswise where neighbours disagree.
    m = len(triangles)
    rows = np.concatenate([a, a + m])
    cols = np.concatenate([np.where(disagree, b + m, b), np.where(disagree, b, b + m)])
    graph = sparse.coo_matrix((np.ones(len(rows), np.int8), (rows, cols)), shape=(2 * m, 2 * m))
    label = connected_components(graph, directed=False)[1]
    if (label[:m] == label[m:]).any():
        raise SurfaceError(
            "The surface is one-sided (like a Möbius strip), so it has no outside. Expected an orientable "
            "surface of an atrium; rebuild it from its segmentation."
        )
    component = triangle_components(triangles, mesh_edges)
    _, first = np.unique(component, return_index=True)
    flip = label[:m] != label[first[component]]
    result = triangles.copy()
    result[flip] = result[flip][:, ::-1]
    return result


def non_manifold_points(triangles: IntArray, mesh_edges: Edges) -> IntArray:
    """Ids of points whose triangles do not form one fan (half disk at a rim, disk inside)."""
    bad_edges = mesh_edges.usage > 2
    bad = set(np.unique(mesh_edges.points[bad_edges]).tolist())
    m = len(triangles)
    # Corners (triangle, point) connected through the edges at that point: one component a point is one fan.
    inner = np.flatnonzero(mesh_edges.usage == 2)
    a, b = mesh_edges.triangles[inner].T
    rows, cols = [], []
    for end in (0, 1):
        point = mesh_edges.points[inner, end]
        corner_a = (triangles[a] == point[:, None]).argmax(axis=1)
        corner_b = (triangles[b] == point[:, None]).argmax(axis=1)
        rows.append(3 * a + corner_a)
        cols.append(3 * b + corner_b)
    i, j = np.concatenate(rows), np.concatenate(cols)
    graph = sparse.coo_matrix((np.ones(len(i), np.int8), (i, j)), shape=(3 * m, 3 * m))
    count, fan = connected_components(graph, directed=False)
    point_of_fan = np.empty(count, np.int64)
    point_of_fan[fan] = triangles.reshape(-1)
    bad.update(np.flatnonzero(np.bincount(point_of_fan) > 1).tolist())
    return np.array(sorted(bad), np.int64)


def boundary_loops(triangles: IntArray, mesh_edges: Edges) -> list[IntArray]:
    """The rims of the surface, each an ordered array of point ids, longest first.

    Consecutive ids are joined by a boundary edge, the last with the first. A loop runs in the direction of
    its triangles, so the surface is on its left: counter-clockwise round the outside of a flat mesh,
    clockwise round a hole in it.

    Raises
    ------
    SurfaceError : if rims touch at a point, so that they cannot be told apart, or end, where triangles overlap or do
        not all face the same way.
    """
    single = np.flatnonzero(mesh_edges.usage == 1)
    triangle = mesh_edges.triangles[single, 0]
    corner = (mesh_edges.of_triangle[triangle] == single[:, None]).argmax(axis=1)
    start, end = triangles[triangle, (corner + 1) % 3], triangles[triangle, (corner + 2) % 3]
    if len(np.unique(start)) != len(start):
        ids, times = np.unique(start, return_counts=True)
        shown = ", ".join(str(i) for i in ids[times > 1][:5])
        raise SurfaceError(
            f"Rims of the surface touch at point {shown}. Expected every opening to have a rim of its own; "
            "clean the surface (remove isolated triangles at the rim) or remesh it."
        )
    ends = np.setxor1d(start, end)
    if len(ends):
        raise SurfaceError(
            f"A rim of the surface begins or ends at point {ends[0]}. Expected rims that lead back to their start; "
            "clean the surface (remove triangles that overlap or face the other way) or remesh it."
        )
    successor = dict(zip(start.tolist(), end.tolist(), strict=True))
    loops = []
    while successor:
        first, point = successor.popitem()
        loop = [first]
        while point != first:
            loop.append(point)
            point = successor.pop(point)
        loops.append(np.array(loop, np.int64))
    # Start each loop at its smallest id, so that the result does not depend on the search.
    loops = [np.roll(loop, -int(loop.argmin())) for loop in loops]
    return sorted(loops, key=lambda loop: (-len(loop), int(loop[0])))
