"""Lowering the distortion of a map that has no folds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import operators
from ..progress import ProgressCallback, part, report
from ..surface import FloatArray, IntArray, Surface
from .descent import Solver, descend, solved
from .energy import PatchEnergy, rest_shapes
from .parts import Blocks, movable_parts
from .untangling import corner_matrix, neighbourhood

WORST = 10.0
"""Triangles with a larger dilatation than this (about) are relaxed first, by themselves."""
RINGS, WORST_STEPS = 4, (6, 6, 6)
"""Rings of triangles round them that move along, and quasi-Newton steps from preconditioner to preconditioner."""
LEVELS = 6
"""Most times that the very worst, within a factor of ten, are relaxed before the others join them."""
STEPS = (4, 8, 8)
"""Most quasi-Newton steps; the preconditioner is made anew, from the map as it is by then, between them."""
FAR = 0.04
"""The last of them only where those before moved a point by more than this share of the map's radius; elsewhere the
Hessian is of use already."""
HESSIANS, HESSIAN_STEPS = 2, 24
"""Then the Hessian takes the place of the preconditioner: so many of them at most, and steps with each."""
MOST_FOR_HESSIAN = 250_000
"""Points up to which there are Hessians; their factors take four times the memory of the preconditioner's."""
EXACT = 1e-8
"""With them, stop once a step moves no point by more than this share of the map's radius. (The next one would move
none by more than a tenth of that.)"""
NEAR = 1e-6
"""Likewise for each of the parts that rims and paths cut the map into, before they are joined."""
BY_PARTS = 5000
"""Maps of more movable points are lowered part by part: where one is hard, the others need not wait for it."""
LAST_STEPS = 40
"""Most quasi-Newton steps where that does not end."""
GUARD = 1e-2
"""Weight of the triangles that are only guarded against folding, whose area the others count already."""
STILL = 2e-4
"""Of these, stop once one moves no point by more than this share of the map's radius. (Before, steps may be short
because a triangle is all but folded.)"""


def lower_distortion(
    flat: FloatArray,
    surface: Surface,
    movable: NDArray[np.bool_],
    guarded: IntArray | None = None,
    order: IntArray | None = None,
    most: Sequence[int] = STEPS,
    finish: bool = True,
    progress: ProgressCallback | None = None,
) -> FloatArray:
    """The map with less change of angles and areas, and still without folds.

    Minimises `energy.PatchEnergy.distortion`, each triangle weighted by its area on the
    surface, so that the minimum does not depend on how finely the surface is meshed.

    Parameters
    ----------
    flat : (n, 2) map without folded triangles.
    movable : (n,) points that may move; the others stay exactly where they are.
    guarded : (g, 3) more triangles that must not fold, beside those of the surface.
    order : order of elimination for the movable points, if one is known (`solvers.Factorisation.order`).
    most : see `STEPS`.
    finish : whether to go on to the minimum.
    progress : told the share done.
    """
    areas = surface.triangle_areas
    guarded = np.zeros((0, 3), np.int64) if guarded is None else guarded
    triangles = np.concatenate([surface.triangles, guarded])
    scale = float(np.sqrt(operators.triangle_areas(flat, surface.triangles).sum() / areas.sum()))
    rest = rest_shapes(surface.points, triangles, scale)
    weights = np.concatenate([areas, operators.triangle_areas(surface.points, guarded)]) / areas.mean()
    even = weights.copy()
    weights[len(areas) :] *= GUARD
    energy = PatchEnergy(flat, triangles, rest, movable, weights, len(guarded), surface.edges, order)
    flat = _relax_worst(flat, energy, triangles, rest, even, movable, WORST_STEPS if finish else WORST_STEPS[:1])
    radius = 0.5 * float(np.ptp(flat, axis=0).max())
    # Not of small meshes, where a step costs the same for few points as for all.
    groups = movable_parts(surface.triangles, movable) if finish and len(energy.ids) > BY_PARTS else []
    if len(groups) < 2:
        lowered = _lower(energy, flat[energy.ids], radius, EXACT * radius, most, finish, progress)
        flat[energy.ids] = lowered.variables
        return flat
    numbers, solvers, exact = [], [], True
    for k, group in enumerate(groups):
        told = part(progress, k / (len(groups) + 1), (k + 1) / (len(groups) + 1))
        number = np.flatnonzero(group[energy.ids])
        near = group[triangles].any(axis=1)
        # In the order in which the whole has them.
        own_order = None if order is None else np.argsort(np.argsort(energy.ids[number]))
        own = PatchEnergy(
            flat, triangles[near], rest[near], group, weights[near], int(near[len(areas) :].sum()), None, own_order
        )
        lowered = _lower(own, own.start(), radius, NEAR * radius, most, finish, told)
        flat[own.ids] = lowered.variables
        numbers.append(number)
        solvers.append(lowered.solver)
        exact &= len(number) <= MOST_FOR_HESSIAN
    # Of the parts, only the triangles that are guarded know of each other.
    report(progress, len(groups) / (len(groups) + 1), "Lowering the distortion")
    flat[energy.ids] = _join(energy, flat[energy.ids], Blocks(numbers, solvers), exact, radius)
    return flat


