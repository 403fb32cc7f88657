"""Fibrosis and blood pool: closed forms, known scar of the phantom, rules, missing values, bad input."""

import csv
import io
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from LAFlatteningLib.blood_pool import BloodPool, blood_pool_of_labels, find_blood_pool, given_blood_pool
from LAFlatteningLib.cli import main
from LAFlatteningLib.errors import InputFileError, LAFlatteningError, SurfaceError
from LAFlatteningLib.fibrosis import Rule, measure_fibrosis
from LAFlatteningLib.files import read_surface, write_surface
from LAFlatteningLib.flattening import flatten
from LAFlatteningLib.parcellation import Parcellation
from LAFlatteningLib.phantom import LgeModel, left_atrium_shape, make_lge_volume, make_phantom
from LAFlatteningLib.projection import project
from LAFlatteningLib.scalar_arrays import share_reaching
from LAFlatteningLib.surface import Surface
from LAFlatteningLib.volume import Volume

NOISE = 6.0


@pytest.fixture(scope="module")
def image(phantom):
    return Volume.from_image(make_lge_volume(phantom.shape, spacing=(1.0, 1.0, 1.5), noise=NOISE))


def with_regions(phantom, **arrays):
    """The phantom with its true regions where a map has its own."""
    return phantom.surface.with_data(arrays, {"region": phantom.surface.cell_data["true_region"]})


# ---- areas -----------------------------------------------------------------------------------------------------------


def test_share_of_a_triangle_is_that_of_dense_samples():
    random = np.random.default_rng(3)
    corners = random.normal(size=(60, 3))
    corners[:10, 1] = corners[:10, 0]
    corners[10:20, 2] = corners[10:20, :2].max(axis=1)
    # Middles of small triangles, evenly over a triangle.
    n = 200
    i, j = (a.ravel() for a in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    up, down = i + j < n, i + j < n - 1
    weights = np.concatenate(
        [np.stack([i[up], j[up]], axis=1) + 1 / 3, np.stack([i[down], j[down]], axis=1) + 2 / 3]
    ) / n  # fmt: skip
    weights = np.column_stack([weights, 1.0 - weights.sum(axis=1)])
    values = corners @ weights.T
    for threshold in (-1.0, 0.0, 0.3, 5.0):
        sampled = (values >= threshold).mean(axis=1)
        assert np.abs(share_reaching(corners, threshold) - sampled).max() < 0.006


def test_share_at_the_limits_of_a_triangle():
    corners = np.array([[0.0, 1.0, 2.0], [0.0, 2.0, 2.0], [0.0, 0.0, 2.0], [2.0, 2.0, 2.0]])
    assert share_reaching(corners, 0.0).tolist() == [1.0, 1.0, 1.0, 1.0]
    assert share_reaching(corners, 1.0).tolist() == [0.5, 0.75, 0.25, 1.0]
    assert share_reaching(corners, 2.0).tolist() == [0.0, 0.0, 0.0, 1.0]
    assert share_reaching(corners, 2.1).tolist() == [0.0, 0.0, 0.0, 0.0]


def test_a_band_of_a_cylinder_has_its_area():
    """Between two heights, whatever the points are: half of them exceed nothing."""
    turn, height = np.meshgrid(np.linspace(0, 2 * np.pi, 400, endpoint=False), np.linspace(0.0, 30.0, 12))
    points = np.stack([10 * np.cos(turn), 10 * np.sin(turn), height], axis=-1).reshape(-1, 3)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(11), np.arange(400), indexing="ij"))
    a, b, c, d = i * 400 + j, i * 400 + (j + 1) % 400, (i + 1) * 400 + j, (i + 1) * 400 + (j + 1) % 400
    triangles = np.concatenate([np.column_stack([a, b, c]), np.column_stack([b, d, c])])
    surface = Surface(points, triangles, {"height": points[:, 2]})
    found = measure_fibrosis(surface, "height", Rule("value", (7.7, 21.3)))
    assert np.allclose(found.atrium.class_cm2, 2 * np.pi * 0.1 * np.array([7.7, 13.6, 8.7]), rtol=1e-4)
    below = measure_fibrosis(surface, "height", Rule("value", (21.3, 7.7), "below"))
    assert np.allclose(below.atrium.class_cm2, found.atrium.class_cm2[::-1])
    assert found.atrium.mean == pytest.approx(15.0)


