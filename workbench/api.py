"""Run experiments from Python: an experiment by name, or components built in Python."""

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

from workbench.experiment.config.options import GROUPS, allow_packages, packages_in
from workbench.experiment.config.schema import composed, typed
from workbench.experiment.config.stored import current_defaults
from workbench.experiment.provenance import PYTHON, Command, provenance
from workbench.experiment.repeat import changes
from workbench.experiment.run import ending, execute, recorder_of
from workbench.experiment.run import record as record_steps
from workbench.experiment.summary import Summary
from workbench.experiment.tracking import Components
from workbench.recording.condense import condense
from workbench.recording.read.reader import Run, read
from workbench.results.check.outcome import Check, has_moved, table
from workbench.results.check.rerun import Request, check_two, read_sound
from workbench.utils.atomic_write import whole_file
from workbench.utils.errors import InputError
from workbench.utils.parallel import single_blas_thread
from workbench.utils.run_files import RECORDING
from workbench.utils.run_lock import run_folder


def run(
    experiment: str = "walk_multi_cue", *overrides: str, folder: str | Path | None = None, quiet: bool = False,
    **components: Callable[..., object],
) -> Run:  # fmt: skip
    """Run an experiment as `workbench run experiment=… …` does and return its recording.

    Parameters
    ----------
    experiment : its name.
    overrides : as on the command line, "seed=3" or "prior=smooth".
    folder : folder of run.rrd and summary.json; None: recordings/runs/EXPERIMENT/TIME.
    quiet : print no progress bar and no location.
    components : by group, a class or `functools.partial(Class, key=value)` that replaces the experiment's component;
        the recording contains it.

    Raises
    ------
    InputError : bad input. Exceptions of the components pass through. A note on the error names the run's folder.
    """
    if hydras := [text for text in overrides if text.lstrip("+~").startswith("hydra")]:
        raise InputError(f"{hydras[0]}: Hydra's settings have no effect in Python; set the folder by folder=…")
    nodes = {group: _node(component, group) for group, component in components.items()}
    config, choices = _composed(experiment, overrides)
    for group, node in nodes.items():
        OmegaConf.update(config, group, node, merge=False)
        choices[group] = str(node["_target_"]).rpartition(".")[2]
    place, python_call = _place(folder, experiment), ""
    if components:  # no command describes them
        words = [
            *map(repr, (experiment, *overrides)),
            *(f"{group}={_python_source(component)}" for group, component in components.items()),
        ]
        python_call = f"workbench.run({', '.join(words)})"
    command = Command([f"experiment={experiment}", *overrides], choices, python_call=python_call)
    with _reporting_folder(place, quiet):
        execute(config, experiment, place, quiet=quiet, command=command)
    return read(place)


def record(components: Components, folder: str | Path | None = None, *, seed: int = 0, quiet: bool = False) -> Run:
    """Track with components built in Python, record every step, and return the recording.

    The recorded settings contain the seed and the names of the components' classes. Their configuration is the
    caller's, who keeps the code that builds them.

    Parameters
    ----------
    components : the live objects.
    folder : folder of run.rrd and summary.json; None: recordings/runs/python/TIME.
    seed : of all random numbers.
    quiet : print no progress bar and no location.

    Raises
    ------
    InputError : as `track`. A note on the error names the run's folder.
    """
    place = _place(folder, PYTHON)
    settings = _settings(components, seed)
    recorder_keys = {"_target_": "workbench.recording.write.recorder.Recorder"}
    config = OmegaConf.create({**settings, "recorder": recorder_keys})
    summary = Summary(PYTHON, seed, place / RECORDING, settings=settings)
    summary.provenance = provenance(config, Command())
    one_thread = single_blas_thread()  # as `execute` does
    with (
        _reporting_folder(place, quiet), run_folder(place), ending(summary), one_thread,
        recorder_of(config, components, summary) as recorder,
    ):  # fmt: skip
        record_steps(components, recorder, seed, summary, quiet)
        recorder.set_result(summary.metrics)
        recorder.set_cost(summary.cost)
    return read(place)


