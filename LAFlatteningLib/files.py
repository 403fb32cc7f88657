"""Surfaces and seeds, from and to files.

Surfaces: .vtp, .vtk (legacy), .stl, .ply, .obj. Seeds: .csv, Slicer markups .mrk.json, and the older .fcsv (read only).
Patient axes (LPS, RAS) in files are handled here and nowhere else. A damaged file is refused with a reason, nothing
that a file holds is executed, and no file is left half-written.
"""

from __future__ import annotations

import csv
import io
import json
import os
import re
import secrets
import shutil
import sys
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonCore import VTK_STRING, vtkEventForwarderCommand, vtkStringArray
from vtkmodules.vtkCommonDataModel import vtkPolyData
from vtkmodules.vtkCommonExecutionModel import vtkAlgorithm
from vtkmodules.vtkIOGeometry import vtkSTLReader, vtkSTLWriter
from vtkmodules.vtkIOLegacy import vtkPolyDataWriter
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLPolyDataWriter

from .errors import InputFileError, LAFlatteningError, SeedError, SurfaceError
from .schema import load_json
from .surface import FloatArray, Surface

PathLike = str | os.PathLike[str]

_HEADER = "LAFlattening output. SPACE="
_MARKUPS = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/"
    "markups-schema-v1.0.3.json#"
)
_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "µm": 1e-3}
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)
_PLY_TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"} | {
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8", "int8": "i1", "uint8": "u1"},
    **{"int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
}
_COLOURS = ("red", "green", "blue", "alpha")


# ---- surfaces -----------------------------------------------------------------------------------------------


def read_surface(path: PathLike) -> Surface:
    """Read a triangle surface with its arrays: .vtp, .vtk (legacy), .stl, .ply or .obj, in upper or lower case.

    Points are in mm. `Surface.space` is what the file declares, as 3D Slicer declares it ("SPACE=RAS" in the header
    or comment, a string array "SPACE" in .vtp), and "LPS" where it declares nothing. Points of an .stl file with
    exactly the same coordinates are made one; points of all other files stay as they are, in their order.

    Raises
    ------
    InputFileError : missing, empty, damaged or cut off, of an unknown kind, or not a surface.
    SurfaceError : read, but not a triangle mesh (no triangles, quadrilaterals, coordinates that are not numbers).

    Source: vtkMRMLModelStorageNode of 3D Slicer (GetCoordinateSystemFromFileHeader, GetCoordinateSystemFromFieldData,
    GetCoordinateUnitScaleFromFileHeader), whose rules these are.
    """
    path = Path(path)
    read = _READERS[_input_suffix(path, _READERS, "a surface")]
    try:
        # Of NaN among the points, Surface says more than a warning of numpy.
        with np.errstate(invalid="ignore"):
            return read(path)
    except SurfaceError as error:
        raise SurfaceError(f'"{path}": {error}') from error
    except OSError as error:
        raise _unreadable(path, error.strerror or str(error)) from error


def write_surface(surface: Surface, path: PathLike) -> None:
    """Write a surface; the extension chooses the format: .vtp (best), .vtk (legacy), .stl, .ply or .obj.

    All formats carry the axes in the way that 3D Slicer reads them. .vtp and .vtk keep every array, .ply the numeric
    point arrays (vectors as NAME_0, NAME_1, ...), .stl and .obj none; .stl rounds coordinates to 7 digits.

    Raises
    ------
    InputFileError : unknown extension, or the file cannot be written; an older file of that name is then unchanged.
    """
    path = Path(path)
    write = _WRITERS[_known_suffix(path, _WRITERS, "a surface")]
    with atomic_write(path) as temporary:
        write(surface, temporary)


class _Messages(list[str]):
    """Collects what VTK would print: an observer of one object, so safe where several threads read files."""

    CallDataType = VTK_STRING

    def __call__(self, _caller: object, _event: str, text: str | bytes) -> None:
        """Keep a message, without the part that names VTK's source file."""
        self.append(re.sub(r"^.*?\(\w+\): ", "", _text(text), flags=re.DOTALL).strip().rstrip("."))


def _text(text: str | bytes) -> str:
    # VTK returns what is not UTF-8 as bytes.
    return text if isinstance(text, str) else text.decode("latin-1")


