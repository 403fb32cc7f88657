"""Pages that show what is read off a map: classes of fibrosis or voltage, and two maps compared."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .comparison import Comparison
from .fibrosis import Fibrosis, on_atrium
from .figures import BORDER_COLOUR, INSIDE, RIM_COLOUR, VIEW_DOTS_PER_INCH
from .flattening.flat_map import REGION_ARRAY, FlatMap
from .map_data import MapData
from .page import (
    FAINT,
    HEADING_SIZE,
    INK,
    PAGE_INCHES,
    SMALL_SIZE,
    TEXT_SIZE,
    add_axes,
    digits,
    draw_line,
    new_page,
    rasterise_map,
    require_matplotlib,
    save_page,
    show_raster,
    write_heading,
    write_row,
    write_text,
)
from .parcel_figures import draw_outlines, list_parts
from .parcellation import Parcellation
from .quantities import readable
from .scalar_arrays import scalar_array
from .shading import NO_VALUE, FloatArray, Paint, label_of, rasterise, shade
from .surface import Surface
from .template import Template
from .views import PatientFrame, View

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NORMAL_COLOUR = "#c6dbef"
CLASS_COLOURS = {1: ("#c51b1b",), 2: ("#f2a93b", "#a50f15")}
"""Colours of the classes beyond normal, by their number; told apart with any colour blindness, and in print."""
ONLY_A, ONLY_B, BOTH, NEITHER = "#4477AA", "#EE8866", "#3b1f4a", "#e4e4e4"
BESIDE_A_MAP = ((0.2, 4.3, 3.7, 3.1), (0.2, 0.75, 3.7, 3.1))
WITHOUT_A_MAP = ((0.2, 2.2, 4.6, 4.8), (4.9, 2.2, 4.6, 4.8))
"""Where the two views of the atrium are: left, bottom, width, height in inches."""
MOST_CLASSES = 6
"""More columns do not fit: then the table shows what is beyond the first threshold, and the file has the rest."""
MOST_PARTS = 12
"""More lines of a table do not fit on the page."""


def draw_fibrosis(
    atrium: FlatMap | MapData | Surface,
    found: Fibrosis,
    path: Path | str,
    *,
    parcellations: Sequence[Parcellation] = (),
) -> None:
    """Write one page: classes on the atrium from behind and from the front, on its map, and areas by region.

    Parameters
    ----------
    atrium : what `measure_fibrosis` was given; of an atrium without a map, the map is left out.
    path : .png, .pdf or .svg.
    parcellations : sub-regions to outline on the map, as they were measured; each has its line.

    Raises
    ------
    TemplateError : a parcellation does not belong on the template of the map.
    MissingPackageError : matplotlib is not installed.
    InputFileError : another file type, or the file cannot be written.
    """
    save_page(path, lambda: make_fibrosis_figure(atrium, found, parcellations=parcellations))


def draw_comparison(found: Comparison, path: Path | str, *, names: tuple[str, str] = ("A", "B")) -> None:
    """Write one page: both maps with one colour bar, and their agreement by region; errors as `draw_fibrosis`.

    Parameters
    ----------
    names : what the maps are called on the page.
    """
    save_page(path, lambda: make_comparison_figure(found, names=names))


def draw_difference(found: Comparison, path: Path | str, *, names: tuple[str, str] = ("A", "B")) -> None:
    """Write one page: the difference B - A, and where both reach their thresholds; parameters as `draw_comparison`."""
    save_page(path, lambda: make_difference_figure(found, names=names))


def make_fibrosis_figure(
    atrium: FlatMap | MapData | Surface, found: Fibrosis, *, parcellations: Sequence[Parcellation] = ()
) -> Figure:
    """The page of `draw_fibrosis` as a matplotlib Figure, with axes "posterior", "anterior" (mm), "map" (map units)."""
    require_matplotlib()
    surface, data = on_atrium(atrium)
    paint = class_paint(surface, found)
    frame = data.frame if data is not None else PatientFrame.of(surface, {})
    title = f"{found.array}: {found.atrium.beyond_percent:.1f} % of the atrium {_beyond(found)}"
    figure = new_page(title, [*_facts(found), *([frame.fact] if frame.fact else [])])
    _views(figure, surface, frame.views, paint, BESIDE_A_MAP if data is not None else WITHOUT_A_MAP)
    if data is not None:
        axes = add_axes(figure, "map", (4.35, 1.75, 5.2, 5.2))
        _draw_map(axes, data, paint, bool(parcellations))
        draw_outlines(axes, data.template, parcellations)
        outer = data.template.anatomy.openings[data.template.anatomy.outer]
        write_heading(axes, f"Map, seen from outside (outer rim: {outer})", 0.2)
    _class_legend(figure, paint, found)
    _class_table(figure, found)
    list_parts(figure, found, 9.7, 5.35)
    return figure


def make_comparison_figure(found: Comparison, *, names: tuple[str, str] = ("A", "B")) -> Figure:
    """The page of `draw_comparison` as a matplotlib Figure, with axes "A", "B" (map units) and "colours"."""
    require_matplotlib()
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    a, b = found.scaled
    if found.scale == "ranks":
        low, high, label = 0.0, 100.0, "percentile on its own map, by area, from normal to diseased (%)"
    else:
        known = np.concatenate([a[np.isfinite(a)], b[np.isfinite(b)]])
        low, high = (float(x) for x in np.percentile(known, [1, 99]))
        label = label_of(found.array_a)
    if low == high:
        low, high = low - 0.5, high + 0.5
    whole = found.whole
    title = f"{names[0]} and {names[1]}: Pearson r = {digits(whole.pearson, 2)}, Spearman rho = "
    title += digits(whole.spearman, 2)
    figure = new_page(title, _comparison_facts(found))
    cmap, norm = colormaps["plasma"], Normalize(low, high)
    for letter, name, array, values, left in (
        ("A", names[0], found.array_a, a, 0.3), ("B", names[1], found.array_b, b, 5.3),
    ):  # fmt: skip
        axes = add_axes(figure, letter, (left, 2.75, 4.7, 4.7))
        _draw_grid(axes, found, cmap(norm(found.picture(values))), found.picture(values))
        write_heading(axes, f"{letter}: {name}, {array}", 0.05)
    bar = add_axes(figure, "colours", (10.35, 3.2, 0.17, 3.8))
    shown = figure.colorbar(ScalarMappable(norm, cmap), cax=bar, extend="neither" if low == 0.0 else "both")
    shown.set_label(label, size=TEXT_SIZE, color=INK, parse_math=False)
    bar.tick_params(labelsize=SMALL_SIZE, colors=INK)
    add_missing_legend(bar, bool(np.isnan(found.scaled).any()))
    _agreement_table(figure, found)
    return figure


def make_difference_figure(found: Comparison, *, names: tuple[str, str] = ("A", "B")) -> Figure:
    """The page of `draw_difference` as a matplotlib Figure, with axes "difference", "colours", and "overlap" where
    there are thresholds."""
    require_matplotlib()
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize, to_rgb
    from matplotlib.patches import Patch

    difference = found.picture(found.difference)
    reach = float(np.percentile(np.abs(found.difference[np.isfinite(found.difference)]), 99)) or 1.0
    unit = "percentiles" if found.scale == "ranks" else label_of(found.array_a)
    figure = new_page(f"{names[1]} minus {names[0]}", _comparison_facts(found))
    axes = add_axes(figure, "difference", (0.3, 2.75, 4.7, 4.7))
    cmap, norm = colormaps["RdBu_r"], Normalize(-reach, reach)
    _draw_grid(axes, found, cmap(norm(difference)), difference)
    write_heading(axes, "Difference, B minus A", 0.05)
    bar = add_axes(figure, "colours", (5.1, 3.2, 0.17, 3.8))
    shown = figure.colorbar(ScalarMappable(norm, cmap), cax=bar, extend="both")
    shown.set_label(f"difference, {unit}", size=TEXT_SIZE, color=INK, parse_math=False)
    bar.tick_params(labelsize=SMALL_SIZE, colors=INK)
    add_missing_legend(bar, bool(np.isnan(found.difference).any()))
    if found.threshold_a is not None and found.threshold_b is not None:
        known = np.isfinite(found.values_a) & np.isfinite(found.values_b)
        kinds = found.beyond_a + 2 * found.beyond_b
        grid = found.picture(np.where(known, kinds, np.nan))
        colours = np.array([to_rgb(one) for one in (NEITHER, ONLY_A, ONLY_B, BOTH)])
        axes = add_axes(figure, "overlap", (6.15, 2.75, 4.7, 4.7))
        _draw_grid(axes, found, colours[np.nan_to_num(grid).astype(int)], grid)
        dice = "no overlap is possible" if np.isnan(found.whole.dice) else f"Dice {found.whole.dice:.2f}"
        write_heading(axes, f"Overlap: {dice}", 0.05)
        sign_a, sign_b = ("≥" if side == "above" else "<" for side in (found.direction_a, found.direction_b))
        words = (
            f"only A ({found.array_a} {sign_a} {found.threshold_a:g})",
            f"only B ({found.array_b} {sign_b} {found.threshold_b:g})",
            "both",
            "neither",
        )
        handles = [Patch(facecolor=c, label=w) for c, w in zip((ONLY_A, ONLY_B, BOTH, NEITHER), words, strict=True)]
        axes.legend(
            handles=handles, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=4, frameon=False, fontsize=SMALL_SIZE,
            labelcolor=INK,
        )  # fmt: skip
    _agreement_table(figure, found)
    return figure


def class_paint(surface: Surface, found: Fibrosis) -> Paint:
    """The colours of the classes: bands whose borders are where the array, linear in each triangle, has a threshold."""
    from matplotlib.colors import BoundaryNorm, ListedColormap

    values, on_points = scalar_array(surface, found.array)
    limits, colours = list(found.thresholds), class_colours(found)
    if found.rule.direction == "below":
        limits, colours = limits[::-1], colours[::-1]
    known = values[np.isfinite(values)]
    # The outer bands end beyond every value.
    ends = [min(known.min(), limits[0]) - 1.0, max(known.max(), limits[-1]) + 1.0]
    norm = BoundaryNorm([ends[0], *limits, ends[1]], len(colours))
    return Paint(found.array, values, on_points, ListedColormap(colours), norm)


def class_colours(found: Fibrosis) -> list[str]:
    """A colour for each class, normal first."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    count = len(found.thresholds)
    if count in CLASS_COLOURS:
        return [NORMAL_COLOUR, *CLASS_COLOURS[count]]
    return [NORMAL_COLOUR, *(to_hex(one) for one in colormaps["YlOrRd"](np.linspace(0.3, 1.0, count)))]


