"""The energies of a map: one that folded maps can be brought down, and one that says how distorted a map is.

With J the Jacobian of a triangle, surface to map:

- `PatchEnergy.untangling`, after Garanzha, Kaporin, Kudryavtseva, Protais, Ray and Sokolov, "Foldover-free maps in 50
  lines of code", ACM Transactions on Graphics 40, 2021:
  (tr(J^T J) + LAMBDA (det(J)^2 + 1)) / chi(det J), chi(d) = (d + sqrt(eps^2 + d^2)) / 2. It is finite for folded
  triangles, too.
- `PatchEnergy.distortion`: (tr(J^T J) / (2 det J))^2 + AREA (det J + 1 / det J). The first term is the square of the
  "most isometric parametrisations" energy of Hormann and Greiner (2000), (K + 1/K)^2 / 4 with K the dilatation; the
  second keeps areas. It is infinite at det J = 0, a barrier against folding.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from .. import operators, topology
from ..solvers import Factorisation
from ..surface import FloatArray, IntArray

ComplexArray = NDArray[np.complex128]

LAMBDA = 0.01
"""Weight of keeping area against keeping angles while untangling. Small, but scale must not drift."""
AREA = 0.4
"""Weight of keeping area against keeping angles in the distortion of a map. Docs/method.md shows what others give."""


def rest_shapes(points: FloatArray, triangles: IntArray, scale: float) -> FloatArray:
    """The triangles on the surface, in their own plane, at the scale of the map: (m, 3) base, x and height.

    Corner 0 is at the origin, corner 1 at (base, 0), corner 2 at (x, height). Slivers on the surface are
    widened to a height of a tenth of their longest side, because the map of a sliver has no shape worth keeping.

    Parameters
    ----------
    points : (n, 3) mm.
    scale : map units per mm.
    """
    frames = operators.local_frames(points, triangles) * scale
    base, x, height = np.maximum(frames[:, 1, 0], 1e-12), frames[:, 2, 0].copy(), frames[:, 2, 1].copy()
    squared = np.stack([base**2, (x - base) ** 2 + height**2, x**2 + height**2])
    longest = np.sqrt(squared.max(axis=0))
    # Twice the area over the longest side is the height above it.
    thin = np.flatnonzero(base * height < 0.1 * longest**2)
    # The longest side first, so that it does not matter with which corner a triangle begins.
    first = squared[:, thin].argmax(axis=0)
    turned = (first[:, None] + np.arange(3)) % 3
    local = operators.local_frames(points, np.take_along_axis(triangles[thin], turned, axis=1)) * scale
    flat = np.zeros((len(thin), 3, 2))
    flat[:, 1, 0], flat[:, 2, 0] = longest[thin], local[:, 2, 0]
    flat[:, 2, 1] = 0.1 * longest[thin]
    # Back to the triangle's own order of corners.
    flat = np.take_along_axis(flat, np.argsort(turned, axis=1)[:, :, None], axis=1)
    u, v = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    base[thin] = np.linalg.norm(u, axis=1)
    x[thin] = (u * v).sum(axis=1) / base[thin]
    height[thin] = (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / base[thin]
    return np.stack([base, x, height], axis=1)


class PatchEnergy:
    """The energy of some triangles as a function of some of their points.

    Parameters
    ----------
    flat : (n, 2) map; the points that do not move are taken from it.
    triangles : (k, 3) the triangles that count: all that touch a movable point.
    rest : (k, 3) their `rest_shapes`.
    movable : (n,) points that are variables.
    weights : (k,) weight of each triangle (default 1).
    guards : how many triangles, the last ones, only must not fold: preconditioners leave them out.
    mesh_edges : edges of the other triangles, if they are known already.
    order : in which order the variables stand, as an order of their ids: a good one for elimination
        (`Factorisation.order`). By default, that of their ids, and one is found for every factorisation.
    """

    def __init__(
        self,
        flat: FloatArray,
        triangles: IntArray,
        rest: FloatArray,
        movable: NDArray[np.bool_],
        weights: FloatArray | None = None,
        guards: int = 0,
        mesh_edges: topology.Edges | None = None,
        order: IntArray | None = None,
    ) -> None:
        self._triangles = triangles
        self._in_order = order is not None
        self._counted = len(triangles) - guards
        self._mesh_edges = mesh_edges
        self._flat = flat.copy()
        self._weights = np.ones(len(triangles)) if weights is None else weights
        self._rest = rest
        base, x, height = rest.T
        self._p, self._q, self._r = 1.0 / base, -x / (base * height), 1.0 / height
        self.reach = 3.0 * float(np.sqrt(np.median(base * height)))
        """The farthest that a point may move in one step, map units."""
        used = np.zeros(len(flat), bool)
        used[triangles] = True
        self.ids = np.flatnonzero(used & movable)
        if order is not None:
            self.ids = self.ids[order]
        """Ids of the variables, in their order."""
        self._number = np.full(len(flat), -1, np.int64)
        self._number[self.ids] = np.arange(len(self.ids))
        # Edge vectors, corner 1 - corner 0 and then corner 2 - corner 0, as a matrix on the variables.
        k = len(triangles)
        rows = np.tile(np.arange(2 * k), 2)
        columns = self._number[np.concatenate([triangles[:, 1], triangles[:, 2], triangles[:, 0], triangles[:, 0]])]
        signs = np.repeat([1.0, -1.0], 2 * k)
        free = columns >= 0
        self._edges = sparse.csr_matrix((signs[free], (rows[free], columns[free])), shape=(2 * k, len(self.ids)))
        self._edges_transposed = self._edges.T.tocsr()
        held = np.where((used & ~movable)[:, None], flat, 0.0)
        first = held[triangles[:, 0]]
        self._held_edges = np.concatenate([held[triangles[:, 1]] - first, held[triangles[:, 2]] - first])

    def start(self) -> FloatArray:
        """The variables as they are on the map, (v, 2)."""
        return self._flat[self.ids]

    def _columns(self, variables: FloatArray) -> tuple[ComplexArray, ComplexArray, FloatArray]:
        """Both columns of each Jacobian as complex numbers x + iy, and its determinant."""
        edges = (self._edges @ variables + self._held_edges).view(np.complex128)[:, 0]
        u, v = edges[: len(self._p)], edges[len(self._p) :]
        one, two = u * self._p, u * self._q + v * self._r
        return one, two, one.real * two.imag - one.imag * two.real

    def determinants(self, variables: FloatArray) -> FloatArray:
        """Area of each triangle on the map over its area at rest, (k,); negative where folded."""
        return self._columns(variables)[2]

    def mips(self, variables: FloatArray) -> FloatArray:
        """(K + 1/K)/2 of each triangle, (k,), K its dilatation; of triangles that are not folded."""
        one, two, det = self._columns(variables)
        return 0.5 * (one.real**2 + one.imag**2 + two.real**2 + two.imag**2) / np.maximum(det, 1e-6)

    def untangling(self, variables: FloatArray, eps: float) -> tuple[float, FloatArray]:
        """The energy against folds, for eps > 0, and its derivative by the variables, (v, 2)."""
        one, two, det = self._columns(variables)
        numerator = one.real**2 + one.imag**2 + two.real**2 + two.imag**2 + LAMBDA * (det * det + 1.0)
        root = np.sqrt(eps * eps + det * det)
        # For negative det the textbook sum loses all digits; the second form is the same number.
        chi = 0.5 * np.where(det > 0, det + root, eps * eps / (root + np.abs(det)))
        share = self._weights / chi
        value = float((share * numerator).sum())
        return value, self._gradient(one, two, 2.0 * share, share * (2.0 * LAMBDA * det - numerator / root))

    def distortion(self, variables: FloatArray) -> tuple[float, FloatArray]:
        """The distortion and its derivative by the variables, (v, 2).

        Infinite for a map with a folded triangle, its derivative then NaN.
        """
        one, two, det = self._columns(variables)
        if det.min() <= 0.0:
            return np.inf, np.full(variables.shape, np.nan)
        inverse = 1.0 / det
        trace = one.real**2 + one.imag**2 + two.real**2 + two.imag**2
        mips = 0.5 * trace * inverse
        weighted = self._weights * mips
        value = float((weighted * mips).sum() + AREA * (self._weights * (det + inverse)).sum())
        by_det = self._weights * (AREA * (1.0 - inverse * inverse)) - 2.0 * weighted * mips * inverse
        return value, self._gradient(one, two, 2.0 * weighted * inverse, by_det)

    def _gradient(self, one: ComplexArray, two: ComplexArray, scale: FloatArray, by_det: FloatArray) -> FloatArray:
        """Derivative by the variables, (v, 2), of what has the derivative `scale` J + `by_det` cofactor(J) by J."""
        # The columns of the cofactor matrix are -i two and i one.
        turned = 1j * by_det
        by_one, by_two = scale * one - turned * two, scale * two + turned * one
        by_edge = np.concatenate([by_one * self._p + by_two * self._q, by_two * self._r])
        return self._edges_transposed @ by_edge.view(np.float64).reshape(-1, 2)

    def preconditioner_at_rest(self) -> Factorisation:
        """A stand-in for the inverse of the Hessian that knows nothing of the map: the inverse of the Dirichlet
        energy of the rest shapes. For maps that are still folded."""
        base, x, height = self._rest.T
        corners = np.zeros((len(base), 3, 2))
        corners[:, 1, 0], corners[:, 2, 0], corners[:, 2, 1] = base, x, height
        return self._inverse_dirichlet(corners, self._weights)

    def preconditioner(self, variables: FloatArray) -> Factorisation:
        """A stand-in for the inverse of the Hessian at a map without folds.

        A small displacement v of the map changes the distortion of a triangle to second order by about
        weight (tr(J^T J)/det(J))^2 |grad v|^2, the gradient taken on the map: a Dirichlet energy there.
        """
        det = np.maximum(self.determinants(variables), 1e-6)
        area = self._rest[:, 0] * self._rest[:, 2] * det
        stiffness = self._weights * (2.0 * self.mips(variables)) ** 2 / area
        flat = self._flat.copy()
        flat[self.ids] = variables
        return self._inverse_dirichlet(flat[self._triangles], stiffness)

    def hessian(self, variables: FloatArray) -> Factorisation:
        """The Hessian of the distortion, factorised; of a map without folds, near its minimum.

        It acts on the coordinates of the variables in turn, (2v,). The triangles that are only guarded are left out.
        With z the map as a complex number, a triangle's distortion depends on |a| and |b| only, a being the derivative
        of z by the complex coordinate at rest and b that by its conjugate: |J|^2 = 2 (|a|^2 + |b|^2) and
        det J = |a|^2 - |b|^2. So its second derivatives are a 2 x 2 matrix for changes of |a| and |b|, and a number
        each for turning a and b.
        """
        one, two = (column[: self._counted] for column in self._columns(variables)[:2])
        a, b = 0.5 * (one - 1j * two), 0.5 * (one + 1j * two)
        p, q = a.real**2 + a.imag**2, b.real**2 + b.imag**2
        total, inverse = p + q, 1.0 / (p - q)
        # First and second derivatives by p + q and p - q, then by p and q.
        by_s, by_d = 2.0 * total * inverse**2, -2.0 * total**2 * inverse**3 + AREA * (1.0 - inverse**2)
        by_ss, by_sd = 2.0 * inverse**2, -4.0 * total * inverse**3
        by_dd = 6.0 * total**2 * inverse**4 + 2.0 * AREA * inverse**3
        by_p, by_q = by_s + by_d, by_s - by_d
        weights = self._weights[: self._counted]
        turn_a, turn_b = 2.0 * weights * by_p, 2.0 * weights * by_q
        stretch_a = turn_a + 4.0 * weights * p * (by_ss + 2.0 * by_sd + by_dd)
        stretch_b = turn_b + 4.0 * weights * q * (by_ss - 2.0 * by_sd + by_dd)
        both = 4.0 * weights * np.sqrt(p * q) * (by_ss - by_dd)
        # a is the sum over the corners of share * z, b that of conj(share) * z.
        u, v = 0.5 * (self._p - 1j * self._q)[: self._counted], -0.5j * self._r[: self._counted]
        towards_a, towards_b = _direction(a), _direction(b)
        along_a = [towards_a * share.conj() for share in (-u - v, u, v)]
        along_b = [towards_b * share for share in (-u - v, u, v)]
        blocks = np.empty((self._counted, 3, 2, 2))
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            ai, aj, bi, bj = along_a[i], along_a[j], along_b[i], along_b[j]
            for x, (ai_x, bi_x, turned_ai, turned_bi) in enumerate(
                ((ai.real, bi.real, -ai.imag, -bi.imag), (ai.imag, bi.imag, ai.real, bi.real))
            ):
                for y, (aj_y, bj_y, turned_aj, turned_bj) in enumerate(
                    ((aj.real, bj.real, -aj.imag, -bj.imag), (aj.imag, bj.imag, aj.real, bj.real))
                ):
                    blocks[:, k, x, y] = (
                        ai_x * (stretch_a * aj_y + both * bj_y)
                        + bi_x * (stretch_b * bj_y + both * aj_y)
                        + turn_a * turned_ai * turned_aj
                        + turn_b * turned_bi * turned_bj
                    )
        return Factorisation(self._pattern.block_matrix(blocks), in_order=self._in_order)

    def _inverse_dirichlet(self, corners: FloatArray, stiffness: FloatArray) -> Factorisation:
        """Solver for the Dirichlet energy of triangles (k, 3, 2), each with its own stiffness (k,)."""
        # Obtuse triangles must not make the matrix indefinite.
        weight = np.maximum(operators.corner_cotangents(corners[: self._counted]), 0.05)
        weight *= stiffness[: self._counted, None]
        return Factorisation(self._pattern.matrix(weight), in_order=self._in_order)

    @cached_property
    def _pattern(self) -> _DirichletPattern:
        return _DirichletPattern(self._number[self._triangles[: self._counted]], len(self.ids), self._mesh_edges)


def _direction(z: ComplexArray) -> ComplexArray:
    """z over its absolute value; 1 for 0."""
    size = np.abs(z)
    return np.divide(z, size, out=np.ones_like(z), where=size > 0.0)


class _DirichletPattern:
    """Where the entries of an energy's matrix stand, so that new weights only fill in numbers.

    Parameters
    ----------
    corners : (k, 3) number of the variable at each corner, -1 where the point is held.
    variables : number of variables.
    mesh_edges : edges of the triangles, if known.
    """

    def __init__(self, corners: IntArray, variables: int, mesh_edges: topology.Edges | None) -> None:
        if mesh_edges is None:
            # Held points are told apart only by being held: all are one point here.
            mesh_edges = topology.edges(np.where(corners >= 0, corners, variables))
            ends = mesh_edges.points
        else:
            ends = np.empty_like(mesh_edges.points)
            for k in range(3):
                ends[mesh_edges.of_triangle[:, k]] = corners[:, [(k + 1) % 3, (k + 2) % 3]]
        ends = np.where(ends < 0, variables, ends)
        self._corners = np.where(corners < 0, variables, corners)
        self._edge_of_corner = mesh_edges.of_triangle.reshape(-1)
        self._ends = ends
        self._inner = np.flatnonzero((ends < variables).all(axis=1) & (ends[:, 0] != ends[:, 1]))
        a, b = ends[self._inner].T
        diagonal = np.arange(variables)
        rows, columns = np.concatenate([a, b, diagonal]), np.concatenate([b, a, diagonal])
        # The matrix of entry numbers: reading it column by column gives the place of each entry.
        places = sparse.csc_matrix((np.arange(len(rows)), (rows, columns)), shape=(variables, variables))
        self._entry, self._structure = places.data, (places.indices, places.indptr)
        self._variables = variables

    def matrix(self, weight: FloatArray) -> sparse.csc_matrix:
        """The matrix for weights (k, 3) of the edges opposite each corner of each triangle."""
        edge = 0.5 * np.bincount(self._edge_of_corner, weight.reshape(-1), minlength=len(self._ends))
        ends, v = self._ends, self._variables
        diagonal = np.bincount(ends[:, 0], edge, minlength=v + 1) + np.bincount(ends[:, 1], edge, minlength=v + 1)
        diagonal = diagonal[:v]
        # A patch without any held point would make the matrix singular.
        diagonal += 1e-9 * diagonal.max()
        inner = -edge[self._inner]
        data = np.concatenate([inner, inner, diagonal])[self._entry]
        return sparse.csc_matrix((data, *self._structure), shape=(v, v))

    def block_matrix(self, blocks: FloatArray) -> sparse.csc_matrix:
        """The matrix (2v, 2v), x and y of each variable side by side, for blocks (k, 3, 2, 2) of the edges opposite
        each corner of each triangle, from its corner k + 1 (rows) to its corner k + 2; all rows sum to 0."""
        ends, v, m = self._ends, self._variables, len(self._ends)
        one, two = self._corners[:, [1, 2, 0]].reshape(-1), self._corners[:, [2, 0, 1]].reshape(-1)
        flat = blocks.reshape(-1, 2, 2)
        turned = (ends[self._edge_of_corner, 0] != one)[:, None, None]
        ordered = np.where(turned, flat.transpose(0, 2, 1), flat)
        edge, diagonal = np.empty((m, 2, 2)), np.empty((v, 2, 2))
        for x in range(2):
            for y in range(2):
                edge[:, x, y] = np.bincount(self._edge_of_corner, ordered[:, x, y], minlength=m)
                diagonal[:, x, y] = -(
                    np.bincount(one, flat[:, x, y], minlength=v + 1) + np.bincount(two, flat[:, y, x], minlength=v + 1)
                )[:v]
        inner = edge[self._inner]
        # The places are read column by column: as rows they are those of the transposed matrix, which is the same.
        data = np.concatenate([inner.transpose(0, 2, 1), inner, diagonal])[self._entry]
        rows = sparse.bsr_matrix((data, *self._structure), shape=(2 * v, 2 * v)).tocsr()
        return sparse.csc_matrix((rows.data, rows.indices, rows.indptr), shape=(2 * v, 2 * v))
