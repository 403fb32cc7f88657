"""The division of the cavity: paths between the seeds, their feet on the rims, and the regions between them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from . import topology
from .anatomy import Anatomy
from .errors import SurfaceError, TemplateError
from .geodesics import PathTree
from .seed_paths import SeedPaths, Walk
from .subcontours import spread_counts
from .surface import IntArray, Surface
from .template import Template


@dataclass(frozen=True, eq=False)
class Division:
    """Rims and paths on the cavity, ready to be laid on a template.

    Attributes
    ----------
    surface : the cavity; in the method ``regional`` with its triangles cut along the paths, so that its first points
        are those of the cavity and the others lie on edges of the cavity.
    loops : opening -> its rim as point ids, counter-clockwise on the map, starting at the first foot.
    feet : opening -> indices in the loop of the feet, in the order of `Anatomy.feet`.
    paths : path -> point ids from foot to foot, feet included.
    walks : path -> the way from seed to seed that gave the feet.
    parent : (triangles of `surface`,) the triangle of the cavity of which each is a part.
    notes : what is unusual about the seeds.
    landmarks : landmark -> its point.
    """

    surface: Surface
    loops: Mapping[str, IntArray]
    feet: Mapping[str, IntArray]
    paths: Mapping[str, IntArray]
    walks: Mapping[str, Walk]
    parent: IntArray
    notes: tuple[str, ...] = ()
    landmarks: Mapping[str, int] = field(default_factory=dict)


def divide_as_published(surface: Surface, connected: SeedPaths, template: Template, rounding: str) -> Division:
    """Rims and paths by the published rules: points are counted, paths found again on the open cavity.

    Parameters
    ----------
    rounding : see `subcontours.ROUNDINGS`.
    """
    anatomy = template.anatomy
    loops, feet = {}, {}
    for opening in anatomy.openings:
        order = anatomy.feet(opening)
        start = int(connected.feet[opening][order[0]])
        loop = np.roll(connected.loops[opening], -start)
        index = np.array([(connected.feet[opening][name] - start) % len(loop) for name in order]).astype(np.int64)
        if template.rim(opening).spread_feet:
            arcs = np.diff(np.append(index, len(loop))).tolist()
            if len(arcs) != 3:
                raise TemplateError(
                    f"holes.{opening}.spread_feet: the published rule is for three paths, found {len(arcs)}. Set it to "
                    "false, or use the method regional."
                )
            index = np.concatenate(
                [[0], np.cumsum(spread_counts(arcs, template.rim(opening).shares(order), rounding))[:-1]]
            )
        if len(loop) < 2 * len(index):
            raise SurfaceError(
                f"The rim of {opening} has {len(loop)} points; the published rule needs at least {2 * len(index)} for "
                f"its {len(index)} paths. Use the method regional, or a finer mesh."
            )
        loops[opening], feet[opening] = loop, _apart(index, len(loop))
    foot = _foot_ids(anatomy, loops, feet)
    landmarks = {name: int(connected.loops[name][0]) for name in anatomy.landmarks}
    foot.update({(name, path): point for name, point in landmarks.items() for path in anatomy.feet(name)})
    paths = {}
    for name, (a, b) in anatomy.paths.items():
        start, end = foot[anatomy.opening_of(a), name], foot[anatomy.opening_of(b), name]
        ids = PathTree(surface.edge_graph, start).to(end)
        if ids is None:
            raise SurfaceError(f"No path {name} from {a} to {b} on the open cavity: it is not connected.")
        paths[name] = ids
    whole = np.arange(len(surface.triangles))
    return Division(surface, loops, feet, paths, connected.walks, whole, connected.notes, landmarks)


def _apart(index: IntArray, n: int) -> IntArray:
    """Feet (increasing from 0 on a rim of n points) moved as little as needed to be at different points."""
    index = index.copy()
    for k in range(1, len(index)):
        index[k] = max(index[k], index[k - 1] + 1)
    index[-1] = min(index[-1], n - 1)
    for k in range(len(index) - 2, 0, -1):
        index[k] = min(index[k], index[k + 1] - 1)
    return index


def _foot_ids(
    anatomy: Anatomy, loops: Mapping[str, IntArray], feet: Mapping[str, IntArray]
) -> dict[tuple[str, str], int]:
    return {
        (opening, name): int(loops[opening][index])
        for opening in anatomy.openings
        for name, index in zip(anatomy.feet(opening), feet[opening], strict=True)
    }


def label_regions(division: Division, anatomy: Anatomy) -> IntArray:
    """Region number of each triangle, (m,): the surface is cut along the paths, and each piece gets the region
    that lies on that side of the paths round it.

    Pieces cut off by paths that touch belong to the region on whose side most of their boundary lies.
    """
    surface = division.surface
    edges = surface.edges
    n = len(surface.points)
    key = edges.points[:, 0] * n + edges.points[:, 1]
    cut = np.zeros(len(key), bool)
    left_region = {dart: region for region in anatomy.regions for dart in anatomy.face(region)}
    walked, region_of_walk = [], []
    for name, ids in division.paths.items():
        for end, walk in ((0, ids), (1, ids[::-1])):
            walked.append(np.stack([walk[:-1], walk[1:]], axis=1))
            region_of_walk.append(np.full(len(walk) - 1, left_region[name, end]))
    directed = np.concatenate(walked)
    region_of_step = np.concatenate(region_of_walk)
    along = np.searchsorted(key, directed.min(axis=1) * n + directed.max(axis=1))
    cut[along] = True
    piece = topology.triangle_components(surface.triangles, edges, cut)
    # The triangle on the left of a directed edge is the one that runs along it.
    triangle = edges.triangles[along]
    corners = surface.triangles[triangle]
    runs = (corners == directed[:, None, :1]) & (np.roll(corners, -1, axis=2) == directed[:, None, 1:])
    inside = runs.any(axis=2) & (triangle >= 0)
    has_left = inside.any(axis=1)
    left = triangle[np.arange(len(triangle)), inside.argmax(axis=1)][has_left]
    numbers = np.array(sorted(anatomy.regions))
    votes = np.zeros((piece.max() + 1, len(numbers)))
    np.add.at(votes, (piece[left], np.searchsorted(numbers, region_of_step[has_left])), 1.0)
    return numbers[votes.argmax(axis=1)][piece]
