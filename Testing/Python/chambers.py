"""Other chambers of the heart as closed forms, for the tests: a left ventricle, a right atrium."""

from __future__ import annotations

import numpy as np
from meshes import icosphere, planar

from LAFlatteningLib.surface import Surface

VENTRICLE_MM = (25.0, 25.0, 70.0)
"""Semi-axes of the half ellipsoid; its base is the plane z = 0, its apex at the bottom."""
ATRIUM_MM = (24.0, 26.0, 30.0)


def ventricle(rings: int = 20) -> tuple[Surface, dict[str, np.ndarray]]:
    """Half an ellipsoid, open at its base, in LPS; and its seeds.

    Looked at from the apex with the anterior wall up, as on the map, the patient's right is on the left.
    """
    around = [np.arange(6 * k) * np.pi / (3 * k) + 0.1 * k for k in range(1, rings + 1)]
    turn = np.concatenate([[0.0], *around])
    share = np.repeat(np.arange(rings + 1) / rings, [1, *map(len, around)])
    disk = planar(share[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1), lambda at: np.ones(len(at), bool))
    polar = 0.5 * np.pi * share
    # +x is the patient's left, -y anterior; the disk is seen from below, from outside.
    unit = np.stack([np.sin(polar) * np.cos(turn), -np.sin(polar) * np.sin(turn), -np.cos(polar)], axis=1)
    seeds = {"APEX": np.array([0.0, 0.0, -VENTRICLE_MM[2]])}
    for label, degrees in (("B1", 120.0), ("B2", 240.0), ("B3", 0.0)):
        seeds[label] = np.array([np.cos(np.deg2rad(degrees)), -np.sin(np.deg2rad(degrees)), 0.0]) * VENTRICLE_MM
    return Surface(unit * VENTRICLE_MM, disk.triangles), seeds


def right_atrium(coronary_sinus: bool = False, subdivisions: int = 5) -> tuple[Surface, dict[str, np.ndarray]]:
    """An ellipsoid with two short tubes for the venae cavae, cut open at these and at the valve, in LPS; its seeds."""
    sphere = icosphere(1.0, subdivisions)
    axes = {"SVC": direction(0.0, 0.35, 0.94), "IVC": direction(0.0, 0.45, -0.89), "TV": direction(0.45, -0.85, -0.25)}
    widths = {"SVC": 0.36, "IVC": 0.42, "TV": 0.62, "CS": 0.17}
    if coronary_sinus:
        axes["CS"] = direction(0.75, -0.05, -0.66)
    points = sphere.points * ATRIUM_MM
    for name in ("SVC", "IVC"):
        # A tube: the cap round the axis is pushed outwards, the more the nearer to it.
        near = np.clip(
            (sphere.points @ axes[name] - np.cos(1.3 * widths[name])) / (1 - np.cos(1.3 * widths[name])), 0, 1
        )
        points = points + 12.0 * (near * near * (3.0 - 2.0 * near))[:, None] * axes[name]
    keep = [(axes[name], np.cos(widths[name])) for name in axes]
    inside = np.all([sphere.points @ axis < cosine for axis, cosine in keep], axis=0)
    surface, _ = Surface(points, sphere.triangles).submesh(inside[sphere.triangles].all(axis=1))
    loops = surface.boundary_loops
    middles = [surface.points[loop].mean(axis=0) for loop in loops]
    seeds, rim = {}, None
    for name, axis in axes.items():
        nearest = int(np.argmax([middle / np.linalg.norm(middle) @ axis for middle in middles]))
        if name == "TV":
            rim = surface.points[loops[nearest]]
        else:
            seeds[name] = middles[nearest]
    assert rim is not None
    for label, towards in (("TV1", (0.1, 0.1, 1.0)), ("TV2", (0.9, 0.5, -0.6)), ("TV3", (-0.6, 0.3, -0.9))):
        seeds[label] = rim[np.argmax((rim - rim.mean(axis=0)) @ np.array(towards))]
    return surface, seeds


def direction(x: float, y: float, z: float) -> np.ndarray:
    """A unit vector, LPS."""
    return np.array([x, y, z]) / np.linalg.norm([x, y, z])
