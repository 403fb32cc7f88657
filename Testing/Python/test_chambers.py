"""Other chambers and outlines on the map: by templates alone."""

import copy
import re

import chambers
import numpy as np
import pytest

from LAFlatteningLib import Flattener, SeedError, Surface, Template, TemplateError, make_phantom
from LAFlatteningLib.distortion import overlapping_pairs
from LAFlatteningLib.operators import signed_areas
from LAFlatteningLib.shapes import Polygon

SHIPPED = {
    "left_ventricle": chambers.ventricle(),
    "right_atrium": chambers.right_atrium(subdivisions=4),
    "right_atrium_cs": chambers.right_atrium(True),
}


def polygon_area(corners):
    x, y = corners.T
    return 0.5 * abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def check(flat_map):
    """What a map of any chamber must be: without folds, rims on their outlines, paths straight, landmarks in place."""
    template, division = flat_map.template, flat_map.division
    assert len(flat_map.folded_triangles) == 0
    assert len(overlapping_pairs(flat_map.points, flat_map.triangles)) == 0
    for opening, loop in division.loops.items():
        assert template.rim(opening).shape.distance(flat_map.solution[loop]).max() < 1e-12
    for path, ids in division.paths.items():
        start, end = template.segment(path)
        along = (end - start) / np.linalg.norm(end - start)
        off = flat_map.solution[ids] - start
        assert np.abs(off @ [-along[1], along[0]]).max() < 1e-12
        assert (np.diff(off @ along) > 0).all()
        np.testing.assert_allclose(flat_map.solution[ids[[0, -1]]], [start, end], atol=1e-12)
    for landmark, point in division.landmarks.items():
        assert flat_map.solution[point].tolist() == list(template.landmarks[landmark])
    assert set(flat_map.regions.tolist()) == set(template.anatomy.regions)


@pytest.mark.parametrize("name", SHIPPED)
def test_other_chambers_are_laid_flat(name):
    surface, seeds = SHIPPED[name]
    flat_map = Flattener(surface, name).flatten(seeds)
    check(flat_map)
    assert flat_map.metrics["notes"] == []


@pytest.mark.parametrize("name", SHIPPED)
def test_published_rules_take_other_chambers(name):
    surface, seeds = SHIPPED[name]
    flat_map = Flattener(surface, name, "paper").flatten(seeds)
    assert flat_map.rim_error < 1e-9
    assert len(flat_map.folded_triangles) <= 3


def test_the_ventricle_is_the_bulls_eye():
    """A body of revolution: azimuth stays, the radius grows with the distance from the apex, thirds are thirds."""
    surface, seeds = SHIPPED["left_ventricle"]
    flat_map = Flattener(surface, "left_ventricle").flatten(seeds)
    x, y, z = surface.points.T
    radius = np.hypot(*flat_map.points.T)
    # LPS: +x is the patient's left and right on the map, -y anterior and up.
    off_axis = np.hypot(x, y) > 8.0
    turn = np.angle((x - 1j * y)[off_axis] / (flat_map.points @ [1.0, 1j])[off_axis], deg=True)
    assert np.median(np.abs(turn)) < 1.0
    assert np.abs(turn).max() < 5.0
    for low, high in ((-65, -45), (-45, -25), (-25, -5)):
        band = radius[(z > low) & (z <= high)]
        assert np.std(band) < 0.06
    heights = [radius[np.abs(z - height) < 2.5].mean() for height in (-60, -45, -30, -15, 0)]
    assert (np.diff(heights) > 0.03).all()
    area = np.bincount(flat_map.regions, surface.triangle_areas)[1:]
    np.testing.assert_allclose(area / area.sum(), 1 / 3, atol=0.02)


def test_the_apex_is_where_the_seed_is():
    surface, seeds = SHIPPED["left_ventricle"]
    place = np.array([6.0, 3.0, 0.0])
    place[2] = -70.0 * np.sqrt(1.0 - (6.0 / 25.0) ** 2 - (3.0 / 25.0) ** 2)
    flat_map = Flattener(surface, "left_ventricle").flatten({**seeds, "APEX": place})
    check(flat_map)
    point = flat_map.division.landmarks["APEX"]
    assert np.linalg.norm(surface.points - place, axis=1).argmin() == point
    moved = np.linalg.norm(surface.points[point] - place)
    assert flat_map.metrics["seed_moved_mm"]["APEX"] == pytest.approx(moved)


def test_a_landmark_may_sit_where_paths_are_crowded():
    """Close to the base, the paths to it are squeezed between rim and each other: still no fold."""
    surface, seeds = SHIPPED["left_ventricle"]
    for degrees in (20.0, 100.0, 260.0):
        turn = np.deg2rad(degrees)
        place = np.array([20.0 * np.cos(turn), 20.0 * np.sin(turn), -42.0])
        check(Flattener(surface, "left_ventricle").flatten({**seeds, "APEX": place}))


