"""The atria that the figures are drawn from, with what several figures need of them, made once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from cases import DATA, real
from cases import phantom as phantom_with_seeds

from LAFlatteningLib import FlatMap, Flattener, Phantom, Surface, make_phantom, read_surface

POINTS = 20000
"""Of the phantom, as in the paper."""


@dataclass(frozen=True)
class Atrium:
    """An atrium open at its six openings.

    Attributes
    ----------
    key : part of the file names of its figures; empty for the phantom.
    title : what captions call it.
    surface, seeds : in the same axes, mm.
    """

    key: str
    title: str
    surface: Surface
    seeds: dict[str, np.ndarray]
    _maps: dict[tuple[str, str], FlatMap] = field(default_factory=dict, repr=False)

    def map(self, method: str = "regional", template: str = "adapted1") -> FlatMap:
        """Its map, made when first asked for."""
        if (method, template) not in self._maps:
            self._maps[method, template] = Flattener(self.surface, template, method).flatten(self.seeds)
        return self._maps[method, template]


@cache
def made_phantom(points: int = POINTS) -> Phantom:
    """The phantom with its truth."""
    return make_phantom(points)


def phantom() -> Atrium:
    """The synthetic atrium."""
    return Atrium("", f"synthetic atrium, {POINTS} points", *phantom_with_seeds(POINTS))


TITLES = {
    "frf_demo": "left atrium from LGE-MRI",
    "pvi_gap": "left atrium from LGE-MRI after ablation",
    "ct_shape_model_1": "left atrium of a CT shape model",
}


def atria() -> Iterator[Atrium]:
    """The phantom, then the real atria that are found."""
    yield phantom()
    for key, surface, seeds in real():
        yield Atrium(key, f"{TITLES[key]}, {len(surface.points)} points", surface, seeds)


def found(path: str) -> Surface | None:
    """A surface of the real data, or None where it is absent."""
    return read_surface(DATA / path) if (DATA / path).is_file() else None
