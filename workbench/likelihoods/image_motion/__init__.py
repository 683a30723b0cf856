"""Paper A's likelihood: image motion, the prediction of the image by the previous one moved with the body."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from workbench.body.limbs import Body
from workbench.cameras.camera import Camera
from workbench.core.capabilities import IMAGES, Traits, component_traits
from workbench.core.checks import BELOW_1, POSITIVE, at_least, check, one_of
from workbench.core.frame import Frame
from workbench.core.likelihood import Evaluation
from workbench.core.side_information import STATIC_CAMERA
from workbench.likelihoods.base import AdaptiveLikelihood, expand_finite, finite_rows, select_finite
from workbench.likelihoods.cues.image_levels import grey_levels
from workbench.likelihoods.image_motion import kernel
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.rng import stream

BLUR_PX = 2.0**0.5  # standard deviation of the smoothing

Sampling = Literal["regular", "random"]


@dataclass(frozen=True, eq=False)
class ImageMotion:
    """Image motion of the limbs' planar patches (A, sections 3.2 and 5, eq. 10–12; EQUATIONS A).

    Every limb's patch is sampled at n points in frame t, and at the same points of the patch in frame t−1; the
    differences of the smoothed grey levels are Gaussian with σ = σ_I / cos α, or an outlier.

        p_image,j = ε/256 + (1−ε) / (√(2π) σ) · exp(−k m / 2σ²),  m the mean (or sum) of the squared differences
        p_j = q p_image,j + (1−q) p_occluded,  q = cos α · (fraction of the points compared);  log p = Σ_j log p_j

    With background "static", b the fraction of the points compared, and m_0 the mean (or sum) of their squared changes
    at the same pixel, log p gains Σ_j b (log p_static(0) − log p_static(m_0)), where p_static is p_image at α = 0: the
    ratio of foreground to background.

    Parameters
    ----------
    body : the person's body.
    sigma : σ_I, grey levels.
    outlier_fraction : ε; 0 in B.
    p_occluded : likelihood of a hidden limb, for A determined empirically.
    n_samples : n.
    reduction : "mean" (B eq. 5) or "sum" (A eq. 10, for which limbs saturate at ε/256).
    effective_pixels : k, which multiplies either; 1 in both papers.
    occlusion : "sample" tests every point against the other limbs' patches; "limb" is A's rule, which excludes a limb
        that a nearer one covers in part, except one that continues it: at their joint one always covers the other;
        "none" ignores occlusion.
    background : "none", as in the paper, for which a limb at rest on a static background explains the images as well as
        the true moving limb; "static", for static cameras.
    sampling : "regular": evenly spaced over the patch except its rim, where background is visible; "random": from the
        whole patch, as in A.
    taper : whether patches taper with the limb; False: A's cylinders, of the limbs' mean radii.

    Raises
    ------
    InputError : a parameter is out of range.

    Notes
    -----
    Deviations from A, section 5: all particles and limbs share the n points, in every frame, so that likelihoods differ
    by the pose, not by sampling noise; points are sampled from the patch, not from its pixels. α of a sphere is 0.
    Points outside an image are excluded and reduce q, as hidden points do. Occlusion is tested in frame t only. Log
    likelihoods of the cameras present in both frames add up.
    """

    @staticmethod
    def traits(keys: Mapping[str, Any]) -> Traits:
        """Declare that images are required, and a static camera if the background is static."""
        return component_traits(
            dataset=IMAGES, assumptions=(STATIC_CAMERA,) if keys.get("background") == "static" else ()
        )

    body: Body
    sigma: float = 10.0
    outlier_fraction: float = 0.05
    p_occluded: float = 0.01
    n_samples: int = 48
    reduction: kernel.Reduction = "mean"
    effective_pixels: float = 1.0
    occlusion: kernel.Occlusion = "sample"
    background: kernel.Background = "none"
    sampling: Sampling = "regular"
    taper: bool = True

    def __post_init__(self) -> None:
        check("image motion", self, sigma=POSITIVE, outlier_fraction=BELOW_1, p_occluded=POSITIVE)
        check("image motion", self, n_samples=at_least(1), effective_pixels=POSITIVE)
        check("image motion", self, reduction=one_of(*get_args(kernel.Reduction)))
        check("image motion", self, occlusion=one_of(*get_args(kernel.Occlusion)))
        check("image motion", self, background=one_of(*get_args(kernel.Background)))
        check("image motion", self, sampling=one_of(*get_args(Sampling)))

    @cached_property
    def samples(self) -> FloatArray:
        """The points (n, 2) of every patch, see `regular_samples` and `random_samples`."""
        sampler = regular_samples if self.sampling == "regular" else random_samples
        return sampler(self.n_samples, stream(0, "image motion samples"))

    @cached_property
    def compared_body(self) -> Body:
        """The body whose patches are compared."""
        return self.body if self.taper else replace(self.body, limbs=self.body.limbs.cylinders())

    @property
    def model(self) -> kernel.LimbModel:
        """The parameters of the limbs' likelihood for the kernel."""
        constants = (
            self.sigma, self.outlier_fraction, self.p_occluded, self.reduction, self.effective_pixels, self.occlusion,
            self.background,
        )  # fmt: skip
        return kernel.LimbModel(*constants)

    def prepare(self, previous: Frame | None, frame: Frame) -> "_MotionFrameLikelihood":
        """Smooth and pack the images of a frame and the previous one. Raises InputError if they have no camera in
        common or, for a static background, different image sizes, or an image's size is not its camera's."""
        return self._prepare(None, previous, frame)

    def _prepare(
        self, cached: "_PackedFrame | None", previous: Frame | None, frame: Frame
    ) -> "_MotionFrameLikelihood":  # fmt: skip
        present = self._packed(frame)
        if previous is None:
            return _MotionFrameLikelihood(self, present, {}, ())
        past = cached if cached is not None and cached.frame is previous else self._packed(previous)
        pairs = {name: (past.views[name], view) for name, view in present.views.items() if name in past.views}
        if not pairs:
            raise InputError(f"image motion: frames {previous.index} and {frame.index} have no camera in common")
        for name, ((_, old), (_, new)) in pairs.items():
            if self.background == "static" and old.shape != new.shape:
                raise InputError(f"image motion: background=static needs images of one size from camera {name}")
        missing = sorted({*past.views, *present.views} - set(pairs))
        where = f"is missing in frame {previous.index} or {frame.index}"
        notes = tuple(f"image motion: camera {name} {where}" for name in missing)
        return _MotionFrameLikelihood(self, present, pairs, notes)

    def _packed(self, frame: Frame) -> "_PackedFrame":
        images = ((view.camera, kernel.packed(grey_levels(view, BLUR_PX))) for view in frame.views)
        return _PackedFrame(frame, {camera.name: (camera, image) for camera, image in images})


