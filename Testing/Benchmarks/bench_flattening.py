"""How long a map takes, stage by stage, how that grows, and what the textbook way takes in the same run.

make bench      or      python Testing/Benchmarks/bench_flattening.py [--sizes 5000,20000] [--repeat 3]
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path

import cases
import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from LAFlatteningLib import Flattener, operators
from LAFlatteningLib.constraints import Constraints, constraints_by_count
from LAFlatteningLib.division import divide_as_published
from LAFlatteningLib.flattening import FlatMap
from LAFlatteningLib.seed_paths import WaysOverCovers, connect_seeds
from LAFlatteningLib.solvers import Factorisation, solver_name

STAGES = ("cavity", "division", "coarse map", "solve", "untangle", "refine", "total")


def timed(points: int, repeat: int, method: str) -> tuple[dict[str, float], FlatMap]:
    """Median seconds of each stage over fresh flatteners, and the last map."""
    surface, seeds = cases.phantom(points)
    runs = []
    for _ in range(repeat):
        fresh = type(surface)(surface.points, surface.triangles)
        flat_map = Flattener(fresh, method=method).flatten(seeds)
        runs.append(flat_map.seconds)
    return {stage: float(np.median([run.get(stage, 0.0) for run in runs])) for stage in STAGES}, flat_map


def textbook_division(flat_map: FlatMap) -> tuple[Constraints, float]:
    """The published paths and their targets, and processor seconds for them."""
    began = time.process_time()
    ways = WaysOverCovers(flat_map.cavity)
    connected = connect_seeds(flat_map.cavity, flat_map.seeds, flat_map.template.anatomy, ways)
    division = divide_as_published(flat_map.cavity.surface, connected, flat_map.template, "half-even")
    return constraints_by_count(division, flat_map.template, as_printed=False), time.process_time() - began


def textbook(flat_map: FlatMap, constraints: Constraints) -> float:
    """Processor seconds for equations 3-6 as they stand in the paper: a saddle-point matrix with multipliers and one
    spsolve a coordinate (scipy's default order of elimination), then one spsolve a coordinate for the refinement."""
    surface = flat_map.surface
    n, p = len(surface.points), len(constraints.path_ids)
    began = time.process_time()

    def system(laplacian: sparse.csr_matrix) -> sparse.csr_matrix:
        keep = np.ones(n)
        keep[constraints.rim_ids] = 0.0
        return (sparse.diags(keep) @ laplacian + sparse.diags(1.0 - keep)).tocsr()

    matrix = system(2.0 * operators.cotangent_laplacian(surface.points, surface.triangles))
    picks = sparse.csr_matrix((np.ones(p), (np.arange(p), constraints.path_ids)), shape=(p, n))
    # w = 1000, as in the paper.
    saddle = sparse.bmat([[1e6 * matrix.T @ matrix, picks.T], [picks, None]], format="csc")
    first = np.empty((n, 2))
    targets = np.zeros((n, 2))
    targets[constraints.rim_ids] = constraints.rim_targets
    for axis in (0, 1):
        right = np.concatenate([1e6 * matrix.T @ targets[:, axis], constraints.path_targets[:, axis]])
        first[:, axis] = spsolve(saddle, right)[:n]
    refined = system(operators.cotangent_laplacian(first, surface.triangles)).tocsc()
    for axis in (0, 1):
        spsolve(refined, targets[:, axis])
    return time.process_time() - began


def numeric_factorisations(flat_map: FlatMap, published: Constraints) -> tuple[float, float]:
    """Processor seconds for one numeric factorisation, with the order of elimination known: of the least squares of the
    paper (equations 3-4, paths eliminated), and of the Laplacian alone with rims and paths eliminated."""
    surface = flat_map.surface
    free = np.setdiff1d(np.arange(len(surface.points)), published.path_ids)
    keep = np.ones(len(surface.points))
    keep[published.rim_ids] = 0.0
    system = (sparse.diags(keep) @ (2.0 * surface.laplacian) + sparse.diags(1.0 - keep)).tocsc()[:, free]
    cut = flat_map.division.surface
    inner = np.setdiff1d(np.arange(len(cut.points)), flat_map.constraints.ids)
    seconds = []
    for matrix in ((system.T @ system).tocsc(), cut.laplacian[inner][:, inner].tocsc()):
        order = Factorisation(matrix).order
        ordered = matrix[:, order][order].tocsc()
        runs = []
        for _ in range(3):
            began = time.process_time()
            Factorisation(ordered, in_order=True)
            runs.append(time.process_time() - began)
        seconds.append(min(runs))
    return seconds[0], seconds[1]


def spent(flattener: Flattener, seeds: cases.Seeds) -> tuple[float, FlatMap]:
    """Processor seconds for a map, and the map."""
    began = time.process_time()
    flat_map = flattener.flatten(seeds)
    return time.process_time() - began, flat_map


def peak_memory(points: int) -> None:
    """Print the peak memory of a process that makes and maps one phantom, and of making the phantom alone."""
    # Of this process alone: what `resource` says includes the process that started it.
    code = """
import pathlib, sys
sys.path.insert(0, sys.argv[1])
import cases
from LAFlatteningLib import Flattener
def peak():
    lines = pathlib.Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM"))
surface, seeds = cases.phantom(int(sys.argv[2]))
alone = peak()
Flattener(surface).flatten(seeds)
print(peak(), alone)
"""
    if not Path("/proc/self/status").exists():
        print("peak memory: only measured on Linux")
        return
    output = subprocess.run(
        [sys.executable, "-c", code, sys.path[0], str(points)], check=True, capture_output=True, text=True
    ).stdout.split()
    print(f"peak memory at {points} points: {float(output[0]):.0f} MB (the phantom alone: {float(output[1]):.0f} MB)")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", default="5000,10000,20000,50000,100000,200000")
    parser.add_argument("--repeat", type=int, default=3)
    options = parser.parse_args()
    sizes = [int(size) for size in options.sizes.split(",")]

    print(f"Linear solver: {solver_name()}")
    print("Seconds from surface and seeds to map, method regional, phantom (median of repeated runs)")
    print(f"{'points':>8} " + " ".join(f"{stage:>10}" for stage in STAGES) + f" {'growth':>7}")
    totals: list[float] = []
    for size in sizes:
        seconds, flat_map = timed(size, options.repeat if size <= 50000 else 1, "regional")
        totals.append(seconds["total"])
        growth = ""
        if len(totals) > 1:
            previous = sizes[len(totals) - 2]
            growth = f"N^{np.log(totals[-1] / totals[-2]) / np.log(size / previous):.2f}"
        print(f"{size:>8} " + " ".join(f"{seconds[stage]:>10.3f}" for stage in STAGES) + f" {growth:>7}", flush=True)
        if len(flat_map.folded_triangles):
            raise SystemExit(f"{len(flat_map.folded_triangles)} folded triangles at {size} points")
    if len(totals) > 1:
        slope = np.polyfit(np.log(sizes), np.log(totals), 1)[0]
        print(f"growth over all sizes: N^{slope:.2f}")

    size = 20000
    print(f"\nAgainst the textbook way (saddle-point matrix, one spsolve a coordinate), {size} points, run in turn,")
    print("processor seconds; covers are kept, so that all of these are from seeds to map")
    surface, seeds = cases.phantom(size)
    flattener = Flattener(surface)
    flat_map = flattener.flatten(seeds)
    rows = []
    for number in range(options.repeat):
        places = cases.moved(seeds, flat_map.cavity.closed, 1.0, np.random.default_rng(number))
        all_seeds, flat_map = spent(flattener, places)
        constraints, paths = textbook_division(flat_map)
        solves = textbook(flat_map, constraints)
        one_seed, _ = spent(flattener, {**places, "RIPV": seeds["RIPV"]})
        squares, alone = numeric_factorisations(flat_map, constraints)
        rows.append((paths, solves, all_seeds, one_seed, squares, alone))
        print(
            f"textbook: paths {paths:.3f}, solves {solves:.2f}; regional: all seeds moved {all_seeds:.2f}, one seed "
            f"{one_seed:.2f}; numeric factorisation of the paper's least squares {squares:.3f}, of the Laplacian "
            f"{alone:.3f}"
        )
    paths, solves, all_seeds, one_seed, squares, alone = np.median(np.array(rows), axis=0)
    slow = paths + solves
    print(
        f"medians: regional {slow / all_seeds:.1f} times faster than the textbook way where all seeds moved, "
        f"{slow / one_seed:.1f} times where one did; {all_seeds / squares:.1f} times the numeric factorisation of the "
        f"paper's least squares, {all_seeds / alone:.0f} times that of the Laplacian"
    )

    seconds, _ = timed(size, options.repeat, "paper")
    print(f"method paper at {size} points: " + ", ".join(f"{k} {v:.3f} s" for k, v in seconds.items() if v))
    print()
    peak_memory(200000)


if __name__ == "__main__":
    main()
