"""Images of a recording with the skeletons drawn over them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
import rerun as rr

from workbench.recording.read.chunks import cells, flat, read_chunks, static_values
from workbench.recording.read.reader import Run
from workbench.recording.write.images import KEYPOINT_RADIUS
from workbench.utils.arrays import ByteArray, FloatArray
from workbench.utils.decode import decode
from workbench.utils.errors import InputError

SKELETONS = ("particles", "estimate", "truth")
_IMAGE, _TIMESTAMP = "EncodedImage:blob", "VideoFrameReference:timestamp"
_STRIPS, _RADII, _LABELS = "LineStrips2D:strips", "Points2D:radii", "Points2D:labels"
_RESOLUTION = "Pinhole:resolution"
_REDUCED = {1: cv2.IMREAD_UNCHANGED, 2: cv2.IMREAD_REDUCED_COLOR_2, 4: cv2.IMREAD_REDUCED_COLOR_4}
"""OpenCV's flags by the factor by which it reduces a JPEG while decoding, which is faster than to resize it."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A camera's image in a frame, undistorted, (height, width) grey or (height, width, 3) RGB.

    skeletons: SKELETONS by name, each as lines (n, k, 2), pixels of the image; n may be 0. confidence: of the detected
    keypoints by joint, 0 to 1.
    """

    frame: int
    image: ByteArray
    skeletons: Mapping[str, FloatArray]
    confidence: Mapping[str, float] = field(default_factory=dict)


def camera_names(run: Run) -> list[str]:
    """Return the names of the cameras with a lens, by which `pictures` chooses one."""
    lenses = static_values(read_chunks(run.path, ["/world/**"], [_RESOLUTION]))
    return [path.split("/")[-2] for path in sorted(lenses) if _RESOLUTION in lenses[path]]


def pictures(
    run: Run, frames: Sequence[int] | None = None, camera: str | None = None, max_side_px: int | None = None
) -> Iterator[Picture]:
    """Yield the images of frames, decoded one by one.

    Parameters
    ----------
    frames : numbers of recorded frames, ascending; None: all with an image.
    camera : name; None: the first by name.
    max_side_px : images of a longer side are reduced to this one; None: none is.

    Raises
    ------
    InputError : where a frame has no image, and for an unknown camera.
    """
    columns = cells(run.path, ["/world/**"], frames, (_IMAGE, _TIMESTAMP, _STRIPS, _RADII, _LABELS))
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
    rows = {name: columns.get(f"{path}/{name}", {}).get(_STRIPS, {}) for name in SKELETONS}
    keypoints = columns.get(f"{path}/keypoints", {})
    factor = 1
    if component == _IMAGE:
        factor = _factor(run, path, max_side_px)
        images: Iterator[ByteArray] = (decoded(encoded[frame], factor) for frame in chosen)
    else:
        images = _video_images(run, path, [int(flat(encoded[frame])[0]) for frame in chosen])
    for frame, image in zip(chosen, images, strict=True):
        small = reduced(image, max_side_px)
        scale = np.array(small.shape[1::-1]) / image.shape[1::-1] / factor
        # the centre of the top left pixel is (0, 0)
        skeletons = {name: (lines(each.get(frame), 2) + 0.5) * scale - 0.5 for name, each in rows.items()}
        yield Picture(frame, small, skeletons, _confidence(keypoints, frame))


def _factor(run: Run, path: str, max_side_px: int | None) -> int:
    """Return the largest factor of _REDUCED by which the images at `path` are not smaller than `max_side_px`."""
    lens = static_values(read_chunks(run.path, [f"/{path}"], [_RESOLUTION])).get(path, {})
    side = float(max(flat(lens.get(_RESOLUTION)), default=0.0))
    return max(each for each in _REDUCED if each == 1 or (max_side_px is not None and side >= each * max_side_px))


def reduced(image: ByteArray, max_side_px: int | None) -> ByteArray:
    """Return an image whose longer side is at most `max_side_px`; None: the same image."""
    if max_side_px is None or (side := max(image.shape[:2])) <= max_side_px:
        return image
    height, width = (max(1, round(size * max_side_px / side)) for size in image.shape[:2])
    # bilinear is five times as fast, and reads all pixels down to half the size
    how = cv2.INTER_LINEAR if side <= 2 * max_side_px else cv2.INTER_AREA
    return np.asarray(cv2.resize(image, (width, height), interpolation=how), np.uint8)


def _confidence(keypoints: Mapping[str, Mapping[int, Any]], frame: int) -> dict[str, float]:
    """Return the weights of a frame's keypoints by joint, from the columns of their entity."""
    labels, radii = (keypoints.get(name, {}).get(frame) for name in (_LABELS, _RADII))
    if labels is None or radii is None:
        return {}
    return dict(zip(labels.as_py(), ((flat(radii) / KEYPOINT_RADIUS) ** 2).tolist(), strict=True))


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
        yield from decode(file, wanted[0], wanted[-1], set(wanted))


def lines(cell: Any, n_axes: int) -> FloatArray:
    """Return a cell's lines (n, k, n_axes)."""
    n = 0 if cell is None else len(cell)
    return flat(cell).reshape(n, -1, n_axes) if n else np.empty((0, 2, n_axes))


def decoded(cell: Any, factor: int = 1) -> ByteArray:
    """Return a cell's image, grey or RGB; reduced by another factor of _REDUCED than 1, it is RGB."""
    image = np.asarray(cv2.imdecode(np.asarray(cell.values.flatten(), dtype=np.uint8), _REDUCED[factor]), np.uint8)
    # OpenCV decodes to BGR
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)
