"""A tracking experiment with any prior, likelihood and inference works, or is refused in one sentence."""

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
"""What makes a scene small, where the data set has such a key."""


CASES = [(group, option) for group in GROUPS for option in sorted(options(group))]
WITH_DATA = (
    "balance_1cam", "balance_4cam", "balance_arm", "points_full", "video_cues", "walk_keypoints", "walk_video",
    "walk_video_multi_cue",
)  # fmt: skip
"""Those that show nobody without recordings; the others show generated people here. In walk_keypoints a few frames of
a hundred are annotated, so that three are too few."""
FEW = ("walk_straight", "points_walk_variable", "walk_keypoints_synthetic")
"""One that shows images, one that shows points and one that shows joints: run with every option."""


def sampled() -> list[tuple[str, str, str]]:
    """Return (experiment, group, option): every option in the few, and one option, chosen by hash, in each other."""
    cases = [(name, *case) for name in FEW for case in CASES]
    for name in sorted({*TRACKING} - {*FEW, "video"}):  # which has no video of its own
        cases.append((name, *min(CASES, key=lambda case: sha256(f"{name} {case}".encode()).digest())))
    return cases


@pytest.fixture(autouse=True)
def hydra_is_ready():
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"), single_blas_thread():
        yield


def made_small(config: DictConfig, generated: bool, cut: bool) -> DictConfig:
    """Return it with few particles, small images and, where cut, few frames."""
    config = config.copy()
    if generated and "motion" in config.dataset:
        config.dataset.motion = "builtin"
    for key, value in SMALL.items():
        group, _, name = key.partition(".")
        if name in config[group] and (cut or name != "n_frames"):
            OmegaConf.update(config, key, value)
    if "n_particles" in config.inference:
        config.inference.n_particles = 20
    return config


def outcome(config: DictConfig) -> str:
    """What became of a few frames: "works", or the sentence by which the parts were refused before they were built."""
    if sentence := first_conflict(config, {}):
        with pytest.raises(InputError, match=r"^config: "):
            assemble(config)
        return sentence
    parts = assemble(config)
    steps = [step for step, _ in track(parts, seed=0)]
    assert len(steps) == len(parts.clip) >= 2
    assert all(np.isfinite(step.expected_pose).all() for step in steps)
    return "works"


@pytest.mark.slow
@pytest.mark.parametrize(("experiment", "group", "option"), sampled())
def test_it_works_or_says_why_not(experiment, group, option, cache, request):
    if experiment in WITH_DATA:
        usual = [f"paths.data={request.getfixturevalue('data')}"]
        usual += ["training.motions=builtin"] * (experiment != "points_full")  # which has every joint of a recording
    else:
        usual = ["paths.data=null", "training.motions=builtin", f"paths.cache={cache}"]
    config = compose("config", overrides=[f"experiment={experiment}", *usual, f"{group}={option}"])
    found = outcome(made_small(config, experiment not in WITH_DATA, experiment != "walk_keypoints"))
    assert found == "works" or found.startswith("config: "), found
