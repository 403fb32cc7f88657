"""Values of an image between its voxels, against SimpleITK, and what projection does where a surface is odd."""

import numpy as np
import pytest
import SimpleITK as sitk

from LAFlatteningLib.errors import InputFileError, SurfaceError
from LAFlatteningLib.projection import outward_normals, project
from LAFlatteningLib.surface import Surface
from LAFlatteningLib.volume import SAMPLES_AT_ONCE, Volume

TURNED = np.array([[0.0, 0.0, -1.0], [0.6, -0.8, 0.0], [-0.8, -0.6, 0.0]])


def make_image(kind, size=(7, 5, 4)):
    random = np.random.default_rng(4)
    image = sitk.GetImageFromArray(random.integers(0, 250, size[::-1]).astype(kind))
    image.SetSpacing((0.7, 0.9, 1.6))
    image.SetOrigin((-12.0, 30.0, 5.0))
    image.SetDirection(TURNED.ravel().tolist())
    return image


@pytest.mark.parametrize("kind", [np.uint8, np.int16, np.uint32, np.float32, np.float64])
def test_values_between_voxels_are_those_of_simpleitk(kind):
    """Of whole numbers too, between which a difference may be negative."""
    image = make_image(kind)
    volume = Volume.from_image(image)
    random = np.random.default_rng(5)
    index = random.uniform(0.0, np.array(image.GetSize()) - 1.0, (400, 3))
    # On voxels, on sides and on corners of the image as well.
    index[:100] = np.round(index[:100])
    index[100:150, 0] = 0.0
    index[150:200, 2] = image.GetSize()[2] - 1.0
    places = volume.positions(index)
    linear = [image.EvaluateAtPhysicalPoint(place.tolist(), sitk.sitkLinear) for place in places]
    # SimpleITK interpolates small types in single precision.
    assert np.allclose(volume.sample(places), linear, atol=1e-4)
    off_border = np.abs(index - np.floor(index) - 0.5).min(axis=1) > 1e-3
    nearest = [image.EvaluateAtPhysicalPoint(place.tolist(), sitk.sitkNearestNeighbor) for place in places[off_border]]
    assert np.array_equal(volume.sample(places[off_border], nearest=True), nearest)


def test_nothing_is_extrapolated():
    volume = Volume.from_image(make_image(np.float64))
    last = np.array(volume.values.shape[::-1]) - 1.0
    middle = 0.5 * last
    for axis in range(3):
        for end, out in ((0.0, -1.0), (last[axis], 1.0)):
            for beyond, known in ((0.0, True), (0.01, False), (0.49, False), (50.0, False)):
                index = middle.copy()
                index[axis] = end + out * beyond
                for nearest in (False, True):
                    assert np.isfinite(volume.sample(volume.positions(index[None]), nearest))[0] == known
    assert np.isnan(volume.sample(np.array([[np.nan, 0.0, 0.0]])))[0]
    assert len(volume.sample(np.empty((0, 3)))) == 0


def test_one_slice_has_values_in_its_plane_only():
    image = make_image(np.int16, (6, 5, 1))
    volume = Volume.from_image(image)
    index = np.array([[2.0, 3.0, 0.0], [5.0, 4.0, 0.0], [2.5, 3.0, 0.0], [2.0, 3.0, 0.2]])
    rows = volume.values[0].astype(float)
    found = volume.sample(volume.positions(index))
    assert found[:3] == pytest.approx([rows[3, 2], rows[4, 5], 0.5 * (rows[3, 2] + rows[3, 3])])
    assert np.isnan(found[3])


def test_many_places_are_as_few():
    volume = Volume.from_image(make_image(np.float32))
    places = volume.positions(np.random.default_rng(6).uniform(-0.5, 6.0, (2 * SAMPLES_AT_ONCE + 7, 3)))
    apart = np.concatenate([volume.sample(part) for part in np.array_split(places, 9)])
    assert np.array_equal(volume.sample(places), apart, equal_nan=True)


def test_memory_order_of_the_voxels_does_not_matter():
    volume = Volume.from_image(make_image(np.float32))
    turned = Volume(np.asfortranarray(volume.values), volume.spacing, volume.origin, volume.direction)
    places = volume.positions(np.random.default_rng(7).uniform(0.0, 3.0, (50, 3)))
    assert np.array_equal(volume.sample(places), turned.sample(places))


# ---- odd surfaces and images -----------------------------------------------------------------------------------------


def test_a_stray_triangle_does_not_stop_the_rest(phantom):
    surface = phantom.surface
    count = len(surface.points)
    stray = surface.points.mean(axis=0) + np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.3], [0.0, 1.0, 0.2]])
    both = Surface(
        np.concatenate([surface.points, stray]),
        np.concatenate([surface.triangles[:, ::-1], [[count, count + 1, count + 2]]]),
    )
    assert np.allclose(outward_normals(both)[:count], surface.point_normals)


def test_a_tilted_sheet_has_no_outer_side():
    u, v = (a.ravel() for a in np.meshgrid(np.arange(5.0), np.arange(5.0)))
    i = np.array([5 * row + column for row in range(4) for column in range(4)])
    triangles = np.concatenate([np.stack([i, i + 1, i + 5], axis=1), np.stack([i + 1, i + 6, i + 5], axis=1)])
    sheet = Surface(np.column_stack([u + 0.1 * v, 0.7 * v - 0.3 * u, 0.2 * u + 0.9 * v]), triangles)
    with pytest.raises(SurfaceError, match="encloses no volume"):
        outward_normals(sheet)


def test_an_image_without_any_value_is_refused(phantom):
    points = phantom.surface.points
    blank = Volume(np.full((20, 20, 20), np.nan), np.full(3, 8.0), points.min(axis=0) - 10.0, np.eye(3))
    with pytest.raises(InputFileError, match="all are NaN"):
        project(phantom.surface, blank)


@pytest.mark.parametrize("kind", [np.int16, np.float32])
def test_samples_along_lines_are_those_at_their_places(kind):
    volume = Volume.from_image(make_image(kind))
    rng = np.random.default_rng(6)
    starts = volume.positions(rng.uniform(-1.0, 7.0, (SAMPLES_AT_ONCE + 40, 3)))
    directions = rng.normal(size=starts.shape)
    along = np.linspace(-3.0, 2.0, 5)
    found = volume.sample_lines(starts, directions, along)
    there = np.stack([volume.sample(starts + distance * directions) for distance in along])
    assert np.array_equal(np.isnan(found), np.isnan(there))
    assert 0.05 < np.isfinite(found).mean() < 0.95
    known = np.isfinite(there)
    assert np.abs(found - there)[known].max() < 1e-9 * np.abs(there[known]).max()
