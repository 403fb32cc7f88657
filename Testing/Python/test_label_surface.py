"""The surface of a label map against the analytic phantom, closed forms, and the topology of the voxels."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import SimpleITK as sitk
from scipy import ndimage

from LAFlatteningLib import operators
from LAFlatteningLib.cavity.label_surface import ROUNDS, _filtered, _response, label_surface
from LAFlatteningLib.errors import Cancelled, LAFlatteningError, SurfaceError
from LAFlatteningLib.files import read_volume
from LAFlatteningLib.phantom import left_atrium_shape, make_label_map, make_lge_volume, mesh_phantom
from LAFlatteningLib.volume import Volume

SHAPE = left_atrium_shape()
MRI = (0.625, 0.625, 1.25)


def turned(degrees: float, axis: tuple[float, float, float] = (1.0, 2.0, 0.5)) -> np.ndarray:
    """A rotation matrix."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    t = np.radians(degrees)
    return np.eye(3) + np.sin(t) * k + (1.0 - np.cos(t)) * k @ k


@cache
def labels(spacing: tuple[float, float, float] = (2.0, 2.0, 2.0), noise: float = 0.0, seed: int = 0) -> Volume:
    return Volume.from_image(make_label_map(SHAPE, spacing, noise_voxels=noise, seed=seed))


@cache
def true_volume_ml() -> float:
    return mesh_phantom(SHAPE, 40000, closed=True).surface.enclosed_volume / 1000.0


def with_values(volume: Volume, values: np.ndarray) -> Volume:
    return Volume(values, volume.spacing, volume.origin, volume.direction)


def ball(radius: float, spacing: float = 1.0, direction: np.ndarray | None = None, size: int = 64) -> Volume:
    """A ball in the middle of an image of `size` voxels."""
    at = np.indices((size, size, size)) - 0.5 * (size - 1)
    inside = (at**2).sum(axis=0) * spacing**2 < radius**2
    return Volume(
        inside.astype(np.uint8), np.full(3, spacing), np.zeros(3), np.eye(3) if direction is None else direction
    )


def genus_of_voxels(mask: np.ndarray) -> int:
    """Handles of one piece without hollows, counted on the voxels: 1 minus the Euler number.

    Voxels are joined through faces: points (voxels), edges (pairs), squares (2 x 2) and cubes (2 x 2 x 2). Where only
    two opposite corners of a cube are outside, outside is not joined through the diagonal (18-connected): a disk closes
    the ring of the other six.
    """
    m = np.pad(mask, 1).astype(int)
    x, y, z = m[1:] * m[:-1], m[:, 1:] * m[:, :-1], m[..., 1:] * m[..., :-1]
    squares = (x[:, 1:] * x[:, :-1]).sum() + (y[..., 1:] * y[..., :-1]).sum() + (x[..., 1:] * x[..., :-1]).sum()
    corner = {(a, b, c): m[a : m.shape[0] - 1 + a, b : m.shape[1] - 1 + b, c : m.shape[2] - 1 + c]
              for a in (0, 1) for b in (0, 1) for c in (0, 1)}  # fmt: skip
    inside = sum(corner.values())
    disks = 0
    for a, b, c in ((0, 0, 0), (0, 0, 1), (0, 1, 0), (1, 0, 0)):
        opposite = corner[1 - a, 1 - b, 1 - c]
        disks += ((inside == 6) & (corner[a, b, c] == 0) & (opposite == 0)).sum()
    euler = m.sum() - x.sum() - y.sum() - z.sum() + squares - (inside == 8).sum() + disks
    return int(1 - euler)


