"""Healing a mesh: faults of its making are removed, the anatomy is left as it is.

Handles are no faults of the mesh; see `handles`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..errors import SurfaceError
from ..progress import ProgressCallback, report
from ..surface import FloatArray, IntArray, Surface
from .sheets import flaps, separate_sheets, turned_alike
from .slivers import collapse_needles, flatten_spikes, flip_flat
from .wall import patch_wall, place_text

MERGE_MM = 1e-3
"""Points closer than this are one: far below any voxel, far above the rounding of coordinates in a file."""

PINHOLE_MM = 12.5
"""A rim no longer than this is a hole in the wall: it is as long as a circle 4 mm wide, narrower than pulmonary veins
that are told apart in images, and than any other opening of an atrium."""

SECOND_SHARE = 0.2
"""A second piece with more than this share of the area of the first is no debris."""

PLACES = 3
"""Places that a note names."""


def heal(surface: Surface, progress: ProgressCallback | None = None) -> tuple[Surface, tuple[str, ...]]:
    """Remove the faults of a mesh that would stop later steps.

    In this order: points within `MERGE_MM` are merged; duplicate triangles and those with a point twice are dropped;
    pieces of less than `SECOND_SHARE` of the largest one's area are dropped; single triangles that hang on an edge of
    two others are dropped; triangles are turned alike; sheets that touch in points or edges are taken apart
    (`sheets.separate_sheets`: each keeps its triangles, which changes less than dropping one); ends of needles are
    joined, flat triangles flipped, tips of spikes moved back (`slivers`); rims up to `PINHOLE_MM` long are covered.
    This is repeated until nothing is left to do, because one repair may uncover another.

    Returns
    -------
    surface : one manifold piece, with the point and cell arrays of the parts that stayed, and unused points gone; the
        same object if nothing was wrong. It may still have handles and openings.
    notes : what was changed, a sentence for each kind of fault, with places in mm.

    Raises
    ------
    SurfaceError : a second large piece, or a fault that cannot be healed, with its place.
    Cancelled : the callback returned False.

    Examples
    --------
    >>> from LAFlatteningLib.phantom import make_phantom
    >>> surface = make_phantom(500).surface
    >>> heal(surface)[0] is surface
    True
    """
    given = surface
    notes: dict[str, list[FloatArray]] = {}
    for turn in range(PASSES):
        before = surface
        for number, (text, step) in enumerate(STEPS):
            report(progress, (turn + number / len(STEPS)) / PASSES, "Healing the surface")
            surface, places = step(surface)
            if len(places):
                notes.setdefault(text, []).extend(places)
        if surface is before:
            break
    if surface is not given:
        surface, _ = surface.submesh(np.ones(len(surface.triangles), bool))
    _check(surface)
    report(progress, 1.0, "Surface healed")
    return surface, tuple(_sentence(text, places) for text, places in notes.items())


def _sentence(text: str, places: list[FloatArray]) -> str:
    """A note with the number of places and the first of them."""
    named = ", ".join(place_text(place) for place in places[:PLACES])
    more = f" and {len(places) - PLACES} more" if len(places) > PLACES else ""
    return f"{text}: {len(places)}, at {named}{more}."


def _check(surface: Surface) -> None:
    bad = surface.non_manifold_points
    if len(bad):
        raise SurfaceError(
            f"The surface is not a clean sheet at {len(bad)} points that cannot be healed (the first at "
            f"{place_text(surface.points[bad[0]])}). Rebuild it from its segmentation, or remesh it."
        )
    if surface.component_count > 1:
        _largest_piece(surface)


Healed = tuple[Surface, FloatArray]
"""What a step returns: the surface, the same object if nothing was wrong, and the places of changes, (k, 3) mm."""

NOWHERE = np.zeros((0, 3))


def _merge(surface: Surface) -> Healed:
    """Points at the same place are one."""
    pairs = cKDTree(surface.points).query_pairs(MERGE_MM, output_type="ndarray")
    pairs = pairs[surface.used_points[pairs].all(axis=1)]
    if len(pairs) == 0:
        return surface, NOWHERE
    n = len(surface.points)
    graph = sparse.coo_matrix((np.ones(len(pairs), np.int8), tuple(pairs.T)), shape=(n, n))
    label = connected_components(graph, directed=False)[1]
    _, first = np.unique(label, return_index=True)
    target = first[label]
    moved = target != np.arange(n)
    return _without_degenerate(surface.with_triangles(target[surface.triangles])), surface.points[moved]


def _without_degenerate(surface: Surface) -> Surface:
    """Without triangles that have a point twice."""
    triangles = surface.triangles
    whole = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    return surface if whole.all() else _keep(surface, whole)


def _keep(surface: Surface, keep: IntArray) -> Surface:
    """Some of the triangles, all points."""
    return replace(
        surface,
        triangles=surface.triangles[keep],
        cell_data={name: values[keep] for name, values in surface.cell_data.items()},
    )


def _degenerate(surface: Surface) -> Healed:
    healed = _without_degenerate(surface)
    if healed is surface:
        return surface, NOWHERE
    triangles = surface.triangles
    twice = (triangles == np.roll(triangles, 1, axis=1)).any(axis=1)
    return healed, surface.points[triangles[twice, 0]]


def _duplicates(surface: Surface) -> Healed:
    """Of triangles with the same three points one stays; none if the surface goes on without it.

    Two that face each other on top of a surface that is whole are a blister without content.
    """
    ids, inverse, times = np.unique(np.sort(surface.triangles, axis=1), axis=0, return_inverse=True, return_counts=True)
    if (times == 1).all():
        return surface, NOWHERE
    inverse = inverse.reshape(-1)
    keep = np.ones(len(surface.triangles), bool)
    usage = surface.edges.usage[surface.edges.of_triangle]
    for group in np.flatnonzero(times > 1).tolist():
        same = np.flatnonzero(inverse == group)
        keep[same] = False
        # Triangles beyond each edge; two is a whole surface without these.
        if (usage[same[0]] - len(same) < 2).any():
            keep[same[0]] = True
    return _keep(surface, keep), surface.points[ids[times > 1]].mean(axis=1)


def _largest_piece(surface: Surface) -> Healed:
    """The piece with the largest area."""
    if surface.component_count == 1:
        return surface, NOWHERE
    area = np.bincount(surface.components, surface.triangle_areas)
    order = np.argsort(-area, kind="stable")
    centres = surface.points[surface.triangles].mean(axis=1)
    places = np.array([centres[surface.components == piece].mean(axis=0) for piece in order[1:]])
    if area[order[1]] > SECOND_SHARE * area[order[0]]:
        raise SurfaceError(
            f"The surface has {len(area)} separate pieces; the second, at {place_text(places[0])}, has an area of "
            f"{area[order[1]]:.0f} mm2 beside {area[order[0]]:.0f} mm2 of the largest. Expected one atrium, with small "
            f"debris at most ({SECOND_SHARE:.0%}). Keep the right piece, or join them in the segmentation."
        )
    return _keep(surface, surface.components == order[0]), places


def _flaps(surface: Surface) -> Healed:
    hanging = flaps(surface)
    if len(hanging) == 0:
        return surface, NOWHERE
    keep = np.ones(len(surface.triangles), bool)
    keep[hanging] = False
    return _keep(surface, keep), surface.points[surface.triangles[hanging]].mean(axis=1)


def _turned(surface: Surface) -> Healed:
    turned = turned_alike(surface)
    changed = (turned.triangles != surface.triangles).any(axis=1)
    return turned, surface.points[surface.triangles[changed]].mean(axis=1)


def _sheets(surface: Surface) -> Healed:
    if surface.is_manifold:
        return surface, NOWHERE
    # Of the two ways to divide an edge, the wrong one leaves its points joined.
    ways = [separate_sheets(surface, keep_lumen) for keep_lumen in (True, False)]
    healed, divided = min(ways, key=lambda way: len(way[0].non_manifold_points))
    return (healed, surface.points[divided]) if len(divided) else (surface, NOWHERE)


def _needles(surface: Surface) -> Healed:
    healed, joined = collapse_needles(surface)
    return healed, surface.points[joined]


def _pinholes(surface: Surface) -> Healed:
    if not surface.is_manifold:
        return surface, NOWHERE
    small = [rim for rim in surface.boundary_loops if surface.loop_length(rim) <= PINHOLE_MM]
    if not small:
        return surface, NOWHERE
    return patch_wall(surface, small), np.array([surface.points[rim].mean(axis=0) for rim in small])


STEPS: tuple[tuple[str, Callable[[Surface], Healed]], ...] = (
    (f"Points within {MERGE_MM:g} mm of another were merged with it", _merge),
    ("Triangles with a point twice were dropped", _degenerate),
    ("Duplicate triangles were dropped", _duplicates),
    ("Small separate pieces were dropped", _largest_piece),
    ("Triangles that hung on an edge of two others were dropped", _flaps),
    ("Triangles were turned as their neighbours are", _turned),
    ("Points where sheets touched were divided", _sheets),
    ("Ends of needles were joined", _needles),
    ("Flat triangles were turned", flip_flat),
    ("Tips of spikes were moved back", flatten_spikes),
    (f"Pinholes (rims up to {PINHOLE_MM:g} mm long) were closed", _pinholes),
)

PASSES = 5
"""At most so many rounds of all steps."""
