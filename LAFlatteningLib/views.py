"""Where the patient's left, back and head are in the coordinates of a surface, and the views of it by them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from .anatomy import Anatomy
from .errors import SeedError
from .seeds import check_directions
from .surface import Surface

FloatArray = NDArray[np.float64]

OPPOSITE = {
    "left": "right",
    "right": "left",
    "posterior": "anterior",
    "anterior": "posterior",
    "superior": "inferior",
    "inferior": "superior",
}

ROWS = ("left", "posterior", "superior")
"""The patient's directions that are the rows of `PatientFrame.axes`: those of LPS."""

STANDARD_VIEWS: dict[str, tuple[str, str, str]] = {
    "posterior": ("right", "superior", "posterior"),
    "anterior": ("left", "superior", "anterior"),
}
"""View -> the patient's directions that point right on the page, up on the page, and towards the viewer."""

_SEEN_FROM = {"posterior": "behind", "anterior": "the front"}
_SIDES = {"posterior": "one side", "anterior": "the other side"}
"""What the views are called where the patient's directions are not known."""

AXES_UNKNOWN = "the axes of the file are unknown"
AXES_CONTRADICTED = "the seeds contradict the axes of the file"
ESTIMATED, LEFT_OUT = "directions estimated from the seeds", "no directions of the patient"


@dataclass(frozen=True, eq=False)
class View:
    """An orthographic view of a patient.

    Attributes
    ----------
    name : "posterior" (from behind) or "anterior" (from the front); "one side" or "the other side" where the patient's
        directions are not known.
    right, up, towards : the patient's directions that point right on the page, up, and towards the viewer; empty where
        they are not known.
    axes : (3, 3) rows: these directions as unit vectors.
    """

    name: str
    right: str
    up: str
    towards: str
    axes: FloatArray

    @property
    def title(self) -> str:
        """What is seen, in two or three words."""
        return f"{self.name} view" if self.towards else self.name

    @property
    def heading(self) -> str:
        """What is seen, for a line above the picture."""
        if not self.towards:
            return f"{self.name[0].upper()}{self.name[1:]} (directions of the patient unknown)"
        return f"Seen from {_SEEN_FROM[self.towards]} ({self.towards} view)"

    @property
    def ends(self) -> dict[str, str]:
        """Side of the page ("left", "right", "bottom", "top") -> the patient's direction there; empty where they are
        not known."""
        if not self.towards:
            return {}
        return {"left": OPPOSITE[self.right], "right": self.right, "bottom": OPPOSITE[self.up], "top": self.up}

    def project(self, points: FloatArray) -> FloatArray:
        """Points (n, 3) mm -> (n, 3) mm: right on the page, up on the page, towards the viewer."""
        return points @ self.axes.T


@dataclass(frozen=True, eq=False)
class PatientFrame:
    """The directions of the patient in the coordinates of a surface.

    Attributes
    ----------
    axes : (3, 3) rows: unit vectors to the patient's left, back and head; None where they are not known.
    fact : what to say about them below a figure; empty where they are those that the file states.
    """

    axes: FloatArray | None
    fact: str = ""

    @classmethod
    def of_space(cls, space: str) -> PatientFrame:
        """That of "LPS" or "RAS" coordinates.

        Examples
        --------
        >>> PatientFrame.of_space("RAS").direction("anterior").tolist()
        [0.0, 1.0, 0.0]
        """
        return cls(np.diag([1.0, 1.0, 1.0] if space == "LPS" else [-1.0, -1.0, 1.0]))

    @classmethod
    def of(cls, surface: Surface, seeds: Mapping[str, FloatArray], anatomy: Anatomy | None = None) -> PatientFrame:
        """That which the surface states; estimated from its seeds where it does not know, or where they contradict it.

        Parameters
        ----------
        seeds : label of a seed, or name of an opening -> (3,) mm; may be empty.
        anatomy : of the seeds.
        """
        reason = "" if surface.axes_known else AXES_UNKNOWN
        if anatomy is not None and not reason and set(seeds) >= {*anatomy.holes, *anatomy.landmarks}:
            try:
                check_directions(seeds, surface.space, anatomy)
            except SeedError:
                reason = AXES_CONTRADICTED
        if not reason:
            return cls.of_space(surface.space)
        axes = None if anatomy is None else estimate_axes(surface, seeds, anatomy)
        return cls(axes, f"{LEFT_OUT if axes is None else ESTIMATED}: {reason}")

    def direction(self, name: str) -> FloatArray:
        """Unit vector, (3,), of a direction of the patient ("left", "anterior"...).

        Raises
        ------
        ValueError : the directions are not known.
        """
        if self.axes is None:
            raise ValueError("Expected a frame with axes; found one of which the directions are not known.")
        # Adding zero turns -0.0 into 0.0.
        return 0.0 + (self.axes[ROWS.index(name)] if name in ROWS else -self.axes[ROWS.index(OPPOSITE[name])])

    def view(self, name: str) -> View:
        """One of `STANDARD_VIEWS`; where the directions are not known, that of coordinates in LPS, without words.

        Examples
        --------
        From behind, the patient's left is on the left of the page:

        >>> PatientFrame.of_space("LPS").view("posterior").project(np.array([[1.0, 0.0, 0.0]])).tolist()
        [[-1.0, 0.0, 0.0]]
        """
        directions = STANDARD_VIEWS[name]
        if self.axes is None:
            return View(_SIDES[name], "", "", "", PatientFrame.of_space("LPS").view(name).axes)
        return View(name, *directions, axes=np.stack([self.direction(d) for d in directions]))

    @property
    def views(self) -> tuple[View, View]:
        """From behind and from the front."""
        return self.view("posterior"), self.view("anterior")


def estimate_axes(surface: Surface, seeds: Mapping[str, FloatArray], anatomy: Anatomy) -> FloatArray | None:
    """The patient's directions as the openings of an atrium tell them: (3, 3) as `PatientFrame.axes`.

    The mean layout of the anatomy is turned to fit the directions from the middle of the surface to its openings best
    (Kabsch 1976); never mirrored. On real atria this is off by as much as their heart lies turned in the chest from
    the mean: 4 to 19 degrees on nine of them (most of which are in that mean), 34 on the phantom.

    Parameters
    ----------
    seeds : as for `PatientFrame.of`. The outer opening is where its seeds are in the mean, or at its own name.

    Returns
    -------
    None where the anatomy states no layout, or an opening has no seed.
    """
    places = {name: np.asarray(place, np.float64) for name, place in seeds.items()}
    if set(places) >= set(anatomy.outer_seeds):
        places[anatomy.outer] = np.mean([places[seed] for seed in anatomy.outer_seeds], axis=0)
    if not anatomy.layout or not set(places) >= set(anatomy.openings):
        return None
    middle = np.average(surface.points[surface.triangles].mean(axis=1), axis=0, weights=surface.triangle_areas)
    found = _units(np.array([places[opening] - middle for opening in anatomy.openings]))
    layout = _units(np.array([anatomy.layout[opening] for opening in anatomy.openings]))
    turn, _ = Rotation.align_vectors(found, layout)
    return turn.as_matrix().T


def _units(vectors: FloatArray) -> FloatArray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
