"""How long a dragged seed takes to show on the map: from the markups event to the new map drawn in its view.

make bench-drag      or      python Testing/Benchmarks/bench_drag.py [--sizes 5000,13000,20000] [--events 60]

The seed is dragged by mouse events in the view of the atrium, through Slicer's own markups widget; the clock starts
with the event of the seeds node and stops when the map's view has been drawn. Two ways to drag:

unhurried   the next mouse event comes when the map has been drawn: what one step takes.
at 60 Hz    mouse events come 60 times a second whatever happens: how old the newest seed position on the map is when
            the map is drawn, and how many maps a second there are. Events are left out here, never the last one.

Drawing is part of it; without a graphics card (as on a server) it is done by the processor, and its share is printed.
"""

from __future__ import annotations

import argparse
import platform
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "Testing" / "Host"))

import slicer_host  # noqa: E402

VIEW_PIXELS = (700, 700)
SEED = "RSPV"
REACH_MM = 3.0
"""How far the seed is dragged to and fro."""
TIMEOUT = 30.0


class Drag:
    """A seed held by the mouse in the view of the atrium, with a clock on what follows."""

    def __init__(self, points: int) -> None:
        import slicer
        import vtk
        from slicer_host import loading

        self.slicer = slicer
        slicer.mrmlScene.Clear()
        self.panel = loading.enter(loading.load_module(ROOT / "LAFlattening" / "LAFlattening.py"))
        # A panel that is shown already takes the new scene's parameter node when events are processed.
        self.wait(lambda: self.panel.parameterNode is not None)
        surface, self.seeds = self.panel.logic.loadSample(points=points)
        parameters = self.panel.parameterNode
        parameters.surface, parameters.seeds = surface, self.seeds
        self.panel.showLayout()
        self.wait(lambda: parameters.map is not None)
        self.map = parameters.map
        logic = self.panel.logic
        views = {
            widget.mrmlViewNode(): widget.threeDView()
            for widget in map(
                slicer.app.layoutManager().threeDWidget, range(slicer.app.layoutManager().threeDViewCount)
            )
        }
        self.atrium, self.flat = views[logic.atriumViewNode()], views[logic.mapViewNode()]
        for view in views.values():
            view.resize(*VIEW_PIXELS)
        self.index = self.seeds.GetControlPointIndexByLabel(SEED)
        self.place = np.array(self.seeds.GetNthControlPointPositionWorld(self.index))
        self._look_at_seed(surface)
        self.event = self.drawn = self.began_drawing = 0.0
        self.seen = tuple(self.place)
        self.drawing: list[float] = []
        self.seeds.AddObserver(self.seeds.PointModifiedEvent, self._on_event, 100.0)
        window = self.flat.renderWindow()
        window.AddObserver(vtk.vtkCommand.StartEvent, self._on_draw)
        window.AddObserver(vtk.vtkCommand.EndEvent, self._on_drawn)
        self.shown_event = 0.0
        self.changed_at = 0.0
        self.map.AddObserver(slicer.vtkMRMLModelNode.MeshModifiedEvent, self._on_map)

    def _look_at_seed(self, surface) -> None:
        centre = self.slicer.util.arrayFromModelPoints(surface).mean(axis=0)
        outward = (self.place - centre) / np.linalg.norm(self.place - centre)
        camera = self.atrium.cameraNode()
        camera.SetFocalPoint(*self.place)
        camera.SetPosition(*(self.place + 200.0 * outward))
        camera.SetViewUp(0.0, 0.0, 1.0)
        camera.ResetClippingRange()
        self.atrium.forceRender()
        self.pixel = self._pixel(self.place)
        sideways = np.cross([0.0, 0.0, 1.0], outward)
        self.reach = self._pixel(self.place + REACH_MM * sideways / np.linalg.norm(sideways)) - self.pixel

    def _pixel(self, place: np.ndarray) -> np.ndarray:
        import vtk

        coordinate = vtk.vtkCoordinate()
        coordinate.SetCoordinateSystemToWorld()
        coordinate.SetValue(*place)
        return np.array(coordinate.GetComputedDisplayValue(self.atrium.renderer()), float)

    def mouse(self, event: str, at: np.ndarray) -> None:
        """A mouse event in the view of the atrium."""
        interactor = self.atrium.interactor()
        interactor.SetEventInformation(*(int(x) for x in np.round(at)), 0, 0)
        interactor.InvokeEvent(event)

    def _on_event(self, *_args) -> None:
        # The same event comes with changes of names and colours.
        place = self.seeds.GetNthControlPointPositionWorld(self.index)
        if tuple(place) != self.seen:
            self.seen, self.event = tuple(place), time.perf_counter()

    def _on_map(self, *_args) -> None:
        self.changed_at = self.event

    def _on_draw(self, *_args) -> None:
        self.began_drawing = time.perf_counter()

    def _on_drawn(self, *_args) -> None:
        self.drawn = time.perf_counter()
        self.drawing.append(self.drawn - self.began_drawing)
        self.shown_event = self.changed_at

    def wait(self, condition) -> None:
        """Let events be processed until something is true."""
        end = time.perf_counter() + TIMEOUT
        while not condition():
            if time.perf_counter() > end:
                raise SystemExit(f"nothing happened for {TIMEOUT:g} s")
            self.slicer.app.processEvents()

    def at(self, step: int) -> np.ndarray:
        """Where the mouse is at a step: to and fro, never twice at the same pixel in a row."""
        return self.pixel + np.round(self.reach * np.sin(0.35 * (step + 1)))

    def hold(self) -> None:
        """Press the mouse button on the seed."""
        self.mouse("EnterEvent", self.pixel)
        self.mouse("MouseMoveEvent", self.pixel)
        self.mouse("LeftButtonPressEvent", self.pixel)

    def release(self) -> None:
        """Put the seed back and let go; the full map is made."""
        self.mouse("MouseMoveEvent", self.pixel)
        self.mouse("LeftButtonReleaseEvent", self.pixel)
        self.wait(lambda: self.map.GetAttribute("LAFlattening.stage") == "map")
        self.atrium.forceRender()

    def unhurried(self, events: int) -> list[float]:
        """Seconds from each event to its map, drawn."""
        self.hold()
        seconds = []
        for step in range(events):
            before = self.event
            self.mouse("MouseMoveEvent", self.at(step))
            if self.event == before:
                continue
            event = self.event
            self.wait(lambda event=event: self.shown_event >= event)
            seconds.append(self.drawn - event)
            # The pause after a preview belongs to hurried drags.
            rest = time.perf_counter() + 3.0 * seconds[-1] + 0.05
            self.wait(lambda rest=rest: time.perf_counter() > rest)
        self.release()
        if not seconds:
            raise SystemExit("the mouse did not take hold of the seed: nothing was measured")
        return seconds

    def hurried(self, duration: float, rate: float = 60.0) -> tuple[list[float], float]:
        """Age of the seed position on each map when it was drawn (s), and maps a second."""
        self.hold()
        ages, step, shown = [], 0, self.shown_event
        began = due = time.perf_counter()
        while time.perf_counter() < began + duration:
            if time.perf_counter() >= due:
                self.mouse("MouseMoveEvent", self.at(step))
                step, due = step + 1, due + 1.0 / rate
            self.slicer.app.processEvents()
            if self.shown_event > shown:
                shown = self.shown_event
                ages.append(self.drawn - shown)
        self.release()
        return ages, len(ages) / duration


