"""What the Logic does with seeds."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import slicer

from LAFlatteningLib import SeedError
from LAFlatteningLib.anatomy import Anatomy

from . import seed_nodes
from .live_update import reasonsOf
from .seed_nodes import FiducialNode, seedPositions
from .surface_nodes import Settings, SurfaceCache
from .template_text import templateOf, textOf


class SeedLogic:
    """The part of `LAFlatteningLogic` that is about seeds. Positions are RAS, mm, world coordinates."""

    cache: SurfaceCache

    def anatomy(self, template: str = "adapted1") -> Anatomy:
        """The openings, seeds, paths and regions of a template; TemplateError if there is no such template."""
        return templateOf(template).anatomy

    def seedLabels(self, template: str = "adapted1") -> tuple[str, ...]:
        """The names of the seeds in the order in which they are placed."""
        return self.anatomy(template).seeds

    def seedDescription(self, label: str, template: str = "adapted1") -> str:
        """Where a seed belongs, for people: "middle of the ostium of the right superior pulmonary vein"."""
        anatomy = self.anatomy(template)
        if label in anatomy.outer_seeds:
            return anatomy.outer_seeds[label]
        return f"middle of the ostium of the {anatomy.openings[label]}"

    def createSeedsNode(self, name: str = "Seeds") -> FiducialNode:
        """A fiducial node with the nine seeds, named, none placed yet; placing fills them in order."""
        return seed_nodes.createSeedsNode(slicer.mrmlScene, name, self.anatomy())

    def prepareSeedsNode(self, seedsNode: FiducialNode) -> None:
        """Add the seeds that a node of the user's does not have, not placed yet; colours that tell good from bad."""
        seed_nodes.prepareSeedsNode(seedsNode, self.anatomy())

    def nextSeed(self, seedsNode: FiducialNode | None) -> str | None:
        """The seed to place next; None when all are placed."""
        return seed_nodes.nextSeed(seedsNode, self.anatomy())

    def placeNext(self, seedsNode: FiducialNode, label: str | None = None) -> None:
        """Start placing by mouse: clicks in a view place `label` (default: the next seed), then the others missing.

        A seed that has a place already loses it.
        """
        self.prepareSeedsNode(seedsNode)
        label = label or self.nextSeed(seedsNode)
        if label is None:
            return
        if label in seedPositions(seedsNode):
            self.removeSeed(seedsNode, label)
        seedsNode.SetControlPointPlacementStartIndex(seed_nodes.indexOf(seedsNode, label))
        markups = slicer.modules.markups.logic()
        markups.SetActiveList(seedsNode)
        markups.StartPlaceMode(True)

    def stopPlacing(self) -> None:
        """Leave the mode in which clicks place seeds."""
        interaction = slicer.app.applicationLogic().GetInteractionNode()
        if interaction.GetCurrentInteractionMode() == interaction.Place:
            interaction.SetCurrentInteractionMode(interaction.ViewTransform)

    def placeSeed(
        self,
        seedsNode: FiducialNode,
        label: str,
        position: tuple[float, float, float],
        surfaceNode: slicer.vtkMRMLModelNode | None = None,
    ) -> None:
        """Put a seed at a place (RAS, mm, world), or where it snaps to if a surface is given.

        Raises
        ------
        SeedError : no seed of that name.
        SurfaceError : the surface has not the openings of an atrium.
        """
        anatomy = self.anatomy()
        if label not in anatomy.seeds:
            raise SeedError(f'There is no seed "{label}". Expected one of {", ".join(anatomy.seeds)}.', (label,))
        place = np.asarray(position, dtype=float)
        if surfaceNode is not None:
            cavity = self.cache.cavity(surfaceNode, anatomy, seedPositions(seedsNode))
            place = seed_nodes.snapped(label, place, cavity, anatomy)
        seed_nodes.placeSeed(seedsNode, label, place)

    def removeSeed(self, seedsNode: FiducialNode, label: str) -> None:
        """Take a seed away; it is then the next to be placed."""
        seed_nodes.removeSeed(seedsNode, label)

    def checkSeeds(
        self,
        seedsNode: FiducialNode,
        surfaceNode: slicer.vtkMRMLModelNode,
        template: str = "adapted1",
        method: str = "regional",
        checkAxes: bool = True,
    ) -> Mapping[str, str]:
        """Seed -> why it cannot be right. Marks these seeds in the node; empty where nothing is wrong.

        Before all seeds are placed, each is checked for itself; then also against each other.

        Raises
        ------
        SurfaceError, TemplateError : of the library.
        """
        anatomy, positions = self.anatomy(template), seedPositions(seedsNode)
        cavity = self.cache.cavity(surfaceNode, anatomy, positions)
        reasons = seed_nodes.placementProblems(positions, cavity, anatomy)
        if not reasons and all(label in positions for label in anatomy.seeds):
            try:
                self.cache.flattener(surfaceNode, Settings(textOf(template), method, checkAxes)).preview(positions)
            except SeedError as error:
                reasons = reasonsOf(error)
        seed_nodes.markSeeds(seedsNode, reasons, anatomy)
        return reasons
