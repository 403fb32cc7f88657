"""Section Template: where holes and mitral seeds lie on the map, to be moved, saved and opened."""

import qt
from LAFlatteningScene.map_nodes import millimetresPerUnit
from LAFlatteningScene.template_handles import FOOT, handlesOf
from slicer.i18n import tr as _

from LAFlatteningLib import TemplateError
from LAFlatteningLib.template_editing import move_foot, move_hole, scale_hole

from .section import Section, errorsShownIn, showMessage

FILES = "Template (*.json)"


class TemplateSection(Section):
    """Edits the template by numbers; handles on the map do the same. Lengths are mm on the map."""

    def __init__(self, panel) -> None:
        super().__init__(panel)
        self.holes: tuple[str, ...] = ()
        self.feet: tuple[str, ...] = ()
        for spinBox, act in (
            (self.ui.holeX, lambda: self.moveHole(0)),
            (self.ui.holeY, lambda: self.moveHole(1)),
            (self.ui.holeRadius, self.resizeHole),
            (self.ui.footAngle, self.moveFoot),
        ):
            spinBox.connect("valueChanged(double)", lambda _value, act=act: act())
        for selector in (self.ui.holeSelector, self.ui.footSelector):
            selector.connect("activated(int)", lambda _row: self.showNumbers())
        for button, act in (
            (self.ui.undoTemplateButton, self.undo),
            (self.ui.redoTemplateButton, self.redo),
            (self.ui.resetTemplateButton, self.resetTemplate),
            (self.ui.openTemplateButton, self.open),
            (self.ui.saveTemplateButton, self.save),
        ):
            button.connect("clicked()", act)

    # ---- what the user does ------------------------------------------------------------------------------------------

    def moveHole(self, axis: int) -> None:
        """The hole goes along an axis (0 or 1) to where its number says; the other coordinate keeps all its digits."""
        template, hole = self._template(), self.holes[self.ui.holeSelector.currentIndex]
        value = (self.ui.holeX, self.ui.holeY)[axis].value
        centre = list(template.holes[hole].shape.centre)
        centre[axis] = value / self._unit(template) + template.outer.shape.centre[axis]
        self._edit(lambda: move_hole(template, hole, centre))

    def resizeHole(self) -> None:
        """The hole gets the radius that the number says; of an ellipse, the larger semi-axis."""
        template, hole = self._template(), self.holes[self.ui.holeSelector.currentIndex]
        radius = self.ui.holeRadius.value / self._unit(template)
        self._edit(lambda: scale_hole(template, hole, radius / max(template.holes[hole].shape.semi_axes)))

    def moveFoot(self) -> None:
        """The mitral seed goes to the angle that the number says."""
        template, path = self._template(), self.feet[self.ui.footSelector.currentIndex]
        self._edit(lambda: move_foot(template, template.anatomy.outer, path, self.ui.footAngle.value))

    def undo(self) -> None:
        """Go back to the template before the last change."""
        self.logic.undoTemplate()
        self._edited("")

    def redo(self) -> None:
        """Make the change again that was undone last."""
        self.logic.redoTemplate()
        self._edited("")

    def resetTemplate(self) -> None:
        """Go back to the built-in template."""
        with errorsShownIn(self.ui.templateMessage, _("The template could not be reset.")):
            self.logic.resetTemplate(self.parameters)
        self.panel.update()

    def open(self) -> None:
        """Use the template of a file."""
        path = qt.QFileDialog.getOpenFileName(self.panel.parent, _("Open a template"), "", _(FILES))
        if path:
            with errorsShownIn(self.ui.templateMessage, _("The template could not be opened.")):
                self.logic.openTemplate(self.parameters, path)
        self.panel.update()

    def save(self) -> None:
        """Write the template to a file, by whose name it is then called."""
        name = f"{self._template().name}.json"
        path = qt.QFileDialog.getSaveFileName(self.panel.parent, _("Save the template"), name, _(FILES))
        if path:
            with errorsShownIn(self.ui.templateMessage, _("The template could not be saved.")):
                self.logic.saveTemplate(self.parameters, path)
        self.panel.update()

    def _edit(self, edited) -> None:
        try:
            self.logic.editTemplate(edited())
        except TemplateError as error:
            self._edited(str(error))

    def _edited(self, message: str) -> None:
        showMessage(self.ui.templateMessage, message)
        self.update()

    # ---- what is shown -----------------------------------------------------------------------------------------------

    def reset(self) -> None:
        """No message of another scene."""
        showMessage(self.ui.templateMessage, "")
        showMessage(self.ui.quickDistortion, "")

    def showEdit(self, report) -> None:
        """What has come of an edit."""
        showMessage(self.ui.templateMessage, report.message)
        handle = report.handle
        if handle is not None:
            names, selector = (
                (self.feet, self.ui.footSelector) if handle.kind == FOOT else (self.holes, self.ui.holeSelector)
            )
            if handle.name in names:
                selector.currentIndex = names.index(handle.name)
        self.showNumbers()
        if report.summary is not None:
            self._showQuick(report)
        self._updateButtons()

    def _showQuick(self, report) -> None:
        s = report.summary
        text = _("While editing: {figures}").format(
            figures=_figures(s["beta"]["mean"], s["alpha"]["entropy"], s["dilatation"]["p99"], report.folded)
        )
        showMessage(self.ui.quickDistortion, text)

    def showNumbers(self) -> None:
        """Place and size of the hole, and angle of the mitral seed, that are chosen."""
        template, chosen = self._template(), self.holes[self.ui.holeSelector.currentIndex] if self.holes else None
        unit, outer = self._unit(template), template.outer
        if chosen is not None:
            shape = template.holes[chosen].shape
            for spinBox, value in (
                (self.ui.holeX, (shape.centre[0] - outer.shape.centre[0]) * unit),
                (self.ui.holeY, (shape.centre[1] - outer.shape.centre[1]) * unit),
                (self.ui.holeRadius, max(shape.semi_axes) * unit),
            ):
                _show(spinBox, value)
        if self.feet:
            _show(self.ui.footAngle, outer.feet[self.feet[self.ui.footSelector.currentIndex]] % 360.0)

    def update(self) -> None:
        """Names, numbers, distortion of the map, and what can be pressed now."""
        template = self._template()
        feet = {handle.name: handle.label(template) for handle in handlesOf(template) if handle.kind == FOOT}
        self.holes = _fill(self.ui.holeSelector, {name: name for name in template.anatomy.holes})
        self.feet = _fill(self.ui.footSelector, feet)
        self.showNumbers()
        mapNode = self.parameters.map
        figures = self.logic.distortionFigures(mapNode)
        if figures is not None:
            self.ui.mapDistortion.text = _figures(*figures)
        elif mapNode is None:
            self.ui.mapDistortion.text = _("There is no map yet, so that edits cannot be seen.")
        else:
            self.ui.mapDistortion.text = _("The figures of this map are not in the scene. Press Flatten.")
        if self.logic.isCurrent(mapNode):
            showMessage(self.ui.quickDistortion, "")
        self._updateButtons()

    def _updateButtons(self) -> None:
        self.ui.undoTemplateButton.enabled = self.logic.canUndoTemplate()
        self.ui.redoTemplateButton.enabled = self.logic.canRedoTemplate()
        self.ui.editTemplate.enabled = self.parameters.map is not None
        for widget, wanted in (
            (self.ui.holeX, self.holes),
            (self.ui.holeY, self.holes),
            (self.ui.holeRadius, self.holes),
            (self.ui.footAngle, self.feet),
        ):
            widget.enabled = bool(wanted)

    def _template(self):
        return self.logic.editedTemplate(self.parameters)

    def _unit(self, template) -> float:
        return millimetresPerUnit(template, float(self.parameters.diskDiameter))


def _figures(isotropy: float, entropy: float, dilatation: float, folded: int) -> str:
    """Figures of the distortion, for people."""
    return _(
        "isotropy {isotropy}, entropy of the area ratio {entropy} nat, dilatation {dilatation} (99th percentile), "
        "folded triangles {folded}"
    ).format(
        isotropy=f"{isotropy:.3f}", entropy=f"{entropy:.2f}", dilatation=f"{dilatation:.1f}", folded=f"{int(folded)}"
    )


def _fill(selector, names: dict[str, str]) -> tuple[str, ...]:
    """Offer some names; the one that was chosen stays, as far as it is still there."""
    labels = list(names.values())
    if [selector.itemText(row) for row in range(selector.count)] != labels:
        selector.clear()
        selector.addItems(labels)
    if selector.currentIndex < 0 and labels:
        selector.currentIndex = 0
    selector.enabled = bool(labels)
    return tuple(names)


def _show(spinBox, value: float) -> None:
    """Show a number without taking it for an edit; one that is being typed stays as it is."""
    if abs(spinBox.value - value) < 0.5 * 10.0**-spinBox.decimals:
        return
    blocked = spinBox.blockSignals(True)
    spinBox.value = value
    spinBox.blockSignals(blocked)
