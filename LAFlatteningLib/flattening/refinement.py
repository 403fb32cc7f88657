"""Lowering the distortion of a map that has no folds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import operators
from ..progress import ProgressCallback, part, report
from ..solvers import Factorisation
from ..surface import FloatArray, IntArray, Surface
from .descent import descend
from .energy import GUARDED_FROM, PatchEnergy, rest_shapes
from .parts import movable_parts
from .untangling import neighbourhood, untangle

WORST = 10.0
"""Triangles with a larger dilatation than this (about) are relaxed first, by themselves."""
RINGS, WORST_STEPS = 4, (6, 6, 6)
"""Rings of triangles round them that move along, and quasi-Newton steps from preconditioner to preconditioner."""
LEVELS = 6
"""Most times that the very worst, within a factor of ten, are relaxed before the others join them."""
STEPS = (10, 8, 8)
"""Most quasi-Newton steps; the preconditioner is made anew, from the map as it is by then, between them."""
FAR = 2e-3
"""The last of them only where the last step moved a point by more than this share of the map's radius, or had to be
shortened; elsewhere the Hessian is of use already."""
HESSIANS, HESSIAN_STEPS = 3, 16
"""Then the Hessian takes the place of the preconditioner: so many of them at most, and steps with each."""
MOST_FOR_HESSIAN = 250_000
"""Points up to which there are Hessians; their factors take four times the memory of the preconditioner's."""
EXACT = 1e-8
"""With them, stop once a step moves no point by more than this share of the map's radius. (The next one would move
none by more than a tenth of that.)"""
BY_PARTS = 5000
"""Maps of more movable points are lowered part by part: where one is hard, the others need not wait for it."""
LAST_STEPS = 40
"""Most quasi-Newton steps where that does not end."""
AGAIN = 4
"""Most times that these are taken, and Hessians tried again. (On 100,000 points of a real atrium, at most twice.)"""
STILL = 2e-4
"""Of these, stop once one moves no point by more than this share of the map's radius. (Before, steps may be short
because a triangle is all but folded.)"""


class Refinement:
    """Lowers the distortion of maps of one surface with the same points held.

    Minimises `energy.PatchEnergy.distortion`, each triangle weighted by its area on the
    surface, so that the minimum does not depend on how finely the surface is meshed.

    Parameters
    ----------
    flat : (n, 2) any map, from which the points that are held are taken at first.
    surface : in 3D.
    movable : (n,) points that may move; the others stay exactly where they are.
    scale : map units per mm, of the whole map.
    """

    def __init__(self, flat: FloatArray, surface: Surface, movable: NDArray[np.bool_], scale: float) -> None:
        areas = surface.triangle_areas
        # (A point without triangles has no place that is better than another.)
        movable = movable & surface.used_points
        self._surface, self._movable, self._scale = surface, movable, scale
        self._rest, self._weights = rest_shapes(surface.points, surface.triangles, scale), areas / areas.mean()
        # Not of small meshes, where a step costs the same for few points as for all.
        apart = movable.sum() > BY_PARTS
        part_of = movable_parts(surface.edges.points, movable) if apart else np.where(movable, 0, -1)
        # All corners of a triangle that move are in one part.
        of_triangle = np.max([part_of.take(corner) for corner in np.ascontiguousarray(surface.triangles.T)], axis=0)
        self._parts = [
            self._part(flat, part_of == number, np.flatnonzero(of_triangle == number))
            for number in range(int(part_of.max()) + 1)
        ]

    def _part(self, flat: FloatArray, group: NDArray[np.bool_], near: IntArray) -> _Part:
        surface = self._surface
        triangles, rest, weights = surface.triangles[near], self._rest[near], self._weights[near]
        energy = PatchEnergy(flat, triangles, rest, group, weights, mesh_edges=surface.edges.of_triangle[near])
        return _Part(energy, triangles, rest, weights)

    def follow(self, flat: FloatArray, placed: FloatArray) -> FloatArray:
        """A map (n, 2) with the points that are held where `placed` (n, 2) has them, and the others moved along.

        It may have folds.
        """
        result = placed.copy()
        for one in self._parts:
            energy = one.energy
            energy.hold(flat)
            result[energy.ids], one.solver = energy.follow(np.asfortranarray(flat[energy.ids]), placed)
        return result

    def lower(
        self,
        flat: FloatArray,
        most: Sequence[int] = STEPS,
        finish: bool = True,
        progress: ProgressCallback | None = None,
    ) -> FloatArray:
        """The map with less change of angles and areas, and still without folds.

        Parameters
        ----------
        flat : (n, 2) map without folded triangles.
        most : see `STEPS`.
        finish : whether to go on to the minimum.
        progress : told the share done.
        """
        result, radius, worst = flat.copy(), _radius(flat), WORST_STEPS if finish else WORST_STEPS[:1]
        for k, one in enumerate(self._parts):
            told = part(progress, k / len(self._parts), (k + 1) / len(self._parts))
            one.energy.hold(flat)
            relaxed = self._relax_worst(flat, one, worst)
            result[one.energy.ids] = _lower(one.energy, relaxed, one.solver, radius, most, finish, told)
        return result

    def guard(
        self, flat: FloatArray, guarded: IntArray, fixed: NDArray[np.bool_], loose: NDArray[np.bool_]
    ) -> tuple[FloatArray, IntArray]:
        """The map with more triangles (g, 3) kept from folding, and from being all but folded, where they are.

        Points near them move to where the distortion of all is least; elsewhere the map stays as it is.

        Returns
        -------
        flat, freed : see `untangling.untangle`, also for `fixed` and `loose`.

        Raises
        ------
        FoldError : if folds remain.
        """
        if not len(guarded):
            return flat, np.zeros(0, np.int64)
        points = self._surface.points
        triangles = np.concatenate([self._surface.triangles, guarded])
        rest = np.concatenate([self._rest, rest_shapes(points, guarded, self._scale)])
        new = slice(len(self._weights), None)
        energy = PatchEnergy(flat, guarded, rest[new], np.zeros(len(flat), bool))
        bad = energy.determinants(energy.start()) <= 0.0
        close = bad | (energy.mips(energy.start()) > GUARDED_FROM)
        if not close.any():
            return flat, np.zeros(0, np.int64)
        untangled, freed = (
            untangle(flat, triangles, points, fixed, loose) if bad.any() else (flat, np.zeros(0, np.int64))
        )
        near = neighbourhood(triangles, len(self._weights) + np.flatnonzero(close), RINGS, len(flat))
        near = self._movable & (near | (untangled != flat).any(axis=1))
        if not near.any():
            return untangled, freed
        areas = operators.triangle_areas(points, guarded) / self._surface.triangle_areas.mean()
        weights = np.concatenate([self._weights, areas])
        used = near[triangles].any(axis=1)
        patch = PatchEnergy(untangled, triangles[used], rest[used], near, weights[used], int(used[new].sum()))
        result = untangled.copy()
        result[patch.ids] = _lower(patch, patch.start(), None, _radius(flat), STEPS, True, None)
        return result, freed

    def _relax_worst(self, flat: FloatArray, one: _Part, most: Sequence[int]) -> FloatArray:
        """The variables of a part with the places where triangles are all but folded relaxed.

        A few such triangles, left where folds were turned back, would keep every step of the whole map short. The very
        worst come first, by themselves, or they would do the same in their patches.
        """
        ids, result = one.energy.ids, flat
        for level in range(LEVELS + 1):
            mips = one.energy.mips(result[ids])
            last = level == LEVELS or mips.max() < 2.0 * WORST
            worst = np.flatnonzero(mips > max(0.5 * WORST, 0.0 if last else 0.1 * mips.max()))
            if not len(worst):
                break
            if result is flat:
                result = flat.copy()
            near = neighbourhood(one.triangles, worst, RINGS, len(flat)) & self._movable
            used = near[one.triangles].any(axis=1)
            if not used.any():
                break
            patch = PatchEnergy(result, one.triangles[used], one.rest[used], near, one.weights[used])
            variables = patch.start()
            for steps in most:
                preconditioner = patch.preconditioner(variables)
                variables = descend(patch.distortion, variables, patch.reach, preconditioner, steps, 0.0).variables
            result[patch.ids] = variables
            if last:
                break
        return np.asfortranarray(result[ids])


