"""Cycles of activities: interpolation against slerp of quaternions, angles of rotations, and cutting into cycles."""

import logging
from dataclasses import replace

import numpy as np
import pytest

from tests.oracles.kinematics import forward as forward_oracle
from workbench.body.shape import from_height
from workbench.body.skeleton import N_ROOT, PARTS, POSE_NAMES, Skeleton, person_skeleton
from workbench.motion.models.activity_cycles import activity_cycles, concatenated, cut, normalised
from workbench.motion.synthetic.gait import builtin_motions
from workbench.motion.synthetic.run_gait import average_runner, runner
from workbench.utils.errors import InputError

PERSON = person_skeleton(from_height(1.75))
S = np.sqrt(0.5)
TILTED = {
    "hinge": [(S, 0.0, S)],
    "two": [(0.0, 1.0, 0.0), (S, 0.0, -S)],
    "three": [(0.0, S, S), (1.0, 0.0, 0.0), (0.0, S, -S)],
}


def chain(axes):
    """Return a skeleton of a root and a chain of joints that turn about the given axes."""
    joints = [*["root"] * 6, *(name for name, directions in axes.items() for _ in directions)]
    names = ("root", *axes)
    directions = np.vstack([np.eye(3), [(0, 0, 1), (0, 1, 0), (1, 0, 0)], *axes.values()]).astype(float)
    offsets = np.vstack([np.zeros(3), np.tile([0.0, 0.0, -0.4], (len(axes), 1))])
    numbers = np.array([names.index(joint) for joint in joints])
    dofs = tuple(f"{joint}_{k}" for k, joint in enumerate(joints))
    limits = np.tile([-1.5, 1.5], (len(joints), 1))
    return Skeleton(names, np.arange(len(names)) - 1, offsets, dofs, numbers, directions, limits)


def swings(skeleton, n, amplitude, rng):
    """Return smooth random poses (n, P) of one period around the middle of the limits."""
    phase = 2.0 * np.pi * np.arange(n)[:, None] / (n - 1)
    poses = np.zeros((n, len(skeleton.dof_names)))
    waves = np.sin(phase + rng.uniform(0.0, 6.0, poses.shape[1])) + 0.4 * np.sin(2 * phase + rng.uniform(0.0, 6.0))
    poses[:, N_ROOT:] = skeleton.limits[N_ROOT:].mean(axis=1) + amplitude * waves[:, N_ROOT:]
    poses[:, :N_ROOT] = rng.normal(size=(n, N_ROOT))  # the root must not matter
    poses[-1] = poses[0]
    return poses


def relative(skeleton, poses):
    """Return the rotations (F, J, 3, 3) of all joints without the root in their parents' frames."""
    rotations = forward_oracle(skeleton, poses).rotations
    return rotations[:, skeleton.parents[1:]].swapaxes(-1, -2) @ rotations[:, 1:]


def quaternions(rotations):
    """Return quaternions (…, 4), w first and positive, of rotations by less than π."""
    w = 0.5 * np.sqrt(1.0 + np.trace(rotations, axis1=-2, axis2=-1))
    turns = rotations - rotations.swapaxes(-1, -2)
    vector = np.stack([turns[..., 2, 1], turns[..., 0, 2], turns[..., 1, 0]], axis=-1) / (4.0 * w[..., None])
    return np.concatenate([w[..., None], vector], axis=-1)


def slerp(first, second, fraction):
    """Return the slerp of quaternions (…, 4) along the shorter arc (Shoemake 1985)."""
    dot = (first * second).sum(axis=-1, keepdims=True)
    second, dot = np.where(dot < 0.0, -second, second), np.abs(dot)
    angle = np.arccos(np.minimum(dot, 1.0))
    small = angle < 1e-7
    sine = np.where(small, 1.0, np.sin(angle))
    first_weight = np.where(small, 1.0 - fraction, np.sin((1.0 - fraction) * angle) / sine)
    second_weight = np.where(small, fraction, np.sin(fraction * angle) / sine)
    return first_weight * first + second_weight * second


@pytest.mark.parametrize(
    "skeleton", [PERSON, chain({k: TILTED[k] for k in ("hinge", "three")})], ids=["person", "chain"]
)
def test_rotations_between_frames_are_the_slerp_along_the_shorter_arc(skeleton):
    """The signs of the quaternions are random; joints have one or three turns."""
    rng = np.random.default_rng(3)
    poses = swings(skeleton, 9, 0.5, rng)
    (angles,) = normalised(skeleton, poses, np.array([[0.0, 8.0]]), 32)
    interpolated = np.zeros((32, poses.shape[1]))
    interpolated[:, N_ROOT:] = angles
    keys = quaternions(relative(skeleton, poses)) * rng.choice([-1.0, 1.0], (9, len(skeleton.names) - 1, 1))
    places = 8.0 * np.arange(32) / 32
    before = places.astype(int)
    expected = slerp(keys[before], keys[before + 1], (places - before)[:, None, None])
    agreement = np.abs((quaternions(relative(skeleton, interpolated)) * expected).sum(axis=-1))
    assert agreement == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("skeleton", [PERSON, chain(TILTED)], ids=["person", "chain"])
def test_angles_at_the_frames_are_those_of_the_poses(skeleton):
    poses = swings(skeleton, 17, 0.5, np.random.default_rng(4))
    (angles,) = normalised(skeleton, poses, np.array([[0.0, 16.0]]), 16)
    assert angles == pytest.approx(poses[:-1, N_ROOT:], abs=1e-12)


