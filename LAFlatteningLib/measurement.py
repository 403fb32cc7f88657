"""Sizes of an atrium: perimeters of its openings, lengths between them, and their ratios (the paper's appendix B)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ._version import __version__
from .anatomy import LEFT_ATRIUM, REFERENCES, Anatomy
from .cavity.openings import make_cavity
from .errors import InputFileError, SurfaceError
from .ostium_ways import WaysAcrossOstia
from .rim_length import rim_perimeter
from .schema import load_json
from .seed_paths import connect_seeds
from .seeds import check_labels, snap_seeds
from .surface import FloatArray, Surface

SCHEMA = "laflattening-measurement/1"


@dataclass(frozen=True)
class Measurement:
    """Sizes of one atrium.

    Attributes
    ----------
    anatomy : its name.
    perimeters_mm : opening -> length of its rim, without the saw that cutting leaves (`rim_length.rim_perimeter`).
    paths_mm : path -> length between the rims of its two openings of the geodesic line between its seeds. (On the outer
        rim it ends at its seed.)
    area_cm2 : of the cavity.
    notes : what is unusual about the seeds.
    """

    anatomy: str
    perimeters_mm: Mapping[str, float]
    paths_mm: Mapping[str, float]
    area_cm2: float
    notes: tuple[str, ...] = ()

    @property
    def perimeter_ratios(self) -> dict[str, float]:
        """Opening -> perimeter over that of the reference opening; empty for an anatomy without one."""
        return self._ratios(self.perimeters_mm, 0)

    @property
    def path_ratios(self) -> dict[str, float]:
        """Path -> length over that of the reference path; empty for an anatomy without one."""
        return self._ratios(self.paths_mm, 1)

    def _ratios(self, sizes: Mapping[str, float], which: int) -> dict[str, float]:
        if self.anatomy not in REFERENCES:
            return {}
        reference = sizes[REFERENCES[self.anatomy][which]]
        return {name: size / reference for name, size in sizes.items()}

    def to_dict(self) -> dict[str, Any]:
        """For JSON (see Docs/formats.md)."""
        return {
            "schema": SCHEMA,
            "version": __version__,
            "anatomy": self.anatomy,
            "perimeters_mm": dict(self.perimeters_mm),
            "perimeter_ratios": self.perimeter_ratios,
            "paths_mm": dict(self.paths_mm),
            "path_ratios": self.path_ratios,
            "area_cm2": self.area_cm2,
            "notes": list(self.notes),
        }


def measure(
    surface: Surface,
    seeds: Mapping[str, FloatArray],
    anatomy: Anatomy = LEFT_ATRIUM,
    check_axes: bool = True,
) -> Measurement:
    """Measure an atrium that is open at its openings.

    Parameters
    ----------
    surface, seeds, check_axes : as for `flattening.Flattener`; mm.

    Raises
    ------
    SurfaceError, SeedError : as `flattening.Flattener.flatten`.

    Examples
    --------
    >>> from LAFlatteningLib.phantom import make_phantom
    >>> phantom = make_phantom(2000)
    >>> round(measure(phantom.surface, phantom.seeds).area_cm2)
    96
    """
    seeds = check_labels(seeds, anatomy)
    cavity = make_cavity(surface, anatomy, np.array([seeds[label] for label in anatomy.outer_seeds]))
    ways = WaysAcrossOstia(cavity)
    connected = connect_seeds(cavity, snap_seeds(seeds, cavity, anatomy), anatomy, ways, check_axes)
    points = cavity.surface.points
    lengths = {}
    for name, walk in connected.walks.items():
        if walk.line is None:
            raise SurfaceError(f"No path {name} over the open cavity: it is not connected.")
        lengths[name] = float(walk.line.length(points))
    return Measurement(
        anatomy.name,
        {opening: rim_perimeter(points[connected.loops[opening]]) for opening in anatomy.openings},
        {name: lengths[name] for name in anatomy.paths},
        cavity.surface.area / 100.0,
        connected.notes,
    )


def read_measurement(path: Path | str) -> Measurement:
    """Read a file of `la-flatten measure`.

    Raises
    ------
    InputFileError : not such a file, or of another version of its format.
    """
    data = load_json(Path(path))
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        found = data.get("schema") if isinstance(data, dict) else None
        raise InputFileError(
            f'{path}: expected a measurement (schema "{SCHEMA}") as la-flatten measure writes it, found '
            f"{found or 'none'}."
        )
    for group in ("perimeters_mm", "paths_mm"):
        sizes = data.get(group)
        if not isinstance(sizes, dict) or not all(
            isinstance(size, (int, float)) and not isinstance(size, bool) and 0.0 < size < np.inf
            for size in sizes.values()
        ):
            raise InputFileError(f"{path}: expected {group} with lengths above 0 mm, found {sizes!r:.60}.")
    return Measurement(
        str(data.get("anatomy")),
        data["perimeters_mm"],
        data["paths_mm"],
        float(data.get("area_cm2", np.nan)),
        tuple(data.get("notes", ())),
    )
