"""HDF5 and C3D files that were changed at random: their bytes, and what they hold; see `hostile`."""

from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np

TYPES = ("f4", "f8", "i1", "i8", "u8", "S7", "c16", "?", h5py.string_dtype(), h5py.vlen_dtype("f8"), h5py.ref_dtype,
         [("x", "f4"), ("y", "S3")])  # fmt: skip
SHAPES = ((), (0,), (1,), (3,), (0, 3), (4, 0), (2, 3, 4), (7, 1), (1, 2, 1, 2))
VALUES = (np.nan, np.inf, -np.inf, 1e300, -1e18, 1e-320, 0.0, -1.0)
LARGE = 1_000_000
"""Numbers of a data set that an earlier change made, which the next one does not read."""

WORDS = (
    "", "x", "{", "[" * 5000, "9" * 5000, '{"a": 1}', "null", "NaN", "1e400", "\x00", "é\u2028", "x" * 100_000,
    b"\xff\xfe", -1, 0, 2**63, float("nan"), 1e300, [], [1.0, 2.0], ["a", "b"], True, h5py.Empty("f8"),
    np.zeros((2, 3)),
)  # fmt: skip


def flipped(content, rng):
    """Flip bits, overwrite a few bytes, or cut: the file keeps its form longer than under changes of all kinds."""
    data = bytearray(content)
    for _ in range(int(rng.integers(1, 9))):
        at = int(rng.integers(0, len(data)))
        at = min(at, int(rng.integers(0, len(data))), int(rng.integers(0, len(data)))) if rng.random() < 0.5 else at
        match int(rng.integers(0, 5)):
            case 0 | 1:
                data[at] ^= 1 << int(rng.integers(0, 8))
            case 2:
                data[at] = (0, 255, 1, 127, 128)[int(rng.integers(0, 5))]
            case 3:
                span = min(len(data) - at, (2, 4, 8)[int(rng.integers(0, 3))])
                data[at : at + span] = (bytes(span), b"\xff" * span, rng.bytes(span))[int(rng.integers(0, 3))]
            case _:
                if rng.random() < 0.15 and at:
                    del data[at:]
    return bytes(data)


def changed_hdf5(path, rng):
    """Change what a sound HDF5 file holds, in one to three places, by the library that wrote it."""
    with h5py.File(path, "r+") as file:
        for _ in range(int(rng.integers(1, 4))):
            names = [""]
            file.visit(names.append)
            name = names[int(rng.integers(0, len(names)))]
            with suppress(AttributeError, ValueError, TypeError, KeyError, OSError, RuntimeError):  # is refused
                _change(file, name, path.parent, rng)


def _change(file, name, folder, rng):
    found = file[name] if name else file
    ways = ("attribute", "attribute", "drop attribute") if not name or rng.random() < 0.2 else (
        "remove", "shape", "type", "value", "value", "word", "group", "link", "external link", "external storage",
        "virtual", "not stored", "rename", "copy", "circle", "packed", "rows")  # fmt: skip
    way = ways[int(rng.integers(0, len(ways)))]
    if way == "attribute":
        key = [*found.attrs, "format", "x"][int(rng.integers(0, len(found.attrs) + 2))]
        found.attrs[key] = WORDS[int(rng.integers(0, len(WORDS)))]
    elif way == "drop attribute":
        for key in [*found.attrs][:1]:
            del found.attrs[key]
    else:
        small = isinstance(found, h5py.Dataset) and found.size is not None and found.size < LARGE
        data = np.asarray(found[()] if small else np.ones(3))
        if way == "rename":
            file.move(name, f"{name}{WORDS[1]}")
            return
        if way == "copy":
            file.copy(name, f"{name}_more")
            return
        del file[name]
        _REPLACED[way](file, name, data, folder, rng)


def _link(file, name, data, folder, rng):
    file[name] = h5py.SoftLink(("/", f"/{name}", "/nowhere", "/" + "a/" * 300)[int(rng.integers(0, 4))])


def _external_storage(file, name, data, folder, rng):
    np.zeros(1000).tofile(folder / "secret")
    file.create_dataset(name, (3,), "f8", external=[(str(folder / "secret"), 0, 24)])


def _virtual(file, name, data, folder, rng):
    layout = h5py.VirtualLayout((3,), "f8")
    layout[...] = h5py.VirtualSource("secret.h5", "x", (3,))
    file.create_virtual_dataset(name, layout)


def _typed(file, name, data, folder, rng):
    kind = TYPES[int(rng.integers(0, len(TYPES)))]
    try:
        file.create_dataset(name, data=data.astype(kind))
    except (TypeError, ValueError, OSError):
        file.create_dataset(name, data.shape, kind)


def _valued(file, name, data, folder, rng):
    if data.dtype.kind == "f" and data.size:
        data = data.copy()
        data.flat[int(rng.integers(0, data.size))] = VALUES[int(rng.integers(0, len(VALUES)))]
    elif data.dtype.kind in "iu":
        data = data * 0 + (-1, 2**31, 7)[int(rng.integers(0, 3))]
    file[name] = data


def _rows(file, name, data, folder, rng):
    file[name] = np.repeat(data, 2, axis=0) if rng.random() < 0.5 and data.ndim else data[: len(data) // 2]


def _huge(file, name, data, folder, rng):
    shape = ((10**9, 3), (10**7,), (2**40,), (49_999_999,), (10**6, 0))[int(rng.integers(0, 5))]
    file.create_dataset(name, shape, "f8", chunks=True)


def _packed(file, name, data, folder, rng):
    more = {"compression": "gzip", "shuffle": True, "fletcher32": True}
    file.create_dataset(name, data=np.full((300, 3), float(rng.integers(0, 2))), chunks=(7, 2), **more)


_REPLACED = {
    "remove": lambda *_: None,
    "shape": lambda file, name, data, folder, rng: file.create_dataset(
        name, data=np.ones(SHAPES[int(rng.integers(0, len(SHAPES)))], data.dtype if data.dtype.kind in "fiu" else "f8")
    ),
    "type": _typed, "value": _valued, "rows": _rows, "packed": _packed, "link": _link, "not stored": _huge,
    "word": lambda file, name, data, folder, rng: file.create_dataset(name, data=WORDS[rng.integers(0, len(WORDS))]),
    "group": lambda file, name, *_: file.create_group(name),
    "circle": lambda file, name, *_: file.__setitem__(name, file["/"]),
    "external link": lambda file, name, data, folder, rng: file.__setitem__(
        name, h5py.ExternalLink(str(Path(folder, "secret.h5")), "/x")
    ),
    "external storage": _external_storage, "virtual": _virtual,
}  # fmt: skip


def changed_c3d(content, rng):
    """Change words of a C3D file's header and of its parameters, which say how much of everything follows."""
    data = bytearray(content)
    for _ in range(int(rng.integers(1, 6))):
        at = 2 * int(rng.integers(0, 10)) if rng.random() < 0.4 else int(rng.integers(0, min(len(data), 3000)))
        word = (0, 1, -1, 32767, -32768, 255, 2, int(rng.integers(-32768, 32768)))[int(rng.integers(0, 8))]
        data[at : at + 2] = int(word).to_bytes(2, "little", signed=True)
    return bytes(data)
