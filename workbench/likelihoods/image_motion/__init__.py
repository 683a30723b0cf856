"""Paper A's likelihood: how well the previous image, moved with the body, predicts the present one."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from workbench.body.camera import Camera
from workbench.body.limbs import Body
from workbench.core.capabilities import IMAGES, Traits, offering
from workbench.core.checks import BELOW_1, POSITIVE, at_least, check, one_of
from workbench.core.frame import Frame
from workbench.core.likelihood import Evaluation
from workbench.core.side_information import STATIC_CAMERA
from workbench.likelihoods.base import Remembering, among_finite, finite_rows, those
from workbench.likelihoods.cues.image_levels import grey_levels
from workbench.likelihoods.image_motion import kernel
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.rng import stream

P_OCCLUDED = 0.01
"""Likelihood of a point that another limb hides, p_occluded."""
BLUR_PX = 2.0**0.5  # standard deviation of the smoothing

Sampling = Literal["regular", "random"]


@dataclass(frozen=True, eq=False)
class ImageMotion:
    """Image motion of the limbs' planar patches (A, sections 3.2 and 5, eq. 10–12; EQUATIONS A).

    Every limb's patch is sampled at n points in frame t, and at the same points of the patch in frame t−1; the
    differences of the smoothed grey levels are Gaussian with σ = σ_I / cos α, or an outlier.

        p_image,j = ε/256 + (1−ε) / (√(2π) σ) · exp(−k m / 2σ²),  m the mean (or sum) of the squared differences
        p_j = q p_image,j + (1−q) p_occluded,  q = cos α · (fraction of the points compared);  log p = Σ_j log p_j

    sigma: σ_I, grey levels. exponent: "mean" (B eq. 5) or "sum" (A eq. 10, under which limbs saturate at ε/256); k
    multiplies either, and is 1 in both papers, as ε is 0 in B. occlusion: "sample" tests every point against the other
    limbs' patches; "limb" is A's rule, which silences every limb that a nearer one covers in part; "none" does without.
    background: "none" as in the paper, under which a limb at rest on a still background explains the images as well as
    the true limb that moves. "static", for cameras that stand still: with b the share of the points compared, and m_0
    the mean (or sum) of their squared changes at the same pixel, log p gains Σ_j b (log p_still(0) − log p_still(m_0)),
    p_still being p_image at α = 0, the ratio of foreground to background. points: "spread" evenly over the patch but
    for its rim, where background shows; "drawn" from the whole patch, as in A. taper: patches taper with the limb;
    without, limbs are A's cylinders, of their mean radii.

    Deviations from A, section 5: all particles and limbs share the n points, in every frame, so that likelihoods differ
    by pose and not by luck; they are drawn from the patch, not from its pixels. α of a sphere is 0. Points outside an
    image are left out and count against q, as hidden points do. Occlusion is judged in frame t only. Log likelihoods of
    the cameras present in both frames add up. Raises InputError when a constant is out of range."""

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare the need of images, and that the background stands still where it is taken to."""
        return offering(dataset=IMAGES, given=(STATIC_CAMERA,) if keys.get("background") == "static" else ())

    body: Body
    sigma: float = 10.0
    outlier_fraction: float = 0.05
    n_samples: int = 48
    reduction: kernel.Reduction = "mean"
    effective_pixels: float = 1.0
    occlusion: kernel.Occlusion = "sample"
    background: kernel.Background = "none"
    sampling: Sampling = "regular"
    taper: bool = True

    def __post_init__(self) -> None:
        check("image motion", self, sigma=POSITIVE, outlier_fraction=BELOW_1, n_samples=at_least(1))
        check("image motion", self, reduction=one_of(*get_args(kernel.Reduction)), effective_pixels=POSITIVE)
        check("image motion", self, occlusion=one_of(*get_args(kernel.Occlusion)))
        check(
            "image motion", self, background=one_of(*get_args(kernel.Background)), sampling=one_of(*get_args(Sampling))
        )

    @cached_property
    def samples(self) -> FloatArray:
        """The points (n, 2) of every patch, see `patch_samples` and `drawn_samples`."""
        make = patch_samples if self.sampling == "regular" else drawn_samples
        return make(self.n_samples, stream(0, "image motion samples"))

    @cached_property
    def compared(self) -> Body:
        """The body whose patches are compared."""
        return self.body if self.taper else replace(self.body, limbs=self.body.limbs.cylinders())

    @property
    def model(self) -> kernel.LimbModel:
        """Return the constants of the limbs' likelihood, as the kernel takes them."""
        constants = (
            self.sigma,
            self.outlier_fraction,
            P_OCCLUDED,
            self.reduction,
            self.effective_pixels,
            self.occlusion,
            self.background,
        )
        return kernel.LimbModel(*constants)

    def prepare(self, previous: Frame | None, frame: Frame) -> "_MotionLook":
        """Smooth and pack the images of a frame and of the one before; raises InputError when they share no camera or,
        under a still background, an image size, and when an image has not the size that its camera states."""
        return self._look(None, previous, frame)

    def _look(self, known: "_PackedFrame | None", previous: Frame | None, frame: Frame) -> "_MotionLook":
        now = self._packed(frame)
        if previous is None:
            return _MotionLook(self, now, {}, ())
        before = known if known is not None and known.frame is previous else self._packed(previous)
        pairs = {name: (before.views[name], view) for name, view in now.views.items() if name in before.views}
        if not pairs:
            raise InputError(f"image motion: frames {previous.index} and {frame.index} have no camera in common")
        for name, ((_, old), (_, new)) in pairs.items():
            if self.background == "static" and old.shape != new.shape:
                raise InputError(f"image motion: background=static needs images of one size from camera {name}")
        missing = sorted({*before.views, *now.views} - set(pairs))
        where = f"is missing in frame {previous.index} or {frame.index}"
        return _MotionLook(self, now, pairs, tuple(f"image motion: camera {name} {where}" for name in missing))

    def _packed(self, frame: Frame) -> "_PackedFrame":
        images = ((view.camera, kernel.packed(grey_levels(view, BLUR_PX))) for view in frame.views)
        return _PackedFrame(frame, {camera.name: (camera, image) for camera, image in images})


