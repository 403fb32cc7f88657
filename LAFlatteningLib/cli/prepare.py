"""``la-flatten prepare``: a raw atrium to a cavity with seeds."""

from __future__ import annotations

import argparse
import json
from contextlib import ExitStack
from pathlib import Path

from ..axes import AXES, with_axes
from ..cavity.clipping import CutPlane
from ..cavity.label_surface import denoised_label_surface
from ..cavity.plan import KEEP_MM
from ..cavity.plane_files import read_planes
from ..errors import InputFileError, LAFlatteningError
from ..figures import check_figure_path
from ..files import atomic_write, check_writable, read_seeds, read_surface, read_volume, write_seeds, write_surface
from ..files.volumes import VOLUME_SUFFIXES
from ..preparation import DEFAULT_POINTS, EVEN_POINTS, Preparation, PrepareSettings, prepare
from ..preparation_figure import draw_preparation
from ..progress import ProgressCallback, part
from ..surface import FloatArray, Surface
from .command import Subcommands, add_command, check_distinct
from .progress import Progress


def add(commands: Subcommands) -> None:
    """Add the command."""
    sub = add_command(
        commands,
        "prepare",
        run,
        "Cut a raw atrium open at veins, appendage and valve, and place the seeds.",
        "la-flatten prepare labels.nrrd --output cavity.vtp --seeds-output seeds.mrk.json --report prepare.json",
    )
    add_input_options(sub)
    sub.add_argument("--output", required=True, metavar="CAVITY.vtp", help="the cavity, open at six openings")
    sub.add_argument("--seeds-output", required=True, metavar="SEEDS.mrk.json", help="the nine seeds (or .csv)")
    sub.add_argument("--report", metavar="R.json", help="repairs, openings, planes and confidence; also after an error")
    sub.add_argument("--figure", metavar="F.png", help="write a picture of what was cut (.png .pdf .svg)")


def add_input_options(sub: argparse.ArgumentParser) -> None:
    """The options that say what is prepared and how; `run` has the same."""
    sub.add_argument(
        "input",
        metavar="INPUT",
        help=f"label map ({' '.join(VOLUME_SUFFIXES)}) or surface in mm (.vtk .vtp .stl .ply .obj), closed or open",
    )
    sub.add_argument("--label", type=int, help="value of the atrium in a label map (default: the only one)")
    sub.add_argument("--tips", metavar="T.csv", help="ends of the four veins and the appendage, named as seeds are")
    sub.add_argument("--planes", metavar="P.json", help="planes of openings, as in a report of this command")
    sub.add_argument(
        "--points",
        type=int,
        help=f"points of the atrium, meshed anew; 0 keeps its mesh (default: {DEFAULT_POINTS}, but surfaces of "
        f"{EVEN_POINTS[0]} to {EVEN_POINTS[1]} points are kept)",
    )
    sub.add_argument(
        "--pv-length",
        type=float,
        default=KEEP_MM,
        metavar="MM",
        help="vein kept beyond its ostium (default: %(default)s)",
    )
    sub.add_argument(
        "--laa-length",
        type=float,
        default=KEEP_MM,
        metavar="MM",
        help="appendage kept beyond its ostium (default: %(default)s)",
    )
    sub.add_argument("--whole-triangles", action="store_true", help="leave triangles whole at the rims")
    sub.add_argument(
        "--extra-veins",
        choices=("cover", "keep"),
        default="cover",
        help="cut further veins off and cover them, or keep them (default: %(default)s)",
    )
    sub.add_argument(
        "--axes",
        choices=AXES,
        type=str.upper,
        help="axes of the coordinates of a surface, whatever its file says; CARTO: to the left, the head, the front",
    )
    sub.add_argument(
        "--ignore-axes",
        action="store_true",
        help="the coordinates are in unknown axes; the files say so, and later commands go by it",
    )


def settings_of(options: argparse.Namespace, is_label_map: bool) -> PrepareSettings:
    """The settings that the options ask for."""
    for name in ("pv_length", "laa_length"):
        value = getattr(options, name)
        if not 0.0 <= value <= 30.0:
            raise InputFileError(f"--{name.replace('_', '-')} {value:g}: expected 0 to 30 mm.")
    points = options.points
    if points is None and is_label_map:
        points = DEFAULT_POINTS
    return PrepareSettings(
        points,
        options.pv_length,
        options.laa_length,
        options.whole_triangles,
        options.extra_veins,
        options.ignore_axes,
    )


