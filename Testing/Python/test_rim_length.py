"""Length along rims: shares of a circle, and what a saw along it changes."""

import numpy as np
import pytest

from LAFlatteningLib.rim_length import SMOOTHING_MM, rim_lengths


def _circle(count: int, radius: float, saw: float = 0.0) -> np.ndarray:
    angle = 2.0 * np.pi * np.arange(count) / count
    r = radius + saw * (np.arange(count) % 2)
    return np.stack([r * np.cos(angle), r * np.sin(angle), 0.0 * angle], axis=1)


def test_a_smoothed_circle_is_a_smaller_circle():
    radius = 8.0
    length = rim_lengths(_circle(400, radius))
    # A Gaussian takes exp(-(s f)^2 / 2) off a wave of frequency f, here 1 / radius.
    expected = 2.0 * np.pi * radius * np.exp(-0.5 * (SMOOTHING_MM / radius) ** 2)
    assert length[-1] == pytest.approx(expected, rel=1e-4)
    assert np.allclose(length / length[-1], np.arange(401) / 400, atol=1e-12)


def test_shares_do_not_depend_on_where_points_lie():
    angle = np.sort(np.random.default_rng(0).uniform(0.0, 2.0 * np.pi, 300))
    points = np.stack([10.0 * np.cos(angle), 10.0 * np.sin(angle), 0.0 * angle], axis=1)
    length = rim_lengths(points)
    expected = np.append(angle, angle[0] + 2.0 * np.pi) - angle[0]
    assert np.abs(length / length[-1] - expected / expected[-1]).max() < 1e-3


def test_a_saw_along_a_half_of_a_rim_gains_it_no_share():
    count, radius = 100, 8.0
    smooth, ragged = _circle(count, radius), _circle(count, radius, 0.8)
    points = np.concatenate([smooth[: count // 2], ragged[count // 2 :]])
    sides = np.linalg.norm(np.diff(points, axis=0, append=points[:1]), axis=1)
    raw = sides[: count // 2].sum() / sides.sum()
    length = rim_lengths(points)
    share = length[count // 2] / length[-1]
    assert raw < 0.4
    assert abs(share - 0.5) < 0.3 * abs(raw - 0.5)


def test_a_rim_shorter_than_the_smoothing_still_grows_along_it():
    length = rim_lengths(_circle(12, 0.5))
    assert (np.diff(length) > 0.0).all()
    assert np.isfinite(length).all()
