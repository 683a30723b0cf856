"""Key frames, closed tracks and lost backgrounds, at the boundaries of their thresholds."""

import cv2
import numpy as np
import pytest

from workbench.cameras import background_tracks
from workbench.cameras.background_tracks import track_background

WIDTH, HEIGHT = 480, 270
NO_PEOPLE = np.empty((0, 22, 3))


def texture(seed, width=WIDTH):
    """Return a grey image of blobs."""
    noise = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=(HEIGHT, width)), (0, 0), 2.5)
    return np.clip(128.0 + 40.0 * noise / noise.std(), 0, 255).astype(np.uint8)


def tracks(images):
    return track_background(images, [NO_PEOPLE] * len(images))


@pytest.mark.parametrize(("moved", "is_next"), [(0.36, False), (0.44, True)])
def test_the_next_key_frame_begins_when_less_than_three_fifths_of_the_corners_are_in_the_image(moved, is_next):
    wide, step, n = texture(0, 2 * WIDTH), 12, round(moved * WIDTH / 12)
    keys = tracks([wide[:, min(t, n) * step :][:, :WIDTH] for t in range(n + 3)]).keys
    assert keys[n // 2] == 0
    assert (keys[-1] > 0) == is_next


@pytest.mark.parametrize(("missed_px", "is_valid"), [(0.45, True), (0.55, False)])
def test_a_corner_that_misses_its_place_by_half_a_pixel_is_no_track(missed_px, is_valid, monkeypatch):
    """Tracked to the next image each corner moves by 3 px, and back by as much but for what it misses."""
    shifts = [np.array([3.0, 0.0]), np.array([-3.0 + missed_px, 0.0])]

    def flow(before, after, start, guess):
        return start + shifts.pop(0), np.ones(len(start), bool)

    monkeypatch.setattr(background_tracks, "_flow", flow)
    assert (tracks([texture(1)] * 2).keys[1] == 0) == is_valid


@pytest.mark.parametrize(("share", "is_found"), [(0.28, True), (0.22, False)])
def test_a_quarter_of_the_corners_must_be_found_again(share, is_found, monkeypatch):
    """The flow moves all corners by 3 px, and back, but finds every share-th of them only."""

    def flow(before, after, start, guess):
        found = np.floor(share * np.arange(1, len(start) + 1)) > np.floor(share * np.arange(len(start)))
        return start + shifts.pop(0), found

    shifts = [np.array([3.0, 0.0]), np.array([-3.0, 0.0])]
    monkeypatch.setattr(background_tracks, "_flow", flow)
    found = tracks([texture(2)] * 2)
    assert found.keys[1] == (0 if is_found else -1)
    assert found.lost == (0.0 if is_found else 0.5)
