"""The shortest closed line on a surface that does not cut it in two.

A tree of triangles and a tree of points that crosses none of its steps leave 2 g edges, one for each way to go round a
handle (the tree-cotree decomposition: Eppstein 2003). Each gives a closed strip of triangles. A closed line of edges
separates the surface only if it crosses each strip as often to the left as to the right, so those that do not separate
can be told by counting crossings; and each of them passes a point beside a strip. Shortest paths from all these
points therefore find the shortest such line, after Erickson and Whittlesey, "Greedy optimal homotopy and homology
generators", SODA 2005.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import breadth_first_order, connected_components, dijkstra, minimum_spanning_tree

from .. import topology
from ..errors import SurfaceError
from ..progress import ProgressCallback, report
from ..surface import FloatArray, IntArray, Surface

GROUP = 16
"""Points from which paths are sought at a time."""


def shortest_loop(surface: Surface, progress: ProgressCallback | None = None) -> IntArray:
    """The shortest closed line along edges that does not separate the surface.

    Parameters
    ----------
    surface : an oriented manifold of one piece with at least one handle, closed or open. Openings count as covered,
        so that a line round an opening separates; no line touches a rim.

    Returns
    -------
    (k,) point ids in order, k >= 3. No edge of the surface joins two of them but those of the line.

    Raises
    ------
    SurfaceError : no such line stays off the rims.
    """
    crossing = _crossings(surface)
    graph = _Graph.of(surface, crossing)
    roots = np.unique(graph.ends[graph.crossing != 0, 0])
    best = _Found(np.inf, np.zeros(0, np.int64))
    # A few roots first: what they find limits how far the others have to look.
    done = np.zeros(len(roots), bool)
    for round_number, stride in enumerate((max(1, len(roots) // 4), max(1, len(roots) // 40), 1)):
        chosen = np.zeros(len(roots), bool)
        chosen[::stride] = True
        chosen &= ~done
        done |= chosen
        best = _search(graph, roots[chosen], best)
        report(progress, (round_number + 1) / 3, "Looking for handles")
    if not np.isfinite(best.length):
        raise SurfaceError(
            "The surface has a handle (like the handle of a cup) that cannot be gone round without touching a rim. "
            "Separate veins that touch in the segmentation, and make the surface again."
        )
    return _without_chords(graph, best.loop)


def shortest_across(surface: Surface, loop: IntArray, longest: float) -> IntArray | None:
    """The shortest closed line along edges that crosses another one, to one side once more than to the other.

    Parameters
    ----------
    loop : (k,) point ids in order, without chords, off the rims, as `shortest_loop` returns.
    longest : only shorter lines count, mm.

    Returns
    -------
    (j,) point ids in order, without chords; None if there is no such line.
    """
    on_line = np.zeros(len(surface.points), bool)
    on_line[loop] = True
    strip = np.flatnonzero(on_line[surface.triangles].any(axis=1))
    left = np.zeros(len(surface.triangles), bool)
    left[strip] = left_of(surface, loop, strip)
    # Leaving the line to the left counts as a crossing.
    edges = surface.edges
    beside = on_line[edges.points]
    crossing = np.where(left[edges.triangles[:, 0]] & (beside.sum(axis=1) == 1), np.where(beside[:, 0], 1, -1), 0)
    graph = _Graph.of(surface, crossing)
    found = _search(graph, np.sort(loop), _Found(longest, np.zeros(0, np.int64)))
    return _without_chords(graph, found.loop) if len(found.loop) else None


def left_of(surface: Surface, loop: IntArray, strip: IntArray) -> NDArray[np.bool_]:
    """Which of the triangles that touch a closed line lie on its left.

    Parameters
    ----------
    loop : (k,) point ids in order, as `shortest_loop` returns.
    strip : (s,) ids of the triangles that have a point of the line.

    Returns
    -------
    (s,) bool.
    """
    ends = surface.edges.points
    n = len(surface.points)
    following = np.roll(loop, -1)
    key = np.minimum(loop, following) * n + np.maximum(loop, following)
    blocked = np.isin(ends[:, 0] * n + ends[:, 1], key)
    number = np.full(len(surface.triangles), -1, np.int64)
    number[strip] = np.arange(len(strip))
    joins = number[surface.edges.triangles[(surface.edges.usage == 2) & ~blocked]]
    joins = joins[(joins >= 0).all(axis=1)]
    # Fans of one side meet only at points of the line, so triangles of the strip connect round each point.
    graph = sparse.coo_matrix((np.ones(len(joins), np.int8), tuple(joins.T)), shape=(len(strip), len(strip)))
    label = connected_components(graph, directed=False)[1]
    half = topology.half_edges(surface.triangles[strip])
    forward = np.isin(half[:, 0] * n + half[:, 1], loop * n + following).reshape(3, -1).any(axis=0)
    return np.isin(label, label[forward])


class _Found(NamedTuple):
    length: float
    loop: IntArray


class _Graph(NamedTuple):
    """The edges that lines may use."""

    points: FloatArray
    """(n, 3), mm"""
    ends: IntArray
    """(e, 2), smaller id first, sorted."""
    length: FloatArray
    crossing: IntArray
    """(e,) signed number of strips that the edge crosses from its smaller to its larger id, as one number."""

    @classmethod
    def of(cls, surface: Surface, crossing: IntArray) -> _Graph:
        edges = surface.edges
        on_rim = np.zeros(len(surface.points), bool)
        on_rim[edges.points[edges.usage == 1]] = True
        free = ~on_rim[edges.points].any(axis=1)
        return cls(surface.points, edges.points[free], surface.edge_lengths[free], crossing[free])

    @property
    def size(self) -> int:
        """Number of points."""
        return len(self.points)

    def near(self, roots: IntArray, reach: float) -> tuple[_Graph, IntArray]:
        """The part that paths of some length from some points reach, and the ids of its points here."""
        if not np.isfinite(reach):
            return self, np.arange(self.size)
        distance = dijkstra(self.matrix(), indices=roots, limit=reach, min_only=True)
        return self._part(np.isfinite(distance))

    def in_box(self, roots: IntArray, reach: float) -> tuple[_Graph, IntArray]:
        """As `near`, but quickly, and with more: all in a box round the points."""
        corner = self.points[roots]
        inside = (self.points >= corner.min(axis=0) - reach) & (self.points <= corner.max(axis=0) + reach)
        return self._part(inside.all(axis=1))

    def _part(self, keep: NDArray[np.bool_]) -> tuple[_Graph, IntArray]:
        ids = np.flatnonzero(keep)
        number = np.full(self.size, -1, np.int64)
        number[ids] = np.arange(len(ids))
        kept = keep[self.ends[:, 0]] & keep[self.ends[:, 1]]
        return _Graph(self.points[ids], number[self.ends[kept]], self.length[kept], self.crossing[kept]), ids

    def matrix(self) -> sparse.csr_matrix:
        a, b = self.ends.T
        # An edge of length 0 would be no edge of a sparse matrix.
        length = np.maximum(self.length, 1e-12)
        return sparse.csr_matrix(
            (np.concatenate([length, length]), (np.concatenate([a, b]), np.concatenate([b, a]))),
            shape=(self.size, self.size),
        )

    def crossings(self, a: IntArray, b: IntArray) -> IntArray:
        """Of the steps from points a to points b, which are joined by edges."""
        key = np.minimum(a, b) * self.size + np.maximum(a, b)
        number = np.searchsorted(self.ends[:, 0] * self.size + self.ends[:, 1], key)
        return np.where(a < b, 1, -1) * self.crossing[number]


def _crossings(surface: Surface) -> IntArray:
    """(e,) for each edge, from its smaller to its larger id, the strips that it crosses.

    The 2 g counts are added with random weights (and wrap around): sums for two lines are equal where the counts are,
    and otherwise differ but for one chance in some 10^18.
    """
    triangles = _covered(surface)
    edges = surface.edges if triangles is surface.triangles else topology.edges(triangles)
    m, e = len(triangles), len(edges.points)
    one, two = edges.triangles.T
    # Which of the two triangles runs along the edge from its smaller to its larger id.
    start, end = topology.half_edges(triangles).T
    forward = np.full(e, -1, np.int64)
    runs = start < end
    forward[edges.of_triangle.T.reshape(-1)[runs]] = np.tile(np.arange(m), 3)[runs]
    backward = one + two - forward

    number = np.arange(e)
    dual = sparse.csr_matrix(
        (np.tile(number + 1, 2), (np.concatenate([one, two]), np.concatenate([two, one]))), shape=(m, m)
    )
    order, before = breadth_first_order(dual, 0, directed=True)
    before = before.astype(np.int64)
    steps = np.asarray(dual[order[1:], before[order[1:]]]).ravel() - 1
    step_to = np.full(m, -1, np.int64)
    step_to[order[1:]] = steps
    depth = np.zeros(m)
    depth[order[1:]] = _sum_to_root(before, np.where(before >= 0, 1, 0))[order[1:]]

    # The tree of points takes edges whose strip would be long, so that those left over have short ones.
    free = np.ones(e, bool)
    free[steps] = False
    span = depth[one] + depth[two]
    weight = span.max() + 1.0 - span[free]
    n = int(triangles.max()) + 1
    candidates = sparse.csr_matrix((weight, tuple(edges.points[free].T)), shape=(n, n))
    tree = minimum_spanning_tree(candidates).tocoo()
    key = edges.points[:, 0] * n + edges.points[:, 1]
    in_tree = np.minimum(tree.row, tree.col).astype(np.int64) * n + np.maximum(tree.row, tree.col)
    left_over = np.flatnonzero(free & ~np.isin(key, in_tree))

    crossing = np.zeros(e, np.int64)
    random = np.random.default_rng(0).integers(-(2**62), 2**62, len(left_over))
    for edge, value in zip(left_over.tolist(), random.tolist(), strict=True):
        # Across the edge, up to the root, and down again; where both ways are the same, they cancel.
        _add(crossing, edge, value)
        for triangle, sign in ((int(backward[edge]), 1), (int(forward[edge]), -1)):
            while before[triangle] >= 0:
                step = step_to[triangle]
                _add(crossing, step, sign * value if forward[step] == triangle else -sign * value)
                triangle = before[triangle]
    # Edges of the surface keep their order among those of the covered one.
    return crossing[edges.points[:, 1] < len(surface.points)]


def _add(total: IntArray, place: int, value: int) -> None:
    total[place] = (int(total[place]) + value + 2**63) % 2**64 - 2**63


def _covered(surface: Surface) -> IntArray:
    """The triangles, with a fan over each opening round a further point."""
    if not surface.boundary_loops:
        return surface.triangles
    triangles = [surface.triangles]
    n = len(surface.points)
    for number, rim in enumerate(surface.boundary_loops):
        triangles.append(np.column_stack([np.roll(rim, -1), rim, np.full(len(rim), n + number)]))
    return np.concatenate(triangles)


def _sum_to_root(before: IntArray, values: IntArray) -> IntArray:
    """Sum of values (..., n) from each point of a tree up to its root (whose `before` is negative), by doubling."""
    total = values.copy()
    root = before < 0
    up = np.where(root, np.arange(before.shape[-1]), before)
    total[root] = 0
    while True:
        higher = np.take_along_axis(up, up, axis=-1)
        total = total + np.take_along_axis(total, up, axis=-1)
        if (higher == up).all():
            return total
        up = higher


def _search(graph: _Graph, roots: IntArray, best: _Found) -> _Found:
    """The shortest loop through one of some points that does not separate, if it is shorter than the best so far."""
    if len(roots) == 0:
        return best
    around, ids = graph.near(roots, best.length / 2.0)
    number = np.full(graph.size, -1, np.int64)
    number[ids] = np.arange(len(ids))
    for group in _together(around.points, number[roots], best.length):
        # Balls round points of one group overlap, so that the part of the surface to look at is small.
        local, inner_ids = around.in_box(group, best.length / 2.0)
        inner_number = np.full(around.size, -1, np.int64)
        inner_number[inner_ids] = np.arange(len(inner_ids))
        batch = inner_number[group]
        matrix = local.matrix()
        distance, before = dijkstra(matrix, indices=batch, limit=best.length / 2.0, return_predecessors=True)
        before = before.astype(np.int64)
        row, point = np.nonzero(before >= 0)
        step = np.zeros(before.shape, np.int64)
        step[row, point] = local.crossings(before[row, point], point)
        total = _sum_to_root(before, step)
        a, b = local.ends.T
        length = distance[:, a] + distance[:, b] + local.length
        length[total[:, a] + local.crossing == total[:, b]] = np.inf
        if length.size == 0:
            continue
        k, edge = np.unravel_index(length.argmin(), length.shape)
        if length[k, edge] < best.length:
            best = _Found(float(length[k, edge]), ids[inner_ids[_loop(before[k], int(a[edge]), int(b[edge]))]])
    return best


def _together(points: FloatArray, roots: IntArray, size: float) -> list[IntArray]:
    """Points in groups of at most `GROUP`, each in a cube of some size."""
    cell = np.zeros(len(roots), np.int64)
    if np.isfinite(size):
        corner = np.floor(points[roots] / size).astype(np.int64)
        cell = np.unique(corner, axis=0, return_inverse=True)[1].reshape(-1)
    order = np.argsort(cell, kind="stable")
    groups = np.split(roots[order], np.flatnonzero(np.diff(cell[order])) + 1)
    return [group[first : first + GROUP] for group in groups for first in range(0, len(group), GROUP)]


def _loop(before: IntArray, a: int, b: int) -> IntArray:
    """Up the tree from a and from b, to where they meet."""
    ways = []
    for point in (a, b):
        way = [point]
        while before[way[-1]] >= 0:
            way.append(int(before[way[-1]]))
        ways.append(way[::-1])
    common = 0
    while common + 1 < min(map(len, ways)) and ways[0][common + 1] == ways[1][common + 1]:
        common += 1
    return np.array(ways[0][common:] + ways[1][common + 1 :][::-1], np.int64)


def _without_chords(graph: _Graph, loop: IntArray) -> IntArray:
    """Cut a loop short at edges between its points; of the two parts, the shorter that does not separate."""
    while True:
        place = np.full(graph.size, -1, np.int64)
        place[loop] = np.arange(len(loop))
        ends = np.sort(place[graph.ends[(place[graph.ends] >= 0).all(axis=1)]], axis=1)
        apart = ends[:, 1] - ends[:, 0]
        chords = ends[(apart > 1) & (apart < len(loop) - 1)]
        if len(chords) == 0:
            return loop
        i, j = chords[0]
        parts = [loop[i : j + 1], np.concatenate([loop[j:], loop[: i + 1]])]
        crosses = [graph.crossings(part, np.roll(part, -1)).sum() != 0 for part in parts]
        loop = min((part for part, cross in zip(parts, crosses, strict=True) if cross), key=len)
