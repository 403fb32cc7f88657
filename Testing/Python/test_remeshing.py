"""Uniform remeshing: the shape, its openings and handles and its data are kept, at the size asked for."""

import meshes
import numpy as np
import pytest

from LAFlatteningLib.carrying import closest_points
from LAFlatteningLib.errors import Cancelled, SurfaceError
from LAFlatteningLib.files import read_surface
from LAFlatteningLib.phantom import make_phantom
from LAFlatteningLib.remeshing import remesh
from LAFlatteningLib.surface import Surface


def slab(size: float = 40.0, gap: float = 1.0, n: int = 41) -> Surface:
    """A flat closed box: two walls much closer to each other than they are wide."""
    top = meshes.grid(n, n, size, size)
    rim = top.boundary_loops[0]
    m = len(top.points)
    points = np.concatenate([top.points + np.array([0, 0, gap]), top.points])
    sides = [[rim, np.roll(rim, -1) + m, np.roll(rim, -1)], [rim, rim + m, np.roll(rim, -1) + m]]
    triangles = [top.triangles, top.triangles[:, ::-1] + m, *(np.stack(side, axis=1) for side in sides)]
    return Surface(points, np.concatenate(triangles))


def check_same_kind(before: Surface, after: Surface) -> None:
    assert after.is_manifold
    assert after.is_oriented
    assert after.component_count == 1
    assert after.used_points.all()
    assert after.genus == before.genus
    assert len(after.boundary_loops) == len(before.boundary_loops)
    assert np.sign(after.enclosed_volume) == np.sign(before.enclosed_volume)


CASES = {
    "sphere": (lambda: meshes.icosphere(40.0, 4), 900),
    "torus": (lambda: meshes.torus(n=48), 1500),
    "torus, finer": (lambda: meshes.torus(n=24), 2000),
    "tube": (lambda: meshes.cylinder(10.0, 40.0, 80, 60), 1200),
    "phantom, coarser": (lambda: make_phantom(4000).surface, 1200),
    "phantom, finer": (lambda: make_phantom(1500).surface, 5000),
    "phantom, about as fine": (lambda: make_phantom(2000).surface, 2000),
    "phantom, very coarse": (lambda: make_phantom(4000).surface, 250),
    "closed phantom": (lambda: make_phantom(3000, closed=True).surface, 1500),
    "slab, edges longer than it is thick": (slab, 800),
    "slab, finer": (lambda: slab(n=21), 3000),
}


@pytest.fixture(scope="module", params=CASES, ids=list(CASES))
def case(request):
    make, points = CASES[request.param]
    surface = make()
    return surface, points, remesh(surface, points=points)


def test_kind_number_and_orientation_are_kept(case):
    surface, points, remeshed = case
    check_same_kind(surface, remeshed.surface)
    assert len(remeshed.surface.points) == points


def test_points_lie_on_the_old_surface(case):
    surface, _, remeshed = case
    # Chords of the rims apart, points are on it: rim points on the old rim, others projected.
    distance = closest_points(surface, remeshed.surface.points).distance_mm
    assert distance.max() < 1e-6 * np.ptp(surface.points)


def test_triangles_are_even(case):
    _, _, remeshed = case
    assert remeshed.quality["smallest_angle_degrees"] > 10.0
    assert remeshed.quality["p1_angle_degrees"] > 30.0
    assert remeshed.quality["edge_spread"] < 0.2


def test_area_and_distance_are_those_of_a_fine_enough_mesh(case):
    surface, _, remeshed = case
    edge = remeshed.quality["edge_mean_mm"]
    assert remeshed.surface.area == pytest.approx(surface.area, rel=0.06)
    assert remeshed.distance_mm["p95"] < 0.25 * edge
    # At a corner of a slab thinner than an edge there is room for one point only.
    assert remeshed.distance_mm["max"] < 0.8 * edge


def test_a_sphere_is_inscribed_as_finely_as_its_edges_allow():
    radius = 40.0
    remeshed = remesh(meshes.icosphere(radius, 5), points=1000)
    edge = remeshed.quality["edge_mean_mm"]
    # A triangle of edge l dips under the sphere by l^2 / (6 R).
    centres = remeshed.surface.points[remeshed.surface.triangles].mean(axis=1)
    dip = radius - np.linalg.norm(centres, axis=1)
    assert dip.mean() == pytest.approx(edge**2 / (6 * radius), rel=0.15)


