"""Peer maps: closed forms of each, and what the table says of the phantom."""

from __future__ import annotations

import csv
import io
import json

import numpy as np
import pytest
from bench_peers import published_coordinates
from meshes import annulus, planar
from scipy.spatial import cKDTree

from LAFlatteningLib import LEFT_ATRIUM, LAFlatteningError, Surface, distortion, write_seeds, write_surface
from LAFlatteningLib.cli import main
from LAFlatteningLib.errors import Cancelled, SurfaceError, TemplateError
from LAFlatteningLib.flattening import flatten
from LAFlatteningLib.flattening.coarse import coarsened
from LAFlatteningLib.peers import table as table_module
from LAFlatteningLib.peers.conformal import conformal_disk, conformal_map
from LAFlatteningLib.peers.karim import round_square, square_map
from LAFlatteningLib.peers.ma import control_grid, distance_map, equal_area_disk, proportional, spline_weights
from LAFlatteningLib.peers.peer_map import ours, place_spread
from LAFlatteningLib.peers.registration import register
from LAFlatteningLib.peers.spots import lost_spots, spots_on
from LAFlatteningLib.peers.sum_map import SumTemplate, sum_map, sum_regions
from LAFlatteningLib.peers.table import compare_peers
from LAFlatteningLib.peers.universal import HOLES, Lines, unit_square, universal_map
from LAFlatteningLib.phantom import make_phantom
from LAFlatteningLib.seed_suggestion import suggest_seeds


def disk_mesh(rings: int = 9) -> Surface:
    """The unit disk, unevenly meshed, its rim on the circle at uneven steps."""
    rng = np.random.default_rng(3)
    inner = [np.zeros((1, 2))]
    for r in np.linspace(0, 1, rings)[1:-1]:
        angle = 2 * np.pi * (np.arange(int(6 * r * rings)) + rng.uniform(0, 0.4)) / int(6 * r * rings)
        inner.append(r * np.stack([np.cos(angle), np.sin(angle)], 1) + rng.uniform(-0.02, 0.02, (len(angle), 2)))
    angle = 2 * np.pi * (np.arange(60) + rng.uniform(-0.3, 0.3, 60)) / 60
    points = np.concatenate([*inner, np.stack([np.cos(angle), np.sin(angle)], 1)])
    return planar(points, lambda centre: np.ones(len(centre), bool))


@pytest.fixture(scope="module")
def table(phantom):
    return compare_peers(phantom.surface, phantom.seeds)


# ---- conformal -------------------------------------------------------------------------------------------------------


def test_conformal_map_of_a_disk_is_a_turn():
    """A flat disk about the origin is its own conformal map, up to a turn, wherever its rim starts."""
    disk = disk_mesh()
    rim = disk.boundary_loops[0]
    # Begin far from it: even steps by number, a third of a turn away.
    flat = conformal_disk(disk.laplacian, disk.mass, rim, np.arange(len(rim)) / len(rim) + 1 / 3)
    assert np.ptp(flat[:, 0]) > 1.9
    a, b = disk.points[:, 0] + 1j * disk.points[:, 1], flat[:, 0] + 1j * flat[:, 1]
    # The centre of mass of the polygon is not quite the origin: a Moebius transformation next to a turn is left.
    isotropy = distortion.isotropy(disk.points, disk.triangles, flat)
    assert isotropy.min() > 0.998
    turn = np.vdot(a, b) / np.vdot(a, a)
    assert abs(abs(turn) - 1.0) < 2e-3
    assert np.abs(b - turn * a).max() < 0.02
    # Turned to where it began, in the mean over the rim.
    start = np.exp(2j * np.pi * (np.arange(len(rim)) / len(rim) + 1 / 3))
    assert abs(np.angle((b[rim] * np.conj(start)).sum())) < 1e-3


def test_conformal_disk_of_a_cone_has_powers_of_the_radius():
    """A cone opened to a circle of unit slant whose angle round the tip is theta maps by r to r ** (2 pi / theta)."""
    theta = 2 * np.pi * 0.6
    flat = annulus(0.02, 1.0, 40, 64)
    radius, angle = np.hypot(*flat.points[:, :2].T), np.arctan2(flat.points[:, 1], flat.points[:, 0])
    # Round the tip a fan.
    share = theta / (2 * np.pi)
    cone = np.stack([radius * share * np.cos(angle), radius * share * np.sin(angle), radius * np.sqrt(1 - share**2)], 1)
    tip = len(cone)
    hole = min(flat.boundary_loops, key=flat.loop_length)
    fan = np.stack([np.roll(hole, -1), hole, np.full(len(hole), tip)], 1)
    surface = Surface(np.vstack([cone, np.zeros(3)]), np.concatenate([flat.triangles, fan]))
    rim = surface.boundary_loops[0]
    turns = np.unwrap(np.arctan2(*surface.points[rim, 1::-1].T)) / (2 * np.pi)
    found = np.hypot(*conformal_disk(surface.laplacian, surface.mass, rim, turns).T)[:tip]
    middle = radius > 0.2
    assert np.abs(found - radius ** (1 / share))[middle].max() < 0.01


