"""Pages that show three maps or more compared: side by side, and their mean and spread."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .analysis_figures import add_missing_legend, draw_grid
from .page import (
    FAINT,
    INK,
    SMALL_SIZE,
    TEXT_SIZE,
    add_axes,
    new_page,
    require_matplotlib,
    save_page,
    write_heading,
    write_row,
)
from .several_maps import SeveralMaps
from .shading import FloatArray, label_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap, Normalize
    from matplotlib.figure import Figure

MOST_MAPS = 12
"""More are too small to read on one page."""
MOST_IN_MATRIX = 6
"""Pairs of more maps are left to the table file."""
MOST_INCHES = 4.4
"""Side of the largest map."""
LONGEST_NAME = 22
"""Letters of a map's name that fit above it."""


def draw_several(found: SeveralMaps, path: Path | str) -> None:
    """Write one page: the maps side by side with one colour bar, and how each agrees with the first.

    Raises
    ------
    MissingPackageError : matplotlib is not installed.
    InputFileError : another file type, or the file cannot be written.
    """
    save_page(path, lambda: make_several_figure(found))


def draw_spread(found: SeveralMaps, path: Path | str) -> None:
    """Write one page: mean and standard deviation of the maps at each place; errors as `draw_several`."""
    save_page(path, lambda: make_spread_figure(found))


