"""Logic: from a surface and seeds to a map and what belongs to it."""

import math
import tempfile
from pathlib import Path

import numpy as np
import slicer
import vtk
from logic_case import (
    LogicCase,
    addArray,
    addAtrium,
    addModel,
    addSeeds,
    addTransform,
    array,
    moveSeed,
    phantom,
    points,
    sceneNodes,
    seedPosition,
    toRas,
    triangles,
)

from LAFlatteningLib import Cancelled, SeedError, SurfaceError, TemplateError

CIRCLES = {
    "RSPV": ((20.5, 8.375), 4.05),
    "RIPV": ((20.5, -10.875), 3.3),
    "LIPV": ((-25.0, -10.0), 3.0),
    "LSPV": ((-25.0, 7.5), 3.3),
    "LAA": ((-28.0, 28.5), 4.05),
    "MV": ((0.0, 0.0), 50.0),
}
"""The template of the paper on a disk of 100 mm: centres and radii, mm."""


class MapTest(LogicCase):
    """What a map is."""

    def setUp(self):
        super().setUp()
        self.surface, self.seeds = addAtrium(), addSeeds(self.logic)

    def test_samePointsInThePlane(self):
        flat = self.logic.flatten(self.surface, self.seeds)
        self.assertEqual(len(points(flat)), len(points(self.surface)))
        self.assertEqual(np.abs(points(flat)[:, 2]).max(), 0.0)
        np.testing.assert_array_equal(array(flat, "surface_point_id"), np.arange(len(points(flat))))
        np.testing.assert_array_equal(array(flat, "LGE"), array(self.surface, "LGE"))
        np.testing.assert_array_equal(array(flat, "true_region", True), array(self.surface, "true_region", True))

    def test_openingsLieOnTheCirclesOfTheTemplate(self):
        flat = points(self.logic.flatten(self.surface, self.seeds))[:, :2]
        for loop in phantom().surface.boundary_loops:
            ostium = phantom().surface.points[loop].mean(axis=0)
            holes = [label for label in CIRCLES if label != "MV"]
            near = min(holes, key=lambda label: np.linalg.norm(phantom().seeds[label] - ostium))
            name = near if np.linalg.norm(phantom().seeds[near] - ostium) < 2.0 else "MV"
            centre, radius = CIRCLES[name]
            np.testing.assert_allclose(np.linalg.norm(flat[loop] - centre, axis=1), radius, atol=1e-6, err_msg=name)

    def test_noTriangleIsFoldedOrLost(self):
        flat = self.logic.flatten(self.surface, self.seeds)
        corners = points(flat)[triangles(flat)][:, :, :2]
        (ax, ay), (bx, by) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
        areas = 0.5 * (ax * by - ay * bx)
        self.assertGreater(areas.min(), 0.0)
        # Rims are polygons of chords, so the holes and the disk are a little smaller than their circles.
        holes = sum(radius**2 for name, (_, radius) in CIRCLES.items() if name != "MV")
        self.assertAlmostEqual(areas.sum() / (math.pi * (50.0**2 - holes)), 1.0, delta=0.01)

    def test_diameter(self):
        flat = points(self.logic.flatten(self.surface, self.seeds, diskDiameter=60.0))
        self.assertAlmostEqual(np.linalg.norm(flat, axis=1).max(), 30.0, places=6)

    def test_regionsAgreeWithTheTruth(self):
        flat = self.logic.flatten(self.surface, self.seeds)
        region, truth = array(flat, "region", True), array(self.surface, "true_region", True)
        self.assertEqual(set(region), {1, 2, 3, 4, 5})
        self.assertGreater((region == truth).mean(), 0.93)
        np.testing.assert_array_equal(array(self.surface, "region", True), region)

    def test_anArrayOfTheUsersNamedRegionStays(self):
        mine = np.arange(len(triangles(self.surface)))
        addArray(self.surface, "region", mine, onCells=True)
        flat = self.logic.flatten(self.surface, self.seeds)
        np.testing.assert_array_equal(array(self.surface, "region", True), mine)
        self.assertEqual(set(array(flat, "region", True)), {1, 2, 3, 4, 5})

    def test_theInputStaysAsItIs(self):
        before, corners = points(self.surface), triangles(self.surface).copy()
        self.logic.flatten(self.surface, self.seeds)
        np.testing.assert_array_equal(points(self.surface), before)
        np.testing.assert_array_equal(triangles(self.surface), corners)

    def test_nothingIsShared(self):
        flat = self.logic.flatten(self.surface, self.seeds)
        before = points(flat)
        slicer.util.arrayFromModelPoints(flat)[:] = 7.0
        slicer.util.arrayFromModelPointData(flat, "LGE")[:] = -1.0
        again = self.logic.flatten(self.surface, self.seeds)
        np.testing.assert_allclose(points(again), before, atol=1e-9)
        self.assertGreater(array(self.surface, "LGE").min(), 0.0)

    def test_vectorsTextsAndComponentNamesTravelAlong(self):
        count = len(points(self.surface))
        addArray(self.surface, "vector", np.arange(3 * count, dtype=np.float32).reshape(count, 3))
        self.surface.GetPolyData().GetPointData().GetArray("vector").SetComponentName(1, "second")
        texts = vtk.vtkStringArray()
        texts.SetName("text")
        for k in range(count):
            texts.InsertNextValue(f"point {k}")
        self.surface.GetPolyData().GetPointData().AddArray(texts)
        data = self.logic.flatten(self.surface, self.seeds).GetPolyData().GetPointData()
        self.assertEqual(data.GetArray("vector").GetTuple(5), (15.0, 16.0, 17.0))
        self.assertEqual(data.GetArray("vector").GetComponentName(1), "second")
        self.assertEqual(data.GetArray("vector").GetDataType(), vtk.VTK_FLOAT)
        self.assertEqual(data.GetAbstractArray("text").GetValue(11), "point 11")

    def test_coversAreLeftOut(self):
        covered, mask, count = coveredAtrium(self.logic, self.surface, self.seeds)
        flat = self.logic.flatten(covered, self.seeds)
        ids = array(flat, "surface_point_id")
        self.assertEqual(len(ids), count)
        np.testing.assert_array_equal(array(flat, "number"), array(covered, "number")[ids])
        self.assertEqual(set(array(covered, "region", True)[mask]), {0})
        np.testing.assert_array_equal(array(covered, "region", True)[~mask], array(flat, "region", True))

    def test_linesBesideTheTrianglesDoNoHarm(self):
        polydata = self.surface.GetPolyData()
        lines = vtk.vtkCellArray()
        for k in range(3):
            lines.InsertNextCell(2, [k, k + 1])
        polydata.SetLines(lines)
        numbers = np.arange(polydata.GetNumberOfCells())
        polydata.GetCellData().RemoveArray("true_region")
        addArray(self.surface, "cell", numbers, onCells=True)
        flat = self.logic.flatten(self.surface, self.seeds)
        np.testing.assert_array_equal(array(flat, "cell", True), numbers[3:])


