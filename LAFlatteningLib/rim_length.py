"""Length along a rim, where the rim is ragged."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .surface import FloatArray

SMOOTHING_MM = 2.5
"""Rims are smoothed over this length (standard deviation of a Gaussian), before lengths along them are measured."""

GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(4)
"""For integrals over a side."""


def rim_lengths(points: FloatArray) -> FloatArray:
    """Length along a rim from its first point to each of its points and once round, (k + 1,), mm.

    The rim of a segmentation, or of a mesh from which triangles were taken, is a saw: its length depends on the
    triangles, by a third in places, and a remeshed rim has lost most of it. So the length is that of the rim smoothed
    over `SMOOTHING_MM`. On a circle, that does not change the share of the rim between two points.

    Parameters
    ----------
    points : (k, 3) mm, the closed rim in order, without its first point again.

    Examples
    --------
    >>> square = np.array([[0.0, 0, 0], [30, 0, 0], [30, 30, 0], [0, 30, 0]])
    >>> length = rim_lengths(square)
    >>> (length / length[-1]).round(6).tolist()
    [0.0, 0.25, 0.5, 0.75, 1.0]
    """
    sides = np.diff(points, axis=0, append=points[:1])
    length = np.linalg.norm(sides, axis=1)
    raw = np.concatenate([[0.0], np.cumsum(length)])
    directions = sides / np.maximum(length, 1e-12)[:, None]
    # The direction of the rim is constant on each side. Its Fourier coefficients are exact; a Gaussian is a factor on
    # each, and nothing is left of the higher ones.
    count = int(np.ceil(8.0 * raw[-1] / (2.0 * np.pi * SMOOTHING_MM)))
    frequency = 2.0 * np.pi / raw[-1] * np.arange(1, count + 1)
    steps = np.diff(_harmonics(-frequency[0] * raw, count), axis=1)
    factor = np.exp(-0.5 * (SMOOTHING_MM * frequency) ** 2) / frequency
    # (The rim is closed: the mean of its direction is 0.)
    coefficients = (2j / raw[-1] * factor)[:, None] * (steps @ directions)
    at = (raw[:-1, None] + 0.5 * length[:, None] * (1.0 + GAUSS_NODES)).reshape(-1)
    smoothed = (_harmonics(frequency[0] * at, count).T @ coefficients).real
    along = 0.5 * length * (np.linalg.norm(smoothed, axis=1).reshape(-1, 4) @ GAUSS_WEIGHTS)
    # Never without length, so that no two points fall together.
    return np.concatenate([[0.0], np.cumsum(np.maximum(along, 1e-3 * length))])


def _harmonics(angle: FloatArray, count: int) -> NDArray[np.complex128]:
    """exp(i j angle) for j = 1, 2, ..., (count, angles); as powers, many times faster than one exponential each."""
    return np.cumprod(np.broadcast_to(np.exp(1j * angle), (count, len(angle))), axis=0)


HARMONICS = 4
"""An ostium is a loop of so many harmonics; what is finer is the saw."""


def rim_perimeter(points: FloatArray) -> float:
    """Perimeter of an opening, mm: the length of its rim's first `HARMONICS` Fourier harmonics.

    Right to 0.2 % for circles of 50 points, 1.3 % of 17 points, and to 1.2 % for ellipses up to 1 : 2. A remeshed rim,
    which has lost most of its saw, keeps it to 1 or 2 %; its length along the edges changes by up to a third.

    Parameters
    ----------
    points : (k, 3) mm, the closed rim in order, without its first point again.

    Examples
    --------
    >>> turns = np.linspace(0.0, 2.0 * np.pi, 50, endpoint=False)
    >>> circle = 10.0 * np.stack([np.cos(turns), np.sin(turns), 0.0 * turns], axis=1)
    >>> round(rim_perimeter(circle), 1)
    62.7
    """
    count = 64 * HARMONICS
    # Even steps along the smoothed rim: along the saw, jagged parts would get more than their share.
    along = rim_lengths(points)
    at = np.linspace(0.0, along[-1], count, endpoint=False)
    closed = np.concatenate([points, points[:1]])
    even = np.stack([np.interp(at, along, closed[:, axis]) for axis in range(3)], axis=1)
    spectrum = np.fft.rfft(even, axis=0)
    spectrum[HARMONICS + 1 :] = 0.0
    smooth = np.fft.irfft(spectrum, count, axis=0)
    return float(np.linalg.norm(np.roll(smooth, -1, axis=0) - smooth, axis=1).sum())
