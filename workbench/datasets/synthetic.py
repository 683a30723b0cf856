"""Rendered sequences of a walking person, with exact truth."""

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from workbench.body.camera import Camera, load_cameras
from workbench.body.kinematics import joints
from workbench.body.limbs import Body, person, with_neck_and_feet
from workbench.body.skeleton import POSE_NAMES, parameters
from workbench.core.capabilities import IMAGES, KEYPOINTS, ONE_CAMERA, START, Traits, component_traits
from workbench.core.checks import Range, at_least, one_of
from workbench.core.dataset import SequenceInfo
from workbench.core.frame import Frame, Truth, View
from workbench.core.side_information import INITIAL_POSE
from workbench.datasets.rendering import render, sequence, surroundings
from workbench.datasets.rendering import subject as subjects
from workbench.datasets.rendering.cache import cached_images, image_key
from workbench.datasets.rendering.concatenation import splice
from workbench.datasets.rendering.perturbations import calibration_error
from workbench.datasets.rendering.sequence import Scene
from workbench.datasets.rendering.subject import SceneSubject, subject_of
from workbench.datasets.rendering.surroundings import passing_board
from workbench.motion.pose_sequence import Motion
from workbench.motion.sources import find_motion
from workbench.motion.synthetic.gait import PATHS
from workbench.utils.arrays import BoolArray, ByteArray, FloatArray
from workbench.utils.errors import InputError
from workbench.utils.rng import stream
from workbench.utils.source_hash import code_digest

_KEYPOINTS_MISSED = 0.1  # share of the joints that the simulated detector does not find


