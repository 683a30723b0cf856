"""Configurations that an earlier workbench recorded, in the keys that components have today."""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from workbench.errors import InputError

_DATASETS = "workbench.datasets"
_VIDEOS = (f"{_DATASETS}.video.Video", f"{_DATASETS}.multi_view.MultiView")
_POINTS = f"{_DATASETS}.point_files.PointFiles"
_PRODUCT = "workbench.likelihoods.product.Product"


def in_todays_words(path: Path, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the configuration with today's keys; a warning names each key whose value changes.

    A video's `last_frame` becomes `n_frames`, the `first_frame` of files of points becomes `truth_first`, and a
    product's `device` is removed.

    Parameters
    ----------
    path : the recording, for messages.
    settings : the recorded configuration.

    Raises
    ------
    InputError : a product computed on another device than the CPU.
    """
    today = {key: _on_the_cpu(path, key, value) for key, value in settings.items()}
    if isinstance(dataset := today.get("dataset"), Mapping):
        today["dataset"] = _dataset(dataset)
    return today


def _dataset(recorded: Mapping[str, Any]) -> dict[str, Any]:
    target, dataset = recorded.get("_target_"), dict(recorded)
    if target in _VIDEOS and "last_frame" in dataset:
        last = dataset.pop("last_frame")
        if isinstance(last, int):
            frames = last - int(dataset.get("first_frame") or 0) + 1
            fewer = dataset.get("n_frames")
            dataset["n_frames"] = frames if fewer is None else min(frames, fewer)
            warnings.warn(f"dataset.last_frame={last} is dataset.n_frames={dataset['n_frames']} today", stacklevel=3)
    elif target == _POINTS and "n_frames" not in dataset:  # which they took no part of
        first = dataset.pop("first_frame", 0)
        dataset["truth_first"] = -first
        if first:
            warnings.warn(f"dataset.first_frame={first} is dataset.truth_first={-first} today", stacklevel=3)
    return dataset


def _on_the_cpu(path: Path, place: str, value: Any) -> Any:
    """Remove `device` from every product in a part of a configuration."""
    if not isinstance(value, Mapping):
        return value
    found = {key: _on_the_cpu(path, f"{place}.{key}", item) for key, item in value.items()}
    if found.get("_target_") == _PRODUCT and (device := found.pop("device", None)) not in ("cpu", None):
        raise InputError(
            f"{path}: {place}.device: expected cpu, the only device of the workbench's own likelihoods, found "
            f"{device!r}; run its experiment again without this key"
        )
    return found
