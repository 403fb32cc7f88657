"""Images and label maps: NRRD, NIfTI, MetaImage, through SimpleITK.

What SimpleITK lets pass is checked in the header before: a file that states no voxel size (SimpleITK says 1 mm), a
NIfTI file that is cut off (SimpleITK fills up with zeros) or says nothing of left and right.
"""

from __future__ import annotations

import gzip
import re
import zlib
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import SimpleITK as sitk

from ..errors import InputFileError
from ..volume import Volume
from .access import PathLike, atomic_write, input_suffix, known_suffix, unreadable
from .nifti_header import HEADER_BYTES, NiftiHeader

SIZE_LIMITS_MM = (20.0, 3000.0)
"""Plausible longest side of an image of a heart or a body."""
LARGEST_VOXEL_MM = 20.0
"""Plausible largest side of a voxel."""

_IMAGE_IO = {
    ".nrrd": "NrrdImageIO",
    ".nhdr": "NrrdImageIO",
    ".nii.gz": "NiftiImageIO",
    ".nii": "NiftiImageIO",
    ".mha": "MetaImageIO",
    ".mhd": "MetaImageIO",
}
_WRITTEN = (".nrrd", ".nii.gz", ".nii", ".mha")
"""Formats of one file: those of two (.nhdr, .mhd) could be left half-written."""
_TEXT_HEADER_BYTES = 1 << 20
_STATE_SPACING = (
    "expected a voxel size in mm. Export it again from the program that knows it (in Slicer: set it in the Volumes "
    "module, then save)"
)


def read_volume(path: PathLike) -> Volume:
    """Read a 3D image or label map: .nrrd, .nhdr, .nii, .nii.gz, .mha or .mhd, in upper or lower case.

    Positions are LPS, mm, whatever axes the file uses. A fourth dimension of length 1 is dropped.

    Raises
    ------
    InputFileError : missing, empty, damaged or cut off, of an unknown kind; no 3D image with one value a voxel; no
        voxel size stated; axes not at right angles; an implausible size; NIfTI without orientation.

    Examples
    --------
    >>> volume = read_volume("case_laendo.nrrd")  # doctest: +SKIP
    >>> volume.spacing.tolist()  # doctest: +SKIP
    [0.625, 0.625, 1.25]
    """
    path = Path(path)
    suffix = input_suffix(path, _IMAGE_IO, "an image")
    try:
        _CHECKS[_IMAGE_IO[suffix]](path)
    except (OSError, EOFError, zlib.error) as error:
        raise unreadable(path, getattr(error, "strerror", None) or f"it is damaged or cut off ({error})") from error
    reader = sitk.ImageFileReader()
    reader.SetImageIO(_IMAGE_IO[suffix])
    reader.SetFileName(str(path))
    try:
        reader.ReadImageInformation()
        _check_kind(path, reader)
        image = reader.Execute()
    except RuntimeError as error:
        raise unreadable(path, _reason(str(error))) from error
    while image.GetDimension() > 3:
        image = image[..., 0]
    try:
        volume = Volume.from_image(image)
    except InputFileError as error:
        raise InputFileError(f'"{path}": {error}') from error
    _check_size(path, volume)
    return volume


def write_volume(volume: Volume, path: PathLike) -> None:
    """Write an image or label map, compressed; the extension chooses the format: .nrrd, .nii.gz, .nii or .mha.

    Truth values are written as 0 and 1. NIfTI keeps positions as 32-bit numbers (exact to about 0.01 micrometres
    at the size of a body).

    Raises
    ------
    InputFileError : unknown extension, a type of number that no file holds, or the file cannot be written; an older
        file of that name is then unchanged.
    """
    path = Path(path)
    suffix = known_suffix(path, _WRITTEN, "an image")
    values = volume.values.astype(np.uint8) if volume.values.dtype == bool else volume.values
    try:
        image = Volume(values, volume.spacing, volume.origin, volume.direction).to_image()
    except (TypeError, KeyError) as error:
        raise InputFileError(
            f'"{path}" cannot be written: voxels are of the type {values.dtype}. Expected whole numbers, float32 or '
            "float64."
        ) from error
    writer = sitk.ImageFileWriter()
    writer.SetImageIO(_IMAGE_IO[suffix])
    writer.SetUseCompression(suffix != ".nii")
    with atomic_write(path) as temporary:
        writer.SetFileName(str(temporary))
        try:
            writer.Execute(image)
        except RuntimeError as error:
            raise OSError(_reason(str(error))) from error


def _reason(text: str) -> str:
    """The cause in an error of SimpleITK, without its places in source files and memory."""
    if "orthonormal" in text:
        return "its axes are not at right angles (a sheared grid); resample it onto a grid with right angles"
    if "Unable to determine ImageIO" in text:
        return "it is not what its extension says"
    if "itkMetaImageIO" in text:
        return "its voxels are missing or cut off"
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return re.sub(r"^.*?\(0x[0-9a-f]+\):\s*|^.*ERROR:\s*", "", lines[-1]).rstrip(".") if lines else "it is damaged"


