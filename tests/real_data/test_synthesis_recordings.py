"""Synthesized running has jumps as in recordings with the exact search, and larger ones with the paper's search."""

from itertools import pairwise

import numpy as np
import pytest

from workbench.body.limbs import person
from workbench.datasets.blank import Blank
from workbench.inference.synthesis import Synthesis, jump_deg
from workbench.motion.models.windows import learn_windows
from workbench.motion.sources import find_sources, load_motion
from workbench.priors.implicit import Implicit

CLIP = "dataset-2_run_normal_001"
STILL = {"sigma_position": (0.0,) * 3, "sigma_rotation": (0.0,) * 3, "sigma_angles": 0.0}


@pytest.fixture(scope="module")
def library(data):
    """Return clips of all activities, without the one that gives the initial pose."""
    files = find_sources([data / "bandai"])
    chosen = [file for file in files if "run_normal" in file.name][1::6] + files[::40]
    return [load_motion(file) for file in chosen if file.stem != CLIP]


@pytest.fixture(scope="module")
def windows(library):
    return learn_windows(library)


def jumps_and_activity(data, prior, **options):
    blank = Blank(motion=CLIP, data=str(data), n_frames=61)
    inference = Synthesis(prior, person(blank.info.shape), blank.info, **options)
    steps = []
    for seed in range(3):
        streams = {name: np.random.default_rng([seed, i]) for i, name in enumerate(("start", "prior"))}
        steps += list(inference.run(blank.frames(), blank.info.initial_pose, streams))[1:]
    return tuple(np.mean([step.diagnostics[name] for step in steps]) for name in ("jump_deg", "same_activity"))


def test_exact_samples_at_low_temperature_continue_the_run_and_the_sign_tree_does_not(data, windows):
    cold = jumps_and_activity(data, Implicit(windows, beta=0.01, **STILL), look_ahead=3)
    literal = {"blend_time_s": 0.0, "foot_contact": False}
    neutral = Implicit(windows, search="sign_tree", beta=1.0, prediction="copy", **STILL)
    jumps, same_activity = jumps_and_activity(data, neutral, **literal)
    recorded = load_motion(data / "bandai" / "dataset-2" / f"{CLIP}.bvh").poses
    recorded_jumps = np.mean([jump_deg(a, b) for a, b in pairwise(recorded)])
    assert cold[0] < 1.5 * recorded_jumps
    assert jumps > 2.0 * recorded_jumps
    assert cold[1] > 0.9
    assert same_activity < cold[1]
