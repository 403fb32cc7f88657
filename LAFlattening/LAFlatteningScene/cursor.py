"""The linked cursor: what is pointed at on the map is marked on the atrium, and the other way round."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import slicer
import vtk
from slicer.util import VTKObservationMixin
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

from LAFlatteningLib import LEFT_ATRIUM
from LAFlatteningLib.flattening.flat_map import POINT_ID_ARRAY, REGION_ARRAY
from LAFlatteningLib.shading import label_of

from .display_link import activeArray
from .surface_nodes import worldPoints
from .views import cameraOf, threeDView

TOLERANCE_MM = 2.0
"""The cursor is on a model if it is not farther from it."""
UNSURE_MM = 0.2
"""Where both models are as near as this to each other, the cursor stays on the one that it was on."""
CLICK_PIXELS = 3
"""A button released this near to where it was pressed is a click; farther, the map was moved."""
MARKER_COLOUR = (1.0, 0.1, 0.6)
MARKER_RADIUS = {"atrium": 1.8, "map": 0.012}
"""Of the markers: mm on the atrium, disk diameters on the map."""
MARKER = "LAFlattening.marker"
"""Attribute of the marker nodes: on which model they are."""

ModelNode = slicer.vtkMRMLModelNode


@dataclass(frozen=True)
class Place:
    """A place in a triangle of map and atrium.

    Attributes
    ----------
    triangle : number of the triangle of the map.
    ids, weights : its points, and the barycentric coordinates in it, (3,) each.
    atrium, map : (3,) RAS, mm, world.
    """

    triangle: int
    ids: np.ndarray
    weights: np.ndarray
    atrium: np.ndarray
    map: np.ndarray


class Correspondence:
    """Finds places of the map on the atrium and the other way round; both as they are now."""

    def __init__(self, surfaceNode: ModelNode, mapNode: ModelNode) -> None:
        self.surfaceNode, self.mapNode = surfaceNode, mapNode
        self._keys: dict[str, tuple[int, ...]] = {}
        self._points: dict[str, np.ndarray] = {}
        self._triangles = np.zeros((0, 3), np.int64)
        self._locators: dict[str, vtk.vtkStaticCellLocator] = {}

    def find(self, on: str, position: np.ndarray) -> tuple[float, Place] | None:
        """The place of one model nearest to a position, with the distance in mm.

        Parameters
        ----------
        on : "atrium" or "map".
        position : (3,) RAS, mm, world.
        """
        if not self._update():
            return None
        nearest, cell, sub, squared = [0.0] * 3, vtk.reference(0), vtk.reference(0), vtk.reference(0.0)
        self._locators[on].FindClosestPoint(
            [float(x) for x in position], nearest, vtk.vtkGenericCell(), cell, sub, squared
        )
        ids = self._triangles[int(cell)]
        weights = barycentric(np.array(nearest), self._points[on][ids])
        places = {name: weights @ points[ids] for name, points in self._points.items()}
        return float(squared) ** 0.5, Place(int(cell), ids, weights, places["atrium"], places["map"])

    def outward(self, place: Place) -> np.ndarray:
        """The unit normal of the atrium at a place, (3,), away from its inside."""
        a, b, c = self._points["atrium"][place.ids]
        normal = np.cross(b - a, c - a)
        return normal / max(float(np.linalg.norm(normal)), 1e-12)

    def _update(self) -> bool:
        """Build the locators anew if a model has changed; False if the two do not belong together."""
        surface, flat = self.surfaceNode.GetPolyData(), self.mapNode.GetPolyData()
        if surface is None or flat is None or flat.GetNumberOfPolys() == 0:
            return False
        ids = flat.GetPointData().GetArray(POINT_ID_ARRAY)
        if ids is None or ids.GetRange()[1] >= surface.GetNumberOfPoints():
            return False
        for name, node, mesh in (("atrium", self.surfaceNode, surface), ("map", self.mapNode, flat)):
            # While a seed is dragged, only the points of the map change.
            parts = (mesh.GetPoints(), flat.GetPolys(), ids)
            key = (*(part.GetMTime() for part in parts), _transformTime(node.GetParentTransformNode()))
            if key == self._keys.get(name):
                continue
            self._triangles = vtk_to_numpy(flat.GetPolys().GetConnectivityArray()).reshape(-1, 3).astype(np.int64)
            points = worldPoints(node)
            self._points[name] = points[vtk_to_numpy(ids)] if name == "atrium" else points
            located = vtk.vtkPolyData()
            vtkPoints = vtk.vtkPoints()
            vtkPoints.SetData(numpy_to_vtk(self._points[name], deep=True))
            located.SetPoints(vtkPoints)
            located.SetPolys(flat.GetPolys())
            self._locators[name] = vtk.vtkStaticCellLocator()
            self._locators[name].SetDataSet(located)
            self._locators[name].BuildLocator()
            self._keys[name] = key
        return True


def _transformTime(node: slicer.vtkMRMLTransformNode | None) -> int:
    """A number that grows when a transform or one above it changes."""
    time = 0
    while node is not None:
        time = max(time, node.GetTransformToWorldMTime())
        node = node.GetParentTransformNode()
    return time


def barycentric(position: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Weights (3,) of the corners (3, 3) of a triangle that give a position in its plane; not negative, sum 1."""
    a, b = corners[1] - corners[0], corners[2] - corners[0]
    gram = np.array([[a @ a, a @ b], [a @ b, b @ b]])
    if np.linalg.det(gram) <= 1e-18 * max(a @ a, b @ b) ** 2:
        nearest = np.linalg.norm(corners - position, axis=1).argmin()
        return np.eye(3)[nearest]
    u, v = np.linalg.solve(gram, np.array([a @ (position - corners[0]), b @ (position - corners[0])]))
    weights = np.clip([1.0 - u - v, u, v], 0.0, 1.0)
    return weights / weights.sum()


