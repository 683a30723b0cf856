"""Synthesis: draws against the prior's own steps, look-ahead, smoothing of jumps, and foot contact."""

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

STILL = {"sigma_position": (0.0,) * 3, "sigma_rotation": (0.0,) * 3, "sigma_angles": 0.0}
CERTAIN = {"beta": 1e-6, **STILL}  # so cold that an entry's own window finds nothing but itself
PLAIN = {"blend_time_s": 0.0, "foot_contact": False}
AT = 30  # the frame that motions start from


@pytest.fixture(scope="module")
def motions():
    """Four clips at 30 Hz, of two activities."""
    four = [motion.resampled(30.0) for motion in builtin_motions(n_subjects=4)]
    return [replace(motion, activity="run" if i % 2 else "walk") for i, motion in enumerate(four)]


@pytest.fixture(scope="module")
def windows(motions):
    return learn_windows(motions)


def until(motion, frame=AT, every=1):
    """What a dataset knows of the poses before the start."""
    poses = motion.poses[: frame + 1][::-every][::-1]
    return SequenceInfo("clip", 0, rate_hz=30.0 / every, pose_history=poses, pose_history_activity=motion.activity)


def frames(n, rate_hz=30.0):
    return [Frame(i, i / rate_hz, ()) for i in range(n)]


def streams(seed=0):
    return {name: np.random.default_rng([seed, i]) for i, name in enumerate(("start", "prior"))}


def run(prior, motion, n=20, pose_history=True, rate_hz=30.0, seed=0, **options):
    before = until(motion, every=round(30.0 / rate_hz))
    inference = Synthesis(prior, person(motion.shape), before if pose_history else None, **{**PLAIN, **options})
    return list(inference.run(frames(n, rate_hz), motion.poses[AT], streams(seed)))


def test_without_noise_a_known_motion_goes_on_as_recorded(windows, motions):
    steps = run(Implicit(windows, **CERTAIN), motions[1], n=40)
    poses = np.array([step.expected_pose for step in steps])
    assert poses == pytest.approx(motions[1].poses[AT : AT + 40], abs=2e-4)  # float32 rows, added up


def test_frames_apart_by_several_of_the_librarys_take_several_draws(windows, motions):
    prior, own = Implicit(windows), streams()["prior"]
    first, *steps = run(prior, motions[1], n=10, rate_hz=10.0)
    state = first.particles
    for step in steps:
        for _ in range(3):
            state = prior.sample_transition(state, 1 / 30, own)
        assert (step.particles == state).all()


def test_the_lead_in_may_have_another_rate(windows, motions):
    """Which is that of the frames: 15 Hz, of which the library's 30 Hz is a multiple."""
    known = until(motions[1], every=2)
    inference = Synthesis(Implicit(windows, **CERTAIN), person(motions[1].shape), known, **PLAIN)
    step = next(inference.run(frames(2, rate_hz=15.0), known.pose_history[-1], streams()))
    (expected,) = run(Implicit(windows, **CERTAIN), motions[1], n=1)
    # the same window but for what a spline through half of it leaves, of coefficients in deviations
    assert step.particles == pytest.approx(expected.particles, abs=0.03)


def test_other_priors_take_their_own_steps(motions):
    prior = Smooth()
    steps = run(prior, motions[0], n=5)
    own = streams()
    state = prior.sample_initial(motions[0].poses[AT], 1, own["start"])
    for step in steps:
        assert step.expected_pose == pytest.approx(prior.pose(state)[0])  # times apart are rounded
        assert step.warnings == ()
        assert "same_activity" not in step.diagnostics
        assert step.activity is None
        state = prior.sample_transition(state, 1 / 30, own["prior"])


