"""``la-flatten measure``: sizes of an atrium, or of several together."""

from __future__ import annotations

import argparse
import json
from contextlib import ExitStack
from pathlib import Path

from ..errors import InputFileError
from ..files import atomic_write, check_writable, read_seeds, read_surface
from ..measurement import Measurement, measure, read_measurement
from ..shape_statistics import ShapeTable, tabulate
from ..study_figures import draw_box_plots
from ..template import DEFAULT_TEMPLATE, Template
from .command import Subcommands, add_command, check_distinct
from .progress import Progress

FILES = ("measurements.csv", "measurements.json", "measurements.png")


def add(commands: Subcommands) -> None:
    """Add the command."""
    sub = add_command(
        commands,
        "measure",
        run,
        "Measure perimeters of the openings and lengths between them, of one atrium or of several.",
        "la-flatten measure atrium.vtp --seeds seeds.mrk.json --output atrium.json\n"
        "  la-flatten measure --table a.json b.json c.json --output table",
    )
    sub.add_argument("surface", nargs="?", metavar="CAVITY", help="atrium in mm, open at its openings")
    sub.add_argument("--seeds", metavar="S", help="its seeds, as for la-flatten flatten")
    sub.add_argument("--table", nargs="+", metavar="M.json", help="files of this command: put them together")
    sub.add_argument(
        "--output", metavar="M.json|DIR", help="of one atrium the file; of a table the folder (default: printed only)"
    )
    sub.add_argument("--template", default=DEFAULT_TEMPLATE, metavar="NAME|FILE.json", help="names the anatomy")
    sub.add_argument("--ignore-axes", action="store_true", help="do not check the seeds against the patient axes")


def run(options: argparse.Namespace, progress: Progress) -> None:
    """Measure, or tabulate."""
    if options.table:
        if options.surface or options.seeds:
            raise InputFileError("--table takes files that were measured already: leave out CAVITY and --seeds.")
        _tabulate(options, progress)
        return
    if not (options.surface and options.seeds and options.output):
        raise InputFileError("Give an atrium, its --seeds and the --output M.json; or --table with files of before.")
    check_distinct(options, ("surface", "seeds", "template", "output"))
    check_writable(options.output)
    progress(0.0, "Reading")
    surface = read_surface(options.surface)
    seeds = read_seeds(options.seeds, surface.space)
    progress(0.3, "Measuring")
    found = measure(surface, seeds, Template.load(options.template).anatomy, not options.ignore_axes)
    content = {**found.to_dict(), "input": Path(options.surface).name}
    with atomic_write(options.output) as temporary:
        temporary.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    progress.clear()
    _print_one(found)
    print(f"Wrote {options.output}")


def _print_one(found: Measurement) -> None:
    for note in found.notes:
        print(f"Note: {note}")
    for what, sizes, ratios in (
        ("perimeter", found.perimeters_mm, found.perimeter_ratios),
        ("length", found.paths_mm, found.path_ratios),
    ):
        for name, size in sizes.items():
            ratio = f", {ratios[name]:.2f} times the reference" if ratios else ""
            print(f"  {name} {what} {size:.1f} mm{ratio}")
    print(f"  area of the cavity {found.area_cm2:.1f} cm2")


def _tabulate(options: argparse.Namespace, progress: Progress) -> None:
    measurements: dict[str, Measurement] = {}
    for path in options.table:
        name = Path(path).stem
        if name in measurements:
            raise InputFileError(f'Two of the files are called "{name}"; expected a name for each atrium.')
        measurements[name] = read_measurement(path)
    table = tabulate(measurements)
    written: list[Path] = []
    if options.output:
        folder = Path(options.output)
        paths = {name: folder / name for name in FILES}
        for path in paths.values():
            check_writable(path, make_folder=True)
        with ExitStack() as files:
            progress(0.5, "Drawing")
            draw_box_plots(table, files.enter_context(atomic_write(paths["measurements.png"])))
            for name, text in (
                ("measurements.csv", table.to_csv()),
                ("measurements.json", json.dumps(table.to_dict(), indent=2) + "\n"),
            ):
                files.enter_context(atomic_write(paths[name])).write_text(text, encoding="utf-8")
        written = list(paths.values())
    progress.clear()
    _print_table(table)
    if written:
        print("Wrote " + ", ".join(str(path) for path in written))


def _print_table(table: ShapeTable) -> None:
    print(f"{len(table.names)} atria; mean, SD, median, smallest to largest:")
    for spread in table.spreads:
        s = spread.summary
        unit = " mm" if spread.unit == "mm" else ""
        sd = "-" if s["sd"] is None else f"{s['sd']:.2f}"
        print(
            f"  {spread.group} {spread.name}: {s['mean']:.2f}, {sd}, {s['median']:.2f}, {s['smallest']:.2f} to "
            f"{s['largest']:.2f}{unit}"
        )
    for test in table.tests:
        p = [
            f"{name} p = {value:.2g}" if value is not None else f"{name}: too few atria, or no difference"
            for name, value in (("Wilcoxon", test.p_wilcoxon), ("t", test.p_t))
        ]
        print(f"  {test.group} {test.second} - {test.first}: median {test.median_difference:+.2f} mm, {', '.join(p)}")
