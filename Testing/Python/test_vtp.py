"""VTK's XML files of surfaces: all ways of storing them, against VTK's own reader, and damaged ones."""

from __future__ import annotations

import re
import struct
from base64 import b64encode
from pathlib import Path

import numpy as np
import pytest
from meshes import grid
from surface_files import (
    of_every_kind,
    polydata_xml,
    refusal,
    same_arrays,
    sample,
    silence,
    vtk_read,
    vtk_write,
)
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkBitArray, vtkStringArray
from vtkmodules.vtkCommonDataModel import vtkCellArray
from vtkmodules.vtkCommonExecutionModel import vtkTrivialProducer
from vtkmodules.vtkFiltersSources import vtkSphereSource
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLPolyDataWriter

from LAFlatteningLib.errors import LAFlatteningError
from LAFlatteningLib.files import read_surface
from LAFlatteningLib.surface import Surface

__all__ = ["silence"]


def same_as_vtk(path: Path) -> Surface:
    """What is read, which is exactly what VTK's own reader reads."""
    expected = Surface.from_polydata(vtk_read(vtkXMLPolyDataReader(), path))
    found = read_surface(path)
    np.testing.assert_array_equal(found.points, expected.points)
    np.testing.assert_array_equal(found.triangles, expected.triangles)
    same_arrays(found.point_data, expected.point_data)
    same_arrays(found.cell_data, expected.cell_data)
    same_arrays(found.field_data, expected.field_data)
    return found


@pytest.mark.parametrize("compressor", [0, 1, 2, 3])
@pytest.mark.parametrize("header", [32, 64])
@pytest.mark.parametrize("order", [0, 1])
@pytest.mark.parametrize(("mode", "encode"), [(0, 1), (1, 1), (2, 0), (2, 1)])
def test_every_way_of_storing_values(
    tmp_path: Path, mode: int, encode: int, order: int, header: int, compressor: int
) -> None:
    polydata = of_every_kind()
    # VTK leaves it to its users to make names fit for XML.
    for data in (polydata.GetPointData(), polydata.GetCellData()):
        data.GetAbstractArray('100 %\t"odd" näme').SetName("&lt;odd&gt; näme")
    path = vtk_write(
        vtkXMLPolyDataWriter(),
        polydata,
        tmp_path / "a.vtp",
        SetDataMode=mode,
        SetEncodeAppendedData=encode,
        SetByteOrder=order,
        SetHeaderType=header,
        SetCompressorType=compressor,
        # Several blocks, of which the last is shorter.
        SetBlockSize=4096,
    )
    found = same_as_vtk(path)
    assert len(found.point_data) == 20 and found.point_data["<odd> näme"].shape == (20, 2)
    assert found.cell_data["type int32"].shape == (24,)
    assert found.field_data["note"].tolist() == ["method: regional"]


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_bits(tmp_path: Path, mode: int) -> None:
    polydata, bits = grid(5, 4).to_polydata(), vtkBitArray()
    bits.SetName("bits")
    for i in range(20):
        bits.InsertNextValue(i % 3 == 0)
    polydata.GetPointData().AddArray(bits)
    path = vtk_write(vtkXMLPolyDataWriter(), polydata, tmp_path / "a.vtp", SetDataMode=mode)
    assert read_surface(path).point_data["bits"].tolist() == [int(i % 3 == 0) for i in range(20)]


def test_several_pieces(tmp_path: Path) -> None:
    ball = vtkSphereSource()
    ball.SetThetaResolution(24)
    writer = vtkXMLPolyDataWriter()
    writer.SetInputConnection(ball.GetOutputPort())
    writer.SetNumberOfPieces(4)
    writer.SetFileName(str(tmp_path / "a.vtp"))
    assert writer.Write()
    text = (tmp_path / "a.vtp").read_bytes()
    assert text.count(b"<Piece") == 4
    assert "Normals" in same_as_vtk(tmp_path / "a.vtp").point_data