# ---- accuracy ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("spacing", "noise", "rms_mm", "percent"),
    [
        (MRI, 0.0, 0.15, 0.5),
        ((1.0, 1.0, 3.0), 0.0, 0.30, 0.5),
        ((2.0, 2.0, 2.0), 0.0, 0.25, 1.0),
        (MRI, 0.6, 0.45, 0.5),
    ],
)
def test_follows_the_analytic_atrium(
    spacing: tuple[float, float, float], noise: float, rms_mm: float, percent: float
) -> None:
    made = label_surface(labels(spacing, noise, 1))
    surface = made.surface
    assert surface.is_manifold and surface.is_oriented and surface.space == "LPS"
    assert surface.component_count == 1 and surface.genus == 0 and not surface.boundary_loops
    distance = SHAPE.signed_distance(surface.points)
    assert np.sqrt(np.mean(distance**2)) < rms_mm
    # Neither the whole nor the veins shrink.
    assert made.volume_ml == pytest.approx(true_volume_ml(), rel=0.01 * percent)
    assert made.area_cm2 == pytest.approx(SHAPE.area(closed=True) / 100.0, rel=0.015)
    offset = surface.points - np.array(SHAPE.centre)
    for name in SHAPE.tubes:
        opening = SHAPE.openings[name]
        height = offset @ opening.axis
        across = np.linalg.norm(offset - height[:, None] * opening.axis, axis=1)
        wall = (height > opening.rim[1]) & (height < opening.top) & (across < 1.5 * opening.rim[0])
        # The noise itself does not quite average out over a vein.
        assert abs(distance[wall].mean()) < max(0.12, 0.15 * np.cbrt(np.prod(spacing))) + 0.3 * noise


def test_has_no_staircase() -> None:
    # Almost parallel to the slices: terraces about 12 mm wide. Without smoothing a slice's step is 1.25 mm.
    flat = left_atrium_shape()
    image = make_label_map(flat, MRI, direction=turned(5.0, (1.0, 0.0, 0.0)))
    made = label_surface(Volume.from_image(image))
    surface = made.surface
    centres = surface.points[surface.triangles].mean(axis=1)
    step = 1e-3 * np.eye(3)
    outward = np.stack([flat.signed_distance(centres + e) - flat.signed_distance(centres - e) for e in step], axis=1)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    normals = operators.area_vectors(surface.points, surface.triangles)
    areas = np.linalg.norm(normals, axis=1)
    angles = np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", normals, outward) / areas, -1.0, 1.0)))
    assert np.average(angles, weights=areas) < 4.5
    assert angles.max() < 60.0


def test_triangles_are_good() -> None:
    for spacing, noise in ((MRI, 0.0), (MRI, 0.8), ((1.5, 1.5, 1.5), 0.6), ((0.7, 0.7, 3.0), 0.0)):
        surface = label_surface(labels(spacing, noise, 3)).surface
        smallest = np.degrees(np.arctan2(1.0, operators.cotangents(surface.points, surface.triangles))).min(axis=1)
        assert smallest.min() > 2.0 and np.mean(smallest > 15.0) > 0.98


def test_ball_of_known_size_and_filter_of_known_response() -> None:
    made = label_surface(ball(25.0))
    radii = np.linalg.norm(made.surface.points - 31.5, axis=1)
    assert radii.mean() == pytest.approx(25.0, abs=0.05) and radii.std() < 0.1
    assert made.volume_ml == pytest.approx(4.0 / 3.0 * np.pi * 25.0**3 / 1000.0, rel=0.005)
    # On a ring the waves are eigenvectors: slow ones stay, the chosen one is halved, fast ones go.
    n, t = 400, 2.0 * np.pi * np.arange(400) / 400
    ring = ndimage.convolve1d(np.eye(n), np.array([0.5, 0.0, 0.5]), axis=0, mode="wrap")
    response = _response(1.0 - np.cos(2.0 * np.pi * 20 / n))
    for wave, expected in ((0, 1.0), (5, 1.0), (20, 0.5), (60, 0.0)):
        points = np.cos(wave * t)[:, None]
        for _ in range(ROUNDS):
            points = _filtered(ring, points, response)
        assert points[0, 0] == pytest.approx(expected, abs=0.01)


