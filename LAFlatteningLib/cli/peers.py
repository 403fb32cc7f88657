"""``la-flatten peers``: one atrium on our map and on the other maps in use, with one table."""

from __future__ import annotations

import argparse
import json
from contextlib import ExitStack
from pathlib import Path

from ..errors import InputFileError
from ..files import atomic_write, check_writable, read_seeds, read_surface, write_surface
from ..page import check_figure_path
from ..peers.figure import draw_peers
from ..peers.sum_map import SumTemplate
from ..peers.table import compare_peers
from ..progress import part
from ..template import DEFAULT_TEMPLATE, builtin_templates
from .command import Subcommands, add_command, check_distinct
from .progress import Progress

FILES = ("peers.json", "peers.csv", "peers.png")


def add(commands: Subcommands) -> None:
    """Add the command."""
    sub = add_command(
        commands,
        "peers",
        run,
        "Lay one atrium flat by our two methods and by the others in use, and compare the maps.",
        "la-flatten peers atrium.vtp --seeds seeds.mrk.json --output peers",
    )
    sub.add_argument("surface", metavar="CAVITY", help="atrium in mm, open at four veins, appendage and mitral valve")
    sub.add_argument("--seeds", required=True, help="9 seeds, as for la-flatten flatten")
    sub.add_argument("--sum-template", metavar="T3D.vtp", help="template atrium of SUM (not part of this software)")
    sub.add_argument("--sum-disk", metavar="DISK.vtp", help="the same mesh on its disk")
    sub.add_argument(
        "--template",
        default=DEFAULT_TEMPLATE,
        metavar="NAME|FILE.json",
        help=f"of our maps: {', '.join(builtin_templates())}, or a template file (default: %(default)s)",
    )
    sub.add_argument("--ignore-axes", action="store_true", help="do not check the seeds against the patient axes")
    sub.add_argument(
        "--output", required=True, metavar="DIR", help=f"folder for {', '.join(FILES)} and each map (NAME.vtp)"
    )


def run(options: argparse.Namespace, progress: Progress) -> None:
    """Read, map, write."""
    if bool(options.sum_template) != bool(options.sum_disk):
        raise InputFileError("SUM needs both files of its template: give --sum-template and --sum-disk, or neither.")
    check_distinct(options, ("surface", "seeds", "template", "sum_template", "sum_disk"))
    paths = [Path(options.output) / name for name in FILES]
    check_figure_path(paths[2])
    progress(0.0, "Reading")
    surface = read_surface(options.surface)
    seeds = read_seeds(options.seeds, surface.space)
    sum_template = SumTemplate.load(options.sum_template, options.sum_disk) if options.sum_template else None
    for path in paths:
        check_writable(path, make_folder=True)
    table = compare_peers(
        surface, seeds, sum_template, options.template, not options.ignore_axes, part(progress, 0.05, 0.85)
    )
    with ExitStack() as files:
        json_file, csv_file, figure = (files.enter_context(atomic_write(path)) for path in paths)
        progress(0.85, "Drawing")
        draw_peers(table, figure)
        csv_file.write_text(table.to_csv(), encoding="utf-8")
        json_file.write_text(json.dumps(table.to_dict(), indent=2) + "\n", encoding="utf-8")
        for found in table.maps:
            paths.append(Path(options.output) / f"{found.name}.vtp")
            write_surface(found.to_surface(), files.enter_context(atomic_write(paths[-1])))
    progress.clear()
    for note in table.notes:
        print(f"Note: {note}")
    print(table.to_markdown(), end="")
    print("Wrote " + ", ".join(str(path) for path in paths))
