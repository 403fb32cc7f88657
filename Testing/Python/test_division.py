"""Seeds, paths, feet and regions, on the phantom whose answers are known."""

from itertools import permutations

import numpy as np
import pytest

from LAFlatteningLib.anatomy import LEFT_ATRIUM
from LAFlatteningLib.cavity.openings import SNAP_LIMIT_MM, make_cavity
from LAFlatteningLib.constraints import constraints_by_count, constraints_by_length
from LAFlatteningLib.division import divide_as_published, label_regions
from LAFlatteningLib.errors import SeedError
from LAFlatteningLib.line_division import divide
from LAFlatteningLib.ostium_ways import WaysAcrossOstia
from LAFlatteningLib.seed_paths import WaysOverCovers, connect_seeds
from LAFlatteningLib.seeds import snap_seeds
from LAFlatteningLib.subcontours import spread_counts, spread_lengths
from LAFlatteningLib.surface import Surface
from LAFlatteningLib.template import Template

TEMPLATE = Template.load("adapted1")


@pytest.fixture(scope="module")
def cavity(phantom):
    return make_cavity(phantom.surface, LEFT_ATRIUM, np.array([phantom.seeds[s] for s in LEFT_ATRIUM.outer_seeds]))


@pytest.fixture(scope="module")
def division(cavity, phantom):
    return divided(cavity, phantom.seeds)


# ---- the sub-contour rule ----


def test_spread_counts_as_printed():
    # 60 points, arcs of 10, 20, 30; shares a third each: floor((20 - 10)/2) = 5, floor((20 - 20)/2) = 0.
    assert spread_counts([10, 20, 30], np.full(3, 1 / 3), "paper") == [15, 20, 25]
    # A negative odd difference rounds down, away from zero: floor(-5/2) = -3.
    assert spread_counts([25, 20, 15], np.full(3, 1 / 3), "paper") == [22, 20, 18]


def test_spread_counts_as_published_results_were_made():
    # First offset round(5/2): 2 to even, 3 away from zero; the second counts from the displaced first foot.
    assert spread_counts([15, 20, 25], np.full(3, 1 / 3), "half-even") == [17, 19, 24]
    assert spread_counts([15, 20, 25], np.full(3, 1 / 3), "half-away") == [18, 18, 24]


@pytest.mark.parametrize("rounding", ["paper", "half-even", "half-away"])
def test_spread_counts_keep_the_total_and_every_arc(rounding):
    rng = np.random.default_rng(0)
    for _ in range(300):
        arcs = rng.integers(1, 40, 3)
        shares = rng.dirichlet([2, 2, 2])
        result = spread_counts(arcs.tolist(), shares, rounding)
        assert sum(result) == arcs.sum()
        assert min(result) >= 1


def test_spread_counts_refuse_nonsense():
    with pytest.raises(ValueError, match="rounding"):
        spread_counts([1, 2, 3], np.full(3, 1 / 3), "up")
    with pytest.raises(ValueError, match="three arcs"):
        spread_counts([1, 2], np.full(2, 1 / 2), "paper")


def test_spread_lengths_are_half_way():
    shares = np.array([0.25, 0.25, 0.5])
    arcs = np.array([10.0, 30.0, 20.0])
    assert spread_lengths(arcs, shares).tolist() == [12.5, 22.5, 25.0]
    assert spread_lengths(shares * 8, shares).tolist() == (shares * 8).tolist()


# ---- seeds ----


def test_seeds_snap_to_their_own_openings(cavity, phantom):
    snapped = snap_seeds(phantom.seeds, cavity, LEFT_ATRIUM)
    assert sorted(snapped.hole.values()) == [0, 1, 2, 3, 4]
    for label, at in phantom.seeds.items():
        place = cavity.closed.points[snapped.ids[label]]
        moved = np.linalg.norm(snapped.positions[label] - at)
        # Outer seeds go to the nearest place of the rim, the others to the nearest point of their cover.
        expected = moved if label in LEFT_ATRIUM.outer_seeds else np.linalg.norm(place - at)
        assert snapped.moved_mm[label] == pytest.approx(expected)
        assert moved <= np.linalg.norm(place - at) + 1e-9
        # An edge is about 2 mm long at this resolution.
        assert snapped.moved_mm[label] < 3.0
    outer = set(cavity.ids[cavity.outer].tolist())
    for label in LEFT_ATRIUM.outer_seeds:
        assert snapped.ids[label] in outer
    for label in LEFT_ATRIUM.holes:
        assert snapped.ids[label] in cavity.cover_points[snapped.hole[label]]


