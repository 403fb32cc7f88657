"""Shows an off-screen view in a window and passes the mouse on to it."""

from __future__ import annotations

from PySide6 import QtGui, QtWidgets
from PySide6.QtCore import QEvent, Qt
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

_BUTTONS = {
    Qt.MouseButton.LeftButton: "LeftButton",
    Qt.MouseButton.MiddleButton: "MiddleButton",
    Qt.MouseButton.RightButton: "RightButton",
}


class ViewWidget(QtWidgets.QWidget):
    """The picture of a view; drawn again when the view has been."""

    def __init__(self, view):
        super().__init__()
        self._view, self._image, self._pixels = view, None, None
        self.setMouseTracking(True)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setMinimumSize(240, 240)
        view.renderWindow().AddObserver("EndEvent", lambda *_args: self._drawn())

    def _drawn(self) -> None:
        self._image = None
        self.update()

    def resizeEvent(self, event) -> None:
        """The view gets the size of the widget, in pixels of the screen."""
        ratio = self.devicePixelRatioF()
        self._view.resize(int(event.size().width() * ratio), int(event.size().height() * ratio))
        self._view.forceRender()

    def paintEvent(self, event) -> None:
        """Paint what the view has drawn last."""
        if self._image is None:
            self._image = self._picture()
        painter = QtGui.QPainter(self)
        painter.drawImage(self.rect, self._image)
        painter.end()

    def _picture(self) -> QtGui.QImage:
        window = self._view.renderWindow()
        width, height = window.GetSize()
        pixels = vtkUnsignedCharArray()
        window.GetPixelData(0, 0, width - 1, height - 1, 0, pixels, 0)
        # VTK's first line is the lowest. The image does not own its pixels.
        self._pixels = vtk_to_numpy(pixels).reshape(height, width, 3)[::-1].copy()
        return QtGui.QImage(self._pixels.data, width, height, 3 * width, QtGui.QImage.Format.Format_RGB888)

    def _send(self, name: str, event=None) -> None:
        interactor = self._view.interactor()
        if event is not None:
            ratio, held = self.devicePixelRatioF(), event.modifiers()
            x, y = event.position().x() * ratio, event.position().y() * ratio
            control = int(bool(held & Qt.KeyboardModifier.ControlModifier))
            shift = int(bool(held & Qt.KeyboardModifier.ShiftModifier))
            interactor.SetEventInformation(
                int(x), int(self._view.renderWindow().GetSize()[1] - 1 - y), control, shift, "\0", 0
            )
        interactor.InvokeEvent(name)

    def mousePressEvent(self, event) -> None:
        """Pass it on."""
        if event.button() in _BUTTONS:
            self._send(f"{_BUTTONS[event.button()]}PressEvent", event)

    def mouseReleaseEvent(self, event) -> None:
        """Pass it on."""
        if event.button() in _BUTTONS:
            self._send(f"{_BUTTONS[event.button()]}ReleaseEvent", event)

    def mouseDoubleClickEvent(self, event) -> None:
        """Pass it on."""
        if event.button() in _BUTTONS:
            self._send(f"{_BUTTONS[event.button()]}DoubleClickEvent", event)

    def mouseMoveEvent(self, event) -> None:
        """Pass it on."""
        self._send("MouseMoveEvent", event)

    def wheelEvent(self, event) -> None:
        """Pass it on."""
        self._send("MouseWheelForwardEvent" if event.angleDelta().y() > 0 else "MouseWheelBackwardEvent", event)

    def enterEvent(self, event) -> None:
        """Pass it on."""
        self._send("EnterEvent", event)

    def leaveEvent(self, event: QEvent) -> None:
        """Pass it on."""
        self._send("LeaveEvent")
