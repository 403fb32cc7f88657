"""The parts of a map between its rims and paths: what moves in one leaves the others as they are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from ..surface import IntArray

SMALLEST = 200
"""Parts of fewer points (pockets between a path and a rim) are put together: a part costs some milliseconds."""


def movable_parts(edges: IntArray, movable: NDArray[np.bool_]) -> IntArray:
    """The points that may move, in groups that no edge joins.

    Parameters
    ----------
    edges : (e, 2) point ids.
    movable : (n,).

    Returns
    -------
    part : (n,) number of the group, 0 the largest; -1 for points that do not move.
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
    number = np.empty(rest + 1, np.int64)
    number[np.argsort(-size, kind="stable")] = np.arange(rest + 1)
    return np.where(movable, number[group], -1)
