"""Missing values and incompatible choices of a configuration, and likelihoods with comparable evidence."""

import pytest
from compositions import composed

from workbench.experiment.config.requirements import SOURCES, evidence_problem, first_conflict, first_missing

NAMES = {"dataset": "video", "body": "height"}


@pytest.mark.parametrize(
    ("overrides", "reason"),
    [
        (["experiment=walk_straight"], "likelihood=ImageMotion is not a density of the data"),
        (["experiment=walk_straight", "likelihood.reduction=sum"], "likelihood=ImageMotion is not"),
        (["experiment=walk_multi_cue"], "likelihood=Product is not"),
        (["experiment=walk_keypoints_synthetic", "inference=particle_filter"], "likelihood=KeypointLikelihood is not"),
        (["experiment=walk_keypoints_synthetic", "inference=particle_filter", "likelihood.likelihood_power=1.0"], None),
        (["experiment=synthesize_run"], "there is no likelihood"),
    ],
    ids=str,
)
def test_evidence_needs_a_density_of_the_data(overrides, reason):
    problem = evidence_problem(composed(*overrides, "paths.data=null"), {})
    assert problem is None if reason is None else problem.startswith(reason)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (
            ["experiment=synthesize_run", "prior=smooth"],
            "inference=Synthesis requires recorded windows to look ahead in",
        ),
        (["experiment=points_full", "prior=smooth"], "dataset=Points requires every joint of a motion file's skeleton"),
        (["experiment=points_walk_steady", "prior.skeleton=full"], "prior=activity requires every joint"),
        (["experiment=points_full", "inference=synthesis"], "inference=Synthesis does not work with every joint"),
        (["experiment=synthesize_run", "prior=smooth", "inference.look_ahead=0"], None),
    ],
    ids=str,
)
def test_a_conflict_is_one_sentence_about_both_choices(overrides, message):
    conflict = first_conflict(composed(*overrides, "paths.data=somewhere"), {})
    assert conflict is None if message is None else conflict.startswith(f"config: {message}")


@pytest.mark.parametrize(
    ("overrides", "names", "message"),
    [
        (
            ["dataset=video"], {"dataset": "video"},
            "config: dataset=video requires source, calibration_file: add dataset.source=… "
            "dataset.calibration_file=… (source: a video file",
        ),
        (
            ["dataset=video", "dataset.source=x.mp4"], {},
            "config: workbench.datasets.video.Video requires calibration_file: add dataset.calibration_file=…",
        ),
        (
            ["dataset=multi_view", "dataset.calibration_file=c.toml"], {"dataset": "multi_view"},
            "config: dataset=multi_view requires sources: add dataset.sources=…",
        ),
        (["dataset=multi_view", "dataset.calibration_file=c.toml", "dataset.sources.a=a.mp4"], {}, None),
        (["dataset=video", "body=height"], NAMES, "config: body=height requires height_m: add body.height_m=…"),
        (
            ["dataset=video", "body=height", "body.height_m=1.7", "dataset.source=x", "dataset.calibration_file=y"],
            NAMES, None,
        ),
        (["paths.data=null"], {}, None),
    ],
    ids=str,
)  # fmt: skip
def test_the_first_missing_key_is_named_with_its_description(overrides, names, message):
    missing = first_missing(composed("experiment=custom", *overrides), names)
    assert missing is None if message is None else missing.startswith(message)


@pytest.mark.parametrize(
    ("experiment", "folder"), [("walk_keypoints", "sports2d_walk"), ("balance_4cam", "pose2sim_balance")]
)
def test_missing_recordings_are_named_with_their_source(experiment, folder, tmp_path):
    message = first_missing(composed(f"experiment={experiment}", "paths.data=null"), {})
    assert "paths.data is not set: add paths.data=FOLDER or set WORKBENCH_DATA=FOLDER" in message
    assert f"the folder must contain {folder}/, {SOURCES[folder]}" in message
    message = first_missing(composed(f"experiment={experiment}", f"paths.data={tmp_path}"), {})
    assert message.startswith("config: dataset.")
    assert message.endswith(f"paths.data must contain {folder}/: {SOURCES[folder]}")
    (tmp_path / folder).mkdir()
    assert first_missing(composed(f"experiment={experiment}", f"paths.data={tmp_path}"), {}) is None
