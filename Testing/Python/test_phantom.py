"""The phantom against closed forms, exact polyhedral geodesics and brute force."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import SimpleITK as sitk
from matplotlib.path import Path as PlanePath
from pygeodesic import geodesic
from scipy.spatial import cKDTree

from LAFlatteningLib import operators
from LAFlatteningLib.errors import LAFlatteningError
from LAFlatteningLib.phantom import DEFAULT_SCAR, Phantom, left_atrium_shape, make_phantom, mesh_phantom
from LAFlatteningLib.phantom.lge import Gap, LgeModel, ScarPatch, ScarPattern, ScarRing, make_lge_volume
from LAFlatteningLib.phantom.shape import PhantomShape
from LAFlatteningLib.phantom.sphere import angles_between, direction, tangent_frame

SHAPE = left_atrium_shape()
CENTRE = np.array(SHAPE.centre)
TUBES = tuple(SHAPE.tubes)
PATHS = tuple(SHAPE.anatomy.paths)
NO_SCAR = ScarPattern()


@cache
def phantom(points: int, closed: bool = False) -> Phantom:
    return make_phantom(points, closed=closed)


def random_directions(count: int, seed: int = 1) -> np.ndarray:
    u = np.random.default_rng(seed).normal(size=(count, 3))
    return u / np.linalg.norm(u, axis=1, keepdims=True)


def gradient(points: np.ndarray) -> np.ndarray:
    """Of the signed distance, by central differences: the outward normal."""
    step = 1e-4 * np.eye(3)
    return np.stack([SHAPE.signed_distance(points + e) - SHAPE.signed_distance(points - e) for e in step], 1) / 2e-4


def rim_loops(made: Phantom) -> dict[str, np.ndarray]:
    """Opening -> point ids of its rim, found by the nearest seed (the mean of the MV seeds for the valve)."""
    targets = {name: made.seeds[name] for name in TUBES}
    targets["MV"] = CENTRE + SHAPE.openings["MV"].rim[1] * SHAPE.openings["MV"].axis
    names, places = list(targets), np.array(list(targets.values()))
    loops = {}
    for loop in made.surface.boundary_loops:
        middle = made.surface.points[loop].mean(axis=0)
        loops[names[int(np.linalg.norm(places - middle, axis=1).argmin())]] = loop
    return loops


# ---- the mesh ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("points", [500, 501, 2000, 7777, 20000])
@pytest.mark.parametrize("closed", [False, True])
def test_mesh_is_a_good_oriented_manifold_on_the_surface(points: int, closed: bool) -> None:
    made = phantom(points, closed)
    surface = made.surface
    assert len(surface.points) == points
    assert surface.used_points.all()
    assert surface.is_manifold and surface.is_oriented
    assert surface.component_count == 1 and surface.genus == 0
    assert len(surface.boundary_loops) == (0 if closed else 6)
    assert np.abs(SHAPE.signed_distance(surface.points)).max() < 1e-9
    # Every triangle turns outward: to where the signed distance grows.
    normals = operators.area_vectors(surface.points, surface.triangles)
    outward = gradient(surface.points[surface.triangles].mean(axis=1))
    assert (np.einsum("ij,ij->i", normals, outward) > 0.5 * np.linalg.norm(normals, axis=1)).all()
    smallest = np.degrees(np.arctan2(1.0, operators.cotangents(surface.points, surface.triangles))).min(axis=1)
    assert np.mean(smallest > 25.0) > 0.99 and smallest.min() > 18.0
    lengths = surface.edge_lengths / surface.edge_lengths.mean()
    assert lengths.min() > 0.4 and lengths.max() < 1.7 and lengths.std() < 0.15


def test_no_triangle_has_two_rim_edges() -> None:
    for points in (500, 2000):
        surface = phantom(points).surface
        on_rim = surface.edges.usage == 1
        assert on_rim[surface.edges.of_triangle].sum(axis=1).max() == 1


def test_closed_mesh_has_positive_volume_and_it_contains_the_open_one() -> None:
    closed, opened = phantom(20000, True).surface, phantom(20000).surface
    assert operators.signed_volume(closed.points, closed.triangles) > 4.0 / 3.0 * np.pi * 28.0**3
    # Cut in the planes of the rims, the closed mesh leaves the area of the open surface.
    inside = phantom(20000, True).surface.cell_data["true_region"] > 0
    assert closed.triangle_areas[inside].sum() == pytest.approx(opened.area, rel=0.01)


@pytest.mark.parametrize("closed", [False, True])
def test_area_of_the_mesh_converges_to_the_closed_form(closed: bool) -> None:
    errors = [abs(phantom(n, closed).surface.area / SHAPE.area(closed) - 1.0) for n in (2000, 20000)]
    assert errors[0] < 0.01 and errors[1] < 0.15 * errors[0]


def test_two_meshes_of_one_request_are_the_same() -> None:
    first, second = make_phantom(3000), make_phantom(3000)
    assert np.array_equal(first.surface.points, second.surface.points)
    assert np.array_equal(first.surface.triangles, second.surface.triangles)
    assert np.array_equal(first.surface.point_data["LGE"], second.surface.point_data["LGE"])


def test_mesh_is_not_aligned_with_the_planes_of_the_paths() -> None:
    surface = phantom(20000).surface
    for path in PATHS:
        off = (surface.points - CENTRE) @ SHAPE.path_normal(path)
        near = np.abs(off) < 1.0
        # Evenly spread distances, as from a random plane: 1 % of the points within 1 % of the distance.
        assert np.mean(np.abs(off[near]) < 0.01) < 0.03
        a, b = surface.edges.points.T
        assert np.count_nonzero((np.abs(off[a]) < 0.01) & (np.abs(off[b]) < 0.01)) <= 3


# ---- rims, seeds, proportions --------------------------------------------------------------------------------------


def test_rims_are_the_stated_circles() -> None:
    # Means of Nunez-Garcia et al., appendix B.
    perimeters = {"LIPV": 38.73, "LSPV": 43.06, "RIPV": 44.49, "RSPV": 50.47, "LAA": 54.30, "MV": 120.0}
    made = phantom(20000)
    loops = rim_loops(made)
    assert set(loops) == set(perimeters)
    for name, loop in loops.items():
        rim = made.surface.points[loop]
        count = len(loop)
        radius = perimeters[name] / (2.0 * np.pi)
        centre = made.seeds[name] if name in TUBES else rim.mean(axis=0)
        assert np.abs(np.linalg.norm(rim - centre, axis=1) - radius).max() < 1e-9
        assert np.abs((rim - centre) @ SHAPE.openings[name].axis).max() < 1e-9
        # A regular polygon in the circle.
        assert made.surface.loop_length(loop) == pytest.approx(2.0 * count * radius * np.sin(np.pi / count), rel=1e-9)


def test_mitral_seeds_lie_on_the_rim_clockwise_as_on_the_disk() -> None:
    axis = SHAPE.openings["MV"].axis
    rim = phantom(2000).surface.points[rim_loops(phantom(2000))["MV"]]
    first, second = tangent_frame(axis)
    angles = []
    for label in ("MV1", "MV2", "MV3", "MV4"):
        offset = SHAPE.seeds[label] - rim.mean(axis=0)
        assert np.linalg.norm(offset) == pytest.approx(120.0 / (2.0 * np.pi), abs=1e-9)
        assert offset @ axis == pytest.approx(0.0, abs=1e-9)
        angles.append(np.degrees(np.arctan2(offset @ second, offset @ first)))
    # Seen from outside at the valve they run counter-clockwise; seen from behind, through the atrium, clockwise.
    # The arcs resemble those of the template, where the seeds lie at 22.5, -30, 210 and 130.5 degrees.
    arcs = np.diff([*angles, angles[0]]) % 360.0
    assert arcs.sum() == pytest.approx(360.0)
    assert np.abs(arcs - [52.5, 120.0, 79.5, 108.0]).max() < 15.0


def test_layout_is_that_of_a_patient_in_lps() -> None:
    # Off the origin, so that LPS taken for RAS shows.
    assert np.linalg.norm(phantom(2000).surface.points.mean(axis=0) - [12.0, -35.0, 80.0]) < 10.0
    assert phantom(2000).surface.space == "LPS"
    place = {name: SHAPE.seeds[name] - CENTRE for name in TUBES}
    valve = SHAPE.openings["MV"].axis
    for vein in ("RSPV", "RIPV"):
        assert place[vein][0] < -15
    for vein in ("LSPV", "LIPV", "LAA"):
        assert place[vein][0] > 15
    for vein in ("RSPV", "RIPV", "LSPV", "LIPV"):
        assert place[vein][1] > 0
    assert place["LAA"][1] < -10 and place["LAA"][2] > 0
    assert place["RSPV"][2] > 0 > place["RIPV"][2] and place["LSPV"][2] > 0 > place["LIPV"][2]
    assert valve[0] > 0 and valve[1] < 0 and valve[2] < 0


def test_distances_between_rims_resemble_the_population() -> None:
    exact = {"s3": 14.82, "s1": 17.03, "s8": 23.94}
    for path, mean in exact.items():
        assert SHAPE.path_length(path) == pytest.approx(mean, abs=0.1)
    # Right to left: as a sphere allows, about one standard deviation (8.61 and 7.21) below the mean.
    assert abs(SHAPE.path_length("s4") - 57.66) < 8.61
    assert abs(SHAPE.path_length("s2") - 58.91) < 1.15 * 7.21
    # The left veins are about half as far from the valve as the right ones.
    assert 1.4 < SHAPE.path_length("s6") / SHAPE.path_length("s7") < 3.0


# ---- paths and regions ---------------------------------------------------------------------------------------------


def covered_mesh(made: Phantom) -> tuple[np.ndarray, np.ndarray, dict[str, int]]:
    """The open mesh with flat covers: each rim joined to its seed. Also the point id of each seed."""
    points, triangles, ids = made.surface.points, [made.surface.triangles], {}
    loops = rim_loops(made)
    for name in TUBES:
        ids[name] = len(points)
        points = np.vstack([points, made.seeds[name]])
        loop = loops[name]
        triangles.append(np.stack([np.roll(loop, -1), loop, np.full(len(loop), ids[name])], axis=1))
    for label in SHAPE.valve.seeds:
        loop = loops["MV"]
        ids[label] = int(loop[np.linalg.norm(points[loop] - made.seeds[label], axis=1).argmin()])
    return points, np.concatenate(triangles), ids


def test_paths_are_shortest_by_an_exact_polyhedral_geodesic() -> None:
    made = phantom(10000)
    points, triangles, ids = covered_mesh(made)
    solver = geodesic.PyGeodesicAlgorithmExact(points, triangles)
    for path, (first, second) in SHAPE.anatomy.paths.items():
        length, line = solver.geodesicDistance(ids[first], ids[second])
        normal, expected = SHAPE.path_normal(path), SHAPE.path_length(path)
        expected += sum(SHAPE.openings[seed].rim[0] for seed in (first, second) if seed in TUBES)
        if second not in TUBES:
            # The mesh has no point just at the seed: the same closed form, with its nearest rim point.
            to_rim = points[ids[second]] - CENTRE
            start = SHAPE.nodes[first]
            turned = np.arccos(start @ to_rim / np.linalg.norm(to_rim)) - np.arccos(start @ SHAPE.nodes[second])
            expected += SHAPE.radius * turned
            normal = np.cross(start, to_rim) / np.linalg.norm(np.cross(start, to_rim))
        assert length == pytest.approx(expected, rel=2.5e-3)
        # The straight edges of a rim let a path cross the ridge of the cover beside the plane, by half an edge.
        assert np.abs((line - CENTRE) @ normal).max() < 0.5 * made.surface.edge_lengths.mean()


@pytest.mark.parametrize("path", PATHS)
def test_path_polyline_lies_on_the_surface_in_its_plane(path: str) -> None:
    line = SHAPE.path(path, 0.1, covered=False)
    assert np.abs(SHAPE.signed_distance(line)).max() < 1e-9
    assert np.abs((line - CENTRE) @ SHAPE.path_normal(path)).max() < 1e-9
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    assert steps.max() < 0.25 and steps.min() > 1e-6
    assert steps.sum() == pytest.approx(SHAPE.path_length(path), rel=1e-4)
    first, second = SHAPE.anatomy.paths[path]
    whole = phantom(2000).true_paths[path]
    assert np.allclose(whole[0], SHAPE.seeds[first]) and np.allclose(whole[-1], SHAPE.seeds[second])


def test_regions_agree_with_polygons_of_the_paths_in_a_stereographic_picture() -> None:
    axis = SHAPE.openings["MV"].axis
    first, second = tangent_frame(axis)

    def picture(u: np.ndarray) -> np.ndarray:
        return np.stack([u @ first, u @ second], axis=-1) / (1.0 - u @ axis)[..., None]

    u = random_directions(20000)
    u = u[SHAPE.caps.distance("MV", u) > 0.5]
    # Clear of all borders, which the polygons only sample.
    lines = {}
    for path, (start, end) in SHAPE.anatomy.paths.items():
        a, b = SHAPE.nodes[start], SHAPE.nodes[end]
        t = np.linspace(0.0, 1.0, 800)[:, None]
        chord = (1.0 - t) * a + t * b
        lines[path] = chord / np.linalg.norm(chord, axis=1, keepdims=True)
    clear = cKDTree(np.concatenate(list(lines.values()))).query(u)[0] > 0.01
    u = u[clear]
    found = SHAPE.division.region_of(u)
    assert set(np.unique(found)) == {1, 2, 3, 4, 5}
    # Rim arcs by the place of the seeds, from one seed to the next as the template shows them.
    rim = {1: ("MV2", "MV1"), 2: ("MV3", "MV2"), 3: ("MV4", "MV3"), 4: ("MV1", "MV4")}
    walks = {
        1: ["-s6", "s1r", "s5"],
        2: ["-s7", "s2r", "s6"],
        3: ["-s9", "s8r", "s3r", "s7"],
        4: ["-s5", "s4r", "s8", "s9"],
        5: ["s1", "s2", "s3", "s4"],
    }
    for region, walk in walks.items():
        parts = []
        for step in walk:
            name = step.strip("-r")
            parts.append(lines[name][::-1] if step[0] == "-" or step[-1] == "r" else lines[name])
        if region in rim:
            begin, end = (np.radians(SHAPE.valve.seeds[label]) for label in rim[region])
            angle = begin - np.linspace(0.0, (begin - end) % (2.0 * np.pi), 400)
            if region == 1:
                assert parts[-1][-1] @ SHAPE.nodes["MV1"] == pytest.approx(1.0)
            cap = SHAPE.caps.angles["MV"]
            arc = np.cos(cap) * axis + np.sin(cap) * (np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second)
            parts.append(arc if np.allclose(arc[0], parts[-1][-1]) else arc[::-1])
        polygon = PlanePath(picture(np.concatenate(parts)))
        assert np.array_equal(polygon.contains_points(picture(u)), found == region), region


def test_region_areas_add_up_and_agree_with_the_mesh() -> None:
    areas = SHAPE.region_areas()
    assert sum(areas.values()) == pytest.approx(SHAPE.area(), rel=1e-12)
    assert sum(SHAPE.division.solid_angles().values()) == pytest.approx(4.0 * np.pi)
    for made, tolerance in ((phantom(20000), 0.01), (phantom(20000, True), 0.02)):
        surface = made.surface
        for region, area in areas.items():
            on_mesh = surface.triangle_areas[surface.cell_data["true_region"] == region].sum()
            assert on_mesh == pytest.approx(area, rel=tolerance)


def test_each_rim_borders_the_regions_of_the_paths_that_end_there() -> None:
    made = phantom(20000)
    surface = made.surface
    for name, loop in rim_loops(made).items():
        touching = np.isin(surface.triangles, loop).any(axis=1)
        expected = {
            region
            for region, paths in SHAPE.anatomy.regions.items()
            if any(name in {SHAPE.anatomy.opening_of(s) for s in SHAPE.anatomy.paths[p]} for p in paths)
        }
        assert set(np.unique(surface.cell_data["true_region"][touching])) == expected


def test_points_beyond_the_rims_have_no_region() -> None:
    for name, tip in SHAPE.tips.items():
        seed = SHAPE.seeds[name]
        axis = SHAPE.openings[name].axis
        assert SHAPE.region_of(np.array([tip]))[0] == 0
        across = SHAPE.openings[name].rim[0] * tangent_frame(axis)[0]
        just_out, just_in = seed + across + 0.01 * axis, seed + across - 0.01 * axis
        assert SHAPE.region_of(np.array([just_out]))[0] == 0
        assert SHAPE.region_of(np.array([just_in]))[0] > 0


# ---- the analytic surface --------------------------------------------------------------------------------------------


def test_signed_distance_agrees_with_the_nearest_mesh_point() -> None:
    mesh = mesh_phantom(SHAPE, 30000, closed=True).surface
    rng = np.random.default_rng(2)
    beside = mesh.points[rng.integers(0, len(mesh.points), 3000)] + rng.uniform(-3.0, 3.0, (3000, 3))
    points = np.concatenate([beside, CENTRE + random_directions(2000) * rng.uniform(1.0, 62.0, (2000, 1))])
    distance = SHAPE.signed_distance(points)
    nearest = cKDTree(mesh.points).query(points)[0]
    exact = distance < 3.0
    assert np.count_nonzero(exact & (distance > 0.5)) > 500
    # The nearest vertex is no nearer than the surface; beside the foot by at most an edge, on a surface that
    # curves away or towards the point with radii of 3 mm or more.
    edge = mesh.edge_lengths.max()
    assert (nearest[exact] > np.abs(distance[exact]) - 1e-9).all()
    assert (nearest[exact] < np.hypot(distance[exact], edge)).all()
    assert (nearest[~exact] > 2.95).all()
    feet = SHAPE.closest_points(points)
    assert np.abs(SHAPE.signed_distance(feet)).max() < 1e-6
    assert np.abs(np.linalg.norm(points - feet, axis=1) - np.abs(distance))[exact].max() < 1e-9


def test_signed_distance_of_known_points() -> None:
    valve = SHAPE.openings["MV"].axis
    known = {
        "centre, nearest to the valve plane": (CENTRE, -(np.sqrt(900 - (60 / np.pi) ** 2) + 3.0)),
        "behind the posterior wall": (CENTRE + 32.0 * direction(0.0, 0.0), 2.0),
        "a tip": (SHAPE.tips["LAA"], 0.0),
        "a seed, on the axis of its tube": (SHAPE.seeds["LIPV"], -38.73 / (2 * np.pi)),
        "before the valve": (CENTRE + 30.0 * valve, 30.0 - (np.sqrt(900 - (60 / np.pi) ** 2) + 3.0)),
    }
    for name, (point, distance) in known.items():
        assert SHAPE.signed_distance(np.array([point]))[0] == pytest.approx(distance, abs=1e-9), name


def test_vein_length_is_measured_from_rim_to_tip() -> None:
    shape = left_atrium_shape(vein_length=12.0, appendage_length=25.0, scar=NO_SCAR)
    for name, tip in shape.tips.items():
        length = 25.0 if name == "LAA" else 12.0
        assert np.linalg.norm(tip - shape.seeds[name]) == pytest.approx(length)
    assert phantom(2000).tips == {}
    assert set(phantom(2000, True).tips) == set(TUBES)


@pytest.mark.parametrize("closed", [False, True])
def test_conformal_map_keeps_angles(closed: bool) -> None:
    changes = []
    for points in (5000, 20000):
        surface = phantom(points, closed).surface
        image = SHAPE.conformal(surface.points)
        assert np.allclose(np.linalg.norm(image, axis=1), 1.0)
        before, after = (
            np.degrees(np.arctan2(1.0, operators.cotangents(p, surface.triangles))) for p in (surface.points, image)
        )
        changes.append(np.percentile(np.abs(after - before), 99))
    # It falls with the size of the triangles.
    assert changes[1] < 0.65 * changes[0] and changes[1] < 5.0
    # Along one meridian and one parallel of a tube, over short steps: equal stretch to first order.
    opening = SHAPE.openings["RSPV"]
    first, second = tangent_frame(opening.axis)
    place = CENTRE + opening.rim[0] * first + (opening.rim[1] + 3.0) * opening.axis
    step = 1e-4
    moved = np.array([place, place + step * opening.axis, place + step * second])
    there = SHAPE.conformal(moved)
    stretch = np.linalg.norm(there[1:] - there[0], axis=1) / step
    assert stretch[0] == pytest.approx(stretch[1], rel=1e-3)


# ---- scar ----------------------------------------------------------------------------------------------------------


def with_scar(*rings: ScarRing, patches: tuple[ScarPatch, ...] = ()) -> PhantomShape:
    return replace(SHAPE, scar_pattern=ScarPattern(rings, patches))


def test_area_of_a_patch_and_of_a_ring_by_quadrature() -> None:
    patch = with_scar(patches=(ScarPatch(-8.0, 2.0, 8.0),))
    areas = patch.scar_areas()
    assert areas[5] == pytest.approx(2.0 * np.pi * 900.0 * (1.0 - np.cos(8.0 / 30.0)), abs=0.2)
    assert sum(areas.values()) == areas[5]
    ring = with_scar(ScarRing(("RIPV",), 1.0, 4.0))
    contact = SHAPE.caps.angles["RIPV"]
    exact = 2.0 * np.pi * 900.0 * (np.cos(contact + 1.0 / 30.0) - np.cos(contact + 4.0 / 30.0))
    assert sum(ring.scar_areas().values()) == pytest.approx(exact, abs=0.3)


def test_scar_fractions_agree_with_the_mesh() -> None:
    made = phantom(20000)
    surface = made.surface
    scar = SHAPE.scar(surface.points[surface.triangles].mean(axis=1))
    for region, fraction in SHAPE.scar_fractions(300_000).items():
        mine = surface.cell_data["true_region"] == region
        on_mesh = surface.triangle_areas[mine & scar].sum() / surface.triangle_areas[mine].sum()
        assert on_mesh == pytest.approx(fraction, abs=0.004)
        assert 0.02 < fraction < 0.3


@pytest.mark.parametrize("width", [3.0, 5.0, 8.0, 12.0])
def test_gap_has_its_width_at_every_distance(width: float) -> None:
    angle = 40.0
    ring = ScarRing(("RSPV",), 1.0, 5.0, (Gap(angle, width),))
    shape = with_scar(ring)
    axis = SHAPE.caps.axes["RSPV"]
    first, second = tangent_frame(axis)
    a = np.radians(angle)
    along = np.cos(a) * first + np.sin(a) * second
    # The last scar on either side of the gap, at many distances from the vein.
    t = SHAPE.caps.angles["RSPV"] + np.linspace(1.001, 4.999, 81) / 30.0
    turn = np.radians(np.linspace(0.0, 120.0, 4001))
    sides = []
    for sign in (-1.0, 1.0):
        ways = np.cos(turn)[:, None] * along + sign * np.sin(turn)[:, None] * np.cross(axis, along)
        grid = np.cos(t)[:, None, None] * axis + np.sin(t)[:, None, None] * ways
        scar = shape.scar(CENTRE + 30.0 * grid.reshape(-1, 3)).reshape(grid.shape[:2])
        assert not scar[:, 0].any() and scar[:, -1].all()
        sides.append(grid[np.arange(len(t)), scar.argmax(axis=1)])
    apart = 60.0 * np.arcsin(0.5 * np.linalg.norm(sides[0][:, None] - sides[1], axis=2))
    assert apart.min() == pytest.approx(width, abs=0.02)
    # As wide at the outer edge of the ring, where a sector would be wider.
    assert apart[40:].min() == pytest.approx(width, abs=0.02)


def test_joint_ring_surrounds_both_veins_and_leaves_the_carina() -> None:
    shape = with_scar(ScarRing(("LSPV", "LIPV"), 4.0, 8.0))
    between = SHAPE.nodes["LSPV"] + SHAPE.nodes["LIPV"]
    carina = CENTRE + 30.0 * between / np.linalg.norm(between)
    assert not shape.scar(carina[None])[0]
    for vein in ("LSPV", "LIPV"):
        away = SHAPE.nodes[vein] - 0.8 * SHAPE.nodes["LIPV" if vein == "LSPV" else "LSPV"]
        away -= (away @ SHAPE.nodes[vein]) * SHAPE.nodes[vein]
        away /= np.linalg.norm(away)
        t = SHAPE.caps.angles[vein] + 6.0 / 30.0
        assert shape.scar((CENTRE + 30.0 * (np.cos(t) * SHAPE.nodes[vein] + np.sin(t) * away))[None])[0]


def test_point_array_lge_is_the_maximum_along_the_normal() -> None:
    model = LgeModel()
    for closed in (False, True):
        surface = phantom(2000, closed).surface
        depth = np.linspace(-2.95, 2.95, 119)
        samples = surface.points[:, None] + depth[:, None] * gradient(surface.points)[:, None]
        values = SHAPE.intensity(samples.reshape(-1, 3), model).reshape(len(surface.points), -1)
        # On the rounded edge of the closed valve the direction changes along the normal.
        body = SHAPE.caps.distance(
            "MV", (surface.points - CENTRE) / np.linalg.norm(surface.points - CENTRE, axis=1)[:, None]
        )
        away = body > -1e-6
        assert np.abs(values.max(axis=1) - surface.point_data["LGE"])[away].max() < 0.5
        # An intensity ratio of 1.2 separates scar from healthy wall.
        assert np.array_equal(surface.point_data["LGE"] > 1.2 * model.blood, surface.point_data["scar"] == 1)
        assert 0.05 < surface.point_data["scar"].mean() < 0.3


# ---- the image -----------------------------------------------------------------------------------------------------


@cache
def volume() -> sitk.Image:
    return make_lge_volume(SHAPE, spacing=(0.7, 0.7, 0.7))


def at(image: sitk.Image, point: np.ndarray) -> float:
    return float(image.EvaluateAtPhysicalPoint(point.tolist(), sitk.sitkLinear))


def test_intensities_at_known_places() -> None:
    image = volume()
    assert image.GetPixelID() == sitk.sitkFloat32
    back = direction(-8.0, 2.0)
    healthy = direction(30.0, 10.0)
    complete = SHAPE.nodes["RIPV"]
    ring = (
        np.cos(2.5 / 30.0 + SHAPE.caps.angles["RIPV"]) * complete
        + np.sin(2.5 / 30.0 + SHAPE.caps.angles["RIPV"]) * tangent_frame(complete)[1]
    )
    middle = 31.25
    assert at(image, CENTRE) == pytest.approx(100.0)
    assert at(image, SHAPE.seeds["LSPV"]) == pytest.approx(100.0)
    assert at(image, CENTRE + middle * back) == pytest.approx(170.0, abs=1.0)
    assert at(image, CENTRE + middle * healthy) == pytest.approx(70.0, abs=1.0)
    assert at(image, CENTRE + middle * ring) == pytest.approx(170.0, abs=3.0)
    assert at(image, CENTRE + 36.0 * back) == pytest.approx(30.0)
    assert at(image, CENTRE + 34.0 * SHAPE.openings["MV"].axis) == pytest.approx(100.0)
    # A vein's wall is healthy, and the middle of a gap too.
    vein = SHAPE.openings["LIPV"]
    wall = CENTRE + (vein.rim[0] + 1.25) * tangent_frame(vein.axis)[0] + (vein.rim[1] + 4.0) * vein.axis
    assert at(image, wall) == pytest.approx(70.0, abs=2.0)
    gap = DEFAULT_SCAR.rings[1].gaps[0]
    axis = SHAPE.nodes["RSPV"]
    first, second = tangent_frame(axis)
    way = np.cos(np.radians(gap.angle)) * first + np.sin(np.radians(gap.angle)) * second
    t = SHAPE.caps.angles["RSPV"] + 2.5 / 30.0
    assert at(image, CENTRE + middle * (np.cos(t) * axis + np.sin(t) * way)) == pytest.approx(70.0, abs=1.0)
    assert at(image, CENTRE + middle * (np.cos(t) * axis - np.sin(t) * way)) == pytest.approx(170.0, abs=3.0)


def test_image_encloses_the_closed_phantom() -> None:
    image = volume()
    size = image.GetSize()
    corners = [image.TransformIndexToPhysicalPoint(index) for index in ((0, 0, 0), tuple(n - 1 for n in size))]
    points = phantom(20000, True).surface.points
    assert (points.min(axis=0) - np.array(corners[0]) > 9.0).all()
    assert (np.array(corners[1]) - points.max(axis=0) > 9.0).all()


OBLIQUE = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]


@pytest.mark.parametrize("turn", [np.diag([-1.0, -1.0, 1.0]), np.diag([1.0, 1.0, -1.0]), OBLIQUE, -OBLIQUE])
def test_image_is_the_same_in_any_direction(turn: np.ndarray) -> None:
    image = make_lge_volume(SHAPE, spacing=(1.5, 2.0, 2.5), direction=turn)
    assert np.allclose(np.array(image.GetDirection()).reshape(3, 3), turn)
    assert image.GetSpacing() == (1.5, 2.0, 2.5)
    values = sitk.GetArrayViewFromImage(image)
    rng = np.random.default_rng(4)
    indices = rng.integers(0, image.GetSize(), (500, 3))
    places = np.array([image.TransformIndexToPhysicalPoint([int(i) for i in index]) for index in indices])
    expected = SHAPE.intensity(places, LgeModel())
    assert np.abs(values[tuple(indices.T[::-1])] - expected).max() < 1e-3
    assert len(np.unique(expected.round(1))) > 5
    # Nothing of the atrium is cut off.
    inside = SHAPE.closest_points(phantom(2000, True).surface.points)
    index = np.array([image.TransformPhysicalPointToContinuousIndex(p.tolist()) for p in inside])
    assert (index > 0).all() and (index < np.array(image.GetSize()) - 1).all()


def test_noise_is_gaussian_of_the_stated_size_and_repeatable() -> None:
    shape = left_atrium_shape(scar=NO_SCAR)
    quiet, noisy, again = (
        sitk.GetArrayFromImage(make_lge_volume(shape, (3, 3, 3), noise=noise, seed=seed)).astype(float)
        for noise, seed in ((0.0, 0), (8.0, 5), (8.0, 5))
    )
    assert np.array_equal(noisy, again)
    difference = (noisy - quiet).ravel()
    assert difference.std() == pytest.approx(8.0, rel=0.03) and abs(difference.mean()) < 0.3
    # 68.3 % within one standard deviation.
    assert np.mean(np.abs(difference) < 8.0) == pytest.approx(0.683, abs=0.02)


def test_partial_volume_has_the_stated_width() -> None:
    model = LgeModel(transition=2.0)
    u = direction(30.0, 10.0)
    radii = np.linspace(27.0, 35.0, 801)
    values = SHAPE.intensity(CENTRE + radii[:, None] * u, model)
    changing = radii[(values < 99.999) & (values > 70.001)]
    assert changing.min() == pytest.approx(29.0, abs=0.05)
    inner = changing[changing < 31.25]
    assert inner.max() == pytest.approx(31.0, abs=0.05)
    assert np.interp(30.0, radii, values) == pytest.approx(85.0, abs=0.01)


# ---- bad input -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"points": 499}, "whole number of points from 500 to 1000000, found 499"),
        ({"points": 1_000_001}, "found 1000001"),
        ({"points": 1000.5}, "whole number of points"),
        ({"vein_length": -3.0}, "vein_length between 0 and 200 mm, found -3"),
        ({"vein_length": float("nan")}, "vein_length between 0 and 200 mm, found nan"),
        ({"vein_length": 4.0}, "at least .* mm beyond the rim"),
        ({"appendage_length": 0.0}, "appendage_length between 0 and 200"),
    ],
)
def test_bad_phantom_is_refused(arguments: dict, message: str) -> None:
    with pytest.raises(LAFlatteningError, match=message):
        make_phantom(**arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"spacing": (1.0, 1.0)}, "three positive numbers"),
        ({"spacing": (1.0, 0.0, 1.0)}, "three positive numbers"),
        ({"spacing": (1.0, 1.0, float("inf"))}, "three positive numbers"),
        ({"direction": np.eye(2)}, "3 x 3 numbers, found 4"),
        ({"direction": np.diag([1.0, 1.0, 2.0])}, "orthonormal"),
        ({"direction": [1, 0.1, 0, 0, 1, 0, 0, 0, 1]}, "orthonormal"),
        ({"noise": -1.0}, "standard deviation of the noise"),
        ({"margin": -1.0}, "margin"),
    ],
)
def test_bad_volume_is_refused(arguments: dict, message: str) -> None:
    with pytest.raises(LAFlatteningError, match=message):
        make_lge_volume(SHAPE, **{"spacing": (4.0, 4.0, 4.0), **arguments})


@pytest.mark.parametrize(
    ("rings", "message"),
    [
        ((ScarRing(("XX",), 1.0, 4.0),), "openings out of"),
        ((ScarRing((), 1.0, 4.0),), "found none"),
        ((ScarRing(("RSPV",), 4.0, 1.0),), "inner < outer"),
        ((ScarRing(("RSPV",), -1.0, 1.0),), "inner < outer"),
        ((ScarRing(("RSPV",), 1.0, 4.0, (Gap(0.0, 0.0),)),), "width between 0 and"),
        ((ScarRing(("RSPV",), 1.0, 4.0, (Gap(0.0, 40.0),)),), "width between 0 and"),
        ((ScarRing(("RSPV",), 1.0, 4.0, (Gap(0.0, 5.0), Gap(10.0, 5.0))),), "overlaps the one"),
        (
            (ScarRing(("RSPV",), 1.0, 6.0, (Gap(180.0, 5.0),)), ScarRing(("RIPV",), 1.0, 8.0)),
            "filled by other scar",
        ),
    ],
)
def test_bad_scar_is_refused(rings: tuple[ScarRing, ...], message: str) -> None:
    with pytest.raises(LAFlatteningError, match=message):
        with_scar(*rings)


def test_bad_patch_and_model_are_refused() -> None:
    with pytest.raises(LAFlatteningError, match="Scar patch: expected a radius"):
        with_scar(patches=(ScarPatch(0.0, 0.0, -1.0),))
    with pytest.raises(LAFlatteningError, match="transition < wall"):
        LgeModel(transition=3.0)
    with pytest.raises(LAFlatteningError, match="background <= healthy"):
        LgeModel(scar=50.0)


def test_impossible_layout_is_refused() -> None:
    tubes = dict(SHAPE.tubes)
    near = {**tubes, "LSPV": replace(tubes["LSPV"], elevation=5.0)}
    with pytest.raises(LAFlatteningError, match="LIPV and LSPV are"):
        replace(SHAPE, tubes=near)
    with pytest.raises(LAFlatteningError, match="rim lies in the fillet"):
        replace(SHAPE, tubes={**tubes, "LAA": replace(tubes["LAA"], offset=1.0)})
    swapped = replace(SHAPE.valve, seeds={"MV1": 137.0, "MV2": 85.0, "MV3": 253.0, "MV4": 336.0})
    with pytest.raises(LAFlatteningError, match=r"Paths s5 and s6 meet"):
        replace(SHAPE, valve=swapped)
    across = replace(SHAPE.valve, seeds={**SHAPE.valve.seeds, "MV4": 200.0})
    with pytest.raises(LAFlatteningError, match="Path s9 runs into MV"):
        replace(SHAPE, valve=across)


def test_angles_between_is_accurate_for_small_angles() -> None:
    axis = direction(20.0, 30.0)
    side = tangent_frame(axis)[0]
    for angle in (1e-8, 1e-3, 1.0, 3.0):
        u = np.cos(angle) * axis + np.sin(angle) * side
        assert angles_between(u[None], axis)[0] == pytest.approx(angle, rel=1e-6)
