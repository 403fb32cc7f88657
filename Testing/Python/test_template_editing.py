"""Templates made of others, their files, and the quick map that shows them."""

import json
from dataclasses import replace

import numpy as np
import pytest

from LAFlatteningLib import Flattener, Template, TemplateError, builtin_templates, distortion, make_phantom
from LAFlatteningLib.errors import InputFileError
from LAFlatteningLib.template_editing import move_foot, move_hole, renamed, scale_hole

ADAPTED = Template.load("adapted1")


@pytest.fixture(scope="module")
def phantom():
    return make_phantom(3000)


def test_a_hole_is_moved():
    moved = move_hole(ADAPTED, "RSPV", (0.22, 0.1))
    shape = moved.holes["RSPV"].shape
    assert shape.centre == (0.22, 0.1)
    assert shape.semi_axes == ADAPTED.holes["RSPV"].shape.semi_axes
    # Paths still begin on its rim, at the angles they had.
    before, after = (template.foot("s1", 0) for template in (ADAPTED, moved))
    np.testing.assert_allclose(after - before, (0.22 - 0.205, 0.1 - 0.08375), atol=1e-12)
    assert {name: rim for name, rim in moved.holes.items() if name != "RSPV"} == {
        name: rim for name, rim in ADAPTED.holes.items() if name != "RSPV"
    }
    assert moved.outer == ADAPTED.outer


def test_an_ellipse_keeps_its_form_when_scaled():
    rim = ADAPTED.holes["LAA"]
    ellipse = replace(rim, shape=replace(rim.shape, semi_axes=(0.02, 0.04), rotation=20.0))
    template = replace(ADAPTED, name="mine", holes={**ADAPTED.holes, "LAA": ellipse})
    shape = scale_hole(template, "LAA", 1.1).holes["LAA"].shape
    assert shape.semi_axes == pytest.approx((0.022, 0.044))
    assert (shape.centre, shape.rotation) == (ellipse.shape.centre, 20.0)


def test_a_foot_is_moved_on_the_outer_rim_and_on_a_hole():
    moved = move_foot(ADAPTED, "MV", "s5", 380.0)
    assert moved.outer.feet["s5"] == pytest.approx(20.0)
    np.testing.assert_allclose(moved.foot("s5", 1), 0.5 * np.array([np.cos(np.pi / 9), np.sin(np.pi / 9)]))
    assert move_foot(ADAPTED, "RSPV", "s5", 30.0).holes["RSPV"].feet == {"s4": 180, "s1": 270, "s5": 30}


def test_an_edited_template_is_not_called_like_a_built_in_one():
    edited = move_foot(move_hole(ADAPTED, "LAA", (-0.27, 0.28)), "MV", "s9", 128.0)
    assert edited.name == "adapted1-edited"
    assert "adapted1" in edited.source
    assert move_hole(replace(ADAPTED, name="mine"), "LAA", (-0.27, 0.28)).name == "mine"
    assert renamed(edited, "clinic_2").name == "clinic_2"


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda t: move_hole(t, "RSPV", (0.205, -0.10)), "overlaps"),
        (lambda t: move_hole(t, "RSPV", (0.49, 0.1)), "beyond the outer rim"),
        (lambda t: move_hole(t, "RSPV", (-0.4, 0.2)), "cross"),
        (lambda t: move_hole(t, "RSPV", (np.nan, 0.0)), "finite"),
        (lambda t: move_hole(t, "MV", (0.0, 0.0)), "unknown hole"),
        (lambda t: scale_hole(t, "LIPV", 5.0), "overlaps"),
        (lambda t: scale_hole(t, "LIPV", 0.0), "above 0"),
        (lambda t: scale_hole(t, "LIPV", 0.1), "too small"),
        (lambda t: move_foot(t, "MV", "s5", 200.0), "out of order"),
        (lambda t: move_foot(t, "MV", "s5", np.inf), "angle"),
        (lambda t: move_foot(t, "MV", "s1", 20.0), "does not meet"),
        (lambda t: move_foot(t, "XX", "s1", 20.0), "unknown opening"),
        (lambda t: renamed(t, "population"), "built-in"),
        (lambda t: renamed(t, "my template"), "letters"),
    ],
)
def test_what_cannot_be_is_refused(edit, message):
    with pytest.raises(TemplateError, match=message):
        edit(ADAPTED)


@pytest.mark.parametrize("name", builtin_templates())
def test_a_template_and_its_content(name):
    template = Template.load(name)
    content = json.loads(json.dumps(template.to_dict()))
    assert Template.from_dict(content) == template


