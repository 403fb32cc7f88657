"""Ways from seed to seed in the plane, where they are known, and the division that they make of the phantom."""

from itertools import pairwise
from types import SimpleNamespace

import meshes
import networkx
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from LAFlatteningLib import line_division
from LAFlatteningLib.anatomy import LEFT_ATRIUM
from LAFlatteningLib.cavity.openings import Cavity, make_cavity
from LAFlatteningLib.errors import SeedError
from LAFlatteningLib.flattening import Flattener
from LAFlatteningLib.geodesic_lines import Line, Place, straighten
from LAFlatteningLib.geodesics import PathTree
from LAFlatteningLib.half_edges import HalfEdges
from LAFlatteningLib.insertion import Inserted, insert_lines
from LAFlatteningLib.line_division import NEAR_POINT, _feet, _lead_between, _Rim, _sort_out, divide
from LAFlatteningLib.ostium_ways import WaysAcrossOstia, rim_place
from LAFlatteningLib.phantom import make_phantom
from LAFlatteningLib.seed_paths import _connect, connect_seeds
from LAFlatteningLib.seeds import SnappedSeeds, snap_seeds
from LAFlatteningLib.surface import Surface
from LAFlatteningLib.template import Template

TEMPLATE = Template.load("adapted1")

# ---- ways across ostia, in the plane ----


def regular(x, y, radius, corners=12):
    turn = 2.0 * np.pi * np.arange(corners) / corners
    return np.array([x, y]) + radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)


def plane_cavity(size, n, holes, seed=0, tall=1.0):
    """A flat square with holes, as a cavity with an outer rim. Its covers are left out: no way across needs them.

    With `tall`, a rectangle of triangles that are higher than wide by this factor.
    """
    flat = meshes.pierced(size, n, [hole / [1.0, tall] for hole in holes], seed)
    surface = Surface(flat.points * [1.0, tall, 1.0], flat.triangles)
    centres = [surface.points[loop, :2].mean(axis=0) for loop in surface.boundary_loops[1:]]
    order = [int(np.argmin([np.linalg.norm(c - hole.mean(axis=0)) for c in centres])) for hole in holes]
    rims = tuple(surface.boundary_loops[1 + k] for k in order)
    whole = np.full(len(surface.triangles), -1)
    return Cavity(surface, whole, surface, np.arange(len(surface.points)), rims, surface.boundary_loops[0])


def seeds_at(places, outer_at=None, cavity=None):
    """Seeds of the first holes of a cavity, and coordinates along its outer rim."""
    positions = {label: np.array([*at, 0.0]) for label, at in places.items()}
    for label, at in (outer_at or {}).items():
        a, b = cavity.surface.points[cavity.outer[[int(at), (int(at) + 1) % len(cavity.outer)]]]
        positions[label] = a + (at - int(at)) * (b - a)
    return SnappedSeeds({}, {label: k for k, label in enumerate(places)}, {}, positions, dict(outer_at or {}))


def on_polygon(polygon, start, stop):
    """Where the segment from a place inside a polygon to one outside leaves it."""
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        t, u = np.linalg.solve(np.stack([stop - start, a - b], axis=1), a - start)
        if 0.0 < t < 1.0 and 0.0 <= u <= 1.0:
            return start + t * (stop - start)
    raise AssertionError


TWO = [regular(15.0, 30.0, 6.0), regular(46.0, 33.0, 5.0)]


@pytest.fixture(scope="module")
def two_ostia():
    return plane_cavity(60.0, 25, TWO)


def test_nothing_in_the_way(two_ostia):
    """The straight line from seed to seed, wherever in their ostia they are; its feet are where it crosses the rims."""
    ways = WaysAcrossOstia(two_ostia, smoothing=0.0)
    points = two_ostia.surface.points
    rng = np.random.default_rng(0)
    for _ in range(15):
        a, b = (hole.mean(axis=0) + rng.uniform(-2.5, 2.5, 2) for hole in TWO)
        walk = ways.walk(seeds_at({"A": a, "B": b}), "A", "B")
        length = np.linalg.norm(b - a)
        assert walk.length == pytest.approx(length, abs=1e-10)
        along = (walk.positions[:, :2] - a) @ (b - a) / length
        assert np.abs(walk.positions[:, :2] - a - along[:, None] * (b - a) / length).max() < 1e-10
        feet = [on_polygon(TWO[0], a, b), on_polygon(TWO[1], b, a)]
        for (one, two, share), foot, rim in zip(walk.feet, feet, two_ostia.rims, strict=True):
            assert {one, two} <= set(rim.tolist())
            assert np.allclose((1.0 - share) * points[one] + share * points[two], [*foot, 0.0], atol=1e-10)
        assert np.allclose(walk.line.positions(points)[[0, -1], :2], feet, atol=1e-10)
        assert walk.line.length(points) == pytest.approx(np.linalg.norm(feet[1] - feet[0]), abs=1e-10)


