"""Legacy .vtk files, read."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from ..errors import LAFlatteningError, SurfaceError
from ..surface import Surface
from .access import space_in, unreadable

_LEGACY_TYPES = {"char": "i1", "signed_char": "i1", "unsigned_char": "u1", "short": "i2", "unsigned_short": "u2"} | {
    **{"int": "i4", "unsigned_int": "u4", "vtkidtype": "i4", "float": "f4", "double": "f8"},
    **{"long": "i8", "unsigned_long": "u8", "vtktypeint64": "i8", "vtktypeuint64": "u8"},
}
_COMPONENTS = {"VECTORS": 3, "NORMALS": 3, "TENSORS": 9, "TENSORS6": 6, "GLOBAL_IDS": 1, "PEDIGREE_IDS": 1}


def read_vtk(path: Path) -> Surface:
    """Read a legacy VTK file.

    Not with vtkPolyDataReader, which fills the arrays of a file that is cut off with anything, without an error,
    and on damaged cells ends the program.
    """
    data = path.read_bytes()
    if not data.startswith(b"# vtk DataFile"):
        raise unreadable(path, 'it is not a legacy VTK file (it does not begin with "# vtk DataFile")')
    head = re.match(rb"[^\n]*\n([^\n]*)\n\s*(ASCII|BINARY)\s+DATASET\s+(\w+)[^\n]*\n?", data, re.IGNORECASE)
    if not head:
        raise unreadable(path, "the four lines that a legacy VTK file begins with are incomplete")
    title, encoding, kind = (part.decode("latin-1") for part in head.groups())
    if kind.upper() != "POLYDATA":
        volume = ", a volume" if kind.upper().startswith(("STRUCTURED_POINTS", "RECTILINEAR")) else ""
        raise unreadable(path, f"it holds {kind}{volume}, expected POLYDATA (in 3D Slicer: export as a model)")
    try:
        return _LegacyFile(data, head.end(), encoding.upper() == "ASCII").surface(space_in(title))
    except LAFlatteningError:
        raise
    except EOFError as error:
        raise unreadable(path, f"it is cut off in {error}") from error
    except (ValueError, LookupError, TypeError, OverflowError) as error:
        raise unreadable(path, f"its contents make no sense ({error})") from error


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
