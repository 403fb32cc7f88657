"""Intensities of an image carried to the wall: sampled along the normal at each point of a surface.

The maximum within 3 mm on both sides (maximum intensity projection) is what Nunez-Garcia et al. show on their maps
(section III-A of the paper); other depths, sides and the mean are in use as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import topology
from .cavity.covers import HOLE_ARRAY
from .cavity.openings import guess_unit
from .errors import InputFileError, LAFlatteningError, SurfaceError
from .flattening.flat_map import POINT_ID_ARRAY, POSITION_ARRAY, REGION_ARRAY
from .surface import FloatArray, IntArray, Surface
from .volume import Volume

LGE_ARRAY = "LGE"
"""Point array with the projected intensity."""
TAKEN = (HOLE_ARRAY, REGION_ARRAY, POSITION_ARRAY, POINT_ID_ARRAY)
"""Names of arrays that mean something else."""
DEPTH_MM = 3.0
FARTHEST_MM = 50.0
"""Farther from the wall there is no wall: so far is across the chamber."""
SIDES = ("both", "in", "out")
STATISTICS = ("max", "mean")

SAMPLES_AT_ONCE = 2_000_000
"""Points are done in groups of about so many samples, to bound memory."""
FLAT = 1e-9
"""A piece that encloses less than this share of (its area) ^ 3/2 is flat, but for rounding."""


@dataclass(frozen=True, eq=False)
class Projection:
    """The intensity at each point of a surface.

    Attributes
    ----------
    values : (n,) float64, NaN where every sample is outside the image.
    interval_mm : where samples were taken, along the outward normal: negative is inside the chamber.
    step_mm : distance of the samples.
    statistic : "max" or "mean".
    outside : number of points with every sample outside the image (or where the image is NaN): no value.
    partly_outside : number of points with some samples outside. Their values are of the samples inside.
    notes : what the user should know.
    """

    values: FloatArray
    interval_mm: tuple[float, float]
    step_mm: float
    statistic: str
    outside: int
    partly_outside: int
    notes: tuple[str, ...]

    def on(self, surface: Surface, name: str = LGE_ARRAY) -> Surface:
        """The surface with the values as a point array, and how they were made in its field data
        (NAME_interval_mm, NAME_step_mm, NAME_statistic).

        Raises
        ------
        LAFlatteningError : no name, or one that says something else on an atrium or a map (`TAKEN`).
        """
        if not name.strip() or name in TAKEN:
            raise LAFlatteningError(
                f"Expected a name for the array of intensities, like {LGE_ARRAY}, other than {', '.join(TAKEN)}; found "
                f'"{name}".'
            )
        return surface.with_data(
            {name: self.values},
            field_data={
                f"{name}_interval_mm": np.array(self.interval_mm),
                f"{name}_step_mm": np.array([self.step_mm]),
                f"{name}_statistic": np.array([self.statistic], dtype=object),
            },
        )


def projection_of(surface: Surface, name: str) -> dict[str, Any] | None:
    """How an array was projected, by what `Projection.on` wrote: ``interval_mm``, ``statistic``; None of others."""
    interval, statistic = (surface.field_data.get(f"{name}_{what}") for what in ("interval_mm", "statistic"))
    if interval is None or statistic is None:
        return None
    return {"interval_mm": [float(end) for end in np.ravel(interval)], "statistic": str(np.ravel(statistic)[0])}


def project(
    surface: Surface,
    volume: Volume,
    depth_mm: float = DEPTH_MM,
    side: str = "both",
    statistic: str = "max",
    *,
    interval_mm: Sequence[float] | None = None,
) -> Projection:
    """Sample an image along the outward normal at each point of a surface.

    Samples lie no farther apart than half the smallest side of a voxel, ends included, and are trilinear. The normal
    of a point is the mean of those of its triangles, weighted by area, outward whichever way the triangles are turned.
    Samples outside the outermost voxel centres are left out; a point with none inside is NaN. Both are counted.

    Parameters
    ----------
    surface : the wall of a chamber, in LPS or RAS as its `space` says; open or closed.
    depth_mm, side : how far to go, and to "both" sides, "in" (into the chamber) or "out" (away from it).
    statistic : "max", or "mean" (the integral over the interval by the trapezoidal rule, divided by its length).
    interval_mm : (from, to) along the outward normal, in place of depth and side; (-1, 3) is 1 mm inside to 3 outside.

    Raises
    ------
    LAFlatteningError : depth not positive, interval empty, farther than `FARTHEST_MM`, unknown side or statistic.
    InputFileError : the image is the same everywhere; it does not reach the surface, or so little of it that the axes
        of the surface are wrong.
    SurfaceError : a flat map, a surface of which no outer side can be told, or one that is not in mm.

    Examples
    --------
    >>> from LAFlatteningLib.phantom import left_atrium_shape, make_lge_volume, make_phantom
    >>> volume = Volume.from_image(make_lge_volume(left_atrium_shape(), spacing=(1, 1, 1)))
    >>> project(make_phantom(2000).surface, volume).outside
    0
    """
    low, high = _interval(depth_mm, side, interval_mm)
    if statistic not in STATISTICS:
        raise LAFlatteningError(f'Expected the statistic "max" or "mean", found "{statistic}".')
    volume.check_varied()
    points = surface.points * surface.lps_signs
    _check_unit(points[surface.used_points])
    normals = outward_normals(surface) * surface.lps_signs
    values, inside, count = sample_along(volume, points, normals, (low, high), statistic)
    used = surface.used_points
    outside, partly = (int(np.count_nonzero(used & which)) for which in (inside == 0, (inside > 0) & (inside < count)))
    if outside == np.count_nonzero(used):
        raise InputFileError(_no_overlap(points[used], volume, surface.axes_known))
    if outside > 0.5 * np.count_nonzero(used) and _fits_turned(points[used], volume):
        raise InputFileError(
            f"The image does not reach {outside} of {np.count_nonzero(used)} points of the surface. " + _TURNED
        )
    notes = []
    if outside:
        notes.append(
            f"{outside} of {np.count_nonzero(used)} points have no value, because the image does not reach them."
        )
    if partly:
        notes.append(
            f"{partly} of {np.count_nonzero(used)} points are at the edge of the image: their values are of the part "
            "of the depth that it covers."
        )
    return Projection(values, (low, high), float((high - low) / (count - 1)), statistic, outside, partly, tuple(notes))


def sample_along(
    volume: Volume, points: FloatArray, normals: FloatArray, interval_mm: tuple[float, float], statistic: str
) -> tuple[FloatArray, IntArray, int]:
    """Maximum or mean of an image along the normals at points (n, 3), LPS, mm.

    Returns
    -------
    Values (n,), NaN where every sample is outside the image; number of samples inside it (n,); number of samples.
    """
    low, high = interval_mm
    count = int(np.ceil((high - low) / (0.5 * float(volume.spacing.min())) - 1e-9)) + 1
    along = np.linspace(low, high, count)
    weight = np.ones(count)
    if statistic == "mean":
        weight[[0, -1]] = 0.5

    values, inside = np.empty(len(points)), np.empty(len(points), np.int64)
    group = max(1, SAMPLES_AT_ONCE // count)
    for first in range(0, len(points), group):
        part = slice(first, first + group)
        sample = volume.sample_lines(points[part], normals[part], along)
        known = ~np.isnan(sample)
        inside[part] = known.sum(axis=0)
        if statistic == "max":
            values[part] = np.fmax.reduce(sample, axis=0)
        else:
            total = weight @ known
            values[part] = (weight @ np.where(known, sample, 0.0)) / np.where(total > 0, total, 1.0)
    values[inside == 0] = np.nan
    return values, inside, count


def outward_normals(surface: Surface) -> FloatArray:
    """Unit normal of each point, (n, 3), out of the chamber, weighted by area; 0 where no triangle uses the point.

    The outside of each piece of the surface is told by the volume that it encloses, its openings covered, whichever
    way its triangles are turned.

    Raises
    ------
    SurfaceError : a flat map; triangles that cannot be turned the same way; a surface that encloses nothing.
    """
    if np.ptp(surface.points[surface.used_points], axis=0).min() == 0.0:
        raise SurfaceError(
            "The surface is flat: it looks like a map. Expected the atrium in 3D; project on it first and flatten then."
        )
    if not surface.is_oriented:
        surface = surface.with_triangles(topology.orient(surface.triangles, surface.edges))
    triangles = surface.triangles.copy()
    turned, encloses = False, False
    for piece in range(surface.component_count):
        own = surface.components == piece
        part = surface if surface.component_count == 1 else surface.submesh(own)[0]
        volume = part.enclosed_volume
        if abs(volume) <= FLAT * part.area**1.5:
            # A stray triangle, for example: it has no outside, and stays as it is.
            continue
        encloses = True
        if volume < 0.0:
            triangles[own] = triangles[own][:, ::-1]
            turned = True
    if not encloses:
        raise SurfaceError(
            "The surface encloses no volume, so that it has no outer side. Expected the wall of a chamber."
        )
    # The surface keeps its normals, so that a change of the depth is quick.
    return surface.with_triangles(triangles).point_normals if turned else surface.point_normals


def _interval(depth_mm: float, side: str, interval_mm: Sequence[float] | None) -> tuple[float, float]:
    if interval_mm is not None:
        if len(interval_mm) != 2 or not np.isfinite(interval_mm).all() or not interval_mm[0] < interval_mm[1]:
            raise LAFlatteningError(
                "Expected an interval (from, to) in mm along the outward normal, from less than to, like (-1, 3); "
                f"found {tuple(interval_mm)}."
            )
        if max(abs(end) for end in interval_mm) > FARTHEST_MM:
            raise LAFlatteningError(_too_far(max(interval_mm, key=abs)))
        return float(interval_mm[0]), float(interval_mm[1])
    if not (np.isfinite(depth_mm) and depth_mm > 0.0):
        raise LAFlatteningError(f"Expected a depth above 0 mm, found {depth_mm:g}. The usual depth is {DEPTH_MM:g} mm.")
    if side not in SIDES:
        raise LAFlatteningError(f'Expected the side "both", "in" or "out", found "{side}".')
    if depth_mm > FARTHEST_MM:
        raise LAFlatteningError(_too_far(depth_mm))
    return (0.0 if side == "out" else -float(depth_mm)), (0.0 if side == "in" else float(depth_mm))


def _no_overlap(points: FloatArray, volume: Volume, axes_known: bool) -> str:
    """What to say where no sample is in the image: both extents, and whether a mix-up of axes explains it."""
    last = np.array(volume.values.shape[::-1]) - 1.0
    corners = volume.positions(np.stack(np.meshgrid(*((0.0, end) for end in last)), axis=-1).reshape(-1, 3))
    texts = [
        ", ".join(f"{a:.0f} to {b:.0f}" for a, b in zip(box.min(axis=0), box.max(axis=0), strict=True))
        for box in (points, corners)
    ]
    message = (
        f"The image does not overlap the surface. The surface reaches over {texts[0]} mm, the image over {texts[1]} mm "
        f"(x, y, z{' in LPS' if axes_known else ''}). "
    )
    if _fits_turned(points, volume):
        return message + _TURNED
    return message + "Check that both are of the same patient and examination, and in the same coordinates."


_TURNED = (
    "They overlap if the axes of the surface are taken the other way: its file says or leaves open whether it is in "
    "LPS or RAS, and that is probably wrong. Export the surface again with its axes named."
)


def _fits_turned(points: FloatArray, volume: Volume) -> bool:
    """Whether an image holds points (n, 3) in LPS if these are in RAS in truth."""
    index = volume.indices(points * (-1.0, -1.0, 1.0))
    last = np.array(volume.values.shape[::-1]) - 1.0
    return bool(((index >= 0.0) & (index <= last)).all(axis=1).mean() > 0.9)


def _check_unit(points: FloatArray) -> None:
    """Raise SurfaceError where a surface is of a heart chamber's size in another unit."""
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    guess = guess_unit(size)
    if guess is not None and guess[1] != 1.0:
        raise SurfaceError(
            f"The surface is {size:.3g} across, expected a chamber in mm. It is probably in {guess[0]}: multiply its "
            f"coordinates by {guess[1]:g}."
        )


def _too_far(distance_mm: float) -> str:
    return (
        f"Expected to look at most {FARTHEST_MM:g} mm from the wall, found {distance_mm:g} mm. The usual depth is "
        f"{DEPTH_MM:g} mm."
    )
