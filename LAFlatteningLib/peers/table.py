"""One atrium on every map, and one table of how they compare."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..errors import SurfaceError
from ..flattening import FlatMap, Flattener
from ..progress import ProgressCallback, part, report
from ..surface import FloatArray, Surface
from ..template import DEFAULT_TEMPLATE, Template
from .conformal import conformal_map
from .karim import square_map
from .ma import distance_map
from .peer_map import PeerMap, ours
from .spots import PIXELS, lost_spots, spots_on
from .sum_map import SumTemplate, sum_map
from .universal import universal_map


@dataclass(frozen=True)
class PeerRow:
    """What the table says of a map.

    Attributes
    ----------
    name, title : of the method.
    standardised : whether it puts the veins and the appendage at places of its own, the same in every atrium.
    drift_percent : root mean square distance of the openings from those places, in per cent of half the map's width;
        None where there are none.
    triangles, folded_triangles : of the map.
    alpha_entropy, beta_mean : see `distortion`.
    spots_lost, spots : see `spots.lost_spots`.
    seconds : from the surface to the map.
    """

    name: str
    title: str
    standardised: bool
    drift_percent: float | None
    triangles: int
    folded_triangles: int
    alpha_entropy: float
    beta_mean: float
    spots_lost: int
    spots: int
    seconds: float


@dataclass(frozen=True, eq=False)
class PeerTable:
    """The maps of one atrium and their table.

    Attributes
    ----------
    maps, rows : in the same order.
    flat_map : our map by the method ``regional``, on which the peers are built.
    notes : what to know before comparing.
    """

    maps: tuple[PeerMap, ...]
    rows: tuple[PeerRow, ...]
    flat_map: FlatMap
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """As written to JSON: the rows with source and notes of each method."""
        rows = [
            {**asdict(row), "source": found.source, "notes": list(found.notes)}
            for row, found in zip(self.rows, self.maps, strict=True)
        ]
        return {"template": self.flat_map.template.name, "picture_pixels": PIXELS, "maps": rows, "notes": [*self.notes]}

    def to_csv(self) -> str:
        """The rows as comma-separated values with a head line."""
        text = io.StringIO()
        writer = csv.DictWriter(text, list(asdict(self.rows[0])), lineterminator="\n")
        writer.writeheader()
        writer.writerows(asdict(row) for row in self.rows)
        return text.getvalue()

    def to_markdown(self) -> str:
        """The rows as a table for people."""
        return markdown(self.rows)


def markdown(rows: Sequence[PeerRow]) -> str:
    """A table of rows in Markdown."""
    lines = [
        "| map | veins at standard places (off by, % of half width) | folded triangles | alpha entropy | beta mean | "
        "spots lost | seconds |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        places = f"yes ({row.drift_percent:.1f})" if row.drift_percent is not None else "no"
        lines.append(
            f"| {row.title} | {places} | {row.folded_triangles} of {row.triangles} | {row.alpha_entropy:.2f} | "
            f"{row.beta_mean:.3f} | {row.spots_lost} of {row.spots} | {row.seconds:.2f} |"
        )
    return "\n".join(lines) + "\n"


def compare_peers(
    surface: Surface,
    seeds: Mapping[str, FloatArray],
    sum_template: SumTemplate | None = None,
    template: Template | str | Path = DEFAULT_TEMPLATE,
    check_axes: bool = True,
    progress: ProgressCallback | None = None,
) -> PeerTable:
    """Lay one atrium flat by our two methods and by every peer.

    Parameters
    ----------
    surface, seeds, template, check_axes : as for `Flattener`; a template of the left atrium.
    sum_template : without it there is no SUM map.
    progress : told how far the work is; may stop it.

    Raises
    ------
    SurfaceError, SeedError, FoldError : as `Flattener.flatten` by the method ``regional``. A map that another method
        cannot make is left out, with a note.
    Cancelled : by `progress`.

    Examples
    --------
    >>> from LAFlatteningLib import make_phantom
    >>> phantom = make_phantom(1000)
    >>> [row.name for row in compare_peers(phantom.surface, phantom.seeds).rows]
    ['regional', 'paper', 'conformal', 'square', 'distances', 'universal']
    """
    flat_map = Flattener(surface, template, "regional", check_axes=check_axes).flatten(seeds, part(progress, 0.0, 0.2))
    ways: dict[str, Callable[[ProgressCallback | None], PeerMap]] = {
        "paper": lambda told: ours(Flattener(surface, template, "paper", check_axes=check_axes).flatten(seeds, told)),
        "conformal": lambda told: conformal_map(flat_map, told),
        "square": lambda told: square_map(flat_map, told),
        "distances": lambda told: distance_map(flat_map, told),
        "universal": lambda told: universal_map(flat_map, progress=told),
    }
    notes = []
    if sum_template is not None:
        ways["sum"] = lambda told: sum_map(flat_map, sum_template, told)
    else:
        notes.append("SUM needs the two files of its template, which cannot be given away with this software.")
    maps = [ours(flat_map)]
    for k, (name, make) in enumerate(ways.items()):
        try:
            maps.append(make(part(progress, 0.2 + 0.65 * k / len(ways), 0.2 + 0.65 * (k + 1) / len(ways))))
        except SurfaceError as error:
            # Where another method finds no way, the others are still compared.
            notes.append(f"No map {name}: {error}")
    return PeerTable(tuple(maps), _rows(maps, flat_map, part(progress, 0.85, 1.0)), flat_map, tuple(notes))


def _rows(maps: Sequence[PeerMap], flat_map: FlatMap, progress: ProgressCallback | None) -> tuple[PeerRow, ...]:
    report(progress, 0.0, "Following spots")
    # Spots go by points, of which both of our methods and all peers have the same.
    spot = spots_on(flat_map.cavity.surface)
    rows = []
    for k, found in enumerate(maps):
        report(progress, 0.5 + 0.5 * k / len(maps), "Following spots")
        summary = found.summary
        rows.append(
            PeerRow(
                found.name,
                found.title,
                found.standardised,
                None if found.drift is None else 100.0 * found.drift,
                len(found.triangles),
                len(found.folded_triangles),
                summary["alpha"]["entropy"],
                summary["beta"]["mean"],
                lost_spots(found, spot),
                int(spot.max()),
                found.seconds,
            )
        )
    report(progress, 1.0, "Compared")
    return tuple(rows)
