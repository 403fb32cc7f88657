"""Triangulating a closed polygon in space with the least area (Barequet and Sharir 1995; Liepa 2003, section 2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

EXACT_LIMIT = 250
"""Rims of up to this many points get the least area exactly; longer ones are first cut into such pieces."""
COARSE_POINTS = 120
"""Points of a longer rim that decide where it is cut."""


def minimum_area_triangulation(corners: FloatArray, taken: BoolArray | None = None) -> IntArray | None:
    """Triangulate a closed polygon in space, without new points, with the least total area.

    Parameters
    ----------
    corners : (n, 3) in order, n >= 3; the polygon need be neither flat nor convex.
    taken : (n, n) symmetric, pairs of corners that no triangle may join.

    Returns
    -------
    (n - 2, 3) triangles that turn with the polygon, or None if the taken pairs leave no triangulation.
    Exact up to `EXACT_LIMIT` corners: dynamic programming over chains of corners, O(n^3). Equal areas (every
    triangulation of a flat convex polygon) are decided by the least sum of squared diagonals. A longer polygon is
    cut along the most central triangle of the solution for `COARSE_POINTS` of its corners, and the three parts are
    solved by themselves.

    Source: Barequet and Sharir 1995; Liepa 2003.

    Examples
    --------
    >>> import numpy as np
    >>> arrow = np.array([[0.0, 0, 0], [2, 1, 0], [0, 2, 0], [1, 1, 0]])
    >>> minimum_area_triangulation(arrow).tolist()
    [[0, 1, 3], [1, 2, 3]]
    """
    n = len(corners)
    if taken is None:
        taken = np.zeros((n, n), bool)
    pieces, found = [np.arange(n)], []
    while pieces:
        piece = pieces.pop()
        if len(piece) <= EXACT_LIMIT:
            triangles = _least_area(corners[piece], taken[np.ix_(piece, piece)])
            if triangles is None:
                return None
            found.append(piece[triangles])
            continue
        chosen = np.unique(np.linspace(0, len(piece) - 1, COARSE_POINTS).astype(np.int64))
        sample = piece[chosen]
        triangles = _least_area(corners[sample], taken[np.ix_(sample, sample)])
        if triangles is None:
            return None
        # The triangle that leaves the smallest largest part.
        i, k, j = chosen[triangles].T
        balance = np.maximum(np.maximum(k - i, j - k), len(piece) - (j - i))
        cut = int(balance.argmin())
        i, k, j = int(i[cut]), int(k[cut]), int(j[cut])
        found.append(piece[[[i, k, j]]])
        parts = [piece[i : k + 1], piece[k : j + 1], np.concatenate([piece[j:], piece[: i + 1]])]
        pieces.extend(part for part in parts if len(part) > 2)
    return np.concatenate(found)


def _least_area(corners: FloatArray, taken: BoolArray) -> IntArray | None:
    n = len(corners)
    centred = corners - corners.mean(axis=0)
    step = np.arange(n)
    # A chain of corners is known by its span (number of edges) and its first or its last corner. With one table each
    # way, [span, first] and [span, last], all chains of one span and all their splits are plain slices.
    ahead, behind = (step[None, :] + step[:, None]) % n, (step[None, :] - step[:, None]) % n
    moment = np.moveaxis(np.cross(centred[None, :], centred[ahead]), 2, 0).copy()
    moment_behind = np.moveaxis(np.cross(centred[behind], centred[None, :]), 2, 0).copy()
    squared = ((centred[None, :] - centred[ahead]) ** 2).sum(axis=2)
    free = ~taken[step[None, :], ahead]
    area = np.full((n, n), np.inf)
    area[1] = np.where(free[1], 0.0, np.inf)
    area_behind = area.copy()
    area_behind[1] = np.roll(area[1], 1)
    diagonals, diagonals_behind = np.zeros((n, n)), np.zeros((n, n))
    split = np.zeros((n, n), np.int64)
    tie = 1e-10 * max(float((centred**2).sum(axis=1).max()), np.finfo(float).tiny)
    for span in range(2, n):
        count = n - span
        # Triangle (first, split, last): twice its area vector is the sum of the moments of its sides.
        vector = (
            moment[:, 1:span, :count] + moment_behind[:, span - 1 : 0 : -1, span:] - moment[:, span, :count][:, None]
        )
        total = 0.5 * np.sqrt((vector**2).sum(axis=0))
        total += area[1:span, :count] + area_behind[span - 1 : 0 : -1, span:]
        shorter = diagonals[1:span, :count] + diagonals_behind[span - 1 : 0 : -1, span:]
        shorter[total > total.min(axis=0) + tie] = np.inf
        best = shorter.argmin(axis=0)
        column = step[:count]
        area[span, :count] = np.where(free[span, :count] | (count == 1), total[best, column], np.inf)
        diagonals[span, :count] = shorter[best, column] + squared[span, :count]
        split[span, :count] = best + 1
        area_behind[span, span:] = area[span, :count]
        diagonals_behind[span, span:] = diagonals[span, :count]
    if not np.isfinite(area[n - 1, 0]):
        return None
    triangles, chains = [], [(0, n - 1)]
    while chains:
        first, last = chains.pop()
        if last - first > 1:
            middle = first + int(split[last - first, first])
            triangles.append((first, middle, last))
            chains += [(first, middle), (middle, last)]
    return np.array(triangles, np.int64)