@pytest.mark.parametrize("at", [0.0, 12.37, 29.5, 47.999, 60.0, 95.01])
def test_seeds_inside_edges_of_the_outer_rim(two_ostia, at):
    ways = WaysAcrossOstia(two_ostia, smoothing=0.0)
    points = two_ostia.surface.points
    seeds = seeds_at({"A": (14.0, 31.0)}, {"V": at}, two_ostia)
    walk = ways.walk(seeds, "A", "V")
    a, b = two_ostia.outer[[int(at), (int(at) + 1) % len(two_ostia.outer)]]
    goal = points[a] + (at - int(at)) * (points[b] - points[a])
    assert np.allclose(walk.positions[-1], goal, atol=1e-12)
    one, two, share = walk.feet[1]
    assert np.allclose((1.0 - share) * points[one] + share * points[two], goal, atol=1e-12)
    # The other ostium may be in the way.
    straight = np.linalg.norm(goal - seeds.positions["A"])
    assert walk.length >= straight - 1e-12
    t = np.linspace(0.0, 1.0, 500)[:, None]
    places = (1.0 - t) * seeds.positions["A"] + t * goal
    if np.linalg.norm(places[:, :2] - TWO[1].mean(axis=0), axis=1).min() > 5.0:
        assert walk.length == pytest.approx(straight, abs=1e-10)
    assert straight - 1e-12 <= ways.distance(seeds, "A", "V") <= 1.15 * walk.length
    assert ways.to_outer_rim(seeds, "A") <= ways.distance(seeds, "A", "V") + 1e-12


def test_no_way_leads_across_another_ostium():
    holes = [regular(12.0, 30.0, 5.0), regular(48.0, 30.0, 5.0), regular(30.0, 31.0, 8.0, 16)]
    cavity = plane_cavity(60.0, 25, holes)
    seeds = seeds_at({"A": (12.0, 30.0), "B": (48.0, 30.0), "C": (30.0, 31.0)})
    walk = WaysAcrossOstia(cavity, smoothing=0.0).walk(seeds, "A", "B")
    assert walk.length == pytest.approx(min(taut(holes[2], (12.0, 30.0), (48.0, 30.0))), abs=1e-10)
    assert walk.length > 36.5


def taut(hole, a, b):
    """Lengths of the two strings pulled tight from a to b round a convex hole between them."""
    points = np.concatenate([[a, b], hole])
    ring = ConvexHull(points).vertices.tolist()
    ring = ring[ring.index(0) :] + ring[: ring.index(0)]
    split = ring.index(1)
    ways = points[ring[: split + 1]], points[[*ring[split:], 0]]
    return [np.linalg.norm(np.diff(way, axis=0), axis=1).sum() for way in ways]


@pytest.mark.parametrize(
    ("tall", "seed", "offset"),
    [(1.7, 12, 0.1), (1.7, 22, 0.2), (1.7, 44, 0.1), (2.5, 0, 0.4), (2.5, 13, 0.4), (2.5, 58, 0.05)],
)
def test_the_shorter_of_two_ways_round_although_edges_mislead(tall, seed, offset):
    """Past a hole a little off the middle, on triangles along whose edges the way over it looks shorter."""
    middle_y = 30.0 * tall
    middle = regular(30.0, middle_y + offset, 9.0, 16)
    ends = (9.0, middle_y), (51.0, middle_y)
    cavity = plane_cavity(60.0, 25, [*(regular(*at, 4.0) for at in ends), middle], seed, tall)
    ways = WaysAcrossOstia(cavity, smoothing=0.0)
    seeds = seeds_at({"A": ends[0], "B": ends[1]})
    # Along edges, over points half-way, above and below.
    x, y = cavity.surface.points[:, 0], cavity.surface.points[:, 1]
    far = sum(from_seed(cavity, k, seeds.positions[label]) for k, label in enumerate("AB"))
    above, below = (far[(np.abs(x - 30.0) < 2.0) & side].min() for side in (y > middle_y, y < middle_y))
    assert 0.98 * below < above < below, "the test needs edges that mislead a little"
    walk = ways.walk(seeds, "A", "B")
    assert walk.length == pytest.approx(min(taut(middle, *ends)), abs=1e-9)
    assert walk.positions[np.abs(walk.positions[:, 0] - 30.0).argmin(), 1] < middle_y


def from_seed(cavity, hole, position):
    """Lengths of the shortest ways from the seed of a hole straight to its rim, then along edges and diagonals."""
    surface, rim = cavity.surface, cavity.rims[hole]
    graph = networkx.Graph()
    graph.add_weighted_edges_from(
        (a, b, length) for (a, b), length in zip(surface.edges.points.tolist(), surface.edge_lengths, strict=True)
    )
    ends, lengths = HalfEdges.of(surface).diagonals()
    graph.add_weighted_edges_from((a, b, length) for (a, b), length in zip(ends.tolist(), lengths, strict=True))
    for point in rim.tolist():
        graph.add_edge("seed", point, weight=np.linalg.norm(surface.points[point] - position))
    found = networkx.single_source_dijkstra_path_length(graph, "seed")
    return np.array([found[point] for point in range(len(surface.points))])


