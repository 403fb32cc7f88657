"""Ostia: where along its centreline a vein or the appendage opens into the body of the chamber."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ..surface import FloatArray, IntArray, Surface
from .lumen import Lumen
from .sections import plane_section

STEP_MM = 0.5
"""Distance of sections along a centreline."""
SMOOTHING_MM = 2.0
"""Standard deviation of the Gaussian that takes the steps of voxels out of a centreline."""
SLOPE = 1.2
"""A tube has become the funnel of an ostium where its diameter grows faster than this, mm a mm (a half angle of 31
degrees; published criterion) ..."""
RUN_MM = 3.0
"""... on average over this length."""
WIDEST_VEIN_MM = 25.0
"""No vein is wider before its ostium: what widens farther in belongs to the body."""
WIDEST_APPENDAGE_MM = 35.0
"""The same for the appendage."""
FLARE = 0.7
"""Two runs are of one funnel where the diameter grows by so much a mm between them (a half angle of 19 degrees); along
a vein between two bifurcations it grows less."""
NECK_GROWTH = 1.25
"""The appendage begins where it is this much wider than its neck."""
NECK_MM = 5.0
"""A neck is a stretch of this length ..."""
NECK_TAPER = 0.08
"""... that gets no narrower outwards than by this share."""


@dataclass(frozen=True, eq=False)
class Centreline:
    """The middle of a tube, from its tip into the body, at equal steps of `STEP_MM`.

    Attributes
    ----------
    points : (k, 3) mm, tip first.
    tangents : (k, 3) unit vectors towards the body.
    """

    points: FloatArray
    tangents: FloatArray

    def at(self, length_mm: float) -> tuple[FloatArray, FloatArray]:
        """Place and tangent at a distance from the tip, mm; the nearest end beyond the ends."""
        where = np.clip(length_mm / STEP_MM, 0.0, len(self.points) - 1.0)
        steps = np.arange(len(self.points))
        place = np.array([np.interp(where, steps, c) for c in self.points.T])
        tangent = np.array([np.interp(where, steps, c) for c in self.tangents.T])
        return place, tangent / np.linalg.norm(tangent)

    @property
    def length(self) -> float:
        """From tip to body, mm."""
        return STEP_MM * (len(self.points) - 1)


def centreline(lumen: Lumen, tip: FloatArray) -> Centreline:
    """The centreline from a tip (3,) mm to the body of the chamber."""
    way = lumen.way_from(tip)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
    at = np.arange(0.0, max(along[-1], 2.0 * STEP_MM) + 1e-9, STEP_MM)
    points = np.stack([np.interp(at, along, c) for c in way.T], axis=1)
    points = gaussian_filter1d(points, SMOOTHING_MM / STEP_MM, axis=0, mode="nearest")
    tangents = np.gradient(points, axis=0)
    length = np.linalg.norm(tangents, axis=1, keepdims=True)
    return Centreline(points, tangents / np.maximum(length, 1e-12))


@dataclass(frozen=True, eq=False)
class Ostium:
    """Where a tube opens into the body, and how wide it is on the way there.

    Attributes
    ----------
    line : its centreline.
    at_mm : place of the ostium along it, from the tip.
    rounding_mm : length of the rounded end of the tube, from the tip; no cut can be made there.
    diameters : (k,) largest diameter of the section at each point of the centreline, mm; NaN where there is none.
    found : whether there is an ostium at all; False for a bump that widens from its very tip.
    """

    line: Centreline
    at_mm: float
    rounding_mm: float
    diameters: FloatArray
    found: bool

    def plane_at(self, beyond_mm: float) -> tuple[FloatArray, FloatArray, float]:
        """Where to cut so that a length of tube stays beyond the ostium.

        Returns
        -------
        centre, normal : (3,) on the centreline, mm, and the unit normal out of the chamber.
        kept_mm : the length that stays: less than asked for where the tube is shorter.
        """
        at = max(self.at_mm - beyond_mm, min(self.rounding_mm, self.at_mm))
        centre, tangent = self.line.at(at)
        return centre, -tangent, self.at_mm - at


def find_ostium(surface: Surface, lumen: Lumen, tip: FloatArray, neck: bool = False) -> Ostium:
    """The ostium of the tube that ends at a tip.

    Sections at right angles to the centreline give its largest diameter D. Their envelope E, the smallest D from each
    place inwards, ignores side branches and bulges, since those end before the body does. A *run* is a stretch over
    which E grows by `SLOPE` a mm or more, averaged over `RUN_MM`; runs with no tube between them (`FLARE`) are one
    funnel. The ostium is the beginning of the last funnel that begins where a vein can still be (E up to
    `WIDEST_VEIN_MM`): an earlier one is a bifurcation.

    An appendage has lobes and grows wider less steadily; where it has a neck its ostium is the place inwards of that
    where it has become `NECK_GROWTH` times as wide.

    Parameters
    ----------
    surface : closed, mm.
    lumen : its inside.
    tip : (3,) mm, on the surface at the end of the tube.
    neck : look for a neck (appendage).

    Source: slope of the largest diameter as published by Nunez-Garcia et al. (there a growth of more than 5 once, or of
    more than 1.2 over 5 % of the sections, from the tip); envelope, funnels and neck are ours.
    """
    line = centreline(lumen, tip)
    diameters = _diameters(surface, line)
    known = np.flatnonzero(np.isfinite(diameters))
    if len(known) < 2:
        return Ostium(line, 0.0, 0.0, diameters, False)
    filled = np.interp(np.arange(len(diameters)), known, diameters[known])
    envelope = np.minimum.accumulate(filled[::-1])[::-1]
    begin = _rounding(lumen, line)
    widest = WIDEST_APPENDAGE_MM if neck else WIDEST_VEIN_MM
    starts = _starts(envelope, begin, widest)
    at = starts[-1] if starts else begin
    found = bool(starts)
    if neck:
        wider = _beyond_neck(filled, begin, at)
        if wider is not None:
            at, found = wider, True
    while at > begin and filled[at] > widest:
        at -= 1
    return Ostium(line, STEP_MM * at, STEP_MM * begin, diameters, found)


def _diameters(surface: Surface, line: Centreline) -> FloatArray:
    sections = [plane_section(surface, *place) for place in zip(line.points, line.tangents, strict=True)]
    return np.array([s.diameter if s is not None and s.around else np.nan for s in sections])


def _rounding(lumen: Lumen, line: Centreline) -> int:
    """First point of the centreline that is farther from the tip than from the wall: inwards of the round end."""
    along = STEP_MM * np.arange(len(line.points))
    inside = np.flatnonzero(along >= lumen.depth_at(line.points))
    return int(inside[0]) if len(inside) else 0


def _first_of(places: IntArray, envelope: FloatArray, join: bool) -> list[int]:
    """The first of each group of places from which the envelope grows over a window.

    Parameters
    ----------
    join : groups are of one where the envelope also grows by `FLARE` a mm from the end of one to the next.
    """
    window = round(RUN_MM / STEP_MM)
    firsts: list[int] = []
    last = -1
    for place in places.tolist():
        end = min(last + window, len(envelope) - 1)
        pause = STEP_MM * (place - end)
        joined = join and (pause <= 0.0 or envelope[place] - envelope[end] >= FLARE * pause)
        if last < 0 or (place - last > 1 and not joined):
            firsts.append(place)
        last = place
    return firsts


def _starts(envelope: FloatArray, begin: int, widest: float) -> list[int]:
    """Where the tube may end, from the tip: the beginnings of funnels; of runs in a tube that is all one funnel."""
    window = round(RUN_MM / STEP_MM)
    last = len(envelope) - 1
    ahead = envelope[np.minimum(np.arange(len(envelope)) + window, last)]
    grows = np.flatnonzero(ahead - envelope >= SLOPE * RUN_MM)
    grows = grows[grows >= begin]
    step = np.append(np.diff(envelope), 0.0) / STEP_MM
    for join in (True, False):
        # The average sees a jump from a run's length away: go on to where it happens.
        starts = [
            next(k for k in range(first, last + 1) if step[k] >= SLOPE or k >= first + window or k == last)
            for first in _first_of(grows, envelope, join)
            if first > begin
        ]
        starts = [start for start in starts if envelope[start] <= widest] or starts[:1]
        if starts:
            return starts
    return []


def _beyond_neck(diameter: FloatArray, begin: int, end: int) -> int | None:
    """Where a tube is `NECK_GROWTH` times as wide as at its neck, inwards of that; None without a neck before `end`."""
    length = round(NECK_MM / STEP_MM)
    necks = [
        place
        for place in range(begin + length, end + 1)
        if diameter[place - length : place + 1].min() >= (1.0 - NECK_TAPER) * diameter[place]
    ]
    if not necks:
        return None
    neck = necks[-1]
    wider = np.flatnonzero(diameter[neck:] >= NECK_GROWTH * diameter[neck])
    return None if len(wider) == 0 else neck + int(wider[0])
