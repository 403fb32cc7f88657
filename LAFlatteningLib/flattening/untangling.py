"""Turning folded triangles back by moving the points near them.

Garanzha, Kaporin, Kudryavtseva, Protais, Ray and Sokolov, "Foldover-free maps in 50 lines of code", ACM
Transactions on Graphics 40, 2021. The energy of a triangle with Jacobian J is

    tr(J^T J) / chi(det J) + LAMBDA (det(J)^2 + 1) / chi(det J),   chi(d) = (d + sqrt(eps^2 + d^2)) / 2,

finite on folded triangles and, as eps goes to 0, a barrier against folding.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.optimize import minimize

from .. import operators
from ..errors import FoldError
from ..surface import FloatArray, IntArray

RINGS = (3, 6, 12, 24)
"""Rings of triangles round a fold that may move; the next number is tried where the one before is not enough."""
LAMBDA = 0.01
"""Weight of keeping area against keeping angles. Small: angles matter more, but scale must not drift."""
MIN_DETERMINANT = 1e-3
"""The smallest share of its rest area (at the scale of the map) that a triangle of a repaired place must reach."""
_MAX_STEPS = 40


def rest_shapes(points: FloatArray, triangles: IntArray, scale: float) -> FloatArray:
    """Inverse edge matrices of the triangles on the surface, (m, 2, 2), at the scale of the map.

    The Jacobian of a triangle is its edge matrix on the map times this. Slivers on the surface are widened
    to a height of a tenth of their base, because the map of a sliver has no shape worth keeping.
    """
    local = operators.local_frames(points, triangles) * scale
    base = np.maximum(local[:, 1, 0], 1e-12)
    x = np.clip(local[:, 2, 0], -2.0 * base, 3.0 * base)
    height = np.maximum(local[:, 2, 1], 0.1 * np.maximum(base, np.abs(x)))
    inverse = np.zeros((len(triangles), 2, 2))
    inverse[:, 0, 0] = 1.0 / base
    inverse[:, 0, 1] = -x / (base * height)
    inverse[:, 1, 1] = 1.0 / height
    return inverse


def untangle(
    flat: FloatArray, triangles: IntArray, points: FloatArray, fixed: NDArray[np.bool_], loose: NDArray[np.bool_]
) -> tuple[FloatArray, IntArray]:
    """A map without folded triangles, equal to the given one away from its folds.

    Parameters
    ----------
    flat : (n, 2) map with few folds.
    points : (n, 3) the surface, whose triangle shapes the moved triangles keep as well as they can.
    fixed : (n,) points that never move (rims).
    loose : (n,) points that move only where nothing else helps (paths).

    Returns
    -------
    flat : (n, 2) with every triangle turned counter-clockwise.
    freed : ids of the loose points that had to move.

    Raises
    ------
    FoldError : if folds remain, with their points.
    """
    folded = _bad(flat, triangles)
    if not len(folded):
        return flat, np.zeros(0, np.int64)
    scale = float(
        np.sqrt(operators.triangle_areas(flat, triangles).sum() / operators.triangle_areas(points, triangles).sum())
    )
    n = len(points)
    corner = sparse.csr_matrix(
        (np.ones(triangles.size, np.int8), (triangles.reshape(-1), np.repeat(np.arange(len(triangles)), 3))),
        shape=(n, len(triangles)),
    )
    flat = flat.copy()
    held = fixed | loose
    freed = np.zeros(n, bool)
    for stage in (held, fixed):
        for rings in RINGS:
            folded = _bad(flat, triangles)
            if not len(folded):
                return flat, np.flatnonzero(freed)
            near = _neighbourhood(corner, folded, rings)
            # Once paths must give way, they do so close to the fold only.
            blocked = stage | (held & ~_neighbourhood(corner, folded, min(rings, RINGS[0])))
            movable = near & ~blocked
            if not movable.any():
                continue
            before = flat.copy()
            _relax(flat, triangles, points, scale, movable)
            freed |= loose & (flat != before).any(axis=1)
    folded = _bad(flat, triangles)
    if len(folded):
        at = triangles[folded[0]]
        place = ", ".join(f"{x:.1f}" for x in points[at].mean(axis=0))
        raise FoldError(
            f"{len(folded)} triangles stay folded on the map; the first is at {place} mm (points {', '.join(map(str, at))}). "
            "The surface there is too coarse or too narrow for the template: refine it there, or move the nearest seed.",
            tuple(int(i) for i in np.unique(triangles[folded])),
        )
    return flat, np.flatnonzero(freed)


def _bad(flat: FloatArray, triangles: IntArray) -> IntArray:
    """Triangles that are turned over, or so nearly that rounding decides."""
    corner = flat[triangles]
    longest = (np.diff(corner, axis=1, append=corner[:, :1]) ** 2).sum(axis=2).max(axis=1)
    return np.flatnonzero(operators.signed_areas(flat, triangles) <= 1e-9 * longest)


def _neighbourhood(corner: sparse.csr_matrix, triangles: IntArray, rings: int) -> NDArray[np.bool_]:
    """Points within some rings of triangles, (n,)."""
    chosen = np.zeros(corner.shape[1])
    chosen[triangles] = 1.0
    for _ in range(rings):
        points = (corner @ chosen) > 0
        chosen = (corner.T @ points.astype(np.float64) > 0).astype(np.float64)
    return points


def _relax(flat: FloatArray, triangles: IntArray, points: FloatArray, scale: float, movable: NDArray[np.bool_]) -> None:
    """Minimise the energy of all triangles with a movable point, in place."""
    near = np.flatnonzero(movable[triangles].any(axis=1))
    ids, local = np.unique(triangles[near], return_inverse=True)
    local = local.reshape(-1, 3)
    free = movable[ids]
    rest = rest_shapes(points, triangles[near], scale)
    position = flat[ids].copy()
    order = np.flatnonzero(free)

    def determinants(at: FloatArray) -> FloatArray:
        u, v = at[local[:, 1]] - at[local[:, 0]], at[local[:, 2]] - at[local[:, 0]]
        return (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) * rest[:, 0, 0] * rest[:, 1, 1]

    def energy(x: FloatArray, eps: float) -> tuple[float, FloatArray]:
        position[order] = x.reshape(-1, 2)
        edge = np.stack(
            [position[local[:, 1]] - position[local[:, 0]], position[local[:, 2]] - position[local[:, 0]]], 2
        )
        jacobian = edge @ rest
        a, b, c, d = jacobian[:, 0, 0], jacobian[:, 0, 1], jacobian[:, 1, 0], jacobian[:, 1, 1]
        det = a * d - b * c
        root = np.sqrt(eps * eps + det * det)
        chi = 0.5 * (det + root)
        # For very negative det the sum above loses all digits; this form does not.
        chi = np.where(det < 0, 0.5 * eps * eps / (root - det), chi)
        value = (a * a + b * b + c * c + d * d + LAMBDA * (det * det + 1.0)) / chi
        slope = 2.0 * LAMBDA * det / chi - value / root
        cofactor = np.stack([np.stack([d, -c], 1), np.stack([-b, a], 1)], 1)
        by_jacobian = 2.0 * jacobian / chi[:, None, None] + slope[:, None, None] * cofactor
        by_edge = by_jacobian @ rest.transpose(0, 2, 1)
        gradient = np.zeros((len(ids), 2))
        for axis in (0, 1):
            first = np.bincount(local[:, 1], by_edge[:, axis, 0], len(ids))
            second = np.bincount(local[:, 2], by_edge[:, axis, 1], len(ids))
            base = np.bincount(local[:, 0], by_edge[:, axis].sum(axis=1), len(ids))
            gradient[:, axis] = first + second - base
        return float(value.sum()), gradient[order].reshape(-1)

    for _ in range(_MAX_STEPS):
        lowest = float(determinants(position).min())
        eps = float(np.sqrt(1e-9 + 0.04 * min(lowest, 0.0) ** 2))
        found = minimize(
            energy, position[order].reshape(-1), args=(eps,), jac=True, method="L-BFGS-B", options={"maxiter": 60}
        )
        position[order] = found.x.reshape(-1, 2)
        now = float(determinants(position).min())
        # Settled: done, or the rim of the patch is in the way and a larger patch must be tried.
        if now >= MIN_DETERMINANT or found.nit < 2 or (lowest < 0 and now <= lowest + 1e-6):
            break
    flat[ids] = position
