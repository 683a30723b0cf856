"""Cutting walks into cycles, and their PCA against known components."""

from functools import partial

import numpy as np
import pytest

from workbench.body.shape import from_height
from workbench.body.skeleton import N_ROOT, POSE_NAMES
from workbench.motion.models.walking import (
    CHANNEL_NAMES,
    ROOT_CHANNELS,
    component_counts,
    learn_walking,
    walking_cycles,
)
from workbench.motion.pose_sequence import Motion, gait_events
from workbench.utils.errors import InputError

RATE = 60.0
T = 48
PAPER = {"variance": 0.95, "n_components": None, "scaling": "none"}


def curves(phase, first=0.0, second=0.0):
    """Return joint angles (F, 19) of a walk with two components at phases (F,); at 0 the left thigh is foremost."""
    angles = np.zeros((len(phase), 19))
    names = POSE_NAMES[N_ROOT:]
    wave, knee = np.cos(2 * np.pi * phase), np.sin(2 * np.pi * phase)
    angles[:, names.index("left_hip_flexion")] = 0.5 * wave
    angles[:, names.index("right_hip_flexion")] = -0.5 * wave
    angles[:, names.index("left_knee_flexion")] = 0.6 + 0.4 * knee + first * np.cos(4 * np.pi * phase)
    angles[:, names.index("right_elbow_flexion")] = 0.3 + second * np.sin(6 * np.pi * phase)
    return angles


def walk(first=0.0, second=0.0, cycle_s=1.1, n_cycles=3.5, speed=1.3, heading=0.4, name="walk"):
    times = np.arange(int(n_cycles * cycle_s * RATE)) / RATE
    poses = np.zeros((len(times), 25))
    poses[:, 0], poses[:, 1] = speed * times * np.cos(heading), speed * times * np.sin(heading)
    poses[:, 2], poses[:, 3] = 0.95, heading
    poses[:, N_ROOT:] = curves(times / cycle_s - 0.25, first, second)
    return Motion(name, "s", "walk", RATE, poses, from_height(1.75), np.zeros(14), "made", "0" * 64, "none")


def test_events_are_where_the_left_thigh_is_foremost():
    motion = walk(cycle_s=1.1)
    expected = (0.25 + np.arange(4)) * 1.1 * RATE
    assert gait_events(motion) == pytest.approx(expected, abs=0.5)  # the filtered signal is cut off at its ends


def test_cycles_recover_the_curves():
    cycles = walking_cycles([walk(first=0.1, second=-0.05)], n_phases=T)
    assert cycles.curves.shape == (3, T, len(CHANNEL_NAMES))
    assert cycles.durations_s == pytest.approx(1.1, abs=0.4 / RATE)
    expected = curves(np.arange(T) / T, 0.1, -0.05)
    # an event off by 0.2 of 66 frames moves the steepest curve (0.1 × 4π + 0.4 × 2π rad a cycle) by 0.012 rad
    assert cycles.curves[1, :, 1:] == pytest.approx(expected, abs=0.015)
    assert cycles.curves[:, :, 0] == pytest.approx(1.3, abs=1e-6)


def test_a_short_motion_has_no_cycles():
    assert len(walking_cycles([walk(n_cycles=0.9)]).curves) == 0
    with pytest.raises(InputError, match="two walking cycles"):
        learn_walking([walk(n_cycles=0.9)], **PAPER)


def two_component_walks(n=14, seed=0):
    rng = np.random.default_rng(seed)
    return [walk(first=0.12 * a, second=0.06 * b, name=f"walk{i}") for i, (a, b) in enumerate(rng.normal(size=(n, 2)))]


@pytest.mark.parametrize("scaling", ["none", "joints"])
def test_pca_recovers_the_true_components(scaling):
    model = learn_walking(two_component_walks(), **PAPER | {"n_components": 2, "scaling": scaling}, n_phases=T)
    assert model.explained > 0.95  # the rest is due to the events' errors of up to half a frame
    span = model.components.reshape(2, -1)
    for a, b in ((0.1, 0.0), (0.0, 0.1)):
        expected = np.zeros((T, len(CHANNEL_NAMES)))
        expected[:, 1:] = curves(np.arange(T) / T, a, b) - curves(np.arange(T) / T)
        solution, *_ = np.linalg.lstsq(span.T, expected.ravel(), rcond=None)
        residual = np.linalg.norm(expected.ravel() - solution @ span) / np.linalg.norm(expected)
        assert residual < 0.15  # because of the events' errors


