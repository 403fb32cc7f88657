"""A label map of the phantom, clean or with the noise of a segmentation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import SimpleITK as sitk
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter

from ..errors import LAFlatteningError
from .grid import FloatArray, Grid
from .shape import PhantomShape

CORRELATION = 2.0
"""Standard deviation of the kernel that correlates the noise of neighbouring voxels, in voxels of mean size.

With it a boundary moved by a voxel (one standard deviation) tilts by about 20 degrees: bumps and dents as where a
hand or a network followed it, no loose dust."""


def make_label_map(
    shape: PhantomShape,
    spacing: Sequence[float] = (0.625, 0.625, 1.25),
    direction: ArrayLike | None = None,
    noise_voxels: float = 0.0,
    seed: int = 0,
    margin: float = 10.0,
) -> sitk.Image:
    """A label map of the closed phantom: 1 where the centre of a voxel is inside, else 0.

    Parameters
    ----------
    shape : the phantom (long veins, appendage, closed valve).
    spacing : of the voxels, mm; the default is that of the 2018 Atrial Segmentation Challenge.
    direction : (3, 3) or 9 numbers row by row: column k is the direction of image axis k, in LPS. Orthonormal, left-
        or right-handed; None for axial slices.
    noise_voxels : standard deviation of the displacement of the boundary, in voxels of mean size (the cube root of a
        voxel's volume). Displacements of neighbouring places are alike (see `CORRELATION`).
    seed : of the noise; the same seed gives the same noise.
    margin : background round the shape, mm.

    Returns
    -------
    SimpleITK.Image, uint8, origin and direction in LPS, mm.

    Raises
    ------
    LAFlatteningError : spacing, direction, noise or margin out of range.

    Examples
    --------
    >>> from LAFlatteningLib.phantom import left_atrium_shape
    >>> image = make_label_map(left_atrium_shape(), spacing=(4, 4, 4))
    >>> image.GetPixelIDTypeAsString()
    '8-bit unsigned integer'
    """
    grid = Grid.around(shape, spacing, direction, margin)
    if not (np.isfinite(noise_voxels) and 0.0 <= noise_voxels <= 5.0):
        raise LAFlatteningError(f"Expected noise between 0 and 5 voxels, found {noise_voxels}.")
    if noise_voxels == 0.0:
        return grid.image(grid.fill(lambda points: shape.signed_distance(points) <= 0.0, np.uint8))
    distance = grid.fill(shape.signed_distance, np.float64)
    distance += noise_voxels * _mean_voxel(grid) * _correlated_noise(grid, seed)
    return grid.image((distance <= 0.0).astype(np.uint8))


def _mean_voxel(grid: Grid) -> float:
    return float(np.cbrt(np.prod(grid.spacing)))


def _correlated_noise(grid: Grid, seed: int) -> FloatArray:
    """A smooth random field of mean 0 and standard deviation 1 on a grid."""
    white = np.random.default_rng(seed).normal(size=grid.array_shape)
    # The same length in mm along every axis; index axes of the array run k, j, i.
    smooth = gaussian_filter(white, CORRELATION * _mean_voxel(grid) / grid.spacing[::-1], mode="wrap")
    return (smooth - smooth.mean()) / smooth.std()
