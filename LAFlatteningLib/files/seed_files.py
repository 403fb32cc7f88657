"""Seeds, from and to files: .csv, Slicer markups .mrk.json, and the older .fcsv (read only)."""

from __future__ import annotations

import csv
import io
import json
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import SeedError
from ..schema import load_json
from ..surface import FloatArray
from .access import MM, NUMBER, PathLike, input_suffix, known_suffix, unreadable, write_text

_MARKUPS = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/"
    "markups-schema-v1.0.3.json#"
)


def read_seeds(path: PathLike, space: str = "LPS") -> dict[str, FloatArray]:
    """Read labelled points: .csv, Slicer markups .mrk.json (or .json), or the older .fcsv.

    Parameters
    ----------
    space : "LPS" or "RAS", the axes wanted; `Surface.space` of the surface that the seeds belong to. Points of
        markups are turned into it from the axes that their file declares. A CSV file (``label,x_mm,y_mm,z_mm``)
        declares none: its points are in the axes of the surface, and are returned as they are.

    Returns
    -------
    label -> (3,) mm, in the order of the file. Labels are stripped of spaces around them, and otherwise unchanged.
    Points that were not placed (position status undefined, preview, missing) are left out.

    Raises
    ------
    InputFileError : missing or damaged file, unknown kind of file, axes or unit.
    SeedError : a label twice or empty, a coordinate that is missing or not a number, no points at all. The message
        names line and label.

    Source: vtkMRMLMarkupsJsonStorageNode and vtkMRMLMarkupsFiducialStorageNode of 3D Slicer.
    """
    path = Path(path)
    _check_space(space)
    suffix = input_suffix(path, _SEED_SUFFIXES, "seeds")
    if suffix == ".csv":
        return _seeds_from_csv(path)
    points, found = _seeds_from_fcsv(path) if suffix == ".fcsv" else _seeds_from_markups(path)
    return {label: _turned(point, found, space) for label, point in points.items()}


def write_seeds(seeds: Mapping[str, FloatArray], path: PathLike, space: str = "LPS") -> None:
    """Write labelled points as .csv, or as .mrk.json (.json), which 3D Slicer loads as a point list.

    Parameters
    ----------
    seeds : label -> (3,) mm.
    space : "LPS" or "RAS", the axes that the points are in. A .csv file does not store them.

    Raises
    ------
    SeedError : a point that is not three finite numbers, an empty label.
    InputFileError : unknown extension, or the file cannot be written; an older file of that name is then unchanged.
    """
    path = Path(path)
    _check_space(space)
    suffix = known_suffix(path, (".csv", ".mrk.json", ".json"), "seeds")
    checked = _Seeds(path)
    for number, (label, point) in enumerate(seeds.items(), 1):
        checked.add(label, np.ravel(point).tolist(), f"point {number}")
    write_text(path, (_csv_text if suffix == ".csv" else _markups_text)(checked.points, space))


_SEED_SUFFIXES = (".csv", ".mrk.json", ".json", ".fcsv")


