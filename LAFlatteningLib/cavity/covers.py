"""Covers over openings: a patch of triangles for each rim, with inner points for a centre seed to sit on.

Three steps after P. Liepa, "Filling holes in meshes", Symposium on Geometry Processing 2003: the rim is triangulated
with the least area (after Barequet and Sharir), the triangles are refined to the edge length round the opening (after
Pfeifle and Seidel), and the new points are faired. Written from the paper's description.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from .. import operators, topology
from ..errors import LAFlatteningError, SurfaceError
from ..surface import Surface

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
Fairing = Literal["membrane", "thin-plate"]

EXACT_LIMIT = 250
"""Rims of up to this many points get the least area exactly; longer ones are first cut into such pieces."""
COARSE_POINTS = 120
"""Points of a longer rim that decide where it is cut."""
ALPHA = np.sqrt(2.0)
"""Liepa's density: a triangle is split while its corners are farther than sigma / ALPHA from its centroid."""
FAIRING_SOLVES = 8
"""At most so many solves for a membrane, each with the weights of the last shape."""
FAIRING_TOLERANCE = 1e-3
"""A membrane is done when a solve lowers its area by less than this share."""


def cover_rim(
    points: FloatArray,
    rim: IntArray,
    triangles: IntArray | None = None,
    *,
    fairing: Fairing = "membrane",
    name: str = "The rim",
) -> tuple[FloatArray, IntArray]:
    """Cover an opening with triangles of the size of those round it.

    Parameters
    ----------
    points : (n, 3) in any length unit.
    rim : (r,) ids of the opening's points in order, at least 3, with the surface on the left of the loop (the
        order of `topology.boundary_loops`).
    triangles : (m, 3) the surface round the opening (all of it, or at least every triangle that touches the rim).
        From it come the edge length to match, and the edges between points of the rim that the cover must not use
        a second time. Without it the edge length is that of the rim.
    fairing : "membrane" stretches the cover over the rim, a discrete minimal surface. "thin-plate", the paper's
        second-order fairing, lets the surface continue across the rim with its tangents; it needs `triangles`.
    name : what messages call the rim.

    Returns
    -------
    inner : (k, 3) new points, k >= 1. They are numbered from n on.
    cover : (t, 3) triangles of the cover with ids into `points` followed by `inner`. They run along each
        edge of the rim against the surface's triangle there, so that the orientation continues.

    Raises
    ------
    SurfaceError : fewer than 3 points in the rim, a point twice, an id out of range, coordinates that are not numbers,
        or a rim that is not a loop of the surface's boundary in its direction.
    LAFlatteningError : an unknown fairing, or "thin-plate" without triangles.

    Notes
    -----
    Why the membrane is the default, against the paper: at an ostium "with its tangents" means along the vein. On a
    tube of radius R the thin plate is a dome R/2 high. Measured on 15 ostia of two atria, it stood 1.3 to 3.5 mm out
    into the vein (membrane: at most 0.35 mm, the raggedness of the rims), its centre 0.7 to 1.9 mm (0.05 mm). It made
    each geodesic between two centre seeds 1 to 3 mm longer, and one in ten took the other side of its vein. As it
    hangs on the last row of triangles of the cut vein, noise of 0.1 mm moved its centre by 0.12 mm (0.04 mm).
    The thin plate is right where a rounded stump is wanted; published covers of ostia exist of both kinds.

    Source: Liepa 2003. Minimal surface: Pinkall and Polthier 1993.

    Examples
    --------
    >>> import numpy as np
    >>> angle = np.linspace(0, 2 * np.pi, 6, endpoint=False)
    >>> hexagon = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    >>> inner, cover = cover_rim(hexagon, np.arange(6)[::-1])
    >>> len(inner), len(cover), bool(np.allclose(inner, 0))
    (1, 6, True)
    """
    points = np.asarray(points, np.float64)
    covers = _cover(points, _checked_rims(points, [rim], [name]), triangles, fairing, [name])
    return covers.inner, covers.triangles


