"""What is read off a map through the Logic is what the library finds, whatever transforms lie above the nodes."""

import csv
import json
import tempfile
import unittest
from pathlib import Path

import numpy as np
import slicer
import vtk
from analysis_case import AnalysisCase, addVolume, column, lgeVolume
from LAFlatteningScene.analysis_logic import ProjectionChoice, thresholdsFrom
from LAFlatteningScene.class_colours import classColours
from LAFlatteningScene.export import mapSurface
from LAFlatteningScene.fibrosis_nodes import classArrayOf
from LAFlatteningScene.map_reading import mapDataOf
from LAFlatteningScene.result_nodes import KIND, ON_MAP, resultsOf
from logic_case import (
    POINTS,
    Clock,
    addArray,
    addAtrium,
    addTransform,
    array,
    moveSeed,
    phantom,
    points,
    seedPosition,
)

from LAFlatteningLib import (
    Cancelled,
    InputFileError,
    LAFlatteningError,
    MapData,
    Rule,
    SurfaceError,
    Volume,
    find_gaps,
    flatten,
    measure_fibrosis,
    project,
)
from LAFlatteningLib.blood_pool import find_blood_pool


def rotation():
    """A rigid transform."""
    transform = vtk.vtkTransform()
    transform.Translate(11.0, -7.0, 23.0)
    transform.RotateWXYZ(35.0, 1.0, 2.0, -0.5)
    return transform


def bending():
    """A transform that is not linear: it bends and stretches by some mm."""
    grid = vtk.vtkThinPlateSplineTransform()
    source, target = vtk.vtkPoints(), vtk.vtkPoints()
    rng = np.random.default_rng(3)
    for x in (-80.0, 0.0, 80.0):
        for y in (-60.0, 10.0, 90.0):
            for z in (20.0, 80.0, 140.0):
                source.InsertNextPoint(x, y, z)
                target.InsertNextPoint(*(np.array([x, y, z]) + rng.uniform(-2.0, 2.0, 3)))
    grid.SetSourceLandmarks(source)
    grid.SetTargetLandmarks(target)
    grid.SetBasisToR()
    return grid


