"""The extension as Slicer builds and packages it: nothing missing, nothing that is not there."""

from __future__ import annotations

import re
import struct
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "Testing" / "Tools"))
from list_package_files import EXPECTED, listed  # noqa: E402


@pytest.mark.parametrize(("file", "variable"), EXPECTED, ids=" ".join)
def test_cmake_lists_every_file(file, variable):
    assert listed(ROOT / file, variable) == EXPECTED[file, variable], (
        f"{file}: {variable} is out of date; run python Testing/Tools/list_package_files.py"
    )


def test_nothing_but_known_kinds_of_files_is_in_the_packaged_folders():
    """A data file of a new kind would be left out of the package unnoticed."""
    expected = {
        ROOT / Path(file).parent / name
        for (file, _), names in EXPECTED.items()
        if "Testing" not in file
        for name in names
    }
    present = {
        path
        for folder in ("LAFlatteningLib", "LAFlattening")
        for path in (ROOT / folder).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and path.name != "CMakeLists.txt"
    }
    assert present == expected


def test_top_level_adds_library_and_module():
    text = (ROOT / "CMakeLists.txt").read_text(encoding="utf-8")
    assert re.findall(r"add_subdirectory\((\w+)\)", text) == ["LAFlatteningLib", "LAFlattening"]
    assert re.search(r"^project\(LAFlattening\)$", text, re.MULTILINE)


def test_metadata_of_the_extension():
    text = (ROOT / "CMakeLists.txt").read_text(encoding="utf-8")
    repository = re.search(r'set\(LAFlattening_REPOSITORY "(.*)"\)', text)[1]
    fields = dict(re.findall(r'set\(EXTENSION_(\w+) "(.*)"\)', text))
    assert set(fields) >= {"HOMEPAGE", "CONTRIBUTORS", "DESCRIPTION", "ICONURL", "SCREENSHOTURLS", "DEPENDS"}
    assert fields["DESCRIPTION"].count(".") <= 2, "the index asks for one or two sentences"
    prefix = "https://raw.githubusercontent.com/${LAFlattening_REPOSITORY}/main/"
    assert re.fullmatch(r"[\w-]+/[\w.-]+", repository)
    for address in [fields["ICONURL"], *fields["SCREENSHOTURLS"].split()]:
        assert address.startswith(prefix)
        assert (ROOT / address.removeprefix(prefix)).is_file(), f"{address} is not in the repository"


def test_icon_is_a_square_png():
    data = (ROOT / "LAFlattening" / "Resources" / "Icons" / "LAFlattening.png").read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert struct.unpack(">II", data[16:24]) == (128, 128)


def test_module_and_packages_install_beside_each_other():
    """The library gets a folder of its own where modules are installed; the module's packages lie below its file."""
    assert "WITH_SUBDIR" in (ROOT / "LAFlatteningLib" / "CMakeLists.txt").read_text(encoding="utf-8")
    assert "WITH_SUBDIR" not in (ROOT / "LAFlattening" / "CMakeLists.txt").read_text(encoding="utf-8")


def ui() -> ET.Element:
    return ET.parse(ROOT / "LAFlattening" / "Resources" / "UI" / "LAFlattening.ui").getroot()


CONTROLS = (
    "qMRMLNodeComboBox",
    "ctkSliderWidget",
    "ctkPathLineEdit",
    "QComboBox",
    "QCheckBox",
    "QPushButton",
    "QTableWidget",
)


def test_every_control_has_a_tooltip():
    controls = [widget for widget in ui().iter("widget") if widget.get("class") in CONTROLS]
    assert len(controls) > 25
    for widget in controls:
        tip = widget.find("property[@name='toolTip']/string")
        assert tip is not None and tip.text.strip(), f"{widget.get('name')} has no tooltip"


def test_every_mrml_widget_is_told_of_the_scene():
    """In Slicer a node selector without scene stays empty."""
    root = ui()
    told = {c.find("receiver").text for c in root.iter("connection") if c.find("slot").text.startswith("setMRMLScene")}
    assert told == {w.get("name") for w in root.iter("widget") if w.get("class") == "qMRMLNodeComboBox"}


def test_widget_names_are_unique():
    names = [widget.get("name") for widget in ui().iter("widget")]
    assert len(names) == len(set(names))


def test_custom_widgets_are_declared():
    root = ui()
    used = {widget.get("class") for widget in root.iter("widget") if not widget.get("class").startswith("Q")}
    assert used == {entry.find("class").text for entry in root.iter("customwidget")}