def array(name: str, values: str, form: str = 'format="ascii"', kind: str = "Int32") -> str:
    return f'<DataArray type="{kind}" Name="{name}" {form}>{values}</DataArray>'


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("<VTKFile ", "<VTKFile xmlns='VTK' "),
        (' format="ascii"', ""),
        ('format="ascii"', 'format="ASCII"'),
        ('NumberOfComponents="3"', 'NumberOfComponents="   3"'),
        # A process of a parallel program that had no part of the surface.
        ("</Piece>", '</Piece><Piece NumberOfPoints="0" NumberOfPolys="0"></Piece>'),
        # A piece of points only has no cell arrays.
        (
            "</Piece>",
            '</Piece><Piece NumberOfPoints="1"><PointData>'
            f'{array("one", "1")}</PointData><Points><DataArray type="Float64" NumberOfComponents="3" format="ascii">'
            "5 5 5</DataArray></Points></Piece>",
        ),
    ],
)
def test_what_other_programs_write(tmp_path: Path, old: str, new: str) -> None:
    text = polydata_xml(tmp_path)
    text = text.replace("<PointData>", "<PointData>" + array("one", "1 " * 30))
    text = text.replace("<CellData>", "<CellData>" + array("two", "2 " * 40))
    assert old in text
    (tmp_path / "a.vtp").write_text(text.replace(old, new))
    found = same_as_vtk(tmp_path / "a.vtp")
    assert set(found.point_data) == {"one"} and found.cell_data["two"].tolist() == [2] * 40


@pytest.mark.parametrize(("header", "size"), [("UInt32", "<I"), ("UInt64", "<Q")])
@pytest.mark.parametrize("appended", [False, True])
def test_a_header_that_is_encoded_by_itself(tmp_path: Path, header: str, size: str, appended: bool) -> None:
    """As VTK does not write it, but reads it."""
    text = polydata_xml(tmp_path).replace('header_type="UInt32"', f'header_type="{header}"')
    values = (b64encode(struct.pack(size, 30)) + b64encode(bytes(range(30)))).decode()
    form = 'format="appended" offset="0"' if appended else 'format="binary"'
    text = text.replace("<PointData>", "<PointData>" + array("tag", "" if appended else values, form, "UInt8"))
    if appended:
        text = text.replace("</VTKFile>", f'<AppendedData encoding="base64">\n_{values}\n</AppendedData></VTKFile>')
    (tmp_path / "a.vtp").write_text(re.sub(' compressor="[^"]*"', "", text))
    assert same_as_vtk(tmp_path / "a.vtp").point_data["tag"].tolist() == list(range(30))


def test_appended_values_without_their_underscore(tmp_path: Path) -> None:
    text = polydata_xml(tmp_path)
    values = b64encode(struct.pack("<I", 30) + bytes(range(30))).decode()
    text = text.replace("<PointData>", "<PointData>" + array("tag", "", 'format="appended" offset="0"', "UInt8"))
    text = text.replace("</VTKFile>", f'<AppendedData encoding="base64">{values}</AppendedData></VTKFile>')
    (tmp_path / "a.vtp").write_text(re.sub(' compressor="[^"]*"', "", text))
    assert read_surface(tmp_path / "a.vtp").point_data["tag"].tolist() == list(range(30))


def test_the_first_of_several_time_steps(tmp_path: Path) -> None:
    polydata, producer, writer = grid().to_polydata(), vtkTrivialProducer(), vtkXMLPolyDataWriter()
    producer.SetOutput(polydata)
    writer.SetInputConnection(producer.GetOutputPort())
    writer.SetFileName(str(tmp_path / "a.vtp"))
    writer.SetNumberOfTimeSteps(3)
    writer.Start()
    for step in range(3):
        for data, count in ((polydata.GetPointData(), 30), (polydata.GetCellData(), 40)):
            data.Initialize()
            values = numpy_to_vtk(np.full(count, step), deep=True)
            values.SetName("step")
            data.AddArray(values)
        polydata.GetPoints().SetPoint(0, -step, 0, 0)
        polydata.GetPoints().Modified()
        polydata.SetPolys(vtkCellArray())
        for triangle in np.roll(grid().triangles, step, axis=0):
            polydata.GetPolys().InsertNextCell(3, triangle)
        producer.Modified()
        writer.WriteNextTime(float(step))
    writer.Stop()
    assert (tmp_path / "a.vtp").read_bytes().count(b'TimeStep="2"') > 3
    found = read_surface(tmp_path / "a.vtp")
    np.testing.assert_array_equal(found.points, grid().points)
    np.testing.assert_array_equal(found.triangles, grid().triangles)
    assert not found.point_data["step"].any() and not found.cell_data["step"].any()


def test_of_arrays_with_the_same_name_the_first_is_read(tmp_path: Path) -> None:
    text = polydata_xml(tmp_path)
    text = text.replace("<PointData>", "<PointData>" + array("tag", "1 " * 30) + array("tag", "2 " * 30))
    (tmp_path / "a.vtp").write_text(text)
    assert read_surface(tmp_path / "a.vtp").point_data["tag"].tolist() == [1] * 30


