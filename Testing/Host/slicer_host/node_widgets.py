"""Widgets that know the scene: the panel's own frame, the node selector and the slider with units."""

from __future__ import annotations

import slicer
import vtk
from PySide6 import QtCore, QtWidgets
from PySide6.QtCore import Property, Signal

from .ctk_widgets import ctkSliderWidget
from .standin import Observations, stored


class qMRMLWidget(QtWidgets.QWidget):
    """A widget that has a scene and tells the widgets in it."""

    mrmlSceneChanged = Signal(object)
    SIGNALS = {"mrmlSceneChanged(vtkMRMLScene*)": "mrmlSceneChanged"}  # noqa: RUF012

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self._scene = None

    def setMRMLScene(self, scene) -> None:
        """Set the scene."""
        if scene is not self._scene:
            self._scene = scene
            self.mrmlSceneChanged.emit(scene)

    def mrmlScene(self):
        """The scene."""
        return self._scene


class qSlicerWidget(qMRMLWidget):
    """A widget that has a scene."""


class qSlicerScriptedLoadableModuleWidget(qMRMLWidget):
    """The frame of a scripted module's panel."""

    def __init__(self, module):
        super().__init__()
        self._module, self._entered, self._python = module, False, None

    isEntered = Property(bool, lambda self: self._entered)

    def self(self):
        """The module's widget object (Python)."""
        return self._python

    def make(self) -> None:
        """Make the module's widget object in this frame and set it up (the host calls this)."""
        self._python = self._module.new_widget(self)
        self._python.setup()

    def reload(self) -> None:
        """Make the module's widget object anew, from the class as it is now."""
        entered = self._entered
        self.set_entered(False)
        self.make()
        self.set_entered(entered)

    def set_entered(self, entered: bool) -> None:
        """Show (True) or leave the module (the host calls this)."""
        if entered == self._entered:
            return
        self._entered = entered
        hook = getattr(self._python, "enter" if entered else "exit", None)
        if hook is not None:
            hook()


