"""The intensity of blood in an image of an atrium, to which that of the wall is compared."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkImagingStencil import vtkImageStencilToImage, vtkPolyDataToImageStencil

from . import topology
from .errors import LAFlatteningError, SurfaceError
from .surface import FloatArray, Surface
from .volume import Volume

DEPTH_MM = 5.0
"""Blood is measured so far away from the wall, which is up to 3 mm thick and blurred by the heart's motion."""
DEPTH_SHARE = 0.5
"""In a small chamber: so large a share of the largest distance from the wall, if that is less."""
FEWEST_VOXELS = 30
"""Fewer voxels give no mean and standard deviation worth the name."""
OUTLIER = 3.0
"""Voxels farther from the median than so many (robust) standard deviations are not blood: valve, noise, a lead."""
LEAST_REACHED, WHOLE = 0.25, 0.95
"""Blood is measured if the image holds so large a share of the chamber; that of a larger share is not mentioned."""
NEGATIVE = 0.01
"""If a larger share of the voxels is negative, intensities were shifted (z-scores), and ratios of them say nothing."""


@dataclass(frozen=True, eq=False)
class BloodPool:
    """Mean and standard deviation of the intensity of blood.

    Attributes
    ----------
    mean, sd : in the units of the image.
    how : where they come from, for people.
    voxels, volume_ml : how much was measured; None for given numbers.
    centre_mm : (3,) centre of the measured region, LPS; None for given numbers.
    depth_mm : least distance of the region from the wall; None where a user chose it.
    shifted : whether intensities of the image were shifted, so that ratios of them mean nothing.
    region : the voxels measured, 1 in a label map; None for given numbers.
    """

    mean: float
    sd: float
    how: str
    voxels: int | None = None
    volume_ml: float | None = None
    centre_mm: FloatArray | None = None
    depth_mm: float | None = None
    shifted: bool = False
    region: Volume | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.mean) and np.isfinite(self.sd) and self.sd >= 0.0):
            raise LAFlatteningError(
                "Expected the blood pool as a mean and a standard deviation of 0 or more, found "
                f"mean {self.mean:g}, standard deviation {self.sd:g}."
            )

    def to_dict(self) -> dict[str, Any]:
        """For JSON (see Docs/formats.md)."""
        return {
            "mean": self.mean,
            "sd": self.sd,
            "how": self.how,
            "voxels": self.voxels,
            "volume_ml": self.volume_ml,
            "centre_mm": None if self.centre_mm is None else [float(x) for x in self.centre_mm],
            "depth_mm": self.depth_mm,
        }


def given_blood_pool(mean: float, sd: float) -> BloodPool:
    """The blood pool from numbers that were measured elsewhere."""
    return BloodPool(float(mean), float(sd), "given as numbers")


def find_blood_pool(surface: Surface, volume: Volume) -> BloodPool:
    """Measure blood inside a chamber, far from its wall.

    The openings of the surface are covered. What counts is the largest connected region of voxels that are farther than
    5 mm inside (in a small chamber: half of the largest distance), without outliers (`OUTLIER`).

    Parameters
    ----------
    surface : the wall, in LPS or RAS as its `space` says.

    Raises
    ------
    InputFileError : the image is the same everywhere.
    LAFlatteningError : hardly any voxel lies inside the surface, or the image reaches less than a quarter of the
        chamber: the image is elsewhere, or too coarse.
    SurfaceError : triangles that cannot be turned the same way.
    """
    if np.ptp(surface.points[surface.used_points], axis=0).min() == 0.0:
        raise SurfaceError("The surface is flat. Expected the atrium in 3D, inside which there is blood.")
    volume.check_varied()
    if not surface.is_oriented:
        surface = surface.with_triangles(topology.orient(surface.triangles, surface.edges))
    points, triangles = surface.capped
    index = volume.indices(points * surface.lps_signs)
    size = np.array(volume.values.shape[::-1])
    # One voxel more on each side, where nothing is inside.
    low = np.maximum(np.floor(index.min(axis=0)).astype(np.int64) - 1, 0)
    high = np.minimum(np.ceil(index.max(axis=0)).astype(np.int64) + 1, size - 1)
    empty = (
        "There is no blood pool: the image has {} voxels inside the surface, away from the wall, expected "
        f"{FEWEST_VOXELS} or more. Check that surface and image belong together, or give the region of the blood "
        "as a label map, or its mean and standard deviation."
    )
    if (high < low).any():
        raise LAFlatteningError(empty.format("no"))
    inside = _voxels_inside(index - low, triangles, high - low + 1)
    reached = float(np.count_nonzero(inside)) * volume.voxel_volume / max(abs(surface.enclosed_volume), 1e-9)
    if reached < LEAST_REACHED:
        raise LAFlatteningError(
            f"The image reaches {100.0 * reached:.0f} % of the chamber, too little to find the blood in it; expected "
            f"{100.0 * LEAST_REACHED:.0f} % or more. Check that surface and image belong together and that the axes of "
            "the surface (LPS or RAS) are right, or give mean and standard deviation of the blood."
        )
    depth = ndimage.distance_transform_edt(np.pad(inside, 1), sampling=volume.spacing[::-1])[1:-1, 1:-1, 1:-1]
    least = min(DEPTH_MM, DEPTH_SHARE * float(depth.max()))
    labels, count = ndimage.label(depth > least)
    if count == 0:
        raise LAFlatteningError(empty.format("no"))
    region = labels == 1 + int(np.argmax(np.bincount(labels.ravel())[1:]))
    values = volume.values[tuple(slice(a, b + 1) for a, b in zip(low[::-1], high[::-1], strict=True))][region]
    if len(values) < FEWEST_VOXELS:
        raise LAFlatteningError(empty.format(len(values)))
    box = Volume(
        region.astype(np.uint8), volume.spacing, volume.positions(low[None].astype(np.float64))[0], volume.direction
    )
    how = f"inside the chamber, more than {least:.1f} mm from its wall"
    if reached < WHOLE:
        how += f", where the image reaches {100.0 * reached:.0f} % of it"
    return _measure(values, box, volume, how, least)


