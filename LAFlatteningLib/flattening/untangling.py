"""Turning folded triangles back by moving the points near them."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from .. import operators
from ..errors import FoldError
from ..surface import FloatArray, IntArray
from .descent import descend
from .energy import PatchEnergy, rest_shapes

RINGS = (3, 6, 12, 24)
"""Rings of triangles round a fold that may move; the next number is tried where the one before is not enough."""
MIN_DETERMINANT = 1e-3
"""The smallest share of its rest area (at the scale of the map) that a triangle of a repaired place must reach."""
PATIENCE = (0, 1, 5, 5)
"""Rounds in a row without progress that are borne, for each of these, before the next is tried."""
ROUNDS, STEPS = 60, 15
"""Rounds of lowering the energy of a patch, each with its own eps, and quasi-Newton steps in each."""


def untangle(
    flat: FloatArray, triangles: IntArray, points: FloatArray, fixed: NDArray[np.bool_], loose: NDArray[np.bool_]
) -> tuple[FloatArray, IntArray]:
    """A map without folded triangles, equal to the given one away from its folds.

    Parameters
    ----------
    flat : (n, 2) map with few folds.
    points : (n, 3) the surface, whose triangle shapes the moved triangles keep as well as they can.
    fixed : (n,) points that never move (rims).
    loose : (n,) points that move only where nothing else helps (paths).

    Returns
    -------
    flat : (n, 2) with every triangle turned counter-clockwise.
    freed : ids of the loose points that had to move.

    Raises
    ------
    FoldError : if folds remain, with their points.
    """
    folded = _bad(flat, triangles)
    if not len(folded):
        return flat, np.zeros(0, np.int64)
    scale = float(
        np.sqrt(operators.triangle_areas(flat, triangles).sum() / operators.triangle_areas(points, triangles).sum())
    )
    n = len(points)
    flat = flat.copy()
    held = fixed | loose
    freed = np.zeros(n, bool)
    for stage in (held, fixed):
        for rings, patience in zip(RINGS, PATIENCE, strict=True):
            folded = _bad(flat, triangles)
            if not len(folded):
                return flat, np.flatnonzero(freed)
            count = len(folded)
            # Nothing can be done about the others at this stage.
            folded = folded[~stage[triangles[folded]].all(axis=1)]
            if not len(folded):
                break
            near = neighbourhood(triangles, folded, rings, n)
            # Once paths must give way, they do so close to the fold only.
            blocked = stage | (held & ~neighbourhood(triangles, folded, min(rings, RINGS[0]), n))
            movable = near & ~blocked
            if not movable.any():
                continue
            tried = flat.copy()
            _relax(tried, triangles, points, scale, movable, patience)
            # A patch that was too small may only have pushed the folds about.
            if len(_bad(tried, triangles)) < count:
                freed |= loose & (flat != tried).any(axis=1)
                flat = tried
    folded = _bad(flat, triangles)
    if len(folded):
        raise fold_error(points, triangles[folded])
    return flat, np.flatnonzero(freed)


def fold_error(points: FloatArray, folded: IntArray) -> FoldError:
    """The error for triangles (k, 3) that stay folded on the map, saying where on the surface they are."""
    place = ", ".join(f"{x:.1f}" for x in points[folded[0]].mean(axis=0))
    return FoldError(
        f"{len(folded)} triangles stay folded on the map; the first is at {place} mm. The surface there is too "
        "coarse or too narrow for the template, or its triangles are slivers: check the nearest seed, or remesh the "
        "surface evenly.",
        tuple(int(i) for i in np.unique(folded)),
    )


def _bad(flat: FloatArray, triangles: IntArray) -> IntArray:
    """Triangles that are turned over, or so nearly that rounding decides."""
    area = operators.signed_areas(flat, triangles)
    extent = np.ptp(flat, axis=0).max()
    small = np.flatnonzero(area <= 1e-9 * extent**2)
    corner = flat[triangles[small]]
    longest = (np.diff(corner, axis=1, append=corner[:, :1]) ** 2).sum(axis=2).max(axis=1)
    return small[area[small] <= 1e-9 * longest]


def neighbourhood(triangles: IntArray, chosen: IntArray, rings: int, n: int) -> NDArray[np.bool_]:
    """Points within some rings of some of the triangles (numbers `chosen`), (n,)."""
    one, two, three = np.ascontiguousarray(triangles.T)
    near = np.zeros(n, bool)
    near[triangles[chosen]] = True
    for _ in range(rings - 1):
        touched = near.take(one)
        touched |= near.take(two)
        touched |= near.take(three)
        near[triangles[touched]] = True
    return near


def _relax(
    flat: FloatArray, triangles: IntArray, points: FloatArray, scale: float, movable: NDArray[np.bool_], patience: int
) -> None:
    """Lower the energy of all triangles with a movable point until none is folded, in place."""
    near = triangles[movable[triangles].any(axis=1)]
    energy = PatchEnergy(flat, near, rest_shapes(points, near, scale), movable)
    precondition = energy.preconditioner_at_rest()
    variables = energy.start()
    lowest = float(energy.determinants(variables).min())
    stuck = 0
    for _ in range(ROUNDS):
        eps = float(np.sqrt(1e-9 + 0.04 * min(lowest, 0.0) ** 2))
        variables, steps, _ = descend(partial(energy.untangling, eps=eps), variables, energy.reach, precondition, STEPS)
        before, lowest = lowest, float(energy.determinants(variables).min())
        stuck = stuck + 1 if before < 0 and lowest < before + 1e-3 * abs(before) else 0
        # Settled: done, or the rim of the patch is in the way and a larger patch must be tried.
        if lowest >= MIN_DETERMINANT or steps == 0 or stuck > patience:
            break
    flat[energy.ids] = variables
