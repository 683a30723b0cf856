"""Initialization and fit of the recorded woman from annotated joints."""

import numpy as np
import pytest
from least_squares_scenes import PriorStub

from workbench.body.kinematics import joints
from workbench.core.prior import Smoothness
from workbench.datasets import person
from workbench.datasets.video import Video
from workbench.inference.initialization.poses import fit_annotations
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.motion.motion_fit import MotionFit
from workbench.likelihoods.keypoints import KeypointLikelihood
from workbench.priors.from_motions import walking

SCALE = 0.5


@pytest.fixture(scope="module")
def prior(data, cache):
    return walking(motions="cmu", data=str(data), cache=str(cache))


@pytest.fixture(scope="module")
def woman():
    return person.of_height(height_m=1.65, limb_lengths_m={"thigh": 0.40, "calf": 0.365, "forearm": 0.24})


def video(data, **parameters):
    folder = data / "sports2d_walk"
    files = {name: str(folder / "keypoints.csv") for name in ("initial_annotations", "keypoints")}
    options = {"first_frame": 64, "n_frames": 97, "scale": SCALE, **files, **parameters}
    return Video(str(folder / "demo.mp4"), str(folder / "Calib_demo.toml"), **options)


@pytest.mark.slow
@pytest.mark.parametrize(("last", "rate_hz"), [(None, np.nan), (160, 0.83)])
def test_the_initial_pose_fits_the_annotations(data, prior, woman, last, rate_hz):
    dataset = video(data, initial_last_frame=last)
    (camera,) = dataset.info.cameras
    fit = fit_annotations(prior.capabilities.motion, woman.skeleton, camera, dataset.info.initial_annotations)
    first = dataset.info.initial_annotations.keypoints[0]
    errors = np.linalg.norm(camera.project(joints(woman.skeleton, fit.pose[None])[0]) - first[:, :2], axis=1) / SCALE
    # annotations have a deviation of 4 px, of hidden joints 6–10 px; the constant style over five frames adds to it
    assert np.nanmean(errors) < (5.0 if last is None else 8.0)
    assert abs((fit.heading + np.pi / 2.0 + np.pi) % (2.0 * np.pi) - np.pi) < 0.2  # she walks along the camera's −x
    # frames 64 and 100 bound one cycle: 1.2 s
    assert fit.rate_hz == pytest.approx(rate_hz, abs=0.06, nan_ok=True)


@pytest.mark.slow
def test_the_walk_is_interpolated_between_annotations(data, prior, woman):
    dataset = video(data, eval_frames=[130])
    stiff = PriorStub(
        motion=prior.capabilities.motion, smoothness=Smoothness(phase=0.005, position=0.01, rotation=0.01)
    )
    likelihood, steady = KeypointLikelihood(woman, sigma_px=2.0), MotionFit(frames_per_style=None)
    inference = LeastSquares(woman, likelihood, stiff, problem=steady, n_particles=20)
    frames = list(dataset.frames())
    fit, _, _ = inference.fit_frames(frames, None, np.random.default_rng(0))
    annotations, camera = video(data)._keypoints, frames[0].views[0].camera
    errors = {}
    for index in map(int, annotations.frames):
        pixels = camera.project(joints(woman.skeleton, fit.poses[index - 64][None])[0])
        expected = (annotations.at(index)[0] + 0.5) * SCALE - 0.5
        errors[index] = np.nanmean(np.linalg.norm(pixels - expected, axis=1)) / SCALE
    assert max(error for index, error in errors.items() if index != 130) < 15.0
    assert errors[130] < 55.0  # the length of her forearm; half a cycle is a step
