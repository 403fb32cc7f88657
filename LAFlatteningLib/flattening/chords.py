"""Edges that would have to run across an opening of the map, and how they are taken out of the way."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..errors import FoldError
from ..surface import IntArray, Surface


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
    rim_of = np.full(len(surface.points), -1, np.int64)
    for number, rim in enumerate(rims):
        rim_of[rim] = number
    flipped = 0
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
            p = int(np.setdiff1d(triangles[one], surface.edges.points[chord])[0])
            q = int(np.setdiff1d(triangles[two], surface.edges.points[chord])[0])
            if rim_of[p] >= 0 and rim_of[p] == rim_of[q]:
                continue
            joined = neighbours.indices[neighbours.indptr[p] : neighbours.indptr[p + 1]]
            if q in joined or (min(p, q), max(p, q)) in added:
                continue
            # Turn triangle `one` to (p, a, b) with the chord a-b; the flip gives (p, a, q) and (q, b, p).
            corner = int(np.flatnonzero(triangles[one] == p)[0])
            a, b = int(triangles[one][(corner + 1) % 3]), int(triangles[one][(corner + 2) % 3])
            triangles[one] = (p, a, q)
            triangles[two] = (q, b, p)
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


def _chords(surface: Surface, rim_of: IntArray) -> IntArray:
    """Inner edges with both ends on the same rim."""
    ends = rim_of[surface.edges.points]
    return np.flatnonzero((surface.edges.usage == 2) & (ends[:, 0] >= 0) & (ends[:, 0] == ends[:, 1]))
