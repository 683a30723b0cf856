"""Everyday videos with joints annotated by hand: distances of the estimate and of the detector from the annotations.

A folder has videos NAME.mp4, .avi, .mkv or .mov with annotations NAME.csv, and in README.md a table whose rows name a
video and the height of its person, as in "| walk.mp4 | a man walks; about 1.80 m |". The runs are those of `workbench
track`, and their folders have its overlays.
"""

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
from workbench.detections.joint_annotations import read_annotations
from workbench.experiment.run import execute
from workbench.recording.read.chunks import cells, flat
from workbench.recording.read.reader import Run, read
from workbench.results.overlay import MAX_SIDE_PX, PERSON_CHAINS, lost_frames, write_overlay
from workbench.results.pictures import lines
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.run_files import OVERLAY, read_summary

log = logging.getLogger(__name__)

_SUFFIXES = (".mp4", ".avi", ".mkv", ".mov")
_LIMBS = [k for k, name in enumerate(JOINT_NAMES) if name.startswith(("left_", "right_"))]
_UPRIGHT = [k for k, name in enumerate(JOINT_NAMES) if name.endswith(("head_centre", "hip", "knee", "ankle"))]
"""Joints whose distance in the image shows the height: raised arms do not count."""
_UPRIGHT_OVER_HEIGHT = 0.891
"""From the head's centre to the ankles, of a standing person of average proportions (`from_height`)."""
_CLOSE = 0.06
"""Distance over the person's height within which a joint is close: six standard deviations of an annotation, and less
than half of a forearm, so that an exchanged or forgotten limb is not."""
_PRECISION = {"shoulder": 0.01, "hip": 0.02}
"""Standard deviation of annotated joints over the person's height: of repeated annotations by hand."""
_HEADER = (
    "video", "annotated frames", "detector, mean (% H)", "estimate, mean (% H)", "estimate, median (% H)",
    "joints within 6 % H (%)", "facing right (frames)", "tracked (% of frames)", "verdict", "fit (ms a frame)",
)  # fmt: skip


@dataclass(frozen=True)
class Subject:
    """An annotated video. height_m : of the person; None: unknown."""

    video: Path
    annotations: Path
    height_m: float | None


@dataclass(frozen=True, eq=False)
class Measured:
    """Comparison of a run with the annotations of its video.

    errors, detected : (F, J) distances over the person's height, NaN where a joint is not annotated as visible,
    infinite where it has no estimate or no detection. facing : see `facing`. tracked : fraction of the frames from
    the first to the last annotated one. fit_ms : per frame.
    """

    errors: FloatArray
    detected: FloatArray
    facing: Sequence[bool]
    tracked: float
    verdict: str
    fit_ms: float

    def cells(self) -> list[str]:
        """Return the cells of the row after the name."""
        annotated = self.errors[~np.isnan(self.errors)]
        both = np.isfinite(self.errors) & np.isfinite(self.detected)
        means = [100.0 * float(each[both].mean()) if both.any() else np.nan for each in (self.detected, self.errors)]
        median, close = np.nan, np.nan
        if len(annotated):
            median, close = 100.0 * float(np.median(annotated)), 100.0 * float((annotated <= _CLOSE).mean())
        return [
            str(len(self.errors)), *(_number(value, 1) for value in (*means, median)), _number(close, 0),
            f"{sum(self.facing)} of {len(self.facing)}" if self.facing else NONE,
            _number(100.0 * self.tracked, 0), self.verdict, _number(self.fit_ms, 1),
        ]  # fmt: skip


def table(folder: Path | None, data: Path | None, runs: Path, detector: str) -> str:
    """Return the table of the annotated videos, in Markdown.

    Parameters
    ----------
    folder : of videos and annotations.
    data : recorded data; its video of a walking woman is the last row, if it is there.
    runs : folder of the recordings, which are made again.
    detector : "full", "heavy" or a landmark model, see `workbench track`.

    Raises
    ------
    InputError
        Where there is no annotated video.
    """
    rows = []
    for subject in subjects(folder, data):
        log.info("%s", subject.video)
        try:
            row = measured(subject, runs / subject.video.stem, detector).cells()
        except InputError as error:
            log.warning("%s", error)
            row = [NONE] * (len(_HEADER) - 3) + ["not tracked", NONE]
        rows.append([subject.video.stem, *row])
    return markdown([_HEADER, ["---"] * len(_HEADER), *rows])


def subjects(folder: Path | None, data: Path | None) -> list[Subject]:
    """Return the annotated videos, see `table`."""
    if folder is None or not folder.is_dir():
        raise InputError(f"expected a folder of annotated videos, --videos FOLDER, found {folder or 'none'}")
    heights = heights_m(folder / "README.md")
    videos = [file for file in sorted(folder.iterdir()) if file.suffix in _SUFFIXES]
    every = [Subject(video, video.with_suffix(".csv"), heights.get(video.name)) for video in videos]
    if not (annotated := [subject for subject in every if subject.annotations.is_file()]):
        raise InputError(f"{folder}: expected videos NAME.mp4 with annotations NAME.csv, found none")
    walk = (data or Path()) / "sports2d_walk"
    woman = Subject(walk / "demo.mp4", walk / "keypoints.csv", 1.65)
    return [*annotated, woman] if woman.video.is_file() else annotated