def close_rims(
    surface: Surface, rims: Sequence[IntArray], names: Sequence[str] | None = None, *, fairing: Fairing = "membrane"
) -> tuple[Surface, IntArray]:
    """The surface with some of its openings covered.

    Points and triangles of the surface keep their ids; those of the covers follow, rim by rim.

    Parameters
    ----------
    rims : loops of the surface's boundary, as in `Surface.boundary_loops`.
    names : what messages call them; "Rim 0", "Rim 1", ... if not given.
    fairing : see `cover_rim`.

    Returns
    -------
    closed : Surface with all arrays of the surface. On covers, point arrays of floating type are harmonic
        (each value between those of the rim; NaN only where the whole rim has none), others are those of the nearest
        point of the rim; cell arrays are 0 (empty for text). The point array `hole` (uint8) is 1 at the covers' inner
        points, 0 elsewhere, rims included; where the surface has such an array already, its marks stay.
    rim_of_triangle : (m',) number of the rim that a triangle covers, -1 for the surface's own triangles.

    Raises
    ------
    SurfaceError : a rim is not a loop of the surface, two rims share a point, see `cover_rim`.
    LAFlatteningError : unknown fairing; as many names as rims expected.
    """
    if names is None:
        names = [f"Rim {number}" for number in range(len(rims))]
    if len(names) != len(rims):
        raise LAFlatteningError(f"Expected a name for each of the {len(rims)} rims, found {len(names)} names.")
    n = len(surface.points)
    hole = np.zeros(n, np.uint8)
    if "hole" in surface.point_data:
        hole = (np.asarray(surface.point_data["hole"]).reshape(n, -1) != 0).any(axis=1).astype(np.uint8)
    if len(rims) == 0:
        return surface.with_data({"hole": hole}), np.full(len(surface.triangles), -1, np.int64)
    rims = _checked_rims(surface.points, rims, names)
    covers = _cover(surface.points, rims, surface.triangles, fairing, names)
    added = len(covers.triangles)
    point_data = _continue_on_covers(surface, rims, covers)
    point_data["hole"] = np.append(hole, np.ones(len(covers.inner), np.uint8))
    cell_data = {key: np.concatenate([values, _neutral(values, added)]) for key, values in surface.cell_data.items()}
    closed = Surface(
        np.concatenate([surface.points, covers.inner]),
        np.concatenate([surface.triangles, covers.triangles]),
        point_data,
        cell_data,
        surface.field_data,
        surface.space,
    )
    return closed, np.concatenate([np.full(len(surface.triangles), -1, np.int64), covers.rim_of_triangle])


class _Covers(NamedTuple):
    """Covers of several rims, ordered by rim, with ids into the points followed by `inner`."""

    inner: FloatArray
    triangles: IntArray
    rim_of_point: IntArray
    """(k,) of each inner point."""
    rim_of_triangle: IntArray
    """(t,)"""


def _cover(
    points: FloatArray, rims: Sequence[IntArray], triangles: IntArray | None, fairing: str, names: Sequence[str]
) -> _Covers:
    """Cover rims. All go through refinement and fairing together, because small arrays cost numpy as much as large."""
    if fairing not in get_args(Fairing):
        raise LAFlatteningError(f'Expected fairing "membrane" or "thin-plate", found "{fairing}".')
    if fairing == "thin-plate" and triangles is None:
        raise LAFlatteningError('fairing="thin-plate" continues the surface: give the triangles round the rim too.')
    around = None
    if triangles is not None:
        on_rim = np.zeros(len(points), bool)
        on_rim[np.concatenate(rims)] = True
        around = np.asarray(triangles, np.int64)
        around = around[on_rim[around].any(axis=1)]
        _check_loops(around, rims, names, len(points))

    # Patches have their own numbering: first the points of the rims, each rim backwards, so that triangles which
    # turn with that order continue the orientation of the surface; then inner points as they are made.
    outline = np.concatenate([rim[::-1] for rim in rims])
    start = np.cumsum([0] + [len(rim) for rim in rims])
    ends, length = _edges_around(points, rims, around)
    local = np.full(len(points), -1, np.int64)
    local[outline] = np.arange(len(outline))
    joined = local[ends]
    sigma = _mean_at_points(joined, length, len(outline))
    rim_of_outline = np.repeat(np.arange(len(rims)), np.diff(start))
    joined = joined[(joined >= 0).all(axis=1)]
    joined = joined[rim_of_outline[joined[:, 0]] == rim_of_outline[joined[:, 1]]]

    patches = _Patches(points[outline], sigma, rim_of_outline, joined)
    for number, (first, last) in enumerate(pairwise(start)):
        corners = points[outline[first:last]]
        pairs = joined[(joined[:, 0] >= first) & (joined[:, 0] < last)] - first
        taken = np.zeros((last - first, last - first), bool)
        taken[pairs[:, 0], pairs[:, 1]] = taken[pairs[:, 1], pairs[:, 0]] = True
        step = np.arange(last - first)
        taken[step, np.roll(step, -1)] = taken[np.roll(step, -1), step] = False
        found = minimum_area_triangulation(corners, taken)
        if found is None:
            # Every triangulation would use an edge of the surface again: a fan round a new point does not.
            centre = patches.add_points(corners.mean(axis=0)[None], sigma[first:last].mean()[None], np.array([number]))
            found = np.stack([step, np.roll(step, -1), np.full(len(step), centre[0] - first)], axis=1)
        patches.add_triangles(found + first, number)
    patches.join()
    patches.relax()
    patches.unfold()
    patches.refine()
    patches.ensure_inner_points()
    _fair_membrane(patches)
    if around is not None and fairing == "thin-plate":
        _fair_thin_plate(patches, points, outline, around)

    fixed = len(outline)
    order = np.argsort(patches.rim_of_point[fixed:], kind="stable")
    new_id = np.concatenate([outline, np.empty(len(order), np.int64)])
    new_id[fixed + order] = len(points) + np.arange(len(order))
    by_rim = np.argsort(patches.rim_of_triangle, kind="stable")
    return _Covers(
        patches.points[fixed:][order],
        new_id[patches.triangles[by_rim]],
        patches.rim_of_point[fixed:][order],
        patches.rim_of_triangle[by_rim],
    )


