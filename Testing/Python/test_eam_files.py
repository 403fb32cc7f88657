"""Electroanatomical maps: CARTO 3 and OpenEP files written here, two real ones, and damaged ones."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import meshes
import numpy as np
import pytest
from scipy.io import savemat

from LAFlatteningLib.errors import InputFileError, LAFlatteningError, SurfaceError
from LAFlatteningLib.files import read_surface, write_surface
from LAFlatteningLib.quantities import KNOWN_UNITS, unit_of
from LAFlatteningLib.remeshing import remesh
from LAFlatteningLib.surface import Surface

NO_VALUE = -10000.0


def chamber() -> Surface:
    """A sphere of 30 mm with a hole, in LPS: the hole is at its front (anterior)."""
    ball = meshes.icosphere(30.0, 3)
    part, _ = ball.submesh(ball.points[ball.triangles].mean(axis=1)[:, 1] > -25.0)
    return Surface(part.points + np.array([20.0, -100.0, -40.0]), part.triangles)


def to_carto(points: np.ndarray) -> np.ndarray:
    """LPS to the axes of CARTO: to the left, up, to the front."""
    x, y, z = points.T
    return np.stack([x, z, -y], axis=1)


def carto_text(
    surface: Surface,
    colours: dict[str, np.ndarray] | None = None,
    extra: np.ndarray | None = None,
    point_group: np.ndarray | None = None,
    triangle_group: np.ndarray | None = None,
    visible: str | None = "0",
    marks: np.ndarray | None = None,
) -> str:
    """A CARTO 3 file, as CARTO writes it."""
    n, m = len(surface.points), len(surface.triangles)
    colours = colours or {}
    point_group = np.zeros(n) if point_group is None else point_group
    triangle_group = np.zeros(m) if triangle_group is None else triangle_group
    lines = ["#TriangulatedMeshVersion2.0", "; Biosense Webster Triangulated Mesh file format, 2008 ©", ""]
    lines += ["[GeneralAttributes]", "MeshID = -1", "MeshName               = ", f"NumVertex = {n}"]
    lines += [f"NumTriangle            = {m}", "; ----", *([f"VisibleGroupsIDs = {visible}"] if visible else [])]
    lines += [f"NumVertexColors = {len(colours)}", f"ColorsNames = {'  '.join(colours)}  ", "", "[VerticesSection]"]
    lines += ["; X Y Z NormalX NormalY NormalZ GroupID", ""]
    rows = np.column_stack([to_carto(surface.points), to_carto(surface.point_normals), point_group])
    lines += [f"{k} = " + " ".join(f"{x:.9g}" for x in row) for k, row in enumerate(rows)]
    lines += ["", "[TrianglesSection]", "; Vertex0  Vertex1  Vertex2 NormalX NormalY NormalZ GroupID", ""]
    lines += [
        f"{k} = {a} {b} {c} 0 0 1 {g:.0f}"
        for k, ((a, b, c), g) in enumerate(zip(surface.triangles, triangle_group, strict=True))
    ]
    columns = [*colours.values(), *([extra] if extra is not None else [])]
    if columns:
        lines += ["", "[VerticesColorsSection]", "; Color Value= -10000 indicates invalid data", ""]
        lines += [f"{k} = " + " ".join(f"{x:.9g}" for x in row) for k, row in enumerate(np.column_stack(columns))]
    if marks is not None:
        lines += ["", "[VerticesAttributesSection]", ";            Scar   EML          CoScar CoEML", "; Scar=0: no"]
        lines += [f"{k} = {a} {b} 0 0" for k, (a, b) in enumerate(marks)]
    return "\r\n".join(lines) + "\r\n"


def write_carto(path: Path, *arguments: Any, **options: Any) -> Path:
    path.write_bytes(carto_text(*arguments, **options).encode("latin-1"))
    return path


def openep_data(surface: Surface, system: str | None = None) -> dict[str, Any]:
    """What OpenEP keeps of a map: userdata."""
    n = len(surface.points)
    z = surface.points[:, 2]
    tables = {
        "act_bip": np.column_stack([10.0 * z, np.where(z > np.median(z), np.nan, 0.5)]),
        "uni_imp_frc": np.column_stack([z + 1.0, np.where(np.arange(n) == 3, NO_VALUE, 120.0 + z), np.full(n, np.nan)]),
        "isVertexAtRim": np.zeros((n, 1), bool),
    }
    tri_rep = {"X": to_carto(surface.points), "Triangulation": surface.triangles + 1.0}
    data: dict[str, Any] = {"surface": {"triRep": tri_rep, **tables}, "notes": np.array(["made by a test"], object)}
    return data if system is None else {**data, "systemName": system}


def save_matlab_5(path: Path, userdata: dict[str, Any]) -> None:
    savemat(path, {"userdata": userdata}, do_compression=True)


def save_matlab_73(path: Path, userdata: dict[str, Any]) -> None:
    """As MATLAB does: a block of 512 bytes, then HDF5 with rows as columns and text as numbers."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:

        def put(group: Any, content: dict[str, Any]) -> None:
            for name, value in content.items():
                if isinstance(value, dict):
                    put(group.create_group(name), value)
                elif isinstance(value, str):
                    group[name] = np.array([[ord(letter)] for letter in value], np.uint16)
                elif value.dtype == object:
                    continue
                elif value.size == 0:
                    group[name] = np.array(value.shape, np.uint64)
                    group[name].attrs["MATLAB_empty"] = np.uint8(1)
                else:
                    group[name] = value.T.astype(np.uint8) if value.dtype == bool else value.T

        put(file.create_group("userdata"), userdata)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512, b" "))