def test_scar_of_the_phantom_is_within_one_point_at_three_resolutions():
    # Healthy wall as bright as blood: then the threshold is in the middle of the edge of scar, where scar ends.
    model = LgeModel(healthy=100.0, scar=140.0)
    shape = left_atrium_shape()
    truth = shape.scar_fractions()
    for points in (3000, 6000, 12000):
        phantom = make_phantom(points)
        surface = with_regions(phantom, LGE=shape.lge(phantom.surface.points, model))
        found = measure_fibrosis(surface, "LGE", Rule.parse("iir=1.2"), given_blood_pool(100.0, 5.0))
        for region, share in truth.items():
            assert found.part("region", region).beyond_percent == pytest.approx(100.0 * share, abs=1.0)


def test_scar_in_the_phantoms_image_is_within_one_point():
    phantom = make_phantom(20000)
    image = Volume.from_image(make_lge_volume(phantom.shape, noise=2.0, margin=4.0))
    surface = project(phantom.surface, image).on(with_regions(phantom))
    found = measure_fibrosis(surface, "LGE", Rule.parse("iir=1.2"), find_blood_pool(surface, image))
    for region, share in phantom.shape.scar_fractions().items():
        part = found.part("region", region)
        assert part.area_cm2 == pytest.approx(phantom.shape.region_areas()[region] / 100.0, rel=0.01)
        assert part.beyond_percent == pytest.approx(100.0 * share, abs=1.0)


def test_scar_in_the_phantoms_image_is_within_one_point_at_three_resolutions():
    """Blood, 100, hides the healthy wall, 70, so that values at the points alone say too much."""
    shape = left_atrium_shape()
    truth = shape.scar_fractions()
    image = Volume.from_image(make_lge_volume(shape, noise=2.0, margin=4.0))
    for points in (3000, 6000, 12000):
        surface = with_regions(make_phantom(points))
        surface = project(surface, image).on(surface)
        rule = Rule.parse("iir=1.2")
        found = measure_fibrosis(surface, "LGE", rule, given_blood_pool(100.0, 2.0), volume=image)
        assert found.sampled_mm <= 0.625
        for region, share in truth.items():
            assert found.part("region", region).beyond_percent == pytest.approx(100.0 * share, abs=1.0)
        coarse = measure_fibrosis(surface, "LGE", rule, given_blood_pool(100.0, 2.0))
        assert coarse.sampled_mm is None
        if points == 3000:
            assert max(coarse.part("region", r).beyond_percent - 100.0 * truth[r] for r in truth) > 1.0


def test_scar_in_regions_of_the_map_is_what_the_phantom_has_in_them():
    phantom = make_phantom(5000)
    image = Volume.from_image(make_lge_volume(phantom.shape, noise=2.0, margin=4.0))
    surface = project(phantom.surface, image).on(phantom.surface)
    flat_map = flatten(surface, phantom.seeds)
    parcels = {"halves": ((flat_map.regions <= 2).astype(int), {1: "low"})}
    pool = given_blood_pool(100.0, 2.0)
    found = measure_fibrosis(flat_map, "LGE", Rule.parse("iir=1.2"), pool, volume=image, parcels=parcels)
    triangles = surface.points[flat_map.triangles]
    k = np.arange(6)
    places = np.array([(a + 1 / 3, b + 1 / 3, 6 - a - b - 2 / 3) for a in k for b in k if a + b < 6]) / 6.0
    points = np.einsum("sj,mjd->msd", places, triangles)
    scar = phantom.shape.scar(points.reshape(-1, 3)).reshape(points.shape[:2]).mean(axis=1)
    areas = surface.with_triangles(flat_map.triangles).triangle_areas
    for region in range(1, 6):
        own = flat_map.regions == region
        truth = 100.0 * float(scar[own] @ areas[own] / areas[own].sum())
        assert found.part("region", region).beyond_percent == pytest.approx(truth, abs=1.0)
    low = sum(found.part("region", region).class_cm2[1] for region in (1, 2))
    assert found.part("halves", 1).class_cm2[1] == pytest.approx(low)


