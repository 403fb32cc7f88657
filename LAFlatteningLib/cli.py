"""The command ``la-flatten``."""

from __future__ import annotations

import argparse
import io
import json
import os
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from . import topology
from ._version import __version__
from .cavity.covers import HOLE_ARRAY
from .cavity.openings import guess_unit
from .errors import InputFileError, LAFlatteningError
from .figures import check_figure_path, draw_figure
from .files import atomic_write, check_writable, read_seeds, read_surface, write_seeds, write_surface
from .flattening import METHODS, FlatMap, Flattener
from .progress import part
from .subcontours import ROUNDINGS
from .template import DEFAULT_TEMPLATE, builtin_templates

BAD_INPUT = 2
"""Exit code for input that cannot be used."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code (0 done, 2 bad input, 130 interrupted)."""
    parser = _parser()
    options = parser.parse_args(arguments)
    progress = _Progress(options.quiet)
    if threading.current_thread() is threading.main_thread():
        # Being terminated is like Ctrl-C: temporary files are removed on the way out.
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    if isinstance(sys.stdout, io.TextIOWrapper):
        # Names of arrays may hold letters that the terminal does not know.
        sys.stdout.reconfigure(errors="replace")
    try:
        options.run(options, progress)
        progress.clear()
        sys.stdout.flush()
    except LAFlatteningError as error:
        progress.clear()
        print(f"la-flatten: {error}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        progress.clear()
        print("la-flatten: stopped; no file was written.", file=sys.stderr)
        return 130
    except OSError as error:
        # Nobody reads standard output (a closed pipe), or it has no room; files are whole by then.
        progress.clear()
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):
            return 0
        print(f"la-flatten: standard output cannot be written: {error.strerror or error}", file=sys.stderr)
        return BAD_INPUT
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="la-flatten",
        description="Standardised, fold-free 2D maps of the left atrium.",
        epilog="Example: la-flatten demo --output demo   (then: la-flatten flatten demo/atrium.vtp "
        "--seeds demo/seeds.mrk.json --output map.vtp --metrics metrics.json --figure map.png)",
    )
    parser.add_argument("--version", action="version", version=f"la-flatten {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def command(name: str, run: Callable[..., None], summary: str, example: str) -> argparse.ArgumentParser:
        sub = commands.add_parser(
            name,
            help=summary,
            description=summary,
            epilog=f"Example:\n  {example}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        sub.add_argument("--quiet", action="store_true", help="print results and errors only")
        sub.set_defaults(run=run)
        return sub

    flat = command(
        "flatten",
        _flatten,
        "Flatten an atrium with 9 seeds into a 2D map.",
        "la-flatten flatten atrium.vtp --seeds seeds.mrk.json --output map.vtp --metrics metrics.json --figure map.png",
    )
    flat.add_argument(
        "surface",
        metavar="SURFACE",
        help="atrium in mm, open at four veins, appendage and mitral valve, or with covers marked by a point array "
        f'"{HOLE_ARRAY}" = 1 (.vtk .vtp .stl .ply .obj)',
    )
    flat.add_argument(
        "--seeds",
        required=True,
        help="9 seeds: CSV label,x_mm,y_mm,z_mm in the surface's coordinates, or a Slicer markups file .mrk.json",
    )
    flat.add_argument("--output", required=True, metavar="MAP.vtp", help="the map, a disk of radius 0.5 at z = 0")
    flat.add_argument("--method", choices=METHODS, default=METHODS[0], help="default: %(default)s")
    flat.add_argument(
        "--rounding",
        choices=ROUNDINGS,
        help=f"how --method paper rounds the sub-contour rule (default: {ROUNDINGS[0]}, as printed)",
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

    demo = command(
        "demo",
        _demo,
        "Make a synthetic atrium, flatten it and draw it.",
        "la-flatten demo --output demo",
    )
    demo.add_argument("--output", default="demo", metavar="DIR", help="folder for the files (default: %(default)s)")
    demo.add_argument("--points", type=int, default=20000, help="points of the atrium (default: %(default)s)")

    info = command(
        "info",
        _info,
        "Say what a surface file holds: openings, topology, arrays, probable units and axes.",
        "la-flatten info atrium.vtp",
    )
    info.add_argument("surface", metavar="SURFACE", help="surface file (.vtk .vtp .stl .ply .obj)")
    return parser


class _Progress:
    """Says on standard error what is being done, once the command has taken longer than a second."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet
        self._line = False
        self._now = ""
        self._printed = ""
        self._timer = threading.Timer(1.0, self._start)
        self._timer.daemon = True
        self._started = False
        if not quiet:
            self._timer.start()

    def __call__(self, share: float, text: str) -> bool:
        self._now = f"{100 * share:3.0f} %  {text}"
        if self._started:
            self._print()
        return True

    def _start(self) -> None:
        self._started = True
        self._print()

    def _print(self) -> None:
        if not self._now or self._now == self._printed:
            return
        self._printed = self._now
        if sys.stderr.isatty():
            print(f"\r\033[K{self._now}", end="", file=sys.stderr, flush=True)
            self._line = True
        else:
            print(self._now, file=sys.stderr, flush=True)

    def clear(self) -> None:
        self._timer.cancel()
        self._started = False
        if self._line:
            print("\r\033[K", end="", file=sys.stderr, flush=True)
            self._line = False


def _flatten(options: argparse.Namespace, progress: _Progress) -> None:
    _check_options(options)
    outputs = [path for path in (options.output, options.metrics, options.figure) if path]
    for path in outputs:
        check_writable(path)
    progress(0.0, "Reading")
    surface = read_surface(options.surface)
    seeds = read_seeds(options.seeds, surface.space)
    flattener = Flattener(
        surface, options.template, options.method, options.rounding or ROUNDINGS[0], not options.ignore_axes
    )
    flat_map = flattener.flatten(seeds, part(progress, 0.05, 0.7))
    _write(flat_map, options.output, options.metrics, options.figure, options.array, progress)
    progress.clear()
    _report(flat_map, outputs)


def _check_options(options: argparse.Namespace) -> None:
    """Raise InputFileError for options that contradict each other, before any work."""
    if options.array and not options.figure:
        raise InputFileError("--array chooses what the figure shows: give --figure F.png too.")
    if options.figure:
        check_figure_path(options.figure)
    if options.rounding and options.method != "paper":
        raise InputFileError("--rounding belongs to --method paper: give that too, or leave --rounding out.")
    if Path(options.output).suffix.lower() not in (".vtp", ".vtk"):
        raise InputFileError(
            f'--output "{options.output}": expected a .vtp (or .vtk) file; other kinds lose the arrays of the map.'
        )
    used: dict[Path, str] = {}
    for name in ("surface", "seeds", "template", "output", "metrics", "figure"):
        value = getattr(options, name)
        if value and not (name == "template" and value in builtin_templates()):
            path = Path(value).resolve()
            if path in used:
                raise InputFileError(f'"{value}" is given twice, as {used[path]} and as {name}; expected two files.')
            used[path] = name


def _demo(options: argparse.Namespace, progress: _Progress) -> None:
    from .phantom import make_phantom

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
    _write(flat_map, files["map.vtp"], files["metrics.json"], files["figure.png"], None, progress)
    progress.clear()
    _report(flat_map, [str(path) for path in files.values()])


def _write(
    flat_map: FlatMap,
    output: Path | str,
    metrics: Path | str | None,
    figure: Path | str | None,
    array: str | None,
    progress: _Progress,
) -> None:
    """Write map, metrics and figure: all of them, or none."""
    with ExitStack() as files:
        if figure:
            progress(0.75, "Drawing")
            draw_figure(flat_map, files.enter_context(atomic_write(figure)), array=array)
        progress(0.95, "Writing")
        if metrics:
            text = json.dumps(flat_map.metrics, indent=2) + "\n"
            files.enter_context(atomic_write(metrics)).write_text(text, encoding="utf-8")
        write_surface(flat_map.to_surface(), files.enter_context(atomic_write(output)))


def _report(flat_map: FlatMap, outputs: Sequence[str]) -> None:
    metrics = flat_map.metrics
    for note in metrics["notes"]:
        print(f"Note: {note}")
    print(
        f"{metrics['points']} points, {metrics['triangles']} triangles; "
        f"folded triangles {metrics['folded_triangles']}, overlapping pairs {metrics['overlapping_pairs']}"
    )
    print(
        f"beta mean {metrics['beta']['mean']:.3f}, dilatation median {metrics['dilatation']['median']:.2f}, "
        f"99th percentile {metrics['dilatation']['p99']:.1f}; rim error {metrics['rim_error']:.1e}, "
        f"path drift {metrics['path_drift']:.1e} disk radii"
    )
    print(
        f"method {metrics['method']}, template {metrics['template']}, "
        f"{metrics['seconds']['total']:.2f} s from seeds to map"
    )
    print("Wrote " + ", ".join(str(path) for path in outputs))


def _info(options: argparse.Namespace, progress: _Progress) -> None:
    surface = read_surface(options.surface)
    low, high = surface.points.min(axis=0), surface.points.max(axis=0)
    size = float(np.linalg.norm(high - low))
    print(f"{options.surface}: {len(surface.points)} points, {len(surface.triangles)} triangles")
    guess = guess_unit(size)
    unit = "mm" if guess is None or guess[0] == "mm" else "units of the file"
    print(f"extent {' x '.join(f'{x:.4g}' for x in high - low)} {unit}, {size:.4g} across")
    if guess:
        print(f"units: probably {guess[0]}" + ("" if guess[0] == "mm" else f"; multiply by {guess[1]:g} to get mm"))
    else:
        print("units: unclear; a left atrium is about 100 mm across")
    print(f"patient axes: {surface.space} (as the file says; LPS if it says nothing)")
    print(f"pieces: {surface.component_count}")
    print(f"triangles all turned the same way: {'yes' if surface.is_oriented else 'no'}")
    if surface.is_manifold and not surface.is_oriented:
        surface = surface.with_triangles(topology.orient(surface.triangles, surface.edges))
    if not surface.is_manifold:
        print(f"not a clean sheet at {len(surface.non_manifold_points)} points")
        loops = []
    else:
        loops = surface.boundary_loops
        print(f"handles (genus): {surface.genus}")
    for number, loop in enumerate(sorted(loops, key=surface.loop_length, reverse=True), start=1):
        centre = ", ".join(f"{x:.4g}" for x in surface.points[loop].mean(axis=0))
        length = f"{surface.loop_length(loop):.4g} {unit}"
        print(f"opening {number}: perimeter {length}, {len(loop)} points, centre ({centre})")
    if not loops and surface.is_manifold:
        print("openings: none (closed surface)")
    if HOLE_ARRAY in surface.point_data:
        marked = np.count_nonzero(surface.point_data[HOLE_ARRAY] == 1)
        print(f'covers: {marked} points marked by the array "{HOLE_ARRAY}"')
    for kind, arrays in (("point", surface.point_data), ("cell", surface.cell_data)):
        for name, values in arrays.items():
            print(f"{kind} array {name}: {_describe(values)}")


def _describe(values: Any) -> str:
    if values.dtype.kind not in "fiub":
        return "text"
    shape = "" if values.ndim == 1 else f", {values.shape[1]} components"
    finite = values[np.isfinite(values)]
    missing = values.size - finite.size
    extent = f"{finite.min():g} to {finite.max():g}" if finite.size else "no values"
    return extent + shape + (f", {missing} without a value" if missing else "")
