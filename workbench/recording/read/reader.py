"""Readers of recordings of runs and studies, complete or cut off."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from workbench.core.study import Figure
from workbench.recording.format import check_format
from workbench.recording.read import chunks, frame_tables
from workbench.recording.read.chunks import Curve, curves, read_chunks, sound, static_values
from workbench.recording.read.notebook import notebook_viewer
from workbench.recording.read.properties import check_settings, checked
from workbench.recording.study.figures import figure_of
from workbench.utils.arrays import FloatArray, IntArray
from workbench.utils.errors import InputError
from workbench.utils.input_limits import parse_yaml
from workbench.utils.run_files import PART, RECORDING, RECORDING_SUFFIXES

DRAWS = "estimate/draws"
"""Path of the samples of the motion."""
_IN_A_FOLDER = (RECORDING, PART)
_NO_MAPPING = "expected a mapping in plain YAML as the configuration, found something else"


@dataclass(frozen=True, eq=False)
class MarginalPictures:
    """The marginals of K parameters over frames.

    names, units: K each. low, high: (K,), the ends of the B bins. frames: (F,). log_mass: (K, B, F), log of the
    posterior mass in each bin, bounded from below.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    low: FloatArray
    high: FloatArray
    frames: IntArray
    log_mass: FloatArray


@dataclass(frozen=True, eq=False)
class Joints:
    """Positions of J joints. names: J. frames: (F,), ascending. positions: (F, J, 3), m, in the world, as float32."""

    names: tuple[str, ...]
    frames: IntArray
    positions: FloatArray


