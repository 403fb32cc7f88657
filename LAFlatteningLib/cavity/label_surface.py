"""From a label map to a smooth surface of the atrium.

The mask is smoothed by the kernel 2G - G*G ("twicing", Tukey 1977) and cut at one half by flying edges. G is a Gaussian
with a standard deviation of `SMOOTHING` times the coarsest voxel spacing, the same in mm along all axes. A plain
Gaussian takes the staircase away but pulls a vein of radius r inwards by sigma^2 / (2 r); twicing cancels this term.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkFiltersCore import vtkFlyingEdges3D

from ..errors import SurfaceError
from ..progress import ProgressCallback, report
from ..surface import Surface
from ..volume import Volume

BoolArray = NDArray[np.bool_]

SMOOTHING = 1.0
"""Standard deviation of the Gaussian, in coarsest voxel spacings."""
MOST_LABELS = 256
"""An image with more different values is taken for an intensity image."""
SECOND_SHARE = 0.2
"""A second piece with more than this share of the first one's volume is no island that may be dropped."""
VOLUME_LIMITS = (10.0, 500.0)
"""Volume of a left atrium with its veins, ml. Adults: 30 to 150, giant atria up to about 400."""

_LEVEL = 0.5


@dataclass(frozen=True, eq=False)
class LabelSurface:
    """The surface of a label, and what was done to get it.

    Attributes
    ----------
    surface : closed, LPS, mm, triangles outward.
    notes : what was left out or changed, a sentence each.
    volume_ml, area_cm2 : of the surface.
    """

    surface: Surface
    notes: tuple[str, ...]
    volume_ml: float
    area_cm2: float


def label_surface(volume: Volume, label: int | None = None, progress: ProgressCallback | None = None) -> LabelSurface:
    """The surface of one label, smooth below the size of a voxel and without shrinking.

    The largest piece is kept; islands are dropped and cavities inside are filled, both noted. A mask that touches the
    border of the image is closed there, and noted. Handles are kept (see `cavity.handles`); where smoothing opens or
    closes one, it is noted.

    Parameters
    ----------
    label : which value; None for the only one that is not zero.

    Raises
    ------
    SurfaceError : an intensity image, no such label, several labels and none chosen, two large pieces, or a volume
        outside `VOLUME_LIMITS`.
    Cancelled : the progress callback answered False.
    """
    report(progress, 0.0, "Reading the label")
    notes: list[str] = []
    mask, corner = _label_mask(volume, label)
    report(progress, 0.2, "Finding pieces")
    mask = _one_piece(mask, volume, notes)
    _note_borders(mask, corner, volume, notes)
    sigma = SMOOTHING * float(volume.spacing.max()) / volume.spacing[::-1]
    pad = np.ceil(4.0 * sigma).astype(int) + 1
    padded = np.pad(mask, [(width, width) for width in pad])
    padded = _without_cavities(padded, volume, notes)
    _check_volume(np.count_nonzero(padded) * volume.voxel_volume / 1000.0, "The label")
    report(progress, 0.4, "Smoothing")
    once = ndimage.gaussian_filter(padded.astype(np.float32), sigma, truncate=4.0)
    field = 2.0 * once - ndimage.gaussian_filter(once, sigma, truncate=4.0)
    # A value on the level itself would make triangles without area.
    field[np.abs(field - _LEVEL) < 1e-3] = _LEVEL + 1e-3
    report(progress, 0.7, "Drawing the surface")
    surface = _contour(field, volume, corner - pad[::-1])
    if surface.component_count > 1:
        largest, _ = surface.submesh(surface.components == 0)
        left = abs(surface.enclosed_volume - largest.enclosed_volume) / 1000.0
        notes.append(
            f"Smoothing parted {surface.component_count - 1} thin piece(s) of {left:.2g} ml from the atrium; left out."
        )
        surface = largest
    expected = _handles_of(padded)
    if surface.genus != expected:
        notes.append(
            f"The label has {expected} handle(s), its smooth surface {surface.genus}: "
            "passages or bridges about a voxel wide were closed or opened by smoothing."
        )
    millilitres = surface.enclosed_volume / 1000.0
    report(progress, 1.0, "Surface of the label")
    return LabelSurface(surface, tuple(notes), millilitres, surface.area / 100.0)


