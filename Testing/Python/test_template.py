"""The division as data, and the layout of the map."""

import copy
import json
import re

import numpy as np
import pytest

from LAFlatteningLib.anatomy import ANATOMIES, LEFT_ATRIUM, Anatomy, trace_faces
from LAFlatteningLib.errors import TemplateError
from LAFlatteningLib.template import Shape, Template, builtin_templates, template_schema

ADAPTED1 = Template.load("adapted1")


def document():
    """The content of the default template's file."""
    from LAFlatteningLib.template import _FOLDER

    return json.loads((_FOLDER / "adapted1.json").read_text())


def test_left_atrium_is_the_division_of_the_paper():
    assert LEFT_ATRIUM.seeds == ("RSPV", "RIPV", "LIPV", "LSPV", "LAA", "MV1", "MV2", "MV3", "MV4")
    assert len(LEFT_ATRIUM.paths) == 9
    # Section II-A2: R1 s1 s5 s6, R2 s2 s6 s7, R3 s9 s8 s3 s7, R4 s5 s4 s8 s9, R5 s1-s4.
    assert {number: set(paths) for number, paths in LEFT_ATRIUM.regions.items()} == {
        1: {"s1", "s5", "s6"},
        2: {"s2", "s6", "s7"},
        3: {"s9", "s8", "s3", "s7"},
        4: {"s5", "s4", "s8", "s9"},
        5: {"s1", "s2", "s3", "s4"},
    }


def test_faces_satisfy_eulers_formula_and_use_each_side_of_a_path_once():
    faces = trace_faces(LEFT_ATRIUM)
    nodes = {*LEFT_ATRIUM.holes, LEFT_ATRIUM.outer}
    # The outer rim is one node; the plane outside it is no face, being inside that node.
    assert len(nodes) - len(LEFT_ATRIUM.paths) + len(faces) == 2
    darts = [dart for face in faces for dart in face]
    assert len(darts) == len(set(darts)) == 2 * len(LEFT_ATRIUM.paths)


def test_anatomy_survives_its_dictionary():
    again = Anatomy.from_dict(json.loads(json.dumps(LEFT_ATRIUM.to_dict())))
    assert again == LEFT_ATRIUM
    assert ANATOMIES == {"left_atrium": LEFT_ATRIUM}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a: a.update(outer="AV"), "anatomy.outer"),
        (lambda a: a["paths"].update(s1=["RSPV", "MV9"]), 'anatomy.paths.s1: "MV9"'),
        (lambda a: a["paths"].update(s1=["RSPV", "RSPV"]), "anatomy.paths.s1: joins"),
        (lambda a: a["paths"].pop("s5"), "anatomy.outer_seeds.MV1"),
        (lambda a: a["rims"].update(LAA=["s8"]), "anatomy.rims.LAA"),
        (lambda a: a["rims"].update(RSPV=["s4", "s5", "s1"]), "do not enclose a region"),
        (lambda a: a["regions"].update({"1": ["s1", "s2"]}), "anatomy.regions.1"),
        (lambda a: a["region_names"].pop("5"), "anatomy.region_names.5"),
        (lambda a: a["regions"].pop("5"), "cut out 5 regions"),
    ],
)
def test_contradictory_anatomy_is_refused_by_field(change, message):
    data = LEFT_ATRIUM.to_dict()
    change(data)
    with pytest.raises(TemplateError, match=re.escape(message)):
        Anatomy.from_dict(data)


@pytest.mark.parametrize("name", builtin_templates())
def test_regions_and_holes_of_builtin_templates_cover_the_map(name):
    template = Template.load(name)
    assert template.name == name

    def area(outline):
        x, y = outline.T
        return 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))

    regions = {number: area(template.region_outline(number, step=0.1)) for number in template.anatomy.regions}
    assert min(regions.values()) > 0.02
    holes = sum(np.pi * np.prod(rim.shape.semi_axes) for rim in template.holes.values())
    whole = {"rectangle": 1.2 * 0.9, "square": 1.0}.get(name, np.pi / 4)
    assert sum(regions.values()) + holes == pytest.approx(whole, rel=1e-4)


