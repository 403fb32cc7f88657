"""Smoothed surfaces whose shape after smoothing is known."""

import meshes
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from LAFlatteningLib.smoothing import smoothed_points
from LAFlatteningLib.surface import Surface


@pytest.mark.parametrize("wavelength", [4.0, 10.0])
def test_a_wave_loses_its_share_of_height(wavelength):
    """A gentle wave along x: one implicit step takes 1 / (1 + 2 (pi s / w)^2) of it."""
    flat = meshes.grid(161, 41, 40.0, 10.0)
    height = 0.02 * np.sin(2.0 * np.pi * flat.points[:, 0] / wavelength)
    surface = Surface(flat.points + np.outer(height, [0.0, 0.0, 1.0]), flat.triangles)
    smooth = smoothed_points(surface, 1.0)
    inner = (np.abs(flat.points[:, 0] - 20.0) < 12.0) & (np.abs(flat.points[:, 1] - 5.0) < 4.0)
    expected = height / (1.0 + 2.0 * (np.pi / wavelength) ** 2)
    # Rims, curves whose waves lose the same, follow suit.
    assert np.abs(smooth[inner, 2] - expected[inner]).max() < 0.01 * np.abs(expected).max()
    assert np.abs(smooth[inner, :2] - flat.points[inner, :2]).max() < 1e-3


@pytest.mark.parametrize("subdivisions", [3, 4])
def test_a_sphere_becomes_a_smaller_sphere(subdivisions):
    """The Laplacian of the place on a sphere of radius R is -2 / R^2 of it, whatever the triangles."""
    smooth = smoothed_points(meshes.icosphere(10.0, subdivisions), 3.0)
    assert np.linalg.norm(smooth, axis=1) == pytest.approx(10.0 / (1.0 + 0.5 * 9.0 * 2.0 / 100.0), rel=5e-3)


def test_a_round_rim_becomes_a_smaller_one():
    ring = meshes.annulus(8.0, 20.0, 25, 120)
    smooth = smoothed_points(ring, 1.0)
    for loop in ring.boundary_loops:
        radius = np.linalg.norm(ring.points[loop[0]])
        assert np.linalg.norm(smooth[loop], axis=1) == pytest.approx(radius / (1.0 + 0.5 / radius**2), rel=1e-4)
    assert np.abs(smooth[:, 2]).max() == 0.0


def test_a_saw_along_a_rim_all_but_goes():
    """Teeth of .6 mm, a millimetre apart, in the straight rim of a plane."""
    flat = meshes.grid(81, 41, 20.0, 10.0)
    points = flat.points.copy()
    teeth = np.flatnonzero((points[:, 1] == 0.0) & (points[:, 0] > 0.0) & (points[:, 0] < 20.0))
    points[teeth, 1] = np.where(np.arange(len(teeth)) // 2 % 2 == 0, -0.5, 0.1)
    smooth = smoothed_points(Surface(points, flat.triangles), 1.0)
    middle = teeth[20:-20]
    assert np.ptp(smooth[middle, 1]) < 0.3 * np.ptp(points[middle, 1])


def test_it_turns_and_grows_with_the_surface():
    rng = np.random.default_rng(0)
    flat = meshes.jittered(12, 10, 1)
    surface = Surface(flat.points + rng.normal(0.0, 0.15, flat.points.shape), flat.triangles)
    turn = Rotation.from_euler("xyz", [20, -50, 130], degrees=True).as_matrix()
    moved = Surface(2.5 * surface.points @ turn.T + [3.0, -40.0, 7.0], flat.triangles)
    expected = 2.5 * smoothed_points(surface, 0.8) @ turn.T + [3.0, -40.0, 7.0]
    assert np.abs(smoothed_points(moved, 2.0) - expected).max() < 1e-7


def test_nothing_over_no_length():
    surface = meshes.jittered(6, 5, 2)
    assert np.allclose(smoothed_points(surface, 0.0), surface.points, atol=1e-9)


def test_points_without_triangles_stay_where_they_are():
    surface = meshes.jittered(6, 5, 2)
    more = Surface(np.concatenate([surface.points, [[9.0, 8.0, 7.0]]]), surface.triangles)
    smooth = smoothed_points(more, 0.3)
    assert smooth[-1].tolist() == [9.0, 8.0, 7.0]
    assert np.allclose(smooth[:-1], smoothed_points(surface, 0.3), atol=1e-9)
