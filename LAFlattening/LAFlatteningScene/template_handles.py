"""Handles of a template on the map: points to be dragged, for the place and size of holes and for mitral feet."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import slicer

from LAFlatteningLib import Template
from LAFlatteningLib.template_editing import move_foot, move_hole, scale_hole

from .map_nodes import millimetresPerUnit, onMap

CENTRE, SIZE, FOOT = "centre", "size", "foot"
"""Kinds of handles: of a hole, its middle and a point of its rim; of a path, where it meets the outer rim."""
HEIGHT = 0.012
"""Of the handles above the map, in disk diameters: above lines and names."""
GLYPH = 0.022
"""Size of a handle, in disk diameters."""
COLOUR, ACTIVE_COLOUR = (0.95, 0.45, 0.05), (1.0, 0.85, 0.1)

FiducialNode = slicer.vtkMRMLMarkupsFiducialNode


@dataclass(frozen=True)
class Handle:
    """One point to be dragged.

    Attributes
    ----------
    kind : `CENTRE`, `SIZE` or `FOOT`.
    name : the hole, or the path.
    """

    kind: str
    name: str

    def place(self, template: Template) -> np.ndarray:
        """Where it is on a template, map units, (2,)."""
        outer = template.anatomy.outer
        if self.kind == FOOT:
            return template.rim(outer).shape.at(template.rim(outer).feet[self.name])
        rim = template.holes[self.name]
        if self.kind == CENTRE:
            return np.asarray(rim.shape.centre)
        arcs = rim.arcs(template.anatomy.feet(self.name)) or [(0.0, 360.0)]
        start, end = max(arcs, key=lambda arc: arc[1] - arc[0])
        return rim.shape.at(0.5 * (start + end))

    def dragged(self, template: Template, place: np.ndarray) -> Template:
        """The template with this handle dragged to a place (2,), map units; TemplateError where it cannot be."""
        if self.kind == CENTRE:
            return move_hole(template, self.name, place)
        if self.kind == FOOT:
            outer = template.anatomy.outer
            return move_foot(template, outer, self.name, template.rim(outer).shape.angle_of(place))
        shape = template.holes[self.name].shape
        reach = np.linalg.norm(shape.project(place[None])[0] - shape.centre)
        return scale_hole(template, self.name, float(np.linalg.norm(place - shape.centre) / reach))

    def label(self, template: Template) -> str:
        """What the point is called: hole and kind, or the seed at the foot."""
        if self.kind != FOOT:
            return f"{self.name} {self.kind}"
        a, b = template.anatomy.paths[self.name]
        return b if template.anatomy.opening_of(b) == template.anatomy.outer else a


def handlesOf(template: Template) -> list[Handle]:
    """All handles of a template, centres first."""
    anatomy = template.anatomy
    return [
        *(Handle(CENTRE, hole) for hole in anatomy.holes),
        *(Handle(SIZE, hole) for hole in anatomy.holes),
        *(Handle(FOOT, path) for path in anatomy.feet(anatomy.outer)),
    ]


class HandlesNode:
    """The markups node with the handles of a template; it is never saved with the scene."""

    def __init__(self, scene: slicer.vtkMRMLScene) -> None:
        node = scene.CreateNodeByClass("vtkMRMLMarkupsFiducialNode")
        node.UnRegister(None)
        node.SetName(scene.GenerateUniqueName("Template handles"))
        node.SetHideFromEditors(True)
        node.SetSaveWithScene(False)
        self.node: FiducialNode = scene.AddNode(node)
        self.node.CreateDefaultDisplayNodes()
        self.handles: list[Handle] = []
        self._template: Template | None = None
        self._diameter = 0.0
        display = self.node.GetDisplayNode()
        display.SetSaveWithScene(False)
        display.SetPointLabelsVisibility(False)
        display.SetPropertiesLabelVisibility(False)
        display.SetUseGlyphScale(False)
        display.SetSelectedColor(*COLOUR)
        display.SetActiveColor(*ACTIVE_COLOUR)
        # In the plane of the map, not onto what lies below.
        display.SetSnapMode(display.SnapModeUnconstrained)
        display.SetOccludedVisibility(True)

    @property
    def isAlive(self) -> bool:
        """Whether the node is still in a scene."""
        return self.node.GetScene() is not None

    def show(self, template: Template, diskDiameter: float, held: int | None = None) -> None:
        """Put all handles where they belong, but for one that the mouse holds."""
        handles = handlesOf(template)
        node, modifying = self.node, self.node.StartModify()
        try:
            if handles != self.handles or node.GetNumberOfControlPoints() != len(handles):
                node.SetFixedNumberOfControlPoints(False)
                node.RemoveAllControlPoints()
                for handle in handles:
                    node.AddControlPoint(0.0, 0.0, 0.0, handle.label(template))
                node.SetFixedNumberOfControlPoints(True)
                self.handles = handles
            node.GetDisplayNode().SetGlyphSize(GLYPH * diskDiameter)
            self._template, self._diameter = template, diskDiameter
            for k, place in enumerate(self._places()):
                if k != held and np.abs(np.subtract(node.GetNthControlPointPosition(k), place)).max() > 1e-9:
                    node.SetNthControlPointPosition(k, *place.tolist())
        finally:
            node.EndModify(modifying)

    def moved(self) -> Iterator[tuple[int, np.ndarray]]:
        """The handles that are not where they were put, with their places now, map units (2,)."""
        template = self._template
        if template is None or self.node.GetNumberOfControlPoints() != len(self.handles):
            return
        unit = millimetresPerUnit(template, self._diameter)
        for k, place in enumerate(self._places()):
            now = np.array(self.node.GetNthControlPointPosition(k))
            if np.abs(now - place)[:2].max() > 1e-6 * self._diameter:
                yield k, now[:2] / unit + np.asarray(template.outer.shape.centre)

    def remove(self) -> None:
        """Take the node out of the scene."""
        if self.isAlive:
            self.node.GetScene().RemoveNode(self.node)

    def _places(self) -> np.ndarray:
        """Where the handles belong, mm, (k, 3)."""
        assert self._template is not None
        flat = np.array([handle.place(self._template) for handle in self.handles]).reshape(-1, 2)
        flat = onMap(flat, self._template, self._diameter)
        return np.column_stack([flat, np.full(len(flat), HEIGHT * self._diameter)])
