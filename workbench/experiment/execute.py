"""One run: whether what is asked for can be one, and how it ended. What runs it is imported only once it can."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omegaconf import DictConfig, OmegaConf

from workbench.experiment.config.compatibility import incompatibility
from workbench.experiment.config.identity import identity
from workbench.experiment.config.instantiate import check_names, check_targets, targets_in
from workbench.experiment.config.lacking import what_lacks
from workbench.experiment.config.options import GROUPS
from workbench.experiment.folder import run_folder, set_aside
from workbench.experiment.provenance import Command, provenance
from workbench.experiment.summary import Summary
from workbench.utils.errors import InputError
from workbench.utils.input_limits import check_products, check_sizes
from workbench.utils.rng import rng_streams
from workbench.utils.run_files import RECORDING, SUMMARY
from workbench.utils.signals import deferred, interruptible

if TYPE_CHECKING:
    from workbench.experiment.continuing import Continued  # which reads recordings, as a run that is refused does not

Stop = Callable[[Mapping[str, float]], bool]
"""Whether a run ends, by its numbers so far; as text it says when."""


def execute(
    config: DictConfig, experiment: str, folder: Path, quiet: bool = False, command: Command | None = None,
    continued: "Continued | None" = None, stop: Stop | None = None, anew: str | None = None,
) -> Summary:  # fmt: skip
    """Run the configured experiment and leave `run.rrd` and `summary.json` in `folder`.

    quiet: no progress bar. command: what was said, which is recorded; sentences name its choices. continued: where a
    recorded run goes on; None: from the first frame. stop: ends the run where it holds. anew: why it does not go on
    where an earlier attempt ended. Raises InputError for what a person can mend, DegenerateWeights where the
    configuration asks to end there; summary.json then says so, and the recording up to there is kept as `run.rrd.part`.
    One run at a time works in a folder, see `run_lock`.
    """
    summary = Summary(experiment=experiment, seed=int(config.seed), recording=folder / RECORDING, anew=anew)
    with run_folder(folder), ending(summary):
        run_checked(config, summary, quiet, command or Command(), continued, stop)
    return summary


@contextmanager
def ending(summary: Summary) -> Iterator[None]:
    """Write summary.json at the beginning of a run and, with how it ended, at its end; SIGTERM and its like interrupt.

    The caller holds the lock of the run's folder. A complete run in it is set aside. The recording decides: once it is
    published the run is complete, whatever is asked for or fails from there on.
    """
    path = summary.recording.parent / SUMMARY
    set_aside(path.parent)
    with interruptible():
        try:
            summary.write(path)  # "running", which is what a killed run leaves
            yield
            _end(summary, path, None)
        except BaseException as error:
            _end(summary, path, error)  # once more, where it was asked to end while it was about to do that
            raise


def _end(summary: Summary, path: Path, error: BaseException | None) -> None:
    with deferred():
        summary.end(error)
        summary.write(path)


def run_checked(
    config: DictConfig, summary: Summary, quiet: bool, command: Command, continued: "Continued | None",
    stop: Stop | None,
) -> None:  # fmt: skip
    """Check the configuration and run it, counted in the summary; parameters and errors as of `execute`."""
    said: Any = OmegaConf.to_container(config, resolve=True)
    _check_components(config)
    check_names(targets_in(said, ""))
    check_sizes(said)
    check_products(said)
    rng_streams(summary.seed)  # which a wrong seed has none of
    if sentence := _refused(config, command.choices):
        raise InputError(sentence)
    check_targets(config)
    summary.identity, summary.provenance = identity(config), provenance(config, command)
    if continued is not None:
        summary.identity = continued.identity(summary.identity)
        summary.provenance = {**summary.provenance, **continued.provenance}
    with deferred():  # an exception within an import can be lost in C code
        from workbench.experiment.running import run  # here, as what is refused does without: it takes longest

    run(config, summary, command.choices, quiet, continued, stop)


def _check_components(config: DictConfig) -> None:
    """Raise InputError for a group that is neither null nor a component, such as one left empty in a file."""
    for group in GROUPS:
        node = config.get(group)
        if node is not None and not (isinstance(node, DictConfig) and isinstance(node.get("_target_"), str)):
            found = "nothing" if isinstance(node, DictConfig) and not len(node) else repr(node)
            raise InputError(
                f"config: {group}: expected a component with a _target_, found {found}; choose an option, "
                f"{group}=NAME, or write {group}: null"
            )


def _refused(config: DictConfig, names: Mapping[str, str]) -> str | None:
    """Say what keeps a person from being tracked with these parts, as `assemble` would, by what is known of them
    without importing them."""
    if config.study is not None or any(config[name] is None for name in ("dataset", "body", "inference")):
        return None
    return what_lacks(config, names) or incompatibility(config, names)
