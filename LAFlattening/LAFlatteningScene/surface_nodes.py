"""The atrium as a model node, and what is kept of it while seeds move."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import slicer
import vtk
from vtk.util.numpy_support import vtk_to_numpy

from LAFlatteningLib import Flattener, Surface, SurfaceError
from LAFlatteningLib.anatomy import Anatomy
from LAFlatteningLib.cavity.covers import HOLE_ARRAY
from LAFlatteningLib.cavity.openings import Cavity, make_cavity, nearest_rim

from .template_text import templateOf

CELL_ID_ARRAY = "surface_cell_id"
"""Cell array of a map: the number of the triangle among the triangles of the surface node."""
NOWHERE = np.full((1, 3), 1e6)
"""A place near no rim: the longest rim is then taken for the outer one."""


@dataclass(frozen=True)
class Settings:
    """How a map is made, see `LAFlatteningLib.Flattener`; template as text (`template_text`), diskDiameter in mm."""

    template: str = "adapted1"
    method: str = "regional"
    checkAxes: bool = True
    diskDiameter: float = 100.0


def worldPoints(modelNode: slicer.vtkMRMLModelNode) -> np.ndarray:
    """The points of a model in RAS, mm, world coordinates, (n, 3): a copy, with all parent transforms applied."""
    polydata = modelNode.GetPolyData()
    if polydata is None or polydata.GetPoints() is None:
        return np.zeros((0, 3))
    return toWorld(polydata.GetPoints(), modelNode)


def toWorld(points: vtk.vtkPoints, node: slicer.vtkMRMLTransformableNode) -> np.ndarray:
    """Points of a node (RAS, mm) with all its parent transforms applied, (n, 3): a copy."""
    parent = node.GetParentTransformNode()
    if parent is None:
        return vtk_to_numpy(points.GetData()).astype(np.float64)
    transform = vtk.vtkGeneralTransform()
    slicer.vtkMRMLTransformNode.GetTransformBetweenNodes(parent, None, transform)
    return transformed(points, transform)


def transformed(points: vtk.vtkPoints, transform: vtk.vtkAbstractTransform) -> np.ndarray:
    """Points moved by a transform, (n, 3): a copy."""
    moved = vtk.vtkPoints()
    moved.SetDataTypeToDouble()
    transform.TransformPoints(points, moved)
    return vtk_to_numpy(moved.GetData()).copy()


def surfaceOf(modelNode: slicer.vtkMRMLModelNode | None) -> Surface:
    """The geometry of a model node as a surface of the library, RAS, mm, world; nothing is shared with the node.

    It carries the array ``hole`` that marks covers, where there is one, the number of each triangle, and that its axes
    are unknown, where it says so; the other arrays are taken from the node when a map is written, as they are then.

    Raises
    ------
    SurfaceError : no node, no triangles, or what `Surface` refuses.
    """
    if modelNode is None or modelNode.GetScene() is None:
        raise SurfaceError("No surface is selected. Expected a model of an atrium; select or load one.")
    polydata = modelNode.GetPolyData()
    if polydata is None or polydata.GetNumberOfPoints() == 0:
        raise SurfaceError(
            f'The surface "{modelNode.GetName()}" is empty. Expected a triangle mesh of an atrium; select another one.'
        )
    bare = vtk.vtkPolyData()
    bare.SetPoints(polydata.GetPoints())
    bare.SetPolys(polydata.GetPolys())
    bare.SetStrips(polydata.GetStrips())
    bare.SetFieldData(polydata.GetFieldData())
    checked = Surface.from_polydata(bare, "RAS")
    hole = polydata.GetPointData().GetArray(HOLE_ARRAY)
    surface = Surface(
        worldPoints(modelNode),
        checked.triangles.copy(),
        {} if hole is None else {HOLE_ARRAY: vtk_to_numpy(hole).copy()},
        {CELL_ID_ARRAY: np.arange(len(checked.triangles))},
        space="RAS",
    )
    return surface if checked.axes_known else surface.with_unknown_axes()


def sameGeometry(a: Surface, b: Surface) -> bool:
    """Whether two surfaces have the same points, triangles and covers."""
    return (
        np.array_equal(a.points, b.points)
        and np.array_equal(a.triangles, b.triangles)
        and a.point_data.keys() == b.point_data.keys()
        and all(np.array_equal(a.point_data[name], b.point_data[name]) for name in a.point_data)
    )


def fingerprint(surface: Surface, seeds: Mapping[str, np.ndarray], settings: Settings) -> str:
    """A text that changes when anything changes that a map depends on; survives saving and loading a scene.

    Lengths are rounded to 0.01 mm for that, since files hold fewer digits than memory.
    """
    digest = hashlib.sha256(repr(settings).encode())
    digest.update(np.round(surface.points, 2).tobytes() + surface.triangles.tobytes())
    for label in sorted(seeds):
        digest.update(label.encode() + (np.round(seeds[label], 2) + 0.0).tobytes())
    return digest.hexdigest()


class SurfaceCache:
    """The last surface that was worked on, with what does not change when a seed moves."""

    def __init__(self) -> None:
        self._surface: Surface | None = None
        self._flatteners: dict[Settings, Flattener] = {}
        self._cavity: tuple[str, Cavity] | None = None

    def surface(self, modelNode: slicer.vtkMRMLModelNode | None) -> Surface:
        """The surface of a node; the same object as long as its geometry is the same. Errors as `surfaceOf`."""
        surface = surfaceOf(modelNode)
        if self._surface is None or not sameGeometry(surface, self._surface):
            self.clear()
            self._surface = surface
        return self._surface

    def flattener(self, modelNode: slicer.vtkMRMLModelNode | None, settings: Settings) -> Flattener:
        """The flattener of a node. Errors as `surfaceOf`, and TemplateError."""
        surface = self.surface(modelNode)
        key = Settings(settings.template, settings.method, settings.checkAxes)
        if key not in self._flatteners:
            template, former = templateOf(settings.template), next(iter(self._flatteners.items()), None)
            if former is not None and (former[0].method, former[0].checkAxes) == (key.method, key.checkAxes):
                made = former[1].with_template(template)
            else:
                made = Flattener(surface, template, settings.method, check_axes=settings.checkAxes)
            # Only one: each keeps a factorisation and covers.
            self._flatteners = {key: made}
        return self._flatteners[key]

    def cavity(
        self, modelNode: slicer.vtkMRMLModelNode | None, anatomy: Anatomy, seeds: Mapping[str, np.ndarray]
    ) -> Cavity:
        """The covered openings of a node.

        Parameters
        ----------
        seeds : those placed so far; without one on the outer rim, the longest rim is taken for the outer one.

        Raises
        ------
        SurfaceError : as `make_cavity`.
        """
        surface = self.surface(modelNode)
        onRim = np.array([seeds[label] for label in anatomy.outer_seeds if label in seeds]).reshape(-1, 3)
        if self._cavity is not None and self._cavity[0] == anatomy.name:
            cavity = self._cavity[1]
            rims = [*cavity.rims, cavity.outer]
            if not len(onRim) or nearest_rim(cavity.surface, rims, onRim) == len(cavity.rims):
                return cavity
        self._cavity = (anatomy.name, make_cavity(surface, anatomy, onRim if len(onRim) else NOWHERE))
        return self._cavity[1]

    def clear(self) -> None:
        """Forget everything."""
        self._surface = None
        self._flatteners = {}
        self._cavity = None
