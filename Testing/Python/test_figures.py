"""Figures: what is seen where, against the template, the phantom and closed forms, not against earlier pictures."""

from __future__ import annotations

import subprocess
import sys
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOImage import vtkPNGReader

from LAFlatteningLib import distortion, figures, shading
from LAFlatteningLib import page as page_module
from LAFlatteningLib.errors import InputFileError, LAFlatteningError
from LAFlatteningLib.files import read_seeds, read_surface
from LAFlatteningLib.flattening.flat_map import FlatMap
from LAFlatteningLib.flattening.flattener import Flattener, flatten
from LAFlatteningLib.phantom import Phantom, make_phantom
from LAFlatteningLib.surface import Surface
from LAFlatteningLib.views import PatientFrame

pytest.importorskip("matplotlib", reason="figures need matplotlib")
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.text import Text

WHITE = np.array([255, 255, 255])
VEINS = ("RSPV", "RIPV", "LIPV", "LSPV")


def read_png(path: Path) -> np.ndarray:
    """(rows, columns, 3) from the top, read without matplotlib."""
    reader = vtkPNGReader()
    reader.SetFileName(str(path))
    reader.Update()
    width, height, _ = reader.GetOutput().GetDimensions()
    pixels = vtk_to_numpy(reader.GetOutput().GetPointData().GetScalars())
    return pixels.reshape(height, width, -1)[::-1, :, :3].astype(int)


def colour(code: str) -> np.ndarray:
    return np.round(np.array(to_rgb(code)) * 255).astype(int)


def axes_of(figure: Figure, label: str) -> Axes:
    return next(axes for axes in figure.axes if axes.get_label() == label)


def text_places(axes: Axes) -> dict[str, np.ndarray]:
    return {text.get_text(): np.array(text.get_position()) for text in axes.texts}


@dataclass
class Page:
    """A written page, and the figure that says where things are on it."""

    pixels: np.ndarray
    figure: Figure

    def at(self, label: str, places: np.ndarray) -> np.ndarray:
        """Pixels (k, 3) at places (k, 2) in the coordinates of some axes."""
        x, y = axes_of(self.figure, label).transData.transform(np.atleast_2d(places)).T
        return self.pixels[len(self.pixels) - 1 - np.floor(y).astype(int), np.floor(x).astype(int)]

    def patch(self, label: str, place: np.ndarray, radius: float) -> np.ndarray:
        """Pixels (k, 3) of a disk in some axes."""
        grid = np.stack(np.meshgrid(*[np.linspace(-radius, radius, 41)] * 2), axis=-1).reshape(-1, 2)
        return self.at(label, place + grid[np.linalg.norm(grid, axis=1) <= radius])


@pytest.fixture(scope="module")
def flat_map(phantom_map: FlatMap) -> FlatMap:
    return phantom_map


def with_arrays(flat_map: FlatMap, points: dict | None = None, cells: dict | None = None) -> FlatMap:
    """The map with these arrays and no others."""
    return replace(flat_map, surface=replace(flat_map.surface, point_data=points or {}, cell_data=cells or {}))


@pytest.fixture(scope="module")
def draw(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Page]:
    def drawn(flat_map: FlatMap, make: Callable = figures.make_figure, **options: str) -> Page:
        path = tmp_path_factory.mktemp("page") / "page.png"
        write = {figures.make_figure: figures.draw_figure, figures.make_distortion_figure: figures.draw_distortion}[
            make
        ]
        write(flat_map, path, **options)
        with pytest.MonkeyPatch.context() as patch:
            # Where things are does not depend on how fine the pictures are.
            patch.setattr(figures, "VIEW_DOTS_PER_INCH", 60)
            patch.setattr(page_module, "MAP_DOTS", 400)
            return Page(read_png(path), make(flat_map, **options))

    return drawn


@pytest.fixture(scope="module")
def regions_page(flat_map: FlatMap, draw: Callable[..., Page]) -> Page:
    return draw(with_arrays(flat_map))


