"""The Slicer module LAFlattening: a left atrium and its standard 2D map, side by side.

The method is in the library `LAFlatteningLib`, what it makes of MRML nodes in the package `LAFlatteningScene`, the
sections of the panel in `LAFlatteningWidgets`; this file holds what Slicer looks for in a module: parameter node,
Logic, Widget and Test.
"""

import importlib.util
import sys
import unittest
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Union

import numpy as np
import slicer
from slicer import (
    vtkMRMLLabelMapVolumeNode,
    vtkMRMLMarkupsFiducialNode,
    vtkMRMLModelNode,
    vtkMRMLScalarVolumeNode,
    vtkMRMLSegmentationNode,
    vtkMRMLTableNode,
)
from slicer.i18n import tr as _
from slicer.i18n import translate
from slicer.parameterNodeWrapper import Choice, WithinRange, parameterNodeWrapper
from slicer.ScriptedLoadableModule import *  # noqa: F403

# Of a module from "Additional module paths" Slicer knows only the folder of this file; the library lies beside that.
if importlib.util.find_spec("LAFlatteningLib") is None:
    sys.path.append(str(Path(__file__).resolve().parents[1]))

from LAFlatteningScene.analysis_logic import DEFAULT_THRESHOLDS, AnalysisLogic
from LAFlatteningScene.export import exportMap
from LAFlatteningScene.live_update import LiveUpdate, Report
from LAFlatteningScene.long_action import refuseWhileBusy, whileChosen
from LAFlatteningScene.map_making import MAKING, checkOutput, chooseMap, makeMap, notesOf
from LAFlatteningScene.map_nodes import refuseCopy, writeMap
from LAFlatteningScene.parameter_values import takeOutUnknown
from LAFlatteningScene.prepare_logic import PrepareLogic
from LAFlatteningScene.quality_nodes import METRICS_ROLE, REGIONS_ROLE, SERIES_ROLES
from LAFlatteningScene.sample_data import SAMPLE_NAME, loadSample, registerSampleData
from LAFlatteningScene.seed_logic import SeedLogic
from LAFlatteningScene.seed_nodes import seedPositions
from LAFlatteningScene.surface_nodes import Settings, SurfaceCache
from LAFlatteningScene.template_logic import TemplateLogic
from LAFlatteningScene.template_text import IsTemplate, textOf
from LAFlatteningScene.view_logic import ViewLogic
from LAFlatteningScene.views import addLayout
from LAFlatteningWidgets import (
    AnalyseSection,
    ExportSection,
    InputSection,
    MapSection,
    Panel,
    PrepareSection,
    QualitySection,
    SeedSection,
    TemplateSection,
)

from LAFlatteningLib.cavity.plan import KEEP_MM
from LAFlatteningLib.fibrosis import DIRECTIONS, RULES
from LAFlatteningLib.flattening import METHODS
from LAFlatteningLib.parcellation import builtin_parcellations
from LAFlatteningLib.projection import DEPTH_MM, SIDES, STATISTICS


