"""Lines made edges of a mesh, and which of them meet, against brute force in the plane."""

from itertools import combinations, pairwise

import meshes
import numpy as np
import pytest

from LAFlatteningLib.geodesic_lines import Line, Place, settle, straighten
from LAFlatteningLib.geodesics import PathTree
from LAFlatteningLib.half_edges import HalfEdges
from LAFlatteningLib.insertion import Inserted, chord_triangles, edges_of, insert_lines, meeting
from LAFlatteningLib.operators import signed_areas
from LAFlatteningLib.surface import Surface


def cut(inserted):
    """The triangles of the surface before that are in pieces."""
    return np.flatnonzero(np.bincount(inserted.parent) > 1)


def line_from(surface, mesh, start, stop):
    path = PathTree(surface.edge_graph, int(mesh.origin[start.half_edge])).to(int(mesh.origin[stop.half_edge]))
    strip = mesh.along(path.tolist(), start.half_edge // 3, stop.half_edge // 3)
    return straighten(mesh, start, stop, strip)


def random_lines(surface, count, rng, at_points=0.3):
    """Straight lines between places on rims and points of the mesh, none of which runs along an edge."""
    mesh = HalfEdges.of(surface)
    rim = np.flatnonzero(mesh.twin < 0)
    lines = {}
    while len(lines) < count:
        places = []
        for _ in range(2):
            if rng.random() < at_points:
                places.append(Place(int(mesh.first[rng.integers(len(surface.points))]), 0.0))
            else:
                places.append(Place(int(rng.choice(rim)), float(rng.uniform(0.02, 0.98))))
        line = line_from(surface, mesh, *places)
        if len(line.share) > 1 and (chord_triangles(surface, line.ends[:-1], line.ends[1:]) >= 0).all():
            lines[f"line {len(lines)}"] = line
    return lines


def apart(surface, lines):
    """The lines, in their order, that do not meet those before them."""
    pairs = meeting(surface, lines)
    kept = {}
    for name, line in lines.items():
        if not any(frozenset((name, other)) in pairs for other in kept):
            kept[name] = line
    return kept


def assert_inserted(surface, inserted, lines):
    """All that `insert_lines` promises, on a flat surface seen from above."""
    made, n = inserted.surface, len(surface.points)
    assert np.array_equal(made.points[:n], surface.points)
    assert made.is_manifold
    assert made.is_oriented
    assert made.used_points.all()
    assert made.component_count == surface.component_count
    assert made.genus == surface.genus
    assert len(made.boundary_loops) == len(surface.boundary_loops)
    # Every piece is turned like its parent, inside it, and together the pieces are as large as it is.
    assert signed_areas(made.points[:, :2], made.triangles).min() > 0.0
    parts = np.bincount(inserted.parent, made.triangle_areas, minlength=len(surface.triangles))
    assert np.allclose(parts, surface.triangle_areas, rtol=1e-11, atol=0.0)
    a, b, c = surface.points[surface.triangles[inserted.parent], :2].swapaxes(0, 1)
    frame = np.stack([b - a, c - a], axis=2)
    for corner in made.triangles.T:
        u, v = np.linalg.solve(frame, (made.points[corner, :2] - a)[..., None])[..., 0].T
        assert min(u.min(), v.min(), (1.0 - u - v).min()) > -1e-9
    edges = {tuple(edge) for edge in made.edges.points.tolist()}
    for name, line in lines.items():
        ids = inserted.lines[name]
        assert np.allclose(made.points[ids], line.positions(surface.points), rtol=0.0, atol=1e-13)
        assert all((min(pair), max(pair)) in edges for pair in pairwise(ids.tolist()))


# ---- inserting ----


def test_no_lines_change_nothing():
    before = Inserted.of(meshes.jittered())
    assert insert_lines(before, {}) is before
    assert before.parent.tolist() == list(range(len(before.surface.triangles)))
    assert len(cut(before)) == 0


def test_one_line_across_one_triangle():
    surface = meshes.grid(2, 2)
    line = Line(np.array([[0, 1], [0, 3]]), np.array([0.25, 0.5]), (), np.zeros(0))
    inserted = insert_lines(Inserted.of(surface), {"a": line})
    assert_inserted(surface, inserted, {"a": line})
    assert inserted.surface.points[4:].tolist() == [[0.25, 0.0, 0.0], [0.5, 0.5, 0.0]]
    assert sorted(inserted.lines["a"].tolist()) == [4, 5]
    # Three pieces of the triangle crossed; its neighbour, with a new point on one side, in two.
    counts = np.bincount(inserted.parent)
    crossed = next(t for t in range(2) if 1 in surface.triangles[t])
    assert counts[crossed] == 3
    assert counts[1 - crossed] == 2


def sharpest(points, triangles):
    """Twice the smallest area over the longest side squared."""
    a, b, c = points[np.array(triangles)].swapaxes(0, 1)
    sides = np.max([np.sum((p - q) ** 2, axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    return (np.linalg.norm(np.cross(b - a, c - a), axis=1) / sides).min()


@pytest.mark.parametrize("corner", range(3))
def test_four_corners_behind_a_line_are_cut_the_better_way(corner):
    rng = np.random.default_rng(corner)
    chosen = set()
    for _ in range(60):
        points = np.append(rng.uniform(0.0, 4.0, (3, 2)), np.zeros((3, 1)), axis=1)
        triangle = np.array([[0, 1, 2]])
        forward = signed_areas(points[:, :2], triangle)[0] > 0.0
        surface = Surface(points, triangle if forward else triangle[:, ::-1])
        c, p, q = np.roll(surface.triangles[0], -corner)
        shares = rng.uniform(0.02, 0.98, 2)
        line = Line(np.array([[c, p], [c, q]]), shares, (), np.zeros(0))
        inserted = insert_lines(Inserted.of(surface), {"a": line})
        assert_inserted(surface, inserted, {"a": line})
        made, (u, v) = inserted.surface, inserted.lines["a"]
        behind = [triangle for triangle in made.triangles.tolist() if c not in triangle]
        both = [[[u, p, q], [u, q, v]], [[p, q, v], [u, p, v]]]
        quality = [sharpest(made.points, cut) for cut in both]
        assert sharpest(made.points, behind) == pytest.approx(max(quality), rel=1e-9)
        chosen.add(int(np.argmax(quality)))
    assert chosen == {0, 1}


@pytest.mark.parametrize("seed", range(12))
def test_random_lines_become_edges(seed):
    rng = np.random.default_rng(seed)
    surface = meshes.jittered(7, 6, seed, 0.35)
    lines = apart(surface, random_lines(surface, 40, rng))
    assert len(lines) > 3
    inserted = insert_lines(Inserted.of(surface), lines)
    assert_inserted(surface, inserted, lines)
    assert len(cut(inserted)) > 10
    # Led through points of the mesh as well.
    inner = np.isfinite(HalfEdges.of(surface).angles)
    settled = apart(surface, {name: settle(line, surface.points, inner, 0.1) for name, line in lines.items()})
    assert_inserted(surface, insert_lines(Inserted.of(surface), settled), settled)


def test_lines_round_a_hole():
    square = np.array([[4.0, 4.0], [6.0, 4.0], [6.0, 6.0], [4.0, 6.0]])
    surface = meshes.pierced(10.0, 15, [square], 2)
    mesh = HalfEdges.of(surface)
    hole = min(surface.boundary_loops, key=len)
    outer = np.setdiff1d(np.flatnonzero(mesh.twin < 0), np.flatnonzero(np.isin(mesh.origin, hole)))
    lines = {}
    for k, point in enumerate(hole[::2].tolist()):
        goal = outer[np.linalg.norm(surface.points[mesh.origin[outer]] - surface.points[point], axis=1).argmin()]
        lines[f"line {k}"] = line_from(surface, mesh, Place(int(mesh.first[point]), 0.0), Place(int(goal), 0.4))
    lines = {name: line for name, line in lines.items() if (chord_triangles(surface, *_pieces(line)) >= 0).all()}
    lines = apart(surface, lines)
    assert len(lines) > 3
    inserted = insert_lines(Inserted.of(surface), lines)
    assert_inserted(surface, inserted, lines)
    assert sorted(map(len, inserted.surface.boundary_loops))[0] == len(hole)


def _pieces(line):
    return line.ends[:-1], line.ends[1:]


def test_many_lines_in_one_triangle():
    """Fans of lines that cut off each of the three corners."""
    surface = meshes.grid(2, 2)
    triangle = surface.triangles[0].tolist()
    lines = {}
    for k in range(3):
        corner, one, two = triangle[k], triangle[(k + 1) % 3], triangle[(k + 2) % 3]
        for i, share in enumerate((0.1, 0.2, 0.3, 0.4)):
            ends = np.array([[corner, one], [corner, two]])
            lines[f"{k} {i}"] = Line(ends, np.array([share, 1.1 * share]), (), np.zeros(0))
    assert meeting(surface, lines) == set()
    inserted = insert_lines(Inserted.of(surface), lines)
    assert_inserted(surface, inserted, lines)
    # A triangle with 24 points on its sides and 12 lines: 24 + 3 corners make 25 triangles without points inside.
    assert np.bincount(inserted.parent)[0] == 25
    assert len(inserted.surface.points) == 4 + 24


def test_lines_from_a_corner_and_through_points():
    surface = meshes.grid(3, 3, 2.0, 2.0)
    mesh = HalfEdges.of(surface)
    # From the corner at the top left to the one at the bottom right, through the point in the middle.
    diagonal = line_from(surface, mesh, Place(int(mesh.first[6]), 0.0), Place(int(mesh.first[2]), 0.0))
    assert diagonal.ends[diagonal.ends[:, 0] == diagonal.ends[:, 1], 0].tolist() == [6, 4, 2]
    inserted = insert_lines(Inserted.of(surface), {"a": diagonal})
    assert_inserted(surface, inserted, {"a": diagonal})
    assert len(inserted.surface.points) == 9 + 2
    assert len(inserted.surface.triangles) == 8 + 4
    # Along edges: nothing is cut.
    row = line_from(surface, mesh, Place(int(mesh.first[3]), 0.0), Place(int(mesh.first[5]), 0.0))
    along = insert_lines(Inserted.of(surface), {"a": row})
    assert len(along.surface.triangles) == 8
    assert_inserted(surface, along, {"a": row})


def test_single_places_become_points():
    surface = meshes.jittered()
    inner = np.flatnonzero(surface.edges.usage == 2)[[3, 30]]
    rim = np.flatnonzero(surface.edges.usage == 1)[[2, 7]]
    places = {}
    for k, edge in enumerate([*inner.tolist(), *rim.tolist()]):
        a, b = surface.edges.points[edge]
        # Either way round.
        ends = np.array([[a, b] if k % 2 else [b, a]])
        places[f"place {k}"] = Line(ends, np.array([0.3]), (), np.zeros(0))
    places["point"] = Line(np.array([[20, 20]]), np.zeros(1), (), np.zeros(0))
    inserted = insert_lines(Inserted.of(surface), places)
    assert_inserted(surface, inserted, places)
    assert inserted.lines["point"].tolist() == [20]
    assert len(inserted.surface.points) == len(surface.points) + 4
    assert len(inserted.surface.triangles) == len(surface.triangles) + 2 * 2 + 2
    assert len(inserted.surface.boundary_loops[0]) == len(surface.boundary_loops[0]) + 2
    touched = np.unique(surface.edges.triangles[[*inner, *rim]])
    assert cut(inserted).tolist() == touched[touched >= 0].tolist()


def test_lines_inserted_one_after_the_other():
    """Parents are triangles of the first surface, and lines keep their ids."""
    surface = meshes.jittered(6, 6, 1)
    mesh = HalfEdges.of(surface)
    rim = np.flatnonzero(mesh.twin < 0)
    left, right = (rim[(surface.points[mesh.ends(rim), 0] == x).all(axis=1)] for x in (0.0, 5.0))
    by_height = lambda side: side[np.argsort(surface.points[mesh.ends(side), 1].mean(axis=1))]  # noqa: E731
    lines, inserted = {}, Inserted.of(surface)
    for k, (a, b) in enumerate(zip(by_height(left)[1:4], by_height(right)[1:4], strict=True)):
        now = inserted.surface
        mesh_now = HalfEdges.of(now)
        # The rim's half-edges have other numbers by now, but none of these has been cut.
        places = []
        for h in (a, b):
            start, end = mesh.ends([h])[0].tolist()
            h_now = int(np.flatnonzero((mesh_now.origin == start) & (mesh_now.twin < 0))[0])
            assert mesh_now.end(h_now) == end
            places.append(Place(h_now, 0.5))
        line = line_from(now, mesh_now, *places)
        at = line.positions(now.points)
        if (chord_triangles(now, *_pieces(line)) < 0).any():
            continue
        inserted = insert_lines(inserted, {f"line {k}": line})
        lines[f"line {k}"] = at
    assert len(lines) == 3
    assert_inserted(surface, inserted, {})
    for name, at in lines.items():
        assert np.allclose(inserted.surface.points[inserted.lines[name]], at, rtol=0.0, atol=1e-13)


def test_the_side_of_an_edge_does_not_matter():
    surface = meshes.jittered()
    ends = surface.edges.points[[5, 9, 30]]
    share = np.array([0.2, 0.5, 0.9])
    edge, same = edges_of(surface, ends, share, np.ones(3, bool))
    turned, counted = edges_of(surface, ends[:, ::-1], 1.0 - share, np.array([True, False, True]))
    assert edge.tolist() == [5, 9, 30]
    assert turned.tolist() == [5, -1, 30]
    assert np.allclose(same, share)
    assert np.allclose(counted, share)


def test_triangles_that_pieces_cross():
    surface = meshes.jittered()
    for t in (0, 7, 40):
        a, b, c = surface.triangles[t].tolist()
        one = np.array([[a, b], [a, a], [c, a], [a, a], [a, b]])
        two = np.array([[c, b], [c, b], [b, c], [b, b], [b, b]])
        assert chord_triangles(surface, one, two).tolist() == [t, t, t, -1, -1]


# ---- which lines meet ----


def crosses(a, b, c, d):
    """Whether two segments of the plane cross in the inside of both; None if that is a matter of rounding."""

    def side(p, q, r):
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    sides = [side(a, b, c), side(a, b, d), side(c, d, a), side(c, d, b)]
    if min(map(abs, sides)) < 1e-9:
        return None
    return bool(sides[0] * sides[1] < 0 and sides[2] * sides[3] < 0)


@pytest.mark.parametrize("at_points", [0.0, 0.5])
def test_meeting_lines_are_those_that_brute_force_finds(at_points):
    found = 0
    for seed in range(6):
        rng = np.random.default_rng(seed)
        surface = meshes.jittered(7, 6, seed, 0.35)
        lines = random_lines(surface, 40, rng, at_points)
        segments = {name: line.positions(surface.points)[[0, -1], :2] for name, line in lines.items()}
        crossing, meets = meeting(surface, lines, touching=False), meeting(surface, lines)
        assert crossing <= meets
        for one, two in combinations(lines, 2):
            expected = crosses(*segments[one], *segments[two])
            pair = frozenset((one, two))
            if expected is not None:
                assert (pair in crossing) == expected, pair
                found += expected
    assert found > 500


def test_touching_lines_count_if_asked():
    surface = meshes.grid(3, 3, 2.0, 2.0)
    mesh = HalfEdges.of(surface)
    one = line_from(surface, mesh, Place(int(mesh.first[6]), 0.0), Place(int(mesh.first[2]), 0.0))
    other = Line(np.array([[4, 4], [0, 1]]), np.array([0.0, 0.5]), (), np.zeros(0))
    assert meeting(surface, {"a": one, "b": other}, touching=False) == set()
    assert meeting(surface, {"a": one, "b": other}) == {frozenset("ab")}
    # Two that leave one point into the same triangle.
    first, second = (Line(np.array([[4, 4], [0, 1]]), np.array([0.0, t]), (), np.zeros(0)) for t in (0.3, 0.7))
    assert meeting(surface, {"a": first, "b": second}, touching=False) == set()
    assert meeting(surface, {"a": first, "b": second}) == {frozenset("ab")}
    # Two that come to nearly one place of an edge, from the same side or from either.
    for ends in ([[0, 1], [0, 4]], [[0, 3], [0, 4]]):
        near = Line(np.array([[0, 1], [0, 4]]), np.array([0.3, 0.5]), (), np.zeros(0))
        beside = Line(np.array(ends), np.array([0.6, 0.5 + 5e-4]), (), np.zeros(0))
        farther = Line(np.array(ends), np.array([0.6, 0.52]), (), np.zeros(0))
        assert meeting(surface, {"a": near, "b": beside}) == {frozenset("ab")}
        assert meeting(surface, {"a": near, "b": beside}, touching=False) == set()
        assert meeting(surface, {"a": near, "b": farther}) == set()
    assert meeting(surface, {}) == set()


@pytest.mark.parametrize("order", [[0, 1, 2], [1, 0, 2], [2, 1, 0]])
def test_all_pairs_through_one_point_touch(order):
    """Also those of which neither is the first to come."""
    lines = {
        "a": Line(np.array([[4, 4], [0, 1]]), np.array([0.0, 0.5]), (), np.zeros(0)),
        "b": Line(np.array([[4, 4], [1, 5]]), np.array([0.0, 0.5]), (), np.zeros(0)),
        "c": Line(np.array([[4, 4], [0, 3]]), np.array([0.0, 0.5]), (), np.zeros(0)),
    }
    chosen = {"abc"[k]: lines["abc"[k]] for k in order}
    expected = {frozenset(pair) for pair in ("ab", "ac", "bc")}
    assert meeting(meshes.grid(3, 3, 2.0, 2.0), chosen) == expected


def test_all_pairs_at_nearly_one_place_touch():
    lines = {
        name: Line(np.array([[0, 1], [0, 4]]), np.array([share, 0.5 + k * 4e-4]), (), np.zeros(0))
        for k, (name, share) in enumerate(zip("abc", (0.3, 0.4, 0.5), strict=True))
    }
    assert meeting(meshes.grid(3, 3, 2.0, 2.0), lines) == {frozenset(pair) for pair in ("ab", "ac", "bc")}


def test_a_line_along_an_edge_meets_those_across_it():
    surface = meshes.grid(3, 3, 2.0, 2.0)
    along = Line(np.array([[3, 3], [4, 4]]), np.zeros(2), (), np.zeros(0))
    across = Line(np.array([[0, 4], [3, 4], [3, 7]]), np.full(3, 0.5), (), np.zeros(0))
    beside = Line(np.array([[0, 4], [1, 4]]), np.full(2, 0.5), (), np.zeros(0))
    short = Line(np.array([[3, 4], [4, 4]]), np.array([0.7, 0.0]), (), np.zeros(0))
    lines = {"along": along, "across": across, "beside": beside, "short": short}
    for touching in (True, False):
        pairs = meeting(surface, lines, touching)
        assert frozenset(("along", "across")) in pairs
        assert frozenset(("along", "beside")) not in pairs
        assert frozenset(("short", "across")) not in pairs
