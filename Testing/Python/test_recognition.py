"""Which vein is which: from known layouts, turned, mirrored, disturbed."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from LAFlatteningLib.anatomy import LEFT_ATRIUM, Anatomy
from LAFlatteningLib.cavity.recognition import VeinsMissingError, recognise
from LAFlatteningLib.errors import SurfaceError, TemplateError

HOLES = LEFT_ATRIUM.holes
LAYOUT = np.array([LEFT_ATRIUM.layout[hole] for hole in HOLES])
LAYOUT /= np.linalg.norm(LAYOUT, axis=1, keepdims=True)


def disturbed(seed, degrees=10.0):
    """The layout, each direction turned by up to some degrees, in another order."""
    rng = np.random.default_rng(seed)
    turns = Rotation.from_rotvec(np.radians(degrees) * rng.uniform(-1, 1, (len(HOLES), 3)) / np.sqrt(3))
    order = rng.permutation(len(HOLES))
    return turns.apply(LAYOUT)[order], {hole: int(np.flatnonzero(order == k)[0]) for k, hole in enumerate(HOLES)}


@pytest.mark.parametrize("seed", range(20))
def test_names_are_found_in_patient_axes_and_without(seed):
    directions, truth = disturbed(seed)
    tilt = Rotation.from_euler("xyz", np.random.default_rng(seed).uniform(-12, 12, 3), degrees=True)
    directions = tilt.apply(directions)
    found = recognise(directions, [20.0] * 5, LEFT_ATRIUM)
    assert found.index == truth
    assert found.confidence == "high"
    assert recognise(directions * [-1, -1, 1], [20.0] * 5, LEFT_ATRIUM, "RAS").index == truth
    turned = Rotation.random(random_state=seed).apply(directions)
    assert recognise(turned, [20.0] * 5, LEFT_ATRIUM, None).index == truth


@pytest.mark.parametrize("axis", range(3))
def test_mirrored_atria_are_refused(axis):
    directions, truth = disturbed(axis)
    mirrored = directions * np.where(np.arange(3) == axis, -1.0, 1.0)
    if axis == 1:
        # Front to back, appendage and left inferior vein change places; the widths of the tubes tell (`plan_cuts`).
        assert recognise(mirrored, [20.0] * 5, LEFT_ATRIUM).mirrored == truth
    else:
        with pytest.raises(SurfaceError):
            recognise(mirrored, [20.0] * 5, LEFT_ATRIUM)
    with pytest.raises(SurfaceError, match="mirror image"):
        recognise(Rotation.random(random_state=axis).apply(mirrored), [20.0] * 5, LEFT_ATRIUM, None)


def test_message_names_the_cause():
    directions, _ = disturbed(3)
    with pytest.raises(SurfaceError, match="mirror image"):
        recognise(directions * [-1, 1, 1], [20.0] * 5, LEFT_ATRIUM)
    with pytest.raises(SurfaceError, match="as in RAS"):
        recognise(directions * [-1, -1, 1], [20.0] * 5, LEFT_ATRIUM)
    x, y, z = directions.T
    carto = np.stack([x, z, -y], axis=1)
    for space in ("LPS", "RAS"):
        with pytest.raises(SurfaceError, match=r"axes of CARTO .* --axes CARTO"):
            recognise(carto, [20.0] * 5, LEFT_ATRIUM, space)
    turned = Rotation.from_euler("z", 90, degrees=True).apply(directions)
    with pytest.raises(SurfaceError, match=r"turned by 9[0-9] degrees|turned by 8[0-9] degrees"):
        recognise(turned, [20.0] * 5, LEFT_ATRIUM)
    with pytest.raises(VeinsMissingError, match=r"Expected 5 .* found 4"):
        recognise(directions[:4], [20.0] * 4, LEFT_ATRIUM)


def test_a_bump_is_not_taken_for_a_vein():
    directions, truth = disturbed(1)
    bump = np.array([LEFT_ATRIUM.layout["RIPV"]]) + np.array([0.05, 0.1, -0.1])
    more = np.concatenate([directions, bump / np.linalg.norm(bump)])
    assert recognise(more, [20.0] * 5 + [3.0], LEFT_ATRIUM).index == truth


def test_an_open_rim_is_not_left_for_a_bump():
    """The best fitting of six candidates is a bump; all that are open are taken."""
    directions, truth = disturbed(2, 25.0)
    exact = LAYOUT[HOLES.index("LSPV")]
    more = np.concatenate([directions, [exact]])
    found = recognise(more, [np.inf] * 5 + [8.0], LEFT_ATRIUM)
    assert set(found.index.values()) == set(truth.values())


def test_two_likely_assignments_lower_the_confidence():
    directions, truth = disturbed(1, 2.0)
    beside = directions[truth["RSPV"]] + [0.0, 0.05, -0.05]
    more = np.concatenate([directions, [beside / np.linalg.norm(beside)]])
    found = recognise(more, [20.0] * 6, LEFT_ATRIUM)
    assert found.confidence == "low"
    assert any("RSPV" in note for note in found.notes)


def test_layout_belongs_to_an_anatomy():
    copy = Anatomy.from_dict(LEFT_ATRIUM.to_dict())
    assert copy == LEFT_ATRIUM
    data = LEFT_ATRIUM.to_dict() | {"layout": {"RSPV": [1, 0, 0]}}
    with pytest.raises(TemplateError, match=r"anatomy\.layout"):
        Anatomy.from_dict(data)
    with pytest.raises(SurfaceError, match="states no layout"):
        recognise(LAYOUT, [20.0] * 5, Anatomy.from_dict(LEFT_ATRIUM.to_dict() | {"layout": {}}))


def test_of_two_open_rims_that_fit_a_vein_the_wider_is_it():
    exact = LAYOUT.copy()
    off = exact[HOLES.index("RIPV")] + [0.02, 0.05, 0.02]
    directions = np.concatenate([exact, [off / np.linalg.norm(off)]])
    rises = [np.inf] * 6
    right = HOLES.index("RIPV")
    found = recognise(directions, rises, LEFT_ATRIUM, "LPS", [60.0] * 5 + [80.0])
    assert found.index["RIPV"] == 5
    assert found.confidence == "low"
    assert any("80 mm round" in note for note in found.notes)
    for perimeters in ([60.0] * 6, [60.0] * 5 + [40.0], [60.0] * 5 + [np.nan], None):
        assert recognise(directions, rises, LEFT_ATRIUM, "LPS", perimeters).index["RIPV"] == right
