"""``la-flatten run``: from raw input to map, metrics, figures and report with no further question."""

from __future__ import annotations

import argparse
import json
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from ..analysis_figures import draw_comparison, draw_difference, draw_fibrosis
from ..anatomy import LEFT_ATRIUM
from ..blood_pool import BloodPool, find_blood_pool
from ..comparison import compare_maps
from ..errors import InputFileError, LAFlatteningError, SurfaceError
from ..fibrosis import Fibrosis, Rule, measure_fibrosis
from ..figures import check_figure_path
from ..files import atomic_write, check_writable, read_surface, read_volume
from ..flattening import METHODS, FlatMap, Flattener
from ..gaps import GapReport, find_gaps
from ..gaps.figures import draw_gaps
from ..gaps.search_areas import SEARCH_MM
from ..map_data import MapData
from ..parcellation import Parcellation, builtin_parcellations, parcels_of
from ..preparation import Preparation, prepare
from ..progress import part
from ..projection import project
from ..quantities import bipolar_array, diseased_side
from ..rules import LOW_VOLTAGE_MV
from ..run_report import write_run_report
from ..scalar_arrays import corner_values
from ..surface import Surface
from ..template import DEFAULT_TEMPLATE, Template, builtin_templates
from ..volume import Volume
from .command import Subcommands, add_command, report_map, write_map
from .prepare import (
    add_input_options,
    read_given,
    read_input,
    report_preparation,
    settings_of,
    write_cavity,
    write_report,
)
from .progress import Progress

FILES = ("cavity.vtp", "seeds.mrk.json", "map.vtp", "metrics.json", "prepare.json", "figure.png", "report.html")
MEASURED_FILES = ("fibrosis.json", "fibrosis.csv", "fibrosis.png", "gaps.json", "gaps.png")
"""Also written where there is something to measure: an image, bipolar voltage, or an array and a rule."""
SECOND_FILES = ("comparison.json", "comparison.csv", "comparison.png", "difference.png")
"""Also written where a second map is given."""
ARRAY = "LGE"
"""Point array of the projected intensities."""
BY_TEMPLATE = "vein_surroundings"
"""Parcellation in which gaps are looked for where `SEARCH_MM` is too much."""
DEFAULT_RULE, VOLTAGE_RULE = "sd=2.3,3.3", "value=" + ",".join(f"{level:g}" for level in LOW_VOLTAGE_MV)
"""Common classes of fibrosis that hold for intensities on any scale, and of bipolar voltage, in mV."""


def add(commands: Subcommands) -> None:
    """Add the command."""
    sub = add_command(
        commands,
        "run",
        run,
        "From a raw atrium to its map and report: prepare, flatten, measure, draw.",
        "la-flatten run labels.nrrd --volume lge.nrrd --output result",
    )
    add_input_options(sub)
    sub.add_argument("--output", required=True, metavar="DIR", help="folder for " + ", ".join(FILES))
    sub.add_argument("--volume", metavar="LGE", help="image to project onto the wall, and to measure fibrosis in")
    sub.add_argument(
        "--rule",
        help="classes, sd=K,.. iir=R,.. or value=V,.. from normal to diseased, of the image, or else of --array; the "
        f"first threshold is also that of gaps in ablation lines (default: {DEFAULT_RULE} of an image, {VOLTAGE_RULE} "
        "mV of bipolar voltage). Measuring adds " + ", ".join(MEASURED_FILES),
    )
    sub.add_argument(
        "--parcellation",
        action="append",
        default=[],
        metavar="NAME|FILE.json",
        help=f"sub-regions to measure in, may be repeated: {', '.join(builtin_parcellations())}, or a file",
    )
    sub.add_argument("--second", metavar="MAP.vtp", help="another map to compare with; adds " + ", ".join(SECOND_FILES))
    sub.add_argument(
        "--array",
        metavar="NAME",
        help="array that is drawn, and compared with the other map; measured by --rule where no image is given "
        f"(default: {ARRAY}, the image; to be measured, bipolar voltage)",
    )
    sub.add_argument("--second-array", metavar="NAME", help="array of the other map (default: the same)")
    sub.add_argument("--method", choices=METHODS, default=METHODS[0], help="default: %(default)s")
    sub.add_argument(
        "--template",
        default=DEFAULT_TEMPLATE,
        metavar="NAME|FILE.json",
        help=f"{', '.join(builtin_templates('left_atrium'))}, or a template file (default: %(default)s)",
    )


