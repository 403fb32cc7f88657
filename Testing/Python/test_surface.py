"""Topology, operators and conversions of a surface, against closed forms and another library."""

import gc

import meshes
import numpy as np
import potpourri3d
import pytest
import vtk
from vtk.util.numpy_support import vtk_to_numpy

from LAFlatteningLib import operators, topology
from LAFlatteningLib.errors import SurfaceError
from LAFlatteningLib.surface import Surface

# ---- topology ----


@pytest.mark.parametrize(
    ("surface", "genus", "loops"),
    [(meshes.icosphere(), 0, 0), (meshes.torus(), 1, 0), (meshes.cylinder(), 0, 2), (meshes.grid(), 0, 1)],
    ids=["sphere", "torus", "cylinder", "grid"],
)
def test_genus_and_loops_of_known_surfaces(surface, genus, loops):
    assert surface.is_manifold
    assert surface.is_oriented
    assert surface.component_count == 1
    assert surface.genus == genus
    assert len(surface.boundary_loops) == loops


def test_loop_runs_with_the_surface_on_its_left():
    surface = meshes.annulus(1.0, 2.0, 4, 24)
    outer, inner = sorted(surface.boundary_loops, key=surface.loop_length, reverse=True)
    for loop, turn in ((outer, 1), (inner, -1)):
        x, y = surface.points[loop, :2].T
        assert np.sign(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) == turn
        steps = surface.points[np.roll(loop, -1)] - surface.points[loop]
        assert np.linalg.norm(steps, axis=1).max() < 0.6


def test_loop_length_is_the_perimeter():
    surface = meshes.cylinder(radius=3.0, around=200)
    for loop in surface.boundary_loops:
        # A regular polygon of 200 sides in a circle of radius 3.
        assert surface.loop_length(loop) == pytest.approx(2 * 200 * 3 * np.sin(np.pi / 200))


def test_edges_know_their_triangles():
    surface = meshes.grid(4, 4)
    edges = surface.edges
    for edge, pair, usage in zip(edges.points, edges.triangles, edges.usage, strict=True):
        having = [t for t, corners in enumerate(surface.triangles) if set(edge) <= set(corners)]
        assert sorted(pair[pair >= 0]) == having
        assert usage == len(having)
    for t, corners in enumerate(surface.triangles):
        for k in range(3):
            assert set(edges.points[edges.of_triangle[t, k]]) == set(corners) - {corners[k]}


@pytest.mark.parametrize("far", [0, 3_000_000_000])
@pytest.mark.parametrize("count", [1, 12, 40, 150])
def test_edges_of_any_triangles(far, count):
    # Edges with many triangles among them; and ids so large that they sort the other way.
    rng = np.random.default_rng(count)
    ids = np.where(np.arange(9) < 4, np.arange(9), np.arange(9) + far)
    triangles = np.array([rng.choice(ids, 3, replace=False) for _ in range(count)])
    edges = topology.edges(triangles)
    uses = {}
    for k in range(3):
        for t, corners in enumerate(triangles.tolist()):
            uses.setdefault(tuple(sorted((corners[(k + 1) % 3], corners[(k + 2) % 3]))), []).append((t, k))
    assert [tuple(ends) for ends in edges.points.tolist()] == sorted(uses)
    for e, ends in enumerate(sorted(uses)):
        assert edges.usage[e] == len(uses[ends])
        assert edges.triangles[e].tolist() == ([t for t, _ in uses[ends]] + [-1])[:2]
        assert all(edges.of_triangle[t, k] == e for t, k in uses[ends])


def test_non_manifold_points_are_found():
    assert meshes.tetrahedra_sharing_a_point().non_manifold_points.tolist() == [0]
    three_on_an_edge = Surface(
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1.0]]),
        np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]]),
    )
    assert {0, 1} <= set(three_on_an_edge.non_manifold_points.tolist())


def test_orientation_is_repaired():
    sphere = meshes.icosphere(subdivisions=2)
    mixed = sphere.triangles.copy()
    turned = np.random.default_rng(1).random(len(mixed)) < 0.4
    turned[0] = False
    mixed[turned] = mixed[turned][:, ::-1]
    assert not topology.is_oriented(mixed, topology.edges(mixed))
    repaired = topology.orient(mixed, topology.edges(mixed))
    assert topology.is_oriented(repaired, topology.edges(repaired))
    assert operators.signed_volume(sphere.points, repaired) == pytest.approx(
        operators.signed_volume(sphere.points, sphere.triangles)
    )


