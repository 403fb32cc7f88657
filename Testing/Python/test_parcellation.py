"""Sub-regions drawn on the map."""

import copy
import json
import re

import numpy as np
import pytest

from LAFlatteningLib.errors import LAFlatteningError, SurfaceError, TemplateError
from LAFlatteningLib.files import read_surface, write_surface
from LAFlatteningLib.map_data import MapData
from LAFlatteningLib.parcellation import (
    NO_PART,
    Parcellation,
    builtin_parcellations,
    parcellation_schema,
)
from LAFlatteningLib.template import Template, builtin_templates

ADAPTED1 = Template.load("adapted1")
LEFT_SIDE = {"schema": "laflattening-parcellation/1", "name": "left_side", "anatomy": "left_atrium"}


def document(area, **more):
    return {**LEFT_SIDE, "parts": [{"label": 3, "name": "one", "area": area}], **more}


def grid(step=0.004):
    places = np.stack(np.meshgrid(*2 * [np.arange(-0.5, 0.5, step) + 0.5 * step]), axis=-1).reshape(-1, 2)
    return places[np.linalg.norm(places, axis=1) < 0.5]


@pytest.mark.parametrize("name", builtin_parcellations())
@pytest.mark.parametrize("template", builtin_templates("left_atrium"))
def test_builtin_parts_lie_on_every_template(name, template):
    parcellation, template = Parcellation.load(name), Template.load(template)
    places = grid()
    free = np.ones(len(places), bool)
    for rim in template.holes.values():
        # Circles and ellipses of the built-in templates stand upright.
        free &= np.linalg.norm((places - rim.shape.centre) / rim.shape.semi_axes, axis=1) > 1.0
    for part in parcellation.parts:
        labels = parcellation.labels_at(places[free], template, part.name)
        assert set(labels.tolist()) == {NO_PART, part.label}, part.name


@pytest.mark.parametrize("template", builtin_templates("left_atrium"))
def test_the_24_regions_cover_the_map_once_each(template):
    parcellation = Parcellation.load("segments_24")
    labels = parcellation.labels_at(grid(), Template.load(template))
    assert sorted(parcellation.names) == list(range(1, 25))
    assert set(labels.tolist()) == set(range(1, 25))


@pytest.mark.parametrize("name", ["adapted1", "adapted2", "population"])
def test_every_place_on_a_path_is_in_a_region(name):
    """Paths are the borders of regions: rounding must not leave a place on one outside both."""
    template = Template.load(name)
    parts = [
        {"label": number, "name": f"R{number}", "area": {"type": "region", "number": number}} for number in range(1, 6)
    ]
    regions = Parcellation.from_dict({**LEFT_SIDE, "template": name, "parts": parts})
    for path in template.anatomy.paths:
        start, stop = np.array(template.segment(path))
        along = start + np.linspace(0.0, 1.0, 2001)[:, None] * (stop - start)
        assert (regions.labels_at(along, template) > 0).all()


def test_whole_regions_are_those_of_the_map(phantom_map):
    parts = [
        {"label": number, "name": f"R{number}", "area": {"type": "region", "number": number}} for number in range(1, 6)
    ]
    labels = Parcellation.from_dict({**LEFT_SIDE, "parts": parts}).labels_of(phantom_map)
    # Only triangles that a path crosses may differ.
    division = phantom_map.division
    whole = np.bincount(division.parent, minlength=len(phantom_map.triangles)) == 1
    assert (labels.cells == phantom_map.regions)[whole].all()
    assert (labels.points > 0).all()


