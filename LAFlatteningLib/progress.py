"""Progress of long work, the wish to stop it, and how long it took."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from .errors import Cancelled

ProgressCallback = Callable[[float, str], "bool | None"]
"""Called with the share done (0 to 1) and what is being done; returning False stops the work."""


def report(progress: ProgressCallback | None, share: float, text: str) -> None:
    """Tell a callback how far the work is.

    Raises
    ------
    Cancelled : if it answers False.
    """
    if progress is not None and progress(share, text) is False:
        raise Cancelled(text)


def part(progress: ProgressCallback | None, start: float, stop: float) -> ProgressCallback | None:
    """The progress of a step, as a part of the whole from `start` to `stop`."""
    if progress is None:
        return None
    return lambda share, text: progress(start + share * (stop - start), text)


class Stopwatch:
    """Seconds spent in each stage of a piece of work."""

    def __init__(self) -> None:
        self._began = time.perf_counter()
        self.seconds: dict[str, float] = {}
        """stage -> seconds, and after `stop` also "total"."""

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time what is done inside the ``with`` block, in addition to what the stage has taken already."""
        began = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - began

    def stop(self) -> dict[str, float]:
        """Note the total time since the watch was made; returns `seconds`."""
        self.seconds["total"] = time.perf_counter() - self._began
        return self.seconds
