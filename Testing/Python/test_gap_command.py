"""The command ``la-flatten gaps`` and its figure."""

import json
import re

import numpy as np
import pytest

from LAFlatteningLib.cli import main
from LAFlatteningLib.files import write_surface
from LAFlatteningLib.gaps import find_gaps
from LAFlatteningLib.map_data import MapData


@pytest.fixture(scope="module")
def map_file(tmp_path_factory, phantom_map):
    path = tmp_path_factory.mktemp("map") / "map.vtp"
    write_surface(phantom_map.to_surface(), path)
    return path


def run(map_file, *options, array="LGE", threshold="110,120"):
    folder = map_file.parent
    return main(
        [
            "gaps",
            str(map_file),
            "--array",
            array,
            "--threshold",
            threshold,
            "--output",
            str(folder / "gaps.json"),
            *options,
        ]
    )


def test_command_writes_what_the_library_finds(map_file, phantom_map, capsys):
    figure = map_file.parent / "gaps.png"
    assert run(map_file, "--figure", str(figure)) == 0
    written = json.loads((map_file.parent / "gaps.json").read_text(encoding="utf-8"))
    assert written == json.loads(json.dumps(find_gaps(phantom_map, "LGE", [110.0, 120.0]).to_dict()))
    assert figure.read_bytes().startswith(b"\x89PNG")
    printed = capsys.readouterr().out
    assert "RIPV: RGM 0.000" in printed
    assert "complete" in printed


def test_search_and_least_length_are_passed_on(map_file):
    assert run(map_file, "--search", "vein_surroundings", "--minimum", "3", threshold="120") == 0
    written = json.loads((map_file.parent / "gaps.json").read_text(encoding="utf-8"))
    assert written["search"] == "vein_surroundings"
    lengths = [gap["length_mm"] for area in written["results"][0]["areas"].values() for gap in area["gaps"]]
    assert min(lengths) >= 3.0
    assert run(map_file, "--search", "12.5", threshold="120") == 0
    assert (
        json.loads((map_file.parent / "gaps.json").read_text(encoding="utf-8"))["search"]
        == "within 12.5 mm of the rims"
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"threshold": "high"}, "expected numbers separated by commas"),
        ({"threshold": "120,110"}, "Thresholds out of order"),
        ({"array": "voltage"}, 'no array "voltage"'),
    ],
)
def test_bad_options_leave_no_file(map_file, options, message, capsys):
    output = map_file.parent / "gaps.json"
    output.unlink(missing_ok=True)
    assert run(map_file, **options) == 2
    assert message in capsys.readouterr().err
    assert not output.exists()


def test_every_vein_has_its_line_however_many_gaps_there_are(phantom_map, monkeypatch):
    pytest.importorskip("matplotlib")
    from LAFlatteningLib.gaps import figures

    monkeypatch.setattr(figures, "MOST_ROWS", 9)
    data = MapData.of(phantom_map)
    # Stripes of scar all round: many gaps on every path.
    stripes = np.sin(5.0 * data.surface.points[:, 0]) + np.sin(5.0 * data.surface.points[:, 2])
    data = MapData(data.surface.with_data({"stripes": stripes}), data.flat, data.template)
    report = find_gaps(data, "stripes", [1.2])
    rings = report.at(1.2)
    assert sum(len(rings[name].gaps) for name in ("RSPV", "RIPV", "LIPV", "LSPV")) > 2 * (9 - 4)
    figure = figures.make_gap_figure(data, report)
    texts = [text.get_text() for text in figure.texts]
    for name, ring in rings.items():
        assert any(text.startswith(f"{name}: ") and text.endswith(f"RGM {ring.rgm:.2f}") for text in texts)
    assert any(text.endswith("more: see the gap file") for text in texts)
    written = [text.get_position() for text in figure.texts if ": " in text.get_text() or " mm   " in text.get_text()]
    assert len({round(y, 4) for x, y in written if 0.0 < x < 0.4 and y < 0.4}) <= 9
    bars = next(axes for axes in figure.axes if axes.get_label() == "RGM").patches
    assert [bar.get_width() for bar in bars] == [ring.rgm for ring in rings.values()]


def test_the_figure_shows_every_gap_and_curve(phantom_map):
    pytest.importorskip("matplotlib")
    from LAFlatteningLib.gaps.figures import make_gap_figure

    report = find_gaps(phantom_map, "LGE", [110.0, 120.0, 130.0])
    figure = make_gap_figure(phantom_map, report)
    axes = {axes.get_label(): axes for axes in figure.axes}
    assert set(axes) == {"alone", "together", "RGM"}
    texts = "\n".join(text.get_text() for text in figure.texts)
    for ring in report.at(120.0).values():
        for gap in ring.gaps:
            assert re.search(rf"{gap.length_mm:.1f} mm   (about )?{gap.segment}", texts)
    curves = {line.get_label(): line for line in axes["RGM"].lines}
    assert curves["RSPV"].get_ydata().tolist() == [ring.rgm for ring in report.rings["RSPV"]]
    shown = [text.get_text() for text in axes["together"].texts]
    count = sum(len(ring.gaps) for name, ring in report.at(120.0).items() if name in ("left", "right"))
    assert [str(number + 1) in shown for number in range(count)] == [True] * count
