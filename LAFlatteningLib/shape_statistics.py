"""What the sizes of several atria have in common, and which differ: the paper's appendix tables for a population."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from ._version import __version__
from .anatomy import COMPARED
from .errors import LAFlatteningError
from .measurement import Measurement
from .surface import FloatArray

FEWEST_FOR_WILCOXON = 6
"""With fewer pairs, not even differences that all go one way are significant at 5 % by Wilcoxon's test."""


@dataclass(frozen=True)
class Spread:
    """One size over several atria.

    Attributes
    ----------
    group : "perimeter", "perimeter ratio", "path" or "path ratio".
    name : opening or path.
    unit : "mm" or "1".
    values : (n,) one for each atrium.
    """

    group: str
    name: str
    unit: str
    values: FloatArray

    @property
    def summary(self) -> dict[str, float | None]:
        """Mean, standard deviation (n - 1; None for one atrium), median, smallest, largest."""
        x = self.values
        return {
            "mean": float(x.mean()),
            "sd": float(x.std(ddof=1)) if len(x) > 1 else None,
            "median": float(np.median(x)),
            "smallest": float(x.min()),
            "largest": float(x.max()),
        }


@dataclass(frozen=True)
class PairedTest:
    """Whether one size is larger than another in the same atria.

    Attributes
    ----------
    group, first, second : the sizes, see `Spread`.
    n : atria.
    median_difference : second - first, mm.
    p_wilcoxon : Wilcoxon's signed rank test, two-sided; None for fewer than `FEWEST_FOR_WILCOXON` atria.
    p_t : paired t test, two-sided; None for fewer than 3 atria, or differences that are all the same.
    """

    group: str
    first: str
    second: str
    n: int
    median_difference: float
    p_wilcoxon: float | None
    p_t: float | None


@dataclass(frozen=True)
class ShapeTable:
    """Sizes of several atria.

    Attributes
    ----------
    names : of the atria.
    spreads : every size.
    tests : see `anatomy.COMPARED`. No correction for their number is made.
    """

    names: tuple[str, ...]
    spreads: tuple[Spread, ...]
    tests: tuple[PairedTest, ...]

    def spread(self, group: str, name: str) -> Spread:
        """One size; KeyError if there is none."""
        for one in self.spreads:
            if (one.group, one.name) == (group, name):
                return one
        raise KeyError((group, name))

    def to_dict(self) -> dict[str, Any]:
        """For JSON (see Docs/formats.md)."""
        return {
            "version": __version__,
            "atria": list(self.names),
            "sizes": [
                {"group": s.group, "name": s.name, "unit": s.unit, **s.summary, "values": s.values.tolist()}
                for s in self.spreads
            ],
            "paired_tests": [vars(test) for test in self.tests],
        }

    def to_csv(self) -> str:
        """A table with one line a size."""
        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        table.writerow(["group", "name", "unit", "n", "mean", "sd", "median", "smallest", "largest", *self.names])
        for s in self.spreads:
            numbers = ["" if x is None else f"{x:.4f}" for x in s.summary.values()]
            table.writerow([s.group, s.name, s.unit, len(s.values), *numbers, *(f"{x:.4f}" for x in s.values)])
        return text.getvalue()


def tabulate(measurements: Mapping[str, Measurement]) -> ShapeTable:
    """Put the sizes of several atria together.

    Parameters
    ----------
    measurements : name -> sizes, all of one anatomy.

    Raises
    ------
    LAFlatteningError : none, or of several anatomies.
    """
    if not measurements:
        raise LAFlatteningError("Expected the measurements of one atrium or more, found none.")
    every = list(measurements.values())
    for name, one in measurements.items():
        same = (
            one.perimeters_mm.keys() == every[0].perimeters_mm.keys()
            and one.paths_mm.keys() == every[0].paths_mm.keys()
        )
        if not same:
            raise LAFlatteningError(
                f"{name} has other openings or paths than {next(iter(measurements))}: expected measurements of one "
                "anatomy. Tabulate each anatomy by itself."
            )
    spreads = []
    for group, unit, sizes in (
        ("perimeter", "mm", [one.perimeters_mm for one in every]),
        ("perimeter ratio", "1", [one.perimeter_ratios for one in every]),
        ("path", "mm", [one.paths_mm for one in every]),
        ("path ratio", "1", [one.path_ratios for one in every]),
    ):
        spreads += [Spread(group, name, unit, np.array([one[name] for one in sizes])) for name in sizes[0]]
    known = {(s.group, s.name): s.values for s in spreads}
    tests = [
        _test(group, first, second, known[group, first], known[group, second])
        for group, pairs in COMPARED.items()
        for first, second in pairs
        if (group, first) in known and (group, second) in known
    ]
    return ShapeTable(tuple(measurements), tuple(spreads), tuple(tests))


def _test(group: str, first: str, second: str, a: FloatArray, b: FloatArray) -> PairedTest:
    difference: Sequence[float] | FloatArray = b - a
    varies = len(a) >= 3 and float(np.ptp(difference)) > 0.0
    wilcoxon = float(stats.wilcoxon(a, b).pvalue) if len(a) >= FEWEST_FOR_WILCOXON and varies else None
    t = float(stats.ttest_rel(a, b).pvalue) if varies else None
    return PairedTest(group, first, second, len(a), float(np.median(difference)), wilcoxon, t)
