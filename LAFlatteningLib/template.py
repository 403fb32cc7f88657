"""Where openings, paths and regions lie on the 2D map.

A template is a JSON file (``templates/*.json``, checked against ``templates/schema.json``) that gives each
opening of an anatomy a shape in the plane and each path the angle at which it meets that shape. Paths are
straight segments between those feet.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .anatomy import ANATOMIES, Anatomy
from .errors import TemplateError
from .files import atomic_write
from .schema import load_json, validate
from .shapes import Cornered, FloatArray, Shape, shape_from_dict

DEFAULT_TEMPLATE = "adapted1"
_FOLDER = Path(__file__).parent / "templates"


@dataclass(frozen=True)
class Rim:
    """An opening on the map: its shape, and the angle (degrees) at which each path meets it."""

    shape: Shape
    feet: Mapping[str, float]
    spread_feet: bool = False

    def arcs(self, order: tuple[str, ...]) -> list[tuple[float, float]]:
        """Start and end angle of each arc between consecutive feet, increasing, once round.

        Parameters
        ----------
        order : the paths counter-clockwise round the rim; arc k goes from foot k to foot k + 1.
        """
        angles = [self.feet[path] for path in order]
        arcs = []
        for k, start in enumerate(angles):
            turn = (angles[(k + 1) % len(angles)] - start) % 360.0
            arcs.append((start, start + (turn if turn > 0 else 360.0)))
        return arcs

    def shares(self, order: tuple[str, ...]) -> FloatArray:
        """The share of the outline's length in each arc, summing to 1."""
        lengths = np.array([self.shape.arc_length(a, b) for a, b in self.arcs(order)])
        return lengths / lengths.sum()


@dataclass(frozen=True)
class Template:
    """The layout of a map. Lengths are in map units; the built-in disks have radius 0.5.

    Attributes
    ----------
    anatomy : what is laid out.
    outer : rim of the map.
    holes : opening -> its rim.
    landmarks : landmark -> its place on the map.
    """

    name: str
    anatomy: Anatomy
    outer: Rim
    holes: Mapping[str, Rim]
    title: str = ""
    source: str = ""
    landmarks: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _check(self)

    @property
    def radius(self) -> float:
        """Half the largest extent of the map; errors and displacements are quoted in this unit ("disk radii")."""
        return max(self.outer.shape.semi_axes)

    def rim(self, opening: str) -> Rim:
        """The rim of any opening, the outer one included."""
        return self.outer if opening == self.anatomy.outer else self.holes[opening]

    def foot(self, path: str, end: int) -> FloatArray:
        """Where a path starts (`end` = 0) or ends (1) on the map, (2,)."""
        opening = self.anatomy.opening_of(self.anatomy.paths[path][end])
        if opening in self.landmarks:
            return np.array(self.landmarks[opening], dtype=np.float64)
        rim = self.rim(opening)
        return rim.shape.at(rim.feet[path])

    def segment(self, path: str) -> FloatArray:
        """Both ends of a path on the map, (2, 2)."""
        return np.stack([self.foot(path, 0), self.foot(path, 1)])

    def region_outline(self, region: int, step: float = 3.0) -> FloatArray:
        """Closed polygon round a region, (k, 2), arcs sampled every `step` degrees."""
        outline = []
        face = self.anatomy.face(region)
        for (path, end), (after, _) in zip(face, face[1:] + face[:1], strict=True):
            outline.append(self.segment(path)[[end, 1 - end]])
            opening = self.anatomy.opening_of(self.anatomy.paths[path][1 - end])
            if opening in self.landmarks:
                continue
            order, rim = self.anatomy.feet(opening), self.rim(opening)
            arcs = rim.arcs(order)
            # With the region on the left, a hole is walked round clockwise, the outer rim counter-clockwise.
            start, stop = arcs[order.index(path)] if opening == self.anatomy.outer else arcs[order.index(after)][::-1]
            count = max(2, int(abs(stop - start) / step))
            outline.append(rim.shape.at(rim.shape.angles_between(start, stop, count)))
        return np.concatenate(outline)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Template:
        """Build a template from a template file's content.

        Raises
        ------
        TemplateError : naming the field that breaks the schema, or what is impossible about the layout.
        """
        validate(data, template_schema())
        if isinstance(data["anatomy"], str):
            if data["anatomy"] not in ANATOMIES:
                raise TemplateError(
                    f"anatomy: expected the name of a built-in anatomy ({', '.join(ANATOMIES)}) or an anatomy object, "
                    f'found "{data["anatomy"]}".'
                )
            anatomy = ANATOMIES[data["anatomy"]]
        else:
            anatomy = Anatomy.from_dict(data["anatomy"])
        return cls(
            data["name"],
            anatomy,
            _rim(data["outer"], "outer", False),
            {
                name: _rim(rim, f"holes.{name}", bool(rim.get("spread_feet", True)))
                for name, rim in data["holes"].items()
            },
            data.get("title", ""),
            data.get("source", ""),
            {name: (float(place[0]), float(place[1])) for name, place in data.get("landmarks", {}).items()},
        )

    def to_dict(self) -> dict[str, Any]:
        """The content of a template file; `from_dict` makes the same template of it."""
        anatomy = self.anatomy
        built_in = ANATOMIES.get(anatomy.name) == anatomy
        data: dict[str, Any] = {"schema": template_schema()["$id"], "name": self.name}
        data.update({key: text for key, text in (("title", self.title), ("source", self.source)) if text})
        data["anatomy"] = anatomy.name if built_in else anatomy.to_dict()
        data["outer"] = {"shape": self.outer.shape.to_dict(), "feet": dict(self.outer.feet)}
        data["holes"] = {
            name: {"shape": rim.shape.to_dict(), "feet": dict(rim.feet), "spread_feet": rim.spread_feet}
            for name, rim in self.holes.items()
        }
        if self.landmarks:
            data["landmarks"] = {name: list(place) for name, place in self.landmarks.items()}
        return data

    def save(self, path: str | Path) -> None:
        """Write a template file (JSON), to be loaded with `load`.

        Raises
        ------
        TemplateError : the name is that of a built-in template, or has letters that a template file may not have.
        InputFileError : the file cannot be written.
        """
        validate(self.to_dict(), template_schema())
        if self.name in builtin_templates():
            raise TemplateError(
                f'name: "{self.name}" is the name of a built-in template, so that maps on this one would be taken for '
                "maps on that one. Give it another name."
            )
        with atomic_write(path) as temporary:
            temporary.write_text(json.dumps(self.to_dict(), indent=2, ensure_ascii=False) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, name_or_path: str | Path) -> Template:
        """A built-in template by name (see `builtin_templates`) or one from a JSON file."""
        if str(name_or_path) in builtin_templates():
            return _builtin(str(name_or_path))
        path = Path(name_or_path)
        if not path.suffix and not path.exists():
            raise TemplateError(
                f'There is no template "{name_or_path}". Expected one of {", ".join(builtin_templates())}, '
                "or the path of a template file (.json)."
            )
        template = cls.from_dict(load_json(path))
        if template.name in builtin_templates() and template != _builtin(template.name):
            raise TemplateError(
                f'name: "{template.name}" is the name of a built-in template with another layout than "{path}", so '
                "that maps would be mistaken for each other. Give it another name."
            )
        return template


