"""CARTO 3 maps (.mesh), read."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..axes import lps_from_carto
from ..errors import SurfaceError
from ..quantities import measured
from ..surface import Array, FloatArray, Surface
from .access import unreadable

INACTIVE = -1000000
"""Group of points and triangles that CARTO keeps, but that are no part of the surface."""


def read_carto(path: Path) -> Surface:
    """Read the surface and the values of a CARTO 3 map.

    Triangles of visible groups are read; what was cut away or made transparent is left out. Values that were not
    measured are NaN, and quantities that were measured nowhere are left out. Coordinates are turned to LPS.

    Raises
    ------
    InputFileError : not a CARTO map, cut off, damaged.
    SurfaceError : no visible triangles, or triangles of points that do not exist.
    """
    text = path.read_bytes().decode("latin-1")
    if not text.lstrip().startswith("#TriangulatedMeshVersion"):
        raise unreadable(path, 'it is not a CARTO 3 map (it does not begin with "#TriangulatedMeshVersion2.0")')
    # The text between two headings.
    parts = re.split(r"^\[(\w+)\][^\n]*\n?", text, flags=re.MULTILINE)
    sections = dict(zip(parts[1::2], parts[2::2], strict=True))
    about = dict(re.findall(r"^[^\S\n]*(\w+)[^\S\n]*=[^\S\n]*([^\r\n]*)", sections.get("GeneralAttributes", ""), re.M))
    vertices = _table(path, sections, "VerticesSection", _count(path, about, "NumVertex"), 7)
    faces = _table(path, sections, "TrianglesSection", _count(path, about, "NumTriangle"), 7)
    triangles = faces[:, :3].astype(np.int64)
    if (triangles != faces[:, :3]).any():
        raise unreadable(path, "[TrianglesSection] has point numbers that are no whole numbers")
    surface = Surface(lps_from_carto(vertices[:, :3]), triangles, _values(path, sections, about, len(vertices)))
    active = vertices[:, 6] != INACTIVE
    shown = _visible(faces[:, 6], about) & active[triangles].all(axis=1)
    if not shown.any():
        raise SurfaceError(
            f"None of its {len(faces)} triangles is visible. Show the surface in CARTO and export it again."
        )
    return surface.submesh(shown)[0]


def _count(path: Path, about: dict[str, str], key: str) -> int:
    if not re.fullmatch(r"\d{1,9}", about.get(key, "").strip()):
        raise unreadable(path, f'it is cut off or damaged ({key} is "{about.get(key, "")}", expected a number)')
    return int(about[key])


def _table(path: Path, sections: dict[str, str], name: str, rows: int, least: int) -> NDArray[np.float64]:
    """The numbers of a section, (rows, columns); its lines read ``number = value value ...``."""
    if name not in sections:
        raise unreadable(path, f"it is cut off (it has no section [{name}])")
    lines = [line.partition("=") for line in sections[name].splitlines() if line.strip() and line.lstrip()[0] != ";"]
    if len(lines) < rows:
        raise unreadable(path, f"it is cut off in [{name}] ({len(lines)} lines of {rows})")
    try:
        number = np.array([int(before) for before, _, _ in lines])
        table = np.array([after.split() for _, _, after in lines], dtype=np.float64)
    except (ValueError, OverflowError) as error:
        raise unreadable(path, f"[{name}] is not a table of numbers ({error})") from error
    if len(lines) != rows or (number != np.arange(rows)).any():
        raise unreadable(path, f"the lines of [{name}] are not numbered 0 to {rows - 1}")
    if rows == 0 or table.ndim != 2 or table.shape[1] < least:
        raise unreadable(path, f"[{name}] has {table.shape[-1] if rows else 0} columns, expected {least}")
    return table


def _visible(group: FloatArray, about: dict[str, str]) -> NDArray[np.bool_]:
    """Which triangles are in a visible group; groups below 0 are not, where the file does not list them."""
    listed = [int(word) for word in about.get("VisibleGroupsIDs", "").split() if re.fullmatch(r"-?\d{1,9}", word)]
    shown = np.isin(group, listed)
    return shown if shown.any() else group >= 0


def _values(path: Path, sections: dict[str, str], about: dict[str, str], rows: int) -> dict[str, Array]:
    arrays: dict[str, Array] = {}
    names = about.get("ColorsNames", "").split()
    if "VerticesColorsSection" in sections and sections["VerticesColorsSection"].strip():
        table = measured(_table(path, sections, "VerticesColorsSection", rows, max(len(names), 1)))
        # Some versions of CARTO write columns that they do not name.
        names += [f"unnamed_{k + 1}" for k in range(table.shape[1] - len(names))]
        # No column hides another of its name.
        names = [name if names.index(name) == k else f"{name}_{k + 1}" for k, name in enumerate(names)]
        arrays = {n: v for n, v in zip(names, table.T.copy(), strict=True) if np.isfinite(v).any()}
    if "VerticesAttributesSection" in sections:
        # The first line names the columns: scar, and what was marked as an ablation (EML).
        marks = re.search(r"^\s*;([\w \t]+)", sections["VerticesAttributesSection"])
        table = _table(path, sections, "VerticesAttributesSection", rows, 1)
        for name, column in zip(marks[1].split() if marks else [], table.T, strict=False):
            if column.any() and np.isin(column, (0, 1)).all():
                arrays.setdefault(name, column.astype(np.uint8))
    return arrays
