"""Dataset of rendered images of a moving person, with ground truth."""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from tqdm import tqdm

from workbench.body.kinematics import joints
from workbench.body.limbs import Body, person, with_neck_and_feet
from workbench.body.skeleton import POSE_NAMES, parameters
from workbench.cameras.camera import Camera
from workbench.cameras.camera_file import load_cameras
from workbench.core.capabilities import IMAGES, KEYPOINTS, START, Traits, component_traits
from workbench.core.checks import at_least, one_of, optional
from workbench.core.dataset import SequenceInfo
from workbench.core.frame import Frame, Truth, View
from workbench.core.side_information import INITIAL_POSE
from workbench.datasets.rendering import render, sequence, surroundings
from workbench.datasets.rendering import subject as subjects
from workbench.datasets.rendering.cache import cached_images, image_key
from workbench.datasets.rendering.concatenation import concatenate
from workbench.datasets.rendering.perturbations import calibration_error
from workbench.datasets.rendering.sequence import Scene
from workbench.datasets.rendering.subject import SceneSubject, draw_subject
from workbench.datasets.rendering.surroundings import passing_occluder
from workbench.motion.pose_sequence import Motion
from workbench.motion.sources import find_motion
from workbench.motion.synthetic.gait import PATHS
from workbench.utils.arrays import BoolArray, ByteArray, FloatArray
from workbench.utils.errors import InputError
from workbench.utils.input_path import InputPath, expanded
from workbench.utils.rng import stream
from workbench.utils.source_hash import code_digest

_MISSING_FRACTION = 0.1  # fraction of the joints that the simulated detector misses


