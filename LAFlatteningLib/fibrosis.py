"""How much of the wall is fibrotic, or of low voltage: classes by thresholds, measured on the atrium in 3D.

Rules in use: image intensity ratio to the mean of the blood pool (Khurram et al. 2014; 1.2 and 1.32 are common), mean
plus k standard deviations of the blood pool (2 and 3 are common), absolute values. For voltage, classes lie below the
thresholds.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._version import __version__
from .anatomy import LEFT_ATRIUM, Anatomy
from .blood_pool import BloodPool
from .errors import LAFlatteningError
from .flattening.flat_map import REGION_ARRAY, FlatMap
from .map_data import MapData
from .quantities import diseased_side, readable, unit_of
from .scalar_arrays import corner_values, share_reaching
from .surface import IntArray, Surface

BoolArray = NDArray[np.bool_]

RULES = ("iir", "sd", "value")
DIRECTIONS = ("above", "below")
ATRIUM = "atrium"
"""Name of the whole among the parts."""
_NAMES = {
    ("above", 1): ("normal", "fibrosis"),
    ("above", 2): ("normal", "border zone", "dense fibrosis"),
    ("below", 1): ("normal", "low"),
    ("below", 2): ("normal", "low", "very low"),
}


@dataclass(frozen=True)
class Rule:
    """How thresholds are found.

    Attributes
    ----------
    kind : "iir" (factors times the mean of the blood pool), "sd" (mean of the blood pool plus factors times its
        standard deviation) or "value" (the factors themselves).
    factors : from normal to diseased: rising, or falling where classes lie below the thresholds.
    direction : "above": a class begins where a value reaches its threshold. "below": where it is less.

    Raises
    ------
    LAFlatteningError : unknown kind or direction, no factor, factors out of order.

    Examples
    --------
    >>> Rule.parse("iir=1.2,1.32").thresholds(BloodPool(100.0, 8.0, "example"))
    (120.0, 132.0)
    >>> Rule.parse("value=0.5,0.1", "below").thresholds(None)
    (0.5, 0.1)
    """

    kind: str
    factors: tuple[float, ...]
    direction: str = "above"

    def __post_init__(self) -> None:
        if self.kind not in RULES:
            raise LAFlatteningError(f'Expected a rule iir=..., sd=... or value=..., found "{self.kind}".')
        if self.direction not in DIRECTIONS:
            raise LAFlatteningError(f'Expected classes "above" or "below" thresholds, found "{self.direction}".')
        if not self.factors or not np.isfinite(self.factors).all():
            raise LAFlatteningError(
                f"Expected numbers as thresholds of the rule {self.kind}, found {list(self.factors) or 'none'}."
            )
        sign = 1.0 if self.direction == "above" else -1.0
        if any(sign * b <= sign * a for a, b in zip(self.factors, self.factors[1:], strict=False)):
            order = "rising" if self.direction == "above" else "falling"
            falls = self.direction == "above" and list(self.factors) == sorted(set(self.factors), reverse=True)
            right = ",".join(f"{x:g}" for x in sorted(set(self.factors), reverse=self.direction == "below"))
            raise LAFlatteningError(
                f"The thresholds are out of order: expected them from normal to diseased, {order}, each once; found "
                f"{','.join(f'{x:g}' for x in self.factors)}. Write {self.kind}={right}"
                + (', or choose the direction "below" if low values are diseased.' if falls else ".")
            )

    @classmethod
    def parse(cls, text: str, direction: str = "above") -> Rule:
        """Read a rule like ``iir=1.2,1.32``."""
        kind, _, numbers = text.partition("=")
        try:
            factors = tuple(float(number) for number in numbers.split(","))
        except ValueError:
            raise LAFlatteningError(
                f'Expected a rule like iir=1.2,1.32 or sd=2,3 or value=120, found "{text}".'
            ) from None
        return cls(kind.strip(), factors, direction)

    @property
    def needs_blood_pool(self) -> bool:
        """Whether thresholds depend on the blood pool."""
        return self.kind != "value"

    def thresholds(self, blood_pool: BloodPool | None) -> tuple[float, ...]:
        """The thresholds in the units of the array.

        Raises
        ------
        LAFlatteningError : no blood pool where one is needed, or one with which the rule means nothing.
        """
        if not self.needs_blood_pool:
            return self.factors
        if blood_pool is None:
            raise LAFlatteningError(
                f"The rule {self.kind} compares with the blood pool, which is not known. Give the image, a region "
                "of it, or mean and standard deviation of the blood."
            )
        if self.kind == "sd":
            if blood_pool.sd == 0.0:
                raise LAFlatteningError(
                    "The blood pool has the standard deviation 0, so that mean + k SD is no threshold. Take the rule "
                    "iir or value, or another region of blood."
                )
            return tuple(blood_pool.mean + factor * blood_pool.sd for factor in self.factors)
        if blood_pool.shifted or blood_pool.mean <= 0.0:
            raise LAFlatteningError(
                f"The intensities of the image were shifted (mean of the blood pool {blood_pool.mean:.3g}; z-scores, "
                "for example, lie below zero in part), so that a ratio to the blood pool means nothing. Take the rule "
                "sd, or the original image."
            )
        return tuple(factor * blood_pool.mean for factor in self.factors)

    def __str__(self) -> str:
        return f"{self.kind}={','.join(f'{factor:g}' for factor in self.factors)}"


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
    parts : the whole atrium, then regions, then parts of parcellations.
    notes : what the user should know.
    """

    array: str
    unit: str
    rule: Rule
    thresholds: tuple[float, ...]
    class_names: tuple[str, ...]
    blood_pool: BloodPool | None
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
        return f"{self.class_names[index]} ({limits_text(self.thresholds, self.rule.direction, self.unit, index)})"

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
) -> Fibrosis:
    """Areas of the classes of an array, on the atrium in 3D.

    In each triangle the array is linear between its corners, and the area beyond a threshold is exact: nothing depends
    on which points happen to exceed it. Triangles with a corner without value are left out and counted.

    Parameters
    ----------
    atrium : a map, the surface that a map file holds, or an atrium in 3D; its cell array ``region``, if there, gives
        the regions.
    array : scalar point array, or cell array.
    parcels : name of a group -> label of each triangle (m,), and label -> name. Labels without a name count to nothing.
    class_names : from normal on, one more than thresholds.
    unit : of the array, for people; default: by its name (`quantities.unit_of`).
    anatomy : names the regions; default: that of the map, or the left atrium.

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
    surface, data = on_atrium(atrium)
    anatomy = anatomy or (data.template.anatomy if data is not None else LEFT_ATRIUM)
    corners = corner_values(surface, array)
    unit = unit_of(array) if unit is None else unit
    if rule.needs_blood_pool and unit_of(array):
        raise LAFlatteningError(
            f"The rule {rule.kind} compares intensities of an image with those of blood, and {array} is in "
            f"{unit_of(array)}. Take the rule value, like value=0.5,0.1 for bipolar voltage."
        )
    thresholds = rule.thresholds(blood_pool)
    names = tuple(class_names) if class_names is not None else _default_names(rule, array)
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
    first, last = min(thresholds), max(thresholds)
    if low >= last or high < first:
        notes.append(
            f"All values of {array} ({readable(low)} to {readable(high)}) are on one side of the thresholds "
            f"({', '.join(readable(limit) for limit in thresholds)}). Check that these are meant for this array."
        )
    if rule.direction != diseased_side(array):
        notes.append(
            f"Values of {array} {rule.direction} the thresholds were counted as diseased; as a rule, those on the "
            "other side are."
        )
    return Fibrosis(array, unit, rule, thresholds, names, blood_pool, tuple(parts), tuple(notes))


def limits_text(thresholds: Sequence[float], direction: str, unit: str, index: int) -> str:
    """The limits of a class in words, normal first, as in "120 to 132"."""
    limits, unit = [readable(limit) for limit in thresholds], f" {unit}" if unit else ""
    above = direction == "above"
    if index == 0:
        return f"{'<' if above else '≥'} {limits[0]}{unit}"
    if index == len(limits):
        return f"{'≥' if above else '<'} {limits[-1]}{unit}"
    return " to ".join(limits[index - 1 : index + 1] if above else limits[index - 1 : index + 1][::-1]) + unit


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
        data = MapData(surface, data.flat, data.template)
    return data.surface, data


def _default_names(rule: Rule, array: str) -> tuple[str, ...]:
    count = len(rule.factors)
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
    "Fibrosis",
    "Part",
    "Rule",
    "limits_text",
    "measure_fibrosis",
    "on_atrium",
]
