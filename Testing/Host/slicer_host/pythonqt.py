"""PythonQt's conventions on PySide6's classes.

In Slicer, Qt is wrapped by PythonQt: properties are attributes, ``connect`` takes the signal as text, slots may take
fewer arguments than the signal has, named children are attributes, and an attribute or signal that does not exist is an
error.
``adopt`` gives PySide6's classes these ways; it changes them for the whole process.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable

from PySide6 import QtCore, QtGui, QtWidgets
from PySide6.QtCore import QMetaObject, QObject

# Virtual methods, and a static method, that a property of the same name would hide.
_NOT_PROPERTIES = frozenset({"sizeHint", "minimumSizeHint", "singleShot"})
_object_getattribute = QObject.__getattribute__
_qt_connect, _qt_disconnect = QObject.connect, QObject.disconnect
_adopted: set[type] = set()


def adopt(cls: type) -> None:
    """Give one of PySide6's own classes PythonQt's conventions."""
    if cls in _adopted:
        return
    _adopted.add(cls)
    meta = cls.staticMetaObject
    for index in range(meta.propertyOffset(), meta.propertyCount()):
        name = meta.property(index).name()
        if name not in _NOT_PROPERTIES:
            setattr(cls, name, _attribute(name, getattr(cls, name, None)))
    cls.__setattr__ = _set_attribute
    # PySide6 answers ``instance.connect`` before it looks at the class, so it has to be asked for earlier.
    cls.__getattribute__ = _get_attribute
    if cls is QObject:
        cls.__getattr__ = _get_other
        cls.className = lambda self: self.metaObject().className()


def _attribute(name: str, method) -> property:
    if callable(method):
        return property(lambda self: method(self))
    return property(lambda self: self.property(name))


def _get_attribute(self, name: str):
    if name == "connect":
        return _connect.__get__(self)
    if name == "disconnect":
        return _disconnect.__get__(self)
    return _object_getattribute(self, name)


def _get_other(self, name: str):
    """An attribute that the class does not have: the object's name, a dynamic property or a named child."""
    if not name.startswith("_"):
        if name == "name":
            return self.property("objectName")
        if name in _dynamic_names(self):
            return self.property(name)
        child = self.findChild(QObject, name)
        if child is not None:
            return child
    raise AttributeError(f"{type(self).__name__} has no attribute {name!r} that the host knows")


def _dynamic_names(self) -> list[str]:
    return [bytes(name).decode() for name in self.dynamicPropertyNames()]


def _set_attribute(self, name: str, value) -> None:
    if isinstance(value, QtCore.SignalInstance):
        # PySide6 itself, which keeps the signal that was asked for.
        self.__dict__[name] = value
        return
    name = "objectName" if name == "name" else name
    meta = self.metaObject()
    index = meta.indexOfProperty(name)
    if index >= 0:
        _set_property(self, meta.property(index), value)
    elif name in _dynamic_names(self):
        self.setProperty(name, value)
    elif _accepts_attributes(type(self)) or (name.startswith("_") and type(self) not in _adopted):
        descriptor = next((vars(cls)[name] for cls in type(self).__mro__ if name in vars(cls)), None)
        if hasattr(descriptor, "__set__"):
            descriptor.__set__(self, value)
        else:
            self.__dict__[name] = value
    else:
        raise AttributeError(f"{type(self).__name__} has no property {name!r} that the host knows")


def _accepts_attributes(cls: type) -> bool:
    """Whether instances take new attributes: those of Python classes do, those of Qt's own classes do not."""
    return cls not in _adopted and not cls.__module__.startswith((__package__, "PySide6"))


def _set_property(self, prop, value) -> None:
    name = prop.name()
    if not prop.isWritable():
        raise AttributeError(f"{type(self).__name__}.{name} cannot be set")
    if prop.typeName() == "bool":
        value = bool(value)
    elif prop.typeName() == "QStringList" and isinstance(value, tuple):
        value = list(value)
    if not self.setProperty(name, value):
        setter = getattr(self, f"set{name[0].upper()}{name[1:]}", None)
        if setter is None:
            raise TypeError(f"{type(self).__name__}.{name} ({prop.typeName()}) does not take {value!r}")
        setter(value)


