"""The map as a model node: its points and arrays, and its links with the atrium."""

from __future__ import annotations

import json

import numpy as np
import slicer
import vtk
from vtk.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy

from LAFlatteningLib import Anatomy, FlatMap, SurfaceError, Template
from LAFlatteningLib.flattening.flat_map import POINT_ID_ARRAY, REGION_ARRAY
from LAFlatteningLib.flattening.preview import Preview
from LAFlatteningLib.shading import REGION_COLOURS

from .quality_nodes import qualityNodesOf
from .result_nodes import FINGERPRINT, hideOutdated
from .surface_nodes import CELL_ID_ARRAY, Settings

SURFACE_ROLE, SEEDS_ROLE, MAP_ROLE = "LAFlattening.surface", "LAFlattening.seeds", "LAFlattening.map"
"""Node references: from a map to what it was made of, and from the surface to its maps."""
NOTES, STAGE, SETTINGS = (f"LAFlattening.{name}" for name in ("notes", "stage", "settings"))
"""Attributes of a map node: JSON list of notes, "preview" or "map", JSON of `Settings`."""
OWN_REGIONS = "LAFlattening.regionArray"
"""Attribute of a surface node whose region array was written by this module."""
COLOURS_NAME = "Left atrial regions"
COVER_GREY = (0.6, 0.6, 0.6)

ModelNode = slicer.vtkMRMLModelNode


def millimetresPerUnit(template: Template, diskDiameter: float) -> float:
    """mm on the map node for one map unit."""
    return diskDiameter / (2.0 * template.radius)


def onMap(points: np.ndarray, template: Template, diskDiameter: float) -> np.ndarray:
    """Map units (k, 2) to mm on the map node, (k, 2); the centre of the disk is the origin."""
    return (points - np.asarray(template.outer.shape.centre)) * millimetresPerUnit(template, diskDiameter)


def writeMap(
    mapNode: ModelNode, flatMap: FlatMap | Preview, surfaceNode: ModelNode, settings: Settings, stage: str
) -> None:
    """Put a map into its node: points in mm in the plane z = 0, triangles, regions, all arrays of the surface.

    Where only points have moved, they are moved in the same arrays, so that views need not build anything anew.
    Everything is copied, so that later changes of the node do not reach the library's results.
    """
    flat = onMap(flatMap.points, flatMap.template, settings.diskDiameter)
    points = np.column_stack([flat, np.zeros(len(flat))])
    polydata = mapNode.GetPolyData()
    modifying = mapNode.StartModify()
    try:
        if polydata is not None and _hasMesh(polydata, len(points), flatMap.triangles):
            vtk_to_numpy(polydata.GetPoints().GetData())[:] = points
            polydata.GetPoints().GetData().Modified()
            polydata.GetPoints().Modified()
            if stage == "map":
                _setArrays(polydata, flatMap, surfaceNode)
            else:
                regions = polydata.GetCellData().GetArray(REGION_ARRAY)
                vtk_to_numpy(regions)[:] = flatMap.regions
                regions.Modified()
            polydata.Modified()
        else:
            polydata = _mesh(points, flatMap.triangles)
            _setArrays(polydata, flatMap, surfaceNode)
            mapNode.SetAndObservePolyData(polydata)
        mapNode.SetAttribute(STAGE, stage)
        mapNode.SetAttribute(SETTINGS, json.dumps(settings.__dict__))
        if stage == "map":
            mapNode.SetAttribute(NOTES, json.dumps(list(flatMap.notes)))
            field = vtk.vtkFieldData()
            field.DeepCopy(flatMap.to_surface().to_polydata().GetFieldData())
            polydata.SetFieldData(field)
        else:
            # A quick map is never taken for the map of these seeds.
            mapNode.RemoveAttribute(FINGERPRINT)
            hideOutdated(mapNode)
    finally:
        mapNode.EndModify(modifying)


