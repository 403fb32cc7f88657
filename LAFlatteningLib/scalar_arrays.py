"""Scalar arrays of a surface as numbers: at points or in triangles, NaN where there is no value."""

from __future__ import annotations

import numpy as np

from .errors import LAFlatteningError
from .surface import FloatArray, Surface


def scalar_array(surface: Surface, name: str) -> tuple[FloatArray, bool]:
    """The values of a point or cell array as float64, infinite ones as NaN, and whether they are at points.

    Where a point array and a cell array have the name, it is the point array.

    Raises
    ------
    LAFlatteningError : no such array, or not one of single numbers.
    """
    on_points = name in surface.point_data
    arrays = surface.point_data if on_points else surface.cell_data
    if name not in arrays:
        known = sorted({*surface.point_data, *surface.cell_data})
        raise LAFlatteningError(
            f'There is no array "{name}"; found {", ".join(known) or "none"}. Check its name, or project an '
            "image first."
        )
    values = np.asarray(arrays[name])
    if values.dtype.kind not in "fiub" or values.size != len(values):
        raise LAFlatteningError(f'The array "{name}" does not hold single numbers. Choose a scalar array.')
    values = values.reshape(-1).astype(np.float64)
    values[~np.isfinite(values)] = np.nan
    return values, on_points


def corner_values(surface: Surface, name: str) -> FloatArray:
    """The values of a scalar point or cell array at the corners of each triangle, (m, 3).

    Raises
    ------
    LAFlatteningError : no such array, not one of single numbers, or no triangle with a number at each corner.
    """
    values, on_points = scalar_array(surface, name)
    corners = values[surface.triangles] if on_points else np.repeat(values[:, None], 3, axis=1)
    if np.isnan(corners).any(axis=1).all():
        raise LAFlatteningError(
            f'The array "{name}" has no value in any triangle ({np.count_nonzero(np.isfinite(values))} of '
            f"{len(values)} entries are numbers). Check the image or the recording that it comes from."
        )
    return corners


def share_reaching(corners: FloatArray, threshold: float) -> FloatArray:
    """Share of the area of each triangle where a linear quantity is `threshold` or more; (m,), exact.

    Parameters
    ----------
    corners : (m, 3) values at the corners, finite.

    Examples
    --------
    >>> share_reaching(np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 1.0], [2.0, 2.0, 2.0]]), 0.5).tolist()
    [0.25, 0.75, 1.0]
    """
    low, middle, high = np.sort(corners, axis=1).T
    with np.errstate(divide="ignore", invalid="ignore"):
        tip = (high - threshold) ** 2 / ((high - low) * (high - middle))
        rest = 1.0 - (threshold - low) ** 2 / ((high - low) * (middle - low))
    share = np.where(threshold > middle, tip, rest)
    share = np.where(threshold > high, 0.0, share)
    # At the largest value nothing but a line or a point reaches it, unless a whole side or triangle has it.
    share = np.where(threshold == high, np.where(low == high, 1.0, 0.0), share)
    return np.where(threshold <= low, 1.0, share)
