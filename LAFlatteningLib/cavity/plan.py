"""Which openings an atrium has or gets: the plan of the cuts, made by rule and open to correction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..anatomy import Anatomy
from ..errors import SeedError, SurfaceError
from ..progress import ProgressCallback, report
from ..seeds import check_directions
from ..surface import FloatArray, Surface
from .candidates import EXTRA_RISE_MM, OWN_OPENING_MM, Candidate, Planner, candidates_by_rule, candidates_from_tips
from .clipping import CutPlane, clip
from .mitral import mitral_plane
from .openings import describe_loops
from .ostia import WIDEST_VEIN_MM, Ostium, find_ostium
from .planned_openings import KEEP_MM, PlannedOpening, loop_plane, parted, plan_opening
from .recognition import Recognition, VeinsMissingError
from .sections import plane_section
from .tips import find_tips

SMALLEST_EXTRA_MM = 15.0
"""An extra vein is so long round (5 mm wide); less is a twig or noise, and hardly disturbs a map."""
NEAR_OSTIUM_MM = 15.0
"""A branch that leaves its vein within this of the cut may be an extra vein with a common ostium."""
MIRRORED_RATIO = 1.4
"""The atrium is taken for mirrored where a vein in the appendage's mirror place is wider than it by this factor (.4 to
.85 in nine atria, 1.15 in one)."""


USUAL_VALVE_MM = (80.0, 165.0)
"""Perimeter of the mitral opening; 104 to 155 mm in the atria at hand that are cut well. Others are noted."""


@dataclass(frozen=True, eq=False)
class CutPlan:
    """All openings of an atrium, before anything is cut.

    Attributes
    ----------
    openings : opening -> where it is, for every opening of the anatomy.
    extra : planes of further veins, which are cut off and covered.
    to_cover : (3,) centres of open rims that are none of the openings, mm.
    recognition : how sure the names are; None where they were given.
    notes : what to look at, in words.
    """

    openings: Mapping[str, PlannedOpening]
    extra: Sequence[PlannedOpening] = ()
    to_cover: Sequence[FloatArray] = ()
    recognition: Recognition | None = None
    notes: Sequence[str] = ()

    @property
    def confidence(self) -> str:
        """ "high", "low", or "given" where the names are the user's."""
        return "given" if self.recognition is None else self.recognition.confidence