SAVE = {"MATLAB 5": save_matlab_5, "MATLAB 7.3": save_matlab_73}


@pytest.fixture(params=SAVE, ids=list(SAVE))
def save(request) -> Callable[[Path, dict[str, Any]], None]:
    return SAVE[request.param]


def refusal(path: Path, kind: type[LAFlatteningError] = InputFileError) -> str:
    with pytest.raises(kind) as caught:
        read_surface(path)
    assert path.name in str(caught.value)
    return str(caught.value)


# ---- CARTO ----


def test_carto_map_is_read_in_patient_axes_with_missing_values(tmp_path):
    surface = chamber()
    z = surface.points[:, 2]
    voltage = np.where(np.arange(len(z)) % 5 == 0, NO_VALUE, 0.1 * z)
    colours = {"Unipolar": z + 500, "Bipolar": voltage, "LAT": -z, "A2-A1": np.full(len(z), NO_VALUE)}
    marks = np.column_stack([z > -40, np.zeros(len(z))]).astype(int)
    path = write_carto(tmp_path / "1-LA.MESH", surface, colours, marks=marks)
    found = read_surface(path)
    assert found.space == "LPS"
    np.testing.assert_allclose(found.points, surface.points, atol=1e-6)
    np.testing.assert_array_equal(found.triangles, surface.triangles)
    assert found.enclosed_volume > 0
    # Measured nowhere: left out, as are marks that nothing has.
    assert set(found.point_data) == {"Unipolar", "Bipolar", "LAT", "Scar"}
    np.testing.assert_allclose(found.point_data["Unipolar"], z + 500, atol=1e-5)
    np.testing.assert_allclose(found.point_data["Bipolar"], np.where(voltage == NO_VALUE, np.nan, voltage), atol=1e-6)
    np.testing.assert_array_equal(found.point_data["Scar"], z > -40)


def test_no_value_in_surface_files_is_no_voltage(tmp_path):
    surface = chamber()
    voltage = np.where(np.arange(len(surface.points)) % 5 == 0, NO_VALUE, 1.5)
    arrays = {"Bipolar voltage": voltage, "LAT": voltage.astype(np.int32), "depth": voltage}
    write_surface(surface.with_data(arrays, {"Unipolar": np.full(len(surface.triangles), 2.0)}), tmp_path / "a.vtk")
    found = read_surface(tmp_path / "a.vtk")
    for name in ("Bipolar voltage", "LAT"):
        np.testing.assert_array_equal(np.isnan(found.point_data[name]), voltage == NO_VALUE)
        assert np.nanmin(found.point_data[name]) == pytest.approx(1.5, abs=0.5)
    # Of what is no quantity of a mapping system nothing is known, and what has all its values stays as it was.
    np.testing.assert_array_equal(found.point_data["depth"], voltage)
    assert found.cell_data["Unipolar"].min() == 2.0


def test_columns_of_one_name_do_not_hide_each_other(tmp_path):
    surface = chamber()
    rising, falling = np.arange(float(len(surface.points))), -np.arange(float(len(surface.points)))
    path = write_carto(tmp_path / "twice.mesh", surface, {"Bipolar": rising, "Other": falling})
    path.write_bytes(path.read_bytes().replace(b"Bipolar  Other", b"Bipolar  Bipolar"))
    found = read_surface(path)
    assert np.allclose(found.point_data["Bipolar"], rising)
    assert np.allclose(found.point_data["Bipolar_2"], falling)


