"""The method regional: the map belongs to the atrium and its seeds, not to the triangles."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from LAFlatteningLib import Flattener, SeedError, Surface, distortion, flatten, make_phantom
from LAFlatteningLib.anatomy import LEFT_ATRIUM
from LAFlatteningLib.flattening.coarse import Carrier, coarsened


def radii(flat_map, ours, theirs):
    return np.linalg.norm(ours - theirs, axis=1) / flat_map.template.radius


@pytest.fixture(scope="module")
def fine():
    phantom = make_phantom(8000)
    return phantom, flatten(phantom.surface, phantom.seeds)


def test_two_resolutions_give_one_map(fine, phantom, phantom_map):
    """The phantom is one shape at any resolution: the coarse map, carried over, is the fine one."""
    _, fine_map = fine
    carried = Carrier(phantom_map.surface, fine_map.surface)(phantom_map.points)
    apart = radii(fine_map, carried, fine_map.points)
    # 2,000 and 8,000 points: edges of 3 and 1.5 mm. A step of the paths by an edge would be .05.
    assert np.median(apart) < 0.01
    assert np.percentile(apart, 95) < 0.03


def test_another_triangulation_of_the_same_points_gives_the_same_map(phantom, phantom_map):
    """Every second edge of the flat parts flipped: nearly the same shape, quite other edges to walk along."""
    surface = phantom.surface
    triangles = surface.triangles.copy()
    edges = surface.edges
    rng = np.random.default_rng(0)
    joined = {tuple(edge) for edge in edges.points.tolist()}
    touched = np.zeros(len(triangles), bool)
    flipped = 0
    for edge in rng.permutation(np.flatnonzero(edges.usage == 2)):
        one, two = edges.triangles[edge]
        if touched[one] or touched[two]:
            continue
        a, b = edges.points[edge]
        p = int(np.setdiff1d(triangles[one], [a, b])[0])
        q = int(np.setdiff1d(triangles[two], [a, b])[0])
        normals = [np.cross(*(surface.points[t[1:]] - surface.points[t[0]])) for t in (triangles[one], triangles[two])]
        cosine = normals[0] @ normals[1] / np.prod([np.linalg.norm(normal) for normal in normals])
        corner = int(np.flatnonzero(triangles[one] == p)[0])
        a, b = int(triangles[one][(corner + 1) % 3]), int(triangles[one][(corner + 2) % 3])
        new = [np.cross(surface.points[x] - surface.points[p], surface.points[y] - surface.points[p])
               for x, y in ((a, q), (q, b))]  # fmt: skip
        convex = all(normal @ normals[0] > 0.3 * np.linalg.norm(normals[0]) ** 2 for normal in new)
        if cosine < 0.99 or not convex or (min(p, q), max(p, q)) in joined:
            continue
        triangles[one], triangles[two] = (p, a, q), (q, b, p)
        touched[[one, two]] = True
        joined.add((min(p, q), max(p, q)))
        flipped += 1
    assert flipped > 400
    other = flatten(Surface(surface.points, triangles), phantom.seeds)
    apart = radii(phantom_map, other.points, phantom_map.points)
    assert np.median(apart) < 0.005
    assert np.percentile(apart, 95) < 0.02


def test_a_small_move_of_a_seed_is_a_small_move_of_the_map(phantom, phantom_map):
    flattener = Flattener(phantom.surface)
    before, steps = phantom_map.points, []
    at = phantom_map.seeds.positions["RIPV"]
    for k in range(1, 9):
        moved = {**phantom_map.seeds.positions, "RIPV": at + k * np.array([0.0, 0.1, 0.05])}
        after = flattener.flatten(moved).points
        steps.append(np.percentile(radii(phantom_map, after, before), 95))
        before = after
    # 0.1 mm is .002 disk radii or so. On triangles of 3 mm a line may still go over to the other side of a point, where
    # it is as short; one that jumped to the next edge would move the map by .05.
    assert np.median(steps) < 0.002
    assert max(steps) < 0.02


def test_cavity_points_keep_their_ids_and_paths_lie_between_them(phantom, phantom_map):
    division, n = phantom_map.division, len(phantom.surface.points)
    assert np.array_equal(division.surface.points[:n], phantom.surface.points)
    assert len(phantom_map.points) == n < len(phantom_map.solution)
    for name, (on_atrium, on_map) in phantom_map.lines.items():
        start, end = phantom_map.template.segment(name)
        walked = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(on_atrium, axis=0), axis=1))])
        expected = start + (walked / walked[-1])[:, None] * (end - start)
        assert np.abs(on_map - expected).max() < 1e-12
        assert cKDTree(phantom.surface.points).query(on_atrium)[0].max() < 2.0


def test_no_triangle_folds_neither_whole_nor_cut(phantom_map):
    division = phantom_map.division
    assert len(distortion.folded_triangles(phantom_map.solution, division.surface.triangles)) == 0
    assert len(distortion.folded_triangles(phantom_map.points, phantom_map.triangles)) == 0
    assert division.surface.area == pytest.approx(phantom_map.surface.area)


@pytest.mark.parametrize("points", [600, 800, 1000])
def test_coarse_meshes_with_few_points_on_a_rim(points):
    phantom = make_phantom(points)
    # The smallest ostium has about a dozen.
    assert min(map(len, phantom.surface.boundary_loops)) < 20
    flat_map = flatten(phantom.surface, phantom.seeds)
    assert flat_map.metrics["folded_triangles"] == 0
    assert flat_map.path_drift < 1e-9 or len(flat_map.freed_path_points)


# ---- quick maps ----


def test_quick_map_is_the_map_while_nothing_moves(phantom):
    flattener = Flattener(phantom.surface)
    full = flattener.flatten(phantom.seeds)
    quick = flattener.preview(phantom.seeds)
    assert np.abs(quick.points - full.points).max() < 1e-9
    assert np.array_equal(quick.triangles, full.triangles)
    assert (quick.regions == full.regions).mean() > 0.9


def test_rims_of_a_quick_map_are_on_their_outlines(fine):
    phantom, full = fine
    flattener = Flattener(phantom.surface)
    quick = flattener.preview({**phantom.seeds, "RIPV": phantom.seeds["RIPV"] + [0.0, 1.0, 1.0]})
    for opening, loop in full.division.loops.items():
        rim = loop[loop < len(quick.points)]
        assert full.template.rim(opening).shape.distance(quick.points[rim]).max() < 1e-12


def test_quick_map_follows_a_moved_seed(fine):
    phantom, full = fine
    flattener = Flattener(phantom.surface)
    start = flattener.flatten(phantom.seeds)
    moved = {**start.seeds.positions}
    moved["MV3"] = start.seeds.positions["MV3"] + 6.0 * unit(
        start.seeds.positions["MV2"] - start.seeds.positions["MV3"]
    )
    moved["LSPV"] = start.seeds.positions["LSPV"] + [0.0, 2.0, 2.0]
    quick = flattener.preview(moved)
    there = Flattener(phantom.surface).flatten(moved)
    apart = radii(full, quick.points, there.points)
    went = radii(full, there.points, start.points)
    assert np.percentile(went, 95) > 0.02, "the seeds must move the map for this to be a test"
    assert np.median(apart) < 0.01
    assert np.percentile(apart, 95) < 0.5 * np.percentile(went, 95)


def unit(vector):
    return vector / np.linalg.norm(vector)


def test_quick_map_without_a_full_one_before(fine):
    phantom, full = fine
    quick = Flattener(phantom.surface).preview(phantom.seeds)
    assert np.median(radii(full, quick.points, full.points)) < 0.01


def test_quick_map_at_the_end_of_a_long_drag(fine):
    """Each quick map starts from the one before it, but errors do not add up."""
    phantom, full = fine
    flattener = Flattener(phantom.surface)
    start = flattener.flatten(phantom.seeds).seeds.positions
    for k in range(1, 13):
        moved = {**start, "RIPV": start["RIPV"] + 0.3 * k * unit(start["RSPV"] - start["RIPV"])}
        quick = flattener.preview(moved)
    fresh = Flattener(phantom.surface)
    fresh.flatten(phantom.seeds)
    assert np.median(radii(full, quick.points, fresh.preview(moved).points)) < 0.002
    assert np.median(radii(full, quick.points, flattener.flatten(moved).points)) < 0.01


def test_a_map_does_not_depend_on_what_was_made_before_it(fine):
    phantom, full = fine
    flattener = Flattener(phantom.surface)
    other = {**phantom.seeds, "MV3": phantom.seeds["MV3"] + [1.0, 1.0, 0.0]}
    flattener.flatten(other)
    flattener.preview({**phantom.seeds, "RIPV": phantom.seeds["RIPV"] + [0.0, 0.5, 0.5]})
    flattener.preview(phantom.seeds)
    assert np.array_equal(flattener.flatten(phantom.seeds).points, full.points)


def test_quick_map_refuses_what_the_map_refuses(phantom):
    flattener = Flattener(phantom.surface)
    flattener.flatten(phantom.seeds)
    swapped = {**phantom.seeds, "RSPV": phantom.seeds["RIPV"], "RIPV": phantom.seeds["RSPV"]}
    for call in (flattener.preview, flattener.flatten):
        with pytest.raises(SeedError):
            call(swapped)
    with pytest.raises(SeedError, match="missing"):
        flattener.preview({label: phantom.seeds[label] for label in LEFT_ATRIUM.holes})


def test_coarse_copy_is_the_same_shape(fine):
    phantom, _ = fine
    coarse = coarsened(phantom.surface, 1500)
    assert 1000 < len(coarse.points) < 2000
    assert len(coarse.boundary_loops) == 6 and coarse.is_manifold
    assert coarse.area == pytest.approx(phantom.surface.area, rel=0.02)
    carrier = Carrier(coarse, phantom.surface)
    # Carrying the coordinates themselves gives the nearest places on the copy.
    assert np.median(np.linalg.norm(carrier(coarse.points) - phantom.surface.points, axis=1)) < 0.2
    assert np.allclose(carrier(np.ones((len(coarse.points), 1))), 1.0)


# ---- solvers ----


def test_cholmod_where_installed_agrees_with_superlu(phantom, phantom_map, monkeypatch):
    from LAFlatteningLib import solvers

    if solvers.solver_name() != "CHOLMOD":
        pytest.skip("scikit-sparse, an optional package, is not installed")
    assert phantom_map.metrics["solver"] == "CHOLMOD"
    monkeypatch.setattr(solvers, "_cholmod", None)
    other = flatten(phantom.surface, phantom.seeds)
    assert other.metrics["solver"] == "SuperLU"
    assert np.abs(other.points - phantom_map.points).max() < 1e-8
