"""Simulated stereo points: what a depth camera sees of a moving person, with exact truth (paper D, section 4.1)."""

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from workbench.arrays import ByteArray, FloatArray
from workbench.body.camera import Camera
from workbench.body.limbs import Body
from workbench.body.shape import Shape
from workbench.datasets import render
from workbench.datasets.automatic_camera import automatic_camera
from workbench.datasets.frame import Frame, View
from workbench.datasets.surroundings import Surroundings, bar, clutter_points, in_box, not_hidden, surroundings
from workbench.datasets.take import Take, check_start, find_take
from workbench.datasets.visible_surface import visible_points
from workbench.errors import InputError

AT_M = 4.0
"""The depth at which σ is sigma_m."""
_NOISE_GREY = 4.0


@dataclass(frozen=True)
class Points:
    """Points of the surface that one still camera sees of a person, n_points a frame, for n_frames frames at rate_hz.

    motion: a name as `motions.find_motion` knows them, or a list of names that take even turns (`splice.splice`). data:
    the folder that holds cmu/ and bandai/. path: of the builtin walker. first_frame: of the (first) motion, at rate_hz.
    A level camera of width × height pixels and focal length focal_px looks at view_deg to the motion's direction (90:
    from the side), distance_m away half-way through, or further where the motion would not fit into its image.

    Of n_points a share `outliers` lie anywhere in a box about the person, the others evenly over what the camera sees
    of the limbs, off along the line of sight by σ = sigma_m (z / 4 m)². clutter: as many points more of floor, wall and
    bins in that box. bar_m: width of an upright bar half-way between camera and person; it hides what is behind it, so
    that there are fewer points. skeleton: "person", or "full" for the motion file's own with every joint, which is then
    the tracked body too. images: render what the camera sees, for the viewer; otherwise there are no views.

    start: "auto" offers nothing: start_pose and phase_ends are None and whoever tracks finds both. "given" offers what
    paper D sets by hand: start_pose, the first true pose off by σ 3 cm and 0.05 rad in every number, and phase_ends,
    the true phases of the first and last frame. Truth is in the frames either way, for the evaluation only.
    seed: of the points, their errors, the start and the builtin walker.

    Raises InputError for parameters out of range, a motion that cannot be found or is too short, and start="given" for
    one without a gait cycle.
    """

    motion: Any = "builtin"  # a name or a list of them, for which a schema has no other type
    data: str | None = None
    path: str = "straight"
    n_frames: int = 28
    first_frame: int = 0
    rate_hz: float = 14.0
    n_points: int = 400
    sigma_m: float = 0.02
    outliers: float = 0.15
    clutter: int = 0
    bar_m: float = 0.0
    distance_m: float = 4.0
    view_deg: float = 90.0
    width: int = 640
    height: int = 480
    focal_px: float = 400.0
    images: bool = False
    start: str = "auto"
    seed: int = 0
    skeleton: str = "person"

    def __post_init__(self) -> None:
        at_least = {
            "n_frames": 2, "first_frame": 0, "n_points": 1, "sigma_m": 0.0, "clutter": 0, "bar_m": 0.0,
            "distance_m": 1.0, "width": 32, "height": 32, "focal_px": 1.0, "seed": 0,
        }  # fmt: skip
        for name, least in at_least.items():
            if not least <= getattr(self, name) < np.inf:
                raise InputError(f"points: {name} must be at least {least}, found {getattr(self, name)}")
        if not 0.0 <= self.outliers < 1.0:
            raise InputError(f"points: outliers must be a share from 0 to below 1, found {self.outliers}")
        if not 0.0 < self.rate_hz < np.inf or not np.isfinite(self.view_deg):
            raise InputError(
                f"points: expected a positive rate_hz and a finite view_deg, found {self.rate_hz}, {self.view_deg}"
            )
        check_start("points", self.start, self.take)  # finds the motion, so that mistakes show before the first frame
        _ = self.view_camera

    @property
    def name(self) -> str:
        """The motion's name."""
        return f"points of {self.take.motion.name}"

    @property
    def scale(self) -> float:
        """1: images come in the size they were rendered in."""
        return 1.0

    @property
    def shape(self) -> Shape:
        """The person's measurements."""
        return self.take.motion.shape

    @property
    def full_body(self) -> Body | None:
        """The body of the motion file's own skeleton, where it is that which moves."""
        return self.take.body if self.skeleton == "full" else None

    @property
    def start_pose(self) -> FloatArray | None:
        """With start="given" the first pose (P,), off by σ 3 cm and 0.05 rad in every number; else None."""
        return self.take.rough_start(self.seed) if self.start == "given" else None

    @property
    def phase_ends(self) -> tuple[float, float] | None:
        """With start="given" the phases of the first and the last frame, cycles (`splice.gait_phases`); else None."""
        return self.take.phase_ends if self.start == "given" else None

    @property
    def start_marks(self) -> None:
        """There are none."""
        return None

    def __len__(self) -> int:
        return self.n_frames

    def frames(self) -> Iterator[Frame]:
        """The frames in order, each with its points, the true pose and joints and, where it is known, the activity."""
        for i, truth in enumerate(self.take.truths):
            index = self.first_frame + i
            views = (View(self.view_camera, self._image(i)),) if self.images else ()
            yield Frame(index, index / self.rate_hz, views, truth, points=self._points(i))

    @cached_property
    def take(self) -> Take:
        """What the person does."""
        return find_take(
            self.motion, data=self.data, rate_hz=self.rate_hz, n_frames=self.n_frames, first_frame=self.first_frame,
            path=self.path, seed=self.seed, skeleton=self.skeleton,
        )  # fmt: skip

    @cached_property
    def view_camera(self) -> Camera:
        """The camera that sees the points."""
        camera, distance = automatic_camera(
            self.take.motion, self.take.places, width=self.width, height=self.height, focal_px=self.focal_px,
            view_deg=self.view_deg, distance_m=self.distance_m,
        )  # fmt: skip
        if distance > 1.01 * self.distance_m:
            warnings.warn(
                f"points: the camera is {distance:.1f} m away instead of {self.distance_m:g}, so that the whole motion "
                "fits into its image",
                stacklevel=2,
            )
        return camera

    def _points(self, i: int) -> FloatArray:
        """The points (K, 3) of frame i, in random order."""
        rng = np.random.default_rng([self.seed, 1, i])
        camera, body, pose = self.view_camera, self.take.body, self.take.motion.poses[i]
        n_outliers = int(rng.binomial(self.n_points, self.outliers))
        surface = visible_points(body, pose, camera, self.n_points - n_outliers, rng)
        if self.bar_m > 0.0:
            surface = not_hidden(surface, camera, [(bar(self.take, camera, self.bar_m), np.zeros(len(pose)))])
        if self.clutter:
            others = clutter_points(self._surroundings, pose[:3], camera, self.clutter, rng)
            surface = np.concatenate([surface, not_hidden(others, camera, [(body, pose)])])
        noisy = with_depth_noise(surface, camera, self.sigma_m, rng)
        return rng.permutation(np.concatenate([noisy, in_box(pose[:3], n_outliers, rng)]))

    @cached_property
    def _surroundings(self) -> Surroundings:
        return surroundings(self.take, self.view_camera)

    def _image(self, i: int) -> ByteArray:
        noise = np.random.default_rng([self.seed, 2, i])
        return render.with_noise(render.render(self._scene, self.take.motion.poses[i]), _NOISE_GREY, noise)

    @cached_property
    def _scene(self) -> render.Scene:
        rng, body, camera = np.random.default_rng([self.seed, 3]), self.take.body, self.view_camera
        wall = render.background(camera.height, camera.width, rng)
        return render.prepare(body, camera, render.clothes(body, rng), wall)


def with_depth_noise(points: FloatArray, camera: Camera, sigma_m: float, rng: np.random.Generator) -> FloatArray:
    """Points (K, 3), m, moved along their lines of sight so that their depth z errs by σ = sigma_m (z / 4 m)².

    The error of a stereo pair: depth is focal length × baseline / disparity, and the disparity's error is constant.
    """
    seen = camera.to_camera(points)
    depth = seen[:, 2]
    factor = 1.0 + sigma_m * depth / AT_M**2 * rng.standard_normal(len(points))
    moved: FloatArray = (seen * factor[:, None] - camera.translation) @ camera.rotation
    return moved
