"""What the panel does between its sections and Slicer's events."""

import qt
import slicer
import vtk
from slicer.util import VTKObservationMixin


class Panel(VTKObservationMixin):
    """The part of the module's Widget that does not depend on Slicer's base class of widgets.

    Attributes
    ----------
    parameterNode : the only store of what the panel shows; None while a scene is closed.
    sections : in the order of the panel.
    work : the computation that is going on in the panel, see `section.Work`; None if there is none.
    """

    def __init__(self) -> None:
        VTKObservationMixin.__init__(self)
        self.parameterNode = None
        self.sections = ()
        self.work = None
        self._guiTag = None
        self._isResuming = False

    def observeScene(self) -> None:
        """Follow opening and closing of scenes, and what clicks in views do."""
        scene, interaction = slicer.mrmlScene, slicer.app.applicationLogic().GetInteractionNode()
        self.addObserver(scene, scene.StartCloseEvent, self.onSceneStartClose)
        self.addObserver(scene, scene.EndCloseEvent, self.onSceneChanged)
        self.addObserver(scene, scene.StartImportEvent, self.onSceneStartImport)
        self.addObserver(scene, scene.EndImportEvent, self.onSceneChanged)
        self.addObserver(interaction, interaction.InteractionModeChangedEvent, self.onInteractionMode)

    def setParameterNode(self, parameterNode: object | None) -> None:
        """Connect the panel with a parameter node (`LAFlatteningParameterNode`); None leaves it unconnected."""
        if self.parameterNode is not None:
            self.logic.stopLiveUpdate()
            self.logic.stopTemplateEditing()
            self.logic.stopCutPreview()
            self.logic.stopLiveProjection()
            self.logic.unlinkViews()
            self.parameterNode.disconnectGui(self._guiTag)
            self.removeObserver(self.parameterNode, vtk.vtkCommand.ModifiedEvent, self.onParametersModified)
        self.parameterNode = parameterNode
        for section in self.sections:
            section.reset()
        if parameterNode is not None:
            self._guiTag = parameterNode.connectGui(self.ui)
            self.addObserver(parameterNode, vtk.vtkCommand.ModifiedEvent, self.onParametersModified)
            self.logic.linkViews(parameterNode, self.onReadout, self.onColours)
            self.logic.startLiveUpdate(parameterNode, qt.QTimer.singleShot, self.onReport)
            self.logic.startTemplateEditing(parameterNode, qt.QTimer.singleShot, self.onTemplateEdited)
            self.logic.startCutPreview(parameterNode, qt.QTimer.singleShot, self.onCuts)
            self.logic.startLiveProjection(parameterNode, qt.QTimer.singleShot, self.onProjected)
        self.update()

    # ---- events ------------------------------------------------------------------------------------------------------

    def onEnter(self) -> None:
        """The panel is shown: what it shows goes on, undo included, if it is still of this scene."""
        if self.parameterNode is None or self.parameterNode.parameterNode is not self.logic.getParameterNode():
            self.initializeParameterNode()
            return
        self.inputs.chooseOnlySurface()
        self.logic.updateViews()
        self.update()

    def onSceneStartClose(self, caller=None, event=None) -> None:
        """The scene is about to go, and the parameter node with it."""
        self._isResuming = False
        self.setParameterNode(None)

    def onSceneStartImport(self, caller=None, event=None) -> None:
        """Another scene is about to be added, whose parameter node may replace the one that is there.

        In the midst of it that names nodes by numbers which still belong to others: following it would write the map of
        one atrium over that of another.
        """
        self._isResuming = self._isResuming or self.parameterNode is not None
        self.setParameterNode(None)

    def onSceneChanged(self, caller=None, event=None) -> None:
        """A scene was closed or opened: begin anew when Slicer has finished with it.

        Nodes that were added in the midst of opening would get in the way of those that come from the file.
        """
        qt.QTimer.singleShot(0, self.onSceneReady)

    def onSceneReady(self) -> None:
        """Take the parameter node of the scene that is there now, if the panel is shown, or was at work, without it."""
        if self.parameterNode is not None or not (self._isResuming or self.parent.isEntered):
            return
        if slicer.mrmlScene.IsBatchProcessing():
            # More is being opened, and lets events through; look again when it may be done.
            qt.QTimer.singleShot(100, self.onSceneReady)
            return
        self._isResuming = False
        self.initializeParameterNode()

    def onParametersModified(self, caller=None, event=None) -> None:
        """Something that the panel shows has changed."""
        self.update()

    def onInteractionMode(self, caller=None, event=None) -> None:
        """Clicks in views now do something else."""
        if self.parameterNode is not None:
            self.seeds.update()

    def onReport(self, report) -> None:
        """The Logic has followed a change of surface or seeds."""
        if self.parameterNode is None:
            return
        self.seeds.setReasons(report.seedReasons)
        if report.stage != "preview":
            self.map.showReport(report)
            self.update()

    def onTemplateEdited(self, report) -> None:
        """The Logic has followed an edit of the template."""
        if self.parameterNode is not None:
            self.template.showEdit(report)

    def onCuts(self) -> None:
        """The Logic has followed the planes of the openings."""
        if self.parameterNode is not None:
            self.prepare.update()

    def onProjected(self, projection, text: str) -> None:
        """The Logic has projected the image anew, or could not."""
        if self.parameterNode is not None:
            self.analyse.showProjection(projection, text)
            self.update()

    def onReadout(self, text: str) -> None:
        """What is under the cursor."""
        self.ui.readoutText.text = text

    def onColours(self) -> None:
        """The atrium is coloured otherwise."""
        if self.parameterNode is not None:
            self.map.updateColours()

    # ---- what sections use -------------------------------------------------------------------------------------------

    @property
    def isBusy(self) -> bool:
        """Whether something is being computed, and nothing else can be asked for but to cancel it."""
        return self.work is not None

    def update(self) -> None:
        """Show in all sections what the parameter node says."""
        if self.parameterNode is None:
            return
        for section in self.sections:
            section.update()

    def showLayout(self) -> None:
        """Show the atrium left and the map right."""
        self.logic.showLayout()