def _signal(self, signature: str):
    """The signal of that signature; stand-ins list signatures that PySide6 cannot express in ``SIGNALS``."""
    for cls in type(self).__mro__:
        name = cls.__dict__.get("SIGNALS", {}).get(signature)
        if name:
            return _object_getattribute(self, name)
    normal = bytes(QMetaObject.normalizedSignature(signature).data()).decode()
    if "PyObject" in normal or self.metaObject().indexOfSignal(normal) < 0:
        raise AttributeError(f"{type(self).__name__} has no signal {signature!r} that the host knows")
    return _object_getattribute(self, normal.partition("(")[0])


def _connect(self, signature: str, slot: Callable | None = None, *others) -> bool:
    """Call ``slot`` when the signal is emitted, with as many of its arguments as it takes."""
    if not isinstance(signature, str):
        # PySide6 itself, as in QTimer.singleShot.
        return _qt_connect(signature, slot, *others)
    if others or not callable(slot):
        raise TypeError(f"{type(self).__name__}.connect takes a signal as text and something that can be called")
    signal = _signal(self, signature)
    given = 0 if signature.endswith("()") else signature.count(",") + 1
    wanted = min(given, _positional_arguments(slot, given))

    adapter = _ADAPTERS[given](lambda *arguments: slot(*arguments[:wanted]))
    signal.connect(adapter)
    self.__dict__.setdefault("_connections", []).append((signature, slot, adapter))
    return True


# PySide6 gives a function as many arguments as it declares; to ``*args`` it gives none that has a default.
_ADAPTERS = (
    lambda call: lambda: call(),
    lambda call: lambda a: call(a),
    lambda call: lambda a, b: call(a, b),
    lambda call: lambda a, b, c: call(a, b, c),
    lambda call: lambda a, b, c, d: call(a, b, c, d),
)


def _disconnect(self, signature: str, slot: Callable | None = None, *others) -> bool:
    """Undo ``connect`` (without ``slot``: all connections of the signal); returns whether there was any."""
    if not isinstance(signature, str):
        return _qt_disconnect(signature, slot, *others)
    signal = _signal(self, signature)
    connections = self.__dict__.get("_connections", [])
    gone = [entry for entry in connections if entry[0] == signature and (slot is None or entry[1] == slot)]
    for entry in gone:
        signal.disconnect(entry[2])
        connections.remove(entry)
    return bool(gone)


def _positional_arguments(slot: Callable, default: int) -> int:
    try:
        parameters = inspect.signature(slot).parameters.values()
    except (TypeError, ValueError):
        return default
    if any(parameter.kind is parameter.VAR_POSITIONAL for parameter in parameters):
        return default
    positional = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return sum(parameter.kind in positional for parameter in parameters)


def classes_to_adopt() -> list[type]:
    """PySide6's classes that get PythonQt's conventions, base classes first: all widgets and layouts, and a few others.

    Not all of QObject's: some (QFile) end the process when their way of finding attributes is changed.
    """
    others = (QObject, QtCore.QTimer, QtCore.QAbstractItemModel, QtGui.QStandardItemModel, QtCore.QItemSelectionModel,
              QtGui.QAction, QtGui.QActionGroup, QtGui.QShortcut, QtWidgets.QButtonGroup)  # fmt: skip
    # PySide6 makes its classes when they are first asked for, so the module's own dict would not do.
    members = [getattr(QtWidgets, name) for name in dir(QtWidgets)]
    kinds = (QtWidgets.QWidget, QtWidgets.QLayout)
    found = [cls for cls in members if isinstance(cls, type) and issubclass(cls, kinds)]
    return sorted({*others, *found}, key=lambda cls: len(cls.__mro__))
