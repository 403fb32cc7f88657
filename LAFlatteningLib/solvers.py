"""The sparse linear systems of the flattening, both coordinates solved at once.

Every solve is of a symmetric positive definite matrix over the points that are free to move: constrained
points are eliminated, not appended as multipliers. Nothing dense of the size of the mesh is made.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from .surface import FloatArray, IntArray

try:
    from sksparse import cholmod as _cholmod
except ImportError:  # an optional extra
    _cholmod = None


SIMPLICIAL = 200_000
"""Rows up to which CHOLMOD goes column by column: on meshes half the time of blocks, which win on larger ones."""


def solver_name() -> str:
    """What factorises: "CHOLMOD" where the optional package scikit-sparse is installed, otherwise "SuperLU" (scipy)."""
    return "SuperLU" if _cholmod is None else "CHOLMOD"


class Factorisation:
    """A symmetric positive definite matrix, ready to be solved with.

    CHOLMOD, where scikit-sparse is installed; otherwise SuperLU in symmetric mode, pivots on the diagonal. (On meshes
    its panels and relaxed supernodes are mostly empty: without them it is a fifth to a quarter faster.)

    Parameters
    ----------
    matrix : (n, n) sparse.
    order : the order of elimination that another factorisation found for the same pattern (`order`), which
        saves a third of the time; by default one is found.
    in_order : whether the rows stand in such an order already.
    single : whether single precision is enough; it is half as fast again with SuperLU (CHOLMOD has double only).

    Raises
    ------
    numpy.linalg.LinAlgError : the matrix is singular or, found by CHOLMOD only, not positive definite.
    """

    def __init__(
        self,
        matrix: sparse.csr_matrix | sparse.csc_matrix,
        order: IntArray | None = None,
        in_order: bool = False,
        single: bool = False,
    ) -> None:
        self._order = order
        self.size = matrix.shape[0]
        if order is not None:
            matrix = matrix[:, order][order]
        find_order = order is None and not in_order
        self._solver = (
            _Superlu(matrix.tocsc(), find_order, single) if _cholmod is None else _Cholmod(matrix.tocsc(), find_order)
        )

    @property
    def order(self) -> IntArray:
        """(n,) the row eliminated first, second, ..."""
        return self._solver.order if self._order is None else self._order

    def solve(self, right: FloatArray) -> FloatArray:
        """The x with ``matrix @ x = right``, right being (n,) or (n, k)."""
        if self._order is None:
            return self._solver.solve(right)
        result = np.empty_like(right)
        result[self._order] = self._solver.solve(right[self._order])
        return result


class _Superlu:
    def __init__(self, matrix: sparse.csc_matrix, find_order: bool, single: bool) -> None:
        self._single = single
        try:
            self._factor = splu(
                matrix.astype(np.float32) if single else matrix,
                permc_spec="MMD_AT_PLUS_A" if find_order else "NATURAL",
                diag_pivot_thresh=0.0,
                panel_size=1,
                relax=1,
                options={"SymmetricMode": True},
            )
        except RuntimeError as error:
            raise np.linalg.LinAlgError(str(error)) from error

    @property
    def order(self) -> IntArray:
        return np.argsort(self._factor.perm_c)

    def solve(self, right: FloatArray) -> FloatArray:
        if not self._single:
            return np.asarray(self._factor.solve(right))
        # Numbers too small for single precision would be lost.
        size = float(np.abs(right).max(initial=0.0)) or 1.0
        return np.asarray(self._factor.solve((right / size).astype(np.float32)), np.float64) * size


class _Cholmod:
    def __init__(self, matrix: sparse.csc_matrix, find_order: bool) -> None:
        assert _cholmod is not None
        try:
            self._factor = _cholmod.cholesky(
                matrix,
                mode="simplicial" if matrix.shape[0] <= SIMPLICIAL else "auto",
                ordering_method="default" if find_order else "natural",
            )
        except _cholmod.CholmodError as error:
            raise np.linalg.LinAlgError(str(error)) from error

    @property
    def order(self) -> IntArray:
        return np.asarray(self._factor.P(), np.int64)

    def solve(self, right: FloatArray) -> FloatArray:
        return np.asarray(self._factor(right))


def _free(n: int, fixed: IntArray) -> IntArray:
    mask = np.ones(n, bool)
    mask[fixed] = False
    return np.flatnonzero(mask)


def harmonic(laplacian: sparse.csr_matrix, fixed: IntArray, targets: FloatArray) -> tuple[FloatArray, Factorisation]:
    """The map with ``laplacian @ map = 0`` at free points and given positions elsewhere (paper, equations 5-6).

    Parameters
    ----------
    laplacian : (n, n) positive semi-definite, e.g. `operators.cotangent_laplacian`.
    fixed, targets : (c,) point ids and their positions (c, 2).

    Returns
    -------
    flat : (n, 2) positions; those of fixed points are the targets to the last bit.
    factorisation : of the Laplacian at the free points, in the order of their ids.
    """
    n = laplacian.shape[0]
    free = _free(n, fixed)
    flat = np.empty((n, targets.shape[1]))
    flat[fixed] = targets
    rows = laplacian[free]
    factorisation = Factorisation(rows[:, free])
    flat[free] = factorisation.solve(-(rows[:, fixed] @ targets))
    return flat, factorisation


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
    flat[free] = Factorisation(inner.T @ inner).solve(inner.T @ (right - system[:, paths] @ path_targets))
    return flat
