"""The application without its windows: scene, logics, ``slicer.app`` and ``slicer.modules``."""

from __future__ import annotations

import atexit
import shutil
import sys
import tempfile
import types
from collections.abc import Callable
from pathlib import Path

import slicer
import vtk

from . import subject_hierarchy
from .files import IOManager

# Module name -> class of its logic in slicer-core.
_LOGICS = {
    "Colors": "vtkMRMLColorLogic",
    "Models": "vtkSlicerModelsLogic",
    "Markups": "vtkSlicerMarkupsLogic",
    "Volumes": "vtkSlicerVolumesLogic",
    "Tables": "vtkSlicerTablesLogic",
    "Plots": "vtkSlicerPlotsLogic",
    "Texts": "vtkSlicerTextsLogic",
    "Transforms": "vtkSlicerTransformLogic",
    "SubjectHierarchy": "vtkSlicerSubjectHierarchyModuleLogic",
    "Data": "vtkSlicerDataModuleLogic",
    "Cameras": "vtkSlicerCamerasModuleLogic",
    "Units": "vtkSlicerUnitsLogic",
    "Segmentations": "vtkSlicerSegmentationsModuleLogic",
}


class Module:
    """One entry of ``slicer.modules``: a module that is a logic and nothing else."""

    __slots__ = ("_logic", "name", "path", "title")

    def __init__(self, name: str, logic: Callable, path: str = ""):
        self.name, self._logic, self.path, self.title = name, logic, path, name

    def logic(self):
        """The module's logic."""
        return self._logic()


class ModuleManager:
    """``slicer.app.moduleManager()``: the modules by name."""

    __slots__ = ("_modules", "_slots")

    def __init__(self):
        self._modules: dict[str, object] = {}
        self._slots: list[Callable] = []

    def add(self, name: str, module) -> None:
        """Add a module; it becomes ``slicer.modules.<name in lower case>``."""
        self._modules[name] = module
        setattr(slicer.modules, name.lower(), module)

    def module(self, name: str):
        """The module, or None."""
        return self._modules.get(name)

    def modulesNames(self) -> list[str]:
        """The names of all modules."""
        return list(self._modules)

    def connect(self, signal: str, slot: Callable) -> bool:
        """Call ``slot`` with the name of a module that is about to be unloaded."""
        _check_signal(signal, ("moduleAboutToBeUnloaded(QString)",), "qSlicerModuleManager")
        self._slots.append(slot)
        return True

    def disconnect(self, signal: str, slot: Callable) -> bool:
        """Undo ``connect``."""
        _check_signal(signal, ("moduleAboutToBeUnloaded(QString)",), "qSlicerModuleManager")
        self._slots = [other for other in self._slots if other != slot]
        return True

    def unload_all(self) -> None:
        """Tell every module that it is about to be unloaded, as the application does when it closes."""
        for name in self._modules:
            for slot in list(self._slots):
                slot(name)


class Application:
    """``slicer.app``: what modules and ``slicer.util`` ask of it, and nothing else."""

    _SIGNALS = ("startupCompleted()", "aboutToQuit()")
    __slots__ = ("_io", "_keep", "_layout_manager", "_logic", "_manager", "_paused", "_scene", "_slots", "_testing",
                 "applicationName", "applicationVersion", "documentationBaseUrl", "majorVersion", "minorVersion",
                 "slicerHome", "temporaryPath")  # fmt: skip

    def __init__(self, scene, logic, folder: str, testing: bool):
        self._scene, self._logic, self._testing = scene, logic, testing
        self._io, self._manager = IOManager(), ModuleManager()
        self._layout_manager, self._paused, self._keep = None, 0, []
        self._slots: dict[str, list[Callable]] = {}
        self.temporaryPath = self.slicerHome = folder
        self.applicationName = "Slicer"
        self.majorVersion, self.minorVersion = 5, 13
        self.applicationVersion = "5.13"
        self.documentationBaseUrl = "https://slicer.readthedocs.io/en/latest/"

    def mrmlScene(self):
        """The scene."""
        return self._scene

    def applicationLogic(self):
        """The vtkMRMLApplicationLogic."""
        return self._logic

    def coreIOManager(self) -> IOManager:
        """What loads and saves files."""
        return self._io

    ioManager = coreIOManager

    def moduleManager(self) -> ModuleManager:
        """The modules."""
        return self._manager

    def layoutManager(self):
        """The layout manager, or None where nothing can be drawn (as in Slicer without a main window)."""
        return self._layout_manager

    def setLayoutManager(self, manager) -> None:
        """Set the layout manager."""
        self._layout_manager = manager

    def testingEnabled(self) -> bool:
        """Whether message boxes are logged instead of shown."""
        return self._testing

    def moduleDocumentationUrl(self, name: str) -> str:
        """Address of a module's page in Slicer's documentation."""
        return f"{self.documentationBaseUrl}user_guide/modules/{name.lower()}.html"

    def pauseRender(self) -> None:
        """Draw nothing until resumeRender is called as often."""
        self._paused += 1

    def resumeRender(self) -> None:
        """Undo one pauseRender."""
        self._paused = max(0, self._paused - 1)
        if not self._paused and self._layout_manager is not None:
            self._layout_manager.render_pending()

    def setRenderPaused(self, paused: bool) -> None:
        """Pause (True) or resume (False)."""
        self.pauseRender() if paused else self.resumeRender()

    @property
    def isRenderPaused(self) -> bool:
        """Whether nothing is drawn now."""
        return self._paused > 0

    def processEvents(self, *_args) -> None:
        """Let Qt and the views do what is waiting."""
        if "PySide6.QtCore" in sys.modules:
            from PySide6.QtCore import QCoreApplication, QEvent

            QCoreApplication.processEvents()
            QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete.value)
        if self._layout_manager is not None and not self._paused:
            self._layout_manager.render_pending()

    def connect(self, signal: str, slot: Callable) -> bool:
        """Call ``slot`` when the application emits ``signal``."""
        _check_signal(signal, self._SIGNALS, "qSlicerApplication")
        self._slots.setdefault(signal, []).append(slot)
        return True

    def disconnect(self, signal: str, slot: Callable) -> bool:
        """Undo ``connect``."""
        _check_signal(signal, self._SIGNALS, "qSlicerApplication")
        self._slots[signal] = [other for other in self._slots.get(signal, []) if other != slot]
        return True

    def emit(self, signal: str) -> None:
        """Emit one of the application's signals (the host calls this, not a module)."""
        for slot in list(self._slots.get(signal, [])):
            slot()

    def topLevelWidgets(self) -> list:
        """Qt's windows."""
        from PySide6.QtWidgets import QApplication

        return QApplication.topLevelWidgets()

    def setOverrideCursor(self, cursor) -> None:
        """Show ``cursor`` everywhere."""
        from PySide6.QtWidgets import QApplication

        QApplication.setOverrideCursor(cursor)

    def restoreOverrideCursor(self) -> None:
        """Undo one setOverrideCursor."""
        from PySide6.QtWidgets import QApplication

        QApplication.restoreOverrideCursor()

    def settings(self):
        """The user's settings."""
        from PySide6.QtCore import QSettings

        return QSettings()

    userSettings = settings


