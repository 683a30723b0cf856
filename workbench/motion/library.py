"""The motion library: many motions in one HDF5 file.

/motions/<number> contains the datasets poses (F, 25), velocities (F, 25) and joint_error_mm (14,), the attributes name,
subject, activity, rate_hz, source, sha256 and licence, and the group shape with the person's measurements. The root has
the attributes format, format_version, workbench_version, pose_names and error_joints.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from workbench import __version__
from workbench.body.shape import read_shape
from workbench.body.skeleton import ERROR_JOINTS, POSE_NAMES
from workbench.motion.hdf5 import Hdf5, read_hdf5
from workbench.motion.pose_sequence import Motion
from workbench.utils.arrays import AnyArray, FloatArray
from workbench.utils.atomic_write import whole_file
from workbench.utils.errors import InputError
from workbench.utils.input_limits import check_places, check_rate

FORMAT = "workbench motion library"
FORMAT_VERSION = 1
_TEXT_ATTRIBUTES = ("name", "subject", "activity", "source", "sha256", "licence")


def write_library(path: str | Path, motions: Sequence[Motion]) -> None:
    """Write motions to an HDF5 file, atomically; an existing file is replaced.

    Raises InputError if there is no motion, one has fewer than two frames, or the file cannot be written.
    """
    path = Path(path)
    if not motions:
        raise InputError(f"{path}: expected at least one motion to write, found none")
    if short := [motion.name for motion in motions if len(motion) < 2]:
        raise InputError(f"{path}: expected motions of at least two frames, found {short[0]!r} with one")
    with whole_file(path) as part, h5py.File(part, "w") as file:
        file.attrs.update(format=FORMAT, format_version=FORMAT_VERSION, workbench_version=__version__)
        file.attrs.update(pose_names=list(POSE_NAMES), error_joints=list(ERROR_JOINTS))
        for number, motion in enumerate(motions):
            group = file.create_group(f"motions/{number:06d}")
            group.attrs.update({name: getattr(motion, name) for name in _TEXT_ATTRIBUTES}, rate_hz=motion.rate_hz)
            for name in ("poses", "velocities", "joint_error_mm"):
                group[name] = getattr(motion, name)
            group.create_group("shape").attrs.update(motion.shape.as_dict())


def read_library(path: str | Path, own: bool = False) -> tuple[Motion, ...]:
    """Return the motions of a library, in the order in which they were written. own : see `read_hdf5`.

    Raises InputError if the file is missing, is not HDF5 or not a library of this version, has external links, or a
    motion is incomplete, has arrays of a wrong shape, or numbers that are not finite or exceed `input_limits`.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such motion library")
    file = read_hdf5(path, "a whole motion library", own)
    root = file.attributes["/"]
    kind, version = root.get("format"), root.get("format_version")
    if (kind, version) != (FORMAT, FORMAT_VERSION):
        raise InputError(f"{path}: expected {FORMAT!r} of version {FORMAT_VERSION}, found {kind!r}, {version}")
    keys = {place.split("/")[2] for place in (*file.attributes, *file.arrays) if place.startswith("/motions/")}
    if not keys:
        raise InputError(f"{path}: expected at least one motion under /motions, found none")
    return tuple(_read_motion(path, file, key) for key in sorted(keys))


def _read_motion(path: Path, file: Hdf5, key: str) -> Motion:
    group, place = f"/motions/{key}", f"{path}: motion {key}"
    if group not in file.attributes:
        raise InputError(f"{place} is not a group")
    texts: dict[str, Any] = {name: file.attributes[group].get(name) for name in _TEXT_ATTRIBUTES}
    rate_hz = file.attributes[group].get("rate_hz")
    if missing := [name for name in _TEXT_ATTRIBUTES if not isinstance(texts[name], str)]:
        raise InputError(f"{place} has no text attribute {missing[0]!r}")
    if not isinstance(rate_hz, float):
        raise InputError(f"{place} must have a positive rate_hz, found {rate_hz!r}")
    check_rate(f"{place} must have a positive rate_hz", rate_hz)
    if (shape := file.attributes.get(f"{group}/shape")) is None:
        raise InputError(f"{place} has no group 'shape'")
    poses = _numbers(place, file.arrays.get(f"{group}/poses"), "poses", (None, len(POSE_NAMES)))
    velocities = file.arrays.get(f"{group}/velocities")
    _numbers(place, velocities, "velocities", poses.shape)  # for other readers; here they are derived from the poses
    check_places(place, poses[:, :3])
    errors_mm = _numbers(place, file.arrays.get(f"{group}/joint_error_mm"), "joint_error_mm", (len(ERROR_JOINTS),))
    measurements = read_shape(place, shape)
    return Motion(**texts, rate_hz=rate_hz, poses=poses, shape=measurements, joint_error_mm=errors_mm)


def _numbers(place: str, values: AnyArray | None, name: str, shape: tuple[int | None, ...]) -> FloatArray:
    """Return a dataset of finite float64; None in the shape matches any positive size."""
    if values is None:
        raise InputError(f"{place} has no dataset {name!r}")
    fits = len(values.shape) == len(shape) and all(
        size == expected or (expected is None and size > 0) for size, expected in zip(values.shape, shape, strict=True)
    )
    if not fits or values.dtype != np.float64:
        sizes = " × ".join("F" if expected is None else str(expected) for expected in shape)
        raise InputError(f"{place}: {name} must be {sizes} float64, found {values.shape} {values.dtype}")
    if not np.isfinite(values).all():
        raise InputError(f"{place}: {name} has numbers that are not finite")
    return values
