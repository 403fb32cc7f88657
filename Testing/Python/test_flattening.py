"""The map: exact where the answer is known, free of folds everywhere, and true to the published one."""

import copy
import dataclasses
import pickle
import re
from types import SimpleNamespace

import meshes
import numpy as np
import pytest
from cases import moved, seeds_by_rule
from scipy import sparse
from scipy.sparse.linalg import spsolve

from LAFlatteningLib import distortion, operators
from LAFlatteningLib.anatomy import LEFT_ATRIUM
from LAFlatteningLib.division import label_regions
from LAFlatteningLib.errors import Cancelled, LAFlatteningError
from LAFlatteningLib.files import read_seeds, read_surface
from LAFlatteningLib.flattening import Flattener, flatten, refinement
from LAFlatteningLib.flattening.chords import flip_chords, flip_folded, split_crossing
from LAFlatteningLib.phantom import make_phantom
from LAFlatteningLib.remeshing import remesh
from LAFlatteningLib.solvers import Factorisation, harmonic, published_least_squares
from LAFlatteningLib.surface import Surface
from LAFlatteningLib.template import Template

# ---- solvers, where the answer is known ----


def test_factorisation_solves():
    rng = np.random.default_rng(0)
    a = sparse.random(200, 200, 0.02, random_state=1)
    matrix = (a @ a.T + sparse.eye(200)).tocsr()
    right = rng.random((200, 2))
    first = Factorisation(matrix)
    assert np.allclose(matrix @ first.solve(right), right)
    # The same pattern with other values, in the order found before.
    other = matrix + sparse.diags(rng.random(200))
    again = Factorisation(other, first.order)
    assert np.allclose(other @ again.solve(right), right)
    assert np.array_equal(again.order, first.order)


@pytest.mark.parametrize("size", [1.0, 1e-60, 1e60, 0.0])
def test_single_precision_keeps_numbers_of_any_size(size):
    rng = np.random.default_rng(0)
    matrix = (sparse.eye(50) * 4.0 + sparse.random(50, 50, 0.05, random_state=2)).tocsc()
    matrix = (matrix @ matrix.T).tocsc()
    right = size * rng.standard_normal((50, 2))
    result = Factorisation(matrix, single=True).solve(right)
    assert result.dtype == np.float64
    np.testing.assert_allclose(result, np.linalg.solve(matrix.toarray(), right), rtol=1e-3, atol=1e-5 * size)


def test_annulus_has_the_known_harmonic_map():
    """Rims of radii 1 and 3 mapped to radii 1 and 2: the harmonic map is (a r + b / r) e^(i angle)."""
    b = (2 - 3) / (1 / 3 - 3)
    a = 1 - b
    errors = []
    for rings in (9, 17, 33):
        surface = meshes.annulus(1.0, 3.0, rings, 6 * rings)
        r = np.linalg.norm(surface.points[:, :2], axis=1)
        exact = surface.points[:, :2] * ((a * r + b / r) / r)[:, None]
        fixed = np.concatenate(surface.boundary_loops)
        flat, _ = harmonic(surface.laplacian, fixed, exact[fixed])
        assert np.array_equal(flat[fixed], exact[fixed])
        errors.append(np.abs(flat - exact).max())
    assert errors[-1] < 2e-3
    # Second order: the error falls by four as the edges halve.
    assert errors[0] / errors[1] > 3
    assert errors[1] / errors[2] > 3


def test_elimination_equals_the_saddle_point_system_of_the_paper():
    """Equations 3-4 as printed, with Lagrange multipliers, one spsolve a coordinate."""
    surface = meshes.annulus(10.0, 30.0, 9, 48)
    rng = np.random.default_rng(0)
    n = len(surface.points)
    rims = np.concatenate(surface.boundary_loops)
    paths = rng.choice(np.setdiff1d(np.arange(n), rims), 12, replace=False)
    rim_targets, path_targets = rng.random((len(rims), 2)), rng.random((12, 2))
    laplacian = 2.0 * surface.laplacian
    ours = published_least_squares(laplacian, rims, rim_targets, paths, path_targets)
    matrix = laplacian.tolil()
    matrix[rims] = 0
    matrix[rims, rims] = 1
    matrix = matrix.tocsr()
    picks = sparse.csr_matrix((np.ones(12), (np.arange(12), paths)), shape=(12, n))
    w = 1.0
    saddle = sparse.bmat([[w**2 * matrix.T @ matrix, picks.T], [picks, None]], format="csc")
    for axis in (0, 1):
        b = np.zeros(n)
        b[rims] = rim_targets[:, axis]
        solution = spsolve(saddle, np.concatenate([w**2 * matrix.T @ b, path_targets[:, axis]]))
        assert np.abs(solution[:n] - ours[:, axis]).max() < 1e-8


