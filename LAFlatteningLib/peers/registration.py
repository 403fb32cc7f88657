"""One atrium bent onto another: landmarks first, then closest points, more and more loosely."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import sparse
from scipy.interpolate import RBFInterpolator
from scipy.spatial import cKDTree

from ..carrying import closest_points
from ..errors import SeedError
from ..progress import ProgressCallback, part, report
from ..solvers import Factorisation
from ..surface import FloatArray, IntArray, Surface

REACH_MM = (20.0, 14.0, 10.0, 7.0, 5.0, 3.5, 2.5, 2.0)
"""Lengths over which displacements are smoothed, round after round."""
STEPS = 3
"""Closest points are found so often with each length."""


def register(
    moving: Surface,
    moving_landmarks: Mapping[str, FloatArray],
    moving_rims: Mapping[str, IntArray],
    target: Surface,
    target_landmarks: Mapping[str, FloatArray],
    target_rims: Mapping[str, IntArray],
    progress: ProgressCallback | None = None,
) -> FloatArray:
    """Places (n, 3) of the points of one atrium, bent onto another, mm.

    1. The affine transformation that brings the landmarks nearest to their counterparts.
    2. A thin-plate spline (in space: kernel r) that takes each landmark to its counterpart.
    3. Each point is drawn to the closest place on the target, rims to the rim of the same opening; displacements are
       smoothed over `REACH_MM` (minimum of the squared misses plus the square of the length times the Dirichlet energy
       of the displacement).

    Parameters
    ----------
    moving, target : atria, mm, in any axes of the same handedness.
    moving_landmarks, target_landmarks : label -> (3,) mm; those that both have are used, at least 5.
    moving_rims, target_rims : opening -> its rim as point ids.

    Raises
    ------
    SeedError : too few landmarks in common.
    Cancelled : by `progress`.
    """
    labels = [label for label in moving_landmarks if label in target_landmarks]
    if len(labels) < 5:
        raise SeedError(
            f"Expected at least 5 landmarks that both atria have, found {', '.join(labels) or 'none'}.", tuple(labels)
        )
    report(progress, 0.0, "Matching landmarks")
    source = np.array([moving_landmarks[label] for label in labels])
    goal = np.array([target_landmarks[label] for label in labels])
    factors = np.linalg.lstsq(np.column_stack([source, np.ones(len(source))]), goal, rcond=None)[0]
    places = np.column_stack([moving.points, np.ones(len(moving.points))]) @ factors
    at = np.column_stack([source, np.ones(len(source))]) @ factors
    places = places + RBFInterpolator(at, goal - at, kernel="linear", degree=1)(places)
    openings = [opening for opening in moving_rims if opening in target_rims]
    for k, reach in enumerate(REACH_MM):
        share = part(progress, k / len(REACH_MM), (k + 1) / len(REACH_MM))
        places = _draw(places, moving, moving_rims, target, target_rims, openings, reach, share)
    report(progress, 1.0, "Bent onto the atrium")
    return places


def _draw(
    places: FloatArray,
    moving: Surface,
    moving_rims: Mapping[str, IntArray],
    target: Surface,
    target_rims: Mapping[str, IntArray],
    openings: Sequence[str],
    reach: float,
    progress: ProgressCallback | None,
) -> FloatArray:
    bent = Surface(places, moving.triangles)
    mass = sparse.diags(np.maximum(bent.mass, 1e-6 * bent.area / len(places)))
    smooth = Factorisation((mass + reach**2 * bent.laplacian).tocsc())
    for step in range(STEPS):
        report(progress, step / STEPS, f"Bending onto the atrium, smoothed over {reach:g} mm")
        goal = closest_points(target, places).positions
        for opening in openings:
            rim = target.points[target_rims[opening]]
            own = moving_rims[opening]
            goal[own] = rim[cKDTree(rim).query(places[own])[1]]
        places = places + smooth.solve(mass @ (goal - places))
    return places
