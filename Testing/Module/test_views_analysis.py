"""Classes and gaps as they are drawn: in which view, where, and in which colours."""

import unittest

import numpy as np
import slicer
from LAFlatteningScene.colouring import colourBarOf
from LAFlatteningScene.gap_nodes import GAP_COLOUR
from LAFlatteningScene.result_nodes import ON_MAP, resultsOf
from logic_case import array
from view_case import ViewCase, like, onScreen, picture

from LAFlatteningLib import Rule

BLUE = tuple(round(255 * share) for share in GAP_COLOUR)


class GapViewTest(ViewCase):
    def setUp(self):
        super().setUp()
        self.logic.findGaps(self.p.map, "LGE", [120.0])
        slicer.app.processEvents()

    def test_eachLineInItsViewOnly(self):
        mapView = self.logic.mapViewNode().GetID()
        drawn = [node for kind in ("gap curve", "ablation path") for node in resultsOf(self.p.map, kind)]
        self.assertGreater(len(drawn), 10)
        for node in drawn:
            display = node.GetDisplayNode()
            shown = {display.GetNthViewNodeID(k) for k in range(display.GetNumberOfViewNodeIDs())}
            if node.GetAttribute(ON_MAP):
                self.assertEqual(shown, {mapView}, node.GetName())
            else:
                self.assertNotIn(mapView, shown, node.GetName())
                self.assertIn(self.logic.atriumViewNode().GetID(), shown)

    def test_gapsAreDrawnWhereTheyAre(self):
        pixels = picture(self.right)
        blue = like(pixels, BLUE)
        self.assertGreater(blue.sum(), 30)
        for curve in resultsOf(self.p.map, "gap curve"):
            # The longer ones: at their middle there is their colour.
            if curve.GetAttribute(ON_MAP) and curve.GetCurveLengthWorld() > 4.0:
                at = np.zeros(3)
                curve.GetPositionAlongCurveWorld(at, 0, 0.5 * curve.GetCurveLengthWorld())
                column, row = onScreen(self.right, at).astype(int)
                self.assertTrue(blue[row - 3 : row + 4, column - 3 : column + 4].any(), curve.GetName())

    def test_hiddenWithTheMap(self):
        mapNode = self.p.map
        self.p.map = None
        shown = [node for node in resultsOf(mapNode, "gap curve") if node.GetAttribute(ON_MAP)]
        self.assertEqual([node.GetName() for node in shown if node.GetDisplayVisibility()], [])
        self.p.map = mapNode
        self.assertTrue(all(node.GetDisplayVisibility() for node in shown))


class ClassViewTest(ViewCase):
    def test_classesHaveTheirColoursAndALegend(self):
        self.logic.measureFibrosis(self.p.map, "LGE", Rule("value", (110.0, 130.0)))
        slicer.app.processEvents()
        bar = colourBarOf(self.p.map)
        self.assertTrue(bar.GetUseColorNamesForLabels())
        self.assertEqual(bar.GetNumberOfLabels(), 4)
        self.assertEqual(bar.GetTitleText(), "LGE classes")
        colours = self.surface.GetDisplayNode().GetColorNode()
        classes = array(self.p.map, "LGE classes", onCells=True)
        pixels = picture(self.right)
        self.assertEqual(set(np.unique(classes)), {0, 1, 2})
        for number in (0, 2):
            rgba = [0.0] * 4
            colours.GetColor(number, rgba)
            self.assertGreater(like(pixels, np.round(255 * np.array(rgba[:3])), 12).sum(), 200, number)

    def test_numbersComeBackAfterClasses(self):
        self.logic.colourBy(self.surface, "LGE")
        former = self.surface.GetDisplayNode().GetColorNodeID()
        self.logic.measureFibrosis(self.p.map, "LGE", Rule("value", (110.0,)))
        self.assertNotEqual(self.surface.GetDisplayNode().GetColorNodeID(), former)
        self.logic.colourBy(self.surface, "LGE")
        self.assertEqual(self.surface.GetDisplayNode().GetColorNodeID(), former)
        bar = colourBarOf(self.p.map)
        self.assertFalse(bar.GetUseColorNamesForLabels())
        self.assertEqual(bar.GetTitleText(), "LGE (a.u.)")


if __name__ == "__main__":
    unittest.main()
