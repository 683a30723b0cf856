"""Generated walkers of random size as a detector sees them in one camera, with the errors that a real detector has."""

from dataclasses import dataclass, replace

import numpy as np

from workbench.body.kinematics import forward
from workbench.body.skeleton import Skeleton, person_skeleton
from workbench.cameras.camera import Camera, plain_camera
from workbench.cameras.person_height import Measurements, calibrate_by_height, detected_segments
from workbench.core.frame import Frame, View
from workbench.inference.initialization import limb_lengths as lengths
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.video.detector_errors import offset_std
from workbench.likelihoods.keypoints import KeypointLikelihood
from workbench.motion.synthetic.gait import subjects, walker
from workbench.priors.from_motions import linear
from workbench.utils.rng import rng_streams

RATE_HZ, N_FRAMES, WIDTH, HEIGHT, FOCAL_PX = 30.0, 75, 1280, 720, 1100.0
NOISE, RHO = 0.0075, 0.7
"""Standard deviation of a joint in heights of the person, and its correlation from frame to frame: a fit is then 1 % of
the height from the joints, as that to a woman in `sports2d_walk`."""
LANDMARK_STD_M = 0.04


@dataclass(frozen=True, eq=False)
class DetectedWalker:
    """A walker with true poses (T, P), and the frames of one camera: keypoints, and world landmarks. assumed_m: the
    height that the user gives. sigma_px: standard deviation of the keypoints."""

    skeleton: Skeleton
    poses: np.ndarray
    camera: Camera
    pixels: np.ndarray
    landmarks: np.ndarray
    assumed_m: float
    sigma_px: float

    def frames(self, camera):
        """Return the frames as of a camera, the true one or an estimated one."""
        image = np.zeros((HEIGHT, WIDTH), np.uint8)
        rows = np.concatenate([self.pixels, np.ones((N_FRAMES, 15, 1))], axis=2)
        return [
            Frame(t, t / RATE_HZ, (View(camera, image, rows[t], self.landmarks[t]),)) for t in range(N_FRAMES)
        ]  # fmt: skip

    def estimated_camera(self):
        """Return the camera as estimated from the person's head and feet."""
        segments = detected_segments(np.arange(N_FRAMES), self.pixels, np.ones((N_FRAMES, 15)), self.landmarks)
        known = Measurements(self.assumed_m, gait=0.04, step_frames=0.5 * RATE_HZ)
        return calibrate_by_height("camera", (WIDTH, HEIGHT), segments, known).camera

    def fit(self, camera, seed=0):
        """Return the fit of `workbench track` without learned postures."""
        frames = self.frames(camera)
        body = lengths.of_keypoints(frames, height_m=self.assumed_m)
        likelihood = KeypointLikelihood(body, sigma_px=self.sigma_px, depth_sigma_m=0.1, systematic_errors=True)
        inference = LeastSquares(body, likelihood, linear(motions="builtin", frames_hz=RATE_HZ), max_iterations=100)
        return inference.fit_frames(frames, None, rng_streams(seed)["start"])[0]


def detected_walker(seed):
    """Return a walker who passes a camera at 4 to 6.5 m within 35° of across."""
    rng = np.random.default_rng([seed, 58])
    height_m = rng.uniform(1.55, 1.9)
    deviations = [
        lengths.WIDTH_SIGMA if each in lengths.WIDTHS else lengths.PROPORTION_SIGMA for each in lengths.LENGTHS
    ]
    proportions = deviations * rng.standard_normal(len(deviations))
    shape = lengths.shape_of(np.concatenate([[np.log(height_m / lengths.AVERAGE_M)], proportions]))
    motion = walker(replace(subjects(1, rng)[0], shape=shape), N_FRAMES / RATE_HZ, RATE_HZ)
    poses, heading = motion.poses[:N_FRAMES].copy(), rng.uniform(-0.6, 0.6) + np.pi * rng.integers(2)
    turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    poses[:, :2] = (poses[:, :2] - poses[:, :2].mean(axis=0)) @ turn.T
    poses[:, 3] += heading
    distance_m, skeleton = rng.uniform(4.0, 6.5), person_skeleton(shape)
    position, aim = (0.0, -distance_m, rng.uniform(1.0, 1.7)), (0.0, 0.0, rng.uniform(0.8, 1.1))
    camera = plain_camera(WIDTH, HEIGHT, FOCAL_PX, position, aim)
    body = forward(skeleton, poses)
    # offset_std is the difference of two definitions, a detector's is one
    definitions = np.sqrt(0.5) * offset_std(skeleton)[:, None] * rng.standard_normal((15, 3))
    axes = body.rotations[:, skeleton.parents.clip(min=0)]
    person_px = FOCAL_PX * height_m / distance_m
    pixels = camera.project(body.positions + np.einsum("tjxy,jy->tjx", axes, definitions))
    relative = (body.positions - body.positions[:, :1]) @ camera.rotation.T / height_m
    return DetectedWalker(
        skeleton, poses, camera, pixels + NOISE * person_px * autoregression(rng, (N_FRAMES, 15, 2)),
        lengths.AVERAGE_M * relative + LANDMARK_STD_M * autoregression(rng, (N_FRAMES, 15, 3)),
        height_m * np.exp(lengths.KNOWN_HEIGHT_SIGMA * rng.standard_normal()), 0.015 * person_px,
    )  # fmt: skip


def autoregression(rng, shape):
    """Return noise (T, ...) of unit variance with the correlation RHO from frame to frame."""
    noise = rng.standard_normal(shape)
    for t in range(1, len(noise)):
        noise[t] = RHO * noise[t - 1] + np.sqrt(1.0 - RHO**2) * noise[t]
    return noise
