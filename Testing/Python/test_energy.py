"""The energy against folding: its derivative, its minimum, and that steps never fold a map."""

from functools import partial

import meshes
import numpy as np
import pytest

from LAFlatteningLib import distortion, operators
from LAFlatteningLib.errors import FoldError
from LAFlatteningLib.flattening import refinement
from LAFlatteningLib.flattening.descent import descend
from LAFlatteningLib.flattening.energy import AREA, GUARDED_FROM, PatchEnergy, rest_shapes
from LAFlatteningLib.flattening.untangling import untangle


def ring():
    surface = meshes.annulus(20.0, 50.0, 10, 60)
    fixed = np.zeros(len(surface.points), bool)
    for loop in surface.boundary_loops:
        fixed[loop] = True
    return surface, fixed


def energy_of(surface, flat, movable):
    return PatchEnergy(flat, surface.triangles, rest_shapes(surface.points, surface.triangles, 1.0), movable)


@pytest.mark.parametrize("eps", [0.5, 0.05, 0.0])
def test_gradient_is_that_of_finite_differences(eps):
    surface, fixed = ring()
    rng = np.random.default_rng(0)
    flat = surface.points[:, :2] + (2.0 if eps else 0.3) * rng.standard_normal((len(surface.points), 2))
    energy = energy_of(surface, flat, ~fixed)
    at = energy.start()
    # Untangling must cover folded triangles; the distortion is for maps without.
    assert (energy.determinants(at) < 0).any() == bool(eps)
    function = partial(energy.untangling, eps=eps) if eps else energy.distortion
    _, gradient = function(at)
    for _ in range(5):
        direction = rng.standard_normal(at.shape)
        step = 1e-6
        ahead = function(at + step * direction)[0]
        behind = function(at - step * direction)[0]
        assert (ahead - behind) / (2 * step) == pytest.approx((gradient * direction).sum(), rel=1e-4)


@pytest.mark.parametrize("ordered", [False, True])
@pytest.mark.parametrize("guards", [0, 400])
def test_hessian_is_that_of_finite_differences(ordered, guards):
    """Also with triangles that are only guarded: these count only where they are far from their shape."""
    surface, fixed = ring()
    rng = np.random.default_rng(0)
    flat = surface.points[:, :2] + 0.02 * rng.standard_normal((len(surface.points), 2))
    rest = rest_shapes(surface.points, surface.triangles, 1.0)
    order = rng.permutation(int((~fixed).sum())) if ordered else None
    if guards:
        # Some triangles once more, half of them with another shape.
        again = rest[-guards:] * np.where(np.arange(guards) % 2, 12.0, 1.0)[:, None] ** [1, 1, 0]
        triangles = np.concatenate([surface.triangles, surface.triangles[-guards:]])
        energy = PatchEnergy(flat, triangles, np.concatenate([rest, again]), ~fixed, guards=guards)
    else:
        edges = surface.edges.of_triangle
        energy = PatchEnergy(flat, surface.triangles, rest, ~fixed, surface.triangle_areas, mesh_edges=edges)
    at = energy.start()
    if guards:
        beyond = energy.mips(at)[-guards:] > GUARDED_FROM
        assert beyond.any() and not beyond.all()
    hessian = energy.hessian(at, order)
    for _ in range(3):
        direction = rng.standard_normal(at.shape)
        step = 1e-6
        change = (energy.distortion(at + step * direction)[1] - energy.distortion(at - step * direction)[1]) / (
            2 * step
        )
        # The factorisation solves with the Hessian: what it makes of the change must be the direction.
        assert np.abs(hessian.solve(change) - direction).max() < 1e-3 * np.abs(direction).max()


