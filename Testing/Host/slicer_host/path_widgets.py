"""CTK's widgets for files and folders."""

from __future__ import annotations

from PySide6 import QtWidgets
from PySide6.QtCore import Property, Signal

from .standin import passed_on, stored

_DIRS = 0x001


class ctkPathLineEdit(QtWidgets.QWidget):
    """A line for a path, with a button that opens a file dialog."""

    Dirs, Files, Drives, Readable, Writable, Executable = _DIRS, 0x002, 0x004, 0x010, 0x020, 0x040
    currentPathChanged = Signal(str)

    def __init__(self, *arguments):
        super().__init__(*arguments)
        layout = QtWidgets.QHBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        self._line = QtWidgets.QLineEdit()
        self._button = QtWidgets.QToolButton()
        self._button.setText("…")
        self._button.clicked.connect(lambda *_checked: self.browse())
        layout.addWidget(self._line)
        layout.addWidget(self._button)
        self._line.textChanged.connect(self.currentPathChanged)

    currentPath = passed_on(str, "_line", "text")
    filters = stored(int, "filters", 0x7)
    nameFilters = stored("QStringList", "nameFilters", [])
    settingKey = stored(str, "settingKey", "")
    showBrowseButton = Property(
        bool, lambda self: not self._button.isHidden(), lambda self, shown: self._button.setVisible(shown)
    )

    def setCurrentPath(self, path: str) -> None:
        """Set the path."""
        self._line.setText(path)

    def addCurrentPathToHistory(self) -> None:
        """Remember the path for the next time: here in the settings, if the widget has a key."""
        if self.settingKey:
            from PySide6.QtCore import QSettings

            QSettings().setValue(self.settingKey, self.currentPath)

    def browse(self) -> None:
        """Ask for a path."""
        dialog = QtWidgets.QFileDialog
        if self.filters & _DIRS:
            path = dialog.getExistingDirectory(self, "", self.currentPath)
        elif self.filters & self.Writable:
            path = dialog.getSaveFileName(self, "", self.currentPath, ";;".join(self.nameFilters))[0]
        else:
            path = dialog.getOpenFileName(self, "", self.currentPath, ";;".join(self.nameFilters))[0]
        if path:
            self.currentPath = path


class ctkDirectoryButton(QtWidgets.QPushButton):
    """A button that shows a folder and asks for another."""

    directoryChanged, directorySelected = Signal(str), Signal(str)

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.clicked.connect(lambda *_checked: self.browse())

    directory = stored(
        str, "directory", "", changed=lambda self: self.setText(self.directory), notify="directoryChanged"
    )
    caption = stored(str, "caption", "")

    def browse(self) -> None:
        """Ask for a folder."""
        path = QtWidgets.QFileDialog.getExistingDirectory(self, self.caption, self.directory)
        if path:
            self.directory = path
            self.directorySelected.emit(path)
