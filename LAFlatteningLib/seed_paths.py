"""Paths between the seeds, where they leave the rims, and whether the seeds can be right."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Protocol

import numpy as np

from .anatomy import Anatomy
from .cavity.openings import Cavity
from .errors import SeedError, SurfaceError
from .geodesic_lines import Line
from .geodesics import PathTree
from .rim_length import rim_lengths
from .seeds import SnappedSeeds, check_directions
from .surface import FloatArray, IntArray

ROTATED = 1.15
"""Outer seeds are taken for moved on along the rim if all of them, moved on, would have paths shorter by this factor.
(Seeds of experts never do; moved on by one place, their paths get longer by 1.2 at least.)"""
SAME_FOOT = 1e-6
"""Feet nearer to each other than this, in steps from point to point of the rim, are one."""
FAR_SEED = 1.25
"""An outer seed whose path is longer than the shortest way to the rim by this factor makes a note (experts': 1.08)."""
CLOSE = 0.025
"""Two outer seeds nearer to each other than this share of the rim (3 mm) make a note (experts': .1 or more)."""


Feet = tuple[tuple[int, int, float], tuple[int, int, float]]


@dataclass(frozen=True, eq=False)
class Walk:
    """A way from one seed to another.

    Attributes
    ----------
    length : mm.
    feet : where it leaves the rim at its first and its last seed: two neighbouring points of the rim (ids of the
        cavity) and the share of the way from one to the other; or one point, twice, and 0.
    positions : (k, 3) mm, from seed to seed.
    ids : for ways along edges: point ids in `Cavity.closed`.
    line, strip : for ways across triangles: the part over the cavity from foot to foot, and the half-edges it crosses.
    mean_feet : for ways across triangles: where ways that are about as short leave the rims in the mean.
    """

    length: float
    feet: Feet
    positions: FloatArray
    ids: IntArray | None = None
    line: Line | None = None
    strip: tuple[int, ...] = ()
    mean_feet: Feet | None = None

    def reversed(self) -> Walk:
        """The same way from its last seed to its first; `line` and `strip` stay as they are."""
        ids = None if self.ids is None else self.ids[::-1]
        mean = None if self.mean_feet is None else self.mean_feet[::-1]
        return replace(self, feet=self.feet[::-1], positions=self.positions[::-1], ids=ids, mean_feet=mean)


@dataclass(frozen=True, eq=False)
class SeedPaths:
    """Shortest paths between seeds.

    Attributes
    ----------
    walks : path -> the way from the first seed to the second.
    loops : opening -> its rim as ids of the cavity, counter-clockwise on the map; landmark -> its point.
    feet : opening or landmark -> path -> where the path leaves the cover (or where the seed is, on the outer rim):
        index in the loop, plus the share of the way to its next point.
    mean_feet : likewise, where ways that are about as short leave it in the mean.
    notes : what is unusual about the seeds.
    """

    walks: Mapping[str, Walk]
    loops: Mapping[str, IntArray]
    feet: Mapping[str, Mapping[str, float]]
    mean_feet: Mapping[str, Mapping[str, float]]
    notes: tuple[str, ...] = ()

    @property
    def lengths(self) -> dict[str, float]:
        """Path -> its length, mm."""
        return {name: walk.length for name, walk in self.walks.items()}


class Ways(Protocol):
    """A way of going from the seed of a hole, or from a landmark, to other seeds."""

    def walk(self, seeds: SnappedSeeds, start: str, end: str) -> Walk | None:
        """The shortest way from a seed that is not on the outer rim to another one; None if there is no way."""

    def crossing(self, walks: Mapping[str, Walk]) -> set[frozenset[str]]:
        """The pairs of walks that cross."""

    def distance(self, seeds: SnappedSeeds, start: str, end: str) -> float:
        """Length of the shortest path along edges from one seed to the other, mm."""

    def to_outer_rim(self, seeds: SnappedSeeds, start: str) -> float:
        """Length of the shortest path to any point of the outer rim, mm."""


class WaysOverCovers:
    """Shortest paths along the edges of the closed surface, covers included: as published.

    Where a path leaves an ostium depends on the triangles of its cover.
    """

    def __init__(self, cavity: Cavity) -> None:
        self._cavity = cavity
        self._graph = cavity.closed.edge_graph
        self._outer = cavity.ids[cavity.outer]
        self._trees: dict[int, PathTree] = {}

    def _tree(self, seeds: SnappedSeeds, start: str) -> PathTree:
        source = seeds.ids[start]
        if source not in self._trees:
            self._trees[source] = PathTree(self._graph, source)
        return self._trees[source]

    def walk(self, seeds: SnappedSeeds, start: str, end: str) -> Walk | None:
        """See `Ways`."""
        ids = self._tree(seeds, start).to(seeds.ids[end])
        if ids is None:
            return None
        on_cavity = self._cavity.number[ids]
        feet = [int(on_cavity[np.argmax(on_cavity >= 0)]), int(on_cavity[::-1][np.argmax(on_cavity[::-1] >= 0)])]
        return Walk(
            self.distance(seeds, start, end),
            ((feet[0], feet[0], 0.0), (feet[1], feet[1], 0.0)),
            self._cavity.closed.points[ids],
            ids,
        )

    def crossing(self, walks: Mapping[str, Walk]) -> set[frozenset[str]]:
        """See `Ways`."""
        ids = {name: set(walk.ids.tolist()) for name, walk in walks.items() if walk.ids is not None}
        return {frozenset((a, b)) for a, b in combinations(ids, 2) if ids[a] & ids[b]}

    def distance(self, seeds: SnappedSeeds, start: str, end: str) -> float:
        """See `Ways`."""
        return float(self._tree(seeds, start).distance[seeds.ids[end]])

    def to_outer_rim(self, seeds: SnappedSeeds, start: str) -> float:
        """See `Ways`."""
        return float(self._tree(seeds, start).distance[self._outer].min())


def connect_seeds(
    cavity: Cavity, seeds: SnappedSeeds, anatomy: Anatomy, ways: Ways, check_axes: bool = True
) -> SeedPaths:
    """Join the seeds by paths, and find the feet of the paths on the rims.

    Parameters
    ----------
    check_axes : whether the seeds must lie as the patient axes of the surface say (`seeds.check_directions`), if it
        knows them.

    Raises
    ------
    SeedError : mirrored anatomy, seeds that contradict the patient axes, or paths that leave a rim in another order
        than the anatomy says: seeds swapped or moved on.
    """
    result = _connect(cavity, seeds, anatomy, ways)
    _check_not_mirrored(result, anatomy)
    directions = check_axes and cavity.closed.axes_known
    if directions:
        check_directions(seeds.positions, cavity.closed.space, anatomy)
    if _misplaced(result, anatomy, ways):
        _explain(cavity, seeds, anatomy, ways, result)
    _check_rotation(seeds, anatomy, ways)
    if not directions:
        _check_round_faces(cavity, seeds, anatomy, ways)
    return replace(result, notes=(*_far_seeds(seeds, anatomy, ways), *_close_seeds(cavity, seeds, anatomy)))


def _connect(cavity: Cavity, seeds: SnappedSeeds, anatomy: Anatomy, ways: Ways) -> SeedPaths:
    loops = {hole: cavity.rims[seeds.hole[hole]][::-1] for hole in anatomy.holes}
    loops[anatomy.outer] = cavity.outer
    # A landmark is like a rim of one point.
    loops.update({label: np.array([point], np.int64) for label, point in seeds.landmark.items()})
    feet: dict[str, dict[str, float]] = {opening: {} for opening in loops}
    mean_feet: dict[str, dict[str, float]] = {opening: {} for opening in loops}
    walks = {}
    for name, (a, b) in anatomy.paths.items():
        forward = a not in anatomy.outer_seeds
        walk = ways.walk(seeds, a, b) if forward else ways.walk(seeds, b, a)
        if walk is None:
            raise SurfaceError(f"No path {name} from {a} to {b} on the surface: it is not connected.")
        walks[name] = walk if forward else walk.reversed()
        for seed, foot, mean in zip((a, b), walks[name].feet, walks[name].mean_feet or walks[name].feet, strict=True):
            opening = anatomy.opening_of(seed)
            at, mean_at = _coordinate(loops[opening], *foot), _coordinate(loops[opening], *mean)
            if at is None or mean_at is None:
                raise SurfaceError(
                    f"Path {name} does not leave {opening} through its rim; check the cover of {opening}."
                )
            feet[opening][name], mean_feet[opening][name] = at, mean_at
    return SeedPaths(walks, loops, feet, mean_feet)


def _coordinate(loop: IntArray, a: int, b: int, share: float) -> float | None:
    """Index in a loop plus share of the way to the next point, for a place between two of its points."""
    index = np.flatnonzero(loop == a)
    if not len(index):
        return None
    if share == 0.0:
        return float(index[0])
    if loop[(index[0] + 1) % len(loop)] == b:
        return float(index[0]) + share
    return float((index[0] - 1) % len(loop)) + 1.0 - share


def _out_of_order(paths: SeedPaths, anatomy: Anatomy, step: int = 1) -> list[str]:
    """The openings whose feet do not follow each other as in the anatomy (with step -1: in its mirror image)."""
    wrong = []
    for opening in anatomy.openings:
        order = anatomy.feet(opening)[::step]
        n = len(paths.loops[opening])
        at = [paths.feet[opening][name] for name in order]
        # Two paths may share a foot: an angle of 0 between them is allowed, once round is not.
        steps = ((after - before) % n for before, after in zip(at, at[1:] + at[:1], strict=True))
        if sum(step for step in steps if step < n - SAME_FOOT) > 1.5 * n:
            wrong.append(opening)
    return wrong


def _crossings(paths: SeedPaths, anatomy: Anatomy, ways: Ways) -> list[frozenset[str]]:
    """Pairs of paths without a common seed that cross."""
    return [
        pair
        for pair in ways.crossing(paths.walks)
        if not set.intersection(*(set(anatomy.paths[name]) for name in pair))
    ]


def _misplaced(paths: SeedPaths, anatomy: Anatomy, ways: Ways) -> bool:
    return bool(_out_of_order(paths, anatomy)) or bool(_crossings(paths, anatomy, ways))


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
    kinds = (anatomy.holes, tuple(anatomy.landmarks), tuple(sorted(anatomy.outer_seeds)))
    candidates = []
    for a, b in (pair for kind in kinds for pair in combinations(kind, 2)):
        renamed = seeds.renamed({a: b, b: a})
        attempt = _connect(cavity, renamed, anatomy, ways)
        if (
            not _misplaced(attempt, anatomy, ways)
            and _shift(renamed, anatomy, ways)[0] == 0
            and not _shorter_round_faces(renamed, anatomy, ways)
        ):
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
            tuple(label for label in anatomy.seeds if label in labels),
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


def _check_round_faces(cavity: Cavity, seeds: SnappedSeeds, anatomy: Anatomy, ways: Ways) -> None:
    """Raise SeedError if seeds of holes, moved on round the region between them, stay in order and have shorter paths.

    Where the patient axes are known, they have told that already.
    """
    for length, names in _shorter_round_faces(seeds, anatomy, ways):
        renamed = seeds.renamed(names)
        attempt = _connect(cavity, renamed, anatomy, ways)
        if not _misplaced(attempt, anatomy, ways) and _shift(renamed, anatomy, ways)[0] == 0:
            now = _total(seeds, anatomy, ways)
            renames = ", ".join(f"{old} as {new}" for new, old in names.items())
            raise SeedError(
                f"Seeds {', '.join(names)} look moved on, each to the opening of its neighbour: all paths are "
                f"{now:.0f} mm long together, {length:.0f} mm with {renames}.",
                tuple(names),
            )


def _shorter_round_faces(seeds: SnappedSeeds, anatomy: Anatomy, ways: Ways) -> list[tuple[float, dict[str, str]]]:
    """The ways to move the seeds of holes on round a region between holes that give shorter paths, the shortest first:
    their length, mm, and label -> the label whose place it takes."""
    now, found = _total(seeds, anatomy, ways), []
    for region in anatomy.regions:
        holes = [anatomy.paths[path][end] for path, end in anatomy.face(region)]
        if not set(holes) <= set(anatomy.holes) or len(set(holes)) < len(holes):
            continue
        for step in range(1, len(holes)):
            names = dict(zip(holes, holes[step:] + holes[:step], strict=True))
            length = _total(seeds, anatomy, ways, names)
            if length < now:
                found.append((length, names))
    return sorted(found, key=lambda one: one[0])


def _total(seeds: SnappedSeeds, anatomy: Anatomy, ways: Ways, names: Mapping[str, str] | None = None) -> float:
    """Length of all paths together, along edges, mm; `names`: label -> the label whose place it takes."""
    names = names or {}
    pairs = ((names.get(a, a), names.get(b, b)) for a, b in anatomy.paths.values())
    return sum(ways.distance(seeds, *(pair if pair[0] not in anatomy.outer_seeds else pair[::-1])) for pair in pairs)


def _far_seeds(seeds: SnappedSeeds, anatomy: Anatomy, ways: Ways) -> tuple[str, ...]:
    """A note for each outer seed that is much farther from its hole than the outer rim is."""
    notes = []
    for seed, path in zip(anatomy.outer_seeds, anatomy.outer_paths, strict=True):
        hole = next(end for end in anatomy.paths[path] if end not in anatomy.outer_seeds)
        length, shortest = ways.distance(seeds, hole, seed), ways.to_outer_rim(seeds, hole)
        if length > FAR_SEED * shortest:
            notes.append(
                f"{seed} is {length:.0f} mm from {hole}, whose shortest way to the {anatomy.outer} rim is "
                f"{shortest:.0f} mm. Check {seed}."
            )
    return tuple(notes)


def _close_seeds(cavity: Cavity, seeds: SnappedSeeds, anatomy: Anatomy) -> tuple[str, ...]:
    """A note for each two outer seeds that lie close together: the region between them ends in next to nothing."""
    along = rim_lengths(cavity.surface.points[cavity.outer])
    order = tuple(anatomy.outer_seeds)
    notes = []
    for one, other in zip(order, order[1:] + order[:1], strict=True):
        a, b = (float(np.interp(seeds.outer_at[label], np.arange(len(along)), along)) for label in (one, other))
        apart = min((b - a) % along[-1], (a - b) % along[-1])
        if len(order) > 1 and apart < CLOSE * along[-1]:
            notes.append(
                f"{one} and {other} are {apart:.1f} mm apart along the {anatomy.outer} rim, so that hardly anything is "
                f"left of the wall between them. Check {one} and {other}."
            )
    return tuple(notes)


def _shift(seeds: SnappedSeeds, anatomy: Anatomy, ways: Ways) -> tuple[int, float, float]:
    """By how many places the outer seeds look moved on; length of the paths to them as they are, and then, mm."""
    order = tuple(anatomy.outer_seeds)
    holes = [
        next(seed for seed in anatomy.paths[path] if seed not in anatomy.outer_seeds) for path in anatomy.outer_paths
    ]
    lengths = [
        sum(ways.distance(seeds, hole, order[(k + shift) % len(order)]) for k, hole in enumerate(holes))
        for shift in range(len(order))
    ]
    if not lengths or lengths[0] <= ROTATED * min(lengths):
        return 0, 0.0, 0.0
    return int(np.argmin(lengths)), lengths[0], min(lengths)