def test_previews_of_a_chamber_with_a_landmark():
    surface, seeds = SHIPPED["left_ventricle"]
    flattener = Flattener(surface, "left_ventricle")
    flat_map = flattener.flatten(seeds)
    preview = flattener.preview(seeds)
    assert np.median(np.linalg.norm(preview.points - flat_map.points, axis=1)) < 0.01 * flat_map.template.radius


@pytest.mark.parametrize("name", ["square", "rectangle"])
@pytest.mark.parametrize("method", ["regional", "paper"])
def test_the_left_atrium_on_other_outlines(name, method):
    phantom = make_phantom(2000)
    flat_map = Flattener(phantom.surface, name, method).flatten(phantom.seeds)
    assert flat_map.rim_error < 1e-9
    if method == "regional":
        check(flat_map)
        # Nothing of the outline is missing.
        template = flat_map.template
        corners = np.ptp(template.outer.shape.outline(), axis=0)
        holes = sum(polygon_area(flat_map.solution[flat_map.division.loops[hole]]) for hole in template.holes)
        area = signed_areas(flat_map.solution, flat_map.division.surface.triangles).sum()
        assert area + holes == pytest.approx(corners.prod(), rel=1e-9)


def test_any_convex_polygon_will_do():
    phantom = make_phantom(2000)
    data = Template.load("adapted1").to_dict()
    corners = [[0.6 * np.cos(t), 0.6 * np.sin(t)] for t in np.deg2rad([10, 75, 140, 200, 265, 320])]
    data.update(name="hexagon", outer={"shape": {"type": "polygon", "corners": corners}, "feet": data["outer"]["feet"]})
    template = Template.from_dict(data)
    assert isinstance(template.outer.shape, Polygon)
    assert Template.from_dict(template.to_dict()) == template
    check(Flattener(phantom.surface, template).flatten(phantom.seeds))


# ---- what is refused -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("left_ventricle", lambda d: d.pop("landmarks"), "landmarks.APEX: missing"),
        ("left_ventricle", lambda d: d["landmarks"].update(TIP=[0, 0.1]), "landmarks.TIP: unknown landmark"),
        ("left_ventricle", lambda d: d["landmarks"].update(APEX=[0.6, 0]), "landmarks.APEX: lies beyond the outer rim"),
        ("left_ventricle", lambda d: d["landmarks"].update(APEX=[0.0, None]), "landmarks.APEX"),
        ("left_ventricle", lambda d: d["outer"]["feet"].update(v1=240, v2=120), "outer.feet: angles out of order"),
        ("left_ventricle", lambda d: d["anatomy"]["rims"].update(APEX=["v1", "v3", "v2"]), "do not enclose a region"),
        ("left_ventricle", lambda d: d["anatomy"]["landmarks"].update(B1="twice"), '"B1" is used twice'),
        ("right_atrium", lambda d: d.update(landmarks={"APEX": [0, 0]}), "right_atrium has none"),
        ("square", lambda d: d["outer"]["shape"].update(width=-1), "outer.shape.width"),
        ("square", lambda d: d["outer"]["shape"].update(width=0.5), "reaches beyond the outer rim"),
        (
            "square",
            lambda d: d["outer"].update(shape={"type": "polygon", "corners": [[-1, -1], [1, -1], [0, 0], [-1, 1]]}),
            "outer.shape.corners: expected a convex polygon",
        ),
        (
            "square",
            lambda d: d["holes"]["LAA"].update(
                shape={"type": "rectangle", "centre": [-0.3, 0.3], "width": 0.1, "height": 0.1}
            ),
            "holes.LAA.shape",
        ),
    ],
)
def test_impossible_layouts_are_refused_by_field(name, change, message):
    data = copy.deepcopy(Template.load(name).to_dict())
    change(data)
    with pytest.raises(TemplateError, match=re.escape(message)):
        Template.from_dict(data)


def test_seeds_of_other_chambers_are_checked():
    surface, seeds = SHIPPED["left_ventricle"]
    flattener = Flattener(surface, "left_ventricle")
    with pytest.raises(SeedError, match="APEX is 30 mm from the surface"):
        flattener.flatten({**seeds, "APEX": np.array([0.0, 0.0, -100.0])})
    with pytest.raises(SeedError, match="mirrored"):
        flattener.flatten({**seeds, "B1": seeds["B2"], "B2": seeds["B1"]})
    with pytest.raises(SeedError, match="Seed missing: APEX"):
        flattener.flatten({label: place for label, place in seeds.items() if label != "APEX"})
    surface, seeds = SHIPPED["right_atrium"]
    with pytest.raises(SeedError):
        Flattener(surface, "right_atrium").flatten({**seeds, "SVC": seeds["IVC"], "IVC": seeds["SVC"]})
    upside_down = Surface(surface.points * [1.0, -1.0, -1.0], surface.triangles)
    with pytest.raises(SeedError, match="superior"):
        Flattener(upside_down, "right_atrium").flatten({k: v * [1.0, -1.0, -1.0] for k, v in seeds.items()})
