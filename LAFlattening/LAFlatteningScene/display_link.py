"""The same colours on atrium and map, whichever of the two the user changes."""

from __future__ import annotations

import slicer
import vtk
from slicer.util import VTKObservationMixin

from .map_nodes import copyArrays

DisplayNode = slicer.vtkMRMLModelDisplayNode


def followColours(leader: slicer.vtkMRMLModelNode, follower: slicer.vtkMRMLModelNode) -> None:
    """Give a model the scalar colours of another: active array, visibility, colour table and range.

    An array that the follower does not have leaves its colours as they are.
    """
    source, target = leader.GetDisplayNode(), follower.GetDisplayNode()
    if source is None or target is None:
        return
    name, where = source.GetActiveScalarName() or "", source.GetActiveAttributeLocation()
    if source.GetScalarVisibility() and not _has(follower, name, where):
        return
    low, high = scalarRange(leader)
    modifying = target.StartModify()
    try:
        if target.GetScalarVisibility() != source.GetScalarVisibility():
            target.SetScalarVisibility(source.GetScalarVisibility())
        if source.GetScalarVisibility():
            if (target.GetActiveScalarName() or "", target.GetActiveAttributeLocation()) != (name, where):
                target.SetActiveScalar(name, where)
            if target.GetColorNodeID() != source.GetColorNodeID():
                target.SetAndObserveColorNodeID(source.GetColorNodeID())
            if scalarRange(follower) != (low, high):
                # Covers are on the atrium only, so the ranges of the data differ: the follower gets the numbers.
                target.SetScalarRangeFlag(target.UseManualScalarRange)
                target.SetScalarRange(low, high)
    finally:
        target.EndModify(modifying)


def scalarRange(model: slicer.vtkMRMLModelNode) -> tuple[float, float]:
    """The values at the ends of the colours with which a model is drawn."""
    display = model.GetDisplayNode()
    flag = display.GetScalarRangeFlag()
    if flag == display.UseDataScalarRange:
        array = activeArray(model)
        if array is not None:
            return tuple(array.GetRange(-1 if array.GetNumberOfComponents() > 1 else 0))
    if flag == display.UseColorNodeScalarRange and display.GetColorNode() is not None:
        table = display.GetColorNode().GetScalarsToColors()
        if table is not None:
            return tuple(table.GetRange())
    return tuple(display.GetScalarRange())


def activeArray(model: slicer.vtkMRMLModelNode) -> vtk.vtkDataArray | None:
    """The array by which a model is coloured; None if by none."""
    display, polydata = model.GetDisplayNode(), model.GetPolyData()
    if display is None or polydata is None or not display.GetScalarVisibility() or not display.GetActiveScalarName():
        return None
    onCells = display.GetActiveAttributeLocation() == vtk.vtkAssignAttribute.CELL_DATA
    return (polydata.GetCellData() if onCells else polydata.GetPointData()).GetArray(display.GetActiveScalarName())


def _has(model: slicer.vtkMRMLModelNode, name: str, where: int) -> bool:
    polydata = model.GetPolyData()
    if polydata is None or not name:
        return False
    onCells = where == vtk.vtkAssignAttribute.CELL_DATA
    return bool((polydata.GetCellData() if onCells else polydata.GetPointData()).HasArray(name))


class DisplayLink(VTKObservationMixin):
    """Keeps arrays and colours of an atrium and its map in step, as long as it lives (`stop`)."""

    def __init__(self, surfaceNode: slicer.vtkMRMLModelNode, mapNode: slicer.vtkMRMLModelNode) -> None:
        super().__init__()
        self.surfaceNode, self.mapNode = surfaceNode, mapNode
        self._busy = False
        self._arraysTime = 0
        self._watched: list[vtk.vtkAbstractArray] = []
        for node, act in ((surfaceNode, self._onSurface), (mapNode, self._onMap)):
            if node.GetDisplayNode() is None:
                node.CreateDefaultDisplayNodes()
            self.addObserver(node.GetDisplayNode(), vtk.vtkCommand.ModifiedEvent, act)
        self.addObserver(surfaceNode, slicer.vtkMRMLModelNode.MeshModifiedEvent, self._onArrays)
        self._onArrays()

    def stop(self) -> None:
        """No longer follow."""
        self.removeObservers()

    def _onArrays(self, _caller: object = None, _event: object = None) -> None:
        polydata = self.surfaceNode.GetPolyData()
        if polydata is None:
            return
        data = (polydata.GetPointData(), polydata.GetCellData())
        time = max(attributes.GetMTime() for attributes in data)
        if time != self._arraysTime:
            self._arraysTime = time
            self._watch(
                [attributes.GetAbstractArray(k) for attributes in data for k in range(attributes.GetNumberOfArrays())]
            )
            copyArrays(self.mapNode, self.surfaceNode)
            self._onSurface()

    def _watch(self, arrays: list[vtk.vtkAbstractArray]) -> None:
        """Look at each array too: values changed in place by a script are told by the array alone."""
        for array in self._watched:
            if array not in arrays:
                self.removeObserver(array, vtk.vtkCommand.ModifiedEvent, self._onArrays)
        for array in arrays:
            if array not in self._watched:
                self.addObserver(array, vtk.vtkCommand.ModifiedEvent, self._onArrays)
        self._watched = arrays

    def _onSurface(self, _caller: object = None, _event: object = None) -> None:
        self._follow(self.surfaceNode, self.mapNode)

    def _onMap(self, _caller: object = None, _event: object = None) -> None:
        self._follow(self.mapNode, self.surfaceNode)

    def _follow(self, leader: slicer.vtkMRMLModelNode, follower: slicer.vtkMRMLModelNode) -> None:
        if self._busy or leader.GetScene() is None or follower.GetScene() is None:
            return
        self._busy = True
        try:
            followColours(leader, follower)
        finally:
            self._busy = False
