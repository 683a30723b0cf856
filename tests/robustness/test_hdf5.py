"""HDF5 files of users, motion libraries and points, are read in the sandbox, and no other file is read."""

import h5py
import numpy as np
import pytest
from damage import changes, flips, refusal, withstands
from valid_files import library, points, written

from workbench.datasets.point_formats import read_hdf5
from workbench.motion import hdf5
from workbench.motion.library import read_library
from workbench.utils.input_limits import DEEPEST, MAX_NUMBERS


def read_points(path):
    return list(read_hdf5(path))


def read_any(path):
    return hdf5.read_hdf5(path, "numbers", own=True)


KINDS = {"library": (library, "motions/000000/poses", read_library), "points": (points, "frames/1", read_points)}


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_random_damage_is_refused_or_read(kind, tmp_path):
    write, _, read = KINDS[kind]
    withstands(read, write(tmp_path / "a.h5"), 20, changes | flips)


@pytest.mark.parametrize("kind", KINDS)
def test_replaced_data_sets_and_attributes_are_refused_or_read(kind, tmp_path, trusted):
    """Each data set and attribute is removed or replaced by one of another type or shape."""
    write, _, read = KINDS[kind]
    sound = write(tmp_path / "sound.h5").read_bytes()
    with h5py.File(tmp_path / "sound.h5") as file:
        names = []
        file.visit(names.append)
    values = (None, "x", "[" * 5000, "9" * 5000, b"\xff", -1, np.nan, [], ["a"], np.zeros((2, 3)), h5py.Empty("f8"),
              np.zeros(2, [("x", "f4")]), np.ones((3, 3)) * 1j)  # fmt: skip
    for location in (*names, "@format", f"{names[1]}@name"):
        for value in values:
            with h5py.File(written(tmp_path / "a.h5", sound), "r+") as file:
                name, _, attribute = location.partition("@")
                holder, key = (file[name or "/"].attrs, attribute) if attribute else (file, name)
                if key in holder:
                    del holder[key]
                if value is not None:
                    holder[key] = value
            refusal(read, tmp_path / "a.h5")


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
    layout = h5py.VirtualLayout(file[name].shape, file[name].dtype)
    layout[...] = h5py.VirtualSource(str(path), "x", file[name].shape)
    del file[name]
    file.create_virtual_dataset(name, layout)


def soft_link(file, name, path):
    file["elsewhere"] = file[name][()]
    del file[name]
    file[name] = h5py.SoftLink("/elsewhere")


def unallocated(file, name, path):
    del file[name]
    file.create_dataset(name, (10_000_000, 3), "f8", chunks=(1000, 3))


@pytest.mark.parametrize("change", [external_storage, external_link, virtual, soft_link, unallocated])
@pytest.mark.parametrize("kind", KINDS)
def test_numbers_outside_the_file_are_refused(kind, change, tmp_path, trusted):
    write, name, read = KINDS[kind]
    with h5py.File(write(tmp_path / "a.h5"), "r+") as file:
        change(file, name, tmp_path / "secret")
    assert f"a.h5: /{name}: expected" in refusal(read, tmp_path / "a.h5")


@pytest.mark.parametrize("kind", KINDS)
def test_only_the_sandbox_opens_a_user_s_file(kind, tmp_path, monkeypatch):
    write, _, read = KINDS[kind]
    path = write(tmp_path / "a.h5")
    monkeypatch.setattr("workbench.motion.hdf5.h5py", None)
    assert read(path)


@pytest.mark.parametrize("count", [MAX_NUMBERS + 1, 10**9, 10**18])
def test_more_numbers_than_fit_into_memory_are_refused(count, tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("x", (count,), "f8", chunks=(1000,))
    assert "a.h5: /x: expected at most" in refusal(read_any, tmp_path / "a.h5")


def test_a_high_compression_ratio_is_refused(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for k in range(3):
            file.create_dataset(f"x{k}", data=np.zeros(5_000_000), chunks=(1_000_000,), compression="gzip")
    assert "bytes of numbers in a file of this size" in refusal(read_any, tmp_path / "a.h5")


@pytest.mark.parametrize("cyclic", [False, True])
def test_endlessly_nested_groups_are_refused(cyclic, tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["a" if cyclic else "/a" * (2 * DEEPEST)] = file["/"] if cyclic else np.ones(3)
    assert f"at most {DEEPEST} nested groups" in refusal(read_any, tmp_path / "a.h5")


@pytest.mark.slow
def test_a_file_with_which_the_hdf5_library_loops_is_refused(tmp_path):
    """An object in the global heap has size zero, and HDF5 searches its end forever."""
    content = bytearray(library(tmp_path / "a.h5").read_bytes())
    at = content.index(b"GCOL")
    content[at + 16 : at + 4096] = b"\x01\x00\x01\x00" + bytes(4) + b"\xf0" + b"\xff" * 7 + bytes(4080 - 16)
    message = refusal(read_library, written(tmp_path / "a.h5", bytes(content)))
    assert "a.h5: expected a whole motion library" in message


@pytest.mark.parametrize("own", [False, True])
def test_numbers_and_texts_are_read_as_stored(own, tmp_path):
    rng = np.random.default_rng(0)
    types = ("float64", "float32", "int64", ">f8", "bool", "u1", "f2")
    stored = [(100.0 * rng.random(shape)).astype(t) for t in types for shape in [(), (0, 3), (5,), (4, 2, 3)]]
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for k, values in enumerate(stored):
            file[f"g/{k}"] = values
        file["text"], file["texts"] = "ä", ["a", "b"]
        file["g"].attrs.update(rate=np.float64(0.1), n=3, word="é\n", words=["a", "b"], none=h5py.Empty("f8"))
    arrays, attributes = hdf5.read_hdf5(tmp_path / "a.h5", "numbers", own)
    for k, values in enumerate(stored):
        assert (arrays[f"/g/{k}"].dtype, arrays[f"/g/{k}"].shape) == (values.dtype, values.shape)
        np.testing.assert_array_equal(arrays[f"/g/{k}"], values)
    assert (str(arrays["/text"]), str(arrays["/texts"])) == ("ä", hdf5.OTHER)
    assert attributes == {"/": {}, "/g": {"rate": 0.1, "n": 3, "word": "é\n", "words": ["a", "b"], "none": None}}
    assert isinstance(attributes["/g"]["rate"], float)
