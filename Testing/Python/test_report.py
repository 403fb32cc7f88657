"""The report: one file that needs nothing else."""

import json
import re
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
from LAFlatteningLib.parcellation import parcels_of
from LAFlatteningLib.preparation import PrepareSettings, prepare
from LAFlatteningLib.report import DISCLAIMER, Picture, Section, Table, make_html, write_report
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
    assert f"LAFlattening {__version__}, 2026-03-09. Input: a b.vtp, lge.nrrd" in page.text
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
    shares = Table(["share (%)", "mixed"], [[68.0, 1], [9.25, 0.5], [None, None]])
    assert Page(make_html("t", [Section("s", tables=[shares])])).rows[1:] == [
        ["68.00", "1"],
        ["9.25", "0.5"],
        ["–"] * 2,
    ]


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
    assert ["RSPV", f"{gap.length_mm:.1f}", gap.segment, str(round(gap.angle_degrees))] in page.rows
    assert any(row[0] == "threshold of scar" for row in page.rows)
    assert [section.title for section in run_sections(run_folder)] == ["Findings", "Map", "Gaps in ablation lines"]
    for note in found.notes:
        assert note in page.text


def rows_of(page):
    return {row[0]: row[1:] for row in page.rows}


def test_fibrosis_is_shown_by_class_and_part(run_folder, phantom_map):
    rule, pool = Rule("iir", (1.2, 1.32)), BloodPool(100.0, 8.0, "by hand")
    found = measure_fibrosis(phantom_map, "LGE", rule, pool, parcels=parcels_of(phantom_map, ["vein_segments"]))
    (run_folder / "fibrosis.json").write_text(json.dumps(found.to_dict()))
    page = Page(write_run_report(run_folder).read_text(encoding="utf-8"))
    rows = rows_of(page)
    assert rows["part"] == ["area (cm2)", "normal (%)", "border zone (%)", "dense fibrosis (%)", "mean"]
    wall = found.part("region", 2)
    shares = [f"{share:.1f}" for share in wall.class_percent]
    assert rows["R2 posterior wall and floor"][1:4] == shares
    assert "left superior (vein_segments)" in rows
    whole = found.atrium
    assert [rows[name] for name in found.class_names] == [
        [limits, f"{area:.1f}", f"{share:.1f}"]
        for limits, area, share in zip(
            ("< 120", "120 to 132", "≥ 132"), whole.class_cm2, whole.class_percent, strict=True
        )
    ]
    assert rows["LGE: dense fibrosis (≥ 132)"] == [
        f"{whole.class_percent[2]:.1f} % of the wall, {whole.class_cm2[2]:.1f} cm2"
    ]
    assert "1.2 and 1.32 times the mean of the blood pool" in page.text
    assert "Blood pool: mean 100, SD 8 (by hand)" in page.text
    assert "No step gave a warning" in page.text


def test_missing_values_and_low_voltage_are_named(run_folder, phantom_map):
    voltage = 3.0 - phantom_map.surface.point_data["LGE"] / 60.0
    voltage[phantom_map.surface.points[:, 2] > 95.0] = np.nan
    surface = phantom_map.to_surface().with_data({"Bipolar": voltage})
    found = measure_fibrosis(surface, "Bipolar", Rule("value", (1.0, 0.5), "below"))
    (run_folder / "fibrosis.json").write_text(json.dumps(found.to_dict()))
    page = Page(write_run_report(run_folder).read_text(encoding="utf-8"))
    assert rows_of(page)["part"][-1] == "no value (cm2)"
    assert rows_of(page)["whole atrium"][-1] == f"{found.atrium.missing_cm2:.1f}"
    assert "Low Bipolar: " + found.notes[0] in page.text
    assert rows_of(page)["low"][0] == "0.5 to 1 mV"


def test_comparison_is_shown_by_region(run_folder, phantom_map):
    found = compare_maps(phantom_map, phantom_map, "LGE", "scar", 120.0, 0.5)
    content = {"a": "before.vtp", "b": "after.vtp", **found.to_dict()}
    (run_folder / "comparison.json").write_text(json.dumps(content))
    page = Page(write_run_report(run_folder).read_text(encoding="utf-8"))
    row = rows_of(page)["R4 anterior wall"]
    part = next(part for part in found.parts if part.region == 4)
    assert row[1:3] == [f"{part.pearson:.3f}", f"{part.spearman:.3f}"]
    assert row[-1] == f"{part.dice:.3f}"
    assert "A is LGE of before.vtp, B is scar of after.vtp" in page.text
    assert "A from 120 and B from 0.5" in page.text
    assert "percentiles" in page.text


def test_repairs_and_doubts_of_the_preparation_are_warnings(run_folder, phantom):
    prepared = prepare(phantom.surface, PrepareSettings(points=0))
    content = {**prepared.report(), "repairs": ["The atrium may be cut off."], "notes": [], "confidence": "low"}
    (run_folder / "prepare.json").write_text(json.dumps(content))
    page = Page(write_run_report(run_folder).read_text(encoding="utf-8"))
    assert "Preparation of the atrium: The atrium may be cut off." in page.text
    assert "Preparation of the atrium: It is not certain which opening is which" in page.text
    assert "No step gave a warning" not in page.text
    length = prepared.cavity.loop_length(prepared.rims["MV"])
    assert rows_of(page)["MV"][:2] == ["open", f"{length:.1f}"]


def test_findings_come_first_and_results_of_another_kind_are_refused(run_folder, phantom_map):
    assert [section.title for section in run_sections(run_folder)] == ["Map"]
    found = find_gaps(phantom_map, "scar", [0.5])
    (run_folder / "gaps.json").write_text(json.dumps(found.to_dict()))
    assert [section.title for section in run_sections(run_folder)][:2] == ["Findings", "Map"]
    rows = rows_of(Page(write_run_report(run_folder).read_text(encoding="utf-8")))
    assert rows["Scar round RIPV"] == ["complete"]
    ring = found.at(0.5)["left"]
    assert f"{ring.gap_length_mm:.1f} mm (RGM {ring.rgm:.2f})" in rows["Scar round the left veins together"][0]
    (run_folder / "fibrosis.json").write_text('{"rule": "iir"}')
    with pytest.raises(InputFileError, match="something of them is missing"):
        run_sections(run_folder)


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
