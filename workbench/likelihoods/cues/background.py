"""A limb covers pixels that differ from the background of a still camera; beside it lie pixels that do not."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import ClassVar

import numpy as np

from workbench.body.limbs import Body
from workbench.core.capabilities import IMAGES, Traits, offering
from workbench.core.checks import INSIDE_UNIT, POSITIVE, at_least, check
from workbench.core.frame import Frame
from workbench.core.frame_cache import FrameCache
from workbench.core.side_information import STATIC_BACKGROUND
from workbench.likelihoods.cues.image_levels import StillScene, log_ratio, still_scenes
from workbench.likelihoods.cues.limb_points import LimbLook, LimbPoints, ViewJudge, mean_at
from workbench.likelihoods.image_motion import patch_samples
from workbench.utils.arrays import Float32Array, FloatArray
from workbench.utils.rng import stream

BLUR_PX = 0.7  # standard deviation of the smoothing
BESIDE, BEYOND = (1.15, 1.6), (1.25, 1.5)
"""Places of the points about a limb: in half widths from its axis, and beyond its end in lengths; off its outline."""


@dataclass(frozen=True, eq=False)
class Background:
    """Likelihood ratio of foreground to background at the pixels in and about the limbs, for cameras that stand still.

    The background of a pixel is Gaussian about its median over the clip with a robust deviation, or an outlier; the
    person can have any level:

        r(x) = −log( ε + (1−ε) Π_c [256 N(I_c(x); median_c(x), σ_c(x)²)]^(1/C) )
        log p = k/n Σ_j ( Σ_i r(x_j,i) − Σ_i r(y_j,i) )

    C: 1 for grey images, 3 for colour, whose channels err together and count as one. x_j,i: n points of limb j, of
    which those that are hidden or out of the image add nothing. y_j,i: as many beside the limb and beyond its end, of
    which those that some limb covers add nothing; they centre a limb on the person's. Each limb counts as k independent
    pixels. The clip is read once; a person who stays in one place for more than half of it becomes part of the
    background.

    n_frames: as many of the clip's frames, evenly spread, are used. epsilon: ε. n_samples: n.
    Raises InputError when a constant is out of range or a camera was not in the clip.
    """

    traits: ClassVar[Traits] = offering(dataset=IMAGES, given=STATIC_BACKGROUND)

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
        """The points (n, 2) of every patch and those about it."""
        inside = patch_samples(self.n_samples, stream(0, "background samples"))
        return inside, points_about(inside)

    @cached_property
    def scenes(self) -> Mapping[str, StillScene]:
        """The still scene of every camera of the clip, by the camera's name."""
        return still_scenes(self.clip, self.n_frames, BLUR_PX)

    def prepare(self, previous: Frame | None, frame: Frame) -> LimbLook:
        """Tell foreground from background in every view; raises InputError for a camera that was not in the clip."""
        inside, beside = self.samples
        ratios = [(view.camera, log_ratio(view, self.scenes, BLUR_PX, self.outlier_fraction)) for view in frame.views]
        informative = [ViewJudge(camera, inside, partial(self._log_prob, ratio), beside) for camera, ratio in ratios]
        return LimbLook("background", self.body, informative, lambda expected_pose: self)

    def _log_prob(self, ratio: Float32Array, inside: LimbPoints, beside: LimbPoints) -> FloatArray:
        return self.effective_pixels * (mean_at(ratio, inside) - mean_at(ratio, beside)).sum(axis=1)


def points_about(inside: FloatArray) -> FloatArray:
    """Points (n, 2) about a patch, made of as many within it: every third goes beyond its end, others to its sides."""
    (near, far), (first, last) = BESIDE, BEYOND
    u, v = inside.T
    width = np.abs(v).max()
    sides = np.column_stack([u, np.sign(v) * (near + (far - near) * np.abs(v) / width)])
    end = np.column_stack([first + (last - first) * u, 0.75 * v])
    return np.where(np.arange(len(inside))[:, None] % 3 == 2, end, sides)
