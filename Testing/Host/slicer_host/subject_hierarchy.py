"""Subject hierarchy items that come and go with their nodes, which Slicer's Qt plugins see to and MRML does not."""

from __future__ import annotations

import slicer
import vtk

_DATA = (
    "vtkMRMLModelNode",
    "vtkMRMLMarkupsNode",
    "vtkMRMLVolumeNode",
    "vtkMRMLSegmentationNode",
    "vtkMRMLTransformNode",
    "vtkMRMLTableNode",
    "vtkMRMLPlotChartNode",
    "vtkMRMLPlotSeriesNode",
    "vtkMRMLTextNode",
)


def follow(scene) -> list[int]:
    """Give every data node of ``scene`` an item while it is there; returns the tags of the observers."""

    @vtk.calldata_type(vtk.VTK_OBJECT)
    def added(_scene, _event, node):
        if not scene.IsImporting():
            _add_item(scene, node)

    @vtk.calldata_type(vtk.VTK_OBJECT)
    def removed(_scene, _event, node):
        # While a scene is read it may hold two hierarchies, which asking for the one would merge too early.
        if scene.IsImporting() or scene.IsClosing() or not _is_data(node):
            return
        hierarchy = slicer.vtkMRMLSubjectHierarchyNode.GetSubjectHierarchyNode(scene)
        item = hierarchy.GetItemByDataNode(node) if hierarchy is not None else 0
        if item:
            hierarchy.RemoveItem(item, False, False)

    def closed(*_args):
        # The scene remembers its hierarchy even after closing, if anything else still holds it: make a new one.
        slicer.vtkMRMLSubjectHierarchyNode.ResolveSubjectHierarchy(scene)

    def imported(*_args):
        slicer.vtkMRMLSubjectHierarchyNode.ResolveSubjectHierarchy(scene)
        for index in range(scene.GetNumberOfNodes()):
            _add_item(scene, scene.GetNthNode(index))

    return [
        scene.AddObserver(slicer.vtkMRMLScene.NodeAddedEvent, added),
        scene.AddObserver(slicer.vtkMRMLScene.NodeAboutToBeRemovedEvent, removed),
        scene.AddObserver(slicer.vtkMRMLScene.EndCloseEvent, closed),
        scene.AddObserver(slicer.vtkMRMLScene.EndImportEvent, imported),
    ]


def _add_item(scene, node) -> None:
    if node.GetHideFromEditors() or not _is_data(node):
        return
    hierarchy = slicer.vtkMRMLSubjectHierarchyNode.GetSubjectHierarchyNode(scene)
    if hierarchy is not None and not hierarchy.GetItemByDataNode(node):
        hierarchy.CreateItem(hierarchy.GetSceneItemID(), node)


def _is_data(node) -> bool:
    return any(node.IsA(name) for name in _DATA)
