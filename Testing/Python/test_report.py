"""The report: one file that needs nothing else."""

import json
import re
from datetime import date
from html.parser import HTMLParser

import numpy as np
import pytest

from LAFlatteningLib._version import __version__
from LAFlatteningLib.errors import InputFileError
from LAFlatteningLib.gaps import find_gaps
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
    assert ["RSPV", f"{round(gap.length_mm, 1):g}", gap.segment, str(round(gap.angle_degrees))] in page.rows
    assert any(row[0] == "threshold of scar" for row in page.rows)
    assert [section.title for section in run_sections(run_folder)] == ["Map", "Gaps in ablation lines"]
    for note in found.notes:
        assert note in page.text


def test_other_results_are_shown_as_they_are(run_folder):
    content = {
        "rule": "iir",
        "thresholds": [1.2, 1.32],
        "regions": {"1": {"area_cm2": 20.5, "fibrosis_percent": 3.0}, "2": {"area_cm2": 31.0, "fibrosis_percent": 1.0}},
        "list": [{"name": "x", "r": 0.5}],
        "notes": ["7 points have no value."],
    }
    (run_folder / "fibrosis.json").write_text(json.dumps(content))
    page = Page(write_run_report(run_folder).read_text(encoding="utf-8"))
    assert ["", "area (cm2)", "fibrosis (%)"] in page.rows
    assert ["2", "31", "1"] in page.rows
    assert ["x", "0.5"] in page.rows
    assert ["thresholds", "1.2, 1.32"] in page.rows
    assert "Fibrosis: 7 points have no value." in page.text


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
