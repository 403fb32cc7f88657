"""Files: round trips, files of other programs, real atria, and every kind of bad file with its message."""

from __future__ import annotations

import csv
import json
import os
import shutil
import struct
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from meshes import grid, icosphere
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkBitArray, vtkPoints, vtkStringArray
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkImageData, vtkPolyData, vtkUnstructuredGrid
from vtkmodules.vtkIOGeometry import vtkOBJReader, vtkOBJWriter, vtkSTLReader, vtkSTLWriter
from vtkmodules.vtkIOLegacy import (
    vtkPolyDataReader,
    vtkPolyDataWriter,
    vtkStructuredPointsWriter,
    vtkUnstructuredGridWriter,
)
from vtkmodules.vtkIOPLY import vtkPLYReader, vtkPLYWriter
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLPolyDataWriter

from LAFlatteningLib.errors import InputFileError, LAFlatteningError, SeedError, SurfaceError
from LAFlatteningLib.files import (
    atomic_write,
    check_writable,
    read_seeds,
    read_surface,
    write_seeds,
    write_surface,
    write_text,
)
from LAFlatteningLib.surface import Surface

EXTENSIONS = (".vtp", ".vtk", ".stl", ".ply", ".obj")
ASCII, BINARY = 1, 2


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


# ---- round trips ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("space", ["LPS", "RAS"])
@pytest.mark.parametrize("extension", EXTENSIONS)
def test_round_trip(tmp_path: Path, extension: str, space: str) -> None:
    surface, path = sample(space), tmp_path / f"surface of Zoë{extension.upper()}"
    write_surface(surface, path)
    found = read_surface(str(path))
    assert found.space == space
    assert len(found.points) == len(surface.points)
    if extension == ".stl":
        # Points are numbered anew; single precision.
        np.testing.assert_array_equal(corners(found), corners(surface).astype(np.float32))
    else:
        np.testing.assert_array_equal(found.points, surface.points)
        np.testing.assert_array_equal(found.triangles, surface.triangles)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("extension", [".vtp", ".vtk"])
def test_round_trip_keeps_all_arrays(tmp_path: Path, extension: str) -> None:
    surface, path = sample("RAS"), tmp_path / f"a{extension}"
    write_surface(surface, path)
    found = read_surface(path)
    same_arrays(found.point_data, surface.point_data)
    same_arrays(found.cell_data, surface.cell_data)
    same_arrays(found.field_data, surface.field_data)


def test_round_trip_of_point_arrays_in_ply(tmp_path: Path) -> None:
    surface, path = sample(), tmp_path / "a.ply"
    write_surface(surface, path)
    expected = dict(surface.point_data)
    expected["späte_Anreicherung"] = expected.pop("späte Anreicherung")
    expected["RGB"] = expected.pop("colour")
    fibre = expected.pop("fibre")
    expected.update({f"fibre_{k}": fibre[:, k] for k in range(3)})
    same_arrays(read_surface(path).point_data, expected)


def test_reading_does_not_depend_on_what_was_written_before(tmp_path: Path) -> None:
    """A surface read in RAS and written again is not tagged twice, nor as it was."""
    path = tmp_path / "a.vtp"
    write_surface(sample("RAS"), path)
    found = read_surface(path)
    assert "SPACE" not in found.field_data
    moved = Surface(found.points * [-1, -1, 1], found.triangles, field_data={"SPACE": np.array(["RAS"], object)})
    write_surface(moved, path)
    assert read_surface(path).space == "LPS"
    write_surface(moved, tmp_path / "a.vtk")
    assert "SPACE" not in read_surface(tmp_path / "a.vtk").field_data


def test_large_whole_numbers_in_ply(tmp_path: Path) -> None:
    numbers = np.array([0, 2**31, -(2**40), 2**52])
    surface = Surface(np.eye(4)[:, :3], np.array([[0, 1, 2], [1, 2, 3]]), {"id": numbers})
    write_surface(surface, tmp_path / "a.ply")
    assert read_surface(tmp_path / "a.ply").point_data["id"].tolist() == numbers.tolist()


# ---- what we write, read by VTK itself -----------------------------------------------------------------------


def vtk_read(reader: Any, path: Path) -> vtkPolyData:
    reader.SetFileName(str(path))
    reader.Update()
    return reader.GetOutput()


def test_written_vtp_is_read_by_vtk(tmp_path: Path) -> None:
    surface, path = sample("RAS"), tmp_path / "a.vtp"
    write_surface(surface, path)
    polydata = vtk_read(vtkXMLPolyDataReader(), path)
    tag = polydata.GetFieldData().GetAbstractArray("SPACE")
    assert [tag.GetValue(i) for i in range(tag.GetNumberOfValues())] == ["RAS"]
    np.testing.assert_array_equal(vtk_to_numpy(polydata.GetPoints().GetData()), surface.points)
    np.testing.assert_array_equal(
        vtk_to_numpy(polydata.GetPolys().GetConnectivityArray()).reshape(-1, 3), surface.triangles
    )
    np.testing.assert_array_equal(
        vtk_to_numpy(polydata.GetPointData().GetArray("voltage")), surface.point_data["voltage"]
    )
    np.testing.assert_array_equal(vtk_to_numpy(polydata.GetCellData().GetArray("region")), surface.cell_data["region"])


def test_written_vtk_stl_ply_obj_are_read_by_vtk(tmp_path: Path) -> None:
    surface = sample("RAS")
    for extension in (".vtk", ".stl", ".ply", ".obj"):
        write_surface(surface, tmp_path / f"a{extension}")
    legacy = vtkPolyDataReader()
    legacy.ReadAllScalarsOn()
    legacy.ReadAllVectorsOn()
    polydata = vtk_read(legacy, tmp_path / "a.vtk")
    assert legacy.GetHeader().endswith("SPACE=RAS")
    assert (tmp_path / "a.vtk").read_bytes().startswith(b"# vtk DataFile Version 4.2\n")
    np.testing.assert_array_equal(vtk_to_numpy(polydata.GetPoints().GetData()), surface.points)
    np.testing.assert_array_equal(vtk_to_numpy(polydata.GetPointData().GetArray("fibre")), surface.point_data["fibre"])
    assert polydata.GetFieldData().GetAbstractArray("seeds").GetValue(1) == "veine pulmonaire droite é"

    stl = vtkSTLReader()
    polydata = vtk_read(stl, tmp_path / "a.stl")
    assert stl.GetHeader().endswith("SPACE=RAS")
    assert polydata.GetNumberOfPolys() == len(surface.triangles)

    ply = vtkPLYReader()
    polydata = vtk_read(ply, tmp_path / "a.ply")
    comments = ply.GetComments()
    assert any("SPACE=RAS" in comments.GetValue(i) for i in range(comments.GetNumberOfValues()))
    np.testing.assert_array_equal(vtk_to_numpy(polydata.GetPoints().GetData()), surface.points.astype(np.float32))
    np.testing.assert_array_equal(
        vtk_to_numpy(polydata.GetPolys().GetConnectivityArray()).reshape(-1, 3), surface.triangles
    )
    np.testing.assert_array_equal(vtk_to_numpy(polydata.GetPointData().GetArray("RGB")), surface.point_data["colour"])

    obj = vtkOBJReader()
    polydata = vtk_read(obj, tmp_path / "a.obj")
    assert obj.GetComment().strip().endswith("SPACE=RAS")
    np.testing.assert_allclose(vtk_to_numpy(polydata.GetPoints().GetData()), surface.points, rtol=1e-6)
    np.testing.assert_array_equal(
        vtk_to_numpy(polydata.GetPolys().GetConnectivityArray()).reshape(-1, 3), surface.triangles
    )


