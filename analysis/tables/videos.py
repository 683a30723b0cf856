"""Everyday videos with joints annotated by hand: how far the estimate and the detector are from the annotations.

A folder has videos NAME.mp4, .avi or .mkv with annotations NAME.csv (frame,joint,u,v,visible), and in README.md a table
whose rows name a video and the height of its person, as in "| walk.mp4 | a man walks; about 1.80 m |". The numbers are
measured on runs of `workbench track`. Constants of the workbench were not chosen on these videos.
"""

import csv
import logging
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.figures.unrecorded import composed
from analysis.tables.table import NONE, markdown
from workbench.body.skeleton import JOINT_NAMES
from workbench.cameras.image_height import height_px
from workbench.experiment.run import execute
from workbench.recording.read.chunks import cells, flat
from workbench.recording.read.reader import Run, read
from workbench.results.overlay import PERSON_CHAINS, lost_frames
from workbench.results.pictures import lines
from workbench.utils.arrays import FloatArray
from workbench.utils.decode import count_frames
from workbench.utils.errors import InputError
from workbench.utils.run_files import read_summary

log = logging.getLogger(__name__)

_SUFFIXES = (".mp4", ".avi", ".mkv", ".mov")
_LIMB_JOINTS = tuple(name for name in JOINT_NAMES if name.startswith(("left_", "right_")))
_CLOSE = 0.06
"""Distance over the person's height up to which a joint counts as close: six standard deviations of an annotation."""
_PRECISION = 0.01
"""Standard deviation of an annotated joint over the person's height, as README.md of the videos states it."""
_HEADER = (
    "video", "annotated frames", "estimate (% H)", "detector (% H)", "ratio", "joints within 6 % H (%)",
    "facing right (frames)", "tracked (% of frames)", "verdict", "fit (ms a frame)",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Measured:
    """Comparison with the annotations of one video.

    errors, detected : (F, 12) distances over the person's height H, NaN where a joint is not annotated as visible;
    infinite where it has no estimate or no detection. facing : of the frames where the annotations show the side that
    the person turns to the camera, whether the estimate shows the same. tracked : fraction of the video's frames.
    """

    errors: FloatArray
    detected: FloatArray
    facing: Sequence[bool]
    tracked: float
    verdict: str
    fit_ms: float

    def cells(self) -> list[str]:
        """Return the cells of the row after the name."""
        both = np.isfinite(self.errors) & np.isfinite(self.detected)
        known = ~np.isnan(self.errors)
        estimate, detector = (100.0 * float(each[both].mean()) if both.any() else np.nan for each in (
            self.errors, self.detected
        ))  # fmt: skip
        close = 100.0 * float((self.errors[known] <= _CLOSE).mean()) if known.any() else np.nan
        numbers = [f"{estimate:.1f}", f"{detector:.1f}", f"{estimate / detector:.2f}", f"{close:.0f}"]
        facing = f"{sum(self.facing)} of {len(self.facing)}" if self.facing else NONE
        return [
            str(len(self.errors)), *(NONE if number == "nan" else number for number in numbers), facing,
            f"{100.0 * self.tracked:.0f}", self.verdict, f"{self.fit_ms:.1f}",
        ]  # fmt: skip


def table(folder: Path | None, runs: Path, detector: str) -> str:
    """Return the table of the annotated videos in a folder, in Markdown.

    Parameters
    ----------
    runs : folder of the recordings, which are made again.
    detector : "full", "heavy" or a landmark model, see `workbench track`.

    Raises
    ------
    InputError
        Where there is no annotated video.
    """
    if folder is None or not folder.is_dir():
        raise InputError(f"expected a folder of annotated videos, --videos FOLDER, found {folder or 'none'}")
    videos = [file for file in sorted(folder.iterdir()) if file.suffix in _SUFFIXES and annotations_of(file).is_file()]
    if not videos:
        raise InputError(f"{folder}: expected videos NAME.mp4 with annotations NAME.csv, found none")
    heights = heights_m(folder / "README.md")
    rows = []
    for video in videos:
        log.info("%s", video)
        rows.append([video.stem, *measured(video, heights.get(video.name), runs / video.stem, detector).cells()])
    return markdown([_HEADER, ["---"] * len(_HEADER), *rows])


def annotations_of(video: Path) -> Path:
    """Return the file of a video's annotations."""
    return video.with_suffix(".csv")


def heights_m(readme: Path) -> dict[str, float]:
    """Return people's heights by the name of the video, from the rows of a table in Markdown."""
    rows = readme.read_text(encoding="utf-8").splitlines() if readme.is_file() else []
    matches = [re.match(r"\|\s*([\w.-]+\.\w+)\b.*?about (\d\.\d+) m", row) for row in rows]
    return {match[1]: float(match[2]) for match in matches if match}


def read_limb_joints(path: Path) -> tuple[list[int], FloatArray, FloatArray]:
    """Return annotated frames (F,), pixels (F, J, 2) of JOINT_NAMES, NaN without, and those that are visible.

    Other points, such as heels and toes, are omitted.
    """
    with path.open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["joint"] in JOINT_NAMES]
    frames = sorted({int(row["frame"]) for row in rows})
    pixels = np.full((2, len(frames), len(JOINT_NAMES), 2), np.nan)
    for row in rows:
        place = frames.index(int(row["frame"])), JOINT_NAMES.index(row["joint"])
        pixels[0][place] = float(row["u"]), float(row["v"])
        if row["visible"] == "1":
            pixels[1][place] = pixels[0][place]
    return frames, pixels[0], pixels[1]


