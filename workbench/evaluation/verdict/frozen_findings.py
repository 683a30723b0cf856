"""Findings on detections that repeat from frame to frame: frozen stretches, and duplicated frames."""

from collections.abc import Iterator

from scipy.ndimage import find_objects, label

from workbench.evaluation.verdict.repeated_frames import frozen_frames, repeated_frames
from workbench.evaluation.verdict.run_measurements import RunMeasurements
from workbench.evaluation.verdict.time_findings import level_of_share
from workbench.utils.finding import NOTE, Finding

_MAX_DUPLICATES = 0.2
"""Fraction of the frames that may repeat the one before: with more, more than every fifth speed is zero. A film of
24 Hz at 30 Hz has a fifth."""


def frozen_findings(measured: RunMeasurements) -> Iterator[Finding]:
    """Yield frozen stretches and duplicated frames, by camera."""
    repeats, frozen = repeated_frames(measured.observed), frozen_frames(measured)
    for v, name in enumerate(measured.cameras):
        n, n_frozen = int(measured.observed.shows_person[:, v].sum()), int(frozen[:, v].sum())
        camera = f"{name}: " if len(measured.cameras) > 1 else ""
        if n and (level := level_of_share(1.0 - n_frozen / n)) != NOTE:
            stretches = [each for (each,) in find_objects(label(frozen[:, v])[0])]
            longest = max(stretches, key=lambda each: each.stop - each.start)
            first, last = measured.frames[longest.start - 1], measured.frames[longest.stop - 1]
            text = f"{camera}the keypoints of {n_frozen} of {n} frames are those of the frame before"
            yield Finding("frozen frames", f"{text}, frozen from frame {first} to {last}", level)
        n_duplicates = int(repeats[:, v].sum()) - n_frozen
        if n_duplicates > _MAX_DUPLICATES * n:
            text = f"{n_duplicates} of {n} frames repeat the keypoints of the one before: the source has a lower rate"
            yield Finding("repeated frames", f"{camera}{text}")
