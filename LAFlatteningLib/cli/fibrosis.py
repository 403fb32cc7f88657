"""``la-flatten fibrosis``: areas of fibrosis, or of low voltage, by thresholds."""

from __future__ import annotations

import argparse
import json
from contextlib import ExitStack

from ..analysis_figures import draw_fibrosis
from ..blood_pool import BloodPool, blood_pool_of_labels, find_blood_pool, given_blood_pool
from ..errors import InputFileError
from ..fibrosis import DIRECTIONS, Fibrosis, Rule, measure_fibrosis, on_atrium
from ..files import atomic_write, check_writable, read_surface, read_volume
from ..map_data import MapData
from ..page import check_figure_path
from ..parcellation import Parcellation, builtin_parcellations, parcels_of
from ..quantities import diseased_side
from ..surface import Surface
from ..volume import Volume
from .command import Subcommands, add_command, check_distinct
from .progress import Progress


def add(commands: Subcommands) -> None:
    """Add the command."""
    sub = add_command(
        commands,
        "fibrosis",
        run,
        "Measure areas beyond thresholds (fibrosis, low voltage) on the atrium, by region.",
        "la-flatten fibrosis map.vtp --array LGE --rule iir=1.2,1.32 --volume lge.nrrd --output fibrosis.json",
    )
    sub.add_argument("map", metavar="MAP", help="a map as la-flatten flatten writes it, or an atrium in 3D (.vtp)")
    sub.add_argument("--array", required=True, metavar="NAME", help="what is measured, a scalar array")
    sub.add_argument(
        "--rule",
        required=True,
        metavar="RULE=K[,K...]",
        help="iir: ratio to the mean of the blood pool; sd: mean of the blood pool + K standard deviations; value: in "
        "the units of the array. Several thresholds from normal to diseased",
    )
    sub.add_argument(
        "--direction",
        choices=DIRECTIONS,
        help="on which side of the thresholds disease is (default: below for voltages, above for everything else)",
    )
    sub.add_argument(
        "--volume",
        metavar="V",
        help="image in which the blood pool is measured, inside the atrium; an array that was projected from it is "
        "sampled again, within the triangles",
    )
    sub.add_argument("--blood-pool-labels", metavar="L", help="label map of the blood, in place of the inside")
    sub.add_argument("--blood-pool-label", type=int, metavar="N", help="its label (default: every one but 0)")
    sub.add_argument(
        "--blood-pool",
        metavar="MEAN,SD",
        help="the blood pool as numbers, without an image (a negative one as --blood-pool=-10,5)",
    )
    sub.add_argument(
        "--parcellation",
        action="append",
        default=[],
        metavar="NAME|FILE.json",
        help=f"further parts to measure, may be repeated: {', '.join(builtin_parcellations())}, or a file",
    )
    sub.add_argument("--template", metavar="NAME|FILE.json", help="of the map (default: the one that the map names)")
    sub.add_argument("--unit", help="of the array, like mV (default: that of a known quantity)")
    sub.add_argument(
        "--names", metavar="A,B[,...]", help="names of the classes, from normal on (default: by the quantity)"
    )
    sub.add_argument("--output", required=True, metavar="F.json", help="areas and percentages")
    sub.add_argument("--csv", metavar="F.csv", help="the same as a table")
    sub.add_argument("--figure", metavar="F.png", help="a picture with the classes (.png .pdf .svg)")


