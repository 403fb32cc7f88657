"""The decorator ``parameterNodeWrapper``: a class with type hints becomes a typed view of a parameter node."""

from __future__ import annotations

import typing
import weakref

import slicer
import vtk

from . import connectors, storage
from .validators import Default, Validator

SlicerParameterNamePropertyName = "SlicerParameterName"


class _Parameter:
    """What is known of one parameter from its type hint."""

    def __init__(self, name: str, hint, owner: type):
        annotated = typing.get_origin(hint) is typing.Annotated
        self.name, self.hint = name, hint
        self.kind = typing.get_args(hint)[0] if annotated else hint
        notes = list(hint.__metadata__) if annotated else []
        known = (Validator, Default, connectors.Decimals, connectors.SingleStep)
        strange = [note for note in notes if not isinstance(note, known)]
        if strange:
            raise TypeError(
                f"{owner.__name__}.{name}: the host's parameterNodeWrapper knows no annotation {strange[0]!r}"
            )
        self.storage = storage.create(self.kind, [note for note in notes if isinstance(note, Validator)])
        defaults = [note for note in notes if isinstance(note, Default)]
        if name in vars(owner):
            self.default = Default(vars(owner)[name])
        else:
            self.default = defaults[0] if defaults else Default(self.storage.default)

    def validate(self, value) -> None:
        """Raise the error of the first validator that refuses ``value``."""
        for validator in self.storage.validators:
            validator.validate(value)

    def put_default(self, node, name: str) -> None:
        """Give ``node`` the default if it has no value."""
        if not self.storage.is_in(node, name):
            value = self.default.value
            self.validate(value)
            self.storage.write(node, name, value)


class _Held:
    """The value of a parameter in a node, read when it is made and at each ModifiedEvent of the node, as in Slicer.

    Somebody who is told of a change sees the new value if he began to observe later; what changes in the node without
    an event is not seen.
    """

    def __init__(self, parameter: _Parameter, node, name: str):
        self._parameter, self._node, self._name = parameter, node, name
        self._writing = False
        self.value = self._read()
        # A weak reference, so that the observer does not keep the wrapper alive.
        me = weakref.ref(self)

        def changed(*_args):
            held = me()
            if held is not None and not held._writing:
                held.value = held._read()

        tag = node.AddObserver(vtk.vtkCommand.ModifiedEvent, changed)
        weakref.finalize(self, node.RemoveObserver, tag)

    def write(self, value) -> None:
        self._parameter.validate(value)
        self._writing = True
        try:
            with slicer.util.NodeModify(self._node):
                self._parameter.storage.write(self._node, self._name, value)
                # Before anybody is told.
                self.value = self._read()
        finally:
            self._writing = False

    def _read(self):
        # Closing the scene empties the node, which is a singleton: the default comes back.
        self._parameter.put_default(self._node, self._name)
        return self._parameter.storage.read(self._node, self._name)


def _property(parameter: _Parameter) -> property:
    return property(
        lambda self: self.getValue(parameter.name),
        lambda self, value: self.setValue(parameter.name, value),
    )


