"""A template as text: the name of a built-in one, or the content of a template file (JSON).

A text is what settings and parameters hold, so that a scene carries its user's template with it.
"""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path

from slicer.parameterNodeWrapper import Validator

from LAFlatteningLib import LEFT_ATRIUM, Template, TemplateError, builtin_templates


@lru_cache(maxsize=64)
def templateOf(text: str) -> Template:
    """The template of a text; of the path of a template file too.

    Raises
    ------
    TemplateError : no such template, or what is wrong with it.
    InputFileError : a file that cannot be read.
    """
    if not isContent(text):
        return Template.load(text)
    try:
        content = json.loads(text)
    except json.JSONDecodeError as error:
        raise TemplateError(f"Expected the content of a template file (JSON), found text that is none: {error}.") from (
            error
        )
    return Template.from_dict(content)


def textOf(template: Template | str | Path) -> str:
    """The text of a template, of a built-in one by name, or of a file. Errors as `templateOf`."""
    if not isinstance(template, Template):
        if str(template) in builtin_templates() or isContent(str(template)):
            return str(template)
        template = Template.load(template)
    if template.name in builtin_templates() and template == Template.load(template.name):
        return template.name
    return json.dumps(template.to_dict(), ensure_ascii=False)


def isContent(text: str) -> bool:
    """Whether a text is the content of a template, not a name."""
    return text.lstrip().startswith("{")


def panelTemplate(text: str) -> Template:
    """The template of a text, if the panel can use it: one of the left atrium, built in or the content of a file.

    Raises
    ------
    TemplateError : no template, or one of another chamber.
    """
    names = builtin_templates(LEFT_ATRIUM.name)
    if not isContent(text) and text not in builtin_templates():
        raise TemplateError(f'There is no template "{text}". Expected one of {", ".join(names)}.')
    template = templateOf(text)
    if template.anatomy != LEFT_ATRIUM:
        raise TemplateError(
            f'Expected a template of "{LEFT_ATRIUM.name}", found "{template.name}", which is one of '
            f'"{template.anatomy.name}". Choose {", ".join(names)} or a copy of one of them; other chambers are laid '
            "out by the command la-flatten flatten --template."
        )
    return template


class IsTemplate(Validator):
    """The value of a parameter is the text of a template that the panel can use, see `panelTemplate`."""

    def __init__(self, mayBeEmpty: bool = False) -> None:
        self._mayBeEmpty = mayBeEmpty

    def validate(self, value: str) -> None:
        """Raise ValueError with the reason if it is not."""
        try:
            if value or not self._mayBeEmpty:
                panelTemplate(value)
        except TemplateError as error:
            raise ValueError(str(error)) from error