def run(options: argparse.Namespace, progress: Progress) -> None:
    """Read, measure, write."""
    if options.figure:
        check_figure_path(options.figure)
    check_distinct(options, ("map", "volume", "blood_pool_labels", "template", "output", "csv", "figure"))
    rule = Rule.parse(options.rule, options.direction or diseased_side(options.array))
    _check_options(options, rule)
    outputs = [path for path in (options.output, options.csv, options.figure) if path]
    for path in outputs:
        check_writable(path)
    progress(0.0, "Reading")
    atrium: Surface | MapData = read_surface(options.map)
    assert isinstance(atrium, Surface)
    flat = atrium.points[:, 2].min() == atrium.points[:, 2].max()
    if flat:
        atrium = MapData.of(atrium, options.template)
    elif options.parcellation or options.template:
        raise InputFileError(f'"{options.map}" is no map: a parcellation and a template need one. Flatten it first.')
    parcels = parcels_of(atrium, options.parcellation) if isinstance(atrium, MapData) else {}
    progress(0.2, "Measuring the blood pool")
    volume = read_volume(options.volume) if options.volume else None
    pool = _blood_pool(options, on_atrium(atrium)[0], volume)
    progress(0.5, "Measuring")
    names = [name.strip() for name in options.names.split(",")] if options.names else None
    found = measure_fibrosis(
        atrium,
        options.array,
        rule,
        pool,
        parcels=parcels,
        class_names=names,
        unit=options.unit,
        volume=volume,
    )
    with ExitStack() as files:
        if options.figure:
            progress(0.6, "Drawing")
            draw_fibrosis(
                atrium,
                found,
                files.enter_context(atomic_write(options.figure)),
                parcellations=[Parcellation.load(name) for name in options.parcellation],
            )
        if options.csv:
            files.enter_context(atomic_write(options.csv)).write_text(found.to_csv(), encoding="utf-8")
        text = json.dumps(found.to_dict(), indent=2) + "\n"
        files.enter_context(atomic_write(options.output)).write_text(text, encoding="utf-8")
    progress.clear()
    _report(found, on_atrium(atrium)[0].axes_known)
    print("Wrote " + ", ".join(outputs))


def _check_options(options: argparse.Namespace, rule: Rule) -> None:
    """Raise InputFileError for options that contradict each other, before any work."""
    if options.blood_pool and (options.volume or options.blood_pool_labels):
        raise InputFileError("--blood-pool gives the blood pool as numbers: leave out --volume and its label map.")
    if options.blood_pool_labels and not options.volume:
        raise InputFileError("--blood-pool-labels says where blood is: give the image with --volume.")
    if options.blood_pool_label is not None and not options.blood_pool_labels:
        raise InputFileError("--blood-pool-label chooses a label: give the label map with --blood-pool-labels.")
    if rule.needs_blood_pool and not (options.volume or options.blood_pool):
        raise InputFileError(
            f"The rule {rule.kind} compares with the blood pool: give the image with --volume, or mean and standard "
            "deviation with --blood-pool MEAN,SD."
        )


def _blood_pool(options: argparse.Namespace, surface: Surface, volume: Volume | None) -> BloodPool | None:
    if options.blood_pool:
        try:
            mean, sd = (float(word) for word in options.blood_pool.split(","))
        except ValueError:
            raise InputFileError(f'--blood-pool "{options.blood_pool}": expected two numbers, MEAN,SD.') from None
        return given_blood_pool(mean, sd)
    if volume is None:
        return None
    if options.blood_pool_labels:
        return blood_pool_of_labels(volume, read_volume(options.blood_pool_labels), options.blood_pool_label)
    return find_blood_pool(surface, volume)


def _report(found: Fibrosis, axes_known: bool) -> None:
    for note in found.notes:
        print(f"Note: {note}")
    if found.blood_pool is not None:
        pool = found.blood_pool
        where = ""
        if pool.centre_mm is not None:
            place, axes = ", ".join(f"{x:.0f}" for x in pool.centre_mm), " LPS" if axes_known else ""
            where = f"; {pool.voxels} voxels, {pool.volume_ml:.1f} ml about ({place}) mm{axes}"
        print(f"blood pool: mean {pool.mean:.4g}, SD {pool.sd:.4g} ({pool.how}{where})")
    if found.sampled_mm is not None:
        print(f"image sampled every {found.sampled_mm:.2f} mm along the wall")
    print("classes: " + "; ".join(found.class_label(k) for k in range(len(found.class_names))))
    for part in found.parts:
        classes = zip(found.class_names[1:], part.class_percent[1:], part.class_cm2[1:], strict=True)
        words = [f"{name} {share:.1f} % ({area:.1f} cm2)" for name, share, area in classes]
        print(f"  {part.name}: {part.area_cm2:.1f} cm2; {', '.join(words)}")
