"""How a value of each type is kept in a vtkMRMLScriptedModuleNode."""

from __future__ import annotations

import enum
import pathlib
import types
import typing

import slicer

from .validators import IsInstance, NotNone, Validator

PATHS = tuple(
    getattr(pathlib, name)
    for name in ("Path", "PosixPath", "WindowsPath", "PurePath", "PurePosixPath", "PureWindowsPath")
)


class Storage:
    """Reads and writes one parameter of a text type; the base of all others."""

    def __init__(self, kind: type, default, validators: list[Validator]):
        self.kind, self.default, self.validators = kind, default, validators

    def is_in(self, node, name: str) -> bool:
        """Whether ``node`` has a value for the parameter."""
        return bool(node.HasParameter(name))

    def read(self, node, name: str):
        """The value in ``node``."""
        return self.decode(node.GetParameter(name))

    def write(self, node, name: str, value) -> None:
        """Put a valid ``value`` into ``node``."""
        node.SetParameter(name, self.encode(value))

    def encode(self, value) -> str:
        """The text that stands for ``value``."""
        return str(value)

    def decode(self, text: str):
        """The value that ``text`` stands for."""
        return self.kind(text)


class _BoolStorage(Storage):
    def decode(self, text: str) -> bool:
        return text == "True"


class _EnumStorage(Storage):
    def encode(self, value) -> str:
        return value.name

    def decode(self, text: str):
        return self.kind[text]


class _NodeStorage(Storage):
    """A node reference whose role is the parameter's name; an empty parameter of that name says that it was set."""

    def read(self, node, name: str):
        return node.GetNodeReference(name)

    def write(self, node, name: str, value) -> None:
        node.SetParameter(name, "")
        node.SetNodeReferenceID(name, value.GetID() if value is not None else None)


class _UnionStorage(Storage):
    """A union of node classes and, if it says so, None.

    Slicer keeps each member under a name of its own, ``name.0`` and so on, and only the one that was set last. Without
    None in the union there is no way to write None, which is the default too: such a parameter cannot even be made.
    """

    def __init__(self, members: tuple[type, ...]):
        super().__init__(slicer.vtkMRMLNode, None, [])
        self._members = members

    def is_in(self, node, name: str) -> bool:
        return self._present(node, name) is not None

    def read(self, node, name: str):
        return node.GetNodeReference(self._present(node, name))

    def write(self, node, name: str, value) -> None:
        number = next((k for k, member in enumerate(self._members) if isinstance(value, member)), None)
        if number is None:
            raise TypeError(f"A union of {self._members} cannot hold {value!r} of type {type(value)}")
        for role in self._roles(name):
            node.UnsetParameter(role)
            node.RemoveNodeReferenceIDs(role)
        role = self._roles(name)[number]
        node.SetParameter(role, "True" if value is None else "")
        if value is not None:
            node.SetNodeReferenceID(role, value.GetID())

    def _present(self, node, name: str) -> str | None:
        return next((role for role in self._roles(name) if node.HasParameter(role)), None)

    def _roles(self, name: str) -> list[str]:
        return [f"{name}.{number}" for number in range(len(self._members))]


def create(kind, extra: list[Validator]) -> Storage:
    """The storage of a parameter of type ``kind`` whose annotations hold the validators ``extra``."""
    storage = _create(kind)
    storage.validators = storage.validators + extra
    return storage


def node_classes(kind) -> tuple[type, ...]:
    """The MRML node classes that a parameter of type ``kind`` may hold; empty if it holds something else."""
    classes = tuple(member for member in _members(kind) if member is not type(None))
    if all(isinstance(member, type) and issubclass(member, slicer.vtkMRMLNode) for member in classes):
        return classes
    return ()


def _members(kind) -> tuple:
    return typing.get_args(kind) if typing.get_origin(kind) in (typing.Union, types.UnionType) else (kind,)


def _create(kind) -> Storage:
    if kind is bool:
        return _BoolStorage(bool, False, [NotNone(), IsInstance(bool)])
    if kind in (int, float):
        return Storage(kind, 0, [NotNone(), IsInstance((int, float) if kind is float else int)])
    if kind is str:
        return Storage(str, "", [NotNone(), IsInstance(str)])
    if kind in PATHS:
        return Storage(kind, kind(), [NotNone(), IsInstance(kind)])
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        return _EnumStorage(kind, next(iter(kind)), [IsInstance(kind)])
    classes = node_classes(kind)
    if classes and _members(kind) == (kind,):
        return _NodeStorage(kind, None, [IsInstance(kind)])
    if classes:
        return _UnionStorage(_members(kind))
    raise TypeError(f"The host's parameterNodeWrapper knows no parameter of type {kind}")