def blood_pool_of_labels(volume: Volume, labels: Volume, label: int | None = None) -> BloodPool:
    """Measure blood in a region that a user drew.

    Parameters
    ----------
    labels : label map; its grid need not be that of the image.
    label : number of the region; default: every number but 0.

    Raises
    ------
    LAFlatteningError : the region is empty, or outside the image.
    """
    chosen = labels.values != 0 if label is None else labels.values == label
    which = "no voxel that is not 0" if label is None else f"no voxel with the number {label}"
    if not chosen.any():
        numbers = ", ".join(f"{number:g}" for number in np.unique(labels.values)[:20])
        raise LAFlatteningError(f"The region of the blood pool is empty: its label map has {which} (found {numbers}).")
    places = labels.positions(np.argwhere(chosen)[:, ::-1].astype(np.float64))
    values = volume.sample(places)
    values = values[np.isfinite(values)]
    if len(values) < FEWEST_VOXELS:
        raise LAFlatteningError(
            f"The region of the blood pool has {np.count_nonzero(chosen)} voxels, of which {len(values)} lie in the "
            f"image; expected {FEWEST_VOXELS} or more. Check that label map and image belong together."
        )
    region = Volume(chosen.astype(np.uint8), labels.spacing, labels.origin, labels.direction)
    return _measure(values, region, volume, "region drawn by the user", None)


def _measure(values: NDArray, region: Volume, volume: Volume, how: str, depth_mm: float | None) -> BloodPool:
    values = values[np.isfinite(values)].astype(np.float64)
    if len(values) < FEWEST_VOXELS:
        raise LAFlatteningError(
            f"The blood pool has {len(values)} voxels with a value; expected {FEWEST_VOXELS} or more. Check the image "
            "there, or give mean and standard deviation of the blood."
        )
    off = np.abs(values - np.median(values))
    # 1.4826 makes the median deviation the standard deviation of a normal distribution.
    spread = 1.4826 * float(np.median(off))
    kept = values[off <= OUTLIER * spread] if spread > 0.0 else values
    return BloodPool(
        float(kept.mean()),
        float(kept.std()),
        how,
        len(kept),
        len(kept) * region.voxel_volume / 1000.0,
        region.positions(np.argwhere(region.values != 0).mean(axis=0)[None, ::-1])[0],
        depth_mm,
        bool(np.count_nonzero(volume.values < 0) > NEGATIVE * volume.values.size),
        region,
    )


def _voxels_inside(index: FloatArray, triangles: NDArray[np.int64], size: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which voxels of a grid have their centre inside a closed surface; (k, j, i).

    Parameters
    ----------
    index : (n, 3) points as fractions of indices i, j, k of the grid, so that directions of the image do not matter.
    size : of the grid, along i, j, k.
    """
    stencil = vtkPolyDataToImageStencil()
    stencil.SetInputData(Surface(index, triangles).to_polydata())
    stencil.SetOutputOrigin(0.0, 0.0, 0.0)
    stencil.SetOutputSpacing(1.0, 1.0, 1.0)
    stencil.SetOutputWholeExtent(*(int(x) for last in size for x in (0, last - 1)))
    image = vtkImageStencilToImage()
    image.SetInputConnection(stencil.GetOutputPort())
    image.SetOutputScalarTypeToUnsignedChar()
    image.SetInsideValue(1)
    image.SetOutsideValue(0)
    image.Update()
    scalars = vtk_to_numpy(image.GetOutput().GetPointData().GetScalars())
    return scalars.reshape(*size[::-1]).astype(bool)