def test_a_chain_of_ears_is_flipped():
    surface = meshes.annulus(10.0, 20.0, 5, 30)
    rim = min(surface.boundary_loops, key=surface.loop_length)
    a, b = (int(i) for i in rim[:2])
    # An ear on the edge a-b, and a second one on the edge from a to its tip: both inner edges become chords.
    tip = surface.points[[a, b]].mean(axis=0) * 0.9
    tip2 = (surface.points[a] + tip) / 2 * 0.97
    e, f = len(surface.points), len(surface.points) + 1
    ears = Surface(
        np.concatenate([surface.points, [tip, tip2]]), np.concatenate([surface.triangles, [[b, a, e], [e, a, f]]])
    )
    rim = next(loop for loop in ears.boundary_loops if e in loop)
    assert {a, b, e, f} <= set(rim.tolist())
    flipped, count = flip_chords(ears, [rim])
    assert count == 2
    assert np.isin(flipped.edges.points, [a, b, e, f]).all(axis=1).sum() == 3
    assert flipped.is_manifold
    assert flipped.is_oriented
    assert flipped.genus == 0
    assert sorted(map(len, flipped.boundary_loops)) == [30, 32]
    assert operators.signed_areas(flipped.points[:, :2], flipped.triangles).min() > 0


def test_edges_that_run_into_an_opening_of_the_map_get_a_point():
    """A path led along a rim leaves edges between the two that the outline of the opening is in the way of."""
    surface, seeds = seeds_on_rims()
    flat_map = flatten(surface, seeds)
    cut, held = flat_map.division.surface, np.zeros(len(flat_map.solution), bool)
    held[flat_map.constraints.ids] = True
    assert (~held[len(surface.points) :]).sum() == 2
    assert len(flat_map.freed_path_points) == 0
    assert flat_map.path_drift < 1e-12
    assert operators.signed_areas(flat_map.solution, cut.triangles).min() > 0
    assert len(flat_map.folded_triangles) == 0
    # The shape is the same, and each part lies in its triangle.
    area = np.bincount(flat_map.division.parent, cut.triangle_areas, len(flat_map.triangles))
    np.testing.assert_allclose(area, flat_map.surface.triangle_areas, rtol=1e-12)
    # There is nothing left to split.
    assert split_crossing(flat_map.division, flat_map.constraints) is flat_map.division


def seeds_on_rims():
    """A coarse phantom whose seeds of veins lie at their rims, 4 mm and more from the middle of the ostium."""
    made = make_phantom(600)
    return made.surface, moved(made.seeds, made.surface, 4.0, np.random.default_rng(7))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_no_chord_is_left_on_a_ragged_rim(seed):
    """Rims cut along triangles, without smoothing, have ears."""
    sphere = meshes.icosphere(40.0, 4)
    distance = np.linalg.norm(sphere.points[sphere.triangles].mean(axis=1) - sphere.points[700], axis=1)
    rng = np.random.default_rng(seed)
    while True:
        surface, _ = sphere.submesh(distance > 14 + 3 * rng.random(len(distance)))
        surface, _ = surface.submesh(surface.components == 0)
        if surface.is_manifold and len(surface.boundary_loops) == 1:
            break
    rim = surface.boundary_loops[0]
    before = np.isin(surface.edges.points, rim).all(axis=1) & (surface.edges.usage == 2)
    assert before.any(), "the test needs ears"
    flipped, count = flip_chords(surface, [rim])
    assert count >= before.sum()
    on_rim = np.isin(flipped.edges.points, rim).all(axis=1)
    assert (flipped.edges.usage[on_rim] == 1).all()
    assert sorted(flipped.boundary_loops[0].tolist()) == sorted(rim.tolist())
    assert flipped.is_manifold
    assert flipped.is_oriented


# ---- a flat disk with holes maps to itself ----