# ---- parts of a page -------------------------------------------------------------------------------------------------


def _beyond(found: Fibrosis) -> str:
    """The first threshold in words."""
    unit = f" {found.unit}" if found.unit else ""
    return f"{'at' if found.rule.direction == 'above' else 'below'} {readable(found.thresholds[0])}{unit}" + (
        " or more" if found.rule.direction == "above" else ""
    )


def _facts(found: Fibrosis) -> list[str]:
    facts = [f"rule {found.rule}", "areas measured on the atrium in 3D"]
    if found.sampled_mm is not None:
        facts[-1] += f", image sampled every {found.sampled_mm:.1f} mm"
    whole = found.atrium
    if whole.missing_cm2 > 0.0:
        share = 100.0 * whole.missing_cm2 / (whole.missing_cm2 + whole.area_cm2)
        facts.append(f"{share:.1f} % of the atrium has no value and is left out")
    if found.blood_pool is not None:
        pool = found.blood_pool
        volume = f", {pool.volume_ml:.1f} ml" if pool.volume_ml is not None else ""
        facts.append(f"blood pool {readable(pool.mean)}, SD {readable(pool.sd)} ({pool.how}{volume})")
    return facts


def _comparison_facts(found: Comparison) -> list[str]:
    return [
        f"template {found.template.name}",
        "weighted by area on the atria",
        f"{found.whole.missing_percent:.1f} % of the area left out (no value)",
    ]


