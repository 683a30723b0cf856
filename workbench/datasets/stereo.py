"""Points from a rendered stereo pair by semi-global block matching (Hirschmüller, PAMI 30, 2008), with exact truth."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from tqdm import tqdm

from workbench.body.camera import Camera
from workbench.core.capabilities import IMAGES, ONE_CAMERA, POINTS, START, Traits, component_traits
from workbench.core.checks import POSITIVE, at_least
from workbench.core.dataset import SequenceInfo
from workbench.core.frame import Frame, View
from workbench.datasets.rendering import render, sequence, surroundings
from workbench.datasets.rendering import subject as subjects
from workbench.datasets.rendering.cache import cached_images, image_key
from workbench.datasets.rendering.sequence import Scene, Take, find_take, given_start, offered_start, take_camera
from workbench.utils.arrays import ByteArray, FloatArray
from workbench.utils.errors import InputError
from workbench.utils.rng import stream
from workbench.utils.source_hash import code_digest

N_EMPTY = 5  # pairs of images of the empty room
_NEAREST_M = 0.6  # how much nearer than a joint the surface, and so the largest disparity to search for, may be
_BLOCK_PX = 5
_NEARER_PX = 2.0  # by how much of disparity a point must be nearer than the empty scene to be taken for someone's
_PATCH_SHARE = 0.05
"""Patches of such points with less than this share of the largest one's pixels are taken for wrong matches."""


@dataclass(kw_only=True, eq=False)
class Stereo(Scene):
    """Frames of a person before a textured wall and floor, seen by two level cameras side by side, and their points.

    motion to departures: see `Scene`, of the left camera, which is distance_m away half-way through, or further where
    the motion would not fit into its image; the right one is baseline_m to its right. The pair as a whole is told off.
    noise: σ of each sensor, grey levels.
    contrast, clutter: strength of the clothes' and the room's texture, see `synthetic.Synthetic`. cache: a folder for
    rendered images; without one every process renders them anew.

    The points are those of OpenCV's StereoSGBM (`disparities`). Paper D does not say how the person was cut out;
    here a point stays when it is nearer, by two pixels of disparity or more, than all that the same pixel showed in
    five pairs of images of the empty room, and lies in no small patch. Of these n_points are drawn evenly. Both images
    are views: "left", "right".

    start: as for `points.Points`, and InputError is raised where that does.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare points, which tell the start, too, and what is given of it."""
        return component_traits(POINTS, IMAGES, ONE_CAMERA, START, *offered_start(keys))

    cache: str | None = None
    n_points: int = 400
    baseline_m: float = 0.2
    distance_m: float = 4.0
    noise: float = 4.0
    contrast: float = 1.0
    clutter: float = 1.0
    start: str = "auto"

    def __post_init__(self) -> None:
        self.check(width=at_least(64), height=at_least(64), n_points=at_least(1), distance_m=at_least(1))
        self.check(noise=at_least(0), contrast=at_least(0), clutter=at_least(0), baseline_m=POSITIVE)

    @cached_property
    def info(self) -> SequenceInfo:
        """The person's measurements, both cameras, and what is offered of the start."""
        initial_pose, phase_ends = given_start("stereo", self.start, self.take, self.seed)
        if self.n_disparities >= self.width // 2:
            found = f"disparities up to {self.n_disparities} px in images {self.width} px wide"
            raise InputError(f"stereo: {found}; expected a smaller baseline_m or focal_px, or a larger distance_m")
        return SequenceInfo(
            name=f"stereo {self.take.motion.name}", n_frames=self.n_frames, rate_hz=self.rate_hz,
            cameras=self.told_cameras, shape=self.take.motion.shape, initial_pose=initial_pose, has_points=True,
            phase_ends=phase_ends, departures=self.take.departures(initial_pose, self.cameras[0], self.told_cameras[0]),
        )  # fmt: skip

    def frames(self) -> Iterator[Frame]:
        """The frames in order; all are rendered and matched before the first comes out."""
        cameras = () if self.told_cameras is self.cameras else self.cameras
        for i, (truth, points) in enumerate(zip(self.take.truths, self._points, strict=True)):
            index = self.first_frame + i
            views = tuple(View(camera, self._images[i, k]) for k, camera in enumerate(self.told_cameras))
            truth = replace(truth, cameras=cameras)
            yield Frame(index, index / self.rate_hz, views, truth, points=points)

    @cached_property
    def take(self) -> Take:
        """What the person does."""
        return find_take(self)

    @cached_property
    def cameras(self) -> tuple[Camera, Camera]:
        """The left and the right camera; rows of one image are rows of the other."""
        return self._pair(take_camera(self, self.take, self.distance_m, "left"))

    @cached_property
    def told_cameras(self) -> tuple[Camera, Camera]:
        """Both cameras as a calibration found them: the pair as a whole is off."""
        left = self.calibrated(self.cameras[0], self.take.motion)
        return self.cameras if left is self.cameras[0] else self._pair(left)

    def _pair(self, left: Camera) -> tuple[Camera, Camera]:
        return left, replace(left, name="right", translation=left.translation - [self.baseline_m, 0.0, 0.0])

    @cached_property
    def n_disparities(self) -> int:
        """The number of disparities searched, px, a multiple of 16."""
        nearest = self.cameras[0].to_camera(self.take.places)[..., 2].min() - _NEAREST_M
        return int(np.ceil(self.focal_px * self.baseline_m / max(nearest, 0.4) / 16.0)) * 16

    @cached_property
    def _points(self) -> list[FloatArray]:
        """The points (K, 3) of every frame, m."""
        left, right = self._images[:, 0], self._images[:, 1]
        pairs = tqdm(zip(left, right, strict=True), f"matching {self.motion}", len(left), unit="frame", disable=None)
        seen = np.stack([disparities(*pair, self.n_disparities) for pair in pairs])
        empty = empty_disparity(seen[self.n_frames :])
        clouds = []
        for i in range(self.n_frames):
            points = nearer_points(seen[i], empty, self.told_cameras[0], self.baseline_m)
            chosen = stream(self.seed, "points", i).permutation(len(points))[: self.n_points]
            clouds.append(points[chosen])
        return clouds

    @cached_property
    def _images(self) -> ByteArray:
        """The images, (n_frames + N_EMPTY, 2, height, width), from the cache or rendered; N_EMPTY of the empty room."""
        shape = (2 * (self.n_frames + N_EMPTY), self.height, self.width)
        return cached_images(self.cache, self._key, shape, self._render).reshape(-1, 2, *shape[1:])

    def _render(self) -> ByteArray:
        """The images (2 (n_frames + N_EMPTY), height, width), left and right in turns."""
        outfit, wall, sensor = (stream(self.seed, name) for name in ("clothes", "background", "sensor"))
        body = self.take.subject.body
        texture = render.clothes(body, outfit, self.contrast)
        room = surroundings.room(self.take, self.cameras[0], wall, self.clutter)
        views = ((camera, texture, surroundings.empty_view(room, camera)) for camera in self.cameras)
        scenes = [render.RenderedScene(body, *view) for view in views]
        images = []
        poses = tqdm(self.take.motion.poses, desc=f"rendering {self.motion}", unit="frame", disable=None)
        for i, pose in enumerate(poses):
            shown = [self.take.subject.shown(scene, (self.first_frame + i) / self.rate_hz) for scene in scenes]
            images += [render.with_noise(render.render(scene, pose), self.noise, sensor) for scene in shown]
        images += [render.with_noise(scene.background, self.noise, sensor) for _ in range(N_EMPTY) for scene in scenes]
        return np.stack(images)

    def _key(self) -> str:
        unseen = ("data", "cache", "start", "n_points")
        return image_key(self, unseen, code_digest(render, sequence, subjects, surroundings), self.take.motion)


