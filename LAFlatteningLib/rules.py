"""Rules by which thresholds between normal and diseased wall are found.

In use: image intensity ratio to the mean of the blood pool (Khurram et al. 2014; 1.2 and 1.32 are common), mean plus k
standard deviations of the blood pool (2 and 3 are common), absolute values. For voltage, classes lie below the
thresholds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .blood_pool import BloodPool
from .errors import LAFlatteningError

RULES = ("iir", "sd", "value")
DIRECTIONS = ("above", "below")
LOW_VOLTAGE_MV = (0.5, 0.1)
"""Common thresholds of bipolar voltage, mV: below the first it is low, below the second scar."""


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
