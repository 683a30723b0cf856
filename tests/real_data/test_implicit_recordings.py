"""The implicit prior on recorded motion: accuracy of the searches, and predictions of held-out clips."""

import numpy as np
import pytest

from workbench.motion.models.windows import learn_windows
from workbench.motion.sources import find_sources, load_motion
from workbench.priors.implicit import Implicit
from workbench.priors.implicit_search import kd_tree
from workbench.priors.implicit_tree import fidelity, median_tree, sign_tree


@pytest.fixture(scope="module")
def recordings(data):
    files = find_sources([data / "bandai" / "dataset-1"])[::12]
    motions = [load_motion(file) for file in files]
    return motions[1::5], [motion for i, motion in enumerate(motions) if i % 5 != 1]


@pytest.fixture(scope="module")
def windows(recordings):
    return learn_windows(recordings[1])


@pytest.fixture(scope="module")
def probes(recordings, windows):
    held_out = learn_windows(recordings[0])
    chosen = np.random.default_rng(0).choice(len(held_out), 15, replace=False)
    return windows.project(held_out.window_rows(chosen))


def test_the_kd_tree_samples_the_posterior_and_the_paper_s_trees_do_not(windows, probes):
    rng = np.random.default_rng(0)
    results = [
        fidelity(build(windows.coefficients), windows.coefficients, probes, 0.05, rng)
        for build in (kd_tree, sign_tree, median_tree)
    ]
    assert results[0].total_variation <= 0.01  # the bound epsilon = 0.01
    assert results[0].visited < 0.5
    assert min(result.total_variation for result in results[1:]) > 0.1


def test_increments_predict_held_out_clips_better_than_copies(recordings, windows):
    errors = {}
    for prediction in ("copy", "increment"):
        prior = Implicit(
            windows, prediction=prediction, sigma_position=(0,) * 3, sigma_rotation=(0,) * 3, sigma_angles=0.0
        )
        differences = []
        for motion in recordings[0]:
            for first in range(0, len(motion) - 12, 15):
                state = prior.start_after(motion.poses[first : first + 11], 30)
                predicted = prior.pose(prior.sample_transition(state, 1 / 30, np.random.default_rng(first)))
                differences.append(predicted.mean(axis=0)[6:] - motion.poses[first + 11, 6:])
        errors[prediction] = np.sqrt(np.mean(np.square(differences)))
    assert errors["increment"] < 0.7 * errors["copy"]
