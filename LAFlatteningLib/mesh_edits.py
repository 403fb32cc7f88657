"""Changing the triangles of a mesh without changing what it is: splitting, collapsing and flipping edges.

Each function makes as many changes at once as do not touch each other, on plain arrays. A manifold stays one, with the
same handles, rims and pieces: an edge is collapsed only if its ends have no common neighbours but the points opposite
to it (the link condition, Dey et al. 1999), and flipped only if the new edge is not there yet.

Source: Hoppe et al. 1993 for the changes; Botsch and Kobbelt 2004 for evening out a mesh with them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from . import operators, topology

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

PASSES = 3
"""How often changes that do not touch each other are looked for among those left."""
SMALLEST_RIM = 8
"""A rim is not thinned out to fewer points."""
LEAST_COSINE = 0.3
"""A change may turn the normal of no triangle by more than the angle with this cosine (73 degrees)."""

THIN = 0.01
"""Triangles with less area than this, in squares of their longest side, have hardly any."""


@dataclass(eq=False)
class WorkMesh:
    """A mesh while it is being changed.

    Attributes
    ----------
    points : (n, 3) mm.
    triangles : (m, 3).
    rim : (n,) number of the rim that a point is on, -1 inside.
    along : (n,) where on that rim it is: mm from the rim's first point.
    rim_lengths : mm round each rim.
    """

    points: FloatArray
    triangles: IntArray
    rim: IntArray
    along: FloatArray
    rim_lengths: FloatArray

    def __post_init__(self) -> None:
        self._edges: topology.Edges | None = None

    @property
    def edges(self) -> topology.Edges:
        """The edges as they are now."""
        if self._edges is None:
            self._edges = topology.edges(self.triangles)
        return self._edges

    def set_triangles(self, triangles: IntArray) -> None:
        """Replace the triangles."""
        self.triangles, self._edges = triangles, None

    def edge_lengths(self) -> FloatArray:
        """(e,) mm."""
        a, b = self.edges.points.T
        return norms(self.points[a] - self.points[b])


def norms(vectors: FloatArray) -> FloatArray:
    """(n,) lengths of vectors (n, k); several times faster than numpy's own on short ones."""
    return np.sqrt(np.einsum("ij,ij->i", vectors, vectors))


def split_edges(mesh: WorkMesh, chosen: BoolArray) -> None:
    """Put a point into the middle of edges; triangles are cut into two, three or four.

    Parameters
    ----------
    chosen : (e,) which edges.
    """
    ends = mesh.edges.points[chosen]
    n, count = len(mesh.points), len(ends)
    if count == 0:
        return
    new = np.full(len(chosen), -1, np.int64)
    new[chosen] = n + np.arange(count)
    rim = np.where(mesh.edges.usage[chosen] == 1, mesh.rim[ends[:, 0]], -1)
    along = np.zeros(count)
    on = rim >= 0
    if on.any():
        length = mesh.rim_lengths[rim[on]]
        start, end = mesh.along[ends[on, 0]], mesh.along[ends[on, 1]]
        # The short way round.
        step = (end - start + 0.5 * length) % length - 0.5 * length
        along[on] = (start + 0.5 * step) % length
    mesh.points = np.concatenate([mesh.points, mesh.points[ends].mean(axis=1)])
    mesh.rim = np.concatenate([mesh.rim, rim])
    mesh.along = np.concatenate([mesh.along, along])
    middle = new[mesh.edges.of_triangle]
    cut = middle >= 0
    times = cut.sum(axis=1)
    t = mesh.triangles
    parts = [t[times == 0]]
    if (times == 1).any():
        rows = np.flatnonzero(times == 1)
        c, (p, q, r), m = _turned(t, middle, rows, cut[rows].argmax(axis=1))
        del c
        parts += [np.stack([p, q, m[0]], 1), np.stack([p, m[0], r], 1)]
    if (times == 2).any():
        rows = np.flatnonzero(times == 2)
        # Turned so that the side opposite corner p is whole; the others have middles on r-p and p-q.
        _, (p, q, r), m = _turned(t, middle, rows, (~cut[rows]).argmax(axis=1))
        parts.append(np.stack([p, m[2], m[1]], 1))
        across = norms(mesh.points[q] - mesh.points[m[1]])
        other = norms(mesh.points[r] - mesh.points[m[2]])
        first = (across < other)[:, None]
        parts.append(np.where(first, np.stack([q, m[1], m[2]], 1), np.stack([q, r, m[2]], 1)))
        parts.append(np.where(first, np.stack([q, r, m[1]], 1), np.stack([r, m[1], m[2]], 1)))
    if (times == 3).any():
        rows = np.flatnonzero(times == 3)
        (p, q, r), (a, b, c) = t[rows].T, middle[rows].T
        parts += [np.stack(x, 1) for x in ((p, c, b), (q, a, c), (r, b, a), (a, b, c))]
    mesh.set_triangles(np.concatenate(parts))


