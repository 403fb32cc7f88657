"""The section Analyse of the panel: what its buttons do, and what it says."""

import json
import tempfile
import unittest
from pathlib import Path

import numpy as np
import slicer
from analysis_case import addVolume, column
from logic_case import addArray, points
from panel_case import PanelCase

from LAFlatteningLib import Volume


class AnalysePanelTest(PanelCase):
    """From an image to tables, by the buttons."""

    def openImage(self):
        """A map, the section unfolded, and the image that came with the sample."""
        made = self.makeMap()
        self.ui.analyseSection.collapsed = False
        volume = slicer.util.getNodesByClass("vtkMRMLScalarVolumeNode")[0]
        self.ui.volumeSelector.setCurrentNode(volume)
        self.settle()
        return made

    def test_imageOntoTheWall(self):
        surface, _, mapNode = self.openImage()
        self.assertIn("from -3 to 3 mm along the outward normal", self.ui.projectionMessage.text)
        first = slicer.util.arrayFromModelPointData(surface, "LGE").copy()
        self.ui.projectionDepth.value = 1.0
        self.settle()
        self.assertIn("from -1 to 1 mm", self.ui.projectionMessage.text)
        second = slicer.util.arrayFromModelPointData(surface, "LGE")
        self.assertLess(second.sum(), first.sum(), "less deep, lower maximum")
        self.assertEqual(mapNode.GetDisplayNode().GetActiveScalarName(), "LGE")

    def test_notLive(self):
        self.makeMap()
        self.ui.projectLive.checked = False
        self.ui.volumeSelector.setCurrentNode(slicer.util.getNodesByClass("vtkMRMLScalarVolumeNode")[0])
        self.settle()
        self.assertEqual(self.ui.projectionMessage.text, "")
        self.ui.projectButton.click()
        self.assertIn("Maximum from -3", self.ui.projectionMessage.text)

    def test_fibrosis(self):
        self.openImage()
        self.assertEqual(self.ui.arraySelector.currentText, "LGE (a.u.)")
        self.assertEqual(self.ui.ruleThresholds.text, "1.2, 1.32")
        self.ui.measureButton.click()
        table = self.ui.fibrosisTable
        self.assertEqual(table.rowCount, 6)
        self.assertEqual(table.item(0, 1).text(), "whole atrium")
        self.assertEqual(table.horizontalHeaderItem(2).text(), "Area (cm2)")
        self.assertIn("Blood pool: mean 100", self.ui.bloodPoolText.text)
        self.assertFalse(table.isHidden())
        self.ui.clearButton.click()
        self.assertTrue(table.isHidden())
        self.assertFalse(self.ui.clearButton.enabled)

    def test_subRegionsOfOnesOwn(self):
        self.openImage()
        self.parameters.parcellation = "vein_segments"
        content = {
            "schema": "laflattening-parcellation/1",
            "name": "two_walls",
            "anatomy": "left_atrium",
            "parts": [
                {"label": 1, "name": "behind", "title": "Wall behind", "area": {"type": "region", "number": 5}},
                {"label": 2, "name": "front", "title": "Wall in front", "area": {"type": "region", "number": 4}},
            ],
        }
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "own.json"
            path.write_text(json.dumps(content), encoding="utf-8")
            self.ui.parcellationFile.currentPath = str(path)
            self.ui.measureButton.click()
        self.assertNotIn("expected", self.ui.analyseMessage.text)
        names = [self.ui.fibrosisTable.item(row, 1).text() for row in range(self.ui.fibrosisTable.rowCount)]
        self.assertEqual(len(names), 6 + 18 + 2)
        self.assertEqual(names[-2:], ["behind", "front"])
        self.ui.parcellationFile.currentPath = "/nowhere/own.json"
        self.ui.measureButton.click()
        self.assertIn("own.json", self.ui.analyseMessage.text)

    def test_wrongThresholdsAreSaid(self):
        self.openImage()
        self.ui.ruleThresholds.text = "1.32, 1.2"
        self.ui.measureButton.click()
        self.assertIn("out of order", self.ui.analyseMessage.text)
        self.ui.ruleThresholds.text = "much"
        self.ui.measureButton.click()
        self.assertIn("as numbers", self.ui.analyseMessage.text)
        self.assertTrue(self.ui.fibrosisTable.isHidden())

    def test_buttonsSayWhatIsMissing(self):
        self.loadSample()
        self.assertFalse(self.ui.measureButton.enabled)
        self.assertIn("map first", self.ui.measureButton.toolTip)
        self.assertIn("image first", self.ui.projectButton.toolTip)
        self.ui.flattenButton.click()
        self.assertFalse(self.ui.measureButton.enabled)
        self.assertIn("image in which blood", self.ui.measureButton.toolTip)
        self.assertIn("threshold of scar", self.ui.gapsButton.toolTip)
        self.parameters.rule, self.parameters.ruleThresholds = "value", "120"
        self.assertTrue(self.ui.measureButton.enabled, self.ui.measureButton.toolTip)
        self.assertTrue(self.ui.bloodRegionSelector.isHidden())

    def test_voltageSuggestsItsRule(self):
        surface, _, _ = self.makeMap()
        addArray(surface, "Bipolar", np.where(points(surface)[:, 2] > 80, 0.05, 1.5))
        self.settle()
        row = self.panel.analyse.arrays.index("Bipolar")
        self.ui.arraySelector.setCurrentIndex(row)
        self.ui.arraySelector.activated.emit(row)
        self.assertEqual(self.ui.ruleThresholds.text, "0.5, 0.1")
        self.assertEqual(self.ui.ruleDirection.currentText, "below")
        self.assertEqual(self.ui.ruleHint.text, "mV")
        self.ui.measureButton.click()
        self.assertIn("scar (< 0.1 mV)", self.ui.fibrosisTable.horizontalHeaderItem(5).text())

    def test_gaps(self):
        self.openImage()
        self.ui.gapThresholds.text = "110, 120"
        self.ui.gapsButton.click()
        self.assertEqual(self.ui.gapTable.rowCount, 12)
        self.assertFalse(self.ui.gapListTable.isHidden())
        self.assertTrue(self.ui.gapChartButton.enabled)
        self.ui.gapChartButton.click()
        self.assertEqual(self.ui.analyseMessage.text, "")

    def test_comparison(self):
        surface, _, mapNode = self.openImage()
        self.assertIn("other map", self.ui.compareButton.toolTip)
        addArray(surface, "inverse", 200.0 - slicer.util.arrayFromModelPointData(surface, "LGE"))
        self.parameters.otherMap = mapNode
        self.settle()
        row = self.panel.analyse.otherArrays.index("inverse")
        self.ui.otherArraySelector.activated.emit(row)
        self.ui.compareButton.click()
        self.assertIn("ranks, not of their values", self.ui.analyseMessage.text)
        r = column(self.panel.logic.comparisonTable(mapNode), "Pearson")
        np.testing.assert_allclose(r, -1.0, atol=1e-9)
        self.assertFalse(self.ui.comparisonTable.isHidden())

    def test_imageElsewhere(self):
        self.makeMap()
        rng = np.random.default_rng(1)
        far = Volume(rng.uniform(size=(6, 6, 6)), np.ones(3), np.full(3, 900.0), np.eye(3))
        self.ui.volumeSelector.setCurrentNode(addVolume(far))
        self.settle()
        self.assertIn("does not overlap", self.ui.projectionMessage.text)


if __name__ == "__main__":
    unittest.main()
