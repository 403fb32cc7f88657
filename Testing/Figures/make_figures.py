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
import others
import overview
import readings
import study
from atria import Atrium, atria
from pictures import Drawn, save

FOLDER = Path(__file__).resolve().parents[2] / "Docs" / "figures"

FIGURES: dict[str, Callable[[Atrium], Drawn | None]] = {
    "overview": overview.draw,
    "constraints": constraints.draw,
    "strategies": study.strategies,
    "templates": study.templates,
    "refinement": study.refinement,
    "patterns": study.patterns,
    "gaps": readings.gaps,
    "lge": readings.lge,
    "lge_voltage": readings.voltage,
    "peers": others.draw,
}
"""Name -> what draws it for an atrium, or None where the atrium has not what it needs. In the order of the paper."""


POPULATIONS = {"box_plots": study.box_plots, "template_spread": study.template_spread}
"""Name -> what draws it for several atria."""


def main() -> None:
    """Draw them all, or those asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    names = [*FIGURES, *POPULATIONS, "templates_sum"]
    parser.add_argument("--only", nargs="+", choices=names, default=names, metavar="NAME")
    parser.add_argument("--phantom", action="store_true", help="leave real atria out")
    options = parser.parse_args()
    captions: dict[Path, dict[str, str]] = {}

    def draw(name: str, folder: Path, make: Callable[[], Drawn | None]) -> None:
        if name not in options.only:
            return
        begun = time.perf_counter()
        drawn = make()
        if drawn is not None:
            path = save(drawn, folder)
            captions.setdefault(folder, {})[drawn.name] = drawn.caption
            print(f"{path}  ({time.perf_counter() - begun:.0f} s)", flush=True)

    for atrium in atria():
        if options.phantom and atrium.key:
            break
        folder = FOLDER / "real" / atrium.key if atrium.key else FOLDER
        for name, of in FIGURES.items():
            draw(name, folder, lambda of=of, atrium=atrium: of(atrium))
        if not atrium.key:
            phantoms = study.population()
            for name, of_many in POPULATIONS.items():
                draw(name, folder, lambda of_many=of_many, some=phantoms: of_many(some, "synthetic atria"))
    if not options.phantom:
        real = study.real_population()
        for atrium in real:
            draw("lge", FOLDER / "real" / atrium.key, lambda atrium=atrium: readings.lge(atrium))
        for name, of_many in POPULATIONS.items() if real else ():
            draw(name, FOLDER / "real", lambda of_many=of_many: of_many(real, "atria from LGE-MRI"))
        draw("templates_sum", FOLDER / "real", study.sum_atlas)
    if options.only == names:
        for folder, texts in captions.items():
            _write_gallery(folder, texts)


def _write_gallery(folder: Path, captions: dict[str, str]) -> None:
    lines = ["# Figures", "", "Drawn by `make figures`; every number in a caption was computed with its figure.", ""]
    for name, caption in captions.items():
        lines += [f"## {name.replace('_', ' ').capitalize()}", "", f"![{name}]({name}.png)", "", caption, ""]
    (folder / "README.md").write_text("\n".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()