def test_without_a_start_or_an_activity_there_is_nothing_to_compare_with(windows, motions):
    inference = Synthesis(
        Implicit(windows), person(motions[0].shape), replace(until(motions[0]), pose_history_activity=None), **PLAIN
    )
    with pytest.raises(InputError, match="initial pose"):
        list(inference.run(frames(2), None, streams()))
    steps = list(inference.run(frames(3), motions[0].poses[AT], streams()))
    assert all("same_activity" not in step.diagnostics for step in steps)


def test_a_start_from_the_pose_alone_is_told(windows, motions, monkeypatch):
    for name in ("POSITION", "ROTATION", "ANGLE"):
        monkeypatch.setattr(f"workbench.priors.implicit.INITIAL_{name}_STD", 0.0)
    prior = Implicit(windows, **STILL)
    steps = run(prior, motions[0], pose_history=False)
    assert "has 0 of the 11 frames" in steps[0].warnings[0]
    assert all(step.warnings == () for step in steps[1:])
    assert (steps[0].expected_pose == motions[0].poses[AT]).all()
    short = Synthesis(prior, person(motions[0].shape), until(motions[0], 9), **PLAIN)
    (step,) = short.run(frames(1), motions[0].poses[9], streams())
    assert "has 10 of the 11 frames" in step.warnings[0]


def test_jump_is_the_largest_change_of_a_joint_angle(windows, motions):
    steps = run(Implicit(windows), motions[0])
    assert "jump_deg" not in steps[0].diagnostics
    for before, step in pairwise(steps):
        change = step.expected_pose[N_ROOT:] - before.expected_pose[N_ROOT:]
        assert step.diagnostics["jump_deg"] == pytest.approx(np.degrees(np.abs(change)).max())


def test_the_root_and_whole_turns_are_no_jump():
    before, after = np.zeros(len(POSE_NAMES)), np.zeros(len(POSE_NAMES))
    after[:N_ROOT], after[N_ROOT], after[N_ROOT + 1] = 5.0, 2.0 * np.pi + 0.1, -0.2
    assert jump_deg(before, after) == pytest.approx(np.degrees(0.2))


@pytest.mark.parametrize("which", [0, 1])
def test_same_activity_is_that_of_the_clips_drawn_from(windows, motions, which):
    steps = run(Implicit(windows, **CERTAIN), motions[which])
    assert "same_activity" not in steps[0].diagnostics
    assert [step.diagnostics["same_activity"] for step in steps[1:]] == [1.0] * 19
    assert {step.activity for step in steps} == {motions[which].activity}
    other = replace(motions[which], activity=motions[1 - which].activity)
    told = [step.activity for step in run(Implicit(windows, **CERTAIN), other)]
    assert told == [other.activity, *[motions[which].activity] * 19]  # of the start, then of what is drawn
    assert [step.diagnostics["same_activity"] for step in run(Implicit(windows, **CERTAIN), other)[1:]] == [0.0] * 19


def entries_drawn(prior, motion, monkeypatch, **options):
    """How many frames follow every window drawn near a clip's end, also of draws that are not kept."""
    drawn = []
    own = Implicit.draw

    def spy(self, probes, rng):
        entries = own(self, probes, rng)
        drawn.extend(self.windows.followers[entries])
        return entries

    monkeypatch.setattr(Implicit, "draw", spy)
    last = until(motion, len(motion) - 8)
    inference = Synthesis(prior, person(motion.shape), last, **{**PLAIN, **options})
    list(inference.run(frames(6), last.pose_history[-1], streams()))
    return np.array(drawn)


def test_look_ahead_never_draws_a_window_that_ends_within_it(windows, motions, monkeypatch):
    prior = Implicit(windows, **CERTAIN)
    assert entries_drawn(prior, motions[0], monkeypatch).min() < 4  # such windows are nearest here
    assert entries_drawn(prior, motions[0], monkeypatch, look_ahead=4).min() >= 4
    assert prior.windows is windows  # the prior itself is as it was


