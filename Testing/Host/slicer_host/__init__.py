"""A machine without Slicer on which a scripted module, its panel and its tests run on the real MRML.

The MRML scene, logics, markups widget and displayable managers come from the wheel slicer-core, Qt from PySide6. What
Slicer's own Qt layer adds on top (the application, PythonQt's conventions, CTK and qMRML widgets, the layout manager,
the base classes of scripted modules, parameter nodes) is stood in for here, and only as far as the project uses it:
anything not known is refused with an error. ``start()`` puts it all in place; see ``Testing/Host/README.md``.
"""

from .session import HostUnavailable, qt_problem, rendering_problem, start, wheel_problem

__all__ = ["HostUnavailable", "qt_problem", "rendering_problem", "start", "wheel_problem"]
