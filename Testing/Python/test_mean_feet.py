"""Where paths leave rims: means whose place is known, and that they move without a jump."""

from itertools import pairwise

import meshes
import numpy as np
import pytest
from cases import seeds_by_rule

from LAFlatteningLib import read_surface
from LAFlatteningLib.anatomy import LEFT_ATRIUM
from LAFlatteningLib.cavity.openings import Cavity, make_cavity
from LAFlatteningLib.mean_feet import NEGLIGIBLE, mean_foot
from LAFlatteningLib.ostium_ways import WaysAcrossOstia
from LAFlatteningLib.phantom import make_phantom
from LAFlatteningLib.rim_length import rim_lengths
from LAFlatteningLib.seed_paths import connect_seeds
from LAFlatteningLib.seeds import SnappedSeeds, snap_seeds
from LAFlatteningLib.surface import Surface


def apart(a, b, total):
    """The shorter way from one place on a rim to another, with its sign, mm."""
    return (b - a + total / 2.0) % total - total / 2.0


@pytest.mark.parametrize("centre", [0.0, 3.2, 20.0, 39.99])
def test_ways_that_grow_evenly_to_both_sides(centre):
    """A von Mises distribution has its mean in its middle; also across the place where the rim begins."""
    at = np.append(np.sort(np.random.default_rng(0).uniform(0.0, 40.0, 400)), 0.0)
    at = np.append(at[:-1] - at[0], 40.0)
    lengths = 50.0 - 6.0 * np.cos(2.0 * np.pi * (at[:-1] - centre) / 40.0)
    assert abs(apart(mean_foot(at, lengths, 1.0), centre, 40.0)) < 0.02


@pytest.mark.parametrize("longer", [-0.3, 0.0, 0.5, 2.0])
def test_two_feet_count_by_the_lengths_of_their_ways(longer):
    at = np.arange(41.0)
    lengths = np.full(40, np.inf)
    lengths[[4, 8]] = 50.0, 50.0 + longer
    # Each less what a way has that counts nothing.
    first, second = np.exp(-max(-longer, 0.0) / 0.8), np.exp(-max(longer, 0.0) / 0.8)
    weight = (second - np.exp(-NEGLIGIBLE)) / (first - np.exp(-NEGLIGIBLE))
    both = np.exp(2j * np.pi * 4.0 / 40.0) + weight * np.exp(2j * np.pi * 8.0 / 40.0)
    assert mean_foot(at, lengths, 0.8) == pytest.approx(np.angle(both) / (2.0 * np.pi) * 40.0)
    if longer == 0.0:
        assert mean_foot(at, lengths, 0.8) == pytest.approx(6.0)


def test_a_foot_counts_by_half_of_both_sides_beside_it():
    at = np.array([0.0, 1.0, 4.0, 10.0, 12.0, 20.0, 30.0])
    lengths = np.full(6, np.inf)
    lengths[[1, 3]] = 50.0
    both = (0.5 + 1.5) * np.exp(2j * np.pi / 30.0) + (3.0 + 1.0) * np.exp(2j * np.pi * 10.0 / 30.0)
    assert mean_foot(at, lengths, 1.0) == pytest.approx(np.angle(both) / (2.0 * np.pi) * 30.0)


def test_much_longer_ways_need_not_be_known():
    """What is looked at depends on what was asked for before; the foot must not."""
    at = np.arange(41.0)
    lengths = 50.0 + np.abs(np.arange(40) - 11.0) + 0.3 * np.sin(np.arange(40))
    known = np.where(lengths > lengths.min() + NEGLIGIBLE * 0.8, np.inf, lengths)
    assert np.isinf(known).sum() > 10
    assert mean_foot(at, known, 0.8) == mean_foot(at, lengths, 0.8)


def hilly(n=61, height=9.0):
    """A plane with a hill in its middle between two ostia, mirror-symmetric but for its triangles."""
    turn = 2.0 * np.pi * np.arange(24) / 24
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    holes = [[10.0, 30.0] + 5.0 * circle, [50.0, 30.0] + 5.0 * circle]
    flat = meshes.pierced(60.0, n, holes, 3)
    off = flat.points[:, :2] - 30.0
    hill = height * np.exp(-(off**2).sum(axis=1) / (2.0 * 5.0**2))
    surface = Surface(flat.points + np.outer(hill, [0.0, 0.0, 1.0]), flat.triangles)
    loops = surface.boundary_loops
    rims = tuple(sorted(loops[1:], key=lambda loop: surface.points[loop, 0].mean()))
    return Cavity(surface, np.full(len(surface.triangles), -1), surface, np.arange(len(flat.points)), rims, loops[0])


def across(cavity, height):
    """Seeds to the left and the right of the hill."""
    positions = {"A": np.array([10.0, height, 0.0]), "B": np.array([50.0, 30.0, 0.0])}
    return SnappedSeeds({}, {"A": 0, "B": 1}, {}, positions, {})


