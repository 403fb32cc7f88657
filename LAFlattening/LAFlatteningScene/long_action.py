"""One long action at a time, and what it writes belongs to what it has read.

A long action tells how far it is, and whoever is told may let events through: seeds move, another atrium is chosen,
nodes are deleted, buttons are pressed. So one rule holds for all of them. A second action is refused while one is going
on, what follows changes by itself waits, and before anything is written the action looks whether what it has read is
still there and still the same. If not, nothing is written, and the user is told why.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol

import slicer

from LAFlatteningLib import Cancelled, LAFlatteningError
from LAFlatteningLib.progress import ProgressCallback

BUSY = "Something else is being computed. Wait until it is done, or cancel it; then do this again."
LOOK_AGAIN = 200
"""Milliseconds after which what follows changes by itself looks whether the action that is going on is done."""


class Interrupted(Cancelled):
    """Nothing was written, and why; the message is for the user."""


class CanBeBusy(Protocol):
    """What runs long actions: the Logic."""

    isBusy: bool


def refuseWhileBusy(logic: CanBeBusy) -> None:
    """Refuse to do anything with maps and atria in the midst of a long action.

    Raises
    ------
    Interrupted : one is going on.
    """
    if logic.isBusy:
        raise Interrupted(BUSY)


@contextmanager
def longAction(logic: CanBeBusy, doing: str, progress: ProgressCallback | None = None) -> Iterator[LongAction]:
    """The only long action while the ``with`` block lasts, in which it also writes.

    Parameters
    ----------
    doing : for messages, like "the map was being made".

    Raises
    ------
    Interrupted : another one is going on.
    """
    refuseWhileBusy(logic)
    logic.isBusy = True
    try:
        yield LongAction(doing, progress)
    finally:
        logic.isBusy = False


class LongAction:
    """What a long action has read, and whether it is still so."""

    def __init__(self, doing: str, progress: ProgressCallback | None) -> None:
        self._doing, self._progress = doing, progress
        self._nodes: list[slicer.vtkMRMLNode] = []
        self._state: Callable[[], object] = lambda: None
        self._before: object = None

    def read(self, state: Callable[[], object], *nodes: slicer.vtkMRMLNode | None) -> None:
        """Note what is read, at the time of reading.

        Parameters
        ----------
        state : gives something that compares equal as long as what was read is the same.
        nodes : that have to stay in the scene; None is left out.
        """
        self._nodes = [node for node in nodes if node is not None]
        self._state, self._before = state, state()

    def progress(self, share: float, text: str) -> bool | None:
        """The progress of the action; it ends at once when a node is deleted.

        Raises
        ------
        Interrupted : see `read`.
        """
        answer = self._progress(share, text) if self._progress is not None else None
        self._checkNodes()
        return answer

    def check(self) -> None:
        """Called before anything is written, and after the last progress.

        Raises
        ------
        Interrupted : what was read is not there any more, or has changed.
        """
        self._checkNodes()
        try:
            same = self._state() == self._before
        except LAFlatteningError:
            # It cannot even be read any more.
            same = False
        if not same:
            raise Interrupted(
                f"What had been read was changed while {self._doing}, so that nothing was written. Do it again."
            )

    def _checkNodes(self) -> None:
        for node in self._nodes:
            if node.GetScene() is None:
                raise Interrupted(f'"{node.GetName()}" was deleted while {self._doing}, so that nothing was written.')


def whileChosen(
    parameterNode: object, names: Sequence[str], doing: str, progress: ProgressCallback | None
) -> ProgressCallback | None:
    """A progress that ends the action when other nodes are chosen in the panel meanwhile.

    Parameters
    ----------
    names : of parameters that hold nodes.
    """
    if progress is None:
        return None
    chosen = {name: getattr(parameterNode, name) for name in names}

    def watch(share: float, text: str) -> bool | None:
        answer = progress(share, text)
        for name, node in chosen.items():
            # That a node was deleted says the action itself.
            isThere = node is None or node.GetScene() is not None
            if isThere and getattr(parameterNode, name) is not node:
                raise Interrupted(
                    f"Something else was chosen in the panel while {doing}, so that nothing was written. Do it again."
                )
        return answer

    return watch