PackedImage: TypeAlias = tuple[Camera, kernel.Packed]  # a camera and its packed image


@dataclass(frozen=True, eq=False)
class _PackedFrame:
    """A frame and its packed images, by the camera's name."""

    frame: Frame
    views: Mapping[str, PackedImage]


@dataclass(frozen=True, eq=False)
class _MotionFrameLikelihood:
    """The likelihood of a frame `present` by `ImageMotion`, the `cue`. pairs: the previous and present images of every
    camera in both frames; none in the first frame of a run."""

    cue: ImageMotion
    present: _PackedFrame
    pairs: Mapping[str, tuple[PackedImage, PackedImage]]
    notes: tuple[str, ...]
    diagnostics: Mapping[str, float] = field(default_factory=dict)

    def evaluate(self, previous_pose: FloatArray, pose: FloatArray) -> Evaluation:
        """Return log likelihoods (N,) of poses (N, P) with previous poses (N, P), −∞ where either is not finite; with a
        note if 5 % of the points or more are outside the images."""
        finite = finite_rows(previous_pose) & finite_rows(pose)
        previous_pose, pose = select_finite(previous_pose, finite), select_finite(pose, finite)
        log_prob, notes, cue = np.zeros(len(pose)), [], self.cue
        for name, (previous_views, present) in self.pairs.items():
            views = kernel.PackedView(*previous_views, previous_pose), kernel.PackedView(*present, pose)
            view_log_prob, outside = kernel.view_log_prob(cue.compared_body, cue.samples, cue.model, *views)
            log_prob += view_log_prob
            outside_fraction = int(outside.sum()) / max(len(pose) * len(cue.body.limbs) * cue.n_samples, 1)
            if outside_fraction > 0.05:
                notes.append(
                    f"image motion: {outside_fraction:.0%} of the sample points lay outside the images of {name}"
                )
        return expand_finite("image motion", finite, log_prob, tuple(notes))

    def update(self, expected_pose: FloatArray) -> AdaptiveLikelihood[_PackedFrame]:
        """Return the likelihood with this frame's packed images as the previous ones."""
        return AdaptiveLikelihood(self.present, self.cue._prepare)


def regular_samples(n: int, rng: np.random.Generator) -> FloatArray:
    """Return n points (n, 2) evenly spaced over a patch, u along the limb in 0.08..0.92, v across it in −0.8..0.8: the
    additive recurrence of the plastic number (Roberts 2018, the "R2 sequence") at a random offset."""
    plastic = 1.324717957244746
    steps = np.outer(np.arange(n), [1.0 / plastic, 1.0 / plastic**2])
    unit: FloatArray = (rng.random(2) + steps) % 1.0
    return np.array([0.08, -0.8]) + np.array([0.84, 1.6]) * unit


def random_samples(n: int, rng: np.random.Generator) -> FloatArray:
    """Return n uniformly random points (n, 2) of a patch, u = 0..1 along, v = −1..1 across the limb (A, section 5)."""
    return np.array([0.0, -1.0]) + np.array([1.0, 2.0]) * rng.random((n, 2))
