"""Patient directions: stated by the file, estimated from the seeds where its axes are unknown, else left out."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from vtkmodules.vtkCommonCore import reference
from vtkmodules.vtkCommonDataModel import vtkStaticCellLocator

from LAFlatteningLib.anatomy import LEFT_ATRIUM
from LAFlatteningLib.axes import with_axes
from LAFlatteningLib.cavity.plane_files import read_planes
from LAFlatteningLib.cli import main
from LAFlatteningLib.errors import SeedError, SurfaceError
from LAFlatteningLib.files import read_seeds, read_surface, write_seeds, write_surface
from LAFlatteningLib.flattening import Flattener, flatten
from LAFlatteningLib.map_data import MapData
from LAFlatteningLib.measurement import measure
from LAFlatteningLib.phantom import make_phantom
from LAFlatteningLib.preparation import PrepareSettings, prepare
from LAFlatteningLib.views import ROWS, PatientFrame, estimate_axes

QUARTERS = {axis: Rotation.from_euler(axis, 90, degrees=True) for axis in "xyz"}
ATRIA = [("frf_demo", "seeds_operator1.csv"), ("frf_demo", "seeds_operator2.csv"), ("pvi_gap", "seeds.csv")]


def turned(phantom, turn):
    """The surface and the seeds of a phantom, turned; it still says LPS."""
    surface = replace(phantom.surface, points=turn.apply(np.array(phantom.surface.points)))
    return surface, {label: turn.apply(place) for label, place in phantom.seeds.items()}


def degrees_off(axes, truth):
    """(3,) angles between the rows of two frames."""
    return np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", axes, truth), -1.0, 1.0)))


@pytest.fixture(scope="module", params=QUARTERS)
def quarter(request, phantom):
    """A turn by 90 degrees, and the map of the phantom turned by it, axes unknown."""
    surface, seeds = turned(phantom, QUARTERS[request.param])
    return QUARTERS[request.param], flatten(surface, seeds, check_axes=False)


# ---- the estimate ----------------------------------------------------------------------------------------------------


def test_axes_that_the_file_states_are_taken(phantom, phantom_map):
    for frame in (phantom_map.frame, MapData.of(phantom_map).frame, PatientFrame.of(phantom.surface, {})):
        np.testing.assert_array_equal(frame.axes, np.eye(3))
        assert not frame.fact
    assert not any("axes" in note for note in phantom_map.notes)
    assert "patient_axes" not in phantom_map.to_surface().field_data
    ras = PatientFrame.of_space("RAS")
    assert [ras.direction(name).tolist() for name in ROWS] == [[-1, 0, 0], [0, -1, 0], [0, 0, 1]]
    assert ras.direction("right").tolist() == [1, 0, 0]


def test_an_atrium_that_lies_as_the_mean_is_found_as_it_is_turned():
    sphere = make_phantom(500, closed=True).surface
    points = sphere.points - np.average(
        sphere.points[sphere.triangles].mean(axis=1), axis=0, weights=sphere.triangle_areas
    )
    for seed in range(5):
        turn = Rotation.random(random_state=seed)
        surface = replace(sphere, points=turn.apply(points) + 7.0)
        # At any distance from the middle.
        places = {
            name: turn.apply(np.array(at) * (20.0 + 5.0 * k)) + 7.0
            for k, (name, at) in enumerate(LEFT_ATRIUM.layout.items())
        }
        np.testing.assert_allclose(estimate_axes(surface, places, LEFT_ATRIUM), turn.as_matrix().T, atol=1e-9)


def test_directions_of_the_turned_phantom(phantom, quarter):
    turn, flat_map = quarter
    axes = flat_map.frame.axes
    assert np.isclose(np.linalg.det(axes), 1.0)
    # The phantom is simpler than an atrium: its openings lie 20 degrees and more off the mean layout.
    assert (degrees_off(axes, turn.as_matrix().T) < 30.0).all()
    straight = estimate_axes(phantom.surface, phantom.seeds, LEFT_ATRIUM)
    np.testing.assert_allclose(axes, straight @ turn.as_matrix().T, atol=0.02)


@pytest.mark.parametrize(("folder", "file"), ATRIA)
def test_directions_of_real_atria(data_dir, folder, file):
    surface = read_surface(data_dir / folder / "cavity.vtp")
    seeds = read_seeds(data_dir / folder / file, surface.space)
    assert (degrees_off(estimate_axes(surface, seeds, LEFT_ATRIUM), np.eye(3)) < 20.0).all()


def test_without_seeds_or_layout_nothing_is_said(phantom):
    unknown = phantom.surface.with_unknown_axes()
    bare = replace(LEFT_ATRIUM, layout={})
    for seeds, anatomy in (({}, None), ({}, LEFT_ATRIUM), (phantom.seeds, bare)):
        frame = PatientFrame.of(unknown, seeds, anatomy)
        assert frame.axes is None and "no directions" in frame.fact
        for view in frame.views:
            assert not view.ends and "unknown" in view.heading
        with pytest.raises(ValueError, match="not known"):
            frame.direction("left")


def test_seeds_that_contradict_the_axes_of_a_map_file(quarter):
    """As such files were written before they said that their axes are unknown."""
    _, flat_map = quarter
    file = flat_map.to_surface()
    old = replace(file, field_data={k: v for k, v in file.field_data.items() if k != "patient_axes"})
    data = MapData.of(old)
    assert data.surface.axes_known and "contradict" in data.frame.fact
    np.testing.assert_allclose(data.frame.axes, flat_map.frame.axes, atol=1e-6)


# ---- unknown axes travel ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("space", ["LPS", "RAS"])
@pytest.mark.parametrize("suffix", [".vtp", ".vtk"])
def test_files_keep_that_axes_are_unknown(phantom, tmp_path, space, suffix):
    surface, seeds = turned(phantom, QUARTERS["x"])
    surface = replace(surface, space=space)
    with pytest.raises(SeedError, match="axes"):
        flatten(surface, seeds)
    made = flatten(surface, seeds, check_axes=False)
    for name, one in (("cavity", made.surface), ("map", made.to_surface())):
        write_surface(one, tmp_path / f"{name}{suffix}")
    write_seeds(seeds, tmp_path / "seeds.mrk.json", made.surface.space)
    cavity, flat = (read_surface(tmp_path / f"{name}{suffix}") for name in ("cavity", "map"))
    assert cavity.space == space and not cavity.axes_known and not flat.axes_known
    again = read_seeds(tmp_path / "seeds.mrk.json", cavity.space)
    np.testing.assert_allclose([again[label] for label in seeds], list(seeds.values()), atol=1e-9)
    # Neither is refused again.
    assert any("axes of the file are unknown" in note for note in flatten(cavity, again).notes)
    assert measure(cavity, again).area_cm2 > 0.0
    frame = MapData.of(flat).frame
    assert "estimated from the seeds" in frame.fact
    np.testing.assert_allclose(frame.axes, made.frame.axes, atol=1e-6)


def test_naming_the_axes_makes_them_known(phantom):
    unknown = phantom.surface.with_unknown_axes()
    assert unknown.axes_name == "unknown" and unknown.with_unknown_axes() is unknown
    for axes in ("RAS", "CARTO"):
        assert with_axes(unknown, axes)[0].axes_known
    assert "patient_axes" in unknown.field_data  # as it was


def test_preparing_an_atrium_in_unknown_axes(tmp_path, capsys):
    closed = make_phantom(3000, closed=True)
    surface = turned(closed, QUARTERS["y"])[0]
    write_surface(surface, tmp_path / "raw.vtp")
    cavity, seeds, report = (tmp_path / name for name in ("cavity.vtp", "seeds.mrk.json", "prepare.json"))
    files = ["--output", str(cavity), "--seeds-output", str(seeds), "--report", str(report)]
    arguments = ["prepare", str(tmp_path / "raw.vtp"), "--points", "0", *files]
    assert main([*arguments, "--ignore-axes", "--axes", "LPS"]) == 2
    assert "leave one of them out" in capsys.readouterr().err
    assert main(arguments) == 2
    capsys.readouterr()
    assert main([*arguments, "--ignore-axes"]) == 0
    said = capsys.readouterr().out
    assert "LPS" not in said and "patient axes: unknown" in said
    assert json.loads(report.read_text(encoding="utf-8"))["space"] == "unknown"
    assert not read_surface(cavity).axes_known
    # Its planes are in the coordinates of the surface, whatever these are.
    for space in ("LPS", "RAS"):
        planes = read_planes(report, space)
        assert np.allclose(planes["MV"].centre, json.loads(report.read_text())["planes"]["MV"]["centre_mm"])
    files = ["--output", str(tmp_path / "map.vtp"), "--metrics", str(tmp_path / "m.json")]
    assert main(["flatten", str(cavity), "--seeds", str(seeds), *files]) == 0
    assert any("unknown" in note for note in json.loads((tmp_path / "m.json").read_text())["notes"])
    assert main(["info", str(cavity)]) == 0
    assert "patient axes: unknown" in capsys.readouterr().out


def test_seeds_in_other_axes_than_a_surface_in_unknown_ones(phantom):
    seeds = {label: place * (-1.0, -1.0, 1.0) for label, place in phantom.seeds.items()}
    with pytest.raises(SeedError, match="x and y negated") as caught:
        Flattener(phantom.surface, check_axes=False).flatten(seeds)
    assert "LPS" not in str(caught.value) and "RAS" not in str(caught.value)


def test_an_atrium_and_its_mirror_image_that_fit_as_well(data_dir):
    """`standardised.vtp` is in axes of its own: that is the cause, whatever else is wrong."""
    surface = read_surface(data_dir / "lasc_b002" / "standardised.vtp")
    with pytest.raises(SurfaceError, match=r"axes of the file are probably .*--tips.* --ignore-axes"):
        prepare(surface, PrepareSettings(points=0))


# ---- pictures --------------------------------------------------------------------------------------------------------


def written(axes):
    """Text -> where it stands."""
    return {text.get_text(): np.array(text.get_position()) for text in axes.texts}


def labelled(figure):
    return {axes.get_label(): axes for axes in figure.axes}


def test_words_of_the_figure_are_those_of_the_anatomy(phantom_map, quarter):
    pytest.importorskip("matplotlib", reason="figures need matplotlib")
    from LAFlatteningLib.figures import make_figure

    page = make_figure(quarter[1])
    axes, straight = labelled(page), labelled(make_figure(phantom_map))
    for side in ("x", "y"):
        found, true = (re.split("←|→", getattr(one["map"], f"get_{side}label")()) for one in (axes, straight))
        # What runs across the map is left out.
        for end in (0, 2):
            assert set(re.findall(r"[\w']+", found[end])) <= set(re.findall(r"[\w']+", true[end]))
    assert axes["map"].get_xlabel() == straight["map"].get_xlabel() != "disk radii"
    assert axes["map"].get_ylabel().endswith("anterior")
    behind, front = written(axes["posterior"]), written(axes["anterior"])
    assert {"R5", "R2"} <= set(behind) and "R4" in front
    assert behind["LSPV"][0] < behind["RSPV"][0] and behind["LSPV"][1] > behind["LIPV"][1]
    assert behind["L"][0] < behind["R"][0] and front["R"][0] < front["L"][0]
    assert front["LAA"][0] > front["RSPV"][0]
    assert any("directions estimated from the seeds" in text.get_text() for text in page.texts)


def test_a_figure_without_directions_has_no_words_of_them(quarter):
    pytest.importorskip("matplotlib", reason="figures need matplotlib")
    from LAFlatteningLib.figures import make_figure

    template = replace(quarter[1].template, anatomy=replace(LEFT_ATRIUM, layout={}))
    page = make_figure(replace(quarter[1], template=template))
    axes = labelled(page)
    assert axes["map"].get_xlabel() == axes["map"].get_ylabel() == "disk radii"
    for side in ("one side", "the other side"):
        assert not {"L", "R", "S", "I", "A", "P"} & set(written(axes[side]))
    texts = [text.get_text() for one in (page, *page.axes) for text in one.texts]
    assert not any(word in text for word in ("patient's", "Seen from", "posterior view") for text in texts)


@pytest.mark.parametrize("tilt", [0, -40])
def test_names_in_a_picture_of_a_preparation_stand_where_their_opening_is_seen(tilt):
    pytest.importorskip("matplotlib", reason="figures need matplotlib")
    from LAFlatteningLib.preparation_figure import make_preparation_figure

    surface, _ = turned(make_phantom(3000, closed=True), Rotation.from_euler("x", tilt, degrees=True))
    done = prepare(surface, PrepareSettings(points=0, ignore_axes=True))
    frame = PatientFrame.of_space("LPS")
    # As the file has them, so that the valve is seen from the side.
    done.cavity, done.surface = (replace(one, field_data={}) for one in (done.cavity, done.surface))
    axes = labelled(make_preparation_figure(done))
    locator = vtkStaticCellLocator()
    locator.SetDataSet(done.surface.to_polydata())
    locator.BuildLocator()
    checked = 0
    for view in frame.views:
        for name, place in written(axes[view.name]).items():
            if name not in done.rims:
                continue
            line = view.project(done.cavity.points[done.rims[name]])
            places = np.concatenate([line, line.mean(axis=0)[None]])
            nearest = places[np.linalg.norm(places[:, :2] - place, axis=1).argmin()]
            assert np.linalg.norm(nearest[:2] - place) < 0.1
            start, end = (nearest @ view.axes + away * view.axes[2] for away in (2.0, 300.0))
            out = (reference(0.0), [0.0] * 3, [0.0] * 3, reference(0))
            hit = locator.IntersectWithLine(start, end, 1e-6, *out)
            assert not hit, (view.name, name)
            checked += 1
    assert checked >= 6
