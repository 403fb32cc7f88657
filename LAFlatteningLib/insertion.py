"""Making lines across triangles edges of the mesh, while all its points keep their ids."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .geodesic_lines import Line
from .surface import FloatArray, IntArray, Surface


@dataclass(frozen=True, eq=False)
class Inserted:
    """A surface with lines as edges.

    Attributes
    ----------
    surface : its first points are those of the surface before, with the same ids; the others lie on their edges.
    parent : (triangles of `surface`,) the triangle of the surface before of which each is a part.
    lines : name -> point ids of the line, from its first place to its last.
    """

    surface: Surface
    parent: IntArray
    lines: Mapping[str, IntArray]

    @classmethod
    def of(cls, surface: Surface) -> Inserted:
        """A surface with nothing inserted."""
        return cls(surface, np.arange(len(surface.triangles)), {})

    @cached_property
    def line_keys(self) -> IntArray:
        """The edges of all lines, each as one number, see `Surface.edge_keys`."""
        pairs = np.concatenate([np.stack([ids[:-1], ids[1:]], axis=1) for ids in self.lines.values()])
        return pairs.min(axis=1) * len(self.surface.points) + pairs.max(axis=1)

    def edges_between(self, taken: NDArray[np.bool_]) -> IntArray:
        """(k, 2) the edges inside the surface between two of some points (n,) that no line runs along."""
        edges, keys = self.surface.edges, self.surface.edge_keys
        return edges.points[(edges.usage == 2) & taken[edges.points].all(axis=1) & ~np.isin(keys, self.line_keys)]

    def split_edges(self, edges: IntArray) -> Inserted:
        """The surface with a new point amid each of some edges (k, 2)."""
        middles = {f"middle {k}": Line(ends[None], np.array([0.5]), (), np.zeros(0)) for k, ends in enumerate(edges)}
        split = insert_lines(replace(self, lines={}), middles)
        return replace(split, lines=self.lines)


def insert_lines(before: Inserted, lines: Mapping[str, Line]) -> Inserted:
    """The surface with its triangles cut along more lines; lines of one place become points.

    Parameters
    ----------
    lines : name -> line across the triangles of ``before.surface``. No two may cross or meet (`meeting`), nor cross
        those that are there.
    """
    if not lines:
        return before
    surface = before.surface
    n, m = len(surface.points), len(surface.triangles)
    ends = np.concatenate([line.ends for line in lines.values()])
    share = np.concatenate([line.share for line in lines.values()])
    counts = [len(line.share) for line in lines.values()]
    # Every place on an edge is a new point, numbered along the edges.
    on_edge = ends[:, 0] != ends[:, 1]
    edge, share = edges_of(surface, ends, share, on_edge)
    nodes = ends[:, 0].copy()
    order = np.flatnonzero(on_edge)
    order = order[np.lexsort((share[order], edge[order]))]
    nodes[order] = n + np.arange(len(order))
    a, b = surface.edges.points[edge[order]].T
    t = share[order, None]
    points = np.concatenate([surface.points, (1.0 - t) * surface.points[a] + t * surface.points[b]])
    starts = np.concatenate([[0], np.cumsum(counts)])
    ids = {name: nodes[starts[k] : starts[k + 1]] for k, name in enumerate(lines)}

    # What falls into each triangle: new points on its sides, and pieces of lines.
    follows = np.ones(len(nodes), bool)
    follows[starts[1:] - 1] = False
    first = np.flatnonzero(follows)
    inside = chord_triangles(surface, ends[first], ends[first + 1])
    across = np.flatnonzero(inside >= 0)
    falls = _Falls(
        surface, points, edge[order], nodes[order], inside[across], nodes[np.stack([first, first + 1], axis=1)[across]]
    )
    simple, parent = _cut_by_one_piece(falls)
    others, others_parent = _cut_otherwise(falls, np.setdiff1d(falls.cut, parent))
    whole = np.ones(m, bool)
    whole[falls.cut] = False
    kept = np.flatnonzero(whole)
    return Inserted(
        Surface(points, np.concatenate([surface.triangles[kept], simple, others]), space=surface.space),
        before.parent[np.concatenate([kept, parent, others_parent])],
        {**before.lines, **ids},
    )


@dataclass(frozen=True, eq=False)
class _Falls:
    """What falls into the triangles of a surface.

    Attributes
    ----------
    surface, points : the surface before, and the points after.
    edge, node : (k,) the edge of each new point, rising, and the point; along each edge, points are in order.
    triangle, piece : (p,) the triangle that each piece of a line crosses, and (p, 2) the points at its ends.
    """

    surface: Surface
    points: FloatArray
    edge: IntArray
    node: IntArray
    triangle: IntArray
    piece: IntArray

    @cached_property
    def cut(self) -> IntArray:
        """The triangles into which anything falls, rising."""
        sides = self.surface.edges.triangles[self.edge]
        return np.unique(np.concatenate([self.triangle, sides[sides >= 0]]))


def _cut_by_one_piece(falls: _Falls) -> tuple[IntArray, IntArray]:
    """The parts, and their parents, of triangles that are crossed by one line from side to side or from a corner, and
    have no more points on their sides."""
    surface = falls.surface
    n, m = len(surface.points), len(surface.triangles)
    sides = surface.edges.of_triangle
    count = np.bincount(falls.edge, minlength=len(surface.edges.points))
    node = np.zeros(len(count), np.int64)
    node[falls.edge] = falls.node
    at_triangle = falls.triangle[np.bincount(falls.triangle, minlength=m)[falls.triangle] == 1]
    on_sides = count[sides[at_triangle]]
    made = np.bincount(falls.triangle, (falls.piece >= n).sum(axis=1), minlength=m)[at_triangle]
    simple = (on_sides.max(axis=1) == 1) & (on_sides.sum(axis=1) == made)

    # From one side to the next one, round corner c: a triangle, and four corners to be cut the better way.
    round_corner = simple & (made == 2)
    t, k = at_triangle[round_corner], on_sides[round_corner].argmin(axis=1)
    c, p, q = (surface.triangles[t, (k + step) % 3] for step in range(3))
    u, v = (node[sides[t, (k + step) % 3]] for step in (2, 1))

    def worse(*triangles: tuple[IntArray, IntArray, IntArray]) -> FloatArray:
        """The quality of the worse one of two triangles."""
        corners = [[falls.points[i].T for i in ids] for ids in triangles]
        return np.minimum(*(_quality(x, y, z, np.maximum) for x, y, z in corners))

    first = worse((u, p, q), (u, q, v)) > worse((p, q, v), (u, p, v))
    parts = [
        np.stack([c, u, v], axis=1),
        np.where(first, [u, p, q], [p, q, v]).T,
        np.where(first, [u, q, v], [u, p, v]).T,
    ]
    parents = [t] * 3
    # From corner c to the side opposite.
    from_corner = simple & (made == 1)
    t, k = at_triangle[from_corner], on_sides[from_corner].argmax(axis=1)
    c, p, q = (surface.triangles[t, (k + step) % 3] for step in range(3))
    v = node[sides[t, k]]
    parts += [np.stack([c, p, v], axis=1), np.stack([c, v, q], axis=1)]
    parents += [t] * 2
    return np.concatenate(parts), np.concatenate(parents)


def _cut_otherwise(falls: _Falls, cut: IntArray) -> tuple[IntArray, IntArray]:
    """The parts, and their parents, of triangles into which anything falls."""
    surface, points = falls.surface, falls.points
    ours = np.isin(falls.edge, surface.edges.of_triangle[cut])
    on_edges: dict[int, list[int]] = {}
    for e, node in zip(falls.edge[ours].tolist(), falls.node[ours].tolist(), strict=True):
        on_edges.setdefault(e, []).append(node)
    ours = np.isin(falls.triangle, cut)
    pieces: dict[int, list[tuple[int, int]]] = {}
    for triangle, (u, v) in zip(falls.triangle[ours].tolist(), falls.piece[ours].tolist(), strict=True):
        pieces.setdefault(triangle, []).append((u, v))
    new: list[tuple[int, int, int]] = []
    parent: list[int] = []
    position = points.tolist() if len(cut) > len(surface.triangles) // 4 else None
    for triangle in cut.tolist():
        corners = surface.triangles[triangle].tolist()
        polygon: list[int] = []
        for k in range(3):
            polygon.append(corners[k])
            e = int(surface.edges.of_triangle[triangle, (k + 2) % 3])
            if e in on_edges:
                along = on_edges[e]
                polygon += along if corners[k] == surface.edges.points[e, 0] else along[::-1]
        at = {i: position[i] if position else points[i].tolist() for i in polygon}
        for part in _split(polygon, pieces.get(triangle, [])):
            made = _triangulate(part, at)
            new += made
            parent += [triangle] * len(made)
    return np.array(new, np.int64).reshape(-1, 3), np.array(parent, np.int64)


def edges_of(
    surface: Surface, ends: IntArray, share: FloatArray, on_edge: NDArray[np.bool_]
) -> tuple[IntArray, FloatArray]:
    """The edge between two points, (k,), -1 where not `on_edge`; and the share counted from its first point."""
    n = len(surface.points)
    low, high = ends.min(axis=1), ends.max(axis=1)
    edge = np.searchsorted(surface.edge_keys, low * n + high)
    return np.where(on_edge, edge, -1), np.where(ends[:, 0] == low, share, 1.0 - share)


def chord_triangles(surface: Surface, one: IntArray, two: IntArray) -> IntArray:
    """The triangle that a straight piece of a line crosses, (k,); -1 where it runs along an edge.

    Parameters
    ----------
    one, two : (k, 2) ends of the edges on which the piece starts and stops; twice the same for a point.
    """
    # The three corners of the triangle are the ends of both edges.
    corners = np.sort(np.concatenate([one, two], axis=1), axis=1)
    distinct = np.concatenate([np.ones((len(corners), 1), bool), np.diff(corners, axis=1) > 0], axis=1)
    across = distinct.sum(axis=1) == 3
    triple = corners[across][distinct[across]].reshape(-1, 3)
    edge, _ = edges_of(surface, triple[:, :2], np.zeros(len(triple)), np.ones(len(triple), bool))
    sides = surface.edges.triangles[edge]
    has = (surface.triangles[sides] == triple[:, 2, None, None]).any(axis=2) & (sides >= 0)
    result = np.full(len(one), -1, np.int64)
    result[across] = sides[np.arange(len(sides)), has.argmax(axis=1)]
    return result


def _split(polygon: list[int], pieces: Sequence[tuple[int, int]]) -> list[list[int]]:
    """A convex polygon cut along pieces of lines between its corners, which do not cross."""
    parts = [polygon]
    for u, v in pieces:
        for k, part in enumerate(parts):
            if u in part and v in part:
                i, j = sorted((part.index(u), part.index(v)))
                if j - i > 1 and len(part) - (j - i) > 1:
                    parts[k : k + 1] = [part[i : j + 1], part[j:] + part[: i + 1]]
                break
        else:
            raise ValueError("Lines to be inserted cross each other.")
    return parts


def _triangulate(polygon: list[int], at: Mapping[int, Sequence[float]]) -> list[tuple[int, int, int]]:
    """A convex polygon, some of its corners perhaps on a straight side, cut into triangles whose worst one is as
    good as possible."""
    k = len(polygon)
    if k == 3:
        return [(polygon[0], polygon[1], polygon[2])]
    corner = [at[i] for i in polygon]
    best: dict[tuple[int, int], tuple[float, list[tuple[int, int, int]]]] = {
        (i, i + 1): (float("inf"), []) for i in range(k)
    }
    for width in range(2, k):
        for i in range(k - width):
            j = i + width
            choice = None
            for middle in range(i + 1, j):
                left, right = best[i, middle], best[middle, j]
                worst = min(left[0], right[0], _quality(corner[i], corner[middle], corner[j]))
                if choice is None or worst > choice[0]:
                    choice = (worst, [*left[1], *right[1], (polygon[i], polygon[middle], polygon[j])])
            assert choice is not None
            best[i, j] = choice
    return best[0, k - 1][1]


def _quality(a: Sequence[Any], b: Sequence[Any], c: Sequence[Any], larger: Callable[[Any, Any], Any] = max) -> Any:
    """Twice the area of a triangle over its longest side squared, squared; 0 for a sliver.

    Parameters
    ----------
    a, b, c : three coordinates each: numbers, or with `larger` that of arrays, arrays.
    """
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    uu, vv, uv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, ux * vx + uy * vy + uz * vz
    longest = larger(larger(uu, vv), uu + vv - 2.0 * uv)
    return (uu * vv - uv * uv) / (longest * longest)


def meeting(
    surface: Surface, lines: Mapping[str, Line], touching: bool = True, shared: Sequence[int] = ()
) -> set[frozenset[str]]:
    """The pairs of lines that cross.

    Parameters
    ----------
    touching : whether lines that only touch, or pass through the same point, count as well.
    shared : points where lines may meet, for they end there.
    """
    if not lines:
        return set()
    names = list(lines)
    ends = np.concatenate([line.ends for line in lines.values()])
    share = np.concatenate([line.share for line in lines.values()])
    line = np.repeat(np.arange(len(names)), [len(one.share) for one in lines.values()])
    on_edge = ends[:, 0] != ends[:, 1]
    edge, share = edges_of(surface, ends, share, on_edge)
    # Pieces of lines, the triangle that each crosses, and those that run along an edge.
    first = np.flatnonzero(np.diff(line) == 0)
    inside = chord_triangles(surface, ends[first], ends[first + 1])
    along = first[inside < 0]
    corners = np.sort(np.concatenate([ends[along], ends[along + 1]], axis=1), axis=1)[:, [0, -1]]
    along_edge, _ = edges_of(surface, corners, np.zeros(len(along)), np.ones(len(along), bool))
    found: set[frozenset[str]] = set()

    def note(a: int, b: int) -> None:
        if a != b:
            found.add(frozenset((names[a], names[b])))

    at_edge: dict[int, list[tuple[float, int]]] = {}
    for k in np.flatnonzero(on_edge & (_of_several(edge, line) | np.isin(edge, along_edge))).tolist():
        at_edge.setdefault(int(edge[k]), []).append((float(share[k]), int(line[k])))
    if touching:
        through: dict[int, set[int]] = {}
        for k in np.flatnonzero(~on_edge & _of_several(np.where(on_edge, -1, ends[:, 0]), line)).tolist():
            through.setdefault(int(ends[k, 0]), set()).add(int(line[k]))
        for point, several in through.items():
            for a, b in combinations(sorted(several) if point not in shared else (), 2):
                note(a, b)
        for places in at_edge.values():
            for (one, a), (other, b) in combinations(places, 2):
                if abs(one - other) < TOO_CLOSE:
                    note(a, b)
    # Pieces along an edge, and what crosses it there.
    for k, e, (_, last) in zip(along.tolist(), along_edge.tolist(), corners.tolist(), strict=True):
        stretch = sorted(float(share[j]) if on_edge[j] else float(ends[j, 0] == last) for j in (k, k + 1))
        for place, other in at_edge.get(e, []):
            if stretch[0] < place < stretch[1]:
                note(int(line[k]), other)
    # Pieces in one triangle whose ends alternate round it.
    together = _of_several(inside, line[first]) & (inside >= 0)
    per_triangle: dict[int, list[int]] = {}
    for k, triangle in zip(first[together].tolist(), inside[together].tolist(), strict=True):
        per_triangle.setdefault(triangle, []).append(k)
    for triangle, chords in per_triangle.items():
        corners = surface.triangles[triangle].tolist()

        def round_at(k: int, corners: list[int] = corners) -> float:
            """How far round the triangle a place is: corner number plus share of the side."""
            a, b = ends[k].tolist()
            i = corners.index(a)
            if a == b:
                return float(i)
            along = share[k] if a < b else 1.0 - share[k]
            return i + along if corners[(i + 1) % 3] == b else corners.index(b) + 1.0 - along

        spans = [(int(line[k]), sorted((round_at(k), round_at(k + 1)))) for k in chords]
        for (one, (low, high)), (other, (c, d)) in combinations(spans, 2):
            if (low < c < high) != (low < d < high) and c not in (low, high) and d not in (low, high):
                note(one, other)
    return found


def _of_several(key: IntArray, line: IntArray) -> NDArray[np.bool_]:
    """(k,) for places of lines, each with a key: whether places of other lines have the same key."""
    order = np.lexsort((line, key))
    key, line = key[order], line[order]
    begins = np.append(True, key[1:] != key[:-1])
    changes = np.append(False, line[1:] != line[:-1]) & ~begins
    group = np.cumsum(begins) - 1
    result = np.empty(len(key), bool)
    result[order] = (np.bincount(group, changes) > 0)[group] if len(key) else False
    return result


TOO_CLOSE = 1e-3
"""Lines closer than this share of an edge touch."""