def copyArrays(mapNode: ModelNode, surfaceNode: ModelNode) -> bool:
    """Bring the arrays of a map up to date with those of its surface; False if they do not belong together."""
    source, target = surfaceNode.GetPolyData(), mapNode.GetPolyData()
    if source is None or target is None:
        return False
    pointIds, cellIds = (
        data.GetArray(name)
        for data, name in ((target.GetPointData(), POINT_ID_ARRAY), (target.GetCellData(), CELL_ID_ARRAY))
    )
    if pointIds is None or cellIds is None:
        return False
    pointIds, cellIds = vtk_to_numpy(pointIds), vtk_to_numpy(cellIds)
    if pointIds.max(initial=-1) >= source.GetNumberOfPoints() or cellIds.max(initial=-1) >= source.GetNumberOfPolys():
        return False
    first = source.GetNumberOfVerts() + source.GetNumberOfLines()
    kept = {POINT_ID_ARRAY, CELL_ID_ARRAY, REGION_ARRAY}
    _copy(source.GetPointData(), target.GetPointData(), pointIds, kept)
    _copy(source.GetCellData(), target.GetCellData(), cellIds + first, kept)
    target.Modified()
    return True


def writeRegions(surfaceNode: ModelNode, flatMap: FlatMap) -> None:
    """Put the regions on the surface too, 0 on covers; an array of the user's of that name stays as it is."""
    polydata = surfaceNode.GetPolyData()
    if polydata.GetCellData().HasArray(REGION_ARRAY) and surfaceNode.GetAttribute(OWN_REGIONS) is None:
        return
    if polydata.GetPointData().HasArray(REGION_ARRAY):
        return
    values = np.zeros(polydata.GetNumberOfCells(), np.int32)
    first = polydata.GetNumberOfVerts() + polydata.GetNumberOfLines()
    values[flatMap.surface.cell_data[CELL_ID_ARRAY] + first] = flatMap.regions
    present = polydata.GetCellData().GetArray(REGION_ARRAY)
    if present is not None and np.array_equal(vtk_to_numpy(present), values):
        return
    surfaceNode.SetAttribute(OWN_REGIONS, "1")
    polydata.GetCellData().AddArray(_named(numpy_to_vtk(values, deep=True), REGION_ARRAY))
    polydata.Modified()


def linkNodes(mapNode: ModelNode, surfaceNode: ModelNode, seedsNode: slicer.vtkMRMLMarkupsFiducialNode | None) -> None:
    """Node references from the map to surface and seeds, and from the surface back to the map."""
    former = mapNode.GetNodeReference(SURFACE_ROLE)
    if former is not None and former is not surfaceNode:
        for index in reversed(range(former.GetNumberOfNodeReferences(MAP_ROLE))):
            if former.GetNthNodeReferenceID(MAP_ROLE, index) == mapNode.GetID():
                former.RemoveNthNodeReferenceID(MAP_ROLE, index)
    mapNode.SetNodeReferenceID(SURFACE_ROLE, surfaceNode.GetID())
    mapNode.SetNodeReferenceID(SEEDS_ROLE, seedsNode.GetID() if seedsNode is not None else None)
    if mapNode not in mapsOf(surfaceNode):
        surfaceNode.AddNodeReferenceID(MAP_ROLE, mapNode.GetID())


def mapsOf(surfaceNode: ModelNode) -> list[ModelNode]:
    """The maps of a surface."""
    found = (
        surfaceNode.GetNthNodeReference(MAP_ROLE, k) for k in range(surfaceNode.GetNumberOfNodeReferences(MAP_ROLE))
    )
    return [node for node in found if node is not None]


def belongsTo(mapNode: ModelNode, surfaceNode: ModelNode) -> bool:
    """Whether a map is of a surface, or of none yet."""
    return mapNode.GetNodeReference(SURFACE_ROLE) in (None, surfaceNode)


