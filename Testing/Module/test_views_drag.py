"""Placing and dragging seeds with the mouse, through Slicer's own markups widget, with the map following."""

import numpy as np
import slicer
from LAFlatteningScene.live_update import LiveUpdate
from logic_case import Clock, phantom, points, seedPosition, toRas
from view_case import MARKER, ViewCase, like, middle, onScreen, picture

SEED_GREEN = (26, 191, 89)


class MouseCase(ViewCase):
    """The atrium from behind, where three veins are in sight, followed with a clock that stands still by itself."""

    def setUp(self):
        super().setUp()
        self.clock, self.reports, self.stages = Clock(), [], []
        self.p.map.GetDisplayNode().SetScalarVisibility(False)
        # Out of the way of seeds on the picture.
        self.surface.GetDisplayNode().SetColor(0.2, 0.2, 0.8)
        live = LiveUpdate(self.logic, self.p, self.clock.schedule, self.report, self.clock)
        self.logic._live = live
        self.clock.run()
        self.look(toRas(phantom().seeds["LSPV"]) - points(self.surface).mean(axis=0))

    def report(self, report):
        self.reports.append(report)
        self.stages.append((report.stage, self.p.map.GetAttribute("LAFlattening.stage") if self.p.map else None))

    def look(self, direction):
        camera = self.lookAtTheAtrium(direction)
        camera.ResetClippingRange()
        self.left.forceRender()

    def rimPlace(self, label, turns=0):
        """A place of the mitral rim some points on from a seed."""
        surface = phantom().surface
        loop = toRas(surface.points[max(surface.boundary_loops, key=surface.loop_length)])
        nearest = np.linalg.norm(loop - seedPosition(self.seeds, label), axis=1).argmin()
        return loop[(nearest + turns) % len(loop)]


class DragTest(MouseCase):
    """A seed is dragged."""

    def test_theMapFollows(self):
        start = seedPosition(self.seeds, "LSPV")
        before = points(self.p.map)
        at = onScreen(self.left, start)
        end = at + np.array((14, 6))
        self.stages.clear()
        self.mouse(self.left, "MouseMoveEvent", at)
        self.assertEqual(
            self.seeds.GetDisplayNode().GetActiveComponentType(), self.seeds.GetDisplayNode().ComponentControlPoint
        )
        self.mouse(self.left, "LeftButtonPressEvent", at)
        maps = []
        for share in np.linspace(0.0, 1.0, 8)[1:]:
            self.mouse(self.left, "MouseMoveEvent", at + share * (end - at))
            self.clock.run(0.2)
            maps.append(points(self.p.map))
        self.assertTrue(self.stages)
        self.assertEqual({stage for stage, _ in self.stages}, {"preview"})
        self.assertEqual({made for _, made in self.stages}, {"preview"})
        # Paths run along edges, so that not every small move changes the map of so coarse a mesh.
        self.assertGreater(len({flat.tobytes() for flat in maps}), 2)
        self.assertGreater(np.linalg.norm(maps[-1] - before, axis=1).max(), 0.05)
        self.mouse(self.left, "LeftButtonReleaseEvent", end)
        self.clock.run()
        self.assertEqual(self.stages[-1], ("map", "map"))
        moved = seedPosition(self.seeds, "LSPV")
        self.assertGreater(np.linalg.norm(moved - start), 2.0)
        np.testing.assert_allclose(onScreen(self.left, moved), end, atol=4)
        self.assertGreater(np.linalg.norm(points(self.p.map) - before, axis=1).max(), 0.05)
        self.logic.undo()
        self.clock.run()
        np.testing.assert_allclose(seedPosition(self.seeds, "LSPV"), start, atol=1e-6)
        np.testing.assert_allclose(points(self.p.map), before, atol=1e-6)

    def test_aSeedOnTheMitralRim(self):
        self.look(self.rimPlace("MV3") - points(self.surface).mean(axis=0))
        at, end = onScreen(self.left, seedPosition(self.seeds, "MV3")), onScreen(self.left, self.rimPlace("MV3", 4))
        self.left.forceRender()
        self.drag(self.left, at, end)
        self.clock.run()
        self.assertEqual(self.reports[-1].stage, "map")
        surface = phantom().surface
        rim = toRas(surface.points[max(surface.boundary_loops, key=surface.loop_length)])
        moved = seedPosition(self.seeds, "MV3")
        self.assertLess(np.linalg.norm(rim - moved, axis=1).min(), 1e-9)
        self.assertLess(np.linalg.norm(moved - self.rimPlace("MV3")), 3.0)

    def test_theSeedIsDrawnWhereItIs(self):
        for k in range(self.seeds.GetNumberOfControlPoints()):
            if self.seeds.GetNthControlPointLabel(k) != "LSPV":
                self.seeds.SetNthControlPointVisibility(k, False)
        self.seeds.GetDisplayNode().SetPointLabelsVisibility(False)
        pixels = picture(self.left)
        # Lit, so darker towards its outline: more green than red and blue.
        green = (pixels[..., 1] > pixels[..., 0] + 40) & (pixels[..., 1] > pixels[..., 2] + 20)
        np.testing.assert_allclose(middle(green), onScreen(self.left, seedPosition(self.seeds, "LSPV")), atol=4)

    def test_aWrongSeedIsDrawnInRed(self):
        self.seeds.GetDisplayNode().SetPointLabelsVisibility(False)

        def red():
            pixels = picture(self.left)
            return (pixels[..., 0] > pixels[..., 1] + 60) & (pixels[..., 0] > pixels[..., 2] + 60)

        self.assertFalse(red().any())
        self.logic.placeSeed(self.seeds, "LIPV", seedPosition(self.seeds, "LSPV") + np.array((0.0, 0.0, 3.0)))
        self.clock.run()
        self.assertEqual(self.reports[-1].stage, "error")
        self.assertTrue(red().any())

    def test_removingTheSurfaceDuringTheDrag(self):
        at = onScreen(self.left, seedPosition(self.seeds, "LSPV"))
        self.mouse(self.left, "MouseMoveEvent", at)
        self.mouse(self.left, "LeftButtonPressEvent", at)
        slicer.mrmlScene.RemoveNode(self.surface)
        self.mouse(self.left, "MouseMoveEvent", at + np.array((10, 0)))
        self.clock.run(0.2)
        self.mouse(self.left, "LeftButtonReleaseEvent", at + np.array((10, 0)))
        self.clock.run()
        self.assertIn("surface", self.reports[-1].message)
        self.assertIsNotNone(self.p.map)


