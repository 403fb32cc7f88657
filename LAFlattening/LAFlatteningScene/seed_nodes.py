"""The seeds as a markups fiducial node: named, placed in order, snapped, marked where they cannot be right."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import slicer
from scipy.spatial import cKDTree

from LAFlatteningLib.anatomy import Anatomy
from LAFlatteningLib.cavity.openings import SNAP_LIMIT_MM, Cavity

GOOD_COLOUR, BAD_COLOUR = (0.1, 0.75, 0.35), (0.9, 0.1, 0.1)
SEED_SIZE_MM = 3.0
NAMES_SIZE = 4.0
"""Of the names beside the seeds, in percent of the height of the view."""
SAME_PLACE_MM = 1e-3
"""Seeds nearer to each other than this are at the same place."""

Positions = dict[str, np.ndarray]
FiducialNode = slicer.vtkMRMLMarkupsFiducialNode


def createSeedsNode(scene: slicer.vtkMRMLScene, name: str, anatomy: Anatomy) -> FiducialNode:
    """A node with all seeds of an anatomy, none placed.

    The points exist from the start, without positions: Slicer's placing then fills them in order, their names cannot
    go wrong, and deleting one only takes its place away.
    """
    node = scene.AddNewNodeByClass("vtkMRMLMarkupsFiducialNode", scene.GenerateUniqueName(name))
    prepareSeedsNode(node, anatomy)
    node.SetFixedNumberOfControlPoints(True)
    return node


def prepareSeedsNode(node: FiducialNode, anatomy: Anatomy) -> None:
    """Give a fiducial node the points of the seeds that it lacks, not placed yet, and the look of seeds.

    A node that has its look already keeps it, in all but the two colours that tell good seeds from bad ones.
    """
    present = {node.GetNthControlPointLabel(k) for k in range(node.GetNumberOfControlPoints())}
    missing = [label for label in anatomy.seeds if label not in present]
    if missing and node.GetFixedNumberOfControlPoints():
        node.SetFixedNumberOfControlPoints(False)
    for label in missing:
        node.UnsetNthControlPointPosition(node.AddControlPoint(0.0, 0.0, 0.0, label))
    if node.GetDisplayNode() is None:
        node.CreateDefaultDisplayNodes()
        display = node.GetDisplayNode()
        display.SetUseGlyphScale(False)
        display.SetGlyphSize(SEED_SIZE_MM)
        display.SetTextScale(NAMES_SIZE)
    display = node.GetDisplayNode()
    display.SetSelectedColor(*GOOD_COLOUR)
    display.SetColor(*BAD_COLOUR)
    display.SetActiveColor(1.0, 0.8, 0.1)
    display.SetSnapMode(display.SnapModeToVisibleSurface)


def indexOf(node: FiducialNode, label: str) -> int:
    """Index of the control point with a label, placed ones first; -1 if there is none."""
    found = [k for k in range(node.GetNumberOfControlPoints()) if node.GetNthControlPointLabel(k) == label]
    return next((k for k in found if isPlaced(node, k)), found[0] if found else -1)


def isPlaced(node: FiducialNode, index: int) -> bool:
    """Whether a control point has a position (and does not just follow the mouse before it is placed)."""
    return node.GetNthControlPointPositionStatus(index) == node.PositionDefined


def seedPositions(node: FiducialNode | None) -> Positions:
    """Label -> (3,) RAS, mm, world, of the points that are placed."""
    positions: Positions = {}
    if node is None or node.GetScene() is None:
        return positions
    for k in range(node.GetNumberOfControlPoints()):
        if isPlaced(node, k):
            positions.setdefault(node.GetNthControlPointLabel(k), np.array(node.GetNthControlPointPositionWorld(k)))
    return positions


def samePositions(a: Mapping[str, np.ndarray], b: Mapping[str, np.ndarray]) -> bool:
    """Whether the same seeds are placed at the same places."""
    return a.keys() == b.keys() and all(np.array_equal(a[label], b[label]) for label in a)


def nextSeed(node: FiducialNode | None, anatomy: Anatomy) -> str | None:
    """The first seed that is not placed."""
    placed = seedPositions(node)
    return next((label for label in anatomy.seeds if label not in placed), None)


def placeSeed(node: FiducialNode, label: str, position: np.ndarray) -> None:
    """Put a seed at a place (RAS, mm, world); its point is made if the node has none."""
    index = indexOf(node, label)
    if index < 0:
        node.AddControlPointWorld(*(float(x) for x in position), label)
    else:
        node.SetNthControlPointPositionWorld(index, *(float(x) for x in position))


def removeSeed(node: FiducialNode, label: str) -> None:
    """Take a seed's place away; its point stays, to be placed again."""
    index = indexOf(node, label)
    if index >= 0:
        node.UnsetNthControlPointPosition(index)


