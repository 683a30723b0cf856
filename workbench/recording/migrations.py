"""Translate configurations recorded by earlier versions to today's names."""

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
_EKF = "workbench.inference.ekf.iterated_ekf.IteratedEkf"
_REINITIALIZING = "workbench.inference.smc.reinitializing.Reinitializing"
_CLASSES = {
    "workbench.inference.ekf.iterated_ekf.Kalman": _EKF,
    "workbench.inference.smc.reinitializing.Restarting": _REINITIALIZING,
    "workbench.likelihoods.dense.dense_alignment.Alignment": _ALIGNMENT,
    "workbench.priors.ar_offsets.Jitter": "workbench.priors.ar_offsets.AROffsets",
    "workbench.priors.fitted_rest.Following": "workbench.priors.fitted_rest.FittedRest",
    "workbench.priors.kinematic_flips.Flipping": "workbench.priors.kinematic_flips.KinematicFlips",
}
"""Targets that have another name today."""
_REMOVED = (
    "workbench.priors.mixture.Mixture", "workbench.priors.mixture.Switching", "workbench.priors.factored.Partwise",
)  # fmt: skip
_CYCLE = {"start_coefficients": 0.3, "start_phase": 0.015}
_FIXED: dict[str, dict[str, Any]] = {
    _EKF: {"steps": 3, "guesses": 40},
    "workbench.inference.smc.tempered_smc.Annealed": {"power": 1.5, "shrink": 0.5},
    _REINITIALIZING: {"drop": 4.0, "patience": 3},
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

_OPTIONS: dict[str, dict[str, str]] = {
    "inference": {"kalman": "iterated_ekf", "restarting": "reinitializing"},
    "likelihood": {"alignment": "dense_alignment"},
    "prior": {
        "flipping": "kinematic_flips", "following": "fitted_rest", "following_implicit": "fitted_rest_implicit",
        "jitter": "ar_offsets", "jitter_gait": "ar_offsets_gait",
    },
}  # fmt: skip
"""Options that have another name today, by group: old and new."""
_COLUMNS = {"_jitter": "_offset"}
"""Suffixes of columns of states and of recorded curves that have another name today: old and new."""
_SMC, _PRIORS = "workbench.inference.smc", "workbench.priors"
_LEARNED = {
    "leave_out": "exclude", "start_position": "initial_position_std", "start_rotation": "initial_rotation_std",
}  # fmt: skip
_SCENE = {"departures": "perturbations", "view_deg": "view_azimuth_deg"}
_KEYS: dict[str, dict[str, str]] = {
    _EKF: {
        "flatten": "curvature_weight", "postures": "pose_prior_power", "sudden": "outlier_motion_probability",
        "widen": "std_inflation",
    },
    f"{_SMC}.bootstrap.Auxiliary": {"flatten": "first_stage_power"},
    f"{_SMC}.gauss_newton.GaussNewton": {
        "flatten": "curvature_weight", "share": "proposal_fraction", "steps": "n_newton_steps",
    },
    f"{_SMC}.hybrid.Hybrid": {"share": "proposal_fraction", "widen": "std_inflation"},
    f"{_SMC}.particle_filter.ParticleFilter": {"move": "algorithm"},
    f"{_SMC}.partitioned.Partitioned": {"flatten": "intermediate_power", "parts": "partitions"},
    _REINITIALIZING: {"share": "reinitialized_fraction"},
    f"{_SMC}.smoothing.BackwardSimulation": {
        "least_ancestors": "min_effective_ancestors", "moves": "n_mcmc_steps",
    },
    f"{_SMC}.smoothing.FixedLag": {"least_ancestors": "min_effective_ancestors"},
    f"{_SMC}.tempered_smc.TemperedSMC": {"moves": "n_mcmc_steps"},
    "workbench.studies.dimension.ParticlesByDimension": {"n_most": "max_particles", "off": "tolerance_std"},
    "workbench.studies.learning_activities.LearnWalkRun": {"leave_out": "exclude", "most_per_clip": "max_per_clip"},
    "workbench.studies.walk_cycles.PeriodSnr": {"missing": "missing_fraction"},
    "workbench.datasets.person.of_height": {"feet": "neck_and_feet", "lengths": "limb_lengths_m"},
    f"{_DATASETS}.multi_view.MultiView": {
        "camera": "calibration_file", "which": "cameras", "truth_first": "truth_first_frame",
    },
    _POINTS: {"most_points": "max_points", "start": "initialization", "truth_first": "truth_first_frame"},
    f"{_DATASETS}.points.Points": {
        **_SCENE, "bar_m": "occluder_width_m", "clutter": "n_clutter_points", "outliers": "outlier_fraction",
        "start": "initialization",
    },
    f"{_DATASETS}.stereo.Stereo": {**_SCENE, "noise": "noise_std", "start": "initialization"},
    f"{_DATASETS}.synthetic.Synthetic": {
        **_SCENE, "camera": "calibration_file", "feet": "neck_and_feet", "noise": "noise_std",
    },
    f"{_DATASETS}.video.Video": {
        "camera": "calibration_file", "eval_marks": "eval_annotations", "held_out": "eval_frames",
        "hidden_weight": "occluded_weight", "start_last": "initial_last_frame", "start_marks": "initial_annotations",
        "which": "camera_name",
    },
    "workbench.inference.least_squares.least_squares.LeastSquares": {"most_points": "max_points"},
    "workbench.inference.synthesis.Synthesis": {"smoothing_s": "blend_time_s"},
    f"{_PRIORS}.ar_offsets.AROffsets": {"keep": "ar_coefficient"},
    f"{_PRIORS}.from_motions.activity": {"leave_out": "exclude"},
    f"{_PRIORS}.from_motions.cyclic": {**_LEARNED, "q": "n_components", "missing": "missing_fraction"},
    f"{_PRIORS}.from_motions.gait": _LEARNED,
    f"{_PRIORS}.from_motions.implicit": {
        "leave_out": "exclude", "root": "include_root", "length": "window_frames", "epsilon": "tail_probability",
        "reweight": "importance_correction", "pull": "blend_rate", "inertia": "velocity_noise_fraction",
    },
    f"{_PRIORS}.from_motions.linear": {"leave_out": "exclude", "noise": "noise_scale"},
    f"{_PRIORS}.from_motions.walking": _LEARNED,
    f"{_PRIORS}.kinematic_flips.KinematicFlips": {"share": "proposal_fraction"},
    f"{_PRIORS}.smooth.Smooth": {
        "lowest": "lower", "highest": "upper", "start_pose": "initial_pose_scale", "start_uniform": "initial_uniform",
    },
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
_INITIALIZATION = {"initialization": {"given": "perturbed_truth"}}
_VALUES: dict[str, dict[str, dict[Any, Any]]] = {
    _POINTS: _INITIALIZATION,
    f"{_DATASETS}.points.Points": _INITIALIZATION,
    f"{_DATASETS}.stereo.Stereo": _INITIALIZATION,
    _IMAGE_MOTION: {"background": {"still": "static"}, "sampling": {"spread": "regular", "drawn": "random"}},
}
"""Values of keys that have another name today, by target and today's key: old and new."""
_INVERSES = {"exact": "perturb"}
"""Flags that today's key inverts, of the targets in _SCENES: old and new."""
# The recorded property `departures` is `perturbations` today.
_SCENES = tuple(f"{_DATASETS}.{name}" for name in ("points.Points", "stereo.Stereo", "synthetic.Synthetic"))

_EXPERIMENTS = {
    "strangers": "held_out_subjects", "track": "dense_tracking", "track_video": "video_cues",
    "walk_best": "walk_multi_cue", "walk_video_best": "walk_video_multi_cue",
}  # fmt: skip
"""Experiments that have another name today: old and new."""
_TOP_KEYS = {
    "learn": "training", "parts": "component_packages", "people": "default_motions", "threads": "n_threads",
    "clips.choose": "clips.validation", "clips.half": "clips.split", "clips.report": "clips.test",
    "clips.report_full": "clips.test_full", "clips.report_run": "clips.test_run",
    "clips.report_walk_run": "clips.test_walk_run", "clips.strangers": "clips.held_out",
    "learn.leave_out": "training.exclude", "protocol.half": "protocol.split", "protocol.shown": "protocol.occlusion",
    "sweep.jobs": "sweep.job_ids", "sweep.metric": "sweep.objective", "sweep.stop_when": "sweep.stop_if",
}  # fmt: skip
"""Keys outside of components that have another name today, with their section: old and new."""
_TOP_VALUES: dict[str, dict[Any, Any]] = {
    "clips.split": {"choose": "validation", "report": "test"},
    "protocol.occlusion": {"a board passing": "moving board", "nothing before the person": "none"},
    "protocol.split": {"choose": "validation", "report": "test"},
}
"""Values of keys outside of components that have another name today, by today's key: old and new."""


def todays_experiment(name: str) -> str:
    """Return the name that an experiment has today."""
    return _EXPERIMENTS.get(name, name)


def todays_key(place: str) -> str:
    """Return the dotted key that a key outside of components has today."""
    section, dot, rest = place.partition(".")
    return _TOP_KEYS.get(place) or f"{_TOP_KEYS.get(section, section)}{dot}{rest}"


def provenance_in_todays_words(provenance: Mapping[str, Any]) -> dict[str, Any]:
    """Return a recorded provenance with today's experiment names, also in its choices "group=option"."""
    today = dict(provenance)
    if "experiment" in today:
        today["experiment"] = todays_experiment(str(today["experiment"]))
    if choices := today.get("choices"):
        listed = [choices] if isinstance(choices, str) else choices
        pairs = (str(choice).partition("=") for choice in listed)
        today["choices"] = [
            f"{group}={todays_experiment(name) if group == 'experiment' else name}" for group, _, name in pairs
        ]
    return today


def in_todays_words(path: Path, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the configuration with today's keys; a warning names each key whose value changes.

    Targets, keys and values get the names they have today, a video's `last_frame` becomes `n_frames`, the `first_frame`
    of files of points becomes `truth_first_frame`, and keys whose values are fixed today are removed.

    Parameters
    ----------
    path : the recording, for messages.
    settings : the recorded configuration.

    Raises
    ------
    InputError : a component that is none any more, or another value than the one that is fixed today.
    """
    today = {todays_key(key): _section(key, _today(path, key, value)) for key, value in settings.items()}
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
    for key, inverse in _INVERSES.items() if target in _SCENES else ():
        if isinstance(flag := today.pop(key, None), bool):
            today[inverse] = not flag
    for key, values in _VALUES.get(target, {}).items():
        if key in today and not isinstance(today[key], list | dict):
            today[key] = values.get(today[key], today[key])
    return today


def _section(name: str, value: Any) -> Any:
    """Return a section of the top level with today's keys and values."""
    if not isinstance(value, Mapping):
        return value
    places = {key: todays_key(f"{name}.{key}") for key in value}
    return {
        places[key].partition(".")[2]: _TOP_VALUES.get(places[key], {}).get(item, item)
        if isinstance(item, str)
        else item
        for key, item in value.items()
    }


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
        dataset["truth_first_frame"] = -first
        if first:
            warnings.warn(f"dataset.first_frame={first} is dataset.truth_first_frame={-first} today", stacklevel=3)
    return dataset
