"""Gaps in ablation lines, against closed forms, a brute-force search, known scar and the published result."""

import csv
import json
import re

import networkx
import numpy as np
import pytest

from LAFlatteningLib.errors import Cancelled, LAFlatteningError, SurfaceError, TemplateError
from LAFlatteningLib.files import read_surface, write_surface
from LAFlatteningLib.flattening import flatten
from LAFlatteningLib.gaps import find_gaps, ring_search, search_areas
from LAFlatteningLib.gaps.level import cut_at_level
from LAFlatteningLib.gaps.ring_search import Centre, best_ring
from LAFlatteningLib.gaps.search_areas import vein_groups
from LAFlatteningLib.map_data import MapData
from LAFlatteningLib.operators import signed_areas, triangle_areas
from LAFlatteningLib.parcellation import Parcellation
from LAFlatteningLib.phantom import Gap, ScarPattern, ScarRing, make_phantom
from LAFlatteningLib.template import Template

ORIGIN = Centre(np.zeros((1, 2)))
INNER, OUTER = 5.0, 15.0


def annulus(rows=14, columns=60, jitter=0.0):
    """A flat ring of triangles, its points (n, 2) mm and its triangles."""
    radius = np.linspace(INNER, OUTER, rows)
    turn = np.linspace(0.0, 2.0 * np.pi, columns, endpoint=False) + 0.013
    r, t = (a.ravel() for a in np.meshgrid(radius, turn, indexing="ij"))
    if jitter:
        random = np.random.default_rng(5)
        inner = (r > INNER) & (r < OUTER)
        r = r + inner * jitter * random.uniform(-1, 1, len(r)) * (OUTER - INNER) / rows
        t = t + jitter * random.uniform(-1, 1, len(r)) * 2.0 * np.pi / columns
    i, j = (a.ravel() for a in np.meshgrid(np.arange(rows - 1), np.arange(columns), indexing="ij"))
    a, b = i * columns + j, i * columns + (j + 1) % columns
    triangles = np.concatenate([np.column_stack([a, a + columns, b]), np.column_stack([b, a + columns, b + columns])])
    return np.stack([r * np.cos(t), r * np.sin(t)], axis=1), triangles


def ring_of(flat, triangles, values, level=0.0, centre=ORIGIN):
    return best_ring(cut_at_level(lift(flat), flat, triangles, values, level), centre)


def lift(flat):
    return np.column_stack([flat, np.zeros(len(flat))])


def healthy(ring):
    return ring.lengths[~ring.in_scar].sum()


# ---- the level -------------------------------------------------------------------------------------------------------


def test_level_cuts_where_a_linear_quantity_reaches_it():
    flat, triangles = annulus(8, 30, jitter=0.3)
    values = 0.7 * flat[:, 0] - 0.4 * flat[:, 1]
    mesh = cut_at_level(lift(flat), flat, triangles, values, 1.3)
    assert triangle_areas(mesh.points, mesh.triangles).sum() == pytest.approx(triangle_areas(flat, triangles).sum())
    at = 0.7 * mesh.flat[mesh.triangles][..., 0] - 0.4 * mesh.flat[mesh.triangles][..., 1]
    assert (at[mesh.above] >= 1.3 - 1e-9).all()
    assert (at[~mesh.above] <= 1.3 + 1e-9).all()
    # Turned as before.
    assert (signed_areas(mesh.flat, mesh.triangles) > 0).all()


def test_triangles_with_an_unknown_corner_are_below_the_level():
    flat, triangles = annulus(6, 20)
    values = flat[:, 0].copy()
    values[::3] = np.nan
    mesh = cut_at_level(lift(flat), flat, triangles, values, 2.0)
    assert triangle_areas(mesh.points, mesh.triangles).sum() == pytest.approx(triangle_areas(flat, triangles).sum())
    known = np.isfinite(values[triangles]).all(axis=1)
    above = triangle_areas(mesh.points, mesh.triangles[mesh.above]).sum()
    alone = cut_at_level(lift(flat), flat, triangles[known], values, 2.0)
    assert above == pytest.approx(triangle_areas(alone.points, alone.triangles[alone.above]).sum())
    assert above > 0.0


# ---- the curve -------------------------------------------------------------------------------------------------------


