"""The cardiologist's report of a run: what each file of the folder says, in sections."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import date
from pathlib import Path
from typing import Any

from .errors import InputFileError
from .flattening.flat_map import USUAL_DILATATION
from .gaps.places import ALL_ROUND, WIDE_MM, extent_words
from .gaps.quantification import scar_words
from .report import Fixed, Picture, Section, Table, write_report
from .report_sections import comparison_section, fibrosis_section, preparation_section, summary_section
from .schema import load_json

METRICS, PREPARATION = "metrics.json", "prepare.json"
RESULTS = ("fibrosis", "gaps", "comparison")
"""What was read off the map, NAME.json with NAME.png, in the order of the report."""
CAPTIONS = {
    "figure": "The atrium and its map.",
    "fibrosis": "Classes on the atrium and on the map.",
    "gaps": "Gaps on the map.",
    "comparison": "Both maps with one colour bar.",
    "difference": "Where they differ.",
}
PICTURES = {"fibrosis": ("fibrosis",), "gaps": ("gaps",), "comparison": ("comparison", "difference")}
"""Pictures of each result, NAME.png."""
MOST_ROWS = 40
"""Longer lists are left to the file that holds them."""


def write_run_report(
    folder: Path | str,
    path: Path | str | None = None,
    *,
    title: str = "Left atrium: standardised map",
    inputs: Iterable[Path | str] = (),
    day: date | None = None,
) -> Path:
    """Write the report of a folder that ``la-flatten run`` filled.

    Parameters
    ----------
    folder : with ``metrics.json``; and, where they were made, ``figure.png``, ``gaps.json``, ``gaps.png``,
        ``prepare.json``, ``fibrosis.json``, ``comparison.json`` and their pictures.
    path : default ``report.html`` in the folder.
    inputs : files that the run was given; their names are written.

    Returns
    -------
    The file that was written.

    Raises
    ------
    InputFileError : no ``metrics.json``, a damaged file, a place that cannot be written to.
    """
    target = Path(folder) / "report.html" if path is None else Path(path)
    write_report(target, title, run_sections(folder), inputs=inputs, day=day)
    return target


def run_sections(folder: Path | str) -> list[Section]:
    """What the files of a run say; errors as for `write_run_report`."""
    folder = Path(folder)
    if not (folder / METRICS).is_file():
        raise InputFileError(
            f'"{folder}" holds no {METRICS}. Expected the folder that la-flatten run (or flatten --metrics) wrote.'
        )
    found = {name: load_json(folder / f"{name}.json") for name in RESULTS if (folder / f"{name}.json").is_file()}
    summary = summary_section(found)
    sections = [summary] if summary is not None else []
    sections.append(map_section(load_json(folder / METRICS), _pictures(folder, "figure")))
    make = {"fibrosis": fibrosis_section, "gaps": gap_section, "comparison": comparison_section}
    sections += [make[name](content, _pictures(folder, *PICTURES[name])) for name, content in found.items()]
    if (folder / PREPARATION).is_file():
        sections.append(preparation_section(load_json(folder / PREPARATION), []))
    return sections


def map_section(metrics: Mapping[str, Any], pictures: list[Picture]) -> Section:
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


def gap_section(gaps: Mapping[str, Any], pictures: list[Picture]) -> Section:
    """Gaps in ablation lines, from the content of a gap file."""
    results = gaps["results"]
    shown = results[len(results) // 2]
    words = [
        f"Scar is {scar_words(gaps['array'], gaps['direction'], shown['threshold'])}. Round each vein, and round the "
        "veins of each side together, the closed path with the least length outside scar was looked for "
        f"({gaps['search']}). Its pieces outside scar are the gaps; the relative gap measure (RGM) is their share of "
        "the path: 0 is a complete ring, 1 is no scar at all. Without an ablation round the veins these figures say "
        "nothing.",
    ]
    if gaps.get("minimum_mm"):
        words.append(f"Gaps shorter than {gaps['minimum_mm']:g} mm are counted, not listed.")
    areas = shown["areas"]
    summary = Table(
        (
            "round",
            "gaps",
            f"of {WIDE_MM:g} mm or more",
            "gap length (mm)",
            "scar length (mm)",
            "RGM",
            "longest gap (mm)",
        ),
        [
            (
                name,
                "complete" if ring["complete"] else str(ring["gap_count"] + ring["small_gaps"]),
                ring.get("wide_gaps"),
                Fixed(ring["gap_length_mm"]),
                Fixed(ring["scar_length_mm"]),
                Fixed(ring["rgm"], 3),
                Fixed(max((gap["length_mm"] for gap in ring["gaps"]), default=None)),
            )
            for name, ring in areas.items()
        ]
        + [(name, "not measured", *(None,) * 5) for name in gaps.get("left_out", ())],
        f"Gaps at the threshold {shown['threshold']:.4g}",
    )
    listed = [
        (name, Fixed(gap["length_mm"]), _where(gap), round(gap["angle_degrees"]))
        for name, ring in areas.items()
        for gap in ring["gaps"]
    ]
    tables = [summary]
    if listed:
        columns = ("round", "length (mm)", "where", "angle on the map (degrees)")
        tables.append(Table(columns, listed[:MOST_ROWS], "Each gap"))
    if len(results) > 1:
        names = list(gaps["rgm_over_threshold"])
        rows = [
            (level, *(Fixed(gaps["rgm_over_threshold"][name][k], 3) for name in names))
            for k, level in enumerate(gaps["thresholds"])
        ]
        tables.append(Table((f"threshold of {gaps['array']}", *names), rows, "RGM over the threshold"))
    return Section("Gaps in ablation lines", words, tables, pictures, list(gaps.get("notes", [])))


def _where(gap: Mapping[str, Any]) -> str:
    middle = str(gap["segment"])
    return middle if middle == ALL_ROUND else extent_words(middle, gap.get("segments", ()))


def _percent(metrics: Mapping[str, Any], key: str) -> float | None:
    value = metrics.get(key)
    return None if value is None else round(100.0 * float(value), 3)


def _get(data: Mapping[str, Any], *keys: str) -> Any:
    value: Any = data
    for key in keys:
        value = value.get(key) if isinstance(value, Mapping) else None
    return value


def _pictures(folder: Path, *names: str) -> list[Picture]:
    """The pictures of these names that are in the folder."""
    return [Picture(folder / f"{name}.png", CAPTIONS[name]) for name in names if (folder / f"{name}.png").is_file()]
