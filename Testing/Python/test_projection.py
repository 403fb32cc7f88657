"""Images projected onto the wall: closed forms, the phantom's known maximum, SimpleITK, axes, edges, bad input."""

import numpy as np
import pytest
import SimpleITK as sitk

from LAFlatteningLib.cavity.label_surface import label_surface
from LAFlatteningLib.errors import InputFileError, LAFlatteningError, SurfaceError
from LAFlatteningLib.files import read_volume
from LAFlatteningLib.phantom import LgeModel, make_lge_volume
from LAFlatteningLib.projection import outward_normals, project
from LAFlatteningLib.surface import Surface
from LAFlatteningLib.volume import Volume


@pytest.fixture(scope="module")
def image(phantom):
    return Volume.from_image(make_lge_volume(phantom.shape, spacing=(1.0, 1.0, 1.5), noise=5.0))


def volume_of(function, low, high, step=2.0):
    """An image of a function of places (n, 3) in LPS."""
    count = np.ceil((high - low) / step).astype(int) + 1
    k, j, i = np.meshgrid(*(np.arange(n) for n in count[::-1]), indexing="ij")
    places = low + step * np.stack([i, j, k], axis=-1).reshape(-1, 3)
    return Volume(function(places).reshape(count[::-1]), np.full(3, step), low, np.eye(3))


@pytest.fixture(scope="module")
def ramp(phantom):
    """An image that rises by 2 a mm towards the patient's left."""
    points = phantom.surface.points
    return volume_of(lambda places: 2.0 * places[:, 0] + 7.0, points.min(axis=0) - 6.0, points.max(axis=0) + 6.0)


# ---- closed forms ----------------------------------------------------------------------------------------------------


def test_in_a_linear_image_every_statistic_is_known(phantom, ramp):
    surface = phantom.surface
    at, slope = 2.0 * surface.points[:, 0] + 7.0, 2.0 * surface.point_normals[:, 0]
    for (low, high), found in {
        (-3.0, 3.0): project(surface, ramp),
        (-2.0, 0.0): project(surface, ramp, 2.0, "in"),
        (0.0, 2.5): project(surface, ramp, 2.5, "out"),
        (-1.0, 3.0): project(surface, ramp, interval_mm=(-1, 3)),
    }.items():
        assert np.allclose(found.values, at + np.maximum(low * slope, high * slope), atol=1e-9)
        assert found.interval_mm == (low, high)
        assert found.step_mm <= 0.5 * ramp.spacing.min() + 1e-12
        assert (found.outside, found.partly_outside, found.notes) == (0, 0, ())
    mean = project(surface, ramp, statistic="mean", interval_mm=(-1, 3))
    assert np.allclose(mean.values, at + slope, atol=1e-9)


def test_maximum_on_the_phantom_is_the_analytic_one(phantom):
    shape, points = phantom.shape, phantom.surface.points
    offset = points - np.array(shape.centre)
    directions = offset / np.linalg.norm(offset, axis=1, keepdims=True)
    from_edge = np.abs(shape.scar_pattern.depth(directions, shape.caps))
    from_edge = np.minimum(from_edge, np.abs(shape.caps.distance(shape.anatomy.outer, directions)))
    model = LgeModel()
    contrast = model.scar - model.healthy
    errors = {}
    for voxel in (1.6, 0.8):
        image = Volume.from_image(make_lge_volume(shape, spacing=(voxel,) * 3, margin=6.0))
        error = np.abs(project(phantom.surface, image).values - shape.lge(points))
        errors[voxel] = np.sqrt((error**2).mean())
        # Where a voxel holds one tissue; at an edge it is a mixture of two, and no projection can tell them apart. The
        # tissue in the middle of the wall, 1.5 mm thick, holds voxels of 0.8 mm whichever way they lie.
        pure = from_edge > 0.5 * model.transition + np.sqrt(3.0) * voxel
    assert np.count_nonzero(pure) > 1000
    assert np.count_nonzero(pure & (shape.lge(points) == model.scar)) > 5
    assert error[pure].max() < 0.01 * contrast
    assert errors[0.8] < 0.6 * errors[1.6]


def test_maximum_and_mean_are_those_of_a_loop_by_simpleitk_on_real_atria(data_dir):
    for case in ("4CHFJ", "MJHV7"):
        folder = data_dir / "stacom2018"
        image = sitk.ReadImage(str(folder / f"{case}_lgemri_norm.nrrd"))
        surface = label_surface(read_volume(folder / f"{case}_laendo.nrrd")).surface
        maximum, mean = (project(surface, Volume.from_image(image), statistic=which) for which in ("max", "mean"))
        chosen = np.random.default_rng(1).choice(len(surface.points), 150, replace=False)
        steps = np.linspace(-3.0, 3.0, 1 + int(np.ceil(6.0 / (0.5 * min(image.GetSpacing())))))
        for point in chosen:
            normal = np.zeros(3)
            for a, b, c in surface.points[surface.triangles[(surface.triangles == point).any(axis=1)]]:
                normal += np.cross(b - a, c - a)
            normal /= np.linalg.norm(normal)
            values = [
                image.EvaluateAtPhysicalPoint((surface.points[point] + t * normal).tolist(), sitk.sitkLinear)
                for t in steps
            ]
            assert maximum.values[point] == pytest.approx(max(values), abs=1e-5)
            assert mean.values[point] == pytest.approx(np.trapezoid(values, steps) / 6.0, abs=1e-5)


