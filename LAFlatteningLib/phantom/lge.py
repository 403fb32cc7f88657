"""Scar with known area and gaps, and a late gadolinium enhancement (LGE) volume that shows it.

Scar is a function of the direction from the centre of a spherical body (see `LAFlatteningLib.phantom`): rings
round veins, with gaps of known width, and round patches. Its extent is therefore known without any mesh. The
volume paints blood, a wall of stated thickness, scar and background from the signed distance to the surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import SimpleITK as sitk
from numpy.typing import ArrayLike

from ..errors import LAFlatteningError
from .grid import Bounded, FloatArray, Grid
from .sphere import Caps, angles_between, direction, tangent_frame


def ramp(depth: FloatArray, width: float) -> FloatArray:
    """A smooth step: 0 below -width/2, 1 above width/2, 1/2 at 0 (cubic, so it is reached exactly)."""
    t = np.clip(depth / width + 0.5, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


@dataclass(frozen=True)
class Gap:
    """Healthy tissue across a ring, `width` mm wide at every distance from the vein.

    The gap is the strip of body points nearer than width/2 to the great circle that leaves the centre of the ring
    at `angle`. Its two sides are parallel curves, so the shortest way from scar to scar across it is `width`, anywhere.

    Attributes
    ----------
    angle : degrees, counter-clockwise seen from outside; 0 is superior (see `tangent_frame`).
    width : mm.
    """

    angle: float
    width: float


@dataclass(frozen=True)
class ScarRing:
    """An ablation line round one vein, or round a pair together.

    Attributes
    ----------
    veins : openings that the line encloses.
    inner, outer : distances along the body from the ostium (of the nearest of `veins`) between which there is scar, mm.
    gaps : where it is interrupted; angles are counted about the mean direction of `veins`.
    """

    veins: tuple[str, ...]
    inner: float
    outer: float
    gaps: tuple[Gap, ...] = ()

    def axis(self, caps: Caps) -> FloatArray:
        """Unit vector to the centre of the ring."""
        total = np.sum([caps.axes[vein] for vein in self.veins], axis=0)
        return total / np.linalg.norm(total)

    def gap_depth(self, gap: Gap, directions: FloatArray, caps: Caps) -> FloatArray:
        """How far body points lie inside a gap's strip, mm, negative outside."""
        axis = self.axis(caps)
        first, second = tangent_frame(axis)
        angle = np.radians(gap.angle)
        along = np.cos(angle) * first + np.sin(angle) * second
        off = caps.radius * np.arcsin(np.clip(np.abs(directions @ np.cross(axis, along)), 0.0, 1.0))
        return np.where(directions @ along > 0.0, 0.5 * gap.width - off, -off - 0.5 * gap.width)

    def band_depth(self, directions: FloatArray, caps: Caps) -> FloatArray:
        """How far body points lie inside the ring without its gaps, mm, negative outside."""
        distance = np.min([caps.distance(vein, directions) for vein in self.veins], axis=0)
        return np.minimum(distance - self.inner, self.outer - distance)

    def depth(self, directions: FloatArray, caps: Caps) -> FloatArray:
        """How far body points lie inside the scar of this ring, mm, negative outside; (n,) for (n, 3)."""
        depth = self.band_depth(directions, caps)
        for gap in self.gaps:
            depth = np.minimum(depth, -self.gap_depth(gap, directions, caps))
        return depth


@dataclass(frozen=True)
class ScarPatch:
    """A round patch of scar: body points within `radius` mm of a centre, along the body.

    Its area is ``2 pi R^2 (1 - cos(radius / R))`` on a body of radius R.

    Attributes
    ----------
    azimuth, elevation : direction of its centre, degrees, see `direction`.
    radius : mm.
    """

    azimuth: float
    elevation: float
    radius: float

    def depth(self, directions: FloatArray, caps: Caps) -> FloatArray:
        """How far body points lie inside the patch, mm, negative outside; (n,) for (n, 3)."""
        centre = direction(self.azimuth, self.elevation)
        return self.radius - caps.radius * angles_between(directions, centre)