def plan_cuts(
    surface: Surface,
    anatomy: Anatomy,
    *,
    tips: Mapping[str, FloatArray] | None = None,
    planes: Mapping[str, CutPlane] | None = None,
    keep_mm: Mapping[str, float] | None = None,
    ignore_axes: bool = False,
    extra_veins: str = "cover",
    progress: ProgressCallback | None = None,
) -> CutPlan:
    """Find the openings of an atrium: those that are open, and where the others are to be cut.

    Parameters
    ----------
    surface : one connected, outward oriented manifold without handles, mm; closed, or open at some openings.
    tips : hole -> (3,) mm, the end of each vein and the appendage; found and named by rule if None.
    planes : opening -> plane of the user, for some or all openings; the others are found by rule.
    keep_mm : hole -> length that stays beyond its ostium, mm (`KEEP_MM`).
    ignore_axes : the coordinates are not the patient's axes.
    extra_veins : "cover" cuts further veins off and covers them, "keep" leaves them on the surface.

    Raises
    ------
    SurfaceError : veins missing, two tips on one vein, mirrored or turned, no room for the valve.
    SeedError : tips with labels missing or far from the surface.
    Cancelled : by `progress`.
    """
    planes = dict(planes or {})
    _check_names(anatomy, tips, planes)
    keep = dict.fromkeys(anatomy.holes, KEEP_MM) | dict(keep_mm or {})
    report(progress, 0.0, "Looking into the atrium")
    planner = Planner(surface, anatomy, keep, None if ignore_axes else surface.space)
    valve = planner.valve_rim()
    report(progress, 0.2, "Finding veins")
    recognition = None
    candidates: list[Candidate] = []
    if tips is not None:
        named = candidates_from_tips(planner, tips, valve)
    elif all(hole in planes for hole in anatomy.holes):
        named = {}
    else:
        named, recognition, candidates = candidates_by_rule(planner, valve)
    try:
        named, openings = _openings(planner, named, planes, valve, recognition, ignore_axes)
    except SurfaceError as error:
        if not planner.faint:
            raise
        raise VeinsMissingError(
            f"{' and '.join(planner.faint)} {'was' if len(planner.faint) == 1 else 'were'} not found: hardly anything "
            f"stands out there, and no cut fits ({error}) Expected four pulmonary veins and an appendage; a common "
            "trunk must have two branches of some length. Mark the tip of each vein (--tips), give planes (--planes), "
            "or segment the veins farther out."
        ) from error
    if recognition is not None:
        found_at = {hole: c.ostium.line.at(c.ostium.at_mm)[0] for hole, c in named.items()}
        for hole in (name for name in planes if name in found_at):
            nearest = min(found_at, key=lambda name: float(np.linalg.norm(found_at[name] - planes[hole].centre)))
            if nearest != hole:
                planner.notes.append(f"The plane given for {hole} lies where {nearest} was found; check its name.")
                recognition = replace(recognition, confidence="low")
        recognition = _checked_for_mirroring(planner, recognition, openings)
    open_at = [opening.plane.centre for opening in openings.values() if opening.found_by == "open"]
    used = {valve} | {
        int(np.argmin([np.linalg.norm(surface.points[loop].mean(axis=0) - centre) for loop in planner.loops]))
        for centre in open_at
    }
    used |= {c.rim for c in named.values() if c.rim is not None}
    to_cover = [surface.points[loop].mean(axis=0) for k, loop in enumerate(planner.loops) if k not in used]
    if to_cover:
        closed = [planner.loops[k] for k in range(len(planner.loops)) if k not in used]
        planner.notes.append(
            f"Covered {len(closed)} opening{'s' if len(closed) > 1 else ''} that {'are' if len(closed) > 1 else 'is'} "
            f"none of the {len(anatomy.openings)}: {describe_loops(surface, closed)}."
        )
    noted = len(planner.notes)
    extra = _extra_veins(planner, named, openings, candidates, extra_veins)
    rims = [hole for hole in anatomy.holes if openings[hole].found_by == "open"]
    if recognition is not None and rims and any("An extra vein" in note for note in planner.notes[noted:]):
        planner.notes.append(
            f"Taken from open rims: {', '.join(rims)}; but a closed vein is left over. If one of these rims is a hole "
            "in the wall, close it, or mark the tip of each vein (--tips)."
        )
        recognition = replace(recognition, confidence="low")
    notes = [
        *(recognition.notes if recognition else ()),
        *planner.notes,
        *_valve_notes(openings[anatomy.outer], anatomy),
    ]
    return CutPlan(openings, extra, to_cover, recognition, notes)


def _openings(
    planner: Planner,
    named: Mapping[str, Candidate],
    planes: Mapping[str, CutPlane],
    valve: int | None,
    recognition: Recognition | None,
    ignore_axes: bool,
) -> tuple[dict[str, Candidate], dict[str, PlannedOpening]]:
    """The candidates with their final ostia, and the openings that they become."""
    anatomy = planner.anatomy
    with_necks = {
        hole: replace(c, ostium=find_ostium(planner.closed, planner.lumen, c.tip, neck=True))
        if hole in anatomy.appendages and c.rim is None
        else c
        for hole, c in named.items()
    }
    final = parted(planner, with_necks)
    openings = {
        hole: _given(planner, planes[hole]) if hole in planes else plan_opening(planner, hole, final[hole])
        for hole in anatomy.holes
    }
    if recognition is None and not ignore_axes:
        check_directions({hole: openings[hole].plane.centre for hole in anatomy.holes}, planner.surface.space, anatomy)
    openings[anatomy.outer] = _valve(planner, openings, planes, valve, _usual_valve(planner, recognition))
    return final, openings


def _check_names(anatomy: Anatomy, tips: Mapping[str, FloatArray] | None, planes: Mapping[str, CutPlane]) -> None:
    unknown = [name for name in planes if name not in anatomy.openings]
    if unknown:
        raise SurfaceError(
            f"There is a plane for {', '.join(map(ascii, unknown))}; expected names out of "
            f"{', '.join(anatomy.openings)}."
        )
    if tips is not None:
        missing = tuple(hole for hole in anatomy.holes if hole not in tips and hole not in planes)
        if missing:
            raise SeedError(
                f"Tip{'s' if len(missing) > 1 else ''} missing: {', '.join(missing)}. Expected one at the end of each "
                f"of {', '.join(anatomy.holes)}.",
                missing,
            )


