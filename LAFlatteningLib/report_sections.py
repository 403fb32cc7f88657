"""What each results file of a run says, put for a cardiologist: a section of the report each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .fibrosis import limits_text
from .flattening.flat_map import USUAL_DILATATION
from .gaps.quantification import scar_words
from .quantities import readable
from .report import Picture, Section, Table

Content = Mapping[str, Any]
"""Of a results file (see Docs/formats.md)."""

MOST_ROWS = 40
"""Longer lists are left to the file that holds them."""


def summary_section(fibrosis: Content | None, gaps: Content | None, comparison: Content | None) -> Section | None:
    """The main findings in a few lines; None where nothing was measured."""
    rows: list[tuple[str, str]] = []
    if fibrosis is not None:
        whole, names = fibrosis["parts"][0], fibrosis["classes"]
        for index in range(1, len(names)):
            limits = limits_text(fibrosis["thresholds"], fibrosis["direction"], fibrosis["unit"], index)
            share = _percent_words(whole["class_percent"][index])
            area = f"{whole['class_cm2'][index]:.1f} cm2"
            rows.append((f"{fibrosis['array']}: {names[index]} ({limits})", f"{share} of the wall, {area}"))
    if gaps is not None:
        for name, ring in _shown(gaps)["areas"].items():
            count = ring["gap_count"] + ring["small_gaps"]
            found = f"{count} gap{'s' if count > 1 else ''}, {ring['gap_length_mm']:.1f} mm (RGM {ring['rgm']:.2f})"
            where = name if len(ring["openings"]) == 1 else f"the {name} veins together"
            rows.append((f"Scar round {where}", "complete" if ring["complete"] else found))
    if comparison is not None:
        pearson = comparison["parts"][0]["pearson"]
        agreement = "none (one of them is the same everywhere)" if pearson is None else f"Pearson r = {pearson:.2f}"
        rows.append((f"Correlation of {comparison['array_a']} with the second map", agreement))
    words = ["Scar round veins, complete or not, says something only after an ablation."] if gaps is not None else []
    return Section("Findings", words, [Table(("", "found"), rows)]) if rows else None


def map_section(metrics: Content, pictures: list[Picture]) -> Section:
    """The map and its quality, from the content of a metrics file."""
    rows: list[tuple[str, Any, str | None]] = [
        ("folded triangles", metrics.get("folded_triangles"), "0"),
        ("overlapping pairs of triangles", metrics.get("overlapping_pairs"), "0"),
        ("largest distance of a rim from its outline (% of the disk radius)", _percent(metrics, "rim_error"), "0"),
        ("largest distance of a path from its line (% of the disk radius)", _percent(metrics, "path_drift"), "0"),
        ("isotropy beta, mean (1: all angles kept)", _get(metrics, "beta", "mean"), None),
        ("area ratio alpha, 5th percentile (1: areas kept)", _get(metrics, "alpha", "p5"), None),
        ("area ratio alpha, 95th percentile", _get(metrics, "alpha", "p95"), None),
        ("dilatation, 99th percentile", _get(metrics, "dilatation", "p99"), f"4 to 10; {USUAL_DILATATION:g} is noted"),
    ]
    moved = metrics.get("seed_moved_mm")
    if moved:
        rows.append(("farthest that a seed was moved to its opening (mm)", max(moved.values()), None))
    how = [
        f"Method {metrics.get('method', 'unknown')}, template {metrics.get('template', 'unknown')}; "
        f"{metrics.get('points', 'unknown')} points, {metrics.get('triangles', 'unknown')} triangles.",
        "Every place of the atrium has a fixed place on the map, so that maps of different patients, or of one patient "
        "at different times, can be laid over each other.",
    ]
    table = Table(("quality", "found", "usual"), rows, "Quality of the map")
    return Section("Map", how, [table], pictures, list(metrics.get("notes", [])))


def fibrosis_section(fibrosis: Content, pictures: list[Picture]) -> Section:
    """Areas of the classes, from the content of a fibrosis file."""
    names, unit = fibrosis["classes"], fibrosis["unit"]
    kind, _, factors = fibrosis["rule"].partition("=")
    listed = factors.replace(",", " and ")
    rules = {
        "iir": f"Thresholds are {listed} times the mean of the blood pool (image intensity ratio).",
        "sd": f"Thresholds are the mean of the blood pool plus {listed} of its standard deviations.",
        "value": "Thresholds are values that were given.",
    }
    words = [
        f"{rules[kind]} Areas are measured on the atrium in 3D; percentages are of the area that has values.",
    ]
    if fibrosis["sampled_mm"] is not None:
        words.append(f"The image was sampled every {fibrosis['sampled_mm']:.1f} mm within the triangles.")
    pool = fibrosis["blood_pool"]
    if pool:
        where = ""
        if pool["centre_mm"] is not None:
            place = ", ".join(f"{x:.0f}" for x in pool["centre_mm"])
            where = f": {pool['voxels']} voxels, {pool['volume_ml']:.1f} ml about ({place}) mm LPS"
        words.append(f"Blood pool: mean {readable(pool['mean'])}, SD {readable(pool['sd'])} ({pool['how']}{where}).")
    parts = fibrosis["parts"]
    whole = parts[0]
    limits = [limits_text(fibrosis["thresholds"], fibrosis["direction"], unit, k) for k in range(len(names))]
    classes = Table(
        ("class", fibrosis["array"], "area (cm2)", "share (%)"),
        [
            (name, limit, round(area, 1), _rounded(share, 1))
            for name, limit, area, share in zip(names, limits, whole["class_cm2"], whole["class_percent"], strict=True)
        ],
        "The whole atrium",
    )
    some_missing = any(part["missing_cm2"] > 0.0 for part in parts)
    missing = ("no value (cm2)",) if some_missing else ()
    columns = ("part", "area (cm2)", *(f"{name} (%)" for name in names), "mean", *missing)
    rows = [
        (
            _part_name(part),
            round(part["area_cm2"], 1),
            *(_rounded(share, 1) for share in part["class_percent"]),
            part["mean"],
            *((round(part["missing_cm2"], 1),) if some_missing else ()),
        )
        for part in parts
    ]
    tables = [classes, Table(columns, rows[:MOST_ROWS], _caption("By part of the atrium", rows, "fibrosis"))]
    title = "Fibrosis" if not unit else fibrosis["array"]
    title = title if fibrosis["direction"] == "above" else f"Low {fibrosis['array']}"
    return Section(title, words, tables, pictures, list(fibrosis["notes"]))


def gap_section(gaps: Content, pictures: list[Picture]) -> Section:
    """Gaps in ablation lines, from the content of a gap file."""
    results, shown = gaps["results"], _shown(gaps)
    words = [
        f"Scar is {scar_words(gaps['array'], gaps['direction'], shown['threshold'])}. Round each vein, and round the "
        "veins of each side together, the closed path with the least length outside scar was looked for "
        f"({gaps['search']}). Its pieces outside scar are the gaps; the relative gap measure (RGM) is their share of "
        "the path: 0 is a complete ring, 1 is no scar at all. Without an ablation round the veins these figures say "
        "nothing.",
    ]
    if gaps["minimum_mm"]:
        words.append(f"Gaps shorter than {gaps['minimum_mm']:g} mm are counted, not listed.")
    areas = shown["areas"]
    summary = Table(
        ("round", "gaps", "gap length (mm)", "scar length (mm)", "RGM", "longest gap (mm)"),
        [
            (
                name,
                "complete" if ring["complete"] else str(ring["gap_count"] + ring["small_gaps"]),
                round(ring["gap_length_mm"], 1),
                round(ring["scar_length_mm"], 1),
                round(ring["rgm"], 3),
                round(max((gap["length_mm"] for gap in ring["gaps"]), default=0.0), 1) if ring["gaps"] else None,
            )
            for name, ring in areas.items()
        ],
        f"Gaps at the threshold {readable(shown['threshold'])}",
    )
    listed = [
        (name, round(gap["length_mm"], 1), gap["segment"], round(gap["angle_degrees"]))
        for name, ring in areas.items()
        for gap in ring["gaps"]
    ]
    tables = [summary]
    if listed:
        columns = ("round", "length (mm)", "segment", "angle on the map (degrees)")
        tables.append(Table(columns, listed[:MOST_ROWS], _caption("Each gap", listed, "gaps")))
    if len(results) > 1:
        names = list(gaps["rgm_over_threshold"])
        rows = [
            (level, *(round(gaps["rgm_over_threshold"][name][k], 3) for name in names))
            for k, level in enumerate(gaps["thresholds"])
        ]
        tables.append(Table((f"threshold of {gaps['array']}", *names), rows, "RGM over the threshold"))
    return Section("Gaps in ablation lines", words, tables, pictures, list(gaps["notes"]))


def comparison_section(comparison: Content, pictures: list[Picture]) -> Section:
    """How two maps agree, from the content of a comparison file."""
    a, b = (f"{comparison[f'array_{letter}']} of {comparison[letter]}" for letter in "ab")
    scale = (
        "The difference B - A is in the unit of the arrays."
        if comparison["scale"] == "values"
        else "The two cannot be subtracted: the difference B - A is of percentiles, each value among those of its own "
        "map, by area, from normal to diseased."
    )
    words = [
        f"A is {a}, B is {b}. Both were read at the same places of the template {comparison['template']}, each of "
        f"which counts by its area on the atria. {scale}",
    ]
    overlap = comparison["threshold_a"] is not None
    if overlap:
        limits = [
            f"{letter.upper()} {'from' if comparison[f'direction_{letter}'] == 'above' else 'below'} "
            f"{readable(comparison[f'threshold_{letter}'])}"
            for letter in "ab"
        ]
        words.append(f"Dice is the overlap of {' and '.join(limits)}: 0 none, 1 the same.")
    columns = ["part", "area (cm2)", "Pearson r", "Spearman rho", "mean A", "mean B", "B - A", "SD of B - A"]
    columns += ["no value (%)", *(("A beyond (%)", "B beyond (%)", "Dice") if overlap else ())]
    rows = []
    for part in comparison["parts"]:
        name = part["name"] if part["region"] == 0 else f"R{part['region']} {part['name']}"
        row = [name, round(part["area_cm2"], 1), _rounded(part["pearson"], 3), _rounded(part["spearman"], 3)]
        row += [part["mean_a"], part["mean_b"], part["difference"], part["difference_sd"]]
        row += [_rounded(part["missing_percent"], 1)]
        if overlap:
            row += [_rounded(part["percent_a"], 1), _rounded(part["percent_b"], 1), _rounded(part["dice"], 3)]
        rows.append(row)
    table = Table(columns, rows, "Agreement by region")
    return Section("Comparison", words, [table], pictures, list(comparison["notes"]))


def preparation_section(preparation: Content, pictures: list[Picture]) -> Section:
    """What was cut and mended, from the content of a preparation report. All of it is to be known: repairs are
    warnings, too."""
    words = []
    sizes = [
        f"{name}: {preparation[key]['points']} points, {preparation[key]['area_cm2']:.1f} cm2, "
        f"{preparation[key]['volume_ml']:.1f} ml"
        for name, key in (("The atrium as given", "input"), ("the cavity that was flattened", "cavity"))
        if key in preparation
    ]
    if sizes:
        words.append("; ".join(sizes) + ".")
    if "confidence" in preparation:
        words.append(f"Confidence in which opening is which: {preparation['confidence']}.")
    tables = []
    planes = preparation.get("planes", {})
    if planes:
        rows = [
            (name, opening["found_by"], *_sizes_of(opening), _place(opening["centre_mm"]))
            for name, opening in planes.items()
        ]
        columns = ("opening", "found by", "perimeter (mm)", "kept beyond the ostium (mm)", "centre")
        tables.append(Table((*columns[:-1], f"centre (mm, {preparation['space']})"), rows, "Openings"))
    extra = [(opening["found_by"], *_sizes_of(opening)) for opening in preparation.get("extra_veins", [])]
    if extra:
        tables.append(Table(("found by", "perimeter (mm)", "kept (mm)"), extra, "Further veins"))
    handles = [(handle["kind"], round(handle["width_mm"], 1)) for handle in preparation.get("handles", [])]
    if handles:
        tables.append(Table(("handle", "width (mm)"), handles, "Handles that were opened"))
    warnings = [*preparation.get("repairs", []), *preparation.get("notes", [])]
    if preparation.get("confidence") == "low" and not preparation.get("notes"):
        warnings.append("It is not certain which opening is which. Check the names in the picture.")
    return Section("Preparation of the atrium", words, tables, pictures, warnings)


def _shown(gaps: Content) -> Content:
    """The result of a gap file that is shown: the middle threshold, as in its picture."""
    shown: Content = gaps["results"][len(gaps["results"]) // 2]
    return shown


def _part_name(part: Content) -> str:
    if part["group"] == "atrium":
        return str(part["name"])
    return f"R{part['label']} {part['name']}" if part["group"] == "region" else f"{part['name']} ({part['group']})"


def _caption(text: str, rows: list[Any], file: str) -> str:
    return text if len(rows) <= MOST_ROWS else f"{text} ({MOST_ROWS} of {len(rows)}; all are in {file}.json)"


def _sizes_of(opening: Content) -> tuple[float | None, float | None]:
    length = opening.get("rim_perimeter_mm", opening["perimeter_mm"])
    return _rounded(length, 1), _rounded(opening["kept_mm"], 1)


def _place(place: Any) -> str:
    return ", ".join(f"{x:.1f}" for x in place)


def _percent_words(value: float | None) -> str:
    return "no value" if value is None else f"{value:.1f} %"


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)


def _percent(metrics: Content, key: str) -> float | None:
    value = metrics.get(key)
    return None if value is None else round(100.0 * float(value), 3)


def _get(data: Content, *keys: str) -> Any:
    value: Any = data
    for key in keys:
        value = value.get(key) if isinstance(value, Mapping) else None
    return value