@dataclass(frozen=True, eq=False)
class Run:
    """A recorded run.

    properties: by name, then by key: run, config, provenance, body, shape, metrics, where they were recorded.
    metrics: the metrics recorded over frames, by name; a study's have one frame.

    These are read at once. Everything else is read from the file on first use and cached, which raises InputError where
    the file can no longer be read.
    """

    path: Path
    properties: Mapping[str, Mapping[str, Any]]
    metrics: Mapping[str, Curve]

    @property
    def folder(self) -> Path:
        """The folder of the recording, with the run's summary.json."""
        return self.path.parent

    @property
    def id(self) -> str:
        """The run's unique id; "" in a damaged recording."""
        return str(self.properties["run"].get("id", ""))

    @property
    def status(self) -> str:
        """complete, stopped (by a condition), failed (by an exception), interrupted, or running (also if killed)."""
        return str(self.properties["run"]["status"])

    @property
    def environment(self) -> Mapping[str, str]:
        """The versions and processor features that affect the last bits of numbers."""
        return self.properties.get("environment", {})

    @property
    def provenance(self) -> Mapping[str, Any]:
        """The run's origin: experiment, seed, versions of Python and packages."""
        return self.properties.get("provenance", {})

    @property
    def result(self) -> Mapping[str, float]:
        """The run's metrics by name; {} before the run is complete."""
        return self.properties.get("metrics", {})

    @property
    def config(self) -> str:
        """The resolved configuration, YAML."""
        return str(self.properties.get("config", {}).get("TextDocument:text", ""))

    @cached_property
    def settings(self) -> dict[str, Any]:
        """The resolved configuration as plain lists and dicts.

        Nothing in it is resolved any further. Raises InputError when it is no YAML mapping, or has references.
        """
        try:
            settings = parse_yaml(self.path, self.config)
        except InputError as error:
            raise InputError(f"{self.path}: {_NO_MAPPING}: {str(error).removeprefix(f'{self.path}: ')}") from None
        if not isinstance(settings, dict) or not all(isinstance(key, str) for key in settings):
            raise InputError(f"{self.path}: {_NO_MAPPING}")
        check_settings(self.path, settings)
        return settings

    @property
    def metric_names(self) -> tuple[str, ...]:
        """Names of the metrics recorded over frames, sorted."""
        return tuple(sorted(self.metrics))

    def metric(self, name: str) -> tuple[IntArray, FloatArray]:
        """Return frames (F,) and values (F,) of a metric; raises InputError when it was not recorded."""
        if name not in self.metrics:
            raise InputError(f"{self.path}: no metric {name!r}, it has {', '.join(self.metric_names) or 'none'}")
        return self.metrics[name].frames, self.metrics[name].values[:, 0]

    @property
    def is_study(self) -> bool:
        """Whether this is a study, which tracks no person and has no poses."""
        return "body" not in self.properties

    @cached_property
    def poses(self) -> tuple[IntArray, FloatArray]:
        """Frames (F,) and expected poses (F, P) in full precision; F = 0 when none was recorded.

        Raises InputError for a study's recording.
        """
        if self.is_study:
            raise InputError(f"{self.path}: expected a run that tracks a person, found a study, which has no poses")
        n, (frames, _, poses) = len(self.properties["body"]["pose"]), chunks.timed(self.path, "poses")
        if len(frames) and poses.shape[1:] != (n,):
            raise InputError(f"{self.path}: expected poses of {n} numbers, found {poses.shape[1:]}")
        return frames, poses.reshape(len(frames), n)

    @cached_property
    def draws(self) -> FloatArray | None:
        """Samples of the whole motion from the posterior (S, F, P), in the frames of `poses`; None where none was
        recorded.

        Each sample has the errors' correlation over time: what the camera does not determine, such as the scale, is
        equal in all of its frames. Raises InputError as `poses`, and for frames without samples.
        """
        frames, poses = self.poses
        with sound(self.path):
            curve = curves(read_chunks(self.path, [f"/{DRAWS}"]), chunks.DRAWS).get(DRAWS)
        if curve is None:
            return None
        n_numbers = curve.values.shape[1]
        if not n_numbers or n_numbers % poses.shape[1] or not np.isin(frames, curve.frames).all():
            raise InputError(
                f"{self.path}: expected samples of {poses.shape[1]} numbers in {len(frames)} frames ({DRAWS}), found "
                f"{n_numbers} numbers in {len(curve.frames)} frames"
            )
        rows = curve.values[np.searchsorted(curve.frames, frames)]
        return np.moveaxis(rows.reshape(len(frames), -1, poses.shape[1]), 1, 0)

    @cached_property
    def joints(self) -> Joints:
        """The joints of the expected poses; F = 0 when none was recorded."""
        return self._joints("joints")

    @cached_property
    def true_joints(self) -> Joints:
        """The true joints in the frames that have them; F may be 0."""
        return self._joints("true_joints")

    @cached_property
    def scalars(self) -> Mapping[str, Curve]:
        """Every recorded curve by entity path, such as metrics/ess and posterior/parameters/root_x/mean."""
        with sound(self.path):
            contents = ["/metrics/**", "/estimate/**", "/posterior/parameters/**"]
            return curves(read_chunks(self.path, contents, [chunks.SCALARS]))

    @cached_property
    def intervals(self) -> frame_tables.CredibleIntervals:
        """The posterior's 90 % credible interval and mean, and the truth, by parameter; K and F may be 0."""
        return frame_tables.intervals_of(self.scalars)

    def table(self, name: str) -> frame_tables.Columns:
        """Return the table poses, joints, true_joints, intervals or metrics: columns of NumPy arrays by name.

        poses and metrics have a row for each frame, joints and true_joints for each joint of each frame, intervals for
        each parameter of each frame. Units are m and rad unless a metric's name has another unit. Raises InputError for
        another name.
        """
        match name:
            case "poses":
                frames, poses = self.poses
                return {"frame": frames, **dict(zip(self.properties["body"]["pose"], poses.T, strict=True))}
            case "joints" | "true_joints":
                joints = self.joints if name == "joints" else self.true_joints
                places = dict(zip("xyz", np.moveaxis(joints.positions, 2, 0), strict=True))
                return frame_tables.long_table(joints.frames, "joint", joints.names, places)
            case "intervals":
                edges = {edge: getattr(self.intervals, edge) for edge in frame_tables.EDGES}
                return frame_tables.long_table(self.intervals.frames, "parameter", self.intervals.names, edges)
            case "metrics":
                frames, values = frame_tables.aligned(dict(sorted(self.metrics.items())))
                return {"frame": frames, **values}
        raise InputError(f"expected a table, one of {', '.join(frame_tables.TABLES)}, found {name!r}")

    def pandas(self, name: str) -> Any:
        """Return `table(name)` as a pandas data frame."""
        return frame_tables.data_frame("pandas", self.table(name))

    def polars(self, name: str) -> Any:
        """Return `table(name)` as a polars data frame; raises InputError where polars is not installed."""
        return frame_tables.data_frame("polars", self.table(name))

    def show(self) -> Any:
        """Return the recording in the Rerun viewer as a widget, which a notebook displays; see `notebook_viewer`.

        Raises InputError where rerun-notebook, the extra `notebook`, is not installed.
        """
        return notebook_viewer(self.path)

    def __repr__(self) -> str:
        experiment = self.provenance.get("experiment", "a run")
        return f"<Run of {experiment}: {self.status}, {len(self.metrics)} metrics, in {self.path}>"

    @cached_property
    def marginals(self) -> MarginalPictures | None:
        """The marginals over frames; None before the first flush and in a study."""
        axes = self.properties.get("marginals")
        with sound(self.path):
            tensor = static_values(read_chunks(self.path, ["/posterior/marginals"])).get("posterior/marginals")
            if tensor is None or axes is None:
                return None
            data = tensor["Tensor:data"][0]
            log_mass = np.asarray(data["buffer"].value.values, dtype=np.float64).reshape(data["shape"].as_py())
            names, units = (tuple(np.atleast_1d(axes[key]).tolist()) for key in ("names", "units"))
            low, high, frames = (np.atleast_1d(axes[key]) for key in ("low", "high", "frames"))
            sizes = (len(names), log_mass.shape[1], len(frames))
        if log_mass.shape != sizes or not len(names) == len(units) == len(low) == len(high):
            raise InputError(f"{self.path}: expected marginals of {sizes} numbers, found {log_mass.shape}")
        return MarginalPictures(names, units, low, high, frames, log_mass)

    @cached_property
    def figures(self) -> tuple[Figure, ...]:
        """A study's figures in full precision; () of a run that tracks."""
        with sound(self.path):
            columns = static_values(read_chunks(self.path, ["/figures/**"])).values()
            recorded = [{key: value.as_py() for key, value in each.items()} for each in columns if "kind" in each]
            return tuple(figure_of(each) for each in sorted(recorded, key=lambda each: each["order"][0]))

    @cached_property
    def note(self) -> str | None:
        """A study's note; None of a run that tracks."""
        with sound(self.path):
            note = static_values(read_chunks(self.path, ["/note"])).get("note")
            return None if note is None else str(note["TextDocument:text"][0])

    def _joints(self, name: str) -> Joints:
        frames, _, positions = chunks.timed(self.path, name)
        names = tuple(self.properties.get("body", {}).get("joints", ()))
        if len(frames) and positions.shape[1:] != (len(names), 3):
            raise InputError(f"{self.path}: expected the positions of {len(names)} joints, found {positions.shape[1:]}")
        return Joints(names, frames, positions.reshape(len(frames), len(names), 3))