def _checked_for_mirroring(
    planner: Planner, recognition: Recognition, openings: Mapping[str, PlannedOpening]
) -> Recognition:
    """The recognition, less sure where the mirror image of the atrium would be as likely.

    Mirrored front to back, the appendage lies where an inferior vein belongs and the other way round. What tells them
    apart is that the appendage is the wider.

    Raises
    ------
    SurfaceError : what would be the appendage in the mirror image is much wider.
    """
    for appendage in planner.anatomy.appendages:
        other = next(
            (hole for hole, k in recognition.index.items() if k == recognition.mirrored.get(appendage)), appendage
        )
        ratio = openings[other].perimeter_mm / openings[appendage].perimeter_mm
        # Not a number where a given plane meets nothing; cutting tells that.
        if not ratio > 1.0:
            continue
        suspicion = (
            f"{other} ({openings[other].perimeter_mm:.0f} mm round) is wider than {appendage} "
            f"({openings[appendage].perimeter_mm:.0f} mm)"
        )
        if ratio >= MIRRORED_RATIO:
            raise SurfaceError(
                f"{suspicion}, as in the mirror image of an atrium, in which they lie the other way round. Check the "
                "direction matrix of the image; if it is right, mark the tip of each vein (--tips)."
            )
        planner.notes.append(f"{suspicion}; in a mirrored atrium they would be exchanged. Check which is which.")
        recognition = replace(recognition, confidence="low")
    return recognition


def _given(planner: Planner, plane: CutPlane) -> PlannedOpening:
    """An opening in the plane of the user; one that is at an open rim is that rim."""
    for loop in planner.loops:
        if np.linalg.norm(planner.surface.points[loop].mean(axis=0) - plane.centre) < OWN_OPENING_MM:
            return PlannedOpening(plane, "open", planner.surface.loop_length(loop))
    if (planner.lumen.centre - plane.centre) @ plane.normal > 0.0:
        # It would cut the chamber off and leave the vein.
        plane = CutPlane(plane.centre, -plane.normal)
        planner.notes.append("The normal of a given plane pointed into the chamber; it was reversed.")
    section = plane_section(planner.closed, plane.centre, plane.normal)
    perimeter = section.perimeter if section is not None and section.around else float("nan")
    return PlannedOpening(plane, "given", perimeter)


def _usual_valve(planner: Planner, recognition: Recognition | None) -> FloatArray | None:
    """The direction in which the valve usually lies from the middle of the chamber; None where it is not known."""
    layout = planner.anatomy.layout
    if not layout or (recognition is None and planner.space is None):
        return None
    direction = np.array(layout[planner.anatomy.outer])
    if planner.space == "RAS":
        direction = direction * [-1.0, -1.0, 1.0]
    if recognition is not None:
        direction = recognition.rotation @ direction
    return direction / np.linalg.norm(direction)


def _valve(
    planner: Planner,
    openings: Mapping[str, PlannedOpening],
    planes: Mapping[str, CutPlane],
    valve: int | None,
    usual: FloatArray | None,
) -> PlannedOpening:
    """The opening of the valve: open, given or by rule."""
    anatomy = planner.anatomy
    if anatomy.outer in planes:
        given = _given(planner, planes[anatomy.outer])
        centres = np.array([openings[hole].plane.centre for hole in anatomy.holes])
        beyond = (centres - given.plane.centre) @ given.plane.normal
        if given.found_by == "given" and (beyond > 0.0).all():
            return replace(given, plane=CutPlane(given.plane.centre, -given.plane.normal))
        return given
    veins = [openings[hole].plane.centre for hole in anatomy.holes if hole not in anatomy.appendages]
    if valve is not None:
        loop = planner.surface.points[planner.loops[valve]]
        outwards = loop.mean(axis=0) - np.mean(veins, axis=0)
        return PlannedOpening(loop_plane(loop, outwards), "open", planner.surface.loop_length(planner.loops[valve]))
    body = planner.surface
    done: list[str] = []
    for hole in anatomy.holes:
        if openings[hole].found_by == "open":
            continue
        try:
            body = clip(body, openings[hole].plane, hole)
        except SurfaceError as error:
            if not done or openings[hole].found_by == "given":
                raise
            nearest = min(
                done,
                key=lambda other: float(np.linalg.norm(openings[other].plane.centre - openings[hole].plane.centre)),
            )
            raise SurfaceError(
                f"{hole} and {nearest} cannot be cut apart: they are one trunk nearly up to their tips. Expected two "
                "veins that part well before their ends. Segment them farther out, or give their planes (--planes)."
            ) from error
        done.append(hole)
    found = mitral_plane(body, veins, usual)
    planner.notes += found.notes
    return PlannedOpening(found.plane, found.found_by, found.perimeter_mm)


