"""Sub-regions drawn on the map, and so carried to any atrium.

A parcellation is a JSON file (``parcellations/*.json``, checked against ``parcellations/schema.json``). Its parts are
drawn relative to the holes, paths and regions of a template, so that they fit every template of their anatomy; a file
with coordinates of its own names the one template that it is drawn on, and is refused on others.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .anatomy import ANATOMIES, Anatomy
from .errors import TemplateError
from .flattening.flat_map import FlatMap
from .map_data import MapData
from .schema import load_json, validate
from .shapes import FloatArray, Shape
from .surface import Surface
from .template import Template, builtin_templates, inside_polygon

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

NO_PART = 0
"""Label of places that belong to no part."""
ON_BORDER = 1e-9
"""Places as near to the border of a part as this share of the map's radius are on it."""
OUTLINED = ("region", "polygon")
"""Kinds of parts that may share a border with others."""
_FOLDER = Path(__file__).parent / "parcellations"


class Labels(NamedTuple):
    """The part that each triangle and each point of a map belongs to, `NO_PART` for none."""

    cells: IntArray
    """(m,) by the centroid of the triangle on the map."""
    points: IntArray
    """(n,)."""


@dataclass(frozen=True)
class Part:
    """A sub-region.

    Attributes
    ----------
    label : its number in arrays, 1 or more.
    name : identifier.
    title : for people.
    area : where it is, as in the file (see Docs/formats.md).
    """

    label: int
    name: str
    title: str
    area: Mapping[str, Any]


@dataclass(frozen=True)
class Parcellation:
    """Sub-regions of a map.

    Attributes
    ----------
    name, title, source : identifier; for people; where the borders come from.
    anatomy : whose openings, paths and regions the areas refer to.
    parts : in the order of the file.
    overlapping : whether parts may share ground. If not, a place belongs to the first part that holds it.
    template : name of the only template on which the parts may be used; "" for every template of the anatomy.

    Raises
    ------
    TemplateError : naming the field at fault.

    Examples
    --------
    >>> from LAFlatteningLib import Template
    >>> segments = Parcellation.load("vein_segments")
    >>> segments.names[3]
    'left anterior carina'
    >>> segments.labels_at(np.array([[-0.35, -0.01]]), Template.load("adapted1")).tolist()
    [3]
    """

    name: str
    anatomy: Anatomy
    parts: tuple[Part, ...]
    title: str = ""
    source: str = ""
    overlapping: bool = False
    template: str = ""

    def __post_init__(self) -> None:
        _check(self)

    @property
    def names(self) -> dict[int, str]:
        """Label -> name."""
        return {part.label: part.name for part in self.parts}

    def part(self, name: str) -> Part:
        """A part by its name.

        Raises
        ------
        TemplateError : there is none.
        """
        for part in self.parts:
            if part.name == name:
                return part
        raise TemplateError(
            f'The parcellation {self.name} has no part "{name}"; found {", ".join(part.name for part in self.parts)}.'
        )

    def check_template(self, template: Template) -> None:
        """Raise TemplateError where the parts do not belong on a template."""
        if self.template and self.template != template.name:
            raise TemplateError(
                f"The parcellation {self.name} is drawn on the template {self.template}, and the map was made on "
                f"{template.name}. Flatten on {self.template}, or take a parcellation for {template.name}."
            )
        if self.anatomy != template.anatomy:
            raise TemplateError(
                f"The parcellation {self.name} belongs to the anatomy {self.anatomy.name}, and the template "
                f"{template.name} to {template.anatomy.name}."
            )

    def contains(self, part: str, places: FloatArray, template: Template) -> BoolArray:
        """Whether places (k, 2) on a map, map units, lie in a part, whatever other parts hold them; (k,).

        Raises
        ------
        TemplateError : no such part, or the parts do not belong on the template.
        """
        self.check_template(template)
        return _contains(self.part(part).area, np.asarray(places, np.float64), template)

    def labels_at(self, places: FloatArray, template: Template, part: str | None = None) -> IntArray:
        """The label of each place (k, 2) on a map, map units; (k,), `NO_PART` for none.

        Parameters
        ----------
        part : label this part only; needed where parts overlap.

        Raises
        ------
        TemplateError : parts overlap and none is named; no such part; the parts do not belong on the template.
        """
        if part is None and self.overlapping:
            raise TemplateError(
                f"The parts of {self.name} overlap, so that a place can be in several. Name one of "
                f"{', '.join(part.name for part in self.parts)}."
            )
        self.check_template(template)
        places = np.asarray(places, np.float64)
        chosen = self.parts if part is None else (self.part(part),)
        labels = np.full(len(places), NO_PART, np.int64)
        for step in (0.0, ON_BORDER * template.radius):
            # Rounding may put a place on the border of two outlines outside both: beside it, it is in one of them.
            left = np.flatnonzero(labels == NO_PART)
            for one in reversed(chosen):
                if not step or one.area["type"] in OUTLINED:
                    inside = _contains(one.area, places[left] + step * np.array([0.8, 0.6]), template)
                    labels[left[inside]] = one.label
        return labels

    def labels_of(self, flat_map: FlatMap | MapData, part: str | None = None) -> Labels:
        """The labels of the triangles and points of a map; parameters and errors as for `labels_at`."""
        data = MapData.of(flat_map)
        centroids = data.flat[data.triangles].mean(axis=1)
        return Labels(self.labels_at(centroids, data.template, part), self.labels_at(data.flat, data.template, part))

    def carry(self, flat_map: FlatMap | MapData, surface: Surface | None = None) -> Surface:
        """A surface with the labels as cell and point arrays.

        The arrays have the name of the parcellation; where parts overlap there is one for each, NAME_PART.

        Parameters
        ----------
        surface : one with the points and triangles of the map, in its order: the atrium (default) or the map itself.
        """
        data = MapData.of(flat_map)
        surface = data.surface if surface is None else surface
        names = (
            {f"{self.name}_{part.name}": part.name for part in self.parts} if self.overlapping else {self.name: None}
        )
        labels = {array: self.labels_of(data, part) for array, part in names.items()}
        return surface.with_data(
            {array: found.points.astype(np.int32) for array, found in labels.items()},
            {array: found.cells.astype(np.int32) for array, found in labels.items()},
        )

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Parcellation:
        """Build one from a file's content.

        Raises
        ------
        TemplateError : naming the field that breaks the schema, or what does not fit the anatomy.
        """
        validate(data, parcellation_schema())
        if data["anatomy"] not in ANATOMIES:
            raise TemplateError(
                f'anatomy: expected the name of a built-in anatomy ({", ".join(ANATOMIES)}), found "{data["anatomy"]}".'
            )
        return cls(
            data["name"],
            ANATOMIES[data["anatomy"]],
            tuple(Part(part["label"], part["name"], part.get("title", ""), part["area"]) for part in data["parts"]),
            data.get("title", ""),
            data.get("source", ""),
            bool(data.get("overlapping", False)),
            data.get("template", ""),
        )

    @classmethod
    def load(cls, name_or_path: str | Path) -> Parcellation:
        """A built-in parcellation by name (see `builtin_parcellations`) or one from a JSON file."""
        if str(name_or_path) in builtin_parcellations():
            return cls.from_dict(load_json(_FOLDER / f"{name_or_path}.json"))
        path = Path(name_or_path)
        if not path.suffix and not path.exists():
            raise TemplateError(
                f'There is no parcellation "{name_or_path}". Expected one of {", ".join(builtin_parcellations())}, '
                "or the path of a parcellation file (.json)."
            )
        return cls.from_dict(load_json(path))


