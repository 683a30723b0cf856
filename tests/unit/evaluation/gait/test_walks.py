"""Strikes, steps and speeds of generated walks and runs agree with how they were generated."""

from dataclasses import fields

import numpy as np
import pytest
from walking_scenes import HEIGHT_M, Scene, on_treadmill, scene, standing

from workbench.body.skeleton import POSE_NAMES
from workbench.evaluation.gait.foot_events import MIN_SEPARATION, MIN_STRIDE_S, _strike, _toe_off, foot_events
from workbench.evaluation.gait.stretches import CUTOFF_HZ, low_passed
from workbench.evaluation.gait.strides import BELT_SPEED, MAX_STRIDE_S, MAX_TURN_RAD, Strides, is_run
from workbench.motion.synthetic.gait import average_subject, subjects, walker
from workbench.motion.synthetic.run_gait import average_runner, runner, runners

WALKERS = [average_subject(), *subjects(3, np.random.default_rng(1))]
RUNNERS = [average_runner(), *runners(3, np.random.default_rng(2))]


def speed_of(motion):
    return float(motion.poses[-1, 0] - motion.poses[0, 0]) * motion.rate_hz / (len(motion) - 1)


@pytest.mark.parametrize("rate_hz", [25.0, 30.0, 60.0])
@pytest.mark.parametrize(("make", "people"), [(walker, WALKERS), (runner, RUNNERS)])
def test_strikes_are_within_35_ms(make, people, rate_hz):
    for person in people:
        stretch = scene(make(person, 6.0, rate_hz)).stretch()
        for foot, events in enumerate(foot_events(stretch, HEIGHT_M, runs=make is runner)):
            phases = person.phase + person.stride_hz * events.strikes_s[0] - 0.5 * foot
            errors_s = (phases - np.rint(phases)) / person.stride_hz
            assert len(errors_s) >= 4
            assert np.abs(errors_s).max() < 0.035


@pytest.mark.parametrize(("make", "people"), [(walker, WALKERS), (runner, RUNNERS)])
def test_cadence_speed_and_steps_agree_with_the_motion(make, people):
    for person in people:
        motion = make(person, 6.0, 30.0)
        walk = scene(motion).walk()
        measures = walk.parameters
        speed = speed_of(motion)
        assert measures["cadence_steps_min"]["both"][0] == pytest.approx(120.0 * person.stride_hz, rel=0.01)
        assert measures["speed_m_s"]["both"][0] == pytest.approx(speed, rel=0.015)
        for side in ("left", "right"):
            assert measures["stride_length_m"][side][0] == pytest.approx(speed / person.stride_hz, abs=0.03)
            assert measures["step_length_m"][side][0] == pytest.approx(0.5 * speed / person.stride_hz, abs=0.04)
            assert measures["stride_time_s"][side][0] == pytest.approx(1.0 / person.stride_hz, rel=0.01)
        assert not walk.on_belt
        assert walk.is_run == (make is runner)
        assert (walk.n_turning, walk.n_irregular) == (0, 0)


def test_the_sum_of_both_step_times_is_the_stride_time():
    measures = scene(walker(average_subject(), 8.0, 30.0)).walk().parameters
    both = measures["step_time_s"]["left"] + measures["step_time_s"]["right"]
    np.testing.assert_allclose(both, measures["stride_time_s"]["left"], rtol=0.01)


def test_a_shorter_right_step_is_found():
    """The right foot lands 0.1 m farther back, relative to the pelvis, in every frame."""
    straight = scene(walker(average_subject(), 8.0, 30.0))
    shifted = straight.poses.copy()
    length = straight.joints[0, 0, 9, 2] - straight.joints[0, 0, 11, 2]
    shifted[..., POSE_NAMES.index("right_hip_flexion")] -= 0.1 / length
    measures = Scene(straight.skeleton, straight.times_s, shifted).walk().parameters["step_length_m"]
    assert measures["left"][0] - measures["right"][0] == pytest.approx(0.2, abs=0.06)


def test_a_treadmill_is_recognised_and_its_speed_measured():
    motion = walker(average_subject(), 8.0, 30.0)
    speed = speed_of(motion)
    ground, belt = scene(motion).walk(), on_treadmill(scene(motion), speed).walk()
    assert not ground.on_belt
    assert belt.on_belt
    # the standing ankles of this walker move ahead by an eighth of the speed, those of recorded ones by a fiftieth
    assert belt.parameters["speed_m_s"]["both"][0] == pytest.approx(speed, rel=0.15)
    for name in ("cadence_steps_min", "stance_fraction", "step_width_m"):
        for side, values in belt.parameters[name].items():
            np.testing.assert_allclose(values, ground.parameters[name][side], rtol=0.02)


