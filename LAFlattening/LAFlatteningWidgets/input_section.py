"""Section Input: which atrium."""

import slicer
from LAFlatteningScene.map_nodes import STAGE
from slicer.i18n import tr as _

from .section import Section, errorsShownIn, showMessage


class InputSection(Section):
    """Chooses the atrium, or loads the synthetic one."""

    def __init__(self, panel) -> None:
        super().__init__(panel)
        self.ui.sampleButton.connect("clicked()", self.loadSample)

    def loadSample(self) -> None:
        """Add the synthetic atrium with its seeds, and choose them."""
        with errorsShownIn(self.ui.inputMessage, _("The synthetic atrium could not be made.")):
            surfaceNode, seedsNode = self.logic.loadSample()
            self.parameters.surface, self.parameters.seeds = surfaceNode, seedsNode
            # Another atrium gets another map.
            self.parameters.map = None
            self.panel.showLayout()

    def chooseOnlySurface(self) -> None:
        """Choose the atrium where there is no choice: the only model in the scene that a user sees in lists."""
        if self.parameters.surface:
            return
        models = [node for node in slicer.util.getNodesByClass("vtkMRMLModelNode") if not node.GetHideFromEditors()]
        candidates = [node for node in models if node.GetAttribute(STAGE) is None]
        if len(candidates) == 1:
            self.parameters.surface = candidates[0]

    def update(self) -> None:
        """Say what is missing."""
        self.ui.sampleButton.enabled = not self.panel.isBusy
        if not self.parameters.surface:
            showMessage(
                self.ui.inputMessage,
                _("Choose the surface model of a left atrium, or load the synthetic one to try the module."),
            )
        else:
            showMessage(self.ui.inputMessage, "")
