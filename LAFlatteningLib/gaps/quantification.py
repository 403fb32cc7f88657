"""Gaps in ablation lines round the veins: how much healthy tissue is on the best closed path (Nunez-Garcia et al.,
"Mind the gap: quantification of incomplete ablation patterns after pulmonary vein isolation using minimum path search",
2018)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._version import __version__
from ..errors import LAFlatteningError, SurfaceError
from ..flattening import FlatMap
from ..map_data import MapData
from ..parcellation import Parcellation
from ..progress import ProgressCallback, report
from ..quantities import diseased_side, readable, unit_of
from ..surface import FloatArray, IntArray
from .level import cut_at_level
from .places import WIDE_MM, FoundGap, describe, rounded
from .ring_search import Ring, best_ring
from .search_areas import SEARCH_MM, Search, SearchArea, by_distance, describe_search, search_areas

BoolArray = NDArray[np.bool_]

TOUCH_MM = 0.02
"""Healthy tissue or scar on a path for less than this is a corner that the path touches, not a gap and not scar."""


BORDER_MM = 1.0
"""Gaps that run along the border of the search area for more than this are noted."""


@dataclass(frozen=True, eq=False)
class Encirclement:
    """The closed path round a vein, or a pair, with the least length outside scar; of several such, the shortest.

    Attributes
    ----------
    area, openings : the search area, and the openings that it goes round.
    threshold : beyond which the array is scar.
    gap_length_mm, scar_length_mm : length of the path outside and within scar.
    gaps : the healthy pieces, of the least length asked for or more, longest first.
    small_gaps : how many shorter ones there are; their length counts in `gap_length_mm`.
    wide_gaps : how many have `WIDE_MM` or more.
    points_mm, points_on_map : the path, (k, 3) and (k, 2), counter-clockwise on the map; the first is not repeated.
    in_scar : (k,) whether the way from each place to the next is within scar.
    unknown_share : share of the search area's area where the array has no value (counted as healthy).
    gap_on_border_mm : length of the path that is outside scar and on the border of the search area.
    border_on_map : (b, 2, 2) the border of the search area, as segments.
    """

    area: str
    openings: tuple[str, ...]
    threshold: float
    gap_length_mm: float
    scar_length_mm: float
    gaps: tuple[FoundGap, ...]
    small_gaps: int
    wide_gaps: int
    points_mm: FloatArray
    points_on_map: FloatArray
    in_scar: BoolArray
    unknown_share: float
    gap_on_border_mm: float
    border_on_map: FloatArray

    @property
    def rgm(self) -> float:
        """Relative gap measure: share of the path outside scar, 0 (a complete ring) to 1 (no scar on it)."""
        return self.gap_length_mm / (self.gap_length_mm + self.scar_length_mm)

    @property
    def complete(self) -> bool:
        """Whether scar surrounds the opening without a gap."""
        return self.gap_length_mm == 0.0

    def to_dict(self) -> dict[str, Any]:
        """As written to the gap file."""
        return {
            "openings": list(self.openings),
            "threshold": self.threshold,
            "gap_length_mm": round(self.gap_length_mm, 3),
            "scar_length_mm": round(self.scar_length_mm, 3),
            "rgm": round(self.rgm, 5),
            "complete": self.complete,
            "gap_count": len(self.gaps),
            "small_gaps": self.small_gaps,
            "wide_gaps": self.wide_gaps,
            "gaps": [gap.to_dict() for gap in self.gaps],
            "unknown_share": round(self.unknown_share, 5),
            "gap_on_border_mm": round(self.gap_on_border_mm, 3),
            "path_mm": rounded(self.points_mm),
            "path_on_map": rounded(self.points_on_map, 5),
            "path_in_scar": [int(scar) for scar in self.in_scar],
        }


@dataclass(frozen=True, eq=False)
class GapReport:
    """The gaps round all veins.

    Attributes
    ----------
    array, space : the array that scar was read from; patient axes of positions, or "unknown".
    direction : "above": scar is where the array reaches a threshold; "below": where it is less, as for voltage.
    thresholds : increasing.
    search, segments : names of the parcellations: search areas, and segments by which places are named.
    minimum_mm : least length of a gap in the lists.
    rings : search area -> path for each threshold, in the order of `thresholds`.
    left_out : search areas in which no closed path was found.
    notes : what to know before trusting the figures.
    """

    array: str
    space: str
    direction: str
    thresholds: tuple[float, ...]
    search: str
    segments: str
    minimum_mm: float
    rings: Mapping[str, tuple[Encirclement, ...]]
    left_out: tuple[str, ...]
    notes: tuple[str, ...]

    def scar_words(self, threshold: float) -> str:
        """What is scar, as in "LGE of 120 or more" or "Bipolar below 0.5 mV"."""
        return scar_words(self.array, self.direction, threshold)

    def at(self, threshold: float) -> dict[str, Encirclement]:
        """Search area -> path, for one of the thresholds."""
        index = self.thresholds.index(threshold)
        return {area: rings[index] for area, rings in self.rings.items()}

    def to_dict(self) -> dict[str, Any]:
        """As written to the gap file (see Docs/formats.md)."""
        return {
            "version": __version__,
            "array": self.array,
            "space": self.space,
            "direction": self.direction,
            "search": self.search,
            "segments": self.segments,
            "thresholds": list(self.thresholds),
            "minimum_mm": self.minimum_mm,
            "left_out": list(self.left_out),
            "notes": list(self.notes),
            "results": [
                {"threshold": threshold, "areas": {area: ring.to_dict() for area, ring in self.at(threshold).items()}}
                for threshold in self.thresholds
            ],
            "rgm_over_threshold": {area: [round(ring.rgm, 5) for ring in rings] for area, rings in self.rings.items()},
        }


def find_gaps(
    flat_map: FlatMap | MapData,
    array: str,
    thresholds: Sequence[float],
    *,
    search: Search = SEARCH_MM,
    segments: Parcellation | str | Path = "vein_segments",
    minimum_mm: float = 0.0,
    direction: str | None = None,
    progress: ProgressCallback | None = None,
) -> GapReport:
    """Measure the gaps round each vein and each pair of veins.

    Parameters
    ----------
    flat_map : a map, or `MapData` of a map file.
    array : a scalar point or cell array: intensity, or scar as 0 and 1 (threshold 0.5).
    thresholds : one or more, increasing.
    direction : "above": scar is where the array, linear in each triangle, reaches the threshold. "below": where it is
        less. Default: below for voltages, above for everything else.
    search : where the path round each vein, and round the veins of each side together, is looked for. A number: within
        so many mm of the rims, and nearer to them than to any other hole. Or a parcellation (name, file or object) of
        which each part goes round one opening or several, such as the published "vein_surroundings"; or area -> point
        array that marks it with 1.
    segments : parcellation whose parts name the places of gaps.
    minimum_mm : gaps shorter than this are counted but not listed (in clinical use 3 mm).

    Returns
    -------
    GapReport. Where the array has no value (NaN) tissue counts as healthy, which a note says.

    Raises
    ------
    LAFlatteningError : no such array or no number in it; thresholds missing, not finite or out of order.
    SurfaceError : a search area that was drawn does not go round an opening, or another opening interrupts it; or
        this is so of all areas within the distance. (Where it is so of some, they are left out, which a note says.)
    TemplateError : a parcellation that does not belong on the map's template.

    Examples
    --------
    >>> from LAFlatteningLib import flatten, make_phantom
    >>> phantom = make_phantom(3000)
    >>> found = find_gaps(flatten(phantom.surface, phantom.seeds), "scar", [0.5])
    >>> sum(ring.complete for ring in found.at(0.5).values())
    1
    """
    data = MapData.of(flat_map)
    levels = _check_thresholds(thresholds)
    if not (np.isfinite(minimum_mm) and minimum_mm >= 0.0):
        raise LAFlatteningError(f"Expected a least length of gaps of 0 mm or more, found {minimum_mm:g}.")
    direction = direction or diseased_side(array)
    if direction not in ("above", "below"):
        raise LAFlatteningError(f'Expected scar "above" or "below" thresholds, found "{direction}".')
    values = data.point_values(array)
    known = np.isfinite(values)
    if not known.any():
        raise LAFlatteningError(f'The array "{array}" holds no number at all (every value is NaN). Choose another one.')
    notes = []
    if not known.all():
        notes.append(
            f'{np.count_nonzero(~known)} of {len(known)} points have no value in "{array}"; they count as healthy.'
        )
    for level in levels:
        if level > values[known].max() or level <= values[known].min():
            everything = (level > values[known].max()) == (direction == "below")
            notes.append(
                f"The threshold {level:g} is outside the values of {array} ({values[known].min():g} to "
                f"{values[known].max():g}): {'everything' if everything else 'nothing'} is scar."
            )
    areas, left_out, widened = search_areas(data, search)
    notes += widened
    model = segments if isinstance(segments, Parcellation) else Parcellation.load(segments)
    segment_of = model.labels_at(data.flat, data.template)
    rings: dict[str, tuple[Encirclement, ...]] = {}
    for index, area in enumerate(areas):
        found: list[Encirclement] = []
        for k, level in enumerate(levels):
            share = (index + k / len(levels)) / len(areas)
            report(progress, share, f"Looking for gaps: {area.name} at {level:g}")
            ring = _encircle(data, values, level, direction, area, model, segment_of, minimum_mm)
            if ring is None:
                break
            found.append(ring)
        if not found:
            if not by_distance(search):
                raise SurfaceError(
                    f"The search area {area.name} does not go all the way round {' and '.join(area.openings)}. Draw it "
                    "larger, or keep it off the rim of the map and of other openings."
                )
            left_out.append(area.name)
            continue
        rings[area.name] = tuple(found)
        if found[0].unknown_share > 0.0:
            notes.append(f"{100 * found[0].unknown_share:.1f} % of the search area {area.name} has no value.")
        bordering = {ring.threshold: ring.gap_on_border_mm for ring in found if ring.gap_on_border_mm > BORDER_MM}
        if bordering:
            notes.append(
                f"{area.name} at {', '.join(f'{level:g}' for level in bordering)}: up to "
                f"{max(bordering.values()):.1f} mm of its gaps lie on the border of the search "
                "area; scar beyond it is not seen. Look at the map, and at the veins together."
            )
    if left_out:
        words = (
            f"no closed way round {', '.join(left_out)} was found {describe_search(search)} that keeps clear of other "
            "openings. Search nearer to the rims where another opening is close, and farther where veins lie far apart."
        )
        if not rings:
            raise SurfaceError(f"Gaps cannot be measured: {words}")
        notes.append(f"Left out: {words}")
    return GapReport(
        array,
        data.surface.axes_name,
        direction,
        levels,
        describe_search(search),
        model.name,
        float(minimum_mm),
        rings,
        tuple(left_out),
        tuple(notes),
    )


def scar_words(array: str, direction: str, threshold: float) -> str:
    """What is scar, as in "LGE of 120 or more" or "Bipolar below 0.5 mV"."""
    number = " ".join(word for word in (readable(threshold), unit_of(array)) if word)
    return f"{array} of {number} or more" if direction == "above" else f"{array} below {number}"


# ---- one vein at one threshold ---------------------------------------------------------------------------------------


def _encircle(
    data: MapData,
    values: FloatArray,
    level: float,
    direction: str,
    area: SearchArea,
    model: Parcellation,
    segment_of: IntArray,
    minimum_mm: float,
) -> Encirclement | None:
    """The best path; None where the area does not go all the way round."""
    triangles = data.triangles[area.triangles]
    ids, corners = np.unique(triangles, return_inverse=True)
    local = corners.reshape(-1, 3)
    # To reach a threshold is to be it or more; to be below it is to be less.
    signed, cut = (values, level) if direction == "above" else (-values, float(np.nextafter(-level, np.inf)))
    mesh = cut_at_level(data.surface.points[ids], data.flat[ids], local, signed[ids], cut)
    ring = best_ring(mesh, area.centre)
    if ring is None:
        return None
    ring = _without_touches(ring)
    lengths = ring.lengths
    gaps = [describe(data, piece, area, model, segment_of) for piece in _gap_pieces(ring)]
    gaps.sort(key=lambda gap: -gap.length_mm)
    listed = tuple(gap for gap in gaps if gap.length_mm >= minimum_mm)
    sizes = data.surface.triangle_areas[area.triangles]
    unknown = ~np.isfinite(values[triangles]).all(axis=1)
    return Encirclement(
        area.name,
        area.openings,
        level,
        float(lengths[~ring.in_scar].sum()),
        float(lengths[ring.in_scar].sum()),
        listed,
        len(gaps) - len(listed),
        sum(gap.length_mm >= WIDE_MM for gap in gaps),
        ring.points,
        ring.flat,
        ring.in_scar,
        float(sizes[unknown].sum() / sizes.sum()),
        float(lengths[~ring.in_scar & _on_border(data, ring, area)].sum()),
        data.flat[area.border],
    )


def _on_border(data: MapData, ring: Ring, area: SearchArea) -> BoolArray:
    """(k,) whether each way of a curve runs along the border of its search area."""
    if not len(area.border):
        return np.zeros(len(ring.flat), bool)
    middle = 0.5 * (ring.flat + np.roll(ring.flat, -1, axis=0))
    start, stop = data.flat[area.border[:, 0]], data.flat[area.border[:, 1]]
    along = stop - start
    t = np.einsum("kbi,bi->kb", middle[:, None] - start, along) / np.einsum("bi,bi->b", along, along)
    nearest = start + np.clip(t, 0.0, 1.0)[..., None] * along
    return np.linalg.norm(middle[:, None] - nearest, axis=2).min(axis=1) < 1e-6 * data.template.radius


def _without_touches(ring: Ring) -> Ring:
    """The same curve where pieces shorter than `TOUCH_MM` count as what is on both sides of them."""
    in_scar = ring.in_scar.copy()
    for scar in (True, False):
        if (in_scar == scar).all():
            continue
        for piece in _runs(in_scar == scar):
            if ring.lengths[piece].sum() < TOUCH_MM:
                in_scar[piece] = not scar
    return Ring(ring.points, ring.flat, in_scar)


def _runs(chosen: BoolArray) -> list[IntArray]:
    """Runs of consecutive chosen entries of a closed row, each as its indices in order."""
    if chosen.all():
        return [np.arange(len(chosen))]
    first = int(np.flatnonzero(~chosen)[0])
    order = np.roll(np.arange(len(chosen)), -first)
    change = np.flatnonzero(np.diff(chosen[order].astype(np.int8)))
    return [piece for piece in np.split(order, change + 1) if chosen[piece[0]]]


def _gap_pieces(ring: Ring) -> list[tuple[FloatArray, FloatArray]]:
    """The healthy pieces of a curve, each with both ends, on the atrium and on the map."""
    pieces = []
    for run in _runs(~ring.in_scar):
        ids = np.append(run, (run[-1] + 1) % len(ring.points))
        if len(run):
            pieces.append((ring.points[ids], ring.flat[ids]))
    return pieces


def _check_thresholds(thresholds: Sequence[float]) -> tuple[float, ...]:
    levels = tuple(float(level) for level in np.atleast_1d(np.asarray(thresholds, np.float64)))
    if not levels:
        raise LAFlatteningError("No threshold is given. Expected one or more values from which tissue counts as scar.")
    if not np.isfinite(levels).all():
        raise LAFlatteningError(f"Expected thresholds that are numbers, found {', '.join(f'{x:g}' for x in levels)}.")
    if any(b <= a for a, b in pairwise(levels)):
        raise LAFlatteningError(
            "Thresholds out of order: expected increasing values, each once, found "
            f"{', '.join(f'{x:g}' for x in levels)}."
        )
    return levels
