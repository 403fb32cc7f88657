"""Triangles and points that are faults of a mesh, not of the anatomy: needles, flat triangles, spikes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .. import operators
from ..half_edges import corner_angles
from ..surface import FloatArray, IntArray, Surface
from .patches import contains

NEEDLE_SHARE = 0.01
"""Edges shorter than this share of the median edge are needles' ends."""

FLAT_MM = 1e-3
"""A triangle lower than this has no area to speak of."""

SPIKE_DEGREES = 90.0
"""A point round which the angles of its triangles add up to less is the tip of a spike: a cone with an opening of less
than 29 degrees, ending in one point. (Round a point of a smooth surface they add up to 360 degrees.)"""


def collapse_needles(surface: Surface, among: NDArray[np.bool_] | None = None) -> tuple[Surface, IntArray]:
    """Join the ends of edges shorter than `NEEDLE_SHARE` of the median edge, where that keeps the surface a manifold
    and turns no triangle over.

    Parameters
    ----------
    among : (n,) points that may be joined to others; all if not given.

    Returns
    -------
    surface : with fewer triangles and all points (some unused); the same object if nothing was joined.
    points : ids of the points that were joined to others.
    """
    joined: list[int] = []
    if among is None:
        among = np.ones(len(surface.points), bool)
    while True:
        short = np.flatnonzero(
            (surface.edge_lengths < NEEDLE_SHARE * np.median(surface.edge_lengths))
            & among[surface.edges.points].any(axis=1)
        )
        if len(short) == 0:
            return surface, np.array(joined, np.int64)
        target = np.arange(len(surface.points))
        of_point = _triangles_of(surface, surface.edges.points[short].reshape(-1))
        on_rim = np.zeros(len(surface.points), bool)
        on_rim[surface.edges.points[surface.edges.usage == 1]] = True
        touched = np.zeros(len(surface.points), bool)
        for edge in short[np.argsort(surface.edge_lengths[short], kind="stable")].tolist():
            keep, drop = surface.edges.points[edge].tolist()
            if not among[drop] or (on_rim[drop] and not on_rim[keep] and among[keep]):
                keep, drop = drop, keep
            ring = np.unique(surface.triangles[np.union1d(of_point[keep], of_point[drop])])
            if touched[ring].any() or not _may_join(surface, edge, keep, drop, of_point, on_rim):
                continue
            target[drop] = keep
            touched[ring] = True
            joined.append(drop)
        if not touched.any():
            return surface, np.array(joined, np.int64)
        triangles = target[surface.triangles]
        whole = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
        surface = replace(
            surface,
            triangles=triangles[whole],
            cell_data={name: values[whole] for name, values in surface.cell_data.items()},
        )


def _triangles_of(surface: Surface, points: IntArray) -> dict[int, IntArray]:
    asked = np.zeros(len(surface.points), bool)
    asked[points] = True
    near = np.flatnonzero(asked[surface.triangles].any(axis=1))
    return {int(p): near[(surface.triangles[near] == p).any(axis=1)] for p in np.unique(points)}


def _may_join(
    surface: Surface, edge: int, keep: int, drop: int, of_point: dict[int, IntArray], on_rim: NDArray[np.bool_]
) -> bool:
    """The link condition, and no triangle turned over."""
    usage = int(surface.edges.usage[edge])
    if usage > 2 or (on_rim[keep] and on_rim[drop] and usage != 1):
        return False
    rings = [np.setdiff1d(surface.triangles[of_point[point]], (keep, drop)) for point in (keep, drop)]
    if len(np.intersect1d(rings[0], rings[1])) != usage:
        return False
    staying = np.setdiff1d(of_point[drop], of_point[keep])
    corners = surface.triangles[staying]
    before = operators.area_vectors(surface.points, corners)
    after = operators.area_vectors(surface.points, np.where(corners == drop, keep, corners))
    size = np.linalg.norm(before, axis=1)
    # A triangle without area has no side to be turned over to.
    solid = size > FLAT_MM * NEEDLE_SHARE
    return bool(((before * after).sum(axis=1)[solid] > 0).all()) and len(of_point[drop]) > usage


