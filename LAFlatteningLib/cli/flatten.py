"""``la-flatten flatten``: a cavity and nine seeds to a map."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..cavity.covers import HOLE_ARRAY
from ..errors import InputFileError
from ..files import check_writable, read_seeds, read_surface
from ..flattening import METHODS, Flattener
from ..flattening.strategies import STRATEGIES, flatten_by_strategy
from ..page import check_figure_path
from ..progress import part
from ..subcontours import ROUNDINGS
from ..template import DEFAULT_TEMPLATE, builtin_templates
from .command import Subcommands, add_command, check_distinct, report_map, write_map
from .progress import Progress


def add(commands: Subcommands) -> None:
    """Add the command."""
    flat = add_command(
        commands,
        "flatten",
        run,
        "Flatten an atrium with 9 seeds into a 2D map.",
        "la-flatten flatten atrium.vtp --seeds seeds.mrk.json --output map.vtp --metrics metrics.json --figure map.png",
    )
    flat.add_argument(
        "surface",
        metavar="SURFACE",
        help="atrium in mm, open at four veins, appendage and mitral valve, or with covers marked by a point array "
        f'"{HOLE_ARRAY}" = 1 (.vtk .vtp .stl .ply .obj .mesh .mat)',
    )
    flat.add_argument(
        "--seeds",
        required=True,
        help="the seeds of the template (9 for the left atrium): CSV label,x_mm,y_mm,z_mm in the surface's "
        "coordinates, or a Slicer markups file .mrk.json",
    )
    flat.add_argument(
        "--output",
        required=True,
        metavar="MAP.vtp",
        help="the map, at z = 0 (a disk of radius 0.5, unless the template says otherwise)",
    )
    flat.add_argument("--method", choices=METHODS, default=METHODS[0], help="default: %(default)s")
    flat.add_argument(
        "--rounding",
        choices=ROUNDINGS,
        help=f"how --method paper rounds the sub-contour rule (default: {ROUNDINGS[0]}, as printed)",
    )
    flat.add_argument(
        "--strategy",
        choices=STRATEGIES,
        help="for study, one of the four that the paper compares: only the outer rim on its circle, all rims, rims and "
        "paths, or refined (which is --method paper)",
    )
    flat.add_argument(
        "--template",
        default=DEFAULT_TEMPLATE,
        metavar="NAME|FILE.json",
        help=f"{', '.join(builtin_templates())}, or a template file (default: %(default)s)",
    )
    flat.add_argument(
        "--ignore-axes",
        action="store_true",
        help="do not check the seeds against the patient axes: for surfaces in coordinates of their own",
    )
    flat.add_argument("--metrics", metavar="M.json", help="write the quality figures of the map")
    flat.add_argument("--figure", metavar="F.png", help="write a picture of atrium and map (.png .pdf .svg)")
    flat.add_argument("--array", metavar="NAME", help="array that the figure shows (default: intensity, else regions)")


def run(options: argparse.Namespace, progress: Progress) -> None:
    """Read, flatten, write."""
    _check_options(options)
    outputs = [path for path in (options.output, options.metrics, options.figure) if path]
    for path in outputs:
        check_writable(path)
    progress(0.0, "Reading")
    surface = read_surface(options.surface)
    seeds = read_seeds(options.seeds, surface.space)
    rounding, check_axes, work = options.rounding or ROUNDINGS[0], not options.ignore_axes, part(progress, 0.05, 0.7)
    if options.strategy:
        flat_map = flatten_by_strategy(surface, seeds, options.strategy, options.template, rounding, check_axes, work)
    else:
        flat_map = Flattener(surface, options.template, options.method, rounding, check_axes).flatten(seeds, work)
    write_map(flat_map, options.output, options.metrics, options.figure, options.array, progress)
    progress.clear()
    report_map(flat_map, outputs)


def _check_options(options: argparse.Namespace) -> None:
    """Raise InputFileError for options that contradict each other, before any work."""
    if options.array and not options.figure:
        raise InputFileError("--array chooses what the figure shows: give --figure F.png too.")
    if options.figure:
        check_figure_path(options.figure)
    if options.strategy and options.method != "paper":
        raise InputFileError("--strategy belongs to --method paper: give that too, or leave --strategy out.")
    if options.rounding and options.method != "paper":
        raise InputFileError("--rounding belongs to --method paper: give that too, or leave --rounding out.")
    if Path(options.output).suffix.lower() not in (".vtp", ".vtk"):
        raise InputFileError(
            f'--output "{options.output}": expected a .vtp (or .vtk) file; other kinds lose the arrays of the map.'
        )
    check_distinct(options, ("surface", "seeds", "template", "output", "metrics", "figure"))
