"""Maps compared: a map with itself, remeshed, changed in a known place; weights, ranks, missing values, bad input."""

import json

import numpy as np
import pytest
from scipy.stats import pearsonr, spearmanr

from LAFlatteningLib.comparison import compare_maps, weighted_correlation, weighted_ranks
from LAFlatteningLib.errors import LAFlatteningError, TemplateError
from LAFlatteningLib.files import read_surface, write_surface
from LAFlatteningLib.flattening import flatten
from LAFlatteningLib.map_data import MapData
from LAFlatteningLib.phantom import make_phantom


def pattern(points):
    """A smooth quantity of places in space, mm."""
    x, y, z = points.T / 15.0
    return 100.0 + 20.0 * np.sin(x + 0.5 * z) + 15.0 * np.cos(1.3 * y - z)


def with_array(flat_map, name, values):
    data = MapData.of(flat_map)
    return MapData(data.surface.with_data({name: values}), data.flat, data.template)


# ---- statistics ------------------------------------------------------------------------------------------------------


def test_weighted_statistics_are_those_of_repeated_values():
    random = np.random.default_rng(2)
    x = random.integers(0, 12, 80).astype(float)
    y = x + random.integers(-6, 7, 80)
    times = random.integers(1, 6, 80)
    weights = 0.3 * times
    long_x, long_y = np.repeat(x, times), np.repeat(y, times)
    assert weighted_correlation(x, y, weights) == pytest.approx(pearsonr(long_x, long_y)[0], abs=1e-12)
    ranked = weighted_correlation(weighted_ranks(x, weights), weighted_ranks(y, weights), weights)
    assert ranked == pytest.approx(spearmanr(long_x, long_y)[0], abs=1e-12)


def test_rounding_does_not_make_ranks():
    values = np.array([1.0, 1.0 + 1e-15, 1.0 - 1e-15, 2.0])
    assert len(np.unique(weighted_ranks(values, np.ones(4)))) == 2
    assert weighted_ranks(np.full(3, 4.0), np.ones(3)).tolist() == [0.5, 0.5, 0.5]
    assert np.isnan(weighted_correlation(np.full(3, 4.0), np.arange(3.0), np.ones(3)))


# ---- maps ------------------------------------------------------------------------------------------------------------


def test_a_map_agrees_with_itself(phantom_map):
    found = compare_maps(phantom_map, phantom_map, "LGE", "LGE", 120.0, 120.0)
    for part in found.parts:
        assert part.pearson == pytest.approx(1.0, abs=1e-12)
        assert part.spearman == pytest.approx(1.0, abs=1e-12)
        assert part.dice == pytest.approx(1.0, abs=1e-12)
        assert part.percent_a == part.percent_b
        assert part.missing_percent == 0.0
    assert np.abs(found.difference).max() <= 1e-12
    assert found.notes == ()


def test_areas_and_means_are_those_on_the_atrium(phantom_map):
    """The map enlarges and shrinks: only with weights do places of the map stand for area."""
    found = compare_maps(phantom_map, phantom_map, "LGE", "LGE", 120.0, 120.0)
    surface, regions = phantom_map.surface, phantom_map.regions
    mean = surface.point_data["LGE"][surface.triangles].mean(axis=1)
    assert found.whole.area_cm2 == pytest.approx(surface.area / 100.0, rel=0.002)
    assert found.whole.mean_a == pytest.approx(mean @ surface.triangle_areas / surface.area, rel=0.002)
    for part in found.parts[1:]:
        own = regions == part.region
        assert part.area_cm2 == pytest.approx(surface.triangle_areas[own].sum() / 100.0, rel=0.03)
    assert sum(part.area_cm2 for part in found.parts[1:]) == pytest.approx(found.whole.area_cm2)


def test_two_meshes_of_one_atrium_agree(phantom_map):
    other = make_phantom(3500)
    fine = with_array(flatten(other.surface, other.seeds), "p", pattern(other.surface.points))
    coarse = with_array(phantom_map, "p", pattern(phantom_map.surface.points))
    found = compare_maps(coarse, fine, "p", "p", 105.0, 105.0)
    for part in found.parts:
        assert part.pearson > 0.99
        assert part.spearman > 0.99
        assert part.dice > 0.97 or np.isnan(part.dice)
    assert abs(found.whole.difference) < 0.2
    # Different meshes do not reach the rims alike; hardly anything is lost there.
    assert found.whole.missing_percent < 0.3


def test_a_patch_is_found_where_it_was_put(phantom_map):
    surface = phantom_map.surface
    before = np.full(len(surface.points), 100.0)
    place = np.argmin(np.linalg.norm(phantom_map.points - (0.05, 0.25), axis=1))
    near = np.linalg.norm(surface.points - surface.points[place], axis=1)
    after = np.where(near < 9.0, 150.0, 100.0)
    found = compare_maps(
        with_array(phantom_map, "v", before), with_array(phantom_map, "v", after), "v", "v", 125.0, 125.0
    )
    changed = found.difference > 25.0
    centre = np.average(found.places[changed], axis=0, weights=found.weights[changed])
    assert np.linalg.norm(centre - phantom_map.points[place]) < 0.02
    assert found.weights[changed].sum() == pytest.approx(np.pi * 9.0**2, rel=0.15)
    assert found.difference.max() == pytest.approx(50.0)
    assert set(found.regions[changed]) == {4}
    assert found.whole.percent_a == 0.0
    assert found.whole.dice == 0.0
    assert np.isnan(found.whole.pearson)
    assert found.parts[5].difference_rms == 0.0
    picture = found.picture(found.difference)
    row, column = np.unravel_index(np.nanargmax(picture), picture.shape)
    assert near[np.argmin(np.linalg.norm(phantom_map.points - (np.array([column, row]) + 0.5) / 512 + 0.5, axis=1))] < 9


