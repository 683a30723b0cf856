"""Runs with several image cues: what is recorded of them, and that they come out the same again."""

import numpy as np
import pytest

from workbench.recording.read.reader import read

SMALL = ("dataset.n_frames=5", "inference.n_particles=200", "dataset.width=160", "dataset.height=120")
SMALL += ("dataset.person_px=80", "dataset.focal_px=175", "likelihood=product")
CUES = ("image_motion", "background", "appearance")


def test_the_shares_of_the_cues_are_recorded_frame_by_frame(run):
    switched_off = "likelihood.weights.edges=0"  # so that nothing has to be learned from rendered people
    code, told, folder = run("out", *SMALL, switched_off)
    assert code == 0, told
    recorded = read(folder / "run.rrd")
    shares = np.array([recorded.metric(f"share_{cue}")[1] for cue in CUES])
    assert shares.shape == (3, 5)
    np.testing.assert_allclose(shares.sum(axis=0), [0.0, 1.0, 1.0, 1.0, 1.0], atol=1e-9)  # the first frame is given
    assert (np.abs(shares).mean(axis=1) > 0.01).all()  # every cue has its say
    assert "share_edges" not in recorded.metric_names

    code, told, again = run("again", *SMALL, switched_off, "threads=1")
    assert code == 0, told
    np.testing.assert_array_equal(read(again / "run.rrd").poses[1], recorded.poses[1])


@pytest.mark.slow  # it renders people to learn from
def test_edges_are_learned_once(run, tmp_path):
    own = f"paths.cache={tmp_path / 'cache'}"
    for folder in ("out", "again"):
        code, told, _ = run(folder, *SMALL, own, *(f"likelihood.weights.{cue}=0" for cue in CUES))
        assert code == 0, told
        assert ("learning edges" in told) == (folder == "out")
