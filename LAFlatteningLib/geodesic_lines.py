"""Geodesic lines across the triangles of a surface: shortest ways that are not tied to edges.

A line starts as a strip of triangles along an edge path. Within a strip the shortest line is found by unfolding it
into the plane and pulling a string through it (the funnel of Lee and Preparata, "Euclidean shortest paths in the
presence of rectilinear barriers", Networks 14, 1984). Where the string touches a point whose other side is the
shorter way round, the strip is led round that side, until no point is left: a locally shortest line (Mitchell,
Mount and Papadimitriou, "The discrete geodesic problem", SIAM J. Comput. 16, 1987, lemma 3.4; Xin and Wang,
"Efficiently determining a locally exact shortest path on polyhedral surfaces", CAD 39, 2007).
"""

from __future__ import annotations

from cmath import phase
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .half_edges import HalfEdges, after
from .surface import FloatArray, IntArray

ComplexArray = NDArray[np.complex128]

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
        string = _pull(mesh, start, stop, strip)
        turned = _lead_round(mesh, strip, string)
        if turned is None:
            break
        strip = _trim(mesh, start, stop, turned)
    else:
        string = _pull(mesh, start, stop, strip)
    share = string.crossing()
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
    while begin < end and mesh.touches(strip[begin], first):
        begin += 1
    while end > begin and mesh.touches(strip[end - 1], last):
        end -= 1
    return strip[begin:end]


def make_line(mesh: HalfEdges, start: Place, stop: Place, strip: Sequence[int] | IntArray, share: FloatArray) -> Line:
    """The line that crosses a strip at given shares of its half-edges."""
    crossed = np.empty(len(strip) + 2, np.int64)
    shares = np.empty(len(strip) + 2)
    crossed[0], crossed[1:-1], crossed[-1] = start.half_edge, strip, stop.half_edge
    shares[0], shares[1:-1], shares[-1] = start.share, share, stop.share
    ends = mesh.ends(crossed)
    at_first, at_second = shares <= AT_POINT, shares >= 1.0 - AT_POINT
    ends[at_first, 1] = ends[at_first, 0]
    ends[at_second, 0] = ends[at_second, 1]
    at_point = at_first | at_second
    shares[at_point] = 0.0
    # Turning round a point, a line stays at it.
    stays = at_point[1:] & at_point[:-1] & (ends[1:, 0] == ends[:-1, 0])
    if stays.any():
        new = np.append(True, ~stays)
        ends, shares = ends[new], shares[new]
    return Line(ends, shares, tuple(crossed[1:-1].tolist()), share)


@dataclass(frozen=True, eq=False)
class _String:
    """A string pulled through an unfolded strip.

    Attributes
    ----------
    left, right : (k,) the ends of the half-edges crossed, in the plane of the strip.
    corners : where the string turns: the number of a half-edge, and whether at its left end.
    bends : the places of its first end, of the corners and of its last end.
    """

    left: ComplexArray
    right: ComplexArray
    corners: list[tuple[int, bool]]
    bends: list[complex]

    def turn(self, corner: int) -> float:
        """By how much the string turns at a corner, radians, positive."""
        a, b, c = self.bends[corner : corner + 3]
        return abs(phase((c - b) * (b - a).conjugate()))

    def crossing(self) -> FloatArray:
        """Where it crosses each half-edge: the share of the way from right to left."""
        portals = np.array([-1, *(portal for portal, _ in self.corners), len(self.left)])
        bends = np.array(self.bends)
        # The straight piece on which each half-edge lies.
        piece = np.searchsorted(portals, np.arange(len(self.left)), side="right") - 1
        a, along = bends[piece], np.diff(bends)[piece]
        with np.errstate(divide="ignore", invalid="ignore"):
            share = _cross(a - self.right, along) / _cross(self.left - self.right, along)
        for portal, is_left in self.corners:
            share[portal] = 1.0 if is_left else 0.0
        # A line along an edge: any place on it will do, the nearest end is one.
        share = np.where(np.isfinite(share), share, 0.5)
        # At a point to the last bit, so that lines which leave a rim at one point have one foot.
        return np.where(share <= AT_POINT, 0.0, np.where(share >= 1.0 - AT_POINT, 1.0, share))


def _pull(mesh: HalfEdges, start: Place, stop: Place, strip: list[int]) -> _String:
    """The shortest line in a strip."""
    left, right, keeps_right, first, last = _unfold(mesh, start, stop, strip)
    corners, bends = _funnel(left.tolist(), right.tolist(), keeps_right.tolist(), first, last)
    return _String(left, right, corners, bends)