def test_one_sided_surface_is_refused():
    n = 12
    angle = 2 * np.pi * np.arange(n) / n
    strip = []
    for side in (-1, 1):
        r = 10 + side * np.cos(angle / 2)
        strip.append(np.column_stack([r * np.cos(angle), r * np.sin(angle), side * np.sin(angle / 2)]))
    triangles = []
    for k in range(n):
        a, b = k, n + k
        c, d = ((k + 1), n + (k + 1)) if k < n - 1 else (n, 0)
        triangles += [(a, c, b), (b, c, d)]
    triangles = np.array(triangles)
    with pytest.raises(SurfaceError, match="one-sided"):
        topology.orient(triangles, topology.edges(triangles))


def test_components_are_numbered_by_size():
    small, large = meshes.icosphere(1, 1), meshes.icosphere(1, 2)
    both = Surface(
        np.concatenate([small.points, large.points + 5]),
        np.concatenate([small.triangles, large.triangles + len(small.points)]),
    )
    assert both.component_count == 2
    assert np.bincount(both.components).tolist() == [len(large.triangles), len(small.triangles)]


def test_touching_rims_are_refused():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0.0]])
    with pytest.raises(SurfaceError, match="touch at point 0"):
        _ = Surface(points, np.array([[0, 1, 2], [0, 3, 4]])).boundary_loops


