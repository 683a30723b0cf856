"""The centre of mass of a body, by the positions of its joints."""

from collections.abc import Sequence

import numpy as np

from workbench.body.skeleton import JOINT_NAMES
from workbench.utils.arrays import FloatArray

_LIMBS = (
    ("shoulder", "elbow", 0.028, 0.436),
    ("elbow", "wrist", 0.022, 0.682),
    ("hip", "knee", 0.100, 0.433),
    ("knee", "ankle", 0.061, 0.606),
)
"""Proximal and distal joint, mass fraction and centre of mass as a fraction of the length, hands and feet included
(Winter, *Biomechanics and Motor Control of Human Movement*, 4th ed. 2009, table 4.1)."""


def centre_of_mass(names: Sequence[str]) -> FloatArray:
    """Return the weights (J,) of the joints of these names in the centre of mass, see _LIMBS. The trunk's mass is
    midway between pelvis and neck, slightly too high."""
    weights = dict.fromkeys(JOINT_NAMES, 0.0) | {"pelvis": 0.2485, "neck": 0.2485, "head_centre": 0.081}
    for side in ("left", "right"):
        for near, far, mass, along in _LIMBS:
            weights[f"{side}_{near}"] += mass * (1.0 - along)
            weights[f"{side}_{far}"] += mass * along
    total = sum(weights.values())
    return np.array([weights.get(name, 0.0) / total for name in names])
