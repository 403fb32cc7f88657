"""How far a map changes areas and angles, and whether it folds.

Paper, section II-B: ``alpha`` is a triangle's share of the map's area over its share of the surface's area,
``beta`` the smaller over the larger singular value of the Jacobian of the triangle's map.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import operators
from .surface import FloatArray, IntArray

ENTROPY_BIN = 0.1
"""Width of the bins of the histogram of alpha whose entropy is quoted."""


def area_ratio(points: FloatArray, triangles: IntArray, flat: FloatArray) -> FloatArray:
    """alpha of each triangle, (m,): area on the map over area on the surface, both meshes scaled to area 1.

    1 keeps the size, more enlarges. Triangles without area on the surface get NaN.

    Parameters
    ----------
    points : (n, 3) surface, any length unit.
    flat : (n, 2) map, any length unit.
    """
    on_surface = operators.triangle_areas(points, triangles)
    on_map = operators.triangle_areas(flat, triangles)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = (on_map / on_map.sum()) / (on_surface / on_surface.sum())
    ratio[on_surface == 0] = np.nan
    return ratio


def isotropy(points: FloatArray, triangles: IntArray, flat: FloatArray) -> FloatArray:
    """beta of each triangle, (m,): 1 where angles are kept, towards 0 the more a triangle is stretched one way.

    A folded triangle has the beta of its mirror image; NaN where the surface triangle has no area.
    """
    large, small = operators.singular_values(operators.jacobians(points, triangles, flat))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.abs(small) / large


def dilatation(points: FloatArray, triangles: IntArray, flat: FloatArray) -> FloatArray:
    """Quasi-conformal dilatation K = 1/beta of each triangle, (m,): 1 where the map is conformal."""
    with np.errstate(divide="ignore"):
        return 1.0 / isotropy(points, triangles, flat)


def entropy(values: FloatArray, bin_width: float = ENTROPY_BIN) -> float:
    """Shannon entropy (natural logarithm) of the histogram of some values; NaN values are left out.

    Bins of the given width start at 0. Lower means that triangles change size more alike.
    """
    finite = values[np.isfinite(values)]
    counts = np.unique(np.floor(finite / bin_width), return_counts=True)[1]
    share = counts / counts.sum()
    return float(-(share * np.log(share)).sum())


def folded_triangles(flat: FloatArray, triangles: IntArray) -> IntArray:
    """Indices of the triangles that are turned over on the map, or have no area there."""
    return np.flatnonzero(operators.signed_areas(flat, triangles) <= 0.0)


def overlapping_pairs(flat: FloatArray, triangles: IntArray) -> IntArray:
    """Pairs of triangles whose insides overlap on the map, (k, 2), found without regard to orientation.

    Independent of `folded_triangles`: every pair whose bounding boxes meet is tested for a separating line.
    """
    corners = flat[triangles]
    low, high = corners.min(axis=1), corners.max(axis=1)
    pairs = _box_pairs(low, high)
    return pairs[_overlap(corners[pairs[:, 0]], corners[pairs[:, 1]])]


def _box_pairs(low: FloatArray, high: FloatArray) -> IntArray:
    """All pairs of boxes that meet, (k, 2), each once: boxes sorted into a grid, then compared cell by cell."""
    m = len(low)
    origin = low.min(axis=0)
    cell = max(float(np.median(np.max(high - low, axis=1))) * 1.5, float((high.max(axis=0) - origin).max()) / 2000.0)
    first, last = ((low - origin) // cell).astype(np.int64), ((high - origin) // cell).astype(np.int64)
    width = int(last[:, 0].max()) + 1
    span = last - first + 1
    copies = span[:, 0] * span[:, 1]
    box = np.repeat(np.arange(m), copies)
    step = np.arange(copies.sum()) - np.repeat(np.cumsum(copies) - copies, copies)
    x = first[box, 0] + step % span[box, 0]
    y = first[box, 1] + step // span[box, 0]
    key = y * width + x
    order = np.argsort(key, kind="stable")
    key, box = key[order], box[order]
    found = []
    # Within a cell, compare each box with the one 1, 2, 3... places further on, until no cell is that full.
    for offset in range(1, len(key)):
        same = np.flatnonzero(key[offset:] == key[:-offset])
        if not len(same):
            break
        a, b = box[same], box[same + offset]
        meet = ((low[a] < high[b]) & (low[b] < high[a])).all(axis=1)
        # A pair that shares several cells is counted in the lowest of them only.
        home = np.maximum(first[a], first[b])
        meet &= home[:, 1] * width + home[:, 0] == key[same]
        found.append(np.stack([a[meet], b[meet]], axis=1))
    return np.sort(np.concatenate(found), axis=1) if found else np.zeros((0, 2), np.int64)


def _overlap(a: FloatArray, b: FloatArray) -> NDArray[np.bool_]:
    """Whether triangles (k, 3, 2) overlap by more than rounding: no edge line of either separates them."""
    size = np.maximum(np.ptp(a, axis=1).max(axis=1), np.ptp(b, axis=1).max(axis=1))
    overlap = np.ones(len(a), bool)
    for one, other in ((a, b), (b, a)):
        for k in range(3):
            edge = one[:, (k + 1) % 3] - one[:, k]
            normal = np.stack([-edge[:, 1], edge[:, 0]], axis=1)
            length = np.linalg.norm(normal, axis=1)
            mine = np.einsum("kij,kj->ki", one - one[:, k : k + 1], normal)
            theirs = np.einsum("kij,kj->ki", other - one[:, k : k + 1], normal)
            gap = np.maximum(theirs.min(axis=1) - mine.max(axis=1), mine.min(axis=1) - theirs.max(axis=1))
            # Triangles sharing an edge or corner touch: only a depth above rounding counts.
            overlap &= gap < -1e-9 * size * length
    return overlap


def summary(points: FloatArray, triangles: IntArray, flat: FloatArray) -> dict[str, Any]:
    """The distortion figures of a map: alpha {median, p5, p95, entropy}, beta {mean, median, p5},
    dilatation {median, p99, max}. Per triangle, each counting the same; triangles without area on the surface
    are left out.
    """
    alpha = area_ratio(points, triangles, flat)
    beta = isotropy(points, triangles, flat)
    alpha, beta = alpha[np.isfinite(alpha)], beta[np.isfinite(beta)]
    with np.errstate(divide="ignore"):
        k = 1.0 / beta
    return {
        "alpha": {
            "median": float(np.median(alpha)),
            "p5": float(np.percentile(alpha, 5)),
            "p95": float(np.percentile(alpha, 95)),
            "entropy": entropy(alpha),
        },
        "beta": {
            "mean": float(beta.mean()),
            "median": float(np.median(beta)),
            "p5": float(np.percentile(beta, 5)),
        },
        "dilatation": {
            "median": float(np.median(k)),
            "p99": float(np.percentile(k, 99)),
            "max": float(k.max()),
        },
    }
