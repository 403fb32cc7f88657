"""A page that shows the gaps: the map with scar, search areas and paths, their lengths, and RGM over threshold."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._version import __version__
from ..figures import RIM_COLOUR
from ..flattening import FlatMap
from ..map_data import MapData
from ..page import (
    DOTS_PER_INCH,
    FAINT,
    INK,
    PAGE_INCHES,
    SMALL_SIZE,
    TITLE_SIZE,
    add_axes,
    draw_line,
    rasterise_map,
    require_matplotlib,
    save_page,
    show_raster,
    write_heading,
    write_text,
)
from ..shading import NO_VALUE, FloatArray, Raster, label_of
from .quantification import Encirclement, GapReport

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SCAR_COLOUR, HEALTHY_COLOUR = "#f0b35a", "#e9e9e9"
PATH_COLOUR, GAP_COLOUR, AREA_COLOUR = "#3a2a10", "#0a4fd0", "#7a7a7a"
CURVES = ("#4477AA", "#EE6677", "#228833", "#AA3377", "#66CCEE", "#CCBB44")
"""Line colours of P. Tol's "bright" scheme, told apart with any colour blindness."""
MOST_ROWS = 15
"""More lines of text do not fit below a map."""


def draw_gaps(
    flat_map: FlatMap | MapData, report: GapReport, path: Path | str, *, threshold: float | None = None
) -> None:
    """Write one page: the map with the paths round each vein and round pairs, gap lengths in mm, RGM over threshold.

    Parameters
    ----------
    flat_map : the map that `find_gaps` was given.
    path : .png, .pdf or .svg.
    threshold : the one shown on the maps; the middle one by default.

    Raises
    ------
    MissingPackageError : matplotlib is not installed.
    InputFileError : another file type, or the file cannot be written.
    """
    save_page(path, lambda: make_gap_figure(flat_map, report, threshold=threshold))


