"""Times of a video's frames from the presentation timestamps of its file."""

import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.decode import frame_rate
from workbench.utils.errors import InputError
from workbench.utils.input_limits import check_rate

log = logging.getLogger(__name__)

_ROUNDING_S = 1.01e-3
"""Largest rounding of a timestamp: Matroska, WebM and FLV count milliseconds."""
_RATE_TOLERANCE = 0.02
"""Relative difference of two rates that is reported. 29.97 and 30 Hz differ by 0.001, 24 and 25 Hz by 0.04."""
_MAX_UNEVEN = 0.5
"""Largest deviation of even timestamps from a constant rate, in frames: a nearest frame is then the right one."""


@dataclass(frozen=True, eq=False)
class FrameTimes:
    """Times of the frames of one source, s, the first of which is 0.

    rate_hz: frame rate; the median rate of uneven frames. uneven_s: (F,), times of all frames from frame 0 on; None for
    a constant rate.
    """

    rate_hz: float
    uneven_s: FloatArray | None = None

    def at(self, frames: IntArray | int) -> FloatArray:
        """Return the times of frames by number; frames outside the source continue at `rate_hz`."""
        if self.uneven_s is None:
            return np.asarray(np.asarray(frames) / self.rate_hz, dtype=np.float64)
        inside = np.clip(frames, 0, len(self.uneven_s) - 1)
        return np.asarray(self.uneven_s[inside] + (frames - inside) / self.rate_hz, dtype=np.float64)

    def since(self, start: int, frames: IntArray) -> FloatArray:
        """Return the times of frames since the frame `start`."""
        if self.uneven_s is None:
            return self.at(frames - start)
        return self.at(frames) - self.at(start)


def is_equal(a: FrameTimes, b: FrameTimes) -> bool:
    """Return whether two sources have the same times, to the rounding of timestamps."""
    if a.uneven_s is None or b.uneven_s is None:
        return a.uneven_s is b.uneven_s and a.rate_hz == b.rate_hz
    n = min(len(a.uneven_s), len(b.uneven_s))
    return bool((np.abs(a.uneven_s[:n] - b.uneven_s[:n]) <= _ROUNDING_S).all())


def given_times(rate_hz: float) -> FrameTimes:
    """Return the times at a rate that is set; raises InputError for one that is not positive or out of bounds."""
    if not 0.0 < rate_hz < np.inf:
        raise InputError(f"video: rate_hz must be positive, found {rate_hz}")
    return FrameTimes(check_rate("video: rate_hz", rate_hz))


def rate_in_file(source: Path, times_s: FloatArray, rate_hz: float) -> float | None:
    """Return the rate, Hz, of a source's frames by its timestamps (F,), s, where `rate_hz` is set; None for images.

    It is `rate_hz` where that explains the timestamps to their rounding, else their mean rate; the header's where they
    do not increase. Timestamps more than half a frame from a constant rate are logged as a warning.
    """
    if (header_hz := frame_rate(source)) is None or len(times_s) < 2 or not (np.diff(times_s) > 0.0).all():
        return header_hz
    times_s = times_s - times_s[0]
    if (np.abs(times_s - np.arange(len(times_s)) / rate_hz) <= _ROUNDING_S).all():
        return rate_hz
    mean_hz = (len(times_s) - 1) / float(times_s[-1])
    if np.ptp(times_s * mean_hz - np.arange(len(times_s))) > 2.0 * _MAX_UNEVEN:
        intervals_ms = 1e3 * np.diff(times_s)
        log.warning(
            "%s: the file's times are uneven, %.1f to %.1f ms apart, %.4g Hz on average; rate_hz=%g assumes a constant "
            "rate, without it they are used",
            source, intervals_ms.min(), intervals_ms.max(), mean_hz, rate_hz,
        )  # fmt: skip
    return mean_hz


def frame_times(source: Path, times_s: FloatArray) -> FrameTimes:
    """Return the times of the frames of a source with timestamps (F,), s, of its first frames or all.

    Times are constant where they agree with a constant rate to the rounding of timestamps; then they are the frame's
    number over that rate. A header's rate that contradicts the timestamps is logged as a warning. Raises InputError for
    a source without a frame rate, such as a folder, and for a rate out of bounds.
    """
    header_hz = frame_rate(source)
    if header_hz is None:
        raise InputError(f"{source}: has no frame rate; set rate_hz")
    if len(times_s) < 2 or not (np.diff(times_s) > 0.0).all():
        if len(times_s) > 1 and np.ptp(times_s) > 0.0:
            log.warning("%s: timestamps do not increase; the header's rate of %g Hz is used", source, header_hz)
        return FrameTimes(check_rate(f"{source}: rate_hz", header_hz))
    times_s = times_s - times_s[0]
    mean_hz = check_rate(f"{source}: rate_hz", (len(times_s) - 1) / times_s[-1])
    for rate_hz in (header_hz, mean_hz):
        if (np.abs(times_s - np.arange(len(times_s)) / rate_hz) <= _ROUNDING_S).all():
            if abs(np.log(header_hz / rate_hz)) > _RATE_TOLERANCE:
                text = "%s: the header's rate is %g Hz, the timestamps' %.5g Hz, which is used"
                log.warning(text, source, header_hz, rate_hz)
            return FrameTimes(check_rate(f"{source}: rate_hz", rate_hz))
    intervals_s = np.diff(times_s)
    median_hz = float(1.0 / np.median(intervals_s))
    log.warning(
        "%s: frame intervals of %.1f to %.1f ms, %.4g Hz on average, %g Hz by the header; the file's times are used "
        "(rate_hz assumes a constant rate)",
        source, 1e3 * intervals_s.min(), 1e3 * intervals_s.max(), mean_hz, header_hz,
    )  # fmt: skip
    return FrameTimes(median_hz, times_s)
