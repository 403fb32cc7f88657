"""The energy of a map that is low where triangles keep their shape and infinite where they fold.

Garanzha, Kaporin, Kudryavtseva, Protais, Ray and Sokolov, "Foldover-free maps in 50 lines of code", ACM
Transactions on Graphics 40, 2021. The energy of a triangle with Jacobian J, surface to map, is

    (tr(J^T J) + LAMBDA (det(J)^2 + 1)) / chi(det J),   chi(d) = (d + sqrt(eps^2 + d^2)) / 2.

With eps = 0 it is infinite at det J = 0 (a barrier against folding); with eps > 0 it is finite everywhere, so
that a folded map can be brought down to one without folds.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from .. import operators
from ..surface import FloatArray, IntArray
from .solvers import factorise

LAMBDA = 0.01
"""Weight of keeping area against keeping angles. Small: angles matter more, but scale must not drift."""
_MEMORY = 8
"""Pairs of steps that the quasi-Newton method remembers."""


def rest_shapes(points: FloatArray, triangles: IntArray, scale: float) -> FloatArray:
    """The triangles on the surface, in their own plane, at the scale of the map: (m, 3) base, x and height.

    Corner 0 is at the origin, corner 1 at (base, 0), corner 2 at (x, height). Slivers on the surface are
    widened to a height of a tenth of their base, because the map of a sliver has no shape worth keeping.

    Parameters
    ----------
    points : (n, 3) mm.
    scale : map units per mm.
    """
    local = operators.local_frames(points, triangles) * scale
    base = np.maximum(local[:, 1, 0], 1e-12)
    x = np.clip(local[:, 2, 0], -2.0 * base, 3.0 * base)
    height = np.maximum(local[:, 2, 1], 0.1 * np.maximum(base, np.abs(x)))
    return np.stack([base, x, height], axis=1)


class PatchEnergy:
    """The energy of some triangles as a function of some of their points.

    Parameters
    ----------
    flat : (n, 2) map; the points that do not move are taken from it.
    triangles : (k, 3) the triangles that count: all that touch a movable point.
    rest : (k, 3) their `rest_shapes`.
    movable : (n,) points that are variables.
    weights : (k,) weight of each triangle (default 1).
    """

    def __init__(
        self,
        flat: FloatArray,
        triangles: IntArray,
        rest: FloatArray,
        movable: NDArray[np.bool_],
        weights: FloatArray | None = None,
    ) -> None:
        self._ids, local = np.unique(triangles, return_inverse=True)
        self._corner = np.ascontiguousarray(local.reshape(-1, 3).T)
        self._position = flat[self._ids]
        self._free = np.flatnonzero(movable[self._ids])
        self.ids = self._ids[self._free]
        """Ids of the variables, in their order."""
        base, x, height = rest.T
        self._p, self._q, self._r = 1.0 / base, -x / (base * height), 1.0 / height
        self._weights = np.ones(len(triangles)) if weights is None else weights
        self._rest = rest
        self.reach = 3.0 * float(np.sqrt(np.median(base * height)))
        """The farthest that a point may move in one step, map units."""

    def start(self) -> FloatArray:
        """The variables as they are on the map, (v, 2)."""
        return self._position[self._free]

    def _jacobians(self, variables: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        self._position[self._free] = variables
        x, y = self._position.T
        i, j, k = self._corner
        ux, uy, vx, vy = x[j] - x[i], y[j] - y[i], x[k] - x[i], y[k] - y[i]
        a, c = ux * self._p, uy * self._p
        b, d = ux * self._q + vx * self._r, uy * self._q + vy * self._r
        return a, b, c, d, a * d - b * c

    def determinants(self, variables: FloatArray) -> FloatArray:
        """Area of each triangle on the map over its area at rest, (k,); negative where folded."""
        return self._jacobians(variables)[4]

    def value_and_gradient(self, variables: FloatArray, eps: float) -> tuple[float, FloatArray]:
        """The energy and its derivative by the variables, (v, 2).

        With eps = 0 the energy of a map with a folded triangle is infinite, and its derivative NaN.
        """
        a, b, c, d, det = self._jacobians(variables)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            root = np.sqrt(eps * eps + det * det)
            # For negative det the textbook sum loses all digits; the second form is the same number.
            chi = 0.5 * np.where(det > 0, det + root, eps * eps / (root + np.abs(det)))
            numerator = a * a + b * b + c * c + d * d + LAMBDA * (det * det + 1.0)
            value = float((self._weights * numerator / chi).sum())
        if not np.isfinite(value):
            return np.inf, np.full(variables.shape, np.nan)
        double = 2.0 * self._weights / chi
        slope = self._weights * (2.0 * LAMBDA * det - numerator / root) / chi
        # Derivative by the Jacobian: double * J + slope * cofactor(J).
        ga, gb = double * a + slope * d, double * b - slope * c
        gc, gd = double * c - slope * b, double * d + slope * a
        ux, vx = ga * self._p + gb * self._q, gb * self._r
        uy, vy = gc * self._p + gd * self._q, gd * self._r
        n = len(self._ids)
        corner = self._corner.reshape(-1)
        gradient = np.stack(
            [
                np.bincount(corner, np.concatenate([-ux - vx, ux, vx]), n),
                np.bincount(corner, np.concatenate([-uy - vy, uy, vy]), n),
            ],
            axis=1,
        )
        return value, gradient[self._free]

    def preconditioner_at_rest(self) -> Callable[[FloatArray], FloatArray]:
        """A stand-in for the inverse of the Hessian that knows nothing of the map: the inverse of the Dirichlet
        energy of the rest shapes. For maps that are still folded."""
        base, x, height = self._rest.T
        corners = np.zeros((len(base), 3, 2))
        corners[:, 1, 0], corners[:, 2, 0], corners[:, 2, 1] = base, x, height
        return self._inverse_dirichlet(corners, self._weights)

    def preconditioner(self, variables: FloatArray) -> Callable[[FloatArray], FloatArray]:
        """A stand-in for the inverse of the Hessian at a map without folds.

        A small displacement v of the map changes the energy of a triangle to second order by about
        weight tr(J^T J)/det(J) |grad v|^2, the gradient taken on the map: a Dirichlet energy there.
        """
        a, b, c, d, det = self._jacobians(variables)
        det = np.maximum(det, 1e-6)
        area = self._rest[:, 0] * self._rest[:, 2] * det
        stiffness = self._weights * (a * a + b * b + c * c + d * d) / (det * area)
        return self._inverse_dirichlet(self._position[self._corner.T], stiffness)

    def _inverse_dirichlet(self, corners: FloatArray, stiffness: FloatArray) -> Callable[[FloatArray], FloatArray]:
        """Solver for the Dirichlet energy of triangles (k, 3, 2), each with its own stiffness (k,)."""
        cotangent = operators.cotangents(corners.reshape(-1, 2), np.arange(3 * len(corners)).reshape(-1, 3))
        # Obtuse triangles must not make the matrix indefinite.
        weighted = np.maximum(cotangent, 0.05) * stiffness[:, None]
        matrix = operators.laplacian_from_cotangents(weighted, self._corner.T, len(self._ids))
        inner = matrix[self._free][:, self._free]
        # A patch without any fixed point would make the matrix singular.
        return factorise(inner + sparse.diags(np.full(len(self._free), 1e-9 * inner.diagonal().max())))


def descend(
    energy: PatchEnergy,
    variables: FloatArray,
    eps: float,
    precondition: Callable[[FloatArray], FloatArray],
    steps: int,
    tolerance: float = 1e-4,
) -> tuple[FloatArray, int]:
    """Lower an energy by limited-memory quasi-Newton steps started from a preconditioner.

    Nocedal and Wright, Numerical Optimization, algorithm 7.4, with the preconditioner as initial inverse
    Hessian; steps are halved until the energy falls enough (Armijo). Where the start has no folded triangle
    and `eps` is 0, no step makes one.

    Parameters
    ----------
    steps : most steps to take.
    tolerance : stop once a step lowers the energy by less than this share of it.

    Returns
    -------
    variables : (v, 2).
    taken : number of steps.
    """
    value, gradient = energy.value_and_gradient(variables, eps)
    history: deque[_Pair] = deque(maxlen=_MEMORY)
    for step in range(steps):
        direction = _two_loop(gradient, history, precondition)
        slope = _dot(direction, gradient)
        if slope >= 0.0 and history:
            history.clear()
            direction = _two_loop(gradient, history, precondition)
            slope = _dot(direction, gradient)
        if slope >= 0.0:
            return variables, step
        # Far from the minimum the model of the energy is poor: no point moves farther than a few triangles.
        length = min(1.0, energy.reach / float(np.abs(direction).max()))
        while True:
            trial = variables + length * direction
            new_value, new_gradient = energy.value_and_gradient(trial, eps)
            if new_value <= value + 1e-4 * length * slope:
                break
            length *= 0.5
            if length * float(np.abs(direction).max()) < 1e-9 * energy.reach:
                return variables, step
        s, y = trial - variables, new_gradient - gradient
        curvature = _dot(s, y)
        if curvature > 0.0:
            history.append(_Pair(s, y, 1.0 / curvature))
        small = value - new_value < tolerance * abs(value)
        variables, value, gradient = trial, new_value, new_gradient
        if small:
            return variables, step + 1
    return variables, steps


def _dot(a: FloatArray, b: FloatArray) -> float:
    # Not through BLAS: for vectors of this size its threads cost more than they bring, above all on a busy machine.
    return float(np.einsum("ij,ij->", a, b))


class _Pair(NamedTuple):
    """A step, the change of the gradient along it, and one over their product."""

    s: FloatArray
    y: FloatArray
    inverse: float


def _two_loop(
    gradient: FloatArray, history: deque[_Pair], precondition: Callable[[FloatArray], FloatArray]
) -> FloatArray:
    direction = -gradient
    factors = []
    for pair in reversed(history):
        factor = pair.inverse * _dot(pair.s, direction)
        factors.append(factor)
        direction = direction - factor * pair.y
    direction = precondition(direction)
    if history:
        # Nocedal and Wright, equation 7.20, in the metric of the preconditioner.
        last = history[-1]
        direction = direction / (last.inverse * _dot(last.y, precondition(last.y)))
    for pair, factor in zip(history, reversed(factors), strict=True):
        direction = direction + (factor - pair.inverse * _dot(pair.y, direction)) * pair.s
    return direction
