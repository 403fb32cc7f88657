"""The atria that the benchmarks run on: the phantom everywhere, real ones where they are found."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.sparse.csgraph import dijkstra

from LAFlatteningLib import Surface, make_phantom, read_seeds, read_surface

DATA = Path(os.environ.get("LAF_TEST_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
Seeds = dict[str, np.ndarray]


def phantom(points: int) -> tuple[Surface, Seeds]:
    """The synthetic atrium with its own seeds."""
    made = make_phantom(points)
    return made.surface, made.seeds


def real() -> Iterator[tuple[str, Surface, Seeds]]:
    """Name, surface and seeds of each real atrium that is present."""
    for name, seeds in (("frf_demo", "seeds_operator1.csv"), ("pvi_gap", "seeds.csv")):
        if (DATA / name).is_dir():
            yield name, read_surface(DATA / name / "closed_ostia.vtp"), read_seeds(DATA / name / seeds)
    path = DATA / "labelled" / "ct_shape_model_1.vtp"
    if path.is_file():
        surface = read_surface(path)
        yield "ct_shape_model_1", surface, seeds_by_rule(surface)


def seeds_by_rule(surface: Surface) -> Seeds:
    """Seeds of an atrium in LPS whose six openings are open.

    The longest rim is the valve. Of the others, the two with the smallest x are the right veins, the higher
    (z) the superior one; of the left three the most anterior (smallest y) is the appendage and of the other two
    the higher is the superior vein. Seeds of veins and appendage: the centre of the rim. Mitral seeds: the
    point of the valve's rim nearest, along edges, to the rim of RSPV, RIPV, LIPV and LAA.
    """
    loops = sorted(surface.boundary_loops, key=surface.loop_length, reverse=True)
    valve, others = loops[0], sorted(loops[1:], key=lambda loop: surface.points[loop, 0].mean())
    ripv, rspv = sorted(others[:2], key=lambda loop: surface.points[loop, 2].mean())
    left = sorted(others[2:], key=lambda loop: surface.points[loop, 1].mean())
    lipv, lspv = sorted(left[1:], key=lambda loop: surface.points[loop, 2].mean())
    rims = {"RSPV": rspv, "RIPV": ripv, "LIPV": lipv, "LSPV": lspv, "LAA": left[0]}
    seeds = {label: surface.points[rim].mean(axis=0) for label, rim in rims.items()}
    for seed, opening in (("MV1", "RSPV"), ("MV2", "RIPV"), ("MV3", "LIPV"), ("MV4", "LAA")):
        distance = dijkstra(surface.edge_graph, indices=rims[opening], min_only=True)
        seeds[seed] = surface.points[valve[distance[valve].argmin()]]
    return seeds


def moved(seeds: Seeds, surface: Surface, distance: float, rng: np.random.Generator) -> Seeds:
    """Seeds moved by a distance (mm) in random directions and put back on the surface."""
    result = {}
    for label, at in seeds.items():
        step = rng.standard_normal(3)
        target = at + distance * step / np.linalg.norm(step)
        result[label] = surface.points[np.linalg.norm(surface.points - target, axis=1).argmin()]
    return result
