"""Configurations that an earlier workbench recorded, in the words that datasets take today."""

import warnings
from collections.abc import Mapping
from typing import Any

_DATASETS = "workbench.datasets"
_VIDEOS = (f"{_DATASETS}.video.Video", f"{_DATASETS}.multi_view.MultiView")
_POINTS = f"{_DATASETS}.point_files.PointFiles"


def in_todays_words(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the same configuration with `n_frames` for a video's `last_frame`, and with `truth_first` for what
    `first_frame` was of files of points; a warning says so."""
    dataset = settings.get("dataset")
    if not isinstance(dataset, Mapping):
        return dict(settings)
    target, told = dataset.get("_target_"), dict(dataset)
    if target in _VIDEOS and "last_frame" in dataset:
        last = told.pop("last_frame")
        if isinstance(last, int):
            frames = last - int(told.get("first_frame") or 0) + 1
            fewer = told.get("n_frames")
            told["n_frames"] = frames if fewer is None else min(frames, fewer)
            warnings.warn(f"dataset.last_frame={last} is dataset.n_frames={told['n_frames']} today", stacklevel=2)
    elif target == _POINTS and "n_frames" not in dataset:  # which they took no part of
        first = told.pop("first_frame", 0)
        told["truth_first"] = -first
        if first:
            warnings.warn(f"dataset.first_frame={first} is dataset.truth_first={-first} today", stacklevel=2)
    return {**settings, "dataset": told}
