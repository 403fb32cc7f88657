"""Slicer's widgets for placing and listing markups."""

from __future__ import annotations

import slicer
from PySide6 import QtWidgets
from PySide6.QtCore import Property, Signal

from .node_widgets import qMRMLNodeComboBox
from .standin import Observations, stored


class qSlicerMarkupsPlaceWidget(QtWidgets.QWidget):
    """A button that starts placing points of the current node with the mouse, and one that deletes them."""

    HideAllMenuOptions, ShowPlaceMultipleMarkupsOption = 0, 1
    UnlimitedPlaceMultipleMarkups, ForcePlaceSingleMarkup, ForcePlaceMultipleMarkups = 2, 3, 4
    activeMarkupsPlaceModeChanged, activeMarkupsFiducialPlaceModeChanged = Signal(bool), Signal(bool)

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self._scene, self._node, self._interaction = None, None, None
        self._on_interaction = Observations(self)
        layout = QtWidgets.QHBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        self._place, self._delete = QtWidgets.QToolButton(), QtWidgets.QToolButton()
        self._place.setText("Place")
        self._place.setCheckable(True)
        self._delete.setText("Delete")
        layout.addWidget(self._place)
        layout.addWidget(self._delete)
        self._place.clicked.connect(self.setPlaceModeEnabled)
        self._delete.clicked.connect(lambda *_checked: self.deleteLastPoint())

    placeMultipleMarkups = stored(int, "placeMultipleMarkups", 1)
    deleteAllControlPointsOptionVisible = stored(bool, "deleteAllControlPointsOptionVisible", True)
    placeModePersistency = stored(bool, "placeModePersistency", False)
    buttonsVisible = Property(
        bool, lambda self: not self._place.isHidden(), lambda self, shown: self._show_buttons(shown)
    )

    def _show_buttons(self, shown: bool) -> None:
        self._place.setVisible(shown)
        self._delete.setVisible(shown)

    def setMRMLScene(self, scene) -> None:
        """Set the scene."""
        self._on_interaction.clear()
        self._scene = scene
        self._interaction = scene.GetNodeByID("vtkMRMLInteractionNodeSingleton") if scene is not None else None
        if self._interaction is not None:
            self._on_interaction.add(self._interaction, self._interaction.InteractionModeChangedEvent, self._follow)

    def mrmlScene(self):
        """The scene."""
        return self._scene

    def _follow(self, *_args) -> None:
        if self._place.checked != self._placing():
            self._place.checked = self._placing()
            self.activeMarkupsPlaceModeChanged.emit(self._placing())
            self.activeMarkupsFiducialPlaceModeChanged.emit(self._placing())

    def _placing(self) -> bool:
        if self._interaction is None or self._node is None:
            return False
        node = self._interaction
        active = slicer.modules.markups.logic().GetActiveListID()
        return node.GetCurrentInteractionMode() == node.Place and active == self._node.GetID()

    def setCurrentNode(self, node) -> None:
        """Set the node whose points are placed."""
        self._node = node
        self._follow()

    def currentNode(self):
        """The node whose points are placed."""
        return self._node

    def placeButton(self):
        """The button that starts placing."""
        return self._place

    def deleteButton(self):
        """The button that deletes."""
        return self._delete

    def setPlaceModeEnabled(self, placing: bool) -> None:
        """Start (True) or end placing."""
        if self._interaction is None or self._node is None:
            self._place.checked = False
            return
        node = self._interaction
        if placing:
            slicer.modules.markups.logic().SetActiveList(self._node)
            several = self.placeMultipleMarkups in (self.UnlimitedPlaceMultipleMarkups, self.ForcePlaceMultipleMarkups)
            node.SetPlaceModePersistence(int(several or self.placeModePersistency))
            node.SetCurrentInteractionMode(node.Place)
        else:
            node.SetCurrentInteractionMode(node.ViewTransform)
        self._follow()

    placeModeEnabled = Property(bool, _placing, setPlaceModeEnabled)

    def deleteLastPoint(self) -> None:
        """Delete the last point."""
        if self._node is not None and self._node.GetNumberOfControlPoints():
            self._node.RemoveNthControlPoint(self._node.GetNumberOfControlPoints() - 1)

    def deleteAllPoints(self) -> None:
        """Delete all points."""
        if self._node is not None:
            self._node.RemoveAllControlPoints()


class qSlicerSimpleMarkupsWidget(QtWidgets.QWidget):
    """A node selector, the place widget and a table of the node's points."""

    markupsNodeChanged, updateFinished = Signal(), Signal()
    currentMarkupsControlPointSelectionChanged = Signal(int)

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self._on_node = Observations(self)
        self._selector, self._placer = qMRMLNodeComboBox(), qSlicerMarkupsPlaceWidget()
        self._selector.nodeTypes = ["vtkMRMLMarkupsFiducialNode"]
        self._selector.noneEnabled = True
        self._selector.renameEnabled = True
        self._table = QtWidgets.QTableWidget(0, 4)
        self._table.setHorizontalHeaderLabels(["Label", "R", "A", "S"])
        self._table.setEditTriggers(QtWidgets.QAbstractItemView.EditTrigger.NoEditTriggers)
        row = QtWidgets.QHBoxLayout()
        row.addWidget(self._selector)
        row.addWidget(self._placer)
        layout = QtWidgets.QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addLayout(row)
        layout.addWidget(self._table)
        self._selector.currentNodeChanged.connect(self._select)
        self._table.currentCellChanged.connect(
            lambda row, *_rest: self.currentMarkupsControlPointSelectionChanged.emit(row)
        )

    nodeSelectorVisible = Property(
        bool, lambda self: not self._selector.isHidden(), lambda self, shown: self._selector.setVisible(shown)
    )

    def _select(self, node) -> None:
        self._on_node.clear()
        if node is not None:
            for event in (
                node.PointModifiedEvent,
                node.PointAddedEvent,
                node.PointRemovedEvent,
                node.PointPositionDefinedEvent,
            ):
                self._on_node.add(node, event, self._fill)
        self._placer.setCurrentNode(node)
        self._fill()
        self.markupsNodeChanged.emit()

    def _fill(self, *_args) -> None:
        node = self.currentNode()
        self._table.setRowCount(node.GetNumberOfControlPoints() if node is not None else 0)
        for row in range(self._table.rowCount):
            position = node.GetNthControlPointPosition(row)
            texts = [node.GetNthControlPointLabel(row), *(f"{value:.2f}" for value in position)]
            for column, text in enumerate(texts):
                self._table.setItem(row, column, QtWidgets.QTableWidgetItem(text))
        self.updateFinished.emit()

    def setMRMLScene(self, scene) -> None:
        """Set the scene."""
        self._placer.setMRMLScene(scene)
        self._selector.setMRMLScene(scene)

    def mrmlScene(self):
        """The scene."""
        return self._selector.mrmlScene()

    def currentNode(self):
        """The node shown."""
        return self._selector.currentNode()

    def setCurrentNode(self, node) -> None:
        """Show a node."""
        self._selector.setCurrentNode(node)

    def markupsSelectorComboBox(self):
        """The node selector."""
        return self._selector

    def markupsPlaceWidget(self):
        """The place widget."""
        return self._placer

    def tableWidget(self):
        """The table."""
        return self._table