def _checked_rims(points: FloatArray, rims: Sequence[IntArray], names: Sequence[str]) -> list[IntArray]:
    """The rims as int64 arrays of distinct ids, none in two rims."""
    owner = np.full(len(points), -1, np.int64)
    checked = []
    for number, (given, name) in enumerate(zip(rims, names, strict=True)):
        rim = np.asarray(given)
        if rim.ndim != 1 or len(rim) < 3 or rim.dtype.kind not in "iu":
            raise SurfaceError(
                f"{name}: expected a loop of at least 3 point ids, found an array of shape {rim.shape} and type "
                f"{rim.dtype}. Take it from Surface.boundary_loops."
            )
        if rim.min() < 0 or rim.max() >= len(points):
            bad = rim.min() if rim.min() < 0 else rim.max()
            raise SurfaceError(
                f"{name} has point {bad}, expected ids from 0 to {len(points) - 1}. Take it from the same surface."
            )
        ids, times = np.unique(rim, return_counts=True)
        if (times > 1).any():
            raise SurfaceError(
                f"{name} passes point {ids[times > 1][0]} more than once. Expected each point once, without the "
                "first repeated at the end."
            )
        if not np.isfinite(points[rim]).all():
            raise SurfaceError(f"{name} has points with coordinates that are not a number. Remove them first.")
        other = owner[rim].max()
        if other >= 0:
            raise SurfaceError(
                f"{name} shares point {rim[owner[rim] >= 0][0]} with {names[other]}. Give each opening once."
            )
        owner[rim] = number
        checked.append(rim.astype(np.int64))
    return checked


def _check_loops(around: IntArray, rims: Sequence[IntArray], names: Sequence[str], n: int) -> None:
    """Each edge of a rim must be used by one triangle, in the rim's direction."""
    half = topology.half_edges(around)
    keys = np.sort(half[:, 0] * n + half[:, 1])
    for rim, name in zip(rims, names, strict=True):
        following = np.roll(rim, -1)
        forward = _contains(keys, rim * n + following)
        backward = _contains(keys, following * n + rim)
        if backward.all() and not forward.any():
            raise SurfaceError(
                f"{name} runs the wrong way: expected the surface on the left of the loop, as in "
                "Surface.boundary_loops. Reverse it."
            )
        wrong = ~forward | backward
        if wrong.any():
            k = int(np.flatnonzero(wrong)[0])
            found = "an edge inside the surface" if forward[k] else "no edge of the surface in this direction"
            raise SurfaceError(
                f"{name} is not a loop of the surface's boundary: {np.count_nonzero(wrong)} of its {len(rim)} steps "
                f"are not boundary edges (from point {rim[k]} to {following[k]} there is {found}). "
                "Take it from Surface.boundary_loops of the same surface."
            )


def _contains(ordered: IntArray, values: IntArray) -> BoolArray:
    """Which values are in a sorted array."""
    if len(ordered) == 0:
        return np.zeros(values.shape, bool)
    place = np.minimum(np.searchsorted(ordered, values), len(ordered) - 1)
    return ordered[place] == values


def _edges_around(points: FloatArray, rims: Sequence[IntArray], around: IntArray | None) -> tuple[IntArray, FloatArray]:
    """Edges that touch the rims, (e, 2) and their lengths: those of the surface, or the rims' own."""
    if around is None:
        ends = np.concatenate([np.stack([rim, np.roll(rim, -1)], axis=1) for rim in rims])
    else:
        ends = topology.edges(around).points
    return ends, np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)


def _mean_at_points(ends: IntArray, length: FloatArray, n: int) -> FloatArray:
    """Liepa's sigma: mean length of the edges at each point, (n,); ends that are -1 do not count."""
    flat, weight = ends.reshape(-1), np.repeat(length, 2)
    counted = flat >= 0
    total = np.bincount(flat[counted], weight[counted], minlength=n)
    return total / np.bincount(flat[counted], minlength=n)


# ---- minimum area ---------------------------------------------------------------------------------------------------


