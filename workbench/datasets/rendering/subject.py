"""Rendered subjects: persons whose proportions, limb profiles and clothes differ from the tracker's body.

The subject has the joints, the angles and about the height of the tracker's body, but other bone lengths and limb
radii, drawn by seed; limbs of varying radius, built of short cones; a neck and feet; and clothes that slide and swing
by a few millimetres. `sequence.Scene.perturbation_sizes` has the sizes; where all are zero the subject is bitwise the
tracker's own body.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from workbench.body.limbs import Body, Limbs, person, with_neck_and_feet
from workbench.body.shape import Shape
from workbench.body.skeleton import JOINT_NAMES, without_side
from workbench.datasets.rendering.render import VOXEL_M, RenderedScene
from workbench.motion.synthetic.gait import ANKLE_HEIGHT
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.rng import stream

_Profile = tuple[tuple[float, ...], ...]
"""Profile of a limb: (fraction of its length, factor of both semi-axes, or of the one fore and aft and the lateral)."""
_PROFILES: Mapping[str, _Profile] = MappingProxyType(
    {
        "torso": ((0.0, 1.05, 0.98), (0.25, 1.0, 0.92), (0.5, 0.98, 0.93), (0.78, 1.1, 1.02), (1.0, 0.85, 0.72)),
        "upper_arm": ((0.0, 1.0), (0.4, 1.08), (1.0, 0.95)),
        "forearm": ((0.0, 0.95), (0.3, 1.1), (1.0, 0.97)),
        "thigh": ((0.0, 1.01), (0.3, 1.05), (0.7, 1.0), (1.0, 0.97)),
        "calf": ((0.0, 0.95), (0.3, 1.12), (0.6, 1.05), (1.0, 0.95)),
    }
)
"""By limb name without the side; measured in adult silhouettes, as the radii of `shape.from_height`."""
_OTHER_PROFILE: _Profile = ((0.0, 0.95), (0.35, 1.06), (0.7, 1.03), (1.0, 0.95))
_BARE = ("head", "hand", "neck", "foot", "toe")
"""Parts of the names of limbs without clothes."""
_MIN_RADIUS_M = 0.01
_WAVES, _SLIDES = 3, 2


@dataclass(frozen=True, eq=False)
class _Clothes:
    """Motion of L limbs' clothes: sums of W sine waves along the limb and over time, of unit variance.

    Parameters
    ----------
    swing : (L, W) frequencies of the radius, Hz.
    along : (L, W) waves per limb length.
    phase : (L, W) rad.
    slide, slide_phase : (L, 3, V) frequencies, Hz, and phases, rad, of the texture along the limb's axes.
    size_m : (L,) standard deviation of both.
    """

    swing: FloatArray
    along: FloatArray
    phase: FloatArray
    slide: FloatArray
    slide_phase: FloatArray
    size_m: FloatArray

    def swung(self, limb: IntArray, place: FloatArray, time_s: float) -> FloatArray:
        """Return the increase of the mean radius, (K,) m, at fractions `place` (K,) of the length of limbs (K,)."""
        angle = self.swing[limb] * time_s + self.along[limb] * place[:, None]
        waves = np.sin(2.0 * np.pi * angle + self.phase[limb]).sum(axis=1)
        return self.size_m[limb] * np.sqrt(2.0 / _WAVES) * waves

    def slid(self, time_s: float) -> FloatArray:
        """Return the displacement of the texture (L, 3), m."""
        waves = np.sin(2.0 * np.pi * self.slide * time_s + self.slide_phase).sum(axis=2)
        return self.size_m[:, None] * np.sqrt(2.0 / _SLIDES) * waves


@dataclass(frozen=True, eq=False)
class SceneSubject:
    """A rendered person.

    Parameters
    ----------
    body : skeleton and limbs.
    segments : K short limbs that make up the body's limbs.
    whole : (K,) index of the body's limb that contains a segment.
    ends : (K, 2) start and end of a segment, as fractions of its limb's length.
    clothes : None for static ones.
    factors : drawn values by name, for the recording.
    """

    body: Body
    segments: Limbs
    whole: IntArray
    ends: FloatArray
    clothes: _Clothes | None
    factors: Mapping[str, FloatArray]

    def at(self, time_s: float) -> Body:
        """Return the body with the limbs visible at a time, s."""
        if self.clothes is None:
            return replace(self.body, limbs=self.segments) if len(self.segments) != len(self.body.limbs) else self.body
        swung = np.stack([self.clothes.swung(self.whole, self.ends[:, k], time_s) for k in range(2)], axis=1)
        mean_radii = self.segments.radii.mean(axis=2)
        factor = np.maximum(mean_radii + swung, np.minimum(mean_radii, _MIN_RADIUS_M)) / mean_radii
        return replace(self.body, limbs=replace(self.segments, radii=factor[:, :, None] * self.segments.radii))

    def scene_at(self, scene: RenderedScene, time_s: float) -> RenderedScene:
        """Return a scene at a time, s, with segments instead of the body and texture of whole limbs."""
        shift = np.zeros((len(self.segments), 3)) if self.clothes is None else self.clothes.slid(time_s)[self.whole]
        # the texture is continuous across segments
        shift[:, 2] += self.body.limbs.lengths[self.whole] * self.ends[:, 0]
        offsets, grey = scene.texture.offsets[self.whole] + shift / VOXEL_M, scene.texture.grey[self.whole]
        return replace(scene, body=self.at(time_s), texture=replace(scene.texture, offsets=offsets, grey=grey))


def draw_subject(body: Body, sizes: Mapping[str, float], seed: int) -> SceneSubject:
    """Draw the rendered subject for a tracker's `body`; sizes: see `sequence.Scene.perturbation_sizes`.

    Every perturbation has its own random stream, so that one does not change with the size of another.
    """
    lengths, radii, profile, clothes = (sizes[name] for name in ("lengths", "radii", "profile", "clothes_m"))
    streams = [stream(seed, f"subject: {name}") for name in ("lengths", "radii", "clothes")]
    factors: dict[str, FloatArray] = {}
    if lengths > 0.0:
        body, factors = _perturbed_bones(body, lengths, streams[0])
    if radii > 0.0:
        body, radius_factors = _perturbed_radii(body, radii, streams[1])
        factors |= radius_factors
    factors |= {name: np.array([size]) for name, size in (("profile", profile), ("clothes_m", clothes)) if size > 0.0}
    if profile > 0.0:
        body = _with_neck_and_feet(body)
    n = len(body.limbs)
    limbs, whole, ends = body.limbs, np.arange(n), np.tile([0.0, 1.0], (n, 1))
    if profile > 0.0:
        limbs, whole, ends = _profiled(body.limbs, profile)
    return SceneSubject(
        body, limbs, whole, ends, _clothes(body.limbs, clothes, streams[2]) if clothes else None, factors
    )


def height_of(shape: Shape) -> float:
    """Return the standing height of a person, m, from the soles to the top of the head."""
    return float((1.0 + ANKLE_HEIGHT) * shape.calf + shape.thigh + shape.neck[2] + shape.head[2] + shape.head_radius)


def _perturbed_bones(body: Body, size: float, rng: np.random.Generator) -> tuple[Body, dict[str, FloatArray]]:
    """Return a body of the same height with bone lengths changed by up to `size`, and the factors."""
    if body.skeleton.names != JOINT_NAMES:
        return _perturbed_offsets(body, size, rng)
    original = body.shape
    names = ("torso", "shoulders", "hips", "head", "upper_arm", "forearm", "thigh", "calf")
    f = dict(zip(names, rng.uniform(1.0 - size, 1.0 + size, len(names)), strict=True))

    def shape(scale: float) -> Shape:
        torso, across, hips, head = (scale * f[name] for name in names[:4])
        return replace(
            original, neck=tuple(torso * x for x in original.neck), hip=tuple(hips * x for x in original.hip),
            head=tuple(head * x for x in original.head),
            shoulder=(torso * original.shoulder[0], across * original.shoulder[1], torso * original.shoulder[2]),
            **{name: scale * f[name] * getattr(original, name) for name in names[4:]},
        )  # fmt: skip

    head_radius = original.head_radius
    scale = (height_of(original) - head_radius) / (height_of(shape(1.0)) - head_radius)
    other = person(shape(scale))
    other = other if len(other.limbs) == len(body.limbs) else with_neck_and_feet(other)
    return other, {f"length_{name}": np.array([scale * factor]) for name, factor in f.items()}


def _perturbed_offsets(body: Body, size: float, rng: np.random.Generator) -> tuple[Body, dict[str, FloatArray]]:
    """Do the same for any skeleton, bone by bone; its height is that of its joints with all angles zero."""
    skeleton, limbs = body.skeleton, body.limbs
    factor = rng.uniform(1.0 - size, 1.0 + size, len(skeleton.names))
    offsets = factor[:, None] * skeleton.offsets
    factor *= _joint_height(skeleton.offsets, skeleton.parents) / _joint_height(offsets, skeleton.parents)
    of_limb = np.array([factor[skeleton.joint(name.removesuffix("_end"))] for name in limbs.names])
    limbs = replace(limbs, starts=of_limb[:, None] * limbs.starts, ends=of_limb[:, None] * limbs.ends)
    other = replace(body, skeleton=replace(skeleton, offsets=factor[:, None] * skeleton.offsets), limbs=limbs)
    return other, {f"length_{name}": np.array([f]) for name, f in zip(skeleton.names, factor, strict=True)}


def _joint_height(offsets: FloatArray, parents: IntArray) -> float:
    height = np.zeros(len(parents))
    for joint, parent in enumerate(parents):
        height[joint] = offsets[joint, 2] + (height[parent] if parent >= 0 else 0.0)
    return float(np.ptp(height))


def _perturbed_radii(body: Body, size: float, rng: np.random.Generator) -> tuple[Body, dict[str, FloatArray]]:
    """Return a body with semi-axes changed by up to `size`, equal for left and right, and the factors.

    A sphere has one factor; the head has none, because it contributes to the height.
    """
    limbs = body.limbs
    factors: dict[str, FloatArray] = {}
    radii = limbs.radii.copy()
    for k, name in enumerate(limbs.names):
        drawn = rng.uniform(1.0 - size, 1.0 + size, 2)
        plain = without_side(name)
        if plain != "head":
            drawn = np.full(2, drawn[0]) if limbs.spheres[k] else drawn
            radii[k] *= factors.setdefault(f"radius_{plain}", drawn)
    return replace(body, limbs=replace(limbs, radii=radii)), factors


def _with_neck_and_feet(body: Body) -> Body:
    """Return a person's body with an elongated head, flat hands, and the neck and feet that a tracker's body lacks."""
    if body.skeleton.names != JOINT_NAMES:
        return body  # a motion file's skeleton includes them
    shape, limbs = body.shape, body.limbs
    starts, ends, radii = limbs.starts.copy(), limbs.ends.copy(), limbs.radii.copy()
    up = np.array([0.0, 0.0, 1.0])
    for k in np.flatnonzero(limbs.spheres):
        centre, r = limbs.starts[k], limbs.radii[k, 0, 0]
        if limbs.names[k] == "head":  # as high as the sphere, as caps are as high as the smaller of their semi-axes
            starts[k], ends[k] = centre - 0.4 * r * up, centre + 0.28 * r * up
            radii[k] = r * np.array([[0.75, 0.6], [0.85, 0.72]])
        else:
            starts[k], ends[k] = centre + 0.6 * r * up, centre - 0.7 * r * up
            radii[k] = r * np.array([[0.75, 0.5], [0.8, 0.45]])
    head, r = np.array(shape.head), shape.head_radius
    rows = [("neck", "neck", -0.02 * up, head - 0.5 * r * up, [[0.55 * r, 0.55 * r], [0.5 * r, 0.5 * r]])]
    c, a = shape.calf, ANKLE_HEIGHT * shape.calf
    for side in ("left", "right"):
        heel, toes = np.array([-0.08 * c, 0.0, -c - 0.48 * a]), np.array([0.36 * c, 0.0, -c - 0.66 * a])
        rows.append((f"{side}_foot", f"{side}_knee", heel, toes, [[0.52 * a, 0.55 * a], [0.34 * a, 0.65 * a]]))
    shaped = replace(limbs, starts=starts, ends=ends, radii=radii, spheres=np.zeros(len(limbs), dtype=np.bool_))
    return replace(body, limbs=shaped.extended(rows))


def _profiled(limbs: Limbs, size: float) -> tuple[Limbs, IntArray, FloatArray]:
    """Return segments (K,) with the radii of the profiles, their limbs (K,), and their ends in these (K, 2)."""
    whole, ends, radii = [], [], []
    for k, name in enumerate(limbs.names):
        bare = any(word in name.lower() for word in _BARE) or limbs.spheres[k]
        table = ((0.0, 1.0), (1.0, 1.0)) if bare else _PROFILES.get(without_side(name), _OTHER_PROFILE)
        place, *factors = np.array(table).T
        linear = limbs.radii[k, 0] + place[:, None] * (limbs.radii[k, 1] - limbs.radii[k, 0])
        rings = linear * (1.0 + size * (np.stack(factors, axis=1) - 1.0))
        whole += [k] * (len(place) - 1)
        ends += list(pairwise(place))
        radii += list(pairwise(rings))
    of, at = np.array(whole), np.array(ends)
    axis, names = (limbs.ends - limbs.starts)[of], tuple(f"{limbs.names[k]}_{i}" for i, k in enumerate(whole))
    starts, ends_m = limbs.starts[of] + at[:, :1] * axis, limbs.starts[of] + at[:, 1:] * axis
    return Limbs(names, limbs.joints[of], starts, ends_m, np.array(radii), limbs.spheres[of]), of, at


def _clothes(limbs: Limbs, size_m: float, rng: np.random.Generator) -> _Clothes:
    n = len(limbs)
    bare = np.array([any(word in name.lower() for word in _BARE) for name in limbs.names])
    return _Clothes(
        swing=rng.uniform(0.6, 2.5, (n, _WAVES)),
        along=rng.uniform(0.3, 1.2, (n, _WAVES)) * rng.choice([-1.0, 1.0], (n, _WAVES)),
        phase=rng.uniform(0.0, 2.0 * np.pi, (n, _WAVES)),
        slide=rng.uniform(0.6, 2.5, (n, 3, _SLIDES)),
        slide_phase=rng.uniform(0.0, 2.0 * np.pi, (n, 3, _SLIDES)),
        size_m=np.where(bare, 0.0, size_m),
    )
