"""Figures for the study of maps: strategies side by side, distortion of several maps, patterns, box plots of sizes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from . import distortion
from .figures import FOLD_COLOUR, INSIDE, RIM_COLOUR
from .map_data import MapData
from .page import (
    FAINT,
    HEADING_SIZE,
    INK,
    PAGE_INCHES,
    SMALL_SIZE,
    TEXT_SIZE,
    add_axes,
    fill_colour_bar,
    new_page,
    rasterise_map,
    save_page,
    show_raster,
    write_heading,
    write_text,
)
from .shading import (
    NO_VALUE,
    FloatArray,
    IntArray,
    Paint,
    Raster,
    rasterise,
    region_paint,
    shade,
)
from .shape_statistics import ShapeTable
from .surface import Surface
from .textures import Texture
from .views import View

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

OCTAVES = 4
"""The colours of alpha reach so many doublings on either side of 1, in every figure alike."""
MOST_ROWS = 4
DARK, LIGHT = np.array([0.12, 0.27, 0.42]), np.array([0.93, 0.93, 0.90])
"""Of patterns."""
VIEW_PIXELS = 700


# ---- what is called --------------------------------------------------------------------------------------------------


def draw_box_plots(table: ShapeTable, path: Path | str) -> None:
    """Write one page: box plots of perimeters, lengths and their ratios; errors as for `page.save_page`."""
    save_page(path, lambda: make_box_plots(table))


def draw_study(maps: Mapping[str, MapData], path: Path | str, *, pattern: Texture | None = None) -> None:
    """Write one page: a row for each map with triangles, alpha, beta, a pattern, and histograms.

    Parameters
    ----------
    maps : name -> map, at most `MOST_ROWS`.
    pattern : of the atrium that all maps are of; without one, its column is left out.
    """
    save_page(path, lambda: make_study_figure(maps, pattern=pattern))


def draw_textures(data: MapData, patterns: Sequence[Texture], path: Path | str) -> None:
    """Write one page: a row for each pattern with the atrium from behind and from the front, and the map."""
    save_page(path, lambda: make_texture_figure(data, patterns))


def draw_maps(maps: Mapping[str, tuple[MapData, IntArray]], path: Path | str, *, title: str) -> None:
    """Write one page: maps side by side, regions in colour, folded triangles in red.

    Parameters
    ----------
    maps : name -> map and region of each of its triangles (m,).
    """
    save_page(path, lambda: make_maps_figure(maps, title=title))


def make_box_plots(table: ShapeTable) -> Figure:
    """The page of `draw_box_plots`, with axes "perimeter", "perimeter ratio", "path", "path ratio"."""
    count = len(table.names)
    figure = new_page(f"Sizes of {count} atria" if count > 1 else f"Sizes of one atrium, {table.names[0]}")
    places = ((0.8, 4.45), (6.6, 4.45), (0.8, 0.85), (6.6, 0.85))
    headings = {
        "perimeter": "Perimeters of the openings",
        "perimeter ratio": "Perimeters over that of the smallest ostium",
        "path": "Lengths between the openings, from rim to rim",
        "path ratio": "Lengths over that of the left carina",
    }
    for (group, heading), (left, bottom) in zip(headings.items(), places, strict=True):
        spreads = [spread for spread in table.spreads if spread.group == group]
        axes = add_axes(figure, group, (left, bottom, 4.6, 2.8))
        write_heading(axes, heading, 0.12)
        if not spreads:
            write_text(axes, (0.5, 0.5), "no reference for this anatomy", TEXT_SIZE, transform=axes.transAxes)
            continue
        axes.boxplot(
            [spread.values for spread in spreads],
            medianprops={"color": "#b03000", "linewidth": 1.6},
            flierprops={"marker": "", "linestyle": ""},
        )
        rng = np.random.default_rng(0)
        for k, spread in enumerate(spreads, 1):
            # Every atrium is a dot: with few of them, a box alone promises too much.
            axes.plot(
                k + rng.uniform(-0.12, 0.12, len(spread.values)), spread.values, "o", color="#3366aa", markersize=2.5
            )
        axes.set_xticks(range(1, len(spreads) + 1), [spread.name for spread in spreads])
        axes.set_ylabel("mm" if spreads[0].unit == "mm" else "ratio (1)", size=SMALL_SIZE, color=INK)
        axes.tick_params(labelsize=SMALL_SIZE, colors=INK)
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def make_study_figure(maps: Mapping[str, MapData], *, pattern: Texture | None = None) -> Figure:
    """The page of `draw_study`; axes are labelled by the name of the map and the column, "SUM alpha" for example."""
    if not 1 <= len(maps) <= MOST_ROWS:
        raise ValueError(f"Expected 1 to {MOST_ROWS} maps, found {len(maps)}.")
    figure = new_page("How maps of one atrium change areas and angles")
    columns = ["triangles", "alpha", "beta"] + (["pattern"] if pattern is not None else [])
    headings = {
        "triangles": "triangles",
        "alpha": "area ratio α",
        "beta": "isotropy β",
        "pattern": pattern.title if pattern is not None else "",
    }
    height = 6.6 / len(maps)
    side = min(height - 0.1, 1.95)
    for row, (name, data) in enumerate(maps.items()):
        bottom = 7.35 - (row + 1) * height + 0.5 * (height - side)
        surface, flat = data.surface, data.flat
        mesh = (surface.points, data.triangles, flat)
        alpha, beta = alpha_paint(distortion.area_ratio(*mesh)), beta_paint(distortion.isotropy(*mesh))
        raster = rasterise_map(flat, data.triangles)
        for k, column in enumerate(columns):
            axes = add_axes(figure, f"{name} {column}", (0.95 + k * 2.05, bottom, side, side))
            if column == "triangles":
                _edges(axes, flat, data.triangles)
            elif column == "pattern":
                assert pattern is not None
                show_raster(axes, raster, texture_colours(raster, pattern))
            else:
                show_raster(axes, raster, (alpha if column == "alpha" else beta).rgb(raster))
            _finish_map(axes, data)
            if row == 0:
                write_heading(axes, headings[column], 0.08)
        write_text(
            figure.axes[-len(columns)], (-0.1, 0.5), name, HEADING_SIZE, rotation=90,
            transform=figure.axes[-len(columns)].transAxes,
        )  # fmt: skip
        left = 1.25 + len(columns) * 2.05
        width = (PAGE_INCHES[0] - left - 0.25) / 2.0 - 0.3
        found = distortion.summary(*mesh)
        edges = 2.0 ** np.linspace(-OCTAVES, OCTAVES, 41)
        words = f"entropy {found['alpha']['entropy']:.2f}"
        _histogram(figure, f"{name} alpha histogram", (left, bottom + 0.25, width, side - 0.55), alpha, edges, words)
        words = f"mean {found['beta']['mean']:.3f}"
        place = (left + width + 0.35, bottom + 0.25, width, side - 0.55)
        _histogram(figure, f"{name} beta histogram", place, beta, np.linspace(0.0, 1.0, 41), words)
    fill_colour_bar(add_axes(figure, "alpha colours", (3.0, 0.72, 1.95, 0.1)), alpha, "horizontal")
    fill_colour_bar(add_axes(figure, "beta colours", (5.2, 0.72, 1.6, 0.1)), beta, "horizontal")
    return figure


def make_texture_figure(data: MapData, patterns: Sequence[Texture]) -> Figure:
    """The page of `draw_textures`; axes are labelled by the pattern and "map" or the `View.name`."""
    if not 1 <= len(patterns) <= 3:
        raise ValueError(f"Expected 1 to 3 patterns, found {len(patterns)}.")
    figure = new_page("Patterns on the atrium, and on its map", [data.frame.fact] if data.frame.fact else [])
    height = 6.9 / len(patterns)
    side = min(height - 0.15, 3.4)
    raster = rasterise_map(data.flat, data.triangles)
    for row, pattern in enumerate(patterns):
        bottom = 7.4 - (row + 1) * height + 0.5 * (height - side)
        for k, view in enumerate(data.frame.views):
            axes = add_axes(figure, f"{pattern.name} {view.name}", (0.6 + k * (side + 0.2), bottom, side, side))
            show_surface(axes, data.surface, view, pattern)
            if row == 0:
                write_heading(axes, view.title, 0.08)
        axes = add_axes(figure, f"{pattern.name} map", (0.9 + 2.0 * (side + 0.2), bottom, side, side))
        show_raster(axes, raster, texture_colours(raster, pattern))
        _finish_map(axes, data)
        write_text(axes, (1.04, 0.5), pattern.title, TEXT_SIZE, rotation=90, transform=axes.transAxes)
        if row == 0:
            write_heading(axes, "map", 0.08)
    return figure


def make_maps_figure(maps: Mapping[str, tuple[MapData, IntArray]], *, title: str) -> Figure:
    """The page of `draw_maps`; axes are labelled by the names of the maps."""
    figure = new_page(title)
    columns = min(len(maps), 5)
    rows = -(-len(maps) // columns)
    side = min((PAGE_INCHES[0] - 0.6) / columns - 0.25, 6.3 / rows - 0.55)
    for k, (name, (data, regions)) in enumerate(maps.items()):
        left = 0.4 + (k % columns) * (side + 0.25)
        bottom = 7.1 - (k // columns + 1) * (side + 0.55) + 0.15
        axes = add_axes(figure, name, (left, bottom, side, side))
        raster = rasterise_map(data.flat, data.triangles)
        show_raster(axes, raster, region_paint(regions, data.template.anatomy).rgb(raster))
        _finish_map(axes, data)
        folded = distortion.folded_triangles(data.flat, data.triangles)
        axes.plot(*data.flat[data.triangles[folded]].mean(axis=1).T, "x", color=FOLD_COLOUR, markersize=3, zorder=6)
        mesh = (data.surface.points, data.triangles, data.flat)
        beta = float(np.nanmean(distortion.isotropy(*mesh)))
        write_heading(axes, name, 0.1)
        words = f"{len(folded)} folded triangles, mean β {beta:.3f}"
        write_text(axes, (0.5, -0.05), words, SMALL_SIZE, transform=axes.transAxes)
    return figure


# ---- colours ---------------------------------------------------------------------------------------------------------


def alpha_paint(alpha: FloatArray) -> Paint:
    """The colours of area ratios, the same for every map: `OCTAVES` doublings on either side of 1."""
    from matplotlib import colormaps
    from matplotlib.colors import LogNorm

    edge = 2.0**-OCTAVES
    ticks = [
        (2.0**power, f"1/{2**-power}" if power < 0 else f"{2**power}") for power in range(-OCTAVES, OCTAVES + 1, 2)
    ]
    values = np.where(np.isfinite(alpha), np.maximum(alpha, edge), np.nan)
    return Paint(
        "α: smaller ← 1 → larger on the map", values, False, colormaps["PuOr_r"], LogNorm(edge, 1 / edge), ticks
    )


def beta_paint(beta: FloatArray) -> Paint:
    """The colours of isotropy: 0 to 1 for every map."""
    from matplotlib import colormaps
    from matplotlib.colors import Normalize

    ticks = [(x, f"{x:g}") for x in (0.0, 0.5, 1.0)]
    return Paint("β: 1 keeps angles", beta, False, colormaps["cividis"], Normalize(0.0, 1.0), ticks)


def texture_colours(raster: Raster, pattern: Texture) -> FloatArray:
    """(k, 3) the colours of a pattern at the covered pixels; circles have their own, so that they can be told apart."""
    values = raster.interpolate(pattern.values)
    dark = np.broadcast_to(DARK, (len(values), 3))
    if pattern.labels.any():
        labels = raster.nearest(pattern.labels.astype(np.float64)).astype(np.int64)
        dark = _circle_colours(int(pattern.labels.max()))[np.maximum(labels, 1) - 1]
    colours = np.where((values > 0.0)[:, None], dark, LIGHT)
    colours[~np.isfinite(values)] = _rgb(NO_VALUE)
    return colours


def _circle_colours(count: int) -> FloatArray:
    """Colours of which neighbouring numbers differ."""
    from matplotlib import colormaps

    return colormaps["turbo"]((np.arange(count) * 0.61803) % 1.0)[:, :3]


def _rgb(colour: str) -> FloatArray:
    return np.array([int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)])


# ---- parts of a page -------------------------------------------------------------------------------------------------


def show_surface(axes: Axes, surface: Surface, view: View, pattern: Texture) -> None:
    """The atrium with a pattern in one view, shaded, with a scale bar."""
    projected = view.project(surface.points)
    frame = projected[surface.used_points, :2]
    low, high = frame.min(axis=0), frame.max(axis=0)
    extent = 1.06 * float((high - low).max())
    left, bottom = 0.5 * (low + high) - 0.5 * extent
    shape = (VIEW_PIXELS, VIEW_PIXELS)
    raster = rasterise(projected, surface.triangles, left, bottom, extent / VIEW_PIXELS, shape)
    colours = np.where(raster.front[:, None], texture_colours(raster, pattern), INSIDE)
    show_raster(axes, raster, shade(raster, colours, raster.interpolate(view.project(surface.point_normals))))
    axes.set(xlim=(left, left + extent), ylim=(bottom, bottom + extent), xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    axes.plot([left + 0.02 * extent, left + 0.02 * extent + 20.0], [bottom + 0.02 * extent] * 2, color=INK, linewidth=2)
    write_text(axes, (left + 0.02 * extent + 10.0, bottom + 0.05 * extent), "20 mm", SMALL_SIZE)


def _finish_map(axes: Axes, data: MapData) -> None:
    for loop in data.surface.boundary_loops:
        axes.plot(*data.flat[np.append(loop, loop[0])].T, color=RIM_COLOUR, linewidth=1.0, zorder=4)
    low, high = data.flat.min(axis=0), data.flat.max(axis=0)
    middle, reach = 0.5 * (low + high), 0.52 * float((high - low).max())
    axes.set(xlim=middle[0] + reach * np.array([-1, 1]), ylim=middle[1] + reach * np.array([-1, 1]))
    axes.set(xticks=[], yticks=[], aspect="equal")
    axes.spines[:].set_visible(False)


def _edges(axes: Axes, flat: FloatArray, triangles: IntArray) -> None:
    from matplotlib.collections import LineCollection

    sides = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    lines = LineCollection(list(flat[sides]), colors="#52708a", linewidths=0.15)
    lines.set_rasterized(True)
    axes.add_collection(lines)


def _histogram(
    figure: Figure, label: str, inches: tuple[float, ...], paint: Paint, edges: FloatArray, words: str
) -> None:
    axes = add_axes(figure, label, inches)
    values = paint.values[np.isfinite(paint.values)]
    count = 100.0 * np.histogram(np.clip(values, edges[0], edges[-1]), edges)[0] / max(len(values), 1)
    middle = 0.5 * (edges[1:] + edges[:-1])
    axes.bar(
        edges[:-1], count, np.diff(edges), align="edge", color=paint.colours_of(middle), edgecolor=FAINT, linewidth=0.2
    )
    axes.set(xscale="log" if edges[0] > 0 else "linear", xlim=(edges[0], edges[-1]))
    ticks = paint.ticks or []
    axes.set_xticks([], minor=True)
    axes.set_xticks([at for at, _ in ticks], labels=[text for _, text in ticks])
    axes.set_xlabel(paint.label[0], size=SMALL_SIZE, color=INK)
    axes.set_ylabel("triangles (%)", size=SMALL_SIZE - 1, color=INK)
    axes.tick_params(labelsize=SMALL_SIZE - 2, colors=FAINT)
    axes.spines[["top", "right"]].set_visible(False)
    write_text(axes, (0.5, 1.08), words, SMALL_SIZE, transform=axes.transAxes)


__all__ = [
    "alpha_paint",
    "beta_paint",
    "draw_box_plots",
    "draw_maps",
    "draw_study",
    "draw_textures",
    "make_box_plots",
    "make_maps_figure",
    "make_study_figure",
    "make_texture_figure",
    "show_surface",
    "texture_colours",
]
