"""The assumptions in an experiment's file and in the documents are those of its components."""

import re
from pathlib import Path

import pytest
from compositions import TRACKING, composed

from workbench.core.side_information import ORDER
from workbench.experiment.config.options import options
from workbench.experiment.config.requirements import assumptions, first_conflict

EXPERIMENTS = Path(__file__).parents[2] / "docs" / "experiments.md"


@pytest.mark.parametrize(
    ("overrides", "added", "removed"),
    [
        (["experiment=walk_straight", "paper=literal"], {"fixed_torso_orientation"}, set()),
        (["experiment=walk_straight", "likelihood=product"], {"static_background"}, set()),
        (["experiment=walk_straight", "likelihood.background=static"], {"static_camera"}, set()),
        (["experiment=walk_straight", "body=height", "body.height_m=1.7"], {"height"}, {"limb_lengths", "limb_radii"}),
        (
            ["experiment=points_walk_steady", "dataset.initialization=perturbed_truth"],
            {"initial_pose", "phase_ends"},
            set(),
        ),
        (["experiment=points_walk_steady", "inference=particle_filter"], {"first_frames"}, set()),
        (["experiment=balance_4cam", "body.height_m=1.8"], {"height"}, set()),
        (["experiment=video", "dataset.calibration_file=camera.toml"], {"camera_calibration"}, set()),
        (["experiment=video", "dataset.height_m=1.8"], {"height"}, set()),
    ],
)
@pytest.mark.slow
def test_the_assumptions_of_a_run_follow_its_components(overrides, added, removed):
    unchanged = set(assumptions(composed(overrides[0])))
    assert set(assumptions(composed(*overrides))) == (unchanged | added) - removed


@pytest.mark.slow
def test_experiments_and_the_table_of_the_documents_list_the_assumptions_of_the_components():
    configs = {name: composed(f"experiment={name}") for name in TRACKING if name != "custom"}
    derived = {name: set(assumptions(config)) for name, config in configs.items()}
    assert {name: set(config.assumptions) for name, config in configs.items()} == derived
    text = EXPERIMENTS.read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \|(?:[^|]+\|){1,2}?([^|]+)\| (?:required|optional|–) \|$", text, re.MULTILINE)
    listed = {name: set(re.findall(r"\w+", words)) for name, words in rows if name in TRACKING}
    assert listed == derived
    assert {name for name, _ in rows} == set(options("experiment")) - {"custom"}
    (section,) = re.findall(r"^## Assumptions\n(.+?)^## ", text, re.DOTALL | re.MULTILINE)
    assert re.findall(r"^\| `(\w+)` \|", section, re.MULTILINE) == list(ORDER)


@pytest.mark.parametrize("likelihood", ["likelihood=keypoints", "likelihood=product"])
def test_reinitialization_from_joints_is_rejected_with_a_likelihood_of_the_same_joints(likelihood):
    chosen = ["experiment=walk_keypoints_synthetic", "prior=smooth", "inference=reinitializing", likelihood]
    names = {"inference": "reinitializing", "likelihood": "keypoints"}
    conflict = first_conflict(composed(*chosen), names)
    if likelihood == "likelihood=keypoints":
        reason = "starts from 2-D joints, which likelihood=keypoints would use a second time"
        assert conflict == f"config: inference=reinitializing {reason}"
    else:
        assert conflict is None
