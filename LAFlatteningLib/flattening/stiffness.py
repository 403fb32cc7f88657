"""The matrices of a map's energy: where their entries stand, and how triangles fill them in."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from .. import topology
from ..surface import FloatArray, IntArray

ComplexArray = NDArray[np.complex128]


class StiffnessPattern:
    """A matrix with an entry for each pair of variables on one edge: new weights only fill in numbers.

    Parameters
    ----------
    corners : (k, 3) number of the point at each corner: first the variables, then the points that are held.
    variables : number of variables.
    mesh_edges : number of the edge opposite each corner, (k, 3), if known: any numbers, not negative.
    """

    def __init__(self, corners: IntArray, variables: int, mesh_edges: IntArray | None = None) -> None:
        if mesh_edges is None:
            mesh_edges = topology.edges(corners).of_triangle
        of_corner = np.ascontiguousarray(mesh_edges.T).reshape(-1)
        seen = np.zeros(int(of_corner.max(initial=-1)) + 1, np.int64)
        seen[of_corner] = 1
        self._edge_of_corner = (np.cumsum(seen) - 1)[of_corner]
        # The ends of each edge, as the last triangle on it has them.
        ends = np.empty((int(seen.sum()), 2), np.int64)
        first, second = corners.T[[1, 2, 0]].reshape(-1), corners.T[[2, 0, 1]].reshape(-1)
        ends[self._edge_of_corner, 0], ends[self._edge_of_corner, 1] = first, second
        self._a, self._b = np.ascontiguousarray(ends[:, 0]), np.ascontiguousarray(ends[:, 1])
        self._turned = self._a[self._edge_of_corner] != first
        self._variables, self._points = variables, int(corners.max(initial=-1)) + 1
        free_a, free_b = self._a < variables, self._b < variables
        self._inner = np.flatnonzero(free_a & free_b)
        self._to_held = np.flatnonzero(free_a != free_b)
        a, b, diagonal = self._a[self._inner], self._b[self._inner], np.arange(variables)
        rows, columns = np.concatenate([a, b, diagonal]), np.concatenate([b, a, diagonal])
        # The matrix of entry numbers: reading it column by column gives the place of each entry.
        places = sparse.csc_matrix((np.arange(len(rows)), (rows, columns)), shape=(variables, variables))
        self._entry, self._structure = places.data, (places.indices, places.indptr)

    def edge_weights(self, weight: FloatArray) -> FloatArray:
        """Of each edge, from weights (3, k) of the edges opposite each corner: half their sum, as in a Laplacian."""
        return 0.5 * self._on_edges(weight)

    def matrix(self, edge: FloatArray) -> sparse.csc_matrix:
        """The Laplacian with these `edge_weights`, of the variables alone, (v, v)."""
        diagonal = self._at_ends(edge)
        # A patch without any held point would make the matrix singular.
        diagonal += 1e-9 * diagonal.max(initial=0.0)
        inner = -edge[self._inner]
        data = np.concatenate([inner, inner, diagonal])[self._entry]
        return sparse.csc_matrix((data, *self._structure), shape=(self._variables, self._variables))

    def pulled(self, edge: FloatArray, moved: FloatArray) -> FloatArray:
        """How held points pull at the variables, (v, 2): what `matrix` @ displacements is where they move by
        `moved` (points, 2)."""
        a, b = self._a[self._to_held], self._b[self._to_held]
        free, held = np.minimum(a, b), np.maximum(a, b)
        result = np.empty((self._variables, 2), order="F")
        for axis in range(2):
            weight = edge[self._to_held] * moved[held, axis]
            result[:, axis] = np.bincount(free, weight, minlength=self._variables)
        return result

    def block_matrix(self, direct: ComplexArray, mirrored: ComplexArray) -> sparse.csc_matrix:
        """The matrix of second derivatives by x and y of each variable, side by side, (2v, 2v); rows sum to 0.

        Parameters
        ----------
        direct, mirrored : (3, k) of the edge opposite each corner, from i = its corner k + 1 to j = its corner k + 2:
            displacements z of the points, as complex numbers, change the derivatives as the form with the terms
            Re(direct z_i conj(z_j) + mirrored z_i z_j).
        """
        inner, v = self._inner, self._variables
        turn = np.where(self._turned, -1.0, 1.0) * direct.imag.reshape(-1)
        one, two, three, four = (self._on_edges(part) for part in (direct.real, turn, mirrored.real, mirrored.imag))
        blocks = np.empty((2 * len(inner) + v, 2, 2))
        # From b to a is the transposed block, and the places are read column by column: as rows they are those of the
        # transposed matrix, which is the same.
        for start, sign in ((len(inner), 1.0), (0, -1.0)):
            part = blocks[start : start + len(inner)]
            part[:, 0, 0], part[:, 1, 1] = (one + three)[inner], (one - three)[inner]
            part[:, 0, 1], part[:, 1, 0] = (sign * two - four)[inner], (-sign * two - four)[inner]
        one, three, four = (-self._at_ends(part) for part in (one, three, four))
        part = blocks[2 * len(inner) :]
        part[:, 0, 0], part[:, 1, 1] = one + three, one - three
        part[:, 0, 1] = part[:, 1, 0] = -four
        rows = sparse.bsr_matrix((blocks[self._entry], *self._structure), shape=(2 * v, 2 * v)).tocsr()
        return sparse.csc_matrix((rows.data, rows.indices, rows.indptr), shape=(2 * v, 2 * v))

    def _on_edges(self, values: FloatArray) -> FloatArray:
        """The sum over the triangles on each edge, of values (3, k) for the edges opposite their corners."""
        sums = np.bincount(self._edge_of_corner, values.reshape(-1), minlength=len(self._a))
        return sums.astype(np.float64, copy=False)

    def _at_ends(self, edge: FloatArray) -> FloatArray:
        """The sum over the edges at each variable, (v,)."""
        n = self._points
        sums = np.bincount(self._a, edge, minlength=n) + np.bincount(self._b, edge, minlength=n)
        return sums.astype(np.float64, copy=False)[: self._variables]
