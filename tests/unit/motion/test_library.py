"""The motion library: reading back, interrupted writing, and invalid files."""

import h5py
import numpy as np
import pytest

from workbench.body.shape import from_height
from workbench.motion.library import read_library, write_library
from workbench.motion.pose_sequence import Motion
from workbench.utils.errors import InputError


def motion(name, n=5, seed=0):
    rng = np.random.default_rng(seed)
    return Motion(
        name=name,
        subject="ä/b",
        activity="jump, balance",
        rate_hz=29.97,
        poses=rng.normal(size=(n, 25)),
        shape=from_height(1.6 + 0.1 * seed),
        joint_error_mm=rng.uniform(size=14),
        source="35/35_02.amc",
        sha256="0" * 64,
        licence="CC BY-NC 4.0",
    )


@pytest.fixture
def library(tmp_path):
    path = tmp_path / "motions.h5"
    write_library(path, [motion("one"), motion("two", 7, seed=1), motion("one", 2, seed=2)])
    return path


def test_motions_are_read_back_exactly(library):
    written = [motion("one"), motion("two", 7, seed=1), motion("one", 2, seed=2)]
    for read, expected in zip(read_library(library), written, strict=True):
        for name in ("name", "subject", "activity", "rate_hz", "shape", "source", "sha256", "licence"):
            assert getattr(read, name) == getattr(expected, name)
        np.testing.assert_array_equal(read.poses, expected.poses)
        np.testing.assert_array_equal(read.joint_error_mm, expected.joint_error_mm)


def test_a_failed_write_leaves_the_library_unchanged(library, trusted):
    before = library.read_bytes()
    broken = motion("broken")
    broken = Motion(**{**vars(broken), "licence": "a\0b"})  # HDF5 rejects strings with a null
    with pytest.raises(ValueError, match="NULL"):
        write_library(library, [motion("new"), broken])
    assert library.read_bytes() == before
    assert list(library.parent.iterdir()) == [library]
    write_library(library, [motion("new")])
    assert [read.name for read in read_library(library)] == ["new"]
    assert list(library.parent.iterdir()) == [library]


def test_too_few_motions_or_frames_and_wrong_paths_are_rejected(tmp_path):
    with pytest.raises(InputError, match=r"at least one motion"):
        write_library(tmp_path / "none.h5", [])
    with pytest.raises(InputError, match=r"at least two frames, found 'short'"):
        write_library(tmp_path / "short.h5", [motion("one"), motion("short", 1)])
    with pytest.raises(InputError, match=r"cannot be written"):
        write_library(tmp_path / "no folder" / "x.h5", [motion("one")])
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError, match=r"folder: cannot be written"):
        write_library(tmp_path / "folder", [motion("one")])
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]


def change(file, location, value=None):
    """Replace a dataset or an attribute ("group@attribute"), or delete it."""
    group, _, attribute = location.partition("@")
    holder = file[group or "/"].attrs if attribute else file
    del holder[attribute or group]
    if value is not None:
        holder[attribute or group] = value


INVALID = {  # name: (location, new value, message)
    "another format": ("@format", "walking model", "found 'walking model'"),
    "a later version": ("@format_version", 2, "of version 1"),
    "zero rate": ("motions/000001@rate_hz", 0.0, "a positive rate_hz"),
    "poses of 24": ("motions/000001/poses", np.zeros((7, 24)), "poses must be F × 25 float64, found (7, 24)"),
    "a NaN pose": ("motions/000001/poses", np.full((7, 25), np.nan), "poses has numbers"),
    "a flat neck": ("motions/000001/shape@neck", [0.0, 0.5], "length 'neck'"),
}  # fmt: skip


@pytest.mark.parametrize(("location", "value", "message"), INVALID.values(), ids=INVALID)
def test_invalid_content_is_rejected(library, location, value, message, trusted):
    with h5py.File(library, "r+") as file:
        change(file, location, value)
    with pytest.raises(InputError) as error:
        read_library(library)
    assert str(error.value).startswith(f"{library}: ")
    assert message in str(error.value)


def test_other_files_are_rejected(library, tmp_path, trusted):
    with pytest.raises(InputError, match=r"none\.h5: no such motion library"):
        read_library(tmp_path / "none.h5")
    with pytest.raises(InputError, match=r"no such motion library"):
        read_library(tmp_path)
    for name, content in (("text.h5", b"not HDF5"), ("empty.h5", b""), ("cut.h5", library.read_bytes()[:-2000])):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=rf"{name}: expected a whole motion library"):
            read_library(tmp_path / name)
