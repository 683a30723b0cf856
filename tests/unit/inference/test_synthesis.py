"""Synthesis: steps against those of the prior, look-ahead, blending of jumps, and foot contact."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from workbench.body.limbs import person
from workbench.body.shape import from_height
from workbench.body.skeleton import N_ROOT, POSE_NAMES, person_skeleton
from workbench.core.dataset import SequenceInfo
from workbench.core.frame import Frame
from workbench.inference import synthesis
from workbench.inference.synthesis import (
    GROUND_RATE,
    PLANTED_SPEED,
    FootContact,
    JumpBlending,
    Synthesis,
    ankle_positions,
    jump_deg,
)
from workbench.motion.models.windows import learn_windows
from workbench.motion.synthetic.gait import builtin_motions
from workbench.priors.implicit import Implicit
from workbench.priors.smooth import Smooth
from workbench.utils.errors import InputError

WITHOUT_NOISE = {"sigma_position": (0.0,) * 3, "sigma_rotation": (0.0,) * 3, "sigma_angles": 0.0}
NEAREST = {"beta": 1e-6, **WITHOUT_NOISE}
"""Options with which the nearest window is always drawn."""
UNPROCESSED = {"blend_time_s": 0.0, "foot_contact": False}
START = 30
"""The frame of the motions in which synthesis begins."""


@pytest.fixture(scope="module")
def motions():
    """Four clips at 30 Hz, of two activities."""
    clips = [motion.resampled(30.0) for motion in builtin_motions(n_subjects=4)]
    return [replace(motion, activity="run" if i % 2 else "walk") for i, motion in enumerate(clips)]


@pytest.fixture(scope="module")
def windows(motions):
    return learn_windows(motions)


def info_with_history(motion, frame=START, step=1):
    """Return information with every `step`-th pose of a motion up to a frame as the pose history."""
    poses = motion.poses[: frame + 1][::-step][::-1]
    return SequenceInfo("clip", 0, rate_hz=30.0 / step, pose_history=poses, pose_history_activity=motion.activity)


def frames(n, rate_hz=30.0):
    return [Frame(i, i / rate_hz, ()) for i in range(n)]


def streams(seed=0):
    return {name: np.random.default_rng([seed, i]) for i, name in enumerate(("start", "prior"))}


def run(prior, motion, n=20, pose_history=True, rate_hz=30.0, seed=0, **options):
    info = info_with_history(motion, step=round(30.0 / rate_hz)) if pose_history else None
    inference = Synthesis(prior, person(motion.shape), info, **{**UNPROCESSED, **options})
    return list(inference.run(frames(n, rate_hz), motion.poses[START], streams(seed)))


def test_a_motion_of_the_library_is_continued_as_recorded_without_noise(windows, motions):
    steps = run(Implicit(windows, **NEAREST), motions[1], n=40)
    poses = np.array([step.expected_pose for step in steps])
    assert poses == pytest.approx(motions[1].poses[START : START + 40], abs=2e-4)  # sums of float32 differences


def test_a_frame_interval_of_three_library_frames_takes_three_transitions(windows, motions):
    prior, rng = Implicit(windows), streams()["prior"]
    first, *steps = run(prior, motions[1], n=10, rate_hz=10.0)
    state = first.particles
    for step in steps:
        for _ in range(3):
            state = prior.sample_transition(state, 1 / 30, rng)
        assert (step.particles == state).all()


def test_a_pose_history_at_half_the_rate_of_the_library_is_interpolated(windows, motions):
    info = info_with_history(motions[1], step=2)
    inference = Synthesis(Implicit(windows, **NEAREST), person(motions[1].shape), info, **UNPROCESSED)
    step = next(inference.run(frames(2, rate_hz=15.0), info.pose_history[-1], streams()))
    (expected,) = run(Implicit(windows, **NEAREST), motions[1], n=1)
    # The coefficients, in deviations, differ by the error of the spline.
    assert step.particles == pytest.approx(expected.particles, abs=0.03)


def test_other_priors_take_one_transition_per_frame(motions):
    prior, rngs = Smooth(), streams()
    steps = run(prior, motions[0], n=5)
    state = prior.sample_initial(motions[0].poses[START], 1, rngs["start"])
    for step in steps:
        assert step.expected_pose == pytest.approx(prior.pose(state)[0])  # frame intervals are rounded
        assert step.warnings == ()
        assert "same_activity" not in step.diagnostics
        assert step.activity is None
        state = prior.sample_transition(state, 1 / 30, rngs["prior"])


def test_a_missing_initial_pose_is_rejected(windows, motions):
    inference = Synthesis(Implicit(windows), person(motions[0].shape), info_with_history(motions[0]), **UNPROCESSED)
    with pytest.raises(InputError, match="initial pose"):
        list(inference.run(frames(2), None, streams()))


def test_an_unknown_activity_is_not_compared(windows, motions):
    info = replace(info_with_history(motions[0]), pose_history_activity=None)
    inference = Synthesis(Implicit(windows), person(motions[0].shape), info, **UNPROCESSED)
    steps = list(inference.run(frames(3), motions[0].poses[START], streams()))
    assert all("same_activity" not in step.diagnostics for step in steps)


def test_an_incomplete_pose_history_is_reported(windows, motions, monkeypatch):
    for name in ("POSITION", "ROTATION", "ANGLE"):
        monkeypatch.setattr(f"workbench.priors.implicit.INITIAL_{name}_STD", 0.0)
    prior = Implicit(windows, **WITHOUT_NOISE)
    steps = run(prior, motions[0], pose_history=False)
    assert "has 0 of the 11 frames" in steps[0].warnings[0]
    assert all(step.warnings == () for step in steps[1:])
    assert (steps[0].expected_pose == motions[0].poses[START]).all()
    inference = Synthesis(prior, person(motions[0].shape), info_with_history(motions[0], 9), **UNPROCESSED)
    (step,) = inference.run(frames(1), motions[0].poses[9], streams())
    assert "has 10 of the 11 frames" in step.warnings[0]


def test_the_jump_is_the_largest_change_of_a_joint_angle(windows, motions):
    steps = run(Implicit(windows), motions[0])
    assert "jump_deg" not in steps[0].diagnostics
    for previous, step in pairwise(steps):
        change = step.expected_pose[N_ROOT:] - previous.expected_pose[N_ROOT:]
        assert step.diagnostics["jump_deg"] == pytest.approx(np.degrees(np.abs(change)).max())


def test_the_jump_ignores_the_root_and_whole_turns():
    previous, pose = np.zeros(len(POSE_NAMES)), np.zeros(len(POSE_NAMES))
    pose[:N_ROOT], pose[N_ROOT], pose[N_ROOT + 1] = 5.0, 2.0 * np.pi + 0.1, -0.2
    assert jump_deg(previous, pose) == pytest.approx(np.degrees(0.2))


@pytest.mark.parametrize(("index", "same_activity"), [(0, True), (1, True), (1, False)])
def test_the_activity_is_that_of_the_drawn_windows(windows, motions, index, same_activity):
    """The first step has the activity of the pose history."""
    drawn, other = motions[index].activity, motions[1 - index].activity
    history = drawn if same_activity else other
    steps = run(Implicit(windows, **NEAREST), replace(motions[index], activity=history))
    assert [step.activity for step in steps] == [history, *[drawn] * 19]
    assert "same_activity" not in steps[0].diagnostics
    assert [step.diagnostics["same_activity"] for step in steps[1:]] == [float(same_activity)] * 19


def followers_of_draws(prior, motion, monkeypatch, **options):
    """Return the number of frames that follow each window drawn near the end of a clip."""
    followers, draw = [], Implicit.draw

    def recording_draw(self, probes, rng):
        entries = draw(self, probes, rng)
        followers.extend(self.windows.followers[entries])
        return entries

    monkeypatch.setattr(Implicit, "draw", recording_draw)
    info = info_with_history(motion, len(motion) - 8)
    inference = Synthesis(prior, person(motion.shape), info, **{**UNPROCESSED, **options})
    list(inference.run(frames(6), info.pose_history[-1], streams()))
    return np.array(followers)


def test_look_ahead_excludes_windows_with_too_few_following_frames(windows, motions, monkeypatch):
    prior = Implicit(windows, **NEAREST)
    assert followers_of_draws(prior, motions[0], monkeypatch).min() < 4
    assert followers_of_draws(prior, motions[0], monkeypatch, look_ahead=4).min() >= 4
    assert prior.windows is windows  # the prior is unchanged


def test_followers_are_the_remaining_rows_of_the_clip(windows, motions):
    for entry in (0, 5, len(windows) - 1):
        clip = windows.clip_of[entry]
        end_of_clip = windows.firsts[clip] + len(motions[clip]) - 1  # a clip has one row fewer than frames
        assert windows.followers[entry] == end_of_clip - 1 - windows.ends[entry]
    assert windows.followers.min() == 1
    assert windows.clips == tuple(motion.name for motion in motions)


def test_look_ahead_avoids_windows_with_successors_far_from_the_library():
    """The successors of every second window are far from all windows."""
    n_pose, coefficients = len(POSE_NAMES), np.array([[0.0], [0.1], [0.0], [0.1]])

    def predict(states, entries, noise):
        predicted = states.copy()
        predicted[:, n_pose] = np.where(entries % 2 == 1, 10.0, 0.0)
        return predicted

    prior = SimpleNamespace(
        beta=0.1, space=SimpleNamespace(slices={"coefficients": slice(n_pose, n_pose + 1)}), predict=predict,
        windows=SimpleNamespace(coefficients=coefficients), draw=lambda probes, rng: rng.integers(4, size=len(probes)),
    )  # fmt: skip
    state, rng = np.zeros((1, n_pose + 1)), np.random.default_rng(0)

    def rate(look_ahead):
        return np.mean([synthesis._draw(prior, state, look_ahead, rng)[1] % 2 for _ in range(200)])

    assert rate(look_ahead=1) < 0.03  # all eight candidates are such windows with probability 1/256
    assert 0.3 < rate(look_ahead=0) < 0.7


DT, TAU, LIMIT = 1 / 30, 0.1, 0.3
DECAY = 1.0 - np.exp(-DT / TAU)
"""Fraction of an offset that is removed per frame."""


def blended(angles, tau=TAU):
    """Return one blended angle of the poses."""
    blending, poses = JumpBlending(tau, LIMIT), np.zeros((len(angles), len(POSE_NAMES)))
    poses[:, 10] = angles
    return np.array([blending.update(pose, DT)[10] for pose in poses])


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.01, 3.0))
def test_no_angle_changes_by_more_than_the_threshold_and_the_decay(seed, size):
    poses = size * np.random.default_rng(seed).standard_normal((30, len(POSE_NAMES)))
    blending = JumpBlending(TAU, LIMIT)
    previous, offset = blending.update(poses[0], DT), np.zeros(len(POSE_NAMES) - 3)
    for pose in poses[1:]:
        current = blending.update(pose, DT)
        assert (np.abs(current - previous)[3:] <= LIMIT + DECAY * np.abs(offset) + 1e-9).all()
        turns = (current[3:] - blending.offset - pose[3:]) / (2.0 * np.pi)
        assert turns == pytest.approx(np.rint(turns), abs=1e-9)  # the sum of pose and offset, up to whole turns
        assert (current[:3] == pose[:3]).all()
        previous, offset = current, blending.offset.copy()


def test_the_offset_of_a_jump_decays_exponentially():
    jump = 2.0
    offset = (jump - LIMIT) * np.exp(-DT / TAU * np.arange(40))
    assert blended([0.0] + [jump] * 40)[1:] == pytest.approx(jump - offset)


def test_changes_below_the_threshold_are_not_blended():
    angles = np.cumsum(np.random.default_rng(0).uniform(-LIMIT, LIMIT, 60))
    assert blended(angles) == pytest.approx(angles)


def test_a_whole_turn_is_no_jump():
    assert blended([0.1, 0.2, 0.3 + 2.0 * np.pi, 0.4]) == pytest.approx([0.1, 0.2, 0.3, 0.4])


def test_jumps_are_unchanged_without_a_blend_time():
    assert blended([0.0, 3.0, -3.0], tau=0.0).tolist() == [0.0, 3.0, -3.0]


@pytest.fixture(scope="module")
def walk():
    return builtin_motions(n_subjects=1)[0].resampled(30.0)


def shifted_by_contact(skeleton, poses, ground_m):
    """Return the shifted poses (F, P) and the index of the planted ankle in each frame, -1 for none."""
    contact, shifted, planted = FootContact(skeleton, ground_m), [], []
    for pose in poses:
        shifted.append(contact.update(pose, DT))
        planted.append(-1 if contact.planted is None else contact.planted)
    return np.array(shifted), np.array(planted)


def test_the_planted_ankle_of_a_sliding_and_sinking_body_does_not_move(walk):
    skeleton = person_skeleton(walk.shape)
    ground = ankle_positions(skeleton, walk.poses)[..., 2].min()
    sliding = walk.poses.copy()
    sliding[:, :3] += np.arange(len(walk))[:, None] * DT * [0.2, 0.1, -0.05]  # m/s
    shifted, planted = shifted_by_contact(skeleton, sliding, ground)
    assert (shifted[:, 3:] == sliding[:, 3:]).all()
    ankles = ankle_positions(skeleton, shifted)
    t = np.flatnonzero((planted[1:] == planted[:-1]) & (planted[1:] >= 0)) + 1
    assert len(t) > len(walk) / 3  # most of the time one foot of a walker is flat on the ground
    change = ankles[t, planted[t]] - ankles[t - 1, planted[t]]
    assert np.abs(change[:, :2]).max() < 1e-9
    original = ankle_positions(skeleton, sliding)
    original_change = original[t, planted[t]] - original[t - 1, planted[t]]
    assert np.abs(original_change[:, :2]).max() > 0.2 * DT
    # Without contact the walk ends 30 cm below the ground.
    assert np.abs(ankles[t[-10:], planted[t[-10:]], 2] - ground).max() < 0.03


def test_a_standing_foot_approaches_the_ground_exponentially():
    skeleton = person_skeleton(from_height(1.75))
    poses = np.zeros((6, len(POSE_NAMES)))
    height = ankle_positions(skeleton, poses[:1])[0, 0, 2]
    shifted, planted = shifted_by_contact(skeleton, poses, height - 0.08)
    assert planted[0] == -1  # a first pose has no speed
    assert (planted[1:] >= 0).all()
    above = ankle_positions(skeleton, shifted)[:, 0, 2] - (height - 0.08)
    assert above == pytest.approx(0.08 * (1.0 - GROUND_RATE) ** np.arange(6))


def test_fast_feet_and_feet_high_above_the_ground_are_not_planted():
    skeleton = person_skeleton(from_height(1.75))
    flight = np.zeros((10, len(POSE_NAMES)))
    flight[:, 0] = np.arange(10) * DT * 1.01 * PLANTED_SPEED
    hanging = np.zeros((10, len(POSE_NAMES)))
    ground = ankle_positions(skeleton, hanging[:1])[0, 0, 2]
    for poses, below in ((flight, 0.0), (hanging, 1.0)):
        shifted, planted = shifted_by_contact(skeleton, poses, ground - below)
        assert (planted == -1).all()
        assert (shifted == poses).all()


def test_the_shift_is_continuous_at_landing_and_takeoff(walk):
    skeleton = person_skeleton(walk.shape)
    ground = ankle_positions(skeleton, walk.poses)[..., 2].min()
    shifted, planted = shifted_by_contact(skeleton, walk.poses, ground)
    assert set(planted) == {-1, 0, 1}
    shift = np.diff(shifted[:, :3] - walk.poses[:, :3], axis=0)
    # Per frame the horizontal shift changes by at most the motion of a planted ankle.
    assert np.linalg.norm(shift[:, :2], axis=1).max() <= PLANTED_SPEED * DT + 1e-12
    assert np.abs(shift[planted[1:] == -1]).max() < 1e-12
