"""Section Seeds: which seed is next, where it goes, and what is wrong with those that are placed."""

from collections.abc import Mapping

import qt
import slicer
from slicer.i18n import tr as _

from .section import Section, errorsShownIn, fitHeight, showMessage

LABEL, STATE, PLACE = range(3)
"""Columns of the table."""


class SeedSection(Section):
    """Guides through placing the seeds and lists them.

    Which seeds are placed is read from the seeds node, whether clicks place seeds from Slicer's interaction node. Kept
    here are only the reasons that the Logic told last, and which seed was chosen in the table.
    """

    def __init__(self, panel) -> None:
        super().__init__(panel)
        self.reasons: Mapping[str, str] = {}
        self.chosen: str | None = None
        self.ui.placeButton.connect("clicked()", self.place)
        self.ui.removeButton.connect("clicked()", self.remove)
        self.ui.undoButton.connect("clicked()", self.undo)
        self.ui.redoButton.connect("clicked()", self.redo)
        self.ui.seedsTable.connect("cellClicked(int,int)", self.choose)

    # ---- what the user does ------------------------------------------------------------------------------------------

    def place(self) -> None:
        """Start or stop placing seeds by mouse."""
        with errorsShownIn(self.ui.seedsMessage, _("Seeds cannot be placed.")):
            if not self.ui.placeButton.checked:
                self.logic.stopPlacing()
            else:
                if self.parameters.seeds is None:
                    self.parameters.seeds = self.logic.createSeedsNode(self._newName())
                self.panel.showLayout()
                self.logic.placeNext(self.parameters.seeds, self._chosenToPlace())
        self.update()

    def remove(self) -> None:
        """Take the chosen seed away."""
        with errorsShownIn(self.ui.seedsMessage, _("The seed could not be removed.")):
            self.logic.removeSeed(self.parameters.seeds, self.chosen)
        self.update()

    def undo(self) -> None:
        """Undo the last change of a seed."""
        with errorsShownIn(self.ui.seedsMessage, _("The change could not be undone.")):
            self.logic.undo()
        self.update()

    def redo(self) -> None:
        """Make an undone change again."""
        with errorsShownIn(self.ui.seedsMessage, _("The change could not be made again.")):
            self.logic.redo()
        self.update()

    def choose(self, row: int, column: int = 0) -> None:
        """A seed was chosen in the table: it is shown in the diagram and, if it has no place yet, placed next."""
        self.chosen = self.ui.seedsTable.item(row, LABEL).text()
        if self._isPlacing() and self._chosenToPlace():
            self.logic.placeNext(self.parameters.seeds, self.chosen)
        self.update()

    # ---- what happens ------------------------------------------------------------------------------------------------

    def reset(self) -> None:
        """Nothing is chosen, nothing known to be wrong."""
        self.reasons, self.chosen = {}, None

    def setReasons(self, reasons: Mapping[str, str]) -> None:
        """What is wrong with seeds, as the Logic found."""
        if dict(reasons) != self.reasons:
            self.reasons = dict(reasons)
            self.update()

    def update(self) -> None:
        """Show seeds, states, diagram and what to do next."""
        parameters = self.parameters
        template = parameters.template
        labels, placed, following = self.logic.seedLabels(template), self._placed(), self._nextSeed()
        if self._isPlacing():
            if following is None:
                # Another click would add a point that is no seed.
                self.logic.stopPlacing()
            if self.chosen in placed:
                self.chosen = None
        self._fillTable(labels, placed, following)
        shown = self.chosen or following
        diagram = self.panel.resourcePath(f"SeedDiagrams/{shown or 'complete'}.png")
        self.ui.seedDiagram.setPixmap(qt.QPixmap(diagram))
        if shown is None:
            text = _("All seeds are placed. Drag one to move it.")
        else:
            text = _("{seed}: {place}") if shown in placed else _("Next {seed}: {place}")
            text = text.format(seed=shown, place=self.logic.seedDescription(shown, template))
        self.ui.nextSeedText.text = text
        self._updateButtons(placed, following)
        showMessage(self.ui.seedsMessage, "\n".join(dict.fromkeys(self.reasons.values())))

    def _fillTable(self, labels: tuple[str, ...], placed: set[str], following: str | None) -> None:
        table = self.ui.seedsTable
        table.setRowCount(len(labels))
        for row, label in enumerate(labels):
            reason = self.reasons.get(label, "")
            if reason:
                state = _("check")
            elif label in placed:
                state = _("placed")
            else:
                state = _("next") if label == following else _("not placed")
            description = self.logic.seedDescription(label, self.parameters.template)
            for column, text in ((LABEL, label), (STATE, state), (PLACE, description)):
                item = qt.QTableWidgetItem(text)
                item.setToolTip(reason or description)
                table.setItem(row, column, item)
        for column in (LABEL, STATE):
            table.resizeColumnToContents(column)
        if self.chosen is None:
            table.clearSelection()
        else:
            table.selectRow(labels.index(self.chosen))
        fitHeight(table)

    def _updateButtons(self, placed: set[str], following: str | None) -> None:
        placing = self._isPlacing()
        button = self.ui.placeButton
        button.checked = placing
        button.enabled = self.parameters.surface is not None and (placing or following is not None)
        if self.parameters.surface is None:
            button.toolTip = _("Choose an atrium first.")
        elif following is None:
            button.toolTip = _("All seeds are placed. Drag one to move it, or remove one to place it anew.")
        else:
            button.toolTip = _(
                "Each click on the atrium places the next seed, until all are placed. Press again to stop."
            )
        button.text = _("Stop placing") if placing else _("Place seeds")
        self.ui.removeButton.enabled = self.chosen in placed
        self.ui.undoButton.enabled = self.logic.canUndo()
        self.ui.redoButton.enabled = self.logic.canRedo()

    # ---- helpers -----------------------------------------------------------------------------------------------------

    def _chosenToPlace(self) -> str | None:
        """The seed chosen in the table, if it has no place yet."""
        return self.chosen if self.chosen not in self._placed() else None

    def _newName(self) -> str:
        surfaceNode = self.parameters.surface
        return _("{name} seeds").format(name=surfaceNode.GetName()) if surfaceNode else _("Seeds")

    def _nextSeed(self) -> str | None:
        if self.parameters.seeds is None:
            return self.logic.seedLabels(self.parameters.template)[0]
        return self.logic.nextSeed(self.parameters.seeds)

    def _placed(self) -> set[str]:
        """Labels of the seeds that have a place."""
        node = self.parameters.seeds
        if node is None:
            return set()
        indices = range(node.GetNumberOfControlPoints())
        return {
            node.GetNthControlPointLabel(k)
            for k in indices
            if node.GetNthControlPointPositionStatus(k) == node.PositionDefined
        }

    def _isPlacing(self) -> bool:
        """Whether a click in a view places a seed."""
        application, seedsNode = slicer.app.applicationLogic(), self.parameters.seeds
        interaction = application.GetInteractionNode()
        if seedsNode is None or interaction.GetCurrentInteractionMode() != interaction.Place:
            return False
        return application.GetSelectionNode().GetActivePlaceNodeID() == seedsNode.GetID()
