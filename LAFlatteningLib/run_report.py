"""The cardiologist's report of a run: the findings, then what each file of the folder says (`report_sections`)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import date
from pathlib import Path

from .errors import InputFileError
from .report import Picture, Section, write_report
from .report_sections import (
    comparison_section,
    fibrosis_section,
    gap_section,
    map_section,
    preparation_section,
    summary_section,
)
from .schema import load_json

METRICS = "metrics.json"


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
    fibrosis, gaps, comparison, preparation = (
        load_json(folder / f"{name}.json") if (folder / f"{name}.json").is_file() else None
        for name in ("fibrosis", "gaps", "comparison", "prepare")
    )
    try:
        summary = summary_section(fibrosis, gaps, comparison)
        sections = [summary] if summary else []
        captions = {"figure": "The atrium and its map."}
        sections.append(map_section(load_json(folder / METRICS), _pictures(folder, captions)))
        if fibrosis is not None:
            captions = {"fibrosis": "Classes on the atrium and on the map."}
            sections.append(fibrosis_section(fibrosis, _pictures(folder, captions)))
        if gaps is not None:
            sections.append(gap_section(gaps, _pictures(folder, {"gaps": "Gaps on the map."})))
        if comparison is not None:
            captions = {"comparison": "Both maps.", "difference": "Where they differ."}
            sections.append(comparison_section(comparison, _pictures(folder, captions)))
        if preparation is not None:
            captions = {"prepare": "What was cut."}
            sections.append(preparation_section(preparation, _pictures(folder, captions)))
    except (KeyError, TypeError, IndexError, AttributeError) as error:
        raise InputFileError(
            f'The results in "{folder}" cannot be read: something of them is missing ({error!r}). They may be of '
            "another version; run la-flatten again."
        ) from error
    return sections


def _pictures(folder: Path, captions: Mapping[str, str]) -> list[Picture]:
    """The pictures of these names that are in the folder."""
    return [
        Picture(folder / f"{name}.png", caption)
        for name, caption in captions.items()
        if (folder / f"{name}.png").is_file()
    ]
