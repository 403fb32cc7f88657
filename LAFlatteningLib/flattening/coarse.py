"""A coarse copy of an atrium, whose map is a quick preview of the full one and the start for it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from functools import partial
from typing import Any

import numpy as np
from scipy import sparse
from vtkmodules.vtkCommonCore import reference
from vtkmodules.vtkCommonDataModel import vtkGenericCell, vtkStaticCellLocator
from vtkmodules.vtkFiltersCore import vtkQuadricDecimation

from ..surface import FloatArray, IntArray, Surface
from .flat_map import FlatMap

COARSE_POINTS = (1200, 1000, 1600, 2000, 3000, 5000)
"""Points of the coarse copy, about; the next number is tried where decimation spoils the mesh."""
COARSE_STEPS = (2, 2, 4)
"""Quasi-Newton steps on the coarse copy, see `refinement.STEPS`."""


Start = Callable[[FloatArray], FloatArray]
"""From points of a surface (k, 3) to places on the map (k, 2), from which its map is made."""


def coarsened(surface: Surface, points: int) -> Surface:
    """A surface of about the same shape with fewer points, without data (quadric error decimation).

    Parameters
    ----------
    surface : an open surface.
    points : as many points are left, about; the surface itself where it has no more.
    """
    if len(surface.points) <= points:
        return Surface(surface.points, surface.triangles, space=surface.space)
    decimation = vtkQuadricDecimation()
    decimation.SetInputData(Surface(surface.points, surface.triangles).to_polydata())
    decimation.SetTargetReduction(1.0 - points / len(surface.points))
    decimation.Update()
    made = Surface.from_polydata(decimation.GetOutput(), surface.space)
    used = np.flatnonzero(made.used_points)
    return made.submesh(np.ones(len(made.triangles), bool))[0] if len(used) < len(made.points) else made


class CoarseCopy:
    """The coarse copy of one cavity, and its map for some seeds.

    Parameters
    ----------
    coarse : the coarse copy.
    surface : the cavity as it is flattened.
    flatten : makes a map of the coarse copy from seeds (label -> (3,) mm), if need be from given places on.
    """

    def __init__(
        self,
        coarse: Surface,
        surface: Surface,
        flatten: Callable[[Mapping[str, FloatArray], Start | None], FlatMap],
    ) -> None:
        self.surface = surface
        self.carrier = Carrier(coarse, surface)
        self._make = flatten
        self._latest: tuple[bytes, FlatMap] | None = None
        self._followed: tuple[bytes, FlatMap] | None = None

    def made_by(self, flatten: Callable[[Mapping[str, FloatArray], Start | None], FlatMap]) -> CoarseCopy:
        """The same copy with its map made otherwise, as for another template."""
        other = copy(self)
        other._make, other._latest, other._followed = flatten, None, None
        return other

    def flatten(self, seeds: Mapping[str, FloatArray]) -> FlatMap:
        """The map of the copy, which depends on these seeds alone; that of the seeds asked for last is kept.

        Raises
        ------
        SurfaceError, SeedError, FoldError : now and then for the copy alone.
        """
        key = _key(seeds)
        if self._latest is None or self._latest[0] != key:
            self._latest = key, self._make(seeds, None)
        return self._latest[1]

    def follow(self, seeds: Mapping[str, FloatArray]) -> FlatMap:
        """The map of the copy, made from the one asked for before: quicker while seeds move little by little.

        Raises
        ------
        SurfaceError, SeedError, FoldError : now and then for the copy alone.
        """
        key = _key(seeds)
        if self._latest is not None and self._latest[0] == key:
            self._followed = self._latest
        before = self._followed or self._latest
        if before is None or before[0] != key:
            start = None if before is None else partial(self._places, before[1])
            self._followed = key, self._make(seeds, start)
        assert self._followed is not None
        return self._followed[1]

    def carried(self, seeds: Mapping[str, FloatArray], points: FloatArray) -> FloatArray:
        """Where the map of the copy has the points of a finer mesh, (k, 2).

        On each side of a path by the triangles of that side, for a map bends there.

        Parameters
        ----------
        points : (k, 3) mm; the first ones are those of `surface`.

        Raises
        ------
        SurfaceError, SeedError, FoldError : see `flatten`.
        """
        coarse, n = self.flatten(seeds), len(self.surface.points)
        flat = np.empty((len(points), 2))
        flat[:n] = self.carrier(coarse.points)
        # Where paths cut the copy, it bends within its triangles.
        triangle = np.concatenate([self.carrier.triangle, self.carrier.locate(points[n:])[0]])
        cut = np.flatnonzero(np.bincount(coarse.division.parent, minlength=len(coarse.triangles))[triangle] > 1)
        cut = np.union1d(cut, np.arange(n, len(points)))
        flat[cut] = _carried(coarse, triangle[cut], points[cut])
        return flat

    def _places(self, coarse: FlatMap, points: FloatArray) -> FloatArray:
        """Where a map of the copy has the points of the copy and others on it, (k, 2)."""
        n = len(coarse.points)
        added = points[n:]
        return np.concatenate([coarse.points, _carried(coarse, self.carrier.locate(added)[0], added)])


class Carrier:
    """Carries values between the points of a surface and those of its coarse copy.

    Parameters
    ----------
    coarse : the copy.
    surface : the surface.
    """

    def __init__(self, coarse: Surface, surface: Surface) -> None:
        self._locator = vtkStaticCellLocator()
        self._locator.SetDataSet(coarse.to_polydata())
        self._locator.BuildLocator()
        n = len(surface.points)
        self.triangle, nearest = self.locate(surface.points)
        """(n,) the triangle of the copy nearest to each point of the surface."""
        corners = coarse.triangles[self.triangle]
        shares = _shares(nearest, coarse.points[corners])
        self._matrix = sparse.csr_matrix(
            (shares.reshape(-1), corners.reshape(-1), np.arange(0, 3 * n + 1, 3)), shape=(n, len(coarse.points))
        )

    def __call__(self, values: FloatArray) -> FloatArray:
        """Values (points of the copy, k) at the points of the surface, (n, k): linear in each triangle of the copy."""
        return self._matrix @ values

    def locate(self, points: FloatArray) -> tuple[IntArray, FloatArray]:
        """The triangle of the copy nearest to each of some points (k, 3), and the place on it, (k,) and (k, 3)."""
        triangle = np.empty(len(points), np.int64)
        nearest = np.empty((len(points), 3))
        at = [0.0, 0.0, 0.0]
        # Out-parameters, which the type stubs of VTK take for numbers.
        cell_id: Any = reference(0)
        rest: Any = (reference(0), reference(0.0))
        cell = vtkGenericCell()
        for k, point in enumerate(points.tolist()):
            self._locator.FindClosestPoint(point, at, cell, cell_id, *rest)
            triangle[k] = int(cell_id)
            nearest[k] = at
        return triangle, nearest


def _carried(coarse: FlatMap, triangle: IntArray, points: FloatArray) -> FloatArray:
    """Where a map has points (k, 3), each near a triangle of it (k,): (k, 2)."""
    parent, cut = coarse.division.parent, coarse.division.surface
    # All pieces of the triangle that a point is in; of these the one that it lies in deepest.
    count = np.bincount(parent, minlength=len(coarse.triangles))
    first = np.cumsum(count) - count
    pieces = count[triangle]
    point = np.repeat(np.arange(len(points)), pieces)
    number = np.arange(len(point)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    corners = cut.triangles[np.argsort(parent, kind="stable")[first[triangle[point]] + number]]
    shares = _shares(points[point], cut.points[corners])
    order = np.lexsort((-shares.min(axis=1), point))
    best = order[np.searchsorted(point, np.arange(len(points)))]
    # Points beside the copy go to the nearest side.
    inside = np.maximum(shares[best], 0.0)
    inside /= inside.sum(axis=1, keepdims=True)
    return np.einsum("ij,ijk->ik", inside, coarse.solution[corners[best]])


def _key(seeds: Mapping[str, FloatArray]) -> bytes:
    return b"".join(np.asarray(seeds[label], np.float64).tobytes() for label in sorted(seeds))


def _shares(places: FloatArray, corners: FloatArray) -> FloatArray:
    """Barycentric coordinates of places (k, 3) in triangles (k, 3, 3), after projection onto their planes: (k, 3)."""
    a = corners[:, 0]
    u, v, w = corners[:, 1] - a, corners[:, 2] - a, places - a
    uu, uv, vv, wu, wv = (np.einsum("ij,ij->i", x, y) for x, y in ((u, u), (u, v), (v, v), (w, u), (w, v)))
    determinant = np.maximum(uu * vv - uv * uv, 1e-300)
    second, third = (vv * wu - uv * wv) / determinant, (uu * wv - uv * wu) / determinant
    return np.stack([1.0 - second - third, second, third], axis=1)