def _views(
    figure: Figure, surface: Surface, views: Sequence[View], paint: Paint, places: Sequence[tuple[float, ...]]
) -> None:
    """The atrium from behind and from the front, at one scale."""
    frames = [view.project(surface.points[surface.used_points])[:, :2] for view in views]
    size = np.array(places[0][2:])
    mm_per_inch = max(float((np.ptp(frame, axis=0) / (size - (0.6, 0.4))).max()) for frame in frames)
    for view, frame, place in zip(views, frames, places, strict=True):
        axes = add_axes(figure, view.name, place)
        low = 0.5 * (frame.min(axis=0) + frame.max(axis=0)) - 0.5 * mm_per_inch * size
        columns, rows = (int(count) for count in np.round(size * VIEW_DOTS_PER_INCH))
        projected = view.project(surface.points)
        raster = rasterise(
            projected, surface.triangles, low[0], low[1], mm_per_inch / VIEW_DOTS_PER_INCH, (rows, columns)
        )
        normals = view.project(surface.point_normals)
        colours = np.where(raster.front[:, None], paint.rgb(raster), INSIDE)
        show_raster(axes, raster, shade(raster, colours, raster.interpolate(normals)))
        for loop in surface.boundary_loops if surface.is_manifold else ():
            closed = np.append(loop, loop[0])
            draw_line(axes, raster.visible_part(projected[closed]), RIM_COLOUR, 1.2)
        left, right, bottom_mm, top = raster.extent
        axes.set(xlim=(left, right), ylim=(bottom_mm, top), xticks=[], yticks=[])
        axes.spines[:].set_visible(False)
        for side, x in (("left", 0.01), ("right", 0.99)) if view.ends else ():
            letter = view.ends[side][0].upper()
            write_text(axes, (x, 0.5), letter, TEXT_SIZE, FAINT, weight="bold", transform=axes.transAxes)
        write_heading(axes, view.heading, 0.1)
        x, y = left + 0.1 * mm_per_inch, bottom_mm + 0.05 * mm_per_inch
        axes.plot([x, x + 20.0], [y, y], color=INK, linewidth=2.0, solid_capstyle="butt")
        write_text(axes, (x + 10.0, y + 0.11 * mm_per_inch), "20 mm", SMALL_SIZE)