def measured(video: Path, height_m: float | None, folder: Path, detector: str) -> Measured:
    """Track the person in a video and compare with its annotations."""
    overrides = [f"dataset.source='{video}'", f"dataset.detector='{detector}'"]
    overrides += [] if height_m is None else [f"dataset.height_m={height_m}"]
    execute(composed(["experiment=video", *overrides]), "video", folder, quiet=True)
    run, summary = read(folder), read_summary(folder) or {}
    frames, annotated, visible = read_limb_joints(annotations_of(video))
    estimate, detected = projected_joints(run, frames), detected_joints(run, frames)
    limbs = [JOINT_NAMES.index(name) for name in _LIMB_JOINTS]
    height = float(height_px(annotated).max())
    n_tracked, n = len(run.poses[0]) - len(lost_frames(run)), count_frames(video)
    return Measured(
        distances(estimate, visible)[:, limbs] / height, distances(detected, visible)[:, limbs] / height,
        facing(estimate, visible, height), n_tracked / n, summary["verdict"]["level"],
        1e3 * summary["timing"]["least_squares"] / len(run.poses[0]),
    )  # fmt: skip


def distances(pixels: FloatArray, annotated: FloatArray) -> FloatArray:
    """Return distances (F, J), NaN without annotation, infinite for an annotated joint without pixels."""
    each = np.linalg.norm(pixels - annotated, axis=-1)
    return np.where(np.isnan(annotated[..., 0]), np.nan, np.where(np.isnan(each), np.inf, each))


def facing(pixels: FloatArray, annotated: FloatArray, height: float) -> list[bool]:
    """Return whether the estimate's left shoulder is on the side of its right one that the annotations show.

    Where it is shows whether the person faces the camera. Frames count in which the annotated shoulders are visible and
    further apart in the image's x than three standard deviations of their annotation, and in which visible hips do not
    contradict them.
    """
    same = []
    limit = 3.0 * np.sqrt(2.0) * _PRECISION * height
    shoulders, hips = ([JOINT_NAMES.index(f"{side}_{joint}") for side in ("left", "right")] for joint in (
        "shoulder", "hip"
    ))  # fmt: skip
    for estimated, place in zip(pixels, annotated, strict=True):
        width, hip_width = (float(place[k, 0] - place[j, 0]) for k, j in (shoulders, hips))
        if not abs(width) > limit or width * hip_width < 0.0:
            continue
        same.append(bool(width * (estimated[shoulders[0], 0] - estimated[shoulders[1], 0]) > 0.0))
    return same


def projected_joints(run: Run, frames: Sequence[int]) -> FloatArray:
    """Return the estimate's joints (F, J, 2) in the images of the only camera; NaN in frames without an estimate."""
    columns = cells(run.path, ["/world/**"], frames, ("LineStrips2D:strips",))
    strips = next(each["LineStrips2D:strips"] for path, each in columns.items() if path.endswith("/image/estimate"))
    pixels = np.full((len(frames), len(JOINT_NAMES), 2), np.nan)
    for row, frame in enumerate(frames):
        shown = lines(strips.get(frame), 2)
        if len(shown) == len(PERSON_CHAINS):
            for names, line in zip(PERSON_CHAINS, shown, strict=True):
                pixels[row, [JOINT_NAMES.index(name) for name in names]] = line
    return pixels


def detected_joints(run: Run, frames: Sequence[int]) -> FloatArray:
    """Return the target person's keypoints (F, J, 2) in the images of the only camera; NaN without."""
    columns = cells(run.path, ["/world/**"], frames, ("Points2D:labels", "Points2D:positions"))
    keypoints = next(each for path, each in columns.items() if path.endswith("/image/keypoints"))
    pixels = np.full((len(frames), len(JOINT_NAMES), 2), np.nan)
    for row, frame in enumerate(frames):
        if (labels := keypoints["Points2D:labels"].get(frame)) is not None:
            places = flat(keypoints["Points2D:positions"][frame]).reshape(-1, 2)
            pixels[row, [JOINT_NAMES.index(name) for name in labels.as_py()]] = places
    return pixels
