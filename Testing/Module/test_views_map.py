"""What the two views show, drawn off screen: the map framed, the overlay, the colours, each object in its place."""

import numpy as np
import slicer
import vtk
from LAFlatteningScene import views
from LAFlatteningScene.overlay import places
from logic_case import addArray, addAtrium, addModel, addSeeds, array, points, seedPosition, triangles
from view_case import GREEN, ViewCase, like, middle, onScreen, picture

from LAFlatteningLib import Rule, Template


class FrameTest(ViewCase):
    """The map fills its view and stays flat."""

    def test_theDiskIsFramed(self):
        pixels = picture(self.right)
        height, width, _ = pixels.shape
        rows, columns = np.nonzero(like(pixels, GREEN))
        across = min(height, width) / views.MARGIN
        self.assertAlmostEqual(np.ptp(rows), across, delta=4)
        self.assertAlmostEqual(np.ptp(columns), across, delta=4)
        np.testing.assert_allclose(
            [0.5 * (columns.min() + columns.max()), 0.5 * (rows.min() + rows.max())],
            [0.5 * width, 0.5 * height],
            atol=3,
        )

    def test_holesAreOpen(self):
        pixels = picture(self.right)
        for hole in ((20.5, 8.375), (-25.0, -10.0), (-28.0, 28.5)):
            column, row = onScreen(self.right, (*hole, 0.0))
            np.testing.assert_array_equal(pixels[row, column], (255, 255, 255))
        column, row = onScreen(self.right, (0.0, 30.0, 0.0))
        self.assertTrue(like(pixels[row, column], GREEN))

    def test_aNarrowWindow(self):
        window, before = self.right.renderWindow(), self.right.renderWindow().GetSize()
        window.SetSize(240, 480)
        self.addCleanup(window.SetSize, *before)
        self.logic.frameMap()
        columns = np.nonzero(like(picture(self.right), GREEN))[1]
        self.assertAlmostEqual(np.ptp(columns), 240 / views.MARGIN, delta=4)

    def test_draggingMovesTheMapWithoutTurningIt(self):
        before = middle(like(picture(self.right), GREEN))
        start = onScreen(self.right, (5.0, 5.0, 0.0))
        self.drag(self.right, start, start + np.array((40, 25)))
        after = middle(like(picture(self.right), GREEN))
        np.testing.assert_allclose(after - before, (40, 25), atol=3)
        camera = views.cameraOf(self.logic.mapViewNode())
        np.testing.assert_allclose(camera.GetViewUp(), (0.0, 1.0, 0.0), atol=1e-9)
        np.testing.assert_allclose(np.array(camera.GetPosition())[:2], np.array(camera.GetFocalPoint())[:2], atol=1e-6)
        self.logic.frameMap()
        np.testing.assert_allclose(middle(like(picture(self.right), GREEN)), before, atol=1)

    def test_theMapCannotBeTurned(self):
        before = picture(self.right)
        camera = views.cameraOf(self.logic.mapViewNode())
        camera.RotateTo(camera.Anterior)
        np.testing.assert_array_equal(picture(self.right), before)
        camera.SetViewUp(0.6, 0.8, 0.0)
        np.testing.assert_array_equal(picture(self.right), before)

    def test_theAtriumCanBeTurned(self):
        camera = self.lookAtTheAtrium()
        before = np.array(camera.GetPosition())
        self.left.forceRender()
        self.drag(self.left, np.array([30, 30]), np.array([120, 60]))
        self.assertGreater(np.linalg.norm(np.array(camera.GetPosition()) - before), 10.0)

    def test_zoomIsKeptWhenTheMapChanges(self):
        camera = views.cameraOf(self.logic.mapViewNode())
        self.logic.mapViewNode().SetFieldOfView(40.0)
        camera.SetParallelScale(20.0)
        self.logic.flattenParameters(self.p)
        self.assertAlmostEqual(camera.GetParallelScale(), 20.0)

    def test_otherDiameter(self):
        self.p.diskDiameter = 200.0
        self.logic.flattenParameters(self.p)
        pixels = picture(self.right)
        self.assertAlmostEqual(
            np.ptp(np.nonzero(like(pixels, GREEN))[0]), min(pixels.shape[:2]) / views.MARGIN, delta=4
        )

    def test_afterTheSceneWasClosed(self):
        self.logic.unlinkViews()
        slicer.mrmlScene.Clear(0)
        surface, seeds = addAtrium(), addSeeds(self.logic)
        self.p = self.parameters(surface, seeds)
        self.p.showTemplate = self.p.showLabels = False
        self.logic.showLayout()
        self.logic.linkViews(self.p)
        self.logic.flattenParameters(self.p)
        self.p.map.GetDisplayNode().SetScalarVisibility(False)
        self.p.map.GetDisplayNode().SetColor(0.0, 1.0, 0.0)
        node = self.logic.mapViewNode()
        self.assertEqual(node.GetRenderMode(), node.Orthographic)
        self.assertFalse(node.GetBoxVisible())
        pixels = picture(views.threeDView(node))
        self.assertAlmostEqual(
            np.ptp(np.nonzero(like(pixels, GREEN))[0]), min(pixels.shape[:2]) / views.MARGIN, delta=4
        )


