"""The panel while something long is computed: what can be pressed, and what is said."""

import unittest
import unittest.mock

import numpy as np
import slicer
from panel_case import PanelCase

BUTTONS = (
    "sampleButton",
    "suggestButton",
    "byHandButton",
    "applyButton",
    "prepareUndoButton",
    "flattenButton",
    "projectButton",
    "measureButton",
    "gapsButton",
    "compareButton",
    "clearButton",
    "exportButton",
)
"""That begin something with maps or atria."""


class MeanwhileCase(PanelCase):
    """A map that follows its seeds, ready to be measured."""

    POINTS = 1500

    def setUp(self):
        super().setUp()
        self.surface, self.seeds, self.map = self.makeMap(follow=True)
        p = self.parameters
        p.volume = slicer.util.getNodesByClass("vtkMRMLScalarVolumeNode")[0]
        p.projectLive = False
        p.analysisArray, p.rule, p.ruleThresholds, p.gapThresholds = "LGE", "value", "120", "120"
        self.settle()

    def during(self, work, act, at=0.4):
        """Let something happen in the midst of a computation of the panel, when so much is done."""
        done, original = [], work.progress

        def progress(share, text):
            answer = original(share, text)
            if share >= at and not done:
                done.append(share)
                act()
            return answer

        self.addCleanup(lambda: self.assertTrue(done, "it never came to that"))
        patch = unittest.mock.patch.object(work, "progress", progress)
        patch.start()
        self.addCleanup(patch.stop)

    def regions(self):
        """Areas of the regions as the table of the map says, cm2."""
        table = self.panel.logic.regionTable(self.map)
        return [float(table.GetCellText(row, 2)) / 100.0 for row in range(table.GetNumberOfRows())]

    def measured(self):
        """Areas of the regions as the table of the classes says, cm2."""
        table = self.panel.logic.fibrosisTable(self.map)
        return [float(table.GetCellText(row, 2)) for row in range(1, table.GetNumberOfRows())]

    def moveMitralSeed(self):
        first, second = (
            np.array(self.seeds.GetNthControlPointPositionWorld(self.seeds.GetControlPointIndexByLabel(label)))
            for label in ("MV1", "MV2")
        )
        self.moveSeed(self.seeds, "MV2", 0.5 * (first - second))


class MovedMeanwhileTest(MeanwhileCase):
    """The table is of the map as it was, and said to be outdated as soon as there is another map."""

    def test_measure(self):
        before = self.regions()

        def move():
            self.moveMitralSeed()
            self.settle(0.5)
            np.testing.assert_allclose(self.regions(), before, err_msg="the map waits")

        self.during(self.panel.analyse.work, move)
        self.ui.measureButton.click()
        np.testing.assert_allclose(self.measured(), before, rtol=1e-6)
        self.waitFor(lambda: not np.allclose(self.regions(), before))
        self.settle()
        self.assertTrue(self.panel.logic.hasOutdated(self.map))
        self.assertIn("outdated", self.ui.analyseMessage.text)

    def test_gaps(self):
        before = slicer.util.arrayFromModelPoints(self.map).copy()

        def isAsBefore():
            return np.array_equal(slicer.util.arrayFromModelPoints(self.map), before)

        def edit():
            self.parameters.template = "population"
            self.settle(0.5)
            self.assertTrue(isAsBefore(), "the map waits")

        self.during(self.panel.analyse.work, edit)
        self.ui.gapsButton.click()
        self.assertGreater(self.ui.gapTable.rowCount, 0)
        self.waitFor(lambda: not isAsBefore())
        self.settle()
        self.assertIn("outdated", self.ui.analyseMessage.text)


class DeletedMeanwhileTest(MeanwhileCase):
    """A message, and the panel works on."""

    def delete(self, button, name):
        self.parameters.liveUpdate = False
        node = getattr(self, name)
        self.during(self.panel.analyse.work, lambda: slicer.mrmlScene.RemoveNode(node))
        button.click()
        self.assertIn("deleted while", self.ui.analyseMessage.text)
        self.settle()
        tables = [node.GetName() for node in slicer.util.getNodesByClass("vtkMRMLTableNode")]
        self.assertFalse([name for name in tables if "classes" in name or "gap" in name], tables)
        self.assertEqual(slicer.util.getNodesByClass("vtkMRMLMarkupsCurveNode"), [])
        self.assertFalse(self.panel.isBusy)
        self.assertTrue(self.ui.sampleButton.enabled)

    def test_map_while_measuring(self):
        self.delete(self.ui.measureButton, "map")

    def test_atrium_while_measuring(self):
        self.delete(self.ui.measureButton, "surface")

    def test_map_while_finding_gaps(self):
        self.delete(self.ui.gapsButton, "map")

    def test_atrium_while_finding_gaps(self):
        self.delete(self.ui.gapsButton, "surface")


class OneAtATimeTest(MeanwhileCase):
    """Nothing else can be begun, and a click that comes through all the same is answered."""

    def press(self, button, work, section, begin, message):
        """Press a button and, while its work is going on, another one whose click was on its way already."""
        self.parameters.prepareInput = self.surface
        self.settle()
        seen = []

        def second():
            seen.append([name for name in BUTTONS if getattr(self.ui, name).enabled])
            begin()
            seen.append(message.text)
            seen.append((work.isRunning, section.isVisibleTo(self.panel.parent)))

        self.during(work, second)
        button.click()
        self.assertEqual(seen[0], [], "buttons that can be pressed meanwhile")
        self.assertIn("Something else is being computed", seen[1])
        self.assertEqual(seen[2], (True, True), "the first one goes on and can be cancelled")
        self.assertFalse(self.panel.isBusy)
        self.assertTrue(button.enabled)

    def test_flatten_while_measuring(self):
        analyse, unfolded = self.panel.analyse, self.ui.analyseSection
        unfolded.collapsed = False
        begin = self.panel.map.flatten
        self.press(self.ui.measureButton, analyse.work, self.ui.analyseCancelButton, begin, self.ui.mapMessage)
        self.assertEqual(self.ui.analyseMessage.text, "")
        np.testing.assert_allclose(self.measured(), self.regions(), rtol=1e-6)

    def test_measure_while_flattening(self):
        begin = self.panel.analyse.measure
        self.press(self.ui.flattenButton, self.panel.map.work, self.ui.cancelButton, begin, self.ui.analyseMessage)
        self.assertEqual(self.ui.mapMessage.text, "")
        self.assertIsNone(self.panel.logic.fibrosisTable(self.map))

    def test_suggest_while_finding_gaps(self):
        self.ui.analyseSection.collapsed = False
        begin = self.panel.prepare.suggest
        self.press(
            self.ui.gapsButton,
            self.panel.analyse.work,
            self.ui.analyseCancelButton,
            begin,
            self.ui.prepareMessage,
        )
        self.assertIsNotNone(self.panel.logic.gapTable(self.map))

    def test_cancel_is_not_forgotten(self):
        """Cancel, then a click on its way: the first is still cancelled."""
        work = self.panel.analyse.work

        def cancel():
            work.cancel()
            self.panel.analyse.findGaps()

        self.during(work, cancel)
        self.ui.measureButton.click()
        self.assertIn("Cancelled", self.ui.analyseMessage.text)
        self.assertIsNone(self.panel.logic.fibrosisTable(self.map))
        self.assertIsNone(self.panel.logic.gapTable(self.map))


if __name__ == "__main__":
    unittest.main()
