"""The map lowered part by part is the map lowered as a whole."""

import meshes
import numpy as np
import pytest

from LAFlatteningLib import Flattener, FoldError, flatten, make_phantom, operators
from LAFlatteningLib.division import label_regions
from LAFlatteningLib.flattening import refinement
from LAFlatteningLib.flattening.parts import movable_parts
from LAFlatteningLib.solvers import harmonic
from LAFlatteningLib.surface import Surface


def test_parts_are_what_no_triangle_joins(phantom_map, monkeypatch):
    """On the cut surface of the phantom: the regions, each without its rims and paths."""
    monkeypatch.setattr("LAFlatteningLib.flattening.parts.SMALLEST", 0)
    division = phantom_map.division
    triangles = division.surface.triangles
    movable = np.ones(len(division.surface.points), bool)
    movable[phantom_map.constraints.ids] = False
    number = movable_parts(division.surface.edges.points, movable)
    assert ((number >= 0) == movable).all()
    corners, parts = movable[triangles], int(number.max()) + 1
    sizes = np.bincount(number[movable])
    assert (sizes > 0).all() and (np.diff(sizes) <= 0).all()
    of_corner = number[triangles]
    # All movable corners of a triangle belong to one part, and a part to one region.
    low = np.where(corners, of_corner, parts).min(axis=1)
    assert (low[corners.any(axis=1)] == of_corner.max(axis=1)[corners.any(axis=1)]).all()
    region = label_regions(division, phantom_map.template.anatomy)
    for k in range(parts):
        assert len(np.unique(region[(of_corner == k).any(axis=1)])) == 1
    assert {int(region[(of_corner == k).any(axis=1)][0]) for k in range(parts)} == {1, 2, 3, 4, 5}


def test_small_parts_are_put_together():
    # Two edges far apart: a point of each may move.
    edges = np.array([[0, 1], [2, 3]])
    movable = np.array([True, False, True, False])
    assert movable_parts(edges, movable).tolist() == [0, -1, 0, -1]


@pytest.mark.parametrize("hessians", [True, False])
def test_part_by_part_is_the_minimum_of_the_whole(phantom, monkeypatch, hessians):
    if not hessians:
        monkeypatch.setattr(refinement, "MOST_FOR_HESSIAN", 0)
    monkeypatch.setattr(refinement, "BY_PARTS", 10**9)
    whole = flatten(phantom.surface, phantom.seeds)
    monkeypatch.setattr(refinement, "BY_PARTS", 0)
    by_parts = flatten(phantom.surface, phantom.seeds)
    apart = np.abs(by_parts.points - whole.points).max() / whole.template.radius
    # Both end once a step of the exact Hessian is below 1e-8, of the approximation below 2e-4.
    assert 0.0 < apart < (1e-7 if hessians else 2e-3)
    assert not len(by_parts.folded_triangles)


def turned_ring(turn):
    """A ring, which of its points are held (its rims), and a map of it whose inner rim is turned, radians."""
    surface = meshes.annulus(20.0, 50.0, 24, 120)
    held = np.zeros(len(surface.points), bool)
    held[np.concatenate(surface.boundary_loops)] = True
    placed = surface.points[:, :2].copy()
    inner = held & (np.linalg.norm(placed, axis=1) < 30.0)
    placed[inner] = placed[inner] @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]).T
    flat, _ = harmonic(surface.laplacian, np.flatnonzero(held), placed[held])
    return surface, held, flat


def test_guarded_triangles_are_unfolded_and_the_rest_is_left_alone():
    """A ring whose rims are turned against each other: triangles of three points far apart fold over, those of the mesh
    do not."""
    surface, held, flat = turned_ring(-0.6)
    shear = refinement.Refinement(flat, surface, ~held, 1.0)
    flat = shear.lower(flat)
    # Narrow ones across the ring, near its side of positive x.
    at = surface.points[:, :2]
    radius, side = np.linalg.norm(at, axis=1), np.abs(np.arctan2(at[:, 1], at[:, 0])) < 0.15
    rings = [np.flatnonzero(side & (np.abs(radius - r) < 0.7)) for r in (23.0, 36.0, 28.0)]
    triples = np.stack(np.meshgrid(*rings), axis=-1).reshape(-1, 3)
    narrow = (operators.signed_areas(at, triples) > 0.5) & (operators.signed_areas(flat, triples) < 0.0)
    guarded = triples[narrow][:2]
    assert (operators.signed_areas(at, guarded) > 0).all()
    assert len(guarded) == 2
    loose = np.zeros_like(held)
    mended, freed = shear.guard(flat, guarded, held, loose)
    assert not len(freed)
    assert operators.signed_areas(mended, guarded).min() > 0.0
    assert operators.signed_areas(mended, surface.triangles).min() > 0.0
    moved = (mended != flat).any(axis=1)
    assert moved.any() and not moved[held].any()
    assert np.linalg.norm(at[moved] - [28.0, 0.0], axis=1).max() < 20.0
    # Nothing to do a second time, for none is all but folded.
    again, _ = shear.guard(mended, guarded, held, loose)
    assert np.abs(again - mended).max() < 0.05
    untouched, _ = shear.guard(flat, surface.triangles[:5], held, loose)
    assert untouched is flat
    none, _ = shear.guard(flat, np.zeros((0, 3), np.int64), held, loose)
    assert none is flat


