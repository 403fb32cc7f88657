"""The result of a flattening: the map, what it was made with, and how good it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from .. import distortion
from .._version import __version__
from ..cavity.openings import POINT_ID_ARRAY, Cavity
from ..constraints import Constraints
from ..division import Division, label_regions
from ..seeds import SnappedSeeds
from ..solvers import solver_name
from ..surface import FloatArray, IntArray, Surface
from ..template import Template
from ..views import PatientFrame

USUAL_DILATATION = 20.0
"""A 99th percentile of the dilatation above this makes a note: on real atria with good seeds it is 4 to 10."""
WIDE_EDGE_DEGREES = 45.0
"""Edges of rims that span more of their outline are noted: between their ends they leave it by 8 % of its radius."""
RIM_OFF = 1e-3
"""Rims farther from their circles than this share of the disk radius make a note."""
REGION_ARRAY = "region"
"""Cell array of a map: the number of the region."""
POSITION_ARRAY = "position_mm"
"""Point array of a map file: where the point is on the atrium, (n, 3) mm."""


@dataclass(frozen=True, eq=False)
class FlatMap:
    """A cavity laid flat.

    Point ids link the map with the atrium: row i of `points` is the place of point i of `surface`, which is
    point ``surface.point_data["surface_point_id"][i]`` of the surface that was given.

    Attributes
    ----------
    solution : (n + p, 2) map positions of the points of ``division.surface``: those of the cavity and, in the method
        ``regional``, the places of the paths between them, and now and then a place beside a path (`split_crossing`).
    surface : the cavity in 3D, mm, with the triangles of the map (some edges flipped, see `flipped_edges`).
    cavity, seeds, division, constraints : the steps before.
    template, method, rounding : how it was made; rounding only for the method "paper".
    flipped_edges : edges of the cavity that would have crossed an opening of the map and were flipped.
    freed_path_points : ids (in ``division.surface``) of path points that left their line so that no triangle folds.
    seconds : stage -> time, and "total".
    """

    solution: FloatArray
    surface: Surface
    cavity: Cavity
    seeds: SnappedSeeds
    division: Division
    constraints: Constraints
    template: Template
    method: str
    rounding: str | None
    flipped_edges: int
    freed_path_points: IntArray
    seconds: Mapping[str, float]

    @property
    def points(self) -> FloatArray:
        """(n, 2) map positions, in map units (built-in templates: a disk of radius 0.5)."""
        return self.solution[: len(self.surface.points)]

    @cached_property
    def regions(self) -> IntArray:
        """(m,) region number of each triangle; where a path cuts a triangle, of its larger part."""
        anatomy = self.template.anatomy
        region = label_regions(self.division, anatomy)
        area = np.zeros((len(self.triangles), max(anatomy.regions) + 1))
        np.add.at(area, (self.division.parent, region), self.division.surface.triangle_areas)
        return area.argmax(axis=1)

    @property
    def lines(self) -> dict[str, tuple[FloatArray, FloatArray]]:
        """Path -> its places from foot to foot, on the atrium (k, 3) mm and on the map (k, 2) map units."""
        points = self.division.surface.points
        return {name: (points[ids], self.solution[ids]) for name, ids in self.division.paths.items()}

    @property
    def triangles(self) -> IntArray:
        """(m, 3) point ids, counter-clockwise on the map."""
        return self.surface.triangles

    @cached_property
    def folded_triangles(self) -> IntArray:
        """Indices of triangles that are turned over on the map."""
        return distortion.folded_triangles(self.points, self.triangles)

    @cached_property
    def rim_error(self) -> float:
        """Largest distance of a rim point from its shape in the template, in disk radii."""
        worst = 0.0
        for opening, loop in self.division.loops.items():
            shape = self.template.rim(opening).shape
            worst = max(worst, float(shape.distance(self.solution[loop]).max()))
        return worst / self.template.radius

    @cached_property
    def widest_rim_edge(self) -> tuple[str, float]:
        """The opening with the edge that spans the largest share of its outline, and that share in degrees of 360."""
        spans = {}
        for opening, loop in self.division.loops.items():
            corners = self.solution[loop]
            edges = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
            outline = self.template.rim(opening).shape.outline()
            around = float(np.linalg.norm(np.roll(outline, -1, axis=0) - outline, axis=1).sum())
            spans[opening] = 360.0 * float(edges.max()) / around
        return max(spans.items(), key=lambda span: span[1])

    @cached_property
    def path_drift(self) -> float:
        """Largest distance of a path point from its place on the template, in disk radii."""
        moved = np.linalg.norm(self.solution[self.constraints.path_ids] - self.constraints.path_targets, axis=1)
        return float(moved.max(initial=0.0)) / self.template.radius

    @cached_property
    def distortion_summary(self) -> dict[str, Any]:
        """Figures of alpha, beta and dilatation, see `distortion.summary`."""
        return distortion.summary(self.surface.points, self.triangles, self.points)

    @cached_property
    def frame(self) -> PatientFrame:
        """The patient's directions; estimated where the axes of the surface are not known."""
        return PatientFrame.of(self.surface, self.seeds.positions, self.template.anatomy)

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """What was mended in the input, and what to look at on the map before trusting it."""
        notes = [*self.cavity.notes, *self.division.notes]
        if not self.surface.axes_known:
            notes.append(
                "The axes of the file are unknown: "
                + (
                    "figures state no directions of the patient. "
                    if self.frame.axes is None
                    else "the patient's directions in figures are estimated from the seeds, to about 20 degrees. "
                )
                + "Coordinates are those of the file."
            )
        if len(self.folded_triangles):
            notes.append(
                f"{len(self.folded_triangles)} triangles are folded, as is usual for the method {self.method}; "
                "the method regional does not fold."
            )
        if self.rim_error > RIM_OFF:
            notes.append(
                f"Rims are off their circles by up to {100 * self.rim_error:.0f} % of the disk radius ({self.method}): "
                "the map is for study, and cannot be compared with others."
            )
        opening, degrees = self.widest_rim_edge
        if degrees > WIDE_EDGE_DEGREES:
            notes.append(
                f"An edge of the rim of {opening} spans {degrees:.0f} degrees of its outline, so that the map leaves "
                "it there. Check the seeds beside it, or mesh the surface more finely."
            )
        if len(self.freed_path_points):
            notes.append(
                f"{len(self.freed_path_points)} path points had to leave their lines so that nothing folds, by up to "
                f"{100 * self.path_drift:.2g} % of the disk radius. Check the seeds, and the map near the paths."
            )
        worst = self.distortion_summary["dilatation"]["p99"]
        if self.method == "regional" and worst > USUAL_DILATATION:
            stretched = distortion.dilatation(self.surface.points, self.triangles, self.points) > USUAL_DILATATION
            share = float(self.surface.triangle_areas[stretched].sum() / self.surface.area)
            notes.append(
                f"The map is stretched more than usual (99th percentile of the dilatation {worst:.0f}, usually 4 to "
                "10). Check that every seed is on the opening that it names."
                if share > 0.01
                # Slivers are stretched whatever the map is like.
                else f"The mesh has thin triangles, of {100 * share:.1g} % of the area, which raise the figures of the "
                f"dilatation (99th percentile {worst:.0f}). Remesh the surface evenly if these matter."
            )
        return tuple(notes)

    @cached_property
    def metrics(self) -> dict[str, Any]:
        """The quality of the map, as written to the metrics file (see Docs/formats.md)."""
        return {
            "version": __version__,
            "method": self.method,
            "rounding": self.rounding,
            "solver": solver_name(),
            "template": self.template.name,
            "points": len(self.points),
            "triangles": len(self.triangles),
            "folded_triangles": len(self.folded_triangles),
            "overlapping_pairs": len(distortion.overlapping_pairs(self.points, self.triangles)),
            "flipped_edges": self.flipped_edges,
            "freed_path_points": len(self.freed_path_points),
            "rim_error": self.rim_error,
            "path_drift": self.path_drift,
            **self.distortion_summary,
            "seed_moved_mm": dict(self.seeds.moved_mm),
            "notes": list(self.notes),
            "seconds": dict(self.seconds),
        }

    def to_surface(self) -> Surface:
        """The map as a surface in the plane z = 0, with all arrays of the atrium, ``surface_point_id``,
        ``position_mm`` and ``region``; seeds, template, method and version are in its field data.
        """
        labels = list(self.template.anatomy.seeds)
        on_atrium = np.array([self.seeds.positions[label] for label in labels])
        return Surface(
            np.column_stack([self.points, np.zeros(len(self.points))]),
            self.triangles,
            {**self.surface.point_data, POSITION_ARRAY: self.surface.points},
            {**self.surface.cell_data, REGION_ARRAY: self.regions.astype(np.int32)},
            {
                **self.surface.field_data,
                "template": np.array([self.template.name], dtype=object),
                "method": np.array([self.method], dtype=object),
                "rounding": np.array([self.rounding or ""], dtype=object),
                "version": np.array([__version__], dtype=object),
                "seed_labels": np.array(labels, dtype=object),
                "seed_positions_mm": on_atrium,
                "seed_space": np.array([self.surface.space], dtype=object),
            },
            # A map has no patient axes. RAS is what 3D Slicer shows as it is, without turning it.
            "RAS",
        )


__all__ = ["POINT_ID_ARRAY", "POSITION_ARRAY", "REGION_ARRAY", "FlatMap"]
