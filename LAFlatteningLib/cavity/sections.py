"""Plane sections: the closed curve in which a plane cuts a tube of the surface."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components, depth_first_order
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.distance import pdist

from ..surface import FloatArray, IntArray, Surface


@dataclass(frozen=True, eq=False)
class Section:
    """A closed curve of a plane section, round (or next to) a place.

    Attributes
    ----------
    points : (k, 3) in order along the curve, mm.
    triangles : ids of the triangles that it passes.
    around : whether it goes round the place that was given.
    normal : (3,) of the plane.
    """

    points: FloatArray
    triangles: IntArray
    around: bool
    normal: FloatArray

    @cached_property
    def _flat(self) -> FloatArray:
        first, second = plane_axes(self.normal)
        return (self.points - self.points[0]) @ np.stack([first, second], axis=1)

    @property
    def perimeter(self) -> float:
        """Length of the curve, mm."""
        return float(np.linalg.norm(self.points - np.roll(self.points, -1, axis=0), axis=1).sum())

    @property
    def area(self) -> float:
        """Area within it, mm2."""
        x, y = self._flat.T
        return 0.5 * abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))

    @property
    def diameter(self) -> float:
        """Largest distance of two of its points, mm."""
        try:
            corners = self._flat[ConvexHull(self._flat).vertices]
        except (QhullError, ValueError):  # a curve without area
            corners = self._flat
        return float(pdist(corners).max()) if len(corners) > 1 else 0.0

    @property
    def centre(self) -> FloatArray:
        """(3,) centroid of the area within it, mm; of the curve where that has no area."""
        x, y = self._flat.T
        cross = x * np.roll(y, -1) - y * np.roll(x, -1)
        if abs(cross.sum()) < 1e-9:
            return self.points.mean(axis=0)
        middle = [((c + np.roll(c, -1)) * cross).sum() / (3.0 * cross.sum()) for c in (x, y)]
        first, second = plane_axes(self.normal)
        return self.points[0] + middle[0] * first + middle[1] * second

    def encloses(self, line: FloatArray) -> bool:
        """Whether a line of points (k, 3), mm, passes through the area within the curve."""
        side = (line - self.points[0]) @ self.normal
        k = np.flatnonzero((side[:-1] > 0.0) != (side[1:] > 0.0))
        share = side[k] / (side[k] - side[k + 1])
        return bool(self._within(line[k] + share[:, None] * (line[k + 1] - line[k])).any())

    def cuts_into(self, line: FloatArray, radii: FloatArray) -> bool:
        """Whether the area within the curve cuts into a tube along a line (k, 3), mm, with radii (k,)."""
        close = np.abs((line - self.points[0]) @ self.normal) < radii
        return bool(self._within(line[close]).any())

    def _within(self, places: FloatArray) -> NDArray[np.bool_]:
        """(k,) whether places (k, 3), dropped into the plane, are within the curve."""
        first, second = plane_axes(self.normal)
        flat = (places - self.points[0]) @ np.stack([first, second], axis=1)
        seen = _complex(self._flat)[None, :] - _complex(flat)[:, None]
        return np.abs(np.angle(np.roll(seen, -1, axis=1) * np.conj(seen)).sum(axis=1)) > np.pi


def plane_axes(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors at right angles to a unit normal and to each other; right-handed with it in this order."""
    helper = np.eye(3)[int(np.abs(normal).argmin())]
    first = np.cross(helper, normal)
    first /= np.linalg.norm(first)
    return first, np.cross(normal, first)


def plane_section(surface: Surface, centre: FloatArray, normal: FloatArray) -> Section | None:
    """The closed curve in which a plane cuts the surface round a place, or nearest to it if none goes round.

    Parameters
    ----------
    centre, normal : (3,) a place in the plane, mm, and its unit normal.

    Returns
    -------
    None where the plane meets nothing closed there. Of several curves round the place, the one nearest to it.
    """
    side = (surface.points - centre) @ normal
    above = side > 0.0
    # Column by column: several times faster than counting along the short axis.
    first_above, second_above, third_above = (above[surface.triangles[:, k]] for k in range(3))
    passed = np.flatnonzero((first_above != second_above) | (second_above != third_above))
    if len(passed) == 0:
        return None
    edge = surface.edges.of_triangle[passed]
    ends = surface.edges.points
    crossed = above[ends[edge, 0]] != above[ends[edge, 1]]
    ids, pair = np.unique(edge[crossed], return_inverse=True)
    pair = pair.reshape(-1, 2)
    low, high = ends[ids].T
    share = side[low] / (side[low] - side[high])
    places = surface.points[low] + share[:, None] * (surface.points[high] - surface.points[low])
    half = sparse.coo_matrix((np.ones(len(pair)), (pair[:, 0], pair[:, 1])), shape=(len(ids),) * 2)
    graph = (half + half.T).tocsr()
    number, curve = connected_components(graph, directed=False)
    degree = np.diff(graph.indptr)
    first, second = plane_axes(normal)
    flat = (places - centre) @ np.stack([first, second], axis=1)
    best: tuple[tuple[bool, float], IntArray, int] | None = None
    for k in range(number):
        members = np.flatnonzero(curve == k)
        if len(members) < 3 or (degree[members] != 2).any():
            continue  # ends at a rim
        order = depth_first_order(graph, members[0], directed=False, return_predecessors=False)
        here = flat[order]
        turn = np.angle(np.roll(_complex(here), -1) * np.conj(_complex(here))).sum()
        key = (bool(abs(turn) < np.pi), float(np.linalg.norm(here, axis=1).min()))
        if best is None or key < best[0]:
            best = (key, order, k)
    if best is None:
        return None
    key, order, k = best
    return Section(places[order], passed[curve[pair[:, 0]] == k], not key[0], np.asarray(normal, np.float64))


def _complex(flat: FloatArray) -> FloatArray:
    return flat[:, 0] + 1j * flat[:, 1]
