"""Arrays of the module's own that are drawn as named classes: their colour tables, found again by the array."""

from __future__ import annotations

from collections.abc import Sequence

import slicer

CLASS_ARRAY = "LAFlattening.classArray"
"""Attribute of a colour table: the cell array that it is for."""
CLASS_COLOURS_ROLE = "LAFlattening.classColours"
"""Node reference from an atrium to the colour tables of its class arrays."""
NO_VALUE_GREY = (0.71, 0.71, 0.71)

ModelNode = slicer.vtkMRMLModelNode


def classColours(surfaceNode: ModelNode, array: str) -> slicer.vtkMRMLColorTableNode | None:
    """The colour table of a class array of an atrium; None if it is none."""
    for k in range(surfaceNode.GetNumberOfNodeReferences(CLASS_COLOURS_ROLE)):
        node = surfaceNode.GetNthNodeReference(CLASS_COLOURS_ROLE, k)
        if node is not None and node.GetAttribute(CLASS_ARRAY) == array:
            return node
    return None


def setClassColours(
    surfaceNode: ModelNode, array: str, names: Sequence[str], colours: Sequence[tuple[float, float, float]]
) -> slicer.vtkMRMLColorTableNode:
    """Name and colour the classes 0, 1, ... of an array of an atrium; the next number is "no value", grey."""
    node = classColours(surfaceNode, array)
    scene = surfaceNode.GetScene()
    if node is None:
        node = scene.AddNewNodeByClass(
            "vtkMRMLColorTableNode", scene.GenerateUniqueName(f"{surfaceNode.GetName()} {array}")
        )
        node.SetAttribute(CLASS_ARRAY, array)
        surfaceNode.AddNodeReferenceID(CLASS_COLOURS_ROLE, node.GetID())
    node.SetTypeToUser()
    node.SetHideFromEditors(False)
    node.SetNumberOfColors(len(names) + 1)
    node.GetLookupTable().SetTableRange(0, len(names))
    for k, (name, colour) in enumerate(zip((*names, "no value"), (*colours, NO_VALUE_GREY), strict=True)):
        node.SetColor(k, name, *colour, 1.0)
    return node


def removeClassColours(surfaceNode: ModelNode, array: str) -> None:
    """Remove the colour table of a class array."""
    node = classColours(surfaceNode, array)
    if node is not None:
        surfaceNode.GetScene().RemoveNode(node)
