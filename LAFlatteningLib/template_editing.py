"""Templates made of others: a hole moved or scaled, the foot of a path moved along its rim, another name.

Every function returns a new template that is as sound as the first one, or raises `TemplateError` with what would be
impossible about it (overlapping holes, a path that crosses a hole, feet out of order ...).

Examples
--------
>>> from LAFlatteningLib import Template
>>> template = Template.load("adapted1")
>>> hole = template.anatomy.holes[0]
>>> wider = scale_hole(template, hole, 1.2)
>>> round(wider.holes[hole].shape.semi_axes[0] / template.holes[hole].shape.semi_axes[0], 4)
1.2
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from .errors import TemplateError
from .template import Rim, Template, builtin_templates

SMALLEST_HOLE = 0.01
"""Smallest semi-axis of a hole after scaling, in radii of the map."""
EDITED = "edited"
"""What is added to the name of a template when it is edited."""


def move_hole(template: Template, hole: str, centre: ArrayLike) -> Template:
    """Move a hole; the feet of its paths keep their angles, and the paths stay straight.

    Parameters
    ----------
    centre : (2,) where its centre goes, map units.

    Raises
    ------
    TemplateError : no such hole, a place that is no number, or an impossible layout.
    """
    x, y = (float(value) for value in np.asarray(centre, dtype=np.float64))
    if not np.isfinite([x, y]).all():
        raise TemplateError(f"holes.{hole}.shape.centre: expected two finite numbers, found {x:g}, {y:g}.")
    rim = _hole(template, hole)
    return _with_hole(template, hole, replace(rim, shape=replace(rim.shape, centre=(x, y))))


def scale_hole(template: Template, hole: str, factor: float) -> Template:
    """Make a hole larger or smaller about its centre; an ellipse keeps its form.

    Parameters
    ----------
    factor : of its semi-axes, above 0.

    Raises
    ------
    TemplateError : no such hole, a factor that is not above 0, a hole that vanishes, or an impossible layout.
    """
    if not (np.isfinite(factor) and factor > 0.0):
        raise TemplateError(f"holes.{hole}.shape: expected a factor above 0, found {factor:g}.")
    rim = _hole(template, hole)
    a, b = rim.shape.semi_axes
    if min(a, b) * factor < SMALLEST_HOLE * template.radius:
        raise TemplateError(
            f"holes.{hole}.shape: would be smaller than {100 * SMALLEST_HOLE:g} % of the radius of the map, too small "
            "to be seen. Keep it larger."
        )
    return _with_hole(
        template, hole, replace(rim, shape=replace(rim.shape, semi_axes=(float(a * factor), float(b * factor))))
    )


def move_foot(template: Template, opening: str, path: str, degrees: float) -> Template:
    """Move the foot of a path along the rim of an opening, such as a mitral seed along the outer rim.

    Parameters
    ----------
    degrees : the new angle, counter-clockwise about the centre of the opening.

    Raises
    ------
    TemplateError : no such opening, no such path on its rim, no finite angle, or an impossible layout.
    """
    if opening not in template.anatomy.openings:
        raise TemplateError(f'"{opening}": unknown opening; expected {", ".join(template.anatomy.openings)}.')
    rim = template.rim(opening)
    if path not in rim.feet:
        raise TemplateError(f'"{path}" does not meet the rim of {opening}; expected {", ".join(rim.feet) or "none"}.')
    if not np.isfinite(degrees):
        raise TemplateError(f"{opening}, foot of {path}: expected an angle in degrees, found {degrees:g}.")
    moved = replace(rim, feet={**rim.feet, path: float(degrees) % 360.0})
    if opening == template.anatomy.outer:
        return _edited(template, outer=moved)
    return _with_hole(template, opening, moved)


def renamed(template: Template, name: str) -> Template:
    """The same layout under another name.

    Raises
    ------
    TemplateError : a name that a template file may not have, or that of a built-in template.
    """
    if not re.fullmatch(r"[A-Za-z0-9_-]+", name):
        raise TemplateError(f'name: expected letters, digits, "-" and "_", found "{name}".')
    if name in builtin_templates():
        raise TemplateError(f'name: "{name}" is the name of a built-in template. Choose another one.')
    return replace(template, name=name)


def _hole(template: Template, hole: str) -> Rim:
    if hole not in template.holes:
        raise TemplateError(f'"{hole}": unknown hole; {template.name} has {", ".join(template.holes) or "none"}.')
    return template.holes[hole]


def _with_hole(template: Template, hole: str, rim: Rim) -> Template:
    return _edited(template, holes={**template.holes, hole: rim})


def _edited(template: Template, **changes: object) -> Template:
    """A template with changes, under a name that is not that of a built-in one."""
    if template.name not in builtin_templates():
        return replace(template, **changes)  # type: ignore[arg-type]
    return replace(
        template,
        name=f"{template.name}-{EDITED}",
        title=f"{template.title or template.name}, {EDITED}",
        source=f"{EDITED} from {template.name}",
        **changes,  # type: ignore[arg-type]
    )
