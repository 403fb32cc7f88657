"""Whether the map belongs to the atrium and not to its triangles: remeshed atria with the same seeds in mm.

python Testing/Benchmarks/bench_independence.py [--method regional] [--sizes 5000,10000,20000,50000]
"""

from __future__ import annotations

import argparse

import cases
import numpy as np
import remeshed

from LAFlatteningLib import Flattener


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


if __name__ == "__main__":
    main()