@pytest.mark.parametrize(("part", "on_belt"), [(0.9, True), (1.1, False)])
def test_a_belt_is_one_from_half_of_the_walking_speed(part, on_belt):
    """Feet move backwards at BELT_SPEED of the speed relative to the pelvis: a little more, or less."""
    motion = scene(walker(average_subject(), 8.0, 30.0))
    slope = on_treadmill(motion, 1.0).walk().standing_speed - motion.walk().standing_speed
    speed = (BELT_SPEED / part - motion.walk().standing_speed) / slope
    walk = on_treadmill(motion, speed).walk()
    assert walk.on_belt == on_belt
    assert walk.standing_speed == pytest.approx(BELT_SPEED / part, abs=0.02)


def test_every_sample_has_the_steps_of_the_expected_motion():
    rng = np.random.default_rng(0)
    motion = scene(walker(average_subject(), 6.0, 30.0))
    samples = motion.poses + rng.normal(0.0, 0.005, (12, 1, len(POSE_NAMES)))
    many = Scene(motion.skeleton, motion.times_s, np.concatenate([motion.poses, samples])).walk()
    one = motion.walk()
    assert np.isfinite(many.strides[0].starts_s).all()
    for name, sides in one.parameters.items():
        for side, values in sides.items():
            np.testing.assert_allclose(many.parameters[name][side][0], values[0], rtol=1e-9)
            np.testing.assert_allclose(many.parameters[name][side], values[0], rtol=0.12, atol=0.02)


