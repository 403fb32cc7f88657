"""Files: round trips, files of other programs, real atria, and every kind of bad file with its message."""

from __future__ import annotations

import os
import shutil
import struct
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from meshes import grid, icosphere
from surface_files import (
    ASCII,
    BINARY,
    EXTENSIONS,
    SQUARE,
    corners,
    of_every_kind,
    refusal,
    same_arrays,
    sample,
    silence,
    vtk_read,
    vtk_write,
)
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkBitArray, vtkPoints
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

from LAFlatteningLib.errors import InputFileError, LAFlatteningError, SurfaceError
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

__all__ = ["silence"]


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
    good = vtk_write(vtkSTLWriter(), grid().to_polydata(), tmp_path / "good.stl", SetFileType=ASCII)
    bad = []
    for k in range(8):
        bad.append(tmp_path / f"bad{k}.stl")
        bad[-1].write_text(good.read_text().replace("vertex", "vertex x", k + 1))

    def outcome(path: Path) -> str:
        try:
            return str(len(read_surface(path).points))
        except InputFileError as error:
            return str(error)

    paths = [path for path in bad for _ in range(10)] + [good] * 80
    with ThreadPoolExecutor(8) as pool:
        outcomes = list(pool.map(outcome, paths))
    for path, found in zip(paths, outcomes, strict=True):
        assert found == "30" if path == good else str(path) in found and "STLReader" in found


# ---- writing -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("write", [write_surface, write_seeds])
def test_output_that_cannot_be_written(tmp_path: Path, write: Any) -> None:
    content: Any = sample() if write is write_surface else {"RSPV": np.zeros(3)}
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
