"""A map of the scene, and an atrium, as the analyses of the library read them."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
import slicer
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

from LAFlatteningLib import MapData, Parcellation, Surface, SurfaceError
from LAFlatteningLib.flattening.flat_map import POINT_ID_ARRAY, REGION_ARRAY
from LAFlatteningLib.map_data import seeds_in
from LAFlatteningLib.projection import Projection
from LAFlatteningLib.quantities import measured, unit_of

from .map_nodes import STAGE, SURFACE_ROLE, copyArrays, millimetresPerUnit, refuseCopy, settingsOf
from .result_nodes import FINGERPRINT
from .surface_nodes import CELL_ID_ARRAY, worldPoints
from .template_text import templateOf

ModelNode = slicer.vtkMRMLModelNode


def mapDataOf(mapNode: ModelNode | None) -> MapData:
    """A map with the places of its points on the atrium (RAS, mm, world) and the arrays that the atrium has now.

    Values that a mapping system exports for "not measured" are NaN.

    Raises
    ------
    SurfaceError : no map, a quick one, or the copy of one; its atrium is gone or another one.
    """
    if mapNode is None or mapNode.GetScene() is None or mapNode.GetAttribute(STAGE) is None:
        raise SurfaceError("There is no map. Flatten the atrium first.")
    refuseCopy(mapNode)
    if mapNode.GetAttribute(STAGE) != "map":
        raise SurfaceError(
            f'"{mapNode.GetName()}" is only a quick map, as made while something is moved. Press Flatten first.'
        )
    surfaceNode = mapNode.GetNodeReference(SURFACE_ROLE)
    if surfaceNode is None or surfaceNode.GetScene() is None:
        raise SurfaceError(
            f'The atrium of the map "{mapNode.GetName()}" is not in the scene, so that nothing can be measured on it. '
            "Load it, and flatten it again."
        )
    if not copyArrays(mapNode, surfaceNode):
        raise SurfaceError(
            f'The atrium "{surfaceNode.GetName()}" is no longer the one of which "{mapNode.GetName()}" is the map. '
            "Flatten it again."
        )
    polydata, settings = mapNode.GetPolyData(), settingsOf(mapNode)
    template = templateOf(settings.template)
    ids = vtk_to_numpy(polydata.GetPointData().GetArray(POINT_ID_ARRAY))
    flat = vtk_to_numpy(polydata.GetPoints().GetData())[:, :2] / millimetresPerUnit(template, settings.diskDiameter)
    triangles = vtk_to_numpy(polydata.GetPolys().GetConnectivityArray()).reshape(-1, 3).astype(np.int64)
    surface = Surface(
        worldPoints(surfaceNode)[ids],
        triangles,
        _scalars(polydata.GetPointData()),
        _scalars(polydata.GetCellData()),
        _field(surfaceNode.GetPolyData()),
        space="RAS",
    )
    if not settings.checkAxes:
        surface = surface.with_unknown_axes()
    seeds = seeds_in(_field(polydata))
    return MapData(surface, flat + np.asarray(template.outer.shape.centre), template, seeds=seeds)


def stateOf(mapNode: ModelNode | None, array: str) -> str:
    """A text that changes when a map does, or its places on the atrium, or an array. Errors as `mapDataOf`."""
    data = mapDataOf(mapNode)
    digest = hashlib.sha256(repr((mapNode.GetAttribute(FINGERPRINT), settingsOf(mapNode))).encode())
    for part in (data.surface.points, data.triangles, data.flat):
        digest.update(np.ascontiguousarray(part).tobytes())
    for arrays in (data.surface.point_data, data.surface.cell_data):
        for name in (array, REGION_ARRAY):
            if name in arrays:
                digest.update(name.encode() + arrays[name].tobytes())
    # How it was projected.
    digest.update(repr([(name, str(value)) for name, value in sorted(data.surface.field_data.items())]).encode())
    return digest.hexdigest()


def writeHow(polydata: vtk.vtkPolyData, array: str, found: Projection) -> None:
    """Say in the field data of an atrium how an array was projected, as the library does in files."""
    interval = numpy_to_vtk(np.array(found.interval_mm), deep=True)
    interval.SetName(f"{array}_interval_mm")
    statistic = vtk.vtkStringArray()
    statistic.SetName(f"{array}_statistic")
    statistic.InsertNextValue(found.statistic)
    for one in (interval, statistic):
        polydata.GetFieldData().AddArray(one)


def _field(polydata: vtk.vtkPolyData) -> dict[str, np.ndarray]:
    """The field data of an atrium, or of a map."""
    return dict(Surface.from_polydata(polydata, "RAS").field_data)


def withParcels(
    mapNode: ModelNode, surfaceNode: ModelNode, data: MapData, parcellations: Sequence[Parcellation]
) -> None:
    """Carry parcellations to an atrium, and so to its maps, as point and cell arrays; 0 where there is no part."""
    polydata = surfaceNode.GetPolyData()
    first = polydata.GetNumberOfVerts() + polydata.GetNumberOfLines()
    for parcellation in parcellations:
        carried = parcellation.carry(data)
        for arrays, own, ids, count, target in (
            (
                carried.point_data,
                data.surface.point_data,
                data.surface.point_data[POINT_ID_ARRAY],
                polydata.GetNumberOfPoints(),
                polydata.GetPointData(),
            ),
            (
                carried.cell_data,
                data.surface.cell_data,
                data.surface.cell_data[CELL_ID_ARRAY] + first,
                polydata.GetNumberOfCells(),
                polydata.GetCellData(),
            ),
        ):
            for name in arrays:
                if arrays[name] is own.get(name):
                    continue
                values = np.zeros(count, np.int32)
                values[ids] = arrays[name]
                array = numpy_to_vtk(values, deep=True)
                array.SetName(name)
                target.AddArray(array)
    if parcellations:
        polydata.Modified()
        copyArrays(mapNode, surfaceNode)


def _scalars(data: vtk.vtkFieldData) -> dict[str, np.ndarray]:
    """The arrays of single numbers, copied."""
    found = {}
    for k in range(data.GetNumberOfArrays()):
        array, name = data.GetArray(k), data.GetArrayName(k)
        if array is not None and name and array.GetNumberOfComponents() == 1:
            values = vtk_to_numpy(array)
            found[name] = measured(values) if unit_of(name) else values.copy()
    return found