def test_without_scar_the_curve_is_the_rim():
    flat, triangles = annulus()
    ring = ring_of(flat, triangles, np.full(len(flat), -1.0))
    assert not ring.in_scar.any()
    # A polygon of 60 corners in a circle.
    assert ring.lengths.sum() == pytest.approx(60 * 2 * INNER * np.sin(np.pi / 60), rel=1e-6)


@pytest.mark.parametrize("jitter", [0.0, 0.3])
@pytest.mark.parametrize("width", [2.5, 4.0, 6.0])
def test_a_gap_with_parallel_sides_is_as_long_as_it_is_wide(width, jitter):
    flat, triangles = annulus(24, 90, jitter)
    x, y = flat.T
    # All scar but the strip |y| < width / 2 on one side: linear in each triangle, except where its border bends.
    values = np.where(x > 0, np.abs(y) - 0.5 * width, 2.0)
    ring = ring_of(flat, triangles, values)
    assert healthy(ring) == pytest.approx(width, rel=0.005)
    assert np.count_nonzero(np.diff(np.append(ring.in_scar, ring.in_scar[0]).astype(int)) == -1) == 1


def test_complete_scar_leaves_no_gap_and_the_shortest_way_within_it():
    flat, triangles = annulus(20, 120)
    radius = np.linalg.norm(flat, axis=1)
    ring = ring_of(flat, triangles, np.minimum(radius - 8.0, 12.0 - radius))
    assert healthy(ring) < 1e-6
    assert ring.lengths.sum() == pytest.approx(2 * np.pi * 8.0, rel=0.005)


def test_travel_in_scar_is_free():
    """A long way round within scar is better than a short gap."""
    flat, triangles = annulus(40, 160)
    radius, turn = np.linalg.norm(flat, axis=1), np.arctan2(flat[:, 1], flat[:, 0])
    # A thin line of scar at the inner rim, open over 40 degrees, and a spur that leads round the opening far outside.
    line = np.where(np.abs(turn) > np.radians(20), 6.5 - radius, -1.0)
    spurs = np.where(np.abs(np.abs(turn) - np.radians(25)) < np.radians(5), 1.0, -1.0)
    bridge = np.where(np.abs(turn) < np.radians(28), 1.0 - np.abs(radius - 13.0), -1.0)
    ring = ring_of(flat, triangles, np.maximum(np.maximum(line, spurs), bridge))
    assert healthy(ring) < 1e-6
    assert np.linalg.norm(ring.flat, axis=1).max() > 11.5
    without = ring_of(flat, triangles, np.maximum(line, spurs))
    assert np.linalg.norm(without.flat, axis=1).max() < 7.0


def test_a_gap_across_the_line_where_turns_are_counted_is_one():
    for turned in (0.0, np.pi):
        flat, triangles = annulus(16, 80)
        angle = (np.arctan2(flat[:, 1], flat[:, 0]) - turned + np.pi) % (2 * np.pi) - np.pi
        ring = ring_of(flat, triangles, np.abs(angle) - 0.3)
        assert np.count_nonzero(np.diff(np.append(ring.in_scar, ring.in_scar[0]).astype(int)) == -1) == 1
        assert healthy(ring) == pytest.approx(2 * INNER * 0.3, rel=0.03)


def test_finding_it_on_the_mesh_agrees_with_a_brute_force_search(monkeypatch):
    """Along edges alone the least cost is known from trying every start in a graph unrolled by angle."""
    flat, triangles = annulus(7, 24, jitter=0.35)
    monkeypatch.setattr(ring_search, "MOST_NODES", 0)
    random = np.random.default_rng(11)
    for _ in range(5):
        smooth = random.normal(size=(len(flat),))
        for _ in range(2):
            total, count = np.zeros(len(flat)), np.zeros(len(flat))
            np.add.at(total, triangles, smooth[triangles].mean(axis=1)[:, None])
            np.add.at(count, triangles, 1.0)
            smooth = total / count
        mesh = cut_at_level(lift(flat), flat, triangles, smooth, 0.0)
        ring = best_ring(mesh, ORIGIN)
        cost = (ring.lengths * np.where(ring.in_scar, ring_search.SCAR_COST, 1.0)).sum()
        graph = networkx.DiGraph()
        for corners, above in zip(mesh.triangles.tolist(), mesh.above.tolist(), strict=True):
            for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
                for p, q in ((a, b), (b, a)):
                    z = complex(*mesh.flat[q]) / complex(*mesh.flat[p])
                    # Sheets are counted by the angle from the negative x axis, unlike in the search.
                    before = np.angle(complex(*mesh.flat[p]))
                    turn = round((before + np.angle(z) - np.angle(complex(*mesh.flat[q]))) / (2 * np.pi))
                    length = np.linalg.norm(mesh.flat[p] - mesh.flat[q]) * (ring_search.SCAR_COST if above else 1.0)
                    for sheet in range(-1, 3):
                        old = graph.get_edge_data((p, sheet), (q, sheet + turn), {"weight": np.inf})["weight"]
                        graph.add_edge((p, sheet), (q, sheet + turn), weight=min(old, length))
        best = min(
            networkx.single_source_dijkstra_path_length(graph, (v, 0)).get((v, 1), np.inf) for v in range(len(flat))
        )
        assert cost == pytest.approx(best, abs=2 * ring_search.EXACT_MM)