@pytest.fixture
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer dots, for tests that do not look at pixels."""
    monkeypatch.setattr(figures, "VIEW_DOTS_PER_INCH", 60)
    monkeypatch.setattr(page_module, "MAP_DOTS", 150)
    monkeypatch.setattr(page_module, "DOTS_PER_INCH", 40)


# ---- the map ---------------------------------------------------------------------------------------------------------


def test_page_is_a4_landscape_at_200_dots_per_inch(regions_page: Page) -> None:
    height, width, _ = regions_page.pixels.shape
    assert abs(width / 200 * 25.4 - 297) < 1 and abs(height / 200 * 25.4 - 210) < 1


def test_regions_have_their_colours_where_the_template_puts_them(flat_map: FlatMap, regions_page: Page) -> None:
    centroids = flat_map.points[flat_map.triangles].mean(axis=1)
    codes = [colour(code) for code in shading.REGION_COLOURS[:5]]
    for region, code in zip(range(1, 6), codes, strict=True):
        inside = flat_map.template.region_outline(region)
        # Deep in the region by the template's outline, not by what the map says.
        mine = centroids[contains(inside, centroids)]
        deep = mine[np.array([np.linalg.norm(inside - p, axis=1).min() for p in mine]) > 0.02]
        found = regions_page.at("map", deep)
        assert len(deep) > 20
        assert (np.abs(found - code) <= 2).all(axis=1).mean() > 0.75  # the rest lies under names and lines
        for other in codes:
            if other is not code:
                assert not (np.abs(found - other) <= 2).all(axis=1).any()


def contains(polygon: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Whether points are inside a closed polygon: winding number."""
    spokes = polygon[None] - points[:, None]
    angles = np.arctan2(spokes[..., 1], spokes[..., 0])
    turns = np.diff(angles, axis=1, append=angles[:, :1])
    return np.abs(((turns + np.pi) % (2 * np.pi) - np.pi).sum(axis=1)) > np.pi


def test_holes_and_surroundings_are_background_and_seeds_are_in_the_holes(
    flat_map: FlatMap, regions_page: Page
) -> None:
    for hole in flat_map.template.anatomy.holes:
        shape = flat_map.template.rim(hole).shape
        centre, radius = np.array(shape.centre), min(shape.semi_axes)
        turn = np.linspace(0, 2 * np.pi, 60)
        ring = centre + 0.6 * radius * np.column_stack([np.cos(turn), np.sin(turn)])
        assert (regions_page.at("map", ring) == WHITE).all(), hole
        assert (regions_page.patch("map", centre, 0.4 * radius).max(axis=1) < 80).sum() > 10, hole
    corner = np.array([0.5, 0.5])
    assert (regions_page.patch("map", corner, 0.02) == WHITE).all()


def test_seeds_on_the_outer_rim_are_at_the_feet_of_the_template(flat_map: FlatMap, regions_page: Page) -> None:
    template = flat_map.template
    for path in template.anatomy.outer_paths:
        foot = template.outer.shape.at(template.outer.feet[path])
        assert (np.abs(regions_page.at("map", foot) - colour(figures.SEED_COLOUR)) <= 3).all()
        assert (regions_page.patch("map", foot, 0.008).max(axis=1) < 80).sum() > 10


def test_rims_and_borders_are_drawn_where_the_template_puts_them(flat_map: FlatMap, regions_page: Page) -> None:
    template = flat_map.template
    for path in template.anatomy.paths:
        middle = template.segment(path).mean(axis=0)
        assert (np.abs(regions_page.at("map", middle) - colour(figures.BORDER_COLOUR)) <= 25).all(), path
    degrees = np.array([50.0, 100.0, 165.0, 250.0, 290.0])
    rim = regions_page.at("map", template.outer.shape.at(degrees))
    assert (np.abs(rim - colour(figures.RIM_COLOUR)) <= 25).all()


