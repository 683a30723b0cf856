"""A tracking experiment with any prior, likelihood or inference tracks a person or is refused with a reason."""

from hashlib import sha256

import numpy as np
import pytest
from compositions import TRACKING
from hydra import compose, initialize_config_module
from omegaconf import DictConfig, OmegaConf

from workbench.experiment.config.options import options
from workbench.experiment.config.requirements import first_conflict
from workbench.experiment.config.schema import prepare_hydra
from workbench.experiment.tracking import assemble, track
from workbench.utils.errors import InputError
from workbench.utils.parallel import single_blas_thread

GROUPS = ("prior", "likelihood", "inference")
SMALL = {
    "dataset.n_frames": 3, "dataset.width": 160, "dataset.height": 120, "dataset.person_px": 80,
    "dataset.focal_px": 175, "dataset.n_points": 60, "dataset.images": False,
}  # fmt: skip
"""Settings of a small scene, for the datasets that have the key."""


CASES = [(group, option) for group in GROUPS for option in sorted(options(group))]
WITH_DATA = (
    "balance_1cam", "balance_4cam", "balance_arm", "points_full", "video_cues", "walk_keypoints", "walk_video",
    "walk_video_multi_cue",
)  # fmt: skip
"""Experiments that need recordings; the others show generated people."""
HUMANEVA = tuple(name for name in TRACKING if name.startswith("humaneva"))
COMPLETE = {"walk_straight": GROUPS, "points_walk_variable": GROUPS, "walk_keypoints_synthetic": GROUPS[1:]}
"""Experiments on images, points and joints that are run with every option of these groups."""


def sample_cases() -> list[tuple[str, str, str]]:
    """Return (experiment, group, option): the options for COMPLETE, one option chosen by hash for every other one."""
    cases = [(name, *case) for name, groups in COMPLETE.items() for case in CASES if case[0] in groups]
    for name in sorted({*TRACKING} - {*COMPLETE, "video", *HUMANEVA}):  # they have no video of their own
        cases.append((name, *min(CASES, key=lambda case: sha256(f"{name} {case}".encode()).digest())))
    return cases


@pytest.fixture(autouse=True)
def hydra():
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"), single_blas_thread():
        yield


def make_small(config: DictConfig, generated: bool, few_frames: bool) -> DictConfig:
    """Return a configuration with few particles, small images and few frames."""
    config = config.copy()
    if generated and "motion" in config.dataset:
        config.dataset.motion = "builtin"
    for key, value in SMALL.items():
        group, _, name = key.partition(".")
        if name in config[group] and (few_frames or name != "n_frames"):
            OmegaConf.update(config, key, value)
    if "n_particles" in config.inference:
        config.inference.n_particles = 20
    return config


def conflict_or_track(config: DictConfig) -> str | None:
    """Track a few frames; return the conflict between the components, or None."""
    if conflict := first_conflict(config, {}):
        with pytest.raises(InputError, match=r"^config: "):
            assemble(config)
        return conflict
    components = assemble(config)
    steps = [step for step, _ in track(components, seed=0)]
    assert len(steps) == len(components.clip) >= 2
    assert all(np.isfinite(step.expected_pose).all() for step in steps)
    return None


@pytest.mark.slow
@pytest.mark.parametrize(("experiment", "group", "option"), sample_cases())
def test_a_combination_tracks_or_is_refused(experiment, group, option, cache, request):
    if experiment in WITH_DATA:
        data = [f"paths.data={request.getfixturevalue('data')}"]
        data += ["training.motions=builtin"] * (experiment != "points_full")  # it needs every joint of a recording
    else:
        data = ["paths.data=null", "training.motions=builtin"]
    words = [f"experiment={experiment}", *data, f"paths.cache={cache}", f"{group}={option}"]
    config = compose("config", overrides=words)
    few_frames = experiment != "walk_keypoints"  # few of its frames are annotated
    conflict = conflict_or_track(make_small(config, experiment not in WITH_DATA, few_frames))
    assert conflict is None or conflict.startswith("config: ")


@pytest.mark.parametrize(
    ("experiment", "message"), [
        ("walk_straight", "skeleton=feet needs a fit"),
        ("walk_keypoints_synthetic", "the poses of this dataset have no ankles"),
    ]
)  # fmt: skip
def test_feet_are_refused_where_no_ankle_moves(experiment, message, cache):
    overrides = [f"experiment={experiment}", "paths.data=null", "training.motions=builtin", f"paths.cache={cache}"]
    config = compose("config", overrides=[*overrides, "body=height", "body.height_m=1.7", "body.skeleton=feet"])
    with pytest.raises(InputError, match=message):
        assemble(make_small(config, True, True))
