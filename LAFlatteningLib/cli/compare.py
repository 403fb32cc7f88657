"""``la-flatten compare``: maps of one template, place by place."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from ..analysis_figures import draw_comparison, draw_difference
from ..comparison import Agreement, Comparison, compare_maps
from ..errors import InputFileError
from ..fibrosis import DIRECTIONS
from ..files import atomic_write, check_writable, read_surface
from ..map_data import MapData
from ..page import check_figure_path, digits
from ..progress import part
from ..quantities import diseased_side
from ..several_figures import draw_several, draw_spread
from ..several_maps import SeveralMaps, compare_several
from .command import Subcommands, add_command
from .progress import Progress

FILES = ("comparison.json", "comparison.csv", "comparison.png", "difference.png")
SEVERAL_FILES = (*FILES[:3], "mean.png")
"""Written for three maps or more."""


def add(commands: Subcommands) -> None:
    """Add the command."""
    sub = add_command(
        commands,
        "compare",
        run,
        "Compare maps place by place: correlation, difference, overlap, by region; of three or more also the mean.",
        "la-flatten compare before.vtp after.vtp --array LGE --threshold 120 --output comparison",
    )
    sub.add_argument("a", metavar="A", help="a map as la-flatten flatten writes it (.vtp)")
    sub.add_argument("b", metavar="B", help="another, of the same template; or the same, to compare two of its arrays")
    sub.add_argument("others", metavar="C", nargs="*", help="more, to compare one array of all; A is the reference")
    sub.add_argument("--array", metavar="NAME", help="array of every map")
    sub.add_argument("--array-a", metavar="NAME", help="array of map A (of two)")
    sub.add_argument("--array-b", metavar="NAME", help="array of map B (of two)")
    sub.add_argument("--threshold", type=float, metavar="T", help="for the overlap (Dice): what counts on every map")
    sub.add_argument("--threshold-a", type=float, metavar="T", help="what counts on A (of two)")
    sub.add_argument("--threshold-b", type=float, metavar="T", help="and on B")
    sub.add_argument(
        "--direction",
        choices=DIRECTIONS,
        help="on which side of a threshold disease is (default: below for voltages, above for everything else)",
    )
    for letter in "ab":
        sub.add_argument(
            f"--direction-{letter}", choices=DIRECTIONS, help=f"the same for map {letter.upper()} (of two)"
        )
    sub.add_argument(
        "--scale",
        choices=("auto", "values", "ranks"),
        default="auto",
        help="of the difference of two maps: values of one quantity, or ranks of two (default: values if the arrays "
        "have one name)",
    )
    sub.add_argument("--template", metavar="NAME|FILE.json", help="of the maps (default: the one that they name)")
    sub.add_argument(
        "--output",
        required=True,
        metavar="DIR",
        help=f"folder for {', '.join(FILES)}; of three maps or more {SEVERAL_FILES[-1]} in place of {FILES[-1]}",
    )


def run(options: argparse.Namespace, progress: Progress) -> None:
    """Read, compare, write."""
    inputs = [options.a, options.b, *options.others]
    several = len(inputs) > 2
    arrays, thresholds, directions = _choices(options, several)
    folder = Path(options.output)
    paths = [folder / name for name in (SEVERAL_FILES if several else FILES)]
    check_figure_path(paths[2])
    progress(0.0, "Reading")
    maps = [MapData.of(read_surface(path), options.template) for path in inputs]
    names = names_of(inputs)
    progress(0.2, "Comparing")
    if several:
        all_found = compare_several(
            maps, names, arrays[0], thresholds[0], directions[0], progress=part(progress, 0.2, 0.5)
        )
        _write(
            paths,
            all_found,
            {},
            (lambda path: draw_several(all_found, path), lambda path: draw_spread(all_found, path)),
            progress,
        )
    else:
        found = compare_maps(maps[0], maps[1], *arrays, *thresholds, *directions, options.scale)
        pair = (names[0], names[1])
        _write(
            paths,
            found,
            {"a": pair[0], "b": pair[1]},
            (
                lambda path: draw_comparison(found, path, names=pair),
                lambda path: draw_difference(found, path, names=pair),
            ),
            progress,
        )
    # What lies there from an earlier comparison of another kind must not be taken for this one's.
    (folder / (FILES if several else SEVERAL_FILES)[-1]).unlink(missing_ok=True)
    progress.clear()
    if several:
        _report_several(all_found)
    else:
        _report(found)
    print("Wrote " + ", ".join(str(path) for path in paths))


def names_of(paths: Sequence[str]) -> list[str]:
    """A name for each file, with as many of its folders as tell it from the others; one given twice is numbered.

    Examples
    --------
    >>> names_of(["a/map.vtp", "b/map.vtp"]), names_of(["x/1.vtp", "x/2.vtp"])
    (['a/map.vtp', 'b/map.vtp'], ['1.vtp', '2.vtp'])
    """
    parts = [Path(path).resolve().parts for path in paths]
    longest = max(map(len, parts))
    for depth in range(1, longest):
        names = ["/".join(one[-depth:]) for one in parts]
        if len(set(names)) == len(set(parts)):
            break
    if len(set(names)) < len(names):
        names = [name if names.count(name) == 1 else f"{name} ({k + 1})" for k, name in enumerate(names)]
    return names


def _choices(
    options: argparse.Namespace, several: bool
) -> tuple[tuple[str, str], tuple[float | None, float | None], tuple[str, str]]:
    """Array, threshold and direction of A and B: what is given for all, or for each."""
    found: list[tuple[Any, ...]] = []
    for name in ("array", "threshold", "direction"):
        own = [getattr(options, f"{name}_{letter}") for letter in "ab"]
        common = getattr(options, name)
        if several and own != [None, None]:
            raise InputFileError(
                f"--{name}-a and --{name}-b are for two maps; found {2 + len(options.others)} maps. Give --{name}, "
                "which holds for all of them."
            )
        if common is not None and None not in own:
            raise InputFileError(f"--{name} holds for all maps: leave it out, or --{name}-a and --{name}-b.")
        found.append(tuple(common if one is None else one for one in own))
    arrays, thresholds, directions = found
    if None in arrays:
        raise InputFileError("Say what is compared: give --array NAME, or for two maps --array-a and --array-b.")
    if several and options.scale == "ranks":
        raise InputFileError("Ranks are compared of two maps only. Leave --scale out, or give two maps.")
    names = str(arrays[0]), str(arrays[1])
    sides = [direction or diseased_side(name) for direction, name in zip(directions, names, strict=True)]
    return names, (thresholds[0], thresholds[1]), (sides[0], sides[1])


def _write(
    paths: Sequence[Path],
    found: Comparison | SeveralMaps,
    inputs: dict[str, str],
    draw: Sequence[Callable[[Path], None]],
    progress: Progress,
) -> None:
    """Write the results and both pages: all of them, or none."""
    for path in paths:
        check_writable(path, make_folder=True)
    with ExitStack() as files:
        json_file, csv_file, *pages = (files.enter_context(atomic_write(path)) for path in paths)
        for number, (page, make) in enumerate(zip(pages, draw, strict=True)):
            progress(0.5 + 0.25 * number, "Drawing")
            make(page)
        csv_file.write_text(found.to_csv(), encoding="utf-8")
        json_file.write_text(json.dumps({**inputs, **found.to_dict()}, indent=2) + "\n", encoding="utf-8")


def _report(found: Comparison) -> None:
    for note in found.notes:
        print(f"Note: {note}")
    for one in found.parts:
        _report_part(one.name, one, found.scale)


def _report_several(found: SeveralMaps) -> None:
    for note in found.notes:
        print(f"Note: {note}")
    for (a, b), pair in found.pairs.items():
        _report_part(f"{found.names[a]} and {found.names[b]}", pair.whole, pair.scale)
    unit = f" {found.unit}" if found.unit else ""
    for one in found.parts:
        print(f"{one.name}: mean {one.mean:.4g}{unit}, SD between the maps {one.sd:.4g}{unit}")


def _report_part(name: str, found: Agreement, scale: str) -> None:
    dice = f", Dice {found.dice:.3f}" if found.dice == found.dice else ""
    print(
        f"{name}: {found.area_cm2:.1f} cm2, Pearson {digits(found.pearson, 3)}, Spearman {digits(found.spearman, 3)}, "
        f"B - A {found.difference:.4g} (SD {found.difference_sd:.4g}, {scale}){dice}"
    )