def _draw_map(axes: Axes, data: MapData, paint: Paint, has_parts: bool) -> None:
    """The map in colours; regions are named unless numbers of parts are in the way."""
    template = data.template
    raster = rasterise_map(data.flat, data.triangles)
    show_raster(axes, raster, paint.rgb(raster))
    draw_template(axes, template)
    if REGION_ARRAY in data.surface.cell_data and not has_parts:
        regions = np.asarray(data.surface.cell_data[REGION_ARRAY]).astype(np.int64)
        for region, (place, _) in raster.inmost_places(regions, raster.front).items():
            write_text(axes, place, f"R{region}", HEADING_SIZE, weight="bold", halo=True)


def _draw_grid(axes: Axes, found: Comparison, colours: FloatArray, values: FloatArray) -> None:
    """A picture of a comparison, grey where there is no value."""
    covered = np.zeros(values.shape, bool)
    covered[found.row, found.column] = True
    draw_grid(axes, found.template, colours, values, covered)


def draw_grid(
    axes: Axes,
    template: Template,
    colours: FloatArray,
    values: FloatArray,
    covered: NDArray[np.bool_],
    name_size: float = SMALL_SIZE - 1.0,
) -> None:
    """Values (rows, columns) over a template in their colours (rows, columns, 3 or 4): grey where they are NaN,
    transparent where there is no map."""
    from matplotlib.colors import to_rgb

    picture = np.ones((*values.shape, 4))
    picture[..., :3] = np.where(np.isnan(values)[..., None], to_rgb(NO_VALUE), colours[..., :3])
    picture[..., 3] = covered
    x, y = template.outer.shape.centre
    radius = template.radius
    axes.imshow(
        picture, extent=(x - radius, x + radius, y - radius, y + radius), origin="lower", interpolation="hanning",
        aspect="equal",
    )  # fmt: skip
    draw_template(axes, template, name_size)


def draw_template(axes: Axes, template: Template, name_size: float = SMALL_SIZE - 1.0) -> None:
    """Rims, borders of regions and names of openings, and the limits of the axes."""
    for path in template.anatomy.paths:
        draw_line(axes, template.segment(path), BORDER_COLOUR, 0.9)
    for opening in template.anatomy.openings:
        outline = template.rim(opening).shape.outline()
        draw_line(axes, np.concatenate([outline, outline[:1]]), RIM_COLOUR, 1.6)
    for hole, rim in template.holes.items():
        write_text(axes, rim.shape.centre, hole, name_size, weight="bold")
    centre, reach = np.array(template.outer.shape.centre), 1.02 * template.radius * np.array([-1.0, 1.0])
    axes.set(xlim=centre[0] + reach, ylim=centre[1] + reach, xticks=[], yticks=[])
    axes.spines[:].set_visible(False)


