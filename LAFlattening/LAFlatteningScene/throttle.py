"""Something done often, but not more often than there is time for: at once, and once more when it comes to rest."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from .live_update import SHORTEST_PAUSE, Scheduler


class Throttle:
    """Does what was asked for last, at least `SHORTEST_PAUSE` (or as long as it took) after the last time.

    Parameters
    ----------
    scheduler : called with milliseconds and a function to call after them, once.
    clock : seconds.
    """

    def __init__(self, scheduler: Scheduler, clock: Callable[[], float] = time.monotonic) -> None:
        self._scheduler, self._clock = scheduler, clock
        self._action: Callable[[], None] | None = None
        self._ticket = 0
        self._notBefore = -np.inf

    def request(self, action: Callable[[], None]) -> None:
        """Do something now if the last time is long enough ago, else when it is; a later request takes its place."""
        waiting = self._action is not None
        self._action = action
        wait = self._notBefore - self._clock()
        if wait <= 0.0:
            self._do()
        elif not waiting:
            self._ticket += 1
            ticket = self._ticket
            self._scheduler(int(np.ceil(1000.0 * wait)), lambda: self._late(ticket))

    def cancel(self) -> None:
        """What was asked for is no longer wanted."""
        self._action = None
        self._ticket += 1

    def _late(self, ticket: int) -> None:
        if ticket == self._ticket and self._action is not None:
            self._do()

    def _do(self) -> None:
        action, self._action = self._action, None
        assert action is not None
        began = self._clock()
        try:
            action()
        finally:
            ended = self._clock()
            self._notBefore = ended + max(SHORTEST_PAUSE, ended - began)
