"""Images and label maps: .nrrd, .nhdr, .nii, .nii.gz, .mha, .mhd."""

from __future__ import annotations

import gzip
import math
import re
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import SimpleITK as sitk

from ..errors import InputFileError
from ..volume import Volume
from .access import PathLike, atomic_write, input_suffix, known_suffix, unreadable

SMALLEST_EXTENT = 20.0
"""An image whose longest side is shorter shows no atrium, mm; metres in place of mm end up here."""
LARGEST_EXTENT = 2000.0
"""An image of a patient is no longer, mm; micrometres in place of mm end up here."""

_HEADER_BYTES = 1 << 16


def read_volume(path: PathLike) -> Volume:
    """Read a 3D image or label map: .nrrd, .nhdr, .nii, .nii.gz, .mha or .mhd, in upper or lower case.

    Places are in LPS, mm, whatever axes the file uses. A 4D file with a single time is taken as 3D.

    Raises
    ------
    InputFileError : missing, empty, damaged or cut off, of an unknown kind, not 3D, several values a voxel, no stated
        voxel spacing, image axes not at right angles, or a size that cannot be that of an atrium in mm.
    """
    path = Path(path)
    suffix = input_suffix(path, _STATES_SPACING, "an image")
    try:
        stated = _STATES_SPACING[suffix](path)
    except OSError as error:
        raise unreadable(path, error.strerror or str(error)) from error
    except (EOFError, zlib.error, struct.error, ValueError) as error:
        if isinstance(error, InputFileError):
            raise
        raise unreadable(path, f"it is damaged or cut off ({error})") from error
    if not stated:
        raise InputFileError(
            f'"{path}" states no voxel spacing, so nothing in it can be measured in mm. Expected {_WHERE[suffix]}. '
            "Export it again from the program that made it, with its spacing."
        )
    reader = sitk.ImageFileReader()
    reader.SetFileName(str(path))
    try:
        reader.ReadImageInformation()
        size, components = list(reader.GetSize()), reader.GetNumberOfComponents()
        if len(size) == 4 and size[3] == 1:
            reader.SetExtractSize([*size[:3], 0])
            size = size[:3]
        if len(size) != 3 or components != 1 or min(size) < 2:
            raise InputFileError(
                f'"{path}": expected a 3D image with one value a voxel, found {" x ".join(map(str, size))} voxels with '
                f"{components} value{'s' if components > 1 else ''} each. Export one volume, or one segment as a label "
                "map (in Slicer: Segmentations, Export to label map)."
            )
        image = reader.Execute()
    except RuntimeError as error:
        raise unreadable(path, _reason(error)) from error
    try:
        volume = Volume.from_image(image)
    except InputFileError as error:
        raise InputFileError(f'"{path}": {error}') from error
    extent = volume.spacing * volume.values.shape[::-1]
    if not SMALLEST_EXTENT <= extent.max() <= LARGEST_EXTENT:
        raise InputFileError(
            f'"{path}" is {" x ".join(f"{side:.3g}" for side in extent)} mm large; expected a longest side of '
            f"{SMALLEST_EXTENT:g} to {LARGEST_EXTENT:g} mm. Its spacing is probably not in mm: correct it."
        )
    return volume


def write_volume(volume: Volume, path: PathLike) -> None:
    """Write an image or label map, compressed; the extension chooses the format: .nrrd, .nii, .nii.gz or .mha.

    Raises
    ------
    InputFileError : unknown extension, or the file cannot be written; an older file of that name is then unchanged.
    """
    path = Path(path)
    suffix = known_suffix(path, (".nrrd", ".nii.gz", ".nii", ".mha"), "an image")
    if volume.values.dtype == np.bool_:
        volume = Volume(volume.values.astype(np.uint8), volume.spacing, volume.origin, volume.direction)
    with atomic_write(path) as temporary:
        # ITK chooses the format by the name; of .nii.gz it looks at both extensions, and wants no other before them.
        part = temporary.with_name(temporary.name.replace(".", "_") + suffix)
        try:
            sitk.WriteImage(volume.to_image(), str(part), useCompression=suffix != ".nii")
            part.replace(temporary)
        except RuntimeError as error:
            raise OSError(_reason(error)) from error
        finally:
            part.unlink(missing_ok=True)


