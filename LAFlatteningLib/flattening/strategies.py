"""The four ways to lay an atrium flat that the paper compares (its figure "Example of different quasi-conformal LA
flattenings"), for study: only the last is the method ``paper``, and only ``regional`` never folds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..progress import ProgressCallback
from ..solvers import harmonic, published_least_squares
from ..surface import FloatArray, Surface
from ..template import DEFAULT_TEMPLATE, Template
from .flat_map import FlatMap
from .flattener import Flattener

STRATEGIES = ("mitral", "rims", "paths", "refined")
"""``mitral``: holes covered, only the outer rim on its place. ``rims``: all rims. ``paths``: paths too, rims in the
least-squares sense (equations 3-4). ``refined``: that, and then the rims again without the paths (equations 5-6)."""


def flatten_by_strategy(
    surface: Surface,
    seeds: Mapping[str, FloatArray],
    strategy: str,
    template: Template | str | Path = DEFAULT_TEMPLATE,
    rounding: str = "paper",
    check_axes: bool = True,
    progress: ProgressCallback | None = None,
) -> FlatMap:
    """Flatten a surface by one of `STRATEGIES`, with the rules of the method ``paper`` for rims and paths.

    Returns
    -------
    A `FlatMap` whose `method` names the strategy. Rims that the strategy leaves free are not on their circles
    (`FlatMap.rim_error`), paths not on their lines (`FlatMap.path_drift`), and triangles may be folded.

    Raises
    ------
    ValueError : unknown strategy.
    SurfaceError, SeedError, TemplateError : as `Flattener.flatten`.
    """
    if strategy not in STRATEGIES:
        raise ValueError(f'Expected strategy {", ".join(STRATEGIES)}; found "{strategy}".')
    whole = Flattener(surface, template, "paper", rounding, check_axes).flatten(seeds, progress)
    if strategy == "refined":
        return whole
    constraints = whole.constraints
    if strategy == "mitral":
        flat = _outer_rim_only(whole)
    elif strategy == "rims":
        flat, _ = harmonic(whole.surface.laplacian, constraints.rim_ids, constraints.rim_targets)
    else:
        flat = published_least_squares(
            2.0 * whole.surface.laplacian,
            constraints.rim_ids,
            constraints.rim_targets,
            constraints.path_ids,
            constraints.path_targets,
        )
    return replace(whole, solution=flat, method=f"paper, strategy {strategy}")


def _outer_rim_only(whole: FlatMap) -> FloatArray:
    """The harmonic map of the covered surface with its outer rim on the circle, at the points of the cavity."""
    outer = whole.division.loops[whole.template.anatomy.outer]
    place = np.full(len(whole.surface.points), -1)
    place[whole.constraints.rim_ids] = np.arange(len(whole.constraints.rim_ids))
    cavity = whole.cavity
    covered, _ = harmonic(cavity.closed.laplacian, cavity.ids[outer], whole.constraints.rim_targets[place[outer]])
    return covered[cavity.ids]