# ---- axes and orientation --------------------------------------------------------------------------------------------


def as_ras(surface):
    return Surface(surface.points * (-1.0, -1.0, 1.0), surface.triangles, space="RAS")


def with_axes(volume, order, turned):
    """The same image stored along other axes: `order` of i, j, k, some of them from the other end."""
    values = volume.values.transpose([2 - axis for axis in order][::-1])
    direction, spacing = volume.direction[:, order].copy(), volume.spacing[list(order)]
    origin = volume.origin.copy()
    for axis in turned:
        values = np.flip(values, 2 - axis)
        origin += direction[:, axis] * spacing[axis] * (values.shape[2 - axis] - 1)
        direction[:, axis] *= -1.0
    return Volume(values, spacing, origin, direction)


def test_the_same_anatomy_gives_the_same_values_whatever_the_axes(phantom, image):
    expected = project(phantom.surface, image, interval_mm=(-1, 3)).values
    flipped = phantom.surface.with_triangles(phantom.surface.triangles[:, ::-1])
    mixed = phantom.surface.triangles.copy()
    mixed[::3] = mixed[::3, ::-1]
    for surface in (flipped, phantom.surface.with_triangles(mixed), as_ras(phantom.surface), as_ras(flipped)):
        for order, turned in (((0, 1, 2), ()), ((2, 0, 1), (0,)), ((1, 0, 2), (0, 1)), ((2, 1, 0), (2,))):
            found = project(surface, with_axes(image, order, turned), interval_mm=(-1, 3))
            assert np.abs(found.values - expected).max() < 1e-6


def test_an_oblique_image_shows_the_same(phantom):
    c, s = np.cos(0.5), np.sin(0.5)
    tilt = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    straight, oblique = (
        project(phantom.surface, Volume.from_image(make_lge_volume(phantom.shape, (1.0,) * 3, direction=d))).values
        for d in (None, tilt)
    )
    # Voxels elsewhere mix tissues elsewhere: alike in the mean, and nearly everywhere.
    assert abs(straight.mean() - oblique.mean()) < 0.3
    assert np.median(np.abs(straight - oblique)) < 0.01


def test_normals_of_each_piece_point_out_of_it(phantom):
    inner = phantom.surface
    other = inner.points + np.array([200.0, 0.0, 0.0])
    both = Surface(
        np.concatenate([inner.points, other]),
        np.concatenate([inner.triangles, inner.triangles[:, ::-1] + len(inner.points)]),
    )
    normals = outward_normals(both)
    assert np.allclose(normals[: len(other)], inner.point_normals)
    assert np.allclose(normals[len(other) :], inner.point_normals)


# ---- the edge of the image -------------------------------------------------------------------------------------------


def test_points_outside_the_image_are_counted_and_have_no_value(phantom, image):
    whole = project(phantom.surface, image)
    # The lower slices are cut off.
    cut = image.values.shape[0] // 4
    corner = image.origin + np.array([0.0, 0.0, cut * image.spacing[2]])
    part = Volume(image.values[cut:], image.spacing, corner, image.direction)
    found = project(phantom.surface, part)
    floor = part.origin[2]
    z, dz = phantom.surface.points[:, 2], np.abs(3.0 * phantom.surface.point_normals[:, 2])
    outside, inside = z + dz < floor - 1e-6, z - dz > floor + 1e-6
    assert np.array_equal(np.isnan(found.values), outside)
    assert found.outside == np.count_nonzero(outside) > 0
    assert found.partly_outside == np.count_nonzero(~outside & ~inside) > 0
    assert np.allclose(found.values[inside], whole.values[inside], atol=1e-9)
    assert np.all(found.values[~outside] <= whole.values[~outside] + 1e-9)
    assert str(found.outside) in found.notes[0]
    assert str(found.partly_outside) in found.notes[1]


