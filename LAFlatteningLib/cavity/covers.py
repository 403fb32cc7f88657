"""Covers over openings: a patch of triangles for each rim, with inner points for a centre seed to sit on.

Three steps after P. Liepa, "Filling holes in meshes", Symposium on Geometry Processing 2003: the rim is triangulated
with the least area (after Barequet and Sharir), the triangles are refined to the edge length round the opening (after
Pfeifle and Seidel), and the new points are faired. Written from the paper's description.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from .. import topology
from ..errors import LAFlatteningError, SurfaceError
from ..surface import Surface
from .fairing import fair_membrane, fair_thin_plate, harmonic_weights, solve_held
from .least_area import minimum_area_triangulation
from .patches import Patches, contains

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
Fairing = Literal["membrane", "thin-plate"]

HOLE_ARRAY = "hole"
"""Point array that marks the inner points of covers with 1."""


def cover_rim(
    points: FloatArray,
    rim: IntArray,
    triangles: IntArray | None = None,
    *,
    fairing: Fairing = "membrane",
    name: str = "The rim",
) -> tuple[FloatArray, IntArray]:
    """Cover an opening with triangles of the size of those round it.

    Parameters
    ----------
    points : (n, 3) in any length unit.
    rim : (r,) ids of the opening's points in order, at least 3, with the surface on the left of the loop (the
        order of `topology.boundary_loops`).
    triangles : (m, 3) the surface round the opening (all of it, or at least every triangle that touches the rim).
        From it come the edge length to match, and the edges between points of the rim that the cover must not use
        a second time. Without it the edge length is that of the rim.
    fairing : "membrane" stretches the cover over the rim, a discrete minimal surface. "thin-plate", the paper's
        second-order fairing, lets the surface continue across the rim with its tangents; it needs `triangles`.
    name : what messages call the rim.

    Returns
    -------
    inner : (k, 3) new points, k >= 1. They are numbered from n on.
    cover : (t, 3) triangles of the cover with ids into `points` followed by `inner`. They run along each
        edge of the rim against the surface's triangle there, so that the orientation continues.

    Raises
    ------
    SurfaceError : fewer than 3 points in the rim, a point twice, an id out of range, coordinates that are not numbers,
        or a rim that is not a loop of the surface's boundary in its direction.
    LAFlatteningError : an unknown fairing, or "thin-plate" without triangles.

    Notes
    -----
    Why the membrane is the default, against the paper: at an ostium "with its tangents" means along the vein. On a
    tube of radius R the thin plate is a dome R/2 high. Measured on 15 ostia of two atria, it stood 1.3 to 3.5 mm out
    into the vein (membrane: at most 0.35 mm, the raggedness of the rims), its centre 0.7 to 1.9 mm (0.05 mm). It made
    each geodesic between two centre seeds 1 to 3 mm longer, and one in ten took the other side of its vein. As it
    hangs on the last row of triangles of the cut vein, noise of 0.1 mm moved its centre by 0.12 mm (0.04 mm).
    The thin plate is right where a rounded stump is wanted; published covers of ostia exist of both kinds.

    Source: Liepa 2003. Minimal surface: Pinkall and Polthier 1993.

    Examples
    --------
    >>> import numpy as np
    >>> angle = np.linspace(0, 2 * np.pi, 6, endpoint=False)
    >>> hexagon = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    >>> inner, cover = cover_rim(hexagon, np.arange(6)[::-1])
    >>> len(inner), len(cover), bool(np.allclose(inner, 0))
    (1, 6, True)
    """
    points = np.asarray(points, np.float64)
    covers = _cover(points, _checked_rims(points, [rim], [name]), triangles, fairing, [name])
    return covers.inner, covers.triangles


def close_rims(
    surface: Surface, rims: Sequence[IntArray], names: Sequence[str] | None = None, *, fairing: Fairing = "membrane"
) -> tuple[Surface, IntArray]:
    """The surface with some of its openings covered.

    Points and triangles of the surface keep their ids; those of the covers follow, rim by rim.

    Parameters
    ----------
    rims : loops of the surface's boundary, as in `Surface.boundary_loops`.
    names : what messages call them; "Rim 0", "Rim 1", ... if not given.
    fairing : see `cover_rim`.

    Returns
    -------
    closed : Surface with all arrays of the surface. On covers, point arrays of floating type are harmonic
        (each value between those of the rim; NaN only where the whole rim has none), others are those of the nearest
        point of the rim; cell arrays are 0 (empty for text). The point array `hole` (uint8) is 1 at the covers' inner
        points, 0 elsewhere, rims included; where the surface has such an array already, its marks stay.
    rim_of_triangle : (m',) number of the rim that a triangle covers, -1 for the surface's own triangles.

    Raises
    ------
    SurfaceError : a rim is not a loop of the surface, two rims share a point, see `cover_rim`.
    LAFlatteningError : unknown fairing; as many names as rims expected.
    """
    if names is None:
        names = [f"Rim {number}" for number in range(len(rims))]
    if len(names) != len(rims):
        raise LAFlatteningError(f"Expected a name for each of the {len(rims)} rims, found {len(names)} names.")
    n = len(surface.points)
    hole = np.zeros(n, np.uint8)
    if HOLE_ARRAY in surface.point_data:
        hole = (np.asarray(surface.point_data[HOLE_ARRAY]).reshape(n, -1) != 0).any(axis=1).astype(np.uint8)
    if len(rims) == 0:
        return surface.with_data({HOLE_ARRAY: hole}), np.full(len(surface.triangles), -1, np.int64)
    rims = _checked_rims(surface.points, rims, names)
    covers = _cover(surface.points, rims, surface.triangles, fairing, names)
    added = len(covers.triangles)
    point_data = _continue_on_covers(surface, rims, covers)
    point_data[HOLE_ARRAY] = np.append(hole, np.ones(len(covers.inner), np.uint8))
    cell_data = {key: np.concatenate([values, _neutral(values, added)]) for key, values in surface.cell_data.items()}
    closed = Surface(
        np.concatenate([surface.points, covers.inner]),
        np.concatenate([surface.triangles, covers.triangles]),
        point_data,
        cell_data,
        surface.field_data,
        surface.space,
    )
    return closed, np.concatenate([np.full(len(surface.triangles), -1, np.int64), covers.rim_of_triangle])


class _Covers(NamedTuple):
    """Covers of several rims, ordered by rim, with ids into the points followed by `inner`."""

    inner: FloatArray
    triangles: IntArray
    rim_of_point: IntArray
    """(k,) of each inner point."""
    rim_of_triangle: IntArray
    """(t,)"""


def _cover(
    points: FloatArray, rims: Sequence[IntArray], triangles: IntArray | None, fairing: str, names: Sequence[str]
) -> _Covers:
    """Cover rims. All go through refinement and fairing together, because small arrays cost numpy as much as large."""
    if fairing not in get_args(Fairing):
        raise LAFlatteningError(f'Expected fairing "membrane" or "thin-plate", found "{fairing}".')
    if fairing == "thin-plate" and triangles is None:
        raise LAFlatteningError('fairing="thin-plate" continues the surface: give the triangles round the rim too.')
    around = None
    if triangles is not None:
        on_rim = np.zeros(len(points), bool)
        on_rim[np.concatenate(rims)] = True
        around = np.asarray(triangles, np.int64)
        around = around[on_rim[around].any(axis=1)]
        _check_loops(around, rims, names, len(points))

    # Patches have their own numbering: first the points of the rims, each rim backwards, so that triangles which
    # turn with that order continue the orientation of the surface; then inner points as they are made.
    outline = np.concatenate([rim[::-1] for rim in rims])
    start = np.cumsum([0] + [len(rim) for rim in rims])
    ends, length = _edges_around(points, rims, around)
    local = np.full(len(points), -1, np.int64)
    local[outline] = np.arange(len(outline))
    joined = local[ends]
    sigma = _mean_at_points(joined, length, len(outline))
    rim_of_outline = np.repeat(np.arange(len(rims)), np.diff(start))
    joined = joined[(joined >= 0).all(axis=1)]
    joined = joined[rim_of_outline[joined[:, 0]] == rim_of_outline[joined[:, 1]]]

    patches = Patches(points[outline], sigma, rim_of_outline, joined)
    for number, (first, last) in enumerate(pairwise(start)):
        corners = points[outline[first:last]]
        pairs = joined[(joined[:, 0] >= first) & (joined[:, 0] < last)] - first
        taken = np.zeros((last - first, last - first), bool)
        taken[pairs[:, 0], pairs[:, 1]] = taken[pairs[:, 1], pairs[:, 0]] = True
        step = np.arange(last - first)
        taken[step, np.roll(step, -1)] = taken[np.roll(step, -1), step] = False
        found = minimum_area_triangulation(corners, taken)
        if found is None:
            # Every triangulation would use an edge of the surface again: a fan round a new point does not.
            centre = patches.add_points(corners.mean(axis=0)[None], sigma[first:last].mean()[None], np.array([number]))
            found = np.stack([step, np.roll(step, -1), np.full(len(step), centre[0] - first)], axis=1)
        patches.add_triangles(found + first, number)
    patches.join()
    patches.relax()
    patches.unfold()
    patches.refine()
    patches.ensure_inner_points()
    fair_membrane(patches)
    if around is not None and fairing == "thin-plate":
        fair_thin_plate(patches, points, outline, around)

    fixed = len(outline)
    order = np.argsort(patches.rim_of_point[fixed:], kind="stable")
    new_id = np.concatenate([outline, np.empty(len(order), np.int64)])
    new_id[fixed + order] = len(points) + np.arange(len(order))
    by_rim = np.argsort(patches.rim_of_triangle, kind="stable")
    return _Covers(
        patches.points[fixed:][order],
        new_id[patches.triangles[by_rim]],
        patches.rim_of_point[fixed:][order],
        patches.rim_of_triangle[by_rim],
    )


def _checked_rims(points: FloatArray, rims: Sequence[IntArray], names: Sequence[str]) -> list[IntArray]:
    """The rims as int64 arrays of distinct ids, none in two rims."""
    owner = np.full(len(points), -1, np.int64)
    checked = []
    for number, (given, name) in enumerate(zip(rims, names, strict=True)):
        rim = np.asarray(given)
        if rim.ndim != 1 or len(rim) < 3 or rim.dtype.kind not in "iu":
            raise SurfaceError(
                f"{name}: expected a loop of at least 3 point ids, found an array of shape {rim.shape} and type "
                f"{rim.dtype}. Take it from Surface.boundary_loops."
            )
        if rim.min() < 0 or rim.max() >= len(points):
            bad = rim.min() if rim.min() < 0 else rim.max()
            raise SurfaceError(
                f"{name} has point {bad}, expected ids from 0 to {len(points) - 1}. Take it from the same surface."
            )
        ids, times = np.unique(rim, return_counts=True)
        if (times > 1).any():
            raise SurfaceError(
                f"{name} passes point {ids[times > 1][0]} more than once. Expected each point once, without the "
                "first repeated at the end."
            )
        if not np.isfinite(points[rim]).all():
            raise SurfaceError(f"{name} has points with coordinates that are not a number. Remove them first.")
        other = owner[rim].max()
        if other >= 0:
            raise SurfaceError(
                f"{name} shares point {rim[owner[rim] >= 0][0]} with {names[other]}. Give each opening once."
            )
        owner[rim] = number
        checked.append(rim.astype(np.int64))
    return checked


def _check_loops(around: IntArray, rims: Sequence[IntArray], names: Sequence[str], n: int) -> None:
    """Each edge of a rim must be used by one triangle, in the rim's direction."""
    half = topology.half_edges(around)
    keys = np.sort(half[:, 0] * n + half[:, 1])
    for rim, name in zip(rims, names, strict=True):
        following = np.roll(rim, -1)
        forward = contains(keys, rim * n + following)
        backward = contains(keys, following * n + rim)
        if backward.all() and not forward.any():
            raise SurfaceError(
                f"{name} runs the wrong way: expected the surface on the left of the loop, as in "
                "Surface.boundary_loops. Reverse it."
            )
        wrong = ~forward | backward
        if wrong.any():
            k = int(np.flatnonzero(wrong)[0])
            found = "an edge inside the surface" if forward[k] else "no edge of the surface in this direction"
            raise SurfaceError(
                f"{name} is not a loop of the surface's boundary: {np.count_nonzero(wrong)} of its {len(rim)} steps "
                f"are not boundary edges (from point {rim[k]} to {following[k]} there is {found}). "
                "Take it from Surface.boundary_loops of the same surface."
            )


def _edges_around(points: FloatArray, rims: Sequence[IntArray], around: IntArray | None) -> tuple[IntArray, FloatArray]:
    """Edges that touch the rims, (e, 2) and their lengths: those of the surface, or the rims' own."""
    if around is None:
        ends = np.concatenate([np.stack([rim, np.roll(rim, -1)], axis=1) for rim in rims])
    else:
        ends = topology.edges(around).points
    return ends, np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)