def changed(phantom, **moves):
    return {**phantom.seeds, **moves}


def test_missing_seed_is_named(cavity, phantom):
    seeds = {label: at for label, at in phantom.seeds.items() if label != "LAA"}
    with pytest.raises(SeedError, match=r"Seed missing: LAA\. Expected 9 seeds") as caught:
        snap_seeds(seeds, cavity, LEFT_ATRIUM)
    assert caught.value.labels == ("LAA",)


def test_missing_seed_message_shows_what_was_found_instead(cavity, phantom):
    seeds = dict(phantom.seeds)
    seeds["laa"] = seeds.pop("LAA")
    with pytest.raises(SeedError, match="found instead 'laa'"):
        snap_seeds(seeds, cavity, LEFT_ATRIUM)


def test_seed_off_the_surface(cavity, phantom):
    away = phantom.seeds["RSPV"] + 3 * (phantom.seeds["RSPV"] - cavity.surface.points.mean(axis=0))
    with pytest.raises(SeedError, match=rf"at most {SNAP_LIMIT_MM:g} mm.*RSPV is \d+ mm from the nearest opening"):
        snap_seeds(changed(phantom, RSPV=away), cavity, LEFT_ATRIUM)


def test_vein_seed_at_the_valve(cavity, phantom):
    with pytest.raises(SeedError, match=r"RIPV .* lies at the MV rim instead"):
        snap_seeds(changed(phantom, RIPV=phantom.seeds["MV2"]), cavity, LEFT_ATRIUM)


def test_two_seeds_on_one_opening(cavity, phantom):
    with pytest.raises(SeedError, match=r"RSPV and RIPV sit on the same opening.*has none") as caught:
        snap_seeds(changed(phantom, RIPV=phantom.seeds["RSPV"]), cavity, LEFT_ATRIUM)
    assert set(caught.value.labels) == {"RSPV", "RIPV"}


def test_two_mitral_seeds_on_one_point(cavity, phantom):
    with pytest.raises(SeedError, match="MV1 and MV2 sit on the same place"):
        snap_seeds(changed(phantom, MV2=phantom.seeds["MV1"]), cavity, LEFT_ATRIUM)


def test_seed_without_a_position(cavity, phantom):
    with pytest.raises(SeedError, match="MV3 has no valid position"):
        snap_seeds(changed(phantom, MV3=np.array([1.0, np.nan, 2.0])), cavity, LEFT_ATRIUM)


def test_ras_seeds_on_an_lps_surface(cavity, phantom):
    seeds = {label: at * [-1, -1, 1] for label, at in phantom.seeds.items()}
    with pytest.raises(SeedError, match="seeds are in RAS and the surface is in LPS"):
        snap_seeds(seeds, cavity, LEFT_ATRIUM)


def test_seeds_in_metres(cavity, phantom):
    with pytest.raises(SeedError, match=r"in metres.*Multiply the seeds by 1000"):
        snap_seeds({label: at / 1000 for label, at in phantom.seeds.items()}, cavity, LEFT_ATRIUM)


def connect(cavity, seeds, ways=WaysAcrossOstia, check_axes=False):
    return connect_seeds(cavity, snap_seeds(seeds, cavity, LEFT_ATRIUM), LEFT_ATRIUM, ways(cavity), check_axes)


def divided(cavity, seeds, template=TEMPLATE):
    ways = WaysAcrossOstia(cavity)
    connected = connect_seeds(cavity, snap_seeds(seeds, cavity, LEFT_ATRIUM), LEFT_ATRIUM, ways)
    return divide(cavity.surface, ways.mesh, connected, template)


@pytest.mark.parametrize(
    ("a", "b"),
    [(a, b) for i, a in enumerate(LEFT_ATRIUM.holes) for b in LEFT_ATRIUM.holes[i + 1 :]]
    + [("MV1", "MV2"), ("MV2", "MV3"), ("MV3", "MV4"), ("MV1", "MV4"), ("MV1", "MV3"), ("MV2", "MV4")],
)
def test_every_swap_of_two_seeds_is_recognised_and_named(cavity, phantom, a, b):
    with pytest.raises(SeedError, match="look swapped") as caught:
        connect(cavity, changed(phantom, **{a: phantom.seeds[b], b: phantom.seeds[a]}))
    assert set(caught.value.labels) == {a, b}


