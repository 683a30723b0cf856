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
    "workbench.inference.particles.annealed": "workbench.inference.smc.tempered_smc",
    "workbench.inference.particles.auxiliary": "workbench.inference.smc.bootstrap",
    "workbench.inference.particles.bootstrap": "workbench.inference.smc.bootstrap",
    "workbench.inference.particles.filter": "workbench.inference.smc.particle_filter",
    "workbench.inference.particles.gauss_newton": "workbench.inference.smc.gauss_newton",
    "workbench.inference.particles.guided": "workbench.inference.smc.hybrid",
    "workbench.inference.particles.partitioned": "workbench.inference.smc.partitioned",
    "workbench.inference.particles.restarting": "workbench.inference.smc.reinitializing",
    "workbench.inference.particles.smoothing": "workbench.inference.smc.smoothing",
    "workbench.inference.particles.tempered_smc": "workbench.inference.smc.tempered_smc",
    "workbench.inference.smc.annealed": "workbench.inference.smc.tempered_smc",
    "workbench.inference.smc.auxiliary": "workbench.inference.smc.bootstrap",
    "workbench.inference.start.limb_lengths": "workbench.inference.initialization.limb_lengths",
    "workbench.likelihoods.alignment.alignment": "workbench.likelihoods.dense.dense_alignment",
    "workbench.likelihoods.appearance": "workbench.likelihoods.cues.appearance",
    "workbench.likelihoods.background": "workbench.likelihoods.cues.background",
    "workbench.likelihoods.edges": "workbench.likelihoods.cues.edges",
    "workbench.likelihoods.silhouette": "workbench.likelihoods.cues.silhouette",
    "workbench.mocap.sources": "workbench.motion.sources",
    "workbench.studies.gaps": "workbench.studies.gap_errors",
    "workbench.studies.learning_alignment": "workbench.studies.walk_cycles",
    "workbench.studies.learning_period": "workbench.studies.walk_cycles",
    "workbench.studies.learning_walk": "workbench.studies.learning",
    "workbench.priors.flipping": "workbench.priors.kinematic_flips",
    "workbench.priors.following": "workbench.priors.fitted_rest",
    "workbench.priors.jitter": "workbench.priors.ar_offsets",
    "workbench.priors.partwise": "workbench.priors.factored",
}
"""Modules of targets that have moved."""
_ALIGNMENT = "workbench.likelihoods.dense.dense_alignment.DenseAlignment"
_IMAGE_MOTION = "workbench.likelihoods.image_motion.ImageMotion"
_CUES = "workbench.likelihoods.cues"
_PIXELS = {"k": "effective_pixels", "epsilon": "outlier_fraction"}
_CLASSES = {"workbench.likelihoods.dense.dense_alignment.Alignment": _ALIGNMENT}
"""Targets that have another name today."""
_REMOVED = (
    "workbench.priors.mixture.Mixture", "workbench.priors.mixture.Switching", "workbench.priors.factored.Partwise",
)  # fmt: skip
_CYCLE = {"start_coefficients": 0.3, "start_phase": 0.015}
_FIXED: dict[str, dict[str, Any]] = {
    "workbench.inference.ekf.iterated_ekf.Kalman": {"steps": 3, "guesses": 40},
    "workbench.inference.smc.tempered_smc.Annealed": {"power": 1.5, "shrink": 0.5},
    "workbench.inference.smc.reinitializing.Restarting": {"drop": 4.0, "patience": 3},
    "workbench.inference.synthesis.Synthesis": {"limit_deg": 25.0},
    "workbench.likelihoods.cues.appearance.Appearance": {"blur_px": 2.0**0.5, "seed": 0},
    "workbench.likelihoods.cues.background.Background": {"least_sigma": 3.0, "blur_px": 0.7, "seed": 0},
    "workbench.likelihoods.cues.silhouette.Silhouette": {"least_sigma": 3.0},
    _ALIGNMENT: {"blurs_px": [6.0, 3.0, 1.2], "outline": 0.25, "facing": 0.3},
    _IMAGE_MOTION: {"p_occluded": 0.01, "blur_px": 2.0**0.5, "seed": 0},
    "workbench.likelihoods.keypoints.KeypointLikelihood": {"nu": 4.0},
    "workbench.likelihoods.product.Product": {"device": "cpu"},
    "workbench.likelihoods.surface_points.SurfacePoints": {"range_m": 2.0},
    "workbench.priors.from_motions.activity": {
        "most_per_clip": 4, "start_coefficients": 0.5, "start_phase": 0.03, "start_position": 0.02,
        "start_rotation": 0.03, "start_velocity": 2.0,
    },
    "workbench.priors.from_motions.cyclic": _CYCLE,
    "workbench.priors.from_motions.gait": _CYCLE,
    "workbench.priors.from_motions.implicit": {
        "start_beta": 0.05, "start_position": 0.01, "start_rotation": 0.02, "start_angles": 0.02,
    },
    "workbench.priors.from_motions.linear": {"start_position": 0.03, "start_angles": 0.05},
    "workbench.priors.from_motions.walking": _CYCLE,
    "workbench.priors.smooth.Smooth": {"start_velocity": 3.0},
}  # fmt: skip
"""Keys that components no longer have, by target, with the value that is fixed today."""

