"""Recognition: which opening or protrusion of an atrium is which vein, and which is the appendage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import permutations

import numpy as np
from scipy.spatial.transform import Rotation

from ..anatomy import Anatomy
from ..errors import SurfaceError
from ..surface import FloatArray, IntArray

TILT_DEGREES = 30.0
"""A heart lies in the chest turned by up to this from the mean layout (4 to 18 degrees on twelve atria)."""
WORST_MISFIT = 0.6
"""Sum over the openings of 1 - cos of the angle off the layout, above which an atrium is not recognised: all 20 degrees
off (.02 to .15 on real atria, .5 on the phantom; mirrored ones have .9 or more)."""
LIKELY_MISFIT = 0.3
"""A better fit than this is a sure one, if nothing else fits nearly as well."""
SMALLEST_LEAD = 0.08
"""... that is, if the second best assignment has a misfit larger by this."""
MIRROR_RATIO = 0.75
"""Without patient axes the layout must fit better than its mirror image by this factor."""
MOST_CANDIDATES = 9
"""More are not tried (their number of assignments grows as a factorial): those that stand out least are left out."""
LOW_RISE_MM = 5.0
"""A tip that rises less is a less likely vein: it adds a misfit of `LOW_RISE_MISFIT` or less."""
LOW_RISE_MISFIT = 0.15
WIDER_RATIO = 1.2
"""Where two open rims fit as one vein, the one wider by this is it: a further vein is narrower than the four."""
LEFT_OPEN_MISFIT = 0.15
"""Taking a protrusion although an open rim is left over adds so much: what was cut open was an opening."""

_UNLIKE = "The veins and the appendage do not lie as in a left atrium"


class VeinsMissingError(SurfaceError):
    """Veins or the appendage were not found; not that they are surely there and mirrored or turned."""


@dataclass(frozen=True)
class Recognition:
    """Which candidate is which.

    Attributes
    ----------
    index : hole -> number of the candidate.
    rotation : (3, 3) turns the mean layout into that of this atrium.
    misfit : sum over the holes of 1 - cos(angle off the turned layout).
    lead : how much larger the misfit of the next best assignment is.
    confidence : "high" or "low".
    notes : what makes it doubtful, in words.
    mirrored : hole -> number of the candidate if the atrium were mirrored and turned, where that would fit as well as
        an atrium does; empty where it would not.
    """

    index: Mapping[str, int]
    rotation: FloatArray
    misfit: float
    lead: float
    confidence: str
    notes: tuple[str, ...] = ()
    mirrored: Mapping[str, int] = field(default_factory=dict)


def recognise(
    directions: FloatArray,
    rises_mm: Sequence[float],
    anatomy: Anatomy,
    space: str | None = "LPS",
    perimeters_mm: Sequence[float] | None = None,
) -> Recognition:
    """Assign candidates to the holes of an anatomy by their directions from the middle of the chamber.

    Every assignment is tried: the mean layout of the anatomy (`Anatomy.layout`) is turned to fit it best (Kabsch 1976),
    by no more than `TILT_DEGREES` where the patient axes are known, and the assignment with the smallest misfit wins.

    Parameters
    ----------
    directions : (k, 3) unit vectors from the middle of the chamber to the candidates.
    rises_mm : (k,) how far each stands out (`tips.Tip.rise_mm`); infinite for openings.
    space : axes of the directions, "LPS" or "RAS"; None where they are not the patient's.
    perimeters_mm : (k,) of the open rims, NaN for others; decides which of two that fit a vein is it.

    Raises
    ------
    VeinsMissingError : too few candidates; unlike the anatomy.
    SurfaceError : mirrored; turned away from the patient axes.
    """
    holes = anatomy.holes
    if not anatomy.layout:
        raise SurfaceError(f'The anatomy "{anatomy.name}" states no layout, so that its openings are not recognised.')
    if len(directions) < len(holes):
        raise VeinsMissingError(
            f"Expected {len(holes)} veins and appendage ({', '.join(holes)}), found {len(directions)}. "
            "If some are short or merged, mark the tip of each (--tips), or segment them farther out."
        )
    layout = np.array([anatomy.layout[hole] for hole in holes])
    layout /= np.linalg.norm(layout, axis=1, keepdims=True)
    if space == "RAS":
        layout = layout * [-1.0, -1.0, 1.0]
    rises = np.asarray(rises_mm, np.float64)
    chosen = np.sort(np.argsort(-rises, kind="stable")[:MOST_CANDIDATES])
    orders = chosen[np.array(list(permutations(range(len(chosen)), len(holes))))]
    # An open rim has an infinite rise, so that each costs nothing; those that could be taken and are not cost.
    is_open = np.isinf(rises)
    taken = is_open[orders].sum(axis=1)
    extra = (LOW_RISE_MISFIT * np.exp(-rises / LOW_RISE_MM))[orders].sum(axis=1)
    extra += LEFT_OPEN_MISFIT * (min(int(is_open.sum()), len(holes)) - taken)
    limit = 180.0 if space is None else TILT_DEGREES

    best = _fit(layout, directions, orders, extra, limit)
    if space is None:
        mirrored = _fit(_mirror(layout), directions, orders, extra, 180.0)
        if best.misfit <= WORST_MISFIT and best.misfit > MIRROR_RATIO * mirrored.misfit:
            raise SurfaceError(
                "Without patient axes the atrium and its mirror image look too much alike to tell right from left. "
                "Give the surface in patient axes, or mark the tip of each vein (--tips)."
            )
    if best.misfit > LIKELY_MISFIT:
        _refuse_other_axes(layout, directions, orders, extra, best, space)
    if best.misfit > WORST_MISFIT:
        raise VeinsMissingError(
            f"{_UNLIKE} (misfit {best.misfit:.2f}, at most {WORST_MISFIT:g}). Expected one with four pulmonary veins "
            "and an appendage, and no ventricle attached. If it is one, mark the tip of each vein (--tips)."
        )
    notes: list[str] = []
    if best.lead < SMALLEST_LEAD and perimeters_mm is not None:
        wider = _wider(best, np.asarray(perimeters_mm, np.float64))
        if wider is not None:
            vein, taken_mm, other_mm = holes[wider[0]], *wider[1:]
            notes.append(
                f"Two openings fit {vein}: the wider, {taken_mm:.0f} mm round, was taken for it, and the other "
                f"({other_mm:.0f} mm) for a further vein."
            )
            second = _fit(layout, directions, best.second[None], np.zeros(1), limit)
            best = replace(second, second=best.order, lead=best.lead)
    names = {hole: int(k) for hole, k in zip(holes, best.order, strict=True)}
    if best.lead < SMALLEST_LEAD and not notes:
        doubtful = [hole for hole, a, b in zip(holes, best.order, best.second, strict=True) if a != b]
        notes.append(f"{' and '.join(doubtful)} could also be taken otherwise; check which is which.")
    if best.misfit > LIKELY_MISFIT:
        notes.append("The veins lie unusually for a left atrium; check which is which.")
    mirror = _fit(_mirror(layout), directions, orders, extra, 180.0)
    exchanged = dict(zip(holes, map(int, mirror.order), strict=True)) if mirror.misfit <= LIKELY_MISFIT else {}
    return Recognition(
        names, best.rotation, best.misfit, best.lead, "low" if notes else "high", tuple(notes), exchanged
    )


def _wider(best: _Fit, perimeters: FloatArray) -> tuple[int, float, float] | None:
    """Where the second best assignment differs by a wider open rim only: number of the hole, both perimeters."""
    differs = np.flatnonzero(best.order != best.second)
    if len(differs) != 1:
        return None
    first, second = (float(perimeters[order[differs[0]]]) for order in (best.order, best.second))
    # False for tips, which are NaN.
    return (int(differs[0]), second, first) if second >= WIDER_RATIO * first else None


@dataclass(frozen=True)
class _Fit:
    order: IntArray
    second: IntArray
    misfit: float
    lead: float
    rotation: FloatArray
    degrees: float


def _mirror(layout: FloatArray) -> FloatArray:
    return layout * [-1.0, 1.0, 1.0]


def _fit(layout: FloatArray, directions: FloatArray, orders: IntArray, extra: FloatArray, limit: float) -> _Fit:
    """The best of all assignments, the layout turned by at most `limit` degrees."""
    found = directions[orders]
    left, _, right = np.linalg.svd(np.einsum("bki,kj->bij", found, layout))
    # No reflections: the last axis is turned where the best orthogonal matrix is one.
    left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    turn = Rotation.from_matrix(left @ right).as_rotvec()
    angle = np.linalg.norm(turn, axis=1)
    turn *= np.minimum(1.0, np.radians(limit) / np.maximum(angle, 1e-12))[:, None]
    rotation = Rotation.from_rotvec(turn).as_matrix()
    off = 1.0 - np.einsum("bij,kj,bki->bk", rotation, layout, found)
    misfit = off.sum(axis=1)
    cost = misfit + extra
    ranked = np.argsort(cost, kind="stable")
    first, second = ranked[0], ranked[min(1, len(ranked) - 1)]
    lead = np.inf if len(ranked) == 1 else float(cost[second] - cost[first])
    return _Fit(
        orders[first], orders[second], float(misfit[first]), lead, rotation[first], float(np.degrees(angle[first]))
    )


def _refuse_other_axes(
    layout: FloatArray, directions: FloatArray, orders: IntArray, extra: FloatArray, best: _Fit, space: str | None
) -> None:
    """Raise SurfaceError where a poor fit is explained better by a mirror image or by other axes."""
    if space is None:
        return
    better = min(WORST_MISFIT, MIRROR_RATIO * best.misfit)
    mirrored = _fit(_mirror(layout), directions, orders, extra, TILT_DEGREES)
    turned = _fit(layout, directions, orders, extra, 180.0)
    other = _fit(_mirror(layout), directions, orders, extra, 180.0)
    x, y, z = (layout if space == "LPS" else layout * [-1.0, -1.0, 1.0]).T
    as_carto = _fit(np.stack([x, z, -y], axis=1), directions, orders, extra, TILT_DEGREES)
    swapped = _fit(layout * [-1.0, -1.0, 1.0], directions, orders, extra, TILT_DEGREES)
    if mirrored.misfit <= min(better, turned.misfit / MIRROR_RATIO):
        raise SurfaceError(
            f"{_UNLIKE}, but as in its mirror image. Right and left seem exchanged: check the direction matrix of the "
            "image and the patient axes of the file."
        )
    if swapped.misfit <= min(better, MIRROR_RATIO * other.misfit):
        named = "RAS" if space == "LPS" else "LPS"
        raise SurfaceError(
            f"{_UNLIKE} in {space}, the axes of the file, but as in {named}. Save the file with its axes named "
            f"(SPACE={named}), or give --axes {named}."
        )
    if as_carto.misfit <= min(better, MIRROR_RATIO * other.misfit):
        raise SurfaceError(
            f"{_UNLIKE} in {space}, the axes of the file, but as in the axes of CARTO (to the left, the head, the "
            "front), which exports of it keep. Give --axes CARTO."
        )
    if turned.misfit <= min(better, MIRROR_RATIO * other.misfit):
        raise SurfaceError(
            f"{_UNLIKE} in patient axes ({space}), but would if turned by {turned.degrees:.0f} degrees. Check the axes "
            "of the file (LPS or RAS), or give --ignore-axes if its axes are not the patient's."
        )
    if other.misfit <= min(better, MIRROR_RATIO * turned.misfit):
        raise SurfaceError(
            f"{_UNLIKE}, but as in its mirror image, turned by {other.degrees:.0f} degrees. Check the direction matrix "
            "of the image and the patient axes of the file."
        )
    if turned.misfit <= better:
        # Not final: among fainter tips there may be veins that fit as the axes say.
        raise VeinsMissingError(
            f"{_UNLIKE} in patient axes ({space}), but would if turned by {turned.degrees:.0f} degrees, and nearly as "
            f"well mirrored and turned by {other.degrees:.0f} degrees: the axes of the file are probably not the "
            "patient's. Give the surface in patient axes; or mark the tip of each vein (--tips), so that right and "
            "left are known, and give --ignore-axes."
        )
