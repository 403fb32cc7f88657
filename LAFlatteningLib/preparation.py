"""From a raw atrium to a cavity with seeds: clean, remesh, cut, name, place seeds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ._version import __version__
from .anatomy import LEFT_ATRIUM, Anatomy
from .cavity.clipping import CutPlane
from .cavity.covers import HOLE_ARRAY
from .cavity.handles import Handle, remove_handles
from .cavity.healing import heal
from .cavity.opening_up import open_up
from .cavity.openings import check_surface, open_covers
from .cavity.plan import KEEP_MM, CutPlan, PlannedOpening, plan_cuts
from .progress import ProgressCallback, Stopwatch, part, report
from .remeshing import remesh
from .seed_suggestion import suggest_seeds
from .surface import FloatArray, IntArray, Surface

EVEN_POINTS = (10_000, 40_000)
"""A surface with so many points is not meshed anew unless a number is asked for."""
DEFAULT_POINTS = 20_000
"""Points that another surface is given."""


WIDEST_HANDLE_MM = 12.0
"""A pulmonary vein or the appendage is hardly wider where it touches another; what is wider is no artefact."""


@dataclass(frozen=True)
class PrepareSettings:
    """How an atrium is prepared.

    Attributes
    ----------
    points : of the closed atrium, which is meshed anew; 0 keeps its mesh; None keeps it if it has `EVEN_POINTS`, and
        else asks for `DEFAULT_POINTS`.
    pv_length_mm, laa_length_mm : length of vein and appendage that stays beyond the ostium.
    whole_triangles : leave triangles whole at the rims.
    extra_veins : "cover" or "keep", see `cavity.plan.plan_cuts`.
    ignore_axes : the coordinates are not the patient's axes, as where the surface says so itself.
    widest_handle_mm : a wider bridge between veins, or tunnel, is not cut by itself.
    """

    points: int | None = None
    pv_length_mm: float = KEEP_MM
    laa_length_mm: float = KEEP_MM
    whole_triangles: bool = False
    extra_veins: str = "cover"
    ignore_axes: bool = False
    widest_handle_mm: float = WIDEST_HANDLE_MM


@dataclass(eq=False)
class Preparation:
    """An atrium on its way to a map; steps that were not reached are None or empty.

    Attributes
    ----------
    raw : the surface as given.
    surface : cleaned and perhaps meshed anew; still with its veins.
    plan : its openings, and where it is cut.
    cavity : open at all openings.
    rims : opening -> its rim in the cavity.
    seeds : seed -> (3,) mm.
    handles : what was cut so that the surface has no handle.
    repairs : what was mended, in words.
    seconds : by step.
    """

    raw: Surface
    surface: Surface | None = None
    plan: CutPlan | None = None
    cavity: Surface | None = None
    rims: Mapping[str, IntArray] = field(default_factory=dict)
    seeds: Mapping[str, FloatArray] = field(default_factory=dict)
    handles: tuple[Handle, ...] = ()
    repairs: list[str] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def notes(self) -> list[str]:
        """All that the user should know, in words."""
        return [*self.repairs, *(self.plan.notes if self.plan else ())]

    def report(self) -> dict[str, Any]:
        """What was found and done, for ``prepare.json``; JSON types only."""
        result: dict[str, Any] = {
            "schema": "laflattening-prepare/1",
            "version": __version__,
            "space": self.raw.axes_name,
            "input": _sizes(self.raw),
            "repairs": list(self.repairs),
            "handles": [
                {"place_mm": h.place_mm.tolist(), "width_mm": h.width_mm, "kind": h.kind} for h in self.handles
            ],
            "notes": list(self.plan.notes) if self.plan else [],
            "seconds": dict(self.seconds),
        }
        if self.plan:
            recognition = self.plan.recognition
            result["confidence"] = self.plan.confidence
            if recognition:
                result["recognition"] = {"misfit": recognition.misfit, "lead": min(recognition.lead, 99.0)}
            result["planes"] = {name: _described(opening) for name, opening in self.plan.openings.items()}
            result["extra_veins"] = [_described(opening) for opening in self.plan.extra]
        if self.cavity:
            result["cavity"] = _sizes(self.cavity)
            for name, rim in self.rims.items():
                result["planes"][name]["rim_perimeter_mm"] = self.cavity.loop_length(rim)
        if self.seeds:
            result["seeds"] = {label: np.asarray(place).tolist() for label, place in self.seeds.items()}
        return result


def prepare(
    surface: Surface,
    settings: PrepareSettings | None = None,
    *,
    anatomy: Anatomy = LEFT_ATRIUM,
    tips: Mapping[str, FloatArray] | None = None,
    planes: Mapping[str, CutPlane] | None = None,
    into: Preparation | None = None,
    progress: ProgressCallback | None = None,
) -> Preparation:
    """A cavity with seeds from a raw atrium.

    Parameters
    ----------
    surface : an atrium in mm, closed or open at some openings, with veins of any length.
    tips, planes : see `cavity.plan.plan_cuts`.
    into : filled step by step, so that after an error the caller has what was reached.

    Raises
    ------
    SurfaceError, SeedError : what is wrong with the surface, where, and what to do.
    Cancelled : by `progress`.

    Examples
    --------
    >>> from LAFlatteningLib.phantom import make_phantom
    >>> prepared = prepare(make_phantom(4000, closed=True).surface, PrepareSettings(points=0))
    >>> len(prepared.cavity.boundary_loops), len(prepared.seeds)
    (6, 9)
    """
    settings = settings or PrepareSettings()
    result = into if into is not None else Preparation(surface)
    if settings.ignore_axes:
        # All that is made of the surface takes that along.
        surface = surface.with_unknown_axes()
    result.raw = surface
    watch = Stopwatch()
    result.seconds = watch.seconds
    with watch.stage("clean"):
        report(progress, 0.0, "Checking the surface")
        healed, healing = heal(surface)
        result.repairs += healing
        result.surface, notes = check_surface(healed, handles_allowed=True)
        result.repairs += notes
        if HOLE_ARRAY in result.surface.point_data:
            result.surface, covers = open_covers(result.surface)
            if covers:
                result.repairs.append(
                    f'{covers} cover{"s" if covers > 1 else ""}, marked by the array "{HOLE_ARRAY}", '
                    f"{'were' if covers > 1 else 'was'} taken off."
                )
    with watch.stage("handles"):
        # Before remeshing: a handle may be narrower than the new triangles.
        result.surface, result.handles = remove_handles(
            result.surface, widest_mm=settings.widest_handle_mm, progress=part(progress, 0.05, 0.2)
        )
    with watch.stage("remesh"):
        result.surface = _remeshed(result.surface, settings.points, part(progress, 0.2, 0.4))
    with watch.stage("plan"):
        result.plan = plan_cuts(
            result.surface,
            anatomy,
            tips=tips,
            planes=planes,
            keep_mm={
                hole: settings.laa_length_mm if hole in anatomy.appendages else settings.pv_length_mm
                for hole in anatomy.holes
            },
            ignore_axes=not surface.axes_known,
            extra_veins=settings.extra_veins,
            progress=part(progress, 0.4, 0.8),
        )
    result.repairs += [_handle_in_words(handle, result.plan, anatomy) for handle in result.handles]
    apply_plan(result, settings, anatomy, part(progress, 0.8, 1.0), watch)
    watch.stop()
    return result


def apply_plan(
    preparation: Preparation,
    settings: PrepareSettings,
    anatomy: Anatomy = LEFT_ATRIUM,
    progress: ProgressCallback | None = None,
    watch: Stopwatch | None = None,
) -> None:
    """Cut the surface of a preparation by its plan, and place seeds; again after planes were moved."""
    assert preparation.surface is not None
    assert preparation.plan is not None
    watch = watch or Stopwatch()
    with watch.stage("cut"):
        cavity, rims = open_up(preparation.surface, preparation.plan, settings.whole_triangles, progress)
    with watch.stage("seeds"):
        report(progress, 0.9, "Placing seeds")
        seeds = suggest_seeds(cavity, rims, anatomy)
    preparation.cavity, preparation.rims, preparation.seeds = cavity, rims, seeds


def _remeshed(surface: Surface, points: int | None, progress: ProgressCallback | None) -> Surface:
    if points == 0 or (points is None and EVEN_POINTS[0] <= len(surface.points) <= EVEN_POINTS[1]):
        return surface
    return remesh(surface, points or DEFAULT_POINTS, progress=progress).surface


def _handle_in_words(handle: Handle, plan: CutPlan, anatomy: Anatomy) -> str:
    """A handle that was cut, and the two structures next to it."""

    def distance(hole: str) -> float:
        opening = plan.openings[hole]
        begin = opening.plane.centre
        end = begin if opening.tip is None else opening.tip
        along = np.clip(
            (handle.place_mm - begin) @ (end - begin) / max(float((end - begin) @ (end - begin)), 1e-9), 0, 1
        )
        return float(np.linalg.norm(begin + along * (end - begin) - handle.place_mm))

    first, second = sorted(anatomy.holes, key=distance)[:2]
    verb = "Cut" if handle.kind == "bridge" else "Filled"
    place = ", ".join(f"{x:.1f}" for x in handle.place_mm)
    return (
        f"{verb} a {handle.kind} {handle.width_mm:.1f} mm wide between {first} and {second}, at ({place}) mm; check "
        "that it was none of the heart's."
    )


def _sizes(surface: Surface) -> dict[str, Any]:
    return {
        "points": len(surface.points),
        "triangles": len(surface.triangles),
        "area_cm2": surface.area / 100.0,
        "volume_ml": abs(surface.enclosed_volume) / 1000.0 if surface.is_manifold else None,
    }


def _described(opening: PlannedOpening) -> dict[str, Any]:
    return {
        "centre_mm": opening.plane.centre.tolist(),
        "normal": opening.plane.normal.tolist(),
        "found_by": opening.found_by,
        "perimeter_mm": _number(opening.perimeter_mm),
        "kept_mm": _number(opening.kept_mm),
    }


def _number(value: float) -> float | None:
    """A number that JSON knows."""
    return float(value) if np.isfinite(value) else None
