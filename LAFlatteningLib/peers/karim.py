"""The atrium as a square, after Karim et al.: the valve's rim on the sides, the veins wherever they fall."""

from __future__ import annotations

import time

import numpy as np

from ..flattening.flat_map import FlatMap
from ..progress import ProgressCallback, report
from ..solvers import harmonic
from ..surface import FloatArray
from .peer_map import OuterRim, PeerMap, whole_cavity

SOURCE = (
    "Karim et al., Surface flattening of the human left atrium and proof-of-concept clinical applications, Comput. "
    "Med. Imaging Graph. 38, 2014; as Nunez-Garcia et al. describe it"
)


def square_map(flat_map: FlatMap, progress: ProgressCallback | None = None) -> PeerMap:
    """The atrium, its veins covered, as a square of side 1 about the origin with the valve's rim on its sides.

    Parameters
    ----------
    flat_map : our map of the atrium, for its cavity, covers and seeds.

    Returns
    -------
    PeerMap without fixed places.

    Notes
    -----
    Known of the source here: a square, veins and appendage not placed. Chosen here: the rim of the valve goes round
    the sides in proportion to its length, turned so that its seeds are nearest to their angles in our template; inside,
    the map is harmonic (cotangent weights).

    Raises
    ------
    Cancelled : by `progress`.
    """
    report(progress, 0.0, "Mapping to a square")
    began = time.perf_counter()
    cavity, rim = flat_map.cavity, OuterRim.of(flat_map)
    flat, _ = harmonic(cavity.closed.laplacian, cavity.ids[rim.ids], round_square(rim.turns))
    seconds = time.perf_counter() - began + flat_map.seconds["cavity"]
    report(progress, 1.0, "Mapped to a square")
    return whole_cavity(
        flat_map,
        "square",
        "square (Karim et al.)",
        flat[cavity.ids],
        seconds,
        SOURCE,
        ("Where the corners are on the valve, and the weights inside, are our choice.",),
    )


def round_square(turns: FloatArray) -> FloatArray:
    """Places (k, 2) on the square of side 1 about the origin, walked round counter-clockwise at even speed from the
    middle of the side at x = 0.5; `turns` (k,) may be any number of turns.

    Examples
    --------
    >>> round_square(np.array([0.0, 0.125, 0.25, 1.5])).tolist()
    [[0.5, 0.0], [0.5, 0.5], [0.0, 0.5], [-0.5, 0.0]]
    """
    along = 8.0 * (np.asarray(turns, np.float64) % 1.0)
    knots = np.arange(0.0, 9.0)
    x = np.array([0.5, 0.5, 0.0, -0.5, -0.5, -0.5, 0.0, 0.5, 0.5])
    return np.stack([np.interp(along, knots, x), np.interp((along - 2.0) % 8.0, knots, x)], axis=1)
