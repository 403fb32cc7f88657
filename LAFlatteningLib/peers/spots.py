"""Spots on the atrium, and how many of them are no longer there on a picture of a map."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ..shading import rasterise
from ..surface import FloatArray, IntArray, Surface
from ..textures import circles
from .peer_map import PeerMap

SPOTS = 500
"""As many as in the paper's appendix,"""
POINTS_OF_A_SPOT = 12
"""... but no more than one for so many points of the mesh."""
PIXELS = 256
"""Width of the picture on which spots are looked for, pixels."""
NO_SPOT = 0


def spots_on(surface: Surface, count: int = SPOTS) -> IntArray:
    """The spot that each point lies in, (n,), from 1 on, `NO_SPOT` for none: `textures.circles`.

    Parameters
    ----------
    surface : the open cavity, mm.
    count : number of spots, fewer on coarse meshes (`POINTS_OF_A_SPOT`).

    Raises
    ------
    LAFlatteningError : spots smaller than the triangles, on very uneven meshes.

    Examples
    --------
    >>> from LAFlatteningLib import make_phantom
    >>> int(spots_on(make_phantom(1200).surface).max())
    100
    """
    pattern = circles(surface, min(count, len(surface.points) // POINTS_OF_A_SPOT))
    return np.where(pattern.values > 0.0, pattern.labels, NO_SPOT)


def lost_spots(found: PeerMap, spot: IntArray, pixels: int = PIXELS) -> int:
    """The number of spots that own no pixel of a picture of the map.

    The picture is `pixels` wide along the larger side of the map. A pixel shows the spot of the nearest corner of the
    triangle in it. A method that carries data to a mesh of its own is drawn on that mesh, each point of it with the
    spot of the point of the atrium from which it takes its data.

    Parameters
    ----------
    spot : (points of the cavity,) of `spots_on`.
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