def readout(place: Place, surfaceNode: ModelNode, mapNode: ModelNode) -> str:
    """What is at a place: region, value of the array shown on the atrium (or else on the map), position."""
    parts = []
    regions = mapNode.GetPolyData().GetCellData().GetArray(REGION_ARRAY)
    if regions is not None:
        number = int(regions.GetTuple1(place.triangle))
        name = LEFT_ATRIUM.region_names.get(number)
        parts.append(f"R{number} {name}" if name else f"R{number}")
    value = _value(place, mapNode, activeArray(surfaceNode) or activeArray(mapNode))
    if value:
        parts.append(value)
    right, anterior, superior = place.atrium
    parts.append(
        f"{'R' if right >= 0 else 'L'} {abs(right):.1f}, {'A' if anterior >= 0 else 'P'} {abs(anterior):.1f}, "
        f"{'S' if superior >= 0 else 'I'} {abs(superior):.1f} mm"
    )
    return "  ·  ".join(parts)


def _value(place: Place, mapNode: ModelNode, shown: vtk.vtkDataArray | None) -> str:
    """Name and value of an array, between the points by barycentric weights; whole numbers as they are nearest."""
    if shown is None or shown.GetName() == REGION_ARRAY:
        return ""
    flat, name = mapNode.GetPolyData(), shown.GetName()
    array = flat.GetPointData().GetArray(name)
    if array is not None:
        values = np.array([array.GetTuple(int(k)) for k in place.ids])
        whole = array.GetDataType() not in (vtk.VTK_FLOAT, vtk.VTK_DOUBLE)
        value = values[place.weights.argmax()] if whole else place.weights @ values
    elif flat.GetCellData().HasArray(name):
        value = np.array(flat.GetCellData().GetArray(name).GetTuple(place.triangle))
    else:
        return ""
    label = label_of(name)
    numbers = ", ".join("no value" if np.isnan(x) else f"{x:.4g}" for x in value)
    return f"{label}: {numbers}"