def disk_like_the_template(template, spacing=0.02):
    """The template itself as a surface of 100 mm across, in mm, with its holes open, and its own seeds."""
    rng = np.random.default_rng(0)
    fixed = []
    for opening in template.anatomy.openings:
        rim = template.rim(opening)
        for start, end in rim.arcs(template.anatomy.feet(opening)):
            count = max(4, round(rim.shape.arc_length(start, end) / spacing))
            fixed.append(rim.shape.at(np.linspace(start, end, count, endpoint=False)))
    for path in template.anatomy.paths:
        a, b = template.segment(path)
        count = max(3, round(np.linalg.norm(b - a) / spacing))
        fixed.append(a + np.linspace(0, 1, count + 1)[1:-1, None] * (b - a))
    fixed = np.concatenate(fixed)
    x, y = np.meshgrid(np.arange(-0.5, 0.5, spacing), np.arange(-0.5, 0.5, spacing * 0.87))
    x[1::2] += spacing / 2
    inner = np.column_stack([x.ravel(), y.ravel()]) + 0.05 * spacing * rng.standard_normal((x.size, 2))

    def in_domain(at, margin=0.0):
        inside = np.linalg.norm(at, axis=1) < 0.5 - margin
        for rim in template.holes.values():
            inside &= np.linalg.norm(at - rim.shape.centre, axis=1) > rim.shape.semi_axes[0] + margin
        return inside

    inner = inner[in_domain(inner, 0.3 * spacing)]
    inner = inner[np.linalg.norm(inner[:, None] - fixed[None], axis=2).min(axis=1) > 0.55 * spacing]
    flat = meshes.planar(np.concatenate([fixed, inner]), in_domain)
    part, _ = flat.submesh(np.ones(len(flat.triangles), bool))
    surface = Surface(100.0 * part.points, part.triangles)
    seeds = {hole: np.array([*template.holes[hole].shape.centre, 0.0]) * 100 for hole in template.anatomy.holes}
    for seed, path in zip(template.anatomy.outer_seeds, template.anatomy.outer_paths, strict=True):
        seeds[seed] = np.array([*template.outer.shape.at(template.outer.feet[path]), 0.0]) * 100
    return surface, seeds


def test_flat_disk_with_holes_maps_to_itself():
    template = Template.load("adapted1")
    # Feet at their own places, so that only the map itself is tested.
    template = dataclasses.replace(
        template, holes={k: dataclasses.replace(rim, spread_feet=False) for k, rim in template.holes.items()}
    )
    surface, seeds = disk_like_the_template(template)
    flat_map = flatten(surface, seeds, template, check_axes=False)
    ids = flat_map.surface.point_data["surface_point_id"]
    moved = np.linalg.norm(flat_map.points - surface.points[ids, :2] / 100.0, axis=1) / template.radius
    assert np.median(moved) < 0.005
    assert np.percentile(moved, 95) < 0.05
    assert flat_map.metrics["beta"]["median"] > 0.97
    # The same seeds on the disk seen from behind run the wrong way round.
    turned = {label: at * [-1, 1, 1] for label, at in seeds.items()}
    behind = Surface(surface.points * [-1, 1, 1], surface.triangles[:, ::-1])
    with pytest.raises(LAFlatteningError):
        flatten(behind, turned, template, check_axes=False)


def test_map_of_a_flat_disk_is_exact_when_its_rims_and_paths_are():
    """Solvers alone: coordinates are harmonic on a flat mesh and the identity has the least energy."""
    surface, _ = disk_like_the_template(Template.load("adapted1"))
    identity = surface.points[:, :2] / 100.0
    fixed = np.concatenate(surface.boundary_loops)
    flat, _ = harmonic(surface.laplacian, fixed, identity[fixed])
    assert np.abs(flat - identity).max() < 1e-9
    movable = np.ones(len(identity), bool)
    movable[fixed] = False
    assert np.abs(meshes.lowered(flat, surface, movable) - identity).max() < 1e-9


# ---- promises of the regional method ----


def check_promises(flat_map):
    metrics = flat_map.metrics
    assert metrics["folded_triangles"] == 0
    assert metrics["overlapping_pairs"] == 0
    assert metrics["rim_error"] < 1e-9
    if metrics["freed_path_points"] == 0:
        assert metrics["path_drift"] < 1e-9
    assert sorted(set(flat_map.regions.tolist())) == sorted(flat_map.template.anatomy.regions)
    assert len(flat_map.points) == len(flat_map.surface.points)


@pytest.mark.parametrize("points", [2000, 5000, 20000])
def test_phantom_maps_without_folds(points):
    phantom = make_phantom(points)
    check_promises(flatten(phantom.surface, phantom.seeds))


@pytest.mark.parametrize("template", ["adapted1", "adapted2", "population"])
def test_every_template_maps_without_folds(phantom, template):
    check_promises(flatten(phantom.surface, phantom.seeds, template))


def test_random_seeds_map_without_folds(phantom):
    flattener = Flattener(phantom.surface)
    closed = flattener.flatten(phantom.seeds).cavity.closed
    rng = np.random.default_rng(0)
    for _ in range(25):
        check_promises(flattener.flatten(moved(phantom.seeds, closed, 2.0, rng)))


def test_a_flattener_gives_what_a_fresh_one_gives(phantom, phantom_map):
    flattener = Flattener(phantom.surface)
    closed = phantom_map.cavity.closed
    flattener.flatten(moved(phantom.seeds, closed, 2.0, np.random.default_rng(1)))
    again = flattener.flatten(phantom.seeds)
    assert np.array_equal(again.points, phantom_map.points)