@parameterNodeWrapper
class LAFlatteningParameterNode:
    """All that the panel holds; saved with the scene.

    Attributes
    ----------
    prepareInput : what an atrium is prepared from.
    prepareStructure : the segment (id) or label (value) that is the atrium; empty for the only one.
    pvLength, laaLength : length of vein and appendage that stays beyond the ostium, mm.
    preparePoints : points of the prepared mesh; 0 chooses.
    surface : the atrium, mm.
    seeds : the nine seeds.
    map : the map that is made and kept up to date.
    metrics : quality of the map.
    template : name of a built-in template, or the content of a template file (JSON).
    ownTemplate : the user's template that was used last, likewise; empty before there is one.
    editTemplate : handles on the map move holes and mitral feet of the template.
    method : "regional" or "paper".
    checkAxes : refuse seeds that contradict the patient axes; False for coordinates that are none.
    diskDiameter : of the map, mm.
    liveUpdate : the map follows the seeds.
    snapSeeds : a seed that was placed or moved goes to the nearest place where it may be.
    showTemplate, showLabels : lines and names on the map.
    showColourBar : values and colours beside the map.
    showOpenings : the covers of the openings on the atrium, on which seeds of veins and appendage are placed.
    linkCursor : pointing at one shows the same place on the other.
    volume : the image that is projected onto the wall, and in which blood is measured.
    projectLive : the projection follows image, depth, side and statistic.
    projectionDepth : mm along the normal.
    projectionSide : "both" sides of the wall, "in" or "out".
    projectionStatistic : "max" or "mean".
    analysisArray : array of the atrium that is measured and compared.
    rule, ruleThresholds, ruleDirection : how classes are told apart, see `LAFlatteningLib.Rule`; numbers as typed.
    bloodRegion : where blood is; the inside of the atrium if none is chosen.
    parcellation : further parts that are measured; "none" or a built-in one.
    parcellationFile : a file with further parts of the user's own; "." for none.
    gapThresholds : of scar, as typed.
    otherMap, otherArray : what is compared with; an empty array is the same as `analysisArray`.
    exportDirectory : where files are written; "." until one is chosen.
    """

    # Slicer knows this notation of a union only, and takes None in one only if the union says so, after the nodes.
    prepareInput: Union[vtkMRMLModelNode, vtkMRMLSegmentationNode, vtkMRMLLabelMapVolumeNode, None]  # noqa: UP007
    prepareStructure: str = ""
    pvLength: Annotated[float, WithinRange(0.0, 20.0)] = KEEP_MM
    laaLength: Annotated[float, WithinRange(0.0, 20.0)] = KEEP_MM
    preparePoints: Annotated[int, WithinRange(0, 200_000)] = 0
    surface: vtkMRMLModelNode
    seeds: vtkMRMLMarkupsFiducialNode
    map: vtkMRMLModelNode
    metrics: vtkMRMLTableNode
    template: Annotated[str, IsTemplate()] = "adapted1"
    ownTemplate: Annotated[str, IsTemplate(mayBeEmpty=True)] = ""
    editTemplate: bool = False
    method: Annotated[str, Choice(METHODS)] = "regional"
    checkAxes: bool = True
    diskDiameter: Annotated[float, WithinRange(10.0, 1000.0)] = 100.0
    liveUpdate: bool = True
    snapSeeds: bool = True
    showTemplate: bool = True
    showLabels: bool = True
    showColourBar: bool = True
    showOpenings: bool = True
    linkCursor: bool = True
    volume: vtkMRMLScalarVolumeNode
    projectLive: bool = True
    projectionDepth: Annotated[float, WithinRange(0.5, 10.0)] = DEPTH_MM
    projectionSide: Annotated[str, Choice(SIDES)] = "both"
    projectionStatistic: Annotated[str, Choice(STATISTICS)] = "max"
    analysisArray: str = ""
    rule: Annotated[str, Choice(RULES)] = "iir"
    ruleThresholds: str = DEFAULT_THRESHOLDS["iir"]
    ruleDirection: Annotated[str, Choice(DIRECTIONS)] = "above"
    bloodRegion: Union[vtkMRMLLabelMapVolumeNode, vtkMRMLSegmentationNode, None]  # noqa: UP007
    parcellation: Annotated[str, Choice(("none", *builtin_parcellations()))] = "none"
    parcellationFile: Path
    gapThresholds: str = ""
    otherMap: vtkMRMLModelNode
    otherArray: str = ""
    exportDirectory: Path


