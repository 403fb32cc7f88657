"""The parts of a map between its rims and paths: what moves in one leaves the distortion of the others as it is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from ..surface import FloatArray, IntArray
from .descent import Solver, solved

SMALLEST = 200
"""Parts of fewer points (pockets between a path and a rim) are put together: a part costs some milliseconds."""


def movable_parts(triangles: IntArray, movable: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
    """The points that may move, in groups that no triangle joins, the largest first.

    Parameters
    ----------
    triangles : (m, 3).
    movable : (n,).

    Returns
    -------
    parts : (n,) each; every movable point is in one of them.
    """
    n = len(movable)
    ends = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    ends = ends[movable[ends].all(axis=1)]
    graph = sparse.coo_matrix((np.ones(len(ends), np.int8), tuple(ends.T)), shape=(n, n))
    group = connected_components(graph, directed=False)[1]
    size = np.bincount(group[movable], minlength=group.max() + 1)
    rest = int(group.max()) + 1
    group = np.where(size[group] < SMALLEST, rest, group)
    size = np.bincount(group[movable], minlength=rest + 1)
    return [movable & (group == number) for number in np.argsort(-size, kind="stable") if size[number]]


class Blocks:
    """A solver for each part, as one for all variables.

    Parameters
    ----------
    variables : of each part, their numbers among all variables.
    solvers : of each part, for right sides as `descent.solved` takes them.
    """

    def __init__(self, variables: Sequence[IntArray], solvers: Sequence[Solver]) -> None:
        self._parts = list(zip(variables, solvers, strict=True))
        self.size = sum(len(numbers) for numbers in variables)

    def solve(self, right: FloatArray) -> FloatArray:
        """For a right side (v, 2)."""
        result = np.empty_like(right)
        for numbers, solver in self._parts:
            result[numbers] = solved(solver, right[numbers])
        return result
