"""Small recordings of a walk, and readers of their contents that use only Rerun."""

from recording_steps import BODY, SPACE
from rerun.chunk import RrdReader

from workbench.recording.write.recorder import Recorder


def record(path, run, metrics=lambda step: {}, result=None, **options):
    """Record steps with their metrics and the run's result, and return the path."""
    options = {"run_id": path.stem, "config_yaml": "", "provenance": {}, **options}
    with Recorder(path, BODY, options.pop("space", SPACE), **options) as recorder:
        for step in run:
            recorder.log(step, metrics(step))
        if result:
            recorder.set_result(result)
    return path


def column(path, entity, component):
    """Return {frame: value} of a temporal component; times in ns."""
    rows = {}
    for chunk in RrdReader(path).stream().filter(content=entity, is_static=False):
        batch = chunk.to_record_batch()
        if component in batch.schema.names:
            values = batch.column(component).cast("int64") if component == "time" else batch.column(component)
            rows.update(zip(batch.column("frame").to_pylist(), values.to_pylist(), strict=True))
    return rows


def values(path, entity, component):
    """Return a temporal component's values in the order of frames; lists of one item become the item."""
    ordered = [value for _, value in sorted(column(path, entity, component).items())]
    return [value[0] if isinstance(value, list) and len(value) == 1 else value for value in ordered]


def static(path, entity, component):
    """Return the last value of a static component, or None."""
    batches = [chunk.to_record_batch() for chunk in RrdReader(path).stream().filter(content=entity, is_static=True)]
    rows = [batch.column(component).to_pylist()[-1] for batch in batches if component in batch.schema.names]
    return rows[-1] if rows else None


def components(path):
    """Return {(entity, static): set of component columns} of a recording."""
    columns: dict[tuple[str, bool], set[str]] = {}
    for chunk in RrdReader(path).stream():
        names = set(chunk.to_record_batch().schema.names)
        columns.setdefault((chunk.entity_path, chunk.is_static), set()).update(names)
    return columns
