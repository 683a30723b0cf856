"""The synthetic gait agrees with recorded walks."""

from itertools import pairwise

import numpy as np
import pytest
import scipy

from workbench.body.kinematics import joints
from workbench.body.skeleton import JOINT_NAMES, POSE_NAMES, person_skeleton
from workbench.motion.sources import load_motion
from workbench.motion.synthetic.gait import average_subject

CLIPS = ("02_01", "05_01", "06_01", "07_01", "08_01", "16_15", "35_02", "38_01", "39_01")


@pytest.fixture(scope="module")
def recorded_cycle(data):
    """Return the mean cycle (101, 25), degrees, of nine people, between heel strikes of the left foot."""
    cycles = []
    for clip in CLIPS:
        motion = load_motion(data / "cmu" / clip[:2] / f"{clip}.amc")
        positions = joints(person_skeleton(motion.shape), motion.poses)
        direction = positions[-1, 0] - positions[0, 0]
        direction[2] = 0.0
        ahead = (
            (positions[:, JOINT_NAMES.index("left_ankle")] - positions[:, 0]) @ direction / np.linalg.norm(direction)
        )
        strikes, _ = scipy.signal.find_peaks(ahead, distance=int(0.7 * motion.rate_hz), prominence=0.2)
        for start, end in pairwise(strikes):
            times = np.linspace(start, end, 101)
            frames = np.arange(len(motion))
            cycles.append(np.stack([np.interp(times, frames, column) for column in motion.poses.T], axis=1))
    assert len(cycles) >= len(CLIPS)
    return np.degrees(np.mean(cycles, axis=0))


def misfit(recorded_cycle, name, remove_mean):
    """Return the RMS difference at the best phase shift and the mean difference there, degrees."""
    column = recorded_cycle[:, POSE_NAMES.index(name)]
    best = (np.inf, np.nan)
    for shift in np.arange(0.0, 1.0, 0.01):
        angles = np.degrees(average_subject().angles(np.linspace(0.0, 1.0, 101) + shift))
        error = angles[:, POSE_NAMES.index(name) - 3] - column
        best = min(best, (float(error.std() if remove_mean else np.sqrt((error**2).mean())), float(error.mean())))
    return best


@pytest.mark.parametrize("name", ["left_hip_flexion", "left_elbow_flexion", "left_shoulder_flexion"])
def test_the_average_walk_fits_recorded_walks(recorded_cycle, name):
    # 8° is about the standard deviation between people in Winter's tables
    assert misfit(recorded_cycle, name, remove_mean=False)[0] < 8.0


def test_the_average_knee_fits_recorded_knees_up_to_a_constant(recorded_cycle):
    """The knees of this database are flexed by at least 11°, and by 17° at heel strike, where Winter has 2° and 4°."""
    rms, offset = misfit(recorded_cycle, "left_knee_flexion", remove_mean=True)
    assert rms < 8.0
    assert offset == pytest.approx(-11.0, abs=3.0)
