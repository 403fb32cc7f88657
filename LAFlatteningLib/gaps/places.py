"""Where a gap is: its place, and in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from ..map_data import MapData
from ..parcellation import NO_PART, Parcellation
from ..surface import FloatArray, IntArray
from .search_areas import SearchArea

ALL_ROUND = "all round"
"""Where a gap is that has no ends."""
WIDE_MM = 3.0
"""Gaps from this length on are counted apart: shorter ones are hardly reported, and below the voxels of an image."""
STRETCHES = 20
"""What holds less than one of so many equal pieces of a gap may go unsaid."""


@dataclass(frozen=True, eq=False)
class FoundGap:
    """Healthy tissue on the path round a vein.

    Attributes
    ----------
    length_mm : along the atrium.
    place_mm, place_on_map : its middle, (3,) on the atrium and (2,) on the map.
    angle_degrees : its direction from the vein (of a pair: from the middle between them) on the map, counter-clockwise
        from +x, 0 to 360.
    segment : the part of the segment model that its middle is in, or is nearest to; `ALL_ROUND` of a path without scar.
    segments : the parts that it goes through, in order.
    points_mm, points_on_map : the gap as a line, (k, 3) and (k, 2).
    """

    length_mm: float
    place_mm: FloatArray
    place_on_map: FloatArray
    angle_degrees: float
    segment: str
    segments: tuple[str, ...]
    points_mm: FloatArray
    points_on_map: FloatArray

    @property
    def where(self) -> str:
        """In words: the part that it is in, or, of one through more than two parts, from where to where."""
        return self.segment if self.segment == ALL_ROUND else extent_words(self.segment, self.segments)

    def to_dict(self) -> dict[str, Any]:
        """As written to the gap file, without the lines."""
        return {
            "length_mm": round(self.length_mm, 3),
            "place_mm": rounded(self.place_mm),
            "place_on_map": rounded(self.place_on_map, 5),
            "angle_degrees": round(self.angle_degrees, 1),
            "segment": self.segment,
            "segments": list(self.segments),
        }


def describe(
    data: MapData, piece: tuple[FloatArray, FloatArray], area: SearchArea, model: Parcellation, segment_of: IntArray
) -> FoundGap:
    """A gap with its place.

    Parameters
    ----------
    piece : its line, (k, 3) on the atrium and (k, 2) on the map; the last place is the first where there is no scar.
    area : that it was looked for in.
    model, segment_of : the parts that name places, and the one of each point of the map.
    """
    points, flat = piece
    whole = bool((points[0] == points[-1]).all())
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    middle = 0.5 * along[-1]
    place = np.array([np.interp(middle, along, points[:, k]) for k in range(3)])
    on_map = np.array([np.interp(middle, along, flat[:, k]) for k in range(2)])
    shares = along[-1] * (np.arange(STRETCHES) + 0.5) / STRETCHES
    stretches = np.stack([np.interp(shares, along, flat[:, k]) for k in range(2)], axis=1)
    label, *through = _labels(data, np.concatenate([on_map[None], stretches]), model, segment_of)
    names = [model.names.get(one, "") for one, _ in groupby(through)]
    return FoundGap(
        float(along[-1]),
        place,
        on_map,
        float(area.centre.angles(on_map[None])[0]),
        ALL_ROUND if whole else model.names.get(label, ""),
        tuple(names),
        points,
        flat,
    )


def _labels(data: MapData, places: FloatArray, model: Parcellation, segment_of: IntArray) -> list[int]:
    """The part that each place (k, 2) on the map is in, or is nearest to."""
    labels = model.labels_at(places, data.template)
    some = np.flatnonzero(segment_of != NO_PART)
    if len(some):
        for k in np.flatnonzero(labels == NO_PART):
            labels[k] = segment_of[some[np.linalg.norm(data.flat[some] - places[k], axis=1).argmin()]]
    found: list[int] = labels.tolist()
    return found


def extent_words(middle: str, through: Sequence[str]) -> str:
    """Where a gap is, by the part of its middle and the parts that it goes through.

    Examples
    --------
    >>> extent_words("left roof", ["left front", "left roof"])
    'left roof'
    >>> extent_words("left roof", ["left front", "left roof", "left back"])
    'left front to back, over left roof'
    """
    if len(through) <= 2:
        return middle
    first, last = through[0], through[-1]
    side, _, rest = last.partition(" ")
    words = f"{first} to {rest if rest and first.startswith(side + ' ') else last}"
    return words if middle in (first, last) else f"{words}, over {middle}"


def rounded(values: FloatArray, digits: int = 3) -> list[Any]:
    """Coordinates as they are written to files."""
    found: list[Any] = np.round(values, digits).tolist()
    return found
