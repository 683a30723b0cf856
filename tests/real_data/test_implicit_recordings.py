"""The implicit prior on recorded motion: fidelity of the searches, and predictions of clips left out."""

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
    left_out = learn_windows(recordings[0])
    chosen = np.random.default_rng(0).choice(len(left_out), 15, replace=False)
    return windows.project(left_out.window_rows(chosen))


def test_the_exact_search_is_faithful_where_the_trees_are_not(windows, probes):
    rng = np.random.default_rng(0)
    results = [
        fidelity(build(windows.coefficients), windows.coefficients, probes, 0.05, rng)
        for build in (kd_tree, sign_tree, median_tree)
    ]
    assert results[0].total_variation <= 0.01  # what epsilon = 0.01 promises
    assert results[0].visited < 0.5
    assert min(result.total_variation for result in results[1:]) > 0.1  # prototypes: 0.5 and more


def test_increments_predict_clips_left_out_better_than_copies(recordings, windows):
    errors = {}
    for prediction in ("copy", "increment"):
        prior = Implicit(
            windows, prediction=prediction, sigma_position=(0,) * 3, sigma_rotation=(0,) * 3, sigma_angles=0.0
        )
        apart = []
        for motion in recordings[0]:
            for first in range(0, len(motion) - 12, 15):
                state = prior.start_after(motion.poses[first : first + 11], 30)
                predicted = prior.pose(prior.sample_transition(state, 1 / 30, np.random.default_rng(first)))
                apart.append(predicted.mean(axis=0)[6:] - motion.poses[first + 11, 6:])
        errors[prediction] = np.sqrt(np.mean(np.square(apart)))
    assert errors["increment"] < 0.7 * errors["copy"]  # prototypes: 1.9° against 4.1°