class _Lowered(NamedTuple):
    """Variables (v, 2), the solver that they came there with, and whether they have come to the minimum."""

    variables: FloatArray
    solver: Solver
    settled: bool


def _lower(
    energy: PatchEnergy,
    variables: FloatArray,
    radius: float,
    still: float,
    most: Sequence[int],
    finish: bool,
    progress: ProgressCallback | None,
) -> _Lowered:
    """Steps with the approximation, and with the Hessian until one moves no point by more than `still`."""
    rounds, moved = len(most) + 2, np.inf
    for number, steps in enumerate(most):
        report(progress, number / rounds, "Lowering the distortion")
        if finish and number + 1 == len(most) and moved <= FAR * radius:
            break
        solver, before = energy.preconditioner(variables), variables
        variables, _ = descend(energy.distortion, variables, energy.reach, solver, steps, tolerance=0.0)
        moved = float(np.abs(variables - before).max())
    report(progress, len(most) / rounds, "Lowering the distortion")
    return _finish(energy, variables, radius, still) if finish else _Lowered(variables, solver, False)


def _join(energy: PatchEnergy, variables: FloatArray, blocks: Blocks, exact: bool, radius: float) -> FloatArray:
    """The minimum, from the minima of the parts."""
    still = (EXACT if exact else STILL) * radius
    variables, _ = descend(energy.distortion, variables, energy.reach, blocks, LAST_STEPS, tolerance=0.0, still=still)
    if exact and np.abs(blocks.solve(energy.distortion(variables)[1])).max() >= 10.0 * still:
        return _finish(energy, variables, radius, still).variables
    return variables


def _finish(energy: PatchEnergy, variables: FloatArray, radius: float, still: float) -> _Lowered:
    """The minimum, from a place near it."""
    small = len(variables) <= MOST_FOR_HESSIAN
    if small:
        lowered = _by_hessians(energy, variables, still)
        if lowered is not None and lowered.settled:
            return lowered
        variables = variables if lowered is None else lowered.variables
    # Too far from the minimum as yet, or a mesh too large for the memory that Hessians take.
    solver = energy.preconditioner(variables)
    variables, _ = descend(
        energy.distortion, variables, energy.reach, solver, LAST_STEPS, tolerance=0.0, still=STILL * radius
    )
    lowered = _by_hessians(energy, variables, still) if small else None
    return _Lowered(variables, solver, False) if lowered is None else lowered


def _by_hessians(energy: PatchEnergy, variables: FloatArray, still: float) -> _Lowered | None:
    """Steps with the Hessian; None where it is singular."""
    lowered = None
    for _ in range(HESSIANS):
        try:
            hessian = energy.hessian(variables)
        except np.linalg.LinAlgError:
            break
        variables, taken = descend(
            energy.distortion, variables, energy.reach, hessian, HESSIAN_STEPS, tolerance=0.0, still=still
        )
        lowered = _Lowered(variables, hessian, False)
        if taken < HESSIAN_STEPS:
            # Steps may also end because the Hessian, not positive definite yet, is of no use.
            left = solved(hessian, energy.distortion(variables)[1])
            return _Lowered(variables, hessian, bool(np.abs(left).max() < still))
    return lowered


def _relax_worst(
    flat: FloatArray,
    whole: PatchEnergy,
    triangles: IntArray,
    rest: FloatArray,
    areas: FloatArray,
    movable: NDArray[np.bool_],
    most: Sequence[int],
) -> FloatArray:
    """The map with the places where triangles are all but folded relaxed.

    A few such triangles, left where folds were turned back, would keep every step of the whole map short. The very
    worst come first, by themselves, or they would do the same in their patches.
    """
    corner = None
    result = flat.copy()
    for level in range(LEVELS + 1):
        mips = whole.mips(result[whole.ids])
        last = level == LEVELS or mips.max() < 2.0 * WORST
        worst = np.flatnonzero(mips > max(0.5 * WORST, 0.0 if last else 0.1 * mips.max()))
        if not len(worst):
            break
        if corner is None:
            corner = corner_matrix(triangles, len(flat))
        near = neighbourhood(corner, worst, RINGS)
        used = (near & movable)[triangles].any(axis=1)
        if not used.any():
            break
        patch = PatchEnergy(result, triangles[used], rest[used], near & movable, areas[used] / areas[used].mean())
        variables = patch.start()
        for steps in most:
            preconditioner = patch.preconditioner(variables)
            variables, _ = descend(patch.distortion, variables, patch.reach, preconditioner, steps, tolerance=0.0)
        result[patch.ids] = variables
        if last:
            break
    return result
