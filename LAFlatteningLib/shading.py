"""Pictures of a surface without a graphics card: a depth-buffer rasteriser, shading, colours.

A surface is projected (`views.View.project`), rasterised (`rasterise`: which triangle is in front at each pixel), its
array is turned into colours (`Paint`), and these are shaded (`shade`). A flat map is rasterised likewise, with depth 0.
All of it is numpy, so that figures come out alike on a server, in a thread and within other programs.

Colours
-------
Scalars are drawn in matplotlib's "plasma": equal steps of the value look equally large, it is readable with any colour
blindness and in print, and it still runs from blue (low) to warm colours (high) as late-enhancement pictures do; the
usual rainbow shows borders where there are none. Voltage and activation time are reversed ("plasma_r"), because mapping
systems draw low voltage and early activation warm: scar is warm either way. Region colours are the "light" set of
P. Tol's colour-blind-safe schemes, on which black text is legible.
"""

from __future__ import annotations

import re
import textwrap
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from .anatomy import Anatomy
from .errors import LAFlatteningError
from .quantities import unit_of
from .surface import Surface

if TYPE_CHECKING:
    from matplotlib.colors import Colormap, Normalize

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

LIGHT = (-0.35, 0.50, 0.79)
"""Where light comes from: right on the page, up, towards the viewer."""
AMBIENT, DIFFUSE, SHEEN = 0.52, 0.52, 0.11
"""Share of a colour that is there without light, what light straight on adds to it, and the white of a highlight
(without which dark colours show no shape)."""
OUTLINE = 0.45
"""How much of a colour is left where the surface ends in front of something farther away."""

NO_VALUE = "#b5b5b5"
REGION_COLOURS = ("#77AADD", "#EE8866", "#EEDD88", "#AAAA00", "#FFAABB", "#99DDFF", "#44BB99", "#BBCC33")
DEFAULT_ARRAYS = (r"lge", r"scalars", r".*(bip|voltage).*", r"lat")
"""What is shown if nothing is named, by preference: patterns of point array names, upper and lower case alike."""
REVERSED_ARRAYS = r".*(bipolar|unipolar|voltage|activation).*|lat"
"""Arrays of which low values are drawn warm, likewise."""
MAX_CLASSES = 8
"""An array of whole numbers with no more different values than this is drawn as classes."""

VISIBLE_MM = 1.0
"""A point of the surface is hidden where the surface is farther in front of it than this."""
FRAGMENTS_AT_ONCE = 2_000_000
"""Pixels tested at a time; bounds the memory."""