def _valve_notes(valve: PlannedOpening, anatomy: Anatomy) -> list[str]:
    """A note where the valve is smaller or larger than valves are: all areas depend on where it is cut."""
    low, high = USUAL_VALVE_MM
    if not anatomy.layout or not np.isfinite(valve.perimeter_mm) or low <= valve.perimeter_mm <= high:
        return []
    what = (
        "Check that this rim is the valve's" if valve.found_by == "open" else "Look where it is cut, and move its plane"
    )
    return [f"{anatomy.outer} is {valve.perimeter_mm:.0f} mm round; usual are {low:.0f} to {high:.0f} mm. {what}."]


def _extra_veins(
    planner: Planner,
    named: Mapping[str, Candidate],
    openings: Mapping[str, PlannedOpening],
    candidates: list[Candidate],
    what: str,
) -> list[PlannedOpening]:
    """Planes of protrusions that have an ostium of their own, none of the openings, and are on the cavity's side."""
    chosen = {id(c) for c in named.values()} | {id(c) for c in candidates if c.rim is not None}
    tips = {tuple(c.tip) for c in named.values()}
    extra = []
    # Lower ones are looked at only as branches of veins.
    low = [tip for tip in find_tips(planner.closed, planner.lumen) if candidates and tip.rise_mm < EXTRA_RISE_MM]
    for c in [*candidates, *map(planner.candidate, low)]:
        if id(c) in chosen or tuple(c.tip) in tips or not c.ostium.found:
            continue
        centre, normal, kept = c.ostium.plane_at(0.0)
        # On the surface as it will be cut: its open rims stay open.
        section = plane_section(planner.surface, centre, normal)
        if section is None or not section.around or section.perimeter < SMALLEST_EXTRA_MM:
            continue
        if section.diameter > WIDEST_VEIN_MM:
            continue
        beyond = [
            hole
            for hole, opening in openings.items()
            if opening.found_by != "open"
            and (c.tip - opening.plane.centre) @ opening.plane.normal > 0.0
            and _cut_off(planner, opening, c.ostium)
        ]
        near = [h for h in beyond if np.linalg.norm(centre - openings[h].plane.centre) < NEAR_OSTIUM_MM]
        if near and near[0] in planner.anatomy.holes:
            planner.notes.append(
                f"A branch of {near[0]}, {section.perimeter:.0f} mm round, leaves it near its ostium, as an extra vein "
                "does; it was cut off with it, so that they have one ostium on the map."
            )
        if beyond or c.rise_mm < EXTRA_RISE_MM:
            continue
        nearest = min(named, key=lambda hole: float(np.linalg.norm(openings[hole].plane.centre - centre)), default="")
        place = f" near {nearest}" if nearest else ""
        if what == "keep":
            planner.notes.append(f"An extra vein{place}, {c.rise_mm:.0f} mm long, stays on the surface as a bulge.")
            continue
        planner.notes.append(
            f"An extra vein{place}, {section.perimeter:.0f} mm round, was cut off and covered; its surroundings are "
            "not as on other maps."
        )
        extra.append(PlannedOpening(CutPlane(section.centre, normal), "ostium", section.perimeter, kept, c.tip))
    return extra


def _cut_off(planner: Planner, opening: PlannedOpening, ostium: Ostium) -> bool:
    """Whether the way from a tip into the body passes through an opening: the tip is on a branch beyond it."""
    section = plane_section(planner.closed, opening.plane.centre, opening.plane.normal)
    return section is not None and section.encloses(ostium.line.points)


__all__ = ["KEEP_MM", "CutPlan", "PlannedOpening", "loop_plane", "plan_cuts"]
