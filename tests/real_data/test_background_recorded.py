"""The background of the demonstration video: the marked woman is no part of it."""

import numpy as np
import pytest

from workbench.core.frame_cache import FrameCache
from workbench.datasets.video import Video
from workbench.likelihoods.cues.image_levels import log_ratio, still_scenes


@pytest.mark.slow  # it decodes a hundred frames
def test_the_woman_is_foreground_and_the_rest_is_not(data):
    folder = data / "sports2d_walk"
    files = {"eval_marks": str(folder / "keypoints.csv"), "first_frame": 64, "n_frames": 97, "scale": 0.5}
    video = Video(str(folder / "demo.mp4"), str(folder / "Calib_demo.toml"), **files)
    scenes = still_scenes(FrameCache(video), 60, 0.7, 3.0)
    shares = []
    for frame in video.frames():
        if frame.truth is None:
            continue
        ratio = log_ratio(frame.views[0], scenes, 0.7, 0.05)
        marks = frame.truth.marks[np.isfinite(frame.truth.marks).all(axis=1)]
        column, row = np.rint(marks).astype(int).T
        away = np.ones(ratio.shape, dtype=bool)
        low, high = np.maximum(marks.min(axis=0) - 60, 0).astype(int), marks.max(axis=0).astype(int) + 60
        away[low[1] : high[1], low[0] : high[0]] = False
        shares.append([(ratio[row, column] > 0.0).mean(), (ratio[away] > 0.0).mean()])
    woman, rest = np.mean(shares, axis=0)
    assert woman > 0.7  # joints lie on her, though some on what looks like the wall behind
    assert rest < 0.05  # the share of outliers that the background is given