# ---- where it lies -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("handedness", [1.0, -1.0])
def test_any_direction_gives_the_same_place_and_outward_triangles(handedness: float) -> None:
    direction = turned(40.0) @ np.diag([1.0, handedness, 1.0])
    made = label_surface(Volume.from_image(make_label_map(SHAPE, (1.5, 1.0, 2.0), direction=direction)))
    assert np.sqrt(np.mean(SHAPE.signed_distance(made.surface.points) ** 2)) < 0.25
    assert made.surface.enclosed_volume > 0.0 and made.surface.is_oriented
    assert made.volume_ml == pytest.approx(true_volume_ml(), rel=0.01)


def test_position_does_not_depend_on_the_crop() -> None:
    small = labels()
    k = np.array([3, 5, 7])
    values = np.zeros(np.array(small.values.shape) + 20, np.int16)
    values[tuple(slice(a, a + n) for a, n in zip(k, small.values.shape, strict=True))] = 4 * small.values
    origin = small.positions(-k[None, ::-1].astype(float))[0]
    moved = label_surface(Volume(values, small.spacing, origin, small.direction))
    here = label_surface(small)
    assert np.allclose(moved.surface.points, here.surface.points, atol=1e-4)
    assert np.array_equal(moved.surface.triangles, here.surface.triangles)


# ---- topology -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(6))
def test_topology_is_that_of_the_voxels(seed: int) -> None:
    # A sponge: many handles, and voxels that touch at edges and corners.
    rng = np.random.default_rng(seed)
    field = ndimage.gaussian_filter(rng.normal(size=(24, 26, 28)), 0.9)
    pieces, _ = ndimage.label(field > 0.1 * field.std())
    mask = pieces == np.bincount(pieces.reshape(-1))[1:].argmax() + 1
    outside, _ = ndimage.label(np.pad(~mask, 1, constant_values=True), ndimage.generate_binary_structure(3, 2))
    mask = (outside != outside[0, 0, 0])[1:-1, 1:-1, 1:-1]
    made = label_surface(Volume(mask.astype(np.uint8), np.full(3, 2.0), np.zeros(3), np.eye(3)))
    genus = genus_of_voxels(mask)
    assert genus > 10
    assert made.surface.genus == genus
    assert made.surface.is_manifold and made.surface.component_count == 1 and not made.surface.boundary_loops
    assert any(f"{genus} handles" in note for note in made.notes)


def test_neither_makes_nor_breaks_thin_bridges() -> None:
    at = np.indices((40, 60, 60)) - np.array([20.0, 30.0, 30.0])[:, None, None, None]
    ring = (np.hypot(at[1], at[2]) - 20.0) ** 2 + at[0] ** 2 < 8.0**2
    whole = Volume(ring.astype(np.uint8), np.ones(3), np.zeros(3), np.eye(3))
    assert label_surface(whole).surface.genus == 1
    cut = ring.copy()
    cut[:, 30, 30:] = False
    narrow = label_surface(with_values(whole, cut.astype(np.uint8)))
    assert narrow.surface.genus == 0 and narrow.notes == ()
    # The two ends do not meet in the gap of one voxel.
    beside = narrow.surface.points[narrow.surface.points[:, 0] > 35.0]
    assert np.abs(beside[:, 1] - 30.0).min() > 0.05
    cut[20, 30, 50] = True
    joined = label_surface(with_values(whole, cut.astype(np.uint8)))
    assert joined.surface.genus == 1 and "1 handle:" in joined.notes[0]
    # A one-voxel bridge keeps its two sides apart.
    smallest = np.arctan2(1.0, operators.cotangents(joined.surface.points, joined.surface.triangles)).min()
    assert np.degrees(smallest) > 3.0


# ---- what is left out and what is refused ---------------------------------------------------------------------------


def test_islands_and_hollows_are_noted_and_do_not_matter() -> None:
    clean = labels()
    values = clean.values.copy()
    values[1:3, 1:3, 1:4] = 1
    inner = tuple(np.round(clean.indices(np.array([SHAPE.centre]))[0]).astype(int)[::-1])
    values[inner] = 0
    made = label_surface(with_values(clean, values))
    assert np.allclose(made.surface.points, label_surface(clean).surface.points)
    assert "1 loose piece beside the atrium left out (0.096 ml" in made.notes[0]
    assert "1 hollow inside the atrium filled (0.008 ml)" in made.notes[1]


