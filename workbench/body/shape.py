"""The shape of one person: places of the joints, lengths and radii of the limbs."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from workbench.utils.errors import InputError
from workbench.utils.input_limits import LONGEST_LIMB_M

Triple = tuple[float, float, float]
_Pair = tuple[float, float]

ANKLE_HEIGHT, SHOULDER_HEIGHT, HEAD_HEIGHT, LEG_LENGTH = 0.039, 0.818, 0.93, 0.491
"""Of a standing person, as fractions of the height, as in `from_height`: heights of ankles, shoulders and the head's
centre, and the length of thigh and calf together."""
FOOT_LENGTH, HEEL_BEHIND, TOES_HEIGHT = 0.152, 0.035, 0.022
"""Of a foot, as fractions of the height: its length (Drillis & Contini 1966, in Winter, *Biomechanics and Motor Control
of Human Movement*, 4th ed. 2009, fig. 4.1), and our values for the distance of the heel behind the ankle and the toes'
height."""
FOREARM_OVER_HEIGHT = 0.044
"""A forearm's width over a person's height, the mean of the two ends of `from_height`: the threshold of a track in the
image."""


@dataclass(frozen=True)
class Shape:
    """Lengths and radii of one person, all in metres. neck, shoulder, hip: place of the neck, the left shoulder and the
    left hip in the torso's frame (forward, left, up), measured from the pelvis, the midpoint of the hips; the right
    side is their mirror image. head: centre of the head seen from the neck. upper_arm, forearm, thigh, calf: lengths
    from joint to joint. *_radii of a limb: (at its near end, at its far end). torso_radii_low, torso_radii_high: (fore
    and aft, sideways) semi-axes of the torso's elliptical section at the hips and at the shoulders."""

    neck: Triple
    shoulder: Triple
    hip: Triple
    head: Triple
    upper_arm: float
    forearm: float
    thigh: float
    calf: float
    head_radius: float
    hand_radius: float
    torso_radii_low: _Pair
    torso_radii_high: _Pair
    upper_arm_radii: _Pair
    forearm_radii: _Pair
    thigh_radii: _Pair
    calf_radii: _Pair

    def __post_init__(self) -> None:
        for name in ("upper_arm", "forearm", "thigh", "calf", "head_radius", "hand_radius"):
            if not getattr(self, name) > 0.0:
                raise InputError(f"shape: {name} must be a positive length in metres, found {getattr(self, name)}")

    def scaled(self, factor: float) -> "Shape":
        """Return the shape with every length multiplied by `factor`, which preserves the proportions."""
        lengths: dict[str, Any] = self.as_dict()
        for name, value in lengths.items():
            lengths[name] = tuple(factor * x for x in value) if isinstance(value, tuple) else factor * value
        return Shape(**lengths)

    @property
    def foot_size(self) -> float:
        """Height, m, of the person whose feet these are: that of an average person with legs as long."""
        return (self.thigh + self.calf) / LEG_LENGTH

    @property
    def heel(self) -> Triple:
        """The back of the heel at the sole, where detectors have it, m, seen from the ankle: forward, left, up, with
        the sole at right angles to the calf."""
        return (-self.foot_size * HEEL_BEHIND, 0.0, -self.foot_size * ANKLE_HEIGHT)

    @property
    def toes(self) -> Triple:
        """The tip of the toes, half as high as they are, m, as `heel`."""
        return (
            self.foot_size * (FOOT_LENGTH - HEEL_BEHIND), 0.0, self.foot_size * (0.5 * TOES_HEIGHT - ANKLE_HEIGHT)
        )  # fmt: skip

    def as_dict(self) -> dict[str, float | tuple[float, ...]]:
        """Return plain numbers by name, for provenance and for HDF5 attributes."""
        return dict(vars(self))


def from_height(height_m: float, **lengths: float | tuple[float, ...]) -> Shape:
    """Return the shape of an average person of this height; keyword arguments replace single lengths (m).

    Segment lengths as fractions of the height H: Drillis & Contini 1966, as tabulated by Winter, *Biomechanics and
    Motor Control of Human Movement*, 4th ed. 2009, fig. 4.1 (heights of hip 0.530, knee 0.285, ankle 0.039, shoulder
    0.818 H; upper arm 0.186, forearm 0.146 H; shoulder joints 0.129 H from the midline). The distance between the hip
    joints, 0.10 H, is that of joint centres (Bell, Pedersen & Brand 1990), not Winter's breadth over the trochanters.
    The neck (C7) and the centre of the head at 0.85 and 0.93 H, and the radii, are ours, read off adult silhouettes.
    Raises InputError if the height is not between 0.5 and 2.5 m or a name is unknown.
    """
    if not 0.5 <= height_m <= 2.5:
        raise InputError(f"shape: height must be given in metres, between 0.5 and 2.5, found {height_m}")
    if unknown := set(lengths) - {field.name for field in fields(Shape)}:
        raise InputError(f"shape: unknown length {sorted(unknown)[0]!r}")
    average = Shape(
        neck=(0.0, 0.0, 0.320), shoulder=(0.0, 0.115, 0.288), hip=(0.0, 0.050, 0.0), head=(0.012, 0.0, 0.080),
        upper_arm=0.186, forearm=0.146, thigh=0.245, calf=0.246, head_radius=0.060, hand_radius=0.030,
        torso_radii_low=(0.062, 0.095), torso_radii_high=(0.058, 0.100), upper_arm_radii=(0.030, 0.025),
        forearm_radii=(0.026, 0.018), thigh_radii=(0.050, 0.035), calf_radii=(0.034, 0.023),
    ).scaled(height_m)  # fmt: skip
    return _possible(Shape(**{**average.as_dict(), **lengths}))  # type: ignore[arg-type]


def read_shape(place: str, attributes: Mapping[str, Any]) -> Shape:
    """Return the shape from a file's lengths, m, by the names of `Shape.as_dict`; raises InputError, naming the place,
    if one is missing, not finite, or implausible."""
    lengths: dict[str, Any] = {}
    for name, average in from_height(1.7).as_dict().items():  # for names and sizes
        value = np.asarray(attributes.get(name))
        if value.dtype != np.float64 or value.shape != np.shape(average) or not np.isfinite(value).all():
            raise InputError(f"{place}: the shape has no valid length {name!r}; expected metres")
        lengths[name] = tuple(map(float, value)) if value.ndim else float(value)
    try:
        return _possible(Shape(**lengths))
    except InputError as error:  # names the length, not its file
        raise InputError(f"{place}: {error}") from None


def _possible(shape: Shape) -> Shape:
    """Return the shape; raises InputError for limbs longer than LONGEST_LIMB_M. Only for input, as a fit may exceed it
    temporarily."""
    for name in ("upper_arm", "forearm", "thigh", "calf"):
        if getattr(shape, name) > LONGEST_LIMB_M:
            raise InputError(f"shape: {name} must be at most {LONGEST_LIMB_M} m, found {getattr(shape, name):g}")
    return shape
