"""What is read off the map, against what is known: projection, fibrosis, comparison; and how long a projection takes.

python Testing/Benchmarks/bench_analyses.py
"""

from __future__ import annotations

import time

import cases
import numpy as np
from remeshed import carried, remesh

from LAFlatteningLib import flatten, make_phantom, read_seeds, read_surface
from LAFlatteningLib.blood_pool import find_blood_pool
from LAFlatteningLib.comparison import compare_maps
from LAFlatteningLib.fibrosis import Rule, measure_fibrosis
from LAFlatteningLib.phantom import left_atrium_shape, make_lge_volume
from LAFlatteningLib.projection import project
from LAFlatteningLib.volume import Volume


def projection_time() -> None:
    """Seconds of one projection of 20,000 points, at the voxels of a clinical image."""
    phantom = make_phantom(20000)
    image = Volume.from_image(make_lge_volume(phantom.shape))
    seconds = []
    for _ in range(7):
        began = time.perf_counter()
        project(phantom.surface, image)
        seconds.append(time.perf_counter() - began)
    print(f"projection of 20,000 points, 3 mm both sides, voxels 0.625 x 0.625 x 1.25 mm: {1000 * min(seconds):.0f} ms")


def fibrosis_error() -> None:
    """Largest error of a region, percentage points, with the threshold off the middle of the edge of scar."""
    shape = left_atrium_shape()
    truth = shape.scar_fractions()
    image = Volume.from_image(make_lge_volume(shape, noise=2.0))
    print("scar of the phantom, default model (blood 100, scar 170, threshold 120); largest error of a region, points")
    for points in (5000, 10000, 20000, 40000):
        phantom = make_phantom(points)
        surface = phantom.surface.with_data(cell_data={"region": phantom.surface.cell_data["true_region"]})
        pool = find_blood_pool(surface, image)
        errors = []
        projected = project(surface, image).on(surface)
        for made, volume in ((surface, None), (projected, None), (projected, image)):
            found = measure_fibrosis(made, "LGE", Rule.parse("iir=1.2"), pool, volume=volume)
            errors.append(max(abs(found.part("region", r).beyond_percent - 100 * truth[r]) for r in truth))
        print(
            f"  {points:6} points: {errors[0]:.2f} from the analytic array, {errors[1]:.2f} from the image at the "
            f"points, {errors[2]:.2f} from the image within the triangles"
        )


def remeshings() -> None:
    """Two triangulations of one real atrium: agreement of the maps of its enhancement."""
    folder = cases.DATA / "frf_demo"
    if not folder.is_dir():
        print("frf_demo is not here: no comparison of two meshes of a real atrium")
        return
    surface, seeds = read_surface(folder / "cavity.vtp"), read_seeds(folder / "seeds_operator1.csv")
    values = surface.point_data["scalars"].astype(np.float64)[:, None]
    maps = []
    for points in (15000, 25000):
        other = remesh(surface, points)
        maps.append(flatten(other.with_data({"scalars": carried(surface, values, other.points)[:, 0]}), seeds))
    found = compare_maps(maps[0], maps[1], "scalars", "scalars", 101.0, 101.0)
    print("frf_demo at about 15,000 and 25,000 points, LGE, same seeds")
    for part in found.parts:
        print(f"  {part.name}: r {part.pearson:.4f}, rho {part.spearman:.4f}, Dice {part.dice:.3f}")


if __name__ == "__main__":
    projection_time()
    fibrosis_error()
    remeshings()