def test_slicer_reads_what_we_write(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """With the real MRML classes, where they are installed (package slicer-core)."""
    slicer = pytest.importorskip("slicer", reason="slicer-core is not installed")
    surface, seeds = sample("LPS"), {"RSPV": np.array([1.0, 2.0, 3.0]), "MV1": np.array([-4.5, 1e-7, 6.0])}
    for extension in EXTENSIONS:
        for space in ("LPS", "RAS"):
            write_surface(sample(space), tmp_path / f"{space}{extension}")
            storage, node = slicer.vtkMRMLModelStorageNode(), slicer.vtkMRMLModelNode()
            storage.SetFileName(str(tmp_path / f"{space}{extension}"))
            assert storage.ReadData(node), extension
            assert storage.GetCoordinateSystem() == storage.GetCoordinateSystemFromString(space)
            ras = surface.points * ([-1, -1, 1] if space == "LPS" else [1, 1, 1])
            found = vtk_to_numpy(node.GetPolyData().GetPoints().GetData())
            np.testing.assert_allclose(found.min(axis=0), ras.min(axis=0), rtol=1e-6)
            np.testing.assert_allclose(found.max(axis=0), ras.max(axis=0), rtol=1e-6)
    scene = slicer.vtkMRMLScene()
    for space, sign in (("LPS", [-1, -1, 1]), ("RAS", [1, 1, 1])):
        write_seeds(seeds, tmp_path / "seeds.mrk.json", space)
        storage = slicer.vtkMRMLMarkupsJsonStorageNode()
        scene.AddNode(storage)
        node = storage.AddNewMarkupsNodeFromFile(str(tmp_path / "seeds.mrk.json"))
        assert node.GetNumberOfControlPoints() == 2
        for number, (label, point) in enumerate(seeds.items()):
            assert node.GetNthControlPointLabel(number) == label
            np.testing.assert_allclose(node.GetNthControlPointPosition(number), point * sign)
        # And what Slicer writes, with an unplaced point, comes back.
        node.AddControlPoint(0, 0, 0, "LAA")
        node.UnsetNthControlPointPosition(2)
        for name in ("back.mrk.json", "back.fcsv"):
            storage = (
                slicer.vtkMRMLMarkupsJsonStorageNode() if "json" in name else slicer.vtkMRMLMarkupsFiducialStorageNode()
            )
            storage.SetFileName(str(tmp_path / name))
            assert storage.WriteData(node)
            for wanted in ("LPS", "RAS"):
                back = read_seeds(tmp_path / name, wanted)
                assert list(back) == list(seeds)
                for label, point in seeds.items():
                    turn = [1, 1, 1] if wanted == space else [-1, -1, 1]
                    np.testing.assert_allclose(back[label], point * turn, rtol=1e-12, atol=1e-12)
    # Slicer warns that .fcsv is of old.
    capfd.readouterr()


# ---- what VTK writes, read by us -----------------------------------------------------------------------------


def vtk_write(writer: Any, polydata: Any, path: Path, **settings: Any) -> Path:
    writer.SetInputData(polydata)
    writer.SetFileName(str(path))
    for name, value in settings.items():
        getattr(writer, name)(value)
    assert writer.Write()
    return path


@pytest.mark.parametrize(
    "settings",
    [
        {"SetDataMode": 0},
        {"SetDataMode": 1},
        {"SetDataMode": 2},
        {"SetEncodeAppendedData": 0},
        {"SetCompressorType": 0, "SetEncodeAppendedData": 0, "SetHeaderType": 64},
        {"SetCompressorType": 2, "SetByteOrder": 0},
    ],
)
def test_vtp_of_vtk_in_every_encoding(tmp_path: Path, settings: dict[str, int]) -> None:
    surface = sample()
    path = vtk_write(vtkXMLPolyDataWriter(), surface.to_polydata(), tmp_path / "a.vtp", **settings)
    found = read_surface(path)
    np.testing.assert_allclose(found.points, surface.points, rtol=1e-9)
    assert found.space == "LPS"
    assert set(found.point_data) == set(surface.point_data)
    np.testing.assert_allclose(found.point_data["voltage"], surface.point_data["voltage"], rtol=1e-6)


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


@pytest.mark.parametrize("version", [42, 51])
@pytest.mark.parametrize("mode", [ASCII, BINARY])
def test_legacy_vtk_is_read_as_vtk_reads_it(tmp_path: Path, mode: int, version: int) -> None:
    path = tmp_path / "a.vtk"
    vtk_write(vtkPolyDataWriter(), of_every_kind(), path, SetFileType=mode, SetFileVersion=version)
    reader = vtkPolyDataReader()
    for what in ("Scalars", "Vectors", "Normals", "Tensors", "ColorScalars", "TCoords", "Fields"):
        getattr(reader, f"ReadAll{what}On")()
    expected = Surface.from_polydata(vtk_read(reader, path))
    found = read_surface(path)
    np.testing.assert_array_equal(found.points, expected.points)
    np.testing.assert_array_equal(found.triangles, expected.triangles)
    assert len(found.point_data) == 20
    same_arrays(found.point_data, expected.point_data)
    same_arrays(found.cell_data, expected.cell_data)
    same_arrays(found.field_data, expected.field_data)
    assert found.cell_data["type int32"].shape == (24,)


def test_legacy_vtk_written_by_hand(tmp_path: Path) -> None:
    """Old files: windows line ends, colours and a lookup table, FIELD and SCALARS mixed, upper and lower case."""
    text = (
        "# vtk DataFile Version 2.0\nsome program, SPACE=RAS\nascii\ndataset polydata\n\n\npoints 4 float\n"
        "0 0 0 1 0 0\n 0 1 0\t1 1 0\nPOLYGONS 2 8\n3 0 1 2\n3 1 3 2\n\nPOINT_DATA 4\nSCALARS lat double\n"
        "LOOKUP_TABLE mine\n1 2 nan 4\nLOOKUP_TABLE mine 2\n0 0 0 1 1 1 1 1\nCOLOR_SCALARS shade 3\n"
        "0 0.5 1 0 0 0 0 0 0 0 0 1\nFIELD FieldData 2\na 1 4 int\n1 2 3 4\nb 2 4 unsigned_char\n1 2 3 4 5 6 7 8\n"
        "METADATA\nINFORMATION 0\n\nCELL_DATA 2\nSCALARS tag int 1\nLOOKUP_TABLE default\n11 12"
    )
    path = tmp_path / "a.vtk"
    path.write_bytes(text.replace("\n", "\r\n").encode())
    surface = read_surface(path)
    assert surface.space == "RAS"
    assert surface.triangles.tolist() == [[0, 1, 2], [1, 3, 2]]
    np.testing.assert_array_equal(surface.point_data["lat"], [1, 2, np.nan, 4])
    assert surface.point_data["a"].tolist() == [1, 2, 3, 4]
    assert surface.point_data["b"].tolist() == [[1, 2], [3, 4], [5, 6], [7, 8]]
    assert surface.point_data["shade"].shape == (4, 3)
    assert surface.cell_data["tag"].tolist() == [11, 12]


def test_legacy_vtk_with_bits(tmp_path: Path) -> None:
    polydata = grid(5, 4).to_polydata()
    bits = vtkBitArray()
    bits.SetName("bits")
    for i in range(20):
        bits.InsertNextValue(i % 3 == 0)
    polydata.GetPointData().AddArray(bits)
    for mode in (ASCII, BINARY):
        path = vtk_write(vtkPolyDataWriter(), polydata, tmp_path / "a.vtk", SetFileType=mode)
        assert read_surface(path).point_data["bits"].tolist() == [int(i % 3 == 0) for i in range(20)]


@pytest.mark.parametrize("mode", [ASCII, BINARY])
def test_stl_of_vtk(tmp_path: Path, mode: int) -> None:
    ball = icosphere(30.0, 2)
    path = vtk_write(vtkSTLWriter(), ball.to_polydata(), tmp_path / "a.stl", SetFileType=mode)
    found = read_surface(path)
    assert len(found.points) == len(ball.points)
    assert found.is_manifold and found.genus == 0 and found.boundary_loops == []
    np.testing.assert_allclose(corners(found), corners(ball), rtol=1e-6)


def test_stl_merges_equal_points_only(tmp_path: Path) -> None:
    a, b, c, d = (0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)
    near = (1, np.nextafter(np.float32(0), np.float32(1)), 0)
    facets = [(a, b, c), (b, d, c), (near, d, b)]
    data = b"\0" * 80 + struct.pack("<I", 3)
    data += b"".join(struct.pack("<12fH", 0, 0, 0, *np.ravel(facet), 0) for facet in facets)
    (tmp_path / "a.stl").write_bytes(data)
    found = read_surface(tmp_path / "a.stl")
    assert len(found.points) == 5
    np.testing.assert_array_equal(corners(found), np.reshape(np.float32(facets), (3, 9)))


def test_ply_and_obj_of_vtk_keep_points_in_order(tmp_path: Path) -> None:
    ball = icosphere(30.0, 2)
    paths = [
        vtk_write(vtkPLYWriter(), ball.to_polydata(), tmp_path / f"{mode}.ply", SetFileType=mode)
        for mode in (ASCII, BINARY)
    ]
    for path in [*paths, vtk_write(vtkOBJWriter(), ball.to_polydata(), tmp_path / "a.obj")]:
        found = read_surface(path)
        np.testing.assert_allclose(found.points, ball.points, rtol=1e-6, atol=1e-6)
        np.testing.assert_array_equal(found.triangles, ball.triangles)


def test_points_at_the_same_place_stay_apart_outside_stl(tmp_path: Path) -> None:
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [9, 9, 9]]
    surface = Surface(np.array(points, float), np.array([[0, 1, 2], [3, 4, 5]]))
    for extension in (".vtp", ".vtk", ".ply", ".obj"):
        write_surface(surface, tmp_path / f"a{extension}")
        np.testing.assert_array_equal(read_surface(tmp_path / f"a{extension}").points, surface.points)
    write_surface(surface, tmp_path / "a.stl")
    assert len(read_surface(tmp_path / "a.stl").points) == 4


