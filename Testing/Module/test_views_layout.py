"""The layout with atrium and map."""

import slicer
from LAFlatteningScene import views
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
