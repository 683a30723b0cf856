"""Simulated stereo points: what a depth camera sees of a moving person, with exact truth (paper D, section 4.1)."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from workbench.body.camera import Camera
from workbench.body.limbs import Body
from workbench.core.capabilities import ALL_JOINTS, IMAGES, ONE_CAMERA, POINTS, START, Traits, component_traits
from workbench.core.checks import BELOW_1, at_least
from workbench.core.dataset import SequenceInfo
from workbench.core.frame import Frame, View
from workbench.datasets.rendering import render, surroundings
from workbench.datasets.rendering.sequence import Scene, Take, find_take, given_start, offered_start, take_camera
from workbench.datasets.rendering.surroundings import in_box, not_hidden
from workbench.datasets.rendering.visible import visible_points
from workbench.utils.arrays import ByteArray, FloatArray
from workbench.utils.rng import stream

_AT_M = 4.0  # the depth at which σ is sigma_m
_NOISE_GREY = 4.0


@dataclass(kw_only=True, eq=False)
class Points(Scene):
    """Points of the surface that one still camera sees of a person, n_points a frame.

    motion to departures: see `Scene`. The camera is distance_m away half-way through, or further where the motion would
    not fit into its image. What it sees is placed in the world by the camera that is told.

    Of n_points a share `outliers` lie anywhere in a box about the person, the others evenly over what the camera sees
    of the limbs, off along the line of sight by σ = sigma_m (z / 4 m)². clutter: as many points more of floor, wall and
    bins in that box. bar_m: width of an upright bar half-way between camera and person; it hides what is behind it, so
    that there are fewer points. skeleton: "person", or "full" for the motion file's own with every joint, which is then
    the tracked body too. images: render what the camera sees, for the viewer; otherwise there are no views.

    start: "auto" offers nothing: initial_pose and phase_ends are None and whoever tracks finds both. "given" offers
    what paper D sets by hand: initial_pose, the first true pose off by σ 3 cm and 0.05 rad in every number, and
    phase_ends, the true phases of the first and last frame. Truth is in the frames either way, for the evaluation only.
    Raises InputError for parameters out of range and, when asked what is known, for a motion that cannot be found or is
    too short, and start="given" for one without a gait cycle.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare points, which tell the start, too, and images where they are rendered. Every joint of a file's
        skeleton needs a prior that knows them."""
        images = (IMAGES, ONE_CAMERA) if keys.get("images") else ()
        skeleton = keys.get("skeleton", "person")
        joints = () if skeleton == "person" else (ALL_JOINTS,)
        needs = {"prior": ALL_JOINTS} if skeleton == "full" else {}
        return component_traits(POINTS, START, *offered_start(keys), *images, *joints, **needs)

    focal_px: float = 400.0
    n_points: int = 400
    sigma_m: float = 0.02
    outliers: float = 0.15
    clutter: int = 0
    bar_m: float = 0.0
    distance_m: float = 4.0
    images: bool = False
    start: str = "auto"
    skeleton: str = "person"

    def __post_init__(self) -> None:
        self.check(n_points=at_least(1), sigma_m=at_least(0), clutter=at_least(0), bar_m=at_least(0))
        self.check(distance_m=at_least(1), outliers=BELOW_1)

    @cached_property
    def info(self) -> SequenceInfo:
        """The person's measurements, the full body where it is tracked, and what is offered of the start."""
        initial_pose, phase_ends = given_start("points", self.start, self.take, self.seed)
        return SequenceInfo(
            name=f"points of {self.take.motion.name}", n_frames=self.n_frames, rate_hz=self.rate_hz,
            cameras=(self.told_camera,) if self.images else (), shape=self.take.motion.shape,
            body=self.take.body if self.skeleton == "full" else None, initial_pose=initial_pose, has_points=True,
            phase_ends=phase_ends, departures=self.take.departures(initial_pose, self.view_camera, self.told_camera),
        )  # fmt: skip

    def frames(self) -> Iterator[Frame]:
        """The frames in order, each with its points, the true pose and joints and, where it is known, the activity."""
        cameras = (self.view_camera,) if self.images and self.told_camera is not self.view_camera else ()
        for i, truth in enumerate(self.take.truths):
            index = self.first_frame + i
            views = (View(self.told_camera, self._image(i)),) if self.images else ()
            truth = replace(truth, cameras=cameras)
            yield Frame(index, index / self.rate_hz, views, truth, points=self._points(i))

    @cached_property
    def take(self) -> Take:
        """What the person does."""
        return find_take(self, self.skeleton)

    @cached_property
    def view_camera(self) -> Camera:
        """The camera that sees the points."""
        return take_camera(self, self.take, self.distance_m)

    @cached_property
    def told_camera(self) -> Camera:
        """The camera as a calibration found it, by which what it sees was placed in the world."""
        return self.calibrated(self.view_camera, self.take.motion)

    def _subject(self, i: int) -> Body:
        """The body that is seen in frame i."""
        return self.take.subject.at((self.first_frame + i) / self.rate_hz)

    def _points(self, i: int) -> FloatArray:
        """The points (K, 3) of frame i, in random order."""
        rng = stream(self.seed, "points", i)
        camera, body, pose = self.view_camera, self._subject(i), self.take.motion.poses[i]
        n_outliers = int(rng.binomial(self.n_points, self.outliers))
        surface = visible_points(body, pose, camera, self.n_points - n_outliers, rng)
        if self.bar_m > 0.0:
            surface = not_hidden(surface, camera, surroundings.bar(self.take, camera, self.bar_m), np.zeros(len(pose)))
        if self.clutter:
            others = surroundings.clutter_points(self._surroundings, pose[:3], camera, self.clutter, rng)
            surface = np.concatenate([surface, not_hidden(others, camera, body, pose)])
        noisy = with_depth_noise(surface, camera, self.sigma_m, rng, self.told_camera)
        return rng.permutation(np.concatenate([noisy, in_box(pose[:3], n_outliers, rng)]))

    @cached_property
    def _surroundings(self) -> surroundings.Surroundings:
        return surroundings.surroundings(self.take, self.view_camera)

    def _image(self, i: int) -> ByteArray:
        noise = stream(self.seed, "sensor", i)
        shown = self.take.subject.shown(self._scene, (self.first_frame + i) / self.rate_hz)
        return render.with_noise(render.render(shown, self.take.motion.poses[i]), _NOISE_GREY, noise)

    @cached_property
    def _scene(self) -> render.RenderedScene:
        body, camera = self.take.subject.body, self.view_camera
        wall = render.background(camera.height, camera.width, stream(self.seed, "background"))
        return render.RenderedScene(body, camera, render.clothes(body, stream(self.seed, "clothes")), wall)


def with_depth_noise(
    points: FloatArray, camera: Camera, sigma_m: float, rng: np.random.Generator, told: Camera | None = None
) -> FloatArray:
    """Move points (K, 3), m, along their lines of sight so that their depth z errs by σ = sigma_m (z / 4 m)², as a
    stereo pair's does: depth is focal length × baseline / disparity, whose error is constant. told: the camera, without
    distortion, by which what `camera` sees is placed in the world; None: the same."""
    seen = camera.to_camera(points)
    depth = seen[:, 2]
    factor = 1.0 + sigma_m * depth / _AT_M**2 * rng.standard_normal(len(points))
    moved = seen * factor[:, None]
    if told is None or told is camera:
        return (moved - camera.translation) @ camera.rotation
    pixels = moved[:, :2] / moved[:, 2:] * camera.matrix[[0, 1], [0, 1]] + camera.matrix[:2, 2]
    moved[:, :2] = (pixels - told.matrix[:2, 2]) / told.matrix[[0, 1], [0, 1]] * moved[:, 2:]
    return (moved - told.translation) @ told.rotation
