"""Which openings an atrium has or gets: the plan of the cuts, made by rule and open to correction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree

from ..anatomy import Anatomy
from ..errors import SeedError, SurfaceError
from ..progress import ProgressCallback, report
from ..seeds import check_directions
from ..surface import FloatArray, IntArray, Surface
from .clipping import CutPlane, clip
from .lumen import Lumen
from .mitral import mitral_plane
from .openings import describe_loops
from .ostia import STEP_MM, WIDEST_VEIN_MM, Ostium, find_ostium
from .recognition import Recognition, VeinsMissingError, recognise
from .sections import Section, plane_section
from .tips import Tip, find_tips

KEEP_MM = 3.0
"""Length of vein or appendage that stays beyond its ostium."""
FAINT_RISE_MM = 1.0
"""Tips that rise this little are looked at only where veins are missing: the branches of a common trunk."""
SMALLEST_VALVE_MM = 60.0
"""A rim is that of the mitral valve only if it is longer than this (95 to 145 mm in adults) ..."""
VALVE_RATIO = 1.2
"""... and longer than any other by this factor."""
LONG_STUMP_MM = 8.0
"""An open vein is cut again only where more than this would be cut off: one that was cut before stays as it is."""
TUBE_SPREAD = 1.5
"""... and only if it is a tube that far: not wider in one place than in another by more than this."""
SMALLEST_RIM_MM = 10.0
"""No vein is so narrow (3 mm) where it is cut: that would be its very tip."""
TIP_TO_SURFACE_MM = 10.0
"""A tip given by the user may be so far from the surface."""
EXTRA_RISE_MM = 4.0
"""A further protrusion that stands out by this, with an ostium, is an extra vein."""
SMALLEST_EXTRA_MM = 15.0
"""... if it is so long round (5 mm wide); less is a twig or noise, and hardly disturbs a map."""
NEAR_OSTIUM_MM = 15.0
"""A branch that leaves its vein within this of the cut may be an extra vein with a common ostium."""
MIRRORED_RATIO = 1.4
"""The atrium is taken for mirrored where a vein in the appendage's mirror place is wider than it by this factor (.4 to
.85 in nine atria, 1.15 in one)."""
OWN_OPENING_MM = 2.0
"""Tips nearer than this to an open rim's cover are that opening."""


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


@dataclass(frozen=True, eq=False)
class _Candidate:
    """What may be one of the holes: a tip or an open rim."""

    tip: FloatArray
    rise_mm: float
    ostium: Ostium
    rim: int | None = None


