"""Small meshes with known geometry, for the tests."""

from __future__ import annotations

import numpy as np
from scipy.spatial import Delaunay

from LAFlatteningLib.flattening.refinement import Refinement
from LAFlatteningLib.operators import signed_areas
from LAFlatteningLib.surface import Surface


def icosphere(radius: float = 1.0, subdivisions: int = 3) -> Surface:
    """A sphere about the origin, outward oriented."""
    golden = (1 + 5**0.5) / 2
    points = [(-1, golden, 0), (1, golden, 0), (-1, -golden, 0), (1, -golden, 0)]
    points += [(0, -1, golden), (0, 1, golden), (0, -1, -golden), (0, 1, -golden)]
    points += [(golden, 0, -1), (golden, 0, 1), (-golden, 0, -1), (-golden, 0, 1)]
    triangles = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2)]
    triangles += [(10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5)]
    triangles += [(2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]
    p, t = np.array(points, float), np.array(triangles)
    for _ in range(subdivisions):
        edges = np.sort(np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]]), axis=1)
        unique, index = np.unique(edges, axis=0, return_inverse=True)
        a, b, c = (len(p) + index.reshape(3, -1)).astype(int)
        p = np.concatenate([p, p[unique].mean(axis=1)])
        t = np.concatenate(
            [
                np.stack([t[:, 0], a, c], 1),
                np.stack([t[:, 1], b, a], 1),
                np.stack([t[:, 2], c, b], 1),
                np.stack([a, b, c], 1),
            ]
        )
    return Surface(radius * p / np.linalg.norm(p, axis=1, keepdims=True), t)


def grid(nx: int = 6, ny: int = 5, width: float = 1.0, height: float = 1.0) -> Surface:
    """A flat rectangle in z = 0 with its corner at the origin, every square cut along the same diagonal."""
    x, y = np.meshgrid(np.linspace(0, width, nx), np.linspace(0, height, ny))
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    i = (np.arange(nx - 1)[None] + nx * np.arange(ny - 1)[:, None]).ravel()
    triangles = np.concatenate([np.stack([i, i + 1, i + nx + 1], 1), np.stack([i, i + nx + 1, i + nx], 1)])
    return Surface(points, triangles)


def cylinder(radius: float = 1.0, height: float = 2.0, around: int = 40, up: int = 20) -> Surface:
    """An open tube about the z axis, outward oriented."""
    flat = grid(around + 1, up + 1, 2 * np.pi, height)
    angle = flat.points[:, 0]
    points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), flat.points[:, 1]])
    seam = np.arange(len(points))
    seam[around :: around + 1] -= around
    part, _ = Surface(points, seam[flat.triangles]).submesh(np.ones(len(flat.triangles), bool))
    return part


def annulus(inner: float, outer: float, rings: int, around: int) -> Surface:
    """A flat ring about the origin in z = 0, counter-clockwise."""
    radii = np.linspace(inner, outer, rings)
    angles = 2 * np.pi * (np.arange(around)[None] + 0.5 * (np.arange(rings)[:, None] % 2)) / around
    points = np.stack([radii[:, None] * np.cos(angles), radii[:, None] * np.sin(angles), 0 * angles], 2).reshape(-1, 3)
    triangles = []
    for r in range(rings - 1):
        for k in range(around):
            a, b = r * around + k, r * around + (k + 1) % around
            c, d = a + around, b + around
            triangles += [(a, c, b), (b, c, d)] if r % 2 == 0 else [(a, c, d), (a, d, b)]
    return Surface(points, np.array(triangles))


def planar(points: np.ndarray, inside) -> Surface:
    """Delaunay triangulation of points (n, 2), keeping triangles whose centroid satisfies `inside`."""
    triangles = Delaunay(points).simplices.astype(np.int64)
    area = signed_areas(points, triangles)
    triangles[area < 0] = triangles[area < 0][:, ::-1]
    keep = (np.abs(area) > 1e-12) & inside(points[triangles].mean(axis=1))
    return Surface(np.column_stack([points, np.zeros(len(points))]), triangles[keep])


def jittered(nx: int = 8, ny: int = 7, seed: int = 0, amount: float = 0.3) -> Surface:
    """A flat rectangle of unit steps, its inner points shaken by up to `amount`, triangulated by Delaunay."""
    flat = grid(nx, ny, nx - 1.0, ny - 1.0).points[:, :2]
    inner = ((flat > 0) & (flat < [nx - 1, ny - 1])).all(axis=1)
    shake = np.random.default_rng(seed).uniform(-amount, amount, flat.shape)
    return planar(flat + inner[:, None] * shake, lambda centre: np.ones(len(centre), bool))


