"""Image files: round trips, axes, and every kind of bad file with its message."""

from __future__ import annotations

import gzip
import re
import struct
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk

from LAFlatteningLib.errors import InputFileError
from LAFlatteningLib.files import read_volume, write_volume
from LAFlatteningLib.volume import Volume

WRITTEN = (".nrrd", ".nii.gz", ".nii", ".mha")


def turned() -> np.ndarray:
    """A left-handed direction matrix, far from any axis."""
    a, b = np.radians(20.0), np.radians(35.0)
    first = np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])
    second = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(b), -np.sin(b)], [0.0, np.sin(b), np.cos(b)]])
    return first @ second @ np.diag([1.0, 1.0, -1.0])


def sample(dtype: type = np.int16) -> Volume:
    values = np.random.default_rng(0).integers(0, 100, (12, 30, 40)).astype(dtype)
    return Volume(values, np.array([1.0, 1.25, 2.5]), np.array([-50.0, 120.5, 33.25]), turned())


def saved(tmp_path: Path, suffix: str, compressed: bool = False) -> Path:
    """A file that another program may have written (SimpleITK itself), axial, not compressed."""
    image = sitk.GetImageFromArray(sample(np.uint8).values)
    image.SetSpacing((1.0, 1.25, 2.5))
    image.SetOrigin((5.0, 6.0, 7.0))
    path = tmp_path / f"image{suffix}"
    sitk.WriteImage(image, str(path), useCompression=compressed)
    return path


def replaced(path: Path, pattern: str, by: str) -> Path:
    data = path.read_bytes()
    changed = re.sub(pattern.encode(), by.encode(), data, count=1)
    assert changed != data
    path.write_bytes(changed)
    return path


def patched(path: Path, *changes: tuple[int, str, float]) -> Path:
    """Numbers of a header overwritten: (offset, format, value)."""
    data = bytearray(path.read_bytes())
    for offset, kind, value in changes:
        struct.pack_into(kind, data, offset, value)
    path.write_bytes(data)
    return path


def reason(path: Path) -> str:
    with pytest.raises(InputFileError) as caught:
        read_volume(path)
    assert path.name in str(caught.value)
    return str(caught.value)


# ---- round trips ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", WRITTEN)
@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.float32, np.float64])
def test_round_trip(tmp_path: Path, suffix: str, dtype: type) -> None:
    volume = sample(dtype)
    path = tmp_path / f"a case{suffix}"
    write_volume(volume, path)
    again = read_volume(path)
    assert np.array_equal(again.values, volume.values) and again.values.dtype == dtype
    assert np.allclose(again.spacing, volume.spacing, rtol=1e-6)
    assert np.allclose(again.origin, volume.origin, atol=1e-4)
    assert np.allclose(again.direction, volume.direction, atol=1e-6)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix", [".nhdr", ".mhd", ".NRRD"])
def test_reads_files_in_two_parts_and_upper_case(tmp_path: Path, suffix: str) -> None:
    path = saved(tmp_path, suffix.lower())
    if suffix.isupper():
        path = path.rename(path.with_suffix(suffix))
    assert np.array_equal(read_volume(path).values, sample(np.uint8).values)


def test_truth_values_become_a_label_map(tmp_path: Path) -> None:
    volume = sample()
    write_volume(Volume(volume.values > 50, volume.spacing, volume.origin, volume.direction), tmp_path / "mask.nrrd")
    again = read_volume(tmp_path / "mask.nrrd")
    assert again.values.dtype == np.uint8 and np.array_equal(again.values, volume.values > 50)


def test_axes_of_files_become_lps(tmp_path: Path) -> None:
    # NRRD may count in RAS; NIfTI always does.
    path = replaced(saved(tmp_path, ".nrrd"), "left-posterior-superior", "right-anterior-superior")
    volume = read_volume(path)
    assert np.allclose(volume.direction, np.diag([-1.0, -1.0, 1.0]))
    assert np.allclose(volume.origin, [-5.0, -6.0, 7.0])
    data = saved(tmp_path, ".nii").read_bytes()
    ras = np.array(struct.unpack_from("<12f", data, 280)).reshape(3, 4)
    volume = read_volume(tmp_path / "image.nii")
    place = volume.positions(np.array([[3.0, 4.0, 5.0]]))[0]
    assert np.allclose(place * [-1.0, -1.0, 1.0], ras @ [3.0, 4.0, 5.0, 1.0])


def test_a_fourth_dimension_of_one_is_dropped(tmp_path: Path) -> None:
    image = sitk.JoinSeries([sitk.ReadImage(str(saved(tmp_path, ".nrrd")))])
    for suffix in (".nrrd", ".nii"):
        sitk.WriteImage(image, str(tmp_path / f"four{suffix}"))
        assert read_volume(tmp_path / f"four{suffix}").values.shape == (12, 30, 40)


