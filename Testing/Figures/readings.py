"""What is read off the map, in pictures: LGE, gaps, LGE against voltage."""

from __future__ import annotations

import numpy as np
from atria import POINTS, Atrium, made_phantom
from pictures import Drawn

from LAFlatteningLib import Flattener, Surface, Volume, compare_maps, find_gaps, make_phantom, project
from LAFlatteningLib.analysis_figures import make_comparison_figure
from LAFlatteningLib.figures import make_figure
from LAFlatteningLib.gaps.figures import make_gap_figure
from LAFlatteningLib.phantom import make_lge_volume

PHANTOM_SCAR = 120.0
"""Threshold of scar in the phantom's image: half-way between its wall and its scar."""
VOLTAGE_POINTS = 4000
"""Of the phantom's electroanatomical map: fewer than of its image, as in life."""


def lge(atrium: Atrium) -> Drawn | None:
    """Intensities of an image, projected onto the wall."""
    if "scalars" in atrium.surface.point_data:
        array, flat_map = "scalars", atrium.map()
        source = "intensities as published with the surface"
    elif atrium.key.startswith("scan"):
        array, flat_map = "LGE", atrium.map()
        source = "largest intensity within 3 mm on both sides of the wall"
    elif atrium.key:
        return None
    else:
        phantom = made_phantom(POINTS)
        volume = Volume.from_image(make_lge_volume(phantom.shape))
        surface = project(phantom.surface, volume).on(phantom.surface)
        array, flat_map = "LGE", Flattener(surface).flatten(phantom.seeds)
        source = "largest intensity within 3 mm on both sides of the wall, in a synthetic LGE image"
    caption = f"Late gadolinium enhancement on an atrium and on its map ({atrium.title}): {source}."
    return Drawn("lge", make_figure(flat_map, array=array), caption)


def gaps(atrium: Atrium) -> Drawn | None:
    """Gaps round single veins and round pairs."""
    if not atrium.key:
        array, middle = "LGE", PHANTOM_SCAR
    elif atrium.key == "pvi_gap":
        array, middle = "scalars", 108.0
    else:
        return None
    flat_map = atrium.map()
    report = find_gaps(flat_map, array, [0.9 * middle, middle, 1.1 * middle])
    rings = report.at(middle)
    words = "; ".join(f"{name} {ring.gap_length_mm:.1f} mm (RGM {ring.rgm:.2f})" for name, ring in rings.items())
    caption = f"Gaps after pulmonary vein isolation ({atrium.title}), scar at {middle:g} or more. Gap length: {words}."
    return Drawn("gaps", make_gap_figure(flat_map, report, threshold=middle), caption)


def voltage(atrium: Atrium) -> Drawn | None:
    """LGE against bipolar voltage of the same patient, two meshes."""
    if atrium.key:
        return None
    mapped = make_phantom(VOLTAGE_POINTS)
    scar = mapped.surface.point_data["LGE"]
    share = (scar - scar.min()) / np.ptp(scar)
    # Healthy wall about 2 mV, scar about 0.1 mV, measured with an error of a fifth.
    millivolts = 2.0 * 0.05**share * np.exp(0.2 * _smooth_noise(mapped.surface))
    surface = Surface(
        mapped.surface.points, mapped.surface.triangles, {"bipolar": millivolts}, space=mapped.surface.space
    )
    voltage_map = Flattener(surface).flatten(mapped.seeds)
    comparison = compare_maps(
        atrium.map(),
        voltage_map,
        array_a="LGE",
        array_b="bipolar",
        threshold_a=PHANTOM_SCAR,
        threshold_b=0.5,
        direction_b="below",
    )
    whole = comparison.whole
    caption = (
        f"LGE (left) against bipolar voltage (right) of one synthetic patient: two meshes of {POINTS} and "
        f"{VOLTAGE_POINTS} points, voltages made from the same scar with a smooth error of a fifth. Over the whole "
        f"disk Spearman's rho is {whole.spearman:.2f}, and scar by LGE overlaps low voltage (below 0.5 mV) with Dice "
        f"{whole.dice:.2f}."
    )
    return Drawn("lge_voltage", make_comparison_figure(comparison, names=("LGE", "voltage")), caption)


def _smooth_noise(surface: Surface) -> np.ndarray:
    """A random value at each point, alike in places some edges apart, with a standard deviation of 1."""
    neighbours = surface.edge_graph.copy()
    neighbours.data[:] = 1.0
    count = np.asarray(neighbours.sum(axis=1)).ravel()
    noise = np.random.default_rng(4).standard_normal(len(surface.points))
    for _ in range(20):
        noise = 0.5 * (noise + neighbours @ noise / count)
    return (noise - noise.mean()) / noise.std()
