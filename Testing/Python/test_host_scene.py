"""The host's scene, files, subject hierarchy, views and window are the real MRML at work."""

from __future__ import annotations

import numpy as np
import pytest

RADIUS = 30.0


def ball(slicer, name: str = "ball"):
    """A model node: a sphere about the origin."""
    import vtk

    source = vtk.vtkSphereSource()
    source.SetRadius(RADIUS)
    source.SetThetaResolution(60)
    source.SetPhiResolution(60)
    source.Update()
    node = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLModelNode", name)
    node.SetAndObservePolyData(source.GetOutput())
    node.CreateDefaultDisplayNodes()
    return node


@pytest.fixture
def front(host_with_views):
    """The first 3D view, looking at a ball along +y; and the place of a point in it in pixels."""
    import vtk

    slicer = host_with_views
    ball(slicer)
    view = slicer.app.layoutManager().threeDWidget(0).threeDView()
    camera = view.cameraNode()
    camera.SetPosition(0, -200, 0)
    camera.SetFocalPoint(0, 0, 0)
    camera.SetViewUp(0, 0, 1)
    view.mrmlViewNode().SetBoxVisible(0)
    view.mrmlViewNode().SetAxisLabelsVisible(0)
    view.resetCamera()
    view.forceRender()

    def pixel(point):
        place = vtk.vtkCoordinate()
        place.SetCoordinateSystemToWorld()
        place.SetValue(*point)
        return place.GetComputedDisplayValue(view.renderer())

    return view, pixel


def pixels(view):
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy

    view.forceRender()
    shot = vtk.vtkWindowToImageFilter()
    shot.SetInput(view.renderWindow())
    shot.ReadFrontBufferOff()
    shot.Update()
    image = shot.GetOutput()
    width, height, _ = image.GetDimensions()
    return vtk_to_numpy(image.GetPointData().GetScalars()).reshape(height, width, 3).copy()


def send(view, name, place):
    view.interactor().SetEventInformation(int(place[0]), int(place[1]), 0, 0)
    view.interactor().InvokeEvent(name)


def test_the_ball_is_drawn_where_it_is(front):
    view, pixel = front
    image = pixels(view)
    middle, beside = pixel((0, -RADIUS, 0)), pixel((0, 0, 1.3 * RADIUS))
    assert np.abs(image[middle[1], middle[0]].astype(int) - image[beside[1], beside[0]]).max() > 40


def test_a_fiducial_follows_the_mouse(front, host):
    view, pixel = front
    seeds = host.mrmlScene.AddNewNodeByClass("vtkMRMLMarkupsFiducialNode", "seeds")
    seeds.CreateDefaultDisplayNodes()
    seeds.GetDisplayNode().SetSnapMode(seeds.GetDisplayNode().SnapModeToVisibleSurface)
    start = np.array([15.0, -np.sqrt(RADIUS**2 - 15.0**2), 0.0])
    end = np.array([0.0, -np.sqrt(RADIUS**2 - 12.0**2), 12.0])
    seeds.AddControlPoint(start)
    other = seeds.AddControlPoint(-end)
    view.forceRender()
    events = []
    for name in ("PointStartInteractionEvent", "PointModifiedEvent", "PointEndInteractionEvent"):
        seeds.AddObserver(getattr(seeds, name), lambda *_, name=name: events.append(name))
    send(view, "EnterEvent", pixel(start))
    send(view, "MouseMoveEvent", pixel(start))
    host.util.clickAndDrag(view, start=pixel(start), end=pixel(end), steps=6)
    np.testing.assert_allclose(seeds.GetNthControlPointPositionWorld(0), end, atol=0.5)
    np.testing.assert_allclose(seeds.GetNthControlPointPositionWorld(other), -end)
    assert events[0] == "PointStartInteractionEvent" and events[-1] == "PointEndInteractionEvent"
    assert events.count("PointModifiedEvent") >= 5


def test_a_click_places_a_point_in_place_mode(front, host):
    view, pixel = front
    seeds = host.mrmlScene.AddNewNodeByClass("vtkMRMLMarkupsFiducialNode", "placed")
    seeds.CreateDefaultDisplayNodes()
    host.modules.markups.logic().SetActiveList(seeds)
    interaction = host.mrmlScene.GetNodeByID("vtkMRMLInteractionNodeSingleton")
    interaction.SetCurrentInteractionMode(interaction.Place)
    view.forceRender()
    for name in ("EnterEvent", "MouseMoveEvent", "LeftButtonPressEvent", "LeftButtonReleaseEvent"):
        send(view, name, pixel((0, -RADIUS, 0)))
    assert seeds.GetNumberOfDefinedControlPoints() == 1
    np.testing.assert_allclose(seeds.GetNthControlPointPositionWorld(0), (0, -RADIUS, 0), atol=0.5)
    assert interaction.GetCurrentInteractionMode() == interaction.ViewTransform


def test_views_are_drawn_when_events_are_processed(front, host):
    view, _ = front
    drawn = []
    tag = view.renderWindow().AddObserver("EndEvent", lambda *_: drawn.append(1))
    host.app.processEvents()
    drawn.clear()
    host.app.pauseRender()
    host.util.getNode("ball").GetDisplayNode().SetColor(1, 0, 0)
    host.app.processEvents()
    assert not drawn
    host.app.resumeRender()
    assert len(drawn) == 1
    host.app.processEvents()
    assert len(drawn) == 1
    view.renderWindow().RemoveObserver(tag)


