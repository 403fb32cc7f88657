"""Electroanatomical maps in the format of OpenEP (.mat), read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat

from ..axes import lps_from_carto
from ..errors import InputFileError, LAFlatteningError
from ..quantities import measured
from ..surface import Surface
from .access import unreadable

TABLES = {"act_bip": ("LAT", "Bipolar"), "uni_imp_frc": ("Unipolar", "Impedance", "Force")}
"""Table of the file -> the quantities in its columns."""
LPS_SYSTEMS = ("precision", "ensite", "velocity", "navx")
"""Mapping systems whose coordinates are LPS; OpenEP keeps those of the system, otherwise of CARTO."""


def read_openep(path: Path) -> Surface:
    """Read the surface of an OpenEP data set, with local activation time, voltages, impedance and contact force.

    Files of MATLAB 5 to 7 are read by scipy, those of version 7.3 (HDF5) by h5py, where it is installed. Values that
    were not measured are NaN, and quantities that were measured nowhere are left out. Coordinates are turned to LPS.

    Raises
    ------
    InputFileError : not a MATLAB file, damaged, without OpenEP's data; version 7.3 and h5py is not installed.
    SurfaceError : read, but not a triangle mesh.
    """
    with path.open("rb") as file:
        head = file.read(520)
    is_hdf5 = b"\x89HDF\r\n\x1a\n" in (head[:8], head[512:520])
    if not is_hdf5 and not head.startswith(b"MATLAB"):
        raise unreadable(path, 'it is not a MATLAB file (it does not begin with "MATLAB")')
    try:
        if is_hdf5:
            with _h5py(path).File(path, "r") as file:
                return _surface(path, _Hdf5(file))
        return _surface(path, _Matlab(path))
    except LAFlatteningError:
        raise
    # Damaged files make these packages raise almost anything.
    except Exception as error:
        raise unreadable(path, f"its contents are damaged ({error})") from error


class _Matlab:
    """The data set in a file of MATLAB 5 to 7."""

    def __init__(self, path: Path) -> None:
        found = loadmat(path, squeeze_me=True, struct_as_record=False, variable_names=["userdata"])
        self._root = found.get("userdata")

    def get(self, *names: str) -> Any:
        """What is stored under names, None if nothing is: an array, or a structure."""
        node = self._root
        for name in names:
            node = getattr(node, name, None) if name in getattr(node, "_fieldnames", ()) else None
        return node

    def array(self, *names: str) -> NDArray[Any] | None:
        """Numbers as MATLAB shows them, at least 2D; None if there are none."""
        node = self.get(*names)
        values = None if node is None else np.asarray(node)
        return np.atleast_2d(values) if values is not None and values.dtype.kind in "fiub" and values.size else None

    def text(self, *names: str) -> str:
        """Text; empty if there is none."""
        node = self.get(*names)
        return node if isinstance(node, str) else ""


class _Hdf5:
    """The data set in a file of MATLAB 7.3."""

    def __init__(self, file: Any) -> None:
        self._file = file

    def get(self, *names: str) -> Any:
        """As `_Matlab.get`."""
        return self._file.get("/".join(("userdata", *names)))

    def array(self, *names: str) -> NDArray[Any] | None:
        """As `_Matlab.array`; HDF5 holds the rows of MATLAB as columns, and of an empty array its size."""
        node = self.get(*names)
        if not hasattr(node, "dtype") or node.dtype.kind not in "fiub" or "MATLAB_empty" in node.attrs:
            return None
        values = np.atleast_2d(node[()]).T
        return values if values.size else None

    def text(self, *names: str) -> str:
        """As `_Matlab.text`; letters are numbers."""
        node = self.get(*names)
        if not hasattr(node, "dtype") or node.dtype.kind != "u" or node.size > 1000:
            return ""
        return "".join(chr(int(letter)) for letter in np.ravel(node[()]))


def _h5py(path: Path) -> Any:
    """The optional package h5py, loaded only when a file needs it."""
    try:
        import h5py
    except ImportError as error:
        raise InputFileError(
            f'"{path}" is a MATLAB file of version 7.3, which needs the Python package h5py. Install it (pip install '
            "h5py), or in MATLAB save the data set with the option -v7."
        ) from error
    return h5py


def _surface(path: Path, data: _Matlab | _Hdf5) -> Surface:
    if data.get() is None:
        raise unreadable(path, 'it has no variable "userdata", so it is not a data set of OpenEP')
    if data.get("surface") is None:
        raise unreadable(path, "its userdata has no surface")
    points = _first(data, "X", "Points")
    triangles = _first(data, "Triangulation", "ConnectivityList")
    if points is None or triangles is None:
        raise unreadable(
            path,
            "its userdata.surface.triRep has no X and Triangulation (a MATLAB object cannot be read elsewhere; in "
            "MATLAB, replace it by a struct with these two fields)",
        )
    if points.shape[1] != 3 or triangles.shape[1] != 3:
        raise unreadable(
            path, f"X is {_size(points)} and Triangulation {_size(triangles)}, expected n x 3 and m x 3 numbers"
        )
    if (triangles != np.round(triangles)).any() or np.abs(triangles).max() > 1e9:
        raise unreadable(path, "Triangulation has point numbers that are no whole numbers")
    if not any(system in data.text("systemName").lower() for system in LPS_SYSTEMS):
        points = lps_from_carto(points)
    arrays: dict[str, NDArray[Any]] = {}
    for table, names in TABLES.items():
        values = data.array("surface", table)
        if values is None:
            continue
        if values.shape != (len(points), len(names)):
            raise unreadable(
                path, f"{table} is {_size(values)}, expected {len(points)} x {len(names)} numbers ({', '.join(names)})"
            )
        for name, column in zip(names, measured(values.astype(np.float64)).T.copy(), strict=True):
            if np.isfinite(column).any():
                arrays[name] = column
    surface = Surface(points, triangles.astype(np.int64) - 1, arrays)
    return surface.submesh(np.ones(len(triangles), bool))[0]


def _first(data: _Matlab | _Hdf5, *names: str) -> NDArray[Any] | None:
    """The first of some fields of the surface's triangulation that is there."""
    return next((a for a in (data.array("surface", "triRep", name) for name in names) if a is not None), None)


def _size(values: NDArray[Any]) -> str:
    return " x ".join(str(n) for n in values.shape)