class _Seeds:
    """Gathers the points of a file, and checks each."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.points: dict[str, FloatArray] = {}
        self.places: dict[str, str] = {}

    def error(self, place: str, label: str, message: str) -> SeedError:
        """An error that names file, place and label."""
        seed = f', seed "{label}"' if label else ""
        return SeedError(f'"{self.path}", {place}{seed}: {message}', (label,) if label else ())

    def add(self, label: str, point: list[Any], place: str, scale: float = 1.0) -> None:
        """Add a point of three numbers."""
        label = label.strip()
        if not label:
            raise self.error(place, "", "the label is empty. Expected the name of a seed.")
        if len(point) != 3 or not all(_is_finite(value) for value in point):
            raise self.error(place, label, f"expected three finite coordinates, found {str(point)[:80]}.")
        if label in self.points:
            raise self.error(place, label, f"the label is also that of {self.places[label]}. Keep one of them.")
        self.points[label] = scale * np.array(point, np.float64)
        self.places[label] = place

    def some(self) -> dict[str, FloatArray]:
        """The points; an error if there are none."""
        if not self.points:
            raise SeedError(f'"{self.path}" holds no placed points. Expected labelled seeds.')
        return self.points


def _is_finite(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def _turned(point: FloatArray, found: str, wanted: str) -> FloatArray:
    return point if found == wanted else point * [-1.0, -1.0, 1.0]


def _check_space(space: str) -> None:
    if space not in ("LPS", "RAS"):
        raise ValueError(f'Expected space "LPS" or "RAS", found "{space}".')


def _text_of(path: Path) -> str:
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise unreadable(path, "it is not text in UTF-8 (in a spreadsheet: save as CSV UTF-8)") from error
    if "\0" in text:
        raise unreadable(path, "it is not a text file")
    return text


def _rows(path: Path, lines: list[str], separator: str) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of each line of a CSV file that holds anything."""
    reader = csv.reader(lines, delimiter=separator, skipinitialspace=True, strict=True)
    try:
        for cells in reader:
            cells = [cell.strip() for cell in cells]
            if any(cells) and not cells[0].startswith("#"):
                yield reader.line_num, cells
    except csv.Error as error:
        raise unreadable(path, f"line {reader.line_num} is not CSV ({error})") from error


def _coordinate(text: str, name: str, seeds: _Seeds, place: str, label: str) -> float:
    if not text:
        raise seeds.error(place, label, f"{name} is missing. Expected a number (mm).")
    if not NUMBER.fullmatch(text):
        raise seeds.error(place, label, f'{name} is "{text}". Expected a number (mm), such as -12.5.')
    return float(text)


def _seeds_from_csv(path: Path) -> dict[str, FloatArray]:
    lines = _text_of(path).splitlines()
    # Spreadsheets separate by semicolons where the comma is the decimal sign, or by tabs.
    separator = next((sign for sign in ";\t" if any(sign in line for line in lines)), ",")
    rows = _rows(path, lines, separator)
    first, names = next(rows, (1, []))
    names = [name.lower().removesuffix("_mm") for name in names]
    if any(names.count(name) != 1 for name in ("label", "x", "y", "z")):
        raise SeedError(
            f'"{path}", line {first}: expected the column names label,x_mm,y_mm,z_mm, '
            f'found "{lines[first - 1].strip() if lines else ""}". Add them as the first line, separated by commas.'
        )
    at = {name: names.index(name) for name in ("label", "x", "y", "z")}
    seeds = _Seeds(path)
    for line, cells in rows:
        label = cells[at["label"]] if at["label"] < len(cells) else ""
        if any(cells[len(names) :]):
            hint = " Write decimal points, or separate by semicolons." if separator == "," else ""
            raise seeds.error(f"line {line}", label, f"{len(cells)} values, expected {len(names)}.{hint}")
        point = []
        for axis in "xyz":
            text = cells[at[axis]] if at[axis] < len(cells) else ""
            text = text.replace(",", ".") if separator != "," else text
            point.append(_coordinate(text, f"{axis}_mm", seeds, f"line {line}", label))
        seeds.add(label, point, f"line {line}")
    return seeds.some()


def _seeds_from_fcsv(path: Path) -> tuple[dict[str, FloatArray], str]:
    lines = _text_of(path).splitlines()
    notes = dict(re.findall(r"^#\s*(.*?)\s*=\s*(.*?)\s*$", "\n".join(lines), re.MULTILINE))
    seeds = _Seeds(path)
    versioned = "Markups fiducial file version" in notes
    # Slicer 3 wrote label,x,y,z,sel,vis, in RAS, and no version.
    space = _axes(path, notes.get("CoordinateSystem", "LPS")) if versioned else "RAS"
    for line, cells in _rows(path, lines, ","):
        label_at = 11 if versioned else 0
        label = cells[label_at] if label_at < len(cells) else ""
        if cells[14:15] in (["0"], ["1"], ["3"]):
            continue  # position undefined, preview, missing; 2 is defined
        values = [*cells[1:4], "", "", ""][:3]
        point = [
            _coordinate(text, axis, seeds, f"line {line}", label) for axis, text in zip("xyz", values, strict=True)
        ]
        seeds.add(label, point, f"line {line}")
    return seeds.some(), space


