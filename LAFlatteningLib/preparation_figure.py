"""A picture of a preparation: what was kept of the atrium, what was cut off, the openings and the seeds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ._version import __version__
from .anatomy import LEFT_ATRIUM
from .carrying import closest_points
from .figures import INSIDE, RIM_COLOUR
from .page import FAINT, HEADING_SIZE, INK, SMALL_SIZE, TEXT_SIZE, TITLE_SIZE, save_page, write_text
from .preparation import Preparation
from .shading import BoolArray, FloatArray, Raster, rasterise, shade
from .surface import Surface
from .views import PatientFrame, View

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAGE_INCHES = (11.7, 6.0)
PIXELS = 900
"""Along the longer side of a view."""
KEPT, CUT_OFF = (0.86, 0.64, 0.56), (0.72, 0.74, 0.78)
CUT_OFF_MM = 0.05
"""Points farther than this from the cavity were cut off."""


def draw_preparation(preparation: Preparation, path: Path | str) -> None:
    """Write a page: the atrium from behind and from the front, kept and cut off, with openings and seeds.

    Parameters
    ----------
    preparation : at least its surface must have been reached; openings and seeds are drawn where there are any.
    path : .png, .pdf or .svg.

    Raises
    ------
    MissingPackageError, InputFileError : as for `figures.draw_figure`.
    """
    save_page(path, lambda: make_preparation_figure(preparation))


def make_preparation_figure(preparation: Preparation) -> Figure:
    """The page of `draw_preparation`; its axes are labelled "posterior" and "anterior" (mm), or as `View.name`."""
    from matplotlib.figure import Figure

    surface = preparation.surface or preparation.raw
    figure = Figure(figsize=PAGE_INCHES, facecolor="white")
    centred: dict[str, Any] = {"ha": "center", "va": "center", "parse_math": False}
    figure.text(0.5, 0.95, "Prepared atrium: kept, cut off, openings and seeds", size=TITLE_SIZE, color=INK, **centred)
    kept = np.ones(len(surface.points), bool)
    if preparation.cavity is not None:
        kept = closest_points(preparation.cavity, surface.points).distance_mm < CUT_OFF_MM
    openings = preparation.plan.openings if preparation.plan else {}
    places = {name: opening.plane.centre for name, opening in openings.items()}
    frame = PatientFrame.of(surface if preparation.cavity is None else preparation.cavity, places, LEFT_ATRIUM)
    for k, view in enumerate(frame.views):
        axes = figure.add_axes((0.03 + 0.48 * k, 0.16, 0.46, 0.7))
        axes.set_label(view.name)
        _draw_view(axes, preparation, surface, kept, view)
    facts = [f"{len(surface.points):,} points", f"{surface.area / 100:.0f} cm²"]
    if preparation.plan:
        rims = [f"{name} {opening.perimeter_mm:.0f} mm ({opening.found_by})" for name, opening in openings.items()]
        figure.text(0.5, 0.085, "perimeters: " + "  ·  ".join(rims), size=SMALL_SIZE, color=INK, **centred)
        facts.append(f"names: confidence {preparation.plan.confidence}")
    facts += [frame.fact] if frame.fact else []
    facts += ["grey: cut off", "dots: seeds", f"LAFlattening {__version__}"]
    figure.text(0.5, 0.035, "  ·  ".join(facts), size=SMALL_SIZE, color=FAINT, **centred)
    return figure


def _draw_view(axes: Axes, preparation: Preparation, surface: Surface, kept: np.ndarray, view: View) -> None:
    projected = view.project(surface.points)
    low, high = projected[:, :2].min(axis=0) - 8.0, projected[:, :2].max(axis=0) + 8.0
    pixel = float((high - low).max()) / PIXELS
    columns, rows = (int(count) for count in np.ceil((high - low) / pixel))
    raster = rasterise(projected, surface.triangles, low[0], low[1], pixel, (rows, columns))
    colours = np.where(raster.nearest(kept.astype(float))[:, None] > 0.5, KEPT, CUT_OFF)
    colours = np.where(raster.front[:, None], colours, INSIDE)
    image = np.ones((rows, columns, 3))
    image[raster.covered] = shade(raster, colours, raster.interpolate(view.project(surface.point_normals)))
    left, right, bottom, top = raster.extent
    axes.imshow(image, extent=(left, right, bottom, top), origin="lower", interpolation="antialiased")
    axes.set(xlim=(left, right), ylim=(bottom, top), xticks=[], yticks=[], aspect="equal")
    axes.spines[:].set_visible(False)
    axes.set_title(view.title, size=HEADING_SIZE, color=INK)
    words = f"patient's {view.ends['left']}  ←  mm  →  {view.ends['right']}" if view.ends else "mm"
    axes.set_xlabel(words, size=TEXT_SIZE, color=INK)
    if preparation.cavity is not None:
        for name, rim in preparation.rims.items():
            line = view.project(preparation.cavity.points[np.append(rim, rim[0])])
            seen = raster.is_visible(line)
            shown = np.where(seen[:, None], line[:, :2], np.nan)
            axes.plot(shown[:, 0], shown[:, 1], color=RIM_COLOUR, linewidth=1.8)
            if seen.mean() > 0.3:
                write_text(axes, _name_place(line, seen, raster), name, TEXT_SIZE, halo=True, weight="bold")
    for label, place in preparation.seeds.items():
        at = view.project(place[None])
        if raster.is_visible(at)[0]:
            axes.plot(at[0, 0], at[0, 1], "o", color="white", markeredgecolor=INK, markersize=4.5)
            if label not in preparation.rims:
                write_text(axes, at[0, :2] + 2.5, label, TEXT_SIZE, halo=True, weight="bold")
    axes.plot([left + 4.0, left + 24.0], [bottom + 3.0] * 2, color=INK, linewidth=2.0)
    axes.text(left + 14.0, bottom + 5.0, "20 mm", size=SMALL_SIZE, color=INK, ha="center", va="bottom")


def _name_place(line: FloatArray, seen: BoolArray, raster: Raster) -> FloatArray:
    """Where to write the name of an opening, (2,): in its middle, or on the part of its rim that is seen where the wall
    hides that.

    Parameters
    ----------
    line : (k, 3) its rim, projected.
    seen : (k,) which of that is seen; some of it.
    """
    middle = line.mean(axis=0)
    if raster.is_visible(middle[None])[0]:
        return middle[:2]
    shown = line[seen, :2]
    return shown[np.linalg.norm(shown - shown.mean(axis=0), axis=1).argmin()]
