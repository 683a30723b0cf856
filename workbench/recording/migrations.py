"""Translation of earlier recordings to today's names of metrics, entity paths, properties and configuration keys."""

import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from workbench.utils.errors import InputError

FORMAT = 3
"""The version of a recording's names, in its property `run` and in summary.json. Readers translate smaller versions.

1: without a number. 2: `run` has the key format. 3: the standard names of metrics, paths and configuration keys.
"""

_DATASETS = "workbench.datasets"
_VIDEOS = (f"{_DATASETS}.video.Video", f"{_DATASETS}.multi_view.MultiView")
_POINTS = f"{_DATASETS}.point_files.PointFiles"
_MODULES = {
    "workbench.inference.fit.frame_by_frame": "workbench.inference.least_squares.motion.frame_by_frame",
    "workbench.inference.fit.least_squares": "workbench.inference.least_squares.least_squares",
    "workbench.inference.fit.motion_fit": "workbench.inference.least_squares.motion.motion_fit",
    "workbench.inference.fit.smooth_fit": "workbench.inference.least_squares.motion.smooth_fit",
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
    _IMAGE_MOTION: {"blur_px": 2.0**0.5, "seed": 0},
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
    "workbench.recording.write.recorder.Recorder": {"live": "stream"},
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
_SCENES = tuple(f"{_DATASETS}.{name}" for name in ("points.Points", "stereo.Stereo", "synthetic.Synthetic"))
_SETTINGS: dict[str, str] = {
    "check.figures": "check.study_metrics", "clips.choose": "clips.validation", "clips.half": "clips.split",
    "clips.report": "clips.test", "clips.report_full": "clips.test_full", "clips.report_run": "clips.test_run",
    "clips.report_walk_run": "clips.test_walk_run", "clips.strangers": "clips.held_out",
    "learn.leave_out": "learn.exclude", "protocol.half": "protocol.split", "protocol.shown": "protocol.occlusion",
    "sweep.jobs": "sweep.job_ids", "sweep.metric": "sweep.objective", "sweep.stop_when": "sweep.stop_if",
    "given": "assumptions", "learn": "training", "parts": "component_packages", "people": "default_motions",
    "threads": "n_threads",
}  # fmt: skip
"""Keys outside of components that have another name today, dotted: old and new. Keys of a section come before it."""
_SETTING_VALUES: dict[str, dict[Any, Any]] = {
    "clips.split": {"choose": "validation", "report": "test"},
    "protocol.occlusion": {"a board passing": "moving board", "nothing before the person": "none"},
    "protocol.split": {"choose": "validation", "report": "test"},
}
"""Values of keys outside of components that have another name today, by today's key: old and new."""
_EXPERIMENTS = {
    "strangers": "held_out_subjects", "track": "dense_tracking", "track_video": "video_cues",
    "walk_best": "walk_multi_cue", "walk_video_best": "walk_video_multi_cue",
}  # fmt: skip
"""Experiments that have another name today: old and new."""

_METRICS: dict[str, str] = {
    "acceptance": "acceptance_rate",
    "ancestors_10": "unique_ancestors_lag10",
    "calibration_error": "expected_calibration_error",
    "compiling_s": "compile_s",
    "distinct": "unique_particles",
    "error_abs_mm": "mpjpe_abs_mm",
    "error_abs_offsets_removed_mm": "mpjpe_abs_offset_corrected_mm",
    "error_angle_deg": "mpjae_local_deg",
    "error_offset_free_mm": "mpjpe_abs_marker_corrected_mm",
    "error_procrustes_mm": "pa_mpjpe_mm",
    "error_px": "mpjpe_px",
    "error_rel_mm": "mpjpe_mm",
    "error_rel_offsets_removed_mm": "mpjpe_offset_corrected_mm",
    "explained": "explained_variance",
    "explained_5": "explained_variance_5",
    "forearm_px": "forearm_width_px",
    "frames": "n_frames",
    "held": "tracked",
    "hip_deg": "hip_flexion_rmse_deg",
    "inliers": "inlier_fraction",
    "knee_deg": "knee_flexion_rmse_deg",
    "log_score": "nll",
    "lost_share": "lost_fraction",
    "passes": "n_passes",
    "passing": "occluded_fraction",
    "pck_150mm": "pck_abs_150mm",
    "restarted": "reinitialized",
    "temperatures": "n_temperatures",
    "times_lost": "n_track_losses",
    "z2": "nees_per_dim",
}
"""Metrics that have another name today: old and new."""
_METRIC_PATTERNS: dict[str, str] = {
    r"doubt_(\w+)_mm": r"expected_error_\1_mm",
    r"missed_(\w+)_mm": r"mpjpe_abs_\1_mm",
    r"offset_(\w+)_mm": r"marker_offset_\1_mm",
    r"share_(\w+)": r"variance_fraction_\1",
}
"""Families of metrics that have another name today: regular expressions of whole names, and their replacements."""
_SUFFIXES: dict[str, str] = {"_map": "_max_weight"}
"""Suffixes of metrics that have another name today: old and new."""
_PATHS: dict[str, str] = {
    "checkpoint/told": "checkpoint/reported",
    "evaluation/ranks/even": "evaluation/ranks/uniform",
    "residual_px": "reprojection_error_px",
    "state/do_not_trust": "state/large_expected_error",
    "state/person": "state/tracking",
}
"""Entity paths that have another name today, with all below them: old and new."""
_PATH_PATTERNS: dict[str, str] = {r"(world/[^/]+/image)/truth_marks": r"\1/annotations"}
"""Families of entity paths that have another name today: regular expressions of whole paths, and replacements."""
_PROPERTIES: dict[str, str] = {"departures": "perturbations"}
"""Properties of a recording that have another name today: old and new."""
_PROPERTY_KEYS: dict[str, dict[str, str]] = {
    "provenance": {"given": "assumptions"},
    "verdict": {"found": "findings", "sentence": "message"},
}
"""Keys of properties that have another name today, by today's property: old and new."""
_VERDICTS: dict[str, str] = {
    "cameras disagree": "inconsistent cameras",
    "far from what is seen": "observations far from the body",
    "frames missing": "missing frames or jumps",
    "height": "height mismatch",
    "held": "tracked",
    "left and right": "left–right swap",
    "limb lengths": "implausible limb lengths",
    "no truth": "no ground truth",
    "not seen": "no person visible",
    "rate": "frame-rate mismatch",
}
"""Kinds of verdicts that have another name today: old and new."""
_LEVELS = dict.fromkeys(("tracked", "no ground truth", "no person visible"), "not evaluated") | {"lost": "not usable"}
"""Levels of verdicts that were recorded without one, by their kind of today; any other kind is a contradiction."""
_SUMMARY: dict[str, str] = {
    "anew": "restart_reason", "counted": "input_counts", "given": "assumptions", "left_out": "omitted_metrics",
}  # fmt: skip
"""Fields of summary.json that have another name today: old and new."""


def todays_experiment(name: str) -> str:
    """Return the name that an experiment has today."""
    return _EXPERIMENTS.get(name, name)


def todays_key(place: str) -> str:
    """Return the dotted key that a key outside of components has today."""
    section, dot, rest = _SETTINGS.get(place, place).partition(".")
    return f"{_SETTINGS.get(section, section)}{dot}{rest}"


def metric_name(recorded: str) -> str:
    """Return today's name of a metric of an earlier recording."""
    for suffix, new in _SUFFIXES.items():
        if recorded.endswith(suffix):
            return metric_name(recorded.removesuffix(suffix)) + new
    for pattern, replacement in _METRIC_PATTERNS.items():
        if match := re.fullmatch(pattern, recorded):
            return match.expand(replacement)
    return _METRICS.get(recorded, recorded)


def entity_path(recorded: str) -> str:
    """Return today's path, /a/b, of an entity of an earlier recording."""
    path = recorded.removeprefix("/")
    root, _, name = path.partition("/")
    if root in ("metrics", "guides"):
        return f"/{root}/{metric_name(name)}"
    for old, new in _COLUMNS.items():
        path = re.sub(f"{old}(?=/|$)", new, path)
    for old, new in _PATHS.items():
        if path == old or path.startswith(f"{old}/"):
            return f"/{new}{path.removeprefix(old)}"
    for pattern, replacement in _PATH_PATTERNS.items():
        if match := re.fullmatch(pattern, path):
            return f"/{match.expand(replacement)}"
    return f"/{path}"


def former_paths(paths: Sequence[str]) -> list[str]:
    """Return the paths that earlier recordings have for those of `paths` that were renamed."""
    former = {f"/{new}": f"/{old}" for old, new in _PATHS.items()}
    former |= {f"/metrics/{new}": f"/metrics/{old}" for old, new in _METRICS.items()}
    return [former[path] for path in paths if path in former]


def renamed_metrics(recorded: Mapping[str, Any]) -> dict[str, Any]:
    """Return the mapping with today's names of metrics as keys."""
    return {metric_name(name): value for name, value in recorded.items()}


def renamed_properties(recorded: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return an earlier recording's properties with today's names and keys."""
    properties: dict[str, dict[str, Any]] = {}
    for name, values in recorded.items():
        name = _PROPERTIES.get(name, name)
        properties[name] = _renamed_keys(values, _PROPERTY_KEYS.get(name, {}))
        if name in ("metrics", "cost"):
            properties[name] = renamed_metrics(values)
    if isinstance(kind := properties.get("verdict", {}).get("kind"), str):
        properties["verdict"]["kind"] = _VERDICTS.get(kind, kind)
    if "provenance" in properties:
        properties["provenance"] |= _provenance(properties["provenance"])
    if isinstance(names := properties.get("marginals", {}).get("names"), list):
        properties["marginals"]["names"] = [_column(name) for name in names]
    return properties


def with_level(properties: Mapping[str, Any]) -> dict[str, Any]:
    """Return properties, or a summary, whose verdict has a level, that of its kind where it was recorded without."""
    verdict = properties.get("verdict")
    if not isinstance(verdict, Mapping) or "kind" not in verdict:
        return dict(properties)
    return {**properties, "verdict": {"level": _LEVELS.get(verdict["kind"], "doubtful"), **verdict}}


def _column(recorded: Any) -> Any:
    """Return today's name of a column of the state."""
    for old, new in _COLUMNS.items():
        if str(recorded).endswith(old):
            return f"{str(recorded).removesuffix(old)}{new}"
    return recorded


def _provenance(recorded: Mapping[str, Any]) -> dict[str, Any]:
    """Return the experiment and the choices "group=option" of a provenance, where it has them, in today's names."""
    today: dict[str, Any] = {}
    if "experiment" in recorded:
        today["experiment"] = todays_experiment(str(recorded["experiment"]))
    if choices := recorded.get("choices"):
        pairs = (str(choice).partition("=") for choice in ([choices] if isinstance(choices, str) else choices))
        options = {"experiment": _EXPERIMENTS, **_OPTIONS}
        today["choices"] = [f"{group}={options.get(group, {}).get(option, option)}" for group, _, option in pairs]
    return today


def renamed_summary(recorded: Mapping[str, Any]) -> dict[str, Any]:
    """Return a summary.json with today's names; one of today's format is returned unchanged."""
    if recorded.get("format", 1) >= FORMAT:
        return with_level(recorded)
    summary = _renamed_keys(recorded, _SUMMARY)
    summary["metrics"] = renamed_metrics(summary["metrics"])
    properties = {name: summary[name] for name in ("provenance", "verdict") if isinstance(summary.get(name), Mapping)}
    summary |= renamed_properties(properties)
    if isinstance(settings := summary.get("settings"), Mapping):
        summary["settings"] = renamed(settings)
    return with_level(summary)


def renamed(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return an earlier recording's configuration with today's targets, keys and values.

    A video's `last_frame` becomes `n_frames`, and the `first_frame` of point files becomes `truth_first_frame`. Keys
    that components no longer have are removed where they have the value that is fixed today, and stay otherwise.
    """
    return _renamed(settings)[0]


def migrated(path: Path, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return an earlier recording's configuration as `renamed`, to be run again.

    A warning names each key whose value changes.

    Parameters
    ----------
    path : the recording, for messages.
    settings : the recorded configuration.

    Raises
    ------
    InputError : the configuration has a removed component, or a value other than the one that is fixed today.
    """
    for place, value in settings.items():
        for message in _obstacles(place, value):
            raise InputError(f"{path}: {message}")
    today, changes = _renamed(settings)
    for change in changes:
        warnings.warn(change, stacklevel=2)
    return today


def _renamed(settings: Mapping[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """Return the configuration with today's names, and a message for each key whose value changes."""
    dataset, changes = settings.get("dataset"), list[str]()
    if isinstance(dataset, Mapping):
        dataset, changes = _dataset(dataset)
    today: dict[str, Any] = {key: _component(dataset if key == "dataset" else value) for key, value in settings.items()}
    for old, new in _SETTINGS.items():
        *parents, name = old.split(".")
        node: Any = today
        for parent in parents:
            node = node.get(parent) if isinstance(node, dict) else None
        if isinstance(node, dict) and name in node:
            node[new.rpartition(".")[2]] = node.pop(name)
    for place, names in _SETTING_VALUES.items():
        section, _, name = place.partition(".")
        if isinstance(today.get(section), dict) and isinstance(value := today[section].get(name), str):
            today[section][name] = names.get(value, value)
    if isinstance(today.get("check"), dict):
        today["check"] = renamed_metrics(today["check"])
    return today, changes


def _component(value: Any) -> Any:
    """Return a part of a configuration with today's targets, keys and values."""
    if isinstance(value, list):
        return [_component(item) for item in value]
    if not isinstance(value, Mapping):
        return value
    today = {key: _component(item) for key, item in value.items()}
    if not isinstance(recorded := today.get("_target_"), str):
        return today
    today["_target_"] = target = _target(recorded)
    for key, fixed in _FIXED.get(target, {}).items():
        if today.get(key, fixed) in (fixed, None):
            today.pop(key, None)
    today = _renamed_keys(today, _KEYS.get(target, {}))
    for old, inverse in _INVERSES.items() if target in _SCENES else ():
        if isinstance(flag := today.pop(old, None), bool):
            today[inverse] = not flag
    for key, values in _VALUES.get(target, {}).items():
        if key in today and not isinstance(today[key], list | dict):
            today[key] = values.get(today[key], today[key])
    return today


def _obstacles(place: str, value: Any) -> Iterator[str]:
    """Yield why a part of an earlier configuration cannot run: removed components, and values that are fixed today."""
    if isinstance(value, list):
        for k, item in enumerate(value):
            yield from _obstacles(f"{place}.{k}", item)
    if not isinstance(value, Mapping):
        return
    for key, item in value.items():
        yield from _obstacles(f"{place}.{key}", item)
    if not isinstance(recorded := value.get("_target_"), str):
        return
    target = _target(recorded)
    if target in _REMOVED:
        yield f"{place}._target_: the component {recorded} was removed; choose another one"
    for key, fixed in _FIXED.get(target, {}).items():
        if value.get(key) not in (fixed, None):
            yield (
                f"{place}.{key}: expected {fixed}, which is fixed today, found {value[key]!r}; run its experiment "
                "again without this key"
            )


def _target(recorded: str) -> str:
    """Return today's target."""
    module, _, name = recorded.rpartition(".")
    target = f"{_MODULES.get(module, module)}.{name}"
    return _CLASSES.get(target, target)


def _renamed_keys(values: Mapping[str, Any], names: Mapping[str, str]) -> dict[str, Any]:
    return {names.get(key, key): value for key, value in values.items()}


def _dataset(recorded: Mapping[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """Return the dataset with today's numbers of frames, and a message for each key whose value changes."""
    target, dataset, changes = _target(str(recorded.get("_target_"))), dict(recorded), list[str]()
    if target in _VIDEOS and "last_frame" in dataset:
        last = dataset.pop("last_frame")
        if isinstance(last, int):
            frames = last - int(dataset.get("first_frame") or 0) + 1
            fewer = dataset.get("n_frames")
            dataset["n_frames"] = frames if fewer is None else min(frames, fewer)
            changes.append(f"dataset.last_frame={last} is dataset.n_frames={dataset['n_frames']} today")
    elif target == _POINTS and "n_frames" not in dataset:  # earlier point files had no range of frames
        first = dataset.pop("first_frame", 0)
        dataset["truth_first"] = -first
        if first:
            changes.append(f"dataset.first_frame={first} is dataset.truth_first_frame={-first} today")
    return dataset, changes
