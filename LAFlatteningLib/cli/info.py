"""``la-flatten info``: what a surface file holds."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from .. import topology
from ..cavity.covers import HOLE_ARRAY
from ..cavity.healing import heal
from ..cavity.openings import guess_unit
from ..errors import SurfaceError
from ..files import read_surface
from .command import Subcommands, add_command
from .progress import Progress


def add(commands: Subcommands) -> None:
    """Add the command."""
    info = add_command(
        commands,
        "info",
        run,
        "Say what a surface file holds: openings, topology, arrays, probable units and axes.",
        "la-flatten info atrium.vtp",
    )
    info.add_argument("surface", metavar="SURFACE", help="surface file (.vtk .vtp .stl .ply .obj .mesh .mat)")


def run(options: argparse.Namespace, progress: Progress) -> None:
    """Print what the file holds."""
    surface = read_surface(options.surface)
    low, high = surface.points.min(axis=0), surface.points.max(axis=0)
    size = float(np.linalg.norm(high - low))
    print(f"{options.surface}: {len(surface.points)} points, {len(surface.triangles)} triangles")
    guess = guess_unit(size)
    unit = "mm" if guess is None or guess[0] == "mm" else "units of the file"
    print(f"extent {' x '.join(f'{x:.4g}' for x in high - low)} {unit}, {size:.4g} across")
    if guess:
        print(f"units: probably {guess[0]}" + ("" if guess[0] == "mm" else f"; multiply by {guess[1]:g} to get mm"))
    else:
        print("units: unclear; a left atrium is about 100 mm across")
    said = "as the file says; LPS if it says nothing" if surface.axes_known else "so it was said, and the file keeps it"
    print(f"patient axes: {surface.axes_name} ({said})")
    print(f"pieces: {surface.component_count}")
    print(f"triangles all turned the same way: {'yes' if surface.is_oriented else 'no'}")
    if surface.is_manifold and not surface.is_oriented:
        surface = surface.with_triangles(topology.orient(surface.triangles, surface.edges))
    whole = surface
    if not whole.is_manifold:
        print(f"not a clean sheet at {len(surface.non_manifold_points)} points")
        # Lengths in it are in mm.
        if unit == "mm":
            try:
                whole, notes = heal(surface)
                print("as la-flatten prepare mends it:")
            except SurfaceError as error:
                notes = (str(error),)
            for note in notes:
                print(f"  {note}")
    loops = whole.boundary_loops if whole.is_manifold else []
    if whole.is_manifold:
        print(f"handles (genus): {whole.genus}")
    for number, loop in enumerate(sorted(loops, key=whole.loop_length, reverse=True), start=1):
        centre = ", ".join(f"{x:.4g}" for x in whole.points[loop].mean(axis=0))
        length = f"{whole.loop_length(loop):.4g} {unit}"
        print(f"opening {number}: perimeter {length}, {len(loop)} points, centre ({centre})")
    if not loops and whole.is_manifold:
        print("openings: none (closed surface)")
    if HOLE_ARRAY in surface.point_data:
        marked = np.count_nonzero(surface.point_data[HOLE_ARRAY] == 1)
        print(f'covers: {marked} points marked by the array "{HOLE_ARRAY}"')
    for kind, arrays in (("point", surface.point_data), ("cell", surface.cell_data)):
        for name, values in arrays.items():
            print(f"{kind} array {name}: {_describe(values)}")


def _describe(values: Any) -> str:
    if values.dtype.kind not in "fiub":
        return "text"
    shape = "" if values.ndim == 1 else f", {values.shape[1]} components"
    finite = values[np.isfinite(values)]
    missing = values.size - finite.size
    extent = f"{finite.min():g} to {finite.max():g}" if finite.size else "no values"
    return extent + shape + (f", {missing} without a value" if missing else "")
