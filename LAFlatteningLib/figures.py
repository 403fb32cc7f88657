"""Figures of a map for people: the atrium beside its map, and how much the map distorts.

They need matplotlib (``pip install "laflattening[figures]"``), which is imported when a figure is asked for. No window,
no graphics card and no pyplot with its global state: figures can be made in a worker thread and within other programs.
Which colours are used, and why, is said in `LAFlatteningLib.shading`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from . import distortion
from ._version import __version__
from .division import label_regions
from .flattening.flat_map import FlatMap
from .page import (
    DOTS_PER_INCH,
    FAINT,
    HEADING_SIZE,
    INK,
    PAGE_INCHES,
    SMALL_SIZE,
    TEXT_SIZE,
    TITLE_SIZE,
    MissingPackageError,
    add_axes,
    check_figure_path,
    draw_line,
    fill_colour_bar,
    rasterise_map,
    require_matplotlib,
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
    array_paint,
    default_array,
    rasterise,
    region_paint,
    shade,
)
from .surface import Surface
from .views import OPPOSITE, View

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

VIEW_DOTS_PER_INCH = 400
"""Of the atrium before it is scaled down to the page, which smooths its outline."""
DIAGONAL = 0.8
"""An estimated direction of the patient that runs along both axes of the map, along the one as much as this share of
the other, is not written at either."""
INSIDE = (0.36, 0.36, 0.38)
"""The inner side of the wall, seen through an opening."""
BORDER_COLOUR, RIM_COLOUR, SEED_COLOUR, FOLD_COLOUR = "#111111", "#00b8a9", "#ffffff", "#d40000"


__all__ = [
    "MissingPackageError",
    "check_figure_path",
    "draw_distortion",
    "draw_figure",
    "make_distortion_figure",
    "make_figure",
]

# ---- what is called --------------------------------------------------------------------------------------------------


def draw_figure(flat_map: FlatMap, path: Path | str, *, array: str | None = None, title: str | None = None) -> None:
    """Write one page: the atrium from behind and from the front, and its map, in the same colours.

    Parameters
    ----------
    path : .png, .pdf or .svg; A4 landscape, 200 dots per inch. Written in one go: never a partial file.
    array : scalar point or cell array of ``flat_map.surface`` to colour by. Default: the first that is there of LGE,
        "scalars" and bipolar voltage, or else the regions.
    title : default: names the chamber and the array.

    Raises
    ------
    MissingPackageError : matplotlib is not installed.
    InputFileError : another file type, or the file cannot be written.
    LAFlatteningError : no such array, or not a scalar one.
    """
    save_page(path, lambda: make_figure(flat_map, array=array, title=title))


def draw_distortion(flat_map: FlatMap, path: Path | str) -> None:
    """Write one page: the map coloured by area ratio (alpha) and by isotropy (beta), with their histograms.

    Parameters and errors as for `draw_figure`. Definitions: `LAFlatteningLib.distortion`.
    """
    save_page(path, lambda: make_distortion_figure(flat_map))


def make_figure(flat_map: FlatMap, *, array: str | None = None, title: str | None = None) -> Figure:
    """The page of `draw_figure` as a matplotlib Figure, to show or to change.

    Its axes are labelled "posterior", "anterior" (data coordinates: mm; or as `views.View.name`), "map" (map units) and
    "colours".
    """
    require_matplotlib()
    anatomy, surface = flat_map.template.anatomy, flat_map.surface
    array = default_array(surface) if array is None else array
    # Regions end at the paths, which cross triangles; arrays belong to the points of the cavity.
    mesh = _Drawn.cut(flat_map) if array is None else _Drawn.whole(flat_map)
    paint = region_paint(mesh.regions, anatomy) if array is None else array_paint(surface, array)
    chamber = anatomy.name.replace("_", " ").capitalize()
    figure = _new_page(flat_map, title or f"{chamber} and its standard map: {paint.label}")
    views = flat_map.frame.views
    frames = [view.project(surface.points[surface.used_points])[:, :2] for view in views]
    size = np.array([3.75, 3.2])
    # Both views at one scale, with room for the names round the atrium.
    mm_per_inch = max(float((np.ptp(frame, axis=0) / (size - (0.95, 0.55))).max()) for frame in frames)
    for view, frame, bottom in zip(views, frames, (4.15, 0.5), strict=True):
        axes = add_axes(figure, view.name, (0.2, bottom, *size))
        low = 0.5 * (frame.min(axis=0) + frame.max(axis=0)) - 0.5 * mm_per_inch * size
        columns, rows = (int(count) for count in np.round(size * VIEW_DOTS_PER_INCH))
        pixel = mm_per_inch / VIEW_DOTS_PER_INCH
        projected = view.project(mesh.surface.points)
        raster = rasterise(projected, mesh.surface.triangles, low[0], low[1], pixel, (rows, columns))
        _draw_view(axes, flat_map, mesh, paint, view, raster, mm_per_inch)
    axes = add_axes(figure, "map", (4.6, 1.3, 5.75, 5.75))
    _draw_map(axes, flat_map, mesh, paint, rasterise_map(mesh.flat, mesh.surface.triangles))
    write_heading(axes, f"Map, seen from outside (outer rim: {anatomy.openings[anatomy.outer]})", 0.45)
    _legend(axes, paint)
    fill_colour_bar(add_axes(figure, "colours", (10.5, 1.75, 0.17, 4.7)), paint, "vertical")
    names = [f"R{number} {name}" for number, name in sorted(anatomy.region_names.items())]
    if paint.extend != "neither":
        names.append("pointed ends of the colour bar: values beyond it")
    figure.text(
        0.5, 0.38 / PAGE_INCHES[1], "  ·  ".join(names), size=SMALL_SIZE, color=INK, ha="center", va="center",
        parse_math=False,
    )  # fmt: skip
    return figure


def make_distortion_figure(flat_map: FlatMap) -> Figure:
    """The page of `draw_distortion` as a matplotlib Figure.

    Its axes are labelled "alpha", "beta" (map units), "alpha colours", "beta colours", "alpha histogram" and
    "beta histogram".
    """
    require_matplotlib()
    from matplotlib import colormaps
    from matplotlib.colors import LogNorm, Normalize

    figure = _new_page(flat_map, "How much the map changes areas and angles")
    drawn = _Drawn.whole(flat_map)
    mesh = (flat_map.surface.points, flat_map.triangles, flat_map.points)
    quoted = distortion.summary(*mesh)
    a, b = quoted["alpha"], quoted["beta"]
    # Whole octaves, as many as hold 90 % of the triangles, alike for shrunk and enlarged.
    octaves = int(np.clip(np.ceil(np.abs(np.log2(np.maximum([a["p5"], a["p95"]], 2.0**-6))).max()), 1, 6))
    edge, powers = 2.0**-octaves, range(-octaves, octaves + 1)
    ticks = [(2.0**power, f"1/{2**-power}" if power < 0 else f"{2**power}") for power in powers]
    ticks[0], ticks[-1] = (ticks[0][0], f"≤ {ticks[0][1]}"), (ticks[-1][0], f"≥ {ticks[-1][1]}")
    alpha = distortion.area_ratio(*mesh)
    alpha[alpha < edge] = edge
    label, norm = "smaller on the map  ←  α  →  larger on the map", LogNorm(edge, 1.0 / edge)
    alpha_paint = Paint(label, alpha, False, colormaps["PuOr_r"], norm, ticks)
    label, ticks = "stretched one way  ←  β  →  angles kept", [(fifth / 5, f"{fifth / 5:.1f}") for fifth in range(6)]
    beta_paint = Paint(label, distortion.isotropy(*mesh), False, colormaps["cividis"], Normalize(0.0, 1.0), ticks)
    alpha_heading = "Area ratio α: share of the map's area over share of the surface's"
    alpha_numbers = f"median {a['median']:.2f}, 5 to 95 %: {a['p5']:.2f} to {a['p95']:.2f}"
    beta_heading = "Isotropy β: smallest over largest stretch"
    beta_numbers = f"median {b['median']:.2f}, mean {b['mean']:.2f}, 5 %: {b['p5']:.2f}"
    alpha_bins, beta_bins = 2.0 ** np.linspace(-octaves, octaves, 49), np.linspace(0.0, 1.0, 49)
    raster = rasterise_map(drawn.flat, drawn.surface.triangles)
    for left, name, heading, paint, bins, numbers in (
        (0.95, "alpha", alpha_heading, alpha_paint, alpha_bins, alpha_numbers),
        (6.75, "beta", beta_heading, beta_paint, beta_bins, beta_numbers),
    ):
        axes = add_axes(figure, name, (left, 2.95, 4.3, 4.3))
        _draw_map(axes, flat_map, drawn, paint, raster)
        write_heading(axes, heading, 0.2)
        fill_colour_bar(add_axes(figure, f"{name} colours", (left, 0.98, 4.3, 0.12)), paint, "horizontal")
        _histogram(add_axes(figure, f"{name} histogram", (left, 1.15, 4.3, 0.95)), paint, bins, numbers)
    return figure


# ---- the atrium ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Drawn:
    """The mesh that is drawn: surface, map positions of its points, region of each triangle."""

    surface: Surface
    flat: FloatArray
    regions: IntArray

    @classmethod
    def whole(cls, flat_map: FlatMap) -> _Drawn:
        """The triangles of the cavity."""
        return cls(flat_map.surface, flat_map.points, flat_map.regions)

    @classmethod
    def cut(cls, flat_map: FlatMap) -> _Drawn:
        """The triangles as the paths cut them."""
        regions = label_regions(flat_map.division, flat_map.template.anatomy)
        return cls(flat_map.division.surface, flat_map.solution, regions)


def _draw_view(
    axes: Axes, flat_map: FlatMap, mesh: _Drawn, paint: Paint, view: View, raster: Raster, mm_per_inch: float
) -> None:
    """The atrium with its paths, rims, seeds and names; page units are mm."""
    division, outer = flat_map.division, flat_map.template.anatomy.outer
    normals = view.project(mesh.surface.point_normals)
    line_points = view.project(division.surface.points)
    line_normals = view.project(division.surface.point_normals)
    colours = np.where(raster.front[:, None], paint.rgb(raster), INSIDE)
    show_raster(axes, raster, shade(raster, colours, raster.interpolate(normals)))
    left, right, bottom, top = raster.extent
    axes.set(xlim=(left, right), ylim=(bottom, top), xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    for ids in division.paths.values():
        draw_line(axes, raster.visible_part(line_points[ids], line_normals[ids]), BORDER_COLOUR, 1.1)
    corners = {"left": (0.01, 0.5), "right": (0.99, 0.5), "top": (0.5, 0.97), "bottom": (0.5, 0.03)}
    marks = [(corners[side], direction) for side, direction in view.ends.items()]
    small = np.array([0.1, 0.08]) * mm_per_inch
    seeds = view.project(np.array(list(flat_map.seeds.positions.values())))
    seeds = seeds[raster.is_visible(seeds), :2]
    # What is written keeps clear of these: centres and half sizes.
    boxes = [(np.array([left + at[0] * (right - left), bottom + at[1] * (top - bottom)]), small) for at, _ in marks]
    boxes += [(seed, 0.4 * small) for seed in seeds]
    for region, (place, room) in raster.inmost_places(mesh.regions, raster.front).items():
        if room > 0.13 * mm_per_inch:
            write_text(axes, place, f"R{region}", SMALL_SIZE, weight="bold", halo=True)
            boxes.append((place, small))
    for opening, loop in division.loops.items():
        rim = line_points[loop]
        outward = np.cross(rim - rim.mean(axis=0), np.roll(rim, -1, axis=0) - rim.mean(axis=0)).sum(axis=0)
        # Seen from outside, holes run counter-clockwise and the outer rim clockwise.
        outward *= (-1.0 if opening == outer else 1.0) / np.linalg.norm(outward)
        # Into an opening that faces the viewer one sees its whole rim; of others, the side towards the viewer.
        closed = np.append(loop, loop[0])
        line = raster.visible_part(line_points[closed], line_normals[closed] if outward[2] < -0.2 else None)
        draw_line(axes, line, RIM_COLOUR, 1.6)
        if np.isfinite(line[:, 0]).mean() > 0.4:
            half = np.array([0.035 * len(opening) + 0.04, 0.075]) * mm_per_inch
            place = _free_place(rim[:, :2], outward, half, boxes)
            boxes.append((place, half))
            write_text(axes, place, opening, TEXT_SIZE, weight="bold", halo=True)
    _seeds(axes, seeds)
    for at, direction in marks:
        write_text(axes, at, direction[0].upper(), TEXT_SIZE, FAINT, weight="bold", transform=axes.transAxes)
    write_heading(axes, view.heading, 0.15)
    bar = 20.0
    x, y = left + 0.1 * mm_per_inch, bottom + 0.05 * mm_per_inch
    axes.plot([x, x + bar], [y, y], color=INK, linewidth=2.0, solid_capstyle="butt")
    write_text(axes, (x + 0.5 * bar, y + 0.11 * mm_per_inch), f"{bar:g} mm", SMALL_SIZE)


def _free_place(
    rim: FloatArray, outward: FloatArray, half: FloatArray, boxes: list[tuple[FloatArray, FloatArray]]
) -> FloatArray:
    """Where to write the name of an opening: beside its rim (k, 2), on the side to which it opens, clear of others.

    Parameters
    ----------
    outward : (3,) where the opening faces, on the page.
    half : (2,) half the width and height of the text.
    boxes : centre and half size of the texts that are already there.
    """
    centre = rim.mean(axis=0)
    towards = np.arctan2(outward[1], outward[0])
    places = [centre] if np.hypot(outward[0], outward[1]) < 0.5 else []
    for distance in (1.0, 2.0):
        for turn in np.radians([0, 30, -30, 60, -60, 90, -90]):
            direction = np.array([np.cos(towards + turn), np.sin(towards + turn)])
            reach = float(((rim - centre) @ direction).max())
            places.append(centre + direction * (reach + distance * np.abs(direction) @ (half * (1.0, 1.4))))
    clear = (p for p in places if not any((np.abs(p - other) < half + size).all() for other, size in boxes))
    return next(clear, places[0])


# ---- the map ---------------------------------------------------------------------------------------------------------


def _draw_map(axes: Axes, flat_map: FlatMap, mesh: _Drawn, paint: Paint, raster: Raster) -> None:
    """The map with its paths, rims, seeds and names; page units are map units."""
    template, division, flat = flat_map.template, flat_map.division, flat_map.solution
    anatomy, radius = template.anatomy, template.radius
    show_raster(axes, raster, paint.rgb(raster))
    for ids in division.paths.values():
        draw_line(axes, flat[ids], BORDER_COLOUR, 1.3)
    for ids in division.loops.values():
        draw_line(axes, flat[np.append(ids, ids[0])], RIM_COLOUR, 2.2)
    for region, (place, _) in raster.inmost_places(mesh.regions, raster.front).items():
        write_text(axes, place, f"R{region}", HEADING_SIZE, weight="bold", halo=True)
    for opening in anatomy.holes:
        shape, order = template.rim(opening).shape, anatomy.feet(opening)
        arcs = template.rim(opening).arcs(order)
        # The name goes where most room is between two paths.
        start, end = max(arcs, key=lambda arc: arc[1] - arc[0]) if arcs else (0.0, 180.0)
        outline = shape.at(0.5 * (start + end))
        outward = (outline - shape.centre) / np.linalg.norm(outline - shape.centre)
        room = np.abs(outward) @ (0.016 * len(opening) + 0.035, 0.06) * radius
        write_text(axes, outline + room * outward, opening, TEXT_SIZE, weight="bold", halo=True)
        _seeds(axes, np.array([shape.centre]))
    for name, point in division.landmarks.items():
        _seeds(axes, flat[point][None])
        write_text(axes, flat[point] - (0.0, 0.06 * radius), name, TEXT_SIZE, weight="bold", halo=True)
    centre = np.array(template.outer.shape.centre)
    feet = division.loops[anatomy.outer][division.feet[anatomy.outer]]
    for seed, foot in zip(anatomy.outer_seeds, feet, strict=True):
        place = flat[foot]
        _seeds(axes, place[None])
        outward = (place - centre) / np.linalg.norm(place - centre)
        write_text(axes, place + np.abs(outward) @ (0.085, 0.055) * radius * outward, seed, SMALL_SIZE)
    _region_words(axes, flat_map)
    _map_axes(axes, flat_map)
    folded = flat_map.folded_triangles
    if len(folded):
        x, y = flat[flat_map.triangles[folded]].mean(axis=1).T
        axes.plot(x, y, "x", color=FOLD_COLOUR, markersize=4.0, markeredgewidth=1.0, zorder=6, gid="folded")


def _region_words(axes: Axes, flat_map: FlatMap) -> None:
    """The names of the regions at the outer rim, along it."""
    template = flat_map.template
    anatomy, shape = template.anatomy, template.outer.shape
    order = anatomy.feet(anatomy.outer)
    arcs = template.outer.arcs(order)
    for region, name in anatomy.region_names.items():
        for path, end in anatomy.face(region):
            if anatomy.opening_of(anatomy.paths[path][1 - end]) != anatomy.outer:
                continue
            middle = 0.5 * sum(arcs[order.index(path)])
            along = np.subtract(*shape.at([middle + 0.1, middle - 0.1]))
            outward = np.array([along[1], -along[0]]) / np.linalg.norm(along)
            place = shape.at(middle) + 0.05 * template.radius * outward
            turn = (np.degrees(np.arctan2(outward[1], outward[0])) + 180.0) % 180.0 - 90.0
            write_text(axes, place, name, TEXT_SIZE, rotation=turn, rotation_mode="anchor")


def _map_axes(axes: Axes, flat_map: FlatMap) -> None:
    """Ticks in disk radii, and at the ends of each axis the patient's directions in which it runs, if known."""
    shape, radius = flat_map.template.outer.shape, flat_map.template.radius
    flat, on_atrium = (points[flat_map.triangles].mean(axis=1) for points in (flat_map.points, flat_map.surface.points))
    area = flat_map.surface.triangle_areas[:, None]
    trend = (area * (on_atrium - (area * on_atrium).sum(axis=0) / area.sum())).T @ flat
    ends: tuple[list[str], list[str]] = ([], [])
    for name in ("right", "superior", "anterior") if flat_map.frame.axes is not None else ():
        along = flat_map.frame.direction(name) @ (trend / np.linalg.norm(trend, axis=0))
        axis = int(np.abs(along).argmax())
        if flat_map.frame.fact and abs(along[1 - axis]) > DIAGONAL * abs(along[axis]):
            continue
        ends[axis].append(name if along[axis] > 0 else OPPOSITE[name])
    ticks = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    for axis, side in enumerate(("bottom", "left")):
        middle = shape.centre[axis]
        low, high = ", ".join(OPPOSITE[name] for name in ends[axis]), ", ".join(ends[axis])
        whose = "patient's " if "left" in (low, high) else ""
        line = (axes.xaxis, axes.yaxis)[axis]
        words = f"{whose}{low}  ←  disk radii  →  {whose}{high}" if ends[axis] else "disk radii"
        line.set_label_text(words, size=TEXT_SIZE, color=INK)
        line.set_ticks(middle + ticks * radius, labels=[f"{tick:g}" for tick in ticks])
        (axes.set_xlim, axes.set_ylim)[axis](middle - 1.16 * radius, middle + 1.16 * radius)
        axes.spines[side].set(bounds=(middle - radius, middle + radius), edgecolor=FAINT)
    axes.tick_params(labelsize=SMALL_SIZE, colors=FAINT)
    axes.spines[["top", "right"]].set_visible(False)


