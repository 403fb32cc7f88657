"""What atrium and map are coloured by, and the colour bar beside the map."""

import numpy as np
import slicer
import vtk
from LAFlatteningScene.colouring import CELL_DATA, POINT_DATA, colourBarOf, updateColourBar
from logic_case import addArray, points
from view_case import ViewCase, picture

from LAFlatteningLib.errors import InputFileError


class ColourByTest(ViewCase):
    def test_choicesAreTheScalarArraysAndTheRegions(self):
        addArray(self.surface, "direction", np.zeros((len(points(self.surface)), 3)))
        choices = self.logic.colourChoices(self.surface)
        self.assertEqual(choices["LGE", POINT_DATA], "LGE (a.u.)")
        self.assertEqual(choices["region", CELL_DATA], "regions")
        self.assertNotIn(("direction", POINT_DATA), choices)
        self.assertEqual(self.logic.colourChoices(None), {})

    def test_theMapFollows(self):
        self.assertIsNone(self.logic.colouredBy(self.surface))
        for name in ("number", "LGE", "region", "LGE"):
            self.logic.colourBy(self.surface, name)
            for node in (self.surface, self.p.map):
                self.assertEqual(self.logic.colouredBy(node)[0], name)
            displays = self.surface.GetDisplayNode(), self.p.map.GetDisplayNode()
            self.assertEqual(displays[0].GetColorNodeID(), displays[1].GetColorNodeID())
            self.assertEqual(displays[0].GetScalarRange(), displays[1].GetScalarRange())
        self.logic.colourBy(self.surface, None)
        self.assertFalse(self.p.map.GetDisplayNode().GetScalarVisibility())

    def test_coloursOfNumbersComeBackAfterTheRegions(self):
        self.logic.colourBy(self.surface, "LGE")
        display = self.surface.GetDisplayNode()
        display.SetAndObserveColorNodeID("vtkMRMLColorTableNodeGrey")
        self.logic.colourBy(self.surface, "region")
        self.assertNotEqual(display.GetColorNodeID(), "vtkMRMLColorTableNodeGrey")
        self.logic.colourBy(self.surface, "LGE")
        self.assertEqual(display.GetColorNodeID(), "vtkMRMLColorTableNodeGrey")

    def test_rangeWithoutTheMissingValues(self):
        values = np.linspace(1.0, 9.0, len(points(self.surface)))
        values[::7] = np.nan
        values[0] = 1.0
        addArray(self.surface, "voltage", values)
        self.logic.colourBy(self.surface, "voltage")
        wanted = (np.nanmin(values), np.nanmax(values))
        for node in (self.surface, self.p.map):
            np.testing.assert_allclose(node.GetDisplayNode().GetScalarRange(), wanted)

    def test_anArrayThatIsNotThere(self):
        with self.assertRaisesRegex(InputFileError, "Expected one of LGE"):
            self.logic.colourBy(self.surface, "voltage")


class ColourBarTest(ViewCase):
    def bar(self):
        return colourBarOf(self.p.map)

    def test_drawnInTheViewOfTheMapOnly(self):
        self.logic.colourBy(self.surface, "LGE")
        slicer.app.processEvents()
        pictures = []
        for visible in (True, False):
            self.p.showColourBar = visible
            slicer.app.processEvents()
            pictures.append((picture(self.left), picture(self.right)))
        (leftWith, rightWith), (leftWithout, rightWithout) = pictures
        np.testing.assert_array_equal(leftWith, leftWithout)
        rows, columns = np.nonzero((rightWith != rightWithout).any(axis=-1))
        height, width = rightWith.shape[:2]
        self.assertGreater(len(rows), 100)
        # In the lower right corner; rows are counted from below.
        self.assertGreater(columns.min(), 0.6 * width)
        self.assertLess(rows.max(), 0.4 * height)

    def test_namesTheArrayThatIsShown(self):
        self.logic.colourBy(self.surface, "LGE")
        self.assertEqual(self.bar().GetTitleText(), "LGE (a.u.)")
        self.assertIs(self.bar().GetPrimaryDisplayNode(), self.p.map.GetDisplayNode())
        addArray(self.surface, "Bipolar", np.linspace(0.0, 3.0, len(points(self.surface))))
        self.p.map.GetDisplayNode().SetActiveScalar("LGE", vtk.vtkAssignAttribute.POINT_DATA)
        self.logic.colourBy(self.surface, "Bipolar")
        self.assertEqual(self.bar().GetTitleText(), "Bipolar (mV)")

    def test_noneForRegionsAndPlainColour(self):
        for name in ("region", None):
            self.logic.colourBy(self.surface, "LGE")
            self.assertTrue(self.bar().GetVisibility())
            self.logic.colourBy(self.surface, name)
            self.assertFalse(self.bar().GetVisibility())

    def test_oneForAMapAndGoneWithIt(self):
        self.logic.colourBy(self.surface, "LGE")
        updateColourBar(self.p.map, True)
        bar = self.bar()
        kind = "vtkMRMLColorLegendDisplayNode"
        self.assertEqual(slicer.mrmlScene.GetNumberOfNodesByClass(kind), 1)
        slicer.mrmlScene.RemoveNode(self.p.map)
        self.assertIsNone(bar.GetScene())
