"""Patterns: distances are the true ones, circles are round and of one size, borders are where they belong."""

from __future__ import annotations

import numpy as np
import pytest
from meshes import grid

from LAFlatteningLib import LAFlatteningError, SurfaceError, flatten, make_phantom
from LAFlatteningLib.cli import main
from LAFlatteningLib.files import read_surface, write_surface
from LAFlatteningLib.heat_distance import heat_distance
from LAFlatteningLib.surface import Surface
from LAFlatteningLib.textures import checker, circles, spread_points, stripes


@pytest.fixture(scope="module")
def phantom():
    return make_phantom(4000)


@pytest.fixture(scope="module")
def plane():
    """A square of 40 mm, evenly meshed."""
    return grid(61, 61, 40.0, 40.0)


def test_distance_on_a_plane(plane):
    middle = int(np.linalg.norm(plane.points - plane.points.mean(axis=0), axis=1).argmin())
    true = np.linalg.norm(plane.points - plane.points[middle], axis=1)
    found = heat_distance(plane, middle)
    far = true > 3.0
    assert np.median(np.abs(found - true)[far] / true[far]) < 0.02
    assert found[middle] == 0.0


def test_distance_on_a_sphere(phantom):
    shape, points = phantom.shape, phantom.surface.points
    out = points - shape.centre
    on_body = np.abs(np.linalg.norm(out, axis=1) - shape.radius) < 1e-6
    behind = np.array([0.0, 1.0, 0.0])
    source = int(np.where(on_body, out @ behind, -np.inf).argmax())
    cosine = (out @ out[source]) / np.linalg.norm(out, axis=1) / np.linalg.norm(out[source])
    arc = shape.radius * np.arccos(np.clip(cosine, -1.0, 1.0))
    # So near, no opening is in the way.
    near = on_body & (arc > 4.0) & (arc < 18.0)
    assert near.sum() > 100
    assert np.median(np.abs(heat_distance(phantom.surface, source) - arc)[near] / arc[near]) < 0.02


def test_distance_from_several_points_is_that_from_the_nearest(plane):
    corners = [0, len(plane.points) - 1]
    both = heat_distance(plane, np.array(corners))
    true = np.linalg.norm(plane.points[:, None] - plane.points[corners][None], axis=2).min(axis=1)
    assert np.median(np.abs(both - true)) < 0.6


def test_another_piece_cannot_be_reached(plane):
    two = Surface(
        np.concatenate([plane.points, plane.points + np.array([100.0, 0.0, 0.0])]),
        np.concatenate([plane.triangles, plane.triangles + len(plane.points)]),
    )
    distance = heat_distance(two, 5)
    assert np.isfinite(distance[: len(plane.points)]).all()
    assert np.isinf(distance[len(plane.points) :]).all()
    for wrong in (np.array([], np.int64), -1, len(two.points)):
        with pytest.raises(SurfaceError, match="Expected sources"):
            heat_distance(two, wrong)


def test_points_are_spread(phantom):
    chosen = spread_points(phantom.surface, 60)
    assert len(set(chosen.tolist())) == 60
    places = phantom.surface.points[chosen]
    gap = np.linalg.norm(places[:, None] - places[None], axis=2)
    np.fill_diagonal(gap, np.inf)
    # As far apart as hexagons of that area, roughly; and no place of the atrium is far from all.
    even = np.sqrt(2.0 / np.sqrt(3.0) * phantom.surface.area / 60)
    assert gap.min() > 0.6 * even
    assert np.linalg.norm(phantom.surface.points[:, None] - places[None], axis=2).min(axis=1).max() < 1.2 * even
    with pytest.raises(LAFlatteningError, match="no more"):
        spread_points(phantom.surface, 10_000)


def test_circles_have_their_radius(plane):
    pattern = circles(plane, 9, 4.0)
    for number, centre in enumerate(pattern.centres, 1):
        own = (pattern.labels == number) & (pattern.values > 0.0)
        away = np.linalg.norm(plane.points[own] - plane.points[centre], axis=1)
        assert away.max() < 4.0
    inside = np.linalg.norm(plane.points[:, None] - plane.points[pattern.centres][None], axis=2).min(axis=1) < 4.0
    np.testing.assert_array_equal(pattern.values > 0.0, inside)
    arrays = pattern.on(plane).point_data
    assert set(np.unique(arrays["circles_number"][arrays["circles"] > 0])) == set(range(1, 10))


def test_circles_do_not_reach_through_the_wall(phantom):
    # On a shell of two walls 1 mm apart, a circle is on one wall only.
    step = np.array([0.0, 0.0, 1.0])
    sheet = grid(41, 41, 40.0, 40.0)
    n = len(sheet.points)
    shell = Surface(
        np.concatenate([sheet.points, sheet.points + step]), np.concatenate([sheet.triangles, sheet.triangles + n])
    )
    pattern = circles(shell, 8, 3.0)
    for number, centre in enumerate(pattern.centres, 1):
        own = np.flatnonzero((pattern.labels == number) & (pattern.values > 0.0))
        assert len(np.unique(own // n)) == 1
        assert own[0] // n == centre // n


def test_circles_that_are_too_small(phantom):
    with pytest.raises(LAFlatteningError, match="smaller than the triangles"):
        circles(phantom.surface, 50, 0.05)
    with pytest.raises(LAFlatteningError, match="radius above 0"):
        circles(phantom.surface, 50, -1.0)


def test_stripes_have_their_width(plane):
    place = plane.points.mean(axis=0)
    pattern = stripes(plane, place, 4.0)
    true = np.linalg.norm(plane.points - plane.points[pattern.centres[0]], axis=1)
    # Away from the borders of stripes, by more than the error of the distance.
    clear = np.abs((true / 4.0 + 0.5) % 1.0 - 0.5) > 0.12
    dark = np.floor(true / 4.0) % 2 == 0
    assert (dark == (pattern.values > 0.0))[clear].mean() > 0.995


def test_checks_alternate(phantom):
    pattern = checker(phantom.surface, phantom.seeds["MV1"], 8.0)
    assert abs((pattern.values > 0.0).mean() - 0.5) < 0.06
    assert len(set(pattern.centres.tolist())) == 2
    for make in (stripes, checker):
        with pytest.raises(LAFlatteningError, match="width above 0"):
            make(phantom.surface, phantom.seeds["MV1"], 0.0)


def test_commands(phantom, tmp_path, capsys):
    flat_map = flatten(phantom.surface, phantom.seeds)
    path = tmp_path / "map.vtp"
    write_surface(flat_map.to_surface(), path)
    for pattern in ("circles", "stripes", "checker"):
        outputs = ["--output", f"{tmp_path}/{pattern}.vtp", "--figure", f"{tmp_path}/{pattern}.png"]
        assert main(["texture", str(path), "--pattern", pattern, *outputs]) == 0
        assert pattern in read_surface(tmp_path / f"{pattern}.vtp").point_data
        assert (tmp_path / f"{pattern}.png").stat().st_size > 20_000
    assert main(["texture", str(path)]) == 2
    assert "Nothing would be written" in capsys.readouterr().err
    assert main(["texture", str(path), "--pattern", "stripes", "--from", "1,2", "--figure", f"{tmp_path}/x.png"]) == 2
    assert "expected three numbers" in capsys.readouterr().err
