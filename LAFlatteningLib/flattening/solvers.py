"""The sparse linear systems of the flattening, both coordinates solved at once.

Every solve is of a symmetric positive definite matrix over the points that are free to move: constrained
points are eliminated, not appended as multipliers. Nothing dense of the size of the mesh is made.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from ..surface import FloatArray, IntArray


def factorise(matrix: sparse.spmatrix) -> Callable[[FloatArray], FloatArray]:
    """A function that solves ``matrix @ x = b`` for a symmetric positive definite matrix.

    SuperLU in symmetric mode: minimum degree ordering on the pattern itself, pivots on the diagonal.
    """
    solver = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    solve: Callable[[FloatArray], FloatArray] = solver.solve
    return solve


def _free(n: int, fixed: IntArray) -> IntArray:
    mask = np.ones(n, bool)
    mask[fixed] = False
    return np.flatnonzero(mask)


def harmonic(laplacian: sparse.csr_matrix, fixed: IntArray, targets: FloatArray) -> FloatArray:
    """The map with ``laplacian @ map = 0`` at free points and given positions elsewhere (paper, equations 5-6).

    Parameters
    ----------
    laplacian : (n, n) positive semi-definite, e.g. `operators.cotangent_laplacian`.
    fixed, targets : (c,) point ids and their positions (c, 2).

    Returns
    -------
    (n, 2) positions; those of fixed points are the targets to the last bit.
    """
    n = laplacian.shape[0]
    free = _free(n, fixed)
    flat = np.empty((n, targets.shape[1]))
    flat[fixed] = targets
    rows = laplacian[free]
    flat[free] = factorise(rows[:, free])(-(rows[:, fixed] @ targets))
    return flat


def published_least_squares(
    laplacian: sparse.csr_matrix,
    rims: IntArray,
    rim_targets: FloatArray,
    paths: IntArray,
    path_targets: FloatArray,
) -> FloatArray:
    """Equations 3-4 of the paper: paths exact, rims in the least-squares sense together with the Laplacian.

    The printed weight w multiplies the whole objective and so has no effect; it is left out.

    Parameters
    ----------
    laplacian : (n, n) with off-diagonal entries -(cot a + cot b): the scale matters here, because the rows of
        rim points hold a 1 on the diagonal and enter the same sum.
    """
    n = laplacian.shape[0]
    keep = np.ones(n)
    keep[rims] = 0.0
    system = (sparse.diags(keep) @ laplacian + sparse.diags(1.0 - keep)).tocsc()
    right = np.zeros((n, 2))
    right[rims] = rim_targets
    free = _free(n, paths)
    inner = system[:, free]
    flat = np.empty((n, 2))
    flat[paths] = path_targets
    flat[free] = factorise(inner.T @ inner)(inner.T @ (right - system[:, paths] @ path_targets))
    return flat
