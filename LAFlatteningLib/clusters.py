"""Thinning out a mesh in one go: clusters of points round chosen ones are made single points.

What clusters of points leave of a mesh, a triangle for each of its triangles that meets three of them, is the same
surface if every cluster is a disk, every two neighbours meet in one line and every three in one place (the closed ball
property, Edelsbrunner and Shah 1997). Clusters that break a rule are taken apart, so the surface is always kept.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from . import operators
from .mesh_edits import SMALLEST_RIM, WorkMesh

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


def contract_clusters(mesh: WorkMesh, radius: float) -> int:
    """Replace clusters of neighbouring points by their centres.

    Parameters
    ----------
    radius : mm; a cluster is a point and neighbours of it on edges shorter than this. (A point on a rim is in the
        cluster of a neighbour on the rim.)

    Returns
    -------
    Number of points removed.
    """
    n = len(mesh.points)
    centre = _clusters(mesh, radius)
    for _ in range(n):
        bad = _bad_clusters(mesh, centre)
        broken = bad[centre] & (centre != np.arange(n))
        if not broken.any():
            break
        centre[broken] = np.flatnonzero(broken)
    stays = centre == np.arange(n)
    number = np.cumsum(stays) - 1
    triangles = centre[mesh.triangles]
    triangles = number[triangles[_three(triangles)]]
    mesh.points, mesh.rim, mesh.along = mesh.points[stays], mesh.rim[stays], mesh.along[stays]
    mesh.set_triangles(triangles)
    return int(n - np.count_nonzero(stays))


def _three(triangles: IntArray) -> BoolArray:
    """Which triangles have three different corners."""
    a, b, c = triangles.T
    return (a != b) & (b != c) & (c != a)


def _clusters(mesh: WorkMesh, radius: float) -> IntArray:
    """(n,) centre of the cluster of each point: centres are no neighbours, the others go to their nearest centre."""
    n = len(mesh.points)
    edges = mesh.edges
    lengths = mesh.edge_lengths()
    on_rim = mesh.rim >= 0
    usable = lengths < radius
    a, b = edges.points[usable].T
    length = lengths[usable]
    # Into a cluster of a: b, unless b is on a rim and the edge is not.
    along_rim = edges.usage[usable] == 1
    start = np.concatenate([a, b])
    end = np.concatenate([b, a])
    length = np.concatenate([length, length])
    goes = ~on_rim[end] | np.concatenate([along_rim, along_rim])
    start, end, length = start[goes], end[goes], length[goes]
    # Points of rims come first, so that rims are thinned out evenly; otherwise in any (repeatable) order.
    rank = np.random.default_rng(0).permutation(n)
    rank[on_rim] -= n
    out = np.iinfo(np.int64).max
    chosen = np.zeros(n, bool)
    while True:
        near = np.full(n, out)
        np.minimum.at(near, end, rank[start])
        np.minimum.at(near, start, rank[end])
        now = (rank < near) & (rank < out)
        if not now.any():
            break
        chosen |= now
        rank[now] = out
        rank[end[now[start]]] = out
    centre = np.arange(n)
    reach = chosen[start] & ~chosen[end]
    start, end, length = start[reach], end[reach], length[reach]
    order = np.lexsort((length, end))
    first = np.concatenate([[True], np.diff(end[order]) > 0])
    centre[end[order[first]]] = start[order[first]]
    return centre


def _bad_clusters(mesh: WorkMesh, centre: IntArray) -> BoolArray:
    """(n,) whether the cluster round each centre breaks a rule: then it, or one that it meets, must be taken apart."""
    n = len(mesh.points)
    edges = mesh.edges
    bad = np.zeros(n, bool)
    a, b = centre[edges.points].T
    inside = a == b
    corners = centre[mesh.triangles]
    p, q, r = corners.T
    whole = (p == q) & (q == r)
    # A disk: points - edges + triangles = 1.
    euler = np.bincount(centre, minlength=n) - np.bincount(a[inside], minlength=n) + np.bincount(p[whole], minlength=n)
    bad |= (euler != 1) & (centre == np.arange(n))
    # The part on a rim is one piece, and no whole rim.
    on_rim = mesh.rim >= 0
    rim_edge = edges.usage == 1
    pieces = np.bincount(centre[on_rim], minlength=n) - np.bincount(a[inside & rim_edge], minlength=n)
    bad |= (np.bincount(centre[on_rim], minlength=n) > 0) & (pieces != 1)
    left = np.bincount(mesh.rim[on_rim & (centre == np.arange(n))], minlength=len(mesh.rim_lengths))
    bad[centre[on_rim]] |= left[mesh.rim[on_rim]] < SMALLEST_RIM
    # Two meet along one line: edges between them - triangles that join these edges = 1; at most one end on a rim.
    joins = ~whole & ~_three(corners)
    x, y, z = corners[joins].T
    # The two clusters of such a triangle.
    low, high = np.minimum(np.minimum(x, y), z), np.maximum(np.maximum(x, y), z)
    crossing = ~inside
    keys = np.minimum(a, b)[crossing] * n + np.maximum(a, b)[crossing]
    pair, index = np.unique(keys, return_inverse=True)
    lines = np.bincount(index.reshape(-1), minlength=len(pair))
    joined = np.searchsorted(pair, low * n + high)
    lines -= np.bincount(joined, minlength=len(pair))
    ends = np.bincount(index.reshape(-1)[rim_edge[crossing]], minlength=len(pair))
    wrong = (lines != 1) | (ends > 1)
    bad[pair[wrong] // n] = True
    bad[pair[wrong] % n] = True
    # Three meet in one place.
    triples = corners[_three(corners)]
    ordered = np.sort(triples, axis=1)
    order = np.lexsort(ordered.T)
    again = (ordered[order[1:]] == ordered[order[:-1]]).all(axis=1)
    bad[ordered[order[1:][again]].reshape(-1)] = True
    # And the triangle between their centres faces as the surface does there.
    facing = operators.area_vectors(mesh.points, triples)
    normals = operators.point_normals(mesh.points, mesh.triangles)
    turned = np.zeros(len(triples), bool)
    for k in range(3):
        turned |= np.einsum("ij,ij->i", facing, normals[triples[:, k]]) <= 0.0
    bad[triples[turned].reshape(-1)] = True
    return bad
