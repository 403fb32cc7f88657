"""The modules ``qt`` and ``ctk``, and the widget classes that Slicer puts into ``slicer``."""

from __future__ import annotations

import sys
import types

import slicer
from PySide6 import QtCore, QtGui, QtTest, QtWidgets

from . import (
    ctk_widgets,
    file_dialogs,
    markups_widgets,
    message_box,
    node_widgets,
    path_widgets,
    pythonqt,
    table_widgets,
    ui_loader,
)

_SOURCES = (ctk_widgets, path_widgets, message_box, node_widgets, markups_widgets, table_widgets)


def install() -> None:
    """Make the QApplication, give PySide6 PythonQt's conventions and publish the modules and classes."""
    application = QtWidgets.QApplication.instance() or QtWidgets.QApplication(["LAFlattening"])
    application.setStyle("fusion")
    QtCore.QCoreApplication.setOrganizationName("LAFlattening")
    QtCore.QCoreApplication.setApplicationName("LAFlatteningPanel")
    QtCore.QSettings.setDefaultFormat(QtCore.QSettings.Format.IniFormat)
    QtCore.QSettings.setPath(
        QtCore.QSettings.Format.IniFormat, QtCore.QSettings.Scope.UserScope, slicer.app.temporaryPath
    )

    for cls in pythonqt.classes_to_adopt():
        pythonqt.adopt(cls)

    qt, ctk = types.ModuleType("qt"), types.ModuleType("ctk")
    for module in (QtCore, QtGui, QtWidgets):
        for name in dir(module):
            if name.startswith("Q"):
                setattr(qt, name, getattr(module, name))
    qt.QTest = QtTest.QTest
    qt.QFileDialog = file_dialogs.QFileDialog
    qt.QUiLoader = ui_loader.QUiLoader
    for cls in (QtWidgets.QDialog, QtWidgets.QMenu, QtWidgets.QApplication):
        cls.exec_ = cls.exec
    for cls in stand_ins():
        setattr(ctk if cls.__name__.startswith("ctk") else slicer, cls.__name__, cls)
    sys.modules["qt"], sys.modules["ctk"] = qt, ctk
    slicer.app._keep.append(application)


def stand_ins() -> list[type]:
    """The widget classes that stand in for CTK's and Slicer's."""
    return [
        cls
        for module in _SOURCES
        for name, cls in vars(module).items()
        if isinstance(cls, type) and cls.__module__ == module.__name__ and name.startswith(("ctk", "q"))
    ]