def _class_legend(figure: Figure, paint: Paint, found: Fibrosis) -> None:
    from matplotlib.patches import Patch

    labels = [textwrap.fill(found.class_label(k), 26) for k in range(len(found.class_names))]
    handles = [
        Patch(facecolor=colour, edgecolor=FAINT, linewidth=0.4, label=label)
        for colour, label in zip(class_colours(found), labels, strict=True)
    ]
    if paint.any_missing:
        handles.append(Patch(facecolor=NO_VALUE, label="no value"))
    figure.legend(
        handles=handles, loc="upper left", bbox_to_anchor=(9.65 / PAGE_INCHES[0], 6.9 / PAGE_INCHES[1]), frameon=False,
        fontsize=SMALL_SIZE, labelcolor=INK, title=label_of(found.array) if not found.unit else found.array,
        title_fontsize=TEXT_SIZE, alignment="left",
    )  # fmt: skip


def _class_table(figure: Figure, found: Fibrosis) -> None:
    """Areas by part, below the map."""
    columns = [("part", 4.15), ("area (cm2)", 6.7)]
    all_fit = len(found.class_names) <= MOST_CLASSES
    names = found.class_names if all_fit else (found.class_names[0], "beyond the first threshold")
    apart = 3.75 / max(3, len(names))
    columns += [(f"{name} (%)", 7.65 + apart * k) for k, name in enumerate(names)]
    write_row(figure, 1.52, columns, FAINT)
    shown = [part for part in found.parts if part.group in ("atrium", REGION_ARRAY)][:8]
    for number, part in enumerate(shown):
        name = part.name if part.group == "atrium" else f"R{part.label} {part.name}"
        shares = part.class_percent if all_fit else (part.class_percent[0], part.beyond_percent)
        numbers = [digits(share, 1) for share in shares]
        words = [name, f"{part.area_cm2:.1f}", *numbers]
        cells = [(word, at) for word, (_, at) in zip(words, columns, strict=True)]
        write_row(figure, 1.36 - 0.15 * number, cells, INK)


def add_missing_legend(bar: Axes, missing: bool) -> None:
    """Below a colour bar, the colour of places without a value, where there are some."""
    from matplotlib.patches import Patch

    if missing:
        bar.legend(
            handles=[Patch(facecolor=NO_VALUE, label="no value")], loc="upper left", bbox_to_anchor=(-1.0, -0.09),
            borderaxespad=0.0, handlelength=1.2, frameon=False, fontsize=SMALL_SIZE, labelcolor=INK,
        )  # fmt: skip


def _agreement_table(figure: Figure, found: Comparison) -> None:
    """Agreement by region, at the bottom."""
    unit = " (percentiles)" if found.scale == "ranks" else ""
    columns = [("part", 0.6), ("area (cm2)", 3.3), ("Pearson r", 4.2), ("Spearman rho", 5.1), ("mean A", 6.2)]
    columns += [("mean B", 7.0), (f"B - A{unit}: mean, SD", 7.8), ("left out (%)", 9.6), ("Dice", 10.6)]
    write_row(figure, 2.1, columns, FAINT)
    for number, part in enumerate(found.parts[:MOST_PARTS]):
        name = part.name if part.region == 0 else f"R{part.region} {part.name}"
        words = [name, f"{part.area_cm2:.1f}", f"{part.pearson:.3f}", f"{part.spearman:.3f}", readable(part.mean_a)]
        words += [readable(part.mean_b), f"{round(part.difference, 9) + 0.0:.3g}, {part.difference_sd:.3g}"]
        words += [f"{part.missing_percent:.1f}", f"{part.dice:.3f}"]
        cells = [(word.replace("nan", "-"), at) for word, (_, at) in zip(words, columns, strict=True)]
        write_row(figure, 1.9 - 0.18 * number, cells, INK)
