"""How good maps are, in pictures: strategies, refinement of the rims, sizes, distortion on templates, patterns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from atria import Atrium, scans, varied_phantoms
from cases import DATA
from matplotlib.collections import LineCollection
from pictures import INK, Drawn, page, panel

from LAFlatteningLib import Flattener, MapData, Template, builtin_templates, distortion
from LAFlatteningLib.flattening.strategies import STRATEGIES, flatten_by_strategy
from LAFlatteningLib.measurement import measure
from LAFlatteningLib.peers.sum_map import SumTemplate
from LAFlatteningLib.shape_statistics import tabulate
from LAFlatteningLib.study_figures import make_box_plots, make_maps_figure, make_study_figure, make_texture_figure
from LAFlatteningLib.textures import circles, stripes

TEMPLATES = ("population", "adapted1", "adapted2")
TITLES = {
    "mitral": "(a) valve rim only",
    "rims": "(b) all rims",
    "paths": "(c) rims and paths",
    "refined": "(d) refined: method paper",
}
ZOOMED = ("LSPV", "RIPV", "RSPV")


def strategies(atrium: Atrium) -> Drawn:
    """The four strategies of the paper, and the method regional."""
    maps = {}
    for name in STRATEGIES:
        made = flatten_by_strategy(atrium.surface, atrium.seeds, name)
        maps[TITLES[name]] = (MapData.of(made), made.regions)
    made = atrium.map()
    maps["method regional"] = (MapData.of(made), made.regions)
    folds = {name: len(distortion.folded_triangles(data.flat, data.triangles)) for name, (data, _) in maps.items()}
    figure = make_maps_figure(maps, title="Four strategies, and the method regional")
    caption = (
        f"Strategies ({atrium.title}): (a) only the rim of the valve on its circle, (b) all rims, (c) rims and paths "
        "(equations 3-4), (d) the rims refined (equations 5-6), and the method `regional`. Red crosses: folded "
        f"triangles ({', '.join(f'{name} {count}' for name, count in folds.items())})."
    )
    return Drawn("strategies", figure, caption)


def refinement(atrium: Atrium) -> Drawn:
    """Rims before and after the refinement of the published method, and their targets."""
    before, after = (flatten_by_strategy(atrium.surface, atrium.seeds, name) for name in ("paths", "refined"))
    figure = page(10.5, 4.0)
    edges = after.surface.edges.points
    for k, opening in enumerate(ZOOMED):
        axes = panel(figure, (0.01 + k / 3, 0.04, 0.31, 0.80), opening)
        for made, colour in ((before, "#d40000"), (after, "#2a9d3a")):
            axes.add_collection(LineCollection(list(made.points[edges]), colors=colour, linewidths=0.35, alpha=0.7))
            loop = made.division.loops[opening]
            axes.plot(*made.solution[np.append(loop, loop[0])].T, color=colour, linewidth=1.6)
        shape = after.template.rim(opening).shape
        outline = shape.outline()
        axes.plot(*np.concatenate([outline, outline[:1]]).T, color=INK, linewidth=1.0)
        reach = 1.8 * max(shape.semi_axes)
        axes.set(xlim=shape.centre[0] + reach * np.array([-1, 1]), ylim=shape.centre[1] + reach * np.array([-1, 1]))
    figure.text(0.01, 0.93, "Rims before (red) and after (green) the refinement; targets black", size=11, color=INK)
    caption = (
        f"Refinement of the rims (method `paper`, {atrium.title}). Before it (red) rims are off their circles by up to "
        f"{100 * before.rim_error:.1f} % of the disk radius; after it (green) by {100 * after.rim_error:.0e} %. The "
        f"paths, exact before, are then off their lines by up to {100 * after.path_drift:.1f} %. "
        f"{len(before.folded_triangles)} triangles are folded before and {len(after.folded_triangles)} after."
    )
    return Drawn("refinement", figure, caption)


def patterns(atrium: Atrium) -> Drawn:
    """Stripes by distance from a point between the veins, and circles."""
    data = MapData.of(atrium.map())
    middle = np.mean([data.template.holes[vein].shape.centre for vein in ("RSPV", "RIPV", "LIPV", "LSPV")], axis=0)
    source = data.surface.points[np.linalg.norm(data.flat - middle, axis=1).argmin()]
    drawn = [stripes(data.surface, source, 5.0), circles(data.surface, 100)]
    caption = (
        f"Patterns on an atrium and on its map ({atrium.title}): {drawn[0].title} from a point between the veins, and "
        f"{drawn[1].title}. All points of the atrium are on the map, so no circle is lost or blurred."
    )
    return Drawn("patterns", make_texture_figure(data, drawn), caption)


def templates(atrium: Atrium) -> Drawn:
    """Distortion of one atrium on the three templates."""
    maps = {name: MapData.of(atrium.map(template=name)) for name in TEMPLATES if name in builtin_templates()}
    return _distortion(maps, atrium.title, "templates")


def sum_atlas() -> Drawn | None:
    """Distortion of SUM's own atlas on its disk, and of our maps of it."""
    folder = DATA / "sum_atlas"
    if not folder.is_dir():
        return None
    atlas = SumTemplate.load(folder / "template_3d.vtp", folder / "template_disk.vtp")
    maps = {"SUM": MapData(atlas.surface, atlas.disk, Template.load("adapted2"))}
    for name in TEMPLATES:
        maps[name] = MapData.of(Flattener(atlas.surface, name, check_axes=False).flatten(atlas.seeds))
    return _distortion(maps, "the SUM atlas, 6132 points", "templates_sum")