def test_region_names_lie_in_their_regions(flat_map: FlatMap, regions_page: Page) -> None:
    places = text_places(axes_of(regions_page.figure, "map"))
    for region in range(1, 6):
        inside = contains(flat_map.template.region_outline(region), places[f"R{region}"][None])
        assert inside[0]
    bar = axes_of(regions_page.figure, "colours")
    names = [" ".join(label.get_text().split()) for label in bar.get_yticklabels()]
    assert names == [f"R{n} {name}" for n, name in sorted(flat_map.template.anatomy.region_names.items())]


def test_opening_names_are_next_to_their_holes(flat_map: FlatMap, regions_page: Page) -> None:
    template, places = flat_map.template, text_places(axes_of(regions_page.figure, "map"))
    for hole in template.anatomy.holes:
        distance = {h: np.linalg.norm(places[hole] - template.rim(h).shape.centre) for h in template.anatomy.holes}
        assert min(distance, key=lambda h: distance[h]) == hole
        assert distance[hole] > min(template.rim(hole).shape.semi_axes)


def test_region_words_run_along_their_part_of_the_outer_rim(flat_map: FlatMap, regions_page: Page) -> None:
    places = text_places(axes_of(regions_page.figure, "map"))
    angle = {name: np.degrees(np.arctan2(*places[name][::-1])) % 360 for name in places}
    # Feet of the paths on the outer rim, Nunez-Garcia et al.: 22.5, 130.5, 210 and 330 degrees.
    assert 22.5 < angle["anterior wall"] < 130.5
    assert 130.5 < angle["left lateral wall"] < 210
    assert 210 < angle["posterior wall and floor"] < 330
    assert not 22.5 < angle["septal wall"] < 330
    assert "posterior wall between the veins" not in places


# ---- the atrium in 3D ------------------------------------------------------------------------------------------------


def test_views_are_those_of_a_patient_seen_from_behind_and_from_the_front() -> None:
    seeds = make_phantom(500).seeds
    for space, sign in (("LPS", [1, 1, 1]), ("RAS", [-1, -1, 1])):
        for name, left_is in (("posterior", -1), ("anterior", 1)):
            page = {k: PatientFrame.of_space(space).view(name).project(p * np.array(sign)) for k, p in seeds.items()}
            for side in ("S", "I"):
                assert np.sign(page[f"L{side}PV"][0] - page[f"R{side}PV"][0]) == left_is
            for side in ("L", "R"):
                assert page[f"{side}SPV"][1] > page[f"{side}IPV"][1]
            # Veins enter at the back, the appendage is in front.
            veins = np.mean([page[vein][2] for vein in VEINS])
            assert (veins > page["LAA"][2]) == (name == "posterior")


@pytest.mark.usefixtures("coarse")
@pytest.mark.parametrize("space", ["LPS", "RAS"])
def test_names_on_the_page_are_on_the_right_side(space: str) -> None:
    phantom = make_phantom(800)
    sign = np.array([1.0, 1.0, 1.0] if space == "LPS" else [-1.0, -1.0, 1.0])
    surface = replace(phantom.surface, points=phantom.surface.points * sign, space=space)
    figure = figures.make_figure(Flattener(surface).flatten({k: p * sign for k, p in phantom.seeds.items()}))
    behind, front = text_places(axes_of(figure, "posterior")), text_places(axes_of(figure, "anterior"))
    assert set(VEINS) <= set(behind)
    assert behind["LSPV"][0] < behind["RSPV"][0] and behind["LIPV"][0] < behind["RIPV"][0]
    assert behind["LSPV"][1] > behind["LIPV"][1] and behind["RSPV"][1] > behind["RIPV"][1]
    assert {"MV", "LAA"} <= set(front) and "LAA" not in behind
    assert front["LAA"][0] > front["RSPV"][0]
    assert behind["L"][0] < behind["R"][0] and behind["S"][1] > behind["I"][1]
    assert front["R"][0] < front["L"][0] and front["S"][1] > front["I"][1]
    words = axes_of(figure, "map").get_xlabel()
    assert words.startswith("patient's left") and words.endswith("patient's right")
    assert axes_of(figure, "map").get_ylabel().endswith("superior, anterior")