def test_pairs_are_gone_round_together():
    """Two holes: the curve keeps off the line between their centres."""
    flat, triangles = annulus(30, 120)
    # One wide opening, whose two halves are the holes.
    pair = Centre(np.array([[-2.0, 0.0], [2.0, 0.0]]))
    ring = ring_of(flat, triangles, np.full(len(flat), -1.0), centre=pair)
    assert ring.lengths.sum() == pytest.approx(2 * np.pi * INNER, rel=0.001)
    # Centres in the tissue: the way round both is longer than round the opening.
    apart = Centre(np.array([[0.0, 0.0], [8.0, 0.0]]))
    ring = ring_of(flat, triangles, np.full(len(flat), -1.0), centre=apart)
    tangent = np.sqrt(8.0**2 - INNER**2)
    angle = np.arccos(INNER / 8.0)
    shortest = 2 * tangent + 2 * (np.pi - angle) * INNER
    # It turns at the first node beyond the centre, not at the centre itself.
    assert 0.999 * shortest < ring.lengths.sum() < 1.02 * shortest


def test_an_area_that_does_not_close_is_none():
    flat, triangles = annulus()
    half = (flat[triangles][..., 0] > -2.0).all(axis=1)
    assert ring_of(flat, triangles[half], np.zeros(len(flat))) is None


# ---- known scar ------------------------------------------------------------------------------------------------------

LINES = ScarPattern(
    rings=(
        ScarRing(("LSPV",), 1.0, 5.0, (Gap(60.0, 3.0),)),
        ScarRing(("LIPV",), 1.0, 4.0, (Gap(200.0, 5.0), Gap(300.0, 3.0))),
        ScarRing(("RSPV",), 1.0, 5.0, (Gap(300.0, 8.0),)),
        ScarRing(("RIPV",), 1.0, 4.0, (Gap(200.0, 12.0),)),
    )
)
TRUTH = {"LSPV": [3.0], "LIPV": [5.0, 3.0], "RSPV": [8.0], "RIPV": [12.0]}


def lined(points, pattern=LINES):
    phantom = make_phantom(points, scar=pattern)
    offset = phantom.surface.points - np.array(phantom.shape.centre)
    directions = offset / np.linalg.norm(offset, axis=1, keepdims=True)
    depth = pattern.depth(directions, phantom.shape.caps)
    return flatten(phantom.surface.with_data({"depth": depth}), phantom.seeds)


@pytest.mark.parametrize(("points", "arrays"), [(2500, ["depth"]), (7000, ["depth", "scar"]), (14000, ["LGE", "scar"])])
def test_known_gaps_are_found_to_a_millimetre(points, arrays):
    flat_map = lined(points)
    for array in arrays:
        level = {"depth": 0.0, "scar": 0.5, "LGE": 120.0}[array]
        found = find_gaps(flat_map, array, [level]).at(level)
        for vein, widths in TRUTH.items():
            lengths = [gap.length_mm for gap in found[vein].gaps]
            assert lengths == pytest.approx(widths, abs=1.0), (array, vein)
            assert found[vein].gap_length_mm == pytest.approx(sum(lengths))
        # Round both veins of a side, every gap of theirs counts, on the atrium and on the map at the same places.
        left = found["left"]
        assert [gap.length_mm for gap in left.gaps] == pytest.approx([5.0, 3.0, 3.0], abs=1.0)