class LinkedCursor(VTKObservationMixin):
    """Follows the mouse over both models, and turns the atrium where the map is clicked."""

    def __init__(
        self,
        surfaceNode: ModelNode,
        mapNode: ModelNode,
        diskDiameter: float,
        atriumView: slicer.vtkMRMLViewNode | None,
        mapView: slicer.vtkMRMLViewNode | None,
        onReadout: Callable[[str], None] | None = None,
    ) -> None:
        super().__init__()
        self._places = Correspondence(surfaceNode, mapNode)
        self._diameter = diskDiameter
        self._atriumView, self._mapView = atriumView, mapView
        self._onReadout = onReadout or (lambda text: None)
        self._on: str | None = None
        self._pressed: tuple[int, int] | None = None
        self._crosshair = slicer.mrmlScene.GetSingletonNode("default", "vtkMRMLCrosshairNode")
        self.markers = {name: _marker(name, diskDiameter) for name in ("atrium", "map")}
        if self._crosshair is not None:
            self.addObserver(self._crosshair, slicer.vtkMRMLCrosshairNode.CursorPositionModifiedEvent, self._onCursor)
        view = threeDView(mapView)
        if view is not None:
            # Before the view's own reaction, which may use the event up.
            self.addObserver(view.interactor(), "LeftButtonPressEvent", self._onPress, priority=100.0)
            self.addObserver(view.interactor(), "LeftButtonReleaseEvent", self._onRelease, priority=100.0)

    def stop(self) -> None:
        """No longer follow; the markers disappear."""
        self.removeObservers()
        self._hide()

    def _onCursor(self, _caller: object = None, _event: object = None) -> None:
        position = [0.0, 0.0, 0.0]
        valid = self._crosshair.GetCursorPositionRAS(position)
        found = self.locate(np.array(position)) if valid else None
        if found is None:
            self._hide()
            self._onReadout("")
            return
        on, place = found
        other = "map" if on == "atrium" else "atrium"
        _show(self.markers[on], False)
        _move(self.markers[other], getattr(place, other))
        _show(self.markers[other], True)
        self._onReadout(readout(place, self._places.surfaceNode, self._places.mapNode))

    def locate(self, position: np.ndarray) -> tuple[str, Place] | None:
        """On which model a position (RAS, mm, world) lies, and where; None if on neither."""
        if self._places.surfaceNode.GetScene() is None or self._places.mapNode.GetScene() is None:
            return None
        found = {on: self._places.find(on, position) for on in ("atrium", "map")}
        near = {on: hit for on, hit in found.items() if hit is not None and hit[0] <= TOLERANCE_MM}
        if not near:
            return None
        on = min(near, key=lambda name: near[name][0])
        # The crosshair does not say in which view the mouse is. Where the atrium passes through the plane of the map,
        # the mouse has not left the model that it was on.
        if len(near) == 2 and self._on in near and abs(near["atrium"][0] - near["map"][0]) < UNSURE_MM:
            on = self._on
        self._on = on
        return on, near[on][1]

    def _hide(self) -> None:
        for marker in self.markers.values():
            _show(marker, False)

    def _onPress(self, interactor: vtk.vtkRenderWindowInteractor, _event: object) -> None:
        self._pressed = tuple(interactor.GetEventPosition())

    def _onRelease(self, interactor: vtk.vtkRenderWindowInteractor, _event: object) -> None:
        if self._pressed is None:
            return
        moved = np.abs(np.array(interactor.GetEventPosition()) - self._pressed).max()
        self._pressed = None
        if moved <= CLICK_PIXELS:
            self.turnTo(self._underMouse(interactor))

    def _underMouse(self, interactor: vtk.vtkRenderWindowInteractor) -> np.ndarray | None:
        """Where the line of sight through the mouse meets the plane of the map; the map view is orthographic."""
        renderer = threeDView(self._mapView).renderer()
        x, y = interactor.GetEventPosition()
        ends = []
        for depth in (0.0, 1.0):
            renderer.SetDisplayPoint(x, y, depth)
            renderer.DisplayToWorld()
            point = np.array(renderer.GetWorldPoint())
            ends.append(point[:3] / point[3])
        (_, _, z0), (_, _, z1) = ends
        return ends[0] + (0.0 - z0) / (z1 - z0) * (ends[1] - ends[0]) if z0 != z1 else None

    def turnTo(self, onMap: np.ndarray | None) -> bool:
        """Turn the atrium so that a place of the map faces the viewer; False if there is nothing at that place.

        Parameters
        ----------
        onMap : (3,) RAS, mm, world.
        """
        if onMap is None or self._atriumView is None or self._places.surfaceNode.GetScene() is None:
            return False
        found = self._places.find("map", onMap)
        camera = cameraOf(self._atriumView)
        if found is None or found[0] > TOLERANCE_MM or camera is None:
            return False
        place = found[1]
        turnCamera(camera, place.atrium, self._places.outward(place))
        _move(self.markers["atrium"], place.atrium)
        _show(self.markers["atrium"], True)
        return True