def test_vein_surroundings_are_the_published_ones():
    surroundings = Parcellation.load("vein_surroundings")
    places = grid()
    areas = {
        part.name: surroundings.contains(part.name, places, ADAPTED1).mean() * np.pi / 4 for part in surroundings.parts
    }
    # Facts: disks of radius about .145 (left disks are .142 and .145 to stay off the other vein), ellipses of semi-axes
    # (.138, .2145) and (.138, .213).
    assert areas["RSPV"] == pytest.approx(np.pi * 0.145**2, rel=0.01)
    assert areas["LIPV"] == pytest.approx(np.pi * 0.142**2, rel=0.01)
    assert areas["left"] == pytest.approx(np.pi * 0.138 * 0.2145, rel=0.01)
    assert areas["right"] == pytest.approx(np.pi * 0.138 * 0.213, rel=0.01)
    x, y = places[surroundings.contains("right", places, ADAPTED1)].mean(axis=0)
    assert (x, y) == pytest.approx((0.201, -0.011), abs=0.005)


def test_segments_are_where_their_names_say():
    segments = Parcellation.load("vein_segments")
    ids = {name: label for label, name in segments.names.items()}
    # On the map +y is roof and -y floor; the posterior wall lies between the veins.
    for place, name in [
        ((-0.25, 0.17), "left superior"),
        ((-0.25, -0.19), "left inferior"),
        ((-0.15, -0.01), "left posterior carina"),
        ((-0.35, -0.01), "left anterior carina"),
        ((0.10, -0.01), "right posterior carina"),
        ((0.30, -0.01), "right anterior carina"),
        ((0.27, 0.13), "right anterosuperior"),
        ((0.13, -0.14), "right posteroinferior"),
        # Between the veins, from the one to the other.
        ((-0.25, -0.06), "left carina"),
        ((-0.23, 0.03), "left carina"),
        ((0.19, 0.03), "right carina"),
        ((0.21, -0.07), "right carina"),
    ]:
        assert segments.labels_at(np.array([place]), ADAPTED1).tolist() == [ids[name]], name


def test_rings_and_sectors_are_measured_from_the_rim():
    quarter = Parcellation.from_dict(document({"type": "ring", "hole": "RSPV", "width": 0.1, "sector": [0, 90]}))
    centre, radius = np.array([0.205, 0.08375]), 0.0405 + 0.05
    for turn, far, inside in [(45, 0.99, True), (45, 1.01, False), (-1, 0.9, False), (91, 0.9, False), (89, 0.9, True)]:
        place = centre + far * radius * np.array([np.cos(np.radians(turn)), np.sin(np.radians(turn))])
        assert quarter.contains("one", place[None], ADAPTED1)[0] == inside


def test_first_part_wins_where_parts_do_not_overlap():
    parts = [
        {"label": 7, "name": "ring", "area": {"type": "ring", "hole": "LAA", "width": 0.1}},
        {"label": 2, "name": "wall", "area": {"type": "region", "number": 4}},
    ]
    both = Parcellation.from_dict({**LEFT_SIDE, "parts": parts})
    place = np.array([[-0.22, 0.285]])
    assert both.labels_at(place, ADAPTED1).tolist() == [7]
    assert both.labels_at(place, ADAPTED1, "wall").tolist() == [2]


def test_overlapping_parts_are_asked_for_one_at_a_time(phantom_map):
    surroundings = Parcellation.load("vein_surroundings")
    with pytest.raises(TemplateError, match=r"overlap.*Name one of RSPV, RIPV, LIPV, LSPV, left, right"):
        surroundings.labels_of(phantom_map)
    carried = surroundings.carry(phantom_map)
    assert set(np.unique(carried.cell_data["vein_surroundings_left"])) == {0, 5}
    assert len(carried.point_data["vein_surroundings_RSPV"]) == len(phantom_map.points)


