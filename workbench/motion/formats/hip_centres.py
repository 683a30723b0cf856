"""Centres of the hip joints, which no marker shows, from the markers on the pelvis.

The regression is that of Harrington et al., *J. Biomech.* 40, 2007, without the length of the leg: it errs by 5 mm.
"""

from collections.abc import Sequence

import numpy as np

from workbench.motion.formats.joint_names import unprefixed
from workbench.utils.arrays import FloatArray
from workbench.utils.text import plain_name

_FRONT_AND_BACK = (("{}asi", "{}psi"), ("{}asis", "{}psis"), ("{}ias", "{}ips"), ("waist{}front", "waist{}back"))
"""Markers on the anterior and posterior superior iliac spines of a side, as in Plug-in Gait, OpenSim and Qualisys."""
_SACRUM = ("sacr", "sacrum", "vsacral", "sacral")
_AHEAD, _UP, _ASIDE = (-0.24, -9.9e-3), (-0.30, -10.9e-3), (0.33, 7.3e-3)
"""Factors, of the depth of the pelvis ahead and of its width else, and constants, m, from the middle of the front."""


def pelvis_markers(names: Sequence[str]) -> tuple[tuple[str, str], tuple[str, ...]] | None:
    """Return the names of the left and right marker in front, and of those at the back, of the first subject that has
    them; None without."""
    for subject in dict.fromkeys(name.rpartition(":")[0] for name in names):
        own = [name for name in names if name.rpartition(":")[0] == subject]
        for words in unprefixed(own):
            index = dict(zip(map(plain_name, words), own, strict=True))
            sacrum = [index[word] for word in _SACRUM if word in index][:1]
            for front, back in _FRONT_AND_BACK:
                left, right, *behind = (index.get(form.format(side)) for form in (front, back) for side in "lr")
                spines = [name for name in behind if name is not None]
                spines = spines if len(spines) == len(behind) else sacrum
                if left is not None and right is not None and spines:
                    return (left, right), tuple(spines)
    return None


def hip_centres(left: FloatArray, right: FloatArray, back: FloatArray) -> FloatArray:
    """Return the centres of the left and right hip (F, 2, 3) by the markers on the front of the pelvis, and the middle
    of those on its back, each (F, 3), m."""
    middle, across = 0.5 * (left + right), left - right
    width = np.linalg.norm(across, axis=1, keepdims=True)
    aside, ahead = across / width, middle - back
    depth = np.linalg.norm(ahead, axis=1, keepdims=True)
    ahead = ahead - (ahead * aside).sum(axis=1, keepdims=True) * aside
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    centre = middle + _along(_AHEAD, depth) * ahead + _along(_UP, width) * np.cross(ahead, aside)
    return np.stack([centre + sign * _along(_ASIDE, width) * aside for sign in (1.0, -1.0)], axis=1)


def _along(regression: tuple[float, float], size: FloatArray) -> FloatArray:
    return np.asarray(regression[0] * size + regression[1])
