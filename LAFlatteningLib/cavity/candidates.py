"""What may be a vein or the appendage: open rims and tips of tubes, and which of them is which."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree

from ..anatomy import Anatomy
from ..errors import SeedError, SurfaceError
from ..surface import FloatArray, IntArray, Surface
from .lumen import Lumen
from .ostia import STEP_MM, Ostium, find_ostium
from .recognition import Recognition, VeinsMissingError, recognise
from .tips import Tip, find_tips

FAINT_RISE_MM = 1.0
"""Tips that rise this little are looked at only where veins are missing: the branches of a common trunk."""
SMALLEST_VALVE_MM = 60.0
"""A rim is that of the mitral valve only if it is longer than this (95 to 145 mm in adults) ..."""
VALVE_RATIO = 1.2
"""... and longer than any other by this factor."""
TIP_TO_SURFACE_MM = 10.0
"""A tip given by the user may be so far from the surface."""
EXTRA_RISE_MM = 4.0
"""A further protrusion that stands out by this, with an ostium, is an extra vein."""
OWN_OPENING_MM = 2.0
"""Tips nearer than this to an open rim's cover are that opening."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """What may be one of the holes: a tip or an open rim."""

    tip: FloatArray
    rise_mm: float
    ostium: Ostium
    rim: int | None = None


@dataclass(eq=False)
class Planner:
    """An atrium that is planned, and what was noticed on the way.

    Attributes
    ----------
    surface : as it is.
    keep_mm : hole -> length that stays beyond its ostium, mm.
    space : patient axes; None where they are not known.
    closed, lumen : the surface with its rims covered, and the room inside.
    loops : its rims.
    notes : what to look at, in words.
    """

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

    def valve_rim(self) -> int | None:
        """Number of the rim that is the mitral valve's; None if that is closed."""
        lengths = sorted(((self.surface.loop_length(loop), k) for k, loop in enumerate(self.loops)), reverse=True)
        if not lengths or lengths[0][0] < SMALLEST_VALVE_MM:
            return None
        if len(lengths) > 1 and lengths[0][0] < VALVE_RATIO * lengths[1][0]:
            return None
        return lengths[0][1]

    def candidates(self, smallest_rise_mm: float, valve: int | None) -> list[Candidate]:
        """Open rims other than the valve's, and tips that are not at a rim."""
        middles = [self.surface.points[loop].mean(axis=0) for loop in self.loops]
        found = [
            Candidate(middle, np.inf, find_ostium(self.closed, self.lumen, middle), k)
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

    def candidate(self, tip: Tip) -> Candidate:
        """A tip with the ostium of its tube."""
        return Candidate(tip.position, tip.rise_mm, find_ostium(self.closed, self.lumen, tip.position))

    def recognise(self, candidates: list[Candidate]) -> Recognition:
        """Which of the candidates is which; errors as for `recognition.recognise`."""
        # An open rim is at its ostium or near it; the centreline of so short a tube says less.
        places = np.array(
            [c.ostium.line.at(c.ostium.at_mm)[0] if c.rim is None else c.tip for c in candidates]
        ).reshape(-1, 3)
        places = places - self.lumen.centre
        directions = places / np.maximum(np.linalg.norm(places, axis=1, keepdims=True), 1e-9)
        perimeters = [np.nan if c.rim is None else self.surface.loop_length(self.loops[c.rim]) for c in candidates]
        return recognise(directions, [c.rise_mm for c in candidates], self.anatomy, self.space, perimeters)


def candidates_from_tips(planner: Planner, tips: Mapping[str, FloatArray], valve: int | None) -> dict[str, Candidate]:
    """Candidates at the tips that the user marked, by their names.

    Raises
    ------
    SeedError : a tip far from the surface, two on one vein.
    """
    middles = {k: planner.surface.points[loop].mean(axis=0) for k, loop in enumerate(planner.loops) if k != valve}
    tree = cKDTree(planner.closed.points)
    tubes = planner.candidates(FAINT_RISE_MM, valve)
    named: dict[str, Candidate] = {}
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
        named[hole] = Candidate(tip, np.inf, find_ostium(planner.closed, planner.lumen, tip), rim)
    return named


def _end_of_tube(planner: Planner, tubes: Sequence[Candidate], marked: FloatArray, nearest: FloatArray) -> FloatArray:
    """The end of the tube that a place is on, so that it does not matter where on its end the user marked it."""
    ends = []
    for tube in tubes:
        line = tube.ostium.line.points[: round(tube.ostium.at_mm / STEP_MM) + 1]
        outside = np.linalg.norm(line - marked, axis=1) - planner.lumen.depth_at(line)
        if tube.rim is None and tube.ostium.found and outside.min() <= OWN_OPENING_MM:
            ends.append(tube.tip)
    return min(ends, key=lambda end: float(np.linalg.norm(end - marked)), default=nearest)


def candidates_by_rule(
    planner: Planner, valve: int | None
) -> tuple[dict[str, Candidate], Recognition, list[Candidate]]:
    """Candidates found and named by rule; where a vein is missing, branches of a common trunk are tried.

    Returns
    -------
    Hole -> candidate; how sure the names are; all candidates.

    Raises
    ------
    SurfaceError : veins missing, mirrored or turned.
    """
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
                f"{hole} stands out by only {candidates[recognition.index[hole]].rise_mm:.1f} mm; check that it is "
                f"{'the appendage' if hole in planner.anatomy.appendages else 'a vein'}."
            )
        if faint:
            planner.faint = tuple(faint)
            recognition = replace(recognition, confidence="low")
    return {hole: candidates[k] for hole, k in recognition.index.items()}, recognition, candidates