def test_adapted1_has_the_published_numbers():
    # Facts: ratios 1.1 / 1.1 / 1.35 / 1.35 to the left inferior vein, left carina .175, width 2.6 times it.
    radius = {hole: rim.shape.semi_axes[0] for hole, rim in ADAPTED1.holes.items()}
    for hole, ratio in {"LIPV": 1.0, "LSPV": 1.1, "RIPV": 1.1, "RSPV": 1.35, "LAA": 1.35}.items():
        assert radius[hole] == pytest.approx(0.03 * ratio)
    centre = {hole: np.array(rim.shape.centre) for hole, rim in ADAPTED1.holes.items()}
    assert np.linalg.norm(centre["LSPV"] - centre["LIPV"]) == pytest.approx(0.175)
    assert np.linalg.norm(centre["RSPV"] - centre["RIPV"]) == pytest.approx(0.175 * 1.1)
    assert centre["RIPV"][0] - centre["LIPV"][0] == pytest.approx(0.175 * 2.6)
    assert (centre["LAA"] - centre["LSPV"]).tolist() == pytest.approx([-0.03, 1.2 * 0.175])
    shares = ADAPTED1.holes["RSPV"].shares(LEFT_ATRIUM.feet("RSPV"))
    assert shares.tolist() == pytest.approx([0.25, 0.3125, 0.4375])
    assert not ADAPTED1.holes["LAA"].spread_feet


def test_population_has_the_measured_ratios():
    template = Template.load("population")
    centre = {hole: np.array(rim.shape.centre) for hole, rim in template.holes.items()}
    carina = np.linalg.norm(centre["LSPV"] - centre["LIPV"])
    assert (centre["RSPV"][0] - centre["LSPV"][0]) / carina == pytest.approx(3.75, rel=0.01)
    assert np.linalg.norm(centre["RSPV"] - centre["RIPV"]) / carina == pytest.approx(1.1, rel=0.01)
    assert (centre["LAA"] - centre["LSPV"])[1] / carina == pytest.approx(1.6, rel=0.01)

    def to_valve(side):
        return np.mean([0.5 - abs(centre[v][0]) - template.holes[v].shape.semi_axes[0] for v in side])

    assert to_valve(["LSPV", "LIPV"]) / to_valve(["RSPV", "RIPV"]) == pytest.approx(0.5, rel=0.02)


def test_ellipse_is_walked_by_length():
    shape = Shape((1.0, 2.0), (3.0, 1.0), 30.0)
    angles = shape.angle_at(0.0, 360.0, np.linspace(0, 1, 201))
    steps = np.linalg.norm(np.diff(shape.at(angles), axis=0), axis=1)
    assert np.ptp(steps) < 0.02 * steps.mean()
    # Ramanujan's second formula.
    h = ((3 - 1) / (3 + 1)) ** 2
    assert shape.arc_length(0, 360) == pytest.approx(np.pi * 4 * (1 + 3 * h / (10 + np.sqrt(4 - 3 * h))), rel=1e-5)
    assert shape.distance(shape.at(np.linspace(0, 360, 50))).max() < 1e-12
    assert shape.distance(np.array([[1.0, 2.0]]))[0] == pytest.approx(1.0)


def test_circle_measures_angles_and_distances():
    shape = Shape((0.0, 0.0), (2.0, 2.0))
    assert shape.at(90.0).tolist() == pytest.approx([0.0, 2.0])
    assert shape.arc_length(0, 90) == pytest.approx(np.pi)
    assert shape.distance(np.array([[3.0, 4.0]]))[0] == pytest.approx(3.0)