def test_lines_of_seeds_that_stay_are_kept(two_ostia):
    ways = WaysAcrossOstia(two_ostia, smoothing=0.0)
    places = {"A": (14.0, 31.0), "B": (46.0, 33.0)}
    seeds = seeds_at(places, {"V": 12.37}, two_ostia)
    pairs = [("A", "B"), ("A", "V"), ("B", "V")]
    before = {pair: ways.walk(seeds, *pair) for pair in pairs}
    same = seeds_at(dict(places), {"V": 12.37}, two_ostia)
    assert all(ways.walk(same, *pair) is before[pair] for pair in pairs)
    for moved in (
        seeds_at({**places, "B": (46.5, 33.0)}, {"V": 12.37}, two_ostia),
        seeds_at(places, {"V": 12.4}, two_ostia),
    ):
        for pair in pairs:
            kept = all(np.array_equal(moved.positions[label], seeds.positions[label]) for label in pair)
            walk = ways.walk(moved, *pair)
            assert (walk is before[pair]) == kept
            fresh = WaysAcrossOstia(two_ostia, smoothing=0.0).walk(moved, *pair)
            assert np.array_equal(walk.positions, fresh.positions)
            assert walk.length == fresh.length
        for pair in pairs:
            before[pair] = ways.walk(seeds, *pair)
            assert np.allclose(before[pair].positions[0], seeds.positions[pair[0]])
            assert np.allclose(before[pair].positions[-1], seeds.positions[pair[1]])


def test_walks_that_cross():
    holes = [regular(x, y, 4.0) for x, y in ((12, 12), (48, 12), (48, 48), (12, 48))]
    cavity = plane_cavity(60.0, 25, holes)
    ways = WaysAcrossOstia(cavity, smoothing=0.0)
    seeds = seeds_at({label: hole.mean(axis=0) for label, hole in zip("ABCD", holes, strict=True)})
    walks = {pair: ways.walk(seeds, *pair) for pair in ("AB", "BC", "CD", "DA", "AC", "BD")}
    assert ways.crossing(walks) == {frozenset(("AC", "BD"))}


def test_places_on_rims():
    surface = meshes.grid(5, 4, 4.0, 3.0)
    mesh = HalfEdges.of(surface)
    for loop in (surface.boundary_loops[0], surface.boundary_loops[0][::-1]):
        corners = surface.points[np.append(loop, loop[0])]
        for at in np.arange(0.0, len(loop), 0.25):
            place = rim_place(mesh, loop, at)
            a, b = surface.points[mesh.ends([place.half_edge])[0]]
            k = int(at)
            expected = corners[k] + (at - k) * (corners[k + 1] - corners[k])
            assert np.allclose((1.0 - place.share) * a + place.share * b, expected)
            assert place.share > 0 or mesh.origin[place.half_edge] == loop[k]
            assert place.share == 0 or mesh.twin[place.half_edge] < 0


def test_means_in_order_count_even_where_shortest_ways_leave_past_each_other():
    """Near its rim a seed's shortest ways may leave past one another, in an order that is still one round the rim."""
    surface = meshes.annulus(6.0, 20.0, 6, 54)
    loop = next(loop for loop in surface.boundary_loops if np.linalg.norm(surface.points[loop[0]]) < 7.0)
    rim = _Rim(surface, HalfEdges.of(surface), loop, False)
    order = LEFT_ATRIUM.feet("LIPV")
    mean = dict(zip(order, (21.3, 29.9, 34.7), strict=True))
    feet = dict(zip(order, (34.75, 30.87, 33.0), strict=True))
    found, usual = (
        _feet(rim, SimpleNamespace(feet={"LIPV": one}, mean_feet={"LIPV": mean}), TEMPLATE, "LIPV")
        for one in (feet, mean)
    )
    assert found == pytest.approx(usual)
    # In order, once round.
    steps = [(found[b] - found[a]) % len(loop) for a, b in pairwise([*order, order[0]])]
    assert sum(steps) == pytest.approx(len(loop))


def test_feet_at_one_place_are_not_once_round_apart():
    surface = meshes.annulus(1.0, 3.0, 5, 16)
    loop = surface.boundary_loops[0]
    rim = _Rim(surface, HalfEdges.of(surface), loop, True)
    for at in (0.0, 3.0, 7.4, len(loop) - 0.3):
        before, after = (at - 1e-12) % len(loop), (at + 1e-12) % len(loop)
        assert rim.ahead(before, after) == pytest.approx(0.0, abs=1e-9)
        assert rim.ahead(after, before) == 0.0
        assert rim.ahead(at, (at + 2.0) % len(loop)) + rim.ahead((at + 2.0) % len(loop), at) == pytest.approx(
            rim.length
        )


