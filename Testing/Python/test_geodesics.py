"""Shortest edge paths against closed forms and other libraries."""

import meshes
import networkx
import numpy as np
import potpourri3d
import pytest

from LAFlatteningLib.geodesics import PathTree
from LAFlatteningLib.half_edges import HalfEdges
from LAFlatteningLib.surface import Surface

# Edge paths are never shorter than the geodesic, and on meshes of near-equilateral triangles at most
# 2 / sqrt(3) = 1.155 times as long (walking along two sides instead of across).
LONGEST = 2 / np.sqrt(3) + 0.01


def length(surface, ids):
    return np.linalg.norm(np.diff(surface.points[ids], axis=0), axis=1).sum()


def test_along_a_row_of_edges_the_path_is_exact():
    surface = meshes.grid(11, 6, width=10.0)
    path = PathTree(surface.edge_graph, 0).to(10)
    assert path.tolist() == list(range(11))
    assert length(surface, path) == pytest.approx(10.0)


def test_great_circles_on_the_sphere():
    sphere = meshes.icosphere(5.0, 5)
    start = 5000  # not one of the twelve points with five neighbours
    tree = PathTree(sphere.edge_graph, start)
    rng = np.random.default_rng(0)
    for target in rng.integers(1, len(sphere.points), 40):
        exact = 5.0 * np.arccos(np.clip(sphere.points[start] @ sphere.points[target] / 25.0, -1, 1))
        assert 0.999 * exact <= tree.distance[target] <= LONGEST * exact


def test_helices_on_the_cylinder():
    tube = meshes.cylinder(radius=2.0, height=6.0, around=100, up=50)
    start = 0
    tree = PathTree(tube.edge_graph, start)
    angle = np.arctan2(tube.points[:, 1], tube.points[:, 0])
    turn = np.abs((angle - angle[start] + np.pi) % (2 * np.pi) - np.pi)
    exact = np.hypot(2.0 * turn, tube.points[:, 2] - tube.points[start, 2])
    away = exact > 1.0
    ratio = tree.distance[away] / exact[away]
    # Right triangles cut one way: walking against the diagonals costs up to (1 + 1) / sqrt(2).
    assert ratio.min() > 0.999
    assert ratio.max() < np.sqrt(2.0) + 0.01


def test_lengths_equal_those_of_networkx():
    rng = np.random.default_rng(3)
    surface = meshes.planar(rng.random((300, 2)), lambda centre: np.ones(len(centre), bool))
    graph = networkx.Graph()
    for (a, b), weight in zip(surface.edges.points.tolist(), surface.edge_lengths, strict=True):
        graph.add_edge(a, b, weight=weight)
    expected = networkx.single_source_dijkstra_path_length(graph, 7)
    tree = PathTree(surface.edge_graph, 7)
    for target, distance in expected.items():
        assert tree.distance[target] == pytest.approx(distance)
        assert length(surface, tree.to(target)) == pytest.approx(distance)


def test_edge_paths_bound_the_geodesics_of_potpourri3d():
    sphere = meshes.icosphere(5.0, 4)
    rng = np.random.default_rng(4)
    bumpy = type(sphere)(sphere.points * (1 + 0.05 * rng.random((len(sphere.points), 1))), sphere.triangles)
    solver = potpourri3d.EdgeFlipGeodesicSolver(bumpy.points, bumpy.triangles)
    tree = PathTree(bumpy.edge_graph, 0)
    for target in rng.integers(1, len(bumpy.points), 20):
        curve = solver.find_geodesic_path(0, int(target))
        exact = np.linalg.norm(np.diff(curve, axis=0), axis=1).sum()
        assert exact * 0.999 <= tree.distance[target] <= LONGEST * exact


def test_unreachable_point_gives_none():
    two = meshes.grid(3, 3)
    far = type(two)(
        np.concatenate([two.points, two.points + 9]), np.concatenate([two.triangles, two.triangles + len(two.points)])
    )
    assert PathTree(far.edge_graph, 0).to(len(two.points)) is None


def test_of_several_ways_between_two_points_the_shortest_counts():
    """Round a point of three triangles, each way straight across an edge has the ends of another edge."""
    tip = np.array([[0.0, 0.0, 6.0]])
    base = np.array([[np.cos(t), np.sin(t), 0.0] for t in 2.0 * np.pi * np.arange(3) / 3])
    surface = Surface(np.concatenate([base, tip]), np.array([[0, 1, 3], [1, 2, 3], [2, 0, 3]]))
    mesh = HalfEdges.of(surface)
    across, lengths = mesh.diagonals()
    graph = mesh.near_graph().toarray()
    assert len(across) > 0
    for a in range(4):
        for b in range(4):
            ways = [np.linalg.norm(surface.points[a] - surface.points[b])] if a != b else []
            ways += [length for ends, length in zip(across.tolist(), lengths, strict=True) if set(ends) == {a, b}]
            assert graph[a, b] == pytest.approx(min(ways) if a != b else 0.0)
