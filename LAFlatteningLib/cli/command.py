"""What every command shares: how it is added to the parser, and how a map is written and summed up."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

from ..errors import InputFileError
from ..figures import draw_figure
from ..files import atomic_write, write_surface
from ..flattening import FlatMap
from ..template import builtin_templates
from .progress import Progress

Subcommands = argparse._SubParsersAction
"""What ``ArgumentParser.add_subparsers`` returns."""


def add_command(
    commands: Subcommands, name: str, run: Callable[[argparse.Namespace, Progress], None], summary: str, example: str
) -> argparse.ArgumentParser:
    """Add a command to the parser; `run` is called with its options."""
    sub = commands.add_parser(
        name,
        help=summary,
        description=summary,
        epilog=f"Example:\n  {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    sub.add_argument("--quiet", action="store_true", help="print results and errors only")
    sub.set_defaults(run=run)
    return sub


def check_distinct(options: argparse.Namespace, names: Sequence[str]) -> None:
    """Raise InputFileError where one file is given for two of the options called `names`."""
    used: dict[Path, str] = {}
    for name in names:
        value = getattr(options, name)
        if value and not (name == "template" and value in builtin_templates()):
            path = Path(value).resolve()
            if path in used:
                raise InputFileError(f'"{value}" is given twice, as {used[path]} and as {name}; expected two files.')
            used[path] = name


def write_map(
    flat_map: FlatMap,
    output: Path | str,
    metrics: Path | str | None,
    figure: Path | str | None,
    array: str | None,
    progress: Progress,
) -> None:
    """Write map, metrics and figure: all of them, or none."""
    with ExitStack() as files:
        if figure:
            progress(0.75, "Drawing")
            draw_figure(flat_map, files.enter_context(atomic_write(figure)), array=array)
        progress(0.95, "Writing")
        if metrics:
            text = json.dumps(flat_map.metrics, indent=2) + "\n"
            files.enter_context(atomic_write(metrics)).write_text(text, encoding="utf-8")
        write_surface(flat_map.to_surface(), files.enter_context(atomic_write(output)))


def report_map(flat_map: FlatMap, outputs: Sequence[str]) -> None:
    """Print notes, quality and outputs of a map."""
    metrics = flat_map.metrics
    for note in metrics["notes"]:
        print(f"Note: {note}")
    print(
        f"{metrics['points']} points, {metrics['triangles']} triangles; "
        f"folded triangles {metrics['folded_triangles']}, overlapping pairs {metrics['overlapping_pairs']}"
    )
    print(
        f"beta mean {metrics['beta']['mean']:.3f}, dilatation median {metrics['dilatation']['median']:.2f}, "
        f"99th percentile {metrics['dilatation']['p99']:.1f}; rim error {metrics['rim_error']:.1e}, "
        f"path drift {metrics['path_drift']:.1e} disk radii"
    )
    print(
        f"method {metrics['method']}, template {metrics['template']}, "
        f"{metrics['seconds']['total']:.2f} s from seeds to map"
    )
    print("Wrote " + ", ".join(str(path) for path in outputs))