def _box(values: NDArray) -> tuple[slice, ...]:
    """The smallest box that holds everything that is not zero."""
    sides = []
    for axis in range(3):
        line = np.flatnonzero(values.any(axis=tuple(a for a in range(3) if a != axis)))
        sides.append(slice(int(line[0]), int(line[-1]) + 1) if len(line) else slice(0, 0))
    return tuple(sides)


def _label_mask(volume: Volume, label: int | None) -> tuple[BoolArray, NDArray[np.int64]]:
    """The voxels of the label in its box, and the index (i, j, k) where the box begins."""
    box = _box(volume.values)
    values = volume.values[box]
    if values.size == 0:
        raise SurfaceError("The label map is empty: every voxel is 0. Expected the segmentation of a left atrium.")
    found = _labels(values)
    each = volume.voxel_volume / 1000.0
    listed = ", ".join(f"{value} ({count * each:.1f} ml)" for value, count in sorted(found.items())[:20])
    if label is None:
        if len(found) > 1:
            raise SurfaceError(f"The label map holds several labels: {listed}. Say which one is the left atrium.")
        label = next(iter(found))
    if label == 0 or label not in found:
        raise SurfaceError(f"The label map has no label {label}. It holds: {listed}.")
    mask = values == label
    inner = _box(mask)
    corner = np.array([outer.start + part.start for outer, part in zip(box, inner, strict=True)])[::-1]
    return mask[inner], corner


