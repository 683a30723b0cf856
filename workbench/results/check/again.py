"""Recorded configurations run again, alone and with other seeds."""

import json
from collections.abc import Sequence
from itertools import count, islice
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf
from tqdm import tqdm

from workbench.experiment.run import execute
from workbench.recording.read.reader import Run, read
from workbench.recording.settings import NO_EFFECT
from workbench.results.check.agreement import Agreement, Tolerance
from workbench.results.check.compare import Finding
from workbench.utils.errors import InputError
from workbench.utils.input_limits import parse_json
from workbench.utils.run_files import RECORDING

TOLERANCES = "tolerances.json"
"""Next to recordings that are checked: by how much their numbers may move in another environment."""


def tolerances(run: Run, own: DictConfig) -> dict[str, Tolerance]:
    """Return by how much a run's numbers may move in another environment.

    Measured ones from `tolerances.json` next to the recording, see `measured_tolerances`; of other numbers those in the
    recorded configuration, or today's where it has none. Raises InputError for what is no tolerance.
    """
    today: Any = OmegaConf.to_container(own.check)
    stored = run.settings.get("check", today)
    try:
        usual = {name: Tolerance(**{key: float(value) for key, value in keys.items()}) for name, keys in stored.items()}
    except (AttributeError, TypeError, ValueError):
        raise InputError(f"{run.path}: check: expected absolute and relative for every metric, found others") from None
    return usual | measured_tolerances(run.path)


def measured_tolerances(recording: Path) -> dict[str, Tolerance]:
    """Read those of a recording that `python -m analysis.tolerances` measured; empty where it has not."""
    path = recording.parent / TOLERANCES
    if not path.is_file():
        return {}
    measured = parse_json(path, path.read_text(encoding="utf-8"))
    try:
        numbers = measured["tolerances"].get(recording.stem, {})
        return {str(name): Tolerance(absolute=float(value)) for name, value in numbers.items()}
    except (AttributeError, KeyError, TypeError, ValueError):
        raise InputError(f"{path}: expected numbers by recording and metric under 'tolerances'") from None


def again(was: Run, config: DictConfig, folder: Path) -> Run | Finding:
    """Run a stored configuration again in `folder`; returns its recording or, where the run crashed, a finding."""
    try:
        execute(config, str(was.provenance.get("experiment", "custom")), folder, quiet=True)
        return read(folder / RECORDING)
    except Exception as error:  # noqa: BLE001 (whatever a run ends of, the check goes on and names it)
        cause = " ".join(f"{type(error).__name__}: {error}".split())
        return Finding("run", None, None, "complete", False, f"crashed: {cause}", Agreement.CHANGED)


def same_but_for_seeds(runs: Sequence[Run]) -> list[list[Run]]:
    """Group runs whose configurations differ only in the seed and what affects no number, in order of their first."""
    groups: dict[str, list[Run]] = {}
    for run in runs:
        kept = {key: value for key, value in run.settings.items() if key not in ("seed", *NO_EFFECT)}
        groups.setdefault(json.dumps(kept, sort_keys=True, default=str), []).append(run)
    return list(groups.values())


def with_other_seeds(group: Sequence[Run], config: DictConfig, n: int, folder: Path) -> list[Run] | Finding:
    """Run the group's configuration n times with the smallest seeds that none of the group has; or the first crash.

    Other seeds, since runs with the same ones are no independent sample.
    """
    taken = {run.settings.get("seed", 0) for run in group}
    found: list[Run] = []
    for seed in tqdm(list(islice((seed for seed in count() if seed not in taken), n)), unit="seed", disable=None):
        seeded = config.copy()
        seeded.seed = seed
        new = again(group[0], seeded, folder / str(seed))
        if isinstance(new, Finding):
            return new
        found.append(new)
    return found