def _turned(
    triangles: IntArray, middle: IntArray, rows: IntArray, corner: IntArray
) -> tuple[IntArray, tuple[IntArray, ...], tuple[IntArray, ...]]:
    """Corners of some triangles beginning with a chosen one, and the middles opposite to each of them."""
    order = (corner[:, None] + np.arange(3)) % 3
    corners = np.take_along_axis(triangles[rows], order, axis=1)
    middles = np.take_along_axis(middle[rows], order, axis=1)
    return rows, tuple(corners.T), tuple(middles.T)


def collapse_edges(mesh: WorkMesh, chosen: BoolArray, longest: float = np.inf, most: int | None = None) -> int:
    """Remove points by collapsing edges onto one of their ends, which stays where it is.

    Parameters
    ----------
    chosen : (e,) edges that may be collapsed, the shortest first.
    longest : mm; no edge longer than this is made.
    most : at most so many points are removed.

    Returns
    -------
    Number of points removed.
    """
    edges, n = mesh.edges, len(mesh.points)
    length = mesh.edge_lengths()
    on_rim = mesh.rim >= 0
    a, b = edges.points.T
    both = on_rim[a] & on_rim[b]
    sizes = np.bincount(mesh.rim[on_rim], minlength=len(mesh.rim_lengths))
    # A point on a rim goes only along it. (An edge from rim to rim would pinch the surface.)
    possible = chosen & (~both | (edges.usage == 1))
    possible[both & (edges.usage == 1)] &= sizes[mesh.rim[a[both & (edges.usage == 1)]]] > SMALLEST_RIM
    possible = np.flatnonzero(possible)
    possible = possible[np.argsort(length[possible], kind="stable")]
    a, b = a[possible], b[possible]
    # The one with fewer neighbours goes, unless only that one is on a rim.
    degree = np.bincount(edges.points.reshape(-1), minlength=n)
    gone = np.where((degree[a] < degree[b]) & (on_rim[a] == on_rim[b]) | (on_rim[b] & ~on_rim[a]), a, b)
    kept = np.where(gone == a, b, a)
    rank = np.full(n, len(possible), np.int64)
    np.minimum.at(rank, gone, np.arange(len(possible)))
    target = np.full(n, -1, np.int64)
    has = rank < len(possible)
    target[has] = kept[rank[has]]
    allowed = _collapsible(mesh, np.flatnonzero(has), target, edges, longest, degree)
    rank[has] = np.where(allowed, rank[has], len(possible))
    picked = _independent(rank, len(possible), edges.points)
    picked = picked[np.argsort(rank[picked])]
    if len(mesh.rim_lengths):
        # Not too many from a small rim at once.
        room = sizes - SMALLEST_RIM
        for k in np.flatnonzero(room < sizes / 2):
            of_rim = mesh.rim[picked] == k
            picked = picked[~of_rim | (np.cumsum(of_rim) <= room[k])]
    if most is not None:
        picked = picked[:most]
    if len(picked) == 0:
        return 0
    goes_to = np.arange(n)
    goes_to[picked] = target[picked]
    triangles = goes_to[mesh.triangles]
    p, q, r = triangles.T
    triangles = triangles[(p != q) & (q != r) & (r != p)]
    stays = np.ones(n, bool)
    stays[picked] = False
    number = np.cumsum(stays) - 1
    mesh.points, mesh.rim, mesh.along = mesh.points[stays], mesh.rim[stays], mesh.along[stays]
    mesh.set_triangles(number[triangles])
    return len(picked)