def _observed(algorithm: vtkAlgorithm) -> _Messages:
    messages = _Messages()
    algorithm.AddObserver("ErrorEvent", messages)
    # Left aside: warnings, and the pipeline, which repeats each error at length.
    algorithm.AddObserver("WarningEvent", _Messages())
    algorithm.GetExecutive().AddObserver("ErrorEvent", _Messages())
    return messages


def _run_reader(reader: vtkAlgorithm, path: Path) -> vtkPolyData:
    messages = _observed(reader)
    reader.SetFileName(str(path))
    reader.Update()
    if messages:
        raise _unreadable(path, messages[0])
    return reader.GetOutput()


def _run_writer(writer: vtkAlgorithm, surface: Surface, path: Path) -> None:
    messages = _observed(writer)
    polydata = surface.to_polydata()
    polydata.GetFieldData().RemoveArray("SPACE")
    if isinstance(writer, vtkXMLPolyDataWriter):
        tag = vtkStringArray()
        tag.SetName("SPACE")
        tag.InsertNextValue(surface.space)
        polydata.GetFieldData().AddArray(tag)
    else:
        writer.SetHeader(_HEADER + surface.space)
        writer.SetFileTypeToBinary()
    writer.SetInputData(polydata)
    writer.SetFileName(str(path))
    if not writer.Write() or messages:
        raise OSError(messages[0] if messages else "the disk may be full")


def _space(notes: str) -> str:
    """The axes that a header declares: Slicer looks for exactly these letters, RAS first; LPS if it has neither."""
    return "RAS" if "SPACE=RAS" in notes else "LPS"


def _read_vtp(path: Path) -> Surface:
    with path.open("rb") as file:
        head = file.read(1 << 16)
    kind = re.search(rb"<VTKFile[^>]*\stype\s*=\s*[\"'](\w+)", head)
    if not kind:
        raise _unreadable(path, "it is not a VTK XML file (it has no VTKFile element)")
    if kind[1] != b"PolyData":
        raise _unreadable(path, f"it holds {kind[1].decode()}, expected PolyData")
    # VTK ends the whole program if it cannot get the memory that a damaged count asks for.
    most = 1000 * path.stat().st_size
    for name, count in re.findall(rb"\s(NumberOf\w+)\s*=\s*[\"']([^\"']*)", head):
        if not count.strip().isdigit() or len(count) > 18 or int(count) > most:
            raise _unreadable(path, f"{name.decode()} is {count.decode('latin-1')}, which is impossible")
    reader = vtkXMLPolyDataReader()
    forward = vtkEventForwarderCommand()
    forward.SetTarget(reader)
    reader.SetParserErrorObserver(forward)
    polydata = _run_reader(reader, path)
    tag = polydata.GetFieldData().GetAbstractArray("SPACE")
    declared = _text(tag.GetValue(0)) if isinstance(tag, vtkStringArray) and tag.GetNumberOfValues() else ""
    if isinstance(tag, vtkStringArray):
        polydata.GetFieldData().RemoveArray("SPACE")
    return Surface.from_polydata(polydata, "RAS" if "RAS" in declared else "LPS")


def _read_stl(path: Path) -> Surface:
    size = path.stat().st_size
    with path.open("rb") as file:
        start = file.read(84)
        file.seek(max(size - 1024, 0))
        end = file.read()
    count = int.from_bytes(start[80:84], "little")
    # VTK takes a file that lost its last triangles for a whole one. (Some programs write -1 for the count.)
    if start.lstrip().lower().startswith(b"solid") and size != 84 + 50 * count:
        if b"endsolid" not in end.lower():
            raise _unreadable(path, 'it is cut off (its end, "endsolid", is missing)')
    elif size < 84 + 50 * count and count != 0xFFFFFFFF:
        raise _unreadable(path, f"it is cut off, or not an STL file (room for {max(size - 84, 0) // 50} triangles)")
    reader = vtkSTLReader()
    # An STL file is a heap of loose triangles; only equal coordinates tell that they meet.
    reader.MergingOn()
    polydata = _run_reader(reader, path)
    return Surface.from_polydata(polydata, _space(_text(reader.GetHeader() or "")))


def _write_vtp(surface: Surface, path: Path) -> None:
    _run_writer(vtkXMLPolyDataWriter(), surface, path)
    # VTK 9.6 says nothing when the disk is full.
    with path.open("rb") as file:
        file.seek(-min(64, path.stat().st_size), os.SEEK_END)
        if not file.read().rstrip().endswith(b"</VTKFile>"):
            raise OSError("the disk may be full")


