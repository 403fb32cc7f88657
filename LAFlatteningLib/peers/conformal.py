"""The plain conformal map of the atrium to a disk: angles kept as well as they can be, no vein at a fixed place."""

from __future__ import annotations

import time

import numpy as np
from scipy import sparse

from ..flattening.flat_map import FlatMap
from ..progress import ProgressCallback, report
from ..solvers import Factorisation, harmonic
from ..surface import FloatArray, IntArray
from .peer_map import OuterRim, PeerMap, whole_cavity

STEPS = 60
"""Most Newton steps on the places of the rim; 8 to 20 are usual."""
TOLERANCE = 1e-12
"""Steps stop where one lowers the conformal energy by less than this share of it (or of 1)."""
CENTRING = 200
"""Most steps that bring the centre of area to the centre of the disk."""
COLUMNS_AT_ONCE = 128
"""Right sides solved together, to keep memory small."""
SOURCE = (
    "Figure (a) of Nunez-Garcia et al.: all openings but the valve are closed, mapped conformally to a disk, opened"
)


def conformal_map(flat_map: FlatMap, progress: ProgressCallback | None = None) -> PeerMap:
    """The atrium, its veins covered, mapped conformally to a disk of radius 0.5 with the valve on its rim.

    Parameters
    ----------
    flat_map : our map of the atrium, for its cavity, covers and seeds.

    Returns
    -------
    PeerMap without fixed places.

    Notes
    -----
    Deviations: the published figure solves for the inner points only, with the rim at equal steps (our strategy
    ``mitral``, `flattening.strategies`), and that is not conformal near the rim. Here the places along the rim are
    found as well (`conformal_disk`). Of the conformal maps, which differ by a Moebius transformation, the one is taken
    whose centre is the centre of the atrium's area and on which the seeds of the valve are nearest to their angles in
    the template.

    Raises
    ------
    Cancelled : by `progress`.
    """
    report(progress, 0.0, "Mapping conformally")
    began = time.perf_counter()
    cavity = flat_map.cavity
    rim = OuterRim.of(flat_map)
    flat = conformal_disk(cavity.closed.laplacian, cavity.closed.mass, cavity.ids[rim.ids], rim.turns)
    seconds = time.perf_counter() - began + flat_map.seconds["cavity"]
    report(progress, 1.0, "Mapped conformally")
    return whole_cavity(
        flat_map,
        "conformal",
        "conformal, valve on the rim",
        0.5 * flat[cavity.ids],
        seconds,
        SOURCE,
        ("The places along the rim are free; the disk is centred on the atrium's area and turned to the seeds.",),
    )


def conformal_disk(laplacian: sparse.csr_matrix, mass: FloatArray, rim: IntArray, turns: FloatArray) -> FloatArray:
    """The conformal map of a surface with one rim to the unit disk.

    Among all maps with the rim on the circle, in order, the conformal energy (Dirichlet energy minus area) is least,
    and 0 on a smooth surface, for the conformal one. For given places on the rim the rest is harmonic, so that the
    energy is a function of the angles of the rim only, a quadratic form of their sines and cosines with the Schur
    complement of the Laplacian; it is minimised by damped Newton steps.

    Parameters
    ----------
    laplacian : (n, n) cotangent Laplacian of a surface with no other rim.
    mass : (n,) area round each point, for the centre.
    rim : (k,) its points in order, counter-clockwise on the map.
    turns : (k,) where to begin, in turns, increasing; the result is turned to be nearest to them.

    Returns
    -------
    (n, 2) places in the unit disk, the points of the rim on the circle.

    Source: the conformal energy, e.g. Hutchinson, "Computing conformal maps and minimal surfaces", 1991; Yueh et al.,
    "An efficient energy minimization for conformal parameterizations", J. Sci. Comput. 73, 2017.
    """
    schur = _schur_complement(laplacian, rim)
    held = np.linspace(0, len(rim), 3, endpoint=False).astype(np.int64)
    angle = _relax(schur, 2.0 * np.pi * turns, held)
    flat, _ = harmonic(laplacian, rim, np.stack([np.cos(angle), np.sin(angle)], axis=1))
    places = _centred(flat[:, 0] + 1j * flat[:, 1], mass, rim)
    places *= np.exp(1j * np.angle((np.exp(2j * np.pi * turns) * np.conj(places[rim])).sum()))
    # A Moebius transformation of the corners is harmonic only nearly: solve again, so that it is.
    flat, _ = harmonic(laplacian, rim, np.stack([places[rim].real, places[rim].imag], axis=1))
    return flat


