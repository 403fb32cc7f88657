"""Outlines on the map: ellipses, and, for the outer rim, rectangles and convex polygons.

A place on an outline is named by an angle in degrees, counter-clockwise. All outlines answer the same questions, so
that nobody has to ask of which kind one is.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import TemplateError

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Shape:
    """An ellipse in the plane; a circle is one with equal semi-axes.

    Its angles parametrise the ellipse: for a circle they are the ordinary angle about its centre.

    Attributes
    ----------
    centre, semi_axes : in map units.
    rotation : degrees, counter-clockwise.
    """

    centre: tuple[float, float]
    semi_axes: tuple[float, float]
    rotation: float = 0.0

    def at(self, degrees: ArrayLike) -> FloatArray:
        """Points of the outline at some angles, shape of the angles with a last axis of 2."""
        t = np.deg2rad(np.asarray(degrees, dtype=np.float64))
        x, y = self.semi_axes[0] * np.cos(t), self.semi_axes[1] * np.sin(t)
        c, s = np.cos(np.deg2rad(self.rotation)), np.sin(np.deg2rad(self.rotation))
        return np.stack([self.centre[0] + c * x - s * y, self.centre[1] + s * x + c * y], axis=-1)

    def _lengths(self, start: float, end: float) -> tuple[FloatArray, FloatArray]:
        degrees = np.linspace(start, end, 2001)
        steps = np.linalg.norm(np.diff(self.at(degrees), axis=0), axis=1)
        return degrees, np.concatenate([[0.0], np.cumsum(steps)])

    def arc_length(self, start: float, end: float) -> float:
        """Length of the outline from one angle to another, going counter-clockwise if `end` is larger."""
        if self.semi_axes[0] == self.semi_axes[1]:
            return float(abs(np.deg2rad(end - start)) * self.semi_axes[0])
        return float(self._lengths(start, end)[1][-1])

    def angle_at(self, start: float, end: float, fraction: FloatArray) -> FloatArray:
        """Angles at which a fraction of the outline's *length* between two angles has been walked, degrees."""
        if self.semi_axes[0] == self.semi_axes[1]:
            return start + (end - start) * fraction
        degrees, lengths = self._lengths(start, end)
        return np.interp(fraction * lengths[-1], lengths, degrees)

    def project(self, points: FloatArray) -> FloatArray:
        """The places (k, 2) where the rays from the centre through points (k, 2) meet the outline."""
        c, s = np.cos(np.deg2rad(self.rotation)), np.sin(np.deg2rad(self.rotation))
        offset = points - np.asarray(self.centre)
        scale = np.linalg.norm(offset @ np.array([[c, -s], [s, c]]) / np.asarray(self.semi_axes), axis=1)[:, None]
        # The centre itself is on no ray: the end of the shorter axis is nearest to it.
        nearest = self.at(90.0 * int(np.argmin(self.semi_axes)))
        return np.where(scale > 0.0, self.centre + offset / np.where(scale > 0.0, scale, 1.0), nearest)

    def angle_of(self, point: ArrayLike) -> float:
        """The angle (degrees, 0 to 360) at which the ray from the centre through a point (2,) meets the outline."""
        c, s = np.cos(np.deg2rad(self.rotation)), np.sin(np.deg2rad(self.rotation))
        x, y = (np.asarray(point, dtype=np.float64) - self.centre) @ np.array([[c, -s], [s, c]]) / self.semi_axes
        return float(np.rad2deg(np.arctan2(y, x)) % 360.0)

    def contains(self, points: FloatArray) -> NDArray[np.bool_]:
        """Whether points (k, 2) are inside the outline, (k,)."""
        c, s = np.cos(np.deg2rad(self.rotation)), np.sin(np.deg2rad(self.rotation))
        local = (points - np.asarray(self.centre)) @ np.array([[c, -s], [s, c]]) / np.asarray(self.semi_axes)
        return np.einsum("ij,ij->i", local, local) < 1.0

    def distance(self, points: FloatArray) -> FloatArray:
        """How far points (k, 2) are from the outline, measured along the ray from its centre; (k,)."""
        return np.linalg.norm(points - self.project(points), axis=1)

    def angles_between(self, start: float, end: float, count: int) -> FloatArray:
        """Angles from one to another, both included, evenly spaced; and between them those of all corners."""
        return np.linspace(start, end, count)

    def filled(self, points: FloatArray, kept: NDArray[np.int64]) -> FloatArray:
        """Points (k, 2) spread along the outline, with one moved into each corner: the nearest that is not `kept`."""
        return points

    def outline(self, count: int = 180) -> FloatArray:
        """A closed polygon of the outline, (count, 2), without repeating the first point."""
        return self.at(np.linspace(0.0, 360.0, count, endpoint=False))

    def to_dict(self) -> dict[str, Any]:
        """The ``shape`` object of a template file."""
        centre = list(self.centre)
        if self.semi_axes[0] == self.semi_axes[1] and self.rotation == 0.0:
            return {"type": "circle", "centre": centre, "radius": self.semi_axes[0]}
        turned = {"rotation_degrees": self.rotation} if self.rotation else {}
        return {"type": "ellipse", "centre": centre, "semi_axes": list(self.semi_axes), **turned}


