"""The paper's overview: raw atrium, division, map."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from atria import Atrium
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from pictures import PATH, RIM, Drawn, page, panel, scale_bar, show_atrium, show_line, show_map

from LAFlatteningLib import make_phantom
from LAFlatteningLib.division import label_regions
from LAFlatteningLib.shading import REGION_COLOURS, region_paint
from LAFlatteningLib.views import PatientFrame


def draw(atrium: Atrium) -> Drawn:
    """The five regions on the atrium, from behind and from the front, and on its map."""
    flat_map = atrium.map()
    anatomy, surface = flat_map.template.anatomy, flat_map.division.surface
    paint = region_paint(label_regions(flat_map.division, anatomy), anatomy)
    raw = not atrium.key
    figure = page(12.0 if raw else 9.6, 3.9)
    panels = 4 if raw else 3
    places = [(0.01 + k * 0.99 / panels, 0.13, 0.96 / panels, 0.74) for k in range(panels)]
    if raw:
        # Only of the phantom is the atrium before it was cut at hand for certain.
        axes = panel(figure, places.pop(0), "1  Atrium as segmented, from behind")
        show_atrium(axes, make_phantom(20000, closed=True).surface, PatientFrame.of_space("LPS").view("posterior"))
        scale_bar(axes)
    for step, (name, words) in enumerate((("posterior", "from behind"), ("anterior", "from the front"))):
        axes = panel(figure, places[step], f"2  Cavity and regions, {words}")
        view = PatientFrame.of_space(surface.space).view(name)
        raster = show_atrium(axes, surface, view, paint)
        for ids in flat_map.division.paths.values():
            show_line(axes, raster, surface, view, ids, PATH, 1.2)
        for ids in flat_map.division.loops.values():
            show_line(axes, raster, surface, view, np.append(ids, ids[0]), RIM, 1.4)
        scale_bar(axes)
    show_map(panel(figure, places[2], "3  Standard map"), flat_map, paint, cut=True)
    _legend(figure, anatomy.region_names)
    caption = (
        f"From atrium to map ({atrium.title}). Nine paths between the seeds divide the cavity into five regions; each "
        "goes to its place on the disk. The rim of the mitral valve becomes the rim of the disk, the ostia become "
        f"fixed circles. {len(flat_map.folded_triangles)} triangles are folded."
    )
    return Drawn("overview", figure, caption)


def _legend(figure: Figure, names: Mapping[int, str]) -> None:
    handles = [
        Patch(facecolor=REGION_COLOURS[number - 1], label=f"R{number} {names[number]}") for number in sorted(names)
    ]
    figure.legend(handles=handles, loc="lower center", ncols=len(handles), frameon=False, fontsize=8)