def test_guarded_triangles_that_are_all_but_folded_weigh_a_hundredth():
    """One that does not fold, and that the mesh may pull: its patch ends at the minimum of the printed energy."""
    surface, held, flat = turned_ring(-0.9)
    refined = refinement.Refinement(flat, surface, ~held, 1.0)
    flat = refined.lower(flat)
    at = surface.points[:, :2]
    side = np.flatnonzero(~held & (np.abs(np.arctan2(at[:, 1], at[:, 0])) < 0.15))[::2]
    triples = np.stack(np.meshgrid(side, side, side), axis=-1).reshape(-1, 3)
    triples = triples[(operators.signed_areas(at, triples) > 5.0) & (operators.signed_areas(flat, triples) > 0.1)]
    # (Slivers count as wider than they are.)
    longest = np.linalg.norm(at[triples] - at[np.roll(triples, 1, axis=1)], axis=2).max(axis=1)
    triples = triples[2.0 * operators.signed_areas(at, triples) > 0.2 * longest**2]
    guarded = triples[spread(at, flat, triples) > 7.0][:1]
    assert len(guarded) == 1
    mended, freed = refined.guard(flat, guarded, held, np.zeros_like(held))
    assert not len(freed)
    assert 5.0 < spread(at, mended, guarded)[0] < spread(at, flat, guarded)[0]

    def energy(places):
        distortion = spread(at, places, surface.triangles)
        ratio = operators.signed_areas(places, surface.triangles) / operators.signed_areas(at, surface.triangles)
        own = operators.signed_areas(at, surface.triangles) @ (distortion**2 + 0.4 * (ratio + 1.0 / ratio))
        excess = np.maximum(spread(at, places, guarded) - 5.0, 0.0)
        return own + 0.01 * operators.signed_areas(at, guarded) @ excess**2

    for point in guarded[0]:
        for axis in np.eye(2):
            step = 1e-3 * axis * (np.arange(len(at)) == point)[:, None]
            slope, before = (energy(places + step) - energy(places - step) for places in (mended, flat))
            assert abs(slope) < 1e-3 * abs(before)


def test_triangles_that_paths_cut_do_not_fold(monkeypatch):
    """On a mesh of long edges some would, for paths bend the map within them; without the guard, none is returned."""
    made = make_phantom(700)
    moved = [np.random.default_rng(number).normal(0.0, 3.0, (len(made.seeds), 3)) for number in (8, 42, 47)]
    sets = [dict(zip(made.seeds, np.array([*made.seeds.values()]) + by, strict=True)) for by in moved]
    flattener = Flattener(made.surface)
    for seeds in sets:
        flat_map = flattener.flatten(seeds)
        assert operators.signed_areas(flat_map.points, flat_map.surface.triangles).min() > 0.0
    monkeypatch.setattr(refinement.Refinement, "guard", lambda _, flat, *__: (flat, np.zeros(0, np.int64)))
    folded = 0
    for seeds in sets:
        try:
            flattener.flatten(seeds)
        except FoldError:
            folded += 1
    assert folded, "the test needs a triangle that folds"


def spread(at, flat, triangles):
    """(K + 1/K)/2 of triangles of a plane (n, 2) on a map of it, by their singular values."""
    here, there = (
        np.stack([p[triangles[:, 1]] - p[triangles[:, 0]], p[triangles[:, 2]] - p[triangles[:, 0]]], axis=2)
        for p in (at, flat)
    )
    sigma = np.linalg.svd(there @ np.linalg.inv(here), compute_uv=False)
    return 0.5 * (sigma[:, 0] / sigma[:, 1] + sigma[:, 1] / sigma[:, 0])


def test_points_are_held_where_the_map_has_them(monkeypatch):
    """Not where another map had them, of which a refinement was made: path points may have been freed since."""
    monkeypatch.setattr(refinement, "BY_PARTS", 0)
    surface, held, straight = turned_ring(0.0)
    _, _, turned = turned_ring(-0.3)
    refined = refinement.Refinement(straight, surface, ~held, 1.0)
    expected = refinement.Refinement(turned, surface, ~held, 1.0).lower(turned)
    assert np.abs(refined.lower(turned) - expected).max() < 1e-6
    # And back again: the points between follow from where they are, not from another map.
    moved = refined.follow(straight, straight)
    assert np.abs(moved - straight).max() < 1e-9


def test_points_without_triangles_stay_where_they_are(monkeypatch):
    monkeypatch.setattr(refinement, "BY_PARTS", 0)
    surface, held, flat = turned_ring(-0.2)
    more = Surface(np.concatenate([surface.points, [[80.0, 0.0, 0.0]]]), surface.triangles)
    start, movable = np.concatenate([flat, [[3.0, 4.0]]]), np.append(~held, True)
    lowered = refinement.Refinement(start, more, movable, 1.0).lower(start)
    assert lowered[-1].tolist() == [3.0, 4.0]
    expected = refinement.Refinement(flat, surface, ~held, 1.0).lower(flat)
    assert np.abs(lowered[:-1] - expected).max() < 1e-6
    # Also where they are all that may move.
    alone = refinement.Refinement(start, more, np.arange(len(start)) == len(flat), 1.0)
    assert (alone.lower(start) == start).all()
