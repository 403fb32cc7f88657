"""An array of a map, read at the middles of a square grid: the same places on every map of one template."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import operators
from .errors import TemplateError
from .flattening.flat_map import FlatMap
from .map_data import MapData
from .parcellation import Parcellation, Part
from .quantities import unit_of
from .scalar_arrays import corner_values
from .shading import rasterise
from .surface import FloatArray, IntArray, Surface
from .template import Template

GRID = 512
"""Places across the map, in each direction."""


@dataclass(frozen=True, eq=False)
class MapReading:
    """What `read_map` finds.

    Attributes
    ----------
    array : what was read.
    template, method : of the map; the method is empty where a map file does not name it.
    values : (GRID, GRID) linear in each triangle, NaN where the map has no triangle or no value; row 0 at the bottom.
    areas : (GRID, GRID) mm2 on the atrium that a place stands for, NaN where the map has no triangle.
    """

    array: str
    template: Template
    method: str
    values: FloatArray
    areas: FloatArray

    @property
    def covered(self) -> NDArray[np.bool_]:
        """(GRID, GRID) where the map has triangles."""
        return np.isfinite(self.areas)

    @property
    def unit(self) -> str:
        """Of the array, by its name; empty where it is not known."""
        return unit_of(self.array)


def read_map(atrium: FlatMap | MapData | Surface, array: str) -> MapReading:
    """Read a scalar point or cell array of a map at the places of the grid.

    Raises
    ------
    LAFlatteningError : no such array, NaN everywhere.
    SurfaceError : no map, or a map file without the positions on the atrium.
    TemplateError : the template of a map file is not known.
    """
    data = MapData.of(atrium)
    corners = corner_values(data.surface, array)
    left, bottom, pixel = _frame(data.template)
    raster = rasterise(data.flat, data.triangles, left, bottom, pixel, (GRID, GRID))
    with np.errstate(divide="ignore", invalid="ignore"):
        density = data.surface.triangle_areas / operators.triangle_areas(data.flat, data.triangles)
    values, areas = np.full((GRID, GRID), np.nan), np.full((GRID, GRID), np.nan)
    triangle = raster.triangle[raster.covered]
    values[raster.covered] = np.einsum("ij,ij->i", raster.weights, corners[triangle])
    areas[raster.covered] = density[triangle] * pixel**2
    return MapReading(array, data.template, data.method, values, areas)


def places_of(template: Template, row: IntArray, column: IntArray) -> FloatArray:
    """The places (k, 2) of the grid in map units."""
    left, bottom, pixel = _frame(template)
    return np.array([left, bottom]) + (np.stack([column, row], axis=1) + 0.5) * pixel


def regions_at(template: Template, places: FloatArray) -> IntArray:
    """The region of the template at places (k, 2), (k,)."""
    parts = (
        Part(number, f"R{number}", "", {"type": "region", "number": number}) for number in template.anatomy.regions
    )
    return Parcellation("regions", template.anatomy, tuple(parts)).labels_at(places, template)


def check_templates(a: Template, b: Template) -> None:
    """Raise TemplateError for maps of different templates."""
    if a.name != b.name:
        raise TemplateError(
            f"The maps were made on different templates, {a.name} and {b.name}, so that a place on one is another "
            "place on the other. Flatten one of them again, on the template of the other."
        )
    if a != b:
        raise TemplateError(f"The maps were made on different templates that are both called {a.name}. Use one file.")


def method_notes(methods: Sequence[str]) -> list[str]:
    """What the user should know where maps were not made by one method."""
    known = sorted({method for method in methods if method})
    if len(known) < 2:
        return []
    return [
        f"The maps were made by different methods ({' and '.join(known)}), which put the same anatomy into "
        "different places within the regions: part of the difference is theirs. Flatten all by one method."
    ]


def _frame(template: Template) -> tuple[float, float, float]:
    """Left and bottom of the grid, and the side of a place, map units."""
    radius = template.radius
    left, bottom = (float(x) - radius for x in template.outer.shape.centre)
    return left, bottom, 2.0 * radius / GRID