PackedImage: TypeAlias = tuple[Camera, kernel.Packed]  # what a camera saw, as the kernel looks it up


@dataclass(frozen=True, eq=False)
class _PackedFrame:
    """A frame and its packed images, by the camera's name."""

    frame: Frame
    views: Mapping[str, PackedImage]


@dataclass(frozen=True, eq=False)
class _MotionLook:
    """A look of `ImageMotion`, the `cue`, at a frame `now`. pairs: the images before and now of every camera that
    both frames have; none in the first frame of a run."""

    cue: ImageMotion
    now: _PackedFrame
    pairs: Mapping[str, tuple[PackedImage, PackedImage]]
    notes: tuple[str, ...]
    diagnostics: Mapping[str, float] = field(default_factory=dict)

    def evaluate(self, previous_pose: FloatArray, pose: FloatArray) -> Evaluation:
        """Log likelihoods (N,) of poses (N, P) that came from previous poses (N, P), −∞ where either is not finite;
        with a note from 5 % of points outside the images on."""
        finite = finite_rows(previous_pose) & finite_rows(pose)
        previous_pose, pose = those(previous_pose, finite), those(pose, finite)
        log_prob, notes, cue = np.zeros(len(pose)), [], self.cue
        for name, (before, now) in self.pairs.items():
            views = kernel.PackedView(*before, previous_pose), kernel.PackedView(*now, pose)
            found, outside = kernel.view_log_prob(cue.compared, cue.samples, cue.model, *views)
            log_prob += found
            share = int(outside.sum()) / max(len(pose) * len(cue.body.limbs) * cue.n_samples, 1)
            if share > 0.05:
                notes.append(f"image motion: {share:.0%} of the sample points lay outside the images of {name}")
        return among_finite("image motion", finite, log_prob, tuple(notes))

    def update(self, expected_pose: FloatArray) -> Remembering[_PackedFrame]:
        """The likelihood, which keeps this frame's images for the next look."""
        return Remembering(self.now, self.cue._look)


def patch_samples(n: int, rng: np.random.Generator) -> FloatArray:
    """Spread n points (n, 2) evenly over a patch, u along the limb in 0.08..0.92, v across it in −0.8..0.8: the
    additive recurrence of the plastic number (Roberts 2018, the "R2 sequence") at a random offset."""
    plastic = 1.324717957244746
    steps = np.outer(np.arange(n), [1.0 / plastic, 1.0 / plastic**2])
    unit: FloatArray = (rng.random(2) + steps) % 1.0
    return np.array([0.08, -0.8]) + np.array([0.84, 1.6]) * unit


def drawn_samples(n: int, rng: np.random.Generator) -> FloatArray:
    """Draw n points (n, 2) of a patch, u = 0..1 along and v = −1..1 across the limb, evenly likely (A, section 5)."""
    return np.array([0.0, -1.0]) + np.array([1.0, 2.0]) * rng.random((n, 2))