def test_regions_lie_in_their_places_on_the_map(phantom_map):
    from LAFlatteningLib.template import inside_polygon

    centre = phantom_map.points[phantom_map.triangles].mean(axis=1)
    for region in LEFT_ATRIUM.regions:
        outline = phantom_map.template.region_outline(region, step=0.5)
        mine = phantom_map.regions == region
        # Triangles that a path cuts count for their larger part: some have their centre beyond it.
        assert inside_polygon(centre[mine], outline).mean() > 0.98
        assert inside_polygon(centre[~mine], outline).mean() < 0.02
        # The pieces into which the paths cut them are all on their side.
        division, flat = phantom_map.division, phantom_map.solution
        pieces = label_regions(division, LEFT_ATRIUM) == region
        middle = flat[division.surface.triangles].mean(axis=1)
        shrunk = inside_polygon(middle[pieces], outline).mean()
        assert shrunk > 0.995 and inside_polygon(middle[~pieces], outline).mean() < 0.002


def test_patient_right_is_on_the_right_of_the_map(phantom, phantom_map):
    """The phantom is in LPS: x grows to the patient's left, z upwards. On the map, right is right and up is up."""
    posterior = phantom_map.regions == 5
    centre = phantom_map.points[phantom_map.triangles[posterior]].mean(axis=1)
    on_atrium = phantom_map.surface.points[phantom_map.triangles[posterior]].mean(axis=1)
    assert np.corrcoef(centre[:, 0], on_atrium[:, 0])[0, 1] < -0.9
    assert np.corrcoef(centre[:, 1], on_atrium[:, 2])[0, 1] > 0.8


def test_less_distortion_than_the_published_method(phantom, phantom_map):
    paper = flatten(phantom.surface, phantom.seeds, method="paper").metrics
    ours = phantom_map.metrics
    assert ours["beta"]["mean"] > paper["beta"]["mean"]
    assert ours["dilatation"]["p99"] < paper["dilatation"]["p99"]


# ---- result ----


def test_map_as_a_surface_keeps_the_contract(phantom, phantom_map):
    surface = phantom_map.to_surface()
    assert (surface.points[:, 2] == 0).all()
    assert np.linalg.norm(surface.points, axis=1).max() == pytest.approx(0.5)
    assert np.array_equal(surface.point_data["surface_point_id"], np.arange(len(phantom.surface.points)))
    assert np.array_equal(surface.point_data["LGE"], phantom.surface.point_data["LGE"])
    assert np.array_equal(surface.cell_data["true_region"], phantom.surface.cell_data["true_region"])
    assert set(surface.cell_data["region"].tolist()) == {1, 2, 3, 4, 5}
    assert surface.field_data["template"].tolist() == ["adapted1"]
    assert surface.field_data["method"].tolist() == ["regional"]
    assert surface.field_data["seed_labels"].tolist() == list(LEFT_ATRIUM.seeds)
    for label, at in zip(surface.field_data["seed_labels"], surface.field_data["seed_positions_mm"], strict=True):
        moved = np.linalg.norm(at - phantom.seeds[label])
        if label in LEFT_ATRIUM.outer_seeds:
            assert moved == pytest.approx(phantom_map.seeds.moved_mm[label], abs=1e-9)
        else:
            # The nearest place on the cover is no farther than its nearest point.
            assert moved <= phantom_map.seeds.moved_mm[label] + 1e-9


def test_metrics_hold_every_figure_and_are_json(phantom_map):
    import json

    metrics = json.loads(json.dumps(phantom_map.metrics))
    counts = {"points", "triangles", "folded_triangles", "overlapping_pairs", "flipped_edges"}
    assert counts | {"rim_error", "path_drift", "method", "template", "version"} <= set(metrics)
    assert set(metrics["alpha"]) == {"median", "p5", "p95", "entropy"}
    assert set(metrics["beta"]) == {"mean", "median", "p5"}
    assert set(metrics["dilatation"]) == {"median", "p99", "max"}
    assert {"cavity", "division", "solve", "untangle", "refine", "total"} <= set(metrics["seconds"])


def test_progress_is_told_and_can_cancel(phantom):
    told = []
    flatten(phantom.surface, phantom.seeds, progress=lambda share, text: told.append((share, text)))
    shares = [share for share, _ in told]
    assert shares == sorted(shares)
    assert shares[0] == 0.0
    assert shares[-1] == 1.0
    with pytest.raises(Cancelled):
        flatten(phantom.surface, phantom.seeds, progress=lambda share, text: share < 0.3)


