"""Geodesic lines across the triangles of a surface: shortest ways that are not tied to edges.

A line starts as a strip of triangles along an edge path. Within a strip the shortest line is found by unfolding it
into the plane and pulling a string through it (the funnel of Lee and Preparata, "Euclidean shortest paths in the
presence of rectilinear barriers", Networks 14, 1984). Where the string touches a point whose other side is the
shorter way round, the strip is led round that side, until no point is left: a locally shortest line (Mitchell,
Mount and Papadimitriou, "The discrete geodesic problem", SIAM J. Comput. 16, 1987, lemma 3.4; Xin and Wang,
"Efficiently determining a locally exact shortest path on polyhedral surfaces", CAD 39, 2007).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .half_edges import HalfEdges, after, before
from .surface import FloatArray, IntArray

PASSES = 1000
"""Most times that a strip is led round points: ten to thirty at 20,000 points, a hundred at 200,000."""


AT_POINT = 1e-9
"""A place on an edge nearer to its end than this share of it is at the end."""


@dataclass(frozen=True)
class Place:
    """A place where a line starts or ends: a point of the mesh, or a place on a rim.

    Attributes
    ----------
    half_edge : a half-edge on the rim, or one that starts at the point.
    share : how far along the half-edge, 0 to 1; 0 for a point.
    """

    half_edge: int
    share: float


@dataclass(frozen=True, eq=False)
class Line:
    """A line across triangles: straight in each triangle, from edge to edge.

    Attributes
    ----------
    ends : (k, 2) the two points of the edge on which each of its places lies; twice the same where it passes
        through a point.
    share : (k,) where on the edge: 0 at the first point, 1 at the second.
    strip : the half-edges crossed between the first place and the last.
    crossing : (length of the strip,) where on each of them, 0 at its start, 1 at its end.
    """

    ends: IntArray
    share: FloatArray
    strip: tuple[int, ...]
    crossing: FloatArray

    def positions(self, points: FloatArray) -> FloatArray:
        """(k, 3) mm, with `points` those of the surface."""
        t = self.share[:, None]
        return (1.0 - t) * points[self.ends[:, 0]] + t * points[self.ends[:, 1]]

    def reversed(self) -> Line:
        """The same line from its end to its start, without its strip."""
        return Line(self.ends[::-1], self.share[::-1], (), np.zeros(0))

    def place(self, index: int) -> Line:
        """One place of the line as a line of its own."""
        k = range(len(self.share))[index]
        return Line(self.ends[k : k + 1], self.share[k : k + 1], (), np.zeros(0))

    def length(self, points: FloatArray) -> float:
        """mm."""
        return float(np.linalg.norm(np.diff(self.positions(points), axis=0), axis=1).sum())


def straighten(mesh: HalfEdges, start: Place, stop: Place, strip: Sequence[int], clearance: float = 0.0) -> Line:
    """The locally shortest line from one place to another, found from a strip of triangles between them.

    Parameters
    ----------
    mesh : a surface without handles between the strip and the shortest line; rims are never crossed.
    strip : half-edges, see `HalfEdges`; from a triangle at `start` to one at `stop`.
    clearance : where the shortest line touches a rim, how far it keeps away from it, as a share of the edges
        that end there.
    """
    strip = _trim(mesh, start, stop, mesh.without_detours(strip))
    for _ in range(PASSES):
        if not strip:
            return make_line(mesh, start, stop, strip, np.zeros(0))
        share, corners = _pull(mesh, start, stop, strip)
        turned = _lead_round(mesh, strip, corners)
        if turned is None:
            break
        strip = _trim(mesh, start, stop, turned)
    else:
        share, _ = _pull(mesh, start, stop, strip)
    if clearance > 0.0:
        ends = mesh.ends(strip)
        low, high = np.where(np.isinf(mesh.angles[ends]), clearance, 0.0).T
        share = np.clip(share, low, 1.0 - high)
    return make_line(mesh, start, stop, strip, share)


def _point_of(mesh: HalfEdges, place: Place) -> int:
    """The point of the mesh at a place, -1 if there is none."""
    return int(mesh.origin[place.half_edge]) if place.share == 0.0 else -1


def _trim(mesh: HalfEdges, start: Place, stop: Place, strip: list[int]) -> list[int]:
    """The strip without its turns round a point at which the line itself starts or ends."""
    first, last = _point_of(mesh, start), _point_of(mesh, stop)
    begin, end = 0, len(strip)
    while begin < end and first in (mesh.origin[strip[begin]], mesh.end(strip[begin])):
        begin += 1
    while end > begin and last in (mesh.origin[strip[end - 1]], mesh.end(strip[end - 1])):
        end -= 1
    return strip[begin:end]


def make_line(mesh: HalfEdges, start: Place, stop: Place, strip: Sequence[int] | IntArray, share: FloatArray) -> Line:
    """The line that crosses a strip at given shares of its half-edges."""
    ends = np.empty((len(strip) + 2, 2), np.int64)
    shares = np.empty(len(strip) + 2)
    ends[1:-1], shares[1:-1] = mesh.ends(strip) if len(strip) else np.zeros((0, 2), np.int64), share
    for k, place in ((0, start), (-1, stop)):
        ends[k] = mesh.origin[place.half_edge], mesh.end(place.half_edge)
        shares[k] = place.share
    at_first, at_second = shares <= AT_POINT, shares >= 1.0 - AT_POINT
    ends[at_first, 1] = ends[at_first, 0]
    ends[at_second, 0] = ends[at_second, 1]
    shares[at_first | at_second] = 0.0
    # Turning round a point, a line stays at it.
    new = np.append(True, (ends[1:] != ends[:-1]).any(axis=1) | (ends[1:, 0] != ends[1:, 1]))
    return Line(ends[new], shares[new], tuple(int(h) for h in strip), share)


@dataclass
class _Corner:
    """A point where a pulled string turns."""

    portal: int
    left: bool
    turn: float
    """By how much the string turns there, radians, positive."""


def _pull(mesh: HalfEdges, start: Place, stop: Place, strip: list[int]) -> tuple[FloatArray, list[_Corner]]:
    """Where the shortest line in a strip crosses each of its half-edges (share of the way from start to end), and
    the points where it turns."""
    left, right, first, last = _unfold(mesh, start, stop, strip)
    corners = _funnel(left, right, first, last)
    portals = np.array([-1, *(portal for portal, _ in corners), len(strip)])
    bends = np.array([first, *((left if is_left else right)[portal] for portal, is_left in corners), last])
    # The straight piece on which each portal lies.
    piece = np.searchsorted(portals, np.arange(len(strip)), side="right") - 1
    a, b = bends[piece], bends[piece + 1]
    near = np.array(right)
    across, along = np.array(left) - near, b - a
    with np.errstate(divide="ignore", invalid="ignore"):
        share = ((a - near).conjugate() * along).imag / (across.conjugate() * along).imag
    for portal, is_left in corners:
        share[portal] = 1.0 if is_left else 0.0
    # A line along an edge: any place on it will do, the nearest end is one.
    share = np.clip(np.where(np.isfinite(share), share, 0.5), 0.0, 1.0)
    directions = np.diff(bends)
    with np.errstate(divide="ignore", invalid="ignore"):
        turns = np.abs(np.angle(directions[1:] / directions[:-1]))
    return share, [
        _Corner(portal, is_left, float(turn)) for (portal, is_left), turn in zip(corners, turns, strict=True)
    ]


def _unfold(
    mesh: HalfEdges, start: Place, stop: Place, strip: list[int]
) -> tuple[list[complex], list[complex], complex, complex]:
    """The strip laid in the plane: left and right end of each half-edge crossed, start and end."""
    first = strip[0]
    length = float(np.linalg.norm(np.subtract(*mesh.points[mesh.ends([first])[0]])))
    twins = mesh.twin[np.array(strip)]
    apex = mesh.apex(np.append(twins, first)).tolist()
    origin = mesh.origin
    a, b = 0j, complex(length)
    own = {int(origin[first]): a, mesh.end(first): b, int(origin[before(first)]): a + (b - a) * apex[-1]}
    begin = _where(mesh, start, own)
    left, right = [b], [a]
    for k, twin in enumerate(twins.tolist()):
        # The twin leads from b to a; the new point is on its left.
        c = b + (a - b) * apex[k]
        if k + 1 < len(strip):
            h = strip[k + 1]
            if h == after(twin):
                # From the end of the twin (a) to the new point.
                a, b = a, c
            else:
                a, b = c, b
            left.append(b)
            right.append(a)
        else:
            own = {int(origin[twin]): b, mesh.end(twin): a, int(origin[before(twin)]): c}
    return left, right, begin, _where(mesh, stop, own)


def _where(mesh: HalfEdges, place: Place, corners: dict[int, complex]) -> complex:
    at = corners[int(mesh.origin[place.half_edge])]
    if place.share == 0.0:
        return at
    return at + place.share * (corners[mesh.end(place.half_edge)] - at)


def _funnel(left: list[complex], right: list[complex], start: complex, stop: complex) -> list[tuple[int, bool]]:
    """The portals at whose ends the shortest line through all portals turns, and whether at the left end."""
    corners: list[tuple[int, bool]] = []
    apex = start
    l_side = r_side = start
    l_at = r_at = -1
    n = len(left)
    k = 0
    while True:
        if k == n:
            # The end is seen past both sides, or the line first goes round the side that hides it.
            if ((l_side - apex).conjugate() * (stop - apex)).imag > 0.0:
                corners.append((l_at, True))
                apex, k = l_side, l_at + 1
                r_side, r_at = l_side, l_at
                continue
            if ((r_side - apex).conjugate() * (stop - apex)).imag < 0.0:
                corners.append((r_at, False))
                apex, k = r_side, r_at + 1
                l_side, l_at = r_side, r_at
                continue
            break
        new_l, new_r = left[k], right[k]
        # Right side: narrower if the new end lies left of the old one.
        if ((r_side - apex).conjugate() * (new_r - apex)).imag >= 0.0:
            if apex == r_side or ((l_side - apex).conjugate() * (new_r - apex)).imag < 0.0:
                r_side, r_at = new_r, k
            else:
                corners.append((l_at, True))
                apex, k = l_side, l_at + 1
                r_side, r_at = l_side, l_at
                continue
        if ((l_side - apex).conjugate() * (new_l - apex)).imag <= 0.0:
            if apex == l_side or ((r_side - apex).conjugate() * (new_l - apex)).imag > 0.0:
                l_side, l_at = new_l, k
            else:
                corners.append((r_at, False))
                apex, k = r_side, r_at + 1
                l_side, l_at = r_side, r_at
                continue
        k += 1
    return corners


def _lead_round(mesh: HalfEdges, strip: list[int], corners: list[_Corner]) -> list[int] | None:
    """The strip led round the other side of every point where that is shorter; None if there is none."""
    changed = False
    result = list(strip)
    free = len(strip)
    for corner in reversed(corners):
        h = strip[corner.portal]
        point = mesh.end(h) if corner.left else int(mesh.origin[h])
        # On the outside of the turn the line sees pi + turn; it can be shortened if less than pi is left inside.
        if mesh.angles[point] - corner.turn >= 2.0 * np.pi - 1e-9:
            continue
        begin = end = corner.portal
        while begin > 0 and point in (mesh.origin[strip[begin - 1]], mesh.end(strip[begin - 1])):
            begin -= 1
        while end + 1 < len(strip) and point in (mesh.origin[strip[end + 1]], mesh.end(strip[end + 1])):
            end += 1
        if end >= free:
            continue
        other = mesh.turn(strip[begin] // 3, int(mesh.twin[strip[end]]) // 3, point, not corner.left)
        if other is None:
            continue
        result[begin : end + 1] = other
        free = begin
        changed = True
    return mesh.without_detours(result) if changed else None


def settle(line: Line, points: FloatArray, allowed: NDArray[np.bool_], tolerance: float) -> Line:
    """The line led through the points of the mesh that it all but touches, so that no slivers are cut off beside it.

    Parameters
    ----------
    points : (n, 3) mm.
    allowed : (n,) the points through which it may be led.
    tolerance : how near it must pass, as a share of the length of the edges crossed there.
    """
    ends, share = line.ends, line.share
    at = line.positions(points)
    inner = np.flatnonzero(ends[:, 0] != ends[:, 1])
    inner = inner[(inner > 0) & (inner < len(share) - 1)]
    if not len(inner):
        return line
    node, point = np.repeat(inner, 2), ends[inner].reshape(-1)
    distance = np.minimum(
        _to_segment(points[point], at[node - 1], at[node]), _to_segment(points[point], at[node], at[node + 1])
    )
    lengths = np.linalg.norm(points[ends[inner, 0]] - points[ends[inner, 1]], axis=1)
    relative = distance / np.repeat(lengths, 2)
    candidate = (relative < tolerance) & allowed[point]
    if not candidate.any():
        return line
    keep = np.ones(len(share), bool)
    ends, share = ends.copy(), share.copy()
    done = set(ends[ends[:, 0] == ends[:, 1], 0].tolist())
    for k in np.flatnonzero(candidate)[np.argsort(relative[candidate], kind="stable")]:
        v = int(point[k])
        touching = node[(point == v) & keep[node] & (ends[node, 0] != ends[node, 1])]
        # Not where it has been led through another point in between.
        if v in done or not len(touching) or keep[touching[0] : touching[-1] + 1].sum() > len(touching):
            continue
        done.add(v)
        keep[touching[1:]] = False
        ends[touching[0]], share[touching[0]] = v, 0.0
    return Line(ends[keep], share[keep], line.strip, line.crossing)


def _to_segment(points: FloatArray, starts: FloatArray, stops: FloatArray) -> FloatArray:
    """Distance of each point (k, 3) from its own segment, (k,)."""
    along = stops - starts
    squared = np.einsum("ij,ij->i", along, along)
    t = np.einsum("ij,ij->i", points - starts, along) / np.where(squared > 0.0, squared, 1.0)
    nearest = starts + np.clip(t, 0.0, 1.0)[:, None] * along
    return np.linalg.norm(points - nearest, axis=1)