def test_nifti_of_either_byte_order(tmp_path: Path) -> None:
    # Big-endian, written by its specification: 348 bytes of header, four more, the voxels.
    values = np.arange(24 * 25 * 26, dtype=">i2").reshape(26, 25, 24)
    head = bytearray(352)
    struct.pack_into(">i", head, 0, 348)
    struct.pack_into(">8h", head, 40, 3, 24, 25, 26, 1, 1, 1, 1)
    struct.pack_into(">2h", head, 70, 4, 16)
    struct.pack_into(">9f", head, 76, 1, 1.5, 1.5, 2, 0, 0, 0, 0, 352)
    struct.pack_into(">b", head, 123, 2)
    struct.pack_into(">2h", head, 252, 0, 1)
    struct.pack_into(">12f", head, 280, 1.5, 0, 0, -10, 0, 1.5, 0, -20, 0, 0, 2, 30)
    head[344:348] = b"n+1\0"
    path = tmp_path / "big.nii"
    path.write_bytes(bytes(head) + values.tobytes())
    volume = read_volume(path)
    assert np.array_equal(volume.values, values) and volume.spacing.tolist() == [1.5, 1.5, 2.0]
    assert np.allclose(volume.origin, [10.0, 20.0, 30.0])
    assert np.allclose(volume.direction, np.diag([-1.0, -1.0, 1.0]))
    path.write_bytes(path.read_bytes()[:-100])
    assert "it is cut off (it holds 31452 of 31552 bytes)" in reason(path)
    path.write_bytes(struct.pack("<i8s", 540, b"n+2\0\r\n\x1a\n").ljust(600, b"\0"))
    assert "it is a NIfTI-2 file" in reason(path)


# ---- no voxel size ---------------------------------------------------------------------------------------------------


def test_a_file_that_states_no_voxel_size_is_refused(tmp_path: Path) -> None:
    nothing = replaced(saved(tmp_path, ".nrrd"), "space: .*\n", "")
    replaced(replaced(nothing, "space directions: .*\n", ""), "space origin: .*\n", "")
    # What this guards against: SimpleITK reads it as 1 mm.
    assert sitk.ReadImage(str(nothing)).GetSpacing() == (1.0, 1.0, 1.0)
    assert "states no voxel size" in reason(nothing)
    replaced(nothing, "kinds:", "spacings: nan nan nan\nkinds:")
    assert "states no voxel size" in reason(nothing)
    replaced(nothing, "spacings: nan nan nan", "spacings: 1 1.25 2.5")
    assert read_volume(nothing).spacing.tolist() == [1.0, 1.25, 2.5]
    replaced(nothing, "spacings: 1 1.25 2.5", "spacings: 1 1.25 nan")
    assert "a voxel size of 1 x 1.25 x nan mm" in reason(nothing)

    meta = replaced(saved(tmp_path, ".mha"), "ElementSpacing = .*\n", "")
    assert sitk.ReadImage(str(meta)).GetSpacing() == (1.0, 1.0, 1.0)
    assert "states no voxel size" in reason(meta)
    meta = replaced(saved(tmp_path, ".mha"), "ElementSpacing = 1 ", "ElementSpacing = 0 ")
    assert "a voxel size of 0 x 1.25 x 2.5 mm" in reason(meta)

    nifti = patched(saved(tmp_path, ".nii"), (80, "<f", 0.0), (84, "<f", 0.0), (88, "<f", 0.0))
    assert sitk.ReadImage(str(nifti)).GetSpacing() == (1.0, 1.0, 1.0)
    assert "states no voxel size (its pixdim is 0)" in reason(nifti)


def test_nifti_without_orientation_or_with_two_voxel_sizes_is_refused(tmp_path: Path) -> None:
    path = patched(saved(tmp_path, ".nii"), (252, "<h", 0), (254, "<h", 0))
    assert "left and right cannot be told apart" in reason(path)
    path = patched(saved(tmp_path, ".nii"), (80, "<f", 0.5))
    assert "two voxel sizes that do not agree: 0.5 x 1.25 x 2.5 mm (pixdim) and 1 x 1.25 x 2.5 mm" in reason(path)


# ---- other bad files -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".nrrd", ".nii", ".nii.gz", ".mha"])
@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("kept", [0.02, 0.5, 0.97])
def test_a_file_that_is_cut_off_is_refused(tmp_path: Path, suffix: str, compressed: bool, kept: float) -> None:
    path = saved(tmp_path, suffix, compressed)
    data = path.read_bytes()
    path.write_bytes(data[: int(kept * len(data))])
    text = reason(path)
    assert "cannot be read" in text or "states no voxel size" in text
    assert "0x" not in text and "itk" not in text