def minimum_area_triangulation(corners: FloatArray, taken: BoolArray | None = None) -> IntArray | None:
    """Triangulate a closed polygon in space, without new points, with the least total area.

    Parameters
    ----------
    corners : (n, 3) in order, n >= 3; the polygon need be neither flat nor convex.
    taken : (n, n) symmetric, pairs of corners that no triangle may join.

    Returns
    -------
    (n - 2, 3) triangles that turn with the polygon, or None if the taken pairs leave no triangulation.
    Exact up to `EXACT_LIMIT` corners: dynamic programming over chains of corners, O(n^3). Equal areas (every
    triangulation of a flat convex polygon) are decided by the least sum of squared diagonals. A longer polygon is
    cut along the most central triangle of the solution for `COARSE_POINTS` of its corners, and the three parts are
    solved by themselves.

    Source: Barequet and Sharir 1995; Liepa 2003.

    Examples
    --------
    >>> import numpy as np
    >>> arrow = np.array([[0.0, 0, 0], [2, 1, 0], [0, 2, 0], [1, 1, 0]])
    >>> minimum_area_triangulation(arrow).tolist()
    [[0, 1, 3], [1, 2, 3]]
    """
    n = len(corners)
    if taken is None:
        taken = np.zeros((n, n), bool)
    pieces, found = [np.arange(n)], []
    while pieces:
        piece = pieces.pop()
        if len(piece) <= EXACT_LIMIT:
            triangles = _least_area(corners[piece], taken[np.ix_(piece, piece)])
            if triangles is None:
                return None
            found.append(piece[triangles])
            continue
        chosen = np.unique(np.linspace(0, len(piece) - 1, COARSE_POINTS).astype(np.int64))
        sample = piece[chosen]
        triangles = _least_area(corners[sample], taken[np.ix_(sample, sample)])
        if triangles is None:
            return None
        # The triangle that leaves the smallest largest part.
        i, k, j = chosen[triangles].T
        balance = np.maximum(np.maximum(k - i, j - k), len(piece) - (j - i))
        cut = int(balance.argmin())
        i, k, j = int(i[cut]), int(k[cut]), int(j[cut])
        found.append(piece[[[i, k, j]]])
        parts = [piece[i : k + 1], piece[k : j + 1], np.concatenate([piece[j:], piece[: i + 1]])]
        pieces.extend(part for part in parts if len(part) > 2)
    return np.concatenate(found)


def _least_area(corners: FloatArray, taken: BoolArray) -> IntArray | None:
    n = len(corners)
    centred = corners - corners.mean(axis=0)
    step = np.arange(n)
    # A chain of corners is known by its span (number of edges) and its first or its last corner. With one table each
    # way, [span, first] and [span, last], all chains of one span and all their splits are plain slices.
    ahead, behind = (step[None, :] + step[:, None]) % n, (step[None, :] - step[:, None]) % n
    moment = np.moveaxis(np.cross(centred[None, :], centred[ahead]), 2, 0).copy()
    moment_behind = np.moveaxis(np.cross(centred[behind], centred[None, :]), 2, 0).copy()
    squared = ((centred[None, :] - centred[ahead]) ** 2).sum(axis=2)
    free = ~taken[step[None, :], ahead]
    area = np.full((n, n), np.inf)
    area[1] = np.where(free[1], 0.0, np.inf)
    area_behind = area.copy()
    area_behind[1] = np.roll(area[1], 1)
    diagonals, diagonals_behind = np.zeros((n, n)), np.zeros((n, n))
    split = np.zeros((n, n), np.int64)
    tie = 1e-10 * max(float((centred**2).sum(axis=1).max()), np.finfo(float).tiny)
    for span in range(2, n):
        count = n - span
        # Triangle (first, split, last): twice its area vector is the sum of the moments of its sides.
        vector = (
            moment[:, 1:span, :count] + moment_behind[:, span - 1 : 0 : -1, span:] - moment[:, span, :count][:, None]
        )
        total = 0.5 * np.sqrt((vector**2).sum(axis=0))
        total += area[1:span, :count] + area_behind[span - 1 : 0 : -1, span:]
        shorter = diagonals[1:span, :count] + diagonals_behind[span - 1 : 0 : -1, span:]
        shorter[total > total.min(axis=0) + tie] = np.inf
        best = shorter.argmin(axis=0)
        column = step[:count]
        area[span, :count] = np.where(free[span, :count] | (count == 1), total[best, column], np.inf)
        diagonals[span, :count] = shorter[best, column] + squared[span, :count]
        split[span, :count] = best + 1
        area_behind[span, span:] = area[span, :count]
        diagonals_behind[span, span:] = diagonals[span, :count]
    if not np.isfinite(area[n - 1, 0]):
        return None
    triangles, chains = [], [(0, n - 1)]
    while chains:
        first, last = chains.pop()
        if last - first > 1:
            middle = first + int(split[last - first, first])
            triangles.append((first, middle, last))
            chains += [(first, middle), (middle, last)]
    return np.array(triangles, np.int64)


# ---- refinement -----------------------------------------------------------------------------------------------------


