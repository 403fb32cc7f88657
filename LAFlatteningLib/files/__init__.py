"""Surfaces, seeds and images, from and to files.

Surfaces: .vtp, .vtk (legacy), .stl, .ply, .obj; maps of CARTO 3 (.mesh) and OpenEP (.mat), read only. Seeds: .csv,
Slicer markups .mrk.json, and the older .fcsv (read only). Images and label maps: .nrrd, .nii, .nii.gz, .mha; .nhdr,
.mhd (read only). Patient axes (LPS, RAS) in files are handled here and nowhere else. A damaged file is refused with a
reason, nothing that a file holds is executed, and no file is left half-written.
"""

from .access import atomic_write, check_writable, write_text
from .seed_files import read_seeds, write_seeds
from .surfaces import read_surface, write_surface
from .volumes import read_volume, write_volume

__all__ = [
    "atomic_write",
    "check_writable",
    "read_seeds",
    "read_surface",
    "read_volume",
    "write_seeds",
    "write_surface",
    "write_text",
    "write_volume",
]
