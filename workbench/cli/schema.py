"""The schema of every configuration group, read off the signatures of what the groups build.

A constructor's keyword-only or defaulted parameters are the group's keys, with their types and defaults, so that
neither is written twice and a typo or a wrong type in an override is an error that names the key.
"""

import inspect
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, field, make_dataclass
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from hydra.core.config_store import ConfigStore
from omegaconf import MISSING

from workbench.body import person
from workbench.datasets.blank import Blank
from workbench.datasets.multi_view import MultiView
from workbench.datasets.point_files import PointFiles
from workbench.datasets.points import Points
from workbench.datasets.stereo import Stereo
from workbench.datasets.synthetic import Synthetic
from workbench.datasets.video import Video
from workbench.inference.annealed import Annealed
from workbench.inference.auxiliary import Auxiliary
from workbench.inference.gauss_newton import GaussNewton
from workbench.inference.hybrid import Hybrid
from workbench.inference.least_squares import LeastSquares
from workbench.inference.limb_lengths import of_keypoints
from workbench.inference.particle_filter import ParticleFilter
from workbench.inference.partitioned import Partitioned
from workbench.inference.restarting import Restarting
from workbench.inference.smoothing import BackwardSimulation, FixedLag
from workbench.inference.synthesis import Synthesis
from workbench.inference.tempered_smc import TemperedSMC
from workbench.likelihoods.appearance import Appearance
from workbench.likelihoods.background import Background
from workbench.likelihoods.edges import Edges
from workbench.likelihoods.image_motion import ImageMotion
from workbench.likelihoods.keypoints import KeypointLikelihood
from workbench.likelihoods.product import Product
from workbench.likelihoods.silhouette import Silhouette
from workbench.likelihoods.surface_points import SurfacePoints
from workbench.likelihoods.uniform import Uniform
from workbench.mocap.person import of_file
from workbench.priors.flipping import Flipping
from workbench.priors.following import Following
from workbench.priors.from_motions import activity, cyclic, gait, implicit, walking
from workbench.priors.jitter import Jitter
from workbench.priors.mixture import Mixture, Switching
from workbench.priors.partwise import Partwise
from workbench.priors.smooth import Smooth
from workbench.recording.recorder import Recorder
from workbench.studies.database import CoefficientHistograms, Temperature
from workbench.studies.gaps import ImputeGaps
from workbench.studies.learning_activities import LearnWalkRun
from workbench.studies.learning_alignment import AlignCycles
from workbench.studies.learning_period import PeriodSnr
from workbench.studies.learning_walk import LearnWalk

COMPONENTS: dict[str, dict[str, Callable[..., object]]] = {
    "body": {"dataset": person.of_dataset, "height": person.of_height, "file": of_file, "keypoints": of_keypoints},
    "dataset": {
        "synthetic": Synthetic,
        "video": Video,
        "multi_view": MultiView,
        "blank": Blank,
        "points": Points,
        "stereo": Stereo,
        "point_files": PointFiles,
    },
    "prior": {
        "walking": walking,
        "gait": gait,
        "cyclic": cyclic,
        "smooth": Smooth,
        "implicit": implicit,
        "mixture": Mixture,
        "switching": Switching,
        "partwise": Partwise,
        "jitter": Jitter,
        "flipping": Flipping,
        "following": Following,
        "activity": activity,
    },
    "likelihood": {
        "image_motion": ImageMotion,
        "background": Background,
        "appearance": Appearance,
        "edges": Edges,
        "silhouette": Silhouette,
        "product": Product,
        "surface_points": SurfacePoints,
        "keypoints": KeypointLikelihood,
        "uniform": Uniform,
    },
    "inference": {
        "particle_filter": ParticleFilter,
        "synthesis": Synthesis,
        "least_squares": LeastSquares,
        "hybrid": Hybrid,
        "fixed_lag": FixedLag,
        "backward_simulation": BackwardSimulation,
        "tempered_smc": TemperedSMC,
        "annealed": Annealed,
        "auxiliary": Auxiliary,
        "partitioned": Partitioned,
        "gauss_newton": GaussNewton,
        "restarting": Restarting,
    },
    "recorder": {"rerun": Recorder},
    "study": {
        "temperature": Temperature,
        "coefficient_histograms": CoefficientHistograms,
        "learn_walk": LearnWalk,
        "learn_walk_run": LearnWalkRun,
        "period_snr": PeriodSnr,
        "align_cycles": AlignCycles,
        "impute_gaps": ImputeGaps,
    },
}
LIVE: dict[str, set[str]] = {
    "body": {"dataset_shape", "full_body", "dataset"},
    "prior": {"camera", "trajectory"},
    "likelihood": {"body", "dataset"},
    "inference": {"prior", "likelihood", "body", "lead_in", "model", "phase_ends", "surface"},
    "recorder": {"path", "body", "space", "run_id", "config_yaml", "provenance", "coefficient_scale"},
    "study": {"prior"},
}
"""Parameters that the run fills with live objects; they are no keys of a configuration."""


