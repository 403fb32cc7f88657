"""The covers of the openings of an atrium, shown so that seeds can be put in the middle of an opening."""

from __future__ import annotations

import hashlib

import slicer
import vtk

from LAFlatteningLib.cavity.openings import Cavity

OPENINGS_ROLE = "LAFlattening.openings"
"""Node reference from a surface to the model of its covers."""
COLOUR, OPACITY = (0.95, 0.9, 0.75), 0.6

ModelNode = slicer.vtkMRMLModelNode


def openingsNode(surfaceNode: ModelNode) -> ModelNode | None:
    """The model of a surface's covers, if there is one."""
    return surfaceNode.GetNodeReference(OPENINGS_ROLE)


def showOpenings(surfaceNode: ModelNode, cavity: Cavity) -> ModelNode:
    """Show the covers of a cavity; without them, a click on an opening goes through to the wall behind it.

    The node is in world coordinates, is not saved and not listed.
    """
    node = openingsNode(surfaceNode)
    if node is None:
        scene = surfaceNode.GetScene()
        node = scene.CreateNodeByClass("vtkMRMLModelNode")
        node.UnRegister(None)
        node.SetName(scene.GenerateUniqueName(f"{surfaceNode.GetName()} openings"))
        node.SetHideFromEditors(True)
        node.SetSaveWithScene(False)
        node = scene.AddNode(node)
        surfaceNode.SetNodeReferenceID(OPENINGS_ROLE, node.GetID())
    if node.GetDisplayNode() is None:
        # New, or somebody has deleted it.
        node.CreateDefaultDisplayNodes()
        display = node.GetDisplayNode()
        display.SetSaveWithScene(False)
        display.SetColor(*COLOUR)
        display.SetOpacity(OPACITY)
        display.SetBackfaceCulling(False)
        display.SetVisibility2D(False)
    covers, _ = cavity.closed.submesh(cavity.cover >= 0)
    # Its contents, not its id: that of a cavity that is gone is soon that of another.
    key = hashlib.blake2b(covers.points.tobytes() + covers.triangles.tobytes(), digest_size=16).hexdigest()
    if node.GetAttribute(OPENINGS_ROLE) != key or node.GetPolyData() is None:
        bare = vtk.vtkPolyData()
        source = covers.to_polydata()
        bare.SetPoints(source.GetPoints())
        bare.SetPolys(source.GetPolys())
        # The library's points are shared with its own results.
        copy = vtk.vtkPolyData()
        copy.DeepCopy(bare)
        node.SetAndObservePolyData(copy)
        node.SetAttribute(OPENINGS_ROLE, key)
    if not node.GetDisplayNode().GetVisibility():
        node.GetDisplayNode().SetVisibility(True)
    return node


def hideOpenings(surfaceNode: ModelNode) -> None:
    """Hide the covers."""
    node = openingsNode(surfaceNode) if surfaceNode.GetScene() is not None else None
    if node is not None and node.GetDisplayNode() is not None and node.GetDisplayNode().GetVisibility():
        node.GetDisplayNode().SetVisibility(False)
