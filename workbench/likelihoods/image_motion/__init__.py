"""Paper A's likelihood: how well the previous image, moved with the body, predicts the present one."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, TypeAlias, get_args

import numpy as np

from workbench.arrays import FloatArray
from workbench.body.camera import Camera
from workbench.body.limbs import Body
from workbench.core.frame import Frame, View
from workbench.core.likelihood import Evaluation
from workbench.core.traits import IMAGES, Traits, offering
from workbench.errors import InputError
from workbench.likelihoods.constants import NOT_NEGATIVE, POSITIVE, Range, at_least, check, check_choice
from workbench.likelihoods.image_levels import grey_levels
from workbench.likelihoods.image_motion.kernel import (
    Background,
    Exponent,
    LimbModel,
    Occlusion,
    Packed,
    PackedView,
    packed,
    view_log_prob,
)
from workbench.likelihoods.looks import Remembering, among_finite, finite_rows
from workbench.streams import stream


@dataclass(frozen=True, eq=False)
class ImageMotion:
    """Image motion of the limbs' planar patches (A, sections 3.2 and 5, eq. 10–12; EQUATIONS A).

    Every limb's patch is sampled at n points in frame t, and at the same points of the patch in frame t−1; the
    differences of the smoothed grey levels are Gaussian with σ = σ_I / cos α, or an outlier.

        p_image,j = ε/256 + (1−ε) / (√(2π) σ) · exp(−k m / 2σ²),  m the mean (or sum) of the squared differences
        p_j = q p_image,j + (1−q) p_occluded,  q = cos α · (fraction of the points compared);  log p = Σ_j log p_j

    sigma: σ_I, grey levels; it covers what a planar patch and a rigid limb get wrong, not just the sensor.
    exponent: "mean" (B eq. 5) or "sum" (A eq. 10, under which limbs saturate at ε/256); k multiplies either, and is 1
    in both papers. occlusion: "sample" tests every point against the other limbs'
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

    traits: ClassVar[Traits] = offering(dataset=IMAGES)

    body: Body
    sigma: float = 10.0
    epsilon: float = 0.05
    p_occluded: float = 0.01
    n_samples: int = 48
    exponent: Exponent = "mean"
    k: float = 1.0
    occlusion: Occlusion = "sample"
    background: Background = "none"
    blur_px: float = 2.0**0.5
    seed: int = 0

    def __post_init__(self) -> None:
        check("image motion", POSITIVE, sigma=self.sigma, p_occluded=self.p_occluded, k=self.k)
        check("image motion", Range("at least 0 and below 1", lambda value: 0.0 <= value < 1.0), epsilon=self.epsilon)
        check("image motion", at_least(1), n_samples=self.n_samples)
        check("image motion", NOT_NEGATIVE, blur_px=self.blur_px)
        check_choice("image motion", get_args(Exponent), exponent=self.exponent)
        check_choice("image motion", get_args(Occlusion), occlusion=self.occlusion)
        check_choice("image motion", get_args(Background), background=self.background)

    @cached_property
    def samples(self) -> FloatArray:
        """The points (n, 2) of every patch, see `patch_samples`."""
        return patch_samples(self.n_samples, stream(self.seed, "image motion samples"))

    @property
    def model(self) -> LimbModel:
        """The constants that the kernel and its reference share."""
        return LimbModel(
            self.sigma, self.epsilon, self.p_occluded, self.exponent, self.k, self.occlusion, self.background
        )

    def look(self, previous: Frame | None, frame: Frame) -> "MotionLook":
        """Smooth and pack the images of a frame and of the one before.

        Raises InputError when the frames share no camera or, under a still background, an image size; and when an image
        has not the size its camera states.
        """
        return self._look(None, previous, frame)

    def _look(self, known: "PackedFrame | None", previous: Frame | None, frame: Frame) -> "MotionLook":
        now = self._packed(frame)
        if previous is None:
            return MotionLook(self, now, {}, ())
        before = known if known is not None and known.frame is previous else self._packed(previous)
        pairs = {name: (before.views[name], view) for name, view in now.views.items() if name in before.views}
        if not pairs:
            raise InputError(f"image motion: frames {previous.index} and {frame.index} have no camera in common")
        if self.background == "still":
            _check_sizes(pairs)
        notes = (
            f"image motion: camera {name} is missing in frame {previous.index} or {frame.index}"
            for name in sorted({*before.views, *now.views} - set(pairs))
        )
        return MotionLook(self, now, pairs, tuple(notes))

    def _packed(self, frame: Frame) -> "PackedFrame":
        views = {view.camera.name: (view.camera, packed_levels(view, self.blur_px)) for view in frame.views}
        return PackedFrame(frame, views)


PackedImage: TypeAlias = tuple[Camera, Packed]
"""What a camera saw, as the kernel looks it up."""


@dataclass(frozen=True, eq=False)
class PackedFrame:
    """A frame and its packed images, by the camera's name."""

    frame: Frame
    views: Mapping[str, PackedImage]


@dataclass(frozen=True, eq=False)
class MotionLook:
    """What `ImageMotion`, the `cue`, has seen of a frame `now`.

    pairs: the images before and now of every camera that both frames have; none in the first frame of a run.
    """

    cue: ImageMotion
    now: PackedFrame
    pairs: Mapping[str, tuple[PackedImage, PackedImage]]
    notes: tuple[str, ...]
    diagnostics: Mapping[str, float] = field(default_factory=dict)

    def evaluate(self, previous_pose: FloatArray, pose: FloatArray) -> Evaluation:
        """Log likelihoods (N,) of poses (N, P) that came from previous poses (N, P); −∞ where either is not finite.

        A note tells of points that lay outside the images, from 5 % on.
        """
        finite = finite_rows(previous_pose) & finite_rows(pose)
        previous_pose, pose = previous_pose[finite], pose[finite]
        log_prob, notes, cue = np.zeros(len(pose)), [], self.cue
        for name, (before, now) in self.pairs.items():
            views = PackedView(*before, previous_pose), PackedView(*now, pose)
            found, outside = view_log_prob(cue.body, cue.samples, cue.model, *views)
            log_prob += found
            share = int(outside.sum()) / max(len(pose) * len(cue.body.limbs) * cue.n_samples, 1)
            if share > 0.05:
                notes.append(f"image motion: {share:.0%} of the sample points lay outside the images of {name}")
        return among_finite("image motion", finite, log_prob, tuple(notes))

    def remember(self, expected_pose: FloatArray) -> Remembering[PackedFrame]:
        """The likelihood, which keeps this frame's images for the next look."""
        return Remembering(self.now, self.cue._look)


def packed_levels(view: View, blur_px: float) -> Packed:
    """The view's smoothed grey levels as the kernel looks them up."""
    return packed(grey_levels(view, blur_px))


def _check_sizes(pairs: Mapping[str, tuple[PackedImage, PackedImage]]) -> None:
    for name, ((_, before), (_, now)) in pairs.items():
        if before.shape != now.shape:
            raise InputError(f"image motion: background=still needs images of one size from camera {name}")


def patch_samples(n: int, rng: np.random.Generator) -> FloatArray:
    """n evenly spread points (n, 2) of a patch: u along the limb in 0.08..0.92, v across it in −0.8..0.8.

    The additive recurrence of the plastic number (Roberts 2018, the "R2 sequence"), at a random offset.
    """
    plastic = 1.324717957244746
    steps = np.outer(np.arange(n), [1.0 / plastic, 1.0 / plastic**2])
    unit: FloatArray = (rng.random(2) + steps) % 1.0
    return np.array([0.08, -0.8]) + np.array([0.84, 1.6]) * unit
