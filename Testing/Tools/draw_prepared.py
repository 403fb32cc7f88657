"""Draw Screenshots/prepared.png: what is cut off the synthetic atrium.

python Testing/Tools/draw_prepared.py
"""

from __future__ import annotations

from pathlib import Path

from LAFlatteningLib.phantom import make_phantom
from LAFlatteningLib.preparation import PrepareSettings, prepare
from LAFlatteningLib.preparation_figure import draw_preparation

if __name__ == "__main__":
    prepared = prepare(make_phantom(20000, closed=True).surface, PrepareSettings(points=0))
    draw_preparation(prepared, Path(__file__).resolve().parents[2] / "Screenshots" / "prepared.png")
