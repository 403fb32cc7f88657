"""The names and the topology of a flattening, as data.

An `Anatomy` says which openings a chamber has, which seeds mark them, which paths join the seeds, in which
order the paths leave each opening, and which paths bound each region. The algorithms loop over this table
and name no vein. Where things lie in the plane is said by a `LAFlatteningLib.template.Template`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from .errors import TemplateError


@dataclass(frozen=True)
class Anatomy:
    """A division of a chamber into regions by paths between seeds.

    Attributes
    ----------
    name : identifier.
    openings : opening -> its full name. The one called `outer` becomes the outer rim of the map, the others
        are holes; each hole is marked by a seed of the same name at its centre.
    outer : the opening on the outer rim.
    outer_seeds : seeds on the outer rim, seed -> full name, in counter-clockwise order on the map.
    paths : path -> the two seeds that it joins.
    rims : hole -> the paths that leave it, in counter-clockwise order on the map, seen from outside the
        chamber. The foot of the first path stays where it is when feet are spread more evenly.
    regions : region number -> the paths that bound it.
    region_names : region number -> what a clinician calls it.
    directions : "left", "superior", "anterior" -> pairs of groups of holes, the first of which lies on that side
        of the second in every patient. Empty where the anatomy says nothing about it.
    layout : opening -> the mean direction in which it lies from the middle of the chamber's body, LPS. Empty where it
        is not known; openings are then not recognised by themselves.
    appendages : holes that are blind pouches; the others are vessels.
    landmarks : seeds that are points of the wall, such as the apex of a ventricle, seed -> full name. Paths leave them
        in the order of `rims`, as they leave a hole.
    """

    name: str
    openings: Mapping[str, str]
    outer: str
    outer_seeds: Mapping[str, str]
    paths: Mapping[str, tuple[str, str]]
    rims: Mapping[str, tuple[str, ...]]
    regions: Mapping[int, tuple[str, ...]]
    region_names: Mapping[int, str]
    directions: Mapping[str, tuple[tuple[tuple[str, ...], tuple[str, ...]], ...]] = field(default_factory=dict)
    layout: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    appendages: tuple[str, ...] = ()
    landmarks: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _check(self)

    @property
    def holes(self) -> tuple[str, ...]:
        """The openings that become holes in the map, in the order of the table."""
        return tuple(name for name in self.openings if name != self.outer)

    @property
    def seeds(self) -> tuple[str, ...]:
        """All seed labels: the holes, the landmarks, then the seeds on the outer rim."""
        return (*self.holes, *self.landmarks, *sorted(self.outer_seeds))

    @property
    def outer_paths(self) -> tuple[str, ...]:
        """The paths that end on the outer rim, in the order of `outer_seeds`."""
        ends = {seed: path for path, pair in self.paths.items() for seed in pair if seed in self.outer_seeds}
        return tuple(ends[seed] for seed in self.outer_seeds)

    def feet(self, opening: str) -> tuple[str, ...]:
        """The paths with a foot on the rim of an opening, or at a landmark, counter-clockwise on the map."""
        return self.outer_paths if opening == self.outer else tuple(self.rims[opening])

    def opening_of(self, seed: str) -> str:
        """The opening that a seed marks or lies on; a landmark is where it is itself."""
        return self.outer if seed in self.outer_seeds else seed

    def face(self, region: int) -> list[Dart]:
        """The paths round a region in the order in which they follow each other, region on the left."""
        return next(face for face in trace_faces(self) if {path for path, _ in face} == set(self.regions[region]))

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Anatomy:
        """Build one from the ``anatomy`` object of a template file, already checked against its schema.

        Raises
        ------
        TemplateError : if paths, rims and regions do not fit together.
        """
        return cls(
            data["name"],
            dict(data["openings"]),
            data["outer"],
            dict(data["outer_seeds"]),
            {name: (pair[0], pair[1]) for name, pair in data["paths"].items()},
            {name: tuple(paths) for name, paths in data["rims"].items()},
            {int(number): tuple(paths) for number, paths in data["regions"].items()},
            {int(number): name for number, name in data["region_names"].items()},
            {
                side: tuple((tuple(first), tuple(second)) for first, second in pairs)
                for side, pairs in data.get("directions", {}).items()
            },
            {opening: (at[0], at[1], at[2]) for opening, at in data.get("layout", {}).items()},
            tuple(data.get("appendages", ())),
            dict(data.get("landmarks", {})),
        )

    def to_dict(self) -> dict[str, Any]:
        """The ``anatomy`` object of a template file."""
        return {
            "name": self.name,
            "openings": dict(self.openings),
            "outer": self.outer,
            "outer_seeds": dict(self.outer_seeds),
            "landmarks": dict(self.landmarks),
            "paths": {name: list(pair) for name, pair in self.paths.items()},
            "rims": {name: list(paths) for name, paths in self.rims.items()},
            "regions": {str(number): list(paths) for number, paths in self.regions.items()},
            "region_names": {str(number): name for number, name in self.region_names.items()},
            "directions": {
                side: [[list(first), list(second)] for first, second in pairs]
                for side, pairs in self.directions.items()
            },
            "layout": {opening: list(direction) for opening, direction in self.layout.items()},
            "appendages": list(self.appendages),
        }


Dart = tuple[str, int]
"""A path walked from its end 0 or from its end 1."""


def trace_faces(anatomy: Anatomy) -> list[list[Dart]]:
    """The faces of the plane graph that the rims describe, each as the darts along it, face on the left.

    Openings and landmarks are the nodes and paths the edges of a plane graph; the counter-clockwise order of the
    paths at each of them fixes its faces. Arriving at a hole, the face goes on along the path that precedes there
    (clockwise round the hole); at the outer rim, which lies round the map, along the one that follows.
    """
    faces = []
    todo = {(path, end) for path in anatomy.paths for end in (0, 1)}
    while todo:
        dart = min(todo)
        face: list[Dart] = []
        while dart in todo:
            todo.remove(dart)
            face.append(dart)
            path, end = dart
            opening = anatomy.opening_of(anatomy.paths[path][1 - end])
            order = anatomy.feet(opening)
            step = 1 if opening == anatomy.outer else -1
            after = order[(order.index(path) + step) % len(order)]
            start = next(k for k, seed in enumerate(anatomy.paths[after]) if anatomy.opening_of(seed) == opening)
            dart = (after, start)
        faces.append(face)
    return faces


def _check(anatomy: Anatomy) -> None:
    """Raise TemplateError where the table contradicts itself, naming the field."""
    if anatomy.outer not in anatomy.openings:
        raise TemplateError(f'anatomy.outer: expected one of the openings, found "{anatomy.outer}".')
    inner = (*anatomy.holes, *anatomy.landmarks)
    for name in (*anatomy.landmarks, *anatomy.outer_seeds):
        if name in anatomy.openings or (name in anatomy.landmarks and name in anatomy.outer_seeds):
            raise TemplateError(f'anatomy: "{name}" is used twice; expected another name for each opening and seed.')
    known = {*inner, *anatomy.outer_seeds}
    for name, pair in anatomy.paths.items():
        for seed in pair:
            if seed not in known:
                raise TemplateError(
                    f'anatomy.paths.{name}: "{seed}" is no hole, no landmark and no seed of the outer rim.'
                )
        if pair[0] == pair[1]:
            raise TemplateError(f'anatomy.paths.{name}: joins "{pair[0]}" to itself; expected two different seeds.')
        if not set(pair) & set(inner):
            raise TemplateError(
                f"anatomy.paths.{name}: joins two seeds of the outer rim; expected a hole or a landmark at one end."
            )
    for seed in anatomy.outer_seeds:
        ends = [name for name, pair in anatomy.paths.items() if seed in pair]
        if len(ends) != 1:
            raise TemplateError(
                f"anatomy.outer_seeds.{seed}: expected one path to end there, found {', '.join(ends) or 'none'}."
            )
    for hole in inner:
        ends = sorted(name for name, pair in anatomy.paths.items() if hole in pair)
        if sorted(anatomy.rims.get(hole, ())) != ends or not ends:
            raise TemplateError(
                f"anatomy.rims.{hole}: expected the paths that end there ({', '.join(ends) or 'at least one'}), "
                f"found {', '.join(anatomy.rims.get(hole, ())) or 'none'}."
            )
    for side, pairs in anatomy.directions.items():
        for group in (group for pair in pairs for group in pair):
            unknown = [hole for hole in group if hole not in inner]
            if unknown:
                raise TemplateError(
                    f'anatomy.directions.{side}: "{unknown[0]}" is no hole or landmark of this anatomy.'
                )
    for hole in anatomy.appendages:
        if hole not in anatomy.holes:
            raise TemplateError(f'anatomy.appendages: "{hole}" is no hole of this anatomy.')
    if anatomy.layout and set(anatomy.layout) != set(anatomy.openings):
        raise TemplateError(
            f"anatomy.layout: expected a direction for each of {', '.join(anatomy.openings)}, found "
            f"{', '.join(anatomy.layout)}."
        )
    for opening, direction in anatomy.layout.items():
        if not any(direction):
            raise TemplateError(f"anatomy.layout.{opening}: expected a direction, found three zeros.")
    for number in anatomy.regions:
        if number not in anatomy.region_names:
            raise TemplateError(f"anatomy.region_names.{number}: missing; expected a name for region {number}.")
    faces = [{path for path, _ in face} for face in trace_faces(anatomy)]
    for number, paths in anatomy.regions.items():
        if set(paths) not in faces:
            raise TemplateError(
                f"anatomy.regions.{number}: {', '.join(paths)} do not enclose a region, going by the order of the "
                "paths round each opening (anatomy.rims, anatomy.outer_seeds)."
            )
    if len(faces) != len(anatomy.regions):
        raise TemplateError(f"anatomy.regions: the paths cut out {len(faces)} regions, found {len(anatomy.regions)}.")


LEFT_ATRIUM = Anatomy(
    name="left_atrium",
    openings={
        "RSPV": "right superior pulmonary vein",
        "RIPV": "right inferior pulmonary vein",
        "LIPV": "left inferior pulmonary vein",
        "LSPV": "left superior pulmonary vein",
        "LAA": "left atrial appendage",
        "MV": "mitral valve",
    },
    outer="MV",
    outer_seeds={
        "MV1": "mitral rim, septal wall, below the right superior vein",
        "MV4": "mitral rim, left lateral wall, below the appendage",
        "MV3": "mitral rim, left lateral wall, below the left inferior vein",
        "MV2": "mitral rim, septal wall, below the right inferior vein",
    },
    paths={
        "s1": ("RSPV", "RIPV"),
        "s2": ("RIPV", "LIPV"),
        "s3": ("LIPV", "LSPV"),
        "s4": ("LSPV", "RSPV"),
        "s5": ("RSPV", "MV1"),
        "s6": ("RIPV", "MV2"),
        "s7": ("LIPV", "MV3"),
        "s8": ("LSPV", "LAA"),
        "s9": ("LAA", "MV4"),
    },
    rims={
        "RSPV": ("s4", "s1", "s5"),
        "RIPV": ("s2", "s6", "s1"),
        "LIPV": ("s2", "s3", "s7"),
        "LSPV": ("s4", "s8", "s3"),
        "LAA": ("s8", "s9"),
    },
    regions={
        1: ("s1", "s6", "s5"),
        2: ("s2", "s7", "s6"),
        3: ("s3", "s8", "s9", "s7"),
        4: ("s4", "s5", "s9", "s8"),
        5: ("s1", "s2", "s3", "s4"),
    },
    region_names={
        1: "septal wall",
        2: "posterior wall and floor",
        3: "left lateral wall",
        4: "anterior wall",
        5: "posterior wall between the veins",
    },
    directions={
        "left": ((("LSPV", "LIPV"), ("RSPV", "RIPV")), (("LAA",), ("RSPV", "RIPV"))),
        "superior": ((("LSPV", "RSPV"), ("LIPV", "RIPV")),),
        "anterior": ((("LAA",), ("LSPV", "LIPV")),),
    },
    # Means over ten atria with LGE-MRI (eight of the 2018 Atrial Segmentation Challenge and two others); ostia lie 5 to
    # 15 degrees off them.
    layout={
        "RSPV": (-0.95, -0.05, 0.32),
        "RIPV": (-0.94, 0.33, -0.09),
        "LIPV": (0.58, 0.65, 0.49),
        "LSPV": (0.49, 0.24, 0.84),
        "LAA": (0.65, -0.29, 0.70),
        "MV": (0.42, -0.48, -0.77),
    },
    appendages=("LAA",),
)
"""The nine seeds, nine paths and five regions of Nunez-Garcia et al., section II-A2."""

ANATOMIES: dict[str, Anatomy] = {LEFT_ATRIUM.name: LEFT_ATRIUM}
"""Built-in anatomies by name."""

REFERENCES = {LEFT_ATRIUM.name: ("LIPV", "s3")}
"""Anatomy -> the opening and the path that ratios of sizes refer to, as in the paper: the smallest ostium, the left
carina."""

COMPARED = {
    "perimeter": (
        ("LIPV", "LSPV"),
        ("LSPV", "RIPV"),
        ("RIPV", "RSPV"),
        ("RSPV", "LAA"),
        ("LIPV", "RIPV"),
        ("LSPV", "RSPV"),
    ),
    "path": (("s3", "s1"), ("s3", "s8"), ("s2", "s4"), ("s1", "s2"), ("s7", "s6"), ("s7", "s5")),
}
"""Sizes of which the paper asks whether the second is larger than the first; pairs that an anatomy has not are left
out."""