def _check_kind(path: Path, reader: sitk.ImageFileReader) -> None:
    size = reader.GetSize()
    if reader.GetNumberOfComponents() != 1:
        raise InputFileError(
            f'"{path}" has {reader.GetNumberOfComponents()} values a voxel (a colour or vector image, or a '
            "segmentation whose segments overlap), expected one. Export one channel, or the segmentation as a label "
            "map."
        )
    if len(size) < 3 or min(size[:3]) < 2:
        raise InputFileError(
            f'"{path}" is a single slice ({" x ".join(map(str, size))} voxels), expected a 3D image. Export the whole '
            "series."
        )
    if any(n > 1 for n in size[3:]):
        raise InputFileError(
            f'"{path}" has {len(size)} dimensions ({" x ".join(map(str, size))} voxels), expected a 3D image. Export '
            "one time point."
        )


def _check_size(path: Path, volume: Volume) -> None:
    sides = volume.spacing * volume.values.shape[::-1]
    low, high = SIZE_LIMITS_MM
    if not (low <= sides.max() <= high and volume.spacing.max() <= LARGEST_VOXEL_MM):
        raise InputFileError(
            f'"{path}" measures {" x ".join(f"{x:.3g}" for x in sides)} mm with voxels of '
            f"{' x '.join(f'{x:.3g}' for x in volume.spacing)} mm, expected a longest side of {low:g} to {high:g} mm "
            f"and voxels of at most {LARGEST_VOXEL_MM:g} mm. The voxel size may be in metres or micrometres; set it in "
            "mm and save the image again."
        )


# ---- what the header states ------------------------------------------------------------------------------------------


def _check_nrrd(path: Path) -> None:
    with path.open("rb") as file:
        head = file.read(_TEXT_HEADER_BYTES)
    if not head.startswith(b"NRRD"):
        raise unreadable(path, 'it is not an NRRD file (it does not begin with "NRRD")')
    # The header ends at the first empty line.
    fields = _fields(re.split(rb"\r?\n\r?\n", head, maxsplit=1)[0], ":")
    directions = re.findall(r"\(([^)]*)\)", fields.get("space directions", ""))
    if directions:
        lengths = [float(np.linalg.norm(_numbers(text.split(",")))) for text in directions]
    else:
        lengths = _numbers(fields.get("spacings", "").split())[:3]
    _check_stated(path, lengths[:3], '"space directions" and "spacings" are missing or empty in its header')


def _check_meta(path: Path) -> None:
    with path.open("rb") as file:
        head = file.read(_TEXT_HEADER_BYTES)
    # Voxels follow the line that says where they are.
    fields = _fields(re.split(rb"ElementDataFile[^\n]*", head, maxsplit=1)[0], "=")
    if "ndims" not in fields:
        raise unreadable(path, "it is not a MetaImage file (it has no NDims line)")
    lengths = _numbers((fields.get("elementspacing") or fields.get("elementsize") or "").split())[:3]
    _check_stated(path, lengths, '"ElementSpacing" is missing or 0 in its header')


def _check_nifti(path: Path) -> None:
    with path.open("rb") as file:
        packed = file.read(2) == b"\x1f\x8b"
    with gzip.open(path, "rb") if packed else path.open("rb") as file:
        start = file.read(HEADER_BYTES)
        header = NiftiHeader.read(path, start)
        length = len(start)
        # To the end, also because only there a damaged file shows.
        while part := file.read(1 << 22):
            length += len(part)
    _check_stated(path, list(header.spacing), "its pixdim is 0")
    if length < header.needed_bytes:
        raise unreadable(path, f"it is cut off (it holds {length} of {header.needed_bytes} bytes)")
    if not header.has_orientation:
        raise InputFileError(
            f'"{path}" does not say how it lies in the patient (qform_code and sform_code are both 0), so left and '
            "right cannot be told apart. Export it again from the program that knows it."
        )
    if not np.allclose(header.sform_spacing, header.spacing, rtol=0.01):
        raise InputFileError(
            f'"{path}" states two voxel sizes that do not agree: {_listed(header.spacing)} mm (pixdim) and '
            f"{_listed(header.sform_spacing)} mm (sform). Expected the same, and axes at right angles; export it again."
        )


_CHECKS = {"NrrdImageIO": _check_nrrd, "NiftiImageIO": _check_nifti, "MetaImageIO": _check_meta}


def _check_stated(path: Path, lengths: Sequence[float], missing: str) -> None:
    known = [length for length in lengths if np.isfinite(length) and length != 0.0]
    if not known:
        raise InputFileError(f'"{path}" states no voxel size ({missing}): {_STATE_SPACING}.')
    if len(known) < len(lengths) or min(known) < 0.0:
        raise InputFileError(f'"{path}" states a voxel size of {_listed(lengths)} mm: {_STATE_SPACING}.')


def _listed(lengths: Iterable[float]) -> str:
    return " x ".join(f"{x:.3g}" for x in lengths)


def _fields(head: bytes, separator: str) -> dict[str, str]:
    """Lines "name: value" of a header, names in lower case; an "=" after the colon belongs to NRRD's own keys."""
    result: dict[str, str] = {}
    for line in head.decode("latin-1").splitlines():
        name, found, value = line.partition(separator)
        if found and not line.startswith("#"):
            result.setdefault(name.strip().lower(), value.strip())
    return result


def _numbers(texts: Sequence[str]) -> list[float]:
    """Numbers in text; NaN for what is none."""
    result = []
    for text in texts:
        try:
            result.append(float(text))
        except ValueError:
            result.append(float("nan"))
    return result