def test_gaps_are_where_they_were_made():
    flat_map = lined(5000)
    found = find_gaps(flat_map, "depth", [0.0]).at(0.0)
    phantom = make_phantom(1000, scar=LINES)
    caps = phantom.shape.caps
    for ring in LINES.rings:
        for gap, made in zip(found[ring.veins[0]].gaps, sorted(ring.gaps, key=lambda gap: -gap.width), strict=True):
            offset = gap.place_mm - np.array(phantom.shape.centre)
            direction = offset / np.linalg.norm(offset)
            # In the middle of the strip that was left out.
            depth = ring.gap_depth(made, direction[None], caps)[0]
            assert depth == pytest.approx(0.5 * made.width, abs=0.7)
            assert gap.points_mm.shape[0] == gap.points_on_map.shape[0] >= 2
            assert np.linalg.norm(gap.points_mm - gap.place_mm, axis=1).max() < 0.6 * gap.length_mm


@pytest.mark.parametrize("points", [2500, 7000])
def test_a_complete_line_has_no_gap_and_none_is_all_gap(points):
    rings = tuple(ScarRing((vein,), 1.0, 5.0) for vein in ("RSPV", "LSPV", "LIPV"))
    flat_map = lined(points, ScarPattern(rings))
    found = find_gaps(flat_map, "scar", [0.5]).at(0.5)
    for vein in ("RSPV", "LSPV", "LIPV", "left"):
        assert found[vein].complete
        assert found[vein].rgm == 0.0
        assert found[vein].gaps == ()
    bare = found["RIPV"]
    assert bare.rgm == 1.0
    assert bare.scar_length_mm == 0.0
    # The whole rim: a circle of the perimeter that the phantom has there.
    assert [gap.length_mm for gap in bare.gaps] == pytest.approx([44.49], rel=0.01)


def test_joint_line_round_two_veins(phantom):
    flat_map = flatten(*(lambda p: (p.surface, p.seeds))(make_phantom(7000)))
    found = find_gaps(flat_map, "scar", [0.5])
    # The default scar: gaps of 5 and 3 mm round the left veins, 8 mm round RSPV, none round RIPV.
    left = found.at(0.5)["left"]
    assert [gap.length_mm for gap in left.gaps] == pytest.approx([5.0, 3.0], abs=1.0)
    assert found.at(0.5)["RIPV"].complete
    # Alone, each left vein is open where no line runs between them.
    assert found.at(0.5)["LSPV"].gap_length_mm > 10.0


def test_higher_thresholds_leave_longer_gaps():
    flat_map = lined(4000)
    thresholds = [-1.0, -0.5, 0.0]
    report = find_gaps(flat_map, "depth", thresholds)
    for vein in TRUTH:
        lengths = [ring.gap_length_mm for ring in report.rings[vein]]
        # A depth of d shrinks scar by d on each side of a gap.
        assert lengths == sorted(lengths)
        assert np.diff(lengths)[-1] == pytest.approx(1.0 * len(TRUTH[vein]), abs=0.5)
        assert len(report.to_dict()["rgm_over_threshold"][vein]) == len(thresholds)


# ---- the published result --------------------------------------------------------------------------------------------


def published(data_dir):
    folder = data_dir / "pvi_gap"
    cavity, flat = read_surface(folder / "cavity.vtp"), read_surface(folder / "flat_reference.vtp")
    with (folder / "gap_reference_4veins.csv").open() as file:
        header, *rows = csv.reader(file)
    reference = {vein: [float(row[k]) for row in rows] for k, vein in enumerate(header) if k}
    return MapData(cavity, flat.points[:, :2], Template.load("adapted1")), reference


def test_published_gaps(data_dir):
    data, reference = published(data_dir)
    areas = {vein: vein.lower() for vein in reference}
    found = find_gaps(data, "scalars", [108.0], search=areas).at(108.0)
    for vein, (length, rgm, count) in reference.items():
        assert found[vein].openings == (vein,)
        assert found[vein].gap_length_mm == pytest.approx(length, rel=0.1)
        assert found[vein].rgm == pytest.approx(rgm, abs=0.05)
        assert len(found[vein].gaps) == count


