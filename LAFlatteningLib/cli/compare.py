"""``la-flatten compare``: two maps of one template, place by place."""

from __future__ import annotations

import argparse
import json
from contextlib import ExitStack
from pathlib import Path

from ..analysis_figures import draw_comparison, draw_difference
from ..comparison import Comparison, compare_maps
from ..fibrosis import DIRECTIONS
from ..files import atomic_write, check_writable, read_surface
from ..map_data import MapData
from ..page import check_figure_path, digits
from .command import Subcommands, add_command, distinct_names
from .progress import Progress

FILES = ("comparison.json", "comparison.csv", "comparison.png", "difference.png")


def add(commands: Subcommands) -> None:
    """Add the command."""
    sub = add_command(
        commands,
        "compare",
        run,
        "Compare two maps place by place: correlation, difference, overlap, by region.",
        "la-flatten compare before.vtp after.vtp --array-a LGE --array-b LGE --threshold-a 120 --threshold-b 120 "
        "--output comparison",
    )
    sub.add_argument("a", metavar="A", help="a map as la-flatten flatten writes it (.vtp)")
    sub.add_argument("b", metavar="B", help="another, of the same template; or the same, to compare two of its arrays")
    sub.add_argument("--array-a", required=True, metavar="NAME", help="array of map A")
    sub.add_argument("--array-b", required=True, metavar="NAME", help="array of map B")
    sub.add_argument("--threshold-a", type=float, metavar="T", help="for the overlap (Dice): what counts on A")
    sub.add_argument("--threshold-b", type=float, metavar="T", help="and on B")
    for letter in "ab":
        sub.add_argument(
            f"--direction-{letter}",
            choices=DIRECTIONS,
            help=f"on which side of its threshold {letter.upper()} is diseased (default: below for voltages, above for "
            "everything else)",
        )
    sub.add_argument(
        "--scale",
        choices=("auto", "values", "ranks"),
        default="auto",
        help="of the difference: values of one quantity, or ranks of two (default: values if the arrays have one name)",
    )
    sub.add_argument("--template", metavar="NAME|FILE.json", help="of both maps (default: the one that they name)")
    sub.add_argument("--output", required=True, metavar="DIR", help=f"folder for {', '.join(FILES)}")


def run(options: argparse.Namespace, progress: Progress) -> None:
    """Read, compare, write."""
    paths = [Path(options.output) / name for name in FILES]
    check_figure_path(paths[2])
    progress(0.0, "Reading")
    a, b = (MapData.of(read_surface(path), options.template) for path in (options.a, options.b))
    progress(0.2, "Comparing")
    found = compare_maps(
        a,
        b,
        options.array_a,
        options.array_b,
        options.threshold_a,
        options.threshold_b,
        options.direction_a,
        options.direction_b,
        options.scale,
    )
    for path in paths:
        check_writable(path, make_folder=True)
    names = distinct_names(options.a, options.b)
    with ExitStack() as files:
        json_file, csv_file, both, difference = (files.enter_context(atomic_write(path)) for path in paths)
        progress(0.4, "Drawing")
        draw_comparison(found, both, names=names)
        progress(0.7, "Drawing")
        draw_difference(found, difference, names=names)
        csv_file.write_text(found.to_csv(), encoding="utf-8")
        text = json.dumps({"a": names[0], "b": names[1], **found.to_dict()}, indent=2) + "\n"
        json_file.write_text(text, encoding="utf-8")
    progress.clear()
    _report(found)
    print("Wrote " + ", ".join(str(path) for path in paths))


def _report(found: Comparison) -> None:
    for note in found.notes:
        print(f"Note: {note}")
    for part in found.parts:
        dice = f", Dice {part.dice:.3f}" if part.dice == part.dice else ""
        print(
            f"{part.name}: {part.area_cm2:.1f} cm2, Pearson {digits(part.pearson, 3)}, "
            f"Spearman {digits(part.spearman, 3)}, "
            f"B - A {part.difference:.4g} (SD {part.difference_sd:.4g}, {found.scale}){dice}"
        )