def test_uneven_frames_give_the_same_steps():
    rng = np.random.default_rng(0)
    whole = scene(walker(average_subject(), 8.0, 60.0))
    rows = np.sort(rng.choice(len(whole.times_s), len(whole.times_s) // 2, replace=False))
    uneven, even = whole.frames(rows).walk().parameters, whole.walk().parameters
    assert uneven["cadence_steps_min"]["both"] == pytest.approx(even["cadence_steps_min"]["both"], rel=0.01)
    assert uneven["step_length_m"]["left"] == pytest.approx(even["step_length_m"]["left"], abs=0.04)


def test_strides_in_a_lost_stretch_are_left_out():
    motion = scene(walker(average_subject(), 10.0, 30.0))
    valid = np.ones(len(motion.times_s), bool)
    valid[120:150] = False
    whole, part = motion.walk(), motion.walk(valid)
    assert 2 <= len(part.strides[0]) < len(whole.strides[0])
    lost = motion.times_s[[119, 150]]
    for strides in part.strides:
        assert not ((strides.starts_s[0] < lost[1]) & (strides.ends_s[0] > lost[0])).any()
    expected = whole.parameters["cadence_steps_min"]["both"]
    assert part.parameters["cadence_steps_min"]["both"] == pytest.approx(expected, rel=0.01)


def test_two_strides_are_enough_and_less_than_one_is_none():
    motion = scene(walker(average_subject(), 6.0, 30.0))
    short = motion.frames(slice(0, 90)).walk()
    assert 1 <= len(short.strides[0]) + len(short.strides[1]) <= 4
    assert np.isfinite(short.parameters["speed_m_s"]["both"][0])
    assert motion.frames(slice(0, 30)).walk() is None
    assert motion.frames(slice(0, 9)).walk() is None  # 0.3 s
    assert motion.frames(slice(0, 2)).walk() is None


@pytest.mark.parametrize(("part", "n_strikes"), [(0.8, 0), (1.2, 4)])
def test_steps_need_feet_that_move_apart(part, n_strikes):
    """Feet that swing in turn, by MIN_SEPARATION of the height or a little less or more."""
    still = standing(6.0)
    hip = still.joints[0, 0, 9, 2] - still.joints[0, 0, 11, 2]
    swing = np.arcsin(0.25 * part * MIN_SEPARATION * HEIGHT_M / hip) * np.sin(2.0 * np.pi * 0.9 * still.times_s)
    still.poses[0, :, POSE_NAMES.index("left_hip_flexion")] = swing
    still.poses[0, :, POSE_NAMES.index("right_hip_flexion")] = -swing
    left, right = foot_events(still.stretch(), HEIGHT_M, runs=False)
    assert min(left.strikes_s.shape[1], right.strikes_s.shape[1]) >= n_strikes
    assert n_strikes or left.strikes_s.shape[1] == right.strikes_s.shape[1] == 0


@pytest.mark.parametrize(("part", "turning"), [(0.9, False), (1.1, True)])
def test_strides_that_turn_are_left_out(part, turning):
    """A treadmill on a turntable, which turns from 4 s on, by a little less or more than allowed."""
    person = average_subject()
    motion = on_treadmill(scene(walker(person, 8.0, 30.0)), speed_of(walker(person, 8.0, 30.0)))
    turned = part * MAX_TURN_RAD * person.stride_hz * np.maximum(motion.times_s - 4.0, 0.0)
    motion.poses[0, :, POSE_NAMES.index("root_heading")] += turned
    walk = motion.walk()
    assert (walk.n_turning > 0) == turning
    assert walk.n_irregular == 0  # of the others
    assert (max(strides.starts_s.max() for strides in walk.strides) < 4.0) == turning


@pytest.mark.parametrize(("part", "measured"), [(0.95, True), (1.05, False)])
def test_long_strides_are_pauses(part, measured):
    person = average_subject()
    motion = scene(walker(person, 6.0, 30.0))
    motion.times_s = motion.times_s * part * MAX_STRIDE_S * person.stride_hz
    slow = np.arange(0.0, motion.times_s[-1], 1.0 / 30.0)
    poses = np.stack([np.interp(slow, motion.times_s, column) for column in motion.poses[0].T], axis=1)
    assert (Scene(motion.skeleton, slow, poses[None]).walk() is not None) == measured


@pytest.mark.parametrize(("part", "measured"), [(0.9, False), (1.1, True)])
def test_short_strides_are_no_steps(part, measured):
    person = average_runner()
    motion = scene(runner(person, 6.0, 100.0))
    motion.times_s = motion.times_s * part * MIN_STRIDE_S * person.stride_hz
    walk = motion.walk()
    n = 0 if walk is None else len(walk.strides[0])
    assert (n >= 6) == measured


@pytest.mark.parametrize("support", [-0.001, 0.001])
@pytest.mark.parametrize("rise", [-0.001, 0.001])
def test_a_run_flies_and_sinks(support, rise):
    """A stride of 1 s with this time of double support, s, and rise of the pelvis after the strike, m."""
    values = dict.fromkeys((field.name for field in fields(Strides)), np.zeros((1, 1)))
    values |= {"ends_s": np.ones((1, 1)), "toe_offs_s": np.full((1, 1), 0.5 + support)}
    values |= {"other_strikes_s": np.full((1, 1), 0.5), "rises_m": np.full((1, 1), rise)}
    assert is_run(Strides(**values)) == (support < 0.0 and rise < 0.0)


def parabolas(n, *tops):
    """Return values (1, n) of the largest of parabolas with tops (frame, height), and 0 elsewhere."""
    frames = np.arange(n)
    return np.max([np.zeros(n), *(height - 0.1 * (frames - top) ** 2 for top, height in tops)], axis=0)[None]


@pytest.mark.parametrize(("other", "expected"), [(21.7, 30.3), (23.3, 23.3), (36.7, 36.7), (38.3, 30.3)])
def test_a_strike_is_nearest_to_where_the_feet_are_farthest_apart(other, expected):
    """Of tops of the distance ahead, the highest within a fifth of the stride of 35 frames; 0.045 of it later."""
    strike = _strike(parabolas(60, (30.3, 1.0), (other, 1.1)), peak=30, stride=35.0)
    assert strike == pytest.approx([expected + 0.045 * 35.0])


@pytest.mark.parametrize(("other", "expected"), [(27.7, 40.3), (29.3, 29.3), (50.6, 50.6), (52.3, 40.3)])
def test_a_toe_off_is_between_three_quarters_and_a_fifth_of_a_stride_before_the_strike(other, expected):
    """Of a stride of 40 frames that ends at frame 59, the frames 29 to 51."""
    assert _toe_off(parabolas(80, (40.3, 1.0), (other, 1.1)), 59.0, 40.0) == pytest.approx([expected])


@pytest.mark.parametrize(("strike", "known"), [(9.0, False), (10.0, True)])
def test_a_toe_off_before_the_stretch_is_unknown(strike, known):
    """Of a stride of 40 frames, the last one of its frames is 8 before the strike; it needs three."""
    rising = np.arange(60.0)[None] ** 2
    assert np.isfinite(_toe_off(rising, strike, 40.0)).all() == known
    assert np.isnan(_toe_off(-rising, 30.0, 40.0)).all()  # largest in the first frame


def test_low_rates_are_not_filtered():
    values = np.random.default_rng(0).normal(size=(1, 50, 2))
    np.testing.assert_array_equal(low_passed(values, 2.5 * CUTOFF_HZ - 0.1), values)
    assert low_passed(values, 2.5 * CUTOFF_HZ).std() < values.std()


def test_the_filter_removes_what_is_above_its_cut_off():
    times_s = np.arange(200) / 100.0
    for frequency_hz, gain in ((1.0, 1.0), (CUTOFF_HZ, 0.5), (25.0, 0.0)):
        wave = np.sin(2.0 * np.pi * frequency_hz * times_s)[None]
        assert np.abs(low_passed(wave, 100.0)[0, 50:150]).max() == pytest.approx(gain, abs=0.02)
