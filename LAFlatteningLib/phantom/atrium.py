"""A synthetic left atrium with known answers: a mesh at any resolution, seeds, paths, regions, scar and LGE.

`PhantomShape` is the analytic shape and says why the answers are exact, `make_phantom` meshes it, and
`LAFlatteningLib.phantom.make_lge_volume` images it.

Proportions
-----------
Perimeters are the means of Nunez-Garcia et al., appendix B. Distances between rims along the surface, mm:

===========  ===========  =======
between      mean (SD)    phantom
===========  ===========  =======
LSPV - LIPV  14.8 (3.3)   14.8
RSPV - RIPV  17.0 (5.6)   17.0
RSPV - LSPV  57.7 (8.6)   50.3
RIPV - LIPV  58.9 (7.2)   51.0
LSPV - LAA   23.9 (8.0)   23.9
===========  ===========  =======

Right and left veins are nearer to each other than the mean, since a real atrium is wider than a sphere that leaves the
other distances right.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from .. import operators
from ..errors import LAFlatteningError
from ..surface import Surface
from .lge import Gap, ScarPatch, ScarPattern, ScarRing
from .shape import PhantomShape, Tube, Valve
from .sphere import GOLDEN_ANGLE, angles_between, fibonacci_sphere, tangent_frame

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SMALLEST, LARGEST = 500, 1_000_000
"""Numbers of points that can be asked for."""
GRAIN = 0.3
"""How far points are shaken off their spirals before they are evened out, in edge lengths. Spirals alone make a
lattice, along which edge paths stray by up to 12 mm from shortest paths; real, remeshed atria have no such grain."""
ROUNDS, STEPS = 2, 6
"""How often a mesh is triangulated anew while its points are evened out, and steps of evening out each time."""

DEFAULT_SCAR = ScarPattern(
    rings=(
        ScarRing(("LSPV", "LIPV"), 4.0, 8.0, (Gap(50.0, 5.0), Gap(215.0, 3.0))),
        ScarRing(("RSPV",), 1.0, 4.0, (Gap(300.0, 8.0),)),
        ScarRing(("RIPV",), 1.0, 4.0),
    ),
    patches=(ScarPatch(-8.0, 2.0, 8.0),),
)
"""A joint line round the left veins with gaps of 5 and 3 mm, one round the right superior vein with a gap of 8 mm, a
complete one round the right inferior vein, and a patch of 200 mm2 on the posterior wall."""


def left_atrium_shape(
    vein_length: float = 15.0, appendage_length: float = 20.0, scar: ScarPattern = DEFAULT_SCAR
) -> PhantomShape:
    """The standard phantom.

    Parameters
    ----------
    vein_length, appendage_length : from the rims to the tips of the closed atrium, mm. At least the tubes' radii.
    scar : see `ScarPattern`.
    """
    for what, value in (("vein_length", vein_length), ("appendage_length", appendage_length)):
        if not (np.isfinite(value) and 0.0 < value <= 200.0):
            raise LAFlatteningError(f"Expected a {what} between 0 and 200 mm, found {value}.")
    tubes = {
        "RSPV": Tube(-76.5, 30.0, 50.47, vein_length),
        "RIPV": Tube(-68.5, -24.4, 44.49, vein_length),
        "LIPV": Tube(69.5, -24.8, 38.73, vein_length),
        "LSPV": Tube(68.0, 21.7, 43.06, vein_length),
        "LAA": Tube(143.2, 22.6, 54.30, appendage_length),
    }
    valve = Valve(163.0, -47.0, 120.0, {"MV1": 85.0, "MV2": 137.0, "MV3": 253.0, "MV4": 336.0})
    return PhantomShape(30.0, (12.0, -35.0, 80.0), tubes, valve, scar)


@dataclass(frozen=True, eq=False)
class Phantom:
    """A meshed phantom and its truth.

    Attributes
    ----------
    surface : open (six rims) or closed, outward, LPS, mm. Point arrays ``LGE`` (float64, largest intensity within 3 mm
        along the normal, `PhantomShape.lge`) and ``scar`` (uint8, `PhantomShape.scar`); cell array ``true_region``
        (uint8, region of the centroid; 0 beyond the rims of a closed phantom).
    seeds : label -> (3,) mm. Veins and appendage: centre of the ostium, in the plane of the rim. MV: on the rim.
    true_paths : path -> (k, 3) mm, from seed to seed over flat covers, see `PhantomShape.path`.
    tips : opening -> (3,) mm, the tip of each vein and the appendage; empty for an open phantom.
    shape : the analytic shape.
    closed : whether veins, appendage and valve are closed.
    """

    surface: Surface
    seeds: dict[str, FloatArray]
    true_paths: dict[str, FloatArray]
    tips: dict[str, FloatArray]
    shape: PhantomShape = field(repr=False)
    closed: bool


def make_phantom(
    points: int = 20000,
    *,
    closed: bool = False,
    vein_length: float = 15.0,
    appendage_length: float = 20.0,
    scar: ScarPattern = DEFAULT_SCAR,
) -> Phantom:
    """The standard phantom, meshed.

    Parameters
    ----------
    points : number of points of the mesh, 500 to 1,000,000; the mesh has exactly so many.
    closed : False for the cavity that is flattened: veins and appendage cut at their rims, valve open. True for the
        atrium as it is segmented: long veins and appendage with round tips, valve closed by a plane.
    vein_length, appendage_length, scar : see `left_atrium_shape`. The lengths concern closed phantoms only.

    Raises
    ------
    LAFlatteningError : too few or too many points, lengths or scar out of range.

    Examples
    --------
    >>> phantom = make_phantom(1000)
    >>> len(phantom.surface.points), len(phantom.surface.boundary_loops), phantom.surface.genus
    (1000, 6, 0)
    """
    return mesh_phantom(left_atrium_shape(vein_length, appendage_length, scar), points, closed=closed)


def mesh_phantom(shape: PhantomShape, points: int, *, closed: bool = False) -> Phantom:
    """A phantom of any shape; see `make_phantom`."""
    if not (isinstance(points, int | np.integer) and SMALLEST <= points <= LARGEST):
        raise LAFlatteningError(
            f"Expected a whole number of points from {SMALLEST} to {LARGEST}, found {points}. "
            "Fewer cannot show the veins, more are finer than any image."
        )
    positions, triangles = _mesh(shape, int(points), closed)
    centroids = positions[triangles].mean(axis=1)
    if closed:
        region = shape.region_of(centroids)
    else:
        region = shape.division.region_of(centroids - np.array(shape.centre))
    surface = Surface(
        positions,
        triangles,
        {"LGE": shape.lge(positions), "scar": shape.scar(positions).astype(np.uint8)},
        {"true_region": region.astype(np.uint8)},
    )
    paths = {name: shape.path(name) for name in shape.anatomy.paths}
    return Phantom(surface, shape.seeds, paths, shape.tips if closed else {}, shape, closed)


# ---- meshing -----------------------------------------------------------------------------------------------------
# Points are spread evenly: on the rims at equal angles, elsewhere along Fibonacci spirals, which exist on any surface
# of revolution, then shaken and evened out. They are triangulated as the convex hull of their conformal images on the
# unit sphere: that is the Delaunay triangulation there, and as angles are kept, nearly the one of the surface.


def _mesh(shape: PhantomShape, count: int, closed: bool) -> tuple[FloatArray, IntArray]:
    """Points (count, 3) exactly on the surface and triangles (m, 3), outward; points on the rims come first."""
    each = shape.area(closed) / count
    edge = float(np.sqrt(each * 2.0 / np.sqrt(3.0)))
    rims = np.zeros((0, 3)) if closed else _rim_points(shape, edge)
    free = _spread(shape, count - len(rims), edge, closed)
    free += np.random.default_rng(count).uniform(-GRAIN * edge, GRAIN * edge, free.shape)
    positions = np.concatenate([rims, shape.closest_points(free)])
    # One auxiliary point in the middle of each hole; its triangles are the hole.
    holes = np.zeros((0, 3)) if closed else np.array(list(shape.caps.axes.values()))
    for _ in range(ROUNDS):
        triangles = _triangulate(shape, positions, holes)
        for _ in range(STEPS):
            moved = _even_out(positions, triangles)
            positions[len(rims) :] = shape.closest_points(moved[len(rims) :])
    return positions, _triangulate(shape, positions, holes)


def _around(shape: PhantomShape, name: str, rho: FloatArray | float, z: FloatArray, turn: FloatArray) -> FloatArray:
    """Points (n, 3) of space from cylindrical coordinates about the axis of an opening."""
    axis = shape.openings[name].axis
    first, second = tangent_frame(axis)
    flat = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
    return np.array(shape.centre) + np.reshape(rho, (-1, 1)) * flat + z[:, None] * axis


def _rim_points(shape: PhantomShape, edge: float) -> FloatArray:
    """Points at equal angles on all rims, about `edge` apart, starting at angles unrelated to the paths."""
    rims = []
    for number, (name, opening) in enumerate(shape.openings.items()):
        rho, z = opening.rim
        count = max(8, round(2.0 * np.pi * rho / edge))
        turn = (np.arange(count) + 0.37 + 0.23 * number) * 2.0 * np.pi / count
        rims.append(_around(shape, name, rho, np.full(count, z), turn))
    return np.concatenate(rims)


def _spread(shape: PhantomShape, count: int, edge: float, closed: bool) -> FloatArray:
    """Evenly spread points (count, 3) of the surface, off the rims."""
    each = edge**2 * np.sqrt(3.0) / 2.0
    # Points on a rim already take the strip next to it.
    strip = 0.0 if closed else 0.25 * np.sqrt(3.0) * edge
    pieces = []
    for name, opening in shape.openings.items():
        if name not in shape.tubes and not closed:
            continue
        rho, z = opening.profile.T
        area = np.concatenate([[0.0], np.cumsum(np.pi * (rho[1:] + rho[:-1]) * np.hypot(np.diff(rho), np.diff(z)))])
        whole = area[-1] if closed else np.interp(opening.rim[1] - strip, z, area)
        share = max(1, round(whole / each))
        at = np.interp((np.arange(share) + 0.5) * whole / share, area, np.arange(len(area)))
        rows = np.arange(len(area))
        pieces.append(
            _around(
                shape, name, np.interp(at, rows, rho), np.interp(at, rows, z), np.arange(share) * GOLDEN_ANGLE + share
            )
        )
    needed = count - sum(len(piece) for piece in pieces)
    total = round(4.0 * np.pi * shape.radius**2 / each)
    while True:
        body = fibonacci_sphere(total)
        margin = np.full(total, np.inf)
        for name, opening in shape.openings.items():
            past_rim = shape.caps.distance(name, body) - (0.0 if name in shape.tubes else strip)
            past_contact = shape.radius * (angles_between(body, opening.axis) - opening.contact)
            margin = np.minimum(margin, past_contact if closed else past_rim)
        surplus = np.count_nonzero(margin > 0.0) - needed
        if 0 <= surplus <= 8:
            break
        total -= surplus - 2
    # The few too many are those nearest to an edge, where spirals meet.
    chosen = np.argsort(margin)[total - needed :]
    return np.concatenate([*pieces, np.array(shape.centre) + shape.radius * body[np.sort(chosen)]])


def _triangulate(shape: PhantomShape, positions: FloatArray, holes: FloatArray) -> IntArray:
    images = np.concatenate([shape.conformal(positions), holes])
    triangles = ConvexHull(images).simplices.astype(np.int64)
    triangles = triangles[(triangles < len(positions)).all(axis=1)]
    a, b, c = (images[triangles[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", a, np.cross(b, c)) < 0.0
    triangles[inward] = triangles[inward][:, ::-1]
    return triangles


def _even_out(positions: FloatArray, triangles: IntArray) -> FloatArray:
    """Points moved to the mean of the centroids of their triangles, weighted by area (Chen and Holst 2011)."""
    area = operators.triangle_areas(positions, triangles)
    centroid = positions[triangles].mean(axis=1) * area[:, None]
    corner = triangles.reshape(-1)
    total = np.bincount(corner, np.repeat(area, 3), minlength=len(positions))
    moments = [np.bincount(corner, np.repeat(centroid[:, k], 3), minlength=len(positions)) for k in range(3)]
    return np.stack(moments, axis=1) / total[:, None]
