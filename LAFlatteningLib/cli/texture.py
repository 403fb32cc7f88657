"""``la-flatten texture``: patterns on the atrium and on its map."""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from ..errors import InputFileError
from ..files import atomic_write, check_writable, read_surface, write_surface
from ..map_data import MapData
from ..page import check_figure_path
from ..study_figures import draw_textures
from ..surface import FloatArray
from ..textures import PATTERNS, Texture, checker, circles, stripes
from .command import Subcommands, add_command, check_distinct
from .progress import Progress

DEFAULT_WIDTH_MM = {"stripes": 5.0, "checker": 8.0}


def add(commands: Subcommands) -> None:
    """Add the command."""
    sub = add_command(
        commands,
        "texture",
        run,
        "Put a pattern on an atrium and its map: what the map does to circles, distances and squares.",
        "la-flatten texture map.vtp --pattern circles --count 100 --output circles.vtp --figure circles.png",
    )
    sub.add_argument("map", metavar="MAP", help="a map as la-flatten flatten writes it (.vtp)")
    sub.add_argument("--pattern", choices=PATTERNS, default=PATTERNS[0], help="default: %(default)s")
    sub.add_argument("--count", type=int, default=100, help="of circles (default: %(default)s)")
    sub.add_argument("--radius", type=float, metavar="MM", help="of circles (default: they cover about a third)")
    sub.add_argument("--width", type=float, metavar="MM", help="of a stripe (default: 5) or a check (default: 8)")
    sub.add_argument(
        "--from", dest="source", metavar="X,Y,Z",
        help="where distances begin, mm in the axes of the atrium (default: the middle between the holes of the map)",
    )  # fmt: skip
    sub.add_argument(
        "--output", metavar="OUT.vtp", help="the map with the pattern as a point array, positive where dark"
    )
    sub.add_argument("--figure", metavar="F.png", help="a picture of the pattern on atrium and map (.png .pdf .svg)")
    sub.add_argument("--template", metavar="NAME|FILE.json", help="of the map (default: the one that the file names)")


def run(options: argparse.Namespace, progress: Progress) -> None:
    """Read, make the pattern, write."""
    if not (options.output or options.figure):
        raise InputFileError("Nothing would be written: give --output OUT.vtp, --figure F.png or both.")
    if options.figure:
        check_figure_path(options.figure)
    check_distinct(options, ("map", "template", "output", "figure"))
    outputs = [path for path in (options.output, options.figure) if path]
    for path in outputs:
        check_writable(path)
    if options.output and Path(options.output).suffix.lower() not in (".vtp", ".vtk"):
        raise InputFileError(f'--output "{options.output}": expected a .vtp (or .vtk) file; others lose the arrays.')
    progress(0.0, "Reading")
    surface = read_surface(options.map)
    data = MapData.of(surface, options.template)
    progress(0.2, "Making the pattern")
    pattern = _pattern(options, data)
    with ExitStack() as files:
        if options.figure:
            progress(0.6, "Drawing")
            draw_textures(data, [pattern], files.enter_context(atomic_write(options.figure)))
        if options.output:
            write_surface(pattern.on(surface), files.enter_context(atomic_write(options.output)))
    progress.clear()
    print(f"{pattern.title}; dark where {pattern.name} is positive")
    print("Wrote " + ", ".join(outputs))


def _pattern(options: argparse.Namespace, data: MapData) -> Texture:
    if options.pattern == "circles":
        return circles(data.surface, options.count, options.radius)
    width = DEFAULT_WIDTH_MM[options.pattern] if options.width is None else options.width
    make = stripes if options.pattern == "stripes" else checker
    return make(data.surface, _source(options.source, data), width)


def _source(text: str | None, data: MapData) -> FloatArray:
    if text is None:
        template = data.template
        places = [rim.shape.centre for rim in template.holes.values()] or list(template.landmarks.values())
        middle = np.mean(places or [template.outer.shape.centre], axis=0)
        return np.asarray(data.surface.points[np.linalg.norm(data.flat - middle, axis=1).argmin()])
    try:
        x, y, z = (float(word) for word in text.split(","))
    except ValueError:
        raise InputFileError(f'--from "{text}": expected three numbers in mm, X,Y,Z.') from None
    return np.array([x, y, z])
