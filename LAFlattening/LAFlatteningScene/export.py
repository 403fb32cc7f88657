"""Writing a map: model, picture, tables; all files or none."""

from __future__ import annotations

import csv
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import slicer
import vtk

from LAFlatteningLib import builtin_templates
from LAFlatteningLib.errors import InputFileError, SurfaceError
from LAFlatteningLib.files import atomic_write, write_surface
from LAFlatteningLib.flattening.flat_map import POSITION_ARRAY
from LAFlatteningLib.map_data import DIAMETER_FIELD
from LAFlatteningLib.shading import label_of
from LAFlatteningLib.surface import Surface

from .comparison_nodes import COMPARISON
from .display_link import activeArray, scalarRange
from .fibrosis_nodes import FIBROSIS
from .gap_nodes import GAP_LIST, GAPS
from .map_nodes import STAGE, prepareDisplay, refuseCopy, settingsOf
from .map_reading import mapDataOf
from .overlay import overlayOf
from .quality_nodes import METRICS_ROLE, REGIONS_ROLE
from .result_nodes import KIND, isCurrent, resultOf
from .template_text import templateOf
from .views import MARGIN

FORMATS = ("vtp", "png", "csv")
MEASURED = (FIBROSIS, GAPS, GAP_LIST, COMPARISON)
"""Tables that are written with a map."""
MAP_PIXELS, BAR_PIXELS = 1200, 420
"""Height (and width) of the map on the picture, and width of its colour bar."""
TEXT_PIXELS, TITLE_PIXELS = 26, 30
TICKS = 6
NO_VALUE = (0.85, 0.85, 0.85)

ModelNode = slicer.vtkMRMLModelNode


def exportMap(mapNode: ModelNode, directory: str | Path, formats: tuple[str, ...] = FORMATS) -> list[Path]:
    """Write a map to files named after it; returns their paths. See `LAFlatteningLogic.exportMap`."""
    unknown = [name for name in formats if name not in FORMATS]
    if unknown or not formats:
        raise InputFileError(f"Expected formats out of {', '.join(FORMATS)}, found {', '.join(unknown) or 'none'}.")
    if mapNode is None or mapNode.GetPolyData() is None or mapNode.GetPolyData().GetNumberOfPolys() == 0:
        raise InputFileError("There is no map to write. Make one first (Flatten).")
    refuseCopy(mapNode)
    if mapNode.GetAttribute(STAGE) == "preview":
        raise InputFileError(
            f'"{mapNode.GetName()}" is only a quick map, as made while something is moved, and its tables are of the '
            "one before. Press Flatten first."
        )
    measured = [table for kind in MEASURED if (table := resultOf(mapNode, kind)) is not None]
    if "csv" in formats and not all(isCurrent(mapNode, table) for table in measured):
        raise InputFileError(
            f'What was measured on "{mapNode.GetName()}" is outdated, because map or intensities have changed since. '
            "Measure again or clear the results; then export."
        )
    prepareDisplay(mapNode)
    folder = Path(directory)
    if not str(directory) or not folder.is_dir():
        raise InputFileError(f'The folder "{directory}" does not exist. Choose or create a folder for the files.')
    stem = "".join(letter if letter.isalnum() or letter in " -_." else "_" for letter in mapNode.GetName())
    written: list[Path] = []
    # Every file is written beside its place; none takes its place before all could be written.
    with ExitStack() as files:

        def temporary(name: str) -> Path:
            written.append(folder / name)
            return files.enter_context(atomic_write(folder / name))

        if "vtp" in formats:
            write_surface(mapSurface(mapNode), temporary(f"{stem}.vtp"))
            template = templateOf(settingsOf(mapNode).template)
            if template.name not in builtin_templates():
                # The map names it only, and cannot be read without it.
                template.save(temporary(f"{stem} template.json"))
        if "png" in formats:
            writePicture(mapNode, temporary(f"{stem}.png"))
        if "csv" in formats:
            for role, what in ((METRICS_ROLE, "metrics"), (REGIONS_ROLE, "regions")):
                table = mapNode.GetNodeReference(role)
                if table is not None:
                    writeTable(table, temporary(f"{stem} {what}.csv"))
            for table in measured:
                writeTable(table, temporary(f"{stem} {table.GetAttribute(KIND)}.csv"))
    return written


