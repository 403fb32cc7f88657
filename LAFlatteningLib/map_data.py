"""A map with its data, as analyses read it: just made, or read back from its file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from .cavity.openings import SIZE_LIMITS_MM, guess_unit
from .errors import SurfaceError, TemplateError
from .flattening.flat_map import POSITION_ARRAY, FlatMap
from .operators import signed_areas
from .scalar_arrays import scalar_array
from .surface import Array, FloatArray, IntArray, Surface
from .template import Template, builtin_templates
from .views import PatientFrame

DIAMETER_FIELD = "map_diameter_mm"
"""Field array of maps that the Slicer module has exported: how wide they are, in mm."""
OFF_RIM = 0.1
"""A rim farther off its outline than this share of the map's radius, in the mean, is not that of the opening."""


@dataclass(frozen=True, eq=False)
class MapData:
    """The places of an atrium's points on its map, and the data at them.

    Attributes
    ----------
    surface : the cavity in 3D, mm, with its arrays and the triangles of the map.
    flat : (n, 2) places of its points on the map, map units.
    template : the layout of the map.
    method : by which the map was made; empty where its file does not say.
    seeds : seed -> (3,) where it was used, mm, in the axes of the surface; empty where the file does not say.
    """

    surface: Surface
    flat: FloatArray
    template: Template
    method: str = ""
    seeds: Mapping[str, FloatArray] = field(default_factory=dict)

    @classmethod
    def of(cls, flat_map: FlatMap | Surface | MapData, template: Template | str | Path | None = None) -> MapData:
        """The data of a `FlatMap`, or of the surface that a map file holds.

        Parameters
        ----------
        template : for map files only: by default the built-in one that the file names. If given, it has to have the
            name that the file says, where it says one.

        Raises
        ------
        SurfaceError : a surface that is no map, or not one on its template; a map file without the positions on the
            atrium in mm.
        TemplateError : the template of a map file is not known, or another one.
        """
        if isinstance(flat_map, MapData):
            return flat_map
        if isinstance(flat_map, FlatMap):
            return cls(flat_map.surface, flat_map.points, flat_map.template, flat_map.method, flat_map.seeds.positions)
        if np.ptp(flat_map.points[:, 2]) > 0.0:
            raise SurfaceError(
                "The surface is not flat. Expected a map as la-flatten flatten writes it (all points at z = 0); "
                "flatten the atrium first."
            )
        position = flat_map.point_data.get(POSITION_ARRAY)
        if position is None or position.shape != flat_map.points.shape:
            raise SurfaceError(
                f'The map has no point array "{POSITION_ARRAY}" of 3 components, by which lengths on the atrium are '
                "measured. Make the map again with this version."
            )
        space = flat_map.field_data.get("seed_space", flat_map.space)
        layout = _template(flat_map, template)
        data = cls(
            replace(flat_map, points=np.asarray(position, np.float64), space=_text(space)),
            _in_map_units(flat_map, layout),
            layout,
            _text(flat_map.field_data.get("method", "")),
            seeds_in(flat_map.field_data),
        )
        data._check()
        return data

    def rims(self) -> dict[str, IntArray]:
        """Opening -> its rim, point ids.

        Raises
        ------
        SurfaceError : the map has no rim where its template puts an opening.
        """
        loops, rims = self.surface.boundary_loops, {}
        for opening in self.template.anatomy.openings:
            shape = self.template.rim(opening).shape
            off = [float(shape.distance(self.flat[loop]).mean()) for loop in loops] or [np.inf]
            if min(off) > OFF_RIM * self.template.radius:
                raise SurfaceError(
                    f"The map has no opening where the template {self.template.name} puts {opening}. Check that the "
                    "map was made on this template, and that its points were not moved or scaled since."
                )
            rims[opening] = loops[int(np.argmin(off))]
        return rims

    def _check(self) -> None:
        """Raise SurfaceError for what cannot be a map on its template, as after edits in other programs."""
        # (Maps for study may leave rims where they fall, see `flattening.strategies`.)
        if "strategy" not in self.method:
            self.rims()
        if signed_areas(self.flat, self.triangles).sum() <= 0.0:
            raise SurfaceError("The map is mirrored: its triangles turn clockwise. Make the map again from the atrium.")
        size = float(np.linalg.norm(np.ptp(self.surface.points, axis=0)))
        unit = guess_unit(size)
        if unit is None or unit[0] != "mm":
            raise SurfaceError(
                f'By its positions ("{POSITION_ARRAY}", expected in mm) the atrium of the map is {size:.3g} mm across, '
                f"expected {SIZE_LIMITS_MM[0]:g} to {SIZE_LIMITS_MM[1]:g} mm. Make the map again from an atrium in mm."
            )

    @cached_property
    def frame(self) -> PatientFrame:
        """The patient's directions; estimated where the axes of the surface are not known, or contradicted."""
        return PatientFrame.of(self.surface, self.seeds, self.template.anatomy)

    @property
    def triangles(self) -> IntArray:
        """(m, 3) point ids."""
        return self.surface.triangles

    def point_values(self, array: str) -> FloatArray:
        """The values of a scalar array at the points, (n,), NaN where there is none (infinite ones too); cell arrays
        are spread by area.

        Raises
        ------
        LAFlatteningError : no such array, or not one of single numbers.
        """
        values, on_points = scalar_array(self.surface, array)
        return values if on_points else self._spread(values)

    def _spread(self, values: FloatArray) -> FloatArray:
        """Means of the known values of the triangles round each point."""
        weight = np.where(np.isfinite(values), self.surface.triangle_areas, 0.0)
        corner, count = self.triangles.reshape(-1), len(self.flat)
        total = np.bincount(corner, np.repeat(weight * np.nan_to_num(values), 3), minlength=count)
        with np.errstate(divide="ignore", invalid="ignore"):
            return total / np.bincount(corner, np.repeat(weight, 3), minlength=count)