@dataclass(frozen=True)
class Cornered(Shape, ABC):
    """What convex outlines with straight sides share. Their angles are those of rays from the centre."""

    @property
    @abstractmethod
    def corners(self) -> FloatArray:
        """(k, 2), counter-clockwise."""

    def _sides(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """First corner of each side (k, 2); way to its second (k, 2); angle of each corner and at last of the first
        again, increasing, degrees, (k + 1,); length of the outline up to each of these, (k + 1,)."""
        corners = self.corners
        sides = np.roll(corners, -1, axis=0) - corners
        x, y = (corners - np.asarray(self.centre)).T
        angles = np.rad2deg(np.unwrap(np.arctan2(y, x)))
        lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*sides.T))])
        return corners, sides, np.append(angles, angles[0] + 360.0), lengths

    def _places(self, degrees: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
        """On which side rays from the centre meet the outline, and at what share of it."""
        corners, sides, angles, _ = self._sides()
        turned = angles[0] + (degrees - angles[0]) % 360.0
        side = np.clip(np.searchsorted(angles, turned, side="right") - 1, 0, len(corners) - 1)
        ray = np.stack([np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))], axis=-1)
        share = _cross(ray, np.asarray(self.centre) - corners[side]) / _cross(ray, sides[side])
        return side, np.clip(share, 0.0, 1.0)

    def _walked(self, degrees: ArrayLike) -> FloatArray:
        """Length of the outline from the first corner to some angles, growing on from turn to turn."""
        degrees = np.asarray(degrees, dtype=np.float64)
        side, share = self._places(degrees)
        _, _, angles, lengths = self._sides()
        turns = np.floor((degrees - angles[0]) / 360.0)
        return turns * lengths[-1] + lengths[side] + share * np.diff(lengths)[side]

    def at(self, degrees: ArrayLike) -> FloatArray:
        """See `Shape.at`."""
        side, share = self._places(np.asarray(degrees, dtype=np.float64))
        corners, sides, _, _ = self._sides()
        return corners[side] + share[..., None] * sides[side]

    def arc_length(self, start: float, end: float) -> float:
        """See `Shape.arc_length`."""
        return float(abs(self._walked(end) - self._walked(start)))

    def angle_at(self, start: float, end: float, fraction: FloatArray) -> FloatArray:
        """See `Shape.angle_at`."""
        corners, sides, angles, lengths = self._sides()
        first, last = self._walked(start), self._walked(end)
        walked = first + (last - first) * np.asarray(fraction, dtype=np.float64)
        turns = np.floor(walked / lengths[-1])
        left = walked - turns * lengths[-1]
        side = np.clip(np.searchsorted(lengths, left, side="right") - 1, 0, len(corners) - 1)
        share = (left - lengths[side]) / np.diff(lengths)[side]
        x, y = np.moveaxis(corners[side] + share[..., None] * sides[side] - np.asarray(self.centre), -1, 0)
        # The angle of a place on a side lies between those of its corners.
        turned = np.rad2deg(np.arctan2(y, x))
        turned += 360.0 * np.round((0.5 * (angles[side] + angles[side + 1]) - turned) / 360.0)
        return turns * 360.0 + turned

    def project(self, points: FloatArray) -> FloatArray:
        """See `Shape.project`."""
        offset = points - np.asarray(self.centre)
        corners, sides, angles, _ = self._sides()
        lengths = np.hypot(*sides.T)
        nearest = int(np.argmin(_cross(sides, np.asarray(self.centre) - corners) / lengths))
        ahead = 0.5 * (angles[nearest] + angles[nearest + 1])
        on_ray = np.any(offset != 0.0, axis=1)
        return self.at(np.where(on_ray, np.rad2deg(np.arctan2(offset[:, 1], offset[:, 0])), ahead))

    def angle_of(self, point: ArrayLike) -> float:
        """See `Shape.angle_of`."""
        x, y = np.asarray(point, dtype=np.float64) - self.centre
        return float(np.rad2deg(np.arctan2(y, x)) % 360.0)

    def contains(self, points: FloatArray) -> NDArray[np.bool_]:
        """See `Shape.contains`."""
        corners, sides, _, _ = self._sides()
        return np.min(_cross(sides, np.asarray(points)[:, None] - corners), axis=1) > 0.0

    def angles_between(self, start: float, end: float, count: int) -> FloatArray:
        """See `Shape.angles_between`."""
        low, high = min(start, end), max(start, end)
        angles = self._sides()[2][:-1]
        turns = 360.0 * np.arange(np.floor((low - angles.max()) / 360.0), np.ceil((high - angles.min()) / 360.0) + 1)
        corners = (angles[:, None] + turns).ravel()
        between = np.concatenate([np.linspace(low, high, count), corners[(corners > low) & (corners < high)]])
        return np.unique(between) if start <= end else np.unique(between)[::-1]

    def filled(self, points: FloatArray, kept: NDArray[np.int64]) -> FloatArray:
        """See `Shape.filled`. (Otherwise the edge between the two points beside a corner would cut it off.)"""
        points, free = points.copy(), np.ones(len(points), bool)
        free[kept] = False
        for corner in self.corners:
            if free.any():
                nearest = int(np.where(free, np.linalg.norm(points - corner, axis=1), np.inf).argmin())
                points[nearest] = corner
                free[nearest] = False
        return points

    def outline(self, count: int = 180) -> FloatArray:
        """See `Shape.outline`; the corners are among the points."""
        corners, _, angles, lengths = self._sides()
        count = max(count, 2 * len(corners))
        degrees = self.angle_at(angles[0], angles[-1], np.arange(count) / count)
        points = self.at(degrees)
        points[np.round(lengths[:-1] / lengths[-1] * count).astype(np.int64) % count] = corners
        return points


