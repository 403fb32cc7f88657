"""A triangle surface: arrays, and the topology and operators of the mesh, computed when first asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkPoints, vtkStringArray
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkDataSetAttributes, vtkFieldData, vtkPolyData

from . import operators, topology
from .errors import SurfaceError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Array = NDArray

AXES_FIELD, UNKNOWN = "patient_axes", "unknown"
"""Field array of surfaces whose coordinates are not the patient's axes, and what it holds. It travels with them."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A surface of triangles, with the data that lives on it.

    Attributes
    ----------
    points : (n, 3) float64, mm.
    triangles : (m, 3) int64 point ids, counter-clockwise seen from outside.
    point_data, cell_data : arrays by name; first axis n, or m.
    field_data : arrays by name, of any length: numbers, or strings as an object array.
    space : "LPS" or "RAS", the patient axes of `points`; or, where these are not the patient's (`axes_known`), only
        what files and 3D Slicer take them for.

    Everything else is derived and cached; the arrays are read-only, and a changed surface is a new object
    (`with_triangles`, `submesh`).

    Raises
    ------
    SurfaceError : arrays of the wrong shape, ids out of range, NaN or infinite points, no triangles.

    Examples
    --------
    >>> import numpy as np
    >>> tetrahedron = Surface(np.eye(4)[:, :3], np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]]))
    >>> tetrahedron.genus, len(tetrahedron.boundary_loops)
    (0, 0)
    """

    points: FloatArray
    triangles: IntArray
    point_data: Mapping[str, Array] = field(default_factory=dict)
    cell_data: Mapping[str, Array] = field(default_factory=dict)
    field_data: Mapping[str, Array] = field(default_factory=dict)
    space: str = "LPS"

    def __post_init__(self) -> None:
        points = np.ascontiguousarray(self.points, dtype=np.float64)
        triangles = np.ascontiguousarray(self.triangles, dtype=np.int64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise SurfaceError(f"Expected points as an (n, 3) array, found shape {points.shape}.")
        if len(triangles) == 0:
            raise SurfaceError(
                "The surface has no triangles. Expected a triangle mesh of an atrium; "
                "a point cloud or a set of lines cannot be flattened."
            )
        if triangles.ndim != 2 or triangles.shape[1] != 3:
            raise SurfaceError(f"Expected triangles as an (m, 3) array, found shape {triangles.shape}.")
        if triangles.min() < 0 or triangles.max() >= len(points):
            raise SurfaceError(
                f"Triangles refer to point {triangles.max() if triangles.min() >= 0 else triangles.min()}, "
                f"but the points are numbered 0 to {len(points) - 1}. The file is damaged; export it again."
            )
        finite = np.isfinite(points).all(axis=1)
        if not finite.all():
            raise SurfaceError(
                f"{np.count_nonzero(~finite)} of {len(points)} points have coordinates that are not a number "
                f"(the first is point {int(np.flatnonzero(~finite)[0])}). Remove them or export the surface again."
            )
        if self.space not in ("LPS", "RAS"):
            raise SurfaceError(f'Expected space "LPS" or "RAS", found "{self.space}".')
        for name, data, length in [
            ("point", self.point_data, len(points)),
            ("cell", self.cell_data, len(triangles)),
        ]:
            for key, values in data.items():
                if len(values) != length:
                    raise SurfaceError(
                        f'The {name} array "{key}" has {len(values)} entries, expected {length}, one for each {name}.'
                    )
        # Read-only views: the caller's own arrays stay as they are.
        points, triangles = points.view(), triangles.view()
        points.flags.writeable = False
        triangles.flags.writeable = False
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "triangles", triangles)
        object.__setattr__(self, "point_data", dict(self.point_data))
        object.__setattr__(self, "cell_data", dict(self.cell_data))
        object.__setattr__(self, "field_data", dict(self.field_data))

    # ---- topology -------------------------------------------------------------------------------------------

    @cached_property
    def edges(self) -> topology.Edges:
        """Undirected edges, see `topology.Edges`."""
        return topology.edges(self.triangles)

    @cached_property
    def edge_keys(self) -> IntArray:
        """(e,) one number an edge, rising: smaller id times the number of points, plus larger id."""
        return self.edges.points[:, 0] * len(self.points) + self.edges.points[:, 1]

    @cached_property
    def boundary_loops(self) -> list[IntArray]:
        """Rims as ordered point ids, longest first, surface on their left; see `topology.boundary_loops`."""
        return topology.boundary_loops(self.triangles, self.edges)

    @cached_property
    def used_points(self) -> NDArray[np.bool_]:
        """(n,) whether any triangle uses the point."""
        return np.bincount(self.triangles.reshape(-1), minlength=len(self.points)) > 0

    @cached_property
    def components(self) -> IntArray:
        """(m,) component number of each triangle, 0 the largest by number of triangles."""
        label = topology.triangle_components(self.triangles, self.edges)
        by_size = np.argsort(-np.bincount(label), kind="stable")
        rank = np.empty_like(by_size)
        rank[by_size] = np.arange(len(by_size))
        return rank[label]

    @property
    def component_count(self) -> int:
        """Number of pieces connected through edges."""
        return int(self.components.max()) + 1

    @cached_property
    def non_manifold_points(self) -> IntArray:
        """Ids of points where the surface is not a disk (or, at a rim, half a disk)."""
        return topology.non_manifold_points(self.triangles, self.edges)

    @property
    def is_manifold(self) -> bool:
        """Whether every point has one fan of triangles and every edge one or two triangles."""
        return len(self.non_manifold_points) == 0

    @cached_property
    def is_oriented(self) -> bool:
        """Whether neighbouring triangles turn the same way."""
        return topology.is_oriented(self.triangles, self.edges)

    @property
    def euler_characteristic(self) -> int:
        """Points minus edges plus triangles."""
        return int(self.used_points.sum()) - len(self.edges.points) + len(self.triangles)

    @property
    def genus(self) -> int:
        """Number of handles, over all components together (meaningful for an oriented manifold)."""
        return (2 * self.component_count - len(self.boundary_loops) - self.euler_characteristic) // 2

    # ---- geometry -------------------------------------------------------------------------------------------

    @cached_property
    def triangle_areas(self) -> FloatArray:
        """(m,) mm2."""
        return operators.triangle_areas(self.points, self.triangles)

    @property
    def area(self) -> float:
        """Area of the surface, mm2."""
        return float(self.triangle_areas.sum())

    @cached_property
    def edge_lengths(self) -> FloatArray:
        """(e,) mm, in the order of `edges`."""
        a, b = self.edges.points.T
        return np.linalg.norm(self.points[a] - self.points[b], axis=1)

    @cached_property
    def point_normals(self) -> FloatArray:
        """(n, 3) unit normals, outward where the triangles are."""
        return operators.point_normals(self.points, self.triangles)

    @cached_property
    def laplacian(self) -> sparse.csr_matrix:
        """(n, n) cotangent Laplacian, positive semi-definite, see `operators.cotangent_laplacian`."""
        return operators.cotangent_laplacian(self.points, self.triangles)

    @cached_property
    def mass(self) -> FloatArray:
        """(n,) area belonging to each point, mm2, see `operators.lumped_mass`."""
        return operators.lumped_mass(self.points, self.triangles)

    @cached_property
    def edge_graph(self) -> sparse.csr_matrix:
        """(n, n) symmetric sparse matrix of edge lengths, mm: the graph that edge paths run on."""
        a, b = self.edges.points.T
        n = len(self.points)
        half = sparse.coo_matrix((self.edge_lengths, (a, b)), shape=(n, n))
        return (half + half.T).tocsr()

    @property
    def lps_signs(self) -> FloatArray:
        """(3,) factors by which coordinates of `points`, and directions, become those in LPS."""
        return np.array([1.0, 1.0, 1.0]) if self.space == "LPS" else np.array([-1.0, -1.0, 1.0])

    @property
    def axes_known(self) -> bool:
        """Whether the coordinates are the patient's axes, as far as is known."""
        return UNKNOWN not in np.asarray(self.field_data.get(AXES_FIELD, ()), dtype=object).reshape(-1).tolist()

    @property
    def axes_name(self) -> str:
        """The patient axes of `points` for people and reports: "LPS", "RAS" or "unknown"."""
        return self.space if self.axes_known else UNKNOWN

    @property
    def capped(self) -> tuple[FloatArray, IntArray]:
        """Points and triangles of the surface with each opening covered by a fan to the centre of its rim; the
        centres come after the points of the surface, the fans after its triangles."""
        points, triangles = [self.points], [self.triangles]
        for k, loop in enumerate(self.boundary_loops):
            points.append(self.points[loop].mean(axis=0, keepdims=True))
            centre = np.full(len(loop), len(self.points) + k)
            triangles.append(np.column_stack([np.roll(loop, -1), loop, centre]))
        return np.concatenate(points), np.concatenate(triangles)

    @property
    def enclosed_volume(self) -> float:
        """Volume inside the surface, mm3, each opening `capped`; positive where triangles face outwards."""
        return operators.signed_volume(*self.capped)

    def loop_length(self, loop: IntArray) -> float:
        """Length of a closed line of point ids, mm: the perimeter of a rim."""
        return float(np.linalg.norm(self.points[loop] - self.points[np.roll(loop, -1)], axis=1).sum())

    # ---- changed copies -------------------------------------------------------------------------------------

    def with_unknown_axes(self) -> Surface:
        """The same surface, marked as one whose coordinates are not the patient's axes."""
        if not self.axes_known:
            return self
        return self.with_data(field_data={AXES_FIELD: np.array([UNKNOWN], dtype=object)})

    def with_space(self, space: str) -> Surface:
        """The same coordinates as those in "LPS" or "RAS", whatever was said of them before."""
        kept = {name: values for name, values in self.field_data.items() if name != AXES_FIELD}
        return replace(self, field_data=kept, space=space)

    def with_triangles(self, triangles: IntArray) -> Surface:
        """The same points and data with other triangles, as many and in the same order (flipped, reversed)."""
        return replace(self, triangles=triangles)

    def with_data(
        self,
        point_data: Mapping[str, Array] | None = None,
        cell_data: Mapping[str, Array] | None = None,
        field_data: Mapping[str, Array] | None = None,
    ) -> Surface:
        """The same mesh with more (or replaced) arrays."""
        return replace(
            self,
            point_data={**self.point_data, **(point_data or {})},
            cell_data={**self.cell_data, **(cell_data or {})},
            field_data={**self.field_data, **(field_data or {})},
        )

    def submesh(self, keep: NDArray[np.bool_]) -> tuple[Surface, IntArray]:
        """The part of the surface made of some triangles, and the ids that its points had.

        Parameters
        ----------
        keep : (m,) which triangles stay. Points that no kept triangle uses are dropped; order is kept.

        Returns
        -------
        part : Surface with the data of the kept points and triangles.
        ids : (points of the part,) ids in this surface.
        """
        triangles = self.triangles[keep]
        if len(triangles) == 0:
            raise SurfaceError("No triangle is left of the surface. Check which part was to be kept.")
        ids = np.unique(triangles)
        new_id = np.full(len(self.points), -1, np.int64)
        new_id[ids] = np.arange(len(ids))
        part = Surface(
            self.points[ids],
            new_id[triangles],
            {name: values[ids] for name, values in self.point_data.items()},
            {name: values[keep] for name, values in self.cell_data.items()},
            self.field_data,
            self.space,
        )
        return part, ids

    # ---- VTK ------------------------------------------------------------------------------------------------

    @classmethod
    def from_polydata(cls, polydata: vtkPolyData, space: str = "LPS") -> Surface:
        """Read a vtkPolyData, with all point, cell and field arrays.

        Polygons and strips of more than three corners are refused rather than cut, because cell arrays would
        lose their meaning. Lines and vertices beside the triangles are left out. Arrays are shared with the
        vtkPolyData where their type allows (float64 points, numeric arrays); keep it unchanged while in use.

        Raises
        ------
        SurfaceError : no triangles, polygons that are not triangles, NaN points.
        """
        if polydata.GetNumberOfPolys() == 0:
            raise SurfaceError(
                f"The surface has no triangles (found {polydata.GetNumberOfPoints()} points, "
                f"{polydata.GetNumberOfLines()} lines, {polydata.GetNumberOfStrips()} triangle strips). "
                "Expected a triangle mesh of an atrium."
            )
        polys = polydata.GetPolys()
        triangles = triangles_of_cells(
            vtk_to_numpy(polys.GetOffsetsArray()), vtk_to_numpy(polys.GetConnectivityArray())
        )
        points = vtk_to_numpy(polydata.GetPoints().GetData())
        # Cells are numbered vertices, lines, polygons, strips.
        first = polydata.GetNumberOfVerts() + polydata.GetNumberOfLines()
        cells = slice(first, first + len(triangles))
        return cls(
            points,
            triangles,
            _arrays_from_vtk(polydata.GetPointData()),
            {name: values[cells] for name, values in _arrays_from_vtk(polydata.GetCellData()).items()},
            _arrays_from_vtk(polydata.GetFieldData()),
            space,
        )

    def to_polydata(self) -> vtkPolyData:
        """A vtkPolyData with the same points, triangles and arrays; points and numeric arrays are shared, not
        copied."""
        polydata = vtkPolyData()
        points = vtkPoints()
        points.SetData(numpy_to_vtk(self.points))
        polydata.SetPoints(points)
        cells = vtkCellArray()
        offsets = np.arange(0, 3 * len(self.triangles) + 1, 3, dtype=np.int64)
        cells.SetData(
            numpy_to_vtkIdTypeArray(offsets, deep=True), numpy_to_vtkIdTypeArray(self.triangles.reshape(-1), deep=True)
        )
        polydata.SetPolys(cells)
        _arrays_to_vtk(self.point_data, polydata.GetPointData())
        _arrays_to_vtk(self.cell_data, polydata.GetCellData())
        _arrays_to_vtk(self.field_data, polydata.GetFieldData())
        return polydata


