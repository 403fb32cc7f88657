"""Handles of a template dragged by mouse in the view of the map."""

import numpy as np
import slicer
from LAFlatteningScene import views
from LAFlatteningScene.template_editor import TemplateEditor
from LAFlatteningScene.template_handles import CENTRE, FOOT, Handle, handlesOf
from LAFlatteningScene.template_text import templateOf
from logic_case import Clock, points
from view_case import ViewCase, like, middle, onScreen, picture

from LAFlatteningLib import Template

ORANGE = (242, 115, 13)
ADAPTED = Template.load("adapted1")


class HandleMouseTest(ViewCase):
    """The map with its handles, followed with a clock that stands still by itself."""

    def setUp(self):
        super().setUp()
        self.clock, self.reports = Clock(), []
        self.logic.startLiveUpdate(self.p, self.clock.schedule)
        self.logic._editor = TemplateEditor(self.logic, self.p, self.clock.schedule, self.reports.append, self.clock)
        self.addCleanup(self.logic.stopTemplateEditing)
        self.p.map.GetDisplayNode().SetColor(0.2, 0.2, 0.8)
        self.p.editTemplate = True
        self.clock.run(1.0)
        self.right.forceRender()

    def screen(self, kind, name):
        index = handlesOf(ADAPTED).index(Handle(kind, name))
        return onScreen(self.right, self.logic.templateHandles().GetNthControlPointPosition(index))

    def test_theyAreDrawnOnTheMapOnly(self):
        self.assertTrue(like(picture(self.right), ORANGE).any())
        at = self.screen(CENTRE, "RSPV").astype(int)
        near = like(picture(self.right), ORANGE)[at[1] - 12 : at[1] + 13, at[0] - 12 : at[0] + 13]
        np.testing.assert_allclose(middle(near), (12, 12), atol=2)
        self.lookAtTheAtrium()
        self.assertFalse(like(picture(self.left), ORANGE).any())
        display = self.logic.templateHandles().GetDisplayNode()
        self.assertEqual(display.GetViewNodeIDs(), (views.viewNode(views.MAP_VIEW).GetID(),))
        self.p.editTemplate = False
        self.assertFalse(like(picture(self.right), ORANGE).any())

    def test_aHoleIsDragged(self):
        before, camera = points(self.p.map), self.right.cameraNode().GetFocalPoint()
        start = self.screen(CENTRE, "RSPV")
        end = start + np.array((15, 9))
        self.mouse(self.right, "EnterEvent", start)
        self.mouse(self.right, "MouseMoveEvent", start)
        self.mouse(self.right, "LeftButtonPressEvent", start)
        maps = []
        for share in np.linspace(0.0, 1.0, 6)[1:]:
            self.mouse(self.right, "MouseMoveEvent", start + share * (end - start))
            self.clock.run(0.2)
            maps.append(points(self.p.map))
        self.assertEqual(self.p.map.GetAttribute("LAFlattening.stage"), "preview")
        self.assertGreater(len({flat.tobytes() for flat in maps}), 3)
        self.mouse(self.right, "LeftButtonReleaseEvent", end)
        self.clock.run(1.0)
        moved = templateOf(self.p.template).holes["RSPV"].shape.centre
        np.testing.assert_allclose(onScreen(self.right, (100.0 * moved[0], 100.0 * moved[1], 0.0)), end, atol=4)
        self.assertEqual(self.p.map.GetAttribute("LAFlattening.stage"), "map")
        self.assertGreater(np.abs(points(self.p.map) - before).max(), 1.0)
        # The view has not been moved with it, and the handle lies in its plane still.
        self.assertEqual(self.right.cameraNode().GetFocalPoint(), camera)
        node = self.logic.templateHandles()
        heights = {round(node.GetNthControlPointPosition(k)[2], 6) for k in range(node.GetNumberOfControlPoints())}
        self.assertEqual(heights, {1.2})

    def test_aMitralSeedIsDraggedAlongTheRim(self):
        start = self.screen(FOOT, "s5")
        self.mouse(self.right, "EnterEvent", start)
        self.drag(self.right, start, start + np.array((-4, 16)))
        self.clock.run(1.0)
        self.assertGreater(templateOf(self.p.template).outer.feet["s5"], 23.5)
        place = np.array(slicer.util.arrayFromMarkupsControlPoints(self.logic.templateHandles()))
        feet = [k for k, handle in enumerate(handlesOf(ADAPTED)) if handle.kind == FOOT]
        np.testing.assert_allclose(np.linalg.norm(place[feet, :2], axis=1), 50.0, atol=1e-6)

    def test_linesFollow(self):
        self.p.showTemplate = True
        self.logic.editTemplate(Handle(CENTRE, "RSPV").dragged(ADAPTED, np.array((0.23, 0.1))))
        lines = self.p.map.GetNodeReference("LAFlattening.lines")
        flat = points(lines)[:, :2]
        ring = 100.0 * Handle(CENTRE, "RSPV").dragged(ADAPTED, np.array((0.23, 0.1))).holes["RSPV"].shape.outline(120)
        self.assertLess(np.linalg.norm(flat[:, None] - ring, axis=2).min(axis=0).max(), 1e-3)
