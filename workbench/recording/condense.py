"""Condensed recordings for regression tests: numbers without pictures."""

from pathlib import Path

from rerun.chunk import Chunk, ChunkStore, OptimizationProfile

from workbench.recording.read.chunks import EVERYTHING, read_chunks
from workbench.recording.read.reader import DRAWS, Run
from workbench.recording.write.file import CHOICES, SETTINGS
from workbench.recording.write.scene import ESTIMATE, TRUTH
from workbench.utils.errors import InputError

_PEOPLE = tuple(f"/{person}/{what}" for person in (ESTIMATE, TRUTH) for what in ("joints", "skeleton"))
_RETAINED = ("/__properties/", "/posterior/marginals", "/activity/", "/note", "/log", *_PEOPLE)
_CURVES = ("/metrics/", "/estimate/", "/flexion/")
_FLAT = tuple(f"/__properties/{name}" for name in (SETTINGS, CHOICES))


def condense(run: Run, path: Path) -> None:
    """Write a complete run to `path` with all numbers that a check compares, and skeletons.

    Images, bodies, particles, samples of the motion, credible intervals over time, styles of curves, drawings of a
    study's figures, the layout and the configuration key by key are omitted; the configuration as YAML stays. Raises
    InputError where the recording does not exist or `path` cannot be written.
    """
    chunks = [chunk for chunk in read_chunks(run.path, EVERYTHING) if _is_retained(chunk)]
    store = ChunkStore.from_chunks(chunks).stream().collect(optimize=OptimizationProfile.OBJECT_STORE)
    try:
        store.write_rrd(path, application_id="workbench", recording_id=run.id)
    except (RuntimeError, OSError) as error:
        raise InputError(f"{path}: cannot be written: {' '.join(str(error).split())}") from None


def is_condensed(run: Run) -> bool:
    """Return whether the run's recording has nothing that `condense` omits."""
    return all(_is_retained(chunk) for chunk in read_chunks(run.path, EVERYTHING))


def _is_retained(chunk: Chunk) -> bool:
    if chunk.entity_path.startswith("/figures/"):
        return "kind" in chunk.to_record_batch().schema.names  # a figure's numbers; its drawing has no kind
    if chunk.entity_path.startswith(_CURVES) and chunk.entity_path != f"/{DRAWS}":
        return not chunk.is_static  # the style of a curve is static
    return chunk.entity_path not in _FLAT and chunk.entity_path.startswith(_RETAINED)