def heights_m(readme: Path) -> dict[str, float]:
    """Return people's heights by the name of the video, from the rows of a table in Markdown."""
    rows = readme.read_text(encoding="utf-8").splitlines() if readme.is_file() else []
    matches = [re.match(r"\|\s*([\w.-]+\.\w+)\b.*?about (\d\.\d+) m", row) for row in rows]
    return {match[1]: float(match[2]) for match in matches if match}


def measured(subject: Subject, folder: Path, detector: str) -> Measured:
    """Track the person in a video, write the overlay, and compare with the annotations."""
    overrides = [f"dataset.source='{subject.video}'", f"dataset.detector='{detector}'"]
    overrides += [] if subject.height_m is None else [f"dataset.height_m={subject.height_m}"]
    execute(composed(["experiment=video", *overrides]), "video", folder, quiet=True)
    run, summary = read(folder), read_summary(folder) or {}
    write_overlay(run, folder / OVERLAY, source=subject.video, max_side_px=MAX_SIDE_PX)
    annotations = read_annotations(subject.annotations)
    frames = annotations.frames.tolist()
    visible = np.where(annotations.visible[..., None], annotations.pixels, np.nan)
    estimate, detected = projected_joints(run, frames), detected_joints(run, frames)
    height = float(height_px(annotations.pixels[:, _UPRIGHT]).max()) / _UPRIGHT_OVER_HEIGHT
    span = range(frames[0], frames[-1] + 1)
    n_tracked = len((set(run.poses[0].tolist()) - lost_frames(run)).intersection(span))
    return Measured(
        distances(estimate, visible)[:, _LIMBS] / height, distances(detected, visible)[:, _LIMBS] / height,
        facing(estimate, visible, height), n_tracked / len(span), summary["verdict"]["level"],
        1e3 * summary["timing"]["least_squares"] / len(run.poses[0]),
    )  # fmt: skip


def distances(pixels: FloatArray, annotated: FloatArray) -> FloatArray:
    """Return distances (F, J), NaN without annotation, infinite for an annotated joint without pixels."""
    each = np.linalg.norm(pixels - annotated, axis=-1)
    return np.where(np.isnan(annotated[..., 0]), np.nan, np.where(np.isnan(each), np.inf, each))


def facing(pixels: FloatArray, annotated: FloatArray, height: float) -> list[bool]:
    """Return, of the frames whose annotations show it, whether the estimate turns the same side to the camera.

    Shoulders and hips show it by the order of left and right in the image's x, where they are further apart than three
    standard deviations of the difference of two annotations; all pairs that show it must have the order annotated.
    """
    same = []
    for estimated, places in zip(pixels, annotated, strict=True):
        orders = []
        for name, precision in _PRECISION.items():
            left, right = (JOINT_NAMES.index(f"{side}_{name}") for side in ("left", "right"))
            width = places[left, 0] - places[right, 0]
            if abs(width) > 3.0 * np.sqrt(2.0) * precision * height:
                orders.append(bool(width * (estimated[left, 0] - estimated[right, 0]) > 0.0))
        if orders:
            same.append(all(orders))
    return same


def projected_joints(run: Run, frames: Sequence[int]) -> FloatArray:
    """Return the estimate's joints (F, J, 2) in the images of the only camera; NaN in frames without an estimate."""
    columns = cells(run.path, ["/world/**"], frames, ("LineStrips2D:strips",))
    strips = next(each["LineStrips2D:strips"] for path, each in columns.items() if path.endswith("/image/estimate"))
    pixels = np.full((len(frames), len(JOINT_NAMES), 2), np.nan)
    for row, frame in enumerate(frames):
        for names, line in zip(PERSON_CHAINS, lines(strips.get(frame), 2), strict=False):
            pixels[row, [JOINT_NAMES.index(name) for name in names]] = line
    return pixels


def detected_joints(run: Run, frames: Sequence[int]) -> FloatArray:
    """Return the tracked person's keypoints (F, J, 2) in the images of the only camera; NaN without."""
    columns = cells(run.path, ["/world/**"], frames, ("Points2D:labels", "Points2D:positions"))
    keypoints = next((each for path, each in columns.items() if path.endswith("/image/keypoints")), {})
    pixels = np.full((len(frames), len(JOINT_NAMES), 2), np.nan)
    for row, frame in enumerate(frames):
        if (labels := keypoints.get("Points2D:labels", {}).get(frame)) is not None:
            places = flat(keypoints["Points2D:positions"][frame]).reshape(-1, 2)
            pixels[row, [JOINT_NAMES.index(name) for name in labels.as_py()]] = places
    return pixels


def _number(value: float, digits: int) -> str:
    """Return a cell; infinite: most joints have no estimate."""
    return NONE if np.isnan(value) else f"{value:.{digits}f}" if np.isfinite(value) else "∞"
