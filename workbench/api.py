"""Runs from Python: an experiment by its name, or parts that were built by hand."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from functools import partial
from inspect import isclass
from pathlib import Path
from typing import Any

from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from threadpoolctl import threadpool_limits

from workbench.experiment.config.options import GROUPS, name_parts, parts_in
from workbench.experiment.config.schema import composed, typed
from workbench.experiment.provenance import PYTHON, Command, described, provenance
from workbench.experiment.run import ending, execute, recorder_of
from workbench.experiment.run import record as record_steps
from workbench.experiment.summary import Summary
from workbench.experiment.tracking import Parts
from workbench.recording.read.reader import Run, read
from workbench.utils.errors import InputError
from workbench.utils.run_files import RECORDING
from workbench.utils.run_lock import run_folder


def run(
    experiment: str = "walk_straight", *overrides: str, folder: str | Path | None = None, quiet: bool = False,
    **parts: Callable[..., object],
) -> Run:  # fmt: skip
    """Run an experiment as `workbench run experiment=… …` does, say where it was written, and read it back.

    overrides: as on the command line, "seed=3" or "prior=smooth". folder: where run.rrd and summary.json go; None:
    recordings/runs/EXPERIMENT/TIME. quiet: no progress bar and no sentence. parts: by group, a class in place of what
    the experiment chose, or `functools.partial(Class, key=value)` with keys of it; the recording says these.

    Raises InputError for what a person can mend, and what the parts raise; a note on the error says where the run was
    left.
    """
    nodes = {group: _node(part, group) for group, part in parts.items()}
    config, choices = _composed(experiment, overrides)
    for group, node in nodes.items():
        OmegaConf.update(config, group, node, merge=False)
        choices[group] = str(node["_target_"]).rpartition(".")[2]
    place, said = _place(folder, experiment), ""
    if parts:  # which no command says
        words = [*map(repr, (experiment, *overrides)), *(f"{group}={_written(part)}" for group, part in parts.items())]
        said = f"workbench.run({', '.join(words)})"
    command = Command([f"experiment={experiment}", *overrides], choices, said=said)
    with _telling(place, quiet):
        execute(config, experiment, place, quiet=quiet, command=command)
    return read(place)


def record(parts: Parts, folder: str | Path | None = None, *, seed: int = 0, quiet: bool = False) -> Run:
    """Track with parts that were built in Python, without a configuration, record every step, and read it back.

    The recording's settings are read off the live objects, see `provenance.described`, so that what was swapped is what
    it says. folder: where run.rrd and summary.json go; None: recordings/runs/python/TIME. Raises InputError as `track`
    does; a note on the error says where the run was left.
    """
    place = _place(folder, PYTHON)
    settings = _settings(parts, seed)
    recorder_keys = {"_target_": "workbench.recording.write.recorder.Recorder"}
    config = OmegaConf.create({**settings, "recorder": recorder_keys})
    summary = Summary(PYTHON, seed, place / RECORDING, settings=settings)
    summary.provenance = provenance(config, Command())
    one_thread = threadpool_limits(limits=1, user_api="blas")  # as `execute` does
    with (
        _telling(place, quiet), run_folder(place), ending(summary), one_thread,
        recorder_of(config, parts, summary) as recorder,
    ):  # fmt: skip
        record_steps(parts, recorder, seed, summary, quiet)
        recorder.set_result(summary.metrics)
        recorder.set_cost(summary.cost)
    return read(place)


def _settings(parts: Parts, seed: int) -> dict[str, Any]:
    """Return what tracks in the shape of a configuration; likelihood: the inference's attribute, if it has one."""
    likelihood = getattr(parts.inference, "likelihood", None)
    live = {"dataset": parts.clip.dataset, "prior": parts.prior, "likelihood": likelihood, "inference": parts.inference}
    nodes = {group: None if part is None else described(part) for group, part in live.items()}
    body = {"_target_": described(parts.body)["_target_"], "shape": parts.body.shape.as_dict()}
    return {"experiment": PYTHON, "seed": seed, "body": body, **nodes}


def _composed(experiment: str, overrides: tuple[str, ...]) -> tuple[DictConfig, dict[str, str]]:
    """Compose the configuration as the command does; returns it with the option chosen by group."""
    name_parts(parts_in(overrides))
    try:
        config = composed([f"experiment={experiment}", *overrides], with_hydra=True)
    except (HydraException, OmegaConfBaseException) as error:
        raise InputError(" ".join(str(error).split())) from error
    choices = {str(group): str(option) for group, option in config.hydra.runtime.choices.items()}
    kept = [str(key) for key in config if key not in ("hydra", "sweep")]  # as when the command runs one
    return OmegaConf.masked_copy(config, kept), choices


def _node(part: object, group: str) -> DictConfig:
    """The configuration of a class or a `functools.partial` of one, with the defaults of its keys.

    Raises InputError for another group, for what is neither, arguments without a name, and keys that it does not know.
    """
    if group not in GROUPS:
        raise InputError(f"expected a part by its group, one of {', '.join(GROUPS)}, found {group!r}")
    try:
        found: DictConfig = typed(_keys(part, group), "Python")
    except (HydraException, OmegaConfBaseException) as error:
        raise InputError(" ".join(str(error).split())) from error
    return found


def _keys(part: object, place: str) -> dict[str, Any]:
    target, keywords, nameless = part, {}, False
    if isinstance(part, partial):
        target, keywords, nameless = part.func, part.keywords, bool(part.args)
    if nameless or not (isclass(target) or (callable(target) and hasattr(target, "__qualname__"))):
        raise InputError(f"{place}: expected a class, or functools.partial(Class, key=value), found {part!r}")
    name = f"{target.__module__}.{target.__qualname__}"
    nested = {key: isclass(value) or isinstance(value, partial) for key, value in keywords.items()}
    values = {key: _keys(value, f"{place}.{key}") if nested[key] else value for key, value in keywords.items()}
    return {"_target_": name, **values}


def _written(part: Any) -> str:
    """A class, or a partial of one, as Python has it."""
    if isinstance(part, partial):
        keys = [f"{key}={_written(value)}" for key, value in part.keywords.items()]
        return f"partial({', '.join([_written(part.func), *keys])})"
    return f"{part.__module__}.{part.__qualname__}" if isclass(part) else repr(part)


def _place(folder: str | Path | None, experiment: str) -> Path:
    if folder is not None:
        return Path(folder)
    return Path("recordings", "runs", experiment, f"{datetime.now():%Y-%m-%d_%H-%M-%S-%f}")


@contextmanager
def _telling(place: Path, quiet: bool) -> Iterator[None]:
    """Say where the run is: in a sentence, or on the error that ends it."""
    try:
        yield
    except BaseException as error:
        error.add_note(f"what there is of the run is in {place}")
        raise
    if not quiet:
        print(f"written to {place}")
