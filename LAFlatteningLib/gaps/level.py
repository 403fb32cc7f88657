"""A surface cut where a quantity reaches a threshold, so that every triangle is on one side of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import topology
from ..surface import FloatArray, IntArray

SNAP = 1e-4
"""A cut keeps so far away from the ends of an edge, as a share of it, so that no piece is without area."""


class CutMesh(NamedTuple):
    """Triangles, each above or below the threshold as a whole."""

    points: FloatArray
    """(k, 3) mm: those of the mesh before, then one on each edge that is cut."""
    flat: FloatArray
    """(k, 2) places on the map."""
    triangles: IntArray
    """(t, 3) point ids."""
    above: NDArray[np.bool_]
    """(t,) whether the triangle reaches the threshold."""


def cut_at_level(
    points: FloatArray, flat: FloatArray, triangles: IntArray, values: FloatArray, level: float
) -> CutMesh:
    """Cut triangles where a quantity, linear in each triangle, reaches a level.

    Parameters
    ----------
    points, flat : (n, 3) mm and (n, 2) map units.
    triangles : (m, 3) point ids.
    values : (n,); a triangle with a value that is NaN is below the level, because nothing is known about it.
    level : "above" means this or more.
    """
    edges = topology.edges(triangles)
    a, b = edges.points.T
    above = values >= level
    with np.errstate(invalid="ignore", divide="ignore"):
        share = (level - values[a]) / (values[b] - values[a])
    cut = (above[a] != above[b]) & np.isfinite(share)
    share = np.clip(share[cut], SNAP, 1.0 - SNAP)[:, None]
    a, b = a[cut], b[cut]
    new = np.full(len(cut), -1, np.int64)
    new[cut] = len(points) + np.arange(len(a))
    on_edge = new[edges.of_triangle]
    known = np.all(np.isfinite(values[triangles]), axis=1)
    count = (on_edge >= 0).sum(axis=1)

    whole = count == 0
    pieces, reach = [triangles[whole]], [known[whole] & above[triangles[whole]].all(axis=1)]
    # A cut on one edge only: the third corner has no value, and neither half is above.
    one = np.flatnonzero(count == 1)
    corner, middle = _turned(triangles[one], (on_edge[one] >= 0).argmax(axis=1)), on_edge[one].max(axis=1)
    pieces += [
        np.column_stack([corner[:, 0], corner[:, 1], middle]),
        np.column_stack([corner[:, 0], middle, corner[:, 2]]),
    ]
    reach += [np.zeros(2 * len(one), bool)]
    # Two edges: the corner between them is on its own side, what is left is cut along a diagonal.
    two = np.flatnonzero(count == 2)
    turn = (on_edge[two] < 0).argmax(axis=1)
    corner, at = _turned(triangles[two], turn), _turned(on_edge[two], turn)
    own = known[two] & above[corner[:, 0]]
    rest = known[two] & above[corner[:, 1]]
    # Edge 1 is opposite corner 1: from corner 2 to corner 0.
    pieces += [
        np.column_stack([corner[:, 0], at[:, 2], at[:, 1]]),
        np.column_stack([at[:, 2], corner[:, 1], at[:, 1]]),
        np.column_stack([corner[:, 1], corner[:, 2], at[:, 1]]),
    ]
    reach += [own, rest, rest]
    return CutMesh(
        np.concatenate([points, (1.0 - share) * points[a] + share * points[b]]),
        np.concatenate([flat, (1.0 - share) * flat[a] + share * flat[b]]),
        np.concatenate(pieces),
        np.concatenate(reach),
    )


def _turned(rows: IntArray, first: IntArray) -> IntArray:
    """Rows of three, each turned so that it begins with its entry number `first`."""
    return rows[np.arange(len(rows))[:, None], (first[:, None] + np.arange(3)) % 3]
