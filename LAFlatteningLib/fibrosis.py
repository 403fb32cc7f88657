"""How much of the wall is fibrotic, or of low voltage: classes by thresholds, measured on the atrium in 3D."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._version import __version__
from .anatomy import LEFT_ATRIUM, Anatomy
from .blood_pool import BloodPool
from .errors import LAFlatteningError
from .fine_projection import project_finely
from .flattening.flat_map import REGION_ARRAY, FlatMap
from .map_data import MapData
from .projection import projection_of
from .quantities import diseased_side, is_voltage, readable, unit_of
from .rules import DIRECTIONS, RULES, Rule
from .scalar_arrays import corner_values, share_reaching
from .surface import IntArray, Surface
from .volume import Volume

BoolArray = NDArray[np.bool_]

ATRIUM = "atrium"
"""Name of the whole among the parts."""
_NAMES = {
    ("above", 1): ("normal", "fibrosis"),
    ("above", 2): ("normal", "border zone", "dense fibrosis"),
    ("below", 1): ("normal", "low"),
    ("below", 2): ("normal", "low", "very low"),
}
_VOLTAGE_NAMES = {1: ("normal", "low"), 2: ("normal", "low", "scar")}
"""Of classes of voltage, see `rules.LOW_VOLTAGE_MV`."""


@dataclass(frozen=True)
class Part:
    """The classes in one part of the atrium.

    Attributes
    ----------
    group : "atrium", "region", or the name of a parcellation.
    label : its number in the cell array; 0 for the whole atrium.
    name : for people.
    area_cm2 : of the triangles with values, on the atrium in 3D; percentages are of it.
    missing_cm2, missing_triangles : of triangles without a value at one corner or more, left out.
    mean : of the values, weighted by area; NaN where there is none.
    class_cm2 : area of each class, from normal to the last.
    """

    group: str
    label: int
    name: str
    area_cm2: float
    missing_cm2: float
    missing_triangles: int
    mean: float
    class_cm2: tuple[float, ...]

    @property
    def class_percent(self) -> tuple[float, ...]:
        """Share of each class in the area with values, %; NaN where there is none."""
        whole = self.area_cm2
        return tuple(100.0 * area / whole if whole > 0.0 else float("nan") for area in self.class_cm2)

    @property
    def beyond_percent(self) -> float:
        """Share beyond the first threshold, %: every class but the normal one."""
        return float(sum(self.class_percent[1:]))


@dataclass(frozen=True, eq=False)
class Fibrosis:
    """What `measure_fibrosis` finds.

    Attributes
    ----------
    array, unit : what was measured.
    rule, thresholds : thresholds are in the units of the array.
    class_names : from normal on, one more than thresholds.
    blood_pool : with which the wall was compared, or None.
    sampled_mm : how far apart the image was sampled along the wall; None where values at the points were taken.
    parts : the whole atrium, then regions, then parts of parcellations.
    notes : what the user should know.
    """

    array: str
    unit: str
    rule: Rule
    thresholds: tuple[float, ...]
    class_names: tuple[str, ...]
    blood_pool: BloodPool | None
    sampled_mm: float | None
    projection: Mapping[str, Any] | None
    parts: tuple[Part, ...]
    notes: tuple[str, ...]

    @property
    def atrium(self) -> Part:
        """The whole."""
        return self.parts[0]

    def part(self, group: str, label: int) -> Part:
        """One part; KeyError if there is none."""
        for part in self.parts:
            if (part.group, part.label) == (group, label):
                return part
        raise KeyError((group, label))

    def class_label(self, index: int) -> str:
        """A class with its limits, as in "border zone (120 to 132)"."""
        limits = limits_in_words(self.thresholds, self.rule.direction, self.unit)
        return f"{self.class_names[index]} ({limits[index]})"

    def to_dict(self) -> dict[str, Any]:
        """For JSON; numbers that do not exist are None (see Docs/formats.md)."""
        return {
            "version": __version__,
            "array": self.array,
            "unit": self.unit,
            "rule": str(self.rule),
            "direction": self.rule.direction,
            "thresholds": list(self.thresholds),
            "classes": list(self.class_names),
            "blood_pool": self.blood_pool.to_dict() if self.blood_pool else None,
            "sampled_mm": self.sampled_mm,
            "projection": dict(self.projection) if self.projection else None,
            "parts": [
                {
                    "group": part.group,
                    "label": part.label,
                    "name": part.name,
                    "area_cm2": part.area_cm2,
                    "missing_cm2": part.missing_cm2,
                    "missing_triangles": part.missing_triangles,
                    "mean": _known(part.mean),
                    "beyond_percent": _known(part.beyond_percent),
                    "class_cm2": list(part.class_cm2),
                    "class_percent": [_known(share) for share in part.class_percent],
                }
                for part in self.parts
            ],
            "notes": list(self.notes),
        }

    def to_csv(self) -> str:
        """A table with one line a part."""
        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        header = ["group", "label", "name", "area_cm2", "missing_cm2", "missing_triangles", "mean", "beyond_percent"]
        columns = [name.replace(" ", "_") for name in self.class_names]
        table.writerow([*header, *(f"{name}_cm2" for name in columns), *(f"{name}_percent" for name in columns)])
        for part in self.parts:
            numbers = [part.mean, part.beyond_percent, *part.class_cm2, *part.class_percent]
            row = [part.group, part.label, part.name, f"{part.area_cm2:.4f}", f"{part.missing_cm2:.4f}"]
            row += [part.missing_triangles, *("" if np.isnan(number) else f"{number:.4f}" for number in numbers)]
            table.writerow(row)
        return text.getvalue()


def measure_fibrosis(
    atrium: FlatMap | MapData | Surface,
    array: str,
    rule: Rule,
    blood_pool: BloodPool | None = None,
    *,
    parcels: Mapping[str, tuple[IntArray, Mapping[int, str]]] | None = None,
    class_names: Sequence[str] | None = None,
    unit: str | None = None,
    anatomy: Anatomy | None = None,
    volume: Volume | None = None,
) -> Fibrosis:
    """Areas of the classes of an array, on the atrium in 3D.

    In each triangle the array is linear between its corners, and the area beyond a threshold is exact: nothing depends
    on which points happen to exceed it. Where the image that an array was projected from is given, it is sampled within
    the triangles as well (`fine_projection`), so that the result does not depend on the triangulation. Triangles with a
    corner without value are left out and counted.

    Parameters
    ----------
    atrium : a map, the surface that a map file holds, or an atrium in 3D; its cell array ``region``, if there, gives
        the regions.
    array : scalar point array, or cell array.
    parcels : name of a group -> label of each triangle (m,), and label -> name. Labels without a name count to nothing.
    class_names : from normal on, one more than thresholds; by default those in use for the quantity.
    unit : of the array, for people; by default that of a quantity that is known by its name.
    anatomy : names the regions; default: that of the map, or the left atrium.
    volume : the image that the array was projected from. Another image has no effect.

    Raises
    ------
    LAFlatteningError : no such array, or one that is NaN everywhere; the rule needs a blood pool, or compares with
        blood what is no intensity (a voltage); names or labels that do not fit.
    SurfaceError : a map file without the positions on the atrium.

    Examples
    --------
    >>> from LAFlatteningLib.phantom import make_phantom
    >>> found = measure_fibrosis(make_phantom(2000).surface, "LGE", Rule("value", (120.0,)))
    >>> round(found.atrium.beyond_percent)
    15
    """
    if rule.needs_blood_pool and unit_of(array):
        raise LAFlatteningError(
            f"The rule {rule.kind} compares intensities of an image with those of blood, and {array} is in "
            f"{unit_of(array)}. Take the rule value, like value=0.5,0.1 for bipolar voltage."
        )
    surface, data = on_atrium(atrium)
    sampled_mm = None
    fine = project_finely(surface, volume, array) if volume is not None else None
    if fine is not None:
        surface, parcels, sampled_mm = fine.surface, fine.parcels(parcels or {}), fine.edge_mm
    anatomy = anatomy or (data.template.anatomy if data is not None else LEFT_ATRIUM)
    corners = corner_values(surface, array)
    thresholds = rule.thresholds(blood_pool)
    names = tuple(class_names) if class_names is not None else _default_names(rule, array)
    unit = unit_of(array) if unit is None else unit
    if len(names) != len(thresholds) + 1:
        raise LAFlatteningError(
            f"Expected {len(thresholds) + 1} names of classes, found {len(names)}: {', '.join(names)}."
        )
    if not all(names) or len(set(names)) < len(names):
        raise LAFlatteningError(f"Expected names of classes that differ, none empty; found {', '.join(names)}.")
    area = surface.triangle_areas / 100.0
    missing: BoolArray = np.any(np.isnan(corners), axis=1)
    filled = np.where(missing[:, None], 0.0, corners)
    reached = np.stack([area * share_reaching(filled, threshold) for threshold in thresholds])
    if rule.direction == "below":
        reached = area - reached
    classes = np.diff(np.concatenate([area[None], reached, np.zeros((1, len(area)))]), axis=0) * -1.0
    classes[:, missing] = 0.0
    # Rounding must not leave less than nothing.
    classes = np.maximum(classes, 0.0)

    def part(group: str, label: int, name: str, own: BoolArray) -> Part:
        known = area[own & ~missing]
        total = float(known.sum())
        mean = float(known @ filled[own & ~missing].mean(axis=1)) / total if total > 0.0 else float("nan")
        lost = own & missing
        shares = tuple(float(one) for one in classes[:, own].sum(axis=1))
        return Part(group, label, name, total, float(area[lost].sum()), int(np.count_nonzero(lost)), mean, shares)

    whole = part(ATRIUM, 0, "whole atrium", np.ones(len(area), bool))
    parts, notes = [whole], []
    for group, label, name, own in _parts(surface, array, anatomy, parcels or {}):
        parts.append(part(group, label, name, own))
    if whole.missing_triangles:
        share = 100.0 * whole.missing_cm2 / (whole.missing_cm2 + whole.area_cm2)
        notes.append(
            f"{whole.missing_triangles} triangles ({whole.missing_cm2:.1f} cm2, {share:.1f} % of the atrium) have no "
            "value and were left out."
        )
    low, high = float(filled[~missing].min()), float(filled[~missing].max())
    if low >= max(thresholds) or high < min(thresholds):
        notes.append(
            f"All values of {array} ({readable(low)} to {readable(high)}) are on one side of the thresholds "
            f"({', '.join(readable(limit) for limit in thresholds)}). Check that these are meant for this array."
        )
    if rule.direction != diseased_side(array):
        notes.append(
            f"Values of {array} {rule.direction} the thresholds were counted as diseased; as a rule, those on the "
            "other side are."
        )
    return Fibrosis(
        array,
        unit,
        rule,
        thresholds,
        names,
        blood_pool,
        sampled_mm,
        projection_of(surface, array),
        tuple(parts),
        tuple(notes),
    )


def limits_in_words(thresholds: Sequence[float], direction: str, unit: str = "") -> list[str]:
    """The limits of each class, from normal on.

    Examples
    --------
    >>> limits_in_words([0.5, 0.1], "below", "mV")
    ['≥ 0.5 mV', '0.1 to 0.5 mV', '< 0.1 mV']
    """
    limits, above = [readable(limit) for limit in thresholds], direction == "above"
    inner = [" to ".join(pair if above else pair[::-1]) for pair in pairwise(limits)]
    texts = [f"{'<' if above else '≥'} {limits[0]}", *inner, f"{'≥' if above else '<'} {limits[-1]}"]
    return [f"{text} {unit}" if unit else text for text in texts]


def on_atrium(atrium: FlatMap | MapData | Surface) -> tuple[Surface, MapData | None]:
    """The atrium in 3D with its arrays and, where they are known, regions; and its map, None for an atrium without.

    Raises
    ------
    SurfaceError : a map file without the positions on the atrium.
    """
    if isinstance(atrium, Surface) and np.ptp(atrium.points[:, 2]) > 0.0:
        return atrium, None
    data = MapData.of(atrium)
    if isinstance(atrium, FlatMap):
        surface = data.surface.with_data(cell_data={REGION_ARRAY: atrium.regions})
        data = replace(data, surface=surface)
    return data.surface, data


def _default_names(rule: Rule, array: str) -> tuple[str, ...]:
    count = len(rule.factors)
    if is_voltage(array) and rule.direction == "below" and count in _VOLTAGE_NAMES:
        return _VOLTAGE_NAMES[count]
    numbered = ("normal", *(f"class {number}" for number in range(1, count + 1)))
    if rule.direction == "above" and unit_of(array):
        # Late activation, for example, is no fibrosis.
        return numbered
    return _NAMES.get((rule.direction, count), numbered)


def _parts(
    surface: Surface, array: str, anatomy: Anatomy, parcels: Mapping[str, tuple[IntArray, Mapping[int, str]]]
) -> Iterable[tuple[str, int, str, BoolArray]]:
    """Group, label, name and triangles of each part."""
    count = len(surface.triangles)
    groups = dict(parcels)
    region = surface.cell_data.get(REGION_ARRAY)
    if region is not None and array != REGION_ARRAY and REGION_ARRAY not in groups:
        groups = {REGION_ARRAY: (np.asarray(region).reshape(-1), anatomy.region_names), **groups}
    for group, (labels, names) in groups.items():
        if np.shape(labels) != (count,):
            raise LAFlatteningError(
                f'The labels "{group}" have the shape {np.shape(labels)}, expected ({count},), one for each triangle.'
            )
        for label, name in sorted(names.items()):
            yield group, label, name, labels == label


def _known(value: float) -> float | None:
    return None if np.isnan(value) else value


__all__ = [
    "DIRECTIONS",
    "RULES",
    "Fibrosis",
    "Part",
    "Rule",
    "limits_in_words",
    "measure_fibrosis",
    "on_atrium",
]
