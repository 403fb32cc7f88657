"""Pages of fibrosis and of comparisons: what the colours and the words on them say."""

import numpy as np
import pytest

from LAFlatteningLib.blood_pool import BloodPool
from LAFlatteningLib.comparison import compare_maps
from LAFlatteningLib.fibrosis import Rule, measure_fibrosis
from LAFlatteningLib.map_data import MapData
from LAFlatteningLib.parcellation import Parcellation, parcels_of
from LAFlatteningLib.template import inside_polygon

pytest.importorskip("matplotlib")

from matplotlib.colors import to_rgb

from LAFlatteningLib import analysis_figures as pages
from LAFlatteningLib.shading import NO_VALUE


def axes_of(figure):
    return {axes.get_label(): axes for axes in figure.axes}


def picture_at(axes, x, y):
    """The colour that the picture of some axes has at a place."""
    image = axes.images[0]
    left, right, bottom, top = image.get_extent()
    pixels = np.asarray(image.get_array(), np.float64)
    row, column = int((y - bottom) / (top - bottom) * len(pixels)), int((x - left) / (right - left) * pixels.shape[1])
    colour = pixels[row, column, :3]
    return colour / 255.0 if pixels.max() > 1.0 else colour


def words_of(legend):
    return [text.get_text().replace("\n", " ") for text in legend.get_texts()]


@pytest.fixture(scope="module")
def across(phantom_map):
    """The map with an array that rises from left to right on it, and without values on its far right."""
    data = MapData.of(phantom_map)
    x = data.flat[:, 0].copy()
    holed = np.where(x > 0.3, np.nan, x)
    return MapData(data.surface.with_data({"x": x, "holed": holed}), data.flat, data.template)


def test_bands_of_the_map_have_the_colours_of_their_classes(across):
    found = measure_fibrosis(across, "holed", Rule("value", (-0.1, 0.1)), unit="mV")
    figure = pages.make_fibrosis_figure(across, found)
    drawn = axes_of(figure)["map"]
    colours = [to_rgb(one) for one in pages.class_colours(found)]
    # Below the right veins, clear of lines and openings.
    for x, colour in ((-0.3, colours[0]), (0.0, colours[1]), (0.15, colours[2]), (0.4, to_rgb(NO_VALUE))):
        assert picture_at(drawn, x, -0.22 if x < 0.3 else 0.0) == pytest.approx(colour, abs=0.01)
    words = words_of(figure.legends[0])
    assert [word.split(" (")[-1] for word in words] == ["< -0.1 mV)", "-0.1 to 0.1 mV)", "≥ 0.1 mV)", "no value"]


def test_bands_below_thresholds_run_the_other_way(across):
    found = measure_fibrosis(across, "x", Rule("value", (0.1, -0.1), "below"))
    figure = pages.make_fibrosis_figure(across, found)
    colours = [to_rgb(one) for one in pages.class_colours(found)]
    for x, colour in ((-0.3, colours[2]), (0.0, colours[1]), (0.15, colours[0])):
        assert picture_at(axes_of(figure)["map"], x, -0.22) == pytest.approx(colour, abs=0.01)
    assert "no value" not in words_of(figure.legends[0])


def test_no_line_of_text_runs_off_the_page(across):
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    pool = BloodPool(1.2345, 0.1234, "inside the chamber, more than 5.0 mm from its wall", 1000, 123.4)
    found = measure_fibrosis(across, "x", Rule("sd", (-12.25, -11.75, -11.5, -11.25, -10.75)), pool)
    for figure in (
        pages.make_fibrosis_figure(across, found),
        pages.make_comparison_figure(compare_maps(across, across, "x", "x"), names=("before.vtp", "after.vtp")),
    ):
        renderer = FigureCanvasAgg(figure).get_renderer()
        for text in figure.texts:
            box = text.get_window_extent(renderer)
            assert box.x0 >= 0.0 and box.y0 >= 0.0
            assert box.x1 <= figure.bbox.width and box.y1 <= figure.bbox.height


def test_every_class_is_in_the_table(across):
    found = measure_fibrosis(across, "x", Rule("value", (-0.2, -0.1, 0.0, 0.1)))
    written = [text.get_text() for text in pages.make_fibrosis_figure(across, found).texts]
    for name, share in zip(found.class_names, found.atrium.class_percent, strict=True):
        assert f"{name} (%)" in written
        assert f"{share:.1f}" in written