SQUARE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\n"


@pytest.mark.parametrize(
    "text",
    [
        SQUARE + "f 1 2 3\nf 2 4 3\n",
        SQUARE + "f -4 -3 -2\nf -3 -1 -2",
        "v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 0 1 0 0 1 0\nf 1 2 3\nv 1 1 0 0 0 1\nf -3 -1 -2\n",
        # Another normal or texture point on either side of an edge does not cut the surface.
        "mtllib a.mtl\no left atrium\n" + SQUARE + "vn 0 0 1\nvn 0 1 0\nf 1//1 2//1 3//1\nusemtl b\nf 2//2 4//2 3//2\n",
        SQUARE + "vt 0 0\nvt 1 1\ng a\ns off\nf 1/1/1 2/1/1 3/1/1\nf 2/2/2 4/2/2 3/2/2\n",
        "\tv 0 0 0\r\nv  1.0 0e0 0\r\nv 0 1 0\r\nv 1 1\\\n0\r\nf 1 2 \\\n3\r\nf 2 4 3\r\n",
    ],
)
def test_obj_dialects(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.obj").write_bytes(text.encode())
    surface = read_surface(tmp_path / "a.obj")
    assert surface.points.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]
    assert surface.triangles.tolist() == [[0, 1, 2], [1, 3, 2]]


