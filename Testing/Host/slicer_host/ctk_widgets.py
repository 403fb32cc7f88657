"""CTK's buttons, sliders and boxes."""

from __future__ import annotations

from PySide6 import QtCore, QtWidgets
from PySide6.QtCore import Property, Qt, Signal

from .standin import passed_on, stored

_BAR_HEIGHT = 24
_STEPS = 10000


class ctkCollapsibleButton(QtWidgets.QWidget):
    """A section of a panel under a button that opens and closes it."""

    contentsCollapsed, toggled, clicked = Signal(bool), Signal(bool), Signal(bool)

    def __init__(self, *arguments):
        texts = [argument for argument in arguments if isinstance(argument, str)]
        super().__init__(*[argument for argument in arguments if not isinstance(argument, str)])
        self._collapsed = False
        self._button = QtWidgets.QToolButton(self)
        self._button.setCheckable(True)
        self._button.setChecked(True)
        self._button.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextBesideIcon)
        self._button.setArrowType(Qt.ArrowType.DownArrow)
        self._button.toggled.connect(lambda opened: self._set_collapsed(not opened))
        self._button.clicked.connect(self.clicked)
        self.setContentsMargins(0, _BAR_HEIGHT, 0, 0)
        if texts:
            self._button.setText(texts[0])

    def resizeEvent(self, event) -> None:
        """Keep the button as wide as the section."""
        self._button.setGeometry(0, 0, event.size().width(), _BAR_HEIGHT - 2)

    def showEvent(self, event) -> None:
        """Widgets added to a closed section stay hidden."""
        self._show_contents()

    def _set_collapsed(self, collapsed: bool) -> None:
        if collapsed == self._collapsed:
            return
        self._collapsed = collapsed
        self._button.setChecked(not collapsed)
        self._button.setArrowType(Qt.ArrowType.RightArrow if collapsed else Qt.ArrowType.DownArrow)
        self._show_contents()
        self.setMaximumHeight(_BAR_HEIGHT if collapsed else 16777215)
        self.contentsCollapsed.emit(collapsed)
        self.toggled.emit(not collapsed)

    def _show_contents(self) -> None:
        for child in self.children():
            if not isinstance(child, QtWidgets.QWidget) or child is self._button:
                continue
            # A widget that the module itself has hidden is not shown again.
            if self._collapsed and not child.isHidden():
                child.setProperty("_hidden_by_section", True)
                child.hide()
            elif not self._collapsed and child.property("_hidden_by_section"):
                child.setProperty("_hidden_by_section", None)
                child.show()

    collapsed = Property(bool, lambda self: self._collapsed, lambda self, value: self._set_collapsed(value))
    checked = Property(bool, lambda self: not self._collapsed, lambda self, value: self._set_collapsed(not value))
    text = passed_on(str, "_button", "text")
    icon = passed_on("QIcon", "_button", "icon")
    flat = stored(bool, "flat", False)
    collapsedHeight = stored(int, "collapsedHeight", 16)
    contentsFrameShape = stored(int, "contentsFrameShape", 0)

    def setText(self, text: str) -> None:
        """Set the text of the button."""
        self._button.setText(text)

    def setChecked(self, checked: bool) -> None:
        """Open (True) or close the section."""
        self._set_collapsed(not checked)

    def setCollapsed(self, collapsed: bool) -> None:
        """Close (True) or open the section."""
        self._set_collapsed(collapsed)

    def toggle(self) -> None:
        """Open a closed section, close an open one."""
        self._set_collapsed(not self._collapsed)


class _Range(QtWidgets.QWidget):
    """A number between limits: a slider, a box or both."""

    valueChanged = Signal(float)

    def __init__(self, *arguments, slider: bool, box: bool):
        super().__init__(*arguments)
        layout = QtWidgets.QHBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        self._slider = QtWidgets.QSlider(Qt.Orientation.Horizontal)
        self._slider.setRange(0, _STEPS)
        self._box = QtWidgets.QDoubleSpinBox()
        for shown, widget in ((slider, self._slider), (box, self._box)):
            if shown:
                layout.addWidget(widget)
            else:
                widget.setParent(self)
                widget.hide()
        self._box.valueChanged.connect(self._changed)
        self._slider.sliderMoved.connect(self._moved)

    def _changed(self, value: float) -> None:
        self._show(value)
        self.valueChanged.emit(value)

    def _moved(self, step: int) -> None:
        low, high = self._box.minimum, self._box.maximum
        self._box.setValue(low + (high - low) * step / _STEPS)

    def _show(self, value: float) -> None:
        low, high = self._box.minimum, self._box.maximum
        blocker = QtCore.QSignalBlocker(self._slider)
        self._slider.setValue(round(_STEPS * (value - low) / (high - low)) if high > low else 0)
        blocker.unblock()

    def _limit(self, name: str, value: float) -> None:
        setattr(self._box, name, value)
        self._show(self._box.value)

    value = passed_on(float, "_box", "value")
    minimum = Property(float, lambda self: self._box.minimum, lambda self, value: self._limit("minimum", value))
    maximum = Property(float, lambda self: self._box.maximum, lambda self, value: self._limit("maximum", value))
    singleStep = passed_on(float, "_box", "singleStep")

    def setValue(self, value: float) -> None:
        """Set the value; beyond a limit it becomes that limit."""
        self._box.setValue(value)


class ctkSliderWidget(_Range):
    """A slider with a box for its value."""

    valueIsChanging = Signal(float)

    def __init__(self, *arguments):
        super().__init__(*arguments, slider=True, box=True)

    decimals = passed_on(int, "_box", "decimals")
    suffix = passed_on(str, "_box", "suffix")
    prefix = passed_on(str, "_box", "prefix")
    pageStep = stored(float, "pageStep", 10.0)
    tickInterval = stored(float, "tickInterval", 0.0)
    tracking = stored(bool, "tracking", True)


class ctkDoubleSlider(_Range):
    """A slider of floating-point values."""

    valueIsChanging, sliderMoved = Signal(float), Signal(float)

    def __init__(self, *arguments):
        super().__init__(*arguments, slider=True, box=False)

    pageStep = stored(float, "pageStep", 10.0)
    tickInterval = stored(float, "tickInterval", 0.0)
    tracking = stored(bool, "tracking", True)
    orientation = passed_on(int, "_slider", "orientation")


class ctkDoubleSpinBox(_Range):
    """A box for a floating-point value."""

    def __init__(self, *arguments):
        super().__init__(*arguments, slider=False, box=True)

    decimals = passed_on(int, "_box", "decimals")
    suffix = passed_on(str, "_box", "suffix")
    prefix = passed_on(str, "_box", "prefix")


class ctkCheckBox(QtWidgets.QCheckBox):
    """A check box."""


class ctkPushButton(QtWidgets.QPushButton):
    """A button."""


class ctkComboBox(QtWidgets.QComboBox):
    """A combo box that says something while nothing is selected."""

    defaultText = stored(str, "defaultText", "")


class ctkFittedTextBrowser(QtWidgets.QTextBrowser):
    """A text as high as its contents."""

    collapsed = stored(bool, "collapsed", True)