def test_a_damaged_gz_file_is_refused(tmp_path: Path) -> None:
    path = saved(tmp_path, ".nii.gz")
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 255
    path.write_bytes(data)
    assert "damaged" in reason(path)
    path.write_bytes(gzip.compress(b"no image"))
    assert "not a NIfTI file" in reason(path)


@pytest.mark.parametrize("suffix", [".nrrd", ".nii", ".nii.gz", ".mha", ".mhd", ".nhdr"])
def test_a_file_of_another_kind_is_refused(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"text{suffix}"
    path.write_text("label,x_mm,y_mm,z_mm\n" * 50)
    assert "it is not" in reason(path)
    path.write_bytes(b"")
    assert "is empty" in reason(path)
    path.unlink()
    assert "does not exist" in reason(path)
    path.mkdir()
    assert "is a folder" in reason(path)


def test_unknown_extensions_and_missing_voxels_are_named(tmp_path: Path) -> None:
    (tmp_path / "scan.dcm").write_bytes(b"x")
    assert "expected a file of an image: .nrrd" in reason(tmp_path / "scan.dcm")
    for suffix, voxels in ((".mhd", "image.raw"), (".nhdr", "image.raw")):
        path = saved(tmp_path, suffix)
        (tmp_path / voxels).unlink()
        assert "cannot be read" in reason(path)


def test_what_is_no_3d_image_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "image.nrrd"
    sitk.WriteImage(sitk.Image([30, 30, 30], sitk.sitkVectorUInt8, 3), str(path))
    assert "has 3 values a voxel" in reason(path)
    sitk.WriteImage(sitk.Image([30, 30, 30, 4], sitk.sitkUInt8), str(path))
    assert "has 4 dimensions (30 x 30 x 30 x 4 voxels)" in reason(path)
    sitk.WriteImage(sitk.Image([30, 30], sitk.sitkUInt8), str(path))
    assert "is a single slice (30 x 30 voxels)" in reason(path)
    sitk.WriteImage(sitk.Image([30, 30, 1], sitk.sitkUInt8), str(path))
    assert "is a single slice" in reason(path)
    sitk.WriteImage(sitk.Image([30, 30, 30], sitk.sitkComplexFloat32), str(tmp_path / "image.mha"))
    assert "2 values a voxel" in reason(tmp_path / "image.mha")


def test_axes_not_at_right_angles_are_refused(tmp_path: Path) -> None:
    path = replaced(saved(tmp_path, ".nrrd"), r"\(0,1.25,0\)", "(0.5,1.25,0)")
    assert "right angles" in reason(path)
    path = replaced(saved(tmp_path, ".mha"), "TransformMatrix = 1 0 0", "TransformMatrix = 1 0.3 0")
    assert "right angles" in reason(path)
    # A shear that keeps the lengths of the axes.
    path = patched(
        saved(tmp_path, ".nii"), (252, "<h", 0), (284, "<f", -1.25 * np.sin(0.2)), (300, "<f", -1.25 * np.cos(0.2))
    )
    assert "right angles" in reason(path)


@pytest.mark.parametrize("spacing", [(1e-3, 1e-3, 1e-3), (1e3, 1e3, 1e3), (1.0, 1.0, 30.0)])
def test_an_implausible_size_is_refused(tmp_path: Path, spacing: tuple[float, float, float]) -> None:
    image = sitk.Image([64, 64, 32], sitk.sitkUInt8)
    image.SetSpacing(spacing)
    sitk.WriteImage(image, str(tmp_path / "image.nrrd"))
    assert "metres or micrometres" in reason(tmp_path / "image.nrrd")


def test_nothing_is_left_half_written(tmp_path: Path) -> None:
    path = tmp_path / "old.nii.gz"
    path.write_text("old")
    values = sample().values
    half = Volume(values.astype(np.float16), np.ones(3), np.zeros(3), np.eye(3))
    with pytest.raises(InputFileError, match="type float16"):
        write_volume(half, path)
    with pytest.raises(InputFileError, match="extension"):
        write_volume(sample(), tmp_path / "image.mhd")
    with pytest.raises(InputFileError, match="does not exist"):
        write_volume(sample(), tmp_path / "nowhere" / "image.nrrd")
    assert path.read_text() == "old" and [file.name for file in tmp_path.iterdir()] == [path.name]


def test_real_volumes(data_dir: Path) -> None:
    folder = data_dir / "stacom2018"
    mask, image = (read_volume(folder / f"MJHV7_{kind}.nrrd") for kind in ("laendo", "lgemri_norm"))
    assert np.allclose(mask.spacing, [0.625, 0.625, 1.25]) and mask.values.shape == image.values.shape
    assert np.unique(mask.values).tolist() == [0, 1] and np.allclose(mask.origin, image.origin)
