"""Sub-regions on a page: their outlines and numbers on a map, and what was measured in each."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .fibrosis import ATRIUM, Fibrosis
from .flattening.flat_map import REGION_ARRAY
from .page import FAINT, INK, SMALL_SIZE, write_row, write_text
from .parcellation import Parcellation
from .template import Template, inside_polygon

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

OUTLINE_COLOUR = "#262626"
PLACES = 800
"""Places across the map at which parts are looked up."""
SMALLEST_PART = 12
"""Places of a part that is too small to be drawn."""
MOST_ROWS = 24
LONGEST_NAME = 24
"""Letters of a part's name that fit beside its number."""


def draw_outlines(axes: Axes, template: Template, parcellations: Iterable[Parcellation]) -> None:
    """Draw the borders of the parts of parcellations on a map of the template, each with its number.

    Raises
    ------
    TemplateError : a parcellation does not belong on the template.
    """
    centre, radius = np.array(template.outer.shape.centre), template.radius
    side = radius * (2.0 * (np.arange(PLACES) + 0.5) / PLACES - 1.0)
    x, y = np.meshgrid(centre[0] + side, centre[1] + side)
    places = np.stack([x.ravel(), y.ravel()], axis=1)
    on_map = (np.linalg.norm(places - centre, axis=1) <= radius).reshape(x.shape)
    for hole in template.holes.values():
        on_map &= ~inside_polygon(places, hole.shape.outline()).reshape(x.shape)
    for label, inside in _parts(parcellations, places, template):
        part = inside.reshape(x.shape) & on_map
        if np.count_nonzero(part) < SMALLEST_PART:
            continue
        # Masked off the map, so that rims are no borders of parts.
        drawn = np.ma.masked_array(inside.reshape(x.shape).astype(float), ~on_map)
        axes.contour(x, y, drawn, levels=[0.5], colors=[OUTLINE_COLOUR], linewidths=0.8, linestyles="dashed", zorder=6)
        write_text(axes, _inmost(part, x, y), str(label), SMALL_SIZE - 1.0, halo=True)


def list_parts(figure: Figure, found: Fibrosis, left: float, top: float) -> None:
    """Write the share beyond the first threshold of each part of the parcellations, as a column of the page.

    Parameters
    ----------
    left, top : of the list, inches on the page.
    """
    parts = [part for part in found.parts if part.group not in (ATRIUM, REGION_ARRAY)]
    if not parts:
        return
    sign = "≥" if found.rule.direction == "above" else "<"
    unit = f" {found.unit}" if found.unit else ""
    write_row(figure, top, [("sub-region", left), (f"{sign} {found.thresholds[0]:.4g}{unit} (%)", left + 1.25)], FAINT)
    for row, part in enumerate(parts[:MOST_ROWS]):
        name = part.name if len(part.name) <= LONGEST_NAME else f"{part.name[: LONGEST_NAME - 1]}…"
        share = "-" if np.isnan(part.beyond_percent) else f"{part.beyond_percent:.1f}"
        write_row(figure, top - 0.15 * (row + 1), [(f"{part.label} {name}", left), (share, left + 1.6)], INK)
    if len(parts) > MOST_ROWS:
        more = f"and {len(parts) - MOST_ROWS} more, in the table file"
        write_row(figure, top - 0.15 * (MOST_ROWS + 1), [(more, left)], FAINT)


def _parts(
    parcellations: Iterable[Parcellation], places: NDArray[np.float64], template: Template
) -> Iterator[tuple[int, NDArray[np.bool_]]]:
    """Label of each part, and whether each place is in it."""
    for parcellation in parcellations:
        if parcellation.overlapping:
            for part in parcellation.parts:
                yield part.label, parcellation.contains(part.name, places, template)
            continue
        labels = parcellation.labels_at(places, template)
        for part in parcellation.parts:
            yield part.label, labels == part.label


def _inmost(part: NDArray[np.bool_], x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[float, float]:
    """The place of a part that is farthest from its border."""
    from scipy.ndimage import distance_transform_edt

    at = np.unravel_index(int(np.argmax(distance_transform_edt(part))), part.shape)
    return float(x[at]), float(y[at])