def _unfold(
    mesh: HalfEdges, start: Place, stop: Place, strip: list[int]
) -> tuple[ComplexArray, ComplexArray, NDArray[np.bool_], complex, complex]:
    """The strip laid in the plane: left and right end of each half-edge crossed, whether the next one keeps the right
    end (or else the left one), start and end.

    The first half-edge leads from 0 to 1.
    """
    crossed = np.array(strip)
    twins = mesh.twin[crossed]
    # In the frame of a half-edge that leads from 0 to 1, the triangle behind it ends at `beyond`. The next half-edge
    # leads from 0 to there, or from there to 1.
    beyond = 1.0 - mesh.apexes[twins]
    keeps_right = (crossed[1:] - twins[:-1]) % 3 == 1
    left, right = np.empty((2, len(strip)), np.complex128)
    left[0], right[0] = 1.0, 0.0
    left[1:] = np.where(keeps_right, beyond[:-1], 1.0 - beyond[:-1])
    across = np.cumprod(left)
    right[1:] = np.cumsum(np.where(keeps_right, 0.0, across[:-1] * beyond[:-1]))
    left = right + across

    first = _where(start, strip[0], 0j, 1.0 + 0j, complex(mesh.apexes[strip[0]]))
    last = complex(left[-1]), complex(right[-1]), complex(right[-1] + across[-1] * beyond[-1])
    return left, right, keeps_right, first, _where(stop, int(twins[-1]), *last)


def _where(place: Place, h: int, a: complex, b: complex, c: complex) -> complex:
    """Where the place at an end of a line is in the plane.

    Parameters
    ----------
    h, a, b, c : the half-edge through which the line leaves or enters the triangle there, where that starts and ends in
        the plane, and the third point of the triangle. A place that is a point of the mesh is that one.
    """
    if place.share == 0.0:
        return c
    return b + place.share * (c - b) if place.half_edge == after(h) else c + place.share * (a - c)


def _cross(a: ComplexArray, b: ComplexArray) -> FloatArray:
    """Twice the area between two directions, positive where the second is on the left."""
    return (a.conjugate() * b).imag


def _funnel(
    left: list[complex], right: list[complex], keeps_right: list[bool], start: complex, stop: complex
) -> tuple[list[tuple[int, bool]], list[complex]]:
    """The corners and bends of the string pulled through a strip, see `_String`.

    Parameters
    ----------
    keeps_right : whether the right end of each half-edge is that of the next one, too; the left end is, where not.
    """
    corners: list[tuple[int, bool]] = []
    bends = [start]
    last = len(left) - 1
    # What is seen from the bend: between directions to a left and a right end. First through the half-edge k.
    k = 0
    while k <= last:
        apex = bends[-1]
        l_side, r_side, l_at, r_at = left[k] - apex, right[k] - apex, k, k
        hidden_by_left = None
        while hidden_by_left is None:
            if k == last:
                side = stop - apex
                if (l_side.conjugate() * side).imag > 0.0:
                    hidden_by_left = True
                elif (r_side.conjugate() * side).imag < 0.0:
                    hidden_by_left = False
                else:
                    return corners, [*bends, stop]
            elif keeps_right[k]:
                k += 1
                side = left[k] - apex
                if (l_side.conjugate() * side).imag <= 0.0:
                    if (r_side.conjugate() * side).imag > 0.0:
                        l_side, l_at = side, k
                    else:
                        hidden_by_left = False
            else:
                k += 1
                side = right[k] - apex
                if (r_side.conjugate() * side).imag >= 0.0:
                    if (l_side.conjugate() * side).imag < 0.0:
                        r_side, r_at = side, k
                    else:
                        hidden_by_left = True
        k = l_at if hidden_by_left else r_at
        corners.append((k, hidden_by_left))
        bends.append(left[k] if hidden_by_left else right[k])
        # On behind the last half-edge that ends there.
        while k < last and keeps_right[k] != hidden_by_left:
            k += 1
        k += 1
    return corners, [*bends, stop]


def _lead_round(mesh: HalfEdges, strip: list[int], string: _String) -> list[int] | None:
    """The strip led round the other side of every point where that is shorter; None if there is none."""
    result = strip
    free = len(strip)
    for k, (portal, left) in reversed(list(enumerate(string.corners))):
        point = mesh.end(strip[portal]) if left else int(mesh.origin[strip[portal]])
        # On the outside of the turn the line sees pi + turn; it can be shortened if less than pi is left inside.
        if mesh.angles[point] - string.turn(k) >= 2.0 * np.pi - 1e-9:
            continue
        begin = end = portal
        while begin > 0 and mesh.touches(strip[begin - 1], point):
            begin -= 1
        while end + 1 < len(strip) and mesh.touches(strip[end + 1], point):
            end += 1
        if end >= free:
            continue
        other = mesh.turn(strip[begin] // 3, int(mesh.twin[strip[end]]) // 3, point, not left)
        if other is None:
            continue
        result = [*result[:begin], *other, *result[end + 1 :]]
        free = begin
    return None if result is strip else mesh.without_detours(result)


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
