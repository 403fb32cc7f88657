"""Lowering the distortion of a map that has no folds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .. import operators
from ..progress import ProgressCallback, report
from ..surface import FloatArray, IntArray, Surface
from .energy import PatchEnergy, descend, rest_shapes
from .untangling import corner_matrix, neighbourhood

WORST = 10.0
"""Triangles with a larger dilatation than this (about) are relaxed first, by themselves."""
RINGS, WORST_STEPS = 4, (6, 6, 6)
"""Rings of triangles round them that move along, and quasi-Newton steps from preconditioner to preconditioner."""
LEVELS = 6
"""Most times that the very worst, within a factor of ten, are relaxed before the others join them."""
STEPS = (4, 4, 8, 30)
"""Most quasi-Newton steps; the preconditioner is made anew, from the map as it is by then, between them."""
GUARD = 1e-2
"""Weight of the triangles that are only guarded against folding, whose area the others count already."""
STILL = 2e-4
"""In the last round of steps, stop once one moves no point by more than this share of the map's radius. (Before, steps
may be short because a triangle is all but folded.)"""


def lower_distortion(
    flat: FloatArray,
    surface: Surface,
    movable: NDArray[np.bool_],
    guarded: IntArray | None = None,
    order: IntArray | None = None,
    most: Sequence[int] = STEPS,
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
    progress : told the share done.
    most : see `STEPS`.
    order : order of elimination for the movable points, if one is known (`solvers.Factorisation.order`).
    """
    areas = surface.triangle_areas
    guarded = np.zeros((0, 3), np.int64) if guarded is None else guarded
    triangles = np.concatenate([surface.triangles, guarded])
    scale = float(np.sqrt(operators.triangle_areas(flat, surface.triangles).sum() / areas.sum()))
    flat = _relax_worst(flat, triangles, surface.points, scale, movable)
    energy = PatchEnergy(
        flat,
        triangles,
        rest_shapes(surface.points, triangles, scale),
        movable,
        np.concatenate([areas, GUARD * operators.triangle_areas(surface.points, guarded)]) / areas.mean(),
        len(guarded),
        surface.edges,
    )
    variables = energy.start()
    radius = 0.5 * float(np.ptp(flat, axis=0).max())
    for number, steps in enumerate(most):
        report(progress, number / len(most), "Lowering the distortion")
        preconditioner = energy.preconditioner(variables, order)
        order = preconditioner.order
        still = STILL * radius if number == len(most) - 1 else 0.0
        variables, _ = descend(
            energy.distortion, variables, energy.reach, preconditioner, steps, tolerance=0.0, still=still
        )
    result = flat.copy()
    result[energy.ids] = variables
    return result


def _relax_worst(
    flat: FloatArray, triangles: IntArray, points: FloatArray, scale: float, movable: NDArray[np.bool_]
) -> FloatArray:
    """The map with the places where triangles are all but folded relaxed.

    A few such triangles, left where folds were turned back, would keep every step of the whole map short. The very
    worst come first, by themselves, or they would do the same in their patches.
    """
    rest, areas = rest_shapes(points, triangles, scale), operators.triangle_areas(points, triangles)
    whole = PatchEnergy(flat, triangles, rest, movable)
    corner = corner_matrix(triangles, len(flat))
    result = flat.copy()
    for level in range(LEVELS + 1):
        mips = whole.mips(result[whole.ids])
        last = level == LEVELS or mips.max() < 2.0 * WORST
        near = neighbourhood(corner, np.flatnonzero(mips > max(0.5 * WORST, 0.0 if last else 0.1 * mips.max())), RINGS)
        used = (near & movable)[triangles].any(axis=1)
        if not used.any():
            break
        patch = PatchEnergy(result, triangles[used], rest[used], near & movable, areas[used] / areas[used].mean())
        variables = patch.start()
        for steps in WORST_STEPS:
            preconditioner = patch.preconditioner(variables)
            variables, _ = descend(patch.distortion, variables, patch.reach, preconditioner, steps, tolerance=0.0)
        result[patch.ids] = variables
        if last:
            break
    return result
