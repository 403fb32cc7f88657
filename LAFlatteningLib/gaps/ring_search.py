"""The closed curve round a vein that leaves scar for as short a way as possible.

Stated without a mesh: among all closed curves that go once round the vein within its search area, the one with the
least length outside scar; among several such, the shortest. This is the path of Nunez-Garcia et al. 2018, with
patches of scar as nodes, the distances between them as edges and free travel within them, but it needs no patches, no
cut through the area and no choice of where to start.

The mesh, cut at the threshold so that every triangle is scar or not, carries a graph: its points, more points along
its edges, and straight ways between them across each triangle (Lanthier, Maheshwari and Sack, "Approximating shortest
paths on weighted polyhedral surfaces", Algorithmica 30, 2001). Once round the vein means from a node to its copy one
turn further in the covering graph, where nodes are numbered by turns. The best curve of a coarse graph is found again
on a fine one beside it (selective refinement: Kanai and Suzuki, CAD 33, 2001).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from .. import topology
from ..surface import FloatArray, IntArray
from .level import CutMesh

SCAR_COST = 1e-3
"""Cost of a mm within scar, against 1 outside: it decides between gaps that are equal to within .001 of the path."""
COARSE_MM, FINE_MM = 0.6, 0.08
"""Distance of the nodes along edges, in the search and beside the best curve."""
MOST_NODES = 10
"""No edge gets more nodes: the error of a line across a triangle goes with the square of their share of the edge."""
EXACT_MM = 2e-4
"""The search ends when no curve can be shorter by more."""


@dataclass(frozen=True, eq=False)
class Centre:
    """What a curve goes round, on the map.

    Attributes
    ----------
    places : (h, 2) centres of the holes. Curves may not pass between them.
    """

    places: FloatArray

    @property
    def middle(self) -> FloatArray:
        """(2,) a place on the line through the centres, by which turns are counted."""
        if len(self.places) == 1:
            return self.places[0]
        return 0.5 * (self.places[0] + self.places[1])

    def angles(self, flat: FloatArray) -> FloatArray:
        """(k,) direction of places (k, 2) on the map from the middle, degrees counter-clockwise from +x, 0 to 360."""
        offset = flat - self.middle
        return np.degrees(np.arctan2(offset[:, 1], offset[:, 0])) % 360.0

    def turns(self, start: FloatArray, stop: FloatArray) -> IntArray:
        """(k,) how often ways (k, 2) to (k, 2) cross the line from the middle to +x, counter-clockwise positive."""
        a, b = start - self.middle, stop - self.middle
        below_a, below_b = a[:, 1] < 0.0, b[:, 1] < 0.0
        right = a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]
        return np.where(below_a & ~below_b & (right > 0.0), 1, np.where(~below_a & below_b & (right < 0.0), -1, 0))

    def crosses_opposite(self, start: FloatArray, stop: FloatArray) -> NDArray[np.bool_]:
        """(k,) whether ways cross the line from the middle to -x."""
        a, b = start - self.middle, stop - self.middle
        right = a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]
        return ((a[:, 1] < 0.0) != (b[:, 1] < 0.0)) & np.where(a[:, 1] < 0.0, right < 0.0, right > 0.0)

    def passes_between(self, start: FloatArray, stop: FloatArray) -> NDArray[np.bool_]:
        """(k,) whether ways pass between the centres."""
        blocked = np.zeros(len(start), bool)
        for p, q in zip(self.places[:-1], self.places[1:], strict=True):
            side = [_side(p, q, place) >= 0.0 for place in (start, stop)]
            ends = [_side(start, stop, np.broadcast_to(place, start.shape)) >= 0.0 for place in (p, q)]
            blocked |= (side[0] != side[1]) & (ends[0] != ends[1])
        return blocked


def _side(p: FloatArray, q: FloatArray, r: FloatArray) -> FloatArray:
    along, offset = q - p, r - p
    return along[..., 0] * offset[..., 1] - along[..., 1] * offset[..., 0]


class Ring(NamedTuple):
    """A closed curve; its last place is not repeated."""

    points: FloatArray
    """(k, 3) mm."""
    flat: FloatArray
    """(k, 2) on the map."""
    in_scar: NDArray[np.bool_]
    """(k,) whether the way from each place to the next is within scar."""

    @property
    def lengths(self) -> FloatArray:
        """(k,) of the way from each place to the next, mm."""
        return np.linalg.norm(np.roll(self.points, -1, axis=0) - self.points, axis=1)


def best_ring(mesh: CutMesh, centre: Centre) -> Ring | None:
    """The closed curve once round a centre with the least length outside scar, and the shortest of those.

    Parameters
    ----------
    mesh : the search area, cut at the threshold.

    Returns
    -------
    Ring, counter-clockwise on the map, or None where the area does not go round the centre.
    """
    found = _search(_Graph.of(mesh, centre, np.full(len(mesh.triangles), COARSE_MM)), centre)
    if found is None:
        return None
    graph, nodes, _ = found
    beside = np.zeros(len(mesh.points), bool)
    # Two rings of triangles beside the curve; scar, where every way is free, needs no finer nodes.
    beside[graph.edge_of_node[nodes].reshape(-1)] = True
    for _ in range(2):
        near = beside[mesh.triangles].any(axis=1)
        beside[mesh.triangles[near]] = True
    strip = CutMesh(mesh.points, mesh.flat, mesh.triangles[near], mesh.above[near])
    found = _search(_Graph.of(strip, centre, np.where(strip.above, COARSE_MM, FINE_MM)), centre)
    assert found is not None
    graph, nodes, in_scar = found
    return Ring(graph.points[nodes], graph.flat[nodes], in_scar)


@dataclass(frozen=True, eq=False)
class _Graph:
    """Straight ways across triangles, in two copies: one before and one after the line where turns are counted."""

    points: FloatArray
    """(n, 3) mm."""
    flat: FloatArray
    """(n, 2)."""
    edge_of_node: IntArray
    """(n, 2) the points of the mesh at the ends of the edge on which a node lies."""
    costs: sparse.csr_matrix
    """(2n, 2n) from node to node."""
    starts: IntArray
    """Nodes of which every curve round the centre passes one."""

    @classmethod
    def of(cls, mesh: CutMesh, centre: Centre, spacing: FloatArray) -> _Graph:
        """The graph with nodes so far apart, mm, along the edges of each triangle (t,)."""
        edges = topology.edges(mesh.triangles)
        a, b = edges.points.T
        length = np.linalg.norm(mesh.points[b] - mesh.points[a], axis=1)
        apart = np.full(len(a), np.inf)
        np.minimum.at(apart, edges.of_triangle, spacing[:, None])
        count = np.clip(np.ceil(length / apart).astype(np.int64) - 1, 0, MOST_NODES)
        first = len(mesh.points) + np.concatenate([[0], np.cumsum(count)[:-1]])
        edge, index = _ranges(count)
        share = ((index + 1) / (count[edge] + 1))[:, None]
        points = np.concatenate([mesh.points, (1 - share) * mesh.points[a[edge]] + share * mesh.points[b[edge]]])
        flat = np.concatenate([mesh.flat, (1 - share) * mesh.flat[a[edge]] + share * mesh.flat[b[edge]]])
        own = np.arange(len(mesh.points))
        edge_of_node = np.concatenate([np.stack([own, own], axis=1), edges.points[edge]])

        scar_edge = np.zeros(len(a), bool)
        scar_edge[edges.of_triangle[mesh.above]] = True
        starts, stops, scar = [], [], []
        # Along the edges, from one node to the next.
        e, k = _ranges(count + 1)
        starts.append(np.where(k == 0, a[e], first[e] + k - 1))
        stops.append(np.where(k == count[e], b[e], first[e] + k))
        scar.append(scar_edge[e])
        for corner in range(3):
            # Edge `corner` is opposite that corner: from the corner to it, and from the next edge to it.
            here = edges.of_triangle[:, corner]
            triangle, k = _ranges(count[here])
            starts.append(mesh.triangles[triangle, corner])
            stops.append(first[here[triangle]] + k)
            scar.append(mesh.above[triangle])
            there = edges.of_triangle[:, (corner + 1) % 3]
            triangle, k = _ranges(count[here] * count[there])
            starts.append(first[here[triangle]] + k // np.maximum(count[there[triangle]], 1))
            stops.append(first[there[triangle]] + k % np.maximum(count[there[triangle]], 1))
            scar.append(mesh.above[triangle])
        start, stop, in_scar = np.concatenate(starts), np.concatenate(stops), np.concatenate(scar)
        free = ~centre.passes_between(flat[start], flat[stop])
        start, stop, in_scar = start[free], stop[free], in_scar[free]
        cost = np.linalg.norm(points[stop] - points[start], axis=1) * np.where(in_scar, SCAR_COST, 1.0)
        turn = centre.turns(flat[start], flat[stop])
        n = len(points)
        rows, columns, values = [], [], []
        for sheet in (0, 1):
            onward = sheet + turn
            inside = (onward >= 0) & (onward <= 1)
            rows.append(start[inside] + sheet * n)
            columns.append(stop[inside] + onward[inside] * n)
            values.append(np.maximum(cost[inside], 1e-12))
        row, column, value = np.concatenate(rows), np.concatenate(columns), np.concatenate(values)
        both = (np.concatenate([value, value]), (np.concatenate([row, column]), np.concatenate([column, row])))
        crossed = centre.crosses_opposite(flat[start], flat[stop])
        upper = np.where(flat[start, 1] >= centre.middle[1], start, stop)
        return cls(points, flat, edge_of_node, sparse.csr_matrix(both, shape=(2 * n, 2 * n)), np.unique(upper[crossed]))


def _ranges(count: IntArray) -> tuple[IntArray, IntArray]:
    """0 to count - 1 for each entry, one after another: the entry's number, and the number within it."""
    of = np.repeat(np.arange(len(count)), count)
    return of, np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)


