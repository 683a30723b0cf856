"""Concatenated motions: exact frames, continuity, phase, and rendered sequences."""

from dataclasses import replace

import numpy as np
import pytest

from workbench.body.skeleton import POSE_NAMES
from workbench.datasets.rendering.concatenation import concatenate, gait_phases
from workbench.datasets.rendering.perturbations import DEFAULT_SIZES
from workbench.datasets.rendering.sequence import Scene, find_sequence, perturbed_pose
from workbench.motion.sources import find_motion
from workbench.motion.synthetic.gait import average_subject, subjects, walker

RATE_HZ = 60.0
WALK = walker(average_subject(), 6.0, RATE_HZ)
OTHER = replace(walker(subjects(1, np.random.default_rng(8))[0], 6.0, RATE_HZ, path="circle"), activity="stroll")
RUN = find_motion("builtin_run", data=None, rate_hz=RATE_HZ)


def moved(motion, angle, offset):
    """Return the motion rotated about the vertical and translated."""
    poses = motion.poses.copy()
    c, s = np.cos(angle), np.sin(angle)
    poses[:, :2] = poses[:, :2] @ np.array([[c, s], [-s, c]]) + offset
    poses[:, 3] += angle
    return replace(motion, poses=poses)


def test_one_motion_gives_exactly_its_frames():
    cut = concatenate([WALK], 40, 7)
    assert np.array_equal(cut.motion.poses, WALK.poses[7:47])
    assert np.array_equal(cut.phases, gait_phases(WALK)[7:47])
    assert not cut.clips.any()


def test_phases_agree_with_those_of_the_synthetic_walker():
    subject = average_subject()
    phases = gait_phases(WALK)
    expected = subject.phase + subject.stride_hz * np.arange(len(WALK)) / RATE_HZ
    offset = phases - expected  # the phase of the event that starts a cycle, which is constant
    # events are located to a frame, of which a cycle has 68
    assert np.ptp(offset) < 1 / 60
    assert np.diff(phases).min() > 0.0


@pytest.mark.parametrize(("first", "second"), [(WALK, OTHER), (WALK, RUN), (RUN, WALK)])
def test_positions_and_angles_are_continuous(first, second):
    joined = concatenate([first, second], 200, 20)
    steps = np.abs(np.diff(joined.motion.poses, axis=0))
    max_step = np.maximum(
        np.abs(np.diff(first.poses, axis=0)).max(axis=0), np.abs(np.diff(second.poses, axis=0)).max(axis=0)
    )
    # within the blend of 18 frames the difference of the motions, at most their range, is added to their own steps;
    # the blend weight changes by at most 1.5 / 18 per frame
    poses = np.concatenate([first.poses, second.poses])
    allowed = 2.0 * max_step + 1.5 / 18.0 * np.ptp(poses, axis=0)
    angles = [i for i, name in enumerate(POSE_NAMES) if not name.startswith("root_")]
    assert (steps[:, angles] < allowed[angles]).all()
    speed = np.linalg.norm(np.diff(joined.motion.poses[:, :2], axis=0), axis=1)
    max_speed = max(np.linalg.norm(np.diff(m.poses[:, :2], axis=0), axis=1).max() for m in (first, second))
    assert speed.max() < 1.15 * max_speed  # speeds are scaled by the ratio of leg lengths
    assert list(joined.clips) == [0] * 100 + [1] * 100


def test_frames_outside_of_the_blend_are_those_of_the_motions():
    joined = concatenate([WALK, moved(WALK, 1.2, [5.0, -3.0])], 200, 20).motion
    assert np.allclose(joined.poses[:90], WALK.poses[20:110], atol=1e-12)  # rounding of cumulative sums
    tail = joined.poses[110:, 3:]
    errors = [np.abs(tail[:, 1:] - WALK.poses[i : i + 90, 4:]).max() for i in range(len(WALK) - 90)]
    assert min(errors) == 0.0


def test_the_second_motion_begins_at_the_phase_of_the_first():
    """A periodic walk concatenated with itself is the same walk."""
    joined = concatenate([WALK, WALK], 200, 20)
    subject = average_subject()
    expected = subject.angles(subject.phase + subject.stride_hz * (np.arange(200) + 20) / RATE_HZ)
    # phases agree to 0.02 cycles and half a frame; angles change by up to 7.5 rad per cycle (the knee in its swing)
    assert np.abs(joined.motion.poses[:, 6:] - expected[:, 3:]).max() < 7.5 * (0.02 + 1 / 136)
    assert np.diff(joined.phases).min() > 0.0


def test_steps_are_scaled_to_the_legs_of_the_first_person():
    tall = replace(WALK, shape=WALK.shape.scaled(1.1))
    unscaled, scaled = concatenate([WALK, WALK], 240).motion, concatenate([WALK, tall], 240).motion
    distances = [np.linalg.norm(m.poses[-1, :2] - m.poses[140, :2]) for m in (unscaled, scaled)]
    assert distances[1] / distances[0] == pytest.approx(1 / 1.1)
    assert scaled.poses[-1, 2] / unscaled.poses[-1, 2] == pytest.approx(1 / 1.1)


def test_motions_without_gait_cycles_are_concatenated():
    still = replace(WALK, poses=np.repeat(WALK.poses[:1], 300, axis=0))
    joined = concatenate([WALK, still, RUN], 210)
    assert list(np.bincount(joined.clips)) == [70, 70, 70]
    assert np.allclose(joined.motion.poses[90:120, 6:], still.poses[0, 6:])
    assert np.isfinite(joined.motion.poses).all()


def test_a_sequence_is_the_motion_at_the_frame_rate_with_its_truth():
    sequence = find_sequence(Scene(motion="builtin", n_frames=20, first_frame=3))
    assert np.array_equal(sequence.motion.poses, find_motion("builtin", data=None, rate_hz=56.0).poses[12:89:4])
    assert [truth.activity for truth in sequence.truths] == ["walk"] * 20
    first, last = sequence.phase_ends
    # 0.92 strides per second with a standard deviation of 11 % between subjects; events are located to 1/56 s
    assert last - first == pytest.approx(19 / 14 * 0.92, rel=0.15)
    assert sequence.places.shape == (20, 15, 3)


def test_a_sequence_of_two_motions_has_the_activity_of_each():
    sequence = find_sequence(Scene(motion=["builtin", "builtin_run"], n_frames=28))
    activities = [truth.activity for truth in sequence.truths]
    assert activities == ["walk"] * 14 + ["run"] * 14
    speeds = 14.0 * np.linalg.norm(np.diff(sequence.motion.poses[:, :2], axis=0), axis=1)
    assert speeds[:11].max() < 2.0 < speeds[16:].min()  # walking is slower than 2 m/s and running faster


def test_the_perturbed_initial_pose_has_its_standard_deviations_and_is_reproducible():
    sequence = find_sequence(Scene(motion="builtin", n_frames=4))
    skeleton, pose = sequence.body.skeleton, sequence.motion.poses[0]
    assert np.array_equal(*(perturbed_pose(skeleton, pose, 3, DEFAULT_SIZES) for _ in range(2)))
    errors = np.stack([perturbed_pose(skeleton, pose, seed, DEFAULT_SIZES) for seed in range(400)]) - pose
    # 4 standard errors of a σ from 1200 numbers; the other angles are clipped at their limits
    assert errors[:, :3].std() == pytest.approx(0.03, rel=4 / np.sqrt(2400))
    assert errors[:, 3:6].std() == pytest.approx(0.05, rel=4 / np.sqrt(2400))
