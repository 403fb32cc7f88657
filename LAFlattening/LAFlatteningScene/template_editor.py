"""The map follows its template while that is edited: by handles on the map, or by numbers."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import slicer
import vtk
from slicer.util import VTKObservationMixin

from LAFlatteningLib import LAFlatteningError, Template, TemplateError, distortion

from .live_update import Scheduler
from .map_nodes import refuseCopy, settingsOf, writeMap
from .scene_end import stopWithScene
from .seed_nodes import nextSeed, seedPositions
from .surface_nodes import Settings
from .template_handles import Handle, HandlesNode
from .template_text import isContent, templateOf, textOf
from .throttle import Throttle

if TYPE_CHECKING:
    from LAFlattening import LAFlatteningLogic, LAFlatteningParameterNode

REST = 500
"""Milliseconds without another edit after which the map is made in full."""


@dataclass(frozen=True)
class EditReport:
    """What the panel shows of an edit.

    Attributes
    ----------
    template : as it is edited now.
    message : what is impossible about the last edit, which was not taken; empty if there is nothing to say.
    summary : of the distortion of the quick map, see `distortion.summary`; None where there is no such map.
    folded : triangles of the quick map that are turned over.
    handle : the handle that was dragged last.
    """

    template: Template
    message: str = ""
    summary: dict[str, Any] | None = None
    folded: int = 0
    handle: Handle | None = None


class TemplateEditor(VTKObservationMixin):
    """Follows the template of a parameter node; see `TemplateLogic.startTemplateEditing`.

    An edit is *proposed* (the quick map shows it) and *taken* when a handle is let go, or after a pause: it is then the
    template of the parameter node, and the map is made in full by `LiveUpdate`.
    """

    def __init__(
        self,
        logic: LAFlatteningLogic,
        parameterNode: LAFlatteningParameterNode,
        scheduler: Scheduler,
        onEdited: Callable[[EditReport], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__()
        self._logic, self._parameters = logic, parameterNode
        self._scheduler, self._onEdited = scheduler, onEdited or (lambda report: None)
        self._throttle = Throttle(scheduler, clock)
        self._proposed: Template | None = None
        self._handles: HandlesNode | None = None
        self._held: int | None = None
        self._last: Handle | None = None
        self._dragging = self._applying = self._stopped = False
        self._ticket = 0
        self._past: list[str] = []
        self._future: list[str] = []
        self._now = parameterNode.template
        self._base = self._now
        self.addObserver(parameterNode, vtk.vtkCommand.ModifiedEvent, self._onParameters)
        stopWithScene(self)
        self._follow()

    def stop(self) -> None:
        """No longer follow; what was proposed and not taken is dropped, the handles go."""
        self._stopped = True
        self.removeObservers()
        self._throttle.cancel()
        self._removeHandles()

    @property
    def template(self) -> Template:
        """The template as it is edited now."""
        return self._proposed or templateOf(self._parameters.template)

    @property
    def base(self) -> str:
        """The text of the template with which editing began."""
        return self._base

    @property
    def handlesNode(self) -> slicer.vtkMRMLMarkupsFiducialNode | None:
        """The handles, while they are shown."""
        return self._handles.node if self._handles is not None and self._handles.isAlive else None

    # ---- edits -------------------------------------------------------------------------------------------------------

    def propose(self, template: Template) -> None:
        """Show an edited template at once, and take it when no other edit follows."""
        self._proposed = template
        self._placeHandles()
        self._throttle.request(self._preview)
        self._ticket += 1
        ticket = self._ticket
        self._scheduler(REST, lambda: self._rest(ticket))

    def take(self) -> None:
        """What was proposed is now the template of the parameter node."""
        self._throttle.cancel()
        proposed, self._proposed = self._proposed, None
        if proposed is not None:
            self._parameters.template = textOf(proposed)
        self._placeHandles()

    @property
    def canUndo(self) -> bool:
        """Whether the template was changed."""
        return bool(self._past) or self._proposed is not None

    @property
    def canRedo(self) -> bool:
        """Whether a change was undone, and none made since."""
        return bool(self._future)

    def undo(self) -> None:
        """Go back to the template before the last change."""
        self.take()
        if self._past:
            self._future.append(self._now)
            self._go(self._past.pop())

    def redo(self) -> None:
        """Make the change again that was undone last."""
        self.take()
        if self._future:
            self._past.append(self._now)
            self._go(self._future.pop())

    def _go(self, text: str) -> None:
        self._now = text
        self._parameters.template = text

    # ---- events ------------------------------------------------------------------------------------------------------

    def _onParameters(self, _caller: object = None, _event: object = None) -> None:
        if self._stopped:
            return
        p, text = self._parameters, self._parameters.template
        if text != self._now:
            self._past.append(self._now)
            self._future.clear()
            self._now = text
        if isContent(text):
            if p.ownTemplate != text:
                p.ownTemplate = text
        else:
            self._base = text
        self._follow()

    def _follow(self) -> None:
        """Show or hide the handles."""
        p = self._parameters
        if not p.editTemplate or p.map is None or p.map.GetScene() is None:
            self._removeHandles()
            return
        if self.handlesNode is None:
            self._removeHandles()
            self._handles = HandlesNode(slicer.mrmlScene)
            node = self._handles.node
            self.addObserver(node, node.PointStartInteractionEvent, self._onDragStart)
            self.addObserver(node, node.PointEndInteractionEvent, self._onDragEnd)
            self.addObserver(node, node.PointModifiedEvent, self._onHandles)
            self._placeHandles()
            self._logic.updateViews()
        if self._proposed is None:
            self._placeHandles()

    def _removeHandles(self) -> None:
        handles, self._handles = self._handles, None
        self._dragging, self._held = False, None
        if handles is None:
            return
        node = handles.node
        for event, method in (
            (node.PointStartInteractionEvent, self._onDragStart),
            (node.PointEndInteractionEvent, self._onDragEnd),
            (node.PointModifiedEvent, self._onHandles),
        ):
            if self.hasObserver(node, event, method):
                self.removeObserver(node, event, method)
        handles.remove()

    def _onDragStart(self, _caller: object = None, _event: object = None) -> None:
        self._dragging = True

    def _onDragEnd(self, _caller: object = None, _event: object = None) -> None:
        self._dragging, self._held = False, None
        self.take()

    def _onHandles(self, _caller: object = None, _event: object = None) -> None:
        """A handle was moved, by mouse or by a script."""
        if self._applying or self._stopped or self._handles is None:
            return
        for k, place in self._handles.moved():
            handle = self._handles.handles[k]
            self._held, self._last = (k if self._dragging else None), handle
            try:
                edited = handle.dragged(self.template, place)
            except TemplateError as error:
                self._onEdited(EditReport(self.template, str(error), handle=handle))
                if not self._dragging:
                    self._placeHandles()
                return
            self.propose(edited)
            return

    def _rest(self, ticket: int) -> None:
        if ticket == self._ticket and not self._stopped and not self._dragging and self._proposed is not None:
            self.take()

    # ---- what is shown -----------------------------------------------------------------------------------------------

    def _placeHandles(self) -> None:
        if self.handlesNode is None or self._handles is None:
            return
        self._applying = True
        try:
            self._handles.show(self.template, self._diameter(), self._held)
        finally:
            self._applying = False

    def _diameter(self) -> float:
        p = self._parameters
        return settingsOf(p.map).diskDiameter if p.map is not None else float(p.diskDiameter)

    def _preview(self) -> None:
        p, template = self._parameters, self.template
        report = EditReport(template, handle=self._last)
        try:
            if self._canPreview(template):
                refuseCopy(p.map)
                settings = self._logic.settingsFrom(p)
                flattener = self._logic.cache.flattener(p.surface, settings)
                quick = flattener.preview_template(template, seedPositions(p.seeds))
                shown = Settings(textOf(template), settings.method, settings.checkAxes, self._diameter())
                writeMap(p.map, quick, p.surface, shown, "preview")
                figures = distortion.summary(quick.surface.points, quick.triangles, quick.points)
                folded = len(distortion.folded_triangles(quick.points, quick.triangles))
                report = EditReport(template, "", figures, folded, self._last)
        except LAFlatteningError as error:
            report = EditReport(template, str(error), handle=self._last)
        self._onEdited(report)

    def _canPreview(self, template: Template) -> bool:
        p = self._parameters
        if None in (p.surface, p.seeds, p.map) or self._logic.isBusy:
            return False
        return nextSeed(p.seeds, template.anatomy) is None