class _Wrapper:
    """What the decorated class can do. Names are Slicer's."""

    allParameters: typing.ClassVar[dict[str, _Parameter]] = {}

    def __init__(self, parameterNode, prefix: str | None = None):
        self.parameterNode = parameterNode
        self._connected: dict[int, tuple[dict[str, connectors.GuiConnector], int]] = {}
        self._next_tag = 0
        self._updating = False
        self._held: dict[str, _Held] = {}
        for name, parameter in self.allParameters.items():
            self._held[name] = _Held(parameter, parameterNode, (prefix or "") + name)

    def _parameter(self, name: str) -> _Parameter:
        if name not in self.allParameters:
            raise ValueError(f"Cannot find a param with the given name: {name} (found {', '.join(self.allParameters)})")
        return self.allParameters[name]

    def getValue(self, name: str):
        """The value of a parameter."""
        self._parameter(name)
        return self._held[name].value

    def setValue(self, name: str, value) -> None:
        """Set a parameter; an error of its validators leaves it as it was."""
        self._parameter(name)
        self._held[name].write(value)

    def default(self, name: str) -> Default:
        """The default of a parameter, in its attribute ``value``."""
        return self._parameter(name).default

    @classmethod
    def dataType(cls, name: str):
        """The type hint of a parameter."""
        return cls.allParameters[name].hint

    def isCached(self, name: str) -> bool:
        """Whether a parameter is read from the node only when the node has changed: always."""
        return self._parameter(name) is not None

    def connectGui(self, gui) -> int:
        """Connect the attributes of ``gui``, or widgets below a widget, that have the property SlicerParameterName.

        Each widget is set to the value of its parameter, and from then on both follow each other. Returns a tag for
        disconnectGui.
        """
        if getattr(gui, "isWidgetType", lambda: False)():
            import qt

            widgets = gui.findChildren(qt.QWidget)
        else:
            widgets = vars(gui).values()
        named = ((widget.property(SlicerParameterNamePropertyName), widget) for widget in widgets)
        return self.connectParametersToGui({name: widget for name, widget in named if name})

    def connectParametersToGui(self, mapping: dict) -> int:
        """Like connectGui, for a dict of parameter name to widget (or connector)."""
        made = {}
        for name, widget in mapping.items():
            parameter = self._parameter(name)
            is_connector = isinstance(widget, connectors.GuiConnector)
            made[name] = widget if is_connector else connectors.createGuiConnector(widget, parameter.hint)
        for name, connector in made.items():
            connector.write(self.getValue(name))
            connector.onChanged(self._gui_changed(name, connector))
        observer = self.AddObserver(vtk.vtkCommand.ModifiedEvent, self._update_gui)
        tag = self._next_tag
        self._next_tag += 1
        self._connected[tag] = (made, observer)
        return tag

    def disconnectGui(self, tag: int | None) -> None:
        """Undo the connectGui that returned ``tag``."""
        made, observer = self._connected.pop(tag, ({}, None))
        for connector in made.values():
            connector.onChanged(None)
        if observer is not None:
            self.RemoveObserver(observer)

    def _gui_changed(self, name: str, connector):
        def changed():
            if not self._updating:
                self.setValue(name, connector.read())

        return changed

    def _update_gui(self, *_args) -> None:
        if self._updating:
            return
        self._updating = True
        try:
            with slicer.util.NodeModify(self):
                for made, _observer in list(self._connected.values()):
                    for name, connector in made.items():
                        connector.write(self.getValue(name))
        finally:
            self._updating = False

    def StartModify(self):
        """Hold back the node's ModifiedEvent."""
        return self.parameterNode.StartModify()

    def EndModify(self, wasModified):
        """Send what was held back."""
        return self.parameterNode.EndModify(wasModified)

    def AddObserver(self, event, callback, priority: float = 0.0) -> int:
        """Observe the node."""
        return self.parameterNode.AddObserver(event, callback, priority)

    def RemoveObserver(self, tag: int) -> None:
        """Observe it no longer."""
        self.parameterNode.RemoveObserver(tag)

    def Modified(self) -> None:
        """Say that the node has changed."""
        self.parameterNode.Modified()


def parameterNodeWrapper(classtype: type | None = None):
    """Make a class with type hints a typed view of a vtkMRMLScriptedModuleNode, given to its constructor."""
    if classtype is None:
        return parameterNodeWrapper
    hints = typing.get_type_hints(classtype, include_extras=True)
    parameters = {name: _Parameter(name, hint, classtype) for name, hint in hints.items()}
    taken = [name for name in (*parameters, *vars(classtype)) if name in _RESERVED]
    if taken:
        raise ValueError(f"Cannot use reserved name '{taken[0]}' in a parameterNodeWrapper")
    # The class stays the one that was decorated, with the wrapper's methods added to it.
    for name, value in vars(_Wrapper).items():
        if name == "__init__" or not name.startswith("__"):
            setattr(classtype, name, value)
    classtype.allParameters = parameters
    for parameter in parameters.values():
        setattr(classtype, parameter.name, _property(parameter))
    return classtype


_RESERVED = frozenset(name for name in vars(_Wrapper) if not name.startswith("_"))


def isParameterNodeWrapper(classOrObject) -> bool:
    """Whether a class, or the class of an object, is a parameter node wrapper."""
    owner = classOrObject if isinstance(classOrObject, type) else type(classOrObject)
    return "allParameters" in vars(owner)