def test_published_definition_gives_the_published_lengths(data_dir, monkeypatch):
    """The differences to the published lengths come from its triangles and edges, not from the search."""
    from LAFlatteningLib.gaps import quantification
    from LAFlatteningLib.gaps.level import CutMesh

    def whole_triangles(points, flat, triangles, values, level):
        return CutMesh(points, flat, triangles, (values >= level)[triangles].sum(axis=1) >= 2)

    monkeypatch.setattr(quantification, "cut_at_level", whole_triangles)
    monkeypatch.setattr(ring_search, "MOST_NODES", 0)
    data, reference = published(data_dir)
    found = find_gaps(data, "scar", [0.5], search={vein: vein.lower() for vein in reference}).at(0.5)
    for vein, (length, _, count) in reference.items():
        assert found[vein].gap_length_mm == pytest.approx(length, abs=1e-3)
        assert len(found[vein].gaps) == count


# ---- input and output ------------------------------------------------------------------------------------------------


def test_a_map_file_gives_the_same_gaps(tmp_path, phantom_map):
    write_surface(phantom_map.to_surface(), tmp_path / "map.vtp")
    again = MapData.of(read_surface(tmp_path / "map.vtp"))
    found = [find_gaps(one, "LGE", [110.0, 120.0]).to_dict() for one in (phantom_map, again)]
    assert json.dumps(found[0]) == json.dumps(found[1])
    entry = found[0]["results"][1]["areas"]["RSPV"]
    assert {"gap_length_mm", "scar_length_mm", "rgm", "gaps"} <= set(entry)
    assert len(entry["path_mm"]) == len(entry["path_on_map"]) == len(entry["path_in_scar"])
    path = np.array(entry["path_mm"])
    lengths = np.linalg.norm(np.roll(path, -1, axis=0) - path, axis=1)
    scar = np.array(entry["path_in_scar"], bool)
    assert lengths[~scar].sum() == pytest.approx(entry["gap_length_mm"], abs=0.1)
    assert lengths[scar].sum() == pytest.approx(entry["scar_length_mm"], abs=0.2)


def test_short_gaps_can_be_left_out_of_the_list():
    flat_map = lined(3000)
    found = find_gaps(flat_map, "depth", [0.0], minimum_mm=4.0).at(0.0)["LIPV"]
    assert [round(gap.length_mm) for gap in found.gaps] == [5]
    assert found.small_gaps == 1
    assert found.gap_length_mm == pytest.approx(8.0, abs=1.0)


def test_unknown_values_count_as_healthy_and_are_noted(phantom_map):
    scar = phantom_map.surface.point_data["scar"].astype(float)
    whole = MapData.of(phantom_map)
    full = find_gaps(whole, "scar", [0.5]).at(0.5)["RIPV"]
    assert full.complete
    nearest = np.argsort(np.linalg.norm(whole.flat - full.points_on_map[0], axis=1))[:40]
    scar[nearest] = np.nan
    data = MapData(whole.surface.with_data({"scar": scar}), whole.flat, whole.template)
    report = find_gaps(data, "scar", [0.5])
    ring = report.at(0.5)["RIPV"]
    assert ring.gap_length_mm > 1.0
    assert ring.unknown_share > 0.0
    assert any("40 of" in note and "count as healthy" in note for note in report.notes)
    assert any("search area RIPV has no value" in note for note in report.notes)


def test_gaps_on_the_border_of_the_search_area_are_noted(phantom_map):
    # The default joint line round the left veins runs farther out than 5 mm from their rims.
    report = find_gaps(phantom_map, "scar", [0.5], search=5.0)
    assert report.at(0.5)["left"].gap_on_border_mm > 1.0
    assert any(note.startswith("left at 0.5") and "border of the search area" in note for note in report.notes)
    assert not any(note.startswith("LIPV at") for note in report.notes)


def test_groups_come_from_the_anatomy(phantom_map):
    anatomy = phantom_map.template.anatomy
    assert vein_groups(anatomy) == {
        "RSPV": ("RSPV",),
        "RIPV": ("RIPV",),
        "LIPV": ("LIPV",),
        "LSPV": ("LSPV",),
        "left": ("LSPV", "LIPV"),
        "right": ("RSPV", "RIPV"),
    }


def test_published_search_areas_can_be_chosen(phantom_map):
    report = find_gaps(phantom_map, "scar", [0.5], search="vein_surroundings")
    assert report.search == "vein_surroundings"
    assert report.at(0.5)["left"].openings == ("LIPV", "LSPV")
    assert report.at(0.5)["RIPV"].complete


