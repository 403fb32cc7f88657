"""The two views: atrium left, map right; what is shown in which, and how the map view behaves."""

from __future__ import annotations

import slicer
import vtk
from slicer.util import VTKObservationMixin

LAYOUT_ID = 7391
MAP_VIEW, ATRIUM_VIEW = "LAFlatteningMap", "1"
"""Singleton tags. The atrium has the ordinary 3D view, so that it is still there in other layouts."""
MAP_VIEW_GROUP = 7391
LAYOUT = f"""
<layout type="horizontal" split="true">
  <item><view class="vtkMRMLViewNode" singletontag="{ATRIUM_VIEW}">
    <property name="viewlabel" action="default">1</property>
  </view></item>
  <item><view class="vtkMRMLViewNode" singletontag="{MAP_VIEW}">
    <property name="viewlabel" action="default">M</property>
    <property name="viewgroup" action="default">{MAP_VIEW_GROUP}</property>
  </view></item>
</layout>"""
MARGIN = 1.18
"""Width of what the map view shows, in disk diameters: the name above the disk needs room."""
CAMERA_DISTANCE = 5.0
"""Of the camera from the map, in disk diameters."""
ELSEWHERE = "LAFlattening.elsewhere"
"""Attribute of display nodes that were shown everywhere and are now shown everywhere but on the map: the views."""
WHITE = (1.0, 1.0, 1.0)


def addLayout() -> None:
    """Make the layout with both views known, so that a saved scene can show it; nothing without a layout manager.

    Where a scene has asked for it in vain, and all views are gone, it is shown.
    """
    manager = slicer.app.layoutManager()
    if manager is None:
        return
    layoutNode = manager.layoutLogic().GetLayoutNode()
    if layoutNode.IsLayoutDescription(LAYOUT_ID):
        layoutNode.SetLayoutDescription(LAYOUT_ID, LAYOUT)
    else:
        layoutNode.AddLayoutDescription(LAYOUT_ID, LAYOUT)
    if layoutNode.GetViewArrangement() == LAYOUT_ID and not layoutNode.GetCurrentLayoutDescription():
        manager.setLayout(LAYOUT_ID)


def showLayout() -> None:
    """Switch to the layout with both views; nothing where there is no layout manager."""
    addLayout()
    if slicer.app.layoutManager() is not None:
        slicer.app.layoutManager().setLayout(LAYOUT_ID)


def viewNode(tag: str) -> slicer.vtkMRMLViewNode | None:
    """A 3D view by its singleton tag."""
    node = slicer.mrmlScene.GetSingletonNode(tag, "vtkMRMLViewNode")
    return node if node is not None and node.GetScene() is not None else None


def threeDView(node: slicer.vtkMRMLViewNode | None):
    """The view widget that shows a view node now; None if there is none."""
    manager = slicer.app.layoutManager()
    if manager is None or node is None:
        return None
    for index in range(manager.threeDViewCount):
        widget = manager.threeDWidget(index)
        if widget.mrmlViewNode() is node:
            return widget.threeDView()
    return None


def cameraOf(node: slicer.vtkMRMLViewNode) -> slicer.vtkMRMLCameraNode | None:
    """The camera of a view."""
    return slicer.modules.cameras.logic().GetViewActiveCameraNode(node)


