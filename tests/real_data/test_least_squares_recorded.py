"""Paper D on held-out recorded walks and runs: errors of the fit from an automatic initialization."""

import warnings

import numpy as np
import pytest
from least_squares_scenes import PriorStub

from workbench.body.limbs import person
from workbench.datasets.points import Points
from workbench.evaluation.errors.pose_errors import step_errors
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.likelihoods.surface_points import SurfacePoints
from workbench.motion.library import write_library
from workbench.motion.sources import find_sources, load_motion
from workbench.priors.from_motions import activity

WALKS = ("dataset-1_walk_normal_001", "dataset-1_walk_feminine_001", "dataset-2_walk_youthful_005")
RUNS = ("dataset-1_run_active_001", "dataset-1_run_tired_001", "dataset-2_run_elderly_005")


@pytest.fixture(scope="module")
def model(data, tmp_path_factory):
    """Return the model learned from every third walk and run of the database, without the tracked clips."""
    files = [file for file in find_sources([data / "bandai"]) if "_walk_" in file.name or "_run_" in file.name]
    folder = tmp_path_factory.mktemp("library")
    write_library(folder / "third.h5", [load_motion(file) for file in files[::3]])
    library = {"motions": str(folder / "third.h5"), "cache": str(folder), "exclude": [*WALKS, *RUNS]}
    return activity(**library, n_components=30).model


def errors_of(model, data, clip):
    """Return the mean joint error, mm, and the RMS errors of knee and hip flexion, degrees."""
    first_frame = 0 if clip == "dataset-1_run_active_001" else 10
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # the camera is moved back
        dataset = Points(motion=clip, data=str(data), first_frame=first_frame, perturb=False)
        frames, body = list(dataset.frames()), person(dataset.info.shape)
    streams = dict(zip(("start", "prior"), np.random.default_rng(0).spawn(2), strict=True))
    fitting = LeastSquares(body, SurfacePoints(body), PriorStub(motion=model))
    errors = [step_errors(step, body) for step in fitting.run(frames, None, streams)]
    knee, hip = (
        np.sqrt(np.mean([error[name] ** 2 for error in errors]))
        for name in ("knee_flexion_rmse_deg", "hip_flexion_rmse_deg")
    )
    return np.mean([error["mpjpe_abs_mm"] for error in errors]), knee, hip


@pytest.mark.slow
@pytest.mark.parametrize(("clips", "max_mm"), [(WALKS, 22.0), (RUNS, 26.0)])
def test_held_out_clips_are_tracked(model, data, clips, max_mm):
    """400 points a frame, 2 cm noise at 4 m, 15 % outliers, 14 Hz, with the true body."""
    errors = np.array([errors_of(model, data, clip) for clip in clips])
    assert (errors.mean(axis=0) <= [max_mm, 4.5, 3.5]).all()
    assert errors[:, 0].max() < 40.0  # no track is lost
