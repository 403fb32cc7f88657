"""The surface of a label map: smooth below the size of a voxel, unbiased, with the topology of the voxels.

The boundary between voxels inside and outside is triangulated (`vtkFlyingEdges3D` of the mask: every point lies half
way between two voxel centres), then smoothed with a low-pass filter of stated wavelength that does not shrink, while no
point moves farther than a voxel along any axis, and less than half a voxel where the label, or the gap beside it, is
thin. So the staircase goes, also the long terraces where the wall is almost parallel to the slices or was drawn on
every second slice; a vein loses about a twentieth of a voxel of its radius (Docs/benchmarks.md); and no bridge is made
or broken.

Voxels that touch only at an edge or a corner count as separate, as in digital topology (6-connected inside,
18-connected outside).

Sources: Gibson 1998, "Constrained elastic surface nets" (the constraint); Taubin 1995, "A signal processing approach to
fair surface design" (the filter, which does not shrink).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from scipy import ndimage, sparse
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkFiltersCore import vtkFlyingEdges3D
from vtkmodules.vtkFiltersModeling import vtkButterflySubdivisionFilter

from .. import operators
from ..errors import SurfaceError
from ..progress import ProgressCallback, part, report
from ..surface import FloatArray, Surface
from ..volume import Volume

VOLUME_LIMITS_ML = (20.0, 400.0)
"""Plausible volume of a left atrium with the stumps of its veins: a small child's to the most dilated reported."""
SECOND_SHARE = 0.2
"""A second piece larger than this share of the first is not an island but another chamber, or half of this one."""

SMOOTHED_MM = 12.0
"""Wavelength along the surface that the filter halves. Shorter ones go: terraces of slices, noise. Longer ones stay:
the circumference of a vein 8 mm wide (25 mm) loses 0.4 % of its radius."""
FREEDOM = 1.0
"""How far a point may move along each axis, in voxels: a half is the error of the voxels, and as much again that of the
hand or the network that drew the boundary."""
THIN_FREEDOM = 0.4
"""The same on spikes, bridges and gaps at most about `THIN_VOXELS` thick: less than half, so that opposite sides cannot
meet."""
THIN_VOXELS = 4
ROUNDS = 3
"""The filter is applied in so many parts, with the constraint after each."""

NEGLIGIBLE = 1e-4
"""Coefficients of the filter below this are left out: a ten-thousandth of a millimetre for each millimetre smoothed."""
COARSE_MM = 1.2
"""A mesh with longer edges (from large voxels) is refined once, so that facets do not show."""

MOST_LABELS = 8
"""So many labels are listed in a message."""

_FACES = ndimage.generate_binary_structure(3, 1)
_FACES_AND_EDGES = ndimage.generate_binary_structure(3, 2)
_SIDES = (("right", "left"), ("anterior", "posterior"), ("inferior", "superior"))
"""For each axis of LPS: its negative and its positive end."""


@dataclass(frozen=True, eq=False)
class LabelSurface:
    """The closed surface of a label.

    Attributes
    ----------
    surface : LPS, mm, closed, one piece, triangles outward. Its `genus` is that of the voxels.
    notes : what was left out or filled, and what to look at, for the user.
    """

    surface: Surface
    notes: tuple[str, ...]

    @property
    def volume_ml(self) -> float:
        """Inside the surface, ml."""
        return self.surface.enclosed_volume / 1000.0

    @property
    def area_cm2(self) -> float:
        """Of the surface, cm2."""
        return self.surface.area / 100.0


def label_surface(
    volume: Volume, label: int | None = None, progress: ProgressCallback | None = None, axes_known: bool = True
) -> LabelSurface:
    """The surface of a label in a label map of the left atrium.

    The largest piece is kept; islands are dropped and cavities inside filled, with a note. A label that touches the
    border of the image is closed there, with a note.

    Parameters
    ----------
    volume : a label map: whole numbers, 0 outside.
    label : its value; None for the only one there is.
    axes_known : whether the axes of the image are the patient's, so that notes may go by them.

    Raises
    ------
    SurfaceError : no label or several with None, a label that is not there, an intensity image, two large pieces, a
        volume implausible for a left atrium.

    Examples
    --------
    >>> from LAFlatteningLib.phantom import left_atrium_shape, make_label_map
    >>> made = label_surface(Volume.from_image(make_label_map(left_atrium_shape(), (2, 2, 2))))
    >>> made.surface.genus, made.surface.boundary_loops, made.notes
    (0, [], ())
    """
    report(progress, 0.0, "Reading the label map")
    corner, voxels = _cropped(volume.values, np.zeros(3))
    corner, mask = _cropped(voxels == _chosen(voxels, label, volume), corner)
    report(progress, 0.2, "Separating the largest piece")
    mask, island_notes = _largest_piece(mask, volume)
    mask, hollow_notes = _filled(mask, volume)
    notes = island_notes + hollow_notes + _border_notes(mask, corner, volume, axes_known)
    _check_volume(mask.sum() * volume.voxel_volume / 1000.0)
    report(progress, 0.4, "Triangulating the boundary")
    mesh = _boundary(mask)
    thick = _is_thick(mask, mesh.points) & _is_thick(~mask, mesh.points)
    freedom = np.where(thick, FREEDOM, THIN_FREEDOM)
    points = _smoothed(mesh, volume.spacing, freedom, part(progress, 0.5, 1.0))
    surface = Surface(volume.positions(points + corner), mesh.triangles)
    # Rows of voxels may run left-handed in space.
    if operators.signed_volume(surface.points, surface.triangles) < 0.0:
        surface = surface.with_triangles(surface.triangles[:, ::-1])
    if surface.edge_lengths.mean() > COARSE_MM:
        surface = _refined(surface)
    if surface.genus:
        notes.append(
            f"The label has {surface.genus} handle{'s' * (surface.genus > 1)}: places where veins, or a vein and the "
            "appendage, touch. They have to be cut before the surface can be flattened."
        )
    return LabelSurface(surface, tuple(notes))


