"""Recorded runs in Python: a sequence that is a table, too."""

from pathlib import Path
from typing import Any

from workbench.recording.read.frame_tables import data_frame
from workbench.results.entry import Entry
from workbench.results.index import entries

_FIELDS = ("path", "recording", "status", "experiment", "seed", "started")
_USUAL = Path("recordings")


class Runs(tuple[Entry, ...]):
    """Runs, newest first; `workbench.read(runs[0].path)` opens one."""

    def table(self) -> dict[str, list[Any]]:
        """A row for each run: where it is, how it ended, what was chosen, and its numbers; None where it has none.

        Columns are the fields path, recording, status, experiment, seed and started, then the option chosen by group,
        then the numbers of any run by name.
        """
        choices = sorted({group for entry in self for group in entry.choices} - set(_FIELDS))
        numbers = sorted({name for entry in self for name in entry.metrics} - set(choices) - set(_FIELDS))
        columns: dict[str, list[Any]] = {name: [getattr(entry, name) for entry in self] for name in _FIELDS}
        columns |= {group: [entry.choices.get(group) for entry in self] for group in choices}
        return columns | {name: [entry.metrics.get(name) for entry in self] for name in numbers}

    def pandas(self) -> Any:
        """`table` as a pandas data frame; raises InputError where pandas is not installed."""
        return data_frame("pandas", self.table())

    def polars(self) -> Any:
        """`table` as a polars data frame; raises InputError where polars is not installed."""
        return data_frame("polars", self.table())


def runs(*places: str | Path) -> Runs:
    """The runs at and below these folders or recordings, newest first; without any, those below recordings/.

    What was read is kept in each folder's `.runs.json`. Raises InputError for a place that does not exist.
    """
    return Runs(entries(*(map(Path, places) if places else [_USUAL])))
