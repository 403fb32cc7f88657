"""A surface without its finest bumps, on which shortest lines depend on the shape and not on its noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse

from .solvers import Factorisation
from .surface import FloatArray, IntArray, Surface


def smoothed_points(surface: Surface, length: float) -> FloatArray:
    """The points of a surface after diffusion over a length, rims along themselves: (n, 3), mm.

    A bump of wavelength w is left with 1 / (1 + 2 (pi length / w)^2) of its height. One implicit step (Desbrun, Meyer,
    Schroeder and Barr, "Implicit fairing of irregular meshes using diffusion and curvature flow", 1999, with the
    weights of finite elements): the result belongs to the shape, not to its triangles.

    Parameters
    ----------
    surface : a manifold; its rims are smoothed as curves, and the rest follows them.
    length : mm, the standard deviation of the Gaussian that this stands for.

    Raises
    ------
    numpy.linalg.LinAlgError : triangles have all but no area.

    Examples
    --------
    >>> flat = Surface(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))
    >>> bool(np.allclose(smoothed_points(flat, 0.0), flat.points))
    True
    """
    time = 0.5 * length * length
    points = surface.points.copy()
    loops = surface.boundary_loops
    if loops:
        rims = np.concatenate(loops)
        points[rims] = _smoothed_curves(surface.points, loops, time)
    free = np.ones(len(points), bool)
    for loop in loops:
        free[loop] = False
    inner = np.flatnonzero(free & surface.used_points)
    if len(inner):
        matrix = (sparse.diags(surface.mass) + time * surface.laplacian).tocsr()[inner]
        right = surface.mass[inner, None] * surface.points[inner] - matrix @ np.where(free[:, None], 0.0, points)
        points[inner] = Factorisation(matrix[:, inner]).solve(right)
    return points


def _smoothed_curves(points: FloatArray, loops: Sequence[IntArray], time: float) -> FloatArray:
    """The same for the points of closed curves, one curve after another."""
    blocks, masses = [], []
    for loop in loops:
        side = np.linalg.norm(points[loop] - points[np.roll(loop, -1)], axis=1)
        side = np.maximum(side, 1e-9 * side.sum())
        masses.append(0.5 * (side + np.roll(side, 1)))
        after, k = np.roll(np.arange(len(loop)), -1), np.arange(len(loop))
        step = sparse.coo_matrix((1.0 / side, (k, after)), shape=(len(loop), len(loop)))
        step = step + step.T
        blocks.append(sparse.diags(masses[-1] + time * np.asarray(step.sum(axis=1)).ravel()) - time * step)
    mass = np.concatenate(masses)
    return Factorisation(sparse.block_diag(blocks, format="csc")).solve(mass[:, None] * points[np.concatenate(loops)])
