"""Estimated cameras of walkers: errors of focal length and depth over their stated standard deviations.

Generated walkers before random cameras, with keypoints that have a detector's errors as measured in
`least_squares.video.detector_errors`: definitions of joints that are constant over a clip, and noise of 1.5 % of the
person's height that lasts for several frames. Nothing is rendered, so that the detector itself is not part of it.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy
from tqdm import tqdm

from analysis.tables.table import markdown
from workbench.body.kinematics import forward
from workbench.body.limbs import person
from workbench.body.skeleton import JOINT_NAMES
from workbench.body.stature import LIMBS, usual_height
from workbench.cameras.camera import Camera, level_rotation
from workbench.cameras.person_height import Measurements, calibrate_by_height, detected_segments
from workbench.core.frame import Frame, View
from workbench.inference.initialization.limb_lengths import of_keypoints
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.video.detector_errors import offset_std
from workbench.likelihoods.keypoints import SIGMA_HEIGHTS, KeypointLikelihood
from workbench.motion.synthetic.gait import subjects, walker
from workbench.utils.arrays import FloatArray
from workbench.utils.rng import stream

N_SCENES = 20
SIZE = (1280, 720)
_RATE_HZ, _DURATION_S = 30.0, 3.0
_CORRELATION = 0.8
"""Of a joint's errors in successive frames at 30 Hz."""
_NORMAL_90 = float(scipy.stats.norm.ppf(0.95))
_HEADER = ("quantity", "mean of z", "standard deviation of z", "within the 90 % interval")
"""z = (estimate − truth) / σ"""


@dataclass(frozen=True, eq=False)
class _Scene:
    """A walker's true camera and detections: keypoints (T, J, 3), and depth (T,) of the pelvis, m."""

    camera: Camera
    keypoints: FloatArray
    depth_m: FloatArray
    height_m: float


def table(n_scenes: int = N_SCENES) -> str:
    """Return the table of z of focal length and depth, in Markdown."""
    z = np.array([scores(scene) for scene in tqdm(scenes(n_scenes), total=n_scenes, disable=None)])
    rows = [
        [name, f"{each.mean():.2f}", f"{each.std(ddof=1):.2f}", f"{(np.abs(each) < _NORMAL_90).sum()} of {len(each)}"]
        for name, each in zip(("logarithm of the focal length", "logarithm of the distance"), z.T, strict=True)
    ]
    return markdown([_HEADER, ["---"] * len(_HEADER), *rows])


def scenes(n: int) -> Iterator[_Scene]:
    """Yield walkers before random cameras that see them entirely."""
    for seed in range(n):
        rng = stream(seed, "scene")
        while (scene := _scene(rng)) is None:
            pass
        yield scene


def _scene(rng: np.random.Generator) -> _Scene | None:
    """Return a random scene, None if the walker leaves the image."""
    (subject,) = subjects(1, rng)
    skeleton = person(subject.shape).skeleton
    poses = walker(subject, _DURATION_S, _RATE_HZ).poses
    frames = forward(skeleton, poses)
    turn, distance_m = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(3.0, 9.0)
    rotation = scipy.spatial.transform.Rotation.from_euler("z", turn).as_matrix()
    middle = frames.positions[:, 0].mean(axis=0) * [1.0, 1.0, 0.0]
    places = (frames.positions - middle) @ rotation.T + [distance_m, 0.0, 0.0]
    camera = random_camera(rng, distance_m)
    definitions = offset_std(skeleton)[:, None] * rng.standard_normal((len(skeleton.names), 3))
    turned = rotation @ frames.rotations[:, skeleton.parents.clip(min=0)]
    pixels = camera.project(places + (turned @ definitions[:, :, None])[..., 0])
    if not np.isfinite(pixels).all() or (pixels < 0.0).any() or (pixels > np.array(SIZE) - 1.0).any():
        return None
    height_px = float(np.median(np.ptp(pixels[..., 1], axis=1)))
    noise = SIGMA_HEIGHTS * height_px * correlated(rng, pixels.shape)
    order = [skeleton.joint(name) for name in JOINT_NAMES]
    keypoints = np.concatenate([pixels + noise, np.full((*pixels.shape[:2], 1), 0.95)], axis=2)[:, order]
    height_m = usual_height({limb: getattr(subject.shape, limb) for limb in LIMBS}) * float(
        np.exp(rng.normal(0.0, 0.01))
    )
    return _Scene(camera, keypoints, camera.to_camera(places)[:, 0, 2], height_m)


def random_camera(rng: np.random.Generator, distance_m: float) -> Camera:
    """Return a camera as people set them up, directed at a person at a distance ahead."""
    focal_px = float(np.exp(rng.normal(np.log(max(SIZE)), 0.35)))
    height_m = float(np.exp(rng.normal(np.log(1.4), 0.4)))
    tilt = np.arctan2(height_m - 0.9, distance_m) + rng.normal(0.0, np.radians(3.0))
    roll = rng.normal(0.0, np.radians(2.0))
    rotation = level_rotation(tilt, roll)
    matrix = np.array([[focal_px, 0.0, (SIZE[0] - 1) / 2], [0.0, focal_px, (SIZE[1] - 1) / 2], [0.0, 0.0, 1.0]])
    return Camera("camera", *SIZE, matrix, rotation, -rotation @ [0.0, 0.0, height_m], np.zeros(5))


def correlated(rng: np.random.Generator, shape: tuple[int, ...]) -> FloatArray:
    """Return standard normal noise (T, …) with the correlation _CORRELATION between successive frames."""
    innovations = rng.standard_normal(shape)
    innovations[1:] *= np.sqrt(1.0 - _CORRELATION**2)
    return np.asarray(scipy.signal.lfilter([1.0], [1.0, -_CORRELATION], innovations, axis=0))


def scores(scene: _Scene) -> tuple[float, float]:
    """Return z of the logarithms of the focal length and of the pelvis' distance, the median over the frames."""
    n = len(scene.keypoints)
    pixels, confidence = scene.keypoints[..., :2], scene.keypoints[..., 2]
    segments = detected_segments(np.arange(n), pixels, confidence, None)
    measured = Measurements(scene.height_m, gait=0.04, step_frames=0.5 * _RATE_HZ)
    estimate = calibrate_by_height("camera", SIZE, segments, measured)
    image = np.zeros((2, 2), np.uint8)
    frames = [
        Frame(t, t / _RATE_HZ, (View(estimate.camera, image, keypoints),))
        for t, keypoints in enumerate(scene.keypoints)
    ]
    body = of_keypoints(frames, height_m=scene.height_m)
    sigma_px = SIGMA_HEIGHTS * float(np.median(np.ptp(pixels[..., 1], axis=1)))
    likelihood = KeypointLikelihood(body, sigma_px=sigma_px, systematic_errors=True)
    streams = {name: stream(0, name) for name in ("start", "prior")}
    fit, *_ = LeastSquares(body, likelihood).fit_frames(frames, None, streams["start"])
    axis = estimate.camera.rotation[2]
    depths = estimate.camera.to_camera(fit.poses[:, :3])[:, 2]
    deviations = np.sqrt(np.einsum("i,tij,j->t", axis, fit.covariance[:, :3, :3], axis)) / depths
    focal_px = scene.camera.matrix[0, 0]
    z_focal = np.log(estimate.values["focal_px"] / focal_px) * estimate.values["focal_px"] / estimate.sigma["focal_px"]
    return float(z_focal), float(np.median(np.log(depths / scene.depth_m) / deviations))
