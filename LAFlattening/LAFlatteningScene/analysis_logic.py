"""What the Logic reads off a map: image on the wall, fibrosis or low voltage, gaps, comparison."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import slicer
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

from LAFlatteningLib import LAFlatteningError, Parcellation, Rule, compare_maps, find_gaps, measure_fibrosis, project
from LAFlatteningLib.blood_pool import BloodPool, blood_pool_of_labels, find_blood_pool
from LAFlatteningLib.cavity.covers import HOLE_ARRAY
from LAFlatteningLib.fibrosis import Fibrosis
from LAFlatteningLib.flattening.flat_map import REGION_ARRAY
from LAFlatteningLib.gaps.search_areas import SEARCH_MM
from LAFlatteningLib.parcellation import builtin_parcellations, parcels_of
from LAFlatteningLib.progress import ProgressCallback, part, report
from LAFlatteningLib.projection import DEPTH_MM, LGE_ARRAY, Projection
from LAFlatteningLib.quantities import is_voltage, unit_of
from LAFlatteningLib.rules import LOW_VOLTAGE_MV

from .class_colours import classColours
from .colouring import CELL_DATA, POINT_DATA, colourBy, colourChoices, colouredBy
from .comparison_nodes import COMPARISON, removeDifferences, writeComparison
from .fibrosis_nodes import BLOOD_POOL, FIBROSIS, classArrayOf, removeClasses, writeBloodPool, writeFibrosis
from .gap_nodes import GAP_CURVE, GAP_KINDS, GAP_LIST, GAPS, PATH, RGM, writeGaps
from .image_input import inCoordinatesOf, localVolume, segmentVolume, worldVolume
from .live_projection import LiveProjection
from .long_action import longAction, refuseWhileBusy, whileChosen
from .map_nodes import SURFACE_ROLE, copyArrays, mapsOf
from .map_reading import mapDataOf, stateOf, withParcels, writeHow
from .raw_input import versionOf
from .result_nodes import hasOutdated, noteArray, noteOther, outdateResultsOf, removeResults, resultOf, resultsOf
from .surface_nodes import surfaceOf

if TYPE_CHECKING:
    from LAFlattening import LAFlatteningParameterNode

DEFAULT_THRESHOLDS = {"iir": "1.2, 1.32", "sd": "2.3, 3.3", "value": ""}
"""Of each rule, for enhancement: ratios as in use for LGE-MRI, standard deviations as other programs begin with."""
LABEL_ARRAYS = (REGION_ARRAY, HOLE_ARRAY)
PARCELLATIONS = builtin_parcellations()
VOLTAGE_THRESHOLDS = ", ".join(f"{level:g}" for level in LOW_VOLTAGE_MV)
"""As they stand in the panel."""

BLOOD_POOL_TEXT = "LAFlattening.bloodPool"
"""Attribute of the fibrosis table: what the wall was compared with, in words."""

MEASURING, FINDING_GAPS = "the classes were being measured", "gaps were being looked for"

ModelNode = slicer.vtkMRMLModelNode
RegionNode = slicer.vtkMRMLLabelMapVolumeNode | slicer.vtkMRMLSegmentationNode


@dataclass(frozen=True)
class ProjectionChoice:
    """How an image comes onto the wall, see `LAFlatteningLib.project`; mm.

    Attributes
    ----------
    interval : (from, to) along the outward normal, in place of depth and side; negative is inside.
    """

    depth: float = DEPTH_MM
    side: str = "both"
    statistic: str = "max"
    interval: tuple[float, float] | None = None


def suggestedRule(array: str, kind: str | None = None) -> tuple[str, str, str]:
    """Rule, thresholds and direction with which to begin for an array, and a kind of rule that was chosen."""
    if is_voltage(array):
        return "value", VOLTAGE_THRESHOLDS, "below"
    kind = kind or ("value" if unit_of(array) else "iir")
    return kind, DEFAULT_THRESHOLDS[kind], "above"


def thresholdsFrom(text: str) -> tuple[float, ...]:
    """Numbers that a user has typed, separated by commas, semicolons or spaces.

    Raises
    ------
    LAFlatteningError : none, or something that is no number.
    """
    words = text.replace(";", " ").replace(",", " ").split()
    try:
        numbers = tuple(float(word) for word in words)
    except ValueError:
        raise LAFlatteningError(f'Expected thresholds as numbers, like 1.2, 1.32; found "{text}".') from None
    if not numbers:
        raise LAFlatteningError("Expected one threshold or more, like 1.2, 1.32; found none.")
    return numbers


class AnalysisLogic:
    """The part of `LAFlatteningLogic` that measures. Results are nodes that the map refers to, saved with the scene."""

    isBusy: bool
    _liveProjection: LiveProjection | None = None

    # ---- image on the wall -------------------------------------------------------------------------------------------

    def project(
        self,
        surfaceNode: ModelNode | None,
        volumeNode: slicer.vtkMRMLScalarVolumeNode | None,
        choice: ProjectionChoice = ProjectionChoice(),
        array: str = LGE_ARRAY,
    ) -> Projection:
        """Put the intensities of an image onto an atrium and its maps, as a point array.

        Parent transforms of both count. The array is written when it is complete, or not at all.

        Raises
        ------
        InputFileError : no image, one that is the same everywhere, or that does not overlap the atrium.
        SurfaceError : no atrium.
        LAFlatteningError : depth not positive.
        Cancelled : something else is being computed.
        """
        refuseWhileBusy(self)
        found = project(
            surfaceOf(surfaceNode),
            worldVolume(volumeNode),
            float(choice.depth),
            choice.side,
            choice.statistic,
            interval_mm=choice.interval,
        )
        values = numpy_to_vtk(found.values, deep=True)
        values.SetName(array)
        polydata = surfaceNode.GetPolyData()
        before = polydata.GetPointData().GetArray(array)
        isSame = before is not None and np.array_equal(vtk_to_numpy(before), found.values, equal_nan=True)
        polydata.GetPointData().AddArray(values)
        writeHow(polydata, array, found)
        polydata.Modified()
        for mapNode in mapsOf(surfaceNode):
            copyArrays(mapNode, surfaceNode)
            if not isSame:
                outdateResultsOf(mapNode, array)
        return found

    def projectParameters(self, parameterNode: LAFlatteningParameterNode) -> Projection:
        """`project` with what the panel says; atrium and map are then coloured by it."""
        p = parameterNode
        found = self.project(p.surface, p.volume, self.projectionFrom(p))
        if colouredBy(p.surface) != (LGE_ARRAY, POINT_DATA):
            colourBy(p.surface, (LGE_ARRAY, POINT_DATA))
        return found

    def projectionFrom(self, parameterNode: LAFlatteningParameterNode) -> ProjectionChoice:
        """How the panel says that an image comes onto the wall."""
        p = parameterNode
        return ProjectionChoice(float(p.projectionDepth), p.projectionSide, p.projectionStatistic)

    def startLiveProjection(
        self,
        parameterNode: LAFlatteningParameterNode,
        scheduler: Callable[[int, Callable[[], None]], None],
        onProjected: Callable[[Projection | None, str], None],
    ) -> None:
        """Project anew whenever image, depth, side or statistic change in a parameter node that asks for it.

        Parameters
        ----------
        scheduler : called with milliseconds and a function to call after them, once.
        onProjected : told the projection, or None and why there is none.
        """
        self.stopLiveProjection()
        self._liveProjection = LiveProjection(self, parameterNode, scheduler, onProjected)

    def stopLiveProjection(self) -> None:
        """No longer follow."""
        if self._liveProjection is not None:
            self._liveProjection.stop()
            self._liveProjection = None

    # ---- arrays ------------------------------------------------------------------------------------------------------

    def measurableArrays(self, surfaceNode: ModelNode | None) -> dict[str, str]:
        """The arrays of an atrium with numbers to measure, points before triangles -> what they are called, with unit.

        Left out are regions, parcellations, classes and other labels.
        """
        found: dict[str, str] = {}
        for (name, _where), label in colourChoices(surfaceNode).items():
            isLabel = name in LABEL_ARRAYS or name.startswith(PARCELLATIONS)
            if not isLabel and classColours(surfaceNode, name) is None and name not in found:
                found[name] = label
        return found

    def unitOf(self, array: str) -> str:
        """The unit of an array by its name; empty where it is not known."""
        return unit_of(array)

    # ---- fibrosis and voltage ----------------------------------------------------------------------------------------

    def bloodPool(
        self,
        surfaceNode: ModelNode,
        volumeNode: slicer.vtkMRMLScalarVolumeNode | None,
        regionNode: RegionNode | None = None,
        segment: str = "",
    ) -> BloodPool:
        """The intensity of blood: inside the atrium away from its wall, or in a region of the user's.

        Parameters
        ----------
        regionNode : label map (every label but 0), or segmentation.
        segment : id of its segment; may be empty where there is only one.

        Raises
        ------
        InputFileError : no image.
        LAFlatteningError : hardly a voxel in the region.
        """
        if regionNode is None:
            # In the image's own coordinates, so that the region is a part of its grid.
            local = localVolume(volumeNode)
            return find_blood_pool(inCoordinatesOf(surfaceOf(surfaceNode), volumeNode), local)
        return blood_pool_of_labels(worldVolume(volumeNode), segmentVolume(regionNode, segment))

    def measureFibrosis(
        self,
        mapNode: ModelNode | None,
        array: str,
        rule: Rule,
        volumeNode: slicer.vtkMRMLScalarVolumeNode | None = None,
        regionNode: RegionNode | None = None,
        parcellations: Sequence[str | Path] = (),
        progress: ProgressCallback | None = None,
    ) -> Fibrosis:
        """Areas of the classes of an array on the atrium: whole, by region, by part of parcellations.

        The table is the map's (`fibrosisTable`); the classes become a cell array of atrium and map, in colour.

        Parameters
        ----------
        array : of the atrium, like "LGE" or "Bipolar".
        rule : with "iir" and "sd", blood is measured in the image (see `bloodPool`).
        parcellations : names of built-in ones, or files; carried to atrium and map as point and cell arrays.
        progress : may stop it; nothing is changed then.

        Raises
        ------
        LAFlatteningError : no such array, blood that cannot be found, thresholds that mean nothing.
        SurfaceError : no map, or a quick one.
        Cancelled : by `progress`, or because map, atrium or image were changed or deleted meanwhile, or because
            something else is being computed.
        """
        with longAction(self, MEASURING, progress) as action:
            report(action.progress, 0.0, "Reading the map")
            data = mapDataOf(mapNode)
            surfaceNode = mapNode.GetNodeReference(SURFACE_ROLE)
            data.point_values(array)
            others = [node for node in (volumeNode, regionNode) if node is not None]
            action.read(
                lambda: (stateOf(mapNode, array), *(versionOf(node) for node in others)),
                mapNode,
                surfaceNode,
                *others,
            )
            report(action.progress, 0.1, "Measuring blood")
            drawn = [Parcellation.load(name) for name in parcellations]
            pool = self.bloodPool(surfaceNode, volumeNode, regionNode) if rule.needs_blood_pool else None
            report(action.progress, 0.4, "Measuring the wall")
            found = measure_fibrosis(
                data,
                array,
                rule,
                pool,
                parcels=parcels_of(data, drawn),
                unit=unit_of(array),
                # Where the array was made of this image, it is sampled again within the triangles.
                volume=worldVolume(volumeNode) if volumeNode is not None else None,
            )
            report(action.progress, 0.9, "Writing")
            action.check()
            withParcels(mapNode, surfaceNode, data, drawn)
            table = writeFibrosis(mapNode, surfaceNode, data, found)
            table.SetAttribute(BLOOD_POOL_TEXT, bloodPoolText(pool))
            if pool is not None:
                writeBloodPool(mapNode, surfaceNode, volumeNode, pool)
            else:
                removeResults(mapNode, BLOOD_POOL)
            noteArray(mapNode, array, FIBROSIS, BLOOD_POOL)
            colourBy(surfaceNode, (classArrayOf(array), CELL_DATA))
            return found

    def measureParameters(
        self, parameterNode: LAFlatteningParameterNode, progress: ProgressCallback | None = None
    ) -> Fibrosis:
        """`measureFibrosis` with what the panel says."""
        p = parameterNode
        rule = Rule(p.rule, thresholdsFrom(p.ruleThresholds), p.ruleDirection)
        chosen: list[str | Path] = [] if p.parcellation == "none" else [p.parcellation]
        if str(p.parcellationFile) not in ("", "."):
            chosen.append(Path(p.parcellationFile))
        watch = whileChosen(p, ("map",), MEASURING, progress)
        return self.measureFibrosis(p.map, p.analysisArray, rule, p.volume, p.bloodRegion, chosen, watch)

    # ---- gaps --------------------------------------------------------------------------------------------------------

    def findGaps(
        self,
        mapNode: ModelNode | None,
        array: str,
        thresholds: Sequence[float],
        shown: float | None = None,
        search: float | str = SEARCH_MM,
        progress: ProgressCallback | None = None,
    ) -> slicer.vtkMRMLTableNode:
        """Gaps in ablation lines round each vein and each pair of veins.

        Parameters
        ----------
        array : scar is where it reaches a threshold.
        thresholds : increasing.
        shown : the threshold whose paths and gaps are drawn; the middle one by default.
        search : see `LAFlatteningLib.find_gaps`.

        Returns
        -------
        The table of gap lengths (mm) and RGM. A second one lists the gaps (`gapListTable`); each gap is a curve on the
        atrium and on the map.

        Raises
        ------
        LAFlatteningError : as `LAFlatteningLib.find_gaps`.
        SurfaceError : no map, or a quick one; search areas that run into another opening.
        Cancelled : as `measureFibrosis`.
        """
        with longAction(self, FINDING_GAPS, progress) as action:
            data = mapDataOf(mapNode)
            surfaceNode = mapNode.GetNodeReference(SURFACE_ROLE)
            action.read(lambda: stateOf(mapNode, array), mapNode, surfaceNode)
            found = find_gaps(data, array, thresholds, search=search, progress=part(action.progress, 0.0, 0.9))
            report(action.progress, 0.95, "Drawing")
            action.check()
            level = found.thresholds[len(found.thresholds) // 2] if shown is None else shown
            table = writeGaps(mapNode, surfaceNode, data, found, level)
            table.SetDescription("\n".join(found.notes))
            noteArray(mapNode, array, *GAP_KINDS)
            return table

    def gapsParameters(
        self, parameterNode: LAFlatteningParameterNode, progress: ProgressCallback | None = None
    ) -> slicer.vtkMRMLTableNode:
        """`findGaps` with what the panel says."""
        p = parameterNode
        watch = whileChosen(p, ("map",), FINDING_GAPS, progress)
        return self.findGaps(p.map, p.analysisArray, thresholdsFrom(p.gapThresholds), progress=watch)

    # ---- comparison --------------------------------------------------------------------------------------------------

    def compare(
        self, mapNode: ModelNode | None, otherMapNode: ModelNode | None, array: str, otherArray: str
    ) -> slicer.vtkMRMLTableNode:
        """How an array of one map agrees with an array of another, place by place.

        Voltages count as diseased where they are low. The difference (other - this) becomes a point array of the
        atrium.

        Raises
        ------
        SurfaceError : a map is missing, or a quick one, or its atrium is missing.
        TemplateError : maps on different templates.
        LAFlatteningError : no such array; the same map and array twice.
        Cancelled : something else is being computed.
        """
        refuseWhileBusy(self)
        if otherMapNode is None:
            raise LAFlatteningError("Choose the other map to compare with.")
        if otherMapNode is mapNode and array == otherArray:
            raise LAFlatteningError("A map would be compared with itself. Choose another map, or another array.")
        data, other = mapDataOf(mapNode), mapDataOf(otherMapNode)
        found = compare_maps(data, other, array, otherArray)
        surfaceNode = mapNode.GetNodeReference(SURFACE_ROLE)
        table = writeComparison(mapNode, surfaceNode, data, found, otherMapNode.GetName())
        table.SetDescription("\n".join(found.notes))
        noteArray(mapNode, array, COMPARISON)
        noteOther(table, otherMapNode, otherArray)
        return table

    def compareParameters(self, parameterNode: LAFlatteningParameterNode) -> slicer.vtkMRMLTableNode:
        """`compare` with what the panel says."""
        p = parameterNode
        return self.compare(p.map, p.otherMap, p.analysisArray, p.otherArray or p.analysisArray)

    # ---- results -----------------------------------------------------------------------------------------------------

    def surfaceOfMap(self, mapNode: ModelNode | None) -> ModelNode | None:
        """The atrium of a map."""
        return mapNode.GetNodeReference(SURFACE_ROLE) if mapNode is not None else None

    def hasOutdated(self, mapNode: ModelNode | None) -> bool:
        """Whether something was measured on a map before it changed; what was drawn on the map is hidden then."""
        return hasOutdated(mapNode)

    def hasResults(self, mapNode: ModelNode | None) -> bool:
        """Whether anything was measured on a map."""
        return mapNode is not None and bool(resultsOf(mapNode))

    def fibrosisTable(self, mapNode: ModelNode | None) -> slicer.vtkMRMLTableNode | None:
        """Areas of classes (cm2, %), one row a part."""
        return resultOf(mapNode, FIBROSIS)

    def bloodPoolWords(self, mapNode: ModelNode | None) -> str:
        """What the wall was compared with; empty if with nothing."""
        table = self.fibrosisTable(mapNode)
        return (table.GetAttribute(BLOOD_POOL_TEXT) or "") if table is not None else ""

    def gapTable(self, mapNode: ModelNode | None) -> slicer.vtkMRMLTableNode | None:
        """Gap and scar length (mm) and RGM, one row a threshold and search area."""
        return resultOf(mapNode, GAPS)

    def gapListTable(self, mapNode: ModelNode | None) -> slicer.vtkMRMLTableNode | None:
        """Length (mm) and place of each gap."""
        return resultOf(mapNode, GAP_LIST)

    def comparisonTable(self, mapNode: ModelNode | None) -> slicer.vtkMRMLTableNode | None:
        """Agreement with another map, one row a part."""
        return resultOf(mapNode, COMPARISON)

    def gapChart(self, mapNode: ModelNode | None) -> slicer.vtkMRMLPlotChartNode | None:
        """RGM over the threshold; None for one threshold."""
        found = resultsOf(mapNode, RGM) if mapNode is not None else []
        return next((node for node in found if isinstance(node, slicer.vtkMRMLPlotChartNode)), None)

    def bloodPoolNode(self, mapNode: ModelNode | None) -> slicer.vtkMRMLLabelMapVolumeNode | None:
        """Where blood was measured."""
        return resultOf(mapNode, BLOOD_POOL)

    def clearAnalysis(self, mapNode: ModelNode) -> None:
        """Remove all results of a map; arrays that were there before, or come from an image, stay.

        Raises
        ------
        Cancelled : something else is being computed.
        """
        refuseWhileBusy(self)
        removeResults(mapNode, FIBROSIS, BLOOD_POOL, GAPS, GAP_LIST, GAP_CURVE, PATH, RGM, COMPARISON)
        surfaceNode = mapNode.GetNodeReference(SURFACE_ROLE)
        if surfaceNode is not None:
            removeClasses(surfaceNode)
            removeDifferences(surfaceNode)


def bloodPoolText(pool: BloodPool | None) -> str:
    """The blood pool in words, for the panel."""
    if pool is None:
        return ""
    size = f"; {pool.voxels} voxels, {pool.volume_ml:.1f} ml" if pool.voxels is not None else ""
    return f"Blood pool: mean {pool.mean:.4g}, SD {pool.sd:.3g} ({pool.how}{size})."
