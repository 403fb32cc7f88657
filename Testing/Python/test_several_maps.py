"""Three maps or more: agreement of each pair, mean and spread, what is left out, bad input, the command."""

import csv
import json

import numpy as np
import pytest

from LAFlatteningLib.cli import main
from LAFlatteningLib.cli.compare import names_of
from LAFlatteningLib.comparison import compare_maps
from LAFlatteningLib.errors import LAFlatteningError, TemplateError
from LAFlatteningLib.files import write_surface
from LAFlatteningLib.flattening import flatten
from LAFlatteningLib.map_data import MapData
from LAFlatteningLib.several_maps import MATRICES, compare_several


def with_array(flat_map, name, values):
    data = MapData.of(flat_map)
    return MapData(data.surface.with_data({name: values}), data.flat, data.template, data.method)


@pytest.fixture(scope="module")
def shifted(phantom_map):
    """Three maps of one atrium whose values are x, x + 3 and x + 9: mean x + 4, SD sqrt(21)."""
    x = phantom_map.surface.points[:, 0]
    return [with_array(phantom_map, "x", x + add) for add in (0.0, 3.0, 9.0)]


def test_mean_and_spread_of_shifted_maps(shifted):
    found = compare_several(shifted, "abc", "x")
    known = np.isfinite(found.mean)
    assert np.allclose(found.mean[known], found.values[0][known] + 4.0)
    assert np.allclose(found.sd[known], np.sqrt(21.0))
    for part in found.parts:
        assert part.sd == pytest.approx(np.sqrt(21.0))
        assert np.diff(part.means) == pytest.approx([3.0, 6.0])
        assert part.mean == pytest.approx(part.means[0] + 4.0)
    assert found.matrix("difference") == pytest.approx(np.array([[0, 3, 9], [-3, 0, 6], [-9, -6, 0]]))
    assert found.matrix("pearson") == pytest.approx(np.ones((3, 3)))


def test_each_pair_is_what_two_maps_give(phantom_map, shifted):
    noisy = with_array(phantom_map, "x", np.random.default_rng(4).normal(size=len(phantom_map.points)) * 20.0)
    maps = [shifted[0], noisy, shifted[2]]
    found = compare_several(maps, "abc", "x", 5.0)
    for (a, b), pair in found.pairs.items():
        alone = compare_maps(maps[a], maps[b], "x", "x", 5.0, 5.0)
        assert pair.parts == alone.parts
        for name in MATRICES:
            assert found.matrix(name)[a, b] == getattr(alone.whole, name)
    assert sorted(found.pairs) == [(0, 1), (0, 2), (1, 2)]


def test_places_without_a_value_on_one_map_are_left_out_and_counted(phantom_map, shifted):
    x = phantom_map.surface.points[:, 0]
    holed = with_array(phantom_map, "x", np.where(x > 0.0, x, np.nan))
    found = compare_several([*shifted, holed], "abcd", "x")
    surface = phantom_map.surface
    half = surface.triangle_areas[(x[surface.triangles] <= 0.0).any(axis=1)].sum() / surface.area
    assert found.parts[0].missing_percent == pytest.approx(100.0 * half, abs=0.5)
    # Pairs of maps that have the value are whole.
    assert found.pairs[0, 1].whole.missing_percent == 0.0
    assert "were left out of the mean" in found.notes[0]


def test_different_methods_are_noted_and_different_templates_refused(phantom, phantom_map):
    paper = flatten(phantom.surface, phantom.seeds, method="paper")
    found = compare_several([phantom_map, phantom_map, paper], "abc", "LGE")
    assert found.methods == ("regional", "regional", "paper")
    assert "different methods (paper and regional)" in found.notes[0]
    assert "different methods" in compare_maps(phantom_map, paper, "LGE", "LGE").notes[0]
    other = flatten(phantom.surface, phantom.seeds, "population")
    with pytest.raises(TemplateError, match="adapted1 and population"):
        compare_several([phantom_map, phantom_map, other], "abc", "LGE")


def test_bad_input(shifted):
    with pytest.raises(LAFlatteningError, match="3 maps or more"):
        compare_several(shifted[:2], "ab", "x")
    with pytest.raises(LAFlatteningError, match="a name of its own"):
        compare_several(shifted, "aba", "x")
    with pytest.raises(LAFlatteningError, match='no array "y"'):
        compare_several(shifted, "abc", "y")


def test_units_that_differ_are_not_subtracted(phantom_map):
    x = phantom_map.surface.points[:, 0]
    both = with_array(with_array(phantom_map, "LAT", x), "Bipolar", np.abs(x))
    with pytest.raises(LAFlatteningError, match=r'"LAT" \(ms\) and "Bipolar" \(mV\) have different units'):
        compare_maps(both, both, "LAT", "Bipolar", scale="values")
    found = compare_maps(both, both, "LAT", "Bipolar")
    assert found.scale == "ranks"
    assert "ranks" in found.notes[0]


def test_names_tell_files_apart():
    assert names_of(["p/a/map.vtp", "p/b/map.vtp", "p/c.vtp"]) == ["a/map.vtp", "b/map.vtp", "p/c.vtp"]
    assert names_of(["p/c.vtp", "p/c.vtp"]) == ["c.vtp (1)", "c.vtp (2)"]


def test_the_command_writes_all_files(phantom_map, tmp_path, capsys):
    for number in range(4):
        twice = phantom_map.surface.point_data["LGE"] * (1.0 + 0.1 * number)
        write_surface(phantom_map.to_surface().with_data({"LGE": twice}), tmp_path / f"{number}.vtp")
    files = [str(tmp_path / f"{number}.vtp") for number in range(4)]
    output = tmp_path / "out"
    output.mkdir()
    (output / "difference.png").write_bytes(b"of an earlier comparison of two")
    assert main(["compare", *files, "--array", "LGE", "--threshold", "120", "--output", str(output)]) == 0
    assert sorted(path.name for path in output.iterdir()) == [
        "comparison.csv", "comparison.json", "comparison.png", "mean.png",
    ]  # fmt: skip
    found = json.loads((output / "comparison.json").read_text())
    assert found["maps"] == ["0.vtp", "1.vtp", "2.vtp", "3.vtp"]
    assert found["matrices"]["pearson"][1][3] == pytest.approx(1.0)
    assert found["matrices"]["dice"][0][3] < found["matrices"]["dice"][0][1] < 1.0
    rows = list(csv.DictReader((output / "comparison.csv").open()))
    assert len(rows) == 6 * 6
    assert "SD between the maps" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--array-a", "LGE", "--array-b", "LGE"), "Give --array"),
        ((), "give --array NAME"),
        (("--array", "LGE", "--scale", "ranks"), "two maps only"),
        (("--array", "LGE", "--threshold-a", "1", "--threshold-b", "1"), "Give --threshold"),
    ],
)
def test_choices_that_do_not_fit_more_than_two_maps(phantom_map, tmp_path, options, words, capsys):
    write_surface(phantom_map.to_surface(), tmp_path / "m.vtp")
    assert main(["compare", *[str(tmp_path / "m.vtp")] * 3, *options, "--output", str(tmp_path / "out")]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