def test_unknown_method_and_rounding_are_refused(phantom):
    with pytest.raises(ValueError, match='regional or paper; found "conformal"'):
        Flattener(phantom.surface, method="conformal")
    with pytest.raises(ValueError, match="half-even"):
        Flattener(phantom.surface, method="paper", rounding="up")


# ---- real atria ----


def case(data_dir, name):
    seeds = {"frf_demo": "seeds_operator1.csv", "pvi_gap": "seeds.csv"}[name]
    return read_surface(data_dir / name / "closed_ostia.vtp"), read_seeds(data_dir / name / seeds)


@pytest.mark.parametrize("name", ["frf_demo", "pvi_gap"])
def test_paper_method_agrees_with_the_published_map(data_dir, name):
    surface, seeds = case(data_dir, name)
    reference = read_surface(data_dir / name / "flat_reference.vtp")
    flat_map = flatten(surface, seeds, method="paper", rounding="half-even")
    assert np.array_equal(flat_map.triangles, reference.triangles)
    worst = np.linalg.norm(flat_map.points - reference.points[:, :2], axis=1).max() / 0.5
    assert worst < 1e-4
    cavity = read_surface(data_dir / name / "cavity.vtp")
    if "region" in cavity.cell_data:
        assert np.array_equal(flat_map.regions, cavity.cell_data["region"])
    assert len(flat_map.folded_triangles) == {"frf_demo": 44, "pvi_gap": 81}[name]


@pytest.mark.parametrize("name", ["frf_demo", "pvi_gap"])
def test_seed_paths_are_the_published_ones(data_dir, name):
    folder = data_dir / name / "paths"
    if not folder.is_dir():
        pytest.skip(f"no published paths for {name}")
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy

    surface, seeds = case(data_dir, name)
    flat_map = flatten(surface, seeds, method="paper")
    for path, walk in flat_map.division.walks.items():
        reader = vtk.vtkXMLPolyDataReader()
        reader.SetFileName(str(folder / f"{path}.vtp"))
        reader.Update()
        published = vtk_to_numpy(reader.GetOutput().GetPoints().GetData())
        ours = walk.positions
        assert len(published) == len(ours)
        assert np.linalg.norm(published[:, None] - ours[None], axis=2).min(axis=1).max() < 1e-4


@pytest.mark.parametrize("name", ["frf_demo", "pvi_gap"])
def test_regional_on_real_atria(data_dir, name):
    surface, seeds = case(data_dir, name)
    flattener = Flattener(surface)
    flat_map = flattener.flatten(seeds)
    check_promises(flat_map)
    assert flat_map.metrics["freed_path_points"] == 0
    published = read_surface(data_dir / name / "flat_reference.vtp").points[:, :2]
    points = flat_map.surface.points
    beta = distortion.isotropy(points, flat_map.triangles, flat_map.points).mean()
    assert beta > distortion.isotropy(points, flat_map.triangles, published).mean()
    rng = np.random.default_rng(7)
    for _ in range(5):
        check_promises(flattener.flatten(moved(seeds, flat_map.cavity.closed, 2.0, rng)))


def test_open_real_cavity_is_covered_and_mapped(data_dir):
    surface = read_surface(data_dir / "frf_demo" / "cavity.vtp")
    open_cavity = Surface(surface.points, surface.triangles)
    seeds = read_seeds(data_dir / "frf_demo" / "seeds_operator1.csv")
    ours = flatten(open_cavity, seeds)
    check_promises(ours)
    covered, _ = case(data_dir, "frf_demo")
    theirs = flatten(covered, seeds)
    # Another cover lets paths leave the ostium elsewhere; the map stays the same map.
    apart = np.linalg.norm(ours.points - theirs.points, axis=1) / 0.5
    assert np.median(apart) < 0.06


def test_second_operator_on_the_same_patient(data_dir):
    surface = read_surface(data_dir / "frf_demo" / "closed_ostia_operator2.vtp")
    check_promises(flatten(surface, read_seeds(data_dir / "frf_demo" / "seeds_operator2.csv")))


def test_real_seeds_swapped_and_mirrored_are_refused(data_dir):
    surface, seeds = case(data_dir, "frf_demo")
    swapped = {**seeds, "LSPV": seeds["LIPV"], "LIPV": seeds["LSPV"]}
    with pytest.raises(LAFlatteningError, match=r"L[IS]PV and L[IS]PV look swapped"):
        flatten(surface, swapped)
    flip = np.array([1.0, 1.0, -1.0])
    mirrored = Surface(surface.points * flip, surface.triangles, surface.point_data)
    with pytest.raises(LAFlatteningError, match="mirrored"):
        flatten(mirrored, {label: at * flip for label, at in seeds.items()})


