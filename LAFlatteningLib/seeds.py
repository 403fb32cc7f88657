"""The seeds: which points of the surface they mean, and whether they can be right."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from .anatomy import Anatomy
from .cavity.openings import SNAP_LIMIT_MM, Cavity
from .errors import SeedError
from .surface import FloatArray

SMALLEST_COSINE = 0.3
"""Cosine of the angle with the patient axis that a direction of `Anatomy.directions` must have (0.65 to 1 on the
atria that we have)."""
SAME_PLACE_MM = 0.01
"""Two seeds nearer to each other than this are at one place."""
LARGEST_COORDINATE_MM = 1e6
"""No seed is farther from the origin."""


@dataclass(frozen=True)
class SnappedSeeds:
    """Seeds as points and places of the closed surface.

    Attributes
    ----------
    ids : seed -> point id in `Cavity.closed`.
    hole : hole -> number of its rim and cover in the `Cavity`.
    moved_mm : seed -> how far it was moved: to the point of its cover, or to its place on the outer rim.
    positions : seed -> (3,) the nearest place on its cover or on the outer rim, not tied to a point of it, mm.
    outer_at : outer seed -> where that is along `Cavity.outer`: index, plus the share of the way to the next point.
    landmark : landmark -> the point of `Cavity.surface` that it is moved to.
    """

    ids: Mapping[str, int]
    hole: Mapping[str, int]
    moved_mm: Mapping[str, float]
    positions: Mapping[str, FloatArray]
    outer_at: Mapping[str, float]
    landmark: Mapping[str, int] = field(default_factory=dict)

    def renamed(self, names: Mapping[str, str]) -> SnappedSeeds:
        """The same places with other labels: label -> the label whose place it takes."""
        source = {label: names.get(label, label) for label in self.ids}
        return SnappedSeeds(
            {label: self.ids[source[label]] for label in self.ids},
            {label: self.hole[source[label]] for label in self.hole},
            {label: self.moved_mm[source[label]] for label in self.moved_mm},
            {label: self.positions[source[label]] for label in self.positions},
            {label: self.outer_at[source[label]] for label in self.outer_at},
            {label: self.landmark[source[label]] for label in self.landmark},
        )


def check_labels(seeds: Mapping[str, FloatArray], anatomy: Anatomy) -> dict[str, FloatArray]:
    """The seeds of an anatomy, in its order, as float arrays; other points are left out.

    Raises
    ------
    SeedError : seeds missing, or without finite coordinates.
    """
    missing = tuple(label for label in anatomy.seeds if label not in seeds)
    if missing:
        others = [label for label in seeds if label not in anatomy.seeds]
        raise SeedError(
            f"Seed{'s' if len(missing) > 1 else ''} missing: {', '.join(missing)}. Expected {len(anatomy.seeds)} seeds "
            f"({', '.join(anatomy.seeds)})"
            + (f"; found instead {', '.join(map(ascii, others))} (letters must match exactly)." if others else "."),
            missing,
        )
    result = {}
    for label in anatomy.seeds:
        try:
            result[label] = np.asarray(seeds[label], dtype=np.float64).reshape(-1)
        except (TypeError, ValueError):
            result[label] = np.zeros(0)
    bad = tuple(
        label
        for label, point in result.items()
        if point.shape != (3,) or not (np.abs(point) <= LARGEST_COORDINATE_MM).all()
    )
    if bad:
        raise SeedError(
            f"Seed {bad[0]} has no valid position: expected three coordinates in mm, found {seeds[bad[0]]}.", bad
        )
    return result


def snap_seeds(seeds: Mapping[str, FloatArray], cavity: Cavity, anatomy: Anatomy) -> SnappedSeeds:
    """Move each seed to the nearest point of its own kind: covers for holes, the outer rim for the seeds on it, points
    of the surface off all rims for landmarks.

    Parameters
    ----------
    seeds : label -> (3,) mm, in the axes of the surface.

    Raises
    ------
    SeedError : missing labels; farther than `SNAP_LIMIT_MM` from any cover (outer rim, surface), saying so
        when the cause is a mix-up of RAS and LPS or of units; two seeds on one opening or one rim point.
    """
    seeds = check_labels(seeds, anatomy)
    covers = cavity.cover_points
    cover_of = np.repeat(np.arange(len(covers)), [len(points) for points in covers])
    cover_ids = np.concatenate([np.zeros(0, np.int64), *covers])
    cover_tree = cKDTree(cavity.closed.points[cover_ids])
    outer_ids = cavity.ids[cavity.outer]
    outer_tree = cKDTree(cavity.closed.points[outer_ids])
    inner = np.ones(len(cavity.surface.points), bool)
    inner[np.concatenate([cavity.outer, *cavity.rims])] = False
    inner_ids = np.flatnonzero(inner)
    inner_tree = cKDTree(cavity.surface.points[inner_ids]) if anatomy.landmarks else cover_tree

    def distance(position: FloatArray, label: str) -> float:
        tree = outer_tree if label in anatomy.outer_seeds else inner_tree if label in anatomy.landmarks else cover_tree
        return float(tree.query(position)[0])

    far = tuple(label for label, position in seeds.items() if distance(position, label) > SNAP_LIMIT_MM)
    if far:
        _explain_far_seeds(seeds, far, cavity, anatomy, distance)
    ids: dict[str, int] = {}
    hole: dict[str, int] = {}
    moved: dict[str, float] = {}
    positions: dict[str, FloatArray] = {}
    outer_at: dict[str, float] = {}
    landmark: dict[str, int] = {}
    for label, position in seeds.items():
        if label in anatomy.outer_seeds:
            ids[label] = int(outer_ids[outer_tree.query(position)[1]])
            outer_at[label], positions[label] = _nearest_on_rim(cavity, position)
            moved[label] = float(np.linalg.norm(positions[label] - position))
            for other in outer_at:
                if other != label and np.linalg.norm(positions[other] - positions[label]) < SAME_PLACE_MM:
                    raise SeedError(
                        f"Seeds {other} and {label} sit on the same place of the {anatomy.outer} rim; expected "
                        f"{len(anatomy.outer_seeds)} different places. Move one of them along the rim.",
                        (other, label),
                    )
        elif label in anatomy.landmarks:
            landmark[label] = int(inner_ids[inner_tree.query(position)[1]])
            ids[label] = int(cavity.ids[landmark[label]])
            positions[label] = cavity.surface.points[landmark[label]]
            moved[label] = float(np.linalg.norm(positions[label] - position))
            for other in landmark:
                if other != label and landmark[other] == landmark[label]:
                    raise SeedError(
                        f"Seeds {other} and {label} sit on the same point of the surface; expected two different "
                        "places. Move one of them.",
                        (other, label),
                    )
        else:
            moved[label], nearest = (value.item() for value in map(np.asarray, cover_tree.query(position)))
            ids[label] = int(cover_ids[nearest])
            hole[label] = int(cover_of[nearest])
            positions[label] = cavity.on_cover(hole[label], position)
    for label, number in hole.items():
        rivals = [other for other in hole if hole[other] == number and other != label]
        if rivals:
            empty = ", ".join(
                f"({', '.join(f'{x:.0f}' for x in cavity.surface.points[cavity.rims[k]].mean(axis=0))})"
                for k in range(len(covers))
                if k not in hole.values()
            )
            raise SeedError(
                f"Seeds {label} and {rivals[0]} sit on the same opening; expected one seed on each of the "
                f"{len(covers)} openings ({', '.join(anatomy.holes)}). "
                f"The opening near {empty} mm has none: move one of them there.",
                (label, rivals[0]),
            )
    return SnappedSeeds(ids, hole, moved, positions, outer_at, landmark)


def _nearest_on_rim(cavity: Cavity, position: FloatArray) -> tuple[float, FloatArray]:
    """The place on the outer rim nearest to a position: its coordinate along the rim, and (3,) mm."""
    rim = cavity.surface.points[cavity.outer]
    step = np.roll(rim, -1, axis=0) - rim
    along = np.einsum("ij,ij->i", position - rim, step) / np.einsum("ij,ij->i", step, step)
    places = rim + np.clip(along, 0.0, 1.0)[:, None] * step
    k = int(np.linalg.norm(places - position, axis=1).argmin())
    share = float(np.clip(along[k], 0.0, 1.0))
    return (k + share) % len(rim), places[k]


def check_directions(positions: Mapping[str, FloatArray], space: str, anatomy: Anatomy) -> None:
    """Check that seeds lie to the left of, above and before each other as in every patient.

    Parameters
    ----------
    positions : seed -> (3,) mm, in the axes `space`.

    Raises
    ------
    SeedError : labels exchanged or moved on, or a surface in other axes than it says.
    """
    turn = 1.0 if space == "LPS" else -1.0
    axes = {
        "left": np.array([turn, 0.0, 0.0]),
        "anterior": np.array([0.0, -turn, 0.0]),
        "superior": np.array([0.0, 0.0, 1.0]),
    }
    opposite = {"left": "right of", "anterior": "posterior of", "superior": "below"}
    for side, pairs in anatomy.directions.items():
        for first, second in pairs:
            apart = np.mean([positions[hole] for hole in first], axis=0) - np.mean(
                [positions[hole] for hole in second], axis=0
            )
            cosine = float(apart @ axes[side]) / float(np.linalg.norm(apart))
            if cosine < SMALLEST_COSINE:
                found = opposite[side] if cosine < -SMALLEST_COSINE else "beside"
                raise SeedError(
                    f"By the axes of the surface ({space}), {' and '.join(first)} should lie {side} of "
                    f"{' and '.join(second)}; found {found} them. Either seeds have each other's labels, or the "
                    f"image was mirrored, or the surface is in other axes than {space}: then save it with its axes "
                    "named (SPACE=RAS or SPACE=LPS). If its coordinates are no patient axes at all, switch this "
                    "check off (--ignore-axes).",
                    (*first, *second),
                )


def _explain_far_seeds(
    seeds: Mapping[str, FloatArray],
    far: tuple[str, ...],
    cavity: Cavity,
    anatomy: Anatomy,
    distance: Callable[[FloatArray, str], float],
) -> None:
    """Raise the SeedError that says why seeds are far from where they belong."""
    space, other_space = cavity.closed.space, "RAS" if cavity.closed.space == "LPS" else "LPS"

    def fits(factor: FloatArray) -> bool:
        return all(distance(position * factor, label) <= SNAP_LIMIT_MM for label, position in seeds.items())

    if fits(np.array([-1.0, -1.0, 1.0])):
        if not cavity.closed.axes_known:
            raise SeedError(
                "The seeds are in other axes than the surface: with x and y negated all of them lie on it. Give seeds "
                "in the surface's own coordinates.",
                far,
            )
        raise SeedError(
            f"The seeds are in {other_space} and the surface is in {space}: with x and y negated all seeds lie on the "
            f"surface. Give seeds in the surface's own coordinates, or as .mrk.json, which names its axes (if they are "
            "one: correct its coordinateSystem).",
            far,
        )
    for factor, unit in [(1000.0, "metres"), (10.0, "centimetres"), (0.001, "micrometres")]:
        if fits(np.full(3, factor)):
            raise SeedError(f"The seeds are in {unit}, the surface in mm. Multiply the seeds by {factor:g}.", far)
    parts = []
    for label in far:
        found = distance(seeds[label], label)
        if label in anatomy.outer_seeds:
            parts.append(f"{label} is {found:.0f} mm from the {anatomy.outer} rim")
        elif label in anatomy.landmarks:
            parts.append(f"{label} is {found:.0f} mm from the surface")
        else:
            rim = np.linalg.norm(cavity.surface.points[cavity.outer] - seeds[label], axis=1).min()
            where = f" and lies at the {anatomy.outer} rim instead" if rim <= SNAP_LIMIT_MM else ""
            parts.append(f"{label} is {found:.0f} mm from the nearest opening{where}")
    kinds = (
        (anatomy.holes, "to the centre of their opening"),
        (tuple(anatomy.landmarks), "to the wall"),
        (tuple(sorted(anatomy.outer_seeds)), f"to the {anatomy.outer} rim"),
    )
    belong = [f"{', '.join(labels)} {where}" for labels, where in kinds if labels]
    raise SeedError(
        f"Seeds too far from where they belong (at most {SNAP_LIMIT_MM:g} mm allowed): {'; '.join(parts)}. "
        f"They belong: {', '.join(belong)}.",
        far,
    )
