"""Silhouette of the whole person: pixels inside the outline differ from a static background, all others do not."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import ClassVar

import cv2
import numpy as np

from workbench.body.kinematics import JointFrames, forward
from workbench.body.limbs import Body
from workbench.core.capabilities import IMAGES, Traits, component_traits
from workbench.core.checks import INSIDE_UNIT, POSITIVE, at_least, check
from workbench.core.frame import Frame, View
from workbench.core.frame_cache import FrameCache
from workbench.core.side_information import STATIC_BACKGROUND
from workbench.likelihoods.base import AdaptiveLikelihood
from workbench.likelihoods.cues import image_levels
from workbench.likelihoods.cues.image_levels import StaticBackground, UncoveredBackground, log_ratio
from workbench.likelihoods.cues.limb_points import LimbFrameLikelihood, LimbPoints, LimbViewLikelihood, limb_points
from workbench.likelihoods.cues.outlines import CORNERS, areas, outline_mask, outline_sums, running_sums
from workbench.utils.arrays import Float32Array, FloatArray
from workbench.utils.errors import InputError

START_DILATION_PX = 17
"""Width of the dilation of the first pose's outline, whose error is at most half of it."""


@dataclass(frozen=True, eq=False)
class _PersonMeasurement:
    """The person in one camera. area: of the outline, px². uncovered: the background behind the person, see
    `Silhouette`."""

    area: float
    uncovered: UncoveredBackground | None = None


@dataclass(frozen=True, eq=False)
class Silhouette:
    """Likelihood ratio of foreground to background over all pixels that the person covers, for static cameras:

        log p = k/A Σ_x∈S(φ) r(x)

    r: the pixel's log ratio, see `Background`; images are not smoothed. S(φ): the union of the limbs' outlines, planar
    patches as in paper A and discs of spheres, dilated by dilation_px, because partly covered pixels differ from the
    background too. Missed pixels of the person and covered pixels of the background have equal cost, so that the
    person's size, and hence the depth, is unbiased. A: area of the outline of the previous frame's expected pose, px².
    The whole person counts as k independent pixels.

    With background_from_first_pose, the background behind the person is that of `image_levels.uncovered_background`
    instead of the median, for people who stay in place. Pixels that they never leave are the person as long as their
    levels do not change: r is replaced by max(−r, 0). Where the background is unknown, r is 0. Raises InputError if a
    parameter is out of range, or a camera is not in the sequence.

    Parameters
    ----------
    body, clip : the person's body and the sequence.
    effective_pixels : k.
    outlier_fraction, n_frames : of r, see `Background`.
    dilation_px, background_from_first_pose : as above.
    """

    traits: ClassVar[Traits] = component_traits(dataset=IMAGES, assumptions=STATIC_BACKGROUND)

    body: Body
    clip: FrameCache
    effective_pixels: float = 40.0
    outlier_fraction: float = 0.05
    n_frames: int = 60
    dilation_px: float = 0.4
    background_from_first_pose: bool = False

    def __post_init__(self) -> None:
        check(
            "silhouette", self, effective_pixels=POSITIVE, outlier_fraction=INSIDE_UNIT, n_frames=at_least(3),
            dilation_px=at_least(0),
        )  # fmt: skip

    @cached_property
    def backgrounds(self) -> Mapping[str, StaticBackground]:
        """The static background of every camera of the sequence, by the camera's name."""
        return image_levels.static_backgrounds(self.clip, self.n_frames, 0.0)

    def prepare(self, previous: Frame | None, frame: Frame) -> LimbFrameLikelihood:
        """Return the likelihood of a frame without a measured area; raises InputError for an unknown camera."""
        return self._prepare({}, previous, frame)

    def _prepare(
        self, measurements: Mapping[str, "_PersonMeasurement"], previous: Frame | None, frame: Frame
    ) -> LimbFrameLikelihood:
        views, notes = [], []
        for view in frame.views:
            measured = measurements.get(view.camera.name)
            ratio = self._ratio(measured, view)
            if measured is not None:
                log_prob = partial(self._log_prob, running_sums(ratio), measured.area)
                views.append(LimbViewLikelihood(view.camera, CORNERS, log_prob))
            elif previous is not None:
                name = view.camera.name
                notes.append(f"silhouette: the person's area in camera {name} is not known yet; the camera is ignored")
        return LimbFrameLikelihood(
            "silhouette", self.body, views, partial(self._measure, measurements, frame), tuple(notes)
        )

    def _ratio(self, measured: "_PersonMeasurement | None", view: View) -> Float32Array:
        if not self.background_from_first_pose:
            return log_ratio(view, self.backgrounds, 0.0, self.outlier_fraction)
        if measured is None or measured.uncovered is None:  # in the first frame, which is not evaluated
            return np.zeros(view.image.shape[:2], dtype=np.float32)
        ratio = image_levels.background_log_ratio(view, measured.uncovered.background, 0.0, self.outlier_fraction)
        ratio[measured.uncovered.person] = np.maximum(-ratio[measured.uncovered.person], 0.0)
        ratio[measured.uncovered.unknown] = 0.0
        return ratio

    def _log_prob(self, row_sums: FloatArray, area: float, corners: LimbPoints) -> FloatArray:
        return self.effective_pixels / area * self._sums(row_sums, corners)

    def _measure(
        self, measurements: Mapping[str, "_PersonMeasurement"], frame: Frame, pose: FloatArray
    ) -> AdaptiveLikelihood[Mapping[str, "_PersonMeasurement"]]:
        """Return the likelihood with the area at the expected pose (P,), unless not finite or outside the image."""
        updated = dict(measurements)
        if np.isfinite(pose).all():
            frames = forward(self.body.skeleton, pose[None])
            for view in frame.views:
                corners = limb_points(self.body, CORNERS, view.camera, frames)
                (area,) = self._sums(areas(view.image.shape[0], view.image.shape[1]), corners)
                if area >= 1.0:
                    measured = measurements.get(view.camera.name)
                    uncovered = self._uncovered(view, frames) if measured is None else measured.uncovered
                    updated[view.camera.name] = _PersonMeasurement(float(area), uncovered)
        return AdaptiveLikelihood(updated, self._prepare)

    def _uncovered(self, view: View, frames: JointFrames) -> UncoveredBackground | None:
        """Return the background behind a person whose first pose is given by its joints' frames."""
        if not self.background_from_first_pose:
            return None
        corners = limb_points(self.body, CORNERS, view.camera, frames).pixels[0]
        inside = outline_mask(corners, self.body.limbs.spheres, (view.image.shape[0], view.image.shape[1]))
        near = cv2.dilate(inside.astype(np.uint8), np.ones((START_DILATION_PX, START_DILATION_PX), np.uint8)).astype(
            np.bool_
        )
        images = image_levels.spaced_images(self.clip, self.n_frames, 0.0).get(view.camera.name)
        if images is None:
            raise InputError(f"likelihood: camera {view.camera.name} is not in the sequence, so has no background")
        return image_levels.uncovered_background(images, inside, near)

    def _sums(self, row_sums: FloatArray, corners: LimbPoints) -> FloatArray:
        return outline_sums(row_sums, corners.pixels, self.body.limbs.spheres, self.dilation_px)