def test_atrium_is_seen_as_big_as_it_is(flat_map: FlatMap, regions_page: Page) -> None:
    for name in ("posterior", "anterior"):
        axes = axes_of(regions_page.figure, name)
        x, y = np.meshgrid(np.linspace(*axes.get_xlim(), 200)[1:-1], np.linspace(*axes.get_ylim(), 170)[1:-1])
        grid = np.column_stack([x.ravel(), y.ravel()])
        ink = (regions_page.at(name, grid) < 250).any(axis=1)
        seen = ink.mean() * np.ptp(axes.get_xlim()) * np.ptp(axes.get_ylim())
        # The convex hull of the projection is an upper bound; veins and text are small.
        page = PatientFrame.of_space("LPS").view(name).project(flat_map.surface.points)[:, :2]
        assert 0.9 < seen / ConvexHull(page).volume < 1.15


def test_openings_show_the_inside_of_the_wall(flat_map: FlatMap, regions_page: Page) -> None:
    """The middle of the valve, seen from the front, is dark grey whatever the colours outside."""
    rim = flat_map.division.surface.points[flat_map.division.loops["MV"]]
    middle = PatientFrame.of_space("LPS").view("anterior").project(rim)[:, :2].mean(axis=0)
    patch = regions_page.patch("anterior", middle, 2.0)
    assert (np.ptp(patch, axis=1) < 20).all() and (patch < 170).all()


@pytest.mark.usefixtures("coarse")
def test_texts_are_legible_on_the_page_and_names_do_not_overlap(flat_map: FlatMap) -> None:
    for make in (figures.make_figure, figures.make_distortion_figure):
        figure = make(flat_map)
        figure.draw_without_rendering()
        texts = [t for t in figure.findobj(Text) if t.get_text() and t.get_visible()]
        assert min(text.get_size() for text in texts) >= 8.0
        page = figure.bbox
        for text in texts:
            box = text.get_window_extent()
            assert box.x0 >= page.x0 and box.x1 <= page.x1 and box.y0 >= page.y0 and box.y1 <= page.y1, text
        assert overlapping_texts(figure) == []


def overlapping_texts(figure: Figure) -> list[tuple[str, str]]:
    pairs = []
    for axes in figure.axes:
        texts = [(text.get_text(), text.get_window_extent()) for text in axes.texts]
        pairs += [(a, b) for k, (a, box) in enumerate(texts) for b, other in texts[:k] if box.overlaps(other)]
    return pairs


@pytest.mark.usefixtures("coarse")
@pytest.mark.parametrize(("case", "seeds"), [("frf_demo", "seeds_operator1.csv"), ("pvi_gap", "seeds.csv")])
def test_names_on_real_atria_do_not_overlap(data_dir: Path, case: str, seeds: str) -> None:
    """Here openings are so near to each other that names must give way."""
    folder = data_dir / case
    figure = figures.make_figure(flatten(read_surface(folder / "closed_ostia.vtp"), read_seeds(folder / seeds)))
    figure.draw_without_rendering()
    assert overlapping_texts(figure) == []


# ---- rasteriser ------------------------------------------------------------------------------------------------------


def sphere(count: int, radius: float) -> tuple[np.ndarray, np.ndarray]:
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    points = radius * np.column_stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z])
    triangles = ConvexHull(points).simplices.astype(np.int64)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", a, np.cross(b, c)) < 0
    triangles[inward] = triangles[inward][:, ::-1]
    return points, triangles


