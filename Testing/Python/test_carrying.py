"""Closest points against brute force, and arrays carried: exact for linear functions, labels kept labels."""

import meshes
import numpy as np
import pytest

from LAFlatteningLib.carrying import carry, closest_points, closest_weights, holds_labels
from LAFlatteningLib.errors import SurfaceError
from LAFlatteningLib.surface import Surface


def brute_force(surface: Surface, positions: np.ndarray) -> np.ndarray:
    """Distance of each position to the nearest of all triangles."""
    distance = []
    for position in positions:
        corners = surface.points[surface.triangles]
        weights = closest_weights(corners, np.tile(position, (len(corners), 1)))
        distance.append(np.linalg.norm(np.einsum("kc,kcd->kd", weights, corners) - position, axis=1).min())
    return np.array(distance)


@pytest.fixture
def linear():
    """A bent sheet with arrays of all kinds; `value` and `vector` are linear in x and y."""
    sheet = meshes.jittered(12, 9, seed=3)
    x, y, _ = sheet.points.T
    value = 3.0 * x - 2.0 * y + 1.0
    return sheet.with_data(
        {
            "value": value,
            "single": value.astype(np.float32),
            "vector": np.stack([x, y, x + y], axis=1),
            "label": (x > 5).astype(np.int16),
            "mask": x > 5,
            "float_mask": (x > 5).astype(np.float64),
            "name": np.array(["a"] * len(x), dtype=object),
        },
        {"region": np.arange(len(sheet.triangles)), "pair": np.ones((len(sheet.triangles), 2))},
    )


def test_weights_of_a_known_triangle():
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    asked = {
        (0.25, 0.25, 5.0): (0.5, 0.25, 0.25),
        (-1.0, -1.0, 0.0): (1, 0, 0),
        (2.0, -1.0, 1.0): (0, 1, 0),
        (0.5, -3.0, 0.0): (0.5, 0.5, 0),
        (1.0, 1.0, 0.0): (0, 0.5, 0.5),
    }
    found = closest_weights(np.tile(corners, (len(asked), 1, 1)), np.array(list(asked)))
    np.testing.assert_allclose(found, list(asked.values()), atol=1e-12)


def test_weights_of_a_triangle_without_area():
    corners = np.array([[[0.0, 0, 0], [2, 0, 0], [1, 0, 0]], [[1.0, 1, 1], [1, 1, 1], [1, 1, 1]]])
    positions = np.array([[0.5, 3, 0], [4.0, 5, 1]])
    weights = closest_weights(corners, positions)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    np.testing.assert_allclose(np.einsum("kc,kcd->kd", weights, corners), [[0.5, 0, 0], [1, 1, 1]], atol=1e-12)


@pytest.mark.parametrize("spread", [0.05, 5.0, 60.0], ids=["on it", "near", "far"])
def test_no_triangle_is_nearer_than_the_closest(phantom, spread):
    rng = np.random.default_rng(5)
    surface = phantom.surface
    positions = surface.points[rng.choice(len(surface.points), 60)] + rng.normal(0, spread, (60, 3))
    closest = closest_points(surface, positions)
    np.testing.assert_allclose(closest.distance_mm, brute_force(surface, positions), atol=1e-9)
    assert (closest.weights >= 0).all()
    np.testing.assert_allclose(closest.weights.sum(axis=1), 1.0)
    corners = surface.points[surface.triangles[closest.triangle]]
    np.testing.assert_allclose(np.einsum("kc,kcd->kd", closest.weights, corners), closest.positions, atol=1e-12)


def test_triangles_of_very_different_size_are_found():
    # A sliver 100 mm long among small triangles: its corners are far from most of it.
    points = np.array([[0.0, 0, 0], [100, 0, 0], [0, 1, 0], [50, 3, 0], [51, 3, 0], [50, 4, 0]])
    surface = Surface(points, np.array([[0, 1, 2], [3, 4, 5]]))
    closest = closest_points(surface, np.array([[50.0, -1.0, 0.0], [50.2, 2.9, 1.0]]))
    assert closest.triangle.tolist() == [0, 1]
    np.testing.assert_allclose(closest.positions, [[50, 0, 0], [50.2, 3, 0]], atol=1e-12)


def test_linear_functions_are_carried_exactly(linear):
    rng = np.random.default_rng(2)
    x, y = rng.uniform(0.5, 7, (2, 200))
    carried = carry(linear, np.stack([x, y, np.zeros(200)], axis=1))
    np.testing.assert_allclose(carried.point_data["value"], 3 * x - 2 * y + 1, atol=1e-12)
    assert carried.point_data["single"].dtype == np.float32
    np.testing.assert_allclose(carried.point_data["vector"], np.stack([x, y, x + y], axis=1), atol=1e-12)


def test_labels_stay_labels_and_text_is_left_out(linear):
    rng = np.random.default_rng(2)
    positions = np.column_stack([rng.uniform(0, 11, 200), rng.uniform(0, 8, 200), np.zeros(200)])
    carried = carry(linear, positions)
    for name in ("label", "mask", "float_mask"):
        assert carried.point_data[name].dtype == linear.point_data[name].dtype
        assert set(np.unique(carried.point_data[name])) == {0, 1}
        # A label is that of the nearest corner, at most one edge (here up to 1.8 mm) away.
        assert (carried.point_data[name][positions[:, 0] > 7] == 1).all()
        assert (carried.point_data[name][positions[:, 0] < 3] == 0).all()
    assert "name" not in carried.point_data
    assert any('"name"' in note for note in carried.notes)
    region = carried.cell_data["region"]
    corners = linear.points[linear.triangles[region]][..., :2]
    for position, (a, b, c) in zip(positions[:, :2], corners, strict=True):
        shares = np.linalg.solve(np.stack([a - c, b - c], axis=1), position - c)
        assert min(*shares, 1 - shares.sum()) > -1e-9
    assert carried.cell_data["pair"].shape == (200, 2)


def test_corners_without_a_value_are_left_out():
    triangle = Surface(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    surface = triangle.with_data(
        {"one": np.array([1.5, 4.5, np.nan]), "none": np.full(3, np.nan), "far": np.array([1.5, 4.5, np.inf])}
    )
    carried = carry(surface, np.array([[0.25, 0.5, 0.0], [0.0, 1.0, 0.0]]))
    # Weights .25 and .25 of the two corners that have a value; the second place is the corner that has none.
    np.testing.assert_allclose(carried.point_data["one"], [3.0, np.nan])
    assert np.isnan(carried.point_data["none"]).all()
    np.testing.assert_allclose(carried.point_data["far"], [3.0, np.nan])


def test_few_whole_numbers_are_labels_and_many_are_measured():
    assert holds_labels(np.array([0.0, 1.0, 1.0]))
    assert not holds_labels(np.arange(100.0))
    assert not holds_labels(np.array([0.0, 0.5]))
    assert not holds_labels(np.full(3, np.nan))


@pytest.mark.parametrize("positions", [np.zeros((2, 2)), np.zeros(3), np.array([[0.0, np.nan, 0.0]])])
def test_positions_that_are_none_are_refused(positions):
    with pytest.raises(SurfaceError, match="positions"):
        closest_points(meshes.grid(), positions)
