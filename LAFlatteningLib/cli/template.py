"""``la-flatten template``: lists, checks and draws templates."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..errors import InputFileError
from ..page import check_figure_path
from ..template import Template, builtin_templates
from ..template_editing import renamed
from ..template_figure import draw_template
from .command import Subcommands, add_command, check_distinct
from .progress import Progress


def add(commands: Subcommands) -> None:
    """Add the command."""
    template = add_command(
        commands,
        "template",
        run,
        "List the built-in templates, check a template file, or draw a template.",
        "la-flatten template adapted1 --output adapted1.png",
    )
    template.add_argument(
        "template", nargs="?", metavar="NAME|FILE.json", help="a built-in template, or a file: it is checked"
    )
    template.add_argument("--list", action="store_true", help="list the built-in templates (as without arguments)")
    template.add_argument("--check", metavar="FILE.json", help="check a template file and say what is wrong with it")
    template.add_argument("--output", metavar="F.png", help="draw the template (.png .pdf .svg)")
    template.add_argument(
        "--copy",
        metavar="FILE.json",
        help="write the template as a file of that name, to begin one's own with",
    )


def run(options: argparse.Namespace, progress: Progress) -> None:
    """List, check, draw."""
    name_or_path = _asked_for(options)
    check_distinct(options, ("template", "check", "output", "copy"))
    if options.output:
        check_figure_path(options.output)
    if name_or_path is None:
        _list()
        return
    template = Template.load(name_or_path)
    _describe(template)
    if options.copy:
        renamed(template, Path(options.copy).stem).save(options.copy)
        print(f"Wrote {options.copy}")
    if options.output:
        progress(0.3, "Drawing")
        draw_template(template, options.output)
        progress.clear()
        print(f"Wrote {options.output}")


def _asked_for(options: argparse.Namespace) -> str | None:
    """The template that is meant; None for the list."""
    if options.template and options.check:
        raise InputFileError("--check FILE.json names the template already: leave the other one out.")
    chosen: str | None = options.template or options.check
    if options.list and chosen:
        raise InputFileError("--list lists the built-in templates: give it alone.")
    if chosen is None and (options.output or options.copy):
        raise InputFileError(f"Which template? Give {', '.join(builtin_templates())}, or a template file.")
    if options.check and not Path(options.check).exists():
        raise InputFileError(f"{options.check}: there is no such file.")
    return chosen


def _list() -> None:
    width = max(map(len, builtin_templates()))
    for name in builtin_templates():
        template = Template.load(name)
        print(f"{name:<{width}}  {template.title} ({len(template.anatomy.seeds)} seeds)")


def _describe(template: Template) -> None:
    anatomy = template.anatomy
    print(f"{template.name}: {template.title or 'no title'}. No fault found.")
    print(f"anatomy {anatomy.name}, {len(anatomy.regions)} regions; outer rim {anatomy.outer}")
    print(f"openings: {', '.join(anatomy.openings)}")
    print(f"seeds: {', '.join(anatomy.seeds)}")
    if template.source:
        print(f"source: {template.source}")
