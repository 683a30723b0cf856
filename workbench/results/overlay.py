"""A video of a run's images with the estimated skeleton drawn over them."""

from collections.abc import Iterator, Mapping, Sequence, Set
from heapq import merge
from pathlib import Path

import cv2
import numpy as np
from tqdm import tqdm

from workbench.body.shape import from_height
from workbench.body.skeleton import JOINT_NAMES_WITH_FEET, feet_skeleton, person_skeleton
from workbench.evaluation.verdict.joint_states import LOST
from workbench.recording.read.chunks import timed
from workbench.recording.read.reader import Run
from workbench.recording.read.states import joints_below, lane
from workbench.recording.write.scene import chains
from workbench.results.pictures import Picture, pictures
from workbench.utils.arrays import ByteArray, FloatArray
from workbench.utils.atomic_write import whole_file
from workbench.utils.decode import declared_frames, decode, image_files
from workbench.utils.errors import InputError
from workbench.utils.parallel import ahead

SUFFIX = ".mp4"
LEFT, RIGHT, MIDDLE, TRUTH = (90, 220, 255), (255, 120, 200), (140, 255, 150), (0, 114, 178)
"""RGB; the first three as in `workbench annotate`."""
MAX_SIDE_PX = 640
"""Longer side of the overlay of a run of `workbench track`: OpenCV's encoder takes 2 ms for an image of 640 × 360 and
5 ms for one of 960 × 540."""
_RED = (255, 60, 50)
_MIN_OPACITY = 0.25
"""Of a limb that the detector does not see, which is drawn faintly, as its place is only inferred."""
_WIDTH_OVER_HEIGHT = 1.0 / 200.0
_LARGEST_PX = 1e6
"""Lines further away, of limbs next to the camera, are omitted; OpenCV draws up to 2^31."""
_DEFAULT_HZ = 30.0
_SKELETONS = [skeleton(from_height(1.7)) for skeleton in (person_skeleton, feet_skeleton)]
_CHAINS = {
    chains(each).shape: [[each.names[joint] for joint in chain] for chain in chains(each)] for each in _SKELETONS
}
"""Names of the joints of the lines of a person's skeleton, without and with feet, as recorded, by their shape."""
PERSON_CHAINS = _CHAINS[chains(_SKELETONS[0]).shape]


def write_overlay(
    run: Run,
    path: Path,
    camera: str | None = None,
    source: Path | None = None,
    max_side_px: int | None = None,
    min_state: str | None = None,
) -> tuple[int, bool]:
    """Write the images of one camera with the skeletons as an MP4 file; return the number of frames, and whether any
    has a true skeleton.

    Parameters
    ----------
    camera : name; None: the first by name.
    source : the run's video or folder of images, whose frames without an estimate are then part of the overlay.
    max_side_px : see `pictures`.
    min_state : limbs of which an end has a state below it are not drawn, see `joints_below`; None: all are.

    Raises
    ------
    InputError
        For a recording without images, an unknown camera, as of `joints_below`, and where OpenCV cannot write the file.
    """
    frames = run.poses[0].tolist()
    names, below = JOINT_NAMES_WITH_FEET, {}
    if min_state is not None:
        below = dict(zip(frames, joints_below(run.path, frames, min_state, names), strict=True))
    shown = pictures(run, camera=camera, max_side_px=max_side_px)
    if source is not None:
        shown = with_omitted_frames(shown, run, source)
    lost, n, has_truth = lost_frames(run), 0, False
    with whole_file(path, parents=True) as part:
        target = part.with_suffix(SUFFIX)  # OpenCV chooses the container by the extension
        writer = cv2.VideoWriter()
        try:
            for n, picture in enumerate(tqdm(ahead(shown), desc=path.name, unit="frame", disable=None), 1):
                hidden = {names[joint] for joint in np.flatnonzero(below.get(picture.frame, []))}
                image = drawn(picture, picture.frame in lost, hidden)
                has_truth = has_truth or len(picture.skeletons.get("truth", ())) > 0
                if n == 1:
                    size = image.shape[1], image.shape[0]
                    writer.open(str(target), cv2.VideoWriter.fourcc(*"mp4v"), _rate_hz(run), size)
                    if not writer.isOpened():
                        raise InputError(f"{path}: OpenCV cannot write an MP4 video here")
                writer.write(image)
        finally:
            writer.release()
        target.replace(part)
    return n, has_truth


def _rate_hz(run: Run) -> float:
    """Return the median rate of successive frames."""
    frames, times_s, _ = timed(run.path, "poses")
    return 1.0 / float(np.median(np.diff(times_s) / np.diff(frames))) if len(times_s) > 1 else _DEFAULT_HZ


def lost_frames(run: Run) -> set[int]:
    """Return the numbers of the recorded frames that the verdict regards as lost."""
    frames = run.poses[0].tolist()
    return {frame for frame, state in zip(frames, lane(run.path, "tracking", frames), strict=True) if state == LOST}


