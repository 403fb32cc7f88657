"""The host's widgets answer as Slicer's own answered when they were asked the same (Host/real_answers.json)."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

ANSWERS = json.loads((Path(__file__).parents[1] / "Host" / "real_answers.json").read_text())
MODEL = "vtkMRMLModelNode"
NODE_CHANGED = "currentNodeChanged(vtkMRMLNode*)"

# Question -> what the host answers instead, and why.
EXCEPTIONS = {
    "bad signal": (
        "AttributeError",
        "Slicer prints that there is no such signal and goes on; here it is an error, so that a typo cannot pass",
    ),
}


class Desk:
    """Makes widgets and nodes for the questions, and turns answers into JSON."""

    def __init__(self, slicer):
        import ctk
        import qt

        self.slicer, self.scene, self.qt = slicer, slicer.mrmlScene, qt
        self._makers = (ctk, slicer, qt)

    def make(self, name: str):
        return next(getattr(module, name) for module in self._makers if hasattr(module, name))()

    def combo(self, **properties):
        box = self.make("qMRMLNodeComboBox")
        box.nodeTypes = [MODEL]
        for name, value in properties.items():
            setattr(box, name, value)
        box.setMRMLScene(self.scene)
        return box

    def add(self, name: str, **attributes):
        node = self.scene.CreateNodeByClass(MODEL)
        node.UnRegister(None)
        node.SetName(name)
        node.SetHideFromEditors(attributes.pop("hidden", 0))
        for key, value in attributes.items():
            node.SetAttribute(key, value)
        return self.scene.AddNode(node)

    @staticmethod
    def heard(widget, signal: str, action) -> list:
        """What the signal brings while ``action`` is done; nodes by name."""
        calls: list = []

        def hear(*values):
            calls.append([value.GetName() if hasattr(value, "GetName") else value for value in values])

        widget.connect(signal, hear)
        action()
        return calls


def name_of(node):
    return node.GetName() if node is not None else None


def put(widget, name, value):
    return lambda: setattr(widget, name, value)


# ---- sliders, sections, buttons ----


def slider_defaults(desk):
    slider = desk.make("ctkSliderWidget")
    return [slider.value, slider.minimum, slider.maximum, slider.decimals, slider.singleStep]


def slider_clamps(desk):
    slider = desk.make("ctkSliderWidget")
    slider.value = 1000
    return slider.value


def slider_signals(desk):
    slider = desk.make("ctkSliderWidget")

    def turn():
        slider.value = 5.0
        slider.value = 5.0
        slider.setValue(6)

    return desk.heard(slider, "valueChanged(double)", turn)


def slider_range(desk):
    desk.make("ctkSliderWidget").setRange(10, 20)


def slider_raised_minimum(desk):
    slider = desk.make("ctkSliderWidget")
    return desk.heard(slider, "valueChanged(double)", put(slider, "minimum", 5.0))


def section(desk):
    button = desk.make("ctkCollapsibleButton")
    first = [button.collapsed, button.checked]
    button.collapsed = True
    return [first, button.collapsed, button.checked, button.text]


def section_signal(desk):
    button = desk.make("ctkCollapsibleButton")
    return desk.heard(button, "contentsCollapsed(bool)", put(button, "collapsed", True))


def unknown_attribute(desk):
    desk.make("QPushButton").foo = 1
    return "allowed"


def unknown_signal(desk):
    return bool(desk.make("QPushButton").connect("nosuch(bool)", print))


def short_slot(desk):
    heard, button = [], desk.make("QPushButton")
    button.connect("clicked(bool)", lambda: heard.append(1))
    button.click()
    return heard


def signal_as_attribute(desk):
    heard, button = [], desk.make("QPushButton")
    button.clicked.connect(lambda checked: heard.append(1))
    button.click()
    return heard


def assigned(widget, name, value):
    def ask(desk):
        made = desk.make(widget)
        setattr(made, name, desk.scene if value == "an object" else value)
        return getattr(made, name)

    return ask


def combo_box(desk):
    box = desk.make("QComboBox")
    box.addItems(["a", "b"])
    box.currentIndex = 1
    return [box.currentText, box.count, box.itemText(0), box.findText("b")]


def property_called(desk):
    return desk.make("QPushButton").text()


def setters(desk):
    button = desk.make("QPushButton")
    button.setText("q")
    button.setEnabled(False)
    button.setToolTip("t")
    button.setVisible(False)
    return [button.text, button.enabled, button.toolTip, button.visible]


def label(desk):
    made = desk.make("QLabel")
    made.wordWrap = True
    made.text = "<b>x</b>"
    return [made.wordWrap, made.text]


def layout(desk):
    widget = desk.make("QWidget")
    kept = desk.qt.QVBoxLayout(widget)
    assert kept is not None
    return [callable(widget.layout), widget.layout().className()]


def dynamic_property(desk):
    widget = desk.make("QWidget")
    widget.setProperty("SlicerParameterName", "p")
    return [widget.property("SlicerParameterName"), widget.property("nope")]


def single_shot(desk):
    desk.qt.QTimer.singleShot(0, lambda: None)
    return "ok"


def table(desk):
    made = desk.make("QTableWidget")
    made.setRowCount(2)
    made.setColumnCount(1)
    made.setItem(0, 0, desk.qt.QTableWidgetItem("x"))
    return [made.rowCount, made.item(0, 0).text()]


# ---- node selector ----


def combo_defaults(desk):
    box = desk.make("qMRMLNodeComboBox")
    return {name: getattr(box, name) for name in ANSWERS["combo defaults"]}


def combo_empty(desk):
    box = desk.combo()
    return [box.currentNode(), box.currentNodeID, box.nodeCount()]


def combo_first_node(**properties):
    def ask(desk):
        box = desk.combo(**properties)
        return [desk.heard(box, NODE_CHANGED, lambda: desk.add("A")), name_of(box.currentNode())]

    return ask


def combo_second_node(desk):
    box = desk.combo()
    desk.add("A")
    desk.add("B")
    return [box.currentNode().GetName(), box.nodeCount()]


def combo_remove(desk):
    box = desk.combo()
    first = desk.add("A")
    desk.add("B")
    desk.scene.RemoveNode(first)
    return name_of(box.currentNode())


def combo_remove_selected(desk):
    box, node = desk.combo(noneEnabled=True), desk.add("A")
    box.setCurrentNode(node)
    return [desk.heard(box, NODE_CHANGED, lambda: desk.scene.RemoveNode(node)), box.currentNode()]


def combo_set_none(desk):
    box = desk.combo()
    desk.add("A")
    box.setCurrentNode(None)
    return name_of(box.currentNode())


def combo_hidden(desk):
    box = desk.combo()
    desk.add("A", hidden=1)
    return [box.nodeCount(), box.currentNode()]


def combo_add(desk):
    box = desk.combo(baseName="map")
    return [box.addNode().GetName(), box.addNode().GetName(), box.currentNode().GetName()]


def combo_add_unnamed(desk):
    # The scene counts the names it has given: when the real box was asked, "Model" had been given once.
    desk.scene.GenerateUniqueName("Model")
    return desk.combo().addNode().GetName()


def combo_other_class(desk):
    box = desk.combo(noneEnabled=True)
    box.setCurrentNode(desk.scene.AddNewNodeByClass("vtkMRMLScalarVolumeNode"))
    return box.currentNode()


def combo_bool_signal(desk):
    box, node = desk.combo(noneEnabled=True), desk.add("A")
    return desk.heard(box, "currentNodeChanged(bool)", lambda: box.setCurrentNode(node))


def combo_id_signal(desk):
    box, node = desk.combo(noneEnabled=True), desk.add("A")
    calls = desk.heard(box, "currentNodeIDChanged(QString)", lambda: box.setCurrentNode(node))
    return [len(calls), calls[0][0] == node.GetID()]


def combo_set_id(desk):
    box, node = desk.combo(noneEnabled=True), desk.add("A")
    box.currentNodeID = node.GetID()
    return box.currentNode().GetName()


def combo_rename(desk):
    box, node = desk.combo(), desk.add("A")
    node.SetName("Z")
    return box.currentNode().GetName()


def combo_batch(desk):
    box = desk.combo()
    desk.scene.StartState(desk.scene.BatchProcessState)
    desk.add("A")
    during = name_of(box.currentNode())
    desk.scene.EndState(desk.scene.BatchProcessState)
    return [during, name_of(box.currentNode())]


def combo_scene_closed(desk):
    box = desk.combo()
    desk.add("A")
    desk.scene.Clear(0)
    return [box.currentNode(), box.currentNodeID]


def combo_attribute(desk):
    box = desk.combo()
    box.addAttribute(MODEL, "k", "v")
    desk.add("A")
    before = box.nodeCount()
    desk.add("B", k="v")
    return [before, box.nodeCount(), name_of(box.currentNode())]


def combo_same_object(desk):
    box, node, same = desk.combo(noneEnabled=True), desk.add("A"), []
    box.connect(NODE_CHANGED, lambda changed: same.append(changed is node))
    box.setCurrentNode(node)
    return same


QUESTIONS = {
    "slider defaults": slider_defaults,
    "slider clamps": slider_clamps,
    "slider signals": slider_signals,
    "slider setRange": slider_range,
    "slider min>value": slider_raised_minimum,
    "collapsible": section,
    "collapsible signal": section_signal,
    "combo defaults": combo_defaults,
    "combo empty scene": combo_empty,
    "combo autoselect none=False on add": combo_first_node(),
    "combo none=True on add": combo_first_node(noneEnabled=True),
    "combo second add keeps": combo_second_node,
    "combo remove current": combo_remove,
    "combo remove current, none=True": combo_remove_selected,
    "combo setCurrentNode(None) none=False": combo_set_none,
    "combo hidden node": combo_hidden,
    "combo addNode": combo_add,
    "combo addNode no base": combo_add_unnamed,
    "combo wrong type set": combo_other_class,
    "combo bool signal": combo_bool_signal,
    "combo id signal": combo_id_signal,
    "combo set id": combo_set_id,
    "combo rename follows": combo_rename,
    "combo batch add": combo_batch,
    "combo after scene Clear": combo_scene_closed,
    "combo attribute filter": combo_attribute,
    "unknown attr set": unknown_attribute,
    "bad signal": unknown_signal,
    "fewer slot args": short_slot,
    "py-style signal": signal_as_attribute,
    "text type error": assigned("QPushButton", "text", 3),
    "enabled from int": assigned("QPushButton", "enabled", 1),
    "enabled from object": assigned("QPushButton", "enabled", "an object"),
    "enabled from None": assigned("QPushButton", "enabled", None),
    "spin int from float": assigned("QSpinBox", "value", 3.0),
    "combobox": combo_box,
    "method on property name": property_called,
    "setters exist": setters,
    "label pixmap/wordWrap": label,
    "layout attr": layout,
    "dynamic property": dynamic_property,
    "vtkobj signal arg type": combo_same_object,
    "QTimer.singleShot": single_shot,
    "table": table,
}


def test_every_answer_has_its_question():
    assert set(QUESTIONS) == set(ANSWERS)


@pytest.mark.parametrize("question", sorted(QUESTIONS))
def test_answers_as_the_real_widget(host_with_qt, question):
    desk = Desk(host_with_qt)
    try:
        answer = json.loads(json.dumps(QUESTIONS[question](desk)))
    except (AttributeError, TypeError) as error:
        answer = type(error).__name__
    if question in EXCEPTIONS:
        expected, reason = EXCEPTIONS[question]
        assert reason and expected != ANSWERS[question]
    else:
        expected = ANSWERS[question]
    assert answer == expected
