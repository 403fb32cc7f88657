"""Small defects of a surface mended, each noted with its place, before anything is measured on it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from .. import operators, topology
from ..errors import SurfaceError
from ..surface import Surface
from .covers import HOLE_ARRAY, close_rims

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

COINCIDENT = 1e-5
"""Points nearer than about this are one, mm."""
PINHOLE_PERIMETER = 6.0
"""An opening with a shorter rim is a pinhole, mm: 2 mm across, a fraction of the smallest vein."""
TINY_AREA = 0.05
"""A component, or a fin on an edge, with less than this share of the whole area may be dropped."""
SPIKE = 2.0
"""A point that stands farther above its neighbours than so many of their radii is a spike (a cone below 27 degrees)."""


def heal_surface(surface: Surface) -> tuple[Surface, tuple[str, ...]]:
    """Mend small defects: coincident points, degenerate and double triangles, fins, sheets that touch in a point, tiny
    components, spikes, pinholes.

    Point and cell arrays travel along.

    Returns
    -------
    surface : without those defects; the same object where nothing had to be done.
    notes : what was changed, with places in mm.

    Raises
    ------
    SurfaceError : what is too large to be dropped, or cannot be mended, with its place.
    """
    notes: list[str] = []
    for step in (_merge_points, _drop_bad_triangles, _drop_fins, _drop_components, _split_points, _flatten_spikes):
        surface = step(surface, notes)
    surface = _close_pinholes(surface, notes)
    return surface, tuple(notes)


def _place(surface: Surface, point: int) -> str:
    return f"({', '.join(f'{x:.1f}' for x in surface.points[point])}) mm {surface.space}"


def _merge_points(surface: Surface, notes: list[str]) -> Surface:
    cells = np.round(surface.points / COINCIDENT).astype(np.int64)
    _, first, group = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    merged = first[group.reshape(-1)]
    triangles = merged[surface.triangles]
    moved = np.unique(surface.triangles[triangles != surface.triangles])
    if len(moved) == 0:
        return surface
    notes.append(
        f"{len(moved)} points coincided with others and were merged, the first at {_place(surface, moved[0])}."
    )
    return surface.with_triangles(triangles)


def _drop_bad_triangles(surface: Surface, notes: list[str]) -> Surface:
    corners = np.sort(surface.triangles, axis=1)
    bad = (corners[:, 1:] == corners[:, :-1]).any(axis=1)
    _, first = np.unique(corners, axis=0, return_index=True)
    double = np.ones(len(corners), bool)
    double[first] = False
    bad |= double
    if not bad.any():
        return surface
    at = int(surface.triangles[np.flatnonzero(bad)[0], 0])
    notes.append(
        f"{np.count_nonzero(bad)} triangles without area, or there twice, were removed, the first at "
        f"{_place(surface, at)}."
    )
    return surface.submesh(~bad)[0]


def _drop_fins(surface: Surface, notes: list[str]) -> Surface:
    """At edges of more than two triangles, drop the smallest sheets until two are left."""
    most = TINY_AREA * surface.area
    while (surface.edges.usage > 2).any():
        sheet = topology.triangle_components(surface.triangles, surface.edges)
        area = np.bincount(sheet, surface.triangle_areas)
        crowded = np.flatnonzero(surface.edges.usage > 2)
        at_edge = np.isin(surface.edges.of_triangle, crowded).any(axis=1)
        candidates = np.unique(sheet[at_edge])
        smallest = candidates[area[candidates].argmin()]
        at = int(surface.edges.points[crowded[0], 0])
        if area[smallest] > most or len(candidates) == 1:
            raise SurfaceError(
                f"More than two triangles share an edge at {_place(surface, at)}, and none of the sheets there is "
                "small enough to be dropped. Rebuild the surface from its segmentation."
            )
        notes.append(f"A fin of {area[smallest]:.2g} mm2 was removed at {_place(surface, at)}.")
        surface = surface.submesh(sheet != smallest)[0]
    return surface


def _drop_components(surface: Surface, notes: list[str]) -> Surface:
    if surface.component_count == 1:
        return surface
    area = np.bincount(surface.components, surface.triangle_areas)
    keep = int(area.argmax())
    others = np.flatnonzero(np.arange(len(area)) != keep)
    for number in others:
        point = int(surface.triangles[surface.components == number][0, 0])
        if area[number] > TINY_AREA * area.sum():
            raise SurfaceError(
                f"The surface has a second piece of {area[number] / 100:.2g} cm2 at {_place(surface, point)}, too "
                "large to be dropped. Keep the piece that is the left atrium."
            )
        notes.append(f"A separate piece of {area[number]:.2g} mm2 was removed at {_place(surface, point)}.")
    return surface.submesh(surface.components == keep)[0]


def _split_points(surface: Surface, notes: list[str]) -> Surface:
    """Where several fans of triangles meet in a point, all but the largest get a point of their own."""
    bad = surface.non_manifold_points
    if len(bad) == 0:
        return surface
    triangles = surface.triangles.copy()
    sources: list[int] = []
    for point in bad.tolist():
        round_it = np.flatnonzero((surface.triangles == point).any(axis=1))
        shared = surface.triangles[round_it]
        meets = np.array([[len(np.intersect1d(a, b)) >= 2 for b in shared] for a in shared])
        count, fan = connected_components(sparse.csr_matrix(meets), directed=False)
        largest = int(np.bincount(fan).argmax())
        for number in range(count):
            if number != largest:
                rows = round_it[fan == number]
                triangles[rows] = np.where(
                    surface.triangles[rows] == point, len(surface.points) + len(sources), triangles[rows]
                )
                sources.append(point)
        notes.append(f"{count} sheets that touched in a point were parted at {_place(surface, point)}.")
    ids = np.concatenate([np.arange(len(surface.points)), np.array(sources, np.int64)])
    split = Surface(
        surface.points[ids],
        triangles,
        {name: values[ids] for name, values in surface.point_data.items()},
        surface.cell_data,
        surface.field_data,
        surface.space,
    )
    if not split.is_manifold:
        raise SurfaceError(
            f"The surface is not a clean sheet at {_place(split, int(split.non_manifold_points[0]))} and cannot be "
            "mended there. Rebuild it from its segmentation."
        )
    # Parting sheets can leave a small one on its own.
    return _drop_components(split, notes)


def _flatten_spikes(surface: Surface, notes: list[str]) -> Surface:
    n = len(surface.points)
    a, b = surface.edges.points.T
    ones = np.ones(len(a))
    adjacency = sparse.coo_matrix((ones, (a, b)), shape=(n, n)).tocsr()
    adjacency = adjacency + adjacency.T
    degree = np.maximum(np.asarray(adjacency.sum(axis=1)).reshape(-1), 1.0)
    points = surface.points
    middle = (adjacency @ points) / degree[:, None]
    spread = (adjacency @ (points**2).sum(axis=1)) / degree - (middle**2).sum(axis=1)
    radius = np.sqrt(np.maximum(spread, 0.0))
    spike = surface.used_points & (np.linalg.norm(points - middle, axis=1) > SPIKE * radius)
    # A rim has neighbours on one side only.
    for loop in surface.boundary_loops:
        spike[loop] = False
    ids = np.flatnonzero(spike)
    if len(ids) == 0:
        return surface
    moved = points.copy()
    moved[ids] = middle[ids]
    if (operators.triangle_areas(moved, surface.triangles) <= 0.0).any():
        raise SurfaceError(f"A spike at {_place(surface, int(ids[0]))} cannot be flattened. Smooth the surface there.")
    notes.append(f"{len(ids)} spikes were flattened, the first at {_place(surface, int(ids[0]))}.")
    return Surface(moved, surface.triangles, surface.point_data, surface.cell_data, surface.field_data, surface.space)


def _close_pinholes(surface: Surface, notes: list[str]) -> Surface:
    pinholes = [loop for loop in surface.boundary_loops if surface.loop_length(loop) < PINHOLE_PERIMETER]
    if not pinholes:
        return surface
    closed, _ = close_rims(surface, pinholes)
    for loop in pinholes:
        notes.append(
            f"A pinhole with a rim of {surface.loop_length(loop):.1f} mm was closed at {_place(surface, int(loop[0]))}."
        )
    # It is wall again, no opening with a cover.
    data = dict(closed.point_data)
    marks = data.pop(HOLE_ARRAY)
    if HOLE_ARRAY in surface.point_data:
        marks[len(surface.points) :] = 0
        data[HOLE_ARRAY] = marks
    return Surface(closed.points, closed.triangles, data, closed.cell_data, closed.field_data, closed.space)
