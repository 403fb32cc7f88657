"""Loading a scripted module's file the way Slicer does, and opening its panel."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import slicer


class qSlicerScriptedLoadableModule:
    """The module as the application sees it: the ``parent`` of the module's Python object."""

    __slots__ = (
        "_frame", "_icon", "_instance", "acknowledgementText", "associatedNodeTypes", "categories", "contributors",
        "dependencies", "helpText", "hidden", "index", "name", "path", "title", "widgetRepresentationCreationEnabled",
    )  # fmt: skip

    def __init__(self, name: str, path: str):
        self.name = self.title = name
        self.path, self._frame, self._icon, self._instance = path, None, "", None
        self.categories, self.dependencies, self.contributors, self.associatedNodeTypes = [], [], [], []
        self.helpText = self.acknowledgementText = ""
        self.hidden, self.index, self.widgetRepresentationCreationEnabled = False, -1, True

    @property
    def icon(self):
        """The module's icon."""
        import qt

        return qt.QIcon(self._icon)

    @icon.setter
    def icon(self, icon) -> None:
        raise AttributeError("the host takes a module's icon from Resources/Icons/<module>.png")

    def set_icon_file(self, path: str) -> None:
        """Set the icon (the base class of modules calls this)."""
        self._icon = path

    def logic(self):
        """A logic of the module; prefer ``slicer.util.getModuleLogic``."""
        return getattr(sys.modules[self.name], f"{self.name}Logic")()

    def new_widget(self, frame):
        """Make the module's widget object in ``frame``."""
        widget = getattr(sys.modules[self.name], f"{self.name}Widget")(frame)
        setattr(slicer.modules, f"{self.name}Widget", widget)
        return widget

    def widgetRepresentation(self):
        """The module's panel, made and set up when it is first asked for."""
        if self._frame is None:
            self._frame = self.createNewWidgetRepresentation()
        return self._frame

    def createNewWidgetRepresentation(self):
        """Another panel of the module."""
        import qt

        frame = slicer.qSlicerScriptedLoadableModuleWidget(self)
        frame.setLayout(qt.QVBoxLayout())
        frame.setMRMLScene(slicer.mrmlScene)
        frame.make()
        return frame


slicer.qSlicerScriptedLoadableModule = qSlicerScriptedLoadableModule


def load_module(path: str | Path) -> qSlicerScriptedLoadableModule:
    """Load the scripted module in the file ``path``, once; afterwards ``slicer.modules.<name>`` is there.

    As in Slicer, the file's own folder is put on ``sys.path``, and the application says that its start is complete.
    """
    path = Path(path).resolve()
    name = path.stem
    known = slicer.app.moduleManager().module(name)
    if known is not None:
        return known
    if str(path.parent) not in sys.path:
        sys.path.insert(0, str(path.parent))
    spec = importlib.util.spec_from_file_location(name, path)
    python_module = importlib.util.module_from_spec(spec)
    sys.modules[name] = python_module
    spec.loader.exec_module(python_module)
    module = qSlicerScriptedLoadableModule(name, str(path))
    # Slicer makes the object before the module is in slicer.modules.
    module._instance = getattr(python_module, name)(module)
    slicer.app.moduleManager().add(name, module)
    setattr(slicer.moduleNames, name, name)
    setattr(slicer.modules, f"{name}Instance", module._instance)
    slicer.app.emit("startupCompleted()")
    return module


def enter(module: qSlicerScriptedLoadableModule) -> object:
    """Show a module's panel, as choosing it in Slicer does; returns the module's widget object."""
    frame = module.widgetRepresentation()
    frame.set_entered(True)
    return frame.self()


def leave(module: qSlicerScriptedLoadableModule) -> None:
    """Leave a module's panel for another."""
    module.widgetRepresentation().set_entered(False)
