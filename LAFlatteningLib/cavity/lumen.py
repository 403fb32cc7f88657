"""The lumen: the space inside an atrium, as voxels, with ways through it from its middle to the tips of the veins."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkImagingStencil import vtkImageStencilToImage, vtkPolyDataToImageStencil

from ..errors import SurfaceError
from ..surface import FloatArray, IntArray, Surface

VOXELS = 60_000
"""About so many voxels lie inside: voxels of 1 to 1.5 mm in an atrium."""
DEEP = 0.7
"""The body of the chamber is where the wall is farther than this share of the largest distance from it. Ways begin
there: one deepest voxel would move by centimetres with a millimetre of noise, a set does not."""


class Lumen:
    """The inside of a closed surface.

    Parameters
    ----------
    surface : closed and outward; mm.

    Attributes
    ----------
    spacing : edge of the cubic voxels, mm.
    centres : (n, 3) centres of the voxels inside, mm.
    depth : (n,) how far each is from the wall, mm, to about half a voxel.
    body : ids of the voxels of the body (`DEEP`).

    Raises
    ------
    SurfaceError : nothing inside.
    """

    def __init__(self, surface: Surface) -> None:
        volume = abs(surface.enclosed_volume)
        self.spacing = float(np.cbrt(volume / VOXELS)) if volume > 0 else 1.0
        inside, origin = _voxels(surface, self.spacing)
        pieces, _ = ndimage.label(inside, np.ones((3, 3, 3), bool))
        size = np.bincount(pieces.ravel())[1:]
        if len(size) == 0:
            raise SurfaceError(
                "The surface encloses no space. Expected a closed atrium, or one whose rims can be closed."
            )
        inside = pieces == 1 + int(size.argmax())
        depth = self.spacing * ndimage.distance_transform_edt(inside)
        self._index = np.argwhere(inside)
        self._number = np.full(inside.shape, -1, np.int64)
        self._number[inside] = np.arange(len(self._index))
        self.centres: FloatArray = origin + self.spacing * self._index
        self.depth: FloatArray = depth[inside]
        self.body: IntArray = np.flatnonzero(self.depth >= DEEP * self.depth.max())

    @property
    def centre(self) -> FloatArray:
        """(3,) middle of the body, mm."""
        return self.centres[self.body].mean(axis=0)

    @cached_property
    def _pairs(self) -> tuple[IntArray, IntArray, FloatArray]:
        """Neighbouring voxels (26 each, every pair once) and their distance, mm."""
        first, second, length = [], [], []
        for step in np.ndindex(3, 3, 3):
            offset = np.array(step) - 1
            if tuple(offset) <= (0, 0, 0):
                continue
            # The grid has a margin, so that no neighbour is off it.
            neighbour = self._number[tuple((self._index + offset).T)]
            here = np.flatnonzero(neighbour >= 0)
            first.append(here)
            second.append(neighbour[here])
            length.append(np.full(len(here), self.spacing * float(np.linalg.norm(offset))))
        return np.concatenate(first), np.concatenate(second), np.concatenate(length)

    def _graph(self, weight: FloatArray) -> sparse.csr_matrix:
        a, b, _ = self._pairs
        return sparse.coo_matrix((weight, (a, b)), shape=(len(self.depth),) * 2).tocsr()

    @cached_property
    def distance(self) -> FloatArray:
        """(n,) length of the shortest way inside from the body to each voxel, mm."""
        return np.asarray(dijkstra(self._graph(self._pairs[2]), directed=False, indices=self.body, min_only=True))

    def distance_at(self, positions: FloatArray) -> FloatArray:
        """Length of the shortest way inside from the body to places (k, 3) on the wall, (k,) mm."""
        away, voxel = self._tree.query(positions, k=4)
        return np.asarray((self.distance[voxel] + away).min(axis=1))

    def depth_at(self, positions: FloatArray) -> FloatArray:
        """Distance of places (k, 3) inside from the wall, (k,) mm: that of the nearest voxel."""
        return self.depth[self._tree.query(positions)[1]]

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.centres)

    @cached_property
    def _before(self) -> IntArray:
        """(n,) the voxel before each on the way from the body that keeps to the middle: cost 1/depth^2 a mm."""
        a, b, length = self._pairs
        weight = length / (0.5 * (self.depth[a] + self.depth[b])) ** 2
        _, before, _ = dijkstra(
            self._graph(weight), directed=False, indices=self.body, min_only=True, return_predecessors=True
        )
        return np.asarray(before, np.int64)

    def way_from(self, tip: FloatArray) -> FloatArray:
        """The way from a tip to the body through the middle of the lumen, (k, 3) mm, tip first; voxel by voxel."""
        voxel = int(self._tree.query(tip)[1])
        way = [tip]
        while voxel >= 0:
            way.append(self.centres[voxel])
            voxel = int(self._before[voxel])
        return np.array(way)


def _voxels(surface: Surface, spacing: float) -> tuple[NDArray[np.bool_], FloatArray]:
    """Which voxels have their centre inside, indexed [i, j, k] along x, y, z, and the place of the first one."""
    low, high = surface.points.min(axis=0) - 2.0 * spacing, surface.points.max(axis=0) + 2.0 * spacing
    size = np.ceil((high - low) / spacing).astype(int) + 1
    stencil = vtkPolyDataToImageStencil()
    stencil.SetInputData(surface.to_polydata())
    stencil.SetOutputOrigin(*low)
    stencil.SetOutputSpacing(spacing, spacing, spacing)
    stencil.SetOutputWholeExtent(0, int(size[0]) - 1, 0, int(size[1]) - 1, 0, int(size[2]) - 1)
    image = vtkImageStencilToImage()
    image.SetInputConnection(stencil.GetOutputPort())
    image.SetInsideValue(1)
    image.SetOutsideValue(0)
    image.SetOutputScalarTypeToUnsignedChar()
    image.Update()
    flat = vtk_to_numpy(image.GetOutput().GetPointData().GetScalars())
    return flat.reshape(size[::-1]).transpose(2, 1, 0).astype(bool), low
