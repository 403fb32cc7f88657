"""Plane sections and cuts: against circles and cylinders in closed form."""

import meshes
import numpy as np
import pytest

from LAFlatteningLib.cavity.clipping import CutPlane, clip
from LAFlatteningLib.cavity.sections import plane_section
from LAFlatteningLib.errors import SurfaceError
from LAFlatteningLib.phantom import make_phantom
from LAFlatteningLib.surface import Surface

UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def closed():
    return make_phantom(5000, closed=True)


@pytest.fixture(scope="module")
def sphere():
    """Radius 30 mm about (5, -3, 2)."""
    from scipy.spatial import ConvexHull

    from LAFlatteningLib.phantom.sphere import fibonacci_sphere

    points = fibonacci_sphere(4000)
    triangles = ConvexHull(points).simplices.astype(np.int64)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", a, np.cross(b, c)) < 0
    triangles[inward] = triangles[inward][:, ::-1]
    places = 30.0 * points + [5.0, -3.0, 2.0]
    return Surface(places, triangles, {"height": places[:, 2].copy(), "label": np.arange(4000)})


def test_section_of_a_sphere_is_a_circle(sphere):
    section = plane_section(sphere, np.array([5.0, -3.0, 20.0]), UP)
    radius = np.sqrt(30.0**2 - 18.0**2)
    assert section.around
    assert section.diameter == pytest.approx(2 * radius, rel=0.005)
    assert section.perimeter == pytest.approx(2 * np.pi * radius, rel=0.005)
    assert section.area == pytest.approx(np.pi * radius**2, rel=0.01)
    assert np.allclose(section.centre, [5.0, -3.0, 20.0], atol=0.05)
    assert np.abs((section.points - [0, 0, 20.0]) @ UP).max() < 1e-9


def test_section_tells_what_it_goes_round(sphere):
    section = plane_section(sphere, np.array([5.0, -3.0, 20.0]), UP)
    through = np.array([[6.0, -3.0, 0.0], [6.0, -3.0, 40.0]])
    assert section.encloses(through)
    assert not section.encloses(through + np.array([40.0, 0, 0]))
    assert not section.encloses(np.array([[6.0, -3.0, 21.0], [6.0, -3.0, 40.0]]))
    beside = np.array([[6.0, -3.0, 22.0], [7.0, -3.0, 22.0]])
    assert section.cuts_into(beside, np.full(2, 3.0))
    assert not section.cuts_into(beside, np.full(2, 1.0))
    outside = plane_section(sphere, np.array([60.0, -3.0, 20.0]), UP)
    assert not outside.around
    assert plane_section(sphere, np.array([5.0, -3.0, 90.0]), UP) is None


@pytest.mark.parametrize("height", [20.0, 20.003, 2.0, -11.7])
def test_cut_leaves_what_is_below_the_plane(sphere, height):
    part = clip(sphere, CutPlane([5.0, -3.0, height], 3.0 * UP))
    assert part.is_manifold
    assert part.is_oriented
    assert part.genus == 0
    [rim] = part.boundary_loops
    assert np.abs(part.points[rim, 2] - height).max() < 1e-9
    assert part.points[:, 2].max() < height + 1e-9
    # Area of a spherical cap is 2 pi r h; a chordal mesh has a little less.
    assert part.area == pytest.approx(2 * np.pi * 30.0 * (height - 2.0 + 30.0), rel=0.01)
    # No slivers: the shortest new edge is no small share of an edge.
    assert part.edge_lengths.min() > 0.05 * sphere.edge_lengths.mean()
    # Values are interpolated along edges: a linear one stays exact.
    assert np.abs(part.point_data["height"] - part.points[:, 2]).max() < 1e-9
    assert part.point_data["label"].dtype == sphere.point_data["label"].dtype


def test_whole_triangles_stay_as_they_were(sphere):
    part = clip(sphere, CutPlane([5.0, -3.0, 20.0], UP), whole_triangles=True)
    assert part.is_manifold
    assert len(part.boundary_loops) == 1
    before = {tuple(sorted(t)) for t in sphere.triangles.tolist()}
    labels = part.point_data["label"]
    assert all(tuple(sorted(labels[t])) in before for t in part.triangles)
    edge = sphere.edge_lengths.mean()
    assert np.abs(part.points[part.boundary_loops[0], 2] - 20.0).max() < 1.5 * edge


def test_only_the_tube_of_the_plane_is_cut(closed):
    shape = closed.shape
    opening = shape.openings["RSPV"]
    plane = CutPlane(np.array(shape.centre) + opening.rim[1] * opening.axis, opening.axis)
    part = clip(closed.surface, plane)
    assert len(part.boundary_loops) == 1
    assert part.loop_length(part.boundary_loops[0]) == pytest.approx(shape.tubes["RSPV"].perimeter, rel=0.01)
    # The plane meets the body too on its far side? It does not: everything but the tube is still there.
    tips = np.array([tip for name, tip in closed.tips.items() if name != "RSPV"])
    assert np.linalg.norm(part.points[:, None] - tips[None], axis=2).min(axis=0).max() < 1.0


def test_planes_that_cannot_cut_are_refused(sphere, closed):
    with pytest.raises(SurfaceError, match="does not cut a closed curve round its centre"):
        clip(sphere, CutPlane([60.0, 0, 20.0], UP), "RSPV")
    with pytest.raises(SurfaceError, match="three numbers"):
        CutPlane([1.0, 2.0], UP)
    with pytest.raises(SurfaceError, match="three numbers"):
        CutPlane([1.0, 2.0, 3.0], [0.0, 0.0, 0.0])
    # Through a handle: cutting one side of a torus takes nothing off.
    torus = meshes.torus(20.0, 6.0) if hasattr(meshes, "torus") else None
    if torus is not None:
        with pytest.raises(SurfaceError, match="does not cut anything off"):
            clip(torus, CutPlane([20.0, 0, 0], [0, 1.0, 0]))