PLY = "ply\nformat {} 1.0\ncomment SPACE=RAS\nobj_info x\nelement camera 1\nproperty float angle\nelement vertex 4\n"
PLY += "property double z\nproperty float x\nproperty float y\nproperty uchar red\nproperty uchar green\n"
PLY += "property uchar blue\nproperty uchar alpha\nproperty short quality\nelement face 2\n"
PLY += "property float weight\nproperty list uchar uint vertex_index\nproperty list ushort float texcoord\n"
PLY += "property char tag\nelement edge 0\nproperty int a\nend_header\n"
PLY_VERTICES = [(0.1, k % 2, k // 2, 255, k, 0, 128, -k) for k in range(4)]
PLY_FACES = [(0.5, (0, 1, 2), 7), (1.5, (1, 3, 2), 9)]


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_dialects(tmp_path: Path, form: str) -> None:
    header = PLY.format(form).replace("\n", "\r\n" if form == "ascii" else "\n").encode()
    if form == "ascii":
        lines = ["30", *(" ".join(map(str, vertex)) for vertex in PLY_VERTICES)]
        lines += [f"{weight} 3 {a} {b} {c} 6 0 0 1 0 0 1 {tag}" for weight, (a, b, c), tag in PLY_FACES]
        body = "\r\n".join(lines).encode()
    else:
        order = "<" if "little" in form else ">"
        body = struct.pack(f"{order}f", 30)
        body += b"".join(struct.pack(f"{order}dffBBBBh", *vertex) for vertex in PLY_VERTICES)
        for weight, ids, tag in PLY_FACES:
            body += struct.pack(f"{order}fB3IH6fb", weight, 3, *ids, 6, 0, 0, 1, 0, 0, 1, tag)
    (tmp_path / "a.ply").write_bytes(header + body)
    surface = read_surface(tmp_path / "a.ply")
    assert surface.space == "RAS"
    assert surface.points.tolist() == [[0, 0, 0.1], [1, 0, 0.1], [0, 1, 0.1], [1, 1, 0.1]]
    assert surface.triangles.tolist() == [[0, 1, 2], [1, 3, 2]]
    assert surface.point_data["quality"].tolist() == [0, -1, -2, -3]
    assert surface.point_data["RGBA"].tolist() == [[255, k, 0, 128] for k in range(4)]
    assert surface.point_data["RGBA"].dtype == np.uint8
    assert surface.cell_data["weight"].tolist() == [0.5, 1.5]
    assert surface.cell_data["tag"].tolist() == [7, 9]


# ---- axes and units ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("note", "space"),
    [
        ("", "LPS"),
        ("3D Slicer output. SPACE=RAS", "RAS"),
        ("3D Slicer output. SPACE=LPS", "LPS"),
        ("SPACE=LPS SPACE=RAS", "RAS"),
        ("space=ras", "LPS"),
        ("SPACE = RAS", "LPS"),
        ("RAS", "LPS"),
        ("COLOR=abcd,SPACE=RAS,MATERIAL=x", "RAS"),
    ],
)
def test_axes_are_found_as_slicer_finds_them(tmp_path: Path, note: str, space: str) -> None:
    """vtkMRMLModelStorageNode::GetCoordinateSystemFromFileHeader."""
    polydata = grid().to_polydata()
    vtk_write(vtkPolyDataWriter(), polydata, tmp_path / "a.vtk", SetHeader=note or "x")
    vtk_write(vtkSTLWriter(), polydata, tmp_path / "a.stl", SetFileType=ASCII, SetHeader=note)
    vtk_write(vtkSTLWriter(), polydata, tmp_path / "b.stl", SetFileType=BINARY, SetHeader=note)
    vtk_write(vtkPLYWriter(), polydata, tmp_path / "a.ply", AddComment=note)
    (tmp_path / "a.obj").write_text(f"# first\n#{note}\n{SQUARE}f 1 2 3\n")
    for file in sorted(tmp_path.iterdir()):
        assert read_surface(file).space == space, file


def test_axes_in_a_late_comment_of_obj_do_not_count(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text(f"# first\n{SQUARE}# SPACE=RAS\nf 1 2 3\n")
    assert "SPACE" not in (vtk_read(reader := vtkOBJReader(), path) and reader.GetComment())
    assert read_surface(path).space == "LPS"


@pytest.mark.parametrize(("values", "space"), [(["RAS"], "RAS"), (["LPS", "RAS"], "LPS"), (["x"], "LPS"), ([], "LPS")])
def test_axes_of_vtp(tmp_path: Path, values: list[str], space: str) -> None:
    """vtkMRMLModelStorageNode::GetCoordinateSystemFromFieldData: the first value counts."""
    polydata, tag = grid().to_polydata(), vtkStringArray()
    tag.SetName("SPACE")
    for value in values:
        tag.InsertNextValue(value)
    polydata.GetFieldData().AddArray(tag)
    surface = read_surface(vtk_write(vtkXMLPolyDataWriter(), polydata, tmp_path / "a.vtp"))
    assert surface.space == space
    assert "SPACE" not in surface.field_data


def test_numbers_named_space_are_data(tmp_path: Path) -> None:
    polydata, array = grid().to_polydata(), numpy_to_vtk(np.array([1.0, 2.0]), deep=True)
    array.SetName("SPACE")
    polydata.GetFieldData().AddArray(array)
    surface = read_surface(vtk_write(vtkXMLPolyDataWriter(), polydata, tmp_path / "a.vtp"))
    assert surface.space == "LPS"
    assert surface.field_data["SPACE"].tolist() == [1, 2]


@pytest.mark.parametrize(("unit", "factor"), [("1000.000000 mm", 1000), ("1 mm", 1), ("2.5 cm", 25), ("1.0 M", 1000)])
def test_unit_in_the_header_of_obj(tmp_path: Path, unit: str, factor: float) -> None:
    """vtkMRMLModelStorageNode::GetCoordinateUnitScaleFromFileHeader."""
    note = f"# Materialise\n# Vertex coordinates are measured in units, where 1 unit = {unit}\n"
    (tmp_path / "a.obj").write_text(f"{note}{SQUARE}f 1 2 3\n")
    assert read_surface(tmp_path / "a.obj").points.max() == factor


@pytest.mark.parametrize("unit", ["0 mm", "-1 mm", "1 inch", "nan mm", "x mm", "1"])
def test_unknown_unit_in_the_header_of_obj(tmp_path: Path, unit: str) -> None:
    note = f"# vertex coordinates are measured in units, where 1 unit = {unit}\n"
    (tmp_path / "a.obj").write_text(f"{note}{SQUARE}f 1 2 3\n")
    assert f'1 unit is "{unit}' in refusal(tmp_path / "a.obj")


# ---- real atria ----------------------------------------------------------------------------------------------


def test_real_files(data_dir: Path) -> None:
    """Sizes, ranges and arrays as their README states them."""
    atrium = read_surface(data_dir / "frf_demo" / "surface.vtk")
    assert len(atrium.points) == 20000
    assert atrium.boundary_loops == [] and atrium.space == "LPS"
    assert (atrium.point_data["scalars"].min(), atrium.point_data["scalars"].max()) == pytest.approx((25, 133), abs=1)
    np.testing.assert_array_equal(atrium.point_data["scar"] != 0, atrium.point_data["scalars"] >= 101)

    dense = read_surface(data_dir / "eam" / "openep_mesh_2_dense.vtk")
    assert "LAT" in dense.point_data
    assert dense.component_count == 2 and not dense.is_manifold
    # Its own cell normals agree with its triangles: points, triangles and cell arrays are in step.
    corner = dense.points[dense.triangles]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    assert np.median((normal * dense.cell_data["Normals"]).sum(axis=1)) > 0.99
    np.testing.assert_allclose(dense.cell_data["centroid"], corner.mean(axis=1), atol=1e-3)

    cavity = read_surface(data_dir / "frf_demo" / "cavity.vtp")
    flat = read_surface(data_dir / "frf_demo" / "flat_reference.vtp")
    np.testing.assert_array_equal(cavity.triangles, flat.triangles)
    assert set(np.unique(cavity.cell_data["region"])) <= set(range(7))


@pytest.mark.parametrize("name", ["frf_demo/surface.vtk", "eam/openep_mesh_2_dense.vtk"])
def test_real_legacy_files_are_read_as_vtk_reads_them(data_dir: Path, name: str) -> None:
    reader = vtkPolyDataReader()
    reader.ReadAllScalarsOn()
    reader.ReadAllFieldsOn()
    expected = Surface.from_polydata(vtk_read(reader, data_dir / name))
    found = read_surface(data_dir / name)
    np.testing.assert_array_equal(found.points, expected.points)
    np.testing.assert_array_equal(found.triangles, expected.triangles)
    same_arrays(found.point_data, expected.point_data)
    same_arrays(found.cell_data, expected.cell_data)


def test_real_seeds_lie_on_their_atrium(data_dir: Path) -> None:
    atrium = read_surface(data_dir / "frf_demo" / "closed_ostia.vtp")
    seeds = read_seeds(data_dir / "frf_demo" / "seeds_operator1.csv", atrium.space)
    assert list(seeds) == ["RSPV", "RIPV", "LIPV", "LSPV", "LAA", "MV1", "MV2", "MV3", "MV4"]
    assert seeds["RSPV"].tolist() == [174.4390, 190.6760, 74.4098]
    for point in seeds.values():
        assert np.linalg.norm(atrium.points - point, axis=1).min() < 2.0


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_real_atrium_survives_every_format(data_dir: Path, tmp_path: Path, extension: str) -> None:
    cavity = read_surface(data_dir / "frf_demo" / "cavity.vtp")
    write_surface(cavity, tmp_path / f"a{extension}")
    found = read_surface(tmp_path / f"a{extension}")
    assert found.area == pytest.approx(cavity.area, rel=1e-6)
    assert [len(loop) for loop in found.boundary_loops] == [len(loop) for loop in cavity.boundary_loops]


# ---- bad files -----------------------------------------------------------------------------------------------


def test_missing_folder_empty_and_unknown_files(tmp_path: Path) -> None:
    assert "does not exist. Check the name" in refusal(tmp_path / "none.vtp")
    assert "does not exist" in refusal(tmp_path / "no folder" / "none.vtp")
    (tmp_path / "folder.vtp").mkdir()
    assert "is a folder, expected a file of a surface: .vtp, .vtk, .stl, .ply, .obj" in refusal(tmp_path / "folder.vtp")
    for extension in EXTENSIONS:
        (tmp_path / f"empty{extension}").touch()
        assert "is empty" in refusal(tmp_path / f"empty{extension}")
    for name in ("a.mha", "surface", "a.vtp.gz"):
        (tmp_path / name).write_text("x")
        text = refusal(tmp_path / name)
        assert f'has the extension "{Path(name).suffix}", expected a file of a surface: .vtp, .vtk, .stl' in text
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe.vtk")
        assert "not a regular file" in refusal(tmp_path / "pipe.vtk")


@pytest.mark.parametrize("content", [b"hello,\nthis is a text\n" * 50, b"\x00\xff\x80\n" * 300, b"\n", b"solid"])
@pytest.mark.parametrize("extension", EXTENSIONS)
def test_other_content_under_the_name_of_a_surface(tmp_path: Path, extension: str, content: bytes) -> None:
    path = tmp_path / f"a{extension}"
    path.write_bytes(content)
    if extension == ".obj":
        # Nothing marks a text as OBJ; it just has no faces.
        assert "no triangles" in refusal(path, SurfaceError)
    else:
        text = refusal(path)
        assert "Check that it is the right file, or export it again." in text
        expected = {".vtp": "not a VTK XML file", ".vtk": "not a legacy VTK file", ".ply": "not a PLY file"}
        assert expected.get(extension, "cut off") in text


def polydata_xml(tmp_path: Path) -> str:
    path = vtk_write(vtkXMLPolyDataWriter(), grid().to_polydata(), tmp_path / "whole.vtp", SetDataMode=0)
    return path.read_text()


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('type="PolyData"', 'type="UnstructuredGrid"', "it holds UnstructuredGrid, expected PolyData"),
        ('NumberOfPoints="30"', 'NumberOfPoints="30000000000"', "NumberOfPoints is 30000000000, which is impossible"),
        ('NumberOfPoints="30"', f'NumberOfPoints="{"9" * 5000}"', "which is impossible"),
        ('NumberOfPolys="40"', 'NumberOfPolys="-4"', "NumberOfPolys is -4, which is impossible"),
        ('NumberOfPoints="30"', 'NumberOfPoints="31"', "Cannot read points array"),
        ("</Polys>", "</Poly>", "Error parsing XML in stream at line"),
        ("<Piece", "<Peace", "Error parsing XML"),
    ],
)
def test_damaged_vtp(tmp_path: Path, old: str, new: str, expected: str) -> None:
    text = polydata_xml(tmp_path)
    assert old in text
    (tmp_path / "a.vtp").write_text(text.replace(old, new))
    assert expected in refusal(tmp_path / "a.vtp")


@pytest.mark.parametrize("extension", [".vtp", ".vtk", ".stl", ".ply"])
def test_a_file_that_is_cut_off_anywhere_is_refused(tmp_path: Path, extension: str) -> None:
    """Also where VTK's own readers take it for a whole one, print, or end the program."""
    polydata = Surface(sample().points, sample().triangles, cell_data={"tag": np.arange(320)}).to_polydata()
    writers = {".vtp": vtkXMLPolyDataWriter, ".vtk": vtkPolyDataWriter, ".stl": vtkSTLWriter, ".ply": vtkPLYWriter}
    wholes = [tmp_path / f"own{extension}"]
    write_surface(Surface.from_polydata(polydata), wholes[0])
    for mode in (ASCII, BINARY):
        setting = {"SetDataMode": mode - 1} if extension == ".vtp" else {"SetFileType": mode}
        wholes.append(vtk_write(writers[extension](), polydata, tmp_path / f"{mode}{extension}", **setting))
    path = tmp_path / f"cut{extension}"
    boundaries = 0
    for whole in wholes:
        data = whole.read_bytes().rstrip()
        # The last digits of a text could be missing without a trace.
        for length in np.unique(np.linspace(1, len(data) - 30, 61).astype(int)):
            path.write_bytes(data[:length])
            try:
                found = read_surface(path)
            except LAFlatteningError as error:
                assert str(path) in str(error)
                continue
            # Between two sections a legacy file looks whole, with fewer arrays.
            assert extension == ".vtk" and len(found.triangles) == 320 and "tag" not in found.cell_data
            boundaries += 1
    assert boundaries <= 2


