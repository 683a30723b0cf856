"""HDF5 that leads outside itself, stands for more than it holds, or does not end, is refused before it is read."""

import sys

import h5py
import numpy as np
import pytest
from hostile import a_library, a_model, some_points

from workbench import hdf5
from workbench.datasets.files.point_formats import read_hdf5
from workbench.errors import InputError
from workbench.hdf5 import opened
from workbench.learning.linear_motion import LinearMotion
from workbench.learning.store import load
from workbench.limits import MOST_NUMBERS
from workbench.mocap.library import read_library

KINDS = ("float64", "float32", "int64", ">f8", "bool", "u1", "f2")
"""Of numbers that are handed over."""

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


def everything(path, own):
    """All that a file holds, flat: texts, numbers with their types, and attributes."""
    found = {}
    with opened(path, "x", own) as file:
        pending = [("", file)]
        while pending:
            name, group = pending.pop()
            found[f"{name}/"] = dict(group.attributes)
            for key, each in group.items():
                if isinstance(each, hdf5.Group):
                    pending.append((f"{name}/{key}", each))
                else:
                    found[f"{name}/{key}"] = each.text() if each.kind == "a text" else each.numbers()
    return found


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("own", [False, True])
def test_numbers_come_as_they_are_stored(own, kind, tmp_path):
    rng = np.random.default_rng(0)
    stored = {
        f"g/{k}": (100.0 * rng.random(shape)).astype(kind) for k, shape in enumerate([(), (0, 3), (5,), (4, 2, 3)])
    }
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, values in stored.items():
            file[name] = values
        file["g"].attrs.update(
            rate=np.float64(0.1), values=np.arange(3).astype(kind), word="é\n", none=h5py.Empty("f8")
        )
    found = everything(tmp_path / "a.h5", own)
    for name, values in stored.items():
        read = found[f"/{name}"]
        assert (read.dtype, read.shape) == (values.dtype, values.shape)
        np.testing.assert_array_equal(read, values)
    attributes = found["/g/"]
    assert (attributes["rate"], attributes["word"], attributes["none"]) == (0.1, "é\n", None)
    assert isinstance(attributes["rate"], float)
    assert attributes["values"].dtype == np.dtype(kind)


@pytest.mark.parametrize("own", [False, True])
def test_what_is_neither_numbers_nor_a_text_is_refused_when_it_is_read(own, tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["text"], file["texts"], file["pairs"] = "ä", ["a", "b"], np.zeros(2, [("x", "f4"), ("y", "S3")])
        file["complex"], file["type"] = np.ones(2) * 1j, np.dtype("f8")
    with opened(tmp_path / "a.h5", "x", own) as file:
        assert file["text"].text() == "ä"
        for name in ("texts", "pairs", "complex", "type"):
            with pytest.raises(InputError, match=rf"a\.h5: /{name}: expected a text, found other values"):
                file[name].text()
        for name in ("text", "texts", "pairs", "complex", "type"):
            with pytest.raises(InputError, match=rf"a\.h5: /{name}: expected numbers, found"):
                file[name].numbers()


@pytest.mark.parametrize("kind", READERS)
def test_this_process_opens_no_file_of_a_stranger(kind, tmp_path, monkeypatch):
    """A damaged one may harm the memory of whoever opens it."""
    write, _, read = READERS[kind]
    write(tmp_path / "a.h5")
    monkeypatch.setattr("workbench.hdf5.h5py", None)
    assert read(tmp_path / "a.h5")


def test_frames_are_taken_over_one_by_one(tmp_path):
    """The damage of a later frame is told when that is reached, and nobody waits for what is left."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for k in range(3):
            file.create_dataset(
                f"frames/{k}", data=np.ones((1000, 3)), chunks=(10, 3), compression="gzip", fletcher32=True
            )
        address = file["frames/2"].id.get_chunk_info(0).byte_offset
    content = bytearray((tmp_path / "a.h5").read_bytes())
    content[address] ^= 255
    (tmp_path / "a.h5").write_bytes(content)
    frames = read_hdf5(tmp_path / "a.h5")
    assert [next(frames).shape, next(frames).shape] == [(1000, 3)] * 2
    with pytest.raises(InputError, match=r"a\.h5: expected a whole file of points \(HDF5\): "):
        next(frames)
    frames = read_hdf5(tmp_path / "a.h5")
    next(frames)
    frames.close()


ENDS = {
    "os.abort()": "found damage that ends whoever reads it",
    "sys.exit(1)": ": nothing",
    "sys.exit('a sentence')": ": a sentence",
    "os.write(1, b'12')": ": nothing",
    "os.write(1, bytes(6) + b'12' + bytes(9))": "at most 100000000 bytes of an answer",
    "os.write(1, bytes([5]) + bytes(7) + b'[[[{{')": "expected JSON",
    "os.write(1, bytes([5]) + bytes(7) + b'[[1]]')": "expected x",
}
"""What another process may do, and what is said of the file."""


@pytest.mark.parametrize("does", ENDS)
def test_whatever_the_other_process_does_is_a_sentence(does, tmp_path, monkeypatch):
    some_points(tmp_path / "a.h5")
    command = [sys.executable, "-c", f"import os, sys; sys.stdin.readline(); {does}"]
    monkeypatch.setattr("workbench.apart._command", lambda *_: command)
    with pytest.raises(InputError, match=rf"a\.h5: .*{ENDS[does]}"), opened(tmp_path / "a.h5", "x"):
        pass


@pytest.mark.parametrize("change", [external_storage, external_link, virtual, soft_link, not_stored])
@pytest.mark.parametrize("kind", READERS)
def test_numbers_that_do_not_lie_in_the_file_are_refused(kind, change, tmp_path, monkeypatch):
    write, name, read = READERS[kind]
    monkeypatch.setattr("workbench.hdf5._read_apart", hdf5._read_here)  # what is refused here, is there as well
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
    with opened(tmp_path / "a.h5", "x") as file:
        assert file["a"]["b"].shape == (3,)
        assert file["a"]["again"]["a"] is file["a"]
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
