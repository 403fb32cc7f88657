"""A quick map while a seed is being moved: the map of a coarse copy of the atrium, carried to its points."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from vtkmodules.vtkFiltersCore import vtkQuadricDecimation

from ..carrying import closest_points
from ..surface import FloatArray, IntArray, Surface
from ..template import Template
from .flat_map import FlatMap

COARSE_POINTS = (1200, 2000, 3000, 5000)
"""Points of the coarse copy, about; the next number is tried where decimation spoils the mesh."""
PREVIEW_STEPS = (2, 2, 4)
"""Quasi-Newton steps on the coarse copy, see `refinement.STEPS`."""


@dataclass(frozen=True, eq=False)
class Preview:
    """A quick map, for the eye: close to the map of the same seeds, but a few of its triangles may be folded.

    Attributes
    ----------
    points : (n, 2) map positions of the points of `surface`, in map units.
    surface : the cavity in 3D, mm, with the triangles of the map.
    regions : (m,) region number of each triangle.
    template : the template.
    lines : path -> (k, 3) mm, from foot to foot on the coarse copy.
    """

    points: FloatArray
    surface: Surface
    regions: IntArray
    template: Template
    lines: Mapping[str, FloatArray]

    @property
    def triangles(self) -> IntArray:
        """(m, 3) point ids, counter-clockwise on the map."""
        return self.surface.triangles


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


class Previewer:
    """Makes quick maps of one cavity.

    Parameters
    ----------
    coarse : the coarse copy.
    surface : the cavity as it is flattened.
    flatten : makes a map of the coarse copy from seeds.
    """

    def __init__(
        self, coarse: Surface, surface: Surface, flatten: Callable[[Mapping[str, FloatArray]], FlatMap]
    ) -> None:
        self.surface = surface
        self._flatten = flatten
        self._carrier = Carrier(coarse, surface)
        self._reference: tuple[FlatMap, FloatArray] | None = None

    def preview(self, seeds: Mapping[str, FloatArray], rims: Mapping[str, IntArray], latest: FlatMap | None) -> Preview:
        """A quick map.

        Parameters
        ----------
        seeds : label -> (3,) mm.
        rims : opening -> its points; they go exactly onto its outline.
        latest : the last map of this cavity, if there is one: the quick map adds to it what moving the seeds from
            there does on the coarse copy, so that nothing jumps when a seed is picked up or let go.
        """
        if latest is not None and (self._reference is None or self._reference[0] is not latest):
            before = self._flatten(latest.seeds.positions)
            self._reference = latest, latest.points - self._carrier(before.points)
        coarse = self._flatten(seeds)
        points = self._carrier(coarse.points)
        if latest is not None and self._reference is not None:
            points += self._reference[1]
        for opening, rim in rims.items():
            points[rim] = coarse.template.rim(opening).shape.project(points[rim])
        lines = {name: coarse.division.surface.points[ids] for name, ids in coarse.division.paths.items()}
        regions = coarse.regions[self._carrier.triangle[self.surface.triangles[:, 0]]]
        return Preview(points, self.surface, regions, coarse.template, lines)


class Carrier:
    """Carries values between the points of a surface and those of its coarse copy.

    Parameters
    ----------
    coarse : the copy.
    surface : the surface.
    """

    def __init__(self, coarse: Surface, surface: Surface) -> None:
        closest = closest_points(coarse, surface.points)
        self.triangle = closest.triangle
        """(n,) the triangle of the copy nearest to each point of the surface."""
        n = len(surface.points)
        corners = coarse.triangles[closest.triangle]
        self._matrix = sparse.csr_matrix(
            (closest.weights.reshape(-1), corners.reshape(-1), np.arange(0, 3 * n + 1, 3)),
            shape=(n, len(coarse.points)),
        )

    def __call__(self, values: FloatArray) -> FloatArray:
        """Values (points of the copy, k) at the points of the surface, (n, k): linear in each triangle of the copy."""
        return self._matrix @ values
