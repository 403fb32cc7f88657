"""Lowering the distortion of a map that has no folds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import operators
from ..progress import ProgressCallback, report
from ..surface import FloatArray, IntArray, Surface
from .energy import PatchEnergy, descend, rest_shapes

STEPS = (4, 4, 10, 10)
"""Quasi-Newton steps between making the preconditioner anew from the map as it is by then."""
ENOUGH = 1e-3
"""Stop after steps that together lower the energy by less than this share of it."""


def lower_distortion(
    flat: FloatArray,
    surface: Surface,
    movable: NDArray[np.bool_],
    order: IntArray | None = None,
    progress: ProgressCallback | None = None,
) -> FloatArray:
    """The map with less change of angles and areas, and still without folds.

    Minimises the energy of `energy.PatchEnergy` with eps = 0, each triangle weighted by its area on the
    surface, so that the minimum does not depend on how finely the surface is meshed.

    Parameters
    ----------
    flat : (n, 2) map without folded triangles.
    movable : (n,) points that may move; the others stay exactly where they are.
    progress : told the share done.
    order : order of elimination for the movable points, if one is known (`solvers.Factorisation.order`).
    """
    areas = surface.triangle_areas
    scale = float(np.sqrt(operators.triangle_areas(flat, surface.triangles).sum() / areas.sum()))
    energy = PatchEnergy(
        flat,
        surface.triangles,
        rest_shapes(surface.points, surface.triangles, scale),
        movable,
        areas / areas.mean(),
        surface.edges,
    )
    variables = energy.start()
    value, _ = energy.value_and_gradient(variables, 0.0)
    for number, steps in enumerate(STEPS):
        report(progress, number / len(STEPS), "Lowering the distortion")
        preconditioner = energy.preconditioner(variables, order)
        order = preconditioner.order
        variables, _ = descend(energy, variables, 0.0, preconditioner, steps, tolerance=0.0)
        before, (value, _) = value, energy.value_and_gradient(variables, 0.0)
        if before - value < ENOUGH * value:
            break
    result = flat.copy()
    result[energy.ids] = variables
    return result
