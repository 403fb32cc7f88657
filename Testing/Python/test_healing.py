"""Small defects mended."""

from __future__ import annotations

import numpy as np
import pytest
from meshes import cylinder, icosphere

from LAFlatteningLib.cavity.healing import heal_surface
from LAFlatteningLib.errors import SurfaceError
from LAFlatteningLib.files import read_surface
from LAFlatteningLib.surface import Surface

SPHERE = icosphere(20.0)


def test_clean_surfaces_come_back_as_they_are(phantom):
    for surface in (SPHERE, cylinder(10.0, 20.0), phantom.surface):
        same, notes = heal_surface(surface)
        assert same is surface and notes == ()


def test_a_heap_of_triangles_is_joined():
    heap = Surface(SPHERE.points[SPHERE.triangles].reshape(-1, 3), np.arange(3 * len(SPHERE.triangles)).reshape(-1, 3))
    healed, notes = heal_surface(heap)
    assert healed.is_manifold and healed.genus == 0 and not healed.boundary_loops
    assert "merged" in notes[0]


def test_fins_doubles_and_extra_pieces_are_removed():
    a, b = SPHERE.triangles[0, :2]
    n = len(SPHERE.points)
    points = np.concatenate([SPHERE.points, [1.1 * SPHERE.points[a]], 30 + np.eye(3)])
    extra = [[a, b, n], [n + 1, n + 2, n + 3], SPHERE.triangles[5], [a, a, b]]
    surface = Surface(
        points, np.concatenate([SPHERE.triangles, extra]), cell_data={"id": np.arange(len(SPHERE.triangles) + 4)}
    )
    healed, notes = heal_surface(surface)
    assert len(notes) == 3 and all("mm LPS" in note for note in notes)
    np.testing.assert_array_equal(healed.cell_data["id"], np.arange(len(SPHERE.triangles)))
    np.testing.assert_array_equal(healed.points, SPHERE.points)


def test_sheets_that_touch_in_a_point_are_parted():
    other = SPHERE.points * 0.01
    other = other - other[0] + SPHERE.points[0]
    n = len(SPHERE.points)
    joined = np.where(SPHERE.triangles == 0, 0, SPHERE.triangles + n)
    surface = Surface(np.concatenate([SPHERE.points, other]), np.concatenate([SPHERE.triangles, joined]))
    healed, notes = heal_surface(surface)
    assert healed.is_manifold and healed.component_count == 1 and len(healed.triangles) == len(SPHERE.triangles)
    assert notes


def test_pinholes_are_closed_and_openings_left():
    fine = icosphere(10.0, 4)
    pierced, _ = fine.submesh(~(fine.triangles == 100).any(axis=1))
    assert pierced.loop_length(pierced.boundary_loops[0]) < 6.0
    healed, notes = heal_surface(pierced)
    assert not healed.boundary_loops and "pinhole" in notes[0] and "hole" not in healed.point_data
    opened, _ = SPHERE.submesh(~(SPHERE.triangles == 100).any(axis=1))
    assert heal_surface(opened)[0] is opened


def test_a_spike_is_flattened():
    points = SPHERE.points.copy()
    points[100] *= 1.5
    healed, notes = heal_surface(Surface(points, SPHERE.triangles))
    assert "spike" in notes[0]
    assert np.linalg.norm(healed.points, axis=1).max() < 20.001


def test_a_second_large_piece_is_refused():
    n = len(SPHERE.points)
    with pytest.raises(SurfaceError, match="second piece"):
        heal_surface(
            Surface(
                np.concatenate([SPHERE.points, SPHERE.points + 50]),
                np.concatenate([SPHERE.triangles, SPHERE.triangles + n]),
            )
        )


def test_the_electroanatomical_map(data_dir):
    raw = read_surface(data_dir / "eam" / "openep_mesh_2_dense.vtk")
    healed, notes = heal_surface(raw)
    assert not raw.is_manifold and raw.component_count == 2
    assert healed.is_manifold and healed.component_count == 1 and len(notes) >= 2
    assert set(healed.point_data) == set(raw.point_data)
