"""Walking over a triangle mesh: half-edges, the fan of triangles round a point, strips of triangles."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from . import operators
from .surface import FloatArray, IntArray, Surface


class HalfEdges:
    """The triangles of an oriented surface, each with three half-edges.

    Half-edge ``3 t + k`` of triangle t leads from its corner k to corner k + 1, with the triangle on its left.
    A *strip* is a list of half-edges: a walk leaves the triangle of each through it, into the triangle of the next.

    Attributes
    ----------
    points : (n, 3) mm.
    origin : (3m,) point at which each half-edge starts.
    twin : (3m,) the half-edge that runs the other way on the same edge; -1 where no walk may cross (rims).
    angles : (n,) sum of the angles round each point, radians; infinite where a point cannot be walked round.
    first : (n,) a half-edge that starts at each point; at rims the one from which turning counter-clockwise meets
        all triangles of the point; -1 for points without triangles.
    """

    def __init__(
        self, points: FloatArray, origin: IntArray, twin: IntArray, angles: FloatArray, first: IntArray
    ) -> None:
        self.points, self.origin, self.twin, self.angles, self.first = points, origin, twin, angles, first
        # Reading single numbers through a memoryview is several times faster than from an array.
        self._origin, self._twin = memoryview(origin.data), memoryview(twin.data)

    @classmethod
    def of(cls, surface: Surface) -> HalfEdges:
        """The half-edges of a surface that is an oriented manifold; rims cannot be crossed."""
        triangles, edges = surface.triangles, surface.edges
        half = np.arange(triangles.size)
        # Half-edge k is opposite corner k + 2.
        edge = edges.of_triangle[:, [2, 0, 1]].reshape(-1)
        second = (edges.triangles[edge, 1] == half // 3).astype(np.int64)
        pair = np.full((len(edges.points), 2), -1, np.int64)
        pair[edge, second] = half
        twin = pair[edge, 1 - second]
        origin = np.ascontiguousarray(triangles).reshape(-1)
        angles = np.bincount(origin, corner_angles(surface.points, triangles), minlength=len(surface.points))
        angles[origin[twin < 0]] = np.inf
        first = np.full(len(surface.points), -1, np.int64)
        first[origin] = half
        first[origin[twin < 0]] = half[twin < 0]
        return cls(surface.points, origin, twin, angles.astype(np.float64), first)

    def end(self, h: int) -> int:
        """The point where a half-edge ends."""
        return self._origin[after(h)]

    def touches(self, h: int, point: int) -> bool:
        """Whether a half-edge starts or ends at a point."""
        return self._origin[h] == point or self._origin[after(h)] == point

    def ends(self, strip: Sequence[int] | IntArray) -> IntArray:
        """(k, 2) both points of each half-edge: where it starts (right of the walk) and ends (left of it)."""
        h = np.asarray(strip, np.int64)
        ends = np.empty((len(h), 2), np.int64)
        ends[:, 0], ends[:, 1] = self.origin[h], self.origin[h + 1 - 3 * (h % 3 == 2)]
        return ends

    @property
    def edge_keys(self) -> IntArray:
        """(3m,) one number for the edge of each half-edge: smaller id times the number of points, plus larger id."""
        ends = self.ends(np.arange(len(self.origin)))
        return ends.min(axis=1) * len(self.points) + ends.max(axis=1)

    def out_of(self, triangle: int, point: int) -> int:
        """The half-edge of a triangle that starts at one of its points."""
        h = 3 * triangle
        while self._origin[h] != point:
            h += 1
        return h

    def fan(self, point: int) -> list[int]:
        """The half-edges that start at a point, counter-clockwise; one a triangle."""
        first = int(self.first[point])
        fan = [first]
        while True:
            # Counter-clockwise, a triangle is left through the edge that comes back to the point.
            h = self._twin[fan[-1] - 1 if fan[-1] % 3 else fan[-1] + 2]
            if h < 0 or h == first:
                return fan
            fan.append(h)

    def turn(self, start: int, stop: int, point: int, left: bool) -> list[int] | None:
        """The strip round a point from one of its triangles to another; None if a rim is in between.

        Parameters
        ----------
        start, stop : triangles at the point.
        left : whether the point is on the left of the walk (which then turns counter-clockwise).
        """
        twin = self._twin
        strip: list[int] = []
        h = self.out_of(start, point)
        while h // 3 != stop:
            if left:
                h = h - 1 if h % 3 else h + 2
                strip.append(h)
                h = twin[h]
                if h < 0:
                    return None
            else:
                strip.append(h)
                h = twin[h]
                if h < 0:
                    return None
                h = h + 1 if h % 3 < 2 else h - 2
        return strip

    def along(self, points: Sequence[int], start: int | None, stop: int | None) -> list[int]:
        """A strip of triangles that passes a line of points joined by edges, each on some side.

        Parameters
        ----------
        start, stop : triangles, with the first and the last point as a corner, where the walk begins and ends; by
            default any.
        """
        strip: list[int] = []
        at = start
        for k, point in enumerate(points):
            leaving = self.fan(point)
            fan = [h // 3 for h in leaving]
            closed = self._twin[before(leaving[-1])] >= 0
            if k + 1 < len(points):
                # Both triangles on the edge to the next point will do.
                goals = [h // 3 for h in leaving if points[k + 1] in (self.end(h), self._origin[before(h)])]
            else:
                goals = [stop] if stop is not None else fan if at is None else [at]
            if at is None:
                at = goals[0]
            here = fan.index(at)
            best: tuple[int, int, bool] | None = None
            for goal in goals:
                steps = fan.index(goal) - here
                for count, left in ((steps, True), (-steps, False)):
                    if count < 0:
                        if not closed:
                            continue
                        count += len(fan)
                    if best is None or count < best[0]:
                        best = (count, goal, left)
            assert best is not None
            turned = self.turn(at, best[1], point, best[2])
            assert turned is not None
            strip += turned
            at = best[1]
        return self.without_detours(strip)

    def without_detours(self, strip: Sequence[int]) -> list[int]:
        """The same strip without loops: it enters no triangle twice."""
        if not strip or len({self._twin[strip[-1]] // 3, *(h // 3 for h in strip)}) > len(strip):
            return list(strip)
        result: list[int] = []
        place = {strip[0] // 3: 0}
        for h in strip:
            into = self._twin[h] // 3
            result.append(h)
            if into in place:
                for dropped in result[place[into] :]:
                    entered = self._twin[dropped] // 3
                    if entered != into:
                        place.pop(entered, None)
                del result[place[into] :]
            else:
                place[into] = len(result)
        return result

    @cached_property
    def apexes(self) -> NDArray[np.complex128]:
        """(3m,) the third point of the triangle of each half-edge, see `apexes`."""
        return apexes(self.points, self.origin.reshape(-1, 3))

    def diagonals(self) -> tuple[IntArray, FloatArray]:
        """The straight ways across one edge, from the third point of one triangle to that of its neighbour.

        Returns
        -------
        ends : (k, 2) point ids; only where the straight line, the two triangles laid flat, crosses the edge.
        lengths : (k,) mm.
        """
        h = np.flatnonzero(np.arange(len(self.twin)) < self.twin)
        twin = self.twin[h]
        near = self.apexes[h]
        # In the frame of h as well, where the other triangle lies below.
        far = 1.0 - self.apexes[twin]
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = far.real + (near.real - far.real) * far.imag / (far.imag - near.imag)
        seen = (crossing > 0.0) & (crossing < 1.0)
        h, twin = h[seen], twin[seen]
        ends = np.stack([self.origin[np.where(g % 3 > 0, g - 1, g + 2)] for g in (h, twin)], axis=1)
        edge = self.ends(h)
        length = np.linalg.norm(self.points[edge[:, 0]] - self.points[edge[:, 1]], axis=1)
        return ends, np.abs(near - far)[seen] * length

    def near_graph(self) -> sparse.csr_matrix:
        """(n, n) symmetric lengths, mm, of the edges and of the straight ways across one edge (`diagonals`): ways in it
        are far less jagged than along edges alone. Of several ways between two points, the shortest counts."""
        h = np.flatnonzero(np.arange(len(self.twin)) > self.twin)
        edges = self.ends(h)
        across, far = self.diagonals()
        one, other = np.concatenate([edges, across]).T
        a, b = np.minimum(one, other), np.maximum(one, other)
        lengths = np.concatenate([np.linalg.norm(self.points[edges[:, 0]] - self.points[edges[:, 1]], axis=1), far])
        n = len(self.points)
        key = a * n + b
        order = np.argsort(key)
        first = np.flatnonzero(np.diff(key[order], prepend=-1))
        shortest = np.minimum.reduceat(lengths[order], first)
        half = sparse.coo_matrix((shortest, (a[order[first]], b[order[first]])), shape=(n, n))
        return (half + half.T).tocsr()


def before(h: int) -> int:
    """The half-edge before another in its triangle: it starts at the third point."""
    return h - 1 if h % 3 else h + 2


def after(h: int) -> int:
    """The half-edge after another in its triangle."""
    return h + 1 if h % 3 < 2 else h - 2


def corner_angles(points: FloatArray, triangles: IntArray) -> FloatArray:
    """(3m,) angle at each corner, radians, in the order of the half-edges that start there."""
    return np.arctan2(1.0, operators.cotangents(points, triangles)).reshape(-1)


def apexes(points: FloatArray, triangles: IntArray) -> NDArray[np.complex128]:
    """The third point of the triangle of each half-edge as a complex number, in the frame where the half-edge leads
    from 0 to 1; the imaginary part is positive.

    Returns
    -------
    (3m,) in the order of the half-edges; not finite for half-edges without length.
    """
    along = np.roll(points[triangles], -1, axis=1)
    along -= points[triangles]
    squared = np.einsum("tki,tki->tk", along, along)
    x = -np.einsum("tki,tki->tk", along, np.roll(along, 1, axis=1))
    y = np.sqrt(np.maximum(squared * np.roll(squared, 1, axis=1) - x * x, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        return ((x + 1j * y) / squared).reshape(-1)
