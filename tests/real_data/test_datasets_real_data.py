"""The generated walk against recorded walks, a recorded clip rendered, and the demonstration video."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import find_peaks

from workbench.body.kinematics import joints
from workbench.body.skeleton import JOINT_NAMES, POSE_NAMES, person_skeleton
from workbench.motion.sources import load_motion
from workbench.motion.synthetic.gait import average_subject

CLIPS = ("02_01", "05_01", "06_01", "07_01", "08_01", "16_15", "35_02", "38_01", "39_01")


@pytest.fixture(scope="module")
def recorded_cycle(data):
    """Mean cycle (101, 25) in degrees of nine people's walks, from heel strike to heel strike of the left foot."""
    cycles = []
    for clip in CLIPS:
        motion = load_motion(data / "cmu" / clip[:2] / f"{clip}.amc")
        places = joints(person_skeleton(motion.shape), motion.poses)
        way = places[-1, 0] - places[0, 0]
        way[2] = 0.0
        ahead = (places[:, JOINT_NAMES.index("left_ankle")] - places[:, 0]) @ way / np.linalg.norm(way)
        strikes, _ = find_peaks(ahead, distance=int(0.7 * motion.rate_hz), prominence=0.2)
        for start, end in pairwise(strikes):
            times = np.linspace(start, end, 101)
            at = np.arange(len(motion))
            cycles.append(np.stack([np.interp(times, at, column) for column in motion.poses.T], axis=1))
    assert len(cycles) >= len(CLIPS)
    return np.degrees(np.mean(cycles, axis=0))


def misfit(recorded_cycle, name, remove_mean):
    """RMS difference, degrees, at the best phase shift; and the mean difference there."""
    column = recorded_cycle[:, POSE_NAMES.index(name)]
    best = (np.inf, np.nan)
    for shift in np.arange(0.0, 1.0, 0.01):
        angles = np.degrees(average_subject().angles(np.linspace(0.0, 1.0, 101) + shift))
        error = angles[:, POSE_NAMES.index(name) - 3] - column
        best = min(best, (float(error.std() if remove_mean else np.sqrt((error**2).mean())), float(error.mean())))
    return best


@pytest.mark.parametrize("name", ["left_hip_flexion", "left_elbow_flexion", "left_shoulder_flexion"])
def test_the_average_walk_fits_recorded_walks(recorded_cycle, name):
    # 8° is about the standard deviation between people in Winter's tables. Measured: 3.7° (hip), nothing removed.
    assert misfit(recorded_cycle, name, remove_mean=False)[0] < 8.0


def test_the_average_knee_fits_recorded_knees_but_for_a_constant(recorded_cycle):
    """Knees of this database never straighten: 17° at the strike, 11° at least, where Winter has 4° and 2°.

    Measured: 11.9° RMS as they are, 5.2° after removing the mean difference of −10.7°. The published values are kept:
    a knee bent throughout, as recorded, takes the rise and fall out of a walker without feet.
    """
    rms, offset = misfit(recorded_cycle, "left_knee_flexion", remove_mean=True)
    assert rms < 8.0
    assert offset == pytest.approx(-11.0, abs=3.0)
