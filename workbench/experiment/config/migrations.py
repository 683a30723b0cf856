"""Configurations that an earlier workbench recorded, in the keys that components have today."""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from workbench.utils.errors import InputError

_DATASETS = "workbench.datasets"
_VIDEOS = (f"{_DATASETS}.video.Video", f"{_DATASETS}.multi_view.MultiView")
_POINTS = f"{_DATASETS}.point_files.PointFiles"
_MODULES = {
    "workbench.inference.fit.frame_by_frame": "workbench.inference.least_squares.frame_by_frame",
    "workbench.inference.fit.least_squares": "workbench.inference.least_squares.least_squares",
    "workbench.inference.fit.motion_fit": "workbench.inference.least_squares.motion_fit",
    "workbench.inference.fit.smooth_fit": "workbench.inference.least_squares.smooth_fit",
    "workbench.inference.kalman.filter": "workbench.inference.ekf.iterated_ekf",
    "workbench.inference.particles.annealed": "workbench.inference.smc.annealed",
    "workbench.inference.particles.auxiliary": "workbench.inference.smc.auxiliary",
    "workbench.inference.particles.bootstrap": "workbench.inference.smc.bootstrap",
    "workbench.inference.particles.filter": "workbench.inference.smc.particle_filter",
    "workbench.inference.particles.gauss_newton": "workbench.inference.smc.gauss_newton",
    "workbench.inference.particles.guided": "workbench.inference.smc.hybrid",
    "workbench.inference.particles.partitioned": "workbench.inference.smc.partitioned",
    "workbench.inference.particles.restarting": "workbench.inference.smc.reinitializing",
    "workbench.inference.particles.smoothing": "workbench.inference.smc.smoothing",
    "workbench.inference.particles.tempered_smc": "workbench.inference.smc.tempered_smc",
    "workbench.inference.start.limb_lengths": "workbench.inference.initialization.limb_lengths",
    "workbench.likelihoods.alignment.alignment": "workbench.likelihoods.dense.dense_alignment",
    "workbench.likelihoods.appearance": "workbench.likelihoods.cues.appearance",
    "workbench.likelihoods.background": "workbench.likelihoods.cues.background",
    "workbench.likelihoods.edges": "workbench.likelihoods.cues.edges",
    "workbench.likelihoods.silhouette": "workbench.likelihoods.cues.silhouette",
    "workbench.mocap.sources": "workbench.motion.sources",
    "workbench.priors.flipping": "workbench.priors.kinematic_flips",
    "workbench.priors.following": "workbench.priors.fitted_rest",
    "workbench.priors.jitter": "workbench.priors.ar_offsets",
    "workbench.priors.partwise": "workbench.priors.factored",
}
"""Modules of targets that have moved."""
_REMOVED: Mapping[str, Mapping[str, object]] = {
    "workbench.likelihoods.product.Product": {"device": "cpu"},
}
"""Keys that components have no more, by target, with the one value that holds today; null stands for it."""


def in_todays_words(path: Path, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the configuration with today's keys; a warning names each key whose value changes.

    Targets get the modules they are in today, a video's `last_frame` becomes `n_frames`, the `first_frame` of files of
    points becomes `truth_first`, and keys that components have no more are removed. path: of the recording, for
    messages. Raises InputError for a removed key with another value than the one that holds today.
    """
    today = {key: _without_removed(path, key, _moved_targets(value)) for key, value in settings.items()}
    if isinstance(dataset := today.get("dataset"), Mapping):
        today["dataset"] = _dataset(dataset)
    return today


def _moved_targets(value: Any) -> Any:
    """Replace the modules of all targets in a part of a configuration by today's."""
    if isinstance(value, list):
        return [_moved_targets(item) for item in value]
    if not isinstance(value, Mapping):
        return value
    moved = {key: _moved_targets(item) for key, item in value.items()}
    module, _, name = str(moved.get("_target_", "")).rpartition(".")
    return moved | ({"_target_": f"{_MODULES[module]}.{name}"} if module in _MODULES else {})


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


def _without_removed(path: Path, place: str, value: Any) -> Any:
    """Remove the keys that components have no more from a part of a configuration."""
    if not isinstance(value, Mapping):
        return value
    found = {key: _without_removed(path, f"{place}.{key}", item) for key, item in value.items()}
    for key, today in _REMOVED.get(str(found.get("_target_")), {}).items():
        if (recorded := found.pop(key, None)) not in (today, None):
            raise InputError(
                f"{path}: {place}.{key}: expected {today}, the only value that holds today, found {recorded!r}; "
                "run its experiment again without this key"
            )
    return found
