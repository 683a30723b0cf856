"""A run that goes on where an earlier attempt at it was cut off, and so becomes the whole run."""

from collections.abc import Iterable
from pathlib import Path

from omegaconf import DictConfig

from workbench.experiment.config.identity import identity
from workbench.experiment.continuing import Continued
from workbench.recording.read.partial_run import Earlier, earlier, past_before
from workbench.recording.read.reader import read
from workbench.utils.errors import InputError


def resumed(config: DictConfig, recordings: Iterable[Path]) -> Continued | str | None:
    """Go on with the attempt at this configuration that got farthest; a text says why none can be gone on with.

    None where none has recorded a frame. What comes out is, but for pictures of marginals, what the run would have come
    to if nothing had cut it off: so the code must be the same, too.
    """
    found: list[Earlier] = []
    reason: str | None = None
    for recording in recordings:
        try:
            run = read(recording)
            if run.is_study or not len(run.poses[0]):
                continue
            if run.provenance.get("identity") != identity(config):
                reason = "the code, the configuration or a file that it names was another"
            elif (part := earlier(run)) is None:
                reason = "it had no checkpoint, which recorder.checkpoints=true stores"
            elif past_before(run, part.until) is not None:
                found.append(part)
        except InputError as error:
            reason = str(error)
    if not found:
        return reason
    best = max(found, key=lambda part: part.until)
    return Continued(best.run, best.until, config, changed=False, earlier=best)