def test_mirrored_anatomy_is_recognised(phantom):
    flip = np.array([-1.0, 1.0, 1.0])
    mirrored = Surface(phantom.surface.points * flip, phantom.surface.triangles)
    seeds = {label: at * flip for label, at in phantom.seeds.items()}
    cavity = make_cavity(mirrored, LEFT_ATRIUM, np.array([seeds[s] for s in LEFT_ATRIUM.outer_seeds]))
    with pytest.raises(SeedError, match="anatomy is mirrored"):
        connect(cavity, seeds)


LEFT_RIGHT = {"RSPV": "LSPV", "LSPV": "RSPV", "RIPV": "LIPV", "LIPV": "RIPV"}
WRONG_LABELS = {
    "left and right exchanged": LEFT_RIGHT,
    "left and right exchanged, valve too": {**LEFT_RIGHT, "MV1": "MV4", "MV4": "MV1", "MV2": "MV3", "MV3": "MV2"},
    "superior and inferior exchanged": {"RSPV": "RIPV", "RIPV": "RSPV", "LSPV": "LIPV", "LIPV": "LSPV"},
    "veins moved on": {"RSPV": "LSPV", "LSPV": "LIPV", "LIPV": "RIPV", "RIPV": "RSPV"},
    "veins moved back": {"RSPV": "RIPV", "RIPV": "LIPV", "LIPV": "LSPV", "LSPV": "RSPV"},
    "left side moved on": {"LAA": "LIPV", "LIPV": "LSPV", "LSPV": "LAA"},
    "turned by half": {"RSPV": "LIPV", "LIPV": "RSPV", "RIPV": "LSPV", "LSPV": "RIPV"},
}


@pytest.mark.parametrize("kind", WRONG_LABELS)
def test_labels_that_contradict_the_patient_axes_are_refused(cavity, phantom, kind):
    names = WRONG_LABELS[kind]
    seeds = {label: phantom.seeds[names.get(label, label)] for label in phantom.seeds}
    with pytest.raises(SeedError, match=r"By the axes of the surface \(LPS\)|anatomy is mirrored"):
        connect(cavity, seeds, check_axes=True)


@pytest.mark.parametrize("ways", [WaysAcrossOstia, WaysOverCovers])
def test_veins_moved_on_are_named_without_the_axes(cavity, phantom, ways):
    """All rims are in order, as far as paths tell; but the paths would be shorter with the labels moved back."""
    names = WRONG_LABELS["veins moved back"]
    seeds = {label: phantom.seeds[names.get(label, label)] for label in phantom.seeds}
    with pytest.raises(SeedError, match=r"look moved on, each to .*RSPV as RIPV") as caught:
        connect(cavity, seeds, ways)
    assert set(caught.value.labels) == {"RSPV", "RIPV", "LIPV", "LSPV"}


@pytest.mark.parametrize("three", list(permutations(("RSPV", "RIPV", "LIPV", "LSPV"), 3)))
def test_no_exchange_is_proposed_that_leaves_veins_moved_on(cavity, phantom, three):
    """Three labels moved on are no swap: exchanging two of them, or one and the fourth, does not put them right."""
    names = dict(zip(three, three[1:] + three[:1], strict=True))
    seeds = {label: phantom.seeds[names.get(label, label)] for label in phantom.seeds}
    with pytest.raises(SeedError) as caught:
        connect(cavity, seeds)
    assert "look swapped" not in str(caught.value)
    assert set(three) <= set(caught.value.labels)


@pytest.mark.parametrize("turn", [(-1, -1, 1), (1, -1, -1), (-1, 1, -1)])
def test_surface_in_other_axes_than_it_says_is_refused(phantom, turn):
    surface = Surface(phantom.surface.points * turn, phantom.surface.triangles)
    seeds = {label: at * turn for label, at in phantom.seeds.items()}
    cavity = make_cavity(surface, LEFT_ATRIUM, np.array([seeds[s] for s in LEFT_ATRIUM.outer_seeds]))
    connect(cavity, seeds, check_axes=False)
    with pytest.raises(SeedError, match="save it with its axes named"):
        connect(cavity, seeds, check_axes=True)