@dataclass(frozen=True)
class Unreadable:
    """A recording that cannot be read. reason: a message that names it."""

    path: Path
    reason: str


def read(path: str | Path) -> Run:
    """Return the run or study recorded at `path`, an .rrd, the .part of a run without a regular end, or a run's folder.

    Raises InputError when there is no such file, or it is not a recording of a run, or it is torn inside a message,
    or it has another format.
    """
    path = recording_at(Path(path))
    pieces = read_chunks(path, ["/__properties/**", "/metrics/**"])
    with sound(path):
        properties = chunks.properties(static_values(pieces))
        measured = curves(pieces)
    if "status" not in properties.get("run", {}):
        raise InputError(f"{path}: expected the recording of a run, found one without the property 'run'")
    check_format(path, properties["run"].get("format"), properties.get("provenance", {}).get("workbench"))
    metrics = {entity.removeprefix("metrics/"): curve for entity, curve in measured.items()}
    if empty := [name for name, curve in metrics.items() if curve.values.shape[1:] == (0,)]:
        raise InputError(f"{path}: expected numbers of metrics/{empty[0]}, found none")
    return Run(path, checked(path, properties), metrics)


def recording_at(path: Path) -> Path:
    """Return the path itself, or of a run's folder its recording, the .part of a run without a regular end."""
    if not path.is_dir():
        return path
    return next((path / name for name in _IN_A_FOLDER if (path / name).is_file()), path / _IN_A_FOLDER[0])


def find_recordings(*places: str | Path) -> list[Path]:
    """Return these files and the .rrd and .rrd.part files below these folders, hidden ones excluded; sorted.

    Raises InputError for a place that does not exist.
    """
    recordings: set[Path] = set()
    for place in map(Path, places):
        if not place.exists():
            raise InputError(f"{place}: expected a recording or a folder of recordings, found nothing there")
        if not place.is_dir():
            recordings.add(place)
            continue
        for path in place.rglob("*.rrd*"):
            hidden = any(name.startswith(".") for name in path.relative_to(place).parent.parts)
            if path.name.endswith(RECORDING_SUFFIXES) and path.is_file() and not hidden:
                recordings.add(path)
    return sorted(recordings)
