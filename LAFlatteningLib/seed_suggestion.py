"""Seeds by rule: all of an anatomy, from the rims of its cavity alone.

Holes
    The seed is the centroid of the area within the rim.
Outer rim
    A seed there is joined by a path to one hole (`Anatomy.paths`). It is where the outer rim is nearest to the rim of
    that hole along the surface; experts put it within 8 % of the shortest way. Where the rim runs at nearly equal
    distance for a while, the nearest point alone would jump with the least noise. The seed is therefore the mean of all
    points of the rim, weighted with exp(-(d - smallest d) / `SOFTNESS_MM`): smooth in the surface.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.sparse.csgraph import dijkstra

from .anatomy import Anatomy
from .errors import SeedError
from .half_edges import HalfEdges
from .surface import FloatArray, IntArray, Surface

SOFTNESS_MM = 6.0
"""Points of the rim that are farther by this count 1/e as much."""


def suggest_seeds(surface: Surface, rims: Mapping[str, IntArray], anatomy: Anatomy) -> dict[str, FloatArray]:
    """The seeds of a cavity whose openings are known.

    Parameters
    ----------
    surface : the open cavity, oriented, mm.
    rims : opening -> its rim, ordered point ids (`Surface.boundary_loops`).

    Returns
    -------
    Seed -> (3,) mm, in the order of `Anatomy.seeds`. Seeds of holes lie in the opening, those of the outer rim on it.

    Raises
    ------
    SeedError : seeds of the outer rim would not follow each other as on the map, so that paths would cross.
    """
    seeds = {hole: rim_centre(surface.points[rims[hole]]) for hole in anatomy.holes}
    outer = rims[anatomy.outer]
    distances = _distances(surface, [rims[hole] for hole in anatomy.holes])[:, outer]
    where: dict[str, float] = {}
    for seed in anatomy.outer_seeds:
        path = next(pair for pair in anatomy.paths.values() if seed in pair)
        hole = path[1] if path[0] == seed else path[0]
        where[seed] = _soft_nearest(surface.points[outer], distances[anatomy.holes.index(hole)])
        seeds[seed] = _on_loop(surface.points[outer], where[seed])
    # On the map the outer rim is walked counter-clockwise, surface on the left, as are loops of the surface.
    turns = np.diff([where[seed] for seed in anatomy.outer_seeds], append=where[next(iter(anatomy.outer_seeds))]) % 1.0
    if not np.isclose(turns.sum(), 1.0):
        raise SeedError(
            f"The places on the rim of the {anatomy.openings[anatomy.outer]} nearest to the veins and the appendage do "
            f"not follow each other as {', '.join(anatomy.outer_seeds)} do. Expected four veins and an appendage in "
            "their usual order; check which opening is which, or place these seeds yourself.",
            tuple(anatomy.outer_seeds),
        )
    return {label: seeds[label] for label in anatomy.seeds}


def rim_centre(loop: FloatArray) -> FloatArray:
    """Centroid (3,) of the area of the cone over a closed curve (k, 3), its apex in the mean of the points."""
    middle = loop.mean(axis=0)
    following = np.roll(loop, -1, axis=0)
    area = np.linalg.norm(np.cross(loop - middle, following - middle), axis=1)
    if area.sum() <= 0.0:
        return middle
    return np.average((loop + following + middle) / 3.0, axis=0, weights=area)


def _distances(surface: Surface, rims: list[IntArray]) -> FloatArray:
    """(rims, n) distance of each point from each rim along edges and across pairs of triangles, mm."""
    graph = HalfEdges.of(surface).near_graph()
    return np.stack([dijkstra(graph, indices=rim, min_only=True) for rim in rims])


def _soft_nearest(loop: FloatArray, distance: FloatArray) -> float:
    """Where a closed curve (k, 3) is nearest, as a share of its length from its first point."""
    length = np.linalg.norm(loop - np.roll(loop, -1, axis=0), axis=1)
    at = np.concatenate([[0.0], np.cumsum(length)[:-1]]) / length.sum()
    # Each point stands for half of the way to its neighbours.
    weight = 0.5 * (length + np.roll(length, 1)) * np.exp(-(distance - distance.min()) / SOFTNESS_MM)
    return float(np.angle((weight * np.exp(2j * np.pi * at)).sum()) / (2.0 * np.pi) % 1.0)


def _on_loop(loop: FloatArray, share: float) -> FloatArray:
    """The place (3,) at a share of the length of a closed curve from its first point."""
    closed = np.concatenate([loop, loop[:1]])
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    return np.array([np.interp(share * at[-1], at, c) for c in closed.T])
