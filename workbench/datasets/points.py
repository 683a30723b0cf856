"""Dataset of simulated stereo points on a moving person's surface, with ground truth (paper D, section 4.1)."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from workbench.cameras.camera import Camera
from workbench.core.capabilities import ALL_JOINTS, IMAGES, POINTS, START, Traits, component_traits
from workbench.core.checks import BELOW_1, at_least
from workbench.core.dataset import SequenceInfo
from workbench.core.frame import Frame, View
from workbench.datasets.rendering import render, sequence, surroundings
from workbench.datasets.rendering.sequence import RenderedSequence, Scene, find_sequence
from workbench.datasets.rendering.surroundings import in_box, unoccluded
from workbench.datasets.rendering.visible import visible_points
from workbench.utils.arrays import ByteArray, FloatArray
from workbench.utils.rng import stream

_REFERENCE_M = 4.0  # the depth at which σ is sigma_m
_NOISE_GREY = 4.0


@dataclass(kw_only=True, eq=False)
class Points(Scene):
    """Points on the surface of a person that is visible in one static camera, n_points per frame.

    The camera is distance_m away half-way through, or farther where the motion does not fit into its image. Its points
    are transformed to the world by the perturbed camera. Outliers are uniform in a box around the person, the other
    points uniform on the visible surface of the limbs, with errors along the line of sight of σ = sigma_m (z / 4 m)².

    Raises InputError for parameters out of range. `info` does for a motion that does not exist, is too short or, for
    initialization="perturbed_truth", has no gait cycle.

    Parameters
    ----------
    motion to perturbations : see `Scene`.
    outlier_fraction : expected fraction of outliers among n_points.
    n_clutter_points : additional points on floor, wall and bins in the box.
    occluder_width_m : width of an upright bar half-way between camera and person, which reduces the number of points.
    images : whether to render the camera's images, for the viewer; otherwise there are no views.
    initialization : "auto" provides neither initial_pose nor phase_ends; the inference finds both. "perturbed_truth"
        provides what paper D sets by hand: the first true pose with the errors of `perturbations`, and the true phases
        of the first and last frame. Frames contain the truth in both cases, for evaluation.
    skeleton : "person", or "full" for the motion file's own with every joint, which is then also the tracked body.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare points, which allow initialization, and images where they are rendered. Every joint of a file's
        skeleton requires a prior of all joints."""
        images = (IMAGES,) if keys.get("images") else ()
        skeleton = keys.get("skeleton", "person")
        joints = () if skeleton == "person" else (ALL_JOINTS,)
        needs = {"prior": ALL_JOINTS} if skeleton == "full" else {}
        return component_traits(POINTS, START, *sequence.provided_assumptions(keys), *images, *joints, **needs)

    focal_px: float = 400.0
    n_points: int = 400
    sigma_m: float = 0.02
    outlier_fraction: float = 0.15
    n_clutter_points: int = 0
    occluder_width_m: float = 0.0
    distance_m: float = 4.0
    images: bool = False
    initialization: str = "auto"
    skeleton: str = "person"

    def __post_init__(self) -> None:
        self.check(n_points=at_least(1), sigma_m=at_least(0), n_clutter_points=at_least(0))
        self.check(occluder_width_m=at_least(0), distance_m=at_least(1), outlier_fraction=BELOW_1)

    @cached_property
    def info(self) -> SequenceInfo:
        """The person's measurements, the full body where it is tracked, and the initial pose and phases."""
        initial_pose, phase_ends = sequence.perturbed_initialization(
            "points", self.initialization, self.sequence, self.seed, self.perturbation_sizes
        )
        cameras = self.true_camera, self.calibrated_camera
        return SequenceInfo(
            name=f"points of {self.sequence.motion.name}", n_frames=self.n_frames, rate_hz=self.rate_hz,
            cameras=(self.calibrated_camera,) if self.images else (), shape=self.sequence.motion.shape,
            body=self.sequence.body if self.skeleton == "full" else None, initial_pose=initial_pose, has_points=True,
            phase_ends=phase_ends, perturbations=self.sequence.perturbations(initial_pose, *cameras),
        )  # fmt: skip

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in order, each with points, true pose and joints and, where it is known, the activity."""
        cameras = (self.true_camera,) if self.images and self.calibrated_camera is not self.true_camera else ()
        for i, truth in enumerate(self.sequence.truths):
            index = self.first_frame + i
            views = (View(self.calibrated_camera, self._image(i)),) if self.images else ()
            truth = replace(truth, cameras=cameras)
            yield Frame(index, index / self.rate_hz, views, truth, points=self._points(i))

    @cached_property
    def sequence(self) -> RenderedSequence:
        """The person's motion."""
        return find_sequence(self, self.skeleton)

    @cached_property
    def true_camera(self) -> Camera:
        """The camera of the points."""
        return sequence.sequence_camera(self, self.sequence, self.distance_m)

    @cached_property
    def calibrated_camera(self) -> Camera:
        """The camera with calibration errors, by which points are transformed to the world."""
        return self.miscalibrated(self.true_camera, self.sequence.motion)

    def _points(self, i: int) -> FloatArray:
        """Return the points (K, 3) of frame i, in random order."""
        rng = stream(self.seed, "points", i)
        camera, pose = self.true_camera, self.sequence.motion.poses[i]
        body = self.sequence.subject.at((self.first_frame + i) / self.rate_hz)
        n_outliers = int(rng.binomial(self.n_points, self.outlier_fraction))
        surface = visible_points(body, pose, camera, self.n_points - n_outliers, rng)
        if self.occluder_width_m > 0.0:
            bar = surroundings.occluding_bar(self.sequence, camera, self.occluder_width_m)
            surface = unoccluded(surface, camera, bar, np.zeros(len(pose)))
        if self.n_clutter_points:
            clutter = surroundings.clutter_points(self._surroundings, pose[:3], camera, self.n_clutter_points, rng)
            surface = np.concatenate([surface, unoccluded(clutter, camera, body, pose)])
        noisy = with_depth_noise(surface, camera, self.sigma_m, rng, self.calibrated_camera)
        return rng.permutation(np.concatenate([noisy, in_box(pose[:3], n_outliers, rng)]))

    @cached_property
    def _surroundings(self) -> surroundings.Surroundings:
        return surroundings.surroundings(self.sequence, self.true_camera)

    def _image(self, i: int) -> ByteArray:
        noise = stream(self.seed, "sensor", i)
        scene = self.sequence.subject.scene_at(self._scene, (self.first_frame + i) / self.rate_hz)
        return render.with_noise(render.render(scene, self.sequence.motion.poses[i]), _NOISE_GREY, noise)

    @cached_property
    def _scene(self) -> render.RenderedScene:
        body, camera = self.sequence.subject.body, self.true_camera
        wall = render.background(camera.height, camera.width, stream(self.seed, "background"))
        return render.RenderedScene(body, camera, render.clothes(body, stream(self.seed, "clothes")), wall)


def with_depth_noise(
    points: FloatArray, camera: Camera, sigma_m: float, rng: np.random.Generator, calibrated: Camera | None = None
) -> FloatArray:
    """Return points (K, 3), m, with depth errors of σ = sigma_m (z / 4 m)² along their lines of sight.

    A stereo pair has such errors: depth is focal length × baseline / disparity, and the disparity's error is constant.
    calibrated: camera without distortion by which points in `camera` are transformed to the world; None: the same.
    """
    in_camera = camera.to_camera(points)
    depth = in_camera[:, 2]
    factor = 1.0 + sigma_m * depth / _REFERENCE_M**2 * rng.standard_normal(len(points))
    moved = in_camera * factor[:, None]
    if calibrated is None or calibrated is camera:
        return (moved - camera.translation) @ camera.rotation
    pixels = moved[:, :2] / moved[:, 2:] * camera.matrix[[0, 1], [0, 1]] + camera.matrix[:2, 2]
    moved[:, :2] = (pixels - calibrated.matrix[:2, 2]) / calibrated.matrix[[0, 1], [0, 1]] * moved[:, 2:]
    return (moved - calibrated.translation) @ calibrated.rotation
