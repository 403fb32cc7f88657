"""``la-flatten gaps``: gaps in the ablation lines round the veins, read off a map."""

from __future__ import annotations

import argparse
import json
import re
from contextlib import ExitStack, suppress

from ..errors import InputFileError
from ..fibrosis import DIRECTIONS
from ..files import atomic_write, check_writable, read_surface
from ..gaps import GapReport, find_gaps
from ..gaps.figures import draw_gaps
from ..gaps.places import WIDE_MM
from ..gaps.search_areas import SEARCH_MM
from ..map_data import MapData
from ..page import check_figure_path
from ..parcellation import builtin_parcellations
from ..progress import part
from .command import Subcommands, add_command, check_distinct
from .progress import Progress


def add(commands: Subcommands) -> None:
    """Add the command."""
    gaps = add_command(
        commands,
        "gaps",
        run,
        "Measure the gaps in the scar round each vein and each pair of veins.",
        "la-flatten gaps map.vtp --array LGE --threshold 110,120,130 --output gaps.json --figure gaps.png",
    )
    gaps.add_argument("map", metavar="MAP", help="a map as la-flatten flatten writes it (.vtp)")
    gaps.add_argument("--array", required=True, metavar="NAME", help="intensity, or scar as 0 and 1")
    gaps.add_argument(
        "--threshold",
        required=True,
        metavar="T[,T...]",
        help="from which value of the array tissue is scar; several give the curve of RGM over threshold",
    )
    gaps.add_argument(
        "--direction",
        choices=DIRECTIONS,
        help="on which side of the threshold scar is (default: below for voltages, above for everything else)",
    )
    gaps.add_argument("--output", required=True, metavar="G.json", help="the gaps, with the paths as lines")
    gaps.add_argument("--figure", metavar="F.png", help="write a picture of the gaps on the map (.png .pdf .svg)")
    gaps.add_argument(
        "--minimum", type=float, default=0.0, metavar="MM", help="list gaps of at least so many mm (default: all)"
    )
    gaps.add_argument(
        "--search",
        default=f"{SEARCH_MM:g}",
        metavar="MM|NAME|FILE.json",
        help="search areas: within so many mm of the rims (default: %(default)s), or the parts of a parcellation "
        f"({', '.join(builtin_parcellations())}, or a file); the published ones are vein_surroundings",
    )
    gaps.add_argument(
        "--template", metavar="NAME|FILE.json", help="template of the map (default: the one that the map names)"
    )


def run(options: argparse.Namespace, progress: Progress) -> None:
    """Read, measure, write."""
    if options.figure:
        check_figure_path(options.figure)
    check_distinct(options, ("map", "template", "output", "figure"))
    thresholds = _numbers(options.threshold)
    outputs = [path for path in (options.output, options.figure) if path]
    for path in outputs:
        check_writable(path)
    search: str | float = options.search
    with suppress(ValueError):
        search = float(options.search)
    progress(0.0, "Reading")
    data = MapData.of(read_surface(options.map), options.template)
    found = find_gaps(
        data,
        options.array,
        thresholds,
        search=search,
        minimum_mm=options.minimum,
        direction=options.direction,
        progress=part(progress, 0.05, 0.8),
    )
    with ExitStack() as files:
        if options.figure:
            progress(0.8, "Drawing")
            draw_gaps(data, found, files.enter_context(atomic_write(options.figure)))
        files.enter_context(atomic_write(options.output)).write_text(_json(found), encoding="utf-8")
    progress.clear()
    _report(found)
    print("Wrote " + ", ".join(outputs))


def _json(found: GapReport) -> str:
    """The gap file, with each list of numbers on one line."""
    text = json.dumps(found.to_dict(), indent=2)
    for _ in range(2):
        text = re.sub(r"\[\s+([-+\d.e,\s\[\]]*?)\s+\]", lambda row: "[" + " ".join(row[1].split()) + "]", text)
    return text + "\n"


def _numbers(text: str) -> list[float]:
    try:
        return [float(word) for word in text.split(",")]
    except ValueError as error:
        raise InputFileError(f'--threshold "{text}": expected numbers separated by commas, like 110,120.') from error


def _report(found: GapReport) -> None:
    """Print notes and figures."""
    for note in found.notes:
        print(f"Note: {note}")
    for threshold in found.thresholds:
        print(f"scar: {found.scar_words(threshold)}")
        for area, ring in found.at(threshold).items():
            lengths = ", ".join(f"{gap.length_mm:.1f} mm ({gap.where})" for gap in ring.gaps)
            small = f"{ring.small_gaps} shorter than {found.minimum_mm:g} mm" if ring.small_gaps else ""
            print(
                f"  {area}: RGM {ring.rgm:.3f}, gaps {ring.gap_length_mm:.1f} mm ({ring.wide_gaps} of {WIDE_MM:g} mm "
                f"or more), scar {ring.scar_length_mm:.1f} mm; "
                + ("complete" if ring.complete else "; ".join(words for words in (lengths, small) if words))
            )
