"""Paths between the seeds, where they leave the rims, and whether the seeds can be right."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Protocol

import numpy as np
from scipy import sparse

from .anatomy import Anatomy
from .cavity.openings import Cavity
from .errors import SeedError, SurfaceError
from .geodesics import PathTree
from .seeds import SnappedSeeds, check_directions
from .surface import IntArray, Surface

ROTATED = 1.15
"""Outer seeds are taken for moved on along the rim if all of them, moved on, would have paths shorter by this factor.
(Seeds of experts never do; moved on by one place, their paths get longer by 1.2 at least.)"""
FAR_SEED = 1.25
"""An outer seed whose path is longer than the shortest way to the rim by this factor makes a note (experts': 1.08)."""


@dataclass(frozen=True, eq=False)
class SeedPaths:
    """Shortest paths between seeds.

    Attributes
    ----------
    paths : path -> point ids in `Cavity.closed`, from the first seed to the second.
    lengths : path -> its length, mm.
    notes : what is unusual about the seeds.
    loops : opening -> its rim as ids of the cavity, counter-clockwise on the map.
    feet : opening -> path -> index in the loop of the point where the path leaves the cover (or of the seed,
        on the outer rim).
    """

    paths: Mapping[str, IntArray]
    lengths: Mapping[str, float]
    loops: Mapping[str, IntArray]
    feet: Mapping[str, Mapping[str, int]]
    notes: tuple[str, ...] = ()


class Ways(Protocol):
    """A way of going from the seed of a hole to other seeds."""

    def path(self, seeds: SnappedSeeds, start: str, end: str) -> IntArray | None:
        """Point ids in `Cavity.closed` from one seed to another; None if there is no way."""

    def distance(self, seeds: SnappedSeeds, start: str, end: str) -> float:
        """Length of that path, mm."""

    def to_outer_rim(self, seeds: SnappedSeeds, start: str) -> float:
        """Length of the shortest path to any point of the outer rim, mm."""


class WaysOverCovers:
    """Shortest paths along the edges of the closed surface, covers included: as published.

    Where a path leaves an ostium depends on the triangles of its cover.
    """

    def __init__(self, cavity: Cavity) -> None:
        self._graph = cavity.closed.edge_graph
        self._outer = cavity.ids[cavity.outer]
        self._trees: dict[int, PathTree] = {}

    def _tree(self, seeds: SnappedSeeds, start: str) -> PathTree:
        source = seeds.ids[start]
        if source not in self._trees:
            self._trees[source] = PathTree(self._graph, source)
        return self._trees[source]

    def path(self, seeds: SnappedSeeds, start: str, end: str) -> IntArray | None:
        """See `Ways`."""
        return self._tree(seeds, start).to(seeds.ids[end])

    def distance(self, seeds: SnappedSeeds, start: str, end: str) -> float:
        """See `Ways`."""
        return float(self._tree(seeds, start).distance[seeds.ids[end]])

    def to_outer_rim(self, seeds: SnappedSeeds, start: str) -> float:
        """See `Ways`."""
        return float(self._tree(seeds, start).distance[self._outer].min())


class WaysAcrossOstia:
    """Straight from a seed to its rim, then along the edges of the open cavity, whichever rim point makes it shortest.

    An ostium is nearly flat, so that the straight line is what a path over a perfect cover would be, and the
    triangles of the cover do not matter. No path leads across another ostium.
    """

    def __init__(self, cavity: Cavity) -> None:
        self._cavity = cavity
        self._trees: dict[int, PathTree] = {}

    def _across(self, seeds: SnappedSeeds, hole: str) -> tuple[IntArray, np.ndarray]:
        """The rim of a hole as cavity ids, and how far each of its points is from the seed, mm."""
        rim = self._cavity.rims[seeds.hole[hole]]
        return rim, np.linalg.norm(self._cavity.surface.points[rim] - seeds.positions[hole], axis=1)

    def _tree(self, seeds: SnappedSeeds, start: str) -> PathTree:
        key = seeds.ids[start]
        if key not in self._trees:
            # The seed is one more node, with edges out to its rim and none back in.
            graph = self._cavity.surface.edge_graph
            n = graph.shape[0]
            rim, far = self._across(seeds, start)
            extended = sparse.csr_matrix(
                (
                    np.append(graph.data, far),
                    np.append(graph.indices, rim),
                    np.append(graph.indptr, graph.nnz + len(rim)),
                ),
                shape=(n + 1, n + 1),
            )
            self._trees[key] = PathTree(extended, n)
        return self._trees[key]

    def _last(self, seeds: SnappedSeeds, start: str, end: str) -> tuple[int, float]:
        """The cavity point where the path from one seed to another ends or enters the ostium, and its length, mm."""
        tree = self._tree(seeds, start)
        if end not in seeds.hole:
            point = int(self._cavity.number[seeds.ids[end]])
            return point, float(tree.distance[point])
        rim, far = self._across(seeds, end)
        total = tree.distance[rim] + far
        return int(rim[total.argmin()]), float(total.min())

    def path(self, seeds: SnappedSeeds, start: str, end: str) -> IntArray | None:
        """See `Ways`."""
        last, _ = self._last(seeds, start, end)
        walk = self._tree(seeds, start).to(last)
        if walk is None:
            return None
        inner = self._cavity.ids[walk[1:]]
        ends = ([seeds.ids[start]], inner, [seeds.ids[end]] if end in seeds.hole else [])
        return np.concatenate(ends).astype(np.int64)

    def distance(self, seeds: SnappedSeeds, start: str, end: str) -> float:
        """See `Ways`."""
        return self._last(seeds, start, end)[1]

    def to_outer_rim(self, seeds: SnappedSeeds, start: str) -> float:
        """See `Ways`."""
        return float(self._tree(seeds, start).distance[self._cavity.outer].min())


def connect_seeds(
    cavity: Cavity, seeds: SnappedSeeds, anatomy: Anatomy, ways: Ways, check_axes: bool = True
) -> SeedPaths:
    """Join the seeds by paths, and find the feet of the paths on the rims.

    Parameters
    ----------
    check_axes : whether the seeds must lie as the patient axes of the surface say (`seeds.check_directions`).

    Raises
    ------
    SeedError : mirrored anatomy, seeds that contradict the patient axes, or paths that leave a rim in another order
        than the anatomy says: seeds swapped or moved on.
    """
    result = _connect(cavity, seeds, anatomy, ways)
    _check_not_mirrored(result, anatomy)
    if check_axes:
        check_directions(seeds.positions, cavity.closed.space, anatomy)
    if _misplaced(result, anatomy):
        _explain(cavity, seeds, anatomy, ways, result)
    _check_rotation(seeds, anatomy, ways)
    return replace(result, notes=_far_seeds(seeds, anatomy, ways))


def _connect(cavity: Cavity, seeds: SnappedSeeds, anatomy: Anatomy, ways: Ways) -> SeedPaths:
    number = cavity.number
    loops = {hole: cavity.rims[seeds.hole[hole]][::-1] for hole in anatomy.holes}
    loops[anatomy.outer] = cavity.outer
    feet: dict[str, dict[str, int]] = {opening: {} for opening in anatomy.openings}
    paths = {}
    lengths = {}
    for name, (a, b) in anatomy.paths.items():
        forward = a in seeds.hole
        start, end = (a, b) if forward else (b, a)
        ids = ways.path(seeds, start, end)
        if ids is None:
            raise SurfaceError(f"No path {name} from {a} to {b} on the surface: it is not connected.")
        lengths[name] = ways.distance(seeds, start, end)
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


def _check_not_mirrored(paths: SeedPaths, anatomy: Anatomy) -> None:
    """Raise SeedError if every rim with three or more feet runs the wrong way."""
    if _out_of_order(paths, anatomy) and not _out_of_order(paths, anatomy, -1):
        raise SeedError(
            "The anatomy is mirrored: seen from outside, the seeds run round every opening the wrong way. Either the "
            "surface was flipped (an image with a mirrored axis), or labels are exchanged (left with right, or "
            "superior with inferior). Check which side is the patient's left.",
            anatomy.seeds,
        )


def _explain(cavity: Cavity, seeds: SnappedSeeds, anatomy: Anatomy, ways: Ways, paths: SeedPaths) -> None:
    """Raise the SeedError that tells swapped from merely misplaced seeds.

    Paths that only touch on a coarse mesh, with every rim in order, are no error here.
    """
    wrong = _out_of_order(paths, anatomy)
    kinds = (anatomy.holes, tuple(sorted(anatomy.outer_seeds)))
    candidates = []
    for a, b in (pair for kind in kinds for pair in combinations(kind, 2)):
        renamed = seeds.renamed({a: b, b: a})
        attempt = _connect(cavity, renamed, anatomy, ways)
        if not _misplaced(attempt, anatomy) and _shift(renamed, anatomy, ways)[0] == 0:
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


def _check_rotation(seeds: SnappedSeeds, anatomy: Anatomy, ways: Ways) -> None:
    """Raise SeedError if the outer seeds, all moved on by one or more places, would give much shorter paths."""
    shift, now, best = _shift(seeds, anatomy, ways)
    if shift:
        order = tuple(anatomy.outer_seeds)
        renames = ", ".join(f"{order[(k + shift) % len(order)]} as {order[k]}" for k in range(len(order)))
        raise SeedError(
            f"The seeds on the {anatomy.outer} rim look moved on by {shift} place{'s' if shift > 1 else ''}: the paths "
            f"to them are {now:.0f} mm long together, {best:.0f} mm with {renames}.",
            order,
        )


def _far_seeds(seeds: SnappedSeeds, anatomy: Anatomy, ways: Ways) -> tuple[str, ...]:
    """A note for each outer seed that is much farther from its hole than the outer rim is."""
    notes = []
    for seed, path in zip(anatomy.outer_seeds, anatomy.outer_paths, strict=True):
        hole = next(end for end in anatomy.paths[path] if end in anatomy.holes)
        length, shortest = ways.distance(seeds, hole, seed), ways.to_outer_rim(seeds, hole)
        if length > FAR_SEED * shortest:
            notes.append(
                f"{seed} is {length:.0f} mm from {hole}, whose shortest way to the {anatomy.outer} rim is "
                f"{shortest:.0f} mm. Check {seed}."
            )
    return tuple(notes)


def _shift(seeds: SnappedSeeds, anatomy: Anatomy, ways: Ways) -> tuple[int, float, float]:
    """By how many places the outer seeds look moved on; length of the paths to them as they are, and then, mm."""
    order = tuple(anatomy.outer_seeds)
    holes = [next(seed for seed in anatomy.paths[path] if seed in anatomy.holes) for path in anatomy.outer_paths]
    lengths = [
        sum(ways.distance(seeds, hole, order[(k + shift) % len(order)]) for k, hole in enumerate(holes))
        for shift in range(len(order))
    ]
    if not lengths or lengths[0] <= ROTATED * min(lengths):
        return 0, 0.0, 0.0
    return int(np.argmin(lengths)), lengths[0], min(lengths)


def path_length(surface: Surface, ids: IntArray) -> float:
    """Length of a line of point ids, mm."""
    return float(np.linalg.norm(np.diff(surface.points[ids], axis=0), axis=1).sum())
