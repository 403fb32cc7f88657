"""VTK's XML files of surfaces, .vtp, read."""

from __future__ import annotations

import lzma
import re
import zlib
from base64 import b64decode
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkIOCore import vtkLZ4DataCompressor

from ..errors import LAFlatteningError
from ..surface import Surface, triangles_of_cells
from .access import unreadable

# What follows the "_" of raw appended data is not XML, up to the end of that element. (Two searches, since one for both
# takes time without end in some texts.)
_APPENDED = re.compile(rb"<AppendedData\s([^<>]*)>\s*_")
_RAW = re.compile(rb"encoding\s*=\s*[\"']raw[\"']")
# Codes of expat for a text that ends too early: no element found, unclosed token, partial character.
_UNFINISHED = (3, 5, 6)
_TYPES = {
    **{"Int8": "i1", "Int16": "i2", "Int32": "i4", "Int64": "i8", "Float32": "f4", "Float64": "f8"},
    **{"UInt8": "u1", "UInt16": "u2", "UInt32": "u4", "UInt64": "u8", "Bit": "u1", "String": "u1"},
}
# The order in which cells of the four kinds are numbered.
_CELLS = ("Verts", "Lines", "Polys", "Strips")


def read_vtp(path: Path) -> Surface:
    """Read a VTK XML file of a surface: text, base64 or raw, compressed with zlib, LZMA or LZ4, in either byte order.

    Not with vtkXMLPolyDataReader, which about one in a hundred randomly damaged files makes end the whole program.
    Several pieces are joined, with the arrays that all of them have.

    Source: the chapter on XML file formats of VTK's documentation, and files that VTK's writers made.
    """
    data = path.read_bytes()
    if b"<VTKFile" not in data[: 1 << 16]:
        raise unreadable(path, "it is not a VTK XML file (it has no VTKFile element)")
    raw = _APPENDED.search(data)
    appended, text = None, data
    if raw and _RAW.search(raw[1]):
        end = data.rfind(b"</AppendedData")
        if end < raw.end():
            raise unreadable(path, "it is cut off (its AppendedData has no end)")
        appended, text = data[raw.end() : end], data[: raw.end()] + data[end:]
    parser = ElementTree.XMLParser(target=_NoDocumentType())
    try:
        parser.feed(text)
        root = parser.close()
    except ElementTree.ParseError as error:
        state = "cut off" if error.code in _UNFINISHED else "damaged"
        raise unreadable(path, f"it is {state} (XML: {error})") from error
    except _DocumentType as error:
        raise unreadable(path, "it declares a document type, which no file of VTK does") from error
    except (LookupError, ValueError) as error:
        raise unreadable(path, f"it is in an unknown encoding ({error})") from error
    _tidy(root)
    if root.tag != "VTKFile" or root.get("type") != "PolyData":
        raise unreadable(path, f"it holds {root.get('type', root.tag)}, expected PolyData")
    try:
        return _XmlFile(root, appended).surface()
    except LAFlatteningError:
        raise
    except EOFError as error:
        raise unreadable(path, f"it is cut off or damaged in {error}") from error
    except (ValueError, LookupError, TypeError, OverflowError, MemoryError, zlib.error, lzma.LZMAError) as error:
        raise unreadable(path, f"its contents make no sense ({str(error)[:200]})") from error


class _DocumentType(Exception):
    """The file declares a document type."""


class _NoDocumentType(ElementTree.TreeBuilder):
    """Refuses a document type, which could define entities that fill any memory."""

    def doctype(self, _name: str, _public_id: str | None, _system_id: str | None) -> None:
        raise _DocumentType


def _tidy(root: ElementTree.Element) -> None:
    """Take away namespaces, which many programs declare, and arrays of other time steps than the first."""
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
        element[:] = [child for child in element if "0" in child.get("TimeStep", "0").split()]


