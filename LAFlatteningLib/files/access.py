"""What all file formats share: paths, axes and units in them, and writing whole files or none."""

from __future__ import annotations

import os
import re
import secrets
import shutil
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..errors import InputFileError

PathLike = str | os.PathLike[str]

HEADER = "LAFlattening output. SPACE="
MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "µm": 1e-3}
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)


def space_in(notes: str) -> str:
    """The axes that a header declares: Slicer looks for exactly these letters, RAS first; LPS if it has neither."""
    return "RAS" if "SPACE=RAS" in notes else "LPS"


@contextmanager
def atomic_write(path: PathLike) -> Iterator[Path]:
    """Write a file as a whole or not at all: ``with atomic_write("map.vtp") as temporary: ...`` writes `temporary`.

    The temporary file is in the same folder and has the same extension (.nii.gz too). It takes the place of `path` when
    the block ends; after an error in the block it is removed, and an older file at `path` is as it was.

    Raises
    ------
    InputFileError : the folder is missing or cannot be written to, the disk is full, a folder has the name.
    """
    _check_name(path)
    target = Path(os.path.realpath(path))
    folder = target.parent
    try:
        if not folder.is_dir():
            reason = "is not a folder" if folder.exists() else "does not exist"
            raise InputFileError(f'"{path}" cannot be written: "{folder}" {reason}. Choose or create another folder.')
        if target.exists() and not target.is_file():
            raise InputFileError(f'"{path}" cannot be written: it is not a file. Choose another name.')
        temporary = folder / f".{secrets.token_hex(4)}.{target.name}"
        temporary.touch(exist_ok=False)
    except OSError as error:
        raise unwritable(path, error) from error
    try:
        yield temporary
        if target.exists():
            shutil.copymode(target, temporary)
        temporary.replace(target)
    except OSError as error:
        raise unwritable(path, error) from error
    finally:
        temporary.unlink(missing_ok=True)


def check_writable(path: PathLike, make_folder: bool = False) -> None:
    """Find out before long work whether a file can be written; errors as for `atomic_write`. Leaves no file.

    Parameters
    ----------
    make_folder : make the folder of the file, and those that it is in, where they are missing.
    """
    if make_folder:
        try:
            Path(path).parent.mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError) as error:
            raise InputFileError(
                f'"{path}" cannot be written: "{Path(path).parent}" is a file, or in one; expected a folder. Choose '
                "another one."
            ) from error
        except OSError as error:
            raise unwritable(path, error) from error
    with suppress(_OnlyChecking), atomic_write(path):
        raise _OnlyChecking


class _OnlyChecking(Exception):
    """Leaves `atomic_write` before anything takes the place of the file."""


def write_text(path: PathLike, text: str) -> None:
    """Write a text file in UTF-8, as a whole or not at all; errors as for `atomic_write`."""
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def _check_name(path: PathLike) -> None:
    """Raise InputFileError for a name that is not made of letters of Unicode, which readers and writers cannot take."""
    try:
        os.fspath(path).encode("utf-8")
    except UnicodeEncodeError:
        raise InputFileError(
            f"The name {os.fspath(path)!a} is not in UTF-8, the usual code for names of files. Rename the file."
        ) from None


def unwritable(path: PathLike, error: OSError) -> InputFileError:
    """The error for a file that the system refuses to write."""
    # Of a file that is written within `atomic_write`, by its own name.
    path = Path(path)
    path = path.with_name(re.sub(r"^(\.[0-9a-f]{8}\.)+", "", path.name)) if path.name else path
    return InputFileError(
        f'"{path}" cannot be written: {error.strerror or error}. Check the space on the disk, whether you may write '
        "there, and that no other program has the file open."
    )


def unreadable(path: Path, reason: str) -> InputFileError:
    """The error for a file that is not what it should be."""
    return InputFileError(f'"{path}" cannot be read: {reason}. Check that it is the right file, or export it again.')


def known_suffix(path: Path, suffixes: Collection[str], what: str) -> str:
    """The first of the extensions that a name has, in upper or lower case."""
    found = [suffix for suffix in suffixes if path.name.lower().endswith(suffix)]
    if not found:
        raise InputFileError(
            f'"{path}" has the extension "{path.suffix}", expected a file of {what}: {", ".join(suffixes)}.'
        )
    return found[0]


def input_suffix(path: Path, suffixes: Collection[str], what: str) -> str:
    """The extension of a file that exists and holds something."""
    _check_name(path)
    try:
        if path.is_dir():
            raise InputFileError(f'"{path}" is a folder, expected a file of {what}: {", ".join(suffixes)}.')
        if not path.exists():
            raise InputFileError(f'"{path}" does not exist. Check the name and the folder.')
        suffix = known_suffix(path, suffixes, what)
        if not path.is_file():
            raise unreadable(path, "it is not a regular file")
        with path.open("rb") as file:
            if not file.read(1):
                raise InputFileError(f'"{path}" is empty. Copy or export it again.')
    except OSError as error:
        raise unreadable(path, error.strerror or str(error)) from error
    return suffix