class LAFlatteningLogic(
    ScriptedLoadableModuleLogic,  # noqa: F405
    SeedLogic,
    PrepareLogic,
    AnalysisLogic,
    TemplateLogic,
    ViewLogic,
):
    """What the module does, on MRML nodes; usable from the console.

    Positions are RAS, mm, world coordinates: parent transforms of surface and seeds count, nonlinear ones too.
    Errors of the library (`LAFlatteningLib.errors`) pass through unchanged. What it does with seeds
    (create, place, snap, check) is in `LAFlatteningScene.seed_logic`, how it makes an atrium of a raw one in
    `LAFlatteningScene.prepare_logic`, what it reads off a map in `LAFlatteningScene.analysis_logic`, how it edits
    templates in `LAFlatteningScene.template_logic`, how it shows atrium and map in `LAFlatteningScene.view_logic`.

    Attributes
    ----------
    isBusy : a long action is going on, and the callback of its progress may be letting events through; until it is
        done, everything else that reads or writes maps and atria is refused, see `LAFlatteningScene.long_action`.

    Examples
    --------
    ``map = slicer.util.getModuleLogic("LAFlattening").flatten(surfaceNode, seedsNode)``
    """

    def __init__(self) -> None:
        ScriptedLoadableModuleLogic.__init__(self)  # noqa: F405
        self.cache = SurfaceCache()
        self.isBusy = False
        self._live: LiveUpdate | None = None

    # ---- map ---------------------------------------------------------------------------------------------------------

    def flatten(
        self,
        surfaceNode: vtkMRMLModelNode,
        seedsNode: vtkMRMLMarkupsFiducialNode,
        outputNode: vtkMRMLModelNode | None = None,
        template: str = "adapted1",
        method: str = "regional",
        checkAxes: bool = True,
        diskDiameter: float = 100.0,
        progress: Callable[[float, str], bool | None] | None = None,
    ) -> vtkMRMLModelNode:
        """Make the map of an atrium, with its tables and plots; all of it or nothing.

        Parameters
        ----------
        outputNode : the map to replace; None makes a new one, "<surface> map".
        template : the name of a built-in template, the path of a template file, or the content of one (JSON).
        method, checkAxes : as for `LAFlatteningLib.Flattener`.
        diskDiameter : of the map, mm.
        progress : called with the share done (0 to 1) and what is being done; returning False cancels.

        Returns
        -------
        The map: in mm in the plane z = 0, centred, with all arrays of the surface.

        Raises
        ------
        SurfaceError, SeedError, TemplateError, FoldError : of the library.
        Cancelled : by `progress`, or because the atrium was changed, a node deleted or the scene closed meanwhile, or
            because something else is being computed.
        """
        settings = Settings(textOf(template), method, checkAxes, float(diskDiameter))
        return makeMap(self, surfaceNode, seedsNode, outputNode, settings, progress)

    def flattenParameters(
        self, parameterNode: LAFlatteningParameterNode, progress: Callable[[float, str], bool | None] | None = None
    ) -> vtkMRMLModelNode:
        """`flatten` with what the panel says; the map and its metrics are kept in the parameter node."""
        p, settings = parameterNode, self.settingsFrom(parameterNode)
        chooseMap(p)
        watch = whileChosen(p, ("surface", "seeds", "map"), MAKING, progress)
        mapNode = makeMap(self, p.surface, p.seeds, p.map, settings, watch)
        p.map, p.metrics = mapNode, self.metricsTable(mapNode)
        return mapNode

    def preview(
        self,
        surfaceNode: vtkMRMLModelNode,
        seedsNode: vtkMRMLMarkupsFiducialNode,
        mapNode: vtkMRMLModelNode,
        template: str = "adapted1",
        method: str = "regional",
        checkAxes: bool = True,
        diskDiameter: float = 100.0,
    ) -> vtkMRMLModelNode:
        """A fast, rougher map into a map that exists, for dragging; tables and plots stay as they are.

        Parameters and errors as for `flatten`.
        """
        refuseWhileBusy(self)
        settings = Settings(textOf(template), method, checkAxes, float(diskDiameter))
        checkOutput(mapNode)
        refuseCopy(mapNode)
        flatMap = self.cache.flattener(surfaceNode, settings).preview(seedPositions(seedsNode))
        writeMap(mapNode, flatMap, surfaceNode, settings, "preview")
        return mapNode

    def previewParameters(self, parameterNode: LAFlatteningParameterNode) -> vtkMRMLModelNode:
        """`preview` with what the panel says."""
        p = parameterNode
        return self.preview(p.surface, p.seeds, p.map, p.template, p.method, p.checkAxes, p.diskDiameter)

    def notes(self, mapNode: vtkMRMLModelNode) -> list[str]:
        """What was mended in the input and what to look at on the map before trusting it."""
        return notesOf(mapNode)

    def settingsFrom(self, parameterNode: LAFlatteningParameterNode) -> Settings:
        """How the panel says that maps are made."""
        p = parameterNode
        return Settings(p.template, p.method, p.checkAxes, float(p.diskDiameter))

    # ---- live update -------------------------------------------------------------------------------------------------

    def startLiveUpdate(
        self,
        parameterNode: LAFlatteningParameterNode,
        scheduler: Callable[[int, Callable[[], None]], None],
        onReport: Callable[[Report], None] | None = None,
    ) -> None:
        """Follow surface and seeds of a parameter node: snap, check, preview while dragging, full map on release.

        It ends when the scene is closed or another one is added to it, which may replace what the parameter node holds.

        Parameters
        ----------
        scheduler : called with milliseconds and a function to call after them, once (in Slicer
            ``qt.QTimer.singleShot``).
        onReport : told after every change, see `LAFlatteningScene.live_update.Report`. Errors of input are reported,
            not raised into Slicer's events.
        """
        self.stopLiveUpdate()
        self._live = LiveUpdate(self, parameterNode, scheduler, onReport)

    def stopLiveUpdate(self) -> None:
        """No longer follow; nothing that was scheduled happens any more."""
        if self._live is not None:
            self._live.stop()
            self._live = None

    def canUndo(self) -> bool:
        """Whether a change of the seeds that are followed can be undone."""
        return self._live is not None and self._live.history.canUndo

    def canRedo(self) -> bool:
        """Whether an undone change can be made again."""
        return self._live is not None and self._live.history.canRedo

    def undo(self) -> None:
        """Undo the last placing, moving or removing of a seed."""
        if self._live is not None:
            self._live.undo()

    def redo(self) -> None:
        """Make the change again that was undone last."""
        if self._live is not None:
            self._live.redo()

    # ---- quality and export ------------------------------------------------------------------------------------------

    def metricsTable(self, mapNode: vtkMRMLModelNode) -> vtkMRMLTableNode | None:
        """Quality of the map: columns Quantity, Value, Unit."""
        return mapNode.GetNodeReference(METRICS_ROLE)

    def regionTable(self, mapNode: vtkMRMLModelNode) -> vtkMRMLTableNode | None:
        """Per region: name, area on the atrium (mm2), shares of atrium and map (%), isotropy."""
        return mapNode.GetNodeReference(REGIONS_ROLE)

    def histogramCharts(self, mapNode: vtkMRMLModelNode) -> list[slicer.vtkMRMLPlotChartNode]:
        """Histograms of area ratio and isotropy, as plot charts."""
        charts = (mapNode.GetNodeReference(role) for role in SERIES_ROLES)
        return [chart for chart in charts if chart is not None]

    def exportMap(
        self, mapNode: vtkMRMLModelNode, directory: str | Path, formats: tuple[str, ...] = ("vtp", "png", "csv")
    ) -> list[Path]:
        """Write the map: all files or none.

        Files: <map>.vtp, <map>.png (with colour bar), <map> metrics.csv, <map> regions.csv, and of what was measured
        <map> fibrosis.csv, gaps.csv, gap list.csv and comparison.csv; with the .vtp, <map> template.json if the
        template is not a built-in one.

        Raises
        ------
        InputFileError : no map, or a quick one; tables that were measured before the map changed; the folder is
            missing or cannot be written to.
        SurfaceError : the copy of a map, which has no tables.
        Cancelled : something else is being computed.
        """
        refuseWhileBusy(self)
        return exportMap(mapNode, directory, formats)

    # ---- sample data -------------------------------------------------------------------------------------------------

    def loadSample(self, points: int = 20000) -> tuple[vtkMRMLModelNode, vtkMRMLMarkupsFiducialNode]:
        """Add the synthetic atrium with LGE, and its seeds."""
        surface, seeds, _volume = loadSample(points)
        return surface, seeds