@dataclass
class PathsSchema:
    """data: folder with recorded motion and video. cache: folder for what can be made again."""

    data: str | None = None
    cache: str = MISSING


@dataclass
class ToleranceSchema:
    """What a metric may move by: absolute, in its unit, or relative to what it was."""

    absolute: float = 0.0
    relative: float = 0.0


@dataclass
class SweepSchema:
    """resume: folder of an earlier sweep. jobs: numbers of those to run, None: all. metric: what a tuner minimises."""

    resume: str | None = None
    jobs: list[int] | None = None
    metric: str | None = None


@dataclass
class RunSchema:
    """The top level of a configuration. Groups a study has no use for are null in its experiment; no study: track."""

    body: Any = None
    dataset: Any = None
    prior: Any = None
    likelihood: Any = None
    inference: Any = None
    recorder: Any = None
    study: Any = None
    seed: int = 0
    threads: int | None = None
    paths: PathsSchema = field(default_factory=PathsSchema)
    check: dict[str, ToleranceSchema] = field(default_factory=dict)
    sweep: SweepSchema = field(default_factory=SweepSchema)


def register_schemas() -> None:
    """Store a schema `<group>/schema_<name>` for every component, and `schema_run` for the top level."""
    store = ConfigStore.instance()
    store.store(name="schema_run", node=RunSchema)
    for group, components in COMPONENTS.items():
        for name, target in components.items():
            store.store(group=group, name=f"schema_{name}", node=schema_of(target, LIVE.get(group, set())))


def schema_of(target: Callable[..., object], live: Set[str] = frozenset()) -> type:
    """A dataclass with `_target_` and one typed field per parameter of `target` that is not `live`."""
    called = target.__init__ if inspect.isclass(target) else target
    types = get_type_hints(called)
    columns: list[tuple[str, Any, Any]] = [("_target_", str, f"{target.__module__}.{target.__qualname__}")]
    for name, parameter in inspect.signature(target).parameters.items():
        if name not in live:
            columns.append((name, _schema_type(types[name]), _default(parameter.default)))
    return make_dataclass(f"{target.__qualname__}_keys", columns)


def _default(value: object) -> Any:
    if value is inspect.Parameter.empty:
        return MISSING
    if isinstance(value, tuple | list):
        return field(default_factory=lambda: list(value))
    if isinstance(value, Mapping):
        return field(default_factory=lambda: dict(value))
    return value


def _schema_type(hint: Any) -> Any:
    """What OmegaConf calls the type: sequences are lists, mappings are dicts."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return _schema_type(next(part for part in inner if part is not NoneType)) | None
    if origin in (tuple, list, Sequence):
        return list[inner[0]]  # type: ignore[valid-type]
    if origin is Literal:
        return str  # the component itself names the choices it knows
    if getattr(hint, "_is_protocol", False):
        return Any  # a component of another group, whose own schema knows its keys
    if origin is Mapping:
        return dict[str, inner[1] if inner[1] in (str, int, float, bool) else Any]  # type: ignore[misc]
    return hint