class VisibilityTest(ViewCase):
    """Each object only where it belongs."""

    def shownIn(self, node, view):
        ids = [node.GetDisplayNode().GetNthViewNodeID(k) for k in range(node.GetDisplayNode().GetNumberOfViewNodeIDs())]
        return not ids or view.GetID() in ids

    def test_atriumAndSeedsLeftMapRight(self):
        left, right = self.logic.atriumViewNode(), self.logic.mapViewNode()
        for node in (self.surface, self.seeds):
            self.assertTrue(self.shownIn(node, left))
            self.assertFalse(self.shownIn(node, right))
        self.assertTrue(self.shownIn(self.p.map, right))
        self.assertFalse(self.shownIn(self.p.map, left))

    def test_whatIsLoadedLaterDoesNotCoverTheMap(self):
        before = picture(self.right)
        cube = vtk.vtkCubeSource()
        cube.SetXLength(60.0)
        cube.SetYLength(60.0)
        cube.SetZLength(60.0)
        cube.Update()
        node = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLModelNode", "Cube")
        node.SetAndObservePolyData(cube.GetOutput())
        node.CreateDefaultDisplayNodes()
        np.testing.assert_array_equal(picture(self.right), before)
        self.assertTrue(self.shownIn(node, self.logic.atriumViewNode()))

    def test_theMapDoesNotStandInTheAtriumView(self):
        camera = self.lookAtTheAtrium()
        camera.SetFocalPoint(0.0, 0.0, 0.0)
        camera.SetPosition(0.0, 0.0, 300.0)
        camera.SetViewUp(0.0, 1.0, 0.0)
        self.surface.GetDisplayNode().SetVisibility(False)
        self.p.showOpenings = False
        self.assertFalse(like(picture(self.left), GREEN).any())

    def test_whatTheUserChoseIsKept(self):
        node = addModel(points(self.surface), triangles(self.surface), "Only there")
        slice_ = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLViewNode", "Other view")
        node.GetDisplayNode().SetViewNodeIDs([slice_.GetID()])
        self.logic.linkViews(self.p)
        self.assertEqual(node.GetDisplayNode().GetNumberOfViewNodeIDs(), 1)
        self.assertEqual(node.GetDisplayNode().GetNthViewNodeID(0), slice_.GetID())