class _XmlFile:
    """The elements of a file, and how its values are stored."""

    def __init__(self, root: ElementTree.Element, raw: bytes | None) -> None:
        self.root = root
        self.order = _known(root, "byte_order", {"LittleEndian": "<", "BigEndian": ">"}, "LittleEndian")
        self.word = np.dtype(_known(root, "header_type", {"UInt32": "u4", "UInt64": "u8"}, "UInt32"))
        self.word = self.word.newbyteorder(self.order)
        self.unpack = _known(root, "compressor", _COMPRESSORS, "")
        self.is_raw = raw is not None
        self.appended = raw if raw is not None else _text(root.find("AppendedData")).strip().removeprefix("_").encode()

    def surface(self) -> Surface:
        """Read all pieces."""
        whole = self.root.find("PolyData")
        if whole is None:
            raise ValueError("it has no PolyData element")
        pieces = [self._piece(piece) for piece in whole.findall("Piece")]
        before = np.cumsum([0, *(len(piece[0]) for piece in pieces)])
        points = np.concatenate([np.zeros((0, 3)), *(piece[0] for piece in pieces)])
        triangles = [piece[1] + start for piece, start in zip(pieces, before, strict=False)]
        field = self._arrays(whole.find("FieldData"), None)
        tag = field.get("SPACE", np.zeros(0))
        if tag.dtype == object:
            del field["SPACE"]
        return Surface(
            points,
            np.concatenate([np.zeros((0, 3), np.int64), *triangles]),
            _joined([piece[2] for piece in pieces if len(piece[0])]),
            _joined([piece[3] for piece in pieces if len(piece[1])]),
            field,
            "RAS" if tag.dtype == object and len(tag) and "RAS" in tag[0] else "LPS",
        )

    def _piece(self, piece: ElementTree.Element) -> tuple[NDArray, NDArray, dict[str, NDArray], dict[str, NDArray]]:
        """Points, triangles, point data and cell data of the triangles."""
        count = int(piece.get("NumberOfPoints", "0"))
        points = np.zeros((0, 3))
        if count:
            element = _child(_child(piece, "Points"), "DataArray")
            if int(element.get("NumberOfComponents", "1")) != 3:
                raise ValueError(f"its points have {element.get('NumberOfComponents', '1')} coordinates, expected 3")
            points = self._values(element, 3 * count, "the array of points").reshape(-1, 3)
        counts = [int(piece.get(f"NumberOf{kind}", "0")) for kind in _CELLS]
        triangles = np.zeros((0, 3), np.int64)
        if counts[2]:
            named = {array.get("Name"): array for array in _child(piece, "Polys").findall("DataArray")}
            if not {"offsets", "connectivity"} <= set(named):
                raise ValueError("its Polys have no arrays offsets and connectivity")
            offsets = self._values(named["offsets"], counts[2], "the offsets of the polygons").astype(np.int64)
            corners = self._values(named["connectivity"], int(offsets[-1]), "the corners of the polygons")
            triangles = triangles_of_cells(np.append(0, offsets), corners.astype(np.int64))
            # Of one piece among several, a wrong number would be a point of the next piece.
            if triangles.min() < 0 or triangles.max() >= count:
                raise ValueError(f"its polygons refer to other points than 0 to {count - 1}")
        first = counts[0] + counts[1]
        cells = self._arrays(piece.find("CellData"), sum(counts))
        return (
            points,
            triangles,
            self._arrays(piece.find("PointData"), count),
            {name: values[first : first + len(triangles)] for name, values in cells.items()},
        )

    def _arrays(self, section: ElementTree.Element | None, tuples: int | None) -> dict[str, NDArray]:
        """The arrays of a section by name; ``tuples`` is None where each says its own number."""
        result: dict[str, NDArray] = {}
        for number, element in enumerate(section if section is not None else ()):
            name = element.get("Name") or f"array_{number}"
            # Of several with one name, VTK reads the first.
            if name in result:
                continue
            what = f'the array "{name}"'
            components = int(element.get("NumberOfComponents") or 1)
            count = tuples if tuples is not None else element.get("NumberOfTuples")
            values = self._values(element, None if count is None else int(count) * components, what)
            result[name] = values if components == 1 else values.reshape(-1, components)
        return result

    def _values(self, element: ElementTree.Element, count: int | None, what: str) -> NDArray[Any]:
        """The values of an array; ``count`` of them, or as many as there are."""
        kind = element.get("type", "")
        if kind not in _TYPES:
            raise ValueError(f'{what} has the type "{kind}"')
        if count is not None and count < 0:
            raise ValueError(f"{what} has {count} values")
        dtype = np.dtype(_TYPES[kind])
        if count == 0:
            return np.zeros(0, object if kind == "String" else dtype)
        size = None if count is None or kind == "String" else count * dtype.itemsize
        if _form(element) == "ascii":
            # Letters beyond ASCII are negative numbers where C's char has a sign.
            parsed = np.int16 if kind == "String" else dtype
            with np.errstate(over="ignore"):
                values = np.array(_text(element).split(), parsed).astype(dtype, copy=False)
        else:
            if kind == "Bit" and count is not None:
                size = (count + 7) // 8
            values = np.frombuffer(self._bytes(element, size, what), dtype.newbyteorder(self.order)).astype(dtype)
            if kind == "Bit":
                values = np.unpackbits(values, count=count)
        if kind == "String":
            # Each string ends with a zero.
            values = np.array(
                [word.decode(errors="replace") for word in values.tobytes().split(b"\0")[:-1]], dtype=object
            )
        if count is not None and len(values) != count:
            raise ValueError(f"{what} has {len(values)} values, expected {count}")
        return values

    def _bytes(self, element: ElementTree.Element, size: int | None, what: str) -> bytes:
        """What an array holds, unpacked: ``size`` bytes, or as many as its header says."""
        form = _form(element)
        if form == "appended":
            place = int(element.get("offset", "-1"))
            if not 0 <= place < len(self.appended):
                raise EOFError(what)
            stream = _Stream(self.appended, place, self.is_raw, what)
        elif form == "binary":
            stream = _Stream("".join(_text(element).split()).encode(), 0, False, what)
        else:
            raise ValueError(f'{what} has the format "{form}"')
        return self._unpacked(stream, size, what)

    def _unpacked(self, stream: _Stream, size: int | None, what: str) -> bytes:
        """Read past the header, whose words are the size, or of packed values the sizes of their blocks."""
        if self.unpack is None:
            (found,) = stream.peek(self.word, 1)
            self._check_size(found, size, what)
            if stream.ends_after(self.word.itemsize):
                stream.take(self.word.itemsize)
                return stream.take(found)
            return stream.take(self.word.itemsize + found)[self.word.itemsize :]
        (blocks,) = stream.peek(self.word, 1)
        if not blocks:
            self._check_size(0, size, what)
            return b""
        # The last block may be a shorter one; 0 says that it is not.
        blocks, full, last = stream.peek(self.word, 3)
        self._check_size(blocks * full - (full - last if last else 0), size, what)
        sizes = np.frombuffer(stream.take((3 + blocks) * self.word.itemsize), self.word)[3:]
        packed = stream.take(sum(sizes.tolist()))
        ends = np.cumsum(sizes, dtype=np.int64)
        parts = []
        for number, (end, length) in enumerate(zip(ends.tolist(), sizes.tolist(), strict=True), 1):
            expected = last if last and number == blocks else full
            parts.append(self.unpack(packed[end - length : end], expected))
            if len(parts[-1]) != expected:
                raise ValueError(f"{what} has a block of {len(parts[-1])} bytes, expected {expected}")
        return b"".join(parts)

    def _check_size(self, found: int, expected: int | None, what: str) -> None:
        if expected is not None and found != expected:
            raise ValueError(f"{what} has {found} bytes, expected {expected}")


