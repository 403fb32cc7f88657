"""Closest points on a surface, and values carried from one surface to positions near it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from vtkmodules.vtkCommonCore import reference
from vtkmodules.vtkCommonDataModel import vtkGenericCell, vtkStaticCellLocator

from .errors import SurfaceError
from .surface import Array, FloatArray, IntArray, Surface

MOST_LABELS = 32
"""A floating array of whole numbers, at most so many different ones, holds labels (many programs write masks so)."""


@dataclass(frozen=True, eq=False)
class Closest:
    """The places on a surface closest to k positions.

    Attributes
    ----------
    triangle : (k,) triangle that each place is on.
    weights : (k, 3) barycentric coordinates in it, not negative, summing to 1.
    positions : (k, 3) mm.
    distance_mm : (k,) from the position asked for to the place.
    """

    triangle: IntArray
    weights: FloatArray
    positions: FloatArray
    distance_mm: FloatArray


@dataclass(frozen=True, eq=False)
class Carried:
    """Arrays of a surface at k positions.

    Attributes
    ----------
    point_data : the point arrays there, by name, first axis k.
    cell_data : the cell arrays of the closest triangles.
    notes : what was left out, for the user.
    """

    point_data: dict[str, Array]
    cell_data: dict[str, Array]
    notes: tuple[str, ...]


def closest_points(surface: Surface, positions: FloatArray) -> Closest:
    """The closest place on a surface for each position: exact, inside triangles as well as on edges and points.

    Parameters
    ----------
    positions : (k, 3) mm, in the axes of the surface.

    Raises
    ------
    SurfaceError : positions of another shape, or not numbers.
    """
    positions = np.asarray(positions, np.float64)
    if positions.ndim != 2 or positions.shape[1] != 3:
        raise SurfaceError(f"Expected positions as a (k, 3) array, found shape {positions.shape}.")
    if not np.isfinite(positions).all():
        raise SurfaceError("Expected positions in mm, found some that are not a number. Remove them.")
    locator = vtkStaticCellLocator()
    # Without its data, and on points of its own: the locator looks only at the shape.
    locator.SetDataSet(Surface(surface.points, surface.triangles).to_polydata())
    locator.BuildLocator()
    triangle = np.empty(len(positions), np.int64)
    at = [0.0, 0.0, 0.0]
    # Out-parameters, which the type stubs of VTK take for numbers.
    cell_id: Any = reference(0)
    rest: Any = (reference(0), reference(0.0))
    cell = vtkGenericCell()
    for k, position in enumerate(positions.tolist()):
        locator.FindClosestPoint(position, at, cell, cell_id, *rest)
        triangle[k] = int(cell_id)
    weights = closest_weights(surface.points[surface.triangles[triangle]], positions)
    found = np.einsum("kc,kcd->kd", weights, surface.points[surface.triangles[triangle]])
    return Closest(triangle, weights, found, np.linalg.norm(found - positions, axis=1))


def closest_weights(corners: FloatArray, positions: FloatArray) -> FloatArray:
    """Barycentric coordinates of the place in each triangle that is closest to a position.

    Parameters
    ----------
    corners : (k, 3, 3) the corners of a triangle for each position.
    positions : (k, 3).

    Returns
    -------
    (k, 3), not negative, rows sum to 1.
    """
    a, u, v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    w = positions - a
    uu, uv, vv, wu, wv = (np.einsum("ij,ij->i", x, y) for x, y in ((u, u), (u, v), (v, v), (w, u), (w, v)))
    determinant = uu * vv - uv * uv
    flat = determinant <= 1e-14 * uu * vv
    determinant[flat] = 1.0
    second, third = (vv * wu - uv * wv) / determinant, (uu * wv - uv * wu) / determinant
    weights = np.stack([1.0 - second - third, second, third], axis=1)
    # Outside (or without area): the closest place on the three sides.
    outside = np.flatnonzero((weights < 0.0).any(axis=1) | flat)
    if len(outside):
        best = np.full(len(outside), np.inf)
        for side in range(3):
            start, end = corners[outside, side], corners[outside, (side + 1) % 3]
            along = end - start
            squared = np.einsum("ij,ij->i", along, along)
            share = np.einsum("ij,ij->i", positions[outside] - start, along) / np.where(squared > 0.0, squared, 1.0)
            share = np.clip(share, 0.0, 1.0)
            gap = positions[outside] - start - share[:, None] * along
            distance = np.einsum("ij,ij->i", gap, gap)
            nearer = distance < best
            best[nearer] = distance[nearer]
            rows = outside[nearer]
            weights[rows] = 0.0
            weights[rows, side] = 1.0 - share[nearer]
            weights[rows, (side + 1) % 3] = share[nearer]
    return weights


def interpolate(values: Array, corners: IntArray, weights: FloatArray) -> Array:
    """Values at places inside triangles.

    Parameters
    ----------
    values : (n,) or (n, c) at the points of a surface.
    corners : (k, 3) the points of the triangle of each place.
    weights : (k, 3) its barycentric coordinates.

    Returns
    -------
    (k,) or (k, c) of the same type. Measured (floating) values are interpolated; where corners are NaN or infinite,
    between the others. Labels (`holds_labels`) are those of the corner with the largest weight.
    """
    if holds_labels(values):
        return values[np.take_along_axis(corners, weights.argmax(axis=1)[:, None], axis=1)[:, 0]]
    at_corners = values[corners]
    weights = weights.reshape(weights.shape + (1,) * (values.ndim - 1))
    missing = ~np.isfinite(at_corners)
    if missing.any():
        weights = np.where(missing, 0.0, weights)
        total = weights.sum(axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            return ((np.where(missing, 0.0, at_corners) * weights).sum(axis=1) / total).astype(values.dtype)
    return (at_corners * weights).sum(axis=1).astype(values.dtype)


def holds_labels(values: Array) -> bool:
    """Whether numbers are names of classes, between which nothing can be interpolated: integers, booleans, and
    floating arrays of few different whole numbers."""
    if values.dtype.kind != "f":
        return True
    if values.ndim > 1:
        return False
    finite = values[np.isfinite(values)]
    return bool((finite == np.round(finite)).all()) and 0 < len(np.unique(finite)) <= MOST_LABELS


def carry(source: Surface, positions: FloatArray, closest: Closest | None = None) -> Carried:
    """All arrays of a surface at positions on it or near it.

    Parameters
    ----------
    positions : (k, 3) mm, in the axes of the surface.
    closest : what `closest_points` returned for them, if it is known.

    Returns
    -------
    Point arrays interpolated in the closest triangle (`interpolate`), cell arrays taken from it. Arrays of text are
    left out, with a note.

    Raises
    ------
    SurfaceError : positions of another shape, or not numbers.
    """
    closest = closest_points(source, positions) if closest is None else closest
    corners = source.triangles[closest.triangle]
    notes: list[str] = []

    def numeric(arrays: Mapping[str, Array], kind: str) -> dict[str, Array]:
        text = [name for name, values in arrays.items() if np.asarray(values).dtype.kind not in "fiub"]
        notes.extend(f'The {kind} array "{name}" is not made of numbers; it was not carried over.' for name in text)
        return {name: np.asarray(values) for name, values in arrays.items() if name not in text}

    return Carried(
        {n: interpolate(v, corners, closest.weights) for n, v in numeric(source.point_data, "point").items()},
        {n: v[closest.triangle] for n, v in numeric(source.cell_data, "cell").items()},
        tuple(notes),
    )
