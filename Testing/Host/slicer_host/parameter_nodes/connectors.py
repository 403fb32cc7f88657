"""Two-way connections between a parameter and a widget, by the widget's class and the parameter's type."""

from __future__ import annotations

import abc
import dataclasses
import enum
import typing
from collections.abc import Callable

from . import storage
from .validators import Choice, Maximum, Minimum, WithinRange


@dataclasses.dataclass
class Decimals:
    """Annotation: number of decimals the widget shows."""

    value: int


@dataclasses.dataclass
class SingleStep:
    """Annotation: the widget's step."""

    value: float


class GuiConnector(abc.ABC):
    """Base of all connectors; a module may derive its own and register it with parameterNodeGuiConnector."""

    def __init__(self):
        super().__init__()
        self._callback: Callable | None = None

    @staticmethod
    @abc.abstractmethod
    def canRepresent(widget, datatype) -> bool:
        """Whether this connector connects ``widget`` with a parameter of the type ``datatype``."""

    @staticmethod
    @abc.abstractmethod
    def create(widget, datatype) -> GuiConnector:
        """The connector between the two."""

    def onChanged(self, callback: Callable | None) -> None:
        """Call ``callback`` when the widget changes; None ends it."""
        if callback is None:
            if self._callback is not None:
                self._disconnect()
        elif self._callback is None:
            self._connect()
        self._callback = callback

    def changed(self, *_args) -> None:
        """The slot for the widget's signal."""
        if self._callback is not None:
            self._callback()

    @abc.abstractmethod
    def _connect(self) -> None: ...

    @abc.abstractmethod
    def _disconnect(self) -> None: ...

    @abc.abstractmethod
    def widget(self):
        """The widget."""

    @abc.abstractmethod
    def read(self):
        """The widget's value, in the parameter's type."""

    @abc.abstractmethod
    def write(self, value) -> None:
        """Set the widget."""


_registered: list[type[GuiConnector]] = []


def parameterNodeGuiConnector(classtype: type[GuiConnector] | None = None):
    """Register a connector class (decorator)."""
    if classtype is None:
        return parameterNodeGuiConnector
    if not issubclass(classtype, GuiConnector):
        raise TypeError("Must be a GuiConnector subclass")
    _registered.append(classtype)
    return classtype


def createGuiConnector(widget, datatype) -> GuiConnector:
    """The connector between a widget and a parameter of the type ``datatype``. Raises RuntimeError if there is none."""
    for candidate in (*_registered, _WidgetConnector):
        if candidate.canRepresent(widget, datatype):
            return candidate.create(widget, datatype)
    raise RuntimeError(f"Unable to create GUI connector from datatype '{datatype}' to widget type '{type(widget)}'")


def _plain(datatype):
    return typing.get_args(datatype)[0] if typing.get_origin(datatype) is typing.Annotated else datatype


def _note(datatype, kind: type):
    return next((note for note in getattr(datatype, "__metadata__", ()) if isinstance(note, kind)), None)


def _is_enum(kind) -> bool:
    return isinstance(kind, type) and issubclass(kind, enum.Enum)


class _Binding:
    """How widgets of some classes show values of some types: signal, and attributes that read and write."""

    def __init__(self, classes, types, signal: str, attribute: str, prepare: Callable | None = None):
        self.classes, self.types, self.signal, self.attribute = classes.split(), types, signal, attribute
        self.prepare = prepare or (lambda widget, datatype: None)

    def fits(self, widget, kind) -> bool:
        return type(widget).__name__ in self.classes and self.types(kind)

    def read(self, widget, kind):
        value = getattr(widget, self.attribute)
        return value if isinstance(value, kind) else kind(value)

    def write(self, widget, value) -> None:
        setattr(widget, self.attribute, value)


def _set_limits(lowest: float, highest: float) -> Callable:
    def prepare(widget, datatype) -> None:
        for note, attribute in ((Decimals, "decimals"), (SingleStep, "singleStep")):
            if _note(datatype, note) is not None:
                setattr(widget, attribute, _note(datatype, note).value)
        within = _note(datatype, WithinRange)
        least, most = _note(datatype, Minimum), _note(datatype, Maximum)
        bounded = within is not None or (least is not None and most is not None)
        if not bounded and type(widget).__name__ in ("QSlider", "ctkSliderWidget", "ctkDoubleSlider"):
            raise RuntimeError(f"Cannot connect a {type(widget).__name__} to a parameter without limits")
        widget.minimum = within.minimum if within else least.minimum if least else lowest
        widget.maximum = within.maximum if within else most.maximum if most else highest

    return prepare


