"""PLY and OBJ files, read and written."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import LAFlatteningError, SurfaceError
from ..surface import Surface
from .access import HEADER, MM, NUMBER, space_in, unreadable

_PLY_TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"} | {
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8", "int8": "i1", "uint8": "u1"},
    **{"int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
}
_COLOURS = ("red", "green", "blue", "alpha")


def read_obj(path: Path) -> Surface:
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
        except (ValueError, OverflowError) as error:
            raise unreadable(path, f'line {number} is not a vertex or face of an OBJ file: "{line[:60]}"') from error
    if any(len(point) != 3 for point in points):
        raise unreadable(path, "a vertex has fewer than three coordinates")
    scale = _obj_unit("\n".join(header), path)
    try:
        triangles = _triangles(faces)
    except OverflowError as error:
        raise unreadable(path, "a face has a point number that is impossibly large") from error
    return Surface(scale * np.reshape(points, (-1, 3)), triangles, space=space_in("\n".join(header)))


def _obj_unit(header: str, path: Path) -> float:
    """Millimetres in a unit of the file: 1, unless Mimics or 3-matic say otherwise in their header."""
    sentence = re.compile(r"vertex coordinates are measured in units, where 1 unit =\s*(\S+)\s*(\S*)", re.IGNORECASE)
    found = sentence.search(header)
    if not found:
        return 1.0
    size, unit = found.groups()
    # Slicer converts from mm only, and loads other units with a warning as if they were mm.
    if not NUMBER.fullmatch(size) or float(size) <= 0 or unit.lower() not in MM:
        raise unreadable(path, f'its header says that 1 unit is "{size} {unit}"; expected a length in mm, cm or m')
    return float(size) * MM[unit.lower()]


def _triangles(faces: list[list[int]]) -> NDArray[np.int64]:
    others = [len(face) for face in faces if len(face) != 3]
    if others:
        raise SurfaceError(
            f"{len(others)} of {len(faces)} faces are not triangles (one has {others[0]} corners). Triangulate the "
            "surface first (in Slicer: Surface Toolbox)."
        )
    return np.reshape(np.array(faces, np.int64), (-1, 3))


def write_obj(surface: Surface, path: Path) -> None:
    """Write an OBJ file, in full precision; it has no arrays."""
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.write(f"# {HEADER}{surface.space}\n")
        file.writelines(f"v {x!r} {y!r} {z!r}\n" for x, y, z in surface.points.tolist())
        file.writelines(f"f {a} {b} {c}\n" for a, b, c in (surface.triangles + 1).tolist())


def read_ply(path: Path) -> Surface:
    """Read a PLY file: vtkPLYReader ends the program on a file that is cut off, and rounds."""
    data = path.read_bytes()
    end = re.search(rb"\nend_header[^\S\n]*\n", data)
    if not data.startswith(b"ply") or not end:
        raise unreadable(path, 'it is not a PLY file (it does not begin with "ply" and a header)')
    header = [line.split() for line in data[: end.start()].decode(errors="replace").splitlines()]
    try:
        tables = _ply_tables(header, memoryview(data)[end.end() :])
        vertex, face = tables["vertex"], tables.get("face", {})
        points = np.column_stack([vertex.pop(axis) for axis in "xyz"]).astype(np.float64)
    except LAFlatteningError:
        raise
    except EOFError as error:
        raise unreadable(path, f"it is cut off in its list of {error}") from error
    except (ValueError, LookupError, TypeError, OverflowError) as error:
        raise unreadable(path, f"its header or its lists make no sense ({error!r})") from error
    colours = [vertex.pop(name) for name in _COLOURS if name in vertex]
    if colours:
        vertex["RGBA"[: len(colours)]] = np.column_stack(colours)
    corners = next((face[name] for name in ("vertex_indices", "vertex_index") if name in face), np.zeros((0, 3)))
    comments = "\n".join(" ".join(words) for words in header if words[:1] == ["comment"])
    arrays = {name: values for name, values in face.items() if values.ndim == 1}
    return Surface(points, corners.astype(np.int64), vertex, arrays, space=space_in(comments))


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


def write_ply(surface: Surface, path: Path) -> None:
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
    header = ["ply", "format binary_little_endian 1.0", f"comment {HEADER}{surface.space}"]
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