# ---- paths led between others ----


def straight(surface, mesh, start, stop):
    path = PathTree(surface.edge_graph, int(mesh.origin[start.half_edge])).to(int(mesh.origin[stop.half_edge]))
    strip = mesh.along(path.tolist(), start.half_edge // 3, stop.half_edge // 3)
    return straighten(mesh, start, stop, strip, 0.25)


def rim_at(surface, mesh, x, y):
    """The place on a rim nearest to a position."""
    best = None
    for h in np.flatnonzero(mesh.twin < 0).tolist():
        a, b = surface.points[mesh.ends([h])[0], :2]
        t = float(np.clip((np.array([x, y]) - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0 - 1e-9))
        off = np.linalg.norm(a + t * (b - a) - [x, y])
        if best is None or off < best[0]:
            best = off, Place(h, t if t > 1e-6 else 0.0)
    assert best[0] < 1e-6
    return best[1]


def assert_led(before, after, name):
    """The path is made of edges, keeps off rims and other paths, and the surface is as whole as before."""
    surface = after.surface
    edges = {tuple(edge) for edge in surface.edges.points.tolist()}
    for ids in after.lines.values():
        assert all((min(pair), max(pair)) in edges for pair in pairwise(ids.tolist()))
    inner = set(after.lines[name][1:-1].tolist())
    assert len(inner) == len(after.lines[name]) - 2
    taken = np.concatenate([*surface.boundary_loops, *(after.lines[other] for other in before.lines)])
    assert not inner & set(taken.tolist())
    assert surface.is_manifold
    assert surface.is_oriented
    assert surface.genus == before.surface.genus
    assert len(surface.boundary_loops) == len(before.surface.boundary_loops)
    assert surface.triangle_areas.min() > 0.0
    assert surface.area == pytest.approx(before.surface.area)
    for other, ids in before.lines.items():
        was, now = before.surface.points[ids], surface.points[after.lines[other]]
        assert np.allclose(now[[0, -1]], was[[0, -1]])


def with_lines(surface, mesh, ends):
    """A surface with straight lines, and single places for paths yet to come."""
    lines = {}
    for name, places in ends.items():
        at = [rim_at(surface, mesh, *place) for place in places]
        line = straight(surface, mesh, *at)
        if name.startswith("wall"):
            lines[name] = line
        else:
            lines |= {f"{name} {end}": line.place(end) for end in (0, -1)}
    return insert_lines(Inserted.of(surface), lines)


def only_walls(inserted):
    lines = {name: ids for name, ids in inserted.lines.items() if name.startswith("wall")}
    return Inserted(inserted.surface, inserted.parent, lines)


def led(inserted, name="path"):
    start, stop = (int(inserted.lines[f"{name} {end}"][0]) for end in (0, -1))
    return only_walls(inserted), _lead_between(only_walls(inserted), name, start, stop)


HOLE = regular(10.0, 11.0, 2.0)


@pytest.mark.parametrize("n", [11, 21, 31])
def test_a_path_goes_round_the_wall_and_the_hole_at_its_end(n):
    """A wall from below to the hole; the way from left to right leads over the hole."""
    surface = meshes.pierced(20.0, n, [HOLE], 1)
    mesh = HalfEdges.of(surface)
    inserted = with_lines(surface, mesh, {"wall": [(10.1, 0.0), (10.0, 9.0)], "path": [(0.0, 8.1), (20.0, 8.3)]})
    before, after = led(inserted)
    assert_led(before, after, "path")
    at = after.surface.points[after.lines["path"], :2]
    assert at[0] == pytest.approx([0.0, 8.1])
    assert at[-1] == pytest.approx([20.0, 8.3])
    length = np.linalg.norm(np.diff(at, axis=0), axis=1).sum()
    shortest = max(taut(HOLE, at[0], at[-1]))
    assert at[np.abs(at[:, 0] - 10.0).argmin(), 1] > 13.0
    # It keeps a quarter of an edge off the hole.
    step = 20.0 / (n - 1)
    assert shortest < length < shortest + 2.0 * step


def test_a_path_that_cannot_pass_is_not_led():
    surface = meshes.pierced(20.0, 15, [HOLE], 1)
    mesh = HalfEdges.of(surface)
    walls = {"wall": [(10.1, 0.0), (10.0, 9.0)], "wall 2": [(10.0, 13.0), (9.7, 20.0)]}
    _, after = led(with_lines(surface, mesh, {**walls, "path": [(0.0, 8.1), (20.0, 8.3)]}))
    assert after is None
    before, after = led(with_lines(surface, mesh, {**walls, "path": [(0.0, 8.1), (8.3, 0.0)]}))
    assert_led(before, after, "path")


@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_channels_one_triangle_wide(jitter):
    """Between two lines through the same triangles; and between rows of edges, where no point is free."""
    surface = meshes.jittered(9, 5, 2, jitter) if jitter else meshes.grid(9, 5, 8.0, 4.0)
    mesh = HalfEdges.of(surface)
    ends = {"wall a": [(0.0, 1.4), (8.0, 1.45)], "wall b": [(0.0, 1.6), (8.0, 1.65)], "path": [(0.0, 1.5), (8.0, 1.55)]}
    before, after = led(with_lines(surface, mesh, ends))
    assert_led(before, after, "path")
    x, y = after.surface.points[after.lines["path"], :2].T
    assert ((y > 1.4 + x * 0.05 / 8.0) & (y < 1.6 + x * 0.05 / 8.0)).all()
    length = np.hypot(np.diff(x), np.diff(y)).sum()
    assert length == pytest.approx(np.hypot(8.0, 0.05), rel=1e-3)
    if jitter:
        return
    rows = {
        f"wall {k}": Line(np.repeat(np.arange(9 * k, 9 * k + 9), 2).reshape(-1, 2), np.zeros(9), (), np.zeros(0))
        for k in (1, 2)
    }
    feet = {
        f"path {end}": straight(surface, mesh, *(rim_at(surface, mesh, *at) for at in ends["path"])).place(end)
        for end in (0, -1)
    }
    before, after = led(insert_lines(Inserted.of(surface), {**rows, **feet}))
    assert_led(before, after, "path")
    y = after.surface.points[after.lines["path"], 1]
    assert ((y > 1.0) & (y < 2.0)).all()


def test_paths_side_by_side_in_one_channel():
    """One after the other, five paths find room beside each other."""
    surface = meshes.jittered(9, 5, 3)
    mesh = HalfEdges.of(surface)
    heights = np.linspace(1.2, 1.8, 5)
    ends = {f"{k}": [(0.0, y), (8.0, y)] for k, y in enumerate(heights)}
    inserted = insert_lines(
        Inserted.of(surface),
        {
            f"{name} {end}": straight(surface, mesh, *(rim_at(surface, mesh, *at) for at in places)).place(end)
            for name, places in ends.items()
            for end in (0, -1)
        },
    )
    for name in ("2", "0", "4", "1", "3"):
        start, stop = (int(inserted.lines[f"{name} {end}"][0]) for end in (0, -1))
        paths = {other: ids for other, ids in inserted.lines.items() if other in ends}
        after = _lead_between(inserted, name, start, stop)
        assert after is not None, name
        assert_led(Inserted(inserted.surface, inserted.parent, paths), after, name)
        inserted = after
    at = [inserted.surface.points[inserted.lines[name]] for name in ends]
    for below, above in pairwise(at):
        x = np.linspace(0.0, 8.0, 50)
        assert (np.interp(x, below[:, 0], below[:, 1]) < np.interp(x, above[:, 0], above[:, 1])).all()


@pytest.mark.parametrize("seed", range(3))
def test_lines_are_sorted_out(seed):
    """The first stays, and after it each that meets none of those kept."""
    rng = np.random.default_rng(seed)
    surface = meshes.jittered(10, 9, seed)
    mesh = HalfEdges.of(surface)
    lines, segments = {}, {}
    for k in range(12):
        left, right = rng.uniform(0.2, 7.8, 2)
        lines[str(k)] = straight(surface, mesh, rim_at(surface, mesh, 0.0, left), rim_at(surface, mesh, 9.0, right))
        segments[str(k)] = left, right
    kept, waiting = _sort_out(surface, lines)
    assert [*kept, *waiting] != list(lines) or not waiting
    assert sorted([*kept, *waiting]) == sorted(lines)
    expected = []
    for name, (left, right) in segments.items():
        if all((left - segments[other][0]) * (right - segments[other][1]) > 0 for other in expected):
            expected.append(name)
    assert list(kept) == expected
    for name, line in kept.items():
        assert np.array_equal(line.ends[[0, -1]], lines[name].ends[[0, -1]])


# ---- the division of the phantom ----


def connected_and_divided(cavity, seeds, check=True):
    ways = WaysAcrossOstia(cavity)
    snapped = snap_seeds(seeds, cavity, LEFT_ATRIUM)
    join = connect_seeds if check else _connect
    connected = join(cavity, snapped, LEFT_ATRIUM, ways)
    return connected, divide(cavity.surface, ways.mesh, connected, TEMPLATE)


def cavity_of(surface, seeds):
    return make_cavity(surface, LEFT_ATRIUM, np.array([seeds[s] for s in LEFT_ATRIUM.outer_seeds]))


@pytest.fixture(scope="module")
def small():
    """800 points, ostia of 10 to 15 points."""
    return make_phantom(800)


@pytest.fixture(scope="module")
def small_cavity(small):
    return cavity_of(small.surface, small.seeds)


def assert_division(division, before):
    surface = division.surface
    assert np.array_equal(surface.points[: len(before.points)], before.points)
    assert surface.is_manifold
    assert surface.is_oriented
    assert surface.genus == 0
    assert len(surface.boundary_loops) == len(LEFT_ATRIUM.openings)
    assert surface.triangle_areas.min() > 0.0
    parts = np.bincount(division.parent, surface.triangle_areas, minlength=len(before.triangles))
    assert np.allclose(parts, before.triangle_areas, rtol=1e-9)
    edges = {tuple(edge) for edge in surface.edges.points.tolist()}
    rims = set(np.concatenate(list(division.loops.values())).tolist())
    seen = set()
    for ids in division.paths.values():
        assert all((min(pair), max(pair)) in edges for pair in pairwise(ids.tolist()))
        inner = set(ids[1:-1].tolist())
        assert len(inner) == len(ids) - 2
        assert not inner & (rims | seen)
        seen |= inner
    for opening in LEFT_ATRIUM.openings:
        assert division.feet[opening][0] == 0
        assert (np.diff(division.feet[opening]) > 0).all()


def lengths_along(points, loop):
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points[np.append(loop, loop[0])], axis=0), axis=1))])


