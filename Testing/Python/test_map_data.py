"""Map files that other programs have changed: what is no map on its template any more is refused."""

import numpy as np
import pytest

from LAFlatteningLib import MapData, make_phantom
from LAFlatteningLib.errors import SurfaceError
from LAFlatteningLib.flattening.strategies import flatten_by_strategy
from LAFlatteningLib.surface import Surface


def changed(flat_map, move=lambda points: points, position=1.0):
    """The file of a map with its points moved and the positions on the atrium scaled."""
    surface = flat_map.to_surface()
    data = {**surface.point_data, "position_mm": position * surface.point_data["position_mm"]}
    return Surface(move(surface.points), surface.triangles, data, surface.cell_data, surface.field_data, "RAS")


def test_a_map_as_it_was_written_is_read(phantom_map):
    data = MapData.of(changed(phantom_map))
    rims = data.rims()
    assert set(rims) == set(phantom_map.template.anatomy.openings)
    for opening, loop in rims.items():
        assert set(loop.tolist()) == set(phantom_map.division.loops[opening].tolist()) & set(range(len(data.flat)))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"move": lambda points: points * [-1, 1, 1]}, "no opening where the template adapted1 puts LAA"),
        ({"move": lambda points: points * 100}, "no opening where"),
        ({"move": lambda points: points + np.array([0.5, 0, 0])}, "not moved or scaled"),
        ({"position": 0.1}, r"10.5 mm across, expected 20 to 400 mm"),
    ],
)
def test_a_map_that_was_changed_is_refused(phantom_map, options, message):
    with pytest.raises(SurfaceError, match=message):
        MapData.of(changed(phantom_map, **options))


def test_a_map_whose_triangles_are_turned_is_refused(phantom_map):
    surface = changed(phantom_map)
    with pytest.raises(SurfaceError, match="mirrored"):
        MapData.of(surface.with_triangles(surface.triangles[:, ::-1]))


def test_maps_for_study_may_have_their_rims_elsewhere():
    phantom = make_phantom(1000)
    flat_map = flatten_by_strategy(phantom.surface, phantom.seeds, "mitral")
    assert flat_map.rim_error > 0.02
    assert MapData.of(flat_map.to_surface()).flat.shape == flat_map.points.shape
    assert np.isfinite(MapData.of(flat_map.to_surface()).flat).all()
