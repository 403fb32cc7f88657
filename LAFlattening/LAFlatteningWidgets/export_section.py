"""Section Export: the map and its figures as files."""

from pathlib import Path

from slicer.i18n import tr as _

from .section import Section, errorsShownIn, showMessage


class ExportSection(Section):
    """Writes the map to a folder."""

    def __init__(self, panel) -> None:
        super().__init__(panel)
        self.ui.exportButton.connect("clicked()", self.export)

    def export(self) -> None:
        """Write all files, and say which."""
        label = self.ui.exportMessage
        with errorsShownIn(label, _("The map could not be exported.")):
            chosen = Path(self.parameters.exportDirectory)
            # Not written into the parameters: a saved scene must not tell whose folder it was.
            folder = Path.home() if str(chosen) == "." else chosen
            files = self.logic.exportMap(self.parameters.map, folder)
            names = ", ".join(file.name for file in files)
            showMessage(label, _("Written to {folder}: {names}").format(folder=files[0].parent, names=names))

    def reset(self) -> None:
        """What was written for another scene is not said any more."""
        showMessage(self.ui.exportMessage, "")

    def update(self) -> None:
        """A map is needed; files go to the user's own folder until another one is chosen."""
        hasMap = self.parameters.map is not None
        self.ui.exportButton.enabled = hasMap and not self.panel.isBusy
        files = _(
            "Write the map as VTP and as PNG with colour bar, its quality and the table of regions as CSV; to your "
            "home folder until another one is chosen."
        )
        self.ui.exportButton.toolTip = files if hasMap else _("Make a map first.")