def read_input(options: argparse.Namespace, progress: ProgressCallback | None) -> tuple[Surface, list[str], bool]:
    """The surface of the input, notes on how it was made, and whether the input is a label map."""
    if options.axes and options.ignore_axes:
        raise InputFileError("--axes names the axes, --ignore-axes says that they are unknown: leave one of them out.")
    if Path(options.input).name.lower().endswith(VOLUME_SUFFIXES):
        if options.axes:
            raise InputFileError("--axes is for surfaces: a label map says in which axes it is. Leave it out.")
        made = denoised_label_surface(read_volume(options.input), options.label, progress, not options.ignore_axes)
        return made.surface, list(made.notes), True
    if options.label is not None:
        raise InputFileError("--label chooses a value of a label map, but the input is a surface: leave it out.")
    surface = read_surface(options.input)
    if not options.axes:
        return surface, [], False
    return *with_axes(surface, options.axes), False


def read_given(
    options: argparse.Namespace, space: str
) -> tuple[dict[str, FloatArray] | None, dict[str, CutPlane] | None]:
    """Tips and planes of the user, in the axes of the surface; read before anything is written."""
    tips = read_seeds(options.tips, space) if options.tips else None
    planes = read_planes(options.planes, space) if options.planes else None
    return tips, planes


def run(options: argparse.Namespace, progress: Progress) -> None:
    """Read, prepare, write."""
    names = ("input", "tips", "planes", "output", "seeds_output", "report", "figure")
    check_distinct(options, [name for name in names if not (name == "report" and options.report == options.planes)])
    if Path(options.output).suffix.lower() not in (".vtp", ".vtk"):
        raise InputFileError(f'--output "{options.output}": expected a .vtp (or .vtk) file; others lose arrays.')
    if options.figure:
        check_figure_path(options.figure)
    outputs = [path for path in (options.output, options.seeds_output, options.report, options.figure) if path]
    for path in outputs:
        check_writable(path)
    progress(0.0, "Reading")
    surface, notes, is_label_map = read_input(options, part(progress, 0.0, 0.2))
    tips, planes = read_given(options, surface.space)
    settings = settings_of(options, is_label_map)
    preparation = Preparation(surface, repairs=notes)
    try:
        prepare(surface, settings, tips=tips, planes=planes, into=preparation, progress=part(progress, 0.2, 0.8))
    except LAFlatteningError as error:
        # The planes that the user gave are not replaced by a report that has none.
        if options.report and options.report != options.planes:
            write_report(preparation, options.report, str(error))
        raise
    with ExitStack() as files:
        if options.figure:
            progress(0.85, "Drawing")
            draw_preparation(preparation, files.enter_context(atomic_write(options.figure)))
        progress(0.95, "Writing")
        write_cavity(preparation, options.output, options.seeds_output, files)
        if options.report:
            write_report(preparation, files.enter_context(atomic_write(options.report)))
    progress.clear()
    report_preparation(preparation)
    print("Wrote " + ", ".join(str(path) for path in outputs))


def write_cavity(preparation: Preparation, cavity: Path | str, seeds: Path | str, files: ExitStack) -> None:
    """Write cavity and seeds once `files` is left."""
    assert preparation.cavity is not None
    write_surface(preparation.cavity, files.enter_context(atomic_write(cavity)))
    write_seeds(preparation.seeds, files.enter_context(atomic_write(seeds)), preparation.cavity.space)


def write_report(preparation: Preparation, path: Path | str, error: str | None = None) -> None:
    """Write what was found, and why it stopped if it did."""
    result = preparation.report() | ({"error": error} if error else {})
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


def report_preparation(preparation: Preparation) -> None:
    """Print notes and openings."""
    for note in preparation.notes:
        print(f"Note: {note}")
    if preparation.plan:
        for name, opening in preparation.plan.openings.items():
            rim = preparation.rims.get(name)
            length = (
                opening.perimeter_mm
                if rim is None or preparation.cavity is None
                else preparation.cavity.loop_length(rim)
            )
            place = ", ".join(f"{x:.1f}" for x in opening.plane.centre)
            axes = f" {preparation.raw.space}" if preparation.raw.axes_known else ""
            print(f"{name}: {opening.found_by}, {length:.1f} mm round at ({place}) mm{axes}")
        if not preparation.raw.axes_known:
            print("patient axes: unknown; coordinates are those of the file")
        print(f"names: confidence {preparation.plan.confidence}")
    if preparation.cavity:
        print(f"cavity: {len(preparation.cavity.points)} points, {preparation.cavity.area / 100:.1f} cm2")
