"""The sections of the panel of LAFlattening, each a small class over the widgets of the .ui file.

A section holds no state of its own: what it shows follows from the parameter node and the nodes in it. Sections are the
only part of the module, with the Widget class itself, that knows qt.
"""

from .analyse_section import AnalyseSection
from .export_section import ExportSection
from .input_section import InputSection
from .map_section import MapSection
from .panel import Panel
from .prepare_section import PrepareSection
from .quality_section import QualitySection
from .seed_section import SeedSection
from .template_section import TemplateSection

__all__ = [
    "AnalyseSection",
    "ExportSection",
    "InputSection",
    "MapSection",
    "Panel",
    "PrepareSection",
    "QualitySection",
    "SeedSection",
    "TemplateSection",
]