def test_conformal_map_of_the_phantom_keeps_angles(phantom_map):
    found = conformal_map(phantom_map)
    assert not found.standardised and found.drift is None
    assert len(found.folded_triangles) == 0
    # The published way, harmonic with the rim at even steps, is far from it (square_map is like that).
    assert found.summary["beta"]["mean"] > 0.93 > square_map(phantom_map).summary["beta"]["mean"]
    outer = found.points[found.rims["MV"]]
    np.testing.assert_allclose(np.hypot(*outer.T), 0.5, atol=1e-12)
    # Our orientation: the right veins on the right, LSPV above LIPV.
    assert found.centre("RSPV")[0] > found.centre("LSPV")[0]
    assert found.centre("LSPV")[1] > found.centre("LIPV")[1]


# ---- square ----------------------------------------------------------------------------------------------------------


def test_square_has_the_rim_on_its_sides_at_even_speed(phantom_map):
    turns = np.linspace(0, 1, 81)
    walk = round_square(turns)
    np.testing.assert_allclose(np.abs(walk).max(axis=1), 0.5)
    np.testing.assert_allclose(np.abs(np.diff(walk, axis=0)).sum(axis=1), 4 / 80)
    found = square_map(phantom_map)
    np.testing.assert_allclose(np.abs(found.points[found.rims["MV"]]).max(axis=1), 0.5)
    assert len(found.folded_triangles) == 0
    # Harmonic: inner points of the cavity (away from covers) are the weighted means of their neighbours.
    inner = np.setdiff1d(np.arange(len(found.points)), np.concatenate(list(found.rims.values())))
    surface = phantom_map.cavity.surface
    residual = (surface.laplacian @ found.points)[inner]
    assert np.abs(residual).max() < 1e-10


# ---- proportional distances ------------------------------------------------------------------------------------------


def test_spline_control_grid_is_the_identity():
    places = np.random.default_rng(0).uniform(-1, 1, (40, 2))
    np.testing.assert_allclose(spline_weights(places) @ control_grid(), places, atol=1e-12)


def test_distances_in_the_plane_are_found_again():
    """Distances of a plane figure, bent beforehand, are reached by unbending it."""
    places = np.random.default_rng(1).uniform(-0.8, 0.8, (60, 2))
    wanted = np.linalg.norm(places[:, None] - places[None], axis=2) * 30.0
    weights = spline_weights(places)
    start = 20.0 * (control_grid() + 0.15 * np.sin(3.0 * control_grid()[:, ::-1]))
    found = weights @ proportional(weights, wanted, start)
    got = np.linalg.norm(found[:, None] - found[None], axis=2)
    off = ~np.eye(60, dtype=bool)
    assert np.abs(np.log(got[off] / wanted[off])).max() < 0.03
    before = weights @ start
    bent = np.linalg.norm(before[:, None] - before[None], axis=2)
    assert np.abs(np.log(bent[off] / wanted[off])).max() > 0.3


def test_equal_area_disk_holds_shares_of_the_mass():
    disk = disk_mesh()
    mass = np.exp(disk.points[:, 0]) * disk.mass
    flat = equal_area_disk(disk.points[:, :2] ** 3, mass)
    radius = np.hypot(*flat.T)
    for r in (0.3, 0.6, 0.9):
        assert mass[radius < r].sum() / mass.sum() == pytest.approx(r * r, abs=0.02)


def test_distance_map_of_the_phantom_is_truer_to_distances(phantom_map):
    found, conformal = distance_map(phantom_map), conformal_map(phantom_map)
    # Independent: straight distances of near points against those on the map, up to one factor.
    points = phantom_map.surface.points
    pairs = phantom_map.surface.edges.points[::7]
    length = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)

    def spread(flat):
        return np.log(np.linalg.norm(flat[pairs[:, 0]] - flat[pairs[:, 1]], axis=1) / length).std()

    assert spread(found.points) < 0.6 * spread(conformal.points)


# ---- universal coordinates -------------------------------------------------------------------------------------------