def seeds_in(field_data: Mapping[str, Array]) -> dict[str, FloatArray]:
    """The seeds that the field data of a map hold, seed -> (3,) mm on the atrium; none where they do not fit."""
    labels = np.asarray(field_data.get("seed_labels", ()), dtype=object).reshape(-1)
    places = np.asarray(field_data.get("seed_positions_mm", ()), np.float64)
    if places.shape != (len(labels), 3):
        return {}
    return dict(zip(map(str, labels), places, strict=True))


def _in_map_units(flat_map: Surface, template: Template) -> FloatArray:
    """The places on the map; files of the Slicer module have them in mm, with the centre of the map at the origin."""
    flat = flat_map.points[:, :2]
    if DIAMETER_FIELD not in flat_map.field_data:
        return flat
    diameter = float(np.asarray(flat_map.field_data[DIAMETER_FIELD]).reshape(-1)[0])
    if not (np.isfinite(diameter) and diameter > 0.0):
        raise SurfaceError(f'The map says in "{DIAMETER_FIELD}" that it is {diameter:g} mm wide. Export it again.')
    return flat * (2.0 * template.radius / diameter) + np.asarray(template.outer.shape.centre)


def _text(value: object) -> str:
    return str(np.asarray(value, dtype=object).reshape(-1)[0])


def _template(surface: Surface, given: Template | str | Path | None) -> Template:
    """The template given, or the one that a map file names."""
    name = _text(surface.field_data["template"]) if "template" in surface.field_data else ""
    if given is not None:
        template = given if isinstance(given, Template) else Template.load(given)
        if name and template.name != name:
            raise TemplateError(
                f'The map was made on the template "{name}", and {template.name} was given: its places would be taken '
                f"for others. Give {name}, or flatten again on {template.name}."
            )
        return template
    if name not in builtin_templates():
        raise TemplateError(
            f'The map was made on the template "{name}", which is not a built-in one: give its file as the template '
            "(--template FILE)."
            if name
            else "The map does not say on which template it was made: give the template (--template)."
        )
    return Template.load(name)