@pytest.mark.parametrize(
    ("codes", "expected"), [("195 169 0", "é"), ("-61 -87 0", "é"), ("65 233 0", "A\N{REPLACEMENT CHARACTER}")]
)
def test_letters_as_numbers(tmp_path: Path, codes: str, expected: str) -> None:
    """Where C's char has no sign, VTK writes 195 rather than -61; and a label in another code is no damage."""
    text = polydata_xml(tmp_path)
    note = f'<FieldData><Array type="String" Name="note" NumberOfTuples="1" format="ascii">{codes}</Array></FieldData>'
    (tmp_path / "a.vtp").write_text(text.replace("<Piece", note + "<Piece"))
    assert read_surface(tmp_path / "a.vtp").field_data["note"].tolist() == [expected]


def test_arrays_that_only_some_pieces_have_are_left_out(tmp_path: Path) -> None:
    text = polydata_xml(tmp_path)
    start, end = text.index("<Piece"), text.index("</Piece>") + len("</Piece>")
    extra = '<DataArray type="Int32" Name="tag" format="ascii">' + "7 " * 30 + "</DataArray>"
    piece = text[start:end]
    more = piece.replace("<PointData>", "<PointData>" + extra)
    assert more != piece
    (tmp_path / "a.vtp").write_text(text[:start] + more + piece + text[end:])
    found = read_surface(tmp_path / "a.vtp")
    assert len(found.points) == 60 and found.triangles.max() == 59 and "tag" not in found.point_data
    (tmp_path / "a.vtp").write_text(text[:start] + more + more + text[end:])
    assert read_surface(tmp_path / "a.vtp").point_data["tag"].tolist() == [7] * 60


def test_a_piece_with_the_points_of_another(tmp_path: Path) -> None:
    text = polydata_xml(tmp_path)
    start, end = text.index("<Piece"), text.index("</Piece>") + len("</Piece>")
    polys = text.index('Name="connectivity"', text.index("<Polys>"))
    polys = text.index(">", polys) + 1
    first = re.compile(r"\s*\d+").match(text, polys)
    for number in (30, -1):
        wrong = text[start:polys] + f"\n{number}" + text[first.end() : end]
        (tmp_path / "a.vtp").write_text(text[:start] + wrong + text[start:])
        assert "its polygons refer to other points than 0 to 29" in refusal(tmp_path / "a.vtp")


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('type="PolyData"', 'type="UnstructuredGrid"', "it holds UnstructuredGrid, expected PolyData"),
        ('NumberOfPoints="30"', 'NumberOfPoints="30000000000"', "90 values, expected 90000000000"),
        ('NumberOfPoints="30"', f'NumberOfPoints="{"9" * 5000}"', "make no sense"),
        ('NumberOfPoints="30"', 'NumberOfPoints="-30"', "the array of points has -90 values"),
        ('NumberOfPoints="30"', 'NumberOfPoints="thirty"', "make no sense"),
        ('NumberOfPoints="30"', 'NumberOfPoints="31"', "90 values, expected 93"),
        ('NumberOfPolys="40"', 'NumberOfPolys="-4"', "the offsets of the polygons has -4 values"),
        ('NumberOfPolys="40"', 'NumberOfPolys="41"', "40 values, expected 41"),
        ('NumberOfComponents="3"', 'NumberOfComponents="2"', "its points have 2 coordinates, expected 3"),
        ('byte_order="LittleEndian"', 'byte_order="Middle"', "byte_order is Middle, expected LittleEndian, BigEndian"),
        ('compressor="vtkZLibDataCompressor"', 'compressor="mine"', "compressor is mine, expected vtkZLib"),
        ('header_type="UInt32"', 'header_type="Int8"', "header_type is Int8, expected UInt32, UInt64"),
        ('type="Float64"', 'type="Complex"', 'has the type "Complex"'),
        ('format="ascii"', 'format="morse"', 'has the format "morse"'),
        ('Name="offsets"', 'Name="onsets"', "no arrays offsets and connectivity"),
        ("</Polys>", "</Poly>", "it is damaged (XML: mismatched tag: line"),
        ("<Piece", "<Peace", "it is damaged (XML:"),
        ("</VTKFile>", "", "it is cut off (XML: no element found: line"),
        (
            '<?xml version="1.0"?>',
            '<?xml version="1.0" encoding="mine"?>',
            "unknown encoding: mine",
        ),
        (
            '<?xml version="1.0"?>',
            '<?xml version="1.0" encoding="shift_jis"?>',
            "in an unknown encoding",
        ),
        ('<?xml version="1.0"?>', '<!DOCTYPE a [<!ENTITY b "c">]>', "declares a document type"),
    ],
)
def test_damaged_vtp(tmp_path: Path, old: str, new: str, expected: str) -> None:
    text = polydata_xml(tmp_path)
    assert old in text
    (tmp_path / "a.vtp").write_text(text.replace(old, new))
    assert expected in refusal(tmp_path / "a.vtp")