def _write_vtk(surface: Surface, path: Path) -> None:
    writer = vtkPolyDataWriter()
    # As Slicer does: version 5 is unknown to much other software.
    writer.SetFileVersion(42)
    _run_writer(writer, surface, path)


def _write_stl(surface: Surface, path: Path) -> None:
    _run_writer(vtkSTLWriter(), surface, path)


# ---- legacy VTK ---------------------------------------------------------------------------------------------

_LEGACY_TYPES = {"char": "i1", "signed_char": "i1", "unsigned_char": "u1", "short": "i2", "unsigned_short": "u2"} | {
    **{"int": "i4", "unsigned_int": "u4", "vtkidtype": "i4", "float": "f4", "double": "f8"},
    **{"long": "i8", "unsigned_long": "u8", "vtktypeint64": "i8", "vtktypeuint64": "u8"},
}
_COMPONENTS = {"VECTORS": 3, "NORMALS": 3, "TENSORS": 9, "TENSORS6": 6, "GLOBAL_IDS": 1, "PEDIGREE_IDS": 1}


def _read_vtk(path: Path) -> Surface:
    """Read a legacy VTK file.

    Not with vtkPolyDataReader, which fills the arrays of a file that is cut off with anything, without an error,
    and on damaged cells ends the program.
    """
    data = path.read_bytes()
    if not data.startswith(b"# vtk DataFile"):
        raise _unreadable(path, 'it is not a legacy VTK file (it does not begin with "# vtk DataFile")')
    head = re.match(rb"[^\n]*\n([^\n]*)\n\s*(ASCII|BINARY)\s+DATASET\s+(\w+)[^\n]*\n?", data, re.IGNORECASE)
    if not head:
        raise _unreadable(path, "the four lines that a legacy VTK file begins with are incomplete")
    title, encoding, kind = (part.decode("latin-1") for part in head.groups())
    if kind.upper() != "POLYDATA":
        volume = ", a volume" if kind.upper().startswith(("STRUCTURED_POINTS", "RECTILINEAR")) else ""
        raise _unreadable(path, f"it holds {kind}{volume}, expected POLYDATA (in 3D Slicer: export as a model)")
    try:
        return _LegacyFile(data, head.end(), encoding.upper() == "ASCII").surface(_space(title))
    except LAFlatteningError:
        raise
    except EOFError as error:
        raise _unreadable(path, f"it is cut off in {error}") from error
    except (ValueError, LookupError, TypeError, OverflowError) as error:
        raise _unreadable(path, f"its contents make no sense ({error})") from error