@pytest.mark.parametrize("which", ["small", "phantom"])
def test_feet_go_half_way_in_mm(request, which):
    """Each arc between feet gets the mean of its own length and its share of the template's circle."""
    phantom = request.getfixturevalue(which)
    cavity = cavity_of(phantom.surface, phantom.seeds)
    connected, division = connected_and_divided(cavity, phantom.seeds)
    assert_division(division, cavity.surface)
    points = cavity.surface.points
    moved = 0
    for hole in LEFT_ATRIUM.holes:
        order = LEFT_ATRIUM.rims[hole]
        loop = connected.loops[hole]
        at = lengths_along(points, loop)
        total = at[-1]
        # Where the walks cross the rim, and ways that are about as short in the mean.
        start = []
        for name in order:
            seeds = LEFT_ATRIUM.paths[name]
            walk = connected.walks[name]
            exits = [walk.feet[seeds.index(hole)], walk.mean_feet[seeds.index(hole)]]
            crossing, place = ((1.0 - share) * points[one] + share * points[two] for one, two, share in exits)
            assert np.linalg.norm(walk.positions - crossing, axis=1).min() < 1e-9
            assert np.linalg.norm(place - crossing) < 0.05 * total
            steps = points[np.roll(loop, -1)] - points[loop]
            beyond = np.linalg.norm(points[loop] + steps - place, axis=1) + np.linalg.norm(points[loop] - place, axis=1)
            k = int((beyond - np.linalg.norm(steps, axis=1)).argmin())
            start.append(at[k] + np.linalg.norm(place - points[loop[k]]))
        mm = np.array(start)
        if TEMPLATE.rim(hole).spread_feet:
            angles = np.array([TEMPLATE.rim(hole).feet[name] for name in order])
            shares = (np.roll(angles, -1) - angles) % 360.0 / 360.0
            assert shares.sum() == pytest.approx(1.0)
            arcs = (np.roll(mm, -1) - mm) % total
            assert arcs.sum() == pytest.approx(total)
            mm = mm[0] + np.concatenate([[0.0], np.cumsum((arcs + shares * total) / 2.0)[:-1]])
            moved += np.abs(mm - start).max() > 1.0
        for name, foot, index in zip(order, mm % total, division.feet[hole], strict=True):
            found = division.surface.points[division.loops[hole][index]]
            assert division.loops[hole][index] == division.paths[name][-LEFT_ATRIUM.paths[name].index(hole)]
            k = int(np.searchsorted(at, foot, side="right")) - 1
            share = (foot - at[k]) / (at[k + 1] - at[k])
            # At a point of the rim if that is nearer than half of `NEAR_POINT` edges.
            share = round(share) if min(share, 1.0 - share) < NEAR_POINT / 2.0 else share
            a, b = points[loop[[k, (k + 1) % len(loop)]]]
            assert np.allclose(found, a + share * (b - a), atol=1e-9), (hole, name)
    assert moved > 0
    # Seeds of the valve stay where they are.
    snapped = snap_seeds(phantom.seeds, cavity, LEFT_ATRIUM)
    for name, index in zip(LEFT_ATRIUM.outer_paths, division.feet["MV"], strict=True):
        seed = LEFT_ATRIUM.paths[name][1]
        found = division.surface.points[division.loops["MV"][index]]
        k = int(snapped.outer_at[seed])
        a, b = points[cavity.outer[[k, (k + 1) % len(cavity.outer)]]]
        share = snapped.outer_at[seed] - k
        share = round(share) if min(share, 1.0 - share) < NEAR_POINT / 2.0 else share
        assert np.allclose(found, a + share * (b - a), atol=1e-9)


