"""The axes in which programs write coordinates, and how to bring a surface into the patient's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .errors import SurfaceError
from .surface import FloatArray, Surface

AXES = ("LPS", "RAS", "CARTO")
"""To the left, back and head; to the right, front and head; CARTO 3, and exports of it: to the left, the head and the
front."""


def lps_from_carto(points: FloatArray) -> FloatArray:
    """Coordinates (n, 3) of CARTO, mm (x to the left, y up, z to the front), in LPS."""
    return np.stack([points[:, 0], -points[:, 2], points[:, 1]], axis=1)


def with_axes(surface: Surface, axes: str) -> tuple[Surface, list[str]]:
    """A surface whose coordinates are in the axes that are named, whatever its file says; and notes.

    Coordinates in LPS and RAS stay as they are; those of CARTO are turned to LPS. Arrays of vectors would point
    elsewhere and are left out then.

    Raises
    ------
    SurfaceError : axes that are not known.

    Examples
    --------
    >>> point = Surface(np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), np.array([[0, 1, 2]]))
    >>> with_axes(point, "CARTO")[0].points[0].tolist()
    [1.0, -3.0, 2.0]
    """
    axes = axes.upper()
    if axes not in AXES:
        raise SurfaceError(f'Expected axes out of {", ".join(AXES)}, found "{axes}".')
    if axes != "CARTO":
        return surface.with_space(axes), []
    kept, left_out = [], []
    for arrays in (surface.point_data, surface.cell_data):
        vectors = {name for name, array in arrays.items() if np.ndim(array) == 2 and np.shape(array)[1] == 3}
        kept.append({name: array for name, array in arrays.items() if name not in vectors})
        left_out += sorted(vectors)
    notes = ["The coordinates were turned from the axes of CARTO to LPS."]
    if left_out:
        notes.append(f"Arrays of vectors were left out, which would not be turned with it: {', '.join(left_out)}.")
    return (
        replace(
            surface.with_space("LPS"), points=lps_from_carto(surface.points), point_data=kept[0], cell_data=kept[1]
        ),
        notes,
    )
