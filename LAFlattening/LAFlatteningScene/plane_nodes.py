"""The planes of the openings as markups planes: where an atrium is to be cut, for the user to move and turn."""

from __future__ import annotations

import json
from collections.abc import Mapping

import numpy as np
import slicer

from LAFlatteningLib import LEFT_ATRIUM, Surface
from LAFlatteningLib.cavity.clipping import CutPlane
from LAFlatteningLib.cavity.plan import PlannedOpening
from LAFlatteningLib.cavity.sections import plane_section

INPUT_ROLE = "LAFlattening.input"
"""Node reference from planes, and from a cavity, to what is prepared."""
OPENING, SUGGESTED = "LAFlattening.opening", "LAFlattening.suggested"
"""Attributes of a plane: the name of its opening, and what was suggested (JSON: centre, normal, found_by ...)."""
BY_HAND, GIVEN = "hand", "given"
"""How a plane was found that the user is to put into place, and one that stays where the user has put it."""
ROUGH_SHARES = (0.75, 0.7, 0.65, 0.6)
"""A plane to be put into place by hand begins at one of these shares of the way from the middle to the tip ..."""
ROUGH_DEGREES = 30.0
"""... which is the farthest place within this angle of the direction in which the opening lies in most atria."""
SAME_MM = 1e-3
"""A plane nearer than this to another is that one: files hold fewer digits than memory."""
GOOD_COLOUR, BAD_COLOUR = (0.1, 0.75, 0.35), (0.9, 0.1, 0.1)
FILL_OPACITY = 0.25
MARGIN = 1.6
"""Width of the plane as shown, in diameters of the opening."""
SMALLEST_MM = 16.0

PlaneNode = slicer.vtkMRMLMarkupsPlaneNode


def planesOf(inputNode: slicer.vtkMRMLNode | None) -> dict[str, PlaneNode]:
    """Opening -> its plane, of what is prepared; empty before anything was suggested."""
    if inputNode is None or inputNode.GetScene() is None:
        return {}
    return {
        node.GetAttribute(OPENING): node
        for node in slicer.util.getNodesByClass("vtkMRMLMarkupsPlaneNode", inputNode.GetScene())
        if node.GetAttribute(OPENING) and node.GetNodeReference(INPUT_ROLE) is inputNode
    }


def showPlanes(inputNode: slicer.vtkMRMLNode, openings: Mapping[str, PlannedOpening]) -> dict[str, PlaneNode]:
    """Make the planes of an atrium, or put those that are there where they belong; RAS, mm, world."""
    scene, planes = inputNode.GetScene(), planesOf(inputNode)
    for name, opening in openings.items():
        node = planes.get(name)
        if node is None:
            node = scene.CreateNodeByClass("vtkMRMLMarkupsPlaneNode")
            node.UnRegister(None)
            node.SetName(scene.GenerateUniqueName(name))
            node.SetAttribute(OPENING, name)
            node = scene.AddNode(node)
            node.SetNodeReferenceID(INPUT_ROLE, inputNode.GetID())
            node.SetPlaneType(node.PlaneTypePointNormal)
            node.SetSizeMode(node.SizeModeAbsolute)
            node.CreateDefaultDisplayNodes()
            _prepareDisplay(node.GetDisplayNode())
            planes[name] = node
        suggested = {
            "centre": opening.plane.centre.tolist(),
            "normal": opening.plane.normal.tolist(),
            "found_by": opening.found_by,
            "kept_mm": float(opening.kept_mm) if np.isfinite(opening.kept_mm) else None,
        }
        node.SetAttribute(SUGGESTED, json.dumps(suggested))
        width = opening.perimeter_mm / np.pi * MARGIN if np.isfinite(opening.perimeter_mm) else SMALLEST_MM
        node.SetSize(*[max(width, SMALLEST_MM)] * 2)
        setPlane(node, opening.plane)
        label = node.GetNthControlPointLabel(0)
        if label != name:
            node.SetNthControlPointLabel(0, name)
    setEditable(planes, True)
    return planes


