"""Triangle surfaces (.vtp, .vtk, .stl, .ply, .obj) and electroanatomical maps (.mesh of CARTO 3, .mat of OpenEP)."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from html import escape
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonCore import VTK_STRING, vtkStringArray
from vtkmodules.vtkCommonDataModel import vtkPolyData
from vtkmodules.vtkCommonExecutionModel import vtkAlgorithm
from vtkmodules.vtkIOGeometry import vtkSTLReader, vtkSTLWriter
from vtkmodules.vtkIOLegacy import vtkPolyDataWriter
from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

from ..errors import InputFileError, SurfaceError
from ..quantities import NO_VALUE, measured, unit_of
from ..surface import Surface
from .access import (
    HEADER,
    PathLike,
    atomic_write,
    input_suffix,
    known_suffix,
    space_in,
    unreadable,
)
from .carto import read_carto
from .legacy_vtk import read_vtk
from .openep import read_openep
from .ply_obj import read_obj, read_ply, write_obj, write_ply
from .vtp import read_vtp


def read_surface(path: PathLike) -> Surface:
    """Read a triangle surface with its arrays, by its extension in upper or lower case.

    .vtp, .vtk (legacy), .stl, .ply, .obj; electroanatomical maps: .mesh (CARTO 3, see `carto.read_carto`) and .mat
    (OpenEP, see `openep.read_openep`).

    Points are in mm. `Surface.space` is what the file declares, as 3D Slicer declares it ("SPACE=RAS" in the header
    or comment, a string array "SPACE" in .vtp), and "LPS" where it declares nothing. Points of an .stl file with
    exactly the same coordinates are made one; points of all other files stay as they are, in their order. Arrays of
    quantities that mapping systems record (`quantities.KNOWN_UNITS`) are NaN where nothing was measured.

    Raises
    ------
    InputFileError : missing, empty, damaged or cut off, of an unknown kind, or not a surface.
    SurfaceError : read, but not a triangle mesh (no triangles, quadrilaterals, coordinates that are not numbers).

    Source: vtkMRMLModelStorageNode of 3D Slicer (GetCoordinateSystemFromFileHeader, GetCoordinateSystemFromFieldData,
    GetCoordinateUnitScaleFromFileHeader), whose rules these are.
    """
    path = Path(path)
    read = _READERS[input_suffix(path, _READERS, "a surface")]
    try:
        # Of NaN among the points, Surface says more than a warning of numpy.
        with np.errstate(invalid="ignore"):
            surface = read(path)
        return surface.with_data(_gaps_as_nan(surface.point_data), _gaps_as_nan(surface.cell_data))
    except SurfaceError as error:
        raise SurfaceError(f'"{path}": {error}') from error
    except OSError as error:
        raise unreadable(path, error.strerror or str(error)) from error


def write_surface(surface: Surface, path: PathLike) -> None:
    """Write a surface; the extension chooses the format: .vtp (best), .vtk (legacy), .stl, .ply or .obj.

    All formats carry the axes in the way that 3D Slicer reads them. .vtp and .vtk keep every array, .ply the numeric
    point arrays (vectors as NAME_0, NAME_1, ...), .stl and .obj none; .stl rounds coordinates to 7 digits.

    Raises
    ------
    InputFileError : unknown extension, or the file cannot be written; an older file of that name is then unchanged.
    """
    path = Path(path)
    write = _WRITERS[known_suffix(path, _WRITERS, "a surface")]
    with atomic_write(path) as temporary:
        write(surface, temporary)


def _gaps_as_nan(arrays: Mapping[str, NDArray]) -> dict[str, NDArray]:
    """Those of the arrays in which a mapping system marks places without a measurement, marked by NaN instead.

    Not marked so they would be very low voltages, and be averaged with others.
    """
    recorded = {name: array for name, array in arrays.items() if unit_of(name) and array.dtype.kind in "fiu"}
    return {name: measured(array) for name, array in recorded.items() if (array == NO_VALUE).any()}


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
        raise unreadable(path, messages[0])
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
        _escape_names(polydata, path)
    else:
        writer.SetHeader(HEADER + surface.space)
        writer.SetFileTypeToBinary()
    writer.SetInputData(polydata)
    writer.SetFileName(str(path))
    if not writer.Write() or messages:
        raise OSError(messages[0] if messages else "the disk may be full")


def _escape_names(polydata: vtkPolyData, path: Path) -> None:
    """Make the names of all arrays fit to stand in XML, which VTK leaves to its callers (its reader undoes it)."""
    for data in (polydata.GetPointData(), polydata.GetCellData(), polydata.GetFieldData()):
        for k in range(data.GetNumberOfArrays()):
            name = data.GetAbstractArray(k).GetName() or ""
            if re.search(r"[\x00-\x1f]", name):
                raise InputFileError(
                    f'"{path}" cannot be written: the name of the array {name!a} holds a line break or control '
                    "character. Rename the array."
                )
            data.GetAbstractArray(k).SetName(escape(name))


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
            raise unreadable(path, 'it is cut off (its end, "endsolid", is missing)')
    elif size < 84 + 50 * count and count != 0xFFFFFFFF:
        raise unreadable(path, f"it is cut off, or not an STL file (room for {max(size - 84, 0) // 50} triangles)")
    reader = vtkSTLReader()
    # An STL file is a heap of loose triangles; only equal coordinates tell that they meet.
    reader.MergingOn()
    polydata = _run_reader(reader, path)
    return Surface.from_polydata(polydata, space_in(_text(reader.GetHeader() or "")))


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


_READERS = {
    **{".vtp": read_vtp, ".vtk": read_vtk, ".stl": _read_stl, ".ply": read_ply, ".obj": read_obj},
    **{".mesh": read_carto, ".mat": read_openep},
}
_WRITERS = {".vtp": _write_vtp, ".vtk": _write_vtk, ".stl": _write_stl, ".ply": write_ply, ".obj": write_obj}