def check(run: Run, baseline: str | Path, *, update: bool = False) -> Check:
    """Compare a run with a stored one as `workbench check OLD.rrd NEW.rrd` does, and return the comparison.

    Parameters
    ----------
    run : of `run`, `record` or `read`.
    baseline : recording with the numbers that the run must reproduce; a `tolerances.json` next to it applies.
    update : write the run's numbers to `baseline`, where it is missing or they changed, instead of failing.

    Raises
    ------
    AssertionError : the run's numbers changed; the message has a table of them, and the configuration's changes.
    InputError : there is no baseline, or it cannot be read.
    """
    __tracebackhide__ = True  # in pytest, the caller's line and the table suffice
    path = Path(baseline)
    if not path.is_file() and not update:
        raise InputError(f"{path}: is no baseline yet; write it by check(…, update=True) or pytest --workbench-update")
    if not path.is_file():
        _write_baseline(run, path)
    runs, refused = read_sound([path])
    request = Request([], current_defaults([]), path.parent)
    outcome = refused[0] if refused else check_two(str(path), runs[0], run, request)
    if outcome.refused is not None:
        raise InputError(outcome.refused)
    if update and any(map(has_moved, outcome.findings)):
        _write_baseline(run, path)
    elif not outcome.passed:
        raise AssertionError("\n".join([table([outcome]), *changes(runs[0].settings, run.settings)]))
    return outcome


def _write_baseline(run: Run, path: Path) -> None:
    with whole_file(path, parents=True) as part:
        condense(run, part)


def _settings(components: Components, seed: int) -> dict[str, Any]:
    """Return the classes of the live objects; likelihood: the inference's attribute, if it has one."""
    likelihood = getattr(components.inference, "likelihood", None)
    live = {
        "body": components.body,
        "dataset": components.clip.dataset,
        "prior": components.prior,
        "likelihood": likelihood,
        "inference": components.inference,
    }
    names = {group: f"{type(each).__module__}.{type(each).__qualname__}" for group, each in live.items()}
    nodes = {group: None if live[group] is None else {"_target_": name} for group, name in names.items()}
    return {"experiment": PYTHON, "seed": seed, **nodes}


def _composed(experiment: str, overrides: tuple[str, ...]) -> tuple[DictConfig, dict[str, str]]:
    """Return the configuration, composed as the command does, and the chosen options by group."""
    allow_packages(packages_in(overrides))
    try:
        config = composed([f"experiment={experiment}", *overrides], with_hydra=True)
    except (HydraException, OmegaConfBaseException) as error:
        raise InputError(" ".join(str(error).split())) from error
    choices = {str(group): str(option) for group, option in config.hydra.runtime.choices.items()}
    keys = [str(key) for key in config if key not in ("hydra", "sweep")]  # as the command does
    return OmegaConf.masked_copy(config, keys), choices


def _node(component: object, group: str) -> DictConfig:
    """Return the configuration of a class or a `functools.partial` of one, with the defaults of its keys.

    Raises
    ------
    InputError : an unknown group, an object of another kind, positional arguments, or unknown keys.
    """
    if group not in GROUPS:
        raise InputError(f"expected a component by its group, one of {', '.join(GROUPS)}, found {group!r}")
    try:
        config: DictConfig = typed(_keys(component, group), "Python")
    except (HydraException, OmegaConfBaseException) as error:
        raise InputError(" ".join(str(error).split())) from error
    return config


def _keys(component: object, place: str) -> dict[str, Any]:
    target, keywords, positional = component, {}, False
    if isinstance(component, partial):
        target, keywords, positional = component.func, component.keywords, bool(component.args)
    if positional or not (isclass(target) or (callable(target) and hasattr(target, "__qualname__"))):
        raise InputError(f"{place}: expected a class, or functools.partial(Class, key=value), found {component!r}")
    name = f"{target.__module__}.{target.__qualname__}"
    nested = {key: isclass(value) or isinstance(value, partial) for key, value in keywords.items()}
    values = {key: _keys(value, f"{place}.{key}") if nested[key] else value for key, value in keywords.items()}
    return {"_target_": name, **values}


def _python_source(component: Any) -> str:
    """Return the Python source of a class, or of a partial of one."""
    if isinstance(component, partial):
        keys = [f"{key}={_python_source(value)}" for key, value in component.keywords.items()]
        return f"partial({', '.join([_python_source(component.func), *keys])})"
    return f"{component.__module__}.{component.__qualname__}" if isclass(component) else repr(component)


def _place(folder: str | Path | None, experiment: str) -> Path:
    if folder is not None:
        return Path(folder)
    return Path("recordings", "runs", experiment, f"{datetime.now():%Y-%m-%d_%H-%M-%S-%f}")


@contextmanager
def _reporting_folder(place: Path, quiet: bool) -> Iterator[None]:
    """Print the run's folder, or add it to the error that ends the block."""
    try:
        yield
    except BaseException as error:
        error.add_note(f"the run's folder: {place}")
        raise
    if not quiet:
        print(f"written to {place}")