@dataclass(frozen=True)
class Rectangle(Cornered):
    """A rectangle: its semi-axes are half its width and half its height."""

    @property
    def corners(self) -> FloatArray:
        """See `Cornered.corners`."""
        c, s = np.cos(np.deg2rad(self.rotation)), np.sin(np.deg2rad(self.rotation))
        signs = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
        return np.asarray(self.centre) + signs * self.semi_axes @ np.array([[c, s], [-s, c]])

    def to_dict(self) -> dict[str, Any]:
        """See `Shape.to_dict`."""
        turned = {"rotation_degrees": self.rotation} if self.rotation else {}
        width, height = (2.0 * half for half in self.semi_axes)
        return {"type": "rectangle", "centre": list(self.centre), "width": width, "height": height, **turned}


@dataclass(frozen=True)
class Polygon(Cornered):
    """A convex polygon: its centre is the centroid of its area, its semi-axes are half its extents.

    Attributes
    ----------
    vertices : its corners, counter-clockwise.
    """

    vertices: tuple[tuple[float, float], ...] = ()

    @classmethod
    def of(cls, corners: ArrayLike) -> Polygon:
        """The polygon with these corners (k, 2), counter-clockwise.

        Raises
        ------
        TemplateError : not convex, not counter-clockwise, or fewer than three corners.
        """
        points = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
        after, second = np.roll(points, -1, axis=0), np.roll(points, -2, axis=0)
        turns = _cross(after - points, second - after)
        if len(points) >= 3 and (turns < 0.0).all():
            raise TemplateError("shape.corners: expected counter-clockwise order, found clockwise; reverse the list.")
        # A star turns left everywhere as well, but more than once round.
        step = after - points
        headings = np.arctan2(step[:, 1], step[:, 0])
        once = np.isclose(((np.roll(headings, -1) - headings) % (2.0 * np.pi)).sum(), 2.0 * np.pi)
        if len(points) < 3 or not (turns > 0.0).all() or not once:
            at = int(np.argmin(turns)) if len(points) >= 3 else 0
            place = f" (not at ({after[at][0]:g}, {after[at][1]:g}))" if len(points) >= 3 and turns[at] <= 0.0 else ""
            raise TemplateError(
                f"shape.corners: expected a convex polygon, its corners counter-clockwise{place}. A map on an outline "
                "that bends inwards would have folds."
            )
        weight = _cross(points, after)
        centre = ((points + after) * weight[:, None]).sum(axis=0) / (3.0 * weight.sum())
        half = 0.5 * np.ptp(points, axis=0)
        return cls(
            (float(centre[0]), float(centre[1])),
            (float(half[0]), float(half[1])),
            0.0,
            tuple((float(x), float(y)) for x, y in points),
        )

    @property
    def corners(self) -> FloatArray:
        """See `Cornered.corners`."""
        return np.array(self.vertices)

    def to_dict(self) -> dict[str, Any]:
        """See `Shape.to_dict`."""
        return {"type": "polygon", "corners": [list(corner) for corner in self.vertices]}


def shape_from_dict(data: Mapping[str, Any]) -> Shape:
    """The outline that a ``shape`` object of a template file describes, which is checked against the schema already.

    Raises
    ------
    TemplateError : see `Polygon.of`.
    """
    if data["type"] == "polygon":
        return Polygon.of(data["corners"])
    centre = (float(data["centre"][0]), float(data["centre"][1]))
    rotation = float(data.get("rotation_degrees", 0.0))
    if data["type"] == "rectangle":
        return Rectangle(centre, (0.5 * float(data["width"]), 0.5 * float(data["height"])), rotation)
    a, b = (data["radius"], data["radius"]) if data["type"] == "circle" else data["semi_axes"]
    return Shape(centre, (float(a), float(b)), rotation)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products of vectors (..., 2)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
