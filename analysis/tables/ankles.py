"""Ankle angles of recorded walkers before one camera, by detected joints with heels and toes.

Recorded people, none of whom the prior is learned from, have the errors of a detector as in `fault_clips`: definitions
of joints that are constant over a clip, and noise of 1.5 % of the person's height that lasts for several frames. The
camera is known, and nothing is rendered. The true ankle angle is that of the recording's foot to its calf, less the
clip's mean, as a recording's neutral foot is not flat on the floor.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import scipy
from tqdm import tqdm

from analysis.tables.cameras import correlated
from analysis.tables.fault_clips import DEFINITION
from analysis.tables.table import markdown
from workbench.body.kinematics import forward
from workbench.body.limbs import person_with_feet
from workbench.body.shape import Shape
from workbench.body.skeleton import FOOT_POINTS, JOINT_NAMES
from workbench.body.stature import LIMBS, usual_height
from workbench.cameras.camera import plain_camera
from workbench.core.frame import Frame, View
from workbench.inference.initialization.limb_lengths import of_keypoints
from workbench.inference.least_squares.least_squares import LeastSquares
from workbench.inference.least_squares.video.detector_errors import offset_std
from workbench.likelihoods.keypoints import SIGMA_HEIGHTS, KeypointLikelihood
from workbench.motion.clip import MotionClip
from workbench.motion.sources import find_motion, motion_file, read_clip
from workbench.priors.from_motions import linear
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.rng import stream

CLIPS = ("07_01", "08_01", "16_15", "32_01", "35_01", "39_01")
"""Walks of six people."""
VIEWS: Mapping[str, float] = {"from the side": -90.0, "obliquely": -45.0, "from the front": 0.0}
"""Directions of the camera from the person, degrees to the left of the walk."""
_RATE_HZ, _MAX_S, _DISTANCE_M = 30.0, 3.0, 6.0
_NORMAL_90 = float(scipy.stats.norm.ppf(0.95))
_ANKLES = ("left_ankle_flexion", "right_ankle_flexion")
_HEADER = ("camera", "RMSE (°)", "RMSE without each clip's mean error (°)", "within the 90 % interval (%)")


@dataclass(frozen=True, eq=False)
class _Walk:
    """A person's shape and true poses (T, 27)."""

    shape: Shape
    poses: FloatArray


def table(data: str | None) -> str:
    """Return the table of the errors of ankle angles, in Markdown. data: folder of the recordings; raises InputError
    without it."""
    if data is None:
        raise InputError("needs recorded motion: --data FOLDER")
    walks, rows = [recorded_walk(name, data) for name in CLIPS], []
    for view, azimuth_deg in VIEWS.items():
        scored = [errors_deg(walk, azimuth_deg, seed) for seed, walk in enumerate(tqdm(walks, view, disable=None))]
        errors, deviations = (np.concatenate(each) for each in zip(*scored, strict=True))
        centred = np.concatenate([each - each.mean(axis=0) for each, _ in scored])
        within = 100.0 * (np.abs(errors) < _NORMAL_90 * deviations).mean()
        rms = [f"{np.sqrt((each**2).mean()):.1f}" for each in (errors, centred)]
        rows.append([view, *rms, f"{within:.0f}"])
    return markdown([_HEADER, ["---"] * len(_HEADER), *rows])


def recorded_walk(name: str, data: str) -> _Walk:
    """Return a recorded walk along x through the origin, with the ankles of the recording."""
    motion = find_motion(name, data=data, rate_hz=_RATE_HZ)
    clip = read_clip(motion_file(name, data))
    times_s, recorded_s = np.arange(len(motion)) / _RATE_HZ, np.arange(len(clip)) / clip.rate_hz
    ankles = [np.interp(times_s, recorded_s, each - each.mean()) for each in ankle_angles(clip)]
    poses = np.column_stack([motion.poses, *ankles])
    middle = max(len(poses) - int(_MAX_S * _RATE_HZ), 0) // 2
    poses = poses[middle : middle + int(_MAX_S * _RATE_HZ)]
    way = poses[-1, :2] - poses[0, :2]
    turn = -np.arctan2(way[1], way[0])
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    poses[:, :2] = (poses[:, :2] - poses[:, :2].mean(axis=0)) @ rotation.T
    poses[:, 3] += turn
    return _Walk(motion.shape, poses)


def ankle_angles(clip: MotionClip) -> Iterator[FloatArray]:
    """Yield the angles (F,), rad, of left and right foot to calf, dorsiflexion positive."""
    for side in "lr":
        knee, ankle, ball = (clip.positions[:, clip.joint(side + bone)] for bone in ("tibia", "foot", "toes"))
        calf, foot = ankle - knee, ball - ankle
        cosines = (calf * foot).sum(axis=1) / np.linalg.norm(calf, axis=1) / np.linalg.norm(foot, axis=1)
        yield np.arccos(cosines)


def errors_deg(walk: _Walk, azimuth_deg: float, seed: int) -> tuple[FloatArray, FloatArray]:
    """Return the errors of the ankle angles and their standard deviations, (T, 2), degrees, of a fit to a walk seen
    from a direction."""
    height_m = usual_height({limb: getattr(walk.shape, limb) for limb in LIMBS})
    frames = observed(walk, azimuth_deg, stream(seed, "ankles"))
    body = of_keypoints(frames, height_m=height_m, skeleton="feet")  # type: ignore[arg-type]
    likelihood = KeypointLikelihood(body, sigma_px=None, depth_sigma_m=0.1, systematic_errors=True, clip=frames)  # type: ignore[arg-type]
    prior = linear(motions="builtin", rate_hz=_RATE_HZ)
    inference = LeastSquares(body, likelihood, prior, max_iterations=100)
    fit, *_ = inference.fit_frames(frames, None, stream(0, "start"))
    columns = [body.skeleton.dof(name) for name in _ANKLES]
    errors = fit.poses[:, columns] - walk.poses[:, columns]
    return np.degrees(errors), np.degrees(np.sqrt(fit.covariance[:, columns, columns]))


def observed(walk: _Walk, azimuth_deg: float, rng: np.random.Generator) -> list[Frame]:
    """Return frames with the keypoints of a walk, heels and toes among them, with a detector's errors."""
    azimuth = np.radians(azimuth_deg)
    place = (_DISTANCE_M * float(np.cos(azimuth)), _DISTANCE_M * float(np.sin(azimuth)), 1.3)
    camera, skeleton = plain_camera(1280, 960, 1000.0, place, (0.0, 0.0, 0.9)), person_with_feet(walk.shape).skeleton
    frames = forward(skeleton, walk.poses)
    definitions = DEFINITION * offset_std(skeleton)[:, None] * rng.standard_normal((len(skeleton.names), 3))
    turned = frames.rotations[:, skeleton.parents.clip(min=0)]
    pixels = camera.project(frames.positions + (turned @ definitions[:, :, None])[..., 0])
    height_px = float(np.median(np.ptp(pixels[..., 1], axis=1)))
    pixels += SIGMA_HEIGHTS * height_px * correlated(rng, pixels.shape)
    rows = np.concatenate([pixels, np.full((*pixels.shape[:2], 1), 0.9)], axis=2)
    plain, ends = ([skeleton.joint(name) for name in names] for names in (JOINT_NAMES, FOOT_POINTS))
    image = np.zeros((camera.height, camera.width), np.uint8)
    return [Frame(t, t / _RATE_HZ, (View(camera, image, row[plain], feet=row[ends]),)) for t, row in enumerate(rows)]