# ---- the voxels ------------------------------------------------------------------------------------------------------


def _cropped(values: NDArray, corner: FloatArray) -> tuple[FloatArray, NDArray]:
    """The index (i, j, k) of the first voxel of the box round all that is not 0, and the voxels of the box; `corner` is
    the index of the first voxel of `values`."""
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        raise _intensities("some voxels are not a number")
    occupied = values != 0
    rows = occupied.any(axis=2)
    reached = (np.flatnonzero(rows.any(axis=1)), np.flatnonzero(rows.any(axis=0)))
    if len(reached[0]) == 0:
        raise SurfaceError(
            "The label map is empty: every voxel is 0. Expected voxels of the left atrium with a label of 1 or more. "
            "Check that the right file was chosen."
        )
    k, j = (slice(int(at[0]), int(at[-1]) + 1) for at in reached)
    columns = np.flatnonzero(occupied[k, j].any(axis=(0, 1)))
    i = slice(int(columns[0]), int(columns[-1]) + 1)
    return corner + np.array([i.start, j.start, k.start]), values[k, j, i]


def _intensities(found: str) -> SurfaceError:
    return SurfaceError(
        f"This looks like an image, not a label map: {found}. Expected whole numbers, the same all over the left "
        "atrium and 0 outside. Choose the segmentation, or make one (in Slicer: Segment Editor), and export it as a "
        "label map."
    )


def _chosen(voxels: NDArray, label: int | None, volume: Volume) -> int:
    """The value of the label, or why there is none."""
    if voxels.dtype.kind == "f" and not (voxels == np.round(voxels)).all():
        raise _intensities("voxels have fractions")
    if voxels.dtype.kind != "b" and voxels.min() < 0:
        raise _intensities(f"the smallest value is {voxels.min():g}")
    present, counts = _counted(voxels)
    if len(present) > MOST_LABELS:
        # Labels are blocks of equal voxels; intensities change from voxel to voxel.
        pairs = [(voxels[1:], voxels[:-1]), (voxels[:, 1:], voxels[:, :-1]), (voxels[..., 1:], voxels[..., :-1])]
        equal = sum(np.count_nonzero((a == b) & (a != 0)) for a, b in pairs)
        if equal < 0.5 * sum(np.count_nonzero((a != 0) & (b != 0)) for a, b in pairs):
            raise _intensities(f"it has {len(present)} different values, and neighbours mostly differ")
    order = np.argsort(-counts)
    listed = ", ".join(
        f"{int(present[k])} ({counts[k] * volume.voxel_volume / 1000.0:.3g} ml)" for k in order[:MOST_LABELS]
    )
    if len(present) > MOST_LABELS:
        listed += f" and {len(present) - MOST_LABELS} smaller ones"
    if label is None:
        if len(present) > 1:
            raise SurfaceError(
                f"The label map has {len(present)} labels, expected one, or to be told which is the left atrium. "
                f"Choose one of: {listed}."
            )
        return int(present[0])
    if label not in present:
        what = "is the background" if label == 0 else "is not in the label map"
        raise SurfaceError(f"Label {label} {what}. Choose one of: {listed}.")
    return label


def _counted(voxels: NDArray) -> tuple[NDArray, NDArray[np.int64]]:
    """The values of voxels that are not 0, in order, and how many voxels have each."""
    if voxels.dtype.kind in "bui" and voxels.max() < 1 << 16:
        # Slice by slice, because a body in one piece would take gigabytes.
        total = np.zeros(int(voxels.max()) + 1, np.int64)
        for part_of in voxels:
            count = np.bincount(part_of.reshape(-1))
            total[: len(count)] += count
        present = np.flatnonzero(total[1:]) + 1
        return present, total[present]
    return np.unique(voxels[voxels != 0], return_counts=True)