@dataclass(frozen=True, eq=False)
class Raster:
    """Which triangle is seen at each pixel.

    Attributes
    ----------
    projected : (n, 3) page position and depth of the points: right, up, towards the viewer.
    triangles : (m, 3) point ids.
    triangle : (h, w) index of the triangle in front, -1 where there is none; row 0 is at the bottom.
    depth : (h, w) its distance towards the viewer, -inf where there is none.
    left, bottom : page position of the lower left corner of the picture.
    pixel : side of a pixel, in page units.
    """

    projected: FloatArray
    triangles: IntArray
    triangle: IntArray
    depth: FloatArray
    left: float
    bottom: float
    pixel: float

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top of the picture in page units."""
        height, width = self.triangle.shape
        return (self.left, self.left + width * self.pixel, self.bottom, self.bottom + height * self.pixel)

    @cached_property
    def covered(self) -> BoolArray:
        """(h, w) where the surface is seen."""
        return self.triangle >= 0

    @cached_property
    def _planes(self) -> tuple[FloatArray, FloatArray]:
        return _share_planes(self.projected, self.triangles)

    @cached_property
    def weights(self) -> FloatArray:
        """(k, 3) shares of the corners of the triangle at each covered pixel, in row order; they sum to 1."""
        row, column = np.nonzero(self.covered)
        x, y = self.left + (column + 0.5) * self.pixel, self.bottom + (row + 0.5) * self.pixel
        plane = self._planes[0][self.triangle[self.covered]]
        shares = np.empty((len(x), 3))
        for k in (0, 1):
            shares[:, k] = plane[:, k, 0] * x + plane[:, k, 1] * y + plane[:, k, 2]
        shares[:, 2] = 1.0 - shares[:, 0] - shares[:, 1]
        return shares

    @cached_property
    def front(self) -> BoolArray:
        """(k,) for each covered pixel whether the outside is seen: corners counter-clockwise on the page."""
        return (self._planes[1] > 0)[self.triangle[self.covered]]

    def interpolate(self, values: FloatArray) -> FloatArray:
        """Point values (n,) or (n, c) at the covered pixels, (k,) or (k, c): linear on each triangle."""
        corner = self.triangles[self.triangle[self.covered]]
        if values.ndim == 1:
            return np.einsum("ij,ij->i", self.weights, values[corner])
        return np.einsum("ij,ijc->ic", self.weights, values[corner])

    def nearest(self, values: FloatArray) -> FloatArray:
        """Point values (n,) at the covered pixels, (k,): those of the nearest corner (for labels)."""
        corner = self.triangles[self.triangle[self.covered]]
        return values[corner[np.arange(len(corner)), self.weights.argmax(axis=1)]]

    def is_visible(self, projected: FloatArray) -> BoolArray:
        """Whether points (k, 3) of the same projection are in front of the surface, on it, or behind it by no more
        than `VISIBLE_MM`; points beside the picture are not."""
        row, column, inside = self._pixels(projected)
        height, width = self.depth.shape
        # The farthest of 3 x 3 pixels: on a slope, or at an outline, the surface is not hidden by itself.
        farthest = np.full(len(projected), np.inf)
        for up in (-1, 0, 1):
            for right in (-1, 0, 1):
                near = self.depth[np.clip(row + up, 0, height - 1), np.clip(column + right, 0, width - 1)]
                farthest = np.minimum(farthest, near)
        return inside & (projected[:, 2] >= farthest - VISIBLE_MM)

    def _pixels(self, projected: FloatArray) -> tuple[IntArray, IntArray, BoolArray]:
        """Row and column of points, moved into the picture, and whether they were inside."""
        height, width = self.depth.shape
        column = np.floor((projected[:, 0] - self.left) / self.pixel).astype(np.int64)
        row = np.floor((projected[:, 1] - self.bottom) / self.pixel).astype(np.int64)
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        return np.clip(row, 0, height - 1), np.clip(column, 0, width - 1), inside

    def visible_part(self, line: FloatArray, normals: FloatArray | None = None) -> FloatArray:
        """A line (k, 3) of page position and depth, sampled finely, with NaN where it is hidden, (j, 2).

        Parameters
        ----------
        normals : (k, 3) of the surface there, on the page. The line is then hidden also on the inner side of the
            wall, seen through an opening.
        """
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        at = np.linspace(0.0, length[-1], 2 + int(length[-1] / (4.0 * self.pixel)))
        fine = np.stack([np.interp(at, length, line[:, axis]) for axis in range(3)], axis=1)
        seen = self.is_visible(fine)
        if normals is not None:
            row, column, _ = self._pixels(fine)
            triangle = self.triangle[row, column]
            inner_side = (triangle >= 0) & (self._planes[1][triangle] <= 0)
            # Just round the outline, a line may still be seen against the background.
            seen &= (np.interp(at, length, normals[:, 2]) > -0.25) & ~inner_side
        return np.where(seen[:, None], fine[:, :2], np.nan)

    def inmost_places(self, labels: IntArray, seen: BoolArray) -> dict[int, tuple[FloatArray, float]]:
        """For each label of triangles, (m,), the place deepest inside its area, (2,), and its distance to the border.

        Parameters
        ----------
        seen : (k,) which of the covered pixels count.
        """
        label = np.full(self.triangle.shape, -1)
        label[self.covered] = np.where(seen, labels[self.triangle[self.covered]], -1)
        # Every fourth pixel is precise enough; the padding makes the edge of the picture a border.
        coarse = np.pad(label[::4, ::4], 1, constant_values=-1)
        places = {}
        for number in np.unique(coarse[coarse >= 0]):
            depth = distance_transform_edt(coarse == number)
            # In a long region many places are about as deep: the one in their middle.
            deep = np.argwhere(depth > 0.95 * depth.max())
            row, column = deep[np.linalg.norm(deep - deep.mean(axis=0), axis=1).argmin()]
            at = np.array([self.left, self.bottom]) + (4.0 * np.array([column - 1, row - 1]) + 0.5) * self.pixel
            places[int(number)] = (at, float(depth.max()) * 4.0 * self.pixel)
        return places


def rasterise(
    projected: FloatArray, triangles: IntArray, left: float, bottom: float, pixel: float, shape: tuple[int, int]
) -> Raster:
    """Find the triangle in front at each pixel: a depth buffer.

    Parameters
    ----------
    projected : (n, 3) right, up, towards the viewer, in page units; or (n, 2) for a flat mesh.
    triangles : (m, 3) point ids.
    left, bottom : page position of the lower left corner of the picture.
    pixel : side of a pixel, page units.
    shape : rows and columns.

    A pixel belongs to a triangle if its centre does. Triangles seen from the edge cover no pixel.

    Examples
    --------
    >>> square = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
    >>> rasterise(square, np.array([[0, 1, 2], [0, 2, 3]]), -1.0, 0.0, 1.0, (2, 4)).covered.sum(axis=0).tolist()
    [0, 2, 2, 0]
    """
    if projected.shape[1] == 2:
        projected = np.column_stack([projected, np.zeros(len(projected))])
    height, width = shape
    plane, twice_area = _share_planes(projected, triangles)
    corner = projected[triangles]
    # Depth is a linear function of the page position, as the shares of the corners are.
    depth_plane = np.einsum("mkc,mk->mc", plane, corner[:, :2, 2] - corner[:, 2:, 2])
    depth_plane[:, 2] += corner[:, 2, 2]
    low = np.ceil((corner[:, :, :2].min(axis=1) - (left, bottom)) / pixel - 0.5).astype(np.int64)
    high = np.floor((corner[:, :, :2].max(axis=1) - (left, bottom)) / pixel - 0.5).astype(np.int64)
    low, high = np.maximum(low, 0), np.minimum(high, (width - 1, height - 1))
    span = np.maximum(high - low + 1, 0)
    drawn = np.flatnonzero((span > 0).all(axis=1) & (twice_area != 0))
    count = span[drawn, 0] * span[drawn, 1]
    total = np.concatenate([[0], np.cumsum(count)])
    depth = np.full(height * width, -np.inf)
    seen = np.full(height * width, -1, np.int64)
    first = 0
    while first < len(drawn):
        last = max(first + 1, int(np.searchsorted(total, total[first] + FRAGMENTS_AT_ONCE, side="right")) - 1)
        part, copies = drawn[first:last], count[first:last]
        index = np.repeat(part, copies)
        step = np.arange(copies.sum()) - np.repeat(total[first:last] - total[first], copies)
        row, column = np.divmod(step, span[index, 0])
        row, column = row + low[index, 1], column + low[index, 0]
        x, y = left + (column + 0.5) * pixel, bottom + (row + 0.5) * pixel
        a = plane[index, 0, 0] * x + plane[index, 0, 1] * y + plane[index, 0, 2]
        b = plane[index, 1, 0] * x + plane[index, 1, 1] * y + plane[index, 1, 2]
        inside = (a >= -1e-9) & (b >= -1e-9) & (a + b <= 1.0 + 1e-9)
        index, x, y = index[inside], x[inside], y[inside]
        at = row[inside] * width + column[inside]
        towards = depth_plane[index, 0] * x + depth_plane[index, 1] * y + depth_plane[index, 2]
        np.maximum.at(depth, at, towards)
        won = towards == depth[at]
        seen[at[won]] = index[won]
        first = last
    return Raster(projected, triangles, seen.reshape(shape), depth.reshape(shape), left, bottom, pixel)


def _share_planes(projected: FloatArray, triangles: IntArray) -> tuple[FloatArray, FloatArray]:
    """Shares of the first two corners at (x, y), as (m, 2, 3) factors of (x, y, 1), 0 for triangles without area; and
    twice the areas, (m,), positive where the corners are counter-clockwise on the page."""
    a, b, c = (projected[triangles[:, k], :2] for k in range(3))
    twice_area = (a[:, 0] - c[:, 0]) * (b[:, 1] - c[:, 1]) - (b[:, 0] - c[:, 0]) * (a[:, 1] - c[:, 1])
    plane = np.zeros((len(triangles), 2, 3))
    plane[:, 0, 0], plane[:, 0, 1] = b[:, 1] - c[:, 1], c[:, 0] - b[:, 0]
    plane[:, 1, 0], plane[:, 1, 1] = c[:, 1] - a[:, 1], a[:, 0] - c[:, 0]
    plane[:, :, 2] = -plane[:, :, 0] * c[:, :1] - plane[:, :, 1] * c[:, 1:]
    safe = np.where(twice_area != 0, twice_area, 1.0)
    return plane / safe[:, None, None], twice_area


def shade(raster: Raster, colours: FloatArray, normals: FloatArray) -> FloatArray:
    """Colours (k, 3), 0 to 1, of the covered pixels in the light of `LIGHT`: matte, with a faint highlight (Lambert,
    Phong), and darker where the surface ends in front of something farther away.

    Parameters
    ----------
    normals : (k, 3) on the page: right, up, towards the viewer. They need not have length 1; back sides are lit as
        front sides.
    """
    length = np.linalg.norm(normals, axis=1)
    length[length == 0] = 1.0
    light = np.array(LIGHT) / np.linalg.norm(LIGHT)
    lit = np.maximum((normals @ light) * np.where(normals[:, 2] < 0, -1.0, 1.0) / length, 0.0)
    shaded = colours * (AMBIENT + DIFFUSE * lit)[:, None] + SHEEN * (lit**8)[:, None]
    depth = np.pad(raster.depth, 1, mode="edge")
    height, width = raster.depth.shape
    farthest = np.full((height, width), np.inf)
    for up, right in ((0, 1), (2, 1), (1, 0), (1, 2)):
        np.minimum(farthest, depth[up : up + height, right : right + width], out=farthest)
    # A slope of 84 degrees is still the surface itself.
    with np.errstate(invalid="ignore"):
        ends = (raster.depth - farthest > 10.0 * raster.pixel)[raster.covered]
    shaded[ends] *= OUTLINE
    return np.clip(shaded, 0.0, 1.0)


# ---- colours ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Paint:
    """How an array becomes colours.

    Attributes
    ----------
    label : what is shown, with its unit.
    values : one number a point, or a triangle; NaN where there is none. Of classes: their index.
    on_points : whether `values` belong to points.
    cmap, norm : from matplotlib.
    ticks : value and text of each tick of the colour bar; None leaves them to matplotlib.
    classes : whether values are labels, between which nothing is interpolated.
    extend : "neither", "min", "max" or "both": at which end of the colour bar values go on beyond it.
    """

    label: str
    values: FloatArray
    on_points: bool
    cmap: Colormap
    norm: Normalize
    ticks: list[tuple[float, str]] | None = None
    classes: bool = False
    extend: str = "neither"

    @property
    def any_missing(self) -> bool:
        """Whether some values are NaN, drawn in `NO_VALUE`."""
        return bool(np.isnan(self.values).any())

    def rgb(self, raster: Raster) -> FloatArray:
        """Colours of the covered pixels, (k, 3), 0 to 1."""
        if not self.on_points:
            return self.colours_of(self.values[raster.triangle[raster.covered]])
        return self.colours_of(raster.nearest(self.values) if self.classes else raster.interpolate(self.values))

    def colours_of(self, values: FloatArray) -> FloatArray:
        """Colours (k, 3) of values (k,)."""
        from matplotlib.colors import to_rgb

        colours = np.asarray(self.cmap(np.asarray(self.norm(values))))[:, :3]
        colours[np.isnan(values)] = to_rgb(NO_VALUE)
        return colours


def default_array(surface: Surface) -> str | None:
    """The first scalar point array of `DEFAULT_ARRAYS`, or None."""
    scalars = [name for name, array in surface.point_data.items() if _is_scalar(array)]
    found = (name for pattern in DEFAULT_ARRAYS for name in scalars if re.fullmatch(pattern, name, re.IGNORECASE))
    return next(found, None)


def _is_scalar(array: NDArray) -> bool:
    return array.dtype.kind in "biuf" and array.size == len(array)


def array_paint(surface: Surface, name: str) -> Paint:
    """The colours of an array: whole numbers of few values as classes, others from their 1st to 99th percentile.

    Raises
    ------
    LAFlatteningError : no such array, or not a scalar one, listing those that can be drawn.
    """
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap, Normalize

    found = {**surface.cell_data, **surface.point_data}
    scalars = {key: array for key, array in found.items() if _is_scalar(array)}
    if name not in scalars:
        problem = (
            f"has shape {found[name].shape} and type {found[name].dtype}" if name in found else "is not on the surface"
        )
        raise LAFlatteningError(
            f'The array "{name}" {problem}. Expected an array with one number a point or triangle '
            f"({', '.join(sorted(scalars)) or 'there is none'}), or no name, to draw the regions."
        )
    values = scalars[name].reshape(-1).astype(np.float64)
    values[~np.isfinite(values)] = np.nan
    finite = values[np.isfinite(values)]
    on_points, label = name in surface.point_data, label_of(name)
    cmap = colormaps["plasma_r" if re.fullmatch(REVERSED_ARRAYS, name, re.IGNORECASE) else "plasma"]
    if not len(finite):
        return Paint(f"{label}: no value anywhere", values, on_points, cmap, Normalize(0.0, 1.0), [])
    kinds = np.unique(finite)
    if len(kinds) <= MAX_CLASSES and (kinds == np.round(kinds)).all():
        index = np.where(np.isnan(values), np.nan, np.searchsorted(kinds, np.nan_to_num(values)))
        # Neither end of the colour map: the darkest blue hides the shading, yellow is faint on white.
        steps = ListedColormap(cmap(np.linspace(0.12, 0.85, len(kinds)) if len(kinds) > 1 else [0.5]))
        ticks = [(float(k), f"{kind:g}") for k, kind in enumerate(kinds)]
        return Paint(name, index, on_points, steps, Normalize(-0.5, len(kinds) - 0.5), ticks, classes=True)
    low, high = (float(end) for end in np.percentile(finite, [1, 99]))
    if low == high:
        low, high = float(kinds[0]), float(kinds[-1])
    beyond = {(False, False): "neither", (True, False): "min", (False, True): "max", (True, True): "both"}
    extend = beyond[bool(kinds[0] < low), bool(kinds[-1] > high)]
    if low == high:
        low, high = low - 0.1 * abs(low), high + 0.1 * abs(high)
    return Paint(label, values, on_points, cmap, Normalize(low, high), extend=extend)


def region_paint(regions: IntArray, anatomy: Anatomy) -> Paint:
    """The colours of region numbers, (m,), with their names."""
    from matplotlib.colors import ListedColormap, Normalize

    numbers = sorted(anatomy.regions)
    colours = ListedColormap([REGION_COLOURS[k % len(REGION_COLOURS)] for k in range(len(numbers))])
    ticks = [(float(k), textwrap.fill(f"R{n} {anatomy.region_names[n]}", 14)) for k, n in enumerate(numbers)]
    index = np.searchsorted(numbers, regions).astype(np.float64)
    return Paint("regions", index, False, colours, Normalize(-0.5, len(numbers) - 0.5), ticks, classes=True)


def label_of(name: str) -> str:
    """An array's name with its unit: as the name says, as mapping systems export, or "a.u." (arbitrary units).

    Examples
    --------
    >>> label_of("wall_thickness_mm"), label_of("Bipolar"), label_of("LAT [ms]"), label_of("LGE")
    ('wall thickness (mm)', 'Bipolar (mV)', 'LAT [ms]', 'LGE (a.u.)')
    """
    if re.search(r"[(\[][^)\]]*[)\]]\s*$", name):
        return name
    if suffix := re.fullmatch(r"(.+)_(mm2?|ms|mV|percent)", name):
        return f"{suffix[1].replace('_', ' ')} ({suffix[2].replace('percent', '%')})"
    return f"{name} ({unit_of(name) or 'a.u.'})"