def test_carto_leaves_out_what_is_not_shown(tmp_path):
    surface = meshes.icosphere(30.0, 3)
    centre = surface.points[surface.triangles].mean(axis=1)
    # Cut away and transparent; replaced by finer ones; and a point that is no part of the surface.
    group = np.where(centre[:, 2] > 25, -4.0, 0.0)
    group[centre[:, 2] < -25] = -1000000.0
    points = np.zeros(len(surface.points))
    points[surface.points[:, 0].argmax()] = -1000000
    shown = (group == 0) & (points[surface.triangles] == 0).all(axis=1)
    number = np.arange(len(points), dtype=float)
    path = write_carto(
        tmp_path / "a.mesh", surface, {"Bipolar": number}, point_group=points, triangle_group=group, visible="0 1"
    )
    found = read_surface(path)
    expected, ids = surface.submesh(shown)
    np.testing.assert_array_equal(found.triangles, expected.triangles)
    np.testing.assert_array_equal(found.point_data["Bipolar"], ids)
    assert len(found.boundary_loops) == 3
    # Groups that are listed are shown even below 0; without a list, those from 0 on.
    assert len(
        read_surface(write_carto(tmp_path / "b.mesh", surface, triangle_group=group, visible="-4 0")).triangles
    ) > (len(found.triangles))
    found = read_surface(write_carto(tmp_path / "c.mesh", surface, triangle_group=group, visible=None))
    assert len(found.triangles) == np.count_nonzero(group == 0)


def test_carto_columns_without_a_name_and_maps_without_colours(tmp_path):
    surface = chamber()
    z = surface.points[:, 2]
    found = read_surface(write_carto(tmp_path / "a.mesh", surface, {"Bipolar": z}, extra=2 * z))
    assert list(found.point_data) == ["Bipolar", "unnamed_1"]
    np.testing.assert_allclose(found.point_data["unnamed_1"], 2 * z, atol=1e-5)
    assert read_surface(write_carto(tmp_path / "b.mesh", surface)).point_data == {}
    nothing = read_surface(write_carto(tmp_path / "c.mesh", surface, {"Bipolar": np.full(len(z), NO_VALUE)}))
    assert nothing.point_data == {}


