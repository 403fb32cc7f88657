"""The figures of `make figures` can be drawn, and say what is so."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

pytest.importorskip("matplotlib")
TESTING = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def figures():
    """The modules that draw, and a small synthetic atrium."""
    folders = [str(TESTING / "Figures"), str(TESTING / "Benchmarks")]
    sys.path[:0] = folders
    try:
        import atria
        import make_figures
        from cases import phantom

        yield make_figures, atria.Atrium("", "synthetic atrium, 3000 points", *phantom(3000))
    finally:
        for folder in folders:
            sys.path.remove(folder)


@pytest.mark.parametrize(
    "name", ["overview", "constraints", "strategies", "templates", "refinement", "patterns", "gaps"]
)
def test_figure(figures, name, tmp_path):
    make_figures, atrium = figures
    drawn = make_figures.FIGURES[name](atrium)
    assert drawn.name == name
    assert "synthetic atrium" in drawn.caption
    path = make_figures.save(drawn, tmp_path)
    assert path.stat().st_size > 10_000


def test_the_rule_is_half_way(figures):
    make_figures, atrium = figures
    caption = make_figures.FIGURES["constraints"](atrium).caption
    real, equal, rule = ([int(n) for n in found.split("/")] for found in re.findall(r"\d+/\d+/\d+", caption))
    assert sum(real) == sum(equal) == sum(rule)
    # The first arc: real + floor((equal - real) / 2).
    assert abs(rule[0] - (real[0] + (equal[0] - real[0]) // 2)) <= 1
    assert real != equal


def test_every_figure_is_shown_in_the_gallery(figures):
    make_figures, _ = figures
    folder = TESTING.parent / "Docs" / "figures"
    page = (folder / "README.md").read_text(encoding="utf-8")
    for name in (*make_figures.FIGURES, *make_figures.POPULATIONS):
        assert f"![{name}]({name}.png)" in page
        assert (folder / f"{name}.png").is_file()