def run(options: argparse.Namespace, progress: Progress) -> None:
    """Read, prepare, flatten, write; after an error the folder has what was reached, and in ``prepare.json`` why."""
    folder = Path(options.output)
    files = {name: folder / name for name in (*FILES, *MEASURED_FILES, *SECOND_FILES)}
    check_figure_path(files["figure.png"])
    _check_options(options)
    progress(0.0, "Reading")
    surface, notes, is_label_map = read_input(options, part(progress, 0.0, 0.1))
    settings = settings_of(options, is_label_map)
    tips, planes = read_given(options, surface.space)
    _check_array(options, surface)
    measured = _measured(options, surface)
    template = Template.load(options.template)
    if set(template.anatomy.seeds) != set(LEFT_ATRIUM.seeds):
        raise InputFileError(
            f'--template "{options.template}" is of the anatomy {template.anatomy.name}; only left atria are prepared '
            "and seeded by themselves. Cut the chamber open, place its seeds and use la-flatten flatten."
        )
    parcellations = [Parcellation.load(name) for name in options.parcellation]
    for parcellation in parcellations:
        parcellation.check_template(template)
    volume = read_volume(options.volume) if options.volume else None
    second = MapData.of(read_surface(options.second), options.template) if options.second else None
    if second is not None:
        corner_values(second.surface, options.second_array or options.array or ARRAY)
    for path in files.values():
        if path.resolve() in {
            Path(given).resolve() for given in (options.input, options.volume, options.second) if given
        }:
            raise InputFileError(f'"{path}" is both read and written. Choose another folder for --output.')
        check_writable(path, make_folder=True)
    # What lies there from an earlier run must not be taken for this one's.
    for path in files.values():
        path.unlink(missing_ok=True)
    preparation = Preparation(surface, repairs=notes)
    pool = None
    searched: list[str] = []
    try:
        prepare(surface, settings, tips=tips, planes=planes, into=preparation, progress=part(progress, 0.1, 0.45))
        try:
            if volume is not None:
                pool = _project(preparation, volume)
        finally:
            # Also where the image does not fit: what was cut is right all the same.
            with ExitStack() as written:
                write_cavity(preparation, files["cavity.vtp"], files["seeds.mrk.json"], written)
        assert preparation.cavity is not None
        flattener = Flattener(preparation.cavity, template, options.method, check_axes=not options.ignore_axes)
        flat_map = flattener.flatten(preparation.seeds, part(progress, 0.45, 0.7))
        write_map(flat_map, files["map.vtp"], files["metrics.json"], files["figure.png"], options.array, progress)
        if measured is not None:
            progress(0.75, "Measuring fibrosis and gaps" if volume is not None else f"Measuring {measured[0]}")
            fibrosis, (gaps, searched) = _measure(flat_map, *measured, volume, pool, parcellations, files)
            if gaps is None:
                # There is no other place to say why.
                preparation.repairs, searched = preparation.repairs + searched, []
            searched = [*fibrosis.notes, *searched]
        if second is not None:
            progress(0.9, "Comparing")
            _compare(flat_map, second, options, files)
    except LAFlatteningError as error:
        write_report(preparation, files["prepare.json"], str(error))
        raise
    write_report(preparation, files["prepare.json"])
    inputs = [path for path in (options.input, options.volume, options.second) if path]
    write_run_report(folder, files["report.html"], inputs=inputs)
    progress.clear()
    report_preparation(preparation)
    for note in searched:
        print(f"Note: {note}")
    report_map(flat_map, [str(path) for path in files.values() if path.exists()])


def _check_options(options: argparse.Namespace) -> None:
    """Raise InputFileError for options that would have no effect, before any work."""
    if options.second_array and not options.second:
        raise InputFileError("--second-array says what is compared with another map: give that with --second.")


def _check_array(options: argparse.Namespace, surface: Surface) -> None:
    """Raise LAFlatteningError, before any work, for an array to draw or compare that the map will not have."""
    known = sorted({*surface.point_data, *surface.cell_data, *([ARRAY] if options.volume else [])})
    array = options.array or (ARRAY if options.second else None)
    if array is not None and array not in known:
        raise LAFlatteningError(
            f'The atrium has no array "{array}"; found {", ".join(known) or "none"}. Check its name, or give another '
            "with --array."
        )