def test_the_foot_passes_the_middle_where_the_shortest_way_jumps():
    """As a seed crosses the plane of symmetry, the shortest way jumps from one side of the hill to the other."""
    cavity = hilly()
    ways, points = WaysAcrossOstia(cavity), cavity.surface.points
    heights = np.linspace(29.0, 31.0, 41)
    walks = [ways.walk(across(cavity, height), "A", "B") for height in heights]
    sides = np.array([walk.positions[np.abs(walk.positions[:, 0] - 30.0).argmin(), 1] - 30.0 for walk in walks])
    assert np.abs(sides).min() > 3.0, "the test needs ways round the hill"
    assert sides[0] < 0.0 < sides[-1]
    for end in (0, 1):
        line, mean = (
            np.array([(1.0 - t) * points[a, 1] + t * points[b, 1] for a, b, t in (feet[end] for feet in exits)])
            for exits in ([walk.feet for walk in walks], [walk.mean_feet for walk in walks])
        )
        assert np.abs(np.diff(line)).max() > 1.0
        # A seed moves by .05 mm a step.
        assert np.abs(np.diff(mean)).max() < 0.2
        assert abs(mean[20] - 30.0) < 0.3
        assert np.abs(mean - line).max() < 2.5


def test_a_seed_that_turns_back_finds_the_same_foot():
    cavity = hilly()
    ways = WaysAcrossOstia(cavity)
    there = ways.walk(across(cavity, 30.4), "A", "B").mean_feet
    ways.walk(across(cavity, 29.0), "A", "B")
    assert ways.walk(across(cavity, 30.4), "A", "B").mean_feet == there
    back = ways.walk(across(cavity, 30.4), "B", "A").mean_feet
    assert ways.walk(across(cavity, 30.4), "A", "B").reversed().mean_feet == there[::-1]
    places = [(1.0 - t) * cavity.surface.points[a] + t * cavity.surface.points[b] for a, b, t in [*there, *back[::-1]]]
    assert np.allclose(places[:2], places[2:], atol=1e-6)


def mean_places(surface, seeds):
    """A function from seeds to (opening, path) -> where it leaves the rim in the mean: mm along the rim, the length of
    the rim, and the place."""
    cavity = make_cavity(surface, LEFT_ATRIUM, np.array([seeds[s] for s in LEFT_ATRIUM.outer_seeds]))
    ways = WaysAcrossOstia(cavity)

    def places(moved):
        connected = connect_seeds(cavity, snap_seeds(moved, cavity, LEFT_ATRIUM), LEFT_ATRIUM, ways)
        found = {}
        for hole in LEFT_ATRIUM.holes:
            loop = connected.loops[hole]
            at = rim_lengths(surface.points[loop])
            for name, place in connected.mean_feet[hole].items():
                a, b = surface.points[loop[[int(place) % len(loop), (int(place) + 1) % len(loop)]]]
                found[hole, name] = float(np.interp(place, np.arange(len(at)), at)), at[-1], a + place % 1.0 * (b - a)
        return found

    return places


def test_all_ways_with_weight_are_in_the_mean(monkeypatch):
    """Also of paths to the outer rim, whose seeds look no farther than they must."""
    made, rng = make_phantom(3000), np.random.default_rng(3)
    # (Where seeds are in the middle, ways of any length lie alike on both sides.)
    seeds = {label: place + rng.normal(0.0, 3.0, 3) for label, place in made.seeds.items()}
    here = mean_places(made.surface, made.seeds)(seeds)
    monkeypatch.setattr("LAFlatteningLib.ostium_ways.FOOT_DETOUR", 10.0)
    everywhere = mean_places(made.surface, made.seeds)(seeds)
    assert any(LEFT_ATRIUM.paths[name][1] in LEFT_ATRIUM.outer_seeds for _, name in here)
    for key, (at, total, _) in here.items():
        assert abs(apart(at, everywhere[key][0], total)) < 1e-3, key


def test_feet_on_the_phantom_do_not_depend_on_its_mesh():
    coarse, fine = (make_phantom(points) for points in (3000, 12000))
    here, there = (mean_places(made.surface, made.seeds)(made.seeds) for made in (coarse, fine))
    off = [np.linalg.norm(here[key][2] - there[key][2]) for key in here]
    # Edges of the coarse one are 2 mm long.
    assert np.sqrt(np.mean(np.square(off))) < 0.25
    assert max(off) < 0.6


@pytest.mark.parametrize("label", ["RIPV", "LSPV", "LAA"])
def test_feet_on_the_phantom_move_without_jumps(label):
    made = make_phantom(3000)
    places = mean_places(made.surface, made.seeds)
    direction = made.seeds["MV1"] - made.seeds[label]
    assert_no_jumps(places, made.seeds, label, direction, largest=0.25)


@pytest.mark.parametrize("label", ["LSPV", "RSPV"])
def test_feet_on_a_ragged_rim_move_without_jumps(data_dir, label):
    """Rims that are saws, on which the shortest way leaps from tooth to tooth, by 2 to 3 mm."""
    surface = read_surface(data_dir / "labelled" / "ct_shape_model_1.vtp")
    seeds = seeds_by_rule(surface)
    assert_no_jumps(mean_places(surface, seeds), seeds, label, seeds["MV1"] - seeds[label], largest=0.8)


def assert_no_jumps(places, seeds, label, direction, largest):
    direction = direction / np.linalg.norm(direction)
    moved = [places({**seeds, label: seeds[label] + 0.1 * step * direction}) for step in range(25)]
    for before, after in pairwise(moved):
        for key, (at, total, _) in before.items():
            assert abs(apart(at, after[key][0], total)) < largest, key
