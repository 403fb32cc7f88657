"""The four strategies, and the distortion of several maps."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from LAFlatteningLib import distortion, flatten, make_phantom
from LAFlatteningLib.cli import main
from LAFlatteningLib.files import read_surface, write_seeds, write_surface
from LAFlatteningLib.flattening.strategies import STRATEGIES, flatten_by_strategy
from LAFlatteningLib.map_data import MapData
from LAFlatteningLib.measurement import measure
from LAFlatteningLib.shape_statistics import tabulate
from LAFlatteningLib.study_figures import make_box_plots, make_maps_figure, make_study_figure, make_texture_figure
from LAFlatteningLib.textures import circles


@pytest.fixture(scope="module")
def phantom():
    return make_phantom(3000)


@pytest.fixture(scope="module")
def maps(phantom):
    return {name: flatten_by_strategy(phantom.surface, phantom.seeds, name) for name in STRATEGIES}


def test_mitral_rim_alone_is_harmonic_and_nearly_conformal(maps):
    found = maps["mitral"]
    covered = found.cavity.closed
    place = np.zeros((len(covered.points), 2))
    place[found.cavity.ids] = found.points
    # Every point of the cavity beyond its rims is the weighted mean of its neighbours, covers or not.
    residual = covered.laplacian @ place
    rims = np.unique(np.concatenate([*found.cavity.rims, found.cavity.outer]))
    inner = np.setdiff1d(np.arange(len(found.points)), rims)
    assert np.abs(residual[found.cavity.ids[inner]]).max() < 1e-9
    outer = found.division.loops["MV"]
    np.testing.assert_allclose(np.linalg.norm(found.points[outer], axis=1), 0.5)
    assert found.rim_error > 0.1
    assert any("Rims are off" in note for note in found.notes)
    # Nothing else holds it: less angle distortion than any other.
    assert found.distortion_summary["beta"]["mean"] > 0.9
    assert len(found.folded_triangles) == 0


def test_rims_alone_fold_more_than_with_paths(maps):
    assert maps["rims"].rim_error < 1e-12
    assert maps["rims"].path_drift > 0.05
    assert len(maps["rims"].folded_triangles) > len(maps["paths"].folded_triangles) > 0
    assert len(maps["refined"].folded_triangles) <= len(maps["paths"].folded_triangles)


def test_paths_are_exact_and_rims_soft(maps):
    assert maps["paths"].path_drift < 1e-12
    assert 0.0 < maps["paths"].rim_error < 0.05
    assert maps["refined"].rim_error < 1e-12
    assert maps["refined"].path_drift > 0.0


def test_refined_is_the_published_method(phantom, maps):
    np.testing.assert_array_equal(
        maps["refined"].points, flatten(phantom.surface, phantom.seeds, method="paper").points
    )
    with pytest.raises(ValueError, match="Expected strategy"):
        flatten_by_strategy(phantom.surface, phantom.seeds, "best")


def test_distortion_command(phantom, tmp_path):
    for template in ("population", "adapted1"):
        write_surface(flatten(phantom.surface, phantom.seeds, template).to_surface(), tmp_path / f"{template}.vtp")
    names = ("population", "adapted1")
    assert main(["distortion", *(f"{tmp_path}/{name}.vtp" for name in names), "--output", f"{tmp_path}/study"]) == 0
    rows = {row["name"]: row for row in json.loads((tmp_path / "study" / "distortion.json").read_text())["maps"]}
    with (tmp_path / "study" / "distortion.csv").open(newline="") as file:
        assert [row["name"] for row in csv.DictReader(file)] == list(names)
    for name in names:
        made = read_surface(tmp_path / "study" / f"{name}_distortion.vtp")
        alpha, beta = made.cell_data["alpha"], made.cell_data["beta"]
        # Written out: shares of the areas, and the ratio of the singular values of a least-squares fit.
        data = MapData.of(read_surface(tmp_path / f"{name}.vtp"))
        corners, flat = data.surface.points[data.triangles], data.flat[data.triangles]
        on_atrium = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        a, b = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
        on_map = 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
        np.testing.assert_allclose(alpha, on_map / on_map.sum() / (on_atrium / on_atrium.sum()), rtol=1e-4)
        for k in range(0, len(beta), 500):
            plane = np.linalg.qr((corners[k, 1:] - corners[k, 0]).T)[0]
            jacobian = np.linalg.solve((corners[k, 1:] - corners[k, 0]) @ plane, flat[k, 1:] - flat[k, 0])
            large, small = np.linalg.svd(jacobian)[1]
            assert beta[k] == pytest.approx(small / large, rel=1e-4)
        assert rows[name]["beta_mean"] == pytest.approx(beta.mean(), rel=1e-5)
        bins = np.floor(alpha / 0.1)
        share = np.unique(bins, return_counts=True)[1] / len(bins)
        assert rows[name]["alpha_entropy"] == pytest.approx(-(share * np.log(share)).sum(), abs=2e-3)
    assert main(["distortion", f"{tmp_path}/adapted1.vtp", f"{tmp_path}/adapted1.vtp", "--output", f"{tmp_path}"]) == 2


def test_strategy_command(phantom, tmp_path, capsys):
    write_surface(phantom.surface, tmp_path / "a.vtp")
    write_seeds(phantom.seeds, tmp_path / "s.mrk.json", phantom.surface.space)
    arguments = ["flatten", f"{tmp_path}/a.vtp", "--seeds", f"{tmp_path}/s.mrk.json", "--output", f"{tmp_path}/m.vtp"]
    assert main([*arguments, "--strategy", "rims"]) == 2
    assert "belongs to --method paper" in capsys.readouterr().err
    assert main([*arguments, "--method", "paper", "--strategy", "mitral"]) == 0
    out = capsys.readouterr().out
    assert "for study" in out
    assert "strategy mitral" in out


def test_figures_have_their_parts(phantom, maps):
    pytest.importorskip("matplotlib")
    data = {name: MapData.of(found) for name, found in maps.items()}
    pattern = circles(phantom.surface, 30)
    study = make_study_figure(dict(list(data.items())[:2]), pattern=pattern)
    labels = {axes.get_label() for axes in study.axes}
    assert {"rims alpha", "rims beta", "rims pattern", "mitral beta histogram", "alpha colours"} <= labels
    side = make_maps_figure({n: (d, maps[n].regions) for n, d in data.items()}, title="Four strategies")
    rims = next(axes for axes in side.axes if axes.get_label() == "rims")
    crosses = rims.lines[-1].get_xydata()
    assert len(crosses) == len(distortion.folded_triangles(data["rims"].flat, data["rims"].triangles))
    texture = make_texture_figure(data["refined"], [pattern])
    assert {axes.get_label() for axes in texture.axes} == {"circles posterior", "circles anterior", "circles map"}
    table = tabulate({"one": measure(phantom.surface, phantom.seeds)})
    box = make_box_plots(table)
    ticks = [tick.get_text() for tick in box.axes[2].get_xticklabels()]
    assert ticks == [f"s{k}" for k in range(1, 10)]