def _collapsible(
    mesh: WorkMesh, gone: IntArray, target: IntArray, edges: topology.Edges, longest: float, degree: IntArray
) -> BoolArray:
    """Whether each point can go to its target: link condition, no triangle turned over, no edge too long."""
    n = len(mesh.points)
    ends = edges.points
    index = np.full(n, -1, np.int64)
    index[gone] = np.arange(len(gone))
    # Common neighbours of a point and its target: neighbours x of the point for which x-target is an edge.
    start = np.concatenate([ends[:, 0], ends[:, 1]])
    end = np.concatenate([ends[:, 1], ends[:, 0]])
    of = index[start]
    start, end, of = start[of >= 0], end[of >= 0], of[of >= 0]
    reach = target[start]
    far = norms(mesh.points[end] - mesh.points[reach]) > longest
    key = np.minimum(end, reach) * n + np.maximum(end, reach)
    present = ends[:, 0] * n + ends[:, 1]
    place = np.minimum(np.searchsorted(present, key), len(present) - 1)
    joined = present[place] == key
    common = np.bincount(of[joined], minlength=len(gone))
    on_edge = np.where((mesh.rim[gone] >= 0), 1, 2)
    good = (common == on_edge) & (np.bincount(of[far], minlength=len(gone)) == 0)
    good &= degree[target[gone]] + degree[gone] - on_edge - 2 >= np.where(mesh.rim[target[gone]] >= 0, 2, 3)
    # Triangles round the point that remain.
    corner = index[mesh.triangles]
    turned = np.zeros(len(gone), np.int64)
    for k in range(3):
        rows = np.flatnonzero(corner[:, k] >= 0)
        t = mesh.triangles[rows]
        goal = target[t[:, k]]
        remains = (t != goal[:, None]).all(axis=1)
        rows, t, goal = rows[remains], t[remains], goal[remains]
        after = t.copy()
        after[:, k] = goal
        bad = ~_same_side(mesh.points, t, after)
        turned += np.bincount(corner[rows[bad], k], minlength=len(gone))
    return good & (turned == 0)


def _same_side(points: FloatArray, before: IntArray, after: IntArray) -> BoolArray:
    """Whether triangles keep their normals, about; what has hardly any area has no normal to keep."""
    old, new = operators.area_vectors(points, before), operators.area_vectors(points, after)
    old_size, new_size = norms(old), norms(new)
    longest = max_side(points, before)
    return (old_size < THIN * longest**2) | (np.einsum("ij,ij->i", old, new) > LEAST_COSINE * old_size * new_size)


def max_side(points: FloatArray, triangles: IntArray) -> FloatArray:
    """(m,) longest side of each triangle."""
    p, q, r = (points[triangles[:, k]] for k in range(3))
    return np.maximum(np.maximum(norms(q - p), norms(r - q)), norms(p - r))


def _independent(rank: IntArray, none: int, ends: IntArray) -> IntArray:
    """Points of low rank, no two of which are neighbours or have a common neighbour.

    Parameters
    ----------
    rank : (n,) different for all candidates; `none` for points that are none.
    ends : (e, 2) edges.
    """
    a, b = ends.T
    rank = rank.copy()
    picked = []
    for _ in range(PASSES):
        near = rank.copy()
        np.minimum.at(near, a, rank[b])
        np.minimum.at(near, b, rank[a])
        least = near.copy()
        np.minimum.at(least, a, near[b])
        np.minimum.at(least, b, near[a])
        now = (rank == least) & (rank < none)
        if not now.any():
            break
        picked.append(np.flatnonzero(now))
        # Points two steps away are out.
        blocked = now.copy()
        for _ in range(2):
            grown = blocked.copy()
            grown[a[blocked[b]]] = True
            grown[b[blocked[a]]] = True
            blocked = grown
        rank[blocked] = none
    return np.concatenate(picked) if picked else np.zeros(0, np.int64)


