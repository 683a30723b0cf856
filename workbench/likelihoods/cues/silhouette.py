"""The whole person's outline before a still background: every pixel covered differs from it, every other does not."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import ClassVar

import cv2
import numpy as np

from workbench.body.kinematics import JointFrames, forward
from workbench.body.limbs import Body
from workbench.core.capabilities import IMAGES, Traits, offering
from workbench.core.checks import INSIDE_UNIT, POSITIVE, at_least, check
from workbench.core.frame import Frame, View
from workbench.core.frame_cache import FrameCache
from workbench.core.side_information import STATIC_BACKGROUND
from workbench.likelihoods.base import Remembering
from workbench.likelihoods.cues import image_levels
from workbench.likelihoods.cues.image_levels import StillScene, Uncovered, log_ratio
from workbench.likelihoods.cues.limb_points import LimbLook, LimbPoints, ViewJudge, limb_points
from workbench.likelihoods.cues.outlines import CORNERS, areas, covered, outline_sums, running_sums
from workbench.utils.arrays import Float32Array, FloatArray
from workbench.utils.errors import InputError

BESIDE_PX = 17
"""The outline of the first frame's pose may be off by half of this: start and body are not known exactly."""


@dataclass(frozen=True, eq=False)
class _SeenPerson:
    """What one camera saw of the person. area: of the outline, px². uncovered: the scene behind them."""

    area: float
    uncovered: Uncovered | None = None


@dataclass(frozen=True, eq=False)
class Silhouette:
    """Likelihood ratio of foreground to background over all pixels that the person covers, for still cameras:

        log p = k/A Σ_x∈S(φ) r(x)

    r: the pixel's log ratio, see `Background`. S(φ): the union of the limbs' outlines, planar patches as in paper A and
    discs of spheres, wider by rim_px on all sides, since pixels covered in part differ from the background too. Pixels
    of the person that a pose leaves out and those of the background that it covers cost alike, so that the person's
    size, and with it the depth, is found without bias. A: area of the outline of the pose expected one frame earlier,
    px². The whole person counts as k independent pixels.

    standing: the background behind the person is found from the first frame's pose instead of the median
    (`image_levels.uncovered_scene`), for people who stay where they are. Pixels that they never leave are the person as
    long as they look as they did (−r counts for r, where that is above zero); where nothing is known r is zero.

    epsilon, n_frames: of r, see `Background`; images are not smoothed.
    Raises InputError when a constant is out of range or a camera was not in the clip.
    """

    traits: ClassVar[Traits] = offering(dataset=IMAGES, given=STATIC_BACKGROUND)

    body: Body
    clip: FrameCache
    effective_pixels: float = 40.0
    outlier_fraction: float = 0.05
    n_frames: int = 60
    dilation_px: float = 0.4
    background_from_first_pose: bool = False

    def __post_init__(self) -> None:
        check(
            "silhouette",
            self,
            effective_pixels=POSITIVE,
            outlier_fraction=INSIDE_UNIT,
            n_frames=at_least(3),
            dilation_px=at_least(0),
        )

    @cached_property
    def scenes(self) -> Mapping[str, StillScene]:
        """The still scene of every camera of the clip, by the camera's name."""
        return image_levels.still_scenes(self.clip, self.n_frames, 0.0)

    def prepare(self, previous: Frame | None, frame: Frame) -> LimbLook:
        """Look at a frame, the person's size still unknown; raises InputError for a camera that was not in the clip."""
        return self._look({}, previous, frame)

    def _look(self, seen: Mapping[str, "_SeenPerson"], previous: Frame | None, frame: Frame) -> LimbLook:
        informative, notes = [], []
        for view in frame.views:
            known = seen.get(view.camera.name)
            ratio = self._ratio(known, view)
            if known is not None:
                judge = partial(self._log_prob, running_sums(ratio), known.area)
                informative.append(ViewJudge(view.camera, CORNERS, judge))
            elif previous is not None:
                name = view.camera.name
                notes.append(f"silhouette: how large {name} sees the person is not known; it says nothing yet")
        return LimbLook("silhouette", self.body, informative, partial(self._measure, seen, frame), tuple(notes))

    def _ratio(self, known: "_SeenPerson | None", view: View) -> Float32Array:
        if not self.background_from_first_pose:
            return log_ratio(view, self.scenes, 0.0, self.outlier_fraction)
        if known is None or known.uncovered is None:  # in the first frame, in which nothing is judged
            return np.zeros(view.image.shape[:2], dtype=np.float32)
        ratio = image_levels.scene_log_ratio(view, known.uncovered.scene, 0.0, self.outlier_fraction)
        ratio[known.uncovered.person] = np.maximum(-ratio[known.uncovered.person], 0.0)
        ratio[known.uncovered.unknown] = 0.0
        return ratio

    def _log_prob(self, reached: FloatArray, area: float, corners: LimbPoints) -> FloatArray:
        return self.effective_pixels / area * self._sums(reached, corners)

    def _measure(
        self, seen: Mapping[str, "_SeenPerson"], frame: Frame, pose: FloatArray
    ) -> Remembering[Mapping[str, "_SeenPerson"]]:
        """Measure the area of the expected pose (P,); one not finite, or out of the image, leaves it as it was."""
        measured = dict(seen)
        if np.isfinite(pose).all():
            frames = forward(self.body.skeleton, pose[None])
            for view in frame.views:
                corners = limb_points(self.body, CORNERS, view.camera, frames)
                (area,) = self._sums(areas(view.image.shape[0], view.image.shape[1]), corners)
                if area >= 1.0:
                    known = seen.get(view.camera.name)
                    uncovered = self._uncovered(view, frames) if known is None else known.uncovered
                    measured[view.camera.name] = _SeenPerson(float(area), uncovered)
        return Remembering(measured, self._look)

    def _uncovered(self, view: View, frames: JointFrames) -> Uncovered | None:
        """Find the scene behind a person who is first seen in this pose."""
        if not self.background_from_first_pose:
            return None
        corners = limb_points(self.body, CORNERS, view.camera, frames).pixels[0]
        inside = covered(corners, self.body.limbs.spheres, (view.image.shape[0], view.image.shape[1]))
        near = cv2.dilate(inside.astype(np.uint8), np.ones((BESIDE_PX, BESIDE_PX), np.uint8)).astype(np.bool_)
        images = image_levels.spaced_images(self.clip, self.n_frames, 0.0).get(view.camera.name)
        if images is None:
            raise InputError(f"likelihood: camera {view.camera.name} was not in the clip that it was learned from")
        return image_levels.uncovered_scene(images, inside, near)

    def _sums(self, reached: FloatArray, corners: LimbPoints) -> FloatArray:
        return outline_sums(reached, corners.pixels, self.body.limbs.spheres, self.dilation_px)