def _border_notes(mask: NDArray[np.bool_], corner: FloatArray, volume: Volume, axes_known: bool) -> list[str]:
    """Which sides of the image the label touches, in the patient's directions if the image knows them."""
    names = []
    for axis in range(3):
        ends = np.moveaxis(mask, 2 - axis, 0)
        along = volume.direction[:, axis]
        patient = int(np.abs(along).argmax())
        size = volume.values.shape[2 - axis]
        if corner[axis] == 0 and ends[0].any():
            names.append(_SIDES[patient][int(along[patient] < 0)])
        if corner[axis] + len(ends) == size and ends[-1].any():
            names.append(_SIDES[patient][int(along[patient] > 0)])
    if not names:
        return []
    which = f"{' and the '.join(names)} border" if axes_known else f"border{'s' * (len(names) > 1)}"
    return [
        f"The label reaches the {which} of the image and was closed there by a flat face; the atrium may be cut off."
    ]


def _largest_piece(mask: NDArray[np.bool_], volume: Volume) -> tuple[NDArray[np.bool_], list[str]]:
    pieces, count = ndimage.label(mask, _FACES)
    if count == 1:
        return mask, []
    sizes = np.bincount(pieces.reshape(-1))[1:]
    largest = int(sizes.argmax())
    ml = sizes * volume.voxel_volume / 1000.0
    second = np.sort(ml)[-2]
    if second > SECOND_SHARE * ml[largest]:
        raise SurfaceError(
            f"The label is in two large pieces, of {ml[largest]:.3g} and {second:.3g} ml, expected one left atrium. "
            "Perhaps both atria have the same label, or the atrium is cut in two. Keep one piece (in Slicer: Segment "
            "Editor, Islands), or join them."
        )
    note = (
        f"{count - 1} loose piece{'s' * (count > 2)} beside the atrium left out "
        f"({ml.sum() - ml[largest]:.2g} ml together, the largest {second:.2g} ml)."
    )
    return pieces == largest + 1, [note]


def _filled(mask: NDArray[np.bool_], volume: Volume) -> tuple[NDArray[np.bool_], list[str]]:
    outside = np.pad(~mask, 1, constant_values=True)
    regions, count = ndimage.label(outside, _FACES_AND_EDGES)
    if count == 1:
        return mask, []
    filled = (regions != regions[0, 0, 0])[1:-1, 1:-1, 1:-1]
    ml = (filled.sum() - mask.sum()) * volume.voxel_volume / 1000.0
    return filled, [f"{count - 1} hollow{'s' * (count > 2)} inside the atrium filled ({ml:.2g} ml)."]


def _check_volume(ml: float) -> None:
    low, high = VOLUME_LIMITS_ML
    if low <= ml <= high:
        return
    reason = (
        "The label may hold more than the left atrium (a ventricle still attached, the whole heart); cut it at the "
        "mitral valve"
        if ml > high
        else "It may be another structure, or only a part of the atrium; choose another label"
    )
    raise SurfaceError(
        f"The label has a volume of {ml:.3g} ml, expected {low:g} to {high:g} ml for a left atrium. {reason}, and "
        "check that the voxel size is in mm."
    )


# ---- the surface -----------------------------------------------------------------------------------------------------


def _boundary(mask: NDArray[np.bool_]) -> Surface:
    """The boundary of the voxels, points in indices (i, j, k) half way between voxel centres."""
    padded = np.pad(mask, 1).astype(np.uint8)
    image = vtkImageData()
    image.SetDimensions(*padded.shape[::-1])
    image.SetOrigin(-1.0, -1.0, -1.0)
    image.GetPointData().SetScalars(numpy_to_vtk(padded.reshape(-1)))
    edges = vtkFlyingEdges3D()
    edges.SetInputData(image)
    edges.SetValue(0, 0.5)
    edges.ComputeNormalsOff()
    edges.ComputeGradientsOff()
    edges.ComputeScalarsOff()
    edges.Update()
    mesh = Surface.from_polydata(edges.GetOutput())
    return Surface(mesh.points.copy(), mesh.triangles.copy())


def _is_thick(region: NDArray[np.bool_], points: FloatArray) -> NDArray[np.bool_]:
    """Whether a region (the label, or what is outside it) is thicker than `THIN_VOXELS` at points (n, 3) of its
    boundary, in indices."""
    depth = THIN_VOXELS // 2
    # Beyond the box the outside goes on; the label touches the box only where it has ended.
    core = ndimage.binary_erosion(region, _FACES, depth, border_value=1)
    # Farther than it was eroded, so that bumps of the boundary are not taken for spikes.
    thick = np.pad(ndimage.binary_dilation(core, _FACES, depth + 3), 1, mode="edge")
    low, high = (edge(points).astype(np.int64).T[::-1] + 1 for edge in (np.floor, np.ceil))
    return thick[tuple(low)] | thick[tuple(high)]


