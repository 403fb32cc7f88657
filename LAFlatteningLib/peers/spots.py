"""Spots spread over the atrium, and how many of them are no longer there on a picture of a map."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from ..half_edges import HalfEdges
from ..shading import rasterise
from ..surface import FloatArray, IntArray, Surface
from .peer_map import PeerMap

SPOTS = 500
"""As many as in the paper's appendix."""
COVER = 0.25
"""Share of the atrium's area that the spots cover together."""
PIXELS = 256
"""Width of the picture on which spots are looked for, pixels."""
NO_SPOT = -1


def distance_graph(surface: Surface) -> sparse.csr_matrix:
    """(n, n) symmetric sparse lengths, mm, along edges and across pairs of triangles."""
    ends, lengths = HalfEdges.of(surface).diagonals()
    n = len(surface.points)
    across = sparse.coo_matrix((lengths, (ends[:, 0], ends[:, 1])), shape=(n, n))
    return surface.edge_graph + (across + across.T).tocsr()


def spread_spots(surface: Surface, count: int = SPOTS, cover: float = COVER) -> IntArray:
    """The spot that each point lies in, (n,), `NO_SPOT` for none.

    Centres are points of the surface, each the farthest from those before; a spot holds what is nearer to its centre
    than to others and within the radius with which flat circles cover the given share of the area.

    Parameters
    ----------
    surface : the open cavity, mm.
    count : number of spots, at most one a point.

    Examples
    --------
    >>> from LAFlatteningLib import make_phantom
    >>> len(np.unique(spread_spots(make_phantom(1000).surface, 50))) - 1
    50
    """
    graph = distance_graph(surface)
    radius = np.sqrt(cover * surface.area / (count * np.pi))
    used = np.flatnonzero(surface.used_points)
    nearest = np.full(len(surface.points), -1.0)
    nearest[used] = np.inf
    spot = np.full(len(surface.points), NO_SPOT)
    centre = int(used[0])
    for number in range(min(count, len(used))):
        # Nothing farther than the emptiest place can come nearer to the new centre than to an old one.
        distance = dijkstra(graph, indices=centre, limit=float(nearest.max()))
        closer = distance < nearest
        nearest[closer] = distance[closer]
        spot[closer] = number
        centre = int(nearest.argmax())
    spot[nearest > radius] = NO_SPOT
    return spot


def lost_spots(found: PeerMap, spot: IntArray, pixels: int = PIXELS) -> int:
    """The number of spots that own no pixel of a picture of the map.

    The picture is `pixels` wide along the larger side of the map. A pixel shows the spot of the nearest corner of the
    triangle in it. A method that carries data to a mesh of its own is drawn on that mesh, each point of it with the
    spot of the point of the atrium from which it takes its data.

    Parameters
    ----------
    spot : (points of the cavity,) of `spread_spots`.
    """
    if found.resampled is not None:
        flat, triangles, shown = found.resampled.points, found.resampled.triangles, spot[found.resampled.nearest]
    else:
        flat, triangles = found.points, found.triangles
        more = found.surface.points[found.cavity_points :]
        nearest = cKDTree(found.surface.points[: found.cavity_points]).query(more)[1] if len(more) else []
        shown = np.concatenate([spot, spot[nearest]]) if len(more) else spot
    seen = np.unique(_picture(flat, triangles, shown, pixels))
    return int(np.setdiff1d(np.unique(spot[spot != NO_SPOT]), seen).size)


def _picture(flat: FloatArray, triangles: IntArray, shown: IntArray, pixels: int) -> IntArray:
    low, extent = flat.min(axis=0), np.ptp(flat, axis=0)
    pixel = float(extent.max()) / pixels
    rows, columns = (max(1, int(np.ceil(side / pixel))) for side in extent[::-1])
    raster = rasterise(flat, triangles, low[0], low[1], pixel, (rows, columns))
    return raster.nearest(shown.astype(np.float64)).astype(np.int64)