def with_slivers(surface, count):
    """The surface with points all but on edges that are inside it, so that each has two slivers."""
    inner = np.flatnonzero(surface.edges.usage == 2)
    on_rim = np.zeros(len(surface.points), bool)
    for loop in surface.boundary_loops:
        on_rim[loop] = True
    inner = inner[~on_rim[surface.edges.points[inner]].any(axis=1)]
    points, triangles, used = surface.points, [list(t) for t in surface.triangles.tolist()], set()
    for edge in np.random.default_rng(0).permutation(inner):
        sides = surface.edges.triangles[edge].tolist()
        if used.intersection(sides):
            continue
        used.update(sides)
        a, b = surface.edges.points[edge].tolist()
        for side in sides:
            corners = triangles[side]
            k = next(k for k in range(3) if {corners[k], corners[(k + 1) % 3]} == {a, b})
            first, second, third = corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]
            triangles[side] = [len(points), second, third]
            triangles.append([first, len(points), third])
        points = np.concatenate([points, [points[a] + 1e-3 * (points[b] - points[a])]])
        if len(used) >= 2 * count:
            break
    return Surface(points, np.array(triangles))


def test_a_map_goes_from_process_to_process_and_cannot_be_changed(phantom, phantom_map):
    made = Flattener(phantom.surface)
    flat_map = made.flatten(phantom.seeds)
    for other in (pickle.loads(pickle.dumps(flat_map)), copy.deepcopy(flat_map)):
        assert np.array_equal(other.points, flat_map.points)
        assert other.metrics["beta"] == flat_map.metrics["beta"]
    # Quick maps begin from the last one.
    with pytest.raises(ValueError, match="read-only"):
        flat_map.points[:] *= 1.2


def test_notes_say_what_to_look_at(phantom, phantom_map):
    assert phantom_map.notes == ()
    paper = flatten(phantom.surface, phantom.seeds, method="paper")
    assert len(paper.folded_triangles) > 0
    assert any("folded" in note for note in paper.notes)
    squashed = dataclasses.replace(phantom_map, solution=phantom_map.solution * [1.0, 0.02])
    assert any("stretched more than usual" in note for note in squashed.notes)
    # Slivers along a few edges are no misplaced seeds.
    slivers = flatten(with_slivers(phantom.surface, 60), phantom.seeds)
    assert slivers.distortion_summary["dilatation"]["p99"] > 20.0
    assert [note[:29] for note in slivers.notes] == ["The mesh has thin triangles, "]
    freed = dataclasses.replace(phantom_map, freed_path_points=np.array([3, 4]))
    assert any("2 path points had to leave their lines" in note for note in freed.notes)
    assert freed.metrics["notes"] == list(freed.notes)


def test_outer_seeds_that_all_but_meet_are_noted(phantom, phantom_map):
    rim = phantom_map.surface.points[phantom_map.cavity.outer]
    at = int(np.linalg.norm(rim - phantom.seeds["MV2"], axis=1).argmin())
    step = 1 if np.dot(rim[at - 5] - rim[at], phantom.seeds["MV1"] - rim[at]) < 0 else -1
    beside = rim[at] + 0.3 * (rim[(at + step) % len(rim)] - rim[at]) / np.linalg.norm(
        rim[(at + step) % len(rim)] - rim[at]
    )
    notes = " ".join(flatten(phantom.surface, {**phantom.seeds, "MV2": rim[at], "MV1": beside}).notes)
    assert re.search(r"MV\d and MV\d are 0.3 mm apart along the MV rim", notes)
    assert re.search(r"An edge of the rim of MV spans \d\d degrees", notes)
    assert "apart" not in " ".join(phantom_map.notes)
    assert "spans" not in " ".join(phantom_map.notes)


def test_the_widest_edge_of_a_rim_is_that_of_a_polygon(phantom_map):
    opening, degrees = phantom_map.widest_rim_edge
    turns = {}
    for name, loop in phantom_map.division.loops.items():
        off = phantom_map.solution[loop] - np.array(phantom_map.template.rim(name).shape.centre)
        angle = np.unwrap(np.arctan2(*off.T[::-1]))
        turns[name] = np.degrees(
            np.abs(np.diff(np.append(angle, angle[0] + np.sign(angle[-1] - angle[0]) * 2 * np.pi))).max()
        )
    assert turns[opening] == max(turns.values())
    # A chord is a little shorter than its arc.
    assert degrees == pytest.approx(turns[opening], rel=0.03)


