"""A scene, in which one person moves before a still camera, and its take: what the person does, frame by frame."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from workbench.body.camera import Camera, plain_camera
from workbench.body.kinematics import joints
from workbench.body.limbs import Body, person
from workbench.body.skeleton import POSE_NAMES, Skeleton
from workbench.core.checks import FINITE, RATE, Range, at_least, check
from workbench.core.frame import Truth
from workbench.core.side_information import INITIAL_POSE, PHASE_ENDS
from workbench.datasets.rendering.concatenation import splice
from workbench.datasets.rendering.perturbations import GIVEN, calibrated, calibration_error, sizes
from workbench.datasets.rendering.subject import SceneSubject, subject_of
from workbench.motion.full_skeleton import full_body, full_poses
from workbench.motion.pose_sequence import Motion
from workbench.motion.sources import UNKNOWN, find_motion, motion_file, read_clip
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.rng import stream

_STARTS = ("auto", "given")
_SKELETONS = ("person", "full")  # the person of 25 numbers, or the motion file's own skeleton with every joint
START_SIGMA_M, _START_SIGMA_RAD = 0.03, 0.05
"""How far off the pose is that is given to start from: a person sets a figure by hand, roughly."""
_MARGIN = 0.05  # fraction of the image's width and height that the automatic camera keeps free on every side
_FINE = 4  # clips are spliced, and their cycles found, at this multiple of the dataset's rate
_RANGES = {
    "n_frames": at_least(2), "first_frame": at_least(0), "rate_hz": RATE, "width": at_least(32),
    "height": at_least(32), "focal_px": at_least(1), "view_deg": FINITE, "seed": at_least(0),
}  # fmt: skip


@dataclass(kw_only=True, eq=False)
class Scene:
    """A person's motion in n_frames frames at rate_hz, and a camera that sees it.

    motion: a name as `find_motion` knows them, or a list of names that take even turns (`splice`).
    data: the folder that holds cmu/ and bandai/. path: "straight" or "circle", of the builtin walker. first_frame: of
    the (first) motion, counted at rate_hz. A level camera of width × height pixels and focal length focal_px looks at
    view_deg (degrees) to the motion's direction: 90 from the side, 180 from ahead. seed: of all that is drawn, and of
    the builtin walker.

    The person and the camera are not those that a tracker is told: no tracker of real people knows either. Drawn by
    the seed are bones longer or shorter by up to `lengths`, at the same height, and thicker or thinner by up to
    `radii`; limbs that bulge by `profile`, 1 being a person, with a neck and feet; clothes that swing and slide by a
    standard deviation of `clothes_m` (`subject`); a camera told whose focal length, principal point (of the image's
    width) and place (of its distance) are off by `camera` and whose direction by `camera_deg` degrees, in random
    directions (`perturbations`); and a start off by Gaussian errors of `start_m` and `start_rad`. departures: other
    sizes of these, by name; the rest are `perturbations.USUAL`. exact: the rest are zero; with no departures the person
    is the tracker's own body, and what is told is the truth. That is an inverse crime, for tests of a tracker's sums.
    """

    motion: Any = "builtin"  # a name or a list of them, for which a schema has no other type
    data: str | None = None
    path: str = "straight"
    n_frames: int = 28
    first_frame: int = 0
    rate_hz: float = 14.0
    width: int = 640
    height: int = 480
    focal_px: float = 700.0
    view_deg: float = 90.0
    seed: int = 0
    exact: bool = False
    departures: Mapping[str, float] | None = None

    @property
    def departure(self) -> Mapping[str, float]:
        """How far each thing departs from what is told, by name."""
        return sizes(self.exact, self.departures)

    @property
    def kind(self) -> str:
        """The dataset's name in messages: its class in lower case."""
        return type(self).__name__.lower()

    def calibrated(self, camera: Camera, motion: Motion) -> Camera:
        """Return the camera that sees a motion as a calibration found it, which a tracker uses, see `calibrated`."""
        off, middle = self.departure, motion.poses[len(motion) // 2, :3]
        return calibrated(camera, middle, off["camera"], off["camera_deg"], self.seed)

    def source(self, rate_hz: float) -> dict[str, Any]:
        """Return what tells `find_motion` which of a motion's versions the scene shows, at a rate."""
        return {"data": self.data, "rate_hz": rate_hz, "path": self.path, "seed": self.seed}

    def check(self, **expected: Range) -> None:
        """Raise InputError for the first number that is not in its range, of those that all scenes share and others."""
        check(self.kind, self, departures=GIVEN, **(_RANGES | expected))


@dataclass(frozen=True, eq=False)
class Take:
    """A person's motion in the F frames of a dataset, at its rate, and F truths. body: the person's, or of the motion
    file's full skeleton, as a tracker is told; the poses (F, P) of motion and truths are this body's. phases: (F,)
    cycles, see `concatenation.splice`. subject: who is really shown, whose joints the truths have."""

    motion: Motion
    body: Body
    truths: tuple[Truth, ...]
    phases: FloatArray
    subject: SceneSubject

    @property
    def places(self) -> FloatArray:
        """The true joints (F, J, 3), m."""
        return np.stack([np.asarray(truth.joints) for truth in self.truths])

    @property
    def phase_ends(self) -> tuple[float, float] | None:
        """The phases of the first and the last frame, cycles, as paper D sets them by hand; None without a cycle."""
        first, last = float(self.phases[0]), float(self.phases[-1])
        return (first, last) if np.isfinite(first + last) else None

    def departures(self, start: FloatArray | None, camera: Camera, told: Camera) -> dict[str, FloatArray]:
        """How far who and what is shown is off what is told, with a start (P,), by name; {} where nothing is."""
        found = {**self.subject.factors, **calibration_error(camera, told)}
        return found | start_error(start, self.motion.poses[0]) if found else {}

    def rough_start(self, seed: int) -> FloatArray:
        """The first pose (P,) with Gaussian errors of 3 cm in place and 0.05 rad in every angle, within the limits."""
        return rough_pose(self.body.skeleton, self.motion.poses[0], seed)


def rough_pose(
    skeleton: Skeleton, pose: FloatArray, seed: int, sigma_m: float = START_SIGMA_M, sigma_rad: float = _START_SIGMA_RAD
) -> FloatArray:
    """Return a pose (P,) with Gaussian errors in place and in every angle, within the limits."""
    sigma = np.full(len(pose), sigma_rad)
    sigma[:3] = sigma_m
    error = sigma * stream(seed, "rough start").standard_normal(len(pose))
    return np.clip(pose + error, *skeleton.limits.T)


def start_error(told: FloatArray | None, pose: FloatArray) -> dict[str, FloatArray]:
    """Return the error of the given start by name, for the recording: (P,), m and rad; {} for none."""
    return {} if told is None or np.array_equal(told, pose) else {"start": told - pose}


def find_take(scene: Scene, skeleton: str = "person") -> Take:
    """Find the frames of a scene's motion, or of several spliced. Every frame's truth has pose, joints and, where the
    clip says so, the activity. skeleton: one of _SKELETONS; "full" takes one motion only, which has a file. Raises
    InputError for a motion that cannot be found or is too short, and another skeleton."""
    if skeleton not in _SKELETONS:
        raise InputError(f"dataset: skeleton must be one of {', '.join(_SKELETONS)}, found {skeleton!r}")
    names, first = motion_names(scene.motion), _FINE * scene.first_frame
    clips = [find_motion(name, **scene.source(_FINE * scene.rate_hz)) for name in names]
    fine = splice(clips, _FINE * (scene.n_frames - 1) + 1, first)
    shown = replace(fine.motion, rate_hz=scene.rate_hz, poses=fine.motion.poses[::_FINE])
    body = person(shown.shape)
    if skeleton == "full":
        if len(names) > 1:
            raise InputError(f"dataset: skeleton=full shows one motion, found {len(names)} to splice")
        recorded, person_motion = read_clip(motion_file(names[0], scene.data)), clips[0]
        own = replace(person_motion, rate_hz=recorded.rate_hz, poses=full_poses(recorded))
        poses = own.resampled(person_motion.rate_hz).poses[first::_FINE][: scene.n_frames]
        body, shown = full_body(recorded, person_motion.shape), replace(shown, poses=poses)
    subject = subject_of(body, scene.departure, scene.seed)
    places = joints(subject.body.skeleton, shown.poses)
    activities = [None if clips[k].activity == UNKNOWN else clips[k].activity for k in fine.clips[::_FINE]]
    frames = zip(shown.poses, places, activities, strict=True)
    truths = tuple(Truth(pose=pose, joints=place, activity=activity) for pose, place, activity in frames)
    return Take(shown, body, truths, fine.phases[::_FINE], subject)


def motion_names(motion: str | Sequence[str]) -> list[str]:
    """The names of the motions that take turns; InputError where there is none."""
    names = [motion] if isinstance(motion, str | int) else list(motion)
    if not names:
        raise InputError("dataset: motion must name at least one motion, found none")
    return [str(name) for name in names]


def offered_start(keys: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the start's side information that a dataset with these keys provides, see `given_start`."""
    return (INITIAL_POSE, PHASE_ENDS) if keys.get("start") == "given" else ()


def given_start(
    dataset: str, start: str, take: Take | None, seed: int
) -> tuple[FloatArray | None, tuple[float, float] | None]:
    """Offer with start="given" the rough first pose (P,) and the phase's ends, else nothing; raises InputError, naming
    the dataset, where `start` is unknown or asks for a truth that is not there."""
    if start not in _STARTS:
        raise InputError(f"{dataset}: start must be one of {', '.join(_STARTS)}, found {start!r}")
    if start == "auto":
        return None, None
    if take is None:
        raise InputError(f"{dataset}: start=given needs the truth, which is not known; use start=auto")
    if take.phase_ends is None:
        lacking = f"the ends of the gait's phase, but {take.motion.name!r} has no gait cycle"
        raise InputError(f"{dataset}: start=given gives {lacking}; use start=auto")
    return take.rough_start(seed), take.phase_ends


def automatic_camera(
    scene: Scene, motion: Motion, places: FloatArray, distance_m: float, name: str = "automatic"
) -> tuple[Camera, float]:
    """A level camera at the height of the belly that keeps all joints `places` (F, J, 3) in view, and its distance, m.
    It looks at the scene's view_deg to the motion's direction from distance_m to where the person is half-way through,
    or from further away where the whole motion would not fit into width × height. Distances obey u = f x / z for every
    joint of every frame: each asks for the camera to be so far away at least."""
    width, height, focal_px = scene.width, scene.height, scene.focal_px
    angle = _direction(motion) + np.radians(scene.view_deg)
    forward, right = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([np.sin(angle), -np.cos(angle), 0.0])
    middle = motion.poses[len(motion) // 2]
    sideways, depth = places @ right, places @ forward - middle[:3] @ forward
    centre = 0.5 * (sideways.min() + sideways.max())
    level = motion.poses[:, 2].mean() + 0.1 * standing_height(motion, places)
    thickness = motion.shape.head_radius
    half_width, half_height = np.array([width, height]) * (0.5 - _MARGIN)
    distance = max(
        distance_m,
        ((np.abs(sideways - centre) + thickness) * focal_px / half_width - depth).max(),
        ((np.abs(places[..., 2] - level) + thickness) * focal_px / half_height - depth).max(),
        1.0 - depth.min(),  # nobody comes nearer than a metre
    )
    target = centre * right + (middle[:3] @ forward) * forward + [0.0, 0.0, level]
    x, y, z = target - distance * forward
    return plain_camera(width, height, focal_px, (x, y, z), tuple(target), name=name), float(distance)


def take_camera(scene: Scene, take: Take, distance_m: float, name: str = "automatic") -> Camera:
    """The automatic camera of a take, with a warning where it has to be further away than distance_m."""
    camera, distance = automatic_camera(scene, take.motion, take.places, distance_m, name)
    if distance > 1.01 * distance_m:
        away = f"{distance:.1f} m away instead of {distance_m:g}"
        words = f"{scene.kind}: the camera is {away}, so that the whole motion fits into its image"
        warnings.warn(words, stacklevel=2)
    return camera


def standing_height(motion: Motion, places: FloatArray) -> float:
    """Return the person's height, m, half-way through a motion whose joints are at `places` (F, J, 3)."""
    standing = places[len(motion) // 2, :, 2]
    return float(np.ptp(standing) + motion.shape.head_radius + motion.shape.calf_radii[1])


def _direction(motion: Motion) -> float:
    """The angle, rad, from the world's x to where the person gets, or faces where they stay within 10 cm."""
    way = motion.poses[-1, :2] - motion.poses[0, :2]
    if np.linalg.norm(way) < 0.1:
        return float(motion.poses[len(motion) // 2, POSE_NAMES.index("root_heading")])
    return float(np.arctan2(way[1], way[0]))
