"""``slicer.app.layoutManager()`` on the real vtkMRMLLayoutLogic: one off-screen view for each 3D view of a layout."""

from __future__ import annotations

from collections.abc import Callable

import slicer
import vtk

from .views import ThreeDView, ThreeDWidget

_SIGNALS = ("layoutChanged(int)",)


class LayoutManager:
    """The layout manager. Methods are those of qSlicerLayoutManager.

    Slice, table and plot views are not drawn: a layout may name them, and they stay empty.
    """

    __slots__ = ("_logic", "_node", "_shown", "_slots", "_views")

    def __init__(self):
        self._views: dict[str, ThreeDView] = {}
        self._slots: list[Callable] = []
        self._shown = None
        self._logic = slicer.vtkMRMLLayoutLogic()
        self._logic.SetMRMLScene(slicer.mrmlScene)
        self._node = self._logic.GetLayoutNode()
        self._node.AddObserver(vtk.vtkCommand.ModifiedEvent, self._follow)
        for event in (slicer.vtkMRMLScene.EndCloseEvent, slicer.vtkMRMLScene.EndImportEvent):
            slicer.mrmlScene.AddObserver(event, self._follow)
        self.setLayout(slicer.vtkMRMLLayoutNode.SlicerLayoutOneUp3DView)

    def _nodes(self) -> list:
        nodes = self._logic.GetViewNodes()
        found = (nodes.GetItemAsObject(index) for index in range(nodes.GetNumberOfItems()))
        return [node for node in found if node.IsA("vtkMRMLViewNode") and node.GetScene() is not None]

    def _follow(self, *_args) -> None:
        nodes = self._nodes()
        for node in nodes:
            name = node.GetLayoutName()
            if name not in self._views:
                self._views[name] = ThreeDView(node)
        names = [node.GetLayoutName() for node in nodes]
        for name, view in self._views.items():
            view.mrmlViewNode().SetMappedInLayout(int(name in names))
        if self._shown != self._node.GetViewArrangement():
            self._shown = self._node.GetViewArrangement()
            for slot in list(self._slots):
                slot(self._shown)

    def render_pending(self) -> None:
        """Draw the views in which something has changed (the host calls this)."""
        for view in list(self._views.values()):
            view.render_pending()

    def connect(self, signal: str, slot: Callable) -> bool:
        """Call ``slot`` with the number of the layout when it changes."""
        self._check(signal)
        self._slots.append(slot)
        return True

    def disconnect(self, signal: str, slot: Callable) -> bool:
        """Undo ``connect``."""
        self._check(signal)
        self._slots = [other for other in self._slots if other != slot]
        return True

    @staticmethod
    def _check(signal: str) -> None:
        if signal not in _SIGNALS:
            raise AttributeError(f"qSlicerLayoutManager has no signal {signal!r} that the host knows")

    def layoutLogic(self):
        """The vtkMRMLLayoutLogic."""
        return self._logic

    def mrmlScene(self):
        """The scene."""
        return slicer.mrmlScene

    @property
    def layout(self) -> int:
        """Number of the layout shown."""
        return self._node.GetViewArrangement()

    @layout.setter
    def layout(self, number: int) -> None:
        self.setLayout(number)

    def setLayout(self, number: int) -> None:
        """Show a layout."""
        self._node.SetViewArrangement(number)
        self._follow()

    @property
    def threeDViewCount(self) -> int:
        """Number of 3D views made so far."""
        return len(self._views)

    def threeDWidget(self, which: int | str) -> ThreeDWidget | None:
        """A 3D view by number or by the name it has in layouts; None if there is none."""
        if isinstance(which, int):
            names = list(self._views)
            which = names[which] if 0 <= which < len(names) else ""
        return ThreeDWidget(self._views[which]) if which in self._views else None

    def resetThreeDViews(self) -> None:
        """Look at the middle of what is visible in each 3D view."""
        for view in self._views.values():
            view.resetFocalPoint()

    def sliceViewNames(self) -> tuple:
        """Names of the slice views: none."""
        return ()

    @property
    def tableViewCount(self) -> int:
        """Number of table views: none."""
        return 0

    @property
    def plotViewCount(self) -> int:
        """Number of plot views: none."""
        return 0