def flip_flat(surface: Surface) -> tuple[Surface, FloatArray]:
    """Flip the longest edge of triangles lower than `FLAT_MM`; drop those whose longest edge is on a rim.

    Returns
    -------
    surface : the same object if there were none that can be mended.
    places : (k, 3) mm.
    """
    places: list[FloatArray] = []
    for _ in range(10):
        corners = surface.points[surface.triangles]
        side = np.linalg.norm(np.roll(corners, -1, axis=1) - np.roll(corners, -2, axis=1), axis=2)
        height = _heights(corners)
        flat = np.flatnonzero(height < FLAT_MM)
        longest = surface.edges.of_triangle[flat, side[flat].argmax(axis=1)]
        triangles = surface.triangles.copy()
        keep = np.ones(len(triangles), bool)
        touched = np.zeros(len(surface.points), bool)
        n = len(surface.points)
        existing = surface.edges.points[:, 0] * n + surface.edges.points[:, 1]
        mended = 0
        for triangle, edge in zip(flat.tolist(), longest.tolist(), strict=True):
            if surface.edges.usage[edge] == 1:
                keep[triangle] = False
            else:
                pair = surface.edges.triangles[edge]
                other = int(pair[0] + pair[1] - triangle)
                ids = np.unique(surface.triangles[[triangle, other]])
                if surface.edges.usage[edge] > 2 or touched[ids].any() or len(ids) != 4:
                    continue
                a, b = surface.edges.points[edge].tolist()
                k = int(np.flatnonzero(~np.isin(surface.triangles[triangle], (a, b)))[0])
                c, a, b = np.roll(surface.triangles[triangle], -k).tolist()
                d = int(np.setdiff1d(surface.triangles[other], (a, b))[0])
                flipped = np.array([(c, a, d), (c, d, b)])
                lowest = _heights(surface.points[flipped]).min()
                if (
                    contains(existing, np.array([min(c, d) * n + max(c, d)])).any()
                    or lowest <= height[[triangle, other]].min()
                ):
                    continue
                triangles[[triangle, other]] = flipped
                touched[ids] = True
            places.append(corners[triangle].mean(axis=0))
            mended += 1
        if mended == 0:
            break
        surface = replace(
            surface,
            triangles=triangles[keep],
            cell_data={name: values[keep] for name, values in surface.cell_data.items()},
        )
    return surface, np.array(places).reshape(-1, 3)


def _heights(corners: FloatArray) -> FloatArray:
    """Smallest height of triangles (m, 3, 3), (m,)."""
    side = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    ids = np.arange(3 * len(corners)).reshape(-1, 3)
    area = operators.triangle_areas(corners.reshape(-1, 3), ids)
    return 2.0 * area / np.maximum(side, np.finfo(float).tiny)


def flatten_spikes(surface: Surface) -> tuple[Surface, FloatArray]:
    """Move the tips of spikes (`SPIKE_DEGREES`) to the middle of their neighbours.

    Returns
    -------
    surface : the same object if there were none.
    places : (k, 3) where the tips were, mm.
    """
    places: list[FloatArray] = []
    for _ in range(3):
        angle = corner_angles(surface.points, surface.triangles)
        total = np.degrees(np.bincount(surface.triangles.reshape(-1), angle, len(surface.points)))
        inner = surface.used_points.copy()
        inner[surface.edges.points[surface.edges.usage != 2]] = False
        tips = np.flatnonzero(inner & (total < SPIKE_DEGREES))
        if len(tips) == 0:
            break
        points = surface.points.copy()
        places.extend(surface.points[tips])
        for tip in tips.tolist():
            around = surface.triangles[(surface.triangles == tip).any(axis=1)]
            points[tip] = surface.points[np.setdiff1d(around, tip)].mean(axis=0)
        surface = replace(surface, points=points)
    return surface, np.array(places).reshape(-1, 3)