def make_several_figure(found: SeveralMaps) -> Figure:
    """The page of `draw_several` as a matplotlib Figure, with axes named by the numbers of the maps, from "1", and
    "colours"."""
    require_matplotlib()
    from matplotlib import colormaps

    count = min(len(found.names), MOST_MAPS)
    figure = new_page(f"{len(found.names)} maps: {label_of(found.array)}", _facts(found))
    # As large as the room of 10.0 by 6.9 inches allows.
    columns = max(range(1, count + 1), key=lambda c: min(10.0 / c, 6.9 / -(-count // c)))
    rows = -(-count // columns)
    side = min(10.0 / columns, 6.9 / rows, MOST_INCHES)
    cmap, norm = colormaps["plasma"], _norm(found.values)
    for number in range(count):
        row, column = divmod(number, columns)
        left = 0.25 + (10.0 - side * columns) / 2.0 + side * column
        bottom = 7.55 - side * (row + 1)
        axes = add_axes(figure, str(number + 1), (left + 0.05, bottom + 0.42, side - 0.1, side - 0.7))
        values = found.values[number]
        draw_grid(axes, found.template, cmap(norm(values)), values, found.covered, name_size=1.6 * side)
        write_heading(axes, f"{number + 1}: {_short(found.names[number])}", 0.08)
        axes.set_xlabel(_with_first(found, number), fontsize=SMALL_SIZE, color=FAINT, parse_math=False, labelpad=3.0)
    _colour_bar(figure, "colours", 10.45, cmap, norm, label_of(found.array), bool(np.isnan(_shown(found)).any()))
    if len(found.names) > count:
        words = f"The first {count} of {len(found.names)} maps; all are in the tables."
        write_row(figure, 0.42, [(words, 0.6)], FAINT)
    return figure


def make_spread_figure(found: SeveralMaps) -> Figure:
    """The page of `draw_spread` as a matplotlib Figure, with axes "mean", "SD" (map units) and their colour bars."""
    require_matplotlib()
    from matplotlib import colormaps

    figure = new_page(f"Mean and spread of {len(found.names)} maps", _facts(found))
    missing = bool(np.isnan(found.mean[found.covered]).any())
    for label, heading, values, left, name in (
        ("mean", "Mean", found.mean, 0.3, "plasma"),
        ("SD", "Standard deviation between the maps", found.sd, 5.85, "viridis"),
    ):
        norm, cmap = _norm(values, from_zero=label == "SD"), colormaps[name]
        axes = add_axes(figure, label, (left, 2.85, 4.6, 4.6))
        draw_grid(axes, found.template, cmap(norm(values)), values, found.covered)
        write_heading(axes, heading, 0.05)
        words = f"{'SD of ' if label == 'SD' else ''}{label_of(found.array)}"
        _colour_bar(figure, f"{label} colours", left + 4.65, cmap, norm, words, missing)
    _part_table(figure, found)
    _matrix(figure, found)
    return figure


def _facts(found: SeveralMaps) -> list[str]:
    facts = [
        f"template {found.template.name}",
        "weighted by area on the atria",
        f"1 is the reference: {found.names[0]}",
    ]
    if methods := sorted({method for method in found.methods if method}):
        facts.insert(0, f"method {' and '.join(methods)}")
    return facts


def _with_first(found: SeveralMaps, number: int) -> str:
    """How a map agrees with the reference."""
    if number == 0:
        return "reference"
    whole = found.with_reference(number)
    words = f"with 1: r = {whole.pearson:.2f}, rho = {whole.spearman:.2f}"
    if found.threshold is not None:
        words += f", Dice {whole.dice:.2f}"
    return words.replace("nan", "-")


def _shown(found: SeveralMaps) -> FloatArray:
    """The values of the maps that are drawn."""
    return found.values[:MOST_MAPS, found.covered]


def _norm(values: FloatArray, from_zero: bool = False) -> Normalize:
    from matplotlib.colors import Normalize

    known = values[np.isfinite(values)]
    low, high = (float(x) for x in np.percentile(known, [1, 99])) if len(known) else (0.0, 1.0)
    low = 0.0 if from_zero else low
    return Normalize(low, high) if low < high else Normalize(low - 0.5, low + 0.5)


def _colour_bar(
    figure: Figure, label: str, left: float, cmap: Colormap, norm: Normalize, words: str, missing: bool
) -> Axes:
    from matplotlib.cm import ScalarMappable

    bar = add_axes(figure, label, (left, 3.3, 0.17, 3.6))
    shown = figure.colorbar(ScalarMappable(norm, cmap), cax=bar, extend="max" if norm.vmin == 0.0 else "both")
    shown.set_label(words, size=TEXT_SIZE, color=INK, parse_math=False)
    bar.tick_params(labelsize=SMALL_SIZE, colors=INK)
    add_missing_legend(bar, missing)
    return bar


def _part_table(figure: Figure, found: SeveralMaps) -> None:
    """Mean and spread by region, at the bottom left."""
    unit = f" ({found.unit})" if found.unit else ""
    columns = [("part", 0.5), (f"mean{unit}", 3.1), (f"SD between maps{unit}", 3.9), ("left out (%)", 5.3)]
    write_row(figure, 2.3, columns, FAINT)
    for number, part in enumerate(found.parts[:10]):
        name = part.name if part.region == 0 else f"R{part.region} {part.name}"
        words = [name, f"{part.mean:.4g}", f"{part.sd:.3g}", f"{part.missing_percent:.1f}"]
        cells = [(word.replace("nan", "-"), at) for word, (_, at) in zip(words, columns, strict=True)]
        write_row(figure, 2.1 - 0.17 * number, cells, INK)


def _matrix(figure: Figure, found: SeveralMaps) -> None:
    """Pearson's r of each pair, at the bottom right."""
    count = len(found.names)
    if count > MOST_IN_MATRIX:
        write_row(figure, 2.3, [("The agreement of each pair is in the tables.", 6.6)], FAINT)
        return
    columns = [("Pearson r", 6.6), *((str(k + 1), 9.0 + 0.4 * k) for k in range(count))]
    write_row(figure, 2.3, columns, FAINT)
    for row, values in enumerate(found.matrix("pearson")):
        words = [f"{row + 1}: {_short(found.names[row])}", *(f"{x:.2f}".replace("nan", "-") for x in values)]
        write_row(figure, 2.1 - 0.17 * row, [(word, at) for word, (_, at) in zip(words, columns, strict=True)], INK)


def _short(name: str) -> str:
    """The end of a long name, which tells files apart more often than its beginning."""
    return name if len(name) <= LONGEST_NAME else f"…{name[1 - LONGEST_NAME :]}"
