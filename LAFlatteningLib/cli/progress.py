"""Progress of a command, on standard error."""

from __future__ import annotations

import sys
import threading


class Progress:
    """Says on standard error what is being done, once the command has taken longer than a second."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet
        self._line = False
        self._now = ""
        self._printed = ""
        self._timer = threading.Timer(1.0, self._start)
        self._timer.daemon = True
        self._started = False
        if not quiet:
            self._timer.start()

    def __call__(self, share: float, text: str) -> bool:
        """A `LAFlatteningLib.progress.ProgressCallback`."""
        self._now = f"{100 * share:3.0f} %  {text}"
        if self._started:
            self._print()
        return True

    def _start(self) -> None:
        self._started = True
        self._print()

    def _print(self) -> None:
        if not self._now or self._now == self._printed:
            return
        self._printed = self._now
        if sys.stderr.isatty():
            print(f"\r\033[K{self._now}", end="", file=sys.stderr, flush=True)
            self._line = True
        else:
            print(self._now, file=sys.stderr, flush=True)

    def clear(self) -> None:
        """Say no more, and take the last line away."""
        self._timer.cancel()
        self._started = False
        if self._line:
            print("\r\033[K", end="", file=sys.stderr, flush=True)
            self._line = False
