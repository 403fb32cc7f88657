"""What follows nodes of the scene ends with it."""

from __future__ import annotations

from typing import Protocol

import slicer


class Follower(Protocol):
    """An observer of nodes: a `VTKObservationMixin` that can stop."""

    def addObserver(self, obj: object, event: object, method: object) -> None:
        """See `VTKObservationMixin`."""

    def stop(self) -> None:
        """Follow no longer."""


def stopWithScene(follower: Follower) -> None:
    """Let something stop where the scene is closed, or another one is about to be added to it.

    While a scene is added, its parameter node names nodes by numbers that still belong to others.
    """
    scene = slicer.mrmlScene
    for event in (scene.StartCloseEvent, scene.StartImportEvent):
        follower.addObserver(scene, event, lambda *_: follower.stop())
