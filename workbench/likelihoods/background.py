"""What a limb covers differs from the background that a still camera sees, and what lies just beside it does not."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import cv2
import numpy as np
from tqdm import tqdm

from workbench.arrays import Float32Array, FloatArray
from workbench.body.kinematics import JointFrames
from workbench.body.limbs import Body
from workbench.datasets.frame import Dataset, Frame, View
from workbench.errors import InputError
from workbench.likelihoods.image_motion import float_levels, patch_samples
from workbench.likelihoods.limb_points import limb_points, mean_at, over_views

BESIDE, BEYOND = (1.15, 1.6), (1.25, 1.5)
"""Where the points about a limb lie: in half widths from its axis, and beyond its end in lengths; off its outline."""
MAD_TO_SIGMA = 1.4826
"""Standard deviation of a Gaussian over its median absolute deviation."""


@dataclass(frozen=True, eq=False)
class StillScene:
    """What one camera sees without the person: median and standard deviation, (height, width, C), of every pixel's one
    or three levels, 0..255."""

    median: Float32Array
    sigma: Float32Array


@dataclass(frozen=True, eq=False)
class Background:
    """Likelihood ratio of foreground to background at the pixels in and about the limbs, for cameras that stand still.

    The background of a pixel is Gaussian about its median over the clip with a robust deviation, or an outlier; the
    person can have any level. With r the logarithm of their ratio,

        r(x) = −log( ε + (1−ε) Π_c [256 N(I_c(x); median_c(x), σ_c(x)²)]^(1/C) )
        log p = k/n Σ_j ( Σ_i r(x_j,i) − Σ_i r(y_j,i) )

    C: 1 for grey images, 3 for colour, whose channels err together and count as one. x_j,i: n points of limb j, of
    which those that another limb hides or that are not in the image add nothing. y_j,i: as many about the limb, beside
    it and beyond its end, of which those that some limb covers add nothing; they hold a limb in the middle of the
    person's, which the points inside alone do not. Each limb counts as k independent pixels.

    The clip is read once, before it is tracked. A person who stays in one place for more than half of it becomes part
    of the background; there this likelihood says nothing or, where the person leaves in the end, the wrong thing.

    dataset: the clip. n_frames: as many of its frames, evenly spread, are used. least_sigma: a lower bound of σ, grey
    levels. epsilon: ε. n_samples: n. blur_px: of the smoothing. seed: of the points.
    Raises InputError when a constant is out of range or a camera was not in the clip.
    """

    body: Body
    dataset: Dataset
    k: float = 0.5
    epsilon: float = 0.05
    least_sigma: float = 3.0
    n_frames: int = 60
    n_samples: int = 16
    blur_px: float = 0.7
    seed: int = 0
    _notes: list[str] = field(default_factory=list, init=False, repr=False)

    def __post_init__(self) -> None:
        for name, good, expected in (
            ("k", self.k > 0.0, "positive"),
            ("epsilon", 0.0 < self.epsilon < 1.0, "between 0 and 1"),
            ("least_sigma", self.least_sigma > 0.0, "positive"),
            ("n_frames", self.n_frames >= 3, "at least 3"),
            ("n_samples", self.n_samples >= 1, "at least 1"),
            ("blur_px", self.blur_px >= 0.0, "at least 0"),
        ):
            if not good:
                raise InputError(f"background: {name} must be {expected}, found {getattr(self, name)!r}")

    @cached_property
    def samples(self) -> tuple[FloatArray, FloatArray]:
        """The points (n, 2) of every patch and those about it."""
        inside = patch_samples(self.n_samples, np.random.default_rng(self.seed))
        return inside, points_about(inside)

    @cached_property
    def scenes(self) -> Mapping[str, StillScene]:
        """The still scene of every camera of the clip, by the camera's name."""
        return still_scenes(self.dataset, self.n_frames, self.blur_px, self.least_sigma)

    def log_prob(self, previous: Frame, frame: Frame, previous_pose: FloatArray, pose: FloatArray) -> FloatArray:
        """Log likelihood ratios (N,) of poses (N, P), −inf for those not finite; the previous ones do not matter."""
        if bad := int((~np.isfinite(pose).all(axis=1)).sum()):
            self._notes.append(f"background: {bad} of {len(pose)} poses were not finite")
        return over_views(self.body, frame, pose, self._one_view)

    def warnings(self) -> tuple[str, ...]:
        """What was left out since the last call."""
        sentences = tuple(dict.fromkeys(self._notes))
        self._notes.clear()
        return sentences

    def _one_view(self, view: View, frames: JointFrames) -> FloatArray:
        if view.camera.name not in self.scenes:
            raise InputError(f"background: camera {view.camera.name} was not in the clip that it was learned from")
        ratio = log_ratio(view, self.scenes[view.camera.name], self.blur_px, self.epsilon)
        inside, beside = self.samples
        within = mean_at(ratio, limb_points(self.body, inside, view.camera, frames))
        around = mean_at(ratio, limb_points(self.body, beside, view.camera, frames, beside=True))
        log_prob: FloatArray = self.k * (within - around).sum(axis=1)
        return log_prob