def test_axes_check_knows_ras(phantom):
    turn = np.array([-1, -1, 1])
    surface = Surface(phantom.surface.points * turn, phantom.surface.triangles, space="RAS")
    seeds = {label: at * turn for label, at in phantom.seeds.items()}
    cavity = make_cavity(surface, LEFT_ATRIUM, np.array([seeds[s] for s in LEFT_ATRIUM.outer_seeds]))
    connect(cavity, seeds, check_axes=True)


def test_mirrored_image_with_veins_named_by_side_is_refused(phantom):
    """What happens on an image flipped left to right: chirality and vein names agree, but not the appendage."""
    flip = np.array([-1.0, 1.0, 1.0])
    surface = Surface(phantom.surface.points * flip, phantom.surface.triangles)
    names = {**LEFT_RIGHT, "MV1": "MV4", "MV4": "MV1", "MV2": "MV3", "MV3": "MV2"}
    seeds = {label: phantom.seeds[names.get(label, label)] * flip for label in phantom.seeds}
    cavity = make_cavity(surface, LEFT_ATRIUM, np.array([seeds[s] for s in LEFT_ATRIUM.outer_seeds]))
    with pytest.raises(SeedError):
        connect(cavity, seeds, check_axes=True)


@pytest.mark.parametrize("shift", [1, 2, 3])
@pytest.mark.parametrize("ways", [WaysAcrossOstia, WaysOverCovers])
def test_mitral_seeds_moved_on_along_the_rim_are_named(cavity, phantom, shift, ways):
    order = ["MV1", "MV2", "MV3", "MV4"]
    moved = {label: phantom.seeds[order[(k + shift) % 4]] for k, label in enumerate(order)}
    with pytest.raises(SeedError, match="look moved on by"):
        connect(cavity, changed(phantom, **moved), ways, check_axes=True)


def test_mitral_seed_far_from_its_vein_makes_a_note(cavity, phantom):
    assert connect(cavity, phantom.seeds).notes == ()
    rim = cavity.surface.points[cavity.outer]
    halfway = rim[np.linalg.norm(rim - 0.5 * (phantom.seeds["MV2"] + phantom.seeds["MV3"]), axis=1).argmin()]
    for fraction in (0.5, 0.7, 0.9):
        target = (1 - fraction) * phantom.seeds["MV3"] + fraction * halfway
        at = rim[np.linalg.norm(rim - target, axis=1).argmin()]
        notes = connect(cavity, changed(phantom, MV3=at)).notes
        if notes:
            break
    assert any(note.startswith("MV3 is") and "LIPV" in note for note in notes)


def test_mitral_seeds_close_together_stay_where_they_are(phantom, cavity):
    """Only feet on holes are moved apart: a seed on the outer rim is the user's own."""
    at = int(np.linalg.norm(cavity.surface.points[cavity.outer] - phantom.seeds["MV1"], axis=1).argmin())
    # The outer rim runs counter-clockwise on the map, from MV2 to MV1.
    close = int(cavity.outer[at - 1])
    division = divided(cavity, changed(phantom, MV2=cavity.surface.points[close]))
    loop, feet = division.loops["MV"], division.feet["MV"]
    order = LEFT_ATRIUM.feet("MV")
    assert loop[feet[order.index("s6")]] == close
    foot = division.surface.points[loop[feet[order.index("s5")]]]
    edge = np.linalg.norm(cavity.surface.points[cavity.outer[at]] - cavity.surface.points[close])
    assert np.linalg.norm(foot - connected_position(cavity, phantom, "MV1")) < 0.05 * edge


