"""A quick map while a template is being edited: the last map, moved along with its rims and paths."""

from __future__ import annotations

import numpy as np

from ..constraints import Constraints, constraints_by_count, constraints_by_length
from ..errors import TemplateError
from ..solvers import Factorisation
from ..template import Template
from .flat_map import FlatMap
from .preview import Preview


class TemplatePreviewer:
    """Shows one map on other templates of its anatomy.

    Seeds, and so rims and paths on the atrium, stay; only their places on the map change. The other points move by the
    harmonic displacement (of the Laplacian of the atrium) that brings rims and paths there, so that the map of the same
    template is the map itself. A displacement of rims by a good part of their distance may fold triangles.

    Parameters
    ----------
    flat_map : the map.
    """

    def __init__(self, flat_map: FlatMap) -> None:
        self.flat_map = flat_map
        self._from = flat_map.constraints
        laplacian = flat_map.division.surface.laplacian
        free = np.ones(laplacian.shape[0], bool)
        free[self._from.ids] = False
        self._free = np.flatnonzero(free)
        rows = laplacian[self._free]
        self._to_fixed = rows[:, self._from.ids]
        self._factorisation = Factorisation(rows[:, self._free])

    def preview(self, template: Template) -> Preview:
        """The quick map on a template.

        Raises
        ------
        TemplateError : a template of another anatomy.
        """
        if template.anatomy != self.flat_map.template.anatomy:
            raise TemplateError(
                f"Expected a template of the anatomy {self.flat_map.template.anatomy.name}, as that of the map; "
                f"{template.name} is one of {template.anatomy.name}. Make the map anew."
            )
        # By how much, not to where: a few path points of the map may have left their places.
        displacement = self._constraints(template).targets - self._from.targets
        solution = self.flat_map.solution.copy()
        solution[self._from.ids] += displacement
        solution[self._free] -= self._factorisation.solve(self._to_fixed @ displacement)
        surface, division = self.flat_map.surface, self.flat_map.division
        lines = {name: division.surface.points[ids] for name, ids in division.paths.items()}
        return Preview(solution[: len(surface.points)], surface, self.flat_map.regions, template, lines)

    def _constraints(self, template: Template) -> Constraints:
        if self.flat_map.method == "paper":
            return constraints_by_count(self.flat_map.division, template, self.flat_map.rounding == "paper")
        return constraints_by_length(self.flat_map.division, template)
