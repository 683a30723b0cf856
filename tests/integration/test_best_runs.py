"""The experiments that hold walkers by all that helps, small, on recordings."""

import json

import pytest

SMALL = ("likelihood.weights.edges=0", "inference.n_particles=150", "training.motions=builtin")
"""Nothing is learned from rendered people or from a database."""
SMALL_SCENE = ("dataset.width=160", "dataset.height=120", "dataset.person_px=80", "dataset.focal_px=175")


def metrics(folder):
    return json.loads((folder / "summary.json").read_text())["metrics"]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*px tall instead of")
@pytest.mark.parametrize(("experiment", "n_frames"), [("walk_multi_cue", 12), ("walk_long", 56)])
def test_recorded_walkers_are_held(run, data, experiment, n_frames):
    code, told, folder = run(
        "out", f"experiment={experiment}", f"paths.data={data}", f"dataset.n_frames={n_frames}", *SMALL_SCENE, *SMALL
    )
    assert code == 0, told
    assert metrics(folder)["n_frames"] == n_frames
    assert metrics(folder)["tracked"] == 1.0


@pytest.mark.slow
@pytest.mark.parametrize("experiment", ["walk_video_multi_cue", "video_cues"])
def test_the_woman_of_the_video_is_held(run, data, experiment):
    if not (data / "sports2d_walk").is_dir():
        pytest.skip("no video with marked joints")
    code, told, folder = run("out", f"experiment={experiment}", f"paths.data={data}", "dataset.n_frames=9", *SMALL)
    assert code == 0, told
    assert metrics(folder)["mpjpe_px"] < 20.0  # in frame 70; she is 390 px tall


@pytest.mark.slow
def test_a_video_of_ones_own_is_tracked_with_nothing_but_a_height_and_marks(run, data):
    if not (data / "sports2d_walk").is_dir():
        pytest.skip("no video with marked joints")
    files = {"source": "demo.mp4", "calibration_file": "Calib_demo.toml", "initial_annotations": "keypoints.csv"}
    own = [f"dataset.{key}={data / 'sports2d_walk' / name}" for key, name in files.items()]
    code, told, folder = run(
        "out", "experiment=video_cues", "dataset=video", *own, "body.height_m=1.65", f"paths.data={data}",
        "dataset.first_frame=64", "dataset.n_frames=4", *SMALL,
    )  # fmt: skip
    assert code == 0, told
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["assumptions"] == ["initial_annotations", "height", "camera_calibration", "static_background"]
    assert summary["metrics"]["n_frames"] == 4