def test_views_of_a_layout_of_the_module(host_with_views):
    slicer = host_with_views
    manager = slicer.app.layoutManager()
    label = '<property name="viewlabel" action="default">{0}</property>'
    item = f'<item><view class="vtkMRMLViewNode" singletontag="{{0}}">{label}</view></item>'
    before, changed = manager.layout, []
    manager.connect("layoutChanged(int)", changed.append)
    node = manager.layoutLogic().GetLayoutNode()
    if not node.IsLayoutDescription(990):
        node.AddLayoutDescription(990, f'<layout type="horizontal">{item.format("1")}{item.format("Beside")}</layout>')
    manager.setLayout(990)
    beside = manager.threeDWidget("Beside").mrmlViewNode()
    assert beside.GetLayoutName() == "Beside" and beside.IsMappedInLayout() and changed == [990]
    assert slicer.modules.cameras.logic().GetViewActiveCameraNode(beside) is not None
    manager.setLayout(before)
    assert not beside.IsMappedInLayout() and manager.threeDWidget("1").mrmlViewNode().IsMappedInLayout()
    assert manager.threeDWidget("nowhere") is None
    manager.disconnect("layoutChanged(int)", changed.append)


@pytest.mark.parametrize("name", ["scene.mrb", "scene.mrml"])
def test_scene_and_hierarchy_come_back(host, tmp_path, name):
    model = ball(host)
    hierarchy = host.vtkMRMLSubjectHierarchyNode.GetSubjectHierarchyNode(host.mrmlScene)
    folder = hierarchy.CreateFolderItem(hierarchy.GetSceneItemID(), "patient")
    hierarchy.SetItemParent(hierarchy.GetItemByDataNode(model), folder)
    if name.endswith(".mrml"):
        assert host.util.saveNode(model, str(tmp_path / "ball.vtp"), {})
    assert host.util.saveScene(str(tmp_path / name), {})
    host.mrmlScene.Clear(0)
    assert host.mrmlScene.GetFirstNodeByName("ball") is None
    host.util.loadScene(str(tmp_path / name), {})
    again = host.util.getNode("ball")
    assert again.GetPolyData().GetNumberOfPoints() == 3482
    hierarchy = host.vtkMRMLSubjectHierarchyNode.GetSubjectHierarchyNode(host.mrmlScene)
    assert hierarchy.GetItemName(hierarchy.GetItemParent(hierarchy.GetItemByDataNode(again))) == "patient"


def test_hierarchy_items_come_and_go_with_their_nodes(host):
    hierarchy = host.vtkMRMLSubjectHierarchyNode.GetSubjectHierarchyNode(host.mrmlScene)
    model = ball(host)
    item = hierarchy.GetItemByDataNode(model)
    assert item and hierarchy.GetItemName(item) == "ball"
    host.mrmlScene.RemoveNode(model)
    assert hierarchy.GetItemByName("ball") == hierarchy.GetInvalidItemID()


@pytest.mark.parametrize("name", ["a.vtp", "a.vtk", "a.stl", "a.ply", "a.obj"])
def test_models_are_saved_and_loaded(host, tmp_path, name):
    model = ball(host)
    assert host.util.saveNode(model, str(tmp_path / name), {})
    loaded = host.util.loadNodeFromFile(str(tmp_path / name), properties={})
    np.testing.assert_allclose(loaded.GetPolyData().GetBounds(), model.GetPolyData().GetBounds(), atol=1e-3)


def test_markups_are_saved_and_loaded(host, tmp_path):
    seeds = host.mrmlScene.AddNewNodeByClass("vtkMRMLMarkupsFiducialNode", "seeds")
    seeds.AddControlPoint((1.0, 2.0, 3.0), "LAA")
    assert host.util.saveNode(seeds, str(tmp_path / "s.mrk.json"), {})
    loaded = host.util.loadMarkups(str(tmp_path / "s.mrk.json"))
    assert loaded.GetNthControlPointLabel(0) == "LAA"
    np.testing.assert_allclose(loaded.GetNthControlPointPositionWorld(0), (1, 2, 3))


def test_a_file_that_is_not_there(host, tmp_path):
    with pytest.raises(RuntimeError, match="missing"):
        host.util.loadNodeFromFile(str(tmp_path / "missing.vtp"), properties={})
    (tmp_path / "a.xyz").write_text("")
    with pytest.raises(RuntimeError, match=r"a\.xyz"):
        host.util.loadNodeFromFile(str(tmp_path / "a.xyz"), properties={})


def test_exceptions_in_callbacks_reach_the_hook(host_with_qt, monkeypatch):
    """What the fixture that fails such tests relies on."""
    import sys

    import qt

    caught = []
    monkeypatch.setattr(sys, "excepthook", lambda kind, *_: caught.append(kind))
    node = ball(host_with_qt)
    node.AddObserver("ModifiedEvent", lambda *_: 1 / 0)
    node.Modified()
    button = qt.QPushButton()
    button.connect("clicked()", lambda: [][0])
    button.click()
    assert caught == [ZeroDivisionError, IndexError]
