"""The host refuses what it does not know, in code and in .ui files."""

from __future__ import annotations

import sys

import pytest

UI = """<?xml version="1.0" encoding="UTF-8"?>
<ui version="4.0"><class>Form</class><widget class="qMRMLWidget" name="Form"><layout class="QVBoxLayout" name="column">
<item><widget class="{widget}" name="thing"><property name="{property}"><bool>true</bool></property></widget></item>
<item><widget class="ctkPathLineEdit" name="folder"><property name="filters">
<set>ctkPathLineEdit::{filter}|ctkPathLineEdit::Writable</set></property></widget></item>
<item><widget class="qMRMLNodeComboBox" name="box"/></item>
</layout></widget><connections><connection><sender>Form</sender><signal>{signal}</signal><receiver>box</receiver>
<slot>{slot}</slot></connection></connections></ui>
"""
GOOD = {
    "widget": "QPushButton",
    "property": "enabled",
    "filter": "Dirs",
    "signal": "mrmlSceneChanged(vtkMRMLScene*)",
    "slot": "setMRMLScene(vtkMRMLScene*)",
}


@pytest.fixture
def load(host_with_qt, tmp_path):
    def load_form(**changes):
        path = tmp_path / "form.ui"
        path.write_text(UI.format(**{**GOOD, **changes}))
        return host_with_qt.util.loadUI(str(path))

    return load_form


def test_good_form(load, host_with_qt):
    import ctk

    form = load()
    ui = host_with_qt.util.childWidgetVariables(form)
    assert ui.folder.filters == ctk.ctkPathLineEdit.Dirs | ctk.ctkPathLineEdit.Writable
    form.setMRMLScene(host_with_qt.mrmlScene)
    assert ui.box.mrmlScene() is host_with_qt.mrmlScene


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"widget": "ctkNoSuchButton"}, "ctkNoSuchButton"),
        ({"widget": "QPushButon"}, "QPushButon"),
        ({"property": "enabeld"}, "enabeld"),
        ({"filter": "Dirz"}, "Dirz"),
        ({"signal": "sceneChanged(vtkMRMLScene*)"}, "sceneChanged"),
        ({"slot": "setMRMLSceen(vtkMRMLScene*)"}, "setMRMLSceen"),
    ],
)
def test_form_with_a_typo(load, change, named):
    with pytest.raises((ValueError, AttributeError), match=named):
        load(**change)


WIDGETS = [
    "ctkCollapsibleButton",
    "ctkSliderWidget",
    "ctkDoubleSlider",
    "ctkDoubleSpinBox",
    "ctkPathLineEdit",
    "ctkDirectoryButton",
    "qMRMLWidget",
    "qMRMLNodeComboBox",
    "qMRMLSliderWidget",
    "qMRMLTableView",
    "qSlicerMarkupsPlaceWidget",
    "qSlicerSimpleMarkupsWidget",
    "QPushButton",
    "QTableWidget",
    "QTimer",
    "QFormLayout",
]


@pytest.mark.parametrize("name", WIDGETS)
def test_widget_with_a_typo(host_with_qt, name):
    import ctk
    import qt

    widget = next(getattr(module, name) for module in (ctk, host_with_qt, qt) if hasattr(module, name))()
    with pytest.raises(AttributeError, match="noSuchThing"):
        _ = widget.noSuchThing
    with pytest.raises(AttributeError, match="noSuchThing"):
        widget.noSuchThing = 1
    with pytest.raises(AttributeError, match="noSuchThing"):
        widget.connect("noSuchThing(bool)", print)
    with pytest.raises(TypeError):
        widget.connect("destroyed()", "noSlot")


def test_read_only_property(host_with_qt):
    import qt

    with pytest.raises(AttributeError, match="count"):
        qt.QComboBox().count = 3


def test_python_subclass_takes_attributes(host_with_qt):
    import qt

    class Diagram(qt.QLabel):
        pass

    diagram = Diagram()
    diagram.chosen = "LAA"
    assert diagram.chosen == "LAA"


@pytest.mark.parametrize("module", ["qt", "ctk", "slicer"])
def test_unknown_class(host_with_qt, module):
    with pytest.raises(AttributeError):
        _ = sys.modules[module].qNoSuchWidget


def test_application_and_views(host_with_views):
    app = host_with_views.app
    for owner in (app, app.layoutManager(), app.layoutManager().threeDWidget(0).threeDView(), app.moduleManager()):
        with pytest.raises(AttributeError):
            _ = owner.noSuchThing
        with pytest.raises(AttributeError):
            owner.noSuchThing = 1
    for owner in (app, app.layoutManager(), app.moduleManager()):
        with pytest.raises(AttributeError, match="noSuchThing"):
            owner.connect("noSuchThing()", print)


def test_sample_data_that_would_be_downloaded(host):
    import SampleData

    register = SampleData.SampleDataLogic.registerCustomSampleDataSource
    with pytest.raises(ValueError, match="customDownloader"):
        register(category="Cardiac", sampleName="remote", uris="somewhere")
    with pytest.raises(TypeError):
        register(category="Cardiac", sampleName="a", customDownloader=print, description="no such argument")


@pytest.mark.parametrize("signal", ["clicked()", "clicked(bool)"])
def test_slots_get_what_they_take(host_with_qt, signal):
    import qt

    got = []
    button = qt.QPushButton()
    button.checkable = True
    button.connect(signal, lambda *values: got.append(values))
    button.click()
    assert got == [(True,) if signal == "clicked(bool)" else ()]


def test_disconnected_slot_is_not_called(host_with_qt):
    import qt

    got = []
    button = qt.QPushButton()
    button.connect("clicked()", got.append)
    slot = lambda: got.append("kept")  # noqa: E731
    button.connect("clicked()", slot)
    assert button.disconnect("clicked()", got.append)
    assert not button.disconnect("clicked()", print)
    button.click()
    assert got == ["kept"]
