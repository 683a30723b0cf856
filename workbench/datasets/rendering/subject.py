"""The person whom a scene shows: of other proportions than the tracker assumes, rounder, and softly dressed.

The subject has the joints, the angles and about the height of the tracker's body, but bones and girths of its own,
drawn by seed; limbs that bulge and taper, built of short cones; a neck and feet; and clothes that slide and swing a
few millimetres. `sequence.Scene.departure` has the sizes; where all are zero the subject is the tracker's own body,
bitwise.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from workbench.body.limbs import Body, Limbs, person, with_neck_and_feet
from workbench.body.shape import Shape
from workbench.body.skeleton import JOINT_NAMES
from workbench.datasets.rendering.render import VOXEL_M, RenderedScene
from workbench.motion.synthetic.gait import ANKLE_HEIGHT
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.rng import stream

_Profile = tuple[tuple[float, ...], ...]
"""Girth along a limb: (part of its length, factor of the semi-axes; of that fore and aft and of that sideways)."""
_PROFILES: Mapping[str, _Profile] = MappingProxyType(
    {
        "torso": ((0.0, 1.05, 0.98), (0.25, 1.0, 0.92), (0.5, 0.98, 0.93), (0.78, 1.1, 1.02), (1.0, 0.85, 0.72)),
        "upper_arm": ((0.0, 1.0), (0.4, 1.08), (1.0, 0.95)),
        "forearm": ((0.0, 0.95), (0.3, 1.1), (1.0, 0.97)),
        "thigh": ((0.0, 1.01), (0.3, 1.05), (0.7, 1.0), (1.0, 0.97)),
        "calf": ((0.0, 0.95), (0.3, 1.12), (0.6, 1.05), (1.0, 0.95)),
    }
)
"""Of the person's limbs, by name without the side; read off adult silhouettes, as the radii of `shape.from_height`."""
_OTHER_PROFILE: _Profile = ((0.0, 0.95), (0.35, 1.06), (0.7, 1.03), (1.0, 0.95))
_BARE = ("head", "hand", "neck", "foot", "toe")
"""What wears no clothes, by parts of limbs' names."""
_LEAST_RADIUS_M = 0.01
_WAVES, _SLIDES = 3, 2


@dataclass(frozen=True, eq=False)
class _Clothes:
    """How L limbs' clothes move: sums of W sine waves along the limb and over time, of unit variance.

    swing: (L, W) frequency, Hz, of the girth; along: (L, W) waves in a limb's length; phase: (L, W) rad. slide,
    slide_phase: (L, 3, V), of the texture along a limb's axes. size_m: (L,) standard deviation of both.
    """

    swing: FloatArray
    along: FloatArray
    phase: FloatArray
    slide: FloatArray
    slide_phase: FloatArray
    size_m: FloatArray

    def swung(self, limb: IntArray, place: FloatArray, time_s: float) -> FloatArray:
        """How much larger the mean radius is, (K,) m, at places (K,), parts of the length of limbs (K,)."""
        angle = self.swing[limb] * time_s + self.along[limb] * place[:, None]
        waves = np.sin(2.0 * np.pi * angle + self.phase[limb]).sum(axis=1)
        return self.size_m[limb] * np.sqrt(2.0 / _WAVES) * waves

    def slid(self, time_s: float) -> FloatArray:
        """How far the texture has slid (L, 3), m."""
        waves = np.sin(2.0 * np.pi * self.slide * time_s + self.slide_phase).sum(axis=2)
        return self.size_m[:, None] * np.sqrt(2.0 / _SLIDES) * waves


@dataclass(frozen=True, eq=False)
class SceneSubject:
    """Who is shown. body: the skeleton, and limbs as wholes; drawn: short limbs (K,) that its limbs are made of.

    whole: (K,) the body's limb that a short one belongs to; ends: (K, 2), where it begins and ends, parts of its
    length. clothes: None where they do not move. factors: what was drawn, by name, for the recording.
    """

    body: Body
    drawn: Limbs
    whole: IntArray
    ends: FloatArray
    clothes: _Clothes | None
    factors: Mapping[str, FloatArray]

    def at(self, time_s: float) -> Body:
        """The body with the limbs that are seen at a time, s."""
        if self.clothes is None:
            return replace(self.body, limbs=self.drawn) if len(self.drawn) != len(self.body.limbs) else self.body
        swung = np.stack([self.clothes.swung(self.whole, self.ends[:, k], time_s) for k in range(2)], axis=1)
        girth = self.drawn.radii.mean(axis=2)
        factor = np.maximum(girth + swung, np.minimum(girth, _LEAST_RADIUS_M)) / girth
        return replace(self.body, limbs=replace(self.drawn, radii=factor[:, :, None] * self.drawn.radii))

    def shown(self, scene: RenderedScene, time_s: float) -> RenderedScene:
        """The scene, whose body and texture are of the limbs as wholes, as it is seen at a time, s."""
        lie = np.zeros((len(self.drawn), 3)) if self.clothes is None else self.clothes.slid(time_s)[self.whole]
        lie[:, 2] += self.body.limbs.lengths[self.whole] * self.ends[:, 0]  # the texture goes on across short limbs
        offsets, grey = scene.texture.offsets[self.whole] + lie / VOXEL_M, scene.texture.grey[self.whole]
        return replace(scene, body=self.at(time_s), texture=replace(scene.texture, offsets=offsets, grey=grey))