def _distortion(maps: dict[str, MapData], title: str, name: str) -> Drawn:
    first = next(iter(maps.values()))
    figure = make_study_figure(maps, pattern=circles(first.surface, 100))
    words = []
    for key, data in maps.items():
        mesh = distortion.summary(data.surface.points, data.triangles, data.flat)
        words.append(f"{key} beta {mesh['beta']['mean']:.3f}, entropy of alpha {mesh['alpha']['entropy']:.2f}")
    caption = (
        f"Distortion ({title}): triangles, area ratio alpha, isotropy beta, circles of equal size, histograms. "
        f"{'; '.join(words)}."
    )
    return Drawn(name, figure, caption)


def box_plots(atria: Sequence[Atrium], what: str) -> Drawn:
    """Sizes of several atria."""
    table = tabulate({atrium.key: measure(atrium.surface, atrium.seeds) for atrium in atria})

    def medians(group: str, names: tuple[str, ...]) -> str:
        return ", ".join(f"{name} {np.median(table.spread(group, name).values):.2f}" for name in names)

    ratios = medians("perimeter ratio", ("LSPV", "RIPV", "RSPV", "LAA"))
    lengths = medians("path ratio", ("s1", "s8", "s4", "s2"))
    caption = (
        f"Sizes of {len(table.names)} {what}. Median perimeters over that of LIPV: {ratios} (published: 1.14, 1.13, "
        f"1.34, 1.39); median lengths over that of s3: {lengths} (published: 1.09, 1.59, 3.72, 3.81)."
    )
    return Drawn("box_plots", make_box_plots(table), caption)


def population() -> Sequence[Atrium]:
    """Synthetic atria of other sizes."""
    return list(varied_phantoms())


def real_population() -> Sequence[Atrium]:
    """Atria of LGE-MRI that were found."""
    return list(scans())


def template_spread(atria: Sequence[Atrium], what: str) -> Drawn:
    """Isotropy and entropy of alpha of several atria on the three templates."""
    figure = page(9.0, 4.2)
    rows = {name: [atrium.map(template=name).distortion_summary for atrium in atria] for name in TEMPLATES}
    words = []
    for k, (label, pick) in enumerate(
        (
            ("isotropy β, mean over triangles (1)", lambda row: row["beta"]["mean"]),
            ("entropy of α (nat)", lambda row: row["alpha"]["entropy"]),
        )
    ):
        axes = figure.add_axes((0.09 + 0.5 * k, 0.14, 0.38, 0.7))
        values = [[pick(row) for row in rows[name]] for name in TEMPLATES]
        axes.boxplot(values, medianprops={"color": "#b03000"}, flierprops={"marker": ""})
        for j, column in enumerate(values, 1):
            axes.plot(np.full(len(column), j), column, "o", color="#3366aa", markersize=3)
        axes.set_xticks(range(1, len(TEMPLATES) + 1), TEMPLATES)
        axes.set_ylabel(label, size=9)
        axes.spines[["top", "right"]].set_visible(False)
        medians = ", ".join(f"{name} {np.median(column):.3f}" for name, column in zip(TEMPLATES, values, strict=True))
        words.append(f"median {label.split(',')[0].split(' (')[0]}: {medians}")
    figure.text(0.5, 0.92, f"{len(atria)} {what} on three templates", size=12, color=INK, ha="center")
    caption = f"Distortion of {len(atria)} {what} on three templates, method `regional`; {'; '.join(words)}."
    return Drawn("template_spread", figure, caption)