def parcels_of(
    flat_map: FlatMap | MapData, parcellations: Sequence[Parcellation | str | Path]
) -> dict[str, tuple[IntArray, dict[int, str]]]:
    """The parts of parcellations (or their names or files) on a map, as `fibrosis.measure_fibrosis` takes them.

    Returns
    -------
    Name of a group -> label of each triangle (m,), and label -> name. Each part of a parcellation whose parts overlap
    is a group of its own.
    """
    parcels = {}
    for one in parcellations:
        parcellation = one if isinstance(one, Parcellation) else Parcellation.load(one)
        if parcellation.overlapping:
            for part in parcellation.parts:
                labels = parcellation.labels_of(flat_map, part.name).cells
                parcels[f"{parcellation.name}_{part.name}"] = (labels, {part.label: part.name})
        else:
            parcels[parcellation.name] = (parcellation.labels_of(flat_map).cells, parcellation.names)
    return parcels


@cache
def parcellation_schema() -> dict[str, Any]:
    """The published JSON schema of parcellation files."""
    schema: dict[str, Any] = json.loads((_FOLDER / "schema.json").read_text(encoding="utf-8"))
    return schema


@cache
def builtin_parcellations() -> tuple[str, ...]:
    """Names of the parcellations that come with the library."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.json") if path.stem != "schema"))


# ---- areas -----------------------------------------------------------------------------------------------------------


def _contains(area: Mapping[str, Any], places: FloatArray, template: Template) -> BoolArray:
    radius = template.radius
    centre = np.array(template.outer.shape.centre)
    kind = area["type"]
    if kind == "region":
        return inside_polygon(places, _region_polygon(template, area["number"]))
    if kind == "strip":
        return _to_segment(places, template.segment(area["path"])) <= area["half_width"] * radius
    if kind == "polygon":
        return inside_polygon(places, centre + radius * np.array(area["corners"], np.float64))
    shape = _shape_of(area, template)
    c, s = np.cos(np.deg2rad(shape.rotation)), np.sin(np.deg2rad(shape.rotation))
    scaled = ((places - shape.centre) @ np.array([[c, -s], [s, c]])) / shape.semi_axes
    inside = np.hypot(*scaled.T) <= 1.0
    if "sector" in area:
        first, last = area["sector"]
        angle = np.degrees(np.arctan2(scaled[:, 1], scaled[:, 0]))
        inside &= (angle - first) % 360.0 < last - first
    return inside


def _shape_of(area: Mapping[str, Any], template: Template) -> Shape:
    """The ellipse of a round area, map units; the sector's angles parametrise it."""
    radius = template.radius
    if area["type"] == "ring":
        shape = template.holes[area["hole"]].shape
        x, y = shape.semi_axes
        return Shape(shape.centre, (x + area["width"] * radius, y + area["width"] * radius), shape.rotation)
    if area["type"] == "surroundings":
        centre = template.holes[area["hole"]].shape.centre
        others = [
            float(np.linalg.norm(rim.shape.outline() - np.array(centre), axis=1).min())
            for hole, rim in template.holes.items()
            if hole != area["hole"]
        ]
        reach = min(area["radius"] * radius, *others)
        return Shape(centre, (reach, reach))
    if area["type"] == "pair":
        first, second = (np.array(template.holes[hole].shape.centre) for hole in area["holes"])
        middle, along = 0.5 * (first + second), first - second
        length = float(np.linalg.norm(along))
        return Shape(
            (float(middle[0]), float(middle[1])),
            (0.5 * length + area["beyond"] * radius, area["across"] * radius),
            float(np.degrees(np.arctan2(along[1], along[0]))),
        )
    x, y = np.array(template.outer.shape.centre) + radius * np.array(area["centre"], np.float64)
    a, b = area["semi_axes"]
    return Shape((float(x), float(y)), (a * radius, b * radius), float(area.get("rotation_degrees", 0.0)))


