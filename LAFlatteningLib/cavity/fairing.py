"""Fairing the inner points of covers: a membrane, or a thin plate (Liepa 2003, section 4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from .. import operators
from ..solvers import harmonic
from .patches import Patches

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

FAIRING_SOLVES = 8
"""At most so many solves for a membrane, each with the weights of the last shape."""
FAIRING_TOLERANCE = 1e-3
"""A membrane is done when a solve lowers its area by less than this share."""


def harmonic_weights(points: FloatArray, triangles: IntArray, uniform: bool = False) -> sparse.csr_matrix:
    """(n, n) Laplacian with weights that are positive, so that harmonic values lie between those given.

    Cotangent weights, with negative ones (few after `relax`) raised to almost 0; or 1 for each edge.
    """
    n = len(points)
    i, j = triangles[:, [1, 2, 0]].reshape(-1), triangles[:, [2, 0, 1]].reshape(-1)
    half = 0.5 * operators.cotangents(points, triangles).reshape(-1)
    weight = sparse.coo_matrix(
        (np.concatenate([half, half]), (np.concatenate([i, j]), np.concatenate([j, i]))), shape=(n, n)
    ).tocsr()
    weight.data = np.ones_like(weight.data) if uniform else np.clip(weight.data, 1e-6, 1e6)
    return (sparse.diags(np.asarray(weight.sum(axis=1)).ravel()) - weight).tocsr()


def solve_held(matrix: sparse.csr_matrix, unknown: BoolArray, values: FloatArray) -> FloatArray:
    """Values (n, c) with those of the unknown rows replaced so that these rows of matrix @ values are 0."""
    return harmonic(matrix, np.flatnonzero(~unknown), values[~unknown])[0]


def fair_membrane(patches: Patches) -> None:
    """Move inner points to where the cotangent Laplacian of their coordinates is 0: a surface of least area.

    The first solve has equal weights, which evens out the points and pulls apart what a jagged rim has pushed
    together; the others have the weights of the last shape. A patch is done when its area has stopped falling.
    """
    inner = np.arange(len(patches.points)) >= patches.fixed
    area = patches.areas()
    moving = np.ones(len(area), bool)
    for solve in range(FAIRING_SOLVES):
        matrix = harmonic_weights(patches.points, patches.triangles, uniform=solve == 0)
        patches.points = solve_held(matrix, inner & moving[patches.rim_of_point], patches.points)
        patches.changed = moving[patches.rim_of_triangle]
        patches.relax()
        patches.unfold()
        before, area = area, patches.areas()
        if solve > 0:
            moving &= area < (1.0 - FAIRING_TOLERANCE) * before
        if not moving.any():
            return


def fair_thin_plate(patches: Patches, points: FloatArray, outline: IntArray, around: IntArray) -> None:
    """Move inner points to minimise the squared Laplacian, over cover and rim, with the surface round it held still.

    One linear solve with the weights of the membrane, as in the paper: with weights that follow the shape, a
    cover on a tube would grow into a balloon.
    """
    n = len(points)
    inner_ids = np.arange(len(patches.points) - patches.fixed) + n
    ids = np.concatenate([outline, inner_ids])
    triangles = np.concatenate([around, ids[patches.triangles]])
    used, compact = np.unique(triangles, return_inverse=True)
    triangles = compact.reshape(-1, 3)
    place = np.concatenate([points, patches.points[patches.fixed :]])[used]
    laplacian = operators.cotangent_laplacian(place, triangles)
    mass = operators.lumped_mass(place, triangles)
    rows = np.zeros(n + len(inner_ids), bool)
    rows[ids] = True
    counted = rows[used]
    # Triangles without area (coincident rim points) may leave a point without mass.
    mass = np.maximum(mass[counted], 1e-6 * mass[counted].mean())
    root = sparse.diags(1.0 / np.sqrt(mass)) @ laplacian[counted]
    faired = solve_held((root.T @ root).tocsr(), used >= n, place)
    patches.points = np.concatenate([patches.points[: patches.fixed], faired[used >= n]])
    patches.changed[:] = True
    patches.relax()
    patches.unfold()