def test_guarded_triangles_do_not_count_while_they_keep_their_shape():
    surface, fixed = ring()
    flat = surface.points[:, :2] * [1.5, 1.0]
    rest = rest_shapes(surface.points, surface.triangles, 1.0)
    guarded = PatchEnergy(flat, surface.triangles, rest, ~fixed, guards=100)
    value, _ = guarded.distortion(guarded.start())
    alone = PatchEnergy(flat, surface.triangles[:-100], rest[:-100], ~fixed)
    assert value == pytest.approx(alone.distortion(alone.start())[0])


def test_variables_follow_held_points_that_move_and_turn():
    surface, fixed = ring()
    flat = surface.points[:, :2]
    turned = flat @ np.array([[0.8, -0.6], [0.6, 0.8]]) + [3.0, 1.0]
    rest = rest_shapes(surface.points, surface.triangles, 1.0)
    energy = PatchEnergy(flat, surface.triangles, rest, ~fixed, surface.triangle_areas)
    variables, _ = energy.follow(energy.start(), np.where(fixed[:, None], turned, 0.0))
    # On an undistorted map weighted by area the stand-in is a Laplacian, for which a rigid motion is harmonic. (Nearly:
    # obtuse triangles count as right-angled ones.)
    assert np.abs(variables - turned[energy.ids]).max() < 0.01 * np.abs(turned - flat).max()
    assert energy.mips(variables).max() < 1.001


def test_points_in_one_place_of_a_start_do_no_harm():
    """A coarse map may put all corners of several triangles in one place; the weights there must stay numbers, and of
    use."""
    surface, fixed = ring()
    flat = surface.points[:, :2].copy()
    collapsed = ~fixed & (np.linalg.norm(flat - [35.0, 0.0], axis=1) < 12.0)
    assert collapsed[surface.triangles].all(axis=1).any()
    flat[collapsed] = [35.0, 0.0]
    rest = rest_shapes(surface.points, surface.triangles, 1.0)
    energy = PatchEnergy(flat, surface.triangles, rest, ~fixed, surface.triangle_areas)
    variables, solver = energy.follow(energy.start(), flat)
    assert np.isfinite(variables).all()
    assert np.isfinite(solver.solve(np.ones((len(energy.ids), 2)))).all()
    flat[energy.ids] = variables
    loose = np.zeros(len(flat), bool)
    untangled, freed = untangle(flat, surface.triangles, surface.points, fixed, loose)
    assert (operators.signed_areas(untangled, surface.triangles) > 0.0).all()
    assert not len(freed)


def test_a_map_is_taken_to_its_minimum():
    surface, fixed = ring()
    flat = surface.points[:, :2].copy()
    # The inner rim is turned against the outer one.
    inner = fixed & (np.linalg.norm(flat, axis=1) < 30.0)
    turn = np.array([[np.cos(0.2), -np.sin(0.2)], [np.sin(0.2), np.cos(0.2)]])
    flat[inner] = flat[inner] @ turn.T
    low = meshes.lowered(flat, surface, ~fixed)
    scale = np.sqrt(operators.triangle_areas(flat, surface.triangles).sum() / surface.area)
    rest = rest_shapes(surface.points, surface.triangles, float(scale))
    energy = PatchEnergy(low, surface.triangles, rest, ~fixed, surface.triangle_areas / surface.triangle_areas.mean())
    left = energy.hessian(energy.start()).solve(energy.distortion(energy.start())[1])
    assert np.abs(left).max() < 1e-8 * 50.0


def test_steps_go_on_until_the_minimum_is_reached(monkeypatch):
    """Where Hessians are of no use yet, others follow, as often as it takes."""
    surface, fixed = ring()
    angle = np.linalg.norm(surface.points[:, :2], axis=1) / 50.0
    turned = surface.points[:, :2].copy()
    turned[~fixed] += 2.0 * np.stack([np.sin(9.0 * angle), np.cos(7.0 * angle)], axis=1)[~fixed]
    by_hessians, calls = refinement._by_hessians, []

    def late(energy, variables, order, still):
        calls.append(len(variables))
        if len(calls) <= 2:
            return refinement._Settled(variables, False)
        return by_hessians(energy, variables, order, still)

    monkeypatch.setattr(refinement, "_by_hessians", late)
    found = refinement.Refinement(turned, surface, ~fixed, 1.0).lower(turned)
    assert len(calls) >= 3
    # The flat ring itself is the minimum.
    assert np.abs(found - surface.points[:, :2]).max() < 1e-5


