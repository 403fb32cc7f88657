"""Images and label maps from and to files."""

from __future__ import annotations

import struct

import numpy as np
import pytest
import SimpleITK as sitk

from LAFlatteningLib.errors import InputFileError
from LAFlatteningLib.files import read_volume, write_volume
from LAFlatteningLib.volume import Volume

TURN = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, -1]])  # left-handed


def some_volume(dtype=np.int16) -> Volume:
    values = np.random.default_rng(0).integers(0, 100, (12, 14, 16)).astype(dtype)
    return Volume(values, np.array([2.0, 3.0, 4.0]), np.array([5.0, -6.0, 7.0]), TURN)


@pytest.mark.parametrize("suffix", [".nrrd", ".nii", ".nii.gz", ".mha", ".NRRD"])
@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.float32])
def test_round_trip(tmp_path, suffix, dtype):
    volume = some_volume(dtype)
    write_volume(volume, tmp_path / f"v{suffix}")
    again = read_volume(tmp_path / f"v{suffix}")
    np.testing.assert_array_equal(again.values, volume.values)
    np.testing.assert_allclose(again.direction, volume.direction, atol=1e-6)
    np.testing.assert_allclose(again.spacing, volume.spacing, rtol=1e-6)
    np.testing.assert_allclose(again.origin, volume.origin, atol=1e-5)
    assert [path.name for path in tmp_path.iterdir()] == [f"v{suffix}"]


def test_missing_empty_and_unknown_files_are_refused(tmp_path):
    (tmp_path / "empty.nrrd").touch()
    for name, words in [("none.nrrd", "does not exist"), ("empty.nrrd", "is empty")]:
        with pytest.raises(InputFileError, match=words):
            read_volume(tmp_path / name)
    with pytest.raises(InputFileError, match="extension"):
        write_volume(some_volume(), tmp_path / "v.png")


@pytest.mark.parametrize("suffix", [".nrrd", ".nii", ".nii.gz", ".mha"])
def test_cut_off_and_foreign_files_are_refused(tmp_path, suffix):
    whole = tmp_path / f"whole{suffix}"
    write_volume(some_volume(), whole)
    data = whole.read_bytes()
    for share in (0.3, 0.7):
        (tmp_path / f"part{suffix}").write_bytes(data[: int(share * len(data))])
        with pytest.raises(InputFileError, match="cannot be read"):
            read_volume(tmp_path / f"part{suffix}")
    (tmp_path / f"text{suffix}").write_text("this is no image\n" * 100)
    with pytest.raises(InputFileError, match="cannot be read"):
        read_volume(tmp_path / f"text{suffix}")


def test_files_without_spacing_are_refused(tmp_path):
    data = np.zeros(30**3, np.uint8).tobytes()
    nrrd = b"NRRD0004\ntype: unsigned char\ndimension: 3\nsizes: 30 30 30\nencoding: raw\n"
    (tmp_path / "bare.nrrd").write_bytes(nrrd + b"\n" + data)
    (tmp_path / "nan.nrrd").write_bytes(nrrd + b"spacings: 1 1 nan\n\n" + data)
    meta = b"ObjectType = Image\nNDims = 3\nDimSize = 30 30 30\nElementType = MET_UCHAR\n"
    (tmp_path / "bare.mha").write_bytes(meta + b"ElementDataFile = LOCAL\n" + data)
    write_volume(some_volume(), tmp_path / "zero.nii")
    head = bytearray((tmp_path / "zero.nii").read_bytes())
    struct.pack_into("<f", head, 80 + 4, 0.0)
    (tmp_path / "zero.nii").write_bytes(head)
    for name in ("bare.nrrd", "nan.nrrd", "bare.mha", "zero.nii"):
        with pytest.raises(InputFileError, match="no voxel spacing"):
            read_volume(tmp_path / name)
    (tmp_path / "good.nrrd").write_bytes(nrrd + b"spacings: 1 1 2\n\n" + data)
    (tmp_path / "good.mha").write_bytes(meta + b"ElementSpacing = 1 1 2\nElementDataFile = LOCAL\n" + data)
    for name in ("good.nrrd", "good.mha"):
        assert read_volume(tmp_path / name).spacing.tolist() == [1, 1, 2]


def test_images_that_are_not_3d_scalars_are_refused(tmp_path):
    for name, image in [
        ("flat", sitk.Image([40, 40], sitk.sitkUInt8)),
        ("vector", sitk.Image([30, 30, 30], sitk.sitkVectorUInt8, 3)),
        ("times", sitk.Image([30, 30, 30, 2], sitk.sitkUInt8)),
    ]:
        sitk.WriteImage(image, str(tmp_path / f"{name}.nrrd"))
        with pytest.raises(InputFileError):
            read_volume(tmp_path / f"{name}.nrrd")
    sitk.WriteImage(sitk.Image([30, 31, 32, 1], sitk.sitkUInt8), str(tmp_path / "once.nii"))
    assert read_volume(tmp_path / "once.nii").values.shape == (32, 31, 30)


def test_metres_in_place_of_mm_are_refused(tmp_path):
    volume = some_volume()
    write_volume(Volume(volume.values, volume.spacing / 1000, volume.origin, volume.direction), tmp_path / "m.nrrd")
    with pytest.raises(InputFileError, match="not in mm"):
        read_volume(tmp_path / "m.nrrd")