def _check_signal(signal: str, known: tuple[str, ...], owner: str) -> None:
    if signal not in known:
        raise AttributeError(f"{owner} has no signal {signal!r} that the host knows (it knows {', '.join(known)})")


def create(testing: bool) -> Application:
    """Make scene, logics and ``slicer.app``, in the order in which Slicer does."""
    window = vtk.vtkOutputWindow()
    window.SetDisplayModeToAlwaysStdErr()
    vtk.vtkOutputWindow.SetInstance(window)

    folder = tempfile.mkdtemp(prefix="slicer_host_")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    scene = slicer.vtkMRMLScene()
    logic = slicer.vtkSlicerApplicationLogic()
    logic.SetTemporaryPath(folder)
    crosshair = slicer.vtkMRMLCrosshairNode()
    crosshair.SetCrosshairName("default")
    scene.AddNode(crosshair)
    logic.SetMRMLScene(scene)
    logic.SetSliceLogics(vtk.vtkCollection())
    logic.SetViewLogics(vtk.vtkCollection())
    for factory in (
        slicer.vtkMRMLThreeDViewDisplayableManagerFactory,
        slicer.vtkMRMLSliceViewDisplayableManagerFactory,
    ):
        factory.GetInstance().SetMRMLApplicationLogic(logic)
    slicer.vtkMRMLSliceNode.AddDefaultSliceOrientationPresets(scene, True)

    slicer.modules = sys.modules["slicer.modules"] = types.ModuleType("slicer.modules")
    slicer.moduleNames = sys.modules["slicer.moduleNames"] = types.ModuleType("slicer.moduleNames")
    slicer.selfTests = {}
    slicer.mrmlScene = scene
    slicer.app = app = Application(scene, logic, folder, testing)
    app._keep.extend(_remote_files(scene, logic, folder))
    for name, class_name in _LOGICS.items():
        _add_logic(app, name, getattr(slicer, class_name)(), folder)
    slicer.modules.colors.logic().AddDefaultColorNodes()
    # Slicer's own logic of colours does this; it needs files of Slicer's that are not here.
    scene.RegisterNodeClass(slicer.vtkMRMLColorLegendDisplayNode())
    app._keep.append(subject_hierarchy.follow(scene))
    return app


def add_module_stand_in(name: str, logic: Callable) -> None:
    """Add a module that consists of a logic, made when it is asked for."""
    slicer.app.moduleManager().add(name, Module(name, logic))
    setattr(slicer.moduleNames, name, name)


def _add_logic(app: Application, name: str, logic, folder: str) -> None:
    if hasattr(logic, "SetModuleShareDirectory"):
        share = Path(folder) / name
        share.mkdir()
        logic.SetModuleShareDirectory(str(share))
    logic.SetMRMLApplicationLogic(app.applicationLogic())
    logic.SetMRMLScene(app.mrmlScene())
    app.applicationLogic().SetModuleLogic(name, logic)
    add_module_stand_in(name, lambda: logic)


def _remote_files(scene, logic, folder: str) -> list:
    """What reading scene bundles needs: a cache and the manager that uses it."""
    cache = Path(folder) / "cache"
    cache.mkdir()
    remote = slicer.vtkMRMLRemoteIOLogic()
    remote.SetMRMLScene(scene)
    remote.SetMRMLApplicationLogic(logic)
    remote.GetCacheManager().SetRemoteCacheDirectory(str(cache))
    data = slicer.vtkDataIOManagerLogic()
    data.SetMRMLScene(scene)
    data.SetMRMLApplicationLogic(logic)
    data.SetAndObserveDataIOManager(remote.GetDataIOManager())
    remote.AddDataIOToScene()
    return [remote, data]


def translations() -> types.ModuleType:
    """The module ``slicer.i18n``: English stays as it is."""
    module = types.ModuleType("slicer.i18n")
    module.PUBLISHED_AS = "i18n"
    module.tr = lambda text: text
    module.translate = lambda context, text: text
    module.getContext = lambda source: Path(source).stem
    return module