class qMRMLNodeComboBox(QtWidgets.QWidget):
    """Selects a node of the scene. When it selects by itself was measured on the real widget."""

    currentNodeChanged, currentNodeChangedBool, currentNodeIDChanged = Signal(object), Signal(bool), Signal(str)
    nodeAddedByUser, nodeActivated, mrmlSceneChanged = Signal(object), Signal(object), Signal(object)
    SIGNALS = {  # noqa: RUF012
        "currentNodeChanged(vtkMRMLNode*)": "currentNodeChanged",
        "currentNodeChanged(bool)": "currentNodeChangedBool",
        "currentNodeIDChanged(QString)": "currentNodeIDChanged",
        "nodeAddedByUser(vtkMRMLNode*)": "nodeAddedByUser",
        "nodeActivated(vtkMRMLNode*)": "nodeActivated",
        "mrmlSceneChanged(vtkMRMLScene*)": "mrmlSceneChanged",
    }

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self._scene, self._on_scene, self._on_names = None, Observations(self), Observations(self)
        self._attributes: list[tuple[str, str, object]] = []
        # For each line of the list what it stands for: a node's id, "" for none, or an action.
        self._lines: list[str] = []
        self._current, self._count = "", 0
        layout = QtWidgets.QHBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        self._box = QtWidgets.QComboBox()
        self._box.setSizeAdjustPolicy(QtWidgets.QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        layout.addWidget(self._box)
        self._box.activated.connect(self._activated)
        self._fill()

    def _refill(self) -> None:
        self._fill()

    nodeTypes = stored("QStringList", "nodeTypes", [], changed=_refill)
    noneEnabled = stored(bool, "noneEnabled", False, changed=_refill)
    addEnabled = stored(bool, "addEnabled", True, changed=_refill)
    removeEnabled = stored(bool, "removeEnabled", True, changed=_refill)
    renameEnabled = stored(bool, "renameEnabled", False, changed=_refill)
    editEnabled = stored(bool, "editEnabled", False)
    showHidden = stored(bool, "showHidden", False, changed=_refill)
    showChildNodeTypes = stored(bool, "showChildNodeTypes", True, changed=_refill)
    hideChildNodeTypes = stored("QStringList", "hideChildNodeTypes", [], changed=_refill)
    selectNodeUponCreation = stored(bool, "selectNodeUponCreation", True)
    noneDisplay = stored(str, "noneDisplay", "None", changed=_refill)
    baseName = stored(str, "baseName", "")
    interactionNodeSingletonTag = stored(str, "interactionNodeSingletonTag", "")

    def _nodes(self) -> list:
        found = []
        for kind in self.nodeTypes if self._scene is not None else ():
            for node in slicer.util.getNodesByClass(kind, self._scene):
                exact = node.GetClassName() == kind
                hidden = node.GetHideFromEditors() and not self.showHidden
                left_out = node.GetClassName() in self.hideChildNodeTypes and not exact
                wanted = all(
                    node.GetAttribute(name) is not None if value is None else node.GetAttribute(name) == value
                    for owner, name, value in self._attributes
                    if owner == kind
                )
                if wanted and not hidden and not left_out and (exact or self.showChildNodeTypes) and node not in found:
                    found.append(node)
        return found

    def _kind(self) -> str:
        kind = (list(self.nodeTypes) or ["node"])[0]
        return kind.removeprefix("vtkMRML").removesuffix("Node")

    def _fill(self, *_args, scene_set: bool = False) -> None:
        nodes = self._nodes()
        entries = [(self.noneDisplay, "")] if self.noneEnabled else []
        if not nodes and not self.noneEnabled:
            entries = [(f"Select a {self._kind()}", "")]
        entries += [(node.GetName() or "", node.GetID()) for node in nodes]
        actions = [
            (f"{verb} {self._kind()}", mark)
            for enabled, verb, mark in (
                (self.addEnabled, "Create new", "+"),
                (self.renameEnabled, "Rename current", "~"),
                (self.removeEnabled, "Delete current", "-"),
            )
            if enabled and self.nodeTypes
        ]
        blocker = QtCore.QSignalBlocker(self._box)
        self._box.clear()
        for text, _line in entries + actions:
            self._box.addItem(text)
        if actions:
            self._box.insertSeparator(len(entries))
        self._lines = [line for _text, line in entries] + ([""] if actions else []) + [line for _text, line in actions]
        blocker.unblock()
        self._follow_names(nodes)
        ids = [node.GetID() for node in nodes]
        wanted = self._current if self._current in ids else ""
        # Without a line for none, the first node is taken when the scene is set, when the current node goes, and
        # when it is the first to enter a box that offers no actions.
        entered_empty = not actions and self._count == 0
        if not wanted and ids and not self.noneEnabled and (scene_set or self._current or entered_empty):
            wanted = ids[0]
        self._count = len(nodes)
        self._select(wanted)

    def _follow_names(self, nodes: list) -> None:
        self._on_names.clear()
        for node in nodes:
            self._on_names.add(node, vtk.vtkCommand.ModifiedEvent, self._renamed)

    def _renamed(self, node, _event) -> None:
        if node.GetID() in self._lines:
            index = self._lines.index(node.GetID())
            if self._box.itemText(index) != node.GetName():
                self._box.setItemText(index, node.GetName() or "")

    def _select(self, node_id: str) -> None:
        if node_id in self._lines:
            self._box.setCurrentIndex(self._lines.index(node_id))
        else:
            self._box.setCurrentIndex(-1)
        if node_id != self._current:
            self._current = node_id
            self.currentNodeChanged.emit(self.currentNode())
            self.currentNodeChangedBool.emit(bool(node_id))
            self.currentNodeIDChanged.emit(node_id)

    def _activated(self, index: int) -> None:
        line, node = self._lines[index], self.currentNode()
        if line == "+":
            self.addNode()
        elif line == "-":
            if node is not None:
                self._scene.RemoveNode(node)
            self._fill()
        elif line == "~":
            if node is not None:
                name, agreed = QtWidgets.QInputDialog.getText(self, "Rename", "New name:", text=node.GetName())
                if agreed and name:
                    node.SetName(name)
            self._fill()
        else:
            self._select(line)
            self.nodeActivated.emit(self.currentNode())

    def addNode(self, kind: str | None = None):
        """Add a node of the first of ``nodeTypes`` (or of ``kind``) to the scene, as if by the user; returns it."""
        node = self._scene.CreateNodeByClass(kind or self.nodeTypes[0])
        node.UnRegister(None)
        node.SetName(self._scene.GenerateUniqueName(self.baseName or node.GetNodeTagName()))
        node = self._scene.AddNode(node)
        self.nodeAddedByUser.emit(node)
        if self.selectNodeUponCreation:
            self.setCurrentNode(node)
        return node

    def setMRMLScene(self, scene) -> None:
        """Set the scene whose nodes are offered."""
        if scene is self._scene:
            return
        self._on_scene.clear()
        self._scene = scene
        if scene is not None:
            for event in (scene.NodeAddedEvent, scene.NodeRemovedEvent):
                self._on_scene.add(scene, event, self._scene_changed)
            for event in (scene.EndImportEvent, scene.EndCloseEvent, scene.EndRestoreEvent, scene.EndBatchProcessEvent):
                self._on_scene.add(scene, event, self._fill)
        self.mrmlSceneChanged.emit(scene)
        self._fill(scene_set=True)

    def _scene_changed(self, *_args) -> None:
        if not self._scene.IsBatchProcessing():
            self._fill()

    def mrmlScene(self):
        """The scene."""
        return self._scene

    def currentNode(self):
        """The node selected, or None."""
        return self._scene.GetNodeByID(self._current) if self._scene is not None and self._current else None

    def setCurrentNode(self, node) -> None:
        """Select a node; None, or a node that is not offered, selects nothing."""
        self.setCurrentNodeID(node.GetID() if node is not None else "")

    def setCurrentNodeID(self, node_id: str) -> None:
        """Select a node by its id."""
        if node_id and node_id not in self._lines:
            self._fill()
        self._select(node_id if node_id and node_id in self._lines else "")

    currentNodeID = Property(str, lambda self: self._current, lambda self, value: self.setCurrentNodeID(value))

    def addAttribute(self, kind: str, name: str, value=None) -> None:
        """Offer only nodes of class ``kind`` that have an attribute (with ``value``, if it is not None)."""
        self._attributes.append((kind, name, value))
        self._fill()

    def nodeCount(self) -> int:
        """Number of nodes offered."""
        return len(self._nodes())


class qMRMLSliderWidget(ctkSliderWidget):
    """A slider that shows its value in the unit of ``quantity``. Values are in mm and are not converted here."""

    quantity = stored(str, "quantity", "", changed=lambda self: self._show_unit())
    unitAwareProperties = stored(int, "unitAwareProperties", 0xF)

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self._scene = None

    def _show_unit(self) -> None:
        if self.quantity == "length":
            self.suffix = "mm"

    def setMRMLScene(self, scene) -> None:
        """Set the scene."""
        self._scene = scene

    def mrmlScene(self):
        """The scene."""
        return self._scene
