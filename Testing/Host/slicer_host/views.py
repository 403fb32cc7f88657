"""A 3D view drawn off screen by the real displayable managers, with a real interactor for mouse events."""

from __future__ import annotations

import slicer
import vtk

_MANAGERS = (
    "vtkMRMLCameraDisplayableManager",
    "vtkMRMLViewDisplayableManager",
    "vtkMRMLModelDisplayableManager",
    "vtkMRMLCrosshairDisplayableManager3D",
    "vtkMRMLOrientationMarkerDisplayableManager",
    "vtkMRMLRulerDisplayableManager",
    "vtkMRMLSegmentationsDisplayableManager3D",
    "vtkMRMLMarkupsDisplayableManager",
    "vtkMRMLLinearTransformsDisplayableManager",
    "vtkMRMLColorLegendDisplayableManager",
)
_DEFAULT_SIZE = (640, 480)


class ThreeDView:
    """``threeDWidget.threeDView()``: the drawing area of a 3D view. Methods are those of qMRMLThreeDView."""

    __slots__ = ("_group", "_interactor", "_logic", "_node", "_pending", "_renderer", "_style", "_window", "on_pending")

    def __init__(self, node):
        app_logic = slicer.app.applicationLogic()
        self._node, self._pending, self.on_pending = node, True, None
        self._renderer = vtk.vtkRenderer()
        self._window = vtk.vtkRenderWindow()
        self._window.SetOffScreenRendering(1)
        self._window.SetMultiSamples(0)
        self._window.SetSize(*_DEFAULT_SIZE)
        self._window.AddRenderer(self._renderer)
        self._interactor = vtk.vtkGenericRenderWindowInteractor()
        self._interactor.SetRenderWindow(self._window)
        self._interactor.SetInteractorStyle(vtk.vtkInteractorStyle3D())
        self._interactor.EnableRenderOff()

        factory = slicer.vtkMRMLThreeDViewDisplayableManagerFactory.GetInstance()
        for name in _MANAGERS:
            if not factory.IsDisplayableManagerRegistered(name):
                factory.RegisterDisplayableManager(name)
        self._group = slicer.vtkMRMLDisplayableManagerGroup()
        self._group.Initialize(factory, self._renderer)
        self._group.AddObserver(vtk.vtkCommand.UpdateEvent, self._ask)
        self._interactor.AddObserver(vtk.vtkCommand.RenderEvent, self._ask)
        self._style = slicer.vtkMRMLThreeDViewInteractorStyle()
        self._style.SetDisplayableManagers(self._group)
        self._style.SetInteractor(self._interactor)

        self._logic = slicer.vtkMRMLViewLogic()
        self._logic.SetMRMLApplicationLogic(app_logic)
        app_logic.GetViewLogics().AddItem(self._logic)
        self._logic.SetMRMLScene(slicer.mrmlScene)
        self._group.SetMRMLDisplayableNode(node)

    def _ask(self, *_args) -> None:
        self._pending = True
        if self.on_pending is not None:
            self.on_pending()

    def render_pending(self) -> bool:
        """Draw if something has changed since the last time, as Slicer's event loop does; returns whether it did."""
        if not self._pending or not self._node.IsMappedInLayout():
            return False
        self.forceRender()
        return True

    def resize(self, width: int, height: int) -> None:
        """Set the size of the drawing area in pixels (the host calls this)."""
        self._window.SetSize(width, height)
        self._interactor.UpdateSize(width, height)
        self._interactor.ConfigureEvent()
        self._ask()

    def renderWindow(self):
        """The vtkRenderWindow."""
        return self._window

    def renderer(self):
        """The vtkRenderer."""
        return self._renderer

    def interactor(self):
        """The interactor; mouse events invoked on it reach the displayable managers."""
        return self._interactor

    def interactorStyle(self):
        """The vtkMRMLThreeDViewInteractorStyle."""
        return self._style

    def mrmlViewNode(self):
        """The view node."""
        return self._node

    def mrmlScene(self):
        """The scene."""
        return slicer.mrmlScene

    def cameraNode(self):
        """The camera node of the view."""
        return self.displayableManagerByClassName("vtkMRMLCameraDisplayableManager").GetCameraNode()

    def displayableManagerByClassName(self, name: str):
        """One of the view's displayable managers, or None."""
        return self._group.GetDisplayableManagerByClassName(name)

    def forceRender(self) -> None:
        """Draw now."""
        if slicer.app.isRenderPaused:
            return
        self._pending = False
        self._window.Render()

    def scheduleRender(self) -> None:
        """Draw when the events are processed next."""
        self._ask()

    def resetFocalPoint(self) -> None:
        """Look at the middle of all that is visible."""
        bounds = self._visible_bounds()
        if bounds is not None:
            centre = [(bounds[axis] + bounds[axis + 1]) / 2 for axis in (0, 2, 4)]
            camera = self.cameraNode()
            move = [new - old for new, old in zip(centre, camera.GetFocalPoint(), strict=True)]
            camera.SetPosition([old + step for old, step in zip(camera.GetPosition(), move, strict=True)])
            camera.SetFocalPoint(centre)

    def resetCamera(self) -> None:
        """Frame all that is visible, keeping the direction of view."""
        bounds = self._visible_bounds()
        if bounds is not None:
            self._renderer.ResetCamera(bounds)
        self._renderer.ResetCameraClippingRange()
        self._ask()

    def lookFromAxis(self, axis: int) -> None:
        """Look along one of the six axes (0 right, 1 left, 2 posterior, 3 anterior, 4 superior, 5 inferior)."""
        self.cameraNode().RotateTo(axis)

    rotateToViewAxis = lookFromAxis

    def _visible_bounds(self):
        shown = self._node.GetBoxVisible(), self._node.GetAxisLabelsVisible()
        self._node.SetBoxVisible(0)
        self._node.SetAxisLabelsVisible(0)
        bounds = [0.0] * 6
        self._renderer.ComputeVisiblePropBounds(bounds)
        self._node.SetBoxVisible(shown[0])
        self._node.SetAxisLabelsVisible(shown[1])
        return bounds if bounds[0] <= bounds[1] else None


class ThreeDWidget:
    """``layoutManager.threeDWidget(...)``: a 3D view with its bar. Methods are those of qMRMLThreeDWidget."""

    __slots__ = ("_view",)

    def __init__(self, view: ThreeDView):
        self._view = view

    def threeDView(self) -> ThreeDView:
        """The drawing area."""
        return self._view

    def mrmlViewNode(self):
        """The view node."""
        return self._view.mrmlViewNode()