@dataclass(eq=False)
class _Planner:
    surface: Surface
    anatomy: Anatomy
    keep_mm: Mapping[str, float]
    space: str | None
    closed: Surface = field(init=False)
    lumen: Lumen = field(init=False)
    loops: list[IntArray] = field(init=False)
    notes: list[str] = field(default_factory=list)
    faint: tuple[str, ...] = ()
    """Holes whose tips hardly stand out."""

    def __post_init__(self) -> None:
        self.loops = self.surface.boundary_loops
        self.closed = Surface(*self.surface.capped, space=self.surface.space)
        self.lumen = Lumen(self.closed)

    # ---- candidates ----------------------------------------------------------------------------------------------

    def valve_rim(self) -> int | None:
        """Number of the rim that is the mitral valve's; None if that is closed."""
        lengths = sorted(((self.surface.loop_length(loop), k) for k, loop in enumerate(self.loops)), reverse=True)
        if not lengths or lengths[0][0] < SMALLEST_VALVE_MM:
            return None
        if len(lengths) > 1 and lengths[0][0] < VALVE_RATIO * lengths[1][0]:
            return None
        return lengths[0][1]

    def candidates(self, smallest_rise_mm: float, valve: int | None) -> list[_Candidate]:
        """Open rims other than the valve's, and tips that are not at a rim."""
        middles = [self.surface.points[loop].mean(axis=0) for loop in self.loops]
        found = [
            _Candidate(middle, np.inf, find_ostium(self.closed, self.lumen, middle), k)
            for k, middle in enumerate(middles)
            if k != valve
        ]
        own = (
            cKDTree(np.concatenate([*(self.surface.points[loop] for loop in self.loops), middles])) if middles else None
        )
        for tip in find_tips(self.closed, self.lumen, smallest_rise_mm):
            if own is None or own.query(tip.position)[0] > OWN_OPENING_MM:
                found.append(self.candidate(tip))
        return found

    def candidate(self, tip: Tip) -> _Candidate:
        return _Candidate(tip.position, tip.rise_mm, find_ostium(self.closed, self.lumen, tip.position))

    def recognise(self, candidates: list[_Candidate]) -> Recognition:
        # An open rim is at its ostium or near it; the centreline of so short a tube says less.
        places = np.array(
            [c.ostium.line.at(c.ostium.at_mm)[0] if c.rim is None else c.tip for c in candidates]
        ).reshape(-1, 3)
        places = places - self.lumen.centre
        directions = places / np.maximum(np.linalg.norm(places, axis=1, keepdims=True), 1e-9)
        perimeters = [np.nan if c.rim is None else self.surface.loop_length(self.loops[c.rim]) for c in candidates]
        return recognise(directions, [c.rise_mm for c in candidates], self.anatomy, self.space, perimeters)

    # ---- planes --------------------------------------------------------------------------------------------------

    def opening(self, hole: str, candidate: _Candidate) -> PlannedOpening:
        """Where a tube is cut, or that it is open already."""
        ostium = candidate.ostium
        centre, normal, kept = ostium.plane_at(self.keep_mm[hole])
        if candidate.rim is not None and not self._is_long_stump(ostium, ostium.at_mm - kept):
            loop = self.surface.points[self.loops[candidate.rim]]
            return PlannedOpening(
                loop_plane(loop, candidate.tip - self.lumen.centre),
                "open",
                self.surface.loop_length(self.loops[candidate.rim]),
            )
        if candidate.rim is not None:
            self.notes.append(
                f"{hole} was open {ostium.at_mm:.0f} mm beyond its ostium; it was cut back to {kept:.1f} mm."
            )
        elif not ostium.found:
            self.notes.append(f"{hole} widens from its tip, so that its ostium is uncertain; check its plane.")
        elif kept < self.keep_mm[hole] - STEP_MM:
            self.notes.append(
                f"{hole} is short: {kept:.1f} mm stay beyond its ostium, where {self.keep_mm[hole]:g} were asked for."
            )
        section = plane_section(self.closed, centre, normal)
        if section is None or not section.around or section.perimeter < SMALLEST_RIM_MM:
            place = ", ".join(f"{x:.0f}" for x in centre)
            raise SurfaceError(
                f"No plane was found that cuts {hole} off near ({place}) mm. Give its plane yourself (--planes), or "
                "mark its tip elsewhere (--tips)."
            )
        # The middle of a bent section may lie outside it; the centreline does not.
        middle = plane_section(self.closed, section.centre, normal)
        if middle is not None and middle.around and np.isclose(middle.perimeter, section.perimeter):
            centre = section.centre
        return PlannedOpening(CutPlane(centre, normal), "ostium", section.perimeter, kept, candidate.tip)

    def _is_long_stump(self, ostium: Ostium, beyond_mm: float) -> bool:
        """Whether an open tube goes on as a tube for so long that it is cut again."""
        stump = ostium.diameters[round(ostium.rounding_mm / STEP_MM) : round(beyond_mm / STEP_MM) + 1]
        stump = stump[np.isfinite(stump)]
        if not ostium.found or beyond_mm <= LONG_STUMP_MM or len(stump) == 0:
            return False
        return bool(stump.max() <= TUBE_SPREAD * stump.min())

    def _takes(self, section: Section, other: _Candidate) -> bool:
        """Whether a cut would take another vein with it, or a part of its tube."""
        line = other.ostium.line.points
        if section.encloses(line):
            # The way of another vein into the body passes here only if that vein is beyond.
            return True
        tube = line[: round(other.ostium.at_mm / STEP_MM) + 1]
        return section.cuts_into(tube, self.lumen.depth_at(tube))

    def parted(self, named: dict[str, _Candidate]) -> dict[str, _Candidate]:
        """The same, with ostia moved out where two veins have one in common, to where they part."""
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
                centre, normal, _ = replace(ostium, at_mm=at).plane_at(self.keep_mm[hole])
                section = plane_section(self.closed, centre, normal)
                if section is None or not section.around:
                    break
                inside = {other for other, c in others.items() if self._takes(section, c)}
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
                self.notes.append(
                    f"{hole} is one trunk with {' and '.join(sorted(shared))} at its ostium; it is cut where it leaves "
                    f"it, {ostium.at_mm - at:.0f} mm farther out. The map shows the trunk between them, not a carina."
                )
                result[hole] = replace(candidate, ostium=replace(ostium, at_mm=at))
        return result


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
    planner = _Planner(surface, anatomy, keep, None if ignore_axes else surface.space)
    valve = planner.valve_rim()
    report(progress, 0.2, "Finding veins")
    recognition = None
    candidates: list[_Candidate] = []
    if tips is not None:
        named = _from_tips(planner, tips, valve)
    elif all(hole in planes for hole in anatomy.holes):
        named = {}
    else:
        named, recognition, candidates = _by_rule(planner, valve)
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
    notes = [*(recognition.notes if recognition else ()), *planner.notes]
    return CutPlan(openings, extra, to_cover, recognition, notes)


def _openings(
    planner: _Planner,
    named: Mapping[str, _Candidate],
    planes: Mapping[str, CutPlane],
    valve: int | None,
    recognition: Recognition | None,
    ignore_axes: bool,
) -> tuple[dict[str, _Candidate], dict[str, PlannedOpening]]:
    """The candidates with their final ostia, and the openings that they become."""
    anatomy = planner.anatomy
    with_necks = {
        hole: replace(c, ostium=find_ostium(planner.closed, planner.lumen, c.tip, neck=True))
        if hole in anatomy.appendages and c.rim is None
        else c
        for hole, c in named.items()
    }
    final = planner.parted(with_necks)
    openings = {
        hole: _given(planner, planes[hole]) if hole in planes else planner.opening(hole, final[hole])
        for hole in anatomy.holes
    }
    if recognition is None and not ignore_axes:
        check_directions({hole: openings[hole].plane.centre for hole in anatomy.holes}, planner.surface.space, anatomy)
    openings[anatomy.outer] = _valve(planner, openings, planes, valve, _usual_valve(planner, recognition))
    return final, openings


