"""Planes of cuts, from JSON files: those that ``la-flatten prepare`` writes, or written by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputFileError
from ..files.access import PathLike, input_suffix, unreadable
from ..schema import load_json
from ..surface import UNKNOWN
from .clipping import CutPlane

_TURN = np.array([-1.0, -1.0, 1.0])


def read_planes(path: PathLike, space: str = "LPS") -> dict[str, CutPlane]:
    """Read planes by the name of their opening.

    The file holds ``"planes": {name: {"centre_mm": [x, y, z], "normal": [x, y, z]}}`` and, if the axes are not LPS,
    ``"space": "RAS"``, or "unknown" for those of the surface; the normal points out of the chamber. Other entries, as
    in ``prepare.json``, are left out.

    Parameters
    ----------
    space : "LPS" or "RAS", the axes wanted.

    Raises
    ------
    InputFileError : no such file, not JSON, no planes, a plane without three finite numbers each, a normal of length 0.
    """
    path = Path(path)
    input_suffix(path, (".json",), "planes")
    document = load_json(path)
    planes = document.get("planes") if isinstance(document, dict) else None
    if not isinstance(planes, dict) or not planes:
        raise unreadable(path, 'it has no "planes"')
    found = document.get("space", "LPS")
    if found not in ("LPS", "RAS", UNKNOWN):
        raise InputFileError(f'"{path}", space: expected "LPS", "RAS" or "{UNKNOWN}", found {found!r:.40}.')
    turn = np.ones(3) if found in (space, UNKNOWN) else _TURN
    return {
        name: CutPlane(
            turn * _vector(path, name, "centre_mm", plane), turn * _vector(path, name, "normal", plane, zero=False)
        )
        for name, plane in planes.items()
    }


def _vector(path: Path, name: str, key: str, plane: Any, zero: bool = True) -> np.ndarray:
    values: Any = plane.get(key) if isinstance(plane, dict) else None
    numbers = isinstance(values, list) and all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
    if not numbers or len(values) != 3 or not np.isfinite(values).all():
        raise InputFileError(f'"{path}", planes.{name}.{key}: expected three finite numbers, found {str(values)[:60]}.')
    if not zero and not any(values):
        raise InputFileError(f'"{path}", planes.{name}.{key}: expected a direction, found three zeros.')
    return np.array(values, np.float64)
