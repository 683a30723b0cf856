"""The experiments on HumanEva run on a generated data set, and its error is that of their recordings' joints."""

import numpy as np
import pytest
from compositions import TRACKING
from humaneva_files import SKELETON, cameras, poses, write
from openpose_scenes import points
from openpose_scenes import write as write_openpose

from tests.oracles import humaneva as oracle
from workbench.body.kinematics import joints
from workbench.body.skeleton import JOINT_NAMES
from workbench.cli.main import main
from workbench.datasets.humaneva import HumanEva
from workbench.evaluation.errors.pose_errors import humaneva_errors
from workbench.recording.read.reader import read

EXPERIMENTS = [name for name in TRACKING if name.startswith("humaneva")]
N, FIRST = 4, 6


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a data set with one trial, and with OpenPose's folders of the cameras."""
    place = tmp_path_factory.mktemp("humaneva")
    write(place)
    starts, row, scale = oracle.first_images_and_row(
        {name: tuple(map(float, (place / f"S1/Sync_Data/Walking_1_({name}).ofs").read_text().split()))
         for name in ("C1", "C2", "C3", "BW1")}
    )  # fmt: skip
    places = joints(SKELETON, poses())
    for name, camera in cameras().items():
        first = starts[name] - 1
        rows = [round(row - 1.0 + (image - first) * scale) for image in range(first, 30)]
        pixels = [dict(zip(JOINT_NAMES, camera.project(places[row]), strict=True)) for row in rows]
        write_openpose(place / name, {first + k: [points("BODY_25", each)] for k, each in enumerate(pixels)})
    return place


@pytest.mark.slow
@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_an_experiment_runs_and_measures_the_benchmarks_error(folder, experiment, cache, tmp_path, trusted):
    used = ["C1", "C2", "C3"] if experiment == "humaneva_3cam" else ["C1"]
    words = [
        f"dataset.folder={folder}", f"dataset.n_frames={N}", "paths.data=null", f"paths.cache={cache}",
        "training.motions=builtin", f"hydra.run.dir={tmp_path / 'run'}",
    ]  # fmt: skip
    if experiment.endswith("cam"):
        places = ", ".join(f"{name}: {folder / name}" for name in used)
        words += [f"dataset.keypoints={{{places}}}"]
    else:
        words += ["inference.n_particles=50"]
    assert main(["run", f"experiment={experiment}", *words]) == 0
    run = read(tmp_path / "run")
    assert run.status == "complete"
    frames = list(HumanEva(folder=str(folder), cameras=used, n_frames=N).frames())
    places = np.asarray(run.joints.positions, dtype=float)
    errors = [humaneva_errors(f, places[k], f.truth.virtual_markers) for k, f in enumerate(frames)]
    measured = dict(zip(*run.metric("humaneva_mm"), strict=True))
    for frame, expected in zip(frames, errors, strict=True):
        assert measured[frame.index] == pytest.approx(expected["humaneva_mm"], abs=1e-2)  # joints are float32
    values = np.array([measured[frame.index] for frame in frames])
    assert run.result["humaneva_mm"] == pytest.approx(values[1:].mean(), rel=1e-9)
    assert run.result["humaneva_std_mm"] == pytest.approx(values[1:].std(), rel=1e-9)
    if experiment == "humaneva_3cam":
        assert values.max() < 60.0  # of which the markers' definitions are 15; the person is 80 px tall