def loop_plane(loop: FloatArray, outwards: FloatArray) -> CutPlane:
    """The mean plane of a closed curve (k, 3), its normal on the side of `outwards` (3,)."""
    centre = loop.mean(axis=0)
    normal = np.cross(loop - centre, np.roll(loop, -1, axis=0) - centre).sum(axis=0)
    return CutPlane(centre, normal if normal @ outwards >= 0 else -normal)


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


def _from_tips(planner: _Planner, tips: Mapping[str, FloatArray], valve: int | None) -> dict[str, _Candidate]:
    """Candidates at the tips that the user marked."""
    middles = {k: planner.surface.points[loop].mean(axis=0) for k, loop in enumerate(planner.loops) if k != valve}
    tree = cKDTree(planner.closed.points)
    tubes = planner.candidates(FAINT_RISE_MM, valve)
    named: dict[str, _Candidate] = {}
    for hole in planner.anatomy.holes:
        if hole not in tips:
            continue
        position = np.asarray(tips[hole], np.float64)
        away, point = tree.query(position)
        if away > TIP_TO_SURFACE_MM:
            raise SeedError(
                f"The tip of {hole} is {away:.0f} mm from the surface; expected it on the end of the vein, at most "
                f"{TIP_TO_SURFACE_MM:g} mm off. Check that tips and surface have the same axes and units.",
                (hole,),
            )
        tip = _end_of_tube(planner, tubes, position, planner.closed.points[point])
        for other, c in named.items():
            if np.linalg.norm(c.tip - tip) < OWN_OPENING_MM:
                raise SeedError(
                    f"The tips of {other} and {hole} are on one vein; expected each at the end of its own.",
                    (other, hole),
                )
        rim = next(
            (
                k
                for k, middle in middles.items()
                if np.linalg.norm(middle - position)
                <= planner.surface.loop_length(planner.loops[k]) / (2.0 * np.pi) + OWN_OPENING_MM
            ),
            None,
        )
        if rim is not None:
            tip = middles[rim]
        named[hole] = _Candidate(tip, np.inf, find_ostium(planner.closed, planner.lumen, tip), rim)
    return named


def _end_of_tube(planner: _Planner, tubes: Sequence[_Candidate], marked: FloatArray, nearest: FloatArray) -> FloatArray:
    """The end of the tube that a place is on, so that it does not matter where on its end the user marked it."""
    ends = []
    for tube in tubes:
        line = tube.ostium.line.points[: round(tube.ostium.at_mm / STEP_MM) + 1]
        outside = np.linalg.norm(line - marked, axis=1) - planner.lumen.depth_at(line)
        if tube.rim is None and tube.ostium.found and outside.min() <= OWN_OPENING_MM:
            ends.append(tube.tip)
    return min(ends, key=lambda end: float(np.linalg.norm(end - marked)), default=nearest)


def _by_rule(planner: _Planner, valve: int | None) -> tuple[dict[str, _Candidate], Recognition, list[_Candidate]]:
    """Candidates found and named by rule; where a vein is missing, branches of a common trunk are tried."""
    candidates = planner.candidates(EXTRA_RISE_MM, valve)
    try:
        recognition = planner.recognise(candidates)
    except VeinsMissingError as error:
        fainter = planner.candidates(FAINT_RISE_MM, valve)
        try:
            recognition = planner.recognise(fainter)
        except SurfaceError:
            raise error from None
        candidates = fainter
        faint = [hole for hole, k in recognition.index.items() if candidates[k].rise_mm < EXTRA_RISE_MM]
        for hole in faint:
            planner.notes.append(
                f"{hole} stands out by only {candidates[recognition.index[hole]].rise_mm:.1f} mm; check that it is a "
                "vein."
            )
        if faint:
            planner.faint = tuple(faint)
            recognition = replace(recognition, confidence="low")
    return {hole: candidates[k] for hole, k in recognition.index.items()}, recognition, candidates


def _checked_for_mirroring(
    planner: _Planner, recognition: Recognition, openings: Mapping[str, PlannedOpening]
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


def _given(planner: _Planner, plane: CutPlane) -> PlannedOpening:
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


def _usual_valve(planner: _Planner, recognition: Recognition | None) -> FloatArray | None:
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
    planner: _Planner,
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


def _extra_veins(
    planner: _Planner,
    named: Mapping[str, _Candidate],
    openings: Mapping[str, PlannedOpening],
    candidates: list[_Candidate],
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


def _cut_off(planner: _Planner, opening: PlannedOpening, ostium: Ostium) -> bool:
    """Whether the way from a tip into the body passes through an opening: the tip is on a branch beyond it."""
    section = plane_section(planner.closed, opening.plane.centre, opening.plane.normal)
    return section is not None and section.encloses(ostium.line.points)
