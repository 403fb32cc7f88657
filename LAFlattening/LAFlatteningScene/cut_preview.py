"""The rims that the planes would cut, drawn on the atrium while planes are moved."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import slicer
import vtk
from slicer.util import VTKObservationMixin
from vtk.util.numpy_support import numpy_to_vtk

from LAFlatteningLib import LAFlatteningError, Surface
from LAFlatteningLib.cavity.clipping import CutPlane
from LAFlatteningLib.cavity.sections import plane_section

from .live_update import SHORTEST_PAUSE, Scheduler, surfaceMoved
from .plane_nodes import (
    BAD_COLOUR,
    GOOD_COLOUR,
    PlaneNode,
    colourPlane,
    isMoved,
    isPlaced,
    planeOf,
    planesOf,
    suggestedOf,
)
from .raw_input import versionOf
from .scene_end import stopWithScene

if TYPE_CHECKING:
    from LAFlattening import LAFlatteningLogic, LAFlatteningParameterNode

RIM_RADIUS_MM = 0.5
"""Of the rims as drawn: half of it stands out of the wall."""


@dataclass(frozen=True, eq=False)
class Cut:
    """The rim that a plane would cut.

    Attributes
    ----------
    points : (k, 3) along it, RAS, mm; empty where the plane cuts nothing closed.
    perimeter : mm.
    around : it goes round the centre of the plane, so that it can be cut.
    """

    points: np.ndarray
    perimeter: float
    around: bool


def cutOf(surface: Surface, plane: CutPlane, isOpen: bool = False) -> Cut:
    """The rim of a plane; of an opening that is open already and stays so, the rim that is there."""
    if isOpen and surface.boundary_loops:
        loops = surface.boundary_loops
        loop = min(loops, key=lambda loop: np.linalg.norm(surface.points[loop].mean(axis=0) - plane.centre))
        return Cut(surface.points[loop], surface.loop_length(loop), True)
    section = plane_section(surface, plane.centre, plane.normal)
    if section is None:
        return Cut(np.zeros((0, 3)), 0.0, False)
    return Cut(section.points, section.perimeter, section.around)


class Throttle:
    """Does something at once, and again after the last of many requests, but leaves half of the time to others."""

    def __init__(self, work: Callable[[], None], scheduler: Scheduler, clock: Callable[[], float]) -> None:
        self._work, self._scheduler, self._clock = work, scheduler, clock
        self._notBefore, self._due, self._stopped = -np.inf, False, False

    def request(self) -> None:
        """Now if the last time is long enough ago, else as soon as it is."""
        if self._due or self._stopped:
            return
        wait = self._notBefore - self._clock()
        if wait <= 0.0:
            self._run()
        else:
            self._due = True
            self._scheduler(int(np.ceil(1000.0 * wait)), self._trailing)

    def requestLater(self) -> None:
        """When Slicer has finished with the event that is going on."""
        if not self._due and not self._stopped:
            self._due = True
            self._scheduler(0, self._trailing)

    def stop(self) -> None:
        """Nothing that is scheduled happens any more."""
        self._stopped = True

    def _trailing(self) -> None:
        if self._due and not self._stopped:
            self._due = False
            self._run()

    def _run(self) -> None:
        began = self._clock()
        self._work()
        ended = self._clock()
        self._notBefore = ended + max(SHORTEST_PAUSE, ended - began)


class CutPreview(VTKObservationMixin):
    """Follows the planes of what is prepared; see `LAFlatteningLogic.startCutPreview`.

    Attributes
    ----------
    cuts : opening -> the rim that its plane would cut now; empty while nothing is being planned.
    """

    def __init__(
        self,
        logic: LAFlatteningLogic,
        parameterNode: LAFlatteningParameterNode,
        scheduler: Scheduler,
        onCuts: Callable[[], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__()
        self._logic, self._parameters = logic, parameterNode
        self._onCuts = onCuts or (lambda: None)
        self._throttle = Throttle(self._draw, scheduler, clock)
        self._planes: dict[str, PlaneNode] = {}
        self._seen: dict[str, tuple[float, ...]] = {}
        self._surface: tuple[tuple[object, ...], Surface | None] | None = None
        self._node: slicer.vtkMRMLModelNode | None = None
        self.cuts: Mapping[str, Cut] = {}
        scene = slicer.mrmlScene
        self.addObserver(parameterNode, vtk.vtkCommand.ModifiedEvent, self._onScene)
        self.addObserver(scene, scene.NodeAddedEvent, self._onNodeAdded)
        self.addObserver(scene, scene.NodeRemovedEvent, self._onScene)
        stopWithScene(self)
        self._throttle.requestLater()

    def stop(self) -> None:
        """No longer follow; the rims go."""
        self._throttle.stop()
        self.removeObservers()
        self.cuts = {}
        self._hide()

    # ---- events ------------------------------------------------------------------------------------------------------

    @vtk.calldata_type(vtk.VTK_OBJECT)
    def _onNodeAdded(self, _caller: object, _event: object, node: slicer.vtkMRMLNode) -> None:
        if isinstance(node, PlaneNode):
            self._throttle.requestLater()

    def _onScene(self, _caller: object = None, _event: object = None) -> None:
        self._throttle.requestLater()

    def _onPlane(self, _caller: object = None, _event: object = None) -> None:
        """A plane may have moved: names and colours come with the same events."""
        if self._states() != self._seen:
            self._throttle.request()

    def _follow(self) -> None:
        planes = planesOf(self._parameters.prepareInput)
        if planes == self._planes:
            return
        events = (vtk.vtkCommand.ModifiedEvent, PlaneNode.PointModifiedEvent, surfaceMoved())
        for node in self._planes.values():
            for event in events:
                self.removeObserver(node, event, self._onPlane)
        for node in planes.values():
            for event in events:
                self.addObserver(node, event, self._onPlane)
        self._planes = planes

    def _states(self) -> dict[str, tuple[float, ...]]:
        """Where the planes are that can be moved."""
        return {
            name: (*node.GetCenterWorld(), *node.GetNormalWorld(), float(isPlaced(node)))
            for name, node in self._planes.items()
            if node.GetScene() is not None and not node.GetLocked()
        }

    # ---- drawing -----------------------------------------------------------------------------------------------------

    def _draw(self) -> None:
        self._follow()
        states = self._states()
        former, surface = self._surface, self._currentSurface() if states else None
        unchanged = self._surface is former
        cuts = {}
        for name in states if surface is not None else ():
            if unchanged and name in self.cuts and self._seen.get(name) == states[name]:
                cuts[name] = self.cuts[name]
            else:
                cuts[name] = self._cut(surface, self._planes[name])
            colourPlane(self._planes[name], cuts[name].around)
        changed = list(cuts.items()) != list(self.cuts.items())
        self._seen, self.cuts = states, cuts
        if changed:
            self._show() if cuts else self._hide()
        self._onCuts()

    @staticmethod
    def _cut(surface: Surface, node: PlaneNode) -> Cut:
        if not isPlaced(node):
            return Cut(np.zeros((0, 3)), 0.0, False)
        isOpen = suggestedOf(node)[1] == "open" and not isMoved(node)
        return cutOf(surface, planeOf(node), isOpen)

    def _currentSurface(self) -> Surface | None:
        """The surface that would be cut; the same object as long as it is the same."""
        p = self._parameters
        choice = self._logic.rawChoiceFrom(p)
        key = (versionOf(p.prepareInput, choice.structure), choice, self._logic.isPrepared(p.prepareInput, choice))
        if self._surface is None or self._surface[0] != key:
            try:
                self._surface = (key, self._logic.preparedSurface(p.prepareInput, choice))
            except LAFlatteningError:
                # Said where it is asked for; what cannot be read has no rims.
                self._surface = (key, None)
        return self._surface[1]

    def _show(self) -> None:
        if self._node is None or self._node.GetScene() is None:
            scene = slicer.mrmlScene
            node = scene.CreateNodeByClass("vtkMRMLModelNode")
            node.UnRegister(None)
            node.SetName(scene.GenerateUniqueName("Planned rims"))
            node.SetHideFromEditors(True)
            node.SetSaveWithScene(False)
            node.SetSelectable(False)
            self._node = scene.AddNode(node)
            node.CreateDefaultDisplayNodes()
            display = node.GetDisplayNode()
            display.SetSaveWithScene(False)
            display.SetVisibility2D(False)
            display.SetScalarRangeFlag(display.UseDirectMapping)
        self._node.SetAndObservePolyData(_tubes(self.cuts.values()))
        display = self._node.GetDisplayNode()
        display.SetActiveScalar("colour", vtk.vtkAssignAttribute.POINT_DATA)
        display.SetScalarVisibility(True)

    def _hide(self) -> None:
        if self._node is not None and self._node.GetScene() is not None:
            self._node.GetScene().RemoveNode(self._node)
        self._node = None


def _tubes(cuts: Iterator[Cut]) -> vtk.vtkPolyData:
    """Closed lines as tubes, in the colour of those that can be cut and of those that cannot."""
    append = vtk.vtkAppendPolyData()
    for cut in cuts:
        count = len(cut.points)
        if count < 3:
            continue
        line, points, cells = vtk.vtkPolyData(), vtk.vtkPoints(), vtk.vtkCellArray()
        points.SetData(numpy_to_vtk(cut.points, deep=True))
        cells.InsertNextCell(count + 1)
        for k in (*range(count), 0):
            cells.InsertCellPoint(k)
        line.SetPoints(points)
        line.SetLines(cells)
        colour = np.round(255.0 * np.array(GOOD_COLOUR if cut.around else BAD_COLOUR)).astype(np.uint8)
        colours = numpy_to_vtk(np.tile(colour, (count, 1)), deep=True)
        colours.SetName("colour")
        line.GetPointData().SetScalars(colours)
        append.AddInputData(line)
    tube = vtk.vtkTubeFilter()
    tube.SetInputConnection(append.GetOutputPort())
    tube.SetRadius(RIM_RADIUS_MM)
    tube.SetNumberOfSides(8)
    if append.GetNumberOfInputConnections(0):
        tube.Update()
    return tube.GetOutput()
