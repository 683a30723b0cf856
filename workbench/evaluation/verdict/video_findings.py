"""Findings on the images of a video: cuts of an edited film, and images that repeat the one before."""

from collections.abc import Iterator, Mapping

from workbench.utils.finding import DOUBTFUL, NOT_USABLE, NOTE, Finding

_MAX_FROZEN = 0.6
"""Fraction of the frames, from which on most of the motion is not shown."""
_MIN_REPEATED = 0.1
"""Fraction of the frames: a film of 25 images a second repeats every sixth image in a video of 30 Hz."""


def video_findings(input_counts: Mapping[str, int]) -> Iterator[Finding]:
    """Yield the findings on a video's images. input_counts: as of `SequenceInfo`."""
    if n_cuts := input_counts.get("cuts", 0):
        first, last = input_counts["part_first"], input_counts["part_last"]
        text = f"{n_cuts} cuts of the video" if n_cuts > 1 else f"a cut at frame {input_counts['first_cut']}"
        yield Finding("cut", f"{text}: the person is followed from frame {first} to {last}", NOTE)
    repeated, frozen = (input_counts.get(name, 0) for name in ("frames_repeated", "frames_frozen"))
    n = input_counts.get("frames", 0) - input_counts.get("frames_unseen", 0)
    if frozen:
        level = NOT_USABLE if frozen > _MAX_FROZEN * n else DOUBTFUL
        yield Finding("frozen images", f"the video is frozen in {frozen} of {n} frames, without any motion", level)
    elif repeated >= _MIN_REPEATED * max(n, 1):
        text = f"{repeated} of {n} images repeat the one before: fewer images a second than frames"
        yield Finding("frame-rate mismatch", text, NOTE)