class ProjectionTest(AnalysisCase):
    """An image on the wall."""

    def expected(self, **options):
        return project(phantom().surface, lgeVolume(), **options).values

    def test_valuesAreTheLibrarys(self):
        found = self.logic.project(self.surface, addVolume())
        np.testing.assert_allclose(array(self.surface, "LGE"), self.expected(), rtol=1e-6)
        ids = array(self.map, "surface_point_id")
        np.testing.assert_array_equal(array(self.map, "LGE"), array(self.surface, "LGE")[ids])
        self.assertEqual(found.interval_mm, (-3.0, 3.0))

    def test_depthSideAndStatistic(self):
        volume = addVolume()
        for choice, options in (
            (ProjectionChoice(1.5, "in", "max"), {"depth_mm": 1.5, "side": "in"}),
            (ProjectionChoice(2.0, "out", "mean"), {"depth_mm": 2.0, "side": "out", "statistic": "mean"}),
            (ProjectionChoice(interval=(-1.0, 3.0)), {"interval_mm": (-1.0, 3.0)}),
        ):
            self.logic.project(self.surface, volume, choice)
            np.testing.assert_allclose(array(self.surface, "LGE"), self.expected(**options), rtol=1e-6)

    def test_transformAboveBothChangesNothing(self):
        volume = addVolume()
        parent = addTransform(self.surface, rotation())
        volume.SetAndObserveTransformNodeID(parent.GetID())
        self.logic.project(self.surface, volume)
        np.testing.assert_allclose(array(self.surface, "LGE"), self.expected(), rtol=1e-6)

    def test_transformAboveTheImageAloneCounts(self):
        volume = addVolume()
        addTransform(volume, rotation())
        with self.assertRaisesRegex(InputFileError, "does not overlap"):
            shift = vtk.vtkTransform()
            shift.Translate(500.0, 0.0, 0.0)
            addTransform(volume, shift)
            self.logic.project(self.surface, volume)
        self.assertFalse(self.surface.GetPolyData().GetPointData().HasArray("LGE projected"))

    def test_nonlinearTransformAboveBothMovesValuesByLittle(self):
        volume = addVolume()
        parent = addTransform(self.surface, bending())
        volume.SetAndObserveTransformNodeID(parent.GetID())
        self.logic.project(self.surface, volume)
        # The depth is 3 mm in the world; in the bent image some percent more or less.
        off = np.abs(array(self.surface, "LGE") - self.expected())
        self.assertLess(np.median(off), 1.0)
        self.surface.SetAndObserveTransformNodeID(None)
        self.logic.project(self.surface, volume)
        moved = np.abs(array(self.surface, "LGE") - self.expected())
        self.assertGreater(np.percentile(moved, 95), 2.0 * np.percentile(off, 95))

    def test_partOutsideIsCounted(self):
        whole = lgeVolume()
        half = Volume(whole.values[: len(whole.values) // 2], whole.spacing, whole.origin, whole.direction)
        found = self.logic.project(self.surface, addVolume(half))
        values = array(self.surface, "LGE")
        self.assertEqual(found.outside, np.isnan(values).sum())
        self.assertGreater(found.outside, POINTS // 10)
        self.assertIn("have no value", found.notes[0])

    def test_noImageNoAtrium(self):
        with self.assertRaisesRegex(InputFileError, "No image is selected"):
            self.logic.project(self.surface, None)
        with self.assertRaisesRegex(InputFileError, "has no voxels"):
            self.logic.project(self.surface, slicer.mrmlScene.AddNewNodeByClass("vtkMRMLScalarVolumeNode"))
        with self.assertRaisesRegex(SurfaceError, "No surface is selected"):
            self.logic.project(None, addVolume())

    def test_liveFollowsTheSlider(self):
        p = self.parameters(self.surface, self.seeds)
        clock, told = Clock(), []
        p.map, p.volume = self.map, addVolume()
        self.logic.startLiveProjection(p, clock.schedule, lambda found, text: told.append((found, text)))
        for depth in (2.0, 2.5, 3.5, 4.0, 5.0):
            p.projectionDepth = depth
        self.assertEqual(len(told), 1, "at once, and then not while the slider moves")
        clock.run(1.0)
        self.assertEqual(len(told), 2)
        np.testing.assert_allclose(array(self.surface, "LGE"), self.expected(depth_mm=5.0), rtol=1e-6)
        p.projectLive = False
        p.projectionDepth = 1.0
        clock.run(1.0)
        self.assertEqual(len(told), 2)
        self.logic.stopLiveProjection()

    def test_liveSaysWhyThereIsNone(self):
        p = self.parameters(self.surface, self.seeds)
        told = []
        self.logic.startLiveProjection(p, Clock().schedule, lambda found, text: told.append((found, text)))
        p.volume = addVolume(Volume(np.zeros((5, 5, 5)), np.ones(3), np.zeros(3), np.eye(3)))
        self.assertIsNone(told[-1][0])
        self.assertIn("everywhere", told[-1][1])


class FibrosisTest(AnalysisCase):
    """Classes of intensity and of voltage."""

    def setUp(self):
        super().setUp()
        self.volume = addVolume()
        self.logic.project(self.surface, self.volume)

    def libraryMap(self):
        return flatten(project(phantom().surface, lgeVolume()).on(phantom().surface), phantom().seeds)

    def test_areasAreTheLibrarys(self):
        rule = Rule("iir", (1.2, 1.32))
        found = self.logic.measureFibrosis(self.map, "LGE", rule, self.volume)
        pool = find_blood_pool(phantom().surface, lgeVolume())
        expected = measure_fibrosis(self.libraryMap(), "LGE", rule, pool, volume=lgeVolume())
        self.assertAlmostEqual(found.blood_pool.mean, pool.mean, delta=0.01 * pool.sd)
        for one, other in zip(found.parts, expected.parts, strict=True):
            self.assertEqual(one.name, other.name)
            self.assertAlmostEqual(one.beyond_percent, other.beyond_percent, delta=0.3)
        table = self.logic.fibrosisTable(self.map)
        self.assertEqual(column(table, "Part")[:2], ["whole atrium", "septal wall"])
        np.testing.assert_allclose(column(table, "Area (cm2)"), [part.area_cm2 for part in found.parts])
        np.testing.assert_allclose(column(table, "All of these (%)"), [part.beyond_percent for part in found.parts])

    def test_classesOnAtriumAndMap(self):
        found = self.logic.measureFibrosis(self.map, "LGE", Rule("value", (110.0, 130.0)))
        name = classArrayOf("LGE")
        classes = array(self.map, name, onCells=True)
        self.assertEqual(set(np.unique(classes)), {0, 1, 2})
        area = MapData.of(self.libraryMap()).surface.triangle_areas
        share = 100.0 * area[classes > 0].sum() / area.sum()
        self.assertAlmostEqual(share, found.atrium.beyond_percent, delta=3.0)
        display = self.surface.GetDisplayNode()
        self.assertEqual(display.GetActiveScalarName(), name)
        names = [display.GetColorNode().GetColorName(k) for k in range(4)]
        self.assertEqual(names, ["normal (< 110)", "border zone (110 to 130)", "dense fibrosis (≥ 130)", "no value"])
        self.assertEqual(display.GetScalarRange(), (0.0, 3.0))

    def test_lowVoltage(self):
        z = points(self.surface)[:, 2]
        volts = np.where(z > np.median(z), 2.0, 0.3)
        volts[:20] = -10000.0
        addArray(self.surface, "Bipolar", volts)
        found = self.logic.measureFibrosis(self.map, "Bipolar", Rule("value", (0.5, 0.1), "below"))
        self.assertEqual(found.unit, "mV")
        self.assertEqual(found.class_names, ("normal", "low", "scar"))
        self.assertGreater(found.atrium.missing_cm2, 0.0)
        self.assertEqual(found.atrium.class_cm2[2], 0.0, "what was not measured is no scar")
        self.assertGreater(found.atrium.class_percent[1], 20.0)

    def test_bloodPoolIsShownWhereItWasMeasured(self):
        parent = addTransform(self.surface, rotation())
        self.volume.SetAndObserveTransformNodeID(parent.GetID())
        found = self.logic.measureFibrosis(self.map, "LGE", Rule("iir", (1.2,)), self.volume)
        node = self.logic.bloodPoolNode(self.map)
        self.assertIs(node.GetParentTransformNode(), parent)
        voxels = slicer.util.arrayFromVolume(node)
        centre = np.argwhere(voxels > 0).mean(axis=0)[::-1]
        toRas = vtk.vtkMatrix4x4()
        node.GetIJKToRASMatrix(toRas)
        place = slicer.util.arrayFromVTKMatrix(toRas) @ (*centre, 1.0)
        inside = np.array(phantom().shape.centre) * (-1.0, -1.0, 1.0)
        self.assertLess(np.linalg.norm(place[:3] - inside), 5.0)
        self.assertIn(f"mean {found.blood_pool.mean:.4g}", self.logic.bloodPoolWords(self.map))

    def test_bloodOfTheUsers(self):
        region = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLLabelMapVolumeNode")
        image = vtk.vtkImageData()
        image.DeepCopy(self.volume.GetImageData())
        values = np.zeros(lgeVolume().values.shape, np.uint8)
        index = np.round(lgeVolume().indices(np.array([phantom().shape.centre])))[0].astype(int)
        i, j, k = index
        values[k - 3 : k + 4, j - 3 : j + 4, i - 3 : i + 4] = 1
        image.GetPointData().SetScalars(vtk.util.numpy_support.numpy_to_vtk(values.reshape(-1), deep=True))
        region.SetAndObserveImageData(image)
        region.CopyOrientation(self.volume)
        found = self.logic.measureFibrosis(self.map, "LGE", Rule("iir", (1.2,)), self.volume, region)
        self.assertEqual(found.blood_pool.how, "region drawn by the user")
        self.assertLessEqual(found.blood_pool.voxels, 343)
        empty = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLLabelMapVolumeNode")
        with self.assertRaisesRegex(InputFileError, "has no voxels"):
            self.logic.measureFibrosis(self.map, "LGE", Rule("sd", (3.0,)), self.volume, empty)

    def test_parcellations(self):
        found = self.logic.measureFibrosis(
            self.map, "LGE", Rule("value", (120.0,)), parcellations=["vein_segments", "vein_surroundings"]
        )
        groups = {part.group for part in found.parts}
        self.assertIn("vein_segments", groups)
        labels = array(self.surface, "vein_segments", onCells=True)
        self.assertEqual(len(np.unique(labels[labels > 0])), 18)
        ids = array(self.map, "surface_point_id")
        np.testing.assert_array_equal(array(self.map, "vein_segments"), array(self.surface, "vein_segments")[ids])

    def test_nothingIsWrittenAfterAnError(self):
        before = slicer.mrmlScene.GetNumberOfNodes()
        with self.assertRaisesRegex(LAFlatteningError, 'no array "nonsense"'):
            self.logic.measureFibrosis(self.map, "nonsense", Rule("value", (1.0,)))
        with self.assertRaisesRegex(InputFileError, "No image"):
            self.logic.measureFibrosis(self.map, "LGE", Rule("iir", (1.2,)))
        with self.assertRaisesRegex(SurfaceError, "Flatten the atrium first"):
            self.logic.measureFibrosis(None, "LGE", Rule("value", (1.0,)))
        self.assertEqual(slicer.mrmlScene.GetNumberOfNodes(), before)
        self.assertFalse(self.surface.GetPolyData().GetCellData().HasArray(classArrayOf("LGE")))

    def test_cancelChangesNothing(self):
        before = slicer.mrmlScene.GetNumberOfNodes()
        with self.assertRaises(Cancelled):
            self.logic.measureFibrosis(
                self.map, "LGE", Rule("iir", (1.2,)), self.volume, progress=lambda share, text: share < 0.3
            )
        self.assertEqual(slicer.mrmlScene.GetNumberOfNodes(), before)

    def test_typedThresholds(self):
        self.assertEqual(thresholdsFrom("1.2, 1.32"), (1.2, 1.32))
        self.assertEqual(thresholdsFrom("0.5;0.1"), (0.5, 0.1))
        for text, words in (("", "found none"), ("1.2, x", "as numbers")):
            with self.assertRaisesRegex(LAFlatteningError, words):
                thresholdsFrom(text)


class GapTest(AnalysisCase):
    """Gaps in ablation lines."""

    def test_lengthsAreTheLibrarys(self):
        table = self.logic.findGaps(self.map, "LGE", [110.0, 120.0, 130.0])
        expected = find_gaps(flatten(phantom().surface, phantom().seeds), "LGE", [110.0, 120.0, 130.0])
        rings = [ring for level in expected.thresholds for ring in expected.at(level).values()]
        np.testing.assert_allclose(column(table, "Gap length"), [ring.gap_length_mm for ring in rings], atol=0.05)
        np.testing.assert_allclose(column(table, "RGM"), [ring.rgm for ring in rings], atol=1e-3)
        self.assertEqual(column(table, "Gaps"), [len(ring.gaps) for ring in rings])
        self.assertEqual(column(table, "Of 3 mm"), [sum(gap.length_mm >= 3.0 for gap in ring.gaps) for ring in rings])

    def test_axesThatAreNotThePatientsAreNotNamed(self):
        def columnsOf(mapNode):
            self.logic.findGaps(mapNode, "LGE", [120.0])
            table = self.logic.gapListTable(mapNode).GetTable()
            return {table.GetColumnName(k) for k in range(table.GetNumberOfColumns())}

        self.assertLessEqual({"R (mm)", "A (mm)", "S (mm)"}, columnsOf(self.map))
        self.assertFalse(self.map.GetPolyData().GetFieldData().HasArray("patient_axes"))
        unknown = self.logic.flatten(self.surface, self.seeds, checkAxes=False)
        self.assertLessEqual({"x (mm)", "y (mm)", "z (mm)"}, columnsOf(unknown))
        self.assertFalse(mapDataOf(unknown).surface.axes_known)
        self.assertIn("estimated from the seeds", mapDataOf(unknown).frame.fact)
        self.assertFalse(mapSurface(unknown).axes_known)
        self.assertTrue(any("axes" in note for note in json.loads(unknown.GetAttribute("LAFlattening.notes"))))

    def test_curvesLieOnAtriumAndMap(self):
        self.logic.findGaps(self.map, "LGE", [120.0])
        curves = resultsOf(self.map, "gap curve")
        gaps = len(column(self.logic.gapListTable(self.map), "Gap"))
        self.assertEqual(len(curves), 2 * gaps)
        wall, disk = points(self.surface), points(self.map)
        for curve in curves:
            place = np.array(curve.GetNthControlPointPositionWorld(0))
            if curve.GetAttribute(ON_MAP):
                self.assertLess(np.linalg.norm(disk[:, :2] - place[:2], axis=1).min(), 3.0)
                self.assertLess(np.hypot(*place[:2]), 50.0)
            else:
                self.assertLess(np.linalg.norm(wall - place, axis=1).min(), 2.5)
        listed = column(self.logic.gapListTable(self.map), "Length")
        names = [curve.GetName() for curve in curves if curve.GetAttribute(ON_MAP)]
        named = sorted(float(name.split(": ")[1].split()[0]) for name in names)
        np.testing.assert_allclose(named, sorted(listed), atol=0.06)

    def test_lengthsSurviveATransform(self):
        before = column(self.logic.findGaps(self.map, "LGE", [120.0]), "Gap length")
        addTransform(self.surface, rotation())
        after = column(self.logic.findGaps(self.map, "LGE", [120.0]), "Gap length")
        np.testing.assert_allclose(after, before, atol=1e-6)

    def test_chartOverThresholds(self):
        self.logic.findGaps(self.map, "LGE", [120.0])
        self.assertIsNone(self.logic.gapChart(self.map))
        self.logic.findGaps(self.map, "LGE", [110.0, 120.0])
        chart = self.logic.gapChart(self.map)
        self.assertEqual(chart.GetNumberOfPlotSeriesNodes(), 6)

    def test_anotherRunReplacesTheFormer(self):
        self.logic.findGaps(self.map, "LGE", [110.0, 120.0])
        nodes = slicer.mrmlScene.GetNumberOfNodes()
        self.logic.findGaps(self.map, "LGE", [110.0, 120.0])
        self.assertEqual(slicer.mrmlScene.GetNumberOfNodes(), nodes)

    def test_thresholdsOutOfOrder(self):
        with self.assertRaises(LAFlatteningError):
            self.logic.findGaps(self.map, "LGE", [120.0, 110.0])


class ComparisonTest(AnalysisCase):
    """Two maps."""

    def test_aMapWithAnother(self):
        other = addAtrium("Other")
        addArray(other, "after", 200.0 - np.asarray(array(other, "LGE")))
        otherMap = self.logic.flatten(other, self.seeds)
        table = self.logic.compare(self.map, otherMap, "LGE", "LGE")
        np.testing.assert_allclose(column(table, "Pearson"), 1.0, atol=1e-9)
        np.testing.assert_allclose(column(table, "B - A, mean"), 0.0, atol=1e-9)
        table = self.logic.compare(self.map, otherMap, "LGE", "after")
        np.testing.assert_allclose(column(table, "Pearson"), -1.0, atol=1e-9)
        self.assertEqual(len(resultsOf(self.map, "comparison")), 1)

    def test_differenceIsWhereItIs(self):
        other = addAtrium("Other")
        values = np.asarray(array(other, "LGE")).copy()
        patch = points(other)[:, 0] > np.percentile(points(other)[:, 0], 80)
        values[patch] += 50.0
        addArray(other, "LGE", values)
        otherMap = self.logic.flatten(other, self.seeds)
        self.logic.compare(self.map, otherMap, "LGE", "LGE")
        name = self.surface.GetDisplayNode().GetActiveScalarName()
        self.assertTrue(name.startswith("difference to "), name)
        difference = array(self.map, name)
        inside = patch[array(self.map, "surface_point_id")]
        self.assertGreater(np.nanmedian(difference[inside]), 45.0)
        self.assertLess(abs(np.nanmedian(difference[~inside])), 1.0)

    def test_outdatedWhereTheOtherMapOrItsImageChanges(self):
        volume, other = addVolume(), addAtrium("Other")
        for surface in (self.surface, other):
            self.logic.project(surface, volume)
        otherMap = self.logic.flatten(other, self.seeds)
        table = self.logic.compare(self.map, otherMap, "LGE", "LGE")
        self.logic.project(other, volume)
        self.assertFalse(self.logic.hasOutdated(self.map), "the same values again")
        self.logic.project(other, volume, ProjectionChoice(depth=1.0))
        self.assertTrue(self.logic.hasOutdated(self.map))
        table = self.logic.compare(self.map, otherMap, "LGE", "LGE")
        self.assertFalse(self.logic.hasOutdated(self.map))
        self.logic.flatten(other, self.seeds, otherMap, "adapted2")
        self.assertTrue(self.logic.hasOutdated(self.map))
        # What was measured stays true of a map that is gone.
        self.logic.flatten(other, self.seeds, otherMap)
        self.logic.compare(self.map, otherMap, "LGE", "LGE")
        slicer.mrmlScene.RemoveNode(otherMap)
        self.assertFalse(self.logic.hasOutdated(self.map))
        self.assertEqual(self.logic.comparisonTable(self.map), table)

    def test_notWithItself(self):
        with self.assertRaisesRegex(LAFlatteningError, "with itself"):
            self.logic.compare(self.map, self.map, "LGE", "LGE")
        with self.assertRaisesRegex(LAFlatteningError, "other map"):
            self.logic.compare(self.map, None, "LGE", "LGE")


class ResultsTest(AnalysisCase):
    """Results belong to their map."""

    def measure(self):
        volume = addVolume()
        self.logic.project(self.surface, volume)
        self.logic.measureFibrosis(self.map, "LGE", Rule("iir", (1.2,)), volume)
        self.logic.findGaps(self.map, "LGE", [110.0, 120.0])

    def test_clear(self):
        before = slicer.mrmlScene.GetNumberOfNodes()
        self.logic.findGaps(self.map, "LGE", [110.0, 120.0])
        self.logic.measureFibrosis(self.map, "LGE", Rule("value", (120.0,)))
        self.assertTrue(self.logic.hasResults(self.map))
        self.logic.clearAnalysis(self.map)
        self.assertFalse(self.logic.hasResults(self.map))
        self.assertEqual(slicer.mrmlScene.GetNumberOfNodes(), before)
        self.assertFalse(self.surface.GetPolyData().GetCellData().HasArray(classArrayOf("LGE")))
        self.assertTrue(self.surface.GetPolyData().GetPointData().HasArray("LGE"))

    def test_outdatedWhereTheMapHasChanged(self):
        self.logic.findGaps(self.map, "LGE", [120.0])
        # On map and atrium.
        drawn = [*resultsOf(self.map, "gap curve"), *resultsOf(self.map, "ablation path")]
        self.assertEqual({bool(node.GetAttribute(ON_MAP)) for node in drawn}, {True, False})
        self.assertFalse(self.logic.hasOutdated(self.map))
        before = seedPosition(self.seeds, "RSPV")
        moveSeed(self.seeds, "RSPV", before + np.array([0.0, 1.0, 1.0]))
        self.logic.preview(self.surface, self.seeds, self.map)
        self.assertTrue(self.logic.hasOutdated(self.map))
        self.assertEqual([node.GetName() for node in drawn if node.GetDisplayVisibility()], [])
        self.logic.flatten(self.surface, self.seeds, self.map)
        self.assertTrue(self.logic.hasOutdated(self.map))
        self.assertFalse(any(node.GetDisplayVisibility() for node in drawn))
        moveSeed(self.seeds, "RSPV", before)
        self.logic.flatten(self.surface, self.seeds, self.map)
        self.assertFalse(self.logic.hasOutdated(self.map))
        self.assertTrue(all(node.GetDisplayVisibility() for node in drawn))

    def test_outdatedWhereTheImageIsProjectedAnew(self):
        volume = addVolume()
        self.logic.project(self.surface, volume)
        self.logic.measureFibrosis(self.map, "LGE", Rule("value", (120.0,)))
        self.logic.findGaps(self.map, "LGE", [120.0])
        drawn = resultsOf(self.map, "gap curve")
        # The same once more is no change, and another array is another matter.
        self.logic.project(self.surface, volume)
        self.logic.project(self.surface, volume, ProjectionChoice(1.0), "thin")
        self.assertFalse(self.logic.hasOutdated(self.map))
        self.logic.project(self.surface, volume, ProjectionChoice(1.0))
        self.assertTrue(self.logic.hasOutdated(self.map))
        self.assertFalse(any(node.GetDisplayVisibility() for node in drawn))
        with self.assertRaisesRegex(InputFileError, "intensities have changed"):
            self.logic.exportMap(self.map, tempfile.gettempdir())
        self.logic.measureFibrosis(self.map, "LGE", Rule("value", (120.0,)))
        self.assertTrue(self.logic.hasOutdated(self.map))
        self.logic.findGaps(self.map, "LGE", [120.0])
        self.assertFalse(self.logic.hasOutdated(self.map))

    def test_theyAreExported(self):
        self.measure()
        with tempfile.TemporaryDirectory() as folder:
            files = self.logic.exportMap(self.map, folder, ("csv",))
            names = [file.name for file in files]
            self.assertEqual(names[2:], [f"Atrium map {what}.csv" for what in ("fibrosis", "gaps", "gap list")])
            with files[2].open(encoding="utf-8", newline="") as file:
                rows = list(csv.reader(file))
            self.assertEqual(rows[0][:3], ["Group", "Part", "Area (cm2)"])
            areas = column(self.logic.fibrosisTable(self.map), "Area (cm2)")
            np.testing.assert_allclose([float(row[2]) for row in rows[1:]], areas, rtol=1e-4)

    def test_theyGoWithTheMap(self):
        p = self.parameters(self.surface, self.seeds)
        p.map = self.map
        self.logic.linkViews(p)
        self.measure()
        results = [node.GetID() for node in resultsOf(self.map)]
        slicer.mrmlScene.RemoveNode(self.map)
        self.assertEqual([key for key in results if slicer.mrmlScene.GetNodeByID(key)], [])

    def test_theyAreSavedWithTheScene(self):
        self.measure()
        kinds = sorted(node.GetAttribute(KIND) for node in resultsOf(self.map))
        lengths, words = column(self.logic.gapTable(self.map), "Gap length"), self.logic.bloodPoolWords(self.map)
        with tempfile.TemporaryDirectory() as folder:
            file = str(Path(folder) / "scene.mrb")
            self.assertTrue(slicer.util.saveScene(file))
            slicer.mrmlScene.Clear(0)
            slicer.util.loadScene(file)
        mapNode = slicer.util.getNode("Atrium map")
        surface = slicer.util.getNode("Atrium")
        self.assertEqual(sorted(node.GetAttribute(KIND) for node in resultsOf(mapNode)), kinds)
        np.testing.assert_allclose(column(self.logic.gapTable(mapNode), "Gap length"), lengths, rtol=1e-4)
        self.assertEqual(self.logic.bloodPoolWords(mapNode), words)
        names = [classColours(surface, classArrayOf("LGE")).GetColorName(k) for k in range(2)]
        self.assertEqual(names[0].split()[0], "normal")
        self.assertEqual(surface.GetDisplayNode().GetActiveScalarName(), classArrayOf("LGE"))
        # And it can be measured further.
        self.logic.findGaps(mapNode, "LGE", [120.0])


if __name__ == "__main__":
    unittest.main()