def envelope(nx: int = 13, ny: int = 9) -> tuple[Surface, np.ndarray, np.ndarray, Lines, np.ndarray]:
    """Two rectangles of 40 x 30 mm, one on the other, joined at both sides and at the top; open below.

    Returns the surface, its coordinates (x, y) seen from the back, which triangles are in front, lines and valve.
    """
    u, v = (k.reshape(-1) for k in np.meshgrid(np.linspace(0, 1, nx), np.linspace(0, 1, ny)))
    # A little depth, so that it is a surface in space; sheared rows keep linear functions harmonic.
    back = np.stack([40 * u, 0 * u, 30 * v], 1)
    index = np.arange(nx * ny).reshape(ny, nx)
    joined = (u == 0) | (u == 1) | (v == 1)
    front = np.where(joined, np.arange(nx * ny), -1)
    front[~joined] = nx * ny + np.arange((~joined).sum())
    points = np.concatenate([back, back[~joined] + (0, 1e-3, 0)])
    a, b, c, d = (k.reshape(-1) for k in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    sheet = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    surface = Surface(points, np.concatenate([sheet, front[sheet][:, ::-1]]))
    is_front = np.arange(len(surface.triangles)) >= len(sheet)
    lines = Lines(index[-1], index[::-1, -1], index[::-1, 0])
    expected = np.stack([u, 0.5 * v], 1)
    expected_front = np.stack([u, 1 - 0.5 * v], 1)[~joined]
    valve = np.concatenate([index[0], front[index[0]]])
    return surface, np.concatenate([expected, expected_front]), is_front, lines, np.unique(valve)


def test_universal_coordinates_of_an_envelope_are_its_sides():
    surface, expected, front, lines, valve = envelope()
    ends = np.array([lines.roof[0], lines.roof[-1]])
    cut, places, original = unit_square(surface, front, lines, valve, ends, np.array([[0.0, 0.5], [1.0, 0.5]]))
    n = len(surface.points)
    np.testing.assert_allclose(places[:n], expected, atol=1e-9)
    # The sides come twice, once with the heights of the front.
    copies = original[n:]
    np.testing.assert_allclose(places[n:, 0], expected[copies, 0], atol=1e-9)
    np.testing.assert_allclose(places[n:, 1], 1 - expected[copies, 1], atol=1e-9)
    assert cut.triangles.shape == surface.triangles.shape and len(copies) == 2 * 8


def test_universal_coordinates_of_the_phantom(phantom_map):
    found = universal_map(phantom_map)
    assert found.points.min() > -1e-9 and found.points.max() < 1 + 1e-9
    for hole in ("RIPV", "LIPV", "LAA"):
        np.testing.assert_allclose(HOLES[hole].distance(found.points[found.rims[hole]]), 0.0, atol=1e-9)
    # Roof at y = 0.5, valve at y = 0 or 1, the sides at x = 0 and 1 on every height.
    paths, loops = phantom_map.division.paths, phantom_map.division.loops
    for side in (0.0, 1.0):
        height = np.sort(found.points[np.abs(found.points[:, 0] - side) < 1e-12, 1])
        assert height[0] == 0.0 and height[-1] == 1.0 and np.diff(height).max() < 0.15
    np.testing.assert_allclose(found.points[paths["s4"], 1], 0.5)
    assert np.isin(found.points[loops["MV"], 1], (0.0, 1.0)).all()
    # Region 4 is in front, 5 and 2 behind.
    y = found.points[found.triangles].mean(axis=1)[:, 1]
    # (Cotangent weights may overshoot a little next to the corner of a hole.)
    assert (y[found.regions == 4] > 0.495).all() and (y[np.isin(found.regions, (2, 5))] < 0.505).all()
    assert found.drift < 0.01
    # The square is filled but for the holes (whose rims are polygons): nothing lies twice but where it folds.
    size = np.pi * (2 * 0.06**2 + 0.069 * 0.075 + 0.115 * 0.11)
    assert distortion.operators.signed_areas(found.points, found.triangles).sum() == pytest.approx(1 - size, abs=4e-3)


def test_universal_coordinates_refuse_touching_paths(phantom):
    with pytest.raises(SurfaceError, match="regional"):
        universal_map(flatten(phantom.surface, phantom.seeds, method="paper"))


# ---- SUM -------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def own_template(phantom, phantom_map):
    """The phantom and our map of it in the place of a SUM template."""
    flat = np.column_stack([phantom_map.points, np.zeros(len(phantom_map.points))])
    return SumTemplate.of(phantom_map.surface, Surface(flat, phantom_map.triangles))


def test_template_names_its_openings(own_template, phantom, phantom_map):
    for opening, rim in own_template.rims.items():
        assert set(rim) == set(ours(phantom_map).rims[opening])


def test_sum_of_the_template_itself_is_its_own_map(own_template, phantom_map):
    found = sum_map(phantom_map, own_template)
    away = np.linalg.norm(found.points - phantom_map.points, axis=1)
    assert np.median(away) < 0.005 and np.percentile(away, 95) < 0.02
    assert found.drift < 0.02


def test_registration_undoes_a_known_bend(phantom, phantom_map):
    """The phantom, turned, stretched and bent smoothly, is found again to a fraction of an edge."""
    points = phantom_map.surface.points
    centre = points.mean(axis=0)
    turn = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1.0]])

    def bend(at):
        moved = (at - centre) * (1.1, 0.95, 1.0)
        return moved @ turn + 2.0 * np.sin(moved[:, [1, 2, 0]] / 20.0) + (5, 60, -20)

    rims = ours(phantom_map).rims
    target = Surface(bend(points), phantom_map.triangles)
    seeds = {label: bend(at[None])[0] for label, at in phantom.seeds.items()}
    found = register(phantom_map.surface, phantom.seeds, rims, target, seeds, rims)
    away = np.linalg.norm(found - target.points, axis=1)
    edge = np.median(phantom_map.surface.edge_lengths)
    assert np.median(away) < 0.5 * edge