class PlaceTest(MouseCase):
    """A seed is placed by a click."""

    def click(self, at):
        for event in ("EnterEvent", "MouseMoveEvent", "LeftButtonPressEvent", "LeftButtonReleaseEvent"):
            self.mouse(self.left, event, at)

    def test_aClickOnTheCoverOfAnOpening(self):
        place = seedPosition(self.seeds, "LSPV")
        at = onScreen(self.left, place)
        self.logic.removeSeed(self.seeds, "LSPV")
        self.clock.run()
        self.assertEqual(self.reports[-1].nextSeed, "LSPV")
        self.logic.placeNext(self.seeds)
        self.addCleanup(self.logic.stopPlacing)
        self.left.forceRender()
        self.click(at)
        self.clock.run()
        self.assertEqual(self.reports[-1].stage, "map")
        self.assertLess(np.linalg.norm(seedPosition(self.seeds, "LSPV") - place), 1.5)
        self.assertEqual(self.seeds.GetNumberOfControlPoints(), 9)

    def test_afterTheLastSeedClicksTurnTheViewAgain(self):
        self.logic.placeNext(self.seeds, "LSPV")
        self.left.forceRender()
        self.click(onScreen(self.left, toRas(phantom().seeds["LSPV"])))
        self.clock.run()
        interaction = slicer.app.applicationLogic().GetInteractionNode()
        self.assertNotEqual(interaction.GetCurrentInteractionMode(), interaction.Place)

    def test_theCursorIsLinkedWhilePlacing(self):
        self.logic.placeNext(self.seeds, "LSPV")
        self.addCleanup(self.logic.stopPlacing)
        self.left.forceRender()
        body = points(self.surface)
        direction = toRas(phantom().seeds["LSPV"]) - body.mean(axis=0)
        place = body[((body - body.mean(axis=0)) @ direction).argmax()]
        self.mouse(self.left, "MouseMoveEvent", onScreen(self.left, place))
        self.assertTrue(like(picture(self.right), MARKER).any())
