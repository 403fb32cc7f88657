"""The standardised unfold map (SUM): the atrium registered to a template whose map on a disk is known."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from ..anatomy import LEFT_ATRIUM
from ..carrying import closest_points
from ..cavity.openings import check_surface
from ..errors import SurfaceError, TemplateError
from ..files import read_surface
from ..flattening.flat_map import FlatMap
from ..parcellation import Parcellation
from ..progress import ProgressCallback, part, report
from ..seed_suggestion import suggest_seeds
from ..surface import FloatArray, IntArray, Surface
from ..template import Template
from .peer_map import PeerMap, Resampled, cavity_rims, whole_cavity
from .registration import register

SOURCE = (
    "Williams et al., Standardized unfold mapping: a technique to permit left atrial regional data display and "
    "analysis, J. Interv. Card. Electrophysiol. 50, 2017"
)
LAYOUT = "adapted2"
"""The template whose holes lie as on the SUM disk: by it the holes of a disk get their names."""
NEAR = 0.08
"""On a disk with the layout of SUM no hole is farther than this from its place, in radii."""


@dataclass(frozen=True, eq=False)
class SumTemplate:
    """A template atrium in space and on its disk.

    Attributes
    ----------
    surface : the atrium in space, mm.
    disk : (n, 2) the places of its points on the disk.
    rims : opening -> its rim as point ids.
    seeds : label -> (3,) mm on the atrium.
    """

    surface: Surface
    disk: FloatArray
    rims: Mapping[str, IntArray]
    seeds: Mapping[str, FloatArray]

    @classmethod
    def load(cls, atrium: Path | str, disk: Path | str) -> SumTemplate:
        """Read the two files of a template; errors as for `of` and `read_surface`."""
        return cls.of(read_surface(atrium), read_surface(disk))

    @classmethod
    def of(cls, atrium: Surface, disk: Surface, seeds: Mapping[str, FloatArray] | None = None) -> SumTemplate:
        """A template from its two surfaces.

        Parameters
        ----------
        atrium, disk : the same points and triangles in space (mm) and in the plane z = 0, six rims each.
        seeds : on the atrium; by default `suggest_seeds`.

        Holes get their names by where they lie on the disk: the assignment nearest to the layout of SUM.

        Raises
        ------
        TemplateError : the two are not the same mesh, or the disk is not flat.
        SurfaceError : not six openings, or no clean surface.
        """
        if len(atrium.points) != len(disk.points) or len(atrium.triangles) != len(disk.triangles):
            raise TemplateError(
                f"The template has {len(atrium.points)} points and {len(atrium.triangles)} triangles in space, "
                f"{len(disk.points)} and {len(disk.triangles)} on the disk; expected the same mesh twice. Check that "
                "both files belong together."
            )
        if {*map(tuple, np.sort(atrium.triangles))} != {*map(tuple, np.sort(disk.triangles))}:
            raise TemplateError(
                "The triangles of the template in space and on the disk join other points; expected the same mesh "
                "twice. Check that both files belong together."
            )
        extent = np.ptp(disk.points, axis=0)
        if extent[2] > 1e-6 * extent[:2].max():
            raise TemplateError(
                f"The disk of the template is {extent[2]:.3g} high; expected a flat map at z = 0. Check the order of "
                "the two files: first the atrium in space, then the disk."
            )
        surface, _ = check_surface(atrium)
        if len(surface.boundary_loops) != len(LEFT_ATRIUM.openings):
            raise SurfaceError(
                f"The template has {len(surface.boundary_loops)} openings; expected {len(LEFT_ATRIUM.openings)} "
                f"({', '.join(LEFT_ATRIUM.openings)})."
            )
        flat = disk.points[:, :2]
        rims = _named_rims(surface, flat)
        seeds = suggest_seeds(surface, rims, LEFT_ATRIUM) if seeds is None else seeds
        return cls(surface, flat, rims, seeds)

    @property
    def radius(self) -> float:
        """Half the width of the disk."""
        return 0.5 * float(np.ptp(self.disk, axis=0).max())


def sum_map(flat_map: FlatMap, template: SumTemplate, progress: ProgressCallback | None = None) -> PeerMap:
    """The atrium on the disk of a SUM template.

    Parameters
    ----------
    flat_map : our map of the atrium, for its cavity and seeds.

    Returns
    -------
    PeerMap whose points lie where the closest place of the registered template lies on its disk. Data takes the way of
    the source, from the atrium to the points of the template: `PeerMap.resampled`.

    Notes
    -----
    Deviation: the source registers with software of its own. Here the 9 seeds and the rims are the landmarks of
    `registration.register`, and the seeds of the template are suggested, not placed.

    Raises
    ------
    SeedError : the atrium has no seeds in common with the template.
    Cancelled : by `progress`.
    """
    began = time.perf_counter()
    target, rims = flat_map.surface, cavity_rims(flat_map)
    bent = register(
        template.surface,
        template.seeds,
        template.rims,
        target,
        flat_map.seeds.positions,
        rims,
        part(progress, 0.0, 0.8),
    )
    report(progress, 0.8, "Carrying points to the disk")
    found = closest_points(Surface(bent, template.surface.triangles), target.points)
    corners = template.surface.triangles[found.triangle]
    places = np.einsum("kc,kcd->kd", found.weights, template.disk[corners])
    nearest = cKDTree(target.points).query(bent)[1].astype(np.int64)
    seconds = time.perf_counter() - began + flat_map.seconds["cavity"]
    report(progress, 1.0, "On the disk")
    miss = float(np.median(found.distance_mm))
    holes = {hole: template.disk[rim].mean(axis=0) for hole, rim in template.rims.items() if hole != LEFT_ATRIUM.outer}
    return whole_cavity(
        flat_map,
        "sum",
        "SUM (registration to a template)",
        places,
        seconds,
        SOURCE,
        (
            f"Registered by our seeds and rims; the atrium's points lie {miss:.2f} mm from the bent template (median), "
            f"{float(np.percentile(found.distance_mm, 95)):.1f} mm at the 95th percentile.",
        ),
        holes,
        Resampled(template.disk, template.surface.triangles, nearest),
    )


def sum_regions(places: FloatArray, template: SumTemplate) -> IntArray:
    """The number (1 to 24, 0 for none) of the region at places (k, 2) on the disk of a SUM template.

    The regions are those of the parcellation ``segments_24``: names and numbers of SUM, borders of our own drawing.

    Raises
    ------
    TemplateError : the holes of the disk do not lie as on the disk of SUM.
    """
    layout = Template.load(LAYOUT)
    for hole, rim in layout.holes.items():
        away = np.linalg.norm(
            template.disk[template.rims[hole]].mean(axis=0) / template.radius - _place(rim.shape.centre)
        )
        if away > NEAR:
            raise TemplateError(
                f"On the disk, {hole} lies {away:.2f} radii from its place on the disk of SUM; expected at most "
                f"{NEAR}. The 24 regions are drawn for the layout of SUM."
            )
    scaled = np.asarray(places, np.float64) * (layout.radius / template.radius)
    return Parcellation.load("segments_24").labels_at(scaled, layout)


def _place(centre: tuple[float, float]) -> FloatArray:
    """The place of a hole on the disk of SUM, in radii."""
    return np.array(centre) / Template.load(LAYOUT).radius


def _named_rims(surface: Surface, flat: FloatArray) -> dict[str, IntArray]:
    """Opening -> rim. The outer rim of the disk is the valve; holes go by their places."""
    layout = Template.load(LAYOUT)
    loops = surface.boundary_loops
    outer = int(np.argmax([np.ptp(flat[loop], axis=0).max() for loop in loops]))
    radius = 0.5 * float(np.ptp(flat, axis=0).max())
    others = [loop for k, loop in enumerate(loops) if k != outer]
    centres = np.array([flat[loop].mean(axis=0) for loop in others]) / radius
    wanted = np.array([_place(layout.holes[hole].shape.centre) for hole in LEFT_ATRIUM.holes])
    cost = np.linalg.norm(centres[:, None] - wanted[None], axis=2) ** 2
    best = min(permutations(range(len(others))), key=lambda order: float(cost[list(order), range(len(order))].sum()))
    return {
        **{hole: others[k] for hole, k in zip(LEFT_ATRIUM.holes, best, strict=True)},
        LEFT_ATRIUM.outer: loops[outer],
    }
