"""A main window with a module's panel, the views of the layout and a menu for files."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path

import SampleData
import slicer
from PySide6 import QtCore, QtGui, QtWidgets
from PySide6.QtCore import Qt

from . import loading
from .view_widget import ViewWidget

_OPEN = "Scenes, models, markups (*.mrb *.mrml *.vtp *.vtk *.stl *.ply *.obj *.json *.fcsv *.nrrd *.gz);;All files (*)"
_SAVE = "Scene with its data (*.mrb);;Scene without its data (*.mrml)"
_PANEL_WIDTH = 460
# Views are drawn at most this often (ms), as the display does not show more.
_FRAME = 16


class Window(QtWidgets.QMainWindow):
    """The window. ``slicer.util.mainWindow()`` finds it."""

    def __init__(self, module):
        super().__init__()
        self._views: dict[str, ViewWidget] = {}
        self._arranged = None
        self.setObjectName("qSlicerMainWindow")
        self.setWindowTitle(module.title)
        self.setWindowIcon(module.icon)
        self._splitter = QtWidgets.QSplitter()
        self.setCentralWidget(self._splitter)
        scroll = QtWidgets.QScrollArea()
        scroll.setWidgetResizable(True)
        scroll.setMinimumWidth(_PANEL_WIDTH)
        scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        panel = module.widgetRepresentation()
        panel.layout().addStretch(1)
        scroll.setWidget(panel)
        self._splitter.addWidget(scroll)
        self._area = QtWidgets.QWidget()
        QtWidgets.QVBoxLayout(self._area).setContentsMargins(0, 0, 0, 0)
        self._splitter.addWidget(self._area)
        self._splitter.setStretchFactor(1, 1)
        self._add_menus()
        self.statusBar()
        self.resize(1440, 860)
        loading.enter(module)

        self._arrange()
        self._timer = QtCore.QTimer(self)
        self._timer.timeout.connect(self._frame)
        self._timer.start(_FRAME)

    def _frame(self) -> None:
        self._arrange()
        slicer.app.layoutManager().render_pending()

    # ---- views ----

    def _arrange(self) -> None:
        """Put the views of the layout where its description says."""
        manager = slicer.app.layoutManager()
        node = manager.layoutLogic().GetLayoutNode()
        wanted = manager.threeDViewCount, node.GetCurrentLayoutDescription()
        # While a scene is closed there is no description for a moment.
        if wanted == self._arranged or not wanted[1]:
            return
        self._arranged = wanted
        # The views are kept, what held them is not.
        for view in self._views.values():
            view.setParent(None)
        for child in self._area.findChildren(QtWidgets.QWidget, options=Qt.FindChildOption.FindDirectChildrenOnly):
            child.setParent(None)
            child.deleteLater()
        shown = self._made(ElementTree.fromstring(wanted[1]))
        if shown is not None:
            self._area.layout().addWidget(shown)
            shown.show()

    def _made(self, element) -> QtWidgets.QWidget | None:
        """The widget for a ``layout`` or ``view`` of a layout's description; None if there is nothing to show in it."""
        if element.tag == "view":
            return self._view(element.get("singletontag"))
        parts = [self._made(part) for item in element.findall("item") for part in item]
        parts = [part for part in parts if part is not None]
        if len(parts) < 2:
            return parts[0] if parts else None
        upright = element.get("type") == "vertical"
        splitter = QtWidgets.QSplitter(Qt.Orientation.Vertical if upright else Qt.Orientation.Horizontal)
        for index, part in enumerate(parts):
            splitter.addWidget(part)
            part.show()
            splitter.setStretchFactor(index, 1)
        splitter.setSizes([1000] * len(parts))
        return splitter

    def _view(self, name: str) -> ViewWidget | None:
        widget = slicer.app.layoutManager().threeDWidget(name)
        if widget is None:
            return None
        if name not in self._views:
            self._views[name] = ViewWidget(widget.threeDView())
        return self._views[name]

    # ---- files ----

    def _add_menus(self) -> None:
        files = self.menuBar().addMenu("&File")
        for text, keys, action in (
            ("&Open…", QtGui.QKeySequence.StandardKey.Open, lambda: self._ask(self._ask_open)),
            ("&Save scene…", QtGui.QKeySequence.StandardKey.Save, lambda: self._ask(self._ask_save)),
            ("&Close scene", QtGui.QKeySequence.StandardKey.Close, lambda: slicer.mrmlScene.Clear(0)),
            ("&Quit", QtGui.QKeySequence.StandardKey.Quit, self.close),
        ):
            entry = files.addAction(text)
            entry.setShortcut(QtGui.QKeySequence(keys))
            entry.triggered.connect(lambda *_checked, action=action: action())
        samples = self.menuBar().addMenu("Sample &data")
        for category, sources in SampleData.SampleDataLogic.sampleDataSourcesByCategory().items():
            for source in sources:
                entry = samples.addAction(f"{category}: {source.sampleName}")
                entry.triggered.connect(
                    lambda *_checked, source=source: self._ask(lambda: source.customDownloader(source))
                )

    def _ask(self, action: Callable) -> None:
        """Do what a menu asks for; an error goes into a message box."""
        try:
            action()
        except Exception as error:
            slicer.util.errorDisplay(str(error))

    def _ask_open(self) -> None:
        for name in QtWidgets.QFileDialog.getOpenFileNames(self, "Open", "", _OPEN)[0]:
            self.load(name)

    def _ask_save(self) -> None:
        name = QtWidgets.QFileDialog.getSaveFileName(self, "Save scene", "scene.mrb", _SAVE)[0]
        if name:
            self.save(name)

    def load(self, name: str | Path) -> None:
        """Load a scene in place of the present one, or add a file to it. Raises RuntimeError if it cannot be read."""
        if slicer.app.coreIOManager().fileType(str(name)) == "SceneFile":
            slicer.util.loadScene(str(name), {"clear": True})
        else:
            slicer.util.loadNodeFromFile(str(name), properties={})
            slicer.util.resetThreeDViews()

    def save(self, name: str | Path) -> None:
        """Save the scene. Raises RuntimeError if it cannot be written."""
        if not slicer.util.saveScene(str(name), {}):
            raise RuntimeError(
                f"Expected to save the scene as {name}, but it could not be written: choose another folder."
            )

    def closeEvent(self, event) -> None:
        """The module cleans up before the window goes."""
        self._timer.stop()
        slicer.app.moduleManager().unload_all()
        super().closeEvent(event)
