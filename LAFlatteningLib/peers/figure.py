"""One page with all maps of an atrium side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .._version import __version__
from ..figures import FOLD_COLOUR, RIM_COLOUR
from ..page import (
    DOTS_PER_INCH,
    FAINT,
    HEADING_SIZE,
    INK,
    PAGE_INCHES,
    SMALL_SIZE,
    TITLE_SIZE,
    add_axes,
    draw_line,
    fill_colour_bar,
    rasterise_map,
    require_matplotlib,
    save_page,
    show_raster,
    write_text,
)
from ..shading import Paint, region_paint
from .peer_map import PeerMap
from .table import PeerRow, PeerTable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = 4
SIDE = 2.45
"""Side of a map, inches."""


def draw_peers(table: PeerTable, path: Path | str) -> None:
    """Write one page: the atrium on every map, regions in our colours, folded triangles marked, with figures below.

    Parameters
    ----------
    path : .png, .pdf or .svg; A4 landscape. Written in one go: never a partial file.

    Raises
    ------
    MissingPackageError : matplotlib is not installed.
    InputFileError : another file type, or the file cannot be written.
    """
    save_page(path, lambda: make_peers_figure(table))


def make_peers_figure(table: PeerTable) -> Figure:
    """The page of `draw_peers` as a matplotlib Figure; its axes have the names of the maps as labels."""
    require_matplotlib()
    from matplotlib.figure import Figure

    figure = Figure(figsize=PAGE_INCHES, dpi=DOTS_PER_INCH, facecolor="white")
    width, height = PAGE_INCHES
    figure.text(
        0.5, 1.0 - 0.32 / height, "One atrium on the maps in use", size=TITLE_SIZE, color=INK, ha="center", va="center"
    )
    anatomy = table.flat_map.template.anatomy
    for k, (found, row) in enumerate(zip(table.maps, table.rows, strict=True)):
        left = 0.25 + (width - 0.5) / COLUMNS * (k % COLUMNS + 0.5) - 0.5 * SIDE
        bottom = (4.7, 1.05)[k // COLUMNS]
        axes = add_axes(figure, found.name, (left, bottom, SIDE, SIDE))
        _draw(axes, found, row, region_paint(found.regions, anatomy))
    paint = region_paint(table.maps[0].regions, anatomy)
    bar = add_axes(figure, "colours", (width - 2.6, 1.05, 0.17, SIDE))
    fill_colour_bar(bar, paint, "vertical")
    facts = (
        "red: folded triangles  ·  green: rims of the openings  ·  spots lost: of "
        f"{table.rows[0].spots} on the atrium, none of whose pixels is left  ·  Not a medical device. For research."
        f"  ·  LAFlattening {__version__}"
    )
    figure.text(0.5, 0.25 / height, facts, size=SMALL_SIZE, color=FAINT, ha="center", va="center", parse_math=False)
    return figure


def _draw(axes: Axes, found: PeerMap, row: PeerRow, paint: Paint) -> None:
    from matplotlib.colors import to_rgb

    raster = rasterise_map(found.points, found.triangles)
    colours = paint.rgb(raster)
    folded = np.isin(raster.triangle[raster.covered], found.folded_triangles)
    colours[folded] = to_rgb(FOLD_COLOUR)
    show_raster(axes, raster, colours)
    for loop in found.rims.values():
        draw_line(axes, found.points[np.append(loop, loop[0])], RIM_COLOUR, 1.0)
    for region, (place, room) in raster.inmost_places(found.regions, raster.front).items():
        if room > 0.05 * found.half_width:
            write_text(axes, place, f"R{region}", SMALL_SIZE, weight="bold", halo=True)
    if len(found.folded_triangles):
        centres = found.points[found.triangles[found.folded_triangles]].mean(axis=1)
        axes.plot(*centres.T, ls="", marker=".", color=FOLD_COLOUR, markersize=1.5, zorder=5)
    points = found.points
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    reach = 1.03 * found.half_width * np.array([-1.0, 1.0])
    axes.set(xlim=centre[0] + reach, ylim=centre[1] + reach, xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    write_text(axes, (0.5, 1.08), found.title, HEADING_SIZE - 1.0, transform=axes.transAxes)
    places = "veins at standard places" if row.standardised else "veins anywhere"
    lines = (
        f"{places}  ·  {row.folded_triangles} folded",
        f"alpha entropy {row.alpha_entropy:.2f}  ·  beta {row.beta_mean:.2f}",
        f"{row.spots_lost} spots lost  ·  {row.seconds:.1f} s",
    )
    for k, line in enumerate(lines):
        write_text(axes, (0.5, -0.06 - 0.07 * k), line, SMALL_SIZE, transform=axes.transAxes)