def test_a_rim_that_does_not_come_back_is_refused():
    """Two triangles lie on one place, and a third on one of their edges, so that this has three."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]])
    with pytest.raises(SurfaceError, match="begins or ends at point 0"):
        _ = Surface(points, np.array([[0, 3, 1], [3, 1, 0], [2, 1, 0]])).boundary_loops


# ---- operators ----


def test_laplacian_equals_that_of_potpourri3d():
    surface = meshes.icosphere(2.0, 2)
    rng = np.random.default_rng(0)
    bumpy = Surface(surface.points * (1 + 0.2 * rng.random((len(surface.points), 1))), surface.triangles)
    ours = bumpy.laplacian.toarray()
    theirs = potpourri3d.cotan_laplacian(bumpy.points, bumpy.triangles, denom_eps=0.0).toarray()
    assert np.abs(ours - theirs).max() < 1e-10


def test_linear_functions_are_harmonic_on_the_plane():
    rng = np.random.default_rng(2)
    xy = rng.random((200, 2))
    surface = meshes.planar(xy, lambda centre: np.ones(len(centre), bool))
    inner = np.setdiff1d(np.arange(len(xy)), np.concatenate(surface.boundary_loops))
    assert np.abs((surface.laplacian @ surface.points)[inner]).max() < 1e-9


@pytest.mark.parametrize("degree", [1, 2])
def test_sphere_harmonics_have_eigenvalue_l_l_plus_1(degree):
    sphere = meshes.icosphere(3.0, 5)
    x, y, z = sphere.points.T
    harmonic = z if degree == 1 else x * y
    rayleigh = (harmonic @ sphere.laplacian @ harmonic) / (harmonic @ (sphere.mass * harmonic))
    assert rayleigh == pytest.approx(degree * (degree + 1) / 3.0**2, rel=2e-3)


def test_dirichlet_energy_on_the_cylinder():
    # f = cos(angle): |grad f|^2 integrates to pi height / radius.
    tube = meshes.cylinder(radius=2.0, height=3.0, around=240, up=60)
    f = tube.points[:, 0] / 2.0
    assert f @ tube.laplacian @ f == pytest.approx(np.pi * 3.0 / 2.0, rel=1e-3)


def test_laplacian_survives_degenerate_triangles():
    points = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 1, 0.0], [1, 1, 0.0]])
    triangles = np.array([[0, 1, 3], [1, 2, 3], [0, 1, 2], [1, 3, 4]])
    laplacian = operators.cotangent_laplacian(points, triangles)
    assert np.isfinite(laplacian.data).all()
    assert np.abs(laplacian.sum(axis=1)).max() < 1e-3 * np.abs(laplacian.data).max()


def test_areas_volume_mass_and_normals_of_a_sphere():
    sphere = meshes.icosphere(10.0, 5)
    assert sphere.area == pytest.approx(4 * np.pi * 100, rel=1e-3)
    assert operators.signed_volume(sphere.points, sphere.triangles) == pytest.approx(4 / 3 * np.pi * 1000, rel=2e-3)
    assert operators.signed_volume(sphere.points, sphere.triangles[:, ::-1]) < 0
    assert sphere.mass.sum() == pytest.approx(sphere.area)
    assert np.abs(sphere.point_normals - sphere.points / 10.0).max() < 1e-2


def test_volume_of_an_open_surface_counts_its_openings_as_capped():
    sphere = meshes.icosphere(10.0, 5)
    dome, _ = sphere.submesh((sphere.points[sphere.triangles][:, :, 2] > -1e-9).all(axis=1))
    assert dome.enclosed_volume == pytest.approx(2 / 3 * np.pi * 1000, rel=2e-2)
    # A prism of 100 sides.
    tube = meshes.cylinder(2.0, 3.0, around=100)
    assert tube.enclosed_volume == pytest.approx(3.0 * 0.5 * 100 * 4.0 * np.sin(2 * np.pi / 100))
    assert tube.with_triangles(tube.triangles[:, ::-1]).enclosed_volume == pytest.approx(-tube.enclosed_volume)


def test_jacobian_of_a_known_linear_map():
    surface = meshes.grid(3, 3)
    matrix = np.array([[2.0, 1.0], [0.0, 0.5]])
    flat = surface.points[:, :2] @ matrix.T
    large, small = operators.singular_values(operators.jacobians(surface.points, surface.triangles, flat))
    expected = np.linalg.svd(matrix, compute_uv=False)
    assert np.allclose(large, expected[0])
    assert np.allclose(small, expected[1])
    _, mirrored = operators.singular_values(operators.jacobians(surface.points, surface.triangles, flat * [-1, 1]))
    assert (mirrored < 0).all()


# ---- arrays, checks and VTK ----


@pytest.mark.parametrize(
    ("points", "triangles", "message"),
    [
        (np.zeros((3, 2)), [[0, 1, 2]], r"\(n, 3\)"),
        (np.eye(3), np.zeros((0, 3), int), "no triangles"),
        (np.eye(3), [[0, 1, 3]], "numbered 0 to 2"),
        (np.array([[0, 0, 0], [1, np.nan, 0], [0, 1, 0]]), [[0, 1, 2]], "not a number"),
    ],
)
def test_bad_arrays_are_refused(points, triangles, message):
    with pytest.raises(SurfaceError, match=message):
        Surface(points, np.array(triangles))


def test_array_of_wrong_length_is_refused():
    with pytest.raises(SurfaceError, match='"LGE" has 2 entries, expected 3'):
        Surface(np.eye(3), np.array([[0, 1, 2]]), {"LGE": np.zeros(2)})


def test_arrays_are_read_only_but_the_callers_are_not():
    points = np.eye(3)
    surface = Surface(points, np.array([[0, 1, 2]]))
    with pytest.raises(ValueError, match="read-only"):
        surface.points[0, 0] = 5.0
    points[0, 0] = 5.0


def test_polydata_round_trip_keeps_every_array():
    grid = meshes.grid()
    surface = grid.with_data(
        {"scalar": np.arange(len(grid.points), dtype=np.float32), "vector": np.random.default_rng(0).random((30, 3))},
        {"label": np.arange(len(grid.triangles), dtype=np.int16)},
        {"name": np.array(["Müller"], dtype=object), "numbers": np.array([1.5, 2.5])},
    )
    back = Surface.from_polydata(surface.to_polydata())
    assert np.array_equal(back.points, surface.points)
    assert np.array_equal(back.triangles, surface.triangles)
    for ours, theirs in (
        (surface.point_data, back.point_data),
        (surface.cell_data, back.cell_data),
        (surface.field_data, back.field_data),
    ):
        assert list(ours) == list(theirs)
        for name in ours:
            assert np.array_equal(ours[name], theirs[name])
            assert ours[name].dtype == theirs[name].dtype


def test_polydata_outlives_the_surface_it_came_from():
    polydata = meshes.grid(50, 50).with_data({"x": np.arange(2500.0)}).to_polydata()
    gc.collect()
    filler = [np.full(2500, -1.0) for _ in range(50)]
    assert vtk_to_numpy(polydata.GetPointData().GetArray("x")).tolist() == list(range(2500))
    assert polydata.GetPoint(2499) == (1.0, 1.0, 0.0)
    assert len(filler) == 50


def test_from_polydata_reads_vtks_own_sources():
    source = vtk.vtkSphereSource()
    source.SetRadius(5.0)
    source.SetThetaResolution(40)
    source.SetPhiResolution(40)
    source.Update()
    surface = Surface.from_polydata(source.GetOutput())
    assert surface.area == pytest.approx(4 * np.pi * 25, rel=2e-2)
    assert surface.genus == 0
    assert "Normals" in surface.point_data


def test_quads_and_empty_polydata_are_refused():
    plane = vtk.vtkPlaneSource()
    plane.Update()
    with pytest.raises(SurfaceError, match="not triangles"):
        Surface.from_polydata(plane.GetOutput())
    with pytest.raises(SurfaceError, match="no triangles"):
        Surface.from_polydata(vtk.vtkPolyData())


def test_submesh_carries_data_and_ids():
    surface = meshes.grid(4, 4).with_data({"p": np.arange(16)}, {"c": np.arange(18)})
    keep = np.zeros(18, bool)
    keep[[2, 5, 7]] = True
    part, ids = surface.submesh(keep)
    assert part.cell_data["c"].tolist() == [2, 5, 7]
    assert part.point_data["p"].tolist() == ids.tolist()
    assert np.array_equal(part.points[part.triangles], surface.points[surface.triangles[keep]])
