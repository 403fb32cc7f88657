"""Healing: faults put into clean meshes one by one, and those of real files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from meshes import icosphere
from numpy.typing import NDArray

from LAFlatteningLib.cavity.healing import PINHOLE_MM, heal
from LAFlatteningLib.cavity.openings import check_surface
from LAFlatteningLib.errors import Cancelled, SurfaceError
from LAFlatteningLib.files import read_surface
from LAFlatteningLib.surface import Surface


def sphere(radius: float = 20.0, subdivisions: int = 3) -> Surface:
    """With the arrays `z` (point) and `id` (cell)."""
    surface = icosphere(radius, subdivisions)
    return surface.with_data({"z": surface.points[:, 2]}, {"id": np.arange(len(surface.triangles))})


def with_more(surface: Surface, points: NDArray, triangles: NDArray, drop: NDArray | None = None) -> Surface:
    """With points and triangles added at the end, some triangles dropped."""
    keep = np.ones(len(surface.triangles), bool)
    if drop is not None:
        keep[drop] = False
    points, triangles = np.reshape(points, (-1, 3)), np.reshape(triangles, (-1, 3)).astype(int)
    return Surface(
        np.concatenate([surface.points, points]),
        np.concatenate([surface.triangles[keep], triangles]),
        {"z": np.concatenate([surface.point_data["z"], points[:, 2]])},
        {"id": np.concatenate([surface.cell_data["id"][keep], np.full(len(triangles), -1)])},
    )


def check_healed(surface: Surface, genus: int = 0) -> None:
    assert surface.is_manifold and surface.is_oriented and surface.component_count == 1
    assert surface.genus == genus and surface.used_points.all() and surface.edge_lengths.min() > 1e-3
    again, notes = heal(surface)
    assert again is surface and notes == ()


def test_clean_surfaces_come_back_as_they_are(phantom):
    for surface in (sphere(), phantom.surface):
        result, notes = heal(surface)
        assert result is surface and notes == ()


def test_separate_triangles_are_joined(phantom):
    whole = phantom.surface
    corners = whole.triangles.reshape(-1)
    soup = Surface(
        whole.points[corners],
        np.arange(len(corners)).reshape(-1, 3),
        {name: values[corners] for name, values in whole.point_data.items()},
        whole.cell_data,
    )
    result, (note,) = heal(soup)
    assert note.startswith(f"Points within 0.001 mm of another were merged with it: {len(corners) - len(whole.points)}")
    assert len(result.points) == len(whole.points) and len(result.boundary_loops) == 6
    assert (result.points[result.triangles] == whole.points[whole.triangles]).all()
    for name, values in whole.point_data.items():
        assert np.array_equal(result.point_data[name][result.triangles], values[whole.triangles], equal_nan=True)
    assert result.cell_data.keys() == whole.cell_data.keys()


def test_duplicate_triangles_are_dropped_either_way_round():
    clean = sphere()
    twice = with_more(clean, [], np.stack([clean.triangles[5], clean.triangles[9][::-1]]))
    result, (note,) = heal(twice)
    check_healed(result)
    assert "Duplicate triangles were dropped: 2, at (" in note
    assert (result.triangles == clean.triangles).all()
    assert (result.cell_data["id"] == clean.cell_data["id"]).all()


def test_a_double_membrane_inside_is_dropped():
    # Two pyramids base to base, and both sides of the base.
    points = 5.0 * np.array([[1, 0, 0], [-0.5, 0.9, 0], [-0.5, -0.9, 0], [0, 0, 1.5], [0, 0, -1.5]])
    sides = [(0, 1, 3), (1, 2, 3), (2, 0, 3), (1, 0, 4), (2, 1, 4), (0, 2, 4)]
    result, _ = heal(Surface(points, np.array([*sides, (0, 1, 2), (2, 1, 0)])))
    assert sorted(map(tuple, result.triangles.tolist())) == sorted(sides)


def test_debris_is_dropped_and_a_second_atrium_refused():
    clean = sphere()
    for radius, refused in ((3.0, False), (15.0, True)):
        other = icosphere(radius, 2)
        both = with_more(clean, other.points + np.array([60.0, 0, 0]), other.triangles + len(clean.points))
        if refused:
            with pytest.raises(SurfaceError, match=r"2 separate pieces; the second, at \(60\.0, -?0\.0, -?0\.0\) mm"):
                heal(both)
        else:
            result, (note,) = heal(both)
            check_healed(result)
            assert note == "Small separate pieces were dropped: 1, at (60.0, 0.0, 0.0) mm." or "(60.0, -0.0" in note
            assert np.array_equal(result.points, clean.points)


def test_a_wall_across_the_chamber_is_refused_with_its_place():
    clean = sphere()
    upper, ids = clean.submesh((clean.points[clean.triangles, 2] > 0).any(axis=1))
    (rim,) = upper.boundary_loops
    ring = ids[rim]
    fan = np.column_stack([ring, np.roll(ring, -1), np.full(len(ring), len(clean.points))])
    with pytest.raises(SurfaceError, match="3 separate pieces"):
        heal(with_more(clean, [0.0, 0.0, 0.0], fan))


def test_a_triangle_that_hangs_on_an_edge_is_dropped():
    clean = sphere()
    a, b = clean.edges.points[100]
    result, (note,) = heal(with_more(clean, 1.1 * clean.points[a], [a, b, len(clean.points)]))
    check_healed(result)
    # It hangs by one edge, so that it is a piece of its own.
    assert "pieces were dropped: 1" in note
    assert (result.triangles == clean.triangles).all()


def test_a_triangle_that_hangs_on_a_rim_and_an_edge_is_dropped():
    opened, _ = sphere().submesh((sphere().triangles[:, :, None] != [3, 100]).all(axis=(1, 2)))
    rim = opened.boundary_loops[0]
    a, b = rim[:2]
    (third,) = (t for t in opened.triangles.tolist() if a in t and b in t)
    near = opened.edges.points[(opened.edges.points == a).any(axis=1) & (opened.edges.usage == 2)]
    d = int(np.setdiff1d(near, [a, *third])[0])
    broken = with_more(opened, [], [b, a, d])
    assert broken.component_count == 1 and not broken.is_manifold
    result, notes = heal(broken)
    assert any("hung on an edge of two others were dropped: 1, at (" in note for note in notes)
    assert result.is_manifold and np.array_equal(result.triangles[: len(opened.triangles)], opened.triangles)


@pytest.mark.parametrize("wrong", [(0, 5, 90), (5, 90, 91)])
def test_triangles_are_turned_alike(wrong):
    clean = sphere()
    triangles = clean.triangles.copy()
    triangles[list(wrong)] = triangles[list(wrong), ::-1]
    result, (note,) = heal(clean.with_triangles(triangles))
    check_healed(result)
    assert note.startswith("Triangles were turned as their neighbours are: 3, at (")
    assert result.enclosed_volume == pytest.approx(clean.enclosed_volume)


@pytest.mark.parametrize("count", [1, 2])
def test_sheets_that_touch_in_a_point_or_an_edge_are_taken_apart(count):
    """A sphere pressed in from above and below, until its two sides meet."""
    clean = sphere()
    points = clean.points.copy()
    above = points[:, 2] > 0
    middle = np.linalg.norm(points[:, :2], axis=1) < 12.0
    points[middle, 2] *= 0.3
    top = np.flatnonzero(middle & above)
    edge = clean.edges.points[np.isin(clean.edges.points, top).all(axis=1)]
    pair = edge[np.linalg.norm(points[edge].mean(axis=1)[:, :2], axis=1).argmin()][:count]
    opposite = [int(np.linalg.norm(points - points[p] * [1, 1, -1], axis=1).argmin()) for p in pair]
    assert not set(opposite) & set(pair.tolist())
    points[pair, 2] = 0.0
    points[opposite] = points[pair]
    result, notes = heal(replace(clean, points=points))
    check_healed(result)
    assert len(result.points) == len(points) and len(result.triangles) == len(clean.triangles)
    assert f"merged with it: {count}," in notes[0] and f"sheets touched were divided: {count}," in notes[1]
    # Nothing else has moved, and the divided points hardly.
    old = Surface(points, clean.triangles)
    assert result.area == pytest.approx(old.area, rel=1e-3)
    assert result.enclosed_volume == pytest.approx(old.enclosed_volume, rel=1e-3)


def test_veins_that_touch_along_an_edge_are_taken_apart():
    """A horseshoe, of which one edge of one leg meets one of the other: the room between is outside."""
    around, along = 12, 40
    turn = np.linspace(0.03 * np.pi, 1.97 * np.pi, along)
    angle = 2 * np.pi * np.arange(around) / around
    radius = 12.0 + 3.0 * np.cos(angle)
    rings = np.stack(
        [radius * np.cos(turn[:, None]), radius * np.sin(turn[:, None]), 3.0 * np.sin(angle) + 0 * turn[:, None]], 2
    )
    points = np.concatenate([rings.reshape(-1, 3), rings[0].mean(axis=0)[None], rings[-1].mean(axis=0)[None]])
    i, j = np.meshgrid(np.arange(around), np.arange(along - 1))
    a, b = (i + around * j).ravel(), ((i + 1) % around + around * j).ravel()
    triangles = [np.stack([a, a + around, b], 1), np.stack([b, a + around, b + around], 1)]
    ring = np.arange(around)
    first, last = len(points) - 2, len(points) - 1
    triangles.append(np.stack([ring, np.roll(ring, -1), np.full(around, first)], 1))
    end = ring + around * (along - 1)
    triangles.append(np.stack([np.roll(end, -1), end, np.full(around, last)], 1))
    shape = Surface(points, np.concatenate(triangles))
    if shape.enclosed_volume < 0:
        shape = shape.with_triangles(shape.triangles[:, ::-1])
    assert shape.genus == 0 and shape.is_oriented
    # The edges (k, k + 1) of both end rings come together.
    touching = shape.points.copy()
    for k in (0, 1):
        middle = (touching[k] + touching[end[k]]) / 2
        touching[k] = touching[end[k]] = middle
    touching_shape = replace(shape, points=touching)
    result, _ = heal(touching_shape)
    check_healed(result)
    assert len(result.points) == len(points)
    assert result.enclosed_volume == pytest.approx(touching_shape.enclosed_volume, rel=1e-2)


def test_the_end_of_a_needle_is_joined():
    clean = sphere()
    edge = 50
    a, b = clean.edges.points[edge]
    one, two = clean.edges.triangles[edge]
    c = int(np.setdiff1d(clean.triangles[one], (a, b))[0])
    d = int(np.setdiff1d(clean.triangles[two], (a, b))[0])
    new = len(clean.points)
    split = [np.where(clean.triangles[t] == end, new, clean.triangles[t]) for t in (one, two) for end in (a, b)]
    near = clean.points[a] + 0.003 * (clean.points[b] - clean.points[a])
    result, (note,) = heal(with_more(clean, near, split, drop=np.array([one, two])))
    assert c != d
    check_healed(result)
    assert note.startswith("Ends of needles were joined: 1, at (")
    assert len(result.points) == len(clean.points) and len(result.triangles) == len(clean.triangles)
    assert result.area == pytest.approx(clean.area, rel=1e-3)


def test_a_flat_triangle_is_turned():
    clean = sphere()
    edge = 50
    a, b = clean.edges.points[edge]
    one = clean.edges.triangles[edge, 0]
    k = int(np.flatnonzero(~np.isin(clean.triangles[one], (a, b)))[0])
    c, a, b = np.roll(clean.triangles[one], -k)
    new = len(clean.points)
    middle = (clean.points[a] + clean.points[b]) / 2
    broken = with_more(clean, middle, [(c, a, new), (c, new, b), (new, a, b)], drop=np.array([one]))
    assert broken.is_manifold and broken.triangle_areas.min() < 1e-9
    result, (note,) = heal(broken)
    check_healed(result)
    assert note.startswith("Flat triangles were turned: 1, at (")
    assert result.triangle_areas.min() > 0.1
    assert result.enclosed_volume == pytest.approx(clean.enclosed_volume, rel=1e-9)


def test_the_tip_of_a_spike_is_moved_back():
    clean = sphere()
    points = clean.points.copy()
    points[7] *= 1.8
    result, (note,) = heal(replace(clean, points=points))
    check_healed(result)
    place = ", ".join(f"{x:.1f}" for x in points[7])
    assert note == f"Tips of spikes were moved back: 1, at ({place}) mm."
    assert np.linalg.norm(result.points[7] - clean.points[7]) < 0.6
    assert np.array_equal(np.delete(result.points, 7, 0), np.delete(clean.points, 7, 0))


def test_pinholes_are_closed_and_openings_are_not():
    clean = sphere(16.0)
    star, wide = 3, 200
    near = np.linalg.norm(clean.points - clean.points[wide], axis=1) < 6.0
    gone = (clean.triangles == star).any(axis=1) | near[clean.triangles].any(axis=1)
    broken, _ = clean.submesh(~gone)
    lengths = [broken.loop_length(rim) for rim in broken.boundary_loops]
    assert len(lengths) == 2 and lengths[0] > PINHOLE_MM > lengths[1]
    result, (note,) = heal(broken)
    check_healed(result)
    assert note.startswith("Pinholes (rims up to 12.5 mm long) were closed: 1, at (")
    (rim,) = result.boundary_loops
    assert result.loop_length(rim) == pytest.approx(lengths[0], rel=1e-12)
    # The cover is wall: nothing marks it as that of an opening, and a linear array stays nearly so.
    assert set(result.point_data) == {"z"} and set(result.cell_data) == {"id"}
    assert result.point_data["z"] == pytest.approx(result.points[:, 2], abs=0.3)


def test_several_faults_at_once_and_marks_of_covers_stay():
    clean = sphere(16.0)
    marks = (clean.points[:, 2] > 12.0).astype(np.uint8)
    points = clean.points.copy()
    points[7] *= 1.8
    broken, _ = replace(clean, points=points).with_data({"hole": marks}).submesh((clean.triangles != 3).all(axis=1))
    result, notes = heal(broken)
    check_healed(result)
    assert len(notes) == 2
    assert result.point_data["hole"].sum() == broken.point_data["hole"].sum()


def test_progress_is_told_and_can_stop():
    shares = []
    heal(sphere(), lambda share, text: shares.append(share))
    assert shares == sorted(shares) and shares[-1] == 1.0
    with pytest.raises(Cancelled):
        heal(sphere(), lambda share, text: share < 0.1)


@pytest.mark.parametrize(
    ("name", "rims", "expected"),
    [
        ("eam/openep_mesh_2_dense.vtk", 7, ["pieces were dropped: 1", "divided: 1, at (0.5, -115.3, 137.0)"]),
        ("lasc_b002/standardised.vtp", 5, ["closed: 1, at (205.2, 177.1, 159.4)"]),
        ("frf_demo/clipped_veins_mitral.vtp", 6, ["merged with it: 4", "closed: 1, at (232.0, 204.8, 75.6)"]),
        ("frf_demo/surface.vtk", 0, []),
        ("labelled/dtmri_endo1.vtp", 5, ["turned as their neighbours"]),
    ],
)
def test_faults_of_real_files(data_dir: Path, name: str, rims: int, expected: list[str]):
    file = data_dir / name
    if not file.is_file():
        pytest.skip(f"{name} not found")
    surface = read_surface(file)
    result, notes = heal(surface)
    check_healed(result)
    assert all(any(text in note for note in notes) for text in expected)
    assert (result is surface) == (not expected)
    assert len(result.boundary_loops) == rims
    assert abs(result.area / surface.area - 1) < 0.01
    assert set(result.point_data) == set(surface.point_data) and set(result.cell_data) == set(surface.cell_data)
    check_surface(result)
