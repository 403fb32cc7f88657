"""Gaps in the ablation lines round the veins."""

from .quantification import Encirclement, FoundGap, GapReport, find_gaps

__all__ = ["Encirclement", "FoundGap", "GapReport", "find_gaps"]
