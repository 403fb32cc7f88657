"""Edges that would have to run across an opening of the map, and how they are taken out of the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .. import operators
from ..constraints import Constraints
from ..division import Division
from ..errors import FoldError
from ..insertion import Inserted
from ..surface import FloatArray, IntArray, Surface


def flip_chords(surface: Surface, rims: Sequence[IntArray]) -> tuple[Surface, int]:
    """The surface with every inner edge that joins two points of one rim flipped.

    Such an edge (the base of an "ear", a triangle with all corners on the rim) becomes a chord of its opening on
    the map. Across a hole, the triangle outside it folds whatever the solver does; at the outer rim, the ear's tip
    has no neighbour inside the surface and no path can leave it. It is replaced by the other diagonal of its two
    triangles. Points, and the number and order of triangles, stay.

    Parameters
    ----------
    rims : rims as ids of the surface.

    Returns
    -------
    surface : the same object if there was nothing to flip.
    flipped : number of flips.

    Raises
    ------
    FoldError : if an edge cannot be flipped because the other diagonal exists already.
    """
    rim_of, flipped = _rim_of(surface, rims), 0
    # Every pass takes the chords whose far corner is off the rim, so chains of ears are undone from inside out;
    # a chain cannot be longer than its rim.
    for _ in range(max((len(rim) for rim in rims), default=0)):
        chords = _chords(surface, rim_of)
        if not len(chords):
            return surface, flipped
        triangles = surface.triangles.copy()
        touched: set[int] = set()
        neighbours = surface.edge_graph
        added: set[tuple[int, int]] = set()
        done = 0
        for chord in chords:
            one, two = (int(t) for t in surface.edges.triangles[chord])
            if one in touched or two in touched:
                continue
            flipped_one, flipped_two = _flipped(surface, chord)
            p, q = int(flipped_one[0]), int(flipped_two[0])
            if rim_of[p] >= 0 and rim_of[p] == rim_of[q]:
                continue
            joined = neighbours.indices[neighbours.indptr[p] : neighbours.indptr[p + 1]]
            if q in joined or (min(p, q), max(p, q)) in added:
                continue
            triangles[one], triangles[two] = flipped_one, flipped_two
            touched.update((one, two))
            added.add((min(p, q), max(p, q)))
            done += 1
        if not done:
            break
        flipped += done
        surface = surface.with_triangles(triangles)
    chords = _chords(surface, rim_of)
    if len(chords):
        a, b = surface.edges.points[chords[0]]
        place = ", ".join(f"{x:.1f}" for x in surface.points[a])
        raise FoldError(
            f"The edge between points {a} and {b} at {place} mm spans an opening and cannot be flipped. "
            "Remove the triangles between that edge and the rim.",
            (int(a), int(b)),
        )
    return surface, flipped


def flip_folded(
    surface: Surface, rims: Sequence[IntArray], division: Division, constraints: Constraints
) -> tuple[Surface, int]:
    """The surface with edges flipped where a triangle has all its corners on rims, and the template folds it.

    That happens between rims that are a triangle apart; whatever the solver does it would stay folded. Of its edges,
    the longest one is flipped whose flip leaves no folded triangle of this kind, and no chord.

    Parameters
    ----------
    rims : rims as ids of the surface.
    division, constraints : of the surface; feet of paths may have cut its triangles.

    Returns
    -------
    surface : the same object if there was nothing to flip, or nothing that helps.
    flipped : number of flips.
    """
    cut = division.surface
    held, placed = np.zeros(len(cut.points), bool), np.zeros((len(cut.points), 2))
    held[constraints.rim_ids], placed[constraints.rim_ids] = True, constraints.rim_targets
    pieces = division.parent[_folded(cut.triangles, held, placed)]
    folded = np.union1d(pieces, np.flatnonzero(_folded(surface.triangles, held, placed)))
    if not len(folded):
        return surface, 0
    rim_of, edges, neighbours = _rim_of(surface, rims), surface.edges, surface.edge_graph
    triangles, flipped = surface.triangles.copy(), 0
    touched: set[int] = set()
    for triangle in folded.tolist():
        around = edges.of_triangle[triangle]
        length = np.linalg.norm(np.diff(surface.points[edges.points[around]], axis=1)[:, 0], axis=1)
        for edge in around[np.argsort(-length)].tolist():
            pair = edges.triangles[edge]
            if edges.usage[edge] != 2 or touched & set(pair.tolist()):
                continue
            new = _flipped(surface, edge)
            p, q = int(new[0][0]), int(new[1][0])
            joined = neighbours.indices[neighbours.indptr[p] : neighbours.indptr[p + 1]]
            if q in joined or rim_of[p] == rim_of[q] >= 0 or _folded(new, held, placed).any():
                continue
            triangles[pair] = new
            touched.update(pair.tolist())
            flipped += 1
            break
    return (surface.with_triangles(triangles), flipped) if flipped else (surface, 0)


def split_crossing(division: Division, constraints: Constraints) -> Division:
    """The division with a point amid every edge between two places of rims and paths that would run across an opening,
    or across a path, on the map.

    Such places lie beside each other on the atrium, but the outline of an opening is in the way on the template: the
    edge is straight there, so that triangles at it fold whatever the solver does. With a free point it can bend. Points
    keep their ids, and rims, paths and their places stay.

    Returns
    -------
    division : the same object if there was nothing to split.
    """
    surface = division.surface
    held, placed = np.zeros(len(surface.points), bool), np.zeros((len(surface.points), 2))
    held[constraints.ids], placed[constraints.ids] = True, constraints.targets
    inserted = Inserted(surface, division.parent, division.paths)
    between = inserted.edges_between(held)
    pieces = np.concatenate(
        [
            *(np.stack([loop, np.roll(loop, -1)], axis=1) for loop in division.loops.values()),
            *(np.stack([path[:-1], path[1:]], axis=1) for path in division.paths.values()),
        ]
    )
    crossing = between[_cross(placed[between], placed[pieces])]
    if not len(crossing):
        return division
    split = inserted.split_edges(crossing)
    return replace(division, surface=split.surface, parent=split.parent)


def _cross(segments: FloatArray, others: FloatArray) -> NDArray[np.bool_]:
    """Which segments (k, 2, 2) cross any of some others (l, 2, 2), not only touch them."""

    def sides(line: FloatArray, points: FloatArray) -> FloatArray:
        """Twice the signed area of each line (..., 2, 2) with both of some points (..., 2, 2)."""
        along, to = line[..., 1:, :] - line[..., :1, :], points - line[..., :1, :]
        return along[..., 0] * to[..., 1] - along[..., 1] * to[..., 0]

    one, other = segments[:, None], others[None]
    return ((sides(one, other).prod(axis=2) < 0.0) & (sides(other, one).prod(axis=2) < 0.0)).any(axis=1)


def _folded(triangles: IntArray, held: NDArray[np.bool_], placed: FloatArray) -> NDArray[np.bool_]:
    """Of which triangles all corners are held, and folded."""
    return held[triangles].all(axis=1) & (operators.signed_areas(placed, triangles) <= 0.0)


def _flipped(surface: Surface, edge: int) -> IntArray:
    """The two triangles (2, 3) that take the place of those at an inner edge a-b, with the other diagonal p-q:
    (p, a, q) and (q, b, p)."""
    one, two = surface.triangles[surface.edges.triangles[edge]]
    ends = surface.edges.points[edge]
    corner = int(np.flatnonzero(~np.isin(one, ends))[0])
    p, a, b = np.roll(one, -corner)
    q = two[~np.isin(two, ends)][0]
    return np.array([(p, a, q), (q, b, p)])


def _rim_of(surface: Surface, rims: Sequence[IntArray]) -> IntArray:
    """The number of the rim of each point, (n,); -1 off the rims."""
    rim_of = np.full(len(surface.points), -1, np.int64)
    for number, rim in enumerate(rims):
        rim_of[rim] = number
    return rim_of


def _chords(surface: Surface, rim_of: IntArray) -> IntArray:
    """Inner edges with both ends on the same rim."""
    ends = rim_of[surface.edges.points]
    return np.flatnonzero((surface.edges.usage == 2) & (ends[:, 0] >= 0) & (ends[:, 0] == ends[:, 1]))