class LAFlattening(ScriptedLoadableModule):  # noqa: F405
    """The module as Slicer lists it."""

    def __init__(self, parent) -> None:
        ScriptedLoadableModule.__init__(self, parent)  # noqa: F405
        parent.title = _("Left Atrium Flattening")
        parent.categories = [translate("qSlicerAbstractCoreModule", "Cardiac")]
        parent.dependencies = ["Markups", "Models", "Plots", "Tables"]
        parent.contributors = ["The LAFlattening developers"]
        parent.helpText = _(
            "Lays a left atrium flat: one standard 2D map of the whole chamber, with the same layout for every "
            "patient. Choose an atrium, place nine seeds, and see the map beside it; moving a seed moves the map. "
            "Docs/module.md in the extension's repository is the guide to this panel."
        )
        parent.acknowledgementText = _(
            "Implements Fast Quasi-Conformal Regional Flattening of the Left Atrium by M. Nunez-Garcia, G. Bernardino, "
            "F. Alarcon, G. Caixal, L. Mont, O. Camara and C. Butakoff. Not a medical device. For research."
        )
        slicer.app.connect("startupCompleted()", registerSampleData)
        # Scenes may be opened before the panel.
        slicer.app.connect("startupCompleted()", addLayout)


class LAFlatteningWidget(ScriptedLoadableModuleWidget, Panel):  # noqa: F405
    """The panel. Its state is the parameter node; what it does is in `LAFlatteningWidgets`."""

    def __init__(self, parent=None) -> None:
        Panel.__init__(self)
        ScriptedLoadableModuleWidget.__init__(self, parent)  # noqa: F405

    def setup(self) -> None:
        """Make the panel."""
        ScriptedLoadableModuleWidget.setup(self)  # noqa: F405
        uiWidget = slicer.util.loadUI(self.resourcePath("UI/LAFlattening.ui"))
        self.layout.addWidget(uiWidget)
        self.ui = slicer.util.childWidgetVariables(uiWidget)
        uiWidget.setMRMLScene(slicer.mrmlScene)
        self.logic = LAFlatteningLogic()
        self.inputs, self.seeds, self.map = InputSection(self), SeedSection(self), MapSection(self)
        self.prepare, self.template, self.analyse = PrepareSection(self), TemplateSection(self), AnalyseSection(self)
        self.sections = (
            self.prepare,
            self.inputs,
            self.seeds,
            self.map,
            self.template,
            QualitySection(self),
            self.analyse,
            ExportSection(self),
        )
        # The module may have been added after the start.
        addLayout()
        self.observeScene()
        self.initializeParameterNode()

    def cleanup(self) -> None:
        """The panel goes away: nothing of it may be called again."""
        self.onSceneStartClose()
        self.logic.releaseViews()
        self.removeObservers()

    def enter(self) -> None:
        """The user opens the module."""
        self.onEnter()

    def exit(self) -> None:
        """The user opens another module: atrium and map stay linked, clicks no longer place seeds."""
        if self.parameterNode is not None:
            self.logic.stopPlacing()

    def onReload(self) -> None:
        """Load module and library anew from their files."""
        packages = ("LAFlatteningLib", "LAFlatteningScene", "LAFlatteningWidgets")
        for name in [name for name in sys.modules if name.partition(".")[0] in packages]:
            del sys.modules[name]
        ScriptedLoadableModuleWidget.onReload(self)  # noqa: F405

    def initializeParameterNode(self) -> None:
        """Take the parameter node of the scene (made if there is none); wait for one while a scene is opened."""
        if slicer.mrmlScene.IsImporting():
            return
        node = self.logic.getParameterNode()
        replaced = takeOutUnknown(LAFlatteningParameterNode, node)
        self.setParameterNode(LAFlatteningParameterNode(node))
        self.inputs.setReplaced(replaced)
        self.inputs.chooseOnlySurface()


