"""Keeps views, colours, overlay and cursor as the parameter node says."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import slicer
import vtk
from slicer.util import VTKObservationMixin

from LAFlatteningLib import LAFlatteningError

from .colouring import colourBarOf, updateColourBar
from .cursor import LinkedCursor
from .display_link import DisplayLink
from .live_update import surfaceMoved
from .map_nodes import STAGE, belongsTo, isCopy, settingsOf
from .openings import hideOpenings, openingsNode, showOpenings
from .overlay import overlayOf, updateOverlay
from .quality_nodes import qualityNodesOf
from .result_nodes import HIDDEN, drawnOnMap, resultsOf
from .scene_end import stopWithScene
from .seed_nodes import seedPositions
from .surface_nodes import Settings
from .views import ATRIUM_VIEW, MAP_VIEW, MapView, Visibility, threeDView, viewNode

if TYPE_CHECKING:
    from LAFlattening import LAFlatteningLogic, LAFlatteningParameterNode

DISPLAY_MODIFIED = slicer.vtkMRMLDisplayableNode.DisplayModifiedEvent

PUT_AWAY = "LAFlattening.putAway"
"""Attribute of a map that is hidden because another one, or none, is chosen."""


class LinkedViews(VTKObservationMixin):
    """Follows the nodes of a parameter node in the views; see `LAFlatteningLogic.linkViews`."""

    def __init__(
        self,
        logic: LAFlatteningLogic,
        parameterNode: LAFlatteningParameterNode,
        onReadout: Callable[[str], None] | None = None,
        onColours: Callable[[], None] | None = None,
    ) -> None:
        super().__init__()
        self._logic, self._parameters, self._onReadout = logic, parameterNode, onReadout
        self._onColours = onColours or (lambda: None)
        self._visibility, self.mapView = Visibility(), MapView()
        self._colours: DisplayLink | None = None
        self.cursor: LinkedCursor | None = None
        self._linked: tuple[object, ...] = ()
        self._framed: tuple[object, ...] = ()
        self._surface: slicer.vtkMRMLModelNode | None = None
        self._map: slicer.vtkMRMLModelNode | None = None
        self._settings: Settings | None = None
        self._drawn: tuple[str, ...] = ()
        self._busy = False
        for node in slicer.util.getNodesByClass("vtkMRMLModelNode"):
            # Of a scene that was open when another one was added.
            if node.GetAttribute(STAGE) is not None and node is not parameterNode.map:
                _putAway(node)
        self._visibility.start()
        scene = slicer.mrmlScene
        self.addObserver(parameterNode, vtk.vtkCommand.ModifiedEvent, self._onChange)
        self.addObserver(scene, scene.NodeAboutToBeRemovedEvent, self._onNodeAboutToBeRemoved)
        self.addObserver(scene, scene.NodeRemovedEvent, self._onChange)
        stopWithScene(self)
        self.update()

    def stop(self) -> None:
        """No longer follow. What is shown stays, but for the cursor's markers."""
        self.removeObservers()
        self._visibility.stop()
        self.mapView.stop()
        for part in (self._colours, self.cursor):
            if part is not None:
                part.stop()
        self._colours = self.cursor = None

    def frame(self) -> None:
        """Show the whole disk in the map view."""
        p = self._parameters
        self.mapView.frame(settingsOf(p.map).diskDiameter if p.map is not None else p.diskDiameter)

    def update(self) -> None:
        """Bring everything in line with the parameter node and the layout."""
        if self._busy:
            return
        self._busy = True
        try:
            self._updateMap()
            self._updateOpenings()
            self._updateLinks()
        finally:
            self._busy = False

    def _updateMap(self) -> None:
        p, mapNode = self._parameters, _alive(self._parameters.map)
        if mapNode is not self._map:
            if self._map is not None:
                self.removeObserver(self._map, vtk.vtkCommand.ModifiedEvent, self._onMap)
                self.removeObserver(self._map, DISPLAY_MODIFIED, self._onMapDisplay)
                _putAway(self._map)
            if mapNode is not None:
                self.addObserver(mapNode, vtk.vtkCommand.ModifiedEvent, self._onMap)
                self.addObserver(mapNode, DISPLAY_MODIFIED, self._onMapDisplay)
                _takeOut(mapNode)
            self._map = mapNode
        self._settings = settingsOf(mapNode) if mapNode is not None else None
        onMap = []
        if mapNode is not None and mapNode.GetPolyData() is not None:
            overlay = updateOverlay(mapNode)
            for node, visible in zip(overlay, (p.showTemplate, p.showLabels), strict=True):
                if bool(node.GetDisplayNode().GetVisibility()) != visible:
                    node.GetDisplayNode().SetVisibility(visible)
            onMap = [mapNode, *overlay, *drawnOnMap(mapNode), *self._handles()]
            self._drawn = _displaysOn(mapNode)
            updateColourBar(mapNode, p.showColourBar)
        if self.cursor is not None:
            onMap.append(self.cursor.markers["map"])
        self._visibility.setMapNodes(onMap)
        view = viewNode(MAP_VIEW)
        diameter = self._settings.diskDiameter if self._settings is not None else p.diskDiameter
        # Framed anew only then: the user may have zoomed in.
        now = (view, threeDView(view) is not None, diameter)
        if view is not None and now != self._framed:
            self._framed = now
            self.mapView.setUp(diameter)

    def _updateOpenings(self) -> None:
        p = self._parameters
        surface = _alive(p.surface)
        if surface is not self._surface:
            if self._surface is not None:
                self.removeObserver(self._surface, slicer.vtkMRMLModelNode.MeshModifiedEvent, self._onChange)
                self.removeObserver(self._surface, surfaceMoved(), self._onChange)
                self.removeObserver(self._surface, DISPLAY_MODIFIED, self._onSurfaceDisplay)
                hideOpenings(self._surface)
            self._surface = surface
            if surface is not None:
                self.addObserver(surface, slicer.vtkMRMLModelNode.MeshModifiedEvent, self._onChange)
                self.addObserver(surface, surfaceMoved(), self._onChange)
                self.addObserver(surface, DISPLAY_MODIFIED, self._onSurfaceDisplay)
        if surface is None:
            return
        try:
            if not p.showOpenings:
                hideOpenings(surface)
                return
            anatomy = self._logic.anatomy(p.template)
            showOpenings(surface, self._logic.cache.cavity(surface, anatomy, seedPositions(p.seeds)))
        except LAFlatteningError:
            # The same error is shown where the map is asked for; a surface without openings has no covers to show.
            hideOpenings(surface)

    def _updateLinks(self) -> None:
        p, surface, mapNode = self._parameters, self._surface, self._map
        atriumView, mapView = viewNode(ATRIUM_VIEW), viewNode(MAP_VIEW)
        diameter = self._settings.diskDiameter if self._settings is not None else 0.0
        belonging = surface is not None and mapNode is not None and belongsTo(mapNode, surface) and not isCopy(mapNode)
        now = (
            surface,
            mapNode,
            belonging,
            p.linkCursor,
            atriumView,
            mapView,
            threeDView(mapView) is not None,
            diameter,
        )
        if now == self._linked:
            return
        self._linked = now
        for part in (self._colours, self.cursor):
            if part is not None:
                part.stop()
        self._colours = self.cursor = None
        if surface is None or mapNode is None or not belonging:
            return
        self._colours = DisplayLink(surface, mapNode)
        if p.linkCursor:
            self.cursor = LinkedCursor(surface, mapNode, diameter, atriumView, mapView, self._onReadout)
            onMap = [mapNode, *updateOverlay(mapNode), *drawnOnMap(mapNode), *self._handles()]
            self._visibility.setMapNodes([*onMap, self.cursor.markers["map"]])

    def _handles(self) -> list[slicer.vtkMRMLMarkupsFiducialNode]:
        node = self._logic.templateHandles()
        return [node] if node is not None else []

    def _onMap(self, _caller: object = None, _event: object = None) -> None:
        """The map was made anew: with another template or diameter, frame and overlay change. Or there are results."""
        if self._busy or _alive(self._map) is None:
            return
        if settingsOf(self._map) == self._settings and _displaysOn(self._map) == self._drawn:
            return
        self.update()

    def _onChange(self, _caller: object = None, _event: object = None) -> None:
        self.update()

    def _onMapDisplay(self, _caller: object = None, _event: object = None) -> None:
        """The colour bar shows the array that is shown."""
        if not self._busy and _alive(self._map) is not None and self._map.GetDisplayNode() is not None:
            self._busy = True
            try:
                if updateColourBar(self._map, self._parameters.showColourBar):
                    # It was added to the scene before it belonged to the map.
                    self._visibility.update()
            finally:
                self._busy = False

    def _onSurfaceDisplay(self, _caller: object = None, _event: object = None) -> None:
        self._onColours()

    @vtk.calldata_type(vtk.VTK_OBJECT)
    def _onNodeAboutToBeRemoved(self, _caller: object, _event: object, node: slicer.vtkMRMLNode) -> None:
        """What belongs to a node goes with it."""
        if not isinstance(node, slicer.vtkMRMLModelNode):
            return
        # The node is still in the scene: an update now would make anew what goes here. Its own removal brings one.
        wasBusy, self._busy = self._busy, True
        try:
            for belonging in belongingsOf(node):
                slicer.mrmlScene.RemoveNode(belonging)
        finally:
            self._busy = wasBusy


