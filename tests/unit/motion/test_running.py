"""Generated runners: flight, feet and speeds, and their cycles against those of walkers."""

import numpy as np
import pytest

from workbench.body.kinematics import joints
from workbench.body.skeleton import person_skeleton
from workbench.motion.models.activities import held_out_accuracy, learn_activities
from workbench.motion.models.activity_cycles import activity_cycles
from workbench.motion.synthetic.gait import ANKLE_HEIGHT, builtin_motions
from workbench.motion.synthetic.run_gait import (
    FOOT_ROLL,
    GRAVITY,
    STANCE,
    average_runner,
    bounce,
    builtin_runs,
    runner,
    runners,
)

PEOPLE = [average_runner(), *runners(4, np.random.default_rng(7))]


def test_the_body_falls_freely_in_the_flight_and_is_pushed_in_the_stance():
    rate = 1.4
    phases = np.linspace(0.0, 1.0, 4001)
    height = bounce(phases, rate)
    assert height.mean() == pytest.approx(0.0, abs=1e-4)
    step = 1.0 / 4000 / rate
    acceleration = np.diff(height, 2) / step**2
    inside = phases[1:-1] % 0.5
    flight = (inside > STANCE + 0.02) & (inside < 0.48)
    # 128 harmonics of a force that has a kink where the foot lands
    assert acceleration[flight] == pytest.approx(-GRAVITY, abs=0.05 * GRAVITY)
    middle = np.abs(inside - 0.5 * STANCE) < 0.01
    assert acceleration[middle] / GRAVITY + 1.0 == pytest.approx(0.25 * np.pi / STANCE, abs=0.05)
    drop_m = bounce(np.array([0.435]), rate)[0] - bounce(np.array([0.5]), rate)[0]  # from the top of the flight
    assert drop_m == pytest.approx(0.5 * GRAVITY * (0.065 / rate) ** 2, rel=0.02)


@pytest.mark.parametrize("subject", PEOPLE, ids=lambda subject: subject.name)
def test_feet_stand_on_the_ground_and_roll(subject):
    motion = runner(subject, 4.0, 120.0)
    skeleton = person_skeleton(subject.shape)
    positions = joints(skeleton, motion.poses)
    phases = subject.phase + subject.stride_hz * np.arange(len(motion)) / motion.rate_hz
    sole = ANKLE_HEIGHT * subject.shape.calf
    for side, shift in (("left", 0.0), ("right", 0.5)):
        ankle, cycle = positions[:, skeleton.joint(f"{side}_ankle")], phases - shift
        # individual half degrees in four harmonics of each side move an ankle at 0.85 m by up to 2 cm
        assert ankle[:, 2].min() > sole - 0.02
        cycles = np.arange(np.ceil(cycle[0]), np.floor(cycle[-1]))
        for k in cycles:
            landing, leaving = (np.searchsorted(cycle, k + part) for part in (0.0, STANCE))
            roll = ankle[leaving, 0] - ankle[landing, 0]
            # a frame is 1 % of a cycle of 2.2 m; the right foot's individual angles differ from the left foot's
            assert roll == pytest.approx(FOOT_ROLL * subject.shape.calf, abs=0.06)
        assert len(cycles) >= 3


def test_speeds_and_rises_are_those_of_published_runners():
    """Novacheck's curves are for 3.2 m/s; the variation of stride and cadence is 20 % of it."""
    motions = builtin_runs()
    speeds = [motion.poses[-1, 0] / (len(motion) - 1) * motion.rate_hz for motion in motions]
    assert np.mean(speeds) == pytest.approx(3.2, abs=0.3)
    assert 2.4 < min(speeds) < max(speeds) < 4.0
    rise = [np.ptp(motion.poses[:, 2]) for motion in motions]
    assert 0.05 < min(rise) < max(rise) < 0.11  # Cavanagh & Kram's runners rise and fall by 6 to 10 cm


def test_runs_have_running_cycles_and_are_classified():
    cycles = activity_cycles([*builtin_motions(4), *builtin_runs(4)], n_phases=32)
    runs = np.array(cycles.activities) == "run"
    assert (cycles.durations_s[runs] > 0.55).all()
    assert (cycles.durations_s[runs] < 0.9).all()
    assert (cycles.durations_s[~runs] > 0.9).all()
    knee = cycles.angles.index("left_knee_flexion")
    assert cycles.curves[runs][:, :, knee].max() > np.radians(80.0) > cycles.curves[~runs][:, :, knee].max()
    assert held_out_accuracy(cycles, cycles.sources, 2) == 1.0
    assert len(learn_activities(cycles).scales) < 5
