"""Other triangulations of one atrium, made by a library that is not ours."""

from __future__ import annotations

import warnings

import numpy as np
import pyacvd
import pyvista
from vtkmodules.vtkCommonCore import reference
from vtkmodules.vtkCommonDataModel import vtkGenericCell, vtkStaticCellLocator

from LAFlatteningLib import Surface


def remesh(surface: Surface, points: int, uniform: bool = True) -> Surface:
    """The same shape with about another number of points, rims on the rims that were.

    Spread evenly (Valette et al. 2008), or unevenly: large triangles where it is flat, small and long ones where it
    is curved (quadric error decimation).
    """
    dense = pyvista.wrap(surface.to_polydata()).copy()
    dense.clear_data()
    times = 0
    while len(surface.points) * 4**times < 4 * points:
        times += 1
    if uniform:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            clustering = pyacvd.Clustering(dense)
            if times:
                clustering.subdivide(times)
            clustering.cluster(points)
            made = clustering.create_mesh()
    else:
        made = dense.subdivide(times, "linear") if times else dense
        made = made.decimate(1.0 - points / made.n_points)
    made = made.extract_largest().clean()
    new = Surface(np.array(made.points, np.float64), np.array(made.regular_faces, np.int64), space=surface.space)
    moved = new.points.copy()
    for loop in new.boundary_loops:
        moved[loop] = _on_rims(surface, new.points[loop])
    return Surface(moved, new.triangles, space=surface.space)


def _on_rims(surface: Surface, points: np.ndarray) -> np.ndarray:
    """The places on the rims of a surface nearest to points (k, 3)."""
    best = np.full(len(points), np.inf)
    result = points.copy()
    for loop in surface.boundary_loops:
        start = surface.points[loop]
        step = np.roll(start, -1, axis=0) - start
        t = np.einsum("pij,ij->pi", points[:, None] - start[None], step) / np.einsum("ij,ij->i", step, step)
        places = start[None] + np.clip(t, 0.0, 1.0)[:, :, None] * step[None]
        distance = np.linalg.norm(places - points[:, None], axis=2)
        nearest = distance.argmin(axis=1)
        closer = distance.min(axis=1) < best
        best[closer] = distance.min(axis=1)[closer]
        result[closer] = places[np.arange(len(points)), nearest][closer]
    return result


def carried(surface: Surface, values: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Values (n, k) at the points of a surface, at the places on it nearest to other points (p, 3)."""
    locator = vtkStaticCellLocator()
    locator.SetDataSet(surface.to_polydata())
    locator.BuildLocator()
    result = np.empty((len(points), values.shape[1]))
    nearest, cell, sub, distance = [0.0, 0.0, 0.0], reference(0), reference(0), reference(0.0)
    for k, point in enumerate(points):
        locator.FindClosestPoint(point, nearest, vtkGenericCell(), cell, sub, distance)
        corners = surface.triangles[int(cell)]
        a, b, c = surface.points[corners]
        inside = np.linalg.lstsq(np.stack([b - a, c - a], axis=1), np.array(nearest) - a, rcond=None)[0]
        result[k] = np.array([1.0 - inside.sum(), *inside]) @ values[corners]
    return result


def spread(surface: Surface, count: int, seed: int = 0) -> np.ndarray:
    """About so many points of the surface, evenly by area."""
    rng = np.random.default_rng(seed)
    triangle = rng.choice(len(surface.triangles), count, p=surface.triangle_areas / surface.area)
    weight = rng.dirichlet((1.0, 1.0, 1.0), count)
    return np.einsum("ij,ijk->ik", weight, surface.points[surface.triangles[triangle]])
