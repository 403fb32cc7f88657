"""Section Prepare: from a raw atrium to one that is open, with seeds."""

import qt
from LAFlatteningScene.plane_nodes import isMoved, planesOf, showHandles, suggestedOf
from slicer.i18n import tr as _

from .section import Section, Work, errorsShownIn, fitHeight, showMessage

OPENING, PERIMETER, FOUND = range(3)
"""Columns of the table."""


class PrepareSection(Section):
    """Suggests where an atrium is cut, lets the user correct it, cuts, and takes it back.

    Where the planes are is read from their nodes. Kept here are only the plane that was chosen in the table, the atrium
    that the section was last folded or unfolded for, and what the structures of the input are called.
    """

    def __init__(self, panel) -> None:
        super().__init__(panel)
        self.work = Work(panel, self.ui.prepareProgressBar, self.ui.prepareCancelButton)
        self.chosen: str | None = None
        self.structures: dict[str, str] = {}
        self.seen: tuple[object, ...] = ()
        self.ui.suggestButton.connect("clicked()", self.suggest)
        self.ui.byHandButton.connect("clicked()", self.placeByHand)
        self.ui.applyButton.connect("clicked()", self.apply)
        self.ui.prepareUndoButton.connect("clicked()", self.undo)
        self.ui.structureSelector.connect("activated(int)", self.chooseStructure)
        self.ui.openingsTable.connect("cellClicked(int,int)", self.choose)

    # ---- what the user does ------------------------------------------------------------------------------------------

    def suggest(self) -> None:
        """Find the openings, and show the planes."""
        with errorsShownIn(self.ui.prepareMessage, _("No openings could be suggested.")), self.work.running():
            self.logic.suggestParameters(self.parameters, self.work.progress)
            self.chosen = None
            self._showNotes()
            self.panel.showLayout()

    def placeByHand(self) -> None:
        """Show planes for the user to put into place."""
        with errorsShownIn(self.ui.prepareMessage, _("No planes could be shown.")):
            self.logic.planesParameters(self.parameters)
            showMessage(
                self.ui.prepareMessage,
                _(
                    "Choose an opening in the table and move its plane to where it is cut. Then Apply, or Suggest "
                    "to have the planes found that you have not moved."
                ),
            )
            self.panel.showLayout()
        self.panel.update()

    def apply(self) -> None:
        """Cut the atrium in its planes, and choose what comes of it."""
        with errorsShownIn(self.ui.prepareMessage, _("The atrium could not be cut.")), self.work.running():
            self.logic.applyParameters(self.parameters, self.work.progress)
            self._showNotes()
            self.panel.showLayout()

    def undo(self) -> None:
        """Take the last step back, and say which."""
        done = {
            "cavity": _("The cavity was removed; the planes can be moved again."),
            "moves": _("The planes are where they were suggested."),
            "planes": _("The planes were removed."),
            "": "",
        }
        with errorsShownIn(self.ui.prepareMessage, _("The step could not be undone.")):
            what = self.logic.undoPrepareParameters(self.parameters)
            showMessage(self.ui.prepareMessage, done[what])
        self.panel.update()

    def choose(self, row: int, column: int = 0) -> None:
        """An opening was chosen in the table: its plane gets handles."""
        self.chosen = self.ui.openingsTable.item(row, OPENING).text()
        showHandles(planesOf(self.parameters.prepareInput), self.chosen)

    def chooseStructure(self, row: int) -> None:
        """Another segment or label was chosen."""
        self.parameters.prepareStructure = list(self.structures)[row]

    # ---- what is shown -----------------------------------------------------------------------------------------------

    def reset(self) -> None:
        """Nothing is chosen or said, and what is being computed is no longer wanted."""
        self.work.cancel()
        self.chosen, self.seen = None, ()
        showMessage(self.ui.prepareMessage, "")

    def update(self) -> None:
        """Structures, planes with their rims, and what can be pressed now."""
        p = self.parameters
        self._fold()
        self._updateStructures()
        planes, cavity = planesOf(p.prepareInput), self.logic.cavityOf(p.prepareInput)
        editable = bool(planes) and cavity is None
        if not editable:
            self.chosen = None
        showHandles(planes, self.chosen)
        self._fillTable(planes)
        idle = not self.panel.isBusy
        self.ui.suggestButton.enabled = p.prepareInput is not None and idle
        self.ui.suggestButton.toolTip = (
            _("Find veins, appendage and valve, and show a plane where each would be cut. Nothing is changed.")
            if p.prepareInput is not None
            else _("Choose what to prepare first.")
        )
        self.ui.byHandButton.enabled = p.prepareInput is not None and cavity is None and idle
        self.ui.applyButton.enabled = editable and idle
        self.ui.applyButton.toolTip = (
            _("Cut the atrium in the planes as they are now, and place nine seeds. The atrium itself is kept.")
            if editable
            else _("Press Undo to move the planes and cut anew.")
            if cavity is not None
            else _("Press Suggest first, and look at the planes.")
        )
        self.ui.prepareUndoButton.enabled = bool(planes or cavity) and idle

    def _fold(self) -> None:
        """Fold the section for an atrium that is ready, unfold it else; after that the user decides."""
        p = self.parameters
        if self.seen == (p.surface,):
            return
        self.seen = (p.surface,)
        if p.surface is not None and p.surface is self.logic.cavityOf(p.prepareInput):
            # Just made here: the user may want to undo it.
            return
        self.ui.prepareSection.collapsed = p.surface is not None and self.logic.isReady(p.surface)
        if p.surface is not None and not self.ui.prepareSection.collapsed and p.prepareInput is None:
            p.prepareInput = p.surface

    def _updateStructures(self) -> None:
        p, selector = self.parameters, self.ui.structureSelector
        self.structures = self.logic.structures(p.prepareInput)
        names = list(self.structures.values())
        if [selector.itemText(row) for row in range(selector.count)] != names:
            selector.clear()
            selector.addItems(names)
        keys = list(self.structures)
        if p.prepareStructure not in keys:
            # The structure of another input; the only one need not be chosen.
            p.prepareStructure = ""
        selector.currentIndex = keys.index(p.prepareStructure) if p.prepareStructure else 0 if len(keys) == 1 else -1
        for widget in (selector, self.ui.structureSelectorLabel):
            widget.setVisible(len(keys) > 1)

    def _fillTable(self, planes) -> None:
        table, cuts = self.ui.openingsTable, self.logic.plannedCuts()
        names = [name for name in self.logic.openings() if name in planes]
        table.setRowCount(len(names))
        for row, name in enumerate(names):
            cut = cuts.get(name)
            note = self._note(planes[name], cut)
            perimeter = f"{cut.perimeter:.0f} mm" if cut is not None and cut.around else ""
            for column, text in ((OPENING, name), (PERIMETER, perimeter), (FOUND, note)):
                item = qt.QTableWidgetItem(text)
                item.setToolTip(f"{self.logic.openings()[name]}: {note}")
                table.setItem(row, column, item)
        for column in (OPENING, PERIMETER):
            table.resizeColumnToContents(column)
        if self.chosen in names:
            table.selectRow(names.index(self.chosen))
        else:
            table.clearSelection()
        table.setVisible(bool(names))
        fitHeight(table)

    def _note(self, plane, cut) -> str:
        """How an opening was found, or what is wrong with its plane."""
        if cut is not None and not cut.around:
            return _("misses the tube: move it")
        if isMoved(plane):
            return _("moved")
        _plane, foundBy, kept = suggestedOf(plane)
        texts = {
            "ostium": _("at the ostium"),
            "open": _("open already"),
            "flat": _("flat valve"),
            "rule": _("valve by rule"),
            "hand": _("roughly: move it"),
            "given": _("by hand"),
        }
        text = texts.get(foundBy, foundBy)
        return _("{how}, {length} mm stay").format(how=text, length=f"{kept:.1f}") if kept is not None else text

    def _showNotes(self) -> None:
        notes = self.logic.prepareNotes(self.parameters.prepareInput, self.logic.rawChoiceFrom(self.parameters))
        showMessage(self.ui.prepareMessage, "\n".join(dict.fromkeys(notes)))
