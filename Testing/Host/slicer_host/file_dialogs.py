"""Qt's file dialog as PythonQt gives it: its answers are paths, without the filter that was chosen."""

from __future__ import annotations

from PySide6 import QtWidgets


class QFileDialog(QtWidgets.QFileDialog):
    """A dialog that asks for files."""

    @staticmethod
    def getOpenFileName(parent=None, caption: str = "", directory: str = "", filter: str = "") -> str:
        """Ask for a file to read; empty if the user cancels."""
        return QtWidgets.QFileDialog.getOpenFileName(parent, caption, directory, filter)[0]

    @staticmethod
    def getSaveFileName(parent=None, caption: str = "", directory: str = "", filter: str = "") -> str:
        """Ask for a file to write; empty if the user cancels."""
        return QtWidgets.QFileDialog.getSaveFileName(parent, caption, directory, filter)[0]
