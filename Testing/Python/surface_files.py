"""What the tests of files of surfaces share: samples, VTK's own readers and writers, and how a refusal is read."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from meshes import grid, icosphere
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkStringArray
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

from LAFlatteningLib.errors import InputFileError
from LAFlatteningLib.files import (
    read_surface,
)
from LAFlatteningLib.surface import Surface

EXTENSIONS = (".vtp", ".vtk", ".stl", ".ply", ".obj")
ASCII, BINARY = 1, 2
SQUARE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\n"


def sample(space: str = "LPS") -> Surface:
    """A ball far from the origin, with coordinates that need all digits, and arrays of many kinds."""
    ball = icosphere(30.0, 2)
    n, m = len(ball.points), len(ball.triangles)
    voltage = np.sin(np.arange(n))
    voltage[3] = np.nan
    return Surface(
        ball.points + np.array([10.0, -200.123456789, 50.0]),
        ball.triangles,
        {
            "voltage": voltage,
            "scar": (np.arange(n) % 2).astype(np.uint8),
            "surface_point_id": np.arange(n) + 7,
            "späte Anreicherung": np.arange(n, dtype=np.float32),
            "fibre": np.random.default_rng(1).normal(size=(n, 3)),
            "colour": np.random.default_rng(2).integers(0, 256, (n, 3)).astype(np.uint8),
        },
        {"region": np.arange(m) % 5 + 1, "normal": np.random.default_rng(3).normal(size=(m, 3)).astype(np.float32)},
        {
            "method": np.array(["regional"], object),
            "seeds": np.array(["RSPV", "veine pulmonaire droite é", "MV1"], object),
        },
        space,
    )


def corners(surface: Surface) -> np.ndarray:
    """(m, 9) coordinates of the corners of each triangle, in the file's order."""
    return surface.points[surface.triangles].reshape(-1, 9)


def same_arrays(found: Any, expected: Any) -> None:
    assert set(found) == set(expected)
    for name, values in expected.items():
        assert found[name].dtype.kind == values.dtype.kind, name
        np.testing.assert_array_equal(found[name], values, err_msg=name)


def refusal(path: Path, error: type[Exception] = InputFileError) -> str:
    with pytest.raises(error) as caught:
        read_surface(path)
    assert str(path) in str(caught.value)
    return str(caught.value)


@pytest.fixture(autouse=True)
def silence(capfd: pytest.CaptureFixture[str]) -> Iterator[None]:
    """No test may leave anything on the console, whatever file it reads: VTK prints its errors by default."""
    yield
    printed = capfd.readouterr()
    assert printed.out + printed.err == ""


def vtk_read(reader: Any, path: Path) -> vtkPolyData:
    reader.SetFileName(str(path))
    reader.Update()
    return reader.GetOutput()


def vtk_write(writer: Any, polydata: Any, path: Path, **settings: Any) -> Path:
    writer.SetInputData(polydata)
    writer.SetFileName(str(path))
    for name, value in settings.items():
        getattr(writer, name)(value)
    assert writer.Write()
    return path


def of_every_kind() -> vtkPolyData:
    """Vertices, lines and triangles, with arrays in every section that the legacy format has."""
    polydata = grid(5, 4, 40.0, 30.0).to_polydata()
    for name, size in (("Verts", 1), ("Lines", 2)):
        cells = vtkCellArray()
        cells.InsertNextCell(size, list(range(size)))
        getattr(polydata, f"Set{name}")(cells)
    chance = np.random.default_rng(5)
    for data, n in ((polydata.GetPointData(), polydata.GetNumberOfPoints()), (polydata.GetCellData(), 26)):
        assert n in (20, polydata.GetNumberOfCells())
        kinds = [
            np.int8,
            np.uint8,
            np.int16,
            np.uint16,
            np.int32,
            np.uint32,
            np.int64,
            np.uint64,
            np.float32,
            np.float64,
        ]
        arrays: dict[str, np.ndarray] = {
            f"type {np.dtype(kind).name}": chance.integers(0, 100, n).astype(kind) for kind in kinds
        }
        arrays['100 %\t"odd" näme'] = chance.normal(size=(n, 2))
        arrays["six"] = chance.normal(size=(n, 6))
        for name, values in arrays.items():
            array = numpy_to_vtk(values, deep=True)
            array.SetName(name)
            array.SetComponentName(0, "first")
            data.AddArray(array)
        for attribute, components in [("Scalars", 1), ("Vectors", 3), ("Normals", 3), ("Tensors", 9), ("TCoords", 2)]:
            array = numpy_to_vtk(chance.normal(size=(n, components)).squeeze(), deep=True)
            array.SetName(attribute.lower())
            getattr(data, f"Set{attribute}")(array)
        for attribute in ("GlobalIds", "PedigreeIds"):
            from vtkmodules.vtkCommonCore import vtkIdTypeArray

            ids = vtkIdTypeArray()
            ids.SetName(attribute.lower())
            for i in range(n):
                ids.InsertNextValue(3 * i)
            getattr(data, f"Set{attribute}")(ids)
        texts = vtkStringArray()
        texts.SetName("texts")
        for i in range(n):
            texts.InsertNextValue(["", "a", "two words\n", "é" * 40, "x" * 20000][i % 5])
        data.AddArray(texts)
    note = vtkStringArray()
    note.SetName("note")
    note.InsertNextValue("method: regional")
    polydata.GetFieldData().AddArray(note)
    return polydata


def polydata_xml(tmp_path: Path) -> str:
    path = vtk_write(vtkXMLPolyDataWriter(), grid().to_polydata(), tmp_path / "whole.vtp", SetDataMode=0)
    return path.read_text()