def test_followers_are_the_rows_left_in_the_clip(windows, motions):
    for entry in (0, 5, len(windows) - 1):
        clip = windows.clip_of[entry]
        end_of_clip = windows.firsts[clip] + len(motions[clip]) - 1  # a clip has one row less than frames
        assert windows.followers[entry] == end_of_clip - 1 - windows.ends[entry]
    assert windows.followers.min() == 1
    assert windows.clips == tuple(motion.name for motion in motions)


def test_look_ahead_avoids_a_dead_end():
    """One of two entries leads to a place far from all entries: of candidates, those that drew the other are taken."""
    n_pose, places = len(POSE_NAMES), np.array([[0.0], [0.1], [0.0], [0.1]])

    def predict(states, entries, noise):
        moved = states.copy()
        moved[:, n_pose] = np.where(entries % 2 == 1, 10.0, 0.0)
        return moved

    prior = SimpleNamespace(
        beta=0.1, space=SimpleNamespace(slices={"coefficients": slice(n_pose, n_pose + 1)}), predict=predict,
        windows=SimpleNamespace(coefficients=places), draw=lambda probes, rng: rng.integers(4, size=len(probes)),
    )  # fmt: skip
    state, rng = np.zeros((1, n_pose + 1)), np.random.default_rng(0)
    taken = [synthesis._draw(prior, state, 1, rng)[1] % 2 for _ in range(200)]
    assert np.mean(taken) < 0.03  # all eight candidates are dead ends once in 256
    blind = [synthesis._draw(prior, state, 0, rng)[1] % 2 for _ in range(200)]
    assert 0.3 < np.mean(blind) < 0.7


DT, TAU, LIMIT = 1 / 30, 0.1, 0.3
LET_GO = 1.0 - np.exp(-DT / TAU)


def poses_of(angle):
    poses = np.zeros((len(angle), len(POSE_NAMES)))
    poses[:, 10] = angle
    return poses


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.01, 3.0))
def test_no_angle_changes_by_more_than_the_limit_and_what_is_let_go(seed, size):
    poses = size * np.random.default_rng(seed).standard_normal((30, len(POSE_NAMES)))
    smoother, shown, offset = JumpBlending(TAU, LIMIT), None, np.zeros(len(POSE_NAMES) - 3)
    for pose in poses:
        now = smoother.update(pose, DT)
        if shown is not None:
            assert (np.abs(now - shown)[3:] <= LIMIT + LET_GO * np.abs(offset) + 1e-9).all()
        turns = (now[3:] - smoother.offset - pose[3:]) / (2.0 * np.pi)
        assert turns == pytest.approx(np.rint(turns), abs=1e-9)  # the pose and the offset, but for whole turns
        assert (now[:3] == pose[:3]).all()
        shown, offset = now, smoother.offset.copy()


def test_a_jump_is_let_go_exponentially():
    jump = 2.0
    smoother = JumpBlending(TAU, LIMIT)
    shown = np.array([smoother.update(pose, DT)[10] for pose in poses_of([0.0] + [jump] * 40)])
    left = (jump - LIMIT) * np.exp(-DT / TAU * np.arange(40))
    assert shown[1:] == pytest.approx(jump - left)


def test_motion_within_the_limit_passes_unchanged():
    poses = poses_of(np.cumsum(np.random.default_rng(0).uniform(-LIMIT, LIMIT, 60)))
    smoother = JumpBlending(TAU, LIMIT)
    assert np.array([smoother.update(pose, DT) for pose in poses]) == pytest.approx(poses)


def test_a_whole_turn_is_no_jump():
    smoother = JumpBlending(TAU, LIMIT)
    shown = [smoother.update(pose, DT)[10] for pose in poses_of([0.1, 0.2, 0.3 + 2.0 * np.pi, 0.4])]
    assert shown == pytest.approx([0.1, 0.2, 0.3, 0.4])


def test_without_smoothing_jumps_stay():
    poses = poses_of([0.0, 3.0, -3.0])
    smoother = JumpBlending(0.0, LIMIT)
    assert (np.array([smoother.update(pose, DT) for pose in poses]) == poses).all()