@cache
def template_schema() -> dict[str, Any]:
    """The published JSON schema of template files."""
    schema: dict[str, Any] = json.loads((_FOLDER / "schema.json").read_text(encoding="utf-8"))
    return schema


@cache
def builtin_templates(anatomy: str | None = None) -> tuple[str, ...]:
    """Names of the templates that come with the library: all of them, or those of one anatomy ("left_atrium")."""
    names = tuple(sorted(path.stem for path in _FOLDER.glob("*.json") if path.stem != "schema"))
    return names if anatomy is None else tuple(name for name in names if _builtin(name).anatomy.name == anatomy)


@cache
def _builtin(name: str) -> Template:
    return Template.from_dict(load_json(_FOLDER / f"{name}.json"))


def _rim(data: Mapping[str, Any], field: str, spread_feet: bool) -> Rim:
    try:
        shape = shape_from_dict(data["shape"])
    except TemplateError as error:
        raise TemplateError(f"{field}.{error}") from None
    return Rim(shape, {path: float(angle) for path, angle in data["feet"].items()}, spread_feet)


def _check(template: Template) -> None:
    """Raise TemplateError where the layout is impossible, naming the field."""
    anatomy = template.anatomy
    for hole in anatomy.holes:
        if hole not in template.holes:
            raise TemplateError(f"holes.{hole}: missing; {anatomy.name} has the holes {', '.join(anatomy.holes)}.")
    for hole in template.holes:
        if hole not in anatomy.holes:
            raise TemplateError(f"holes.{hole}: unknown opening; {anatomy.name} has {', '.join(anatomy.holes)}.")
    for name in anatomy.landmarks:
        if name not in template.landmarks:
            raise TemplateError(f"landmarks.{name}: missing; expected its place on the map, [x, y].")
    for name in template.landmarks:
        if name not in anatomy.landmarks:
            known = ", ".join(anatomy.landmarks) or "none"
            raise TemplateError(f"landmarks.{name}: unknown landmark; {anatomy.name} has {known}.")
    for opening in anatomy.openings:
        where = "outer" if opening == anatomy.outer else f"holes.{opening}"
        rim, order = template.rim(opening), anatomy.feet(opening)
        if set(rim.feet) != set(order):
            raise TemplateError(
                f"{where}.feet: expected an angle for each of {', '.join(order)}, "
                f"found {', '.join(rim.feet) or 'none'}."
            )
        total = sum(end - start for start, end in rim.arcs(order))
        if order and not np.isclose(total, 360.0):
            raise TemplateError(
                f"{where}.feet: angles out of order; counter-clockwise expected {', '.join(order)}, found "
                f"{', '.join(sorted(order, key=lambda path: rim.feet[path] % 360))}."
            )
    for hole in anatomy.holes:
        if isinstance(template.holes[hole].shape, Cornered):
            raise TemplateError(f"holes.{hole}.shape: expected a circle or an ellipse; only the outer rim has corners.")
    shapes = {hole: template.holes[hole].shape for hole in anatomy.holes}
    outlines, outer = {hole: shape.outline() for hole, shape in shapes.items()}, template.outer.shape
    for hole, outline in outlines.items():
        if not outer.contains(outline).all():
            raise TemplateError(
                f"holes.{hole}.shape: reaches beyond the outer rim; move it inwards or make it smaller."
            )
    for a, b in combinations(anatomy.holes, 2):
        if shapes[b].contains(outlines[a]).any() or shapes[a].contains(outlines[b]).any():
            raise TemplateError(f"holes.{a}.shape: overlaps holes.{b}.shape; move them apart or make them smaller.")
    for name, place in template.landmarks.items():
        if not outer.contains(np.array([place])).all():
            raise TemplateError(f"landmarks.{name}: lies beyond the outer rim; move it inwards.")
        for hole, shape in shapes.items():
            if shape.contains(np.array([place])).any():
                raise TemplateError(f"landmarks.{name}: lies in the hole {hole}; move it out.")
    segments = {path: template.segment(path) for path in anatomy.paths}
    for path, (start, end) in segments.items():
        inner = start + np.linspace(0.001, 0.999, 200)[:, None] * (end - start)
        for hole in anatomy.holes:
            if shapes[hole].contains(inner).any():
                raise TemplateError(f"path {path} crosses the hole {hole}; change the angles of its feet.")
        if not outer.contains(inner).all():
            raise TemplateError(f"path {path} leaves the map; change the angles of its feet.")
    for name in anatomy.landmarks:
        _check_order(template, name, segments)
    for a, b in combinations(segments, 2):
        if _cross(segments[a], segments[b]):
            raise TemplateError(f"paths {a} and {b} cross; change the angles of their feet.")


