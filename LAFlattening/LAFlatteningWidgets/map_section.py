"""Section Map: how the map is made, making it, and showing it."""

from slicer.i18n import tr as _

from .section import Section, Work, errorsShownIn, showMessage


class MapSection(Section):
    """Makes the map, with progress and cancel, and shows atrium and map side by side."""

    def __init__(self, panel) -> None:
        super().__init__(panel)
        self.work = Work(panel, self.ui.progressBar, self.ui.cancelButton)
        self.choices = ()
        self.templates = ()
        self.ui.templateSelector.connect("currentIndexChanged(int)", self.chooseTemplate)
        self.ui.flattenButton.connect("clicked()", self.flatten)
        self.ui.layoutButton.connect("clicked()", self.panel.showLayout)
        self.ui.frameButton.connect("clicked()", self.logic.frameMap)
        self.ui.colourSelector.connect("activated(int)", self.colour)

    def flatten(self) -> None:
        """Make the map; the panel stays usable enough to cancel."""
        with errorsShownIn(self.ui.mapMessage, _("The map could not be made.")), self.work.running():
            self.logic.flattenParameters(self.parameters, self.work.progress)
            self.panel.showLayout()

    def reset(self) -> None:
        """No message, and what is being computed is no longer wanted."""
        self.work.cancel()
        showMessage(self.ui.mapMessage, "")
        self.ui.readoutText.text = ""

    def showReport(self, report) -> None:
        """What the Logic says after it has followed a change of surface or seeds."""
        if report.seedReasons and report.stage == "error":
            text = _("The map does not show the present seeds: see what is said under Seeds.")
        else:
            # What is missing is said where it is chosen.
            text = "" if report.stage == "seeds" else report.message
        showMessage(self.ui.mapMessage, text)

    def chooseTemplate(self, row: int) -> None:
        """Use another template."""
        if self.parameters is not None and 0 <= row < len(self.templates):
            self.parameters.template = self.templates[row]

    def updateTemplates(self) -> None:
        """Offer the built-in templates and the user's own."""
        choices, selector = self.logic.templateChoices(self.parameters), self.ui.templateSelector
        blocked = selector.blockSignals(True)
        if [selector.itemText(row) for row in range(selector.count)] != list(choices.values()):
            selector.clear()
            selector.addItems(list(choices.values()))
        self.templates = tuple(choices)
        selector.currentIndex = self.templates.index(self.parameters.template)
        selector.blockSignals(blocked)

    def colour(self, row: int) -> None:
        """Colour atrium and map by the array that was chosen."""
        with errorsShownIn(self.ui.mapMessage, _("The colours could not be changed.")):
            self.logic.colourBy(self.parameters.surface, self.choices[row])
        self.updateColours()

    def updateColours(self) -> None:
        """Show what the atrium can be coloured by, and by what it is."""
        surfaceNode, selector = self.parameters.surface, self.ui.colourSelector
        names = {None: _("one colour"), **self.logic.colourChoices(surfaceNode)}
        labels = list(names.values())
        if tuple(names) != self.choices or selector.count != len(labels):
            self.choices = tuple(names)
            selector.clear()
            selector.addItems(labels)
        selector.currentIndex = self.choices.index(self.logic.colouredBy(surfaceNode)) if surfaceNode else 0
        selector.enabled = surfaceNode is not None

    def missing(self) -> str:
        """What is still needed to make a map; empty if nothing."""
        if self.parameters.surface is None:
            return _("Choose an atrium first.")
        if self.parameters.seeds is None or self.logic.nextSeed(self.parameters.seeds) is not None:
            return _("Place all seeds first.")
        return ""

    def update(self) -> None:
        """What can be pressed now."""
        missing = self.missing()
        self.ui.flattenButton.enabled = not missing and not self.panel.isBusy
        self.ui.flattenButton.toolTip = missing or _("Compute the map.")
        self.ui.frameButton.enabled = self.parameters.map is not None
        self.updateTemplates()
        self.updateColours()
