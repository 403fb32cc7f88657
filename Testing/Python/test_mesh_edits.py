"""Splitting, collapsing, flipping and contracting: whatever is asked for, the surface stays what it is."""

import meshes
import numpy as np
import pytest

from LAFlatteningLib import mesh_edits, operators
from LAFlatteningLib.clusters import contract_clusters
from LAFlatteningLib.phantom import make_phantom
from LAFlatteningLib.remeshing import work_mesh
from LAFlatteningLib.surface import Surface

SURFACES = {
    "sphere": lambda: meshes.icosphere(30.0, 3),
    "torus": lambda: meshes.torus(n=20),
    "tube": lambda: meshes.cylinder(8.0, 20.0, 30, 12),
    "flat": lambda: meshes.jittered(20, 15, seed=4),
    "phantom": lambda: make_phantom(1500).surface,
}


@pytest.fixture(params=SURFACES, ids=list(SURFACES))
def surface(request):
    return SURFACES[request.param]()


def check(before: Surface, mesh: mesh_edits.WorkMesh) -> Surface:
    after = Surface(mesh.points, mesh.triangles)
    assert after.is_manifold
    assert after.is_oriented
    assert after.used_points.all()
    assert (after.genus, len(after.boundary_loops), after.component_count) == (
        before.genus,
        len(before.boundary_loops),
        1,
    )
    rim = np.zeros(len(after.points), bool)
    if after.boundary_loops:
        rim[np.concatenate(after.boundary_loops)] = True
    np.testing.assert_array_equal(mesh.rim >= 0, rim)
    for loop in after.boundary_loops:
        assert len(np.unique(mesh.rim[loop])) == 1
    return after


@pytest.mark.parametrize("share", [0.02, 0.4, 1.0])
def test_splitting_keeps_shape_and_adds_a_point_an_edge(surface, share):
    mesh = work_mesh(surface)
    chosen = np.random.default_rng(0).random(len(mesh.edges.points)) < share
    mesh_edits.split_edges(mesh, chosen)
    after = check(surface, mesh)
    assert len(after.points) == len(surface.points) + chosen.sum()
    assert after.area == pytest.approx(surface.area)
    np.testing.assert_array_equal(after.points[: len(surface.points)], surface.points)


def test_collapsing_any_edges_keeps_the_surface_what_it_is(surface):
    mesh = work_mesh(surface)
    rng = np.random.default_rng(1)
    for _ in range(30):
        before = len(mesh.points)
        removed = mesh_edits.collapse_edges(mesh, rng.random(len(mesh.edges.points)) < 0.5)
        assert len(mesh.points) == before - removed
        check(surface, mesh)
    assert len(mesh.points) < 0.5 * len(surface.points)
    # What is left are points of the old surface.
    assert {tuple(p) for p in mesh.points} <= {tuple(p) for p in surface.points}


def test_no_more_points_are_removed_than_asked(surface):
    mesh = work_mesh(surface)
    assert mesh_edits.collapse_edges(mesh, np.ones(len(mesh.edges.points), bool), most=7) == 7
    assert len(mesh.points) == len(surface.points) - 7


def test_no_longer_edge_is_made_than_allowed():
    mesh = work_mesh(meshes.jittered(20, 15, seed=4))
    longest = mesh.edge_lengths().max() * 1.01
    for _ in range(5):
        mesh_edits.collapse_edges(mesh, np.ones(len(mesh.edges.points), bool), longest)
        assert mesh.edge_lengths().max() <= longest


def test_flipping_leads_to_a_delaunay_triangulation():
    flat = meshes.grid(12, 9, 11.0, 8.0)
    shaken = flat.points.copy()
    inner = np.setdiff1d(np.arange(len(shaken)), flat.boundary_loops[0])
    shaken[inner, :2] += np.random.default_rng(3).uniform(-0.3, 0.3, (len(inner), 2))
    surface = Surface(shaken, flat.triangles)
    mesh = work_mesh(surface)
    while mesh_edits.flip_edges(mesh):
        after = check(surface, mesh)
    assert after.area == pytest.approx(surface.area)
    # No point inside the circle through the corners of a triangle; but at the corners of the sheet, where ears are cut.
    at_corner = np.isin(after.points[:, 0], (0, 11)) & np.isin(after.points[:, 1], (0, 8))
    whole = after.triangles[~at_corner[after.triangles].any(axis=1)]
    assert len(whole) >= len(after.triangles) - 8
    a, b, c = (after.points[whole[:, k], :2] for k in range(3))
    d = 2 * np.linalg.det(np.stack([b - a, c - a], axis=1))
    u, v = ((b - a) ** 2).sum(axis=1), ((c - a) ** 2).sum(axis=1)
    centre = (
        a + np.stack([(c - a)[:, 1] * u - (b - a)[:, 1] * v, (b - a)[:, 0] * v - (c - a)[:, 0] * u], 1) / d[:, None]
    )
    radius = np.linalg.norm(a - centre, axis=1)
    gap = np.linalg.norm(after.points[None, :, :2] - centre[:, None], axis=2).min(axis=1)
    assert (gap > radius - 1e-9).all()


def test_flipping_raises_the_smallest_angles(surface):
    mesh = work_mesh(surface)
    before = np.sort(operators.cotangents(mesh.points, mesh.triangles).max(axis=1))[-20:].mean()
    for _ in range(10):
        mesh_edits.flip_edges(mesh)
        check(surface, mesh)
    assert np.sort(operators.cotangents(mesh.points, mesh.triangles).max(axis=1))[-20:].mean() <= before + 1e-9


@pytest.mark.parametrize("factor", [1.2, 3.0, 100.0], ids=["short", "medium", "any"])
def test_contracting_clusters_keeps_the_surface_what_it_is(surface, factor):
    mesh = work_mesh(surface)
    before = len(mesh.points)
    removed = contract_clusters(mesh, factor * surface.edge_lengths.mean())
    assert len(mesh.points) == before - removed
    assert removed > 0.3 * before
    after = check(surface, mesh)
    for _ in range(3):
        contract_clusters(mesh, 100 * surface.edge_lengths.mean())
        after = check(surface, mesh)
    assert {tuple(p) for p in after.points} <= {tuple(p) for p in surface.points}
