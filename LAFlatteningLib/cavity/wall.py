"""Patches of wall: covers of openings that are none, and how messages name a place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..surface import FloatArray, IntArray, Surface
from .covers import HOLE_ARRAY, close_rims


def patch_wall(surface: Surface, rims: Sequence[IntArray]) -> Surface:
    """The surface with some rims covered as in `close_rims`, without marking the covers as those of openings."""
    names = [f"The rim at {place_text(surface.points[rim].mean(axis=0))}" for rim in rims]
    closed, _ = close_rims(surface, rims, names)
    if HOLE_ARRAY not in surface.point_data:
        return replace(closed, point_data={k: v for k, v in closed.point_data.items() if k != HOLE_ARRAY})
    old = np.asarray(surface.point_data[HOLE_ARRAY])
    marks = np.zeros((len(closed.points), *old.shape[1:]), old.dtype)
    marks[: len(old)] = old
    return closed.with_data({HOLE_ARRAY: marks})


def place_text(position: FloatArray) -> str:
    """A place (3,) as "(1.0, 2.0, 3.0) mm"."""
    return f"({', '.join(f'{x:.1f}' for x in position)}) mm"
