"""Standardised, fold-free 2D maps of the left atrium.

Three lines from files to map::

    from LAFlatteningLib import flatten, read_seeds, read_surface
    flat_map = flatten(read_surface("atrium.vtp"), read_seeds("seeds.csv"))
    print(flat_map.metrics)
"""

from ._version import __version__
from .anatomy import LEFT_ATRIUM, Anatomy
from .comparison import compare_maps
from .errors import (
    Cancelled,
    FoldError,
    InputFileError,
    LAFlatteningError,
    SeedError,
    SurfaceError,
    TemplateError,
)
from .fibrosis import Rule, measure_fibrosis
from .files import read_seeds, read_surface, read_volume, write_seeds, write_surface
from .flattening import FlatMap, Flattener, flatten
from .gaps import find_gaps
from .map_data import MapData
from .parcellation import Parcellation
from .phantom import Phantom, make_phantom
from .projection import project
from .several_maps import compare_several
from .surface import Surface
from .template import Template, builtin_templates
from .volume import Volume

__all__ = [
    "LEFT_ATRIUM",
    "Anatomy",
    "Cancelled",
    "FlatMap",
    "Flattener",
    "FoldError",
    "InputFileError",
    "LAFlatteningError",
    "MapData",
    "Parcellation",
    "Phantom",
    "Rule",
    "SeedError",
    "Surface",
    "SurfaceError",
    "Template",
    "TemplateError",
    "Volume",
    "__version__",
    "builtin_templates",
    "compare_maps",
    "compare_several",
    "find_gaps",
    "flatten",
    "make_phantom",
    "measure_fibrosis",
    "project",
    "read_seeds",
    "read_surface",
    "read_volume",
    "write_seeds",
    "write_surface",
]
