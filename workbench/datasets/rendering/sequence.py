"""Scenes of one moving person before a static camera, and their rendered sequences: motion, body and ground truth."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from workbench.body.kinematics import joints
from workbench.body.limbs import Body, person
from workbench.body.skeleton import POSE_NAMES, Skeleton
from workbench.cameras.camera import Camera, plain_camera
from workbench.core.checks import FINITE, RATE, Range, at_least, check
from workbench.core.frame import Truth
from workbench.core.side_information import INITIAL_POSE, PHASE_ENDS
from workbench.datasets.rendering.concatenation import concatenate
from workbench.datasets.rendering.perturbations import (
    DEFAULT_SIZES,
    SIZES_RANGE,
    calibration_error,
    miscalibrated,
    perturbation_sizes,
)
from workbench.datasets.rendering.subject import SceneSubject, draw_subject
from workbench.motion.full_skeleton import full_body, full_poses
from workbench.motion.pose_sequence import Motion
from workbench.motion.sources import UNKNOWN, find_motion, motion_file, read_clip
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.rng import stream

_INITIALIZATIONS = ("auto", "perturbed_truth")
_SKELETONS = ("person", "full")  # the 25-parameter person, or the motion file's own skeleton with every joint
_MARGIN = 0.05  # fraction of the image's width and height that the automatic camera leaves free on every side
_OVERSAMPLING = 4  # motions are concatenated, and their cycles detected, at this multiple of the dataset's rate
_RANGES = {
    "n_frames": at_least(2), "first_frame": at_least(0), "rate_hz": RATE, "width": at_least(32),
    "height": at_least(32), "focal_px": at_least(1), "view_azimuth_deg": FINITE, "seed": at_least(0),
}  # fmt: skip


@dataclass(kw_only=True, eq=False)
class Scene:
    """A person's motion in n_frames frames at rate_hz, and a camera that sees it.

    The person and the camera differ from those given to a tracker, because no tracker of real people has exact ones.
    Drawn by the seed are bone lengths changed by up to `lengths`, at the same height; limb radii changed by up to
    `radii`; limbs with a curved `profile`, 1 being a person's, with a neck and feet; clothes that swing and slide by a
    standard deviation of `clothes_m` (`subject`); a calibration whose focal length, principal point (over the image's
    width) and position (over its distance) are off by `camera` and whose orientation by `camera_deg` degrees, in random
    directions (`perturbations`); and an initial pose with Gaussian errors of `start_m` and `start_rad`.

    Parameters
    ----------
    motion : a name that `find_motion` accepts, or a list of names to `concatenate`.
    data : folder with cmu/ and bandai/.
    path : "straight" or "circle", of the built-in walker.
    first_frame : of the first motion, counted at rate_hz.
    width, height, focal_px : size of the image and focal length of a level camera, px.
    view_azimuth_deg : viewing direction relative to the direction of motion; 90 from the side, 180 from ahead.
    seed : of all random draws, and of the built-in walker.
    perturb : false sets the perturbations not in `perturbations` to zero. Without any, person, camera and initial
        pose are exact: an inverse crime, for tests of a tracker's computations.
    perturbations : sizes of perturbations by name; the others have `perturbations.DEFAULT_SIZES`.
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
    view_azimuth_deg: float = 90.0
    seed: int = 0
    perturb: bool = True
    perturbations: Mapping[str, float] | None = None

    @property
    def perturbation_sizes(self) -> Mapping[str, float]:
        """Sizes of all perturbations, by name."""
        return perturbation_sizes(self.perturb, self.perturbations)

    @property
    def kind(self) -> str:
        """The dataset's name in messages: its class in lower case."""
        return type(self).__name__.lower()

    def miscalibrated(self, camera: Camera, motion: Motion) -> Camera:
        """Return the estimate of a camera that a tracker gets, see `perturbations.miscalibrated`."""
        sizes, middle = self.perturbation_sizes, motion.poses[len(motion) // 2, :3]
        return miscalibrated(camera, middle, sizes["camera"], sizes["camera_deg"], self.seed)

    def source(self, rate_hz: float) -> dict[str, Any]:
        """Return the arguments of `find_motion` for the scene's motions at a rate."""
        return {"data": self.data, "rate_hz": rate_hz, "path": self.path, "seed": self.seed}

    def check(self, **expected: Range) -> None:
        """Raise InputError for the first parameter out of range, of all scenes' parameters and those in `expected`."""
        check(self.kind, self, perturbations=SIZES_RANGE, **(_RANGES | expected))


@dataclass(frozen=True, eq=False)
class RenderedSequence:
    """A person's motion in the F frames of a dataset.

    Parameters
    ----------
    motion : poses (F, P) of `body` at the dataset's rate.
    body : body given to a tracker: the person's, or that of the motion file's full skeleton.
    truths : F ground truths: poses of `body`, joints of `subject`.
    phases : (F,) gait phases, cycles, see `concatenation.concatenate`.
    subject : the rendered person.
    """

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
        """Phases of the first and the last frame, cycles, which paper D sets by hand; None without a cycle."""
        first, last = float(self.phases[0]), float(self.phases[-1])
        return (first, last) if np.isfinite(first + last) else None

    def perturbations(self, pose: FloatArray | None, camera: Camera, estimate: Camera) -> dict[str, FloatArray]:
        """Return the perturbations by name, {} for none: of the initial pose (P,), and of the estimate of a camera."""
        errors = {**self.subject.factors, **calibration_error(camera, estimate)}
        return errors | initial_pose_error(pose, self.motion.poses[0]) if errors else {}


def perturbed_pose(skeleton: Skeleton, pose: FloatArray, seed: int, sizes: Mapping[str, float]) -> FloatArray:
    """Return a pose (P,) with Gaussian errors of `start_m` in position and `start_rad` in every angle, clipped to the
    skeleton's limits; the pose itself where both sizes are zero."""
    if sizes["start_m"] == sizes["start_rad"] == 0.0:
        return pose
    sigma = np.full(len(pose), sizes["start_rad"])
    sigma[:3] = sizes["start_m"]
    error = sigma * stream(seed, "rough start").standard_normal(len(pose))
    return np.clip(pose + error, *skeleton.limits.T)


def initial_pose_error(initial: FloatArray | None, pose: FloatArray) -> dict[str, FloatArray]:
    """Return the error of an initial pose by name, for the recording: (P,), m and rad; {} for none."""
    return {} if initial is None or np.array_equal(initial, pose) else {"start": initial - pose}


def find_sequence(scene: Scene, skeleton: str = "person") -> RenderedSequence:
    """Return the sequence of a scene's motion, or of several, concatenated.

    Every frame's truth has pose, joints and, where the clip has one, the activity. skeleton: one of _SKELETONS; "full"
    needs a single motion with a file. Raises InputError for a motion that does not exist or is too short, and for an
    unknown skeleton.
    """
    if skeleton not in _SKELETONS:
        raise InputError(f"dataset: skeleton must be one of {', '.join(_SKELETONS)}, found {skeleton!r}")
    names, first = motion_names(scene.motion), _OVERSAMPLING * scene.first_frame
    clips = [find_motion(name, **scene.source(_OVERSAMPLING * scene.rate_hz)) for name in names]
    fine = concatenate(clips, _OVERSAMPLING * (scene.n_frames - 1) + 1, first)
    motion = replace(fine.motion, rate_hz=scene.rate_hz, poses=fine.motion.poses[::_OVERSAMPLING])
    body = person(motion.shape)
    if skeleton == "full":
        if len(names) > 1:
            raise InputError(f"dataset: skeleton=full expects one motion, found {len(names)}")
        recorded, person_motion = read_clip(motion_file(names[0], scene.data)), clips[0]
        full_motion = replace(person_motion, rate_hz=recorded.rate_hz, poses=full_poses(recorded))
        poses = full_motion.resampled(person_motion.rate_hz).poses[first::_OVERSAMPLING][: scene.n_frames]
        body, motion = full_body(recorded, person_motion.shape), replace(motion, poses=poses)
    subject = draw_subject(body, scene.perturbation_sizes, scene.seed)
    positions = joints(subject.body.skeleton, motion.poses)
    activities = [None if clips[k].activity == UNKNOWN else clips[k].activity for k in fine.clips[::_OVERSAMPLING]]
    frames = zip(motion.poses, positions, activities, strict=True)
    truths = tuple(Truth(pose=pose, joints=position, activity=activity) for pose, position, activity in frames)
    return RenderedSequence(motion, body, truths, fine.phases[::_OVERSAMPLING], subject)


def motion_names(motion: str | Sequence[str]) -> list[str]:
    """Return the names of the motions to concatenate; raises InputError for none."""
    names = [motion] if isinstance(motion, str | int) else list(motion)
    if not names:
        raise InputError("dataset: motion must name at least one motion, found none")
    return [str(name) for name in names]


def provided_assumptions(keys: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the assumptions on the initial pose that a dataset with these keys provides."""
    return (INITIAL_POSE, PHASE_ENDS) if keys.get("initialization") == "perturbed_truth" else ()


def perturbed_initialization(
    dataset: str, initialization: str, sequence: RenderedSequence | None, seed: int,
    sizes: Mapping[str, float] = DEFAULT_SIZES,
) -> tuple[FloatArray | None, tuple[float, float] | None]:  # fmt: skip
    """Return the perturbed first pose (P,) and the phases of both ends for "perturbed_truth"; None, None for "auto".

    dataset: its name for messages. sequence: the ground truth, None where it is unknown. sizes: as for
    `perturbed_pose`. Raises InputError for another
    `initialization`, and for "perturbed_truth" without ground truth or without a gait cycle.
    """
    if initialization not in _INITIALIZATIONS:
        expected = ", ".join(_INITIALIZATIONS)
        raise InputError(f"{dataset}: initialization must be one of {expected}, found {initialization!r}")
    if initialization == "auto":
        return None, None
    problem = f"{dataset}: use initialization=auto: perturbed_truth needs"
    if sequence is None:
        raise InputError(f"{problem} the ground truth, which is unknown")
    if sequence.phase_ends is None:
        raise InputError(f"{problem} phases, but {sequence.motion.name!r} has no gait cycle")
    pose = perturbed_pose(sequence.body.skeleton, sequence.motion.poses[0], seed, sizes)
    return pose, sequence.phase_ends


def automatic_camera(
    scene: Scene, motion: Motion, places: FloatArray, distance_m: float, name: str = "automatic"
) -> tuple[Camera, float]:
    """Return a level camera at the height of the belly that sees all joints in all frames, and its distance, m.

    The distance to the person half-way through the motion is `distance_m`, or larger where the whole motion does not
    fit into the image: u = f x / z of every joint in every frame gives a lower bound. places: (F, J, 3) joints, m.
    """
    width, height, focal_px = scene.width, scene.height, scene.focal_px
    angle = _direction(motion) + np.radians(scene.view_azimuth_deg)
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
        1.0 - depth.min(),  # at least 1 m in front of the camera
    )
    target = centre * right + (middle[:3] @ forward) * forward + [0.0, 0.0, level]
    x, y, z = target - distance * forward
    return plain_camera(width, height, focal_px, (x, y, z), tuple(target), name=name), float(distance)


def sequence_camera(scene: Scene, sequence: RenderedSequence, distance_m: float, name: str = "automatic") -> Camera:
    """Return the automatic camera of a sequence, with a warning where it is farther away than distance_m."""
    camera, distance = automatic_camera(scene, sequence.motion, sequence.places, distance_m, name)
    if distance > 1.01 * distance_m:
        away = f"{distance:.1f} m away instead of {distance_m:g}"
        message = f"{scene.kind}: the camera is {away}, so that the whole motion fits into its image"
        warnings.warn(message, stacklevel=2)
    return camera


def standing_height(motion: Motion, places: FloatArray) -> float:
    """Return the person's height, m, half-way through a motion whose joints are at `places` (F, J, 3)."""
    standing = places[len(motion) // 2, :, 2]
    return float(np.ptp(standing) + motion.shape.head_radius + motion.shape.calf_radii[1])


def _direction(motion: Motion) -> float:
    """Return the direction of motion, rad from the world's x, or the heading of a person who stays within 10 cm."""
    shift = motion.poses[-1, :2] - motion.poses[0, :2]
    if np.linalg.norm(shift) < 0.1:
        return float(motion.poses[len(motion) // 2, POSE_NAMES.index("root_heading")])
    return float(np.arctan2(shift[1], shift[0]))
