"""Two maps compared place by place: before and after ablation, enhancement against voltage, patient against patient.

Maps of one template put the same anatomy in the same place, so both are read at the same places of the map: the middles
of a square grid. Each place counts by the area that it stands for on the atria in 3D, so that what the map enlarges
counts no more than it is.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._version import __version__
from .errors import LAFlatteningError
from .fibrosis import DIRECTIONS
from .flattening.flat_map import FlatMap
from .map_data import MapData
from .map_reading import GRID, MapReading, check_templates, method_notes, places_of, read_map, regions_at
from .quantities import diseased_side, readable
from .surface import FloatArray, IntArray, Surface
from .template import Template

BoolArray = NDArray[np.bool_]

DISK = "whole map"
"""Name of the whole among the parts."""
FEWEST_PLACES = 10
"""Fewer common places say nothing."""
SAME = 1e-12
"""Values that differ by less than this share of the largest are the same: interpolation rounds."""


@dataclass(frozen=True)
class Agreement:
    """How two quantities agree in one part of the map; all numbers are weighted by area in 3D, NaN where undefined.

    Attributes
    ----------
    region : its number; 0 for the whole map.
    name : for people.
    places : with a value on both maps.
    missing_percent : share of the part, by area, where one of the maps or both have no value: left out.
    area_cm2 : of the common places, mean of both atria.
    pearson, spearman : correlation of the values, and of their ranks.
    mean_a, mean_b : of the values.
    difference, difference_sd, difference_rms : of B - A on the scale of the comparison: mean, standard deviation, root
        mean square.
    dice : overlap of the places beyond both thresholds, 2 |A and B| / (|A| + |B|).
    percent_a, percent_b : share beyond its threshold, %.
    """

    region: int
    name: str
    places: int
    missing_percent: float
    area_cm2: float
    pearson: float
    spearman: float
    mean_a: float
    mean_b: float
    difference: float
    difference_sd: float
    difference_rms: float
    dice: float
    percent_a: float
    percent_b: float

    def to_dict(self) -> dict[str, Any]:
        """For JSON; numbers that do not exist are None."""
        return {key: None if value != value else value for key, value in vars(self).items()}


@dataclass(frozen=True, eq=False)
class Comparison:
    """What `compare_maps` finds.

    Attributes
    ----------
    array_a, array_b : what was compared.
    threshold_a, threshold_b : of the overlap, or None.
    direction_a, direction_b : "above" or "below": which values are diseased, and on which side of its threshold a value
        counts.
    scale : of the difference. "values": of one quantity, in its unit. "ranks": of two quantities that cannot be
        subtracted (enhancement and voltage): each value is the percentile of its place on its own map, by area, from
        normal to diseased.
    template : of both maps.
    methods : by which A and B were made; empty where a map file does not say.
    places : (k, 2) map units, where either map has triangles.
    row, column : (k,) of the places in the grid, row 0 at the bottom.
    values_a, values_b : (k,) NaN where there is none.
    weights : (k,) mm2 on the atrium, mean of both.
    regions : (k,) region of the template.
    parts : the whole map, then its regions.
    notes : what the user should know.
    """

    array_a: str
    array_b: str
    threshold_a: float | None
    threshold_b: float | None
    direction_a: str
    direction_b: str
    scale: str
    template: Template
    methods: tuple[str, str]
    places: FloatArray
    row: IntArray
    column: IntArray
    values_a: FloatArray
    values_b: FloatArray
    weights: FloatArray
    regions: IntArray
    parts: tuple[Agreement, ...]
    notes: tuple[str, ...]

    @property
    def whole(self) -> Agreement:
        """The whole map."""
        return self.parts[0]

    @property
    def difference(self) -> FloatArray:
        """(k,) B - A on the scale of the comparison, NaN where either has no value."""
        a, b = self.scaled
        return b - a

    @property
    def scaled(self) -> tuple[FloatArray, FloatArray]:
        """(k,) and (k,): the values, or their percentiles, 0 to 100, among the common places."""
        return _scaled(self.values_a, self.values_b, self.weights, self.scale, self.direction_a, self.direction_b)

    @property
    def beyond_a(self) -> BoolArray:
        """(k,) whether A is beyond its threshold; nowhere without one."""
        return _beyond(self.values_a, self.threshold_a, self.direction_a)

    @property
    def beyond_b(self) -> BoolArray:
        """(k,) whether B is beyond its threshold."""
        return _beyond(self.values_b, self.threshold_b, self.direction_b)

    def picture(self, values: NDArray) -> FloatArray:
        """Values (k,) at the places as a picture of `GRID` rows and columns, NaN elsewhere; row 0 at the bottom."""
        grid = np.full((GRID, GRID), np.nan)
        grid[self.row, self.column] = values
        return grid

    def at(self, positions: FloatArray, values: NDArray) -> FloatArray:
        """Values (k,) at the places, read at other positions (n, 2) on the map from the nearest place; (n,), NaN where
        there is none."""
        radius = self.template.radius
        steps = (positions - np.asarray(self.template.outer.shape.centre) + radius) * (GRID / (2.0 * radius))
        column, row = np.clip(np.floor(steps).astype(np.int64), 0, GRID - 1).T
        return self.picture(values)[row, column]

    def to_dict(self) -> dict[str, Any]:
        """For JSON (see Docs/formats.md)."""
        return {
            "version": __version__,
            "array_a": self.array_a,
            "array_b": self.array_b,
            "threshold_a": self.threshold_a,
            "threshold_b": self.threshold_b,
            "direction_a": self.direction_a,
            "direction_b": self.direction_b,
            "scale": self.scale,
            "template": self.template.name,
            "method_a": self.methods[0],
            "method_b": self.methods[1],
            "grid": GRID,
            "parts": [part.to_dict() for part in self.parts],
            "notes": list(self.notes),
        }

    def to_csv(self) -> str:
        """A table with one line a part."""
        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        rows = [part.to_dict() for part in self.parts]
        table.writerow(rows[0])
        for row in rows:
            table.writerow([f"{x:.6g}" if isinstance(x, float) else "" if x is None else x for x in row.values()])
        return text.getvalue()


def compare_maps(
    a: FlatMap | MapData | Surface,
    b: FlatMap | MapData | Surface,
    array_a: str,
    array_b: str,
    threshold_a: float | None = None,
    threshold_b: float | None = None,
    direction_a: str | None = None,
    direction_b: str | None = None,
    scale: str = "auto",
) -> Comparison:
    """Compare an array of one map with an array of another, at the same places of their template.

    Values are linear in each triangle. Places where one of the maps has a hole, or a corner without value, are left out
    and counted.

    Parameters
    ----------
    a, b : maps, or the surfaces that map files hold; of the same template.
    array_a, array_b : scalar point or cell arrays.
    threshold_a, threshold_b : both, for the overlap of what reaches them (Dice), or neither.
    direction_a, direction_b : "above" (a value counts from its threshold on) or "below" (where it is less).
        Default: below for voltages, above for everything else.
    scale : "values", "ranks" (see `Comparison`), or "auto": values if both arrays have the same name.

    Raises
    ------
    TemplateError : maps of different templates.
    LAFlatteningError : no such array, NaN everywhere, no common places, one threshold only or none that is a number.
    SurfaceError : a map file without the positions on the atrium.
    """
    one, other = read_map(a, array_a), read_map(b, array_b)
    return compare_readings(one, other, threshold_a, threshold_b, direction_a, direction_b, scale)


def compare_readings(
    a: MapReading,
    b: MapReading,
    threshold_a: float | None = None,
    threshold_b: float | None = None,
    direction_a: str | None = None,
    direction_b: str | None = None,
    scale: str = "auto",
) -> Comparison:
    """As `compare_maps`, of maps that are read already; so that each of many is read once."""
    check_templates(a.template, b.template)
    if (threshold_a is None) != (threshold_b is None):
        raise LAFlatteningError("The overlap needs a threshold for each map; found one. Give both, or none.")
    for threshold in (threshold_a, threshold_b):
        if threshold is not None and not np.isfinite(threshold):
            raise LAFlatteningError(f"Expected thresholds that are numbers, found {threshold:g}.")
    direction_a, direction_b = direction_a or diseased_side(a.array), direction_b or diseased_side(b.array)
    for direction in (direction_a, direction_b):
        if direction not in DIRECTIONS:
            raise LAFlatteningError(f'Expected the direction "above" or "below", found "{direction}".')
    notes = method_notes((a.method, b.method))
    scale, ranked = _scale(a, b, scale)
    notes += ranked
    row, column = np.nonzero(a.covered | b.covered)
    places = places_of(a.template, row, column)
    values_a, values_b = a.values[row, column], b.values[row, column]
    with np.errstate(invalid="ignore"):
        weights = np.nanmean(np.stack([a.areas[row, column], b.areas[row, column]]), axis=0)
    regions = regions_at(a.template, places)
    if np.count_nonzero(np.isfinite(values_a) & np.isfinite(values_b)) < FEWEST_PLACES:
        raise LAFlatteningError(
            f'"{a.array}" and "{b.array}" have hardly any value at a common place of the maps. Check where each of '
            "them has values."
        )
    scaled_a, scaled_b = _scaled(values_a, values_b, weights, scale, direction_a, direction_b)
    difference = scaled_b - scaled_a
    beyond_a, beyond_b = _beyond(values_a, threshold_a, direction_a), _beyond(values_b, threshold_b, direction_b)

    def part(region: int, name: str, own: BoolArray) -> Agreement:
        values = (values_a[own], values_b[own], weights[own], difference[own])
        beyond = (beyond_a[own], beyond_b[own]) if threshold_a is not None else None
        return _agreement(region, name, *values, beyond)

    whole = part(0, DISK, np.ones(len(places), bool))
    parts = [whole]
    for number, name in sorted(a.template.anatomy.region_names.items()):
        parts.append(part(number, name, regions == number))
    if whole.missing_percent >= 0.05:
        notes.append(
            f"{whole.missing_percent:.1f} % of the map have no value on one of the two maps, or on both, and "
            "were left out."
        )
    notes += _doubts((f"{a.array} of A", values_a), (f"{b.array} of B", values_b), scale)
    return Comparison(
        a.array,
        b.array,
        threshold_a,
        threshold_b,
        direction_a,
        direction_b,
        scale,
        a.template,
        (a.method, b.method),
        places,
        row,
        column,
        values_a,
        values_b,
        weights,
        regions,
        tuple(parts),
        tuple(notes),
    )


def weighted_correlation(x: FloatArray, y: FloatArray, weights: FloatArray) -> float:
    """Pearson's correlation with weights; NaN if one of the quantities is the same everywhere.

    Examples
    --------
    >>> weighted_correlation(np.array([0.0, 1.0, 9.0]), np.array([1.0, 3.0, 0.0]), np.array([1.0, 1.0, 0.0]))
    1.0
    """
    if any(np.ptp(values) <= SAME * np.abs(values).max() for values in (x, y)):
        return float("nan")
    share = weights / weights.sum()
    x, y = x - share @ x, y - share @ y
    variances = (share @ x**2) * (share @ y**2)
    return float(np.clip(share @ (x * y) / np.sqrt(variances), -1.0, 1.0)) if variances > 0.0 else float("nan")


def weighted_ranks(values: FloatArray, weights: FloatArray) -> FloatArray:
    """The share of the weight below each value, plus half the share of its equals: ranks, 0 to 1.

    What is the same in large parts of a map is not put into an order by its last digits (`SAME`).
    """
    step = SAME * float(np.abs(values).max())
    kinds, index = np.unique(np.round(values / step) if step > 0.0 else values, return_inverse=True)
    own = np.bincount(index, weights, minlength=len(kinds)) / weights.sum()
    return (np.cumsum(own) - 0.5 * own)[index]


def _doubts(a: tuple[str, FloatArray], b: tuple[str, FloatArray], scale: str) -> list[str]:
    """What speaks against comparing two quantities, each with what it is called."""
    known = [values[np.isfinite(values)] for _, values in (a, b)]
    notes = [
        f"{name} is {readable(values[0])} everywhere, so that there is no correlation."
        for (name, _), values in zip((a, b), known, strict=True)
        if np.ptp(values) <= SAME * np.abs(values).max()
    ]
    # A few outliers say nothing about the scale.
    limits = [np.percentile(values, [1.0, 99.0]) for values in known]
    if scale == "values" and (limits[0][1] < limits[1][0] or limits[1][1] < limits[0][0]):
        spans = [
            f"{name} ({readable(low)} to {readable(high)})"
            for (name, _), (low, high) in zip((a, b), limits, strict=True)
        ]
        notes.append(
            f"{' and '.join(spans)} have no values in common: if they are not on one scale, their difference means "
            'nothing. Take the scale "ranks" then.'
        )
    return notes


def _scale(a: MapReading, b: MapReading, scale: str) -> tuple[str, list[str]]:
    """The scale of a difference, and what the user should know of it."""
    if scale not in ("auto", "values", "ranks"):
        raise LAFlatteningError(f'Expected the scale "auto", "values" or "ranks", found "{scale}".')
    units = [reading.unit for reading in (a, b)]
    if scale == "values" and all(units) and units[0] != units[1]:
        raise LAFlatteningError(
            f'"{a.array}" ({units[0]}) and "{b.array}" ({units[1]}) have different units, so that they cannot be '
            "subtracted. Compare them by rank: leave the scale out, or give ranks."
        )
    if scale == "ranks" or (scale == "auto" and a.array != b.array):
        if a.array == b.array:
            return "ranks", []
        return "ranks", [
            f'"{a.array}" and "{b.array}" are taken for different quantities: the difference is that of their ranks, '
            "not of their values."
        ]
    return "values", []


def _beyond(values: FloatArray, threshold: float | None, direction: str) -> BoolArray:
    if threshold is None:
        return np.zeros(len(values), bool)
    return values >= threshold if direction == "above" else values < threshold


def _scaled(
    a: FloatArray, b: FloatArray, weights: FloatArray, scale: str, direction_a: str, direction_b: str
) -> tuple[FloatArray, FloatArray]:
    if scale == "values":
        return a, b
    both = np.isfinite(a) & np.isfinite(b)
    ranks = np.full((2, len(a)), np.nan)
    for row, values, direction in zip(ranks, (a, b), (direction_a, direction_b), strict=True):
        rank = weighted_ranks(values[both], weights[both])
        row[both] = 100.0 * (rank if direction == "above" else 1.0 - rank)
    return ranks[0], ranks[1]


def _agreement(
    region: int,
    name: str,
    a: FloatArray,
    b: FloatArray,
    weights: FloatArray,
    difference: FloatArray,
    beyond: tuple[BoolArray, BoolArray] | None,
) -> Agreement:
    both = np.isfinite(a) & np.isfinite(b)
    total = float(weights.sum())
    missing = 100.0 * float(weights[~both].sum()) / total if total > 0.0 else float("nan")
    a, b, weights, difference = a[both], b[both], weights[both], difference[both]
    area = float(weights.sum())
    if len(a) < FEWEST_PLACES:
        return Agreement(region, name, len(a), missing, area / 100.0, *[float("nan")] * 10)
    share = weights / area
    mean = float(share @ difference)
    # Of percentiles on the whole map it is 0, but for rounding.
    mean = 0.0 if abs(mean) <= SAME * np.abs(difference).max() else mean
    dice = percent_a = percent_b = float("nan")
    if beyond is not None:
        in_a, in_b = beyond[0][both], beyond[1][both]
        percent_a, percent_b = 100.0 * float(share[in_a].sum()), 100.0 * float(share[in_b].sum())
        if percent_a + percent_b > 0.0:
            dice = 200.0 * float(share[in_a & in_b].sum()) / (percent_a + percent_b)
    return Agreement(
        region,
        name,
        len(a),
        missing,
        area / 100.0,
        weighted_correlation(a, b, weights),
        weighted_correlation(weighted_ranks(a, weights), weighted_ranks(b, weights), weights),
        float(share @ a),
        float(share @ b),
        mean,
        float(np.sqrt(share @ (difference - mean) ** 2)),
        float(np.sqrt(share @ difference**2)),
        dice,
        percent_a,
        percent_b,
    )
