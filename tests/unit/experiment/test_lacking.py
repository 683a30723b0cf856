"""What a configuration leaves out is said before anything is built: keys without a value, absent recordings."""

import pytest
from hydra import compose, initialize_config_module

from workbench.experiment.config.lacking import SOURCES, what_lacks
from workbench.experiment.config.schema import prepare_hydra

NAMES = {"dataset": "video", "body": "height"}


def config_of(*overrides):
    prepare_hydra()
    with initialize_config_module("workbench.conf", version_base="1.3"):
        return compose("config", overrides=["experiment=custom", *overrides])


def test_a_key_without_a_value_is_said_with_what_it_is():
    told = what_lacks(config_of("dataset=video"), {"dataset": "video"})
    assert told == (
        "config: dataset=video needs source, camera: say dataset.source=… dataset.camera=… (camera: TOML of the "
        "Pose2Sim and Sports2D form)"
    )


def test_of_a_part_without_a_name_its_class_is_said():
    told = what_lacks(config_of("dataset=video", "dataset.source=x.mp4"), {})
    assert told == "config: workbench.datasets.video.Video needs camera: say dataset.camera=…"


def test_sources_without_any_are_no_value():
    told = what_lacks(config_of("dataset=multi_view", "dataset.camera=c.toml"), {"dataset": "multi_view"})
    assert told.startswith("config: dataset=multi_view needs sources: say dataset.sources=…")
    assert what_lacks(config_of("dataset=multi_view", "dataset.camera=c.toml", "dataset.sources.a=a.mp4"), {}) is None


def test_the_first_part_that_lacks_something_is_said():
    both = config_of("dataset=video", "body=height")
    assert what_lacks(both, NAMES).startswith("config: body=height needs height_m: say body.height_m=…")
    given = config_of("dataset=video", "body=height", "body.height_m=1.7", "dataset.source=x", "dataset.camera=y")
    assert what_lacks(given, NAMES) is None


@pytest.mark.parametrize(
    ("experiment", "folder"), [("walk_keypoints", "sports2d_walk"), ("balance_4cam", "pose2sim_balance")]
)
def test_recordings_without_a_place_are_said_with_where_they_come_from(experiment, folder, tmp_path):
    told = what_lacks(config_of(f"experiment={experiment}", "paths.data=null"), {})
    assert "paths.data is not set: say paths.data=FOLDER or set WORKBENCH_DATA=FOLDER" in told
    assert f"in which {folder}/ lies, {SOURCES[folder]}" in told
    told = what_lacks(config_of(f"experiment={experiment}", f"paths.data={tmp_path}"), {})
    assert told.startswith("config: dataset.")
    assert told.endswith(f"paths.data should hold {folder}/: {SOURCES[folder]}")
    (tmp_path / folder).mkdir()
    assert what_lacks(config_of(f"experiment={experiment}", f"paths.data={tmp_path}"), {}) is None  # who builds reads


def test_a_folder_that_we_know_nothing_of_is_said_without_a_source(tmp_path):
    files = f"dataset.camera={tmp_path}/mine/c.toml", f"dataset.source={tmp_path}/mine/x.mp4"
    told = what_lacks(config_of("dataset=video", *files, f"paths.data={tmp_path}"), {})
    assert told.endswith("paths.data should hold mine/")


def test_of_what_runs_as_it_stands_nothing_lacks():
    assert what_lacks(config_of("paths.data=null"), {}) is None
