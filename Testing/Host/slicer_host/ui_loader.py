"""``qt.QUiLoader``: makes the widgets of a .ui file, and refuses what the host does not know in it."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

from PySide6 import QtCore, QtUiTools, QtWidgets

_LINE = "Line"


class QUiLoader(QtUiTools.QUiLoader):
    """Loads .ui files with the stand-ins for Slicer's widgets."""

    def __init__(self, *arguments):
        from . import toolkit

        super().__init__(*arguments)
        self._stand_ins = {cls.__name__: cls for cls in toolkit.stand_ins() if issubclass(cls, QtWidgets.QWidget)}
        for cls in self._stand_ins.values():
            self.registerCustomWidget(cls)

    def createWidget(self, class_name: str, parent=None, name: str = ""):
        """A widget of that class."""
        made = self._class(class_name)()
        if parent is not None:
            made.setParent(parent)
        made.setObjectName(name)
        return made

    def load(self, file, parent=None):
        """The widget that the opened ``file`` describes.

        Raises ValueError that lists what the host does not know: widget classes, properties, signals or slots.
        """
        root = ElementTree.fromstring(bytes(file.readAll().data()))
        problems = self._problems(root)
        if problems:
            raise ValueError(f"{file.fileName()}: not known to the host: {'; '.join(problems)}")
        # Signals with MRML types are not Qt's to connect here.
        connections = root.find("connections")
        wanted = [
            [connection.findtext(key) for key in ("sender", "signal", "receiver", "slot")]
            for connection in (connections if connections is not None else ())
        ]
        if connections is not None:
            root.remove(connections)
        self._resolve_enums(root)
        buffer = QtCore.QBuffer()
        buffer.setData(ElementTree.tostring(root))
        buffer.open(QtCore.QIODevice.OpenModeFlag.ReadOnly)
        widget = super().load(buffer, parent)
        for sender, signal, receiver, slot in wanted:
            source, target = self._named(widget, sender), self._named(widget, receiver)
            source.connect(signal, getattr(target, slot.partition("(")[0]))
        return widget

    @staticmethod
    def _named(widget, name: str):
        found = widget if widget.objectName == name else widget.findChild(QtCore.QObject, name)
        if found is None:
            raise ValueError(f"a connection names {name!r}, which the .ui file does not have")
        return found

    def _class(self, name: str) -> type | None:
        if name in self._stand_ins:
            return self._stand_ins[name]
        return getattr(QtWidgets, "QFrame" if name == _LINE else name, None)

    def _resolve_enums(self, root) -> None:
        """Write the enums of stand-ins as the numbers that they are."""
        for element in root.iter("widget"):
            cls = self._stand_ins.get(element.get("class"))
            for prop in element.findall("property"):
                value = next(iter(prop))
                if cls is not None and value.tag in ("set", "enum") and value.text.startswith(cls.__name__):
                    names = [part.rpartition("::")[2] for part in value.text.split("|")]
                    value.tag, value.text = "number", str(sum(getattr(cls, name) for name in names))

    def _problems(self, root) -> list[str]:
        found = []
        for element in root.iter("widget"):
            name, cls = element.get("class"), self._class(element.get("class"))
            if cls is None:
                found.append(f"widget class {name} ({element.get('name')})")
                continue
            probe = cls()
            meta = probe.metaObject()
            found += [
                f"property {name}.{prop.get('name')} ({element.get('name')})"
                for prop in element.findall("property")
                if prop.get("stdset") != "0"
                and meta.indexOfProperty(prop.get("name")) < 0
                and not (name == _LINE and prop.get("name") == "orientation")
            ]
        return found