def _displaysOn(mapNode: slicer.vtkMRMLModelNode) -> tuple[str, ...]:
    """Which results are drawn on a map."""
    return tuple(node.GetDisplayNodeID() or "" for node in drawnOnMap(mapNode))


def _putAway(mapNode: slicer.vtkMRMLModelNode) -> None:
    """Hide a map that is no longer chosen: outside the map view it would lie about in that of the atrium."""
    belonging = (mapNode, *overlayOf(mapNode), *drawnOnMap(mapNode))
    shown = [node for node in belonging if node is not None and node.GetDisplayNode() is not None]
    if shown and mapNode.GetScene() is not None and mapNode.GetDisplayVisibility():
        mapNode.SetAttribute(PUT_AWAY, "1")
        for node in shown:
            node.SetDisplayVisibility(False)


def _takeOut(mapNode: slicer.vtkMRMLModelNode) -> None:
    """Show a map again that was put away, and no other: the user may have hidden it."""
    if mapNode.GetAttribute(PUT_AWAY):
        mapNode.RemoveAttribute(PUT_AWAY)
        for node in (mapNode, *drawnOnMap(mapNode)):
            if not node.GetAttribute(HIDDEN):
                node.SetDisplayVisibility(True)


def belongingsOf(node: slicer.vtkMRMLModelNode) -> list[slicer.vtkMRMLNode]:
    """What has no meaning without an atrium or a map: overlay, covers, colour bar, tables and charts, results."""
    found = [*overlayOf(node), openingsNode(node), colourBarOf(node), *qualityNodesOf(node), *resultsOf(node)]
    return [node for node in found if node is not None and node.GetScene() is not None]


def _alive(node: slicer.vtkMRMLModelNode | None) -> slicer.vtkMRMLModelNode | None:
    """A node that is in a scene; one that is being removed may still be referred to."""
    return node if node is not None and node.GetScene() is not None else None
