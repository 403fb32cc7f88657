"""The nodes that hold what was found on a map: made, found again, and removed with it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import slicer
import vtk
from vtk.util.numpy_support import numpy_to_vtk

RESULT_ROLE = "LAFlattening.results"
"""Node reference from a map to each of its results."""
FINGERPRINT = "LAFlattening.fingerprint"
"""Attribute of a map: what it was made from; absent while it is a quick one."""
MADE_FOR, HIDDEN = "LAFlattening.madeFor", "LAFlattening.hiddenAsOutdated"
"""Attributes of a result: the fingerprint of the map when it was measured; hidden because that has changed."""
OF_ARRAY, OTHER_VALUES = "LAFlattening.measuredArray", "other values"
"""Attribute of a result: the array of the atrium that it was read off; and what `MADE_FOR` says where that has other
values now."""
COMPARED_WITH, OTHER_MADE_FOR, OTHER_ARRAY = (
    "LAFlattening.comparedWith",
    "LAFlattening.otherMadeFor",
    "LAFlattening.otherArray",
)
"""Node reference from a result to a second map that it is of; attributes: that map's fingerprint and array then."""
KIND, ON_MAP = "LAFlattening.result", "LAFlattening.onMap"
"""Attributes of a result: what it is, and whether it is drawn on the map (and not on the atrium)."""

ModelNode = slicer.vtkMRMLModelNode


def resultsOf(mapNode: ModelNode, kind: str | None = None) -> list[slicer.vtkMRMLNode]:
    """The results of a map, all or of one kind, as far as they are in the scene."""
    found = (mapNode.GetNthNodeReference(RESULT_ROLE, k) for k in range(mapNode.GetNumberOfNodeReferences(RESULT_ROLE)))
    return [node for node in found if node is not None and kind in (None, node.GetAttribute(KIND))]


def resultOf(mapNode: ModelNode | None, kind: str) -> slicer.vtkMRMLNode | None:
    """The first result of a kind; None if there is none."""
    found = resultsOf(mapNode, kind) if mapNode is not None else []
    return found[0] if found else None


def drawnOnMap(mapNode: ModelNode) -> list[slicer.vtkMRMLNode]:
    """The results that are drawn on the map."""
    return [node for node in resultsOf(mapNode) if node.GetAttribute(ON_MAP)]


def addResult(mapNode: ModelNode, kind: str, className: str, name: str, onMap: bool = False) -> slicer.vtkMRMLNode:
    """A new node that holds a result of a map, saved with the scene and removed with the map."""
    scene = mapNode.GetScene()
    node = scene.CreateNodeByClass(className)
    node.UnRegister(None)
    node.SetName(scene.GenerateUniqueName(name))
    node.SetAttribute(KIND, kind)
    if onMap:
        node.SetAttribute(ON_MAP, "1")
    # Known as belonging to the map before anything that looks after views sees it.
    stamp(mapNode, node)
    scene.AddNode(node)
    mapNode.AddNodeReferenceID(RESULT_ROLE, node.GetID())
    return node


def hideOutdated(mapNode: ModelNode) -> None:
    """Hide what is drawn on a map that has changed since, and on its atrium, and show it again where the map is as it
    was."""
    for node in resultsOf(mapNode):
        if not (node.IsA("vtkMRMLModelNode") or node.IsA("vtkMRMLMarkupsNode")):
            continue
        if isCurrent(mapNode, node):
            # Only what was hidden here is shown here: the user may have hidden more.
            if node.GetAttribute(HIDDEN):
                node.RemoveAttribute(HIDDEN)
                node.SetDisplayVisibility(True)
        elif node.GetDisplayNode() is not None and node.GetDisplayVisibility():
            node.SetAttribute(HIDDEN, "1")
            node.SetDisplayVisibility(False)


