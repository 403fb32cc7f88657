"""The errors that bad input raises.

Every message says what was expected, what was found and what to do about it, because it is shown to the
user as it stands (panel, command line, console).
"""


class LAFlatteningError(ValueError):
    """Base of every error that the library raises about its input."""


class InputFileError(LAFlatteningError):
    """A file is missing, unreadable, not what its name says, or cannot be written."""


class SurfaceError(LAFlatteningError):
    """A surface is not the kind of mesh that a step needs (topology, orientation, openings, units)."""


class SeedError(LAFlatteningError):
    """Seeds are missing, misplaced, swapped or mirrored.

    ``labels`` names the seeds at fault, so that a caller can mark them.
    """

    def __init__(self, message: str, labels: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.labels = labels


class TemplateError(LAFlatteningError):
    """A template file breaks its schema or describes an impossible layout."""


class FoldError(LAFlatteningError):
    """No map free of folded triangles was found.

    ``points`` are the ids of the surface points at the place.
    """

    def __init__(self, message: str, points: tuple[int, ...] = ()) -> None:
        super().__init__(message)
        self.points = points


class Cancelled(Exception):
    """The progress callback asked to stop; nothing was written."""
