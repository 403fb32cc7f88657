"""Tips: where veins and appendage end, found as the peaks of the distance from the body of the chamber."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..surface import FloatArray, Surface
from .lumen import Lumen

SMALLEST_RISE_MM = 3.0
"""A peak that rises less above the pass to a higher one is no tip; veins rise 7 mm or more."""


class Tip(NamedTuple):
    """The end of a protrusion."""

    position: FloatArray
    """(3,) mm, a point of the surface."""
    rise_mm: float
    """How far it stands out: its distance from the body less that of the pass over which a higher peak is reached."""
    distance_mm: float
    """From the body, along the shortest way inside."""


def find_tips(surface: Surface, lumen: Lumen, smallest_rise_mm: float = SMALLEST_RISE_MM) -> list[Tip]:
    """The tips of a closed surface, by falling rise.

    The distance from the body along the inside has one peak at the end of each vein; how far it rises above the pass to
    a higher peak (its topological persistence) tells veins from bumps, whatever the size and place of either.

    Parameters
    ----------
    surface : closed (rims covered), mm.
    lumen : its inside.

    Source: Edelsbrunner, Letscher and Zomorodian 2002 (persistence), by union-find over falling values.
    """
    height = lumen.distance_at(surface.points)
    height[~surface.used_points] = -np.inf
    order = np.argsort(-height, kind="stable")
    graph = surface.edge_graph
    starts, ends = graph.indptr.tolist(), graph.indices.tolist()
    above = [-1] * len(height)
    """Union-find: -1 for points not reached yet; the root of a set is its peak."""
    value = height.tolist()

    def root(point: int) -> int:
        while above[point] != point:
            above[point] = above[above[point]]
            point = above[point]
        return point

    tips = []
    for point in order.tolist():
        peaks = {root(other) for other in ends[starts[point] : starts[point + 1]] if above[other] >= 0}
        if not peaks:
            above[point] = point
            continue
        highest = max(peaks, key=lambda peak: (value[peak], -peak))
        above[point] = highest
        for peak in peaks - {highest}:
            above[peak] = highest
            if value[peak] - value[point] >= smallest_rise_mm:
                tips.append(Tip(surface.points[peak], value[peak] - value[point], value[peak]))
    top = int(order[0])
    tips.append(Tip(surface.points[top], value[top], value[top]))
    return sorted(tips, key=lambda tip: -tip.rise_mm)
