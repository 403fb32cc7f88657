"""``la-flatten template``, the picture of a template, and other chambers on the command line."""

import json
import re

import chambers
import numpy as np
import pytest

from LAFlatteningLib import Template, builtin_templates, read_surface, write_seeds, write_surface
from LAFlatteningLib.cli import main
from LAFlatteningLib.template_figure import make_template_figure


def call(*arguments):
    return main([str(argument) for argument in arguments])


def test_templates_are_listed(capsys):
    assert call("template") == 0
    said = capsys.readouterr().out
    assert [line.split()[0] for line in said.splitlines()] == list(builtin_templates())
    assert "Left ventricle (4 seeds)" in said
    assert call("template", "--list") == 0
    assert capsys.readouterr().out == said


def test_a_copy_is_a_sound_template_of_its_own(tmp_path, capsys):
    mine = tmp_path / "mine.json"
    assert call("template", "right_atrium", "--copy", mine) == 0
    assert call("template", "--check", mine) == 0
    assert "mine: Right atrium. No fault found." in capsys.readouterr().out
    copied, shipped = Template.load(mine), Template.load("right_atrium")
    assert copied.name == "mine"
    assert (copied.anatomy, copied.outer, copied.holes) == (shipped.anatomy, shipped.outer, shipped.holes)