class _LegacyFile:
    """A place in a legacy VTK file, and what was read before it."""

    def __init__(self, data: bytes, place: int, is_text: bool) -> None:
        self.data = data
        self.place = place
        self.is_text = is_text
        blank = np.frombuffer(data, np.uint8) <= 32 if is_text else np.zeros(0, bool)
        # In a text file: where each word ends.
        self.ends = np.flatnonzero(~blank & np.append(blank[1:], True)) + 1

    def surface(self, space: str) -> Surface:
        """Read all sections."""
        points = np.zeros((0, 3))
        triangles = np.zeros((0, 3), np.int64)
        before = 0
        arrays: dict[str, dict[str, NDArray[Any]]] = {"FIELD": {}, "POINT_DATA": {}, "CELL_DATA": {}}
        current, tuples = arrays["FIELD"], 0
        while words := self._words():
            key = words[0].upper()
            if key == "POINTS":
                points = self._values(key, 3 * int(words[1]), words[2]).reshape(-1, 3)
            elif key == "POLYGONS":
                triangles = self._triangles(words)
            elif key in ("VERTICES", "LINES", "TRIANGLE_STRIPS"):
                sizes, _ = self._cells(words)
                # Cell arrays begin with the values of vertices and lines.
                before += sizes if key != "TRIANGLE_STRIPS" else 0
            elif key in ("POINT_DATA", "CELL_DATA"):
                current, tuples = arrays[key], int(words[1])
            elif key == "FIELD":
                for _ in range(int(words[2])):
                    while self._at(b"METADATA"):
                        self._skip_metadata()
                    name, components, count, kind = self._words()
                    self._add(current, name, int(components), int(count), kind)
            elif key == "SCALARS":
                if self._at(b"LOOKUP_TABLE"):
                    self._words()
                self._add(current, words[1], int((*words, "1")[3]), tuples, words[2])
            elif key in _COMPONENTS:
                self._add(current, words[1], _COMPONENTS[key], tuples, words[2])
            elif key == "TEXTURE_COORDINATES":
                self._add(current, words[1], int(words[2]), tuples, words[3])
            elif key == "COLOR_SCALARS":
                self._add(current, words[1], int(words[2]), tuples, "float" if self.is_text else "unsigned_char")
            elif key == "LOOKUP_TABLE":
                self._values(key, 4 * int(words[2]), "float" if self.is_text else "unsigned_char")
            elif key == "METADATA":
                self._skip_metadata()
            else:
                raise ValueError(f'unknown section "{words[0][:40]}"')
        cells = {name: values[before : before + len(triangles)] for name, values in arrays["CELL_DATA"].items()}
        return Surface(points, triangles, arrays["POINT_DATA"], cells, arrays["FIELD"], space)

    def _at(self, word: bytes) -> bool:
        return self.data[self.place : self.place + 80].lstrip().upper().startswith(word)

    def _words(self) -> list[str]:
        """The next line that is not blank; empty at the end of the file."""
        line = re.compile(rb"\s*([^\n]*)\n?").match(self.data, self.place)
        self.place = line.end() if line else len(self.data)
        return line[1].decode("latin-1").split() if line else []

    def _skip_metadata(self) -> None:
        blank_line = re.compile(rb"\n[^\S\n]*\n").search(self.data, self.place - 1)
        self.place = blank_line.end() if blank_line else len(self.data)

    def _add(self, arrays: dict[str, NDArray[Any]], name: str, components: int, tuples: int, kind: str) -> None:
        name = unquote(name)
        values = self._values(f'the array "{name}"', components * tuples, kind)
        arrays[name] = values if components == 1 else values.reshape(tuples, components)

    def _values(self, what: str, count: int, kind: str) -> NDArray[Any]:
        """The next values; EOFError if the file has fewer."""
        if count < 0:
            raise ValueError(f"{what} has {count} values")
        if kind.lower() == "string":
            return np.array([self._string(what) for _ in range(count)], dtype=object)
        dtype = np.dtype("u1" if kind.lower() == "bit" else _LEGACY_TYPES[kind.lower()])
        start = self.place
        if self.is_text:
            last = int(np.searchsorted(self.ends, start, "right")) + count - 1
            if last >= len(self.ends):
                raise EOFError(what)
            self.place = int(self.ends[last]) if count else start
            with np.errstate(over="ignore"):
                return np.array(self.data[start : self.place].split(), dtype)
        self.place += (count + 7) // 8 if kind.lower() == "bit" else count * dtype.itemsize
        if self.place > len(self.data):
            raise EOFError(what)
        if kind.lower() == "bit":
            return np.unpackbits(np.frombuffer(self.data, np.uint8, self.place - start, start), count=count)
        return np.frombuffer(self.data, dtype.newbyteorder(">"), count, start).astype(dtype)

    def _string(self, what: str) -> str:
        if self.place >= len(self.data):
            raise EOFError(what)
        if self.is_text:
            end = self.data.find(b"\n", self.place) % (len(self.data) + 1)
            text = unquote(self.data[self.place : end].decode().rstrip("\r"))
            self.place = end + 1
            return text
        # The two highest bits tell whether the length is stored in 8, 4, 2 or 1 bytes.
        size = 8 >> (self.data[self.place] >> 6)
        length = int.from_bytes(self.data[self.place : self.place + size], "big") & ((1 << 8 * size - 2) - 1)
        start = self.place + size
        self.place = start + length
        if self.place > len(self.data):
            raise EOFError(what)
        return self.data[start : self.place].decode()

    def _cells(self, words: list[str]) -> tuple[int, NDArray[Any]]:
        """Number of cells, and their points; (m, 4) with the number of points first if all are triangles."""
        key, count, size = words[0].upper(), int(words[1]), int(words[2])
        if not self._at(b"OFFSETS"):
            values = self._values(key, size, "int")
            return count, values.reshape(-1, 4) if size == 4 * count else values
        # Version 5 stores where each cell begins, then all points.
        offsets = self._values(key, count, self._words()[1])
        values = self._values(key, size, self._words()[1])
        if len(offsets) and (np.diff(offsets) == 3).all() and offsets[0] == 0 and offsets[-1] == size:
            values = np.insert(values.reshape(-1, 3), 0, 3, axis=1)
        return max(count - 1, 0), values

    def _triangles(self, words: list[str]) -> NDArray[np.int64]:
        count, values = self._cells(words)
        if values.ndim != 2 or (values[:, 0] != 3).any():
            raise SurfaceError(
                f"Not all of the {count} faces are triangles. Triangulate the surface first (in Slicer: Surface "
                "Toolbox)."
            )
        return values[:, 1:].astype(np.int64)


