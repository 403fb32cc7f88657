"""How a value of each type is kept in a vtkMRMLScriptedModuleNode."""

from __future__ import annotations

import ast
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


class _OptionalNodeStorage(_NodeStorage):
    """A union of node classes. Slicer stores each member of a union under a role of its own."""

    def __init__(self, kinds: tuple[type, ...]):
        super().__init__(slicer.vtkMRMLNode, None, [IsInstance(kinds)])
        self._kinds = kinds

    def is_in(self, node, name: str) -> bool:
        return any(node.HasParameter(role) for role in self._roles(name)) or bool(node.HasParameter(name))

    def read(self, node, name: str):
        found = (node.GetNodeReference(role) for role in self._roles(name))
        return next((value for value in found if value is not None), None)

    def write(self, node, name: str, value) -> None:
        node.SetParameter(name, "")
        for role, kind in zip(self._roles(name), self._kinds, strict=True):
            node.SetNodeReferenceID(role, value.GetID() if isinstance(value, kind) else None)
            if isinstance(value, kind):
                value = None

    def _roles(self, name: str) -> list[str]:
        return [f"{name}_{index}" for index in range(len(self._kinds))]


class _LiteralStorage(Storage):
    """A list, tuple or dict of plain values, as Python text; handed out as a copy, so set it anew to change it."""

    def decode(self, text: str):
        return self.kind(ast.literal_eval(text))

    def encode(self, value) -> str:
        return repr(self.kind(value))


def create(kind, extra: list[Validator]) -> Storage:
    """The storage of a parameter of type ``kind`` whose annotations hold the validators ``extra``."""
    storage = _create(kind)
    storage.validators = storage.validators + extra
    return storage


def node_classes(kind) -> tuple[type, ...]:
    """The MRML node classes that a parameter of type ``kind`` may hold; empty if it holds something else."""
    members = typing.get_args(kind) if typing.get_origin(kind) in (typing.Union, types.UnionType) else (kind,)
    classes = tuple(member for member in members if member is not type(None))
    if all(isinstance(member, type) and issubclass(member, slicer.vtkMRMLNode) for member in classes):
        return classes
    return ()


def _create(kind) -> Storage:
    origin = typing.get_origin(kind)
    if kind is bool:
        return _BoolStorage(bool, False, [NotNone(), IsInstance(bool)])
    if kind in (int, float):
        return Storage(kind, kind(0), [NotNone(), IsInstance((int, float) if kind is float else int)])
    if kind is str:
        return Storage(str, "", [NotNone(), IsInstance(str)])
    if kind in PATHS:
        return Storage(kind, kind(), [NotNone(), IsInstance(kind)])
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        return _EnumStorage(kind, next(iter(kind)), [NotNone(), IsInstance(kind)])
    classes = node_classes(kind)
    if classes and origin is None:
        return _NodeStorage(kind, None, [IsInstance(kind)])
    if classes:
        return _OptionalNodeStorage(classes)
    if origin in (list, tuple, dict) and not any(node_classes(member) for member in typing.get_args(kind)):
        empty = tuple(_create(member).default for member in typing.get_args(kind)) if origin is tuple else origin()
        return _LiteralStorage(origin, empty, [NotNone(), IsInstance(origin)])
    raise TypeError(f"The host's parameterNodeWrapper knows no parameter of type {kind}")
