"""A video of a recording's images with the estimated skeleton drawn over them."""

from pathlib import Path

import cv2
import numpy as np
from tqdm import tqdm

from workbench.recording.read.chunks import timed
from workbench.recording.read.reader import Run
from workbench.results.pictures import Picture, pictures
from workbench.utils.arrays import ByteArray
from workbench.utils.atomic_write import whole_file
from workbench.utils.errors import InputError

SUFFIX = ".mp4"
_COLOURS = {"truth": (0, 114, 178), "estimate": (230, 97, 1)}
"""RGB, as in the viewer."""
_WIDTH_OVER_HEIGHT = 1.0 / 250.0
_DEFAULT_HZ = 30.0


def write_overlay(run: Run, path: Path, camera: str | None = None) -> tuple[int, bool]:
    """Write the images of one camera with the skeletons as an MP4 file; return the number of frames, and whether any
    has a true skeleton.

    Parameters
    ----------
    camera : name; None: the first by name.

    Raises
    ------
    InputError
        For a recording without images, an unknown camera, and where OpenCV cannot write the file.
    """
    _, times_s, _ = timed(run.path, "poses")
    rate_hz = 1.0 / float(np.median(np.diff(times_s))) if len(times_s) > 1 else _DEFAULT_HZ
    n, has_truth, writer = 0, False, None
    with whole_file(path) as part:
        target = part.with_suffix(SUFFIX)  # OpenCV chooses the container by the extension
        try:
            for picture in tqdm(pictures(run, camera=camera), desc=path.name, unit="frame", disable=None):
                image = drawn(picture)
                if writer is None:
                    size = image.shape[1], image.shape[0]
                    writer = cv2.VideoWriter(str(target), cv2.VideoWriter.fourcc(*"mp4v"), rate_hz, size)
                    if not writer.isOpened():
                        raise InputError(f"{path}: OpenCV cannot write an MP4 video here")
                writer.write(image)
                n, has_truth = n + 1, has_truth or len(picture.skeletons["truth"]) > 0
        finally:
            if writer is not None:
                writer.release()
        target.replace(part)
    return n, has_truth


def drawn(picture: Picture) -> ByteArray:
    """Return a picture's image with the skeletons of _COLOURS, (height, width, 3) BGR, of even size."""
    grey = picture.image.ndim == 2
    image = cv2.cvtColor(picture.image, cv2.COLOR_GRAY2BGR if grey else cv2.COLOR_RGB2BGR)
    width = max(1, round(_WIDTH_OVER_HEIGHT * image.shape[0]))
    for name, colour in _COLOURS.items():
        strips = np.nan_to_num(picture.skeletons[name]).round().astype(np.int32)
        cv2.polylines(image, list(strips), False, colour[::-1], width, cv2.LINE_AA)
    height, across = (2 * (size // 2) for size in image.shape[:2])
    return np.ascontiguousarray(image[:height, :across], dtype=np.uint8)