class OverlayTest(ViewCase):
    """Lines and names of the template."""

    def darkAt(self, pixels, place):
        """Whether something dark is drawn within 2 pixels of a place on the map."""
        column, row = onScreen(self.right, (*place, 0.0))
        near = pixels[row - 2 : row + 3, column - 2 : column + 3]
        return bool((near.max(axis=-1) < 90).any())

    def test_linesLieOnRimsAndPaths(self):
        # The upper point of the disk, and the middle of s3 between the left veins' rims (x = -25, y from -7 to 4.2).
        places = [(0.0, 50.0), (-25.0, -1.4)]
        self.assertFalse(any(self.darkAt(picture(self.right), place) for place in places))
        self.p.showTemplate = True
        self.assertTrue(all(self.darkAt(picture(self.right), place) for place in places))
        self.p.showTemplate = False
        self.assertFalse(any(self.darkAt(picture(self.right), place) for place in places))

    def test_namesStandInTheHolesAndRegions(self):
        without = picture(self.right)
        self.p.showLabels = True
        changed = (picture(self.right) != without).any(axis=-1)
        for place in ((20.5, 8.375), (20.5, -10.875), (-25.0, -10.0), (-25.0, 7.5), (-28.0, 28.5), (0.0, 53.0)):
            column, row = onScreen(self.right, (*place, 0.0))
            self.assertTrue(changed[row - 6 : row + 7, column - 12 : column + 13].any(), place)
        self.p.showLabels = False
        np.testing.assert_array_equal(picture(self.right), without)

    def test_namesOfRegionsStandInTheirRegions(self):
        flat, region = points(self.p.map), array(self.p.map, "region", True)
        middles = flat[triangles(self.p.map)].mean(axis=1)[:, :2]
        for name, place, kind in places(Template.load("adapted1")):
            if kind == "region":
                nearest = np.linalg.norm(middles - 100.0 * place, axis=1).argmin()
                self.assertEqual(f"R{region[nearest]}", name)

    def test_otherTemplate(self):
        self.p.showTemplate = True
        self.p.template = "adapted2"
        self.logic.flattenParameters(self.p)
        # RSPV of adapted2: centre (25, 10), radius 4.
        self.assertTrue(self.darkAt(picture(self.right), (29.0, 10.0)))

    def test_theOverlayGoesWithTheMap(self):
        overlay = [self.p.map.GetNodeReference(f"LAFlattening.{what}") for what in ("lines", "labels")]
        slicer.mrmlScene.RemoveNode(self.p.map)
        for node in overlay:
            self.assertIsNone(node.GetScene())

    def named(self, what):
        """The names of nodes that contain something, but for what keeps files and displays."""
        nodes = slicer.util.getNodesByClass("vtkMRMLNode")
        left_out = (slicer.vtkMRMLStorageNode, slicer.vtkMRMLScriptedModuleNode)
        return sorted(
            node.GetName() for node in nodes if what in (node.GetName() or "") and not isinstance(node, left_out)
        )

    def test_nothingOfADeletedMapIsLeft(self):
        self.logic.measureFibrosis(self.p.map, "LGE", Rule("value", (120.0,)))
        self.assertGreater(len(self.named("Atrium map")), 8)
        slicer.mrmlScene.RemoveNode(self.p.map)
        self.assertEqual(self.named("Atrium map"), [])
        # And nothing comes back.
        self.p.showLabels = False
        self.logic.updateViews()
        self.assertEqual(self.named("Atrium map"), [])

    def test_noCoversOfADeletedAtriumAreLeft(self):
        self.assertEqual(self.named("openings"), ["Atrium openings"])
        slicer.mrmlScene.RemoveNode(self.surface)
        self.assertEqual(self.named("openings"), [])
        self.p.showLabels = False
        self.assertEqual(self.named("openings"), [])


