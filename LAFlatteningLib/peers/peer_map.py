"""What every peer returns: a surface and the places of its points in the plane."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from .. import distortion, operators
from ..anatomy import Anatomy
from ..flattening.flat_map import POSITION_ARRAY, REGION_ARRAY, FlatMap
from ..rim_length import rim_lengths
from ..surface import FloatArray, IntArray, Surface


@dataclass(frozen=True, eq=False)
class PeerMap:
    """A cavity laid flat by some method, beside which ours is put.

    Attributes
    ----------
    name, title : identifier; for people.
    surface : the mesh that was laid flat, mm. Its first `cavity_points` points are those of the cavity, in its order;
        methods that cut the surface add others.
    points : (n, 2) places of its points on the map, in units of that map; NaN where a point has none.
    regions : (m,) number of the region of each of its triangles, by our division.
    cavity_points : number of points of the cavity.
    rims : opening -> its rim as point ids.
    fixed : opening -> (2,) the centre that the method gives it in every atrium; openings that it does not place are
        not there.
    seconds : time from the cavity (and the division, if the method needs it) to the map.
    source : where the method is described.
    notes : what deviates from the source here, for the user.
    resampled : for a method that moves data onto a mesh of its own: that mesh in the plane; see `Resampled`.
    """

    name: str
    title: str
    surface: Surface
    points: FloatArray
    regions: IntArray
    cavity_points: int
    rims: Mapping[str, IntArray]
    fixed: Mapping[str, FloatArray]
    seconds: float
    source: str
    notes: tuple[str, ...] = ()
    resampled: Resampled | None = None

    @property
    def triangles(self) -> IntArray:
        """(m, 3) point ids."""
        return self.surface.triangles

    @property
    def on_cavity(self) -> FloatArray:
        """(cavity points, 2) places of the points of the cavity, in its order."""
        return self.points[: self.cavity_points]

    @cached_property
    def half_width(self) -> float:
        """Half the larger side of the map's bounding box: the unit in which distances on the map are compared."""
        return 0.5 * float(np.ptp(self.points[np.isfinite(self.points).all(axis=1)], axis=0).max())

    @cached_property
    def folded_triangles(self) -> IntArray:
        """Indices of triangles that are turned over on the map, or have no area there."""
        return distortion.folded_triangles(self.points, self.triangles)

    @cached_property
    def summary(self) -> dict[str, Any]:
        """Figures of alpha, beta and dilatation, see `distortion.summary`."""
        return distortion.summary(self.surface.points, self.triangles, self.points)

    def centre(self, opening: str) -> FloatArray:
        """(2,) centroid of the opening on the map: that of the polygon of its rim, or of the rim's points where the
        polygon has no area."""
        rim = self.points[self.rims[opening]]
        fan = np.stack([np.arange(1, len(rim) - 1), np.arange(2, len(rim))], axis=1)
        fan = np.column_stack([np.zeros(len(fan), np.int64), fan])
        area = operators.signed_areas(rim, fan)
        if abs(area.sum()) <= 1e-12 * self.half_width**2:
            return rim.mean(axis=0)
        return np.asarray((area[:, None] * rim[fan].mean(axis=1)).sum(axis=0) / area.sum())

    @property
    def standardised(self) -> bool:
        """Whether the method puts every hole at a place of its own."""
        return bool(self.fixed)

    @cached_property
    def drift(self) -> float | None:
        """Root mean square distance of the holes' centres from their standard places, in half widths; None where the
        method has none."""
        if not self.fixed:
            return None
        away = [np.linalg.norm(self.centre(hole) - place) for hole, place in self.fixed.items()]
        return float(np.sqrt(np.mean(np.square(away)))) / self.half_width

    def to_surface(self) -> Surface:
        """The map as a surface in the plane z = 0, with the arrays of its mesh, ``position_mm`` and ``region``."""
        return Surface(
            np.column_stack([self.points, np.zeros(len(self.points))]),
            self.triangles,
            {**self.surface.point_data, POSITION_ARRAY: self.surface.points},
            {REGION_ARRAY: self.regions.astype(np.int32)},
            {"peer": np.array([self.name], dtype=object), "source": np.array([self.source], dtype=object)},
            "RAS",
        )


