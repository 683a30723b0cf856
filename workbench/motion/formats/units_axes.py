"""Unit of length and vertical axis of a motion file: by the key, the header, and a person's plausible size and posture.

Every decision is logged; one that contradicts the header or the format's convention is logged as a warning.
"""

import logging
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from workbench.body.units import PERSON_M, UNITS, fits_person, is_person, unit_of_person
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.nan_statistics import nan_mean

log = logging.getLogger(__name__)

_SPELLINGS = {
    "metre": "m", "meter": "m", "centimetre": "cm", "centimeter": "cm", "millimetre": "mm", "millimeter": "mm",
    "in": "inch", "inche": "inch",
}  # fmt: skip
UPRIGHT = 0.7  # cosine of 45°: an axis along which the head is above the feet
_MOST = 0.5  # of the frames, for the axis that the format suggests
_NEARLY_ALL = 0.9  # of the frames, for another axis
AXES = ("x", "y", "z", "-x", "-y", "-z")
_FORWARD = {"x": "y", "y": "z", "z": "x"}  # by the vertical axis: cyclic, which preserves handedness
_HEIGHTS = (  # words in the names of joints and markers, from low to high; a fibula's head is at the knee
    ("ankle", "knee", "heel", "toe", "foot", "ank", "kne", "mal"), ("pelvis", "hip", "asi", "psi", "sacr", "waist"),
    ("shoulder", "neck", "head", "sho", "c7", "acr", "clav"),
)  # fmt: skip


class Axes(NamedTuple):
    """Signed permutation to the world's axes: world[..., k] = signs[k] * file[..., order[k]]."""

    order: IntArray
    signs: FloatArray

    def vectors(self, values: FloatArray) -> FloatArray:
        """Return vectors (..., 3) of a file in the world's axes."""
        rotated: FloatArray = values[..., self.order] * self.signs
        return rotated

    def rotations(self, matrices: FloatArray) -> FloatArray:
        """Return rotations (..., 3, 3) of a file in the world's axes."""
        rotated: FloatArray = matrices[..., self.order, :][..., self.order] * np.outer(self.signs, self.signs)
        return rotated


def world_axes(up: str, forward: str | None = None) -> Axes:
    """Return the axes of a right-handed file whose axis `up` is vertical.

    forward : the file's axis that becomes the world's x; None: the cyclic successor of `up`, z for y. Raises InputError
    for an unknown axis, or two along one line.
    """
    forward = _FORWARD[up[-1:]] if forward is None and up in AXES else forward
    if up not in AXES or forward not in AXES or up[-1] == forward[-1]:
        raise InputError(f"expected two different axes up and forward of {', '.join(AXES)}, found {up!r}, {forward!r}")
    z, x = (np.eye(3)["xyz".index(axis[-1])] * (-1.0 if axis[0] == "-" else 1.0) for axis in (up, forward))
    matrix = np.stack([x, np.cross(z, x), z])
    return Axes(np.abs(matrix).argmax(axis=1), matrix.sum(axis=1))


def upward(points: Mapping[str, FloatArray]) -> FloatArray | None:
    """Return the vectors (F, 3) from the lowest to the highest known parts of a standing person, NaN in gaps.

    points : positions (F, 3) by the names of joints or markers, of which those with a word of _HEIGHTS are used; None
    if all of them are at one height.
    """
    levels = []
    for words in _HEIGHTS:
        places = [
            at for name, at in points.items() if any(w in name.lower() for w in words) and "fib" not in name.lower()
        ]
        if places:
            levels.append(nan_mean(np.array(places), axis=0))
    return None if len(levels) < 2 else levels[-1] - levels[0]


