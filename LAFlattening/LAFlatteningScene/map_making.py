"""From nodes to a map with everything that belongs to it: all of it or nothing."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import slicer
from vtk import vtkAssignAttribute

from LAFlatteningLib import Cancelled, FlatMap, SeedError, SurfaceError
from LAFlatteningLib.flattening.flat_map import REGION_ARRAY
from LAFlatteningLib.progress import ProgressCallback

from .display_link import followColours
from .map_nodes import (
    NOTES,
    SEEDS_ROLE,
    STAGE,
    belongsTo,
    groupNodes,
    linkNodes,
    mapsOf,
    prepareDisplay,
    regionColours,
    writeMap,
    writeRegions,
)
from .overlay import updateOverlay
from .quality_nodes import writeQuality
from .result_nodes import FINGERPRINT, hideOutdated
from .seed_nodes import seedPositions
from .surface_nodes import Settings, fingerprint, sameGeometry, surfaceOf

if TYPE_CHECKING:
    from LAFlattening import LAFlatteningLogic, LAFlatteningParameterNode

ModelNode = slicer.vtkMRMLModelNode


def makeMap(
    logic: LAFlatteningLogic,
    surfaceNode: ModelNode | None,
    seedsNode: slicer.vtkMRMLMarkupsFiducialNode | None,
    mapNode: ModelNode | None,
    settings: Settings,
    progress: ProgressCallback | None,
) -> ModelNode:
    """See `LAFlatteningLogic.flatten`. No node changes before the map is there."""
    flattener = logic.cache.flattener(surfaceNode, settings)
    if seedsNode is None or seedsNode.GetScene() is None:
        raise SeedError("No seeds are selected. Select or create seeds, and place them.")
    checkOutput(mapNode)
    if logic.isBusy:
        raise Cancelled("Another map is being made; wait for it, or cancel it.")
    nodes = [node for node in (surfaceNode, seedsNode, mapNode) if node is not None]
    seeds = seedPositions(seedsNode)

    def checkNodes() -> None:
        if any(node.GetScene() is None for node in nodes):
            raise Cancelled("The surface, the seeds or the map were deleted while the map was being made.")

    def watch(share: float, text: str) -> bool | None:
        answer = progress(share, text) if progress is not None else None
        checkNodes()
        return answer

    logic.isBusy = True
    try:
        flatMap = flattener.flatten(seeds, watch)
        # Everything that takes long, before anything is written.
        _ = flatMap.metrics
        watch(1.0, "Done")
        if not sameGeometry(surfaceOf(surfaceNode), flattener.surface):
            raise Cancelled("The surface was changed while the map was being made. Make it again.")
    finally:
        logic.isBusy = False
    return _write(flatMap, surfaceNode, seedsNode, mapNode, settings, fingerprint(flattener.surface, seeds, settings))


def checkOutput(mapNode: ModelNode | None) -> None:
    """Refuse to write a map over a model that is none, such as the atrium itself.

    Raises
    ------
    SurfaceError : the model has a mesh that this module has not made.
    """
    polydata = mapNode.GetPolyData() if mapNode is not None else None
    if polydata is not None and polydata.GetNumberOfPoints() and mapNode.GetAttribute(STAGE) is None:
        raise SurfaceError(
            f'"{mapNode.GetName()}" is not a map and would be lost. Choose a map to replace, or none to make a new one.'
        )


def chooseMap(parameterNode: LAFlatteningParameterNode) -> None:
    """Leave the map of another atrium alone: take the newest map of this one and its seeds, or none."""
    p, mapNode = parameterNode, parameterNode.map
    if p.surface is None or mapNode is None or belongsTo(mapNode, p.surface):
        return
    own = mapsOf(p.surface)
    p.map = own[-1] if own else None
    seeds = own[-1].GetNodeReference(SEEDS_ROLE) if own else None
    if seeds is not None:
        p.seeds = seeds


def _write(
    flatMap: FlatMap,
    surfaceNode: ModelNode,
    seedsNode: slicer.vtkMRMLMarkupsFiducialNode,
    mapNode: ModelNode | None,
    settings: Settings,
    madeFrom: str,
) -> ModelNode:
    scene = surfaceNode.GetScene()
    if mapNode is None:
        mapNode = scene.AddNewNodeByClass("vtkMRMLModelNode", scene.GenerateUniqueName(f"{surfaceNode.GetName()} map"))
    isNew = mapNode.GetDisplayNode() is None
    writeMap(mapNode, flatMap, surfaceNode, settings, "map")
    mapNode.SetAttribute(FINGERPRINT, madeFrom)
    hideOutdated(mapNode)
    writeRegions(surfaceNode, flatMap)
    linkNodes(mapNode, surfaceNode, seedsNode)
    display = prepareDisplay(mapNode)
    if surfaceNode.GetDisplayNode() is None:
        surfaceNode.CreateDefaultDisplayNodes()
    if surfaceNode.GetDisplayNode().GetScalarVisibility():
        followColours(surfaceNode, mapNode)
    elif isNew:
        # Nothing is shown on the atrium: the regions say most, on both.
        colours = regionColours(scene, flatMap.template.anatomy)
        display.SetActiveScalar(REGION_ARRAY, vtkAssignAttribute.CELL_DATA)
        display.SetAndObserveColorNodeID(colours.GetID())
        display.SetScalarRangeFlag(display.UseManualScalarRange)
        display.SetScalarRange(0, max(flatMap.template.anatomy.regions))
        display.SetScalarVisibility(True)
        followColours(mapNode, surfaceNode)
    quality = writeQuality(mapNode, flatMap, settings.diskDiameter)
    groupNodes(surfaceNode, [mapNode, seedsNode, *quality, *updateOverlay(mapNode)])
    return mapNode


def notesOf(mapNode: ModelNode) -> list[str]:
    """The notes of the library about a map."""
    return json.loads(mapNode.GetAttribute(NOTES) or "[]")