@dataclass(frozen=True)
class ScarPattern:
    """All scar of a phantom: the union of rings and patches, outside the openings.

    Use `check` once for a body; `LAFlatteningLib.phantom.PhantomShape` does.
    """

    rings: tuple[ScarRing, ...] = ()
    patches: tuple[ScarPatch, ...] = ()

    def depth(self, directions: FloatArray, caps: Caps) -> FloatArray:
        """How far body points lie inside scar, mm, negative outside: scar is where it is positive.

        Parameters
        ----------
        directions : (n, 3) unit vectors from the centre of the body.

        Returns
        -------
        (n,); next to one edge of the scar it is the distance to that edge along the body.
        """
        depth = np.full(len(directions), -np.pi * caps.radius)
        parts: tuple[ScarRing | ScarPatch, ...] = (*self.rings, *self.patches)
        for part in parts:
            depth = np.maximum(depth, part.depth(directions, caps))
        for opening in caps.axes:
            depth = np.minimum(depth, caps.distance(opening, directions))
        return depth

    def check(self, caps: Caps) -> None:
        """Raise LAFlatteningError where the pattern is impossible or a gap is not free over its whole width."""
        for ring in self.rings:
            unknown = [vein for vein in ring.veins if vein not in caps.axes]
            if unknown or not ring.veins:
                raise LAFlatteningError(
                    f"A scar ring needs openings out of {', '.join(caps.axes)}, found {', '.join(unknown) or 'none'}."
                )
            if not 0.0 <= ring.inner < ring.outer:
                raise LAFlatteningError(
                    f"Scar ring round {'+'.join(ring.veins)}: expected 0 <= inner < outer (mm from the ostium), "
                    f"found inner {ring.inner:g}, outer {ring.outer:g}."
                )
            for gap in ring.gaps:
                self._check_gap(ring, gap, caps)
        for patch in self.patches:
            if not 0.0 < patch.radius < 0.5 * np.pi * caps.radius:
                raise LAFlatteningError(
                    f"Scar patch: expected a radius between 0 and {0.5 * np.pi * caps.radius:.1f} mm (a quarter of the "
                    f"circumference of the body), found {patch.radius:g}."
                )

    def _check_gap(self, ring: ScarRing, gap: Gap, caps: Caps) -> None:
        name = f"The gap at {gap.angle:g} degrees of the scar ring round {'+'.join(ring.veins)}"
        widest = 2.0 * caps.radius * min(caps.angles[vein] for vein in ring.veins)
        if not 0.0 < gap.width < widest:
            raise LAFlatteningError(
                f"{name}: expected a width between 0 and {widest:.1f} mm (the diameter of the ostium), "
                f"found {gap.width:g}."
            )
        # The strip where it crosses the ring, sampled to 0.2 mm: along the great circle and off it.
        axis = ring.axis(caps)
        first, second = tangent_frame(axis)
        angle = np.radians(gap.angle)
        along = np.cos(angle) * first + np.sin(angle) * second
        far = np.arange(0.0, 0.5 * np.pi, 0.2 / caps.radius)[:, None, None]
        off = np.linspace(-0.5, 0.5, int(5 * gap.width) + 3)[None, :, None] * 0.999 * gap.width / caps.radius
        line = np.cos(far) * axis + np.sin(far) * along
        strip = (np.cos(off) * line + np.sin(off) * np.cross(axis, along)).reshape(-1, 3)
        strip = strip[ring.band_depth(strip, caps) > 0.0]
        others = ScarPattern(tuple(other for other in self.rings if other is not ring), self.patches)
        if len(strip) == 0:
            raise LAFlatteningError(f"{name} does not cross the ring. Choose another angle.")
        if (others.depth(strip, caps) > 0.0).any():
            raise LAFlatteningError(f"{name} is filled by other scar. Choose another angle, or a narrower gap.")
        for other in ring.gaps:
            if other is not gap and (ring.gap_depth(other, strip, caps) > 0.0).any():
                raise LAFlatteningError(f"{name} overlaps the one at {other.angle:g} degrees. Move them apart.")