def metres_per_unit(
    place: object, size: float | None, header: str | float, given: str | None = None, is_stated: bool = False
) -> float:
    """Return the metres per unit of length of a file.

    Parameters
    ----------
    place : of the file, for messages.
    size : body height in the file's unit; None if unknown.
    header : the unit by the header or the format's convention, a name or metres; "" if there is none.
    given : the unit by the user, which is used as it is.
    is_stated : whether the header names the unit, so that a child may be as small as an adult in another unit is.

    Raises
    ------
    InputError : `given` is unknown, or the person has no plausible height in any unit.
    """
    if given is not None:
        if given not in UNITS:
            raise InputError(f"{place}: the unit must be one of {', '.join(UNITS)}, found {given!r}")
        return UNITS[given]
    name = header if isinstance(header, str) else f"{header:.4g} m"
    word = name.strip().lower()
    word = _SPELLINGS.get(word.removesuffix("s"), word)
    usual = UNITS.get(word) if isinstance(header, str) else header
    if size is None:
        log.info("%s: no limb whose length shows the unit; read as %s", place, name or "m")
        return usual or 1.0
    if usual is not None and (is_person(size * usual) if is_stated else fits_person(size, usual)):
        log.info("%s: read in %s, in which the person is %.2f m tall", place, name, size * usual)
        return usual
    unit = unit_of_person(size)
    if unit is None:
        raise InputError(
            f"{place}: expected a person of {PERSON_M[0]} to {PERSON_M[1]} m, found a body height of {size:.3g} units"
            f"{f' of {name}' if name else ''}; give the unit (the key unit or truth_unit): one of {', '.join(UNITS)}"
        )
    message = "%s: read in %s, in which the person is %.2f m tall"
    arguments = [place, unit, size * UNITS[unit]]
    if name:
        message += "; by the file it would be %s, and the person %s"
        arguments += [name, f"{size * usual:.3g} m tall" if usual else "of unknown size"]
    log.log(logging.WARNING if name else logging.INFO, message, *arguments)
    return UNITS[unit]


def vertical_axis(place: object, upward: FloatArray | None, usual: str | None, given: str | None = None) -> str:
    """Return the vertical axis of a file, one of AXES.

    Parameters
    ----------
    place : of the file, for messages.
    upward : vectors (F, 3) from feet to head in the file's axes, NaN in gaps; None if unknown.
    usual : the axis by the header or the format's convention; None: y or z.
    given : the axis by the user, which is used as it is.

    Raises
    ------
    InputError : `given` is unknown, the person lies along x, or without a convention is not upright in most frames.
    """
    if given is not None:
        if given not in AXES:
            raise InputError(f"{place}: the vertical axis must be one of {', '.join(AXES)}, found {given!r}")
        return given
    key = "give the vertical axis (the key up or truth_up)"
    shares = dict.fromkeys(AXES, 0.0) if upward is None else _upright_shares(upward)
    best = max(AXES, key=lambda axis: shares[axis])
    if usual is not None and (shares[usual] >= _MOST or shares[best] < _NEARLY_ALL):
        how = "as usual" if upward is None else f"the head is above the feet in {shares[usual]:.0%} of the frames"
        log.info("%s: %s is up, %s", place, usual, how)
        return usual
    if upward is None:
        raise InputError(f"{place}: expected joints or markers of head or shoulders and of hips, knees or feet; {key}")
    along = f"the head is above the feet along {best} in {shares[best]:.0%} of the frames"
    if best[-1] == "x" or shares[best] < _MOST:
        raise InputError(f"{place}: expected y or z to be up, but {along}; if the person lies, {key}")
    if usual is None and best in ("y", "z"):
        log.info("%s: %s is up, since %s", place, best, along)
    else:
        log.warning("%s: %s is taken to be up, since %s; if the person lies, %s", place, best, along, key)
    return best


def _upright_shares(upward: FloatArray) -> dict[str, float]:
    """Return the share of frames in which the body is within 45° of each axis."""
    directions = upward[np.isfinite(upward).all(axis=-1)]
    sizes = np.linalg.norm(directions, axis=-1, keepdims=True)
    directions = directions / np.where(sizes > 0.0, sizes, 1.0)
    signed = np.concatenate([directions, -directions], axis=1) > UPRIGHT
    return dict(zip(AXES, signed.mean(axis=0).tolist() if len(signed) else [0.0] * 6, strict=True))
