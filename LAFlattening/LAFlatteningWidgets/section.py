"""What the sections of the panel share: who they belong to, messages, tables."""

from collections.abc import Iterator
from contextlib import contextmanager

import qt
import slicer
from LAFlatteningScene.long_action import BUSY, Interrupted
from slicer.i18n import tr as _

from LAFlatteningLib import Cancelled, LAFlatteningError


class Section:
    """A part of the panel.

    Parameters
    ----------
    panel : the module's Widget: `ui`, `logic`, `parameterNode`, `sectionsChanged()`.
    """

    def __init__(self, panel) -> None:
        self.panel = panel
        self.ui = panel.ui
        self.logic = panel.logic

    @property
    def parameters(self):
        """The parameter node; None while a scene is closed."""
        return self.panel.parameterNode

    def reset(self) -> None:
        """Another parameter node: what belonged to the former is no longer true."""

    def update(self) -> None:
        """Show what the parameter node says."""


class Work:
    """A computation with a progress bar and a button to cancel it; the only one in the panel while it runs.

    Parameters
    ----------
    panel : told (`work`, `update`) when a computation begins and when it ends.
    """

    def __init__(self, panel, bar: qt.QProgressBar, cancelButton: qt.QPushButton) -> None:
        self._panel, self._bar, self._button = panel, bar, cancelButton
        self.isRunning = self._cancelled = False
        cancelButton.connect("clicked()", self.cancel)

    @contextmanager
    def running(self) -> Iterator[None]:
        """Show bar and button while something is computed.

        Raises
        ------
        Interrupted : something is being computed already, and has let the click through that asked for this.
        """
        if self._panel.isBusy:
            raise Interrupted(BUSY)
        self._panel.work = self
        self.isRunning, self._cancelled = True, False
        self._show()
        try:
            yield
        finally:
            self._panel.work = None
            self.isRunning = False
            self._show()

    def progress(self, share: float, text: str) -> bool:
        """Show how far the work is, let the user press Cancel; False stops the work."""
        self._bar.value = round(100 * share)
        self._bar.format = f"{text} (%p %)"
        slicer.app.processEvents()
        return not self._cancelled

    def cancel(self) -> None:
        """Stop the work at its next step."""
        self._cancelled = True

    def _show(self) -> None:
        for widget in (self._bar, self._button):
            widget.setVisible(self.isRunning)
        self._panel.update()


def showMessage(label: qt.QLabel, text: str) -> None:
    """Show a message in the panel; an empty one takes no room."""
    label.text = text
    label.setVisible(bool(text))


@contextmanager
def errorsShownIn(label: qt.QLabel, failure: str) -> Iterator[None]:
    """Show what goes wrong in the ``with`` block where the user is looking.

    What the library refuses is an answer, not an accident: its message says what to do and stands in the panel.
    Anything else is a fault of the program and shown, with its details, by Slicer.

    Parameters
    ----------
    label : where messages of the library go.
    failure : what did not work, for faults of the program.
    """
    showMessage(label, "")
    with slicer.util.tryWithErrorDisplay(failure):
        try:
            yield
        except Interrupted as error:
            showMessage(label, str(error))
        except Cancelled:
            showMessage(label, _("Cancelled; nothing was changed."))
        except LAFlatteningError as error:
            showMessage(label, str(error))


def fillTable(widget: qt.QTableWidget, tableNode) -> None:
    """Show a table node (None: nothing) as it is, column names included."""
    table = tableNode.GetTable() if tableNode else None
    columns = table.GetNumberOfColumns() if table else 0
    rows = table.GetNumberOfRows() if table else 0
    widget.setColumnCount(columns)
    widget.setRowCount(rows)
    widget.setHorizontalHeaderLabels([table.GetColumnName(column) for column in range(columns)])
    for row in range(rows):
        for column in range(columns):
            widget.setItem(row, column, qt.QTableWidgetItem(_cellText(table.GetValue(row, column))))
    widget.resizeColumnsToContents()


def fitHeight(widget: qt.QTableWidget, rows: int | None = None) -> None:
    """Make a table as high as its rows (at most so many): one that scrolls in a panel that scrolls is hard to use."""
    shown = widget.rowCount if rows is None else min(rows, widget.rowCount)
    height = widget.horizontalHeader().height + 2 * widget.frameWidth
    height += sum(widget.rowHeight(row) for row in range(shown))
    if widget.horizontalHeader().length() > widget.viewport().width:
        height += widget.style().pixelMetric(qt.QStyle.PM_ScrollBarExtent)
    widget.setFixedHeight(height)


def _cellText(value) -> str:
    if value.IsDouble() or value.IsFloat():
        return f"{value.ToDouble():.4g}"
    return value.ToString()
