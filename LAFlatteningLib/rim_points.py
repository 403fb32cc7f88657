"""Rims as closed lines: places along them, their corners, and points spread evenly between these."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .surface import FloatArray

CORNER_DEGREES = 45.0
"""A rim has a corner where it turns by more within an edge length of the new mesh to either side."""


@dataclass(frozen=True, eq=False)
class Rim:
    """A rim of the surface that is being remeshed.

    Attributes
    ----------
    points : (k, 3) mm, the corners of a closed line of straight pieces.
    along : (k + 1,) mm along it to each of them, and back to the first.
    corners : (c,) mm along it to its sharp corners, in order.
    """

    points: FloatArray
    along: FloatArray
    corners: FloatArray

    @classmethod
    def of(cls, points: FloatArray, edge_length: float) -> Rim:
        """The rim through points (k, 3), for a mesh of the given edge length, mm."""
        steps = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
        rim = cls(points, np.concatenate([[0.0], np.cumsum(steps)]), np.zeros(0))
        at = rim.along[:-1]
        before, after = points - rim.positions(at - edge_length), rim.positions(at + edge_length) - points
        size = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
        cosine = np.einsum("ij,ij->i", before, after) / np.maximum(size, 1e-300)
        corners: list[float] = []
        for k in np.argsort(cosine, kind="stable"):
            if cosine[k] > np.cos(np.radians(CORNER_DEGREES)):
                break
            if all(abs(rim.short_way(at[k] - other)) > 2.0 * edge_length for other in corners):
                corners.append(float(at[k]))
        return cls(points, rim.along, np.sort(corners))

    @property
    def length(self) -> float:
        """Mm round."""
        return float(self.along[-1])

    def short_way(self, step: float) -> float:
        """A distance along the rim, mm, the short way round: between minus and plus half its length."""
        return (step + 0.5 * self.length) % self.length - 0.5 * self.length

    def positions(self, along: FloatArray) -> FloatArray:
        """(n, 3) the places at distances along the rim, mm."""
        closed = np.concatenate([self.points, self.points[:1]])
        return np.stack([np.interp(along % self.length, self.along, closed[:, k]) for k in range(3)], axis=1)

    def evened(self, along: FloatArray, most: float) -> FloatArray:
        """Places (n,) along the rim, in its order, moved by at most `most` mm towards equal steps from corner to
        corner, each corner with a place on it."""
        n = len(along)
        steps = (np.roll(along, -1) - along) % self.length
        unrolled = along[0] + np.concatenate([[0.0], np.cumsum(steps[:-1])])
        held: dict[int, float] = {}
        for corner in self.corners:
            away = np.array([self.short_way(corner - at) for at in along])
            nearest = int(np.abs(away).argmin())
            held.setdefault(nearest, unrolled[nearest] + away[nearest])
        if held:
            index = np.array(sorted(held))
            at = np.array([held[k] for k in index.tolist()])
            around = np.concatenate([index, [index[0] + n]])
            number = np.arange(n) + np.where(np.arange(n) < index[0], n, 0)
            even = np.interp(number, around, np.append(at, at[0] + self.length))
            even -= np.where(np.arange(n) < index[0], self.length, 0.0)
        else:
            even = np.arange(n) * self.length / n
            even += (unrolled - even).mean()
        return (unrolled + np.clip(even - unrolled, -most, most)) % self.length