def triangles_of_cells(offsets: IntArray, corners: IntArray) -> IntArray:
    """Polygons as VTK stores them, taken for triangles.

    Parameters
    ----------
    offsets : (m + 1,) where the corners of each polygon begin, and where those of the last end.
    corners : (offsets[-1],) point ids.

    Raises
    ------
    SurfaceError : not all of them are triangles.
    """
    sizes = np.diff(offsets)
    if (sizes != 3).any():
        raise SurfaceError(
            f"{np.count_nonzero(sizes != 3)} of {len(sizes)} faces are not triangles "
            f"(one has {sizes[sizes != 3][0]} corners). Triangulate the surface first "
            "(in Slicer: Surface Toolbox)."
        )
    return corners.reshape(-1, 3)


def _arrays_from_vtk(attributes: vtkFieldData) -> dict[str, Array]:
    result: dict[str, Array] = {}
    for index in range(attributes.GetNumberOfArrays()):
        array = attributes.GetAbstractArray(index)
        name = array.GetName() or f"array_{index}"
        if isinstance(array, vtkStringArray):
            values = [array.GetValue(i) for i in range(array.GetNumberOfValues())]
            result[name] = np.array(values, dtype=object)
        elif array.IsNumeric():
            result[name] = vtk_to_numpy(array)
    return result


def _arrays_to_vtk(arrays: Mapping[str, Array], attributes: vtkFieldData | vtkDataSetAttributes) -> None:
    for name, values in arrays.items():
        if values.dtype.kind in "OUS":
            array = vtkStringArray()
            for value in values:
                array.InsertNextValue(str(value))
        else:
            if values.dtype == bool:
                values = values.astype(np.uint8)
            array = numpy_to_vtk(np.ascontiguousarray(values))
        array.SetName(name)
        attributes.AddArray(array)
