"""The layout with atrium and map."""

import slicer
from LAFlatteningScene import views
from logic_case import addAtrium
from view_case import ViewCase


class LayoutTest(ViewCase):
    def viewTags(self):
        nodes = slicer.app.layoutManager().layoutLogic().GetViewNodes()
        return {nodes.GetItemAsObject(k).GetSingletonTag() for k in range(nodes.GetNumberOfItems())}

    def test_bothViewsAreShown(self):
        self.assertEqual(self.viewTags(), {views.ATRIUM_VIEW, views.MAP_VIEW})

    def test_aSceneThatAskedForItBeforeItWasKnownIsShownIt(self):
        node = slicer.app.layoutManager().layoutLogic().GetLayoutNode()
        node.SetViewArrangement(node.SlicerLayoutOneUp3DView)
        # As where the module was not there when Slicer started.
        node.SetLayoutDescription(views.LAYOUT_ID, "")
        node.SetViewArrangement(views.LAYOUT_ID)
        self.assertEqual(node.GetCurrentLayoutDescription(), "")
        views.addLayout()
        self.assertEqual(self.viewTags(), {views.ATRIUM_VIEW, views.MAP_VIEW})

    def test_anotherLayoutStays(self):
        node = slicer.app.layoutManager().layoutLogic().GetLayoutNode()
        slicer.app.layoutManager().setLayout(node.SlicerLayoutOneUp3DView)
        views.addLayout()
        self.assertEqual(node.GetViewArrangement(), node.SlicerLayoutOneUp3DView)


class OthersTest(ViewCase):
    """Nodes of the user's that have nothing to do with atrium and map."""

    def setUp(self):
        super().setUp()
        self.display = addAtrium("Other").GetDisplayNode()
        self.chosen = addAtrium("In one view").GetDisplayNode()
        self.chosen.SetViewNodeIDs([self.logic.atriumViewNode().GetID()])

    def later(self):
        """A 3D view that is made now."""
        node = slicer.mrmlScene.CreateNodeByClass("vtkMRMLViewNode")
        node.UnRegister(None)
        node.SetSingletonTag("Later")
        node.SetLayoutName("Later")
        return slicer.mrmlScene.AddNode(node).GetID()

    def test_theyAreShownInViewsThatAreMadeLater(self):
        self.assertTrue(self.display.IsDisplayableInView(self.later()))
        self.assertFalse(self.display.IsDisplayableInView(self.logic.mapViewNode().GetID()))

    def test_afterTheModuleIsGoneTheyAreShownInAllViews(self):
        self.logic.releaseViews()
        later = self.later()
        self.assertTrue(self.display.IsDisplayableInView(later))
        self.assertEqual(self.display.GetNumberOfViewNodeIDs(), 0)
        # The map stays in its view, and what the user has chosen stays chosen.
        self.assertFalse(self.p.map.GetDisplayNode().IsDisplayableInView(later))
        self.assertFalse(self.chosen.IsDisplayableInView(later))
        # And all can begin again.
        self.logic.linkViews(self.p)
        self.assertFalse(self.display.IsDisplayableInView(self.logic.mapViewNode().GetID()))
