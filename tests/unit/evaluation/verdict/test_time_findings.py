"""Findings on missing, repeated and lost frames, and their thresholds on both sides."""

import re
from dataclasses import replace

import numpy as np
import pytest
from verdict_scenes import RATE_HZ, N, scene

ONE, TWO, FOUR = scene(1), scene(2), scene(4)


def kinds(intact):
    """Return the messages of a scene's findings by kind."""
    return {finding.kind: finding.message for finding in intact.verdict().findings}


def with_counts(intact, **counts):
    """Return the scene with counts of 100 frames of a video."""
    return replace(intact, inputs=replace(intact.inputs, input_counts={"people": 2, "frames": 100} | counts))


def rows(intact, chosen):
    """Return the scene with some of the frames alone."""
    points = intact.keypoints[:, chosen]
    return replace(intact, keypoints=points, poses=intact.poses[chosen], times_s=intact.times_s[chosen])


@pytest.mark.parametrize(
    ("unseen", "lost", "level"),
    [(0, 0, "trustworthy"), (60, 0, "trustworthy"), (20, 20, "trustworthy"), (21, 21, "doubtful"),
     (50, 12, "trustworthy"), (60, 60, "doubtful"), (61, 61, "not usable")],
)  # fmt: skip
def test_frames_in_which_the_person_is_lost_lower_the_verdict(unseen, lost, level):
    verdict = with_counts(ONE, frames_unseen=unseen, frames_lost=lost, frames_empty=unseen // 2).verdict()
    assert verdict.level == level
    text = f"tracked in {100 - unseen} of 100 frames of the video"
    if unseen:
        text += f" (a person is detected in {100 - unseen // 2}, this person in {100 - unseen}; 60 are used)"
    assert verdict.message.endswith(text)
    assert (f"the person is lost in {lost} of the {100 - unseen + lost} frames" in verdict.message) == (lost > 20)


def test_frames_with_a_lost_estimate_are_not_tracked():
    keypoints = ONE.keypoints.copy()
    keypoints[:, 20:50, :, 0] += 100.0
    verdict = with_counts(replace(ONE, keypoints=keypoints), frames=60).verdict()
    n = verdict.states.count("lost")
    assert n > 20
    assert f"tracked in {60 - n} of 60 frames of the video" in verdict.message
    assert f"the person is lost in {n} of the 60 frames" in verdict.message


@pytest.mark.parametrize(("margin", "level"), [(0.24, "trustworthy"), (0.26, "doubtful")])
@pytest.mark.parametrize("end", ["before", "after"])
def test_a_person_enters_and_leaves_through_the_images_edge(end, margin, level):
    keypoints, (camera,) = ONE.keypoints[0, ..., :2], ONE.cameras
    row = keypoints[0 if end == "before" else -1]
    to_edge = row[:, 0].min() - margin * np.ptp(row[:, 1])
    moved = camera.matrix - [[0, 0, to_edge], [0, 0, 0], [0, 0, 0]]
    shifted = replace(ONE, keypoints=ONE.keypoints - [to_edge, 0.0, 0.0], cameras=(replace(camera, matrix=moved),))
    appearing = with_counts(shifted, frames_unseen=40, **{f"frames_{end}": 40})
    lost = [finding.level for finding in appearing.verdict().findings if finding.kind == "person lost"]
    assert (lost or ["trustworthy"]) == [level]


def test_a_person_inside_of_two_images_cannot_leave():
    assert "person lost" in kinds(with_counts(FOUR, frames_unseen=40, frames_after=40))


@pytest.mark.parametrize("intact", [ONE, FOUR])
@pytest.mark.parametrize(("n_missing", "is_gap"), [(6, False), (7, True), (25, True)])
def test_a_gap_in_frames_or_keypoints_is_reported(intact, n_missing, is_gap):
    seconds = f"{n_missing / RATE_HZ:.2g}"
    for first in (0, 20, N - n_missing):
        keypoints, last = intact.keypoints.copy(), first + n_missing - 1
        keypoints[:, first : last + 1] = np.nan
        message = kinds(replace(intact, keypoints=keypoints)).get("missing frames or jumps", "")
        assert re.findall(r"[0-9.]*[0-9]", message) == [f"{first}", f"{last}", seconds] * is_gap
    omitted = rows(intact, np.delete(np.arange(N), np.arange(20, 20 + n_missing)))
    assert (f"{seconds} s" in kinds(omitted).get("missing frames or jumps", "")) == is_gap


def test_the_longest_gap_is_named():
    keypoints = ONE.keypoints.copy()
    keypoints[:, [*range(7), *range(20, 40)]] = np.nan
    message = kinds(replace(ONE, keypoints=keypoints))["missing frames or jumps"]
    assert message == "no keypoints in frames 20 to 39, 0.8 s, and 1 shorter"
    paused = kinds(replace(ONE, times_s=ONE.times_s + (np.arange(N) > 29)))["missing frames or jumps"]
    assert re.findall(r"[0-9]+", paused) == ["29", "1"]  # no frame is missing between frame 29 and the next one


def frozen(intact, frames, v=slice(None), error_px=0.0):
    """Return the scene with the keypoints of the frame before in some frames, with an error."""
    keypoints = intact.keypoints.copy()
    for t in frames:
        keypoints[v, t] = keypoints[v, t - 1] + [error_px * (-1) ** t, 0.0, 0.0]
    return replace(intact, keypoints=keypoints)


@pytest.mark.parametrize(
    ("n_frozen", "level"),
    [(6, ""), (12, ""), (13, "doubtful"), (36, "doubtful"), (37, "not usable"), (59, "not usable")],
)
def test_frozen_keypoints_lower_the_verdict(n_frozen, level):
    verdict = frozen(ONE, range(1, 1 + n_frozen)).verdict()
    levels = {finding.kind: finding.level for finding in verdict.findings}
    assert levels.get("frozen frames", "") == level
    if level:
        text = (
            f"the keypoints of {n_frozen} of 60 frames are those of the frame before, frozen from frame 0 to {n_frozen}"
        )
        assert text in verdict.message


def test_a_frozen_camera_of_several_is_named():
    assert kinds(frozen(FOUR, range(20, 50), v=2))["frozen frames"].startswith("c2: ")


@pytest.mark.parametrize(("error_px", "is_frozen"), [(0.009, True), (0.011, False)])
def test_a_still_person_is_not_frozen(error_px, is_frozen):
    assert ("frozen frames" in kinds(frozen(ONE, range(20, 50), error_px=error_px))) == is_frozen


@pytest.mark.parametrize(("length", "is_frozen"), [(6, False), (7, True)])
def test_short_stretches_repeat_and_long_ones_freeze(length, is_frozen):
    """Stretches of 0.24 s and 0.28 s, with one new frame between them."""
    found = kinds(frozen(ONE, [t for t in range(1, N) if t % (length + 1)]))
    assert ("frozen frames" in found, "repeated frames" in found) == (is_frozen, not is_frozen)


@pytest.mark.parametrize(("n_repeated", "is_finding"), [(12, False), (13, True), (30, True)])
def test_duplicated_frames_are_reported(n_repeated, is_finding):
    assert ("repeated frames" in kinds(frozen(ONE, range(1, 2 * n_repeated, 2)))) == is_finding
