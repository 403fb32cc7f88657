"""From a surface and its seeds to the map."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from .. import operators
from ..cavity.openings import Cavity, make_cavity, nearest_rim
from ..constraints import Constraints, constraints_by_count, constraints_by_length
from ..distortion import folded_triangles
from ..division import Division, divide_as_published
from ..errors import FoldError, SeedError, SurfaceError
from ..line_division import divide
from ..ostium_ways import WaysAcrossOstia
from ..progress import ProgressCallback, Stopwatch, part, report
from ..seed_paths import WaysOverCovers, connect_seeds
from ..seeds import SnappedSeeds, check_labels, snap_seeds
from ..solvers import harmonic, published_least_squares
from ..subcontours import ROUNDINGS
from ..surface import FloatArray, IntArray, Surface
from ..template import DEFAULT_TEMPLATE, Template
from .chords import flip_chords, flip_folded, split_crossing
from .coarse import COARSE_POINTS, COARSE_STEPS, CoarseCopy, Start, coarsened
from .flat_map import FlatMap
from .preview import Preview, Previewer
from .refinement import Refinement
from .template_preview import TemplatePreviewer
from .untangling import fold_error, untangle

METHODS = ("regional", "paper")
"""``regional``: lengths, hard rims and paths, never a fold. ``paper``: the published equations."""


FLIPS = 3
"""Most times that edges between neighbouring rims are flipped and the surface is divided again."""
FROM_COARSE = 2500
"""Cavities with more points than this are mapped from the map of their coarse copy on."""


class Flattener:
    """Flattens one surface, as often as its seeds move.

    What does not depend on the seeds (covers, cavity, operators) is computed once and kept.

    Parameters
    ----------
    surface : an atrium open at its openings, or with covers marked by a point array ``hole`` (`make_cavity`).
    template : a template, the name of a built-in one, or the path of a template file.
    method : "regional" or "paper".
    rounding : of the sub-contour rule, for the method "paper": see `subcontours.ROUNDINGS`.
    check_axes : whether seeds that contradict the patient axes of the surface are refused. If not, its axes are taken
        for unknown, as where the surface says so itself (`Surface.axes_known`).

    Examples
    --------
    >>> from LAFlatteningLib.phantom import make_phantom
    >>> phantom = make_phantom(2000)
    >>> flat_map = Flattener(phantom.surface).flatten(phantom.seeds)
    >>> len(flat_map.folded_triangles)
    0
    """

    def __init__(
        self,
        surface: Surface,
        template: Template | str | Path = DEFAULT_TEMPLATE,
        method: str = "regional",
        rounding: str = "paper",
        check_axes: bool = True,
    ) -> None:
        if method not in METHODS:
            raise ValueError(f'Expected method {" or ".join(METHODS)}; found "{method}".')
        if rounding not in ROUNDINGS:
            raise ValueError(f'Expected rounding {", ".join(ROUNDINGS)}; found "{rounding}".')
        self.surface = surface if check_axes else surface.with_unknown_axes()
        self.template = template if isinstance(template, Template) else Template.load(template)
        self.method = method
        self.rounding = rounding
        # Copies without the surface's own word go by it, too.
        self.check_axes = check_axes and surface.axes_known
        self._prepared: tuple[Cavity, Surface, int] | None = None
        self._ways: WaysAcrossOstia | None = None
        self._is_copy = False
        self._latest: FlatMap | None = None
        self._given: Mapping[str, FloatArray] = {}
        self._start: Start | None = None
        self._copy: CoarseCopy | None = None
        self._coarse: Flattener | None = None
        self._previewer: Previewer | None = None
        self._template_previewer: TemplatePreviewer | None = None

    def with_template(self, template: Template | str | Path) -> Flattener:
        """A flattener of the same surface for another template; it takes over what does not depend on the template.

        Raises
        ------
        TemplateError : of the template.
        """
        other = Flattener(self.surface, template, self.method, self.rounding, self.check_axes)
        if other.template.anatomy == self.template.anatomy:
            other._is_copy = self._is_copy
            other._prepared, other._ways = self._prepared, self._ways
            if self._copy is not None and self._coarse is not None:
                other._coarse = self._coarse.with_template(other.template)
                other._copy = self._copy.made_by(other._coarse._flatten_from)
        return other

    def flatten(self, seeds: Mapping[str, FloatArray], progress: ProgressCallback | None = None) -> FlatMap:
        """The map for these seeds.

        Parameters
        ----------
        seeds : label -> (3,) mm in the axes of the surface, one for each of `Anatomy.seeds`.
        progress : told how far the work is; may stop it.

        Raises
        ------
        SurfaceError, SeedError : input that cannot be right, saying why.
        FoldError : method "regional" only: folds that could not be undone, saying where.
        Cancelled : by `progress`.
        """
        watch = Stopwatch()
        anatomy = self.template.anatomy
        report(progress, 0.0, "Checking and covering the openings")
        with watch.stage("cavity"):
            seeds = check_labels(seeds, anatomy)
            cavity, surface, flipped = self._prepare(np.array([seeds[label] for label in anatomy.outer_seeds]))
        freed = np.zeros(0, np.int64)
        try:
            report(progress, 0.15, "Dividing the surface into regions")
            with watch.stage("division"):
                snapped = snap_seeds(seeds, cavity, anatomy)
                if self.method == "paper":
                    connected = connect_seeds(cavity, snapped, anatomy, WaysOverCovers(cavity), self.check_axes)
                    division = divide_as_published(cavity.surface, connected, self.template, self.rounding)
                    constraints = constraints_by_count(division, self.template, self.rounding == "paper")
                else:
                    division, constraints = self._divide(cavity, surface, snapped)
                    for _ in range(FLIPS):
                        surface, more = flip_folded(surface, [*cavity.rims, cavity.outer], division, constraints)
                        if not more:
                            break
                        flipped += more
                        division, constraints = self._divide(cavity, surface, snapped)
                    division = split_crossing(division, constraints)
            report(progress, 0.3, "Flattening")
            if self.method == "paper":
                flat = self._solve_as_published(surface, constraints, watch, progress)
            else:
                flat, freed = self._solve(surface, snapped, division, constraints, watch, progress)
        except np.linalg.LinAlgError as error:
            raise SurfaceError(
                "The equations of the map have no unique solution, because triangles of the surface have all but no "
                "area. Remesh the surface evenly."
            ) from error
        report(progress, 1.0, "Done")
        # Quick maps begin from it: nobody may change it.
        flat.flags.writeable = False
        self._latest = FlatMap(
            flat,
            surface,
            cavity,
            snapped,
            division,
            constraints,
            self.template,
            self.method,
            self.rounding if self.method == "paper" else None,
            flipped,
            freed,
            watch.stop(),
        )
        self._given = {label: place.copy() for label, place in seeds.items()}
        return self._latest

    def preview(self, seeds: Mapping[str, FloatArray]) -> Preview:
        """A quick map for these seeds, to show while one is being moved; see `preview.Preview`.

        The first call after another surface or another outer rim takes longer than the following ones, and so does
        the first call after `flatten`.

        Raises
        ------
        SurfaceError, SeedError, FoldError : as `flatten` would; now and then one for the coarse copy alone.
        """
        seeds = check_labels(seeds, self.template.anatomy)
        outer_points = np.array([seeds[label] for label in self.template.anatomy.outer_seeds])
        cavity, surface, _ = self._prepare(outer_points)
        copy = self._coarse_copy(surface, outer_points)
        if self._previewer is None or self._previewer.surface is not surface:
            self._previewer = Previewer(copy)
        latest = self._latest if self._latest is not None and self._latest.cavity is cavity else None
        # On this surface, not on the coarse one, seeds go to their places.
        snapped = snap_seeds(seeds, cavity, self.template.anatomy)
        rims = {hole: cavity.rims[number] for hole, number in snapped.hole.items()}
        rims[self.template.anatomy.outer] = cavity.outer
        return self._previewer.preview(snapped.positions, rims, latest)

    def preview_template(self, template: Template, seeds: Mapping[str, FloatArray]) -> Preview:
        """A quick map for these seeds on another template of the same anatomy, to show while that is being edited.

        The map of the seeds is made if the last one is of others, which takes its time; what comes then is quick.

        Raises
        ------
        SurfaceError, SeedError, FoldError : as `flatten`.
        TemplateError : a template of another anatomy.
        """
        latest, seeds = self._latest, check_labels(seeds, self.template.anatomy)
        if latest is None or not all(np.array_equal(self._given[label], place) for label, place in seeds.items()):
            latest = self.flatten(seeds)
        if self._template_previewer is None or self._template_previewer.flat_map is not latest:
            self._template_previewer = TemplatePreviewer(latest)
        return self._template_previewer.preview(template)

    def _coarse_copy(self, surface: Surface, outer_points: FloatArray) -> CoarseCopy:
        if self._copy is not None and self._copy.surface is surface:
            return self._copy
        bare = Surface(surface.points, surface.triangles, space=surface.space)
        for points in (*COARSE_POINTS, len(surface.points)):
            coarse = Flattener(coarsened(bare, points), self.template, self.method, self.rounding, self.check_axes)
            coarse._is_copy = True
            try:
                _, coarse_surface, _ = coarse._prepare(outer_points)
                break
            except (SurfaceError, FoldError):
                # Decimation spoiled the mesh; with all its points it is as it was.
                continue
        self._coarse, self._copy = coarse, CoarseCopy(coarse_surface, surface, coarse._flatten_from)
        return self._copy

    def _flatten_from(self, seeds: Mapping[str, FloatArray], start: Start | None) -> FlatMap:
        """The map for these seeds, made from places that points of the surface start from."""
        self._start = start
        return self.flatten(seeds)

    def _prepare(self, outer_points: FloatArray) -> tuple[Cavity, Surface, int]:
        """The cavity, its surface as it is flattened, and the number of edges flipped for that."""
        if self._prepared is not None:
            cavity = self._prepared[0]
            if nearest_rim(cavity.surface, [*cavity.rims, cavity.outer], outer_points) == len(cavity.rims):
                return self._prepared
        cavity = make_cavity(self.surface, self.template.anatomy, outer_points)
        surface, flipped = cavity.surface, 0
        if self.method == "regional":
            surface, flipped = flip_chords(surface, [*cavity.rims, cavity.outer])
        self._prepared = (cavity, surface, flipped)
        return self._prepared

    def _divide(self, cavity: Cavity, surface: Surface, seeds: SnappedSeeds) -> tuple[Division, Constraints]:
        """The division by the method "regional" of the cavity's surface, some of its edges flipped."""
        ways = self._ways
        if ways is None or ways.surface is not surface:
            ways = WaysAcrossOstia(cavity, surface)
            if self._prepared is not None and surface is self._prepared[1]:
                self._ways = ways
        connected = connect_seeds(cavity, seeds, self.template.anatomy, ways, self.check_axes)
        division = divide(surface, ways.mesh, connected, self.template)
        return division, constraints_by_length(division, self.template)

    def _solve_as_published(
        self, surface: Surface, constraints: Constraints, watch: Stopwatch, progress: ProgressCallback | None
    ) -> FloatArray:
        report(progress, 0.3, "Flattening")
        with watch.stage("solve"):
            # The published matrix has no factor 1/2 in its off-diagonal entries.
            first = published_least_squares(
                2.0 * surface.laplacian,
                constraints.rim_ids,
                constraints.rim_targets,
                constraints.path_ids,
                constraints.path_targets,
            )
        report(progress, 0.7, "Refining the rims")
        with watch.stage("refine"):
            refined = operators.cotangent_laplacian(first, surface.triangles)
            return harmonic(refined, constraints.rim_ids, constraints.rim_targets)[0]

    def _solve(
        self,
        surface: Surface,
        seeds: SnappedSeeds,
        division: Division,
        constraints: Constraints,
        watch: Stopwatch,
        progress: ProgressCallback | None,
    ) -> tuple[FloatArray, IntArray]:
        """A map without folds of the points of `Division.surface`, and the path points that had to leave their places
        for it."""
        cut = division.surface
        fixed = np.zeros(len(cut.points), bool)
        fixed[constraints.rim_ids] = True
        loose = np.zeros_like(fixed)
        loose[constraints.path_ids] = True
        placed = np.zeros((len(cut.points), 2))
        placed[constraints.ids] = constraints.targets
        # What the rims enclose does not depend on the points between them.
        scale = float(np.sqrt(operators.signed_areas(placed, cut.triangles).sum() / cut.area))
        report(progress, 0.3, "Flattening")
        with watch.stage("coarse map"):
            carried = self._carried(surface, seeds, cut)
        best: tuple[Refinement, FloatArray, IntArray] | None = None
        for start in (carried, None) if carried is not None else (None,):
            try:
                with watch.stage("solve"):
                    refinement = Refinement(placed, cut, ~(fixed | loose), scale)
                    if start is None:
                        flat, _ = harmonic(cut.laplacian, constraints.ids, constraints.targets)
                    else:
                        flat = refinement.follow(start, placed)
                report(progress, 0.4, "Turning back folded triangles")
                with watch.stage("untangle"):
                    flat, freed = untangle(flat, cut.triangles, cut.points, fixed, loose)
            except (FoldError, np.linalg.LinAlgError):
                if start is None and best is None:
                    raise
                continue
            if best is None or len(freed) < len(best[2]):
                best = refinement, flat, freed
            # The coarse map may pass an opening on the other side. (A copy's own map before does not.)
            if self._start is not None or not len(freed):
                break
        assert best is not None
        refinement, flat, freed = best
        told = part(progress, 0.5, 1.0)
        if self._is_copy:
            with watch.stage("refine"):
                return refinement.lower(flat, COARSE_STEPS, False, told), freed
        with watch.stage("refine"):
            flat = refinement.lower(flat, progress=told)
            # Triangles that paths cut must not fold as a whole either: the map is theirs, too.
            guarded = surface.triangles[np.bincount(division.parent) > 1]
            flat, more = refinement.guard(flat, guarded, fixed, loose)
        # The promise of this method, checked on every map.
        for checked in (cut.triangles, guarded):
            left = folded_triangles(flat, checked)
            if len(left):
                raise fold_error(cut.points, checked[left])
        return flat, np.union1d(freed, more)

    def _carried(self, surface: Surface, seeds: SnappedSeeds, cut: Surface) -> FloatArray | None:
        """The map to start from, or that of the coarse copy, at the points of the cut surface; None where there is
        none."""
        if self._start is not None:
            return self._start(cut.points)
        if len(surface.points) < FROM_COARSE or self._is_copy:
            return None
        assert self._prepared is not None
        outer_points = np.array([seeds.positions[label] for label in self.template.anatomy.outer_seeds])
        try:
            return self._coarse_copy(self._prepared[1], outer_points).carried(seeds.positions, cut.points)
        except (SurfaceError, SeedError, FoldError):
            return None


def flatten(
    surface: Surface,
    seeds: Mapping[str, FloatArray],
    template: Template | str | Path = DEFAULT_TEMPLATE,
    method: str = "regional",
    rounding: str = "paper",
    check_axes: bool = True,
    progress: ProgressCallback | None = None,
) -> FlatMap:
    """Flatten a surface once; see `Flattener` for the parameters and errors."""
    return Flattener(surface, template, method, rounding, check_axes).flatten(seeds, progress)