def test_an_image_that_the_array_is_not_of_is_not_sampled(phantom):
    image = Volume.from_image(make_lge_volume(phantom.shape, spacing=(2.0, 2.0, 2.0), margin=4.0))
    other = replace(image, values=image.values * 1.1)
    surface = project(phantom.surface, image).on(phantom.surface)
    rule = Rule("value", (120.0,))
    alone = measure_fibrosis(surface, "LGE", rule)
    for atrium, volume in ((surface, other), (phantom.surface, image)):
        found = measure_fibrosis(atrium, "LGE", rule, volume=volume)
        assert found.sampled_mm is None
    assert measure_fibrosis(surface, "LGE", rule, volume=other).parts == alone.parts
    assert measure_fibrosis(surface, "LGE", rule, volume=image).parts != alone.parts


def test_parts_add_up_to_the_whole(phantom, phantom_map):
    segments = Parcellation.load("segments_24")
    labels = segments.labels_of(phantom_map).cells
    found = measure_fibrosis(
        phantom_map, "LGE", Rule("value", (110.0, 130.0, 150.0)), parcels={"segments": (labels, segments.names)}
    )
    assert found.class_names == ("normal", "class 1", "class 2", "class 3")
    assert len(found.parts) == 1 + 5 + 24
    for group in ("region", "segments"):
        parts = [part for part in found.parts if part.group == group]
        assert np.allclose(np.sum([part.class_cm2 for part in parts], axis=0), found.atrium.class_cm2)
    assert sum(found.atrium.class_cm2) == pytest.approx(phantom.surface.area / 100.0)
    assert sum(found.atrium.class_percent) == pytest.approx(100.0)


def test_map_map_file_and_atrium_give_the_same(phantom_map, tmp_path):
    write_surface(phantom_map.to_surface(), tmp_path / "map.vtp")
    atrium = phantom_map.surface.with_data(cell_data={"region": phantom_map.regions})
    results = [
        measure_fibrosis(one, "LGE", Rule("value", (120.0,))).to_dict()["parts"]
        for one in (phantom_map, read_surface(tmp_path / "map.vtp"), atrium)
    ]
    assert results[0] == results[1] == results[2]
    flat = phantom_map.to_surface()
    bare = Surface(flat.points, flat.triangles, {"LGE": flat.point_data["LGE"]}, {}, flat.field_data, "RAS")
    with pytest.raises(SurfaceError, match="position_mm"):
        measure_fibrosis(bare, "LGE", Rule("value", (120.0,)))


def test_triangles_without_a_value_are_left_out_and_counted(phantom):
    values = phantom.surface.point_data["LGE"].copy()
    lost = np.zeros(len(values), bool)
    lost[phantom.surface.points[:, 2] > 90.0] = True
    values[lost] = np.nan
    surface = with_regions(phantom, LGE=values)
    found = measure_fibrosis(surface, "LGE", Rule("value", (120.0,)))
    out = lost[surface.triangles].any(axis=1)
    assert found.atrium.missing_triangles == np.count_nonzero(out) > 50
    assert found.atrium.missing_cm2 == pytest.approx(surface.triangle_areas[out].sum() / 100.0)
    assert found.atrium.area_cm2 == pytest.approx(surface.triangle_areas[~out].sum() / 100.0)
    part, _ = phantom.surface.submesh(~out)
    assert np.allclose(found.atrium.class_cm2, measure_fibrosis(part, "LGE", Rule("value", (120.0,))).atrium.class_cm2)
    assert f"{np.count_nonzero(out)} triangles" in found.notes[0]


def test_a_part_without_values_has_no_percentage(phantom):
    values = np.full(len(phantom.surface.triangles), 5.0)
    values[phantom.surface.cell_data["true_region"] == 3] = np.nan
    surface = phantom.surface.with_data(cell_data={"v": values, "region": phantom.surface.cell_data["true_region"]})
    found = measure_fibrosis(surface, "v", Rule("value", (4.0,)))
    assert found.part("region", 1).beyond_percent == pytest.approx(100.0)
    assert np.isnan(found.part("region", 3).beyond_percent)
    text = json.dumps(found.to_dict(), allow_nan=False)
    assert json.loads(text)["parts"][3]["beyond_percent"] is None
    rows = list(csv.DictReader(io.StringIO(found.to_csv())))
    assert [row["beyond_percent"] for row in rows[1:4]] == ["100.0000", "100.0000", ""]
    assert float(rows[3]["missing_cm2"]) > 1.0