# ---- text formats and PLY -----------------------------------------------------------------------------------


def _read_obj(path: Path) -> Surface:
    """Read an OBJ file by its own vertices.

    vtkOBJReader cuts a surface apart wherever neighbouring faces have other normals or texture points.
    """
    points: list[list[float]] = []
    faces: list[list[int]] = []
    header: list[str] = []
    lines = path.read_text(encoding="latin-1").replace("\\\n", " ").splitlines()
    for number, line in enumerate(lines, 1):
        if line.startswith("#") and len(header) == number - 1:
            header.append(line)
        words = line.split()
        try:
            if words[:1] == ["v"]:
                points.append([float(word) for word in words[1:4]])
            elif words[:1] == ["f"]:
                corners = [int(word.partition("/")[0]) for word in words[1:]]
                if 0 in corners:
                    raise ValueError
                # Numbered from 1; or backwards from the latest vertex, which is -1.
                faces.append([corner - 1 if corner > 0 else len(points) + corner for corner in corners])
        except ValueError as error:
            raise _unreadable(path, f'line {number} is not a vertex or face of an OBJ file: "{line[:60]}"') from error
    if any(len(point) != 3 for point in points):
        raise _unreadable(path, "a vertex has fewer than three coordinates")
    scale = _obj_unit("\n".join(header), path)
    return Surface(scale * np.reshape(points, (-1, 3)), _triangles(faces), space=_space("\n".join(header)))


def _obj_unit(header: str, path: Path) -> float:
    """Millimetres in a unit of the file: 1, unless Mimics or 3-matic say otherwise in their header."""
    sentence = re.compile(r"vertex coordinates are measured in units, where 1 unit =\s*(\S+)\s*(\S*)", re.IGNORECASE)
    found = sentence.search(header)
    if not found:
        return 1.0
    size, unit = found.groups()
    # Slicer converts from mm only, and loads other units with a warning as if they were mm.
    if not _NUMBER.fullmatch(size) or float(size) <= 0 or unit.lower() not in _MM:
        raise _unreadable(path, f'its header says that 1 unit is "{size} {unit}"; expected a length in mm, cm or m')
    return float(size) * _MM[unit.lower()]


def _triangles(faces: list[list[int]]) -> NDArray[np.int64]:
    others = [len(face) for face in faces if len(face) != 3]
    if others:
        raise SurfaceError(
            f"{len(others)} of {len(faces)} faces are not triangles (one has {others[0]} corners). Triangulate the "
            "surface first (in Slicer: Surface Toolbox)."
        )
    return np.reshape(np.array(faces, np.int64), (-1, 3))


def _write_obj(surface: Surface, path: Path) -> None:
    """Write an OBJ file, in full precision; it has no arrays."""
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.write(f"# {_HEADER}{surface.space}\n")
        file.writelines(f"v {x!r} {y!r} {z!r}\n" for x, y, z in surface.points.tolist())
        file.writelines(f"f {a} {b} {c}\n" for a, b, c in (surface.triangles + 1).tolist())


