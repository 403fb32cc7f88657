"""Handles: tori of known widths, bridges and tunnels put into the phantom, and a real atrium with two bridges."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk
from meshes import grid, icosphere
from scipy import sparse
from scipy.ndimage import gaussian_filter
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkFiltersCore import vtkFlyingEdges3D

from LAFlatteningLib.cavity.handles import Handle, remove_handles, winding_number
from LAFlatteningLib.cavity.healing import heal
from LAFlatteningLib.cavity.short_loops import shortest_across, shortest_loop
from LAFlatteningLib.errors import Cancelled, SurfaceError
from LAFlatteningLib.phantom import left_atrium_shape
from LAFlatteningLib.surface import FloatArray, IntArray, Surface

# ---- shapes -----------------------------------------------------------------------------------------------------


def torus_triangles(around: int, along: int) -> IntArray:
    """Of an `around` x `along` lattice closed in both directions; point (i, j) is i + around * j."""
    flat = grid(around + 1, along + 1)
    i, j = np.arange(len(flat.points)) % (around + 1), np.arange(len(flat.points)) // (around + 1)
    return (i % around + around * (j % along))[flat.triangles]


def torus(ring: float, tube: float, around: int = 40, along: int = 80) -> Surface:
    """About the z axis, outward oriented; `around` points round the tube, `along` points along the ring.

    The array ``x`` holds the first coordinate, ``id`` the number of each point and triangle.
    """
    angle = 2 * np.pi * np.arange(around) / around
    turn = 2 * np.pi * np.arange(along)[:, None] / along
    radius = ring + tube * np.cos(angle)
    points = np.stack([radius * np.cos(turn), radius * np.sin(turn), tube * np.sin(angle) + 0 * turn], axis=2)
    points = points.reshape(-1, 3)
    triangles = torus_triangles(around, along)[:, ::-1]
    surface = Surface(
        points,
        triangles,
        {"x": points[:, 0].astype(np.float32), "id": np.arange(len(points))},
        {"id": np.arange(len(triangles))},
    )
    assert surface.genus == 1 and surface.is_oriented and surface.enclosed_volume > 0
    return surface


def surface_of(values: FloatArray, spacing: FloatArray, origin: FloatArray, level: float) -> Surface:
    """Largest piece of the level set of an image [k, j, i]."""
    image = vtkImageData()
    image.SetDimensions(values.shape[::-1])
    image.SetSpacing(spacing.tolist())
    image.SetOrigin(origin.tolist())
    scalars = numpy_to_vtk(values.reshape(-1).astype(np.float32), deep=True)
    image.GetPointData().SetScalars(scalars)
    edges = vtkFlyingEdges3D()
    edges.SetInputData(image)
    edges.SetValue(0, level)
    edges.ComputeNormalsOff()
    edges.Update()
    surface = Surface.from_polydata(edges.GetOutput())
    return surface.submesh(surface.components == 0)[0]


def rod(points: FloatArray, start: FloatArray, stop: FloatArray, radius: float) -> FloatArray:
    """Signed distance of points to a rod with round ends."""
    axis = stop - start
    share = np.clip((points - start) @ axis / (axis @ axis), 0.0, 1.0)
    return np.linalg.norm(points - start - share[:, None] * axis, axis=1) - radius


Rod = tuple[FloatArray, FloatArray, float]
SHAPE = left_atrium_shape(vein_length=12.0, appendage_length=12.0)


def atrium(bridges: Sequence[Rod] = (), tunnels: Sequence[Rod] = ()) -> Surface:
    """The closed phantom on a grid of 0.8 mm, with rods added to its lumen or taken away."""
    return solid(SHAPE.signed_distance, *SHAPE.extent(np.eye(3)), bridges, tunnels)


def solid(
    distance_of: Callable[[FloatArray], FloatArray],
    low: FloatArray,
    high: FloatArray,
    bridges: Sequence[Rod],
    tunnels: Sequence[Rod] = (),
) -> Surface:
    """What has a negative distance within a box, on a grid of 0.8 mm, with rods added or taken away."""
    axes = [np.arange(a - 3.1, b + 3.0, 0.8) for a, b in zip(low, high, strict=True)]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    places = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    distance = distance_of(places)
    for start, stop, radius in bridges:
        distance = np.minimum(distance, rod(places, start, stop, radius))
    for start, stop, radius in tunnels:
        distance = np.maximum(distance, -rod(places, start, stop, radius))
    origin = np.array([axis[0] for axis in axes])
    surface = surface_of(-distance.reshape(x.shape), np.full(3, 0.8), origin, 0.0)
    if surface.enclosed_volume < 0:
        surface = surface.with_triangles(surface.triangles[:, ::-1])
    return surface


def along_vein(name: str, share: float) -> FloatArray:
    """A place on a vein's axis between rim (0) and tip (1)."""
    return (1 - share) * SHAPE.seeds[name] + share * SHAPE.tips[name]