@dataclass(kw_only=True, eq=False)
class Synthetic(Scene):
    """A person in motion, ray-cast over a cluttered background by one still camera; the images are grey.

    motion to departures: see `Scene`; the seed is of the person, the clothes, the background, the noise and the
    keypoints. cache: a folder for rendered images; without one every process renders them anew. moving: names of the
    pose's parameters, or of body parts (`skeleton.PARTS`), that move while all others stay as in the first frame used;
    None: everything moves. camera: a camera file, of which the first camera is used, and the scene's does not count;
    without one the person is person_px tall half-way through, or smaller where the whole motion would not fit into
    width × height.
    occluder: whether a board passes in front of the person once, drawn by the seed, see `passing_board`. noise: σ of
    the sensor, grey levels. contrast, clutter: strength of the clothes' texture and of the background, 1
    being about 24 and 35 grey levels. feet: whether the body that a tracker is told has neck and feet; who is shown has
    their own, and by `exact` those that are told. keypoint_sigma_px: σ of a detector of 2-D joints, px, which misses
    _KEYPOINTS_MISSED of them; None: there is none. Raises InputError for parameters out of range and, when asked what
    is known, for a motion that cannot be found or is too short, and a camera that never sees the person.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare images of one camera, a start, and detected joints where they are asked for."""
        keypoints = () if keys.get("keypoint_sigma_px") is None else (KEYPOINTS,)
        return component_traits(IMAGES, ONE_CAMERA, START, INITIAL_POSE, *keypoints)

    n_frames: int = 50
    rate_hz: float = 30.0
    cache: str | None = None
    moving: Sequence[str] | None = None
    camera: str | None = None
    person_px: float = 270.0
    occluder: bool = False
    noise: float = 4.0
    contrast: float = 1.0
    clutter: float = 1.0
    feet: bool = False
    keypoint_sigma_px: float | None = None

    def __post_init__(self) -> None:
        none_or_more = Range("at least 0 or null", lambda value: value is None or 0.0 <= value < np.inf)
        self.check(path=one_of(*PATHS), person_px=at_least(1), noise=at_least(0), contrast=at_least(0))
        self.check(clutter=at_least(0), keypoint_sigma_px=none_or_more)

    @cached_property
    def info(self) -> SequenceInfo:
        """The camera, the person's measurements and the pose in the first frame, each about as it really is."""
        motion = self._used_motion
        return SequenceInfo(
            name=f"synthetic {motion.name}", n_frames=self.n_frames, rate_hz=self.rate_hz, cameras=(self.told_camera,),
            shape=motion.shape, body=self.body if self.feet else None, initial_pose=self._start,
            has_keypoints=self.keypoint_sigma_px is not None,
            departures={
                **self._subject.factors, **calibration_error(self.view_camera, self.told_camera),
                **sequence.start_error(self._start, motion.poses[0]),
            },
        )  # fmt: skip

    def frames(self) -> Iterator[Frame]:
        """The frames in order, each with the true pose and joints; all are rendered before the first comes out."""
        poses = self._used_motion.poses
        places = joints(self._subject.body.skeleton, poses)
        cameras = () if self.told_camera is self.view_camera else (self.view_camera,)
        for i, image in enumerate(self._images):
            index = self.first_frame + i
            truth = Truth(pose=poses[i], joints=places[i], cameras=cameras)
            views = (View(self.told_camera, image, self._keypoints(i, places[i])),)
            yield Frame(index, index / self.rate_hz, views, truth)

    def _keypoints(self, i: int, places: FloatArray) -> FloatArray | None:
        """Return the detections (J, 3) of joints at places (J, 3), m, in frame i; only what is in the image."""
        if self.keypoint_sigma_px is None:
            return None
        rng, camera = stream(self.seed, "keypoints", i), self.view_camera
        pixels = camera.project(places)
        keypoints = np.column_stack([pixels, np.ones(len(pixels))])
        keypoints[:, :2] += self.keypoint_sigma_px * rng.standard_normal(pixels.shape)
        keypoints[~_inside(camera, pixels) | (rng.random(len(pixels)) < _KEYPOINTS_MISSED)] = np.nan
        return keypoints

    @cached_property
    def view_camera(self) -> Camera:
        """The camera that takes the images: from the file, or placed automatically."""
        places = joints(self._subject.body.skeleton, self._used_motion.poses)
        if self.camera is None:
            return self._automatic_camera(places)
        camera = load_cameras(Path(self.camera).expanduser())[0]
        if not _inside(camera, camera.project(places)).any():
            raise InputError(f"{self.camera}: camera {camera.name!r} never sees the person of motion {self.motion!r}")
        return camera

    @cached_property
    def told_camera(self) -> Camera:
        """The camera as a tracker is told."""
        return self.calibrated(self.view_camera, self._used_motion)

    @cached_property
    def _start(self) -> FloatArray:
        """The first pose (P,) as a tracker is told."""
        pose, off = self._used_motion.poses[0], self.departure
        if off["start_m"] == off["start_rad"] == 0.0:
            return pose
        return sequence.rough_pose(self.body.skeleton, pose, self.seed, off["start_m"], off["start_rad"])

    def _automatic_camera(self, places: FloatArray) -> Camera:
        tall = sequence.standing_height(self._used_motion, places)
        wanted = self.focal_px * tall / self.person_px
        camera, distance = sequence.automatic_camera(self, self._used_motion, places, wanted)
        if distance > 1.01 * wanted:
            tall_px = f"{self.focal_px * tall / distance:.0f} px tall instead of {self.person_px:g}"
            words = f"synthetic: the person is {tall_px}, so that the whole motion fits into the image"
            warnings.warn(words, stacklevel=2)
        return camera

    @cached_property
    def _used_motion(self) -> Motion:
        """The motion at this dataset's rate, cut to the frames used."""
        end = self.first_frame + self.n_frames
        motions = [find_motion(name, **self.source(self.rate_hz)) for name in sequence.motion_names(self.motion)]
        motion = motions[0] if len(motions) == 1 else splice(motions, end).motion
        if end > len(motion):
            frames = f"{len(motion)} frames at {self.rate_hz:g} Hz, expected at least first_frame + n_frames = {end}"
            raise InputError(f"synthetic: motion {self.motion!r} has {frames}")
        poses = motion.poses[self.first_frame : end].copy()
        if self.moving is not None:
            moving = parameters("synthetic: moving", self.moving)
            still = [i for i, name in enumerate(POSE_NAMES) if name not in moving]
            poses[:, still] = poses[0, still]
        return replace(motion, poses=poses)

    @cached_property
    def body(self) -> Body:
        """The person's body, as a tracker is told."""
        plain = person(self._used_motion.shape)
        return with_neck_and_feet(plain) if self.feet else plain

    @cached_property
    def _subject(self) -> SceneSubject:
        body = person(self._used_motion.shape) if self._own_feet else self.body
        return subject_of(body, self.departure, self.seed)

    @property
    def _own_feet(self) -> bool:
        """Whether who is shown has neck and feet of their own, whatever is told of these."""
        return self.departure["profile"] > 0.0

    @cached_property
    def _images(self) -> ByteArray:
        """The images, (n_frames, height, width), from the cache or rendered."""
        shape = (self.n_frames, self.view_camera.height, self.view_camera.width)
        return cached_images(self.cache, self._key, shape, self._render)

    def _render(self) -> ByteArray:
        outfit, wall, sensor = (stream(self.seed, name) for name in ("clothes", "background", "sensor"))
        camera, body = self.view_camera, self._subject.body
        texture = render.clothes(body, outfit, self.contrast)
        background = render.background(camera.height, camera.width, wall, self.clutter)
        scene, images = render.RenderedScene(body, camera, texture, background), []
        board = passing_board(self._seen, self.rate_hz, stream(self.seed, "occluder")) if self.occluder else None
        poses = tqdm(self._used_motion.poses, desc=f"rendering {self.motion}", unit="frame", disable=None)
        for i, pose in enumerate(poses):
            shown = self._subject.shown(scene, (self.first_frame + i) / self.rate_hz)
            image = render.render(shown, pose)
            image = image if board is None else board.cover(image, i)
            images.append(render.with_noise(image, self.noise, sensor))
        return np.stack(images)

    @property
    def _seen(self) -> FloatArray:
        """Where the camera sees the joints, (F, J, 2), px."""
        return self.view_camera.project(joints(self._subject.body.skeleton, self._used_motion.poses))

    def _key(self) -> str:
        unseen, seen_by = ["data", "cache", "camera", "keypoint_sigma_px"], self.view_camera
        unseen += ["feet"] if self._own_feet else []
        calibration = (seen_by.matrix, seen_by.rotation, seen_by.translation, seen_by.distortion)
        size = np.array([seen_by.width, seen_by.height])
        return image_key(
            self, unseen, code_digest(render, subjects, surroundings), self._used_motion, *calibration, size
        )


def _inside(camera: Camera, pixels: FloatArray) -> BoolArray:
    """Return whether pixels (..., 2) lie between the centres of the image's outermost ones."""
    with np.errstate(invalid="ignore"):
        return np.asarray(((pixels >= 0.0) & (pixels <= [camera.width - 1.0, camera.height - 1.0])).all(axis=-1))