def coveredAtrium(logic, surface, seeds):
    """A model with covers over the five holes, marked; the mask of its cover triangles; the points of its cavity."""
    cavity = logic.cache.cavity(surface, logic.anatomy(), {"MV1": seedPosition(seeds, "MV1")})
    node = addModel(cavity.closed.points, cavity.closed.triangles, "Covered")
    inside = np.ones(len(cavity.closed.points), np.uint8)
    inside[cavity.ids] = 0
    addArray(node, "hole", inside)
    addArray(node, "number", np.arange(len(inside))[::-1].copy())
    return node, cavity.cover >= 0, len(cavity.ids)


class TransformTest(LogicCase):
    """Parent transforms count."""

    def setUp(self):
        super().setUp()
        self.surface, self.seeds = addAtrium(), addSeeds(self.logic)
        self.reference = points(self.logic.flatten(self.surface, self.seeds))

    def test_sameTransformOnBoth(self):
        shift = vtk.vtkTransform()
        shift.Translate(120.0, -30.0, 15.0)
        for node in (self.surface, self.seeds):
            addTransform(node, shift)
        flat = points(self.logic.flatten(self.surface, self.seeds))
        np.testing.assert_allclose(flat, self.reference, atol=0.05)

    def test_surfaceMovedAwayFromTheSeeds(self):
        shift = vtk.vtkTransform()
        shift.Translate(120.0, -30.0, 15.0)
        addTransform(self.surface, shift)
        with self.assertRaises(SeedError):
            self.logic.flatten(self.surface, self.seeds)

    def test_chainOfTransforms(self):
        turn, shift = vtk.vtkTransform(), vtk.vtkTransform()
        turn.RotateZ(8.0)
        shift.Translate(5.0, 6.0, 7.0)
        lower, upper = addTransform(self.surface, turn), None
        upper = addTransform(lower, shift)
        angle = np.deg2rad(8.0)
        matrix = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        moved = addModel(points(self.surface) @ matrix.T + np.array((5.0, 6.0, 7.0)), triangles(self.surface), "Moved")
        for label, position in phantom().seeds.items():
            moveSeed(self.seeds, label, matrix @ toRas(position) + np.array((5.0, 6.0, 7.0)))
        inChain = points(self.logic.flatten(self.surface, self.seeds))
        np.testing.assert_allclose(inChain, points(self.logic.flatten(moved, self.seeds)), atol=0.05)
        self.assertIsNotNone(upper)

    def test_nonlinear(self):
        rest, moved = vtk.vtkPoints(), vtk.vtkPoints()
        for corner in np.ndindex(2, 2, 2):
            place = np.array(corner) * 160.0 + np.array((-80.0, -60.0, -10.0))
            rest.InsertNextPoint(*place)
            moved.InsertNextPoint(*(place * (1.1, 1.0, 1.0) + (0.0, 0.0, 6.0 * (corner[0] != corner[1]))))
        warp = vtk.vtkThinPlateSplineTransform()
        warp.SetSourceLandmarks(rest)
        warp.SetTargetLandmarks(moved)
        warp.SetBasisToR()
        for node in (self.surface, self.seeds):
            addTransform(node, warp)
        warped = np.array([warp.TransformPoint(*place) for place in points(self.surface)])
        self.assertGreater(
            np.abs(warped - points(self.surface) - (warped - points(self.surface)).mean(axis=0)).max(), 2.0
        )
        plain = addModel(warped, triangles(self.surface), "Warped")
        plainSeeds = self.logic.createSeedsNode("Warped seeds")
        for label, position in phantom().seeds.items():
            self.logic.placeSeed(plainSeeds, label, warp.TransformPoint(*toRas(position)))
        flat = points(self.logic.flatten(self.surface, self.seeds))
        np.testing.assert_allclose(flat, points(self.logic.flatten(plain, plainSeeds)), atol=1e-3)
        self.assertGreater(np.linalg.norm(flat - self.reference, axis=1).max(), 0.2)


