"""The open cavity: which rims a surface has, their covers, and the surface between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from vtkmodules.vtkCommonCore import reference
from vtkmodules.vtkCommonDataModel import vtkGenericCell, vtkStaticCellLocator

from .. import topology
from ..anatomy import Anatomy
from ..errors import SurfaceError
from ..surface import FloatArray, IntArray, Surface
from .covers import HOLE_ARRAY, close_rims

POINT_ID_ARRAY = "surface_point_id"
"""Point array of the cavity: id of the point in the surface that was given."""

SNAP_LIMIT_MM = 10.0
"""A seed is never moved farther than this to reach its cover or rim."""

SIZE_LIMITS_MM = (20.0, 400.0)
"""Plausible diagonal of the bounding box of a heart chamber."""
MENDED_BY = "let it be prepared (la-flatten prepare; in Slicer, the section Prepare)"
"""What heals meshes and cuts openings by itself, for messages."""


@dataclass(frozen=True, eq=False)
class Cavity:
    """An atrium between its rims, with its covers.

    Attributes
    ----------
    closed : the surface with every hole covered; only the outer rim is open. Outward oriented.
    cover : (triangles of `closed`,) number of the hole that a triangle covers, -1 on the cavity itself.
    surface : the cavity alone, with the point array ``surface_point_id``.
    ids : (points of `surface`,) their ids in `closed`.
    rims : for each hole, its rim as ordered ids of `surface`, surface on the left
        (clockwise round the hole on the map).
    outer : the outer rim, likewise (counter-clockwise on the map).
    notes : what was repaired on the way, for the user.
    """

    closed: Surface
    cover: IntArray
    surface: Surface
    ids: IntArray
    rims: tuple[IntArray, ...]
    outer: IntArray
    notes: tuple[str, ...] = ()

    @cached_property
    def number(self) -> IntArray:
        """(points of `closed`,) their ids in `surface`, -1 inside covers."""
        number = np.full(len(self.closed.points), -1, np.int64)
        number[self.ids] = np.arange(len(self.ids))
        return number

    @cached_property
    def cover_points(self) -> tuple[IntArray, ...]:
        """For each hole, ids in `closed` of the points inside its cover (the rim left out)."""
        covers = [np.unique(self.closed.triangles[self.cover == hole]) for hole in range(len(self.rims))]
        return tuple(points[self.number[points] < 0] for points in covers)

    def on_cover(self, hole: int, position: FloatArray) -> FloatArray:
        """The place on a cover nearest to a position, (3,) mm, in a triangle or on its border."""
        if hole not in self._locators:
            cover, _ = self.closed.submesh(self.cover == hole)
            locator = vtkStaticCellLocator()
            locator.SetDataSet(cover.to_polydata())
            locator.BuildLocator()
            self._locators[hole] = locator
        nearest = [0.0, 0.0, 0.0]
        # The last three are out-parameters, which the type stubs of VTK take for numbers.
        out: Any = (reference(0), reference(0), reference(0.0))
        self._locators[hole].FindClosestPoint(position.tolist(), nearest, vtkGenericCell(), *out)
        return np.array(nearest)

    @cached_property
    def _locators(self) -> dict[int, vtkStaticCellLocator]:
        return {}

    def __getstate__(self) -> dict[str, Any]:
        # Maps go from process to process; objects of VTK cannot, and are made again.
        return {name: value for name, value in self.__dict__.items() if name != "_locators"}


def describe_loops(surface: Surface, loops: list[IntArray]) -> str:
    """A line for each rim: perimeter and centre, for messages."""
    return "; ".join(
        f"{surface.loop_length(loop):.0f} mm round ({', '.join(f'{x:.0f}' for x in surface.points[loop].mean(axis=0))})"
        for loop in loops
    )


def check_surface(surface: Surface, handles_allowed: bool = False) -> tuple[Surface, list[str]]:
    """Check that a surface is one connected, orientable manifold without handles, of plausible size.

    Parameters
    ----------
    handles_allowed : let handles pass, because they will be cut (`handles.remove_handles`).

    Returns
    -------
    surface : the same, with all triangles facing outwards.
    notes : what was mended.

    Raises
    ------
    SurfaceError : saying what is wrong, where, and what to do.
    """
    notes: list[str] = []
    low, high = surface.points[surface.used_points].min(axis=0), surface.points[surface.used_points].max(axis=0)
    size = float(np.linalg.norm(high - low))
    if not SIZE_LIMITS_MM[0] <= size <= SIZE_LIMITS_MM[1]:
        message = (
            f"The surface is {size:.3g} mm across; expected a heart chamber of {SIZE_LIMITS_MM[0]:.0f} to "
            f"{SIZE_LIMITS_MM[1]:.0f} mm."
        )
        guess = guess_unit(size)
        if np.ptp(surface.points[:, 2]) == 0.0:
            message += " It is flat: it looks like a map, not like an atrium."
        elif guess:
            message += f" The coordinates look like {guess[0]}: multiply them by {guess[1]:g} to get mm."
        raise SurfaceError(message)
    shortest = surface.edge_lengths.min()
    if shortest == 0.0:
        a, b = surface.edges.points[surface.edge_lengths.argmin()]
        raise SurfaceError(
            f"Points {a} and {b}, joined by an edge, are at the same place"
            f" ({', '.join(f'{x:.1f}' for x in surface.points[a])} mm), as are the ends of "
            f"{np.count_nonzero(surface.edge_lengths == 0.0)} edges in all. Merge coincident points and remove "
            f"triangles without area (in Slicer: Surface Toolbox, Clean), or {MENDED_BY}."
        )
    bad = surface.non_manifold_points
    if len(bad):
        place = ", ".join(f"{x:.1f}" for x in surface.points[bad[0]])
        raise SurfaceError(
            f"The surface is not a clean sheet at {len(bad)} points (the first is point {bad[0]} at {place} mm): more "
            "than two triangles share an edge, or two sheets touch in a point. Clean or remesh the surface, or "
            f"{MENDED_BY}."
        )
    if surface.component_count > 1:
        sizes = np.sort(np.bincount(surface.components))[::-1]
        raise SurfaceError(
            f"The surface has {len(sizes)} separate pieces (of {', '.join(map(str, sizes[:5]))} triangles); expected "
            "one. "
            + (
                "Its triangles do not share their points: merge coincident points (in Slicer: Surface Toolbox, Clean)."
                if len(np.unique(surface.points, axis=0)) < 0.6 * len(surface.points)
                else "Keep the right one (the largest: in Slicer, Surface Toolbox, Extract largest component), or "
                f"{MENDED_BY}."
            )
        )
    if not surface.is_oriented:
        surface = surface.with_triangles(topology.orient(surface.triangles, surface.edges))
        notes.append("Triangles were not all turned the same way; they were made consistent.")
    if surface.genus > 0 and not handles_allowed:
        raise SurfaceError(
            f"The surface has {surface.genus} handle{'s' if surface.genus > 1 else ''} (like the handle of a cup), "
            "usually veins or the appendage touching each other; expected none. Separate them in the segmentation "
            "and make the surface again."
        )
    if surface.enclosed_volume < 0:
        surface = surface.with_triangles(surface.triangles[:, ::-1])
        notes.append("Triangles faced inwards; they were turned outwards.")
    return surface, notes


def guess_unit(size: float) -> tuple[str, float] | None:
    """The unit in which a bounding box diagonal is that of a heart chamber, and how many mm it has; None if unclear."""
    for name, mm in (("mm", 1.0), ("centimetres", 10.0), ("metres", 1000.0), ("micrometres", 0.001)):
        if SIZE_LIMITS_MM[0] <= size * mm <= SIZE_LIMITS_MM[1]:
            return name, mm
    return None


def make_cavity(surface: Surface, anatomy: Anatomy, outer_points: FloatArray) -> Cavity:
    """Find the openings of a surface, cover its holes and separate the cavity from the covers.

    Parameters
    ----------
    surface : an atrium open at every opening; or with covers over some of them, their inner points marked
        by a point array ``hole`` = 1 (rim points 0).
    outer_points : (k, 3) points near the rim that becomes the outer rim of the map: the seeds on it.

    Raises
    ------
    SurfaceError : not a clean surface (`check_surface`), or another number of openings than the anatomy has.
    """
    surface, notes = check_surface(surface)
    cover = _marked_covers(surface)
    open_loops = surface.boundary_loops
    covered = int(cover.max()) + 1
    expected = len(anatomy.openings)
    if len(open_loops) + covered != expected or not open_loops:
        found = f"{len(open_loops)} open" + (f" and {covered} covered" if covered else "")
        detail = f": {describe_loops(surface, open_loops)}" if open_loops else ""
        raise SurfaceError(
            f"Expected {expected} openings ({', '.join(anatomy.openings)}), {anatomy.outer} open; "
            f"found {found}{detail}. "
            + (
                f"Cut the missing ones open first, or {MENDED_BY}."
                if len(open_loops) + covered < expected or not open_loops
                else f"Close the openings that are none, mark them as covered, or {MENDED_BY}."
            )
        )
    outer = nearest_rim(surface, open_loops, outer_points)
    to_close = [loop for k, loop in enumerate(open_loops) if k != outer]
    if to_close:
        closed, added = close_rims(surface, to_close)
        cover = np.where(added >= 0, added + covered, np.concatenate([cover, np.full(len(added) - len(cover), -1)]))
    else:
        closed = surface
    part, ids = closed.submesh(cover < 0)
    part = part.with_data({POINT_ID_ARRAY: ids})
    if HOLE_ARRAY not in surface.point_data:
        part = replace(part, point_data={k: v for k, v in part.point_data.items() if k != HOLE_ARRAY})
    if len(part.boundary_loops) != expected:
        raise SurfaceError(
            f"The cavity between the covers has {len(part.boundary_loops)} rims, expected {expected}: covers touch "
            "each other or the outer rim. Leave at least one row of triangles between openings."
        )
    covered_by = np.full(len(closed.points), -1, np.int64)
    covered_by[closed.triangles[cover >= 0]] = cover[cover >= 0, None]
    rims: dict[int, IntArray] = {}
    for loop in part.boundary_loops:
        # A rim point may touch a second cover only if the surface between them is one point wide.
        number = int(np.bincount(covered_by[ids[loop]] + 1).argmax()) - 1
        if number < 0:
            outer_rim = loop
        else:
            rims[number] = loop
    return Cavity(closed, cover, part, ids, tuple(rims[k] for k in sorted(rims)), outer_rim, tuple(notes))


def open_covers(surface: Surface) -> tuple[Surface, int]:
    """The surface without the covers that the array ``hole`` marks, and without that array; and how many these were.

    Raises
    ------
    SurfaceError : an array of this name that marks no covers.
    """
    cover = _marked_covers(surface)
    kept = {name: values for name, values in surface.point_data.items() if name != HOLE_ARRAY}
    bare = replace(surface, point_data=kept)
    count = int(cover.max(initial=-1)) + 1
    return (bare.submesh(cover < 0)[0] if count else bare), count


def _marked_covers(surface: Surface) -> IntArray:
    """(m,) number of the cover that each triangle belongs to, going by the array ``hole``; -1 for none."""
    none = np.full(len(surface.triangles), -1, np.int64)
    if HOLE_ARRAY not in surface.point_data:
        return none
    values = np.asarray(surface.point_data[HOLE_ARRAY]).reshape(len(surface.points), -1)[:, 0]
    if values.dtype.kind not in "fiub" or not np.isin(values, (0, 1)).all():
        raise SurfaceError(
            f'The point array "{HOLE_ARRAY}" marks covers with 1 and everything else with 0; found other values. '
            "Correct the array, or remove it if it means something else."
        )
    at_points = values == 1
    marked = np.any(at_points[surface.triangles], axis=1)
    if not marked.any():
        return none
    if marked.all():
        raise SurfaceError('The point array "hole" marks the whole surface as covers; expected 1 on covers only.')
    part = topology.triangle_components(
        surface.triangles, surface.edges, marked[surface.edges.triangles[:, 0]] != marked[surface.edges.triangles[:, 1]]
    )
    _, none[marked] = np.unique(part[marked], return_inverse=True)
    return none


def nearest_rim(surface: Surface, loops: Sequence[IntArray], points: FloatArray) -> int:
    """Number of the rim to which points (k, 3) are closest (median distance); of the longest one if they are near
    none, as when they are in other axes."""
    distance = [
        np.median(np.linalg.norm(surface.points[loop][None] - points[:, None], axis=2).min(axis=1)) for loop in loops
    ]
    if min(distance) > SNAP_LIMIT_MM:
        return int(np.argmax([surface.loop_length(loop) for loop in loops]))
    return int(np.argmin(distance))
