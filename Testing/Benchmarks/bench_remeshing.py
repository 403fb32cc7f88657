"""Remeshing: time, evenness and distance to the surface, beside pyacvd.

python Testing/Benchmarks/bench_remeshing.py [--points 20000]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator

import cases
import remeshed

from LAFlatteningLib import Surface, make_phantom, read_surface
from LAFlatteningLib.remeshing import Remeshed, remesh


def surfaces() -> Iterator[tuple[str, Surface]]:
    """Name and surface of each case."""
    for points in (5000, 60_000, 150_000):
        yield f"phantom, {points} points", make_phantom(points).surface
    for name in ("frf_demo/surface.vtk", "pvi_gap/surface.vtp", "labelled/dtmri_endo1.vtp", "eam/OC59_MV_only.mesh"):
        if (cases.DATA / name).is_file():
            yield name, read_surface(cases.DATA / name)


def line(name: str, surface: Surface, make: Callable[[], Remeshed]) -> None:
    """Print a row of the table: the least time of three runs."""
    seconds = []
    for _ in range(3):
        began = time.perf_counter()
        made = make()
        seconds.append(time.perf_counter() - began)
    quality, distance = made.quality, made.distance_mm
    same = (made.surface.genus, len(made.surface.boundary_loops)) == (surface.genus, len(surface.boundary_loops))
    print(
        f"| {name} | {len(surface.points)} | {len(made.surface.points)} | {min(seconds):.2f} | "
        f"{quality['smallest_angle_degrees']:.0f} | {quality['p1_angle_degrees']:.0f} | {quality['edge_spread']:.3f} | "
        f"{distance['p95']:.3f} | {distance['max']:.3f} | {'yes' if same else 'no'} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=20_000)
    points = parser.parse_args().points
    print("| surface | points | made | s | smallest angle | 1 % below | edge spread | mm, 95 % | max | kept |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for name, surface in surfaces():
        line(name, surface, lambda surface=surface: remesh(surface, points=points))
        line(f"{name} (pyacvd)", surface, lambda surface=surface: Remeshed(remeshed.remesh(surface, points), surface))


if __name__ == "__main__":
    main()