class NodesTest(LogicCase):
    """Names, links, groups."""

    def setUp(self):
        super().setUp()
        self.surface, self.seeds = addAtrium("Patient 7"), addSeeds(self.logic)

    def test_nameAndReferences(self):
        flat = self.logic.flatten(self.surface, self.seeds)
        self.assertEqual(flat.GetName(), "Patient 7 map")
        self.assertIs(flat.GetNodeReference("LAFlattening.surface"), self.surface)
        self.assertIs(flat.GetNodeReference("LAFlattening.seeds"), self.seeds)
        self.assertIs(self.surface.GetNodeReference("LAFlattening.map"), flat)

    def test_groupedWithTheSurface(self):
        flat = self.logic.flatten(self.surface, self.seeds)
        hierarchy = slicer.vtkMRMLSubjectHierarchyNode.GetSubjectHierarchyNode(slicer.mrmlScene)
        parent = hierarchy.GetItemByDataNode(self.surface)
        for node in (flat, self.seeds, self.logic.metricsTable(flat)):
            self.assertEqual(hierarchy.GetItemParent(hierarchy.GetItemByDataNode(node)), parent, node.GetName())

    def test_whereTheUserPutANodeItStays(self):
        hierarchy = slicer.vtkMRMLSubjectHierarchyNode.GetSubjectHierarchyNode(slicer.mrmlScene)
        folder = hierarchy.CreateFolderItem(hierarchy.GetSceneItemID(), "Mine")
        hierarchy.CreateItem(folder, self.seeds)
        self.logic.flatten(self.surface, self.seeds)
        self.assertEqual(hierarchy.GetItemParent(hierarchy.GetItemByDataNode(self.seeds)), folder)

    def test_anotherMapWithoutAnOutputNode(self):
        first, second = (self.logic.flatten(self.surface, self.seeds) for _ in range(2))
        self.assertIsNot(first, second)
        self.assertNotEqual(first.GetName(), second.GetName())
        self.assertEqual(self.surface.GetNumberOfNodeReferences("LAFlattening.map"), 2)

    def test_anOutputNodeIsReplacedAndNothingIsAdded(self):
        flat = self.logic.flatten(self.surface, self.seeds)
        before, nodes = points(flat), sceneNodes()
        moveSeed(self.seeds, "LAA", seedPosition(self.seeds, "LAA") + np.array((2.0, 0.0, 0.0)))
        self.assertIs(self.logic.flatten(self.surface, self.seeds, flat), flat)
        self.assertEqual(sceneNodes(), nodes)
        self.assertGreater(np.linalg.norm(points(flat) - before, axis=1).max(), 0.01)
        self.assertEqual(self.surface.GetNumberOfNodeReferences("LAFlattening.map"), 1)

    def test_aMapOfAnotherSurface(self):
        flat = self.logic.flatten(self.surface, self.seeds)
        other = addAtrium("Patient 8")
        self.logic.flatten(other, self.seeds, flat)
        self.assertEqual(self.surface.GetNumberOfNodeReferences("LAFlattening.map"), 0)
        self.assertIs(other.GetNodeReference("LAFlattening.map"), flat)

    def test_sceneSavedAndLoaded(self):
        parameters = self.parameters(self.surface, self.seeds)
        parameters.diskDiameter = 80.0
        flat = self.logic.flattenParameters(parameters)
        kept, arrays = points(flat), array(flat, "region", True)
        with tempfile.TemporaryDirectory() as folder:
            path = str(Path(folder) / "scene.mrb")
            self.assertTrue(slicer.util.saveScene(path))
            slicer.mrmlScene.Clear(0)
            slicer.util.loadScene(path)
        again = self.parametersOfTheScene()
        self.assertEqual(again.diskDiameter, 80.0)
        self.assertEqual(again.map.GetName(), "Patient 7 map")
        self.assertIs(again.surface.GetNodeReference("LAFlattening.map"), again.map)
        self.assertIs(again.map.GetNodeReference("LAFlattening.surface"), again.surface)
        self.assertIs(again.metrics, self.logic.metricsTable(again.map))
        np.testing.assert_allclose(points(again.map), kept, atol=1e-4)
        np.testing.assert_array_equal(array(again.map, "region", True), arrays)
        self.assertEqual(len(self.logic.histogramCharts(again.map)), 2)

    def parametersOfTheScene(self):
        from LAFlattening import LAFlatteningParameterNode

        return LAFlatteningParameterNode(self.logic.getParameterNode())


