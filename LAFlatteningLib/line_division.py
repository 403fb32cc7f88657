"""The division stated in lengths: paths across triangles, feet anywhere on a rim, none of it tied to the mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from .anatomy import Anatomy
from .division import Division
from .errors import SeedError
from .geodesic_lines import Line, Place, settle, straighten
from .geodesics import PathTree
from .half_edges import HalfEdges, after
from .insertion import Inserted, insert_lines, meeting
from .ostium_ways import rim_place
from .rim_length import rim_lengths
from .seed_paths import SeedPaths
from .subcontours import spread_lengths
from .surface import FloatArray, IntArray, Surface
from .template import Template

DETOUR = 1.5
"""A path that must go this much farther (plus `DETOUR_MM`) to keep clear of the others shows misplaced seeds."""
DETOUR_MM = 5.0
SAME_PLACE = 1e-9
"""Places of a rim nearer to each other than this share of its length are one."""
SMALLEST_ARC = 0.05
"""Feet on the rim of a hole are kept apart by this share of its length."""
CLEARANCE = 0.25
"""Where a path would touch a rim or another path, it keeps this share of the edges there away from it."""
NEAR_POINT = 0.1
"""A path that passes a point of the mesh nearer than this share of an edge is led through it."""


def divide(surface: Surface, mesh: HalfEdges, connected: SeedPaths, template: Template) -> Division:
    """Rims and paths stated in lengths, every path clear of all rims and of the other paths.

    Parameters
    ----------
    surface : the cavity (`Cavity.surface`, or the same points with some edges flipped).
    mesh : its half-edges, smoothed or not (`ostium_ways.WaysAcrossOstia`): paths are shortest on these.
    connected : the seeds joined by ways across the triangles of this surface (`ostium_ways.WaysAcrossOstia`).

    Raises
    ------
    SeedError : if a path has to go far out of its way, or cannot pass at all.
    """
    anatomy = template.anatomy
    rims = {o: _Rim(surface, mesh, connected.loops[o], o == anatomy.outer) for o in anatomy.openings}
    feet = {o: _feet(rims[o], connected, template, o) for o in anatomy.openings}
    feet = _untwisted(mesh, surface, rims, feet, connected, anatomy)
    landmarks = {name: int(connected.loops[name][0]) for name in anatomy.landmarks}
    lines = {name: _line(mesh, rims, feet, connected, anatomy, name) for name in anatomy.paths}
    lengths = {name: line.length(surface.points) for name, line in lines.items()}
    # The shortest have the least room to give way.
    order = sorted(lines, key=lambda name: lengths[name])
    for name in order:
        _check_detour(name, lengths[name], connected, anatomy, ())
    kept, waiting = _sort_out(surface, {name: lines[name] for name in order}, tuple(landmarks.values()))
    feet_only = {f"{name} {end}": lines[name].place(end) for name in waiting for end in (0, -1)}
    inserted = insert_lines(Inserted.of(surface), {**kept, **feet_only})
    for name in waiting:
        start, stop = (int(inserted.lines[f"{name} {end}"][0]) for end in (0, -1))
        others = [other for other in inserted.lines if other in lines]
        led = _lead_between(inserted, name, start, stop)
        if led is None:
            _refuse(name, anatomy, others)
        inserted = led
        points = inserted.surface.points[inserted.lines[name]]
        _check_detour(name, float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()), connected, anatomy, others)
    paths = {name: inserted.lines[name] for name in anatomy.paths}
    loops, indices = _loops(inserted.surface, anatomy, connected.loops, paths)
    return Division(
        inserted.surface, loops, indices, paths, connected.walks, inserted.parent, connected.notes, landmarks
    )


def _check_detour(name: str, length: float, connected: SeedPaths, anatomy: Anatomy, others: Sequence[str]) -> None:
    direct = connected.walks[name].length
    if length <= DETOUR * direct + DETOUR_MM:
        return
    if others:
        _refuse(name, anatomy, others)
    a, b = anatomy.paths[name]
    raise SeedError(
        f"Path {name} would be {length:.0f} mm long once its ends are spread on the rims of its openings; from seed to "
        f"seed it is {direct:.0f} mm. Check seeds {a} and {b}: each belongs to the middle of its opening.",
        (a, b),
    )


def _refuse(name: str, anatomy: Anatomy, others: Sequence[str]) -> NoReturn:
    a, b = anatomy.paths[name]
    raise SeedError(
        f"Path {name} from {a} to {b} is cut off by a rim or by other paths ({', '.join(others)}). "
        f"Check seeds {a} and {b} and their neighbours.",
        (a, b),
    )


def _loops(
    surface: Surface, anatomy: Anatomy, before: Mapping[str, IntArray], paths: Mapping[str, IntArray]
) -> tuple[dict[str, IntArray], dict[str, IntArray]]:
    """The rims with the feet among their points, counter-clockwise on the map from the first foot; and where in
    each rim its feet are."""
    whole = {int(loop.min()): loop for loop in surface.boundary_loops}
    loops, feet = {}, {}
    for opening in anatomy.openings:
        # New points have higher ids, so that the smallest one is still there.
        loop = whole[int(before[opening].min())]
        if opening != anatomy.outer:
            loop = loop[::-1]
        foot = [
            int(paths[name][0 if anatomy.opening_of(anatomy.paths[name][0]) == opening else -1])
            for name in anatomy.feet(opening)
        ]
        loop = np.roll(loop, -int(np.flatnonzero(loop == foot[0])[0]))
        loops[opening] = loop
        feet[opening] = np.array([np.flatnonzero(loop == point)[0] for point in foot])
    return loops, feet


class _Rim:
    """A rim with its length: coordinates along it are index in the loop plus share of the way to the next point."""

    def __init__(self, surface: Surface, mesh: HalfEdges, loop: IntArray, outer: bool) -> None:
        self.mesh, self.loop, self.outer = mesh, loop, outer
        self._index = np.arange(len(loop) + 1)
        self._at = rim_lengths(surface.points[loop])
        self.length = float(self._at[-1])

    def position(self, coordinate: float) -> float:
        """Length along the rim, mm."""
        return float(np.interp(coordinate, self._index, self._at))

    def ahead(self, a: float, b: float) -> float:
        """The way along the rim from one coordinate to another, mm, less than once round; 0 for one place, whatever
        rounding makes of it."""
        mm = (self.position(b) - self.position(a)) % self.length
        return mm if mm < (1.0 - SAME_PLACE) * self.length else 0.0

    def between(self, a: float, b: float) -> float:
        """The way from one coordinate to another, the shorter way round: mm, positive along the rim."""
        return (self.position(b) - self.position(a) + self.length / 2.0) % self.length - self.length / 2.0

    def coordinate(self, position: float) -> float:
        """The coordinate at a length along the rim, mm; at a point of the rim if it is all but there."""
        at = float(np.interp(position % self.length, self._at, self._index))
        return (round(at) if abs(at - round(at)) < NEAR_POINT / 2 else at) % len(self.loop)

    def place(self, coordinate: float) -> Place:
        """See `ostium_ways.rim_place`."""
        return rim_place(self.mesh, self.loop, coordinate)

    def edge(self, a: int, b: int) -> int:
        """The edge of the rim between two of its points: the index of the first in the loop."""
        i, j = (int(np.flatnonzero(self.loop == point)[0]) for point in (a, b))
        return i if (i + 1) % len(self.loop) == j else j

    def edge_at(self, coordinate: float) -> int:
        """The edge on which the half-edge of `place` lies."""
        place = self.place(coordinate)
        return self.edge(int(self.mesh.origin[place.half_edge]), self.mesh.end(place.half_edge))

    def strip(self, edge: int, last: int, mm: float) -> list[int]:
        """The strip of triangles along the rim from one edge to another.

        Parameters
        ----------
        mm : the way from a place on the first to a place on the second, positive counter-clockwise on the map.
        """
        n = len(self.loop)
        forward = mm % self.length < self.length / 2.0
        strip: list[int] = []
        if forward != ((last - edge) % n <= n // 2) and min((last - edge) % n, (edge - last) % n) <= 1:
            # Two places at one point of the rim, on either side of it.
            forward = not forward
        while edge != last:
            beyond = (edge + 1 if forward else edge - 1) % n
            point = int(self.loop[beyond if forward else edge])
            turned = self.mesh.turn(self._triangle(edge), self._triangle(beyond), point, left=forward != self.outer)
            assert turned is not None
            strip += turned
            edge = beyond
        return strip

    def _triangle(self, edge: int) -> int:
        """The triangle on an edge of the rim, given by the index of its first point in the loop."""
        start = self.loop[edge if self.outer else (edge + 1) % len(self.loop)]
        return int(self.mesh.first[start]) // 3


def _feet(rim: _Rim, connected: SeedPaths, template: Template, opening: str) -> dict[str, float]:
    """Path -> coordinate of its displaced foot on a rim.

    Feet on holes are kept apart, for the seed of a hole may sit so near its rim that all paths leave it at one
    place. Those on the outer rim are seeds and stay where the user put them.
    """
    anatomy = template.anatomy
    order, feet = anatomy.feet(opening), connected.feet[opening]
    mean = connected.mean_feet[opening]
    if opening == anatomy.outer:
        moved = {name: rim.coordinate(rim.position(feet[name])) for name in order}
        # Not onto one point of the rim.
        return moved if len(set(moved.values())) == len(moved) else {name: feet[name] for name in order}
    first = rim.position(mean[order[0]])
    along = np.array([rim.ahead(mean[order[0]], mean[name]) for name in order])
    if not (np.diff(along) >= 0.0).all():
        # The order round the rim is that of the shortest ways, which has been checked. (Two are always in order.)
        along = np.array(
            [rim.ahead(feet[order[0]], feet[name]) + rim.between(feet[name], mean[name]) for name in order]
        )
        along -= along[0]
    if template.rim(opening).spread_feet:
        arcs = np.diff(np.append(along, rim.length))
        along = np.append(0.0, np.cumsum(spread_lengths(arcs, template.rim(opening).shares(order)))[:-1])
    along = _apart(along, rim.length, SMALLEST_ARC * rim.length)
    return {name: rim.coordinate(first + mm) for name, mm in zip(order, along.tolist(), strict=True)}


def _apart(along: FloatArray, total: float, least: float) -> FloatArray:
    """Feet (increasing from 0 on a rim of some length, mm) moved as little as needed to be `least` apart."""
    along = along.copy()
    for k in range(1, len(along)):
        along[k] = max(along[k], along[k - 1] + least)
    along[-1] = min(along[-1], total - least)
    for k in range(len(along) - 2, 0, -1):
        along[k] = min(along[k], along[k + 1] - least)
    return along


def _untwisted(
    mesh: HalfEdges,
    surface: Surface,
    rims: Mapping[str, _Rim],
    feet: dict[str, dict[str, float]],
    connected: SeedPaths,
    anatomy: Anatomy,
) -> dict[str, dict[str, float]]:
    """Feet that fell together on a rim of two, moved apart to the sides on which their paths do not cross.

    With two feet, their order round the rim does not say which comes first.
    """
    for opening in anatomy.holes:
        order, rim = anatomy.feet(opening), rims[opening]
        if len(order) != 2:
            continue
        first, second = (rim.position(connected.mean_feet[opening][name]) for name in order)
        gap, least = (second - first) % rim.length, SMALLEST_ARC * rim.length
        if least <= gap <= rim.length - least:
            continue
        options = []
        for mm in (least, -least):
            ends = {order[0]: feet[opening][order[0]], order[1]: rim.coordinate(first + mm)}
            lines = {name: _line(mesh, rims, {**feet, opening: ends}, connected, anatomy, name) for name in order}
            length = sum(line.length(surface.points) for line in lines.values())
            options.append((bool(meeting(surface, lines)), length, ends))
        feet = {**feet, opening: min(options, key=lambda option: option[:2])[2]}
    return feet


def _line(
    mesh: HalfEdges,
    rims: Mapping[str, _Rim],
    feet: Mapping[str, Mapping[str, float]],
    connected: SeedPaths,
    anatomy: Anatomy,
    name: str,
) -> Line:
    """The path between its displaced feet: shortest among the ways past the openings like the one between its seeds."""
    walk = connected.walks[name]
    # The strip of a way leads from a seed that is not on the outer rim, which may be the path's second.
    forward = anatomy.paths[name][0] not in anatomy.outer_seeds
    seeds = anatomy.paths[name] if forward else anatomy.paths[name][::-1]
    a, b = (anatomy.opening_of(seed) for seed in seeds)
    strip = list(walk.strip)
    ends = walk.feet if forward else walk.feet[::-1]
    places: list[Place] = []
    for opening, (one, two, _), leaving in zip((a, b), ends, (True, False), strict=True):
        if opening in anatomy.landmarks:
            places.append(Place(int(mesh.first[one]), 0.0))
            continue
        rim = rims[opening]
        places.append(rim.place(feet[opening][name]))
        moved = rim.position(feet[opening][name]) - rim.position(connected.feet[opening][name])
        before, after = rim.edge(one, two), rim.edge_at(feet[opening][name])
        strip = [*rim.strip(after, before, -moved), *strip] if leaving else [*strip, *rim.strip(before, after, moved)]
    line = straighten(mesh, places[0], places[1], strip, CLEARANCE)
    return line if forward else line.reversed()


def _sort_out(
    surface: Surface, lines: Mapping[str, Line], shared: Sequence[int] = ()
) -> tuple[dict[str, Line], list[str]]:
    """Lines that do not meet, led through points of the mesh that they all but touch; and the names of the others.

    Parameters
    ----------
    shared : the landmarks, where they may meet.
    """
    free = np.ones(len(surface.points), bool)
    free[list(shared)] = False
    for loop in surface.boundary_loops:
        free[loop] = False
    kept: dict[str, Line] = {}
    meets = meeting(surface, lines, shared=shared)
    for name, line in lines.items():
        if not any(frozenset((name, other)) in meets for other in kept):
            settled = settle(line, surface.points, free, NEAR_POINT)
            kept[name] = settled
            free[settled.ends[settled.ends[:, 0] == settled.ends[:, 1], 0]] = False
    # A line may have been led through a point across another one beside it.
    while pairs := meeting(surface, kept, shared=shared):
        for name in set().union(*pairs):
            kept[name] = lines[name]
    return kept, [name for name in lines if name not in kept]


def _lead_between(inserted: Inserted, name: str, start: int, stop: int) -> Inserted | None:
    """The surface with one more path, led between rims and the paths that are there; None if there is no way.

    Parameters
    ----------
    start, stop : feet of the path.
    """
    inserted, taken = _open_channels(inserted)
    surface = inserted.surface
    graph = surface.edge_graph.copy()
    # No way out of a taken point: it can be reached, as the end of the path, but not passed.
    rows = np.repeat(np.arange(len(taken)), np.diff(graph.indptr))
    graph.data[taken[rows] & (rows != start)] = np.inf
    ids = PathTree(graph, start).to(stop)
    if ids is None:
        return None
    mesh = HalfEdges.of(surface)
    mesh.angles[taken] = np.inf
    mesh.twin[np.isin(mesh.edge_keys, inserted.line_keys)] = -1
    for point, neighbour in ((start, int(ids[1])), (stop, int(ids[-2]))):
        _turn_to(mesh, point, neighbour)
    strip = mesh.along(ids.tolist(), None, None)
    line = straighten(mesh, Place(int(mesh.first[start]), 0.0), Place(int(mesh.first[stop]), 0.0), strip, CLEARANCE)
    return insert_lines(inserted, {name: settle(line, surface.points, ~taken, NEAR_POINT)})


def _turn_to(mesh: HalfEdges, point: int, neighbour: int) -> None:
    """Where lines end at a landmark, let `HalfEdges.fan` go over the triangles between the two of them between which a
    neighbour lies."""
    leaving = np.flatnonzero(mesh.origin == point)
    start = next((int(h) for h in leaving if mesh.end(int(h)) == neighbour), None)
    if start is None:
        # Along a rim, against its direction: there is nothing to choose.
        return
    h = start
    while mesh.twin[h] >= 0:
        h = after(int(mesh.twin[h]))
        if h == start:
            break
    mesh.first[point] = h


def _open_channels(inserted: Inserted) -> tuple[Inserted, NDArray[np.bool_]]:
    """The surface with a new point on every edge between two points of rims and paths, and which points are theirs.

    A path can then pass along edges wherever it can pass at all.
    """
    surface = inserted.surface
    taken = np.zeros(len(surface.points), bool)
    for ids in (*surface.boundary_loops, *inserted.lines.values()):
        taken[ids] = True
    opened = inserted.split_edges(inserted.edges_between(taken))
    free = np.zeros(len(opened.surface.points) - len(taken), bool)
    return opened, np.concatenate([taken, free])