def test_quantities_that_cannot_be_subtracted_are_compared_by_rank(phantom_map):
    values = pattern(phantom_map.surface.points)
    both = with_array(with_array(phantom_map, "LGE", values), "voltage", np.exp(-values / 20.0))
    found = compare_maps(both, both, "LGE", "voltage", direction_b="above")
    assert found.scale == "ranks"
    assert found.whole.spearman == pytest.approx(-1.0, abs=1e-5)
    assert found.whole.pearson > -1.0 + 1e-3
    a, b = found.scaled
    # Opposite orders, as far as both are linear in a triangle.
    assert np.abs(a + b - 100.0).max() < 3.0
    assert 0.0 <= a.min() < 0.1 and 99.9 < a.max() <= 100.0
    # Low voltage is diseased: then the two say the same, and overlap.
    limits = np.percentile(values, 80), np.exp(-np.percentile(values, 80) / 20.0)
    alike = compare_maps(both, both, "LGE", "voltage", *limits)
    assert (alike.direction_a, alike.direction_b) == ("above", "below")
    assert np.abs(alike.difference).max() < 3.0
    assert alike.whole.spearman == found.whole.spearman
    assert alike.whole.dice > 0.97
    same = compare_maps(both, both, "LGE", "voltage", scale="values")
    assert same.whole.difference == pytest.approx(same.whole.mean_b - same.whole.mean_a)


def test_places_without_a_value_are_left_out_and_counted(phantom_map):
    surface = phantom_map.surface
    values = surface.point_data["LGE"].copy()
    lost = surface.points[:, 2] > 95.0
    values[lost] = np.nan
    found = compare_maps(with_array(phantom_map, "LGE", values), phantom_map, "LGE", "LGE", 120.0, 120.0)
    out = lost[surface.triangles].any(axis=1)
    share = 100.0 * surface.triangle_areas[out].sum() / surface.area
    assert found.whole.missing_percent == pytest.approx(share, abs=0.1)
    assert f"{found.whole.missing_percent:.1f} %" in found.notes[0]
    assert found.whole.pearson == pytest.approx(1.0, abs=1e-12)
    assert np.isnan(found.difference).sum() == len(found.places) - found.whole.places
    json.dumps(found.to_dict(), allow_nan=False)


def test_overlap_of_classes_below_thresholds(phantom_map):
    surface = phantom_map.surface
    x = surface.points[:, 0]
    left, right = np.median(x) - 5.0, np.median(x) + 5.0
    found = compare_maps(
        with_array(phantom_map, "x", x), with_array(phantom_map, "x", x), "x", "x", left, right, "below", "below"
    )
    a, b = found.whole.percent_a, found.whole.percent_b
    assert 0.0 < a < b < 100.0
    # The smaller lies within the larger.
    assert found.whole.dice == pytest.approx(2 * a / (a + b))


def test_files_compare_as_maps_do(phantom_map, tmp_path):
    write_surface(phantom_map.to_surface(), tmp_path / "map.vtp")
    again = read_surface(tmp_path / "map.vtp")
    assert np.abs(compare_maps(phantom_map, again, "LGE", "LGE").difference).max() < 1e-9


def test_what_says_nothing_is_noted(phantom_map):
    values = pattern(phantom_map.surface.points)
    assert compare_maps(phantom_map, phantom_map, "LGE", "LGE").notes == ()
    same = compare_maps(phantom_map, with_array(phantom_map, "v", np.full(len(values), 5.0)), "LGE", "v")
    assert any("v of B is 5 everywhere" in note for note in same.notes)
    a, b = with_array(phantom_map, "v", values), with_array(phantom_map, "v", 1000.0 + values)
    assert "no values in common" in compare_maps(a, b, "v", "v").notes[0]
    ranks = compare_maps(a, b, "v", "v", scale="ranks")
    assert ranks.notes == ()
    # Percentiles are of the whole map, so that their mean is the same on both.
    other = with_array(phantom_map, "w", np.sin(values))
    assert compare_maps(a, other, "v", "w").whole.difference == 0.0


# ---- bad input -------------------------------------------------------------------------------------------------------


def test_maps_that_cannot_be_compared_are_refused(phantom, phantom_map):
    other = flatten(phantom.surface, phantom.seeds, "population")
    with pytest.raises(TemplateError, match="adapted1 and population"):
        compare_maps(phantom_map, other, "LGE", "LGE")
    with pytest.raises(LAFlatteningError, match='no array "MIP"'):
        compare_maps(phantom_map, phantom_map, "LGE", "MIP")
    with pytest.raises(LAFlatteningError, match="Give both, or none"):
        compare_maps(phantom_map, phantom_map, "LGE", "LGE", 120.0)
    for thresholds in ((np.nan, 120.0), (120.0, np.inf)):
        with pytest.raises(LAFlatteningError, match="thresholds that are numbers"):
            compare_maps(phantom_map, phantom_map, "LGE", "LGE", *thresholds)
    with pytest.raises(LAFlatteningError, match='"auto", "values" or "ranks"'):
        compare_maps(phantom_map, phantom_map, "LGE", "LGE", scale="log")
    values = phantom_map.surface.points[:, 0]
    halves = [with_array(phantom_map, "v", np.where((values > 0.0) == side, 1.0, np.nan)) for side in (True, False)]
    with pytest.raises(LAFlatteningError, match="hardly any value at a common place"):
        compare_maps(*halves, "v", "v")
