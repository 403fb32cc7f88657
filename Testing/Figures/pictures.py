"""What the figures share: pages, shaded views, maps with paths and rims."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from LAFlatteningLib import FlatMap, Surface
from LAFlatteningLib.page import draw_line, rasterise_map, show_raster
from LAFlatteningLib.shading import Paint, Raster, rasterise, shade
from LAFlatteningLib.views import View

INK, PATH, RIM, FOLD = "#1a1a1a", "#111111", "#00b8a9", "#d40000"
WALL, INSIDE = np.array([0.86, 0.80, 0.76]), np.array([0.42, 0.40, 0.40])
VIEW_PIXELS = 900
DOTS_PER_INCH = 110


@dataclass(frozen=True)
class Drawn:
    """A figure with what it shows.

    Attributes
    ----------
    name : of its file, without ending.
    figure : matplotlib Figure.
    caption : one paragraph; every number in it was computed with the figure.
    """

    name: str
    figure: Figure
    caption: str


def page(width: float, height: float) -> Figure:
    """An empty page, inches."""
    figure = Figure(figsize=(width, height), dpi=DOTS_PER_INCH, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def panel(figure: Figure, place: tuple[float, float, float, float], title: str = "") -> Axes:
    """Axes without frame at left, bottom, width, height as shares of the page."""
    axes = figure.add_axes(place)
    axes.set_axis_off()
    axes.set_aspect("equal")
    if title:
        axes.set_title(title, size=9, color=INK)
    return axes


def save(drawn: Drawn, folder: Path) -> Path:
    """Write a figure; its path."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{drawn.name}.png"
    drawn.figure.savefig(path, dpi=DOTS_PER_INCH, facecolor="white", pil_kwargs={"optimize": True})
    return path


def show_atrium(
    axes: Axes,
    surface: Surface,
    view: View,
    paint: Paint | Callable[[Raster], np.ndarray] | None = None,
    frame: tuple[float, float, float] | None = None,
) -> Raster:
    """A surface in one view, shaded.

    Parameters
    ----------
    paint : of the outer side; default: one colour.
    frame : left, bottom and side (mm) of what is shown; default: all of it.
    """
    projected = view.project(surface.points)
    if frame is None:
        used = projected[surface.used_points, :2]
        low, high = used.min(axis=0), used.max(axis=0)
        side = 1.06 * float((high - low).max())
        frame = (*(0.5 * (low + high) - 0.5 * side), side)
    left, bottom, side = frame
    raster = rasterise(projected, surface.triangles, left, bottom, side / VIEW_PIXELS, (VIEW_PIXELS, VIEW_PIXELS))
    wall = WALL if paint is None else paint.rgb(raster) if isinstance(paint, Paint) else paint(raster)
    colours = np.where(raster.front[:, None], wall, INSIDE)
    show_raster(axes, raster, shade(raster, colours, raster.interpolate(view.project(surface.point_normals))))
    axes.set(xlim=(left, left + side), ylim=(bottom, bottom + side))
    return raster


def show_line(axes: Axes, raster: Raster, surface: Surface, view: View, ids: np.ndarray, colour: str, width: float):
    """The visible part of a line along points of a surface."""
    line = raster.visible_part(view.project(surface.points[ids]), view.project(surface.point_normals[ids]))
    draw_line(axes, line, colour, width)


def scale_bar(axes: Axes, millimetres: float = 20.0) -> None:
    """A bar of known length in the lower left corner of a view."""
    left, right = axes.get_xlim()
    bottom, top = axes.get_ylim()
    x, y = left + 0.03 * (right - left), bottom + 0.03 * (top - bottom)
    axes.plot([x, x + millimetres], [y, y], color=INK, linewidth=2, solid_capstyle="butt")
    axes.text(x + 0.5 * millimetres, y + 0.02 * (top - bottom), f"{millimetres:g} mm", ha="center", size=7, color=INK)


def show_map(axes: Axes, flat_map: FlatMap, paint: Paint, cut: bool = False) -> None:
    """A map with its rims and paths.

    Parameters
    ----------
    cut : whether the paint is for the triangles as the paths cut them.
    """
    triangles = flat_map.division.surface.triangles if cut else flat_map.triangles
    flat = flat_map.solution
    raster = rasterise_map(flat if cut else flat_map.points, triangles)
    show_raster(axes, raster, paint.rgb(raster))
    for ids in flat_map.division.paths.values():
        draw_line(axes, flat[ids], PATH, 0.9)
    for ids in flat_map.division.loops.values():
        draw_line(axes, flat[np.append(ids, ids[0])], RIM, 1.4)
    shape, radius = flat_map.template.outer.shape, 1.03 * flat_map.template.radius
    axes.set(xlim=shape.centre[0] + radius * np.array([-1, 1]), ylim=shape.centre[1] + radius * np.array([-1, 1]))
    for opening, rim in flat_map.template.holes.items():
        axes.text(*rim.shape.centre, opening, ha="center", va="center", size=5.5, color=INK)