class _Stream:
    """Bytes from a place on, as they are or in base64, in which each run that was written at once ends in itself."""

    def __init__(self, source: bytes, place: int, is_raw: bool, what: str) -> None:
        self.source = source
        self.place = place
        self.is_raw = is_raw
        self.what = what

    def peek(self, word: np.dtype, count: int) -> list[int]:
        """The words of a header that come next."""
        size = count * word.itemsize
        length = size if self.is_raw else -(-size // 3) * 4
        part = self._part(length)
        return np.frombuffer(part if self.is_raw else b64decode(part, validate=True), word, count).tolist()

    def ends_after(self, size: int) -> bool:
        """Whether a run ends after these bytes: some programs write the header of values as a run of its own."""
        return not self.is_raw and self._part(-(-size // 3) * 4).endswith(b"=" * (-size % 3))

    def take(self, size: int) -> bytes:
        """The next bytes, which are one run."""
        part = self._part(size if self.is_raw else -(-size // 3) * 4)
        self.place += len(part)
        found = part if self.is_raw else b64decode(part, validate=True)
        if len(found) != size:
            raise EOFError(self.what)
        return found

    def _part(self, length: int) -> bytes:
        if length > len(self.source) - self.place:
            raise EOFError(self.what)
        return self.source[self.place : self.place + length]


def _inflate(packed: bytes, size: int) -> bytes:
    return _whole(zlib.decompressobj(), packed, size)


def _unpack_lzma(packed: bytes, size: int) -> bytes:
    return _whole(lzma.LZMADecompressor(), packed, size)


def _whole(decompressor: Any, packed: bytes, size: int) -> bytes:
    # One byte more than expected is enough to see that there is more.
    unpacked = decompressor.decompress(packed, size + 1)
    if not decompressor.eof:
        raise ValueError("a packed block has no end")
    return unpacked


def _unpack_lz4(packed: bytes, size: int) -> bytes:
    # LZ4 does not pack more tightly.
    if size > 255 * len(packed):
        return b""
    compressor = vtkLZ4DataCompressor()
    # Without an observer VTK prints its errors.
    compressor.AddObserver("ErrorEvent", lambda _caller, _event: None)
    unpacked = bytearray(size)
    return bytes(unpacked[: compressor.Uncompress(packed, len(packed), unpacked, size)])


_COMPRESSORS: dict[str, Callable[[bytes, int], bytes] | None] = {
    **{"": None, "vtkZLibDataCompressor": _inflate, "vtkLZMADataCompressor": _unpack_lzma},
    **{"vtkLZ4DataCompressor": _unpack_lz4},
}


def _joined(pieces: list[dict[str, NDArray]]) -> dict[str, NDArray]:
    """The arrays that all pieces have."""
    names = [name for name in pieces[0] if all(name in piece for piece in pieces)] if pieces else []
    return {name: np.concatenate([piece[name] for piece in pieces]) for name in names}


def _known(element: ElementTree.Element, attribute: str, values: dict[str, Any], default: str) -> Any:
    text = element.get(attribute, default)
    if text not in values:
        raise ValueError(f"{attribute} is {text}, expected {', '.join(filter(None, values))}")
    return values[text]


def _form(element: ElementTree.Element) -> str:
    """How an array is stored: in the appended data if it has a place there, as VTK reads it; else text by default."""
    return "appended" if element.get("offset") is not None else element.get("format", "ascii").lower()


def _child(element: ElementTree.Element, tag: str) -> ElementTree.Element:
    child = element.find(tag)
    if child is None:
        raise ValueError(f"{element.tag} has no element {tag}")
    return child


def _text(element: ElementTree.Element | None) -> str:
    """The text of an element, without that of its children (VTK stores ranges there)."""
    return "" if element is None else (element.text or "") + "".join(child.tail or "" for child in element)
