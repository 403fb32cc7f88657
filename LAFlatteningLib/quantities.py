"""Units of the quantities that electroanatomical maps hold."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

KNOWN_UNITS = {
    r".*(bipolar|unipolar|voltage).*": "mV",
    r"lat|.*activation.?time.*": "ms",
    r"impedance": "Ohm",
    r"(contact.?)?force": "g",
}
"""Pattern of an array's name -> unit. The readers of electroanatomical maps give the names Bipolar, Unipolar, LAT,
Impedance and Force, whatever the file calls them; other programs call them otherwise."""
NO_VALUE = -10000.0
"""What CARTO exports where nothing was measured, and readers of other programs keep."""


def unit_of(name: str) -> str:
    """The unit of an array by its name, in upper or lower case; empty where it is not known.

    Examples
    --------
    >>> unit_of("bipolar"), unit_of("Bipolar voltage"), unit_of("scar")
    ('mV', 'mV', '')
    """
    units = (unit for pattern, unit in KNOWN_UNITS.items() if re.fullmatch(pattern, name.strip(), re.IGNORECASE))
    return next(units, "")


def is_voltage(name: str) -> bool:
    """Whether an array holds voltages, of which low ones are diseased."""
    return unit_of(name) == "mV"


def bipolar_array(names: Iterable[str]) -> str | None:
    """The one of several arrays that holds bipolar voltages by its name; None without one, or where several may be it.

    Examples
    --------
    >>> bipolar_array(["LAT", "Unipolar", "Bipolar"]), bipolar_array(["Voltage (mV)"]), bipolar_array(["LGE"])
    ('Bipolar', 'Voltage (mV)', None)
    """
    voltages = [name for name in names if is_voltage(name) and "unipolar" not in name.lower()]
    found = [name for name in voltages if "bipolar" in name.lower()] or voltages
    return found[0] if len(found) == 1 else None


def diseased_side(name: str) -> str:
    """On which side of a threshold the values of an array are diseased, by its name: "below" for voltages, "above" for
    everything else.

    Examples
    --------
    >>> diseased_side("Bipolar"), diseased_side("LGE")
    ('below', 'above')
    """
    return "below" if is_voltage(name) else "above"


def readable(value: float) -> str:
    """A number for people: four digits, all of those before the point, and no exponent where it can be helped.

    Examples
    --------
    >>> readable(3.69103), readable(12345.6), readable(120.0), readable(0.00012)
    ('3.691', '12346', '120', '0.00012')
    """
    return f"{value:.0f}" if 1e4 <= abs(value) < 1e7 else f"{value:.4g}"


def measured(values: NDArray) -> NDArray[np.float64]:
    """Values as float64, NaN where nothing was measured."""
    values = np.asarray(values, np.float64)
    return np.where(np.isfinite(values) & (values != NO_VALUE), values, np.nan)
