"""Rendered sequences of a walking person, with exact truth."""

import hashlib
import json
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from workbench.arrays import ByteArray, FloatArray
from workbench.body.camera import Camera, load_cameras
from workbench.body.kinematics import joints
from workbench.body.limbs import Body, person
from workbench.body.shape import Shape
from workbench.body.skeleton import POSE_NAMES, parameters
from workbench.datasets import render
from workbench.datasets.automatic_camera import automatic_camera, standing_height
from workbench.datasets.frame import Frame, Truth, View
from workbench.datasets.gait import PATHS
from workbench.datasets.image_cache import read_images, write_images
from workbench.datasets.motions import find_motion
from workbench.datasets.splice import splice
from workbench.digest import code_digest
from workbench.errors import InputError
from workbench.mocap.motion import Motion

KEYPOINTS_MISSED = 0.1
"""Share of the joints that the simulated detector does not find."""


@dataclass(frozen=True)
class Synthetic:
    """A person in motion, ray-cast over a cluttered background by one still camera; the images are grey.

    motion: see `motions.find_motion`, or a list of such names that take even turns (`splice.splice`). data: the folder
    that holds cmu/ and bandai/. cache: a folder for rendered
    images; without one every process renders them anew. path: "straight" or "circle", for the builtin walker only.
    moving: names of the pose's parameters, or of body parts (`skeleton.PARTS`), that move while all others stay as in
    the first frame used; None: everything moves. n_frames frames at rate_hz are used, from first_frame on, counted at
    that rate. camera: a camera file, of which the first camera is used; without one a level camera is placed so that it
    looks at view_deg (degrees) to the walk's direction (90: side view, 180: from ahead) with focal length focal_px, and
    the person is person_px tall half-way through, or smaller where the whole walk would not fit into width × height;
    those five say nothing about a camera from a file. noise: σ of the sensor, grey levels. contrast, clutter: strength
    of the clothes' texture and of the background, 1 being about 24 and 35 grey levels.
    keypoint_sigma_px: σ of a detector of 2-D joints, px, that misses KEYPOINTS_MISSED of them; None: there is none.
    seed: of the clothes, the background, the noise, the keypoints and the builtin walker.

    Raises InputError for parameters out of range, a motion that cannot be found or is too short, and a camera that
    never sees the person.
    """

    motion: Any = "builtin"  # a name or a list of them, for which a schema has no other type
    data: str | None = None
    cache: str | None = None
    path: str = "straight"
    moving: Sequence[str] | None = None
    n_frames: int = 50
    first_frame: int = 0
    rate_hz: float = 30.0
    width: int = 640
    height: int = 480
    camera: str | None = None
    view_deg: float = 90.0
    person_px: float = 270.0
    focal_px: float = 700.0
    noise: float = 4.0
    contrast: float = 1.0
    clutter: float = 1.0
    keypoint_sigma_px: float | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        at_least = {
            "n_frames": 2, "first_frame": 0, "width": 32, "height": 32, "person_px": 1.0, "focal_px": 1.0,
            "noise": 0.0, "contrast": 0.0, "clutter": 0.0, "seed": 0,
        }  # fmt: skip
        for name, least in at_least.items():
            if not least <= getattr(self, name) < np.inf:
                raise InputError(f"synthetic: {name} must be at least {least}, found {getattr(self, name)}")
        if self.path not in PATHS:
            raise InputError(f"synthetic: path must be one of {', '.join(PATHS)}, found {self.path!r}")
        if not 0.0 < self.rate_hz < np.inf:
            raise InputError(f"synthetic: rate_hz must be positive, found {self.rate_hz}")
        if self.keypoint_sigma_px is not None and not 0.0 <= self.keypoint_sigma_px < np.inf:
            raise InputError(f"synthetic: keypoint_sigma_px must be at least 0, found {self.keypoint_sigma_px}")
        if not np.isfinite(self.view_deg):
            raise InputError(f"synthetic: view_deg must be an angle in degrees, found {self.view_deg}")
        _ = self.view_camera  # finds the motion and places the camera, so that mistakes show before the first frame

    @property
    def name(self) -> str:
        """The motion's name."""
        return f"synthetic {self._used_motion.name}"

    @property
    def scale(self) -> float:
        """1: images come in the size they were rendered in."""
        return 1.0

    @property
    def shape(self) -> Shape:
        """The measurements of the person rendered."""
        return self._used_motion.shape

    @property
    def start_pose(self) -> FloatArray:
        """The true pose (P,) in the first frame."""
        first: FloatArray = self._used_motion.poses[0]
        return first

    @property
    def start_marks(self) -> None:
        """There are none: the start pose is known."""
        return None

    def __len__(self) -> int:
        return self.n_frames

    def frames(self) -> Iterator[Frame]:
        """The frames in order, each with the true pose and joints; all are rendered before the first comes out."""
        poses = self._used_motion.poses
        places = joints(self._body.skeleton, poses)
        for i, image in enumerate(self._images):
            index = self.first_frame + i
            truth = Truth(pose=poses[i], joints=places[i])
            views = (View(self.view_camera, image, self._keypoints(i, places[i])),)
            yield Frame(index, index / self.rate_hz, views, truth)

    def _keypoints(self, i: int, places: FloatArray) -> FloatArray | None:
        """What the detector finds (J, 3) of joints at places (J, 3), m, in frame i; only what is in the image."""
        if self.keypoint_sigma_px is None:
            return None
        rng, camera = np.random.default_rng([self.seed, 1, i]), self.view_camera
        pixels = camera.project(places)
        keypoints = np.column_stack([pixels, np.ones(len(pixels))])
        keypoints[:, :2] += self.keypoint_sigma_px * rng.standard_normal(pixels.shape)
        with np.errstate(invalid="ignore"):
            inside = ((pixels >= 0.0) & (pixels <= [camera.width - 1.0, camera.height - 1.0])).all(axis=1)
        keypoints[~inside | (rng.random(len(pixels)) < KEYPOINTS_MISSED)] = np.nan
        return keypoints

    @cached_property
    def view_camera(self) -> Camera:
        """The camera: from the file, or placed automatically."""
        places = joints(self._body.skeleton, self._used_motion.poses)
        if self.camera is None:
            return self._automatic_camera(places)
        camera = load_cameras(Path(self.camera).expanduser())[0]
        pixels = camera.project(places)
        with np.errstate(invalid="ignore"):
            inside = (pixels >= 0.0) & (pixels <= [camera.width - 1.0, camera.height - 1.0])
        if not inside.all(axis=-1).any():
            raise InputError(f"{self.camera}: camera {camera.name!r} never sees the person of motion {self.motion!r}")
        return camera

    def _automatic_camera(self, places: FloatArray) -> Camera:
        tall = standing_height(self._used_motion, places)
        wanted = self.focal_px * tall / self.person_px
        camera, distance = automatic_camera(
            self._used_motion, places, width=self.width, height=self.height, focal_px=self.focal_px,
            view_deg=self.view_deg, distance_m=wanted,
        )  # fmt: skip
        if distance > 1.01 * wanted:
            warnings.warn(
                f"synthetic: the person is {self.focal_px * tall / distance:.0f} px tall instead of "
                f"{self.person_px:g}, so that the whole motion fits into the image",
                stacklevel=2,
            )
        return camera

    @cached_property
    def _used_motion(self) -> Motion:
        """The motion at this dataset's rate, cut to the frames used."""
        end = self.first_frame + self.n_frames
        names = [self.motion] if isinstance(self.motion, str | int) else list(self.motion)
        if not names:
            raise InputError("synthetic: motion must name at least one motion, found none")
        motions = [
            find_motion(str(name), data=self.data, rate_hz=self.rate_hz, path=self.path, seed=self.seed)
            for name in names
        ]
        motion = motions[0] if len(motions) == 1 else splice(motions, end).motion
        if end > len(motion):
            raise InputError(
                f"synthetic: motion {self.motion!r} has {len(motion)} frames at {self.rate_hz:g} Hz, "
                f"expected at least first_frame + n_frames = {end}"
            )
        poses = motion.poses[self.first_frame : end].copy()
        if self.moving is not None:
            moving = parameters("synthetic: moving", self.moving)
            still = [i for i, name in enumerate(POSE_NAMES) if name not in moving]
            poses[:, still] = poses[0, still]
        return replace(motion, poses=poses)

    @cached_property
    def _body(self) -> Body:
        return person(self.shape)

    @cached_property
    def _images(self) -> ByteArray:
        """The images, (n_frames, height, width), from the cache or rendered."""
        if self.cache is None:
            return self._render()
        file = Path(self.cache).expanduser() / "scenes" / f"{self._key()[:32]}.npz"
        images = read_images(file, (self.n_frames, self.view_camera.height, self.view_camera.width))
        if images is None:
            images = self._render()
            write_images(file, images)
        return images

    def _render(self) -> ByteArray:
        outfit, wall, sensor = (np.random.default_rng(s) for s in np.random.SeedSequence(self.seed).spawn(3))
        camera = self.view_camera
        scene = render.prepare(
            self._body,
            camera,
            render.clothes(self._body, outfit, self.contrast),
            render.background(camera.height, camera.width, wall, self.clutter),
        )
        poses = tqdm(self._used_motion.poses, desc=f"rendering {self.motion}", unit="frame", disable=None)
        return np.stack([render.with_noise(render.render(scene, pose), self.noise, sensor) for pose in poses])

    def _key(self) -> str:
        """Names the images: a digest of the poses and of every parameter that shows in them."""
        unseen = ("data", "cache", "camera", "keypoint_sigma_px")
        parameters = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in unseen}
        digest = hashlib.sha256(json.dumps([code_digest(render), parameters, self.shape.as_dict()]).encode())
        camera = self.view_camera
        for array in (
            self._used_motion.poses, camera.matrix, camera.rotation, camera.translation, camera.distortion,
            np.array([camera.width, camera.height]),
        ):  # fmt: skip
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()
