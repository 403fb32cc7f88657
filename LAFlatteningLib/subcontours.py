"""The sub-contour rule: feet of the paths on a rim move half-way towards an even spread.

Paper, section II-A2 and algorithm 1, line 6. The paths divide a rim into arcs. With `real` the length of an
arc as the paths cut it, and `proportional` the length it would have if the rim were spread evenly over the
template's circle, the arc gets the length real + (proportional - real)/2. The first foot stays.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

ROUNDINGS = ("paper", "half-even", "half-away")
"""``paper``: every offset rounded down, as printed. ``half-even`` and ``half-away``: the first offset and the
proportional lengths rounded to the nearest integer, halves to even or away from zero; the second offset is
rounded down and counts from the first foot as displaced. Published maps were made with these two."""


def _round_half_away(value: float) -> int:
    return int(math.copysign(math.floor(abs(value) + 0.5), value))


def spread_counts(arcs: Sequence[int], shares: FloatArray, rounding: str) -> list[int]:
    """New numbers of points in the three arcs of a rim (method ``paper``).

    Parameters
    ----------
    arcs : points in each arc as the paths cut it, the first arc after the fixed foot first.
    shares : share of each arc in the template's outline, summing to 1.
    rounding : one of `ROUNDINGS`.

    Returns
    -------
    Points in each arc; at least one each, and as many together as before.
    """
    if rounding not in ROUNDINGS:
        raise ValueError(f'Expected rounding {", ".join(ROUNDINGS)}; found "{rounding}".')
    if len(arcs) != 3:
        raise ValueError(f"The published rule is for three arcs; found {len(arcs)}.")
    total = sum(arcs)
    nearest = _round_half_away if rounding == "half-away" else round
    proportional = [nearest(float(share) * total) for share in shares]
    if rounding == "paper":
        first = math.floor((proportional[0] - arcs[0]) / 2)
        second = math.floor((proportional[1] - arcs[1]) / 2)
    else:
        first = nearest((proportional[0] - arcs[0]) / 2)
        second = math.floor((proportional[1] - (arcs[1] - first)) / 2) - first
    one = max(1, min(arcs[0] + first, total - 2))
    two = max(1, min(arcs[1] + second, total - one - 1))
    return [one, two, total - one - two]


def spread_lengths(arcs: FloatArray, shares: FloatArray) -> FloatArray:
    """New lengths of the arcs of a rim, mm (method ``regional``): the mean of real and proportional length.

    Parameters
    ----------
    arcs : (k,) length of each arc, mm.
    shares : (k,) share of each arc in the template's outline, summing to 1.
    """
    return 0.5 * (arcs + shares * arcs.sum())