def line(what: str, seconds: list[float]) -> str:
    """Median and 95th percentile in ms."""
    ms = 1000.0 * np.array(seconds)
    return f"{what}: median {np.median(ms):6.1f} ms, 95th percentile {np.percentile(ms, 95):6.1f} ms (n = {len(ms)})"


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", default="5000,13000,20000", help="points of the synthetic atrium")
    parser.add_argument("--events", type=int, default=60, help="mouse events of the unhurried drag")
    parser.add_argument("--seconds", type=float, default=5.0, help="duration of the drag at 60 Hz, s")
    options = parser.parse_args()
    try:
        slicer_host.start(views=True)
    except slicer_host.HostUnavailable as problem:
        raise SystemExit(f"cannot be measured here: {problem}") from None
    print(f"From the markups event to the new map in its view, {platform.machine()}, views of {VIEW_PIXELS} pixels")
    for size in (int(text) for text in options.sizes.split(",")):
        drag = Drag(size)
        drag.unhurried(3)
        drag.drawing.clear()
        seconds = drag.unhurried(options.events)
        drawing = list(drag.drawing)
        ages, rate = drag.hurried(options.seconds)
        print(f"{size} points")
        print(line("  unhurried", seconds))
        print(line("  of it, drawing the map's view", drawing))
        print(line("  at 60 Hz", ages) + f", {rate:.1f} maps a second", flush=True)


if __name__ == "__main__":
    main()
