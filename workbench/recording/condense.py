"""A recording made small enough to be kept with the code."""

from pathlib import Path

from rerun.chunk import RrdReader

from workbench.recording.reader import Run

_LEFT_OUT = ["/posterior/parameters/**"]


def condense(run: Run, path: Path) -> None:
    """Write a complete run to `path` without its bands over time, which are most of a short run's bytes.

    The blueprint goes too: the viewer lays such a recording out by itself.
    """
    store = RrdReader(run.path).store().stream().drop(content=_LEFT_OUT).collect()
    store.write_rrd(path, application_id="workbench", recording_id=str(run.properties["run"]["id"]))