@dataclass(kw_only=True, eq=False)
class Synthetic(Scene):
    """Ray-cast grey images of a moving person before a cluttered background in one static camera.

    Raises InputError for parameters out of range. `info` does for a motion that does not exist or is too short, and a
    camera that never sees the person.

    Parameters
    ----------
    motion to perturbations : see `Scene`; the seed is also of clothes, background, noise and keypoints.
    cache : folder for rendered images; None: every process renders them.
    moving : names of pose parameters, or of body parts (`skeleton.PARTS`), that move; all others are constant as in the
        first frame used. None: all move.
    calibration_file : camera file whose first camera replaces the scene's. None: the person is person_px tall half-way
        through, or smaller where the whole motion does not fit into width × height.
    occluder : whether a rectangle drawn by the seed passes in front of the person once, see `passing_occluder`.
    noise_std : σ of the sensor, grey levels.
    contrast, clutter : strength of the clothes' texture and of the background; 1 is about 24 and 35 grey levels.
    neck_and_feet : whether the tracker's body has neck and feet. A perturbed subject has its own.
    keypoint_sigma_px : σ of a detector of 2-D joints, px, which misses a fraction _MISSING_FRACTION; None: no detector.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare images of one camera, an initial pose, and detected joints where they are simulated."""
        keypoints = () if keys.get("keypoint_sigma_px") is None else (KEYPOINTS,)
        return component_traits(IMAGES, START, INITIAL_POSE, *keypoints)

    n_frames: int = 50
    rate_hz: float = 30.0
    cache: str | None = None
    moving: Sequence[str] | None = None
    calibration_file: InputPath | None = None
    person_px: float = 270.0
    occluder: bool = False
    noise_std: float = 4.0
    contrast: float = 1.0
    clutter: float = 1.0
    neck_and_feet: bool = False
    keypoint_sigma_px: float | None = None

    def __post_init__(self) -> None:
        self.check(path=one_of(*PATHS), person_px=at_least(1), noise_std=at_least(0), contrast=at_least(0))
        self.check(clutter=at_least(0), keypoint_sigma_px=optional(at_least(0)))

    @cached_property
    def info(self) -> SequenceInfo:
        """The camera, the person's measurements and the initial pose, with perturbations."""
        motion = self._used_motion
        return SequenceInfo(
            name=f"synthetic {motion.name}", n_frames=self.n_frames, rate_hz=self.rate_hz,
            cameras=(self.calibrated_camera,), shape=motion.shape, body=self.body if self.neck_and_feet else None,
            initial_pose=self._initial_pose, has_keypoints=self.keypoint_sigma_px is not None,
            perturbations={
                **self._subject.factors, **calibration_error(self.true_camera, self.calibrated_camera),
                **sequence.initial_pose_error(self._initial_pose, motion.poses[0]),
            },
        )  # fmt: skip

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in order, each with true pose and joints; all are rendered before the first."""
        poses = self._used_motion.poses
        places = joints(self._subject.body.skeleton, poses)
        cameras = () if self.calibrated_camera is self.true_camera else (self.true_camera,)
        for i, image in enumerate(self._images):
            index = self.first_frame + i
            truth = Truth(pose=poses[i], joints=places[i], cameras=cameras)
            views = (View(self.calibrated_camera, image, self._keypoints(i, places[i])),)
            yield Frame(index, index / self.rate_hz, views, truth)

    def _keypoints(self, i: int, places: FloatArray) -> FloatArray | None:
        """Return the detections (J, 3) of joints at places (J, 3), m, in frame i; NaN outside the image."""
        if self.keypoint_sigma_px is None:
            return None
        rng, camera = stream(self.seed, "keypoints", i), self.true_camera
        pixels = camera.project(places)
        keypoints = np.column_stack([pixels, np.ones(len(pixels))])
        keypoints[:, :2] += self.keypoint_sigma_px * rng.standard_normal(pixels.shape)
        keypoints[~_inside(camera, pixels) | (rng.random(len(pixels)) < _MISSING_FRACTION)] = np.nan
        return keypoints

    @cached_property
    def true_camera(self) -> Camera:
        """The camera of the images: from the file, or placed automatically."""
        places = joints(self._subject.body.skeleton, self._used_motion.poses)
        if self.calibration_file is None:
            return self._automatic_camera(places)
        camera = load_cameras(expanded(self.calibration_file))[0]
        if not camera.width:
            raise InputError(
                f"{self.calibration_file}: camera [{camera.name}] has no image size; add image_width, image_height, px"
            )
        if not _inside(camera, camera.project(places)).any():
            raise InputError(
                f"{self.calibration_file}: camera {camera.name!r} never sees the person of motion {self.motion!r}"
            )
        return camera

    @cached_property
    def calibrated_camera(self) -> Camera:
        """The camera with calibration errors."""
        return self.miscalibrated(self.true_camera, self._used_motion)

    @cached_property
    def _initial_pose(self) -> FloatArray:
        """The initial pose (P,) with its errors."""
        pose = self._used_motion.poses[0]
        return sequence.perturbed_pose(self.body.skeleton, pose, self.seed, self.perturbation_sizes)

    def _automatic_camera(self, places: FloatArray) -> Camera:
        tall = sequence.standing_height(self._used_motion, places)
        distance_m = self.focal_px * tall / self.person_px
        camera, actual_m = sequence.automatic_camera(self, self._used_motion, places, distance_m)
        if actual_m > 1.01 * distance_m:
            tall_px = f"{self.focal_px * tall / actual_m:.0f} px tall instead of {self.person_px:g}"
            message = f"synthetic: the person is {tall_px}, so that the whole motion fits into the image"
            warnings.warn(message, stacklevel=2)
        return camera

    @cached_property
    def _used_motion(self) -> Motion:
        """The motion at the dataset's rate, cut to the frames used."""
        end = self.first_frame + self.n_frames
        motions = [find_motion(name, **self.source(self.rate_hz)) for name in sequence.motion_names(self.motion)]
        motion = motions[0] if len(motions) == 1 else concatenate(motions, end).motion
        if end > len(motion):
            frames = f"{len(motion)} frames at {self.rate_hz:g} Hz, expected at least first_frame + n_frames = {end}"
            raise InputError(f"synthetic: motion {self.motion!r} has {frames}")
        poses = motion.poses[self.first_frame : end].copy()
        if self.moving is not None:
            moving = parameters("synthetic: moving", self.moving)
            constant = [i for i, name in enumerate(POSE_NAMES) if name not in moving]
            poses[:, constant] = poses[0, constant]
        return replace(motion, poses=poses)

    @cached_property
    def body(self) -> Body:
        """The tracker's body."""
        body = person(self._used_motion.shape)
        return with_neck_and_feet(body) if self.neck_and_feet else body

    @cached_property
    def _subject(self) -> SceneSubject:
        body = person(self._used_motion.shape) if self._subject_has_feet else self.body
        return draw_subject(body, self.perturbation_sizes, self.seed)

    @property
    def _subject_has_feet(self) -> bool:
        """Whether the subject has its own neck and feet."""
        return self.perturbation_sizes["profile"] > 0.0

    @cached_property
    def _images(self) -> ByteArray:
        """Images (n_frames, height, width), from the cache or rendered."""
        shape = (self.n_frames, self.true_camera.height, self.true_camera.width)
        return cached_images(self.cache, self._key, shape, self._render)

    def _render(self) -> ByteArray:
        outfit, wall, sensor = (stream(self.seed, name) for name in ("clothes", "background", "sensor"))
        camera, body = self.true_camera, self._subject.body
        texture = render.clothes(body, outfit, self.contrast)
        background = render.background(camera.height, camera.width, wall, self.clutter)
        scene, images = render.RenderedScene(body, camera, texture, background), []
        occluder = None
        if self.occluder:
            pixels = camera.project(joints(body.skeleton, self._used_motion.poses))
            occluder = passing_occluder(pixels, self.rate_hz, stream(self.seed, "occluder"))
        poses = tqdm(self._used_motion.poses, desc=f"rendering {self.motion}", unit="frame", disable=None)
        for i, pose in enumerate(poses):
            frame_scene = self._subject.scene_at(scene, (self.first_frame + i) / self.rate_hz)
            image = render.render(frame_scene, pose)
            image = image if occluder is None else occluder.cover(image, i)
            images.append(render.with_noise(image, self.noise_std, sensor))
        return np.stack(images)

    def _key(self) -> str:
        unseen, camera = ["data", "cache", "calibration_file", "keypoint_sigma_px"], self.true_camera
        unseen += ["neck_and_feet"] if self._subject_has_feet else []
        code = code_digest(render, subjects, surroundings)
        return image_key(self, unseen, code, self._used_motion, camera.row)


def _inside(camera: Camera, pixels: FloatArray) -> BoolArray:
    """Return whether pixels (..., 2) lie between the centres of the image's outermost pixels."""
    with np.errstate(invalid="ignore"):
        return np.asarray(((pixels >= 0.0) & (pixels <= [camera.width - 1.0, camera.height - 1.0])).all(axis=-1))