def test_round_veins_that_lie_far_apart_is_searched_farther(phantom_map):
    """Within 4 mm of the rims there is no way round two veins that are 12 mm apart or more."""
    near, usual = find_gaps(phantom_map, "LGE", [120.0], search=4.0), find_gaps(phantom_map, "LGE", [120.0])
    assert set(near.rings) == set(usual.rings) == {"RSPV", "RIPV", "LIPV", "LSPV", "left", "right"}
    assert near.left_out == ()
    assert not any("mm apart" in note for note in usual.notes)
    apart_notes = [note for note in near.notes if "mm apart" in note]
    for pair, note in zip(("LSPV and LIPV", "RSPV and RIPV"), apart_notes, strict=True):
        apart, within = map(float, re.search(r"are (\d+) mm apart.*within (\d+) mm", note).groups())
        assert note.startswith(pair) and within == pytest.approx(np.hypot(apart / 2, 4.0), abs=0.8)


def test_what_another_opening_interrupts_is_left_out_and_noted(phantom_map, monkeypatch):
    make = search_areas._search_area

    def interrupted(data, name, *arguments):
        if name == "left":
            raise SurfaceError("it runs into LAA")
        return make(data, name, *arguments)

    monkeypatch.setattr(search_areas, "_search_area", interrupted)
    found = find_gaps(phantom_map, "LGE", [120.0])
    assert found.left_out == ("left",) and "left" not in found.rings
    assert found.notes[-1].startswith("Left out: no closed way round left was found within 15 mm of the rims")
    assert found.to_dict()["left_out"] == ["left"]
    monkeypatch.setattr(search_areas, "INSIDE", 1.1)
    monkeypatch.setattr(search_areas, "_search_area", make)
    with pytest.raises(SurfaceError, match=r"Gaps cannot be measured.*within 15 mm.*nearer to the rims"):
        find_gaps(phantom_map, "LGE", [120.0])


def test_a_gap_between_two_veins_is_on_their_carina(phantom_map):
    """Scar all round RIPV but for a wedge, which lies once towards RSPV and once away from it."""
    data, template = MapData.of(phantom_map), phantom_map.template
    centres = {name: np.array(template.holes[name].shape.centre) for name in ("RIPV", "RSPV")}
    off = data.flat - centres["RIPV"]
    for turn, name in ((0.0, "right carina"), (np.pi, "right inferior")):
        towards = np.arctan2(*(centres["RSPV"] - centres["RIPV"])[::-1]) + turn
        angle = (np.arctan2(off[:, 1], off[:, 0]) - towards + np.pi) % (2.0 * np.pi) - np.pi
        scar = MapData(data.surface.with_data({"ring": np.abs(angle)}), data.flat, template)
        (gap,) = find_gaps(scar, "ring", [0.4]).at(0.4)["RIPV"].gaps
        assert (gap.segment, gap.segments, gap.where) == (name, (name,), name)


def test_a_long_gap_is_named_from_where_to_where(phantom_map):
    data = MapData.of(phantom_map)
    off = data.flat - np.array(phantom_map.template.holes["RIPV"].shape.centre)
    # Healthy but for a wedge on the right.
    scar = MapData(
        data.surface.with_data({"ring": -np.abs(np.arctan2(off[:, 1], off[:, 0]))}), data.flat, data.template
    )
    ring = find_gaps(scar, "ring", [-0.4]).at(-0.4)["RIPV"]
    (gap,) = ring.gaps
    assert len(gap.segments) > 2
    assert gap.segments[0] in gap.where and gap.where.endswith(f"over {gap.segment}")
    assert gap.to_dict()["segments"] == list(gap.segments)
    assert ring.wide_gaps == 1


def test_gaps_of_a_width_that_is_reported_are_counted_apart(phantom_map):
    for ring in find_gaps(phantom_map, "LGE", [110.0]).at(110.0).values():
        assert ring.wide_gaps == sum(gap.length_mm >= 3.0 for gap in ring.gaps) == ring.to_dict()["wide_gaps"]


def test_a_path_without_scar_is_healthy_all_round(phantom_map):
    ring = find_gaps(phantom_map, "LGE", [500.0]).at(500.0)["RSPV"]
    assert [gap.segment for gap in ring.gaps] == ["all round"]
    assert "all round" not in {gap.segment for gap in find_gaps(phantom_map, "LGE", [120.0]).at(120.0)["RSPV"].gaps}


