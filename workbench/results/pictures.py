"""Images of a recording with the skeletons drawn over them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
import rerun as rr

from workbench.recording.read.chunks import cells, flat, read_chunks, static_values
from workbench.recording.read.reader import Run
from workbench.utils.arrays import ByteArray, FloatArray
from workbench.utils.decode import decode
from workbench.utils.errors import InputError

SKELETONS = ("particles", "estimate", "truth")
_IMAGE, _TIMESTAMP = "EncodedImage:blob", "VideoFrameReference:timestamp"


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
    frames : numbers of recorded frames, ascending; None: all with an image.
    camera : name; None: the first by name.

    Raises
    ------
    InputError
        Where a frame has no image, and for an unknown camera.
    """
    columns = cells(run.path, ["/world/**"], frames)
    paths = {path.split("/")[-2]: path for path in sorted(columns) if {_IMAGE, _TIMESTAMP} & set(columns[path])}
    if not paths:
        raise InputError(f"{run.path}: expected images, found none")
    if camera is not None and camera not in paths:
        raise InputError(f"{run.path}: no camera {camera!r}, expected one of {', '.join(paths)}")
    path = paths[next(iter(paths)) if camera is None else camera]
    component = _IMAGE if _IMAGE in columns[path] else _TIMESTAMP
    encoded = columns[path][component]
    chosen = sorted(encoded) if frames is None else frames
    if missing := [frame for frame in chosen if frame not in encoded]:
        raise InputError(f"{run.path}: no image of frame {missing[0]}")
    rows = {name: columns.get(f"{path}/{name}", {}).get("LineStrips2D:strips", {}) for name in SKELETONS}
    if component == _IMAGE:
        images: Iterator[ByteArray] = (decoded(encoded[frame]) for frame in chosen)
    else:
        images = _video_images(run, path, [int(flat(encoded[frame])[0]) for frame in chosen])
    for frame, image in zip(chosen, images, strict=True):
        yield Picture(frame, image, {name: lines(each.get(frame), 2) for name, each in rows.items()})


def _video_images(run: Run, path: str, timestamps_ns: Sequence[int]) -> Iterator[ByteArray]:
    """Yield the images at these timestamps, ascending, of the video that is recorded for a camera's image at `path`."""
    entity = f"{path.removesuffix('/image')}/video"
    video = static_values(read_chunks(run.path, [f"/{entity}"]))[entity]
    contents = flat(video["AssetVideo:blob"]).astype(np.uint8).tobytes()
    every_ns = rr.AssetVideo(contents=contents).read_frame_timestamps_nanos()
    with TemporaryDirectory() as folder:
        file = Path(folder, "video.mp4")
        file.write_bytes(contents)
        wanted = np.searchsorted(every_ns, timestamps_ns).tolist()
        for k, image in enumerate(decode(file, wanted[0], wanted[-1]), wanted[0]):
            if k in wanted:
                yield image


def lines(cell: Any, n_axes: int) -> FloatArray:
    """Return a cell's lines (n, k, n_axes)."""
    n = 0 if cell is None else len(cell)
    return flat(cell).reshape(n, -1, n_axes) if n else np.empty((0, 2, n_axes))


def decoded(cell: Any) -> ByteArray:
    """Return a cell's image, grey or RGB."""
    jpeg = flat(cell).astype(np.uint8)
    image = np.asarray(cv2.imdecode(jpeg, cv2.IMREAD_UNCHANGED), dtype=np.uint8)
    return image if image.ndim == 2 else np.ascontiguousarray(image[..., ::-1])  # OpenCV decodes to BGR
