"""What the Logic does to prepare an atrium: suggest planes, cut, place seeds, and take it back."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import slicer
import vtk

from LAFlatteningLib import LEFT_ATRIUM, LAFlatteningError, Surface, SurfaceError
from LAFlatteningLib.cavity.clipping import CutPlane
from LAFlatteningLib.cavity.plan import KEEP_MM, PlannedOpening
from LAFlatteningLib.preparation import Preparation, PrepareSettings, apply_plan, prepare
from LAFlatteningLib.progress import ProgressCallback, part, report

from .cut_preview import Cut, CutPreview
from .display_link import followColours
from .linked_views import belongingsOf
from .long_action import LongAction, longAction, refuseWhileBusy, whileChosen
from .map_nodes import NOTES, groupNodes, mapsOf
from .plane_nodes import (
    BY_HAND,
    GIVEN,
    INPUT_ROLE,
    PlaneNode,
    isMoved,
    isPlaced,
    planeOf,
    planesOf,
    roughOpenings,
    samePlane,
    setEditable,
    setPlane,
    showPlanes,
    suggestedOf,
)
from .quality_nodes import qualityNodesOf
from .raw_input import RawNode, rawSurface, structuresOf, versionOf
from .seed_nodes import FiducialNode, createSeedsNode, setPositions
from .surface_nodes import SurfaceCache

if TYPE_CHECKING:
    from LAFlattening import LAFlatteningParameterNode

CAVITY_ROLE, CAVITY_SEEDS_ROLE = "LAFlattening.cavity", "LAFlattening.cavitySeeds"
"""Node references: from what was prepared to its cavities, the newest last; from a cavity to its suggested seeds."""
FORMER_ROLES = {name: f"LAFlattening.former.{name}" for name in ("surface", "seeds", "map")}
"""Node references from a cavity to what was chosen in the panel before it was made."""
WAS_SHOWN = "LAFlattening.inputWasShown"
"""Attribute of a cavity: what it was made from was visible before."""

SUGGESTING, CUTTING = "the openings were being looked for", "the atrium was being cut"

ModelNode = slicer.vtkMRMLModelNode


@dataclass(frozen=True)
class RawChoice:
    """What is prepared, and how; lengths in mm, see `LAFlatteningLib.preparation.PrepareSettings`.

    Attributes
    ----------
    structure : segment id, or label value; empty for the only one.
    points : of the mesh; 0 keeps a mesh of 10,000 to 40,000 points and gives others 20,000.
    """

    structure: str = ""
    pvLength: float = KEEP_MM
    laaLength: float = KEEP_MM
    points: int = 0
    checkAxes: bool = True

    def settings(self) -> PrepareSettings:
        """The same for the library."""
        return PrepareSettings(
            self.points or None, float(self.pvLength), float(self.laaLength), ignore_axes=not self.checkAxes
        )


class PrepareLogic:
    """The part of `LAFlatteningLogic` that prepares an atrium. Positions are RAS, mm, world coordinates."""

    cache: SurfaceCache
    isBusy: bool
    _prepared: tuple[tuple[object, ...], Preparation] | None = None
    _preview: CutPreview | None = None
    _structures: tuple[tuple[object, ...], dict[str, str]] | None = None

    def structures(self, inputNode: RawNode | None) -> dict[str, str]:
        """What can be chosen in a segmentation or a label map: id -> name."""
        if inputNode is None or inputNode.GetScene() is None:
            return {}
        if not isinstance(inputNode, slicer.vtkMRMLLabelMapVolumeNode):
            return structuresOf(inputNode)
        # All voxels are looked at for that.
        key = versionOf(inputNode)
        if self._structures is None or self._structures[0] != key:
            self._structures = (key, structuresOf(inputNode))
        return self._structures[1]

    def openings(self) -> Mapping[str, str]:
        """The openings of an atrium: name -> full name."""
        return LEFT_ATRIUM.openings

    def isReady(self, surfaceNode: ModelNode | None) -> bool:
        """Whether a model is open as a left atrium must be to be flattened."""
        try:
            self.cache.cavity(surfaceNode, LEFT_ATRIUM, {})
        except LAFlatteningError:
            return False
        return True

    def prepareSuggest(
        self, inputNode: RawNode | None, choice: RawChoice = RawChoice(), progress: ProgressCallback | None = None
    ) -> dict[str, PlaneNode]:
        """Find the openings of an atrium and show where it would be cut; the atrium itself stays as it is.

        A plane that was put into place after `preparePlanes` stays there; the others are found.

        Parameters
        ----------
        inputNode : model (closed, or open at some openings), segmentation or label map.
        progress : called with the share done (0 to 1) and what is being done; returning False cancels.

        Returns
        -------
        Opening -> its plane. Planes that were there are put where they belong.

        Raises
        ------
        SurfaceError, InputFileError : of the library; no plane was made or moved.
        Cancelled : by `progress`, or because the atrium or its planes were changed or deleted meanwhile, or because
            something else is being computed.
        """
        with longAction(self, SUGGESTING, progress) as action:
            _read(action, inputNode, choice)
            prepared = self._prepare(inputNode, choice, action, action.progress)
            return showPlanes(inputNode, prepared.plan.openings)

    def preparePlanes(self, inputNode: RawNode | None, choice: RawChoice = RawChoice()) -> dict[str, PlaneNode]:
        """Show a plane for each opening roughly where it is in most atria, to be moved by hand.

        For an atrium whose openings `prepareSuggest` does not find. Returns and errors as for it.
        """
        refuseWhileBusy(self)
        surface, _ = rawSurface(inputNode, choice.structure)
        return showPlanes(inputNode, roughOpenings(surface))

    def prepareApply(
        self, inputNode: RawNode | None, choice: RawChoice = RawChoice(), progress: ProgressCallback | None = None
    ) -> tuple[ModelNode, FiducialNode]:
        """Cut an atrium in its planes, as they are now, and place the nine seeds; all of it or nothing.

        Returns
        -------
        cavity : a new model, "<name> cavity", with all arrays of the atrium.
        seeds : a new seeds node.

        Raises
        ------
        SurfaceError, InputFileError, SeedError : of the library; no planes yet.
        Cancelled : as `prepareSuggest`.
        """
        with longAction(self, CUTTING, progress) as action:
            return self._apply(inputNode, choice, action)

    def _apply(
        self, inputNode: RawNode | None, choice: RawChoice, action: LongAction
    ) -> tuple[ModelNode, FiducialNode]:
        planes = planesOf(inputNode)
        if not planes:
            raise SurfaceError("There are no planes to cut in. Press Suggest first, and look at them.")
        missing = [name for name in LEFT_ATRIUM.openings if name not in planes or not isPlaced(planes[name])]
        if missing:
            raise SurfaceError(f"The plane of {' and '.join(missing)} was deleted. Press Suggest to get it back.")
        _read(action, inputNode, choice)
        given = _outwards({name: planeOf(node) for name, node in planes.items()})
        if any(suggestedOf(node)[1] == BY_HAND for node in planes.values()):
            prepared = self._prepareByHand(inputNode, choice, given, action)
        else:
            prepared = self._prepareMoved(inputNode, choice, given, action)
        action.check()
        cavity, seeds = _writeCavity(inputNode, prepared)
        setEditable(planes, False)
        return cavity, seeds

    def prepareUndo(self, inputNode: RawNode | None) -> str:
        """Take the last step back: the cavity with its seeds and maps, else moves of planes, else the planes.

        Returns
        -------
        What was taken back: "cavity", "moves", "planes", or "" if there was nothing.

        Raises
        ------
        Cancelled : something else is being computed.
        """
        refuseWhileBusy(self)
        cavity, planes = cavityOf(inputNode), planesOf(inputNode)
        if cavity is not None:
            _removeCavity(inputNode, cavity)
            setEditable(planes, True)
            return "cavity"
        moved = [node for node in planes.values() if isMoved(node)]
        for node in moved:
            setPlane(node, suggestedOf(node)[0])
        if moved:
            return "moves"
        for node in planes.values():
            slicer.mrmlScene.RemoveNode(node)
        return "planes" if planes else ""

    def cavityOf(self, inputNode: RawNode | None) -> ModelNode | None:
        """The last cavity that was made of an atrium."""
        return cavityOf(inputNode)

    def prepareNotes(self, inputNode: RawNode | None, choice: RawChoice = RawChoice()) -> list[str]:
        """What was mended and what to look at; of the last cavity, or of what was suggested last."""
        cavity = cavityOf(inputNode)
        if cavity is not None:
            return json.loads(cavity.GetAttribute(NOTES) or "[]")
        prepared = self._remembered(inputNode, choice)
        return prepared.notes if prepared is not None else []

    # ---- with what the panel says --------------------------------------------------------------------------------

    def rawChoiceFrom(self, parameterNode: LAFlatteningParameterNode) -> RawChoice:
        """How the panel says that the atrium is prepared."""
        p = parameterNode
        return RawChoice(p.prepareStructure, p.pvLength, p.laaLength, p.preparePoints, p.checkAxes)

    def suggestParameters(
        self, parameterNode: LAFlatteningParameterNode, progress: ProgressCallback | None = None
    ) -> dict[str, PlaneNode]:
        """`prepareSuggest` with what the panel says."""
        p = parameterNode
        watch = whileChosen(p, ("prepareInput",), SUGGESTING, progress)
        return self.prepareSuggest(p.prepareInput, self.rawChoiceFrom(p), watch)

    def applyParameters(
        self, parameterNode: LAFlatteningParameterNode, progress: ProgressCallback | None = None
    ) -> tuple[ModelNode, FiducialNode]:
        """`prepareApply` with what the panel says; cavity and seeds become the chosen ones."""
        p = parameterNode
        former = {name: getattr(p, name) for name in FORMER_ROLES}
        watch = whileChosen(p, ("prepareInput", *former), CUTTING, progress)
        cavity, seeds = self.prepareApply(p.prepareInput, self.rawChoiceFrom(p), watch)
        for name, node in former.items():
            # One that was deleted meanwhile would lend its id to a later node.
            isThere = node is not None and node.GetScene() is not None
            cavity.SetNodeReferenceID(FORMER_ROLES[name], node.GetID() if isThere else None)
        # Another atrium gets another map.
        p.surface, p.seeds, p.map = cavity, seeds, None
        return cavity, seeds

    def planesParameters(self, parameterNode: LAFlatteningParameterNode) -> dict[str, PlaneNode]:
        """`preparePlanes` with what the panel says."""
        return self.preparePlanes(parameterNode.prepareInput, self.rawChoiceFrom(parameterNode))

    def undoPrepareParameters(self, parameterNode: LAFlatteningParameterNode) -> str:
        """`prepareUndo` with what the panel says; what was chosen before the cavity is chosen again."""
        refuseWhileBusy(self)
        p, cavity = parameterNode, cavityOf(parameterNode.prepareInput)
        if cavity is not None and p.surface is cavity:
            former = {name: cavity.GetNodeReference(role) for name, role in FORMER_ROLES.items()}
            p.map = None
            p.surface, p.seeds = former["surface"], former["seeds"]
            p.map = former["map"]
        return self.prepareUndo(p.prepareInput)

    def isPrepared(self, inputNode: RawNode | None, choice: RawChoice) -> bool:
        """Whether what `prepareSuggest` found is still known, and true."""
        return self._remembered(inputNode, choice) is not None

    def preparedSurface(self, inputNode: RawNode | None, choice: RawChoice) -> Surface:
        """The surface that planes cut: prepared by `prepareSuggest`, else as it comes. Errors as `rawSurface`."""
        prepared = self._remembered(inputNode, choice)
        return prepared.surface if prepared is not None else rawSurface(inputNode, choice.structure)[0]

    # ---- live preview --------------------------------------------------------------------------------------------

    def startCutPreview(
        self,
        parameterNode: LAFlatteningParameterNode,
        scheduler: Callable[[int, Callable[[], None]], None],
        onCuts: Callable[[], None] | None = None,
    ) -> None:
        """Draw the rims that the planes would cut, and follow the planes.

        Parameters
        ----------
        scheduler : as for `startLiveUpdate`.
        onCuts : called when `plannedCuts` may have changed.
        """
        self.stopCutPreview()
        self._preview = CutPreview(self, parameterNode, scheduler, onCuts)

    def stopCutPreview(self) -> None:
        """End what `startCutPreview` began; the rims go."""
        if self._preview is not None:
            self._preview.stop()
            self._preview = None

    def plannedCuts(self) -> Mapping[str, Cut]:
        """Opening -> the rim that its plane would cut now; empty while no planes are shown or followed."""
        return self._preview.cuts if self._preview is not None else {}

    # ---- helpers -------------------------------------------------------------------------------------------------

    def _remembered(self, inputNode: RawNode | None, choice: RawChoice) -> Preparation | None:
        if inputNode is None or inputNode.GetScene() is None or self._prepared is None:
            return None
        key, prepared = self._prepared
        return prepared if key == _keyOf(inputNode, choice) else None

    def _prepare(
        self,
        inputNode: RawNode | None,
        choice: RawChoice,
        action: LongAction,
        progress: ProgressCallback | None,
    ) -> Preparation:
        """The atrium with its plan, by rule; remembered until it or the settings change."""
        remembered = self._remembered(inputNode, choice)
        if remembered is not None:
            return remembered
        given = _given(inputNode)
        key = _keyOf(inputNode, choice) if inputNode is not None else ()
        report(progress, 0.0, "Reading the atrium")
        raw, notes = rawSurface(inputNode, choice.structure, part(progress, 0.0, 0.2), choice.checkAxes)
        prepared = Preparation(raw, repairs=notes)
        try:
            prepare(raw, choice.settings(), planes=given, into=prepared, progress=part(progress, 0.2, 1.0))
        except SurfaceError as error:
            if prepared.plan is None:
                raise
            # The cuts by rule do not work out, but where they are helps the user to move them.
            prepared.repairs.append(str(error))
        action.check()
        self._prepared = (key, prepared)
        return prepared

    def _prepareMoved(
        self,
        inputNode: RawNode,
        choice: RawChoice,
        planes: Mapping[str, CutPlane],
        action: LongAction,
    ) -> Preparation:
        """The atrium cut as suggested, but for planes that were moved since."""
        prepared = self._prepare(inputNode, choice, action, part(action.progress, 0.0, 0.7))
        moved = {
            name: PlannedOpening(plane, GIVEN, float("nan"))
            for name, plane in planes.items()
            if not samePlane(plane, prepared.plan.openings[name].plane)
        }
        if not moved and prepared.cavity is not None and prepared.seeds:
            return prepared
        plan = replace(prepared.plan, openings={**prepared.plan.openings, **moved})
        own = replace(prepared, plan=plan, cavity=None, rims={}, seeds={}, seconds={})
        apply_plan(own, choice.settings(), LEFT_ATRIUM, part(action.progress, 0.7, 1.0))
        return own

    @staticmethod
    def _prepareByHand(
        inputNode: RawNode,
        choice: RawChoice,
        planes: Mapping[str, CutPlane],
        action: LongAction,
    ) -> Preparation:
        """The atrium cut in planes of the user only."""
        report(action.progress, 0.0, "Reading the atrium")
        raw, notes = rawSurface(inputNode, choice.structure, part(action.progress, 0.0, 0.2), choice.checkAxes)
        prepared = Preparation(raw, repairs=notes)
        return prepare(raw, choice.settings(), planes=planes, into=prepared, progress=part(action.progress, 0.2, 1.0))


def _read(action: LongAction, inputNode: RawNode | None, choice: RawChoice) -> None:
    """Note what a preparation depends on: the atrium, and where its planes are."""
    if inputNode is None or inputNode.GetScene() is None:
        return

    def state() -> object:
        planes = {name: planeOf(node) if isPlaced(node) else None for name, node in planesOf(inputNode).items()}
        places = {
            name: (plane.centre.tolist(), plane.normal.tolist()) for name, plane in planes.items() if plane is not None
        }
        return _keyOf(inputNode, choice), places, sorted(planes)

    action.read(state, inputNode)


def _given(inputNode: RawNode | None) -> dict[str, CutPlane]:
    """The planes that are not to be found, because their user has put them into place."""
    given = {}
    for name, node in planesOf(inputNode).items():
        suggested, foundBy, _ = suggestedOf(node)
        if foundBy == BY_HAND and isPlaced(node) and isMoved(node):
            given[name] = planeOf(node)
        elif foundBy == GIVEN:
            given[name] = suggested
    return given


def _keyOf(inputNode: RawNode, choice: RawChoice) -> tuple[object, ...]:
    """What a preparation depends on."""
    given = {
        name: np.round([plane.centre, plane.normal], 4).tolist() for name, plane in sorted(_given(inputNode).items())
    }
    return versionOf(inputNode, choice.structure), choice, str(given)


def _outwards(planes: Mapping[str, CutPlane]) -> dict[str, CutPlane]:
    """Planes with normals away from the other ones: one that was turned round still cuts the vein off, not the rest."""
    result = {}
    for name, plane in planes.items():
        others = np.mean([other.centre for key, other in planes.items() if key != name], axis=0)
        inwards = float((others - plane.centre) @ plane.normal) > 0.0
        result[name] = CutPlane(plane.centre, -plane.normal) if inwards else plane
    return result


def cavityOf(inputNode: RawNode | None) -> ModelNode | None:
    """The last cavity that was made of an atrium and is still there."""
    if inputNode is None or inputNode.GetScene() is None:
        return None
    count = inputNode.GetNumberOfNodeReferences(CAVITY_ROLE)
    found = (inputNode.GetNthNodeReference(CAVITY_ROLE, k) for k in reversed(range(count)))
    return next((node for node in found if node is not None), None)


def _writeCavity(inputNode: RawNode, prepared: Preparation) -> tuple[ModelNode, FiducialNode]:
    scene = inputNode.GetScene()
    polydata = vtk.vtkPolyData()
    # The arrays may be those of the input.
    polydata.DeepCopy(prepared.cavity.to_polydata())
    name = scene.GenerateUniqueName(f"{inputNode.GetName()} cavity")
    cavity = scene.AddNewNodeByClass("vtkMRMLModelNode", name)
    cavity.SetAndObservePolyData(polydata)
    cavity.CreateDefaultDisplayNodes()
    cavity.SetAttribute(NOTES, json.dumps(_unique(prepared.notes)))
    cavity.SetNodeReferenceID(INPUT_ROLE, inputNode.GetID())
    display = cavity.GetDisplayNode()
    display.SetBackfaceCulling(False)
    shown = inputNode.GetDisplayNode()
    if isinstance(inputNode, slicer.vtkMRMLModelNode):
        if shown is not None:
            display.SetColor(*shown.GetColor())
        followColours(inputNode, cavity)
    seeds = createSeedsNode(scene, f"{name} seeds", LEFT_ATRIUM)
    setPositions(seeds, {label: np.asarray(place) for label, place in prepared.seeds.items()}, LEFT_ATRIUM)
    cavity.SetNodeReferenceID(CAVITY_SEEDS_ROLE, seeds.GetID())
    groupNodes(cavity, [seeds])
    if shown is not None and shown.GetVisibility():
        cavity.SetAttribute(WAS_SHOWN, "1")
        shown.SetVisibility(False)
    inputNode.AddNodeReferenceID(CAVITY_ROLE, cavity.GetID())
    return cavity, seeds


def _removeCavity(inputNode: RawNode, cavity: ModelNode) -> None:
    scene = cavity.GetScene()
    if cavity.GetAttribute(WAS_SHOWN) and inputNode.GetDisplayNode() is not None:
        inputNode.GetDisplayNode().SetVisibility(True)
    for index in reversed(range(inputNode.GetNumberOfNodeReferences(CAVITY_ROLE))):
        if inputNode.GetNthNodeReferenceID(CAVITY_ROLE, index) == cavity.GetID():
            inputNode.RemoveNthNodeReferenceID(CAVITY_ROLE, index)
    maps = mapsOf(cavity)
    seeds = cavity.GetNodeReference(CAVITY_SEEDS_ROLE)
    shown = [belonging for node in (*maps, cavity) for belonging in belongingsOf(node)]
    quality = [table for node in maps for table in qualityNodesOf(node)]
    for node in [*shown, *quality, *maps, seeds, cavity]:
        if node is not None and node.GetScene() is not None:
            scene.RemoveNode(node)


def _unique(notes: list[str]) -> list[str]:
    return list(dict.fromkeys(notes))
