"""The unfolded atrium after Ma et al.: distances on the map proportional to distances on the surface, by a B-spline."""

from __future__ import annotations

import time

import numpy as np
from scipy import sparse
from scipy.interpolate import BSpline
from scipy.optimize import minimize
from scipy.sparse.csgraph import dijkstra

from ..flattening.flat_map import FlatMap
from ..half_edges import HalfEdges
from ..progress import ProgressCallback, report
from ..surface import FloatArray, IntArray, Surface
from ..textures import spread_points
from .conformal import conformal_disk
from .peer_map import OuterRim, PeerMap, whole_cavity

SAMPLES = 250
"""Points between all pairs of which distances are compared."""
SPANS = 8
"""Intervals of the B-spline along each side of the plane that it bends."""
DEGREE = 3
STIFFNESS = 0.02
"""Weight of the second differences of the control points, in mean distances, which keeps the plane from creasing."""
SOURCE = (
    "Ma et al., Cardiac unfold: a novel technique for image-guided cardiac catheterization procedures, IPCAI 2012; as "
    "Nunez-Garcia et al. describe it"
)


def distance_map(flat_map: FlatMap, progress: ProgressCallback | None = None) -> PeerMap:
    """The atrium, its veins covered, unfolded so that distances are as nearly proportional as a B-spline makes them.

    Parameters
    ----------
    flat_map : our map of the atrium, for its cavity, covers and seeds.

    Returns
    -------
    PeerMap in mm, without fixed places and without a fixed outline.

    Notes
    -----
    Known of the source here: a B-spline, and distances between pairs of points of surface and map in proportion.
    Chosen here: the spline (cubic, `SPANS` by `SPANS`) bends the conformal disk, its radii first changed so that each
    disk about the centre holds its share of the area; distances run along edges and across pairs of triangles of the
    covered surface, between `SAMPLES` points spread over it; the sum of squares of the logarithm of map distance over
    surface distance is made least (L-BFGS). (With differences in place of logarithms, the least sum is that of a
    flattened bag, front and back on each other.)

    Raises
    ------
    Cancelled : by `progress`.
    """
    report(progress, 0.0, "Measuring distances")
    began = time.perf_counter()
    cavity, rim = flat_map.cavity, OuterRim.of(flat_map)
    closed = cavity.closed
    disk = equal_area_disk(conformal_disk(closed.laplacian, closed.mass, cavity.ids[rim.ids], rim.turns), closed.mass)
    samples = spread_points(closed, min(SAMPLES, len(closed.points)))
    distance = distances(closed, samples)
    report(progress, 0.4, "Bending the plane")
    weights = spline_weights(disk)
    control = proportional(weights[samples], distance, np.sqrt(closed.area / np.pi) * control_grid())
    flat = weights @ control
    seconds = time.perf_counter() - began + flat_map.seconds["cavity"]
    report(progress, 1.0, "Unfolded")
    return whole_cavity(
        flat_map,
        "distances",
        "proportional distances (Ma et al.)",
        flat[cavity.ids],
        seconds,
        SOURCE,
        ("From where the B-spline starts, its size and the pairs of points are our choice.",),
    )


def equal_area_disk(disk: FloatArray, mass: FloatArray) -> FloatArray:
    """Places (n, 2) in the unit disk with new radii: the disk inside each holds its share of the mass (n,)."""
    radius = np.linalg.norm(disk, axis=1)
    order = np.argsort(radius, kind="stable")
    share = np.empty(len(disk))
    share[order] = (np.cumsum(mass[order]) - 0.5 * mass[order]) / mass.sum()
    on_rim = radius > 1.0 - 1e-9
    share[on_rim] = 1.0
    return disk * (np.sqrt(share) / np.maximum(radius, 1e-300))[:, None]


def distances(surface: Surface, samples: IntArray) -> FloatArray:
    """(k, k) mm between some points (k,) of a surface, along edges and across pairs of triangles."""
    graph = HalfEdges.of(surface).near_graph()
    # Row by row: all rows at once would hold 250 numbers a point.
    return np.stack([dijkstra(graph, indices=sample)[samples] for sample in samples])


def spline_weights(disk: FloatArray) -> sparse.csr_matrix:
    """(n, c) weights of the control points at places (n, 2) of the square from -1 to 1: products of B-splines."""
    step = 2.0 / SPANS
    knots = -1.0 + step * np.arange(-DEGREE, SPANS + DEGREE + 1)
    at = np.clip(disk, -1.0, 1.0)
    x, y = (BSpline.design_matrix(at[:, k], knots, DEGREE).tocsr() for k in (0, 1))
    each, n = SPANS + DEGREE, len(disk)
    # Each row of x and y has degree + 1 entries: all products of them.
    column = x.indices.reshape(n, -1)[:, :, None] * each + y.indices.reshape(n, -1)[:, None, :]
    value = x.data.reshape(n, -1)[:, :, None] * y.data.reshape(n, -1)[:, None, :]
    start = np.arange(n + 1) * column[0].size
    return sparse.csr_matrix((value.reshape(-1), column.reshape(-1), start), shape=(n, each * each))


def control_grid() -> FloatArray:
    """(c, 2) the control points with which the B-spline leaves every place where it is."""
    along = -1.0 + 2.0 / SPANS * (np.arange(SPANS + DEGREE) - 0.5 * (DEGREE - 1))
    return np.stack(np.meshgrid(along, along, indexing="ij"), axis=-1).reshape(-1, 2)


def proportional(weights: sparse.csr_matrix, distance: FloatArray, start: FloatArray) -> FloatArray:
    """Control points (c, 2) with which the distances of samples on the map are nearest to those on the surface.

    Parameters
    ----------
    weights : (k, c) of the control points at the samples.
    distance : (k, k) between the samples on the surface.
    start : (c, 2) control points to begin with.
    """
    first, second = np.triu_indices(len(distance), 1)
    wanted = np.maximum(distance[first, second], 1e-9)
    scale = float(wanted.mean())
    each = SPANS + DEGREE
    bends = sparse.diags([1.0, -2.0, 1.0], [0, 1, 2], shape=(each - 2, each))
    bends = sparse.vstack([sparse.kron(bends, sparse.identity(each)), sparse.kron(sparse.identity(each), bends)])
    stiff = (STIFFNESS / scale**2 * (bends.T @ bends)).tocsr()

    def value(flat: FloatArray) -> tuple[float, FloatArray]:
        control = flat.reshape(-1, 2)
        places = weights @ control
        between = places[first] - places[second]
        length = np.linalg.norm(between, axis=1)
        length = np.maximum(length, 1e-9 * scale)
        miss = np.log(length / wanted)
        pull = (2.0 * miss / length**2)[:, None] * between
        at_samples = np.zeros_like(places)
        for axis in (0, 1):
            at_samples[:, axis] = np.bincount(first, pull[:, axis], len(places))
            at_samples[:, axis] -= np.bincount(second, pull[:, axis], len(places))
        held = stiff @ control
        bent = float((control * held).sum())
        return float(miss @ miss) / len(wanted) + bent, (weights.T @ at_samples / len(wanted) + 2.0 * held).reshape(-1)

    found = minimize(value, start.reshape(-1), jac=True, method="L-BFGS-B", options={"maxiter": 500})
    return np.asarray(found.x).reshape(-1, 2)