def along_valve(cavity, at):
    a, b = cavity.surface.points[cavity.outer[[int(at) % len(cavity.outer), (int(at) + 1) % len(cavity.outer)]]]
    return a + (at - int(at)) * (b - a)


@pytest.mark.parametrize("gap", [1.0, 0.5, 0.12])
def test_paths_that_crowd_together_give_way(small, small_cavity, gap):
    """Two seeds of the valve less than an edge apart: both paths end there, and do not touch."""
    at = np.floor(snap_seeds(small.seeds, small_cavity, LEFT_ATRIUM).outer_at["MV1"])
    seeds = {
        **small.seeds,
        "MV1": along_valve(small_cavity, at + 0.45 + gap / 2.0),
        "MV2": along_valve(small_cavity, at + 0.45 - gap / 2.0),
    }
    connected, division = connected_and_divided(small_cavity, seeds)
    assert_division(division, small_cavity.surface)
    for seed, name in (("MV1", "s5"), ("MV2", "s6")):
        foot = division.surface.points[division.paths[name][-1]]
        edge = small_cavity.surface.edge_lengths.max()
        assert np.linalg.norm(foot - seeds[seed]) < edge * NEAR_POINT / 2.0
    for name, ids in division.paths.items():
        led = np.linalg.norm(np.diff(division.surface.points[ids], axis=0), axis=1).sum()
        assert led < 1.5 * connected.walks[name].length + 5.0