def test_user_template_file(tmp_path):
    data = document()
    data["name"] = "mine"
    data["holes"]["LAA"]["shape"] = {"type": "ellipse", "centre": [-0.28, 0.285], "semi_axes": [0.03, 0.04]}
    data["anatomy"] = LEFT_ATRIUM.to_dict()
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(data))
    template = Template.load(path)
    assert template.name == "mine"
    assert template.anatomy == LEFT_ATRIUM
    assert template.holes["LAA"].shape.semi_axes == (0.03, 0.04)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.pop("holes"), "holes"),
        (lambda d: d["holes"]["RSPV"]["shape"].update(radius=-1), "holes.RSPV.shape.radius"),
        (lambda d: d["holes"]["RSPV"]["shape"].update(radius="big"), "holes.RSPV.shape.radius"),
        (lambda d: d["holes"]["RSPV"].update(colour="red"), "colour"),
        (lambda d: d.update(schema="laflattening-template/9"), "schema"),
        (lambda d: d.update(anatomy="right_kidney"), "anatomy: expected the name of a built-in anatomy"),
        (lambda d: d["holes"].pop("LAA"), "holes.LAA: missing"),
        (lambda d: d["holes"].update(XYZ=d["holes"]["LAA"]), "holes.XYZ: unknown opening"),
        (lambda d: d["holes"]["RSPV"]["feet"].pop("s1"), "holes.RSPV.feet: expected an angle for each of"),
        (lambda d: d["holes"]["RSPV"]["feet"].update(s1=22.5, s5=270), "holes.RSPV.feet: angles out of order"),
        (lambda d: d["outer"]["feet"].update(s5=-45), "outer.feet: angles out of order"),
        (lambda d: d["holes"]["RSPV"]["shape"].update(centre=[0.48, 0.08]), "holes.RSPV.shape: reaches beyond"),
        (lambda d: d["holes"]["RSPV"]["shape"].update(centre=[0.205, -0.09]), "overlaps"),
        (lambda d: d["holes"]["LAA"]["shape"].update(centre=[0.0, 0.08]), "crosses the hole LAA"),
        (lambda d: d["outer"]["feet"].update(s9=60.0, s7=140.0), "cross"),
    ],
)
def test_impossible_templates_are_refused_by_field(change, message):
    data = copy.deepcopy(document())
    change(data)
    with pytest.raises(TemplateError, match=re.escape(message)):
        Template.from_dict(data)


def test_unknown_name_lists_the_known_ones():
    with pytest.raises(TemplateError, match="adapted1, adapted2, left_ventricle, population"):
        Template.load("adapted7")


def test_schema_is_valid_and_accepts_what_ships():
    jsonschema = pytest.importorskip("jsonschema")
    schema = template_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(document(), schema)


def test_no_algorithm_names_a_vein():
    """The algorithms loop over the table: labels of the left atrium stand in anatomy.py and the templates only.

    The phantom is a left atrium, and so are the maps of others (peers): their layouts are theirs.
    """
    from pathlib import Path

    import LAFlatteningLib

    folder = Path(LAFlatteningLib.__file__).parent
    names = re.compile(r"\b(RSPV|RIPV|LIPV|LSPV|LAA|MV[1-4]?|s[1-9])\b")
    for path in folder.rglob("*.py"):
        if path.name != "anatomy.py" and path.parent.name not in ("phantom", "peers"):
            found = [line for line in path.read_text(encoding="utf-8").splitlines() if names.search(line)]
            assert not found, f"{path.name}: {found[0].strip()}"


@pytest.mark.parametrize("name", ["population", "adapted1"])
def test_numbers_follow_from_the_ratios_in_the_document(name):
    """Docs/templates.md: radii and places of the holes from the published ratios and the numbers that were chosen."""
    template = Template.load(name)
    centre = {hole: np.array(rim.shape.centre) for hole, rim in template.holes.items()}
    radius = {hole: rim.shape.semi_axes[0] for hole, rim in template.holes.items()}
    for hole, ratio in {"LIPV": 1.0, "LSPV": 1.1, "RIPV": 1.1, "RSPV": 1.35, "LAA": 1.35}.items():
        assert radius[hole] == pytest.approx(0.030 * ratio)
    width = 0.455
    carina = 0.175 if name == "adapted1" else width / 3.75
    left, right = (-0.25, 0.205) if name == "adapted1" else _places_half_as_far(width, radius["LSPV"], radius["RSPV"])
    assert right - left == pytest.approx(width)
    up = (1.2 if name == "adapted1" else 1.6) * carina
    expected = {
        "LSPV": (left, -0.0125 + carina / 2),
        "LIPV": (left, -0.0125 - carina / 2),
        "RSPV": (right, -0.0125 + 1.1 * carina / 2),
        "RIPV": (right, -0.0125 - 1.1 * carina / 2),
        "LAA": (left - 0.03, -0.0125 + carina / 2 + up),
    }
    for hole, place in expected.items():
        np.testing.assert_allclose(centre[hole], place, atol=5e-4)


def _places_half_as_far(width, left_radius, right_radius):
    """x of the veins, so that the gap to the outer rim is half as large on the left as on the right."""
    # 0.5 + left - left_radius = (0.5 - right - right_radius) / 2, and right = left + width.
    left = (0.5 * (0.5 - width - right_radius) - 0.5 + left_radius) / 1.5
    return left, left + width
