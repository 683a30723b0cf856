"""Appearance of every limb: a template of grey levels, learned from the first frame and updated slowly (paper A,
section 8).

The likelihood of paper A compares with the previous frame only, so that its errors accumulate (drift). A template does
not drift.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np

from workbench.body.kinematics import forward
from workbench.body.limbs import Body
from workbench.body.simd_kinematics import FAST
from workbench.core.capabilities import IMAGES, Traits, component_traits
from workbench.core.checks import INSIDE_UNIT, POSITIVE, UNIT, at_least, check
from workbench.core.frame import Frame
from workbench.likelihoods.base import AdaptiveLikelihood
from workbench.likelihoods.cues import limb_points as limbs
from workbench.likelihoods.cues.image_levels import grey_levels
from workbench.likelihoods.cues.limb_points import (
    PARTICLES,
    LimbFrameLikelihood,
    LimbPoints,
    LimbViewLikelihood,
    bilinear,
)
from workbench.likelihoods.image_motion import regular_samples
from workbench.utils.arrays import Float32Array, FloatArray, IntArray
from workbench.utils.kernel_cache import kernel
from workbench.utils.parallel import parallel_for
from workbench.utils.rng import stream

BLUR_PX = 2.0**0.5  # standard deviation of the smoothing
ALONG, AROUND = 10, 24  # cells of a limb's template: along the limb and around it
_PER_CELL = 3  # points sampled along a cell, and as many across it, for an update


@dataclass(frozen=True, eq=False)
class Template:
    """Grey levels of L limbs' surfaces in one camera, in cells (L, ALONG, AROUND). mean: of the level. n: effective
    number of frames of the mean, 0 for a cell never observed."""

    mean: FloatArray
    n: FloatArray


@dataclass(frozen=True, eq=False)
class _Templates:
    """The templates learned so far, by camera name. notes: problems of the last update."""

    by_camera: Mapping[str, Template] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Appearance:
    """Every limb has a template of grey levels; a point shows its cell's level, or is an outlier of any level:

        log p = k/n Σ_j Σ_i log( ε + (1−ε) 256 N(I(x_j,i); T_j(x_j,i), σ² (1 + 1/n_T)) )

    x_j,i: n points of limb j's planar patch, mapped to the limb's surface: with a circular section, the azimuth is that
    of the patch's side minus arccos v. Cells go around the limb, so that each is learned when its side is visible. The
    ratio is to a person of uniformly distributed grey level; points that are hidden, outside the image or in a cell not
    yet observed contribute 0. n_T: effective number of frames of the cell's mean T. Each limb counts as k independent
    pixels.

    After every frame the template is updated at the expected pose: T += g (I − T), g = w max(1/(n_T + 1),
    learning_rate), with w the probability that the point is an inlier. Wrong poses corrupt the template for about
    1/learning_rate frames. Raises InputError if a parameter is out of range.

    Parameters
    ----------
    body : the person's body.
    effective_pixels : k, per limb.
    sigma : σ, grey levels.
    outlier_fraction : ε.
    learning_rate : minimum gain g of an inlier.
    n_samples : n.
    """

    traits: ClassVar[Traits] = component_traits(dataset=IMAGES)

    body: Body
    effective_pixels: float = 1.0
    sigma: float = 12.0
    outlier_fraction: float = 0.1
    learning_rate: float = 0.1
    n_samples: int = 16

    def __post_init__(self) -> None:
        check("appearance", self, effective_pixels=POSITIVE, sigma=POSITIVE, outlier_fraction=INSIDE_UNIT)
        check("appearance", self, learning_rate=UNIT, n_samples=at_least(1))

    @cached_property
    def samples(self) -> FloatArray:
        """The points (n, 2) of every patch."""
        return regular_samples(self.n_samples, stream(0, "appearance samples"))

    @cached_property
    def training_points(self) -> FloatArray:
        """The points (n, 2) of every patch that update the template, evenly spaced over its cells."""
        u = (np.arange(ALONG * _PER_CELL) + 0.5) / (ALONG * _PER_CELL)
        angles = np.pi * (np.arange(AROUND // 2 * _PER_CELL) + 0.5) / (AROUND // 2 * _PER_CELL)
        v = -np.cos(angles)
        return limbs.patch_grid(u, v[np.abs(v) <= 0.9])  # closer to the contour, the background is visible

    def prepare(self, previous: Frame | None, frame: Frame) -> LimbFrameLikelihood:
        """Return the likelihood of a frame without any template."""
        return self._prepare(_Templates(), previous, frame)

    def _prepare(self, templates: _Templates, previous: Frame | None, frame: Frame) -> LimbFrameLikelihood:
        images = [grey_levels(view, BLUR_PX) for view in frame.views]
        views, notes = [], templates.notes
        for view, image in zip(frame.views, images, strict=True):
            template = templates.by_camera.get(view.camera.name)
            if template is not None:
                views.append(LimbViewLikelihood(view.camera, self.samples, partial(self._log_prob, image, template)))
            elif previous is not None:
                notes += (f"appearance: no template in camera {view.camera.name} yet; the camera is ignored",)
        update = partial(self._update, templates, frame, images)
        return LimbFrameLikelihood("appearance", self.body, views, update, notes)

    def _log_prob(self, image: Float32Array, template: Template, points: LimbPoints) -> FloatArray:
        ratios = template_log_ratio(image, points, self.samples, template, self.sigma, self.outlier_fraction)
        return self.effective_pixels * ratios.sum(axis=1)

    def _update(
        self, templates: _Templates, frame: Frame, images: Sequence[Float32Array], pose: FloatArray
    ) -> AdaptiveLikelihood[_Templates]:
        """Return the likelihood with templates updated at the expected pose (P,), unless that is not finite."""
        if not np.isfinite(pose).all():
            note = f"appearance: frame {frame.index} has no finite expected pose; the template is not updated"
            return AdaptiveLikelihood(replace(templates, notes=(note,)), self._prepare)
        frames, by_camera = forward(self.body.skeleton, pose[None]), dict(templates.by_camera)
        for view, image in zip(frame.views, images, strict=True):
            points = limbs.limb_points(self.body, self.training_points, view.camera, frames)
            levels, template = _cell_levels(image, points, self.training_points), by_camera.get(view.camera.name)
            parameters = self.sigma, self.outlier_fraction, self.learning_rate
            by_camera[view.camera.name] = updated_template(template, levels, *parameters)
        return AdaptiveLikelihood(_Templates(by_camera), self._prepare)


def cell_indices(samples: FloatArray, azimuths: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the template's cells of points (n, 2): along the limbs (n,), and around limbs of azimuths (N, L), (N, L,
    n)."""
    along = np.clip((samples[:, 0] * ALONG).astype(np.int64), 0, ALONG - 1)
    azimuth = (azimuths[..., None] - np.arccos(np.clip(samples[:, 1], -1.0, 1.0))) / (2.0 * np.pi)
    around = ((azimuth - np.floor(azimuth)) * AROUND).astype(np.int64)
    return along, np.minimum(around, AROUND - 1)