def _histogram(axes: Axes, paint: Paint, edges: FloatArray, text: str) -> None:
    """How many triangles have which value, each bar in its colour; the end bars hold what lies beyond."""
    values = paint.values[np.isfinite(paint.values)]
    count = np.histogram(np.clip(values, edges[0], edges[-1]), edges)[0] * 100.0 / max(len(values), 1)
    middle = 0.5 * (edges[1:] + edges[:-1])
    axes.bar(
        edges[:-1], count, np.diff(edges), align="edge", color=paint.colours_of(middle), edgecolor=FAINT, linewidth=0.4
    )
    axes.set(xscale="log" if edges[0] > 0 else "linear", xlim=(edges[0], edges[-1]))
    axes.set_xticks([], minor=True)
    axes.set_xticks([])
    axes.set_ylabel("triangles (%)", size=SMALL_SIZE, color=INK)
    axes.tick_params(labelsize=SMALL_SIZE, colors=FAINT)
    axes.spines[["top", "right"]].set_visible(False)
    write_text(axes, (0.5, 1.1), text, SMALL_SIZE, transform=axes.transAxes)


# ---- the page --------------------------------------------------------------------------------------------------------


def _new_page(flat_map: FlatMap, title: str) -> Figure:
    """A page with its title, and one line on the map's making and quality at the bottom."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=PAGE_INCHES, dpi=DOTS_PER_INCH, facecolor="white")
    centred: dict[str, Any] = {"ha": "center", "va": "center", "parse_math": False}
    figure.text(0.5, 1.0 - 0.36 / PAGE_INCHES[1], title, size=TITLE_SIZE, color=INK, **centred)
    beta = distortion.isotropy(flat_map.surface.points, flat_map.triangles, flat_map.points)
    how = flat_map.method + (f", rounding {flat_map.rounding}" if flat_map.rounding else "")
    folded = len(flat_map.folded_triangles)
    facts = [
        f"method {how}",
        f"template {flat_map.template.name}",
        f"{len(flat_map.points):,} points, {len(flat_map.triangles):,} triangles",
        f"{folded or 'no'} folded triangle{'' if folded == 1 else 's'}",
        f"mean isotropy β {np.nanmean(beta):.2f} (1: angles kept)",
    ]
    if "total" in flat_map.seconds:
        facts.append(f"{flat_map.seconds['total']:.1f} s")
    facts.append(f"LAFlattening {__version__}")
    figure.text(0.5, 0.16 / PAGE_INCHES[1], "  ·  ".join(facts), size=SMALL_SIZE, color=FAINT, **centred)
    if flat_map.frame.fact:
        place = 1.0 - 0.6 / PAGE_INCHES[1]
        figure.text(0.5, place, flat_map.frame.fact, size=SMALL_SIZE, color=INK, **centred)
    return figure


def _legend(axes: Axes, paint: Paint) -> None:
    """What the lines and markers are, below the map."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Line2D([], [], color=BORDER_COLOUR, linewidth=1.5, label="border between regions"),
        Line2D([], [], color=RIM_COLOUR, linewidth=2.5, label="rim of an opening"),
        Line2D([], [], ls="", marker="o", markersize=5, mfc=SEED_COLOUR, mec=INK, label="seed"),
    ]
    if any(line.get_gid() == "folded" for line in axes.lines):
        handles.append(Line2D([], [], ls="", marker="x", color=FOLD_COLOUR, markersize=5, label="folded triangle"))
    if paint.any_missing:
        handles.append(Patch(facecolor=NO_VALUE, label="no value"))
    axes.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.085), ncols=len(handles), frameon=False,
        fontsize=SMALL_SIZE, labelcolor=INK,
    )  # fmt: skip


def _seeds(axes: Axes, places: FloatArray) -> None:
    axes.plot(*places.T, "o", color=SEED_COLOUR, markersize=4.2, markeredgecolor=INK, markeredgewidth=0.9, zorder=7)
