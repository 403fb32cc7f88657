"""An image in space: voxels, and where they lie in the patient."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import SimpleITK as sitk
from numpy.typing import NDArray

from .errors import InputFileError
from .surface import FloatArray

SAMPLES_AT_ONCE = 1 << 13
"""So many at a time stay in the processor's cache, which makes `Volume.sample` three times as fast."""


@dataclass(frozen=True, eq=False)
class Volume:
    """A scalar image or a label map.

    Attributes
    ----------
    values : (slices, rows, columns), indexed [k, j, i] as SimpleITK and Slicer index their arrays.
    spacing : (3,) distance of voxel centres along i, j, k, mm.
    origin : (3,) centre of the first voxel, LPS, mm.
    direction : (3, 3) column a is the direction of index axis a in LPS; orthonormal, left- or right-handed.

    Raises
    ------
    InputFileError : values that are no 3D image, a spacing that is not positive, a direction that is not orthonormal.

    Examples
    --------
    >>> volume = Volume(np.arange(8.0).reshape(2, 2, 2), np.array([1.0, 1, 2]), np.zeros(3), np.eye(3))
    >>> volume.sample(np.array([[0.5, 0.0, 0.0], [0.0, 0.0, 2.0], [9.0, 0.0, 0.0]])).tolist()
    [0.5, 4.0, nan]
    """

    values: NDArray
    spacing: FloatArray
    origin: FloatArray
    direction: FloatArray

    def __post_init__(self) -> None:
        if self.values.ndim != 3 or 0 in self.values.shape:
            raise InputFileError(
                f"Expected a 3D image with one value a voxel, found an array of shape {self.values.shape}."
            )
        if not (np.isfinite(self.spacing).all() and (np.asarray(self.spacing) > 0).all()):
            raise InputFileError(
                f"Expected a voxel spacing of three positive numbers in mm, found {np.asarray(self.spacing).tolist()}."
            )
        error = np.abs(self.direction.T @ self.direction - np.eye(3)).max()
        if not error < 1e-3:
            raise InputFileError(
                "Expected image axes at right angles (an orthonormal direction matrix), found a deviation of "
                f"{error:.3g}. Resample the image onto a grid with right angles."
            )

    @classmethod
    def from_image(cls, image: sitk.Image) -> Volume:
        """A 3D SimpleITK image (LPS); voxels are copied."""
        if image.GetDimension() != 3 or image.GetNumberOfComponentsPerPixel() != 1:
            raise InputFileError(
                "Expected a 3D image with one value a voxel, found "
                f"{image.GetDimension()} dimensions and {image.GetNumberOfComponentsPerPixel()} values a voxel."
            )
        return cls(
            sitk.GetArrayFromImage(image),
            np.array(image.GetSpacing()),
            np.array(image.GetOrigin()),
            np.array(image.GetDirection()).reshape(3, 3),
        )

    def to_image(self) -> sitk.Image:
        """A SimpleITK image with a copy of the voxels."""
        image = sitk.GetImageFromArray(self.values)
        image.SetSpacing(self.spacing.tolist())
        image.SetOrigin(self.origin.tolist())
        image.SetDirection(self.direction.reshape(-1).tolist())
        return image

    def check_varied(self) -> None:
        """Raise InputFileError for an image that shows nothing: the same everywhere, or NaN everywhere."""
        first = self.values.flat[0]
        if first != first and np.isnan(self.values).all():
            raise InputFileError(
                "The image has no voxel with a value (all are NaN). Check that it is the right volume."
            )
        if first == first and (self.values == first).all():
            raise InputFileError(
                f"The image is {float(first):g} everywhere; expected one that shows the atrium. Check that it is the "
                "right volume, and that it was exported with its voxels."
            )

    @property
    def voxel_volume(self) -> float:
        """Of one voxel, mm3."""
        return float(np.prod(self.spacing))

    def positions(self, indices: FloatArray) -> FloatArray:
        """Places (n, 3) in LPS, mm, of (fractions of) indices (n, 3) in the order i, j, k."""
        return self.origin + (np.asarray(indices) * self.spacing) @ self.direction.T

    def indices(self, positions: FloatArray) -> FloatArray:
        """The (fractions of) indices (n, 3), in the order i, j, k, of places (n, 3) in LPS, mm."""
        return ((np.asarray(positions) - self.origin) @ self.direction) / self.spacing

    def sample(self, positions: FloatArray, nearest: bool = False) -> FloatArray:
        """Values (n,) at places (n, 3) in LPS, mm: trilinear, or of the nearest voxel; NaN outside the voxel centres.

        Half a voxel beyond the outermost centres counts as outside: nothing is extrapolated.
        """
        positions = np.asarray(positions, np.float64)
        result = np.empty(len(positions))
        voxels = self.values.reshape(-1)
        for first in range(0, len(positions), SAMPLES_AT_ONCE):
            part = slice(first, first + SAMPLES_AT_ONCE)
            result[part] = self._sample(voxels, np.ascontiguousarray(self.indices(positions[part]).T), nearest)
        return result

    def sample_lines(self, starts: FloatArray, directions: FloatArray, along: FloatArray) -> FloatArray:
        """Values (k, n), trilinear, at k distances along n lines from `starts` (n, 3) in `directions` (n, 3), LPS, mm.

        As `sample` at ``starts + along * directions``; quicker, because lines stay lines in the image.
        """
        start = np.ascontiguousarray(self.indices(starts).T)
        step = np.ascontiguousarray(((np.asarray(directions) @ self.direction) / self.spacing).T)
        result = np.empty((len(along), len(starts)))
        voxels = self.values.reshape(-1)
        for first in range(0, len(starts), SAMPLES_AT_ONCE):
            part = slice(first, first + SAMPLES_AT_ONCE)
            for row, distance in zip(result, along, strict=True):
                row[part] = self._sample(voxels, start[:, part] + distance * step[:, part], False)
        return result

    def _sample(self, voxels: NDArray, index: FloatArray, nearest: bool) -> FloatArray:
        """Values (n,) of the voxels in one row at (fractions of) indices (3, n) in the order i, j, k."""
        size = np.array(self.values.shape[::-1])[:, None]
        # Rounding must not push a place on the border outside.
        inside = np.logical_and.reduce((index >= -1e-6) & (index <= size - 1 + 1e-6))
        index[:, ~inside] = 0.0
        index = np.minimum(np.maximum(index, 0.0), size - 1)
        corner = (index + 0.5 if nearest else index).astype(np.int64)
        if not nearest:
            # The last voxels of a row are reached from the ones before.
            corner = np.minimum(corner, np.maximum(size - 2, 0))
        columns, rows = self.values.shape[2], self.values.shape[1]
        start = (corner[2] * rows + corner[1]) * columns + corner[0]
        if nearest:
            values = voxels.take(start).astype(np.float64)
        else:
            i, j, k = (
                stride if n > 1 else 0 for stride, n in zip((1, columns, rows * columns), size[:, 0], strict=True)
            )
            steps = (0, i, j, j + i, k, k + i, k + j, k + j + i)
            # Of integers, differences would wrap.
            around = [voxels.take(start + step).astype(np.float64) for step in steps]
            # Along i, then j, then k: halves the number of values each time.
            for share in index - corner:
                for low, high in zip(around[::2], around[1::2], strict=True):
                    high -= low
                    high *= share
                    low += high
                around = around[::2]
            values = around[0]
        values[~inside] = np.nan
        return values
