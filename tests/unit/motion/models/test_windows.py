"""Windows of motion: features, clip ends, PCA and the sliding memory, against direct computations."""

import logging

import numpy as np
import pytest

from workbench.body.kinematics import axis_rotations
from workbench.body.skeleton import N_ROOT, PARTS, POSE_NAMES
from workbench.motion.models.windows import advance, learn_windows, pose_rows
from workbench.motion.synthetic.gait import builtin_motions
from workbench.priors.implicit import Implicit

LENGTH = 10


def advance_reference(memory, rows, filters, offset, b):
    """Return the result of `advance`, in NumPy."""
    ahead = np.concatenate([memory[:, b:], np.zeros((len(memory), b))], axis=1)
    return ahead - offset + rows @ filters


@pytest.fixture(scope="module")
def motions():
    return builtin_motions(n_subjects=3)


@pytest.fixture(scope="module")
def windows(motions):
    return learn_windows(motions, window_frames=LENGTH)


def test_rows_integrate_to_the_motion(motions):
    poses = motions[0].resampled(30.0).poses
    rows = pose_rows(poses, 30.0, PARTS["body"], include_root=True)
    n = len(PARTS["body"])
    assert (rows[:, :n] == poses[1:, N_ROOT:]).all()
    assert poses[0, N_ROOT:] + np.cumsum(rows[:, n : 2 * n], axis=0) / 30.0 == pytest.approx(poses[1:, N_ROOT:])
    root = poses[0, :4].copy()
    for row, pose in zip(rows[:, 2 * n :], poses[1:], strict=True):
        root[:3] += axis_rotations(np.array([0.0, 0.0, 1.0]), root[3:4])[0] @ row[:3] / 30.0
        root[3] += row[3] / 30.0
        assert root == pytest.approx(pose[:4], abs=1e-9)
        assert (row[4:] == pose[4:N_ROOT]).all()


def test_windows_stay_in_their_clip_and_have_a_successor(motions, windows):
    frames = [len(motion.resampled(30.0)) - 1 for motion in motions]  # rows: the first frame has no velocity
    firsts = np.cumsum([0, *frames])[:-1]
    expected = [first + np.arange(LENGTH - 1, rows - 1) for first, rows in zip(firsts, frames, strict=True)]
    assert (windows.ends == np.concatenate(expected)).all()


def test_the_components_are_those_of_an_svd(windows):
    stacked = windows.window_rows(np.arange(len(windows))) / windows.scales
    stacked = stacked.reshape(len(windows), -1)
    centred = stacked - stacked.mean(axis=0)
    _, singular, right = np.linalg.svd(centred, full_matrices=False)
    b = len(windows.sigmas)
    assert b == int(np.log2(len(windows)))
    # float32 coefficients and sums of float32 rows: 1e-6 of a value, or of the first component's deviation
    assert windows.sigmas == pytest.approx(singular[:b] / np.sqrt(len(windows)), rel=1e-6)
    c = centred @ right[:b].T / windows.sigmas
    c *= np.sign((c * windows.coefficients).sum(axis=0))
    assert windows.coefficients == pytest.approx(c, abs=1e-4)
    assert windows.coefficients.std(axis=0) == pytest.approx(1.0, abs=1e-4)


def test_without_scaling_the_components_are_those_of_velocities_per_frame(motions, windows):
    """The paper's SVD is of unscaled windows, with angles in rad and velocities in rad or m per frame."""
    unscaled = learn_windows(motions, window_frames=LENGTH, scaling="none")
    n = len(PARTS["body"])
    units = np.array([1.0] * n + [30.0] * n + [30.0] * 4 + [1.0] * 2)
    stacked = (unscaled.window_rows(np.arange(len(unscaled))) / units).reshape(len(unscaled), -1)
    centred = stacked - stacked.mean(axis=0)
    _, singular, right = np.linalg.svd(centred, full_matrices=False)
    b = len(unscaled.sigmas)
    assert unscaled.sigmas == pytest.approx(singular[:b] / np.sqrt(len(unscaled)), rel=1e-4)
    first = centred @ right[0] / unscaled.sigmas[0]
    assert abs(np.corrcoef(first, unscaled.coefficients[:, 0])[0, 1]) == pytest.approx(1.0, abs=1e-6)
    assert (unscaled.scales == windows.scales).all()  # Σ of eq. 3


