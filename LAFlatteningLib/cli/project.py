"""``la-flatten project``: the intensities of an image on the wall of an atrium."""

from __future__ import annotations

import argparse

from ..errors import InputFileError
from ..files import check_writable, read_surface, read_volume, write_surface
from ..projection import DEPTH_MM, LGE_ARRAY, SIDES, STATISTICS, project
from .command import Subcommands, add_command, check_distinct
from .progress import Progress


def add(commands: Subcommands) -> None:
    """Add the command."""
    sub = add_command(
        commands,
        "project",
        run,
        "Project an image onto the wall of an atrium: the intensity along the normal at each point.",
        "la-flatten project atrium.vtp --volume lge.nrrd --depth 3 --output atrium_lge.vtp",
    )
    sub.add_argument("surface", metavar="SURFACE", help="atrium in 3D, mm (.vtk .vtp .stl .ply .obj)")
    sub.add_argument("--volume", required=True, metavar="V", help="the image (.nrrd .nii .nii.gz .mha)")
    sub.add_argument("--depth", type=float, metavar="MM", help=f"how far to look (default: {DEPTH_MM:g})")
    sub.add_argument(
        "--side", choices=SIDES, help="into the chamber, out of it, or to both sides of the wall (default: both)"
    )
    sub.add_argument(
        "--interval",
        metavar="FROM,TO",
        help="in place of depth and side: mm along the outward normal; --interval=-1,3 is 1 mm inside to 3 mm outside",
    )
    sub.add_argument("--statistic", choices=STATISTICS, default=STATISTICS[0], help="default: %(default)s")
    sub.add_argument("--array", default=LGE_ARRAY, metavar="NAME", help="name of the array (default: %(default)s)")
    sub.add_argument(
        "--output", required=True, metavar="OUT.vtp", help="the atrium with the intensities as a point array"
    )


def run(options: argparse.Namespace, progress: Progress) -> None:
    """Read, project, write."""
    check_distinct(options, ("surface", "volume", "output"))
    if not options.output.lower().endswith((".vtp", ".vtk")):
        raise InputFileError(f'--output "{options.output}": expected a .vtp or .vtk file; others lose arrays.')
    interval = None
    if options.interval is not None:
        if options.depth is not None or options.side is not None:
            raise InputFileError("--interval takes the place of --depth and --side: give one or the other.")
        interval = _interval(options.interval)
    check_writable(options.output)
    progress(0.0, "Reading")
    surface, volume = read_surface(options.surface), read_volume(options.volume)
    progress(0.5, "Projecting")
    depth = DEPTH_MM if options.depth is None else options.depth
    found = project(surface, volume, depth, options.side or SIDES[0], options.statistic, interval_mm=interval)
    write_surface(found.on(surface, options.array), options.output)
    progress.clear()
    for note in found.notes:
        print(f"Note: {note}")
    low, high = found.interval_mm
    known = found.values[found.values == found.values]
    print(
        f"{options.array}: {found.statistic} from {low:g} to {high:g} mm along the outward normal, samples "
        f"{found.step_mm:.2g} mm apart; {len(known)} points from {known.min():.4g} to {known.max():.4g}, mean "
        f"{known.mean():.4g}"
    )
    print(f"Wrote {options.output}")


def _interval(text: str) -> tuple[float, float]:
    try:
        low, high = (float(word) for word in text.split(","))
    except ValueError:
        raise InputFileError(f'--interval "{text}": expected two numbers in mm, like --interval=-1,3.') from None
    return low, high
