"""Sharp edges of a surface, and points moved onto them."""

from __future__ import annotations

import numpy as np

from . import operators
from .carrying import closest_points
from .surface import FloatArray, Surface

SHARP_COSINE = float(np.cos(np.radians(45.0)))
"""An edge at which the surface turns by more than the angle with this cosine (45 degrees) is a crease."""
ROUGH = 0.4
"""A surface with more creases, in edge lengths of the new mesh for each of its squares, is rough all over (steps of
voxels), rather than creased."""


def crease_samples(surface: Surface, edge_length: float) -> tuple[FloatArray, FloatArray]:
    """Places along the creases of a surface.

    Parameters
    ----------
    edge_length : mm, of the new mesh; places are at most half of it apart.

    Returns
    -------
    places : (k, 3) mm; none where the surface has no creases, or is rough all over.
    normals : (k, 2, 3) unit normals of the two sides.
    """
    edges = surface.edges
    vectors = operators.area_vectors(surface.points, surface.triangles)
    area = np.linalg.norm(vectors, axis=1)
    normals = vectors / np.maximum(area, 1e-300)[:, None]
    one, two = edges.triangles.T
    sharp = (edges.usage == 2) & (area[one] > 0) & (area[two] > 0)
    sharp &= np.einsum("ij,ij->i", normals[one], normals[two]) < SHARP_COSINE
    if surface.edge_lengths[sharp].sum() * edge_length > ROUGH * surface.area:
        sharp[:] = False
    count = np.ceil(surface.edge_lengths[sharp] / (0.5 * edge_length)).astype(np.int64)
    which = np.repeat(np.flatnonzero(sharp), count)
    first = np.repeat(np.cumsum(count) - count, count)
    share = (np.arange(len(which)) - first + 0.5) / np.repeat(count, count)
    a, b = surface.points[edges.points[which, 0]], surface.points[edges.points[which, 1]]
    return a + share[:, None] * (b - a), normals[edges.triangles[which]]


def sharpened(mesh: Surface, places: FloatArray, normals: FloatArray, farthest: float) -> FloatArray:
    """Points (n, 3) of a mesh, the ones nearest to creases moved onto them, and into their corners.

    Each place counts for the point nearest to it on the mesh, which goes where the sum of squared distances from the
    planes at its places is least, and no farther than `farthest` mm.

    Parameters
    ----------
    places, normals : what `crease_samples` returns.

    Source: Garland and Heckbert 1997, for the sum (quadric); as used by Valette et al. 2008 for creases.
    """
    points = mesh.points.copy()
    if len(places) == 0:
        return points
    closest = closest_points(mesh, places)
    owner = np.take_along_axis(mesh.triangles[closest.triangle], closest.weights.argmax(axis=1)[:, None], axis=1)[:, 0]
    ids, index = np.unique(owner, return_inverse=True)
    index = index.reshape(-1)
    matrix, right = np.zeros((len(ids), 3, 3)), np.zeros((len(ids), 3))
    for normal in (normals[:, 0], normals[:, 1]):
        offset = np.einsum("ij,ij->i", places - points[owner], normal)
        np.add.at(matrix, index, normal[:, :, None] * normal[:, None, :])
        np.add.at(right, index, offset[:, None] * normal)
    # Directions in which the planes hardly differ, as along a crease, stay free.
    step = np.einsum("kij,kj->ki", np.linalg.pinv(matrix, rcond=0.05, hermitian=True), right)
    size = np.linalg.norm(step, axis=1)
    points[ids] += step * np.minimum(1.0, farthest / np.maximum(size, 1e-300))[:, None]
    return points