def between_right_veins(share: float) -> tuple[FloatArray, FloatArray]:
    return along_vein("RSPV", share), along_vein("RIPV", share)


def free_middle(start: FloatArray, stop: FloatArray) -> FloatArray:
    """Middle of the part of a line that is outside the phantom."""
    line = start + np.linspace(0, 1, 400)[:, None] * (stop - start)
    outside = line[SHAPE.signed_distance(line) > 0]
    assert len(outside) > 3
    return outside.mean(axis=0)


def check_result(before: Surface, after: Surface, handles: tuple[Handle, ...]) -> None:
    """A clean surface without handles that is the old one beyond the cuts."""
    assert after.genus == 0 and after.component_count == 1 and after.is_manifold and after.is_oriented
    assert len(after.boundary_loops) == len(before.boundary_loops)
    assert before.triangle_areas.min() > 0 and after.triangle_areas.min() > 0
    # Points are those of the old surface, but for a strip and covers at each cut.
    moved = cKDTree(before.points).query(after.points)[0] > 0
    lost = cKDTree(after.points).query(before.points)[0] > 0
    for handle in handles:
        size = np.linalg.norm(handle.loop_mm - handle.place_mm, axis=1).max() + before.edge_lengths.max()
        near = np.linalg.norm(after.points - handle.place_mm, axis=1) < size
        moved &= ~near
    assert not moved.any()
    lines = np.concatenate([handle.loop_mm for handle in handles])
    assert (cKDTree(lines).query(before.points[lost])[0] == 0).all(), "only points of the lines are gone"


