"""Openings, covers given with the surface, and every kind of surface that is refused."""

import meshes
import numpy as np
import pytest

from LAFlatteningLib.anatomy import LEFT_ATRIUM
from LAFlatteningLib.cavity.openings import check_surface, make_cavity
from LAFlatteningLib.errors import SurfaceError
from LAFlatteningLib.surface import Surface


def cavity_of(surface, phantom):
    return make_cavity(surface, LEFT_ATRIUM, np.array([phantom.seeds[s] for s in LEFT_ATRIUM.outer_seeds]))


def test_open_atrium_keeps_points_and_order(phantom):
    cavity = cavity_of(phantom.surface, phantom)
    assert np.array_equal(cavity.surface.points, phantom.surface.points)
    assert np.array_equal(cavity.surface.triangles, phantom.surface.triangles)
    assert cavity.surface.point_data["surface_point_id"].tolist() == list(range(len(phantom.surface.points)))
    assert np.array_equal(cavity.surface.point_data["LGE"], phantom.surface.point_data["LGE"])
    assert set(cavity.surface.point_data) == {*phantom.surface.point_data, "surface_point_id"}
    assert len(cavity.closed.boundary_loops) == 1
    assert cavity.closed.genus == 0
    assert cavity.closed.is_oriented
    assert len(cavity.rims) == 5
    for hole, rim in enumerate(cavity.rims):
        assert len(cavity.cover_points[hole]) > 0
        # The rim of the cavity is the rim of its cover.
        cover = np.unique(cavity.closed.triangles[cavity.cover == hole])
        assert set(cavity.ids[rim].tolist()) <= set(cover.tolist())


def test_covers_given_by_the_array_hole_are_taken(phantom):
    first = cavity_of(phantom.surface, phantom)
    shuffled = np.random.default_rng(0).permutation(len(first.closed.points))
    rank = np.argsort(shuffled)
    marked = Surface(
        first.closed.points[shuffled],
        rank[first.closed.triangles],
        {name: values[shuffled] for name, values in first.closed.point_data.items()},
    )
    again = cavity_of(marked, phantom)
    assert len(again.rims) == 5
    assert len(again.surface.points) == len(phantom.surface.points)
    ids = again.surface.point_data["surface_point_id"]
    assert np.array_equal(again.surface.points, marked.points[ids])
    assert sorted(again.surface.loop_length(rim) for rim in again.rims) == pytest.approx(
        sorted(first.surface.loop_length(rim) for rim in first.rims)
    )


def test_outer_rim_is_the_one_at_the_seeds_not_the_longest(phantom):
    cavity = make_cavity(phantom.surface, LEFT_ATRIUM, phantom.surface.points[phantom.surface.boundary_loops[3]])
    assert set(cavity.outer.tolist()) == set(phantom.surface.boundary_loops[3].tolist())


def broken(surface, **arrays):
    return Surface(**{"points": surface.points, "triangles": surface.triangles, **arrays})


def test_two_components(phantom):
    n = len(phantom.surface.points)
    two = Surface(
        np.concatenate([phantom.surface.points, meshes.icosphere(5.0, 1).points]),
        np.concatenate([phantom.surface.triangles, meshes.icosphere(5.0, 1).triangles + n]),
    )
    with pytest.raises(SurfaceError, match=rf"2 separate pieces \(of {len(phantom.surface.triangles)}, 80 triangles\)"):
        cavity_of(two, phantom)


def test_non_manifold(phantom):
    fin = np.array([[*phantom.surface.triangles[100][:2], 5]])
    with pytest.raises(SurfaceError, match="not a clean sheet at"):
        cavity_of(broken(phantom.surface, triangles=np.concatenate([phantom.surface.triangles, fin])), phantom)


def test_genus():
    with pytest.raises(SurfaceError, match=r"1 handle \(like the handle of a cup\)"):
        check_surface(meshes.torus())


def test_too_few_openings(phantom):
    cavity = cavity_of(phantom.surface, phantom)
    part, _ = cavity.closed.submesh(np.isin(cavity.cover, [-1, 0, 1]))
    part = Surface(part.points, part.triangles)
    with pytest.raises(
        SurfaceError, match=r"Expected 6 openings .* found 4 open: .*mm round.*Cut the missing ones open"
    ):
        cavity_of(part, phantom)


def test_too_many_openings(phantom):
    keep = np.ones(len(phantom.surface.triangles), bool)
    rims = np.concatenate(phantom.surface.boundary_loops)
    inner = ~np.isin(phantom.surface.triangles, rims).any(axis=1)
    centre = phantom.surface.points[phantom.surface.triangles].mean(axis=1)
    far = [np.linalg.norm(phantom.surface.points[rims] - c, axis=1).min() for c in centre]
    keep[np.argmax(np.where(inner, far, 0))] = False
    pierced, _ = phantom.surface.submesh(keep)
    with pytest.raises(SurfaceError, match=r"found 7 open.*Close the openings that are none"):
        cavity_of(pierced, phantom)


def test_closed_surface_without_covers(phantom):
    with pytest.raises(SurfaceError, match=r"found 0 open.*Cut the missing ones open"):
        cavity_of(meshes.icosphere(40.0), phantom)


@pytest.mark.parametrize(("factor", "unit", "back"), [(0.001, "metres", "1000"), (0.1, "centimetres", "10")])
def test_wrong_units_are_named(phantom, factor, unit, back):
    small = broken(phantom.surface, points=phantom.surface.points * factor)
    with pytest.raises(SurfaceError, match=f"look like {unit}: multiply them by {back} to get mm"):
        cavity_of(small, phantom)


def test_everything_marked_as_cover(phantom):
    marked = phantom.surface.with_data({"hole": np.ones(len(phantom.surface.points))})
    with pytest.raises(SurfaceError, match="marks the whole surface"):
        cavity_of(marked, phantom)


def test_coincident_points_are_named(phantom):
    points = phantom.surface.points.copy()
    a, b = phantom.surface.triangles[500][:2]
    points[a] = points[b]
    with pytest.raises(SurfaceError, match=r"at the same place.*Merge coincident points"):
        cavity_of(broken(phantom.surface, points=points), phantom)


def test_triangles_that_share_no_points(phantom):
    soup = Surface(
        phantom.surface.points[phantom.surface.triangles].reshape(-1, 3),
        np.arange(3 * len(phantom.surface.triangles)).reshape(-1, 3),
    )
    with pytest.raises(SurfaceError, match="do not share their points: merge coincident points"):
        cavity_of(soup, phantom)


@pytest.mark.parametrize("value", [np.nan, -1.0, 2.0])
def test_hole_array_with_other_values(phantom, value):
    hole = np.zeros(len(phantom.surface.points))
    hole[10] = value
    with pytest.raises(SurfaceError, match='point array "hole" marks covers with 1'):
        cavity_of(phantom.surface.with_data({"hole": hole}), phantom)


def test_a_map_is_not_an_atrium(phantom, phantom_map):
    with pytest.raises(SurfaceError, match="looks like a map"):
        cavity_of(phantom_map.to_surface(), phantom)


def test_nearest_place_on_a_cover(phantom):
    cavity = cavity_of(phantom.surface, phantom)
    for hole in range(5):
        corners = cavity.closed.points[cavity.closed.triangles[cavity.cover == hole]]
        inside = corners.mean(axis=1)[3]
        normal = np.cross(corners[3, 1] - corners[3, 0], corners[3, 2] - corners[3, 0])
        off = inside + 0.2 * normal / np.linalg.norm(normal)
        assert np.linalg.norm(cavity.on_cover(hole, off) - inside) < 0.05
