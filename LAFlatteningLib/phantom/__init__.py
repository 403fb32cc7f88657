"""A synthetic left atrium with known answers, and LGE images and label maps of it."""

from .atrium import DEFAULT_SCAR, Phantom, left_atrium_shape, make_phantom, mesh_phantom
from .labels import make_label_map
from .lge import Gap, LgeModel, ScarPatch, ScarPattern, ScarRing, make_lge_volume
from .shape import PhantomShape

__all__ = [
    "DEFAULT_SCAR",
    "Gap",
    "LgeModel",
    "Phantom",
    "PhantomShape",
    "ScarPatch",
    "ScarPattern",
    "ScarRing",
    "left_atrium_shape",
    "make_label_map",
    "make_lge_volume",
    "make_phantom",
    "mesh_phantom",
]