def test_angles_are_continuous_beyond_half_a_turn():
    poses = np.zeros((21, 25))
    turn = POSE_NAMES.index("left_shoulder_abduction")
    poses[:, turn] = 2.9 + 0.5 * np.sin(2.0 * np.pi * np.arange(21) / 20.0)  # to 195°
    (angles,) = normalised(PERSON, poses, np.array([[0.0, 20.0]]), 20)
    assert angles[:, turn - N_ROOT] == pytest.approx(poses[:-1, turn], abs=1e-12)


def test_the_gap_of_a_cycle_is_closed_from_both_ends():
    poses = np.zeros((11, 25))
    knee = POSE_NAMES.index("left_knee_flexion")
    poses[:, knee] = 0.5 + 0.02 * np.arange(11)
    (angles,) = normalised(PERSON, poses, np.array([[0.0, 10.0]]), 10)
    assert angles[:, knee - N_ROOT] == pytest.approx(0.6, abs=1e-12)


@pytest.mark.parametrize("axes", [[(1, 0, 0), (S, S, 0)], [(1, 0, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0)]])
def test_joints_with_unsupported_axes_are_named(axes):
    skeleton = chain({"odd": axes})
    with pytest.raises(InputError, match="odd"):
        normalised(skeleton, np.zeros((5, len(skeleton.dof_names))), np.array([[0.0, 4.0]]), 8)


@pytest.mark.parametrize("stride_hz", [1.0 / 0.9, 1.0 / 0.7, 1.0 / 0.55])
def test_running_cycles_are_cut_where_the_left_thigh_is_foremost(stride_hz):
    subject = replace(average_runner(), stride_hz=stride_hz)
    cycles = activity_cycles([runner(subject, 5.0, 120.0)], n_phases=100)
    assert len(cycles) == 4
    assert cycles.durations_s[1:3] == pytest.approx(1.0 / stride_hz, abs=0.2 / 120.0)  # peaks between the frames
    assert cycles.durations_s == pytest.approx(1.0 / stride_hz, rel=0.02)  # the filter is less exact at a clip's ends
    truth = subject.angles(np.arange(1000) / 1000)[:, 3:]
    errors = [np.abs(cycles.curves[1] - np.roll(truth, -shift, axis=0)[::10]).max() for shift in range(1000)]
    # half a thousandth of a cycle at the knee's 700° a cycle, and the events' fractions of a frame
    assert np.degrees(min(errors)) < 1.0
    left, right = (POSE_NAMES.index(f"{side}_hip_flexion") - N_ROOT for side in ("left", "right"))
    swing = truth[:, left] - truth[:, right]
    assert swing[np.argmin(errors)] > 0.97 * swing.max()  # the events' low-pass filter shifts an asymmetric peak


def test_a_clip_gives_at_most_the_maximal_number_of_cycles():
    (motion,) = builtin_motions(1)
    assert len(activity_cycles([motion], max_per_clip=100)) == 4
    cycles = activity_cycles([motion], max_per_clip=2, n_phases=8)
    assert (cycles.sources, cycles.activities) == ((motion.name,) * 2, ("walk",) * 2)
    assert len(activity_cycles([motion, motion], max_per_clip=2)) == 4


def test_motions_without_a_cycle_are_named(caplog):
    (motion,) = builtin_motions(1)
    still = replace(motion, name="statue", poses=np.repeat(motion.poses[:1], 300, axis=0))
    with caplog.at_level(logging.WARNING):
        assert set(activity_cycles([still, motion]).sources) == {motion.name}
    assert "statue" in caplog.text
    with pytest.raises(InputError, match="no cycle"):
        activity_cycles([still])
    with pytest.raises(InputError, match="1 cycle"):
        activity_cycles([motion], max_per_clip=0)


def test_angles_are_chosen_by_name_or_part():
    cycles = activity_cycles(builtin_motions(1), n_phases=8)
    legs = cycles.of_angles(["lower_body"])
    assert legs.angles == PARTS["lower_body"]
    columns = [cycles.angles.index(name) for name in legs.angles]
    np.testing.assert_array_equal(legs.curves, cycles.curves[:, :, columns])
    assert cycles.of_angles(["right_knee_flexion", "left_arm"]).angles == (*PARTS["left_arm"], "right_knee_flexion")
    with pytest.raises(InputError, match="tail"):
        cycles.of_angles(["body", "tail"])


def test_any_skeleton_is_cut_between_given_events():
    skeleton = chain(TILTED)
    poses = np.vstack([swings(skeleton, 31, 0.3, np.random.default_rng(6))[:-1]] * 4)
    labels = {"activity": "skip", "source": "chain"}
    events = np.array([0.0, 30.0, 60.0, 64.0, 90.0])
    cycles = cut(skeleton, poses, events, rate_hz=30.0, n_phases=30, **labels)
    assert cycles.angles == skeleton.dof_names[N_ROOT:]
    assert cycles.durations_s == pytest.approx([1.0, 1.0, 26.0 / 30.0])  # 4 frames are too short for a cycle
    assert cycles.curves[1] == pytest.approx(poses[:30, N_ROOT:], abs=1e-12)
    assert len(cut(skeleton, poses, np.array([3.0]), rate_hz=30.0, **labels)) == 0
    both = concatenated([cycles, cycles.only(np.array([True, False, False]))])
    assert len(both) == len(both.sources) == len(both.durations_s) == 4
    with pytest.raises(InputError, match="walker_00"):
        concatenated([cycles, activity_cycles(builtin_motions(1), n_phases=30)])