def legacy(tmp_path: Path, old: str = "", new: str = "") -> Path:
    """A legacy file, with a part replaced."""
    path = vtk_write(
        vtkPolyDataWriter(), sample().to_polydata(), tmp_path / "a.vtk", SetFileType=ASCII, SetFileVersion=42
    )
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    return path


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("POINTS 162", "POINTS 16200000000000", "cut off in POINTS"),
        ("POINTS 162", "POINTS -162", "make no sense (POINTS has -486 values)"),
        ("POINTS 162", "POINTS many", "make no sense"),
        ("POINTS 162 double", "POINTS 162 complex", "make no sense ('complex')"),
        ("POLYGONS 320", "POLYHEDRA 320", 'unknown section "POLYHEDRA"'),
        ("region 1 320", "region 1 3200000", 'cut off in the array "region"'),
        ("DATASET POLYDATA", "DATASET", "it holds FIELD, expected POLYDATA"),
        ("ASCII", "ascii art", "four lines"),
    ],
)
def test_damaged_legacy_vtk(tmp_path: Path, old: str, new: str, expected: str) -> None:
    assert expected in refusal(legacy(tmp_path, old, new))


def test_array_of_another_length_in_legacy_vtk(tmp_path: Path) -> None:
    path = tmp_path / "a.vtk"
    path.write_text(
        "# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\nPOINTS 3 float\n0 0 0 1 0 0 0 1 0\n"
        "POLYGONS 1 4\n3 0 1 2\nPOINT_DATA 2\nSCALARS lat float\nLOOKUP_TABLE default\n1 2\n"
    )
    assert 'The point array "lat" has 2 entries, expected 3' in refusal(path, SurfaceError)


def test_volume_and_grid_in_vtk(tmp_path: Path) -> None:
    image = vtkImageData()
    image.SetDimensions(3, 3, 3)
    image.AllocateScalars(10, 1)
    path = vtk_write(vtkStructuredPointsWriter(), image, tmp_path / "a.vtk")
    assert "it holds STRUCTURED_POINTS, a volume, expected POLYDATA" in refusal(path)
    mesh = vtkUnstructuredGrid()
    mesh.SetPoints(vtkPoints())
    path = vtk_write(vtkUnstructuredGridWriter(), mesh, tmp_path / "b.vtk")
    assert "it holds UNSTRUCTURED_GRID, expected POLYDATA (in 3D Slicer: export as a model)" in refusal(path)


def test_no_triangles(tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_bytes(b"solid nothing\nendsolid nothing\n")
    (tmp_path / "b.stl").write_bytes(b"\0" * 84)
    (tmp_path / "a.obj").write_text(SQUARE)
    (tmp_path / "a.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
        "property float z\nend_header\n1 2 3\n"
    )
    points = grid().to_polydata()
    points.SetPolys(vtkCellArray())
    vtk_write(vtkXMLPolyDataWriter(), points, tmp_path / "a.vtp")
    vtk_write(vtkPolyDataWriter(), points, tmp_path / "a.vtk")
    for file in sorted(tmp_path.iterdir()):
        assert "no triangles" in refusal(file, SurfaceError)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.obj", SQUARE + "f 1 2 4 3\n"),
        ("b.obj", SQUARE + "f 1 2\n"),
        ("c.obj", SQUARE + "f 1 2 4\nf 1 2 4 3\n"),
        ("a.ply", "4 0 1 3 2\n3 0 1 2\n"),
        ("b.ply", "3 0 1 2\n4 0 1 3 2\n"),
    ],
)
def test_faces_that_are_not_triangles(tmp_path: Path, name: str, text: str) -> None:
    header = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    header += "element face 2\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n"
    (tmp_path / name).write_text(header + text if name.endswith("ply") else text)
    assert "riangulate" in refusal(tmp_path / name, SurfaceError)


def test_quadrilaterals_in_vtk_files(tmp_path: Path) -> None:
    polydata = vtkPolyData()
    points = vtkPoints()
    for x, y in ((0, 0), (1, 0), (1, 1), (0, 1)):
        points.InsertNextPoint(x, y, 0)
    cells = vtkCellArray()
    cells.InsertNextCell(4, [0, 1, 2, 3])
    polydata.SetPoints(points)
    polydata.SetPolys(cells)
    vtk_write(vtkXMLPolyDataWriter(), polydata, tmp_path / "a.vtp")
    vtk_write(vtkPolyDataWriter(), polydata, tmp_path / "a.vtk", SetFileVersion=42)
    vtk_write(vtkPolyDataWriter(), polydata, tmp_path / "b.vtk", SetFileVersion=51)
    cells.InsertNextCell(2, [0, 1])  # as many values as two triangles have
    vtk_write(vtkPolyDataWriter(), polydata, tmp_path / "c.vtk", SetFileVersion=42)
    for file in sorted(tmp_path.iterdir()):
        assert "riangulate" in refusal(file, SurfaceError)


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_coordinates_that_are_not_numbers(tmp_path: Path, extension: str) -> None:
    polydata = grid().to_polydata()
    points = vtk_to_numpy(polydata.GetPoints().GetData()).copy()
    points[7, 1] = np.nan
    polydata.GetPoints().SetData(numpy_to_vtk(points, deep=True))
    path = tmp_path / f"a{extension}"
    if extension == ".obj":
        path.write_text(SQUARE.replace("v 1 0 0", "v 1 nan 0") + "f 1 2 3\n")
    else:
        writers = {".vtp": vtkXMLPolyDataWriter, ".vtk": vtkPolyDataWriter, ".stl": vtkSTLWriter, ".ply": vtkPLYWriter}
        setting = {} if extension == ".vtp" else {"SetFileType": BINARY}
        vtk_write(writers[extension](), polydata, path, **setting)
    text = refusal(path, LAFlatteningError)
    # Newer versions of VTK notice it themselves in an STL file.
    assert "coordinates that are not a number" in text or (extension == ".stl" and "non-finite" in text)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (SQUARE + "v 1 two 3\nf 1 2 3\n", 'line 5 is not a vertex or face of an OBJ file: "v 1 two 3"'),
        (SQUARE + "f a b c\n", "line 5 is not"),
        # There is no point 0; backwards it would be the next one.
        (SQUARE + "f 0 1 2\nv 3 3 3\n", "line 5 is not"),
        ("v 1 2\nf 1 1 1\n", "fewer than three coordinates"),
    ],
)
def test_damaged_obj(tmp_path: Path, text: str, expected: str) -> None:
    (tmp_path / "a.obj").write_text(text)
    assert expected in refusal(tmp_path / "a.obj")


@pytest.mark.parametrize("face", ["f 1 2 5\n", "f -9 1 2\n"])
def test_obj_with_points_that_are_not_there(tmp_path: Path, face: str) -> None:
    (tmp_path / "a.obj").write_text(SQUARE + face)
    assert "refer to point" in refusal(tmp_path / "a.obj", SurfaceError)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("format ascii", "format utf-8"),
        ("format ascii 1.0\n", ""),
        ("element vertex 4", "element vertex four"),
        ("element vertex 4", "element vertices 4"),
        ("property float x", "property half x"),
        ("property float y", "property float x"),
        ("property double z", "property double w"),
        ("element vertex 4", "element vertex -4"),
    ],
)
def test_damaged_ply_header(tmp_path: Path, old: str, new: str) -> None:
    header = PLY.format("ascii")
    assert old in header
    lines = ["30", *(" ".join(map(str, vertex)) for vertex in PLY_VERTICES)]
    lines += [f"{weight} 3 {a} {b} {c} 6 0 0 1 0 0 1 {tag}" for weight, (a, b, c), tag in PLY_FACES]
    (tmp_path / "a.ply").write_text(header.replace(old, new) + "\n".join(lines))
    assert "make no sense" in refusal(tmp_path / "a.ply")


