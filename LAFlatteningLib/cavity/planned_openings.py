"""Where a vein or the appendage is cut, or that it is open already; and where veins with one trunk part."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..errors import SurfaceError
from ..surface import FloatArray
from .candidates import Candidate, Planner
from .clipping import CutPlane
from .ostia import STEP_MM, WIDEST_VEIN_MM, Ostium
from .sections import Section, plane_section

KEEP_MM = 3.0
"""Length of vein or appendage that stays beyond its ostium."""
LONG_STUMP_MM = 8.0
"""An open vein is cut again only where more than this would be cut off: one that was cut before stays as it is."""
TUBE_SPREAD = 1.5
"""... and only if it is a tube that far: not wider in one place than in another by more than this."""
SMALLEST_RIM_MM = 10.0
"""No vein is so narrow (3 mm) where it is cut: that would be its very tip."""


@dataclass(frozen=True, eq=False)
class PlannedOpening:
    """One opening of the cavity.

    Attributes
    ----------
    plane : where it is cut, or lies if it is open.
    found_by : "ostium" (by rule from a tip), "open" (was open and stays as it is), "flat" or "rule" (mitral valve), or
        "given" (plane of the user).
    perimeter_mm : of its rim.
    kept_mm : length of the tube that stays beyond the ostium; NaN where that is unknown.
    tip : (3,) mm the tip of a tube that is cut; None for others.
    """

    plane: CutPlane
    found_by: str
    perimeter_mm: float
    kept_mm: float = float("nan")
    tip: FloatArray | None = None


def loop_plane(loop: FloatArray, outwards: FloatArray) -> CutPlane:
    """The mean plane of a closed curve (k, 3), its normal on the side of `outwards` (3,)."""
    centre = loop.mean(axis=0)
    normal = np.cross(loop - centre, np.roll(loop, -1, axis=0) - centre).sum(axis=0)
    return CutPlane(centre, normal if normal @ outwards >= 0 else -normal)


def plan_opening(planner: Planner, hole: str, candidate: Candidate) -> PlannedOpening:
    """Where a tube is cut, or that it is open already.

    Raises
    ------
    SurfaceError : no plane cuts it off.
    """
    ostium = candidate.ostium
    centre, normal, kept = ostium.plane_at(planner.keep_mm[hole])
    if candidate.rim is not None and not _is_long_stump(ostium, ostium.at_mm - kept):
        loop = planner.surface.points[planner.loops[candidate.rim]]
        return PlannedOpening(
            loop_plane(loop, candidate.tip - planner.lumen.centre),
            "open",
            planner.surface.loop_length(planner.loops[candidate.rim]),
        )
    if candidate.rim is not None:
        planner.notes.append(
            f"{hole} was open {ostium.at_mm:.0f} mm beyond its ostium; it was cut back to {kept:.1f} mm."
        )
    elif not ostium.found:
        planner.notes.append(f"{hole} widens from its tip, so that its ostium is uncertain; check its plane.")
    elif kept < planner.keep_mm[hole] - STEP_MM:
        planner.notes.append(
            f"{hole} is short: {kept:.1f} mm stay beyond its ostium, where {planner.keep_mm[hole]:g} were asked for."
        )
    section = plane_section(planner.closed, centre, normal)
    if section is None or not section.around or section.perimeter < SMALLEST_RIM_MM:
        place = ", ".join(f"{x:.0f}" for x in centre)
        raise SurfaceError(
            f"No plane was found that cuts {hole} off near ({place}) mm. Give its plane yourself (--planes), or "
            "mark its tip elsewhere (--tips)."
        )
    # The middle of a bent section may lie outside it; the centreline does not.
    middle = plane_section(planner.closed, section.centre, normal)
    if middle is not None and middle.around and np.isclose(middle.perimeter, section.perimeter):
        centre = section.centre
    return PlannedOpening(CutPlane(centre, normal), "ostium", section.perimeter, kept, candidate.tip)


def _is_long_stump(ostium: Ostium, beyond_mm: float) -> bool:
    """Whether an open tube goes on as a tube for so long that it is cut again."""
    stump = ostium.diameters[round(ostium.rounding_mm / STEP_MM) : round(beyond_mm / STEP_MM) + 1]
    stump = stump[np.isfinite(stump)]
    if not ostium.found or beyond_mm <= LONG_STUMP_MM or len(stump) == 0:
        return False
    return bool(stump.max() <= TUBE_SPREAD * stump.min())


def _takes(planner: Planner, section: Section, other: Candidate) -> bool:
    """Whether a cut would take another vein with it, or a part of its tube."""
    line = other.ostium.line.points
    if section.encloses(line):
        # The way of another vein into the body passes here only if that vein is beyond.
        return True
    tube = line[: round(other.ostium.at_mm / STEP_MM) + 1]
    return section.cuts_into(tube, planner.lumen.depth_at(tube))


def parted(planner: Planner, named: dict[str, Candidate]) -> dict[str, Candidate]:
    """The same, with ostia moved out where two veins have one in common, to where they part.

    Raises
    ------
    SurfaceError : two veins that do not part.
    """
    result = dict(named)
    for hole, candidate in named.items():
        if candidate.rim is not None:
            continue
        others = {other: c for other, c in named.items() if other != hole}
        ostium = candidate.ostium
        at = ostium.at_mm
        shared: set[str] = set()
        # Outwards from the cut, while the section goes round another vein that is cut farther out.
        while at > ostium.rounding_mm:
            centre, normal, _ = replace(ostium, at_mm=at).plane_at(planner.keep_mm[hole])
            section = plane_section(planner.closed, centre, normal)
            if section is None or not section.around:
                break
            inside = {other for other, c in others.items() if _takes(planner, section, c)}
            if not inside and (not shared or section.diameter <= WIDEST_VEIN_MM):
                break
            shared |= inside
            at -= STEP_MM
        if shared:
            if at <= ostium.rounding_mm:
                raise SurfaceError(
                    f"{hole} and {' and '.join(sorted(shared))} are one tube up to their tips. Expected two that "
                    "part; if they do, segment them farther out, or mark the tip of each (--tips)."
                )
            planner.notes.append(
                f"{hole} is one trunk with {' and '.join(sorted(shared))} at its ostium; it is cut where it leaves "
                f"it, {ostium.at_mm - at:.0f} mm farther out. The map shows the trunk between them, not a carina."
            )
            result[hole] = replace(candidate, ostium=replace(ostium, at_mm=at))
    return result
