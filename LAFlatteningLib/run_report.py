"""The cardiologist's report of a run: what each file of the folder says, in sections."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import date
from pathlib import Path
from typing import Any

from .errors import InputFileError
from .flattening.flat_map import USUAL_DILATATION
from .gaps.quantification import scar_words
from .report import Picture, Section, Table, write_report
from .schema import load_json

METRICS, GAPS = "metrics.json", "gaps.json"
OTHERS = {"prepare": "Preparation of the atrium", "fibrosis": "Fibrosis", "comparison": "Comparison"}
"""Results that are shown as they are, NAME.json with NAME.png where there is one: name -> title."""
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
    sections = [map_section(load_json(folder / METRICS), _pictures(folder, {"figure": "The atrium and its map."}))]
    if (folder / GAPS).is_file():
        sections.append(gap_section(load_json(folder / GAPS), _pictures(folder, {"gaps": "Gaps on the map."})))
    for name, heading in OTHERS.items():
        if (folder / f"{name}.json").is_file():
            pictures = _pictures(folder, {name: f"{heading}."})
            sections.append(plain_section(heading, load_json(folder / f"{name}.json"), pictures))
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
        f"Scar is {scar_words(gaps['array'], gaps.get('direction', 'above'), shown['threshold'])}. "
        "Round each vein, and round the veins of each side "
        "together, the closed path with the least length outside scar was looked for "
        f"({gaps['search']}). Its pieces outside scar are the gaps; the relative gap measure (RGM) is their share of "
        "the path: 0 is a complete ring, 1 is no scar at all.",
    ]
    if gaps.get("minimum_mm"):
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
        f"Gaps at the threshold {shown['threshold']:g}",
    )
    listed = [
        (name, round(gap["length_mm"], 1), gap["segment"], round(gap["angle_degrees"]))
        for name, ring in areas.items()
        for gap in ring["gaps"]
    ]
    tables = [summary]
    if listed:
        columns = ("round", "length (mm)", "segment", "angle on the map (degrees)")
        tables.append(Table(columns, listed[:MOST_ROWS], "Each gap"))
    if len(results) > 1:
        names = list(gaps["rgm_over_threshold"])
        rows = [
            (level, *(round(gaps["rgm_over_threshold"][name][k], 3) for name in names))
            for k, level in enumerate(gaps["thresholds"])
        ]
        tables.append(Table((f"threshold of {gaps['array']}", *names), rows, "RGM over the threshold"))
    return Section("Gaps in ablation lines", words, tables, pictures, list(gaps.get("notes", [])))


def plain_section(title: str, content: Mapping[str, Any], pictures: list[Picture]) -> Section:
    """A results file as it is: its notes as warnings, its single values as a table, its lists of records likewise.

    A record is an object of single values; an object of records becomes a table with a row for each.
    """
    notes = content.get("notes", [])
    warnings = [str(note) for note in notes] if isinstance(notes, list) else [str(notes)]
    single = [(_words(key), value) for key, value in content.items() if _is_single(value) and key != "notes"]
    tables = [Table(("", "value"), single)] if single else []
    for key, value in content.items():
        tables += _tables(_words(key), value) if key != "notes" else []
    return Section(title, (), tables, pictures, warnings)


def _tables(caption: str, value: Any) -> list[Table]:
    """The records within a value, as tables; deeper ones after those that hold them."""
    if isinstance(value, Mapping):
        records = {str(key): entry for key, entry in value.items() if isinstance(entry, Mapping)}
        alone = [(_words(key), entry) for key, entry in value.items() if _is_single(entry)]
        found = [Table(("", "value"), alone, caption.capitalize())] if alone else []
        if records:
            found += _record_table(caption, list(records), list(records.values()))
        for key, entry in value.items():
            inner = entry.items() if isinstance(entry, Mapping) else [("", entry)] if not _is_single(entry) else []
            for name, deeper in inner:
                if not _is_single(deeper):
                    found += _tables(" ".join(word for word in (caption, _words(key), _words(name)) if word), deeper)
        return found
    if isinstance(value, list) and value and all(isinstance(entry, Mapping) for entry in value):
        return _record_table(caption, [], value)
    return []


def _record_table(caption: str, names: list[str], records: list[Mapping[str, Any]]) -> list[Table]:
    columns = list(dict.fromkeys(key for record in records for key, entry in record.items() if _is_single(entry)))
    if not columns:
        return []
    rows = [tuple(record.get(key) for key in columns) for record in records][:MOST_ROWS]
    if names:
        rows = [(name, *row) for name, row in zip(names, rows, strict=False)]
    headings = tuple(_words(key) for key in columns)
    return [Table(("", *headings) if names else headings, rows, caption.capitalize())]


def _is_single(value: Any) -> bool:
    short = isinstance(value, list) and 0 < len(value) <= 6 and not any(isinstance(x, (list, dict)) for x in value)
    return value is None or isinstance(value, (str, int, float, bool)) or short


def _words(key: str) -> str:
    """A key of a file as words, its unit in brackets."""
    for unit in ("mm2", "cm2", "mm", "degrees", "percent", "mV", "ms"):
        if key.endswith(f"_{unit}"):
            return f"{key[: -len(unit) - 1].replace('_', ' ')} ({'%' if unit == 'percent' else unit})"
    return key.replace("_", " ")


def _percent(metrics: Mapping[str, Any], key: str) -> float | None:
    value = metrics.get(key)
    return None if value is None else round(100.0 * float(value), 3)


def _get(data: Mapping[str, Any], *keys: str) -> Any:
    value: Any = data
    for key in keys:
        value = value.get(key) if isinstance(value, Mapping) else None
    return value


def _pictures(folder: Path, captions: Mapping[str, str]) -> list[Picture]:
    """The pictures of these names that are in the folder."""
    return [
        Picture(folder / f"{name}.png", caption)
        for name, caption in captions.items()
        if (folder / f"{name}.png").is_file()
    ]
