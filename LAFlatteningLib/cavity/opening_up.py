"""Opening an atrium up after a plan: the cuts, and which rim is which opening."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..errors import SurfaceError
from ..progress import ProgressCallback, report
from ..surface import FloatArray, IntArray, Surface
from .clipping import clip
from .covers import HOLE_ARRAY, close_rims
from .openings import describe_loops
from .plan import CutPlan, PlannedOpening

SAME_RIM_MM = 0.5
"""A rim whose mean point is this near to that of a planned one is that one."""


def open_up(
    surface: Surface, plan: CutPlan, whole_triangles: bool = False, progress: ProgressCallback | None = None
) -> tuple[Surface, dict[str, IntArray]]:
    """Cut an atrium open as planned.

    Parameters
    ----------
    surface : the one that the plan was made for.
    whole_triangles : leave triangles whole at the rims (`clipping.clip`).

    Returns
    -------
    cavity : open at the openings of the plan and nowhere else.
    rims : opening -> its rim, ordered point ids of the cavity.

    Raises
    ------
    SurfaceError : a plane cuts nothing, planes run into each other.
    Cancelled : by `progress`.
    """
    result = surface
    for opening in plan.extra:
        try:
            result = _covered(clip(result, opening.plane, "the extra vein"), opening.plane.centre)
        except SurfaceError as error:
            raise SurfaceError(f"{error} It was planned by rule: leave the vein on (--extra-veins keep).") from error
    cut = {name: opening for name, opening in plan.openings.items() if opening.found_by != "open"}
    for number, (name, opening) in enumerate(cut.items()):
        report(progress, number / len(cut), f"Cutting {name}")
        try:
            result = clip(result, opening.plane, name, whole_triangles)
        except SurfaceError as error:
            done = list(cut)[:number]
            if not done:
                raise
            raise SurfaceError(
                f"{error} {', '.join(done)} were cut before: their planes may run into this one."
            ) from error
    for centre in plan.to_cover:
        # One that was cut off with a vein needs no cover.
        if any(
            np.linalg.norm(result.points[loop].mean(axis=0) - centre) < SAME_RIM_MM for loop in result.boundary_loops
        ):
            result = _covered(result, centre)
    return result, _named_rims(result, plan)


def _covered(surface: Surface, centre: FloatArray) -> Surface:
    """The surface with the rim round a place covered."""
    loop = min(
        surface.boundary_loops, key=lambda loop: float(np.linalg.norm(surface.points[loop].mean(axis=0) - centre))
    )
    closed, _ = close_rims(surface, [loop])
    if HOLE_ARRAY in surface.point_data:
        return closed
    return replace(closed, point_data={k: v for k, v in closed.point_data.items() if k != HOLE_ARRAY})


def _named_rims(cavity: Surface, plan: CutPlan) -> dict[str, IntArray]:
    loops = cavity.boundary_loops
    if len(loops) != len(plan.openings):
        raise SurfaceError(
            f"Expected {len(plan.openings)} openings ({', '.join(plan.openings)}) after cutting, found {len(loops)}: "
            f"{describe_loops(cavity, loops)}. Planes run into each other; move them apart."
        )
    rims: dict[str, IntArray] = {}
    for name, opening in plan.openings.items():
        loop = min(loops, key=lambda loop: _off(cavity.points[loop], opening))
        if any(loop is other for other in rims.values()):
            raise SurfaceError(f"{name} and another opening have one rim; move their planes apart.")
        rims[name] = loop
    return rims


def _off(rim: FloatArray, opening: PlannedOpening) -> float:
    """How far a rim is from where an opening was planned, mm."""
    apart = rim - opening.plane.centre
    from_plane = float(np.abs(apart @ opening.plane.normal).mean())
    return from_plane + float(np.linalg.norm(apart.mean(axis=0)))
