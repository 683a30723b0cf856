"""Runs of experiment=video on recorded people.

The woman of sports2d_walk with and without her camera, and the man of pose2sim_balance with four cameras and with each
alone. The man's truth is triangulated from another detector's joints. No row is of people held out: loss, sigma_px,
depth_sigma_m, the correction of exchanged labels and the standard deviations of joint definitions were chosen with
these clips in view.
"""

import os
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from analysis.figures.cached_runs import Run
from analysis.figures.recordings import Source
from analysis.figures.unrecorded import Result
from analysis.tables.table import Column, Labels, Table, mean, of_people

CAMERAS = ("cam_01", "cam_02", "cam_03", "cam_04")
DETECTIONS = os.environ.get("WORKBENCH_DETECTIONS")
"""Folder with demo and cam01 to cam04 of detections; None: people are detected."""


def rows(data: Path, detections: Path | None) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield the name and the overrides of every run."""
    walk = data / "sports2d_walk"
    keypoints = "detect" if detections is None else str(detections / "demo")
    woman = (
        f"dataset.source={walk / 'demo.mp4'}", f"dataset.keypoints={keypoints}",
        f"dataset.eval_annotations={walk / 'keypoints.csv'}",
    )  # fmt: skip
    yield "woman", (*woman, f"dataset.calibration_file={walk / 'Calib_demo.toml'}", "body.height_m=1.65")
    yield "woman, no camera", (*woman, "dataset.height_m=1.65")
    folders = (f"{camera}:{(detections or Path()) / camera.replace('_', '')}" for camera in CAMERAS)
    files = "detect" if detections is None else f"{{{','.join(folders)}}}"
    man = ("dataset=pose2sim_balance", "dataset.scale=1.0", f"dataset.keypoints={files}")
    yield "man, four cameras", man
    yield from ((f"man, {camera}", (*man, f"dataset.cameras=[{camera}]")) for camera in CAMERAS)


def runs(source: Source, _: int | None) -> Mapping[Labels, list[Run]]:
    """Return the run of every row."""
    data, detections = Path(source.data or "."), None if DETECTIONS is None else Path(DETECTIONS)
    return {
        (name,): [Run(name, "video", "", 0, (*overrides, f"paths.data={source.data}"))]
        for name, overrides in rows(data, detections)
    }


def wrong_depth_percent(results: Mapping[Run, Result]) -> float:
    """Return the percentage of the limbs deep as seen from the camera that point the wrong way, see `wrong_signs`."""
    series = [result.series for result in results.values()]
    wrong, deep = (sum(sum(each.get(name, ())) for each in series) for name in ("n_wrong_signs", "n_deep_limbs"))
    return 100.0 * wrong / deep if deep else float("nan")


def percent(metric: str, digits: int, name: str) -> Column:
    """Return the column of a mean in percent."""
    return Column(name, lambda results: 100.0 * float(np.mean(of_people(results, metric))), digits)


VIDEO = Table(
    ("subject, camera",), runs,
    [
        mean("mpjpe_px", 1), mean("mpjpe_abs_mm", 1), mean("mpjpe_mm", 1),
        percent("coverage_90_joints", 1, "`coverage_90_joints` (%)"),
        Column("limbs with the wrong sign of depth (%)", wrong_depth_percent, 1),
    ],
)  # fmt: skip
