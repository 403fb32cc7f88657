"""The map lowered part by part is the map lowered as a whole."""

import numpy as np
import pytest
from scipy import sparse

from LAFlatteningLib import flatten
from LAFlatteningLib.division import label_regions
from LAFlatteningLib.flattening import refinement
from LAFlatteningLib.flattening.parts import Blocks, movable_parts
from LAFlatteningLib.solvers import Factorisation


def test_parts_are_what_no_triangle_joins(phantom_map, monkeypatch):
    """On the cut surface of the phantom: the regions, each without its rims and paths."""
    monkeypatch.setattr("LAFlatteningLib.flattening.parts.SMALLEST", 0)
    division = phantom_map.division
    triangles = division.surface.triangles
    movable = np.ones(len(division.surface.points), bool)
    movable[phantom_map.constraints.ids] = False
    parts = movable_parts(triangles, movable)
    assert (np.sum(parts, axis=0) == movable).all()
    corners = movable[triangles]
    number = np.full(len(movable), -1)
    for k, mask in enumerate(parts):
        number[mask] = k
    of_corner = np.where(corners, number[triangles], -1)
    # All movable corners of a triangle belong to one part, and a part to one region.
    low = np.where(corners, of_corner, len(parts)).min(axis=1)
    assert (low[corners.any(axis=1)] == of_corner.max(axis=1)[corners.any(axis=1)]).all()
    region = label_regions(division, phantom_map.template.anatomy)
    for k in range(len(parts)):
        assert len(np.unique(region[(of_corner == k).any(axis=1)])) == 1
    assert {int(region[(of_corner == k).any(axis=1)][0]) for k in range(len(parts))} == {1, 2, 3, 4, 5}


def test_small_parts_are_put_together():
    # Two triangles far apart: a point each may move.
    triangles = np.array([[0, 1, 2], [3, 4, 5]])
    movable = np.array([True, False, False, True, False, False])
    (only,) = movable_parts(triangles, movable)
    assert (only == movable).all()


def test_blocks_solve_what_the_whole_matrix_does():
    rng = np.random.default_rng(0)
    small = [np.eye(3) * 4 + np.ones((3, 3)), np.eye(4) * 2 + np.ones((4, 4))]
    numbers = [np.array([0, 3, 5]), np.array([1, 2, 4, 6])]
    whole = np.zeros((7, 7))
    for ids, block in zip(numbers, small, strict=True):
        whole[np.ix_(ids, ids)] = block
    right = rng.standard_normal((7, 2))
    blocks = Blocks(numbers, [Factorisation(sparse.csc_matrix(block)) for block in small])
    assert blocks.size == 7
    np.testing.assert_allclose(blocks.solve(right), np.linalg.solve(whole, right), atol=1e-12)


@pytest.mark.parametrize("hessians", [True, False])
def test_part_by_part_is_the_minimum_of_the_whole(phantom, monkeypatch, hessians):
    if not hessians:
        monkeypatch.setattr(refinement, "MOST_FOR_HESSIAN", 0)
    monkeypatch.setattr(refinement, "BY_PARTS", 10**9)
    whole = flatten(phantom.surface, phantom.seeds)
    monkeypatch.setattr(refinement, "BY_PARTS", 0)
    by_parts = flatten(phantom.surface, phantom.seeds)
    apart = np.abs(by_parts.points - whole.points).max() / whole.template.radius
    # Both end once a step of the exact Hessian is below 1e-8, of the approximation below 2e-4.
    assert 0.0 < apart < (1e-7 if hessians else 2e-3)
    assert not len(by_parts.folded_triangles)
