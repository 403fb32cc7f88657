"""From label maps to surfaces, against the analytic phantom."""

from __future__ import annotations

import numpy as np
import pytest
import SimpleITK as sitk

from LAFlatteningLib.cavity.label_surface import label_surface
from LAFlatteningLib.errors import SurfaceError
from LAFlatteningLib.files import read_volume
from LAFlatteningLib.phantom import Bridge, left_atrium_shape, make_label_map
from LAFlatteningLib.volume import Volume

SHAPE = left_atrium_shape()
OBLIQUE = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]


def phantom_volume(spacing=(1.5, 1.5, 1.5), **options) -> Volume:
    return Volume.from_image(make_label_map(SHAPE, spacing, **options))


@pytest.mark.parametrize("spacing", [(0.625, 0.625, 1.25), (1, 1, 1), (2, 2, 2)])
def test_volume_area_and_distance_are_those_of_the_phantom(spacing):
    volume = phantom_volume(spacing)
    found = label_surface(volume)
    assert found.surface.is_manifold and found.surface.genus == 0 and not found.surface.boundary_loops
    assert found.notes == ()
    distance = SHAPE.signed_distance(found.surface.points)
    # Far less than half a voxel, and centred.
    assert np.sqrt(np.mean(distance**2)) < 0.12 * max(spacing)
    assert abs(distance.mean()) < 0.05 * max(spacing)
    assert found.volume_ml == pytest.approx(volume.values.sum() * volume.voxel_volume / 1000, rel=0.012)
    # A staircase has an area some 30 % too large.
    assert found.area_cm2 == pytest.approx(SHAPE.area(closed=True) / 100, rel=0.015)


@pytest.mark.parametrize("sign", [1, -1])
def test_direction_of_the_image_does_not_matter(sign):
    found = label_surface(phantom_volume(direction=OBLIQUE * [1, 1, sign]))
    assert np.abs(SHAPE.signed_distance(found.surface.points)).mean() < 0.2
    assert found.surface.enclosed_volume > 0


def test_boundary_noise_of_a_voxel_keeps_the_shape():
    found = label_surface(phantom_volume(noise_voxels=1.0))
    assert np.abs(SHAPE.signed_distance(found.surface.points)).mean() < 1.5
    assert found.surface.is_manifold


def test_a_bridge_is_one_handle():
    bridge = Bridge("RSPV", "RIPV", 4.0)
    found = label_surface(phantom_volume((1, 1, 1), bridges=[bridge]))
    assert found.surface.genus == 1
    assert np.linalg.norm(found.surface.points - bridge.place(SHAPE), axis=1).min() == pytest.approx(2.0, abs=0.5)


def changed(volume: Volume, change) -> Volume:
    values = volume.values.copy()
    change(values)
    return Volume(values, volume.spacing, volume.origin, volume.direction)


def test_islands_and_cavities_are_dropped_and_noted():
    volume = phantom_volume()
    centre = tuple(np.round(volume.indices(np.array([SHAPE.centre]))[0]).astype(int)[::-1])

    def change(values):
        values[1:3, 1:3, 1:3] = 1
        values[centre] = 0

    found = label_surface(changed(volume, change))
    assert len(found.notes) == 2 and "island" in found.notes[0] and "cavity" in found.notes[1]
    np.testing.assert_allclose(found.surface.points, label_surface(volume).surface.points, atol=1e-4)


def test_a_label_at_the_border_is_closed_and_noted():
    volume = phantom_volume()
    half = Volume(volume.values[len(volume.values) // 2 :], volume.spacing, volume.origin, volume.direction)
    found = label_surface(half)
    assert not found.surface.boundary_loops
    assert "border" in found.notes[0] and "inferior" in found.notes[0]


def test_labels_are_chosen_by_value():
    volume = changed(phantom_volume(), lambda values: np.multiply(values, 7, out=values))
    assert label_surface(volume).volume_ml == pytest.approx(label_surface(volume, 7).volume_ml)

    def second(values):
        values[:2, :2, :2] = 3

    with pytest.raises(SurfaceError, match=r"several labels: 3 \(.*ml\), 7 \("):
        label_surface(changed(volume, second))
    assert label_surface(changed(volume, second), 7).notes == ()
    with pytest.raises(SurfaceError, match="no label 4"):
        label_surface(volume, 4)


def test_what_is_no_atrium_is_refused():
    volume = phantom_volume((2, 2, 2))
    with pytest.raises(SurfaceError, match="empty"):
        label_surface(changed(volume, lambda values: values.fill(0)))
    twice = Volume(np.concatenate([volume.values] * 2), volume.spacing, volume.origin, volume.direction)
    with pytest.raises(SurfaceError, match="two large pieces"):
        label_surface(twice)
    with pytest.raises(SurfaceError, match="ml for a left atrium"):
        label_surface(Volume(volume.values, volume.spacing * 2, volume.origin, volume.direction))
    noise = np.random.default_rng(0).normal(100, 30, volume.values.shape)
    for values in (noise.astype(np.float32), noise.astype(np.int16) * 5):
        with pytest.raises(SurfaceError, match="intensity image"):
            label_surface(Volume(values, volume.spacing, volume.origin, volume.direction))


def test_noise_is_repeatable_and_moves_the_boundary():
    plain, first, second = (
        sitk.GetArrayFromImage(make_label_map(SHAPE, (2, 2, 2), noise_voxels=n)) for n in (0.0, 1.0, 1.0)
    )
    np.testing.assert_array_equal(first, second)
    assert (plain != first).any()


def test_all_masks_of_the_challenge(data_dir):
    for path in sorted((data_dir / "stacom2018").glob("*_laendo.nrrd")):
        volume = read_volume(path)
        found = label_surface(volume)
        assert found.surface.is_manifold and found.surface.is_oriented and found.surface.component_count == 1
        in_mask = np.count_nonzero(volume.values) * volume.voxel_volume / 1000
        assert found.volume_ml == pytest.approx(in_mask, rel=0.012)
        assert found.surface.genus == (2 if path.name.startswith("MJHV7") else 0)
