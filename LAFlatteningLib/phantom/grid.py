"""The voxel grid round a phantom, and how an image is filled on it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
import SimpleITK as sitk
from numpy.typing import ArrayLike, DTypeLike, NDArray

from ..errors import LAFlatteningError

FloatArray = NDArray[np.float64]

VOXELS_AT_ONCE = 500_000
"""An image is filled in pieces of about so many voxels, to bound memory."""


class Bounded(Protocol):
    """What a grid is laid round; `LAFlatteningLib.phantom.PhantomShape` is one."""

    def extent(self, axes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest coordinate of the closed surface along each of the unit vectors `axes` (k, 3), mm."""


class Grid(NamedTuple):
    """Sample points of an image."""

    size: NDArray[np.int64]
    spacing: FloatArray
    axes: FloatArray
    """(3, 3) row k is the direction of index k."""
    corner: FloatArray
    """(3,) coordinates of the first voxel along `axes`."""

    @classmethod
    def around(cls, shape: Bounded, spacing: Sequence[float], direction: ArrayLike | None, margin: float) -> Grid:
        """The grid that holds a shape and a margin round it, mm.

        Raises
        ------
        LAFlatteningError : spacing, direction or margin out of range.
        """
        steps = _check_spacing(spacing)
        axes = _check_direction(direction).T
        if not (np.isfinite(margin) and margin >= 0.0):
            raise LAFlatteningError(f"Expected a margin of 0 mm or more, found {margin}.")
        low, high = shape.extent(axes)
        size = np.ceil((high - low + 2.0 * margin) / steps).astype(np.int64) + 1
        return cls(size, steps, axes, 0.5 * (low + high) - 0.5 * (size - 1) * steps)

    @property
    def array_shape(self) -> tuple[int, int, int]:
        """Of the array of voxels: slices, rows, columns."""
        columns, rows, slices = (int(n) for n in self.size)
        return slices, rows, columns

    def fill(self, value: Callable[[FloatArray], NDArray], dtype: DTypeLike) -> NDArray:
        """Values of a function of points (n, 3) in SimpleITK's array order (slices, rows, columns)."""
        columns, rows, slices = (
            (self.corner[k] + np.arange(self.size[k]) * self.spacing[k])[:, None] * self.axes[k] for k in range(3)
        )
        plane = (rows[:, None] + columns[None, :]).reshape(-1, 3)
        values = np.empty(self.array_shape, dtype)
        together = max(1, VOXELS_AT_ONCE // len(plane))
        for first in range(0, len(slices), together):
            part = slices[first : first + together]
            points = (part[:, None] + plane[None, :]).reshape(-1, 3)
            values[first : first + together] = value(points).reshape(-1, *values.shape[1:])
        return values

    def image(self, values: NDArray) -> sitk.Image:
        """A SimpleITK image of voxels on this grid, origin and direction in LPS, mm."""
        image = sitk.GetImageFromArray(values)
        image.SetSpacing(self.spacing.tolist())
        image.SetDirection(self.axes.T.ravel().tolist())
        image.SetOrigin((self.corner @ self.axes).tolist())
        return image


def _check_spacing(spacing: Sequence[float]) -> FloatArray:
    values = np.asarray(spacing, np.float64)
    if values.shape != (3,) or not (np.isfinite(values).all() and (values > 0).all()):
        raise LAFlatteningError(
            f"Expected a spacing of three positive numbers in mm, like (0.625, 0.625, 1.25), found {tuple(spacing)}."
        )
    return values


def _check_direction(matrix: ArrayLike | None) -> FloatArray:
    values = np.eye(3) if matrix is None else np.asarray(matrix, np.float64)
    if values.size != 9 or not np.isfinite(values).all():
        raise LAFlatteningError(
            f"Expected a direction matrix of 3 x 3 numbers, found {values.size} values. Columns are the directions of "
            "the image axes in LPS."
        )
    values = values.reshape(3, 3)
    error = np.abs(values.T @ values - np.eye(3)).max()
    if error > 1e-6:
        raise LAFlatteningError(
            "Expected a direction matrix with orthonormal columns (image axes at right angles, of length 1), found a "
            f"deviation of {error:.3g}. Normalise the columns, and put the voxel size into the spacing."
        )
    return values