def _make_checkable(widget, _datatype) -> None:
    widget.checkable = True


class _NodeBinding(_Binding):
    def read(self, widget, kind):
        return widget.currentNode()

    def write(self, widget, value) -> None:
        widget.setCurrentNode(value)


def _set_node_types(widget, datatype) -> None:
    widget.nodeTypes = [kind.__name__ for kind in storage.node_classes(_plain(datatype))]


class _ItemsBinding(_Binding):
    """A combo box with one item for each value that the parameter may have."""

    @staticmethod
    def values(datatype) -> list:
        kind = _plain(datatype)
        return list(kind) if _is_enum(kind) else list(_note(datatype, Choice).choices)

    @classmethod
    def fill(cls, widget, datatype) -> None:
        kind = _plain(datatype)
        if not _is_enum(kind) and _note(datatype, Choice) is None:
            raise RuntimeError(
                "A combo box can be connected only to an enum or to a parameter with the Choice annotation."
            )
        label = getattr(kind, "label", lambda value: value.name) if _is_enum(kind) else str
        widget.clear()
        for value in cls.values(datatype):
            widget.addItem(label(value))


class _TextBinding(_Binding):
    def read(self, widget, kind):
        return widget.toPlainText()

    def write(self, widget, value) -> None:
        widget.setPlainText(value)


class _PathBinding(_Binding):
    def write(self, widget, value) -> None:
        setattr(widget, self.attribute, str(value))


class _LabelBinding(_Binding):
    """One way, from the parameter to the label."""


def _is(*kinds) -> Callable:
    return lambda kind: kind in kinds


_INT_LIMIT = 2**31 - 1
_BINDINGS = (
    _Binding("QCheckBox ctkCheckBox", _is(bool), "stateChanged", "checked"),
    _Binding("QPushButton", _is(bool), "toggled", "checked", _make_checkable),
    _Binding("QSlider QSpinBox", _is(int), "valueChanged", "value", _set_limits(-_INT_LIMIT, _INT_LIMIT)),
    _Binding("QDoubleSpinBox ctkSliderWidget ctkDoubleSlider ctkDoubleSpinBox", _is(float), "valueChanged", "value",
             _set_limits(float("-inf"), float("inf"))),
    _ItemsBinding("QComboBox ctkComboBox", lambda kind: kind in (int, float, str, bool) or _is_enum(kind),
                  "currentIndexChanged", "currentIndex", _ItemsBinding.fill),
    _Binding("QLineEdit", _is(str), "textChanged", "text"),
    _TextBinding("QTextEdit", _is(str), "textChanged", ""),
    _LabelBinding("QLabel", _is(str), "", "text"),
    _PathBinding("ctkPathLineEdit", _is(*storage.PATHS), "currentPathChanged", "currentPath"),
    _PathBinding("ctkDirectoryButton", _is(*storage.PATHS), "directoryChanged", "directory"),
    _NodeBinding("qMRMLNodeComboBox", lambda kind: bool(storage.node_classes(kind)), "currentNodeChanged", "",
                 _set_node_types),
)  # fmt: skip


class _WidgetConnector(GuiConnector):
    """A connector for every line of the table above."""

    @staticmethod
    def canRepresent(widget, datatype) -> bool:
        return any(binding.fits(widget, _plain(datatype)) for binding in _BINDINGS)

    @staticmethod
    def create(widget, datatype) -> GuiConnector:
        return _WidgetConnector(widget, datatype)

    def __init__(self, widget, datatype):
        super().__init__()
        self._widget, self._datatype = widget, datatype
        self._binding = next(binding for binding in _BINDINGS if binding.fits(widget, _plain(datatype)))
        self._binding.prepare(widget, datatype)
        is_items = isinstance(self._binding, _ItemsBinding)
        self._items = self._binding.values(datatype) if is_items else None

    def _connect(self) -> None:
        if self._binding.signal:
            getattr(self._widget, self._binding.signal).connect(self.changed)

    def _disconnect(self) -> None:
        if self._binding.signal:
            getattr(self._widget, self._binding.signal).disconnect(self.changed)

    def widget(self):
        return self._widget

    def read(self):
        if self._items is not None:
            return self._items[self._widget.currentIndex]
        return self._binding.read(self._widget, _plain(self._datatype))

    def write(self, value) -> None:
        if self._items is not None:
            self._widget.currentIndex = self._items.index(value)
        else:
            self._binding.write(self._widget, value)
