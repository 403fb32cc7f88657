"""Three maps or more compared: each pair place by place, and the mean and the spread of all of them.

A group of patients, or one patient at several times. All maps hold one quantity, under one name; the first is the
reference.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._version import __version__
from .comparison import DISK, FEWEST_PLACES, Agreement, Comparison, compare_readings
from .errors import LAFlatteningError
from .flattening.flat_map import FlatMap
from .map_data import MapData
from .map_reading import GRID, check_templates, method_notes, places_of, read_map, regions_at
from .progress import ProgressCallback, report
from .quantities import diseased_side
from .surface import FloatArray, Surface
from .template import Template

FEWEST_MAPS = 3
"""Two are what `compare_maps` is for."""
MATRICES = ("pearson", "spearman", "dice", "difference", "difference_rms")
"""Numbers of the whole map that are given for each pair, as in `Agreement`."""


@dataclass(frozen=True)
class Spread:
    """The mean of the maps and their spread in one part of the map, weighted by area in 3D, NaN where undefined.

    Attributes
    ----------
    region : its number; 0 for the whole map.
    name : for people.
    places : with a value on every map.
    missing_percent : share of the part, by area, where one of the maps or more have no value: left out.
    mean : of the mean map.
    sd : root mean square of the standard deviation between the maps at each place (divided by the number of maps - 1).
    means : of each map, in the order of the maps, over the same places.
    """

    region: int
    name: str
    places: int
    missing_percent: float
    mean: float
    sd: float
    means: tuple[float, ...]

    def to_dict(self) -> dict[str, Any]:
        """For JSON; numbers that do not exist are None."""
        return {**{key: _known(value) for key, value in vars(self).items()}, "means": [_known(x) for x in self.means]}


@dataclass(frozen=True, eq=False)
class SeveralMaps:
    """What `compare_several` finds.

    Attributes
    ----------
    names : of the k maps; the first is the reference.
    array, unit : what was compared; the unit is empty where it is not known.
    threshold, direction : of the overlap, as for `compare_maps`.
    template, methods : of the maps.
    values : (k, GRID, GRID) of each map, NaN where it has none; row 0 at the bottom.
    covered : (GRID, GRID) where any of them has triangles.
    mean, sd : (GRID, GRID) of the maps at each place, NaN where one or more have no value.
    pairs : (index of A, index of B) -> how they compare, B - A; A before B.
    parts : the whole map, then its regions.
    notes : what the user should know.
    """

    names: tuple[str, ...]
    array: str
    unit: str
    threshold: float | None
    direction: str
    template: Template
    methods: tuple[str, ...]
    values: FloatArray
    covered: NDArray[np.bool_]
    mean: FloatArray
    sd: FloatArray
    pairs: dict[tuple[int, int], Comparison]
    parts: tuple[Spread, ...]
    notes: tuple[str, ...]

    def matrix(self, number: str) -> FloatArray:
        """A number of the whole map (one of `MATRICES`) for each pair, (k, k); row A, column B.

        On the diagonal is what a map has with itself: 1, or no difference. ``difference`` is B - A.
        """
        count = len(self.names)
        found = np.full((count, count), np.nan)
        np.fill_diagonal(found, 0.0 if number.startswith("difference") else 1.0)
        if number == "dice" and self.threshold is None:
            found[:] = np.nan
        for (a, b), pair in self.pairs.items():
            found[a, b] = getattr(pair.whole, number)
            found[b, a] = -found[a, b] if number == "difference" else found[a, b]
        return found

    def to_dict(self) -> dict[str, Any]:
        """For JSON (see Docs/formats.md)."""
        return {
            "version": __version__,
            "maps": list(self.names),
            "reference": self.names[0],
            "array": self.array,
            "unit": self.unit,
            "threshold": self.threshold,
            "direction": self.direction,
            "scale": "values",
            "template": self.template.name,
            "methods": list(self.methods),
            "grid": GRID,
            "matrices": {
                name: [[_known(float(x)) for x in row] for row in self.matrix(name)]
                for name in MATRICES
                if name != "dice" or self.threshold is not None
            },
            "parts": [part.to_dict() for part in self.parts],
            "pairs": [
                {"a": self.names[a], "b": self.names[b], "parts": [part.to_dict() for part in pair.parts]}
                for (a, b), pair in self.pairs.items()
            ],
            "notes": list(self.notes),
        }

    def to_csv(self) -> str:
        """A table with one line a pair and part."""
        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        rows = [
            {"a": self.names[a], "b": self.names[b], **part.to_dict()}
            for (a, b), pair in self.pairs.items()
            for part in pair.parts
        ]
        table.writerow(rows[0])
        for row in rows:
            table.writerow([f"{x:.6g}" if isinstance(x, float) else "" if x is None else x for x in row.values()])
        return text.getvalue()

    def with_reference(self, index: int) -> Agreement:
        """How the map of an index above 0 agrees with the first, over the whole map."""
        return self.pairs[0, index].whole


def compare_several(
    maps: Sequence[FlatMap | MapData | Surface],
    names: Sequence[str],
    array: str,
    threshold: float | None = None,
    direction: str | None = None,
    progress: ProgressCallback | None = None,
) -> SeveralMaps:
    """Compare one array of three maps or more: each pair, and the mean and standard deviation of all at each place.

    Places without a value on one map are left out of its pairs, and out of the mean and the spread, and counted.

    Parameters
    ----------
    maps : or the surfaces that map files hold; of the same template. The first is the reference.
    names : of the maps, each once.
    array : scalar point or cell array that all of them have.
    threshold, direction : for the overlap of what reaches the threshold, on every map, or None; as for `compare_maps`.

    Raises
    ------
    TemplateError : maps of different templates.
    LAFlatteningError : fewer than three maps, names that are not told apart; as for `compare_maps`.
    SurfaceError : a map file without the positions on the atrium.
    """
    if len(maps) < FEWEST_MAPS or len(names) != len(maps):
        raise LAFlatteningError(
            f"Expected {FEWEST_MAPS} maps or more, each with a name; found {len(maps)} maps and {len(names)} names. "
            "Two maps are compared by compare_maps."
        )
    if len(set(names)) < len(names):
        raise LAFlatteningError(f"Expected a name of its own for each map, found {', '.join(names)}.")
    readings = []
    for number, (one, name) in enumerate(zip(maps, names, strict=True)):
        report(progress, 0.4 * number / len(maps), f"Reading {name}")
        readings.append(read_map(one, array))
    direction = direction or diseased_side(array)
    template = readings[0].template
    for reading in readings[1:]:
        check_templates(template, reading.template)
    index = [(a, b) for a in range(len(maps)) for b in range(a + 1, len(maps))]
    pairs = {}
    for number, (a, b) in enumerate(index):
        report(progress, 0.4 + 0.6 * number / len(index), f"Comparing {names[a]} and {names[b]}")
        pairs[a, b] = compare_readings(
            readings[a], readings[b], threshold, threshold, direction, direction, scale="values"
        )
    values = np.stack([reading.values for reading in readings])
    # NaN wherever a map has no value.
    mean, sd = values.mean(axis=0), values.std(axis=0, ddof=1)
    areas = np.stack([reading.areas for reading in readings])
    covered = np.asarray(np.isfinite(areas).any(axis=0))
    row, column = np.nonzero(covered)
    regions = regions_at(template, places_of(template, row, column))
    weights = np.nanmean(areas[:, row, column], axis=0)

    def part(region: int, name: str) -> Spread:
        own = (regions == region) if region else np.ones(len(row), bool)
        return _spread(region, name, values[:, row[own], column[own]], weights[own])

    parts = [part(0, DISK), *(part(*entry) for entry in sorted(template.anatomy.region_names.items()))]
    methods = tuple(reading.method for reading in readings)
    notes = method_notes(methods)
    if parts[0].places < FEWEST_PLACES:
        notes.append("The maps have hardly any place in common where all have a value: there is no mean map.")
    elif parts[0].missing_percent >= 0.05:
        notes.append(
            f"{parts[0].missing_percent:.1f} % of the map have no value on one of the maps or more, and were left out "
            "of the mean and the spread."
        )
    return SeveralMaps(
        tuple(names), array, readings[0].unit, threshold, direction, template, methods, values, covered, mean, sd,
        pairs, tuple(parts), tuple(notes),
    )  # fmt: skip


def _spread(region: int, name: str, values: FloatArray, weights: FloatArray) -> Spread:
    """Of values (k, n) at the places of a part."""
    known = np.isfinite(values).all(axis=0)
    total = float(weights.sum())
    missing = 100.0 * float(weights[~known].sum()) / total if total > 0.0 else float("nan")
    count = int(np.count_nonzero(known))
    if count < FEWEST_PLACES:
        return Spread(region, name, count, missing, float("nan"), float("nan"), (float("nan"),) * len(values))
    share = weights[known] / weights[known].sum()
    means = values[:, known] @ share
    sd = float(np.sqrt(share @ values[:, known].var(axis=0, ddof=1)))
    return Spread(region, name, count, missing, float(means.mean()), sd, tuple(float(x) for x in means))


def _known(value: Any) -> Any:
    return None if isinstance(value, float) and np.isnan(value) else value