def points_about(inside: FloatArray) -> FloatArray:
    """Points (n, 2) about a patch, made of as many within it: every third goes beyond its end, others to its sides."""
    (near, far), (first, last) = BESIDE, BEYOND
    u, v = inside.T
    width = np.abs(v).max()
    sides = np.column_stack([u, np.sign(v) * (near + (far - near) * np.abs(v) / width)])
    end = np.column_stack([first + (last - first) * u, 0.75 * v])
    return np.where(np.arange(len(inside))[:, None] % 3 == 2, end, sides)


def still_scenes(dataset: Dataset, n_frames: int, blur_px: float, least_sigma: float) -> dict[str, StillScene]:
    """Median and 1.4826 times the median absolute deviation of every camera's smoothed levels over the clip."""
    used = set(np.unique(np.linspace(0, len(dataset) - 1, n_frames).round().astype(int)).tolist())
    seen: dict[str, list[Float32Array]] = {}
    for i, frame in enumerate(tqdm(dataset.frames(), "background", len(dataset), unit="frame", disable=None)):
        if i in used:
            for view in frame.views:
                seen.setdefault(view.camera.name, []).append(levels(view, blur_px))
    return {camera: still_scene(images, least_sigma) for camera, images in seen.items()}


def still_scene(images: Sequence[Float32Array], least_sigma: float) -> StillScene:
    """The scene that F images (height, width, C) have in common."""
    median, sigma = np.empty_like(images[0]), np.empty_like(images[0])
    for rows in np.array_split(np.arange(len(median)), 16):  # in strips, which take less memory
        strip = np.stack([image[rows] for image in images])
        median[rows] = np.median(strip, axis=0)
        sigma[rows] = MAD_TO_SIGMA * np.median(np.abs(strip - median[rows]), axis=0)
    return StillScene(median, np.maximum(sigma, np.float32(least_sigma)))


@lru_cache(maxsize=8)
def log_ratio(view: View, scene: StillScene, blur_px: float, epsilon: float) -> Float32Array:
    """r of every pixel (height, width), see `Background`; kept for the last views."""
    apart = (levels(view, blur_px) - scene.median) / scene.sigma
    normal = np.log(256.0 / (np.sqrt(2.0 * np.pi) * scene.sigma)) - 0.5 * apart**2
    ratio: Float32Array = -np.log(epsilon + (1.0 - epsilon) * np.exp(normal.mean(axis=2))).astype(np.float32)
    return ratio


def levels(view: View, blur_px: float) -> Float32Array:
    """The view's one or three levels (height, width, C), smoothed by a Gaussian."""
    image = float_levels(view)
    smooth = cv2.GaussianBlur(image, (0, 0), blur_px) if blur_px > 0.0 else image
    return np.ascontiguousarray(smooth, dtype=np.float32).reshape(*image.shape[:2], -1)
