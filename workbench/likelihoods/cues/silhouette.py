"""Silhouette of the whole person: pixels inside the outline differ from a static background, all others do not."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import ClassVar

import numpy as np

from workbench.body.kinematics import forward
from workbench.body.limbs import Body
from workbench.core.capabilities import IMAGES, Traits, component_traits
from workbench.core.checks import INSIDE_UNIT, POSITIVE, at_least, check
from workbench.core.frame import Frame
from workbench.core.frame_cache import FrameCache
from workbench.core.side_information import STATIC_BACKGROUND
from workbench.likelihoods.base import AdaptiveLikelihood
from workbench.likelihoods.cues.image_levels import StaticBackground, log_ratio, static_backgrounds
from workbench.likelihoods.cues.limb_points import LimbFrameLikelihood, LimbPoints, LimbViewLikelihood, limb_points
from workbench.likelihoods.cues.outlines import CORNERS, areas, outline_sums, running_sums
from workbench.utils.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Silhouette:
    """Likelihood ratio of foreground to background over all pixels that the person covers, for static cameras:

        log p = k/A Σ_x∈S(φ) r(x)

    r: the pixel's log ratio, see `Background`; images are not smoothed. S(φ): the union of the limbs' outlines, planar
    patches as in paper A and discs of spheres, dilated by dilation_px, because partly covered pixels differ from the
    background too. Missed pixels of the person and covered pixels of the background have equal cost, so that the
    person's size, and hence the depth, is unbiased. A: area of the outline of the previous frame's expected pose, px².
    The whole person counts as k independent pixels. Raises InputError if a parameter is out of range, or a camera is
    not in the sequence.

    Parameters
    ----------
    body, clip : the person's body and the sequence.
    effective_pixels : k.
    outlier_fraction, n_frames : of r, see `Background`.
    dilation_px : as above.
    """

    traits: ClassVar[Traits] = component_traits(dataset=IMAGES, assumptions=STATIC_BACKGROUND)

    body: Body
    clip: FrameCache
    effective_pixels: float = 40.0
    outlier_fraction: float = 0.05
    n_frames: int = 60
    dilation_px: float = 0.4

    def __post_init__(self) -> None:
        check(
            "silhouette", self, effective_pixels=POSITIVE, outlier_fraction=INSIDE_UNIT, n_frames=at_least(3),
            dilation_px=at_least(0),
        )  # fmt: skip

    @cached_property
    def backgrounds(self) -> Mapping[str, StaticBackground]:
        """The static background of every camera of the sequence, by the camera's name."""
        return static_backgrounds(self.clip, self.n_frames, 0.0)

    def prepare(self, previous: Frame | None, frame: Frame) -> LimbFrameLikelihood:
        """Return the likelihood of a frame without a measured area; raises InputError for an unknown camera."""
        return self._prepare({}, previous, frame)

    def _prepare(self, person_px2: Mapping[str, float], previous: Frame | None, frame: Frame) -> LimbFrameLikelihood:
        views, notes = [], []
        for view in frame.views:
            ratio = log_ratio(view, self.backgrounds, 0.0, self.outlier_fraction)
            area = person_px2.get(view.camera.name)
            if area is not None:
                log_prob = partial(self._log_prob, running_sums(ratio), area)
                views.append(LimbViewLikelihood(view.camera, CORNERS, log_prob))
            elif previous is not None:
                name = view.camera.name
                notes.append(f"silhouette: the person's area in camera {name} is not known yet; the camera is ignored")
        return LimbFrameLikelihood(
            "silhouette", self.body, views, partial(self._measure, person_px2, frame), tuple(notes)
        )

    def _log_prob(self, row_sums: FloatArray, area: float, corners: LimbPoints) -> FloatArray:
        return self.effective_pixels / area * self._sums(row_sums, corners)

    def _measure(
        self, person_px2: Mapping[str, float], frame: Frame, pose: FloatArray
    ) -> AdaptiveLikelihood[Mapping[str, float]]:
        """Return the likelihood with the area at the expected pose (P,), unless not finite or outside the image."""
        updated = dict(person_px2)
        if np.isfinite(pose).all():
            frames = forward(self.body.skeleton, pose[None])
            for view in frame.views:
                corners = limb_points(self.body, CORNERS, view.camera, frames)
                (area,) = self._sums(areas(view.image.shape[0], view.image.shape[1]), corners)
                if area >= 1.0:
                    updated[view.camera.name] = float(area)
        return AdaptiveLikelihood(updated, self._prepare)

    def _sums(self, row_sums: FloatArray, corners: LimbPoints) -> FloatArray:
        return outline_sums(row_sums, corners.pixels, self.body.limbs.spheres, self.dilation_px)
