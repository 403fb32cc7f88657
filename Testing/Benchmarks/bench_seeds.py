"""What a small move of the seeds does to the map: noise, continuity, and the quick map beside the full one.

python Testing/Benchmarks/bench_seeds.py [--sets 20]
"""

from __future__ import annotations

import argparse
import time

import cases
import numpy as np

from LAFlatteningLib import Flattener, Surface


def noise(surface: Surface, seeds: cases.Seeds, sets: int) -> np.ndarray:
    """Displacement of all points, in disk radii, over seed sets of which every seed is moved by 1 mm."""
    flattener = Flattener(surface)
    given = flattener.flatten(seeds)
    rng = np.random.default_rng(0)
    medians = []
    for _ in range(sets):
        moved = {}
        for label, at in given.seeds.positions.items():
            step = rng.standard_normal(3)
            moved[label] = at + step / np.linalg.norm(step)
        other = flattener.flatten(moved)
        medians.append(np.linalg.norm(other.points - given.points, axis=1) / given.template.radius)
    return np.array(medians)


def continuity(surface: Surface, seeds: cases.Seeds, label: str) -> tuple[float, float]:
    """Mean and largest of 20 steps of the map (95th percentile of its points, disk radii) while a seed moves by 0.1 mm
    a step."""
    flattener = Flattener(surface)
    before = flattener.flatten(seeds)
    start = before.seeds.positions
    # Along the outer rim, or across the opening.
    towards = start["MV4"] if label == "MV3" else start["MV1"]
    direction = (towards - start[label]) / np.linalg.norm(towards - start[label])
    steps = []
    for k in range(1, 21):
        after = flattener.flatten({**start, label: start[label] + 0.1 * k * direction})
        step = np.linalg.norm(after.points - before.points, axis=1) / after.template.radius
        steps.append(np.percentile(step, 95))
        before = after
    return float(np.mean(steps)), float(np.max(steps))


def preview(surface: Surface, seeds: cases.Seeds) -> tuple[np.ndarray, list[float]]:
    """Seconds of quick maps while each seed in turn is moved by up to 3 mm, and for each seed the median distance from
    the quick map to the full one in the end, in disk radii."""
    flattener = Flattener(surface)
    given = flattener.flatten(seeds)
    flattener.preview(given.seeds.positions)
    seconds, apart = [], []
    for label, at in given.seeds.positions.items():
        centre = given.seeds.positions["RIPV" if label == "RSPV" else "RSPV"]
        direction = (centre - at) / np.linalg.norm(centre - at)
        for k in range(1, 11):
            moved = {**given.seeds.positions, label: at + 0.3 * k * direction}
            began = time.perf_counter()
            quick = flattener.preview(moved)
            seconds.append(time.perf_counter() - began)
        full = Flattener(surface).flatten(moved)
        apart.append(float(np.median(np.linalg.norm(quick.points - full.points, axis=1)) / full.template.radius))
    return np.array(seconds), apart


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=20, help="seed sets for the noise (default: %(default)s)")
    options = parser.parse_args()
    atria = [("phantom 20000", *cases.phantom(20000)), *cases.real()]
    print("Every seed moved by 1 mm: displacement of the map, in disk radii")
    for name, surface, seeds in atria:
        moved = noise(surface, seeds, options.sets)
        median, p95 = np.median(moved), np.percentile(moved, 95)
        print(f"{name:<18} median {median:.4f}  p95 {p95:.4f}", flush=True)
    print("\nOne seed moved in 20 steps of 0.1 mm: steps of the map (95th percentile of its points), in disk radii")
    for name, surface, seeds in atria:
        for label in ("LAA", "RIPV", "MV3"):
            mean, largest = continuity(surface, seeds, label)
            print(
                f"{name:<18} {label:<5} mean {mean:.4f}  largest {largest:.4f}  ratio {largest / mean:.1f}", flush=True
            )
    print("\nQuick maps while a seed is moved by up to 3 mm, and how far they are from the full map, in disk radii")
    for name, surface, seeds in atria:
        seconds, apart = preview(surface, seeds)
        print(
            f"{name:<18} {len(surface.points)} points: median {1e3 * np.median(seconds):.0f} ms, p95 "
            f"{1e3 * np.percentile(seconds, 95):.0f} ms; apart: median over seeds {np.median(apart):.4f}, worst seed "
            f"{max(apart):.4f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