def roughOpenings(surface: Surface) -> dict[str, PlannedOpening]:
    """A plane for each opening in the direction in which it lies in most atria; RAS, mm."""
    corners = surface.points[surface.triangles].mean(axis=1)
    middle = np.average(corners, axis=0, weights=surface.triangle_areas)
    apart = corners - middle
    distance = np.linalg.norm(apart, axis=1)
    openings = {}
    for name, direction in LEFT_ATRIUM.layout.items():
        general = np.array(direction) * (-1.0, -1.0, 1.0) / np.linalg.norm(direction)
        cosine = apart @ general / np.maximum(distance, 1e-9)
        near = cosine >= min(np.cos(np.radians(ROUGH_DEGREES)), cosine.max())
        tip = apart[np.flatnonzero(near)[distance[near].argmax()]]
        out = tip / np.linalg.norm(tip)
        plane, perimeter = CutPlane(middle + ROUGH_SHARES[0] * tip, out), float("nan")
        for share in ROUGH_SHARES:
            section = plane_section(surface, middle + share * tip, out)
            if section is not None and section.around:
                plane, perimeter = CutPlane(section.centre, out), section.perimeter
                break
        openings[name] = PlannedOpening(plane, BY_HAND, perimeter)
    return openings


def planeOf(node: PlaneNode) -> CutPlane:
    """Where a plane is, RAS, mm, world; SurfaceError for one that its user has emptied."""
    return CutPlane(np.array(node.GetCenterWorld()), np.array(node.GetNormalWorld()))


def isPlaced(node: PlaneNode) -> bool:
    """Whether a plane still has a place: its point can be deleted by mouse."""
    return bool(node.GetNumberOfDefinedControlPoints())


def setPlane(node: PlaneNode, plane: CutPlane) -> None:
    """Put a plane somewhere; RAS, mm, world."""
    modifying = node.StartModify()
    try:
        if not isPlaced(node):
            node.RemoveAllControlPoints()
            node.AddControlPointWorld(*plane.centre.tolist())
        node.SetCenterWorld(*plane.centre.tolist())
        node.SetNormalWorld(*plane.normal.tolist())
    finally:
        node.EndModify(modifying)


def samePlane(a: CutPlane, b: CutPlane) -> bool:
    """Whether two planes are the same but for rounding."""
    apart = max(np.abs(a.centre - b.centre).max(), np.abs(a.normal - b.normal).max())
    return bool(apart < SAME_MM)


def suggestedOf(node: PlaneNode) -> tuple[CutPlane, str, float | None]:
    """Where a plane was suggested, how it was found, the length that stays beyond the ostium, mm (None: unknown)."""
    said = json.loads(node.GetAttribute(SUGGESTED))
    return CutPlane(np.array(said["centre"]), np.array(said["normal"])), said["found_by"], said["kept_mm"]


def isMoved(node: PlaneNode) -> bool:
    """Whether a plane is no longer where it was suggested."""
    return not isPlaced(node) or not samePlane(planeOf(node), suggestedOf(node)[0])


def setEditable(planes: Mapping[str, PlaneNode], editable: bool) -> None:
    """Show planes to be moved, or lock and hide them."""
    for node in planes.values():
        node.SetLocked(not editable)
        node.GetDisplayNode().SetVisibility(editable)


def showHandles(planes: Mapping[str, PlaneNode], opening: str | None) -> None:
    """Show handles to move and turn one plane with; those of all at once would hide the atrium."""
    for name, node in planes.items():
        display = node.GetDisplayNode()
        if bool(display.GetHandlesInteractive()) != (name == opening):
            display.SetHandlesInteractive(name == opening)


def colourPlane(node: PlaneNode, good: bool) -> None:
    """Show a plane in the colour of one that cuts, or of one that cannot."""
    display, colour = node.GetDisplayNode(), GOOD_COLOUR if good else BAD_COLOUR
    if display.GetSelectedColor() != colour:
        display.SetSelectedColor(*colour)


def _prepareDisplay(display: slicer.vtkMRMLMarkupsPlaneDisplayNode) -> None:
    display.SetSelectedColor(*GOOD_COLOUR)
    display.SetFillOpacity(FILL_OPACITY)
    display.SetPropertiesLabelVisibility(True)
    display.SetPointLabelsVisibility(False)
    display.SetTextScale(4.0)
    display.SetUseGlyphScale(False)
    display.SetGlyphSize(3.0)
    # A plane is moved and turned; its size is only how much of it is shown.
    display.SetTranslationHandleVisibility(True)
    display.SetRotationHandleVisibility(True)
    display.SetScaleHandleVisibility(False)
    display.SetSnapMode(display.SnapModeUnconstrained)
