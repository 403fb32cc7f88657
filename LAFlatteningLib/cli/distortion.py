"""``la-flatten distortion``: how much maps change areas and angles."""

from __future__ import annotations

import argparse
import csv
import io
import json
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from .. import distortion
from .._version import __version__
from ..errors import InputFileError
from ..files import atomic_write, check_writable, read_surface, write_surface
from ..map_data import MapData
from ..study_figures import MOST_ROWS, draw_study
from ..surface import Surface
from ..textures import circles
from .command import Subcommands, add_command
from .progress import Progress

FILES = ("distortion.csv", "distortion.json", "distortion.png")


def add(commands: Subcommands) -> None:
    """Add the command."""
    sub = add_command(
        commands,
        "distortion",
        run,
        "Compare how much maps change areas (alpha) and angles (beta): table, histograms, maps of both.",
        "la-flatten distortion population.vtp adapted1.vtp adapted2.vtp --output study",
    )
    sub.add_argument("maps", nargs="+", metavar="MAP", help="maps as la-flatten flatten writes them (.vtp)")
    sub.add_argument(
        "--output", required=True, metavar="DIR",
        help=f"folder for {', '.join(FILES)} and, for each map, NAME_distortion.vtp with cell arrays alpha and beta",
    )  # fmt: skip
    sub.add_argument("--template", metavar="NAME|FILE.json", help="of all maps (default: the one that each file names)")
    sub.add_argument("--circles", type=int, default=100, metavar="N", help="circles drawn on the maps (%(default)s)")


def run(options: argparse.Namespace, progress: Progress) -> None:
    """Read, measure, draw, write."""
    names = [Path(path).stem for path in options.maps]
    double = next((name for name in names if names.count(name) > 1), None)
    if double:
        raise InputFileError(f'Two of the maps are called "{double}"; expected a name for each.')
    folder = Path(options.output)
    outputs = {name: folder / name for name in (*FILES, *(f"{name}_distortion.vtp" for name in names))}
    for path in outputs.values():
        if path.resolve() in {Path(given).resolve() for given in options.maps}:
            raise InputFileError(f'"{path}" is both read and written. Choose another folder for --output.')
        check_writable(path, make_folder=True)
    progress(0.0, "Reading")
    surfaces = {name: read_surface(path) for name, path in zip(names, options.maps, strict=True)}
    maps = {name: MapData.of(surface, options.template) for name, surface in surfaces.items()}
    progress(0.3, "Measuring")
    rows = [describe(name, data) for name, data in maps.items()]
    first = next(iter(maps.values()))
    same = all(len(data.flat) == len(first.flat) for data in maps.values())
    pattern = circles(first.surface, options.circles) if same and options.circles else None
    with ExitStack() as files:
        progress(0.5, "Drawing")
        shown = dict(list(maps.items())[:MOST_ROWS])
        draw_study(shown, files.enter_context(atomic_write(outputs["distortion.png"])), pattern=pattern)
        content = json.dumps({"version": __version__, "maps": rows}, indent=2) + "\n"
        for name, text in (("distortion.json", content), ("distortion.csv", _table(rows))):
            files.enter_context(atomic_write(outputs[name])).write_text(text, encoding="utf-8")
        for name, data in maps.items():
            with_arrays = with_distortion(surfaces[name], data)
            write_surface(with_arrays, files.enter_context(atomic_write(outputs[f"{name}_distortion.vtp"])))
    progress.clear()
    for row in rows:
        print(
            f"  {row['name']}: {row['folded_triangles']} folded triangles; beta mean {row['beta_mean']:.3f}, "
            f"dilatation 99th percentile {row['dilatation_p99']:.1f}; alpha median {row['alpha_median']:.2f}, "
            f"entropy {row['alpha_entropy']:.2f}"
        )
    if len(maps) > MOST_ROWS:
        print(f"Note: the figure shows the first {MOST_ROWS} maps.")
    print("Wrote " + ", ".join(str(path) for path in outputs.values()))


def describe(name: str, data: MapData) -> dict[str, Any]:
    """The figures of one map, flat, as a row of a table."""
    mesh = (data.surface.points, data.triangles, data.flat)
    row: dict[str, Any] = {
        "name": name,
        "template": data.template.name,
        "triangles": len(data.triangles),
        "folded_triangles": len(distortion.folded_triangles(data.flat, data.triangles)),
    }
    for quantity, figures in distortion.summary(*mesh).items():
        row |= {f"{quantity}_{figure}": value for figure, value in figures.items()}
    return row


def with_distortion(surface: Surface, data: MapData) -> Surface:
    """A map with the cell arrays ``alpha`` and ``beta``."""
    mesh = (data.surface.points, data.triangles, data.flat)
    arrays = {"alpha": distortion.area_ratio(*mesh), "beta": distortion.isotropy(*mesh)}
    return surface.with_data(cell_data=arrays)


def _table(rows: list[dict[str, Any]]) -> str:
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(rows[0])
    for row in rows:
        table.writerow([f"{value:.6g}" if isinstance(value, float) else value for value in row.values()])
    return text.getvalue()