def with_omitted_frames(shown: Iterator[Picture], run: Run, source: Path) -> Iterator[Picture]:
    """Yield the pictures of a run and, without skeletons, those frames of its source, a video or a folder, that the run
    omits. The source is decoded up to the last of them."""
    dataset = run.settings["dataset"]
    begin, n_set = int(dataset.get("first_frame", 0)), dataset.get("n_frames")
    end = len(image_files(source)) if source.is_dir() else declared_frames(source)
    end = end if n_set is None else min(end, begin + int(n_set))
    omitted = sorted(set(range(begin, end)) - set(run.poses[0].tolist()))
    first = next(shown)
    without = ahead(_decoded(source, omitted, first.image.shape[:2]))  # while those of the recording are decoded
    yield from merge([first], shown, without, key=lambda picture: picture.frame)


def _decoded(source: Path, frames: Sequence[int], shape: tuple[int, ...]) -> Iterator[Picture]:
    """Yield frames of a video or a folder, ascending, without skeletons, of a shape (height, width)."""
    if not frames:
        return
    images = decode(source, frames[0], frames[-1], set(frames))
    for frame, image in zip(frames, images, strict=False):  # the source may declare more than it has
        yield Picture(frame, np.asarray(cv2.resize(image, shape[1::-1]), np.uint8), {})


def drawn(picture: Picture, lost: bool = False, hidden: Set[str] = frozenset()) -> ByteArray:
    """Return a picture's image with its skeletons, (height, width, 3) BGR, of even size.

    Left and right limbs have two colours. A limb is the fainter the less confident the detector is of its ends; one of
    which an end is hidden, by name, is not drawn. A frame without an estimate has a red frame, as a lost one.
    """
    grey = picture.image.ndim == 2
    flag = cv2.COLOR_GRAY2BGR if grey else cv2.COLOR_RGB2BGR
    image = np.asarray(cv2.cvtColor(picture.image, flag), np.uint8)
    width = max(2, round(_WIDTH_OVER_HEIGHT * image.shape[0]))
    _draw_limbs(image, picture.skeletons.get("estimate", np.empty((0, 2, 2))), picture.confidence, width, hidden)
    truth = np.nan_to_num(picture.skeletons.get("truth", np.empty((0, 2, 2)))).round().astype(np.int32)
    cv2.polylines(image, list(truth), False, TRUTH[::-1], max(1, width // 2), cv2.LINE_AA)
    if lost or not picture.skeletons:
        cv2.rectangle(image, (0, 0), (image.shape[1] - 1, image.shape[0] - 1), _RED[::-1], 4 * width)
        words, place = f"frame {picture.frame}: {LOST if lost else 'no estimate'}", (5 * width, 5 * width + 12)
        cv2.putText(image, words, place, cv2.FONT_HERSHEY_SIMPLEX, 0.5, _RED[::-1], 1, cv2.LINE_AA)
    height, across = (2 * (size // 2) for size in image.shape[:2])
    return np.ascontiguousarray(image[:height, :across], dtype=np.uint8)


def _draw_limbs(
    image: ByteArray, lines: FloatArray, confidence: Mapping[str, float], width: int, hidden: Set[str]
) -> None:
    """Draw the lines (C, k, 2) of a skeleton without hidden joints, of another body than a person's in one colour."""
    person = _CHAINS.get(lines.shape[:2])
    of_person = person is not None
    for line, names in zip(lines, person or [[""] * lines.shape[1]] * len(lines), strict=True):
        for k in range(len(line) - 1):
            if of_person and (names[k] == names[k + 1] or hidden & {names[k], names[k + 1]}):
                continue
            side = names[k + 1].partition("_")[0]
            colour = {"left": LEFT, "right": RIGHT}.get(side, MIDDLE)
            _blend_line(image, line[k], line[k + 1], colour, _opacity(names[k : k + 2], confidence), width)


def _opacity(names: list[str], confidence: Mapping[str, float]) -> float:
    """Return the opacity of a limb by the less confident of its ends; joints that no detector has are ignored."""
    sided = [name.replace("_foot", "_ankle") for name in names if name.startswith(("left", "right"))]
    values = [confidence.get(name, 0.0) for name in sided] if confidence else []
    return max(min(values, default=1.0), _MIN_OPACITY)


def _blend_line(
    image: ByteArray, start: FloatArray, end: FloatArray, colour: tuple[int, int, int], opacity: float, width: int
) -> None:
    """Draw a line over the part of an image around it."""
    (u, v), (u_end, v_end) = start.tolist(), end.tolist()  # ten times as fast as NumPy's functions of two numbers
    if not all(abs(x) < _LARGEST_PX for x in (u, v, u_end, v_end)):  # also NaN
        return
    left, top = max(int(min(u, u_end)) - 2 * width, 0), max(int(min(v, v_end)) - 2 * width, 0)
    right, bottom = int(max(u, u_end)) + 2 * width + 1, int(max(v, v_end)) + 2 * width + 1
    if right <= left or bottom <= top or not (part := image[top:bottom, left:right]).size:
        return
    layer = part if opacity >= 1.0 else part.copy()
    ends = (round(u) - left, round(v) - top), (round(u_end) - left, round(v_end) - top)
    cv2.line(layer, *ends, colour[::-1], width, cv2.LINE_AA)
    if layer is not part:
        cv2.addWeighted(layer, opacity, part, 1.0 - opacity, 0.0, dst=part)