def test_sum_regions_need_the_layout_of_sum(own_template, phantom):
    with pytest.raises(TemplateError, match="layout"):
        sum_regions(np.zeros((1, 2)), own_template)
    like_sum = flatten(phantom.surface, phantom.seeds, "adapted2")
    flat = Surface(np.column_stack([2.0 * like_sum.points, 0.0 * like_sum.points[:, 0]]), like_sum.triangles)
    template = SumTemplate.of(like_sum.surface, flat)
    places = np.array([[0.0, 0.0], [0.9, 0.0], [0.0, 0.8]])
    labels = sum_regions(places, template)
    # Between the veins, the septum, the anterior wall.
    assert labels.tolist() == [5, 8, 1]


def test_wrong_template_files_are_refused(phantom_map):
    flat = np.column_stack([phantom_map.points, np.zeros(len(phantom_map.points))])
    disk = Surface(flat, phantom_map.triangles)
    other = make_phantom(1000).surface
    with pytest.raises(TemplateError, match="same mesh"):
        SumTemplate.of(other, disk)
    with pytest.raises(TemplateError, match="flat"):
        SumTemplate.of(disk, phantom_map.surface)
    shuffled = phantom_map.triangles[:, [1, 0, 2]].copy()
    shuffled[0] = (0, 1, 2) if set(shuffled[0]) != {0, 1, 2} else (0, 1, 3)
    with pytest.raises(TemplateError, match="join other points"):
        SumTemplate.of(phantom_map.surface, Surface(flat, shuffled))


def test_template_of_sum_registers_onto_itself(data_dir):
    """The real template: its holes get the names that SUM gives them, and its atrium finds its own disk."""
    folder = data_dir / "sum_atlas"
    template = SumTemplate.load(folder / "template_3d.vtp", folder / "template_disk.vtp")
    places = {
        "RSPV": (0.25, 0.10),
        "RIPV": (0.25, -0.15),
        "LSPV": (-0.30, 0.10),
        "LIPV": (-0.30, -0.15),
        "LAA": (-0.3, 0.3),
    }
    for hole, place in places.items():
        assert np.linalg.norm(template.disk[template.rims[hole]].mean(axis=0) - place) < 0.02
    flat_map = flatten(template.surface, template.seeds, check_axes=False)
    found = sum_map(flat_map, template)
    away = np.linalg.norm(found.points - template.disk[flat_map.surface.point_data["surface_point_id"]], axis=1)
    assert np.median(away) < 0.003 and np.percentile(away, 95) < 0.02
    # Inside the valve's rim its 24 regions are all there.
    labels = sum_regions(template.disk, template)
    assert set(np.unique(labels)) >= set(range(1, 25))


def test_universal_coordinates_against_published_ones(data_dir):
    """Real coordinates of a real atrium (here with fewer points), its seeds suggested: within a few per cent."""
    body, published, rims = published_coordinates()
    coarse = coarsened(Surface(body.points, body.triangles, space=body.space), 6000)
    flat_map = flatten(coarse, suggest_seeds(body, rims, LEFT_ATRIUM), check_axes=False)
    found = universal_map(flat_map)
    nearest = cKDTree(body.points).query(flat_map.surface.points)[1]
    away = np.linalg.norm(found.on_cavity - published[nearest], axis=1)
    assert np.median(away) < 0.08


