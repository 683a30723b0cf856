"""Paper A's likelihood: how well the previous image, moved with the body, predicts the present one."""

from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import cv2
import numpy as np

from workbench.arrays import Float32Array, FloatArray
from workbench.body.limbs import Body
from workbench.datasets.frame import Frame, View
from workbench.errors import InputError
from workbench.likelihoods.image_motion_kernel import (
    Background,
    Exponent,
    LimbModel,
    Occlusion,
    Packed,
    PackedView,
    packed,
    view_log_prob,
)


@dataclass(frozen=True, eq=False)
class ImageMotion:
    """Image motion of the limbs' planar patches (A, sections 3.2 and 5, eq. 10–12; EQUATIONS A).

    Every limb's patch is sampled at n points in frame t, and at the same points of the patch in frame t−1; the
    differences of the smoothed grey levels are Gaussian with σ = σ_I / cos α, or an outlier.

        p_image,j = ε/256 + (1−ε) / (√(2π) σ) · exp(−k m / 2σ²),  m the mean (or sum) of the squared differences
        p_j = q p_image,j + (1−q) p_occluded,  q = cos α · (fraction of the points compared);  log p = Σ_j log p_j

    sigma: σ_I, grey levels. exponent: "mean" (B eq. 5) or "sum" (A eq. 10, under which limbs saturate at ε/256);
    k multiplies either, and is 1 in both papers. occlusion: "sample" tests every point against the other limbs'
    patches; "limb" is A's rule, which silences every limb that a nearer one covers in part: in a side view the near
    arm silences the torso; "none" does without. blur_px: standard deviation of the smoothing. seed: of the points.

    background: "none" as in the paper, under which a limb at rest on a still background explains the images as well
    as the true limb that moves. "still" explains what no limb covers by a background that does not move, for cameras
    that stand still: with b the share of the points compared, and m_0 the mean (or sum) of their squared changes at
    the same pixel, log p gains Σ_j b (log p_still(0) − log p_still(m_0)), p_still being p_image at α = 0. It is the
    ratio of foreground to background of the pixels covered, so that only changed pixels that a limb explains count.

    Deviations from A, section 5: the n points are spread evenly over the patch, not drawn per limb from its pixels,
    and all particles and limbs share them, so that likelihoods differ by pose and not by luck; they keep off the
    patch's rim, where background shows. Patches taper with the limb. α of a sphere is 0. Points outside an image are
    left out and count against q, as hidden points do. Occlusion is judged in frame t only, as in A.
    Several views: log likelihoods add up over the cameras present in both frames.

    Raises InputError when a constant is out of range.
    """

    body: Body
    sigma: float = 6.0
    epsilon: float = 0.05
    p_occluded: float = 0.01
    n_samples: int = 50
    exponent: Exponent = "mean"
    k: float = 1.0
    occlusion: Occlusion = "sample"
    background: Background = "none"
    blur_px: float = 2.0**0.5
    seed: int = 0
    _outside: dict[str, tuple[int, int]] = field(default_factory=dict, init=False, repr=False)
    _notes: list[str] = field(default_factory=list, init=False, repr=False)

    def __post_init__(self) -> None:
        for name, good, expected in (
            ("sigma", self.sigma > 0.0, "positive"),
            ("epsilon", 0.0 <= self.epsilon < 1.0, "at least 0 and below 1"),
            ("p_occluded", self.p_occluded > 0.0, "positive"),
            ("n_samples", self.n_samples >= 1, "at least 1"),
            ("exponent", self.exponent in ("mean", "sum"), "mean or sum"),
            ("k", self.k > 0.0, "positive"),
            ("occlusion", self.occlusion in ("sample", "limb", "none"), "sample, limb or none"),
            ("background", self.background in ("none", "still"), "none or still"),
            ("blur_px", self.blur_px >= 0.0, "at least 0"),
        ):
            if not good:
                raise InputError(f"image motion: {name} must be {expected}, found {getattr(self, name)!r}")

    @cached_property
    def samples(self) -> FloatArray:
        """The points (n, 2) of every patch, see `patch_samples`."""
        return patch_samples(self.n_samples, np.random.default_rng(self.seed))

    @property
    def model(self) -> LimbModel:
        """The constants that the kernel and its reference share."""
        return LimbModel(
            self.sigma, self.epsilon, self.p_occluded, self.exponent, self.k, self.occlusion, self.background
        )

    def log_prob(self, previous: Frame, frame: Frame, previous_pose: FloatArray, pose: FloatArray) -> FloatArray:
        """Log likelihoods (N,) of poses (N, P) that came from previous poses (N, P); −inf where either is not finite.

        Raises InputError when the frames share no camera, or an image has not the size its camera states.
        """
        finite = np.isfinite(previous_pose).all(axis=1) & np.isfinite(pose).all(axis=1)
        if finite.all():
            return self._all_cameras(previous, frame, previous_pose, pose)
        log_prob = np.full(len(pose), -np.inf)
        log_prob[finite] = self._all_cameras(previous, frame, previous_pose[finite], pose[finite])
        self._notes.append(f"image motion: {(~finite).sum()} of {len(pose)} poses were not finite")
        return log_prob

    def warnings(self) -> tuple[str, ...]:
        """What was left out since the last call: points outside the images (from 5 %), views, poses."""
        shares = {camera: outside / max(total, 1) for camera, (outside, total) in self._outside.items()}
        sentences = [
            f"image motion: {share:.0%} of the sample points lay outside the images of {camera}"
            for camera, share in shares.items()
            if share > 0.05
        ]
        sentences += dict.fromkeys(self._notes)
        self._outside.clear()
        self._notes.clear()
        return tuple(sentences)

    def _pairs(self, previous: Frame, frame: Frame) -> list[tuple[View, View]]:
        earlier = {view.camera.name: view for view in previous.views}
        pairs = [(earlier[view.camera.name], view) for view in frame.views if view.camera.name in earlier]
        if not pairs:
            raise InputError(f"image motion: frames {previous.index} and {frame.index} have no camera in common")
        shared = {view.camera.name for _, view in pairs}
        for name in sorted({view.camera.name for view in (*previous.views, *frame.views)} - shared):
            self._notes.append(f"image motion: camera {name} is missing in frame {previous.index} or {frame.index}")
        return pairs

    def _all_cameras(self, previous: Frame, frame: Frame, previous_pose: FloatArray, pose: FloatArray) -> FloatArray:
        log_prob = np.zeros(len(pose))
        for before, now in self._pairs(previous, frame):
            log_prob += self._one_camera(before, now, previous_pose, pose)
        return log_prob

    def _one_camera(self, before: View, now: View, previous_pose: FloatArray, pose: FloatArray) -> FloatArray:
        if self.background == "still" and before.image.shape[:2] != now.image.shape[:2]:
            raise InputError(f"image motion: background=still needs images of one size from camera {now.camera.name}")
        log_prob, outside = view_log_prob(
            self.body,
            self.samples,
            self.model,
            PackedView(before.camera, packed_levels(before, self.blur_px), previous_pose),
            PackedView(now.camera, packed_levels(now, self.blur_px), pose),
        )
        left_out, total = self._outside.get(now.camera.name, (0, 0))
        points = len(outside) * len(self.body.limbs) * self.n_samples
        self._outside[now.camera.name] = left_out + int(outside.sum()), total + points
        return log_prob


