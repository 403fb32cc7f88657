"""Sizes of an atrium are those of its shape; statistics are those of an independent computation."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy import stats

from LAFlatteningLib import LAFlatteningError, SeedError, make_phantom
from LAFlatteningLib.cli import main
from LAFlatteningLib.errors import InputFileError
from LAFlatteningLib.files import write_seeds, write_surface
from LAFlatteningLib.measurement import Measurement, measure, read_measurement
from LAFlatteningLib.rim_length import rim_perimeter
from LAFlatteningLib.shape_statistics import tabulate


@pytest.mark.parametrize("points", [2000, 8000])
def test_sizes_of_the_phantom_are_those_of_its_shape(points):
    phantom = make_phantom(points)
    found, shape = measure(phantom.surface, phantom.seeds), phantom.shape
    for name, tube in shape.tubes.items():
        assert found.perimeters_mm[name] == pytest.approx(tube.perimeter, rel=0.015)
    assert found.perimeters_mm["MV"] == pytest.approx(shape.valve.perimeter, rel=0.01)
    for path, length in found.paths_mm.items():
        assert length == pytest.approx(shape.path_length(path), abs=0.2), path
    assert found.area_cm2 == pytest.approx(shape.area() / 100.0, rel=0.01)
    assert found.path_ratios["s1"] == pytest.approx(shape.path_length("s1") / shape.path_length("s3"), rel=0.02)
    assert found.perimeter_ratios["LIPV"] == 1.0


def ellipse(a: float, b: float, count: int) -> np.ndarray:
    turns = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    return np.stack([a * np.cos(turns), b * np.sin(turns), 0.0 * turns], axis=1)


def test_perimeter_of_an_ellipse():
    from scipy.special import ellipe

    for a, b in ((10.0, 10.0), (12.0, 9.0), (12.0, 6.0)):
        exact = 4.0 * a * ellipe(1.0 - (b / a) ** 2)
        assert rim_perimeter(ellipse(a, b, 60)) == pytest.approx(exact, rel=0.012)


def test_a_saw_does_not_count():
    smooth = ellipse(11.0, 8.0, 80)
    # Teeth of 0.8 mm, as triangles that are left out make them.
    saw = smooth * (1.0 + 0.08 * (np.arange(80) % 2))[:, None]
    raw = np.linalg.norm(np.roll(saw, -1, axis=0) - saw, axis=1).sum()
    middle = rim_perimeter(smooth * 1.04)
    assert raw > 1.25 * middle
    assert rim_perimeter(saw) == pytest.approx(middle, rel=0.015)


def test_wrong_seeds_are_refused():
    phantom = make_phantom(1500)
    seeds = {**phantom.seeds, "RSPV": phantom.seeds["RIPV"], "RIPV": phantom.seeds["RSPV"]}
    with pytest.raises(SeedError, match="RSPV"):
        measure(phantom.surface, seeds)


def made_up(rng: np.random.Generator) -> Measurement:
    perimeters = {name: float(rng.normal(45.0, 6.0)) for name in ("RSPV", "RIPV", "LIPV", "LSPV", "LAA", "MV")}
    paths = {f"s{k}": float(rng.normal(30.0, 5.0)) for k in range(1, 10)}
    return Measurement("left_atrium", perimeters, paths, 90.0)


def test_table_of_several_atria():
    rng = np.random.default_rng(5)
    sizes = {f"atrium {k}": made_up(rng) for k in range(9)}
    table = tabulate(sizes)
    values = np.array([one.perimeters_mm["LSPV"] for one in sizes.values()])
    found = table.spread("perimeter", "LSPV").summary
    assert found["mean"] == pytest.approx(sum(values) / 9)
    assert found["sd"] == pytest.approx(np.sqrt(sum((values - values.mean()) ** 2) / 8))
    assert found["median"] == sorted(values)[4]
    ratio = np.array([one.paths_mm["s1"] / one.paths_mm["s3"] for one in sizes.values()])
    np.testing.assert_allclose(table.spread("path ratio", "s1").values, ratio)
    test = next(test for test in table.tests if (test.first, test.second) == ("s3", "s1"))
    difference = np.array([one.paths_mm["s1"] - one.paths_mm["s3"] for one in sizes.values()])
    assert test.median_difference == pytest.approx(np.median(difference))
    # Student's t written out.
    t = difference.mean() / (difference.std(ddof=1) / 3.0)
    assert test.p_t == pytest.approx(2.0 * stats.t.sf(abs(t), 8))
    # Wilcoxon's test by going through all 512 ways to give signs to the ranks.
    ranks = stats.rankdata(np.abs(difference))
    observed = abs(ranks @ np.sign(difference))
    signs = 2 * ((np.arange(512)[:, None] >> np.arange(9)) & 1) - 1
    assert test.p_wilcoxon == pytest.approx((np.abs(signs @ ranks) >= observed - 1e-9).mean())


def test_few_atria_are_not_tested():
    rng = np.random.default_rng(5)
    two = tabulate({"a": made_up(rng), "b": made_up(rng)})
    assert all(test.p_wilcoxon is None and test.p_t is None for test in two.tests)
    one = tabulate({"a": made_up(rng)})
    assert one.spread("path", "s1").summary["sd"] is None
    with pytest.raises(LAFlatteningError, match="found none"):
        tabulate({})
    other = Measurement("right_atrium", {"SVC": 50.0}, {"p1": 30.0}, 90.0)
    with pytest.raises(LAFlatteningError, match="one anatomy"):
        tabulate({"a": made_up(rng), "b": other})


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The files of two phantoms and their seeds."""
    folder = tmp_path_factory.mktemp("measure")
    for points in (1500, 2000):
        phantom = make_phantom(points)
        write_surface(phantom.surface, folder / f"a{points}.vtp")
        write_seeds(phantom.seeds, folder / f"a{points}.mrk.json", phantom.surface.space)
    return folder


