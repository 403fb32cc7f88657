"""Outlines of the map with corners, against closed forms."""

import numpy as np
import pytest

from LAFlatteningLib.errors import TemplateError
from LAFlatteningLib.shapes import Polygon, Rectangle, Shape, shape_from_dict

SQUARE = Rectangle((1.0, 2.0), (0.5, 0.5))
OBLONG = Rectangle((0.0, 0.0), (2.0, 1.0))
TURNED = Rectangle((0.0, 0.0), (2.0, 1.0), 30.0)
HEXAGON = Polygon.of([(np.cos(t), np.sin(t)) for t in np.arange(6) * np.pi / 3])
TRIANGLE = Polygon.of([(0.0, 0.0), (3.0, 0.0), (0.0, 3.0)])
CORNERED = [SQUARE, OBLONG, TURNED, HEXAGON, TRIANGLE]


def test_rays_meet_the_sides_of_a_square():
    np.testing.assert_allclose(
        SQUARE.at([0.0, 45.0, 90.0, 180.0, 225.0, 270.0]) - SQUARE.centre,
        [[0.5, 0], [0.5, 0.5], [0, 0.5], [-0.5, 0], [-0.5, -0.5], [0, -0.5]],
        atol=1e-15,
    )
    # At 30 degrees to the right side, whose distance is .5.
    np.testing.assert_allclose(SQUARE.at(30.0) - SQUARE.centre, [0.5, 0.5 * np.tan(np.pi / 6)])


def test_lengths_along_a_rectangle():
    assert OBLONG.arc_length(0.0, 90.0) == pytest.approx(1.0 + 2.0)
    assert OBLONG.arc_length(-45.0, 45.0) == pytest.approx(1.0 + 2.0 + 1.0)
    assert OBLONG.arc_length(90.0, 0.0) == pytest.approx(3.0)
    assert OBLONG.arc_length(10.0, 370.0) == pytest.approx(12.0)
    assert TURNED.arc_length(30.0, 120.0) == pytest.approx(3.0)
    assert HEXAGON.arc_length(0.0, 240.0) == pytest.approx(4.0)


@pytest.mark.parametrize("shape", CORNERED)
@pytest.mark.parametrize(("start", "end"), [(0.0, 90.0), (350.0, 620.0), (-170.0, 190.0), (200.0, 20.0)])
def test_shares_of_an_arc_are_shares_of_its_length(shape, start, end):
    share = np.linspace(0.0, 1.0, 41)
    degrees = shape.angle_at(start, end, share)
    assert (np.diff(degrees) * np.sign(end - start) > 0).all()
    np.testing.assert_allclose(shape.at(degrees[[0, -1]]), shape.at([start, end]), atol=1e-12)
    # Independently: the arc walked in small steps.
    fine = shape.at(np.linspace(start, end, 200001))
    walked = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))])
    expected = np.stack([np.interp(share * walked[-1], walked, c) for c in fine.T], axis=1)
    np.testing.assert_allclose(shape.at(degrees), expected, atol=2e-4)
    assert shape.arc_length(start, end) == pytest.approx(walked[-1], rel=1e-4)


@pytest.mark.parametrize("shape", CORNERED)
def test_projection_containment_and_angles_agree(shape):
    rng = np.random.default_rng(1)
    degrees = rng.uniform(0.0, 360.0, 200)
    on = shape.at(degrees)
    np.testing.assert_allclose([shape.angle_of(point) for point in on], degrees, atol=1e-9)
    inside, outside = (shape.centre + factor * (on - shape.centre) for factor in (0.7, 1.2))
    np.testing.assert_allclose(shape.project(inside), on, atol=1e-12)
    np.testing.assert_allclose(shape.distance(outside), np.linalg.norm(outside - on, axis=1), atol=1e-12)
    assert shape.contains(inside).all() and not shape.contains(outside).any()
    nearest = shape.project(np.array([shape.centre]))
    reach = np.linalg.norm(shape.at(np.arange(0.0, 360.0, 0.1)) - shape.centre, axis=1).min()
    assert shape.distance(np.array([shape.centre]))[0] == pytest.approx(reach, abs=1e-3)
    assert np.linalg.norm(nearest - shape.centre) == pytest.approx(reach, abs=0.2 * reach)


@pytest.mark.parametrize("shape", CORNERED)
def test_outlines_and_arcs_hold_the_corners(shape):
    for outline in (shape.outline(90), shape.at(shape.angles_between(10.0, 370.0, 30))):
        apart = np.linalg.norm(outline[:, None] - shape.corners, axis=2).min(axis=0)
        np.testing.assert_allclose(apart, 0.0, atol=1e-12)
    assert len(shape.outline(90)) == 90
    downwards = shape.angles_between(300.0, 20.0, 5)
    assert (np.diff(downwards) < 0).all() and downwards[[0, -1]].tolist() == [300.0, 20.0]


@pytest.mark.parametrize("shape", [*CORNERED, Shape((0.1, 0.2), (0.3, 0.3)), Shape((0.0, 0.0), (0.1, 0.3), 12.5)])
def test_shapes_survive_their_dictionaries(shape):
    assert shape_from_dict(shape.to_dict()) == shape


@pytest.mark.parametrize(
    ("corners", "message"),
    [
        ([(0, 0), (0, 1), (1, 1), (1, 0)], "clockwise; reverse the list"),
        ([(0, 0), (2, 0), (0.5, 0.5), (0, 2)], r"convex polygon.*not at \(0.5, 0.5\)"),
        ([(0, 0), (1, 0), (2, 0), (0, 2)], r"convex polygon.*not at \(1, 0\)"),
        ([(np.cos(t), np.sin(t)) for t in np.arange(5) * 4 * np.pi / 5], "convex polygon"),
    ],
)
def test_outlines_that_bend_inwards_are_refused(corners, message):
    with pytest.raises(TemplateError, match=message):
        Polygon.of(corners)
