"""`experiment=synthesize_run` through the command line, on the built-in motions."""

import json

import numpy as np
import pytest
from rerun.chunk import RrdReader

from workbench.body.kinematics import joints
from workbench.body.limbs import person
from workbench.body.skeleton import JOINT_NAMES
from workbench.datasets.blank import Blank
from workbench.recording.read.reader import read

BUILTIN = ("prior.motions=builtin", "dataset.motion=builtin")
SHORT = "dataset.n_frames=12"


def metrics_of(folder):
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["status"] == "complete"
    return summary["metrics"]


@pytest.mark.slow
def test_a_synthesis_records_jumps_trails_and_figures(run):
    code, output, folder = run("out", "experiment=synthesize_run", *BUILTIN, SHORT)
    assert code == 0, output
    metrics, recording = metrics_of(folder), read(folder / "run.rrd")
    frames, poses = recording.poses
    assert list(frames) == list(range(12))
    jumps = np.degrees(np.abs(np.diff(poses[:, 6:], axis=0)).max(axis=1))
    assert metrics["jump_deg_mean"] == pytest.approx(jumps.mean())
    assert metrics["jump_deg_p99"] == pytest.approx(np.percentile(jumps, 99.0))
    assert "jump_deg" not in metrics
    assert metrics["same_activity"] == 1.0  # the built-in people only walk
    assert recording.metric("jump_deg")[1] == pytest.approx(jumps)
    positions = joints(person(Blank().info.shape).skeleton, poses)
    for name in ("left_wrist", "right_wrist"):
        (trail,) = static_strips(folder / "run.rrd", f"/world/estimate/trails/{name}")
        assert trail == pytest.approx(positions[:, JOINT_NAMES.index(name)], abs=1e-5)  # float32
    figures = np.concatenate(static_strips(folder / "run.rrd", "/world/estimate/trails/figures"))
    for frame in (0, 4, 8):
        for position in positions[frame]:
            assert np.abs(figures - position).max(axis=1).min() < 1e-5


def static_strips(path, entity):
    """Return the last line strips logged at an entity, arrays (K, 3)."""
    chunks = RrdReader(path).stream().filter(content=entity, is_static=True).to_chunks()
    rows = [row for chunk in chunks for row in chunk.to_record_batch().column("LineStrips3D:strips").to_pylist()]
    return [np.array(strip) for strip in rows[-1]]
