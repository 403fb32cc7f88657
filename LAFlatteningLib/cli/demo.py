"""``la-flatten demo``: the main job on a synthetic atrium."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..files import check_writable, write_seeds, write_surface
from ..flattening import Flattener
from ..page import check_figure_path
from ..phantom import make_phantom
from ..progress import part
from .command import Subcommands, add_command, report_map, write_map
from .progress import Progress


def add(commands: Subcommands) -> None:
    """Add the command."""
    demo = add_command(
        commands,
        "demo",
        run,
        "Make a synthetic atrium, flatten it and draw it.",
        "la-flatten demo --output demo",
    )
    demo.add_argument("--output", default="demo", metavar="DIR", help="folder for the files (default: %(default)s)")
    demo.add_argument("--points", type=int, default=20000, help="points of the atrium (default: %(default)s)")


def run(options: argparse.Namespace, progress: Progress) -> None:
    """Make the files."""
    folder = Path(options.output)
    files = {name: folder / name for name in ("atrium.vtp", "seeds.mrk.json", "map.vtp", "metrics.json", "figure.png")}
    check_figure_path(files["figure.png"])
    progress(0.0, "Making a synthetic atrium")
    phantom = make_phantom(options.points)
    for path in files.values():
        check_writable(path, make_folder=True)
    flat_map = Flattener(phantom.surface).flatten(phantom.seeds, part(progress, 0.2, 0.7))
    write_surface(phantom.surface, files["atrium.vtp"])
    write_seeds(phantom.seeds, files["seeds.mrk.json"], phantom.surface.space)
    write_map(flat_map, files["map.vtp"], files["metrics.json"], files["figure.png"], None, progress)
    progress.clear()
    report_map(flat_map, [str(path) for path in files.values()])