def test_the_identity_is_a_minimum():
    surface, fixed = ring()
    energy = energy_of(surface, surface.points[:, :2], ~fixed)
    value, gradient = energy.distortion(energy.start())
    # Per triangle (tr(I) / 2)^2 + AREA * 2.
    assert value == pytest.approx(len(surface.triangles) * (1 + 2 * AREA), rel=1e-9)
    assert np.abs(gradient).max() < 1e-9


def test_folded_maps_have_infinite_energy_without_regularisation():
    surface, fixed = ring()
    flat = surface.points[:, :2].copy()
    flat[~fixed] *= -1
    energy = energy_of(surface, flat, ~fixed)
    assert energy.distortion(energy.start())[0] == np.inf


def test_descent_returns_to_the_identity_without_folding_on_the_way():
    surface, fixed = ring()
    rng = np.random.default_rng(1)
    identity = surface.points[:, :2]
    flat = identity + np.where(fixed[:, None], 0, 0.5) * rng.standard_normal(identity.shape)
    assert len(distortion.folded_triangles(flat, surface.triangles)) == 0
    energy = energy_of(surface, flat, ~fixed)
    at = energy.start()
    for _ in range(12):
        at, *_ = descend(energy.distortion, at, energy.reach, energy.preconditioner(at), 5, 0.0)
        assert energy.determinants(at).min() > 0
    assert np.abs(at - identity[energy.ids]).max() < 1e-3


def test_refinement_leaves_a_perfect_map_and_fixed_points_alone():
    surface, fixed = ring()
    flat = 0.01 * surface.points[:, :2]
    assert np.abs(meshes.lowered(flat, surface, ~fixed) - flat).max() < 1e-9


@pytest.mark.parametrize("seed", range(5))
def test_untangling_turns_every_fold_back(seed):
    surface, fixed = ring()
    rng = np.random.default_rng(seed)
    identity = surface.points[:, :2]
    flat = identity.copy()
    for centre in rng.choice(np.flatnonzero(~fixed), 6, replace=False):
        near = ~fixed & (np.linalg.norm(identity - identity[centre], axis=1) < 7.0)
        flat[near] = 2.2 * identity[centre] - 1.2 * identity[near]
    folded = distortion.folded_triangles(flat, surface.triangles)
    assert len(folded) > 20
    loose = np.zeros_like(fixed)
    result, freed = untangle(flat, surface.triangles, surface.points, fixed, loose)
    assert operators.signed_areas(result, surface.triangles).min() > 0
    assert len(distortion.overlapping_pairs(result, surface.triangles)) == 0
    assert np.array_equal(result[fixed], flat[fixed])
    assert len(freed) == 0


def test_untangling_frees_path_points_only_where_they_force_a_fold():
    surface, fixed = ring()
    identity = surface.points[:, :2]
    loose = ~fixed & (np.abs(identity[:, 1]) < 1.0) & (identity[:, 0] > 0)
    flat = identity.copy()
    path = np.flatnonzero(loose)[np.argsort(identity[loose, 0])]
    flat[path[2]], flat[path[3]] = identity[path[3]], identity[path[2]]
    result, freed = untangle(flat, surface.triangles, surface.points, fixed, loose)
    assert operators.signed_areas(result, surface.triangles).min() > 0
    assert set(freed) <= set(path)
    assert 1 <= len(freed) <= len(path)
    untouched = np.setdiff1d(path, freed)
    assert np.array_equal(result[untouched], flat[untouched])


