"""Handles of an atrium's surface: where veins or the appendage touch, found and removed with the smallest cut.

A surface made from a segmentation has a handle where two veins, or a vein and the appendage, grow together in a few
voxels (a bridge), or where a hole of a few voxels goes through the lumen (a tunnel). Each is removed by cutting the
surface along a closed line and covering both rims: a line round a bridge takes the bridge away, a line round the
inside of a tunnel fills it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from .. import operators
from ..errors import SurfaceError
from ..progress import ProgressCallback, part, report
from ..surface import Array, FloatArray, IntArray, Surface
from .sheets import turned_alike
from .short_loops import left_of, shortest_across, shortest_loop
from .slivers import collapse_needles
from .wall import patch_wall, place_text

WIDEST_MM = 8.0
"""A wider handle is not taken for an artefact. Pulmonary veins are 8 to 20 mm wide at their ostia, so that a bridge of
8 mm may be a vein, and cutting it would change the anatomy."""

PREFER_BRIDGE = 2.0
"""A bridge is cut, rather than the tunnel beside it filled, up to so many times the length of the tunnel's line. Parts
that touch are apart in the heart: filling the tunnel leaves them joined, and where they touch in two places it makes
one wide bridge of two narrow ones. A tunnel less than half as long round as the bridge is a flaw of the wall."""

CLEAR_SHARE = 0.9
"""A cover is taken as inside the lumen, or outside it, if so much of it is; a cover that is both crosses the wall."""

WINDING_PLACES = 8
"""Places on the covers that are looked at."""

GAP_SHARE = 0.5
"""Each of the two rims of a cut lies so many mean edge lengths from the line, so that the covers do not touch."""


@dataclass(frozen=True, eq=False)
class Handle:
    """A handle that was removed.

    Attributes
    ----------
    place_mm : (3,) centre of the line along which it was cut.
    width_mm : perimeter / pi of the cut (the narrower of its two rims), the diameter of a circle as long.
    loop_mm : (k, 3) the line: a closed polygon along edges of the surface, the first point not repeated.
    kind : "bridge", a piece of lumen that joined two parts, was cut through; "tunnel", a hole through the lumen,
        was filled.
    """

    place_mm: FloatArray
    width_mm: float
    loop_mm: FloatArray
    kind: Literal["bridge", "tunnel"]


def remove_handles(
    surface: Surface, *, widest_mm: float = WIDEST_MM, progress: ProgressCallback | None = None
) -> tuple[Surface, tuple[Handle, ...]]:
    """Make a surface that has no handles.

    Handles are removed one after another, each along a short line on the surface that does not separate it. The
    shortest of all is found first (`short_loops.shortest_loop`). If it goes round a bridge, that is cut. If it goes
    round the inside of a tunnel, the shortest line across it goes round the bridge beside it, and the bridge is cut
    if that takes a line up to `PREFER_BRIDGE` times as long; otherwise the tunnel is filled. Lengths decide, not areas
    of covers, because the shortest line is found exactly, whereas an area depends on how the line is covered. The cut
    takes away the strip within half an edge length of the line, and each rim gets a cover of least area. Everything
    else stays where it is, with its point and cell arrays; see `close_rims` for their values on covers.

    Parameters
    ----------
    surface : a manifold of one piece, closed or open; no rim is touched.
    widest_mm : a wider handle (perimeter / pi of its narrowest cut) is refused.

    Returns
    -------
    surface : of genus 0; the same object if it had no handles.
    handles : what was removed, in that order.

    Raises
    ------
    SurfaceError : not a manifold, several pieces, one-sided; a handle too wide; a handle that cannot be cut without
        touching a rim or another part of the surface.
    Cancelled : the callback returned False.

    Notes
    -----
    Where a vein that touches another is narrower before the bridge than the bridge itself, the smallest cut goes
    through that vein. Look at the reported place and line.

    Examples
    --------
    >>> from LAFlatteningLib.phantom import make_phantom
    >>> surface = make_phantom(500).surface
    >>> remove_handles(surface)[0] is surface
    True
    """
    if not surface.is_manifold:
        place = place_text(surface.points[surface.non_manifold_points[0]])
        raise SurfaceError(
            f"Expected a clean sheet to look for handles on; it is none at {len(surface.non_manifold_points)} points "
            f"(the first at {place}). Heal the surface first."
        )
    if surface.component_count > 1:
        raise SurfaceError(f"Expected a surface of one piece, found {surface.component_count}. Keep the right one.")
    if surface.genus == 0:
        return surface, ()
    surface = turned_alike(surface)
    count = surface.genus
    handles: list[Handle] = []
    for number in range(count):
        report(progress, number / count, f"Looking for handle {number + 1} of {count}")
        loop = shortest_loop(surface, part(progress, number / count, (number + 1) / count))
        surface, handle = _remove(surface, loop, widest_mm)
        handles.append(handle)
    report(progress, 1.0, "Handles removed")
    return surface, tuple(handles)


def _remove(surface: Surface, loop: IntArray, widest_mm: float) -> tuple[Surface, Handle]:
    """Remove the handle with the shortest line: along it, or along the shortest line across it."""
    first = _cut_and_cover(surface, loop)
    if first is None or first[1].kind == "tunnel":
        across = shortest_across(surface, loop, PREFER_BRIDGE * surface.loop_length(loop))
        second = None if across is None else _cut_and_cover(surface, across)
        if second is not None and second[1].width_mm <= widest_mm and (first is None or second[1].kind == "bridge"):
            return second
    where = place_text(surface.points[loop].mean(axis=0))
    if first is None:
        raise SurfaceError(
            f"The surface has a handle (like the handle of a cup) at {where} that cannot be cut without crossing "
            "another part of the surface. Separate the parts in the segmentation there and make the surface again."
        )
    width = first[1].width_mm
    if width > widest_mm:
        raise SurfaceError(
            f"The surface has a handle (like the handle of a cup) at {where} that is {width:.1f} mm wide at its "
            f"narrowest; up to {widest_mm:.1f} mm are taken for veins or an appendage that touch, and cut. Separate "
            "the parts in the segmentation there and make the surface again, or allow a wider cut."
        )
    return first


def _cut_and_cover(surface: Surface, loop: IntArray) -> tuple[Surface, Handle] | None:
    """Cut along a chordless loop that does not separate the surface, and cover both rims.

    None where that is impossible, or where a cover would cross the surface.
    """
    line = surface.points[loop]
    centre = line.mean(axis=0)
    cut = cut_open(surface, loop)
    if cut is None:
        return None
    closed = patch_wall(cut.surface, cut.rims)
    if not closed.is_manifold or closed.component_count > 1 or closed.genus != surface.genus - 1:
        return None
    inner = closed.points[len(cut.surface.points) :]
    inside = np.abs(winding_number(surface, inner[:: max(1, len(inner) // WINDING_PLACES)])) > 0.5
    share = float(inside.mean())
    if 1.0 - CLEAR_SHARE < share < CLEAR_SHARE:
        return None
    # A cut through a short edge leaves a shorter one.
    new = np.arange(len(closed.points)) >= len(surface.points) - len(loop)
    healed, joined = collapse_needles(closed, new)
    if len(joined):
        closed, _ = healed.submesh(np.ones(len(healed.triangles), bool))
    width = min(cut.surface.loop_length(rim) for rim in cut.rims) / np.pi
    return closed, Handle(centre, float(width), line, "bridge" if share > 0.5 else "tunnel")


class Cut(NamedTuple):
    """A surface cut open along a loop."""

    surface: Surface
    rims: tuple[IntArray, IntArray]
    """The two new rims, surface on their left."""


def cut_open(surface: Surface, loop: IntArray) -> Cut | None:
    """Take the strip along a closed line out of a surface.

    Parameters
    ----------
    loop : (k,) point ids, joined in order by edges; no two others may be joined (no chords), none on a rim.

    Each edge that leaves the line is cut where it crosses the plane `GAP_SHARE` mean edge lengths beside the line's
    own plane, or as near to that as the edge goes. So the rims are smooth although the line jumps from point to
    point, and they are loops whatever the shape, since each follows the fans on one side of the line.
    """
    n = len(surface.points)
    on_line = np.zeros(n, bool)
    on_line[loop] = True
    triangles = surface.triangles
    in_strip = on_line[triangles].any(axis=1)
    strip = np.flatnonzero(in_strip)
    left = left_of(surface, loop, strip)

    # Cut points, one for each edge (from the line, away from it) and side.
    line = surface.points[loop]
    step = np.linalg.norm(np.roll(line, -1, axis=0) - line, axis=1).mean()
    normal = operators.area_vectors(
        np.concatenate([line, line.mean(axis=0)[None]]),
        np.stack([np.arange(len(loop)), np.roll(np.arange(len(loop)), -1), np.full(len(loop), len(loop))], axis=1),
    ).sum(axis=0)
    normal /= max(float(np.linalg.norm(normal)), np.finfo(float).tiny)
    height = (surface.points - line.mean(axis=0)) @ normal
    away = [np.unique(triangles[strip[left == side]]) for side in (False, True)]
    rise = [float(height[ids[~on_line[ids]]].mean()) for ids in away]
    up = np.array([rise[0] > rise[1], rise[1] >= rise[0]])

    corner = triangles[strip]
    flags = on_line[corner]
    new_triangles: list[IntArray] = []
    parents: list[IntArray] = []
    keys: dict[tuple[int, int], int] = {}
    ends: list[tuple[int, int]] = []
    of_side: list[bool] = []
    # Along the rims, surface on the left.
    following: dict[int, int] = {}

    def cut_point(inner: int, outer: int, side: bool) -> int:
        if (inner, outer) not in keys:
            keys[inner, outer] = n + len(ends)
            ends.append((inner, outer))
            of_side.append(side)
        return keys[inner, outer]

    for row, (ids, flag) in enumerate(zip(corner.tolist(), flags.tolist(), strict=True)):
        side = bool(left[row])
        if sum(flag) == 1:
            k = flag.index(True)
            a, b, c = ids[k], ids[(k + 1) % 3], ids[(k + 2) % 3]
            p, q = cut_point(a, b, side), cut_point(a, c, side)
            pieces = [(p, b, c), (p, c, q)]
            following[q] = p
        else:
            k = flag.index(False)
            c, a, b = ids[k], ids[(k + 1) % 3], ids[(k + 2) % 3]
            p, q = cut_point(a, c, side), cut_point(b, c, side)
            pieces = [(c, p, q)]
            following[p] = q
        new_triangles.append(np.array(pieces, np.int64))
        parents.append(np.full(len(pieces), strip[row]))
    inner, outer = np.array(ends, np.int64).T
    level = np.where(up[np.array(of_side, np.int64)], 1.0, -1.0) * GAP_SHARE * step
    climb = height[outer] - height[inner]
    # An edge that does not climb away from the line is cut where it must be, near its middle.
    aim = (level - height[inner]) / np.where(climb == 0.0, 1.0, climb)
    share = np.where(climb * level > 0, np.clip(aim, 0.2, 0.8), 0.5)

    # Points of the line drop out; all others keep their order.
    kept = np.flatnonzero(~on_line)
    number = np.full(n + len(ends), -1, np.int64)
    number[kept] = np.arange(len(kept))
    number[n:] = len(kept) + np.arange(len(ends))
    parent = np.concatenate([np.flatnonzero(~in_strip), *parents])
    opened = Surface(
        np.concatenate([surface.points[kept], _blend(surface.points, inner, outer, share)]),
        number[np.concatenate([triangles[~in_strip], *new_triangles])],
        {key: np.concatenate([v[kept], _blend(v, inner, outer, share)]) for key, v in surface.point_data.items()},
        {key: values[parent] for key, values in surface.cell_data.items()},
        surface.field_data,
        surface.space,
    )
    rims = [number[rim] for rim in _closed_chains(following)]
    return Cut(opened, (rims[0], rims[1])) if len(rims) == 2 else None


def _closed_chains(following: dict[int, int]) -> list[IntArray]:
    """Loops in which each point is followed by another."""
    left, chains = dict(following), []
    while left:
        first, point = left.popitem()
        chain = [first]
        while point != first:
            chain.append(point)
            point = left.pop(point)
        chains.append(np.array(chain, np.int64))
    return chains


def _blend(values: Array, inner: IntArray, outer: IntArray, share: FloatArray) -> Array:
    """Values at a share of the way along edges: interpolated, or of the nearer end where they are not floating."""
    if values.dtype.kind == "f":
        weight = share.reshape(-1, *[1] * (values.ndim - 1))
        return ((1.0 - weight) * values[inner] + weight * values[outer]).astype(values.dtype)
    return values[np.where(share < 0.5, inner, outer)]


def winding_number(surface: Surface, places: FloatArray) -> FloatArray:
    """How often a surface goes round each place, (k,): 1 inside, 0 outside, openings closed by fans.

    Source: solid angle of a triangle by Van Oosterom and Strackee 1983.
    """
    points, triangles = [surface.points], [surface.triangles]
    for number, rim in enumerate(surface.boundary_loops):
        points.append(surface.points[rim].mean(axis=0, keepdims=True))
        triangles.append(np.column_stack([np.roll(rim, -1), rim, np.full(len(rim), len(surface.points) + number)]))
    corners, ids = np.concatenate(points), np.concatenate(triangles)
    result = np.empty(len(places))
    for k, place in enumerate(places):
        offset = corners - place
        length = np.sqrt((offset**2).sum(axis=1))
        a, b, c = (offset[ids[:, corner]] for corner in range(3))
        la, lb, lc = (length[ids[:, corner]] for corner in range(3))
        triple = (
            a[:, 0] * (b[:, 1] * c[:, 2] - b[:, 2] * c[:, 1])
            + a[:, 1] * (b[:, 2] * c[:, 0] - b[:, 0] * c[:, 2])
            + a[:, 2] * (b[:, 0] * c[:, 1] - b[:, 1] * c[:, 0])
        )
        dots = [np.einsum("ij,ij->i", u, v) for u, v in ((a, b), (b, c), (c, a))]
        below = la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb
        result[k] = np.arctan2(triple, below).sum() / (2.0 * np.pi)
    return result
