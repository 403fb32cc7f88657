"""Our maps beside those of others: one table an atrium, the SUM template laid flat by each method, and universal atrial
coordinates against those that were published with an atrium.

python Testing/Benchmarks/bench_peers.py
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import cases
import numpy as np
from scipy import sparse

from LAFlatteningLib import LEFT_ATRIUM, Flattener, Surface, distortion, read_surface, topology
from LAFlatteningLib.geodesics import PathTree
from LAFlatteningLib.peers import universal
from LAFlatteningLib.peers.peer_map import place_spread
from LAFlatteningLib.peers.sum_map import SumTemplate
from LAFlatteningLib.peers.table import compare_peers
from LAFlatteningLib.seed_suggestion import suggest_seeds

TAGS = {"LAA": 13, "LSPV": 21, "LIPV": 23, "RSPV": 25, "RIPV": 27}
"""Cell array ``tag`` of the atrium with published universal coordinates; the body is 11."""
BODY = 11
ON_LINE = 1e-6
STRAIGHT = {0: (0.23, 0.77), 1: (0.255, 0.375, 0.61)}
"""Values of x and y that a hundred published points have exactly: lines between the ends of the ellipses."""


def sum_template() -> SumTemplate | None:
    """The template of SUM, where it is present."""
    folder = cases.DATA / "sum_atlas"
    return SumTemplate.load(folder / "template_3d.vtp", folder / "template_disk.vtp") if folder.is_dir() else None


def peers(template: SumTemplate | None) -> None:
    """A table for each atrium, and how far the openings are apart on the real ones."""
    maps: dict[str, list] = {}
    for name, surface, seeds in [("phantom", *cases.phantom(20000)), *cases.real()]:
        table = compare_peers(surface, seeds, template)
        print(f"\n{name}\n\n{table.to_markdown()}", flush=True)
        if name != "phantom":
            for found in table.maps:
                maps.setdefault(found.title, []).append(found)
    print("\n| map | spread of the openings over the real atria, % of half width |\n|---|---|")
    for title, found in maps.items():
        print(f"| {title} | {100.0 * place_spread(found, LEFT_ATRIUM.holes):.1f} |", flush=True)


def atlas(template: SumTemplate) -> None:
    """The template of SUM laid flat by its own map and by ours."""
    head = ("map of the SUM template", "folded", "beta mean", "median", "above .8", "alpha entropy", "5 to 95 %")
    print(f"\n| {' | '.join(head)} |\n{'|---' * len(head)}|")
    surface = template.surface
    rows = {"SUM, its own map": (surface, template.disk)}
    for method in ("paper", "regional"):
        for name in ("population", "adapted1", "adapted2"):
            flat_map = Flattener(surface, name, method, check_axes=False).flatten(template.seeds)
            rows[f"{method}, {name}"] = (flat_map.surface, flat_map.points)
    for title, (mesh, flat) in rows.items():
        figures = distortion.summary(mesh.points, mesh.triangles, flat)
        alpha, beta = figures["alpha"], figures["beta"]
        folded = len(distortion.folded_triangles(flat, mesh.triangles))
        near_one = 100.0 * np.mean(distortion.isotropy(mesh.points, mesh.triangles, flat) > 0.8)
        print(
            f"| {title} | {folded} | {beta['mean']:.3f} | {beta['median']:.3f} | {near_one:.0f} % | "
            f"{alpha['entropy']:.2f} | {alpha['p5']:.2f} to {alpha['p95']:.2f} |",
            flush=True,
        )


def published_coordinates() -> tuple[Surface, np.ndarray, dict[str, np.ndarray]]:
    """The body of an atrium cut at its ostia, its published coordinates with x from lateral to septal, and its rims."""
    surface = read_surface(cases.DATA / "labelled" / "dtmri_endo1.vtp")
    # It is in axes of its own (x to the patient's right, y to the front), and not oriented.
    surface = replace(surface, triangles=topology.orient(surface.triangles, surface.edges), space="RAS")
    if surface.enclosed_volume < 0:
        surface = surface.with_triangles(surface.triangles[:, ::-1])
    tag = surface.cell_data["tag"].astype(int)
    body, ids = surface.submesh(tag == BODY)
    published = np.stack([1.0 - body.point_data["UAC_alpha"], body.point_data["UAC_beta"]], axis=1)
    loops = body.boundary_loops
    rims = {"MV": max(loops, key=body.loop_length)}
    for opening, number in TAGS.items():
        of_tag = np.unique(surface.triangles[tag == number])
        rims[opening] = max(loops, key=lambda loop: np.isin(ids[loop], of_tag).mean())
    return body, published, rims


def along(surface: Surface, on_line: np.ndarray, start: int, stop: int) -> np.ndarray:
    """A way along edges from point to point that keeps to the points of a line."""
    graph = surface.edge_graph.tocoo()
    cost = np.where(on_line[graph.row] & on_line[graph.col], 1e-3, 1.0) * graph.data
    way = PathTree(sparse.coo_matrix((cost, (graph.row, graph.col)), graph.shape).tocsr(), start).to(stop)
    assert way is not None
    return way


def report(title: str, found: np.ndarray, published: np.ndarray, folded: int) -> None:
    """A row: how far coordinates are from the published ones."""
    away = np.linalg.norm(found - published, axis=1)
    x, y = np.median(np.abs(found - published), axis=0)
    print(
        f"| {title} | {np.median(away):.3f} | {np.percentile(away, 95):.3f} | {x:.3f} | {y:.3f} | {folded} |",
        flush=True,
    )


def coordinates() -> None:
    """Universal coordinates against the published ones: our seeds, their landmarks, their lines."""
    body, published, rims = published_coordinates()
    print("\n| lines of the coordinates | median | 95 % | x median | y median | folded |\n|---|---|---|---|---|---|")
    valve = rims["MV"]
    ends = {side: valve[np.abs(published[valve, 0] - side) < ON_LINE] for side in (0.0, 1.0)}
    flat_map = Flattener(body, check_axes=False).flatten(suggest_seeds(body, rims, LEFT_ATRIUM))
    septal, lateral = (body.points[ends[side]].mean(axis=0) for side in (1.0, 0.0))
    for title, places in (("ours, seeds as suggested", (None, None)), ("ours, to their ends", (septal, lateral))):
        found = universal.universal_map(flat_map, *places)
        report(title, found.on_cavity, published, len(found.folded_triangles))
    for title, straight in (("their lines", False), ("and the straight ones between the ellipses", True)):
        report(title, *_on_their_lines(body, published, rims, ends, straight))
    span = np.ptp(published[body.triangles], axis=1).max(axis=1)
    whole = body.triangles[span < 0.2]
    print(
        f"\nFolded in the published coordinates (across no seam): {len(distortion.folded_triangles(published, whole))}"
    )


def _on_their_lines(
    body: Surface,
    published: np.ndarray,
    rims: Mapping[str, np.ndarray],
    ends: Mapping[float, np.ndarray],
    straight: bool,
) -> tuple[np.ndarray, np.ndarray, int]:
    """Coordinates solved with the published lines and rims: what is left is the way of solving."""
    x, y = published.T
    corners = {}
    for hole, side in (("RSPV", 1.0), ("LSPV", 0.0)):
        rim = rims[hole]
        level = rim[np.abs(y[rim] - 0.5) < ON_LINE]
        order = level[np.argsort(np.abs(x[level] - side))]
        corners[hole] = (order[0], order[-1])
    roof = along(body, np.abs(y - 0.5) < ON_LINE, corners["LSPV"][1], corners["RSPV"][1])
    septal = along(body, x > 1.0 - ON_LINE, corners["RSPV"][0], ends[1.0][0])
    lateral = along(body, x < ON_LINE, corners["LSPV"][0], ends[0.0][0])
    lines = universal.Lines(roof, septal, lateral)
    half = np.where(np.abs(y[body.triangles].mean(axis=1) - 0.5) < 0.5, y[body.triangles].mean(axis=1), 0.0)
    anterior = universal.halves(body, lines, half > 0.6)
    held = np.concatenate([rims[hole] for hole in TAGS])
    places = published[held]
    if straight:
        # Points of one published height or side: only that coordinate is held.
        for axis, levels in STRAIGHT.items():
            for level in levels:
                on_line = np.setdiff1d(np.flatnonzero(np.abs(published[:, axis] - level) < ON_LINE), held)
                free = np.full((len(on_line), 2), np.nan)
                free[:, axis] = level
                held, places = np.concatenate([held, on_line]), np.concatenate([places, free])
    cut, places, _ = universal.unit_square(body, anterior, lines, rims["MV"], held, places)
    return places[: len(body.points)], published, len(distortion.folded_triangles(places, cut.triangles))


def main() -> None:
    """Print the tables."""
    template = sum_template()
    if (cases.DATA / "labelled" / "dtmri_endo1.vtp").is_file():
        coordinates()
    if template is not None:
        atlas(template)
    peers(template)


if __name__ == "__main__":
    main()