def _reason(error: RuntimeError) -> str:
    """The last line of what ITK says, without its source files and addresses."""
    lines = [re.sub(r"^.*?\(0x[0-9a-f]+\): ", "", line).strip() for line in str(error).splitlines()]
    lines = [line for line in lines if line and not line.startswith(("/", "Exception thrown"))]
    return re.sub(r"^\S*ERROR:?\s*", "", lines[-1]).rstrip(".") if lines else "it is damaged"


def _numbers(text: str) -> list[float]:
    return [float(word) for word in re.findall(r"[^\s(),]+", text) if word.lower() != "none"]


def _nrrd_states_spacing(path: Path) -> bool:
    with path.open("rb") as file:
        head = file.read(_HEADER_BYTES)
    if not head.startswith(b"NRRD"):
        raise unreadable(path, "it is not a NRRD file (it does not begin with NRRD)")
    text = re.split(rb"\r?\n\r?\n", head, maxsplit=1)[0].decode("latin-1")
    fields = dict(re.findall(r"^([^:#\n]+):[ =]*(.*?)\r?$", text, re.MULTILINE))
    for name in ("space directions", "spacings"):
        if name in fields:
            values = np.array(_numbers(fields[name]))
            # A missing spacing of an axis is written as NaN.
            spaced = values[np.isfinite(values)]
            wanted = 9 if name == "space directions" else 3
            return len(spaced) >= wanted and bool(np.any(spaced))
    return False


def _meta_image_states_spacing(path: Path) -> bool:
    with path.open("rb") as file:
        head = file.read(_HEADER_BYTES)
    end = re.search(rb"^\s*ElementDataFile\s*=", head, re.MULTILINE)
    if not end:
        raise unreadable(path, "it is not a MetaImage file (its header has no ElementDataFile)")
    text = head[: end.start()].decode("latin-1")
    found = re.search(r"^\s*(ElementSpacing|ElementSize)\s*=(.*)$", text, re.MULTILINE)
    return found is not None and all(value > 0 for value in _numbers(found[2]))


def _nifti_states_spacing(path: Path) -> bool:
    packed = path.name.lower().endswith(".gz")
    with gzip.open(path) if packed else path.open("rb") as file:
        head = file.read(540)
        # The NIfTI library takes what is missing at the end for zeros, so count what is there.
        found = len(head)
        while part := file.read(1 << 20):
            found += len(part)
    for order in "<>":
        size = struct.unpack_from(order + "i", head)[0]
        if size == 348:
            dim, bits = struct.unpack_from(order + "8h", head, 40), struct.unpack_from(order + "h", head, 72)[0]
            pixdim, start = struct.unpack_from(order + "8f", head, 76), struct.unpack_from(order + "f", head, 108)[0]
            break
        if size == 540:
            dim, bits = struct.unpack_from(order + "8q", head, 16), struct.unpack_from(order + "h", head, 14)[0]
            pixdim, start = struct.unpack_from(order + "8d", head, 104), struct.unpack_from(order + "q", head, 168)[0]
            break
    else:
        raise unreadable(path, "it is not a NIfTI file")
    wanted = start + math.prod(dim[1 : 1 + max(0, min(dim[0], 7))]) * bits / 8
    if found < wanted:
        raise unreadable(path, f"it is cut off: {found} bytes, expected {wanted:.0f}")
    return all(np.isfinite(value) and value != 0.0 for value in pixdim[1:4])


_STATES_SPACING: dict[str, Callable[[Path], bool]] = {
    ".nrrd": _nrrd_states_spacing,
    ".nhdr": _nrrd_states_spacing,
    ".nii.gz": _nifti_states_spacing,
    ".nii": _nifti_states_spacing,
    ".mha": _meta_image_states_spacing,
    ".mhd": _meta_image_states_spacing,
}
VOLUME_SUFFIXES = tuple(_STATES_SPACING)
"""Extensions of the files that `read_volume` reads."""
_NIFTI = "pixdim 1 to 3 of its header above 0"
_NRRD = 'a field "space directions" or "spacings" in its header'
_META = 'a line "ElementSpacing = x y z" in its header'
_WHERE = {".nrrd": _NRRD, ".nhdr": _NRRD, ".nii.gz": _NIFTI, ".nii": _NIFTI, ".mha": _META, ".mhd": _META}