def test_voxels_without_a_value_are_left_out(phantom, ramp):
    values = ramp.values.copy()
    values[: len(values) // 2] = np.nan
    found = project(phantom.surface, Volume(values, ramp.spacing, ramp.origin, ramp.direction))
    assert 0 < found.outside < len(phantom.surface.points)
    assert np.count_nonzero(np.isnan(found.values)) == found.outside


def test_points_in_groups_are_as_all_at_once(phantom, image, monkeypatch):
    whole = project(phantom.surface, image).values
    monkeypatch.setattr("LAFlatteningLib.projection.SAMPLES_AT_ONCE", 1000)
    assert np.array_equal(project(phantom.surface, image).values, whole)


def test_the_array_says_how_it_was_made(phantom, image):
    made = project(phantom.surface, image, 2.0, "in", "mean").on(phantom.surface, "MIP")
    assert made.point_data["MIP"].shape == (len(phantom.surface.points),)
    assert made.field_data["MIP_interval_mm"].tolist() == [-2.0, 0.0]
    assert made.field_data["MIP_statistic"][0] == "mean"
    assert 0.0 < made.field_data["MIP_step_mm"][0] <= 0.5


# ---- bad input -------------------------------------------------------------------------------------------------------


def test_an_image_elsewhere_is_refused_with_both_extents(phantom, image):
    far = Volume(image.values, image.spacing, image.origin + np.array([500.0, 0.0, 0.0]), image.direction)
    with pytest.raises(InputFileError, match=r"does not overlap.*surface reaches over.*image over.*same patient"):
        project(phantom.surface, far)


def test_a_surface_in_the_other_axes_is_recognised(phantom, image):
    away = Volume(image.values, image.spacing, image.origin + np.array([0.0, 300.0, 0.0]), image.direction)
    turned = Surface(
        (phantom.surface.points + np.array([0.0, 300.0, 0.0])) * (-1.0, -1.0, 1.0), phantom.surface.triangles
    )
    with pytest.raises(InputFileError, match="axes of the surface are taken the other way"):
        project(turned, away)


def test_an_image_that_a_turned_surface_touches_by_chance_is_refused(phantom, image):
    points = phantom.surface.points
    # The part of the image that holds the atrium begins in the mirrored atrium.
    low = points.min(axis=0) - 5.0
    shift = np.array([-low[0] - 8.0, -low[1] - 8.0, 0.0])
    away = Volume(image.values, image.spacing, image.origin + shift, image.direction)
    turned = Surface((points + shift) * (-1.0, -1.0, 1.0), phantom.surface.triangles)
    index = away.indices(turned.points)
    some = ((index >= 0.0) & (index <= np.array(away.values.shape[::-1]) - 1)).all(axis=1).mean()
    assert 0.0 < some < 0.5
    with pytest.raises(InputFileError, match=r"does not reach \d+ of.*the other way"):
        project(turned, away)
    # A half image of the right place is no reason to doubt the axes.
    half = Volume(image.values[: len(image.values) // 2], image.spacing, image.origin, image.direction)
    assert project(phantom.surface, half).outside > 0.4 * len(points)


@pytest.mark.parametrize(("factor", "unit"), [(0.001, "metres"), (0.1, "centimetres"), (1000.0, "micrometres")])
def test_a_surface_in_another_unit_is_refused_even_where_it_lies_in_the_image(phantom, image, factor, unit):
    centred = phantom.surface.points - phantom.surface.points.mean(axis=0)
    origin = -0.5 * image.spacing * image.values.shape[::-1]
    around = Volume(image.values, image.spacing, origin, np.eye(3))
    with pytest.raises(SurfaceError, match=f"probably in {unit}"):
        project(Surface(factor * centred, phantom.surface.triangles), around)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"depth_mm": 0.0}, "depth above 0 mm"),
        ({"depth_mm": -3.0}, "depth above 0 mm"),
        ({"depth_mm": float("nan")}, "depth above 0 mm"),
        ({"side": "left"}, '"both", "in" or "out"'),
        ({"statistic": "median"}, '"max" or "mean"'),
        ({"interval_mm": (3.0, -1.0)}, "from less than to"),
        ({"interval_mm": (1.0,)}, "from less than to"),
        ({"depth_mm": 1e9}, "at most 50 mm"),
        ({"interval_mm": (-60.0, 3.0)}, "at most 50 mm from the wall, found -60"),
    ],
)
def test_settings_without_meaning_are_refused(phantom, image, options, words):
    with pytest.raises(LAFlatteningError, match=words):
        project(phantom.surface, image, **options)


def test_an_image_that_shows_nothing_is_refused(phantom, image):
    blank = Volume(np.full_like(image.values, 4.0), image.spacing, image.origin, image.direction)
    with pytest.raises(InputFileError, match="4 everywhere"):
        project(phantom.surface, blank)


def test_names_that_are_taken_and_maps_are_refused(phantom, phantom_map, image):
    for name in ("", " ", "region", "hole"):
        with pytest.raises(LAFlatteningError, match=r"other than hole, region.*found \""):
            project(phantom.surface, image).on(phantom.surface, name)
    with pytest.raises(SurfaceError, match="looks like a map"):
        project(phantom_map.to_surface(), image)
