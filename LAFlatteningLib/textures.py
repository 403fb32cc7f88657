"""Patterns on an atrium by which one sees what a map does to shapes and distances: circles, stripes, checks.

A pattern is a point array: a function that is positive where the pattern is dark, linear in each triangle, so that its
borders are lines across triangles on the atrium and on the map alike (paper, section II-B: spatial context).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import dijkstra

from .errors import LAFlatteningError
from .heat_distance import heat_distance
from .surface import FloatArray, IntArray, Surface

PATTERNS = ("circles", "stripes", "checker")
CHORD_REACH = 1.5
"""Within so many radii along the surface of a circle's centre, distances from it are measured straight."""


@dataclass(frozen=True, eq=False)
class Texture:
    """A pattern.

    Attributes
    ----------
    name : of its point array.
    values : (n,) positive where the pattern is dark. Circles: mm inside the circle; stripes and checks: -1 to 1.
    labels : (n,) number of the nearest circle from 1 on, 0 for patterns without parts.
    centres : ids of the points in the middle of the circles, or from which distances count.
    title : with its size, for people.
    """

    name: str
    values: FloatArray
    labels: IntArray
    centres: IntArray
    title: str

    def on(self, surface: Surface) -> Surface:
        """The surface with the pattern as point arrays (NAME and, for circles, NAME_number)."""
        arrays = {self.name: self.values}
        if self.labels.any():
            arrays[f"{self.name}_number"] = self.labels.astype(np.int32)
        return surface.with_data(arrays)


def spread_points(surface: Surface, count: int, first: int | None = None) -> IntArray:
    """Points spread evenly over a surface, ids (count,): each next one is the farthest from all before, along edges.

    Parameters
    ----------
    first : by default the point farthest from the middle of the surface.

    Raises
    ------
    LAFlatteningError : more points than the surface has, or fewer than one.
    """
    used = np.flatnonzero(surface.used_points)
    if not 1 <= count <= len(used):
        raise LAFlatteningError(f"Expected 1 to {len(used)} points, the surface has no more; found {count}.")
    if first is None:
        middle = surface.points[used].mean(axis=0)
        first = int(used[np.linalg.norm(surface.points[used] - middle, axis=1).argmax()])
    chosen = [first]
    distance = dijkstra(surface.edge_graph, indices=first)
    while len(chosen) < count:
        reach = np.where(np.isfinite(distance), distance, np.inf)
        reach[~surface.used_points] = -1.0
        chosen.append(int(reach.argmax()))
        # Points nearer to another one already stay with that.
        limit = float(distance[chosen[-1]])
        distance = np.minimum(distance, dijkstra(surface.edge_graph, indices=chosen[-1], limit=limit))
    return np.array(chosen, np.int64)


def circles(surface: Surface, count: int = 100, radius_mm: float | None = None) -> Texture:
    """Circles of one size, spread evenly (`spread_points`).

    Parameters
    ----------
    radius_mm : by default a third of the mean distance of neighbouring circles, so that they cover about a third of the
        surface.

    Raises
    ------
    LAFlatteningError : radius not positive, or so small that no point lies in most circles.
    """
    centres = spread_points(surface, count)
    if radius_mm is None:
        # As many hexagons of that area: their width is the distance.
        radius_mm = float(np.sqrt(2.0 / np.sqrt(3.0) * surface.area / count) / 3.0)
    if not (np.isfinite(radius_mm) and radius_mm > 0.0):
        raise LAFlatteningError(f"Expected a radius above 0 mm, found {radius_mm:g}.")
    values, labels = np.full(len(surface.points), -np.inf), np.zeros(len(surface.points), np.int64)
    reached = 0
    for number, centre in enumerate(centres, 1):
        along = dijkstra(surface.edge_graph, indices=centre, limit=CHORD_REACH * radius_mm + _longest_edge(surface))
        near = np.flatnonzero(np.isfinite(along))
        # So near, the chord is the geodesic to a percent, and smooth, which ways along edges are not.
        inside = radius_mm - np.linalg.norm(surface.points[near] - surface.points[centre], axis=1)
        better = inside > values[near]
        values[near[better]], labels[near[better]] = inside[better], number
        reached += int(np.count_nonzero(inside > 0.0) > 3)
    if reached < 0.9 * count:
        raise LAFlatteningError(
            f"Circles with a radius of {radius_mm:.2g} mm are smaller than the triangles of the surface. Take fewer "
            "and larger circles, or a finer mesh."
        )
    # Far from all circles: as far outside as is ever looked at.
    values[~np.isfinite(values)] = -CHORD_REACH * radius_mm
    title = f"{count} circles with a radius of {radius_mm:.1f} mm"
    return Texture("circles", values, labels, centres, title)


def stripes(surface: Surface, source: FloatArray, width_mm: float = 5.0) -> Texture:
    """Stripes of equal width by the geodesic distance from the point nearest to a place.

    Parameters
    ----------
    source : (3,) mm.
    width_mm : of a dark stripe, and of a light one.

    Raises
    ------
    LAFlatteningError : width not positive.
    """
    _check_width(width_mm)
    centre = _nearest(surface, source)
    values = _wave(heat_distance(surface, centre), width_mm)
    return Texture("stripes", values, _none(surface), np.array([centre]), f"stripes of {width_mm:g} mm by distance")


def checker(surface: Surface, source: FloatArray, width_mm: float = 8.0) -> Texture:
    """Checks between the stripes by distance from two points: a place, and one a quarter of the way round from it.

    Where the two distances grow at right angles the checks are squares.

    Parameters
    ----------
    source : (3,) mm.
    width_mm : of a check.

    Raises
    ------
    LAFlatteningError : width not positive.
    """
    _check_width(width_mm)
    first = _nearest(surface, source)
    from_first = heat_distance(surface, first)
    reached = np.where(np.isfinite(from_first), from_first, -1.0)
    far = int(reached.argmax())
    from_far = heat_distance(surface, far)
    # Of the points as far from both, the one farthest from them.
    between = np.abs(from_first - from_far) <= 0.02 * reached[far]
    second = int(np.where(between, from_first, -1.0).argmax())
    values = _wave(from_first, width_mm) * _wave(heat_distance(surface, second), width_mm)
    return Texture("checker", values, _none(surface), np.array([first, second]), f"checks of {width_mm:g} mm")


def _wave(distance: FloatArray, width_mm: float) -> FloatArray:
    """1 in the middle of dark stripes, -1 in that of light ones, the first stripe dark."""
    known = np.isfinite(distance)
    return np.where(known, np.sin(np.pi * np.where(known, distance, 0.0) / width_mm + 1e-9), np.nan)


def _nearest(surface: Surface, place: FloatArray) -> int:
    used = np.flatnonzero(surface.used_points)
    return int(used[np.linalg.norm(surface.points[used] - np.asarray(place, np.float64), axis=1).argmin()])


def _longest_edge(surface: Surface) -> float:
    return float(surface.edge_graph.data.max())


def _none(surface: Surface) -> IntArray:
    return np.zeros(len(surface.points), np.int64)


def _check_width(width_mm: float) -> None:
    if not (np.isfinite(width_mm) and width_mm > 0.0):
        raise LAFlatteningError(f"Expected a width above 0 mm, found {width_mm:g}.")