def _labels(values: NDArray) -> dict[int, int]:
    """Label -> number of voxels, without 0; refuses intensity images."""
    # A slice through the middle tells most intensity images at once.
    middle = np.unique(values[len(values) // 2])
    reason = ""
    if values.dtype.kind == "f" and not (np.isfinite(middle).all() and (middle == np.round(middle)).all()):
        reason = "values that are not whole numbers"
    elif len(middle) > MOST_LABELS:
        reason = f"more than {MOST_LABELS} different values"
    else:
        low, high = float(values.min()), float(values.max())
        if not np.isfinite([low, high]).all() or low < 0:
            reason = "values below 0 or not a number"
        elif high < 1 << 20:
            whole = values.astype(np.int64)
            counts = np.bincount(whole.ravel())
            ids = np.flatnonzero(counts)
            if values.dtype.kind == "f" and not (whole == values).all():
                reason = "values that are not whole numbers"
        else:
            ids, counts_of = np.unique(values, return_counts=True)
            if values.dtype.kind == "f" and not (ids == np.round(ids)).all():
                reason = "values that are not whole numbers"
            else:
                return {int(i): int(c) for i, c in zip(ids, counts_of, strict=True) if i != 0}
        if not reason and len(ids) > MOST_LABELS:
            reason = f"more than {MOST_LABELS} different values"
    if reason:
        raise SurfaceError(
            f"Expected a label map (whole numbers, 0 outside), found an image with {reason}: it looks like an "
            "intensity image. Give the segmentation, exported as a label map."
        )
    return {int(i): int(counts[i]) for i in ids if i != 0}


def _one_piece(mask: BoolArray, volume: Volume, notes: list[str]) -> BoolArray:
    pieces, count = ndimage.label(mask)
    if count == 1:
        return mask
    sizes = np.bincount(pieces.ravel())[1:] * volume.voxel_volume / 1000.0
    order = np.argsort(-sizes)
    first, second = sizes[order[:2]]
    if second > SECOND_SHARE * first:
        raise SurfaceError(
            f"The label has two large pieces, of {first:.1f} ml and {second:.1f} ml. Expected one left atrium and at "
            f"most islands below {SECOND_SHARE:.0%} of it. Join the pieces, or give the atrium a label of its own."
        )
    notes.append(f"{count - 1} island(s) with {sizes.sum() - first:.2g} ml in all were left out.")
    return pieces == order[0] + 1


def _without_cavities(padded: BoolArray, volume: Volume, notes: list[str]) -> BoolArray:
    outside, count = ndimage.label(~padded)
    if count == 1:
        return padded
    filled = outside != outside[0, 0, 0]
    added = np.count_nonzero(filled & ~padded) * volume.voxel_volume / 1000.0
    notes.append(f"{count - 1} cavit{'y' if count == 2 else 'ies'} inside with {added:.2g} ml in all filled.")
    return filled


def _note_borders(mask: BoolArray, corner: NDArray[np.int64], volume: Volume, notes: list[str]) -> None:
    names = (("right", "left"), ("anterior", "posterior"), ("inferior", "superior"))
    touched = []
    for axis in range(3):
        size = volume.values.shape[2 - axis]
        sheets = np.moveaxis(mask, 2 - axis, 0)
        towards = volume.direction[:, axis]
        main = int(np.abs(towards).argmax())
        for sheet, at_border, sign in (
            (sheets[0], corner[axis] == 0, -1),
            (sheets[-1], corner[axis] + len(sheets) == size, 1),
        ):
            if at_border and sheet.any():
                touched.append(names[main][int(sign * towards[main] > 0)])
    if touched:
        notes.append(
            f"The label touches the border of the image ({', '.join(touched)}): the surface is closed flat there, "
            "and what lies beyond is missing."
        )


def _check_volume(millilitres: float, what: str) -> None:
    low, high = VOLUME_LIMITS
    if not low <= millilitres <= high:
        raise SurfaceError(
            f"{what} has a volume of {millilitres:.3g} ml, expected {low:g} to {high:g} ml for a left atrium. Check "
            "that it is the right label, that no ventricle is attached, and that the spacing is in mm."
        )


def _handles_of(mask: BoolArray) -> int:
    """Number of handles of a solid of voxels joined by faces, in one piece and without cavities.

    Its Euler characteristic, 1 - handles, is counted on the dual complex: voxels, pairs, squares and cubes of them.
    """
    along = mask[1:] & mask[:-1], mask[:, 1:] & mask[:, :-1], mask[:, :, 1:] & mask[:, :, :-1]
    squares = along[0][:, 1:] & along[0][:, :-1], along[1][:, :, 1:] & along[1][:, :, :-1]
    third = along[2][1:] & along[2][:-1]
    cubes = squares[0][:, :, 1:] & squares[0][:, :, :-1]
    pairs = sum(int(np.count_nonzero(part)) for part in along)
    faces = sum(int(np.count_nonzero(part)) for part in (*squares, third))
    return 1 - (int(np.count_nonzero(mask)) - pairs + faces - int(np.count_nonzero(cubes)))


def _contour(field: NDArray[np.float32], volume: Volume, corner: NDArray[np.int64]) -> Surface:
    image = vtkImageData()
    image.SetDimensions(*field.shape[::-1])
    image.GetPointData().SetScalars(numpy_to_vtk(field.ravel()))
    contour = vtkFlyingEdges3D()
    contour.SetInputData(image)
    contour.SetValue(0, _LEVEL)
    contour.ComputeNormalsOff()
    contour.ComputeGradientsOff()
    contour.ComputeScalarsOff()
    contour.Update()
    output = contour.GetOutput()
    if output.GetNumberOfPolys() == 0:
        raise SurfaceError("The label is too thin for its voxels: nothing is left of it after smoothing.")
    raw = Surface.from_polydata(output)
    surface = Surface(volume.positions(raw.points + corner), raw.triangles)
    return surface if surface.enclosed_volume > 0 else surface.with_triangles(surface.triangles[:, ::-1])
