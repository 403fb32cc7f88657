"""The division of the cavity: paths between the seeds, their feet on the rims, and the regions between them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from . import topology
from .anatomy import Anatomy
from .errors import SeedError, SurfaceError, TemplateError
from .geodesics import PathTree
from .seed_paths import SeedPaths, path_length
from .subcontours import spread_counts, spread_lengths
from .surface import IntArray, Surface
from .template import Template

DETOUR = 1.5
"""A path that must go this much farther (plus `DETOUR_MM`) to keep clear of the others shows misplaced seeds."""
DETOUR_MM = 5.0
SMALLEST_ARC = 0.05
"""Feet on the rim of a hole are kept apart by this share of its points (method ``regional``)."""


@dataclass(frozen=True, eq=False)
class Division:
    """Rims and paths on the cavity, ready to be laid on a template.

    Attributes
    ----------
    surface : the cavity.
    loops : opening -> its rim as point ids, counter-clockwise on the map, starting at the first foot.
    feet : opening -> index in the loop of each foot, in the order of `Anatomy.feet`, increasing from 0.
    paths : path -> point ids from foot to foot, feet included.
    notes : what is unusual about the seeds.
    seed_paths : the same paths from seed to seed, as ids of `Cavity.closed`.
    """

    surface: Surface
    loops: Mapping[str, IntArray]
    feet: Mapping[str, IntArray]
    paths: Mapping[str, IntArray]
    seed_paths: Mapping[str, IntArray]
    notes: tuple[str, ...] = ()


def _place_feet(
    connected: SeedPaths,
    template: Template,
    new_feet: Callable[[str, IntArray, IntArray], IntArray],
    smallest_arc: float = 0.0,
) -> tuple[dict[str, IntArray], dict[str, IntArray]]:
    """Start every loop at its first foot and displace the others by `new_feet(opening, loop, indices)`.

    Feet on holes are kept `smallest_arc` (a share of the rim's points) apart. Those on the outer rim are seeds and
    stay where the user put them.
    """
    anatomy = template.anatomy
    loops, feet = {}, {}
    for opening in anatomy.openings:
        order = anatomy.feet(opening)
        start = connected.feet[opening][order[0]]
        loop = np.roll(connected.loops[opening], -start)
        index = np.array([(connected.feet[opening][name] - start) % len(loop) for name in order], np.int64)
        if template.rim(opening).spread_feet:
            index = new_feet(opening, loop, index)
        if len(loop) < 2 * len(index):
            raise SurfaceError(
                f"The rim of {opening} has {len(loop)} points; expected at least {2 * len(index)} for its {len(index)} "
                "paths. Use a finer mesh."
            )
        share = 0.0 if opening == anatomy.outer else smallest_arc
        index = _apart(index, len(loop), max(1, round(share * len(loop))))
        loops[opening], feet[opening] = loop, index
    return loops, feet


def _apart(index: IntArray, n: int, least: int) -> IntArray:
    """Feet (increasing from 0 on a rim of n points) moved as little as needed to be `least` points apart.

    The seed of a hole may sit so near its rim that all paths leave it at one point.
    """
    index = index.copy()
    for k in range(1, len(index)):
        index[k] = max(index[k], index[k - 1] + least)
    index[-1] = min(index[-1], n - least)
    for k in range(len(index) - 2, 0, -1):
        index[k] = min(index[k], index[k + 1] - least)
    return index


def divide_as_published(surface: Surface, connected: SeedPaths, template: Template, rounding: str) -> Division:
    """Rims and paths by the published rules: points are counted, paths found again on the open cavity.

    Parameters
    ----------
    rounding : see `subcontours.ROUNDINGS`.
    """
    anatomy = template.anatomy

    def new_feet(opening: str, loop: IntArray, index: IntArray) -> IntArray:
        arcs = np.diff(np.append(index, len(loop))).tolist()
        if len(arcs) != 3:
            raise TemplateError(
                f"holes.{opening}.spread_feet: the published rule is for three paths, found {len(arcs)}. Set it to "
                "false, or use the method regional."
            )
        shares = template.rim(opening).shares(anatomy.feet(opening))
        return np.concatenate([[0], np.cumsum(spread_counts(arcs, shares, rounding))[:-1]])

    loops, feet = _place_feet(connected, template, new_feet)
    foot = _foot_ids(anatomy, loops, feet)
    paths = {}
    for name, (a, b) in anatomy.paths.items():
        start, end = foot[anatomy.opening_of(a), name], foot[anatomy.opening_of(b), name]
        ids = PathTree(surface.edge_graph, start).to(end)
        if ids is None:
            raise SurfaceError(f"No path {name} from {a} to {b} on the open cavity: it is not connected.")
        paths[name] = ids
    return Division(surface, loops, feet, paths, connected.paths, connected.notes)


def divide(surface: Surface, connected: SeedPaths, template: Template) -> Division:
    """Rims and paths stated in lengths, every path clear of all rims and of the other paths.

    Parameters
    ----------
    surface : the cavity (`Cavity.surface`, or the same points with some edges flipped).

    Raises
    ------
    SeedError : if a path has to go far out of its way, or cannot pass at all.
    """
    anatomy = template.anatomy

    def new_feet(opening: str, loop: IntArray, index: IntArray) -> IntArray:
        at = _positions(surface, loop)
        arcs = np.diff(at[np.append(index, len(loop))])
        wanted = np.cumsum(spread_lengths(arcs, template.rim(opening).shares(anatomy.feet(opening))))[:-1]
        nearest = np.abs(at[None, :-1] - wanted[:, None]).argmin(axis=1)
        return np.concatenate([[0], nearest])

    loops, feet = _place_feet(connected, template, new_feet, SMALLEST_ARC)
    foot = _foot_ids(anatomy, loops, feet)
    router = _Router(surface, np.concatenate(list(loops.values())))
    ends = {
        name: (foot[anatomy.opening_of(a), name], foot[anatomy.opening_of(b), name])
        for name, (a, b) in anatomy.paths.items()
    }
    direct = {}
    for name, pair in ends.items():
        # Seldom much longer than from seed to seed; if it is, look farther.
        near = DETOUR * connected.lengths[name] + DETOUR_MM
        direct[name] = router.path(*pair, limit=near)
        if direct[name] is None:
            direct[name] = router.path(*pair)
    length = {name: np.inf if ids is None else path_length(surface, ids) for name, ids in direct.items()}
    paths: dict[str, IntArray] = {}
    # The shortest have the least room to give way.
    for name in sorted(anatomy.paths, key=lambda path: length[path]):
        ids = direct[name]
        if ids is None or router.is_blocked(ids[1:-1]):
            ids = router.path(*ends[name])
        if ids is None or path_length(surface, ids) > DETOUR * length[name] + DETOUR_MM:
            a, b = anatomy.paths[name]
            raise SeedError(
                f"Path {name} from {a} to {b} is cut off by a rim or by other paths ({', '.join(paths) or 'none'}). "
                f"Check seeds {a} and {b} and their neighbours.",
                (a, b),
            )
        paths[name] = ids
        router.block(ids)
    return Division(
        surface, loops, feet, {name: paths[name] for name in anatomy.paths}, connected.paths, connected.notes
    )


def _foot_ids(
    anatomy: Anatomy, loops: Mapping[str, IntArray], feet: Mapping[str, IntArray]
) -> dict[tuple[str, str], int]:
    return {
        (opening, name): int(loops[opening][index])
        for opening in anatomy.openings
        for name, index in zip(anatomy.feet(opening), feet[opening], strict=True)
    }


def _positions(surface: Surface, loop: IntArray) -> np.ndarray:
    """Length along a rim from its first point to each point, and once round, (k + 1,) mm."""
    steps = np.linalg.norm(surface.points[np.roll(loop, -1)] - surface.points[loop], axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


class _Router:
    """Shortest edge paths that do not pass through points already taken."""

    def __init__(self, surface: Surface, taken: IntArray) -> None:
        self._graph = surface.edge_graph.copy()
        self._weights = self._graph.data.copy()
        self._taken = np.zeros(len(surface.points), bool)
        self.block(taken)

    def block(self, ids: IntArray) -> None:
        self._taken[ids] = True
        # No way out of a taken point: it can be reached, as a target, but not passed.
        for i in ids:
            self._graph.data[self._graph.indptr[i] : self._graph.indptr[i + 1]] = np.inf

    def is_blocked(self, ids: IntArray) -> bool:
        return bool(self._taken[ids].any())

    def path(self, start: int, end: int, limit: float = np.inf) -> IntArray | None:
        way_out = slice(self._graph.indptr[start], self._graph.indptr[start + 1])
        self._graph.data[way_out] = self._weights[way_out]
        try:
            return PathTree(self._graph, start, limit).to(end)
        finally:
            self._graph.data[way_out] = np.inf


def label_regions(division: Division, anatomy: Anatomy) -> IntArray:
    """Region number of each triangle, (m,): the surface is cut along the paths, and each piece gets the region
    that lies on that side of the paths round it.

    Pieces cut off by paths that touch belong to the region on whose side most of their boundary lies.
    """
    surface = division.surface
    edges = surface.edges
    n = len(surface.points)
    key = edges.points[:, 0] * n + edges.points[:, 1]
    cut = np.zeros(len(key), bool)
    left_region = {dart: region for region in anatomy.regions for dart in anatomy.face(region)}
    walked, region_of_walk = [], []
    for name, ids in division.paths.items():
        for end, walk in ((0, ids), (1, ids[::-1])):
            walked.append(np.stack([walk[:-1], walk[1:]], axis=1))
            region_of_walk.append(np.full(len(walk) - 1, left_region[name, end]))
    directed = np.concatenate(walked)
    region_of_step = np.concatenate(region_of_walk)
    along = np.searchsorted(key, directed.min(axis=1) * n + directed.max(axis=1))
    cut[along] = True
    piece = topology.triangle_components(surface.triangles, edges, cut)
    # The triangle on the left of a directed edge is the one that runs along it.
    triangle = edges.triangles[along]
    corners = surface.triangles[triangle]
    runs = (corners == directed[:, None, :1]) & (np.roll(corners, -1, axis=2) == directed[:, None, 1:])
    inside = runs.any(axis=2) & (triangle >= 0)
    has_left = inside.any(axis=1)
    left = triangle[np.arange(len(triangle)), inside.argmax(axis=1)][has_left]
    numbers = np.array(sorted(anatomy.regions))
    votes = np.zeros((piece.max() + 1, len(numbers)))
    np.add.at(votes, (piece[left], np.searchsorted(numbers, region_of_step[has_left])), 1.0)
    return numbers[votes.argmax(axis=1)][piece]