@dataclass(frozen=True, eq=False)
class Resampled:
    """The mesh onto which a method carries the data of every atrium, and from where.

    Attributes
    ----------
    points : (k, 2) its points on the map.
    triangles : (t, 3).
    nearest : (k,) the point of the cavity whose data each of its points takes.
    """

    points: FloatArray
    triangles: IntArray
    nearest: IntArray


@dataclass(frozen=True, eq=False)
class OuterRim:
    """The rim of the valve with a direction for each of its points.

    Attributes
    ----------
    ids : (k,) points of the cavity, counter-clockwise on the map.
    turns : (k,) in turns (0 to 1 is once round), increasing: the share of the rim's length, turned so that the seeds on
        the rim lie nearest to their angles in the template. A map whose rim is free otherwise so gets our orientation.
    """

    ids: IntArray
    turns: FloatArray = field(repr=False)

    @classmethod
    def of(cls, flat_map: FlatMap) -> OuterRim:
        """The outer rim of a map's cavity."""
        cavity, template = flat_map.cavity, flat_map.template
        lengths = rim_lengths(cavity.surface.points[cavity.outer])
        share = lengths / lengths[-1]
        anatomy = template.anatomy
        wanted, found = [], []
        for seed, path in zip(anatomy.outer_seeds, anatomy.outer_paths, strict=True):
            wanted.append(template.outer.feet[path] / 360.0)
            found.append(np.interp(flat_map.seeds.outer_at[seed], np.arange(len(share)), share))
        between = np.array(wanted) - np.array(found)
        turn = float(np.angle(np.exp(2j * np.pi * between).sum())) / (2.0 * np.pi) if wanted else 0.0
        return cls(cavity.outer, share[:-1] + turn)


def cavity_rims(flat_map: FlatMap) -> dict[str, IntArray]:
    """Opening -> its rim as point ids of the cavity, counter-clockwise on the map."""
    cavity, anatomy = flat_map.cavity, flat_map.template.anatomy
    rims = {hole: cavity.rims[flat_map.seeds.hole[hole]][::-1] for hole in anatomy.holes}
    rims[anatomy.outer] = cavity.outer
    return rims


def whole_cavity(
    flat_map: FlatMap,
    name: str,
    title: str,
    points: FloatArray,
    seconds: float,
    source: str,
    notes: tuple[str, ...],
    fixed: Mapping[str, FloatArray] | None = None,
    resampled: Resampled | None = None,
) -> PeerMap:
    """A `PeerMap` of the cavity's own mesh, from the places (n, 2) of its points."""
    return PeerMap(
        name,
        title,
        flat_map.surface,
        points,
        flat_map.regions,
        len(flat_map.surface.points),
        cavity_rims(flat_map),
        fixed or {},
        seconds,
        source,
        notes,
        resampled,
    )


def ours(flat_map: FlatMap) -> PeerMap:
    """Our own map as one of the peers; its triangles are those of the cavity."""
    anatomy: Anatomy = flat_map.template.anatomy
    return whole_cavity(
        flat_map,
        flat_map.method,
        f"{flat_map.method}, template {flat_map.template.name}",
        flat_map.points,
        float(flat_map.seconds["total"]),
        "Nunez-Garcia et al., Fast quasi-conformal regional flattening of the left atrium",
        flat_map.notes,
        {hole: np.array(flat_map.template.holes[hole].shape.centre) for hole in anatomy.holes},
    )


def place_spread(maps: Sequence[PeerMap], holes: Sequence[str]) -> float:
    """How far the holes are from their mean places, over maps of several atria by one method, in half widths: the
    root mean square over holes and atria. 0 where the method puts them at the same places in every atrium."""
    places = np.array([[found.centre(hole) / found.half_width for hole in holes] for found in maps])
    return float(np.sqrt(((places - places.mean(axis=0)) ** 2).sum(axis=2).mean()))
