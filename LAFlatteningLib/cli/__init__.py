"""The command ``la-flatten``: one module a command, each with `add`, which describes it, and `run`."""

from __future__ import annotations

import argparse
import io
import os
import signal
import sys
import threading
from collections.abc import Sequence

from .._version import __version__
from ..errors import LAFlatteningError
from . import (
    compare,
    demo,
    distortion,
    fibrosis,
    flatten,
    gaps,
    info,
    measure,
    peers,
    prepare,
    project,
    run,
    template,
    texture,
)
from .progress import Progress

BAD_INPUT = 2
"""Exit code for input that cannot be used."""

COMMANDS = (
    run, prepare, flatten, project, fibrosis, gaps, compare, measure, distortion, texture, template, peers, demo, info,
)  # fmt: skip
"""In the order of the help."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code (0 done, 2 bad input, 130 interrupted)."""
    parser = _parser()
    options = parser.parse_args(arguments)
    progress = Progress(options.quiet)
    if threading.current_thread() is threading.main_thread():
        # Being terminated is like Ctrl-C: temporary files are removed on the way out.
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    if isinstance(sys.stdout, io.TextIOWrapper):
        # Names of arrays may hold letters that the terminal does not know.
        sys.stdout.reconfigure(errors="replace")
    try:
        options.run(options, progress)
        progress.clear()
        sys.stdout.flush()
    except LAFlatteningError as error:
        progress.clear()
        print(f"la-flatten: {error}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        progress.clear()
        print("la-flatten: stopped; no file is half-written.", file=sys.stderr)
        return 130
    except OSError as error:
        # Nobody reads standard output (a closed pipe), or it has no room; files are whole by then.
        progress.clear()
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):
            return 0
        print(f"la-flatten: standard output cannot be written: {error.strerror or error}", file=sys.stderr)
        return BAD_INPUT
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="la-flatten",
        description="Standardised, fold-free 2D maps of the left atrium.",
        epilog="Example: la-flatten demo --output demo   (then: la-flatten flatten demo/atrium.vtp "
        "--seeds demo/seeds.mrk.json --output map.vtp --metrics metrics.json --figure map.png)",
    )
    parser.add_argument("--version", action="version", version=f"la-flatten {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in COMMANDS:
        command.add(commands)
    return parser
