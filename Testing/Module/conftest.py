"""Runs the tests of this folder where there is no Slicer. In Slicer LAFlatteningTest does, without this file."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "Host"))

from slicer_host.pytest_hooks import fresh_scene, pytest_pycollect_makemodule

__all__ = ["fresh_scene", "pytest_pycollect_makemodule"]
