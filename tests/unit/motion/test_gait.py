"""Generated walkers: published angles, feet on the ground, speeds, paths and seeds."""

import numpy as np
import pytest

from workbench.body.kinematics import joints
from workbench.body.skeleton import JOINT_NAMES, POSE_NAMES, person_skeleton
from workbench.motion.synthetic.gait import average_subject, subjects, walker

ANKLES = {"left": JOINT_NAMES.index("left_ankle"), "right": JOINT_NAMES.index("right_ankle")}
PEOPLE = [average_subject(), *subjects(12, np.random.default_rng(2000))]


def angle(subject, name, percent):
    return np.degrees(subject.angles(np.array([percent / 100.0])))[0, POSE_NAMES.index(name) - 3]


# Winter: hip (from the pelvis) 30° at the strike, −11° at 54 %, 32° at 86 %, less the torso's lean of 7° (see gait).
# Six harmonics approximate the curves to 2°.
@pytest.mark.parametrize(
    ("name", "percent", "degrees"),
    [
        ("hip_flexion", 0, 30 - 7), ("hip_flexion", 54, -11 - 7), ("hip_flexion", 86, 32 - 7),
        ("knee_flexion", 0, 4), ("knee_flexion", 15, 19), ("knee_flexion", 40, 4.5), ("knee_flexion", 72, 62),
        ("knee_flexion", 97, 2), ("shoulder_flexion", 0, -24), ("shoulder_flexion", 50, 8), ("elbow_flexion", 54, 42),
    ],
)  # fmt: skip
def test_the_average_walker_has_the_published_angles_on_both_sides(name, percent, degrees):
    assert angle(average_subject(), f"left_{name}", percent) == pytest.approx(degrees, abs=2.0)
    assert angle(average_subject(), f"right_{name}", percent + 50) == pytest.approx(degrees, abs=2.0)


def stances(subject, motion):
    """Yield (side, frames) of each single support, 10 to 50 % of a foot's cycle."""
    phases = subject.phase + subject.stride_hz * np.arange(len(motion)) / motion.rate_hz
    for side, shift in (("left", 0.0), ("right", 0.5)):
        cycle, part = np.divmod(phases + shift, 1.0)
        for k in np.unique(cycle)[1:-1]:
            yield side, np.flatnonzero((cycle == k) & (part >= 0.1) & (part <= 0.5))


@pytest.mark.parametrize("subject", PEOPLE, ids=lambda subject: subject.name)
@pytest.mark.parametrize("path", ["straight", "circle"])
def test_feet_stand_on_the_ground(subject, path):
    motion = walker(subject, 5.0, 60.0, path)
    positions = joints(person_skeleton(subject.shape), motion.poses)
    lowest = positions[:, list(ANKLES.values()), 2].min(axis=1)
    sole = 0.039 / 0.246 * subject.shape.calf
    # Ankles of recorded walks rise by 14 mm while the foot is flat (CMU, 102 cycles, 10 to 40 % of the cycle).
    assert np.abs(lowest - sole).max() < 0.014
    for side, frames in stances(subject, motion):
        slide = np.linalg.norm(np.ptp(positions[frames, ANKLES[side], :2], axis=0))
        # A foot's roll moves its ankle by up to 6 cm; on the circle it also turns, 10 cm behind the root, by 0.26 rad.
        # A speed that is wrong by a fifth gives 10 cm on a straight path.
        assert slide < (0.06 if path == "straight" else 0.06 + 0.026)


@pytest.mark.parametrize("subject", PEOPLE, ids=lambda subject: subject.name)
def test_speed_rise_and_sway_are_those_of_people(subject):
    motion = walker(subject, 20.0 / subject.stride_hz, 60.0)  # 20 cycles
    path = motion.poses[-1, :2] - motion.poses[0, :2]
    assert 0.9 < path[0] * subject.stride_hz / 20.0 < 1.7  # m/s
    assert abs(path[1]) < 0.01
    assert 0.02 < np.ptp(motion.poses[:, 2]) < 0.06  # the pelvis' rise and fall (Inman, Ralston & Todd 1981: 4–5 cm)
    assert 0.01 < np.ptp(motion.poses[:, 1]) < 0.08


def test_the_heading_follows_the_circle():
    subject = average_subject()
    motion = walker(subject, 12.0, 60.0, "circle")
    centred = motion.poses[:, :2] - [0.0, 2.0]
    assert np.linalg.norm(centred, axis=1) == pytest.approx(2.0, abs=0.05)  # half the sideways sway
    tangent = np.unwrap(np.arctan2(centred[:, 1], centred[:, 0])) + np.pi / 2.0
    heading = motion.poses[:, POSE_NAMES.index("root_heading")]
    assert tangent[-1] > 2.0 * np.pi  # more than one round
    # the torso turns by 3° and lurches forward by 2 cm at a radius of 2 m
    assert np.degrees(np.abs(heading - tangent)).max() < 4.0
