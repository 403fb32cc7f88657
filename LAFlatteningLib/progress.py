"""Progress of long work, and the wish to stop it."""

from __future__ import annotations

from collections.abc import Callable

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
