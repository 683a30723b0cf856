"""The verdict names the defect of recorded detections with one simulated defect each.

No threshold of the verdict was chosen on these cases.
"""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from openpose_scenes import people_in

from workbench.cameras.camera_file import load_cameras
from workbench.core.dataset import SequenceInfo
from workbench.core.frame import Frame, View
from workbench.core.frame_cache import FrameCache
from workbench.detections.association.keypoint_kalman import exchanged
from workbench.detections.association.target_selection import select_target
from workbench.evaluation.verdict.run_findings import RunInputs
from workbench.evaluation.verdict.run_measurements import MeasurementCollector
from workbench.evaluation.verdict.run_verdict import verdict
from workbench.inference.initialization.limb_lengths import of_keypoints
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.motion.smooth_fit import SmoothFit
from workbench.likelihoods.keypoints import KeypointLikelihood
from workbench.utils.errors import InputError

pytestmark = pytest.mark.slow
SCALE, RATE_HZ, N = 0.5, 60.0, 24
FILES = ("cam01", "cam02", "cam03", "cam04")


class Detections:
    """The man's joints in four views, without images.

    files: detections of each camera. rows: frames that remain and are renumbered. mirrored: left and right exchanged.
    """

    def __init__(self, folder, calibration=None, files=FILES, rows=range(N), mirrored=False, rate_hz=RATE_HZ):
        cameras = load_cameras(calibration or folder / "Calib_qualisys.toml")
        people = {camera.name: people_in(folder / "openpose" / f"{file}_json")
                 for camera, file in zip(cameras, files, strict=True)}  # fmt: skip
        if mirrored:
            order = exchanged("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
            people = {name: replace(detected, joints=[joints[:, order] for joints in detected.joints])
                      for name, detected in people.items()}  # fmt: skip
        people = {name: _select(detected, list(rows)) for name, detected in people.items()}
        self._joints = select_target(people, {camera.name: camera for camera in cameras}, rate_hz).joints
        self._cameras, self._rate_hz = [camera.scaled(SCALE) for camera in cameras], rate_hz
        self.info = SequenceInfo(
            "detections", self._joints.shape[1], rate_hz, cameras=tuple(self._cameras), scale=SCALE, has_keypoints=True
        )

    def frames(self):
        image = np.zeros((2, 2), dtype=np.uint8)
        for t in range(self._joints.shape[1]):
            scaled = [np.column_stack([(p[t, :, :2] + 0.5) * SCALE - 0.5, p[t, :, 2]]) for p in self._joints]
            views = tuple(View(camera, image, pixels) for camera, pixels in zip(self._cameras, scaled, strict=True))
            yield Frame(t, t / self._rate_hz, views)


def _select(people, frames):
    rows = [int(np.searchsorted(people.frames, frame)) for frame in frames]
    return replace(people, frames=np.arange(len(rows)), joints=[people.joints[row] for row in rows])


def verdict_of(dataset, height_m=1.69, **inputs):
    clip = FrameCache(dataset)
    body = of_keypoints(clip, height_m=height_m)
    fit = LeastSquares(body, KeypointLikelihood(body, sigma_px=5.0, loss="huber"), problem=SmoothFit(), n_particles=20)
    collector = MeasurementCollector(body, SCALE)
    streams = {name: np.random.default_rng(0) for name in ("start", "prior")}
    for step in fit.run(clip, None, streams):
        collector.add(step, {})
    run_inputs = RunInputs(height_m=height_m, rate_hz=dataset.info.rate_hz, **inputs)
    return verdict(collector.measurements(), run_inputs)


@pytest.fixture(scope="module")
def folder(data):
    path = data / "pose2sim_balance"
    if not path.is_dir():
        pytest.skip(f"no recordings of several cameras: {path}")
    return path


def test_unchanged_detections_have_no_findings(folder):
    result = verdict_of(Detections(folder))
    assert (result.kind, result.findings) == ("no ground truth", ())
    assert set(result.states) == {"tracked"}


def test_exchanged_cameras_are_reported(folder):
    assert verdict_of(Detections(folder, files=("cam02", "cam01", "cam03", "cam04"))).kind == "inconsistent cameras"


@pytest.mark.parametrize("factor", [0.85, 1.15])
def test_a_wrong_height_is_reported(folder, factor):
    assert verdict_of(Detections(folder), height_m=1.69 * factor).kind == "height mismatch"


def test_exchanged_left_and_right_are_reported(folder):
    assert verdict_of(Detections(folder, mirrored=True)).kind == "left–right swap"


def test_missing_frames_are_reported(folder):
    result = verdict_of(Detections(folder, rows=[*range(12), *range(42, 54)]))
    assert result.kind == "missing frames or jumps"
    assert "from frame 11 to 12" in result.message


def test_a_wrong_frame_rate_is_reported(folder):
    assert verdict_of(Detections(folder, rate_hz=30.0), source_rate_hz=60.0).kind == "frame-rate mismatch"


def test_a_calibration_of_half_the_size_is_refused(folder, tmp_path):
    """The matrices are those of half the size; the sizes in the file are unchanged."""

    def halve(row):
        matrix = 0.5 * np.array(json.loads(row[1]))
        matrix[2, 2] = 1.0
        return f"matrix = {matrix.tolist()}"

    path = tmp_path / "half.toml"
    path.write_text(re.sub(r"matrix = (\[.*\])", halve, (folder / "Calib_qualisys.toml").read_text()))
    with pytest.raises(InputError, match="match the calibration"):
        Detections(folder, path)