def test_seed_a_little_beyond_the_limit(cavity, phantom):
    rim = cavity.surface.points[cavity.rims[snap_seeds(phantom.seeds, cavity, LEFT_ATRIUM).hole["RSPV"]]]
    across = np.cross(rim[0] - rim.mean(axis=0), rim[len(rim) // 4] - rim.mean(axis=0))
    across /= np.linalg.norm(across)
    near, far = (phantom.seeds["RSPV"] + side * across for side in (SNAP_LIMIT_MM - 1.5, SNAP_LIMIT_MM + 1.5))
    snap_seeds(changed(phantom, RSPV=near), cavity, LEFT_ATRIUM)
    with pytest.raises(SeedError, match="RSPV is"):
        snap_seeds(changed(phantom, RSPV=far), cavity, LEFT_ATRIUM)


def test_feet_are_kept_apart():
    from LAFlatteningLib.line_division import _apart

    assert _apart(np.array([0.0, 0, 0]), 40.0, 2.0).tolist() == [0, 2, 4]
    assert _apart(np.array([0.0, 39.5, 39.5]), 40.0, 2.0).tolist() == [0, 36, 38]
    assert _apart(np.array([0.0, 10, 25]), 40.0, 2.0).tolist() == [0, 10, 25]
    assert _apart(np.array([0.0, 0]), 30.0, 3.0).tolist() == [0, 3]


@pytest.mark.parametrize("label", ["LAA", "RSPV", "LIPV"])
def test_seed_near_the_rim_of_its_opening_is_taken(phantom, cavity, label):
    from LAFlatteningLib.flattening import flatten

    hole = snap_seeds(phantom.seeds, cavity, LEFT_ATRIUM).hole[label]
    for at in cavity.surface.points[cavity.rims[hole]][::5]:
        flat_map = flatten(phantom.surface, changed(phantom, **{label: 0.9 * at + 0.1 * phantom.seeds[label]}))
        assert len(flat_map.folded_triangles) == 0


@pytest.mark.parametrize("change", ["rotated", "moved", "shuffled", "scaled"])
def test_the_map_belongs_to_the_shape_alone(phantom, phantom_map, change):
    """Rigid motion and scale change nothing but rounding; nor does the order of points and triangles, but where two
    lines are equally short to a micrometre, as on this coarse mesh."""
    from scipy.spatial.transform import Rotation

    from LAFlatteningLib.flattening import flatten

    rotation = Rotation.from_euler("xyz", [5, -10, 8], degrees=True).as_matrix() if change == "rotated" else np.eye(3)
    scale = 1.3 if change == "scaled" else 1.0
    shift = np.array([30.0, -500.0, 12.0]) if change == "moved" else np.zeros(3)
    order = np.arange(len(phantom.surface.points))
    triangles = phantom.surface.triangles
    if change == "shuffled":
        rng = np.random.default_rng(0)
        rng.shuffle(order)
        triangles = np.argsort(order)[triangles][rng.permutation(len(triangles))]
    place = lambda points: scale * points @ rotation.T + shift  # noqa: E731
    surface = Surface(place(phantom.surface.points)[order], triangles)
    again = flatten(surface, {label: place(at) for label, at in phantom.seeds.items()})
    points = np.empty_like(again.points)
    points[order[again.surface.point_data["surface_point_id"]]] = again.points
    assert np.abs(points - phantom_map.points).max() < (0.005 if change == "shuffled" else 1e-6)


@pytest.mark.parametrize("turned", [False, True])
def test_orientation_of_the_triangles_does_not_matter(phantom, phantom_map, turned):
    from LAFlatteningLib.flattening import flatten

    triangles = phantom.surface.triangles.copy()
    some = np.random.default_rng(0).random(len(triangles)) < 0.5
    triangles[slice(None) if turned else some] = triangles[slice(None) if turned else some][:, ::-1]
    again = flatten(Surface(phantom.surface.points, triangles), phantom.seeds)
    assert np.abs(again.points - phantom_map.points).max() < 1e-3
    assert [note for note in again.cavity.notes if "turned" in note or "consistent" in note]


# ---- paths and regions ----


def test_seed_paths_follow_the_known_planes(cavity, phantom):
    """A path of the phantom lies in the plane of the centre and its two seeds, but for the bends at the veins."""
    connected = connect(cavity, phantom.seeds)
    for name, (a, b) in LEFT_ATRIUM.paths.items():
        line = connected.walks[name].positions
        assert np.allclose(line[0], connected_position(cavity, phantom, a))
        assert np.allclose(line[-1], connected_position(cavity, phantom, b))
        truth = phantom.true_paths[name]
        nearest = np.linalg.norm(line[:, None] - truth[None], axis=2).min(axis=1)
        assert np.median(nearest) < 2.0, name
        assert connected.lengths[name] == pytest.approx(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
        assert connected.lengths[name] < 1.02 * np.linalg.norm(np.diff(truth, axis=0), axis=1).sum()


def connected_position(cavity, phantom, label):
    return snap_seeds(phantom.seeds, cavity, LEFT_ATRIUM).positions[label]


def test_feet_are_in_order_on_every_rim(division):
    for opening in LEFT_ATRIUM.openings:
        feet = division.feet[opening]
        assert feet[0] == 0
        assert (np.diff(feet) > 0).all()
        for name, index in zip(LEFT_ATRIUM.feet(opening), feet, strict=True):
            assert division.loops[opening][index] in (division.paths[name][0], division.paths[name][-1])


def test_paths_are_edges_and_keep_clear_of_rims_and_of_each_other(division):
    edges = {tuple(edge) for edge in division.surface.edges.points.tolist()}
    rims = set(np.concatenate(list(division.loops.values())).tolist())
    seen: set[int] = set()
    for ids in division.paths.values():
        assert all((min(a, b), max(a, b)) in edges for a, b in zip(ids[:-1].tolist(), ids[1:].tolist(), strict=True))
        inner = set(ids[1:-1].tolist())
        assert not inner & rims
        assert not inner & seen
        seen |= inner


def test_regions_agree_with_the_known_ones(phantom):
    """Without moving feet, the regions differ from the truth by a strip along the paths only."""
    cavity = make_cavity(phantom.surface, LEFT_ATRIUM, np.array([phantom.seeds[s] for s in LEFT_ATRIUM.outer_seeds]))
    import dataclasses

    still = dataclasses.replace(
        TEMPLATE, holes={name: dataclasses.replace(rim, spread_feet=False) for name, rim in TEMPLATE.holes.items()}
    )
    division = divided(cavity, phantom.seeds, still)
    regions = label_regions(division, LEFT_ATRIUM)
    assert sorted(set(regions.tolist())) == [1, 2, 3, 4, 5]
    truth = phantom.surface.cell_data["true_region"][division.parent]
    agree = division.surface.triangle_areas[regions == truth].sum() / cavity.surface.area
    assert agree > 0.95


def test_each_region_is_one_piece(division):
    regions = label_regions(division, LEFT_ATRIUM)
    for number in LEFT_ATRIUM.regions:
        part, _ = division.surface.submesh(regions == number)
        assert part.component_count == 1


# ---- constraints ----


def test_constraints_by_length_put_points_on_the_template(division):
    constraints = constraints_by_length(division, TEMPLATE)
    assert len(np.unique(constraints.ids)) == len(constraints.ids)
    position = dict(zip(constraints.ids.tolist(), constraints.targets, strict=True))
    for opening in LEFT_ATRIUM.openings:
        loop = division.loops[opening]
        at = np.array([position[i] for i in loop.tolist()])
        rim = TEMPLATE.rim(opening)
        assert rim.shape.distance(at).max() < 1e-12
        for name, index in zip(LEFT_ATRIUM.feet(opening), division.feet[opening], strict=True):
            assert np.allclose(at[index], rim.shape.at(rim.feet[name]))
        # Counter-clockwise once round, and steps in proportion to lengths within each arc.
        turn = np.unwrap(np.arctan2(*(at - rim.shape.centre).T[::-1]))
        assert (np.diff(turn) > 0).all()
        assert turn[-1] - turn[0] < 2 * np.pi
        steps = np.linalg.norm(np.diff(division.surface.points[loop], axis=0), axis=1)
        for start, stop in zip(division.feet[opening], [*division.feet[opening][1:], len(loop) - 1], strict=True):
            ratio = np.diff(turn)[start:stop] / steps[start:stop]
            assert np.ptp(ratio) < 1e-9 * ratio.max()
    for name, ids in division.paths.items():
        start, end = TEMPLATE.segment(name)
        walked = np.cumsum(np.linalg.norm(np.diff(division.surface.points[ids], axis=0), axis=1))
        for i, length in zip(ids[1:-1].tolist(), walked, strict=False):
            assert np.allclose(position[i], start + length / walked[-1] * (end - start))


def test_constraints_by_count_are_even(cavity, phantom):
    snapped = snap_seeds(phantom.seeds, cavity, LEFT_ATRIUM)
    connected = connect_seeds(cavity, snapped, LEFT_ATRIUM, WaysOverCovers(cavity))
    division = divide_as_published(cavity.surface, connected, TEMPLATE, "paper")
    constraints = constraints_by_count(division, TEMPLATE, as_printed=True)
    for name in LEFT_ATRIUM.paths:
        at = constraints.path_targets[constraints.path_of == name]
        start, end = TEMPLATE.segment(name)
        expected = start + np.arange(1, len(at) + 1)[:, None] / (len(at) + 1) * (end - start)
        assert np.allclose(at, expected)