class LAFlatteningTest(ScriptedLoadableModuleTest):  # noqa: F405
    """From the sample data to the exported map, in whatever runs the module.

    The tests of the source tree (Testing/Module) go deeper; `test_sourceTree` runs them where they are found. An
    installed extension does not carry them.
    """

    def setUp(self) -> None:
        """Begin with an empty scene."""
        slicer.mrmlScene.Clear()

    def runTest(self) -> None:
        """Run every test, each in an empty scene; what Slicer calls when a user presses Test."""
        result = unittest.TextTestRunner(verbosity=2).run(unittest.TestLoader().loadTestsFromTestCase(type(self)))
        self.assertTrue(result.wasSuccessful(), f"{len(result.failures) + len(result.errors)} tests failed")

    def test_console(self) -> None:
        """One line in the console makes a map."""
        logic = slicer.util.getModuleLogic("LAFlattening")
        surfaceNode, seedsNode = logic.loadSample(points=2000)
        mapNode = logic.flatten(surfaceNode, seedsNode)
        points = slicer.util.arrayFromModelPoints(mapNode)
        self.assertEqual(len(points), surfaceNode.GetPolyData().GetNumberOfPoints())
        self.assertAlmostEqual(float(np.hypot(points[:, 0], points[:, 1]).max()), 50.0, places=3)
        self.assertEqual(float(np.abs(points[:, 2]).max()), 0.0)

    def test_sampleData(self) -> None:
        """The module Sample Data offers the synthetic atrium, once, and makes it."""
        import SampleData

        registerSampleData()
        registerSampleData()
        source = SampleData.SampleDataLogic().sourceForSampleName(SAMPLE_NAME)
        surfaceNode, seedsNode, volumeNode = source.customDownloader(source)
        self.assertGreater(volumeNode.GetImageData().GetScalarRange()[1], 0.0)
        self.assertIsNotNone(surfaceNode.GetPolyData().GetPointData().GetArray("LGE"))
        self.assertEqual(seedsNode.GetNumberOfDefinedControlPoints(), 9)

    def test_panel(self) -> None:
        """The buttons of the panel lead from the sample to a map."""
        panel = slicer.util.getModuleWidget("LAFlattening")
        panel.enter()
        panel.ui.sampleButton.click()
        self.assertTrue(panel.ui.flattenButton.enabled, panel.ui.flattenButton.toolTip)
        panel.ui.flattenButton.click()
        self.assertEqual(panel.ui.mapMessage.text, "")
        self.assertIsNotNone(panel.parameterNode.map)

    def test_sourceTree(self) -> None:
        """The tests in Testing/Module, where the module runs from its source tree."""
        folder = Path(__file__).resolve().parents[1] / "Testing" / "Module"
        if not folder.is_dir():
            self.skipTest("the source tree is not here")
        suite = unittest.TestLoader().discover(str(folder), top_level_dir=str(folder))
        result = unittest.TextTestRunner(verbosity=1).run(suite)
        self.assertTrue(result.wasSuccessful(), f"{len(result.failures) + len(result.errors)} tests failed")
