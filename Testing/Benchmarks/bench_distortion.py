"""How much the maps distort, method by method: folds, dilatation, isotropy, areas, and the kink across the paths.

python Testing/Benchmarks/bench_distortion.py
"""

from __future__ import annotations

import cases
import numpy as np

from LAFlatteningLib import FlatMap, Flattener


def kinks(flat_map: FlatMap) -> np.ndarray:
    """How unlike the map is on either side of each edge of a path: the jump of its derivative across the path, over the
    mean of both; 0 where it is smooth."""
    division, flat = flat_map.division, flat_map.solution
    surface = division.surface
    edges = surface.edges
    n = len(surface.points)
    keys = edges.points[:, 0] * n + edges.points[:, 1]
    found = []
    for ids in division.paths.values():
        pairs = np.sort(np.stack([ids[:-1], ids[1:]], axis=1), axis=1)
        for edge in np.searchsorted(keys, pairs[:, 0] * n + pairs[:, 1]):
            sides = []
            a, b = edges.points[edge]
            along = surface.points[b] - surface.points[a]
            length = np.linalg.norm(along)
            for triangle in edges.triangles[edge]:
                if triangle < 0:
                    break
                c = int(np.setdiff1d(surface.triangles[triangle], [a, b])[0])
                to_c = surface.points[c] - surface.points[a]
                x = to_c @ along / length
                height = np.sqrt(max(to_c @ to_c - x * x, 1e-12))
                tangent = (flat[b] - flat[a]) / length
                sides.append((flat[c] - flat[a] - x * tangent) / height)
            if len(sides) == 2:
                # Seen from the edge the two triangles lie on opposite sides.
                jump = np.linalg.norm(sides[0] + sides[1])
                found.append(jump / (0.5 * (np.linalg.norm(sides[0]) + np.linalg.norm(sides[1]))))
    return np.array(found)


def main() -> None:
    """Print the table."""
    print(
        f"{'atrium':<18} {'method':<9} {'folded':>6} {'rim err':>8} {'path err':>8} {'beta':>6} {'K med':>6} "
        f"{'K p99':>6} {'K max':>7} {'entropy':>8} {'kink med':>9}"
    )
    for name, surface, seeds in [("phantom 20000", *cases.phantom(20000)), *cases.real()]:
        for method in ("paper", "regional"):
            flat_map = Flattener(surface, method=method, rounding="half-even").flatten(seeds)
            m, k = flat_map.metrics, flat_map.metrics["dilatation"]
            print(
                f"{name:<18} {method:<9} {m['folded_triangles']:>6} {m['rim_error']:>8.0e} {m['path_drift']:>8.0e} "
                f"{m['beta']['mean']:>6.3f} {k['median']:>6.2f} {k['p99']:>6.1f} {k['max']:>7.0f} "
                f"{m['alpha']['entropy']:>8.3f} {np.median(kinks(flat_map)):>9.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
