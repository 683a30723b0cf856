"""Points from a rendered stereo pair by block matching: as poor as paper D's data, and with exact truth."""

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np
from tqdm import tqdm

from workbench.arrays import ByteArray, FloatArray
from workbench.body.camera import Camera
from workbench.core.dataset import Known
from workbench.core.frame import Frame, View
from workbench.core.traits import IMAGES, ONE_CAMERA, POINTS, START, Traits, offering
from workbench.datasets.scenes import camera as placing
from workbench.datasets.scenes import render, stereo_matching
from workbench.datasets.scenes import room as stereo_room
from workbench.datasets.scenes.cache import read_images, write_images
from workbench.datasets.scenes.scene import Scene
from workbench.datasets.scenes.stereo_matching import empty_disparity, nearer_points
from workbench.datasets.scenes.take import Take, given_start, take_of
from workbench.digest import code_digest
from workbench.errors import InputError
from workbench.streams import stream

N_EMPTY = 5
"""Pairs of images of the empty room."""
_NEAREST_M = 0.6
"""How much nearer than a joint the surface, and so the largest disparity to search for, may be."""


@dataclass(kw_only=True, eq=False)
class Stereo(Scene):
    """Frames of a person before a textured wall and floor, seen by two level cameras side by side, and their points.

    motion to seed: see `Scene`, of the left camera, which is distance_m away half-way through, or further where the
    motion would not fit into its image; the right one is baseline_m to its right. noise: σ of each sensor, grey levels.
    contrast, clutter: strength of the clothes' and the room's texture, see `synthetic.Synthetic`. cache: a folder for
    rendered images; without one every process renders them anew.

    The points are those of OpenCV's StereoSGBM (`stereo_matching`). Paper D does not say how the person was cut out;
    here a point stays when it is nearer, by two pixels of disparity or more, than all that the same pixel showed in
    five pairs of images of the empty room, and lies in no small patch. Of these n_points are drawn evenly. Both images
    are views: "left", "right".

    start: as for `points.Points`, and InputError is raised where that does.
    """

    traits: ClassVar[Traits] = offering(POINTS, IMAGES, ONE_CAMERA, START)

    cache: str | None = None
    n_points: int = 400
    baseline_m: float = 0.2
    distance_m: float = 4.0
    noise: float = 4.0
    contrast: float = 1.0
    clutter: float = 1.0
    start: str = "auto"

    def __post_init__(self) -> None:
        self.check(width=64, height=64, n_points=1, distance_m=1.0, noise=0.0, contrast=0.0, clutter=0.0)
        if not 0.0 < self.baseline_m < np.inf:
            raise InputError(f"stereo: baseline_m must be positive, found {self.baseline_m}")

    @cached_property
    def known(self) -> Known:
        """The person's measurements, both cameras, and what is offered of the start."""
        start_pose, phase_ends = given_start("stereo", self.start, self.take, self.seed)
        if self.n_disparities >= self.width // 2:
            raise InputError(
                f"stereo: disparities up to {self.n_disparities} px in images {self.width} px wide; expected a smaller "
                "baseline_m or focal_px, or a larger distance_m"
            )
        return Known(
            name=f"stereo {self.take.motion.name}", n_frames=self.n_frames, rate_hz=self.rate_hz, cameras=self.cameras,
            shape=self.take.motion.shape, start_pose=start_pose, has_points=True, phase_ends=phase_ends,
        )  # fmt: skip

    def frames(self) -> Iterator[Frame]:
        """The frames in order; all are rendered and matched before the first comes out."""
        for i, (truth, points) in enumerate(zip(self.take.truths, self._points, strict=True)):
            index = self.first_frame + i
            views = tuple(View(camera, self._images[i, k]) for k, camera in enumerate(self.cameras))
            yield Frame(index, index / self.rate_hz, views, truth, points=points)

    @cached_property
    def take(self) -> Take:
        """Tell what the person does."""
        return take_of(self)

    @cached_property
    def cameras(self) -> tuple[Camera, Camera]:
        """The left and the right camera; rows of one image are rows of the other."""
        left = placing.take_camera(self, self.take, self.distance_m, "left")
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
        seen = np.stack([stereo_matching.disparities(*pair, self.n_disparities) for pair in pairs])
        empty = empty_disparity(seen[self.n_frames :])
        clouds = []
        for i in range(self.n_frames):
            points = nearer_points(seen[i], empty, self.cameras[0], self.baseline_m)
            chosen = stream(self.seed, "points", i).permutation(len(points))[: self.n_points]
            clouds.append(points[chosen])
        return clouds

    @cached_property
    def _images(self) -> ByteArray:
        """The images, (n_frames + N_EMPTY, 2, height, width), from the cache or rendered; N_EMPTY of the empty room."""
        shape = (2 * (self.n_frames + N_EMPTY), self.height, self.width)
        if self.cache is None:
            return self._render().reshape(-1, 2, *shape[1:])
        file = Path(self.cache).expanduser() / "scenes" / f"{self._key()[:32]}.npz"
        images = read_images(file, shape)
        if images is None:
            images = self._render()
            write_images(file, images)
        return images.reshape(-1, 2, *shape[1:])

    def _render(self) -> ByteArray:
        """The images (2 (n_frames + N_EMPTY), height, width), left and right in turns."""
        outfit, wall, sensor = (stream(self.seed, name) for name in ("clothes", "background", "sensor"))
        body, texture = self.take.body, render.clothes(self.take.body, outfit, self.contrast)
        room = stereo_room.room(self.take, self.cameras[0], wall, self.clutter)
        scenes = [
            render.prepare(body, camera, texture, stereo_room.empty_view(room, camera)) for camera in self.cameras
        ]
        images = []
        for pose in tqdm(self.take.motion.poses, desc=f"rendering {self.motion}", unit="frame", disable=None):
            images += [render.with_noise(render.render(scene, pose), self.noise, sensor) for scene in scenes]
        images += [render.with_noise(scene.background, self.noise, sensor) for _ in range(N_EMPTY) for scene in scenes]
        return np.stack(images)

    def _key(self) -> str:
        """Names the images: a digest of the poses and of every parameter that shows in them."""
        apart = ("data", "cache", "start", "n_points")
        parameters = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in apart}
        parameters["motion"] = self.take.motion.name
        code = code_digest(render, stereo_room, placing)
        digest = hashlib.sha256(json.dumps([code, parameters, self.take.motion.shape.as_dict()]).encode())
        digest.update(np.ascontiguousarray(self.take.motion.poses).tobytes())
        return digest.hexdigest()