def make_gap_figure(flat_map: FlatMap | MapData, report: GapReport, *, threshold: float | None = None) -> Figure:
    """The page of `draw_gaps` as a matplotlib Figure, with axes "alone", "together" (where there are pairs), "RGM"."""
    require_matplotlib()
    from matplotlib.figure import Figure

    data = MapData.of(flat_map)
    level = report.thresholds[len(report.thresholds) // 2] if threshold is None else threshold
    rings = report.at(level)
    figure = Figure(figsize=PAGE_INCHES, dpi=DOTS_PER_INCH, facecolor="white")
    title = f"Gaps round the veins: scar is {report.scar_words(level)}"
    centred: dict[str, Any] = {"ha": "center", "va": "center", "parse_math": False}
    figure.text(0.5, 1.0 - 0.36 / PAGE_INCHES[1], title, size=TITLE_SIZE, color=INK, **centred)
    facts = [
        f"search areas {report.search}",
        *([f"gaps of {report.minimum_mm:g} mm or more are listed"] if report.minimum_mm else []),
        "Not a medical device. For research.",
        f"LAFlattening {__version__}",
    ]
    figure.text(0.5, 0.16 / PAGE_INCHES[1], "  ·  ".join(facts), size=SMALL_SIZE, color=FAINT, **centred)
    raster = rasterise_map(data.flat, data.triangles)
    values = data.point_values(report.array)
    alone = {name: ring for name, ring in rings.items() if len(ring.openings) == 1}
    together = {name: ring for name, ring in rings.items() if len(ring.openings) > 1}
    holes = data.template.holes
    left = 0.35
    for label, heading, some in (("alone", "Each vein", alone), ("together", "Veins together", together)):
        if some:
            axes = add_axes(figure, label, (left, 3.05, 4.4, 4.4))
            _draw(axes, data, raster, values, level, report.direction, some)
            write_heading(axes, heading, 0.05)
            _table(figure, left, some, [name for name in report.left_out if (name in holes) == (label == "alone")])
            left += 4.6
    _legend(figure, bool(np.isnan(values).any()))
    axes = add_axes(figure, "RGM", (9.95, 4.9, 1.55, 2.3))
    if len(report.thresholds) > 1:
        _curves(axes, report, level)
    else:
        _bars(axes, report)
    return figure


def _draw(
    axes: Axes,
    data: MapData,
    raster: Raster,
    values: FloatArray,
    level: float,
    direction: str,
    rings: dict[str, Encirclement],
) -> None:
    from matplotlib.collections import LineCollection
    from matplotlib.colors import to_rgb

    at = raster.interpolate(values)
    scar = at >= level if direction == "above" else at < level
    colours = np.where(scar[:, None], to_rgb(SCAR_COLOUR), to_rgb(HEALTHY_COLOUR))
    colours[np.isnan(at)] = to_rgb(NO_VALUE)
    show_raster(axes, raster, colours)
    for loop in data.surface.boundary_loops:
        draw_line(axes, data.flat[np.append(loop, loop[0])], RIM_COLOUR, 1.6)
    radius, centre = data.template.radius, np.array(data.template.outer.shape.centre)
    for ring in rings.values():
        border = LineCollection(list(ring.border_on_map), colors=AREA_COLOUR, linewidths=0.7, linestyles=":")
        axes.add_collection(border)
        draw_line(axes, np.append(ring.points_on_map, ring.points_on_map[:1], axis=0), PATH_COLOUR, 1.3)
        # Gaps too short for the list are thin.
        ways = np.stack([ring.points_on_map, np.roll(ring.points_on_map, -1, axis=0)], axis=1)[~ring.in_scar]
        axes.add_collection(LineCollection(list(ways), colors=GAP_COLOUR, linewidths=1.3, zorder=4.5))
    number = 1
    for name, ring in rings.items():
        middle = np.mean([data.template.holes[hole].shape.centre for hole in ring.openings], axis=0)
        for gap in ring.gaps:
            draw_line(axes, gap.points_on_map, GAP_COLOUR, 2.8)
            write_text(axes, _beside(gap.place_on_map, middle, radius), str(number), SMALL_SIZE, GAP_COLOUR, halo=True)
            number += 1
        if ring.complete:
            farthest = ring.points_on_map[np.linalg.norm(ring.points_on_map - centre, axis=1).argmax()]
            write_text(axes, _beside(farthest, middle, radius), f"{name}: complete", SMALL_SIZE, PATH_COLOUR, halo=True)
    for hole, rim in data.template.holes.items():
        write_text(axes, rim.shape.centre, hole, SMALL_SIZE - 1.0, weight="bold")
    axes.set(xlim=centre[0] + 1.02 * radius * np.array([-1, 1]), ylim=centre[1] + 1.02 * radius * np.array([-1, 1]))
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set_visible(False)


def _beside(place: FloatArray, middle: FloatArray, radius: float) -> FloatArray:
    """Where to write beside a place of a curve, on the side away from what it goes round."""
    outward = place - middle
    return place + 0.055 * radius * outward / max(float(np.linalg.norm(outward)), 1e-9)


def _table(figure: Figure, left: float, rings: dict[str, Encirclement], left_out: Sequence[str]) -> None:
    """The figures below a map: a line for each ring, and below it its gaps in two columns, by their numbers on it."""
    rows = {name: (len(ring.gaps) + 1) // 2 for name, ring in rings.items()}
    # Every ring keeps its line; where there are too many gaps, those with most show fewer.
    while sum(rows.values()) + len(rows) > MOST_ROWS - len(left_out):
        rows[max(rows, key=lambda name: rows[name])] -= 1
    line, first = 0, 1
    for name in left_out:
        _cell(figure, left + 0.1, line, f"{name}: not measured, no closed path (see the notes)", INK)
        line += 1
    for name, ring in rings.items():
        small = f", {ring.small_gaps} shorter" if ring.small_gaps else ""
        state = "complete" if ring.complete else f"gaps {ring.gap_length_mm:.1f} mm{small}"
        words = f"{name}: {state}, scar {ring.scar_length_mm:.1f} mm, RGM {ring.rgm:.2f}"
        _cell(figure, left + 0.1, line, words, INK)
        line += 1
        room = 2 * rows[name]
        listed = ring.gaps if len(ring.gaps) <= room else ring.gaps[: max(room - 1, 0)]
        # (There is no room for all parts that a long gap goes through.)
        where = [f"about {gap.segment}" if gap.where != gap.segment else gap.segment for gap in listed]
        cells = [
            (f"{first + k}   {gap.length_mm:.1f} mm   {words}", GAP_COLOUR)
            for k, (gap, words) in enumerate(zip(listed, where, strict=True))
        ]
        if len(listed) < len(ring.gaps) and room:
            cells.append((f"and {len(ring.gaps) - len(listed)} more: see the gap file", FAINT))
        for k, (text, colour) in enumerate(cells):
            _cell(figure, left + (0.25, 2.4)[k % 2], line + k // 2, text, colour)
        line += rows[name]
        first += len(ring.gaps)


def _cell(figure: Figure, inches: float, line: int, text: str, colour: str) -> None:
    """A text below the maps."""
    figure.text(
        inches / PAGE_INCHES[0], (2.9 - 0.165 * line) / PAGE_INCHES[1], text, size=SMALL_SIZE, color=colour,
        ha="left", va="top", parse_math=False,
    )  # fmt: skip


def _legend(figure: Figure, missing: bool) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Patch(facecolor=SCAR_COLOUR, label="scar"),
        Patch(facecolor=HEALTHY_COLOUR, edgecolor=FAINT, linewidth=0.4, label="healthy"),
        Line2D([], [], color=PATH_COLOUR, linewidth=1.5, label="path within scar"),
        Line2D([], [], color=GAP_COLOUR, linewidth=3.0, label="gap, numbered"),
        Line2D([], [], color=AREA_COLOUR, linewidth=0.9, linestyle=":", label="search area"),
        Line2D([], [], color=RIM_COLOUR, linewidth=2.0, label="rim of an opening"),
    ]
    if missing:
        handles.append(Patch(facecolor=NO_VALUE, label="no value (counts as healthy)"))
    figure.legend(
        handles=handles, loc="upper left", bbox_to_anchor=(9.55 / PAGE_INCHES[0], 3.2 / PAGE_INCHES[1]), frameon=False,
        fontsize=SMALL_SIZE, labelcolor=INK,
    )  # fmt: skip


def _bars(axes: Axes, report: GapReport) -> None:
    """RGM of each search area at the only threshold."""
    names = list(report.rings)
    values = [rings[0].rgm for rings in report.rings.values()]
    axes.barh(names, values, height=0.6, color=PATH_COLOUR)
    axes.invert_yaxis()
    for row, value in enumerate(values):
        axes.text(value + 0.03, row, f"{value:.2f}", size=SMALL_SIZE, color=INK, va="center")
    axes.set_xlim(0.0, 1.25)
    axes.set_xticks([0.0, 0.5, 1.0])
    axes.set_xlabel("relative gap measure\n(0 complete, 1 no scar)", size=SMALL_SIZE, color=INK)
    axes.tick_params(labelsize=SMALL_SIZE, colors=FAINT)
    axes.spines[["top", "right"]].set_visible(False)
    write_heading(axes, "RGM", 0.1)


def _curves(axes: Axes, report: GapReport, level: float) -> None:
    """RGM of each search area over the threshold."""
    for k, (name, rings) in enumerate(report.rings.items()):
        dashes = "-" if len(rings[0].openings) == 1 else "--"
        axes.plot(
            report.thresholds, [ring.rgm for ring in rings], dashes, marker="o", markersize=3.0, linewidth=1.2,
            color=CURVES[k % len(CURVES)], label=name,
        )  # fmt: skip
    axes.axvline(level, color=FAINT, linewidth=0.8, linestyle=":")
    axes.set_ylim(-0.03, 1.03)
    axes.set_xlabel(f"threshold of {label_of(report.array)}", size=SMALL_SIZE, color=INK, parse_math=False)
    axes.set_ylabel("relative gap measure (0 complete)", size=SMALL_SIZE, color=INK)
    axes.tick_params(labelsize=SMALL_SIZE, colors=FAINT)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(
        loc="upper center", bbox_to_anchor=(0.45, -0.22), ncols=2, frameon=False, fontsize=SMALL_SIZE - 1.0,
        labelcolor=INK, columnspacing=0.8, handlelength=1.4,
    )  # fmt: skip
    write_heading(axes, "RGM", 0.1)
