"""Motions spliced: cut to the bit, continuous, in phase, and not longer than they are."""

from dataclasses import replace

import numpy as np
import pytest

from workbench.body.skeleton import POSE_NAMES
from workbench.datasets.rendering.concatenation import concatenate, gait_phases
from workbench.datasets.rendering.sequence import Scene, find_sequence
from workbench.motion.sources import find_motion
from workbench.motion.synthetic.gait import average_subject, subjects, walker

RATE = 60.0
WALK = walker(average_subject(), 6.0, RATE)
OTHER = replace(walker(subjects(1, np.random.default_rng(8))[0], 6.0, RATE, path="circle"), activity="stroll")
RUN = find_motion("builtin_run", data=None, rate_hz=RATE)


def turned(motion, angle, offset):
    """The same motion elsewhere in the world."""
    poses = motion.poses.copy()
    c, s = np.cos(angle), np.sin(angle)
    poses[:, :2] = poses[:, :2] @ np.array([[c, s], [-s, c]]) + offset
    poses[:, 3] += angle
    return replace(motion, poses=poses)


def test_one_motion_is_cut_to_the_bit():
    cut = concatenate([WALK], 40, 7)
    assert np.array_equal(cut.motion.poses, WALK.poses[7:47])
    assert np.array_equal(cut.phases, gait_phases(WALK)[7:47])
    assert not cut.clips.any()


def test_phases_count_the_cycles_of_a_walker_whose_phase_is_known():
    subject = average_subject()
    phases = gait_phases(WALK)
    expected = subject.phase + subject.stride_hz * np.arange(len(WALK)) / RATE
    offset = phases - expected  # where in the cycle the left thigh is furthest ahead, and whole cycles
    # no more than a frame off, of which a cycle has 68; beyond the first and last event by what these are off
    assert np.ptp(offset) < 1 / 60
    assert np.diff(phases).min() > 0.0


def test_a_motion_without_cycles_has_no_phases():
    still = replace(WALK, poses=np.repeat(WALK.poses[:1], 200, axis=0))
    assert np.isnan(gait_phases(still)).all()
    assert np.isnan(gait_phases(replace(WALK, poses=WALK.poses[:5]))).all()


@pytest.mark.parametrize(("first", "second"), [(WALK, OTHER), (WALK, RUN), (RUN, WALK)])
def test_place_heading_and_angles_are_continuous(first, second):
    joined = concatenate([first, second], 200, 20)
    steps = np.abs(np.diff(joined.motion.poses, axis=0))
    either = np.maximum(
        np.abs(np.diff(first.poses, axis=0)).max(axis=0), np.abs(np.diff(second.poses, axis=0)).max(axis=0)
    )
    # where one motion passes into the other, over 18 frames, the difference between the two adds to their own steps;
    # an eased weight changes by 1.5 / 18 a frame at most, and the two are never further apart than their ranges
    both = np.concatenate([first.poses, second.poses])
    allowed = 2.0 * either + 1.5 / 18.0 * np.ptp(both, axis=0)
    angles = [i for i, name in enumerate(POSE_NAMES) if not name.startswith("root_")]
    assert (steps[:, angles] < allowed[angles]).all()
    ground = np.linalg.norm(np.diff(joined.motion.poses[:, :2], axis=0), axis=1)
    fastest = max(np.linalg.norm(np.diff(m.poses[:, :2], axis=0), axis=1).max() for m in (first, second))
    assert ground.max() < 1.15 * fastest  # legs of other lengths scale it by at most 190 / 158 cm over each other
    assert list(joined.clips) == [0] * 100 + [1] * 100


def test_before_and_after_the_blend_each_motion_is_itself():
    joined = concatenate([WALK, turned(WALK, 1.2, [5.0, -3.0])], 200, 20).motion
    assert np.allclose(joined.poses[:90], WALK.poses[20:110], atol=1e-12)  # sums of steps
    tail = joined.poses[110:, 3:]
    distances = [np.abs(tail[:, 1:] - WALK.poses[i : i + 90, 4:]).max() for i in range(len(WALK) - 90)]
    assert min(distances) == 0.0


