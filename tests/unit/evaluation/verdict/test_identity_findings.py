"""Findings on another person who replaces the first one, and their thresholds on both sides."""

from dataclasses import replace

import numpy as np
import pytest
from verdict_scenes import BODY, RATE_HZ, N, scene, walk

from workbench.body.kinematics import joints
from workbench.evaluation.verdict.identity_findings import another_person

LATE = np.arange(N) >= 30


def message(intact):
    """Return the message of the scene's finding on the person's identity, "" without one."""
    return next((each.message for each in intact.verdict().findings if each.kind == "change of person"), "")


def grown(n_cameras, factor, rate_hz=RATE_HZ, late=LATE):
    """Return the scene of a person who is larger by a factor, about the middle of the feet, from frame 30 on."""
    intact, places = scene(n_cameras, sigma_px=0.0), joints(BODY.skeleton, walk())
    if n_cameras == 1:
        pixels = intact.keypoints[..., :2].copy()
        feet = pixels[:, :, [11, 14]].mean(axis=2, keepdims=True)
        pixels[:, late] = (feet + factor * (pixels - feet))[:, late]
    else:
        feet = places[:, [11, 14]].mean(axis=1, keepdims=True)
        places[late] = (feet + factor * (places - feet))[late]
        pixels = np.array([camera.project(places) for camera in intact.cameras])
    keypoints = np.concatenate([pixels, np.ones_like(pixels[..., :1])], axis=-1)
    inputs = replace(intact.inputs, rate_hz=rate_hz)
    return replace(intact, keypoints=keypoints, times_s=np.arange(N) / rate_hz, inputs=inputs)


@pytest.mark.parametrize(
    ("n_cameras", "factor", "is_other"),
    [(1, 1.0, False), (1, 1.15, False), (1, 1.4, True), (1, 0.7, True), (4, 1.0, False), (4, 1.07, False),
     (4, 1.13, True), (4, 0.87, True)],
)  # fmt: skip
def test_a_sudden_change_of_size_is_another_person(n_cameras, factor, is_other):
    """In the image, the posture of the walker changes lengths by up to 10 %."""
    text = message(grown(n_cameras, factor))
    assert ("from frame 3" in text or "from frame 2" in text) == is_other
    assert bool(text) == is_other
    if is_other:
        assert ("larger" if factor > 1.0 else "smaller") in text


@pytest.mark.parametrize("n_cameras", [1, 4])
def test_a_clip_of_a_few_frames_shows_no_change(n_cameras):
    intact = grown(n_cameras, 1.4)
    short = replace(intact, keypoints=intact.keypoints[:, 28:32], poses=intact.poses[28:32], times_s=intact.times_s[:4])
    assert not message(short)


@pytest.mark.parametrize("factor", [0.7, 1.4])
def test_the_first_person_returns_with_the_opposite_change(factor):
    """The person of other size stands between frames 20 and 40; with a second change of equal sign, until the end."""
    between = (np.arange(N) >= 20) & (np.arange(N) < 40)
    once = grown(1, factor, late=between)
    assert another_person(once.measurements()).nonzero()[0][[0, -1]] == pytest.approx([20, 39], abs=3)
    assert np.diff(another_person(once.measurements()).nonzero()[0]).max() == 1
    keypoints = np.where((np.arange(N) < 40)[:, None, None], once.keypoints, grown(1, factor**3).keypoints)
    twice = replace(once, keypoints=keypoints)
    assert message(twice).split("frame ")[1][:2] in ("38", "39", "40", "41", "42")  # the larger of the two changes
    twice = another_person(twice.measurements())
    assert twice.nonzero()[0] == pytest.approx(np.arange(twice.argmax(), N))
    assert twice.argmax() == pytest.approx(20, abs=3)