def disparities(left: ByteArray, right: ByteArray, n_disparities: int) -> FloatArray:
    """Return the disparities (height, width), px, of the left image in the right one; NaN where unknown.

    n_disparities: a multiple of 16; larger ones are not searched. The smoothness penalties are those that OpenCV's
    documentation recommends, 8 and 32 times the block's area; patches of less than 100 px are taken for speckle."""
    matcher = cv2.StereoSGBM.create(
        minDisparity=0, numDisparities=n_disparities, blockSize=_BLOCK_PX, P1=8 * _BLOCK_PX**2, P2=32 * _BLOCK_PX**2,
        disp12MaxDiff=1, uniquenessRatio=10, speckleWindowSize=100, speckleRange=2,
    )  # fmt: skip
    # the matcher leaves out a strip of n_disparities columns on the left, where a match might lie outside
    wide = [cv2.copyMakeBorder(image, 0, 0, n_disparities, 0, cv2.BORDER_REPLICATE) for image in (left, right)]
    found = matcher.compute(*wide)[:, n_disparities:] / 16.0
    return np.where((found > 0.0) & (found <= np.arange(left.shape[1])), found, np.nan)  # else the match is outside


def empty_disparity(pairs: FloatArray) -> FloatArray:
    """The largest disparity (height, width) in (n, height, width) of an empty room, NaN where few of them know it."""
    known = np.isfinite(pairs)
    largest = np.where(known, pairs, 0.0).max(axis=0)
    return np.where(2 * known.sum(axis=0) > len(pairs), largest, np.nan)


def nearer_points(seen: FloatArray, empty: FloatArray, camera: Camera, baseline_m: float) -> FloatArray:
    """The points (K, 3), m, in the world, of the pixels whose disparity (height, width) shows something before `empty`.
    Where either is unknown, and in patches that are small beside the largest, there is no point. camera: the left one,
    without distortion; the right one stands baseline_m along its x axis. A point of disparity d is at the depth f ·
    baseline / d."""
    with np.errstate(invalid="ignore"):
        nearer = (seen >= empty + _NEARER_PX).astype(np.uint8)
    _, patches, statistics, _ = cv2.connectedComponentsWithStats(nearer)
    sizes = np.where(np.arange(len(statistics)) > 0, statistics[:, cv2.CC_STAT_AREA], 0)  # the first one is the rest
    rows, columns = np.nonzero((nearer > 0) & (sizes >= _PATCH_SHARE * sizes.max())[patches])
    depth = camera.matrix[0, 0] * baseline_m / seen[rows, columns]
    x = (columns - camera.matrix[0, 2]) / camera.matrix[0, 0]
    y = (rows - camera.matrix[1, 2]) / camera.matrix[1, 1]
    in_camera = np.stack([x, y, np.ones(len(x))], axis=1) * depth[:, None]
    return (in_camera - camera.translation) @ camera.rotation
