"""Units of the quantities that electroanatomical maps hold."""

from __future__ import annotations

UNITS = {
    "LAT": "ms",
    "Bipolar": "mV",
    "Unipolar": "mV",
    "Impedance": "Ohm",
    "Force": "g",
}
"""Array name -> unit; the readers of electroanatomical maps give these names, whatever the file calls them."""


def unit_of(name: str) -> str:
    """The unit of a point array by its name, in upper or lower case; empty where it is not known.

    Examples
    --------
    >>> unit_of("bipolar"), unit_of("scar")
    ('mV', '')
    """
    return {known.lower(): unit for known, unit in UNITS.items()}.get(name.strip().lower(), "")
