"""Bringing the cavity into the plane."""

from .flat_map import FlatMap
from .flattener import METHODS, Flattener, flatten

__all__ = ["METHODS", "FlatMap", "Flattener", "flatten"]
