"""Half-edges, and lines across triangles against closed forms and the exact algorithm of another library."""

import meshes
import numpy as np
import pytest
from pygeodesic.geodesic import PyGeodesicAlgorithmExact
from scipy import sparse
from scipy.spatial import ConvexHull

from LAFlatteningLib.geodesic_lines import Line, Place, settle, straighten
from LAFlatteningLib.geodesics import PathTree
from LAFlatteningLib.half_edges import HalfEdges
from LAFlatteningLib.surface import Surface

SURFACES = {
    "plane": meshes.jittered(),
    "sphere": meshes.icosphere(2.0, 2),
    "hole": meshes.annulus(1.0, 3.0, 5, 16),
    "tube": meshes.cylinder(around=9, up=5),
}


def bumpy(seed=4, height=0.3):
    """A sphere with points pushed in and out: many of its points have more than a full turn round them."""
    sphere = meshes.icosphere(5.0, 3)
    heights = 1.0 + height * np.random.default_rng(seed).random((len(sphere.points), 1))
    return Surface(sphere.points * heights, sphere.triangles)


def place_at(mesh, point):
    return Place(int(mesh.first[point]), 0.0)


def position(mesh, place):
    h = place.half_edge
    return (1.0 - place.share) * mesh.points[mesh.origin[h]] + place.share * mesh.points[mesh.end(h)]


def strip_between(surface, mesh, start, stop, weights=None):
    """A strip along the shortest edge path, or along a wild one where edges have other weights."""
    graph = surface.edge_graph
    if weights is not None:
        a, b = surface.edges.points.T
        half = sparse.coo_matrix((weights, (a, b)), shape=graph.shape)
        graph = (half + half.T).tocsr()
    return mesh.along(PathTree(graph, start).to(stop).tolist(), None, None)


def line_between(surface, mesh, start, stop, weights=None, clearance=0.0):
    strip = strip_between(surface, mesh, start, stop, weights)
    return straighten(mesh, place_at(mesh, start), place_at(mesh, stop), strip, clearance)