def _smoothed(mesh: Surface, spacing: FloatArray, freedom: FloatArray, progress: ProgressCallback | None) -> FloatArray:
    """Points of the boundary, (n, 3) in indices, smoothed.

    Parameters
    ----------
    freedom : (n,) how far they may move along each axis, in voxels.
    """
    n = len(mesh.points)
    a, b = mesh.edges.points.T
    links = sparse.coo_matrix((np.ones(2 * len(a)), (np.r_[a, b], np.r_[b, a])), shape=(n, n)).tocsr()
    mean = sparse.diags(1.0 / np.asarray(links.sum(axis=1)).reshape(-1)) @ links
    points = mesh.points * spacing
    reach = freedom[:, None] * spacing
    low, high = points - reach, points + reach
    edge = float(np.linalg.norm(points[a] - points[b], axis=1).mean())
    response = _response((np.pi * edge / SMOOTHED_MM) ** 2)
    for k in range(ROUNDS):
        report(progress, k / ROUNDS, "Smoothing the surface")
        points = np.clip(_filtered(mean, points, response), low, high)
    report(progress, 1.0, "Smoothing the surface")
    return points / spacing


def _response(half: float) -> FloatArray:
    """Chebyshev coefficients, in 1 - k, of the response of one round of the filter.

    k is what the umbrella operator (a point minus the mean of its neighbours) makes of a wave: about (wave number x
    edge length / 2)^2, from 0 to 2. All rounds together give ``1 - (1 - exp(-c k^2))^2``: maximally flat at 0 so that
    it does not shrink, without overshoot, and 1/2 at k = `half`.
    """
    c = -np.log(1.0 - np.sqrt(0.5)) / half**2

    # In the angle arccos(1 - k) the response is as narrow as sqrt(2 half): enough terms to resolve that.
    degree = int(np.ceil(12.0 / np.sqrt(min(half, 1.0))))
    at = chebyshev.chebpts1(degree + 1)
    gauss = np.exp(-c * (1.0 - at) ** 2)
    coefficients = chebyshev.chebfit(at, (gauss * (2.0 - gauss)) ** (1.0 / ROUNDS), degree)
    coefficients = coefficients[: int(np.flatnonzero(np.abs(coefficients) > NEGLIGIBLE)[-1]) + 1]
    # Exactly 1 at k = 0: the surface must not move as a whole.
    return coefficients / coefficients.sum()


def _filtered(mean: sparse.csr_matrix, points: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Chebyshev polynomial of the matrix that takes the mean of the neighbours, applied to points."""
    before, now = points, mean @ points
    result = coefficients[0] * before + coefficients[1] * now
    for coefficient in coefficients[2:]:
        before, now = now, 2.0 * (mean @ now) - before
        result += coefficient * now
    return result


def _refined(surface: Surface) -> Surface:
    """Each triangle in four, with new points on a smooth surface through the old ones (butterfly scheme)."""
    subdivide = vtkButterflySubdivisionFilter()
    subdivide.SetInputData(surface.to_polydata())
    subdivide.SetNumberOfSubdivisions(1)
    subdivide.Update()
    mesh = Surface.from_polydata(subdivide.GetOutput())
    return Surface(mesh.points.copy(), mesh.triangles.copy(), space=surface.space)


NOISY_HANDLES = 4
"""Veins touch in a place or two; a label with so many handles is ragged by noise."""


def denoised_label_surface(
    volume: Volume, label: int | None = None, progress: ProgressCallback | None = None, axes_known: bool = True
) -> LabelSurface:
    """As `label_surface`, but a label with `NOISY_HANDLES` or more is smoothed first: the majority of 27 voxels.

    Handles of noise are thinner than a voxel is wide and cannot be cut one by one. A label with fewer stays as it is,
    so that places where veins touch are cut and told one by one (`handles.remove_handles`).
    """
    made = label_surface(volume, label, progress, axes_known)
    if made.surface.genus < NOISY_HANDLES:
        return made
    chosen = volume.values != 0 if label is None else volume.values == label
    majority = ndimage.uniform_filter(chosen.astype(np.float32), 3) > 0.5
    smooth = label_surface(
        Volume(majority.astype(np.uint8), volume.spacing, volume.origin, volume.direction), axes_known=axes_known
    )
    note = (
        f"The label is ragged (its surface would have {made.surface.genus} handles): each voxel took the value of most "
        "of the 27 about it."
    )
    return replace(smooth, notes=(note, *smooth.notes))
