"""Geometry of triangles: areas, normals, cotangents, Laplacian, mass, gradients.

Plain functions on arrays: ``points`` (n, 2) or (n, 3) in any length unit, ``triangles`` (m, 3).
`LAFlatteningLib.surface.Surface` caches what they return.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    # Written out: several times faster than np.cross on many short vectors.
    return np.stack(
        [
            a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1],
            a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2],
            a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0],
        ],
        axis=1,
    )


def area_vectors(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Normal of each triangle, (m, 3), as long as the triangle's area; `points` is (n, 3)."""
    a, b, c = (np.ascontiguousarray(ids) for ids in triangles.T)
    # An axis at a time, contiguous: half the time of whole rows.
    first, second = [], []
    for one in points.T:
        axis = np.ascontiguousarray(one)
        start = axis[a]
        first.append(axis[b] - start)
        second.append(axis[c] - start)
    (ux, uy, uz), (vx, vy, vz) = first, second
    result = np.empty((len(triangles), 3))
    result[:, 0] = uy * vz - uz * vy
    result[:, 1] = uz * vx - ux * vz
    result[:, 2] = ux * vy - uy * vx
    result *= 0.5
    return result


def signed_areas(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Area of each triangle of a *flat* mesh, (m,), positive where it turns counter-clockwise; `points` is (n, 2)."""
    ids = [np.ascontiguousarray(corner) for corner in triangles.T]
    # An axis at a time, contiguous: a quarter of the time of whole rows.
    (ux, vx), (uy, vy) = (
        (axis.take(ids[1]) - axis.take(ids[0]), axis.take(ids[2]) - axis.take(ids[0]))
        for axis in (np.ascontiguousarray(points[:, 0]), np.ascontiguousarray(points[:, 1]))
    )
    return 0.5 * (ux * vy - vx * uy)


def triangle_areas(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Area of each triangle, (m,), never negative; `points` is (n, 2) or (n, 3)."""
    if points.shape[1] == 2:
        return np.abs(signed_areas(points, triangles))
    return np.linalg.norm(area_vectors(points, triangles), axis=1)


def signed_volume(points: FloatArray, triangles: IntArray) -> float:
    """Volume enclosed by a closed surface, positive if its triangles turn counter-clockwise seen from outside."""
    corner = (points - points.mean(axis=0))[triangles]
    return float(np.einsum("ij,ij->", corner[:, 0], _cross(corner[:, 1], corner[:, 2])) / 6.0)


def cotangents(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Cotangent of the angle at each corner, (m, 3); see `corner_cotangents`."""
    return corner_cotangents(points[triangles])


def corner_cotangents(corners: FloatArray) -> FloatArray:
    """Cotangent of the angle at each corner of separate triangles (m, 3, 2) or (m, 3, 3), (m, 3).

    Angles are unsigned, between 0 and pi, also where a flat triangle is folded over. A triangle without area
    has no angles; its cotangents are kept finite by giving it the area 1e-10 times its longest side squared.
    """
    # Side k is opposite corner k.
    sides = [corners[:, (k + 2) % 3] - corners[:, (k + 1) % 3] for k in range(3)]
    squared = np.stack([np.einsum("mi,mi->m", side, side) for side in sides], axis=1)
    if corners.shape[2] == 2:
        twice_area = np.abs(sides[0][:, 0] * sides[1][:, 1] - sides[0][:, 1] * sides[1][:, 0])
    else:
        twice_area = np.linalg.norm(_cross(sides[0], sides[1]), axis=1)
    floor = 1e-10 * squared.max(axis=1)
    twice_area = np.maximum(twice_area, np.where(floor > 0, floor, 1.0))
    # cot(corner k) = (|i|^2 + |j|^2 - |k|^2) / (4 area), the law of cosines over the law of sines.
    return (squared.sum(axis=1, keepdims=True) - 2.0 * squared) / (2.0 * twice_area[:, None])


def laplacian_from_cotangents(cotangent: FloatArray, triangles: IntArray, n: int) -> sparse.csr_matrix:
    """The sparse (n, n) matrix with -(cot a + cot b)/2 at (i, j) for each edge and rows that sum to 0."""
    i = triangles[:, [1, 2, 0]].reshape(-1)
    j = triangles[:, [2, 0, 1]].reshape(-1)
    half = 0.5 * cotangent.reshape(-1)
    weight = sparse.coo_matrix(
        (np.concatenate([half, half]), (np.concatenate([i, j]), np.concatenate([j, i]))), shape=(n, n)
    ).tocsr()
    return (sparse.diags(np.asarray(weight.sum(axis=1)).ravel()) - weight).tocsr()


def cotangent_laplacian(points: FloatArray, triangles: IntArray) -> sparse.csr_matrix:
    """The cotangent Laplacian (stiffness matrix of linear finite elements).

    Returns
    -------
    (n, n) sparse, symmetric, *positive* semi-definite: the entry of edge (i, j) is -(cot a + cot b)/2 with a, b
    the angles opposite the edge (one at a rim); rows sum to 0. ``x @ L @ x`` is the Dirichlet energy of x, in
    units of x squared (it does not depend on the unit of length).

    Source: Pinkall and Polthier 1993.

    Examples
    --------
    >>> import numpy as np
    >>> square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> L = cotangent_laplacian(square, np.array([[0, 1, 2], [0, 2, 3]]))
    >>> float(square[:, 0] @ L @ square[:, 0])
    1.0
    """
    return laplacian_from_cotangents(cotangents(points, triangles), triangles, len(points))


def lumped_mass(points: FloatArray, triangles: IntArray) -> FloatArray:
    """A third of the area round each point, (n,); sums to the area of the mesh."""
    area = triangle_areas(points, triangles)
    return np.bincount(triangles.reshape(-1), np.repeat(area / 3.0, 3), minlength=len(points)).astype(np.float64)


def point_normals(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Unit normal at each point, (n, 3), averaged over its triangles by area; 0 where there is none."""
    vectors = area_vectors(points, triangles)
    total = np.zeros((len(points), 3))
    for axis in range(3):
        total[:, axis] = np.bincount(triangles.reshape(-1), np.repeat(vectors[:, axis], 3), minlength=len(points))
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.divide(total, length, out=np.zeros_like(total), where=length > 0)


def local_frames(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Corners of each triangle in an orthonormal frame of its own plane, (m, 3, 2).

    Corner 0 is at the origin, corner 1 on the positive x axis, corner 2 above it.
    """
    corner = points[triangles]
    u, v = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    length = np.linalg.norm(u, axis=1)
    safe = np.where(length > 0, length, 1.0)
    flat = np.zeros((len(triangles), 3, 2))
    flat[:, 1, 0] = length
    flat[:, 2, 0] = np.einsum("ij,ij->i", u, v) / safe
    flat[:, 2, 1] = 2.0 * triangle_areas(points, triangles) / safe
    return flat


def jacobians(points: FloatArray, triangles: IntArray, flat: FloatArray) -> FloatArray:
    """Jacobian of the map surface -> plane on each triangle, (m, 2, 2), in the frames of `local_frames`.

    Parameters
    ----------
    points : (n, 3) on the surface.
    flat : (n, 2) in the plane.

    Triangles without area on the surface get NaN.
    """
    local = local_frames(points, triangles)
    image = flat[triangles]
    edges_image = np.stack([image[:, 1] - image[:, 0], image[:, 2] - image[:, 0]], axis=2)
    x1, x2, y2 = local[:, 1, 0], local[:, 2, 0], local[:, 2, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        first = edges_image[:, :, 0] / x1[:, None]
        second = (edges_image[:, :, 1] - first * x2[:, None]) / y2[:, None]
    jacobian = np.stack([first, second], axis=2)
    jacobian[~np.isfinite(jacobian).all(axis=(1, 2))] = np.nan
    return jacobian


def singular_values(jacobian: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Largest and smallest singular value of each 2 x 2 matrix of (m, 2, 2), both (m,), the smallest
    negative where the matrix reverses orientation."""
    a, b, c, d = jacobian[:, 0, 0], jacobian[:, 0, 1], jacobian[:, 1, 0], jacobian[:, 1, 1]
    # Closed form: radii of the conformal and the anti-conformal part.
    conformal = 0.5 * np.hypot(a + d, c - b)
    anticonformal = 0.5 * np.hypot(a - d, c + b)
    return conformal + anticonformal, conformal - anticonformal
