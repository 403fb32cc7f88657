"""A template as text: the name of a built-in one, or the content of a template file (JSON).

A text is what settings and parameters hold, so that a scene carries its user's template with it.
"""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path

from slicer.parameterNodeWrapper import Validator

from LAFlatteningLib import Template, TemplateError, builtin_templates


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


class IsTemplate(Validator):
    """The value of a parameter is the text of a template."""

    def validate(self, value: str) -> None:
        """Raise ValueError with the reason if it is not."""
        try:
            if not isContent(value) and value not in builtin_templates():
                raise TemplateError(
                    f'There is no template "{value}". Expected one of {", ".join(builtin_templates())}.'
                )
            templateOf(value)
        except TemplateError as error:
            raise ValueError(str(error)) from error
