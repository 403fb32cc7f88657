"""The mitral valve: where a closed atrium is cut open towards the ventricle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import SurfaceError
from ..surface import FloatArray, Surface
from .clipping import CutPlane
from .sections import Section, plane_section

BEYOND = 0.32
"""The plane lies this share of the body's length beyond its centroid. Published are .35, and .45 for round atria; the
published cuts of two atria lie at .31 and .34, that of experts in a third, round one at .37."""
FLAT_ANGLE_DEGREES = 60.0
"""A flat valve is looked for up to this from the axis ..."""
FLAT_NORMAL_DEGREES = 8.0
"""... among triangles turned by up to this from its plane ..."""
FLAT_THICKNESS_MM = 1.0
"""... that lie in a layer so thick."""
FLAT_SHARE = 0.6
"""It must fill so much of the section next to it: then the surface was made flat there, as anatomy is not."""
FLAT_INSET_MM = 2.0
"""A flat valve is cut off so far inside its plane."""
CLEARANCE_MM = 2.0
"""The plane stays so far from the rims of veins and appendage."""
STEP_MM = 1.0
"""By which a plane is moved out until it is clear of them."""


@dataclass(frozen=True, eq=False)
class MitralPlane:
    """Where the valve is cut.

    Attributes
    ----------
    plane : its normal points towards the ventricle.
    perimeter_mm : of the rim that it makes.
    found_by : "flat" (the surface is flat there) or "rule".
    notes : what is unusual.
    """

    plane: CutPlane
    perimeter_mm: float
    found_by: str
    notes: tuple[str, ...] = ()


def mitral_plane(body: Surface, veins: Sequence[FloatArray], usual: FloatArray | None = None) -> MitralPlane:
    """The plane of the mitral valve.

    The axis of the chamber leads from the mean of the vein ostia to the centroid of the body. Where the body is flat at
    its far end the valve is there; otherwise it lies at right angles to the axis, `BEYOND` the centroid. Where that
    meets a vein or the appendage, the direction in which the valve usually lies takes the place of the axis.

    Parameters
    ----------
    body : veins and appendage cut off, valve closed; mm.
    veins : (3,) centres of the vein ostia.
    usual : (3,) unit vector from the middle of the chamber to the valve in the layout of the anatomy, if known.

    Raises
    ------
    SurfaceError : no plane cuts the valve off without meeting a vein.

    Source: Nunez-Garcia et al., with a single share of the length and the centroid of the area instead of the points.
    """
    centre, axis = chamber_axis(body, veins)
    rims = [body.points[loop] for loop in body.boundary_loops]
    clear_of = np.concatenate(rims) if rims else np.zeros((0, 3))
    flat = _flat_end(body, centre, axis)
    if flat is not None:
        place, normal = flat
        section = _clear_section(body, clear_of, place - FLAT_INSET_MM * normal, normal, 0.0)
        if section is not None:
            return MitralPlane(CutPlane(section.centre, normal), section.perimeter, "flat")
    for direction in [axis] if usual is None else [axis, usual]:
        along = (body.points[body.used_points] - centre) @ direction
        begin = BEYOND * float(np.ptp(along))
        section = _clear_section(
            body, clear_of, centre + begin * direction, direction, float(along.max()) - begin - STEP_MM
        )
        if section is None:
            continue
        notes = []
        moved = float((section.centre - centre) @ direction) - begin
        if direction is not axis:
            notes.append(
                "The plane of the mitral valve by rule would have met a vein or the appendage; it lies where the valve "
                "usually is instead. Check it."
            )
        elif moved > 0.5 * STEP_MM:
            notes.append(f"The mitral plane was moved out by {moved:.0f} mm, so that it meets no vein; check it.")
        return MitralPlane(CutPlane(section.centre, direction), section.perimeter, "rule", tuple(notes))
    raise SurfaceError(
        "No plane was found that cuts the mitral valve off without meeting a vein or the appendage. Give its plane "
        "yourself (--planes), or cut the valve open first."
    )


def chamber_axis(body: Surface, veins: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Centroid of the body's area, (3,) mm, and the unit vector to it from the mean of the vein ostia."""
    middles = body.points[body.triangles].mean(axis=1)
    centre = np.average(middles, axis=0, weights=body.triangle_areas)
    axis = centre - np.mean(np.stack(list(veins)), axis=0)
    length = float(np.linalg.norm(axis))
    if length < 1.0:
        raise SurfaceError(
            "The veins lie all round the chamber, so that the side of the mitral valve cannot be told. Give its plane "
            "yourself (--planes)."
        )
    return centre, axis / length


def _flat_end(body: Surface, centre: FloatArray, axis: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Place and outward normal of the flat region at the far end of the body; None without one."""
    middles = body.points[body.triangles].mean(axis=1)
    area = body.triangle_areas
    normals = np.cross(
        body.points[body.triangles[:, 1]] - body.points[body.triangles[:, 0]],
        body.points[body.triangles[:, 2]] - body.points[body.triangles[:, 0]],
    )
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    far = ((middles - centre) @ axis > 0.0) & (normals @ axis > np.cos(np.radians(FLAT_ANGLE_DEGREES)))
    middles, area, normals = middles[far], area[far], normals[far]
    if len(area) == 0:
        return None
    normal = axis
    place = centre
    largest = 0.0
    # From several normals of the surface itself to the layer with the largest area, then to the plane fitted to it.
    for start in normals[np.argsort(-area)[:: max(1, len(area) // 60)]]:
        here, layer = start, np.zeros(len(area), bool)
        for _ in range(4):
            alike = normals @ here > np.cos(np.radians(FLAT_NORMAL_DEGREES))
            if not alike.any():
                break
            offset = middles @ here
            half = 0.5 * FLAT_THICKNESS_MM
            edges = np.arange(offset[alike].min(), offset[alike].max() + FLAT_THICKNESS_MM, 0.5 * half)
            order = np.argsort(offset[alike])
            ordered = offset[alike][order]
            below = np.concatenate([[0.0], np.cumsum(area[alike][order])])
            share = below[np.searchsorted(ordered, edges + half)] - below[np.searchsorted(ordered, edges - half)]
            layer = alike & (np.abs(offset - edges[int(share.argmax())]) <= half)
            mean = (normals[layer] * area[layer, None]).sum(axis=0)
            here = mean / np.linalg.norm(mean)
        if area[layer].sum() > largest:
            largest = float(area[layer].sum())
            normal, place = here, np.average(middles[layer], axis=0, weights=area[layer])
    section = plane_section(body, place - FLAT_INSET_MM * normal, normal)
    if section is None or not section.around or largest < FLAT_SHARE * section.area:
        return None
    return place, normal


def _clear_section(
    body: Surface, rims: FloatArray, place: FloatArray, normal: FloatArray, reach: float
) -> Section | None:
    """The first section from a place outwards, up to a distance, that all rims are inwards of."""
    for moved in np.arange(0.0, max(reach, 0.0) + 1e-9, STEP_MM):
        at = place + moved * normal
        if ((rims - at) @ normal > -CLEARANCE_MM).any():
            continue
        section = plane_section(body, at, normal)
        if section is not None and section.around:
            return section
    return None
