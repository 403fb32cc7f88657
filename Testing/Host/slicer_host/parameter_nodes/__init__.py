"""Typed parameter nodes, published as ``slicer.parameterNodeWrapper``.

The behaviour of Slicer's own, for the types a module of this size uses: int, float, bool, str, paths, enums and MRML
nodes (one class or a union). A type or annotation not known is refused. Values are stored in the
vtkMRMLScriptedModuleNode in the form in which Slicer stores them.
"""

from .connectors import Decimals, GuiConnector, SingleStep, createGuiConnector, parameterNodeGuiConnector
from .validators import (
    Choice,
    Default,
    Exclude,
    IsInstance,
    Maximum,
    Minimum,
    NotNone,
    Validator,
    WithinRange,
)
from .wrapper import SlicerParameterNamePropertyName, isParameterNodeWrapper, parameterNodeWrapper

PUBLISHED_AS = "parameterNodeWrapper"

__all__ = [
    "Choice",
    "Decimals",
    "Default",
    "Exclude",
    "GuiConnector",
    "IsInstance",
    "Maximum",
    "Minimum",
    "NotNone",
    "SingleStep",
    "SlicerParameterNamePropertyName",
    "Validator",
    "WithinRange",
    "createGuiConnector",
    "isParameterNodeWrapper",
    "parameterNodeGuiConnector",
    "parameterNodeWrapper",
]
