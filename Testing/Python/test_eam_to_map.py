"""Electroanatomical maps from the file of the mapping system to classes of voltage on the map."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from test_eam_files import to_carto, write_carto

from LAFlatteningLib.axes import with_axes
from LAFlatteningLib.cli import main
from LAFlatteningLib.errors import SurfaceError
from LAFlatteningLib.files import read_surface, write_surface
from LAFlatteningLib.surface import Surface

FRONT_Y, STEP_MM = -40.0, 30.0
"""Voltage rises by 1 mV over STEP_MM from the front (low y in LPS) to the back, and is .5 mV at FRONT_Y."""


def voltage(points):
    return np.maximum(0.0, 0.5 + (points[:, 1] - FRONT_Y) / STEP_MM)


def true_percent(surface, limit):
    """Share of the area where the voltage is below a limit, by 36 places in each triangle."""
    k = np.arange(8)
    shares = np.array([(a + 1 / 3, b + 1 / 3, 8 - a - b - 2 / 3) for a in k for b in k if a + b < 8]) / 8.0
    places = np.einsum("sj,mjd->msd", shares, surface.points[surface.triangles])
    low = (voltage(places.reshape(-1, 3)) < limit).reshape(places.shape[:2]).mean(axis=1)
    return 100.0 * float(low @ surface.triangle_areas) / surface.area


@pytest.fixture(scope="module")
def run_folder(phantom, tmp_path_factory):
    """The phantom as a CARTO file, taken through `la-flatten run`."""
    folder = tmp_path_factory.mktemp("eam")
    surface = phantom.surface
    values = voltage(surface.points)
    lat = 100.0 + surface.points[:, 0]
    # A patch without measurement.
    lat[np.linalg.norm(surface.points - surface.points[7], axis=1) < 6.0] = -10000.0
    write_carto(folder / "atrium.mesh", surface, {"Bipolar": values, "LAT": lat})
    code = main(
        ["run", str(folder / "atrium.mesh"), "--array", "LAT", "--points", "3000", "--output", str(folder / "out")]
    )
    assert code == 0
    return folder


def test_a_carto_file_becomes_a_map_with_classes_of_voltage(run_folder, phantom, capsys):
    output = run_folder / "out"
    code = main(
        ["fibrosis", str(output / "map.vtp"), "--array", "Bipolar", "--rule", "value=0.5,0.1",
         "--output", str(output / "v.json"), "--csv", str(output / "v.csv"), "--figure", str(output / "v.png")]
    )  # fmt: skip
    assert code == 0
    assert "low (0.1 to 0.5 mV)" in capsys.readouterr().out
    found = json.loads((output / "v.json").read_text())
    assert (found["unit"], found["direction"]) == ("mV", "below")
    assert found["classes"] == ["normal", "low", "scar"]
    whole = found["parts"][0]
    assert whole["beyond_percent"] == pytest.approx(true_percent(phantom.surface, 0.5), abs=1.0)
    assert whole["class_percent"][2] == pytest.approx(true_percent(phantom.surface, 0.1), abs=1.0)
    by_region = {row["label"]: float(row["beyond_percent"]) for row in csv.DictReader((output / "v.csv").open())}
    # What is low at the front is low on the anterior wall, and normal between the veins.
    assert by_region["4"] > 60.0
    assert by_region["5"] < 20.0
    assert (output / "v.png").read_bytes().startswith(b"\x89PNG")


def test_what_was_not_measured_stays_without_value(run_folder, phantom):
    flat = read_surface(run_folder / "out" / "map.vtp")
    at, lat = flat.point_data["position_mm"], flat.point_data["LAT"]
    hole = np.linalg.norm(at - phantom.surface.points[7], axis=1) < 3.0
    assert hole.any()
    assert np.isnan(lat[hole]).all()
    known = np.isfinite(lat)
    assert known.mean() > 0.9
    assert lat[known] == pytest.approx(100.0 + at[known, 0], abs=2.0)


def test_a_file_in_the_axes_of_carto_is_refused_or_turned(phantom, tmp_path, capsys):
    surface = phantom.surface
    normals = {"Normals": surface.point_normals, "Bipolar": voltage(surface.points)}
    turned = Surface(to_carto(surface.points), surface.triangles, normals)
    write_surface(turned, tmp_path / "export.vtp")
    command = ["prepare", str(tmp_path / "export.vtp"), "--output", str(tmp_path / "cavity.vtp"), "--points", "0"]
    command += ["--seeds-output", str(tmp_path / "seeds.mrk.json")]
    assert main(command) == 2
    assert "do not lie as in a left atrium" in capsys.readouterr().err
    assert main([*command, "--axes", "carto"]) == 0
    assert "Normals" in capsys.readouterr().out
    cavity = read_surface(tmp_path / "cavity.vtp")
    assert cavity.space == "LPS"
    assert cavity.points.min(axis=0) == pytest.approx(surface.points.min(axis=0), abs=0.5)
    assert "Normals" not in cavity.point_data
    assert cavity.point_data["Bipolar"] == pytest.approx(voltage(cavity.points), abs=0.05)


def test_axes_that_only_have_another_name():
    surface = Surface(np.eye(3), np.array([[0, 1, 2]]))
    found, notes = with_axes(surface, "RAS")
    assert (found.space, notes) == ("RAS", [])
    assert np.array_equal(found.points, surface.points)
    assert np.array_equal(with_axes(replace(surface, points=to_carto(np.eye(3))), "CARTO")[0].points, np.eye(3))
    with pytest.raises(SurfaceError, match="LPS, RAS, CARTO"):
        with_axes(surface, "LAS")


@pytest.mark.parametrize("options", [(), ("--axes", "CARTO")])
def test_an_array_to_draw_that_is_not_there_is_told_before_any_work(phantom, tmp_path, options, capsys):
    write_surface(phantom.surface, tmp_path / "a.vtp")
    assert main(["run", str(tmp_path / "a.vtp"), "--array", "LAT", "--output", str(tmp_path / "out"), *options]) == 2
    assert 'no array "LAT"' in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_real_openep_mesh_needs_its_axes_and_names_every_vein(data_dir, tmp_path, capsys):
    """Seven openings: two on the right fit the right inferior vein; the narrower lies between the two right veins."""
    path = data_dir / "eam" / "openep_mesh_2_dense.vtk"
    command = [
        "prepare",
        str(path),
        "--output",
        str(tmp_path / "c.vtp"),
        "--seeds-output",
        str(tmp_path / "s.mrk.json"),
    ]
    command += ["--report", str(tmp_path / "r.json"), "--extra-veins", "keep", "--axes", "CARTO"]
    assert main(command) == 0
    assert "Two openings fit RIPV" in capsys.readouterr().out
    planes = json.loads((tmp_path / "r.json").read_text())["planes"]
    z = {name: plane["centre_mm"][2] for name, plane in planes.items()}
    x = {name: plane["centre_mm"][0] for name, plane in planes.items()}
    assert z["RSPV"] > z["RIPV"] + 20.0
    assert z["LSPV"] > z["LIPV"] + 10.0
    assert max(x["RSPV"], x["RIPV"]) < 0.0 < min(x["LSPV"], x["LIPV"], x["LAA"], x["MV"])
    # The vein between them is left over and covered, higher than the one that is taken.
    assert planes["RIPV"]["perimeter_mm"] == pytest.approx(69.0, abs=2.0)
