"""What the tests of the panel share: an open panel in an empty scene, and nothing may go wrong behind its back."""

import sys
import time
import traceback
import unittest

import numpy as np
import slicer


class PanelCase(unittest.TestCase):
    """Opens the panel in an empty scene; fails if anything raises where nobody would notice.

    Errors in slots of widgets and in observers of nodes do not reach the test that caused them: Qt and VTK hand them to
    ``sys.excepthook``.
    """

    POINTS = 1000
    """Of the synthetic atrium."""

    def setUp(self) -> None:
        self.escaped: list[str] = []
        hook = sys.excepthook
        sys.excepthook = lambda *error: self.escaped.append("".join(traceback.format_exception(*error)))
        self.addCleanup(setattr, sys, "excepthook", hook)
        slicer.mrmlScene.Clear()
        self.panel = slicer.util.getModuleWidget("LAFlattening")
        self.panel.enter()
        self.ui = self.panel.ui

    def tearDown(self) -> None:
        self.panel.setParameterNode(None)
        slicer.mrmlScene.Clear()
        slicer.app.processEvents()
        self.assertEqual(self.escaped, [], "\n".join(self.escaped))

    @property
    def parameters(self):
        """The parameter node of the panel."""
        return self.panel.parameterNode

    def loadSample(self, follow: bool = False):
        """The synthetic atrium and its seeds, chosen in the panel; `follow` makes the map at once and keeps it."""
        self.parameters.liveUpdate = follow
        surfaceNode, seedsNode = self.panel.logic.loadSample(points=self.POINTS)
        self.parameters.surface, self.parameters.seeds = surfaceNode, seedsNode
        self.settle()
        return surfaceNode, seedsNode

    def makeMap(self, follow: bool = False):
        """A map of the sample by the button; returns surface, seeds and map. `follow`: it follows the seeds."""
        surfaceNode, seedsNode = self.loadSample()
        self.ui.flattenButton.click()
        self.assertIsNotNone(self.parameters.map, self.ui.mapMessage.text)
        self.parameters.liveUpdate = follow
        self.settle()
        return surfaceNode, seedsNode, self.parameters.map

    def waitFor(self, condition, seconds: float = 20.0) -> None:
        """Let Slicer work until something is true."""
        end = time.monotonic() + seconds
        while not condition():
            self.assertLess(time.monotonic(), end, f"waited {seconds} s in vain; escaped errors: {self.escaped}")
            slicer.app.processEvents()
            time.sleep(0.005)

    def settle(self, seconds: float = 0.2) -> None:
        """Let Slicer work for a while, so that what was scheduled happens."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            slicer.app.processEvents()
            time.sleep(0.005)

    def moveSeed(self, seedsNode, label: str, offset) -> None:
        """Move a seed by (x, y, z) mm, as one change."""
        index = seedsNode.GetControlPointIndexByLabel(label)
        position = np.array(seedsNode.GetNthControlPointPositionWorld(index)) + offset
        seedsNode.SetNthControlPointPositionWorld(index, *(float(x) for x in position))

    def rowOf(self, label: str) -> int:
        """The row of a seed in the table."""
        table = self.ui.seedsTable
        return next(row for row in range(table.rowCount) if table.item(row, 0).text() == label)

    def stateOf(self, label: str) -> str:
        """What the table says about a seed."""
        return self.ui.seedsTable.item(self.rowOf(label), 1).text()
