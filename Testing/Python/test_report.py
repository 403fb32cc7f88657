"""The report: one file that needs nothing else."""

import json
import re
from dataclasses import replace
from datetime import date
from html.parser import HTMLParser

import numpy as np
import pytest

from LAFlatteningLib._version import __version__
from LAFlatteningLib.blood_pool import BloodPool
from LAFlatteningLib.comparison import compare_maps
from LAFlatteningLib.errors import InputFileError
from LAFlatteningLib.fibrosis import Rule, measure_fibrosis
from LAFlatteningLib.gaps import find_gaps
from LAFlatteningLib.map_data import MapData
from LAFlatteningLib.parcellation import parcels_of
from LAFlatteningLib.report import DISCLAIMER, Fixed, Picture, Section, Table, make_html, write_report
from LAFlatteningLib.run_report import run_sections, write_run_report

# The smallest picture: one black pixel.
PNG = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010806000000"
    "1f15c4890000000d49444154789c6360606060000000050001a5f645400000000049454e44ae426082"
)


class Page(HTMLParser):
    """What a browser would see: balanced tags, text, and everything that could be loaded."""

    VOID = ("meta", "img", "br", "hr")

    def __init__(self, text):
        super().__init__()
        self.open, self.seen, self.links, self.rows = [], [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        self.links += [value for name, value in attributes if name in ("src", "href", "action", "data")]
        if tag not in self.VOID:
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "style" not in self.open:
            self.seen.append(data)
            if self.open and self.open[-1] in ("td", "th"):
                self.rows[-1][-1] += data

    @property
    def text(self):
        return "\n".join(self.seen)


def test_page_says_what_it_is_and_where_it_comes_from():
    page = Page(
        make_html(
            "Patient 7", [Section("A", ["b"])], inputs=["/home/me/a b.vtp", r"D:\x\lge.nrrd"], day=date(2026, 3, 9)
        )
    )
    assert DISCLAIMER in page.text
    assert f"LAFlattening {__version__}, 2026-03-09" in page.text
    assert "Input: a b.vtp, lge.nrrd\n" in page.text
    assert "home" not in page.text and "D:" not in page.text
    assert "No step gave a warning." in page.text


def test_warnings_come_first():
    text = make_html("t", [Section("One", ["fine"]), Section("Two", ["words"], warnings=["look here"])])
    assert text.index("Two: look here") < text.index("<section>")
    assert "No step gave a warning" not in text


def test_text_is_escaped_everywhere(tmp_path):
    evil = '<script>alert("1")</script>&'
    (tmp_path / "p.png").write_bytes(PNG)
    section = Section(evil, [evil], [Table([evil], [[evil]], evil)], [Picture(tmp_path / "p.png", evil)], [evil])
    text = make_html(evil, [section], inputs=[evil])
    assert "<script" not in text
    page = Page(text)
    # Title, heading, warning, section, paragraph, caption, heading of a column, cell, caption of the picture.
    assert page.text.count(evil.split("</")[0]) >= 9


def test_nothing_is_loaded_from_anywhere(tmp_path):
    (tmp_path / "p.png").write_bytes(PNG)
    text = make_html("t", [Section("s", pictures=[Picture(tmp_path / "p.png", "a pixel")])])
    assert [link.split(",")[0] for link in Page(text).links] == ["data:image/png;base64"]
    assert "default-src 'none'" in text
    assert not re.search(r"https?://|@import|url\(", text)


def test_cells_are_written_for_people():
    table = Table(["name", "length (mm)", "open"], [["a", 3.14159, True], ["b", None, False], ["c", np.nan, None]])
    assert Page(make_html("t", [Section("s", tables=[table])])).rows[1:] == [
        ["a", "3.142", "yes"],
        ["b", "–", "no"],
        ["c", "–", "–"],
    ]


def test_numbers_of_a_column_have_as_many_decimals():
    values = [Fixed(18.0), Fixed(17.94), Fixed(-0.04), Fixed(None), Fixed(float("nan")), Fixed(0.1936, 3)]
    html = make_html("t", [Section("s", tables=[Table(["share (%)"], [[value] for value in values])])])
    assert Page(html).rows[1:] == [["18.0"], ["17.9"], ["0.0"], ["–"], ["–"], ["0.194"]]
    assert html.count('class="number"') == 7


def test_report_is_written_whole_or_not_at_all(tmp_path):
    with pytest.raises(InputFileError, match=r"ending in \.html"):
        write_report(tmp_path / "r.txt", "t", [])
    with pytest.raises(InputFileError, match="cannot be read"):
        write_report(tmp_path / "r.html", "t", [Section("s", pictures=[Picture(tmp_path / "none.png", "x")])])
    with pytest.raises(InputFileError, match="expected a picture"):
        write_report(tmp_path / "r.html", "t", [Section("s", pictures=[Picture(tmp_path / "a.tif", "x")])])
    assert list(tmp_path.iterdir()) == []


# ---- a run -----------------------------------------------------------------------------------------------------------


@pytest.fixture
def run_folder(tmp_path, phantom_map):
    (tmp_path / "metrics.json").write_text(json.dumps(phantom_map.metrics))
    (tmp_path / "figure.png").write_bytes(PNG)
    return tmp_path


def test_a_map_alone_makes_a_report(run_folder, phantom_map):
    path = write_run_report(run_folder, inputs=["atrium.vtp"])
    page = Page(path.read_text(encoding="utf-8"))
    rows = {row[0]: row[1:] for row in page.rows}
    assert rows["folded triangles"] == ["0", "0"]
    assert rows["isotropy beta, mean (1: all angles kept)"][0] == f"{phantom_map.metrics['beta']['mean']:.4g}"
    assert "Gaps" not in page.text
    assert len(page.links) == 1


def test_gaps_are_listed_with_their_lengths(run_folder, phantom_map):
    found = find_gaps(phantom_map, "scar", [0.3, 0.5, 0.7])
    (run_folder / "gaps.json").write_text(json.dumps(found.to_dict()))
    page = Page(write_run_report(run_folder).read_text(encoding="utf-8"))
    rows = [row for row in page.rows if row[0] == "RIPV"]
    assert rows[0][1] == "complete"
    gap = found.at(0.5)["RSPV"].gaps[0]
    assert ["RSPV", f"{gap.length_mm:.1f}", gap.where, str(round(gap.angle_degrees))] in page.rows
    assert any(row[0] == "threshold of scar" for row in page.rows)
    assert [section.title for section in run_sections(run_folder)] == ["Summary", "Map", "Gaps in ablation lines"]
    for note in found.notes:
        assert note in page.text


def test_fibrosis_is_a_table_of_classes_by_region_and_sub_region(run_folder, phantom_map):
    parcels = parcels_of(phantom_map, ["vein_segments"])
    pool = BloodPool(100.0, 4.0, "example", volume_ml=12.3)
    found = measure_fibrosis(phantom_map, "LGE", Rule.parse("iir=1.2,1.32"), pool, parcels=parcels)
    (run_folder / "fibrosis.json").write_text(json.dumps(found.to_dict()))
    page = Page(write_run_report(run_folder).read_text(encoding="utf-8"))
    assert ["part", "area (cm2)", "mean", "normal (%)", "border zone (%)", "dense fibrosis (%)"] in page.rows
    for part, name in ((found.atrium, "whole atrium"), (found.part("region", 5), "R5 posterior wall between the veins"),
                       (found.part("vein_segments", 3), "3 left anterior carina")):  # fmt: skip
        row = next(row for row in page.rows if row[0] == name and len(row) == 6)
        numbers = [part.area_cm2, part.mean, *part.class_percent]
        assert [float(cell) for cell in row[1:]] == pytest.approx(numbers, abs=0.06)
    assert "border zone (120 to 132)" in page.text
    assert "mean 100, SD 4 (example, 12.3 ml)" in page.text
    titles = [section.title for section in run_sections(run_folder)]
    assert titles == ["Summary", "Map", "Fibrosis"]
    assert any(row[0] == "most affected region" for row in page.rows)


def test_voltage_has_its_unit_and_name(run_folder, phantom_map):
    surface = phantom_map.surface.with_data({"Bipolar": phantom_map.surface.point_data["LGE"] / 200.0})
    found = measure_fibrosis(surface, "Bipolar", Rule.parse("value=0.6,0.55", "below"))
    (run_folder / "fibrosis.json").write_text(json.dumps(found.to_dict()))
    page = Page(write_run_report(run_folder).read_text(encoding="utf-8"))
    assert ["part", "area (cm2)", "mean (mV)", "normal (%)", "low (%)", "scar (%)"] in page.rows
    assert "low (0.55 to 0.6 mV)" in page.text
    assert "Low voltage" in [section.title for section in run_sections(run_folder)]


def test_a_comparison_says_what_is_compared(run_folder, phantom_map):
    found = compare_maps(phantom_map, phantom_map, "LGE", "scar", 120.0, 0.5)
    content = {"a": "x/map.vtp", "b": "y/map.vtp", **found.to_dict()}
    (run_folder / "comparison.json").write_text(json.dumps(content))
    page = Page(write_run_report(run_folder).read_text(encoding="utf-8"))
    assert "A is LGE of x/map.vtp, B is scar of y/map.vtp" in page.text
    row = next(row for row in page.rows if row[0] == "R5 posterior wall between the veins")
    assert float(row[2]) == pytest.approx(found.parts[5].pearson, abs=0.001)
    assert any("B - A (percentiles)" in row for row in page.rows)
    assert any("ranks" in text for text in run_sections(run_folder)[-1].warnings)


def test_scar_of_voltages_times_and_the_difference_are_named(run_folder, phantom_map):
    data = MapData.of(phantom_map)
    arrays = {"Bipolar": 3.0 - data.surface.point_data["LGE"] / 60.0, "LAT": data.surface.point_data["LGE"]}
    data = replace(data, surface=data.surface.with_data(arrays))
    (run_folder / "gaps.json").write_text(json.dumps(find_gaps(data, "Bipolar", [1.0]).to_dict()))
    late = measure_fibrosis(data, "LAT", Rule("value", (120.0,)))
    (run_folder / "fibrosis.json").write_text(json.dumps(late.to_dict()))
    found = compare_maps(data, data, "LAT", "LAT")
    (run_folder / "comparison.json").write_text(json.dumps({"a": "x", "b": "y", **found.to_dict()}))
    for name in ("comparison.png", "difference.png"):
        (run_folder / name).write_bytes(PNG)
    page = Page(write_run_report(run_folder).read_text(encoding="utf-8"))
    assert "Scar is Bipolar below 1 mV." in page.text
    assert "Without an ablation round the veins these figures say nothing" in page.text
    sections = {section.title: section for section in run_sections(run_folder)}
    assert "LAT" in sections and "Fibrosis" not in sections
    assert [picture.path.name for picture in sections["Comparison"].pictures] == ["comparison.png", "difference.png"]


def test_what_was_mended_and_is_doubtful_comes_first(run_folder):
    content = {
        "space": "LPS",
        "repairs": ["Cut a bridge 4.7 mm wide between LSPV and LAA."],
        "notes": ["RIPV could also be taken otherwise; check which is which."],
        "confidence": "low",
        "planes": {
            "RSPV": {"centre_mm": [25.6, 43.7, 80.4], "found_by": "ostium", "perimeter_mm": 48.6, "kept_mm": 3.0}
        },
        "cavity": {"area_cm2": 77.25, "volume_ml": 57.4},
    }
    (run_folder / "prepare.json").write_text(json.dumps(content))
    page = Page(write_run_report(run_folder).read_text(encoding="utf-8"))
    for words in (*content["repairs"], *content["notes"], "not sure which opening is which"):
        assert page.text.index(words) < page.text.index("Quality of the map")
    assert ["RSPV", "cut at its ostium, found by rule", "48.6", "–", "3.0", "26, 44, 80"] in page.rows
    assert "77.2 cm2 of wall and 57 ml" in page.text


def test_notes_of_the_map_are_warnings(run_folder, phantom_map):
    notes = {**phantom_map.metrics, "notes": ["Triangles faced inwards; they were turned outwards."]}
    (run_folder / "metrics.json").write_text(json.dumps(notes))
    assert "Map: Triangles faced inwards" in Page(write_run_report(run_folder).read_text(encoding="utf-8")).text


def test_a_folder_without_a_map_is_refused(tmp_path):
    with pytest.raises(InputFileError, match=r"holds no metrics\.json"):
        write_run_report(tmp_path)
    (tmp_path / "metrics.json").write_text("{")
    with pytest.raises(InputFileError, match="not valid JSON"):
        write_run_report(tmp_path)
    assert not (tmp_path / "report.html").exists()