class _Part:
    """Some of the points, the triangles at them, and a preconditioner if one is there."""

    def __init__(self, energy: PatchEnergy, triangles: IntArray, rest: FloatArray, weights: FloatArray) -> None:
        self.energy, self.triangles, self.rest, self.weights = energy, triangles, rest, weights
        self.solver: Factorisation | None = None


def _radius(flat: FloatArray) -> float:
    return 0.5 * float(np.ptp(flat, axis=0).max())


def _lower(
    energy: PatchEnergy,
    variables: FloatArray,
    solver: Factorisation | None,
    radius: float,
    most: Sequence[int],
    finish: bool,
    progress: ProgressCallback | None,
) -> FloatArray:
    """Steps with the approximation, from one that is there on, and with the Hessian until they end."""
    rounds = len(most) + 2
    for number, steps in enumerate(most):
        report(progress, number / rounds, "Lowering the distortion")
        if number or solver is None:
            solver = energy.preconditioner(variables)
        variables, _, moved = descend(energy.distortion, variables, energy.reach, solver, steps, tolerance=0.0)
        if finish and moved <= FAR * radius:
            break
    report(progress, len(most) / rounds, "Lowering the distortion")
    if not finish:
        return variables
    assert solver is not None
    small = len(variables) <= MOST_FOR_HESSIAN
    settled = False
    if small:
        variables, settled = _by_hessians(energy, variables, solver.order, EXACT * radius)
    for _ in range(AGAIN):
        if settled:
            break
        # Too far from the minimum as yet, or a mesh too large for the memory that Hessians take.
        solver = energy.preconditioner(variables)
        variables, *_ = descend(
            energy.distortion, variables, energy.reach, solver, LAST_STEPS, tolerance=0.0, still=STILL * radius
        )
        if not small:
            break
        variables, settled = _by_hessians(energy, variables, solver.order, EXACT * radius)
    return variables


class _Settled(NamedTuple):
    """Variables (v, 2), and whether they have come to the minimum."""

    variables: FloatArray
    settled: bool


def _by_hessians(energy: PatchEnergy, variables: FloatArray, order: IntArray, still: float) -> _Settled:
    """Steps with the Hessian until one moves no point by more than `still`, as far as it is of use."""
    for _ in range(HESSIANS):
        try:
            hessian = energy.hessian(variables, order)
        except np.linalg.LinAlgError:
            break
        variables, taken, _ = descend(
            energy.distortion, variables, energy.reach, hessian, HESSIAN_STEPS, tolerance=0.0, still=still
        )
        if taken < HESSIAN_STEPS:
            # Steps may also end because the Hessian, not positive definite yet, is of no use.
            left = hessian.solve(energy.distortion(variables)[1])
            return _Settled(variables, bool(np.abs(left).max() < still))
    return _Settled(variables, False)