def _seeds_from_markups(path: Path) -> tuple[dict[str, FloatArray], str]:
    # Slicer writes NaN, which JSON does not know, where a point list has orientations or measurements undefined.
    document = load_json(path, allow_nan=True)
    lists = document.get("markups") if isinstance(document, dict) else None
    if not isinstance(lists, list) or not all(isinstance(markup, dict) for markup in lists):
        raise unreadable(path, 'it is JSON, but not Slicer markups (it has no list "markups")')
    schema = document.get("@schema", _MARKUPS)
    if not re.search(r"markups-schema-v1\.\d+\.\d+\.json#*$", str(schema).lower()):
        raise unreadable(path, f'its "@schema" is "{schema}", expected markups-schema-v1 of 3D Slicer')
    lists = [markup for markup in lists if markup.get("controlPoints")]
    lists = [markup for markup in lists if markup.get("type") == "Fiducial"] or lists
    if len(lists) != 1:
        names = ", ".join(f'"{markup.get("name", markup.get("type"))}"' for markup in lists)
        raise SeedError(f'"{path}" holds {len(lists)} lists of points ({names or "none"}). Expected one, of the seeds.')
    space = _axes(path, lists[0].get("coordinateSystem", "LPS"))
    unit = lists[0].get("coordinateUnits", "mm")
    unit = unit[0] if isinstance(unit, list) and unit else unit
    if not isinstance(unit, str) or unit not in MM:
        raise unreadable(path, f'its "coordinateUnits" is {json.dumps(unit)}, expected one of {", ".join(MM)}')
    seeds = _Seeds(path)
    points = lists[0]["controlPoints"]
    if not isinstance(points, list) or not all(isinstance(point, dict) for point in points):
        raise unreadable(path, 'its "controlPoints" is not a list of points')
    for number, point in enumerate(points, 1):
        label, place = str(point.get("label", "")), f"point {number}"
        status = point.get("positionStatus", "defined")
        if status in ("undefined", "preview", "missing"):
            continue
        if status != "defined":
            raise seeds.error(place, label, f'unknown positionStatus {json.dumps(status)}. Expected "defined".')
        position = point.get("position")
        seeds.add(label, position if isinstance(position, list) else [], place, MM[unit])
    return seeds.some(), space


def _axes(path: Path, name: Any) -> str:
    # Old files number them.
    space = {"0": "RAS", "1": "LPS"}.get(str(name), name)
    if space not in ("LPS", "RAS"):
        raise unreadable(path, f"its coordinate system is {json.dumps(name)}, expected LPS or RAS")
    return str(space)


def _csv_text(seeds: Mapping[str, FloatArray], _space: str) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["label", "x_mm", "y_mm", "z_mm"])
    writer.writerows([label, *map(repr, point.tolist())] for label, point in seeds.items())
    return text.getvalue()


def _markups_text(seeds: Mapping[str, FloatArray], space: str) -> str:
    state = {"selected": True, "locked": False, "visibility": True, "positionStatus": "defined"}
    points = [
        {"id": str(number), "label": label, "position": point.tolist(), **state}
        for number, (label, point) in enumerate(seeds.items(), 1)
    ]
    markup = {
        "type": "Fiducial",
        "coordinateSystem": space,
        "coordinateUnits": "mm",
        "controlPoints": points,
        "display": {"visibility": True, "pointLabelsVisibility": True},
    }
    return json.dumps({"@schema": _MARKUPS, "markups": [markup]}, indent=2, ensure_ascii=False) + "\n"
