"""Names of files and of the arrays in them: whatever letters they have, and what is said of those that cannot be."""

import os
import sys

import numpy as np
import pytest
from meshes import icosphere

from LAFlatteningLib.errors import InputFileError
from LAFlatteningLib.files import atomic_write, check_writable, read_seeds, read_surface, write_surface


@pytest.mark.parametrize("suffix", [".vtp", ".vtk"])
def test_names_of_arrays_come_back_whatever_is_in_them(tmp_path, suffix):
    surface = icosphere(30.0, 1)
    names = ["a&b", "<1 mV", 'Voltage "bi"', "it's", "a, b", "été µ", "&amp;", "a > b", "two words"]
    values = np.arange(float(len(surface.points)))
    cells = np.arange(float(len(surface.triangles)))
    kept = surface.with_data(
        {name: values + k for k, name in enumerate(names)}, {"<c>": cells}, {"&f": np.array([1.5])}
    )
    write_surface(kept, tmp_path / f"a{suffix}")
    found = read_surface(tmp_path / f"a{suffix}")
    assert sorted(found.point_data) == sorted(names)
    for k, name in enumerate(names):
        np.testing.assert_array_equal(found.point_data[name], values + k)
    np.testing.assert_array_equal(found.cell_data["<c>"], cells)
    assert found.field_data["&f"].tolist() == [1.5]


def test_a_name_that_no_xml_holds_is_refused(tmp_path):
    surface = icosphere(30.0, 1)
    named = surface.with_data({"one\nother": np.zeros(len(surface.points))})
    with pytest.raises(InputFileError, match=r"'one\\nother' holds a line break.*Rename"):
        write_surface(named, tmp_path / "a.vtp")
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
def test_names_of_files_that_are_not_unicode_are_refused_with_words(tmp_path):
    surface = icosphere(30.0, 1)
    write_surface(surface, tmp_path / "a.vtp")
    odd = os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9.vtp")
    (tmp_path / "a.vtp").rename(odd)
    for act in (lambda: read_surface(odd), lambda: write_surface(surface, odd)):
        with pytest.raises(InputFileError, match=r"not in UTF-8.*Rename the file"):
            act()


def test_errors_of_files_within_files_name_the_one_that_was_asked_for(tmp_path):
    with (
        pytest.raises(InputFileError, match=r'picture\.png" cannot be written') as caught,
        atomic_write(tmp_path / "picture.png") as outer,
        atomic_write(outer),
    ):
        raise OSError(28, "No space left on device")
    assert f'"{tmp_path}/picture.png"' in str(caught.value)


def test_a_file_where_a_folder_should_be_is_told_so(tmp_path):
    (tmp_path / "map.vtp").write_text("x")
    with pytest.raises(InputFileError, match=r'map\.vtp" is a file.*expected a folder'):
        check_writable(tmp_path / "map.vtp" / "comparison.json", make_folder=True)


def test_seeds_may_be_separated_by_tabs(tmp_path):
    path = tmp_path / "seeds.csv"
    path.write_text("label\tx_mm\ty_mm\tz_mm\nRSPV\t1,5\t-2.25\t3\n")
    assert read_seeds(path)["RSPV"].tolist() == [1.5, -2.25, 3.0]