def test_bad_carto_files_are_refused_in_words(tmp_path):
    surface = chamber()
    n, m = len(surface.points), len(surface.triangles)
    text = carto_text(surface, {"Bipolar": surface.points[:, 2], "LAT": surface.points[:, 0]})
    path = tmp_path / "a.mesh"

    def refused(changed: str, kind: type[LAFlatteningError] = InputFileError) -> str:
        assert changed != text
        path.write_bytes(changed.encode("latin-1"))
        return refusal(path, kind)

    assert "is not a CARTO 3 map" in refused("MeshVersionFormatted 2\nDimension 3\n")
    assert "cut off in [VerticesSection]" in refused(text[: text.index("[TrianglesSection]") // 2])
    assert "no section [TrianglesSection]" in refused(text[: text.index("[TrianglesSection]")])
    assert f"cut off in [TrianglesSection] ({m - 1} lines of {m})" in refused(
        text[: text.index(f"{m - 1} = ", text.index("[TrianglesSection]"))]
    )
    cut = text.index("[VerticesColorsSection]") + 200
    assert "cut off in [VerticesColorsSection]" in refused(text[:cut])
    assert 'NumVertex is "", expected a number' in refused(text.replace(f"NumVertex = {n}", ""))
    assert "NumVertex is" in refused(text.replace(f"NumVertex = {n}", "NumVertex = -3"))
    assert f"not numbered 0 to {n - 2}" in refused(text.replace(f"NumVertex = {n}", f"NumVertex = {n - 1}"))
    assert "[VerticesSection] is not a table of numbers" in refused(re.sub(r"\n5 = \S+", "\n5 = ###", text, count=1))
    assert "has 1 columns, expected 2" in refused(
        text[: cut - 200] + re.sub(r"(?m)^(\d+ = \S+) \S+", r"\1", text[cut - 200 :])
    )
    assert f"Triangles refer to point {n + 7}" in refused(
        re.sub(r"(?s)(\[TrianglesSection\].*?\n3 = )\d+", rf"\g<1>{n + 7}", text), SurfaceError
    )
    assert "no whole numbers" in refused(re.sub(r"(?s)(\[TrianglesSection\].*?\n3 = )\d+", r"\g<1>2.5", text))
    hidden = carto_text(surface, triangle_group=np.full(m, -4.0))
    assert f"None of its {m} triangles is visible" in refused(hidden, SurfaceError)


# ---- OpenEP ----


def test_openep_map_is_read_in_patient_axes_with_missing_values(tmp_path, save):
    surface = chamber()
    save(tmp_path / "a.mat", openep_data(surface))
    found = read_surface(tmp_path / "a.mat")
    assert found.space == "LPS"
    np.testing.assert_allclose(found.points, surface.points)
    np.testing.assert_array_equal(found.triangles, surface.triangles)
    z = surface.points[:, 2]
    # Force was measured nowhere.
    assert set(found.point_data) == {"LAT", "Bipolar", "Unipolar", "Impedance"}
    np.testing.assert_allclose(found.point_data["LAT"], 10 * z)
    np.testing.assert_allclose(found.point_data["Bipolar"], np.where(z > np.median(z), np.nan, 0.5))
    np.testing.assert_allclose(found.point_data["Unipolar"], z + 1)
    np.testing.assert_allclose(found.point_data["Impedance"], np.where(np.arange(len(z)) == 3, np.nan, 120 + z))


def test_coordinates_of_other_mapping_systems_are_lps(tmp_path, save):
    surface = chamber()
    for system, expected in [("carto", surface.points), ("ensitex", to_carto(surface.points))]:
        save(tmp_path / "a.mat", openep_data(surface, system))
        np.testing.assert_allclose(read_surface(tmp_path / "a.mat").points, expected)


def test_openep_without_values_and_with_unused_points(tmp_path, save):
    surface = chamber()
    data = openep_data(surface)
    data["surface"]["triRep"]["X"] = np.concatenate([data["surface"]["triRep"]["X"], [[500.0, 500, 500]]])
    data["surface"]["act_bip"] = np.zeros((0, 0))
    del data["surface"]["uni_imp_frc"]
    save(tmp_path / "a.mat", data)
    found = read_surface(tmp_path / "a.mat")
    assert len(found.points) == len(surface.points)
    assert found.point_data == {}


def test_bad_openep_files_are_refused_in_words(tmp_path, save):
    surface = chamber()
    n = len(surface.points)
    path = tmp_path / "a.mat"

    def refused(kind: type[LAFlatteningError] = InputFileError, **changes: Any) -> str:
        data = openep_data(surface)
        tri_rep = {k: v for k, v in {**data["surface"]["triRep"], **changes.pop("triRep", {})}.items() if v is not None}
        data["surface"] = {**data["surface"], "triRep": tri_rep, **changes}
        save(path, data)
        return refusal(path, kind)

    assert "no X and Triangulation" in refused(triRep={"X": None})
    assert "no X and Triangulation" in refused(triRep={"Triangulation": None})
    assert f"Triangulation {len(surface.triangles)} x 4" in refused(
        triRep={"Triangulation": np.ones((len(surface.triangles), 4))}
    )
    assert f"act_bip is {n} x 3, expected {n} x 2 numbers (LAT, Bipolar)" in refused(act_bip=np.zeros((n, 3)))
    assert "uni_imp_frc is 5 x 3" in refused(uni_imp_frc=np.zeros((5, 3)))
    wrong = surface.triangles + 1.0
    wrong[4, 1] = n + 9
    assert f"Triangles refer to point {n + 8}" in refused(SurfaceError, triRep={"Triangulation": wrong})
    wrong[4, 1] = 0
    assert "Triangles refer to point -1" in refused(SurfaceError, triRep={"Triangulation": wrong})
    wrong[4, 1] = 1.5
    assert "no whole numbers" in refused(triRep={"Triangulation": wrong})
    wrong[4, 1] = np.nan
    assert "no whole numbers" in refused(triRep={"Triangulation": wrong})
    holes = to_carto(surface.points)
    holes[7, 0] = np.nan
    assert "not a number" in refused(SurfaceError, triRep={"X": holes})
    save(path, {"notes": np.array([1.0])})
    assert "its userdata has no surface" in refusal(path)


def test_files_that_are_no_openep_data(tmp_path):
    path = tmp_path / "a.mat"
    savemat(path, {"data": np.arange(5)})
    assert 'no variable "userdata"' in refusal(path)
    savemat(path, {"userdata": np.arange(5)})
    assert "its userdata has no surface" in refusal(path)
    path.write_bytes(b"PK\x03\x04 not a MATLAB file at all")
    assert "is not a MATLAB file" in refusal(path)


def test_version_73_without_h5py_says_what_to_install(tmp_path, monkeypatch):
    save_matlab_73(tmp_path / "a.mat", openep_data(chamber()))
    monkeypatch.setitem(sys.modules, "h5py", None)
    text = refusal(tmp_path / "a.mat")
    assert "pip install h5py" in text
    assert "-v7" in text
    save_matlab_5(tmp_path / "b.mat", openep_data(chamber()))
    assert len(read_surface(tmp_path / "b.mat").points) == len(chamber().points)


# ---- damaged files ----


@pytest.mark.parametrize("kind", ["carto", *SAVE])
def test_damaged_files_are_read_or_refused_but_nothing_else(tmp_path, kind):
    surface = meshes.icosphere(30.0, 1)
    path = tmp_path / ("a.mesh" if kind == "carto" else "a.mat")
    if kind == "carto":
        write_carto(path, surface, {"Bipolar": surface.points[:, 2]})
    else:
        SAVE[kind](path, openep_data(surface))
    whole = path.read_bytes()
    rng = np.random.default_rng(7)
    refused = 0
    for k in range(150):
        data = bytearray(whole)
        if k % 2:
            del data[rng.integers(1, len(data)) :]
        else:
            for place in rng.integers(0, len(data), 12):
                data[place] = rng.integers(256)
        path.write_bytes(data)
        try:
            read_surface(path)
        except LAFlatteningError as error:
            assert path.name in str(error)
            refused += 1
    assert refused > 60


# ---- what is done with them ----


def test_units_of_quantities():
    assert unit_of("LAT") == "ms"
    assert unit_of("bipolar ") == "mV"
    assert unit_of("scar") == ""
    assert set(KNOWN_UNITS.values()) == {"ms", "mV", "Ohm", "g"}


def test_coarse_map_is_remeshed_with_its_values(tmp_path):
    surface = chamber()
    z = surface.points[:, 2] + 40.0
    path = write_carto(tmp_path / "a.mesh", surface, {"Bipolar": np.where(z > 10, NO_VALUE, 1.0 + 0.02 * z)})
    fine = remesh(read_surface(path), points=4 * len(surface.points)).surface
    height = fine.points[:, 2] + 40.0
    assert np.isnan(fine.point_data["Bipolar"][height > 14]).all()
    measured = height < 6
    np.testing.assert_allclose(fine.point_data["Bipolar"][measured], 1.0 + 0.02 * height[measured], atol=1e-6)
    write_surface(fine, tmp_path / "fine.vtp")
    again = read_surface(tmp_path / "fine.vtp")
    np.testing.assert_array_equal(again.point_data["Bipolar"], fine.point_data["Bipolar"])


def test_real_carto_map(data_dir):
    path = data_dir / "eam" / "OC59_MV_only.mesh"
    if not path.exists():
        pytest.skip(f"{path} is absent")
    surface = read_surface(path)
    assert len(surface.points) == 3786
    assert surface.is_manifold
    assert surface.genus == 0
    assert surface.enclosed_volume > 100_000
    assert set(surface.point_data) == {"Unipolar", "Bipolar", "LAT", "Impedance", "A2", "Force", "Scar", "EML"}
    assert 0 < np.nanmedian(surface.point_data["Bipolar"]) < 5
    assert 80 < np.nanmedian(surface.point_data["Impedance"]) < 200
    # The mitral valve is the one opening: in front of and below the middle of the atrium, and to its left.
    (valve,) = surface.boundary_loops
    to_valve = surface.points[valve].mean(axis=0) - surface.points.mean(axis=0)
    assert to_valve[0] > 0
    assert to_valve[1] < 0
    assert to_valve[2] < 0
    remeshed = remesh(surface, points=10_000).surface
    assert len(remeshed.boundary_loops) == 1
    low, high = (np.nanpercentile(surface.point_data["Bipolar"], q) for q in (5, 95))
    assert np.nanpercentile(remeshed.point_data["Bipolar"], 5) == pytest.approx(low, rel=0.1)
    assert np.nanpercentile(remeshed.point_data["Bipolar"], 95) == pytest.approx(high, rel=0.1)