@pytest.mark.parametrize(
    ("one", "other", "towards", "gap"),
    [
        ("MV1", "MV2", 0.4378347, 0.0540815),
        ("MV3", "MV4", -0.2995007, 0.0806476),
        ("MV2", "MV3", -0.0894105, 0.0605173),
    ],
)
def test_of_two_paths_in_each_others_way_one_is_led_round(small, small_cavity, monkeypatch, one, other, towards, gap):
    """Two seeds of the valve a few hundredths of an edge apart: the lines to them meet."""
    led_round = []

    def spy(inserted, name, start, stop):
        after = _lead_between(inserted, name, start, stop)
        led_round.append((name, after is not None))
        return after

    monkeypatch.setattr(line_division, "_lead_between", spy)
    outer_at, n = snap_seeds(small.seeds, small_cavity, LEFT_ATRIUM).outer_at, len(small_cavity.outer)
    way = (outer_at[other] - outer_at[one] + n / 2) % n - n / 2
    at = outer_at[one] + towards * way
    places = {one: along_valve(small_cavity, at % n), other: along_valve(small_cavity, (at + np.sign(way) * gap) % n)}
    connected, division = connected_and_divided(small_cavity, {**small.seeds, **places})
    assert [found for _, found in led_round] == [True], "the test needs lines that meet"
    assert_division(division, small_cavity.surface)
    name = led_round[0][0]
    length = np.linalg.norm(np.diff(division.surface.points[division.paths[name]], axis=0), axis=1).sum()
    assert length < 1.5 * connected.walks[name].length + 5.0


@pytest.mark.parametrize(("one", "other"), [(0.04, -0.04), (0.04, 0.02), (0.0, -0.04)])
def test_two_seeds_of_the_valve_near_one_point_of_its_rim(small, small_cavity, one, other):
    at = np.floor(snap_seeds(small.seeds, small_cavity, LEFT_ATRIUM).outer_at["MV1"])
    places = {"MV1": along_valve(small_cavity, at + one), "MV2": along_valve(small_cavity, at + other)}
    assert np.linalg.norm(places["MV1"] - places["MV2"]) > 0.05
    _, division = connected_and_divided(small_cavity, {**small.seeds, **places})
    assert_division(division, small_cavity.surface)


@pytest.mark.parametrize("pair", [("MV1", "MV2"), ("MV3", "MV4"), ("MV1", "MV3")])
def test_a_path_that_is_cut_off_is_refused(small, small_cavity, pair):
    """Two seeds of the valve exchanged, and not checked for it: one path must cross the other."""
    a, b = pair
    swapped = {**small.seeds, a: small.seeds[b], b: small.seeds[a]}
    with pytest.raises(SeedError, match=r"is cut off by a rim or by other paths \(.*s\d") as caught:
        connected_and_divided(small_cavity, swapped, check=False)
    assert any(label in LEFT_ATRIUM.outer_seeds for label in caught.value.labels)
    name = str(caught.value).split()[1]
    assert set(LEFT_ATRIUM.paths[name]) == set(caught.value.labels)


