"""A quick map while a seed is being moved: the map of a coarse copy of the atrium, carried to its points."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ..surface import FloatArray, IntArray, Surface
from ..template import Template
from .coarse import CoarseCopy
from .flat_map import FlatMap


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


class Previewer:
    """Makes quick maps of one cavity.

    Parameters
    ----------
    copy : its coarse copy.
    """

    def __init__(self, copy: CoarseCopy) -> None:
        self.surface = copy.surface
        self._flatten = copy.follow
        self._carrier = copy.carrier
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
