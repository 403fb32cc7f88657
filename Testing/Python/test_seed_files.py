"""Files of seeds: round trips, those of Slicer, dialects of CSV, and every kind of bad file with its message."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from surface_files import (
    silence,
)

from LAFlatteningLib.errors import InputFileError, SeedError
from LAFlatteningLib.files import (
    read_seeds,
    write_seeds,
)

__all__ = ["silence"]


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