def test_impossible_rims_give_a_fold_error_that_says_where():
    surface, fixed = ring()
    flat = surface.points[:, :2].copy()
    # The outer rim run the wrong way: the signed areas sum to a negative number, so some must be negative.
    loop = max(surface.boundary_loops, key=surface.loop_length)
    flat[loop] = flat[loop][::-1]
    with pytest.raises(FoldError, match=r"stay folded.*mm") as caught:
        untangle(flat, surface.triangles, surface.points, fixed, np.zeros_like(fixed))
    assert caught.value.points


def test_descent_from_a_folded_map_without_regularisation_is_refused():
    surface, fixed = ring()
    flat = surface.points[:, :2].copy()
    flat[np.flatnonzero(~fixed)[0]] *= -1
    with pytest.raises(ValueError, match="without folded triangles"):
        meshes.lowered(flat, surface, ~fixed)


def test_energy_does_not_depend_on_how_finely_the_surface_is_meshed():
    """With triangles weighted by area, a stretched ring has the same energy at two resolutions."""
    totals = []
    for rings, around in ((10, 60), (20, 120)):
        surface = meshes.annulus(20.0, 50.0, rings, around)
        fixed = np.zeros(len(surface.points), bool)
        areas = surface.triangle_areas
        rest = rest_shapes(surface.points, surface.triangles, 1.0)
        energy = PatchEnergy(surface.points[:, :2] * [1.5, 1.0], surface.triangles, rest, ~fixed, areas)
        totals.append(energy.distortion(energy.start())[0] / areas.sum())
    assert totals[0] == pytest.approx(totals[1], rel=1e-6)
    # tr(J^T J) = 1.5^2 + 1, det = 1.5.
    assert totals[0] == pytest.approx(((1.5**2 + 1) / 3.0) ** 2 + AREA * (1.5 + 1 / 1.5))


def test_rest_shapes_do_not_depend_on_the_first_corner():
    """A good triangle keeps its sides; a needle is widened to a tenth of its longest side, wherever it begins."""
    points = np.array([[0.0, 0, 0], [10, 0, 0], [4, 6, 0], [0.001, 0, 0]])
    for corners, expected in (([0, 1, 2], None), ([0, 1, 3], 0.1), ([0, 3, 2], 0.1)):
        shapes = []
        for k in range(3):
            base, x, height = rest_shapes(points, np.array([np.roll(corners, -k)]), 1.0)[0]
            corner = np.array([[0.0, 0.0], [base, 0.0], [x, height]])
            shapes.append(np.roll(corner, k, axis=0))
        sides = [np.linalg.norm(np.diff(shape, axis=0, append=shape[:1]), axis=1) for shape in shapes]
        assert np.allclose(sides[0], sides[1]) and np.allclose(sides[0], sides[2])
        base, x, height = rest_shapes(points, np.array([corners]), 1.0)[0]
        if expected is None:
            true = np.linalg.norm(points[np.roll(corners, -1)] - points[corners], axis=1)
            assert np.allclose(sides[0], true)
        else:
            assert base * height / sides[0].max() ** 2 == pytest.approx(expected, rel=0.02)


def test_the_map_does_not_depend_on_the_corner_with_which_triangles_begin(phantom, phantom_map):
    from LAFlatteningLib import Surface, flatten

    turned = flatten(Surface(phantom.surface.points, np.roll(phantom.surface.triangles, 1, axis=1)), phantom.seeds)
    assert np.abs(turned.points - phantom_map.points).max() < 1e-6


def test_descent_ends_where_numbers_overflow():
    surface, fixed = ring()
    energy = energy_of(surface, surface.points[:, :2], ~fixed)
    at = energy.start()

    def overflowing(variables):
        return 1.0, np.full(variables.shape, np.nan)

    assert descend(overflowing, at, energy.reach, energy.preconditioner(at), 5, 0.0).taken == 0