# ---- rules -----------------------------------------------------------------------------------------------------------


def test_rules_and_labels_of_classes(phantom):
    pool = BloodPool(100.0, 8.0, "test")
    assert Rule.parse("sd=2,3.3").thresholds(pool) == pytest.approx((116.0, 126.4))
    assert Rule.parse(" iir = 0.97").thresholds(pool) == pytest.approx((97.0,))
    found = measure_fibrosis(phantom.surface, "LGE", Rule.parse("iir=1.2,1.32"), pool)
    assert [found.class_label(k) for k in range(3)] == [
        "normal (< 120)",
        "border zone (120 to 132)",
        "dense fibrosis (≥ 132)",
    ]
    low = measure_fibrosis(
        phantom.surface, "LGE", Rule.parse("value=0.5,0.1", "below"), unit="mV", class_names=("a", "b", "c")
    )
    assert [low.class_label(k) for k in range(3)] == ["a (≥ 0.5 mV)", "b (0.1 to 0.5 mV)", "c (< 0.1 mV)"]


@pytest.mark.parametrize(
    ("text", "direction", "words"),
    [
        ("iir=1.32,1.2", "above", "out of order.*rising.*iir=1.2,1.32"),
        ("value=120,120", "above", "each once"),
        ("value=0.5,0.1", "above", 'choose the direction "below" if low values'),
        ("value=0.1,0.5", "below", "falling.*value=0.5,0.1"),
        ("otsu=1", "above", 'found "otsu"'),
        ("iir", "above", "rule like iir"),
        ("sd=two", "above", "rule like iir"),
        ("sd=nan", "above", "Expected numbers"),
        ("sd=2", "beside", "above"),
    ],
)
def test_bad_rules_are_refused(text, direction, words):
    with pytest.raises(LAFlatteningError, match=words):
        Rule.parse(text, direction)


def test_rules_that_mean_nothing_for_a_blood_pool_are_refused(phantom):
    with pytest.raises(LAFlatteningError, match="not known"):
        measure_fibrosis(phantom.surface, "LGE", Rule.parse("iir=1.2"))
    with pytest.raises(LAFlatteningError, match="shifted"):
        Rule.parse("iir=1.2").thresholds(given_blood_pool(-0.2, 0.1))
    with pytest.raises(LAFlatteningError, match="standard deviation 0"):
        Rule.parse("sd=2").thresholds(given_blood_pool(100.0, 0.0))
    with pytest.raises(LAFlatteningError, match="0 or more"):
        given_blood_pool(100.0, -1.0)


def test_low_voltages_are_diseased_without_being_told(phantom, phantom_map, tmp_path):
    surface = with_regions(phantom, Bipolar=0.5 + (120.0 - phantom.surface.point_data["LGE"]) / 50.0)
    share = measure_fibrosis(surface, "LGE", Rule("value", (120.0,))).atrium.beyond_percent
    write_surface(surface, tmp_path / "atrium.vtp")
    command = ("fibrosis", str(tmp_path / "atrium.vtp"), "--array", "Bipolar", "--output", str(tmp_path / "f.json"))
    assert main([*command, "--rule", "value=0.5,0.1"]) == 0
    found = json.loads((tmp_path / "f.json").read_text())
    assert (found["direction"], found["unit"], found["notes"]) == ("below", "mV", [])
    assert found["parts"][0]["beyond_percent"] == pytest.approx(share, abs=1e-6)
    assert main([*command, "--rule", "value=0.5", "--direction", "above"]) == 0
    found = json.loads((tmp_path / "f.json").read_text())
    assert "other side" in found["notes"][0]
    assert found["parts"][0]["beyond_percent"] == pytest.approx(100.0 - share, abs=1e-6)
    late = measure_fibrosis(
        phantom.surface.with_data({"LAT": phantom.surface.points[:, 0]}), "LAT", Rule("value", (9.0,))
    )
    assert late.class_names == ("normal", "class 1")
    with pytest.raises(LAFlatteningError, match="Bipolar is in mV"):
        measure_fibrosis(surface, "Bipolar", Rule("iir", (1.2,)), BloodPool(100.0, 8.0, "test"))