def flip_edges(mesh: WorkMesh, bent: float = -1.0) -> int:
    """Flip edges opposite to which the two angles sum to more than 180 degrees (so that they become Delaunay).

    Edges that cut an ear off a rim, a triangle with two edges on it, are flipped in any case: where the rim is straight
    an ear has no area, and on a map it would fold.

    Parameters
    ----------
    bent : edges at which the cosine of the turn is smaller stay, because they are creases; by default none are.

    Returns
    -------
    Number of flips made.
    """
    edges, n, m = mesh.edges, len(mesh.points), len(mesh.triangles)
    cotangent = operators.cotangents(mesh.points, mesh.triangles)
    total = np.bincount(edges.of_triangle.reshape(-1), cotangent.reshape(-1), minlength=len(edges.points))
    degree = np.bincount(edges.points.reshape(-1), minlength=n)
    tips = degree[mesh.triangles] == 2
    total[edges.of_triangle[tips]] = -np.inf
    bad = np.flatnonzero((total < -1e-6) & (edges.usage == 2))
    if len(bad) == 0:
        return 0
    bad = bad[np.argsort(total[bad], kind="stable")]
    first, second = edges.triangles[bad].T
    side = (edges.of_triangle[first] == bad[:, None]).argmax(axis=1)
    other = (edges.of_triangle[second] == bad[:, None]).argmax(axis=1)
    facing = operators.area_vectors(mesh.points, mesh.triangles)
    size = np.maximum(norms(facing), 1e-300)
    turn = np.einsum("ij,ij->i", facing[first], facing[second]) / (size[first] * size[second])
    # Triangles (c, a, b) and (d, b, a) become (c, a, d) and (d, b, c).
    c, a, b = (mesh.triangles[first, (side + k) % 3] for k in range(3))
    d = mesh.triangles[second, other]
    key = np.minimum(c, d) * n + np.maximum(c, d)
    present = edges.points[:, 0] * n + edges.points[:, 1]
    place = np.minimum(np.searchsorted(present, key), len(present) - 1)
    is_ear = tips.any(axis=1)
    ear = is_ear[first] | is_ear[second]
    good = (present[place] != key) & (ear | ((turn >= bent) & (degree[a] > 3) & (degree[b] > 3)))
    one, two = np.stack([c, a, d], 1), np.stack([d, b, c], 1)
    for new in (one, two):
        for old in (first, second):
            good &= is_ear[old] | _same_side(mesh.points, mesh.triangles[old], new)
    bad, first, second, one, two, key = (x[good] for x in (bad, first, second, one, two, key))
    ends = np.stack([a[good], b[good]], axis=1)
    if len(bad) == 0:
        return 0
    # Each triangle, each point and each new edge takes part in one flip, the worst first.
    rank = np.arange(len(bad))
    by_triangle, by_point = np.full(m, len(bad)), np.full(n, len(bad))
    for t in (first, second):
        np.minimum.at(by_triangle, t, rank)
    for k in range(2):
        np.minimum.at(by_point, ends[:, k], rank)
    free = (by_triangle[first] == rank) & (by_triangle[second] == rank)
    free &= (by_point[ends[:, 0]] == rank) & (by_point[ends[:, 1]] == rank)
    chosen = np.flatnonzero(free)
    chosen = chosen[np.sort(np.unique(key[chosen], return_index=True)[1])]
    triangles = mesh.triangles.copy()
    triangles[first[chosen]], triangles[second[chosen]] = one[chosen], two[chosen]
    mesh.set_triangles(triangles)
    return len(chosen)


def star_centroids(points: FloatArray, triangles: IntArray) -> FloatArray:
    """(n, 3) centroid of the triangles round each point."""
    area = operators.triangle_areas(points, triangles)
    centre = points[triangles].mean(axis=1)
    n = len(points)
    ids = np.ascontiguousarray(triangles).reshape(-1)
    matrix = sparse.csr_matrix(
        (np.repeat(area, 3), (ids, np.repeat(np.arange(len(triangles)), 3))), shape=(n, len(triangles))
    )
    total = np.asarray(matrix.sum(axis=1)).ravel()
    return (matrix @ centre) / np.where(total > 0, total, 1.0)[:, None]