def test_threads_keep_their_errors_apart(tmp_path: Path) -> None:
    """Errors are observed on each reader, not on the one console window that VTK has."""
    good, text = tmp_path / "good.vtp", polydata_xml(tmp_path)
    good.write_text(text)
    bad = []
    for k in range(8):
        bad.append(tmp_path / f"bad{k}.vtp")
        bad[-1].write_text(text[: 400 + 60 * k])

    def outcome(path: Path) -> str:
        try:
            return str(len(read_surface(path).points))
        except InputFileError as error:
            return str(error)

    paths = [path for path in bad for _ in range(10)] + [good] * 80
    with ThreadPoolExecutor(8) as pool:
        outcomes = list(pool.map(outcome, paths))
    for path, found in zip(paths, outcomes, strict=True):
        assert found == "30" if path == good else str(path) in found and "Error parsing XML" in found


# ---- seeds ---------------------------------------------------------------------------------------------------

SEEDS = {"RSPV": np.array([1.5, -2.25, 3.0]), "LAA": np.array([0.1, 1e-9, -300.123456789012]), "MV 1": np.zeros(3)}


def same_seeds(found: dict[str, np.ndarray], expected: dict[str, Any]) -> None:
    assert list(found) == list(expected)
    for label, point in expected.items():
        assert found[label].dtype == np.float64
        assert found[label].tolist() == list(point), label


def seed_file(tmp_path: Path, text: str | bytes, name: str = "seeds.csv") -> Path:
    path = tmp_path / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def seed_error(path: Path, error: type[Exception] = SeedError) -> str:
    with pytest.raises(error) as caught:
        read_seeds(path)
    assert str(path) in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("space", ["LPS", "RAS"])
@pytest.mark.parametrize("name", ["seeds.csv", "SEEDS.MRK.JSON", "seeds.json"])
def test_round_trip_of_seeds(tmp_path: Path, name: str, space: str) -> None:
    write_seeds(SEEDS, tmp_path / name, space)
    same_seeds(read_seeds(tmp_path / name, space), SEEDS)


def test_axes_of_seeds(tmp_path: Path) -> None:
    for space, other in (("LPS", "RAS"), ("RAS", "LPS")):
        write_seeds({"A": np.array([1, 2, 3])}, tmp_path / "a.mrk.json", space)
        assert read_seeds(tmp_path / "a.mrk.json", other)["A"].tolist() == [-1, -2, 3]
        write_seeds({"A": np.array([1, 2, 3])}, tmp_path / "a.csv", space)
        assert read_seeds(tmp_path / "a.csv", other)["A"].tolist() == [1, 2, 3]
    for function in (read_seeds, lambda path, space: write_seeds(SEEDS, path, space)):
        with pytest.raises(ValueError, match='Expected space "LPS" or "RAS", found "RPS"'):
            function(tmp_path / "a.csv", "RPS")


def test_written_markups_are_as_slicer_writes_them(tmp_path: Path) -> None:
    """The fields that vtkMRMLMarkupsJsonStorageNode reads, and its check of the schema's address."""
    write_seeds(SEEDS, tmp_path / "a.mrk.json", "RAS")
    document = json.loads((tmp_path / "a.mrk.json").read_text(encoding="utf-8"))
    assert document["@schema"].startswith("https://raw.githubusercontent.com/slicer/slicer/master/")
    assert document["@schema"].endswith("markups-schema-v1.0.3.json#")
    (markup,) = document["markups"]
    assert (markup["type"], markup["coordinateSystem"], markup["coordinateUnits"]) == ("Fiducial", "RAS", "mm")
    assert [point["label"] for point in markup["controlPoints"]] == list(SEEDS)
    assert [point["id"] for point in markup["controlPoints"]] == ["1", "2", "3"]
    for point in markup["controlPoints"]:
        assert point["position"] == SEEDS[point["label"]].tolist()
        state = {key: point[key] for key in ("selected", "locked", "visibility", "positionStatus")}
        assert state == {"selected": True, "locked": False, "visibility": True, "positionStatus": "defined"}


