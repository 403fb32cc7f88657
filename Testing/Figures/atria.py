"""The atria that the figures are drawn from, with what several figures need of them, made once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from cases import DATA, real
from cases import phantom as phantom_with_seeds

from LAFlatteningLib import (
    FlatMap,
    Flattener,
    LAFlatteningError,
    Phantom,
    Surface,
    make_phantom,
    project,
    read_surface,
    read_volume,
)
from LAFlatteningLib.cavity.label_surface import label_surface
from LAFlatteningLib.phantom import ScarPattern, mesh_phantom
from LAFlatteningLib.preparation import prepare

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


def varied_phantoms(count: int = 12, points: int = 6000) -> Iterator[Atrium]:
    """Synthetic atria of other sizes, with veins of other widths in other places: a small population."""
    plain = make_phantom(500).shape
    rng = np.random.default_rng(7)
    made = 0
    while made < count:
        tubes = {
            name: replace(
                tube,
                azimuth=tube.azimuth + rng.uniform(-8, 8),
                elevation=tube.elevation + rng.uniform(-6, 6),
                perimeter=tube.perimeter * rng.uniform(0.8, 1.2),
            )
            for name, tube in plain.tubes.items()
        }
        valve = replace(plain.valve, perimeter=plain.valve.perimeter * rng.uniform(0.9, 1.1))
        try:
            shape = replace(
                plain, radius=plain.radius * rng.uniform(0.9, 1.2), tubes=tubes, valve=valve, scar_pattern=ScarPattern()
            )
            phantom = mesh_phantom(shape, points)
        except LAFlatteningError:
            # Openings too near to each other: another one.
            continue
        made += 1
        yield Atrium(f"phantom_{made}", f"synthetic atrium {made}", phantom.surface, phantom.seeds)


def scans(count: int | None = None) -> Iterator[Atrium]:
    """Atria of LGE-MRI, from label map and image to an open atrium with the array LGE, where the data is present.

    Those that are refused (a common trunk) are left out.
    """
    for path in sorted((DATA / "stacom2018").glob("*_laendo.nrrd"))[:count]:
        case = path.name.split("_")[0]
        try:
            prepared = prepare(label_surface(read_volume(path)).surface)
        except LAFlatteningError:
            continue
        image = read_volume(path.with_name(f"{case}_lgemri_norm.nrrd"))
        cavity = project(prepared.cavity, image).on(prepared.cavity)
        yield Atrium(f"scan_{case}", f"left atrium from LGE-MRI, case {case}", cavity, dict(prepared.seeds))


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