def pierced(size: float, n: int, holes: list[np.ndarray], seed: int = 0) -> Surface:
    """A flat square with its corner at the origin, n points a side, with convex polygons (k, 2) cut out of it."""
    step = size / (n - 1)
    flat = grid(n, n, size, size).points[:, :2]
    inner = ((flat > 0) & (flat < size)).all(axis=1)
    flat = flat + inner[:, None] * np.random.default_rng(seed).uniform(-0.25 * step, 0.25 * step, flat.shape)

    def outside(at: np.ndarray, margin: float) -> np.ndarray:
        clear = np.ones(len(at), bool)
        for hole in holes:
            along = np.roll(hole, -1, axis=0) - hole
            inward = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
            clear &= np.einsum("ijk,jk->ij", at[:, None] - hole, inward).min(axis=1) < -margin
        return clear

    rims = []
    for hole in holes:
        for a, b in zip(hole, np.roll(hole, -1, axis=0), strict=True):
            steps = max(1, round(np.linalg.norm(b - a) / step))
            rims.append(a + np.arange(steps)[:, None] / steps * (b - a))
    return planar(np.concatenate([flat[outside(flat, 0.4 * step)], *rims]), lambda centre: outside(centre, 0.0))


def tetrahedron(n: int = 6) -> tuple[Surface, np.ndarray]:
    """A regular tetrahedron of edge 1, n steps an edge, outward oriented; and where its points lie unfolded, (k, 2).

    It unfolds into a triangle of side 2. Two places p and q of it are joined by straight lines of the lengths
    ``|p - q - 2 l|`` and ``|p + q - 2 l|``, l in the lattice of the triangles with sides 1, and by no others.
    """
    high = np.sqrt(3.0) / 2.0
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, high], [2.0, 0.0], [1.5, high], [1.0, 2.0 * high]])
    solid = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1.0]]) / np.sqrt(8.0)
    # The corners of the large triangle are all the first corner of the tetrahedron.
    faces = [((0, 1, 2), (0, 1, 2)), ((1, 4, 2), (1, 3, 2)), ((1, 3, 4), (1, 0, 3)), ((2, 4, 5), (2, 3, 0))]
    points, flat, triangles = [], [], []
    for in_plane, in_space in faces:
        start = len(points)
        index = {}
        for i in range(n + 1):
            for j in range(n + 1 - i):
                weights = np.array([n - i - j, i, j]) / n
                index[i, j] = start + len(index)
                points.append(weights @ solid[list(in_space)])
                flat.append(weights @ corners[list(in_plane)])
        for i, j in index:
            if i + j < n:
                triangles.append((index[i, j], index[i + 1, j], index[i, j + 1]))
            if i + j < n - 1:
                triangles.append((index[i + 1, j], index[i + 1, j + 1], index[i, j + 1]))
    _, first, same = np.unique(np.round(points, 9), axis=0, return_index=True, return_inverse=True)
    surface = Surface(np.array(points)[first], same.reshape(-1)[np.array(triangles)])
    if surface.enclosed_volume < 0:
        surface = surface.with_triangles(surface.triangles[:, ::-1])
    return surface, np.array(flat)[first]


def tetrahedra_sharing_a_point() -> Surface:
    """Two closed surfaces that touch in one point: not a manifold there."""
    corners = np.array([[0, 0, 0], [40, 0, 0], [0, 40, 0], [0, 0, 40], [-40, 0, 0], [0, -40, 0], [0, 0, -40.0]])
    one = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    return Surface(corners, np.concatenate([one, np.where(one > 0, one + 3, 0)[:, ::-1]]))


def torus(major: float = 30.0, minor: float = 10.0, n: int = 24) -> Surface:
    """A closed surface of genus 1."""
    u, v = np.meshgrid(2 * np.pi * np.arange(n) / n, 2 * np.pi * np.arange(n) / n, indexing="ij")
    ring = major + minor * np.cos(v)
    points = np.stack([ring * np.cos(u), ring * np.sin(u), minor * np.sin(v)], 2).reshape(-1, 3)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    at = lambda a, b: (a % n) * n + b % n  # noqa: E731
    triangles = np.concatenate(
        [
            np.stack([at(i, j), at(i + 1, j), at(i + 1, j + 1)], 1),
            np.stack([at(i, j), at(i + 1, j + 1), at(i, j + 1)], 1),
        ]
    )
    return Surface(points, triangles)


def lowered(flat: np.ndarray, surface: Surface, movable: np.ndarray) -> np.ndarray:
    """A map (n, 2) without folds at its least distortion, at the scale that it has."""
    scale = float(np.sqrt(np.abs(signed_areas(flat, surface.triangles)).sum() / surface.area))
    return Refinement(flat, surface, movable, scale).lower(flat)