def _read_ply(path: Path) -> Surface:
    """Read a PLY file: vtkPLYReader ends the program on a file that is cut off, and rounds."""
    data = path.read_bytes()
    end = re.search(rb"\nend_header[^\S\n]*\n", data)
    if not data.startswith(b"ply") or not end:
        raise _unreadable(path, 'it is not a PLY file (it does not begin with "ply" and a header)')
    header = [line.split() for line in data[: end.start()].decode(errors="replace").splitlines()]
    try:
        tables = _ply_tables(header, memoryview(data)[end.end() :])
        vertex, face = tables["vertex"], tables.get("face", {})
        points = np.column_stack([vertex.pop(axis) for axis in "xyz"]).astype(np.float64)
    except LAFlatteningError:
        raise
    except EOFError as error:
        raise _unreadable(path, f"it is cut off in its list of {error}") from error
    except (ValueError, LookupError, TypeError, OverflowError) as error:
        raise _unreadable(path, f"its header or its lists make no sense ({error!r})") from error
    colours = [vertex.pop(name) for name in _COLOURS if name in vertex]
    if colours:
        vertex["RGBA"[: len(colours)]] = np.column_stack(colours)
    corners = next((face[name] for name in ("vertex_indices", "vertex_index") if name in face), np.zeros((0, 3)))
    comments = "\n".join(" ".join(words) for words in header if words[:1] == ["comment"])
    arrays = {name: values for name, values in face.items() if values.ndim == 1}
    return Surface(points, corners.astype(np.int64), vertex, arrays, space=_space(comments))


def _ply_tables(header: list[list[str]], body: memoryview | bytes) -> dict[str, dict[str, NDArray[Any]]]:
    """The columns of each element of a PLY file, by name."""
    kinds = [words[1] for words in header if words[:1] == ["format"]]
    order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[kinds[0]]
    if not order:
        body = np.array(bytes(body).split(), "<f8").tobytes()
    tables: dict[str, dict[str, NDArray[Any]]] = {}
    place = 0
    for start, words in enumerate(header):
        if words[:1] != ["element"]:
            continue
        name, count = words[1], int(words[2])
        columns: list[Any] = []
        types: dict[str, str] = {}
        for line in header[start + 1 :]:
            if line[:1] == ["element"]:
                break
            if line[:1] != ["property"]:
                continue
            stored = [order + _PLY_TYPES[kind] if order else "<f8" for kind in line[1:-1] if kind != "list"]
            if line[1] == "list":
                # All lists are taken to be as long as the first, which is then checked.
                at = place + np.dtype(columns).itemsize
                length = int(np.frombuffer(body, stored[0], 1, at)[0]) if count else 3
                if line[-1].startswith("vertex_ind") and length != 3:
                    raise SurfaceError(f"Faces are not triangles (one has {length} corners). Triangulate them first.")
                columns.append((f"length of {line[-1]}", stored[0]))
                columns.append((line[-1], stored[1], (length,)))
            else:
                columns.append((line[-1], stored[0]))
            types[line[-1]] = _PLY_TYPES[line[-2]]
        row = np.dtype(columns)
        if place + count * row.itemsize > len(body):
            raise EOFError(name)
        table = np.frombuffer(body, row, count, place)
        place += count * row.itemsize
        for column in types:
            if (lengths := f"length of {column}") in (row.names or ()) and len(np.unique(table[lengths])) > 1:
                raise SurfaceError("Some faces are triangles and others are not. Triangulate the surface first.")
        tables[name] = {column: table[column].astype(kind) for column, kind in types.items()}
    return tables


def _write_ply(surface: Surface, path: Path) -> None:
    """Write a binary PLY file, in full precision, with the numeric point arrays."""
    columns: dict[str, NDArray[Any]] = dict(zip("xyz", surface.points.T, strict=True))
    for name, values in surface.point_data.items():
        name = re.sub(r"\s", "_", name)
        if values.dtype.kind not in "biuf":
            continue
        if values.ndim == 1:
            columns.setdefault(name, values)
        elif values.dtype == np.uint8 and values.shape[1] in (3, 4) and "red" not in columns:
            columns.update(zip(_COLOURS, values.T, strict=False))
        else:
            columns.update({f"{name}_{k}": part for k, part in enumerate(values.T)})
    kinds = {name: _ply_type(values) for name, values in columns.items()}
    rows = np.empty(len(surface.points), [(name, f"<{_PLY_TYPES[kind]}") for name, kind in kinds.items()])
    for name, values in columns.items():
        rows[name] = values
    faces = np.empty(len(surface.triangles), [("length", "u1"), ("ids", "<i4", (3,))])
    faces["length"], faces["ids"] = 3, surface.triangles
    header = ["ply", "format binary_little_endian 1.0", f"comment {_HEADER}{surface.space}"]
    header += [f"element vertex {len(rows)}", *(f"property {kind} {name}" for name, kind in kinds.items())]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header\n"]
    with path.open("wb") as file:
        file.write("\n".join(header).encode())
        file.write(rows.data)
        file.write(faces.data)


