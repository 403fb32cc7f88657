"""Typed parameter nodes behave as Slicer documents them."""

from __future__ import annotations

import enum
import pathlib
from typing import Annotated

import pytest


class Shape(enum.Enum):
    DISK = 1
    SQUARE = 2

    def label(self):
        return self.name.title()


@pytest.fixture
def classes(host):
    """A wrapper class with every type of parameter that is known."""
    from slicer.parameterNodeWrapper import Choice, Default, Maximum, Minimum, WithinRange, parameterNodeWrapper

    class Parameters:
        pass

    Parameters.__annotations__ = {
        "count": int,
        "size": Annotated[float, WithinRange(1, 10)],
        "low": Annotated[int, Minimum(2), Default(5)],
        "high": Annotated[int, Minimum(0), Maximum(9), Default(generator=lambda: 7)],
        "name": str,
        "kind": Annotated[str, Choice(["a", "b"])],
        "on": bool,
        "shape": Shape,
        "folder": pathlib.Path,
        "model": host.vtkMRMLModelNode,
        "either": host.vtkMRMLModelNode | host.vtkMRMLTableNode | None,
    }
    Parameters.size, Parameters.kind, Parameters.on = 4.0, "b", True
    return parameterNodeWrapper(Parameters)


@pytest.fixture
def node(host):
    return host.mrmlScene.AddNewNodeByClass("vtkMRMLScriptedModuleNode")


def test_defaults(classes, node):
    p = classes(node)
    assert (p.count, p.size, p.low, p.high, p.name, p.kind, p.on) == (0, 4.0, 5, 7, "", "b", True)
    assert (p.shape, p.folder, p.model, p.either) == (Shape.DISK, pathlib.Path(), None, None)
    assert p.default("size").value == 4.0


def test_values_are_kept_in_the_node(classes, node, host):
    model = host.mrmlScene.AddNewNodeByClass("vtkMRMLModelNode", "m")
    p = classes(node)
    p.count, p.size, p.on, p.shape, p.model, p.either = 3, 2, False, Shape.SQUARE, model, model
    p.folder = pathlib.Path("a") / "b"
    again = classes(node)
    assert (again.count, again.size, again.on, again.shape) == (3, 2.0, False, Shape.SQUARE)
    assert again.model is model and again.either is model and again.folder == pathlib.Path("a/b")
    # In the form in which Slicer stores them.
    assert [node.GetParameter(name) for name in ("count", "on", "shape")] == ["3", "False", "SQUARE"]
    assert node.GetNodeReference("model") is model and node.GetNodeReference("either") is None


def test_each_member_of_a_union_has_a_name_of_its_own(classes, node, host):
    table = host.mrmlScene.AddNewNodeByClass("vtkMRMLTableNode")
    p = classes(node)

    def stored():
        roles = [f"either.{k}" for k in range(3)]
        return [node.GetParameter(role) if node.HasParameter(role) else None for role in roles], [
            node.GetNodeReference(role) for role in roles
        ]

    assert stored() == ([None, None, "True"], [None, None, None])
    p.either = table
    assert stored() == ([None, "", None], [None, table, None]) and not node.HasParameter("either")
    p.either = None
    assert stored() == ([None, None, "True"], [None, None, None])
    with pytest.raises(TypeError):
        p.either = node
    assert p.either is None


def test_a_union_without_none_cannot_be_made(host, node):
    from typing import Union

    from slicer.parameterNodeWrapper import parameterNodeWrapper

    kind = Union[host.vtkMRMLModelNode, host.vtkMRMLTableNode]  # noqa: UP007
    made = parameterNodeWrapper(type("Bad", (), {"__annotations__": {"x": kind}}))
    with pytest.raises(TypeError, match="None"):
        made(node)


def test_a_scene_of_its_own(classes, node, host, tmp_path):
    p = classes(node)
    p.model = host.mrmlScene.AddNewNodeByClass("vtkMRMLModelNode", "atrium")
    p.size, name = 9.5, node.GetName()
    assert host.util.saveScene(str(tmp_path / "scene.mrml"), {})
    host.mrmlScene.Clear(0)
    host.util.loadScene(str(tmp_path / "scene.mrml"), {})
    again = classes(host.mrmlScene.GetFirstNodeByName(name))
    assert again.model.GetName() == "atrium" and again.size == 9.5


@pytest.mark.parametrize(
    ("name", "value", "error"),
    [
        ("count", None, ValueError),
        ("count", 1.5, TypeError),
        ("size", 0.5, ValueError),
        ("size", "4", TypeError),
        ("low", 1, ValueError),
        ("high", 10, ValueError),
        ("kind", "c", ValueError),
        ("on", 1, TypeError),
        ("name", 3, TypeError),
        ("shape", "DISK", TypeError),
        ("folder", "text", TypeError),
        ("model", "vtkMRMLModelNode1", TypeError),
    ],
)
def test_refused_values_change_nothing(classes, node, name, value, error):
    p = classes(node)
    before = getattr(p, name)
    with pytest.raises(error):
        setattr(p, name, value)
    assert getattr(p, name) == before == getattr(classes(node), name)


