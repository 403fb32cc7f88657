"""Logic: files of a map, and the sample data."""

import csv
import tempfile
import unittest.mock
from pathlib import Path

import numpy as np
import slicer
import vtk
from LAFlatteningScene import export
from logic_case import LogicCase, addAtrium, addSeeds, array, phantom, points, triangles
from vtk.util.numpy_support import vtk_to_numpy

from LAFlatteningLib import InputFileError, MapData, find_gaps, flatten, read_surface
from LAFlatteningLib.cavity.covers import HOLE_ARRAY


class ExportTest(LogicCase):
    """All files or none."""

    def setUp(self):
        super().setUp()
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.surface = addAtrium("Patient 7")
        self.flat = self.logic.flatten(self.surface, addSeeds(self.logic))

    def test_whatIsWritten(self):
        written = self.logic.exportMap(self.flat, self.folder, ("vtp", "csv"))
        names = ["Patient 7 map.vtp", "Patient 7 map metrics.csv", "Patient 7 map regions.csv"]
        self.assertEqual([path.name for path in written], names)
        self.assertEqual(sorted(path.name for path in self.folder.iterdir()), sorted(names))

    def test_theModelReadsBack(self):
        (path,) = self.logic.exportMap(self.flat, str(self.folder), ("vtp",))
        surface = read_surface(path)
        self.assertEqual(surface.space, "RAS")
        np.testing.assert_array_equal(surface.points, points(self.flat))
        np.testing.assert_array_equal(surface.triangles, triangles(self.flat))
        np.testing.assert_array_equal(surface.point_data["LGE"], array(self.surface, "LGE"))
        np.testing.assert_array_equal(surface.cell_data["region"], array(self.flat, "region", True))
        self.assertNotIn(HOLE_ARRAY, surface.point_data)

    def test_theModelIsAMapForTheCommands(self):
        (path,) = self.logic.exportMap(self.flat, self.folder, ("vtp",))
        data = MapData.of(read_surface(path))
        made = flatten(phantom().surface, phantom().seeds)
        np.testing.assert_allclose(data.flat, made.points, atol=1e-4)
        np.testing.assert_allclose(data.surface.triangle_areas, made.surface.triangle_areas, atol=1e-3)
        # A gap has its length again.
        expected = find_gaps(made, "LGE", [120.0]).at(120.0)
        for area, ring in find_gaps(data, "LGE", [120.0]).at(120.0).items():
            self.assertAlmostEqual(ring.gap_length_mm, expected[area].gap_length_mm, delta=0.1)

    def test_slicerShowsTheModelWhereItWas(self):
        (path,) = self.logic.exportMap(self.flat, self.folder, ("vtp",))
        again = slicer.util.loadModel(str(path))
        np.testing.assert_allclose(points(again), points(self.flat), atol=1e-9)

    def test_tables(self):
        self.logic.exportMap(self.flat, self.folder, ("csv",))
        with (self.folder / "Patient 7 map regions.csv").open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        self.assertEqual([row["Region"] for row in rows], ["1", "2", "3", "4", "5"])
        self.assertAlmostEqual(sum(float(row["Share of the map (%)"]) for row in rows), 100.0, places=3)
        with (self.folder / "Patient 7 map metrics.csv").open(encoding="utf-8", newline="") as file:
            metrics = {row["Quantity"]: (row["Value"], row["Unit"]) for row in csv.DictReader(file)}
        self.assertEqual(metrics["map diameter"], ("100", "mm"))

    def test_aNameThatIsNoFileName(self):
        self.flat.SetName('a/b\\c:"d"')
        (path,) = self.logic.exportMap(self.flat, self.folder, ("vtp",))
        self.assertEqual(path.parent, self.folder)
        self.assertTrue(path.is_file())

    def test_badInput(self):
        for pattern, node, folder, formats in (
            ("no map", None, self.folder, ("vtp",)),
            ("does not exist", self.flat, self.folder / "missing", ("vtp",)),
            ("does not exist", self.flat, "", ("vtp",)),
            ("vtp, png, csv", self.flat, self.folder, ("jpg",)),
        ):
            with self.assertRaisesRegex(InputFileError, pattern):
                self.logic.exportMap(node, folder, formats)
        self.assertEqual(list(self.folder.iterdir()), [])

    def test_ifOneCannotBeWrittenNoneIs(self):
        older = self.folder / "Patient 7 map.vtp"
        older.write_text("older")
        with (
            unittest.mock.patch.object(export, "writeTable", side_effect=OSError(28, "No space left on device")),
            self.assertRaisesRegex(InputFileError, "No space left"),
        ):
            self.logic.exportMap(self.flat, self.folder, ("vtp", "csv"))
        self.assertEqual(list(self.folder.iterdir()), [older])
        self.assertEqual(older.read_text(), "older")


class SampleTest(LogicCase):
    """The synthetic atrium."""

    def test_itFlattens(self):
        surface, seeds = self.logic.loadSample(1500)
        self.assertEqual(len(points(surface)), 1500)
        self.assertEqual(surface.GetDisplayNode().GetActiveScalarName(), "LGE")
        self.assertIsNone(self.logic.nextSeed(seeds))
        flat = self.logic.flatten(surface, seeds)
        self.assertEqual(flat.GetDisplayNode().GetActiveScalarName(), "LGE")
        self.assertEqual(self.logic.notes(flat), [])

    def test_imageAndSurfaceAreAtTheSamePlace(self):
        surface, _ = self.logic.loadSample(1500)
        volume = slicer.util.getFirstNodeByClassByName("vtkMRMLScalarVolumeNode", "Left atrium LGE")
        toIjk = vtk.vtkMatrix4x4()
        volume.GetRASToIJKMatrix(toIjk)
        matrix = np.array([[toIjk.GetElement(row, column) for column in range(4)] for row in range(4)])
        ijk = np.round(points(surface) @ matrix[:3, :3].T + matrix[:3, 3]).astype(int)
        size = volume.GetImageData().GetDimensions()
        self.assertTrue(((ijk >= 0) & (ijk < size)).all())
        voxels = vtk_to_numpy(volume.GetImageData().GetPointData().GetScalars()).reshape(size[::-1])
        intensity = voxels[ijk[:, 2], ijk[:, 1], ijk[:, 0]]
        scar = array(surface, "scar") == 1
        # Scar is bright on the image, right at the surface.
        self.assertGreater(intensity[scar].mean(), 1.15 * intensity[~scar].mean())

    def test_twiceGivesTwo(self):
        names = {self.logic.loadSample(1500)[0].GetName() for _ in range(2)}
        self.assertEqual(len(names), 2)
