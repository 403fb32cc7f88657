"""What the Logic does with views and colours: layout, linked views, what atrium and map are coloured by."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import slicer

from . import views
from .colouring import CELL_DATA, POINT_DATA, ArrayChoice, colourBy, colourChoices, colouredBy
from .linked_views import LinkedViews

if TYPE_CHECKING:
    from LAFlattening import LAFlatteningParameterNode

ModelNode = slicer.vtkMRMLModelNode


class ViewLogic:
    """The part of `LAFlatteningLogic` that shows atrium and map."""

    _linked: LinkedViews | None = None

    # ---- views -------------------------------------------------------------------------------------------------------

    def showLayout(self) -> None:
        """Show the atrium left and the map right."""
        views.showLayout()
        self.updateViews()

    def updateViews(self) -> None:
        """Show what belongs into each of the linked views, after nodes were made that belong into one."""
        if self._linked is not None:
            self._linked.update()

    def frameMap(self) -> None:
        """Show the whole disk in the map view."""
        if self._linked is not None:
            self._linked.frame()

    def atriumViewNode(self) -> slicer.vtkMRMLViewNode | None:
        """The 3D view of the atrium; None before `showLayout`."""
        return views.viewNode(views.ATRIUM_VIEW)

    def mapViewNode(self) -> slicer.vtkMRMLViewNode | None:
        """The view of the map; None before `showLayout`."""
        return views.viewNode(views.MAP_VIEW)

    def linkViews(
        self,
        parameterNode: LAFlatteningParameterNode,
        onReadout: Callable[[str], None] | None = None,
        onColours: Callable[[], None] | None = None,
    ) -> None:
        """Keep views and display of atrium and map in step, as the parameter node says.

        Linked cursor both ways, click on the map to turn the atrium, same colours, template lines and labels, covers of
        the openings, each object only in its own view.

        Parameters
        ----------
        onReadout : told what is under the cursor (region, value with the name of its array, place); "" for nothing.
        onColours : called when the atrium is coloured otherwise.
        """
        self.unlinkViews()
        self._linked = LinkedViews(self, parameterNode, onReadout, onColours)

    def unlinkViews(self) -> None:
        """End what `linkViews` began; overlay and colours stay as they are."""
        if self._linked is not None:
            self._linked.stop()
            self._linked = None

    def releaseViews(self) -> None:
        """`unlinkViews` for good: other nodes than the map's are shown in all views again."""
        self.unlinkViews()
        views.showEverywhere()

    # ---- colours -----------------------------------------------------------------------------------------------------

    def colourChoices(self, surfaceNode: ModelNode | None) -> dict[ArrayChoice, str]:
        """What the atrium can be coloured by: (array, point or cell data) -> what it is called, with unit."""
        return colourChoices(surfaceNode)

    def colouredBy(self, surfaceNode: ModelNode | None) -> ArrayChoice | None:
        """What the atrium is coloured by; None: one plain colour."""
        return colouredBy(surfaceNode)

    def colourBy(self, surfaceNode: ModelNode, array: str | ArrayChoice | None) -> None:
        """Colour the atrium by an array over the range of its values; None: one plain colour. A linked map follows.

        Parameters
        ----------
        array : its name (points before triangles), or a key of `colourChoices`.

        Raises
        ------
        InputFileError : the atrium has no such scalar array.
        """
        if isinstance(array, str):
            onPoints = (array, POINT_DATA)
            array = onPoints if onPoints in colourChoices(surfaceNode) else (array, CELL_DATA)
        colourBy(surfaceNode, array)
