"""Section Input: which atrium."""

import slicer
from LAFlatteningScene.map_nodes import STAGE
from slicer.i18n import tr as _

from .section import Section, errorsShownIn, showMessage


class InputSection(Section):
    """Chooses the atrium, or loads the synthetic one."""

    def __init__(self, panel) -> None:
        super().__init__(panel)
        self._replaced: dict[str, tuple[str, object]] = {}
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

    def setReplaced(self, replaced: dict[str, str]) -> None:
        """Settings of the scene that are not known here: name -> what the scene says; the defaults are used."""
        self._replaced = {name: (said, self.parameters.getValue(name)) for name, said in replaced.items()}
        self.update()

    def reset(self) -> None:
        """Another parameter node."""
        self._replaced = {}

    def update(self) -> None:
        """Say what is missing, and which settings of the scene are not known here until they are changed."""
        self.ui.sampleButton.enabled = not self.panel.isBusy
        messages = [
            _('The scene says {name} "{said}", which this version does not know: "{used}" is used instead.').format(
                name=name, said=said, used=used
            )
            for name, (said, used) in self._replaced.items()
            if self.parameters.getValue(name) == used
        ]
        if not self.parameters.surface:
            messages.append(
                _("Choose the surface model of a left atrium, or load the synthetic one to try the module.")
            )
        showMessage(self.ui.inputMessage, "\n".join(messages))