def test_changes_are_seen_from_outside(classes, node):
    # Not by the first parameter: VTK tells the first observer of an object last, and each parameter has its own.
    p, events = classes(node), []
    assert p.low == 5
    p.AddObserver("ModifiedEvent", lambda *_: events.append(p.low))
    node.SetParameter("low", "8")
    p.low = 9
    assert events == [8, 9]


def test_a_value_is_read_when_the_node_says_that_it_has_changed_and_not_later(classes, node, host):
    p, model = classes(node), host.mrmlScene.AddNewNodeByClass("vtkMRMLModelNode")
    modifying = node.StartModify()
    node.SetNodeReferenceID("model", model.GetID())
    assert p.model is None
    node.EndModify(modifying)
    assert p.model is model


def test_closing_the_scene_brings_the_defaults_back(classes, host):
    node = host.vtkMRMLScriptedModuleNode()
    node.SetSingletonTag("Some")
    p = classes(host.mrmlScene.AddNode(node))
    p.on, p.size = False, 2.0
    host.mrmlScene.Clear(0)
    assert (p.on, p.size) == (True, 4.0)


def test_unknown_types_and_names_are_refused(host, classes, node):
    from slicer.parameterNodeWrapper import parameterNodeWrapper

    for kind in (complex, Annotated[int, "a note"], list[int]):
        described = type("Bad", (), {"__annotations__": {"x": kind}})
        with pytest.raises(TypeError, match="knows no"):
            parameterNodeWrapper(described)
    with pytest.raises(ValueError, match="reserved"):
        parameterNodeWrapper(type("Bad", (), {"__annotations__": {"connectGui": int}}))
    with pytest.raises(ValueError, match="nothing"):
        classes(node).getValue("nothing")


def widgets():
    """A widget for each parameter, as the attributes of an object."""
    import ctk
    import qt
    import slicer

    kinds = {
        "count": qt.QSpinBox,
        "size": ctk.ctkSliderWidget,
        "name": qt.QLineEdit,
        "kind": qt.QComboBox,
        "on": qt.QCheckBox,
        "shape": qt.QComboBox,
        "folder": ctk.ctkPathLineEdit,
        "model": slicer.qMRMLNodeComboBox,
    }
    gui = type("Gui", (), {})()
    for name, kind in kinds.items():
        widget = kind()
        widget.setProperty("SlicerParameterName", name)
        setattr(gui, f"{name}Widget", widget)
    gui.modelWidget.noneEnabled = True
    gui.modelWidget.setMRMLScene(slicer.mrmlScene)
    return gui


def test_gui_and_node_follow_each_other(host_with_qt, classes, node):
    p, gui = classes(node), widgets()
    model = host_with_qt.mrmlScene.AddNewNodeByClass("vtkMRMLModelNode")
    tag = p.connectGui(gui)
    assert (gui.sizeWidget.minimum, gui.sizeWidget.maximum, gui.sizeWidget.value) == (1.0, 10.0, 4.0)
    assert [gui.shapeWidget.itemText(k) for k in range(2)] == ["Disk", "Square"] and gui.kindWidget.currentText == "b"
    assert list(gui.modelWidget.nodeTypes) == ["vtkMRMLModelNode"] and gui.onWidget.checked

    gui.countWidget.value, gui.sizeWidget.value, gui.nameWidget.text = 4, 6.0, "x"
    gui.kindWidget.currentText, gui.shapeWidget.currentIndex = "a", 1
    gui.folderWidget.currentPath = "somewhere"
    gui.onWidget.click()
    gui.modelWidget.setCurrentNode(model)
    assert (p.count, p.size, p.name, p.kind, p.on, p.shape) == (4, 6.0, "x", "a", False, Shape.SQUARE)
    assert p.folder == pathlib.Path("somewhere") and p.model is model

    p.count, p.on, p.shape, p.model = 1, True, Shape.DISK, None
    assert (gui.countWidget.value, gui.onWidget.checked, gui.shapeWidget.currentIndex) == (1, True, 0)
    assert gui.modelWidget.currentNode() is None

    p.disconnectGui(tag)
    gui.countWidget.value = 5
    p.name = "y"
    assert p.count == 1 and gui.nameWidget.text == "x"


def test_gui_that_does_not_fit_is_refused(host_with_qt, classes, node):
    import ctk
    import qt

    p = classes(node)
    for name, widget in (("name", ctk.ctkPathLineEdit()), ("count", qt.QCheckBox()), ("name", qt.QComboBox())):
        with pytest.raises(RuntimeError):
            p.connectParametersToGui({name: widget})
    with pytest.raises(ValueError, match="noSuch"):
        p.connectParametersToGui({"noSuch": qt.QSpinBox()})
