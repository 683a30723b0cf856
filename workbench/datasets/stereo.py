"""Dataset of points from a rendered stereo pair by semi-global block matching (Hirschmüller, PAMI 30, 2008)."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from tqdm import tqdm

from workbench.cameras.camera import Camera
from workbench.core.capabilities import IMAGES, POINTS, START, Traits, component_traits
from workbench.core.checks import POSITIVE, at_least
from workbench.core.dataset import SequenceInfo
from workbench.core.frame import Frame, View
from workbench.datasets.rendering import render, sequence, surroundings
from workbench.datasets.rendering import subject as subjects
from workbench.datasets.rendering.cache import cached_images, image_key
from workbench.datasets.rendering.sequence import RenderedSequence, Scene, find_sequence
from workbench.utils.arrays import ByteArray, FloatArray
from workbench.utils.errors import InputError
from workbench.utils.rng import stream
from workbench.utils.source_hash import code_digest

N_EMPTY = 5  # image pairs of the empty room
_SURFACE_MARGIN_M = 0.6  # distance of the nearest surface in front of the nearest joint, for the largest disparity
_BLOCK_PX = 5
_MIN_DISPARITY_DIFFERENCE_PX = 2.0  # between a point of the person and the empty room
_MIN_PATCH_FRACTION = 0.05
"""Patches of such points with less than this fraction of the largest one's pixels are assumed to be mismatches."""


@dataclass(kw_only=True, eq=False)
class Stereo(Scene):
    """A person before a textured wall and floor in two level cameras side by side, and points by stereo matching.

    The left camera is distance_m away half-way through, or farther where the motion does not fit into its image; the
    right one is baseline_m to its right. Calibration errors move the pair as a whole. Both images are views, named
    "left" and "right".

    Points come from OpenCV's StereoSGBM (`disparities`). Paper D does not describe its segmentation of the person. Here
    a point is retained when its disparity exceeds the empty room's largest one, over N_EMPTY image pairs, at its pixel
    by two pixels or more, and when it does not lie in a small patch.

    Parameters
    ----------
    motion to perturbations : see `Scene`, of the left camera.
    cache : folder for rendered images; None: every process renders them.
    n_points : number of points sampled uniformly from each frame's.
    noise_std : σ of each sensor, grey levels.
    contrast, clutter : strength of the clothes' and the room's texture, see `synthetic.Synthetic`.
    initialization : as for `points.Points`, with the same errors.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare points, which allow initialization, images, and the assumptions on the initial pose."""
        return component_traits(POINTS, IMAGES, START, *sequence.provided_assumptions(keys))

    cache: str | None = None
    n_points: int = 400
    baseline_m: float = 0.2
    distance_m: float = 4.0
    noise_std: float = 4.0
    contrast: float = 1.0
    clutter: float = 1.0
    initialization: str = "auto"

    def __post_init__(self) -> None:
        self.check(width=at_least(64), height=at_least(64), n_points=at_least(1), distance_m=at_least(1))
        self.check(noise_std=at_least(0), contrast=at_least(0), clutter=at_least(0), baseline_m=POSITIVE)

    @cached_property
    def info(self) -> SequenceInfo:
        """The person's measurements, both cameras, and the initial pose and phases."""
        initial_pose, phase_ends = sequence.perturbed_initialization(
            "stereo", self.initialization, self.sequence, self.seed, self.perturbation_sizes
        )
        if self.n_disparities >= self.width // 2:
            range_px = f"disparities up to {self.n_disparities} px in images {self.width} px wide"
            raise InputError(f"stereo: {range_px}; expected a smaller baseline_m or focal_px, or a larger distance_m")
        left_cameras = self.cameras[0], self.calibrated_cameras[0]
        return SequenceInfo(
            name=f"stereo {self.sequence.motion.name}", n_frames=self.n_frames, rate_hz=self.rate_hz,
            cameras=self.calibrated_cameras, shape=self.sequence.motion.shape, initial_pose=initial_pose,
            has_points=True, phase_ends=phase_ends,
            perturbations=self.sequence.perturbations(initial_pose, *left_cameras),
        )  # fmt: skip

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in order; all are rendered and matched before the first."""
        cameras = () if self.calibrated_cameras is self.cameras else self.cameras
        for i, (truth, points) in enumerate(zip(self.sequence.truths, self._points, strict=True)):
            index = self.first_frame + i
            views = tuple(View(camera, self._images[i, k]) for k, camera in enumerate(self.calibrated_cameras))
            truth = replace(truth, cameras=cameras)
            yield Frame(index, index / self.rate_hz, views, truth, points=points)

    @cached_property
    def sequence(self) -> RenderedSequence:
        """The person's motion."""
        return find_sequence(self)

    @cached_property
    def cameras(self) -> tuple[Camera, Camera]:
        """The rectified left and right camera."""
        return self._pair(sequence.sequence_camera(self, self.sequence, self.distance_m, "left"))

    @cached_property
    def calibrated_cameras(self) -> tuple[Camera, Camera]:
        """Both cameras with calibration errors, which are those of the pair as a whole."""
        left = self.miscalibrated(self.cameras[0], self.sequence.motion)
        return self.cameras if left is self.cameras[0] else self._pair(left)

    def _pair(self, left: Camera) -> tuple[Camera, Camera]:
        return left, replace(left, name="right", translation=left.translation - [self.baseline_m, 0.0, 0.0])

    @cached_property
    def n_disparities(self) -> int:
        """Number of disparities searched, px, a multiple of 16."""
        nearest = self.cameras[0].to_camera(self.sequence.places)[..., 2].min() - _SURFACE_MARGIN_M
        return int(np.ceil(self.focal_px * self.baseline_m / max(nearest, 0.4) / 16.0)) * 16

    @cached_property
    def _points(self) -> list[FloatArray]:
        """Points (K, 3) of every frame, m."""
        left, right = self._images[:, 0], self._images[:, 1]
        pairs = tqdm(zip(left, right, strict=True), f"matching {self.motion}", len(left), unit="frame", disable=None)
        pair_disparities = np.stack([disparities(*pair, self.n_disparities) for pair in pairs])
        empty = empty_disparity(pair_disparities[self.n_frames :])
        clouds = []
        for i in range(self.n_frames):
            points = foreground_points(pair_disparities[i], empty, self.calibrated_cameras[0], self.baseline_m)
            sample = stream(self.seed, "points", i).permutation(len(points))[: self.n_points]
            clouds.append(points[sample])
        return clouds

    @cached_property
    def _images(self) -> ByteArray:
        """Images (n_frames + N_EMPTY, 2, height, width), from the cache or rendered; N_EMPTY of the empty room."""
        shape = (2 * (self.n_frames + N_EMPTY), self.height, self.width)
        return cached_images(self.cache, self._key, shape, self._render).reshape(-1, 2, *shape[1:])

    def _render(self) -> ByteArray:
        """Render the images (2 (n_frames + N_EMPTY), height, width), left and right alternating."""
        outfit, wall, sensor = (stream(self.seed, name) for name in ("clothes", "background", "sensor"))
        body = self.sequence.subject.body
        texture = render.clothes(body, outfit, self.contrast)
        room = surroundings.room(self.sequence, self.cameras[0], wall, self.clutter)
        views = ((camera, texture, surroundings.empty_view(room, camera)) for camera in self.cameras)
        scenes = [render.RenderedScene(body, *view) for view in views]
        images = []
        poses = tqdm(self.sequence.motion.poses, desc=f"rendering {self.motion}", unit="frame", disable=None)
        for i, pose in enumerate(poses):
            time_s = (self.first_frame + i) / self.rate_hz
            pair = [render.render(self.sequence.subject.scene_at(scene, time_s), pose) for scene in scenes]
            images += [render.with_noise(image, self.noise_std, sensor) for image in pair]
        images += [
            render.with_noise(scene.background, self.noise_std, sensor) for _ in range(N_EMPTY) for scene in scenes
        ]
        return np.stack(images)

    def _key(self) -> str:
        unseen = ("data", "cache", "initialization", "n_points")
        return image_key(self, unseen, code_digest(render, sequence, subjects, surroundings), self.sequence.motion)