def _measured(options: argparse.Namespace, surface: Surface) -> tuple[str, Rule] | None:
    """The array that is measured, and by which rule; None where there is nothing to measure.

    Raises
    ------
    LAFlatteningError : a rule, or sub-regions to measure in, for nothing.
    """
    if options.volume:
        return ARRAY, Rule.parse(options.rule or DEFAULT_RULE)
    voltage = bipolar_array([*surface.point_data, *surface.cell_data])
    asked = next((f"--{name}" for name in ("rule", "parcellation") if getattr(options, name)), None)
    array = options.array if options.rule and options.array else voltage
    if array is None:
        if asked is None:
            return None
        raise InputFileError(
            f"{asked} says how something is measured, and there is nothing to measure: give the image with --volume, "
            "or the name of an array of the atrium with --array and its thresholds with --rule value=..."
        )
    rule = Rule.parse(options.rule or VOLTAGE_RULE, diseased_side(array))
    if rule.needs_blood_pool:
        raise InputFileError(
            f"The rule {rule.kind} compares with the blood pool: give the image with --volume, or take "
            f"--rule value=... for {array}."
        )
    try:
        corner_values(surface, array)
    except LAFlatteningError:
        if asked is None:
            # An empty column, which nobody asked for.
            return None
        raise
    return array, rule


def _project(preparation: Preparation, volume: Volume) -> BloodPool:
    """Put the intensities of the wall on the cavity; returns the blood inside it."""
    cavity = preparation.cavity
    assert isinstance(cavity, Surface)
    found = project(cavity, volume)
    preparation.cavity = found.on(cavity, ARRAY)
    preparation.repairs += found.notes
    return find_blood_pool(cavity, volume)


def _measure(
    flat_map: FlatMap,
    array: str,
    rule: Rule,
    volume: Volume | None,
    pool: BloodPool | None,
    parcellations: list[Parcellation],
    files: dict[str, Path],
) -> tuple[Fibrosis, tuple[GapReport | None, list[str]]]:
    """Write fibrosis (or low voltage) by region, and gaps at its first threshold; returns both, see `search_gaps`."""
    fibrosis = measure_fibrosis(flat_map, array, rule, pool, parcels=parcels_of(flat_map, parcellations), volume=volume)
    gaps, notes = search_gaps(flat_map, array, fibrosis.thresholds[0])
    with ExitStack() as written:
        page = written.enter_context(atomic_write(files["fibrosis.png"]))
        draw_fibrosis(flat_map, fibrosis, page, parcellations=parcellations)
        found = {"fibrosis.json": fibrosis.to_dict()}
        if gaps is not None:
            found["gaps.json"] = gaps.to_dict()
            draw_gaps(MapData.of(flat_map), gaps, written.enter_context(atomic_write(files["gaps.png"])))
        for name, content in found.items():
            text = json.dumps(content, indent=2) + "\n"
            written.enter_context(atomic_write(files[name])).write_text(text, encoding="utf-8")
        written.enter_context(atomic_write(files["fibrosis.csv"])).write_text(fibrosis.to_csv(), encoding="utf-8")
    return fibrosis, (gaps, notes)


def search_gaps(flat_map: FlatMap, array: str, threshold: float) -> tuple[GapReport | None, list[str]]:
    """Gaps round the veins, if possible within `SEARCH_MM` of them; and what the user should know of the search.

    In a narrow atrium these areas may run into another opening; those that are drawn on the template do less often.
    """
    notes = []
    for search, where in (
        (SEARCH_MM, f"within {SEARCH_MM:g} mm of"),
        (BY_TEMPLATE, "in the areas of the template round"),
    ):
        try:
            gaps = find_gaps(flat_map, array, (threshold,), search=search)
        except SurfaceError as error:
            notes.append(f"Gaps were not looked for {where} the veins: {error}")
            continue
        if notes:
            notes.append(
                "They were looked for in the areas that are drawn round the veins on the template instead, of which "
                "the width in mm differs from atrium to atrium: compare their lengths with other atria with care."
            )
        notes += gaps.notes
        return replace(gaps, notes=tuple(notes)), notes
    return None, notes


def _compare(flat_map: FlatMap, second: MapData, options: argparse.Namespace, files: dict[str, Path]) -> None:
    """Write how this map agrees with another."""
    array = options.array or ARRAY
    found = compare_maps(MapData.of(flat_map), second, array, options.second_array or array)
    names = ("this map", Path(options.second).name)
    with ExitStack() as written:
        draw_difference(found, written.enter_context(atomic_write(files["difference.png"])), names=names)
        draw_comparison(found, written.enter_context(atomic_write(files["comparison.png"])), names=names)
        text = json.dumps({"a": names[0], "b": names[1], **found.to_dict()}, indent=2) + "\n"
        written.enter_context(atomic_write(files["comparison.json"])).write_text(text, encoding="utf-8")
        written.enter_context(atomic_write(files["comparison.csv"])).write_text(found.to_csv(), encoding="utf-8")