def mapSurface(mapNode: ModelNode) -> Surface:
    """The map of a node as a surface of the library, mm, with all its arrays; it shares nothing with the node.

    As in the library's own files, ``position_mm`` says where each point is on the atrium, as long as that is in the
    scene: without it nothing can be measured on the file.
    """
    copy = vtk.vtkPolyData()
    copy.DeepCopy(mapNode.GetPolyData())
    # A map has no patient axes. RAS is what Slicer shows as it is, without turning it.
    surface = Surface.from_polydata(copy, "RAS")
    try:
        places = {POSITION_ARRAY: mapDataOf(mapNode).surface.points}
        return surface.with_data(places, field_data={DIAMETER_FIELD: np.array([settingsOf(mapNode).diskDiameter])})
    except SurfaceError:
        return surface


def writeTable(table: slicer.vtkMRMLTableNode, path: Path) -> None:
    """A table as CSV in UTF-8, with a line of headings."""
    columns = [table.GetTable().GetColumn(k) for k in range(table.GetNumberOfColumns())]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([column.GetName() for column in columns])
        for row in range(table.GetNumberOfRows()):
            writer.writerow([column.GetVariantValue(row).ToString() for column in columns])


def writePicture(mapNode: ModelNode, path: Path) -> None:
    """The map from above as PNG, in the colours and with the overlay in which it is shown, with a colour bar."""
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(True)
    window.SetMultiSamples(0)
    array = activeArray(mapNode)
    width = MAP_PIXELS + (BAR_PIXELS if array is not None else 0)
    window.SetSize(width, MAP_PIXELS)
    share = MAP_PIXELS / width
    window.AddRenderer(_mapRenderer(mapNode, array, share))
    if array is not None:
        window.AddRenderer(_barRenderer(mapNode, array, share))
    window.Render()
    image = vtk.vtkWindowToImageFilter()
    image.SetInput(window)
    image.SetInputBufferTypeToRGB()
    image.ReadFrontBufferOff()
    image.Update()
    writer = vtk.vtkPNGWriter()
    writer.SetFileName(str(path))
    writer.SetInputConnection(image.GetOutputPort())
    writer.Write()
    window.Finalize()
    if writer.GetErrorCode():
        raise OSError(vtk.vtkErrorCode.GetStringFromErrorCode(writer.GetErrorCode()))


def colours(mapNode: ModelNode) -> vtk.vtkScalarsToColors:
    """The colours of a map over the range in which it is shown; a copy."""
    node = mapNode.GetDisplayNode().GetColorNode()
    source = node.GetLookupTable() if node is not None and node.GetLookupTable() is not None else None
    if source is None and node is not None and node.GetScalarsToColors() is not None:
        table = node.GetScalarsToColors().NewInstance()
        table.DeepCopy(node.GetScalarsToColors())
        return table
    table = vtk.vtkLookupTable()
    if source is not None:
        table.DeepCopy(source)
    table.SetRange(*scalarRange(mapNode))
    table.SetNanColor(*NO_VALUE, 1.0)
    table.Build()
    return table


def _mapRenderer(mapNode: ModelNode, array: vtk.vtkDataArray | None, share: float) -> vtk.vtkRenderer:
    renderer = vtk.vtkRenderer()
    renderer.SetViewport(0.0, 0.0, share, 1.0)
    renderer.SetBackground(1.0, 1.0, 1.0)
    display = mapNode.GetDisplayNode()
    actor = _actor(mapNode)
    mapper = actor.GetMapper()
    mapper.SetScalarVisibility(array is not None)
    if array is not None:
        _selectArray(mapper, mapNode, array)
        mapper.SetLookupTable(colours(mapNode))
        mapper.SetUseLookupTableScalarRange(True)
    actor.GetProperty().SetColor(*display.GetColor())
    renderer.AddActor(actor)
    lines, labels = overlayOf(mapNode)
    for node in (lines, labels):
        if node is None or not node.GetDisplayNode().GetVisibility():
            continue
        part = _actor(node)
        part.GetProperty().SetColor(*node.GetDisplayNode().GetColor())
        part.GetProperty().SetLineWidth(4.0)
        if node is labels:
            part.GetMapper().SetScalarModeToUseCellFieldData()
            part.GetMapper().SelectColorArray("colour")
            part.GetMapper().SetColorModeToDirectScalars()
        else:
            part.GetMapper().ScalarVisibilityOff()
        renderer.AddActor(part)
    diameter = settingsOf(mapNode).diskDiameter
    camera = renderer.GetActiveCamera()
    camera.ParallelProjectionOn()
    camera.SetFocalPoint(0.0, 0.0, 0.0)
    camera.SetPosition(0.0, 0.0, 5.0 * diameter)
    camera.SetViewUp(0.0, 1.0, 0.0)
    camera.SetParallelScale(0.5 * MARGIN * diameter)
    renderer.ResetCameraClippingRange()
    return renderer


