"""Small recordings of a walk, and what Rerun itself reads from them."""

from recording_steps import BODY, SPACE
from rerun.chunk import RrdReader

from workbench.recording.write.recorder import Recorder


def record(path, run, metrics=lambda step: {}, **options):
    """Record steps with the metrics of each; returns the path."""
    options = {"run_id": path.stem, "config_yaml": "", "provenance": {}, **options}
    with Recorder(path, BODY, options.pop("space", SPACE), **options) as recorder:
        for step in run:
            recorder.log(step, metrics(step))
    return path


def column(path, entity, component):
    """{frame: the component's value} of a temporal component; times in ns."""
    found = {}
    for chunk in RrdReader(path).stream().filter(content=entity, is_static=False):
        batch = chunk.to_record_batch()
        if component in batch.schema.names:
            values = batch.column(component).cast("int64") if component == "time" else batch.column(component)
            found.update(zip(batch.column("frame").to_pylist(), values.to_pylist(), strict=True))
    return found


def values(path, entity, component):
    """A temporal component's value in each frame, in order; of lists of one their item."""
    found = [value for _, value in sorted(column(path, entity, component).items())]
    return [value[0] if isinstance(value, list) and len(value) == 1 else value for value in found]


def static(path, entity, component):
    """The last value of a static component, None where there is none."""
    batches = [chunk.to_record_batch() for chunk in RrdReader(path).stream().filter(content=entity, is_static=True)]
    found = [batch.column(component).to_pylist()[-1] for batch in batches if component in batch.schema.names]
    return found[-1] if found else None


def components(path):
    """{(entity, static): set of component columns} of a recording."""
    found: dict[tuple[str, bool], set[str]] = {}
    for chunk in RrdReader(path).stream():
        names = set(chunk.to_record_batch().schema.names)
        found.setdefault((chunk.entity_path, chunk.is_static), set()).update(names)
    return found