BROKEN = {
    "overlap": (lambda d: d["holes"]["RSPV"]["shape"].update(centre=[0.205, -0.09]), "RSPV.shape: overlaps"),
    "outside": (lambda d: d["holes"]["LAA"]["shape"].update(centre=[-0.48, 0.2]), "LAA.shape: reaches beyond"),
    "through a hole": (lambda d: d["holes"]["LAA"]["shape"].update(centre=[0.0, 0.08]), "crosses the hole LAA"),
    "order": (lambda d: d["holes"]["RSPV"]["feet"].update(s1=22.5, s5=270), "RSPV.feet: angles out of order"),
    "unknown": (lambda d: d["holes"].update(LCPV=d["holes"]["LAA"]), "holes.LCPV: unknown opening"),
    "version": (lambda d: d.update(schema="laflattening-template/2"), "laflattening-template/2"),
    "text": (lambda d: d["holes"]["RSPV"]["shape"].update(radius="0.04"), "holes.RSPV.shape.radius"),
    "nan": (lambda d: d["outer"]["feet"].update(s5=float("nan")), "NaN"),
    "infinite": (lambda d: d["holes"]["LAA"]["shape"].update(centre=[float("inf"), 0.2]), "Infinity"),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_check_says_what_is_wrong(tmp_path, capsys, kind):
    change, message = BROKEN[kind]
    data = {**Template.load("adapted1").to_dict(), "name": "mine"}
    change(data)
    (tmp_path / "mine.json").write_text(json.dumps(data))
    assert call("template", "--check", tmp_path / "mine.json") == 2
    assert message in capsys.readouterr().err


def test_check_tells_of_paths_that_cross(tmp_path, capsys):
    data = {**Template.load("right_atrium_cs").to_dict(), "name": "mine"}
    data["holes"]["CS"].update(
        shape={"type": "circle", "centre": [0.3, -0.25], "radius": 0.035}, feet={"r3": 180, "r5": 250}
    )
    data["holes"]["IVC"]["feet"]["r3"] = 310
    (tmp_path / "mine.json").write_text(json.dumps(data))
    assert call("template", "--check", tmp_path / "mine.json") == 2
    assert "paths r3 and r4 cross; change the angles" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("content", "message"),
    [("{", "mine.json"), ("[1, 2]", "an object"), ('{"schema": 1}', "schema"), (b"\xff\xfe\x00", "mine.json")],
)
def test_check_of_what_is_no_template(tmp_path, capsys, content, message):
    (tmp_path / "mine.json").write_bytes(content if isinstance(content, bytes) else content.encode())
    assert call("template", "--check", tmp_path / "mine.json") == 2
    said = capsys.readouterr().err
    assert message in said and "Traceback" not in said


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--check", "nowhere.json"], "nowhere.json"),
        (["adapted1", "--check", "nowhere.json"], "leave the other one out"),
        (["adapted1", "--list"], "give it alone"),
        (["--output", "t.png"], "Which template?"),
        (["adapted1", "--output", "t.txt"], ".png"),
        (["adapted7"], "adapted1, adapted2"),
        (["adapted1", "--copy", "square.json"], "built-in"),
        (["adapted1", "--copy", "two words.json"], "two words"),
    ],
)
def test_bad_calls(tmp_path, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert call("template", *arguments) == 2
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


# ---- the picture -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", builtin_templates())
def test_the_picture_names_everything_in_its_place(name):
    pytest.importorskip("matplotlib")
    template = Template.load(name)
    anatomy = template.anatomy
    axes = make_template_figure(template).axes[0]
    written = {text.get_text(): np.array(text.get_position()) for text in axes.texts}
    for hole, rim in template.holes.items():
        np.testing.assert_allclose(written[hole], rim.shape.centre)
    for path in anatomy.paths:
        np.testing.assert_allclose(written[path], template.segment(path).mean(axis=0))
    for region in anatomy.regions:
        from LAFlatteningLib.template import inside_polygon

        assert inside_polygon(written[f"R{region}"][None], template.region_outline(region))[0]
        assert not any(rim.shape.contains(written[f"R{region}"][None])[0] for rim in template.holes.values())
    for seed, path in zip(anatomy.outer_seeds, anatomy.outer_paths, strict=True):
        place = next(at for text, at in written.items() if text.startswith(f"{seed}\n"))
        assert not template.outer.shape.contains(place[None])[0]
        assert np.linalg.norm(place - template.foot(path, 1)) < 0.15 * template.radius
        assert f"{seed}\n{template.outer.feet[path] % 360:g}°" in written
    rims = [line.get_xydata() for line in axes.lines if line.get_color() == "#00b8a9"]
    assert len(rims) == len(anatomy.openings)
    low, high = axes.get_xlim()
    assert all(low < at[0] < high for at in written.values())
    words = " ".join(text.get_text() for text in make_template_figure(template).axes[1].texts).replace("\n", " ")
    for text in (*anatomy.openings.values(), *anatomy.outer_seeds.values(), *anatomy.region_names.values()):
        assert text in words


def test_the_picture_is_written(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    assert call("template", "left_ventricle", "--output", tmp_path / "t.svg") == 0
    assert re.search(rb"<svg", (tmp_path / "t.svg").read_bytes())


# ---- flattening other chambers ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["left_ventricle", "right_atrium"])
def test_other_chambers_from_file_to_map(tmp_path, capsys, name):
    pytest.importorskip("matplotlib")
    surface, seeds = chambers.ventricle(12) if name == "left_ventricle" else chambers.right_atrium(subdivisions=4)
    write_surface(surface, tmp_path / "chamber.vtp")
    write_seeds(seeds, tmp_path / "seeds.csv", surface.space)
    code = call(
        "flatten", tmp_path / "chamber.vtp", "--seeds", tmp_path / "seeds.csv", "--template", name,
        "--output", tmp_path / "map.vtp", "--figure", tmp_path / "map.png", "--metrics", tmp_path / "m.json",
    )  # fmt: skip
    assert code == 0, capsys.readouterr().err
    metrics = json.loads((tmp_path / "m.json").read_text())
    assert (metrics["template"], metrics["folded_triangles"]) == (name, 0)
    flat = read_surface(tmp_path / "map.vtp")
    assert len(flat.points) == len(surface.points)
    assert set(flat.cell_data["region"].tolist()) == set(Template.load(name).anatomy.regions)
    assert call("texture", tmp_path / "map.vtp", "--pattern", "stripes", "--output", tmp_path / "stripes.vtp") == 0
    assert np.isfinite(read_surface(tmp_path / "stripes.vtp").point_data["stripes"]).all()


def test_raw_chambers_other_than_the_left_atrium_are_not_prepared(tmp_path, capsys):
    surface, _ = chambers.ventricle(12)
    write_surface(surface, tmp_path / "chamber.vtp")
    code = call("run", tmp_path / "chamber.vtp", "--template", "left_ventricle", "--output", tmp_path / "out")
    assert code == 2
    assert "use la-flatten flatten" in capsys.readouterr().err