class QualityTest(LogicCase):
    """Tables and plots."""

    def setUp(self):
        super().setUp()
        self.surface, self.seeds = addAtrium(), addSeeds(self.logic)
        self.flat = self.logic.flatten(self.surface, self.seeds)

    def column(self, table, name):
        column = table.GetTable().GetColumnByName(name)
        return [column.GetVariantValue(k).ToString() for k in range(column.GetNumberOfValues())]

    def test_metricsHaveUnits(self):
        table = self.logic.metricsTable(self.flat)
        values = zip(self.column(table, "Value"), self.column(table, "Unit"), strict=True)
        rows = dict(zip(self.column(table, "Quantity"), values, strict=True))
        self.assertEqual(rows["map diameter"], ("100", "mm"))
        self.assertEqual(rows["points"][0], str(len(points(self.surface))))
        self.assertEqual(rows["folded triangles"][0], "0")
        for quantity, (value, unit) in rows.items():
            if unit == "mm":
                self.assertNotIn("e", value, quantity)
            if quantity not in ("template", "method"):
                self.assertTrue(unit, quantity)
                self.assertTrue(np.isfinite(float(value)), quantity)

    def test_regionAreasAreThoseOfTheSurface(self):
        table = self.logic.regionTable(self.flat)
        size = vtk.vtkCellSizeFilter()
        size.SetInputData(self.surface.GetPolyData())
        size.Update()
        area = np.array(
            [size.GetOutput().GetCellData().GetArray("Area").GetValue(k) for k in range(len(triangles(self.flat)))]
        )
        region = array(self.flat, "region", True)
        found = np.array(self.column(table, "Area on the atrium (mm2)"), float)
        np.testing.assert_allclose(found, [area[region == k].sum() for k in range(1, 6)], rtol=1e-5)
        for name in ("Share of the atrium (%)", "Share of the map (%)"):
            self.assertAlmostEqual(sum(map(float, self.column(table, name))), 100.0, places=3)

    def test_histogramsHoldAllTriangles(self):
        charts = self.logic.histogramCharts(self.flat)
        self.assertEqual(len(charts), 2)
        for chart in charts:
            series = chart.GetNthPlotSeriesNode(0)
            shares = np.array(self.column(series.GetTableNode(), series.GetYColumnName()), float)
            bins = np.array(self.column(series.GetTableNode(), series.GetXColumnName()), float)
            self.assertAlmostEqual(shares.sum(), 100.0, places=3)
            self.assertTrue((np.diff(bins) > 0).all())

    def test_areaRatiosInTheHistogram(self):
        series = self.logic.histogramCharts(self.flat)[0].GetNthPlotSeriesNode(0)
        shares = np.array(self.column(series.GetTableNode(), series.GetYColumnName()), float)

        def areas(node):
            a, b, c = points(node)[triangles(self.flat)].transpose(1, 0, 2)
            area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
            return area / area.sum()

        enlarged = (areas(self.flat) > areas(self.surface)).mean()
        self.assertAlmostEqual(shares[len(shares) // 2 :].sum(), 100.0 * enlarged, places=3)

    def test_previewLeavesTablesAlone(self):
        tables = [self.logic.metricsTable(self.flat), self.logic.regionTable(self.flat)]
        before = [table.GetMTime() for table in tables]
        moveSeed(self.seeds, "RSPV", seedPosition(self.seeds, "RSPV") + np.array((0.0, 1.5, 0.0)))
        data, old = self.flat.GetPolyData().GetPoints().GetData(), points(self.flat)
        self.logic.preview(self.surface, self.seeds, self.flat)
        self.assertEqual([table.GetMTime() for table in tables], before)
        self.assertIs(self.flat.GetPolyData().GetPoints().GetData(), data, "points are moved in place")
        self.assertGreater(np.linalg.norm(points(self.flat) - old, axis=1).max(), 0.05)
        self.assertAlmostEqual(np.linalg.norm(points(self.flat), axis=1).max(), 50.0, places=6)


class BadInputTest(LogicCase):
    """Errors say what to do, and nothing is left behind."""

    def refused(self, error, pattern, *arguments, **options):
        nodes = sceneNodes()
        with self.assertRaisesRegex(error, pattern):
            self.logic.flatten(*arguments, **options)
        self.assertEqual(sceneNodes(), nodes)
        self.assertFalse(self.logic.isBusy)

    def test_nothingSelected(self):
        self.refused(SurfaceError, "No surface is selected", None, None)
        self.refused(SeedError, "No seeds are selected", addAtrium(), None)

    def test_emptySurface(self):
        node = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLModelNode", "Nothing")
        self.refused(SurfaceError, '"Nothing" is empty', node, addSeeds(self.logic))

    def test_seedsMissing(self):
        seeds = addSeeds(self.logic, without=("LAA", "MV2"))
        self.refused(SeedError, "Seeds missing: LAA, MV2", addAtrium(), seeds)

    def test_metres(self):
        surface = addModel(toRas(phantom().surface.points) / 1000.0, phantom().surface.triangles)
        self.refused(SurfaceError, "metres", surface, addSeeds(self.logic))

    def test_swappedSeeds(self):
        seeds = addSeeds(self.logic)
        left, right = seedPosition(seeds, "LSPV"), seedPosition(seeds, "RSPV")
        moveSeed(seeds, "LSPV", right)
        moveSeed(seeds, "RSPV", left)
        self.refused(SeedError, "LSPV", addAtrium(), seeds)

    def test_noSuchTemplate(self):
        self.refused(TemplateError, "no template", addAtrium(), addSeeds(self.logic), template="adapted9")

    def test_cancelled(self):
        self.refused(Cancelled, "", addAtrium(), addSeeds(self.logic), progress=lambda share, text: share < 0.3)

    def test_progressGrows(self):
        told = []
        self.logic.flatten(addAtrium(), addSeeds(self.logic), progress=lambda share, text: told.append((share, text)))
        shares = [share for share, _ in told]
        self.assertEqual(shares, sorted(shares))
        self.assertEqual((shares[0], shares[-1]), (0.0, 1.0))
        self.assertTrue(all(text for _, text in told))

    def test_surfaceDeletedMeanwhile(self):
        surface, seeds = addAtrium(), addSeeds(self.logic)
        with self.assertRaisesRegex(Cancelled, "deleted"):
            self.logic.flatten(surface, seeds, progress=lambda *_: slicer.mrmlScene.RemoveNode(surface))
        self.assertEqual(slicer.mrmlScene.GetNumberOfNodesByClass("vtkMRMLTableNode"), 0)

    def test_sceneClosedMeanwhile(self):
        surface, seeds = addAtrium(), addSeeds(self.logic)
        with self.assertRaises(Cancelled):
            self.logic.flatten(surface, seeds, progress=lambda *_: slicer.mrmlScene.Clear(0))
        self.assertFalse(self.logic.isBusy)

    def test_surfaceReplacedMeanwhile(self):
        surface, seeds = addAtrium(), addSeeds(self.logic)

        def replace(share, _text):
            if share > 0.5:
                slicer.util.arrayFromModelPoints(surface)[:] += 3.0

        with self.assertRaisesRegex(Cancelled, "changed"):
            self.logic.flatten(surface, seeds, progress=replace)
        self.assertEqual(surface.GetNumberOfNodeReferences("LAFlattening.map"), 0)

    def test_surfaceReplacedByOneOfOtherTopology(self):
        surface, seeds = addAtrium(), addSeeds(self.logic)
        flat = self.logic.flatten(surface, seeds)
        before = points(flat)
        sphere = vtk.vtkSphereSource()
        sphere.SetRadius(40.0)
        sphere.Update()
        surface.SetAndObservePolyData(sphere.GetOutput())
        with self.assertRaisesRegex(SurfaceError, "openings"):
            self.logic.flatten(surface, seeds, flat)
        np.testing.assert_array_equal(points(flat), before)