# ---- spots and table -------------------------------------------------------------------------------------------------


def test_spots_are_lost_where_pixels_are_too_large(phantom_map):
    found, spot = ours(phantom_map), spots_on(phantom_map.cavity.surface, 100)
    assert lost_spots(found, spot, 400) == 0
    lost = [lost_spots(found, spot, pixels) for pixels in (40, 10, 3)]
    assert lost == sorted(lost) and lost[0] < 60 and lost[-1] >= 100 - 9


def test_table_of_the_phantom(table):
    rows = {row.name: row for row in table.rows}
    assert [name for name, row in rows.items() if row.standardised] == ["regional", "paper", "universal"]
    assert rows["regional"].folded_triangles == 0
    assert rows["regional"].drift_percent < 0.2
    assert all(row.seconds > 0 for row in table.rows)
    read = list(csv.DictReader(io.StringIO(table.to_csv())))
    assert [row["name"] for row in read] == list(rows)
    assert int(read[5]["folded_triangles"]) == len(table.maps[5].folded_triangles)
    assert table.to_markdown().count("\n") == 2 + len(rows)
    assert any("SUM" in note for note in table.notes)


def test_free_maps_put_the_veins_elsewhere_in_another_atrium(table, phantom):
    """Stretched along an axis, an atrium keeps its places on our map only."""
    stretched = Surface(phantom.surface.points * (1.3, 1.0, 0.85), phantom.surface.triangles)
    seeds = {label: at * (1.3, 1.0, 0.85) for label, at in phantom.seeds.items()}
    other = compare_peers(stretched, seeds)
    spread = {
        a.name: place_spread([a, b], table.flat_map.template.anatomy.holes)
        for a, b in zip(table.maps, other.maps, strict=True)
    }
    assert spread["regional"] < 1e-3 and spread["paper"] < 1e-3 and spread["universal"] < 2e-3
    assert min(spread["conformal"], spread["square"], spread["distances"]) > 5 * spread["regional"]


def test_work_can_be_stopped(phantom):
    seen = []

    def stop(share, text):
        seen.append(share)
        return share < 0.5

    with pytest.raises(Cancelled):
        compare_peers(phantom.surface, phantom.seeds, progress=stop)
    assert seen == sorted(seen)


def test_command_writes_table_figure_and_maps(phantom, phantom_map, tmp_path, capsys):
    pytest.importorskip("matplotlib")
    write_surface(phantom.surface, tmp_path / "atrium.vtp")
    write_seeds(phantom.seeds, tmp_path / "seeds.csv")
    flat = np.column_stack([phantom_map.points, np.zeros(len(phantom_map.points))])
    write_surface(phantom_map.surface, tmp_path / "t3d.vtp")
    write_surface(Surface(flat, phantom_map.triangles), tmp_path / "disk.vtp")
    arguments = ["peers", str(tmp_path / "atrium.vtp"), "--seeds", str(tmp_path / "seeds.csv"), "--quiet"]
    arguments += ["--output", str(tmp_path / "out")]
    assert main([*arguments, "--sum-template", str(tmp_path / "t3d.vtp")]) == 2
    assert "both files" in capsys.readouterr().err
    arguments += ["--sum-template", str(tmp_path / "t3d.vtp"), "--sum-disk", str(tmp_path / "disk.vtp")]
    assert main(arguments) == 0
    assert "| SUM" in capsys.readouterr().out
    written = json.loads((tmp_path / "out" / "peers.json").read_text(encoding="utf-8"))
    assert [row["name"] for row in written["maps"]][-1] == "sum"
    assert all(row["source"] for row in written["maps"])
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"peers.json", "peers.csv", "peers.png", "universal.vtp", "sum.vtp", "regional.vtp"} <= names


def test_a_map_that_cannot_be_made_is_left_out_with_its_reason(phantom, monkeypatch):
    def refuse(*_, **__):
        raise SurfaceError("no way for the lateral line")

    monkeypatch.setattr(table_module, "universal_map", refuse)
    found = compare_peers(phantom.surface, phantom.seeds)
    assert [row.name for row in found.rows] == ["regional", "paper", "conformal", "square", "distances"]
    assert "No map universal: no way for the lateral line" in found.notes


@pytest.mark.parametrize("points", [500, 1000])
def test_coarse_phantoms_are_on_every_map(points):
    small = make_phantom(points)
    assert len(compare_peers(small.surface, small.seeds).rows) == 6


def test_errors_are_ours(phantom):
    with pytest.raises(LAFlatteningError):
        compare_peers(phantom.surface, {k: v for k, v in phantom.seeds.items() if k != "LAA"})