@lru_cache(maxsize=8)
def packed_levels(view: View, blur_px: float) -> Packed:
    """The view's smoothed grey levels as the kernel looks them up; kept for the last views."""
    return packed(smoothed(view, blur_px))


@lru_cache(maxsize=8)
def smoothed(view: View, blur_px: float) -> Float32Array:
    """The view's grey levels (height, width), 0..255, smoothed by a Gaussian (A, section 5); kept for the last views.

    Raises InputError when the image has not the size that its camera states.
    """
    levels = float_levels(view)
    grey = cv2.cvtColor(levels, cv2.COLOR_RGB2GRAY) if levels.ndim == 3 else levels
    smooth = cv2.GaussianBlur(grey, (0, 0), blur_px) if blur_px > 0.0 else grey
    return np.ascontiguousarray(smooth, dtype=np.float32)


def float_levels(view: View) -> Float32Array:
    """The view's grey or RGB levels, 0..255; raises InputError when the image has not the size its camera states."""
    camera, image = view.camera, view.image
    if image.shape[:2] != (camera.height, camera.width) or image.shape[2:] not in ((), (3,)):
        raise InputError(
            f"likelihood: camera {camera.name}: expected a grey or RGB image of {camera.width}×{camera.height} px, "
            f"found an array of shape {image.shape}"
        )
    return image.astype(np.float32)


def patch_samples(n: int, rng: np.random.Generator) -> FloatArray:
    """n evenly spread points (n, 2) of a patch: u along the limb in 0.08..0.92, v across it in −0.8..0.8.

    The additive recurrence of the plastic number (Roberts 2018, the "R2 sequence"), at a random offset.
    """
    plastic = 1.324717957244746
    steps = np.outer(np.arange(n), [1.0 / plastic, 1.0 / plastic**2])
    unit: FloatArray = (rng.random(2) + steps) % 1.0
    return np.array([0.08, -0.8]) + np.array([0.84, 1.6]) * unit
