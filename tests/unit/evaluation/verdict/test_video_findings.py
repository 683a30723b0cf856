"""Findings on cuts and repeated images, and their thresholds from both sides."""

from dataclasses import replace

import pytest
from verdict_scenes import scene

from workbench.utils.finding import DOUBTFUL, NOT_USABLE, TRUSTWORTHY

ONE = scene(1)
FRAMES = {"people": 1, "frames": 100, "frames_unseen": 0, "frames_lost": 0}


def verdict(**counts):
    return replace(ONE, inputs=replace(ONE.inputs, input_counts=FRAMES | counts)).verdict()


@pytest.mark.parametrize(
    ("n", "text"),
    [
        (1, "a cut at frame 120: the person is followed from frame 30 to 119"),
        (3, "3 cuts of the video: the person is followed from frame 30 to 119"),
    ],
)
def test_a_cut_is_a_finding_without_a_judgement(n, text):
    found = verdict(cuts=n, first_cut=120, part_first=30, part_last=119)
    assert found.level == TRUSTWORTHY
    assert text in found.message
    assert text in {finding["message"] for finding in found.as_dict["findings"] if finding["kind"] == "cut"}


@pytest.mark.parametrize(("frozen", "level"), [(0, TRUSTWORTHY), (1, DOUBTFUL), (60, DOUBTFUL), (61, NOT_USABLE)])
def test_a_frozen_video_is_doubtful_and_one_of_mostly_frozen_frames_not_usable(frozen, level):
    found = verdict(frames_repeated=frozen, frames_frozen=frozen)
    assert found.level == level
    assert (f"frozen in {frozen} of 100 frames" in found.message) == (frozen > 0)


@pytest.mark.parametrize(
    ("repeated", "frozen", "is_reported"), [(9, 0, False), (10, 0, True), (50, 0, True), (50, 20, False)]
)
def test_images_that_are_shown_twice_are_a_remark_on_the_rate(repeated, frozen, is_reported):
    found = verdict(frames_repeated=repeated, frames_frozen=frozen)
    assert ("repeat the one before" in found.message) == is_reported
    assert frozen or found.level == TRUSTWORTHY