@pytest.mark.parametrize("count", [2_000, 100_000])
def test_raster_of_a_sphere_is_a_sphere(count: int) -> None:
    radius = 30.0
    points, triangles = sphere(count, radius)
    raster = shading.rasterise(points, triangles, -40.0, -40.0, 0.2, (400, 400))
    assert raster.covered.sum() * 0.04 == pytest.approx(np.pi * radius**2, rel=0.01)
    assert raster.front.all()
    row, column = np.nonzero(raster.covered)
    x, y = -40 + 0.2 * (column + 0.5), -40 + 0.2 * (row + 0.5)
    inner = x**2 + y**2 < (0.8 * radius) ** 2
    depth = np.sqrt(radius**2 - x[inner] ** 2 - y[inner] ** 2)
    np.testing.assert_allclose(raster.depth[raster.covered][inner], depth, atol=0.15)
    # A linear function of space is interpolated exactly, up to the flatness of the triangles.
    np.testing.assert_allclose(raster.interpolate(points[:, 0] + 2 * points[:, 1]), x + 2 * y, atol=1e-6)
    np.testing.assert_allclose(raster.weights.sum(axis=1), 1.0)


def test_raster_does_not_depend_on_how_much_is_done_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    points, triangles = sphere(3000, 30.0)
    whole = shading.rasterise(points, triangles, -40.0, -40.0, 0.5, (160, 160))
    monkeypatch.setattr(shading, "FRAGMENTS_AT_ONCE", 37)
    parts = shading.rasterise(points, triangles, -40.0, -40.0, 0.5, (160, 160))
    np.testing.assert_array_equal(whole.triangle, parts.triangle)


