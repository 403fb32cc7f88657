"""Random seeds on meshes from 1,000 to 50,000 points: that no map folds, and the longest time.

python Testing/Benchmarks/bench_stress.py [--seeds 300] [--move 2.0]
"""

from __future__ import annotations

import argparse
import time

import cases
import numpy as np
import remeshed

from LAFlatteningLib import Flattener, LAFlatteningError


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=300, help="random seed sets on each mesh (default: %(default)s)")
    parser.add_argument("--move", type=float, default=2.0, help="how far each seed moves, mm (default: %(default)s)")
    options = parser.parse_args()
    real = {name: (surface, seeds) for name, surface, seeds in cases.real()}
    meshes = [(f"phantom {size}", *cases.phantom(size)) for size in (1000, 5000, 50000)]
    for name, size in (("frf_demo", 2000), ("pvi_gap", 10000), ("ct_shape_model_1", 12639)):
        if name in real:
            surface, seeds = real[name]
            cavity = Flattener(surface).flatten(seeds).cavity.surface
            made = cavity if size == len(cavity.points) else remeshed.remesh(cavity, size)
            meshes.append((f"{name} {len(made.points)}", made, seeds))
    print(f"{options.seeds} random seed sets on each mesh, every seed moved by {options.move:g} mm")
    print(
        f"{'mesh':<24} {'maps':>5} {'folded':>7} {'freed':>6} {'refused':>8} {'median s':>9} {'worst s':>8} "
        f"{'K p99':>6}"
    )
    for name, surface, seeds in meshes:
        flattener = Flattener(surface)
        closed = flattener.flatten(seeds).cavity.closed
        rng = np.random.default_rng(0)
        folded = freed = 0
        seconds: list[float] = []
        worst_k = 0.0
        refused: dict[str, int] = {}
        for _ in range(options.seeds):
            moved = cases.moved(seeds, closed, options.move, rng)
            began = time.perf_counter()
            try:
                flat_map = flattener.flatten(moved)
            except LAFlatteningError as error:
                refused[str(error)[:160]] = refused.get(str(error)[:160], 0) + 1
                continue
            seconds.append(time.perf_counter() - began)
            folded += len(flat_map.folded_triangles)
            freed += len(flat_map.freed_path_points) > 0
            worst_k = max(worst_k, flat_map.distortion_summary["dilatation"]["p99"])
        print(
            f"{name:<24} {len(seconds):>5} {folded:>7} {freed:>6} {sum(refused.values()):>8} "
            f"{np.median(seconds):>9.2f} {max(seconds):>8.2f} {worst_k:>6.1f}",
            flush=True,
        )
        for reason, count in refused.items():
            print(f"  refused {count}: {reason}")


if __name__ == "__main__":
    main()