def test_coefficients_have_the_stated_standard_deviations():
    """The training cycles' projections on the components have deviations λ and no correlation."""
    motions = two_component_walks()
    model = learn_walking(motions, **PAPER | {"n_components": 3}, n_phases=T)
    weights = np.ones(len(CHANNEL_NAMES))
    weights[0] = 1 / 30
    rows = ((walking_cycles(motions, T).curves - model.mean) * weights).reshape(-1, T * len(CHANNEL_NAMES))
    basis = (model.components * weights).reshape(3, -1)
    assert basis @ basis.T == pytest.approx(np.eye(3), abs=1e-9)
    covariance = np.cov(rows @ basis.T, rowvar=False)
    assert covariance == pytest.approx(np.diag(model.scales**2), abs=1e-9)


def test_the_number_of_components_follows_the_variance():
    few, many = (learn_walking(two_component_walks(), **PAPER | {"variance": v}, n_phases=T) for v in (0.5, 0.999))
    assert len(few.scales) < len(many.scales)
    assert few.explained > 0.5
    assert many.explained > 0.999
    one_less = learn_walking(two_component_walks(), **PAPER | {"n_components": len(many.scales) - 1}, n_phases=T)
    assert one_less.explained <= 0.999  # the fewest that explain more


def swaying(heading_rate=0.0, **options):
    """Return a walk whose root sways across by 2 cm and turns by 0.1 rad once a cycle, and rises by 1 cm twice."""
    motion = walk(n_cycles=4.5, heading=0.0, **options)
    times = np.arange(len(motion)) / RATE
    phase = 2 * np.pi * (times / 1.1 - 0.25)
    heading = 0.4 + heading_rate * times
    path = np.cumsum(1.3 / RATE * np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
    motion.poses[:, :2] = path + 0.02 * np.sin(phase)[:, None] * np.column_stack([-np.sin(heading), np.cos(heading)])
    motion.poses[:, 2] = 0.95 + 0.01 * np.cos(2 * phase) + 0.02 * times
    motion.poses[:, 3], motion.poses[:, 4] = heading + 0.1 * np.cos(phase), 0.05
    return motion


@pytest.mark.parametrize("heading_rate", [0.0, 0.3])
def test_the_sway_of_the_root_is_recovered_on_straight_and_curved_paths(heading_rate):
    cycles = walking_cycles([swaying(heading_rate)], n_phases=T, include_root=True)
    phase = 2 * np.pi * np.arange(T) / T
    assert cycles.curves.shape[2] == len(CHANNEL_NAMES) + len(ROOT_CHANNELS)
    sway = cycles.curves[:, :, len(CHANNEL_NAMES) :]
    expected = [0.02 * np.sin(phase), 0.01 * np.cos(2 * phase), 0.1 * np.cos(phase), 0 * phase, 0 * phase]
    # an event off by 0.2 of 66 frames moves the steepest curve (0.1 × 2π a cycle) by 2 mrad; the sway across is
    # integrated from central differences, which reduce velocities by 0.2 %
    assert sway == pytest.approx(np.broadcast_to(np.transpose(expected), sway.shape), abs=3e-3)


def test_the_published_torso_speed_is_the_norm_of_the_velocity():
    motion = walk(heading=0.4)
    times = np.arange(len(motion)) / RATE
    motion.poses[:, :3] += times[:, None] * [-0.5 * np.sin(0.4), 0.5 * np.cos(0.4), 0.3]  # across and upward, m/s
    expected = {"forward": 1.3, "norm": np.linalg.norm([1.3, 0.5, 0.3])}
    for torso_speed, speed in expected.items():
        assert walking_cycles([motion], T, torso_speed=torso_speed).curves[:, :, 0] == pytest.approx(speed, abs=1e-6)
        model = learn_walking([motion, motion], **PAPER | {"torso_speed": torso_speed, "n_components": 1}, n_phases=T)
        assert model.mean[:, 0] == pytest.approx(speed, abs=1e-6)


def test_component_counts_of_small_training_sets_are_the_true_ones():
    motions = two_component_walks(24)
    cycles, people = walking_cycles(motions, T), {motion.name: f"person {i % 6}" for i, motion in enumerate(motions)}
    draw = partial(component_counts, cycles, people, 20, 0.9)
    counts = draw(np.random.default_rng(0))
    assert set(counts) <= {1, 2}
    assert (counts == draw(np.random.default_rng(0))).all()
    few = {name: f"person {i % 3}" for i, name in enumerate(people)}
    with pytest.raises(InputError, match="4 people, found 3"):
        component_counts(cycles, few, 20, 0.9, np.random.default_rng(0))