def test_scar_of_voltages_is_where_they_are_low(phantom_map):
    data = MapData.of(phantom_map)
    voltage = 3.0 - data.surface.point_data["LGE"] / 60.0
    data = MapData(data.surface.with_data({"Bipolar": voltage}), data.flat, data.template)
    high, low = find_gaps(data, "LGE", [120.0]), find_gaps(data, "Bipolar", [1.0])
    assert (high.direction, low.direction) == ("above", "below")
    assert low.scar_words(1.0) == "Bipolar below 1 mV"
    for name, ring in low.at(1.0).items():
        other = high.at(120.0)[name]
        assert ring.gap_length_mm == pytest.approx(other.gap_length_mm, abs=1e-6)
        assert ring.rgm == pytest.approx(other.rgm, abs=1e-6)
    above = find_gaps(data, "Bipolar", [1.0], direction="above")
    assert above.at(1.0)["RSPV"].complete and not low.at(1.0)["RSPV"].complete
    assert "everything is scar" in find_gaps(data, "Bipolar", [9.0]).notes[0]
    assert "nothing is scar" in find_gaps(data, "Bipolar", [-9.0]).notes[0]
    # Less than the threshold: a value that equals it is healthy.
    whole = MapData(data.surface.with_data({"voltage": np.ones(len(voltage))}), data.flat, data.template)
    assert find_gaps(whole, "voltage", [1.0]).at(1.0)["RSPV"].rgm == 1.0


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"array": "voltage"}, LAFlatteningError, 'no array "voltage"'),
        ({"thresholds": []}, LAFlatteningError, "No threshold is given"),
        ({"thresholds": [2.0, 1.0]}, LAFlatteningError, "Thresholds out of order"),
        ({"thresholds": [1.0, 1.0]}, LAFlatteningError, "Thresholds out of order"),
        ({"thresholds": [np.nan]}, LAFlatteningError, "thresholds that are numbers"),
        ({"minimum_mm": -1.0}, LAFlatteningError, "least length of gaps"),
        ({"search": 0.0}, LAFlatteningError, "search distance"),
        ({"search": "nowhere"}, TemplateError, 'no parcellation "nowhere"'),
        ({"search": {"RSPV": "nowhere"}}, LAFlatteningError, 'no array "nowhere"'),
        ({"search": "segments_24"}, SurfaceError, "goes round no opening"),
        ({"search": {"RSPV": "nothing"}}, SurfaceError, "is empty"),
        ({"search": {"RSPV": "open"}}, SurfaceError, "does not go all the way round RSPV"),
        ({"search": {"RSPV": "runs_into"}}, SurfaceError, "also runs into RIPV"),
        ({"direction": "beside"}, LAFlatteningError, 'found "beside"'),
        ({"array": "unknown"}, LAFlatteningError, "every value is NaN"),
    ],
)
def test_bad_input_is_refused(phantom_map, options, error, message):
    whole = MapData.of(phantom_map)
    x, y = whole.flat.T
    near = np.hypot(x - 0.205, y - 0.08375) < 0.13
    own = {
        "unknown": np.full(len(x), np.nan),
        "nothing": np.zeros(len(x)),
        "open": near & ~((np.abs(x - 0.205) < 0.05) & (y > 0.131)),
        "runs_into": near | ((np.hypot(x - 0.205, y + 0.10875) < 0.06) & (y > -0.12)),
    }
    data = MapData(whole.surface.with_data(own), whole.flat, whole.template)
    with pytest.raises(error, match=re.escape(message)):
        find_gaps(data, **{"array": "scar", "thresholds": [0.5], **options})


def test_work_can_be_stopped(phantom_map):
    with pytest.raises(Cancelled):
        find_gaps(phantom_map, "scar", [0.5], progress=lambda share, text: share < 0.3)


def test_user_search_areas(phantom_map):
    area = {"type": "surroundings", "hole": "RIPV", "radius": 0.25}
    own = Parcellation.from_dict(
        {
            "schema": "laflattening-parcellation/1",
            "name": "mine",
            "anatomy": "left_atrium",
            "parts": [{"label": 1, "name": "mine", "area": area}],
        }
    )
    assert find_gaps(phantom_map, "scar", [0.5], search=own).at(0.5)["mine"].complete
