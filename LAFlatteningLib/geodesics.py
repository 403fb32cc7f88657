"""Shortest paths along the edges of a surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class PathTree:
    """All shortest edge paths from one point (Dijkstra 1959).

    Parameters
    ----------
    graph : (n, n) symmetric sparse edge lengths, e.g. `Surface.edge_graph`.
    source : id of the point where all paths start.
    limit : points farther than this are left out, as if there were no way to them.

    Examples
    --------
    >>> line = sparse.csr_matrix(([1.0, 1, 2, 2], ([0, 1, 1, 2], [1, 0, 2, 1])), shape=(3, 3))
    >>> PathTree(line, 0).to(2).tolist()
    [0, 1, 2]
    """

    def __init__(self, graph: sparse.csr_matrix, source: int, limit: float = np.inf) -> None:
        self.source = int(source)
        self.limit = limit
        self.distance: FloatArray
        """(n,) length of the shortest edge path to each point, infinite where there is none."""
        self.distance, self._before = dijkstra(graph, indices=self.source, return_predecessors=True, limit=limit)

    def to(self, target: int) -> IntArray | None:
        """Point ids from the source to a target, both included; None if it cannot be reached."""
        if not np.isfinite(self.distance[target]):
            return None
        path = [int(target)]
        while path[-1] != self.source:
            path.append(int(self._before[path[-1]]))
        return np.array(path[::-1], np.int64)
