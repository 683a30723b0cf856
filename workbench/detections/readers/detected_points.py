"""Points of people detected in a video, before they are joints: their frames, and their scale."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from workbench.detections.readers.formats import SIZES
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import LARGEST_PX
from workbench.utils.text import natural_order

_UNIT_RANGE = 1.05
"""Largest coordinate of points that are scaled to the image's size: some lie outside the image."""

_MAX_CONFIDENCE = 2.0
"""Some detectors' sums of scores exceed 1."""
_NUMBER, _DECIMAL = re.compile(r"(?<!\d)\d{1,19}(?!\d)"), re.compile(r"(?<!\d)\d{1,9}\.\d{1,20}(?!\d)")
_MAX_NUMBER = 2**63


@dataclass(frozen=True, eq=False)
class DetectedPoints:
    """A detector's points in one video.

    Parameters
    ----------
    source : file or folder.
    frames : (M,) numbers of the frames, ascending.
    points : points (K, 3) of every person by frame, [u, v, confidence], NaN without detection; (0, 3) for an empty one;
        (K, 6) with world landmarks.
    names : names of the K points, where the file has them.
    identities : the detector's numbers (n,) of the people by frame, of those that it follows; None without.
    """

    source: str
    frames: IntArray
    points: tuple[Sequence[FloatArray], ...]
    names: tuple[str, ...] = ()
    identities: tuple[IntArray, ...] | None = None

    @property
    def detected(self) -> list[FloatArray]:
        """Points (K, 3) of the people with at least one point."""
        return [person for frame in self.points for person in frame if np.isfinite(person).any()]

    @property
    def n_points(self) -> int:
        """Number of points per person."""
        return len(self.detected[0])

    def check(self) -> None:
        """Raise InputError for different numbers of points per person, and if no person is detected."""
        if len(sizes := {len(person) for frame in self.points for person in frame} - {0}) > 1:
            raise InputError(
                f"{self.source}: expected the same number of points per person in every file, found {sorted(sizes)}"
            )
        if not self.detected:
            raise InputError(f"{self.source}: expected a person in some frame, found none in {len(self.points)} frames")

    def in_pixels(self, size: tuple[int, int] | None) -> tuple["DetectedPoints", str]:
        """Return the points in pixels of an image of `size`, width and height, and how they are scaled, if they are.

        Coordinates within 0 to 1, or −1 to 1, are fractions of the image's size, as of MediaPipe; OpenPose's
        keypoint_scale 3 and 4 differ by up to a pixel. Raises InputError for such coordinates without a size.
        """
        places = np.concatenate([person[:, :2] for person in self.detected])
        if not np.nanmax(np.abs(places)) <= _UNIT_RANGE:
            return self, ""
        if size is None:
            raise InputError(f"{self.source}: expected coordinates in pixels, found numbers up to 1")
        low = -1.0 if np.nanmean(places < 0.0) > 0.05 else 0.0
        factors = np.array(size) / (1.0 - low)
        scaled = [
            [np.hstack([(person[:, :2] - low) * factors, person[:, 2:]]) for person in frame] for frame in self.points
        ]
        return replace(self, points=tuple(scaled)), f"coordinates of {low:g} to 1 are scaled to {size[0]}×{size[1]} px"


def numbers_in_names(names: Iterable[str]) -> dict[str, int]:
    """Return the numbers of frames in file names, of those with a number.

    Of several numbers in a name it is the one that counts through all files without a gap; or else the last number that
    increases in `natural_order`; or else the last decimal fraction that does, times 1e9. If none does, the names have
    no number where their last ones all differ, such as the seconds of clock times, and otherwise their last one.
    Numbers have at most 63 bits.
    """
    digits = {name: found for name in names if (found := _NUMBER.findall(name))}
    order = [name for name, _ in natural_order(list(digits))]
    columns = _columns([list(map(int, digits[name])) for name in order])
    if not columns:
        return {name: int(numbers[-1]) for name, numbers in digits.items()}
    fractions = _columns([list(map(_billionths, _DECIMAL.findall(name))) for name in order])
    counting = [each for each in columns if len(set(each)) == len(each) == max(each) - min(each) + 1]
    rising = [each for each in (*fractions, *columns) if all(a < b for a, b in pairwise(each))]
    repeated = [each for each in columns[-1:] if len(set(each)) < len(each)]
    chosen = (counting or rising or repeated or [()])[-1]
    return {name: number for name, number in zip(order, chosen, strict=False) if number < _MAX_NUMBER}


def _columns(rows: Sequence[Sequence[int]]) -> list[tuple[int, ...]]:
    """Return the columns of rows of equal length, none where the lengths differ."""
    return list(zip(*rows, strict=True)) if len(set(map(len, rows))) == 1 else []


def _billionths(text: str) -> int:
    whole, _, fraction = text.partition(".")
    return int(whole + fraction[:9].ljust(9, "0"))


def _is_without_confidence(numbers: FloatArray) -> bool:
    """Return whether flat numbers are u, v alone: only then does a layout have as many, and as u, v, confidence some of
    their confidences would be too large, or all coordinates small."""
    size, is_large = numbers.size, numbers > _MAX_CONFIDENCE
    is_unlike = bool(is_large[2::3].any() or not is_large.any())
    return size % 2 == 0 and size // 2 in SIZES and not (size % 3 == 0 and size // 3 in SIZES) and is_unlike


def ordered_points(
    file: Path, names: Sequence[str], people: Sequence[list[FloatArray]], points: tuple[str, ...] = ()
) -> DetectedPoints:
    """Return the people of images by their names' numbers; InputError for a name without or with another's number."""
    numbers = numbers_in_names(names)
    if len(set(numbers.values())) < len(names):
        raise InputError(f"{file}: expected a different number in the name of every image")
    frames = np.array([numbers[name] for name in names], dtype=np.intp)
    order = np.argsort(frames)
    return DetectedPoints(str(file), frames[order], tuple(people[row] for row in order), points)


def keypoints_of(coordinates: Any) -> FloatArray:
    """Return points (K, 3) of coordinates u, v, confidence, flat or a row a point, or of u, v; NaN for missing ones.

    Flat numbers are without confidences if only then a layout has their number, and every third one is no confidence.
    """
    points = np.array(coordinates, dtype=np.float64)
    if (points.ndim == 2 and points.shape[1] == 2) or (points.ndim == 1 and _is_without_confidence(points)):
        points = np.column_stack([points.reshape(-1, 2), np.ones(points.size // 2)])
    points = points.reshape(-1, 3)
    if np.isinf(points).any():
        raise ValueError("numbers that are not finite")
    if (np.abs(points[:, :2]) > LARGEST_PX).any():
        raise ValueError(f"a coordinate beyond {LARGEST_PX:g} px")
    points[~(points[:, 2] > 0.0) | np.isnan(points).any(axis=1) | (points[:, :2] == 0.0).all(axis=1)] = np.nan
    points[:, 2] = np.minimum(points[:, 2], 1.0)
    return points