def test_own_file_with_coordinates_keeps_to_its_template(tmp_path, phantom_map):
    area = {"type": "polygon", "corners": [[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]]}
    path = tmp_path / "square.json"
    path.write_text(json.dumps(document(area, template="adapted1")))
    square = Parcellation.load(path)
    inside = square.labels_of(phantom_map).points == 3
    assert np.array_equal(inside, (np.abs(phantom_map.points) < 0.1).all(axis=1))
    with pytest.raises(TemplateError, match="drawn on the template adapted1, and the map was made on population"):
        square.labels_at(phantom_map.points, Template.load("population"))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.pop("parts"), "parts"),
        (lambda d: d.update(schema="laflattening-template/1"), "schema"),
        (lambda d: d.update(anatomy="left_kidney"), "anatomy: expected the name of a built-in anatomy"),
        (lambda d: d["parts"][0].update(label=0), "parts[0].label"),
        (lambda d: d["parts"][0].update(colour="red"), "colour"),
        (lambda d: d["parts"].append(d["parts"][0]), "parts[1].label"),
        (lambda d: d["parts"][0]["area"].update(hole="RMPV"), 'parts[0].area: "RMPV" is no hole of left_atrium'),
        (lambda d: d["parts"][0].update(area={"type": "strip", "path": "s12", "half_width": 0.1}), '"s12" is no path'),
        (lambda d: d["parts"][0].update(area={"type": "region", "number": 8}), '"8" is no region'),
        (lambda d: d["parts"][0]["area"].update(sector=[90, 0]), "parts[0].area.sector"),
        (lambda d: d["parts"][0]["area"].update(width=-1), "parts[0].area.width"),
        (
            lambda d: d["parts"][0].update(area={"type": "ellipse", "centre": [0, 0], "semi_axes": [0.1, 0.2]}),
            "parts[0].area: has coordinates of its own",
        ),
    ],
)
def test_impossible_files_are_refused_by_field(change, message):
    data = copy.deepcopy(document({"type": "ring", "hole": "RSPV", "width": 0.1}))
    change(data)
    with pytest.raises(TemplateError, match=re.escape(message)):
        Parcellation.from_dict(data)


def test_unknown_names_list_the_known_ones():
    with pytest.raises(TemplateError, match="segments_24, vein_segments, vein_surroundings"):
        Parcellation.load("segments_25")
    with pytest.raises(TemplateError, match='no part "middle"'):
        Parcellation.load("vein_surroundings").contains("middle", np.zeros((1, 2)), ADAPTED1)


def test_schema_is_valid_and_accepts_what_ships():
    jsonschema = pytest.importorskip("jsonschema")
    from LAFlatteningLib.parcellation import _FOLDER

    jsonschema.Draft202012Validator.check_schema(parcellation_schema())
    for name in builtin_parcellations():
        jsonschema.validate(json.loads((_FOLDER / f"{name}.json").read_text()), parcellation_schema())


def test_a_map_file_gives_the_data_of_its_map(tmp_path, phantom_map):
    write_surface(phantom_map.to_surface(), tmp_path / "map.vtp")
    data = MapData.of(read_surface(tmp_path / "map.vtp"))
    assert np.array_equal(data.flat, phantom_map.points)
    assert np.array_equal(data.surface.points, phantom_map.surface.points)
    assert data.surface.space == phantom_map.surface.space
    assert data.template == phantom_map.template
    cells = MapData.of(phantom_map).point_values("scar"), data.point_values("scar")
    assert np.array_equal(*cells)


def test_what_is_no_map_is_refused(phantom, phantom_map):
    with pytest.raises(SurfaceError, match="not flat"):
        MapData.of(phantom.surface)
    flat = phantom_map.to_surface()
    without = type(flat)(flat.points, flat.triangles, field_data=flat.field_data)
    with pytest.raises(SurfaceError, match="position_mm"):
        MapData.of(without)
    nameless = type(flat)(flat.points, flat.triangles, flat.point_data)
    with pytest.raises(TemplateError, match="does not say on which template"):
        MapData.of(nameless)
    assert MapData.of(nameless, "adapted1").template == ADAPTED1
    for given in ("population", Template.load("population")):
        with pytest.raises(TemplateError, match='on the template "adapted1", and population was given'):
            MapData.of(flat, given)
    with pytest.raises(LAFlatteningError, match='no array "voltage"'):
        MapData.of(phantom_map).point_values("voltage")
