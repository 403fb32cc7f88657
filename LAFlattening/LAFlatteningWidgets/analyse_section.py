"""Section Analyse: an image on the wall, fibrosis or low voltage, gaps, comparison."""

import slicer
from LAFlatteningScene.analysis_logic import suggestedRule
from slicer.i18n import tr as _

from .section import Section, Work, errorsShownIn, fillTable, fitHeight, showMessage

ROWS = 12
"""Of a table that are shown without scrolling."""


class AnalyseSection(Section):
    """Measures on the map that is chosen, and shows the tables; results are nodes that the map refers to."""

    def __init__(self, panel) -> None:
        super().__init__(panel)
        self.work = Work(panel, self.ui.analyseProgressBar, self.ui.analyseCancelButton)
        self.arrays: tuple[str, ...] = ()
        self.otherArrays: tuple[str, ...] = ()
        for button, act in (
            (self.ui.projectButton, self.project),
            (self.ui.measureButton, self.measure),
            (self.ui.gapsButton, self.findGaps),
            (self.ui.gapChartButton, self.showChart),
            (self.ui.compareButton, self.compare),
            (self.ui.clearButton, self.clear),
        ):
            button.connect("clicked()", act)
        self.ui.arraySelector.connect("activated(int)", self.chooseArray)
        self.ui.otherArraySelector.connect("activated(int)", self.chooseOtherArray)
        self.ui.ruleSelector.connect("activated(int)", self.chooseRule)

    # ---- what the user does ------------------------------------------------------------------------------------------

    def project(self) -> None:
        """Put the image onto the wall."""
        with errorsShownIn(self.ui.projectionMessage, _("The image could not be projected.")):
            found = self.logic.projectParameters(self.parameters)
            self.showProjection(found, "\n".join(found.notes))
        self.panel.update()

    def measure(self) -> None:
        """Areas of the classes."""
        with errorsShownIn(self.ui.analyseMessage, _("The classes could not be measured.")), self.work.running():
            found = self.logic.measureParameters(self.parameters, self.work.progress)
            showMessage(self.ui.analyseMessage, "\n".join(found.notes))

    def findGaps(self) -> None:
        """Gaps in ablation lines."""
        with errorsShownIn(self.ui.analyseMessage, _("The gaps could not be measured.")), self.work.running():
            table = self.logic.gapsParameters(self.parameters, self.work.progress)
            showMessage(self.ui.analyseMessage, table.GetDescription() or "")

    def showChart(self) -> None:
        """RGM over the threshold, in a plot view."""
        with errorsShownIn(self.ui.analyseMessage, _("The chart could not be shown.")):
            slicer.modules.plots.logic().ShowChartInLayout(self.logic.gapChart(self.parameters.map))

    def compare(self) -> None:
        """This map with another one."""
        with errorsShownIn(self.ui.analyseMessage, _("The maps could not be compared.")), self.work.running():
            table = self.logic.compareParameters(self.parameters)
            showMessage(self.ui.analyseMessage, table.GetDescription() or "")

    def clear(self) -> None:
        """Take all results away."""
        with errorsShownIn(self.ui.analyseMessage, _("The results could not be removed.")):
            self.logic.clearAnalysis(self.parameters.map)
        self.panel.update()

    def chooseArray(self, row: int) -> None:
        """Another array is measured: by the rule that is usual for it."""
        self.parameters.analysisArray = self.arrays[row]
        self._suggest(suggestedRule(self.arrays[row]))

    def chooseOtherArray(self, row: int) -> None:
        """Another array of the other map."""
        self.parameters.otherArray = self.otherArrays[row]

    def chooseRule(self, row: int) -> None:
        """Another kind of thresholds: begin with usual ones."""
        self._suggest(suggestedRule(self.parameters.analysisArray, self.parameters.rule))

    def _suggest(self, suggested: tuple[str, str, str]) -> None:
        p = self.parameters
        p.rule, p.ruleThresholds, p.ruleDirection = suggested

    # ---- what is shown -----------------------------------------------------------------------------------------------

    def reset(self) -> None:
        """No message, and what is being computed is no longer wanted."""
        self.work.cancel()
        for message in (self.ui.projectionMessage, self.ui.analyseMessage):
            showMessage(message, "")

    def showProjection(self, projection, text: str) -> None:
        """What has come of a projection, or why there is none."""
        if projection is not None:
            low, high = projection.interval_mm
            done = _("{what} from {low} to {high} mm along the outward normal, in steps of {step} mm.").format(
                what=_("Maximum") if projection.statistic == "max" else _("Mean"),
                low=f"{low:g}",
                high=f"{high:g}",
                step=f"{projection.step_mm:.2g}",
            )
            text = "\n".join(part for part in (done, text) if part)
        showMessage(self.ui.projectionMessage, text)

    def update(self) -> None:
        """Arrays, tables, and what can be pressed now."""
        p = self.parameters
        self.arrays = self._fill(self.ui.arraySelector, p.surface, p.analysisArray)
        if p.analysisArray not in self.arrays and self.arrays:
            # What is looked at is what is measured, if nothing was chosen.
            shown = self.logic.colouredBy(p.surface)
            p.analysisArray = shown[0] if shown is not None and shown[0] in self.arrays else self.arrays[0]
            self._suggest(suggestedRule(p.analysisArray))
            return
        other = self.logic.surfaceOfMap(p.otherMap)
        self.otherArrays = self._fill(self.ui.otherArraySelector, other, p.otherArray or p.analysisArray)
        if other is not None and p.otherArray not in self.otherArrays and self.otherArrays:
            same = p.analysisArray in self.otherArrays
            p.otherArray = p.analysisArray if same else self.otherArrays[0]
            return
        self._updateHint()
        self._updateTables()
        self._updateButtons()

    def _fill(self, selector, surfaceNode, chosen: str) -> tuple[str, ...]:
        """Offer the arrays that can be measured."""
        labels = self.logic.measurableArrays(surfaceNode)
        names = tuple(labels)
        if [selector.itemText(row) for row in range(selector.count)] != list(labels.values()):
            selector.clear()
            selector.addItems(list(labels.values()))
        selector.currentIndex = names.index(chosen) if chosen in names else -1
        selector.enabled = bool(names)
        return names

    def _updateHint(self) -> None:
        p = self.parameters
        unit = self.logic.unitOf(p.analysisArray)
        self.ui.ruleHint.text = {
            "iir": _("times the mean of the blood pool"),
            "sd": _("standard deviations above the mean of the blood pool"),
            "value": unit or _("in the units of the array"),
        }[p.rule]
        for widget in (self.ui.bloodRegionSelector, self.ui.bloodRegionLabel):
            widget.setVisible(p.rule != "value")

    def _updateTables(self) -> None:
        mapNode = self.parameters.map
        for widget, table in (
            (self.ui.fibrosisTable, self.logic.fibrosisTable(mapNode)),
            (self.ui.gapTable, self.logic.gapTable(mapNode)),
            (self.ui.gapListTable, self.logic.gapListTable(mapNode)),
            (self.ui.comparisonTable, self.logic.comparisonTable(mapNode)),
        ):
            fillTable(widget, table)
            fitHeight(widget, ROWS)
            widget.setVisible(table is not None)
        showMessage(self.ui.bloodPoolText, self.logic.bloodPoolWords(mapNode))

    def _updateButtons(self) -> None:
        p, idle = self.parameters, not self.panel.isBusy
        noImage = (
            _("Choose an atrium first.")
            if p.surface is None
            else _("Choose an image first.")
            if p.volume is None
            else ""
        )
        noMap = _("Make a map first.") if p.map is None else "" if self.arrays else _("The atrium has no array.")
        blood = _("Choose the image in which blood is measured, or the rule value.")
        noRule = noMap or (blood if p.rule != "value" and p.volume is None else "")
        noLevels = noMap or ("" if p.gapThresholds.strip() else _("Give a threshold of scar first."))
        noOther = noMap or ("" if p.otherMap is not None else _("Choose the other map first."))
        for button, missing, what in (
            (self.ui.projectButton, noImage, _("Put the intensities of the image onto atrium and map.")),
            (self.ui.measureButton, noRule, _("Measure the areas beyond the thresholds on the atrium.")),
            (self.ui.gapsButton, noLevels, _("Measure gaps round each vein and each pair of veins.")),
            (self.ui.compareButton, noOther, _("Compare this map with the other one, place by place.")),
        ):
            button.enabled = idle and not missing
            button.toolTip = missing or what
        outdated = _("Map or intensities have changed since: what was measured before is outdated. Measure again.")
        if self.logic.hasOutdated(p.map):
            showMessage(self.ui.analyseMessage, outdated)
        elif self.ui.analyseMessage.text == outdated:
            showMessage(self.ui.analyseMessage, "")
        self.ui.clearButton.enabled = idle and self.logic.hasResults(p.map)
        chart = self.logic.gapChart(p.map)
        self.ui.gapChartButton.enabled = chart is not None
        self.ui.gapChartButton.toolTip = (
            _("Show RGM over the threshold.") if chart is not None else _("Find gaps at several thresholds first.")
        )
