"""Clipping: cutting a vein, the appendage or the valve off a surface in a plane."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .. import topology
from ..errors import SurfaceError
from ..surface import Array, FloatArray, IntArray, Surface
from .sections import Section, plane_section

SNAP = 0.2
"""A point nearer to the plane than this share of an edge slides along the edge into it, so that no slivers are cut."""


@dataclass(frozen=True, eq=False)
class CutPlane:
    """A plane that cuts one tube, not the whole atrium.

    Attributes
    ----------
    centre : (3,) in the middle of the tube, mm.
    normal : (3,) unit vector out of the chamber: what lies beyond is cut off.
    """

    centre: FloatArray
    normal: FloatArray

    def __post_init__(self) -> None:
        centre, normal = np.asarray(self.centre, np.float64), np.asarray(self.normal, np.float64)
        length = np.linalg.norm(normal) if normal.shape == (3,) else 0.0
        if centre.shape != (3,) or not (np.isfinite(centre).all() and np.isfinite(length) and length > 0):
            raise SurfaceError(
                f"Expected a plane as a place and a normal of three numbers each, found {centre.tolist()} and "
                f"{normal.tolist()}."
            )
        object.__setattr__(self, "centre", centre)
        object.__setattr__(self, "normal", normal / length)


def clip(surface: Surface, plane: CutPlane, name: str = "", whole_triangles: bool = False) -> Surface:
    """The surface without what lies beyond a plane on one tube.

    Only the curve round the centre of the plane is cut; other parts of the surface that the plane meets stay.

    Parameters
    ----------
    surface : open or closed, mm.
    name : what is cut off, for messages.
    whole_triangles : leave triangles whole; the rim is then jagged by up to half an edge.

    Returns
    -------
    The rest, with one rim more. Cut triangles are divided; new points lie in the plane and on edges of the surface,
    with values interpolated along these. Point ids change; cell arrays go from a triangle to its parts.

    Raises
    ------
    SurfaceError : the plane does not go round a tube, or cuts nothing off there.
    """
    what = f"The plane of {name}" if name else "The plane"
    section = plane_section(surface, plane.centre, plane.normal)
    if section is None or not section.around:
        place = ", ".join(f"{x:.1f}" for x in plane.centre)
        raise SurfaceError(
            f"{what} at ({place}) mm does not cut a closed curve round its centre out of the surface. Move its centre "
            "into the middle of the tube that it is to cut."
        )
    side = (surface.points - plane.centre) @ plane.normal
    if whole_triangles:
        result = _without_whole(surface, side, section, what)
    else:
        try:
            result = _without_cut(surface, side, section, what, SNAP)
        except _SnapError:
            result = _without_cut(surface, side, section, what, 0.0)
    if not result.is_manifold:
        raise SurfaceError(f"{what} grazes the surface, so that the rim would touch itself. Move or turn it a little.")
    return result


class _SnapError(Exception):
    """Sliding points into the plane flattened a triangle."""


def _without_whole(surface: Surface, side: FloatArray, section: Section, what: str) -> Surface:
    beyond = np.zeros(len(surface.triangles), bool)
    beyond[section.triangles] = side[surface.triangles[section.triangles]].mean(axis=1) > 0.0
    # Round the curve, triangles belong to the side where they are; elsewhere to what they are connected to.
    near = np.zeros(len(surface.points), bool)
    near[surface.triangles[section.triangles]] = True
    band = near[surface.triangles].any(axis=1)
    passed = np.zeros(len(surface.triangles), bool)
    passed[section.triangles] = True
    beyond[band & ~passed] = side[surface.triangles[band & ~passed]].mean(axis=1) > 0.0
    keep = ~_beyond(surface, beyond, np.asarray(band), what)
    # A corner where the rest only touches itself goes with what is cut off.
    for _ in range(10):
        part, ids = surface.submesh(keep)
        if part.is_manifold:
            return part
        touching = np.isin(surface.triangles, ids[part.non_manifold_points]).any(axis=1)
        keep &= ~(touching & band)
    return part


def _beyond(surface: Surface, beyond: NDArray[np.bool_], band: NDArray[np.bool_], what: str) -> NDArray[np.bool_]:
    """Which triangles are cut off, given the side of those in a band round the curve."""
    a, b = surface.edges.triangles.T
    blocked = (b >= 0) & band[a] & band[b] & (beyond[a] != beyond[b])
    piece = topology.triangle_components(surface.triangles, surface.edges, blocked)
    off = np.unique(piece[band & beyond])
    rest = np.unique(piece[band & ~beyond])
    if len(off) == 0 or len(np.intersect1d(off, rest)):
        raise SurfaceError(f"{what} does not cut anything off: the surface is connected round it. Move or turn it.")
    return np.asarray(np.isin(piece, off))


def _without_cut(surface: Surface, side: FloatArray, section: Section, what: str, snap: float) -> Surface:
    cut = np.zeros(len(surface.triangles), bool)
    cut[section.triangles] = True
    snapped, side = _snapped(surface, side, cut, snap)
    divided, side, on_curve = _divided(snapped, side, cut)
    near = on_curve[divided.triangles].any(axis=1)
    flat = on_curve[divided.triangles].all(axis=1)
    if flat.any() or (divided.triangle_areas[near] <= 1e-12).any():
        if snap > 0.0:
            raise _SnapError
        raise SurfaceError(f"{what} cuts triangles into parts without area. Move it a little.")
    corner = np.where(on_curve[divided.triangles], 0.0, side[divided.triangles])
    beyond = np.asarray(near & (corner.sum(axis=1) > 0.0))
    part, _ = divided.submesh(~_beyond(divided, beyond, np.asarray(near), what))
    return part


def _snapped(surface: Surface, side: FloatArray, cut: NDArray[np.bool_], snap: float) -> tuple[Surface, FloatArray]:
    """Points of cut triangles that are near the plane moved into it along an edge; and the new sides, 0 there."""
    edge = np.unique(surface.edges.of_triangle[cut])
    a, b = surface.edges.points[edge].T
    crossed = (side[a] > 0.0) != (side[b] > 0.0)
    a, b = a[crossed], b[crossed]
    share = side[a] / (side[a] - side[b])
    point = np.concatenate([a, b])
    other = np.concatenate([b, a])
    share = np.concatenate([share, 1.0 - share])
    close = share < snap
    order = np.argsort(share[close], kind="stable")
    point, first = np.unique(point[close][order], return_index=True)
    other, share = other[close][order][first], share[close][order][first]
    side = side.copy()
    side[point] = 0.0
    points = surface.points.copy()
    points[point] += share[:, None] * (surface.points[other] - surface.points[point])
    data = {}
    for name, values in surface.point_data.items():
        if len(point) and values.dtype.kind == "f":
            values = values.copy()
            values[point] = _between(surface.point_data[name], point, other, share)
        data[name] = values
    return replace(surface, points=points, point_data=data), side


def _between(values: Array, a: IntArray, b: IntArray, share: FloatArray) -> Array:
    """Values on edges, at a share of the way from a to b; of the nearer end where they are not real numbers."""
    if values.dtype.kind != "f":
        return values[np.where(share < 0.5, a, b)]
    weight = share.reshape(-1, *[1] * (values.ndim - 1))
    mixed = (1.0 - weight) * values[a] + weight * values[b]
    nearer = values[np.where(share < 0.5, a, b)]
    return np.where(np.isfinite(mixed), mixed, nearer).astype(values.dtype)


def _divided(
    surface: Surface, side: FloatArray, cut: NDArray[np.bool_]
) -> tuple[Surface, FloatArray, NDArray[np.bool_]]:
    """The surface with cut triangles divided along the plane; the sides of all points, and which are on the curve."""
    n = len(surface.points)
    sign = np.sign(side)
    corners = surface.triangles[cut]
    passed = (sign[corners].max(axis=1) > 0) & (sign[corners].min(axis=1) < 0)
    parents = np.flatnonzero(cut)[passed]
    corners = surface.triangles[parents]
    ends = np.sort(np.stack([corners[:, [1, 2]], corners[:, [2, 0]], corners[:, [0, 1]]], axis=1), axis=2)
    crossed = sign[ends[:, :, 0]] * sign[ends[:, :, 1]] < 0
    edges, number = np.unique(ends[crossed], axis=0, return_inverse=True)
    a, b = edges.T if len(edges) else (np.zeros(0, np.int64), np.zeros(0, np.int64))
    share = side[a] / (side[a] - side[b]) if len(edges) else np.zeros(0)
    middle = np.full(crossed.shape, -1, np.int64)
    middle[crossed] = n + number.reshape(-1)
    triangles: list[tuple[int, int, int]] = []
    origin: list[int] = []
    for parent, corner, mid in zip(parents.tolist(), corners.tolist(), middle.tolist(), strict=True):
        parts = _parts(corner, mid)
        triangles += parts
        origin += [parent] * len(parts)
    stay = np.ones(len(surface.triangles), bool)
    stay[parents] = False
    source = np.concatenate([np.flatnonzero(stay), np.array(origin, np.int64)])
    points = np.concatenate(
        [surface.points, surface.points[a] + share[:, None] * (surface.points[b] - surface.points[a])]
    )
    divided = Surface(
        points,
        np.concatenate([surface.triangles[stay], np.array(triangles, np.int64).reshape(-1, 3)]),
        {k: np.concatenate([v, _between(v, a, b, share)]) for k, v in surface.point_data.items()},
        {k: v[source] for k, v in surface.cell_data.items()},
        surface.field_data,
        surface.space,
    )
    on_curve = np.zeros(len(points), bool)
    on_curve[n:] = True
    on_curve[surface.triangles[cut]] |= sign[surface.triangles[cut]] == 0
    return divided, np.concatenate([side, np.zeros(len(a))]), on_curve


def _parts(corner: list[int], middle: list[int]) -> list[tuple[int, int, int]]:
    """The parts of a triangle whose edges have points in the middle; `middle[k]` is opposite corner k, -1 for none."""
    crossed = [k for k in range(3) if middle[k] >= 0]
    if len(crossed) == 1:
        # The plane passes corner k and the point opposite.
        k = crossed[0]
        i, j = (k + 1) % 3, (k + 2) % 3
        return [(corner[k], corner[i], middle[k]), (corner[k], middle[k], corner[j])]
    # The edges next to corner k are crossed: a triangle there, and two for the rest.
    k = next(k for k in range(3) if middle[k] < 0)
    i, j = (k + 1) % 3, (k + 2) % 3
    return [
        (corner[k], middle[j], middle[i]),
        (middle[j], corner[i], corner[j]),
        (middle[j], corner[j], middle[i]),
    ]