def disparities(left: ByteArray, right: ByteArray, n_disparities: int) -> FloatArray:
    """Return the disparities (height, width), px, of the left image in the right one; NaN where unknown.

    The smoothness penalties are those of OpenCV's documentation, 8 and 32 times the block's area. Patches of less than
    100 px are removed as speckle. n_disparities: number of disparities searched, a multiple of 16.
    """
    matcher = cv2.StereoSGBM.create(
        minDisparity=0, numDisparities=n_disparities, blockSize=_BLOCK_PX, P1=8 * _BLOCK_PX**2, P2=32 * _BLOCK_PX**2,
        disp12MaxDiff=1, uniquenessRatio=10, speckleWindowSize=100, speckleRange=2,
    )  # fmt: skip
    # the matcher omits n_disparities columns on the left, whose matches might lie outside the image
    wide = [cv2.copyMakeBorder(image, 0, 0, n_disparities, 0, cv2.BORDER_REPLICATE) for image in (left, right)]
    disparity = matcher.compute(*wide)[:, n_disparities:] / 16.0
    inside = (disparity > 0.0) & (disparity <= np.arange(left.shape[1]))
    return np.where(inside, disparity, np.nan)


def empty_disparity(pairs: FloatArray) -> FloatArray:
    """Return the largest disparity (height, width) of n image pairs (n, height, width) of an empty room; NaN where at
    most half of them have one."""
    finite = np.isfinite(pairs)
    largest = np.where(finite, pairs, 0.0).max(axis=0)
    return np.where(2 * finite.sum(axis=0) > len(pairs), largest, np.nan)


def foreground_points(disparity: FloatArray, empty: FloatArray, camera: Camera, baseline_m: float) -> FloatArray:
    """Return points (K, 3), m, in the world, of the pixels in front of the empty room, outside small patches.

    A point of disparity d has the depth f · baseline / d.
    disparity, empty: (height, width), px, of a frame and of the empty room; NaN where unknown. camera: the left camera,
    without distortion. baseline_m: distance of the right camera along the left one's x axis.
    """
    with np.errstate(invalid="ignore"):
        foreground = (disparity >= empty + _MIN_DISPARITY_DIFFERENCE_PX).astype(np.uint8)
    _, patches, statistics, _ = cv2.connectedComponentsWithStats(foreground)
    sizes = statistics[:, cv2.CC_STAT_AREA] * (np.arange(len(statistics)) > 0)  # without the background, the first
    rows, columns = np.nonzero((foreground > 0) & (sizes >= _MIN_PATCH_FRACTION * sizes.max())[patches])
    depth = camera.matrix[0, 0] * baseline_m / disparity[rows, columns]
    x = (columns - camera.matrix[0, 2]) / camera.matrix[0, 0]
    y = (rows - camera.matrix[1, 2]) / camera.matrix[1, 1]
    in_camera = np.stack([x, y, np.ones(len(x))], axis=1) * depth[:, None]
    return (in_camera - camera.translation) @ camera.rotation
