"""The counterparts of the paper's figures.

make figures      or      PYTHONPATH=Testing/Benchmarks python Testing/Figures/make_figures.py [--only NAME ...]

Those of the synthetic atrium go into Docs/figures/ with a page that shows them all, those of real atria, where they are
found, into Docs/figures/real/ (which is not part of the repository: the licences of the data do not allow it).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import constraints
import overview
import readings
from atria import Atrium, atria, scans
from pictures import Drawn, save

FOLDER = Path(__file__).resolve().parents[2] / "Docs" / "figures"

FIGURES: dict[str, Callable[[Atrium], Drawn | None]] = {
    "overview": overview.draw,
    "constraints": constraints.draw,
    "gaps": readings.gaps,
    "lge": readings.lge,
    "lge_voltage": readings.voltage,
}
"""Name -> what draws it for an atrium, or None where the atrium has not what it needs. In the order of the paper."""


def main() -> None:
    """Draw them all, or those asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="+", choices=FIGURES, default=list(FIGURES), metavar="NAME")
    parser.add_argument("--phantom", action="store_true", help="leave real atria out")
    options = parser.parse_args()
    captions: dict[str, dict[str, str]] = {}
    for atrium in (*atria(), *(() if options.phantom else scans())):
        folder = FOLDER / "real" / atrium.key if atrium.key else FOLDER
        for name in options.only if not atrium.key.startswith("scan") else ["lge"]:
            begun = time.perf_counter()
            drawn = FIGURES[name](atrium)
            if drawn is None:
                continue
            path = save(drawn, folder)
            captions.setdefault(atrium.key, {})[drawn.name] = drawn.caption
            print(f"{path}  ({time.perf_counter() - begun:.0f} s)")
        if options.only == list(FIGURES):
            _write_gallery(folder, captions[atrium.key])
        if options.phantom:
            break


def _write_gallery(folder: Path, captions: dict[str, str]) -> None:
    lines = ["# Figures", "", "Drawn by `make figures`; every number in a caption was computed with its figure.", ""]
    for name, caption in captions.items():
        lines += [f"## {name.replace('_', ' ').capitalize()}", "", f"![{name}]({name}.png)", "", caption, ""]
    (folder / "README.md").write_text("\n".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