def test_command(files, capsys):
    for points in (1500, 2000):
        arguments = [f"{files}/a{points}.vtp", "--seeds", f"{files}/a{points}.mrk.json"]
        assert main(["measure", *arguments, "--output", f"{files}/m{points}.json"]) == 0
    content = json.loads((files / "m2000.json").read_text())
    assert content["schema"] == "laflattening-measurement/1"
    assert read_measurement(files / "m2000.json").perimeters_mm == content["perimeters_mm"]
    assert "LIPV perimeter 38." in capsys.readouterr().out
    tables = [f"{files}/m1500.json", f"{files}/m2000.json"]
    assert main(["measure", "--table", *tables, "--output", f"{files}/table"]) == 0
    lines = (files / "table" / "measurements.csv").read_text().splitlines()
    assert lines[0] == "group,name,unit,n,mean,sd,median,smallest,largest,m1500,m2000"
    assert len(lines) == 1 + 2 * (6 + 9)
    assert (files / "table" / "measurements.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("{}", "expected a measurement"),
        ('{"schema": "laflattening-measurement/9"}', "found laflattening-measurement/9"),
        ('{"schema": "laflattening-measurement/1", "perimeters_mm": {"LIPV": "a"}, "paths_mm": {}}', "lengths above 0"),
        ('{"schema": "laflattening-measurement/1", "perimeters_mm": {"LIPV": -2}, "paths_mm": {}}', "lengths above 0"),
        ("[1]", "found none"),
        ("not JSON", "JSON"),
    ],
)
def test_other_files_are_refused(tmp_path, content, words):
    path = tmp_path / "m.json"
    path.write_text(content)
    with pytest.raises(InputFileError, match=words):
        read_measurement(path)


def test_command_refuses(files, tmp_path, capsys):
    assert main(["measure", "--table", f"{files}/a1500.vtp"]) == 2
    assert main(["measure", f"{files}/a1500.vtp", "--output", f"{files}/x.json"]) == 2
    phantom = make_phantom(1500)
    content = json.dumps(measure(phantom.surface, phantom.seeds).to_dict())
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "m1500.json").write_text(content)
    assert main(["measure", "--table", f"{tmp_path}/one/m1500.json", f"{tmp_path}/two/m1500.json"]) == 2
    assert 'called "m1500"' in capsys.readouterr().err