class _Patches:
    """Triangles with their neighbours, as splits and flips change them.

    ``twin[t, k]`` is the slot (3 * triangle + corner) of the same edge in the neighbour across the edge opposite
    corner k of triangle t; -1 on a rim. Many splits or flips that do not touch the same triangle are done at once.
    """

    def __init__(self, points: FloatArray, sigma: FloatArray, rim_of_point: IntArray, joined: IntArray) -> None:
        self.points = points
        self.sigma = sigma
        self.rim_of_point = rim_of_point
        self.fixed = len(points)
        self.joined = joined
        """(e, 2) pairs of rim points that an edge of the surface joins."""
        self.triangles = np.zeros((0, 3), np.int64)
        self.twin = np.zeros((0, 3), np.int64)
        self.rim_of_triangle = np.zeros(0, np.int64)
        self.changed = np.zeros(0, bool)
        """(t,) triangles whose edges are to be looked at by `relax`."""

    def add_points(self, points: FloatArray, sigma: FloatArray, rim: IntArray) -> IntArray:
        """Append points; returns their ids."""
        ids = len(self.points) + np.arange(len(points))
        self.points = np.concatenate([self.points, points])
        self.sigma = np.concatenate([self.sigma, sigma])
        self.rim_of_point = np.concatenate([self.rim_of_point, rim])
        return ids

    def add_triangles(self, triangles: IntArray, rim: int) -> None:
        """Append triangles, without neighbours until `join`."""
        self.triangles = np.concatenate([self.triangles, triangles])
        self.rim_of_triangle = np.concatenate([self.rim_of_triangle, np.full(len(triangles), rim)])

    def join(self) -> None:
        """Find the neighbours."""
        n, t = len(self.points), len(self.triangles)
        half = topology.half_edges(self.triangles)
        slot = (3 * np.arange(t)[None, :] + np.arange(3)[:, None]).reshape(-1)
        keys = half[:, 0] * n + half[:, 1]
        order = np.argsort(keys)
        reverse = half[:, 1] * n + half[:, 0]
        place = np.minimum(np.searchsorted(keys[order], reverse), len(keys) - 1)
        twin = np.full(3 * t, -1, np.int64)
        twin[slot] = np.where(keys[order[place]] == reverse, slot[order[place]], -1)
        self.twin = twin.reshape(t, 3)
        self.changed = np.ones(t, bool)

    def _move_slots(self, old: IntArray, new: IntArray) -> None:
        """Let edges that were in slots `old` be in slots `new`, on both their sides."""
        twin = self.twin.reshape(-1)
        place = np.arange(len(twin))
        place[old] = new
        other = twin[old]
        other = np.where(other >= 0, place[other], -1)
        twin[new] = other
        inner = other >= 0
        twin[other[inner]] = new[inner]

    def split(self, which: IntArray, centres: FloatArray) -> None:
        """Replace triangles by three each, round new points."""
        a, b, c = self.triangles[which].T
        x = self.add_points(centres, self.sigma[self.triangles[which]].mean(axis=1), self.rim_of_triangle[which])
        second = len(self.triangles) + np.arange(len(which))
        third = second + len(which)
        self.triangles[which] = np.stack([x, b, c], axis=1)
        self.triangles = np.concatenate([self.triangles, np.stack([a, x, c], axis=1), np.stack([a, b, x], axis=1)])
        self.rim_of_triangle = np.concatenate([self.rim_of_triangle, np.tile(self.rim_of_triangle[which], 2)])
        self.twin = np.concatenate([self.twin, np.full((2 * len(which), 3), -1, np.int64)])
        self.changed = np.concatenate([self.changed, np.ones(2 * len(which), bool)])
        self.changed[which] = True
        self._move_slots(
            np.concatenate([3 * which + 1, 3 * which + 2]), np.concatenate([3 * second + 1, 3 * third + 2])
        )
        twin = self.twin.reshape(-1)
        sides = [(3 * which + 1, 3 * second), (3 * which + 2, 3 * third), (3 * second + 2, 3 * third + 1)]
        for left, right in sides:
            twin[left], twin[right] = right, left

    def unfold(self) -> None:
        """Flip edges across which the patch turns back on itself, as at a tooth of a jagged rim, where that helps.

        The best flip first, one at a time: each lowers the sum of turns beyond a right angle, so this ends.
        """
        corner = self.points[self.triangles]
        normal = _unit(_cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]))
        slots = np.flatnonzero(self.twin.reshape(-1) >= 0)
        folded = slots[(normal[slots // 3] * normal[self.twin.reshape(-1)[slots] // 3]).sum(axis=1) < 0]
        if len(folded):
            self.changed[folded // 3] = True
            self._flip_edges(self._unfolding, alone=True)

    def relax(self) -> None:
        """Flip edges until none is worth it: Liepa's edge relaxation, a Delaunay criterion for patches in space.

        A flip must lower the sum of the cotangents of all angles. In the plane that is the Delaunay criterion
        (Musin 1997); in space it ends for certain, as the sum falls each time. It must not fold the patch, nor make
        an edge that the patch or the surface has already.
        """
        self._flip_edges(self._gains)

    def _flip_edges(
        self, worth: Callable[[IntArray, IntArray], tuple[FloatArray, IntArray]], alone: bool = False
    ) -> None:
        waiting = np.zeros(0, np.int64)
        while True:
            twin = self.twin.reshape(-1)
            asked = np.repeat(self.changed, 3)
            asked[waiting] = True
            slots = np.flatnonzero(asked & (twin >= 0))
            # Each edge once, by the smaller of its two slots.
            asked[:] = False
            asked[np.minimum(slots, twin[slots])] = True
            slots = np.flatnonzero(asked)
            self.changed[:] = False
            gain, ends = worth(slots, twin[slots])
            slots, gain, ends = slots[gain > 0], gain[gain > 0], ends[gain > 0]
            free = ~self._exists(ends)
            a, b = slots // 3, twin[slots] // 3
            # Each triangle takes part in the flip that gains most for it, if the other triangle agrees.
            by_gain = np.flatnonzero(free)[np.argsort(gain[free], kind="stable")]
            wish = np.full(len(self.triangles), -1, np.int64)
            wish[np.stack([a[by_gain], b[by_gain]], axis=1).reshape(-1)] = np.repeat(by_gain, 2)
            number = np.arange(len(slots))
            agreed = np.flatnonzero((wish[a] == number) & (wish[b] == number))
            # Two flips may not make the same edge.
            agreed = agreed[np.unique(ends[agreed], axis=0, return_index=True)[1]]
            if len(agreed) == 0:
                return
            if alone:
                agreed = agreed[[int(gain[agreed].argmax())]]
            self._flip(slots[agreed], twin[slots[agreed]])
            waiting = slots[~(self.changed[a] | self.changed[b])]

    def _exists(self, ends: IntArray) -> BoolArray:
        """Whether an edge joins these pairs (c, 2), smaller id first, in the patches or in the surface."""
        n = len(self.points)
        asked = np.zeros(n, bool)
        asked[ends[:, 0]] = True
        near = np.sort(topology.half_edges(self.triangles[asked[self.triangles].any(axis=1)]), axis=1)
        near = np.concatenate([near, np.sort(self.joined, axis=1)])
        return _contains(np.sort(near[:, 0] * n + near[:, 1]), ends[:, 0] * n + ends[:, 1])

    def _quadrilaterals(self, slots: IntArray, twins: IntArray) -> IntArray:
        """(4, c) corners p, q, s, r of the triangles (p, q, r) and (s, r, q) on edges that are opposite p and s."""
        a, i = np.divmod(slots, 3)
        b, j = np.divmod(twins, 3)
        p, q, r = (self.triangles[a, (i + k) % 3] for k in range(3))
        return np.stack([p, q, self.triangles[b, j], r])

    def _gains(self, slots: IntArray, twins: IntArray) -> tuple[FloatArray, IntArray]:
        """What flipping each edge takes off the sum of cotangents (0 where it may not be flipped), and its new ends."""
        ids = self._quadrilaterals(slots, twins)
        corner = self.points[ids]
        side = ((np.roll(corner, -1, axis=0) - corner) ** 2).sum(axis=2)  # pq, qs, sr, rp
        now, then = ((corner[[1, 0]] - corner[[3, 2]]) ** 2).sum(axis=2)
        pqr, srq, pqs, srp = _area_vectors_of_flip(corner)
        before = _shape(side[0] + side[3] + now, pqr) + _shape(side[1] + side[2] + now, srq)
        after = _shape(side[0] + side[1] + then, pqs) + _shape(side[2] + side[3] + then, srp)
        gain = before * (1.0 - 1e-9) - after
        # Both pairs of triangles have the same sum of area vectors; a new triangle against it would be folded over.
        total = pqr + srq
        gain[((pqs * total).sum(axis=1) <= 0) | ((srp * total).sum(axis=1) <= 0)] = 0.0
        return gain, np.sort(ids[[0, 2]].T, axis=1)

    def _unfolding(self, slots: IntArray, twins: IntArray) -> tuple[FloatArray, IntArray]:
        """As `_gains`, for the turns beyond a right angle across each edge and the four round it."""
        ids = self._quadrilaterals(slots, twins)
        pqr, srq, pqs, srp = (_unit(vector) for vector in _area_vectors_of_flip(self.points[ids]))
        gain = _turn(pqr, srq) - _turn(pqs, srp)
        a, i = np.divmod(slots, 3)
        b, j = np.divmod(twins, 3)
        flat = self.twin.reshape(-1)
        # Sides rp, pq of the one triangle and qs, sr of the other, and the new triangles that they will belong to.
        for outer, old, new in [
            (flat[3 * a + (i + 1) % 3], pqr, srp),
            (flat[3 * a + (i + 2) % 3], pqr, pqs),
            (flat[3 * b + (j + 1) % 3], srq, pqs),
            (flat[3 * b + (j + 2) % 3], srq, srp),
        ]:
            corner = self.points[self.triangles[outer // 3]]
            beyond = _unit(_cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]))
            gain += np.where(outer >= 0, _turn(old, beyond) - _turn(new, beyond), 0.0)
        return np.where(gain > 1e-6, gain, 0.0), np.sort(ids[[0, 2]].T, axis=1)

    def _flip(self, slots: IntArray, twins: IntArray) -> None:
        """Replace (p, q, r), (s, r, q) by (p, q, s), (s, r, p), no triangle in more than one such pair."""
        p, q, s, r = self._quadrilaterals(slots, twins)
        a, i = np.divmod(slots, 3)
        b, j = np.divmod(twins, 3)
        old = [3 * a + (i + 1) % 3, 3 * a + (i + 2) % 3, 3 * b + (j + 1) % 3, 3 * b + (j + 2) % 3]
        new = [3 * b, 3 * a + 2, 3 * a, 3 * b + 2]
        self._move_slots(np.concatenate(old), np.concatenate(new))
        self.triangles[a] = np.stack([p, q, s], axis=1)
        self.triangles[b] = np.stack([s, r, p], axis=1)
        twin = self.twin.reshape(-1)
        twin[3 * a + 1], twin[3 * b + 1] = 3 * b + 1, 3 * a + 1
        self.changed[a] = self.changed[b] = True

    def refine(self) -> None:
        """Split triangles at their centroid while they are large for the edge length round them, and relax."""
        while True:
            corner, sigma = self.points[self.triangles], self.sigma[self.triangles]
            centre = corner.mean(axis=1)
            reach = ALPHA * np.linalg.norm(corner - centre[:, None], axis=2)
            large = (reach > np.maximum(sigma, sigma.mean(axis=1, keepdims=True))).all(axis=1)
            if not large.any():
                return
            self.split(np.flatnonzero(large), centre[large])
            self.relax()
            self.unfold()

    def areas(self) -> FloatArray:
        """Area of the patch of each rim."""
        area = operators.triangle_areas(self.points, self.triangles)
        return np.bincount(self.rim_of_triangle, area).astype(np.float64)

    def ensure_inner_points(self) -> None:
        """Give a patch without inner points one, at the middle of its longest inner edge."""
        rims = self.rim_of_triangle.max() + 1
        empty = np.bincount(self.rim_of_point[self.fixed :], minlength=rims) == 0
        which, centres = [], []
        for rim in np.flatnonzero(empty):
            own = np.flatnonzero(self.rim_of_triangle == rim)
            corner = self.points[self.triangles[own]]
            length = np.linalg.norm(np.roll(corner, -1, axis=1) - np.roll(corner, -2, axis=1), axis=2)
            length[self.twin[own] < 0] = -1.0
            t, k = np.unravel_index(length.argmax(), length.shape)
            which.append(own[t])
            # A triangle split at the middle of its side leaves one without area, which `relax` flips away.
            centres.append(corner[t, [k - 2, k - 1]].mean(axis=0) if length[t, k] >= 0 else corner[t].mean(axis=0))
        if which:
            self.split(np.array(which), np.array(centres))
            self.relax()


def _cross(u: FloatArray, v: FloatArray) -> FloatArray:
    # Written out: several times faster than np.cross on short arrays.
    return np.stack([u[:, k - 2] * v[:, k - 1] - u[:, k - 1] * v[:, k - 2] for k in range(3)], axis=1)


def _area_vectors_of_flip(corner: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Twice the area vectors of (p, q, r), (s, r, q), and of (p, q, s), (s, r, p); `corner` (4, c, 3) is p, q, s, r."""
    p, q, s, r = corner
    return _cross(q - p, r - p), _cross(r - s, q - s), _cross(q - p, s - p), _cross(r - s, p - s)


def _unit(vectors: FloatArray) -> FloatArray:
    length = np.sqrt((vectors**2).sum(axis=1, keepdims=True))
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


def _turn(a: FloatArray, b: FloatArray) -> FloatArray:
    """Turn beyond a right angle between unit normals: 0, up to 1 where they are opposite."""
    return np.maximum(-(a * b).sum(axis=1), 0.0)


def _shape(squared_sides: FloatArray, twice_area: FloatArray) -> FloatArray:
    """Sum of squared sides over twice the area: twice the sum of cotangents; large but finite without area."""
    tiny = np.finfo(float).tiny
    return squared_sides / np.maximum(np.sqrt((twice_area**2).sum(axis=1)), 1e-10 * squared_sides + tiny)


# ---- fairing --------------------------------------------------------------------------------------------------------


def _harmonic(points: FloatArray, triangles: IntArray, uniform: bool = False) -> sparse.csr_matrix:
    """(n, n) Laplacian with weights that are positive, so that harmonic values lie between those given.

    Cotangent weights, with negative ones (few after `relax`) raised to almost 0; or 1 for each edge.
    """
    n = len(points)
    i, j = triangles[:, [1, 2, 0]].reshape(-1), triangles[:, [2, 0, 1]].reshape(-1)
    half = 0.5 * operators.cotangents(points, triangles).reshape(-1)
    weight = sparse.coo_matrix(
        (np.concatenate([half, half]), (np.concatenate([i, j]), np.concatenate([j, i]))), shape=(n, n)
    ).tocsr()
    weight.data = np.ones_like(weight.data) if uniform else np.clip(weight.data, 1e-6, 1e6)
    return (sparse.diags(np.asarray(weight.sum(axis=1)).ravel()) - weight).tocsr()


def _solve(matrix: sparse.csr_matrix, unknown: BoolArray, values: FloatArray) -> FloatArray:
    """Values (n, c) with those of the unknown rows replaced so that these rows of matrix @ values are 0."""
    rows = matrix[unknown]
    system = splu(
        rows[:, unknown].tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0, options={"SymmetricMode": True}
    )
    result = values.copy()
    result[unknown] = system.solve(-(rows[:, ~unknown] @ values[~unknown]))
    return result


def _fair_membrane(patches: _Patches) -> None:
    """Move inner points to where the cotangent Laplacian of their coordinates is 0: a surface of least area.

    The first solve has equal weights, which evens out the points and pulls apart what a jagged rim has pushed
    together; the others have the weights of the last shape. A patch is done when its area has stopped falling.
    """
    inner = np.arange(len(patches.points)) >= patches.fixed
    area = patches.areas()
    moving = np.ones(len(area), bool)
    for solve in range(FAIRING_SOLVES):
        matrix = _harmonic(patches.points, patches.triangles, uniform=solve == 0)
        patches.points = _solve(matrix, inner & moving[patches.rim_of_point], patches.points)
        patches.changed = moving[patches.rim_of_triangle]
        patches.relax()
        patches.unfold()
        before, area = area, patches.areas()
        if solve > 0:
            moving &= area < (1.0 - FAIRING_TOLERANCE) * before
        if not moving.any():
            return


def _fair_thin_plate(patches: _Patches, points: FloatArray, outline: IntArray, around: IntArray) -> None:
    """Move inner points to minimise the squared Laplacian, over cover and rim, with the surface round it held still.

    One linear solve with the weights of the membrane, as in the paper: with weights that follow the shape, a
    cover on a tube would grow into a balloon.
    """
    n = len(points)
    inner_ids = np.arange(len(patches.points) - patches.fixed) + n
    ids = np.concatenate([outline, inner_ids])
    triangles = np.concatenate([around, ids[patches.triangles]])
    used, compact = np.unique(triangles, return_inverse=True)
    triangles = compact.reshape(-1, 3)
    place = np.concatenate([points, patches.points[patches.fixed :]])[used]
    laplacian = operators.cotangent_laplacian(place, triangles)
    mass = operators.lumped_mass(place, triangles)
    rows = np.zeros(n + len(inner_ids), bool)
    rows[ids] = True
    counted = rows[used]
    # Triangles without area (coincident rim points) may leave a point without mass.
    mass = np.maximum(mass[counted], 1e-6 * mass[counted].mean())
    root = sparse.diags(1.0 / np.sqrt(mass)) @ laplacian[counted]
    faired = _solve((root.T @ root).tocsr(), used >= n, place)
    patches.points = np.concatenate([patches.points[: patches.fixed], faired[used >= n]])
    patches.changed[:] = True
    patches.relax()
    patches.unfold()


# ---- arrays ---------------------------------------------------------------------------------------------------------


def _neutral(values: NDArray, count: int) -> NDArray:
    """Rows for new cells: 0, False, or empty text."""
    filling = "" if values.dtype.kind in "OUS" else 0
    return np.full((count, *values.shape[1:]), filling, dtype=values.dtype)


def _continue_on_covers(surface: Surface, rims: Sequence[IntArray], covers: _Covers) -> dict[str, NDArray]:
    """The surface's point arrays with values for the inner points of covers."""
    n, k = len(surface.points), len(covers.inner)
    nearest = np.empty(k, np.int64)
    for number, rim in enumerate(rims):
        own = covers.rim_of_point == number
        nearest[own] = rim[cKDTree(surface.points[rim]).query(covers.inner[own])[1]]
    floating = {name: values for name, values in surface.point_data.items() if values.dtype.kind == "f"}
    used, compact = np.unique(covers.triangles, return_inverse=True)
    points = np.concatenate([surface.points, covers.inner])[used]
    inner = used >= n
    rim_of = np.concatenate([np.empty(n, np.int64), covers.rim_of_point])
    for number, rim in enumerate(rims):
        rim_of[rim] = number
    columns = [values.reshape(n, -1)[used[~inner]].astype(np.float64) for values in floating.values()]
    table = np.full((len(used), sum(column.shape[1] for column in columns)), np.nan)
    if columns:
        table[~inner] = np.concatenate(columns, axis=1)
        _spread(table, np.isfinite(table), _harmonic(points, compact.reshape(-1, 3)), rim_of[used])

    result, first = {}, 0
    for name, values in surface.point_data.items():
        added = values[nearest]
        if name in floating:
            width = values[:1].size
            added = table[inner, first : first + width].reshape(added.shape).astype(values.dtype)
            first += width
        result[name] = np.concatenate([values, added])
    return result


def _spread(table: FloatArray, known: BoolArray, matrix: sparse.csr_matrix, rim_of: IntArray) -> None:
    """Replace unknown values of each column by harmonic ones; those of a rim without any known value stay."""
    for pattern in np.unique(known, axis=1).T:
        alike = (known == pattern[:, None]).all(axis=0)
        unknown = ~pattern & (np.bincount(rim_of[pattern], minlength=rim_of.max() + 1) > 0)[rim_of]
        reached = unknown | pattern
        if unknown.any():
            part = np.ix_(reached, alike)
            table[part] = _solve(matrix[reached][:, reached], unknown[reached], table[part])