class ColoursTest(ViewCase):
    """Atrium and map in the same colours, whichever the user changes."""

    def look(self, node):
        display = node.GetDisplayNode()
        return (
            display.GetScalarVisibility(),
            display.GetActiveScalarName(),
            display.GetColorNodeID(),
            tuple(np.round(display.GetScalarRange(), 6)),
        )

    def show(self, node, name="LGE", low=50.0, high=150.0, colours="vtkMRMLColorTableNodeRainbow"):
        display = node.GetDisplayNode()
        display.SetActiveScalar(name, vtk.vtkAssignAttribute.POINT_DATA)
        display.SetAndObserveColorNodeID(colours)
        display.SetScalarRangeFlag(display.UseManualScalarRange)
        display.SetScalarRange(low, high)
        display.SetScalarVisibility(True)

    def test_fromTheAtrium(self):
        self.show(self.surface)
        self.assertEqual(self.look(self.p.map), (1, "LGE", "vtkMRMLColorTableNodeRainbow", (50.0, 150.0)))

    def test_fromTheMap(self):
        self.show(self.p.map, low=20.0, high=90.0, colours="vtkMRMLColorTableNodeGrey")
        self.assertEqual(self.look(self.surface), (1, "LGE", "vtkMRMLColorTableNodeGrey", (20.0, 90.0)))

    def test_eachChangeComesOnce(self):
        self.show(self.surface)
        seen = []
        for node in (self.surface, self.p.map):
            node.GetDisplayNode().AddObserver(vtk.vtkCommand.ModifiedEvent, lambda caller, _event: seen.append(caller))
        self.surface.GetDisplayNode().SetScalarRange(1.0, 2.0)
        self.assertEqual(self.look(self.p.map)[-1], (1.0, 2.0))
        self.assertEqual(seen.count(self.p.map.GetDisplayNode()), 1)
        self.assertEqual(seen.count(self.surface.GetDisplayNode()), 1)

    def test_rangeOfTheData(self):
        self.show(self.surface)
        self.surface.GetDisplayNode().SetScalarRangeFlag(self.surface.GetDisplayNode().UseDataScalarRange)
        values = array(self.surface, "LGE")
        np.testing.assert_allclose(self.p.map.GetDisplayNode().GetScalarRange(), (values.min(), values.max()))

    def test_hiddenOnOneHiddenOnTheOther(self):
        self.show(self.surface)
        self.p.map.GetDisplayNode().SetScalarVisibility(False)
        self.assertFalse(self.surface.GetDisplayNode().GetScalarVisibility())

    def test_anArrayAddedLater(self):
        values = np.linspace(0.0, 1.0, len(points(self.surface)))
        addArray(self.surface, "fibrosis", values)
        self.show(self.surface, "fibrosis", 0.0, 1.0)
        self.assertEqual(self.look(self.p.map)[1], "fibrosis")
        np.testing.assert_array_equal(array(self.p.map, "fibrosis"), values)

    def test_valuesChangedInPlace(self):
        slicer.util.arrayFromModelPointData(self.surface, "LGE")[:] = 77.0
        slicer.util.arrayFromModelPointDataModified(self.surface, "LGE")
        self.assertEqual(set(array(self.p.map, "LGE")), {77.0})

    def test_sameColourOnTheScreen(self):
        addArray(self.surface, "flag", np.full(len(points(self.surface)), 3.0))
        self.show(self.surface, "flag", 0.0, 4.0)
        wanted = [0.0, 0.0, 0.0]
        table = self.surface.GetDisplayNode().GetColorNode().GetLookupTable()
        copy = vtk.vtkLookupTable()
        copy.DeepCopy(table)
        copy.SetRange(0.0, 4.0)
        copy.GetColor(3.0, wanted)
        column, row = onScreen(self.right, (0.0, 30.0, 0.0))
        np.testing.assert_allclose(picture(self.right)[row, column], 255.0 * np.array(wanted), atol=3)

    def test_withoutColoursRegionsAreShownOnBoth(self):
        surface = addAtrium("Grey")
        self.p.surface, self.p.map = surface, None
        self.logic.flattenParameters(self.p)
        for node in (surface, self.p.map):
            self.assertEqual(self.look(node)[:2], (1, "region"))
        table = self.p.map.GetDisplayNode().GetColorNode()
        self.assertEqual(table.GetColorName(5), "R5 posterior wall between the veins")
        wanted = [0.0] * 4
        table.GetColor(4, wanted)
        # The widest part of the anterior wall.
        column, row = onScreen(self.right, (0.0, 30.0, 0.0))
        np.testing.assert_allclose(picture(self.right)[row, column], 255.0 * np.array(wanted[:3]), atol=3)


class OpeningsTest(ViewCase):
    """Covers of the openings, to put seeds on."""

    def covers(self):
        return self.surface.GetNodeReference("LAFlattening.openings")

    def test_shownAndHidden(self):
        self.assertTrue(self.covers().GetDisplayNode().GetVisibility())
        self.p.showOpenings = False
        self.assertFalse(self.covers().GetDisplayNode().GetVisibility())

    def test_everySeedOfAHoleLiesOnThem(self):
        locator = vtk.vtkCellLocator()
        locator.SetDataSet(self.covers().GetPolyData())
        locator.BuildLocator()
        for label in ("RSPV", "RIPV", "LIPV", "LSPV", "LAA"):
            nearest, cell, sub, squared = [0.0] * 3, vtk.reference(0), vtk.reference(0), vtk.reference(0.0)
            locator.FindClosestPoint(seedPosition(self.seeds, label), nearest, cell, sub, squared)
            self.assertLess(float(squared), 1.5**2)

    def test_theyFollowTheAtrium(self):
        before = points(self.covers()).mean(axis=0)
        node = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLTransformNode")
        matrix = np.eye(4)
        matrix[:3, 3] = (30.0, 0.0, 0.0)
        node.SetMatrixTransformToParent(slicer.util.vtkMatrixFromArray(matrix))
        self.surface.SetAndObserveTransformNodeID(node.GetID())
        np.testing.assert_allclose(points(self.covers()).mean(axis=0) - before, (30.0, 0.0, 0.0), atol=0.5)
