"""The parts of a map between its rims and paths: what moves in one leaves the others as they are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from ..surface import IntArray

SMALLEST = 200
"""Parts of fewer points (pockets between a path and a rim) are put together: a part costs some milliseconds."""


def movable_parts(edges: IntArray, movable: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
    """The points that may move, in groups that no edge joins, the largest first.

    Parameters
    ----------
    edges : (e, 2) point ids.
    movable : (n,).

    Returns
    -------
    parts : (n,) each; every movable point is in one of them.
    """
    n = len(movable)
    one, two = np.ascontiguousarray(edges.T)
    inner = movable[one] & movable[two]
    graph = sparse.coo_matrix((np.ones(int(inner.sum()), np.int8), (one[inner], two[inner])), shape=(n, n))
    group = connected_components(graph, directed=False)[1]
    rest = int(group.max()) + 1
    size = np.bincount(group[movable], minlength=rest)
    group = np.where(size[group] < SMALLEST, rest, group)
    size = np.bincount(group[movable], minlength=rest + 1)
    return [movable & (group == number) for number in np.argsort(-size, kind="stable") if size[number]]
