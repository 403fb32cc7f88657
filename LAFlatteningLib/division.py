"""The division of the cavity: paths between the seeds, their feet on the rims, and the regions between them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from . import topology
from .anatomy import Anatomy
from .cavity.openings import Cavity
from .errors import SeedError, SurfaceError
from .geodesics import PathTree
from .seeds import SnappedSeeds
from .subcontours import spread_counts, spread_lengths
from .surface import IntArray, Surface
from .template import Template

DETOUR = 1.5
"""A path that must go this much farther (plus `DETOUR_MM`) to keep clear of the others shows misplaced seeds."""
DETOUR_MM = 5.0


@dataclass(frozen=True, eq=False)
class SeedPaths:
    """Shortest paths between seeds on the closed surface.

    Attributes
    ----------
    paths : path -> point ids in `Cavity.closed`, from the first seed to the second.
    lengths : path -> its length, mm.
    loops : opening -> its rim as ids of the cavity, counter-clockwise on the map.
    feet : opening -> path -> index in the loop of the point where the path leaves the cover (or of the seed,
        on the outer rim).
    """

    paths: Mapping[str, IntArray]
    lengths: Mapping[str, float]
    loops: Mapping[str, IntArray]
    feet: Mapping[str, Mapping[str, int]]


@dataclass(frozen=True, eq=False)
class Division:
    """Rims and paths on the cavity, ready to be laid on a template.

    Attributes
    ----------
    surface : the cavity.
    loops : opening -> its rim as point ids, counter-clockwise on the map, starting at the first foot.
    feet : opening -> index in the loop of each foot, in the order of `Anatomy.feet`, increasing from 0.
    paths : path -> point ids from foot to foot, feet included.
    seed_paths : the same paths from seed to seed, as ids of `Cavity.closed`.
    """

    surface: Surface
    loops: Mapping[str, IntArray]
    feet: Mapping[str, IntArray]
    paths: Mapping[str, IntArray]
    seed_paths: Mapping[str, IntArray]


def connect_seeds(cavity: Cavity, seeds: SnappedSeeds, anatomy: Anatomy) -> SeedPaths:
    """Join the seeds by shortest edge paths on the closed surface, and find the feet of the paths on the rims.

    Raises
    ------
    SeedError : where the paths leave a rim in another order than the anatomy says: seeds mirrored or swapped.
    """
    trees = {hole: PathTree(cavity.closed.edge_graph, seeds.ids[hole]) for hole in anatomy.holes}
    result = _connect(cavity, seeds, anatomy, trees)
    if _misplaced(result, anatomy):
        _explain(cavity, seeds, anatomy, trees, result)
    _check_rotation(seeds, anatomy, trees)
    return result


def _connect(cavity: Cavity, seeds: SnappedSeeds, anatomy: Anatomy, trees: Mapping[str, PathTree]) -> SeedPaths:
    number = np.full(len(cavity.closed.points), -1, np.int64)
    number[cavity.ids] = np.arange(len(cavity.ids))
    loops = {hole: cavity.rims[seeds.hole[hole]][::-1] for hole in anatomy.holes}
    loops[anatomy.outer] = cavity.outer
    feet: dict[str, dict[str, int]] = {opening: {} for opening in anatomy.openings}
    paths = {}
    for name, (a, b) in anatomy.paths.items():
        forward = a in trees
        ids = trees[a if forward else b].to(seeds.ids[b if forward else a])
        if ids is None:
            raise SurfaceError(f"No path {name} from {a} to {b} on the surface: it is not connected.")
        paths[name] = ids if forward else ids[::-1]
        for seed, walk in ((a, paths[name]), (b, paths[name][::-1])):
            opening = anatomy.opening_of(seed)
            leaves = walk[np.argmax(number[walk] >= 0)]
            index = np.flatnonzero(loops[opening] == number[leaves])
            if len(index) == 0:
                raise SurfaceError(
                    f"Path {name} does not leave {opening} through its rim; check the cover of {opening}."
                )
            feet[opening][name] = int(index[0])
    lengths = {name: _path_length(cavity.closed, ids) for name, ids in paths.items()}
    return SeedPaths(paths, lengths, loops, feet)


def _out_of_order(paths: SeedPaths, anatomy: Anatomy, step: int = 1) -> list[str]:
    """The openings whose feet do not follow each other as in the anatomy (with step -1: in its mirror image)."""
    wrong = []
    for opening in anatomy.openings:
        order = anatomy.feet(opening)[::step]
        n = len(paths.loops[opening])
        at = [paths.feet[opening][name] for name in order]
        # Two paths may share a foot on a coarse rim: an angle of 0 between them is allowed, once round is not.
        turns = sum((after - before) % n for before, after in zip(at, at[1:] + at[:1], strict=True))
        if turns > n:
            wrong.append(opening)
    return wrong


def _crossings(paths: SeedPaths, anatomy: Anatomy) -> list[tuple[str, str]]:
    """Pairs of paths without a common seed that meet."""
    return [
        (a, b)
        for a, b in combinations(anatomy.paths, 2)
        if not set(anatomy.paths[a]) & set(anatomy.paths[b]) and np.intersect1d(paths.paths[a], paths.paths[b]).size
    ]


def _misplaced(paths: SeedPaths, anatomy: Anatomy) -> bool:
    return bool(_out_of_order(paths, anatomy)) or bool(_crossings(paths, anatomy))


def _explain(
    cavity: Cavity, seeds: SnappedSeeds, anatomy: Anatomy, trees: Mapping[str, PathTree], paths: SeedPaths
) -> None:
    """Raise the SeedError that tells mirrored from swapped from merely misplaced seeds.

    Paths that only touch on a coarse mesh, with every rim in order, are no error here.
    """
    wrong = _out_of_order(paths, anatomy)
    if not _out_of_order(paths, anatomy, -1):
        raise SeedError(
            "The anatomy is mirrored: seen from outside, the seeds run round every opening the wrong way. Either the "
            "surface was flipped (an image with a mirrored axis), or left and right labels are exchanged. Check which "
            "side is the patient's left; do not use this map.",
            anatomy.seeds,
        )
    kinds = (anatomy.holes, tuple(sorted(anatomy.outer_seeds)))
    candidates = []
    for a, b in (pair for kind in kinds for pair in combinations(kind, 2)):
        swap = {a: b, b: a}
        renamed = SnappedSeeds(
            {label: seeds.ids[swap.get(label, label)] for label in seeds.ids},
            {label: seeds.hole[swap.get(label, label)] for label in seeds.hole},
            seeds.moved_mm,
        )
        other_trees = {label: trees[swap.get(label, label)] for label in trees}
        attempt = _connect(cavity, renamed, anatomy, other_trees)
        if not _misplaced(attempt, anatomy):
            length = sum(attempt.lengths.values())
            candidates.append((length, a, b))
    if candidates:
        _, a, b = min(candidates)
        raise SeedError(f"Seeds {a} and {b} look swapped: exchanging them puts every path in its place.", (a, b))
    if wrong:
        kind = "; ".join(
            f"round {opening} expected {', '.join(anatomy.feet(opening))}, found "
            f"{', '.join(sorted(paths.feet[opening], key=lambda name: paths.feet[opening][name]))}"
            for opening in wrong
        )
        labels = {seed for opening in wrong for name in anatomy.feet(opening) for seed in anatomy.paths[name]}
        raise SeedError(
            f"The paths between the seeds are out of order (counter-clockwise on the map, {kind}). "
            f"Check seeds {', '.join(label for label in anatomy.seeds if label in labels)}.",
            tuple(labels),
        )


def _check_rotation(seeds: SnappedSeeds, anatomy: Anatomy, trees: Mapping[str, PathTree]) -> None:
    """Raise SeedError if the outer seeds, all moved on by one or more places, would give much shorter paths."""
    order = tuple(anatomy.outer_seeds)
    holes = [next(seed for seed in anatomy.paths[path] if seed in trees) for path in anatomy.outer_paths]
    lengths = [
        sum(trees[hole].distance[seeds.ids[order[(k + shift) % len(order)]]] for k, hole in enumerate(holes))
        for shift in range(len(order))
    ]
    if lengths and lengths[0] > DETOUR * min(lengths):
        shift = int(np.argmin(lengths))
        renames = ", ".join(f"{order[(k + shift) % len(order)]} as {order[k]}" for k in range(len(order)))
        raise SeedError(
            f"The seeds on the {anatomy.outer} rim look moved on by {shift} place{'s' if shift > 1 else ''}: the paths "
            f"to them are {lengths[0]:.0f} mm long together, {min(lengths):.0f} mm with {renames}.",
            order,
        )


def _path_length(surface: Surface, ids: IntArray) -> float:
    return float(np.linalg.norm(np.diff(surface.points[ids], axis=0), axis=1).sum())


def _place_feet(
    surface: Surface, connected: SeedPaths, template: Template, new_feet: Callable[[str, IntArray, IntArray], IntArray]
) -> tuple[dict[str, IntArray], dict[str, IntArray]]:
    """Start every loop at its first foot and displace the others by `new_feet(opening, loop, indices)`."""
    anatomy = template.anatomy
    loops, feet = {}, {}
    for opening in anatomy.openings:
        order = anatomy.feet(opening)
        start = connected.feet[opening][order[0]]
        loop = np.roll(connected.loops[opening], -start)
        index = np.array([(connected.feet[opening][name] - start) % len(loop) for name in order], np.int64)
        if template.rim(opening).spread_feet:
            index = new_feet(opening, loop, index)
        if len(loop) < 2 * len(index) or (np.diff(np.append(index, len(loop))) < 1).any():
            raise SurfaceError(
                f"The rim of {opening} has {len(loop)} points and the paths {', '.join(order)} meet on it in one "
                "point. Move the seed towards the middle of the opening, or use a finer mesh."
            )
        loops[opening], feet[opening] = loop, index
    return loops, feet


def divide_as_published(cavity: Cavity, seeds: SnappedSeeds, template: Template, rounding: str) -> Division:
    """Rims and paths by the published rules: points are counted, paths found again on the open cavity.

    Parameters
    ----------
    rounding : see `subcontours.ROUNDINGS`.
    """
    anatomy = template.anatomy
    connected = connect_seeds(cavity, seeds, anatomy)

    def new_feet(opening: str, loop: IntArray, index: IntArray) -> IntArray:
        arcs = np.diff(np.append(index, len(loop))).tolist()
        shares = template.rim(opening).shares(anatomy.feet(opening))
        return np.concatenate([[0], np.cumsum(spread_counts(arcs, shares, rounding))[:-1]])

    surface = cavity.surface
    loops, feet = _place_feet(surface, connected, template, new_feet)
    foot = _foot_ids(anatomy, loops, feet)
    paths = {}
    for name, (a, b) in anatomy.paths.items():
        start, end = foot[anatomy.opening_of(a), name], foot[anatomy.opening_of(b), name]
        ids = PathTree(surface.edge_graph, start).to(end)
        if ids is None:
            raise SurfaceError(f"No path {name} from {a} to {b} on the open cavity: it is not connected.")
        paths[name] = ids
    return Division(surface, loops, feet, paths, connected.paths)


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

    loops, feet = _place_feet(surface, connected, template, new_feet)
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
    length = {name: np.inf if ids is None else _path_length(surface, ids) for name, ids in direct.items()}
    paths: dict[str, IntArray] = {}
    # The shortest have the least room to give way.
    for name in sorted(anatomy.paths, key=lambda path: length[path]):
        ids = direct[name]
        if ids is None or router.is_blocked(ids[1:-1]):
            ids = router.path(*ends[name])
        if ids is None or _path_length(surface, ids) > DETOUR * length[name] + DETOUR_MM:
            a, b = anatomy.paths[name]
            raise SeedError(
                f"Path {name} from {a} to {b} is cut off by a rim or by other paths ({', '.join(paths) or 'none'}). "
                f"Check seeds {a} and {b} and their neighbours.",
                (a, b),
            )
        paths[name] = ids
        router.block(ids)
    return Division(surface, loops, feet, {name: paths[name] for name in anatomy.paths}, connected.paths)


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
