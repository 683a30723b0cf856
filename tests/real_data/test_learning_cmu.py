"""The walking model on recorded walks: held-out people are near its span."""

import numpy as np
import pytest

from workbench.body.kinematics import joints
from workbench.body.skeleton import N_ROOT, person_skeleton
from workbench.motion.models.training import training_motions, walking_model
from workbench.motion.models.walking import walking_cycles
from workbench.motion.sources import load_motion
from workbench.priors.cyclic import Cyclic

SUBJECTS = ("02", "05", "06", "07", "08", "16", "32", "39")
OPTIONS = {"variance": 0.95, "n_components": None, "scaling": "joints"}


@pytest.fixture(scope="module")
def learned(data, cache):
    return walking_model(motions="cmu", data=str(data), cache=str(cache), subjects=SUBJECTS, **OPTIONS)


def test_recorded_cycles_have_plausible_durations_and_speeds(data, cache):
    cycles = walking_cycles(training_motions("cmu", data=str(data), cache=str(cache), subjects=SUBJECTS))
    assert len(cycles.curves) > 40
    assert {source.split("_")[0] for source in cycles.sources} == set(SUBJECTS)
    assert 0.8 < np.median(cycles.durations_s) < 1.4  # 27–39 frames at 30 Hz
    assert 0.8 < np.median(cycles.curves[:, :, 0]) < 1.8  # m/s


def test_held_out_people_are_near_the_model(data, learned):
    """The joint error of the best state is below that of the mean training cycle."""
    prior = Cyclic(learned)
    fitted, mean_only = [], []
    for clip in ("35_02", "38_02"):
        motion = load_motion(data / "cmu" / clip[:2] / f"{clip}.amc").resampled(10.0)
        skeleton = person_skeleton(motion.shape)
        truth = joints(skeleton, motion.poses)
        states = np.array([prior.nearest(pose) for pose in motion.poses])
        mean_states = states.copy()
        mean_states[:, prior.space.slices["coefficients"]] = 0.0
        for errors, state in ((fitted, states), (mean_only, mean_states)):
            pose = prior.pose(state)
            pose[:, :N_ROOT] = motion.poses[:, :N_ROOT]
            errors.append(np.linalg.norm(joints(skeleton, pose) - truth, axis=-1).mean())
    assert np.mean(fitted) < 0.025
    assert np.mean(fitted) < 0.8 * np.mean(mean_only)
