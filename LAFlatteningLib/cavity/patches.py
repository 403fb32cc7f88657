"""Refining the triangles of covers to the edge length round them (Liepa 2003, section 3), for all rims together."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .. import operators, topology

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

ALPHA = np.sqrt(2.0)
"""Liepa's density: a triangle is split while its corners are farther than sigma / ALPHA from its centroid."""


class Patches:
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
        return contains(np.sort(near[:, 0] * n + near[:, 1]), ends[:, 0] * n + ends[:, 1])

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


def contains(ordered: IntArray, values: IntArray) -> BoolArray:
    """Which values are in a sorted array."""
    if len(ordered) == 0:
        return np.zeros(values.shape, bool)
    place = np.minimum(np.searchsorted(ordered, values), len(ordered) - 1)
    return ordered[place] == values