def test_written_csv(tmp_path: Path) -> None:
    write_seeds({"RSPV": np.array([1, 2.5, -3]), 'a "b", c': np.zeros(3)}, tmp_path / "a.csv")
    with (tmp_path / "a.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["label", "x_mm", "y_mm", "z_mm"]
    assert rows[1:] == [["RSPV", "1.0", "2.5", "-3.0"], ['a "b", c', "0.0", "0.0", "0.0"]]


@pytest.mark.parametrize(
    "text",
    [
        "label,x_mm,y_mm,z_mm\nRSPV,1,2,3\nMV1,-1.5,2e1,.5\n",
        "label,x,y,z\nRSPV,1,2,3\nMV1,-1.5,20,.5",
        "\ufeffLabel, X_mm, Y_mm, Z_mm\r\n\r\n RSPV , 1 , 2 , 3 \r\n\r\nMV1,-1.5,20.,0.5\r\n\r\n",
        "label;x_mm;y_mm;z_mm\nRSPV;1;2;3\nMV1;-1,5;20,0;0,5\n;;;\n",
        'label;x;y;z\n"RSPV";"1";2;3\nMV1;-1.5;20;0.5\n',
        '"label","x_mm","y_mm","z_mm"\n"RSPV",1,2,3\n"MV1",-1.5,20,0.5\n',
        "label,x_mm,y_mm,z_mm,remark\nRSPV,1,2,3\nMV1,-1.5,20,0.5,on the rim\n",
        "label,x_mm,y_mm,z_mm\nRSPV,1,2,3,,\nMV1,-1.5,20,0.5,\n,,,\n",
        "id,z,y,x,label\n1,3,2,1,RSPV\n2,0.5,20,-1.5,MV1\n",
        "label,x_mm,y_mm,z_mm\rRSPV,1,2,3\rMV1,-1.5,20,0.5\r",
        "# by operator 1\nlabel,x_mm,y_mm,z_mm\nRSPV,1,2,3\nMV1,-1.5,+20,0.5\n",
    ],
)
def test_csv_dialects(tmp_path: Path, text: str) -> None:
    same_seeds(read_seeds(seed_file(tmp_path, text)), {"RSPV": [1, 2, 3], "MV1": [-1.5, 20, 0.5]})


@pytest.mark.parametrize(
    ("text", "labels", "expected"),
    [
        ("RSPV,1,2,3\n", (), 'line 1: expected the column names label,x_mm,y_mm,z_mm, found "RSPV,1,2,3"'),
        ("label,x_m,y_m,z_m\nRSPV,1,2,3\n", (), 'found "label,x_m,y_m,z_m"'),
        ("label,x,x_mm,y,z\nRSPV,1,1,2,3\n", (), "expected the column names"),
        ("\n\n \n", (), "expected the column names"),
        ("label,x_mm,y_mm,z_mm\n", (), "holds no placed points"),
        ("label,x,y,z\nRSPV,1,2,3\nMV1,1,2\n", ("MV1",), 'line 3, seed "MV1": z_mm is missing'),
        ("label,x,y,z\nRSPV,1,,3\n", ("RSPV",), 'line 2, seed "RSPV": y_mm is missing'),
        ("label,x,y,z\nRSPV,1,two,3\n", ("RSPV",), 'line 2, seed "RSPV": y_mm is "two". Expected a number (mm)'),
        ("label,x,y,z\n\nRSPV,nan,2,3\n", ("RSPV",), 'line 3, seed "RSPV": x_mm is "nan"'),
        ("label,x,y,z\nRSPV,inf,2,3\n", ("RSPV",), 'x_mm is "inf"'),
        ("label,x,y,z\nRSPV,1e999,2,3\n", ("RSPV",), "expected three finite coordinates"),
        ("label,x,y,z\nRSPV,1_0,2,3\n", ("RSPV",), 'x_mm is "1_0"'),
        ("label,x,y,z\nRSPV,1,5,2,5,3,5\n", ("RSPV",), "7 values, expected 4. Write decimal points, or separate by"),
        ("label;x;y;z\nRSPV;1.234,5;2;3\n", ("RSPV",), 'x_mm is "1.234.5"'),
        ("label,x,y,z\nRSPV,1,2,3\n RSPV ,4,5,6\n", ("RSPV",), 'line 3, seed "RSPV": the label is also that of line 2'),
        ("label,x,y,z\n,1,2,3\n", (), "line 2: the label is empty"),
    ],
)
def test_bad_csv(tmp_path: Path, text: str, labels: tuple[str, ...], expected: str) -> None:
    path = seed_file(tmp_path, text)
    assert expected in seed_error(path)
    with pytest.raises(SeedError) as caught:
        read_seeds(path)
    assert caught.value.labels == labels


def test_seed_files_that_are_none(tmp_path: Path) -> None:
    assert "does not exist" in seed_error(tmp_path / "none.csv", InputFileError)
    assert "is empty" in seed_error(seed_file(tmp_path, ""), InputFileError)
    (tmp_path / "f.csv").mkdir()
    assert "is a folder" in seed_error(tmp_path / "f.csv", InputFileError)
    text = seed_error(seed_file(tmp_path, "x", "seeds.xlsx"), InputFileError)
    assert 'has the extension ".xlsx", expected a file of seeds: .csv, .mrk.json, .json, .fcsv' in text
    assert "UTF-8" in seed_error(seed_file(tmp_path, b"PK\x03\x04\xff\xfe\x00"), InputFileError)
    assert "UTF-8" in seed_error(seed_file(tmp_path, "label,x\n".encode("utf-16")), InputFileError)
    assert "not a text file" in seed_error(seed_file(tmp_path, b"label\x00"), InputFileError)
    assert "line 2 is not CSV" in seed_error(seed_file(tmp_path, 'label,x,y,z\n"a"b,1,2,3'), InputFileError)


def markups(**changes: Any) -> dict[str, Any]:
    """A file as Slicer 5 writes it, with changes to its one list of points."""
    point = {"id": "1", "label": " RSPV ", "description": "", "associatedNodeID": "", "position": [1, 2.5, -3]}
    point |= {"orientation": [-1.0, -0.0, -0.0, -0.0, -1.0, -0.0, 0.0, 0.0, 1.0], "selected": True, "locked": False}
    point |= {"visibility": True, "positionStatus": "defined"}
    empty = {**point, "id": "2", "label": "LAA", "position": "", "positionStatus": "undefined"}
    preview = {**point, "id": "3", "label": "MV1", "positionStatus": "preview"}
    missing = {**point, "id": "4", "label": "RSPV", "positionStatus": "missing"}
    markup = {"type": "Fiducial", "coordinateSystem": "LPS", "coordinateUnits": "mm", "locked": False, "display": {}}
    markup |= {"controlPoints": [point, empty, preview, missing], "measurements": [], **changes}
    address = "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/"
    return {"@schema": f"{address}markups-schema-v1.0.3.json#", "markups": [markup]}


def markups_file(tmp_path: Path, document: Any, name: str = "a.mrk.json") -> Path:
    return seed_file(tmp_path, json.dumps(document), name)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, [1, 2.5, -3]),
        ({"coordinateSystem": "RAS"}, [-1, -2.5, -3]),
        ({"coordinateSystem": "0"}, [-1, -2.5, -3]),
        ({"coordinateSystem": 0}, [-1, -2.5, -3]),
        ({"coordinateSystem": "1"}, [1, 2.5, -3]),
        ({"coordinateSystem": 1}, [1, 2.5, -3]),
        ({"coordinateUnits": ["mm", "UCUM", "millimeter"]}, [1, 2.5, -3]),
        ({"coordinateUnits": "cm"}, [10, 25, -30]),
        ({"coordinateUnits": ["m", "UCUM", "meter"]}, [1000, 2500, -3000]),
        ({"coordinateUnits": "um"}, [0.001, 0.0025, -0.003]),
        ({"type": "Curve"}, [1, 2.5, -3]),
        ({"measurements": [{"name": "length", "value": float("nan")}]}, [1, 2.5, -3]),
    ],
)
def test_markups_of_slicer(tmp_path: Path, changes: dict[str, Any], expected: list[float]) -> None:
    found = read_seeds(markups_file(tmp_path, markups(**changes)))
    assert list(found) == ["RSPV"]
    np.testing.assert_allclose(found["RSPV"], expected, rtol=1e-15)


def test_markups_with_little_in_them(tmp_path: Path) -> None:
    """What the schema allows to leave out: axes (LPS), unit (mm), status (defined)."""
    points = [
        {"label": "A", "position": [1, 2, 3]},
        {"label": "B", "position": [4, 5, 6], "positionStatus": "undefined"},
    ]
    document: dict[str, Any] = {"markups": [{"type": "Fiducial", "controlPoints": points}]}
    same_seeds(read_seeds(markups_file(tmp_path, document)), {"A": [1, 2, 3]})
    # A region of interest or an empty list beside the seeds does not matter.
    document["markups"] += [{"type": "Fiducial"}, {"type": "ROI", "controlPoints": points}]
    same_seeds(read_seeds(markups_file(tmp_path, document), "RAS"), {"A": [-1, -2, 3]})


POINT = {"label": "RSPV", "position": [1, 2, 3]}


@pytest.mark.parametrize(
    ("points", "labels", "expected"),
    [
        (
            [POINT, {**POINT, "position": [4, 5, 6]}],
            ("RSPV",),
            'point 2, seed "RSPV": the label is also that of point 1',
        ),
        ([{**POINT, "label": " "}], (), "point 1: the label is empty"),
        ([{"position": [1, 2, 3]}], (), "point 1: the label is empty"),
        ([{**POINT, "position": [1, 2]}], ("RSPV",), 'point 1, seed "RSPV": expected three finite coordinates'),
        (
            [{**POINT, "position": [1, 2, float("nan")]}],
            ("RSPV",),
            "expected three finite coordinates, found [1, 2, nan]",
        ),
        ([{**POINT, "position": [1, 2, 10**400]}], ("RSPV",), "expected three finite coordinates"),
        ([{**POINT, "position": [1, 2, "3"]}], ("RSPV",), "expected three finite coordinates"),
        ([{**POINT, "position": [1, 2, True]}], ("RSPV",), "expected three finite coordinates"),
        ([{**POINT, "position": ""}], ("RSPV",), "expected three finite coordinates"),
        ([{"label": "RSPV"}], ("RSPV",), "expected three finite coordinates"),
        ([{**POINT, "positionStatus": "placed"}], ("RSPV",), 'unknown positionStatus "placed"'),
        ([{**POINT, "positionStatus": "undefined"}], (), "holds no placed points"),
        ([], (), "holds 0 lists of points (none)"),
    ],
)
def test_bad_points_in_markups(tmp_path: Path, points: list[Any], labels: tuple[str, ...], expected: str) -> None:
    path = markups_file(tmp_path, markups(controlPoints=points))
    with pytest.raises(SeedError) as caught:
        read_seeds(path)
    assert expected in str(caught.value)
    assert caught.value.labels == labels


@pytest.mark.parametrize(
    ("document", "expected"),
    [
        ([], 'it has no list "markups"'),
        ({"holes": {}}, 'it has no list "markups"'),
        ({"markups": [3]}, 'it has no list "markups"'),
        ({**markups(), "@schema": "https://example.org/segments-v2.json"}, 'its "@schema" is "https://example.org'),
        ({**markups(), "@schema": "x/markups-schema-v2.0.0.json#"}, "expected markups-schema-v1"),
        (markups(coordinateSystem="IJK"), 'its coordinate system is "IJK", expected LPS or RAS'),
        (markups(coordinateSystem=None), "its coordinate system is null"),
        (markups(coordinateUnits="inch"), 'its "coordinateUnits" is "inch", expected one of mm, cm, m'),
        (markups(coordinateUnits=[]), 'its "coordinateUnits" is []'),
        (markups(coordinateUnits=None), 'its "coordinateUnits" is null'),
        (markups(controlPoints="many"), "not a list of points"),
        (markups(controlPoints=[1, 2]), "not a list of points"),
    ],
)
def test_bad_markups(tmp_path: Path, document: Any, expected: str) -> None:
    assert expected in seed_error(markups_file(tmp_path, document), InputFileError)


