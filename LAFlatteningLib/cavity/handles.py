"""Handles of a surface: found, located, and cut away with the smallest cut.

Where two veins touch, a segmentation runs them together by a bridge. The surface then has a handle: a loop round the
bridge, and a loop through the tunnel beside it, do not part the surface. Either loop can be cut and covered on both
sides. Round the bridge, this takes the bridge away; round the tunnel, it fills the tunnel. The shorter loop is cut,
because what changes is about the disc that the loop bounds.

Loops come from the tree-cotree decomposition: shortest paths from a point, and the maximum spanning tree of the dual
graph beside them. Each edge in neither closes a loop that does not part the surface, and the shortest such loop through
the point is among them (J. Erickson and K. Whittlesey, "Greedy optimal homotopy and homology generators", SODA 2005).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components, dijkstra, minimum_spanning_tree
from scipy.spatial import ConvexHull, QhullError

from .. import topology
from ..errors import SurfaceError
from ..progress import ProgressCallback, report
from ..surface import Surface
from .covers import HOLE_ARRAY, close_rims, cover_rim

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

LIMIT = 8.0
"""A bridge or tunnel wider than this is no artefact, mm: it is as wide as a small pulmonary vein."""

_ROOTS = 8
_BESIDE = 16
_LOOPS = 4


@dataclass(frozen=True, eq=False)
class Handle:
    """A handle that was cut away.

    Attributes
    ----------
    place_mm : (3,) centre of the loop, in the axes of the surface.
    width_mm : perimeter / pi of the loop's convex outline in its plane; the diameter, if it is round.
    loop_mm : length of the loop along edges.
    kind : "bridge" was cut through, "tunnel" was filled.
    loop : (k, 3) the loop's points, mm.
    space : "LPS" or "RAS", the axes of places.
    """

    place_mm: FloatArray
    width_mm: float
    loop_mm: float
    kind: Literal["bridge", "tunnel"]
    loop: FloatArray
    space: str

    def __str__(self) -> str:
        x, y, z = self.place_mm
        return f"{self.kind} {self.width_mm:.1f} mm wide at ({x:.1f}, {y:.1f}, {z:.1f}) mm {self.space}"


def remove_handles(
    surface: Surface, limit_mm: float = LIMIT, progress: ProgressCallback | None = None
) -> tuple[Surface, tuple[Handle, ...]]:
    """Cut away every handle, each along the shortest loop found.

    Points of the surface stay where they are, except that the triangles along each loop give way to two covers.

    Parameters
    ----------
    surface : manifold, oriented and in one piece, closed or open.
    limit_mm : widest handle to cut, mm; see `LIMIT`.

    Returns
    -------
    surface : of genus 0; the same object where there is no handle. Arrays continue on covers as in `close_rims`.
    handles : in the order in which they were cut.

    Raises
    ------
    SurfaceError : not manifold, not oriented, several pieces, a handle wider than the limit, or one that cannot be cut.
    Cancelled : the progress callback answered False.
    """
    if not surface.is_manifold or not surface.is_oriented or surface.component_count > 1:
        raise SurfaceError(
            "Handles can be found on a manifold, oriented surface in one piece only. Heal the surface first."
        )
    handles: list[Handle] = []
    total = surface.genus
    while surface.genus > 0:
        report(progress, len(handles) / total, f"Cutting handle {len(handles) + 1} of {total}")
        closed, centres = _closed_by_fans(surface)
        loop = _shortest_loop(_Search.of(closed, centres))
        if loop is None:
            raise SurfaceError(
                f"The surface has {surface.genus} handle(s) round its openings that no loop inside it cuts. "
                "Close the openings first."
            )
        handle = _describe(surface, closed, loop)
        if handle.width_mm > limit_mm:
            raise SurfaceError(
                f"The surface has a handle: a {handle}. That is too wide for an artefact (limit {limit_mm:g} mm), so "
                "it is not cut by itself. Part the structures there in the segmentation."
            )
        genus = surface.genus
        surface = _cut(surface, loop, handle)
        if surface.genus != genus - 1 or surface.component_count > 1 or not surface.is_manifold:
            raise SurfaceError(f"The handle, a {handle}, cannot be cut. Part the structures there in the segmentation.")
        handles.append(handle)
    report(progress, 1.0, "Handles")
    return surface, tuple(handles)


def _closed_by_fans(surface: Surface) -> tuple[Surface, BoolArray]:
    """The surface with a fan over each opening, and which points loops must not pass (rims and fans)."""
    n, loops = len(surface.points), surface.boundary_loops
    if not loops:
        return surface, np.zeros(n, bool)
    centres = np.array([surface.points[loop].mean(axis=0) for loop in loops])
    fans = [np.stack([np.roll(loop, -1), loop, np.full(len(loop), n + k)], 1) for k, loop in enumerate(loops)]
    closed = Surface(np.concatenate([surface.points, centres]), np.concatenate([surface.triangles, *fans]))
    barred = np.zeros(n + len(loops), bool)
    barred[np.concatenate(loops)] = True
    barred[n:] = True
    return closed, barred


class _Loop(NamedTuple):
    length: float
    points: IntArray


@dataclass(frozen=True, eq=False)
class _Search:
    """Looks for short loops through a point of a closed surface."""

    surface: Surface
    graph: sparse.csr_matrix
    barred: BoolArray

    @classmethod
    def of(cls, surface: Surface, barred: BoolArray) -> _Search:
        ends, length = surface.edges.points, surface.edge_lengths
        free = ~barred[ends].any(axis=1)
        n = len(surface.points)
        # Edges of length 0 would be no edges to scipy.
        weight = np.maximum(length[free], 1e-9)
        half = sparse.coo_matrix((weight, (ends[free, 0], ends[free, 1])), shape=(n, n))
        return cls(surface, (half + half.T).tocsr(), barred)

    def loops(self, root: int, limit: float = np.inf) -> list[_Loop]:
        """Loops that do not part the surface, at most about twice `limit` long, shortest first."""
        distance, before = dijkstra(self.graph, indices=root, return_predecessors=True, limit=limit)
        edges = self.surface.edges
        u, v = edges.points.T
        tree = (before[u] == v) | (before[v] == u)
        through = distance[u] + distance[v] + self.surface.edge_lengths
        inner = np.isfinite(distance)[self.surface.triangles].all(axis=1)
        candidate = ~tree & np.isfinite(through) & inner[edges.triangles].all(axis=1)
        # Edges that close no loop come first into the dual tree: they join triangles to areas.
        m = len(self.surface.triangles)
        a, b = edges.triangles[~tree & ~candidate].T
        joined = sparse.coo_matrix((np.ones(len(a), np.int8), (a, b)), shape=(m, m))
        count, area = connected_components(joined, directed=False)
        ids = np.flatnonzero(candidate)
        pair = np.sort(area[edges.triangles[ids]], axis=1).astype(np.int64)
        key = pair[:, 0] * count + pair[:, 1]
        # Of several edges between two areas, the one that closes the longest loop.
        order = np.lexsort([-through[ids], key])
        first = order[np.concatenate([[True], np.diff(key[order]) != 0])] if len(order) else order
        first = first[pair[first, 0] != pair[first, 1]]
        weight = (through[ids].max() if len(ids) else 0.0) - through[ids[first]] + 1.0
        dual = sparse.coo_matrix((weight, (pair[first, 0], pair[first, 1])), shape=(count, count))
        kept = minimum_spanning_tree(dual.tocsr()).tocoo()
        kept_key = np.minimum(kept.row, kept.col).astype(np.int64) * count + np.maximum(kept.row, kept.col)
        in_cotree = np.zeros(len(ids), bool)
        in_cotree[first[np.isin(key[first], kept_key)]] = True
        left = ids[~in_cotree]
        left = left[np.argsort(through[left])][:50]
        found = [self._trimmed(before, root, int(u[e]), int(v[e])) for e in left]
        return sorted((loop for loop in found if len(loop.points) >= 3), key=lambda loop: loop.length)

    def _trimmed(self, before: IntArray, root: int, u: int, v: int) -> _Loop:
        """The loop that an edge closes, without the way that both its sides share."""

        def way(point: int) -> list[int]:
            path = [point]
            while path[-1] != root:
                path.append(int(before[path[-1]]))
            return path

        one, two = way(u), way(v)
        while len(one) > 1 and len(two) > 1 and one[-2] == two[-2]:
            one.pop()
            two.pop()
        points = np.array(one[::-1] + two[:-1], np.int64)
        return _Loop(self.surface.loop_length(points), points)


def _shortest_loop(search: _Search) -> IntArray | None:
    """A short loop that does not part the surface: loops from anywhere, then from points on the best ones."""
    start = search.loops(int(np.flatnonzero(~search.barred)[0]))[:_LOOPS]
    best: _Loop | None = None
    longest = float(search.surface.edge_lengths.max())
    for loop in start:
        improved = True
        while improved:
            improved = False
            # Nothing longer than the best loop so far is of interest, and small neighbourhoods are quick.
            reach = 0.55 * min(loop.length, best.length if best else np.inf) + 2.0 * longest
            # A bridge's loop is met by a loop through its tunnel: points all along it are tried, far ones first.
            count = len(loop.points)
            roots = loop.points[np.unique(np.linspace(0, count, _ROOTS, endpoint=False).astype(int))]
            for root in roots[np.argsort(np.arange(len(roots)) % 2, kind="stable")[::-1]]:
                near = search.loops(int(root), reach)
                if near and near[0].length < loop.length - 1e-9:
                    loop, improved = near[0], True
                    break
        if best is None or loop.length < best.length:
            best = loop
    return None if best is None else _tightened(search, best).points


def _tightened(search: _Search, loop: _Loop) -> _Loop:
    """Move a loop along its tube to a narrower place: loops from points beside it, while they get shorter."""
    longest = float(search.surface.edge_lengths.max())
    improved = True
    while improved:
        improved = False
        distance = dijkstra(search.graph, indices=loop.points[0], limit=0.4 * loop.length + 2.0 * longest)
        beside = np.setdiff1d(np.flatnonzero(np.isfinite(distance)), loop.points)
        for root in beside[:: max(1, len(beside) // _BESIDE)]:
            near = search.loops(int(root), 0.75 * loop.length + 2.0 * longest)
            if near and near[0].length < loop.length - 1e-9:
                loop, improved = near[0], True
                break
    return loop


def _describe(surface: Surface, closed: Surface, loop: IntArray) -> Handle:
    points = surface.points[loop]
    place = points.mean(axis=0)
    length = surface.loop_length(loop)
    axes = np.linalg.svd(points - place)[2]
    try:
        # In two dimensions, the "area" of Qhull is a perimeter. The zigzag of the edges does not count in it.
        perimeter = float(ConvexHull((points - place) @ axes[:2].T).area)
    except QhullError:
        perimeter = length
    inner, _ = cover_rim(surface.points, loop)
    nearest = inner[np.argsort(np.linalg.norm(inner - place, axis=1))[:5]]
    inside = np.median(winding_numbers(closed, nearest)) > 0.5
    return Handle(
        place, min(perimeter, length) / np.pi, length, "bridge" if inside else "tunnel", points, surface.space
    )


def winding_numbers(surface: Surface, places: FloatArray) -> FloatArray:
    """How often a closed surface goes round each of `places` (k, 3): 1 inside, 0 outside, (k,).

    Source: A. van Oosterom and J. Strackee, "The solid angle of a plane triangle", IEEE TBME 1983.
    """
    result = np.empty(len(places))
    for number, place in enumerate(places):
        a, b, c = (surface.points - place)[surface.triangles].transpose(1, 0, 2)
        la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
        volume = np.einsum("ij,ij->i", a, np.cross(b, c))
        dots = [np.einsum("ij,ij->i", p, q) for p, q in ((a, b), (b, c), (c, a))]
        below = la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb
        result[number] = np.arctan2(volume, below).sum() / (2.0 * np.pi)
    return result


def _cut(surface: Surface, loop: IntArray, handle: Handle) -> Surface:
    """Cut along a loop and cover both sides."""
    rims = len(surface.boundary_loops)
    on_loop = np.zeros(len(surface.points), bool)
    on_loop[loop] = True
    keep = np.logical_not(on_loop[surface.triangles].any(axis=1))
    # Without the triangles along the loop the two covers stand apart. Where the handle is too short for that (what
    # is left falls apart, or rims touch), it is cut along the edges.
    for attempt in (lambda: surface.submesh(keep)[0], lambda: _parted(surface, loop)):
        try:
            part = attempt()
            if part.is_manifold and part.component_count == 1 and len(part.boundary_loops) == rims + 2:
                return _covered(surface, part)
        except SurfaceError:
            continue
    raise SurfaceError(f"The handle, a {handle}, cannot be cut. Part the structures there in the segmentation.")


def _covered(surface: Surface, part: Surface) -> Surface:
    """Cover the two rims that the surface did not have."""
    old = {point.tobytes() for loop in surface.boundary_loops for point in surface.points[loop]}
    new = [loop for loop in part.boundary_loops if part.points[loop[0]].tobytes() not in old]
    closed, _ = close_rims(part, new)
    # The covers belong to the wall: they are no openings.
    data = dict(closed.point_data)
    marks = data.pop(HOLE_ARRAY)
    if HOLE_ARRAY in surface.point_data:
        marks[len(part.points) :] = 0
        data[HOLE_ARRAY] = marks
    return Surface(closed.points, closed.triangles, data, closed.cell_data, closed.field_data, closed.space)


def _parted(surface: Surface, loop: IntArray) -> Surface:
    """The surface cut along edges: the points of the loop twice, drawn a quarter of an edge apart."""
    n = len(surface.points)
    triangles = surface.triangles.copy()
    following = dict(zip(loop.tolist(), np.roll(loop, -1).tolist(), strict=True))
    number = {point: n + k for k, point in enumerate(loop.tolist())}
    touching = np.flatnonzero(np.isin(triangles, loop).any(axis=1))
    # Round each point of the loop, the triangles from the edge that follows counter-clockwise to the one before.
    turn: dict[tuple[int, int], tuple[int, int]] = {}
    for t in touching.tolist():
        for k in range(3):
            a, b, c = (int(surface.triangles[t, (k + j) % 3]) for j in range(3))
            turn[a, b] = (t, c)
    last = np.roll(loop, 1)
    for point, previous in zip(loop.tolist(), last.tolist(), strict=True):
        neighbour = following[point]
        while neighbour != previous:
            t, neighbour = turn[point, neighbour]
            triangles[t, surface.triangles[t] == point] = number[point]
    points = np.concatenate([surface.points, surface.points[loop]])
    ends = topology.edges(triangles).points
    both = np.concatenate([ends, ends[:, ::-1]])
    copies = np.concatenate([loop, n + np.arange(len(loop))])
    moved = points.copy()
    for copy in copies:
        beside = both[both[:, 0] == copy, 1]
        beside = beside[~np.isin(beside, copies)]
        if len(beside):
            moved[copy] += 0.25 * (points[beside].mean(axis=0) - points[copy])
    data = {name: np.concatenate([values, values[loop]]) for name, values in surface.point_data.items()}
    return Surface(moved, triangles, data, surface.cell_data, surface.field_data, surface.space)
