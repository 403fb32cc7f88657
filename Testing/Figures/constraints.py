"""The paper's recomputation of constraints: where paths meet the rim of a vein, three ways."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from atria import Atrium
from cases import Seeds
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from pictures import INK, Drawn, page, panel, scale_bar, show_atrium, show_line

from LAFlatteningLib import Anatomy, Surface, Template
from LAFlatteningLib.cavity.openings import Cavity, make_cavity
from LAFlatteningLib.constraints import constraints_by_count
from LAFlatteningLib.division import Division, divide_as_published
from LAFlatteningLib.seed_paths import SeedPaths, WaysOverCovers, connect_seeds
from LAFlatteningLib.seeds import snap_seeds
from LAFlatteningLib.solvers import published_least_squares
from LAFlatteningLib.views import PatientFrame, View

OPENING = "RSPV"
COLOURS = {"as the seeds give them": "#222222", "equal spacing": "#d40000", "half-way (the rule)": "#e0a800"}


@dataclass(frozen=True)
class Way:
    """One way of placing feet: the division and the map that follow from it."""

    division: Division
    flat: np.ndarray


def draw(atrium: Atrium) -> Drawn:
    """Paths and map round RSPV, its seed moved to the border of the ostium, as in the paper."""
    template = Template.load("adapted1")
    anatomy = template.anatomy
    cavity = make_cavity(atrium.surface, anatomy, np.array([atrium.seeds[seed] for seed in anatomy.outer_seeds]))
    covers = WaysOverCovers(cavity)
    snapped = snap_seeds(_off_centre(atrium.seeds, cavity, anatomy, covers), cavity, anatomy)
    connected = connect_seeds(cavity, snapped, anatomy, covers)
    ways = _ways(cavity.surface, connected, template)
    figure = page(11.0, 3.9)
    axes = panel(figure, (0.01, 0.04, 0.25, 0.80), f"{OPENING} with three divisions, side view")
    _show_rim(axes, cavity, ways)
    rim = template.rim(OPENING)
    reach = 2.6 * rim.shape.semi_axes[0]
    for k, (name, way) in enumerate(ways.items()):
        axes = panel(figure, (0.27 + 0.245 * k, 0.04, 0.235, 0.80), f"({'abc'[k]}) {name}")
        segments = way.flat[cavity.surface.edges.points]
        axes.add_collection(LineCollection(list(segments), colors="#8fa3b5", linewidths=0.4))
        for ids in way.division.paths.values():
            axes.plot(*way.flat[ids].T, color=COLOURS[name], linewidth=1.8)
        loop = way.division.loops[OPENING]
        axes.plot(*way.flat[loop].T, "o", color=INK, markersize=2.4)
        axes.plot(*way.flat[loop[way.division.feet[OPENING]]].T, "o", color=COLOURS[name], markersize=6)
        centre = rim.shape.centre
        axes.set(xlim=(centre[0] - reach, centre[0] + reach), ylim=(centre[1] - reach, centre[1] + reach))
    figure.text(0.01, 0.93, f"Feet of the paths on the rim of {OPENING} (method paper)", size=11, color=INK, ha="left")
    counts = {
        name: "/".join(str(n) for n in np.diff(np.append(way.division.feet[OPENING], len(way.division.loops[OPENING]))))
        for name, way in ways.items()
    }
    caption = (
        f"Recomputation of constraints ({atrium.title}, method `paper`). The seed of {OPENING} was moved to the border "
        "of the ostium, which exaggerates the effect. (a) The paths as the seeds give them crowd the points of the "
        "rim; (b) equal spacing of all points turns the paths; (c) the published rule goes half-way. Points of the rim "
        f"in its three arcs: {'; '.join(f'{name} {text}' for name, text in counts.items())}."
    )
    return Drawn("constraints", figure, caption)


def _off_centre(seeds: Seeds, cavity: Cavity, anatomy: Anatomy, ways: WaysOverCovers) -> Seeds:
    """The seeds, that of the opening moved two thirds of the way towards the rim, between two of its paths."""
    connected = connect_seeds(cavity, snap_seeds(seeds, cavity, anatomy), anatomy, ways)
    loop = connected.loops[OPENING]
    start, end = (connected.feet[OPENING][path] for path in anatomy.feet(OPENING)[1:])
    middle = loop[int(start + 0.5 * ((end - start) % len(loop))) % len(loop)]
    return {**seeds, OPENING: seeds[OPENING] + 0.66 * (cavity.surface.points[middle] - seeds[OPENING])}


def _ways(surface: Surface, connected: SeedPaths, template: Template) -> dict[str, Way]:
    rim = template.rim(OPENING)

    def with_feet(spread: bool, feet: dict[str, float] | None = None) -> Way:
        holes = {**template.holes, OPENING: replace(rim, spread_feet=spread)}
        used = replace(template, holes=holes)
        moved = connected
        if feet is not None:
            moved = replace(connected, feet={**connected.feet, OPENING: feet})
        division = divide_as_published(surface, moved, used, "paper")
        constraints = constraints_by_count(division, used, True)
        flat = published_least_squares(
            2.0 * surface.laplacian,
            constraints.rim_ids,
            constraints.rim_targets,
            constraints.path_ids,
            constraints.path_targets,
        )
        return Way(division, flat)

    order = template.anatomy.feet(OPENING)
    count = len(connected.loops[OPENING])
    start = connected.feet[OPENING][order[0]]
    before = np.concatenate([[0.0], np.cumsum(rim.shares(order))[:-1]])
    equal = {path: (start + round(share * count)) % count for path, share in zip(order, before, strict=True)}
    ways = (with_feet(False), with_feet(False, equal), with_feet(True))
    return dict(zip(COLOURS, ways, strict=True))


def _show_rim(axes: Axes, cavity: Cavity, ways: dict[str, Way]) -> None:
    surface = cavity.surface
    loop = next(iter(ways.values())).division.loops[OPENING]
    middle = surface.points[loop].mean(axis=0)
    view = _facing(surface, loop)
    centre, side = view.project(middle[None])[0, :2], 3.2 * np.linalg.norm(surface.points[loop] - middle, axis=1).max()
    raster = show_atrium(axes, surface, view, frame=(*(centre - 0.5 * side), side))
    for name, way in ways.items():
        for path in _paths_at(way.division):
            show_line(axes, raster, surface, view, way.division.paths[path], COLOURS[name], 1.5)
    scale_bar(axes, 10.0)


def _paths_at(division: Division) -> list[str]:
    """The paths with a foot on the rim of the opening."""
    loop = set(division.loops[OPENING].tolist())
    return [name for name, ids in division.paths.items() if {int(ids[0]), int(ids[-1])} & loop]


def _facing(surface: Surface, loop: np.ndarray) -> View:
    """A view obliquely into an opening, superior up."""
    rim = surface.points[loop]
    outward = np.cross(rim - rim.mean(axis=0), np.roll(rim, -1, axis=0) - rim.mean(axis=0)).sum(axis=0)
    outward /= np.linalg.norm(outward)
    if outward @ (rim.mean(axis=0) - surface.points.mean(axis=0)) < 0:
        outward = -outward
    towards = outward + np.array([0.0, 1.1, 0.0])
    towards /= np.linalg.norm(towards)
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    plain = PatientFrame.of_space(surface.space).view("posterior")
    return View("oblique", plain.right, plain.up, plain.towards, np.stack([right, np.cross(towards, right), towards]))
