"""Where ways that are about as short as the shortest leave a rim, in the mean."""

from __future__ import annotations

import numpy as np

from .surface import FloatArray

AS_SHORT = 0.025
"""A way that is longer than the shortest by this share of the opening's perimeter (.6 to 1.4 mm) counts 1/e of it."""
NEGLIGIBLE = 7.0
"""Ways longer by so many times that (less than a thousandth of the weight) count nothing and need not be known."""


def mean_foot(at: FloatArray, lengths: FloatArray, as_short: float) -> float:
    """Mean place on a rim of the ways that leave it at each of its points.

    Parameters
    ----------
    at : (k + 1,) length along the rim from its first point to each point and once round, mm (`rim_length.rim_lengths`).
    lengths : (k,) length of the shortest way through each point of the rim, mm; infinite where it is not known.
    as_short : how much longer ways are that count 1/e of the shortest, mm.

    Returns
    -------
    length along the rim, mm. A way of length L has the weight exp(-(L - shortest) / as_short), less exp(-NEGLIGIBLE),
    down to nothing; the mean is that of the directions of a circle. So it is a continuous function of lengths and rim,
    whichever way is the shortest (but where ways of one weight leave on opposite sides of the rim), and the same
    whether much longer ways are known or not.

    Examples
    --------
    >>> at = np.arange(41.0)
    >>> lengths = 50.0 + np.minimum(abs(at[:-1] - 10.0), abs(at[:-1] - 14.0))
    >>> round(mean_foot(at, lengths, 1.0), 2)
    12.0
    """
    sides = np.diff(at)
    # Half of the two sides at each point: an integral along the rim.
    weights = (sides + np.roll(sides, 1)) * np.maximum(
        np.exp((lengths.min() - lengths) / as_short) - np.exp(-NEGLIGIBLE), 0.0
    )
    mean = np.angle(weights @ np.exp(2j * np.pi * at[:-1] / at[-1])) / (2.0 * np.pi)
    return float(mean % 1.0 * at[-1])
