"""Label maps of the phantom, for everything that begins with a segmentation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import SimpleITK as sitk
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import gaussian_filter

from ..errors import LAFlatteningError
from .lge import LgeModel, make_lge_volume
from .shape import PhantomShape

FloatArray = NDArray[np.float64]

NOISE_LENGTH = 1.5
"""Segmentation errors of neighbouring voxels are alike: standard deviation of their Gaussian kernel, voxels."""


@dataclass(frozen=True)
class Bridge:
    """A round bar of lumen between two tubes, as where veins touch and a segmentation runs them together.

    Attributes
    ----------
    first, second : names of tubes.
    width : diameter of the bar, mm.
    height : of its ends beyond the planes of the two rims, on the axes of the tubes, mm.
    """

    first: str
    second: str
    width: float = 3.0
    height: float = 8.0

    def ends(self, shape: PhantomShape) -> FloatArray:
        """Its ends on the axes of the tubes, (2, 3) mm."""
        openings = [shape.openings[name] for name in (self.first, self.second)]
        return np.array([np.array(shape.centre) + (o.rim[1] + self.height) * o.axis for o in openings])

    def place(self, shape: PhantomShape) -> FloatArray:
        """The middle of the bar between the walls of the two tubes, (3,) mm."""
        a, b = self.ends(shape)
        along = (b - a) / np.linalg.norm(b - a)
        leaves = []
        for end, name, way in ((a, self.first, along), (b, self.second, -along)):
            opening = shape.openings[name]
            sine = np.linalg.norm(way - (way @ opening.axis) * opening.axis)
            leaves.append(end + way * opening.rim[0] / sine)
        return 0.5 * (leaves[0] + leaves[1])

    def distance(self, shape: PhantomShape, points: FloatArray) -> FloatArray:
        """Signed distance of points (n, 3) to the bar, (n,) mm, negative inside."""
        a, b = self.ends(shape)
        along = b - a
        share = np.clip((points - a) @ along / (along @ along), 0.0, 1.0)
        return np.linalg.norm(points - a - share[:, None] * along, axis=1) - 0.5 * self.width


@dataclass(frozen=True)
class _Indicator:
    """What `make_lge_volume` paints: the signed distance to the shape in place of its intensity."""

    shape: PhantomShape
    bridges: tuple[Bridge, ...]

    def extent(self, axes: FloatArray) -> tuple[FloatArray, FloatArray]:
        return self.shape.extent(axes)

    def intensity(self, points: FloatArray, model: LgeModel) -> FloatArray:
        distance = self.shape.signed_distance(points)
        for bridge in self.bridges:
            distance = np.minimum(distance, bridge.distance(self.shape, points))
        return distance


def make_label_map(
    shape: PhantomShape,
    spacing: Sequence[float] = (0.625, 0.625, 1.25),
    direction: ArrayLike | None = None,
    noise_voxels: float = 0.0,
    seed: int = 0,
    margin: float = 10.0,
    bridges: Sequence[Bridge] = (),
) -> sitk.Image:
    """A label map of the closed phantom: 1 where the centre of a voxel is inside, else 0.

    Parameters
    ----------
    shape : of the phantom.
    spacing, direction, margin : of the image, see `make_lge_volume`.
    noise_voxels : standard deviation of the boundary's displacement along the normal, in (geometric mean) voxel sizes.
        Neighbouring voxels are displaced alike (`NOISE_LENGTH`), as an observer or a network errs.
    seed : of the noise; the same seed gives the same noise.
    bridges : bars between tubes; each adds a handle to the surface where the tubes do not meet otherwise.

    Returns
    -------
    SimpleITK.Image, uint8, origin and direction in LPS, mm.

    Raises
    ------
    LAFlatteningError : spacing, direction, noise or margin out of range, a bridge between unknown tubes.

    Examples
    --------
    >>> from LAFlatteningLib.phantom import left_atrium_shape
    >>> image = make_label_map(left_atrium_shape(), spacing=(4, 4, 4))
    >>> image.GetPixelIDTypeAsString()
    '8-bit unsigned integer'
    """
    if not (np.isfinite(noise_voxels) and noise_voxels >= 0.0):
        raise LAFlatteningError(f"Expected boundary noise of 0 voxels or more, found {noise_voxels}.")
    for bridge in bridges:
        for name in (bridge.first, bridge.second):
            if name not in shape.tubes:
                raise LAFlatteningError(f'Expected a bridge between two of {", ".join(shape.tubes)}, found "{name}".')
    distances = make_lge_volume(_Indicator(shape, tuple(bridges)), spacing, direction, margin=margin)
    values = sitk.GetArrayFromImage(distances)
    if noise_voxels > 0.0:
        noise = gaussian_filter(np.random.default_rng(seed).normal(size=values.shape), NOISE_LENGTH)
        values += noise * (noise_voxels * float(np.prod(spacing)) ** (1.0 / 3.0) / noise.std())
    image = sitk.GetImageFromArray((values < 0.0).astype(np.uint8))
    image.CopyInformation(distances)
    return image
