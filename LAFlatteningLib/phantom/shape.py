"""The analytic shape of a synthetic left atrium whose seeds, paths, regions and scar are known exactly.

The body is a sphere of radius R about O. Each vein, and the appendage, is a tube: a circular cylinder whose axis
leaves O in the direction d_i, joined to the sphere by a circular fillet. The mitral valve is a plane cut of the sphere.
Seeds are the centres c_i of the ostia (on the axes, in the planes of the rims) and points q_k on the mitral circle.

Why the paths are known
-----------------------
Let C_i be the circle where tube i meets the sphere, theta_i its angular radius, and m_i the length of a meridian from
c_i (over a flat cover, down the tube, along the fillet) to C_i. Claim: the shortest path from c_i to c_j is the plane
curve meridian - great circle arc - meridian in the plane of O, d_i and d_j, and its length is
m_i + R (angle(d_i, d_j) - theta_i - theta_j) + m_j.

Proof. Split any path from c_i to c_j where it last leaves C_i and where it next meets C_j. A tube is a surface of
revolution about its axis, so the first part is no shorter than m_i and the last no shorter than m_j. The part between
runs outside the ball of radius R or on it, because tubes and their covers lie outside (`PhantomShape` checks the
rims). The projection onto a ball never lengthens a curve, so this part is no shorter than a curve on the sphere from
C_i to C_j, that is, than R (angle - theta_i - theta_j). The plane curve attains the bound, and nothing else does,
because the shortest arc between two circles of a sphere is unique. It runs into no other opening, which
`PhantomShape` checks. For a path from c_i to q_k the point q_k takes the place of C_j. QED

So all paths, and the borders of all regions, lie in planes through O. A region is a spherical polygon as seen from O,
on the tubes as well, because half-planes through a tube's axis cut it along meridians. Any cover with the symmetry of
the tube gives the same paths.

The surface has one more property: body and tubes are surfaces of revolution, so it maps *conformally* onto the unit
sphere by moving the points of each tube along their meridians only (`PhantomShape.conformal`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..anatomy import LEFT_ATRIUM, Anatomy
from ..errors import LAFlatteningError
from .lge import LgeModel, ScarPattern
from .sphere import Caps, SphericalDivision, angles_between, direction, fibonacci_sphere, tangent_frame

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

PATH_CLEARANCE = 1.0
"""Paths must stay so far from openings and paths that they do not belong to, mm."""


@dataclass(frozen=True)
class Tube:
    """A vein or the appendage.

    Attributes
    ----------
    azimuth, elevation : direction of its axis, degrees, see `phantom_sphere.direction`.
    perimeter : of the cylinder, and so of the rim, mm.
    length : from the rim to the tip of the hemisphere that closes it, mm.
    fillet : radius of the fillet between body and cylinder, mm.
    offset : height of the rim above the circle where the body ends, mm.
    """

    azimuth: float
    elevation: float
    perimeter: float
    length: float
    fillet: float = 3.0
    offset: float = 3.0


@dataclass(frozen=True)
class Valve:
    """The mitral valve.

    Attributes
    ----------
    azimuth, elevation : direction of its centre, degrees.
    perimeter : of its rim, a circle on the body, mm.
    seeds : label -> place on the rim, degrees counter-clockwise seen from outside, 0 superior (see `tangent_frame`).
    bulge : how far beyond the plane of the rim the closed atrium ends, in a plane, mm.
    rounding : radius of the edge of that plane, mm.
    """

    azimuth: float
    elevation: float
    perimeter: float
    seeds: Mapping[str, float]
    bulge: float = 3.0
    rounding: float = 2.0


class Opening(NamedTuple):
    """Geometry of a tube or of the valve; rho is the distance from its axis and z the height along it, mm."""

    axis: FloatArray
    contact: float
    """Angular radius of the circle where the sphere ends (in the closed atrium), radians."""
    rim: tuple[float, float]
    """(rho, z) of the rim."""
    arc: tuple[float, float, float]
    """(rho, z) of the centre of the fillet (tube) or rounding (valve), and its radius."""
    top: float
    """z of the centre of the hemisphere at the tip (tube) or of the plane (valve)."""
    profile: FloatArray
    """(k, 2) rho, z along a meridian from the contact to (nearly) the axis, finely."""


@dataclass(frozen=True, eq=False)
class PhantomShape:
    """The analytic shape of a phantom, in LPS, mm; `LAFlatteningLib.phantom.left_atrium_shape` is the standard one.

    The closed atrium contains the open one: cutting it in the planes of the six rims leaves exactly the open surface.

    Attributes
    ----------
    radius, centre : of the body.
    tubes : opening -> tube, for every hole of the anatomy.
    valve : the mitral valve.
    scar_pattern : where there is scar.
    anatomy : the names of seeds, paths and regions.

    Raises
    ------
    LAFlatteningError : openings too near to each other, tubes too short, paths that meet, impossible scar.
    """

    radius: float
    centre: tuple[float, float, float]
    tubes: Mapping[str, Tube]
    valve: Valve
    scar_pattern: ScarPattern = field(default_factory=ScarPattern)
    anatomy: Anatomy = field(default=LEFT_ATRIUM, repr=False)

    def __post_init__(self) -> None:
        for name, tube in self.tubes.items():
            half = tube.perimeter / (2.0 * np.pi)
            if not tube.length >= half:
                raise LAFlatteningError(
                    f"{name}: expected a length of at least {half:.1f} mm beyond the rim (the radius of the tube, "
                    f"whose tip is a hemisphere), found {tube.length:g}. Give a longer vein_length."
                )
            opening = self.openings[name]
            if opening.rim[1] < max(opening.arc[1], self.radius):
                raise LAFlatteningError(f"{name}: the rim lies in the fillet or in the body. Give a larger offset.")
        names = list(self.openings)
        for i, name in enumerate(names):
            for other in names[:i]:
                gap = self.caps.distance(name, self.caps.axes[other][None])[0] - self.radius * self.caps.angles[other]
                if gap < PATH_CLEARANCE:
                    raise LAFlatteningError(
                        f"{other} and {name} are {gap:.1f} mm apart on the body, expected {PATH_CLEARANCE:g} or more. "
                        "Move them apart, or make the body larger."
                    )
        self._check_paths()
        self.scar_pattern.check(self.caps)

    def _check_paths(self) -> None:
        arcs = {name: self._body_arc(name, 0.25 * PATH_CLEARANCE) for name in self.anatomy.paths}
        for name, arc in arcs.items():
            own = {self.anatomy.opening_of(seed) for seed in self.anatomy.paths[name]}
            for opening in self.openings:
                # A path to the mitral rim may come near it, but not cross it before its end.
                least = PATH_CLEARANCE if opening not in own else -1e-6
                if self.caps.distance(opening, arc).min() < least:
                    raise LAFlatteningError(f"Path {name} runs into {opening}. Move the openings or the mitral seeds.")
            for other in arcs:
                apart = self.radius * np.linalg.norm(arc[:, None] - arcs[other], axis=2).min()
                if other < name and apart < PATH_CLEARANCE:
                    raise LAFlatteningError(f"Paths {other} and {name} meet. Move the openings or the mitral seeds.")

    # ---- pieces ---------------------------------------------------------------------------------------------

    @cached_property
    def openings(self) -> dict[str, Opening]:
        """Tubes, then the valve under the name of the outer opening."""
        solved = {name: self._solve_tube(tube) for name, tube in self.tubes.items()}
        return {**solved, self.anatomy.outer: self._solve_valve()}

    def _solve_tube(self, tube: Tube) -> Opening:
        a, f = tube.perimeter / (2.0 * np.pi), tube.fillet
        contact = float(np.arcsin((a + f) / (self.radius + f)))
        z_arc = (self.radius + f) * np.cos(contact)
        z_rim = self.radius * np.cos(contact) + tube.offset
        top = z_rim + tube.length - a
        turn = np.linspace(0.5 * np.pi - contact, 0.0, 400)
        fillet = np.stack([a + f - f * np.cos(turn), z_arc - f * np.sin(turn)], axis=1)
        wall = np.stack([np.full(400, a), np.linspace(z_arc, top, 400)], axis=1)
        # The Mercator coordinate t of the hemisphere spaces points well all the way to the tip.
        t = np.linspace(0.0, 14.0, 1400)
        tip = np.stack([a / np.cosh(t), top + a * np.tanh(t)], axis=1)
        profile = np.concatenate([fillet, wall[1:], tip[1:]])
        return Opening(direction(tube.azimuth, tube.elevation), contact, (a, z_rim), (a + f, z_arc, f), top, profile)

    def _solve_valve(self) -> Opening:
        valve, r = self.valve, self.valve.rounding
        rho_rim = valve.perimeter / (2.0 * np.pi)
        z_rim = float(np.sqrt(self.radius**2 - rho_rim**2))
        top = z_rim + valve.bulge
        contact = float(np.arccos((top - r) / (self.radius - r)))
        rho_arc = (self.radius - r) * np.sin(contact)
        turn = np.linspace(contact, 0.0, 400)
        edge = np.stack([rho_arc + r * np.sin(turn), top - r + r * np.cos(turn)], axis=1)
        t = np.linspace(0.0, 14.0, 1400)
        plane = np.stack([rho_arc * np.exp(-t), np.full(1400, top)], axis=1)
        profile = np.concatenate([edge, plane[1:]])
        return Opening(
            direction(valve.azimuth, valve.elevation), contact, (rho_rim, z_rim), (rho_arc, top - r, r), top, profile
        )

    @cached_property
    def caps(self) -> Caps:
        """The sphere and what the openings take from it: up to the fillets, and to the mitral rim."""
        angles = {name: self.openings[name].contact for name in self.tubes}
        angles[self.anatomy.outer] = float(np.arcsin(self.openings[self.anatomy.outer].rim[0] / self.radius))
        return Caps(self.radius, {name: opening.axis for name, opening in self.openings.items()}, angles)

    @cached_property
    def nodes(self) -> dict[str, FloatArray]:
        """Seed label -> unit vector (3,) from the centre of the body to the seed."""
        outer, angle = self.caps.axes[self.anatomy.outer], self.caps.angles[self.anatomy.outer]
        first, second = tangent_frame(outer)
        nodes = {name: self.caps.axes[name] for name in self.anatomy.holes}
        for label, degrees in self.valve.seeds.items():
            phi = np.radians(degrees)
            nodes[label] = np.cos(angle) * outer + np.sin(angle) * (np.cos(phi) * first + np.sin(phi) * second)
        return nodes

    @cached_property
    def division(self) -> SphericalDivision:
        """The regions as seen from the centre of the body; directions in the valve belong to its sectors."""
        return SphericalDivision(self.anatomy, self.nodes, self.caps.axes[self.anatomy.outer])

    @property
    def seeds(self) -> dict[str, FloatArray]:
        """Seed label -> (3,) mm: centres of the ostia in the planes of their rims, and points on the mitral rim."""
        far = {label: self.openings[label].rim[1] if label in self.tubes else self.radius for label in self.nodes}
        return {label: np.array(self.centre) + far[label] * node for label, node in self.nodes.items()}

    @property
    def tips(self) -> dict[str, FloatArray]:
        """Opening -> (3,) mm, the tip of its tube in the closed atrium."""
        heights = {name: self.openings[name].top + self.openings[name].rim[0] for name in self.tubes}
        return {name: np.array(self.centre) + heights[name] * self.caps.axes[name] for name in self.tubes}

    # ---- surface of the closed atrium --------------------------------------------------------------------------

    def signed_distance(self, points: FloatArray) -> FloatArray:
        """Distance of points (n, 3) to the closed surface, (n,) mm, negative inside.

        Exact inside, and up to the fillet radius (3 mm) outside; farther out it is approximate, but no less than that.
        """
        return self._nearest(np.asarray(points, np.float64))[0]

    def closest_points(self, points: FloatArray) -> FloatArray:
        """The nearest point of the closed surface for each of `points` (n, 3), exact where `signed_distance` is."""
        return self._nearest(np.asarray(points, np.float64))[1]

    def _nearest(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        offset = points - np.array(self.centre)
        length = np.linalg.norm(offset, axis=1)
        distance = length - self.radius
        foot = offset * (self.radius / np.maximum(length, 1e-12))[:, None]
        for name, opening in self.openings.items():
            z = offset @ opening.axis
            in_cone = z > length * np.cos(opening.contact)
            rho_arc, z_arc, r = opening.arc
            if name in self.tubes:
                ids = np.flatnonzero(in_cone | (z > z_arc))
            else:
                ids = np.flatnonzero(in_cone | (length**2 - z**2 < rho_arc**2))
            z, inside = z[ids], in_cone[ids]
            across = offset[ids] - z[:, None] * opening.axis
            rho = np.linalg.norm(across, axis=1)
            if name in self.tubes:
                a = opening.rim[0]
                on_arc = z <= z_arc
                # The hemisphere's centre, or for the cylinder the point of the axis at the same height.
                middle = np.minimum(z, opening.top)
                from_axis = np.hypot(rho, z - middle)
                from_arc = np.maximum(np.hypot(rho - rho_arc, z - z_arc), 1e-12)
                found = np.where(on_arc, r - from_arc, from_axis - a)
                scale = a / np.maximum(from_axis, 1e-12)
                foot_rho = np.where(on_arc, rho_arc + (rho - rho_arc) * r / from_arc, rho * scale)
                foot_z = np.where(on_arc, z_arc + (z - z_arc) * r / from_arc, middle + (z - middle) * scale)
                nearer = inside | (found < distance[ids])
            else:
                on_arc = rho > rho_arc
                from_arc = np.maximum(np.hypot(rho - rho_arc, z - z_arc), 1e-12)
                found = np.where(on_arc, from_arc - r, z - opening.top)
                foot_rho = np.where(on_arc, rho_arc + (rho - rho_arc) * r / from_arc, rho)
                foot_z = np.where(on_arc, z_arc + (z - z_arc) * r / from_arc, opening.top)
                nearer = inside | (found > distance[ids])
            outward = across / np.maximum(rho, 1e-12)[:, None]
            chosen = ids[nearer]
            distance[chosen] = found[nearer]
            foot[chosen] = foot_rho[nearer, None] * outward[nearer] + foot_z[nearer, None] * opening.axis
        return distance, foot + np.array(self.centre)

    def extent(self, axes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest coordinate along each of the unit vectors `axes` (k, 3), mm (the valve taken as round)."""
        centres = np.array([np.zeros(3), *(self.openings[n].top * self.caps.axes[n] for n in self.tubes)])
        radii = np.array([self.radius, *(self.openings[n].rim[0] for n in self.tubes)])
        along, middle = axes @ centres.T, axes @ np.array(self.centre)
        return middle + (along - radii).min(axis=1), middle + (along + radii).max(axis=1)

    def conformal(self, points: FloatArray) -> FloatArray:
        """Points (n, 3) of the surface, open or closed, mapped conformally onto the unit sphere, (n, 3).

        Body points keep their direction from the centre. Those of a tube keep their half-plane, and their
        colatitude t about the axis follows from equal stretch along meridian and parallel,
        ``d ln tan(t/2) = ds / rho`` (the Mercator coordinate).
        """
        offset = np.asarray(points, np.float64) - np.array(self.centre)
        result = offset / np.linalg.norm(offset, axis=1, keepdims=True)
        for opening in self.openings.values():
            ids = np.flatnonzero(result @ opening.axis > np.cos(opening.contact))
            angle = angles_between(result[ids], opening.axis)
            rho, z = opening.profile.T
            step = np.hypot(np.diff(rho), np.diff(z)) * 0.5 * (1.0 / rho[1:] + 1.0 / rho[:-1])
            mercator = np.log(np.tan(0.5 * opening.contact)) - np.concatenate([[0.0], np.cumsum(step)])
            polar = np.arctan2(rho, z)
            # The tip is smooth: there the coordinate is linear in the logarithm of the angle.
            t = np.interp(np.log(np.maximum(angle, polar[-1])), np.log(polar[::-1]), mercator[::-1])
            colatitude = 2.0 * np.arctan(np.exp(t))
            across = result[ids] - (result[ids] @ opening.axis)[:, None] * opening.axis
            across /= np.maximum(np.linalg.norm(across, axis=1), 1e-300)[:, None]
            result[ids] = np.cos(colatitude)[:, None] * opening.axis + np.sin(colatitude)[:, None] * across
        return result

    # ---- areas -------------------------------------------------------------------------------------------------

    def _wall_area(self, name: str) -> float:
        """Area of a tube from the body to the rim, mm2."""
        opening = self.openings[name]
        (a, z_rim), (rho_arc, z_arc, f) = opening.rim, opening.arc
        turn = 0.5 * np.pi - opening.contact
        return 2.0 * np.pi * (f * (rho_arc * turn - f * np.sin(turn)) + a * (z_rim - z_arc))

    def area(self, closed: bool = False) -> float:
        """Area of the surface, mm2, in closed form."""
        sphere = 1.0 - sum(1.0 - np.cos(self.openings[name].contact) for name in self.tubes)
        total = sum(self._wall_area(name) for name in self.tubes)
        outer = self.openings[self.anatomy.outer]
        if closed:
            for name in self.tubes:
                a, z_rim = self.openings[name].rim
                total += 2.0 * np.pi * a * (self.openings[name].top - z_rim + a)
            rho, _, r = outer.arc
            total += 2.0 * np.pi * r * (rho * outer.contact + r * (1.0 - np.cos(outer.contact))) + np.pi * rho**2
            sphere += np.cos(outer.contact)
        else:
            sphere += np.cos(self.caps.angles[self.anatomy.outer])
        return float(2.0 * np.pi * self.radius**2 * sphere + total)

    def region_areas(self) -> dict[int, float]:
        """Region -> its area on the open surface, mm2, in closed form (spherical polygons, sectors of tubes)."""
        outer = self.anatomy.outer
        areas = {}
        for region, solid in self.division.solid_angles().items():
            walls = 0.0
            for opening, angle in self.division.corner_angles(region).items():
                solid -= angle * (1.0 - np.cos(self.caps.angles[opening]))
                walls += 0.0 if opening == outer else angle / (2.0 * np.pi) * self._wall_area(opening)
            areas[region] = float(self.radius**2 * solid + walls)
        return areas

    # ---- regions -----------------------------------------------------------------------------------------------

    def region_of(self, points: FloatArray) -> IntArray:
        """Region 1-5 of points (n, 3) mm on the surface, (n,); 0 beyond the rims (veins, appendage, valve)."""
        offset = np.asarray(points, np.float64) - np.array(self.centre)
        directions = offset / np.linalg.norm(offset, axis=1, keepdims=True)
        result = self.division.region_of(directions)
        for name, opening in self.openings.items():
            inside = directions @ opening.axis > np.cos(self.caps.angles[name]) - 1e-9
            result[inside & (offset @ opening.axis > opening.rim[1] + 1e-6)] = 0
        return result

    # ---- paths -------------------------------------------------------------------------------------------------

    def _body_arc(self, path: str, step: float) -> FloatArray:
        """Unit vectors along the great circle of a path, between the tubes at its ends or from a tube to the rim."""
        first, second = self.anatomy.paths[path]
        a, b = self.nodes[first], self.nodes[second]
        whole = float(angles_between(a[None], b)[0])
        start, stop = (self.caps.angles[seed] if seed in self.tubes else 0.0 for seed in (first, second))
        count = max(2, int(np.ceil(self.radius * (whole - start - stop) / step)) + 1)
        t = np.linspace(start, whole - stop, count)[:, None]
        return (np.sin(whole - t) * a + np.sin(t) * b) / np.sin(whole)

    def path_normal(self, path: str) -> FloatArray:
        """Unit normal (3,) of the plane through the centre in which a path lies."""
        first, second = (self.nodes[seed] for seed in self.anatomy.paths[path])
        normal = np.cross(first, second)
        return normal / np.linalg.norm(normal)

    def path_length(self, path: str) -> float:
        """Length of a path from rim to rim along the open surface, mm, in closed form."""
        first, second = self.anatomy.paths[path]
        length = self.radius * float(angles_between(self.nodes[first][None], self.nodes[second])[0])
        for seed in (first, second):
            if seed in self.tubes:
                opening = self.openings[seed]
                length += opening.arc[2] * (0.5 * np.pi - opening.contact) + opening.rim[1] - opening.arc[1]
                length -= self.radius * opening.contact
        return float(length)

    def path(self, name: str, step: float = 0.5, covered: bool = True) -> FloatArray:
        """Points (k, 3) mm along a path, at most about `step` mm apart, from its first seed to its second.

        With `covered` it runs over flat covers of the ostia to the seeds, else from rim to rim.
        """
        arc = self._body_arc(name, step)
        pieces = [self.radius * arc]
        for which, seed in enumerate(self.anatomy.paths[name]):
            if seed in self.tubes:
                opening = self.openings[seed]
                (a, z_rim), (rho_arc, z_arc, f) = opening.rim, opening.arc
                turn = np.linspace(0.0, 0.5 * np.pi - opening.contact, int(2.0 * f / step) + 2)[:-1]
                cover = np.linspace(0.0 if covered else a, a, int(a / step) + 2 if covered else 1)
                rho = np.concatenate([cover, rho_arc - f * np.cos(turn)])
                z = np.concatenate([np.full(len(cover), z_rim), z_arc - f * np.sin(turn)])
                across = arc[-which] - (arc[-which] @ opening.axis) * opening.axis
                across /= np.linalg.norm(across)
                piece = rho[:, None] * across + z[:, None] * opening.axis
                pieces = [piece, *pieces] if which == 0 else [*pieces, piece[::-1]]
        return np.concatenate(pieces) + np.array(self.centre)

    # ---- scar --------------------------------------------------------------------------------------------------

    def _depths(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Depth in scar, and in the cone of the valve, of the body direction of points (n, 3) of the surface."""
        offset = points - np.array(self.centre)
        directions = offset / np.linalg.norm(offset, axis=1, keepdims=True)
        return self.scar_pattern.depth(directions, self.caps), -self.caps.distance(self.anatomy.outer, directions)

    def scar(self, points: FloatArray) -> NDArray[np.bool_]:
        """Whether points (n, 3) mm of the surface (elsewhere: their nearest points of it) are scar, (n,)."""
        return self._depths(self.closest_points(points))[0] > 0.0

    def lge(self, points: FloatArray, model: LgeModel | None = None) -> FloatArray:
        """Largest intensity within 3 mm along the normal of surface points (n, 3) mm, (n,); see `LgeModel.maximum`."""
        return (model or LgeModel()).maximum(*self._depths(self.closest_points(points)))

    def intensity(self, points: FloatArray, model: LgeModel) -> FloatArray:
        """Intensity of the LGE image at points (n, 3) mm of space, (n,); see `LgeModel.intensity`."""
        distance, feet = self._nearest(np.asarray(points, np.float64))
        scar = np.full(len(distance), -self.radius)
        wall = np.abs(distance - 0.5 * model.wall) < 0.5 * (model.wall + model.transition)
        scar[wall] = self._depths(feet[wall])[0]
        offset = points - np.array(self.centre)
        directions = offset / np.maximum(np.linalg.norm(offset, axis=1, keepdims=True), 1e-12)
        return model.intensity(distance, scar, -self.caps.distance(self.anatomy.outer, directions))

    def scar_areas(self, samples: int = 2_000_000) -> dict[int, float]:
        """Region -> area of scar in it, mm2, by quadrature on the sphere (no mesh involved).

        Scar lies on the body, so its area is the share of evenly spread directions that hit it. With the default
        number of samples, areas are exact to about 0.1 mm2.
        """
        directions = fibonacci_sphere(samples)
        directions = directions[self.scar_pattern.depth(directions, self.caps) > 0.0]
        region = self.division.region_of(directions)
        each = 4.0 * np.pi * self.radius**2 / samples
        return {number: each * np.count_nonzero(region == number) for number in self.anatomy.regions}

    def scar_fractions(self, samples: int = 2_000_000) -> dict[int, float]:
        """Region -> share of its area on the open surface that is scar, 0 to 1 (percentage of fibrosis / 100)."""
        scar, whole = self.scar_areas(samples), self.region_areas()
        return {number: scar[number] / whole[number] for number in whole}