def _mean_at_points(ends: IntArray, length: FloatArray, n: int) -> FloatArray:
    """Liepa's sigma: mean length of the edges at each point, (n,); ends that are -1 do not count."""
    flat, weight = ends.reshape(-1), np.repeat(length, 2)
    counted = flat >= 0
    total = np.bincount(flat[counted], weight[counted], minlength=n)
    return total / np.bincount(flat[counted], minlength=n)


def _neutral(values: NDArray, count: int) -> NDArray:
    """Rows for new cells: 0, False, or empty text."""
    filling = "" if values.dtype.kind in "OUS" else 0
    return np.full((count, *values.shape[1:]), filling, dtype=values.dtype)


def _continue_on_covers(surface: Surface, rims: Sequence[IntArray], covers: _Covers) -> dict[str, NDArray]:
    """The surface's point arrays with values for the inner points of covers."""
    n, k = len(surface.points), len(covers.inner)
    nearest = np.empty(k, np.int64)
    for number, rim in enumerate(rims):
        own = covers.rim_of_point == number
        nearest[own] = rim[cKDTree(surface.points[rim]).query(covers.inner[own])[1]]
    floating = {name: values for name, values in surface.point_data.items() if values.dtype.kind == "f"}
    used, compact = np.unique(covers.triangles, return_inverse=True)
    points = np.concatenate([surface.points, covers.inner])[used]
    inner = used >= n
    rim_of = np.concatenate([np.empty(n, np.int64), covers.rim_of_point])
    for number, rim in enumerate(rims):
        rim_of[rim] = number
    columns = [values.reshape(n, -1)[used[~inner]].astype(np.float64) for values in floating.values()]
    table = np.full((len(used), sum(column.shape[1] for column in columns)), np.nan)
    if columns:
        table[~inner] = np.concatenate(columns, axis=1)
        _spread(table, np.isfinite(table), harmonic_weights(points, compact.reshape(-1, 3)), rim_of[used])

    result, first = {}, 0
    for name, values in surface.point_data.items():
        added = values[nearest]
        if name in floating:
            width = values[:1].size
            added = table[inner, first : first + width].reshape(added.shape).astype(values.dtype)
            first += width
        result[name] = np.concatenate([values, added])
    return result


def _spread(table: FloatArray, known: BoolArray, matrix: sparse.csr_matrix, rim_of: IntArray) -> None:
    """Replace unknown values of each column by harmonic ones; those of a rim without any known value stay."""
    for pattern in np.unique(known, axis=1).T:
        alike = (known == pattern[:, None]).all(axis=0)
        unknown = ~pattern & (np.bincount(rim_of[pattern], minlength=rim_of.max() + 1) > 0)[rim_of]
        reached = unknown | pattern
        if unknown.any():
            part = np.ix_(reached, alike)
            table[part] = solve_held(matrix[reached][:, reached], unknown[reached], table[part])