def isMapOf(mapNode: ModelNode | None, surfaceNode: ModelNode | None) -> bool:
    """Whether a map shows a surface: it is linked with it, and holds points."""
    if mapNode is None or surfaceNode is None or mapNode.GetNodeReference(SURFACE_ROLE) is not surfaceNode:
        return False
    return mapNode.GetPolyData() is not None and mapNode.GetPolyData().GetNumberOfPoints() > 0


def isCopy(mapNode: ModelNode | None) -> bool:
    """Whether a node is the copy of a map (*Clone* in the module Data): it has the attributes of a map but no links.

    What tells it from a map whose atrium was deleted are the links with seeds, tables and charts.
    """
    if mapNode is None or mapNode.GetAttribute(STAGE) is None:
        return False
    linked = mapNode.GetNodeReference(SURFACE_ROLE), mapNode.GetNodeReference(SEEDS_ROLE), *qualityNodesOf(mapNode)
    return all(node is None for node in linked)


def refuseCopy(mapNode: ModelNode | None) -> None:
    """Raise SurfaceError if a node is the copy of a map."""
    if isCopy(mapNode):
        raise SurfaceError(
            f'"{mapNode.GetName()}" is a copy of a map, without the links with an atrium and without tables. Press '
            "Flatten to make it a map of the present atrium and seeds, or choose another map."
        )


def settingsOf(mapNode: ModelNode) -> Settings:
    """How a map was made; the defaults for a node that does not say."""
    text = mapNode.GetAttribute(SETTINGS)
    return Settings(**json.loads(text)) if text else Settings()


def groupNodes(surfaceNode: ModelNode, nodes: list[slicer.vtkMRMLNode]) -> None:
    """Put nodes below the surface in the subject hierarchy.

    Nodes that the user has put elsewhere stay there.
    """
    hierarchy = slicer.vtkMRMLSubjectHierarchyNode.GetSubjectHierarchyNode(surfaceNode.GetScene())
    if hierarchy is None:
        return

    def item(node: slicer.vtkMRMLNode) -> int:
        # Slicer's plugins make items by themselves; without them they are made here.
        return hierarchy.GetItemByDataNode(node) or hierarchy.CreateItem(hierarchy.GetSceneItemID(), node)

    parent = item(surfaceNode)
    for node in nodes:
        child = item(node)
        if hierarchy.GetItemParent(child) == hierarchy.GetSceneItemID():
            hierarchy.SetItemParent(child, parent)


def regionColours(scene: slicer.vtkMRMLScene, anatomy: Anatomy) -> slicer.vtkMRMLColorTableNode:
    """A colour table with the name of each region; 0, on covers, is grey."""
    name = f"{COLOURS_NAME} ({anatomy.name})"
    node = scene.GetFirstNode(name, "vtkMRMLColorTableNode")
    if node is not None:
        return node
    node = scene.AddNewNodeByClass("vtkMRMLColorTableNode", name)
    node.SetTypeToUser()
    node.SetHideFromEditors(False)
    last = max(anatomy.regions)
    node.SetNumberOfColors(last + 1)
    node.GetLookupTable().SetTableRange(0, last)
    node.SetColor(0, "cover", *COVER_GREY, 1.0)
    for k, number in enumerate(sorted(anatomy.regions)):
        red, green, blue = (int(REGION_COLOURS[k % len(REGION_COLOURS)][i : i + 2], 16) / 255.0 for i in (1, 3, 5))
        node.SetColor(number, f"R{number} {anatomy.region_names[number]}", red, green, blue, 1.0)
    return node


def prepareDisplay(mapNode: ModelNode) -> slicer.vtkMRMLModelDisplayNode:
    """The display node of a map: flat, without light, visible from both sides."""
    if mapNode.GetDisplayNode() is None:
        mapNode.CreateDefaultDisplayNodes()
        display = mapNode.GetDisplayNode()
        display.SetLighting(False)
        display.SetBackfaceCulling(False)
        display.SetVisibility2D(False)
    return mapNode.GetDisplayNode()


