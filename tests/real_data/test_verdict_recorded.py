"""What goes wrong with one's own data, planted into what a detector saw of a balancing man: does the verdict tell it?

Nothing here chose a threshold: they are what people and detectors differ by, see `verdict`. The undisturbed run is not
accused of anything. Prints what was said of every case.
"""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from workbench.body.camera import load_cameras
from workbench.core.dataset import SequenceInfo
from workbench.core.frame import Frame, View
from workbench.core.frame_cache import FrameCache
from workbench.datasets.association.keypoint_kalman import exchanged
from workbench.datasets.association.target_selection import select_target
from workbench.evaluation.run_measurements import MeasurementCollector
from workbench.evaluation.verdict import RunInputs, verdict
from workbench.inference.initialization.limb_lengths import of_keypoints
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.smooth_fit import SmoothFit
from workbench.likelihoods.keypoints import KeypointLikelihood
from workbench.motion.formats.openpose import read_openpose
from workbench.utils.errors import InputError

pytestmark = pytest.mark.slow
SCALE, RATE_HZ, N = 0.5, 60.0, 24
FILES = ("cam01", "cam02", "cam03", "cam04")


class Detections:
    """The man's joints in four views, without their images. files: whose detections each camera is given. kept: numbers
    of the frames, which are counted on as if none were missing. mirrored: left and right take each other's names."""

    def __init__(self, folder, calibration=None, files=FILES, kept=range(N), mirrored=False, rate_hz=RATE_HZ):
        cameras = load_cameras(calibration or folder / "Calib_qualisys.toml")
        found = {camera.name: read_openpose(folder / "openpose" / f"{file}_json")
                 for camera, file in zip(cameras, files, strict=True)}  # fmt: skip
        if mirrored:
            order = exchanged("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
            found = {name: replace(people, joints=[each[:, order] for each in people.joints])
                     for name, people in found.items()}  # fmt: skip
        found = {name: _only(people, list(kept)) for name, people in found.items()}
        self._joints = select_target(found, {camera.name: camera for camera in cameras}, rate_hz).joints
        self._cameras, self._rate_hz = [camera.scaled(SCALE) for camera in cameras], rate_hz
        self.info = SequenceInfo(
            "detections", self._joints.shape[1], rate_hz, cameras=tuple(self._cameras), scale=SCALE, has_keypoints=True
        )

    def frames(self):
        image = np.zeros((2, 2), dtype=np.uint8)
        for t in range(self._joints.shape[1]):
            seen = [np.column_stack([(each[t, :, :2] + 0.5) * SCALE - 0.5, each[t, :, 2]]) for each in self._joints]
            views = tuple(View(camera, image, marks) for camera, marks in zip(self._cameras, seen, strict=True))
            yield Frame(t, t / self._rate_hz, views)


def _only(people, kept):
    rows = [int(np.searchsorted(people.frames, frame)) for frame in kept]
    return replace(people, frames=np.arange(len(kept)), joints=[people.joints[row] for row in rows])


def said(dataset, height_m=1.69, **told):
    clip = FrameCache(dataset)
    body = of_keypoints(clip, height_m=height_m)
    fit = LeastSquares(body, KeypointLikelihood(body, sigma_px=5.0, loss="huber"), problem=SmoothFit(), n_particles=20)
    collector, streams = (
        MeasurementCollector(body, SCALE),
        {name: np.random.default_rng(0) for name in ("start", "prior")},
    )
    for step in fit.run(clip, None, streams):
        collector.add(step, {})
    known = RunInputs(height_m=height_m, max_iterations=40, rate_hz=dataset.info.rate_hz, **told)
    found = verdict(collector.measurements(), known)
    print(found.message)
    return found


@pytest.fixture(scope="module")
def folder(data):
    found = data / "pose2sim_balance"
    if not found.is_dir():
        pytest.skip(f"no recordings of several cameras: {found}")
    return found


def test_an_undisturbed_run_is_accused_of_nothing(folder):
    found = said(Detections(folder))
    assert (found.kind, found.findings) == ("no ground truth", ())
    assert set(found.states) == {"tracked"}


def test_two_cameras_exchanged(folder):
    assert said(Detections(folder, files=("cam02", "cam01", "cam03", "cam04"))).kind == "inconsistent cameras"


@pytest.mark.parametrize("factor", [0.85, 1.15])
def test_a_wrong_height(folder, factor):
    assert said(Detections(folder), height_m=1.69 * factor).kind == "height mismatch"


def test_left_and_right_exchanged(folder):
    assert said(Detections(folder, mirrored=True)).kind == "left–right swap"


def test_half_a_second_of_frames_missing(folder):
    found = said(Detections(folder, kept=[*range(12), *range(42, 54)]))
    assert found.kind == "missing frames or jumps"
    assert "from frame 11 to 12" in found.message


def test_a_wrong_rate(folder):
    assert said(Detections(folder, rate_hz=30.0), source_rate_hz=60.0).kind == "frame-rate mismatch"


def test_a_calibration_of_another_size_is_refused_or_told(folder, tmp_path):
    """Half the size, whatever it says of its own."""

    def half(row):
        matrix = 0.5 * np.array(json.loads(row[1]))
        matrix[2, 2] = 1.0
        return f"matrix = {matrix.tolist()}"

    path = tmp_path / "half.toml"
    path.write_text(re.sub(r"matrix = (\[.*\])", half, (folder / "Calib_qualisys.toml").read_text()))
    with pytest.raises(InputError, match="match the calibration"):
        Detections(folder, path)