def _search(graph: _Graph, centre: Centre) -> tuple[_Graph, IntArray, NDArray[np.bool_]] | None:
    """The cheapest closed walk: its nodes in order, and whether each way from one to the next is within scar.

    A walk through a start costs at least what the best through another start costs, less the way there and back: so
    most starts need not be tried.
    """
    n, starts = len(graph.points), graph.starts
    least = np.zeros(len(starts))
    best, kept = np.inf, None
    while len(starts):
        at = int(least.argmin())
        if least[at] >= best - EXACT_MM:
            break
        c = int(starts[at])
        cost, before = dijkstra(graph.costs, indices=c, limit=best, return_predecessors=True)
        if cost[c + n] < best:
            best, kept = float(cost[c + n]), (c, cost, before)
        # No walk was found where it would cost more than the best.
        around = min(float(cost[c + n]), best)
        reached = np.isfinite(cost[starts])
        least[reached] = np.maximum(least[reached], around - 2.0 * cost[starts[reached]])
        least[at] = np.inf
    if kept is None:
        return None
    c, cost, before = kept
    walk = [c + n]
    while walk[-1] != c:
        walk.append(int(before[walk[-1]]))
    nodes = np.array(walk[::-1])
    length = np.linalg.norm(np.diff(graph.points[nodes % n], axis=0), axis=1)
    in_scar = np.diff(cost[nodes]) < 0.5 * length
    return graph, nodes[:-1] % n, in_scar
