"""Section Quality: how good the map is."""

import slicer
from LAFlatteningScene.map_nodes import isCopy
from slicer.i18n import tr as _

from .section import Section, errorsShownIn, fillTable, fitHeight

ROWS = 14
"""Of the metrics that are shown without scrolling."""


class QualitySection(Section):
    """Shows what to look at before trusting the map, its metrics and its regions."""

    def __init__(self, panel) -> None:
        super().__init__(panel)
        self.chartsShown = 0
        self.ui.histogramButton.connect("clicked()", self.showHistogram)

    def showHistogram(self) -> None:
        """Show the histograms in a plot view, one after the other."""
        with errorsShownIn(self.ui.mapMessage, _("The histogram could not be shown.")):
            charts = self.logic.histogramCharts(self.parameters.map)
            slicer.modules.plots.logic().ShowChartInLayout(charts[self.chartsShown % len(charts)])
            self.chartsShown += 1

    def update(self) -> None:
        """Notes, metrics and regions of the map."""
        mapNode = self.parameters.map
        notes = self.logic.notes(mapNode) if mapNode else []
        if mapNode is None:
            self.ui.notesText.text = _("There is no map yet.")
        elif isCopy(mapNode):
            self.ui.notesText.text = _("This is a copy of a map; press Flatten to make it a map of its own.")
        else:
            self.ui.notesText.text = "\n".join(notes) or _("Nothing unusual about this map.")
        for widget, table in (
            (self.ui.metricsTable, self.logic.metricsTable(mapNode) if mapNode else None),
            (self.ui.regionTable, self.logic.regionTable(mapNode) if mapNode else None),
        ):
            fillTable(widget, table)
            fitHeight(widget, ROWS)
            widget.setVisible(table is not None)
        self.ui.histogramButton.enabled = mapNode is not None and bool(self.logic.histogramCharts(mapNode))
