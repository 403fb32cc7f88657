"""Geometry on a sphere for the phantom: directions, caps, and the division by great circles between seeds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..anatomy import Anatomy

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))


def direction(azimuth: float, elevation: float) -> FloatArray:
    """Unit vector (3,) in LPS: azimuth in degrees from posterior to the patient's left, elevation to superior.

    Examples
    --------
    >>> direction(90.0, 0.0).round(9).tolist()
    [1.0, 0.0, 0.0]
    """
    a, e = np.radians([azimuth, elevation])
    return np.array([np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), np.sin(e)])


def angles_between(directions: FloatArray, axis: FloatArray) -> FloatArray:
    """Angle of each unit vector of `directions` (n, 3) with the unit vector `axis` (3,), radians."""
    # The chord is accurate for small angles, where the arc cosine is not.
    return 2.0 * np.arcsin(np.minimum(0.5 * np.linalg.norm(directions - axis, axis=-1), 1.0))


def tangent_frame(axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors orthogonal to `axis` and to each other, by which angles round it are counted.

    The first points as far superior (+z) as possible, the second is a quarter turn counter-clockwise from it,
    seen from outside (looking against `axis`).
    """
    up = np.array([0.0, 0.0, 1.0])
    first = up - axis[2] * axis
    first /= np.linalg.norm(first)
    return first, np.cross(axis, first)


def fibonacci_sphere(count: int) -> FloatArray:
    """Evenly spread unit vectors, (count, 3), each for the same area; a spiral about an axis askew to the patient's."""
    k = np.arange(count) + 0.5
    z = 1.0 - 2.0 * k / count
    rho = np.sqrt(1.0 - z * z)
    turn = k * GOLDEN_ANGLE
    axis = direction(163.0, -41.0)
    first, second = tangent_frame(axis)
    return (rho * np.cos(turn))[:, None] * first + (rho * np.sin(turn))[:, None] * second + z[:, None] * axis


def solid_angle(a: FloatArray, b: FloatArray, c: FloatArray) -> float:
    """Signed solid angle of the spherical triangle of three unit vectors (Van Oosterom and Strackee 1983)."""
    return float(2.0 * np.arctan2(a @ np.cross(b, c), 1.0 + a @ b + b @ c + c @ a))


@dataclass(frozen=True)
class Caps:
    """A sphere, and the caps of it that openings take away.

    Attributes
    ----------
    radius : of the sphere, mm.
    axes : opening -> unit vector to the centre of its cap.
    angles : opening -> angular radius of its cap, radians.
    """

    radius: float
    axes: Mapping[str, FloatArray]
    angles: Mapping[str, float]

    def distance(self, opening: str, directions: FloatArray) -> FloatArray:
        """Distance along the sphere from unit vectors (n, 3) to the edge of a cap, (n,) mm, negative in the cap."""
        return self.radius * (angles_between(directions, self.axes[opening]) - self.angles[opening])


@dataclass(frozen=True, eq=False)
class SphericalDivision:
    """A division of the sphere by great circle arcs between the seeds of an anatomy.

    Attributes
    ----------
    anatomy : which arcs there are, and which bound each region.
    nodes : seed -> unit vector (3,).
    apex : unit vector (3,) to the centre of the outer opening. Where an arc ends on the outer rim, the border goes on
        to the apex and back out to the next arc, so that regions are polygons and share the outer opening out.
    """

    anatomy: Anatomy
    nodes: Mapping[str, FloatArray]
    apex: FloatArray

    @cached_property
    def _signed_angles(self) -> dict[int, float]:
        """Region -> sum of the solid angles of its triangles: less by 4 pi if it holds the point opposite the apex."""
        return {
            region: sum(sign * solid_angle(*corners) for sign, corners in self._fan(region))
            for region in self.anatomy.regions
        }

    def solid_angles(self) -> dict[int, float]:
        """Region -> solid angle, in closed form; they add up to 4 pi."""
        return {region: angle + 4.0 * np.pi * (angle < 0.0) for region, angle in self._signed_angles.items()}

    def _fan(self, region: int) -> list[tuple[int, tuple[FloatArray, FloatArray, FloatArray]]]:
        """A region as signed spherical triangles, all with a corner in the apex."""
        fan = []
        for path, end in self.anatomy.face(region):
            first, second = (self.nodes[seed] for seed in self.anatomy.paths[path])
            fan.append((1 - 2 * end, (self.apex, first, second)))
        return fan

    def corner_angles(self, region: int) -> dict[str, float]:
        """Opening -> angle of a region's corner there, radians."""
        face = self.anatomy.face(region)
        angles = {}
        for (path, end), (after, start) in zip(face, face[1:] + face[:1], strict=True):
            here, back = self.anatomy.paths[path][1 - end], self.anatomy.paths[path][end]
            opening = self.anatomy.opening_of(here)
            leaving, onward = self.anatomy.paths[after][start], self.anatomy.paths[after][1 - start]
            # At the outer rim the border comes in through one seed and leaves through another.
            at_outer = opening == self.anatomy.outer
            first, second = tangent_frame(self.apex if at_outer else self.nodes[opening])
            azimuth = [
                np.arctan2(self.nodes[seed] @ second, self.nodes[seed] @ first)
                for seed in ((here, leaving) if at_outer else (back, onward))
            ]
            angles[opening] = float((azimuth[0] - azimuth[1]) % (2.0 * np.pi))
        return angles

    def region_of(self, directions: FloatArray) -> IntArray:
        """Region of each unit vector (n, 3), (n,)."""
        u = np.asarray(directions, np.float64)
        side = {label: u @ np.cross(self.apex, node) for label, node in self.nodes.items()}
        covered = {}
        for path, (first, second) in self.anatomy.paths.items():
            a, b = self.nodes[first], self.nodes[second]
            beyond = u @ np.cross(a, b)
            # Half-open, so that a direction on the common side of two triangles is in one of them.
            if self.apex @ np.cross(a, b) > 0.0:
                covered[path] = ((side[first] >= 0.0) & (side[second] < 0.0) & (beyond >= 0.0)).astype(np.int64)
            else:
                covered[path] = -((side[second] >= 0.0) & (side[first] < 0.0) & (beyond < 0.0)).astype(np.int64)
        result = np.zeros(len(u), np.int64)
        for region in self.anatomy.regions:
            # The triangles of a region cover it once; if it holds the point opposite the apex, all but it.
            times = sum((1 - 2 * end) * covered[path] for path, end in self.anatomy.face(region))
            result[times == (0 if self._signed_angles[region] < 0.0 else 1)] = region
        return result