def test_more_classes_than_fit_are_summed_up(across):
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    found = measure_fibrosis(across, "x", Rule("value", tuple(np.linspace(-0.4, 0.4, 12))))
    figure = pages.make_fibrosis_figure(across, found)
    renderer = FigureCanvasAgg(figure).get_renderer()
    heads = [text for text in figure.texts if text.get_text().endswith("(%)")]
    assert [head.get_text() for head in heads] == ["normal (%)", "beyond the first threshold (%)"]
    boxes = [head.get_window_extent(renderer) for head in heads]
    assert boxes[0].x1 < boxes[1].x0 < boxes[1].x1 < figure.bbox.width
    assert f"{found.atrium.beyond_percent:.1f}" in [text.get_text() for text in figure.texts]


def test_the_share_without_values_is_on_the_page(across):
    found = measure_fibrosis(across, "holed", Rule("value", (0.0,)))
    share = 100.0 * found.atrium.missing_cm2 / (found.atrium.missing_cm2 + found.atrium.area_cm2)
    words = " ".join(text.get_text() for text in pages.make_fibrosis_figure(across, found).texts).replace("\n", " ")
    assert f"{share:.1f} % of the atrium has no value" in words
    whole = measure_fibrosis(across, "x", Rule("value", (0.0,)))
    assert "no value" not in " ".join(text.get_text() for text in pages.make_fibrosis_figure(across, whole).texts)


def test_an_atrium_without_a_map_has_the_page_for_itself(phantom):
    found = measure_fibrosis(phantom.surface, "LGE", Rule("value", (120.0,)))
    axes = axes_of(pages.make_fibrosis_figure(phantom.surface, found))
    assert set(axes) == {"posterior", "anterior"}
    boxes = [one.get_position() for one in axes.values()]
    assert boxes[0].x1 <= boxes[1].x0
    assert min(box.width for box in boxes) > 0.35


def test_places_without_a_value_are_grey_and_named(across):
    found = compare_maps(across, across, "x", "holed", 0.0, 0.0, scale="values")
    for figure, names in (
        (pages.make_comparison_figure(found), ("B",)),
        (pages.make_difference_figure(found), ("difference", "overlap")),
    ):
        axes = axes_of(figure)
        for name in names:
            assert picture_at(axes[name], 0.4, 0.0) == pytest.approx(to_rgb(NO_VALUE), abs=0.01)
        assert words_of(axes["colours"].get_legend()) == ["no value"]
    whole = compare_maps(across, across, "x", "x")
    for make in (pages.make_comparison_figure, pages.make_difference_figure):
        assert axes_of(make(whole))["colours"].get_legend() is None


def test_both_maps_are_painted_by_one_colour_bar(across):
    half = MapData(across.surface.with_data({"x": 0.5 * across.surface.point_data["x"]}), across.flat, across.template)
    axes = axes_of(pages.make_comparison_figure(compare_maps(across, half, "x", "x")))
    # The value .1 is at .1 on one and at .2 on the other.
    assert picture_at(axes["A"], 0.1, -0.25) == pytest.approx(picture_at(axes["B"], 0.2, -0.25), abs=0.05)
    assert np.abs(picture_at(axes["A"], 0.2, -0.25) - picture_at(axes["B"], 0.2, -0.25)).max() > 0.1


def test_sub_regions_are_outlined_numbered_and_listed(phantom_map):
    parcellation = Parcellation.load("segments_24")
    parcels = parcels_of(phantom_map, [parcellation])
    found = measure_fibrosis(phantom_map, "LGE", Rule("value", (120.0,)), parcels=parcels)
    figure = pages.make_fibrosis_figure(phantom_map, found, parcellations=[parcellation])
    axes = axes_of(figure)["map"]
    template = phantom_map.template
    numbers = {text.get_text(): text.get_position() for text in axes.texts if text.get_text().isdigit()}
    assert sorted(map(int, numbers)) == list(range(1, 25))
    labels = parcellation.labels_at(np.array(list(numbers.values())), template)
    assert [str(label) for label in labels] == list(numbers)
    paths = [path for one in axes.collections for path in one.get_paths()]
    lines = [line for path in paths for line in path.to_polygons(closed_only=False)]
    border = np.concatenate(lines)
    # No border runs within a hole or along the rim of the disk, and either side of it is another part.
    for hole in template.holes.values():
        assert not inside_polygon(border, hole.shape.outline()).any()
    assert np.linalg.norm(border, axis=1).max() <= template.radius
    steps = 0.003 * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    around = np.stack([parcellation.labels_at(border + step, template) for step in steps])
    assert (around != around[0]).any(axis=0).mean() > 0.98
    words = [text.get_text() for text in figure.texts]
    share = found.part("segments_24", 9).beyond_percent
    assert words[words.index("9 LSPV superior") + 1] == f"{share:.1f}"