def turnCamera(camera: slicer.vtkMRMLCameraNode, target: np.ndarray, outward: np.ndarray) -> None:
    """Look at a place against a direction that points out of the surface there, from as far away as before.

    The patient's head stays up, as far as the direction allows.
    """
    distance = float(np.linalg.norm(np.array(camera.GetPosition()) - camera.GetFocalPoint()))
    up = np.array([0.0, 0.0, 1.0])
    if abs(outward @ up) > 0.98:
        up = np.array([0.0, 1.0, 0.0])
    up = up - (up @ outward) * outward
    modifying = camera.StartModify()
    camera.SetFocalPoint(*target)
    camera.SetPosition(*(target + distance * outward))
    camera.SetViewUp(*(up / np.linalg.norm(up)))
    camera.EndModify(modifying)
    camera.ResetClippingRange()


def _marker(name: str, diskDiameter: float) -> ModelNode:
    """The ball that marks a place on one of the models; not saved, not listed, not in the way of the mouse."""
    scene = slicer.mrmlScene
    for node in slicer.util.getNodesByClass("vtkMRMLModelNode"):
        if node.GetAttribute(MARKER) == name:
            break
    else:
        node = scene.CreateNodeByClass("vtkMRMLModelNode")
        node.UnRegister(None)
        node.SetName(f"Cursor on the {name}")
        node.SetAttribute(MARKER, name)
        node.SetHideFromEditors(True)
        node.SetSaveWithScene(False)
        node.SetSelectable(False)
        node = scene.AddNode(node)
        node.CreateDefaultDisplayNodes()
        display = node.GetDisplayNode()
        display.SetSaveWithScene(False)
        display.SetColor(*MARKER_COLOUR)
        display.SetLighting(name == "atrium")
        display.SetVisibility2D(False)
        display.SetVisibility(False)
    ball = vtk.vtkSphereSource()
    ball.SetRadius(MARKER_RADIUS[name] * (diskDiameter if name == "map" else 1.0))
    ball.SetThetaResolution(24)
    ball.SetPhiResolution(16)
    ball.Update()
    node.SetAndObservePolyData(ball.GetOutput())
    return node


def _move(marker: ModelNode, to: np.ndarray) -> None:
    """Move the middle of a marker to a place by moving its points: it needs no transform node of its own."""
    if marker.GetScene() is None:
        return
    points = vtk_to_numpy(marker.GetPolyData().GetPoints().GetData())
    points += (to - 0.5 * (points.min(axis=0) + points.max(axis=0))).astype(points.dtype)
    marker.GetPolyData().GetPoints().GetData().Modified()
    marker.GetPolyData().GetPoints().Modified()
    marker.GetPolyData().Modified()


def _show(marker: ModelNode, visible: bool) -> None:
    display = marker.GetDisplayNode()
    if display is not None and bool(display.GetVisibility()) != visible:
        display.SetVisibility(visible)