@dataclass(frozen=True)
class LgeModel:
    """Intensities of an LGE image, in arbitrary units, and the wall they show.

    With the default values scar is what exceeds 1.2 times the blood pool (an image intensity ratio in clinical
    use): half way between healthy wall and scar lies at 120.

    Attributes
    ----------
    blood, healthy, scar, background : intensities.
    wall : thickness of the wall outside the surface (which is its inner side), mm.
    transition : width over which intensities change from one tissue to the next (partial volume), mm.
    """

    blood: float = 100.0
    healthy: float = 70.0
    scar: float = 170.0
    background: float = 30.0
    wall: float = 2.5
    transition: float = 1.0

    def __post_init__(self) -> None:
        if not 0.0 < self.transition < self.wall:
            raise LAFlatteningError(
                "Expected 0 < transition < wall (mm), so that the wall shows its own intensity in its middle, "
                f"found transition {self.transition:g}, wall {self.wall:g}."
            )
        if not self.background <= self.healthy <= self.blood < self.scar:
            raise LAFlatteningError(
                "Expected background <= healthy <= blood < scar, as in a late enhancement image, found "
                f"{self.background:g}, {self.healthy:g}, {self.blood:g}, {self.scar:g}."
            )

    def tissue(self, scar_depth: FloatArray) -> FloatArray:
        """Intensity in the middle of the wall, where the scar is `scar_depth` mm away from its edge."""
        return self.healthy + (self.scar - self.healthy) * ramp(scar_depth, self.transition)

    def intensity(self, distance: FloatArray, scar_depth: FloatArray, valve_depth: FloatArray) -> FloatArray:
        """Intensity at points of space.

        Parameters
        ----------
        distance : (n,) signed distance to the surface, mm, negative inside.
        scar_depth : (n,) of the nearest point of the surface, see `ScarPattern.depth`.
        valve_depth : (n,) how far inside the cone of the valve, mm; the cone holds blood (the ventricle's).
        """
        tissue = self.tissue(scar_depth)
        value = self.blood + (tissue - self.blood) * ramp(distance, self.transition)
        value += (self.background - tissue) * ramp(distance - self.wall, self.transition)
        return value + (self.blood - value) * ramp(valve_depth, self.transition)

    def maximum(self, scar_depth: FloatArray, valve_depth: FloatArray) -> FloatArray:
        """Largest intensity along the normal of a surface point, from any depth beyond the inner transition.

        Along the normal `scar_depth` and `valve_depth` stay the same and `intensity` goes monotonically from
        blood to tissue to background, so the maximum is one of the first two.
        """
        tissue = self.tissue(scar_depth)
        return np.maximum(self.blood, tissue + (self.blood - tissue) * ramp(valve_depth, self.transition))


class Imaged(Bounded, Protocol):
    """What a volume is made of; `LAFlatteningLib.phantom.PhantomShape` is one."""

    def intensity(self, points: FloatArray, model: LgeModel) -> FloatArray:
        """Intensity at points (n, 3), (n,)."""


def make_lge_volume(
    shape: Imaged,
    spacing: Sequence[float] = (0.625, 0.625, 1.25),
    direction: ArrayLike | None = None,
    noise: float = 0.0,
    *,
    seed: int = 0,
    margin: float = 10.0,
    model: LgeModel | None = None,
) -> sitk.Image:
    """An LGE image of a phantom.

    Parameters
    ----------
    shape : a `LAFlatteningLib.phantom.PhantomShape` (closed: long veins, appendage, valve with the ventricle beyond).
    spacing : of the voxels, mm; the default is that of the 2018 Atrial Segmentation Challenge.
    direction : (3, 3) or 9 numbers row by row, as SimpleITK gives it: column k is the direction of image axis k, in
        LPS. Orthonormal, left- or right-handed; None for axial slices.
    noise : standard deviation of added Gaussian noise, in units of intensity.
    seed : of the noise; the same seed gives the same noise.
    margin : background round the shape, mm.
    model : intensities, wall and blur; `LgeModel()` if None.

    Returns
    -------
    SimpleITK.Image, float32, origin and direction in LPS, mm.

    Raises
    ------
    LAFlatteningError : spacing, direction, noise or margin out of range.

    Examples
    --------
    >>> from LAFlatteningLib.phantom import left_atrium_shape
    >>> make_lge_volume(left_atrium_shape(), spacing=(4, 4, 4)).GetPixelIDTypeAsString()
    '32-bit float'
    """
    grid = Grid.around(shape, spacing, direction, margin)
    if not (np.isfinite(noise) and noise >= 0.0):
        raise LAFlatteningError(f"Expected a standard deviation of the noise of 0 or more, found {noise}.")
    tissues = model or LgeModel()
    values = grid.fill(lambda points: shape.intensity(points, tissues), np.float32)
    if noise > 0.0:
        values += np.random.default_rng(seed).normal(0.0, noise, values.shape).astype(np.float32)
    return grid.image(values)
