"""What the Logic does with templates: choosing, opening, editing and saving them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import slicer

from LAFlatteningLib import InputFileError, Template, builtin_templates
from LAFlatteningLib.template_editing import renamed

from .live_update import Scheduler
from .map_nodes import STAGE, isCopy
from .quality_nodes import METRICS_ROLE
from .template_editor import EditReport, TemplateEditor
from .template_text import isContent, panelTemplate, templateOf, textOf

if TYPE_CHECKING:
    from LAFlattening import LAFlatteningParameterNode


FIGURES = ("isotropy beta, mean", "area ratio alpha, entropy", "dilatation, p99", "folded triangles")
"""Rows of the table of metrics that tell one template from another."""


class TemplateLogic:
    """The part of `LAFlatteningLogic` that is about templates.

    In parameters and settings a template is a text: the name of a built-in one, or the content of a template file, so
    that it is saved with the scene.
    """

    _editor: TemplateEditor | None = None

    def templateOf(self, template: str | Path) -> Template:
        """The template of a text, or of a file; TemplateError, InputFileError if there is none."""
        return templateOf(str(template))

    def templateChoices(self, parameterNode: LAFlatteningParameterNode) -> dict[str, str]:
        """Text of a template -> what it is called: the built-in ones, and the user's, if there is one."""
        choices = {name: name for name in builtin_templates("left_atrium")}
        for text in (parameterNode.ownTemplate, parameterNode.template):
            if isContent(text):
                choices = {name: name for name in builtin_templates("left_atrium")} | {text: templateOf(text).name}
        return choices

    def openTemplate(self, parameterNode: LAFlatteningParameterNode, path: str | Path) -> None:
        """Use the template of a file, a copy of which is kept in the parameter node.

        Raises
        ------
        TemplateError, InputFileError : no template of the left atrium, saying what is wrong with the file.
        """
        # The file may have changed since it was read last.
        text = textOf(Template.load(Path(path)))
        panelTemplate(text)
        parameterNode.template = text

    def saveTemplate(self, parameterNode: LAFlatteningParameterNode, path: str | Path) -> None:
        """Write the template that is used to a template file; ".json" is added to the name if it is missing.

        It is then called as the file is (with "_" for spaces), and the next map is made on it by that name.

        Raises
        ------
        TemplateError : the name of the file is none for a template.
        InputFileError : the file cannot be written, or is there already under the name with ".json" added.
        """
        self.takeTemplateEdit()
        path = Path(path)
        if path.suffix.lower() != ".json":
            # Where files are chosen, only template files are listed.
            path = path.with_name(f"{path.name}.json")
            if path.exists():
                raise InputFileError(f'There is a file "{path.name}" already. Choose it, or write another name.')
        template = renamed(templateOf(parameterNode.template), path.stem.replace(" ", "_"))
        template.save(path)
        if isContent(parameterNode.template):
            parameterNode.template = textOf(template)

    def distortionFigures(self, mapNode: slicer.vtkMRMLModelNode | None) -> tuple[float, float, float, int] | None:
        """Of the last full map, as its table of metrics says: mean isotropy, entropy of the area ratio (nat), 99th
        percentile of the dilatation, number of folded triangles; None without a map or if the table lacks a row."""
        table = mapNode.GetNodeReference(METRICS_ROLE) if mapNode is not None else None
        if table is None:
            return None
        rows = range(table.GetNumberOfRows())
        said = {table.GetCellText(row, 0): table.GetCellText(row, 1) for row in rows}
        if not all(said.get(name) for name in FIGURES):
            # Its file is still being read, or rows were deleted by hand.
            return None
        isotropy, entropy, dilatation, folded = (float(said[name]) for name in FIGURES)
        return isotropy, entropy, dilatation, int(folded)

    def isCurrent(self, mapNode: slicer.vtkMRMLModelNode | None) -> bool:
        """Whether a map is a full one, not the quick one of an edit or a drag."""
        return mapNode is not None and mapNode.GetAttribute(STAGE) == "map" and not isCopy(mapNode)

    # ---- editing -----------------------------------------------------------------------------------------------------

    def startTemplateEditing(
        self,
        parameterNode: LAFlatteningParameterNode,
        scheduler: Scheduler,
        onEdited: Callable[[EditReport], None] | None = None,
    ) -> None:
        """Follow the template of a parameter node, with handles on the map while its ``editTemplate`` is on.

        Parameters
        ----------
        scheduler : as for `LAFlatteningLogic.startLiveUpdate`, which makes the map when an edit was taken.
        onEdited : told after every edit, see `LAFlatteningScene.template_editor.EditReport`.
        """
        self.stopTemplateEditing()
        self._editor = TemplateEditor(self, parameterNode, scheduler, onEdited)

    def stopTemplateEditing(self) -> None:
        """No longer follow; the handles go."""
        if self._editor is not None:
            self._editor.stop()
            self._editor = None

    def templateHandles(self) -> slicer.vtkMRMLMarkupsFiducialNode | None:
        """The handles on the map, while they are shown."""
        return self._editor.handlesNode if self._editor is not None else None

    def editTemplate(self, template: Template) -> None:
        """Show an edited template on the map, and take it when no other edit follows soon."""
        if self._editor is not None:
            self._editor.propose(template)

    def takeTemplateEdit(self) -> None:
        """Take an edit now that is shown, if there is one."""
        if self._editor is not None:
            self._editor.take()

    def editedTemplate(self, parameterNode: LAFlatteningParameterNode) -> Template:
        """The template as it is being edited; that of the parameter node if it is not."""
        return self._editor.template if self._editor is not None else templateOf(parameterNode.template)

    def canUndoTemplate(self) -> bool:
        """Whether a change of the template can be undone."""
        return self._editor is not None and self._editor.canUndo

    def canRedoTemplate(self) -> bool:
        """Whether an undone change of the template can be made again."""
        return self._editor is not None and self._editor.canRedo

    def undoTemplate(self) -> None:
        """Go back to the template before the last change."""
        if self._editor is not None:
            self._editor.undo()

    def redoTemplate(self) -> None:
        """Make the change again that was undone last."""
        if self._editor is not None:
            self._editor.redo()

    def resetTemplate(self, parameterNode: LAFlatteningParameterNode) -> None:
        """Go back to the built-in template from which editing began; this can be undone."""
        self.takeTemplateEdit()
        parameterNode.template = baseOf(parameterNode.template, self._editor.base if self._editor is not None else "")


def baseOf(text: str, base: str = "") -> str:
    """The built-in template of which a template was made: as it says itself, else `base`, else the default."""
    said = templateOf(text).source.removeprefix("edited from ")
    for name in (text, said, base, "adapted1"):
        if name in builtin_templates():
            return name
    raise AssertionError("the default template is built in")
