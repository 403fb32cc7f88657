"""The commands project, fibrosis and compare: files in, files out, and bad input with its message."""

import csv
import json

import numpy as np
import pytest
import SimpleITK as sitk

from LAFlatteningLib import read_surface, write_surface
from LAFlatteningLib.analysis_figures import class_paint, make_comparison_figure
from LAFlatteningLib.cli import main
from LAFlatteningLib.comparison import compare_maps
from LAFlatteningLib.fibrosis import Rule, measure_fibrosis
from LAFlatteningLib.phantom import make_lge_volume


@pytest.fixture(scope="module")
def image(phantom, tmp_path_factory):
    path = tmp_path_factory.mktemp("image") / "lge.nrrd"
    sitk.WriteImage(make_lge_volume(phantom.shape, spacing=(1.2, 1.2, 1.5), noise=3.0), str(path))
    return path


@pytest.fixture
def files(tmp_path, phantom, phantom_map):
    write_surface(phantom.surface, tmp_path / "atrium.vtp")
    write_surface(phantom_map.to_surface(), tmp_path / "map.vtp")
    return tmp_path


def call(*arguments):
    return main([str(argument) for argument in arguments])


def test_project_writes_the_array_and_says_what_it_did(files, image, capsys):
    assert call("project", files / "atrium.vtp", "--volume", image, "--output", files / "out.vtp") == 0
    surface = read_surface(files / "out.vtp")
    assert surface.point_data["LGE"].max() > 150.0
    assert surface.field_data["LGE_interval_mm"].tolist() == [-3.0, 3.0]
    assert "max from -3 to 3 mm" in capsys.readouterr().out
    options = ("--depth", 2, "--side", "in", "--statistic", "mean", "--array", "blood")
    assert call("project", files / "out.vtp", "--volume", image, *options, "--output", files / "out2.vtp") == 0
    again = read_surface(files / "out2.vtp")
    assert np.median(again.point_data["blood"]) == pytest.approx(98.0, abs=4.0)
    assert "LGE" in again.point_data


def test_fibrosis_writes_json_csv_and_figure(files, image, capsys):
    code = call(
        "fibrosis", files / "map.vtp", "--array", "LGE", "--rule", "iir=1.2,1.32", "--volume", image,
        "--parcellation", "vein_segments", "--parcellation", "vein_surroundings",
        "--output", files / "f.json", "--csv", files / "f.csv", "--figure", files / "f.png",
    )  # fmt: skip
    assert code == 0
    found = json.loads((files / "f.json").read_text())
    assert found["thresholds"] == pytest.approx([120.0, 132.0], rel=0.003)
    assert found["blood_pool"]["volume_ml"] > 30.0
    groups = [part["group"] for part in found["parts"]]
    assert groups[0] == "atrium" and groups[1:6] == ["region"] * 5
    assert groups.count("vein_segments") == 18
    assert "vein_surroundings_RSPV" in groups
    rows = list(csv.DictReader((files / "f.csv").open()))
    assert len(rows) == len(found["parts"])
    assert float(rows[0]["beyond_percent"]) == pytest.approx(found["parts"][0]["beyond_percent"], abs=1e-3)
    assert (files / "f.png").read_bytes().startswith(b"\x89PNG")
    out = capsys.readouterr().out
    assert "blood pool: mean 100" in out
    assert "mm LPS" in out


def test_fibrosis_of_an_atrium_without_a_map_and_without_an_image(files):
    code = call(
        "fibrosis", files / "atrium.vtp", "--array", "LGE", "--rule", "sd=2", "--blood-pool", "100,10",
        "--output", files / "f.json", "--figure", files / "f.png",
    )  # fmt: skip
    assert code == 0
    found = json.loads((files / "f.json").read_text())
    assert found["thresholds"] == [120.0]
    assert [part["group"] for part in found["parts"]] == ["atrium"]


def test_fibrosis_with_a_drawn_blood_pool(files, image, phantom):
    volume = sitk.ReadImage(str(image))
    labels = sitk.Image(volume.GetSize(), sitk.sitkUInt8)
    labels.CopyInformation(volume)
    i, j, k = volume.TransformPhysicalPointToIndex([float(x) for x in phantom.shape.centre])
    labels[i - 4 : i + 5, j - 4 : j + 5, k - 4 : k + 5] = 2
    sitk.WriteImage(labels, str(files / "labels.nrrd"))
    options = ("--volume", image, "--blood-pool-labels", files / "labels.nrrd", "--blood-pool-label", 2)
    command = ("fibrosis", files / "map.vtp", "--array", "LGE", "--rule", "iir=1.2", "--output", files / "f.json")
    assert call(*command, *options) == 0
    pool = json.loads((files / "f.json").read_text())["blood_pool"]
    assert pool["voxels"] == pytest.approx(729, abs=10)
    assert pool["mean"] == pytest.approx(100.0, abs=0.5)
    assert np.allclose(pool["centre_mm"], phantom.shape.centre, atol=0.8)


def test_bands_change_colour_at_the_thresholds(phantom_map):
    found = measure_fibrosis(phantom_map, "LGE", Rule("value", (110.0, 140.0)))
    paint = class_paint(phantom_map.surface, found)
    colours = paint.colours_of(np.array([0.0, 109.9, 110.1, 139.9, 140.1, 500.0, np.nan]))
    assert len(np.unique(colours, axis=0)) == 4
    for first, second in ((0, 1), (2, 3), (4, 5)):
        assert np.array_equal(colours[first], colours[second])
    low = measure_fibrosis(phantom_map, "LGE", Rule("value", (140.0, 110.0), "below"))
    mirrored = class_paint(phantom_map.surface, low).colours_of(np.array([500.0, 120.0, 0.0]))
    assert np.array_equal(mirrored, colours[[0, 2, 4]])