def test_a_label_at_the_border_is_closed_and_noted() -> None:
    # Axes: i to the patient's left, j posterior, k superior.
    whole = labels()
    top = int(np.flatnonzero(whole.values.any(axis=(1, 2)))[-1]) - 5
    cut = Volume(whole.values[:top], whole.spacing, whole.origin, whole.direction)
    made = label_surface(cut)
    assert not made.surface.boundary_loops and made.surface.genus == 0
    assert len(made.notes) == 1 and "the superior border" in made.notes[0]
    assert made.surface.points[:, 2].max() < cut.positions(np.array([[0.0, 0.0, top]]))[0, 2]
    # The same image stored upside down and mirrored.
    flip = np.array([[0.0, 0.0, top - 1.0]])
    turned_over = Volume(cut.values[::-1], cut.spacing, cut.positions(flip)[0], np.diag([1.0, 1.0, -1.0]))
    assert label_surface(turned_over).notes == made.notes


def test_chooses_the_label() -> None:
    clean = labels()
    values = 3 * clean.values.astype(np.int32)
    far = values.copy()
    far[:2] = 7
    with pytest.raises(SurfaceError, match=r"has 2 labels.*3 \([\d.]+ ml\), 7 \([\d.]+ ml\)"):
        label_surface(with_values(clean, far))
    made = label_surface(with_values(clean, far), 3)
    assert np.allclose(made.surface.points, label_surface(clean).surface.points)
    with pytest.raises(SurfaceError, match=r"Label 5 is not in the label map. Choose one of: 3"):
        label_surface(with_values(clean, values), 5)
    with pytest.raises(SurfaceError, match="Label 0 is the background"):
        label_surface(with_values(clean, values), 0)
    as_truth = label_surface(with_values(clean, clean.values > 0))
    as_float = label_surface(with_values(clean, clean.values.astype(np.float32)))
    assert np.array_equal(as_truth.surface.points, as_float.surface.points)


