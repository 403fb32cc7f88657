"""Handles found and cut, against bridges of known place and width."""

from __future__ import annotations

import numpy as np
import pytest
from meshes import cylinder, icosphere
from scipy.spatial import cKDTree

from LAFlatteningLib.cavity.handles import remove_handles, winding_numbers
from LAFlatteningLib.cavity.label_surface import label_surface
from LAFlatteningLib.errors import SurfaceError
from LAFlatteningLib.files import read_volume
from LAFlatteningLib.phantom import Bridge, left_atrium_shape, make_label_map
from LAFlatteningLib.surface import Surface
from LAFlatteningLib.volume import Volume

SHAPE = left_atrium_shape()


def bridged(width: float) -> Surface:
    image = make_label_map(SHAPE, (1, 1, 1), bridges=[Bridge("RSPV", "RIPV", width)])
    return label_surface(Volume.from_image(image)).surface


def torus(big: float, small: float, around: int = 60, across: int = 24) -> Surface:
    u, v = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    a, b = 2 * np.pi * u / around, 2 * np.pi * v / across
    ring = big + small * np.cos(b)
    points = np.stack([ring * np.cos(a), ring * np.sin(a), small * np.sin(b)], axis=2).reshape(-1, 3)

    def at(i, j):
        return (i % around) * across + j % across

    squares = [at(u, v), at(u + 1, v), at(u + 1, v + 1), at(u, v + 1)]
    p, q, r, s = (ids.ravel() for ids in squares)
    return Surface(points, np.concatenate([np.stack([p, q, r], 1), np.stack([p, r, s], 1)]))


@pytest.mark.parametrize("width", [4.0, 6.0])
def test_a_bridge_is_cut_at_its_place(width):
    surface = bridged(width)
    assert surface.genus == 1
    cut, (handle,) = remove_handles(surface)
    assert cut.genus == 0 and cut.is_manifold and cut.is_oriented and not cut.boundary_loops
    assert handle.kind == "bridge"
    assert handle.width_mm == pytest.approx(width, abs=1.0)
    # On the bar's axis, between the two walls.
    bridge = Bridge("RSPV", "RIPV", width)
    assert bridge.distance(SHAPE, handle.place_mm[None])[0] < 1.0 - 0.5 * width
    assert cut.enclosed_volume == pytest.approx(surface.enclosed_volume, rel=2e-3)
    assert cut.area == pytest.approx(surface.area, rel=5e-3)
    new = cKDTree(surface.points).query(cut.points)[0] > 0
    assert np.linalg.norm(cut.points[new] - handle.place_mm, axis=1).max() < width


def test_the_shorter_loop_decides_between_cutting_and_filling():
    _, (thin,) = remove_handles(torus(10, 2))
    assert thin.kind == "bridge" and thin.width_mm == pytest.approx(4.0, rel=0.05)
    filled, (tight,) = remove_handles(torus(10, 8, 60, 60))
    assert tight.kind == "tunnel" and tight.width_mm == pytest.approx(4.0, rel=0.05)
    assert filled.genus == 0 and filled.is_manifold
    np.testing.assert_allclose(tight.place_mm, 0.0, atol=0.5)


def test_a_wide_handle_is_refused_with_its_place():
    with pytest.raises(SurfaceError, match=r"handle.* mm wide at \(.*limit 3 mm"):
        remove_handles(bridged(4.0), limit_mm=3.0)


def test_a_surface_without_handles_stays_itself():
    for surface in (icosphere(20.0), cylinder(10.0, 20.0)):
        same, handles = remove_handles(surface)
        assert same is surface and handles == ()


def test_open_surfaces_keep_their_rims_and_arrays():
    surface = bridged(4.0)
    # Cut the tips of all structures on the left off.
    far = surface.points[:, 0] > np.quantile(surface.points[:, 0], 0.99)
    opened, _ = surface.submesh(~far[surface.triangles].any(axis=1))
    opened, _ = opened.submesh(opened.components == 0)
    opened = opened.with_data({"x": opened.points[:, 0].copy()})
    cut, handles = remove_handles(opened)
    assert len(handles) == 1 and cut.genus == 0
    assert list(cut.point_data) == ["x"]
    np.testing.assert_allclose(
        sorted(cut.loop_length(loop) for loop in cut.boundary_loops),
        sorted(opened.loop_length(loop) for loop in opened.boundary_loops),
    )


def test_winding_numbers_of_a_sphere():
    places = np.array([[0.0, 0, 0], [0.5, 0.2, 0], [2.0, 0, 0]])
    np.testing.assert_allclose(winding_numbers(icosphere(), places), [1, 1, 0], atol=1e-9)


def test_the_two_handles_of_a_real_atrium(data_dir):
    surface = label_surface(read_volume(data_dir / "stacom2018" / "MJHV7_laendo.nrrd")).surface
    assert surface.genus == 2
    # One is as wide as a vein: by itself it is refused, not guessed at.
    with pytest.raises(SurfaceError, match="too wide for an artefact"):
        remove_handles(surface)
    cut, handles = remove_handles(surface, limit_mm=12.0)
    assert cut.genus == 0 and cut.is_manifold and len(handles) == 2
    assert cut.enclosed_volume == pytest.approx(surface.enclosed_volume, rel=2e-3)