def test_compare_writes_all_files(files, phantom_map, capsys):
    twice = phantom_map.to_surface().with_data({"LGE": phantom_map.surface.point_data["LGE"] * 1.1})
    write_surface(twice, files / "after.vtp")
    command = ("compare", files / "map.vtp", files / "after.vtp", "--array-a", "LGE", "--array-b", "LGE")
    code = call(*command, "--threshold-a", 120, "--threshold-b", 132, "--output", files / "cmp")
    assert code == 0
    found = json.loads((files / "cmp" / "comparison.json").read_text())
    assert (found["a"], found["b"], found["scale"]) == ("map.vtp", "after.vtp", "values")
    whole = found["parts"][0]
    assert whole["pearson"] == pytest.approx(1.0)
    assert whole["dice"] == pytest.approx(1.0, abs=1e-6)
    assert whole["mean_b"] == pytest.approx(1.1 * whole["mean_a"])
    rows = list(csv.DictReader((files / "cmp" / "comparison.csv").open()))
    assert [row["region"] for row in rows] == ["0", "1", "2", "3", "4", "5"]
    for name in ("comparison.png", "difference.png"):
        assert (files / "cmp" / name).read_bytes().startswith(b"\x89PNG")
    assert "Pearson 1.000" in capsys.readouterr().out


def test_a_figure_of_a_constant_has_no_correlation(phantom_map):
    same = phantom_map.to_surface().with_data({"v": np.full(len(phantom_map.points), 5.0)})
    page = make_comparison_figure(compare_maps(phantom_map, same, "LGE", "v"))
    assert "Pearson r = -, Spearman rho = -" in page.texts[0].get_text()


PROJECT = ("project", "atrium.vtp", "--output", "out.vtp", "--volume")
FIBROSIS = ("fibrosis", "map.vtp", "--output", "f.json", "--array")
COMPARE = ("compare", "map.vtp", "map.vtp", "--output", "cmp")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((*PROJECT, "missing.nrrd"), "does not exist"),
        ((*PROJECT, "IMAGE", "--depth", "0"), "depth above 0 mm"),
        ((*PROJECT, "IMAGE", "--interval=3"), "--interval=-1,3"),
        ((*PROJECT, "IMAGE", "--interval=-1,3", "--depth", "3"), "takes the place"),
        (("project", "map.vtp", "--volume", "IMAGE", "--output", "out.vtp"), "looks like a map"),
        (("project", "atrium.vtp", "--volume", "IMAGE", "--output", "out.stl"), "lose arrays"),
        ((*FIBROSIS, "LGE", "--rule", "iir=1.2"), "--volume"),
        ((*FIBROSIS, "LGE", "--rule", "iir=1.32,1.2", "--volume", "IMAGE"), "out of order"),
        ((*FIBROSIS, "MIP", "--rule", "value=3"), 'no array "MIP"'),
        ((*FIBROSIS, "LGE", "--rule", "value=3", "--blood-pool", "1", "--volume", "IMAGE"), "leave out --volume"),
        ((*FIBROSIS, "LGE", "--rule", "sd=2", "--blood-pool", "100"), "two numbers"),
        ((*FIBROSIS, "LGE", "--rule", "value=3", "--blood-pool-labels", "IMAGE"), "give the image"),
        ((*FIBROSIS, "LGE", "--rule", "value=3", "--parcellation", "nothing"), "no parcellation"),
        ((*FIBROSIS, "LGE", "--rule", "value=3", "--csv", "f.json"), "given twice"),
        ((*COMPARE, "--array-a", "LGE", "--array-b", "MIP"), 'no array "MIP"'),
        ((*COMPARE, "--array-a", "LGE", "--array-b", "LGE", "--threshold-a", "1"), "Give both"),
        ((*COMPARE, "--array-a", "LGE", "--array-b", "LGE", "--template", "population"), "population was given"),
        (("compare", "map.vtp", "atrium.vtp", "--output", "cmp", "--array-a", "LGE", "--array-b", "LGE"), "not flat"),
    ],
)
def test_bad_input_gets_one_message_and_leaves_no_file(files, image, arguments, words, capsys, monkeypatch):
    monkeypatch.chdir(files)
    before = sorted(files.iterdir())
    assert call(*(image if argument == "IMAGE" else argument for argument in arguments)) == 2
    error = capsys.readouterr().err.strip()
    assert error.startswith("la-flatten: ")
    assert words in error
    assert "\n" not in error
    assert sorted(files.iterdir()) == before


def test_no_file_is_left_where_drawing_fails(files, monkeypatch):
    def fail(*_arguments, **_options):
        raise RuntimeError("no room")

    monkeypatch.setattr("LAFlatteningLib.cli.fibrosis.draw_fibrosis", fail)
    with pytest.raises(RuntimeError):
        call(
            "fibrosis", files / "map.vtp", "--array", "LGE", "--rule", "value=120",
            "--output", files / "f.json", "--csv", files / "f.csv", "--figure", files / "f.png",
        )  # fmt: skip
    assert sorted(path.name for path in files.iterdir()) == ["atrium.vtp", "map.vtp"]
