"""The energies of a map: one that folded maps can be brought down, and one that says how distorted a map is.

With J the Jacobian of a triangle, surface to map:

- `PatchEnergy.untangling`, after Garanzha, Kaporin, Kudryavtseva, Protais, Ray and Sokolov, "Foldover-free maps in 50
  lines of code", ACM Transactions on Graphics 40, 2021:
  (tr(J^T J) + LAMBDA (det(J)^2 + 1)) / chi(det J), chi(d) = (d + sqrt(eps^2 + d^2)) / 2. It is finite for folded
  triangles, too.
- `PatchEnergy.distortion`: (tr(J^T J) / (2 det J))^2 + AREA (det J + 1 / det J). The first term is the square of the
  "most isometric parametrisations" energy of Hormann and Greiner (2000), (K + 1/K)^2 / 4 with K the dilatation; the
  second keeps areas. It is infinite at det J = 0, a barrier against folding.

Loops over triangles are written on separate arrays of x and y, which is twice as fast as on rows.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from .. import operators
from ..solvers import Factorisation
from ..surface import FloatArray, IntArray
from .stiffness import StiffnessPattern

LAMBDA = 0.01
"""Weight of keeping area against keeping angles while untangling. Small, but scale must not drift."""
AREA = 0.4
"""Weight of keeping area against keeping angles in the distortion of a map. Docs/method.md shows what others give."""
GUARD, GUARDED_FROM = 1e-2, 5.0
"""Weight of the triangles that are only guarded against folding, whose area others count already; and the (K + 1/K)/2
from which on they count."""
STIFFEST, FLATTEST = 25.0, 0.02
"""Largest (K + 1/K)/2 and smallest share of its rest area with which a triangle enters a stand-in for the Hessian."""
THINNEST = 0.1
"""Least height of a triangle at rest, as a share of its longest side."""


def rest_shapes(points: FloatArray, triangles: IntArray, scale: float) -> FloatArray:
    """The triangles on the surface, in their own plane, at the scale of the map: (m, 3) base, x and height.

    Corner 0 is at the origin, corner 1 at (base, 0), corner 2 at (x, height). Slivers on the surface are
    widened to a height of a tenth of their longest side, because the map of a sliver has no shape worth keeping.

    Parameters
    ----------
    points : (n, 3) mm.
    scale : map units per mm.
    """
    squared = np.zeros((3, len(triangles)))
    ids = np.ascontiguousarray(triangles.T)
    for axis in points.T:
        at = np.ascontiguousarray(axis)[ids]
        for k in range(3):
            squared[k] += (at[(k + 1) % 3] - at[k]) ** 2
    squared = np.maximum(squared * scale**2, 1e-24)
    area = operators.triangle_areas(points, triangles) * scale**2
    longest = squared.max(axis=0)
    # Twice the area over the longest side is the height above it.
    thin = np.flatnonzero(2.0 * area < THINNEST * longest)
    # Counted from the longest side on, so that it does not matter with which corner a triangle begins.
    order = (squared[:, thin].argmax(axis=0) + np.arange(3)[:, None]) % 3
    along, second, third = np.take_along_axis(squared[:, thin], order, axis=0)
    foot = 0.5 * (along + third - second) / np.sqrt(along)
    height = THINNEST**2 * along
    widened = np.stack([along, (np.sqrt(along) - foot) ** 2 + height, foot**2 + height])
    changed = squared[:, thin]
    np.put_along_axis(changed, order, widened, axis=0)
    squared[:, thin], area[thin] = changed, 0.5 * THINNEST * along
    base = np.sqrt(squared[0])
    return np.stack([base, 0.5 * (squared[0] + squared[2] - squared[1]) / base, 2.0 * area / base], axis=1)


class _Columns(NamedTuple):
    """The Jacobian of each triangle, column by column, and its determinant, (k,) each."""

    ax: FloatArray
    ay: FloatArray
    bx: FloatArray
    by: FloatArray
    det: FloatArray

    def squared(self) -> FloatArray:
        """tr(J^T J)."""
        return self.ax * self.ax + self.ay * self.ay + self.bx * self.bx + self.by * self.by


class PatchEnergy:
    """The energy of some triangles as a function of some of their points.

    Variables are (v, 2), best in Fortran order (as `start` has them).

    Parameters
    ----------
    flat : (n, 2) map; the points that do not move are taken from it.
    triangles : (k, 3) the triangles that count: all that touch a movable point.
    rest : (k, 3) their `rest_shapes`.
    movable : (n,) points that are variables.
    weights : (k,) weight of each triangle (default 1).
    guards : how many triangles, the last ones, are only guarded against folding: see `GUARD`.
    mesh_edges : number of the edge opposite each corner of each triangle, if known already.
    """

    def __init__(
        self,
        flat: FloatArray,
        triangles: IntArray,
        rest: FloatArray,
        movable: NDArray[np.bool_],
        weights: FloatArray | None = None,
        guards: int = 0,
        mesh_edges: IntArray | None = None,
    ) -> None:
        self._mesh_edges = mesh_edges
        self._weights = np.ones(len(triangles)) if weights is None else weights
        self._area_weights, self._floor = AREA * self._weights, None
        if guards:
            guard = np.arange(len(triangles)) >= len(triangles) - guards
            self._weights = np.where(guard, GUARD * self._weights, self._weights)
            self._area_weights = np.where(guard, 0.0, self._area_weights)
            self._floor = np.where(guard, GUARDED_FROM, 0.0)
        base, x, height = rest.T
        self._p, self._q, self._r = 1.0 / base, -x / (base * height), 1.0 / height
        self._rest = rest
        self.reach = 3.0 * float(np.sqrt(np.median(base * height)))
        """The farthest that a point may move in one step, map units."""
        used = np.zeros(len(flat), bool)
        used[triangles] = True
        self.ids = np.flatnonzero(used & movable)
        """Ids of the variables, in their order."""
        self.held = np.flatnonzero(used & ~movable)
        """Ids of the points that do not move."""
        v = self._v = len(self.ids)
        number = np.full(len(flat), -1, np.int64)
        number[self.ids] = np.arange(v)
        number[self.held] = v + np.arange(len(self.held))
        self._corners = number[triangles]
        self._corner = tuple(np.ascontiguousarray(self._corners[:, c]) for c in range(3))
        self._all = np.concatenate(self._corner)
        # Places of the variables and then of the points that are held, x and y apart.
        self._at = np.empty((2, v + len(self.held)))
        self._at[:, :v] = flat[self.ids].T
        self.hold(flat)

    def hold(self, flat: FloatArray) -> None:
        """Move the points that are held to their places on a map (n, 2)."""
        self._at[:, self._v :] = flat[self.held].T

    def start(self) -> FloatArray:
        """The variables as they are on the map, (v, 2)."""
        return self._at[:, : self._v].copy().T

    def _sides(self, variables: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """From corner 0 of each triangle on the map to corner 1, x and y, and to corner 2, x and y."""
        self._at[:, : self._v] = variables.T
        first, second, third = self._corner
        sides = []
        for at in self._at:
            origin = at.take(first)
            sides.append((at.take(second) - origin, at.take(third) - origin))
        return sides[0][0], sides[1][0], sides[0][1], sides[1][1]

    def _columns(self, variables: FloatArray) -> _Columns:
        ux, uy, vx, vy = self._sides(variables)
        vx *= self._r
        vx += self._q * ux
        vy *= self._r
        vy += self._q * uy
        ux *= self._p
        uy *= self._p
        return _Columns(ux, uy, vx, vy, ux * vy - uy * vx)

    def determinants(self, variables: FloatArray) -> FloatArray:
        """Area of each triangle on the map over its area at rest, (k,); negative where folded."""
        return self._columns(variables).det

    def mips(self, variables: FloatArray) -> FloatArray:
        """(K + 1/K)/2 of each triangle, (k,), K its dilatation; of triangles that are not folded."""
        columns = self._columns(variables)
        return 0.5 * columns.squared() / np.maximum(columns.det, 1e-6)

    def untangling(self, variables: FloatArray, eps: float) -> tuple[float, FloatArray]:
        """The energy against folds, for eps > 0, and its derivative by the variables, (v, 2)."""
        columns = self._columns(variables)
        det = columns.det
        numerator = columns.squared() + LAMBDA * (det * det + 1.0)
        root = np.sqrt(eps * eps + det * det)
        # For negative det the textbook sum loses all digits; the second form is the same number.
        chi = 0.5 * np.where(det > 0, det + root, eps * eps / (root + np.abs(det)))
        share = self._weights / chi
        value = float((share * numerator).sum())
        return value, self._gradient(columns, 2.0 * share, share * (2.0 * LAMBDA * det - numerator / root))

    def distortion(self, variables: FloatArray) -> tuple[float, FloatArray]:
        """The distortion and its derivative by the variables, (v, 2).

        Infinite for a map with a folded triangle, its derivative then NaN.
        """
        columns = self._columns(variables)
        det = columns.det
        if det.min() <= 0.0:
            return np.inf, np.full(variables.shape, np.nan)
        inverse = 1.0 / det
        mips = 0.5 * columns.squared() * inverse
        excess, areas = self._excess(mips), self._area_weights
        weighted = self._weights * excess
        # Sums not through BLAS: for arrays of this size its threads cost more than they bring.
        value = float(np.einsum("i,i", weighted, excess) + np.einsum("i,i", areas, det + inverse))
        scale = 2.0 * weighted * inverse
        return value, self._gradient(columns, scale, areas * (1.0 - inverse * inverse) - scale * mips)

    def _excess(self, mips: FloatArray) -> FloatArray:
        """What counts of (K + 1/K)/2."""
        return mips if self._floor is None else np.maximum(mips - self._floor, 0.0)

    def _gradient(self, columns: _Columns, scale: FloatArray, by_det: FloatArray) -> FloatArray:
        """Derivative by the variables, (v, 2), of what has the derivative `scale` J + `by_det` cofactor(J) by J."""
        ax, ay, bx, by, _ = columns
        k, v = len(scale), self._v
        gradient = np.empty((2, v))
        corner = np.empty((3, k))
        for axis, (by_a, by_b) in enumerate(
            (
                (scale * ax + by_det * by, scale * bx - by_det * ay),
                (scale * ay - by_det * bx, scale * by + by_det * ax),
            )
        ):
            np.multiply(by_a, self._p, out=corner[1])
            corner[1] += by_b * self._q
            np.multiply(by_b, self._r, out=corner[2])
            np.add(corner[1], corner[2], out=corner[0])
            np.negative(corner[0], out=corner[0])
            gradient[axis] = np.bincount(self._all, corner.reshape(-1), minlength=self._at.shape[1])[:v]
        return gradient.T

    def preconditioner_at_rest(self) -> Factorisation:
        """A stand-in for the inverse of the Hessian that knows nothing of the map: the inverse of the Dirichlet
        energy of the rest shapes. For maps that are still folded."""
        base, x, height = self._rest.T
        weight = _cotangents(base, np.zeros_like(base), x, height) * self._weights
        return self._inverse(self._pattern.edge_weights(weight))

    def preconditioner(self, variables: FloatArray) -> Factorisation:
        """A stand-in for the inverse of the Hessian at a map without folds.

        A small displacement v of the map changes the distortion of a triangle to second order by about
        weight (tr(J^T J)/det(J))^2 |grad v|^2, the gradient taken on the map: a Dirichlet energy there.
        """
        return self._inverse(self._stiffness(variables))

    def follow(self, variables: FloatArray, flat: FloatArray) -> tuple[FloatArray, Factorisation]:
        """Move the points that are held to their places on a map (n, 2), and the variables along with them, as the
        stand-in for the Hessian says that costs least.

        Returns
        -------
        variables : (v, 2) moved; the map may have folds then.
        preconditioner : at the variables as they were.
        """
        edge = self._stiffness(variables)
        solver = self._inverse(edge)
        moved = np.zeros((self._at.shape[1], 2))
        moved[self._v :] = flat[self.held] - self._at[:, self._v :].T
        self.hold(flat)
        return variables + solver.solve(self._pattern.pulled(edge, moved)), solver

    def _stiffness(self, variables: FloatArray) -> FloatArray:
        """Weights of the edges in the `preconditioner`."""
        sides = self._sides(variables)
        columns = self._columns(variables)
        det = np.maximum(columns.det, FLATTEST)
        # Never less than 1 but where the triangle is folded or all but folded.
        mips = np.clip(0.5 * columns.squared() / det, 1.0, STIFFEST)
        stiffness = self._weights * (2.0 * mips) ** 2 / (self._rest[:, 0] * self._rest[:, 2] * det)
        return self._pattern.edge_weights(_cotangents(*sides) * stiffness)

    def _inverse(self, edge: FloatArray) -> Factorisation:
        # Single precision: its solutions are directions of steps, the gradient is exact.
        return Factorisation(self._pattern.matrix(edge), single=True)

    def hessian(self, variables: FloatArray, order: IntArray | None = None) -> HessianSolver:
        """The Hessian of the distortion, factorised; of a map without folds, near its minimum.

        With z the map as a complex number, a triangle's distortion
        depends on |a| and |b| only, a being the derivative of z by the complex coordinate at rest and b that by its
        conjugate: |J|^2 = 2 (|a|^2 + |b|^2) and det J = |a|^2 - |b|^2.

        Parameters
        ----------
        order : a good order of elimination of the variables (`Factorisation.order` of a preconditioner).
        """
        columns = self._columns(variables)
        one, two = columns.ax + 1j * columns.ay, columns.bx + 1j * columns.by
        a, b = 0.5 * (one - 1j * two), 0.5 * (one + 1j * two)
        total = a.real**2 + a.imag**2 + b.real**2 + b.imag**2
        inverse = 1.0 / columns.det
        # (K + 1/K)/2 is total / det.
        mips = total * inverse
        excess, areas = self._excess(mips), self._area_weights
        weights = np.where(excess > 0.0, self._weights, 0.0)
        # First and second derivatives by |a|^2 + |b|^2 and |a|^2 - |b|^2.
        by_s = 2.0 * weights * excess * inverse
        by_d = areas * (1.0 - inverse**2) - by_s * mips
        by_ss = 2.0 * weights * inverse**2
        by_sd = -by_ss * (mips + excess)
        by_dd = by_ss * mips * (mips + 2.0 * excess) + 2.0 * areas * inverse * inverse**2
        # By |a|^2 twice, by |b|^2 twice, by both.
        by_aa, by_bb, by_ab = by_ss + 2.0 * by_sd + by_dd, by_ss - 2.0 * by_sd + by_dd, by_ss - by_dd
        # With da and db their changes, the second derivative of |a|^2 is 2 |da|^2 and the first 2 Re(conj(a) da);
        # Re(u) Re(v) = Re(u v + u conj(v)) / 2.
        along_a = 2.0 * (by_s + by_d) + 2.0 * by_aa * (a.real**2 + a.imag**2)
        along_b = 2.0 * (by_s - by_d) + 2.0 * by_bb * (b.real**2 + b.imag**2)
        twice_a, twice_b = 2.0 * by_aa * a.conj() ** 2, 2.0 * by_bb * b.conj() ** 2
        across, along = 4.0 * by_ab * a.conj() * b, 4.0 * by_ab * a.conj() * b.conj()
        # da is the sum over the corners of share * dz, db that of conj(share) * dz.
        u, v = 0.5 * (self._p - 1j * self._q), -0.5j * self._r
        shares = (-u - v, u, v)
        direct, mirrored = np.empty((2, 3, len(self._p)), complex)
        for k in range(3):
            one, two = shares[(k + 1) % 3], shares[(k + 2) % 3]
            product, turned = one * two, one * two.conj()
            direct[k].real = (along_a + along_b) * turned.real + (across * product).real
            direct[k].imag = (along_a - along_b) * turned.imag
            mirrored[k] = twice_a * product + twice_b * product.conj() + along * turned.real
        return HessianSolver(self._pattern_in(order).block_matrix(direct, mirrored), order)

    @cached_property
    def _pattern(self) -> StiffnessPattern:
        return StiffnessPattern(self._corners, self._v, self._mesh_edges)

    def _pattern_in(self, order: IntArray | None) -> StiffnessPattern:
        """The pattern with the variables in another order."""
        if order is None:
            return self._pattern
        place = np.arange(self._at.shape[1])
        place[order] = np.arange(self._v)
        return StiffnessPattern(place[self._corners], self._v, self._mesh_edges)


class HessianSolver:
    """A factorised Hessian, in single precision like the preconditioners.

    Parameters
    ----------
    matrix : (2v, 2v), x and y of each variable side by side.
    order : variables as they stand in the matrix; by default in their own order.
    """

    def __init__(self, matrix: sparse.csc_matrix, order: IntArray | None) -> None:
        self._order = order
        self._factorisation = Factorisation(matrix, in_order=order is not None, single=True)

    def solve(self, right: FloatArray) -> FloatArray:
        """For a right side (v, 2), a coordinate a column."""
        if self._order is None:
            return self._factorisation.solve(right.reshape(-1)).reshape(-1, 2)
        result = np.empty_like(right)
        result[self._order] = self._factorisation.solve(right[self._order].reshape(-1)).reshape(-1, 2)
        return result


def _cotangents(ux: FloatArray, uy: FloatArray, vx: FloatArray, vy: FloatArray) -> FloatArray:
    """Cotangent of the angle at each corner of triangles with these sides u, v at corner 0, (3, k); at least 0.05, for
    obtuse triangles must not make a matrix indefinite."""
    uu, vv, uv = ux * ux + uy * uy, vx * vx + vy * vy, ux * vx + uy * vy
    # (All corners may be in one place: a coarse map that is carried to the points puts several on its rim.)
    area = np.maximum(np.abs(ux * vy - uy * vx), 1e-10 * np.maximum(uu, vv) + 1e-300)
    return np.maximum(np.stack([uv, uu - uv, vv - uv]) / area, 0.05)
