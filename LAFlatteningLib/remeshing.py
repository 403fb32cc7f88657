"""Uniform remeshing: the same surface with about equal triangles, as many as wanted, and the data on it.

The aim is that of Valette, Chassery and Prost 2008: points spread so that the part of the surface nearest to each has
the least moment of inertia (a centroidal Voronoi tessellation), joined by its dual, a Delaunay triangulation. It is
reached by changes that keep the surface what it is (`mesh_edits`): no vein can be welded to its neighbour and no handle
can appear, however close two walls are. Each result is checked all the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from . import mesh_edits, operators, topology
from .carrying import Closest, carry, closest_points, interpolate
from .clusters import contract_clusters
from .creases import SHARP_COSINE, crease_samples, sharpened
from .errors import SurfaceError
from .mesh_edits import WorkMesh, norms
from .progress import ProgressCallback, part, report
from .rim_points import Rim
from .surface import Array, FloatArray, Surface

DEFAULT_POINTS = 20_000
FEWEST, MOST = 100, 2_000_000
"""Numbers of points that can be asked for."""
SHORT, LONG = 0.8, 4.0 / 3.0
"""Edges shorter or longer than this, in wanted lengths, are collapsed or split (Botsch and Kobbelt 2004)."""
MANY = 0.5
"""Where a larger share of the edges is too short, whole clusters are contracted."""
ROUNDS = 2
"""Rounds of splitting, collapsing, flipping and evening out."""
LAST_ROUNDS = 3
"""Rounds of flipping and evening out once the number of points is right."""
THIN_DEGREES = 15.0
"""Triangles with a smaller angle are removed at last, if there are any."""
OTHER_WALL = -0.5
"""Where normals differ by more than the angle with this cosine (120 degrees), a place is on another wall."""
FARTHEST_STEP = 0.5
"""A point moves at most so many wanted edge lengths in a round."""


@dataclass(frozen=True, eq=False)
class Remeshed:
    """A surface after remeshing, and the way back.

    Attributes
    ----------
    surface : the new mesh, with the arrays of the old one.
    source : the old mesh.
    notes : what was left out, for the user.
    """

    surface: Surface
    source: Surface
    notes: tuple[str, ...] = ()

    @cached_property
    def _back(self) -> Closest:
        return closest_points(self.surface, self.source.points)

    @cached_property
    def _there(self) -> Closest:
        return closest_points(self.source, self.surface.points)

    def to_source(self, values: Array) -> Array:
        """Values at the points of the new mesh, (n,) or (n, c), at the points of the old one.

        Measured values are interpolated, labels taken from the nearest corner (`carrying.interpolate`).

        Raises
        ------
        SurfaceError : another number of values than the new mesh has points.
        """
        values = np.asarray(values)
        if len(values) != len(self.surface.points):
            raise SurfaceError(
                f"Expected a value for each of the {len(self.surface.points)} points of the remeshed surface, found "
                f"{len(values)} values."
            )
        return interpolate(values, self.surface.triangles[self._back.triangle], self._back.weights)

    @cached_property
    def distance_mm(self) -> dict[str, float]:
        """How far the new mesh is from the old: ``p95`` and ``max`` over the points and triangle centres of the new
        mesh and the points of the old, each to the other mesh, mm."""
        centres = self.surface.points[self.surface.triangles].mean(axis=1)
        distance = np.concatenate(
            [self._there.distance_mm, closest_points(self.source, centres).distance_mm, self._back.distance_mm]
        )
        return {"p95": float(np.percentile(distance, 95)), "max": float(distance.max())}

    @cached_property
    def quality(self) -> dict[str, float]:
        """How even the new mesh is: ``smallest_angle_degrees``, ``p1_angle_degrees`` (over all corners; 60 is even),
        ``edge_mean_mm`` and ``edge_spread`` (standard deviation of edge lengths over their mean)."""
        angles = np.degrees(np.arctan2(1.0, operators.cotangents(self.surface.points, self.surface.triangles)))
        lengths = self.surface.edge_lengths
        return {
            "smallest_angle_degrees": float(angles.min()),
            "p1_angle_degrees": float(np.percentile(angles, 1)),
            "edge_mean_mm": float(lengths.mean()),
            "edge_spread": float(lengths.std() / lengths.mean()),
        }


def remesh(
    surface: Surface,
    points: int | None = None,
    edge_length_mm: float | None = None,
    progress: ProgressCallback | None = None,
) -> Remeshed:
    """Mesh a surface anew with about equal triangles.

    Parameters
    ----------
    surface : an oriented manifold in one piece, closed or open, of any genus.
    points : how many points the new mesh gets (100 to 2,000,000); 20,000 if neither is given. More than the surface
        has is fine.
    edge_length_mm : instead of `points`, the mean length of an edge, mm.

    Returns
    -------
    Remeshed, whose surface has the wanted number of points, on the old surface; points on rims lie on the old rims. It
    has as many handles and rims as the old one, and its triangles face the same way. Point and cell arrays are carried
    over (`carrying.carry`), field arrays are kept.

    Raises
    ------
    SurfaceError : numbers out of range, a surface of another kind, or no mesh of that size that keeps its shape.
    Cancelled : the progress callback asked to stop.

    Examples
    --------
    >>> from LAFlatteningLib.phantom import make_phantom
    >>> remeshed = remesh(make_phantom(3000).surface, points=2000)
    >>> len(remeshed.surface.points), len(remeshed.surface.boundary_loops)
    (2000, 6)
    """
    source, surface = surface, _checked(surface)
    wanted = _wanted_points(surface, points, edge_length_mm)
    length = _even_length(surface, wanted)
    mesh = work_mesh(surface)
    rims = [Rim.of(surface.points[loop], length) for loop in surface.boundary_loops]
    creases = crease_samples(surface, length)
    bent = SHARP_COSINE if len(creases[0]) else -1.0
    for k in range(ROUNDS):
        share = 0.1 + 0.5 * k / ROUNDS
        report(progress, share, "Evening out the triangles")
        _split_long(mesh, LONG * length, wanted)
        _collapse_short(mesh, SHORT * length, LONG * length, part(progress, share, share))
        _flip(mesh, bent)
        _even_out(mesh, rims, length)
        _flip(mesh, bent)
        _sharpen(mesh, creases, length)
        if k == 1:
            _put_on(mesh, surface, creases, length)
    report(progress, 0.6, "Fitting the number of points")
    _fit_number(mesh, wanted, bent)
    for k in range(LAST_ROUNDS):
        report(progress, 0.7 + 0.05 * k, "Evening out the triangles")
        _flip(mesh, bent)
        _even_out(mesh, rims, length)
        _sharpen(mesh, creases, length)
    _put_on(mesh, surface, creases, length)
    _flip(mesh, bent, times=8)
    if _remove_thin(mesh, wanted, bent, length):
        _even_out(mesh, rims, length)
        _put_on(mesh, surface, creases, length)
        _flip(mesh, bent, times=8)
    report(progress, 0.9, "Carrying the data over")
    made = Surface(mesh.points, mesh.triangles, space=surface.space)
    _check_kept(surface, made, wanted)
    carried = carry(replace(surface, cell_data={}), made.points)
    notes = carried.notes
    made = made.with_data(carried.point_data, field_data=surface.field_data)
    if surface.cell_data:
        centres = carry(replace(surface, point_data={}), made.points[made.triangles].mean(axis=1))
        made, notes = made.with_data(cell_data=centres.cell_data), notes + centres.notes
    return Remeshed(made, source, notes)


def _checked(surface: Surface) -> Surface:
    """The surface without unused points, if it can be remeshed."""
    if not surface.used_points.all():
        surface, _ = surface.submesh(np.ones(len(surface.triangles), bool))
    bad = surface.non_manifold_points
    if len(bad):
        place = ", ".join(f"{x:.1f}" for x in surface.points[bad[0]])
        raise SurfaceError(
            f"The surface is not a clean sheet at {len(bad)} points (the first is point {bad[0]} at {place} mm): more "
            "than two triangles share an edge, or two sheets touch in a point. Repair it before it is remeshed."
        )
    if surface.component_count > 1:
        raise SurfaceError(
            f"The surface has {surface.component_count} separate pieces; expected one. Keep the largest piece, or "
            "remesh each by itself."
        )
    if not surface.is_oriented:
        surface = surface.with_triangles(topology.orient(surface.triangles, surface.edges))
    return surface


def _wanted_points(surface: Surface, points: int | None, edge_length_mm: float | None) -> int:
    if points is not None and edge_length_mm is not None:
        raise SurfaceError("Expected a number of points or an edge length, found both. Give one of them.")
    if edge_length_mm is None:
        wanted = DEFAULT_POINTS if points is None else int(points)
        what = f"{wanted} points"
    elif not np.isfinite(edge_length_mm) or edge_length_mm <= 0:
        raise SurfaceError(f"Expected an edge length above 0 mm, found {edge_length_mm:g} mm.")
    else:
        share = float(edge_length_mm) ** 2 * np.sqrt(3.0) / 2.0
        rim = sum(surface.loop_length(loop) for loop in surface.boundary_loops)
        # Before it is made an integer, it may be beyond all bounds.
        wanted = round(min(surface.area / share + 0.5 * rim / edge_length_mm, 1e12))
        what = f"{wanted} points, which an edge length of {edge_length_mm:g} mm makes"
    if not FEWEST <= wanted <= MOST:
        raise SurfaceError(f"Expected {FEWEST} to {MOST} points, found {what}. Choose another number.")
    return wanted


def _even_length(surface: Surface, points: int) -> float:
    """Edge length at which equilateral triangles with so many points cover the surface, mm."""
    rim = sum(surface.loop_length(loop) for loop in surface.boundary_loops)
    # points = 2 area / (sqrt(3) length^2) + rim / (2 length), solved for 1 / length.
    a, b = 2.0 * surface.area / np.sqrt(3.0), 0.5 * rim
    return float(2.0 * a / (-b + np.sqrt(b * b + 4.0 * a * points)))


def work_mesh(surface: Surface) -> WorkMesh:
    """A copy of a surface to be changed, with its rims."""
    n = len(surface.points)
    rim, along = np.full(n, -1, np.int64), np.zeros(n)
    lengths = []
    for k, loop in enumerate(surface.boundary_loops):
        steps = np.linalg.norm(surface.points[np.roll(loop, -1)] - surface.points[loop], axis=1)
        rim[loop] = k
        along[loop] = np.concatenate([[0.0], np.cumsum(steps)[:-1]])
        lengths.append(steps.sum())
    return WorkMesh(surface.points.copy(), surface.triangles.copy(), rim, along, np.array(lengths))


def _split_long(mesh: WorkMesh, longest: float, wanted: int) -> None:
    """Split edges until none is too long, if there are not far too many points already."""
    for _ in range(12):
        lengths = mesh.edge_lengths()
        chosen = lengths > longest
        if not chosen.any() or len(mesh.points) > 3 * wanted + 1000:
            return
        mesh_edits.split_edges(mesh, chosen)


def _collapse_short(mesh: WorkMesh, shortest: float, longest: float, progress: ProgressCallback | None) -> None:
    while np.mean(mesh.edge_lengths() < shortest) > MANY:
        report(progress, 0.0, "Thinning out the points")
        if contract_clusters(mesh, shortest) < 0.1 * len(mesh.points):
            break
    for _ in range(60):
        removed = mesh_edits.collapse_edges(mesh, mesh.edge_lengths() < shortest, longest)
        if removed < 1e-3 * len(mesh.points):
            return
        report(progress, 0.0, "Thinning out the points")


def _flip(mesh: WorkMesh, bent: float, times: int = 3) -> None:
    for _ in range(times):
        if mesh_edits.flip_edges(mesh, bent) < 1e-3 * len(mesh.triangles):
            return


def _remove_thin(mesh: WorkMesh, wanted: int, bent: float, length: float) -> bool:
    """Collapse edges of thin triangles, if there are any, and split others instead; whether anything was changed."""
    changed = False
    left = len(mesh.triangles)
    for _ in range(LAST_ROUNDS):
        thin = smallest_angles(mesh) < THIN_DEGREES
        if not 0 < np.count_nonzero(thin) < left:
            break
        left = int(np.count_nonzero(thin))
        chosen = np.zeros(len(mesh.edges.points), bool)
        chosen[mesh.edges.of_triangle[thin]] = True
        if mesh_edits.collapse_edges(mesh, chosen, LONG * length):
            changed = True
            _flip(mesh, bent)
            _fit_number(mesh, wanted, bent)
    return changed


def smallest_angles(mesh: WorkMesh) -> FloatArray:
    """(m,) the smallest angle of each triangle, degrees."""
    return np.degrees(np.arctan2(1.0, operators.cotangents(mesh.points, mesh.triangles).max(axis=1)))


def _even_out(mesh: WorkMesh, rims: list[Rim], length: float) -> None:
    """Move points to the centroids of their surroundings: inside along the surface, on rims along the rim."""
    normals = operators.point_normals(mesh.points, mesh.triangles)
    step = mesh_edits.star_centroids(mesh.points, mesh.triangles) - mesh.points
    step -= np.einsum("ij,ij->i", step, normals)[:, None] * normals
    size = norms(step)
    step *= np.minimum(1.0, FARTHEST_STEP * length / np.where(size > 0, size, 1.0))[:, None]
    step[mesh.rim >= 0] = 0.0
    goal = mesh.points + step
    along = mesh.along.copy()
    if rims:
        for loop in topology.boundary_loops(mesh.triangles, mesh.edges):
            rim = rims[mesh.rim[loop[0]]]
            along[loop] = rim.evened(mesh.along[loop], FARTHEST_STEP * length)
            goal[loop] = rim.positions(along[loop])
    _move(mesh, goal, along)


def _move(mesh: WorkMesh, goal: FloatArray, along: FloatArray) -> None:
    """Move points to their goals, except where that would turn a triangle over."""
    before = operators.area_vectors(mesh.points, mesh.triangles)
    size = norms(before)
    held = np.zeros(len(goal), bool)
    for _ in range(10):
        points = np.where(held[:, None], mesh.points, goal)
        after = operators.area_vectors(points, mesh.triangles)
        new_size = norms(after)
        turned = np.einsum("ij,ij->i", before, after) < 0.5 * size * new_size
        # Thin triangles may get better, but none thinner.
        turned |= new_size < 0.1 * size
        if not turned.any():
            mesh.points = points
            mesh.along = np.where(held, mesh.along, along)
            return
        held[mesh.triangles[turned]] = True


def _sharpen(mesh: WorkMesh, creases: tuple[FloatArray, FloatArray], length: float) -> None:
    """Move inner points onto creases that are near."""
    if len(creases[0]):
        sharp = sharpened(Surface(mesh.points, mesh.triangles), *creases, length)
        _move(mesh, np.where(mesh.rim[:, None] < 0, sharp, mesh.points), mesh.along)


def _put_on(mesh: WorkMesh, surface: Surface, creases: tuple[FloatArray, FloatArray], length: float) -> None:
    """Move inner points onto creases that are near, then all to the closest place on the surface that does not face
    the other way (another wall)."""
    inner = np.flatnonzero(mesh.rim < 0)
    _sharpen(mesh, creases, length)
    normals = operators.point_normals(mesh.points, mesh.triangles)[inner]
    facing = operators.area_vectors(surface.points, surface.triangles)
    facing /= np.maximum(norms(facing), 1e-300)[:, None]
    closest = closest_points(surface, mesh.points[inner])
    goal = mesh.points.copy()
    goal[inner] = closest.positions
    turned = np.einsum("ij,ij->i", normals, facing[closest.triangle]) < OTHER_WALL
    # For those: the closest place on what faces the same way, about; a part of the surface for each octant.
    octant = (normals > 0) @ np.array([4, 2, 1])
    for number in np.unique(octant[turned]):
        axis = np.where([number & 4, number & 2, number & 1], 1.0, -1.0) / np.sqrt(3.0)
        rows = turned & (octant == number)
        keep = facing @ axis > 0.0
        if keep.any():
            goal[inner[rows]] = closest_points(surface.submesh(keep)[0], mesh.points[inner[rows]]).positions
    _move(mesh, goal, mesh.along)


def _fit_number(mesh: WorkMesh, wanted: int, bent: float) -> None:
    """Collapse the shortest or split the longest edges until the number of points is right."""
    for _ in range(200):
        excess = len(mesh.points) - wanted
        if excess == 0:
            return
        lengths = mesh.edge_lengths()
        if excess < 0:
            # Not more than a tenth of the edges at once, so that only long ones are split.
            count = min(-excess, max(1, len(lengths) // 10))
            chosen = np.zeros(len(lengths), bool)
            chosen[np.argpartition(-lengths, count - 1)[:count]] = True
            mesh_edits.split_edges(mesh, chosen)
        else:
            count = min(len(lengths), max(50, 4 * excess))
            chosen = np.zeros(len(lengths), bool)
            chosen[np.argpartition(lengths, count - 1)[:count]] = True
            if not mesh_edits.collapse_edges(mesh, chosen, most=excess) and not mesh_edits.collapse_edges(
                mesh, np.ones(len(lengths), bool), most=excess
            ):
                return
        _flip(mesh, bent)


def _check_kept(before: Surface, after: Surface, wanted: int) -> None:
    """Raise SurfaceError unless the new mesh is the same kind of surface as the old one."""
    kind = (before.genus, len(before.boundary_loops), before.component_count)
    if not after.is_manifold or not after.is_oriented:
        raise SurfaceError(
            f"Remeshing to {wanted} points spoilt the surface: it is no longer one clean sheet. Choose more points."
        )
    made = (after.genus, len(after.boundary_loops), after.component_count)
    if made != kind or abs(len(after.points) - wanted) > 0.01 * wanted:
        raise SurfaceError(
            f"No mesh of {wanted} points was found that keeps the surface what it is ({kind[0]} handles, {kind[1]} "
            f"openings, {kind[2]} piece; found {made[0]}, {made[1]} and {made[2]}, with {len(after.points)} points). "
            "Choose more points."
        )