def subject_of(body: Body, departure: Mapping[str, float], seed: int) -> SceneSubject:
    """Draw who is shown where a tracker is told `body`; departure: see `sequence.Scene.departure`.

    Every kind of departure has a stream of its own, so that one does not change with the size of another.
    """
    lengths, radii, profile, clothes = (departure[name] for name in ("lengths", "radii", "profile", "clothes_m"))
    streams = [stream(seed, f"subject: {name}") for name in ("lengths", "radii", "clothes")]
    factors: dict[str, FloatArray] = {}
    if lengths > 0.0:
        body, factors = _other_bones(body, lengths, streams[0])
    if radii > 0.0:
        body, girths = _other_girths(body, radii, streams[1])
        factors |= girths
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
    """Return how tall a person stands, m, from the soles to the top of the head."""
    return float((1.0 + ANKLE_HEIGHT) * shape.calf + shape.thigh + shape.neck[2] + shape.head[2] + shape.head_radius)


def _other_bones(body: Body, size: float, rng: np.random.Generator) -> tuple[Body, dict[str, FloatArray]]:
    """A body whose bones are longer or shorter by up to `size`, scaled so that it is as tall, and the factors."""
    if body.skeleton.names != JOINT_NAMES:
        return _other_offsets(body, size, rng)
    told = body.shape
    names = ("torso", "shoulders", "hips", "head", "upper_arm", "forearm", "thigh", "calf")
    f = dict(zip(names, rng.uniform(1.0 - size, 1.0 + size, len(names)), strict=True))

    def shape(scale: float) -> Shape:
        torso, across, hips, head = (scale * f[name] for name in names[:4])
        return replace(
            told, neck=tuple(torso * x for x in told.neck), hip=tuple(hips * x for x in told.hip),
            head=tuple(head * x for x in told.head),
            shoulder=(torso * told.shoulder[0], across * told.shoulder[1], torso * told.shoulder[2]),
            **{name: scale * f[name] * getattr(told, name) for name in names[4:]},
        )  # fmt: skip

    round_head = told.head_radius
    scale = (height_of(told) - round_head) / (height_of(shape(1.0)) - round_head)
    other = person(shape(scale))
    other = other if len(other.limbs) == len(body.limbs) else with_neck_and_feet(other)
    return other, {f"length_{name}": np.array([scale * factor]) for name, factor in f.items()}


def _other_offsets(body: Body, size: float, rng: np.random.Generator) -> tuple[Body, dict[str, FloatArray]]:
    """Do the same with any skeleton, bone by bone; its height is that of its joints when all angles are zero."""
    skeleton, limbs = body.skeleton, body.limbs
    factor = rng.uniform(1.0 - size, 1.0 + size, len(skeleton.names))
    offsets = factor[:, None] * skeleton.offsets
    factor *= _tall(skeleton.offsets, skeleton.parents) / _tall(offsets, skeleton.parents)
    of_limb = np.array([factor[skeleton.joint(name.removesuffix("_end"))] for name in limbs.names])
    limbs = replace(limbs, starts=of_limb[:, None] * limbs.starts, ends=of_limb[:, None] * limbs.ends)
    other = replace(body, skeleton=replace(skeleton, offsets=factor[:, None] * skeleton.offsets), limbs=limbs)
    return other, {f"length_{name}": np.array([f]) for name, f in zip(skeleton.names, factor, strict=True)}


def _tall(offsets: FloatArray, parents: IntArray) -> float:
    height = np.zeros(len(parents))
    for joint, parent in enumerate(parents):
        height[joint] = offsets[joint, 2] + (height[parent] if parent >= 0 else 0.0)
    return float(np.ptp(height))


def _other_girths(body: Body, size: float, rng: np.random.Generator) -> tuple[Body, dict[str, FloatArray]]:
    """A body whose limbs are thicker or thinner by up to `size`, fore and aft and sideways; left and right alike.

    A sphere has one factor, and the head, which adds to the height, none.
    """
    limbs = body.limbs
    factors: dict[str, FloatArray] = {}
    radii = limbs.radii.copy()
    for k, name in enumerate(limbs.names):
        drawn = rng.uniform(1.0 - size, 1.0 + size, 2)
        plain = _without_side(name)
        if plain != "head":
            drawn = np.full(2, drawn[0]) if limbs.spheres[k] else drawn
            radii[k] *= factors.setdefault(f"radius_{plain}", drawn)
    return replace(body, limbs=replace(limbs, radii=radii)), factors


def _without_side(name: str) -> str:
    """A limb's name without its side."""
    return name.removeprefix("left_").removeprefix("right_")


def _with_neck_and_feet(body: Body) -> Body:
    """A person's body with a head longer than wide, flat hands, and the neck and the feet that a tracker's lacks."""
    if body.skeleton.names != JOINT_NAMES:
        return body  # a motion file's skeleton has them
    shape, limbs = body.shape, body.limbs
    starts, ends, radii = limbs.starts.copy(), limbs.ends.copy(), limbs.radii.copy()
    up = np.array([0.0, 0.0, 1.0])
    for k in np.flatnonzero(limbs.spheres):
        centre, r = limbs.starts[k], limbs.radii[k, 0, 0]
        if limbs.names[k] == "head":  # as high as the sphere: caps are as high as the smaller of their semi-axes
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
    """Short limbs (K,) with the girths of the profiles, the limb that each is of (K,), and their ends in it (K, 2)."""
    whole, ends, radii = [], [], []
    for k, name in enumerate(limbs.names):
        bare = any(word in name.lower() for word in _BARE) or limbs.spheres[k]
        table = ((0.0, 1.0), (1.0, 1.0)) if bare else _PROFILES.get(_without_side(name), _OTHER_PROFILE)
        place, *girth = np.array(table).T
        even = limbs.radii[k, 0] + place[:, None] * (limbs.radii[k, 1] - limbs.radii[k, 0])
        rings = even * (1.0 + size * (np.stack(girth, axis=1) - 1.0))
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