def test_what_is_not_a_number_is_not_repeated_at_length(tmp_path: Path) -> None:
    text = polydata_xml(tmp_path).replace("<PointData>", "<PointData>" + array("tag", "x" * 100000, kind="Float32"))
    (tmp_path / "a.vtp").write_text(text)
    assert len(refusal(tmp_path / "a.vtp")) < 500 + len(str(tmp_path))


def test_texts_in_which_raw_data_are_hard_to_find(tmp_path: Path) -> None:
    text = polydata_xml(tmp_path)
    for hard in ("<AppendedData " * 20000, "<AppendedData " + 'encoding="raw"' * 20000 + ">" + " " * 50000):
        (tmp_path / "a.vtp").write_text(text.replace("<PolyData>", f"<!-- {hard} --><PolyData>"))
        assert len(read_surface(tmp_path / "a.vtp").points) == 30


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


@pytest.mark.parametrize("compressor", [0, 1, 2, 3])
@pytest.mark.parametrize(("mode", "encode"), [(0, 1), (1, 1), (2, 0), (2, 1)])
def test_randomly_damaged_files_end_in_an_error_or_a_surface(
    tmp_path: Path, mode: int, encode: int, compressor: int
) -> None:
    """Bytes changed, left out or repeated, numbers made others; each is an error of ours, none ends the program."""
    whole = vtk_write(
        vtkXMLPolyDataWriter(),
        grid().to_polydata(),
        tmp_path / "whole.vtp",
        SetDataMode=mode,
        SetEncodeAppendedData=encode,
        SetCompressorType=compressor,
    ).read_bytes()
    chance = np.random.default_rng(4 * mode + compressor)
    refused = 0
    for number in range(120):
        data = bytearray(whole)
        for _ in range(chance.integers(1, 4)):
            place, length = int(chance.integers(len(data))), int(chance.integers(1, 60))
            if number % 4 == 0:
                data[place] = chance.integers(256)
            elif number % 4 == 1:
                del data[place : place + length]
            elif number % 4 == 2:
                data[place:place] = data[place : place + length]
            else:
                numbers = list(re.finditer(rb'"(\d+)"', bytes(data)))
                chosen = numbers[chance.integers(len(numbers))]
                other = chance.choice([0, 1, int(chosen[1]) + 1, 100 * int(chosen[1]), 2**31, 2**62])
                data[chosen.start(1) : chosen.end(1)] = str(other).encode()
        path = tmp_path / "damaged.vtp"
        path.write_bytes(data)
        try:
            read_surface(path)
        except LAFlatteningError as error:
            assert str(path) in str(error)
            refused += 1
    assert refused > 60


@pytest.mark.parametrize("compressor", [1, 2, 3])
def test_packed_blocks_that_do_not_hold_what_they_should(tmp_path: Path, compressor: int) -> None:
    path = vtk_write(
        vtkXMLPolyDataWriter(),
        sample().to_polydata(),
        tmp_path / "a.vtp",
        SetEncodeAppendedData=0,
        SetCompressorType=compressor,
    )
    whole = path.read_bytes()
    first = whole.index(b"_", whole.index(b"<AppendedData")) + 1
    # The header: number of blocks, size of a block, size of the last, then the packed size of each.
    blocks, full, last, packed = struct.unpack_from("<4I", whole, first)
    assert blocks == 1
    for number, words in enumerate(
        [
            (blocks, full, last, packed - 9),
            (blocks, full, last + 8, packed),
            (2**31, full, last, packed),
            (blocks, 2**31, 0, packed),
            (blocks, full, last, 2**31),
        ]
    ):
        path.write_bytes(whole[:first] + struct.pack("<4I", *words) + whole[first + 16 :])
        assert "cannot be read" in refusal(path), number
