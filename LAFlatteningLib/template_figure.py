"""A template drawn by itself: where openings, landmarks, paths and regions go, before there is any map."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .page import (
    FAINT,
    HEADING_SIZE,
    INK,
    SMALL_SIZE,
    TEXT_SIZE,
    add_axes,
    draw_line,
    new_page,
    rasterise_map,
    save_page,
    write_text,
)
from .shading import REGION_COLOURS, FloatArray
from .template import Template, inside_polygon

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PATH_COLOUR, RIM_COLOUR = "#111111", "#00b8a9"
GRID = 120
"""Cells across the map in which places for the numbers of regions are looked for."""
LETTERS = 56
"""In a line of the list beside the map."""


def draw_template(template: Template, path: Path | str) -> None:
    """Draw a template to a file (.png, .pdf, .svg); see `make_template_figure`.

    Raises
    ------
    InputFileError : an ending that is none of these, or a place that cannot be written to.
    MissingPackageError : matplotlib is not installed.
    """
    save_page(path, lambda: make_template_figure(template))


def make_template_figure(template: Template) -> Figure:
    """A page with the layout of a template and what its names mean.

    On the map: regions with their numbers, rims, landmarks, paths with their names and feet, and the angle at which
    each path meets the outer rim. Beside it: openings with their sizes, seeds, paths and regions in words.

    Examples
    --------
    >>> figure = make_template_figure(Template.load("adapted1"))
    >>> [axes.get_label() for axes in figure.axes]
    ['template', 'names']
    """
    title = template.title or template.name
    figure = new_page(
        f"Template: {title}", [f"template {template.name}", f"anatomy {template.anatomy.name.replace('_', ' ')}"]
    )
    axes = add_axes(figure, "template", (0.75, 0.85, 6.5, 6.5))
    _draw_layout(axes, template)
    names = add_axes(figure, "names", (7.6, 0.55, 3.9, 7.1))
    names.set_axis_off()
    names.set(xlim=(0.0, 3.9), ylim=(0.0, 7.1))
    _write_names(names, template)
    return figure


def _draw_layout(axes: Axes, template: Template) -> None:
    anatomy, radius = template.anatomy, template.radius
    outlines = {number: template.region_outline(number) for number in anatomy.regions}
    for colour, outline in zip(REGION_COLOURS * 9, outlines.values(), strict=False):
        axes.fill(*outline.T, color=colour, alpha=0.55, linewidth=0.0, zorder=1)
    for number, place in _inmost_places(template, outlines).items():
        write_text(axes, place, f"R{number}", HEADING_SIZE, weight="bold", halo=True)
    for path in anatomy.paths:
        start, end = template.segment(path)
        draw_line(axes, np.stack([start, end]), PATH_COLOUR, 1.3)
        axes.plot(*np.stack([start, end]).T, "o", color=PATH_COLOUR, markersize=3.0, zorder=6)
        write_text(axes, 0.5 * (start + end), path, SMALL_SIZE, halo=True)
    for opening in anatomy.openings:
        outline = template.rim(opening).shape.outline(360)
        draw_line(axes, np.concatenate([outline, outline[:1]]), RIM_COLOUR, 2.2)
    for hole in anatomy.holes:
        shape = template.holes[hole].shape
        size = SMALL_SIZE if min(shape.semi_axes) > 0.07 * radius else SMALL_SIZE - 2.0
        write_text(axes, shape.centre, hole, size, weight="bold")
    for name, at in template.landmarks.items():
        axes.plot(*at, "o", color="white", markeredgecolor=INK, markersize=6.0, zorder=7)
        write_text(axes, (at[0], at[1] - 0.07 * radius), name, TEXT_SIZE, weight="bold", halo=True)
    outer = template.outer.shape
    for seed, path in zip(anatomy.outer_seeds, anatomy.outer_paths, strict=True):
        place = outer.at(template.outer.feet[path])
        outward = (place - outer.centre) / np.linalg.norm(place - outer.centre)
        room = np.abs(outward) @ (0.12, 0.07) * radius
        text = f"{seed}\n{template.outer.feet[path] % 360.0:g}°"
        write_text(axes, place + room * outward, text, SMALL_SIZE, weight="bold", linespacing=0.95)
    _scale(axes, template)


def _inmost_places(template: Template, outlines: dict[int, FloatArray]) -> dict[int, FloatArray]:
    """Where in each region there is most room."""
    low, high = (limit(template.outer.shape.outline(360), axis=0) for limit in (np.min, np.max))
    x, y = np.meshgrid(*(np.linspace(low[k], high[k], GRID + 1) for k in (0, 1)))
    cell = (np.arange(GRID)[:, None] * (GRID + 1) + np.arange(GRID)).ravel()
    up = cell + GRID + 1
    triangles = np.concatenate([np.stack([cell, cell + 1, up + 1], 1), np.stack([cell, up + 1, up], 1)])
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    middles = points[triangles].mean(axis=1)
    labels = np.full(len(triangles), -1, np.int64)
    for number, outline in outlines.items():
        labels[inside_polygon(middles, outline)] = number
    for rim in template.holes.values():
        labels[rim.shape.contains(middles)] = -1
    raster = rasterise_map(points, triangles)
    return {number: place for number, (place, _) in raster.inmost_places(labels, raster.front).items()}


def _scale(axes: Axes, template: Template) -> None:
    shape, radius = template.outer.shape, template.radius
    ticks = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    outline = shape.outline(360)
    for axis, side in enumerate(("bottom", "left")):
        middle = float(outline[:, axis].min() + outline[:, axis].max()) / 2.0
        line = (axes.xaxis, axes.yaxis)[axis]
        line.set_ticks(middle + ticks * radius, labels=[f"{tick * radius + middle:g}" for tick in ticks])
        line.set_label_text("map units", size=TEXT_SIZE, color=INK)
        (axes.set_xlim, axes.set_ylim)[axis](middle - 1.24 * radius, middle + 1.24 * radius)
        axes.spines[side].set(bounds=(middle - radius, middle + radius), edgecolor=FAINT)
    axes.set_aspect("equal")
    axes.tick_params(labelsize=SMALL_SIZE, colors=FAINT)
    axes.spines[["top", "right"]].set_visible(False)


def _write_names(axes: Axes, template: Template) -> None:
    anatomy = template.anatomy
    y = 7.05

    def write(
        text: str, size: float = SMALL_SIZE, colour: str = INK, indent: float = 0.0, weight: str = "normal"
    ) -> None:
        nonlocal y
        lines = textwrap.wrap(text, LETTERS) or [""]
        options = {"ha": "left", "va": "top", "linespacing": 1.15, "weight": weight}
        write_text(axes, (indent, y), "\n".join(lines), size, colour, False, **options)
        y -= 0.152 * len(lines) * size / SMALL_SIZE + 0.03

    def heading(text: str) -> None:
        nonlocal y
        y -= 0.08
        write(text, TEXT_SIZE, weight="bold")

    heading("Openings")
    for opening, name in anatomy.openings.items():
        where = "outer rim, " if opening == anatomy.outer else ""
        write(f"{opening}  {name} ({where}{_size(template.rim(opening).shape.to_dict())})")
    if anatomy.landmarks:
        heading("Landmarks")
        for landmark, name in anatomy.landmarks.items():
            x, height = template.landmarks[landmark]
            write(f"{landmark}  {name} (at {x:g}, {height:g})")
    heading(f"Seeds on the rim of {anatomy.outer}")
    for seed, name in anatomy.outer_seeds.items():
        write(f"{seed}  {name}")
    heading("Regions")
    for number, colour in zip(anatomy.regions, REGION_COLOURS * 9, strict=False):
        axes.plot([0.07], [y - 0.07], "s", color=colour, alpha=0.75, markersize=7.0)
        write(f"R{number}  {anatomy.region_names[number]}", indent=0.22)
    heading("Source")
    write(template.source or "not stated", colour=FAINT)


def _size(shape: dict[str, object]) -> str:
    """The size of an outline in words, map units."""
    if shape["type"] == "circle":
        return f"radius {shape['radius']:g}"
    if shape["type"] == "rectangle":
        return f"{shape['width']:g} x {shape['height']:g}"
    if shape["type"] == "polygon":
        return f"polygon of {len(shape['corners'])} corners"  # type: ignore[arg-type]
    return "semi-axes {:g}, {:g}".format(*shape["semi_axes"])  # type: ignore[misc]
