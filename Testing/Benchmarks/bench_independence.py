"""Whether the map belongs to the atrium and not to its triangles: remeshed atria with the same seeds in mm.

python Testing/Benchmarks/bench_independence.py [--method regional] [--sizes 5000,10000,20000,50000]
"""

from __future__ import annotations

import argparse

import cases
import numpy as np
import remeshed

from LAFlatteningLib import Flattener


def convergence(method: str, sizes: tuple[int, ...] = (2500, 5000, 10000, 20000, 40000), finest: int = 160000) -> None:
    """The phantom at several resolutions against a much finer one, and the order in the length of an edge."""
    print(f"\nThe phantom against its map at {finest} points, in disk radii")
    surface, seeds = cases.phantom(finest)
    fine = Flattener(surface, method=method).flatten(seeds)
    places = remeshed.spread(surface, 4000)
    there = remeshed.carried(fine.surface, fine.points, places)
    medians, edges = [], []
    for size in sizes:
        surface, seeds = cases.phantom(size)
        coarse = Flattener(surface, method=method).flatten(seeds)
        apart = np.linalg.norm(remeshed.carried(coarse.surface, coarse.points, places) - there, axis=1)
        medians.append(np.median(apart) / fine.template.radius)
        edges.append(float(np.median(surface.edge_lengths)))
        p95 = np.percentile(apart, 95) / fine.template.radius
        print(f"{size:>8} points, edges {edges[-1]:.2f} mm: median {medians[-1]:.5f}  p95 {p95:.5f}", flush=True)
    print(f"order of convergence of the median: {np.polyfit(np.log(edges), np.log(medians), 1)[0]:.2f}")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--method", default="regional")
    parser.add_argument("--sizes", default="5000,10000,20000,50000")
    options = parser.parse_args()
    meshes = [(int(size), True) for size in options.sizes.split(",")] + [(10000, False)]
    print("Displacement of corresponding points against the map on the mesh as given, in disk radii")
    print(f"{'atrium':<18} {'mesh':>18} {'median':>8} {'p95':>8} {'max':>8}")
    for name, surface, seeds in [("phantom 20000", *cases.phantom(20000)), *cases.real()]:
        given = Flattener(surface, method=options.method).flatten(seeds)
        seeds = given.seeds.positions
        cavity = given.cavity.surface
        places = remeshed.spread(cavity, 4000)
        there = remeshed.carried(given.surface, given.points, places)
        for points, uniform in meshes:
            other = Flattener(remeshed.remesh(cavity, points, uniform), method=options.method).flatten(seeds)
            here = remeshed.carried(other.surface, other.points, places)
            moved = np.linalg.norm(here - there, axis=1) / given.template.radius
            kind = f"{len(other.points)}" + ("" if uniform else " uneven")
            print(
                f"{name:<18} {kind:>18} {np.median(moved):>8.4f} {np.percentile(moved, 95):>8.4f} {moved.max():>8.4f}",
                flush=True,
            )
    convergence(options.method)


if __name__ == "__main__":
    main()