@pytest.fixture(scope="module")
def walk():
    return builtin_motions(n_subjects=1)[0].resampled(30.0)


def follow(skeleton, poses, ground_m):
    """The shifted poses (F, P), and which ankle is planted in each frame, -1 for none."""
    contact, shifted, planted = FootContact(skeleton, ground_m), [], []
    for pose in poses:
        shifted.append(contact.update(pose, DT))
        planted.append(-1 if contact.planted is None else contact.planted)
    return np.array(shifted), np.array(planted)


def test_the_planted_ankle_stays_though_the_body_slides_and_sinks(walk):
    skeleton = person_skeleton(walk.shape)
    ground = ankle_positions(skeleton, walk.poses)[..., 2].min()
    sliding = walk.poses.copy()
    sliding[:, :3] += np.arange(len(walk))[:, None] * DT * [0.2, 0.1, -0.05]  # m/s
    shifted, planted = follow(skeleton, sliding, ground)
    assert (shifted[:, 3:] == sliding[:, 3:]).all()
    ankles = ankle_positions(skeleton, shifted)
    held = np.flatnonzero((planted[1:] == planted[:-1]) & (planted[1:] >= 0)) + 1
    assert len(held) > len(walk) / 3  # it walks: most of the time a foot is flat on the ground
    moved = ankles[held, planted[held]] - ankles[held - 1, planted[held]]
    assert np.abs(moved[:, :2]).max() < 1e-9  # held exactly, to rounding
    before = ankle_positions(skeleton, sliding)
    slid = before[held, planted[held]] - before[held - 1, planted[held]]
    assert np.abs(slid[:, :2]).max() > 0.2 * DT  # which is what it makes up for
    # Without contact the walk ends 30 cm below the ground.
    assert np.abs(ankles[held[-10:], planted[held[-10:]], 2] - ground).max() < 0.03


def test_a_standing_foot_settles_on_the_ground():
    skeleton = person_skeleton(from_height(1.75))
    poses = np.zeros((6, len(POSE_NAMES)))
    height = ankle_positions(skeleton, poses[:1])[0, 0, 2]
    shifted, planted = follow(skeleton, poses, height - 0.08)
    assert planted[0] == -1  # a first pose has no speed
    assert (planted[1:] >= 0).all()
    above = ankle_positions(skeleton, shifted)[:, 0, 2] - (height - 0.08)
    assert above == pytest.approx(0.08 * (1.0 - GROUND_RATE) ** np.arange(6))


def test_a_body_in_flight_and_a_slow_foot_high_up_are_left_alone():
    skeleton = person_skeleton(from_height(1.75))
    flight = np.zeros((10, len(POSE_NAMES)))
    flight[:, 0] = np.arange(10) * DT * 1.01 * PLANTED_SPEED
    hanging = np.zeros((10, len(POSE_NAMES)))
    ground = ankle_positions(skeleton, hanging[:1])[0, 0, 2]
    for poses, below in ((flight, 0.0), (hanging, 1.0)):
        shifted, planted = follow(skeleton, poses, ground - below)
        assert (planted == -1).all()
        assert (shifted == poses).all()


def test_landing_and_taking_off_make_no_jump(walk):
    skeleton = person_skeleton(walk.shape)
    ground = ankle_positions(skeleton, walk.poses)[..., 2].min()
    shifted, planted = follow(skeleton, walk.poses, ground)
    assert set(planted) == {-1, 0, 1}
    shift = np.diff(shifted[:, :3] - walk.poses[:, :3], axis=0)
    # In a frame the shift makes up for at most a slow ankle's way, and half of what is missing to the ground.
    assert np.linalg.norm(shift[:, :2], axis=1).max() <= PLANTED_SPEED * DT + 1e-12
    assert np.abs(shift[planted[1:] == -1]).max() < 1e-12
