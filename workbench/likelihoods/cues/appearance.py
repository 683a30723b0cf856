"""How the person looks, limb by limb, learned from the first frame and slowly renewed (paper A, section 8).

A's own likelihood compares with the frame before alone, so that small errors add up: it drifts. A template does not.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, ClassVar

import numba
import numpy as np

from workbench.body.kinematics import forward
from workbench.body.limbs import Body
from workbench.body.simd_kinematics import FAST
from workbench.core.capabilities import IMAGES, Traits, offering
from workbench.core.checks import INSIDE_UNIT, POSITIVE, UNIT, at_least, check
from workbench.core.frame import Frame
from workbench.likelihoods.base import Remembering
from workbench.likelihoods.cues import limb_points as limbs
from workbench.likelihoods.cues.image_levels import grey_levels
from workbench.likelihoods.cues.limb_points import LimbLook, LimbPoints, ViewJudge, bilinear
from workbench.likelihoods.image_motion import patch_samples
from workbench.utils.arrays import Float32Array, FloatArray, IntArray
from workbench.utils.kernel_cache import kernel
from workbench.utils.rng import stream

BLUR_PX = 2.0**0.5  # standard deviation of the smoothing
ALONG, AROUND = 10, 24  # cells of a limb's template: along it, and once around it
_PER_CELL = 3  # points looked at along a cell, and as many across, when the template learns


@dataclass(frozen=True, eq=False)
class Template:
    """The grey levels of L limbs' surfaces as one camera sees them, in cells (L, ALONG, AROUND). n: how many frames the
    mean stands for, 0 where a cell was never seen."""

    mean: FloatArray
    n: FloatArray


@dataclass(frozen=True, eq=False)
class _Templates:
    """All that was learned so far. by_camera: by the camera's name. notes: what went wrong when it last learned."""

    by_camera: Mapping[str, Template] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Appearance:
    """Every limb carries a template of its grey levels; a point shows its cell's level, or anything at all:

        log p = k/n Σ_j Σ_i log( ε + (1−ε) 256 N(I(x_j,i); T_j(x_j,i), σ² (1 + 1/n_T)) )

    x_j,i: n points of limb j's planar patch, on the limb, its section taken as round, at the azimuth of the patch's
    side less arccos v; cells go around the limb, so that each learns when its side is seen. The ratio is to a person of
    any grey level; points that are hidden, out of the image or in a cell not yet seen add nothing. n_T: how many frames
    the cell's mean T stands for. Each limb counts as k independent pixels.

    After every frame the template learns from the expected pose: T += g (I − T), g = w max(1/(n_T + 1), rate), w being
    the probability that the point is no outlier. A template learned from wrong poses is wrong for about 1/rate frames.

    sigma: σ, grey levels. epsilon: ε. rate: as above. n_samples: n. Raises InputError when a constant is out of range.
    """

    traits: ClassVar[Traits] = offering(dataset=IMAGES)

    body: Body
    effective_pixels: float = 1.0
    sigma: float = 12.0
    outlier_fraction: float = 0.1
    learning_rate: float = 0.1
    n_samples: int = 16

    def __post_init__(self) -> None:
        check(
            "appearance",
            self,
            effective_pixels=POSITIVE,
            sigma=POSITIVE,
            outlier_fraction=INSIDE_UNIT,
            learning_rate=UNIT,
        )
        check("appearance", self, n_samples=at_least(1))

    @cached_property
    def samples(self) -> FloatArray:
        """The points (n, 2) of every patch."""
        return patch_samples(self.n_samples, stream(0, "appearance samples"))

    @cached_property
    def learned_from(self) -> FloatArray:
        """The points (n, 2) of every patch that the template learns from, evenly spread over its cells."""
        u = (np.arange(ALONG * _PER_CELL) + 0.5) / (ALONG * _PER_CELL)
        angles = np.pi * (np.arange(AROUND // 2 * _PER_CELL) + 0.5) / (AROUND // 2 * _PER_CELL)
        v = -np.cos(angles)
        return limbs.patch_grid(u, v[np.abs(v) <= 0.9])  # nearer to the rim, the background shows

    def prepare(self, previous: Frame | None, frame: Frame) -> LimbLook:
        """Look at a frame, the person still unknown."""
        return self._look(_Templates(), previous, frame)

    def _look(self, known: _Templates, previous: Frame | None, frame: Frame) -> LimbLook:
        images = [grey_levels(view, BLUR_PX) for view in frame.views]
        informative, notes = [], known.notes
        for view, image in zip(frame.views, images, strict=True):
            template = known.by_camera.get(view.camera.name)
            if template is not None:
                informative.append(ViewJudge(view.camera, self.samples, partial(self._log_prob, image, template)))
            elif previous is not None:
                notes += (f"appearance: nothing is known yet of how {view.camera.name} sees the person",)
        learn = partial(self._learn, known, frame, images)
        return LimbLook("appearance", self.body, informative, learn, notes)

    def _log_prob(self, image: Float32Array, template: Template, points: LimbPoints) -> FloatArray:
        ratios = template_log_ratio(image, points, self.samples, template, self.sigma, self.outlier_fraction)
        return self.effective_pixels * ratios.sum(axis=1)

    def _learn(
        self, known: _Templates, frame: Frame, images: Sequence[Float32Array], pose: FloatArray
    ) -> Remembering[_Templates]:
        """Learn from a frame and its expected pose (P,); one that is not finite teaches nothing."""
        if not np.isfinite(pose).all():
            note = f"appearance: frame {frame.index} has no finite expected pose to learn from"
            return Remembering(replace(known, notes=(note,)), self._look)
        frames, by_camera = forward(self.body.skeleton, pose[None]), dict(known.by_camera)
        for view, image in zip(frame.views, images, strict=True):
            points = limbs.limb_points(self.body, self.learned_from, view.camera, frames)
            seen, before = _cell_levels(image, points, self.learned_from), by_camera.get(view.camera.name)
            by_camera[view.camera.name] = learned(before, seen, self.sigma, self.outlier_fraction, self.learning_rate)
        return Remembering(_Templates(by_camera), self._look)


def cells(samples: FloatArray, turns: FloatArray) -> tuple[IntArray, IntArray]:
    """The cells of points (n, 2) along the limbs (n,), and around limbs that are turned by (N, L): (N, L, n)."""
    along = np.clip((samples[:, 0] * ALONG).astype(np.int64), 0, ALONG - 1)
    azimuth = (turns[..., None] - np.arccos(np.clip(samples[:, 1], -1.0, 1.0))) / (2.0 * np.pi)
    around = ((azimuth - np.floor(azimuth)) * AROUND).astype(np.int64)
    return along, np.minimum(around, AROUND - 1)


def _cell_levels(image: Float32Array, points: LimbPoints, samples: FloatArray) -> FloatArray:
    """The mean grey level (L, ALONG, AROUND) that one pose's points show of every cell, NaN of those not seen."""
    along, around = cells(samples, points.turns)
    limb, i = np.nonzero(points.counts[0])
    levels = limbs.levels_at(image, points.pixels[0, limb, i])
    total, n = np.zeros((2, points.counts.shape[1], ALONG, AROUND))
    cell = limb, along[i], around[0, limb, i]
    np.add.at(total, cell, levels)
    np.add.at(n, cell, 1.0)
    return np.where(n > 0.0, total / np.maximum(n, 1.0), np.nan)


def learned(
    before: Template | None, seen: FloatArray, sigma: float, outlier_fraction: float, learning_rate: float
) -> Template:
    """The template after cells were seen at levels (L, ALONG, AROUND), NaN where they were not; see `Appearance`."""
    mean, n = (np.zeros_like(seen), np.zeros_like(seen)) if before is None else (before.mean, before.n)
    miss = np.where(np.isnan(seen), 0.0, seen - mean)
    variance = sigma**2 * (1.0 + 1.0 / np.maximum(n, 1.0))
    ratio = (1.0 - outlier_fraction) * 256.0 * np.exp(-0.5 * miss**2 / variance) / np.sqrt(2.0 * np.pi * variance)
    trust = np.where(np.isnan(seen), 0.0, np.where(n > 0.0, ratio / (ratio + outlier_fraction), 1.0))
    gain = trust * np.maximum(1.0 / (n + 1.0), learning_rate)
    return Template(mean + gain * miss, n + trust)


def template_log_ratio(
    image: Float32Array,
    points: LimbPoints,
    samples: FloatArray,
    template: Template,
    sigma: float,
    outlier_fraction: float,
) -> FloatArray:
    """log(ε + (1−ε) 256 N) at the points that count and whose cell is known, summed for each limb (N, L), over n."""
    variance = sigma**2 * (1.0 + 1.0 / np.maximum(template.n, 1.0))
    peak = np.where(template.n > 0.0, (1.0 - outlier_fraction) * 256.0 / np.sqrt(2.0 * np.pi * variance), 0.0)
    along = np.clip((samples[:, 0] * ALONG).astype(np.int64), 0, ALONG - 1)
    offsets = -np.arccos(np.clip(samples[:, 1], -1.0, 1.0))
    sums = np.empty(points.turns.shape)
    _template_sums(
        *(image, points.pixels, points.counts, points.turns, along, offsets),
        *(template.mean, peak, -0.5 / variance, outlier_fraction, sums),
    )
    return sums / len(samples)


@kernel(parallel=True, error_model="numpy", fastmath=FAST)
def _template_sums(
    image: Any, pixels: Any, counts: Any, turns: Any, along: Any, offsets: Any,
    mean: Any, peak: Any, slope: Any, outlier_fraction: float, sums: Any,
) -> None:  # fmt: skip
    n_around, turn = mean.shape[2], 2.0 * np.pi
    for i in numba.prange(counts.shape[0]):
        for limb in range(counts.shape[1]):
            total = 0.0
            for s in range(counts.shape[2]):
                if not counts[i, limb, s]:
                    continue
                azimuth = (turns[i, limb] + offsets[s]) / turn
                around = min(int((azimuth - np.floor(azimuth)) * n_around), n_around - 1)
                height = peak[limb, along[s], around]
                if height > 0.0:
                    miss = bilinear(image, pixels[i, limb, s, 0], pixels[i, limb, s, 1]) - mean[limb, along[s], around]
                    total += np.log(outlier_fraction + height * np.exp(slope[limb, along[s], around] * miss * miss))
            sums[i, limb] = total
