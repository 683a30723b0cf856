"""Images of a recording with the skeletons drawn over them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]

from workbench.recording.read.chunks import cells
from workbench.recording.read.reader import Run
from workbench.utils.arrays import ByteArray, FloatArray
from workbench.utils.errors import InputError

SKELETONS = ("particles", "estimate", "truth")
_IMAGE = "EncodedImage:blob"


@dataclass(frozen=True, eq=False)
class Picture:
    """A camera's image in a frame, undistorted, (height, width) grey or (height, width, 3) RGB.

    skeletons: SKELETONS by name, each as lines (n, k, 2), pixels of the image; n may be 0.
    """

    frame: int
    image: ByteArray
    skeletons: Mapping[str, FloatArray]


def pictures(run: Run, frames: Sequence[int] | None = None, camera: str | None = None) -> Iterator[Picture]:
    """Yield the images of frames, decoded one by one.

    Parameters
    ----------
    frames : numbers of recorded frames, in the order wanted; None: all with an image.
    camera : name; None: the first by name.

    Raises
    ------
    InputError
        Where a frame has no image, and for an unknown camera.
    """
    columns = cells(run.path, ["/world/**"], frames)
    paths = {path.split("/")[-2]: path for path in sorted(columns) if _IMAGE in columns[path]}
    if not paths:
        raise InputError(f"{run.path}: expected images, found none")
    if camera is not None and camera not in paths:
        raise InputError(f"{run.path}: no camera {camera!r}, expected one of {', '.join(paths)}")
    path = paths[next(iter(paths)) if camera is None else camera]
    jpegs = columns[path][_IMAGE]
    chosen = sorted(jpegs) if frames is None else frames
    if missing := [frame for frame in chosen if frame not in jpegs]:
        raise InputError(f"{run.path}: no image of frame {missing[0]}")
    rows = {name: columns.get(f"{path}/{name}", {}).get("LineStrips2D:strips", {}) for name in SKELETONS}
    for frame in chosen:
        yield Picture(frame, decoded(jpegs[frame]), {name: lines(each.get(frame), 2) for name, each in rows.items()})


def flat(cell: Any) -> FloatArray:
    """Return all numbers in a cell of nested lists, (n,); none where there is no cell."""
    if cell is None or not len(cell):
        return np.empty(0)
    values = cell.values
    while pa.types.is_nested(values.type):
        values = values.flatten()
    return np.asarray(values, dtype=np.float64)


def lines(cell: Any, n_axes: int) -> FloatArray:
    """Return a cell's lines (n, k, n_axes)."""
    n = 0 if cell is None else len(cell)
    return flat(cell).reshape(n, -1, n_axes) if n else np.empty((0, 2, n_axes))


def decoded(cell: Any) -> ByteArray:
    """Return a cell's image, grey or RGB."""
    jpeg = flat(cell).astype(np.uint8)
    image = np.asarray(cv2.imdecode(jpeg, cv2.IMREAD_UNCHANGED), dtype=np.uint8)
    return image if image.ndim == 2 else np.ascontiguousarray(image[..., ::-1])  # OpenCV decodes to BGR
