"""What all figures share: the page and its fonts, axes, headings, colour bars, lines and text."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ._version import __version__
from .errors import InputFileError, LAFlatteningError
from .files import atomic_write
from .shading import FloatArray, IntArray, Paint, Raster, rasterise

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FORMATS = (".png", ".pdf", ".svg")
PAGE_INCHES = (11.7, 8.3)
"""A4, landscape."""
DOTS_PER_INCH = 200
MAP_DOTS = 1200
TITLE_SIZE, HEADING_SIZE, TEXT_SIZE, SMALL_SIZE = 14.0, 11.0, 9.0, 8.0
"""Font sizes, points on the saved page."""
LONGEST_LINE = 170
"""Letters of small text that fit across the page."""
DISCLAIMER = "Not a medical device. For research."

INK, FAINT = "#1a1a1a", "#5f5f5f"


class MissingPackageError(LAFlatteningError):
    """A figure was asked for and matplotlib is not installed."""


def require_matplotlib() -> None:
    """Raise MissingPackageError where matplotlib is not installed."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as error:
        raise MissingPackageError(
            'Figures need matplotlib, which is not installed: pip install "laflattening[figures]". '
            "Without a figure, everything else works."
        ) from error


def check_figure_path(path: Path | str) -> None:
    """Check that a figure of this name can be drawn here, before any other work.

    Raises
    ------
    InputFileError : the ending is none of `FORMATS`.
    MissingPackageError : matplotlib is not installed.
    """
    path = Path(path)
    if path.suffix.lower() not in FORMATS:
        raise InputFileError(
            f'{path}: expected a figure file ending in {", ".join(FORMATS)}; found "{path.suffix}". Change the ending.'
        )
    require_matplotlib()


def save_page(path: Path | str, make: Callable[[], Figure]) -> None:
    """Write the figure that `make` draws, as a whole or not at all; errors as for `check_figure_path`."""
    path = Path(path)
    check_figure_path(path)
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    # The drawing is within, so that a place that cannot be written to is found at once.
    with atomic_write(path) as temporary:
        figure = make()
        FigureCanvasAgg(figure)
        figure.savefig(temporary, format=path.suffix.lower()[1:], dpi=DOTS_PER_INCH, facecolor="white")


def new_page(title: str, facts: Sequence[str] = ()) -> Figure:
    """A page with its title, and facts, disclaimer and version at the bottom."""
    require_matplotlib()
    from matplotlib.figure import Figure

    figure = Figure(figsize=PAGE_INCHES, dpi=DOTS_PER_INCH, facecolor="white")
    centred: dict[str, Any] = {"ha": "center", "va": "center", "parse_math": False}
    figure.text(0.5, 1.0 - 0.32 / PAGE_INCHES[1], title, size=TITLE_SIZE, color=INK, **centred)
    # Held together by spaces at which no line is broken.
    closing = "\N{NO-BREAK SPACE}".join(f"{DISCLAIMER} · LAFlattening {__version__}".split())
    text = textwrap.fill("  ·  ".join([*facts, closing]), LONGEST_LINE)
    figure.text(0.5, 0.2 / PAGE_INCHES[1], text, size=SMALL_SIZE, color=FAINT, **centred)
    return figure


def add_axes(figure: Figure, label: str, inches: tuple[float, ...]) -> Axes:
    """Empty axes with a label, at left, bottom, width and height in inches on the page."""
    left, bottom, width, height = inches
    page_width, page_height = PAGE_INCHES
    axes = figure.add_axes((left / page_width, bottom / page_height, width / page_width, height / page_height))
    axes.set_label(label)
    axes.patch.set_visible(False)
    axes.grid(False)
    return axes


def write_heading(axes: Axes, text: str, inches: float) -> None:
    """A line of text above some axes."""
    from matplotlib.transforms import ScaledTranslation

    up = ScaledTranslation(0.0, inches, axes.figure.dpi_scale_trans)
    write_text(axes, (0.5, 1.0), text, HEADING_SIZE, transform=axes.transAxes + up)


def fill_colour_bar(axes: Axes, paint: Paint, orientation: str) -> None:
    """Fill some axes with the colour bar of a paint."""
    from matplotlib.cm import ScalarMappable

    mappable = ScalarMappable(paint.norm, paint.cmap)
    bar = axes.figure.colorbar(mappable, cax=axes, orientation=orientation, extend=paint.extend, extendfrac=0.03)
    bar.set_label(paint.label, size=TEXT_SIZE, color=INK, parse_math=False)
    if paint.ticks is not None:
        bar.set_ticks([at for at, _ in paint.ticks], labels=[text for _, text in paint.ticks])
        bar.minorticks_off()
    axes.tick_params(labelsize=SMALL_SIZE, colors=INK, length=0 if paint.classes else 3)
    bar.outline.set(edgecolor=FAINT, linewidth=0.6)


def rasterise_map(flat: FloatArray, triangles: IntArray) -> Raster:
    """The pixels of a map with points (n, 2) and triangles (m, 3), `MAP_DOTS` across."""
    low, high = flat.min(axis=0), flat.max(axis=0)
    pixel = float((high - low).max()) / MAP_DOTS
    columns, rows = (int(count) for count in np.ceil((high - low) / pixel))
    return rasterise(flat, triangles, low[0], low[1], pixel, (rows, columns))


def show_raster(axes: Axes, raster: Raster, colours: FloatArray) -> None:
    """Put a coloured raster into some axes, transparent where there is no surface."""
    picture = np.full((*raster.triangle.shape, 4), 255, np.uint8)
    picture[..., 3] *= raster.covered
    picture[raster.covered, :3] = np.round(colours * 255.0)
    axes.imshow(picture, extent=raster.extent, origin="lower", interpolation="hanning", aspect="equal")


def draw_line(axes: Axes, line: FloatArray, colour: str, width: float) -> None:
    """A line with a light edge, so that it stands out from any colour."""
    for order, (stroke, wide) in enumerate([("white", width + 1.0), (colour, width)]):
        axes.plot(
            *line.T, color=stroke, linewidth=wide, solid_capstyle="round", solid_joinstyle="round", zorder=3 + order
        )


def digits(value: float, places: int) -> str:
    """A number for people, a dash where there is none."""
    return "-" if np.isnan(value) else f"{value:.{places}f}"


def write_text(
    axes: Axes, place: Any, text: str, size: float, colour: str = INK, halo: bool = False, **options: Any
) -> None:
    """Text centred at a place, which is never read as a formula; with a halo it stands out from any colour."""
    from matplotlib.patheffects import withStroke

    options.setdefault("ha", "center")
    options.setdefault("va", "center")
    written = axes.text(place[0], place[1], text, size=size, color=colour, parse_math=False, zorder=8, **options)
    if halo:
        written.set_path_effects([withStroke(linewidth=2.4, foreground="white", alpha=0.85)])


def write_row(figure: Figure, height: float, cells: Sequence[tuple[str, float]], colour: str) -> None:
    """A line of a table: texts that begin at inches from the left, at a height in inches."""
    for text, left in cells:
        figure.text(
            left / PAGE_INCHES[0], height / PAGE_INCHES[1], text, size=SMALL_SIZE, color=colour, ha="left", va="center",
            parse_math=False,
        )  # fmt: skip
