"""Where the rims and the paths of a division go on a template."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .division import Division
from .rim_length import rim_lengths
from .surface import FloatArray, IntArray
from .template import Template


@dataclass(frozen=True, eq=False)
class Constraints:
    """Points with a given place on the map.

    Attributes
    ----------
    rim_ids, rim_targets : (b,) point ids and (b, 2) map positions of all rim points, and of the landmarks.
    path_ids, path_targets : (p,) and (p, 2), likewise, of the points inside paths (their feet belong to rims).
    path_of : (p,) path of each of them.
    """

    rim_ids: IntArray
    rim_targets: FloatArray
    path_ids: IntArray
    path_targets: FloatArray
    path_of: NDArray

    @property
    def ids(self) -> IntArray:
        """All constrained points, rims first."""
        return np.concatenate([self.rim_ids, self.path_ids])

    @property
    def targets(self) -> FloatArray:
        """Map positions of `ids`, (b + p, 2)."""
        return np.concatenate([self.rim_targets, self.path_targets])


PUBLISHED_CIRCLE_STEPS = 1000
"""Published maps begin each path at the nearest of this many points round the hole, not at the foot itself
(read off them: up to 0.18 degrees apart, 3e-4 of the disk radius)."""


def constraints_by_count(division: Division, template: Template, as_printed: bool) -> Constraints:
    """Points spread evenly by number: equal steps on each arc and on each path.

    Points of a path that lie on a rim belong to the rim; the others share the whole segment.

    Parameters
    ----------
    as_printed : segments join the feet exactly, as in the paper; otherwise as in the published maps
        (`PUBLISHED_CIRCLE_STEPS`).
    """

    def steps(ids: IntArray) -> FloatArray:
        return np.linspace(0.0, 1.0, len(ids))

    anatomy = template.anatomy

    def foot(path: str, end: int) -> FloatArray:
        opening = anatomy.opening_of(anatomy.paths[path][end])
        if as_printed or opening not in anatomy.holes:
            return template.foot(path, end)
        rim = template.rim(opening)
        step = 360.0 / PUBLISHED_CIRCLE_STEPS
        return rim.shape.at(step * round(rim.feet[path] / step))

    return _constraints(division, template, steps, lambda loop: np.arange(len(loop) + 1.0), foot)


def constraints_by_length(division: Division, template: Template) -> Constraints:
    """Points spread by length: a point's place on its arc or path is the share of the length (mm) walked so far.

    For lengths along rims, see `rim_length.rim_lengths`.
    """
    points = division.surface.points

    def walked(ids: IntArray) -> FloatArray:
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points[ids], axis=0), axis=1))])
        return length / length[-1]

    return _constraints(division, template, walked, lambda loop: rim_lengths(points[loop]), template.foot)


def _constraints(
    division: Division,
    template: Template,
    fractions: Callable[[IntArray], FloatArray],
    along_rim: Callable[[IntArray], FloatArray],
    foot: Callable[[str, int], FloatArray],
) -> Constraints:
    """Targets, with `fractions` giving the share (0 to 1) of a path at each of its points, ends included, `along_rim`
    how far along a rim each of its points is, and at last its whole length, and `foot` where a path begins (0) and
    ends (1)."""
    anatomy = template.anatomy
    rim_ids, rim_targets = [], []
    for opening in anatomy.openings:
        loop, feet, rim = division.loops[opening], division.feet[opening], template.rim(opening)
        rim_ids.append(loop)
        along = along_rim(loop)
        stops = np.append(feet[1:], len(loop))
        targets = []
        for start, stop, angles in zip(feet, stops, rim.arcs(anatomy.feet(opening)), strict=True):
            share = (along[start:stop] - along[start]) / (along[stop] - along[start])
            targets.append(rim.shape.at(rim.shape.angle_at(*angles, share)))
        rim_targets.append(rim.shape.filled(np.concatenate(targets), feet))
    for name, point in division.landmarks.items():
        rim_ids.append(np.array([point], np.int64))
        rim_targets.append(np.array([template.landmarks[name]], np.float64))
    rims = np.concatenate(rim_ids)
    taken = np.zeros(len(division.surface.points), bool)
    taken[rims] = True
    path_ids, path_targets, path_of = [], [], []
    for name, ids in division.paths.items():
        # A point where two paths meet stays with the first of them, and the other shares out its remaining points.
        inner = ids[1:-1][~taken[ids[1:-1]]]
        taken[inner] = True
        share = fractions(np.concatenate([ids[:1], inner, ids[-1:]]))[1:-1]
        start, end = foot(name, 0), foot(name, 1)
        path_ids.append(inner)
        path_targets.append(start + share[:, None] * (end - start))
        path_of.append(np.full(len(inner), name))
    return Constraints(
        rims,
        np.concatenate(rim_targets),
        np.concatenate(path_ids),
        np.concatenate(path_targets),
        np.concatenate(path_of),
    )
