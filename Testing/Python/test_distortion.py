"""alpha, beta, entropy, folds and overlaps against closed forms and brute force."""

import meshes
import numpy as np
import pytest

from LAFlatteningLib import distortion, operators


def strip(stretch=(1.0, 1.0)):
    surface = meshes.grid(9, 7, 2.0, 1.0)
    return surface, surface.points[:, :2] * stretch


def turn(a, b, c):
    """Twice the signed area of a triangle."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])


def test_similar_map_has_no_distortion():
    surface, flat = strip((0.3, 0.3))
    assert np.allclose(distortion.area_ratio(surface.points, surface.triangles, flat), 1.0)
    assert np.allclose(distortion.isotropy(surface.points, surface.triangles, flat), 1.0)


def test_stretch_has_the_ratio_of_its_factors():
    surface, flat = strip((3.0, 1.5))
    assert np.allclose(distortion.isotropy(surface.points, surface.triangles, flat), 0.5)
    assert np.allclose(distortion.dilatation(surface.points, surface.triangles, flat), 2.0)
    assert np.allclose(distortion.area_ratio(surface.points, surface.triangles, flat), 1.0)


def test_area_ratio_of_halves_of_different_growth():
    surface, flat = strip()
    x = flat[:, 0].copy()
    flat[:, 0] = np.where(x < 1.0, x, 1.0 + 3.0 * (x - 1.0))
    alpha = distortion.area_ratio(surface.points, surface.triangles, flat)
    left = surface.points[surface.triangles][:, :, 0].mean(axis=1) < 1.0
    # Total areas 2 -> 4: shares 1/4 and 3/4 of the map for halves of the surface.
    assert np.allclose(alpha[left], 0.5)
    assert np.allclose(alpha[~left], 1.5)


def test_mean_of_alpha_weighted_by_area_is_one():
    surface = meshes.icosphere(1.0, 3)
    flat = surface.points[:, :2] * [1.3, 0.4] + 0.1 * surface.points[:, 2:] ** 2
    alpha = distortion.area_ratio(surface.points, surface.triangles, flat)
    assert np.average(alpha, weights=surface.triangle_areas) == pytest.approx(1.0)


def test_stereographic_projection_is_conformal():
    sphere = meshes.icosphere(1.0, 5)
    dome, _ = sphere.submesh(sphere.points[sphere.triangles][:, :, 2].max(axis=1) < 0.5)
    x, y, z = dome.points.T
    flat = np.column_stack([x / (1 - z), y / (1 - z)])
    beta = distortion.isotropy(dome.points, dome.triangles, flat)
    assert beta.min() > 0.95
    assert beta.mean() > 0.98


def test_entropy_of_known_histograms():
    assert distortion.entropy(np.full(50, 0.33)) == pytest.approx(0.0)
    assert distortion.entropy(np.arange(8) * 0.1 + 0.05) == pytest.approx(np.log(8))
    assert distortion.entropy(np.array([0.05, 0.05, 0.05, 0.15, np.nan])) == pytest.approx(
        -(0.75 * np.log(0.75) + 0.25 * np.log(0.25))
    )


def test_folded_triangles_are_those_turned_over():
    surface, flat = strip()
    flat[10] = [1.9, 0.9]
    expected = [t for t, corners in enumerate(flat[surface.triangles]) if turn(*corners) <= 0]
    assert len(expected) > 0
    assert distortion.folded_triangles(flat, surface.triangles).tolist() == expected


def clipped_area(subject, window):
    """Area of the intersection of two triangles (Sutherland and Hodgman), independently of the library."""
    if turn(*window) < 0:
        window = window[::-1]
    polygon = list(subject)
    for a, b in zip(window, np.roll(window, -1, axis=0), strict=True):
        clipped = []
        for p, q in zip(polygon, polygon[1:] + polygon[:1], strict=True):
            sp, sq = turn(a, b, p), turn(a, b, q)
            if sp >= 0:
                clipped.append(p)
            if sp * sq < 0:
                clipped.append(p + sp / (sp - sq) * (q - p))
        polygon = clipped
        if len(polygon) < 3:
            return 0.0
    x, y = np.array(polygon).T
    return abs(0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


@pytest.mark.parametrize("seed", range(3))
def test_overlapping_pairs_equal_brute_force(seed):
    rng = np.random.default_rng(seed)
    surface, flat = strip()
    moved = rng.choice(len(flat), 5, replace=False)
    flat[moved] += 0.4 * rng.standard_normal((5, 2))
    found = {tuple(pair) for pair in distortion.overlapping_pairs(flat, surface.triangles).tolist()}
    corners = flat[surface.triangles]
    expected = {
        (a, b)
        for a in range(len(corners))
        for b in range(a + 1, len(corners))
        if clipped_area(corners[a], corners[b]) > 1e-12
    }
    assert expected
    assert found == expected


def test_a_proper_map_has_no_overlaps():
    surface, flat = strip()
    assert len(distortion.overlapping_pairs(flat, surface.triangles)) == 0
    spiral = flat @ [[0.3, 0.9], [-0.9, 0.3]]
    assert len(distortion.overlapping_pairs(spiral, surface.triangles)) == 0


def test_a_sheet_lying_over_itself_is_found_without_any_fold():
    # A strip that winds once and a half round a point: no triangle is turned over, yet it covers itself.
    surface = meshes.grid(61, 3, 3 * np.pi, 1.0)
    angle, radius = surface.points[:, 0], 2.0 - surface.points[:, 1]
    flat = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    assert operators.signed_areas(flat, surface.triangles).min() > 0
    assert len(distortion.overlapping_pairs(flat, surface.triangles)) > 20