def _ply_type(values: NDArray[Any]) -> str:
    """The PLY type that holds the values of an array exactly, or as a double where there is none."""
    names = {"i1": "char", "u1": "uchar", "b1": "uchar", "i2": "short", "u2": "ushort", "i4": "int", "u4": "uint"}
    name = (names | {"f4": "float"}).get(values.dtype.str[1:])
    if name is None and values.dtype.kind in "iu" and len(values) and np.abs(values).max() < 2**31:
        return "int"
    return name or "double"


_READERS = {".vtp": _read_vtp, ".vtk": _read_vtk, ".stl": _read_stl, ".ply": _read_ply, ".obj": _read_obj}
_WRITERS = {".vtp": _write_vtp, ".vtk": _write_vtk, ".stl": _write_stl, ".ply": _write_ply, ".obj": _write_obj}


# ---- seeds --------------------------------------------------------------------------------------------------


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
    suffix = _input_suffix(path, _SEED_SUFFIXES, "seeds")
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
    suffix = _known_suffix(path, (".csv", ".mrk.json", ".json"), "seeds")
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
        raise _unreadable(path, "it is not text in UTF-8 (in a spreadsheet: save as CSV UTF-8)") from error
    if "\0" in text:
        raise _unreadable(path, "it is not a text file")
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
        raise _unreadable(path, f"line {reader.line_num} is not CSV ({error})") from error


def _coordinate(text: str, name: str, seeds: _Seeds, place: str, label: str) -> float:
    if not text:
        raise seeds.error(place, label, f"{name} is missing. Expected a number (mm).")
    if not _NUMBER.fullmatch(text):
        raise seeds.error(place, label, f'{name} is "{text}". Expected a number (mm), such as -12.5.')
    return float(text)