def test_rims_keep_their_shape_and_get_even_points():
    surface = make_phantom(6000).surface
    remeshed = remesh(surface, points=1500).surface
    edge = remeshed.edge_lengths.mean()
    before = [surface.points[loop] for loop in surface.boundary_loops]
    for loop in remeshed.boundary_loops:
        rim = remeshed.points[loop]
        near = min(before, key=lambda line: np.linalg.norm(line.mean(axis=0) - rim.mean(axis=0)))
        dense = near[:, None] + np.linspace(0, 1, 20)[None, :, None] * (np.roll(near, -1, axis=0) - near)[:, None]
        gap = np.linalg.norm(rim[:, None] - dense.reshape(1, -1, 3), axis=2)
        assert gap.min(axis=1).max() < 0.05 * edge
        steps = np.linalg.norm(np.roll(rim, -1, axis=0) - rim, axis=1)
        assert steps.std() < 0.15 * steps.mean()
        assert 0.6 * edge < steps.mean() < 1.4 * edge
        length = np.linalg.norm(np.roll(near, -1, axis=0) - near, axis=1).sum()
        assert steps.sum() == pytest.approx(length, rel=0.02)


def test_corners_of_a_rim_are_kept():
    sheet = meshes.grid(41, 31, 40.0, 30.0)
    remeshed = remesh(sheet, points=400).surface
    assert remeshed.area == pytest.approx(sheet.area)
    corners = [[0, 0, 0], [40, 0, 0], [0, 30, 0], [40, 30, 0]]
    assert closest_points(remeshed, np.array(corners, float)).distance_mm.max() < 1e-9


def test_creases_are_kept():
    cube = slab(20.0, 20.0, 2)
    remeshed = remesh(cube, points=1000).surface
    assert remeshed.enclosed_volume == pytest.approx(20.0**3, rel=0.005)
    assert remeshed.area == pytest.approx(6 * 20.0**2, rel=0.01)


def test_close_walls_are_not_welded():
    surface = slab(gap=0.5)
    remeshed = remesh(surface, points=600).surface
    assert remeshed.edge_lengths.mean() > 2.0 * 0.5
    check_same_kind(surface, remeshed)
    assert remeshed.enclosed_volume == pytest.approx(40 * 40 * 0.5, rel=0.15)
    wide = np.ptp(remeshed.points[remeshed.triangles][..., 2], axis=1) > 0.25
    inward = 20 - np.abs(remeshed.points[remeshed.triangles].mean(axis=1)[:, :2] - 20).max(axis=1)
    middle = inward > 2.5 * remeshed.edge_lengths.mean()
    # No triangle leads from wall to wall but at the sides, where one point stands for both creases.
    assert not (wide & middle).any()


def test_edge_length_chooses_the_number_of_points():
    remeshed = remesh(make_phantom(3000).surface, edge_length_mm=2.0)
    assert remeshed.quality["edge_mean_mm"] == pytest.approx(2.0, rel=0.03)


def test_data_travel_there_and_back():
    surface = meshes.jittered(40, 30, seed=1)
    x, y, _ = surface.points.T
    left = surface.points[surface.triangles].mean(axis=1)[:, 0] < 20
    surface = surface.with_data(
        {"value": 2 * x - y, "label": (x > 20).astype(np.uint8), "text": np.array(["t"] * len(x), dtype=object)},
        {"side": left.astype(np.int32)},
        {"source": np.array(["test"], dtype=object)},
    )
    remeshed = remesh(surface, points=900)
    made = remeshed.surface
    np.testing.assert_allclose(made.point_data["value"], 2 * made.points[:, 0] - made.points[:, 1], atol=1e-9)
    assert made.point_data["label"].dtype == np.uint8
    at = made.points[made.triangles].mean(axis=1)[:, 0]
    assert (made.cell_data["side"][at < 18] == 1).all()
    assert (made.cell_data["side"][at > 22] == 0).all()
    assert made.field_data["source"].tolist() == ["test"]
    assert any('"text"' in note for note in remeshed.notes)
    back = remeshed.to_source(made.point_data["value"])
    np.testing.assert_allclose(back, 2 * x - y, atol=1e-9)
    assert set(np.unique(remeshed.to_source(made.point_data["label"]))) == {0, 1}