def test_rim_error_and_path_drift_measure_what_they_say(phantom_map):
    moved = phantom_map.solution.copy()
    loop = phantom_map.division.loops["LAA"]
    centre = np.array(phantom_map.template.holes["LAA"].shape.centre)
    moved[loop[3]] = centre + 1.1 * (moved[loop[3]] - centre)
    point = phantom_map.constraints.path_ids[5]
    moved[point] += [0.0, 0.01]
    other = dataclasses.replace(phantom_map, solution=moved)
    # A tenth of the hole's radius .0405, in disk radii of .5.
    assert other.rim_error == pytest.approx(0.1 * 0.0405 / 0.5)
    assert other.path_drift == pytest.approx(0.01 / 0.5)


def test_paths_that_meet_do_not_break_the_paper_method(phantom):
    from LAFlatteningLib.constraints import constraints_by_count

    flat_map = flatten(phantom.surface, phantom.seeds, method="paper")
    paths = dict(flat_map.division.paths)
    # Lead s7 over a point of s2.
    shared = int(paths["s2"][len(paths["s2"]) // 2])
    paths["s7"] = np.insert(paths["s7"], 3, shared)
    division = dataclasses.replace(flat_map.division, paths=paths)
    constraints = constraints_by_count(division, flat_map.template, as_printed=True)
    assert len(np.unique(constraints.ids)) == len(constraints.ids)


def test_a_fold_left_over_is_an_error_not_a_map(phantom, monkeypatch):
    import LAFlatteningLib.flattening.flattener as module
    from LAFlatteningLib.errors import FoldError

    def folding(self, flat, *_, **__):
        worse = flat.copy()
        worse[np.argmin(np.linalg.norm(flat, axis=1))] += 0.2
        return worse

    monkeypatch.setattr(module.Refinement, "lower", folding)
    monkeypatch.setattr(module.Refinement, "guard", lambda self, flat, *_: (flat, np.zeros(0, np.int64)))
    with pytest.raises(FoldError, match=r"stay folded on the map; the first is at .* mm") as caught:
        flatten(phantom.surface, phantom.seeds)
    assert caught.value.points


@pytest.mark.parametrize("what", ["singular", "folded"])
def test_a_start_that_is_of_no_use_is_left_out(what, monkeypatch):
    import LAFlatteningLib.flattening.flattener as module
    from LAFlatteningLib.errors import FoldError

    phantom = make_phantom(3000)
    usual = flatten(phantom.surface, phantom.seeds)
    follow, untangle = module.Refinement.follow, module.untangle
    followed = []

    def failing(self, flat, placed):
        followed.append(len(flat))
        if what == "singular":
            raise np.linalg.LinAlgError("singular")
        return follow(self, flat, placed)

    def refusing(*arguments):
        if len(followed) == 1 and what == "folded":
            followed.append(0)
            raise FoldError("folds stay")
        return untangle(*arguments)

    monkeypatch.setattr(module.Refinement, "follow", failing)
    monkeypatch.setattr(module, "untangle", refusing)
    flat_map = flatten(phantom.surface, phantom.seeds)
    assert followed
    # The minimum is the same, from wherever it is reached.
    assert np.abs(flat_map.points - usual.points).max() < 1e-6


def test_path_points_are_freed_where_every_other_start_fails(phantom, monkeypatch):
    import LAFlatteningLib.flattening.flattener as module
    from LAFlatteningLib.errors import FoldError

    untangle, calls = module.untangle, []
    phantom = make_phantom(3000)

    def freeing(flat, triangles, points, fixed, loose):
        if len(triangles) < 3000:
            return untangle(flat, triangles, points, fixed, loose)
        calls.append(len(triangles))
        if len(calls) > 1:
            raise FoldError("folds stay")
        return untangle(flat, triangles, points, fixed, loose)[0], np.flatnonzero(loose)[:3]

    monkeypatch.setattr(module, "untangle", freeing)
    flat_map = flatten(phantom.surface, phantom.seeds)
    assert len(calls) == 2
    assert len(flat_map.freed_path_points) == 3
    assert not len(flat_map.folded_triangles)


@pytest.mark.parametrize("how", ["marked", "ignored"])
def test_unknown_axes_hold_for_the_coarse_copy_too(how, monkeypatch):
    """An atrium in other axes: its map begins with that of the copy, and quick maps are of the copy."""
    phantom = make_phantom(3000)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    surface = Surface(phantom.surface.points @ turn.T, phantom.surface.triangles)
    seeds = {label: turn @ place for label, place in phantom.seeds.items()}
    with pytest.raises(LAFlatteningError, match="By the axes of the surface"):
        flatten(surface, seeds)
    made = Flattener(surface.with_unknown_axes()) if how == "marked" else Flattener(surface, check_axes=False)
    started = []
    follow = refinement.Refinement.follow
    monkeypatch.setattr(
        refinement.Refinement, "follow", lambda self, *given: started.append(len(given[0])) or follow(self, *given)
    )
    flat_map = made.flatten(seeds)
    assert max(started) >= len(surface.points)
    assert np.abs(made.preview(seeds).points - flat_map.points).max() < 1e-9


def test_flips_are_counted():
    """A rim with an ear: one flip, told in the metrics."""
    phantom = make_phantom(2000)
    surface = phantom.surface
    loop = surface.boundary_loops[2]
    a, b, c = (int(i) for i in loop[[0, 1, 2]])
    tip = surface.points[[a, b]].mean(axis=0) + 0.3 * (surface.points[loop].mean(axis=0) - surface.points[a]) / 5.0
    with_ear = Surface(
        np.concatenate([surface.points, [tip]]), np.concatenate([surface.triangles, [[b, a, len(surface.points)]]])
    )
    assert c != a
    flat_map = flatten(with_ear, phantom.seeds)
    assert flat_map.flipped_edges == flat_map.metrics["flipped_edges"] == 1
    check_promises(flat_map)


def test_seeds_of_another_rim_rebuild_the_cavity(phantom):
    flattener = Flattener(phantom.surface)
    flattener.flatten(phantom.seeds)
    rim = phantom.surface.boundary_loops[-1]
    crowd = {f"MV{k + 1}": phantom.surface.points[rim[k * len(rim) // 4]] for k in range(4)}
    with pytest.raises(LAFlatteningError):
        flattener.flatten({**phantom.seeds, **crowd})
    assert np.isfinite(flattener.flatten(phantom.seeds).points).all()


@pytest.mark.parametrize("name", ["ct_shape_model_1"])
def test_regional_on_a_ct_atrium(data_dir, name):
    surface = read_surface(data_dir / "labelled" / f"{name}.vtp")
    check_promises(flatten(surface, seeds_by_rule(surface)))


def between_rims(fourth_rim=None):
    """Two triangles between two rims: points 0 and 1 on one, 2 on the other; 3 lies beyond the edge 1-2."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1, 0], [1.5, 1, 0]])
    surface = Surface(points, np.array([[0, 1, 2], [1, 3, 2]]))
    rims = [np.array([0, 1] + [3] * (fourth_rim == 0)), np.array([2] + [3] * (fourth_rim == 1))]
    return surface, rims, SimpleNamespace(surface=surface, parent=np.arange(2))


@pytest.mark.parametrize("fourth_rim", [None, 0, 1])
def test_an_edge_between_rims_is_flipped_where_the_template_folds_its_triangle(fourth_rim):
    surface, rims, division = between_rims(fourth_rim)
    ids = np.unique(np.concatenate(rims))
    as_it_is = SimpleNamespace(rim_ids=ids, rim_targets=surface.points[ids, :2])
    assert flip_folded(surface, rims, division, as_it_is) == (surface, 0)
    # The third point goes below the side 0-1.
    placed = np.array([[0.0, 0], [1, 0], [0.5, -1], [1.5, 1]])
    flipped, count = flip_folded(surface, rims, division, SimpleNamespace(rim_ids=ids, rim_targets=placed[ids]))
    if fourth_rim is not None:
        # The other diagonal would be a chord of the first rim, or another folded triangle between the two.
        assert flipped is surface and count == 0
    else:
        assert count == 1
        assert {frozenset(t) for t in flipped.triangles.tolist()} == {frozenset((0, 1, 3)), frozenset((0, 2, 3))}


def test_rims_a_triangle_apart_on_a_coarse_atrium(data_dir):
    """500 points: a triangle spans the carina of the left veins from rim to rim, and the template folds it."""
    seeds = read_seeds(data_dir / "frf_demo" / "seeds_operator1.csv")
    cavity = flatten(read_surface(data_dir / "frf_demo" / "closed_ostia.vtp"), seeds).cavity.surface
    flat_map = flatten(remesh(cavity, 500).surface, seeds)
    assert flat_map.flipped_edges == 1
    check_promises(flat_map)
    assert operators.signed_areas(flat_map.points, flat_map.triangles).min() > 0.0


@pytest.mark.parametrize("rounds", [1, 2])
def test_the_division_is_that_of_the_surface_even_where_flips_do_not_end(phantom, monkeypatch, rounds):
    import LAFlatteningLib.flattening.flattener as module

    def always(surface, *_):
        return surface.with_triangles(surface.triangles[::-1]), 1

    monkeypatch.setattr(module, "FLIPS", rounds)
    monkeypatch.setattr(module, "flip_folded", always)
    flat_map = flatten(phantom.surface, phantom.seeds)
    parent = flat_map.division.parent
    whole = np.bincount(parent)[parent] == 1
    cut = flat_map.division.surface.triangles
    assert np.array_equal(cut[whole], flat_map.surface.triangles[parent[whole]])
    assert flat_map.flipped_edges == rounds
    check_promises(flat_map)