def test_projection_gives_the_stored_coefficients(windows):
    entries = np.array([0, 5, len(windows) - 1])
    assert windows.project(windows.window_rows(entries)) == pytest.approx(windows.coefficients[entries], abs=1e-5)


def test_the_memory_slides_along_the_clip(windows):
    """A window's memory, advanced by the next row, gives the next window's coefficients."""
    b = len(windows.sigmas)
    memory = windows.memory(windows.window_rows(np.array([3])))
    for entry in (4, 5, 6, 20):
        if entry == 20:
            memory = windows.memory(windows.window_rows(np.array([19])))
        row = windows.rows[windows.ends[[entry]]].astype(np.float64)
        memory = advance(memory, row, windows.filters, windows.offset, b)
        assert memory[:, :b] == pytest.approx(windows.coefficients[[entry]], abs=1e-5)


def test_the_kernel_agrees_with_numpy(windows):
    rng = np.random.default_rng(0)
    memory = rng.normal(size=(7, windows.filters.shape[1]))
    rows = rng.normal(size=(7, windows.filters.shape[0]))
    arguments = (memory, rows, windows.filters, windows.offset, len(windows.sigmas))
    assert advance(*arguments) == pytest.approx(advance_reference(*arguments), rel=1e-10, abs=1e-10)


def test_windows_of_an_arm_have_its_angles_and_velocities(motions):
    arm = learn_windows(motions, angles=PARTS["right_arm"], include_root=False)
    assert arm.rows.shape[1] == 8  # paper C's arm: four angles and their velocities
    column = POSE_NAMES.index("right_elbow_flexion")
    assert arm.rows[0, 3] == pytest.approx(motions[0].resampled(30.0).poses[1, column], rel=1e-6)


def test_short_clips_are_named(motions, caplog):
    short = builtin_motions(n_subjects=1, seed=1)[0]
    short = type(short)(**{**short.__dict__, "poses": short.poses[:12], "name": "tiny"})
    with caplog.at_level(logging.WARNING):
        windows = learn_windows([*motions, short])
    assert "tiny" in caplog.text
    assert len(windows) == len(learn_windows(motions))


def test_a_prior_of_a_subset_of_windows_draws_by_the_conditional_distribution(windows):
    selected = windows.clip_of != 1
    full = Implicit(windows, beta=2.0, tail_probability=1e-6)
    subset = full.only(selected)
    probes = np.repeat(windows.coefficients[[40]].astype(np.float64), 5000, axis=0)  # of the first clip
    from_full, from_subset = (prior.draw(probes, np.random.default_rng(0)) for prior in (full, subset))
    assert 1 not in subset.windows.clip_of[from_subset]
    assert 1 in windows.clip_of[from_full]
    entries = np.flatnonzero(selected)[from_subset]
    conditional = np.bincount(from_full, minlength=len(windows))[selected] / selected[from_full].sum()
    frequencies = np.bincount(entries, minlength=len(windows))[selected] / len(entries)
    assert np.abs(frequencies - conditional).max() < 5 * np.sqrt(2 * conditional.max() / selected[from_full].sum())


def test_another_search_has_its_own_tree_and_does_not_change_the_prior(windows):
    exact = Implicit(windows, beta=0.5)
    tree = exact.searching("sign_tree", 0.1)
    assert (tree.search, tree.beta, exact.search, exact.beta) == ("sign_tree", 0.1, "exact", 0.5)
    expected = Implicit(windows, search="sign_tree", beta=0.1)
    probes = windows.coefficients[::7].astype(np.float64)
    assert (tree.draw(probes, np.random.default_rng(0)) == expected.draw(probes, np.random.default_rng(0))).all()
