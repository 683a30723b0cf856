"""Read a run's or a study's recording back, finished or cut off."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rerun.chunk import Chunk, RrdReader
from rerun.error_utils import RerunWarning

from workbench.arrays import FloatArray, IntArray
from workbench.errors import InputError
from workbench.recording.figures import figure_of
from workbench.studies.study import Figure

_READ = ["/__properties/**", "/metrics/**", "/estimate/pose", "/posterior/**", "/figures/**", "/note"]


@dataclass(frozen=True, eq=False)
class Curve:
    """Numbers over frames. frames: (F,), ascending; values: (F, k)."""

    frames: IntArray
    values: FloatArray


@dataclass(frozen=True, eq=False)
class MarginalPictures:
    """The marginal of each of K parameters over frames.

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
class Run:
    """What a recording says about its run.

    properties: by name, then by key: run, config, provenance, body, shape, metrics, each where it was written.
    scalars: every recorded curve by its entity path, e.g. metrics/ess. marginals: None before the first flush.
    figures, note: a study's, as it made them; of a run that tracks there are none. A study has neither poses nor
    metrics over frames: its numbers are the property metrics.
    """

    path: Path
    properties: Mapping[str, Mapping[str, Any]]
    scalars: Mapping[str, Curve]
    marginals: MarginalPictures | None
    figures: tuple[Figure, ...] = ()
    note: str | None = None

    @property
    def status(self) -> str:
        """complete; failed: an exception ended the run; running: it is still at work, or was killed."""
        return str(self.properties["run"]["status"])

    @property
    def config(self) -> str:
        """The resolved configuration, YAML."""
        return str(self.properties["config"]["TextDocument:text"])

    @property
    def metric_names(self) -> tuple[str, ...]:
        """Names of the metrics that were recorded over frames, sorted."""
        return tuple(sorted(path.removeprefix("metrics/") for path in self.scalars if path.startswith("metrics/")))

    def metric(self, name: str) -> tuple[IntArray, FloatArray]:
        """Frames (F,) and values (F,) of a metric; raises InputError when it was not recorded."""
        if name not in self.metric_names:
            raise InputError(f"{self.path}: no metric {name!r}, it has {', '.join(self.metric_names) or 'none'}")
        curve = self.scalars[f"metrics/{name}"]
        return curve.frames, curve.values[:, 0]

    @property
    def poses(self) -> tuple[IntArray, FloatArray]:
        """Frames (F,) and expected poses (F, P), exactly as they were tracked; F = 0 when none was written.

        Raises InputError for a study's recording.
        """
        curve = self.scalars.get("estimate/pose")
        if "body" not in self.properties:
            raise InputError(f"{self.path}: expected a run that tracks a person, found a study, which has no poses")
        if curve is None:
            return np.empty(0, dtype=np.int64), np.empty((0, len(self.properties["body"]["pose"])))
        return curve.frames, curve.values


def read(path: str | Path) -> Run:
    """The run or study recorded at `path`, an .rrd or a .part left by a run that did not end well.

    Raises InputError when there is no such file, or it is not a recording of a run, or it is torn inside a message.
    """
    path = Path(path)
    static: dict[str, dict[str, Any]] = {}
    pieces: dict[str, list[tuple[IntArray, FloatArray]]] = {}
    for chunk in _chunks(path):
        entity = chunk.entity_path.removeprefix("/")
        if chunk.is_static:
            static.setdefault(entity, {}).update(_latest(chunk))
        elif "Scalars:scalars" in chunk.to_record_batch().schema.names:
            pieces.setdefault(entity, []).append(_numbers(chunk))
    properties = {
        entity.removeprefix("__properties/"): {key: _plain(value) for key, value in values.items()}
        for entity, values in static.items()
        if entity.startswith("__properties/")
    }
    if "status" not in properties.get("run", {}):
        raise InputError(f"{path}: expected the recording of a run, found one without the property 'run'")
    scalars = {entity: _curve(found) for entity, found in pieces.items()}
    note = static.get("note")
    text = None if note is None else str(note["TextDocument:text"][0])
    return Run(path, properties, scalars, _marginals(static), _figures(static), text)


def _chunks(path: Path) -> list[Chunk]:
    if not path.is_file():
        raise InputError(f"{path}: no such recording")
    try:
        with warnings.catch_warnings():
            # A recording cut off has no footer; that it was cut off is what its status says.
            warnings.simplefilter("ignore", RerunWarning)
            return RrdReader(path).stream().filter(content=_READ).to_chunks()
    except (RuntimeError, ValueError) as error:
        torn = "exceeds file size" in str(error)
        advice = "; `rerun rrd optimize FILE -o WHOLE.rrd` saves what comes before the tear" if torn else ""
        raise InputError(f"{path}: expected a whole Rerun recording: {error}{advice}") from None


def _latest(chunk: Chunk) -> dict[str, Any]:
    """The last value of each static component, as Arrow."""
    batch = chunk.to_record_batch()
    columns = {name: batch.column(name).drop_null() for name in batch.schema.names if not name.startswith("rerun.")}
    return {name: column[-1] for name, column in columns.items() if len(column)}


def _numbers(chunk: Chunk) -> tuple[IntArray, FloatArray]:
    batch = chunk.to_record_batch()
    frames = np.asarray(batch.column("frame"), dtype=np.int64)
    values = np.asarray(batch.column("Scalars:scalars").flatten(), dtype=np.float64)
    return frames, values.reshape(len(frames), -1)


def _curve(pieces: Sequence[tuple[IntArray, FloatArray]]) -> Curve:
    frames, values = (np.concatenate(part) for part in zip(*pieces, strict=True))
    order = np.argsort(frames, kind="stable")
    return Curve(frames[order], values[order])


def _plain(value: Any) -> Any:
    """A property's Arrow list as a Python value, alone when it holds one."""
    values = value.as_py()
    return values[0] if len(values) == 1 else values


def _marginals(static: Mapping[str, Mapping[str, Any]]) -> MarginalPictures | None:
    tensor, axes = static.get("posterior/marginals"), static.get("__properties/marginals")
    if tensor is None or axes is None:
        return None
    data = tensor["Tensor:data"][0]
    log_mass = np.asarray(data["buffer"].value.values, dtype=np.float64).reshape(data["shape"].as_py())
    return MarginalPictures(
        names=tuple(axes["names"].as_py()),
        units=tuple(axes["units"].as_py()),
        low=np.array(axes["low"].as_py()),
        high=np.array(axes["high"].as_py()),
        frames=np.array(axes["frames"].as_py()),
        log_mass=log_mass,
    )


def _figures(static: Mapping[str, Mapping[str, Any]]) -> tuple[Figure, ...]:
    """A study's figures, in their order."""
    found = [
        {key: value.as_py() for key, value in columns.items()}
        for entity, columns in static.items()
        if entity.startswith("figures/") and "kind" in columns
    ]
    return tuple(figure_of(columns) for columns in sorted(found, key=lambda columns: columns["order"][0]))
