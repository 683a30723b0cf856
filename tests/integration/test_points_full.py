"""`experiment=points_full`, which tracks every joint of a motion file, on generated files in Bandai's format."""

import json

import numpy as np
import pytest
from bandai_files import write_bandai_like

from workbench.motion.synthetic.gait import subjects, walker
from workbench.motion.synthetic.run_gait import runner, runners
from workbench.recording.read.reader import read

SMALL = ("dataset.n_frames=8", "dataset.n_points=150", "prior.n_components=3", "inference.n_particles=30")


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Return a folder for paths.data: a walk to track, and two walks and two runs of other people to learn from."""
    folder = tmp_path_factory.mktemp("data")
    for k, person in enumerate(subjects(3, np.random.default_rng(5)), start=1):
        name = f"dataset-{2 if k == 1 else 1}_walk_normal_{k:03d}"
        write_bandai_like(folder / "bandai" / name[:9] / f"{name}.bvh", walker(person, 4.0, 30.0))
    for k, person in enumerate(runners(2, np.random.default_rng(6)), start=1):
        name = f"dataset-1_run_active_{k:03d}"
        write_bandai_like(folder / "bandai" / "dataset-1" / f"{name}.bvh", runner(person, 4.0, 30.0))
    return folder


@pytest.mark.slow
def test_every_joint_of_the_file_is_tracked(recordings, run):
    code, output, folder = run(
        "out", "experiment=points_full", f"paths.data={recordings}", f"paths.cache={recordings}", *SMALL
    )
    assert code == 0, output
    metrics = json.loads((folder / "summary.json").read_text())["metrics"]
    # the model is learned from other generated people: the bounds are about the thickness of a body
    assert metrics["mpjpe_abs_mm"] < 60.0
    assert metrics["knee_flexion_rmse_deg"] < 15.0
    assert metrics["hip_flexion_rmse_deg"] < 15.0
    assert {"activity_accuracy", "jacobian_cost_ratio"} <= metrics.keys()
    recording = read(folder / "run.rrd")
    body = recording.properties["body"]
    assert len(body["joints"]) == 21
    assert {"LowerLeg_L_y", "UpperLeg_R_y"} <= set(body["pose"])
    assert recording.poses[1].shape == (8, len(body["pose"]))
    assert recording.true_joints.positions.shape == (8, 21, 3)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (("prior.skeleton=person",), "dataset=points requires every joint of a motion file's skeleton of the prior"),
        (("prior.motions=builtin",), "prior: skeleton=full requires recordings"),
        (
            ("dataset.motion=[dataset-2_walk_normal_001,dataset-1_run_active_001]", "prior.exclude=[]"),
            "expects one motion",
        ),
        (("dataset.motion=builtin",), "dataset: motion 'builtin'"),
    ],
)
def test_conflicting_options_are_refused(recordings, run, overrides, message):
    code, output, _ = run(
        "out", "experiment=points_full", f"paths.data={recordings}", f"paths.cache={recordings}", *SMALL, *overrides
    )
    assert code == 2
    assert message in output
