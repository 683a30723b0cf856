"""HDF5 that leads outside itself, stands for more than it holds, or does not end, is refused before it is read."""

import h5py
import numpy as np
import pytest
from hostile import a_library, a_model, some_points

from workbench.datasets.files.point_formats import read_hdf5
from workbench.errors import InputError
from workbench.hdf5 import opened
from workbench.learning.linear_motion import LinearMotion
from workbench.learning.store import load
from workbench.limits import MOST_NUMBERS
from workbench.mocap.library import read_library

READERS = {
    "library": (a_library, "motions/000000/poses", read_library),
    "points": (some_points, "frames/1", lambda path: list(read_hdf5(path))),
    "model": (a_model, "gain", lambda path: load(LinearMotion, path)),
}


def external_storage(file, name, path):
    data = file[name][()]
    data.tofile(path)
    del file[name]
    file.create_dataset(name, data.shape, data.dtype, external=[(str(path), 0, data.nbytes)])


def external_link(file, name, path):
    with h5py.File(path, "w") as other:
        other["x"] = file[name][()]
    del file[name]
    file[name] = h5py.ExternalLink(str(path), "/x")


def virtual(file, name, path):
    with h5py.File(path, "w") as other:
        other["x"] = file[name][()]
    shape, kind = file[name].shape, file[name].dtype
    del file[name]
    layout = h5py.VirtualLayout(shape, kind)
    layout[...] = h5py.VirtualSource(str(path), "x", shape)
    file.create_virtual_dataset(name, layout)


def soft_link(file, name, path):
    file["elsewhere"] = file[name][()]
    del file[name]
    file[name] = h5py.SoftLink("/elsewhere")


def not_stored(file, name, path):
    kind = file[name].dtype
    del file[name]
    file.create_dataset(name, (10_000_000, 3), kind, chunks=(1000, 3))


@pytest.mark.parametrize("change", [external_storage, external_link, virtual, soft_link, not_stored])
@pytest.mark.parametrize("kind", READERS)
def test_numbers_that_do_not_lie_in_the_file_are_refused(kind, change, tmp_path, monkeypatch):
    write, name, read = READERS[kind]
    monkeypatch.setattr("workbench.hdf5.read_apart", lambda *_: b"")  # what is refused here, is there as well
    write(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        change(file, name, tmp_path / "secret")
    with pytest.raises(InputError, match=rf"a\.h5: /{name.rpartition('/')[0]}"):
        read(tmp_path / "a.h5")


@pytest.mark.parametrize("count", [MOST_NUMBERS + 1, 10**9, 10**18])
def test_more_numbers_than_any_file_has_are_refused_at_once(count, tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("x", (count,), "f8", chunks=(1000,))
    with pytest.raises(InputError, match=r"a\.h5: /x: expected at most"), opened(tmp_path / "a.h5", "x", own=True):
        pass


def test_numbers_packed_a_thousandfold_are_refused(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for k in range(3):
            file.create_dataset(f"x{k}", data=np.zeros(5_000_000), chunks=(1_000_000,), compression="gzip")
    with (
        pytest.raises(InputError, match="bytes of numbers in a file of this size"),
        opened(tmp_path / "a.h5", "x", True),
    ):
        pass


def test_groups_in_one_another_and_in_circles(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["a/b"] = np.ones(3)
        file["a/again"] = file["/"]
    with opened(tmp_path / "a.h5", "x", own=True) as file:
        assert file["a/b"].shape == (3,)
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["/a" * 100 + "/b"] = np.ones(3)
    with pytest.raises(InputError, match="groups in one another"), opened(tmp_path / "b.h5", "x", own=True):
        pass


@pytest.mark.slow
def test_a_file_that_is_read_for_ever_is_refused(tmp_path):
    """Its heap of texts says that an object in it has no size: HDF5 looks for its end for ever."""
    a_library(tmp_path / "a.h5")
    content = bytearray((tmp_path / "a.h5").read_bytes())
    at = content.index(b"GCOL")
    content[at + 16 : at + 4096] = b"\x01\x00\x01\x00" + bytes(4) + b"\xf0" + b"\xff" * 7 + bytes(4080 - 16)
    (tmp_path / "a.h5").write_bytes(content)
    with pytest.raises(InputError, match=r"a\.h5: expected a whole motion library"):
        read_library(tmp_path / "a.h5")