def test_what_is_in_front_hides_what_is_behind() -> None:
    square = np.array([[0.0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0]])
    two = np.array([[0, 1, 2], [0, 2, 3]])
    # The near square covers half of the far one and shows its back.
    points = np.concatenate([square, square * (0.5, 1, 1) + (0, 0, 8)])
    triangles = np.concatenate([two, two[:, ::-1] + 4])
    raster = shading.rasterise(points, triangles, 0.0, 0.0, 0.1, (100, 100))
    assert (raster.triangle[:, :50] >= 2).all() and (raster.triangle[:, 50:] < 2).all()
    front = np.zeros(raster.covered.shape, bool)
    front[raster.covered] = raster.front
    assert front[:, 50:].all() and not front[:, :50].any()
    places = np.array([[2.0, 5, 0], [2, 5, 8], [8, 5, 0], [8, 5, -3], [8, 5, 3], [20, 5, 9]])
    assert raster.is_visible(places).tolist() == [False, True, True, False, True, False]
    line = raster.visible_part(points[[0, 1]])
    # The far edge from x = 0 to 10; its very end is on the edge of the picture.
    assert np.isnan(line[: len(line) // 2 - 2]).all() and np.isfinite(line[len(line) // 2 + 2 : -1]).all()


# ---- arrays ----------------------------------------------------------------------------------------------------------


def test_array_values_are_the_colours_of_the_bar(flat_map: FlatMap, draw: Callable[..., Page]) -> None:
    """A linear function on the map has on every pixel the colour of its value there."""
    values = 100.0 + 40.0 * flat_map.points[:, 0]
    page = draw(with_arrays(flat_map, {"other": values, "LGE": values}))
    bar = axes_of(page.figure, "colours")
    assert bar.get_ylabel() == "LGE (a.u.)" and "LGE (a.u.)" in page.figure.texts[0].get_text()
    low, high = np.percentile(values, [1, 99])
    assert axes_of(page.figure, "colours").get_ylim() == pytest.approx((low, high))
    places = np.random.default_rng(0).uniform(-0.33, 0.33, (400, 2))
    expected = colormaps["plasma"]((100.0 + 40.0 * places[:, 0] - low) / (high - low))[:, :3] * 255
    good = (np.abs(page.at("map", places) - expected) <= 6).all(axis=1)
    assert good.mean() > 0.8  # the rest lies in holes and under names and lines


def test_default_array_is_lge_then_scalars_then_voltage_then_none(flat_map: FlatMap) -> None:
    some = flat_map.points[:, 0]
    for names, expected in (
        (["x", "Bipolar", "scalars", "lge"], "lge"),
        (["Bipolar", "scalars"], "scalars"),
        (["x", "bipolar_voltage"], "bipolar_voltage"),
        (["x", "scar"], None),
    ):
        assert shading.default_array(with_arrays(flat_map, dict.fromkeys(names, some)).surface) == expected
    vectors = with_arrays(flat_map, {"LGE": flat_map.surface.points})
    assert shading.default_array(vectors.surface) is None


def test_points_without_a_value_are_grey(flat_map: FlatMap, draw: Callable[..., Page]) -> None:
    values = 100.0 + 40.0 * flat_map.points[:, 0]
    lower = flat_map.points[:, 1] < -0.2
    values[lower] = np.where(flat_map.points[lower, 0] > 0, np.inf, np.nan)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        page = draw(with_arrays(flat_map, {"LGE": values}))
    places = np.column_stack([np.linspace(-0.2, 0.2, 30), np.full(30, -0.38)])
    assert (np.abs(page.at("map", places) - colour(shading.NO_VALUE)) <= 2).all()
    upper = page.at("map", places * (1, -1))
    assert (np.abs(upper - colour(shading.NO_VALUE)) > 10).any(axis=1).mean() > 0.8
    legend = axes_of(page.figure, "map").get_legend()
    assert "no value" in [text.get_text() for text in legend.get_texts()]


@pytest.mark.usefixtures("coarse")
@pytest.mark.parametrize(
    ("value", "words"), [(np.nan, "no value anywhere"), (0.25, "x"), (7.0, "x"), (0.0, "x"), (np.inf, "no value")]
)
def test_arrays_of_one_value_are_drawn(flat_map: FlatMap, value: float, words: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure = figures.make_figure(with_arrays(flat_map, {"x": np.full(len(flat_map.points), value)}), array="x")
        figure.draw_without_rendering()
    assert words in axes_of(figure, "colours").get_ylabel()


@pytest.mark.parametrize("on_points", [True, False])
def test_few_whole_numbers_are_classes_without_colours_between(flat_map: FlatMap, on_points: bool) -> None:
    count = len(flat_map.points) if on_points else len(flat_map.triangles)
    mask = (np.random.default_rng(0).uniform(size=count) > 0.5).astype(np.uint8)
    drawn = with_arrays(flat_map, {"scar": mask}) if on_points else with_arrays(flat_map, {}, {"scar": mask})
    paint = shading.array_paint(drawn.surface, "scar")
    raster = shading.rasterise(flat_map.points, flat_map.triangles, -0.5, -0.5, 0.01, (100, 100))
    assert len(np.unique(paint.rgb(raster), axis=0)) == 2
    assert paint.classes and [text for _, text in paint.ticks or []] == ["0", "1"]


def test_cell_arrays_are_flat_on_each_triangle(flat_map: FlatMap) -> None:
    values = np.arange(len(flat_map.triangles)) * 0.5
    paint = shading.array_paint(with_arrays(flat_map, {}, {"v": values}).surface, "v")
    raster = shading.rasterise(flat_map.points, flat_map.triangles, -0.5, -0.5, 0.01, (100, 100))
    np.testing.assert_allclose(paint.rgb(raster), paint.colours_of(values[raster.triangle[raster.covered]]))


@pytest.mark.parametrize(("name", "low_is_warm"), [("LGE", False), ("Bipolar", True), ("LAT", True), ("x", False)])
def test_scar_is_warm(flat_map: FlatMap, name: str, low_is_warm: bool) -> None:
    paint = shading.array_paint(with_arrays(flat_map, {name: flat_map.points[:, 0]}).surface, name)
    red, _, blue = paint.colours_of(np.array([-1.0]))[0]
    assert (red > blue) == low_is_warm


@pytest.mark.parametrize(
    ("name", "label"),
    [
        ("LGE", "LGE (a.u.)"),
        ("Bipolar", "Bipolar (mV)"),
        ("LAT", "LAT (ms)"),
        ("plateau", "plateau (a.u.)"),
        ("voltage (V)", "voltage (V)"),
        ("thickness_mm", "thickness (mm)"),
    ],
)
def test_labels_name_the_unit(name: str, label: str) -> None:
    assert shading.label_of(name) == label


# ---- distortion ------------------------------------------------------------------------------------------------------


def test_distortion_page_shows_alpha_and_beta_of_each_triangle(flat_map: FlatMap, draw: Callable[..., Page]) -> None:
    page = draw(flat_map, figures.make_distortion_figure)
    assert page.pixels.shape == (1660, 2340, 3)
    surface, triangles, flat = flat_map.surface.points, flat_map.triangles, flat_map.points
    alpha, beta = distortion.area_ratio(surface, triangles, flat), distortion.isotropy(surface, triangles, flat)
    low, high = axes_of(page.figure, "alpha colours").get_xlim()
    assert low * high == pytest.approx(1.0)  # as much room for smaller as for larger
    share = np.clip((np.log(alpha) - np.log(low)) / (np.log(high) - np.log(low)), 0, 1)
    centroids = flat[triangles].mean(axis=1)
    for name, expected in (("alpha", colormaps["PuOr_r"](share)), ("beta", colormaps["cividis"](beta))):
        found = page.at(name, centroids)
        assert (np.abs(found - expected[:, :3] * 255) <= 12).all(axis=1).mean() > 0.6
        bars = axes_of(page.figure, f"{name} histogram").patches
        assert sum(bar.get_height() for bar in bars) == pytest.approx(100.0)
    # The histogram's share of enlarged triangles is the share of alpha above 1.
    bars = axes_of(page.figure, "alpha histogram").patches
    larger = sum(bar.get_height() for bar in bars if bar.get_x() > 1 - 1e-9)
    assert larger == pytest.approx(100 * (alpha > 1).mean(), abs=0.5)


# ---- maps of other kinds ---------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("coarse")
def test_published_method_is_drawn_and_its_folds_are_marked(flat_map: FlatMap, phantom: Phantom) -> None:
    published = Flattener(phantom.surface, method="paper").flatten(phantom.seeds)
    assert "method paper, rounding paper" in figures.make_figure(published).texts[1].get_text()
    # Fold it ourselves: one inner point moved across the map.
    on_rim = np.isin(np.arange(len(flat_map.solution)), flat_map.constraints.ids)
    far = int(np.flatnonzero(~on_rim)[0])
    moved = flat_map.solution.copy()
    moved[far] = -moved[far] + 0.1
    folded = replace(flat_map, solution=moved)
    count = len(folded.folded_triangles)
    figure = figures.make_figure(folded)
    assert count > 0 and f"{count} folded triangle" in figure.texts[1].get_text()
    marks = next(line for line in axes_of(figure, "map").lines if line.get_gid() == "folded")
    assert len(marks.get_xdata()) == count


@pytest.mark.usefixtures("coarse")
def test_quality_is_quoted(flat_map: FlatMap) -> None:
    line = figures.make_figure(flat_map).texts[1].get_text()
    beta = flat_map.metrics["beta"]["mean"]
    for words in ("method regional", "template adapted1", "2,000 points", "no folded triangles", f"{beta:.2f}"):
        assert words in line


@pytest.mark.usefixtures("coarse")
def test_other_templates_are_drawn(phantom: Phantom) -> None:
    for name in ("adapted2", "population"):
        figure = figures.make_figure(Flattener(phantom.surface, name).flatten(phantom.seeds))
        assert f"template {name}" in figure.texts[1].get_text()


# ---- files and errors ------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("coarse")
@pytest.mark.parametrize(("ending", "start"), [(".pdf", b"%PDF"), (".svg", b"<?xml"), (".PNG", b"\x89PNG")])
def test_all_three_formats_are_written(flat_map: FlatMap, tmp_path: Path, ending: str, start: bytes) -> None:
    path = tmp_path / f"map{ending}"
    figures.draw_figure(flat_map, path)
    assert path.read_bytes().startswith(start)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    if ending == ".svg":
        # Surfaces are pictures, so that the file does not grow with the mesh.
        text = path.read_text(encoding="utf-8")
        assert text.count("<image") >= 3 and text.count("<path") < len(flat_map.triangles) / 4


def test_other_formats_are_refused(flat_map: FlatMap, tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match=r'expected a figure file ending in .png, .pdf, .svg; found "\.bmp"'):
        figures.draw_figure(flat_map, tmp_path / "map.bmp")


@pytest.mark.usefixtures("coarse")
def test_unwritable_place_is_an_error_of_ours(flat_map: FlatMap, tmp_path: Path) -> None:
    for draw in (figures.draw_figure, figures.draw_distortion):
        with pytest.raises(InputFileError):
            draw(flat_map, tmp_path / "no such folder" / "map.png")


def test_unknown_array_is_an_error_that_lists_the_others(flat_map: FlatMap, tmp_path: Path) -> None:
    arrays = {"LGE": flat_map.points[:, 0], "normals": flat_map.surface.points}
    drawn = with_arrays(flat_map, arrays, {"true_region": flat_map.regions})
    with pytest.raises(LAFlatteningError, match=r'"lge2" is not on the surface.*\(LGE, true_region\)'):
        figures.draw_figure(drawn, tmp_path / "map.png", array="lge2")
    with pytest.raises(LAFlatteningError, match=r'"normals" has shape \(2000, 3\).*\(LGE, true_region\)'):
        figures.draw_figure(drawn, tmp_path / "map.png", array="normals")
    with pytest.raises(LAFlatteningError, match="there is none"):
        figures.draw_figure(with_arrays(flat_map), tmp_path / "map.png", array="LGE")
    assert list(tmp_path.iterdir()) == []


def test_without_matplotlib_the_message_says_what_to_install(
    flat_map: FlatMap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    for draw in (figures.draw_figure, figures.draw_distortion):
        with pytest.raises(figures.MissingPackageError, match=r'pip install "laflattening\[figures\]"'):
            draw(flat_map, tmp_path / "map.png")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("coarse")
def test_names_with_signs_of_formulas_are_shown_as_they_are(flat_map: FlatMap, tmp_path: Path) -> None:
    name = r"cost $\frac{$ of x_1"
    drawn = with_arrays(flat_map, {name: flat_map.points[:, 0]})
    figures.draw_figure(drawn, tmp_path / "map.png", array=name)
    figures.draw_figure(drawn, tmp_path / "map.png", title=name)


def test_matplotlib_is_imported_late_and_pyplot_never() -> None:
    code = (
        "import sys; from LAFlatteningLib import figures, page; assert 'matplotlib' not in sys.modules\n"
        "from LAFlatteningLib.phantom import make_phantom; from LAFlatteningLib.flattening.flattener import flatten\n"
        "figures.VIEW_DOTS_PER_INCH = page.MAP_DOTS = 50\n"
        "phantom = make_phantom(800); figures.make_figure(flatten(phantom.surface, phantom.seeds))\n"
        "assert 'matplotlib.figure' in sys.modules and 'matplotlib.pyplot' not in sys.modules\n"
    )
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_surface_stays_as_it_was(flat_map: FlatMap) -> None:
    values = np.full(len(flat_map.points), 3.25)
    values[0] = np.inf
    surface = Surface(flat_map.surface.points, flat_map.surface.triangles, {"x": values})
    shading.array_paint(surface, "x")
    assert np.isinf(values[0])