def _region_polygon(template: Template, region: int) -> FloatArray:
    """A polygon (k, 2) that holds a region and, beyond the map, its share of the holes and of the outside: the
    polygons of all regions tile the plane, so that no place of the map is in none or in two."""
    anatomy, centre = template.anatomy, np.array(template.outer.shape.centre)
    face = anatomy.face(region)
    corners = []
    for (path, end), (after, start) in zip(face, face[1:] + face[:1], strict=True):
        corners.append(template.segment(path)[[end, 1 - end]])
        opening = anatomy.opening_of(anatomy.paths[path][1 - end])
        if opening == anatomy.outer:
            far = centre + 4.0 * (np.stack([template.foot(path, 1 - end), template.foot(after, start)]) - centre)
            first, last = np.arctan2(*(far - centre).T[::-1])
            turn = first + np.linspace(0.0, 1.0, 9) * ((last - first) % (2.0 * np.pi))
            corners.append(centre + 4.0 * template.radius * np.stack([np.cos(turn), np.sin(turn)], axis=1))
        elif opening in template.holes:
            corners.append(np.array([template.holes[opening].shape.centre]))
    return np.concatenate(corners)


def _to_segment(places: FloatArray, segment: FloatArray) -> FloatArray:
    """Distance of places (k, 2) from a segment (2, 2)."""
    start, along = segment[0], segment[1] - segment[0]
    t = np.clip((places - start) @ along / (along @ along), 0.0, 1.0)
    return np.linalg.norm(places - start - t[:, None] * along, axis=1)


# ---- checks ----------------------------------------------------------------------------------------------------------


def _check(parcellation: Parcellation) -> None:
    """Raise TemplateError where the parts contradict each other or the anatomy, naming the field."""
    anatomy = parcellation.anatomy
    for what in ("label", "name"):
        values = [getattr(part, what) for part in parcellation.parts]
        twice = next((value for value in values if values.count(value) > 1), None)
        if twice is not None:
            second = len(values) - 1 - values[::-1].index(twice)
            raise TemplateError(f'parts[{second}].{what}: "{twice}" is used twice; expected a {what} of its own.')
    known = {"hole": anatomy.holes, "path": tuple(anatomy.paths), "number": tuple(anatomy.regions)}
    for index, part in enumerate(parcellation.parts):
        field, area = f"parts[{index}].area", part.area
        used = [(key, area[key]) for key in known if key in area] + [("hole", hole) for hole in area.get("holes", ())]
        for key, value in used:
            if value not in known[key]:
                raise TemplateError(
                    f'{field}: "{value}" is no {"region" if key == "number" else key} of {anatomy.name}; '
                    f"expected one of {', '.join(map(str, known[key]))}."
                )
        if "sector" in area and not 0.0 < area["sector"][1] - area["sector"][0] <= 360.0:
            raise TemplateError(
                f"{field}.sector: expected first and last angle, the last larger by up to 360 degrees, found "
                f"{area['sector'][0]:g} and {area['sector'][1]:g}."
            )
        if area["type"] in ("ellipse", "polygon") and not parcellation.template:
            raise TemplateError(
                f"{field}: has coordinates of its own, which mean something on one template only. Name it in the "
                f"field template (built-in: {', '.join(builtin_templates())})."
            )
