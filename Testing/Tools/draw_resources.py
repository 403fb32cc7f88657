"""Draw the module's pictures: its icon, the thumbnail of the sample data, and the diagrams that show where a seed goes.

make resources      or      python Testing/Tools/draw_resources.py

Everything comes from the library (phantom, template, colours), so that the diagrams cannot disagree with the method.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from LAFlatteningLib import Phantom, Template, make_phantom
from LAFlatteningLib.shading import REGION_COLOURS, array_paint, rasterise, shade
from LAFlatteningLib.views import PatientFrame, View

RESOURCES = Path(__file__).resolve().parents[2] / "LAFlattening" / "Resources"
POINTS = 8000
"""Of the phantom in the pictures."""
ICON_PIXELS = 128
THUMBNAIL_PIXELS = (260, 280)
DIAGRAM_PIXELS = (400, 200)
"""Atrium left, map right; small enough for a narrow panel."""
DOTS_PER_INCH = 100

INK, FAINT = "#1a1a1a", "#808080"
WALL = (0.86, 0.80, 0.76)
INSIDE = (0.42, 0.40, 0.40)
NEXT, PLACED = "#d40000", "#ffffff"
SEEN_FROM = {"RSPV": "posterior", "RIPV": "posterior", "LIPV": "posterior", "LSPV": "posterior", "LAA": "anterior"}
"""View in which an opening can be seen; the valve, and what is on its rim, from the front."""


def page(pixels: tuple[int, int]) -> Figure:
    """An empty picture of that many pixels."""
    return Figure(figsize=(pixels[0] / DOTS_PER_INCH, pixels[1] / DOTS_PER_INCH), dpi=DOTS_PER_INCH)


def frame(figure: Figure, place: tuple[float, float, float, float]) -> Axes:
    """Axes without frame, at a place given as shares of the picture."""
    axes = figure.add_axes(place)
    axes.set_axis_off()
    axes.set_aspect("equal")
    return axes


def draw_template(axes: Axes, template: Template, line: float, room: float) -> None:
    """The disk with its regions and holes, and room round it, in disk radii."""
    for region in template.anatomy.regions:
        axes.add_patch(Polygon(template.region_outline(region), facecolor=REGION_COLOURS[region - 1], edgecolor="none"))
    for path in template.anatomy.paths:
        axes.plot(*template.segment(path).T, color=INK, linewidth=line, solid_capstyle="round")
    for opening in template.anatomy.openings:
        outline = template.rim(opening).shape.outline()
        face = "none" if opening == template.anatomy.outer else "white"
        axes.add_patch(Polygon(outline, facecolor=face, edgecolor=INK, linewidth=1.5 * line, zorder=3))
    reach = (1.0 + room) * template.radius
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach))


def draw_atrium(axes: Axes, phantom: Phantom, view: View, pixels: int, array: str | None = None) -> None:
    """The phantom in one view, `pixels` wide and high."""
    surface = phantom.surface
    projected = view.project(surface.points)
    low, high = projected[:, :2].min(axis=0), projected[:, :2].max(axis=0)
    side = 1.2 * float((high - low).max())
    left, bottom = 0.5 * (low + high) - 0.5 * side
    raster = rasterise(projected, surface.triangles, left, bottom, side / pixels, (pixels, pixels))
    wall = np.array(WALL) if array is None else array_paint(surface, array).rgb(raster)
    colours = np.where(raster.front[:, None], wall, INSIDE)
    image = np.ones((pixels, pixels, 4))
    image[~raster.covered, 3] = 0.0
    image[raster.covered, :3] = shade(raster, colours, raster.interpolate(view.project(surface.point_normals)))
    axes.imshow(image, extent=raster.extent, origin="lower", interpolation="antialiased")
    axes.set(xlim=raster.extent[:2], ylim=raster.extent[2:])


def map_place(template: Template, seed: str) -> np.ndarray:
    """Where a seed lies on the map: the centre of its hole, or the foot of its path on the outer rim, (2,)."""
    anatomy = template.anatomy
    if seed in anatomy.holes:
        return np.array(template.rim(seed).shape.centre)
    path = next(path for path, ends in anatomy.paths.items() if seed in ends)
    return template.foot(path, anatomy.paths[path].index(seed))


def draw_diagram(phantom: Phantom, template: Template, seed: str | None) -> Figure:
    """Atrium and map with all seeds; one of them, the next to place, stands out. None: all are placed."""
    figure = page(DIAGRAM_PIXELS)
    anatomy = template.anatomy
    name = SEEN_FROM.get(anatomy.opening_of(seed), "anterior") if seed else "posterior"
    view = PatientFrame.of_space(phantom.surface.space).view(name)
    atrium, disk = frame(figure, (0.0, 0.0, 0.5, 0.93)), frame(figure, (0.5, 0.0, 0.5, 0.93))
    draw_atrium(atrium, phantom, view, 2 * DIAGRAM_PIXELS[1])
    draw_template(disk, template, 0.7, 0.2)
    for label in anatomy.seeds:
        on_atrium = view.project(phantom.seeds[label][None])[0]
        normal = phantom.seeds[label] - phantom.surface.points.mean(axis=0)
        faces_viewer = view.project(normal[None])[0, 2] > 0
        on_map = map_place(template, label)
        if label != seed:
            disk.plot(*on_map, "o", markersize=3.5, color=FAINT, zorder=4, clip_on=False)
            if faces_viewer:
                atrium.plot(*on_atrium[:2], "o", markersize=3.5, color=FAINT)
            continue
        for axes, place in ((atrium, on_atrium[:2]), (disk, on_map)):
            axes.plot(*place, "o", markersize=8, color=NEXT, markeredgecolor="white", zorder=5, clip_on=False)
            span = axes.get_xlim()[1] - axes.get_xlim()[0]
            axes.add_patch(Circle(place, 0.08 * span, fill=False, edgecolor=NEXT, linewidth=1.6, zorder=5))
    text = "seen from behind" if name == "posterior" else "seen from the front"
    for x, words in ((0.25, f"atrium, {text}"), (0.75, "map")):
        figure.text(x, 0.985, words, ha="center", va="top", fontsize=7.5, color=INK)
    sides = ("left", "right") if name == "posterior" else ("right", "left")
    for x, side, align in ((0.005, sides[0], "left"), (0.495, sides[1], "right")):
        figure.text(x, 0.02, f"patient's {side}", ha=align, va="bottom", fontsize=6, color=FAINT)
    return figure


def main() -> None:
    """Write all pictures."""
    phantom, template = make_phantom(POINTS), Template.load("adapted1")
    icon = page((ICON_PIXELS, ICON_PIXELS))
    draw_template(frame(icon, (0.0, 0.0, 1.0, 1.0)), template, 1.4, 0.04)
    thumbnail = page(THUMBNAIL_PIXELS)
    view = PatientFrame.of_space(phantom.surface.space).view("posterior")
    draw_atrium(frame(thumbnail, (0.0, 0.0, 1.0, 1.0)), phantom, view, 2 * THUMBNAIL_PIXELS[1], "LGE")
    pictures = {"Icons/LAFlattening.png": icon, "Icons/LeftAtriumSynthetic.png": thumbnail}
    for seed in (*template.anatomy.seeds, None):
        pictures[f"SeedDiagrams/{seed or 'complete'}.png"] = draw_diagram(phantom, template, seed)
    for name, figure in pictures.items():
        path = RESOURCES / name
        path.parent.mkdir(parents=True, exist_ok=True)
        # Without a date or a version in the file, the same picture is the same file.
        figure.savefig(path, transparent="Icons" in name, metadata={"Software": None})
        print(path.relative_to(RESOURCES.parents[1]))


if __name__ == "__main__":
    main()