def assert_strip(mesh, strip, start, stop):
    """Half-edges that follow each other from one triangle to another, no triangle twice."""
    entered = [start, *(int(mesh.twin[h]) // 3 for h in strip)]
    assert [h // 3 for h in strip] == entered[:-1]
    assert entered[-1] == stop
    assert len(set(entered)) == len(entered)


# ---- half-edges ----


@pytest.mark.parametrize("kind", SURFACES)
def test_half_edges_belong_to_their_triangles_and_to_each_other(kind):
    surface = SURFACES[kind]
    mesh = HalfEdges.of(surface)
    directed = {}
    for t, corners in enumerate(surface.triangles.tolist()):
        for k in range(3):
            directed[corners[k], corners[(k + 1) % 3]] = 3 * t + k
    for (a, b), h in directed.items():
        assert (mesh.origin[h], mesh.end(h)) == (a, b)
        assert mesh.twin[h] == directed.get((b, a), -1)
        assert mesh.out_of(h // 3, a) == h
        assert {p for p in surface.triangles[h // 3].tolist() if mesh.touches(h, p)} == {a, b}
    assert mesh.ends(list(directed.values())).tolist() == [list(edge) for edge in directed]


@pytest.mark.parametrize("kind", SURFACES)
def test_fan_has_all_triangles_round_a_point_counter_clockwise(kind):
    surface = SURFACES[kind]
    mesh = HalfEdges.of(surface)
    rims = set(np.concatenate([*surface.boundary_loops, np.zeros(0, int)]).tolist())
    for point in range(len(surface.points)):
        fan = mesh.fan(point)
        expected = np.flatnonzero((surface.triangles == point).any(axis=1))
        assert sorted(h // 3 for h in fan) == expected.tolist()
        assert (mesh.origin[fan] == point).all()
        # The last corner of a triangle is the second one of the next.
        third = [int(np.setdiff1d(surface.triangles[h // 3], [point, mesh.end(h)])[0]) for h in fan]
        following = [mesh.end(h) for h in fan]
        assert third[:-1] == following[1:]
        assert (third[-1] != following[0]) == (point in rims)
        # The angles add up: infinite at rims.
        if point in rims:
            assert np.isinf(mesh.angles[point])
            continue
        spokes = surface.points[following] - surface.points[point]
        spokes /= np.linalg.norm(spokes, axis=1, keepdims=True)
        total = np.arccos(np.einsum("ij,ij->i", spokes, np.roll(spokes, -1, axis=0))).sum()
        assert mesh.angles[point] == pytest.approx(total, abs=1e-12)


def test_angles_are_a_full_turn_in_the_plane():
    surface = SURFACES["plane"]
    angles = HalfEdges.of(surface).angles
    assert np.isfinite(angles).sum() == 6 * 5
    assert np.allclose(angles[np.isfinite(angles)], 2.0 * np.pi, atol=1e-12)


@pytest.mark.parametrize("kind", SURFACES)
def test_turns_keep_the_point_on_the_side_asked_for(kind):
    surface = SURFACES[kind]
    mesh = HalfEdges.of(surface)
    for point in range(0, len(surface.points), 3):
        fan = [h // 3 for h in mesh.fan(point)]
        closed = np.isfinite(mesh.angles[point])
        for i, start in enumerate(fan):
            for j, stop in enumerate(fan):
                for left in (True, False):
                    strip = mesh.turn(start, stop, point, left)
                    steps = j - i if left else i - j
                    if steps < 0 and not closed:
                        assert strip is None
                        continue
                    assert_strip(mesh, strip, start, stop)
                    assert len(strip) == steps % len(fan)
                    # Ends of the half-edges are left of the walk, starts right of it.
                    assert (mesh.ends(strip).reshape(-1, 2)[:, 1 if left else 0] == point).all()


@pytest.mark.parametrize("kind", SURFACES)
def test_strips_along_points_have_no_detours(kind):
    surface = SURFACES[kind]
    mesh = HalfEdges.of(surface)
    rng = np.random.default_rng(1)
    for _ in range(40):
        start, stop = (int(i) for i in rng.choice(len(surface.points), 2, replace=False))
        strip = strip_between(surface, mesh, start, stop, rng.random(len(surface.edges.points)) ** 3)
        if strip:
            assert_strip(mesh, strip, strip[0] // 3, int(mesh.twin[strip[-1]]) // 3)
            assert start in surface.triangles[strip[0] // 3]
            assert stop in surface.triangles[int(mesh.twin[strip[-1]]) // 3]


def test_loops_are_taken_out_of_a_strip():
    surface = SURFACES["plane"]
    mesh = HalfEdges.of(surface)
    point = int(np.flatnonzero(np.isfinite(mesh.angles))[7])
    fan = [h // 3 for h in mesh.fan(point)]
    there, back = (mesh.turn(fan[0], fan[2], point, left) for left in (True, False))
    once_round = [*mesh.turn(fan[0], fan[-1], point, True), *mesh.turn(fan[-1], fan[0], point, True)]
    assert len(once_round) == len(fan)
    assert mesh.without_detours(once_round) == []
    assert mesh.without_detours([*once_round, *there]) == there
    return_way = [int(mesh.twin[h]) for h in there[::-1]]
    assert mesh.without_detours([*there, *return_way]) == []
    assert mesh.without_detours([*there, *return_way, *back]) == back
    assert mesh.without_detours(there) == there


def test_a_strip_with_a_loop_gives_the_same_line():
    surface = SURFACES["plane"]
    mesh = HalfEdges.of(surface)
    strip = strip_between(surface, mesh, 8, 47)
    straight = straighten(mesh, place_at(mesh, 8), place_at(mesh, 47), strip)
    point = next(p for p in surface.triangles[strip[3] // 3].tolist() if np.isfinite(mesh.angles[p]))
    first = strip[3] // 3
    fan = [h // 3 for h in mesh.fan(point)]
    before = fan[fan.index(first) - 1]
    loop = [*mesh.turn(first, before, point, True), *mesh.turn(before, first, point, True)]
    assert len(loop) == len(fan)
    line = straighten(mesh, place_at(mesh, 8), place_at(mesh, 47), [*strip[:3], *loop, *strip[3:]])
    assert np.array_equal(line.ends, straight.ends)
    assert np.allclose(line.share, straight.share)


def test_strips_along_points_start_and_end_where_asked():
    surface = SURFACES["plane"]
    mesh = HalfEdges.of(surface)
    for points in ([9, 10, 11, 19], [0, 8, 9], [20]):
        for start in (h // 3 for h in mesh.fan(points[0])):
            for stop in (h // 3 for h in mesh.fan(points[-1])):
                assert_strip(mesh, mesh.along(points, start, stop), start, stop)


def test_apexes_are_the_third_points():
    surface = bumpy()
    mesh = HalfEdges.of(surface)
    h = np.arange(len(mesh.origin))
    a, b = surface.points[mesh.ends(h)].swapaxes(0, 1)
    c = surface.points[surface.triangles.reshape(-1)[h - h % 3 + (h + 2) % 3]]
    apex = mesh.apexes[h]
    side = np.linalg.norm(b - a, axis=1)
    assert (apex.imag > 0).all()
    assert np.allclose(np.abs(apex) * side, np.linalg.norm(c - a, axis=1), rtol=1e-12)
    assert np.allclose(np.abs(apex - 1.0) * side, np.linalg.norm(c - b, axis=1), rtol=1e-12)


def test_diagonals_in_the_plane_are_straight():
    """Between the tips of two neighbouring triangles that form a convex quadrilateral: distances in the plane."""
    surface = meshes.jittered(10, 9, seed=3, amount=0.45)
    at = surface.points[:, :2]
    expected, doubtful = set(), set()
    for edge, pair in zip(surface.edges.points, surface.edges.triangles, strict=True):
        if pair[1] < 0:
            continue
        tips = [int(np.setdiff1d(surface.triangles[t], edge)[0]) for t in pair]
        across, along = at[tips[1]] - at[tips[0]], at[edge[1]] - at[edge[0]]
        t, _ = np.linalg.solve(np.stack([along, -across], axis=1), at[tips[0]] - at[edge[0]])
        if 0.0 < t < 1.0:
            expected.add(frozenset(tips))
        if min(abs(t), abs(1.0 - t)) < 1e-9:
            # Three points of a straight rim.
            doubtful.add(frozenset(tips))
    ends, lengths = HalfEdges.of(surface).diagonals()
    found = {frozenset(pair): length for pair, length in zip(ends.tolist(), lengths, strict=True)}
    assert len(found) == len(ends)
    assert found.keys() - doubtful == expected - doubtful
    assert len(doubtful) < 10
    assert len(found) < np.count_nonzero(surface.edges.usage == 2), "the test needs quadrilaterals that are not convex"
    for pair, length in found.items():
        assert length == pytest.approx(np.linalg.norm(np.diff(at[list(pair)], axis=0)), rel=1e-12)


# ---- straight lines where the answer is known ----


def assert_straight(surface, line, a, b):
    """The places of the line are on the segment from a to b, one after the other, and fill it."""
    at = line.positions(surface.points)
    length = np.linalg.norm(b - a)
    assert line.length(surface.points) == pytest.approx(length, abs=1e-12)
    along = (at - a) @ (b - a) / length
    assert np.linalg.norm(at - a - along[:, None] * (b - a) / length, axis=1).max() < 1e-12
    assert (np.diff(along) > 0.0).all()
    assert along[0] == pytest.approx(0.0, abs=1e-12)
    assert along[-1] == pytest.approx(length, abs=1e-12)


@pytest.mark.parametrize("amount", [0.0, 0.3, 0.45])
def test_plane_from_any_strip(amount):
    surface = meshes.jittered(12, 10, 1, amount) if amount else meshes.grid(8, 7, 7.0, 6.0)
    mesh = HalfEdges.of(surface)
    rng = np.random.default_rng(2)
    for _ in range(60):
        start, stop = (int(i) for i in rng.choice(len(surface.points), 2, replace=False))
        line = line_between(surface, mesh, start, stop, rng.random(len(surface.edges.points)) ** 3)
        assert_straight(surface, line, surface.points[start], surface.points[stop])
        # Every piece is inside one triangle, or along its edge.
        for one, two in zip(line.ends[:-1], line.ends[1:], strict=True):
            corners = np.unique([one, two])
            assert np.isin(surface.triangles, corners).sum(axis=1).max() == len(corners) <= 3


def test_places_on_rims():
    surface = meshes.jittered(9, 8, 5)
    mesh = HalfEdges.of(surface)
    rim = np.flatnonzero(mesh.twin < 0)
    rng = np.random.default_rng(0)
    for trial in range(150):
        ends = [Place(int(rng.choice(rim)), float(rng.uniform(0.01, 0.99))) for _ in range(2)]
        if trial % 3 == 0:
            ends[trial % 2] = place_at(mesh, int(rng.integers(len(surface.points))))
        path = PathTree(surface.edge_graph, int(mesh.origin[ends[0].half_edge])).to(int(mesh.origin[ends[1].half_edge]))
        strip = mesh.along(path.tolist(), ends[0].half_edge // 3, ends[1].half_edge // 3)
        line = straighten(mesh, *ends, strip)
        assert_straight(surface, line, position(mesh, ends[0]), position(mesh, ends[1]))


def test_within_one_triangle():
    surface = meshes.grid(2, 2)
    mesh = HalfEdges.of(surface)
    bottom, right = (int(mesh.out_of(0, point)) for point in (0, 1))
    assert mesh.twin[bottom] == mesh.twin[right] == -1
    line = straighten(mesh, Place(bottom, 0.25), Place(right, 0.5), [])
    assert np.allclose(line.positions(surface.points), [[0.25, 0, 0], [1, 0.5, 0]])
    line = straighten(mesh, Place(bottom, 0.25), place_at(mesh, 3), [])
    assert np.allclose(line.positions(surface.points), [[0.25, 0, 0], [1, 1, 0]])
    line = straighten(mesh, Place(bottom, 0.75), Place(bottom, 0.25), [])
    assert line.length(surface.points) == pytest.approx(0.5)
    # Once round the other triangle makes no difference.
    line = straighten(mesh, place_at(mesh, 0), place_at(mesh, 3), [mesh.out_of(0, 3)])
    assert np.array_equal(line.ends, [[0, 0], [3, 3]])


def test_a_line_turned_round_and_its_places():
    surface = SURFACES["plane"]
    mesh = HalfEdges.of(surface)
    line = line_between(surface, mesh, 3, 50)
    at = line.positions(surface.points)
    assert np.array_equal(line.reversed().positions(surface.points), at[::-1])
    assert line.reversed().length(surface.points) == pytest.approx(line.length(surface.points))
    for k in (0, 2, -1):
        assert np.array_equal(line.place(k).positions(surface.points), at[[k]])
        assert line.place(k).length(surface.points) == 0.0


@pytest.mark.parametrize("around", [7, 20])
def test_helices_on_the_cylinder(around):
    """A prism unrolls into the plane: straight lines, once or several times round."""
    tube = meshes.cylinder(2.0, 6.0, around, 12)
    mesh = HalfEdges.of(tube)
    side = 4.0 * np.sin(np.pi / around)
    face = np.round(np.arctan2(tube.points[:, 1], tube.points[:, 0]) * around / (2.0 * np.pi)).astype(int)
    rng = np.random.default_rng(0)
    shortest = 0
    for trial in range(80):
        start, stop = (int(i) for i in rng.choice(len(tube.points), 2, replace=False))
        weights = rng.random(len(tube.edges.points)) ** 3 if trial % 2 else None
        found = line_between(tube, mesh, start, stop, weights).length(tube.points)
        turns = (face[stop] - face[start]) % around + around * np.arange(-3, 4)
        exact = np.hypot(turns * side, tube.points[stop, 2] - tube.points[start, 2])
        assert np.abs(exact - found).min() < 1e-11
        shortest += found < exact.min() + 1e-11
    assert shortest > 40


def test_tetrahedron():
    """No way passes the corners, so that all are straight lines of the unfolded surface."""
    surface, flat = meshes.tetrahedron(6)
    mesh = HalfEdges.of(surface)
    i, j = np.meshgrid(np.arange(-6, 7), np.arange(-6, 7))
    lattice = 2.0 * np.stack([i + 0.5 * j, np.sqrt(0.75) * j], axis=2).reshape(-1, 2)
    exact = PyGeodesicAlgorithmExact(surface.points, surface.triangles.astype(np.int32))
    rng = np.random.default_rng(0)
    shortest = 0
    for trial in range(80):
        start, stop = (int(i) for i in rng.choice(len(flat), 2, replace=False))
        known = np.linalg.norm(flat[start] - np.concatenate([flat[stop] + lattice, lattice - flat[stop]]), axis=1)
        assert exact.geodesicDistance(start, stop)[0] == pytest.approx(known.min(), abs=1e-9)
        weights = rng.random(len(surface.edges.points)) ** 3 if trial % 2 else None
        found = line_between(surface, mesh, start, stop, weights).length(surface.points)
        assert np.abs(known - found).min() < 1e-11
        shortest += found < known.min() + 1e-11
    assert shortest > 40


def test_great_circles():
    """The polyhedron comes nearer to the sphere with the square of its edges, and so do the lines."""
    rng = np.random.default_rng(1)
    directions = meshes.icosphere(1.0, 1).points
    pairs = [tuple(pair) for pair in rng.choice(len(directions), (60, 2)) if pair[0] != pair[1]]
    errors = []
    for subdivisions in (1, 2, 3):
        # Subdivision keeps the ids of the points that are there.
        sphere = meshes.icosphere(1.0, subdivisions)
        assert np.array_equal(sphere.points[: len(directions)], directions)
        mesh = HalfEdges.of(sphere)
        ratio = []
        for start, stop in pairs:
            arc = np.arccos(np.clip(directions[start] @ directions[stop], -1.0, 1.0))
            ratio.append(line_between(sphere, mesh, int(start), int(stop)).length(sphere.points) / arc)
        errors.append(max(abs(np.array(ratio) - 1.0)))
    assert errors[-1] < 1e-2
    assert errors[0] / errors[1] > 3.0
    assert errors[1] / errors[2] > 3.0


# ---- lines of least length, against other computations ----


def angle(a, b):
    return np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)


def assert_locally_shortest(surface, line):
    """Unfolded, the line is straight on every edge; at a point, it has at least half a turn on either side."""
    at = line.positions(surface.points)
    for k in range(1, len(at) - 1):
        a, b = line.ends[k]
        before, after = at[k - 1] - at[k], at[k + 1] - at[k]
        if a != b:
            edge = surface.points[b] - surface.points[a]
            assert angle(before, edge) + angle(after, edge) == pytest.approx(np.pi, abs=1e-6)
            continue
        # Corners of the point's triangles in order, and where in this order the line comes and goes.
        around = {}
        for corners in surface.triangles[(surface.triangles == a).any(axis=1)].tolist():
            i = corners.index(a)
            around[corners[(i + 1) % 3]] = corners[(i + 2) % 3]
        ring = [next(iter(around))]
        while around[ring[-1]] != ring[0]:
            ring.append(around[ring[-1]])
        spokes = surface.points[ring] - surface.points[a]
        turns = np.cumsum([0.0, *(angle(u, v) for u, v in zip(spokes, np.roll(spokes, -1, axis=0), strict=True))])
        directions = []
        for other, way in ((k - 1, before), (k + 1, after)):
            corners = set(line.ends[other].tolist()) - {a}
            i = next(i for i in range(len(ring)) if corners <= {ring[i], ring[(i + 1) % len(ring)]} and corners)
            directions.append(turns[i] + angle(spokes[i], way))
        one = abs(directions[0] - directions[1])
        assert min(one, turns[-1] - one) > np.pi - 1e-6


def test_lines_on_a_rough_surface_cannot_be_shortened():
    surface = bumpy()
    mesh = HalfEdges.of(surface)
    exact = PyGeodesicAlgorithmExact(surface.points, surface.triangles.astype(np.int32))
    rng = np.random.default_rng(3)
    through = 0
    for trial in range(40):
        start, stop = (int(i) for i in rng.choice(len(surface.points), 2, replace=False))
        weights = rng.random(len(surface.edges.points)) ** 3 if trial % 2 else None
        line = line_between(surface, mesh, start, stop, weights)
        assert_locally_shortest(surface, line)
        through += (line.ends[1:-1, 0] == line.ends[1:-1, 1]).any()
        if trial < 12:
            shortest = exact.geodesicDistance(start, stop)[0]
            assert line.length(surface.points) >= shortest * (1.0 - 1e-9)
            if not trial % 2:
                edges = PathTree(surface.edge_graph, start).distance[stop]
                assert line.length(surface.points) <= edges * (1.0 + 1e-12)
    assert through > 10, "the test needs lines that bend at points"


def test_gently_curved_surfaces_have_the_exact_distances():
    sphere = meshes.icosphere(5.0, 3)
    surface = Surface(sphere.points * [1.0, 0.8, 1.3], sphere.triangles)
    mesh = HalfEdges.of(surface)
    exact = PyGeodesicAlgorithmExact(surface.points, surface.triangles.astype(np.int32))
    rng = np.random.default_rng(0)
    ratio = []
    for _ in range(25):
        start, stop = (int(i) for i in rng.choice(len(surface.points), 2, replace=False))
        shortest = exact.geodesicDistance(start, stop)[0]
        ratio.append(line_between(surface, mesh, start, stop).length(surface.points) / shortest)
    # Lines on either side of a point are nearly as long as each other; most are the very shortest.
    assert min(ratio) > 1.0 - 1e-9
    assert np.median(ratio) < 1.0 + 1e-9
    assert max(ratio) < 1.002


# ---- rims in the way ----

SQUARE = np.array([[4.0, 4.0], [6.0, 4.0], [6.0, 6.0], [4.0, 6.0]])
DISK = np.stack(
    [5.0 + np.cos(np.linspace(0, 2 * np.pi, 24, False)), 5.0 + np.sin(np.linspace(0, 2 * np.pi, 24, False))], 1
)


def taut(hole, a, b):
    """Lengths of the two strings pulled tight round a convex hole that is between a and b, above and below."""
    points = np.concatenate([[a, b], hole])
    ring = ConvexHull(points).vertices.tolist()
    assert 0 in ring
    assert 1 in ring
    ring = ring[ring.index(0) :] + ring[: ring.index(0)]
    split = ring.index(1)
    # Counter-clockwise from a on the left, the first half runs below the hole.
    below, above = points[ring[: split + 1]], points[[*ring[split:], 0]]
    return [np.linalg.norm(np.diff(way, axis=0), axis=1).sum() for way in (above, below)]


@pytest.mark.parametrize("hole", [SQUARE, DISK], ids=["square", "disk"])
def test_a_string_pulled_tight_round_a_hole(hole):
    surface = meshes.pierced(10.0, 21, [hole], 0)
    assert sorted(map(len, surface.boundary_loops)) == [len(hole) if len(hole) > 4 else 16, 80]
    mesh = HalfEdges.of(surface)
    x, y = surface.points[:, 0], surface.points[:, 1]
    level = (y > 4.3) & (y < 5.7)
    a, b = surface.edges.points.T
    rng = np.random.default_rng(0)
    for _ in range(25):
        start, stop = int(rng.choice(np.flatnonzero(level & (x < 3)))), int(rng.choice(np.flatnonzero(level & (x > 7))))
        for side, length in zip((1, -1), taut(hole, surface.points[start, :2], surface.points[stop, :2]), strict=True):
            # No edge leads on through where the hole's other side is.
            barred = (side * (y - 5.0) < 0.0) & (np.abs(x - 5.0) < 1.0)
            line = line_between(surface, mesh, start, stop, surface.edge_lengths + 1e3 * (barred[a] | barred[b]))
            assert line.length(surface.points) == pytest.approx(length, abs=1e-11)
            assert line.length(surface.points) > np.linalg.norm(surface.points[start] - surface.points[stop]) + 1e-3


def test_clearance_keeps_off_the_rim():
    surface = meshes.pierced(10.0, 21, [SQUARE], 1)
    mesh = HalfEdges.of(surface)
    hole = min(surface.boundary_loops, key=len)
    x, y = surface.points[:, 0], surface.points[:, 1]
    rng = np.random.default_rng(0)
    level = (y > 4.3) & (y < 5.7)
    for _ in range(25):
        start, stop = int(rng.choice(np.flatnonzero(level & (x < 3)))), int(rng.choice(np.flatnonzero(level & (x > 7))))
        touching = line_between(surface, mesh, start, stop)
        assert np.isin(touching.ends, hole).all(axis=1).any()
        line = line_between(surface, mesh, start, stop, clearance=0.25)
        near = np.isin(line.ends[1:-1], hole)
        assert near.any()
        assert not near.all(axis=1).any()
        assert (line.share[1:-1][near[:, 0]] > 0.25 - 1e-12).all()
        assert (line.share[1:-1][near[:, 1]] < 0.75 + 1e-12).all()
        # Farther by no more than there and back at each edge that ends on the rim, a quarter of it.
        edges = surface.points[line.ends[1:-1, 0]] - surface.points[line.ends[1:-1, 1]]
        allowed = 0.5 * np.linalg.norm(edges[near.any(axis=1)], axis=1).sum()
        assert 0.0 < line.length(surface.points) - touching.length(surface.points) < allowed


# ---- settling on points that are all but touched ----


def horizontal(surface, mesh, height):
    """The line at one height over a grid of unit squares."""
    rim = np.flatnonzero(mesh.twin < 0)
    ends = surface.points[mesh.ends(rim)]
    across = ((ends[..., 1] - height).prod(axis=1) < 0) & (np.ptp(ends[..., 0], axis=1) == 0)
    places = []
    for h, (a, b) in sorted(zip(rim[across].tolist(), ends[across], strict=True), key=lambda item: item[1][0, 0]):
        places.append(Place(h, float((height - a[1]) / (b[1] - a[1]))))
    path = PathTree(surface.edge_graph, int(mesh.origin[places[0].half_edge])).to(int(mesh.origin[places[1].half_edge]))
    strip = mesh.along(path.tolist(), *(place.half_edge // 3 for place in places))
    return straighten(mesh, *places, strip)


def test_a_line_beside_a_row_of_points_goes_through_them():
    surface = meshes.grid(6, 4, 5.0, 3.0)
    line = horizontal(surface, HalfEdges.of(surface), 1.04)
    inner = np.ones(len(surface.points), bool)
    inner[surface.boundary_loops[0]] = False
    settled = settle(line, surface.points, inner, 0.1)
    # The first and the last place stay, and the one on the diagonal at the left, whose near end is on the rim.
    through = [[7, 7], [8, 8], [9, 9], [10, 10]]
    assert settled.ends.tolist() == [line.ends[0].tolist(), line.ends[1].tolist(), *through, line.ends[-1].tolist()]
    assert sorted(line.ends[1].tolist()) == [6, 13]
    expected = 0.04 + np.hypot(0.96, 0.04) + 3.0 + np.hypot(1.0, 0.04)
    assert settled.length(surface.points) == pytest.approx(expected, abs=1e-12)
    # One that is not allowed is passed as before.
    passed = settle(line, surface.points, inner & (np.arange(len(inner)) != 8), 0.1)
    assert 8 not in passed.ends[passed.ends[:, 0] == passed.ends[:, 1]]
    assert {7, 9, 10} <= set(passed.ends[passed.ends[:, 0] == passed.ends[:, 1], 0].tolist())
    assert (passed.ends == [8, 14]).all(axis=1).any() or (passed.ends == [14, 8]).all(axis=1).any()
    # Too far away.
    assert settle(line, surface.points, inner, 0.02) is line


@pytest.mark.parametrize("tolerance", [0.1, 0.4])
@pytest.mark.parametrize("seed", range(3))
def test_settled_lines_stay_lines_across_triangles(seed, tolerance):
    surface = meshes.jittered(14, 12, seed)
    mesh = HalfEdges.of(surface)
    rng = np.random.default_rng(seed)
    inner = np.isfinite(mesh.angles)
    longest = surface.edge_lengths.max()
    settled_at = 0
    for _ in range(40):
        start, stop = (int(i) for i in rng.choice(len(surface.points), 2, replace=False))
        line = line_between(surface, mesh, start, stop)
        allowed = inner & (rng.random(len(inner)) < 0.8)
        settled = settle(line, surface.points, allowed, tolerance)
        for one, two in zip(settled.ends[:-1], settled.ends[1:], strict=True):
            corners = np.unique([one, two])
            assert 1 < len(corners) <= 3
            assert np.isin(surface.triangles, corners).sum(axis=1).max() == len(corners)
        assert np.array_equal(settled.ends[[0, -1]], line.ends[[0, -1]])
        before = set(line.ends[line.ends[:, 0] == line.ends[:, 1], 0].tolist())
        through = settled.ends[settled.ends[:, 0] == settled.ends[:, 1], 0].tolist()
        assert len(set(through)) == len(through)
        new = [point for point in through if point not in before]
        assert allowed[new].all()
        # Each is near the straight line, and there and back from it is the most that it adds.
        a, b = surface.points[start], surface.points[stop]
        off = np.linalg.norm(np.cross(surface.points[new] - a, (b - a) / np.linalg.norm(b - a)), axis=1)
        assert (off < tolerance * longest).all()
        added = settled.length(surface.points) - np.linalg.norm(b - a)
        assert -1e-12 < added <= 2.0 * off.sum() + 1e-12
        settled_at += len(new)
    assert settled_at > 20


def test_a_line_of_one_piece_settles_nowhere():
    surface = SURFACES["plane"]
    line = Line(np.array([[0, 1], [0, 8]]), np.array([0.01, 0.01]), (), np.zeros(0))
    assert settle(line, surface.points, np.ones(len(surface.points), bool), 0.1) is line
