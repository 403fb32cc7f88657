"""The part of a NIfTI header that says where the voxels lie and how many bytes they take."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from .access import unreadable

HEADER_BYTES = 348
_NIFTI2_BYTES = 540
_LAYOUT: list[Any] = [
    ("sizeof_hdr", "i4"),
    ("unused1", "V36"),
    ("dim", "i2", 8),
    ("unused2", "V14"),
    ("datatype", "i2"),
    ("bitpix", "i2"),
    ("unused3", "V2"),
    ("pixdim", "f4", 8),
    ("vox_offset", "f4"),
    ("unused4", "V140"),
    ("qform_code", "i2"),
    ("sform_code", "i2"),
    ("unused5", "V24"),
    ("srow", "f4", (3, 4)),
    ("unused6", "V20"),
]


@dataclass(frozen=True)
class NiftiHeader:
    """What a NIfTI-1 header states.

    Attributes
    ----------
    spacing : (3,) pixdim of the first three axes, in the file's own unit.
    sform_spacing : (3,) lengths of the columns of the sform matrix; as `spacing` where there is none.
    has_orientation : whether the file has a qform or an sform.
    needed_bytes : length of the unpacked file up to its last voxel.

    Source: nifti1.h of the NIfTI Data Format Working Group.
    """

    spacing: NDArray[np.float64]
    sform_spacing: NDArray[np.float64]
    has_orientation: bool
    needed_bytes: int

    @classmethod
    def read(cls, path: Path, start: bytes) -> NiftiHeader:
        """Of the first `HEADER_BYTES` of the (unpacked) file.

        Raises
        ------
        InputFileError : not a NIfTI-1 file, or cut off in its header.
        """
        orders: tuple[Literal["<", ">"], ...] = ("<", ">")
        for order in orders:
            size = int(np.frombuffer(start[:4].ljust(4, b"\0"), f"{order}i4")[0])
            if size == _NIFTI2_BYTES:
                raise unreadable(path, "it is a NIfTI-2 file, expected NIfTI-1 (or NRRD)")
            if size == HEADER_BYTES:
                break
        else:
            raise unreadable(path, f"it is not a NIfTI file (it does not begin with the number {HEADER_BYTES})")
        if len(start) < HEADER_BYTES:
            raise unreadable(path, f"it is cut off in its header ({len(start)} of {HEADER_BYTES} bytes)")
        head = np.frombuffer(start, np.dtype(_LAYOUT).newbyteorder(order), 1)[0]
        spacing = head["pixdim"][1:4].astype(np.float64)
        sform = bool(head["sform_code"] > 0)
        # Python's whole numbers: a damaged header must not overflow.
        bits = int(head["bitpix"])
        for n in head["dim"][1 : 1 + min(max(int(head["dim"][0]), 1), 7)]:
            bits *= max(1, int(n))
        return cls(
            spacing,
            np.linalg.norm(head["srow"][:, :3].astype(np.float64), axis=0) if sform else spacing,
            sform or bool(head["qform_code"] > 0),
            int(np.nan_to_num(head["vox_offset"])) + (bits + 7) // 8,
        )
