"""Universal atrial coordinates (UAC): two coordinates by Laplace's equation, drawn on the unit square.

x goes from the lateral (0) to the septal wall (1), y from the posterior rim of the valve (0) over the roof (0.5) to its
anterior rim (1). The square is the atrium cut open along a septal line (RSPV to valve) and a lateral line (LSPV to
valve); the roof line (LSPV to RSPV) parts its posterior from its anterior half.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from .. import topology
from ..division import Division, label_regions
from ..errors import SurfaceError
from ..flattening.flat_map import FlatMap
from ..progress import ProgressCallback, report
from ..rim_length import rim_lengths
from ..solvers import harmonic
from ..surface import FloatArray, IntArray, Surface
from ..template import Shape
from .peer_map import PeerMap

SOURCE = (
    "Roney et al., Universal atrial coordinates applied to visualisation, registration and construction of patient "
    "specific meshes, Med. Image Anal. 55, 2019"
)
HOLES: Mapping[str, Shape] = {
    "RIPV": Shape((0.87, 0.315), (0.06, 0.06)),
    "LIPV": Shape((0.13, 0.315), (0.06, 0.06)),
    "LAA": Shape((0.161, 0.865), (0.069, 0.075)),
    "RSPV": Shape((0.885, 0.5), (0.115, 0.11)),
    "LSPV": Shape((0.115, 0.5), (0.115, 0.11)),
}
"""Where the ostia are, read off published coordinates of one atrium. Of the superior veins the ellipse's upper half
bounds the anterior side; their posterior side is the diameter, on the roof line."""
Place = FloatArray | None
SUPERIOR = ("RSPV", "LSPV")
NEEDED = {
    "openings": ("RSPV", "RIPV", "LIPV", "LSPV", "LAA", "MV"),
    "paths": ("s1", "s2", "s3", "s4", "s5", "s6", "s7", "s8", "s9"),
}
"""What of an anatomy the coordinates are made of: they exist for the left atrium only."""


@dataclass(frozen=True, eq=False)
class Lines:
    """The three lines of the coordinates, as point ids of one surface.

    Attributes
    ----------
    roof : from the rim of LSPV to that of RSPV.
    septal : from the rim of RSPV to the valve.
    lateral : from the rim of LSPV to the valve.
    """

    roof: IntArray
    septal: IntArray
    lateral: IntArray


def universal_map(
    flat_map: FlatMap,
    septal_end: Place = None,
    lateral_end: Place = None,
    progress: ProgressCallback | None = None,
) -> PeerMap:
    """The atrium in universal atrial coordinates.

    Parameters
    ----------
    flat_map : our map of the atrium by the method ``regional``, for its paths.
    septal_end, lateral_end : (3,) mm, where these lines reach the valve; by default the points between MV1 and MV2,
        and between MV3 and MV4, that are nearest to where the lines begin.

    Returns
    -------
    PeerMap in the unit square. Its surface is cut along the septal and the lateral line, whose points therefore come
    twice; the copies come after the points of the cavity and of its paths.

    Notes
    -----
    The roof line is our path s4. The septal and the lateral line begin on the rims of RSPV and LSPV where our paths s1
    and s3 leave them, at the carinas, and are the shortest ways along edges within our regions 1 and 3. (So they run in
    published coordinates of one atrium. The source takes geodesics between five landmarks placed by hand.)
    x: Laplace's equation with 0 and 1 on the lateral and the septal line; y: with 0 and 1 on the posterior and the
    anterior rim of the valve and 0.5 on the roof line. Solved twice: first with the rims free (but for what lies on
    the roof's height), then with all rims on `HOLES`: the points of a rim that were farthest to either side come to the
    ends of its ellipse, the others between them by length. Published coordinates of one atrium follow these rules.
    Deviation: published files also hold lines between the ends of the ellipses straight; here they are free.

    Raises
    ------
    SurfaceError : another chamber, another method, or no way for one of the lines.
    Cancelled : by `progress`.
    """
    report(progress, 0.0, "Solving for universal coordinates")
    began = time.perf_counter()
    anatomy, division = flat_map.template.anatomy, flat_map.division
    if not set(NEEDED["openings"]) <= set(anatomy.openings) or not set(NEEDED["paths"]) <= set(anatomy.paths):
        raise SurfaceError(
            f"Universal atrial coordinates need the openings {', '.join(NEEDED['openings'])} of a left atrium; found "
            f"{', '.join(anatomy.openings)}. Leave this map out."
        )
    if flat_map.method != "regional":
        raise SurfaceError("Universal atrial coordinates need paths that do not touch: take a map of method regional.")
    region = label_regions(division, anatomy)
    lateral = _to_valve(division, *division.surface.submesh(region == 3), "LSPV", "s3", lateral_end)
    septal = _to_valve(division, *division.surface.submesh(region == 1), "RSPV", "s1", septal_end)
    lines = Lines(division.paths["s4"], septal, lateral)
    anterior = halves(division.surface, lines, region == 4)
    rims = {opening: division.loops[opening] for opening in anatomy.openings}
    # First with the rims free but for what lies on the roof's height, then with all of them on their ellipses.
    behind = _posterior_sides(division, lines)
    _, places, _ = unit_square(division.surface, anterior, lines, rims["MV"], *behind)
    placed = _all_rims(division, lines, behind, places)
    cut, places, _ = unit_square(division.surface, anterior, lines, rims["MV"], *placed)
    seconds = time.perf_counter() - began + flat_map.seconds["cavity"] + flat_map.seconds["division"]
    report(progress, 1.0, "Solved for universal coordinates")
    return PeerMap(
        "universal",
        "universal atrial coordinates",
        cut,
        places,
        region,
        len(flat_map.surface.points),
        {hole: rims[hole] for hole in anatomy.holes},
        {hole: _centroid(hole) for hole in HOLES},
        seconds,
        SOURCE,
        ("Its lines follow our paths and regions; lines between the ellipses are not held straight.",),
    )


def unit_square(
    surface: Surface,
    anterior: NDArray[np.bool_],
    lines: Lines,
    valve: IntArray,
    held: IntArray,
    held_places: FloatArray,
) -> tuple[Surface, FloatArray, IntArray]:
    """The two coordinates of a surface, once its lines, halves and rims are known.

    Parameters
    ----------
    surface : (n points) the lines run along its edges.
    anterior : (m,) which triangles lie before the roof, septal and lateral line.
    valve : the points of the valve's rim.
    held, held_places : (b,) points of the other rims, or of any line, and (b, 2) their coordinates, NaN for one that
        is free; those on the roof's height have y = 0.5.

    Returns
    -------
    cut : the surface with the points of septal and lateral line doubled: the old ones belong to the posterior half.
    places : (points of `cut`, 2) x and y.
    original : (points of `cut`,) the point of `surface` that each is.

    Source: Roney et al. 2019, with each coordinate harmonic between its values on lines and rims.
    """
    n = len(surface.points)
    # A point on the roof's height is one point of the square; the others of both lines are two.
    doubled = np.setdiff1d(np.concatenate([lines.septal, lines.lateral]), held)
    copy = np.arange(n)
    copy[doubled] = n + np.arange(len(doubled))
    original = np.concatenate([np.arange(n), doubled])
    triangles = np.where(anterior[:, None], copy[surface.triangles], surface.triangles)
    cut = Surface(
        surface.points[original],
        triangles,
        {name: values[original] for name, values in surface.point_data.items()},
        surface.cell_data,
        surface.field_data,
        surface.space,
    )

    def solve(values: FloatArray) -> FloatArray:
        ids = np.flatnonzero(np.isfinite(values))
        return harmonic(cut.laplacian, ids, values[ids, None])[0][:, 0]

    x, y = np.full((2, len(original)), np.nan)
    for line, value in ((lines.lateral, 0.0), (lines.septal, 1.0)):
        x[line] = x[copy[line]] = value
    # The ends of the lines are on both halves of the valve's rim.
    for half, value in ((~anterior, 0.0), (anterior, 1.0)):
        on_valve = np.zeros(len(original), bool)
        on_valve[valve] = on_valve[copy[valve]] = True
        used = np.unique(triangles[half])
        y[used[on_valve[used]]] = value
    y[lines.roof] = 0.5
    for values, given in ((x, held_places[:, 0]), (y, held_places[:, 1])):
        values[held[np.isfinite(given)]] = given[np.isfinite(given)]
    return cut, np.stack([solve(x), solve(y)], axis=1), original


def _to_valve(division: Division, part: Surface, ids: IntArray, hole: str, carina: str, end: Place) -> IntArray:
    """Shortest way along edges to the valve within one region, from the rim of a superior vein at the carina.

    Parameters
    ----------
    part, ids : the triangles of the region, and the ids of its points in `Division.surface`.
    carina : the path at whose foot on the rim the line begins, or at the next point of the rim from which there is a
        way.
    end : (3,) mm near its end, or None for the nearest point of the valve.
    """
    # The line may not touch paths and other rims, and has but its ends on the two rims that it joins.
    taken, on_rim = np.zeros((2, len(division.surface.points)), bool)
    for path in division.paths.values():
        taken[path] = True
    for opening, loop in division.loops.items():
        (on_rim if opening in (hole, "MV") else taken)[loop] = True
    foot = next(int(point) for point in division.paths[carina][[0, -1]] if point in division.loops[hole])
    taken[foot] = False
    number = np.full(len(taken), -1, np.int64)
    number[ids] = np.arange(len(ids))
    along = np.roll(division.loops[hole], -int(np.flatnonzero(division.loops[hole] == foot)[0]))
    steps = np.minimum(np.arange(len(along)), len(along) - np.arange(len(along)))
    nearest_first = along[np.argsort(steps, kind="stable")]
    starts = number[nearest_first[(number[nearest_first] >= 0) & ~taken[nearest_first]]]
    valve = number[division.loops["MV"]]
    ends = valve[(valve >= 0) & ~taken[division.loops["MV"]]]
    if end is not None and len(ends):
        ends = ends[[np.linalg.norm(part.points[ends] - np.asarray(end, np.float64), axis=1).argmin()]]
    graph = part.edge_graph.tocoo()
    a, b = ids[graph.row], ids[graph.col]
    free = ~taken[a] & ~taken[b] & ~(on_rim[a] & on_rim[b])
    graph = sparse.coo_matrix((graph.data[free], (graph.row[free], graph.col[free])), graph.shape).tocsr()
    if len(starts) and len(ends):
        # Points of the rims end a way; they are no part of one.
        distance, before, _ = dijkstra(graph, indices=ends, min_only=True, return_predecessors=True)
        for start in starts[np.isfinite(distance[starts])]:
            way = [int(start)]
            while before[way[-1]] >= 0:
                way.append(int(before[way[-1]]))
            if not on_rim[ids[way[1:-1]]].any():
                return ids[way]
    raise SurfaceError(
        f"There is no way from {hole} to the valve for a line of the universal coordinates: the wall between the "
        "openings there is a few triangles wide. Check the seeds on the valve, or take a finer mesh."
    )


def halves(surface: Surface, lines: Lines, surely_anterior: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(m,) which triangles lie before the three lines: the piece with most of some triangles (m,) that surely do."""
    edges, n = surface.edges, len(surface.points)
    pairs = np.concatenate(
        [np.stack([line[:-1], line[1:]], axis=1) for line in (lines.roof, lines.septal, lines.lateral)]
    )
    blocked = np.isin(edges.points[:, 0] * n + edges.points[:, 1], pairs.min(axis=1) * n + pairs.max(axis=1))
    piece = topology.triangle_components(surface.triangles, edges, blocked)
    return np.asarray(piece == np.bincount(piece[surely_anterior]).argmax())


def _posterior_sides(division: Division, lines: Lines) -> tuple[IntArray, FloatArray]:
    """The sides of RSPV and LSPV behind the roof, ends included, and their places: on the diameter, by length."""
    ids, places = [], []
    for hole in SUPERIOR:
        loop, turn = division.loops[hole], _turn(division, lines, hole)
        along, shape = rim_lengths(division.surface.points[loop]), HOLES[hole]
        # Counter-clockwise from the roof line, the rim of RSPV is first behind it, that of LSPV first before it.
        part = slice(0, turn + 1) if hole == "RSPV" else slice(turn, len(along))
        share = (along[part] - along[part][0]) / (along[part][-1] - along[part][0])
        x = shape.centre[0] + shape.semi_axes[0] * (2.0 * share - 1.0)
        ids.append(np.append(loop, loop[0])[part])
        places.append(np.stack([x, np.full(len(x), shape.centre[1])], axis=1))
    return np.concatenate(ids), np.concatenate(places)


def _turn(division: Division, lines: Lines, hole: str) -> int:
    """Where in the loop of a superior vein, which begins at the roof line, its other line meets it."""
    foot = lines.septal[0] if hole == "RSPV" else lines.lateral[0]
    return int(np.flatnonzero(division.loops[hole] == foot)[0])


def _all_rims(
    division: Division, lines: Lines, behind: tuple[IntArray, FloatArray], before: FloatArray
) -> tuple[IntArray, FloatArray]:
    """All rims but the valve's, and their places, given where points lay before (k, 2)."""
    ids, places = [behind[0]], [behind[1]]
    for hole, shape in HOLES.items():
        loop = division.loops[hole]
        if hole in SUPERIOR:
            # Upper half: the ends are on the roof's height, the top is where the rim lay highest.
            turn = _turn(division, lines, hole)
            closed = np.append(loop, loop[0])
            part = np.arange(turn, len(closed)) if hole == "RSPV" else np.arange(turn + 1)
            top = int(before[closed[part[1:-1]], 1].argmax()) + 1 if len(part) > 2 else 0
            knots, angles = ([0, top, len(part) - 1], [0.0, 90.0, 180.0]) if top else ([0, len(part) - 1], [0.0, 180.0])
            along = rim_lengths(division.surface.points[loop])[part]
            own = shape.at(_quarters(along, knots, angles, shape))[1:-1]
            ids.append(closed[part][1:-1])
        else:
            own = _round_ellipse(division.surface.points[loop], before[loop], shape)
            ids.append(loop)
        places.append(own)
    return np.concatenate(ids), np.concatenate(places)


def _quarters(along: FloatArray, knots: list[int], angles: list[float], shape: Shape) -> FloatArray:
    """Angles on an ellipse of points at lengths (k,) along a rim: between points that have theirs, by length."""
    angle = np.empty(len(along))
    for (a, b), (start, end) in zip(pairwise(knots), pairwise(angles), strict=True):
        share = (along[a : b + 1] - along[a]) / (along[b] - along[a])
        angle[a : b + 1] = shape.angle_at(start, end, share)
    return angle


def _round_ellipse(rim: FloatArray, before: FloatArray, shape: Shape) -> FloatArray:
    """Places (k, 2) on an ellipse of a rim (k, 3): the points that lay farthest right, up, left and down `before`
    (k, 2) come to its four ends, the others between them by length. Where those four do not follow each other, all
    points go by length, turned to where they lay."""
    n = len(rim)
    ends = [before[:, 0].argmax(), before[:, 1].argmax(), before[:, 0].argmin(), before[:, 1].argmin()]
    first = int(ends[0])
    lengths = rim_lengths(np.roll(rim, -first, axis=0))
    knots = [*((int(end) - first) % n for end in ends), n]
    if all(a < b for a, b in pairwise(knots)):
        angle = _quarters(lengths, knots, [0.0, 90.0, 180.0, 270.0, 360.0], shape)[:-1]
    else:
        angle = shape.angle_at(0.0, 360.0, lengths[:-1] / lengths[-1])
        away = (np.roll(before, -first, axis=0) - before.mean(axis=0)) / np.asarray(shape.semi_axes)
        seen = np.arctan2(away[:, 1], away[:, 0])
        angle = angle + np.rad2deg(np.angle(np.exp(1j * (seen - np.deg2rad(angle))).sum()))
    return np.roll(shape.at(angle), first, axis=0)


def _centroid(hole: str) -> FloatArray:
    """Centre of the hole on the square: of the half ellipse for the superior veins."""
    shape = HOLES[hole]
    up = 4.0 * shape.semi_axes[1] / (3.0 * np.pi) if hole in SUPERIOR else 0.0
    return np.array([shape.centre[0], shape.centre[1] + up])
