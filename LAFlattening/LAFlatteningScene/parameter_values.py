"""Values of a parameter node that this version of the module does not take, as another version may have saved them."""

from __future__ import annotations

import typing

import slicer
from slicer.parameterNodeWrapper import Validator

LONGEST = 40
"""Letters of a value that are shown."""


def takeOutUnknown(wrapper: type, node: slicer.vtkMRMLScriptedModuleNode) -> dict[str, str]:
    """Take out of a node what a class of parameters refuses, so that the default comes in its place.

    Slicer checks values when they are set, not when they are read: one that came with a scene would be found by whoever
    needs it, and the panel could not even be connected.

    Returns
    -------
    Name of each parameter that was taken out -> what the node said, shortened.
    """
    found = {}
    for name, hint in typing.get_type_hints(wrapper, include_extras=True).items():
        validators = [note for note in getattr(hint, "__metadata__", ()) if isinstance(note, Validator)]
        if not validators or not node.HasParameter(name):
            continue
        text = node.GetParameter(name)
        try:
            value = typing.get_args(hint)[0](text)
            for validator in validators:
                validator.validate(value)
        except ValueError:
            found[name] = text if len(text) <= LONGEST else f"{text[:LONGEST]} ..."
            node.UnsetParameter(name)
    return found