def _cell_levels(image: Float32Array, points: LimbPoints, samples: FloatArray) -> FloatArray:
    """Return the mean grey level (L, ALONG, AROUND) of each cell in one pose, NaN for cells without a visible point."""
    along, around = cell_indices(samples, points.azimuths)
    limb, i = np.nonzero(points.valid[0])
    levels = limbs.levels_at(image, points.pixels[0, limb, i])
    total, n = np.zeros((2, points.valid.shape[1], ALONG, AROUND))
    cell = limb, along[i], around[0, limb, i]
    np.add.at(total, cell, levels)
    np.add.at(n, cell, 1.0)
    return np.where(n > 0.0, total / np.maximum(n, 1.0), np.nan)


def updated_template(
    template: Template | None, levels: FloatArray, sigma: float, outlier_fraction: float, learning_rate: float
) -> Template:
    """Return the template updated with cells' grey levels (L, ALONG, AROUND), NaN where invisible; see `Appearance`."""
    mean, n = (np.zeros_like(levels), np.zeros_like(levels)) if template is None else (template.mean, template.n)
    residual = np.where(np.isnan(levels), 0.0, levels - mean)
    variance = sigma**2 * (1.0 + 1.0 / np.maximum(n, 1.0))
    ratio = (1.0 - outlier_fraction) * 256.0 * np.exp(-0.5 * residual**2 / variance) / np.sqrt(2.0 * np.pi * variance)
    inlier_probability = np.where(np.isnan(levels), 0.0, np.where(n > 0.0, ratio / (ratio + outlier_fraction), 1.0))
    gain = inlier_probability * np.maximum(1.0 / (n + 1.0), learning_rate)
    return Template(mean + gain * residual, n + inlier_probability)


def template_log_ratio(
    image: Float32Array, points: LimbPoints, samples: FloatArray, template: Template, sigma: float,
    outlier_fraction: float,
) -> FloatArray:  # fmt: skip
    """Return log(ε + (1−ε) 256 N) at the valid points in observed cells, summed for each limb (N, L), over n."""
    variance = sigma**2 * (1.0 + 1.0 / np.maximum(template.n, 1.0))
    peak = np.where(template.n > 0.0, (1.0 - outlier_fraction) * 256.0 / np.sqrt(2.0 * np.pi * variance), 0.0)
    along = np.clip((samples[:, 0] * ALONG).astype(np.int64), 0, ALONG - 1)
    offsets = -np.arccos(np.clip(samples[:, 1], -1.0, 1.0))
    sums = np.empty(points.azimuths.shape)
    arguments = (
        *(image, points.pixels, points.valid, points.azimuths, along, offsets),
        *(template.mean, peak, -0.5 / variance, outlier_fraction, sums),
    )
    parallel_for(lambda first, last: _template_sums(first, last, *arguments), len(sums), PARTICLES)
    return sums / len(samples)


@kernel(error_model="numpy", fastmath=FAST)
def _template_sums(
    first: int, last: int, image: Any, pixels: Any, valid: Any, azimuths: Any, along: Any, offsets: Any,
    mean: Any, peak: Any, exponent_scale: Any, outlier_fraction: float, sums: Any,
) -> None:  # fmt: skip
    n_around, full_turn = mean.shape[2], 2.0 * np.pi
    for i in range(first, last):
        for limb in range(valid.shape[1]):
            total = 0.0
            for s in range(valid.shape[2]):
                if not valid[i, limb, s]:
                    continue
                azimuth = (azimuths[i, limb] + offsets[s]) / full_turn
                around = min(int((azimuth - np.floor(azimuth)) * n_around), n_around - 1)
                density = peak[limb, along[s], around]
                if density > 0.0:
                    level = bilinear(image, pixels[i, limb, s, 0], pixels[i, limb, s, 1])
                    residual, factor = level - mean[limb, along[s], around], exponent_scale[limb, along[s], around]
                    total += np.log(outlier_fraction + density * np.exp(factor * residual * residual))
            sums[i, limb] = total
