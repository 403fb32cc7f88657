"""How far the surface of a label map is from the analytic phantom, and what it makes of real label maps.

python Testing/Benchmarks/bench_labels.py
"""

from __future__ import annotations

import time

import cases
import numpy as np

from LAFlatteningLib.cavity.label_surface import label_surface
from LAFlatteningLib.files import read_volume
from LAFlatteningLib.operators import area_vectors, cotangents
from LAFlatteningLib.phantom import PhantomShape, left_atrium_shape, make_label_map, mesh_phantom
from LAFlatteningLib.surface import Surface
from LAFlatteningLib.volume import Volume

IMAGES = (
    ((0.5, 0.5, 0.5), 0.0),
    ((0.625, 0.625, 1.25), 0.0),
    ((1.0, 1.0, 3.0), 0.0),
    ((2.0, 2.0, 2.0), 0.0),
    ((0.625, 0.625, 1.25), 0.6),
    ((0.625, 0.625, 1.25), 1.0),
    ((2.0, 2.0, 2.0), 0.5),
)
"""Voxel size, mm, and noise of the boundary, voxels."""


def on_veins(shape: PhantomShape, points: np.ndarray) -> np.ndarray:
    """Which points lie on the cylinders of the veins and the appendage."""
    offset = points - np.array(shape.centre)
    found = np.zeros(len(points), bool)
    for name in shape.tubes:
        opening = shape.openings[name]
        height = offset @ opening.axis
        across = np.linalg.norm(offset - height[:, None] * opening.axis, axis=1)
        found |= (height > opening.rim[1]) & (height < opening.top) & (across < 1.5 * opening.rim[0])
    return found


def tilt(shape: PhantomShape, surface: Surface) -> float:
    """Mean angle between the triangles and the analytic surface, weighted by area, degrees."""
    centres = surface.points[surface.triangles].mean(axis=1)
    step = 1e-3 * np.eye(3)
    normals = np.stack([shape.signed_distance(centres + e) - shape.signed_distance(centres - e) for e in step], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    areas = area_vectors(surface.points, surface.triangles)
    size = np.linalg.norm(areas, axis=1)
    angle = np.arccos(np.clip(np.einsum("ij,ij->i", areas, normals) / np.maximum(size, 1e-12), -1.0, 1.0))
    return float(np.degrees(np.average(angle, weights=size)))


def main() -> None:
    """Print the tables."""
    shape = left_atrium_shape()
    volume_ml = mesh_phantom(shape, 40000, closed=True).surface.enclosed_volume / 1000.0
    area_cm2 = shape.area(closed=True) / 100.0
    print(f"{'voxels, mm':<20} {'noise':>5} {'rms mm':>7} {'mean mm':>8} {'veins mm':>9} {'volume %':>9} {'area %':>7} "
          f"{'tilt deg':>8} {'points':>7} {'s':>5}")  # fmt: skip
    for spacing, noise in IMAGES:
        volume = Volume.from_image(make_label_map(shape, spacing, noise_voxels=noise, seed=1))
        began = time.perf_counter()
        made = label_surface(volume)
        seconds = time.perf_counter() - began
        distance = shape.signed_distance(made.surface.points)
        veins = distance[on_veins(shape, made.surface.points)]
        print(
            f"{' x '.join(f'{x:g}' for x in spacing):<20} {noise:>5} {np.sqrt(np.mean(distance**2)):>7.2f} "
            f"{distance.mean():>+8.3f} {veins.mean():>+9.3f} {100.0 * (made.volume_ml / volume_ml - 1.0):>+9.2f} "
            f"{100.0 * (made.area_cm2 / area_cm2 - 1.0):>+7.2f} {tilt(shape, made.surface):>8.1f} "
            f"{len(made.surface.points):>7} {seconds:>5.2f}",
            flush=True,
        )
    print(
        f"\n{'label map':<10} {'voxels ml':>9} {'ml':>7} {'cm2':>5} {'handles':>7} {'angle':>6} {'points':>7} {'s':>5}"
    )
    for path in sorted((cases.DATA / "stacom2018").glob("*_laendo.nrrd")):
        volume = read_volume(path)
        began = time.perf_counter()
        made = label_surface(volume)
        seconds = time.perf_counter() - began
        surface = made.surface
        smallest = np.degrees(np.arctan2(1.0, cotangents(surface.points, surface.triangles))).min()
        print(
            f"{path.name[:5]:<10} {np.count_nonzero(volume.values) * volume.voxel_volume / 1000.0:>9.1f} "
            f"{made.volume_ml:>7.1f} {made.area_cm2:>5.0f} {surface.genus:>7} {smallest:>6.1f} "
            f"{len(surface.points):>7} {seconds:>5.2f}  {' '.join(made.notes)}",
            flush=True,
        )


if __name__ == "__main__":
    main()