def _mesh(points: np.ndarray, triangles: np.ndarray) -> vtk.vtkPolyData:
    polydata = vtk.vtkPolyData()
    vtkPoints = vtk.vtkPoints()
    vtkPoints.SetData(numpy_to_vtk(points, deep=True))
    polydata.SetPoints(vtkPoints)
    cells = vtk.vtkCellArray()
    cells.SetData(
        numpy_to_vtkIdTypeArray(np.arange(0, 3 * len(triangles) + 1, 3, dtype=np.int64), deep=True),
        numpy_to_vtkIdTypeArray(np.ascontiguousarray(triangles).reshape(-1), deep=True),
    )
    polydata.SetPolys(cells)
    return polydata


def _hasMesh(polydata: vtk.vtkPolyData, count: int, triangles: np.ndarray) -> bool:
    """Whether a node's mesh already has these triangles, and points that can be moved in place."""
    return (
        polydata.GetNumberOfPoints() == count
        and polydata.GetNumberOfPolys() == len(triangles)
        and polydata.GetPoints().GetDataType() == vtk.VTK_DOUBLE
        and polydata.GetCellData().HasArray(REGION_ARRAY)
        and np.array_equal(vtk_to_numpy(polydata.GetPolys().GetConnectivityArray()), triangles.reshape(-1))
    )


def _setArrays(polydata: vtk.vtkPolyData, flatMap: FlatMap | Preview, surfaceNode: ModelNode) -> None:
    """All arrays of a map: links, regions, those of the surface."""
    source = surfaceNode.GetPolyData()
    pointIds = flatMap.surface.point_data[POINT_ID_ARRAY]
    cellIds = flatMap.surface.cell_data[CELL_ID_ARRAY]
    own = {POINT_ID_ARRAY: pointIds}
    first = source.GetNumberOfVerts() + source.GetNumberOfLines()
    _copy(source.GetPointData(), polydata.GetPointData(), pointIds, set(own))
    for name, values in own.items():
        polydata.GetPointData().AddArray(_named(numpy_to_vtk(values, deep=True), name))
    ownCells = {CELL_ID_ARRAY: cellIds, REGION_ARRAY: flatMap.regions.astype(np.int32)}
    _copy(source.GetCellData(), polydata.GetCellData(), cellIds + first, set(ownCells))
    for name, values in ownCells.items():
        polydata.GetCellData().AddArray(_named(numpy_to_vtk(values, deep=True), name))


def _copy(source: vtk.vtkFieldData, target: vtk.vtkFieldData, ids: np.ndarray, kept: set[str]) -> None:
    """Make the arrays of `target` those of `source` at some ids, but for some names that stay as they are."""
    names = {source.GetArrayName(k) for k in range(source.GetNumberOfArrays())} - {None}
    for name in [target.GetArrayName(k) for k in range(target.GetNumberOfArrays())]:
        if name not in names | kept:
            target.RemoveArray(name)
    for name in names - kept:
        array = source.GetAbstractArray(name)
        if array.IsNumeric():
            part = numpy_to_vtk(vtk_to_numpy(array)[ids], deep=True, array_type=array.GetDataType())
            for component in range(array.GetNumberOfComponents()):
                if array.GetComponentName(component):
                    part.SetComponentName(component, array.GetComponentName(component))
        else:
            part = array.NewInstance()
            part.SetNumberOfComponents(array.GetNumberOfComponents())
            part.SetNumberOfTuples(len(ids))
            for row, k in enumerate(ids):
                part.SetTuple(row, int(k), array)
        target.AddArray(_named(part, name))


def _named(array: vtk.vtkAbstractArray, name: str) -> vtk.vtkAbstractArray:
    array.SetName(name)
    return array
