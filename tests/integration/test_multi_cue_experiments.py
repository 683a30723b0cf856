"""Experiments that track with several cues, at small size, on real recordings."""

import json

import pytest

SMALL = ("likelihood.weights.edges=0", "inference.n_particles=150", "training.motions=builtin")
"""Overrides with which no model is learned from rendered people or from a database."""
SMALL_SCENE = ("dataset.width=160", "dataset.height=120", "dataset.person_px=80", "dataset.focal_px=175")


def metrics_of(folder):
    return json.loads((folder / "summary.json").read_text())["metrics"]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*px tall instead of")
@pytest.mark.parametrize(("experiment", "n_frames"), [("walk_multi_cue", 12), ("walk_long", 56)])
def test_recorded_walkers_are_tracked(run, data, experiment, n_frames):
    code, output, folder = run(
        "out", f"experiment={experiment}", f"paths.data={data}", f"dataset.n_frames={n_frames}", *SMALL_SCENE, *SMALL
    )
    assert code == 0, output
    assert metrics_of(folder)["n_frames"] == n_frames
    assert metrics_of(folder)["tracked"] == 1.0


@pytest.mark.slow
@pytest.mark.parametrize("experiment", ["walk_video_multi_cue", "video_cues"])
def test_the_woman_in_the_video_is_tracked(run, data, experiment):
    if not (data / "sports2d_walk").is_dir():
        pytest.skip("no video with annotated joints")
    code, output, folder = run("out", f"experiment={experiment}", f"paths.data={data}", "dataset.n_frames=7", *SMALL)
    assert code == 0, output
    assert metrics_of(folder)["mpjpe_px"] < 20.0  # of frame 70; her height is 390 px
