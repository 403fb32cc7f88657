"""Projects an image anew when what it depends on changes: at once, and once more when the user comes to rest."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import slicer
import vtk
from slicer.util import VTKObservationMixin

from LAFlatteningLib import LAFlatteningError
from LAFlatteningLib.projection import Projection

from .long_action import LOOK_AGAIN
from .scene_end import stopWithScene
from .throttle import Throttle

if TYPE_CHECKING:
    from LAFlattening import LAFlatteningLogic, LAFlatteningParameterNode


class LiveProjection(VTKObservationMixin):
    """See `AnalysisLogic.startLiveProjection`."""

    def __init__(
        self,
        logic: LAFlatteningLogic,
        parameterNode: LAFlatteningParameterNode,
        scheduler: Callable[[int, Callable[[], None]], None],
        onProjected: Callable[[Projection | None, str], None],
    ) -> None:
        super().__init__()
        self._logic, self._parameters = logic, parameterNode
        self._scheduler, self._throttle, self._onProjected = scheduler, Throttle(scheduler), onProjected
        self._waiting = self._stopped = False
        self._followed: tuple[slicer.vtkMRMLTransformableNode, ...] = ()
        self._done = self._state()
        self.addObserver(parameterNode, vtk.vtkCommand.ModifiedEvent, self._onChange)
        stopWithScene(self)
        self._follow()

    def stop(self) -> None:
        """No longer follow; what was scheduled does not happen."""
        self._stopped = True
        self._throttle.cancel()
        self.removeObservers()

    def _state(self) -> tuple[object, ...]:
        """What a projection depends on."""
        p = self._parameters
        image = p.volume.GetImageData() if p.volume is not None else None
        return (
            p.projectLive,
            p.surface.GetID() if p.surface is not None else None,
            p.volume.GetID() if p.volume is not None else None,
            image.GetMTime() if image is not None else None,
            self._logic.projectionFrom(p),
            *(_placement(node) for node in (p.surface, p.volume)),
        )

    def _follow(self) -> None:
        """Look at the transforms of the present atrium and image."""
        now = tuple(node for node in (self._parameters.surface, self._parameters.volume) if node is not None)
        if now == self._followed:
            return
        moved = slicer.vtkMRMLTransformableNode.TransformModifiedEvent
        for node in self._followed:
            self.removeObserver(node, moved, self._onChange)
        for node in now:
            self.addObserver(node, moved, self._onChange)
        self._followed = now

    def _onChange(self, _caller: object = None, _event: object = None) -> None:
        self._follow()
        if self._state() != self._done:
            self._throttle.request(self._project)

    def _lookAgain(self) -> None:
        self._waiting = False
        if not self._stopped:
            self._onChange()

    def _project(self) -> None:
        if self._logic.isBusy:
            # The array may be just what is being measured.
            if not self._waiting:
                self._waiting = True
                self._scheduler(LOOK_AGAIN, self._lookAgain)
            return
        p, self._done = self._parameters, self._state()
        if not p.projectLive or p.surface is None or p.volume is None:
            return
        try:
            found = self._logic.projectParameters(p)
        except LAFlatteningError as error:
            self._onProjected(None, str(error))
        else:
            self._onProjected(found, "\n".join(found.notes))


def _placement(node: slicer.vtkMRMLTransformableNode | None) -> tuple[object, ...] | None:
    """What changes when a node's parent transforms do, or the points of a model."""
    if node is None:
        return None
    parent = node.GetParentTransformNode()
    moved = None if parent is None else (parent.GetID(), parent.GetTransformToWorldMTime(), parent.GetMTime())
    if isinstance(node, slicer.vtkMRMLModelNode):
        polydata = node.GetPolyData()
        points = polydata.GetPoints() if polydata is not None else None
        return (moved, None if points is None else points.GetMTime())
    matrix = vtk.vtkMatrix4x4()
    node.GetIJKToRASMatrix(matrix)
    return (moved, str(slicer.util.arrayFromVTKMatrix(matrix).tolist()))
