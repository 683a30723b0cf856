"""What one camera knows of scene and person, and how it learns from one frame to the next."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.likelihoods.dense.background_model import Scene, grown
from workbench.likelihoods.dense.occluders import Passing, nothing_passing
from workbench.likelihoods.dense.pyramid import Picture
from workbench.likelihoods.dense.view_likelihood import TEXTURE_BEND
from workbench.utils.arrays import BoolArray, Float32Array, FloatArray, IntArray

_HIDE_PX = 5
"""By half of this, what passes hides more than its pixels."""


@dataclass(frozen=True, eq=False)
class Seen:
    """What one camera knows. person: (height, width), covered by the pose expected last. texture: (K, S) grey levels of
    the body's cells at every smoothing; n: (S,) how many frames they stand for, 0 where a cell was never seen."""

    scene: Scene
    passing: Passing
    person: BoolArray
    texture: FloatArray
    n: FloatArray

    @property
    def hidden(self) -> BoolArray:
        """Where something passes before the person, (height, width)."""
        return grown(self.passing.mask, _HIDE_PX)

    def followed(self, image: Float32Array, ratio: Float32Array) -> "Seen":
        """Find what passes in an image, given the log ratio of anybody to the scene, before the person is found."""
        return replace(self, passing=self.passing.followed(image, ratio > 0.0, self.person, ~self.scene.known))

    def with_person(self, image: Float32Array, person: BoolArray) -> "Seen":
        """Learn the scene of an image, in which the person covers some pixels."""
        return replace(self, scene=self.scene.seen(image, person | self.hidden), person=person)

    def with_texture(
        self, levels: Sequence[Picture], cells: IntArray, pixels: FloatArray, sigma: float, rate: float
    ) -> "Seen":
        """Learn how cells (K,) look at pixels (K, 2) of an image at all smoothings: T += g (I − T), see
        `DenseAlignment`."""
        found = np.stack([level.at(pixels)[0] for level in levels])
        texture, n = self.texture.copy(), self.n.copy()
        misses = (found[-1] - texture[-1, cells]) / (TEXTURE_BEND * sigma)
        trust = np.where(n[cells] > 0.0, 1.0 / (1.0 + misses**2) ** 2, 1.0)
        texture[:, cells] += trust * np.maximum(1.0 / (n[cells] + 1.0), rate) * (found - texture[:, cells])
        n[cells] += trust
        return replace(self, texture=texture, n=n)


def newly_seen(scene: Scene, image: Float32Array, person: BoolArray, n_levels: int, n_cells: int) -> Seen:
    """Know a scene and where the person is in an image, but not yet how they look."""
    return Seen(scene, nothing_passing(image), person, np.zeros((n_levels, n_cells)), np.zeros(n_cells))
