"""Run a stored configuration again."""

import json
from collections.abc import Sequence
from itertools import count, islice
from pathlib import Path

from omegaconf import DictConfig
from tqdm import tqdm

from workbench.experiment.execute import execute
from workbench.recording.compare.compare import Finding
from workbench.recording.read.reader import Run, read


def again(was: Run, config: DictConfig, folder: Path) -> Run | Finding:
    """The new run's recording, in `folder`; or, where the run crashed, that as a finding."""
    try:
        execute(config, str(was.provenance.get("experiment", "custom")), folder, quiet=True)
        return read(folder / "run.rrd")
    except Exception as error:  # noqa: BLE001 (whatever a run ends of, the check goes on and names it)
        cause = " ".join(f"{type(error).__name__}: {error}".split())
        return Finding("run", None, None, "complete", False, f"crashed: {cause}")


def same_but_for_seeds(runs: Sequence[Run]) -> list[list[Run]]:
    """The runs in groups of one configuration each, the seed and the paths left out; in the order of their first."""
    groups: dict[str, list[Run]] = {}
    for run in runs:
        kept = {key: value for key, value in run.settings.items() if key not in ("seed", "paths", "threads")}
        groups.setdefault(json.dumps(kept, sort_keys=True, default=str), []).append(run)
    return list(groups.values())


def with_other_seeds(group: Sequence[Run], config: DictConfig, n: int, folder: Path) -> list[Run] | Finding:
    """n runs of the group's configuration with the smallest seeds that none of the group has; or the first crash.

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