def _actor(node: ModelNode) -> vtk.vtkActor:
    """A model without light, where it is in its own coordinates."""
    mapper = vtk.vtkPolyDataMapper()
    mapper.SetInputData(node.GetPolyData())
    actor = vtk.vtkActor()
    actor.SetMapper(mapper)
    actor.GetProperty().LightingOff()
    return actor


def _selectArray(mapper: vtk.vtkPolyDataMapper, mapNode: ModelNode, array: vtk.vtkDataArray) -> None:
    if mapNode.GetDisplayNode().GetActiveAttributeLocation() == vtk.vtkAssignAttribute.CELL_DATA:
        mapper.SetScalarModeToUseCellFieldData()
    else:
        mapper.SetScalarModeToUsePointFieldData()
        mapper.InterpolateScalarsBeforeMappingOn()
    mapper.SelectColorArray(array.GetName())


def _barRenderer(mapNode: ModelNode, array: vtk.vtkDataArray, share: float) -> vtk.vtkRenderer:
    renderer = vtk.vtkRenderer()
    renderer.SetViewport(share, 0.0, 1.0, 1.0)
    renderer.SetBackground(1.0, 1.0, 1.0)
    bar = vtk.vtkScalarBarActor()
    node = mapNode.GetDisplayNode().GetColorNode()
    table = colours(mapNode)
    names = _names(node)
    if names:
        table = _named(table, names)
    else:
        # Ticks are annotations too: how tick labels are formatted depends on the version of VTK.
        for value in np.linspace(*table.GetRange(), TICKS):
            table.SetAnnotation(float(value), f"{value:.4g}")
    bar.SetDrawTickLabels(False)
    bar.SetTextPositionToPrecedeScalarBar()
    bar.SetLookupTable(table)
    bar.SetTitle(("Region" if names else label_of(array.GetName())) + "\n ")
    bar.SetUnconstrainedFontSize(True)
    bar.SetPosition(0.05, 0.1)
    bar.SetPosition2(0.9, 0.8)
    bar.SetBarRatio(0.14)
    for text, size in (
        (bar.GetTitleTextProperty(), TITLE_PIXELS),
        (bar.GetAnnotationTextProperty(), TEXT_PIXELS),
    ):
        text.SetColor(0.1, 0.1, 0.1)
        text.SetFontSize(size)
        text.ItalicOff()
        text.ShadowOff()
        text.BoldOff()
    renderer.AddViewProp(bar)
    return renderer


def _names(node: slicer.vtkMRMLColorNode | None) -> dict[int, str]:
    """Value -> name in a colour table whose colours mean classes; empty for one that means numbers."""
    if node is None or node.GetType() != node.User or node.GetNumberOfColors() > 32:
        return {}
    names = {k: node.GetColorName(k) for k in range(node.GetNumberOfColors())}
    return {k: name for k, name in names.items() if name and name != node.GetNoName()}


def _named(table: vtk.vtkScalarsToColors, names: dict[int, str]) -> vtk.vtkLookupTable:
    """A table of classes, each with its name beside its colour."""
    classes = vtk.vtkLookupTable()
    classes.SetNumberOfTableValues(len(names))
    classes.IndexedLookupOn()
    colour = np.zeros(3)
    for row, (value, name) in enumerate(names.items()):
        table.GetColor(float(value), colour)
        classes.SetTableValue(row, *colour, 1.0)
        classes.SetAnnotation(float(value), name)
    return classes
