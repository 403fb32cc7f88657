"""The command ``la-flatten``."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ._version import __version__
from .cavity.openings import HOLE_ARRAY
from .errors import LAFlatteningError
from .files import check_writable, read_seeds, read_surface, write_seeds, write_surface, write_text
from .flattening import METHODS, FlatMap, Flattener
from .progress import ProgressCallback
from .subcontours import ROUNDINGS
from .surface import Surface
from .template import DEFAULT_TEMPLATE, builtin_templates

BAD_INPUT = 2
"""Exit code for input that cannot be used."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code (0 done, 2 bad input, 130 interrupted)."""
    parser = _parser()
    options = parser.parse_args(arguments)
    progress = _Progress(options.quiet)
    try:
        options.run(options, progress)
    except LAFlatteningError as error:
        progress.clear()
        print(f"la-flatten: {error}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        progress.clear()
        print("la-flatten: stopped; nothing was written.", file=sys.stderr)
        return 130
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
        default=ROUNDINGS[0],
        help="how --method paper rounds the sub-contour rule (default: %(default)s, as printed)",
    )
    flat.add_argument(
        "--template",
        default=DEFAULT_TEMPLATE,
        metavar="NAME|FILE.json",
        help=f"{', '.join(builtin_templates())}, or a template file (default: %(default)s)",
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
    """A line on a terminal that says what is being done once it has taken longer than a second."""

    def __init__(self, quiet: bool) -> None:
        self._shown = False
        self._quiet = quiet
        self._began = time.perf_counter()
        self._printed = ""

    def __call__(self, share: float, text: str) -> bool:
        if self._quiet or time.perf_counter() - self._began < 1.0:
            return True
        if sys.stderr.isatty():
            print(f"\r\033[K{100 * share:3.0f} %  {text}", end="", file=sys.stderr, flush=True)
            self._shown = True
        elif text != self._printed:
            print(f"{100 * share:3.0f} %  {text}", file=sys.stderr, flush=True)
        self._printed = text
        return True

    def clear(self) -> None:
        if self._shown:
            print("\r\033[K", end="", file=sys.stderr, flush=True)
            self._shown = False


def _flatten(options: argparse.Namespace, progress: _Progress) -> None:
    outputs = [path for path in (options.output, options.metrics, options.figure) if path]
    for path in outputs:
        check_writable(path)
    progress(0.0, "Reading")
    surface = read_surface(options.surface)
    seeds = read_seeds(options.seeds, surface.space)
    flattener = Flattener(surface, options.template, options.method, options.rounding)
    flat_map = flattener.flatten(seeds, _part(progress, 0.05, 0.7))
    _write(flat_map, Path(options.output), options.metrics, options.figure, options.array, progress)
    progress.clear()
    _report(flat_map, outputs)


def _demo(options: argparse.Namespace, progress: _Progress) -> None:
    from .phantom import make_phantom

    folder = Path(options.output)
    files = {name: folder / name for name in ("atrium.vtp", "seeds.mrk.json", "map.vtp", "metrics.json", "figure.png")}
    for path in files.values():
        check_writable(path, make_folder=True)
    progress(0.0, "Making a synthetic atrium")
    phantom = make_phantom(options.points)
    flat_map = Flattener(phantom.surface).flatten(phantom.seeds, _part(progress, 0.2, 0.7))
    write_surface(phantom.surface, files["atrium.vtp"])
    write_seeds(phantom.seeds, files["seeds.mrk.json"], phantom.surface.space)
    _write(flat_map, files["map.vtp"], files["metrics.json"], files["figure.png"], None, progress)
    progress.clear()
    _report(flat_map, [str(path) for path in files.values()])


def _part(progress: _Progress, start: float, stop: float) -> ProgressCallback:
    """The progress of a step as a part of the whole."""
    return lambda share, text: progress(start + share * (stop - start), text)


def _write(
    flat_map: FlatMap,
    output: Path,
    metrics: Path | str | None,
    figure: Path | str | None,
    array: str | None,
    progress: _Progress,
) -> None:
    """Write map, metrics and figure; the figure first, because it is the one that can fail late."""
    if figure:
        from .figures import draw_figure

        progress(0.75, "Drawing")
        draw_figure(flat_map, figure, array=array)
    progress(0.95, "Writing")
    if metrics:
        write_text(metrics, json.dumps(flat_map.metrics, indent=2) + "\n")
    write_surface(flat_map.to_surface(), output)


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
    print(f"extent {' x '.join(f'{x:.1f}' for x in high - low)} (units of the file), area {surface.area:.0f}")
    print(f"units: {_guess_units(size)}; axes: {surface.space} ({_axes_source(surface)})")
    print(f"pieces: {surface.component_count}; turned the same way: {'yes' if surface.is_oriented else 'no'}")
    if not surface.is_manifold:
        print(f"not a clean sheet at {len(surface.non_manifold_points)} points")
        loops = []
    else:
        loops = surface.boundary_loops
        print(f"handles (genus): {surface.genus}")
    for number, loop in enumerate(sorted(loops, key=surface.loop_length, reverse=True), start=1):
        centre = ", ".join(f"{x:.1f}" for x in surface.points[loop].mean(axis=0))
        print(
            f"opening {number}: perimeter {surface.loop_length(loop):.1f} mm, {len(loop)} points, centre ({centre}) mm"
        )
    if not loops and surface.is_manifold:
        print("openings: none (closed surface)")
    if HOLE_ARRAY in surface.point_data:
        print(f'covers: {int((surface.point_data[HOLE_ARRAY] > 0.5).sum())} points marked by the array "{HOLE_ARRAY}"')
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


def _guess_units(size: float) -> str:
    """The unit in which a bounding box diagonal of `size` is that of a heart chamber (20 to 1000 mm)."""
    for factor, unit in ((1.0, "mm"), (10.0, "cm"), (1000.0, "m"), (0.001, "micrometres")):
        if 20.0 <= size * factor <= 400.0:
            return f"probably {unit} ({size:.3g} across)"
    return f"unclear ({size:.3g} across; a left atrium is about 100 mm)"


def _axes_source(surface: Surface) -> str:
    return "named in the file" if "SPACE" in surface.field_data else "LPS is assumed unless the file says otherwise"
