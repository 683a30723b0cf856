"""Background subtraction: pixels on a limb differ from a static background, pixels next to it do not."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import ClassVar

import numpy as np

from workbench.body.limbs import Body
from workbench.core.capabilities import IMAGES, Traits, component_traits
from workbench.core.checks import INSIDE_UNIT, POSITIVE, at_least, check
from workbench.core.frame import Frame
from workbench.core.frame_cache import FrameCache
from workbench.core.side_information import STATIC_BACKGROUND
from workbench.likelihoods.cues.image_levels import StaticBackground, log_ratio, static_backgrounds
from workbench.likelihoods.cues.limb_points import LimbFrameLikelihood, LimbPoints, LimbViewLikelihood, mean_at
from workbench.likelihoods.image_motion import regular_samples
from workbench.utils.arrays import Float32Array, FloatArray
from workbench.utils.rng import stream

BLUR_PX = 0.7  # standard deviation of the smoothing
SIDE_OFFSETS, END_OFFSETS = (1.15, 1.6), (1.25, 1.5)
"""Ranges of the points around a limb: to its sides, in half widths from its axis, and beyond its end, in lengths."""


@dataclass(frozen=True, eq=False)
class Background:
    """Likelihood ratio of foreground to background at pixels inside and just outside the limbs, for static cameras.

    A background pixel is Gaussian about its median over the sequence, with a robust deviation, or an outlier; the
    person's levels are uniformly distributed:

        r(x) = −log( ε + (1−ε) Π_c [256 N(I_c(x); median_c(x), σ_c(x)²)]^(1/C) )
        log p = k/n Σ_j ( Σ_i r(x_j,i) − Σ_i r(y_j,i) )

    C: 1 for grey images, 3 for colour images, whose channels have correlated errors and count as one. x_j,i: n points
    of limb j; those that are hidden or outside the image contribute 0. y_j,i: n points next to the limb and beyond its
    end; those that a limb covers contribute 0. They centre a limb on the person's. Each limb counts as k independent
    pixels. A person who stays in one place for more than half of the sequence becomes part of the background. Raises
    InputError if a parameter is out of range, or a camera is not in the sequence.

    Parameters
    ----------
    body, clip : the person's body and the sequence, which is read once.
    effective_pixels : k, per limb.
    outlier_fraction : ε.
    n_frames : evenly spaced frames of the sequence used.
    n_samples : n.
    """

    traits: ClassVar[Traits] = component_traits(dataset=IMAGES, assumptions=STATIC_BACKGROUND)

    body: Body
    clip: FrameCache
    effective_pixels: float = 0.5
    outlier_fraction: float = 0.05
    n_frames: int = 60
    n_samples: int = 16

    def __post_init__(self) -> None:
        check("background", self, effective_pixels=POSITIVE, outlier_fraction=INSIDE_UNIT)
        check("background", self, n_frames=at_least(3), n_samples=at_least(1))

    @cached_property
    def samples(self) -> tuple[FloatArray, FloatArray]:
        """The points (n, 2) of every patch and those around it."""
        inside = regular_samples(self.n_samples, stream(0, "background samples"))
        return inside, contour_samples(inside)

    @cached_property
    def backgrounds(self) -> Mapping[str, StaticBackground]:
        """The static background of every camera of the sequence, by the camera's name."""
        return static_backgrounds(self.clip, self.n_frames, BLUR_PX)

    def prepare(self, previous: Frame | None, frame: Frame) -> LimbFrameLikelihood:
        """Return the likelihood of a frame; raises InputError for a camera that is not in the sequence."""
        inside, outside = self.samples
        ratios = [
            (view.camera, log_ratio(view, self.backgrounds, BLUR_PX, self.outlier_fraction)) for view in frame.views
        ]
        views = [
            LimbViewLikelihood(camera, inside, partial(self._log_prob, ratio), outside) for camera, ratio in ratios
        ]
        return LimbFrameLikelihood("background", self.body, views, lambda expected_pose: self)

    def _log_prob(self, ratio: Float32Array, inside: LimbPoints, outside: LimbPoints) -> FloatArray:
        return self.effective_pixels * (mean_at(ratio, inside) - mean_at(ratio, outside)).sum(axis=1)


def contour_samples(inside: FloatArray) -> FloatArray:
    """Return points (n, 2) around a patch from n points inside it: every third beyond its end, others to its sides."""
    (near, far), (first, last) = SIDE_OFFSETS, END_OFFSETS
    u, v = inside.T
    width = np.abs(v).max()
    sides = np.column_stack([u, np.sign(v) * (near + (far - near) * np.abs(v) / width)])
    end = np.column_stack([first + (last - first) * u, 0.75 * v])
    return np.where(np.arange(len(inside))[:, None] % 3 == 2, end, sides)