def test_many_labels_are_labels() -> None:
    # A whole-body label map: blocks of 40 values beside the atrium.
    clean = labels()
    blocks = np.add.outer(np.arange(clean.values.shape[1]) // 6, 11 * (np.arange(clean.values.shape[2]) // 6))
    values = np.where(clean.values > 0, 1, 2 + np.broadcast_to(blocks, clean.values.shape)).astype(np.int16)
    made = label_surface(with_values(clean, values), 1)
    assert np.allclose(made.surface.points, label_surface(clean).surface.points)


def test_refuses_with_a_reason() -> None:
    clean = labels()
    with pytest.raises(SurfaceError, match="label map is empty"):
        label_surface(with_values(clean, np.zeros_like(clean.values)))
    two = np.concatenate([clean.values, clean.values], axis=2)
    with pytest.raises(SurfaceError, match=r"two large pieces, of \d+ and \d+ ml.*both atria"):
        label_surface(with_values(clean, two))
    with pytest.raises(SurfaceError, match=r"volume of 9\.\d+ ml, expected 20 to 400 ml.*only a part"):
        label_surface(ball(13.0))
    with pytest.raises(SurfaceError, match=r"volume of 5\d\d ml, expected 20 to 400 ml.*ventricle still attached"):
        label_surface(ball(50.0, 2.0))


def test_refuses_an_intensity_image() -> None:
    lge = Volume.from_image(make_lge_volume(SHAPE, (3, 3, 3), noise=4.0))
    with pytest.raises(SurfaceError, match="an image, not a label map: voxels have fractions"):
        label_surface(lge)
    with pytest.raises(SurfaceError, match=r"an image, not a label map: it has .* neighbours mostly differ"):
        label_surface(with_values(lge, np.clip(lge.values, 0, 255).astype(np.uint8)))
    with pytest.raises(SurfaceError, match="smallest value is -"):
        label_surface(with_values(lge, lge.values.astype(np.int16) - 1000))
    holes = lge.values.copy()
    holes[0] = np.nan
    with pytest.raises(SurfaceError, match="not a number"):
        label_surface(with_values(lge, holes))


def test_reports_progress_and_stops() -> None:
    shares: list[float] = []
    label_surface(labels(), progress=lambda share, text: shares.append(share))
    assert shares == sorted(shares) and shares[0] == 0.0 and shares[-1] == 1.0
    for stop in (0, 2, len(shares) - 2):
        count = 0

        def ask(share: float, text: str, stop: int = stop) -> bool:
            nonlocal count
            count += 1
            return count <= stop

        with pytest.raises(Cancelled):
            label_surface(labels(), progress=ask)


# ---- the phantom's label map ----------------------------------------------------------------------------------------


def test_label_map_holds_the_voxels_inside() -> None:
    direction = turned(25.0) @ np.diag([-1.0, 1.0, 1.0])
    image = make_label_map(SHAPE, (2.0, 1.5, 3.0), direction=direction, margin=4.0)
    assert image.GetPixelID() == sitk.sitkUInt8 and image.GetSpacing() == (2.0, 1.5, 3.0)
    values = sitk.GetArrayViewFromImage(image)
    index = np.random.default_rng(0).integers(0, image.GetSize(), (2000, 3))
    places = np.array([image.TransformIndexToPhysicalPoint([int(i) for i in row]) for row in index])
    assert np.array_equal(values[tuple(index.T[::-1])], SHAPE.signed_distance(places) <= 0.0)
    assert values.sum() * 9.0 / 1000.0 == pytest.approx(true_volume_ml(), rel=0.01)
    # The margin is free.
    assert not any(np.moveaxis(values, axis, 0)[end].any() for axis in range(3) for end in (0, -1))


def test_label_noise_is_of_the_stated_size_and_looks_like_segmentation() -> None:
    clean, noisy, again, other = (
        sitk.GetArrayFromImage(make_label_map(SHAPE, (1, 1, 1), noise_voxels=n, seed=s))
        for n, s in ((0.0, 0), (1.0, 4), (1.0, 4), (1.0, 5))
    )
    assert np.array_equal(noisy, again) and not np.array_equal(noisy, other)
    # A displacement of standard deviation 1 voxel changes E|N(0, 1)| = 0.80 voxels for each voxel of boundary area.
    changed = np.count_nonzero(noisy != clean) / SHAPE.area(closed=True)
    assert changed == pytest.approx(np.sqrt(2.0 / np.pi), rel=0.1)
    # It does not fall apart.
    pieces, _ = ndimage.label(noisy)
    assert np.bincount(pieces.reshape(-1))[1:].max() > 0.999 * noisy.sum()
    for bad in (-1.0, np.nan, 9.0):
        with pytest.raises(LAFlatteningError, match="noise between 0 and 5 voxels"):
            make_label_map(SHAPE, (4, 4, 4), noise_voxels=bad)


# ---- real atria -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("case", "genus"), [("06SR5", 0), ("8M99G", 0), ("MJHV7", 2)])
def test_real_label_maps(data_dir, case: str, genus: int) -> None:
    volume = read_volume(data_dir / "stacom2018" / f"{case}_laendo.nrrd")
    made = label_surface(volume)
    surface = made.surface
    assert surface.is_manifold and surface.is_oriented and surface.component_count == 1
    assert surface.genus == genus and not surface.boundary_loops
    assert made.volume_ml == pytest.approx(np.count_nonzero(volume.values) * volume.voxel_volume / 1000.0, rel=0.006)
    # Nowhere farther than two voxels from the boundary of the voxels.
    whole = ndimage.binary_fill_holes(volume.values > 0)
    near = ndimage.binary_dilation(whole, iterations=2) & ~ndimage.binary_erosion(whole, iterations=2)
    assert near[tuple(np.round(volume.indices(surface.points)).astype(int).T[::-1])].all()
    smallest = np.degrees(np.arctan2(1.0, operators.cotangents(surface.points, surface.triangles))).min()
    assert smallest > 2.0
    with pytest.raises(SurfaceError, match="not a label map"):
        label_surface(read_volume(data_dir / "stacom2018" / f"{case}_lgemri_norm.nrrd"))
