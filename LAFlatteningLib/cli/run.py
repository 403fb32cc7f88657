"""``la-flatten run``: from raw input to map, metrics and figure with no further question."""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from pathlib import Path

from ..errors import LAFlatteningError
from ..figures import check_figure_path
from ..files import check_writable
from ..flattening import METHODS, Flattener
from ..preparation import Preparation
from ..progress import part
from ..template import DEFAULT_TEMPLATE, builtin_templates
from .command import Subcommands, add_command, report_map, write_map
from .prepare import (
    add_input_options,
    prepare_input,
    read_input,
    report_preparation,
    settings_of,
    write_cavity,
    write_report,
)
from .progress import Progress

FILES = ("cavity.vtp", "seeds.mrk.json", "map.vtp", "metrics.json", "prepare.json", "figure.png")


def add(commands: Subcommands) -> None:
    """Add the command."""
    sub = add_command(
        commands,
        "run",
        run,
        "From a raw atrium to its map: prepare, flatten, draw.",
        "la-flatten run labels.nrrd --output result",
    )
    add_input_options(sub)
    sub.add_argument("--output", required=True, metavar="DIR", help="folder for " + ", ".join(FILES))
    sub.add_argument("--method", choices=METHODS, default=METHODS[0], help="default: %(default)s")
    sub.add_argument(
        "--template",
        default=DEFAULT_TEMPLATE,
        metavar="NAME|FILE.json",
        help=f"{', '.join(builtin_templates())}, or a template file (default: %(default)s)",
    )


def run(options: argparse.Namespace, progress: Progress) -> None:
    """Read, prepare, flatten, write; after an error the folder has what was reached, and in ``prepare.json`` why."""
    folder = Path(options.output)
    files = {name: folder / name for name in FILES}
    check_figure_path(files["figure.png"])
    progress(0.0, "Reading")
    surface, notes, is_label_map = read_input(options, part(progress, 0.0, 0.1))
    settings = settings_of(options, is_label_map)
    for path in files.values():
        check_writable(path, make_folder=True)
    # What lies there from an earlier run must not be taken for this one's.
    for path in files.values():
        path.unlink(missing_ok=True)
    preparation = Preparation(surface, repairs=notes)
    try:
        prepare_input(options, preparation, settings, part(progress, 0.1, 0.5))
        with ExitStack() as written:
            write_cavity(preparation, files["cavity.vtp"], files["seeds.mrk.json"], written)
        assert preparation.cavity is not None
        flattener = Flattener(preparation.cavity, options.template, options.method, check_axes=not options.ignore_axes)
        flat_map = flattener.flatten(preparation.seeds, part(progress, 0.5, 0.8))
        write_map(flat_map, files["map.vtp"], files["metrics.json"], files["figure.png"], None, progress)
    except LAFlatteningError as error:
        write_report(preparation, files["prepare.json"], str(error))
        raise
    write_report(preparation, files["prepare.json"])
    progress.clear()
    report_preparation(preparation)
    report_map(flat_map, [str(path) for path in files.values()])
