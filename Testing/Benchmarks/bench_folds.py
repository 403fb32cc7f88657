"""That no map folds: phantoms of many sizes, real atria, and random seeds on each; and how good the maps are.

python Testing/Benchmarks/bench_folds.py [--seeds 200] [--move 2.0]
"""

from __future__ import annotations

import argparse

import cases
import numpy as np

from LAFlatteningLib import Flattener, SeedError


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--seeds", type=int, default=200, help="random seed sets on each real case (default: %(default)s)"
    )
    parser.add_argument("--move", type=float, default=2.0, help="how far each seed moves, mm (default: %(default)s)")
    options = parser.parse_args()
    atria = [(f"phantom {size}", *cases.phantom(size)) for size in (2000, 5000, 20000, 100000)]
    atria += list(cases.real())
    print(
        f"{'atrium':<18} {'method':<9} {'folded':>6} {'overlap':>7} {'flipped':>7} {'freed':>5} "
        f"{'rim err':>8} {'drift':>8} "
        f"{'beta':>6} {'K med':>6} {'K p99':>6} {'K max':>7} {'entropy':>7} {'s':>6}"
    )
    for name, surface, seeds in atria:
        for method in ("regional", "paper"):
            m = Flattener(surface, method=method).flatten(seeds).metrics
            k = m["dilatation"]
            print(
                f"{name:<18} {method:<9} {m['folded_triangles']:>6} {m['overlapping_pairs']:>7} "
                f"{m['flipped_edges']:>7} {m['freed_path_points']:>5} {m['rim_error']:>8.0e} {m['path_drift']:>8.0e} "
                f"{m['beta']['mean']:>6.3f} "
                f"{k['median']:>6.2f} {k['p99']:>6.1f} {k['max']:>7.0f} {m['alpha']['entropy']:>7.3f} "
                f"{m['seconds']['total']:>6.2f}",
                flush=True,
            )
    print(f"\n{options.seeds} random seed sets, each seed moved by {options.move:g} mm and put back on the surface")
    for name, surface, seeds in atria[1:2] + atria[4:]:
        flattener = Flattener(surface)
        closed = flattener.flatten(seeds).cavity.closed
        rng = np.random.default_rng(0)
        folded = freed = 0
        seconds, refused = [], []
        for _ in range(options.seeds):
            try:
                flat_map = flattener.flatten(cases.moved(seeds, closed, options.move, rng))
            except SeedError as error:
                refused.append(str(error))
                continue
            folded += len(flat_map.folded_triangles)
            freed += len(flat_map.freed_path_points) > 0
            seconds.append(flat_map.seconds["total"])
        print(
            f"{name:<18} folded triangles {folded} in {len(seconds)} maps; {freed} maps with freed path points; "
            f"refused {len(refused)}; {np.median(seconds):.2f} s in the median, {max(seconds):.2f} s at worst",
            flush=True,
        )
        if folded:
            raise SystemExit(f"{folded} folded triangles on {name}")
        for reason in sorted(set(refused)):
            print(f"  refused: {reason}")


if __name__ == "__main__":
    main()
