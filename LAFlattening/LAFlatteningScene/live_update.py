"""The map follows the seeds: quickly and roughly while one is dragged, fully when it is released."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import slicer
import vtk
from slicer.util import VTKObservationMixin

from LAFlatteningLib import Cancelled, LAFlatteningError, SeedError

from .long_action import LOOK_AGAIN
from .map_making import chooseMap
from .map_nodes import isMapOf, refuseCopy
from .result_nodes import FINGERPRINT
from .scene_end import stopWithScene
from .seed_nodes import (
    Positions,
    SeedHistory,
    markSeeds,
    nextSeed,
    placementProblems,
    placeSeed,
    prepareSeedsNode,
    samePositions,
    seedPositions,
    setPositions,
    snapped,
)
from .surface_nodes import fingerprint

if TYPE_CHECKING:
    from LAFlattening import LAFlatteningLogic, LAFlatteningParameterNode

SHORTEST_PAUSE = 0.04
"""Seconds between two previews at least; more if a preview takes longer, so that views and mouse get half the time."""

Scheduler = Callable[[int, Callable[[], None]], None]


@dataclass(frozen=True)
class Report:
    """What the panel shows about the state of the work.

    Attributes
    ----------
    stage : "seeds": seeds are still to be placed. "preview": the map is a quick one. "map": the map is up to date.
        "outdated": it is not, because following is switched off. "error": no map of this input is possible.
    message : for the user; empty if there is nothing to say.
    seedReasons : seed -> why it cannot be right.
    nextSeed : the seed to place next, if any.
    """

    stage: str
    message: str = ""
    seedReasons: Mapping[str, str] = field(default_factory=dict)
    nextSeed: str | None = None


class LiveUpdate(VTKObservationMixin):
    """Follows the nodes of a parameter node; see `LAFlatteningLogic.startLiveUpdate`.

    Two things can be due. A *preview*, while a seed is being dragged: at once if the last one is long enough ago, else
    when it is. *Settling*, after everything else: seeds snap and are checked, the change can be undone, the full map
    is made if anything has changed that it depends on. Settling never happens during a drag, and always from the
    scheduler, after Slicer has finished with the event, and once however many events there were.
    """

    def __init__(
        self,
        logic: LAFlatteningLogic,
        parameterNode: LAFlatteningParameterNode,
        scheduler: Scheduler,
        onReport: Callable[[Report], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__()
        self._logic, self._parameters = logic, parameterNode
        self._scheduler, self._clock = scheduler, clock
        self._onReport = onReport or (lambda report: None)
        self._followed: tuple[slicer.vtkMRMLNode | None, ...] = (None, None)
        self._seen: Positions = {}
        self._dragging = self._applying = self._stopped = False
        # Something scheduled is valid only while the number is that which it was scheduled with.
        self._previewTicket = self._settleTicket = 0
        self._previewDue = self._settleDue = False
        self._notBefore = -np.inf
        self._tried: tuple[str, LAFlatteningError | None] | None = None
        self.history = SeedHistory()
        self.addObserver(parameterNode, vtk.vtkCommand.ModifiedEvent, self._onParameters)
        scene = slicer.mrmlScene
        stopWithScene(self)
        self.addObserver(scene, scene.NodeRemovedEvent, self._onParameters)
        self._follow()
        self._requestSettle()

    def stop(self) -> None:
        """No longer follow; nothing that is scheduled happens any more."""
        self._stopped = True
        self.removeObservers()

    def undo(self) -> None:
        """Put the seeds where they were before the last change."""
        if self.history.canUndo:
            self._apply(self.history.undo())

    def redo(self) -> None:
        """Make the change again that was undone last."""
        if self.history.canRedo:
            self._apply(self.history.redo())

    # ---- events ------------------------------------------------------------------------------------------------------

    def _follow(self) -> None:
        """Observe the surface and the seeds that are selected now."""
        seeds, surface = self._parameters.seeds, self._parameters.surface
        if (seeds, surface) == self._followed:
            return
        formerSeeds, formerSurface = self._followed
        if formerSurface is not None and formerSurface is not surface:
            for event in (slicer.vtkMRMLModelNode.MeshModifiedEvent, surfaceMoved()):
                self.removeObserver(formerSurface, event, self._onSurface)
        if formerSeeds is not None and formerSeeds is not seeds:
            for event, method in self._seedEvents(formerSeeds):
                self.removeObserver(formerSeeds, event, method)
        if surface is not None and surface is not formerSurface:
            for event in (slicer.vtkMRMLModelNode.MeshModifiedEvent, surfaceMoved()):
                self.addObserver(surface, event, self._onSurface)
        if seeds is not formerSeeds:
            self._dragging = False
            self.history = SeedHistory()
            if seeds is not None:
                prepareSeedsNode(seeds, self._logic.anatomy(self._parameters.template))
                for event, method in self._seedEvents(seeds):
                    self.addObserver(seeds, event, method)
                self.history.record(seedPositions(seeds))
            self._seen = seedPositions(seeds)
        self._followed = (seeds, surface)

    def _seedEvents(self, node: slicer.vtkMRMLMarkupsFiducialNode) -> list[tuple[int, Callable]]:
        return [
            (node.PointStartInteractionEvent, self._onDragStart),
            (node.PointEndInteractionEvent, self._onDragEnd),
            (node.PointModifiedEvent, self._onSeeds),
            (node.PointPositionDefinedEvent, self._onSeeds),
            (node.PointPositionUndefinedEvent, self._onSeeds),
            (node.PointRemovedEvent, self._onSeeds),
            (surfaceMoved(), self._onSeeds),
        ]

    def _onParameters(self, _caller: object = None, _event: object = None) -> None:
        if not self._stopped:
            chooseMap(self._parameters)
            self._follow()
            self._requestSettle()

    def _onSurface(self, _caller: object = None, _event: object = None) -> None:
        self._requestSettle()

    def _onDragStart(self, _caller: object = None, _event: object = None) -> None:
        self._dragging = True

    def _onDragEnd(self, _caller: object = None, _event: object = None) -> None:
        self._dragging = False
        self._previewTicket += 1
        self._previewDue = False
        self._requestSettle()

    def _onSeeds(self, _caller: object = None, _event: object = None) -> None:
        """Seeds may have moved: names, colours and points that follow the mouse come with the same events."""
        if self._applying or self._stopped:
            return
        positions = seedPositions(self._parameters.seeds)
        if samePositions(positions, self._seen):
            return
        self._seen = positions
        if self._dragging:
            self._requestPreview()
        else:
            self._requestSettle()

    # ---- preview -----------------------------------------------------------------------------------------------------

    def _requestPreview(self) -> None:
        p = self._parameters
        if self._previewDue or not p.liveUpdate or p.map is None or self._logic.isBusy:
            return
        wait = self._notBefore - self._clock()
        if wait <= 0.0:
            self._preview()
            return
        self._previewDue = True
        self._previewTicket += 1
        ticket = self._previewTicket
        self._scheduler(int(np.ceil(1000.0 * wait)), lambda: self._trailingPreview(ticket))

    def _trailingPreview(self, ticket: int) -> None:
        if self._stopped or ticket != self._previewTicket or not self._dragging:
            return
        self._previewDue = False
        self._preview()

    def _preview(self) -> None:
        began = self._clock()
        p = self._parameters
        try:
            if nextSeed(p.seeds, self._logic.anatomy(p.template)) is None and not self._logic.isBusy:
                self._logic.previewParameters(p)
                self._report("preview", reasons={})
        except LAFlatteningError as error:
            self._report("error", str(error), reasonsOf(error))
        ended = self._clock()
        self._notBefore = ended + max(SHORTEST_PAUSE, ended - began)

    # ---- settling ----------------------------------------------------------------------------------------------------

    def _requestSettle(self) -> None:
        if self._stopped or self._settleDue:
            return
        self._settleDue = True
        self._settleTicket += 1
        ticket = self._settleTicket
        self._scheduler(0, lambda: self._settle(ticket))

    def _settle(self, ticket: int) -> None:
        if self._stopped or ticket != self._settleTicket:
            return
        self._settleDue = False
        if self._dragging:
            # Letting go asks again.
            return
        if self._logic.isBusy:
            # Something long lets events through; look again when it may be done.
            self._settleDue = True
            self._scheduler(LOOK_AGAIN, lambda: self._settle(ticket))
            return
        p = self._parameters
        if p.seeds is None or p.surface is None:
            missing = [what for what, node in (("a surface", p.surface), ("seeds", p.seeds)) if node is None]
            self._report("seeds", f"Select or create {' and '.join(missing)}.", {})
            return
        try:
            anatomy = self._logic.anatomy(p.template)
            self._snapMoved(anatomy)
            self._bringUpToDate(anatomy)
        except Cancelled:
            self._report("outdated", "The map was not made: stopped.", {})
        except LAFlatteningError as error:
            self._report("error", str(error), reasonsOf(error))

    def _snapMoved(self, anatomy) -> None:
        """Snap the seeds that are not where they were after the last settling, and note the change."""
        p = self._parameters
        positions = seedPositions(p.seeds)
        before = self.history.now or {}
        moved = [
            label
            for label in anatomy.seeds
            if label in positions and not (label in before and np.array_equal(before[label], positions[label]))
        ]
        try:
            if moved and p.snapSeeds:
                cavity = self._logic.cache.cavity(p.surface, anatomy, positions)
                self._applying = True
                for label in moved:
                    place = snapped(label, positions[label], cavity, anatomy)
                    if np.linalg.norm(place - positions[label]) > 1e-6:
                        placeSeed(p.seeds, label, place)
        finally:
            self._applying = False
            self._seen = seedPositions(p.seeds)
            self.history.record(self._seen)
        prepareSeedsNode(p.seeds, anatomy)

    def _bringUpToDate(self, anatomy) -> None:
        p = self._parameters
        label = nextSeed(p.seeds, anatomy)
        if label is not None:
            cavity = self._logic.cache.cavity(p.surface, anatomy, self._seen)
            reasons = placementProblems(self._seen, cavity, anatomy)
            self._report("seeds", next(iter(reasons.values()), ""), reasons)
            return
        if slicer.modules.markups.logic().GetActiveListID() == p.seeds.GetID():
            # A node of the user's may take more points than there are seeds.
            self._logic.stopPlacing()
        now = fingerprint(self._logic.cache.surface(p.surface), self._seen, self._logic.settingsFrom(p))
        tried, error = self._tried or (None, None)
        # Not made into a map without being asked: somebody may have wanted to keep it as it is.
        refuseCopy(p.map)
        if isMapOf(p.map, p.surface) and p.map.GetAttribute(FINGERPRINT) == now:
            self._tried = (now, None)
            self._report("map", "", {})
        elif tried == now and error is not None:
            raise error
        elif tried == now and p.map is None:
            self._report("outdated", "There is no map; it was deleted. Press Flatten to make it again.", {})
        elif not p.liveUpdate:
            self._report("outdated", "The map does not show the present seeds and settings. Press Flatten.", None)
        else:
            self._tried = (now, None)
            try:
                self._logic.flattenParameters(p)
            except LAFlatteningError as failure:
                self._tried = (now, failure)
                raise
            self._report("map", "", {})

    # ---- what both need ----------------------------------------------------------------------------------------------

    def _apply(self, positions: Positions) -> None:
        p = self._parameters
        if p.seeds is None:
            return
        self._applying = True
        try:
            setPositions(p.seeds, positions, self._logic.anatomy(p.template))
        finally:
            self._applying = False
        self._seen = seedPositions(p.seeds)
        self._requestSettle()

    def _report(self, stage: str, message: str = "", reasons: Mapping[str, str] | None = None) -> None:
        """Mark the seeds and tell the panel; `reasons` None leaves the marks as they are."""
        p = self._parameters
        label = None
        if p.seeds is not None:
            anatomy = self._logic.anatomy(p.template)
            label = nextSeed(p.seeds, anatomy)
            if reasons is not None:
                self._applying = True
                try:
                    markSeeds(p.seeds, reasons, anatomy)
                finally:
                    self._applying = False
        self._onReport(Report(stage, message, dict(reasons or {}), label))


def surfaceMoved() -> int:
    """The event of a node whose parent transform has changed."""
    return slicer.vtkMRMLTransformableNode.TransformModifiedEvent


def reasonsOf(error: LAFlatteningError) -> dict[str, str]:
    """Seed -> reason, for an error that is about seeds."""
    return {label: str(error) for label in error.labels} if isinstance(error, SeedError) else {}