def test_several_lists_of_points(tmp_path: Path) -> None:
    document = markups(name="left")
    document["markups"] += markups(name="right")["markups"]
    assert 'holds 2 lists of points ("left", "right")' in seed_error(markups_file(tmp_path, document))


def test_markups_that_are_no_json(tmp_path: Path) -> None:
    assert "line 1, column 3" in seed_error(seed_file(tmp_path, "{ label", "a.mrk.json"), InputFileError)


FCSV = "# Markups fiducial file version = 4.10\n# CoordinateSystem = {}\n"
FCSV += "# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n"
FCSV += "vtkMRMLMarkupsFiducialNode_0,1,2.5,-3,0,0,0,1,1,1,0,RSPV,,vtkMRMLScalarVolumeNode1\n"
FCSV += 'vtkMRMLMarkupsFiducialNode_1,4,5,6,0,0,0,1,1,1,0,"LAA, ""tip""",,\n'


@pytest.mark.parametrize(("name", "sign"), [("0", -1), ("RAS", -1), ("1", 1), ("LPS", 1)])
def test_fcsv_of_slicer(tmp_path: Path, name: str, sign: int) -> None:
    path = seed_file(tmp_path, FCSV.format(name), "a.fcsv")
    same_seeds(read_seeds(path), {"RSPV": [sign, sign * 2.5, -3], 'LAA, "tip"': [sign * 4, sign * 5, 6]})
    same_seeds(read_seeds(path, "RAS"), {"RSPV": [-sign, -sign * 2.5, -3], 'LAA, "tip"': [-sign * 4, -sign * 5, 6]})


def test_fcsv_without_axes_or_version(tmp_path: Path) -> None:
    """As vtkMRMLMarkupsFiducialStorageNode does: LPS by default, but Slicer 3 files are RAS."""
    text = FCSV.replace("# CoordinateSystem = {}\n", "")
    assert read_seeds(seed_file(tmp_path, text, "a.fcsv"))["RSPV"].tolist() == [1, 2.5, -3]
    text = "# name = F\n# columns = label,x,y,z,sel,vis\nRSPV,1,2.5,-3,1,1\n"
    assert read_seeds(seed_file(tmp_path, text, "a.fcsv"))["RSPV"].tolist() == [-1, -2.5, -3]


def test_fcsv_points_that_are_not_placed(tmp_path: Path) -> None:
    rows = "".join(f"{k},1,2,3,0,0,0,1,1,1,0,P{k},,,{k},0\n" for k in range(4))
    assert list(read_seeds(seed_file(tmp_path, FCSV.format("RAS") + rows, "a.fcsv"))) == ["RSPV", 'LAA, "tip"', "P2"]


def test_bad_fcsv(tmp_path: Path) -> None:
    assert 'its coordinate system is "IJK"' in seed_error(
        seed_file(tmp_path, FCSV.format("IJK"), "a.fcsv"), InputFileError
    )
    text = FCSV.format("LPS").replace("2.5", "x")
    assert 'line 4, seed "RSPV": y is "x"' in seed_error(seed_file(tmp_path, text, "a.fcsv"))
    assert "holds no placed points" in seed_error(seed_file(tmp_path, "# nothing\n", "a.fcsv"))


@pytest.mark.parametrize(
    ("seeds", "expected"),
    [
        ({"A": [1, 2]}, "expected three finite coordinates"),
        ({"A": [1, 2, np.nan]}, "expected three finite coordinates"),
        ({" ": [1, 2, 3]}, "label is empty"),
        ({"A": [1, 2, 3], "A ": [1, 2, 3]}, "the label is also that of point 1"),
    ],
)
def test_seeds_that_cannot_be_written(tmp_path: Path, seeds: dict[str, Any], expected: str) -> None:
    with pytest.raises(SeedError, match=expected):
        write_seeds(seeds, tmp_path / "a.csv")
    assert list(tmp_path.iterdir()) == []


# ---- writing -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("write", [write_surface, write_seeds])
def test_output_that_cannot_be_written(tmp_path: Path, write: Any) -> None:
    content: Any = sample() if write is write_surface else SEEDS
    suffix = ".vtp" if write is write_surface else ".csv"
    (tmp_path / "file").write_text("x")
    (tmp_path / f"folder{suffix}").mkdir()
    for path, expected in [
        (tmp_path / "file" / f"a{suffix}", "is not a folder. Choose or create another folder"),
        (tmp_path / "none" / f"a{suffix}", "does not exist. Choose or create another folder"),
        (tmp_path / "file" / "deeper" / f"a{suffix}", "does not exist"),
        (tmp_path / f"folder{suffix}", "it is not a file"),
        (tmp_path / f"{'x' * 300}{suffix}", "File name too long"),
        (tmp_path / "a.xyz", 'has the extension ".xyz", expected a file of'),
        (tmp_path / "a", 'has the extension "", expected a file of'),
    ]:
        with pytest.raises(InputFileError) as caught:
            write(content, path)
        assert expected in str(caught.value)
        assert str(path) in str(caught.value)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["file", f"folder{suffix}"]


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc, where not even root can write")
def test_folder_that_cannot_be_written_to() -> None:
    with pytest.raises(InputFileError, match="cannot be written"):
        write_surface(sample(), "/proc/self/a.vtp")


@pytest.mark.skipif(sys.platform == "win32", reason="needs limits on file sizes")
@pytest.mark.parametrize("extension", [*EXTENSIONS, ".csv"])
def test_full_disk_leaves_the_old_file(tmp_path: Path, extension: str) -> None:
    path = tmp_path / f"a{extension}"
    path.write_text("the old file")
    script = (
        "import resource, signal, sys, numpy as np\n"
        "from LAFlatteningLib.files import write_seeds, write_surface\n"
        "from LAFlatteningLib.errors import InputFileError\n"
        "from meshes import icosphere\n"
        "path = sys.argv[1]\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))\n"
        "try:\n"
        "    if path.endswith('csv'): write_seeds({f'seed{k}': np.zeros(3) for k in range(1000)}, path)\n"
        "    else: write_surface(icosphere(30.0, 3), path)\n"
        "except InputFileError as error: print(error)\n"
    )
    folders = os.pathsep.join([str(Path(__file__).parent), str(Path(__file__).parents[2])])
    run = subprocess.run(
        [sys.executable, "-c", script, str(path)],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": folders},
    )
    assert f'"{path}" cannot be written' in run.stdout
    assert run.stderr == ""
    assert path.read_text() == "the old file"
    assert list(tmp_path.iterdir()) == [path]


def test_atomic_write_replaces_only_when_done(tmp_path: Path) -> None:
    path = tmp_path / "a.tar.gz"
    with atomic_write(path) as temporary:
        assert temporary.parent == tmp_path and temporary.suffix == ".gz"
        temporary.write_text("new")
        assert not path.exists()
    assert path.read_text() == "new"
    for error in (KeyboardInterrupt, ZeroDivisionError, InputFileError):
        with pytest.raises(error), atomic_write(path) as temporary:
            temporary.write_text("half")
            raise error
    with pytest.raises(InputFileError, match="cannot be written: No space left"), atomic_write(path):
        raise OSError(28, "No space left on device")
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(sys.platform == "win32", reason="file modes and links are those of Unix")
def test_atomic_write_keeps_modes_and_links(tmp_path: Path) -> None:
    (tmp_path / "plain").touch()
    write_text(tmp_path / "new", "x")
    assert (tmp_path / "new").stat().st_mode == (tmp_path / "plain").stat().st_mode
    (tmp_path / "new").chmod(0o640)
    (tmp_path / "link").symlink_to(tmp_path / "new")
    write_text(tmp_path / "link", "è\n")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "new").read_bytes() == "è\n".encode()
    assert (tmp_path / "new").stat().st_mode & 0o777 == 0o640


def test_check_writable(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b" / "c.vtp"
    with pytest.raises(InputFileError, match="does not exist"):
        check_writable(path)
    check_writable(path, make_folder=True)
    assert list(path.parent.iterdir()) == []
    path.write_text("old")
    check_writable(path)
    assert path.read_text() == "old"
    with pytest.raises(InputFileError, match="cannot be written"):
        check_writable(path / "d" / "e.vtp", make_folder=True)
    shutil.rmtree(tmp_path / "a")