def _check_order(template: Template, landmark: str, segments: Mapping[str, FloatArray]) -> None:
    """Raise TemplateError where the paths do not leave a landmark in the order of the anatomy."""
    order = template.anatomy.feet(landmark)
    heading = {}
    for path in order:
        start, end = segments[path] if template.anatomy.paths[path][0] == landmark else segments[path][::-1]
        heading[path] = float(np.rad2deg(np.arctan2(*(end - start)[::-1])) % 360.0)
    turns = [(heading[b] - heading[a]) % 360.0 for a, b in zip(order, order[1:] + order[:1], strict=True)]
    if len(order) > 1 and not (min(turns) > 0.0 and np.isclose(sum(turns), 360.0)):
        raise TemplateError(
            f"landmarks.{landmark}: its paths leave it out of order; counter-clockwise expected {', '.join(order)}, "
            f"found {', '.join(sorted(order, key=lambda path: heading[path]))}."
        )


def inside_polygon(points: FloatArray, polygon: FloatArray) -> NDArray[np.bool_]:
    """Whether points (k, 2) are inside a polygon (p, 2): crossing number."""
    inside = np.zeros(len(points), bool)
    # Edge by edge, and of the points in its box only: all at once is a large table, of which little is needed.
    near = np.flatnonzero(((points >= polygon.min(axis=0)) & (points <= polygon.max(axis=0))).all(axis=1))
    x, y = points[near, 0].copy(), points[near, 1].copy()
    odd = np.zeros(len(near), bool)
    for (x0, y0), (x1, y1) in zip(polygon.tolist(), np.roll(polygon, -1, axis=0).tolist(), strict=True):
        spans = np.flatnonzero((y0 > y) != (y1 > y))
        odd[spans] ^= x[spans] < x0 + (y[spans] - y0) / (y1 - y0) * (x1 - x0) if len(spans) else False
    inside[near] = odd
    return inside


def _cross(a: FloatArray, b: FloatArray) -> bool:
    """Whether two segments (2, 2) properly cross."""

    def side(p: FloatArray, q: FloatArray, r: FloatArray) -> float:
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    return side(a[0], a[1], b[0]) * side(a[0], a[1], b[1]) < 0 and side(b[0], b[1], a[0]) * side(b[0], b[1], a[1]) < 0
