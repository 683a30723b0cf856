"""Markers measured in 3-D, from a TRC or C3D file, and the joints they stand for."""

import logging
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from workbench.body.skeleton import JOINT_NAMES
from workbench.motion.clip import WORLD_FROM_FILE
from workbench.utils.arrays import FloatArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import check_places, check_rate

log = logging.getLogger(__name__)

MarkersOf = Mapping[str, Sequence[str]]
NO_MARKERS: MarkersOf = MappingProxyType({})
UNITS = MappingProxyType({"m": 1.0, "cm": 0.01, "mm": 0.001})
PERSON_M = 1.7  # a person's extent, by which the unit is told: the nearest of metres, centimetres and millimetres


@dataclass(frozen=True, eq=False)
class Markers:
    """M markers in F frames at rate_hz. source: the file. positions: (F, M, 3), m, in the world, NaN where missing."""

    source: str
    names: tuple[str, ...]
    rate_hz: float
    positions: FloatArray

    def at(self, times_s: FloatArray) -> FloatArray:
        """Positions (T, M, 3) at times (T,), s, since the first frame, linear between frames; NaN before and after,
        and beside a gap."""
        rows = np.round(times_s * self.rate_hz, 6)
        low = np.floor(rows).astype(int)
        inside = (low >= 0) & (rows <= len(self.positions) - 1)
        before = self.positions[np.where(inside, low, 0)]
        after = self.positions[np.where(inside, np.ceil(rows).astype(int), 0)]
        part = (rows - low)[:, None, None]
        between = np.where(part == 0.0, before, before + part * (after - before))
        return np.where(inside[:, None, None], between, np.nan)


def in_world(source: str, names: Sequence[str], rate_hz: float, positions: FloatArray, unit: str) -> Markers:
    """Markers at positions (F, M, 3) in a file's axes and unit, in metres with z up.

    The unit is told by the person's size, as headers are often wrong, and which axis is up by where the upper body is;
    both are said. unit: what the header says, to say so where it is another. Raises InputError where neither y nor z is
    up, and for markers that are never seen.
    """
    if not np.isfinite(positions).any():
        raise InputError(f"{source}: expected markers, found none in {len(positions)} frames")
    shown = positions[np.isfinite(positions[..., 0]).any(axis=1)]
    extent = np.median(np.linalg.norm(np.nanmax(shown, axis=1) - np.nanmin(shown, axis=1), axis=1))
    found = min(UNITS, key=lambda name: abs(np.log(extent * UNITS[name] / PERSON_M)))
    up = _up(source, names, positions)
    log.info("%s: %d markers, %d frames, read as %s with %s up", source, len(names), len(positions), found, "xyz"[up])
    if unit.lower() not in (found, ""):
        log.warning("%s: says its unit is %r, but a person would be %.3g %s tall", source, unit, extent, unit)
    world = positions if up == 2 else positions[..., WORLD_FROM_FILE]
    check_rate(source, rate_hz)
    check_places(source, world * UNITS[found])
    return Markers(source, tuple(names), rate_hz, world * UNITS[found])


def joints_of(markers: Markers, given: MarkersOf = NO_MARKERS) -> list[tuple[str, tuple[str, ...]]]:
    """The joints that the markers stand for, each with the names of those in whose middle it lies.

    given: markers by joint, where names do not say so or the joint's centre is between others. Raises InputError for
    unknown joints and markers, and where no joint is known.
    """
    if unknown := sorted(set(given) - set(JOINT_NAMES)):
        raise InputError(f"{markers.source}: unknown joint {unknown[0]!r}, expected one of {', '.join(JOINT_NAMES)}")
    if unknown := sorted({name for names in given.values() for name in names} - set(markers.names)):
        raise InputError(f"{markers.source}: no marker {unknown[0]!r}, expected some of {', '.join(markers.names)}")
    plain = {_plain(name): name for name in reversed(markers.names)}
    found = []
    for joint in JOINT_NAMES:
        fits = [names for names in _alternatives(joint) if all(name in plain for name in names)]
        if joint in given:
            found.append((joint, tuple(given[joint])))
        elif fits:
            found.append((joint, tuple(plain[name] for name in fits[0])))
    if not found:
        raise InputError(f"{markers.source}: no marker has the name of a joint, found {', '.join(markers.names)}")
    return found


def joint_centres(markers: Markers, positions: FloatArray, given: MarkersOf = NO_MARKERS) -> FloatArray:
    """Virtual markers (F, J, 3), m, at the joints' centres, of markers at positions (F, M, 3); NaN where unknown.

    given, and what is raised: see `joints_of`.
    """
    centres = np.full((len(positions), len(JOINT_NAMES), 3), np.nan)
    for joint, names in joints_of(markers, given):
        centres[:, JOINT_NAMES.index(joint)] = positions[:, [markers.names.index(name) for name in names]].mean(axis=1)
    return centres


def _alternatives(joint: str) -> Iterable[tuple[str, ...]]:
    """List what markers of a joint are called, in plain letters, the best first."""
    yield (_plain(joint),)
    if joint == "pelvis":
        yield from (("midhip",), ("hip",), ("lhip", "rhip"), ("lefthip", "righthip"))
    elif joint == "head_centre":
        yield from (("neck", "head"), ("neck", "headtop"), ("lear", "rear"))  # "head" is its top
    elif "_" in joint:
        side, part = joint.split("_")
        yield (side[0] + part,)


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


def _up(source: str, names: Sequence[str], positions: FloatArray) -> int:
    """The axis along which shoulders, neck and head are above knees and ankles."""
    plain = [_plain(name) for name in names]
    high = [any(word in name for word in ("shoulder", "neck", "head", "sho", "c7")) for name in plain]
    low = [any(word in name for word in ("knee", "ankle", "heel", "toe", "ank", "kne")) for name in plain]
    if not (any(high) and any(low)):
        raise InputError(f"{source}: expected markers of shoulders or head and of knees or ankles, to tell what is up")
    above = np.nanmean(positions[:, high], axis=(0, 1)) - np.nanmean(positions[:, low], axis=(0, 1))
    up = int(np.argmax(np.abs(above)))
    if up == 0 or not above[up] > 0.0:
        raise InputError(f"{source}: expected y or z to be up, found {'-' if above[up] < 0.0 else ''}{'xyz'[up]}")
    return up
