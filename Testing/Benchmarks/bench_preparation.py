"""How near prepared atria come to the published and expert cuts, how sure the names are, and how long it takes.

python Testing/Benchmarks/bench_preparation.py
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from cases import DATA

from LAFlatteningLib import flatten, read_seeds, read_surface
from LAFlatteningLib.cavity.label_surface import label_surface
from LAFlatteningLib.errors import LAFlatteningError
from LAFlatteningLib.files import read_volume
from LAFlatteningLib.phantom import make_phantom
from LAFlatteningLib.preparation import Preparation, PrepareSettings, prepare
from LAFlatteningLib.surface import Surface


def rim_planes(surface: Surface) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Centre, normal and perimeter of each rim."""
    result = []
    for loop in surface.boundary_loops:
        points = surface.points[loop]
        centre = points.mean(axis=0)
        normal = np.cross(points - centre, np.roll(points, -1, axis=0) - centre).sum(axis=0)
        result.append((centre, normal / np.linalg.norm(normal), surface.loop_length(loop)))
    return result


def compare(name: str, prepared: Preparation, reference: Surface) -> None:
    """Print each opening beside the nearest rim of a reference."""
    assert prepared.plan is not None
    assert prepared.cavity is not None
    rims = rim_planes(reference)
    for opening, planned in prepared.plan.openings.items():
        rim = prepared.cavity.points[prepared.rims[opening]]
        centre, normal, perimeter = min(rims, key=lambda r: float(np.linalg.norm(r[0] - rim.mean(axis=0))))
        apart = rim.mean(axis=0) - centre
        angle = np.degrees(np.arccos(min(1.0, abs(float(normal @ planned.plane.normal)))))
        print(
            f"| {name} | {opening} | {abs(apart @ normal):.1f} | {np.linalg.norm(apart):.1f} | {angle:.0f} | "
            f"{prepared.cavity.loop_length(prepared.rims[opening]) / perimeter:.2f} |"
        )


def raw_atria(folder: Path | None) -> Iterator[tuple[str, Surface, PrepareSettings]]:
    """All raw atria: the phantom, and where there are any, the label maps."""
    yield "phantom", make_phantom(20000, closed=True).surface, PrepareSettings(points=0)
    for path in sorted(folder.glob("stacom2018/*laendo.nrrd")) if folder else ():
        yield path.name[:5], label_surface(read_volume(path)).surface, PrepareSettings(points=20000)


def main() -> None:
    """Print the tables."""
    folder = DATA if DATA.is_dir() else None
    if folder:
        print("| atrium | opening | along the vein, mm | in all, mm | angle, degrees | perimeter ratio |")
        print("|---|---|---|---|---|---|")
        for case, file, rims in (
            ("frf_demo", "surface.vtk", "clipped_veins_mitral.vtp"),
            ("pvi_gap", "surface.vtp", "cavity.vtp"),
            ("lasc_b002", "surface.vtp", "standardised.vtp"),
        ):
            surface, reference = read_surface(folder / case / file), read_surface(folder / case / rims)
            for keep in (3.0, 5.0):
                settings = PrepareSettings(0, keep, keep, ignore_axes=case == "lasc_b002")
                compare(f"{case}, found tips, {keep:g} mm", prepare(surface, settings), reference)
                tips = folder / case / "vein_tip_seeds.csv"
                if tips.exists():
                    given = prepare(surface, settings, tips=read_seeds(tips))
                    compare(f"{case}, given tips, {keep:g} mm", given, reference)
    print("\n| atrium | confidence | seconds | folds | beta | notes |\n|---|---|---|---|---|---|")
    for name, surface, settings in raw_atria(folder):
        began = time.perf_counter()
        try:
            result = prepare(surface, settings)
            seconds = time.perf_counter() - began
            assert result.cavity is not None
            assert result.plan is not None
            metrics = flatten(result.cavity, result.seeds).metrics
            print(
                f"| {name} | {result.plan.confidence} | {seconds:.1f} | {metrics['folded_triangles']} | "
                f"{metrics['beta']['mean']:.3f} | {' '.join(result.notes)} |"
            )
        except LAFlatteningError as error:
            print(f"| {name} | refused | {time.perf_counter() - began:.1f} | | | {error} |")


if __name__ == "__main__":
    main()
