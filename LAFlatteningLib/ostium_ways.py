"""Geodesic lines from the seed of an ostium, straight across the ostium and on over the open cavity."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.ndimage import minimum_filter1d
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from .cavity.openings import Cavity
from .geodesic_lines import Line, Place, make_line, straighten
from .geodesics import PathTree
from .half_edges import HalfEdges, apexes, corner_angles
from .insertion import meeting
from .mean_feet import AS_SHORT, NEGLIGIBLE, mean_foot
from .rim_length import rim_lengths, rim_perimeter
from .seed_paths import Walk
from .seeds import SnappedSeeds
from .smoothing import smoothed_points
from .surface import FloatArray, IntArray, Surface

DETOURS = (0.007, 0.02)
"""Ways along edges that are longer than the shortest by less than these shares are tried as well, if there is a ridge
between them and the line that was found."""
FOOT_DETOUR = 0.04
"""Likewise for ways that leave the rim elsewhere; near a rim, edges mislead more."""
MOST_OTHERS = 3
"""No more other lines than this are tried."""
NEIGHBOURHOOD = 0.08
"""Feet nearer to each other than this share of the rim are not told apart."""
BANDS = 8
"""Slices of the way in which they are looked for."""
APART_MM = 3.0
"""And if they are this far from all lines tried, mm."""
SMOOTHING = 0.01
"""Lines are shortest on the surface smoothed over this share of the square root of its area (about 1 mm)."""


class WaysAcrossOstia:
    """Straight from a seed to its rim, then the shortest way over the open cavity, across its triangles.

    An ostium is nearly flat, so that the straight line is what a path over a perfect cover would be, and the
    triangles of the cover do not matter. In terms of the mesh, every ostium is covered by the cone from its seed,
    and a path is a geodesic line over the two cones at its ends and the cavity between them. No path leads across
    another ostium.

    Trees and lines of seeds that did not move since the last call are kept.

    Parameters
    ----------
    cavity : with its rims.
    surface : the cavity as it is flattened: the same points, some edges flipped
        (default: `Cavity.surface`).
    smoothing : lines are shortest on the surface smoothed over this share of the square root of its area: teeth of
        rims and bumps of the wall, between which lines jump when a seed moves, are gone there. 0: as it is.

    Attributes
    ----------
    surface : as given.
    mesh : the half-edges of the smoothed surface.
    """

    def __init__(self, cavity: Cavity, surface: Surface | None = None, smoothing: float = SMOOTHING) -> None:
        surface = cavity.surface if surface is None else surface
        self._cavity, self.surface = cavity, surface
        if smoothing > 0.0:
            smoothed = smoothed_points(surface, smoothing * float(np.sqrt(surface.area)))
            surface = Surface(smoothed, surface.triangles, space=surface.space)
        self._smooth = surface
        self.mesh = HalfEdges.of(surface)
        n, m = len(surface.points), len(surface.triangles)
        self._fans = [np.stack([np.full(len(rim), n + k), np.roll(rim, -1), rim], axis=1) for k, rim in self._rims()]
        triangles = np.concatenate([surface.triangles, *self._fans])
        # Half-edge 1 of a cone's triangle lies on the rim, 0 and 2 on its neighbours in the cone.
        twin = np.concatenate([self.mesh.twin, np.full(3 * sum(map(len, self._fans)), -1)])
        first = np.concatenate([self.mesh.first, np.zeros(len(cavity.rims), np.int64)])
        self._joined: list[IntArray] = []
        self._cones: list[slice] = []
        start = 3 * m
        for (hole, rim), fan in zip(self._rims(), self._fans, strict=True):
            own = start + 3 * np.arange(len(fan))
            self._joined.append(np.stack([self.mesh.first[rim], own + 1]))
            self._cones.append(slice(start, start + 3 * len(fan)))
            first[n + hole] = start
            twin[own] = np.roll(own, -1) + 2
            twin[own + 2] = np.roll(own, 1)
            start += 3 * len(fan)
        # All cones are there, and closed to walks but for those opened.
        self._covered = HalfEdges(
            np.concatenate([surface.points, np.full((len(cavity.rims), 3), np.nan)]),
            triangles.reshape(-1),
            twin,
            np.concatenate([self.mesh.angles, np.full(len(cavity.rims), np.inf)]),
            first,
        )
        self._unsmoothed = np.concatenate([self.surface.points, np.full((len(cavity.rims), 3), np.nan)])
        # (One array for both.)
        self._covered.apexes = np.append(self.mesh.apexes, np.full(len(twin) - 3 * m, np.nan))
        self.mesh.apexes = self._covered.apexes[: 3 * m]
        self._opened: list[int] = []
        self._rim_angles: dict[int, FloatArray] = {}
        corners = corner_angles(surface.points, surface.triangles)
        self._corner_sums = np.bincount(surface.triangles.reshape(-1), corners, minlength=n)
        self._graph = self.mesh.near_graph()
        # With room for the edges of a seed.
        room = np.zeros(max([2, *map(len, cavity.rims)]))
        self._lengths = np.append(self._graph.data, room)
        self._ends = np.append(self._graph.indices, room.astype(self._graph.indices.dtype))
        self._rim_lengths: dict[int, tuple[FloatArray, float]] = {}
        self._arounds: dict[str, tuple[bytes, IntArray, FloatArray]] = {}
        self._trees: dict[str, tuple[bytes, PathTree]] = {}
        self._walks: dict[tuple[str, str], tuple[bytes, Walk | None]] = {}

    def _rims(self) -> list[tuple[int, IntArray]]:
        return list(enumerate(self._cavity.rims))

    def walk(self, seeds: SnappedSeeds, start: str, end: str) -> Walk | None:
        """See `seed_paths.Ways`."""
        key = self._key(seeds, start) + self._key(seeds, end)
        known = self._walks.get((start, end))
        if known is None or known[0] != key:
            known = key, self._find(seeds, start, end)
            self._walks[start, end] = known
        return known[1]

    def crossing(self, walks: Mapping[str, Walk]) -> set[frozenset[str]]:
        """See `seed_paths.Ways`."""
        lines = {name: walk.line for name, walk in walks.items() if walk.line is not None}
        return meeting(self.surface, lines, touching=False)

    def distance(self, seeds: SnappedSeeds, start: str, end: str) -> float:
        """See `seed_paths.Ways`."""
        return self._last(seeds, start, end)[1]

    def to_outer_rim(self, seeds: SnappedSeeds, start: str) -> float:
        """See `seed_paths.Ways`."""
        return float(self._tree(seeds, start).distance[self._cavity.outer].min())

    def _key(self, seeds: SnappedSeeds, label: str) -> bytes:
        hole = seeds.hole.get(label, -1)
        return seeds.positions[label].tobytes() + hole.to_bytes(4, "little", signed=True)

    def _tree(self, seeds: SnappedSeeds, start: str, limit: float = np.inf) -> PathTree:
        """All shortest ways along edges from a seed: over its cone to its rim, or to both sides on the outer rim.

        Parameters
        ----------
        limit : what is farther than this, mm, may be missing.
        """
        key = self._key(seeds, start)
        if start not in self._trees or self._trees[start][0] != key or self._trees[start][1].limit < limit:
            # The seed is one more node, with edges out to its rim and none back in.
            n = self._graph.shape[0]
            rim, far = self._around(seeds, start)
            stop = self._graph.nnz + len(rim)
            self._lengths[self._graph.nnz : stop], self._ends[self._graph.nnz : stop] = far, rim
            starts = np.append(self._graph.indptr, np.int32(stop))
            extended = sparse.csr_matrix((self._lengths[:stop], self._ends[:stop], starts), shape=(n + 1, n + 1))
            self._trees[start] = key, PathTree(extended, n, limit)
        return self._trees[start][1]

    def _around(self, seeds: SnappedSeeds, label: str) -> tuple[IntArray, FloatArray]:
        """The points of the cavity that can be reached straight from a seed, and how far they are, mm."""
        key = self._key(seeds, label)
        if label not in self._arounds or self._arounds[label][0] != key:
            if label in seeds.hole:
                near = self._cavity.rims[seeds.hole[label]]
            elif label in seeds.landmark:
                near = np.array([seeds.landmark[label]], np.int64)
            else:
                outer = self._cavity.outer
                first = int(seeds.outer_at[label])
                near = outer[[first, (first + 1) % len(outer)]]
            far = np.linalg.norm(self._smooth.points[near] - seeds.positions[label], axis=1)
            self._arounds[label] = key, near, far
        return self._arounds[label][1:]

    def _last(self, seeds: SnappedSeeds, start: str, end: str) -> tuple[int, float]:
        """The last point of the cavity on the edge path from one seed to another, and the length of that path, mm."""
        near, far = self._around(seeds, end)
        total = self._tree(seeds, start).distance[near] + far
        return int(near[total.argmin()]), float(total.min())

    def _mesh_between(self, seeds: SnappedSeeds, start: str, end: str) -> HalfEdges:
        """The cavity with the cones of one or two seeds; valid until the next call."""
        mesh, rims = self._covered, self._cavity.rims
        for hole in self._opened:
            mesh.twin[self._joined[hole]] = -1
            mesh.angles[rims[hole]] = np.inf
        self._opened = [seeds.hole[label] for label in (start, end) if label in seeds.hole]
        for label in (start, end):
            if label in seeds.hole:
                hole = seeds.hole[label]
                self._shape_cone(hole, seeds.positions[label])
                inside, outside = self._joined[hole]
                mesh.twin[inside], mesh.twin[outside] = outside, inside
                mesh.angles[rims[hole]] = self._rim_angles[hole]
        return mesh

    def _shape_cone(self, hole: int, seed: FloatArray) -> None:
        """Put the tip of a cone at a seed."""
        mesh, rim, fan = self._covered, self._cavity.rims[hole], self._fans[hole]
        tip = mesh.points[len(self.surface.points) + hole]
        if not np.array_equal(tip, seed):
            tip[:] = seed
            mesh.apexes[self._cones[hole]] = apexes(mesh.points, fan)
            # Corner 0 of each triangle is the seed, 2 its point on the rim, 1 the next point.
            cone = corner_angles(mesh.points, fan).reshape(-1, 3)
            self._rim_angles[hole] = self._corner_sums[rim] + cone[:, 2] + np.roll(cone[:, 1], 1)

    def _find(self, seeds: SnappedSeeds, start: str, end: str) -> Walk | None:
        last, length = self._last(seeds, start, end)
        if not np.isfinite(length):
            return None
        n, m = len(self.surface.points), len(self.surface.triangles)
        out = self._tree(seeds, start)
        direct = _path(out, last)
        mesh = self._mesh_between(seeds, start, end)
        begin, stop = self._place(seeds, start), self._place(seeds, end)

        def line_along(path: list[int]) -> Line:
            cones = [[n + seeds.hole[label]] if label in seeds.hole else [] for label in (start, end)]
            points = [*cones[0], *self._over_edges(path), *cones[1]]
            strip = mesh.along(points, None, stop.half_edge // 3 if end in seeds.outer_at else None)
            return straighten(mesh, begin, stop, strip)

        best = line_along(direct)
        # (Nothing farther from the end than the detours allow, or without weight in the mean, is looked at; other ways
        # start from the seeds of holes.)
        detour = max(*DETOURS, FOOT_DETOUR) * length
        if start in seeds.hole:
            detour = max(detour, NEGLIGIBLE * self._along(seeds.hole[start])[1])
        back = self._tree(seeds, end, np.inf if end in seeds.hole else length + detour)
        # Along edges, ways look longer than they are, and unevenly so: lines that leave a rim elsewhere, or on either
        # side of the one found, may be shorter.
        tried = [cKDTree(best.positions(mesh.points))]
        # (The last entry of a tree is its seed.)
        valleys = _other_valleys(self._smooth, self._graph, out.distance[:-1], back.distance[:-1], tried[0])
        ways = [(point, [*_path(out, point), *_path(back, point)[-2::-1]]) for point in valleys]
        ways += [(point, _path(back, point)[::-1]) for point in self._other_feet(seeds, start, direct[0], back)]
        ways += [(point, _path(out, point)) for point in self._other_feet(seeds, end, direct[-1], out)]
        for point, way in ways:
            if min(known.query(mesh.points[point])[0] for known in tried) < APART_MM:
                continue
            other = line_along(_without_loops(way))
            tried.append(cKDTree(other.positions(mesh.points)))
            if other.length(mesh.points) < best.length(mesh.points):
                best = other
            if len(tried) > MOST_OTHERS:
                break
        walk = self._walk(seeds, start, end, best, mesh, m)
        means = (self._mean_foot(seeds, start, back), self._mean_foot(seeds, end, out))
        return replace(walk, mean_feet=(means[0] or walk.feet[0], means[1] or walk.feet[1]))

    def _mean_foot(self, seeds: SnappedSeeds, label: str, tree: PathTree) -> tuple[int, int, float] | None:
        """Where ways from a far seed leave the rim round another seed in the mean; None where there is no such rim."""
        if label not in seeds.hole:
            return None
        hole = seeds.hole[label]
        rim, far = self._around(seeds, label)
        at, as_short = self._along(hole)
        mean = mean_foot(at, tree.distance[rim] + far, as_short)
        index, share = divmod(float(np.interp(mean, at, np.arange(len(at)))), 1.0)
        return int(rim[int(index) % len(rim)]), int(rim[(int(index) + 1) % len(rim)]), share

    def _along(self, hole: int) -> tuple[FloatArray, float]:
        """Length along a rim (`rim_length.rim_lengths`), and how much longer ways over it are as short, mm."""
        if hole not in self._rim_lengths:
            points = self.surface.points[self._cavity.rims[hole]]
            self._rim_lengths[hole] = rim_lengths(points), AS_SHORT * rim_perimeter(points)
        return self._rim_lengths[hole]

    def _other_feet(self, seeds: SnappedSeeds, label: str, foot: int, tree: PathTree) -> list[int]:
        """Points of the rim round a seed where the way from a far seed over them is shortest in their neighbourhood,
        and little longer than over the foot that was found."""
        if label not in seeds.hole:
            return []
        rim, far = self._around(seeds, label)
        total = tree.distance[rim] + far
        reach = max(1, round(NEIGHBOURHOOD * len(rim)))
        lowest = minimum_filter1d(total, 2 * reach + 1, mode="wrap")
        index = np.flatnonzero((total == lowest) & (total < (1.0 + FOOT_DETOUR) * total.min()))
        own = int(np.flatnonzero(rim == foot)[0]) if (rim == foot).any() else int(total.argmin())
        return [int(rim[k]) for k in index if min((k - own) % len(rim), (own - k) % len(rim)) > reach]

    def _place(self, seeds: SnappedSeeds, label: str) -> Place:
        if label in seeds.hole:
            return Place(int(self._joined[seeds.hole[label]][1][0]) - 1, 0.0)
        if label in seeds.landmark:
            return Place(int(self.mesh.first[seeds.landmark[label]]), 0.0)
        return rim_place(self.mesh, self._cavity.outer, seeds.outer_at[label])

    def _over_edges(self, path: list[int]) -> list[int]:
        """A path of the graph as a path along mesh edges."""
        result = path[:1]
        for a, b in pairwise(path):
            near = self._neighbours(a)
            if b not in near:
                result.append(min(near & self._neighbours(b)))
            result.append(b)
        return result

    def _neighbours(self, point: int) -> set[int]:
        graph = self.surface.edge_graph
        return set(graph.indices[graph.indptr[point] : graph.indptr[point + 1]].tolist())

    def _walk(self, seeds: SnappedSeeds, start: str, end: str, line: Line, mesh: HalfEdges, m: int) -> Walk:
        """The line with its feet on the rims, and its part over the cavity."""
        strip = np.array(line.strip, np.int64)
        twin = mesh.twin[strip]
        # Out of the first cone for the last time, into the last one for the first time.
        if start in seeds.hole:
            begin = int(np.flatnonzero(strip >= 3 * m)[-1]) + 1
            feet = [(int(twin[begin - 1]), 1.0 - float(line.crossing[begin - 1]))]
        else:
            place = self._place(seeds, start)
            begin, feet = 0, [(place.half_edge, place.share)]
        if end in seeds.hole:
            into = begin + int(np.flatnonzero(twin[begin:] >= 3 * m)[0])
            feet.append((int(strip[into]), float(line.crossing[into])))
        else:
            into = len(strip)
            place = self._place(seeds, end)
            feet.append((place.half_edge, place.share))
        points = self._unsmoothed
        points[len(self.surface.points) :] = mesh.points[len(self.surface.points) :]
        return Walk(
            line.length(points),
            (self._at(*feet[0]), self._at(*feet[1])),
            line.positions(points),
            strip=tuple(strip[begin:into].tolist()),
            line=make_line(self.mesh, Place(*feet[0]), Place(*feet[1]), strip[begin:into], line.crossing[begin:into]),
        )

    def _at(self, half_edge: int, share: float) -> tuple[int, int, float]:
        return int(self.mesh.origin[half_edge]), self.mesh.end(half_edge), share


def _path(tree: PathTree, point: int) -> list[int]:
    """The points of the cavity from the seed of a tree to one of them."""
    ids = tree.to(point)
    assert ids is not None
    return ids[1:].tolist()


def _without_loops(path: list[int]) -> list[int]:
    """A path that comes to no point twice."""
    result: list[int] = []
    for point in path:
        if point in result:
            del result[result.index(point) + 1 :]
        else:
            result.append(point)
    return result


def _other_valleys(
    surface: Surface, graph: sparse.csr_matrix, out: FloatArray, back: FloatArray, line: cKDTree
) -> list[int]:
    """A point in each place, apart from a line, through which ways are little longer and that a ridge parts from it.

    Parameters
    ----------
    graph : edges between the points of the surface.
    out, back : (n,) length of the shortest way along edges to each point from either end, mm.
    line : the line that was found.
    """
    through = out + back
    shortest = through.min()
    near = np.flatnonzero(through < (1.0 + max(DETOURS)) * shortest)
    # Slices across the way: in each, what is not joined to the line lies beyond a ridge or an opening.
    band = np.floor(out[near] / np.maximum(through[near], 1e-12) * BANDS).astype(np.int64)
    between = (band > 0) & (band < BANDS - 1)
    near, band = near[between], band[between]
    apart = np.isinf(line.query(surface.points[near], distance_upper_bound=APART_MM)[0])
    one, other = _edges_among(graph, near, apart)
    same = band[one] == band[other]
    one, other = one[same], other[same]
    found: list[int] = []
    for detour in DETOURS:
        possible = through[near] < (1.0 + detour) * shortest
        if not (possible & apart).any():
            continue
        kept = possible[one] & possible[other]
        to_line = kept & ~apart[other]
        kept &= apart[other]
        starts = np.searchsorted(one[kept], np.arange(len(near) + 1))
        joined = sparse.csr_matrix((np.ones(starts[-1]), other[kept], starts), shape=2 * near.shape)
        # (Every edge is there both ways, so that weak and strong components are the same, and these are found sooner.)
        valley = connected_components(joined, connection="strong")[1]
        for k in np.setdiff1d(valley[possible & apart], valley[one[to_line]]):
            inside = near[valley == k]
            found.append(int(inside[through[inside].argmin()]))
    return sorted(found, key=lambda point: float(through[point]))


def _edges_among(graph: sparse.csr_matrix, points: IntArray, leaving: NDArray[np.bool_]) -> tuple[IntArray, IntArray]:
    """The edges of a graph from some of its points to these and others.

    Parameters
    ----------
    points : the points, all together.
    leaving : those of them from which the edges lead.

    Returns
    -------
    one, other : indices of the ends of each edge among the points, `one` rising.
    """
    number = np.full(graph.shape[0], -1)
    number[points] = np.arange(len(points))
    first, count = graph.indptr[points[leaving]], np.diff(graph.indptr)[points[leaving]]
    one = np.repeat(np.flatnonzero(leaving), count)
    other = number[graph.indices[np.arange(len(one)) + np.repeat(first - np.cumsum(count) + count, count)]]
    return one[other >= 0], other[other >= 0]


def rim_place(mesh: HalfEdges, loop: IntArray, at: float) -> Place:
    """The place on a rim at a coordinate along it: index in the loop plus share of the way to the next point.

    Parameters
    ----------
    loop : the rim as point ids, either way round.
    """
    index = int(np.floor(at)) % len(loop)
    share = float(at - np.floor(at))
    a, b = int(loop[index]), int(loop[(index + 1) % len(loop)])
    forward = int(mesh.first[a])
    if mesh.end(forward) == b:
        return Place(forward, share)
    # Also where the share is too small to make a difference.
    if 1.0 - share == 1.0:
        return Place(forward, 0.0)
    return Place(int(mesh.first[b]), 1.0 - share)