_KEYS: dict[str, dict[str, str]] = {
    f"{_DATASETS}.video.Video": {"start_marks": "initial_annotations"},
    _ALIGNMENT: {"count": "pixel_weight", "rate": "learning_rate", "epsilon": "outlier_fraction"},
    f"{_CUES}.appearance.Appearance": {**_PIXELS, "rate": "learning_rate"},
    f"{_CUES}.background.Background": _PIXELS,
    f"{_CUES}.edges.Edges": {"k": "effective_responses"},
    f"{_CUES}.silhouette.Silhouette": {
        **_PIXELS, "rim_px": "dilation_px", "standing": "background_from_first_pose",
    },
    _IMAGE_MOTION: {**_PIXELS, "exponent": "reduction", "points": "sampling"},
    "workbench.likelihoods.keypoints.KeypointLikelihood": {
        "temper": "likelihood_power", "scale": "loss_scale", "which": "cameras",
    },
    "workbench.likelihoods.surface_points.SurfacePoints": {
        "epsilon": "outlier_fraction", "temper": "likelihood_power", "kind": "residual", "scale": "loss_scale",
        "shared_m": "common_bias_std_m",
    },
}  # fmt: skip
"""Keys of components that have another name today, by target: old and new."""
_VALUES: dict[str, dict[str, dict[Any, Any]]] = {
    _IMAGE_MOTION: {"background": {"still": "static"}, "sampling": {"spread": "regular", "drawn": "random"}},
}
"""Values of keys that have another name today, by target and today's key: old and new."""
_OPTIONS = {"likelihood": {"alignment": "dense_alignment"}}
"""Options that have another name today, by group: old and new."""


def in_todays_words(path: Path, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the configuration with today's keys; a warning names each key whose value changes.

    Targets, keys and values get the names they have today, a video's `last_frame` becomes `n_frames`, the `first_frame`
    of files of points becomes `truth_first`, and keys whose values are fixed today are removed.

    Parameters
    ----------
    path : the recording, for messages.
    settings : the recorded configuration.

    Raises
    ------
    InputError : a component that is none any more, or another value than the one that is fixed today.
    """
    today = {key: _today(path, key, value) for key, value in settings.items()}
    if isinstance(dataset := today.get("dataset"), Mapping):
        today["dataset"] = _dataset(dataset)
    return today


def _today(path: Path, place: str, value: Any) -> Any:
    """Return a part of a configuration with today's targets and keys."""
    if isinstance(value, list):
        return [_today(path, f"{place}.{k}", item) for k, item in enumerate(value)]
    if not isinstance(value, Mapping):
        return value
    today = {key: _today(path, f"{place}.{key}", item) for key, item in value.items()}
    if not isinstance(recorded := today.get("_target_"), str):
        return today
    module, _, name = recorded.rpartition(".")
    target = f"{_MODULES.get(module, module)}.{name}"
    today["_target_"] = target = _CLASSES.get(target, target)
    if target in _REMOVED:
        raise InputError(f"{path}: {place}._target_: {recorded} is no component any more; choose another one")
    for key, fixed in _FIXED.get(target, {}).items():
        if (found := today.pop(key, None)) not in (fixed, None):
            raise InputError(
                f"{path}: {place}.{key}: expected {fixed}, which is fixed today, found {found!r}; run its experiment "
                "again without this key"
            )
    renamed = _KEYS.get(target, {})
    today = {renamed.get(key, key): item for key, item in today.items()}
    for key, values in _VALUES.get(target, {}).items():
        if key in today and not isinstance(today[key], list | dict):
            today[key] = values.get(today[key], today[key])
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