def test_a_saved_template_is_the_same(tmp_path):
    rim = ADAPTED.holes["LAA"]
    ellipse = replace(rim, shape=replace(rim.shape, semi_axes=(0.025, 0.05), rotation=10.0))
    anatomy = replace(ADAPTED.anatomy, name="mine", openings={**ADAPTED.anatomy.openings, "LAA": "Ohr"})
    template = replace(ADAPTED, name="mine", anatomy=anatomy, holes={**ADAPTED.holes, "LAA": ellipse})
    template.save(tmp_path / "mine.json")
    assert Template.load(tmp_path / "mine.json") == template


def test_the_name_of_a_built_in_template_is_not_taken(tmp_path):
    other = replace(move_hole(ADAPTED, "LAA", (-0.27, 0.28)), name="adapted1")
    with pytest.raises(TemplateError, match="built-in"):
        other.save(tmp_path / "mine.json")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "mine.json").write_text(json.dumps(other.to_dict()))
    with pytest.raises(TemplateError, match="built-in"):
        Template.load(tmp_path / "mine.json")
    with pytest.raises(InputFileError, match="does not exist"):
        renamed(other, "mine").save(tmp_path / "nowhere" / "mine.json")


def test_angles_of_places():
    shape = replace(ADAPTED.holes["LAA"].shape, semi_axes=(0.02, 0.05), rotation=33.0)
    for degrees in np.random.default_rng(3).uniform(0.0, 360.0, 20):
        beyond = shape.centre + 1.7 * (shape.at(degrees) - shape.centre)
        assert shape.angle_of(beyond) == pytest.approx(degrees)


@pytest.mark.parametrize("method", ["regional", "paper"])
def test_the_quick_map_follows_the_template(phantom, method):
    flattener = Flattener(phantom.surface, method=method)
    flat_map = flattener.flatten(phantom.seeds)
    same = flattener.preview_template(ADAPTED, phantom.seeds)
    np.testing.assert_allclose(same.points, flat_map.points, atol=1e-12)
    edited = scale_hole(move_hole(move_foot(ADAPTED, "MV", "s5", 26.0), "RSPV", (0.22, 0.09)), "LAA", 1.2)
    quick = flattener.preview_template(edited, phantom.seeds)
    full = Flattener(phantom.surface, edited, method).flatten(phantom.seeds)
    scale = 1e-9 if method == "regional" else 0.01
    for opening in ("RSPV", "LAA", "MV"):
        loop = flat_map.division.loops[opening]
        loop = loop[loop < len(quick.points)]
        assert edited.rim(opening).shape.distance(quick.points[loop]).max() < scale
    moved = np.linalg.norm(full.points - flat_map.points, axis=1)
    apart = np.linalg.norm(full.points - quick.points, axis=1)
    assert moved.max() > 0.015
    assert np.percentile(apart, 99) < 0.4 * np.percentile(moved, 99)
    if method == "regional":
        assert len(distortion.folded_triangles(quick.points, quick.triangles)) == 0


def test_the_quick_map_is_of_the_seeds_that_are_given(phantom):
    flattener = Flattener(phantom.surface)
    flattener.flatten(phantom.seeds)
    seeds = {**phantom.seeds, "RSPV": phantom.seeds["RSPV"] + (2.0, 0.0, 1.0)}
    quick = flattener.preview_template(ADAPTED, seeds)
    np.testing.assert_allclose(quick.points, Flattener(phantom.surface).flatten(seeds).points, atol=1e-9)


def test_another_anatomy_has_no_quick_map(phantom):
    flattener = Flattener(phantom.surface)
    other = replace(ADAPTED, name="mine", anatomy=replace(ADAPTED.anatomy, name="other"))
    with pytest.raises(TemplateError, match="anatomy"):
        flattener.preview_template(other, phantom.seeds)


def test_a_flattener_for_another_template_makes_the_map_of_a_new_one(phantom):
    edited = move_hole(ADAPTED, "RSPV", (0.22, 0.09))
    first = Flattener(phantom.surface)
    first.flatten(phantom.seeds)
    first.preview(phantom.seeds)
    second = first.with_template(edited)
    new = Flattener(phantom.surface, edited)
    np.testing.assert_array_equal(second.flatten(phantom.seeds).points, new.flatten(phantom.seeds).points)
    np.testing.assert_array_equal(second.preview(phantom.seeds).points, new.preview(phantom.seeds).points)
    # The first one is as it was.
    np.testing.assert_array_equal(
        first.flatten(phantom.seeds).points, Flattener(phantom.surface).flatten(phantom.seeds).points
    )