def covered(phantom, rings):
    """The phantom with cones over its ostia, in rings of triangles; all with the same shape."""
    surface = phantom.surface
    outer = max(surface.boundary_loops, key=surface.loop_length)
    points, triangles, marks = [surface.points], [surface.triangles], [np.zeros(len(surface.points))]
    count = len(surface.points)
    for loop in surface.boundary_loops:
        if loop is outer:
            continue
        rim, k = surface.points[loop], len(loop)
        centre = rim.mean(axis=0)
        before = loop
        for ring in range(1, rings):
            now = count + np.arange(k)
            points.append(rim + ring / rings * (centre - rim))
            after, then = np.roll(before, -1), np.roll(now, -1)
            triangles += [np.stack([after, before, now], axis=1), np.stack([after, now, then], axis=1)]
            before, count = now, count + k
            marks.append(np.ones(k))
        points.append(centre[None])
        marks.append(np.ones(1))
        triangles.append(np.stack([np.roll(before, -1), before, np.full(k, count)], axis=1))
        count += 1
    return Surface(
        np.concatenate(points), np.concatenate(triangles), point_data={"hole": np.concatenate(marks).astype(int)}
    )


def test_the_triangles_of_covers_do_not_matter(small):
    """Seeds off the centre of their covers, on the same cones cut into other triangles."""
    seeds = dict(small.seeds)
    outer = max(small.surface.boundary_loops, key=small.surface.loop_length)
    for loop in small.surface.boundary_loops:
        if loop is outer:
            continue
        rim = small.surface.points[loop]
        label = min(LEFT_ATRIUM.holes, key=lambda label: np.linalg.norm(small.seeds[label] - rim.mean(axis=0)))
        seeds[label] = 0.6 * rim.mean(axis=0) + 0.15 * rim[0] + 0.25 * rim[1]
    made = []
    for rings in (1, 2, 5):
        surface = covered(small, rings)
        assert surface.is_manifold
        assert surface.is_oriented
        cavity = cavity_of(surface, seeds)
        assert len(cavity.surface.points) == len(small.surface.points)
        made.append(connected_and_divided(cavity, seeds)[1])
    for other in made[1:]:
        assert np.allclose(other.surface.points, made[0].surface.points, atol=1e-9)
        assert all(np.array_equal(other.paths[name], made[0].paths[name]) for name in LEFT_ATRIUM.paths)
        assert all(np.array_equal(other.feet[o], made[0].feet[o]) for o in LEFT_ATRIUM.openings)


def random_seeds(cavity, snapped, rng):
    """Seeds anywhere on the cones over the ostia, and along the valve."""
    points, seeds = cavity.surface.points, {}
    for label in LEFT_ATRIUM.holes:
        rim = points[cavity.rims[snapped.hole[label]]]
        k, out, share = rng.integers(len(rim)), 0.95 * np.sqrt(rng.random()), rng.random()
        at = (1.0 - share) * rim[k] + share * rim[(k + 1) % len(rim)]
        seeds[label] = rim.mean(axis=0) + out * (at - rim.mean(axis=0))
    n = len(cavity.outer)
    for label in LEFT_ATRIUM.outer_seeds:
        seeds[label] = along_valve(cavity, (snapped.outer_at[label] + rng.uniform(-0.04, 0.04) * n) % n)
    return seeds


@pytest.mark.parametrize("count", [500, 1000, 1500])
def test_random_seeds_on_coarse_phantoms_give_no_folds(count):
    phantom = make_phantom(count)
    cavity = cavity_of(phantom.surface, phantom.seeds)
    if count == 500:
        assert min(map(len, cavity.rims)) < 12
    snapped = snap_seeds(phantom.seeds, cavity, LEFT_ATRIUM)
    flattener = Flattener(phantom.surface, check_axes=False)
    rng = np.random.default_rng(count)
    done = 0
    for _ in range(4):
        try:
            flat_map = flattener.flatten(random_seeds(cavity, snapped, rng))
        except SeedError:
            continue
        done += 1
        assert len(flat_map.folded_triangles) == 0
        # All pieces of triangles as well.
        a, b, c = flat_map.solution[flat_map.division.surface.triangles].swapaxes(0, 1)
        assert ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]).min() > 0.0
        assert np.array_equal(flat_map.division.surface.points[: len(flat_map.points)], flat_map.surface.points)
        assert_division(flat_map.division, flat_map.surface)
    assert done >= 2


@pytest.mark.parametrize("part", [0.9, 0.97])
def test_feet_that_fall_together_on_the_appendage_part_on_the_right_side(small, small_cavity, part):
    """The seed near the rim: both paths leave it at one place, and neither must be led round the opening."""
    hole = snap_seeds(small.seeds, small_cavity, LEFT_ATRIUM).hole["LAA"]
    rim = small_cavity.surface.points[small_cavity.rims[hole]]
    for at in rim[::3]:
        seeds = {**small.seeds, "LAA": part * at + (1.0 - part) * small.seeds["LAA"]}
        connected, division = connected_and_divided(small_cavity, seeds)
        assert_division(division, small_cavity.surface)
        for name in ("s8", "s9"):
            led = np.linalg.norm(np.diff(division.surface.points[division.paths[name]], axis=0), axis=1).sum()
            assert led < 1.1 * connected.walks[name].length + 2.0, name
