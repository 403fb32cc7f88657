"""Random seeds on meshes from 1,000 to 50,000 points: that no map folds, and the longest time.

python Testing/Benchmarks/bench_stress.py [--seeds 300] [--move 2.0] [--store FILE]

With a store (CSV), what is in it already is not done again, so that a run may be stopped and taken up later.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import cases
import numpy as np
import remeshed

from LAFlatteningLib import Flattener, LAFlatteningError, Surface

COLUMNS = ("mesh", "set", "folded", "freed", "seconds", "K p99", "refused")
TOGETHER = 10
"""So many sets on each mesh, then on the next one: a run that is stopped has done all meshes about alike."""


def meshes() -> Iterator[tuple[str, Surface, cases.Seeds]]:
    """Name, surface and seeds."""
    for size in (1000, 5000, 50000):
        yield f"phantom {size}", *cases.phantom(size)
    sizes = {"frf_demo": 2000, "pvi_gap": 10000, "ct_shape_model_1": 12639}
    for name, surface, seeds in cases.real():
        cavity = Flattener(surface).flatten(seeds).cavity.surface
        made = cavity if sizes[name] == len(cavity.points) else remeshed.remesh(cavity, sizes[name])
        yield f"{name} {len(made.points)}", made, seeds


def run(flattener: Flattener, closed: Surface, seeds: cases.Seeds, number: int, move: float) -> dict[str, object]:
    """One seed set: what `COLUMNS` say, times in seconds of the processor."""
    moved = cases.moved(seeds, closed, move, np.random.default_rng(number))
    began = time.process_time()
    try:
        flat_map = flattener.flatten(moved)
    except LAFlatteningError as error:
        return {"set": number, "refused": str(error)[:160]}
    seconds = time.process_time() - began
    return {
        "set": number,
        # Counted again here, with nothing of what made the map.
        "folded": int((signed_areas(flat_map.points, flat_map.triangles) <= 0.0).sum()),
        "freed": len(flat_map.freed_path_points),
        "seconds": round(seconds, 3),
        "K p99": round(flat_map.distortion_summary["dilatation"]["p99"], 2),
        "refused": "",
    }


def signed_areas(flat: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(m,), positive where a triangle turns counter-clockwise."""
    a, b, c = (flat[triangles[:, k]] for k in range(3))
    return 0.5 * np.linalg.det(np.stack([b - a, c - a], axis=1))


def table(rows: list[dict[str, str]]) -> None:
    """Print what was found on each mesh."""
    print(
        f"{'mesh':<24} {'maps':>5} {'folded':>7} {'freed':>6} {'refused':>8} {'median s':>9} {'worst s':>8} "
        f"{'K p99':>6}"
    )
    for name in dict.fromkeys(row["mesh"] for row in rows):
        own = [row for row in rows if row["mesh"] == name]
        made = [row for row in own if not row["refused"]]
        seconds = np.array([float(row["seconds"]) for row in made])
        print(
            f"{name:<24} {len(made):>5} {sum(int(row['folded']) for row in made):>7} "
            f"{sum(int(row['freed']) > 0 for row in made):>6} {len(own) - len(made):>8} {np.median(seconds):>9.2f} "
            f"{seconds.max():>8.2f} {max(float(row['K p99']) for row in made):>6.1f}"
        )
        for reason, count in Counter(row["refused"] for row in own if row["refused"]).items():
            print(f"  refused {count}: {reason}")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=300, help="random seed sets on each mesh (default: %(default)s)")
    parser.add_argument("--move", type=float, default=2.0, help="how far each seed moves, mm (default: %(default)s)")
    parser.add_argument("--store", type=Path, help="CSV file that results are added to as they come")
    options = parser.parse_args()
    rows: list[dict[str, str]] = []
    if options.store is not None and options.store.is_file():
        with options.store.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    done = {(row["mesh"], int(row["set"])) for row in rows}
    prepared = []
    for name, surface, seeds in meshes():
        flattener = Flattener(surface)
        prepared.append((name, flattener, flattener.flatten(seeds).cavity.closed, seeds))
    print(f"{options.seeds} random seed sets on each mesh, every seed moved by {options.move:g} mm")
    for start in range(0, options.seeds, TOGETHER):
        for name, flattener, closed, seeds in prepared:
            for number in range(start, min(start + TOGETHER, options.seeds)):
                if (name, number) in done:
                    continue
                found = {"mesh": name, **run(flattener, closed, seeds, number, options.move)}
                row = {column: str(found.get(column, "")) for column in COLUMNS}
                rows.append(row)
                if options.store is not None:
                    new = not options.store.exists()
                    with options.store.open("a", newline="", encoding="utf-8") as file:
                        writer = csv.DictWriter(file, COLUMNS)
                        if new:
                            writer.writeheader()
                        writer.writerow(row)
    table(rows)


if __name__ == "__main__":
    main()
