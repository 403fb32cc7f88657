"""Lowering a function of the positions of points by quasi-Newton steps."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from ..surface import FloatArray

_MEMORY = 5
"""Pairs of steps that the quasi-Newton method remembers."""
NOISE = 1e-13
"""Differences of the function smaller than this share of it are rounding, which must not shorten steps near the
minimum."""


class Solver(Protocol):
    """A matrix ready to be solved with: `solvers.Factorisation`, the same for both coordinates, or one for both."""

    def solve(self, right: FloatArray) -> FloatArray:
        """For a right side (v, 2), the coordinates as columns."""


class Descent(NamedTuple):
    """Where steps ended, see `descend`."""

    variables: FloatArray
    taken: int
    moved: float


def descend(
    function: Callable[[FloatArray], tuple[float, FloatArray]],
    variables: FloatArray,
    reach: float,
    precondition: Solver,
    steps: int,
    tolerance: float = 1e-4,
    still: float = 0.0,
) -> Descent:
    """Lower a function by limited-memory quasi-Newton steps started from a preconditioner.

    Nocedal and Wright, Numerical Optimization, algorithm 7.4, with the preconditioner as initial inverse
    Hessian; steps are halved until the energy falls enough (Armijo). Where the function is infinite
    for folded maps, no step folds one.

    Parameters
    ----------
    function : from variables (v, 2) to its value and its derivative.
    reach : the farthest that a point may move in one step, `PatchEnergy.reach`.
    steps : most steps to take.
    tolerance : stop once a step lowers the function by less than this share of it.
    still : stop once a step moves no point by more than this.

    Returns
    -------
    variables : (v, 2).
    taken : number of steps.
    moved : how far the last of them moved a point at most; infinite where it was shortened, or none was taken.

    Raises
    ------
    ValueError : the function is infinite at the start.
    """
    value, gradient = function(variables)
    if not np.isfinite(value):
        raise ValueError("The descent must start from a map without folded triangles.")
    history: deque[_Pair] = deque(maxlen=_MEMORY)
    scale, moved = 1.0, np.inf
    for step in range(steps):
        direction = _two_loop(gradient, history, precondition, scale)
        slope = _dot(direction, gradient)
        if not slope < 0.0 and history:
            history.clear()
            direction = _two_loop(gradient, history, precondition, scale)
            slope = _dot(direction, gradient)
        # Also where the numbers overflowed: NaN is not below 0.
        if not slope < 0.0:
            return Descent(variables, step, moved)
        # Far from the minimum the model of the energy is poor: no point moves farther than a few triangles.
        length = min(1.0, reach / float(np.abs(direction).max()))
        while True:
            trial = variables + length * direction
            new_value, new_gradient = function(trial)
            if new_value <= value + 1e-4 * length * slope + NOISE * abs(value):
                break
            length *= 0.5
            if not length * float(np.abs(direction).max()) >= 1e-9 * reach:
                return Descent(variables, step, np.inf)
        s, y = trial - variables, new_gradient - gradient
        curvature = _dot(s, y)
        if curvature > 0.0:
            if not history:
                # Nocedal and Wright, equation 7.20, in the metric of the preconditioner.
                scale = curvature / _dot(y, precondition.solve(y))
            history.append(_Pair(s, y, 1.0 / curvature))
        farthest = float(np.abs(s).max())
        moved = farthest if length == 1.0 else np.inf
        small = value - new_value < tolerance * abs(value) or farthest < still
        variables, value, gradient = trial, new_value, new_gradient
        if small:
            return Descent(variables, step + 1, moved)
    return Descent(variables, steps, moved)


def _dot(a: FloatArray, b: FloatArray) -> float:
    # Not through BLAS: for vectors of this size its threads cost more than they bring, above all on a busy machine.
    return float(np.einsum("ij,ij->", a, b))


class _Pair(NamedTuple):
    """A step, the change of the gradient along it, and one over their product."""

    s: FloatArray
    y: FloatArray
    inverse: float


def _two_loop(gradient: FloatArray, history: deque[_Pair], precondition: Solver, scale: float) -> FloatArray:
    direction, part = gradient.copy(order="K"), np.empty_like(gradient)
    factors = []
    for pair in reversed(history):
        factor = pair.inverse * _dot(pair.s, direction)
        factors.append(factor)
        direction -= np.multiply(pair.y, factor, out=part)
    direction = precondition.solve(direction)
    direction *= scale
    for pair, factor in zip(history, reversed(factors), strict=True):
        direction += np.multiply(pair.s, factor - pair.inverse * _dot(pair.y, direction), out=part)
    return np.negative(direction, out=direction)
