"""The recorded man who balances in four cameras: ground truth, initialization, fit and credible intervals."""

import numpy as np
import pytest

from workbench.body.kinematics import joint_jacobian, joints
from workbench.core.frame_cache import FrameCache
from workbench.datasets.multi_view import MultiView
from workbench.datasets.video import Video
from workbench.inference.initialization.from_keypoints import poses_from_keypoints
from workbench.inference.initialization.limb_lengths import of_keypoints
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.motion.smooth_fit import SmoothFit
from workbench.inference.least_squares.video.foot_contact import ANKLES, detect_foot_contacts, median_foot_height
from workbench.likelihoods.keypoints import KeypointLikelihood

NAMES = ("cam_01", "cam_02", "cam_03", "cam_04")


@pytest.fixture(scope="module")
def clip(data):
    return FrameCache(recorded_by(data, NAMES, n_frames=20))


def recorded_by(data, names, n_frames=None):
    """Return the dataset of these cameras at a tenth of the resolution."""
    folder = data / "pose2sim_balance"
    if not folder.is_dir():
        pytest.skip(f"no recordings of several cameras: {folder}")
    files = {name: name.replace("_", "") for name in names}
    dataset = MultiView(
        {name: str(folder / f"{file}.mp4") for name, file in files.items()}, str(folder / "Calib_qualisys.toml"),
        keypoints={name: str(folder / "openpose" / f"{file}_json") for name, file in files.items()},
        truth=str(folder / "joints_triangulated.trc"), scale=0.1, n_frames=n_frames,
    )  # fmt: skip
    if "cam_01" in names:
        with pytest.warns(UserWarning, match="are stretched"):  # two videos are 8 px narrower than calibrated
            _ = dataset.info
    return dataset


def test_the_projected_truth_is_at_the_detected_joints(clip):
    distances = [
        np.linalg.norm(view.camera.project(frame.truth.joints) - view.keypoints[:, :2], axis=1)
        for frame in clip
        for view in frame.views
    ]
    # checks axes, unit, keypoint layout and time; the triangulation error is a few pixels at full size, 1920 px
    assert np.nanmedian(distances) / 0.1 < 12.0


@pytest.mark.slow
def test_the_man_is_fitted_with_estimated_limb_lengths(clip):
    body = of_keypoints(clip)
    fitting = LeastSquares(body, KeypointLikelihood(body, sigma_px=1.0), problem=SmoothFit())
    fit, _, _ = fitting.fit_frames(list(clip), None, np.random.default_rng(0))
    truth = np.array([frame.truth.joints for frame in clip])
    errors = 1e3 * np.linalg.norm(joints(body.skeleton, fit.poses) - truth, axis=2)
    assert errors[:, 1:].mean() < 60.0  # the documented bound


def test_credible_intervals_of_four_cameras_cover_the_truth(clip):
    body, frames = of_keypoints(clip), list(clip)
    truth = np.array([frame.truth.joints for frame in frames])
    rates = {}
    for systematic_errors in (False, True):
        likelihood = KeypointLikelihood(body, sigma_px=1.0, loss="huber", systematic_errors=systematic_errors)
        fit, _, _ = LeastSquares(body, likelihood).fit_frames(frames, None, np.random.default_rng(0))
        jacobian = joint_jacobian(body.skeleton, fit.poses)
        deviation = np.sqrt(np.einsum("tjxp,tpq,tjxq->tjx", jacobian, fit.covariance, jacobian))
        rates[systematic_errors] = (np.abs(joints(body.skeleton, fit.poses) - truth) < 1.645 * deviation).mean()
    assert rates[False] < 0.7
    assert 0.8 < rates[True] < 0.97


@pytest.mark.slow
def test_one_camera_estimates_the_floor_from_the_feet(data):
    clip = FrameCache(recorded_by(data, NAMES[3:]))
    body = of_keypoints(clip)
    fitting = LeastSquares(body, KeypointLikelihood(body, sigma_px=1.0, loss="huber"), problem=SmoothFit())
    frames = list(clip)
    fit, poses, _ = fitting.fit_frames(frames, None, np.random.default_rng(0))
    contacts = detect_foot_contacts(body.skeleton, poses, np.array([frame.time_s for frame in frames]))
    ankles = [body.skeleton.joint(name) for name in ANKLES]
    truth = np.array([frame.truth.joints for frame in frames])
    assert contacts[:, 0].mean() > 0.3  # he stands on the left foot
    height = median_foot_height(body.skeleton, fit.poses, contacts)
    assert height == pytest.approx(np.median(truth[:, ankles, 2][contacts]), abs=0.06)
    errors = 1e3 * np.linalg.norm(joints(body.skeleton, fit.poses) - truth, axis=2)
    assert errors[:, 1:].mean() < 90.0


def first_pose_errors(clip):
    """Return the errors of the first pose, (joints, 3) in m, and the true joints."""
    frames, skeleton = list(clip), of_keypoints(clip).skeleton
    truth = frames[0].truth.joints[1:]
    return joints(skeleton, poses_from_keypoints(skeleton, frames)[:1])[0, 1:] - truth, truth


def test_the_first_pose_is_estimated_from_four_cameras(clip):
    errors, _ = first_pose_errors(clip)
    assert 1e3 * np.linalg.norm(errors, axis=1).mean() < 60.0  # the documented bound


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.filterwarnings("ignore:.*are stretched")
def test_the_first_pose_is_estimated_from_one_camera(data, name):
    """The errors parallel to the image have the same bound; the depth, determined by the prior, is known to a tenth."""
    clip = FrameCache(recorded_by(data, [name], n_frames=37))
    errors, truth = first_pose_errors(clip)
    (camera,) = clip.info.cameras
    assert 1e3 * np.linalg.norm(errors @ camera.rotation[:2].T, axis=1).mean() < 60.0
    assert np.abs(errors @ camera.rotation[2]).mean() < 0.1 * camera.to_camera(truth)[:, 2].mean()


def test_the_first_pose_is_estimated_from_the_annotations_of_one_frame(data):
    folder = data / "sports2d_walk"
    files = [str(folder / name) for name in ("demo.mp4", "Calib_demo.toml")]
    video = Video(*files, first_frame=64, n_frames=1, keypoints=str(folder / "keypoints.csv"))
    skeleton = of_keypoints(FrameCache(video)).skeleton
    (frame,) = video.frames()
    (view,) = frame.views
    pixels = view.camera.project(joints(skeleton, poses_from_keypoints(skeleton, [frame])[:1])[0])
    assert np.nanmean(np.linalg.norm(pixels - view.keypoints[:, :2], axis=1)) < 8.0  # the documented bound