@pytest.mark.parametrize("limits", [(1.2, 1.32), (500.0,)])
def test_thresholds_that_no_value_crosses_are_noted(phantom, limits):
    assert measure_fibrosis(phantom.surface, "LGE", Rule("value", (120.0,))).notes == ()
    note = measure_fibrosis(phantom.surface, "LGE", Rule("value", limits)).notes[0]
    assert "(100 to 170) are on one side" in note


def test_arrays_that_cannot_be_measured_are_refused(phantom):
    surface, rule = phantom.surface, Rule("value", (1.0,))
    with pytest.raises(LAFlatteningError, match='no array "MIP"; found LGE, scar'):
        measure_fibrosis(surface, "MIP", rule)
    nothing = surface.with_data({"v": np.full(len(surface.points), np.nan), "xyz": surface.points})
    with pytest.raises(LAFlatteningError, match="no value in any triangle"):
        measure_fibrosis(nothing, "v", rule)
    with pytest.raises(LAFlatteningError, match="single numbers"):
        measure_fibrosis(nothing, "xyz", rule)
    with pytest.raises(LAFlatteningError, match="2 names of classes, found 1"):
        measure_fibrosis(surface, "LGE", rule, class_names=("one",))
    for names in (("same", "same"), ("normal", "")):
        with pytest.raises(LAFlatteningError, match="names of classes that differ, none empty"):
            measure_fibrosis(surface, "LGE", rule, class_names=names)
    with pytest.raises(LAFlatteningError, match="one for each triangle"):
        measure_fibrosis(surface, "LGE", rule, parcels={"p": (np.zeros(3, np.int64), {1: "a"})})


# ---- the blood pool --------------------------------------------------------------------------------------------------


def test_blood_is_found_inside_the_chamber(phantom, image):
    pool = find_blood_pool(phantom.surface, image)
    assert pool.mean == pytest.approx(LgeModel().blood, abs=0.2)
    assert pool.sd == pytest.approx(NOISE, rel=0.03)
    places = pool.region.positions(np.argwhere(pool.region.values == 1)[:, ::-1].astype(float))
    distance, _ = phantom.shape._nearest(places)
    # The covers of the rims are nearer than the phantom's long veins; the mesh is within 0.1 mm of the shape.
    assert distance.max() < -(pool.depth_mm - 0.7 * image.spacing.max())
    assert pool.volume_ml == pytest.approx(len(places) * image.voxel_volume / 1000.0, rel=0.01)
    # A sphere less 5 mm on all sides, and the valve's cap.
    assert 0.8 < pool.volume_ml * 1000.0 / (4 / 3 * np.pi * (phantom.shape.radius - 5.0) ** 3) < 1.0
    assert np.linalg.norm(pool.centre_mm - phantom.shape.centre) < 6.0
    assert json.loads(json.dumps(pool.to_dict()))["depth_mm"] == 5.0


def test_blood_is_the_same_in_other_axes_and_orientations(phantom, image):
    expected = find_blood_pool(phantom.surface, image)
    ras = Surface(phantom.surface.points * (-1.0, -1.0, 1.0), phantom.surface.triangles[:, ::-1], space="RAS")
    turned = Volume(
        np.flip(image.values, 2),
        image.spacing,
        image.origin + np.array([image.spacing[0] * (image.values.shape[2] - 1), 0.0, 0.0]),
        image.direction * np.array([-1.0, 1.0, 1.0]),
    )
    found = find_blood_pool(ras, turned)
    assert found.mean == pytest.approx(expected.mean, abs=0.02)
    assert found.voxels == pytest.approx(expected.voxels, rel=0.002)
    assert np.allclose(found.centre_mm, expected.centre_mm, atol=0.05)