# ---- shortest lines ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
def test_the_shortest_loop_is_that_of_the_unrolled_torus(seed):
    around, along = 9, 11
    surface = torus(10.0, 3.5 + seed, around, along)
    noise = np.random.default_rng(seed).normal(0, 0.4, surface.points.shape)
    surface = Surface(surface.points + noise, surface.triangles)
    # Independent: paths from each point to its images on a plane of 5 x 5 copies, where every loop that is not
    # closed up to a copy of itself is a line between different copies.
    copies = grid(5 * around + 1, 5 * along + 1)
    width = 5 * around + 1
    i, j = np.arange(len(copies.points)) % width, np.arange(len(copies.points)) // width
    image = i % around + around * (j % along)
    a, b = copies.edges.points.T
    length = np.linalg.norm(surface.points[image[a]] - surface.points[image[b]], axis=1)
    graph = sparse.coo_matrix((length, (a, b)), shape=2 * (len(image),)).tocsr()
    middle = np.flatnonzero((i // around == 2) & (j // along == 2))
    distance = dijkstra(graph + graph.T, indices=middle)
    distance[image[None] != image[middle][:, None]] = np.inf
    distance[np.arange(len(middle)), middle] = np.inf
    assert surface.loop_length(shortest_loop(surface)) == pytest.approx(distance.min(), rel=1e-12)


def test_the_loop_across_goes_the_other_way_round():
    surface = torus(12.0, 4.0)
    loop = shortest_loop(surface)
    assert surface.loop_length(loop) == pytest.approx(2 * np.pi * 4, rel=0.01)
    across = shortest_across(surface, loop, 100.0)
    assert across is not None and surface.loop_length(across) == pytest.approx(2 * np.pi * 8, rel=0.01)
    assert len(np.intersect1d(loop, across)) > 0
    assert shortest_across(surface, loop, 40.0) is None


# ---- closed forms -----------------------------------------------------------------------------------------------


def test_a_thin_torus_is_cut_through():
    surface = torus(15.0, 3.0)
    result, (handle,) = remove_handles(surface)
    check_result(surface, result, (handle,))
    assert handle.kind == "bridge"
    assert handle.width_mm == pytest.approx(6.0, rel=0.02)
    # The centre of the cut lies on the centre line of the tube.
    assert np.hypot(*handle.place_mm[:2]) == pytest.approx(15.0, abs=0.3)
    assert handle.place_mm[2] == pytest.approx(0.0, abs=0.3)
    # The strip taken away is about an edge wide; two discs are added.
    edge = np.linalg.norm(handle.loop_mm[0] - handle.loop_mm[1])
    assert 0 < surface.enclosed_volume - result.enclosed_volume < 2.5 * np.pi * 9 * edge
    assert result.area - surface.area == pytest.approx(2 * np.pi * 9, abs=2 * np.pi * 6 * edge)


def test_a_tunnel_much_narrower_than_the_lumen_is_filled():
    surface = torus(15.0, 12.0, 100, 100)
    result, (handle,) = remove_handles(surface)
    check_result(surface, result, (handle,))
    assert handle.kind == "tunnel"
    assert handle.width_mm == pytest.approx(6.0, rel=0.02)
    assert np.abs(handle.place_mm).max() < 0.5
    assert 0 < result.enclosed_volume - surface.enclosed_volume < 60.0


def test_a_bridge_is_cut_rather_than_a_tunnel_a_little_narrower_filled():
    surface = torus(15.0, 9.0, 60, 60)
    result, (handle,) = remove_handles(surface, widest_mm=20.0)
    check_result(surface, result, (handle,))
    assert handle.kind == "bridge"
    assert handle.width_mm == pytest.approx(18.0, rel=0.02)
    # But not if the bridge is as wide as a vein.
    _, (handle,) = remove_handles(surface, widest_mm=15.0)
    assert handle.kind == "tunnel"
    assert handle.width_mm == pytest.approx(12.0, rel=0.02)


def test_arrays_travel_along():
    surface = torus(15.0, 3.0)
    result, _ = remove_handles(surface)
    old = np.flatnonzero(cKDTree(surface.points).query(result.points)[0] == 0)
    same = cKDTree(surface.points).query(result.points[old])[1]
    assert (result.point_data["id"][old] == same).all()
    # A linear function stays linear at the cut; on flat covers it does so too.
    assert result.point_data["x"].dtype == np.float32
    assert result.point_data["x"] == pytest.approx(result.points[:, 0], abs=0.15)
    centres = surface.points[surface.triangles].mean(axis=1)
    own = np.isin(result.triangles, old).all(axis=1)
    assert np.allclose(centres[result.cell_data["id"][own]], result.points[result.triangles[own]].mean(axis=1))
    assert set(result.point_data) == set(surface.point_data)


def test_rims_are_left_alone_and_marks_of_covers_stay():
    surface = torus(15.0, 3.0)
    # An opening on the outside of the ring, and another part that is marked as the cover of one.
    outermost = int(np.linalg.norm(surface.points[:, :2], axis=1).argmax())
    opened, _ = surface.submesh((surface.triangles != outermost).all(axis=1))
    marks = (np.linalg.norm(opened.points - [-18.0, 0, 0], axis=1) < 1.5).astype(np.uint8)
    assert marks.any()
    opened = opened.with_data({"hole": marks})
    result, (handle,) = remove_handles(opened)
    check_result(opened, result, (handle,))
    (rim,), (rim_after,) = opened.boundary_loops, result.boundary_loops
    assert {tuple(p) for p in opened.points[rim]} == {tuple(p) for p in result.points[rim_after]}
    assert handle.width_mm == pytest.approx(6.0, rel=0.02)
    assert {tuple(p) for p in result.points[result.point_data["hole"] == 1]} <= {
        tuple(p) for p in opened.points[marks == 1]
    }


def test_triangles_turned_at_random_are_made_consistent_first():
    surface = torus(15.0, 3.0)
    triangles = surface.triangles.copy()
    flip = np.random.default_rng(0).random(len(triangles)) < 0.3
    flip[0] = False
    triangles[flip] = triangles[flip][:, ::-1]
    result, (handle,) = remove_handles(surface.with_triangles(triangles))
    assert result.is_oriented and result.genus == 0 and handle.kind == "bridge"


def test_winding_number_is_that_of_a_sphere_open_or_closed():
    sphere = icosphere(10.0, 2)
    places = np.array([[0.0, 0, 0], [5, 5, 0], [11, 0, 0], [0, -30, 0]])
    assert winding_number(sphere, places) == pytest.approx([1, 1, 0, 0], abs=1e-9)
    opened, _ = sphere.submesh((sphere.triangles != 0).all(axis=1))
    assert winding_number(opened, places) == pytest.approx([1, 1, 0, 0], abs=1e-9)


# ---- what is refused --------------------------------------------------------------------------------------------


def test_a_surface_without_handles_comes_back_as_it_is():
    sphere = icosphere()
    result, handles = remove_handles(sphere)
    assert result is sphere and handles == ()


def test_a_handle_as_wide_as_a_vein_is_refused_with_its_place_and_width():
    with pytest.raises(SurfaceError, match=r"handle .* at \(.*\) mm that is 9\.\d mm wide .* up to 8\.0 mm"):
        remove_handles(torus(15.0, 4.7))


def test_what_is_no_single_clean_sheet_is_refused():
    a = torus(15.0, 3.0)
    b = icosphere(2.0)
    both = Surface(np.concatenate([a.points, b.points]), np.concatenate([a.triangles, b.triangles + len(a.points)]))
    with pytest.raises(SurfaceError, match="found 2"):
        remove_handles(both)
    with pytest.raises(SurfaceError, match="none at 3 points"):
        remove_handles(a.with_triangles(np.concatenate([a.triangles[:-1], a.triangles[:1]])))


def test_a_handle_that_only_lines_along_rims_go_round_is_refused():
    # Of a torus, only two crossing strips one square wide.
    surface = torus(10.0, 3.0, 8, 6)
    square = np.arange(len(surface.triangles)) % 48
    opened, _ = surface.submesh((square % 8 == 0) | (square // 8 == 0))
    assert opened.is_manifold and opened.genus == 1 and len(opened.boundary_loops) == 1
    with pytest.raises(SurfaceError, match="without touching a rim"):
        remove_handles(opened)


def test_progress_is_told_and_can_stop():
    shares = []
    remove_handles(torus(15.0, 3.0), progress=lambda share, text: shares.append(share))
    assert shares == sorted(shares) and shares[-1] == 1.0
    with pytest.raises(Cancelled):
        remove_handles(torus(15.0, 3.0), progress=lambda share, text: share < 0.3)


# ---- the phantom ------------------------------------------------------------------------------------------------


def test_a_bridge_between_right_veins_is_found_and_cut():
    start, stop = between_right_veins(0.7)
    surface = atrium([(start, stop, 1.5)])
    assert surface.genus == 1
    plain = atrium([])
    assert plain.genus == 0
    result, (handle,) = remove_handles(surface)
    check_result(surface, result, (handle,))
    assert handle.kind == "bridge"
    assert handle.width_mm == pytest.approx(3.0, abs=0.4)
    axis = (stop - start) / np.linalg.norm(stop - start)
    offset = handle.place_mm - free_middle(start, stop)
    assert np.linalg.norm(offset - (offset @ axis) * axis) < 0.8, "on the axis of the bridge"
    assert SHAPE.signed_distance(handle.place_mm[None])[0] > 0, "between the veins"
    # What is left of the bridge is its two stumps.
    assert plain.enclosed_volume < result.enclosed_volume < surface.enclosed_volume
    assert abs(result.area / plain.area - 1) < 0.02


def test_two_bridges_beside_each_other_are_both_cut():
    # Two blind veins 3 mm apart that leave a common trunk below; the tunnel between the two bridges is narrower than
    # they are, but filling it would make one wide bridge.
    def veins(places: FloatArray) -> FloatArray:
        corners = [np.array([x, 0.0, z]) for x in (-7.5, 7.5) for z in (-25.0, 15.0)]
        trunk = rod(places, corners[0], corners[2], 8.0)
        return np.minimum.reduce([trunk, *(rod(places, corners[k], corners[k + 1], 6.0) for k in (0, 2))])

    heights = (2.0, 7.6)
    middle = np.array([[0.0, 0.0, z] for z in heights])
    side = np.array([7.5, 0.0, 0.0])
    surface = solid(
        veins, np.array([-16.0, -9, -34]), np.array([16.0, 9, 22]), [(m - side, m + side, 1.9) for m in middle]
    )
    assert surface.genus == 2
    shortest = surface.points[shortest_loop(surface)]
    assert heights[0] < shortest[:, 2].mean() < heights[1], "the tunnel has the shortest line"
    result, handles = remove_handles(surface)
    check_result(surface, result, handles)
    assert [handle.kind for handle in handles] == ["bridge", "bridge"]
    assert [handle.width_mm for handle in handles] == pytest.approx([3.8, 3.8], abs=0.5)
    found = np.array([handle.place_mm for handle in handles])
    distance, which = cKDTree(middle).query(found)
    assert sorted(which.tolist()) == [0, 1] and distance.max() < 1.6


def test_a_tunnel_through_the_body_is_filled():
    place = SHAPE.centre + np.array([0.0, 24.0, 0.0])
    side = np.array([40.0, 0.0, 0.0])
    surface = atrium([], [(place - side, place + side, 1.5)])
    assert surface.genus == 1
    result, (handle,) = remove_handles(surface)
    check_result(surface, result, (handle,))
    assert handle.kind == "tunnel"
    assert handle.width_mm == pytest.approx(3.0, abs=0.4)
    assert np.linalg.norm((handle.place_mm - place)[1:]) < 0.8
    assert result.enclosed_volume > surface.enclosed_volume


# ---- a real atrium ----------------------------------------------------------------------------------------------


def test_the_two_bridges_of_a_real_atrium(data_dir: Path):
    file = data_dir / "stacom2018" / "MJHV7_laendo.nrrd"
    if not file.is_file():
        pytest.skip(f"{file.name} not found")
    image = sitk.ReadImage(str(file))
    spacing = np.array(image.GetSpacing())
    mask = np.pad((sitk.GetArrayFromImage(image) > 0).astype(float), 4)
    smooth = gaussian_filter(mask, 0.9 / spacing[::-1])
    surface, _ = heal(surface_of(smooth, spacing, np.zeros(3), 0.5))
    assert surface.genus == 2
    result, handles = remove_handles(surface)
    check_result(surface, result, handles)
    assert len(handles) == 2 and all(handle.kind == "bridge" for handle in handles)
    assert abs(result.area / surface.area - 1) < 0.01
    assert abs(result.enclosed_volume / surface.enclosed_volume - 1) < 0.001
    assert heal(result)[0] is result, "the cuts leave nothing to heal"
