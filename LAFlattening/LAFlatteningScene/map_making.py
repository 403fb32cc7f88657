"""From nodes to a map with everything that belongs to it: all of it or nothing."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import slicer
from vtk import vtkAssignAttribute

from LAFlatteningLib import FlatMap, SeedError, SurfaceError
from LAFlatteningLib.flattening.flat_map import REGION_ARRAY
from LAFlatteningLib.progress import ProgressCallback, report

from .display_link import followColours
from .long_action import longAction
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

MAKING = "the map was being made"


def makeMap(
    logic: LAFlatteningLogic,
    surfaceNode: ModelNode | None,
    seedsNode: slicer.vtkMRMLMarkupsFiducialNode | None,
    mapNode: ModelNode | None,
    settings: Settings,
    progress: ProgressCallback | None,
) -> ModelNode:
    """See `LAFlatteningLogic.flatten`. No node changes before the map is there."""
    with longAction(logic, MAKING, progress) as action:
        flattener = logic.cache.flattener(surfaceNode, settings)
        if seedsNode is None or seedsNode.GetScene() is None:
            raise SeedError("No seeds are selected. Select or create seeds, and place them.")
        checkOutput(mapNode)
        # Seeds may move meanwhile: the map says of which it is, and is followed by another one.
        seeds = seedPositions(seedsNode)
        action.read(lambda: sameGeometry(surfaceOf(surfaceNode), flattener.surface), surfaceNode, seedsNode, mapNode)
        flatMap = flattener.flatten(seeds, action.progress)
        # Everything that takes long, before anything is written.
        _ = flatMap.metrics
        report(action.progress, 1.0, "Done")
        action.check()
        madeFrom = fingerprint(flattener.surface, seeds, settings)
        return _write(flatMap, surfaceNode, seedsNode, mapNode, settings, madeFrom)


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
