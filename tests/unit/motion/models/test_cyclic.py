"""The walking model of paper B: equal to paper A's without gaps, removed data, and the published algorithm."""

from dataclasses import replace

import numpy as np
import pytest

from workbench.body.shape import from_height
from workbench.body.skeleton import N_ROOT, POSE_NAMES
from workbench.motion.models.cycle_alignment import align, motion_period
from workbench.motion.models.functional_pca import cut, fpca_paper
from workbench.motion.models.imputation import remove_blocks, with_gaps
from workbench.motion.models.walking import learn_cyclic, learn_walking
from workbench.motion.pose_sequence import Motion
from workbench.studies.gap_errors import remove_markers
from workbench.studies.walk_cycles import event_period, period_study
from workbench.utils.errors import InputError

RATE, CYCLE_S, T = 60.0, 1.1, 64


def walk(style=0.0, first=0.2, n_cycles=4.2, name="walk"):
    """A walk at 1.3 m/s from phase `first`, whose left knee and right elbow vary with the style."""
    times = np.arange(int(n_cycles * CYCLE_S * RATE)) / RATE
    turn = 2 * np.pi * (times / CYCLE_S + first)
    poses = np.zeros((len(times), len(POSE_NAMES)))
    poses[:, 0], poses[:, 2] = 1.3 * times, 0.95
    for angle, curve in {
        "left_hip_flexion": 0.5 * np.cos(turn),
        "right_hip_flexion": -0.5 * np.cos(turn),
        "left_knee_flexion": 0.6 + 0.4 * np.sin(turn) + style * np.cos(2 * turn),
        "right_knee_flexion": 0.6 - 0.4 * np.sin(turn),
        "right_elbow_flexion": 0.5 + 0.3 * np.cos(turn) + 0.5 * style * np.sin(3 * turn),
    }.items():
        poses[:, POSE_NAMES.index(angle)] = curve
    return Motion(name, "s", "walk", RATE, poses, from_height(1.75), np.zeros(14), "made", "0" * 64, "none")


def walks(n=12, seed=0, noise=0.0):
    rng = np.random.default_rng(seed)
    clean = [walk(0.15 * rng.normal(), rng.random(), rng.uniform(3.0, 5.0), f"walk{i}") for i in range(n)]
    return [replace(motion, poses=motion.poses + noise * rng.normal(size=motion.poses.shape)) for motion in clean]


def test_without_gaps_the_model_is_that_of_paper_a():
    a = learn_walking(walks(), variance=0.95, n_components=1, scaling="none", n_phases=T)
    b = learn_cyclic(walks(), n_components=1, n_phases=T)
    # phases differ by the offsets' step and by the events' errors; the steepest curve changes by 2π × 0.5 a cycle
    assert b.mean[:, 1:] == pytest.approx(a.mean[:, 1:], abs=2 * np.pi * 0.5 * 0.01)
    assert b.mean[:, 0] == pytest.approx(1.3, abs=1e-3)
    assert b.cycle_rate_hz[0] == pytest.approx(1 / CYCLE_S, rel=0.005)
    assert b.explained > 0.9
    overlap = (a.components[:, :, 1:] * b.components[:, :, 1:]).sum()
    assert abs(overlap) == pytest.approx(1.0, abs=0.02)
    assert b.scales == pytest.approx(a.scales, rel=0.15)  # the two weight clips by different numbers of cycles


def test_the_left_thigh_is_foremost_at_phase_zero():
    model = learn_cyclic(walks(), n_components=1)
    left, right = (1 + POSE_NAMES.index(f"{side}_hip_flexion") - N_ROOT for side in ("left", "right"))
    assert np.argmax(model.mean[:, left] - model.mean[:, right]) in (0, 1, T - 1)


def test_motions_without_a_period_are_excluded_with_a_warning(caplog):
    short = walk(n_cycles=1.2, name="short")
    model = learn_cyclic([*walks(4), short], n_components=1)
    assert "short excluded" in caplog.text
    assert model.n_cycles == learn_cyclic(walks(4), n_components=1).n_cycles
    with pytest.raises(InputError, match="found 0 of 1"):
        learn_cyclic([short])


@pytest.mark.parametrize("remove", [remove_blocks, remove_markers])
@pytest.mark.parametrize("fraction", [0.1, 0.3])
def test_the_removed_fraction_is_the_requested_one(remove, fraction):
    motion = walk()
    removed = remove(motion, fraction, np.random.default_rng(0))
    longest = 0.5 * RATE if remove is remove_blocks else 0.5 * CYCLE_S * RATE + 1
    assert (removed.mean(axis=0) >= fraction).all()
    assert (removed.mean(axis=0) < fraction + (longest + 1) / len(motion)).all()
    if remove is remove_markers:
        names = POSE_NAMES[N_ROOT:]
        leg = [names.index(f"left_{angle}") for angle in ("hip_flexion", "hip_abduction", "hip_twist", "knee_flexion")]
        assert (removed[:, leg] == removed[:, leg[:1]]).all()


def test_a_missing_period_is_an_infinite_error(caplog):
    """After three events the walker stands, so that the events give strides but the clip has no period."""
    short = walk(n_cycles=3.2)
    poses = np.concatenate([short.poses, np.repeat(short.poses[-1:], 400, axis=0)])
    poses[:, N_ROOT:] += np.linspace(0.0, 3.0, len(poses))[:, None] ** 3
    broken = replace(short, poses=poses, name="broken")
    assert np.isfinite(event_period(broken))
    metrics, _, _ = period_study([broken], np.random.default_rng(0))
    assert metrics["period_error_max_pct"] == np.inf
    assert "broken" in caplog.text


def test_as_published_truncated_singular_values_of_all_slices_are_learned():
    motions = [with_gaps(motion, 0.2, np.random.default_rng(i)) for i, motion in enumerate(walks(6, noise=0.05))]
    published, ours = (
        learn_cyclic(motions, n_components=2, as_published=as_published) for as_published in (True, False)
    )
    angles = [motion.poses[:, N_ROOT:] for motion in motions]
    periods = [motion_period(motion, series, summed=True) for motion, series in zip(motions, angles, strict=True)]
    alignment = align(angles, periods)
    hips = [POSE_NAMES.index(f"{side}_hip_flexion") - N_ROOT for side in ("left", "right")]
    foremost = np.argmax(alignment.reference[:, hips[0]] - alignment.reference[:, hips[1]]) / len(alignment.reference)
    pca = fpca_paper(cut(angles, replace(alignment, offsets=(alignment.offsets - foremost) % 1.0)), 2)
    assert published.n_cycles == len(pca.completed) > ours.n_cycles  # with those at the ends of the sequences
    assert published.mean[:, 1:] == pytest.approx(pca.mean, abs=1e-9)
    assert published.scales == pytest.approx(pca.scales, rel=1e-6)
    assert (published.mean[:, 0] == 0.0).all()  # B has no torso speed
    assert published.scales != pytest.approx(ours.scales, rel=0.01)
