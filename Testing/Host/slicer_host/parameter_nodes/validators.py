"""Annotations that limit the values of a parameter, and the one that gives its default."""

from __future__ import annotations

import abc
from collections.abc import Callable, Iterable


class Validator(abc.ABC):
    """Base of all validators; a module may derive its own."""

    @abc.abstractmethod
    def validate(self, value) -> None:
        """Raise an exception (ValueError by preference) if ``value`` is not allowed."""


class NotNone(Validator):
    """The value is not None."""

    def validate(self, value) -> None:
        if value is None:
            raise ValueError("Value must not be None")


class IsInstance(Validator):
    """The value is None or an instance of ``classtype`` (a class or a tuple of classes)."""

    def __init__(self, classtype):
        self.classtype = classtype

    def validate(self, value) -> None:
        if value is not None and not isinstance(value, self.classtype):
            raise TypeError(f"Value must be of type {self.classtype}, is {value!r} of type {type(value)}")


class Minimum(Validator):
    """The value is at least ``minimum``."""

    def __init__(self, minimum: float):
        self.minimum = minimum

    def validate(self, value) -> None:
        if value < self.minimum:
            raise ValueError(f"Value must be at least {self.minimum}, is {value}")


class Maximum(Validator):
    """The value is at most ``maximum``."""

    def __init__(self, maximum: float):
        self.maximum = maximum

    def validate(self, value) -> None:
        if value > self.maximum:
            raise ValueError(f"Value must be at most {self.maximum}, is {value}")


class WithinRange(Validator):
    """The value is between ``minimum`` and ``maximum``, both allowed."""

    def __init__(self, minimum: float, maximum: float):
        self.minimum, self.maximum = minimum, maximum

    def validate(self, value) -> None:
        if not self.minimum <= value <= self.maximum:
            raise ValueError(f"Value must be within [{self.minimum}, {self.maximum}], is {value}")


class Choice(Validator):
    """The value is one of ``choices``."""

    def __init__(self, choices: Iterable):
        self.choices = choices

    def validate(self, value) -> None:
        if value not in self.choices:
            raise ValueError(f"Value must be one of {self.choices}, is {value!r}")


class Exclude(Validator):
    """The value is none of ``excludedValues``."""

    def __init__(self, excludedValues: Iterable):
        self.excludedValues = excludedValues

    def validate(self, value) -> None:
        if value in self.excludedValues:
            raise ValueError(f"Value must not be one of {self.excludedValues}, is {value!r}")


class Default:
    """The value of a parameter that has not been set: ``value``, or what ``generator()`` returns when it is needed."""

    def __init__(self, value=None, *, generator: Callable | None = None):
        self._generator = generator or (lambda: value)

    @property
    def value(self):
        """The default."""
        return self._generator()