def test_outliers_are_no_blood(phantom, image):
    values = image.values.copy()
    random = np.random.default_rng(0)
    values[random.random(values.shape) < 0.02] = 2000.0
    found = find_blood_pool(phantom.surface, Volume(values, image.spacing, image.origin, image.direction))
    assert found.mean == pytest.approx(100.0, abs=0.5)
    assert found.sd == pytest.approx(NOISE, rel=0.05)


def test_blood_of_a_drawn_region(phantom, image):
    spacing, centre = np.array([2.0, 2.0, 2.0]), np.array(phantom.shape.centre)
    labels = np.zeros((10, 10, 10), np.uint8)
    labels[2:8, 2:8, 2:8] = 3
    drawn = Volume(labels, spacing, centre - 9.0, np.eye(3))
    pool = blood_pool_of_labels(image, drawn, 3)
    assert pool.mean == pytest.approx(100.0, abs=2.0)
    assert pool.volume_ml == pytest.approx(pool.voxels * 8.0 / 1000.0)
    assert np.allclose(pool.centre_mm, centre, atol=0.01)
    with pytest.raises(LAFlatteningError, match=r"no voxel with the number 2 \(found 0, 3\)"):
        blood_pool_of_labels(image, drawn, 2)
    with pytest.raises(LAFlatteningError, match="216 voxels, of which 0 lie in the"):
        blood_pool_of_labels(image, Volume(labels, spacing, centre + 500.0, np.eye(3)))


def test_an_empty_blood_pool_is_refused(phantom, image):
    far = Volume(image.values, image.spacing, image.origin + 500.0, image.direction)
    with pytest.raises(LAFlatteningError, match=r"no blood pool.*no voxels inside"):
        find_blood_pool(phantom.surface, far)
    coarse = Volume(image.values[::20, ::30, ::30], image.spacing * (30, 30, 20), image.origin, image.direction)
    with pytest.raises(LAFlatteningError, match="no blood pool"):
        find_blood_pool(phantom.surface, coarse)


def test_blood_of_an_image_that_shows_nothing_is_refused(phantom, image):
    blank = Volume(np.full_like(image.values, 7.0), image.spacing, image.origin, image.direction)
    with pytest.raises(InputFileError, match="7 everywhere"):
        find_blood_pool(phantom.surface, blank)


def test_blood_of_a_part_of_the_chamber_says_so_and_of_a_corner_is_refused(phantom, image):
    z = phantom.surface.points[:, 2]
    index = (np.percentile(z, [8, 50]) - image.origin[2]) / image.spacing[2]
    some, half = (Volume(image.values[: int(last) + 1], image.spacing, image.origin, image.direction) for last in index)
    assert 45.0 < float(re.search(r"reaches (\d+) %", find_blood_pool(phantom.surface, half).how)[1]) < 55.0
    assert "reaches" not in find_blood_pool(phantom.surface, image).how
    with pytest.raises(LAFlatteningError, match=r"reaches \d % of the chamber.*axes"):
        find_blood_pool(phantom.surface, some)


def test_a_ratio_to_shifted_intensities_is_refused(phantom, image):
    shifted = Volume(image.values - 60.0, image.spacing, image.origin, image.direction)
    pool = find_blood_pool(phantom.surface, shifted)
    assert pool.mean > 0.0
    with pytest.raises(LAFlatteningError, match="rule sd"):
        Rule.parse("iir=1.2").thresholds(pool)
    assert Rule.parse("sd=2").thresholds(pool)[0] == pytest.approx(40.0 + 2 * NOISE, abs=0.6)


def test_blood_of_a_real_atrium(data_dir):
    from LAFlatteningLib.cavity.label_surface import label_surface
    from LAFlatteningLib.files import read_volume

    folder = data_dir / "stacom2018"
    image, mask = (read_volume(folder / f"BYSRS_{what}.nrrd") for what in ("lgemri_norm", "laendo"))
    pool = find_blood_pool(label_surface(mask).surface, image)
    inside = image.values[mask.values > 0]
    # The middle of the chamber is like most of it, and more even than all of it.
    assert abs(pool.mean - np.median(inside)) < 0.5 * inside.std()
    assert pool.sd < inside.std()
    assert pool.volume_ml < np.count_nonzero(mask.values) * mask.voxel_volume / 1000.0
