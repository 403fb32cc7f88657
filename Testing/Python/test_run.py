"""The command run: what it refuses before any work, and what it leaves where a later step fails."""

import json

import numpy as np
import pytest
import SimpleITK as sitk

from LAFlatteningLib.cli import main
from LAFlatteningLib.files import read_surface, write_surface
from LAFlatteningLib.flattening import flatten
from LAFlatteningLib.phantom import make_lge_volume


@pytest.fixture
def files(tmp_path, phantom, phantom_map):
    write_surface(phantom.surface, tmp_path / "atrium.vtp")
    write_surface(phantom_map.to_surface(), tmp_path / "map.vtp")
    return tmp_path


def run(files, *options):
    arguments = ["run", files / "atrium.vtp", "--points", 0, "--output", files / "out", *options]
    return main([str(argument) for argument in arguments])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--rule", "iir=1.2"), "give the image with --volume"),
        (("--parcellation", "vein_segments"), "give the image with --volume"),
        (("--rule", "iir=1.2", "--array", "LGE"), "take --rule value=... for LGE"),
        (("--rule", "value=120", "--array", "lge"), 'no array "lge"'),
        (("--rule", "value=132,120", "--array", "LGE"), "out of order"),
        (("--second-array", "LGE"), "give that with --second"),
        (("--second", "MAP", "--array", "Bipolar"), 'no array "Bipolar"'),
        (("--second", "MAP", "--second-array", "Bipolar"), 'no array "Bipolar"'),
        (("--second", "MAP", "--template", "population"), 'on the template "adapted1"'),
    ],
)
def test_what_cannot_be_done_is_said_before_any_work(files, options, words, capsys):
    assert run(files, *(files / "map.vtp" if option == "MAP" else option for option in options)) == 2
    assert words in capsys.readouterr().err
    assert not (files / "out").exists()


def test_an_image_elsewhere_leaves_the_cavity_and_the_reason(files, phantom):
    image = make_lge_volume(phantom.shape, (2.0, 2.0, 2.0))
    image.SetOrigin((1000.0, 0.0, 0.0))
    sitk.WriteImage(image, str(files / "far.nrrd"))
    assert run(files, "--volume", files / "far.nrrd") == 2
    assert sorted(path.name for path in (files / "out").iterdir()) == ["cavity.vtp", "prepare.json", "seeds.mrk.json"]
    assert "does not overlap" in json.loads((files / "out" / "prepare.json").read_text())["error"]
    assert len(read_surface(files / "out" / "cavity.vtp").boundary_loops) == 6


def test_low_voltages_of_both_maps_are_ranked_as_diseased(files, phantom):
    voltage = 3.0 - phantom.surface.point_data["LGE"] / 60.0
    with_voltage = phantom.surface.with_data({"Bipolar": voltage})
    write_surface(with_voltage, files / "atrium.vtp")
    write_surface(flatten(with_voltage, phantom.seeds).to_surface(), files / "map.vtp")
    assert run(files, "--second", files / "map.vtp", "--array", "Bipolar", "--second-array", "LGE") == 0
    found = json.loads((files / "out" / "comparison.json").read_text())
    assert (found["a"], found["b"]) == ("this map", "map.vtp")
    assert (found["direction_a"], found["direction_b"], found["scale"]) == ("below", "above", "ranks")
    # The two say the same, place by place: their percentiles differ only where the maps do.
    assert found["parts"][0]["spearman"] < -0.9
    assert found["parts"][0]["difference_rms"] < 0.3 * np.sqrt(100.0**2 / 12.0)
    assert (files / "out" / "difference.png").read_bytes().startswith(b"\x89PNG")
    page = (files / "out" / "report.html").read_text(encoding="utf-8")
    assert "A is Bipolar of this map, B is LGE of map.vtp" in page
    assert "map.vtp" in page[: page.index("Not a medical device")]


def test_an_array_is_measured_by_a_rule_without_an_image(files, phantom):
    assert run(files, "--array", "LGE", "--rule", "value=120", "--parcellation", "vein_segments") == 0
    found = json.loads((files / "out" / "fibrosis.json").read_text())
    whole = found["parts"][0]
    # In closed form: 120 lies between wall and scar of the phantom.
    share = 100.0 * sum(phantom.shape.scar_areas().values()) / phantom.surface.area
    assert whole["class_percent"][1] == pytest.approx(share, abs=3.0)
    assert {part["group"] for part in found["parts"]} >= {"region", "vein_segments"}
    assert "LGE" in json.loads((files / "out" / "gaps.json").read_text())["array"]


def test_bipolar_voltage_is_measured_unasked(files, phantom):
    """Where a mapping system measured nothing it writes -10000, which is no low voltage."""
    voltage = np.where(phantom.surface.points[:, 2] > phantom.surface.points[:, 2].mean(), 2.0, 0.3)
    unknown = np.linalg.norm(phantom.surface.points - phantom.surface.points[700], axis=1) < 12.0
    voltage[unknown] = -10000.0
    write_surface(phantom.surface.with_data({"Bipolar": voltage, "Unipolar": voltage + 3.0}), files / "atrium.vtp")
    assert run(files) == 0
    found = json.loads((files / "out" / "fibrosis.json").read_text())
    assert (found["array"], found["direction"], found["unit"]) == ("Bipolar", "below", "mV")
    assert found["thresholds"] == [0.5, 0.1]
    whole = found["parts"][0]
    assert whole["class_percent"][2] == 0.0
    assert whole["missing_cm2"] > 1.0
    assert 20.0 < whole["class_percent"][1] < 70.0
    page = (files / "out" / "report.html").read_text(encoding="utf-8")
    assert "Low voltage" in page
    assert "mV" in page


def test_an_empty_voltage_is_no_reason_to_refuse_a_map(files, phantom):
    write_surface(
        phantom.surface.with_data({"Bipolar": np.full(len(phantom.surface.points), -10000.0)}), files / "atrium.vtp"
    )
    assert run(files) == 0
    assert (files / "out" / "map.vtp").exists()
    assert not (files / "out" / "fibrosis.json").exists()
    assert run(files, "--rule", "value=0.5") == 2
