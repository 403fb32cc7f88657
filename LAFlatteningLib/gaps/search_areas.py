"""Where the closed path round a vein is looked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra

from ..anatomy import Anatomy
from ..errors import LAFlatteningError, SurfaceError
from ..half_edges import HalfEdges
from ..map_data import MapData
from ..parcellation import Parcellation
from ..surface import FloatArray, IntArray
from .ring_search import Centre

BoolArray = NDArray[np.bool_]
Search = float | str | Path | Parcellation | Mapping[str, str]
"""A distance from the rims, mm; a parcellation, its name or file; or area -> point array that marks it with 1."""

SEARCH_MM = 15.0
"""Ablation lines lie at the ostia or, drawn wide round a pair of veins, up to about so far away from their rims."""
BESIDE_MM = 10.0
"""Between two veins the area round both reaches at least so far to either side (or the search distance, if that is
less), for the path round both has to pass there."""
INSIDE, OUTSIDE = 0.9, 0.5
"""An area goes round an opening if it holds so much of its rim, and leaves it alone below so much."""


@dataclass(frozen=True, eq=False)
class SearchArea:
    """Where a closed path is looked for.

    Attributes
    ----------
    name : of the area; openings : what it goes round.
    triangles : (m,) which triangles of the map belong to it.
    centre : what turns are counted by.
    border : (k, 2) edges, as point ids, at which it ends within the atrium.
    """

    name: str
    openings: tuple[str, ...]
    triangles: BoolArray
    centre: Centre
    border: IntArray


def search_areas(data: MapData, search: Search) -> tuple[list[SearchArea], list[str], list[str]]:
    """The search areas on a map, the names of those within a distance of rims that are none (another opening interrupts
    them, or they do not hold the rim), and notes.

    Raises
    ------
    SurfaceError : an area that a user drew and that goes round no opening, or that another opening interrupts.
    TemplateError : a parcellation that does not belong on the map's template.
    LAFlatteningError : an array that is not there, a distance out of range.
    """
    corners = data.triangles
    masks: dict[str, BoolArray] = {}
    rims = data.rims()
    holes = {hole: rims[hole] for hole in data.template.holes}
    notes: list[str] = []
    if isinstance(search, (int, float)):
        masks, notes = _within(data, float(search), holes)
    elif isinstance(search, Mapping):
        for name, array in search.items():
            # Values at points: the triangles whose corners are all marked.
            masks[name] = np.all((data.point_values(array) > 0.5)[corners], axis=1)
    else:
        parts = search if isinstance(search, Parcellation) else Parcellation.load(search)
        centroids = data.flat[corners].mean(axis=1)
        masks = {part.name: parts.contains(part.name, centroids, data.template) for part in parts.parts}
    areas, none = [], []
    for name, mask in masks.items():
        try:
            areas.append(_search_area(data, name, mask, holes))
        except SurfaceError:
            if not by_distance(search):
                raise
            none.append(name)
    return areas, none, notes


def by_distance(search: Search) -> bool:
    """Whether search areas lie within a distance of rims; otherwise they are drawn."""
    return isinstance(search, (int, float))


def describe_search(search: Search) -> str:
    """How the search areas were chosen, for the report."""
    if isinstance(search, (int, float)):
        return f"within {search:g} mm of the rims"
    if isinstance(search, Mapping):
        return "arrays " + ", ".join(search.values())
    return search.name if isinstance(search, Parcellation) else Path(search).name


def vein_groups(anatomy: Anatomy) -> dict[str, tuple[str, ...]]:
    """The openings round which gaps are looked for: each vein by itself, then the veins of each side together.

    Sides are those of which the anatomy says that one lies left of the other; without them, every hole by itself.
    """
    sides = anatomy.directions.get("left", ())
    if not sides:
        return {hole: (hole,) for hole in anatomy.holes}
    groups = {"left": sides[0][0], "right": sides[0][1]}
    alone = [hole for hole in anatomy.holes if any(hole in group for group in groups.values())]
    return {**{hole: (hole,) for hole in alone}, **{name: group for name, group in groups.items() if len(group) > 1}}


def _within(data: MapData, reach: float, holes: Mapping[str, IntArray]) -> tuple[dict[str, BoolArray], list[str]]:
    """Triangles nearer than `reach` mm to the rims of a group, and nearer to them than to any other hole; and notes.

    The outer opening takes nothing away: lines round a vein may come near the valve. Round veins that lie far apart the
    distance is larger, see `BESIDE_MM`.
    """
    if not (np.isfinite(reach) and reach > 0.0):
        raise LAFlatteningError(f"Expected a search distance of more than 0 mm, found {reach:g}.")
    distance = dict(zip(holes, _distances(data, list(holes.values())), strict=True))
    masks, notes = {}, []
    for name, group in vein_groups(data.template.anatomy).items():
        apart = max((float(distance[a][holes[b]].min()) for a, b in pairwise(group)), default=0.0)
        far = max(reach, float(np.hypot(0.5 * apart, min(reach, BESIDE_MM)))) if apart else reach
        if far > reach:
            notes.append(
                f"{' and '.join(group)} are {apart:.0f} mm apart: the path round both was looked for within "
                f"{far:.0f} mm of their rims."
            )
        own = np.min([distance[hole] for hole in group], axis=0)
        others = np.min([distance[hole] for hole in distance if hole not in group], axis=0)
        at = np.minimum(own, far)[data.triangles].mean(axis=1)
        masks[name] = (at < far) & (at <= others[data.triangles].mean(axis=1))
    return masks, notes


def _distances(data: MapData, rims: list[IntArray]) -> list[FloatArray]:
    """(n,) mm of each point from each rim, along edges and straight across one edge at a time."""
    graph = HalfEdges.of(data.surface).near_graph()
    return [dijkstra(graph, indices=rim, min_only=True) for rim in rims]


def _search_area(data: MapData, name: str, triangles: BoolArray, holes: Mapping[str, IntArray]) -> SearchArea:
    if not triangles.any():
        raise SurfaceError(f"The search area {name} is empty. It has to go round a vein; draw it larger.")
    inside = np.zeros(len(data.flat), bool)
    inside[data.triangles[triangles]] = True
    held = {hole: float(inside[rim].mean()) for hole, rim in holes.items()}
    openings = tuple(hole for hole, share in held.items() if share >= INSIDE)
    if not openings:
        most = max(held, key=lambda hole: held[hole])
        raise SurfaceError(
            f"The search area {name} goes round no opening: it holds at most {100 * held[most]:.0f} % of a rim "
            f"({most}). Expected an area that begins at the rim of the vein, all round; draw it larger."
        )
    hit = [hole for hole, share in held.items() if OUTSIDE < share < INSIDE]
    if hit:
        raise SurfaceError(
            f"The search area {name}, round {' and '.join(openings)}, also runs into {hit[0]} (it holds "
            f"{100 * held[hit[0]]:.0f} % of its rim). Draw it smaller, or round both."
        )
    edges = data.surface.edges
    sides = edges.triangles
    held_sides = np.where(sides >= 0, triangles[sides], False).sum(axis=1)
    border = edges.points[(held_sides == 1) & (edges.usage == 2)]
    centres = np.array([data.template.holes[hole].shape.centre for hole in openings])
    return SearchArea(name, openings, triangles, Centre(centres), border)
