"""Slicer's view of a table node."""

from __future__ import annotations

import vtk
from PySide6 import QtGui, QtWidgets

from .standin import Observations, stored


class qMRMLTableView(QtWidgets.QTableView):
    """Shows a vtkMRMLTableNode, not editable here."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self._scene, self._node, self._on_node = None, None, Observations(self)
        self._items = QtGui.QStandardItemModel(self)
        self.setModel(self._items)
        self.setEditTriggers(QtWidgets.QAbstractItemView.EditTrigger.NoEditTriggers)

    transposed = stored(bool, "transposed", False, changed=lambda self: self._fill())

    def setMRMLScene(self, scene) -> None:
        """Set the scene."""
        self._scene = scene

    def mrmlScene(self):
        """The scene."""
        return self._scene

    def setMRMLTableNode(self, node) -> None:
        """Show a table node, or nothing (None)."""
        self._on_node.clear()
        self._node = node
        if node is not None:
            self._on_node.add(node, vtk.vtkCommand.ModifiedEvent, self._fill)
        self._fill()

    def mrmlTableNode(self):
        """The table node shown."""
        return self._node

    def _fill(self, *_args) -> None:
        self._items.clear()
        table = self._node.GetTable() if self._node is not None else None
        if table is None:
            return
        names = [table.GetColumnName(column) or "" for column in range(table.GetNumberOfColumns())]
        rows = [
            [table.GetValue(row, column).ToString() for column in range(len(names))]
            for row in range(table.GetNumberOfRows())
        ]
        if self.transposed:
            rows, names = [list(column) for column in zip(*([names, *rows]), strict=True)], []
        if names:
            self._items.setHorizontalHeaderLabels(names)
        for row in rows:
            self._items.appendRow([QtGui.QStandardItem(text) for text in row])