class MapView(VTKObservationMixin):
    """Keeps the view of the map flat: orthographic, from above, to be panned and zoomed only."""

    def __init__(self) -> None:
        super().__init__()
        self._diameter = 100.0
        self._camera: slicer.vtkMRMLCameraNode | None = None
        self._busy = False

    @property
    def node(self) -> slicer.vtkMRMLViewNode | None:
        """The view node; None before the layout is shown."""
        return viewNode(MAP_VIEW)

    def setUp(self, diskDiameter: float) -> None:
        """Set what closing a scene resets, and frame a disk of a diameter (mm) about the origin."""
        node = self.node
        if node is None:
            return
        modifying = node.StartModify()
        node.SetBoxVisible(False)
        node.SetAxisLabelsVisible(False)
        node.SetOrientationMarkerType(node.OrientationMarkerTypeNone)
        node.SetRenderMode(node.Orthographic)
        node.SetBackgroundColor(*WHITE)
        node.SetBackgroundColor2(*WHITE)
        node.EndModify(modifying)
        self._lockRotation()
        self.frame(diskDiameter)

    def frame(self, diskDiameter: float) -> None:
        """Show the whole disk, whatever the shape of the window."""
        node = self.node
        camera = cameraOf(node) if node is not None else None
        if camera is None:
            return
        self._diameter = diskDiameter
        self._busy = True
        try:
            # The field of view is what the height of the window shows.
            view = threeDView(node)
            width, height = view.renderWindow().GetSize() if view is not None else (1, 1)
            node.SetFieldOfView(MARGIN * diskDiameter * max(1.0, height / max(width, 1)))
            modifying = camera.StartModify()
            camera.SetFocalPoint(0.0, 0.0, 0.0)
            camera.SetPosition(0.0, 0.0, CAMERA_DISTANCE * diskDiameter)
            camera.SetViewUp(0.0, 1.0, 0.0)
            camera.SetParallelScale(0.5 * node.GetFieldOfView())
            camera.EndModify(modifying)
            camera.ResetClippingRange()
        finally:
            self._busy = False
        if self._camera is not camera:
            if self._camera is not None:
                self.removeObserver(self._camera, vtk.vtkCommand.ModifiedEvent, self._onCamera)
            self._camera = camera
            self.addObserver(camera, vtk.vtkCommand.ModifiedEvent, self._onCamera)

    def stop(self) -> None:
        """No longer look after the camera."""
        self.removeObservers()
        self._camera = None

    def _lockRotation(self) -> None:
        """Dragging with the left button moves the map instead of turning it."""
        view = threeDView(self.node)
        if view is None:
            return
        manager = view.displayableManagerByClassName("vtkMRMLCameraDisplayableManager")
        widget = manager.GetCameraWidget() if manager is not None else None
        if widget is None:
            return
        none = vtk.vtkWidgetEvent.NoEvent
        press, free = vtk.vtkCommand.LeftButtonPressEvent, vtk.vtkEvent.NoModifier
        widget.SetEventTranslationClickAndDrag(
            widget.WidgetStateIdle, press, free, widget.WidgetStateRotate, none, none
        )
        widget.SetEventTranslationClickAndDrag(
            widget.WidgetStateIdle, press, free, widget.WidgetStateTranslate,
            widget.WidgetEventTranslateStart, widget.WidgetEventTranslateEnd,
        )  # fmt: skip
        spin = vtk.vtkEvent.ControlModifier
        widget.SetEventTranslationClickAndDrag(widget.WidgetStateIdle, press, spin, widget.WidgetStateSpin, none, none)

    def _onCamera(self, camera: slicer.vtkMRMLCameraNode, _event: object) -> None:
        """Undo turns that come by other ways than the mouse: keys, the buttons of the view's controller."""
        if self._busy:
            return
        x, y, z = camera.GetFocalPoint()
        up, position = camera.GetViewUp(), camera.GetPosition()
        distance = CAMERA_DISTANCE * self._diameter
        straight = abs(position[0] - x) < 1e-6 * distance and abs(position[1] - y) < 1e-6 * distance
        if straight and position[2] > z and abs(up[1] - 1.0) < 1e-9 and abs(z) < 1e-6 * distance:
            return
        self._busy = True
        try:
            modifying = camera.StartModify()
            camera.SetFocalPoint(x, y, 0.0)
            camera.SetPosition(x, y, distance)
            camera.SetViewUp(0.0, 1.0, 0.0)
            camera.EndModify(modifying)
            camera.ResetClippingRange()
        finally:
            self._busy = False


def showEverywhere() -> None:
    """Show what was kept out of the map view in all views again, those that are made later too."""
    for display in slicer.util.getNodesByClass("vtkMRMLDisplayNode"):
        kept = display.GetAttribute(ELSEWHERE)
        if kept is None:
            continue
        # Where somebody has chosen other views since, they stay.
        if kept == " ".join(_viewsOf(display)):
            display.RemoveAllViewNodeIDs()
        display.RemoveAttribute(ELSEWHERE)


def _viewsOf(display: slicer.vtkMRMLDisplayNode) -> list[str]:
    """The views in which a node is shown; none for all."""
    return [display.GetNthViewNodeID(k) for k in range(display.GetNumberOfViewNodeIDs())]


class Visibility(VTKObservationMixin):
    """Shows some nodes in the map view only and everything else in all views but that one."""

    def __init__(self) -> None:
        super().__init__()
        self._mapNodes: set[str] = set()

    def start(self) -> None:
        """Keep what is in the scene, and what is added to it, out of the map view."""
        scene = slicer.mrmlScene
        if not self.hasObserver(scene, slicer.vtkMRMLScene.NodeAddedEvent, self._onNodeAdded):
            self.addObserver(scene, slicer.vtkMRMLScene.NodeAddedEvent, self._onNodeAdded)
        self.update()

    def stop(self) -> None:
        """No longer look after nodes that are added."""
        self.removeObservers()

    def setMapNodes(self, nodes: list[slicer.vtkMRMLDisplayableNode]) -> None:
        """The nodes that belong on the map."""
        self._mapNodes = {node.GetID() for node in nodes}
        self.update()

    def update(self) -> None:
        """Set the views of all display nodes."""
        mapView = viewNode(MAP_VIEW)
        if mapView is None:
            return
        scene = slicer.mrmlScene
        others = [
            node.GetID()
            for node in slicer.util.getNodesByClass("vtkMRMLAbstractViewNode", scene)
            if node is not mapView
        ]
        for display in slicer.util.getNodesByClass("vtkMRMLDisplayNode", scene):
            owner = display.GetDisplayableNode()
            now = _viewsOf(display)
            if owner is not None and owner.GetID() in self._mapNodes:
                wanted = [mapView.GetID()]
            elif not now or display.GetAttribute(ELSEWHERE) == " ".join(now):
                display.SetAttribute(ELSEWHERE, " ".join(others))
                wanted = others
            else:
                # Somebody has chosen views for this one; only the map view is taken from it.
                wanted = [view for view in now if view != mapView.GetID()] or others
            if now != wanted:
                display.SetViewNodeIDs(wanted)

    @vtk.calldata_type(vtk.VTK_OBJECT)
    def _onNodeAdded(self, _caller: object, _event: object, node: slicer.vtkMRMLNode) -> None:
        if isinstance(node, (slicer.vtkMRMLDisplayNode, slicer.vtkMRMLAbstractViewNode)):
            self.update()