def _seeds_from_csv(path: Path) -> dict[str, FloatArray]:
    lines = _text_of(path).splitlines()
    # Spreadsheets separate by semicolons where the comma is the decimal sign.
    separator = ";" if any(";" in line for line in lines) else ","
    rows = _rows(path, lines, separator)
    first, names = next(rows, (1, []))
    names = [name.lower().removesuffix("_mm") for name in names]
    if any(names.count(name) != 1 for name in ("label", "x", "y", "z")):
        raise SeedError(
            f'"{path}", line {first}: expected the column names label,x_mm,y_mm,z_mm, '
            f'found "{lines[first - 1].strip() if lines else ""}". Add them as the first line.'
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
            text = text.replace(",", ".") if separator == ";" else text
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
        raise _unreadable(path, 'it is JSON, but not Slicer markups (it has no list "markups")')
    schema = document.get("@schema", _MARKUPS)
    if not re.search(r"markups-schema-v1\.\d+\.\d+\.json#*$", str(schema).lower()):
        raise _unreadable(path, f'its "@schema" is "{schema}", expected markups-schema-v1 of 3D Slicer')
    lists = [markup for markup in lists if markup.get("controlPoints")]
    lists = [markup for markup in lists if markup.get("type") == "Fiducial"] or lists
    if len(lists) != 1:
        names = ", ".join(f'"{markup.get("name", markup.get("type"))}"' for markup in lists)
        raise SeedError(f'"{path}" holds {len(lists)} lists of points ({names or "none"}). Expected one, of the seeds.')
    space = _axes(path, lists[0].get("coordinateSystem", "LPS"))
    unit = lists[0].get("coordinateUnits", "mm")
    unit = unit[0] if isinstance(unit, list) and unit else unit
    if not isinstance(unit, str) or unit not in _MM:
        raise _unreadable(path, f'its "coordinateUnits" is {json.dumps(unit)}, expected one of {", ".join(_MM)}')
    seeds = _Seeds(path)
    points = lists[0]["controlPoints"]
    if not isinstance(points, list) or not all(isinstance(point, dict) for point in points):
        raise _unreadable(path, 'its "controlPoints" is not a list of points')
    for number, point in enumerate(points, 1):
        label, place = str(point.get("label", "")), f"point {number}"
        status = point.get("positionStatus", "defined")
        if status in ("undefined", "preview", "missing"):
            continue
        if status != "defined":
            raise seeds.error(place, label, f'unknown positionStatus {json.dumps(status)}. Expected "defined".')
        position = point.get("position")
        seeds.add(label, position if isinstance(position, list) else [], place, _MM[unit])
    return seeds.some(), space


def _axes(path: Path, name: Any) -> str:
    # Old files number them.
    space = {"0": "RAS", "1": "LPS"}.get(str(name), name)
    if space not in ("LPS", "RAS"):
        raise _unreadable(path, f"its coordinate system is {json.dumps(name)}, expected LPS or RAS")
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


# ---- paths, and writing whole files or none -----------------------------------------------------------------


@contextmanager
def atomic_write(path: PathLike) -> Iterator[Path]:
    """Write a file as a whole or not at all: ``with atomic_write("map.vtp") as temporary: ...`` writes `temporary`.

    The temporary file is in the same folder and has the same extension. It takes the place of `path` when the block
    ends; after an error in the block it is removed, and an older file at `path` is as it was.

    Raises
    ------
    InputFileError : the folder is missing or cannot be written to, the disk is full, a folder has the name.
    """
    target = Path(os.path.realpath(path))
    folder = target.parent
    try:
        if not folder.is_dir():
            reason = "is not a folder" if folder.exists() else "does not exist"
            raise InputFileError(f'"{path}" cannot be written: "{folder}" {reason}. Choose or create another folder.')
        if target.exists() and not target.is_file():
            raise InputFileError(f'"{path}" cannot be written: it is not a file. Choose another name.')
        temporary = folder / f".{target.stem}.{secrets.token_hex(4)}{target.suffix}"
        temporary.touch(exist_ok=False)
    except OSError as error:
        raise _unwritable(path, error) from error
    try:
        yield temporary
        if target.exists():
            shutil.copymode(target, temporary)
        temporary.replace(target)
    except OSError as error:
        raise _unwritable(path, error) from error
    finally:
        temporary.unlink(missing_ok=True)


def check_writable(path: PathLike, make_folder: bool = False) -> None:
    """Find out before long work whether a file can be written; errors as for `atomic_write`. Leaves no file.

    Parameters
    ----------
    make_folder : make the folder of the file, and those that it is in, where they are missing.
    """
    if make_folder:
        try:
            Path(path).parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise _unwritable(path, error) from error
    with suppress(_OnlyChecking), atomic_write(path):
        raise _OnlyChecking


class _OnlyChecking(Exception):
    """Leaves `atomic_write` before anything takes the place of the file."""


def write_text(path: PathLike, text: str) -> None:
    """Write a text file in UTF-8, as a whole or not at all; errors as for `atomic_write`."""
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def _unwritable(path: PathLike, error: OSError) -> InputFileError:
    """The error for a file that the system refuses to write."""
    return InputFileError(
        f'"{path}" cannot be written: {error.strerror or error}. Check the space on the disk, whether you may write '
        "there, and that no other program has the file open."
    )


def _unreadable(path: Path, reason: str) -> InputFileError:
    """The error for a file that is not what it should be."""
    return InputFileError(f'"{path}" cannot be read: {reason}. Check that it is the right file, or export it again.')


def _known_suffix(path: Path, suffixes: Collection[str], what: str) -> str:
    """The first of the extensions that a name has, in upper or lower case."""
    found = [suffix for suffix in suffixes if path.name.lower().endswith(suffix)]
    if not found:
        raise InputFileError(
            f'"{path}" has the extension "{path.suffix}", expected a file of {what}: {", ".join(suffixes)}.'
        )
    return found[0]


def _input_suffix(path: Path, suffixes: Collection[str], what: str) -> str:
    """The extension of a file that exists and holds something."""
    try:
        if path.is_dir():
            raise InputFileError(f'"{path}" is a folder, expected a file of {what}: {", ".join(suffixes)}.')
        if not path.exists():
            raise InputFileError(f'"{path}" does not exist. Check the name and the folder.')
        suffix = _known_suffix(path, suffixes, what)
        if not path.is_file():
            raise _unreadable(path, "it is not a regular file")
        with path.open("rb") as file:
            if not file.read(1):
                raise InputFileError(f'"{path}" is empty. Copy or export it again.')
    except OSError as error:
        raise _unreadable(path, error.strerror or str(error)) from error
    return suffix