def _schur_complement(laplacian: sparse.csr_matrix, rim: IntArray) -> FloatArray:
    """(k, k) the form whose value for rim values x is twice the least Dirichlet energy with them."""
    n = laplacian.shape[0]
    inner = np.ones(n, bool)
    inner[rim] = False
    free = np.flatnonzero(inner)
    rows = laplacian[free]
    factorisation, coupling = Factorisation(rows[:, free]), rows[:, rim].tocsc()
    schur = laplacian[rim][:, rim].toarray()
    for first in range(0, len(rim), COLUMNS_AT_ONCE):
        part = slice(first, first + COLUMNS_AT_ONCE)
        schur[:, part] -= coupling.T @ factorisation.solve(coupling[:, part].toarray())
    return 0.5 * (schur + schur.T)


def _relax(schur: FloatArray, angle: FloatArray, held: IntArray) -> FloatArray:
    """Angles of the rim with the least conformal energy, three of them held against Moebius transformations."""
    moving = np.ones(len(angle), bool)
    moving[held] = False

    def energy(at: FloatArray) -> float:
        c, s = np.cos(at), np.sin(at)
        return float(0.5 * (c @ schur @ c + s @ schur @ s) - 0.5 * np.sin(_gaps(at)).sum())

    now = energy(angle)
    for _ in range(STEPS):
        c, s, gap = np.cos(angle), np.sin(angle), _gaps(angle)
        sc, ss = schur @ c, schur @ s
        gradient = -s * sc + c * ss - 0.5 * (np.cos(np.roll(gap, 1)) - np.cos(gap))
        hessian = schur * (np.outer(c, c) + np.outer(s, s)) - np.diag(c * sc + s * ss)
        # Second derivatives of the area of the polygon.
        bend, k = 0.5 * np.sin(gap), np.arange(len(angle))
        hessian[k, k] += bend + np.roll(bend, 1)
        hessian[k, (k + 1) % len(k)] -= bend
        hessian[(k + 1) % len(k), k] -= bend
        values, vectors = np.linalg.eigh(hessian[np.ix_(moving, moving)])
        # Away from the minimum the energy need not be convex: take the nearest convex model.
        values = np.maximum(np.abs(values), 1e-9 * np.abs(values).max())
        step = np.zeros(len(angle))
        step[moving] = -vectors @ ((vectors.T @ gradient[moving]) / values)
        # No two points of the rim may pass each other.
        closing = np.roll(step, -1) - step
        room = np.divide(-_gaps(angle), closing, out=np.full(len(angle), np.inf), where=closing < 0.0).min()
        share = min(1.0, 0.9 * float(room))
        while share > 1e-10 and energy(angle + share * step) > now + 1e-4 * share * float(gradient @ step):
            share *= 0.5
        if share <= 1e-10:
            break
        angle = angle + share * step
        before, now = now, energy(angle)
        if before - now <= TOLERANCE * max(1.0, abs(now)):
            break
    return angle


def _gaps(angle: FloatArray) -> FloatArray:
    """(k,) angle from each point of the rim to the next, once round in all."""
    return np.diff(angle, append=angle[0] + 2.0 * np.pi)


def _centred(places: FloatArray, mass: FloatArray, rim: IntArray) -> FloatArray:
    """Complex places in the unit disk after the Moebius transformation that brings the centre of mass to 0."""
    for _ in range(CENTRING):
        centre = complex((mass * places).sum() / mass.sum())
        if abs(centre) < 1e-10:
            break
        places = (places - centre) / (1.0 - np.conj(centre) * places)
    places[rim] /= np.abs(places[rim])
    return places