def isCurrent(mapNode: ModelNode, result: slicer.vtkMRMLNode) -> bool:
    """Whether a result is of the map as it is now, and of the map that it was compared with, where that is left."""
    other = result.GetNodeReference(COMPARED_WITH)
    isOfOther = other is None or result.GetAttribute(OTHER_MADE_FOR) == (other.GetAttribute(FINGERPRINT) or "")
    return isOfOther and result.GetAttribute(MADE_FOR) == (mapNode.GetAttribute(FINGERPRINT) or "")


def noteOther(result: slicer.vtkMRMLNode, otherMapNode: ModelNode, array: str) -> None:
    """Say that a result is of a second map, too, and of which of its arrays."""
    result.SetNodeReferenceID(COMPARED_WITH, otherMapNode.GetID())
    result.SetAttribute(OTHER_MADE_FOR, otherMapNode.GetAttribute(FINGERPRINT) or "")
    result.SetAttribute(OTHER_ARRAY, array)


def noteArray(mapNode: ModelNode, array: str, *kinds: str) -> None:
    """Say of which array the results of some kinds are."""
    for node in resultsOf(mapNode):
        if node.GetAttribute(KIND) in kinds:
            node.SetAttribute(OF_ARRAY, array)


def outdateResultsOf(mapNode: ModelNode, array: str) -> None:
    """What was read off an array is outdated, because that has other values now; comparisons of others with it, too."""
    results = [node for node in resultsOf(mapNode) if node.GetAttribute(OF_ARRAY) == array]
    for table in slicer.util.getNodesByClass("vtkMRMLTableNode", mapNode.GetScene()):
        if table.GetNodeReference(COMPARED_WITH) is mapNode and table.GetAttribute(OTHER_ARRAY) == array:
            results.append(table)
    for node in results:
        node.SetAttribute(MADE_FOR, OTHER_VALUES)
    hideOutdated(mapNode)


def hasOutdated(mapNode: ModelNode | None) -> bool:
    """Whether something was measured on a map before it, or the array, changed."""
    return mapNode is not None and any(not isCurrent(mapNode, node) for node in resultsOf(mapNode))


def stamp(mapNode: ModelNode, result: slicer.vtkMRMLNode) -> None:
    """Say of which state of a map a result is."""
    result.SetAttribute(MADE_FOR, mapNode.GetAttribute(FINGERPRINT) or "")


def removeResults(mapNode: ModelNode, *kinds: str) -> None:
    """Remove the results of some kinds from the scene; all without a kind."""
    for node in resultsOf(mapNode):
        if not kinds or node.GetAttribute(KIND) in kinds:
            mapNode.GetScene().RemoveNode(node)
    # References to nodes that are gone, from the last on.
    for k in reversed(range(mapNode.GetNumberOfNodeReferences(RESULT_ROLE))):
        if mapNode.GetNthNodeReference(RESULT_ROLE, k) is None:
            mapNode.RemoveNthNodeReferenceID(RESULT_ROLE, k)


def tableResult(
    mapNode: ModelNode, kind: str, what: str, columns: Mapping[str, list[str] | np.ndarray]
) -> slicer.vtkMRMLTableNode:
    """Put a table into the result of a kind, which is made if it is not there."""
    node = resultOf(mapNode, kind)
    if node is None:
        node = addResult(mapNode, kind, "vtkMRMLTableNode", f"{mapNode.GetName()} {what}")
    fillTableNode(node, columns)
    stamp(mapNode, node)
    return node


def fillTableNode(node: slicer.vtkMRMLTableNode, columns: Mapping[str, list[str] | np.ndarray]) -> None:
    """Give a table node columns of text or numbers, with titles, that cannot be edited."""
    table = vtk.vtkTable()
    for name, values in columns.items():
        if isinstance(values, np.ndarray):
            array = numpy_to_vtk(values, deep=True)
        else:
            array = vtk.vtkStringArray()
            for value in values:
                array.InsertNextValue(value)
        array.SetName(name)
        table.AddColumn(array)
    node.SetAndObserveTable(table)
    node.SetUseColumnTitleAsColumnHeader(True)
    node.SetLocked(True)