def setPositions(node: FiducialNode, positions: Mapping[str, np.ndarray], anatomy: Anatomy) -> None:
    """Place exactly these seeds, and take the places of the others away, as one change of the node."""
    modifying = node.StartModify()
    try:
        for label in anatomy.seeds:
            if label in positions:
                placeSeed(node, label, positions[label])
            else:
                removeSeed(node, label)
    finally:
        node.EndModify(modifying)


def snapped(label: str, position: np.ndarray, cavity: Cavity, anatomy: Anatomy) -> np.ndarray:
    """Where a seed belongs that was put near: on the outer rim, or on the cover of the nearest opening.

    Farther away than the library allows (`SNAP_LIMIT_MM`), the seed goes to the nearest point of the surface and is
    left there for the user to see.

    Parameters
    ----------
    position : (3,) mm, in the axes of the cavity.
    """
    if label in anatomy.outer_seeds:
        rim = cavity.surface.points[cavity.outer]
        distance, nearest = cKDTree(rim).query(position)
        place = rim[nearest]
    else:
        places = [cavity.on_cover(hole, position) for hole in range(len(cavity.rims))]
        distances = np.linalg.norm(np.array(places) - position, axis=1)
        distance, place = distances.min(), places[int(distances.argmin())]
    if distance <= SNAP_LIMIT_MM:
        return np.array(place)
    return cavity.closed.points[cKDTree(cavity.closed.points).query(position)[1]].copy()


def placementProblems(positions: Mapping[str, np.ndarray], cavity: Cavity, anatomy: Anatomy) -> dict[str, str]:
    """Seed -> what is wrong with its place, as far as that can be said before all seeds are placed."""
    problems: dict[str, str] = {}
    rim = cKDTree(cavity.surface.points[cavity.outer])
    taken: dict[int, str] = {}
    for label in (label for label in anatomy.seeds if label in positions):
        position = positions[label]
        for other in (other for other in positions if other != label):
            if np.linalg.norm(positions[other] - position) < SAME_PLACE_MM:
                problems[label] = f"{label} is at the same place as {other}. Move one of them."
        if label in anatomy.outer_seeds:
            distance = rim.query(position)[0]
            if distance > SNAP_LIMIT_MM:
                problems[label] = (
                    f"{label} is {distance:.0f} mm from the rim of the {anatomy.openings[anatomy.outer]}; at most "
                    f"{SNAP_LIMIT_MM:g} mm are allowed. Move it to the rim."
                )
            continue
        places = [np.linalg.norm(cavity.on_cover(hole, position) - position) for hole in range(len(cavity.rims))]
        hole = int(np.argmin(places))
        if places[hole] > SNAP_LIMIT_MM:
            problems[label] = (
                f"{label} is {places[hole]:.0f} mm from the nearest opening; at most {SNAP_LIMIT_MM:g} mm are allowed. "
                f"Move it to the middle of the {anatomy.openings[label]}."
            )
        elif hole in taken:
            problems[label] = (
                f"{label} and {taken[hole]} are on the same opening; expected one seed on each. Move one of them."
            )
        else:
            taken[hole] = label
    return problems


def markSeeds(node: FiducialNode, reasons: Mapping[str, str], anatomy: Anatomy) -> None:
    """Show seeds in the colour of good or bad ones, and keep the reason as the description of the point."""
    modifying = node.StartModify()
    try:
        for label in anatomy.seeds:
            index = indexOf(node, label)
            if index < 0:
                continue
            good, reason = label not in reasons, reasons.get(label, "")
            if bool(node.GetNthControlPointSelected(index)) != good:
                node.SetNthControlPointSelected(index, good)
            if node.GetNthControlPointDescription(index) != reason:
                node.SetNthControlPointDescription(index, reason)
    finally:
        node.EndModify(modifying)


class SeedHistory:
    """What the seeds were, to undo and redo changes."""

    def __init__(self) -> None:
        self._now: Positions | None = None
        self._past: list[Positions] = []
        self._future: list[Positions] = []

    @property
    def now(self) -> Positions | None:
        """Where the seeds were when it was last noted."""
        return self._now

    def record(self, positions: Positions) -> None:
        """Note where the seeds are after a change; nothing if they are where they were."""
        if self._now is not None and not samePositions(self._now, positions):
            self._past.append(self._now)
            self._future.clear()
        self._now = dict(positions)

    @property
    def canUndo(self) -> bool:
        """Whether there was a change."""
        return bool(self._past)

    @property
    def canRedo(self) -> bool:
        """Whether a change was undone, and none made since."""
        return bool(self._future)

    def undo(self) -> Positions:
        """Where the seeds were before the last change."""
        assert self._now is not None
        self._future.append(self._now)
        self._now = self._past.pop()
        return dict(self._now)

    def redo(self) -> Positions:
        """Where the seeds were before the last undoing."""
        assert self._now is not None
        self._past.append(self._now)
        self._now = self._future.pop()
        return dict(self._now)
