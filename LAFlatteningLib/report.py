"""A report for people: one HTML file that needs nothing else, to read, print and send.

A `Section` holds words, tables and pictures; `write_report` makes one page of several. Pictures are within the file,
all text is escaped, and a content security policy keeps the browser from loading anything. What each step of a run
has to say is put into sections by `LAFlatteningLib.run_report`.
"""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from ._version import __version__
from .errors import InputFileError
from .files.access import write_text
from .quantities import readable

DISCLAIMER = "Not a medical device. For research."
_KINDS = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg", ".svg": "image/svg+xml"}
_NONE = "–"
SHORT_ROWS = 16
"""Longer tables may go over several pages."""

_STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.45 system-ui, "Segoe UI", "Helvetica Neue", Arial, sans-serif; color: #1a1a1a; background: #fff;
       max-width: 62rem; margin: 1.5rem auto; padding: 0 1.25rem; }
h1 { font-size: 1.6rem; margin: 0 0 .2rem; }
h2 { font-size: 1.2rem; margin: 2.2rem 0 .6rem; border-bottom: 1px solid #c9c9c9; padding-bottom: .2rem; }
p { margin: .5rem 0; max-width: 48rem; }
.about { color: #4d4d4d; font-size: .9rem; }
.disclaimer { display: inline-block; margin: .6rem 0; padding: .25rem .7rem; border: 2px solid #1a1a1a;
              font-weight: 600; }
.warnings { background: #fff4d6; border-left: 6px solid #d18b00; margin: 1rem 0; padding: .6rem 1rem; }
.warnings h2 { margin: 0 0 .3rem; border: 0; font-size: 1.05rem; }
.warnings ul { margin: 0; padding-left: 1.2rem; }
.fine { background: #e8f4ec; border-left: 6px solid #2f7d4f; margin: 1rem 0; padding: .6rem 1rem; }
.inputs { font-weight: 600; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; margin: .8rem 0; font-variant-numeric: tabular-nums; }
caption { text-align: left; font-weight: 600; padding-bottom: .3rem; }
th, td { border-bottom: 1px solid #dcdcdc; padding: .25rem .8rem .25rem 0; text-align: left; vertical-align: top; }
th { border-bottom: 2px solid #8a8a8a; font-weight: 600; }
td.number, th.number { text-align: right; padding-right: 1.2rem; }
figure { margin: 1rem 0; }
img { max-width: 100%; height: auto; border: 1px solid #dcdcdc; }
figcaption { color: #4d4d4d; font-size: .9rem; }
@page { size: A4; margin: 14mm; }
@media print {
  body { font-size: 10.5pt; margin: 0; max-width: none; padding: 0; }
  h2 { break-after: avoid; }
  figure, tr, .short, .warnings { break-inside: avoid; }
  thead, caption, tbody tr:first-child { break-after: avoid; }
  .warnings, .fine { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
}
"""


@dataclass(frozen=True)
class Fixed:
    """A number with as many decimals as the others of its column; None is written as a dash."""

    value: float | None
    decimals: int = 1

    def __str__(self) -> str:
        if self.value is None or math.isnan(self.value):
            return _NONE
        # Never "-0.0".
        return f"{round(self.value, self.decimals) + 0.0:.{self.decimals}f}"


@dataclass(frozen=True)
class Table:
    """Rows of values under headings.

    Attributes
    ----------
    columns : headings, with units ("length (mm)").
    rows : as long as `columns`. Numbers are written with four digits, or as they are `Fixed`; None and NaN as a dash;
        True as yes.
    caption : what the table is of.
    """

    columns: Sequence[str]
    rows: Sequence[Sequence[Any]]
    caption: str = ""


@dataclass(frozen=True)
class Picture:
    """A picture file (.png, .jpg, .svg), and what it shows in words, for those who cannot see it as well."""

    path: Path | str
    caption: str


@dataclass(frozen=True)
class Section:
    """A part of a report.

    Attributes
    ----------
    warnings : what to know before trusting the section; shown at the top of the report.
    """

    title: str
    paragraphs: Sequence[str] = ()
    tables: Sequence[Table] = ()
    pictures: Sequence[Picture] = ()
    warnings: Sequence[str] = ()


def write_report(
    path: Path | str,
    title: str,
    sections: Sequence[Section],
    *,
    inputs: Iterable[Path | str] = (),
    day: date | None = None,
) -> None:
    """Write a report, as a whole or not at all.

    Parameters
    ----------
    path : .html.
    title : of the page.
    inputs : files that the results come from; only their names are written, never their folders.
    day : of the report; today by default.

    Raises
    ------
    InputFileError : another extension, a picture that is missing or of another kind, the file cannot be written.

    Examples
    --------
    >>> section = Section("Gaps", ["None was found."], [Table(["vein", "gap (mm)"], [["right superior", 0.0]])])
    >>> "right superior" in make_html("Patient 7", [section])
    True
    """
    if Path(path).suffix.lower() not in (".html", ".htm"):
        raise InputFileError(f'"{path}": expected a report file ending in .html. Change the ending.')
    write_text(path, make_html(title, sections, inputs=inputs, day=day))


def make_html(
    title: str, sections: Sequence[Section], *, inputs: Iterable[Path | str] = (), day: date | None = None
) -> str:
    """The report as text; parameters and errors as for `write_report`."""
    names = ", ".join(_file_name(name) for name in inputs)
    about = f"LAFlattening {__version__}, {(day or date.today()).isoformat()}"
    warnings = [f"{section.title}: {warning}" for section in sections for warning in section.warnings]
    parts = [
        "<!DOCTYPE html>",
        '<html lang="en"><head><meta charset="utf-8">',
        '<meta http-equiv="Content-Security-Policy" '
        "content=\"default-src 'none'; img-src data:; style-src 'unsafe-inline'\">",
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{html.escape(title)}</title><style>{_STYLE}</style></head><body>",
        f"<h1>{html.escape(title)}</h1>",
        *([f'<p class="inputs">Input: {html.escape(names)}</p>'] if names else []),
        f'<p class="about">{html.escape(about)}</p>',
        f'<p class="disclaimer">{DISCLAIMER}</p>',
    ]
    if warnings:
        items = "".join(f"<li>{html.escape(warning)}</li>" for warning in warnings)
        parts.append(f'<div class="warnings" role="note"><h2>Before trusting this</h2><ul>{items}</ul></div>')
    else:
        parts.append('<p class="fine">No step gave a warning.</p>')
    parts += [_section(section) for section in sections]
    return "\n".join([*parts, "</body></html>", ""])


def _section(section: Section) -> str:
    parts = [f"<section><h2>{html.escape(section.title)}</h2>"]
    parts += [f"<p>{html.escape(paragraph)}</p>" for paragraph in section.paragraphs]
    parts += [_table(table) for table in section.tables]
    parts += [_picture(picture) for picture in section.pictures]
    return "\n".join([*parts, "</section>"])


def _table(table: Table) -> str:
    numeric = [
        any(_is_number(row[k]) for row in table.rows)
        and all(_is_number(row[k]) or row[k] is None for row in table.rows)
        for k in range(len(table.columns))
    ]
    marks = [' class="number"' if number else "" for number in numeric]
    head = "".join(
        f'<th scope="col"{mark}>{html.escape(column)}</th>' for column, mark in zip(table.columns, marks, strict=True)
    )
    rows = "".join(
        "<tr>"
        + "".join(f"<td{mark}>{html.escape(_value(value))}</td>" for value, mark in zip(row, marks, strict=True))
        + "</tr>\n"
        for row in table.rows
    )
    caption = f"<caption>{html.escape(table.caption)}</caption>" if table.caption else ""
    # A short table stays on one page when it is printed.
    kind = "wide short" if len(table.rows) <= SHORT_ROWS else "wide"
    return f'<div class="{kind}"><table>{caption}<thead><tr>{head}</tr></thead><tbody>\n{rows}</tbody></table></div>'


def _picture(picture: Picture) -> str:
    path = Path(picture.path)
    kind = _KINDS.get(path.suffix.lower())
    if kind is None:
        raise InputFileError(f'"{path.name}": expected a picture ({", ".join(_KINDS)}) for the report.')
    try:
        data = base64.b64encode(path.read_bytes()).decode("ascii")
    except OSError as error:
        raise InputFileError(
            f'The picture "{path}" cannot be read: {error.strerror or error}. Make it again.'
        ) from error
    caption = html.escape(picture.caption)
    return f'<figure><img src="data:{kind};base64,{data}" alt="{caption}"><figcaption>{caption}</figcaption></figure>'


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float, Fixed)) and not isinstance(value, bool)


def _value(value: Any) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return _NONE
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return readable(value) if abs(value) >= 1e-3 or value == 0.0 else f"{value:.3g}"
    if isinstance(value, (list, tuple)):
        return ", ".join(_value(entry) for entry in value)
    return str(value)


def _file_name(path: Path | str) -> str:
    """The name of a file without its folder, of whichever system."""
    return PureWindowsPath(PurePosixPath(str(path)).name).name