def test_missing_values_stay_missing():
    surface = meshes.icosphere(40.0, 4)
    z = surface.points[:, 2]
    remeshed = remesh(surface.with_data({"value": np.where(z > 0, z, np.nan)}), points=1000).surface
    value, height = remeshed.point_data["value"], remeshed.points[:, 2]
    assert np.isnan(value[height < -5]).all()
    np.testing.assert_allclose(value[height > 5], height[height > 5], atol=1e-9)


def test_space_is_kept_and_the_result_is_repeatable():
    surface = make_phantom(1500).surface
    turned = Surface(surface.points * [-1, -1, 1], surface.triangles, space="RAS")
    once, twice = remesh(turned, points=800).surface, remesh(turned, points=800).surface
    assert once.space == "RAS"
    np.testing.assert_array_equal(once.points, twice.points)
    np.testing.assert_array_equal(once.triangles, twice.triangles)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"points": 99}, "100 to 2,?000,?000 points, found 99"),
        ({"points": 2_000_001}, "found 2000001"),
        ({"points": 1000, "edge_length_mm": 1.0}, "found both"),
        ({"edge_length_mm": 0.0}, "above 0 mm"),
        ({"edge_length_mm": float("nan")}, "above 0 mm"),
        ({"edge_length_mm": 1e-9}, "found .* points, which an edge length of"),
        ({"edge_length_mm": 500.0}, "found .* points, which an edge length of"),
    ],
)
def test_sizes_out_of_range_are_refused(arguments, message):
    with pytest.raises(SurfaceError, match=message):
        remesh(meshes.icosphere(40.0, 2), **arguments)


def test_surfaces_of_another_kind_are_refused():
    with pytest.raises(SurfaceError, match="not a clean sheet at 1 point"):
        remesh(meshes.tetrahedra_sharing_a_point(), points=200)
    one = meshes.icosphere(20.0, 2)
    two = Surface(
        np.concatenate([one.points, one.points + 100]), np.concatenate([one.triangles, one.triangles + len(one.points)])
    )
    with pytest.raises(SurfaceError, match="2 separate pieces"):
        remesh(two, points=200)


def test_points_that_no_triangle_uses_are_left_out_and_still_get_values_back():
    ball = meshes.icosphere(20.0, 3)
    points = np.concatenate([ball.points, [[0.0, 0.0, 25.0]]])
    remeshed = remesh(Surface(points, ball.triangles, {"z": points[:, 2]}), points=400)
    assert remeshed.surface.used_points.all()
    back = remeshed.to_source(remeshed.surface.point_data["z"])
    assert len(back) == len(points)
    # The stray point gets the value of the place nearest to it, on the inscribed mesh.
    assert back[-1] == pytest.approx(20.0, abs=0.3)
    with pytest.raises(SurfaceError, match="Expected a value for each of the 400 points"):
        remeshed.to_source(np.zeros(7))


def test_cancelling_stops_the_work():
    with pytest.raises(Cancelled):
        remesh(meshes.icosphere(40.0, 3), points=500, progress=lambda share, text: share < 0.3)


def test_progress_only_grows():
    shares = []
    remesh(make_phantom(3000).surface, points=1000, progress=lambda share, text: shares.append(share))
    assert shares == sorted(shares)
    assert shares[0] >= 0
    assert shares[-1] <= 1


@pytest.mark.parametrize("name", ["frf_demo/surface.vtk", "pvi_gap/surface.vtp", "frf_demo/cavity.vtp"])
def test_real_atria(data_dir, name):
    path = data_dir / name
    if not path.exists():
        pytest.skip(f"{path} is absent")
    surface = read_surface(path)
    remeshed = remesh(surface, points=6000)
    check_same_kind(surface, remeshed.surface)
    assert len(remeshed.surface.points) == 6000
    assert remeshed.quality["smallest_angle_degrees"] > 5.0
    assert remeshed.distance_mm["p95"] < 0.2
    assert set(remeshed.surface.point_data) == set(surface.point_data)
