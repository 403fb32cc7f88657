"""What the stand-ins for CTK's and Slicer's widgets are made with."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import Property


class Observations:
    """The observers of a widget on MRML objects; they go with the widget, as in Slicer."""

    def __init__(self, widget):
        self._kept: list[tuple] = []
        widget.destroyed.connect(self.clear)

    def add(self, target, event, callback: Callable) -> None:
        """Call ``callback`` on the event."""
        self._kept.append((target, target.AddObserver(event, callback)))

    def clear(self, *_args) -> None:
        """Remove all observers."""
        for target, tag in self._kept:
            target.RemoveObserver(tag)
        self._kept = []


def stored(kind, name: str, default, *, changed: Callable | None = None, notify: str = "") -> Property:
    """A Qt property that the widget keeps.

    When its value changes, ``changed(widget)`` is called and the signal ``notify`` is emitted with the new value.
    """

    def get(self):
        return self.__dict__.setdefault("_stored", {}).get(name, default)

    def put(self, value) -> None:
        if get(self) == value:
            return
        self.__dict__["_stored"][name] = value
        if changed is not None:
            changed(self)
        if notify:
            getattr(self, notify).emit(value)

    return Property(kind, get, put)


def passed_on(kind, part: str, name: str) -> Property:
    """A Qt property that is one of the widget's part ``part``."""
    return Property(
        kind,
        lambda self: getattr(getattr(self, part), name),
        lambda self, value: setattr(getattr(self, part), name, value),
    )