def test_the_next_motion_is_entered_in_phase():
    """A walk spliced with itself is the walk: its curves are periodic, so the same phase is the same pose."""
    joined = concatenate([WALK, WALK], 200, 20)
    subject = average_subject()
    expected = subject.angles(subject.phase + subject.stride_hz * (np.arange(200) + 20) / RATE)
    # phases agree to 0.02 of a cycle and half a frame; an angle rises by up to 7.5 rad a cycle (the knee in its swing)
    assert np.abs(joined.motion.poses[:, 6:] - expected[:, 3:]).max() < 7.5 * (0.02 + 1 / 136)
    assert np.diff(joined.phases).min() > 0.0


def test_where_in_the_world_the_next_motion_was_does_not_matter():
    moved = turned(OTHER, 2.0, [30.0, 4.0])
    moved.poses[:, 6:] += 2.0 * np.pi * np.round(np.random.default_rng(0).uniform(-2, 2, 19))
    assert np.allclose(
        concatenate([WALK, OTHER], 200).motion.poses, concatenate([WALK, moved], 200).motion.poses, atol=1e-9
    )


def test_longer_legs_take_longer_steps():
    tall = replace(WALK, shape=WALK.shape.scaled(1.1))
    plain, scaled = concatenate([WALK, WALK], 240).motion, concatenate([WALK, tall], 240).motion
    way = [np.linalg.norm(m.poses[-1, :2] - m.poses[140, :2]) for m in (plain, scaled)]
    assert way[1] / way[0] == pytest.approx(1 / 1.1)  # the walk of the tall one, done by the first, smaller person
    assert scaled.poses[-1, 2] / plain.poses[-1, 2] == pytest.approx(1 / 1.1)


def test_three_motions_and_motions_without_cycles():
    still = replace(WALK, poses=np.repeat(WALK.poses[:1], 300, axis=0))
    joined = concatenate([WALK, still, RUN], 210)
    assert list(np.bincount(joined.clips)) == [70, 70, 70]
    assert np.allclose(joined.motion.poses[90:120, 6:], still.poses[0, 6:])
    assert np.isfinite(joined.motion.poses).all()


def test_a_take_is_the_motion_at_its_rate_with_its_truth():
    take = find_sequence(Scene(motion="builtin", n_frames=20, first_frame=3))
    assert np.array_equal(take.motion.poses, find_motion("builtin", data=None, rate_hz=56.0).poses[12:89:4])
    assert [truth.activity for truth in take.truths] == ["walk"] * 20
    first, last = take.phase_ends
    # subjects stride 0.92 times a second, give or take 11 %; an event lies a frame of 1/56 s off at most
    assert last - first == pytest.approx(19 / 14 * 0.92, rel=0.15)
    assert take.places.shape == (20, 15, 3)


def test_a_take_of_several_motions_tells_each_ones_activity():
    take = find_sequence(Scene(motion=["builtin", "builtin_run"], n_frames=28))
    activities = [truth.activity for truth in take.truths]
    assert activities == ["walk"] * 14 + ["run"] * 14
    speeds = 14.0 * np.linalg.norm(np.diff(take.motion.poses[:, :2], axis=0), axis=1)
    assert speeds[:11].max() < 2.0 < speeds[16:].min()  # nobody walks as fast as 2 m/s, or runs slower


def test_the_rough_start_is_as_far_off_as_it_says_and_the_same_every_time():
    take = find_sequence(Scene(motion="builtin", n_frames=4))
    assert np.array_equal(take.perturbed_initial_pose(3), take.perturbed_initial_pose(3))
    errors = np.stack([take.perturbed_initial_pose(seed) for seed in range(400)]) - take.motion.poses[0]
    # 4 standard errors of a σ from 1200 numbers; angles at their limits are left out
    assert errors[:, :3].std() == pytest.approx(0.03, rel=4 / np.sqrt(2400))
    assert errors[:, 3:6].std() == pytest.approx(0.05, rel=4 / np.sqrt(2400))
